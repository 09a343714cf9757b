"""The redrawing move: its densities are those of its draws, and it leaves a known posterior as it is."""

from __future__ import annotations

import numpy as np
import pytest
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.inference.ensemble import Assessment, StoppingRule, run_ensembles
from ldbb_bayes.inference.joint import JointDensity, LinearRedraw
from ldbb_bayes.inference.quadrature import HyperPosterior

MODELS = {
    "truncated": lb.HybridModel.default(1),
    "untruncated": lb.HybridModel.default(1).without("truncation"),
    "flat": lb.HybridModel.paper(0),
    "quadratic": lb.HybridModel.default(2),
}


@pytest.mark.parametrize("arc_deg", [360.0, 230.0])
@pytest.mark.parametrize("name", MODELS)
def test_the_density_of_a_draw_is_that_of_the_point(name: str, arc_deg: float) -> None:
    bound = MODELS[name].bind(simulated(plan(arc_deg=arc_deg)))
    redraw = LinearRedraw(JointDensity(bound))
    free = HyperPosterior(bound, truncated=False).draw(40, np.random.default_rng(1))
    points, log_density = redraw.draw(free, np.random.RandomState(3))
    np.testing.assert_allclose(redraw.log_density(points), log_density, atol=1e-5)
    np.testing.assert_array_equal(points[:, redraw.moved], free)


def test_without_truncation_the_draw_is_the_conditional_itself() -> None:
    """ln p(β, φ | y) − ln q(β | φ) is a function of φ alone: the collapsed density."""
    bound = MODELS["untruncated"].bind(simulated(plan()))
    density = JointDensity(bound)
    redraw = LinearRedraw(density)
    free = HyperPosterior(bound, truncated=False).draw(30, np.random.default_rng(1))
    points, log_density = redraw.draw(free, np.random.RandomState(3))
    collapsed = bound.log_evidence(bound.hyper_prior.phi(free)) + bound.hyper_prior.log_density_of_free(free)
    np.testing.assert_allclose(density(points) - log_density - collapsed, 0.0, atol=1e-5)


def test_inside_the_truncation_the_weights_are_nearly_even() -> None:
    """The tilted proposal: ln p(β, φ | y) − ln q(β | φ) spreads little about ln p(φ | y, T)."""
    bound = MODELS["truncated"].bind(simulated(plan()))
    density, start = JointDensity(bound), HyperPosterior(bound, truncated=True)
    free = np.tile(start.mode, (4000, 1))
    points, log_density = LinearRedraw(density).draw(free, np.random.RandomState(3))
    weight = density(points) - log_density
    assert np.isfinite(weight).all()
    mean = np.log(np.mean(np.exp(weight - weight.max()))) + weight.max()
    expected = start.log_density(start.mode[None])[0] - bound.log_prob_truncation_prior
    assert mean == pytest.approx(expected, abs=0.03)
    assert weight.std() < 0.6


class Block2:
    """x | z ~ N(z², 1) redrawn from N(z², 1.5²); z is what is moved."""

    moved = slice(1, 2)

    def draw(self, moved: np.ndarray, random: np.random.RandomState) -> tuple[np.ndarray, np.ndarray]:
        x = moved[:, 0] ** 2 + 1.5 * random.standard_normal(len(moved))
        points = np.column_stack([x, moved[:, 0]])
        return points, self.log_density(points)

    def log_density(self, points: np.ndarray) -> np.ndarray:
        return -0.5 * ((points[:, 0] - points[:, 1] ** 2) / 1.5) ** 2


@pytest.mark.parametrize("wrong", [False, True])
def test_the_move_leaves_a_known_density_as_it_is(wrong: bool) -> None:
    """z ~ N(0, 1), x | z ~ N(z², 1): var x = 3; with a wrong proposal density it is another."""

    class Wrong(Block2):
        def log_density(self, points: np.ndarray) -> np.ndarray:
            return np.zeros(len(points))

    def log_density(points: np.ndarray) -> np.ndarray:
        return np.asarray(-0.5 * (points[:, 0] - points[:, 1] ** 2) ** 2 - 0.5 * points[:, 1] ** 2)

    rng = np.random.default_rng(0)
    starts = rng.normal(size=(4, 64, 2)) + np.array([1.0, 0.0])
    rule = StoppingRule(ess=1e9, max_steps=2000, block=100, thin=5)
    run = run_ensembles(
        log_density,
        starts,
        lambda chain: Assessment(1.0, 1.0, 1.0),
        rule=rule,
        seed=np.random.SeedSequence(5),
        redraw=Wrong() if wrong else Block2(),
    )
    x, z = run.chain.reshape(-1, 2).T
    right = abs(x.mean() - 1.0) < 0.06 and abs(x.var() / 3.0 - 1.0) < 0.06 and abs(z.var() - 1.0) < 0.05
    assert right is not wrong
