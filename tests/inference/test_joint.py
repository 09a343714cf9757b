"""The redrawing move: its densities are those of its draws, and it leaves a known posterior as it is."""

from __future__ import annotations

import numpy as np
import pytest
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.inference.ensemble import run_ensembles
from ldbb_bayes.inference.joint import JointDensity, LinearRedraw
from ldbb_bayes.inference.quadrature import HyperPosterior
from ldbb_bayes.inference.stopping import Assessment, StoppingRule

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


@pytest.mark.parametrize("arc_deg", [360.0, 230.0])
@pytest.mark.parametrize("name", MODELS)
def test_the_density_of_a_draw_is_that_of_the_point(name: str, arc_deg: float) -> None:
    density, redraw = redraw_of(MODELS[name], arc_deg=arc_deg)
    points, log_proposed, log_target = redraw.draw(40, np.random.RandomState(3))
    np.testing.assert_allclose(redraw.log_density(points), log_proposed, atol=1e-5)
    np.testing.assert_allclose(density(points), log_target, atol=1e-5)


def test_without_truncation_the_draw_is_the_conditional_itself() -> None:
    """ln p(β, φ | y) − ln q(β, φ) is a function of φ alone: the collapsed density over the lattice's."""
    density, redraw = redraw_of(MODELS["untruncated"])
    points, log_density, _ = redraw.draw(30, np.random.RandomState(3))
    _, free = density.split(points)
    expected = redraw.start.log_density(free) - redraw.start.coarse.log_proposal(free)
    np.testing.assert_allclose(density(points) - log_density, expected, atol=1e-5)


@pytest.mark.parametrize("name", ["truncated", "untruncated", "quadratic"])
def test_the_weights_are_nearly_even_and_average_to_the_evidence(name: str) -> None:
    """E_q[p / q] = Z; an effective share of more than half keeps most proposals."""
    density, redraw = redraw_of(MODELS[name])
    points, log_density, _ = redraw.draw(1500, np.random.RandomState(3))
    weight = density(points) - log_density
    level = np.exp(weight - weight.max())
    mean, error = level.mean(), level.std() / np.sqrt(len(level))
    expected = redraw.start.lattice().log_integral - density.bound.log_prob_truncation_prior
    # The proposal's own integral is left out of its density.
    own = redraw.start.coarse.log_integral
    assert np.log(mean) + weight.max() + own == pytest.approx(expected, abs=5.0 * error / mean + 2e-3)
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
    rule = StoppingRule(ess=1e9, max_steps=2000, block=100)
    run = run_ensembles(
        log_density,
        starts,
        lambda chain: Assessment(1.0, 1.0, 1.0),
        rule=rule,
        seed=np.random.SeedSequence(5),
        redraw=Wrong() if wrong else Wide(),
    )
    x, z = run.chain.reshape(-1, 2).T
    right = abs(x.mean() - 1.0) < 0.06 and abs(x.var() / 3.0 - 1.0) < 0.06 and abs(z.var() - 1.0) < 0.05
    assert right is not wrong
