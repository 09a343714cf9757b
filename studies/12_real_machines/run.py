"""Do intervals hold on real machines? Families of exactly simulated machines, the model's third
edition beside its second and its first.

python studies/12_real_machines/run.py            # fails when a stated number is not reproduced
python studies/12_real_machines/run.py --write    # states anew
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray

import ldbb_bayes as lb
from ldbb_bayes.analysis.hyper_parameter_nodes import hyper_parameter_nodes
from ldbb_bayes.analysis.value_of_certificates import uncertainty_with
from ldbb_bayes.analysis.verdicts import judge_parameters
from ldbb_bayes.inference.centre_shift import centre_shift
from ldbb_bayes.inference.checks import check_predictions
from ldbb_bayes.inference.effects_of_failures import effects_of_failures
from ldbb_bayes.inference.elastic_deflections import compliance_curves
from ldbb_bayes.inference.fit import Fit
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.nodes import compute_nodes
from ldbb_bayes.model.bound_information import information_of
from ldbb_bayes.model.hybrid import BoundModel

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
sys.path.insert(0, str(HERE))
from left_out_circles import left_out_circles
from machines import (
    CERTIFIED,
    FAMILIES,
    FORCES_N,
    NEW,
    PLANS,
    READINGS,
    STATED,
    Disturbances,
    Machine,
    simulate,
)
from repairs import repairs
from shortfalls import holders_of_mild, shortfalls
from study import DATA, Effort, Study, replicated, run

Array = NDArray[np.float64]
Row = dict[str, float]

CAMPAIGNS = 60
# Of the mild machines measured by other plans.
CAMPAIGNS_OF_PLANS = 60
CAMPAIGNS_OF_FIRST = 60
AGAIN: dict[Effort, int] = {"quick": 1, "usual": 3}
ALL = FAMILIES | NEW | STATED | PLANS
# Number of campaigns of every kind, and of those that the first edition analysed.
KINDS = dict.fromkeys([*FAMILIES, *NEW, *STATED], CAMPAIGNS) | dict.fromkeys(
    PLANS, CAMPAIGNS_OF_PLANS
)
KINDS_OF_FIRST = dict.fromkeys([*FAMILIES, *NEW, *STATED], CAMPAIGNS_OF_FIRST)
# The second edition can no longer be computed: its rows are kept as they were.
EDITIONS = ("third", "second", "first")
MODELS = {"third": lb.HybridModel.default(1), "first": lb.HybridModel.first(1)}
NAMES = MODELS["first"].bind(simulate(FAMILIES["mild"], 0)[0]).names
GROUPS = {
    "compliances": [name for name in NAMES if name.startswith("C") and not name.endswith("_1")],
    "slopes": [name for name in NAMES if name.endswith("_1") and name.startswith("C")],
    "geometric errors": [name for name in NAMES if name.startswith("E")],
}
CERTIFIED_KINDS = ("mild, certificates", "mild, both ways, shuffled, certificates")
LEVELS = np.array([0.025, 0.975])
TOLERANCE = 0.05
DRAWS = 4000
FAR = 3.0
CURVES = ("C_XXX", "C_YYY")
ENDS = (FORCES_N[0], FORCES_N[-1])
LEVEL = 0.95
# What must hold in every family: of each parameter, of groups and of C(F) at the ends; of the mild
# family's parameters that may be called confounded; of errors beyond 3 u that must be.
LEAST_OF_ONE = 0.90
LEAST_OF_GROUP = 0.93
MOST_CONFOUNDED = 0.40
LEAST_ANNOUNCED = 0.95
# What a family states beside the sizes of its effects, or has in other studies alone.
_NOT_SIZES = ("stated", "scatter", "uneven")
# What is compared of the published experiment run both ways.
FOLDED = ("E_C0YX", "E_YX2", "E_XY2")
G10 = "balls of grade G10"


def job(kind: str, seed: int) -> Row:
    """One campaign by the third edition; with certificates, u without them, u foretold and u if no
    compliance were held at zero or above."""
    campaign, machine = simulate(ALL[kind], seed)
    analysis = analysed(MODELS["third"], campaign, machine, seed)
    row = {f"third/{name}": value for name, value in analysis.items()}
    certified: Row = {}
    if kind in CERTIFIED_KINDS:
        certified = certificates_foretold(campaign)
    for name in NAMES:
        for column in (f"before/{name}", f"foretold/{name}", f"unbounded/{name}"):
            row[column] = certified.get(column, np.nan)
    return row


def job_of_first(kind: str, seed: int) -> Row:
    """The same campaign by the first edition; verdicts and the change of C(F) are not stated."""
    campaign, machine = simulate(ALL[kind], seed)
    analysis = analysed(MODELS["first"], campaign, machine, seed)
    omitted = ("confounded", "prior-limited", "change/covered")
    return {
        f"first/{name}": value for name, value in analysis.items() if not name.endswith(omitted)
    }


def analysed(model: lb.HybridModel, campaign: lb.Campaign, machine: Machine, seed: int) -> Row:
    """Of every parameter: error in u, u, whether the interval covers it and its verdict; the same
    of C(F) without verdicts; of the result whether it says misfit, and that the centre shifts with
    force."""
    bound = model.bind(campaign)
    nodes = compute_nodes(HyperPosterior(bound, truncated=True), TOLERANCE)
    mean, sd = nodes.moments()
    beta, phi = nodes.draw(DRAWS, np.random.default_rng(seed))
    low, high = np.quantile(beta, LEVELS, axis=0)
    row: Row = {
        "misfit": bool(fit_of(bound, phi, beta, seed).misfits),
        "centre": bool(centre_shift(bound, mean)),
    }
    verdicts = judge_parameters(bound, information_of(bound, phi.mean(axis=0)), mean)
    for j, name in enumerate(NAMES):
        truth = machine.truth[name]
        row[f"{name}/error"] = (mean[j] - truth) / sd[j]
        row[f"{name}/u"] = sd[j]
        row[f"{name}/covered"] = low[j] <= truth <= high[j]
        row[f"{name}/confounded"] = verdicts[name].verdict == "confounded"
        row[f"{name}/prior-limited"] = verdicts[name].verdict == "prior-limited"
    return row | curves_covered(bound, phi, beta, machine, seed)


def fit_of(bound: BoundModel, phi: Array, beta: Array, seed: int) -> Fit:
    """What the checks of a fit say."""
    checks = check_predictions(bound, phi, beta, np.random.default_rng(seed))
    effects = effects_of_failures(bound, phi.mean(axis=0), checks)
    return Fit(0.0, {}, 0.0, 0.0, 0.0, 0.0, (), checks, {}, *effects)


def curves_covered(bound: BoundModel, phi: Array, beta: Array, machine: Machine, seed: int) -> Row:
    """Whether intervals cover C(F) of both axes at the smallest and the largest force, and its
    change between them; the truth is the spring's own law."""
    curves = compliance_curves(
        bound, phi[::4], beta[::4], np.array(ENDS), np.random.default_rng(seed)
    )
    labels = [label.label for label in bound.compliances]
    row: Row = {}
    for name in CURVES:
        draws = curves[:, :, labels.index(name)]
        truth = np.array([machine.secant(name, force) for force in ENDS])
        for k, force in enumerate(ENDS):
            row[f"{name} at {force:.0f} N/covered"] = covers(draws[:, k], truth[k])
        row[f"{name} change/covered"] = covers(draws[:, 1] - draws[:, 0], truth[1] - truth[0])
    return row


