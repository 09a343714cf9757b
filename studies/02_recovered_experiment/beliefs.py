"""What each new belief of the model's third edition does to the recovered experiment: one at a time
on top of the second edition, and all together.

The second edition's own numbers, and what each of its beliefs did to the first, are kept as they
were when that edition was the default (``second_edition.json``).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from study import DATA

import ldbb_bayes as lb

FIRST = lb.HybridModel.first(1)
THIRD = lb.HybridModel.default(1)
GRADE = "G20"
STATED = f"balls of grade {GRADE}"
KEPT = Path(__file__).resolve().parent / "second_edition.json"
# Prior sd of the second edition's joint load, as a share of the compliance.
SECOND_SHARE = 0.2
TOLERANCE = 1e-2
# Direct compliances whose curve C(F) is shown.
CURVES = ("C_XXX", "C_YYY")
# By inside unit: factor and label for reading.
SHOWN = {"mm/N": (1e6, "nm/N"), "rad/N": (1e9, "nrad/N"), "rad/(N mm)": (1e9, "µrad/(N m)")}
SHOWN |= {f"{unit}/N": (1e3 * factor, f"{label} per kN") for unit, (factor, label) in SHOWN.items()}
SHOWN |= {"1": (1e6, "µm/m"), "1/mm": (1e9, "µm/m²"), "rad": (1e6, "µrad"), "mm": (1e3, "µm")}
Change = Callable[[lb.HybridModel], lb.HybridModel]


@dataclass(frozen=True)
class SecondJointLoad(lb.terms.JointLoad):
    """The second edition's joint load: half the prior sd, and no column for a seat."""

    relative_sd: float = SECOND_SHARE

    def columns(self, setting: Any) -> tuple[lb.terms.Columns, ...]:
        """Columns of preload and of contact of every driven axis."""
        own = super().columns(setting)
        return tuple(lb.terms.Columns(c.names[:2], c.values[..., :2], c.sd[:2]) for c in own)

    def secants(self, setting: Any, force_N: Any) -> Any:
        """Change of an axis' compliance per unit of its two coefficients, shape (n, 2)."""
        return super().secants(setting, force_N)[:, :2]

    def deflections(self, setting: Any, axis: int, r: int, force_N: Any) -> Any:
        """Deflections of an axis around a circle per unit of its two coefficients."""
        return super().deflections(setting, axis, r, force_N)[..., :2]


def adding(term: lb.terms.Term) -> Change:
    """This term beside those of the model."""
    return lambda model: model.with_term(term)


def joints_with_seats(model: lb.HybridModel) -> lb.HybridModel:
    """The third edition's joint load in place of the second's."""
    return model.without("second-joint-load").with_term(lb.terms.JointLoad())


# The second edition's terms, with Ĉ as the third finds it.
SECOND_TERMS = THIRD.without("drift", "hysteresis", "joint-load").with_term(SecondJointLoad())
BELIEFS: Mapping[str, Change] = {
    "first edition": lambda model: FIRST,
    "Ĉ with its uncertainty": lambda model: model,
    "drift in the order listed": adding(lb.terms.Drift()),
    "hysteresis in one direction": adding(lb.terms.Hysteresis()),
    "joint load twice as wide, and a seat": joints_with_seats,
    STATED: lambda model: model,
    "all together": lambda model: THIRD,
    f"all, {STATED}": lambda model: THIRD,
}
# What `--quick` measures again.
AGAIN = ("first edition", "Ĉ with its uncertainty", "all together")


def zero_kept(model: lb.HybridModel) -> lb.HybridModel:
    """The model where only the centre moves between circles."""
    terms = (
        replace(term, moves="centre") if type(term).__name__ == "SetupShift" else term
        for term in model.nuisances
    )
    return replace(model, nuisances=tuple(terms))


def log_bayes_factor(linear: lb.HybridModel, campaign: lb.Campaign) -> float:
    """ln B, linear over constant compliance [nat]."""
    own, least = (
        lb.log_evidence(model, campaign, tolerance=TOLERANCE)
        for model in (linear, linear.with_degree(0))
    )
    return lb.inference.log_bayes_factor(own, least)[0]


def curve(posterior: xr.DataTree) -> dict[str, dict[str, Any]]:
    """Deflection over force at the smallest and the largest force, and the change, by compliance
    [nm/N]."""
    changes = lb.analysis.change_with_force(posterior)
    factor = SHOWN["mm/N"][0]
    found = {}
    for name in CURVES:
        own = changes[name]
        parts = {"low": own.at_smallest, "high": own.at_largest, "change": own.change}
        found[name] = {
            part: {"mean": factor * value.mean, "sd": factor * value.sd}
            for part, value in parts.items()
        }
    return found


