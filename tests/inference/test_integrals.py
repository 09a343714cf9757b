"""Plain integrals on ℝ^h against closed forms: the stated error must cover, in one dimension and in
45."""

from __future__ import annotations

from collections.abc import Callable

import arviz_stats.base
import emcee
import numpy as np
import pytest
from scipy import stats
from scipy.special import gammaln

from ldbb_bayes.inference.diagnostics import pareto_k
from ldbb_bayes.inference.importance_sampling import importance_sample
from ldbb_bayes.inference.integrals import Integral
from ldbb_bayes.inference.lattice import _keys, grow_lattice
from ldbb_bayes.inference.quadrature import integrate
from ldbb_bayes.model.newton import central_differences, newton

Array = np.ndarray
LogDensity = Callable[[Array], Array]
Problem = Callable[[np.random.Generator, int], tuple[LogDensity, list[Array]]]


def turned(rng: np.random.Generator, h: int, size: float = 0.3) -> tuple[Array, float]:
    """A matrix not far from diagonal and ln of its determinant."""
    matrix = np.diag(np.exp(0.5 * rng.normal(size=h))) @ (
        np.eye(h) + size * rng.normal(size=(h, h)) / np.sqrt(h)
    )
    return np.linalg.inv(matrix), float(np.linalg.slogdet(matrix)[1])


def gaussian(rng: np.random.Generator, h: int) -> tuple[LogDensity, list[Array]]:
    inverse, log_det = turned(rng, h, 1.0)
    return lambda x: stats.norm.logpdf(x @ inverse.T).sum(axis=1) - log_det, [np.zeros(h)]


def log_gammas(rng: np.random.Generator, h: int) -> tuple[LogDensity, list[Array]]:
    inverse, log_det = turned(rng, h)
    shape = np.exp(rng.uniform(-0.3, 1.8, h))
    sign = rng.choice([-1.0, 1.0], h)

    def log_density(x: Array) -> Array:
        y = sign * (x @ inverse.T)
        return (shape * y - np.exp(np.minimum(y, 500.0)) - gammaln(shape)).sum(axis=1) - log_det

    return log_density, [np.linalg.solve(inverse, sign * np.log(shape))]


def half_normals(rng: np.random.Generator, h: int) -> tuple[LogDensity, list[Array]]:
    """Logarithms of scales, some near zero: e^(ax) on the left, doubly exponential on the right."""
    power = rng.uniform(1.0, 8.0, h)
    rate = np.exp(rng.normal(size=h))
    constant = (gammaln(power / 2.0) - 0.5 * power * np.log(rate) - np.log(2.0)).sum()
    mode = 0.5 * np.log(power / (2.0 * rate))
    return (
        lambda x: (power * x - rate * np.exp(np.minimum(2.0 * x, 500.0))).sum(axis=1) - constant,
        [mode],
    )


def students(rng: np.random.Generator, h: int) -> tuple[LogDensity, list[Array]]:
    inverse, log_det = turned(rng, h)
    freedom = rng.uniform(5.0, 15.0)
    return lambda x: stats.t.logpdf(x @ inverse.T, freedom).sum(axis=1) - log_det, [np.zeros(h)]


def banana(rng: np.random.Generator, h: int) -> tuple[LogDensity, list[Array]]:
    bend = rng.uniform(0.1, 0.25)

    def log_density(x: Array) -> Array:
        straight = np.concatenate(
            [x[:, :-1], x[:, -1:] - bend * (x[:, :1] ** 2 - 1.0) * (h > 1)], axis=1
        )
        return stats.norm.logpdf(straight).sum(axis=1)

    return log_density, [np.zeros(h)]


def two_modes(rng: np.random.Generator, h: int) -> tuple[LogDensity, list[Array]]:
    apart = rng.normal(size=h)
    share = rng.uniform(0.2, 0.8)
    apart *= rng.uniform(2.0, 3.0) / np.linalg.norm(apart)

    def log_density(x: Array) -> Array:
        one, other = (stats.norm.logpdf(x - centre).sum(axis=1) for centre in (apart, -apart))
        return np.logaddexp(np.log(share) + one, np.log1p(-share) + other)

    return log_density, [apart, -apart]


PROBLEMS = [gaussian, log_gammas, half_normals, students, banana, two_modes]


def student(rng: np.random.Generator, h: int) -> tuple[LogDensity, list[Array]]:
    """In all directions at once: no product of one-dimensional tails fits it."""
    constant = gammaln(4.0 + 0.5 * h) - gammaln(4.0) - 0.5 * h * np.log(8.0 * np.pi)
    return lambda x: constant - (4.0 + 0.5 * h) * np.log1p((x**2).sum(axis=1) / 8.0), [np.zeros(h)]


