"""How soon a change would be found: the fast way against the analysis of whole series."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ldbb_bayes.fleet.change import Series, _Looks, carry, detection, scatter_rule, steps_of, weigh

Array = NDArray[np.float64]
P = 2
OPTIONS = {"change_scale": 0.2, "repeatability": 0.01, "probability": 0.5, "threshold": 0.95}


@pytest.fixture(scope="module")
def information() -> Array:
    rng = np.random.default_rng(2)
    root = rng.standard_normal((3, 4)) * np.array([60.0, 10.0, 30.0])[:, None]
    return root @ root.T


def test_odds_are_those_of_the_analysis(information: Array) -> None:
    rng = np.random.default_rng(3)
    weighted = rng.standard_normal((4, 6, 3)) @ np.linalg.cholesky(information).T + information @ [0.4, -0.1, 0.3]
    shifts = np.array([[0.0, 0.0, 0.0], 0.1 * information[0], -0.3 * information[1]])
    rule = scatter_rule(0.01, step=0.25)
    looks = _Looks(information, P, rule, 0.2, 0.4)
    for moved in (0, 2, 5):
        found = looks.change(weighted, shifts, moved)
        for m, shift in enumerate(shifts):
            for s in range(4):
                own = weighted[s].copy()
                own[6 - moved :] += shift
                series = Series(np.tile(information, (6, 1, 1)), own, P)
                none = weigh(steps_of(carry(series, rule[0]), 0.2), rule[1], 0.4).none.sum()
                assert found[m, s] == pytest.approx(np.log1p(-none) - np.log(none), abs=1e-6)


def test_a_larger_change_is_found_sooner(information: Array) -> None:
    found = [
        detection(
            information, P, np.array([0.5, 0.1, 0.0]), np.array([size, np.nan]), before=5, scatter=scatter_rule(0.01), **OPTIONS
        )
        for size in (0.0, 0.05, 0.4)
    ]
    assert np.all(np.diff(found[2].found[0]) >= 0.0)
    assert found[0].found[0] == pytest.approx(found[0].false_alarm)
    assert found[2].campaigns(0) is not None
    assert found[2].found[0, 0] > found[1].found[0, 0] > found[0].found[0, 0]
    assert np.isnan(found[0].found[1]).all()
    assert found[0].campaigns(1) is None
    assert found[0].error(np.array([0.0, 0.5]))[1] == pytest.approx(0.5 / np.sqrt(found[0].replicates))
    assert found[0].error(np.array([0.0]))[0] > 0.0


def test_a_sure_change_and_a_machine_at_rest(information: Array) -> None:
    """A change of many standard uncertainties is found at once; false alarms of one look stay below what the threshold allows."""
    one = detection(
        1e4 * information, P, np.zeros(3), np.array([0.5, 0.5]), before=8, scatter=scatter_rule(0.001), **OPTIONS, replicates=400
    )
    assert one.found[:, 0] == pytest.approx(1.0)
    assert one.false_alarm[0] < 0.05
    assert one.campaigns(0) == 1
