"""Does the computation return the posterior it claims to, what does Ĉ cost, and what happens when a
nuisance is left out?

python studies/06_validation/run.py            # fails when a stated number is not reproduced
python studies/06_validation/run.py --write    # states anew
"""

from __future__ import annotations

import re
import sys
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import ldbb_bayes as lb
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.nodes import compute_nodes
from ldbb_bayes.model.fourier import basis

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE)]
import estimates
from estimates import DRAWS, EMCEE, WIDTH
from study import Effort, Study, executor, kept, replicated, run

FORCES_N = (36.0, 238.0, 364.0, 490.0, 616.0, 742.0)
ARC_DEG = 220.0
STEP_DEG = 2.0
# How many times as many readings the case of more readings has.
MORE = 4
SEED = 6
# Of the band that ranks should stay within, and of the intervals whose coverage is stated.
PROBABILITY = 0.99
SHARE = 0.95
# Coverage below this is counted.
LOW = 0.9
# Campaigns of each case that are made again with ``--quick``.
AGAIN = 10
LINEAR = lb.HybridModel.first(1)
THIRD = estimates.MODEL
KEPT = HERE / "ranks.csv"
KEPT_THIRD = HERE / "third_edition.csv"
# What intervals of slopes should cover, pooled, as a user runs it.
SLOPES_ASKED = 0.93
# Campaigns of the third edition, by how Ĉ is found.
CAMPAIGNS_OF = {"every term": 100, "estimated": 1000, "squares": 100, "truth": 1000}
THIRD_AGAIN: dict[Effort, int] = {"quick": 2, "usual": 10}
# Made again through `lb.calibrate`, as a user runs it: its fewest.
FEWEST = 10
# What was measured when the second edition was the default; it cannot be made again.
KEPT_SECOND = HERE / "second_edition.csv"
WORDS_OF_SECOND = {
    "every term": "every term, linearised at one point",
    "estimated": "Ĉ of the readings, by least squares",
}
# A draw equal to the truth within rounding falls on either side of it, by version of the libraries.
ONE_RANK = 1.5 / DRAWS
# And where the choice of a draw hangs on rounding, all that follow are others.
ASTRAY = 0.01
NUISANCES = (
    "ball-form",
    "bar-length",
    "mount",
    "force-error",
    "setup-shift",
    "discrepancy",
    "hysteresis",
)
# Seven circles of a machine like those of study 12; some with an odd one.
SEVEN_N = (36.0, 112.0, 238.0, 364.0, 490.0, 616.0, 742.0)
ODD_UM = 3.0
CAMPAIGNS = 40
LEVELS = np.array([0.025, 0.975])
# Of the nodes of an integral over the hyper-parameters.
TOLERANCE = 0.05
COMPONENTS = 2048
ODD_AGAIN: dict[Effort, int] = {"quick": 1, "usual": 3}
# Marks of the groups of parameters in the figure, and where they stand beside their case.
MARKS = {"C": ("o", -0.22), "slope": ("^", 0.0), "E": ("s", 0.22)}


@dataclass(frozen=True)
class Case:
    """A model that analyses, the model that makes the readings, where, how often, and the seed."""

    words: str
    model: lb.HybridModel
    generator: lb.HybridModel
    plan: lb.Plan
    replicates: int
    seed: int = SEED


def plan(*, arc_deg: float = 360.0, clocked: bool = False, step_deg: float = STEP_DEG) -> lb.Plan:
    """The forces of the recovered experiment; both balls turned from circle to circle where
    asked."""
    turns = list(product((0.0, 45.0, 90.0), repeat=2))
    if not clocked:
        turns = [(0.0, 0.0)]
    angle = np.arange(0.0, arc_deg, step_deg)
    tests = []
    for k, force_N in enumerate(FORCES_N):
        work_ball_deg, tool_ball_deg = turns[k % len(turns)]
        test = lb.CircularTest(
            force_N, angle, work_ball_deg=work_ball_deg, tool_ball_deg=tool_ball_deg
        )
        tests.append(test)
    return lb.Plan(tuple(tests))


