"""What each belief of the model's second edition does to the recovered experiment: one at a time,
and all together."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from study import DATA

import ldbb_bayes as lb

FIRST = lb.HybridModel.first(1)
TOGETHER = lb.HybridModel.default(1)
TERMS = {type(term).__name__: term for term in TOGETHER.nuisances}
GRADE = "G20"
STATED = f"balls of grade {GRADE}"
TOLERANCE = 1e-2
# By inside unit: factor and label for reading.
SHOWN = {"mm/N": (1e6, "nm/N"), "rad/N": (1e9, "nrad/N"), "rad/(N mm)": (1e9, "µrad/(N m)")}
SHOWN |= {f"{unit}/N": (1e3 * factor, f"{label} per kN") for unit, (factor, label) in SHOWN.items()}
SHOWN |= {"1": (1e6, "µm/m"), "1/mm": (1e9, "µm/m²"), "rad": (1e6, "µrad"), "mm": (1e3, "µm")}
Change = Callable[[lb.HybridModel], lb.HybridModel]


def adding(term: str) -> Change:
    """The second edition's term, in place of the first's where that has it."""
    return lambda model: model.with_term(TERMS[term])


def form_falls(model: lb.HybridModel) -> lb.HybridModel:
    """The second edition's form and the prior of its size."""
    return replace(
        model.with_term(TERMS["BallForm"]), prior=replace(model.prior, tau_um=TOGETHER.prior.tau_um)
    )


BELIEFS: Mapping[str, Change] = {
    "first edition": lambda model: model,
    "form falls as it may": form_falls,
    f"the same, {STATED}": form_falls,
    "joint load": adding("JointLoad"),
    "position": adding("Position"),
    "angle": adding("Angle"),
    "mount curved": adding("Mount"),
    "force law curved": adding("ForceError"),
    "a scale per circle": adding("CircleScale"),
    "slopes against Ĉ": lambda model: replace(
        model, prior=replace(model.prior, slopes_of_estimate=True)
    ),
    "all together": lambda model: TOGETHER,
    f"all, {STATED}": lambda model: TOGETHER,
}
# What `--quick` measures again.
AGAIN = ("first edition", "all together")


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


def measure(beliefs: Sequence[str]) -> dict[str, Any]:
    """By belief: mean and sd of every parameter [unit for reading], mean δ [µm], ln B over
    constant, and the evidence over the first edition's [nat], all with linear compliance."""
    plain = lb.read_campaign(DATA / "recovered_experiment")
    ball = lb.Ball(grade=GRADE)
    stated = replace(plain, instrument=replace(plain.instrument, work=ball, tool=ball))
    names = FIRST.bind(plain).names
    first = lb.log_evidence(FIRST, plain, tolerance=TOLERANCE).log_value
    found: dict[str, Any] = {}
    for belief in beliefs:
        campaign = stated if STATED in belief else plain
        model = BELIEFS[belief](FIRST)
        table = lb.inference.marginalize(model, campaign, tolerance=TOLERANCE)
        own = table.loc[list(names)]
        factor = own["unit"].map(lambda unit: SHOWN[unit][0])
        found[belief] = {
            "mean": (factor * own["mean"]).to_dict(),
            "sd": (factor * own["sd"]).to_dict(),
            "delta_um": 1e3 * table.loc["delta", "mean"],
            "log_bayes_factor": log_bayes_factor(model, campaign),
            "log_bayes_factor_zero_kept": log_bayes_factor(zero_kept(model), campaign),
            "evidence": lb.log_evidence(model, campaign, tolerance=TOLERANCE).log_value - first,
        }
    acting = TOGETHER.bind(plain).terms
    return {
        "by_belief": found,
        "units": {name: SHOWN[unit][1] for name, unit in own["unit"].items()},
        "not_here": [kind for kind in TERMS if kind not in acting],
        "elsewhere": elsewhere(found["all together"], factor.to_dict(), plain),
    }


def elsewhere(
    own: Mapping[str, Any], factor: Mapping[str, float], campaign: lb.Campaign
) -> dict[str, float]:
    """Largest difference of all beliefs together from independent draws: of means in u, and of the
    ratio of sds from one."""
    tree = lb.sample(TOGETHER, campaign, sampler="independent", seed=1)["posterior"]
    draws = {name: factor[name] * tree[name].to_numpy().ravel() for name in factor}
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
    """Of every parameter, by belief: u over the first edition's, and how far the mean moves in the
    first edition's u."""
    beliefs = dict(results["by_belief"])
    first = beliefs.pop("first edition")
    names = list(first["mean"])
    wider = np.array(
        [[own["sd"][name] / first["sd"][name] for own in beliefs.values()] for name in names]
    )
    moved = np.array(
        [
            [(own["mean"][n] - first["mean"][n]) / first["sd"][n] for own in beliefs.values()]
            for n in names
        ]
    )
    figure = lb.figures.new_figure(10.5, 6.0)
    panels = figure.subplots(1, 2, sharey=True)
    shown = (
        (np.log2(wider), wider, ".2g", "u over that of the first edition"),
        (moved, moved.round(1) + 0.0, "+.1f", "shift in u of the first edition"),
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
