"""ln p(z | β, φ), and the conditional Gaussian of the coefficients: nuisances integrated out in closed form.

z_r = R_r (H_r β + U_r u + V_r v_r + e_r) + ε for every test r, reduced to z_r and R_r; u ~ N(m, s²) shared by all tests, v_r ~
N(0, s²) and e_r ~ N(0, s²) of each alone, ε ~ N(0, σ²), all scales products of known numbers and of φ. Rows are turned so that
R_r e_r + ε has a diagonal covariance D(φ) = weights · [φ², 1]. Then

    Σ_r = D + V sᵥ² Vᵀ               the private columns of one test, Woodbury's identity with a v × v root;
    P   = s⁻² + Σ_r Uᵀ Σ_r⁻¹ U        the shared columns, Cholesky with a q × q root.

Where every circle is sampled uniformly, basis functions that no column links are independent: blocks of their own.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ldbb_bayes.errors import InputError
from ldbb_bayes.model.fourier import SIZE, Reduced
from ldbb_bayes.model.gaussian import Gaussian, factor_and_solve, log_diagonal, solve_lower, solve_upper
from ldbb_bayes.model.terms import BasisNoise, Columns, Hyper
from ldbb_bayes.model.truncation import Orthant, Truncation

__all__ = ["NOISE", "OWN", "Information", "ParameterConditional", "StructuredGaussian"]

OWN = "Parameters"
NOISE = "ReadingNoise"

Array = NDArray[Any]
_LOG_2PI = float(np.log(2 * np.pi))
_MALLOC_BYTES = 31 << 20


class ParameterConditional(Gaussian):
    """p(β | y, φ) for w values of φ, truncation aside; ``physical``: A β ≥ 0, whether or not the model imposes it."""

    physical: Truncation

    @cached_property
    def orthant(self) -> Orthant:
        """The problem of P(A β ≥ 0 | y, φ)."""
        return Orthant(self.mean @ self.physical.rows.T, self.spread(self.physical.rows))

    def draw_inside(self, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
        """One exact draw per φ inside A β ≥ 0, shape (w, p), and where it is one: the rejection sampler did not give up, and
        rounding did not leave β outside."""
        white, exact = self.orthant.draw_spread(rng)
        beta = self.at(white)
        return beta, exact & self.physical.holds(beta)


class _Rows(NamedTuple):
    """Turned rows of all tests, padded to 25 each: weights (T, 25, h + 1) of [φ², 1] in D; columns (T, 25, ·); z (T, 25)."""

    weights: Array
    private: Array
    shared: Array
    interest: Array
    residual: Array


class _Block:
    """b independent groups of m rows a test, of the same shape, each linked within itself; ``index`` (b, q) of shared columns."""

    def __init__(self, rows: _Rows, members: Array, index: Array, *, private: bool) -> None:
        def pick(array: Array) -> Array:
            return np.ascontiguousarray(np.moveaxis(array[:, members], 1, 0))

        self.index = index
        self.weights, self.interest, self.residual = pick(rows.weights), pick(rows.interest), pick(rows.residual)
        self.private = pick(rows.private) if private else pick(rows.private)[..., :0]
        self.shared = np.take_along_axis(pick(rows.shared), index[:, None, None, :], axis=3)
        self.columns = np.concatenate([self.private, self.shared], axis=3)
        self.pairs = _products(self.shared, self.shared)
        self.private_pairs = _products(self.private, self.columns)
        # Rows of the same noise are taken together: uniform circles of one length have few kinds, however many tests there are.
        flat = self.weights.reshape(-1, self.weights.shape[-1])
        self.kinds, kind = np.unique(_to_ten_digits(flat), axis=0, return_inverse=True)
        self.kind_pairs = np.zeros((len(members), len(self.kinds), self.pairs.shape[3]))
        group = np.repeat(np.arange(len(members)), self.weights[0, :, :, 0].size)
        np.add.at(self.kind_pairs, (group, kind.ravel()), self.pairs.reshape(len(flat), self.pairs.shape[3]))


class _Condensed(NamedTuple):
    """A block with its private columns integrated out, test by test: ln density (w, b, T); Uᵀ Σ⁻¹ r (w, b, T, q); 1/D; and of the
    private coefficients the root (w, b, T, v, v), the white mean (w, b, T, v) and the links (w, b, T, v, q), with
    Uᵀ Σ⁻¹ U = Uᵀ D⁻¹ U − linksᵀ links."""

    log_density: Array
    projected: Array
    weight: Array
    root: Array
    white: Array
    links: Array


class StructuredGaussian:
    """p(z | β, φ) with the shared and private columns integrated out.

    Columns that tests share come in the order given in `conditional`; ``interest`` H (tests, 25, p), whose coefficients are given
    in every call; ``offset`` (tests, 25), the known part of the readings in the basis, is subtracted beforehand.
    """

    def __init__(
        self,
        reduced: Sequence[Reduced],
        columns: Sequence[Columns | BasisNoise],
        *,
        interest: Array,
        offset: Array,
        hypers: Sequence[Hyper],
    ) -> None:
        _keep_freed_memory()
        self._residual_ss = np.array([test.residual_ss for test in reduced])
        self._readings = np.array([test.readings for test in reduced])
        shared = [term for term in columns if isinstance(term, Columns) and not term.private]
        private = [term for term in columns if isinstance(term, Columns) and term.private]
        noise = [term for term in columns if isinstance(term, BasisNoise)]
        diagonal = all(test.is_orthogonal for test in reduced)
        # Of arcs only one noise can be made diagonal: that of most orders. The others become private columns.
        absorbed = noise if diagonal else sorted(noise, key=lambda term: -np.count_nonzero(term.sd))[:1]
        private += [_as_columns(term, len(reduced)) for term in noise if term not in absorbed]
        rows = _turned_rows(reduced, absorbed, private, shared, interest, offset, tuple(hypers), diagonal=diagonal)
        self._blocks = _split(rows, diagonal=diagonal)
        self._private_sd, self._private_hyper = _scales(private, hypers)
        self._shared_sd, self._shared_hyper = _scales(shared, hypers)
        means = [np.zeros(len(term.names)) if term.mean is None else term.mean for term in shared]
        self._shared_mean = np.concatenate([np.zeros(0), *means])

    def log_density(self, phi: Array, beta: Array) -> Array:
        """ln p(z | β, φ), shape (w,), at φ (w, hypers) [mm] and β (w, p), or (p,)."""
        total = self._outside(phi).sum(axis=1)
        for _, log_density, *_ in self._integrated(phi, beta):
            total = total + log_density
        return np.asarray(total)

    def log_density_without(self, phi: Array, beta: Array) -> Array:
        """ln p(z without test r | β, φ) for every r, shape (w, tests)."""
        outside, full = self._outside(phi), _with_one(phi)
        total = outside.sum(axis=1, keepdims=True) - outside
        for block in self._blocks:
            part = self._condense(block, full, beta)
            q = block.index.shape[1]
            gram = _contract(part.weight, block.pairs).reshape(*part.weight.shape[:3], q, q)
            gram = gram - np.swapaxes(part.links, -1, -2) @ part.links
            others = [array.sum(axis=2, keepdims=True) - array for array in (gram, part.projected)]
            density = part.log_density.sum(axis=1)
            total = total + density.sum(axis=1, keepdims=True) - density
            for r in range(total.shape[1]):
                total[:, r] += self._integrate(block, full, others[0][:, :, r], others[1][:, :, r])[0].sum(axis=1)
        return np.asarray(total)

    def conditional(self, phi: Array, beta: Array) -> tuple[Array, Gaussian]:
        """ln p(z | β, φ), shape (w,), and the q shared coefficients given z, β and φ, w Gaussians."""
        w, q = len(phi), len(self._shared_sd)
        total = self._outside(phi).sum(axis=1)
        mean, scale, root = np.zeros((w, q)), np.zeros((w, q)), np.zeros((w, q, q))
        for block, log_density, lower, white, block_scale in self._integrated(phi, beta):
            total = total + log_density
            solved = solve_upper(lower, white) * block_scale
            for k, index in enumerate(block.index):
                mean[:, index], scale[:, index] = solved[:, k], block_scale[:, k]
                root[:, index[:, None], index] = lower[:, k]
        return total, Gaussian.factored(mean, root, scale, total)

    def private_mean(self, phi: Array, beta: Array, shared: Array) -> Array:
        """Conditional mean of every private coefficient given β, φ and the shared coefficients, shape (w, tests, v).

        Columns come in the order given, then basis noise that could not be made diagonal.
        """
        full = _with_one(phi)
        (block,) = (block for block in self._blocks if block.private.shape[3])
        part = self._condense(block, full, beta, shared)
        return solve_upper(part.root, part.white)[:, 0] * (self._private_sd * full[:, self._private_hyper])[:, None, :]

    def _outside(self, phi: Array) -> Array:
        """Per test: constants, and the readings' part outside the basis, shape (w, tests)."""
        square, left = phi[:, :1] ** 2, np.maximum(self._readings - SIZE, 0)
        return np.asarray(-0.5 * (self._readings * _LOG_2PI + left * np.log(square) + self._residual_ss / square))

    def _integrated(self, phi: Array, beta: Array) -> Iterator[tuple[_Block, Array, Array, Array, Array]]:
        """Block by block: ln density (w,); root, white mean and scale of the shared coefficients given z."""
        full = _with_one(phi)
        for block in self._blocks:
            part = self._condense(block, full, beta)
            q = block.index.shape[1]
            weight = 1.0 / ((full**2) @ block.kinds.T)
            gram = np.swapaxes(weight @ block.kind_pairs, 0, 1).reshape(len(phi), len(block.index), q, q)
            if part.links.size:
                links = part.links.reshape(*part.links.shape[:2], -1, q)
                gram = gram - np.swapaxes(links, -1, -2) @ links
            gained, root, white, scale = self._integrate(block, full, gram, part.projected.sum(axis=2))
            yield block, part.log_density.sum(axis=(1, 2)) + gained.sum(axis=1), root, white, scale

    def _condense(self, block: _Block, full: Array, beta: Array, shared: Array | None = None) -> _Condensed:
        """Integrate the private columns, group by group and test by test; the shared coefficients zero, or as given (w, q)."""
        variance = np.moveaxis(block.weights @ (full**2).T, -1, 0)
        residual = block.residual - np.moveaxis(block.interest @ np.atleast_2d(beta).T, -1, 0)
        if shared is not None:
            residual = residual - np.einsum("btmq,wbq->wbtm", block.shared, shared[:, block.index])
        weight = 1.0 / variance
        weighted = residual * weight
        density = -0.5 * (np.log(variance) + weighted * residual).sum(axis=3)
        v, q = block.private.shape[3], block.index.shape[1]
        projected = _contract(weighted, block.columns)
        if not v:
            none = np.zeros((*density.shape, 0))
            return _Condensed(density, projected, weight, none[..., None], none, np.zeros((*none.shape, q)))
        sd = (self._private_sd * full[:, self._private_hyper])[:, None, None, :]
        gram = _contract(weight, block.private_pairs).reshape(*weight.shape[:3], v, v + q)
        inner = gram[..., :v] * (sd[..., :, None] * sd[..., None, :]) + np.eye(v)
        cross = np.concatenate([gram[..., v:], projected[..., :v, None]], axis=-1) * sd[..., :, None]
        root = np.linalg.cholesky(inner) if v > 1 else np.sqrt(inner)
        solved = solve_lower(root, cross)
        links, white = solved[..., :-1], solved[..., -1]
        density = density - log_diagonal(root) + 0.5 * (white**2).sum(axis=-1)
        return _Condensed(density, projected[..., v:] - np.einsum("...vq,...v->...q", links, white), weight, root, white, links)

    def _integrate(self, block: _Block, full: Array, gram: Array, projected: Array) -> tuple[Array, Array, Array, Array]:
        """Integrate the shared coefficients: log density gained (w, b), Cholesky factor, white mean and scale.

        Precisions are in units of the prior sd, which may be zero, or infinite for a flat prior.
        """
        sd = (self._shared_sd * full[:, self._shared_hyper])[:, block.index]
        flat = np.isinf(sd)
        diagonal = np.diagonal(gram, axis1=-2, axis2=-1)
        scale = np.where(flat, 1.0 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0)), sd)
        standard = np.where(flat, 0.0, self._shared_mean[block.index] / np.where(sd > 0, scale, 1.0))
        precision = gram * (scale[..., :, None] * scale[..., None, :])
        span = np.arange(sd.shape[2])
        precision[..., span, span] += ~flat
        root, white = factor_and_solve(precision, projected * scale + standard)
        flat_volume = (flat * (np.log(np.where(flat, scale, 1.0)) + 0.5 * _LOG_2PI)).sum(axis=-1)
        gained = flat_volume - log_diagonal(root) + 0.5 * ((white**2).sum(axis=-1) - (standard**2).sum(axis=-1))
        return gained, root, white, scale


