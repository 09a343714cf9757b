"""Priors with means in what is made of a model: identifiability, plans, comparison, calibration, texts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaigns import plan, simulated, with_priors

import ldbb_bayes as lb
from ldbb_bayes.analysis.candidates import Space, states_before
from ldbb_bayes.analysis.design import _model_of
from ldbb_bayes.report.figures import forest, prior_and_posterior
from ldbb_bayes.report.figures.style import FAINT
from ldbb_bayes.report.findings import full_result
from ldbb_bayes.report.text import parameter_table

PRIORS = {"C_XXX": (5.1e-5, 4e-6), "C_YYY": (4.6e-5, 8e-6), "E_YY1": (-5e-5, 4e-5)}
SMALL = plan((30, 30, 30), forces_N=(36.0, 400.0, 742.0))


def test_identifiability_compares_with_the_prior_about_its_mean() -> None:
    model = with_priors(lb.HybridModel.first(1), PRIORS)
    planned, measured = lb.identify(model, SMALL), lb.identify(model, simulated(SMALL))
    for found in (planned, measured):
        for name, entry in found.parameters.items():
            mean, sd = PRIORS.get(name, (0.0, entry.prior_sd))
            assert (entry.prior_mean, entry.prior_sd) == (mean, sd)
            assert entry.as_dict()["prior_mean"] == mean
    assert planned.parameters["C_XXX"].mean == 5.1e-5
    axes = prior_and_posterior(measured).axes[0]
    grey, line = axes.collections[0].get_paths()[0].vertices, axes.lines[0]
    assert grey[np.argmax(grey[:, 1]), 0] == pytest.approx(5.1e-5 * 1e6, abs=0.2)
    assert len(line.get_xdata()) > 100


def test_plans_start_from_the_means() -> None:
    model = with_priors(lb.HybridModel.first(1), PRIORS)
    known = states_before(model, SMALL, 64, 1, augment=False)
    bound = model.bind(SMALL)
    np.testing.assert_array_equal(known.before.mean, np.tile(bound.prior_mean, (len(known.phi), 1)))
    far = np.abs((known.beta - bound.prior_mean) / bound.prior_sd)[:, [bound.names.index(name) for name in PRIORS]]
    assert far.max() < 5.0
    alone = _model_of(Space(model, SMALL, (36.0, 400.0)), SMALL.tests[:2]).bind(replace(SMALL, tests=SMALL.tests[:2]))
    np.testing.assert_array_equal(alone.prior_mean, bound.prior_mean)
    np.testing.assert_allclose(alone.prior_sd, bound.prior_sd)


def test_texts_and_figures_show_mean_and_sd() -> None:
    model, rule = lb.HybridModel.first(0), lb.StoppingRule(ess=100.0)
    for own in (with_priors(model, PRIORS), model):
        tree = lb.sample(own, simulated(SMALL), sampler="independent", seed=1, rule=rule)
        meant = own is not model
        table = parameter_table(full_result(tree, 0.95)).frame().to_dict("list")
        assert table.get("prior mean", ["0", "0"])[:2] == (["51.0", "0"] if meant else ["0", "0"])
        assert table["prior sd"][:2] == (["4", "10"] if meant else ["100", "10"])
        axes = forest(tree).axes[0]
        assert axes.get_xlabel() == "value (nm/N)"
        faint = next(line for line in axes.lines if line.get_color() == FAINT)
        assert (np.mean(faint.get_xdata()) == pytest.approx(51.0, abs=1.5)) == meant


@pytest.mark.slow
def test_calibrated_and_a_missed_mean_is_seen() -> None:
    """Ranks of truths drawn from priors with means: uniform where the same means are believed, at an end where none are."""
    model = with_priors(lb.HybridModel.first(0).without("mount", "force-error", "bar-length"), PRIORS)
    blind = replace(model, prior=replace(model.prior, means=dict.fromkeys(PRIORS, 0.0)))
    planned = plan((30, 30), forces_N=(100.0, 600.0))
    right = lb.validate(model, planned, replicates=20, draws=19, seed=1)
    assert not right.outside
    wrong = lb.validate(blind, planned, replicates=10, draws=19, generator=model, seed=1)
    assert "C_XXX" in wrong.outside
