"""Elimination by a tree against dense algebra, on random patterns and on campaigns."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from scipy.stats import multivariate_normal

import ldbb_bayes as lb
from ldbb_bayes.campaign.campaign import Campaign, CircularTest
from ldbb_bayes.model.elimination import DesignRows, Elimination
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.likelihood import StructuredGaussian
from ldbb_bayes.model.ordering import elimination_groups, heights

KINDS = 5
PHI = 8


@dataclass(frozen=True)
class Problem:
    """Rows with a random pattern, each coefficient with a prior; some priors are negative."""

    columns: np.ndarray
    values: np.ndarray
    kinds: np.ndarray
    signs: np.ndarray
    weight: np.ndarray
    shift: np.ndarray
    shared: int

    @property
    def design(self) -> DesignRows:
        return DesignRows(
            self.columns, self.values, self.kinds, signs=self.signs, shared=self.shared
        )

    def precision(self, k: int) -> np.ndarray:
        return self.columns.T @ (self.weight[self.kinds, k, None] * self.columns)

    def right_side(self, k: int) -> np.ndarray:
        weighted = self.weight[self.kinds, k] * self.values
        return self.columns.T @ weighted + self.shift[:, k]


def random_problem(seed: int, *, size: int, density: float, negative: int = 0) -> Problem:
    """``size`` columns, of which the last ``negative`` ones have priors of negative variance."""
    rng = np.random.default_rng(seed)
    readings = 3 * size
    block = rng.normal(size=(readings, size)) * (rng.random((readings, size)) < density)
    signs = np.ones(size)
    weight = np.exp(rng.normal(size=(KINDS + 1 + bool(negative), PHI)))
    if negative:
        # The precision is still determined: what removes noise is small beside it.
        signs[-negative:] = -1.0
        block[:, -negative:] *= 0.02
        weight[KINDS + 1] *= -1.0
    prior_kinds = np.where(signs > 0.0, KINDS, KINDS + 1)
    return Problem(
        columns=np.concatenate([block, np.eye(size)]),
        values=rng.normal(size=readings + size),
        kinds=np.concatenate([rng.integers(0, KINDS, readings), prior_kinds]),
        signs=signs,
        weight=weight,
        shift=rng.normal(size=(size, PHI)),
        shared=size - negative,
    )


PROBLEMS = {
    "one column": random_problem(0, size=1, density=1.0),
    "diagonal": random_problem(1, size=30, density=0.0),
    "sparse": random_problem(2, size=40, density=0.02),
    "less sparse": random_problem(3, size=60, density=0.05),
    "dense": random_problem(4, size=25, density=1.0),
    "large and dense": random_problem(7, size=70, density=1.0),
    "negative": random_problem(5, size=40, density=0.04, negative=6),
    "dense and negative": random_problem(6, size=25, density=0.8, negative=4),
}


@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.parametrize("last", [0, 1, 7, 19])
def test_every_pattern_against_dense_algebra(name: str, last: int) -> None:
    problem = PROBLEMS[name]
    last = min(last, problem.shared)
    elimination = problem.design.elimination(last)
    workspace, gain = elimination.factorize(problem.weight, problem.shift)
    solution = elimination.solve(workspace)
    lower = np.zeros((last, last, PHI))
    white = np.empty((last, PHI))
    wanted = np.arange(problem.shared - last, problem.shared)
    elimination.copy_factor(workspace, wanted, lower=lower, white_shift=white)
    for k in range(PHI):
        precision = problem.precision(k)
        right = problem.right_side(k)
        mean = np.linalg.solve(precision, right)
        log_determinant = np.linalg.slogdet(precision)[1]
        assert gain[k] == pytest.approx(0.5 * right @ mean - 0.5 * log_determinant, rel=1e-10)
        np.testing.assert_allclose(solution[:, k], mean, rtol=1e-8, atol=1e-10)
        marginal = np.linalg.inv(precision)[np.ix_(wanted, wanted)]
        root = np.linalg.cholesky(np.linalg.inv(marginal))
        np.testing.assert_allclose(lower[:, :, k].T, root, rtol=1e-8, atol=1e-10)
        np.testing.assert_allclose(root.T @ mean[wanted], white[:, k], rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("name", PROBLEMS)
def test_every_column_is_in_one_group_and_the_last_ones_keep_their_order(name: str) -> None:
    pattern = PROBLEMS[name].columns != 0.0
    size = pattern.shape[1]
    last = np.arange(size - min(9, size), size)
    groups = elimination_groups(pattern, last)
    order = np.concatenate([group.columns for group in groups])
    assert sorted(order) == list(range(size))
    place = np.argsort(order)
    for group in groups:
        members = np.concatenate([group.columns, group.border])
        assert (np.diff(place[members]) > 0).all()
        in_last = members[np.isin(members, last)]
        assert (np.diff(in_last) > 0).all()
    for first, second in pairwise(last):
        if pattern[:, [first, second]].all(axis=1).any():
            assert place[first] < place[second]


def test_a_group_is_higher_than_those_it_depends_on() -> None:
    groups = elimination_groups(PROBLEMS["less sparse"].columns != 0.0, np.arange(0))
    height_of = {}
    for group, height in zip(groups, heights(groups), strict=True):
        for column in group.columns:
            height_of[column] = height
    for group in groups:
        for column in group.border:
            assert height_of[column] > height_of[group.columns[0]]


def test_blocks_that_have_no_row_in_common_are_eliminated_together() -> None:
    """Twelve equal blocks are one front, and cost what their own columns cost."""
    problem = random_problem(0, size=4, density=1.0)
    columns = np.kron(np.eye(12), problem.columns)
    design = DesignRows(
        columns,
        np.tile(problem.values, 12),
        np.tile(problem.kinds, 12),
        signs=np.ones(48),
        shared=48,
    )
    elimination = design.elimination(0)
    assert [front.shape for front in elimination.plan.fronts] == [(12, 4, 5)]
    _, gain = elimination.factorize(problem.weight, np.tile(problem.shift, (12, 1)))
    _, expected = problem.design.elimination(0).factorize(problem.weight, problem.shift)
    np.testing.assert_allclose(gain, 12.0 * expected, rtol=1e-12)


@pytest.mark.parametrize(("name", "dense"), [("less sparse", 0), ("large and dense", 18)])
def test_gram_entries_without_zeros_are_dense(name: str, dense: int) -> None:
    """Four columns of the one group at a time."""
    elimination = PROBLEMS[name].design.elimination(0)
    assert len(elimination._gram._dense) == dense
    assert (elimination._gram._sparse.nnz == 0) == (dense > 0)


def test_designs_with_zeros_in_the_same_places_share_their_plan() -> None:
    problem = PROBLEMS["sparse"]
    other = replace(problem, columns=2.0 * problem.columns)
    plan = problem.design.elimination(7).plan
    assert other.design.elimination(7).plan is plan


def test_plans_differ_where_other_columns_are_eliminated_last() -> None:
    design = PROBLEMS["sparse"].design
    assert design.elimination(7).plan is not design.elimination(0).plan


def test_a_coefficient_without_reading_and_prior_is_refused() -> None:
    design = DesignRows(
        np.array([[1.0, 0.0]]), np.ones(1), np.zeros(1, dtype=int), signs=np.ones(2), shared=2
    )
    with pytest.raises(np.linalg.LinAlgError, match="must determine every coefficient"):
        design.elimination(0).factorize(np.ones((1, 8)), None)


# ---- campaigns

FORCES_N = (100.0, 400.0, 700.0)
ANGLE = np.arange(30) * 12.0
ALL_PLANES = ("XY", "YZ", "ZX")


def campaign(
    planes: tuple[str, ...] = ("XY",),
    *,
    directions: tuple[str, ...] = ("CW",),
    radii_mm: tuple[float, ...] = (150.0,),
    work_deg: tuple[float, ...] = (0.0,),
    angle: np.ndarray = ANGLE,
) -> Campaign:
    tests = []
    for plane in planes:
        for radius in radii_mm:
            for force in FORCES_N:
                for direction in directions:
                    for turn in work_deg:
                        tests.append(
                            CircularTest(
                                force,
                                angle,
                                plane=plane,
                                direction=direction,
                                radius_mm=radius,
                                work_ball_deg=turn,
                            )
                        )
    if planes == ("XY",):
        return Campaign(tuple(tests))
    frames = {"X": (5.0, -40.0, 60.0), "Y": (0.0, 10.0, -200.0)}
    return Campaign(tuple(tests), topology="wXFYZt", frames_mm=frames)


CAMPAIGNS = {
    "one plane": campaign(),
    "one plane, both directions": campaign(directions=("CW", "CCW")),
    "one plane, two radii": campaign(radii_mm=(150.0, 100.0)),
    "one plane, clocked": campaign(work_deg=(0.0, 45.0)),
    "one plane, arcs": campaign(angle=np.linspace(0.0, 220.0, 40)),
    "one plane, gaps": campaign(angle=np.linspace(0.0, 356.0, 75)),
    "two planes": campaign(("XY", "YZ")),
    "three planes": campaign(ALL_PLANES),
    "three planes, both directions": campaign(ALL_PLANES, directions=("CW", "CCW")),
    "three planes, two radii": campaign(ALL_PLANES, radii_mm=(150.0, 100.0)),
    "three planes, clocked": campaign(ALL_PLANES, work_deg=(0.0, 45.0)),
}


def bound_to(name: str) -> BoundModel:
    model = lb.HybridModel.default(1)
    return model.bind(model.simulate(CAMPAIGNS[name], seed=1).campaign)


def scales(bound: BoundModel) -> np.ndarray:
    """Three values of the hyper-parameters."""
    rng = np.random.default_rng(0)
    typical = {"sigma": 3e-4, "delta": 5e-4, "kappa": 3e-4, "tau": 1e-3, "omega": 1e-3}
    typical["eta"] = 1e-3
    centre = [typical.get(str(name), 1.0) for name in bound.hyper_prior.names]
    return np.exp(rng.normal(np.log(centre), 0.3, (3, len(centre))))


class Moments(NamedTuple):
    """Mean and covariance of all coefficients."""

    mean: np.ndarray
    covariance: np.ndarray


class Dense:
    """The covariance of all rows that are readings, and no precision.

    Coefficients with the covariance Λ and noise with the covariance D give A Λ Aᵀ + D.
    """

    def __init__(self, gaussian: StructuredGaussian, phi: np.ndarray, tests: int) -> None:
        design = gaussian._design
        weight = next(gaussian._batches(phi[None], None, 1)).weight[:, 0]
        variance = 1.0 / weight[design._kinds]
        size = len(design._signs)
        readings = len(variance) - size
        np.testing.assert_array_equal(design._columns[readings:], np.eye(size))
        self.columns = design._columns[:readings]
        self.prior_variance = variance[readings:]
        self.prior_mean = design._values[readings:]
        # The last row of each test stands for what its Fourier series cannot describe.
        self.norms = np.arange(1, tests + 1) * (readings // tests) - 1
        np.testing.assert_array_equal(self.columns[self.norms], 0.0)
        self.residual = design._values[:readings] - self.columns @ self.prior_mean
        self.noise = variance[:readings]
        self.covariance = np.diag(self.noise)
        self.covariance += (self.columns * self.prior_variance) @ self.columns.T

    def log_density(self, bound: BoundModel) -> float:
        fourier = np.delete(np.arange(len(self.residual)), self.norms)
        covariance = self.covariance[np.ix_(fourier, fourier)]
        total = multivariate_normal.logpdf(self.residual[fourier], cov=covariance)
        circles = [test.near_uniform for test in bound.reduced if test.near_uniform is not None]
        for test, norm in zip(bound.reduced, self.norms, strict=True):
            variance = self.noise[norm]
            total -= 0.5 * (test.readings - 25) * np.log(2 * np.pi * variance)
            total -= 0.5 * test.residual_ss / variance
        if len(circles) == len(self.norms):
            # The Fourier coefficients of nearly uniform circles were multiplied by a matrix.
            for circle in circles:
                total -= 0.5 * np.log1p(circle.departure).sum()
        return float(total)

    def coefficients(self) -> Moments:
        cross = (self.columns * self.prior_variance).T
        gain = np.linalg.solve(self.covariance, cross.T).T
        covariance = np.diag(self.prior_variance) - gain @ cross.T
        return Moments(self.prior_mean + gain @ self.residual, covariance)


@pytest.mark.parametrize("name", CAMPAIGNS)
def test_campaigns_against_the_dense_covariance_of_their_rows(name: str) -> None:
    bound = bound_to(name)
    phi = scales(bound)
    p = len(bound.names)
    gaussian = bound.collapsed
    log_evidence, conditional = gaussian.conditional(phi, last=p)
    np.testing.assert_allclose(gaussian.log_density(phi), log_evidence, rtol=1e-9)
    last = slice(gaussian._shared - p, gaussian._shared)
    unit = gaussian._unit[last]
    for k in range(len(phi)):
        dense = Dense(gaussian, phi[k], len(bound.reduced))
        assert log_evidence[k] == pytest.approx(dense.log_density(bound), abs=1e-5)
        expected = dense.coefficients()
        sd = conditional.sd[k]
        difference = conditional.mean[k] - expected.mean[last] * unit
        np.testing.assert_allclose(difference / sd, 0.0, atol=1e-6)
        covariance = expected.covariance[last, last] * np.outer(unit, unit)
        difference = conditional.covariance[k] - covariance
        np.testing.assert_allclose(difference / np.outer(sd, sd), 0.0, atol=1e-6)


@pytest.mark.parametrize("name", CAMPAIGNS)
def test_the_order_of_elimination_does_not_matter(name: str) -> None:
    """All shared coefficients last, as they stand, against parameters last."""
    bound = bound_to(name)
    phi = scales(bound)
    p = len(bound.names)
    _, conditional = bound.collapsed.conditional(phi, last=p)
    log_evidence, all_shared = bound.collapsed.conditional(phi)
    np.testing.assert_allclose(log_evidence, bound.collapsed.log_density(phi), rtol=1e-9)
    sd = conditional.sd
    np.testing.assert_allclose(all_shared.sd[:, -p:] / sd, 1.0, atol=1e-8)
    difference = all_shared.mean[:, -p:] - conditional.mean
    np.testing.assert_allclose(difference / sd, 0.0, atol=2e-8)
    chosen = [3, 0, *range(len(all_shared.scale[0]) - p, len(all_shared.scale[0]))]
    log_evidence, some_shared = bound.collapsed.conditional_of(chosen, phi)
    np.testing.assert_allclose(log_evidence, bound.collapsed.log_density(phi), rtol=1e-9)
    sd = all_shared.sd[:, chosen]
    difference = all_shared.mean[:, chosen] - some_shared.mean
    np.testing.assert_allclose(difference / sd, 0.0, atol=2e-8)
    difference = all_shared.covariance[:, chosen][:, :, chosen] - some_shared.covariance
    np.testing.assert_allclose(difference / (sd[:, :, None] * sd[:, None]), 0.0, atol=2e-8)


@pytest.mark.parametrize("name", CAMPAIGNS)
def test_cost_follows_the_structure(name: str) -> None:
    """The tree computes less than half of what one dense matrix has, save for arcs."""
    bound = bound_to(name)
    elimination = bound.collapsed._design.elimination(len(bound.names))
    size = len(bound.collapsed._unit)
    dense = size * (size + 1) / 2
    if name == "one plane, arcs":
        assert multiplied(elimination) <= size**3
    else:
        assert elimination.plan.entries < dense
        assert multiplied(elimination) < size**3 / 20


def multiplied(elimination: Elimination) -> float:
    """Multiplications for one value of the hyper-parameters."""
    total = 0.0
    for front in elimination.plan.fronts:
        groups = front.shape[0]
        remaining = front.shape[2] - np.arange(front.shape[1])
        total += groups * (remaining**2).sum() / 2
    return total


@pytest.mark.parametrize("name", ["one plane", "one plane, arcs", "one plane, gaps", "two planes"])
def test_means_of_all_coefficients_against_dense_algebra(name: str) -> None:
    """Those that tests share and those of single tests, given the parameters."""
    bound = bound_to(name)
    phi = scales(bound)
    gaussian = bound.likelihood_given_parameters
    rng = np.random.default_rng(2)
    beta = 0.1 * bound.scale * rng.normal(size=(len(phi), len(bound.names)))
    q = gaussian._shared
    shared, private = gaussian.means(phi, beta)
    design = gaussian._design
    for k in range(len(phi)):
        batch = next(gaussian._batches(phi[k : k + 1], beta[k], 1))
        weighted = design._columns * batch.weight[design._kinds, :1]
        precision = design._columns.T @ weighted
        right = weighted.T @ design._values + batch.shift[:, 0]
        expected = np.linalg.solve(precision, right) * gaussian._unit
        scale = np.abs(expected).max()
        np.testing.assert_allclose(shared[k] / scale, expected[:q] / scale, atol=1e-9)
        np.testing.assert_allclose(private[k].ravel() / scale, expected[q:] / scale, atol=1e-9)
