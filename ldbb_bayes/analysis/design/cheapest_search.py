"""Search for the cheapest campaigns that reach given goals for uncertainties.

Campaigns of one family have the same clockings (pairs of angles by which the two balls are turned
in their sockets), radii and certificates. The search goes through families and numbers of circles,
the cheapest first. For each family and number of circles, the search takes the campaign with the
smallest distance from the goals in the quick forecast (`quick_forecast`). If this distance is small
enough, the full forecast (`forecast`) decides whether the goals are reached. The uncertainties of
the quick forecast are too small by a factor that hardly differs between campaigns of one family.
This factor is estimated from the full forecasts made so far.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ldbb_bayes.analysis.design.campaign_family import CampaignFamily
from ldbb_bayes.analysis.design.costs import Costs
from ldbb_bayes.analysis.design.forecast import forecast_plan
from ldbb_bayes.analysis.design.goals import Goal
from ldbb_bayes.analysis.design.judged_campaigns import (
    JudgedCampaign,
    are_enough,
    judge_plan,
    judged_on_fresh_machines,
    log_ratios_to_goals,
    shares_of_machines,
)
from ldbb_bayes.results import Array

__all__ = [
    "CheapestCampaigns",
    "find_cheapest",
    "judge_largest",
    "largest_counts",
    "truncation_ratios",
]

# Largest number of circles that a campaign may have in the search for the cheapest campaign.
_MOST_CIRCLES = 40
# Number of circles of the campaign from which the search estimates how many circles a family of
# campaigns needs. The search finds the best campaign of the family with this number of circles. It
# then multiplies the number of circles of each test by the same factor: the smallest one with which
# the goals for uncertainties are reached.
_CIRCLES_OF_SHARES = 8
# The search in a family of campaigns begins with this fraction of the estimated number of circles
# with which the goals for uncertainties are reached.
_BEGIN_SHARE = 0.85
# Number of bisection steps with which the search finds the factor by which a campaign must be
# enlarged so that it just reaches the goals for uncertainties.
_HALVINGS = 10
# Before a slow, full forecast of a campaign is made, its result is estimated from a quick forecast
# (with known hyper-parameters). For each goal, let u be the estimated standard uncertainty, and u*
# the largest that the goal permits. The full forecast is made only if ln(u/u*) is at most this
# number for all goals.
_NEAR = 0.03
# Number of full forecasts (with unknown hyper-parameters) for campaigns with the same pairs of ball
# angles, radii and certificates, each with one circle more. If all of them miss the goals, the
# number of circles is searched by bisection.
_MOST_FORECASTS = 8
# After the search has found a campaign that reaches the goals for uncertainties, it tries to omit a
# circle. A fast forecast with this number of possible machines shows whether the slower forecast
# with all 64 possible machines is worthwhile.
_FEW_MACHINES = 16
# The search for further campaigns ends when the cheapest campaign that reaches the goals was found
# and the computing effort (`_Search.effort`) exceeds this number.
_MOST_EFFORT = 700


@dataclass(frozen=True, eq=False)
class CheapestCampaigns:
    """Campaigns that reach all uncertainty goals; if none does, the one that comes nearest."""

    #: the campaigns that reach all goals for uncertainties, the cheapest first
    campaigns: tuple[JudgedCampaign, ...]
    #: campaign that comes nearest to the goals for uncertainties: the one that meets all goals on
    #: the largest share of the possible machines (random draws of the parameters and
    #: hyper-parameters). Only campaigns for which a forecast with unknown hyper-parameters was made
    #: are considered. None if there is no such campaign.
    nearest: JudgedCampaign | None
    #: the same for every goal alone: the campaign that meets the goal on the largest share of the
    #: possible machines. The keys are the names of the goals' parameters.
    nearest_by_goal: Mapping[str, JudgedCampaign] = field(default_factory=dict)
    #: whether campaigns were left out because they exceed the longest machine time allowed
    is_too_long: bool = False


def judge_largest(family: CampaignFamily) -> JudgedCampaign:
    """Return the largest campaign that a search tries first, with its full forecast.

    It is the best campaign of 8 circles of the family, with every circle repeated five times.
    """
    counts = (_MOST_CIRCLES // _CIRCLES_OF_SHARES) * family.best_counts(_CIRCLES_OF_SHARES)
    return judge_plan(family, family.tests_of(counts))


def largest_counts(family: CampaignFamily, costs: Costs) -> Array | None:
    """Return the number of circles of each candidate test in the largest campaign allowed.

    It is the best campaign of the family with as many circles as the machine time allows. If this
    is not limited, or allows 40 circles, it is that of `judge_largest`. The result, shape
    (candidates,), is None if no campaign of the family fits the machine time.
    """
    for circles in range(_MOST_CIRCLES, family.fewest_circles - 1, -1):
        if not costs.fits(family.least_minutes(costs, circles)):
            continue
        if circles == _MOST_CIRCLES:
            counts = (_MOST_CIRCLES // _CIRCLES_OF_SHARES) * family.best_counts(_CIRCLES_OF_SHARES)
        else:
            counts = family.best_counts(circles)
        tests = family.tests_of(counts)
        if costs.fits(family.minutes(costs, tests)):
            # What the best campaign does not use, a smaller family offers too.
            return counts if family.uses_all(tests) else None
    return None


def truncation_ratios(largest: JudgedCampaign) -> dict[str, float]:
    """Return how much the condition that no compliance is negative reduces uncertainties.

    The result holds, for every goal, the ratio of the standard uncertainties with and without this
    condition; the keys are the names of the parameters. The ratios are those of ``largest``, the
    largest campaign that a search tries first. The result is empty if the model allows negative
    compliances.
    """
    family = largest.family
    if not family.bound.truncation.active:
        return {}
    forecast = forecast_plan(family.space.model, largest.plan, analyses=largest.analyses)
    ratios = {}
    for name in family.goals:
        expected = forecast.expected[name]
        ratios[name] = min(1.0, expected.sd / expected.untruncated_sd)
    return ratios


@dataclass
class _Progress:
    """Progress of the search in one family of campaigns.

    u is the uncertainty of a goal's parameter in the full forecast, in which the analysis must
    estimate the hyper-parameters, and v its uncertainty in the quick forecast, in which they are
    known.
    """

    family: CampaignFamily
    #: number of circles of the campaign that is tried next
    circles: int
    #: number of circles of every candidate test in the campaign that was tried last, shape
    #: (candidates,)
    counts: Array
    #: ln(u/v) for the campaign with the largest number of circles allowed; zero if u < v
    lasting_inflation: float = 0.0
    #: coefficient a of the formula ln(u/v) = ``lasting_inflation`` + a/n for a campaign of n
    #: circles; None before the first full forecast
    inflation: float | None = None
    #: number of full forecasts made
    forecasts: int = 0
    #: number of circles of the largest campaign whose full forecast missed the goals
    last_failed: int = 0
    #: number of circles of the campaign that was tried first
    first: int = 0
    #: whether the number of circles that the goals need has been estimated
    started: bool = False


@dataclass(order=True)
class _QueuedFamily:
    """A family of campaigns that is still to be searched, as an entry of the queue of families.

    The queue is sorted by ``price``, a lower limit of the price of the campaign that is tried next
    in the family.
    """

    price: float
    #: number of the family in the list of families; families with equal prices are searched in the
    #: order of these numbers
    position: int
    progress: _Progress = field(compare=False)


def find_cheapest(
    families: Sequence[CampaignFamily],
    goals: Mapping[str, Goal],
    costs: Costs,
    probability: float,
    number: int,
    *,
    on_campaign: Callable[[], object],
) -> CheapestCampaigns:
    """Return the cheapest campaigns that reach all uncertainty goals, one from each family.

    A campaign that buys one more certificate than a cheaper one, and takes no less machine time, is
    left out. If fewer than ``number`` campaigns are left, further campaigns are added. They belong
    to the family of the cheapest campaign, but have more circles.

    Parameters
    ----------
    families
        Families of campaigns; the campaigns of one family have the same angles of the balls in
        their sockets, radii and certificates.
    goals
        Goals; the keys are the names of the parameters.
    costs
        Costs of circles, set-ups and turns of the balls, and the longest machine time allowed.
    probability
        Minimum share of the possible machines on which all goals must be met.
    number
        Largest number of campaigns to return.
    on_campaign
        Function that is called whenever one more campaign is found.

    Returns
    -------
    CheapestCampaigns
        The campaigns, the cheapest first; none if no family reaches the goals.
    """
    search = _Search(goals, costs, probability)
    queue = _queue_of(families, costs)
    campaigns: list[JudgedCampaign] = []
    reported = 0
    while queue and not _is_complete(campaigns, number, queue[0].price, search.effort, costs):
        entry = heapq.heappop(queue)
        progress = entry.progress
        minutes = progress.family.least_minutes(costs, progress.circles)
        if any(_buys_in_vain(progress.family, minutes, campaign, costs) for campaign in campaigns):
            continue
        # A family leaves the queue when a campaign of the family meets the goals, or when none can.
        campaign = None
        if not progress.started:
            goes_on = search.start(progress)
        else:
            campaign = search.attempt(progress)
            goes_on = campaign is None
            progress.circles += 1
        if goes_on and progress.circles <= _MOST_CIRCLES:
            price = progress.family.lowest_price(costs, progress.circles)
            heapq.heappush(queue, _QueuedFamily(price, entry.position, progress))
        if campaign is not None:
            campaigns = [*_not_in_vain(campaigns, campaign, costs), campaign]
            queue = _retry_skipped(queue, costs)
            if reported < min(len(campaigns), number):
                on_campaign()
                reported += 1
    campaigns.sort(key=lambda campaign: campaign.price(costs))
    campaigns = campaigns[:number]
    campaigns += _with_more_circles(campaigns, number - len(campaigns), costs, on_campaign)
    campaigns.sort(key=lambda campaign: campaign.price(costs))
    return CheapestCampaigns(
        tuple(campaigns), search.nearest, search.nearest_by_goal, search.is_too_long
    )


def _is_complete(
    campaigns: Sequence[JudgedCampaign], number: int, lowest_price: float, effort: int, costs: Costs
) -> bool:
    """Return whether no family that is still in the queue need be searched.

    That is so if none of the campaigns to try next can be cheaper than the ``number`` cheapest that
    were found. If the search has taken much computing effort, it is enough that none can be cheaper
    than the cheapest. ``campaigns`` are the campaigns found so far, ``lowest_price`` is a lower
    limit of the prices of the campaigns to try next, and ``effort`` is the computing effort so far.
    """
    if not campaigns:
        return False
    prices = sorted(campaign.price(costs) for campaign in campaigns)
    if lowest_price < prices[0]:
        return False
    if effort > _MOST_EFFORT:
        return True
    return len(campaigns) >= number and lowest_price >= prices[number - 1]


def _retry_skipped(queue: Sequence[_QueuedFamily], costs: Costs) -> list[_QueuedFamily]:
    """Return the queue of families, in which the numbers of circles that were skipped come again.

    Numbers of circles are skipped if the expected uncertainties miss the goals. What is expected
    depends on the full forecasts so far, which were of few circles at first; after a campaign that
    meets the goals, more is known. ``costs`` holds the prices and times of circles and set-ups.
    """
    again = []
    for entry in queue:
        progress = entry.progress
        price = entry.price
        if progress.started and progress.first < progress.circles:
            progress.circles = max(progress.first, progress.last_failed + 1)
            progress.counts = np.zeros_like(progress.counts)
            price = progress.family.lowest_price(costs, progress.circles)
        again.append(_QueuedFamily(price, entry.position, progress))
    heapq.heapify(again)
    return again


def _buys_in_vain(
    family: CampaignFamily, minutes: float, cheaper: JudgedCampaign, costs: Costs
) -> bool:
    """Return whether a campaign buys a certificate that saves no time.

    That is so if it buys all certificates of a cheaper campaign and at least one more, but needs no
    less machine time. ``family`` is the family of the campaign, ``minutes`` the machine time that
    it needs at least [min], ``cheaper`` a campaign that was found, and ``costs`` holds the times of
    circles and set-ups.
    """
    bought = {offer.name for offer in family.offers}
    enough = {offer.name for offer in cheaper.family.offers}
    return enough < bought and minutes >= cheaper.family.minutes(costs, cheaper.tests)


def _not_in_vain(
    campaigns: Sequence[JudgedCampaign], cheaper: JudgedCampaign, costs: Costs
) -> list[JudgedCampaign]:
    """Return the campaigns that buy no certificate in vain, compared with one found after them.

    ``campaigns`` are those found before, and ``cheaper`` is the one found after them.
    """
    needed = []
    for campaign in campaigns:
        minutes = campaign.family.minutes(costs, campaign.tests)
        if not _buys_in_vain(campaign.family, minutes, cheaper, costs):
            needed.append(campaign)
    return needed


def _queue_of(families: Sequence[CampaignFamily], costs: Costs) -> list[_QueuedFamily]:
    """Return the families of campaigns to search as a heap: the cheapest family comes first.

    ``costs`` holds the prices and times of circles, set-ups and turns of the balls.
    """
    queue = []
    for position, family in enumerate(families):
        circles = family.fewest_circles
        price = family.lowest_price(costs, circles)
        no_circles = np.zeros(len(family.space.tests), dtype=int)
        queue.append(_QueuedFamily(price, position, _Progress(family, circles, no_circles)))
    heapq.heapify(queue)
    return queue


def _with_more_circles(
    campaigns: Sequence[JudgedCampaign],
    number: int,
    costs: Costs,
    on_campaign: Callable[[], object],
) -> list[JudgedCampaign]:
    """Return campaigns that have 1, 2, …, ``number`` circles more than the cheapest one found.

    They are the best campaigns of the same family. They cost more, but are more likely to meet the
    goals for uncertainties. Campaigns that exceed the longest machine time allowed are left out.
    The list is empty if no campaign was found. ``on_campaign`` is called whenever a campaign is
    found.
    """
    if not campaigns:
        return []
    campaign = min(campaigns, key=lambda campaign: campaign.price(costs))
    longer = []
    for added in range(1, number + 1):
        counts = campaign.family.best_counts(len(campaign.tests) + added)
        tests = campaign.family.tests_of(counts)
        if costs.fits(campaign.family.minutes(costs, tests)):
            longer.append(judge_plan(campaign.family, tests))
            on_campaign()
    return longer


class _Search:
    """Search for the cheapest campaigns, in one family of campaigns after another.

    Forecasts for one family are also used in the families that are searched later.
    """

    def __init__(self, goals: Mapping[str, Goal], costs: Costs, probability: float) -> None:
        """Begin a search in which no family of campaigns has been examined yet.

        ``probability`` is the minimum share of the possible machines on which all goals are to be
        met.
        """
        self._goals = goals
        self._costs = costs
        self._probability = probability
        # The coefficient `_Progress.inflation` of a family of campaigns states how much larger
        # uncertainties are in a full forecast than in a quick forecast (with known
        # hyper-parameters). The smallest coefficient of the families searched so far is stored
        # here. It is used for a family that has no full forecast yet.
        self._inflation = np.inf
        #: whether campaigns were left out because they exceed the longest machine time allowed
        self.is_too_long = False
        #: campaign that comes nearest to the goals for uncertainties without reaching them: the one
        #: that meets all goals on the largest share of the possible machines
        self.nearest: JudgedCampaign | None = None
        #: the same for every goal alone; the keys are the names of the goals' parameters
        self.nearest_by_goal: dict[str, JudgedCampaign] = {}
        #: computing effort of the search so far: sum of n² over full forecasts of campaigns of n
        #: circles. Not counted are the forecast with which the search in a family starts, and
        #: those of the bisection, unless the campaign meets the goals.
        self.effort = 0

    def start(self, progress: _Progress) -> bool:
        """Begin the search in a `CampaignFamily`, and return whether the search goes on.

        The result is false in two cases. In the first case, a goal for an uncertainty is missed in
        the quick forecast even with very many circles. In the second case, the goals are missed in
        the full forecast of a plan with the largest number of circles allowed. Only one such plan
        is tried: the best plan of 8 circles, with every circle repeated five times. If this plan is
        better than ``nearest``, it replaces ``nearest``.

        If the result is true, the number of circles that is tried first and ``lasting_inflation``
        are stored in ``progress``. In every case, ``progress.started`` is set to true.
        """
        family = progress.family
        progress.started = True
        if family.quick.floor().max() > 0.0:
            return False
        counts = family.best_counts(_CIRCLES_OF_SHARES)
        many = (_MOST_CIRCLES // _CIRCLES_OF_SHARES) * counts
        largest = judge_plan(family, family.tests_of(many))
        if not self._is_met(largest):
            self._keep_nearest(largest)
            return False
        progress.lasting_inflation = max(self._inflation_of(largest, many), 0.0)
        needed = _least_multiple(family, counts, -progress.lasting_inflation)
        begin = int(_BEGIN_SHARE * needed * _CIRCLES_OF_SHARES)
        progress.circles = max(family.fewest_circles, begin)
        progress.first = progress.circles
        return True

    def _inflation_of(self, campaign: JudgedCampaign, counts: Array) -> float:
        """Return the difference of ln(u/u*) between the full and the quick forecast of a campaign.

        u is the standard uncertainty of a goal's parameter after the campaign, and u* the largest
        that the goal permits. The full forecast, stored in ``campaign``, gives ln(u/u*) of every
        goal on many possible machines. The largest value of each machine is taken, and then the
        quantile of these values at the required probability. The quick forecast gives a single
        value, which is subtracted. It is computed from ``counts``, the campaign's number of circles
        of every candidate test.
        """
        excess = log_ratios_to_goals(campaign.stated, self._goals).max(axis=1)
        distance = campaign.family.quick.distance(counts)
        return float(np.quantile(excess, self._probability)) - distance

    def _keep_nearest(self, campaign: JudgedCampaign) -> None:
        """Store a campaign as ``nearest`` if it is better than the campaign stored before.

        A campaign is better if it reaches all goals for uncertainties on a larger share of the
        possible machines or, with equal shares, if it has more circles. For every goal alone, the
        best campaign is stored in ``nearest_by_goal``.
        """
        if self.nearest is None or self._rank(campaign) > self._rank(self.nearest):
            self.nearest = campaign
        for name in self._goals:
            best = self.nearest_by_goal.get(name)
            if best is None or self._rank(campaign, name) > self._rank(best, name):
                self.nearest_by_goal[name] = campaign

    def _rank(self, campaign: JudgedCampaign, name: str = "") -> tuple[float, int]:
        """Return the share of machines on which a campaign reaches goals, and its circles.

        ``name`` is the name of a goal's parameter; an empty string means all goals together.
        """
        return self._share_met(campaign, name), len(campaign.tests)

    def _share_met(self, campaign: JudgedCampaign, name: str = "") -> float:
        """Return the share of machines on which a campaign reaches goals for uncertainties.

        ``name`` is the name of a goal's parameter; an empty string means all goals together.
        """
        return shares_of_machines(campaign.stated, self._goals)[name]

    def _is_met(self, campaign: JudgedCampaign) -> bool:
        """Return whether a campaign reaches all uncertainty goals with the required probability."""
        machines = len(campaign.stated.u)
        return are_enough(self._share_met(campaign), machines, self._probability)

    def attempt(self, progress: _Progress) -> JudgedCampaign | None:
        """Return a campaign of a family that meets the uncertainty goals, or None if this fails.

        ``progress`` holds the family and the number of circles to try. The result has this number
        of circles, or fewer if fewer are enough. The attempt fails if the best campaign with this
        number of circles misses the goals, needs too much machine time, or does not use all
        clockings and radii of the family.
        """
        family = progress.family
        circles = progress.circles
        counts = family.best_counts(circles, progress.counts)
        progress.counts = counts
        tests = family.tests_of(counts)
        is_too_long = not self._costs.fits(family.minutes(self._costs, tests))
        if is_too_long or progress.forecasts >= _MOST_FORECASTS or circles == _MOST_CIRCLES:
            return self._found_by_bisection(progress)
        distance = family.quick.distance(counts)
        inflation = self._expected_inflation(progress)
        if distance + inflation > _NEAR or not family.uses_all(tests):
            return None
        campaign = self._confirmed(self._forecast_fully(progress, counts))
        if campaign is None:
            campaign = self._chosen_anew(family, counts)
        if campaign is None:
            progress.last_failed = circles
            return None
        return self._with_fewer_circles(progress, campaign)

    def _chosen_anew(self, family: CampaignFamily, counts: Array) -> JudgedCampaign | None:
        """Return a campaign whose circles are all chosen anew, or None if it misses the goals.

        Campaigns that grow circle by circle may keep a choice that was best for fewer circles, such
        as a single direction of travel. ``counts`` is the number of circles of every candidate test
        in such a campaign, which misses the goals. The result has as many circles. It is None, too,
        if the quick forecast does not prefer the new choice.
        """
        chosen = family.best_counts(int(counts.sum()))
        tests = family.tests_of(chosen)
        is_better = family.quick.distance(chosen) < family.quick.distance(counts)
        if not (is_better and family.uses_all(tests)):
            return None
        return self._confirmed(judge_plan(family, tests))

    def _found_by_bisection(self, progress: _Progress) -> JudgedCampaign | None:
        """Return a campaign of a family that narrowly misses the goals with fewer circles.

        The largest campaign that fits the machine time is judged first. If it meets the goals, a
        smaller one that meets them is searched by bisection of the numbers of circles that were not
        tried yet. The result is None if the largest campaign misses the goals. The search in the
        family then ends, so that ``progress.circles`` is set to the largest number allowed.
        """
        family = progress.family
        progress.circles = _MOST_CIRCLES
        missed = max(progress.last_failed, family.fewest_circles - 1)
        counts = self._largest_counts(family, missed)
        if counts is None:
            return None
        tests = family.tests_of(counts)
        best = None
        if family.uses_all(tests):
            best = self._confirmed(judge_plan(family, tests))
        while best is not None and len(best.tests) - missed > 1:
            circles = (len(best.tests) + missed) // 2
            tests = family.tests_of(family.best_counts(circles))
            shorter = None
            if family.uses_all(tests):
                shorter = self._confirmed(judge_plan(family, tests))
            if shorter is None:
                missed = circles
            else:
                best = shorter
        return best

    def _largest_counts(self, family: CampaignFamily, missed: int) -> Array | None:
        """Return the number of circles of each candidate test in the largest campaign to judge.

        It is the best campaign of the family with 40 circles or with as many as the machine time
        allows. The result is None if these are no more than ``missed``, or if the goals would be
        missed with so little time even if the hyper-parameters were known. ``is_too_long`` is set
        to true if the machine time allows fewer than 40 circles.
        """
        for circles in range(_MOST_CIRCLES, missed, -1):
            if self._costs.fits(family.least_minutes(self._costs, circles)):
                counts = family.best_counts(circles)
                if self._costs.fits(family.minutes(self._costs, family.tests_of(counts))):
                    is_far = family.quick.distance(counts) > _NEAR
                    return None if is_far and circles < _MOST_CIRCLES else counts
            self.is_too_long = True
        return None

    def _confirmed(self, campaign: JudgedCampaign) -> JudgedCampaign | None:
        """Return a campaign judged on fresh machines too, or None if it misses the goals.

        The result is None if the campaign misses the goals on the machines on which it was judged
        so far, or on these and the fresh machines together. The campaign is then stored as
        ``nearest`` if it is better than the one stored before.
        """
        if not self._is_met(campaign):
            self._keep_nearest(campaign)
            return None
        self.effort += len(campaign.tests) ** 2
        judged_again = judged_on_fresh_machines(campaign)
        if not self._is_met(judged_again):
            self._keep_nearest(judged_again)
            return None
        return judged_again

    def _forecast_fully(self, progress: _Progress, counts: Array) -> JudgedCampaign:
        """Return a campaign with its full forecast, and update ``progress``.

        The function stores in ``progress`` how much larger the uncertainties of the full forecast
        are than those of the quick forecast, which takes the hyper-parameters as known. ``counts``
        is the campaign's number of circles of every candidate test.
        """
        progress.forecasts += 1
        campaign = judge_plan(progress.family, progress.family.tests_of(counts))
        self.effort += len(campaign.tests) ** 2
        self._store_inflation(progress, campaign, counts)
        return campaign

    def _with_fewer_circles(self, progress: _Progress, campaign: JudgedCampaign) -> JudgedCampaign:
        """Return ``campaign``, or a campaign with fewer circles that also meets the goals.

        Circles are removed one by one as long as the campaign still meets the goals. ``progress``
        is updated after every full forecast.
        """
        family = progress.family
        best = campaign
        for circles in range(len(campaign.tests) - 1, progress.last_failed, -1):
            counts = family.best_counts(circles)
            tests = family.tests_of(counts)
            if not family.uses_all(tests):
                break
            judged_by_few = judge_plan(family, tests, _FEW_MACHINES)
            if self._share_met(judged_by_few) < self._probability:
                break
            shorter = self._confirmed(self._forecast_fully(progress, counts))
            if shorter is None:
                break
            best = shorter
        return best

    def _store_inflation(
        self, progress: _Progress, campaign: JudgedCampaign, counts: Array
    ) -> None:
        """Store how much larger the uncertainties are in the full forecast than in the quick one.

        `_expected_inflation` states the formula. Its coefficient ``progress.inflation`` is computed
        from both forecasts of ``campaign``. ``counts`` is the campaign's number of circles of every
        candidate test.
        """
        added = self._inflation_of(campaign, counts) - progress.lasting_inflation
        progress.inflation = max(added, 0.0) * len(campaign.tests)
        self._inflation = min(self._inflation, progress.inflation)

    def _expected_inflation(self, progress: _Progress) -> float:
        """Return the expected logarithm of a ratio of uncertainties, ln(u_full / u_quick).

        The quick forecast assumes that the hyper-parameters are known. In the full forecast, more
        circles determine them better. The logarithm is therefore assumed to be a constant plus a
        term that is inversely proportional to the number of circles. Both are estimated from the
        forecasts of earlier campaigns; ``progress`` holds them.
        """
        inflation = progress.inflation
        if inflation is None:
            inflation = 0.0 if np.isinf(self._inflation) else self._inflation
        return progress.lasting_inflation + inflation / progress.circles


def _least_multiple(family: CampaignFamily, counts: Array, distance: float) -> float:
    """Return the smallest factor by which a campaign must be enlarged so that it meets the goals.

    ``counts`` holds the number of circles of each candidate test in the campaign. All these numbers
    are multiplied by the factor; the products need not be whole. ``family`` holds the goals for
    uncertainties. They count as met if the quick forecast (with known hyper-parameters) states a
    distance from the goals of at most ``distance``. The distance is about ln(u/u*), where u is the
    standard uncertainty, and u* the largest that the goal permits.
    """
    low = -np.log(_CIRCLES_OF_SHARES)
    high = np.log(_MOST_CIRCLES / _CIRCLES_OF_SHARES)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if family.quick.distance(counts * np.exp(middle)) > distance:
            low = middle
        else:
            high = middle
    return float(np.exp(high))
