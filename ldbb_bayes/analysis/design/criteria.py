"""What a design is good for: functions of S, the information about the parameters of interest with all others projected out.

S, shape (..., s, s), is the posterior precision of the s parameters of interest, in units in which they are comparable: the Schur
complement of the whole precision matrix. It comes as its lower triangular root, S = L Lᵀ. A criterion has a `value` Φ(S), shape
(...), that never falls when information is added; `directions` Q (..., s, q) with ∂Φ/∂S = Q Qᵀ, which drive the search; whether
it is `concave`, so that a local optimum over shares is the optimum; and the `efficiency`, 0 … 1, of a design beside the best.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ldbb_bayes.errors import check_known, require
from ldbb_bayes.model.hybrid import BoundModel, informations_of
from ldbb_bayes.model.likelihood import OWN
from ldbb_bayes.model.prior import Prior

__all__ = [
    "Case",
    "Criterion",
    "CriterionName",
    "Determinant",
    "LogBayesFactor",
    "Objective",
    "SmallestEigenvalue",
    "Variance",
    "case_of",
    "chosen_parameters",
    "criterion_of",
    "together",
]

Array = NDArray[Any]
_NEGLIGIBLE, _ROUNDING, _NOTHING = 1e-14, 1e-12, 1e-6
_CHUNK = 1 << 22


@dataclass(frozen=True)
class Determinant:
    """Φ = ln det S: D and D_s; with proper priors Φ/2 is the expected information gain but for a constant [nat]."""

    concave: ClassVar[bool] = True
    size: int

    def value(self, root: Array) -> Array:
        return np.asarray(2.0 * np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=-1))

    def directions(self, root: Array) -> Array:
        return _inverse_transposed(root)

    def efficiency(self, value: float, best: float) -> float:
        """(det S / det S*)^(1/s), s the number of parameters."""
        return float(np.exp((value - best) / self.size))


@dataclass(frozen=True, eq=False)
class Variance:
    """Φ = −tr(W S⁻¹), W (s, s): A (W = 1), c (W = c cᵀ), I (W the mean of x xᵀ over what is to be predicted)."""

    concave: ClassVar[bool] = True
    weight: Array

    def value(self, root: Array) -> Array:
        inverse = _inverse_transposed(root)
        return np.asarray(-np.einsum("ij,...jk,...ik->...", self.weight, inverse, inverse))

    def directions(self, root: Array) -> Array:
        """S⁻¹ W^½."""
        inverse = _inverse_transposed(root)
        values, vectors = np.linalg.eigh(self.weight)
        kept = values > _NEGLIGIBLE * values.max()
        return np.asarray(inverse @ np.swapaxes(inverse, -1, -2) @ (vectors[:, kept] * np.sqrt(values[kept])))

    def efficiency(self, value: float, best: float) -> float:
        """Ratio of the mean variances."""
        return float(best / value)


@dataclass(frozen=True)
class SmallestEigenvalue:
    """Φ = the smallest eigenvalue of S: E, the least determined combination."""

    concave: ClassVar[bool] = True

    def value(self, root: Array) -> Array:
        return np.asarray(np.linalg.eigvalsh(_square(root))[..., 0])

    def directions(self, root: Array) -> Array:
        """The eigenvector (one of them, where several share the eigenvalue)."""
        return np.asarray(np.linalg.eigh(_square(root))[1][..., :, :1])

    def efficiency(self, value: float, best: float) -> float:
        return float(value / best)


@dataclass(frozen=True)
class LogBayesFactor:
    """Φ = the expected ln B in favour of the truth, with the parameters or without them, both equally probable.

    With S in units of the prior, eigenvalues 1 + λ, and parameters that are `size` prior sd in the mean square, E[ln B] is
    ½ Σ [(1 + size² λ) λ/(1 + λ) − ln(1 + λ)] if they are there and ½ Σ [λ/(1 + λ) − ln(1 + λ)] if not; half the difference is
    Φ = ¼ size² Σ λ²/(1 + λ), which never falls. For one parameter it leads to the design of T-optimality. Not concave: an optimum
    is a local one.
    """

    concave: ClassVar[bool] = False
    size: float = 1.0

    def value(self, root: Array) -> Array:
        gain = np.maximum(np.linalg.eigvalsh(_square(root)) - 1.0, 0.0)
        return np.asarray(0.25 * self.size**2 * (gain**2 / (1.0 + gain)).sum(axis=-1))

    def directions(self, root: Array) -> Array:
        """The eigenvectors times the root of dΦ/d(1 + λ)."""
        s, vectors = np.linalg.eigh(_square(root))
        rate = 0.25 * self.size**2 * (1.0 - 1.0 / np.maximum(s, 1.0) ** 2)
        return np.asarray(vectors * np.sqrt(rate)[..., None, :])

    def efficiency(self, value: float, best: float) -> float:
        return float(value / best)


Criterion: TypeAlias = Determinant | Variance | SmallestEigenvalue | LogBayesFactor


def _square(root: Array) -> Array:
    return np.asarray(root @ np.swapaxes(root, -1, -2))


def _inverse_transposed(root: Array) -> Array:
    """L⁻ᵀ, whose square is S⁻¹."""
    return np.linalg.solve(np.swapaxes(root, -1, -2), np.broadcast_to(np.eye(root.shape[-1]), root.shape))


CriterionName = Literal["eig", "d", "a", "c", "i", "e", "discriminate"]
_CRITERIA: tuple[CriterionName, ...] = ("eig", "d", "a", "c", "i", "e", "discriminate")
_PREDICTED_FORCES = 33


def chosen_parameters(bound: BoundModel, criterion: CriterionName, names: Sequence[str]) -> tuple[str, ...]:
    """The parameters of interest: those named, else all that the criterion is about."""
    check_known("criterion", [criterion], _CRITERIA)
    check_known("parameter", names, bound.names)
    wanted = {"discriminate": {"slope"}, "i": {"compliance", "slope"}}.get(criterion, {"compliance", "slope", "geometric"})
    chosen = tuple(p.name for p in bound.parameters if (p.name in names if names else p.group in wanted))
    groups = {p.group for p in bound.parameters if p.name in chosen}
    one = criterion != "c" or len(chosen) == 1
    require(one, f"criterion c must be given one parameter, got {len(chosen)}. Name it, for example E_C0YX.")
    require(
        criterion != "discriminate" or groups == wanted,
        "criterion discriminate must be about slopes, got others or none. Name slopes such as C_XYX_1, or use a model of degree "
        "1 or 2.",
    )
    proper = criterion != "discriminate" or not bound.model.prior.flat
    require(proper, "criterion discriminate must have proper priors, got flat ones. Use the default preset.")
    concerned = "criterion i must be about compliances and their slopes, got a geometric error. Leave it out."
    require(groups <= wanted, concerned)
    return chosen


def criterion_of(
    bound: BoundModel,
    criterion: CriterionName,
    chosen: Sequence[str],
    *,
    size: float = 1.0,
    targets: Mapping[str, float] = MappingProxyType({}),
) -> Criterion:
    """The criterion, its parameters in units of their prior sd (their default prior sd when flat).

    ``size`` is that of slopes for ``discriminate`` [prior sd]; ``targets`` are units for ``a`` and ``c`` instead of that.
    """
    if criterion in ("eig", "d"):
        return Determinant(len(chosen))
    if criterion in ("a", "c"):
        scale = dict(zip(bound.names, bound.scale, strict=True))
        unit = np.array([scale[name] / targets.get(name, scale[name]) for name in chosen])
        return Variance(np.diag(unit**2) / len(chosen))
    if criterion == "e":
        return SmallestEigenvalue()
    return LogBayesFactor(size) if criterion == "discriminate" else Variance(_prediction_weight(bound, chosen))


def _prediction_weight(bound: BoundModel, chosen: Sequence[str]) -> Array:
    """W with tr(W S⁻¹) the variance of C_j(F) / var prior of C_j, averaged over the pilot's forces and the compliances."""
    forces = (bound.pilot or bound.campaign).forces_N
    own = [bound.names.index(name) for name in chosen]
    prior = Prior.default() if bound.model.prior.flat else bound.model.prior
    unit = prior.compliance_sd(bound.compliances, 0, bound.setting.force_range_N)
    concerned = {parameter.compliance for parameter in bound.parameters if parameter.name in chosen}
    used = [k for k, compliance in enumerate(bound.compliances) if compliance.label in concerned]
    at = np.linspace(forces.min(), forces.max(), _PREDICTED_FORCES)
    rows = np.concatenate([(bound.compliance_at(force)[:, own] * bound.scale[own] / unit[:, None])[used] for force in at])
    return np.asarray(rows.T @ rows / len(rows))


