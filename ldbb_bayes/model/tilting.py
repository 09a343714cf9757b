"""Minimax tilting: random draws of Gaussian vectors u given u ≥ 0, from a shifted density.

The constraints are u = L (x − x₀) ≥ 0, where L is a lower triangular matrix and x a standard normal
vector of d elements. x₀ is the point where all constraints hold with equality. The constraints are
also written unit · x ≥ bound: the matrix ``unit`` is L with each row divided by its diagonal entry,
and bound = unit · x₀. Each x_j is drawn at random above its lower limit, from a normal density
shifted by μ_j, which is called a tilt. The log importance weight (Φ is the standard normal
distribution function)

    ψ(x, μ) = Σ_j ln Φ(−e_j) + ½ μ_j² − x_j μ_j,   e_j = bound_j − Σ_{k<j} L_jk x_k / L_jj − μ_j,

is bounded by its value at the saddle point. With this bound, rejection sampling is exact. The mean
of the weights is an efficient estimate of the probability that all constraints hold, even if this
probability is very small (Botev, J. R. Statist. Soc. B 79, 125-148, 2017). The e_j are called
edges: they are the lower limits of the shifted variables x_j − μ_j. There may be further
constraints, which are linear combinations of the constraints above. Each further constraint bounds
the last x_j on which it depends, from below or from above, and therefore only reduces the weights.
The functions of this module process w sets of constraints at once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls
from scipy.special import erfcx, log_ndtr, ndtri_exp

from ldbb_bayes.errors import InputError
from ldbb_bayes.results import Array

__all__ = ["ROUNDING", "SaddlePoint", "Tilted", "find_saddle_point", "least_distance_multipliers"]

# The saddle point of the log importance weight is found as the minimum of a convex function. The
# search ends when the relative magnitude of the gradient (`_ConvexFunction.error`) is at most this
# number. The number also serves as an upper bound of the rounding errors of log probabilities.
ROUNDING = 1e-10
# Largest number of steps of Newton's method in the search for a saddle point of the log importance
# weight.
_ITERATIONS = 60
# Largest number of step lengths that are tried in one step of Newton's method. Each step length is
# half of the previous step length.
_HALVINGS = 20
# Newton's method may find the saddle point of the log importance weight only inexactly. This is
# accepted if the log probability that all constraints on a random vector hold is smaller than minus
# this number, because such a probability is too small to matter.
_NEGLIGIBLE_LOG_PROBABILITY = 1e7
# Uniform random numbers between 0 and 1 that are smaller than this number are replaced by it, so
# that their logarithm is finite.
_LEAST_UNIFORM = 1e-300


class SaddlePoint(NamedTuple):
    """Saddle points of the log importance weights ψ(x, μ) for w sets of constraints.

    ``x`` holds the d coordinates and ``tilt`` the tilts μ, each of shape (w, d). A tilt μ_j is the
    shift of the normal density from which x_j is drawn at random. The last x_j and the last μ_j
    are zero.
    """

    x: Array
    tilt: Array


class Proposal(NamedTuple):
    """Random draws from the shifted (tilted) density, and their log importance weights.

    There are s draws of d coordinates for each of w sets of constraints: ``x`` has the shape (d, s,
    w). ``log_weight``, shape (s, w), is ln (f(x) / g(x)), up to a constant. f is the density of x
    given the constraints, and g is the shifted density.
    """

    log_weight: Array
    x: Array


class _Interval(NamedTuple):
    """Probability that a standard normal variable is in an interval from ``low`` to ``high``.

    Both limits may be infinite. The probability is computed as the difference of two tail
    probabilities, which are also used to draw the variable at random in the interval. To keep
    rounding errors small, left tails are used if the centre of the interval is negative, and right
    tails otherwise.
    """

    #: Log probability of the interval, ln (Φ(high) − Φ(low)).
    log_mass: Array
    #: Log probability of the tail that contains the interval: the tail to the left of ``high`` or
    #: to the right of ``low``.
    log_tail: Array
    #: Probability of the part of this tail beyond the interval, divided by the probability of the
    #: tail. None if the interval has no upper limit.
    tail_ratio: Array | None
    #: −1 for a left tail, 1 for a right tail.
    direction: Array | float


class _ConvexFunction(NamedTuple):
    """Convex function whose minimum gives the saddle point of the log importance weight.

    The fields hold its value and derivatives for w sets of constraints. Each set has d constraints
    U x ≥ ``bound`` on a standard normal vector x, where U is a lower triangular matrix with ones on
    its diagonal. The function of m is ½ mᵀ C m − boundᵀ m + Σ_j (e_j m_j + ln Φ(−e_j)), where
    C = U Uᵀ − I is called the coupling. Each m_j is the inverse Mills ratio φ(e_j) / Φ(−e_j) of the
    lower limit e_j of a shifted normal variable. φ and Φ are the standard normal density and
    distribution function.
    """

    #: Value of the function, shape (w,).
    value: Array
    #: Derivatives with respect to the d ratios m_j, shape (w, d); zero at the saddle point.
    gradient: Array
    #: Derivative of each ratio m_j with respect to the limit e_j, between 0 and 1, shape (w, d).
    slope: Array
    #: Largest relative magnitude of the elements of ``gradient``, shape (w,). Each element is a
    #: sum. Its relative magnitude is its absolute value divided by 1 plus the sum of the absolute
    #: values of the summands.
    error: Array


class _Edges(NamedTuple):
    """Result of the search for saddle points of the log importance weight.

    Each saddle point is described by the lower limits (edges) of the d shifted normal variables.
    ``edge``, shape (w, d), holds the limits for each of w sets of constraints. ``solved``, shape
    (w,), states whether the search succeeded. ``value``, shape (w,), is the value of
    `_ConvexFunction` at these limits.
    """

    edge: Array
    solved: NDArray[np.bool_]
    value: Array


class Tilted(NamedTuple):
    """Batch of w sets of constraints, each on a standard normal vector x of d elements.

    The d independent constraints of a set are unit · x ≥ bound, with a lower triangular matrix
    ``unit``; the constraint that is most likely to fail comes first. There may be k further
    constraints, dependent_mean + dependent · x ≥ 0, which are linear combinations of the
    independent constraints.
    """

    #: Lower triangular matrices of the independent constraints, with ones on the diagonal, shape
    #: (d, d, w).
    unit: Array
    #: Lower bounds of the independent constraints, shape (d, w).
    bound: Array
    #: Coordinates x of the saddle point of the log importance weight, shape (d, w). The last
    #: coordinate is zero.
    x: Array
    #: Tilts at the saddle point: the shifts of the normal densities from which the elements of x
    #: are drawn, shape (d, w). The last tilt is zero.
    tilt: Array
    #: Coefficients of x in the dependent constraints, shape (k, d, w).
    dependent: Array
    #: Constant terms of the dependent constraints, shape (k, w).
    dependent_mean: Array
    #: Index of the last element of x that occurs in each dependent constraint, shape (k, w).
    last: Array

    def select(self, members: NDArray[np.intp]) -> Tilted:
        """Return the sets of constraints with the indices ``members``, from 0."""
        return Tilted(
            self.unit[..., members],
            self.bound[..., members],
            self.x[..., members],
            self.tilt[..., members],
            self.dependent[..., members],
            self.dependent_mean[..., members],
            self.last[..., members],
        )

    @property
    def log_bound(self) -> Array:
        """Upper bound of the log probability that all constraints on a vector hold, shape (w,).

        The bound is the log importance weight at the saddle point. The dependent constraints are
        not taken into account; they could only reduce the bound.
        """
        independent = self._replace(last=np.full_like(self.last, -1))
        return independent.log_weight(self.x[:, None])[0]

    def propose(self, uniform: Array, *, draw_last: bool = True) -> Proposal:
        """Return s random draws of x from the shifted density, with their log importance weights.

        There are s draws for each of w sets of constraints on a standard normal vector x of d
        elements. A draw that violates a constraint has the log weight −inf.

        Parameters
        ----------
        uniform
            Random numbers, uniform between 0 and 1, shape (d, s, w), or (d, s, 1) to use the same
            numbers for all sets. If ``draw_last`` is false, numbers for the first d − 1 elements,
            shape (d − 1, s, w), are sufficient.
        draw_last
            Whether the last element of x is drawn; otherwise the element is zero. The weights do
            not depend on the last element.
        """
        d, w = self.bound.shape
        x = np.zeros((d, uniform.shape[1], w))
        log_weight = np.zeros((uniform.shape[1], w))
        for j in range(d):
            interval = _measure_interval(*self._limits(j, x))
            log_weight += interval.log_mass
            if draw_last or j < d - 1:
                tilt = self.tilt[j]
                log_share = _log_tail_share(interval, uniform[j])
                x[j] = tilt - interval.direction * ndtri_exp(log_share)
                log_weight += tilt * (0.5 * tilt - x[j])
        return Proposal(log_weight, x)

    def log_weight(self, x: Array) -> Array:
        """Return the log importance weights of s points for w sets of constraints, shape (s, w).

        A log weight is ln (f(x) / g(x)), up to a constant. f is the density of x given the
        constraints, and g is the shifted density from which x is drawn. The points ``x`` are
        vectors of d elements, shape (d, s, w). The result is meant for points that
        satisfy the constraints; whether they do is not checked.
        """
        log_mass = np.zeros(x.shape[1:])
        for j in range(len(x)):
            log_mass = log_mass + _measure_interval(*self._limits(j, x)).log_mass
        tilt = self.tilt[:, None]
        return np.asarray(log_mass + (tilt * (0.5 * tilt - x)).sum(axis=0))

    def _limits(
        self,
        j: int,
        x: Array,
    ) -> tuple[Array, Array | None]:
        """Return lower and upper limits of x_j − tilt_j, given x_k for all k < j.

        tilt_j is the shift of the normal density from which x_j is drawn at random. The limits
        follow from the constraints on x. ``x``, shape (d, s, w), holds s points of d coordinates
        for each of w sets of constraints. Each limit has the shape (s, w), or (1, w) if it is the
        same for all points. Only dependent constraints, which are linear combinations of the
        independent constraints, can bound x_j from above. Without such a constraint, the upper
        limit is None.
        """
        # The first constraint on the vector x depends only on its first element x_0. The lower
        # limit of x_0 is therefore the same for all points x.
        explained = np.einsum("kw,ksw->sw", self.unit[j, :j], x[:j]) if j > 0 else 0.0
        low = np.atleast_2d(self.bound[j] - explained - self.tilt[j])
        rows = np.flatnonzero((self.last == j).any(axis=1))
        if not rows.size:
            return low, None
        high = np.full(x.shape[1:], np.inf)
        for row in rows:
            coefficients = self.dependent[row]
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                explained = np.einsum("kw,ksw->sw", coefficients[:j], x[:j])
                value = self.dependent_mean[row] + explained
                edge = -value / coefficients[j] - self.tilt[j]
            ends_here = self.last[row] == j
            from_below = ends_here & (coefficients[j] > 0.0)
            from_above = ends_here & (coefficients[j] < 0.0)
            low = np.where(from_below, np.maximum(low, edge), low)
            high = np.where(from_above, np.minimum(high, edge), high)
        return low, high


def _measure_interval(low: Array, high: Array | None) -> _Interval:
    """Return the probability that a standard normal variable is between ``low`` and ``high``.

    ``high`` is None if there is no upper limit. The result also holds the tail probabilities from
    which random draws in the interval are computed.
    """
    if high is None:
        log_tail = log_ndtr(-low)
        return _Interval(log_tail, log_tail, None, 1.0)
    to_the_left = low + high < 0.0
    log_tail = log_ndtr(np.where(to_the_left, high, -low))
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        log_far_tail = log_ndtr(np.where(to_the_left, low, -high))
        ratio = np.where(high > low, np.exp(log_far_tail - log_tail), 1.0)
        ratio = np.minimum(ratio, 1.0)
        log_mass = log_tail + np.log1p(-ratio)
    return _Interval(log_mass, log_tail, ratio, np.where(to_the_left, -1.0, 1.0))


def _log_tail_share(interval: _Interval, uniform: Array) -> Array:
    """Return logarithms of random tail probabilities of a standard normal variable.

    The caller computes from them random values of the variable within ``interval``. The tail holds
    all smaller values of the variable if ``interval.direction`` is −1, and all larger values if it
    is 1. Each tail probability is drawn from a uniform distribution between the tail probabilities
    of the two ends of the interval; ``uniform`` holds the random numbers for this, between 0 and 1.
    """
    share = np.clip(uniform, _LEAST_UNIFORM, 1.0)
    if interval.tail_ratio is not None:
        share = share + (1.0 - share) * interval.tail_ratio
    return np.asarray(np.log(share) + interval.log_tail)


def find_saddle_point(unit: Array, bound: Array) -> SaddlePoint:
    """Return the saddle points of the log importance weight ψ(x, μ) for w sets of constraints.

    Each set has d constraints unit · x ≥ bound on a standard normal vector x. The tilts μ are the
    shifts of the normal densities from which x is drawn at random; the tilts at the saddle point
    give the smallest bound of the weights. The derivatives of ψ with respect to x and μ are zero
    where x = unitᵀ m and μ = x − m. The m_j = φ(e_j) / Φ(−e_j) are inverse Mills ratios, where φ
    and Φ are the standard normal density and distribution function. The edges e are the lower
    limits of the shifted variables. They are the solution of e + (unit unitᵀ − I) m = bound, which
    is computed by Newton's method. The saddle point may be approximate if the log probability of
    the constraints is below about −1e7, because such a probability is too small to matter.

    Parameters
    ----------
    unit
        Lower triangular matrices of the constraints, with ones on their diagonals, shape (w, d, d).
    bound
        Lower bounds of the constraints, shape (w, d).

    Returns
    -------
    SaddlePoint
        Coordinates x and tilts μ, each of shape (w, d). The last x_j and the last μ_j are set to
        zero, which does not change the bound of the weights.

    Raises
    ------
    InputError
        If double precision does not suffice to compute a saddle point.
    """
    w, d = bound.shape
    if d <= 1:
        return SaddlePoint(np.zeros((w, d)), np.zeros((w, d)))
    mills = _inverse_mills(_edges_at_saddle_point(unit, bound))
    x = np.einsum("wij,wi->wj", unit, mills)
    tilt = np.einsum("wij,wi->wj", np.tril(unit, -1), mills)
    x[:, -1] = 0.0
    tilt[:, -1] = 0.0
    return SaddlePoint(x, tilt)


def _edges_at_saddle_point(unit: Array, bound: Array) -> Array:
    """Return the edges at the saddle points of the log importance weight, shape (w, d).

    There is one saddle point for each of w sets of d constraints unit · x ≥ bound on a standard
    normal vector x. ``unit``, shape (w, d, d), holds lower triangular matrices with ones on their
    diagonals; ``bound`` has the shape (w, d). Each element of x is drawn at random from a shifted
    normal density. The constraint and the elements drawn before give a lower limit of the element;
    the edge is this limit minus the shift. Newton's method starts with the bounds as edges. If it
    fails, it is started a second time, with the edges that `_edges_of_nearest_point` returns. If it
    fails again, an `InputError` is raised, unless the probability of the constraints is too small
    to matter. In that case, the edges that the second search reached are returned.
    """
    coupling = unit @ np.swapaxes(unit, 1, 2) - np.eye(bound.shape[1])
    edge, solved, _ = _solve_edges(coupling, bound, bound)
    failed = np.flatnonzero(~solved)
    if failed.size:
        starts = [_edges_of_nearest_point(coupling[k], unit[k], bound[k]) for k in failed]
        retried = _solve_edges(coupling[failed], bound[failed], np.array(starts))
        edge[failed] = retried.edge
        # At the saddle point, ``value`` is an upper bound of the log probability that all
        # constraints hold.
        negligible = np.abs(retried.value) > _NEGLIGIBLE_LOG_PROBABILITY
        solved[failed] = retried.solved | negligible
    if not solved.all():
        raise InputError(
            "the probability of physical compliances must be within reach of double precision, got"
            " readings too far from them. Check the sign of the readings, the mount compensation"
            " and the forces, or fit --without truncation."
        )
    return edge


def _solve_edges(
    coupling: Array,
    bound: Array,
    start: Array,
) -> _Edges:
    """Solve e + C m(e) = bound for w vectors e, by Newton's method.

    A vector e holds the lower limits (edges) of d shifted normal variables, and m(e) holds their
    inverse Mills ratios. C is ``coupling``, shape (w, d, d). The search starts from e = ``start``;
    ``start`` and ``bound`` have the shape (w, d). Each step is halved until it reduces the value of
    the convex function (`_ConvexFunction`), or the relative magnitude of the gradient of this
    function.
    """
    edge = np.array(start)
    current = _evaluate_convex_function(coupling, bound, edge)
    for _ in range(_ITERATIONS):
        active = current.error > ROUNDING
        if not active.any():
            break
        system = np.eye(bound.shape[1]) + coupling * current.slope[:, None, :]
        step = -np.linalg.solve(system, current.gradient[..., None])[..., 0]
        searching = active.copy()
        for k in range(_HALVINGS):
            trial_edge = np.where(searching[:, None], edge + 0.5**k * step, edge)
            trial = _evaluate_convex_function(coupling, bound, trial_edge)
            falls = (trial.value < current.value) | (trial.error < current.error)
            good = searching & falls
            edge = np.where(good[:, None], trial_edge, edge)
            current = _ConvexFunction(
                value=np.where(good, trial.value, current.value),
                gradient=np.where(good[:, None], trial.gradient, current.gradient),
                slope=np.where(good[:, None], trial.slope, current.slope),
                error=np.where(good, trial.error, current.error),
            )
            searching &= ~good
            if not searching.any():
                break
        if searching[active].all():
            break
    return _Edges(edge, current.error <= ROUNDING, current.value)


def _edges_of_nearest_point(
    coupling: Array,
    unit: Array,
    bound: Array,
) -> Array:
    """Return starting values of the edges for Newton's method in `_solve_edges`, shape (d,).

    Each element x_j of a random vector is drawn from a normal density with the mean μ_j (its tilt),
    truncated to values above a limit l_j. The edge e_j = l_j − μ_j is the distance of the limit
    from the mean. The starting values are approximately the edges for the most probable standard
    normal vector x that satisfies d constraints unit · x ≥ bound. ``unit``, shape (d, d), is a
    lower triangular matrix with ones on the diagonal, and ``bound`` has the shape (d,).
    ``coupling`` is the matrix C = unit unitᵀ − I, shape (d, d), in the equations for the edges.
    """
    # The edges e solve e + C m = bound, where m are the inverse Mills ratios of e. At the most
    # probable x, some constraints are binding: they hold with equality. For a binding constraint, e
    # is assumed to be large. Its m is then nearly equal to e, and the equation becomes (C + I) m =
    # bound. For all other constraints, m is assumed to be zero.
    binding = np.flatnonzero(least_distance_multipliers(unit, bound))
    block = coupling[np.ix_(binding, binding)] + np.eye(len(binding))
    mills = np.zeros(len(bound))
    mills[binding] = np.linalg.solve(block, bound[binding])
    # The inverse Mills ratio m of a large number e is about e + 1/e, so that e is about m − 1/m.
    far = mills - 1.0 / np.maximum(mills, 1.0)
    return np.where(mills > 1.0, far, bound - coupling @ mills)


def _evaluate_convex_function(
    coupling: Array,
    bound: Array,
    edge: Array,
) -> _ConvexFunction:
    """Return the value and derivatives of the convex function described in `_ConvexFunction`.

    The minimum of the function gives the saddle point of the log importance weight. There is one
    function for each of w sets of d linear constraints U x ≥ ``bound`` on a standard normal vector
    x. ``coupling``, shape (w, d, d), holds the matrices C = U Uᵀ − I. ``edge``, shape (w, d), holds
    the lower limits e of shifted normal variables at which the function is evaluated. ``bound``
    also has the shape (w, d).
    """
    mills = _inverse_mills(edge)
    coupled_mills = np.einsum("wij,wj->wi", coupling, mills)
    value = (mills * (0.5 * coupled_mills - bound + edge) + log_ndtr(-edge)).sum(axis=1)
    gradient = edge + coupled_mills - bound
    slope = np.clip(mills * (mills - edge), 0.0, 1.0)
    largest_coupled = np.einsum("wij,wj->wi", np.abs(coupling), mills)
    size_of_terms = 1.0 + np.abs(bound) + np.abs(edge) + largest_coupled
    error = np.abs(gradient / size_of_terms).max(axis=1)
    return _ConvexFunction(value, gradient, slope, error)


def _inverse_mills(edge: Array) -> Array:
    """Return the inverse Mills ratios φ(e) / (1 − Φ(e)) of the numbers e = ``edge``.

    φ and Φ are the standard normal density and distribution function. The ratio is the mean of a
    standard normal variable truncated to values above e.
    """
    with np.errstate(over="ignore"):
        return np.asarray(np.sqrt(2.0 / np.pi) / erfcx(edge / np.sqrt(2.0)))


def least_distance_multipliers(unit: Array, bound: Array) -> Array:
    """Return the Lagrange multipliers of the point x nearest to zero with unit · x ≥ bound.

    There is one multiplier for each of the d constraints, shape (d,). The multiplier is zero for a
    constraint that holds with strict inequality at the nearest point, and usually positive for a
    constraint that holds with equality. The multipliers are determined only up to a common factor.
    They are computed by non-negative least squares (Lawson and Hanson, Solving Least Squares
    Problems, ch. 23).

    Parameters
    ----------
    unit
        Rows of coefficients of the d constraints unit · x ≥ bound on the q elements of x, shape
        (d, q).
    bound
        Lower bounds of the d constraints, shape (d,).
    """
    largest_bound = max(1.0, float(np.abs(bound).max()))
    rows = np.vstack([unit.T, bound / largest_bound])
    multipliers, _ = nnls(rows, np.append(np.zeros(unit.shape[1]), 1.0))
    return np.asarray(multipliers)