def covers(draws: Array, truth: float) -> bool:
    """Whether the interval of the draws holds the truth."""
    low, high = np.quantile(draws, LEVELS)
    return bool(low <= truth <= high)


def certificates_foretold(campaign: lb.Campaign) -> Row:
    """u of these readings without the certificates; u that these were to leave, as `identify` works
    it out before they are bought; and u that they leave if compliances may be negative."""
    bound = MODELS["third"].bind(replace(campaign, instrument=lb.Instrument()))
    uncertified = standard_uncertainties(bound, truncated=True)
    expected = uncertainty_with(bound, CERTIFIED, *hyper_parameter_nodes(bound))
    unbounded = standard_uncertainties(MODELS["third"].bind(campaign), truncated=False)
    row: Row = {}
    for j, name in enumerate(NAMES):
        row[f"before/{name}"] = float(uncertified[j])
        row[f"foretold/{name}"] = float(expected[j])
        row[f"unbounded/{name}"] = float(unbounded[j])
    return row


def standard_uncertainties(bound: BoundModel, *, truncated: bool) -> Array:
    """u of every parameter, shape (p,)."""
    return compute_nodes(HyperPosterior(bound, truncated=truncated), TOLERANCE).moments()[1]


def of_family(rows: pd.DataFrame) -> dict[str, Any]:
    """What is stated of a family by every edition; widths of the third over the others."""
    numbers: dict[str, Any] = {}
    for edition in EDITIONS:
        analysed_rows = rows[rows[f"{edition}/misfit"].notna()]
        numbers[edition] = None
        if len(analysed_rows):
            numbers[edition] = of_edition(analysed_rows, edition)
    numbers["wider"] = {older: widening(rows, older) for older in ("second", "first")}
    return numbers


