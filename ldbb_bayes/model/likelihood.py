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

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError
from ldbb_bayes.model.fourier import SIZE, Even, Reduced
from ldbb_bayes.model.gaussian import Gaussian, components, eliminate, solve_upper
from ldbb_bayes.model.terms import NOISE, OWN, BasisNoise, Columns, Hyper, Source
from ldbb_bayes.model.truncation import Orthant, Truncation
from ldbb_bayes.results import Array

__all__ = ["NOISE", "OWN", "Information", "ParameterConditional", "StructuredGaussian"]

Index = NDArray[np.intp]
_LOG_2PI = float(np.log(2 * np.pi))
_MALLOC_BYTES = 31 << 20
# The most and the fewest φ of one pass; numbers that the cache holds; what BLAS rounds alike the
# multiples of: results do not depend on the stack.
_MOST = 512
_FEWEST = 128
_CACHED = 1 << 19
_MULTIPLE = 8
_CROWDED = "crowded"
# mm²: a hyper-parameter of zero, whose coefficients are then zero to all digits.
_LEAST_VARIANCE = 1e-60
# Multiplications in the time that a column takes besides; columns whose Gram entries are computed
# together.
_OVERHEAD = 60.0
_TOGETHER = 4


class ParameterConditional(Gaussian):
    """p(β | y, φ) for w values of φ, without truncation; ``physical``: A β ≥ 0, whether or not the
    model imposes it."""

    physical: Truncation

    def picked(self, index: Index) -> ParameterConditional:
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

    def draw_inside(self, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
        """One exact draw per φ inside A β ≥ 0, shape (w, p), and where it is one: the rejection
        sampler did not give up, and rounding did not leave β outside."""
        white, exact = self.orthant.draw_spread(rng)
        beta = self.at(white)
        return beta, exact & self.physical.holds(beta)


class _Rows(NamedTuple):
    """Rows of readings and priors: what they have of the columns, in units of their prior sd (rows,
    columns), and of the parameters of interest (rows, p); values (rows,); how many each stands for;
    its test, the number of tests for a prior of what all share; and the parts of its variance that
    go with each source squared, (rows, sources)."""

    columns: Array
    interest: Array
    values: Array
    number: Array
    test: Index
    variance: Array


class _Front(NamedTuple):
    """g groups of s columns (g, s) that meet k kinds of rows (g, k), and for each kind their Gram
    entries, (g, s, s + m + 1, k), with one another, with the m columns that border them and with
    the values."""

    columns: Index
    kinds: Index
    gram: Array
    sign: Array | None  # of the pivots (g, s), where not all are positive

    def eliminated(
        self, factor: Array, links: Array | None = None, linked: Array | None = None
    ) -> Array:
        """L of its entries in place, and ½ |L⁻¹ Aᵀ D⁻¹ r|² − Σ ln L_jj of every group, shape (g,
        w)."""
        eliminate(factor, links, sign=self.sign, linked=linked)
        white = factor[:, :, -1]
        span = np.arange(factor.shape[1])
        left = white if self.sign is None else self.sign[:, :, None] * white
        found = 0.5 * np.einsum("gsw,gsw->gw", left, white) - np.log(factor[:, span, span]).sum(
            axis=1
        )
        if not np.isfinite(found).all():
            raise np.linalg.LinAlgError("readings and priors must determine every coefficient")
        return found

    def entries(self, weight: Array, shift: Array | None, out: Array | None = None) -> Array:
        """P and Aᵀ D⁻¹ r + ``shift`` (columns, w) from the diagonal on, (g, s, s + m + 1, w), at
        weights 1/D (kinds, w)."""
        own = weight[self.kinds][:, None]
        out = np.zeros((*self.gram.shape[:3], weight.shape[1])) if out is None else out
        for j in range(0, self.gram.shape[1], _TOGETHER):
            np.matmul(self.gram[:, j : j + _TOGETHER, j:], own, out=out[:, j : j + _TOGETHER, j:])
        if shift is not None:
            out[:, :, -1] += shift[self.columns]
        return out


class _Elimination(NamedTuple):
    """Fronts of columns that meet no others, leaves, which the root borders, and the root."""

    alone: list[_Front]
    leaves: list[_Front]
    root: _Front

    @property
    def linked(self) -> Array | None:
        """Signs of the leaves' pivots, where not all are positive."""
        signs = [
            np.ones(front.columns.shape) if front.sign is None else front.sign
            for front in self.leaves
        ]
        return (
            None
            if all(front.sign is None for front in self.leaves)
            else np.concatenate([own.ravel() for own in signs])
        )

    @property
    def most(self) -> int:
        """How many φ to take at a time."""
        entries = sum(
            int(np.prod(front.gram.shape[:3])) for front in (*self.alone, *self.leaves, self.root)
        )
        return max(_FEWEST, min(_MOST, _CACHED // max(entries, 1) // _MULTIPLE * _MULTIPLE))

    def factor(self, weight: Array, shift: Array | None) -> tuple[list[Array], Array]:
        """L and L⁻¹ Aᵀ D⁻¹ r of every front, (g, s, s + m + 1, w), and ½ |L⁻¹ Aᵀ D⁻¹ r|² − Σ ln
        L_jj, shape (w,)."""
        factors = [front.entries(weight, shift) for front in self.alone]
        # Leaves lie in one array, aligned at their border.
        most = max((front.gram.shape[1] for front in self.leaves), default=0)
        begun = 0
        links = np.empty(
            (
                sum(front.columns.size for front in self.leaves),
                most + self.root.gram.shape[2],
                weight.shape[1],
            )
        )
        for front in self.leaves:
            g, s, n, _ = front.gram.shape
            own = links[begun : begun + g * s, most - s :].reshape(g, s, n, weight.shape[1])
            factors.append(front.entries(weight, shift, own))
            begun += g * s
        gained = [
            front.eliminated(own).sum(axis=0)
            for front, own in zip((*self.alone, *self.leaves), factors, strict=True)
        ]
        factors.append(self.root.entries(weight, shift))
        gained.append(self.root.eliminated(factors[-1], links[:, most:], self.linked)[0])
        return factors, np.sum(gained, axis=0)


class _Plan(NamedTuple):
    """Columns of the groups that meet no others, of the leaves, and of the root."""

    alone: list[Index]
    leaves: list[Index]
    root: Index

    @property
    def fronts(self) -> tuple[list[list[Index]], list[list[Index]]]:
        """Groups alone and leaves, those of one size together."""
        alone, leaves = (
            [[own for own in part if len(own) == s] for s in sorted({*map(len, part)})]
            for part in self[:2]
        )
        return alone, leaves

    @property
    def cost(self) -> float:
        """Multiplications for each φ."""
        alone, leaves = self.fronts
        total = 0.0
        m = len(self.root)
        for groups, border in [
            *((part, 0) for part in alone),
            *((part, m) for part in leaves),
            ([self.root], 0),
        ]:
            n = len(groups[0]) + border + 1 - np.arange(len(groups[0]))
            total += float((_OVERHEAD + len(groups) * n * (n + 1) / 2).sum())
        return total


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
        even = [test.even for test in reduced if test.even is not None]
        diagonal = len(even) == len(reduced)
        noise = [term for term in columns if isinstance(term, BasisNoise)]
        # Of arcs only one noise can be made diagonal: that of most orders. The others become
        # private columns.
        absorbed = (
            noise if diagonal else sorted(noise, key=lambda term: -np.count_nonzero(term.sd))[:1]
        )
        shared = [term for term in columns if isinstance(term, Columns) and not term.private]
        private = [term for term in columns if isinstance(term, Columns) and term.private]
        private += [_as_columns(term, len(reduced)) for term in noise if term not in absorbed]
        private += (departing := _departing(even) if diagonal else [])
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
        readings = _reading_rows(
            reduced, absorbed, shared, private, interest, offset, self._sources, diagonal=diagonal
        )
        self._rows, self._unit, volume = _with_prior(readings, shared, private, self._sources)
        of_sign = [
            -1.0 if name.startswith(_CROWDED) else 1.0 for term in private for name in term.names
        ] * len(reduced)
        self._sign = np.array([*[1.0] * self._q, *of_sign])
        self._rows.variance[len(self._rows.variance) - len(of_sign) :] *= self._sign[
            self._q :, None
        ]
        self._uneven = bool(departing)
        self._orders = dict[int | None, _Elimination]()
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
        for index, weight, shift, _ in self._passes(phi, beta, _FEWEST):
            known = (columns[:, :q] @ white[index].T) * weight[self._kind]
            factor = front.entries(weight, shift - columns.T @ known)
            eliminate(factor, sign=front.sign)
            mean[index] = solve_upper(
                factor[:, :, :v].transpose(3, 0, 2, 1), factor[:, :, -1].transpose(2, 0, 1)
            )
        return mean * self._unit[q : q + v]

    def _passes(
        self, phi: Array, beta: Array | None, most: int
    ) -> Iterator[tuple[Index, Array, Array | None, Array]]:
        """Some φ at a time, a multiple of eight, the last one repeated: which; 1/D (kinds, w); Aᵀ
        D⁻¹ r of the rows that β moves, (columns, w); −½ Σ ln D − ½ rᵀ D⁻¹ r (w,)."""
        columns, interest, values, *_ = (part[self._moved] for part in self._rows)
        kind = self._kind[self._moved]
        sums = np.ones((1, len(self._constant)))
        number, squares, constant = (
            sums @ part for part in (self._number, self._squares, self._constant[:, None])
        )
        for start in range(0, len(phi), most):
            size = -(-min(len(phi) - start, most) // _MULTIPLE) * _MULTIPLE
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

    def _front(self, groups: Sequence[Index], border: Index | None = None) -> _Front:
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
        return _Front(
            np.array(groups, dtype=np.intp), padded, gram, sign if (sign < 0.0).any() else None
        )

    def _elimination(self, plan: _Plan) -> _Elimination:
        alone, leaves = plan.fronts
        return _Elimination(
            [*map(self._front, alone)],
            [self._front(own, plan.root) for own in leaves],
            self._front([plan.root]),
        )

    def _linked(self, columns: Index) -> list[Index]:
        """The groups that columns fall into when those with a row in common go together."""
        met = (self._rows.columns[:, columns] != 0.0).astype(float)
        label = components(met.T @ met > 0.0)
        return [columns[label == k] for k in range(label.max(initial=-1) + 1)]

    @cached_property
    def _private_first(self) -> _Plan:
        """Private columns first, test by test, then the shared ones in the order given."""
        groups = self._linked(np.arange(len(self._unit)))
        root = [group[group < self._q] for group in groups if group[-1] >= self._q]
        alone = [group for group in groups if group[-1] < self._q]
        return _Plan(
            alone, self._private, np.sort(np.concatenate([np.zeros(0, dtype=np.intp), *root]))
        )

    def _order(self, last: int | None) -> _Elimination:
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
                plans.append(_Plan(alone, leaves, root))
            self._orders[last] = self._elimination(min(plans, key=lambda plan: plan.cost))
        return self._orders[last]


def _reading_rows(
    reduced: Sequence[Reduced],
    absorbed: Sequence[BasisNoise],
    shared: Sequence[Columns],
    private: Sequence[Columns],
    interest: Array,
    offset: Array,
    sources: list[Source],
    *,
    diagonal: bool,
) -> _Rows:
    """Rows of every test's readings, turned so that the absorbed noise is diagonal, and one for all
    that is outside the basis."""
    together, apart = (
        np.concatenate(
            [np.zeros((len(reduced), SIZE, 0)), *(term.values for term in terms)], axis=2
        )
        for terms in (shared, private)
    )
    q = together.shape[2]
    v = apart.shape[2]
    white = np.eye(len(sources))[sources.index(Source("sigma"))]
    found = []
    for r, test in enumerate(reduced):
        turn, factor, spread = _turned(test, absorbed, diagonal=diagonal)
        m = len(factor)
        columns = np.zeros((m + 1, q + len(reduced) * v))
        given = np.zeros((m + 1, interest.shape[2]))
        columns[:m, :q], columns[:m, q + r * v : q + (r + 1) * v] = (
            factor @ together[r],
            factor @ apart[r],
        )
        given[:m] = factor @ interest[r]
        values = (
            np.zeros(m) if test.projection is None else turn @ test.projection - factor @ offset[r]
        )
        variance = np.tile(white, (m + 1, 1))
        number = np.ones(m + 1)
        values, number[m] = (
            np.append(values, np.sqrt(test.residual_ss)),
            max(test.readings - SIZE, 0),
        )
        for term, sd in zip(absorbed, spread, strict=True):
            variance[:m, sources.index(term.source(r))] += sd**2
        found.append(_Rows(columns, given, values, number, np.full(m + 1, r), variance))
    return _Rows(*(np.concatenate(part) for part in zip(*found, strict=True)))


def _turned(
    test: Reduced, absorbed: Sequence[BasisNoise], *, diagonal: bool
) -> tuple[Array, Array, list[Array]]:
    """The turn (m, m) of a test's rows, the turned factor (m, 25), and the sd of every absorbed
    noise in each row."""
    if diagonal and test.even is not None:
        size = test.even.size
        return (
            size[:, None] * np.linalg.inv(test.factor),
            np.diag(size),
            [size * term.sd for term in absorbed],
        )
    left, singular, _ = np.linalg.svd(test.factor * (absorbed[0].sd if absorbed else 1.0))
    return left.T, left.T @ test.factor, [singular][: len(absorbed)]


def _with_prior(
    rows: _Rows, shared: Sequence[Columns], private: Sequence[Columns], sources: list[Source]
) -> tuple[_Rows, Array, float]:
    """The rows in units of the columns' prior sd, flat ones' in units of their own size, with the
    prior's rows below; the units (columns,); and what flat priors add to the log density."""
    tests = int(rows.test[-1]) + 1
    q = sum(len(term.names) for term in shared)
    terms = [*shared, *[*private] * tests]
    sd, stated, mean = (
        np.concatenate(
            [
                np.zeros(0),
                *(np.zeros(len(term.names)) if part is None else part for term, part in of),
            ]
        )
        for of in (
            [(t, t.sd) for t in terms],
            [(t, t.stated) for t in terms],
            [(t, t.mean) for t in terms],
        )
    )
    owner = [sources.index(source) for term in shared for source in term.sources]
    owner += [
        sources.index(source)
        for r in range(tests)
        for term in private
        for source in term.sources_of(r)
    ]
    size = np.linalg.norm(rows.columns, axis=0)
    flat = np.isinf(sd)
    unit = np.where(flat, 1.0 / np.where(size > 0.0, size, 1.0), np.where(sd > 0.0, sd, stated))
    proper = np.flatnonzero(~flat)
    variance = np.zeros((len(sd), len(sources)))
    with np.errstate(invalid="ignore", divide="ignore"):
        for part, place in (
            (sd, np.array(owner, dtype=np.intp)),
            (stated, np.full(len(sd), sources.index(Source()))),
        ):
            share = np.where(unit > 0.0, (part / unit) ** 2, part is sd)
            np.add.at(variance, (np.arange(len(sd)), place), np.where(flat, 0.0, share))
    prior = _Rows(
        np.eye(len(sd))[proper],
        np.zeros((len(proper), rows.interest.shape[1])),
        np.divide(mean, unit, out=np.zeros(len(sd)), where=unit > 0.0)[proper],
        np.ones(len(proper)),
        np.where(proper < q, tests, (proper - q) // max((len(sd) - q) // tests, 1)),
        variance[proper],
    )
    both = zip(rows._replace(columns=rows.columns * unit), prior, strict=True)
    return (
        _Rows(*(np.concatenate(pair) for pair in both)),
        unit,
        float((np.log(unit[flat]) + 0.5 * _LOG_2PI).sum()),
    )


def _as_columns(term: BasisNoise, tests: int) -> Columns:
    used = np.flatnonzero(term.sd)
    values = np.zeros((tests, SIZE, len(used)))
    values[:, used, np.arange(len(used))] = 1.0
    return Columns(
        tuple(f"{term.hyper}_{i}" for i in used),
        values,
        term.sd[used],
        term.hyper,
        private=True,
        circle=term.circle,
    )


def _departing(even: Sequence[Even]) -> list[Columns]:
    """By what the noise of circles exceeds that of uniform ones where readings are missing, and
    falls below it, as a negative variance, where they crowd: σ² (1 + V λ Vᵀ)⁻¹ = σ² (1 − V λ/(1 +
    λ) Vᵀ)."""
    found = []
    for name, sign in (("sparse", -1.0), (_CROWDED, 1.0)):
        kept = [np.flatnonzero(own.counts & (sign * own.departure > 0.0)) for own in even]
        values = np.zeros((len(even), SIZE, max(map(len, kept))))
        for part, own, columns in zip(values, even, kept, strict=True):
            share = np.abs(own.departure[columns]) / (1.0 + own.departure[columns])
            part[:, : len(columns)] = own.along[:, columns] * np.sqrt(share) / own.size[:, None]
        names = tuple(f"{name}_{i}" for i in range(values.shape[2]))
        found.append(Columns(names, values, np.ones(len(names)), "sigma", private=True))
    return [own for own in found if own.names]


def _to_ten_digits(values: Array) -> Array:
    """Values whose last digits, rounding of the projection, no longer tell equal rows apart."""
    size = 10.0 ** (9 - np.floor(np.log10(np.where(values > 0, values, 1.0))))
    return np.round(values * size) / size


@cache
def _keep_freed_memory() -> None:
    """Let go of one large array: GNU's malloc then keeps freed arrays up to its size (mallopt(3),
    M_MMAP_THRESHOLD): stacks of small matrices are two to three times faster."""
    np.empty(_MALLOC_BYTES, dtype=np.uint8)


@dataclass(frozen=True, eq=False)
class Information:
    """z = A c + e at given φ, c in units of its prior sd and e white: the posterior covariance of c
    is (1 + AᵀA)⁻¹.

    Of the m coefficients ``names`` and ``owners``, the term of each or ``OWN`` for a parameter of
    interest; ``scale`` (m,), the prior sd, or a typical size where parameters have ``flat`` priors;
    by block of readings ``design`` (k, m), columns per unit of the coefficients, and ``noise``, the
    covariance (k, k) of every independent source. What a question takes as known leaves the design
    or the noise. No readings are needed, only where they would be taken.
    """

    names: tuple[str, ...]
    owners: tuple[str, ...]
    scale: Array
    flat: bool
    design: tuple[Array, ...]
    noise: tuple[dict[str, Array], ...]

    def __post_init__(self) -> None:
        if not (np.isfinite(self.scale) & (self.scale > 0)).all():
            raise InputError(
                f"prior sd must be positive and finite, got {self.scale.min():g} …"
                f" {self.scale.max():g}."
            )

    @property
    def own(self) -> NDArray[np.intp]:
        """Which coefficients are parameters of interest."""
        return np.flatnonzero([owner == OWN for owner in self.owners])

    @property
    def terms(self) -> tuple[str, ...]:
        """The nuisance terms, those of the noise last; reading noise is not one of them."""
        in_noise = (source for block in self.noise for source in block)
        return tuple(
            name for name in dict.fromkeys([*self.owners, *in_noise]) if name not in (OWN, NOISE)
        )

    @property
    def shared_terms(self) -> tuple[str, ...]:
        """The nuisance terms with coefficients of their own."""
        return tuple(dict.fromkeys(owner for owner in self.owners if owner != OWN))

    def rows(self, known: Collection[str] = ()) -> Array:
        """A, shape (k, m): the design whitened by the noise that is not known, columns in units of
        the prior sd."""
        return np.concatenate(self.blocks(known))

    def blocks(self, known: Collection[str] = ()) -> list[Array]:
        """The same block by block; those that share their noise are whitened together."""
        if any(all(source in known for source in noise) for noise in self.noise):
            raise InputError(
                "reading noise must be left: readings without any would make everything known."
            )
        white: dict[int, Array] = {}
        together: dict[int, list[int]] = {}
        for k, noise in enumerate(self.noise):
            together.setdefault(id(noise), []).append(k)
        for alike in together.values():
            left = np.sum(
                [part for source, part in self.noise[alike[0]].items() if source not in known],
                axis=0,
            )
            rows = np.stack([self.design[k] for k in alike], axis=1) * self.scale
            solved = scipy.linalg.solve_triangular(
                np.linalg.cholesky(left), rows.reshape(len(rows), -1), lower=True
            )
            white.update(zip(alike, np.moveaxis(solved.reshape(rows.shape), 1, 0), strict=True))
        return [white[k] for k in range(len(self.design))]

    def root(
        self, known: Collection[str] = (), *, times: float = 1.0
    ) -> tuple[Array, NDArray[np.intp]]:
        """Upper triangular R with RᵀR = prior + readings' precision of the coefficients left, and
        which these are."""
        pairs = zip(self.owners, self.names, strict=True)
        left = np.flatnonzero([owner not in known and name not in known for owner, name in pairs])
        rows = np.sqrt(times) * (self.rows(known) if known else self._rows)[:, left]
        prior = np.array([0.0 if self.flat and self.owners[k] == OWN else 1.0 for k in left])
        stacked: Any = np.concatenate([rows, np.diag(prior)])
        return np.asarray(np.linalg.qr(stacked, mode="r")), left

    def covariance(self, known: Collection[str] = (), *, times: float = 1.0) -> Array:
        """Posterior covariance in units of the prior sd, shape (m, m), zero for what is known:
        terms (noise too), or single coefficients; ``times``: how often all readings are taken, each
        time with noise of its own."""
        root, left = self.root(known, times=times)
        inverse = scipy.linalg.solve_triangular(root, np.eye(len(root)))
        covariance = np.zeros((len(self.names), len(self.names)))
        covariance[np.ix_(left, left)] = inverse @ inverse.T
        return covariance

    def variances(self, known: Collection[str] = (), *, times: float = 1.0) -> Array:
        """Posterior variances of the parameters of interest in units of their prior variance, shape
        (p,); see `covariance`."""
        return np.diag(self.covariance(known, times=times))[self.own]

    def shares(self, covariance: Array | None = None) -> dict[tuple[str, str], Array]:
        """Share of every independent source, (coefficient or noise, term), in the variance of the
        parameters, each shape (p,).

        With the estimate written as a linear map of prior means and readings, every source s passes
        through it alone; with Cov_s what it leaves and C their sum, E[part_s | error] = Γ_s error
        with Γ_s = Cov_s C⁻¹, Σ Γ_s = 1. The share in the variance of parameter i is [Γ_s V]_ii /
        V_ii: shares sum to one. V is C, or the ``covariance`` (p, p) given.
        """
        joint = self.covariance()
        own = self.own
        total = joint[np.ix_(own, own)]
        weight = np.eye(len(own)) if covariance is None else np.linalg.solve(total, covariance)
        variance = np.diag(total if covariance is None else covariance)
        weight = weight / np.where(variance > 0.0, variance, 1.0)
        parts: dict[tuple[str, str], Array] = {} if self.flat else {(OWN, OWN): total @ total.T}
        for k, (name, owner) in enumerate(zip(self.names, self.owners, strict=True)):
            if owner != OWN:
                parts[name, owner] = np.outer(joint[own, k], joint[own, k])
        for design, noise in zip(self.design, self.noise, strict=True):
            root = np.linalg.cholesky(sum(noise.values(), np.zeros((len(design), len(design)))))
            gain = scipy.linalg.cho_solve((root, True), design * self.scale) @ joint[:, own]
            for source, part in noise.items():
                parts[source, source] = parts.get((source, source), 0.0) + gain.T @ part @ gain
        return {key: np.einsum("ij,ji->i", part, weight) for key, part in parts.items()}

    def contributions(self) -> dict[str, Array]:
        """`shares` by term. That of a source is also d ln sd(β) / d ln (its scale), the other
        scales held."""
        found: dict[str, Array] = {}
        for (_, term), share in self.shares().items():
            found[term] = found.get(term, 0.0) + share
        return found

    @cached_property
    def _rows(self) -> Array:
        return self.rows()
