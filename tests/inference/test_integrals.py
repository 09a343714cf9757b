"""Plain integrals on ℝ^h against closed forms: the stated error must cover, in one dimension and in
45."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import arviz_stats.base
import emcee
import numpy as np
import pytest
from scipy import stats
from scipy.special import gammaln, stdtrit

from ldbb_bayes.inference.diagnostics import pareto_k
from ldbb_bayes.inference.importance_sampling import importance_sample, sample_similar
from ldbb_bayes.inference.integrals import Integral, _sorted_by_coordinates
from ldbb_bayes.inference.lattice import _grid_point_ids, grow_lattice
from ldbb_bayes.inference.mixture_proposals import Mixture, _lower_quantiles
from ldbb_bayes.inference.quadrature import integrate
from ldbb_bayes.model.newton import central_differences, newton

Array = np.ndarray
LogDensity = Callable[[Array], Array]
Modes = list[tuple[Array, Array]]  # a mode and the axes of its curvature, the highest first
Target = tuple[LogDensity, list[Array]]  # a log density and where to look for its modes
Problem = Callable[[np.random.Generator, int], Target]


def turned(rng: np.random.Generator, h: int, size: float = 0.3) -> tuple[Array, float]:
    """A matrix not far from diagonal and ln of its determinant."""
    scales = np.diag(np.exp(0.5 * rng.normal(size=h)))
    matrix = scales @ (np.eye(h) + size * rng.normal(size=(h, h)) / np.sqrt(h))
    return np.linalg.inv(matrix), float(np.linalg.slogdet(matrix)[1])


def gaussian(rng: np.random.Generator, h: int) -> Target:
    inverse, log_det = turned(rng, h, 1.0)

    def log_density(x: Array) -> Array:
        return np.asarray(stats.norm.logpdf(x @ inverse.T).sum(axis=1) - log_det)

    return log_density, [np.zeros(h)]


def log_gammas(rng: np.random.Generator, h: int) -> Target:
    inverse, log_det = turned(rng, h)
    shape = np.exp(rng.uniform(-0.3, 1.8, h))
    sign = rng.choice([-1.0, 1.0], h)

    def log_density(x: Array) -> Array:
        y = sign * (x @ inverse.T)
        each_coordinate = shape * y - np.exp(np.minimum(y, 500.0)) - gammaln(shape)
        return each_coordinate.sum(axis=1) - log_det

    return log_density, [np.linalg.solve(inverse, sign * np.log(shape))]


def half_normals(rng: np.random.Generator, h: int) -> Target:
    """Logarithms of scales, some near zero: e^(ax) on the left, doubly exponential on the right."""
    power = rng.uniform(1.0, 8.0, h)
    rate = np.exp(rng.normal(size=h))
    constant = (gammaln(power / 2.0) - 0.5 * power * np.log(rate) - np.log(2.0)).sum()
    mode = 0.5 * np.log(power / (2.0 * rate))

    def log_density(x: Array) -> Array:
        square = np.exp(np.minimum(2.0 * x, 500.0))
        return (power * x - rate * square).sum(axis=1) - constant

    return log_density, [mode]


def students(rng: np.random.Generator, h: int) -> Target:
    inverse, log_det = turned(rng, h)
    dof = rng.uniform(5.0, 15.0)

    def log_density(x: Array) -> Array:
        return np.asarray(stats.t.logpdf(x @ inverse.T, dof).sum(axis=1) - log_det)

    return log_density, [np.zeros(h)]


def banana(rng: np.random.Generator, h: int) -> Target:
    bend = rng.uniform(0.1, 0.25)

    def log_density(x: Array) -> Array:
        straight = x.copy()
        if h > 1:
            straight[:, -1] -= bend * (x[:, 0] ** 2 - 1.0)
        return np.asarray(stats.norm.logpdf(straight).sum(axis=1))

    return log_density, [np.zeros(h)]


def two_modes(rng: np.random.Generator, h: int) -> Target:
    mode = rng.normal(size=h)
    share = rng.uniform(0.2, 0.8)
    mode *= rng.uniform(2.0, 3.0) / np.linalg.norm(mode)

    def log_density(x: Array) -> Array:
        at_mode = stats.norm.logpdf(x - mode).sum(axis=1)
        opposite = stats.norm.logpdf(x + mode).sum(axis=1)
        return np.asarray(np.logaddexp(np.log(share) + at_mode, np.log1p(-share) + opposite))

    return log_density, [mode, -mode]


PROBLEMS = [gaussian, log_gammas, half_normals, students, banana, two_modes]


def student(rng: np.random.Generator, h: int) -> Target:
    """In all directions at once: no product of one-dimensional tails fits it."""
    constant = gammaln(4.0 + 0.5 * h) - gammaln(4.0) - 0.5 * h * np.log(8.0 * np.pi)

    def log_density(x: Array) -> Array:
        return np.asarray(constant - (4.0 + 0.5 * h) * np.log1p((x**2).sum(axis=1) / 8.0))

    return log_density, [np.zeros(h)]


def bananas(rng: np.random.Generator, h: int) -> Target:
    bend = rng.uniform(0.5, 0.7)

    def log_density(x: Array) -> Array:
        straight = x[:, 1::2] - bend * (x[:, ::2] ** 2 - 1.0)
        return np.asarray(stats.norm.logpdf(np.hstack([x[:, ::2], straight])).sum(axis=1))

    return log_density, [np.zeros(h)]


def funnel(rng: np.random.Generator, h: int) -> Target:
    """The first coordinate is ln of the variance of the others (Neal, Annals of Statistics 31,
    705-767, 2003)."""

    def log_density(x: Array) -> Array:
        log_sd = 0.5 * x[:, :1]
        scaled = stats.norm.logpdf(x[:, 1:] * np.exp(-log_sd)) - log_sd
        return np.asarray(stats.norm.logpdf(x[:, 0]) + scaled.sum(axis=1))

    return log_density, [np.zeros(h)]


def modes_of(log_density: LogDensity, starts: list[Array]) -> Modes:
    def derivatives(point: Array) -> tuple[Array, Array]:
        return central_differences(log_density, point, 0.05)

    def depth(mode: tuple[Array, Array]) -> float:
        return -float(log_density(mode[0][None])[0])

    modes = []
    for start in starts:
        mode = newton(log_density, derivatives, start)
        curvature, vectors = np.linalg.eigh(-derivatives(mode)[1])
        modes.append((mode, vectors / np.sqrt(np.maximum(curvature, 0.1))))
    return sorted(modes, key=depth)


def case(problem: Problem, h: int, seed: int) -> tuple[LogDensity, Modes]:
    log_density, starts = problem(np.random.default_rng([h, seed]), h)
    return log_density, modes_of(log_density, starts)


def error_ratio(integral: Integral) -> float:
    """The error over the stated error; the truth is ln 1."""
    return abs(integral.log_integral) / (integral.error + 1e-9)


def few_exceptions(integrals: list[Integral], tolerance: float) -> None:
    trusted = [integral for integral in integrals if integral.trusted]
    ratio = np.array([error_ratio(integral) for integral in trusted])
    assert len(trusted) >= 0.97 * len(integrals)
    assert np.mean(ratio <= 3.0) >= 0.99, np.sort(ratio)[-6:]
    assert np.mean([integral.error <= tolerance for integral in trusted]) >= 0.95
    assert np.median(ratio) > 0.02, "an error a hundred times too large is no error"


@pytest.mark.parametrize(
    ("problems", "dimensions", "seeds"),
    [
        (PROBLEMS, (1, 2, 4, 6, 9), 1),
        pytest.param(PROBLEMS, (1, 2, 4, 6, 9, 14), 9, marks=pytest.mark.slow),
        pytest.param(
            [gaussian, log_gammas, half_normals, banana, two_modes],
            (45,),
            4,
            marks=pytest.mark.slow,
        ),
    ],
)
def test_the_error_of_a_sample_covers(
    problems: list[Problem], dimensions: tuple[int, ...], seeds: int
) -> None:
    integrals: list[Integral] = []
    for problem, h, seed in itertools.product(problems, dimensions, range(seeds)):
        log_density, modes = case(problem, h, seed)
        integrals.append(importance_sample(log_density, modes, tolerance=0.02, seed=len(integrals)))
    few_exceptions(integrals, 0.02)


@pytest.mark.parametrize(
    ("tolerance", "dimensions", "seeds"),
    [(0.1, (1, 2, 3), 6), (1e-2, (1, 2, 3), 6), (1e-4, (1, 2), 3)],
)
def test_the_error_of_a_lattice_covers(
    tolerance: float, dimensions: tuple[int, ...], seeds: int
) -> None:
    lattices: list[Integral] = []
    for problem, h, seed in itertools.product(PROBLEMS, dimensions, range(seeds)):
        log_density, modes = case(problem, h, seed)
        lattices.append(grow_lattice(log_density, modes, tolerance=tolerance))
    ratio = np.array([error_ratio(lattice) for lattice in lattices])
    assert np.mean(ratio <= 3.0) >= 0.99, np.sort(ratio)[-6:]
    assert all(lattice.error <= tolerance for lattice in lattices)


class Moments(NamedTuple):
    """Means and standard deviations of the parameters, each (45,)."""

    mean: Array
    sd: Array


SHARED_START = np.array([-0.5, -0.3, -0.4, 0.1, 2.0])


def weighted_moments(points: Array, weight: Array) -> Moments:
    mean = weight @ points
    return Moments(mean, np.sqrt(weight @ (points - mean) ** 2))


class Circles:
    """Forty circles, a scale λ each with λ² ~ InvGamma(3/2, 3/2), half-normal σ, δ, κ, τ, and p of
    the form: given the shared ones circles are independent, so that the truth is a lattice over
    five dimensions of products of one-dimensional sums."""

    orders = np.repeat(np.arange(1.0, 13.0), 2)
    grid = np.linspace(-2.5, 3.5, 121)

    def __init__(self, rng: np.random.Generator, circles: int = 40) -> None:
        precision = stats.gamma.rvs(1.5, scale=1.0 / 1.5, size=circles, random_state=rng)
        scale = np.exp(-0.5 * np.log(precision))
        sd = np.sqrt(self._variance(np.log([[0.6, 0.8, 0.7]]), np.log(scale))[0])
        harmonics = rng.normal(size=(circles, 24)) * sd
        self.square = (harmonics**2).reshape(circles, 12, 2).sum(axis=2)
        self.noise = stats.chi2.rvs(20 * circles, random_state=rng) * 0.6**2 / (20 * circles)
        self.form = (rng.normal(size=22) * 1.2 * (self.orders[2:] / 6.0) ** -2.0) ** 2

    def _variance(self, shared: Array, log_scale: Array) -> Array:
        """Of every harmonic, shape (w, …, 24)."""
        sigma, delta, kappa = np.exp(2.0 * shared[:, :3]).T[:, :, None, None]
        of_order = np.where(self.orders == 1.0, delta, kappa / self.orders**2)
        return sigma / 10.0 + of_order * np.exp(2.0 * log_scale)[..., None]

    def of_circles(self, shared: Array, log_scale: Array, square: Array) -> Array:
        """ln p(circle, ln λ | shared), shape (w, …)."""
        variance = self._variance(shared, log_scale)[..., ::2]
        prior = -3.0 * log_scale - 1.5 * np.exp(-2.0 * log_scale)
        return np.asarray((-np.log(variance) - 0.5 * square / variance).sum(axis=-1) + prior)

    def of_shared(self, shared: Array) -> Array:
        """The part without circles, shape (w,)."""
        sigma = shared[:, 0]
        tau = shared[:, 3]
        power = shared[:, 4]
        dof = 20.0 * len(self.square)
        scales = shared[:, :4]
        prior = (scales - 0.5 * np.exp(2.0 * scales)).sum(axis=1)
        prior -= 0.5 * ((power - 2.0) / 0.7) ** 2
        log_form = 2.0 * (tau[:, None] - power[:, None] * np.log(self.orders[2:] / 6.0))
        form = -0.5 * (log_form + self.form * np.exp(-log_form)).sum(axis=1)
        return np.asarray(prior + form - dof * (sigma + 0.5 * self.noise * np.exp(-2.0 * sigma)))

    def log_density(self, x: Array) -> Array:
        shared = x[:, :5]
        circles = self.of_circles(shared, x[:, 5:], self.square)
        return self.of_shared(shared) + circles.sum(axis=1)

    def integrated(self, shared: Array) -> Array:
        """ln p of the shared ones, circles summed over the grid, shape (w,)."""
        step = self.grid[1] - self.grid[0]
        total = self.of_shared(shared)
        for square in self.square:
            values = self.of_circles(shared, self.grid, square)
            total = total + np.logaddexp.reduce(values, axis=1) + np.log(step)
        return total

    def truth(self) -> tuple[float, Moments]:
        """ln of the integral, and the moments."""
        modes = modes_of(self.integrated, [SHARED_START])
        lattice = grow_lattice(self.integrated, modes, tolerance=1e-2)
        shared, weight = lattice.heaviest(1e-3)
        moments = [[weight @ shared[:, k], weight @ shared[:, k] ** 2] for k in range(5)]
        for square in self.square:
            values = self.of_circles(shared, self.grid, square)
            share = np.exp(values - np.logaddexp.reduce(values, axis=1, keepdims=True))
            moments.append([weight @ share @ self.grid, weight @ share @ self.grid**2])
        first, second = np.array(moments).T
        return lattice.log_integral, Moments(first, np.sqrt(second - first**2))


def plain_emcee(log_density: LogDensity, start: Array, steps: int) -> Moments:
    """Moments of walkers that know nothing but the density and where to start."""
    rng = np.random.default_rng(1)
    shape = (4 * len(start), len(start))
    moves = [(emcee.moves.DEMove(), 0.9), (emcee.moves.DEMove(gamma0=1.0), 0.1)]
    sampler = emcee.EnsembleSampler(*shape, log_density, vectorize=True, moves=moves)
    walkers = start + 0.3 * rng.normal(size=shape)
    state = emcee.State(walkers, random_state=np.random.RandomState(1).get_state())
    sampler.run_mcmc(state, steps // 10, thin_by=10)
    draws = sampler.get_chain(flat=True, discard=steps // 50)
    return Moments(draws.mean(axis=0), draws.std(axis=0))


@pytest.mark.slow
def test_a_scale_for_every_circle() -> None:
    """45 hyper-parameters: evidence, means within 0.05 sd and sds within 3 % of the truth, and of a
    long run of plain emcee."""
    model = Circles(np.random.default_rng(5))
    log_integral, truth = model.truth()
    modes = modes_of(model.log_density, [np.concatenate([SHARED_START, np.zeros(40)])])
    sample = importance_sample(model.log_density, modes, tolerance=1e-2)
    assert sample.trusted
    assert sample.error <= 0.02
    assert sample.log_integral == pytest.approx(log_integral, abs=3.0 * sample.error + 1e-2)
    moments = weighted_moments(sample.free, sample.weight)
    walkers = plain_emcee(model.log_density, modes[0][0], 20_000)
    for expected in (truth, walkers):
        error = (moments.mean - expected.mean) / expected.sd
        np.testing.assert_allclose(error, 0.0, atol=0.05)
        np.testing.assert_allclose(moments.sd / expected.sd, 1.0, atol=0.03)


def test_every_point_of_a_lattice_has_a_key_of_its_own() -> None:
    for h in range(1, 6):
        rng = np.random.default_rng(h)
        points = np.unique(rng.integers(-1000, 1000, (5000, h)).astype(float), axis=0)
        assert len(np.unique(_grid_point_ids(points))) == len(points)
    origin_and_step = np.zeros((2, 5))
    origin_and_step[1, 4] = 256.0
    assert np.diff(_grid_point_ids(origin_and_step))[0]


@pytest.mark.slow
def test_what_cannot_be_trusted_says_so() -> None:
    sample = importance_sample(*case(student, 80, 0), tolerance=0.02, max_points=8192)
    assert (sample.trusted, sample.error) == (False, np.inf)


def test_a_second_try_has_another_seed() -> None:
    log_density, modes = case(student, 32, 0)
    for tries, trusted in ((1, False), (2, True)):
        sample = importance_sample(log_density, modes, max_points=512, seed=5, tries=tries)
        assert sample.trusted == trusted


def test_a_lattice_that_ran_out_of_nodes_has_a_larger_error() -> None:
    assert grow_lattice(*case(half_normals, 3, 0), tolerance=1e-6, max_nodes=2000).error > 1e-6


@pytest.mark.slow
@pytest.mark.parametrize(
    ("problem", "h", "seed"),
    [(funnel, 10, 0), (funnel, 10, 1), (funnel, 10, 2), (funnel, 20, 0)],
)
def test_an_integral_whose_weights_cannot_be_trusted_has_no_error(
    problem: Problem, h: int, seed: int
) -> None:
    """Nothing takes over silently: the error is infinite, also after multiplication."""
    log_density, modes = case(problem, h, seed)
    integral = integrate(log_density, modes, tolerance=0.02, seed=seed)

    def log_factor(index: Array) -> Array:
        return np.zeros(len(index))

    product = integral.times(log_factor, 1e-4)
    assert not integral.trusted
    assert (integral.error, product.error) == (np.inf, np.inf)


@pytest.mark.parametrize(
    ("problem", "h"),
    [(funnel, 5), (bananas, 6), (student, 14), pytest.param(student, 20, marks=pytest.mark.slow)],
)
def test_hard_integrals_lie_within_their_error(problem: Problem, h: int) -> None:
    """Means and widths of coordinates depend on others, or all tails are heavy at once."""
    log_density, modes = case(problem, h, 0)
    integral = importance_sample(log_density, modes, tolerance=0.02)
    assert integral.trusted
    assert error_ratio(integral) <= 3.0


def test_a_lattice_has_no_proposal() -> None:
    lattice = grow_lattice(*case(gaussian, 2, 0), tolerance=0.1)
    with pytest.raises(TypeError, match="a lattice has no proposal to draw from"):
        lattice.draw(10, np.random.default_rng(0))


@pytest.mark.slow
@pytest.mark.parametrize(("problem", "h"), [(log_gammas, 4), (two_modes, 2), (log_gammas, 8)])
def test_moments_and_draws(problem: Problem, h: int) -> None:
    """Means and sds of the nodes, and of draws weighted by density over proposal, are those of a
    long sample."""
    log_density, modes = case(problem, h, 3)
    long = importance_sample(log_density, modes, tolerance=1e-3, seed=9)
    expected = weighted_moments(long.free, long.weight)
    nodes = integrate(log_density, modes, tolerance=1e-2)
    sample = importance_sample(log_density, modes, tolerance=0.05)
    draws = sample.draw(20_000, np.random.default_rng(3))
    weight = np.exp(log_density(draws) - sample.log_proposal(draws))
    standard_error = weight.std() / np.sqrt(len(weight))
    assert weight.mean() == pytest.approx(1.0, abs=5.0 * standard_error + 1e-3)
    assert weight.sum() ** 2 / (weight**2).sum() > 0.4 * len(weight)
    of_nodes = weighted_moments(nodes.free, nodes.weight)
    of_draws = weighted_moments(draws, weight / weight.sum())
    for moments in (of_nodes, of_draws):
        error = (moments.mean - expected.mean) / expected.sd
        np.testing.assert_allclose(error, 0.0, atol=0.08)
        np.testing.assert_allclose(moments.sd / expected.sd, 1.0, atol=0.06)
    tempered = sample.draw(20_000, np.random.default_rng(3), temperature=2.0)
    assert np.all(tempered.std(axis=0) > 1.1 * draws.std(axis=0))


@pytest.mark.parametrize("h", [3, 8])
def test_points_are_picked_with_every_coordinate(h: int) -> None:
    log_density, modes = case(gaussian, h, 1)
    integral = integrate(log_density, modes, tolerance=1e-3)
    points = integral.resample(20_000, np.random.default_rng(0))
    assert np.cov(points.T).shape == (h, h)


@pytest.mark.parametrize("different", [3, 10_000])
def test_points_are_sorted_by_the_last_coordinate_then_by_earlier_ones(different: int) -> None:
    points = np.random.default_rng(1).integers(different, size=(200, 4)).astype(float)
    expected = sorted(range(200), key=lambda i: (*points[i, ::-1], i))
    assert _sorted_by_coordinates(points).tolist() == expected


@pytest.mark.parametrize("h", [3, 8])
def test_nodes_of_a_nearby_density(h: int) -> None:
    log_density, modes = case(gaussian, h, 1)
    plain = integrate(log_density, modes, tolerance=2e-3)

    def log_factor(index: Array) -> Array:
        return np.asarray(stats.norm.logcdf(plain.free[index, 0]))

    corrected = plain.times(log_factor, 1e-4)
    assert corrected.log_integral == pytest.approx(np.log(0.5), abs=3.0 * corrected.error)
    assert corrected.error < 0.02


@pytest.mark.parametrize("shape", [0.0, 0.3, 0.7])
def test_the_tail_of_weights_is_judged_as_arviz_does(shape: float) -> None:
    log_weight = np.log(stats.genpareto.rvs(shape, loc=1.0, size=4000, random_state=3))
    expected = float(arviz_stats.base.array_stats.psislw(-log_weight)[1])
    assert pareto_k(log_weight) == pytest.approx(expected, abs=0.02)
    assert pareto_k(np.zeros(100)) == -np.inf


def test_quantiles_of_student_t_are_those_of_scipy() -> None:
    level = np.concatenate([10.0 ** np.linspace(-15.0, -0.31, 400), [0.5]])
    for freedom in (3.0, 5.0, 9.0, 20.0):
        quantiles = _lower_quantiles(np.full(len(level), freedom), level)
        np.testing.assert_allclose(quantiles, stdtrit(freedom, level), rtol=1e-9, atol=1e-12)


def test_components_that_share_coordinates_have_the_density_of_their_own() -> None:
    sample = importance_sample(*case(banana, 6, 0), tolerance=0.1)
    proposal = sample.proposal
    assert isinstance(proposal, Mixture)
    apart = [
        np.log(share) + component.log_density(sample.free)
        for share, component in zip(proposal.share, proposal.components, strict=True)
    ]
    np.testing.assert_allclose(proposal.by_component(sample.free), apart, rtol=1e-12)


@pytest.mark.parametrize("h", [6, 16])
def test_a_sample_serves_for_a_similar_density(h: int) -> None:
    """The nodes of a normal density serve for one that is shifted and narrower."""

    def log_density(points: Array) -> Array:
        return -0.5 * (points**2).sum(axis=1)

    def similar(points: Array) -> Array:
        return -0.5 * ((points - 0.5) ** 2).sum(axis=1) / 0.81

    earlier = importance_sample(log_density, [(np.zeros(h), np.eye(h))], tolerance=0.01)
    weighted = replace(earlier, log_density=similar(earlier.free))
    sample = sample_similar(similar, weighted, tolerance=0.01)
    expected = h * (0.5 * np.log(2.0 * np.pi) + np.log(0.9))
    assert sample.error <= 0.01
    assert abs(sample.log_integral - expected) < 3.0 * sample.error


def test_a_lattice_does_not_serve_for_a_similar_density() -> None:
    log_density, modes = case(gaussian, 2, 0)
    with pytest.raises(TypeError, match="no proposal"):
        sample_similar(log_density, grow_lattice(log_density, modes))
