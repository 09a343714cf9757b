"""Priors with means in what is made of a model: identifiability, plans, comparison, calibration, texts."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from campaigns import plan, simulated
from scipy import integrate, stats

import ldbb_bayes as lb
from ldbb_bayes.analysis.comparison import _differing_priors
from ldbb_bayes.analysis.design.candidates import Space
from ldbb_bayes.analysis.design.design import _model_of
from ldbb_bayes.analysis.design.forecast import states_before
from ldbb_bayes.report.figures import forest, prior_and_posterior
from ldbb_bayes.report.findings import full_result
from ldbb_bayes.report.sections import assumptions
from ldbb_bayes.report.text import parameter_table

PRIORS = {"C_XXX": (5.1e-5, 4e-6), "C_YYY": (4.6e-5, 8e-6), "E_YY1": (-5e-5, 4e-5)}
SMALL = plan((30, 30, 30), forces_N=(36.0, 400.0, 742.0))


def with_priors(model: lb.HybridModel) -> lb.HybridModel:
    means, sds = {name: mean for name, (mean, _) in PRIORS.items()}, {name: sd for name, (_, sd) in PRIORS.items()}
    return replace(model, prior=replace(model.prior, means=means, overrides=sds))


def test_identifiability_compares_with_the_prior_about_its_mean() -> None:
    model = with_priors(lb.HybridModel.default(1))
    planned, measured = lb.identify(model, SMALL), lb.identify(model, simulated(SMALL))
    for found in (planned, measured):
        for name, entry in found.parameters.items():
            mean, sd = PRIORS.get(name, (0.0, entry.prior_sd))
            assert (entry.prior_mean, entry.prior_sd) == (mean, sd)
            before, after = stats.norm(mean, sd), stats.norm(entry.mean, entry.sd)
            reach = np.linspace(mean - 9 * sd, mean + 9 * sd, 40_001)
            common = integrate.trapezoid(np.minimum(before.pdf(reach), after.pdf(reach)), reach)
            assert entry.overlap == pytest.approx(common, abs=1e-3), name
            assert entry.as_dict()["prior_mean"] == mean
    assert planned.parameters["C_XXX"].mean == 5.1e-5
    axes = prior_and_posterior(measured).axes[0]
    grey, line = axes.collections[0].get_paths()[0].vertices, axes.lines[0]
    assert grey[np.argmax(grey[:, 1]), 0] == pytest.approx(5.1e-5 * 1e3, abs=2e-4)
    assert len(line.get_xdata()) > 100


def test_plans_start_from_the_means() -> None:
    model = with_priors(lb.HybridModel.default(1))
    known = states_before(model, SMALL, 64, 1, augment=False)
    bound = model.bind(SMALL)
    np.testing.assert_array_equal(known.before.mean, np.tile(bound.prior_mean, (len(known.phi), 1)))
    far = np.abs((known.beta - bound.prior_mean) / bound.prior_sd)[:, [bound.names.index(name) for name in PRIORS]]
    assert far.max() < 5.0
    alone = _model_of(Space(model, SMALL, (36.0, 400.0)), SMALL.tests[:2]).bind(replace(SMALL, tests=SMALL.tests[:2]))
    np.testing.assert_array_equal(alone.prior_mean, bound.prior_mean)
    np.testing.assert_allclose(alone.prior_sd, bound.prior_sd)


def test_different_means_are_told_of_a_comparison() -> None:
    campaign, model = simulated(SMALL), lb.HybridModel.default(0)
    other = replace(with_priors(model), prior=replace(with_priors(model).prior, means={"E_YY1": -5e-5}, overrides={}))
    bounds = [one.bind(campaign) for one in (model, other)]
    assert _differing_priors(bounds) == ("E_YY1",)
    assert _differing_priors([bounds[0], bounds[0]]) == ()


def test_texts_and_figures_show_mean_and_sd() -> None:
    campaign = simulated(SMALL)
    rule = lb.StoppingRule(ess=100.0)
    fitted = lb.sample(with_priors(lb.HybridModel.default(0)), campaign, sampler="independent", seed=1, rule=rule)
    plain = lb.sample(lb.HybridModel.default(0), campaign, sampler="independent", seed=1, rule=rule)
    shown = {}
    for name, tree in (("means", fitted), ("none", plain)):
        table = parameter_table(full_result(tree, 0.95))
        shown[name] = table.frame().to_dict("list")
    assert shown["none"]["prior sd"][:2] == ["0.1", "0.01"]
    prior = dict(zip(shown["means"]["parameter"], shown["means"]["prior"], strict=True))
    assert prior["C_XXX"] == "0.0510 ± 0.0040"
    assert prior["C_CXY"] == "0 ± 100"
    assert prior["tau"].startswith("± ")
    for name, tree, words in (("means", fitted, "about the means below"), ("none", plain, "about zero")):
        found = SimpleNamespace(result=full_result(tree, 0.95), posterior=tree, flat=False)
        paragraph, sheet, _ = assumptions(found)  # type: ignore[arg-type]
        assert f"normal priors {words}, restricted" in paragraph
        assert ("prior mean" in sheet.heads) == (name == "means")
        assert list(sheet.rows[0]) == (["C_XXX", "0.0510", "0.0040", "µm/N"] if name == "means" else ["C_XXX", "0.10", "µm/N"])
    assert forest(fitted).axes[0].get_xlabel() == "(value − prior mean) / prior sd"
    assert forest(plain).axes[0].get_xlabel() == "value / prior sd"


@pytest.mark.slow
def test_calibrated_and_a_missed_mean_is_seen() -> None:
    """Ranks of truths drawn from priors with means: uniform where the same means are believed, at an end where none are."""
    model = with_priors(lb.HybridModel.default(0).without("mount", "force-error", "bar-length"))
    blind = replace(model, prior=replace(model.prior, means=dict.fromkeys(PRIORS, 0.0)))
    planned = plan((30, 30), forces_N=(100.0, 600.0))
    right = lb.validate(model, planned, replicates=20, draws=19, seed=1)
    assert not right.outside
    wrong = lb.validate(blind, planned, replicates=10, draws=19, generator=model, seed=1)
    assert "C_XXX" in wrong.outside
