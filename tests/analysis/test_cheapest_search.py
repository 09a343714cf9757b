"""The search for the cheapest campaigns, against searches of one family and all small campaigns."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations_with_replacement
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.analysis.design import Costs, cheapest_search, goals_in, minutes_of
from ldbb_bayes.analysis.design.campaign_family import CampaignFamily
from ldbb_bayes.analysis.design.judged_campaigns import JudgedCampaign
from ldbb_bayes.analysis.design.space import Space
from ldbb_bayes.analysis.design.states import states_before

MODEL = lb.HybridModel.default(1)
PILOT = lb.read_campaign(lb.embedded_campaign())
ANGLE_DEG = np.arange(0.0, 360.0, 30.0)
UNTURNED = (0.0, 0.0)
TURNED = (45.0, 45.0)


def family_in_two_planes(radii_mm: tuple[float, ...]) -> CampaignFamily:
    """Campaigns in XY and YZ with turned and unturned balls, for a goal of XY alone."""
    tests = []
    for setup, plane in enumerate(("XY", "YZ"), start=1):
        for force_N in (100.0, 600.0):
            tests.append(lb.CircularTest(force_N, ANGLE_DEG, plane=plane, setup=setup))
    space = Space(
        model=MODEL,
        pilot=lb.Campaign(tuple(tests), topology="wXFYZSt"),
        forces_N=(100.0,),
        clockings_deg=(UNTURNED, TURNED),
        radii_mm=radii_mm,
        parameters=("E_C0XY",),
    )
    states = states_before(MODEL, space.pilot, 4, 1, augment=False)
    return CampaignFamily(space, (), goals_in(space.bound, {"E_C0XY": "45 µrad"}), states)


@pytest.mark.parametrize("radii_mm", [(150.0,), (150.0, 100.0)])
@pytest.mark.parametrize("minutes_per_clocking", [2.0, 40.0])
@pytest.mark.parametrize("circles", [2, 3, 4])
def test_the_least_minutes_are_those_of_the_shortest_of_all_campaigns(
    radii_mm: tuple[float, ...], minutes_per_clocking: float, circles: int
) -> None:
    """No plane need be run that no goal needs: a campaign may keep to one set-up."""
    family = family_in_two_planes(radii_mm)
    costs = Costs(minutes_per_clocking=minutes_per_clocking)
    minutes = []
    for tests in combinations_with_replacement(family.space.tests, circles):
        if family.uses_all(tests):
            minutes.append(minutes_of(costs, tests))
    assert family.least_minutes(costs, circles) == min(minutes)


@pytest.mark.slow
def test_no_family_has_a_cheaper_campaign_than_those_that_are_shown() -> None:
    """Balls of grade G10 that are not turned: a search of this family alone finds its price."""
    goals = {"C_XXX": "9 nm/N", "E_C0YX": "6 µrad"}
    prices = {"mount": 10.0, "balls G10": 10.0}
    design = lb.design(MODEL, PILOT, goals=goals, certificates=prices, directions=("CW", "CCW"))
    unturned = lb.design(
        MODEL,
        PILOT,
        goals=goals,
        certificates={"balls G10": 10.0},
        clockings_deg=(UNTURNED,),
        directions=("CW", "CCW"),
    )
    assert unturned.best.certificates == ("balls of grade G10",)
    assert design.plans[0].price < unturned.best.price <= design.plans[2].price
    assert unturned.best.price in [plan.price for plan in design.plans]


@dataclass(frozen=True)
class FamilyOfOneNumber:
    """Stand-in for campaigns that need a number of circles, of a minute and a price of 1 each.

    Before any campaign is found, this number and some more are skipped, as if their forecasts were
    expected to be poor.
    """

    names: tuple[str, ...]
    needed: int
    skipped: int = 0
    certificates_price: float = 1.0
    fewest_circles = 1
    space = SimpleNamespace(tests=(None,))

    @property
    def offers(self) -> list[Any]:
        return [SimpleNamespace(name=name) for name in self.names]

    def least_minutes(self, costs: Costs, circles: int) -> float:
        return float(circles)

    def lowest_price(self, costs: Costs, circles: int) -> float:
        return circles + self.certificates_price * len(self.names)

    def minutes(self, costs: Costs, tests: tuple[Any, ...]) -> float:
        return float(len(tests))

    def price(self, costs: Costs, tests: tuple[Any, ...]) -> float:
        return self.lowest_price(costs, len(tests))


class SearchOfOneNumbers:
    """Stand-in for the search in `FamilyOfOneNumber`."""

    def __init__(self, *_: Any) -> None:
        self.effort = 0
        self.is_too_long = False
        self.nearest = None
        self.nearest_by_goal: dict[str, Any] = {}
        self.has_found = False

    def start(self, progress: Any) -> bool:
        progress.started = True
        progress.first = progress.circles
        return True

    def attempt(self, progress: Any) -> Any:
        family = progress.family
        if progress.circles < family.needed:
            progress.last_failed = progress.circles
            return None
        if not self.has_found and progress.circles < family.needed + family.skipped:
            return None
        self.has_found = True
        tests = (None,) * family.needed
        return JudgedCampaign(family, tests, *(None,) * 3)  # type: ignore[arg-type]


def searched(monkeypatch: pytest.MonkeyPatch, *families: FamilyOfOneNumber) -> list[Any]:
    """Return the certificates and circles of the cheapest campaigns, at most two."""
    monkeypatch.setattr(cheapest_search, "_Search", SearchOfOneNumbers)
    monkeypatch.setattr(cheapest_search, "_with_more_circles", lambda *_: [])
    steps: list[int] = []
    cheapest = cheapest_search.find_cheapest(
        families,  # type: ignore[arg-type]
        {},
        Costs(),
        0.9,
        2,
        on_campaign=lambda: steps.append(1),
    )
    assert len(steps) <= 2
    return [(campaign.family.names, len(campaign.tests)) for campaign in cheapest.campaigns]


def test_a_certificate_found_before_the_campaign_that_needs_none_is_left_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Balls alone need 5 circles, which were skipped; mount and balls need 5 as well."""
    balls = FamilyOfOneNumber(("balls",), 5, skipped=10)
    both = FamilyOfOneNumber(("balls", "mount"), 5, certificates_price=0.75)
    nothing = FamilyOfOneNumber((), 20)
    assert searched(monkeypatch, balls, both, nothing) == [(("balls",), 5), ((), 20)]


@pytest.mark.parametrize("seed", range(20))
def test_the_two_cheapest_are_found_whatever_is_skipped(
    monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    families = []
    for k in range(6):
        needed = int(rng.integers(2, 30))
        families.append(FamilyOfOneNumber((f"c{k}",), needed, int(rng.integers(10))))
    cheapest = sorted(family.needed for family in families)[:2]
    campaigns = searched(monkeypatch, *families)
    assert [circles for _, circles in campaigns] == cheapest