def widening(rows: pd.DataFrame, older: str) -> dict[str, float] | None:
    """Median ratio of u by the third edition to that by an older one, of every parameter; None
    where the older edition was not computed."""
    medians = {}
    for name in NAMES:
        ratio = rows[f"third/{name}/u"] / rows[f"{older}/{name}/u"]
        medians[name] = float(ratio.median())
    return None if np.isnan(medians["C_XXX"]) else medians


def of_edition(rows: pd.DataFrame, edition: str) -> dict[str, Any]:
    """Coverage by group, by parameter and of C(F); number of errors beyond 3 u; alarms; and, but
    for the first edition, verdicts."""
    coverage = {name: float(rows[f"{edition}/{name}/covered"].mean()) for name in NAMES}
    worst = min(coverage, key=coverage.__getitem__)
    curve = {f"{force:.0f}": curve_coverage(rows, edition, f"at {force:.0f} N") for force in ENDS}
    numbers = {
        "campaigns": len(rows),
        "coverage": coverage_of_groups(coverage),
        "by_parameter": coverage,
        "worst": worst,
        "worst_coverage": coverage[worst],
        "far": int(is_far(rows, edition).sum()),
        "curve": curve,
        "change": curve_coverage(rows, edition, "change"),
        "alarms": float(rows[f"{edition}/misfit"].mean()),
        "centre": float(rows[f"{edition}/centre"].mean()),
    }
    if edition != "first":
        numbers |= of_verdicts(rows, edition)
    return numbers


def coverage_of_groups(coverage: dict[str, float]) -> dict[str, float]:
    """Mean coverage of compliances, slopes and geometric errors."""
    means = {}
    for group, names in GROUPS.items():
        means[group] = float(np.mean([coverage[name] for name in names]))
    return means


def is_far(rows: pd.DataFrame, edition: str) -> NDArray[np.bool_]:
    """Whether an error is beyond 3 u, shape (parameters, campaigns)."""
    return np.array([rows[f"{edition}/{name}/error"].abs() > FAR for name in NAMES])


def of_verdicts(rows: pd.DataFrame, edition: str) -> dict[str, Any]:
    """Errors beyond 3 u: the share of them of parameters called confounded, and those that were
    not; verdicts; coverage of the parameters that were not called confounded."""
    far = is_far(rows, edition)
    covered = np.array([rows[f"{edition}/{name}/covered"] > 0 for name in NAMES])
    confounded = np.array([rows[f"{edition}/{name}/confounded"] > 0 for name in NAMES])
    announced = 1.0
    if far.any():
        announced = float((far & confounded).sum() / far.sum())
    unannounced = {}
    for name, count in zip(NAMES, (far & ~confounded).sum(axis=1), strict=True):
        if count:
            unannounced[name] = int(count)
    coverage_of_others = None
    if not confounded.all():
        coverage_of_others = float(covered[~confounded].mean())
    return {
        "announced": announced,
        "unannounced": unannounced,
        "confounded": float(confounded.mean()),
        "confounded_by_parameter": {
            name: float(confounded[j].mean()) for j, name in enumerate(NAMES)
        },
        "prior_limited": prior_limited(rows, edition),
        "rest_coverage": coverage_of_others,
    }


def prior_limited(rows: pd.DataFrame, edition: str) -> float | None:
    """Share of parameters called prior-limited, where the rows have it."""
    return mean_of_columns(rows, [f"{edition}/{name}/prior-limited" for name in NAMES])


def curve_coverage(rows: pd.DataFrame, edition: str, quantity: str) -> float | None:
    """Coverage of C(F) of both axes, or of its change, where the rows have it."""
    return mean_of_columns(rows, [f"{edition}/{name} {quantity}/covered" for name in CURVES])


def mean_of_columns(rows: pd.DataFrame, columns: list[str]) -> float | None:
    """Mean of all the columns; None if one of them is not there."""
    if not set(columns) <= set(rows.columns):
        return None
    return float(rows[columns].mean().mean())