@dataclass(frozen=True, eq=False)
class Case:
    """One model at K values of its hyper-parameters.

    Attributes
    ----------
    rows : ndarray, shape (K, candidates, m, p)
        G: the information of one test of a candidate is GᵀG; the s parameters of interest are the last columns.
    prior : ndarray, shape (K, p, p)
        P: precision before the new tests; prior and tests already run.
    weight : ndarray, shape (K,)
        Share of each in the objective.
    interest : int
        s.
    """

    rows: Array
    prior: Array
    weight: Array
    interest: int
    criterion: Criterion

    def precision(self, counts: Array) -> Array:
        """M, shape (K, p, p)."""
        used = np.flatnonzero(counts)
        scaled = self.rows[:, used] * np.sqrt(counts[used])[:, None, None]
        stacked = scaled.reshape(len(scaled), -1, scaled.shape[-1])
        return np.asarray(self.prior + np.swapaxes(stacked, -1, -2) @ stacked)

    def value(self, precision: Array) -> Array:
        """Weighted sum of Φ over the K values, shape (...), of M with shape (..., K, p, p); −inf where M is singular."""
        values = self._values(precision.reshape(-1, *precision.shape[-2:]))
        return np.asarray(values.reshape(precision.shape[:-2]) @ self.weight)

    def _values(self, precision: Array) -> Array:
        try:
            root = np.linalg.cholesky(precision)
        except np.linalg.LinAlgError:
            if len(precision) == 1:
                return np.array([-np.inf])
            return np.concatenate([self._values(matrix[None]) for matrix in precision])
        values = self.criterion.value(root[:, -self.interest :, -self.interest :])
        if self._open:
            # Where only rounding kept a factorisation alive: what is left of a column beside the others is nothing.
            left = np.diagonal(root, axis1=-2, axis2=-1) / np.sqrt(np.diagonal(precision, axis1=-2, axis2=-1))
            values = np.where(left.min(axis=-1) < _NOTHING, -np.inf, values)
        return values

    @cached_property
    def _open(self) -> bool:
        """Whether the tests must determine something that nothing determines before."""
        return bool(np.linalg.matrix_rank(self.prior).min() < self.prior.shape[-1])

    def sensitivity(self, precision: Array) -> tuple[float, Array]:
        """Φ and ∂Φ/∂n_i = Σ_k ‖G_ki D_k‖², shape (candidates,), with ∂Φ/∂M = D Dᵀ."""
        s = self.interest
        nuisance, cross = precision[..., :-s, :-s], precision[..., :-s, -s:]
        back = -np.linalg.solve(nuisance, cross)
        root = np.linalg.cholesky(precision[..., -s:, -s:] + np.swapaxes(cross, -1, -2) @ back)
        own = self.criterion.directions(root) * np.sqrt(self.weight)[:, None, None]
        slope = np.zeros(self.rows.shape[1])
        for rows, direction in zip(self.rows, np.concatenate([back @ own, own], axis=-2), strict=True):
            slope += ((rows.reshape(-1, rows.shape[-1]) @ direction) ** 2).sum(axis=1).reshape(len(slope), -1).sum(axis=1)
        return float(self.criterion.value(root) @ self.weight), slope