def cases() -> dict[str, Case]:
    """What must be calibrated, and what cannot be."""
    full = plan()
    constant = LINEAR.with_degree(0)
    return {
        "linear": Case("linear compliance, full circles", LINEAR, LINEAR, full, 600),
        "constant": Case("constant compliance, full circles", constant, constant, full, 300),
        "untruncated": Case(
            "no truncation", LINEAR.without("truncation"), LINEAR.without("truncation"), full, 300
        ),
        "arcs": Case("arcs", LINEAR, LINEAR, plan(arc_deg=ARC_DEG), 300),
        "clocked": Case("both balls turned in between", LINEAR, LINEAR, plan(clocked=True), 300),
        "no discrepancy": Case(
            "discrepancy left out", LINEAR.without("discrepancy"), LINEAR, full, 200
        ),
        "no discrepancy, more readings": Case(
            "discrepancy left out, more readings",
            LINEAR.without("discrepancy"),
            LINEAR,
            plan(step_deg=STEP_DEG / MORE),
            200,
        ),
        "no ball form": Case("ball form left out", LINEAR.without("ball-form"), LINEAR, full, 200),
        "no set-up shift": Case(
            "set-up shift left out", LINEAR.without("setup-shift"), LINEAR, full, 200
        ),
        "white noise": Case(
            "all nuisances left out", LINEAR.without(*NUISANCES), LINEAR, full, 200
        ),
    }


def ranked(case: Case, replicates: int, pool: Executor | None) -> lb.analysis.Validation:
    """Simulated, inferred and ranked; the first replicates are the same however many follow."""
    return lb.calibrate(
        case.model,
        case.plan,
        replicates=replicates,
        draws=DRAWS,
        generator=case.generator,
        prob=PROBABILITY,
        seed=case.seed,
        executor=pool,
    )


def all_ranks(effort: Effort) -> pd.DataFrame:
    """Ranks of every case of the first edition, one row per replicate; made again as far as the
    effort goes, and all that are in the file."""
    tables = []
    counts = {}
    with executor() as pool:
        for kind, case in cases().items():
            counts[kind] = case.replicates
            replicates = case.replicates
            if effort == "quick":
                replicates = min(AGAIN, replicates)
            calibration = ranked(case, replicates, pool)
            if calibration.failures:
                sys.exit(f"06_validation, {kind}: {calibration.failures[0]}")
            tables.append(ranks_of(calibration).assign(kind=kind))
    return kept(KEPT, pd.concat(tables), counts, effort, tolerance=ONE_RANK, astray=ASTRAY)


def ranks_of(calibration: lb.analysis.Validation) -> pd.DataFrame:
    """One row for each replicate."""
    ranks = pd.DataFrame(calibration.ranks.astype(float), columns=list(calibration.names))
    return ranks.assign(seed=range(len(ranks)))


def third_ranks(effort: Effort) -> pd.DataFrame:
    """Ranks of the third edition, by how Ĉ is found; some are made again, those of a user through
    `lb.calibrate`."""
    rows = replicated(
        KEPT_THIRD, estimates.row, CAMPAIGNS_OF, effort, again=THIRD_AGAIN, tolerance=ONE_RANK
    )
    with executor() as pool:
        calibration = lb.calibrate(
            THIRD,
            estimates.everything(),
            replicates=FEWEST,
            draws=DRAWS,
            prob=PROBABILITY,
            seed=SEED,
            executor=pool,
        )
    estimated = rows[rows["kind"] == "estimated"].sort_values("seed").head(FEWEST)
    ranks = estimated[list(calibration.names)].to_numpy()
    differs = (np.abs(ranks - calibration.ranks) > 1.5).any(axis=1)
    if differs.sum() > 1:
        sys.exit(f"06_validation: `lb.calibrate` differs from {KEPT_THIRD.name}")
    return rows


def validation(ranks: pd.DataFrame, kind: str) -> lb.analysis.Validation:
    """The ranks of one case as `lb.calibrate` returns them."""
    of_kind = ranks[ranks["kind"] == kind].drop(columns=["kind", "seed"]).dropna(axis="columns")
    of_kind = of_kind[[name for name in of_kind if not name.startswith(WIDTH)]]
    by_emcee: tuple[int, ...] = ()
    if EMCEE in of_kind:
        by_emcee = tuple(np.flatnonzero(of_kind.pop(EMCEE)).tolist())
    return lb.analysis.Validation(
        tuple(of_kind.columns),
        of_kind.to_numpy(dtype=int),
        DRAWS,
        "independent",
        PROBABILITY,
        (),
        by_emcee,
    )


