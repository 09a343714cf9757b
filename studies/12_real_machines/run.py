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
from ldbb_bayes.inference.nodes import HyperPosterior
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
    found = analysed(MODELS["third"], campaign, machine, seed)
    row = {f"third/{name}": value for name, value in found.items()}
    certified = certificates_foretold(campaign) if kind in CERTIFIED_KINDS else {}
    for name in NAMES:
        for column in (f"before/{name}", f"foretold/{name}", f"unbounded/{name}"):
            row[column] = certified.get(column, np.nan)
    return row


def job_of_first(kind: str, seed: int) -> Row:
    """The same campaign by the first edition; verdicts and the change of C(F) are not kept."""
    campaign, machine = simulate(ALL[kind], seed)
    found = analysed(MODELS["first"], campaign, machine, seed)
    left_out = ("confounded", "prior-limited", "change/covered")
    return {f"first/{name}": value for name, value in found.items() if not name.endswith(left_out)}


def analysed(model: lb.HybridModel, campaign: lb.Campaign, machine: Machine, seed: int) -> Row:
    """Of every parameter: error in u, u, whether the interval covers it and its verdict; the same
    of C(F) without verdicts; of the result whether it says misfit, and that the centre shifts with
    force."""
    bound = model.bind(campaign)
    nodes = HyperPosterior(bound, truncated=True).nodes(TOLERANCE)
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
        drawn = curves[:, :, labels.index(name)]
        true = np.array([machine.secant(name, force) for force in ENDS])
        for k, force in enumerate(ENDS):
            row[f"{name} at {force:.0f} N/covered"] = covers(drawn[:, k], true[k])
        row[f"{name} change/covered"] = covers(drawn[:, 1] - drawn[:, 0], true[1] - true[0])
    return row


def covers(draws: Array, truth: float) -> bool:
    """Whether the interval of the draws holds the truth."""
    least, most = np.quantile(draws, LEVELS)
    return bool(least <= truth <= most)


def certificates_foretold(campaign: lb.Campaign) -> Row:
    """u of these readings without the certificates; u that these were to leave, as `identify` works
    it out before they are bought; and u that they leave if compliances may be negative."""
    bound = MODELS["third"].bind(replace(campaign, instrument=lb.Instrument()))
    before = standard_uncertainties(bound, truncated=True)
    expected = uncertainty_with(bound, CERTIFIED, *hyper_parameter_nodes(bound))
    unbounded = standard_uncertainties(MODELS["third"].bind(campaign), truncated=False)
    row: Row = {}
    for j, name in enumerate(NAMES):
        row[f"before/{name}"] = float(before[j])
        row[f"foretold/{name}"] = float(expected[j])
        row[f"unbounded/{name}"] = float(unbounded[j])
    return row


def standard_uncertainties(bound: BoundModel, *, truncated: bool) -> Array:
    """u of every parameter, shape (p,)."""
    return HyperPosterior(bound, truncated=truncated).nodes(TOLERANCE).moments()[1]


def of_family(rows: pd.DataFrame) -> dict[str, Any]:
    """What is stated of a family by every edition; widths of the third over the others."""
    found: dict[str, Any] = {}
    for edition in EDITIONS:
        rows_of_edition = rows[rows[f"{edition}/misfit"].notna()]
        found[edition] = of_edition(rows_of_edition, edition) if len(rows_of_edition) else None
    found["wider"] = {}
    for older in ("second", "first"):
        ratios = {name: rows[f"third/{name}/u"] / rows[f"{older}/{name}/u"] for name in NAMES}
        medians = {name: float(ratio.median()) for name, ratio in ratios.items()}
        found["wider"][older] = None if np.isnan(medians["C_XXX"]) else medians
    return found