def bananas(rng: np.random.Generator, h: int) -> tuple[LogDensity, list[Array]]:
    bend = rng.uniform(0.5, 0.7)

    def log_density(x: Array) -> Array:
        return stats.norm.logpdf(
            np.hstack([x[:, ::2], x[:, 1::2] - bend * (x[:, ::2] ** 2 - 1.0)])
        ).sum(axis=1)

    return log_density, [np.zeros(h)]


def funnel(rng: np.random.Generator, h: int) -> tuple[LogDensity, list[Array]]:
    """The first coordinate is ln of the variance of the others (Neal, Annals of Statistics 31,
    705-767, 2003)."""

    def log_density(x: Array) -> Array:
        others = stats.norm.logpdf(x[:, 1:] * np.exp(-0.5 * x[:, :1])) - 0.5 * x[:, :1]
        return np.asarray(stats.norm.logpdf(x[:, 0]) + others.sum(axis=1))

    return log_density, [np.zeros(h)]


def modes_of(log_density: LogDensity, starts: list[Array]) -> list[tuple[Array, Array]]:
    modes = []
    for start in starts:
        mode = newton(
            log_density, lambda point: central_differences(log_density, point, 0.05), start
        )
        curvature, vectors = np.linalg.eigh(-central_differences(log_density, mode, 0.05)[1])
        modes.append((mode, vectors / np.sqrt(np.maximum(curvature, 0.1))))
    return sorted(modes, key=lambda own: -float(log_density(own[0][None])[0]))


def case(problem: Problem, h: int, seed: int) -> tuple[LogDensity, list[tuple[Array, Array]]]:
    log_density, starts = problem(np.random.default_rng([h, seed]), h)
    return log_density, modes_of(log_density, starts)


def few_exceptions(found: list[Integral], tolerance: float) -> None:
    """The truth is ln 1."""
    trusted = [own for own in found if own.trusted]
    ratio = np.array([abs(own.log_integral) / (own.error + 1e-9) for own in trusted])
    assert len(trusted) >= 0.97 * len(found)
    assert np.mean(ratio <= 3.0) >= 0.99, np.sort(ratio)[-6:]
    assert np.mean([own.error <= tolerance for own in trusted]) >= 0.95
    assert np.median(ratio) > 0.02, "an error a hundred times too large is no error"


@pytest.mark.parametrize(
    ("problems", "dimensions", "seeds"),
    [
        (PROBLEMS, (1, 2, 4, 6, 9), 1),
        pytest.param(PROBLEMS, (1, 2, 4, 6, 9, 14), 9, marks=pytest.mark.slow),
        pytest.param(
            [own for own in PROBLEMS if own is not students], (45,), 4, marks=pytest.mark.slow
        ),
    ],
)
def test_the_error_of_a_sample_covers(
    problems: list[Problem], dimensions: tuple[int, ...], seeds: int
) -> None:
    cases = [
        case(problem, h, seed) for problem in problems for h in dimensions for seed in range(seeds)
    ]
    few_exceptions(
        [importance_sample(*own, tolerance=0.02, seed=k) for k, own in enumerate(cases)], 0.02
    )


@pytest.mark.parametrize("tolerance", [0.1, 1e-2, 1e-4])
def test_the_error_of_a_lattice_covers(tolerance: float) -> None:
    cases = [
        case(problem, h, seed)
        for problem in PROBLEMS
        for h in (1, 2, 3)
        for seed in range(3 if tolerance < 1e-3 else 6)
    ]
    few = [own for own in cases if tolerance > 1e-3 or own[1][0][0].size < 3]
    found = [grow_lattice(*own, tolerance=tolerance) for own in few]
    ratio = np.array([abs(own.log_integral) / (own.error + 1e-9) for own in found])
    assert np.mean(ratio <= 3.0) >= 0.99, np.sort(ratio)[-6:]
    assert all(own.error <= tolerance for own in found)