def coverages(calibration: lb.analysis.Validation) -> dict[str, float]:
    """Of the 95 % intervals of compliances, slopes and geometric errors."""
    shares = calibration.coverage()[f"{100 * SHARE:g}"]
    return {
        str(name): float(value)
        for name, value in shares.items()
        if str(name).startswith(("C_", "E_"))
    }


def pooled(share: dict[str, float]) -> dict[str, float]:
    """Mean coverage of compliances, slopes and geometric errors, where there are any."""
    groups: dict[str, list[float]] = {}
    for name, value in share.items():
        groups.setdefault(_group(name), []).append(value)
    return {group: float(np.mean(values)) for group, values in groups.items()}


def stated(words: str, calibration: lb.analysis.Validation) -> dict[str, Any]:
    """What the page says of one case."""
    coverage = coverages(calibration)
    worst = min(coverage, key=coverage.__getitem__)
    return {
        "words": words,
        "replicates": calibration.replicates,
        "quantities": len(calibration.names),
        "outside": len(calibration.outside),
        "outside_names": list(calibration.outside),
        "coverage": coverage,
        "mean_coverage": float(np.mean(list(coverage.values()))),
        "pooled": pooled(coverage),
        "worst_coverage": coverage[worst],
        "worst": worst.replace("C0YX", "C(0Y)X"),
        "below_90": sum(value < LOW for value in coverage.values()),
        "se_of_one": float(np.sqrt(SHARE * (1.0 - SHARE) / calibration.replicates)),
        "by_emcee": len(calibration.by_emcee),
    }


def price_of_estimate(ranks: pd.DataFrame) -> dict[str, Any]:
    """By how Ĉ is found, of the campaigns that were analysed by every method: coverage, and the
    median width over that with the truth known, of compliances, slopes and geometric errors."""
    methods = ("squares", "estimated", "truth")
    count = min(CAMPAIGNS_OF[method] for method in methods)
    common = ranks[ranks["seed"] < count].sort_values("seed")
    with_truth = common[common["kind"] == "truth"]
    numbers: dict[str, Any] = {"campaigns": count}
    for method in methods:
        rows = common[common["kind"] == method]
        numbers[method] = stated(estimates.WORDS[method], validation(rows, method))
        numbers[method]["width"] = width_ratios(rows, with_truth)
    return numbers


def width_ratios(rows: pd.DataFrame, reference: pd.DataFrame) -> dict[str, float]:
    """Median ratio of the widths of the same campaigns, mean by group of parameters."""
    ratios: dict[str, list[float]] = {"C": [], "slope": [], "E": []}
    for name in rows.filter(regex=f"^{WIDTH}"):
        ratio = rows[name].to_numpy() / reference[name].to_numpy()
        ratios[_group(name.removeprefix(WIDTH))].append(float(np.median(ratio)))
    return {group: float(np.mean(values)) for group, values in ratios.items()}


def seven_circles(kind: str, seed: int) -> dict[str, float]:
    """Seven circles of a machine of λ = 1, with and without a scale for every circle.

    Of every compliance: the sd and whether the interval covers the truth. Where ``kind`` is odd one
    circle changes by 3 µm at every order up to six, over the order.
    """
    rng = np.random.default_rng([seed, 6])
    angle_deg = np.arange(0.0, 360.0, 4.0)
    planned = lb.Plan(
        tuple(lb.CircularTest(force_N, angle_deg) for force_N in SEVEN_N), radius_mm=150.0
    )
    compliances = drawn_compliances(rng)
    truth = compliances | drawn_slopes(compliances, rng) | drawn_geometry(rng)
    without_scale = THIRD.without("circle-scale")
    campaign = without_scale.simulate(planned, seed=seed, parameters=truth).campaign
    if kind == "odd":
        campaign = with_odd_circle(campaign, angle_deg, rng)
    row: dict[str, float] = {}
    for name, model in (("with", THIRD), ("without", without_scale)):
        nodes = compute_nodes(HyperPosterior(model.bind(campaign), truncated=True), TOLERANCE)
        _, sd = nodes.moments()
        low, high = nodes.quantiles(LEVELS, seed=1, components=COMPONENTS)
        for parameter in compliances:
            j = nodes.bound.names.index(parameter)
            row[f"{name}/{parameter}/sd"] = sd[j]
            row[f"{name}/{parameter}/covered"] = low[j] <= truth[parameter] <= high[j]
    return row


