"""The models bound last are kept, so that analyses of one campaign share them."""

from __future__ import annotations

from campaigns import plan

import ldbb_bayes as lb

MODEL = lb.HybridModel.first(1)
CAMPAIGN = plan()


def test_a_model_is_bound_to_a_campaign_once() -> None:
    assert MODEL.bind(CAMPAIGN) is lb.HybridModel.first(1).bind(CAMPAIGN)


def test_another_model_is_bound_anew() -> None:
    assert MODEL.with_degree(0).bind(CAMPAIGN).names != MODEL.bind(CAMPAIGN).names


def test_another_campaign_is_bound_anew() -> None:
    assert MODEL.bind(plan()) is not MODEL.bind(CAMPAIGN)