def of_edition(rows: pd.DataFrame, edition: str) -> dict[str, Any]:
    """Coverage by group, by parameter and of C(F); errors beyond 3 u, the share of them of
    parameters called confounded, and those that were not; verdicts; coverage of the parameters that
    were not called confounded; alarms."""
    covered = {name: float(rows[f"{edition}/{name}/covered"].mean()) for name in NAMES}
    worst = min(covered, key=covered.__getitem__)
    far = np.array([rows[f"{edition}/{name}/error"].abs() > FAR for name in NAMES])
    inside = np.array([rows[f"{edition}/{name}/covered"] > 0 for name in NAMES])
    found = {
        "campaigns": len(rows),
        "coverage": {
            group: float(np.mean([covered[name] for name in names]))
            for group, names in GROUPS.items()
        },
        "by_parameter": covered,
        "worst": worst,
        "worst_coverage": covered[worst],
        "far": int(far.sum()),
        "curve": {
            f"{force:.0f}": curve_coverage(rows, edition, f"at {force:.0f} N") for force in ENDS
        },
        "change": curve_coverage(rows, edition, "change"),
        "alarms": float(rows[f"{edition}/misfit"].mean()),
        "centre": float(rows[f"{edition}/centre"].mean()),
    }
    if edition == "first":
        return found
    confounded = np.array([rows[f"{edition}/{name}/confounded"] > 0 for name in NAMES])
    unannounced = (far & ~confounded).sum(axis=1)
    return found | {
        "announced": float((far & confounded).sum() / far.sum()) if far.any() else 1.0,
        "unannounced": {
            name: int(count) for name, count in zip(NAMES, unannounced, strict=True) if count
        },
        "confounded": float(confounded.mean()),
        "confounded_by_parameter": {
            name: float(confounded[j].mean()) for j, name in enumerate(NAMES)
        },
        "prior_limited": prior_limited(rows, edition),
        "rest_coverage": float(inside[~confounded].mean()) if not confounded.all() else None,
    }


def prior_limited(rows: pd.DataFrame, edition: str) -> float | None:
    """Share of parameters called prior-limited, where that was kept."""
    columns = [f"{edition}/{name}/prior-limited" for name in NAMES]
    return float(rows[columns].mean().mean()) if set(columns) <= set(rows.columns) else None


def curve_coverage(rows: pd.DataFrame, edition: str, what: str) -> float | None:
    """Coverage of C(F) of both axes, or of its change, where that was kept."""
    columns = [f"{edition}/{name} {what}/covered" for name in CURVES]
    return float(rows[columns].mean().mean()) if set(columns) <= set(rows.columns) else None


def falls_short(rows: pd.DataFrame, families: dict[str, Any]) -> list[dict[str, Any]]:
    """What of the third edition is below what must hold, family by family; of a parameter, the
    share of the intervals that miss it which lie above it."""
    found = []
    for kind, editions in families.items():
        third = editions["third"]
        of_kind = rows[rows["kind"] == kind]
        for name, coverage in third["by_parameter"].items():
            if coverage < LEAST_OF_ONE:
                missed = of_kind[of_kind[f"third/{name}/covered"] == 0.0]
                above = float((missed[f"third/{name}/error"] > 0.0).mean())
                found.append({"family": kind, "what": name, "coverage": coverage, "above": above})
        pooled = {name: third["coverage"][name] for name in ("compliances", "geometric errors")}
        pooled |= {f"C(F) at {force} N": value for force, value in third["curve"].items()}
        for name, coverage in pooled.items():
            if coverage < LEAST_OF_GROUP:
                found.append({"family": kind, "what": name, "coverage": coverage, "above": None})
    return found


def widths(rows: pd.DataFrame) -> dict[str, dict[str, dict[str, float]]]:
    """Median u of every parameter by kind and edition, over that of the second edition in the mild
    family."""
    mild = rows[rows["kind"] == "mild"]
    reference = {name: mild[f"second/{name}/u"].median() for name in NAMES}
    found: dict[str, dict[str, dict[str, float]]] = {}
    for kind in ("mild", *PLANS):
        of_kind = rows[rows["kind"] == kind]
        found[kind] = {}
        for edition in ("third", "second"):
            ratio = {
                name: float(of_kind[f"{edition}/{name}/u"].median() / reference[name])
                for name in NAMES
            }
            found[kind][edition] = ratio
    return found


def worth_of_certificates(rows: pd.DataFrame) -> dict[str, Any]:
    """Median u of every parameter before and after certificates, and over what was foretold."""
    found: dict[str, Any] = {}
    for kind in CERTIFIED_KINDS:
        of_kind = rows[rows["kind"] == kind]
        found[kind] = {}
        for name in NAMES:
            after = of_kind[f"third/{name}/u"]
            found[kind][name] = {
                "before": float(of_kind[f"before/{name}"].median()),
                "after": float(after.median()),
                "foretold": float(of_kind[f"foretold/{name}"].median()),
                "over_foretold": float((after / of_kind[f"foretold/{name}"]).median()),
                "unbounded_over_foretold": float(
                    (of_kind[f"unbounded/{name}"] / of_kind[f"foretold/{name}"]).median()
                ),
            }
    return found