def drawn_compliances(rng: np.random.Generator) -> dict[str, float]:
    """Compliances of a machine [mm, N, rad]."""
    axial = rng.uniform(3e-5, 8e-5, 2)
    return {
        "C_XXX": axial[0],
        "C_YYY": axial[1],
        "C_CCY": rng.uniform(0.5e-10, 4e-10),
        "C_XYX": rng.normal(0.0, 1e-6),
        "C_CXY": rng.normal(0.0, 2e-8),
        "C_CYY": rng.normal(0.0, 2e-8),
    }


def drawn_slopes(compliances: dict[str, float], rng: np.random.Generator) -> dict[str, float]:
    """Slopes that change a compliance by 12 % over the range of force, one sd."""
    slopes = {}
    for name, value in compliances.items():
        slopes[f"{name}_1"] = value * rng.normal(0.0, 0.12) / (SEVEN_N[-1] - SEVEN_N[0])
    return slopes


def drawn_geometry(rng: np.random.Generator) -> dict[str, float]:
    """Geometric errors [mm, rad]."""
    sds = {
        "E_XX1": 5e-5,
        "E_YY1": 5e-5,
        "E_C0YX": 2e-5,
        "E_YX2": 3e-7,
        "E_XY2": 3e-7,
        "E_Xt0": 5e-3,
        "E_Yt0": 5e-3,
    }
    return {name: rng.normal(0.0, sd) for name, sd in sds.items()}


def with_odd_circle(
    campaign: lb.Campaign, angle_deg: np.ndarray, rng: np.random.Generator
) -> lb.Campaign:
    """The campaign with one circle changed at the orders 0 to 6."""
    order = np.repeat(np.arange(7), 2)[1:]
    odd_index = int(rng.integers(len(SEVEN_N)))
    size_um = ODD_UM * rng.standard_normal(13) / np.maximum(order, 1)
    change_um = basis(np.deg2rad(angle_deg))[:, :13] @ size_um
    tests = list(campaign.tests)
    reading_um = np.asarray(tests[odd_index].reading_um)
    tests[odd_index] = tests[odd_index].with_reading_um(reading_um + change_um)
    return replace(campaign, tests=tuple(tests))


def scales(effort: Effort) -> dict[str, Any]:
    """What a scale for every circle costs where all are alike, and gives where one is odd."""
    kinds = {"alike": CAMPAIGNS, "odd": CAMPAIGNS}
    rows = replicated(HERE / "scales.csv", seven_circles, kinds, effort, again=ODD_AGAIN)
    with_scale = rows.filter(regex="^with/.*/sd$").columns
    names = [column.split("/")[1] for column in with_scale]
    se = float(np.sqrt(SHARE * (1.0 - SHARE) / (len(names) * CAMPAIGNS)))
    numbers: dict[str, Any] = {"se": se}
    for kind, of_kind in rows.groupby("kind"):
        numbers[str(kind)] = of_scale(of_kind, names)
    return numbers


def of_scale(rows: pd.DataFrame, names: list[str]) -> dict[str, Any]:
    """Of one kind of campaigns: widths with a scale over those without, and coverage of both."""
    ratios = {name: rows[f"with/{name}/sd"] / rows[f"without/{name}/sd"] for name in names}
    by_compliance: dict[str, dict[str, float]] = {}
    coverage = {}
    for model in ("with", "without"):
        shares = {name: float(rows[f"{model}/{name}/covered"].mean()) for name in names}
        by_compliance[model] = shares
        coverage[model] = float(np.mean(list(shares.values())))
    return {
        "campaigns": len(rows),
        "ratio": {name: float(ratio.median()) for name, ratio in ratios.items()},
        "pooled_ratio": float(np.median(list(ratios.values()))),
        "coverage": coverage,
        "by_compliance": by_compliance,
    }


