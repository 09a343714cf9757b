"""Uncertainties that parameters would have with a changed plan or with a new certificate.

A remedy for a large uncertainty is a change of the plan or a calibration certificate of the
instrument. The plan is changed by the circles that it foresees and that have not been run yet, by
another order of the circles, circles in the other direction of travel, circles with turned balls,
more circles, or circles of a second radius. The uncertainties are computed for the changed plan, or
for the campaign with the certificate. The hyper-parameters φ, such as the standard deviation of the
noise, keep their values (`HyperPrior.values_from`). Some effects in the model depend on an estimate
of the machine's compliances. This estimate comes from the unchanged campaign, or from its pilot
(the campaign from which it was planned).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property

import numpy as np

from ldbb_bayes.analysis.confounding_rule import confounding_sources
from ldbb_bayes.analysis.cures import at_other_radius, clocked, in_other_direction
from ldbb_bayes.analysis.curve_changes import curve_changes
from ldbb_bayes.analysis.value_of_certificates import missing_certificates
from ldbb_bayes.analysis.variance_sources import sources_of
from ldbb_bayes.campaign.campaign import Campaign, CircularTest
from ldbb_bayes.campaign.run_times import SECONDS_PER_TEST
from ldbb_bayes.model.bound_information import information_of
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.terms import Drift
from ldbb_bayes.results import Array, Result
from ldbb_bayes.units import ranked

__all__ = ["RemedyKind", "RemedyStep", "TriedRemedies", "longer_plans", "sd_by_name"]

# Angle [°] by which both balls are turned in the added circles, if the remedy for a large
# uncertainty is to turn the balls. One angle is enough: it shifts the phase of a ball's form error
# by 90°, 135° and 180° at the Fourier orders 2, 3 and 4. At these orders, compliances also change
# the readings.
_TURN_DEG = 45.0
# Number of random orders of the circles that are tried. The chosen order is the one in which the
# positions of the circles are least correlated with their forces.
_ORDERS_TRIED = 200


class RemedyKind(StrEnum):
    """Kinds of remedy for a large uncertainty, from the cheapest to the most expensive."""

    #: remedy for a large uncertainty: the circles of the plan that have not been run yet
    PLANNED = "planned"
    #: remedy for a large uncertainty: the same circles are run in an order that is not correlated
    #: with force
    ORDER = "order"
    #: remedy for a large uncertainty: every circle is run in both directions of travel
    DIRECTION = "direction"
    #: remedy for a large uncertainty: every circle is repeated with both balls turned in their
    #: sockets
    BALLS = "balls"
    CIRCLES = "circles"  #: remedy for a large uncertainty: every circle of the plan is run twice
    #: remedy for a large uncertainty: every circle of the plan is run again at another radius
    RADIUS = "radius"
    #: remedy for a large uncertainty: a calibration certificate of the instrument
    CERTIFICATE = "certificate"


@dataclass(frozen=True)
class RemedyStep(Result):
    """A remedy for a large uncertainty: a change of the plan, or a certificate."""

    kind: RemedyKind  #: kind of remedy for a large uncertainty, such as more circles
    #: name of the certificate, such as "mount ± 2 %"; one of the keys of ``CERTIFICATES``. The name
    #: is empty if the remedy is a change of the plan.
    certificate: str


class TriedRemedies:
    """A campaign, and the uncertainties of its parameters after one remedy or several remedies.

    A remedy for a large uncertainty is a certificate of the instrument or a change of the plan.
    Results are stored, so that they are computed only once.

    Parameters
    ----------
    bound
        Model of a campaign or of a plan.
    phi
        Values of the h hyper-parameters, shape (h,); lengths in mm.
    contradicted
        Names of the certificates that the readings contradict. They are no remedies.
    """

    def __init__(self, bound: BoundModel, phi: Array, contradicted: Collection[str] = ()) -> None:
        """Store a campaign's model and hyper-parameters, before any remedy is tried.

        ``bound`` is the model of the campaign or plan. ``phi`` holds the values of the h
        hyper-parameters, shape (h,); lengths are in mm. ``contradicted`` are the names of the
        certificates that the readings contradict.
        """
        self.bound = bound
        self.phi = phi
        self.contradicted = contradicted
        self._bound_with: dict[tuple[RemedyStep, ...], BoundModel] = {(): bound}
        self._sd_with: dict[tuple[RemedyStep, ...], dict[str, float]] = {}
        self._confounded_with: dict[tuple[RemedyStep, ...], set[str]] = {}

    @cached_property
    def steps(self) -> tuple[RemedyStep, ...]:
        """All single remedies that can be tried, the cheapest first.

        A remedy is a certificate of the instrument or a change of the plan.
        """
        steps = [RemedyStep(kind, "") for kind in longer_plans(self.bound)]
        for name in missing_certificates(self.bound.campaign.instrument):
            if name not in self.contradicted:
                steps.append(RemedyStep(RemedyKind.CERTIFICATE, name))
        return tuple(steps)

    def bound_with(self, *steps: RemedyStep) -> BoundModel | None:
        """Return the model of the campaign that results from the remedies ``steps``.

        A remedy is a certificate of the instrument or a change of the plan. The remedies are
        applied one after the other. Return None if a remedy cannot be applied after the earlier
        remedies, for example because the instrument already has the certificate.
        """
        if steps not in self._bound_with:
            before = self.bound_with(*steps[:-1])
            after = None if before is None else _with_remedy(before, steps[-1])
            if after is None:
                return None
            self._bound_with[steps] = after
        return self._bound_with[steps]

    def sd_with(self, *steps: RemedyStep) -> dict[str, float]:
        """Return the standard uncertainties after the remedies ``steps``, in internal units.

        A remedy is a certificate of the instrument or a change of the plan. There is one standard
        uncertainty for each parameter, with its name as the key, and one for each change of a
        compliance with force, with a key such as "change of C_XXX". The result is empty if the
        remedies cannot be applied one after the other.
        """
        if steps not in self._sd_with:
            changed = self.bound_with(*steps)
            self._sd_with[steps] = {}
            if changed is not None:
                self._sd_with[steps] = sd_by_name(changed, self._information(changed))
        return self._sd_with[steps]

    def confounded_with(self, *steps: RemedyStep) -> set[str]:
        """Return the names of the parameters that are confounded after the remedies ``steps``.

        A remedy is a certificate of the instrument or a change of the plan. A parameter is
        confounded if more than half of its variance comes from effects with two properties: their
        standard uncertainties are assumed (neither measured nor stated), and they cause errors of
        all parameters in nearly the same proportions (`confounding_sources`). The parameter's own
        prior does not count as an effect, nor do effects that cause less than 5 % of the variance.
        The result is empty if the remedies cannot be applied one after the other.
        """
        if steps not in self._confounded_with:
            names = set()
            changed = self.bound_with(*steps)
            if changed is not None:
                sources_by_name = sources_of(changed, self._information(changed))
                for name, (sources, likeness) in sources_by_name.items():
                    if confounding_sources(sources, likeness):
                        names.add(name)
            self._confounded_with[steps] = names
        return self._confounded_with[steps]

    def circles_with(self, *steps: RemedyStep) -> int:
        """Return the number of circles that the remedies ``steps`` add to the campaign.

        A remedy is a certificate of the instrument or a change of the plan. Return zero if the
        remedies cannot be applied one after the other.
        """
        changed = self.bound_with(*steps)
        if changed is None:
            return 0
        return len(changed.campaign.tests) - len(self.bound.campaign.tests)

    def _information(self, changed: BoundModel) -> Information:
        """Return the linear model of the readings after some remedies.

        A remedy is a certificate of the instrument or a change of the plan. ``changed`` is the
        model of the campaign or plan that results from the remedies. The hyper-parameters keep the
        values that they have without the remedies.
        """
        carried = changed.hyper_prior.values_from(self.bound.hyper_prior, self.phi)
        return information_of(changed, carried)


def _with_remedy(bound: BoundModel, step: RemedyStep) -> BoundModel | None:
    """Return the model of the campaign or plan that results from one remedy.

    The remedy ``step`` is a certificate of the instrument or a change of the plan. It is applied to
    ``bound``, the model of a campaign or plan. Return None if the plan does not need the change, if
    the instrument already has the certificate, or if the certificate is for one ball while neither
    ball has a certificate.
    """
    if step.certificate:
        statements = missing_certificates(bound.campaign.instrument).get(step.certificate)
        if statements is None:
            return None
        instrument = replace(bound.campaign.instrument, **statements)
        campaign = replace(bound.campaign, instrument=instrument)
        return BoundModel(bound.model, campaign, pilot=bound.pilot)
    plan = longer_plans(bound).get(step.kind)
    if plan is None:
        return None
    pilot = bound.pilot
    if pilot is None and not bound.campaign.is_plan:
        pilot = bound.campaign
    return BoundModel(bound.model, plan, pilot=pilot)


def sd_by_name(
    bound: BoundModel, information: Information, *, times: float = 1.0
) -> dict[str, float]:
    """Return standard uncertainties of all parameters and of the compliances' changes with force.

    The keys are the names of the parameters, followed by names such as "change of C_XXX" for the
    changes of compliances over the tested forces. The values are in internal units. The
    uncertainties are computed as if every reading were taken ``times`` times.
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
    """Return the changed plans that may reduce uncertainties, the cheapest change first.

    The keys are the kinds of change. The first is to run the circles that are planned already, if
    there are any. If the change is another order of the circles, the circles of a plan are
    reordered; the circles of a campaign that has already been run are repeated in the new order.
    This change is left out if the model has no drift. The change to the other direction of travel
    is left out if every plane is already run in both directions.
    """
    plan = bound.campaign.plan()
    tests = _with_drift_times(plan)
    plans: dict[RemedyKind, Campaign] = {}
    if plan.foreseen and not bound.campaign.is_plan:
        plans[RemedyKind.PLANNED] = _with_added_circles(plan, tests, _still_planned(plan))
    if bound.columns_of.get(Drift):
        if bound.campaign.is_plan:
            plans[RemedyKind.ORDER] = replace(plan, tests=_shuffled(tests))
        else:
            plans[RemedyKind.ORDER] = _with_added_circles(plan, tests, _shuffled(tests))
    directed = in_other_direction(replace(plan, tests=tests))
    if directed.further:
        plans[RemedyKind.DIRECTION] = _with_added_circles(plan, directed.stated, directed.further)
    turned = clocked(plan, (_TURN_DEG,), work_ball=True, tool_ball=True)
    plans[RemedyKind.BALLS] = _with_added_circles(plan, tests, turned)
    plans[RemedyKind.CIRCLES] = _with_added_circles(plan, tests, tests)
    plans[RemedyKind.RADIUS] = _with_added_circles(plan, tests, at_other_radius(plan))
    return plans


