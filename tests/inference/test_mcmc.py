"""Ensembles: the redrawing move leaves a known posterior as it is, the rule sees what has not mixed, Ctrl-C ends a run."""

from __future__ import annotations

import numpy as np
import pytest
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.inference.mcmc import Assessment, JointDensity, LinearRedraw, StoppingRule, run_ensembles
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.inference.posterior import assess

MODELS = {
    "truncated": lb.HybridModel.default(1),
    "untruncated": lb.HybridModel.default(1).without("truncation"),
    "flat": lb.HybridModel.paper(0),
    "quadratic": lb.HybridModel.default(2),
}


def redraw_of(model: lb.HybridModel, **planned: float) -> tuple[JointDensity, LinearRedraw]:
    bound = model.bind(simulated(plan(**planned)))
    density = JointDensity(bound)
    return density, LinearRedraw(density, HyperPosterior(bound, truncated=bound.truncation.active))


@pytest.mark.parametrize("name", MODELS)
def test_the_density_of_a_draw_is_that_of_the_point(name: str) -> None:
    density, redraw = redraw_of(MODELS[name], arc_deg=230.0)
    points, log_proposed, log_target = redraw.draw(40, np.random.RandomState(3))
    np.testing.assert_allclose(redraw.log_density(points), log_proposed, atol=1e-5)
    np.testing.assert_allclose(density(points), log_target, atol=1e-5)


def test_the_weights_are_nearly_even_and_average_to_the_evidence() -> None:
    """E_q[p / q] = Z; an effective share of more than half keeps most proposals."""
    density, redraw = redraw_of(lb.HybridModel.default(0))
    points, log_density, _ = redraw.draw(1500, np.random.RandomState(3))
    weight = density(points) - log_density
    level = np.exp(weight - weight.max())
    mean, error = level.mean(), level.std() / np.sqrt(len(level))
    expected = redraw.start.nodes(1e-2).lattice.log_integral - density.bound.log_prob_truncation_prior
    # The proposal's own integral is left out of its density.
    own = redraw.start.coarse.log_integral
    assert np.log(mean) + weight.max() + own == pytest.approx(expected, abs=5.0 * error / mean + 1e-2)
    assert level.sum() ** 2 / (level**2).sum() > 0.5 * len(level)


def log_density(points: np.ndarray) -> np.ndarray:
    return np.asarray(-0.5 * (points[:, 0] - points[:, 1] ** 2) ** 2 - 0.5 * points[:, 1] ** 2)


class Wide:
    """(x, z) from z ~ N(0, 1.3²), x | z ~ N(z², 1.5²)."""

    def draw(self, size: int, random: np.random.RandomState) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        z = 1.3 * random.standard_normal(size)
        points = np.column_stack([z**2 + 1.5 * random.standard_normal(size), z])
        return points, self.log_density(points), log_density(points)

    def log_density(self, points: np.ndarray) -> np.ndarray:
        return -0.5 * ((points[:, 0] - points[:, 1] ** 2) / 1.5) ** 2 - 0.5 * (points[:, 1] / 1.3) ** 2


@pytest.mark.parametrize("wrong", [False, True])
def test_the_move_leaves_a_known_density_as_it_is(wrong: bool) -> None:
    """z ~ N(0, 1), x | z ~ N(z², 1): var x = 3; with a wrong proposal density it is another."""

    class Wrong(Wide):
        def log_density(self, points: np.ndarray) -> np.ndarray:
            return np.zeros(len(points))

    rng = np.random.default_rng(0)
    starts = rng.normal(size=(4, 64, 2)) + np.array([1.0, 0.0])
    rule = StoppingRule(ess=1e9, max_steps=1000, block=100)
    run = run_ensembles(
        log_density,
        starts,
        lambda chain: Assessment(1.0, 1.0, 1.0),
        rule=rule,
        seed=np.random.SeedSequence(5),
        redraw=Wrong() if wrong else Wide(),
    )
    x, z = run.chain.reshape(-1, 2).T
    right = abs(x.mean() - 1.0) < 0.08 and abs(x.var() / 3.0 - 1.0) < 0.08 and abs(z.var() - 1.0) < 0.07
    assert right is not wrong


@pytest.mark.slow
def test_ensembles_sample_a_correlated_normal_at_the_real_dimension() -> None:
    """23 dimensions: the moves must not bias the spread (a known fault of another move is sd 0.88)."""
    rng = np.random.default_rng(0)
    d = 23
    root = np.tril(rng.normal(size=(d, d)), -1) * 0.3 + np.diag(np.exp(rng.normal(size=d)))
    inverse = np.linalg.inv(root)
    starts = rng.normal(size=(4, 92, d)) @ root.T

    def log_density(x: np.ndarray) -> np.ndarray:
        return -0.5 * ((x @ inverse.T) ** 2).sum(axis=1)

    run = run_ensembles(log_density, starts, assess, rule=StoppingRule(ess=2000.0), seed=np.random.SeedSequence(1))
    white = run.chain.reshape(-1, d) @ inverse.T
    assert run.converged
    np.testing.assert_allclose(white.std(axis=0), 1.0, atol=0.06)
    np.testing.assert_allclose(white.mean(axis=0), 0.0, atol=0.08)


def test_walker_major_order() -> None:
    """Ensembles whose walkers stand still must not look like thousands of independent draws."""
    starts = np.random.default_rng(0).normal(size=(4, 64, 2))
    run = run_ensembles(
        lambda x: np.where(np.isin(x[:, 0], starts[..., 0]), 0.0, -np.inf),
        starts,
        assess,
        rule=StoppingRule(ess=1000.0, max_steps=400),
        seed=np.random.SeedSequence(1),
    )
    assert not run.converged
    assert run.assessment.ess_bulk_min < 500.0


def test_an_interrupt_ends_the_run_and_prints_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    def interrupted(points: np.ndarray) -> np.ndarray:
        raise KeyboardInterrupt

    starts = np.random.default_rng(0).normal(size=(4, 8, 2))
    with pytest.raises(KeyboardInterrupt):
        run_ensembles(interrupted, starts, assess, rule=StoppingRule(), seed=np.random.SeedSequence(1))
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("ess", "rhat", "walkers", "met"),
    [
        (1000, 1.01, 0, True),
        (999, 1.0, 0, False),
        (1000, 1.011, 0, False),
        (1000, 1.0, 200, False),
        (np.nan, 1.0, 0, False),
        (1200, np.nan, 0, False),
    ],
)
def test_the_rule(ess: float, rhat: float, walkers: int, met: bool) -> None:
    """1000 draws' worth of 200 walkers is less than six autocorrelation times."""
    assert Assessment(ess, 2000.0, rhat).meets(StoppingRule(), walkers=walkers) is met