def measure(effort: Effort) -> dict[str, Any]:
    """Everything the page states."""
    ranks = all_ranks(effort)
    results = {kind: stated(case.words, validation(ranks, kind)) for kind, case in cases().items()}
    of_third = third_ranks(effort)
    of_second = pd.read_csv(KEPT_SECOND)
    right = [kind for kind, case in cases().items() if case.model == case.generator]
    return {
        "third": {
            kind: stated(words, validation(of_third, kind))
            for kind, words in estimates.WORDS.items()
        },
        "second": {
            kind: stated(words, validation(of_second, kind))
            for kind, words in WORDS_OF_SECOND.items()
        },
        "price": price_of_estimate(of_third),
        "errors_of_estimate": estimates.errors_of_estimate(),
        "scales": scales(effort),
        "odd_um": ODD_UM,
        "cases": results,
        "calibrated": right,
        "all_calibrated": not any(results[kind]["outside"] for kind in right),
        "low_percent": 100.0 * LOW,
        "draws": DRAWS,
        "forces_N": list(FORCES_N),
        "arc_deg": ARC_DEG,
        "more": MORE,
        "readings": len(plan().tests[0].angle_deg),
        "band_percent": 100.0 * PROBABILITY,
        "slopes_asked": SLOPES_ASKED,
    }


@lb.figures.styled
def coverage_figure(results: dict[str, Any]) -> Figure:
    """Coverage of the 95 % intervals, parameter by parameter, case by case."""
    cases_stated = results["cases"]
    figure = lb.figures.new_figure(9.6, 4.6)
    axes = figure.subplots()
    for k, (kind, case) in enumerate(cases_stated.items()):
        is_right = kind in results["calibrated"]
        colour = lb.figures.PALETTE[0 if is_right else 1]
        for group, (shape, offset) in MARKS.items():
            shares = [share for name, share in case["coverage"].items() if _group(name) == group]
            axes.plot(
                [k + offset] * len(shares),
                shares,
                shape,
                color=colour,
                markersize=4,
                alpha=0.75,
                linestyle="",
            )
        half = 3.0 * case["se_of_one"]
        axes.fill_between(
            [k - 0.42, k + 0.42], SHARE - half, min(SHARE + half, 1.0), color="#DADADA", linewidth=0
        )
    axes.axhline(SHARE, color="black", linewidth=0.8, linestyle="--")
    labels = [_broken(case["words"]) for case in cases_stated.values()]
    axes.set_xticks(range(len(cases_stated)), labels)
    axes.tick_params(axis="x", labelsize=7, rotation=35)
    axes.set_ylim(0.0, 1.02)
    axes.set_ylabel("coverage of 95 % intervals (1)")
    for shape, label in (("o", "compliances"), ("^", "slopes"), ("s", "geometric errors")):
        axes.plot([], [], shape, color="#555555", linestyle="", label=label)
    axes.legend(loc="lower left", title="grey: 95 % ± 3 standard errors")
    return figure


def _broken(words: str) -> str:
    """In two lines."""
    return re.sub(r",? (full|left|turned)", r"\n\1", words)


def _group(name: str) -> str:
    """Group of a parameter: geometric errors, slopes or compliances."""
    if name.startswith("E_"):
        return "E"
    return "slope" if name.endswith("_1") else "C"


def draw(results: dict[str, Any]) -> dict[str, Figure]:
    """Coverage, and the ranks of right and of wrong models."""
    ranks = pd.read_csv(KEPT)
    third = pd.read_csv(KEPT_THIRD)
    return {
        "coverage": coverage_figure(results),
        "ranks_truth": lb.figures.rank_ecdf(validation(third, "truth")),
        "ranks_estimated": lb.figures.rank_ecdf(validation(third, "estimated")),
        "ranks_linear": lb.figures.rank_ecdf(validation(ranks, "linear")),
        "ranks_no_discrepancy": lb.figures.rank_ecdf(validation(ranks, "no discrepancy")),
    }


def main() -> None:
    """Measure and compare with what is stated; ``--write`` states anew."""
    run(Study(HERE, measure, draw))


if __name__ == "__main__":
    main()
