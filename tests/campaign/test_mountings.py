"""Set-up numbers of circles, as a plan is run: a bar that is mounted anew is a new set-up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest
from campaigns import in_setups, plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.campaign.mountings import last_setup, mounted_anew, setups_as_run


def planned(setups: Sequence[int | None]) -> lb.Campaign:
    """A plan with a circle in each of these set-ups."""
    circles = plan((40,) * len(setups), forces_N=range(100, 100 + len(setups)))
    return in_setups(circles, *setups)


def run(*setups: int) -> lb.Campaign:
    """A campaign with readings of a circle in each of these set-ups."""
    circles = plan((40,) * len(setups), forces_N=range(100, 100 + len(setups)))
    return in_setups(simulated(circles), *setups)


@pytest.mark.parametrize(
    ("setups", "as_run"),
    [
        ([None, None], (1, 1)),
        ([1, 1, 2, 2], (1, 1, 2, 2)),
        ([2, 1, 1], (2, 1, 1)),
        ([5, 3], (5, 3)),
        ([1, 2, 1, 1, 2], (1, 2, 3, 3, 4)),
        ([1, 5, 1], (1, 5, 6)),
    ],
)
def test_a_plan_that_returns_to_a_set_up_gets_a_new_number(
    setups: list[int | None], as_run: tuple[int, ...]
) -> None:
    one_plan = planned(setups)
    assert setups_as_run(one_plan) == as_run
    anew = [k for k in range(1, len(as_run)) if as_run[k] != as_run[k - 1]]
    assert mounted_anew(one_plan) == anew
    assert last_setup(one_plan) is None


def test_the_circles_that_a_plan_is_added_to_have_taken_their_numbers() -> None:
    pilot = run(1, 1, 2)
    for setups, as_run in (([2], (2,)), ([1], (3,)), ([2, 1, 2], (2, 3, 4)), ([7], (7,))):
        added = replace(planned(setups), pilot=pilot, adds_to_pilot=True)
        assert setups_as_run(added) == as_run
        assert last_setup(added) == 2
    # A plan that is run by itself has nothing to do with the set-ups of its pilot.
    assert setups_as_run(replace(planned([1]), pilot=pilot)) == (1,)


def test_the_last_circle_is_the_one_that_was_started_last() -> None:
    pilot = run(1, 2)
    first, second = pilot.tests
    late_first = replace(pilot, tests=(replace(first, time_s=900.0), replace(second, time_s=100.0)))
    assert last_setup(replace(planned([1]), pilot=late_first, adds_to_pilot=True)) == 1
    partly_timed = replace(pilot, tests=(replace(first, time_s=900.0), second))
    assert last_setup(replace(planned([1]), pilot=partly_timed, adds_to_pilot=True)) == 2


def test_a_bar_that_is_mounted_in_the_plane_stays_as_it_is() -> None:
    """Although the plan names the set-up of earlier circles in the plane."""
    pilot = run(1, 2, 3)
    for setups, as_run in (([1, 1], (3, 3)), ([1, 2, 1], (3, 4, 5)), ([2, 1], (4, 5))):
        added = replace(planned(setups), pilot=pilot, adds_to_pilot=True)
        assert setups_as_run(added) == as_run
    elsewhere = planned([1])
    off_centre = replace(elsewhere.tests[0], centre_x_mm=100.0)
    added = replace(elsewhere, tests=(off_centre,), pilot=pilot, adds_to_pilot=True)
    assert setups_as_run(added) == (4,)
