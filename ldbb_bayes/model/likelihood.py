"""ln p(z | β, φ), and the conditional Gaussian of the coefficients: nuisances integrated out in
closed form.

z_r = R_r (H_r β + U_r u + V_r v_r + e_r) + ε for every test r, reduced to z_r and R_r; u ~ N(m, s²)
shared by all tests, v_r ~ N(0, s²) and e_r ~ N(0, s²) of each alone, ε ~ N(0, σ²), all scales
products of known numbers and of φ. Rows are turned so that R_r e_r + ε has a diagonal covariance,
and a prior is a row like a reading: with x = (u, v_1 … v_T) in units of the known numbers, all rows
together are z − H β = A x + N(0, D(φ)), D diagonal, and

    P = Aᵀ D⁻¹ A = L Lᵀ,   ln p(z | β, φ) = −½ Σ ln D − ½ rᵀ D⁻¹ r + ½ |L⁻¹ Aᵀ D⁻¹ r|² − Σ ln L_jj,
    r = z − H β.

φ enters through D alone. Its rows are of few kinds, so that P and Aᵀ D⁻¹ r are sums of known
matrices, one for each kind, times 1/D. Arrays have their w values of φ last and contiguous: factors
are computed entry by entry, for all φ at once.

Where circles are sampled uniformly, columns of different order or symmetry have no row in common
but for the force errors', which have many orders. Leaves, columns that meet others only through the
root, are eliminated first, then the root. Which columns make the root is worked out once: those
that leave the fewest operations.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ldbb_bayes.model.elimination import (
    BLAS_MULTIPLE,
    FEWEST_PHI,
    Elimination,
    EliminationPlan,
    Front,
)
from ldbb_bayes.model.fourier import SIZE
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.observations import (
    CROWDED,
    add_prior_rows,
    columns_of_noise,
    reading_rows,
    uneven_columns,
)
from ldbb_bayes.model.orthant import Orthant
from ldbb_bayes.model.reduction import Reduced
from ldbb_bayes.model.terms import BasisNoise, Columns, Hyper, Source
from ldbb_bayes.model.triangular import eliminate, solve_upper
from ldbb_bayes.model.truncation import Truncation
from ldbb_bayes.results import Array

__all__ = ["ParameterConditional", "StructuredGaussian"]

_LOG_2PI = float(np.log(2 * np.pi))
_MALLOC_BYTES = 31 << 20
# mm²: a hyper-parameter of zero, whose coefficients are then zero to all digits.
_LEAST_VARIANCE = 1e-60


class ParameterConditional(Gaussian):
    """p(β | y, φ) for w values of φ, without truncation; ``physical``: A β ≥ 0, whether or not the
    model imposes it."""

    physical: Truncation

    def select(self, index: NDArray[np.intp]) -> ParameterConditional:
        """Those of some φ, of one perhaps several times."""
        picked = ParameterConditional.factored(
            self.mean[index], self.root[index], self.scale[index]
        )
        picked.physical = self.physical
        return picked

    @cached_property
    def orthant(self) -> Orthant:
        """The problem of P(A β ≥ 0 | y, φ)."""
        return Orthant(self.mean @ self.physical.rows.T, self.spread(self.physical.rows))

    def draw_truncated(self, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
        """One exact draw per φ inside A β ≥ 0, shape (w, p), and where it is one: the rejection
        sampler did not give up, and rounding did not leave β outside."""
        white, exact = self.orthant.draw_standard(rng)
        beta = self.from_standard(white)
        return beta, exact & self.physical.holds(beta)


class StructuredGaussian:
    """p(z | β, φ) with the shared and private columns integrated out. Columns that tests share come
    in the order given in `conditional`; ``interest`` H (tests, 25, p), whose coefficients are given
    in every call, none by default; ``offset`` (tests, 25), the known part of the readings in the
    basis, is subtracted beforehand."""

    def __init__(
        self,
        reduced: Sequence[Reduced],
        columns: Sequence[Columns | BasisNoise],
        *,
        offset: Array,
        hypers: Sequence[Hyper],
        interest: Array | None = None,
    ) -> None:
        _keep_freed_memory()
        interest = np.zeros((len(reduced), SIZE, 0)) if interest is None else interest
        even = [test.near_uniform for test in reduced if test.near_uniform is not None]
        diagonal = len(even) == len(reduced)
        noise = [term for term in columns if isinstance(term, BasisNoise)]
        # Of arcs only one noise can be made diagonal: that of most orders. The others become
        # private columns.
        absorbed = (
            noise if diagonal else sorted(noise, key=lambda term: -np.count_nonzero(term.sd))[:1]
        )
        shared = [term for term in columns if isinstance(term, Columns) and not term.private]
        private = [term for term in columns if isinstance(term, Columns) and term.private]
        private += [columns_of_noise(term, len(reduced)) for term in noise if term not in absorbed]
        private += (departing := uneven_columns(even) if diagonal else [])
        self._q, v = (sum(len(term.names) for term in terms) for terms in (shared, private))
        self._private = list(self._q + np.arange(len(reduced) * v).reshape(-1, v)) if v else []
        every = {
            Source(),
            Source("sigma"),
            *(source for term in columns for source in term.sources),
        }
        place = {None: len(hypers)} | {name: k for k, name in enumerate(hypers)}
        self._hypers = tuple(hypers)
        self._sources = sorted(
            every, key=lambda own: (place[own.hyper], place[own.circle], own.order)
        )
        readings = reading_rows(
            reduced, absorbed, shared, private, interest, offset, self._sources, diagonal=diagonal
        )
        self._rows, self._unit, volume = add_prior_rows(readings, shared, private, self._sources)
        of_sign = [
            -1.0 if name.startswith(CROWDED) else 1.0 for term in private for name in term.names
        ] * len(reduced)
        self._sign = np.array([*[1.0] * self._q, *of_sign])
        self._rows.variance[len(self._rows.variance) - len(of_sign) :] *= self._sign[
            self._q :, None
        ]
        self._uneven = bool(departing)
        self._orders = dict[int | None, Elimination]()
        self._constant = np.array([*(-0.5 * _LOG_2PI * test.readings for test in reduced), volume])
        self._constant[:-1] -= (
            [0.5 * np.log1p(own.departure).sum() for own in even] if diagonal else 0.0
        )
        _, first, kind = np.unique(
            _to_ten_digits(self._rows.variance), axis=0, return_index=True, return_inverse=True
        )
        self._kinds = self._rows.variance[first]
        self._kind = kind.ravel()
        moved = (self._rows.interest != 0.0).any(axis=1)
        self._moved, self._fixed = np.flatnonzero(moved), np.where(moved, 0.0, self._rows.values)
        self._number, self._squares = (np.zeros((len(reduced) + 1, len(first))) for _ in range(2))
        np.add.at(self._number, (self._rows.test, self._kind), self._rows.number)
        np.add.at(self._squares, (self._rows.test, self._kind), self._fixed**2)

    def log_density(self, phi: Array, beta: Array | None = None) -> Array:
        """ln p(z | β, φ), shape (w,), at φ (w, hypers) [mm] and β (w, p), or (p,)."""
        total = np.empty(len(phi))
        for index, weight, shift, density in self._passes(phi, beta, self._order(0).most):
            total[index] = density + self._order(0).factor(weight, shift)[1]
        return total

    def conditional(
        self, phi: Array, beta: Array | None = None, *, last: int | None = None
    ) -> tuple[Array, Gaussian]:
        """ln p(z | β, φ), shape (w,), and the shared coefficients, or the ``last`` of them, given
        z, β and φ: w Gaussians."""
        w = len(phi)
        first = 0 if last is None else self._q - last
        n = self._q - first
        order = self._order(
            last if self._uneven else None
        )  # Quasi-random points follow last digits.
        total = np.empty(w)
        lower = np.zeros((n, n, w))
        white = np.empty((n, w))
        for index, weight, shift, density in self._passes(phi, beta, order.most):
            factors, gained = order.factor(weight, shift)
            total[index] = density + gained
            part = slice(index[0], index[-1] + 1)
            used = index[-1] + 1 - index[0]
            for front, factor in zip(
                (*order.alone, *order.leaves, order.root), factors, strict=True
            ):
                for columns, own in zip(front.columns, factor, strict=True):
                    kept = np.flatnonzero((columns >= first) & (columns < self._q))
                    place = columns[kept] - first
                    for k, row in zip(kept, place, strict=True):
                        lower[row, place[place >= row], part] = own[k, kept[kept >= k], :used]
                    white[place, part] = own[kept, -1, :used]
        root = lower.transpose(2, 1, 0)
        unit = self._unit[first : self._q]
        mean = solve_upper(root, white.T) * unit
        return total, Gaussian.factored(mean, root, np.broadcast_to(unit, mean.shape), total)

    def private_mean(self, phi: Array, beta: Array, shared: Array) -> Array:
        """Conditional mean of the private coefficients given β, φ and the shared ones, shape (w,
        tests, v): in the order given, then basis noise that could not be made diagonal."""
        q = self._q
        v = len(self._private[0])
        columns = self._rows.columns
        front = self._front(self._private)
        white = np.divide(
            shared, self._unit[:q], out=np.zeros(shared.shape), where=self._unit[:q] > 0.0
        )
        mean = np.empty((len(phi), len(self._private), v))
        for index, weight, shift, _ in self._passes(phi, beta, FEWEST_PHI):
            known = (columns[:, :q] @ white[index].T) * weight[self._kind]
            factor = front.entries(weight, shift - columns.T @ known)
            eliminate(factor, signs=front.sign)
            mean[index] = solve_upper(
                factor[:, :, :v].transpose(3, 0, 2, 1), factor[:, :, -1].transpose(2, 0, 1)
            )
        return mean * self._unit[q : q + v]

    def _passes(
        self, phi: Array, beta: Array | None, most: int
    ) -> Iterator[tuple[NDArray[np.intp], Array, Array | None, Array]]:
        """Some φ at a time, a multiple of eight, the last one repeated: which; 1/D (kinds, w); Aᵀ
        D⁻¹ r of the rows that β moves, (columns, w); −½ Σ ln D − ½ rᵀ D⁻¹ r (w,)."""
        columns, interest, values, *_ = (part[self._moved] for part in self._rows)
        kind = self._kind[self._moved]
        sums = np.ones((1, len(self._constant)))
        number, squares, constant = (
            sums @ part for part in (self._number, self._squares, self._constant[:, None])
        )
        for start in range(0, len(phi), most):
            size = -(-min(len(phi) - start, most) // BLAS_MULTIPLE) * BLAS_MULTIPLE
            index = np.minimum(np.arange(start, start + size), len(phi) - 1)
            variance = self._variances(phi[index])
            shift = None
            weight = 1.0 / variance
            square = np.einsum("tk,kw->tw", number, np.log(np.abs(variance))) + np.einsum(
                "tk,kw->tw", squares, weight
            )
            if beta is not None:
                residual = (
                    values[:, None]
                    - interest @ np.broadcast_to(beta, (len(phi), beta.shape[-1]))[index].T
                )
                weighted = residual * weight[kind]
                square += np.ones((1, len(kind))) @ (residual * weighted)
                shift = columns.T @ weighted
            yield index, weight, shift, (constant - 0.5 * square)[0]

    def _variances(self, phi: Array) -> Array:
        """D of every kind of row, shape (kinds, w): what is known of them times each source
        squared."""
        value = dict(zip(self._hypers, np.ascontiguousarray(phi.T), strict=True))
        sizes = np.stack([np.broadcast_to(source.at(value), len(phi)) for source in self._sources])
        found = self._kinds @ sizes**2
        return np.where(
            found < 0.0, np.minimum(found, -_LEAST_VARIANCE), np.maximum(found, _LEAST_VARIANCE)
        )

    def _front(
        self, groups: Sequence[NDArray[np.intp]], border: NDArray[np.intp] | None = None
    ) -> Front:
        """Groups of as many columns each, to be eliminated together, and the columns that border
        them."""
        sums = []
        kinds = []
        for columns in groups:
            met = (self._rows.columns[:, columns] != 0.0).any(axis=1)
            index = np.flatnonzero(met)[np.argsort(self._kind[met], kind="stable")]
            own, starts = np.unique(self._kind[index], return_index=True)
            both = columns if border is None else np.concatenate([columns, border])
            rows = np.column_stack([self._rows.columns[np.ix_(index, both)], self._fixed[index]])
            sums.append(
                np.stack([part[:, : len(columns)].T @ part for part in np.split(rows, starts[1:])])
            )
            kinds.append(own)
        gram = np.zeros((len(groups), *sums[0].shape[1:], max(map(len, kinds))))
        padded = np.zeros((len(groups), gram.shape[3]), dtype=np.intp)
        for k, (own, values) in enumerate(zip(kinds, sums, strict=True)):
            gram[k, ..., : len(own)], padded[k, : len(own)] = np.moveaxis(values, 0, -1), own
        sign = self._sign[np.array(groups, dtype=np.intp)]
        return Front(
            np.array(groups, dtype=np.intp), padded, gram, sign if (sign < 0.0).any() else None
        )

    def _elimination(self, plan: EliminationPlan) -> Elimination:
        alone, leaves = plan.fronts
        return Elimination(
            [*map(self._front, alone)],
            [self._front(own, plan.root) for own in leaves],
            self._front([plan.root]),
        )

    def _linked(self, columns: NDArray[np.intp]) -> list[NDArray[np.intp]]:
        """The groups that columns fall into when those with a row in common go together."""
        met = (self._rows.columns[:, columns] != 0.0).astype(float)
        _, label = connected_components(met.T @ met > 0.0, directed=False)
        return [columns[label == k] for k in range(label.max(initial=-1) + 1)]

    @cached_property
    def _private_first(self) -> EliminationPlan:
        """Private columns first, test by test, then the shared ones in the order given."""
        groups = self._linked(np.arange(len(self._unit)))
        root = [group[group < self._q] for group in groups if group[-1] >= self._q]
        alone = [group for group in groups if group[-1] < self._q]
        return EliminationPlan(
            alone, self._private, np.sort(np.concatenate([np.zeros(0, dtype=np.intp), *root]))
        )

    def _order(self, last: int | None) -> Elimination:
        """The fewest operations with the ``last`` shared columns at the end; None: all in the order
        given. The root is the private columns, these, and those that have more rows than others, or
        all that private columns meet."""
        if last not in self._orders:
            met = self._rows.columns != 0.0
            plans = [self._private_first]
            first = self._q - (last or 0)
            number = met[:, : self._q].sum(axis=0)
            number[first:] = len(met) + 1
            for most in np.unique(number[:first]) if last is not None else ():
                root = np.concatenate([*self._private, np.flatnonzero(number > most)]).astype(
                    np.intp
                )
                edge = met[met[:, root].any(axis=1)]
                groups = self._linked(np.flatnonzero(number <= most))
                bordered = [bool(edge[:, group].any()) for group in groups]
                alone, leaves = (
                    [own for own, b in zip(groups, bordered, strict=True) if b == yes]
                    for yes in (False, True)
                )
                plans.append(EliminationPlan(alone, leaves, root))
            self._orders[last] = self._elimination(min(plans, key=lambda plan: plan.cost))
        return self._orders[last]


def _to_ten_digits(values: Array) -> Array:
    """Values whose last digits, rounding of the projection, no longer tell equal rows apart."""
    size = 10.0 ** (9 - np.floor(np.log10(np.where(values > 0, values, 1.0))))
    return np.round(values * size) / size


@cache
def _keep_freed_memory() -> None:
    """Let go of one large array: GNU's malloc then keeps freed arrays up to its size (mallopt(3),
    M_MMAP_THRESHOLD): stacks of small matrices are two to three times faster."""
    np.empty(_MALLOC_BYTES, dtype=np.uint8)
