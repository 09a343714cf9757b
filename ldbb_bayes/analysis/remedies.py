"""The cheapest cure of every parameter: what would narrow it, and its uncertainty with it.

A cure is a change of the plan (another order, the other direction of travel, turned balls, more
circles, a second radius) or a certificate of the instrument. Each one is tried: the longer plan, or
the certified campaign, is bound to the same model, and its `Information` gives the standard
uncertainty of every parameter. Hyper-parameters φ (the scales of the noise and of other effects)
are carried over by name (`HyperPrior.carried`). The estimate of the machine that some effects need
stays that of the readings.

Changes of a plan whose circles are added double the number of circles, whatever their kind. What
the mere number does, all readings taken twice at the same times, does not count as a cure by
another order, direction, clocking or radius. More circles are advised only where what is measured
here (scatter between readings and circles above all) holds most of the variance: an assumed effect
is the same in every circle, and no number of them averages it out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from ldbb_bayes.analysis.cures import at_other_radius, clocked, in_other_direction
from ldbb_bayes.analysis.curve_changes import curve_changes
from ldbb_bayes.analysis.origins import MAJORITY
from ldbb_bayes.analysis.value_of_certificates import missing_certificates
from ldbb_bayes.campaign.campaign import Campaign, CircularTest
from ldbb_bayes.campaign.run_times import SECONDS_PER_TEST
from ldbb_bayes.model.bound_information import information_of
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.terms import Drift
from ldbb_bayes.results import Array, Result
from ldbb_bayes.units import ranked

__all__ = ["CURED_RATIO", "Remedy", "RemedyKind", "remedies"]

# A cure is enough if it leaves at most this share of the standard uncertainty: half of the
# variance, as if an effect that held half of it were known.
CURED_RATIO = 0.5**0.5
# A cure is worth its name if it leaves less than this share of the standard uncertainty.
_NARROWER = 0.9
# A change of the plan counts as a cure of its own only if it leaves less than this share of the
# uncertainty that twice the readings without the change would leave.
_BETTER_THAN_REPETITION = 0.9
# Angle by which both balls are turned in the further circles [°]. At one angle the form error of
# orders 2, 3 and 4 already turns by 90, 135 and 180°.
_TURN_DEG = 45.0
# Number of random orders of which the one least correlated with force is taken.
_ORDERS_TRIED = 200


class RemedyKind(StrEnum):
    """Kind of cure, in the order of what it costs, the cheapest first."""

    ORDER = "order"  #: the same circles in an order that has nothing to do with force
    DIRECTION = "direction"  #: every circle also in the other direction of travel
    BALLS = "balls"  #: every circle also with both balls turned in their sockets
    CIRCLES = "circles"  #: every circle twice
    RADIUS = "radius"  #: every circle also at a second radius
    CERTIFICATE = "certificate"  #: a calibration certificate of the instrument


@dataclass(frozen=True)
class Remedy(Result):
    """The cheapest cure for one parameter, and the uncertainty that it would leave."""

    kind: RemedyKind  #: kind of cure
    #: what is certified, by its key in ``CERTIFICATES``, such as "mount ± 2 %"; empty for a change
    #: of the plan
    certificate: str
    circles: int  #: number of circles that the cure adds to those of the campaign
    sd: float  #: standard uncertainty of the parameter with the cure, in internal units
    ratio: float  #: ``sd`` divided by the standard uncertainty without it


@dataclass(frozen=True)
class _Trial:
    """A cure that was tried.

    ``ratio``, shape (p,), are the standard uncertainties of all parameters with the cure, divided
    by those without it.
    """

    kind: RemedyKind
    certificate: str
    circles: int
    ratio: Array


def remedies(
    bound: BoundModel, phi: Array, sd: Array, measured_share: Array
) -> dict[str, Remedy | None]:
    """Return the cheapest cure of every parameter and change with force.

    It is None where no cure narrows the parameter by a tenth. Changes are those of compliances over
    the tested forces (`curve_changes`). They follow the parameters, under names such as "change of
    C_XXX".

    The cures are tried in the order of `RemedyKind`, certificates in that of ``CERTIFICATES``. The
    first one that leaves at most 71 % of the standard uncertainty (half of the variance) is
    returned; if none does, the one that leaves least, if that is less than 90 %.

    Parameters
    ----------
    bound
        Model bound to a campaign or plan.
    phi
        Values of the h hyper-parameters, shape (h,) [mm].
    sd
        Standard uncertainties of the p parameters and changes without any cure, shape (p,), in
        internal units.
    measured_share
        Share of what is measured here, such as scatter between readings and circles, in the
        variance of each of them, shape (p,).
    """
    information = information_of(bound, phi)
    once = _sd_by_name(bound, information)
    trials = list(_trials(bound, phi, once))
    twice = _sd_by_name(bound, information, times=2.0)
    repetition = [twice[name] / once[name] for name in once]
    cheapest: dict[str, Remedy | None] = {}
    for i, name in enumerate(once):
        helpful = []
        for trial in trials:
            if _helps(trial, i, repetition[i], float(measured_share[i])):
                helpful.append(trial)
        cheapest[name] = _cheapest(helpful, i, float(sd[i]))
    return cheapest


def _helps(trial: _Trial, i: int, repetition: float, measured_share: float) -> bool:
    """Return whether a cure narrows the parameter with index i by itself.

    ``repetition`` is the ratio of standard uncertainties if all readings are taken twice, with
    nothing else changed.
    """
    ratio = float(trial.ratio[i])
    if not ratio < _NARROWER:
        return False
    if trial.kind == RemedyKind.CIRCLES:
        return measured_share > MAJORITY
    if trial.circles:
        return ratio < _BETTER_THAN_REPETITION * repetition
    return True


def _cheapest(helpful: Sequence[_Trial], i: int, sd: float) -> Remedy | None:
    """Return the first cure that suffices for parameter i, else the one that narrows it most."""
    if not helpful:
        return None
    enough = [trial for trial in helpful if trial.ratio[i] <= CURED_RATIO]
    if enough:
        best = enough[0]
    else:
        best = ranked(helpful, lambda trial: -float(trial.ratio[i]))[0]
    ratio = float(best.ratio[i])
    return Remedy(best.kind, best.certificate, best.circles, ratio * sd, ratio)


def _trials(bound: BoundModel, phi: Array, before: Mapping[str, float]) -> Iterator[_Trial]:
    """Yield all cures that can be tried for a campaign, the cheapest first.

    ``before`` are the standard uncertainties without any, by name.
    """
    for kind, plan in longer_plans(bound).items():
        pilot = bound.pilot
        if pilot is None and not bound.campaign.is_plan:
            pilot = bound.campaign
        longer = BoundModel(bound.model, plan, pilot=pilot)
        circles = len(plan.tests) - len(bound.campaign.tests)
        yield _Trial(kind, "", circles, _narrowing(bound, longer, phi, before))
    for name, statements in missing_certificates(bound.campaign.instrument).items():
        instrument = replace(bound.campaign.instrument, **statements)
        campaign = replace(bound.campaign, instrument=instrument)
        certified = BoundModel(bound.model, campaign, pilot=bound.pilot)
        ratio = _narrowing(bound, certified, phi, before)
        yield _Trial(RemedyKind.CERTIFICATE, name, 0, ratio)


def _narrowing(
    bound: BoundModel, changed: BoundModel, phi: Array, before: Mapping[str, float]
) -> Array:
    """Return the standard uncertainties in a changed campaign, divided by those before, shape (p,).

    ``phi`` are the hyper-parameters of ``bound``; they are carried over by name.
    """
    carried = changed.hyper_prior.carried(bound.hyper_prior, phi)
    after = _sd_by_name(changed, information_of(changed, carried))
    return np.array([after[name] / sd for name, sd in before.items()])


def _sd_by_name(
    bound: BoundModel, information: Information, *, times: float = 1.0
) -> dict[str, float]:
    """Return the standard uncertainty of every parameter, then of every change with force, by name.

    ``times`` is the number of repetitions of all readings.
    """
    covariance = information.covariance(times=times)
    interest = information.interest
    sd = np.sqrt(np.diag(covariance)[interest]) * information.scale[interest]
    by_name = dict(zip(bound.names, sd.tolist(), strict=True))
    for name, change in curve_changes(bound, information).items():
        variance = float(change.weights @ covariance @ change.weights)
        by_name[f"change of {name}"] = float(np.sqrt(variance))
    return by_name


def longer_plans(bound: BoundModel) -> Mapping[RemedyKind, Campaign]:
    """Return the plans that the cures by a change of the plan lead to, the cheapest first.

    A cure that the campaign does not need is left out: another order where nothing drifts, the
    other direction where every plane is run both ways. A plan is run in another order; a campaign
    that has been run is run once more in it.
    """
    plan = bound.campaign.plan()
    tests = _timed(plan)
    plans: dict[RemedyKind, Campaign] = {}
    if bound.columns_of.get(Drift):
        if bound.campaign.is_plan:
            plans[RemedyKind.ORDER] = replace(plan, tests=_shuffled(tests))
        else:
            plans[RemedyKind.ORDER] = _extended(plan, tests, _shuffled(tests))
    directed = in_other_direction(replace(plan, tests=tests))
    if directed.further:
        plans[RemedyKind.DIRECTION] = _extended(plan, directed.stated, directed.further)
    turned = clocked(plan, (_TURN_DEG,), work_ball=True, tool_ball=True)
    plans[RemedyKind.BALLS] = _extended(plan, tests, turned)
    plans[RemedyKind.CIRCLES] = _extended(plan, tests, tests)
    plans[RemedyKind.RADIUS] = _extended(plan, tests, at_other_radius(plan))
    return plans


def _timed(plan: Campaign) -> tuple[CircularTest, ...]:
    """Return the circles of a plan with their times, as drift in it is modelled.

    Where not all circles state their times, they are run as listed, one every six minutes. No
    circle has a time if the plan states that its order is random.
    """
    if None not in [test.time_s for test in plan.tests]:
        return tuple(plan.tests)
    if plan.order is not None:
        return tuple(replace(test, time_s=None) for test in plan.tests)
    return tuple(replace(test, time_s=k * SECONDS_PER_TEST) for k, test in enumerate(plan.tests))


def _extended(
    plan: Campaign, before: Sequence[CircularTest], added: Sequence[CircularTest]
) -> Campaign:
    """Return a plan of these circles: those before, then the added ones under new names.

    The added circles are run one every six minutes after the last one before, if those before have
    times.
    """
    times = [test.time_s for test in before if test.time_s is not None]
    later = []
    for k, test in enumerate(added):
        time_s = None
        if times:
            time_s = max(times) + (k + 1) * SECONDS_PER_TEST
        later.append(replace(test, name="", time_s=time_s))
    return replace(plan, tests=(*before, *later))


def _shuffled(tests: Sequence[CircularTest]) -> tuple[CircularTest, ...]:
    """Return the tests in an order that has as little as possible to do with their forces.

    Of random orders with a fixed seed, it is the one with the smallest correlation of place and
    force. The k-th test of the new order is run at the k-th time.
    """
    forces = np.array([float(test.force_N or 0.0) for test in tests])
    place = np.arange(len(tests)) - 0.5 * (len(tests) - 1)
    rng = np.random.default_rng(0)
    orders = [rng.permutation(len(tests)) for _ in range(_ORDERS_TRIED)]
    relation = {k: -abs(float(place @ forces[order])) for k, order in enumerate(orders)}
    best = orders[ranked(relation, relation.__getitem__)[0]]
    times: list[float | None] = [None] * len(tests)
    stated = sorted(test.time_s for test in tests if test.time_s is not None)
    times[: len(stated)] = stated
    return tuple(replace(tests[k], time_s=time) for k, time in zip(best, times, strict=True))
