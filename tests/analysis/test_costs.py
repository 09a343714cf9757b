"""Costs of campaigns: machine time by circles, set-ups and turns of the balls, and prices."""

from __future__ import annotations

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.analysis.design import Costs, minutes_of
from ldbb_bayes.analysis.design.certificate_offers import (
    certified_with,
    offers_in,
    require_missing,
    sets_of_offers,
)
from ldbb_bayes.analysis.design.costs import price_of
from ldbb_bayes.errors import InputError

ANGLES = np.arange(0.0, 360.0, 10.0)


def circle(force_N=100.0, work_ball_deg=0.0, radius_mm=150.0):
    return lb.CircularTest(
        force_N, ANGLES, plane="XY", work_ball_deg=work_ball_deg, radius_mm=radius_mm
    )


def test_circles_of_one_setup_cost_their_minutes_and_one_setup():
    assert minutes_of(Costs(3.0, 15.0, 5.0), [circle(100.0), circle(700.0)]) == 21.0


def test_every_further_clocking_costs_one_turn_whatever_the_order():
    tests = [circle(work_ball_deg=45.0), circle(), circle(work_ball_deg=45.0)]
    assert minutes_of(Costs(3.0, 15.0, 5.0), tests) == 29.0


def test_angles_a_whole_turn_apart_are_one_clocking():
    tests = [circle(), circle(work_ball_deg=360.0)]
    assert minutes_of(Costs(3.0, 15.0, 5.0), tests) == 21.0


def test_every_radius_is_a_setup_in_which_the_balls_start_anew():
    tests = [circle(), circle(work_ball_deg=45.0, radius_mm=100.0)]
    assert minutes_of(Costs(3.0, 15.0, 5.0), tests) == 36.0


def test_price_is_that_of_machine_time_and_certificates():
    assert price_of(Costs(price_per_hour=120.0), 30.0, 300.0) == 360.0


def test_hours_limit_the_machine_time():
    costs = Costs(hours=0.5)
    assert costs.fits(30.0)
    assert not costs.fits(30.1)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"minutes_per_circle": 0.0}, "minutes_per_circle must be above 0"),
        ({"minutes_per_setup": -1.0}, "minutes_per_setup must be a number of at least 0"),
        ({"minutes_per_clocking": np.nan}, "minutes_per_clocking must be a number"),
        ({"price_per_hour": 0.0}, "price_per_hour must be above 0"),
        ({"hours": 0.0}, "hours must be above 0"),
    ],
)
def test_costs_that_make_no_sense_are_refused(values, message):
    with pytest.raises(InputError, match=message):
        Costs(**values)


def test_an_offer_states_fields_of_the_instrument():
    (offer,) = offers_in({"balls G10": 300.0})
    instrument = certified_with(lb.Instrument(), [offer])
    assert instrument.work.stated_sphericity_um == 0.25
    assert instrument.tool.stated_sphericity_um == 0.25


def test_sets_of_offers_hold_every_combination_but_what_is_stated_already():
    offers = offers_in({"balls G10": 300.0, "bar": 150.0, "mount": 100.0})
    sets = sets_of_offers(offers, lb.Instrument(bar_U_um=2.0))
    names = [[offer.name for offer in chosen] for chosen in sets]
    assert names == [
        [],
        ["balls of grade G10"],
        ["mount ± 2 %"],
        ["balls of grade G10", "mount ± 2 %"],
    ]


@pytest.mark.parametrize(
    ("word", "instrument", "message"),
    [
        (
            "balls G10",
            lb.Instrument(work=lb.Ball(grade="G5")),
            "got 'balls of grade G10', and the campaign states the work ball. Offer 'tool ball G10'"
            " instead, or leave this certificate out.",
        ),
        (
            "balls G10",
            lb.Instrument(work=lb.Ball(grade="G5"), tool=lb.Ball(grade="G5")),
            "the campaign states the work ball and the tool ball. Leave this certificate out.",
        ),
        (
            "bar",
            lb.Instrument(bar_U_um=2.0),
            "states the bar's length. Leave this certificate out.",
        ),
    ],
)
def test_an_offer_of_what_is_stated_already_is_refused(word, instrument, message):
    with pytest.raises(InputError) as refusal:
        require_missing(offers_in({word: 300.0}), instrument)
    assert str(refusal.value).endswith(message)


def test_an_offer_of_what_is_missing_is_accepted():
    offers = offers_in({"tool ball G10": 300.0, "bar": 150.0})
    require_missing(offers, lb.Instrument(work=lb.Ball(grade="G5")))


def test_a_set_of_offers_states_nothing_twice():
    offers = offers_in({"balls G10": 300.0, "work ball G5": 200.0})
    assert [len(chosen) for chosen in sets_of_offers(offers, lb.Instrument())] == [0, 1, 1]


@pytest.mark.parametrize(
    ("prices", "message"),
    [
        ({"balls": 300.0}, "must state the grade of the ball"),
        ({"balls G11": 300.0}, "grade of a ball must be one of"),
        ({"bars": 300.0}, "Did you mean 'bar'"),
        ({"bar": -1.0}, "price of certificate 'bar' must be a number of at least 0"),
    ],
)
def test_an_offer_that_makes_no_sense_is_refused(prices, message):
    with pytest.raises(InputError, match=message):
        offers_in(prices)
