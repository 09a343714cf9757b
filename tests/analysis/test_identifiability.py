"""Verdicts and confounding fractions."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from campaigns import oracle_of, plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.analysis.identifiability import confounding_fractions
from ldbb_bayes.inference.ensemble import StoppingRule

PHI = np.array([0.3e-3, 0.5e-3, 0.3e-3, 2e-3])
TERMS = {"BallForm": "form", "BarLength": "length", "Mount": "mount"}


@pytest.mark.parametrize("planned", [plan(), plan(work_deg=40.0), plan((9, 40, 12, 30), arc_deg=220.0)])
@pytest.mark.parametrize("term", TERMS)
def test_confounding_fraction_by_the_oracle(planned: lb.Campaign, term: str) -> None:
    """1 − Var(β | y, g) / Var(β | y): knowing a zero-mean term is leaving it out of the covariance."""
    campaign = simulated(planned)
    bound, oracle = lb.HybridModel.default(1).bind(campaign), oracle_of(campaign, 1)
    every = np.diag(oracle.given(PHI)[2])
    value = dict(zip(oracle.hypers, PHI, strict=True))
    if term == "BallForm":
        value["tau"] = 0.0
        known = np.diag(oracle.given(np.array([value[h] for h in oracle.hypers]))[2])
    else:
        terms = tuple(t for t in ("form", "length", "mount", "force", "setup", "discrepancy") if t != TERMS[term])
        known = np.diag(oracle_of(campaign, 1, terms=terms).given(PHI)[2])
    found = confounding_fractions(bound, PHI)
    np.testing.assert_allclose([found[name][term] for name in bound.names], np.clip(1.0 - known / every, 0.0, 1.0), atol=1e-6)


def test_verdicts_on_the_recovered_experiment(recovered: lb.Campaign) -> None:
    tree = lb.sample(lb.HybridModel.default(1), recovered, rule=StoppingRule(ess=300.0, lengths=1.0))
    found = lb.verdicts(tree)
    for name in ("E_YX2", "E_XY2", "E_C0YX"):
        assert (found[name].word, found[name].partners) == ("aliased", ("BallForm",))
        assert re.fullmatch(r"aliased with ball form \(\d\d %\)", found[name].text)
    for name in ("E_XX1", "E_YY1"):
        assert found[name].word == "aliased"
        assert "BarLength" in found[name].partners
    assert found["C_XYX"].text == "known from the readings"
    assert "Mount" in found["C_XXX"].partners
    assert found["C_CXY"].confounding["BallForm"] < 0.2
    assert 0.0 < found["C_XXX"].contraction < 1.0


def test_what_the_prior_decides_is_called_so() -> None:
    """A prior far narrower than the readings can tell leaves nothing to them."""
    model = replace(lb.HybridModel.default(0), prior=replace(lb.Prior.default(), cross_mm_per_N=1e-8))
    tree = lb.sample(model, simulated(plan()), rule=StoppingRule(ess=300.0, lengths=1.0))
    verdict = lb.verdicts(tree)["C_XYX"]
    assert (verdict.word, verdict.text) == ("prior-limited", "mostly the prior")
    assert verdict.contraction < 0.2


def test_a_term_left_out_bounds_nothing() -> None:
    tree = lb.sample(lb.HybridModel.default(0).without("ball-form"), simulated(plan()), rule=StoppingRule(ess=300.0, lengths=1.0))
    assert lb.verdicts(tree)["E_C0YX"].text == "aliased with ball form (left out)"
