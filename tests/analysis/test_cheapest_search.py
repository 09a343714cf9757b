"""The search for the cheapest campaigns, against searches of one family and all small campaigns."""

from __future__ import annotations

from itertools import combinations_with_replacement

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.analysis.design import Costs, goals_in, minutes_of
from ldbb_bayes.analysis.design.campaign_family import CampaignFamily
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
    found = lb.design(MODEL, PILOT, goals=goals, certificates=prices, directions=("CW", "CCW"))
    alone = lb.design(
        MODEL,
        PILOT,
        goals=goals,
        certificates={"balls G10": 10.0},
        clockings_deg=(UNTURNED,),
        directions=("CW", "CCW"),
    )
    assert alone.best.certificates == ("balls of grade G10",)
    assert found.plans[0].price < alone.best.price <= found.plans[2].price
    assert alone.best.price in [plan.price for plan in found.plans]