class Circles:
    """Forty circles, a scale λ each with λ² ~ InvGamma(3/2, 3/2), half-normal σ, δ, κ, τ, and p of
    the form: given the shared ones circles are independent, so that the truth is a lattice over
    five dimensions of products of one-dimensional sums."""

    orders = np.repeat(np.arange(1.0, 13.0), 2)
    grid = np.linspace(-2.5, 3.5, 121)

    def __init__(self, rng: np.random.Generator, circles: int = 40) -> None:
        scale = np.exp(
            -0.5 * np.log(stats.gamma.rvs(1.5, scale=1.0 / 1.5, size=circles, random_state=rng))
        )
        sd = np.sqrt(self._variance(np.log([[0.6, 0.8, 0.7]]), np.log(scale))[0])
        self.square = (
            ((rng.normal(size=(circles, 24)) * sd) ** 2).reshape(circles, 12, 2).sum(axis=2)
        )
        self.noise = stats.chi2.rvs(20 * circles, random_state=rng) * 0.6**2 / (20 * circles)
        self.form = (rng.normal(size=22) * 1.2 * (self.orders[2:] / 6.0) ** -2.0) ** 2

    def _variance(self, shared: Array, log_scale: Array) -> Array:
        """Of every harmonic, shape (w, …, 24)."""
        lead = (slice(None), None, None)
        sigma, delta, kappa = (np.exp(2.0 * shared[:, k])[lead] for k in range(3))
        own = np.where(self.orders == 1.0, delta, kappa / self.orders**2)
        return sigma / 10.0 + own * np.exp(2.0 * log_scale)[..., None]

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
        prior = (scales - 0.5 * np.exp(2.0 * scales)).sum(axis=1) - 0.5 * ((power - 2.0) / 0.7) ** 2
        log_form = 2.0 * (tau[:, None] - power[:, None] * np.log(self.orders[2:] / 6.0))
        form = -0.5 * (log_form + self.form * np.exp(-log_form)).sum(axis=1)
        return np.asarray(prior + form - dof * (sigma + 0.5 * self.noise * np.exp(-2.0 * sigma)))

    def log_density(self, x: Array) -> Array:
        return self.of_shared(x[:, :5]) + self.of_circles(x[:, :5], x[:, 5:], self.square).sum(
            axis=1
        )

    def truth(self) -> tuple[float, Array, Array]:
        """ln of the integral, means and sds, each (45,)."""
        step = self.grid[1] - self.grid[0]

        def integrated(shared: Array) -> Array:
            total = self.of_shared(shared)
            for square in self.square:
                total = (
                    total
                    + np.logaddexp.reduce(self.of_circles(shared, self.grid, square), axis=1)
                    + np.log(step)
                )
            return total

        lattice = grow_lattice(
            integrated,
            modes_of(integrated, [np.array([-0.5, -0.3, -0.4, 0.1, 2.0])]),
            tolerance=1e-2,
        )
        shared, weight = lattice.heaviest(1e-3)
        moments = [[weight @ shared[:, k], weight @ shared[:, k] ** 2] for k in range(5)]
        for square in self.square:
            values = self.of_circles(shared, self.grid, square)
            own = np.exp(values - np.logaddexp.reduce(values, axis=1, keepdims=True))
            moments.append([weight @ own @ self.grid, weight @ own @ self.grid**2])
        first, second = np.array(moments).T
        return lattice.log_integral, first, np.sqrt(second - first**2)