def _still_planned(campaign: Campaign) -> list[CircularTest]:
    """Return the foreseen circles of a campaign, with readings at the angles of its first circle.

    The angles of foreseen circles have no meaning. A circle has no direction of travel in a plane
    whose circles do not state theirs.
    """
    undirected = {test.plane for test in campaign.tests if test.direction is None}
    planned = []
    for test in campaign.foreseen:
        direction = None if test.plane in undirected else test.direction
        angles = campaign.tests[0].angle_deg
        planned.append(replace(test, angle_deg=angles, direction=direction))
    return planned


def _with_drift_times(plan: Campaign) -> tuple[CircularTest, ...]:
    """Return the circles of a plan with the times from which drift is computed.

    If all circles state their times, these times are kept. Otherwise, the circles are taken to be
    run in the order of the plan, one every six minutes. If the plan states that its order was drawn
    at random, the circles are returned without times instead.
    """
    if None not in [test.time_s for test in plan.tests]:
        return tuple(plan.tests)
    if plan.order is not None:
        return tuple(replace(test, time_s=None) for test in plan.tests)
    return tuple(replace(test, time_s=k * SECONDS_PER_TEST) for k, test in enumerate(plan.tests))


def _with_added_circles(
    plan: Campaign, before: Sequence[CircularTest], added: Sequence[CircularTest]
) -> Campaign:
    """Return a plan with the circles ``before``, followed by the circles ``added`` under new names.

    If the circles ``before`` have times, the added circles are run after the latest of these times,
    one every six minutes. Otherwise, the added circles have no times.
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
    """Return the tests in an order that is nearly uncorrelated with their forces.

    Of 200 random orders with a fixed seed, the function chooses the one in which the positions of
    the tests are least correlated with their forces. The times are not reordered with the tests:
    the k-th test of the new order is run at the k-th of the stated times.
    """
    forces = np.array([float(test.force_N or 0.0) for test in tests])
    centred_positions = np.arange(len(tests)) - 0.5 * (len(tests) - 1)
    rng = np.random.default_rng(0)
    orders = [rng.permutation(len(tests)) for _ in range(_ORDERS_TRIED)]
    # The chosen order is the one in which the positions of the tests are least correlated with the
    # forces. Because the positions are centred, the correlation is proportional to the sum of the
    # products of position and force.
    merit = {k: -abs(float(centred_positions @ forces[order])) for k, order in enumerate(orders)}
    best = orders[ranked(merit, merit.__getitem__)[0]]
    times: list[float | None] = [None] * len(tests)
    stated_times = sorted(test.time_s for test in tests if test.time_s is not None)
    times[: len(stated_times)] = stated_times
    return tuple(replace(tests[k], time_s=time) for k, time in zip(best, times, strict=True))
