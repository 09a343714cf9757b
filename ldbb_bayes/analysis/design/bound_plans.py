"""The model applied to planned tests, alone or together with the tests of the pilot.

The pilot is the campaign or plan that a design starts from. The model takes its reference force F0,
its range of force, and the estimate Ĉ of the compliances about which it is linearised, from the
pilot. If the tests have different clockings (pairs of angles by which the two balls are turned),
the model has separate terms for the form errors of the two balls. If all tests have the same
clocking, the readings cannot distinguish the form errors of the two balls, and the model has one
common term for both balls.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign, CircularTest
from ldbb_bayes.campaign.run_times import (
    SECONDS_PER_TEST,
    TimeSource,
    after_the_others,
    time_source,
    with_listed_times,
)
from ldbb_bayes.model.hybrid import BoundModel, HybridModel

__all__ = ["bind_plan", "bind_tests"]


def bind_tests(
    model: HybridModel, pilot: Campaign, tests: Sequence[CircularTest], *, keep_pilot_tests: bool
) -> BoundModel:
    """Return the model applied to planned tests, alone or together with the pilot's tests.

    The model takes its reference force, its range of force and the estimate Ĉ of the compliances
    from the pilot. Even if the pilot's tests are left out, the model keeps the parameters that only
    these tests can determine. The coefficients of hysteresis are an exception: which of them the
    model has depends on the directions of travel, and the directions of tests that are left out do
    not count.

    Parameters
    ----------
    model
        Model that is applied to the tests.
    pilot
        The campaign or plan that the design starts from.
    tests
        Planned tests, without those of the pilot.
    keep_pilot_tests
        Whether the model is applied to the tests of the pilot and the planned tests together. If
        so, the tests of the pilot come first. If not, it is applied to the planned tests alone.

    Returns
    -------
    BoundModel
        The model applied to the tests.
    """
    plan = replace(pilot, tests=tuple(tests), foreseen=(), pilot=None, adds_to_pilot=False)
    if not keep_pilot_tests:
        # The order in which the planned tests will be run is not known yet: a random order is
        # assumed.
        plan = replace(plan, order="random")
    return _bind_to_pilot(model, plan, pilot, keep_pilot_tests=keep_pilot_tests)


def bind_plan(model: HybridModel, plan: Campaign) -> BoundModel:
    """Return the model applied to a plan.

    The pilot is the campaign that the plan starts from. If the plan has a pilot, the model takes
    its reference force, its range of force and the estimate Ĉ of the compliances from the pilot.
    The instrument and the order of the tests are always taken from the plan. If the plan is to be
    analysed together with its pilot, the model is applied to the pilot's tests, followed by the
    tests of the plan.
    """
    pilot = plan.pilot
    if pilot is None:
        return model.bind(plan)
    alone = replace(_with_times(plan, pilot), pilot=None, adds_to_pilot=False)
    return _bind_to_pilot(model, alone, pilot, keep_pilot_tests=plan.adds_to_pilot)


def _with_times(plan: Campaign, pilot: Campaign) -> Campaign:
    """Return a plan whose tests have times, which determine how a drift affects them.

    The pilot is the campaign that the plan starts from. If the plan is to be analysed together with
    its pilot, its tests are run after those of the pilot, one every six minutes. A time that a test
    of the plan states is kept, but only if all tests of the pilot state times: a fit of both, too,
    uses times only if all tests state them. Otherwise, the mean time of the plan's tests is that of
    the pilot's tests. A plan is returned unchanged if its tests are not run in the order in which
    they are listed.
    """
    if plan.order is not None:
        return plan
    if plan.adds_to_pilot:
        planned = plan.tests
        if time_source(pilot) == TimeSource.LISTED:
            planned = tuple(replace(test, time_s=None) for test in planned)
        return replace(plan, tests=after_the_others(with_listed_times(pilot), planned))
    planned_s = np.array([test.time_s for test in plan.tests], dtype=float)
    if not np.isfinite(planned_s).all():
        planned_s = SECONDS_PER_TEST * np.arange(len(plan.tests))
    pilot_s = np.array([test.time_s for test in pilot.tests], dtype=float)
    centred_s = planned_s - planned_s.mean()
    if np.isfinite(pilot_s).all():
        centred_s = centred_s + pilot_s.mean()
    tests = []
    for test, time_s in zip(plan.tests, centred_s.tolist(), strict=True):
        tests.append(replace(test, time_s=time_s))
    return replace(plan, tests=tuple(tests))


def _bind_to_pilot(
    model: HybridModel, plan: Campaign, pilot: Campaign, *, keep_pilot_tests: bool
) -> BoundModel:
    """Return the model applied to the tests of a plan, with settings of the pilot.

    ``pilot`` is the campaign that the plan starts from; the model takes its reference force and
    force range from this campaign. If ``keep_pilot_tests`` is true, the model is applied to the
    tests of the pilot and of the plan together; the tests of the pilot come first. If it is false,
    the model is applied to the tests of the plan alone. It then still has all parameters that the
    pilot's tests could determine, except those of effects that depend on the directions of travel.
    """
    tests = plan.tests
    pilot_tests = pilot.plan().tests
    # Remove the names of the tests. The plan then gives every test a different name, even if the
    # same test is planned several times.
    planned = tuple(replace(test, name="") if test.name else test for test in tests)
    if keep_pilot_tests:
        planned = (*with_listed_times(pilot).plan().tests, *planned)
    pilot_kinds = [replace(test, direction=None) for test in pilot_tests]
    foreseen = (*plan.foreseen, *pilot.foreseen, *pilot_kinds)
    joined = replace(plan, tests=planned, foreseen=foreseen)
    return BoundModel(model, joined, pilot=pilot)
