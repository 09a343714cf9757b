"""Does the computation return the posterior it claims to, and what happens when ball form or discrepancy is left out?

python studies/06_validation/run.py            # fails when a stated number is not reproduced
python studies/06_validation/run.py --write    # states anew
"""

from __future__ import annotations

import re
import sys
from concurrent.futures import Executor
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import ldbb_bayes as lb

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
from study import Effort, Study, executor, kept, run  # noqa: E402

FORCES_N = (36.0, 238.0, 364.0, 490.0, 616.0, 742.0)
ARC_DEG, STEP_DEG, MORE = 220.0, 2.0, 4
DRAWS, SEED, PROBABILITY = 99, 6, 0.99
SHARE, LOW, AGAIN = 0.95, 0.9, 10
LINEAR = lb.HybridModel.first(1)
KEPT = HERE / "ranks.csv"
# A draw equal to the truth within rounding falls on either side of it, by version of the libraries.
ONE_RANK = 1.5 / DRAWS
# And where the choice of a draw hangs on rounding, all that follow are others.
ASTRAY = 0.01
NUISANCES = ("ball-form", "bar-length", "mount", "force-error", "setup-shift", "discrepancy", "hysteresis")


@dataclass(frozen=True)
class Case:
    """A model that analyses, the model that makes the readings, where, and how often."""

    words: str
    model: lb.HybridModel
    generator: lb.HybridModel
    plan: lb.Plan
    replicates: int


def plan(*, arc_deg: float = 360.0, clocked: bool = False, step_deg: float = STEP_DEG) -> lb.Plan:
    """The forces of the recovered experiment; both balls turned from circle to circle where asked."""
    turns = list(product((0.0, 45.0, 90.0), repeat=2))
    angle = np.arange(0.0, arc_deg, step_deg)
    return lb.Plan(
        tuple(
            lb.CircularTest(
                force, angle, work_ball_deg=turns[k % 9][0] if clocked else 0.0, tool_ball_deg=turns[k % 9][1] if clocked else 0.0
            )
            for k, force in enumerate(FORCES_N)
        )
    )


def cases() -> dict[str, Case]:
    """What must be calibrated, and what cannot be."""
    full = plan()
    constant = LINEAR.with_degree(0)
    return {
        "linear": Case("linear compliance, full circles", LINEAR, LINEAR, full, 600),
        "constant": Case("constant compliance, full circles", constant, constant, full, 300),
        "untruncated": Case("no truncation", LINEAR.without("truncation"), LINEAR.without("truncation"), full, 300),
        "arcs": Case("arcs", LINEAR, LINEAR, plan(arc_deg=ARC_DEG), 300),
        "clocked": Case("both balls turned in between", LINEAR, LINEAR, plan(clocked=True), 300),
        "no discrepancy": Case("discrepancy left out", LINEAR.without("discrepancy"), LINEAR, full, 200),
        "no discrepancy, more readings": Case(
            "discrepancy left out, more readings",
            LINEAR.without("discrepancy"),
            LINEAR,
            plan(step_deg=STEP_DEG / MORE),
            200,
        ),
        "no ball form": Case("ball form left out", LINEAR.without("ball-form"), LINEAR, full, 200),
        "no set-up shift": Case("set-up shift left out", LINEAR.without("setup-shift"), LINEAR, full, 200),
        "white noise": Case("all nuisances left out", LINEAR.without(*NUISANCES), LINEAR, full, 200),
    }


def ranked(case: Case, replicates: int, pool: Executor | None) -> lb.Validation:
    """Simulated, inferred and ranked; the first replicates are the same however many follow."""
    return lb.validate(
        case.model,
        case.plan,
        replicates=replicates,
        draws=DRAWS,
        generator=case.generator,
        prob=PROBABILITY,
        seed=SEED,
        executor=pool,
    )