def kept() -> dict[str, Any]:
    """What was measured when the second edition was the default, by belief."""
    return dict(json.loads(KEPT.read_text(encoding="utf-8"))["beliefs"]["by_belief"])


def measure(beliefs: Sequence[str]) -> dict[str, Any]:
    """By belief: mean and sd of every parameter [unit for reading], mean δ [µm], ln B over
    constant, the evidence over the first edition's [nat] and C(F), all with linear compliance."""
    plain = lb.read_campaign(DATA / "recovered_experiment")
    ball = lb.Ball(grade=GRADE)
    stated = replace(plain, instrument=replace(plain.instrument, work=ball, tool=ball))
    names = FIRST.bind(plain).names
    first = lb.log_evidence(FIRST, plain, tolerance=TOLERANCE).log_value
    found: dict[str, Any] = {}
    posteriors = {}
    for belief in beliefs:
        campaign = stated if STATED in belief else plain
        model = BELIEFS[belief](SECOND_TERMS)
        table = lb.inference.marginalize(model, campaign, tolerance=TOLERANCE)
        own = table.loc[list(names)]
        factor = own["unit"].map(lambda unit: SHOWN[unit][0])
        posteriors[belief] = lb.sample(model, campaign, sampler="independent", seed=1)
        found[belief] = {
            "mean": (factor * own["mean"]).to_dict(),
            "sd": (factor * own["sd"]).to_dict(),
            "delta_um": 1e3 * table.loc["delta", "mean"],
            "log_bayes_factor": log_bayes_factor(model, campaign),
            "log_bayes_factor_zero_kept": log_bayes_factor(zero_kept(model), campaign),
            "evidence": lb.log_evidence(model, campaign, tolerance=TOLERANCE).log_value - first,
            "curve": curve(posteriors[belief]),
        }
    acting = THIRD.bind(plain).terms
    return {
        "by_belief": found,
        "units": {name: SHOWN[unit][1] for name, unit in own["unit"].items()},
        "not_here": [name for name in THIRD.terms if name not in acting],
        "forces_N": [float(plain.forces_N.min()), float(plain.forces_N.max())],
        "elsewhere": elsewhere(
            found["all together"], factor.to_dict(), posteriors["all together"]["posterior"]
        ),
    }


def elsewhere(
    own: Mapping[str, Any], factor: Mapping[str, float], posterior: Any
) -> dict[str, float]:
    """Largest difference of all beliefs together from independent draws: of means in u, and of the
    ratio of sds from one."""
    draws = {name: factor[name] * posterior[name].to_numpy().ravel() for name in factor}
    return {
        "draws": next(iter(draws.values())).size,
        "mean_in_u": max(
            abs(own["mean"][name] - values.mean()) / own["sd"][name]
            for name, values in draws.items()
        ),
        "sd": max(abs(values.std() / own["sd"][name] - 1.0) for name, values in draws.items()),
    }


@lb.figures.styled
def widths_and_shifts(results: Mapping[str, Any]) -> Figure:
    """Of every parameter, by belief: u over the second edition's, and how far the mean moves in the
    second edition's u."""
    beliefs = dict(results["by_belief"])
    del beliefs["first edition"]
    second = kept()["all together"]
    names = list(second["mean"])
    wider = np.array(
        [[own["sd"][name] / second["sd"][name] for own in beliefs.values()] for name in names]
    )
    moved = np.array(
        [
            [(own["mean"][n] - second["mean"][n]) / second["sd"][n] for own in beliefs.values()]
            for n in names
        ]
    )
    figure = lb.figures.new_figure(10.5, 6.0)
    panels = figure.subplots(1, 2, sharey=True)
    shown = (
        (np.log2(wider), wider, ".2g", "u over that of the second edition"),
        (moved, moved.round(1) + 0.0, "+.1f", "shift in u of the second edition"),
    )
    for axes, (colour, values, form, title) in zip(panels, shown, strict=True):
        axes.imshow(colour, cmap="RdBu_r", vmin=-2.5, vmax=2.5, aspect="auto")
        for (i, j), value in np.ndenumerate(values):
            dark = abs(colour[i, j]) > 1.6
            axes.text(
                j,
                i,
                format(value, form),
                ha="center",
                va="center",
                fontsize=6.5,
                color="w" if dark else "k",
            )
        axes.set_xticks(range(len(beliefs)), list(beliefs), rotation=60, ha="right", fontsize=8)
        axes.set_title(title, fontsize=10)
        axes.grid(visible=False)
    panels[0].set_yticks(
        range(len(names)), [name.replace("C0YX", "C(0Y)X") for name in names], fontsize=8
    )
    return figure
