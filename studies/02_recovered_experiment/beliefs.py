"""What each new belief of the model's third edition does to the recovered experiment: one at a time
on top of the second edition, and all together.

The second edition's own numbers, and what each of its beliefs did to the first, are kept as they
were when that edition was the default (``second_edition.json``).
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from study import DATA

import ldbb_bayes as lb

FIRST = lb.HybridModel.first(1)
THIRD = lb.HybridModel.default(1)
GRADE = "G20"
STATED = f"balls of grade {GRADE}"
SECOND_EDITION = Path(__file__).resolve().parent / "second_edition.json"
# Prior sd of the second edition's joint load, as a share of the compliance.
SECOND_SHARE = 0.2
TOLERANCE = 1e-2
# Direct compliances whose curve C(F) is shown.
CURVES = ("C_XXX", "C_YYY")
# By inside unit: factor and label for reading.
SHOWN = {"mm/N": (1e6, "nm/N"), "rad/N": (1e9, "nrad/N"), "rad/(N mm)": (1e9, "µrad/(N m)")}
SHOWN |= {f"{unit}/N": (1e3 * factor, f"{label} per kN") for unit, (factor, label) in SHOWN.items()}
SHOWN |= {"1": (1e6, "µm/m"), "1/mm": (1e9, "µm/m²"), "rad": (1e6, "µrad"), "mm": (1e3, "µm")}


@dataclass(frozen=True)
class SecondJointLoad(lb.terms.JointLoad):
    """The second edition's joint load: half the prior sd, and no column for a seat."""

    relative_sd: float = SECOND_SHARE

    def columns(self, setting: Any) -> tuple[lb.terms.Columns, ...]:
        """Columns of preload and of contact of every driven axis."""
        without_seats = []
        for axis in super().columns(setting):
            without_seats.append(
                lb.terms.Columns(axis.names[:2], axis.values[..., :2], axis.sd[:2])
            )
        return tuple(without_seats)

    def secants(self, setting: Any, force_N: Any) -> Any:
        """Change of an axis' compliance per unit of its two coefficients, shape (n, 2)."""
        return super().secants(setting, force_N)[:, :2]

    def deflections(self, setting: Any, axis: int, r: int, force_N: Any) -> Any:
        """Deflections of an axis around a circle per unit of its two coefficients."""
        return super().deflections(setting, axis, r, force_N)[..., :2]


# The second edition's terms, with Ĉ as the third finds it.
SECOND_TERMS = THIRD.without("drift", "hysteresis", "joint-load").with_term(SecondJointLoad())
JOINTS_WITH_SEATS = SECOND_TERMS.without("second-joint-load").with_term(lb.terms.JointLoad())
MODELS: Mapping[str, lb.HybridModel] = {
    "first edition": FIRST,
    "Ĉ with its uncertainty": SECOND_TERMS,
    "drift in the order listed": SECOND_TERMS.with_term(lb.terms.Drift()),
    "hysteresis in one direction": SECOND_TERMS.with_term(lb.terms.Hysteresis()),
    "joint load twice as wide, and a seat": JOINTS_WITH_SEATS,
    STATED: SECOND_TERMS,
    "all together": THIRD,
    f"all, {STATED}": THIRD,
}
BELIEFS = tuple(MODELS)
# What `--quick` measures again.
AGAIN = ("first edition", "Ĉ with its uncertainty", "all together")


def with_fixed_zero(model: lb.HybridModel) -> lb.HybridModel:
    """The model where only the centre moves between circles."""
    terms = []
    for term in model.nuisances:
        if type(term).__name__ == "SetupShift":
            terms.append(replace(term, moves="centre"))
        else:
            terms.append(term)
    return replace(model, nuisances=tuple(terms))


def log_bayes_factor(linear: lb.HybridModel, campaign: lb.Campaign) -> float:
    """ln B, linear over constant compliance [nat]."""
    of_linear = lb.log_evidence(linear, campaign, tolerance=TOLERANCE)
    of_constant = lb.log_evidence(linear.with_degree(0), campaign, tolerance=TOLERANCE)
    return lb.inference.log_bayes_factor(of_linear, of_constant)[0]


def curve(posterior: xr.DataTree) -> dict[str, dict[str, Any]]:
    """Deflection over force at the smallest and the largest force, and the change, by compliance
    [nm/N]."""
    changes = lb.analysis.change_with_force(posterior)
    curves = {}
    for name in CURVES:
        curves[name] = {
            "low": _in_nm_per_N(changes[name].at_smallest),
            "high": _in_nm_per_N(changes[name].at_largest),
            "change": _in_nm_per_N(changes[name].change),
        }
    return curves


def _in_nm_per_N(value: Any) -> dict[str, float]:
    factor, _ = SHOWN["mm/N"]
    return {"mean": factor * value.mean, "sd": factor * value.sd}


def second_edition() -> dict[str, Any]:
    """What was measured when the second edition was the default, by belief."""
    text = SECOND_EDITION.read_text(encoding="utf-8")
    return dict(json.loads(text)["beliefs"]["by_belief"])


