"""Mountings of the bar while a plan is run, and the set-up number of each of them."""

from __future__ import annotations

from ldbb_bayes.campaign.campaign import Campaign, CircularTest
from ldbb_bayes.campaign.circular_test import setup_number
from ldbb_bayes.campaign.run_times import times_stated

__all__ = ["last_setup", "mounted_anew", "setups_as_run"]


def last_setup(plan: Campaign) -> int | None:
    """Return the number of the set-up in which the last circle before a plan was run.

    Only circles to which the plan is added count. Return None if there are none.
    """
    tests = _tests_before(plan)
    return setup_number(tests[-1]) if tests else None


def setups_as_run(plan: Campaign) -> tuple[int, ...]:
    """Return the set-up number of each test of a plan if the tests are run in the plan's order.

    The bar is mounted anew where the set-up changes from one test to the next. A bar that is
    mounted anew is a new set-up, even if the plan returns to a set-up in which circles were run
    before: the offsets of the tool ball are not the same as in that set-up. Such a set-up gets the
    next number that no test has.

    The bar stays as it is mounted if the first test has the plane and the centre of the last circle
    before the plan.
    """
    tests_before = _tests_before(plan)
    planned_before = {setup_number(test) for test in tests_before}
    next_free = max(setup_number(test) for test in (*tests_before, *plan.tests)) + 1
    # Set-up in which the bar is mounted: as the plan numbers it, and as it is run.
    planned_setup = last_setup(plan)
    run_setup = planned_setup or 1
    if tests_before and _place(tests_before[-1]) == _place(plan.tests[0]):
        # The bar may stay as it is: the plan's first set-up is that of the last circle.
        planned_setup = setup_number(plan.tests[0])
    run_setups = []
    for test in plan.tests:
        if setup_number(test) != planned_setup:
            planned_setup = setup_number(test)
            run_setup = planned_setup
            if planned_setup in planned_before:
                run_setup = next_free
                next_free += 1
        planned_before.add(planned_setup)
        run_setups.append(run_setup)
    return tuple(run_setups)


def mounted_anew(plan: Campaign) -> list[int]:
    """Return the positions of the circles of a plan before which the bar is mounted anew.

    The position of the first circle is 0. The first mounting of a plan that is run by itself does
    not count.
    """
    setups = setups_as_run(plan)
    before = [last_setup(plan) or setups[0], *setups[:-1]]
    return [k for k, setup in enumerate(setups) if setup != before[k]]


def _place(test: CircularTest) -> tuple[str, tuple[float, ...]]:
    """Return the plane of the test's circle, and the circle's centre [mm]."""
    return test.circle.plane, tuple(test.circle.centre_mm)


def _tests_before(plan: Campaign) -> tuple[CircularTest, ...]:
    """Return the tests to which a plan is added, in the order in which they were run.

    Without start times, this is the order in which they are listed. The result is empty if the plan
    is run by itself.
    """
    if plan.pilot is None or not plan.adds_to_pilot:
        return ()
    tests = tuple(plan.pilot.tests)
    if times_stated(plan.pilot) < len(tests):
        return tests
    return tuple(sorted(tests, key=_start_s))


def _start_s(test: CircularTest) -> float:
    """Return the time at which a test was started [s]; 0 if it is not stated."""
    return float(test.time_s or 0.0)