def plain_emcee(log_density: LogDensity, start: Array, steps: int) -> tuple[Array, Array]:
    """Means and sds of walkers that know nothing but the density and where to start."""
    rng = np.random.default_rng(1)
    shape = (4 * len(start), len(start))
    moves = [(emcee.moves.DEMove(), 0.9), (emcee.moves.DEMove(gamma0=1.0), 0.1)]
    sampler = emcee.EnsembleSampler(*shape, log_density, vectorize=True, moves=moves)
    state = emcee.State(
        start + 0.3 * rng.normal(size=shape), random_state=np.random.RandomState(1).get_state()
    )
    sampler.run_mcmc(state, steps // 10, thin_by=10)
    kept = sampler.get_chain(flat=True, discard=steps // 50)
    return kept.mean(axis=0), kept.std(axis=0)


@pytest.mark.slow
def test_a_scale_for_every_circle() -> None:
    """45 hyper-parameters: evidence, means within 0.05 sd and sds within 3 % of the truth, and of a
    long run of plain emcee."""
    model = Circles(np.random.default_rng(5))
    log_integral, *truth = model.truth()
    modes = modes_of(
        model.log_density, [np.concatenate([[-0.5, -0.3, -0.4, 0.1, 2.0], np.zeros(40)])]
    )
    found = importance_sample(model.log_density, modes, tolerance=1e-2)
    own = found.weight @ found.free
    assert found.trusted
    assert found.error <= 0.02
    assert found.log_integral == pytest.approx(log_integral, abs=3.0 * found.error + 1e-2)
    for mean, sd in (truth, plain_emcee(model.log_density, modes[0][0], 20_000)):
        np.testing.assert_allclose((own - mean) / sd, 0.0, atol=0.05)
        np.testing.assert_allclose(
            np.sqrt(found.weight @ (found.free - own) ** 2) / sd, 1.0, atol=0.03
        )


def test_every_point_of_a_lattice_has_a_key_of_its_own() -> None:
    for h in range(1, 6):
        points = np.unique(
            np.random.default_rng(h).integers(-1000, 1000, (5000, h)).astype(float), axis=0
        )
        assert len(np.unique(_keys(points))) == len(points)
    assert np.diff(_keys(np.array([[0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 256.0]])))[0]


def test_what_cannot_be_trusted_says_so() -> None:
    found = importance_sample(*case(student, 45, 0), tolerance=0.02, max_points=8192)
    assert (found.trusted, found.error) == (False, np.inf)
    again = [
        importance_sample(*case(student, 26, 0), max_points=512, seed=2, tries=tries).trusted
        for tries in (1, 2)
    ]
    assert again == [False, True], "another seed"
    assert grow_lattice(*case(half_normals, 3, 0), tolerance=1e-6, max_nodes=2000).error > 1e-6


HARD = [
    pytest.param(own, h, seed, marks=pytest.mark.slow)
    for own, h in ((student, 20), (bananas, 20), (funnel, 10))
    for seed in range(3)
]


@pytest.mark.parametrize(("problem", "h", "seed"), [(funnel, 6, 0), *HARD])
def test_an_integral_whose_weights_cannot_be_trusted_has_no_error(
    problem: Problem, h: int, seed: int
) -> None:
    """Nothing takes over silently: the error is infinite, also after multiplication."""
    log_density, modes = case(problem, h, seed)
    integral = integrate(log_density, modes, tolerance=0.02, seed=seed)
    product = integral.times(lambda index: np.zeros(len(index)), 1e-4)
    assert not integral.trusted
    assert (integral.error, product.error) == (np.inf, np.inf)


def test_a_lattice_has_no_proposal() -> None:
    lattice = grow_lattice(*case(gaussian, 2, 0), tolerance=0.1)
    with pytest.raises(TypeError, match="a lattice has no proposal to draw from"):
        lattice.draw(10, np.random.default_rng(0))


@pytest.mark.parametrize(("problem", "h"), [(log_gammas, 4), (two_modes, 2), (log_gammas, 8)])
def test_moments_and_draws(problem: Problem, h: int) -> None:
    """Means and sds of the nodes, and of draws weighted by density over proposal, are those of a
    long sample."""
    log_density, modes = case(problem, h, 3)
    long = importance_sample(log_density, modes, tolerance=1e-3, seed=9)
    mean = long.weight @ long.free
    sd = np.sqrt(long.weight @ (long.free - mean) ** 2)
    found = integrate(log_density, modes, tolerance=1e-2)
    sample = importance_sample(log_density, modes, tolerance=0.05)
    draws = sample.draw(20_000, np.random.default_rng(3))
    weight = np.exp(log_density(draws) - sample.log_proposal(draws))
    assert weight.mean() == pytest.approx(1.0, abs=5.0 * weight.std() / np.sqrt(len(weight)) + 1e-3)
    assert weight.sum() ** 2 / (weight**2).sum() > 0.4 * len(weight)
    for points, own in ((found.free, found.weight), (draws, weight / weight.sum())):
        np.testing.assert_allclose((own @ points - mean) / sd, 0.0, atol=0.08)
        np.testing.assert_allclose(np.sqrt(own @ (points - own @ points) ** 2) / sd, 1.0, atol=0.06)
    assert np.all(
        sample.draw(20_000, np.random.default_rng(3), temperature=2.0).std(axis=0)
        > 1.1 * draws.std(axis=0)
    )


def test_nodes_of_a_nearby_density() -> None:
    for h in (3, 8):
        log_density, modes = case(gaussian, h, 1)
        covariance = np.cov(
            integrate(log_density, modes, tolerance=1e-3).pick(20_000, np.random.default_rng(0)).T
        )
        plain = integrate(log_density, modes, tolerance=2e-3)
        corrected = plain.times(
            lambda index, plain=plain: stats.norm.logcdf(plain.free[index, 0]), 1e-4
        )  # type: ignore[misc]
        assert covariance.shape == (h, h)
        assert corrected.log_integral == pytest.approx(np.log(0.5), abs=3.0 * corrected.error)
        assert corrected.error < 0.02


@pytest.mark.parametrize("shape", [0.0, 0.3, 0.7])
def test_the_tail_of_weights_is_judged_as_arviz_does(shape: float) -> None:
    log_weight = np.log(stats.genpareto.rvs(shape, loc=1.0, size=4000, random_state=3))
    expected = float(arviz_stats.base.array_stats.psislw(-log_weight)[1])
    assert pareto_k(log_weight) == pytest.approx(expected, abs=0.02)
    assert pareto_k(np.zeros(100)) == -np.inf