def _turned_rows(
    reduced: Sequence[Reduced],
    absorbed: Sequence[BasisNoise],
    private: Sequence[Columns],
    shared: Sequence[Columns],
    interest: Array,
    offset: Array,
    hypers: tuple[Hyper, ...],
    *,
    diagonal: bool,
) -> _Rows:
    """Every test's rows, turned so that the absorbed noise is diagonal."""
    tests = len(reduced)
    every = [np.concatenate([np.zeros((tests, SIZE, 0)), *(term.values for term in part)], axis=2) for part in (private, shared)]
    sources = [*every, interest]
    out = [np.zeros(source.shape) for source in sources]
    weights, residual = np.zeros((tests, SIZE, len(hypers) + 1)), np.zeros((tests, SIZE))
    weights[:, :, -1] = 1.0  # rows that a test does not have: variance 1, residual 0
    for r, test in enumerate(reduced):
        m = len(test.factor)
        turn, spread = np.eye(m), []
        if diagonal:
            size = np.diag(test.factor)
            turn, spread = np.diag(np.sign(size)), [np.abs(size) * term.sd for term in absorbed]
        elif absorbed:
            left, singular, _ = np.linalg.svd(test.factor * absorbed[0].sd)
            turn, spread = left.T, [singular]
        factor = turn @ test.factor
        if diagonal:
            factor = np.diag(np.diag(factor))
        weights[r, :m] = np.eye(len(hypers) + 1)[hypers.index("sigma")]
        for term, sd in zip(absorbed, spread, strict=True):
            weights[r, :m, hypers.index(term.hyper)] = sd**2
        for target, source in zip(out, sources, strict=True):
            target[r, :m] = factor @ source[r]
        if test.projection is not None:
            residual[r, :m] = turn @ test.projection - factor @ offset[r]
    return _Rows(weights, out[0], out[1], out[2], residual)


