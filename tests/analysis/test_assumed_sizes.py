"""Assumptions that decide numbers: which are named, and with which size."""

from __future__ import annotations

from typing import Any

import pytest

from ldbb_bayes.analysis.assumed_sizes import deciding_assumptions
from ldbb_bayes.analysis.budgets import Budget, Contribution
from ldbb_bayes.analysis.origins import Origin
from ldbb_bayes.model.terms.columns import NOISE, PARAMETERS


def line(
    source: str,
    term: str,
    share: float,
    u: float | None = None,
    unit: str = "mm",
    origin: Origin = Origin.ASSUMED,
) -> Contribution:
    return Contribution(
        source=source,
        term=term,
        kind="B",
        origin=origin,
        u=u,
        unit=unit,
        sensitivity=None,
        contribution=0.0,
        share=share,
    )


def budget(name: str, *lines: Contribution) -> Budget:
    return Budget(name, "mm/N", 1.0, lines, lines[0].term, None)


def named(*budgets: Budget) -> dict[str, Any]:
    assumptions = deciding_assumptions({entry.parameter: entry for entry in budgets})
    return {assumption.term: assumption for assumption in assumptions}


def test_an_effect_below_five_per_cent_decides_nothing() -> None:
    entry = budget("C_XXX", line("mount", "Mount", 0.06, 0.2), line("angle_lag", "Angle", 0.04))
    assert list(named(entry)) == ["Mount"]


def test_parts_of_one_effect_are_added() -> None:
    entry = budget(
        "C_XXX",
        line("mount", "Mount", 0.03, 0.2, "mm/bar"),
        line("mount_curvature", "Mount", 0.03, 5e-4),
    )
    mount = named(entry)["Mount"]
    assert mount.share == pytest.approx(0.06)
    assert [(size.sd, size.unit) for size in mount.sizes] == [(0.2, "mm/bar"), (5e-4, "mm")]


@pytest.mark.parametrize("origin", [Origin.MEASURED, Origin.STATED])
def test_what_is_measured_or_stated_is_not_assumed(origin: Origin) -> None:
    entry = budget("C_XXX", line("mount", "Mount", 0.5, 0.2, origin=origin))
    assert not named(entry)


def test_what_is_stated_is_named_where_it_is_asked_for() -> None:
    entry = budget(
        "C_XXX",
        line("mount", "Mount", 0.5, 0.2, origin=Origin.STATED),
        line("drift_bar", "Drift", 0.5, 1e-3),
    )
    (mount,) = deciding_assumptions({"C_XXX": entry}, Origin.STATED)
    assert (mount.term, mount.share, mount.sizes[0].sd) == ("Mount", 0.5, 0.2)


def test_noise_that_is_measured_and_priors_are_no_effects() -> None:
    entry = budget(
        "C_XXX",
        line(NOISE, NOISE, 0.5, 1e-3, origin=Origin.MEASURED),
        line(PARAMETERS, PARAMETERS, 0.5),
    )
    assert not named(entry)


def test_an_effect_is_named_once_with_its_largest_share_and_size() -> None:
    first = budget("E_YX2", line("form_cos2", "BallForm", 0.7, 3e-3))
    second = budget(
        "E_XX1",
        line("form_cos2", "BallForm", 0.2, 3e-3),
        line("form_cos3", "BallForm", 0.1, 1e-3),
        line("other BallForm", "BallForm", 0.01),
    )
    form = named(second, first)["BallForm"]
    assert form.parameter == "E_YX2"
    assert form.share == pytest.approx(0.7)
    (size,) = form.sizes
    assert (size.source, size.sd, size.differs) == ("form_cos2", 3e-3, True)


def test_the_effect_with_the_largest_share_comes_first() -> None:
    entry = budget(
        "C_XXX", line("drift_bar", "Drift", 0.2, 1e-3), line("mount", "Mount", 0.4, 0.2, "mm/bar")
    )
    assert list(named(entry)) == ["Mount", "Drift"]
