"""Ensembles: the redrawing move leaves a known posterior as it is, the rule sees what has not
mixed, Ctrl-C ends a run."""

from __future__ import annotations

import numpy as np
import pytest
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.inference.density import JointDensity, LinearRedraw
from ldbb_bayes.inference.diagnostics import diagnose
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.mcmc import Assessment, StoppingRule, WeightedPoints, run_ensembles
from ldbb_bayes.inference.nodes import compute_nodes

MODELS = {
    "truncated": lb.HybridModel.first(1),
    "untruncated": lb.HybridModel.first(1).without("truncation"),
    "flat": lb.HybridModel.paper(0),
    "quadratic": lb.HybridModel.first(2),
}


def redraw_of(model: lb.HybridModel, **planned: float) -> tuple[JointDensity, LinearRedraw]:
    bound = model.bind(simulated(plan(**planned)))
    density = JointDensity(bound)
    hyper_posterior = HyperPosterior(bound, truncated=bound.truncation.active)
    return density, LinearRedraw(density, hyper_posterior)


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_the_weight_of_a_draw_is_that_of_the_point(name: str) -> None:
    density, redraw = redraw_of(MODELS[name], arc_deg=230.0)
    points, log_weight, log_target = redraw.draw(40, np.random.RandomState(3))
    inside = np.isfinite(log_target)
    assert inside.sum() > 10
    np.testing.assert_allclose(redraw.log_weight(points[inside]), log_weight[inside], atol=1e-5)
    np.testing.assert_allclose(density(points), log_target, atol=1e-5)


def test_the_weights_are_nearly_even_and_average_to_the_evidence() -> None:
    """E_q[p / q] = Z; an effective share of more than half keeps most proposals."""
    _, redraw = redraw_of(lb.HybridModel.first(0))
    _, log_weight, _ = redraw.draw(1500, np.random.RandomState(3))
    level = np.exp(log_weight - log_weight.max())
    mean = level.mean()
    error = level.std() / np.sqrt(len(level))
    expected = compute_nodes(redraw.start, 1e-2).integral.log_integral
    log_evidence = np.log(mean) + log_weight.max()
    assert log_evidence == pytest.approx(expected, abs=5.0 * error / mean + 1e-2)
    assert level.sum() ** 2 / (level**2).sum() > 0.5 * len(level)


def log_density(points: np.ndarray) -> np.ndarray:
    return np.asarray(-0.5 * (points[:, 0] - points[:, 1] ** 2) ** 2 - 0.5 * points[:, 1] ** 2)


class Wide:
    """(x, z) from z ~ N(0, 1.3²), x | z ~ N(z², 1.5²)."""

    def draw(self, size: int, random: np.random.RandomState) -> WeightedPoints:
        z = 1.3 * random.standard_normal(size)
        points = np.column_stack([z**2 + 1.5 * random.standard_normal(size), z])
        return WeightedPoints(points, self.log_weight(points), log_density(points))

    def log_weight(self, points: np.ndarray) -> np.ndarray:
        log_proposed = (
            -0.5 * ((points[:, 0] - points[:, 1] ** 2) / 1.5) ** 2 - 0.5 * (points[:, 1] / 1.3) ** 2
        )
        return log_density(points) - log_proposed


class WronglyWeighted(Wide):
    """Weights that leave out the proposal."""

    def log_weight(self, points: np.ndarray) -> np.ndarray:
        return log_density(points)


@pytest.mark.slow
@pytest.mark.parametrize(("redraw", "correct"), [(Wide(), True), (WronglyWeighted(), False)])
def test_the_move_leaves_a_known_density_as_it_is(redraw: Wide, correct: bool) -> None:
    """z ~ N(0, 1), x | z ~ N(z², 1): var x = 3; with wrong weights it is another."""
    rng = np.random.default_rng(0)
    starts = rng.normal(size=(4, 64, 2)) + np.array([1.0, 0.0])
    rule = StoppingRule(ess=1e9, max_steps=1000, block=100)
    seed = np.random.SeedSequence(5)
    run = run_ensembles(log_density, starts, rule=rule, seed=seed, redraw=redraw)
    x, z = run.chain.reshape(-1, 2).T
    errors = np.abs([x.mean() - 1.0, x.var() / 3.0 - 1.0, z.var() - 1.0])
    assert np.all(errors < [0.08, 0.08, 0.07]) == correct