def case_of(bound: BoundModel, run: int, phi: Array, chosen: Sequence[str], criterion: Criterion) -> Case:
    """The candidates' information on the chosen parameters at every φ (K, h); nuisances that touch none of them are left out.

    The model is bound to the tests already run, ``run`` of them, followed by the candidates.
    """
    rows, prior = [], []
    order = kept = proper = np.zeros(0, dtype=int)
    for k, information in enumerate(informations_of(bound, phi)):
        blocks = _compact(information.blocks())
        if not k:
            own = [information.names.index(name) for name in chosen]
            order = _connected(blocks, own)
            kept = np.flatnonzero(np.abs(blocks[:, :, order]).max(axis=(0, 2)) > 0.0)
            proper = np.array([not (information.flat and owner == OWN) for owner in information.owners])[order]
        blocks = blocks[:, :, order][:, kept]
        before = blocks[:run].reshape(-1, len(order))
        prior.append(np.diag(proper.astype(float)) + before.T @ before)
        rows.append(blocks[run:])
    return Case(np.array(rows), np.array(prior), np.full(len(phi), 1.0 / len(phi)), len(chosen), criterion)


def _compact(blocks: Sequence[Array]) -> Array:
    """Blocks of at most 25 rows as one array, rounding errors set to zero."""
    size = max(len(block) for block in blocks)
    stacked = np.array([np.pad(block, ((0, size - len(block)), (0, 0))) for block in blocks])
    stacked[np.abs(stacked) < _ROUNDING * np.abs(stacked).max(axis=(0, 1))] = 0.0
    return stacked


