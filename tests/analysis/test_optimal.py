"""Textbook optima through the same code: polynomial, quadratic and 3 × 3 designs; gradients,
certificates, rounding."""

from __future__ import annotations

from itertools import combinations, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from ldbb_bayes.analysis.design.criteria import Criterion, Determinant, LogBayesFactor, Variance
from ldbb_bayes.analysis.design.objective import Objective
from ldbb_bayes.analysis.design.search import Search, efficient_rounding, exchange
from ldbb_bayes.analysis.design.shares import certificate, optimal_shares
from ldbb_bayes.model.gaussian import Gaussian

Array = NDArray[np.float64]
QUADRATIC = np.array([[1.0, 0.0, 1 / 3], [0.0, 1 / 3, 0.0], [1 / 3, 0.0, 1 / 5]])


def objective(rows: Array, criterion: Criterion, *, prior: float = 0.0) -> Objective:
    """One reading of unit variance per candidate."""
    p = rows.shape[-1]
    return Objective(rows.reshape(1, len(rows), -1, p), prior * np.eye(p)[None], p, criterion)


def polynomial(degree: int, x: Array) -> Array:
    return np.asarray(x[:, None] ** np.arange(degree + 1))


@pytest.mark.parametrize(
    ("degree", "points"),
    [
        (2, (-1.0, 0.0, 1.0)),
        (3, (-1.0, -(5**-0.5), 5**-0.5, 1.0)),
        (4, (-1.0, -((3 / 7) ** 0.5), 0.0, (3 / 7) ** 0.5, 1.0)),
    ],
)
def test_polynomial_d(degree: int, points: tuple[float, ...]) -> None:
    """Equal shares at the extrema of a Legendre polynomial, found on a fine grid that holds them;
    the bound is p."""
    x = np.union1d(np.linspace(-1.0, 1.0, 2001), points)
    optimum = optimal_shares(
        objective(polynomial(degree, x), Determinant(degree + 1)), 1.0, tolerance=1e-9
    )
    expected = np.where(np.isin(x, points), 1.0 / (degree + 1), 0.0)
    np.testing.assert_allclose(optimum.share, expected, atol=1e-6)
    assert optimum.bound == pytest.approx(degree + 1, abs=1e-6)
    assert abs(optimum.excess) < 1e-6


LINE = np.diag([1e-9, 1e-9, 1.0])
NONE = np.zeros((3, 3))


@pytest.mark.parametrize(
    ("criterion", "prior"),
    [
        (Variance(np.eye(3)), NONE),
        (Variance(QUADRATIC), NONE),
        *(
            (own, LINE)
            for own in (
                Variance(np.eye(1)),
                Determinant(1),
                LogBayesFactor(1.0),
                LogBayesFactor(0.3),
            )
        ),
    ],
    ids=["A", "I", "c", "D_s", "ln B", "ln B small"],
)
def test_a_quarter_a_half_a_quarter(criterion: Criterion, prior: Array) -> None:
    """A and I for a quadratic; its discrimination from a line, whatever increasing function of the
    information is asked for."""
    x = np.linspace(-1.0, 1.0, 201)
    wanted = Objective(
        polynomial(2, x)[None, :, None, :], prior[None], 1 if prior.any() else 3, criterion
    )
    optimum = optimal_shares(wanted, 50.0, tolerance=1e-9)
    np.testing.assert_allclose(
        optimum.share[[0, 100, 200]], (0.25, 0.5, 0.25), atol=1e-5 if prior.any() else 1e-6
    )
    assert optimum.excess < 1e-6


@pytest.mark.slow
def test_three_factors_in_fourteen_runs() -> None:
    """The D-optimal quadratic in 3 × 3 × 3 that AlgDesign's vignette lists (Wheeler): |M|^(1/10) =
    0.4630447 per run."""
    grid = np.array(list(product((-1.0, 0.0, 1.0), repeat=3)))
    pairs = [grid[:, i] * grid[:, j] for i, j in combinations(range(3), 2)]
    wanted = objective(np.column_stack([np.ones(27), grid, grid**2, *pairs]), Determinant(10))
    design = Search(wanted, np.arange(27.0), 1, 3).find_design(14)
    assert np.exp(design.value / 10.0) / 14.0 == pytest.approx(0.4630447, abs=5e-8)