@pytest.mark.slow
def test_ensembles_sample_a_correlated_normal_at_the_real_dimension() -> None:
    """23 dimensions: the moves must not bias the spread (a known fault of another move is sd
    0.88)."""
    rng = np.random.default_rng(0)
    d = 23
    below_diagonal = np.tril(rng.normal(size=(d, d)), -1) * 0.3
    root = below_diagonal + np.diag(np.exp(rng.normal(size=d)))
    inverse = np.linalg.inv(root)
    starts = rng.normal(size=(4, 92, d)) @ root.T

    def correlated_normal(x: np.ndarray) -> np.ndarray:
        return -0.5 * ((x @ inverse.T) ** 2).sum(axis=1)

    rule = StoppingRule(ess=2000.0)
    run = run_ensembles(correlated_normal, starts, rule=rule, seed=np.random.SeedSequence(1))
    white = run.chain.reshape(-1, d) @ inverse.T
    assert run.converged
    np.testing.assert_allclose(white.std(axis=0), 1.0, atol=0.06)
    np.testing.assert_allclose(white.mean(axis=0), 0.0, atol=0.08)


def test_burn_in_is_left_out() -> None:
    """Walkers that start 30 sd away: no draw that is kept lies on their way."""
    starts = 30.0 + np.random.default_rng(0).normal(size=(4, 16, 2))
    rule = StoppingRule(ess=1e9, max_steps=1000, block=100)

    def standard_normal(x: np.ndarray) -> np.ndarray:
        return -0.5 * (x**2).sum(axis=1)

    run = run_ensembles(standard_normal, starts, rule=rule, seed=np.random.SeedSequence(1))
    assert np.abs(run.chain).max() < 7.0
    assert run.chain.std() == pytest.approx(1.0, abs=0.1)


def test_diagnostics_are_of_each_parameter(rng: np.random.Generator) -> None:
    """White draws are worth their number, slow ones less, antithetic ones more."""
    chain = rng.normal(size=(4, 1000, 4))
    for t in range(1, chain.shape[1]):
        chain[:, t, 1:3] += np.array([0.95, -0.7]) * chain[:, t - 1, 1:3]
    chain[..., 3] = 1.0
    diagnostics = diagnose(chain)
    white, slow, antithetic, constant = diagnostics.ess_bulk
    assert white == pytest.approx(4000, rel=0.1)
    assert slow < 0.1 * white
    assert antithetic > 1.5 * white
    assert constant == 4000
    assert diagnostics.ess_tail.shape == (4,)
    assert diagnostics.rhat[0] == pytest.approx(1.0, abs=0.01)


def test_walker_major_order() -> None:
    """Ensembles whose walkers stand still must not look like thousands of independent draws."""
    starts = np.random.default_rng(0).normal(size=(4, 64, 2))

    def zero_at_starts_alone(x: np.ndarray) -> np.ndarray:
        return np.where(np.isin(x[:, 0], starts[..., 0]), 0.0, -np.inf)

    rule = StoppingRule(ess=1000.0, max_steps=400)
    run = run_ensembles(zero_at_starts_alone, starts, rule=rule, seed=np.random.SeedSequence(1))
    assert not run.converged
    assert run.assessment.ess_bulk_min < 500.0


@pytest.mark.parametrize(
    ("ess", "rhat", "walkers", "satisfied"),
    [
        (1000, 1.01, 0, True),
        (999, 1.0, 0, False),
        (1000, 1.011, 0, False),
        (1000, 1.0, 200, False),
        (np.nan, 1.0, 0, False),
        (1200, np.nan, 0, False),
    ],
)
def test_the_rule(ess: float, rhat: float, walkers: int, satisfied: bool) -> None:
    """1000 draws' worth of 200 walkers is less than six autocorrelation times."""
    assessment = Assessment(ess, 2000.0, rhat)
    assert assessment.meets(StoppingRule(), walkers=walkers) is satisfied
