"""Reports for tests: quick posteriors of awkward campaigns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from campaigns import plan, simulated
from matplotlib.figure import Figure

import ldbb_bayes as lb
from ldbb_bayes.inference.mcmc import StoppingRule
from ldbb_bayes.model.specification import model_sha256
from ldbb_bayes.report import pictures
from ldbb_bayes.report.figures import new_figure

NOT_COMPARED = "left out in this test"
SCRIPT = '<script>alert(1)</script> $\\frac$ | *b* `c` & "q" ]]>'


def awkward(kind: str) -> xr.DataTree:
    """A posterior that a page must cope with."""
    constant = lb.HybridModel.first(0)
    linear = lb.HybridModel.first(1)
    if kind == "script":
        return fitted(linear, replace(simulated(plan()), name=SCRIPT))
    if kind == "long name":
        return fitted(linear, replace(simulated(plan()), name="M" * 300))
    if kind == "two tests":
        return fitted(constant, simulated(plan((40, 40), forces_N=(100.0, 600.0))))
    if kind == "forty tests":
        forces_N = np.linspace(36.0, 742.0, 40).tolist()
        return fitted(linear, simulated(plan([60] * 40, forces_N=forces_N)))
    if kind == "three planes":
        return fitted(linear, simulated(plan_of_three_planes()))
    if kind == "degree 2":
        return fitted(lb.HybridModel.first(2), simulated(plan()))
    if kind == "unconverged":
        rule = StoppingRule(ess=100_000.0, max_steps=20)
        return lb.sample(constant, simulated(plan((30,) * 4)), seed=1, rule=rule)
    if kind == "contradiction":
        campaign = simulated(plan())
        # Compliances of the wrong sign: ln P(T | y) near −25, a probability of 1e-11.
        turned = []
        for test in campaign.tests:
            turned.append(test.with_reading_um(-0.14 * np.asarray(test.reading_um)))
        return fitted(constant, replace(campaign, tests=tuple(turned)))
    if kind == "paper":
        return fitted(lb.HybridModel.paper(0), simulated(plan()))
    raise ValueError(kind)


def plan_of_three_planes() -> lb.Campaign:
    """Two forces in each plane."""
    angle_deg = np.arange(0.0, 360.0, 5.0)
    circles = []
    for plane in ("XY", "YZ", "ZX"):
        for force_N in (100.0, 700.0):
            circles.append(lb.CircularTest(force_N, angle_deg, plane=plane))
    return lb.Campaign(tuple(circles), name="three planes")


AWKWARD = (
    "script",
    "long name",
    "three planes",
    "two tests",
    "forty tests",
    "degree 2",
    "unconverged",
    "contradiction",
    "paper",
)


_FITTED: dict[tuple[str, str, str], xr.DataTree] = {}


def fitted(model: lb.HybridModel, campaign: lb.Campaign) -> xr.DataTree:
    """By quadrature: the same draws every time, made once."""
    key = (model_sha256(model), campaign.sha256, campaign.name)
    if key not in _FITTED:
        _FITTED[key] = lb.sample(model, campaign, seed=1, sampler="independent")
    return _FITTED[key].copy(deep=True)


def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages with empty figures: for tests of what is said."""

    def draw_nothing(*_: object, **__: object) -> Figure:
        return new_figure(1.0, 1.0)

    empty = {}
    for key, picture in pictures.PICTURES.items():
        empty[key] = picture._replace(draw=draw_nothing)
    monkeypatch.setattr(pictures, "PICTURES", empty)