def all_ranks(effort: Effort) -> pd.DataFrame:
    """Ranks of every case, one row per replicate; made again as far as the effort goes, and all that are kept."""
    made = []
    with executor() as pool:
        for kind, case in cases().items():
            count = AGAIN if effort == "quick" else case.replicates
            found = ranked(case, count, pool)
            if found.failures:
                sys.exit(f"06_validation, {kind}: {found.failures[0]}")
            rows = pd.DataFrame(found.ranks.astype(float), columns=list(found.names))
            made.append(rows.assign(kind=kind, seed=range(len(rows))))
    counts = {kind: case.replicates for kind, case in cases().items()}
    return kept(KEPT, pd.concat(made), counts, effort, tolerance=ONE_RANK, astray=ASTRAY)


def validation(ranks: pd.DataFrame, kind: str) -> lb.Validation:
    """The kept ranks of one case."""
    own = ranks[ranks["kind"] == kind].drop(columns=["kind", "seed"]).dropna(axis="columns")
    return lb.Validation(tuple(own.columns), own.to_numpy(dtype=int), DRAWS, "independent", PROBABILITY, ())


def coverages(found: lb.Validation) -> dict[str, float]:
    """Of the 95 % intervals of compliances, slopes and geometric errors."""
    shares = found.coverage()[f"{100 * SHARE:g}"]
    return {str(name): float(value) for name, value in shares.items() if str(name).startswith(("C_", "E_"))}


def measure(effort: Effort) -> dict[str, Any]:
    """Everything the page states."""
    ranks = all_ranks(effort)
    results: dict[str, Any] = {}
    for kind, case in cases().items():
        found = validation(ranks, kind)
        share = coverages(found)
        worst = min(share, key=lambda name: share[name])
        results[kind] = {
            "words": case.words,
            "replicates": found.replicates,
            "quantities": len(found.names),
            "outside": len(found.outside),
            "outside_names": list(found.outside),
            "coverage": share,
            "mean_coverage": float(np.mean(list(share.values()))),
            "worst_coverage": share[worst],
            "worst": worst.replace("C0YX", "C(0Y)X"),
            "below_90": sum(value < LOW for value in share.values()),
            "se_of_one": float(np.sqrt(SHARE * (1.0 - SHARE) / found.replicates)),
        }
    right = [kind for kind, case in cases().items() if case.model == case.generator]
    return {
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
    }


@lb.figures.styled
def coverage_figure(results: dict[str, Any]) -> Figure:
    """Coverage of the 95 % intervals, parameter by parameter, case by case."""
    found = results["cases"]
    figure = lb.figures.new_figure(9.6, 4.6)
    axes = figure.subplots()
    for k, (kind, case) in enumerate(found.items()):
        right = kind in results["calibrated"]
        for offset, start, shape in ((-0.22, "C", "o"), (0.0, "slope", "^"), (0.22, "E", "s")):
            own = [share for name, share in case["coverage"].items() if _group(name) == start]
            colour = lb.figures.PALETTE[0 if right else 1]
            axes.plot([k + offset] * len(own), own, shape, color=colour, markersize=4, alpha=0.75, linestyle="")
        half = 3.0 * case["se_of_one"]
        axes.fill_between([k - 0.42, k + 0.42], SHARE - half, min(SHARE + half, 1.0), color="#DADADA", linewidth=0)
    axes.axhline(SHARE, color="black", linewidth=0.8, linestyle="--")
    axes.set_xticks(range(len(found)), [_broken(case["words"]) for case in found.values()])
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
    return "E" if name.startswith("E_") else "slope" if name.endswith("_1") else "C"


def draw(results: dict[str, Any]) -> dict[str, Figure]:
    """Coverage, and the ranks of a right and of a wrong model."""
    ranks = pd.read_csv(KEPT)
    return {
        "coverage": coverage_figure(results),
        "ranks_linear": lb.figures.rank_ecdf(validation(ranks, "linear")),
        "ranks_no_discrepancy": lb.figures.rank_ecdf(validation(ranks, "no discrepancy")),
    }


def main() -> None:
    """Measure and compare with what is stated; ``--write`` states anew."""
    run(Study(HERE, measure, draw))


if __name__ == "__main__":
    main()
