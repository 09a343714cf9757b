"""The GUM's law of propagation beside distributions: figures of JCGM 101, and known answers."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from campaigns import refuses
from scipy.stats import chi2, truncnorm
from scipy.stats import t as student

import ldbb_bayes as lb
from ldbb_bayes.analysis.gum_validation import agreeing_digits, numerical_tolerance, validate_gum
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.marginal_mixtures import MarginalMixtures, marginal_mixtures
from ldbb_bayes.inference.nodes import compute_nodes
from ldbb_bayes.inference.posterior import bound_of

TAILS = np.array([0.025, 0.975])


@pytest.mark.parametrize(
    ("u", "digits", "tolerance"),
    [
        (0.35, 2, 0.005),  # 35 × 10⁻²
        (0.35, 1, 0.05),
        (2.0, 2, 0.05),  # JCGM 101, 9.2.2
        (0.0754, 1, 0.005),  # JCGM 101, 9.3
        (0.00996, 2, 0.0005),  # rounded, 10 × 10⁻³
        (0.0, 2, 0.0),
    ],
)
def test_numerical_tolerance_is_half_a_unit_of_the_last_digit_of_u(
    u: float, digits: int, tolerance: float
) -> None:
    assert numerical_tolerance(u, digits) == pytest.approx(tolerance)


@pytest.mark.parametrize(
    ("gum", "distribution", "u", "digits"),
    [
        ((-3.92, 3.92), (-3.88, 3.88), 2.0, 2),  # 9.2.3: validated at δ = 0.05
        ((-19.9, 19.9), (-17.0, 17.0), 10.2, 1),  # 9.2.4: not validated at δ = 0.5
        ((1.1285, 1.3395), (1.0834, 1.3825), 0.0754, 0),  # 9.3, first order: not at δ = 0.005
        ((1.0870, 1.3810), (1.0834, 1.3825), 0.0754, 1),  # 9.3, higher order: at δ = 0.005
        ((745.0, 931.0), (745.0, 932.0), 36.0, 1),  # 9.5: not at δ = 0.5
    ],
)
def test_examples_of_jcgm_101_agree_within_as_many_digits_as_the_guide_says(
    gum: tuple[float, float], distribution: tuple[float, float], u: float, digits: int
) -> None:
    distance = float(np.max(np.abs(np.subtract(gum, distribution))))
    assert agreeing_digits(distance, u) == digits


def test_a_mixture_over_the_variance_has_the_quantiles_of_a_t_distribution() -> None:
    degrees = 6.0
    shares = (np.arange(20_000) + 0.5) / 20_000
    sd = np.sqrt(degrees / chi2(degrees).ppf(shares))[:, None]
    beta = np.linspace(-9.0, 9.0, 20_000)[:, None]
    infinite = np.full_like(sd, np.inf)
    mixture = MarginalMixtures(beta, np.zeros_like(sd), sd, -infinite, infinite)
    assert mixture.quantiles(TAILS)[:, 0] == pytest.approx(student(degrees).ppf(TAILS), rel=1e-4)


@pytest.mark.parametrize("bound", [-1.0, 0.5, 8.0, 30.0])
def test_a_truncated_component_has_the_quantiles_of_a_truncated_gaussian(bound: float) -> None:
    one = np.ones((2, 1))
    beta = np.array([[bound], [bound + 5.0]])
    mixture = MarginalMixtures(beta, 0.0 * one, one, bound * one, np.inf * one)
    expected = truncnorm(bound, np.inf).ppf(TAILS)
    assert mixture.quantiles(TAILS)[:, 0] == pytest.approx(expected, abs=1e-9)


@pytest.fixture(scope="module")
def posterior(recovered: lb.Campaign) -> xr.DataTree:
    return lb.sample(lb.HybridModel.first(1), recovered, sampler="independent", seed=3)


def test_mixtures_have_the_quantiles_of_the_nodes(posterior: xr.DataTree) -> None:
    bound = bound_of(posterior)
    mixtures = marginal_mixtures(posterior)
    nodes = compute_nodes(HyperPosterior(bound, truncated=True), 1e-2)
    expected = nodes.quantiles(TAILS, seed=1, components=16_384)
    sd = mixtures.beta.std(axis=0)
    allowed = 4.0 * mixtures.quantile_errors(TAILS) + 0.03 * sd
    assert np.all(np.abs(mixtures.quantiles(TAILS) - expected) < allowed)


def test_mixtures_scatter_less_from_seed_to_seed_than_the_draws(posterior: xr.DataTree) -> None:
    mixtures = marginal_mixtures(posterior)
    batches = mixtures.beta.reshape(15, -1, mixtures.beta.shape[1])
    of_draws = np.quantile(batches, TAILS, axis=1).std(axis=1, ddof=1) / np.sqrt(15)
    assert np.median(mixtures.quantile_errors(TAILS) / of_draws) < 0.5


def test_a_gaussian_posterior_is_validated_within_two_digits(recovered: lb.Campaign) -> None:
    fit = lb.sample(lb.HybridModel.paper(0), recovered, sampler="independent", seed=3)
    assert validate_gum(fit).not_validated == ()


def test_what_truncation_cuts_off_is_not_validated(posterior: xr.DataTree) -> None:
    assert "C_CCY" in validate_gum(posterior, digits=1).not_validated


def test_without_truncation_the_law_of_propagation_holds_for_more_parameters(
    posterior: xr.DataTree, recovered: lb.Campaign
) -> None:
    model = lb.HybridModel.first(1).without("truncation")
    free = lb.sample(model, recovered, sampler="independent", seed=3)
    with_truncation = validate_gum(posterior, digits=1).validated
    assert set(with_truncation) < set(validate_gum(free, digits=1).validated)


def test_an_average_is_compared_with_its_most_probable_model(recovered: lb.Campaign) -> None:
    models = {"constant": lb.HybridModel.first(0), "linear": lb.HybridModel.first(1)}
    averaged = lb.average(models, recovered, seed=1)
    assert 0.5 < validate_gum(averaged).probability_of_model < 1.0


def test_digits_other_than_one_or_two_are_refused(posterior: xr.DataTree) -> None:
    refuses("digits must be 1 or 2, got 3", validate_gum, posterior, digits=3)


def test_the_json_of_a_validation_has_units(posterior: xr.DataTree) -> None:
    assert validate_gum(posterior).as_dict()["parameters"]["C_XXX"]["unit"] == "mm/N"