@pytest.mark.parametrize(
    ("tests", "determinant"), [(6, 256), (7, 960), (8, 2304), (9, 5184), (10, 9360)]
)
def test_three_by_three(tests: int, determinant: float) -> None:
    """Exact D-optimal designs of the full quadratic on a 3 × 3 grid (Box and Draper 1971; Mitchell
    1974)."""
    a, b = (axis.ravel() for axis in np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]))
    wanted = objective(np.column_stack([np.ones(9), a, b, a * b, a**2, b**2]), Determinant(6))
    rng = np.random.default_rng(1)
    designs = [
        exchange(wanted, np.bincount(rng.integers(9, size=tests), minlength=9), rng)
        for _ in range(30)
    ]
    assert np.exp(max(value for _, value in designs)) == pytest.approx(determinant, rel=1e-9)
    assert all(counts.sum() == tests for counts, _ in designs)


def test_shares_for_extrapolating_a_line_are_those_of_elfving() -> None:
    """c-optimality for extrapolating a line from [−1, 1] to 2: shares 1/4 and 3/4 at the ends
    (Elfving 1952)."""
    x = np.linspace(-1.0, 1.0, 81)
    c = np.array([1.0, 2.0])
    optimum = optimal_shares(
        objective(polynomial(1, x), Variance(np.outer(c, c))), 1.0, tolerance=1e-8
    )
    np.testing.assert_allclose(optimum.share[[0, -1]], (0.25, 0.75), atol=1e-6)
    assert optimum.value == pytest.approx(-4.0, abs=1e-6)


def rows_of_two_planes(seed: int) -> np.ndarray:
    """Rows of seven candidates; not every candidate's readings depend on every parameter."""
    rows = np.random.default_rng(seed).standard_normal((2, 7, 4, 5))
    rows[:, :3, :, 0] = 0.0
    rows[:, 3:, :, 1] = 0.0
    rows[:, 5, :, 2] = 0.0
    return rows