def falls_short(rows: pd.DataFrame, families: dict[str, Any]) -> list[dict[str, Any]]:
    """What of the third edition is below what must hold, family by family."""
    shortfalls_of_all = []
    for kind, editions in families.items():
        third = editions["third"]
        of_kind = rows[rows["kind"] == kind]
        coverages = dict(third["by_parameter"])
        limits = dict.fromkeys(coverages, LEAST_OF_ONE)
        pooled = {name: third["coverage"][name] for name in ("compliances", "geometric errors")}
        pooled |= {f"C(F) at {force} N": value for force, value in third["curve"].items()}
        coverages |= pooled
        limits |= dict.fromkeys(pooled, LEAST_OF_GROUP)
        for name, coverage in coverages.items():
            if coverage < limits[name]:
                above = None if name in pooled else share_above(of_kind, name)
                shortfall = {"family": kind, "what": name, "coverage": coverage, "above": above}
                shortfalls_of_all.append(shortfall)
    return shortfalls_of_all


def share_above(rows: pd.DataFrame, name: str) -> float:
    """Of the intervals that miss a parameter by the third edition, the share that lie above it."""
    missed = rows[rows[f"third/{name}/covered"] == 0.0]
    return float((missed[f"third/{name}/error"] > 0.0).mean())


def widths(rows: pd.DataFrame) -> dict[str, dict[str, dict[str, float]]]:
    """Median u of every parameter by kind and edition, over that of the second edition in the mild
    family."""
    mild = rows[rows["kind"] == "mild"]
    reference = {name: mild[f"second/{name}/u"].median() for name in NAMES}
    ratios: dict[str, dict[str, dict[str, float]]] = {}
    for kind in ("mild", *PLANS):
        of_kind = rows[rows["kind"] == kind]
        ratios[kind] = {}
        for edition in ("third", "second"):
            medians = {name: of_kind[f"{edition}/{name}/u"].median() for name in NAMES}
            ratios[kind][edition] = {name: float(medians[name] / reference[name]) for name in NAMES}
    return ratios


def worth_of_certificates(rows: pd.DataFrame) -> dict[str, Any]:
    """Median u of every parameter before and after certificates, and over what was foretold."""
    worth: dict[str, Any] = {}
    for kind in CERTIFIED_KINDS:
        of_kind = rows[rows["kind"] == kind]
        worth[kind] = {}
        for name in NAMES:
            certified = of_kind[f"third/{name}/u"]
            uncertified = of_kind[f"before/{name}"]
            unbounded = of_kind[f"unbounded/{name}"]
            foretold = of_kind[f"foretold/{name}"]
            worth[kind][name] = {
                "before": float(uncertified.median()),
                "after": float(certified.median()),
                "foretold": float(foretold.median()),
                "over_foretold": float((certified / foretold).median()),
                "unbounded_over_foretold": float((unbounded / foretold).median()),
            }
    return worth


def published_both_ways() -> dict[str, dict[str, float]]:
    """u of geometric errors from the published experiment, simulated as if run both ways with balls
    of grade G10: as it is, as `identify` foretells it with the grade stated, and with it stated."""
    model = MODELS["third"]
    published = lb.read_campaign(DATA / "recovered_experiment")
    plan = plan_both_ways(published)
    truth = lb.fit_least_squares(published).estimate
    scales_um = scales_of_published(model, plan, published)
    readings = model.simulate(plan, seed=1, parameters=truth, hyper_um=scales_um).campaign
    unstated = replace(readings, instrument=published.instrument)
    foretold = lb.identify(model, unstated).certificates
    u_stated = standard_uncertainties(model.bind(readings), truncated=True)
    uncertainties = {}
    for name in FOLDED:
        uncertainties[name] = {
            "before": foretold["none of these"][name],
            "foretold": foretold[G10][name],
            "after": float(u_stated[NAMES.index(name)]),
        }
    return uncertainties


def plan_both_ways(published: lb.Campaign) -> lb.Campaign:
    """Every published circle in both directions, in an order of chance, balls of grade G10."""
    tests = []
    for test in published.plan().tests:
        for direction in ("CW", "CCW"):
            name = f"{test.name}_{direction}"
            tests.append(replace(test, direction=direction, name=name, time_s=None))
    order = np.random.default_rng(1).permutation(len(tests))
    shuffled = tuple(tests[k] for k in order)
    stated = lb.Instrument(work=lb.Ball(grade="G10"), tool=lb.Ball(grade="G10"))
    return replace(published.plan(), tests=shuffled, instrument=stated)


