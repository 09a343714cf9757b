"""Priors with means: densities, draws and the estimate of compliance against the dense oracle and
closed forms; in what is made of a model: identifiability, plans, comparison, texts."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from campaigns import oracle_of, plan, refuses, simulated
from scipy import stats

import ldbb_bayes as lb
from ldbb_bayes.analysis.design.analysis_model import analysis_model
from ldbb_bayes.analysis.design.space import Space
from ldbb_bayes.analysis.design.states import states_before
from ldbb_bayes.errors import InputError
from ldbb_bayes.model.specification import model_from_toml, model_sha256, model_to_toml
from ldbb_bayes.report.figures import forest, prior_and_posterior
from ldbb_bayes.report.figures.style import FAINT
from ldbb_bayes.report.fit_record import full_result
from ldbb_bayes.report.fit_tables import parameter_table

PRIORS = {
    "C_XXX": (5.1e-5, 4e-6),
    "C_YYY": (4.6e-5, 8e-6),
    "C_CXY": (-2e-8, 3e-8),
    "E_YY1": (-5e-5, 4e-5),
}
MEANS = {name: mean for name, (mean, _) in PRIORS.items()}
CLOSE = {"C_XXX": (3e-6, 4e-6), "C_YYY": (-2e-6, 8e-6), "C_CCY": (1e-9, 1e-9)}


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_conditional_and_evidence_are_the_oracles(degree: int) -> None:
    campaign = simulated(plan((30, 26, 40, 28), arc_deg=250.0, work_deg=20.0))
    bound = lb.HybridModel.first(degree).with_prior(PRIORS).bind(campaign)
    dense = oracle_of(campaign, degree, given_priors=PRIORS)
    np.testing.assert_allclose(bound.prior_mean, dense.mean, rtol=1e-15)
    np.testing.assert_allclose(bound.prior_sd, dense.sd, rtol=1e-12)
    for phi in np.array([[3e-4, 5e-4, 2e-4, 2e-3], [1e-3, 2e-3, 1e-3, 8e-3]]):
        log_evidence, conditional = bound.given(phi[None])
        expected, mean, covariance = dense.given(phi)
        assert log_evidence[0] == pytest.approx(expected, abs=1e-6)
        np.testing.assert_allclose(conditional.mean[0] / dense.sd, mean / dense.sd, atol=1e-7)
        difference = conditional.covariance[0] - covariance
        np.testing.assert_allclose(difference / np.outer(dense.sd, dense.sd), 0.0, atol=1e-8)
        beta = mean + dense.sd
        log_likelihood = bound.log_likelihood(phi[None], beta[None])[0]
        assert log_likelihood == pytest.approx(dense.log_likelihood(phi, beta), rel=1e-8)


def test_probability_of_the_truncation_of_constant_compliances() -> None:
    """One normal each."""
    constant = lb.HybridModel.first(0).with_prior(CLOSE).bind(plan())
    expected = sum(stats.norm.logcdf(mean / sd) for mean, sd in CLOSE.values())
    assert constant.parameter_prior.normalisation.log_value == pytest.approx(expected, abs=1e-9)


def test_probability_of_the_truncation_of_linear_compliances() -> None:
    """C at both ends of force, two correlated normals each."""
    linear = lb.HybridModel.first(1).with_prior(CLOSE).bind(plan())
    usual = {"C_XXX": 1e-4, "C_YYY": 1e-4, "C_CCY": 1e-9}
    total = 0.0
    for name, (mean, sd) in CLOSE.items():
        slope = 0.3 * usual[name] / 706.0 * 353.0
        covariance = sd**2 + slope**2 * np.array([[1.0, -1.0], [-1.0, 1.0]])
        law = stats.multivariate_normal([-mean, -mean], covariance, allow_singular=True)
        total += law.logcdf([0.0, 0.0])
    assert linear.parameter_prior.normalisation.log_value == pytest.approx(total, abs=1e-5)


def test_probability_of_a_truncation_that_is_nearly_certain() -> None:
    far_from_zero = {name: (20.0 * sd, sd) for name, (_, sd) in CLOSE.items()}
    certain = lb.HybridModel.first(0).with_prior(far_from_zero).bind(plan())
    expected = 3.0 * stats.norm.logcdf(20.0)
    assert certain.parameter_prior.normalisation.log_value == pytest.approx(
        expected, rel=1e-6, abs=0.0
    )


@pytest.mark.parametrize("truncated", [True, False])
def test_draws_follow_the_prior(truncated: bool, rng: np.random.Generator) -> None:
    model = lb.HybridModel.first(0).with_prior(CLOSE)
    if not truncated:
        model = model.without("truncation")
    bound = model.bind(plan())
    draws = bound.parameter_prior.draw(4000, rng)
    for name, prior_sd, values in zip(bound.names, bound.prior_sd, draws.T, strict=True):
        mean, sd = CLOSE.get(name, (0.0, prior_sd))
        low = -np.inf
        if truncated and name in CLOSE:
            low = -mean / sd
        law = stats.truncnorm(low, np.inf)
        assert stats.kstest((values - mean) / sd, law.cdf).pvalue > 1e-4, name


def test_slopes_keep_their_scale_beside_a_mean() -> None:
    """An override alone says how large a compliance may be, and its slope with it; beside a mean,
    how well it is known."""
    model = lb.HybridModel.first(1)
    narrow = replace(model, prior=replace(model.prior, overrides={"C_XXX": 4e-6})).bind(plan())
    measured = model.with_prior({"C_XXX": (0.0, 4e-6)}).bind(plan())
    places = [narrow.names.index(name) for name in ("C_XXX", "C_XXX_1")]
    np.testing.assert_allclose(narrow.prior_sd[places], [4e-6, 0.3 * 4e-6 / 706.0])
    np.testing.assert_allclose(measured.prior_sd[places], [4e-6, 0.3 * 1e-4 / 706.0])


def test_means_stay_with_the_model() -> None:
    model = lb.HybridModel.first(1).with_prior(PRIORS)
    for other in (
        model.with_degree(0),
        model.with_degree(2),
        model.with_slope_scale(0.5),
        model.without("truncation", "mount"),
    ):
        assert dict(other.prior.means) == MEANS
    assert dict(model.fixing("C_CXY").prior.means) == MEANS | {"C_CXY": 0.0}
    assert pickle.loads(pickle.dumps(model)) == model
    with pytest.raises(TypeError):
        model.prior.means["C_XXX"] = 0.0  # type: ignore[index]


def test_toml_both_ways() -> None:
    model = lb.HybridModel.first(1).with_prior(PRIORS)
    text = model_to_toml(model)
    assert "[prior.means]\nC_XXX = 5.1e-05" in text
    assert model_from_toml(text) == model
    assert "means" not in model_to_toml(lb.HybridModel.first(1))


def test_a_digest_tells_models_with_means_from_those_without() -> None:
    model = lb.HybridModel.first(1).with_prior(PRIORS)
    without_means = replace(model, prior=replace(model.prior, means={}))
    assert model_sha256(model) != model_sha256(without_means)


OVERRIDDEN = replace(lb.Prior.first(), overrides={"C_XXX": 1e-5})


@pytest.mark.parametrize(
    ("model", "digest"),
    [
        (
            lb.HybridModel.first(1),
            "17c5304c3ff51f437b812fc393500f9dbbf841fa81312a7c2e49e46161726e35",
        ),
        (
            lb.HybridModel.paper(0),
            "f6ebc15be3b03d018c48b292b3d5d4b3105472198d2a8409adcde005305585e9",
        ),
        (
            lb.HybridModel(0, prior=OVERRIDDEN).fixing("E_C0YX"),
            "9b9a2f6f01daf51b7addafa9524378a6efcc38c6ac62331af64774d96d9246dd",
        ),
    ],
)
def test_digests_stay_as_they_were_before_means(model: lb.HybridModel, digest: str) -> None:
    assert model_sha256(model) == digest


def test_estimate_of_compliance_where_readings_do_not_tell() -> None:
    """A plan's is the prior mean; at one force the readings leave compliance and geometry open
    between them."""
    priors = {"C_XXX": (5.1e-5, 4e-6), "C_CXY": (-2e-8, 3e-8)}
    model = lb.HybridModel.first(0).with_prior(priors)
    planned = model.bind(plan())
    expected = {
        "C_XXX": 5.1e-5,
        "C_XYX": 0.0,
        "C_YYY": 5e-5,
        "C_CXY": -2e-8,
        "C_CYY": 0.0,
        "C_CCY": 0.0,
    }
    labels = [name.label for name in planned.compliances]
    assert dict(zip(labels, planned.setting.compliance_estimate, strict=True)) == expected
    np.testing.assert_array_equal(planned.least_squares_estimate, planned.prior_mean)
    campaign = (
        lb.HybridModel.first(0)
        .simulate(
            plan((60,), forces_N=(400.0,)),
            seed=1,
            parameters={"C_XXX": 5.1e-5, "C_CXY": -2e-8},
            hyper_um=dict.fromkeys(("sigma", "delta", "kappa", "tau"), 1e-6),
        )
        .campaign
    )
    index = labels.index("C_XXX")
    with_means = model.bind(campaign).setting.compliance_estimate[index]
    without_means = lb.HybridModel.first(0).bind(campaign).setting.compliance_estimate[index]
    assert abs(with_means - 5.1e-5) < 0.05 * abs(without_means - 5.1e-5)


def test_models_that_cannot_be() -> None:
    model = lb.HybridModel.first(1).with_prior(PRIORS)
    with pytest.raises(
        InputError,
        match=r"E_YY1 must be fixed at zero or have a prior mean, got both \(-5e-05\)\. Remove one",
    ):
        replace(model, fixed=("E_YY1",))
    with pytest.raises(
        InputError, match=r"C_XXX must be fixed at zero or have a prior mean, got both"
    ):
        model_from_toml("schema = 1\nfixed = ['C_XXX']\n[prior.means]\nC_XXX = 1e-5\n")
    refuses(
        r"prior means must be a dict, got 1\.0",
        model_from_toml,
        "schema = 1\n[prior]\nmeans = 1.0\n",
    )
    with pytest.raises(
        InputError, match=r"prior mean must be one of C_XXX, .*, got 'C_XXY'\. Did you mean 'C_XYX'"
    ):
        replace(model, prior=replace(model.prior, means={"C_XXY": 1e-5})).bind(plan())


# ---- in what is made of a model

OTHERS = {name: PRIORS[name] for name in ("C_XXX", "C_YYY", "E_YY1")}
SMALL = plan((30, 30, 30), forces_N=(36.0, 400.0, 742.0))


def test_identifiability_compares_with_the_prior_about_its_mean() -> None:
    model = lb.HybridModel.first(1).with_prior(OTHERS)
    planned = lb.identify(model, SMALL)
    measured = lb.identify(model, simulated(SMALL))
    for identifiability in (planned, measured):
        for name, entry in identifiability.parameters.items():
            mean, sd = OTHERS.get(name, (0.0, entry.prior_sd))
            assert (entry.prior_mean, entry.prior_sd) == (mean, sd)
            assert entry.as_dict()["prior_mean"] == mean
    assert planned.parameters["C_XXX"].mean == 5.1e-5
    axes = prior_and_posterior(measured).axes[0]
    grey = axes.collections[0].get_paths()[0].vertices
    line = axes.lines[0]
    assert grey[np.argmax(grey[:, 1]), 0] == pytest.approx(5.1e-5 * 1e6, abs=0.2)
    assert len(line.get_xdata()) > 100


def test_plans_start_from_the_means() -> None:
    model = lb.HybridModel.first(1).with_prior(OTHERS)
    states = states_before(model, SMALL, 64, 1, augment=False)
    bound = model.bind(SMALL)
    prior_means = np.tile(bound.prior_mean, (len(states.phi), 1))
    np.testing.assert_array_equal(states.before.mean, prior_means)
    distance = np.abs((states.beta - bound.prior_mean) / bound.prior_sd)
    index = [bound.names.index(name) for name in OTHERS]
    assert distance[:, index].max() < 5.0
    smaller = replace(SMALL, tests=SMALL.tests[:2])
    space = Space(model, SMALL, (36.0, 400.0))
    two_tests = analysis_model(space, smaller.tests).bind(smaller)
    np.testing.assert_array_equal(two_tests.prior_mean, bound.prior_mean)
    np.testing.assert_allclose(two_tests.prior_sd, bound.prior_sd)


@pytest.mark.parametrize(
    ("model", "means", "sds", "centred_on_the_mean"),
    [
        (lb.HybridModel.first(0).with_prior(OTHERS), ["51.0", "0"], ["4", "10"], True),
        (lb.HybridModel.first(0), ["0", "0"], ["100", "10"], False),
    ],
)
def test_texts_and_figures_show_mean_and_sd(
    model: lb.HybridModel, means: list[str], sds: list[str], centred_on_the_mean: bool
) -> None:
    rule = lb.inference.StoppingRule(ess=100.0)
    tree = lb.sample(model, simulated(SMALL), sampler="independent", seed=1, rule=rule)
    table = parameter_table(full_result(tree, 0.95))
    columns = {}
    for head, *cells in zip(table.heads, *table.rows, strict=True):
        columns[head] = list(cells)
    assert columns.get("prior mean", ["0", "0"])[:2] == means
    assert columns["prior sd"][:2] == sds
    axes = forest(tree).axes[0]
    assert axes.get_xlabel() == "value (nm/N)"
    faint = next(line for line in axes.lines if line.get_color() == FAINT)
    centre = np.mean(faint.get_xdata())
    assert (centre == pytest.approx(51.0, abs=1.5)) == centred_on_the_mean


def test_a_prior_that_the_readings_contradict_is_named() -> None:
    for mean, named in ((5.1e-5, []), (3e-4, ["C_XXX"])):
        model = lb.HybridModel.first(0).with_prior(C_XXX=(mean, 2e-5))
        rule = lb.inference.StoppingRule(ess=100.0)
        tree = lb.sample(model, simulated(SMALL), sampler="independent", seed=1, rule=rule)
        table = lb.summarize(tree)
        concerns = [concern for concern in table.attrs["fit"].concerns if concern.kind == "prior"]
        assert [concern.name for concern in concerns] == named
        assert ("contradict the prior of C_XXX" in str(lb.report.describe_fit(tree))) == bool(named)
    row = table.loc["C_XXX"]
    expected = (row["prior_mean"] - row["mean"]) / np.sqrt(row["prior_sd"] ** 2 - row["sd"] ** 2)
    assert concerns[0].value == pytest.approx(expected, rel=1e-3)


@pytest.mark.slow
def test_calibrated_and_a_missed_mean_is_seen() -> None:
    """Ranks of truths drawn from priors with means: uniform where the same means are believed, at
    an end where none are."""
    model = lb.HybridModel.first(0).without("mount", "force-error", "bar-length").with_prior(OTHERS)
    zero_means = replace(model.prior, means=dict.fromkeys(OTHERS, 0.0))
    blind = replace(model, prior=zero_means)
    planned = plan((30, 30), forces_N=(100.0, 600.0))
    right = lb.calibrate(model, planned, replicates=20, draws=19, seed=1)
    assert not right.outside
    wrong = lb.calibrate(blind, planned, replicates=10, draws=19, generator=model, seed=1)
    assert "C_XXX" in wrong.outside