@pytest.mark.parametrize(
    "criterion",
    [Determinant(3), Variance(np.diag([1.0, 2.0, 0.5])), LogBayesFactor(0.7)],
    ids=lambda c: type(c).__name__,
)
def test_sensitivities_are_derivatives(criterion: Criterion) -> None:
    """∂Φ/∂n_i against central differences, nuisances and several hyper-parameters included."""
    rows = rows_of_two_planes(3)
    wanted = Objective(rows, np.array([np.eye(5), 2.0 * np.eye(5)]), 3, criterion)
    counts = np.random.default_rng(3).random(7) + 0.2
    value, slope = wanted.sensitivity(counts)
    assert value == pytest.approx(wanted.value(counts), rel=1e-12)
    step = 1e-6 * np.eye(7)
    numeric = [(wanted.value(counts + h) - wanted.value(counts - h)) / 2e-6 for h in step]
    np.testing.assert_allclose(slope, numeric, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("interest", [2, 5])
@pytest.mark.parametrize("known_before", [True, False])
@pytest.mark.parametrize(
    "criterion", [Determinant(2), Variance(np.diag([1.0, 3.0])), LogBayesFactor(1.0)]
)
def test_one_more_test_against_dense_precision(
    criterion: Criterion, interest: int, *, known_before: bool
) -> None:
    """Φ with one more test of each candidate, from S = (M⁻¹)_ss⁻¹ of the whole precision M; with
    nuisance parameters and without, with a proper prior and with a flat one."""
    if isinstance(criterion, Variance):
        criterion = Variance(np.diag(np.arange(1.0, interest + 1.0)))
    rows = rows_of_two_planes(4)
    prior = np.array([np.eye(5), 2.0 * np.eye(5)]) if known_before else np.zeros((2, 5, 5))
    counts = np.array([1.0, 0.0, 2.0, 0.0, 0.0, 1.0, 0.0])
    chosen = np.array([6, 1, 2])
    scores = Objective(rows, prior, interest, criterion).after_adding(counts, chosen)
    for added, value in zip(chosen, scores, strict=True):
        runs = counts.copy()
        runs[added] += 1.0
        expected = []
        for k in range(2):
            information = sum(n * g.T @ g for n, g in zip(runs, rows[k], strict=True))
            covariance = np.linalg.inv(prior[k] + information)[-interest:, -interest:]
            expected.append(criterion.value(np.linalg.cholesky(np.linalg.inv(covariance))))
        assert value == pytest.approx(np.mean(expected), rel=1e-10)


def test_expected_log_bayes_factor_by_simulation() -> None:
    """Φ of `LogBayesFactor` is half the difference of mean ln B with and without the slopes, by
    dense evidences."""
    rng = np.random.default_rng(5)
    rows = rng.standard_normal((8, 3))
    expected = Objective(rows[None, :, None, :], np.eye(3)[None], 2, LogBayesFactor(1.0)).value(
        np.ones(8)
    )
    full = Gaussian.of(np.zeros(8), rows @ rows.T + np.eye(8))
    reduced = Gaussian.of(np.zeros(8), rows[:, :1] @ rows[:, :1].T + np.eye(8))
    samples = [truth.draw(rng, (20_000,)) for truth in (full, reduced)]
    with_, without = (full.log_density(y) - reduced.log_density(y) for y in samples)
    spread = np.hypot(with_.std(), without.std()) / np.sqrt(len(with_))
    assert expected == pytest.approx(0.5 * (with_.mean() - without.mean()), abs=2.0 * spread)


@given(st.integers(1, 40), st.lists(st.floats(0.01, 1.0), min_size=1, max_size=12))
def test_rounding(tests: int, weights: list[float]) -> None:
    share = np.array(weights) / sum(weights)
    counts = efficient_rounding(share, tests)
    assert counts.sum() == tests
    assert (counts >= 0).all()
    if tests >= len(share):
        assert np.all(counts <= np.ceil((tests + 0.5 * len(share)) * share) + 1)


@pytest.mark.parametrize("half_distance", [1.0, 100.0])
def test_neighbouring_forces_are_one_where_that_costs_nothing(half_distance: float) -> None:
    """A parabola's middle is split over levels beside it, 2 N or 200 N apart: the first are run at
    one of them."""
    forces = np.array([100.0, 500.0 - half_distance, 500.0 + half_distance, 900.0])
    wanted = objective(polynomial(2, (forces - 500.0) / 400.0), Determinant(3))
    best = max(
        wanted.value(np.array(counts, dtype=float))
        for counts in ((2, 1, 1, 2), (2, 2, 0, 2), (2, 0, 2, 2))
    )
    design = Search(wanted, forces, 1, 1).find_design(6)
    assert bool(design.counts[1] and design.counts[2]) is (half_distance == 100.0)
    assert np.exp((design.value - best) / 3.0) >= 1.0 - 1e-4


@pytest.mark.parametrize(
    ("forces", "counts"),
    [((1000.0, 1000.5, 2000.0), (3, 0, 0)), ((1000.0, 1000.8, 1001.6), (0, 3, 0))],
)
def test_a_start_has_tests_at_forces_that_count_as_different(
    forces: tuple[float, ...], counts: tuple[int, ...]
) -> None:
    """Forces within 0.1 % are one force."""
    forces_N = np.array(forces)
    search = Search(objective(polynomial(1, forces_N), Determinant(2)), forces_N, 2, 1)
    for seed in range(20):
        start = search._at_enough_forces(np.array(counts), np.random.default_rng(seed))
        assert start.sum() == 3
        assert search._is_feasible(start)


def test_a_wrong_design_has_no_certificate() -> None:
    x = np.linspace(-1.0, 1.0, 21)
    wanted = objective(polynomial(2, x), Determinant(3))
    assert certificate(wanted, np.full(21, 1 / 21), 1.0).excess > 0.5


@pytest.mark.parametrize("nudge", [0.0, 1e-12, -1e-12])
def test_too_few_points_are_seen_whatever_the_rounding(nudge: float) -> None:
    """Two points do not determine a parabola, also where rounding leaves the matrix positive
    definite."""
    x = np.array([-1.0, 1.0 / 3.0, 1.0 / 3.0 + nudge, 1.0])
    wanted = objective(polynomial(2, x), Determinant(3))
    assert wanted.value(np.array([1.0, 2.0, 1.0, 0.0])) == -np.inf
    assert np.isfinite(wanted.value(np.array([1.0, 0.0, 1.0, 1.0])))


@pytest.mark.parametrize("criterion", [Determinant(3), Variance(np.diag([1.0, 2.0, 3.0]))])
def test_half_as_many_runs_have_half_the_efficiency(criterion: Criterion) -> None:
    """Without a prior, information grows with the number of runs of every test."""
    precision = QUADRATIC + np.eye(3)
    half, whole = (criterion.value(np.linalg.cholesky(runs * precision)) for runs in (1.0, 2.0))
    assert criterion.efficiency(float(half), float(whole)) == pytest.approx(0.5)
