"""Side by side with the field: least squares with a GUM budget, a Gaussian process as discrepancy,
and the package.

python studies/92_peers/run.py            # fails when a stated number is not reproduced
python studies/92_peers/run.py --write    # states anew; needs the package of the Gaussian process:
pip install '.[bench]'
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import ldbb_bayes as lb
from ldbb_bayes.campaign.run_times import SECONDS_PER_TEST
from ldbb_bayes.parallel import one_blas_thread

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "12_real_machines"), str(HERE)]
import methods
from machines import FAMILIES, FORCES_N, RADIUS_MM, READINGS, simulate
from study import DATA, Effort, Study, replicated, run

RECOVERED = "recovered experiment"
MEASURED = lb.read_campaign(DATA / "recovered_experiment")
FROM_MODEL = {
    "white noise alone": replace(methods.MODEL, nuisances=()),
    "as the model says": methods.MODEL,
}
OF_CHAIN = {
    "mild": "mild",
    "ball of one lobe": "one lobe",
    "joints in contact": "contact",
    "warm-up and seals": "warm-up, seals",
}
CAMPAIGNS = 15
TIMED = 3
KINDS = {RECOVERED: len(MEASURED.tests), **dict.fromkeys([*FROM_MODEL, *OF_CHAIN], CAMPAIGNS)}
AGAIN: dict[Effort, int] = {"quick": 2, "usual": 4}
NAMES = methods.MODEL.bind(MEASURED).names
GROUPS = {
    "compliances": [name for name in NAMES if name.startswith("C") and not name.endswith("_1")],
    "slopes": [name for name in NAMES if name.endswith("_1") and name.startswith("C")],
    "geometric errors": [name for name in NAMES if name.startswith("E")],
}
SQUARES = "least squares"
PROCESS = "Gaussian process"
FULL = {False: "short budget", True: "full budget"}
WORDS = {
    f"{method}, {words}": f"{method}, {words}"
    for method in (SQUARES, PROCESS)
    for words in FULL.values()
}
WORDS |= {"linear": "ours", "averaged": "ours, averaged"}
COLOURS = dict(zip(WORDS, ("#c44e52", "#c44e52", "#8172b2", "#8172b2", "#4c72b0"), strict=False))
MISS = 40.0  # 2/α: what an interval score counts a µm outside as
STATED = HERE / "results.json"


def campaign_of(kind: str, seed: int) -> tuple[lb.Campaign, dict[str, float] | None]:
    """A campaign and its true parameters, where they are known."""
    if kind == RECOVERED:
        return MEASURED, None
    if kind in FROM_MODEL:
        angle = np.arange(0.0, 360.0, 360.0 / READINGS)
        plan = lb.Plan(
            tuple(lb.CircularTest(force, angle) for force in FORCES_N), radius_mm=RADIUS_MM
        )
        made = FROM_MODEL[kind].simulate(plan, seed=seed)
        return made.campaign, made.parameters
    campaign, machine = simulate(FAMILIES[OF_CHAIN[kind]], seed)
    return campaign, machine.truth


def without_one(campaign: lb.Campaign, seed: int) -> tuple[lb.Campaign, lb.CircularTest]:
    """The campaign without one of its tests, and this test; both state when they were run, one
    every six minutes in the order listed, so that the test left out keeps its place in time."""
    k = seed % len(campaign.tests)
    tests = tuple(
        replace(test, time_s=SECONDS_PER_TEST * place) for place, test in enumerate(campaign.tests)
    )
    return replace(campaign, tests=tests[:k] + tests[k + 1 :]), tests[k]


def judged(
    every: Mapping[str, Callable[..., methods.Said]], kind: str, seed: int
) -> dict[str, float]:
    """By each method: intervals of the parameters less the truth; of the circle left out the mean
    log density of its readings [nat, per µm], the share of them inside the band and its mean width
    [µm]."""
    campaign, truth = campaign_of(kind, seed)
    rest, new = without_one(campaign, seed)
    reading = np.asarray(new.reading_um)[methods.picked(new)]
    row = dict[str, float]()
    for method, said in every.items():
        interval = said(campaign)[0] if truth else np.full((2, len(NAMES)), np.nan)
        for name, low, high in zip(NAMES, *interval, strict=True):
            true = truth[name] if truth else 0.0
            row |= {f"{method}/{name}/low": low - true, f"{method}/{name}/high": high - true}
        circle = said(rest, new)[1]
        assert circle is not None
        low, high = circle.band_um
        row |= {
            f"{method}/score": circle.log_density.mean(),
            f"{method}/inside": ((low <= reading) & (reading <= high)).mean(),
            f"{method}/width": (high - low).mean(),
        }
    return row


def least_squares() -> dict[str, Callable[..., methods.Said]]:
    """With either budget."""
    return {
        f"{SQUARES}, {words}": partial(methods.by_least_squares, full=full)
        for full, words in FULL.items()
    }


def processes(seed: int) -> dict[str, Callable[..., methods.Said]]:
    """With either budget."""
    return {
        f"{PROCESS}, {words}": partial(methods.by_process, full=full, seed=seed)
        for full, words in FULL.items()
    }


def by_others(kind: str, seed: int) -> dict[str, float]:
    """By least squares and by the default model; on the measured campaign the average over models
    too."""
    row = judged(least_squares() | {"linear": partial(methods.linear, seed=seed)}, kind, seed)
    columns = ("score", "inside", "width")
    if kind != RECOVERED:
        return row | {f"averaged/{column}": np.nan for column in columns}
    averaged = judged({"averaged": partial(methods.averaged, seed=seed)}, kind, seed)
    return row | {f"averaged/{column}": averaged[f"averaged/{column}"] for column in columns}


def by_process(kind: str, seed: int) -> dict[str, float]:
    """By the Gaussian process."""
    return judged(processes(seed), kind, seed)


def all_rows(effort: Effort) -> pd.DataFrame:
    """Every campaign by every method; what the Gaussian process said is made again where its
    package is."""
    rows = replicated(HERE / "campaigns.csv", by_others, KINDS, effort, again=AGAIN)
    path = HERE / "gaussian_process.csv"
    if methods.HAS_PACKAGE:
        process = replicated(path, by_process, KINDS, effort, again=AGAIN, tolerance=0.1)
    elif effort == "write":
        raise lb.InputError(
            "ACBICI must be installed to state anew, got none. Install it: pip install '.[bench]'"
        )
    else:
        print(
            "ACBICI is not installed: what the Gaussian process said is taken as kept. pip install"
            " '.[bench]' has it made again."
        )
        process = pd.read_csv(path)
    return rows.merge(process, on=["kind", "seed"], validate="one_to_one")


def of_parameters(rows: pd.DataFrame) -> dict[str, Any]:
    """By method: coverage of all parameters, its standard error over campaigns, that of groups;
    median width and mean interval score over ours, geometric means over the parameters."""
    found: dict[str, Any] = {}
    scores = {}
    widths = {}
    for method in COLOURS:
        low, high = (
            rows[[f"{method}/{name}/{end}" for name in NAMES]].to_numpy() for end in ("low", "high")
        )
        inside, widths[method] = (low <= 0.0) & (high >= 0.0), high - low
        scores[method] = widths[method] + MISS * (np.maximum(low, 0.0) + np.maximum(-high, 0.0))
        found[method] = {
            "coverage": float(inside.mean()),
            "se": float(inside.mean(axis=1).std(ddof=1) / np.sqrt(len(rows))),
            "groups": {
                group: float(inside[:, [NAMES.index(name) for name in own]].mean())
                for group, own in GROUPS.items()
            },
        }
    for method, own in found.items():
        own["width"] = float(
            np.exp(np.log(np.median(widths[method] / widths["linear"], axis=0)).mean())
        )
        own["score"] = float(
            np.exp(np.log(scores[method].mean(axis=0) / scores["linear"].mean(axis=0)).mean())
        )
    return found


def of_circles(rows: pd.DataFrame) -> dict[str, Any]:
    """By method, of the circles left out: log score, its difference from ours with standard error,
    coverage, width."""
    found = {}
    for method in WORDS:
        if rows[f"{method}/score"].notna().all():
            gain = rows[f"{method}/score"] - rows["linear/score"]
            found[method] = {
                column: float(rows[f"{method}/{column}"].mean())
                for column in ("score", "inside", "width")
            }
            found[method] |= {
                "gain": float(gain.mean()),
                "gain_se": float(gain.std(ddof=1) / np.sqrt(len(gain))),
            }
            found[method] |= {
                "inside_se": float(rows[f"{method}/inside"].std(ddof=1) / np.sqrt(len(rows)))
            }
    return found


def shown(k: int) -> dict[str, Any]:
    """A circle of the measured campaign that was left out: readings and bands less the
    least-squares prediction [µm]."""
    rest, new = without_one(MEASURED, k)
    index = methods.picked(new)
    every = (
        least_squares()
        | (processes(k) if methods.HAS_PACKAGE else {})
        | {"linear": partial(methods.linear, seed=k)}
    )
    bands = {
        method: circle.band_um
        for method, said in every.items()
        if (circle := said(rest, new)[1]) is not None
    }
    middle = bands[f"{SQUARES}, {FULL[True]}"].mean(axis=0)
    found = {
        "force_N": new.force_N,
        "angle_deg": new.angle_deg[index].tolist(),
        "reading_um": (np.asarray(new.reading_um)[index] - middle).tolist(),
        "band_um": {method: (band - middle).tolist() for method, band in bands.items()},
    }
    if not methods.HAS_PACKAGE:
        found["band_um"] |= {
            name: band
            for name, band in stated("shown")["band_um"].items()
            if name.startswith(PROCESS)
        }
    return found


def stated(name: str) -> Any:
    """What is stated under this name."""
    return json.loads(STATED.read_text(encoding="utf-8"))[name]


@one_blas_thread
def seconds() -> dict[str, Any]:
    """CPU seconds of each method for the intervals of one campaign, medians, in this process and
    one thread."""
    every = least_squares() | processes(1)
    every |= {
        "linear": partial(methods.linear, seed=1),
        "averaged": partial(methods.averaged, seed=1),
    }
    taken: dict[str, list[float]] = {method: [] for method in every}
    for seed in range(TIMED):
        campaign = simulate(FAMILIES["mild"], seed)[0]
        for method, said in every.items():
            start = time.process_time()
            said(campaign)
            taken[method].append(time.process_time() - start)
    return {method: float(np.median(own)) for method, own in taken.items()}


def measure(effort: Effort) -> dict[str, Any]:
    """Everything the page states; time is measured, and the package as it stands run, with
    ``--write`` only."""
    rows = all_rows(effort)
    anew = effort == "write"
    found = {
        "campaigns": CAMPAIGNS,
        "readings": READINGS,
        "picked": methods.PICKED,
        "few": methods.FEW,
        "noise_um": methods.NOISE_UM,
        "discrepancy_um": float(np.sqrt(methods.DISCREPANCY_UM2)),
        "setup_um": methods.SETUP_UM,
        "forces_N": list(FORCES_N),
        "timed": TIMED,
        "parameters": {
            kind: of_parameters(rows[rows["kind"] == kind]) for kind in (*FROM_MODEL, *OF_CHAIN)
        },
        "circles": {kind: of_circles(rows[rows["kind"] == kind]) for kind in KINDS},
        "by_force": {
            f"{test.force_N:.0f}": {
                method: {
                    column: float(row[f"{method}/{column}"])
                    for column in ("score", "inside", "width")
                }
                for method in WORDS
            }
            for test, (_, row) in zip(
                MEASURED.tests,
                rows[rows["kind"] == RECOVERED].sort_values("seed").iterrows(),
                strict=True,
            )
        },
        "seconds": seconds() if anew else stated("seconds"),
        "as_it_stands": methods.as_it_stands(MEASURED, seed=1) if anew else stated("as_it_stands"),
    }
    return found if effort == "quick" else found | {"shown": shown(len(MEASURED.tests) - 1)}


@lb.figures.styled
def figure(results: dict[str, Any]) -> Figure:
    """A circle that no method was given, and how often intervals hold the truth and how wide they
    are."""
    drawn = lb.figures.new_figure(11.0, 6.2)
    left, right = drawn.subfigures(1, 2, width_ratios=(1.0, 1.35))
    circle = results["shown"]
    panels = left.subplots(3, 1, sharex=True, sharey=True)
    for axes, method in zip(
        panels, [name for name in COLOURS if FULL[False] not in name], strict=True
    ):
        low, high = circle["band_um"][method]
        axes.fill_between(circle["angle_deg"], low, high, color=COLOURS[method], alpha=0.35, lw=0.0)
        axes.plot(circle["angle_deg"], circle["reading_um"], "k.", ms=4)
        axes.set_title(WORDS[method], fontsize=9, loc="left")
    panels[1].set_ylabel("reading − least-squares prediction (µm)")
    panels[2].set_xlabel("angle (°)")
    panels[2].set_xticks(range(0, 361, 90))
    left.suptitle(
        f"Circle at {circle['force_N']:.0f} N, predicted from the others, 95 % bands", fontsize=10
    )
    pair = right.subplots(1, 2, sharey=True)
    kinds = list(results["parameters"])
    for j, (method, colour) in enumerate(COLOURS.items()):
        place = np.arange(len(kinds)) + 0.15 * (j - 2)
        inner = "white" if FULL[False] in method else colour
        style: dict[str, Any] = {
            "fmt": "o",
            "color": colour,
            "ms": 5,
            "mfc": inner,
            "label": WORDS[method],
        }
        own = [results["parameters"][kind][method] for kind in kinds]
        pair[0].errorbar(
            [100.0 * each["coverage"] for each in own],
            place,
            xerr=[200.0 * each["se"] for each in own],
            **style,
        )
        pair[1].errorbar([each["width"] for each in own], place, **style)
    pair[0].axvline(95.0, color="k", lw=1.0)
    pair[0].set_xlabel("95 % intervals that hold the truth (%)")
    pair[0].set_xlim(0.0, 103.0)
    pair[1].set_xlim(left=0.0)
    pair[1].set_xlabel("width, ours = 1")
    pair[0].set_yticks(range(len(kinds)), kinds)
    pair[0].set_ylim(len(kinds) - 0.5, -0.5)
    right.suptitle("Compliances, slopes and geometric errors of simulated machines", fontsize=10)
    right.legend(
        *pair[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8
    )
    return drawn


def main() -> None:
    """Measure and compare with what is stated; ``--write`` states anew."""
    absolute = {"shown/*": 0.3}
    run(
        Study(
            HERE,
            measure,
            lambda results: {"side_by_side": figure(results)},
            absolute=absolute,
            long=("shown",),
        )
    )


if __name__ == "__main__":
    main()
