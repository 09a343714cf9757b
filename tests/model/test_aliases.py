"""Exact aliases of the measurement model: which nuisances look exactly like which parameters."""

from __future__ import annotations

from dataclasses import replace

from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.model.aliases import degeneracies, exact_aliases


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
    assert degeneracies(lb.HybridModel.default(1).bind(recovered)) == (
        "Ball form looks exactly like E_XX1 and E_YY1 in cos 2θ; like E_C0YX in sin 2θ; like E_XY2 and E_Xt0 in cos 3θ; "
        "like E_YX2 and E_Yt0 in sin 3θ: these readings cannot tell them apart. "
        "Clock both balls (not by 180° alone), or measure a second radius.",
        "Bar length looks exactly like E_XX1 and E_YY1: these readings cannot tell them apart. Calibrate the bar's length.",
        "Mount looks exactly like C_XXX and C_YYY: these readings cannot tell them apart. Measure the mount's deflection.",
        "Force error looks exactly like C_XXX, C_YYY, C_CXY, C_CYY, C_CCY: these readings cannot tell them apart. "
        "Calibrate the force.",
        "Friction in the bar or lost motion in proportion to force looks exactly like C_XYX in circles of one direction. "
        "Run both directions.",
        "A curvature in force common to all angles (force law, mount) looks exactly like equal slopes of C_XXX and C_YYY.",
        "C_CCY and the 4-lobe form of the balls are told apart by force alone.",
    )


def test_what_the_model_leaves_out_is_said_too(recovered: Campaign) -> None:
    said = degeneracies(lb.HybridModel.paper(0).bind(recovered))
    assert said[1].startswith("Bar length looks exactly like E_XX1 and E_YY1")
    assert all("The model leaves it out: the intervals do not cover it." in sentence for sentence in said[:4])


def test_a_second_radius_brings_a_second_length() -> None:
    two = plan(work_deg=40.0, tool_deg=-65.0)
    two = replace(two, tests=tuple(replace(t, radius_mm=r) for t, r in zip(two.tests, (150, 100, 150, 100), strict=True)))
    assert "bar lengths in proportion to the radii" in found(two)
