"""The log density for samplers of one's own: the oracle's, normalised, with its prior transform;
emcee and dynesty on it."""

from __future__ import annotations

import pickle
from typing import Any

import emcee
import numpy as np
import pandas as pd
import pytest
from campaigns import oracle_of, plan, refuses, simulated
from scipy import optimize, stats

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError

FEW = simulated(plan((30, 30, 30), forces_N=(36.0, 400.0, 742.0)))
FOUR = simulated(plan())
TIGHT = {"C_XXX": (3e-6, 4e-6), "C_YYY": (-2e-6, 8e-6), "C_CCY": (1e-9, 1e-9)}
MODELS = {
    "constant": lb.HybridModel.first(0),
    "linear": lb.HybridModel.first(1),
    "quadratic": lb.HybridModel.first(2),
    "tight": lb.HybridModel.first(1).with_prior(TIGHT),
}


@pytest.mark.parametrize("edition", ["first", "third"])
def test_densities_are_the_oracles(edition: str, rng: np.random.Generator) -> None:
    """ln p(y | x) of the dense covariance; ln p(x) of normals inside, over P(T) in closed form, and
    of the scales."""
    model = lb.HybridModel.default(1)
    priors: dict[str, tuple[float, float]] = {}
    if edition == "first":
        model = MODELS["tight"]
        priors = TIGHT
    density = lb.log_density(model, FOUR)
    dense = oracle_of(FOUR, 1, edition=edition, given_priors=priors)
    x = density.initial(5, seed=2)
    assert np.isfinite(density.log_prob(x)).all()
    for point, likelihood, prior in zip(
        x, density.log_likelihood(x), density.log_prior(x), strict=True
    ):
        by_name = density.split(point)
        beta = np.array([*by_name["parameters"].values()])
        hyper = np.array([*by_name["hyper"].values()])
        named = dict(zip(dense.hypers, hyper, strict=True))
        assert likelihood == pytest.approx(dense.log_likelihood(named, beta), abs=1e-4)
        expected = (
            stats.norm.logpdf(beta, dense.mean, dense.sd).sum()
            - dense._log_prob_prior()
            + dense.log_prior(named)
        )
        assert prior == pytest.approx(expected, abs=1e-4)
        assert density.log_prob(point) == pytest.approx(likelihood + prior, rel=1e-14)
    assert [*density.split(x)["parameters"]] == dense.names
    assert dict(zip(density.names, density.units, strict=True))["C_CCY"] == "rad/(N mm)"


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_prior_transform_gives_draws_of_the_prior(name: str, rng: np.random.Generator) -> None:
    """Those that rejection leaves of normal draws; of the scales by their laws."""
    density = lb.log_density(MODELS[name], FEW)
    bound = density.bound
    size = 300 if name == "quadratic" else 4000
    draws = density.prior_transform(rng.random((size, len(density.names))))
    assert np.isfinite(density.log_prior(draws)).all()
    assert np.all((draws >= density.bounds[:, 0]) & (draws <= density.bounds[:, 1]))
    normal = bound.prior_mean + rng.standard_normal((200_000, len(bound.names))) * bound.prior_sd
    rejected = normal[(normal @ bound.truncation.rows.T >= 0.0).all(axis=1)]
    looks = np.vstack([np.eye(len(bound.names)), bound.truncation.rows])
    p_values = [
        stats.ks_2samp(draws[:, : len(bound.names)] @ look, rejected @ look).pvalue
        for look in looks
    ]
    assert min(p_values) > 1e-4
    tau = density.names.index("tau")
    assert stats.kstest(draws[:, tau], stats.halfnorm(scale=5e-3).cdf).pvalue > 1e-4
    one = rng.random(len(density.names))
    np.testing.assert_array_equal(
        density.prior_transform(one), density.prior_transform(one[None])[0]
    )


@pytest.fixture(scope="module")
def density() -> lb.inference.LogDensity:
    return lb.log_density(lb.HybridModel.default(1), FOUR)


@pytest.fixture(scope="module")
def start(density: lb.inference.LogDensity) -> np.ndarray:
    return density.initial(1)[0]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("C_XXX", -1e-6),
        ("sigma", 1e-5),
        ("decay", 0.4),
        ("lambda_f036", -1.0),
        ("tau", np.nan),
    ],
)
def test_outside_the_bounds(
    name: str, value: float, density: lb.inference.LogDensity, start: np.ndarray
) -> None:
    outside = np.where(np.array(density.names) == name, value, start)
    assert np.clip(value, *density.bounds[density.names.index(name)]) != value
    assert density.log_prob(outside) == density.log_prior(outside) == -np.inf
    assert np.isfinite(density.log_likelihood(outside)) == (name == "C_XXX")


def test_a_density_is_pickled_and_named(
    density: lb.inference.LogDensity, start: np.ndarray
) -> None:
    # Copies of arrays may be aligned otherwise in memory, which moves the last digits of sums.
    copy = pickle.loads(pickle.dumps(density))
    assert copy.log_prob(start) == pytest.approx(density.log_prob(start), rel=1e-13)
    assert repr(density) == "LogDensity of 'campaign': 19 parameters, 9 scales"