def _split(rows: _Rows, *, diagonal: bool) -> list[_Block]:
    """Separate the basis functions that no column links; without orthogonal sampling they are one group."""
    columns = rows.shared.shape[2]
    if not diagonal:
        return [_Block(rows, np.arange(SIZE)[None], np.arange(columns)[None], private=True)]
    own = np.any(rows.private != 0, axis=(0, 2)) | np.any(rows.interest != 0, axis=(0, 2))
    touched = np.any(rows.shared != 0, axis=0)
    count, label = connected_components(np.outer(own, own) | (touched @ touched.T), directed=False)
    main = int(label[np.flatnonzero(own)[0]]) if own.any() else -1
    groups: dict[tuple[int, int, bool], list[tuple[Array, Array]]] = {}
    for k in range(count):
        members = np.flatnonzero(label == k)
        index = np.flatnonzero(touched[members].any(axis=0))
        groups.setdefault((len(members), len(index), k == main), []).append((members, index))
    if not touched.any(axis=0).all():  # coefficients that no reading sees keep their prior
        groups[0, 0, False] = [(np.zeros(0, dtype=int), np.flatnonzero(~touched.any(axis=0)))]
    return [
        _Block(rows, np.array([m for m, _ in pairs]), np.array([i for _, i in pairs]), private=key[2])
        for key, pairs in groups.items()
    ]