def _connected(blocks: Array, own: Sequence[int]) -> NDArray[np.int_]:
    """Columns that share readings with those of interest, directly or through others; those of interest last."""
    size = np.abs(blocks)
    label = connected_components(np.einsum("rij,rik->jk", size, size) > 0.0, directed=False)[1]
    joined = np.isin(label, label[list(own)])
    joined[list(own)] = False
    return np.array([*np.flatnonzero(joined), *own], dtype=int)


@dataclass(frozen=True, eq=False)
class Objective:
    """The sum of cases, all of the same candidates; designs are numbers of tests, counts (candidates,)."""

    cases: tuple[Case, ...]

    @property
    def candidates(self) -> int:
        return int(self.cases[0].rows.shape[1])

    def value(self, counts: Array) -> float:
        """Φ of a design; −inf where it leaves something undetermined."""
        return float(sum(case.value(case.precision(counts)) for case in self.cases))

    def sensitivity(self, counts: Array) -> tuple[float, Array]:
        """Φ and ∂Φ/∂n_i, shape (candidates,)."""
        values, slopes = zip(*(case.sensitivity(case.precision(counts)) for case in self.cases), strict=True)
        return sum(values), np.sum(slopes, axis=0)

    def among(self, chosen: Array) -> Objective:
        """The same with only some of the candidates."""
        return Objective(tuple(replace(case, rows=case.rows[:, chosen]) for case in self.cases))

    def under(self, criterion: Criterion) -> Objective:
        """The same candidates under another criterion."""
        return Objective(tuple(replace(case, criterion=criterion) for case in self.cases))

    def at_few(self, size: int) -> Objective:
        """The same at the first values of the hyper-parameters alone."""
        parts = [(case, case.weight[:size] * (case.weight.sum() / case.weight[:size].sum())) for case in self.cases]
        return Objective(tuple(replace(case, rows=case.rows[:size], prior=case.prior[:size], weight=w) for case, w in parts))

    def after_adding(self, counts: Array, chosen: Array) -> Array:
        """Φ with one more test of each of some candidates in turn, shape (chosen,)."""
        total = np.zeros(len(chosen))
        for case in self.cases:
            base = case.precision(counts)
            size = max(1, _CHUNK // base.size)
            for start in range(0, len(chosen), size):
                rows = case.rows[:, chosen[start : start + size]]
                gram = np.swapaxes(rows, -1, -2) @ rows
                total[start : start + size] += case.value(base + np.swapaxes(gram, 0, 1))
        return total

    def efficiency(self, value: float, best: float) -> float:
        """Of a design with this value beside the best."""
        return self.cases[0].criterion.efficiency(value, best) if np.isfinite(value) else 0.0


def together(objectives: Iterable[Objective]) -> Objective:
    """The average of objectives; of ln det, which grows with the number of parameters, every model counts by its efficiency."""
    cases = [case for objective in objectives for case in objective.cases]
    sizes = [case.interest if isinstance(case.criterion, Determinant) else 1 for case in cases]
    shares = [sizes[0] / size / len(cases) for size in sizes]
    return Objective(tuple(replace(case, weight=case.weight * share) for case, share in zip(cases, shares, strict=True)))