def measure(beliefs: Sequence[str]) -> dict[str, Any]:
    """By belief: mean and sd of every parameter [unit for reading], mean δ [µm], ln B over
    constant, the evidence over the first edition's [nat] and C(F), all with linear compliance."""
    plain = lb.read_campaign(DATA / "recovered_experiment")
    ball = lb.Ball(grade=GRADE)
    stated = replace(plain, instrument=replace(plain.instrument, work=ball, tool=ball))
    of_first = lb.log_evidence(FIRST, plain, tolerance=TOLERANCE)
    by_belief: dict[str, Any] = {}
    for belief in beliefs:
        campaign = stated if STATED in belief else plain
        by_belief[belief] = under_belief(MODELS[belief], campaign, of_first.log_value)
    units = units_of_parameters(plain)
    acting = THIRD.bind(plain).terms
    posterior = lb.sample(THIRD, plain, sampler="independent", seed=1)["posterior"]
    return {
        "by_belief": by_belief,
        "units": {name: SHOWN[unit][1] for name, unit in units.items()},
        "not_here": [name for name in THIRD.terms if name not in acting],
        "forces_N": [float(plain.forces_N.min()), float(plain.forces_N.max())],
        "elsewhere": elsewhere(by_belief["all together"], units, posterior),
    }


def units_of_parameters(campaign: lb.Campaign) -> dict[str, str]:
    """Inside unit of every parameter with linear compliance."""
    table = lb.inference.marginalize(FIRST, campaign, tolerance=TOLERANCE)
    names = FIRST.bind(campaign).names
    return table.loc[list(names), "unit"].to_dict()


def under_belief(
    model: lb.HybridModel, campaign: lb.Campaign, log_evidence_of_first: float
) -> dict[str, Any]:
    """What one model makes of the campaign."""
    table = lb.inference.marginalize(model, campaign, tolerance=TOLERANCE)
    parameters = table.loc[list(FIRST.bind(campaign).names)]
    factor = parameters["unit"].map(lambda unit: SHOWN[unit][0])
    posterior = lb.sample(model, campaign, sampler="independent", seed=1)
    evidence = lb.log_evidence(model, campaign, tolerance=TOLERANCE)
    return {
        "mean": (factor * parameters["mean"]).to_dict(),
        "sd": (factor * parameters["sd"]).to_dict(),
        "delta_um": 1e3 * table.loc["delta", "mean"],
        "log_bayes_factor": log_bayes_factor(model, campaign),
        "log_bayes_factor_zero_kept": log_bayes_factor(with_fixed_zero(model), campaign),
        "evidence": evidence.log_value - log_evidence_of_first,
        "curve": curve(posterior),
    }


def elsewhere(
    marginals: Mapping[str, Any], units: Mapping[str, str], posterior: Any
) -> dict[str, float]:
    """Largest difference of all beliefs together from independent draws: of means in u, and of the
    ratio of sds from one."""
    draws = {}
    for name, unit in units.items():
        draws[name] = SHOWN[unit][0] * posterior[name].to_numpy().ravel()
    differences_in_u = []
    differences_of_sd = []
    for name, values in draws.items():
        mean = marginals["mean"][name]
        sd = marginals["sd"][name]
        differences_in_u.append(abs(mean - values.mean()) / sd)
        differences_of_sd.append(abs(values.std() / sd - 1.0))
    return {
        "draws": next(iter(draws.values())).size,
        "mean_in_u": max(differences_in_u),
        "sd": max(differences_of_sd),
    }


@lb.figures.styled
def widths_and_shifts(results: Mapping[str, Any]) -> Figure:
    """Of every parameter, by belief: u over the second edition's, and how far the mean moves in the
    second edition's u."""
    beliefs = dict(results["by_belief"])
    del beliefs["first edition"]
    second = second_edition()["all together"]
    names = list(second["mean"])
    second_mean = np.array([second["mean"][name] for name in names])
    second_sd = np.array([second["sd"][name] for name in names])
    ratios = []
    shifts = []
    for belief in beliefs.values():
        sd = np.array([belief["sd"][name] for name in names])
        mean = np.array([belief["mean"][name] for name in names])
        ratios.append(sd / second_sd)
        shifts.append((mean - second_mean) / second_sd)
    ratio = np.transpose(ratios)
    shift = np.transpose(shifts)
    figure = lb.figures.new_figure(10.5, 6.0)
    left, right = figure.subplots(1, 2, sharey=True)
    _coloured_table(left, np.log2(ratio), ratio, ".2g")
    left.set_title("u over that of the second edition", fontsize=10)
    _coloured_table(right, shift, shift.round(1) + 0.0, "+.1f")
    right.set_title("shift in u of the second edition", fontsize=10)
    for axes in (left, right):
        axes.set_xticks(range(len(beliefs)), list(beliefs), rotation=60, ha="right", fontsize=8)
    names_on_page = [name.replace("C0YX", "C(0Y)X") for name in names]
    left.set_yticks(range(len(names)), names_on_page, fontsize=8)
    return figure


def _coloured_table(axes: Axes, colour: np.ndarray, values: np.ndarray, form: str) -> None:
    """Values in cells whose colour goes from blue at −2.5 to red at 2.5."""
    axes.imshow(colour, cmap="RdBu_r", vmin=-2.5, vmax=2.5, aspect="auto")
    for (row, column), value in np.ndenumerate(values):
        is_dark = abs(colour[row, column]) > 1.6
        axes.text(
            column,
            row,
            format(value, form),
            ha="center",
            va="center",
            fontsize=6.5,
            color="w" if is_dark else "k",
        )
    axes.grid(visible=False)