def scales_of_published(
    model: lb.HybridModel, plan: lb.Campaign, published: lb.Campaign
) -> dict[str, float]:
    """Hyper-parameters of the plan [µm]: those that the published readings tell are theirs, the
    others have their prior median."""
    scales_um = lb.identify(model, plan).hyper_um
    learnt_um = lb.identify(model, published).hyper_um
    for name in scales_um:
        name_published = name.rpartition("_C")[0] or name
        scales_um[name] = learnt_um.get(name_published, scales_um[name])
    return scales_um


def measure(effort: Effort) -> dict[str, Any]:
    """Everything the page states."""
    rows = rows_of_all_editions(effort)
    families = {kind: of_family(rows[rows["kind"] == kind]) for kind in KINDS}
    return {
        "campaigns": CAMPAIGNS,
        "campaigns_of_plans": CAMPAIGNS_OF_PLANS,
        "se": float(np.sqrt(LEVEL * (1.0 - LEVEL) / CAMPAIGNS)),
        "readings": READINGS,
        "forces_N": list(FORCES_N),
        "far": FAR,
        "bar_U_um": CERTIFIED.bar_U_um,
        "mount_U_percent": CERTIFIED.mount_U_percent,
        "sizes": {kind: sizes_of(family) for kind, family in NEW.items()},
        "travel": list(FAMILIES["travel"].travel),
        "travel_expected": lb.terms.Position().quadratic_sd,
        "seat_expected": lb.terms.JointLoad().relative_sd,
        "mismatch_of_both_ways_um": FAMILIES["both ways"].mismatch_um,
        "new": list(NEW),
        "plans": list(PLANS),
        "must": {
            "one": LEAST_OF_ONE,
            "group": LEAST_OF_GROUP,
            "confounded": MOST_CONFOUNDED,
            "announced": LEAST_ANNOUNCED,
        },
        "families": families,
        "falls_short": falls_short(rows, families),
        "shortfalls": shortfalls(effort),
        "holders_of_mild": holders_of_mild(),
        "widths": widths(rows),
        "certificates": worth_of_certificates(rows),
        "published_both_ways": published_both_ways(),
        "left_out": left_out_circles(effort),
        "repairs": repairs(effort),
    }


def rows_of_all_editions(effort: Effort) -> pd.DataFrame:
    """One row for each campaign, with the columns of every edition that analysed it."""
    rows = replicated(HERE / "campaigns.csv", job, KINDS, effort, again=AGAIN)
    first = replicated(
        HERE / "first_edition.csv", job_of_first, KINDS_OF_FIRST, effort, again=AGAIN
    )
    second = pd.read_csv(HERE / "second_edition.csv")
    for older in (second, first):
        rows = rows.merge(older, on=["kind", "seed"], how="outer", validate="one_to_one")
    return rows


def sizes_of(family: Disturbances) -> dict[str, Any]:
    """Sizes of the effects of a family."""
    return {name: value for name, value in vars(family).items() if name not in _NOT_SIZES}


@lb.figures.styled
def coverage_figure(families: dict[str, Any]) -> Figure:
    """Coverage of every parameter in every family, the editions side by side."""
    figure = lb.figures.new_figure(12.0, 5.6)
    panels = figure.subplots(1, len(EDITIONS))
    parameter_labels = [name.replace("C0YX", "C(0Y)X") for name in NAMES]
    family_labels = list(families)
    for axes, edition in zip(panels, reversed(EDITIONS), strict=True):
        values = np.full((len(families), len(NAMES)), np.nan)
        for i, editions in enumerate(families.values()):
            if editions[edition] is not None:
                values[i] = [editions[edition]["by_parameter"][name] for name in NAMES]
        image = axes.imshow(100.0 * values, vmin=0.0, vmax=100.0, cmap="RdYlBu", aspect="auto")
        axes.set_xticks(range(len(NAMES)), parameter_labels, rotation=90, fontsize=6)
        axes.set_yticks(range(len(families)), family_labels, fontsize=7)
        # Only the first panel names the families.
        family_labels = [""] * len(families)
        axes.set_title(f"{edition} edition", fontsize=10)
        axes.grid(visible=False)
    figure.colorbar(image, ax=list(panels), label="95 % intervals that cover (%)")
    return figure


def draw(results: dict[str, Any]) -> dict[str, Figure]:
    """Figures of the page."""
    return {"coverage": coverage_figure(results["families"])}


def main() -> None:
    """Measure and compare with what is stated; ``--write`` states anew."""
    run(Study(HERE, measure, draw))


if __name__ == "__main__":
    main()