def published_both_ways() -> dict[str, dict[str, float]]:
    """u of geometric errors from the published experiment, simulated as if run both ways with balls
    of grade G10: as it is, as `identify` foretells it with the grade stated, and with it stated."""
    published = lb.read_campaign(DATA / "recovered_experiment")
    tests = []
    for test in published.plan().tests:
        for direction in ("CW", "CCW"):
            name = f"{test.name}_{direction}"
            tests.append(replace(test, direction=direction, name=name, time_s=None))
    order = np.random.default_rng(1).permutation(len(tests))
    stated = lb.Instrument(work=lb.Ball(grade="G10"), tool=lb.Ball(grade="G10"))
    plan = replace(published.plan(), tests=tuple(tests[k] for k in order), instrument=stated)
    model = MODELS["third"]
    truth = lb.fit_least_squares(published).estimate
    # Scales that the published readings tell are theirs, the others have their prior median.
    scales_um = lb.identify(model, plan).hyper_um
    learnt_um = lb.identify(model, published).hyper_um
    for name in scales_um:
        scales_um[name] = learnt_um.get(name.rpartition("_C")[0] or name, scales_um[name])
    simulated = model.simulate(plan, seed=1, parameters=truth, hyper_um=scales_um)
    readings = simulated.campaign
    unstated = replace(readings, instrument=published.instrument)
    foretold = lb.identify(model, unstated).certificates
    u_stated = standard_uncertainties(model.bind(readings), truncated=True)
    found = {}
    for name in FOLDED:
        found[name] = {
            "before": foretold["none of these"][name],
            "foretold": foretold[G10][name],
            "after": float(u_stated[NAMES.index(name)]),
        }
    return found


def measure(effort: Effort) -> dict[str, Any]:
    """Everything the page states."""
    kinds = dict.fromkeys([*FAMILIES, *NEW, *STATED], CAMPAIGNS)
    kinds |= dict.fromkeys(PLANS, CAMPAIGNS_OF_PLANS)
    rows = replicated(HERE / "campaigns.csv", job, kinds, effort, again=AGAIN)
    known_to_first = dict.fromkeys([*FAMILIES, *NEW, *STATED], CAMPAIGNS_OF_FIRST)
    first = replicated(
        HERE / "first_edition.csv", job_of_first, known_to_first, effort, again=AGAIN
    )
    second = pd.read_csv(HERE / "second_edition.csv")
    for older in (second, first):
        rows = rows.merge(older, on=["kind", "seed"], how="outer", validate="one_to_one")
    families = {kind: of_family(rows[rows["kind"] == kind]) for kind in kinds}
    return {
        "campaigns": CAMPAIGNS,
        "campaigns_of_plans": CAMPAIGNS_OF_PLANS,
        "se": float(np.sqrt(LEVEL * (1.0 - LEVEL) / CAMPAIGNS)),
        "readings": READINGS,
        "forces_N": list(FORCES_N),
        "far": FAR,
        "bar_U_um": CERTIFIED.bar_U_um,
        "mount_U_percent": CERTIFIED.mount_U_percent,
        "sizes": {
            kind: {name: value for name, value in vars(family).items() if name not in _NOT_SIZES}
            for kind, family in NEW.items()
        },
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


@lb.figures.styled
def coverage_figure(families: dict[str, Any]) -> Figure:
    """Coverage of every parameter in every family, the editions side by side."""
    figure = lb.figures.new_figure(12.0, 5.6)
    panels = figure.subplots(1, len(EDITIONS))
    for k, edition in enumerate(reversed(EDITIONS)):
        axes = panels[k]
        values = np.full((len(families), len(NAMES)), np.nan)
        for i, editions in enumerate(families.values()):
            if editions[edition] is not None:
                values[i] = [editions[edition]["by_parameter"][name] for name in NAMES]
        image = axes.imshow(100.0 * values, vmin=0.0, vmax=100.0, cmap="RdYlBu", aspect="auto")
        axes.set_xticks(
            range(len(NAMES)),
            [name.replace("C0YX", "C(0Y)X") for name in NAMES],
            rotation=90,
            fontsize=6,
        )
        axes.set_yticks(
            range(len(families)), list(families) if k == 0 else [""] * len(families), fontsize=7
        )
        axes.set_title(f"{edition} edition", fontsize=10)
        axes.grid(visible=False)
    figure.colorbar(image, ax=list(panels), label="95 % intervals that cover (%)")
    return figure


def main() -> None:
    """Measure and compare with what is stated; ``--write`` states anew."""
    run(Study(HERE, measure, lambda results: {"coverage": coverage_figure(results["families"])}))


if __name__ == "__main__":
    main()