def _as_columns(term: BasisNoise, tests: int) -> Columns:
    used = np.flatnonzero(term.sd)
    values = np.zeros((tests, SIZE, len(used)))
    values[:, used, np.arange(len(used))] = 1.0
    return Columns(tuple(f"{term.hyper}_{i}" for i in used), values, term.sd[used], term.hyper, private=True)


def _scales(terms: Sequence[Columns], hypers: Sequence[Hyper]) -> tuple[Array, NDArray[np.intp]]:
    """Prior sd of stacked columns, and which of [φ, 1] each is multiplied by."""
    owner = [len(hypers) if term.hyper is None else hypers.index(term.hyper) for term in terms for _ in term.names]
    return np.concatenate([np.zeros(0), *(term.sd for term in terms)]), np.array(owner, dtype=np.intp)


def _with_one(phi: Array) -> Array:
    return np.column_stack([phi, np.ones(len(phi))])


def _contract(weight: Array, columns: Array) -> Array:
    """Sum over the rows of each test: (w, b, T, m) with (b, T, m, c) → (w, b, T, c)."""
    return np.moveaxis(np.moveaxis(weight, 0, 2) @ columns, 2, 0)


def _products(left: Array, right: Array) -> Array:
    """(b, T, m, i) and (b, T, m, j) → (b, T, m, i j)."""
    return np.einsum("btmi,btmj->btmij", left, right).reshape(*left.shape[:3], left.shape[3] * right.shape[3])