def test_a_wrong_shape_is_refused(density: lb.inference.LogDensity) -> None:
    message = r"x must have shape \(28,\) or \(n, 28\), got \(3,\)\. Order it as in names"
    refuses(message, density.log_prob, np.zeros(3))


@pytest.mark.parametrize("x", ["a", {"C_XXX": 5e-5}, [[0.0], [0.0, 1.0]]])
def test_points_that_are_no_numbers_are_refused(density: lb.inference.LogDensity, x: Any) -> None:
    message = "x must be an array of numbers, got .*. Order it as in names"
    refuses(message, density.log_prob, x)


@pytest.mark.parametrize("u", [1.5, -1e-9, np.nan])
def test_no_probability_is_refused(u: float, density: lb.inference.LogDensity) -> None:
    point = np.full(len(density.names), 0.5)
    point[3] = u
    with pytest.raises(InputError, match=f"u must lie between 0 and 1, got {u}. Give prior"):
        density.prior_transform(point)


def test_a_plan_is_refused() -> None:
    message = "must have readings to have a posterior, got a plan"
    refuses(message, lb.log_density, lb.HybridModel.default(1), plan())


def test_a_flat_prior_has_no_transform() -> None:
    flat = lb.log_density(lb.HybridModel.paper(0), FEW)
    refuses("must be proper, got a flat one", flat.prior_transform, np.zeros(14))


@pytest.mark.slow
def test_an_optimiser_finds_the_mode() -> None:
    """Least squares where the prior is flat and noise alone is left."""
    density = lb.log_density(lb.HybridModel.paper(0), FEW)
    x0 = density.initial(1)[0]
    options = {"maxfev": 40_000, "maxiter": 40_000, "adaptive": True, "xatol": 1e-6, "fatol": 1e-9}

    def loss(z: np.ndarray) -> float:
        return -density.log_prob(x0 + density.scale * z)

    origin = np.zeros(len(x0))
    optimum = optimize.minimize(loss, origin, method="Nelder-Mead", options=options)
    mode = density.split(x0 + density.scale * optimum.x)["parameters"]
    estimate = lb.fit_least_squares(FEW).estimate
    sd = lb.inference.marginalize(lb.HybridModel.paper(0), FEW)["sd"]
    assert max(abs(mode[name] - estimate[name]) / sd[name] for name in mode) < 0.05


def agree(
    density: lb.inference.LogDensity,
    exact: pd.DataFrame,
    draws: np.ndarray,
    weight: np.ndarray | None = None,
) -> None:
    mean = np.average(draws, axis=0, weights=weight)
    sd = np.sqrt(np.average((draws - mean) ** 2, axis=0, weights=weight))
    expected = exact.loc[list(density.names)]
    assert np.abs((mean - expected["mean"]) / expected["sd"]).max() < 0.12
    assert np.abs(sd / expected["sd"] - 1.0).max() < 0.12


@pytest.mark.slow
def test_emcee_reproduces_the_posterior(recovered: lb.Campaign) -> None:
    model = lb.HybridModel.first(1)
    density = lb.log_density(model, recovered)
    d = len(density.names)
    moves = [(emcee.moves.DEMove(), 0.9), (emcee.moves.DEMove(gamma0=1.0), 0.1)]
    sampler = emcee.EnsembleSampler(8 * d, d, density.log_prob, vectorize=True, moves=moves)
    sampler.run_mcmc(
        emcee.State(density.initial(8 * d), random_state=np.random.RandomState(1).get_state()), 6000
    )
    agree(
        density,
        lb.inference.marginalize(model, recovered),
        sampler.get_chain(discard=1500, thin=10, flat=True),
    )


@pytest.mark.slow
def test_dynesty_reproduces_posterior_and_evidence() -> None:
    dynesty = pytest.importorskip("dynesty")
    model = lb.HybridModel(1, (lb.terms.SetupShift(),)).fixing(
        "C_XYX", "C_CXY", "C_CYY", "C_CCY", "C_XYX_1", "C_CXY_1", "C_CYY_1"
    )
    model = model.fixing("C_CCY_1", "C_YYY_1", "E_YX2", "E_XY2", "E_C0YX", "E_Xt0", "E_Yt0")
    density = lb.log_density(model, FEW)
    (rng,) = np.random.default_rng(1).spawn(1)
    nested = dynesty.NestedSampler(
        density.log_likelihood, density.prior_transform, len(density.names), nlive=250, rstate=rng
    )
    nested.run_nested(print_progress=False, dlogz=0.1)
    results = nested.results
    log_evidence = results.logz[-1]
    error = results.logzerr[-1]
    expected = lb.log_evidence(model, FEW).log_value
    assert log_evidence == pytest.approx(expected, abs=3.0 * error)
    assert error < 0.5
    weight = np.exp(results.logwt - log_evidence)
    agree(density, lb.inference.marginalize(model, FEW), results.samples, weight)
