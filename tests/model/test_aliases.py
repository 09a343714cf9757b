"""Exact aliases of the measurement model: which nuisances look exactly like which parameters."""

from __future__ import annotations

from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.model.aliases import exact_aliases


def found(campaign: Campaign, degree: int = 1) -> dict[str, set[str]]:
    aliases: dict[str, set[str]] = {}
    for alias in exact_aliases(lb.HybridModel.default(degree).bind(campaign)):
        for nuisance in alias.nuisances:
            aliases[nuisance] = set(alias.parameters)
    return aliases


def test_recovered_experiment(recovered: Campaign) -> None:
    aliases = found(recovered)
    assert aliases == {
        "form_cos2": {"E_XX1", "E_YY1"},
        "form_sin2": {"E_C0YX"},
        "form_cos3": {"E_XY2", "E_Xt0"},
        "form_sin3": {"E_YX2", "E_Yt0"},
        "bar_length": {"E_XX1", "E_YY1"},
        "mount": {"C_XXX", "C_YYY"},
        "force_gain": {"C_XXX", "C_YYY", "C_CXY", "C_CYY", "C_CCY"},
    }
    assert found(recovered, 0).keys() == aliases.keys()


def test_four_lobes_are_separated_by_force_only(recovered: Campaign) -> None:
    assert "form_cos4" not in found(recovered)
    one = simulated(plan((40,), forces_N=(300.0,)))
    assert found(one, 0)["form_cos4"] >= {"C_CCY"}


def test_a_plan_is_enough() -> None:
    assert "bar_length" in found(plan())


def test_statements_name_the_partner_and_the_cure(recovered: Campaign) -> None:
    statements = [alias.statement for alias in exact_aliases(lb.HybridModel.default(1).bind(recovered))]
    assert "BarLength (bar_length) looks exactly like E_XX1, E_YY1 here. Calibrate the bar's length." in statements
