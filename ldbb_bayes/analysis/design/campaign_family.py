"""Families of campaigns that have the same clockings, radii and calibration certificates.

A clocking is a pair of angles by which the two balls are turned in their sockets. All campaigns of
a family use the same set of clockings, the same set of radii and the same certificates. The
campaigns differ in the number of circles, and in the force, direction of travel, clocking and
radius of the individual circles. Every additional circle costs the same. The information from each
possible circle is computed only once for a family.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations, product
from typing import Any

import numpy as np

from ldbb_bayes.analysis.design.bound_plans import bind_tests
from ldbb_bayes.analysis.design.campaign_objective import objective_of
from ldbb_bayes.analysis.design.candidates import Clocking
from ldbb_bayes.analysis.design.certificate_offers import CertificateOffer, certified_with
from ldbb_bayes.analysis.design.costs import Costs, minutes_of, price_of
from ldbb_bayes.analysis.design.criteria import Determinant
from ldbb_bayes.analysis.design.goals import Goal
from ldbb_bayes.analysis.design.quick_forecast import QuickForecast, limits_of_goals
from ldbb_bayes.analysis.design.space import Space
from ldbb_bayes.analysis.design.states import States
from ldbb_bayes.campaign.campaign import Campaign, CircularTest, distinct_forces
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array

__all__ = ["CampaignFamily", "families_of"]

# Number of possible states of the machine (sets of its parameters and hyper-parameters) over which
# the quick forecast averages.
_QUICK_STATES = 6


@dataclass(frozen=True, eq=False)
class CampaignFamily:
    """Family of campaigns that have the same clockings, radii and calibration certificates.

    A clocking is a pair of angles by which the two balls are turned.
    """

    #: the candidate tests, with all forces, directions of travel, ball angles and radii that the
    #: campaigns of the family may have
    space: Space
    #: calibration certificates that are bought for every campaign of this family of campaigns
    offers: tuple[CertificateOffer, ...]
    goals: Mapping[str, Goal]
    #: possible states of the machine (values of parameters and hyper-parameters) before the
    #: campaign
    states: States
    #: for goals whose uncertainty is reduced by the condition that no compliance is negative: the
    #: ratio of the standard uncertainties with and without this condition; the keys are the names
    #: of the parameters. Other goals have the ratio 1.
    truncation: Mapping[str, float] = field(default_factory=dict)

    @property
    def certificates_price(self) -> float:
        """Price of the calibration certificates that all campaigns of one family need."""
        return sum(offer.price for offer in self.offers)

    @cached_property
    def bound(self) -> BoundModel:
        """The model applied to all candidate tests, with the certificates of the family."""
        bound = bind_tests(
            self.space.model,
            self.space.pilot,
            self.space.tests,
            keep_pilot_tests=self.space.augment,
        )
        if not self.offers:
            return bound
        instrument = certified_with(bound.campaign.instrument, self.offers)
        certified = replace(bound.campaign, instrument=instrument)
        return BoundModel(bound.model, certified, pilot=bound.pilot)

    @cached_property
    def quick(self) -> QuickForecast:
        """Quick forecast of how far a campaign is from the goals for its uncertainties."""
        bound = self.bound
        number = len(self.states.phi)
        chosen = np.unique(np.linspace(0, number - 1, _QUICK_STATES).round().astype(int))
        tests_run = len(self.space.pilot.tests) if self.space.augment else 0
        names = list(self.goals)
        size = Determinant(len(names))
        objective = objective_of(bound, tests_run, self.states.phi[chosen], names, size)
        limits = limits_of_goals(self.goals, self.states, bound.names)[chosen]
        scale = bound.scale[[bound.names.index(name) for name in names]]
        # In the quick forecast compliances may be negative. Its uncertainties are too large where
        # a full forecast is truncated. Larger limits have the same effect as smaller uncertainties.
        truncation = np.array([self.truncation.get(name, 1.0) for name in names])
        return QuickForecast(objective, limits / (truncation * scale))

    def lowest_price(self, costs: Costs, circles: int) -> float:
        """Return the lowest price that a campaign of this family can have with ``circles`` circles.

        The price includes the certificates. It is in the unit of money of `Costs`.
        """
        return price_of(costs, self.least_minutes(costs, circles), self.certificates_price)

    def least_minutes(self, costs: Costs, circles: int) -> float:
        """Return the least machine time that a campaign of ``circles`` circles can have [min].

        All campaigns of a family use the same radii and the same clockings, but not all planes.
        Every plane and radius needs a set-up, in which the first clocking needs no turn of the
        balls. ``costs`` holds the time that each circle, set-up and turn takes.
        """
        radii = len(self.space.radii_mm)
        clockings = len(self.space.clockings_deg)
        planes = len({str(test.plane) for test in self.space.templates})
        least = np.inf
        for setups in range(radii, planes * radii + 1):
            turns = max(clockings - setups, 0)
            minutes = costs.minutes_per_setup * setups + costs.minutes_per_clocking * turns
            least = min(least, minutes)
        return costs.minutes_per_circle * circles + least

    @property
    def fewest_circles(self) -> int:
        """Minimum number of circles of a campaign in this family.

        A campaign needs at least one circle for every radius, one for every pair of ball angles,
        and one for each of the different forces that are needed.
        """
        space = self.space
        return max(self._least_levels, len(space.radii_mm), len(space.clockings_deg))

    @property
    def _least_levels(self) -> int:
        """Smallest permitted number of different forces in a campaign.

        One force is enough if the model's compliances do not depend on force, or if the campaign is
        analysed together with tests that have already been run. In all other cases, two forces are
        needed.
        """
        if self.space.augment or self.space.model.degree == 0:
            return 1
        return 2

    def best_counts(self, circles: int, start: Array | None = None) -> Array:
        """Return the number of circles of each candidate test in the best campaign.

        ``circles`` is the number of all circles of the campaign. The search begins with the
        campaign that has ``start`` circles of each candidate test, and adds circles one by one. By
        default, it begins without circles. If all circles of the resulting campaign are at one
        force although two forces are needed, one circle is replaced by the best candidate at
        another force. ``start`` and the result have the shape (candidates,).
        """
        if start is None:
            start = np.zeros(self.quick.candidates, dtype=int)
        counts = self.quick.best_counts(circles, start)
        if self._has_enough_forces(counts):
            return counts
        best = counts
        best_distance = np.inf
        most_frequent = int(np.argmax(counts))
        for candidate in range(len(counts)):
            exchanged = counts.copy()
            exchanged[most_frequent] -= 1
            exchanged[candidate] += 1
            distance = self.quick.distance(exchanged)
            if self._has_enough_forces(exchanged) and distance < best_distance:
                best = exchanged
                best_distance = distance
        return best

    def _has_enough_forces(self, counts: Array) -> bool:
        """Return whether the circles of a campaign have enough different forces.

        One force is enough if compliances do not depend on force, or if the campaign is analysed
        together with tests that have already been run. Otherwise, two are needed. ``counts`` is
        the number of circles of each candidate test, shape (candidates,).
        """
        forces = [float(test.force_N or 0.0) for test in self.tests_of(counts)]
        return len(distinct_forces(forces)) >= self._least_levels

    def tests_of(self, counts: Array) -> tuple[CircularTest, ...]:
        """Return the tests of a campaign, each repeated as often as it is run.

        ``counts`` is the number of circles of each candidate test, shape (candidates,).
        """
        positions = np.repeat(np.arange(len(self.space.tests)), counts)
        return tuple(self.space.tests[k] for k in positions)

    def uses_all(self, tests: Sequence[CircularTest]) -> bool:
        """Return whether ``tests`` use all clockings and all radii of the family.

        A clocking is a pair of angles by which the two balls are turned in their sockets. The tests
        must belong to the family: only the numbers of different clockings and of different radii
        are compared with those of the family.
        """
        clockings = {(test.work_ball_deg, test.tool_ball_deg) for test in tests}
        radii = {test.radius_mm for test in tests}
        uses_all_clockings = len(clockings) >= len(self.space.clockings_deg)
        uses_all_radii = len(radii) >= len(self.space.radii_mm)
        return uses_all_clockings and uses_all_radii

    def minutes(self, costs: Costs, tests: Sequence[CircularTest]) -> float:
        """Return the machine time of ``tests`` [min], computed from the times in ``costs``."""
        return minutes_of(costs, tests)

    def price(self, costs: Costs, tests: Sequence[CircularTest]) -> float:
        """Return the price of the machine time of ``tests``, plus the price of the certificates.

        ``costs`` holds the price of an hour and the time that each circle, set-up and turn of the
        balls takes.
        """
        return price_of(costs, minutes_of(costs, tests), self.certificates_price)

    def plan_of(self, tests: Sequence[CircularTest]) -> Campaign:
        """Return the tests as a plan, in the order in which to run them.

        The plan describes the instrument as it will be with the certificates that are bought for
        the campaigns of this family.
        """
        plan = self.space.plan_of(tests, seed=self.space.seed)
        if not self.offers:
            return plan
        return replace(plan, instrument=certified_with(plan.instrument, self.offers))


def families_of(
    space: Space,
    sets_of_certificates: Sequence[tuple[CertificateOffer, ...]],
    goals: Mapping[str, Goal],
    states: States,
    truncation: Mapping[str, float],
) -> Iterator[CampaignFamily]:
    """Yield the families of campaigns among which the cheapest campaign is sought.

    The campaigns of one family use the same clockings, the same radii and the same certificates.
    There is one family for each combination of three choices: a non-empty subset of the clockings,
    a non-empty subset of the radii, and one of the sets in ``sets_of_certificates`` (certificates
    that could be bought). Subsets of the clockings contain the first clocking, because only the
    difference between the clockings of a campaign matters; if the circles are added to those of the
    pilot, which have clockings of their own, any subset is possible. ``space`` holds the clockings
    and radii to choose from. ``goals`` are the goals for uncertainties, ``states`` are the possible
    states of the machine, and ``truncation`` are the ratios of `CampaignFamily.truncation`; all are
    the same for all families.
    """
    clocking_sets = [chosen for chosen in _subsets(space.clockings_deg) if chosen]
    if not space.augment:
        first = space.clockings_deg[0]
        clocking_sets = [chosen for chosen in clocking_sets if first in chosen]
    radius_sets = [chosen for chosen in _subsets(space.radii_mm) if chosen]
    for clockings, radii, offers in product(clocking_sets, radius_sets, sets_of_certificates):
        narrowed = replace(space, clockings_deg=clockings, radii_mm=radii)
        yield CampaignFamily(narrowed, offers, goals, states, truncation)


def _subsets(values: Sequence[Clocking] | Sequence[float]) -> list[tuple[Any, ...]]:
    """Return all subsets of ``values``, beginning with the empty subset."""
    subsets = []
    for number in range(len(values) + 1):
        subsets += list(combinations(values, number))
    return subsets