def _to_ten_digits(values: Array) -> Array:
    """Values whose last digits, rounding of the projection, no longer tell equal rows apart."""
    size = 10.0 ** (9 - np.floor(np.log10(np.where(values > 0, values, 1.0))))
    return np.round(values * size) / size


@cache
def _keep_freed_memory() -> None:
    """Let go of one large array: GNU's malloc then keeps freed arrays up to its size (mallopt(3), M_MMAP_THRESHOLD): stacks of
    small matrices are two to three times faster."""
    np.empty(_MALLOC_BYTES, dtype=np.uint8)


@dataclass(frozen=True, eq=False)
class Information:
    """z = A c + e at given φ, c in units of its prior sd and e white: the posterior covariance of c is (1 + AᵀA)⁻¹.

    Of the m coefficients ``names`` and ``owners``, the term of each or ``OWN`` for a parameter of interest; ``scale`` (m,), the
    prior sd, or a typical size where parameters have ``flat`` priors; by block of readings ``design`` (k, m), columns per unit of
    the coefficients, and ``noise``, the covariance (k, k) of every independent source. What a question takes as known leaves
    the design or the noise. No readings are needed, only where they would be taken.
    """

    names: tuple[str, ...]
    owners: tuple[str, ...]
    scale: Array
    flat: bool
    design: tuple[Array, ...]
    noise: tuple[dict[str, Array], ...]

    def __post_init__(self) -> None:
        if not (np.isfinite(self.scale) & (self.scale > 0)).all():
            raise InputError(f"prior sd must be positive and finite, got {self.scale.min():g} … {self.scale.max():g}.")

    @property
    def own(self) -> NDArray[np.intp]:
        """Which coefficients are parameters of interest."""
        return np.flatnonzero([owner == OWN for owner in self.owners])

    @property
    def terms(self) -> tuple[str, ...]:
        """The nuisance terms, those of the noise last; reading noise is not one of them."""
        in_noise = (source for block in self.noise for source in block)
        return tuple(name for name in dict.fromkeys([*self.owners, *in_noise]) if name not in (OWN, NOISE))

    @property
    def shared_terms(self) -> tuple[str, ...]:
        """The nuisance terms with coefficients of their own."""
        return tuple(dict.fromkeys(owner for owner in self.owners if owner != OWN))

    def rows(self, known: Collection[str] = ()) -> Array:
        """A, shape (k, m): the design whitened by the noise that is not known, columns in units of the prior sd."""
        return np.concatenate(self.blocks(known))

    def blocks(self, known: Collection[str] = ()) -> list[Array]:
        """The same block by block; blocks of one size are whitened together."""
        if any(all(source in known for source in noise) for noise in self.noise):
            raise InputError("reading noise must be left: readings without any would make everything known.")
        white: dict[int, Array] = {}
        sizes = np.array([len(values) for values in self.design])
        for size in np.unique(sizes):
            alike = np.flatnonzero(sizes == size)
            left = [np.sum([part for source, part in self.noise[k].items() if source not in known], axis=0) for k in alike]
            root = np.linalg.cholesky(np.array(left))
            white.update(zip(alike, solve_lower(root, np.array([self.design[k] for k in alike]) * self.scale), strict=True))
        return [white[k] for k in range(len(sizes))]

    def root(self, known: Collection[str] = (), *, times: float = 1.0) -> tuple[Array, NDArray[np.intp]]:
        """Upper triangular R with RᵀR = prior + readings' precision of the coefficients left, and which these are."""
        pairs = zip(self.owners, self.names, strict=True)
        left = np.flatnonzero([owner not in known and name not in known for owner, name in pairs])
        rows = np.sqrt(times) * (self.rows(known) if known else self._rows)[:, left]
        prior = np.array([0.0 if self.flat and self.owners[k] == OWN else 1.0 for k in left])
        stacked: Any = np.concatenate([rows, np.diag(prior)])
        return np.asarray(np.linalg.qr(stacked, mode="r")), left

    def covariance(self, known: Collection[str] = (), *, times: float = 1.0) -> Array:
        """Posterior covariance in units of the prior sd, shape (m, m), zero for what is known: terms (noise too), or single
        coefficients; ``times``: how often all readings are taken, each time with noise of its own."""
        root, left = self.root(known, times=times)
        inverse = scipy.linalg.solve_triangular(root, np.eye(len(root)))
        covariance = np.zeros((len(self.names), len(self.names)))
        covariance[np.ix_(left, left)] = inverse @ inverse.T
        return covariance

    def variances(self, known: Collection[str] = (), *, times: float = 1.0) -> Array:
        """Posterior variances of the parameters of interest in units of their prior variance, shape (p,); see `covariance`."""
        return np.diag(self.covariance(known, times=times))[self.own]

    def shares(self, covariance: Array | None = None) -> dict[tuple[str, str], Array]:
        """Share of every independent source, (coefficient or noise, term), in the variance of the parameters, each shape (p,).

        With the estimate written as a linear map of prior means and readings, every source s passes through it alone; with Cov_s
        what it leaves and C their sum, E[part_s | error] = Γ_s error with Γ_s = Cov_s C⁻¹, Σ Γ_s = 1. The share in the variance
        of parameter i is [Γ_s V]_ii / V_ii: shares sum to one. V is C, or the ``covariance`` (p, p) given.
        """
        joint, own = self.covariance(), self.own
        total = joint[np.ix_(own, own)]
        weight = np.eye(len(own)) if covariance is None else np.linalg.solve(total, covariance)
        weight = weight / np.diag(total if covariance is None else covariance)
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
        """`shares` by term. That of a source is also d ln sd(β) / d ln (its scale), the other scales held."""
        found: dict[str, Array] = {}
        for (_, term), share in self.shares().items():
            found[term] = found.get(term, 0.0) + share
        return found

    @cached_property
    def _rows(self) -> Array:
        return self.rows()
