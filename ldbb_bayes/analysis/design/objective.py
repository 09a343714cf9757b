"""Objective of the search for a design: a criterion averaged over the hyper-parameters.

Hyper-parameters are quantities such as the standard deviation of the noise. A candidate is a test
that could be run, once or several times. A design consists of n_i runs of each candidate i. Let
G_i be the derivatives of the readings of candidate i with respect to the parameters, divided by the
standard deviation of the noise. Each test of candidate i adds the information G_iᵀG_i. The
precision (inverse covariance) of all parameters is M = P + Σ n_i G_iᵀG_i, where P is the precision
before the tests of the design. The criterion Φ is the figure of merit that the design maximises.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.analysis.design.criteria import Criterion
from ldbb_bayes.results import Array, Shown

__all__ = ["Objective"]

# Let L be the Cholesky factor of the precision matrix M (inverse covariance) of a design. The
# design is said not to determine parameter i if L_ii is below this share of √M_ii.
_SINGULAR_SHARE = 1e-6
# Largest number of elements of the precision matrices that `Objective.after_adding` computes at a
# time, so that little memory is needed.
_CHUNK_SIZE = 1 << 22


class _WithoutNuisance(NamedTuple):
    """Precision of the s parameters of interest when the n nuisance parameters are unknown.

    M is the precision matrix of all parameters, at each of K values of the hyper-parameters. Its
    blocks for nuisance parameters and parameters of interest are M_nn, M_ns and M_ss.
    """

    #: Schur complement M_ss − M_sn M_nn⁻¹ M_ns: the precision of the parameters of interest, shape
    #: (K, s, s)
    schur: Array
    #: −M_nn⁻¹ M_ns: change of the nuisance parameters that belongs to a change of the parameters of
    #: interest, shape (K, n, s)
    projection: Array
    #: L⁻ᵀ for the Cholesky factor L of M_nn, so that L⁻ᵀ L⁻¹ is M_nn⁻¹, shape (K, n, n)
    whitening: Array


class _CandidateGroup(NamedTuple):
    """Candidate tests whose readings depend on the same c of the p parameters.

    In a campaign of several planes, for example, a test of one plane says nothing about most
    nuisance parameters of the other planes. Without the zeros, products of matrices take less time.
    """

    candidates: NDArray[np.intp]  #: indices of the n candidates of the group
    columns: NDArray[np.intp]  #: indices of the c parameters on which the readings depend
    #: derivatives of the readings with respect to these parameters (see `Objective.rows`), at K
    #: values of the hyper-parameters, shape (K, n, m, c)
    rows: Array


@dataclass(frozen=True, eq=False)
class Objective(Shown):
    """Criterion Φ as a function of a design, averaged over K values of the hyper-parameters.

    The criterion is the figure of merit that the search for a design maximises. A design is
    described by the number of runs of each candidate, ``counts``, shape (candidates,).
    """

    #: derivatives G of the readings of each candidate with respect to the p parameters, divided by
    #: the standard deviation of the noise, at K values of the hyper-parameters, shape (K,
    #: candidates, m, p). The readings are first reduced to m values that contain all their
    #: information. One test of a candidate adds GᵀG to the precision of the parameters.
    rows: Array
    #: precision (inverse covariance) of the p parameters before the tests of the design, at K
    #: values of the hyper-parameters, shape (K, p, p). This precision is the sum of the precision
    #: of the prior, which is zero for a flat prior, and the information from tests that have
    #: already been run.
    prior: Array
    #: number s of parameters of interest, which are the last s of the p parameters; all other
    #: parameters are nuisance parameters
    interest: int
    #: design criterion (figure of merit): a `Determinant`, `Variance` or `LogBayesFactor`
    criterion: Criterion

    @property
    def candidates(self) -> int:
        """Number of candidate tests that a design chooses from."""
        return int(self.rows.shape[1])

    def among(self, candidates: Array) -> Objective:
        """Return the objective (figure of merit) of a design with only some of the candidate tests.

        ``candidates`` are the indices of the candidate tests to keep.
        """
        return replace(self, rows=self.rows[:, candidates])

    def at_every(self, step: int) -> Objective:
        """Return the objective averaged over every ``step``-th value of the hyper-parameters."""
        return replace(self, rows=self.rows[::step], prior=self.prior[::step])

    def efficiency(self, value: float, best: float) -> float:
        """Return the efficiency, 0 … 1, of a design from the value of its design criterion.

        ``value`` is the value of the criterion for the design, and ``best`` that for the best
        design.
        """
        if not np.isfinite(value):
            return 0.0
        return self.criterion.efficiency(value, best)

    def value(self, counts: Array) -> float:
        """Return the criterion Φ of a design; −inf if the design does not determine all parameters.

        ``counts`` is the number of runs of each candidate, shape (candidates,).
        """
        return float(self._values(self._precision(counts)).mean())

    def after_adding(self, counts: Array, chosen: Array) -> Array:
        """Return the criterion Φ of a design with one more test, for each of several candidates.

        ``counts`` holds the number of runs of each candidate in the design. ``chosen`` holds the
        indices of the candidates that are tried. For each of them, one test is added to the same
        design. The result has the shape (chosen,).
        """
        base = self._precision(counts)
        values_of = partial(self._values_after_adding_to_undetermined, base)
        if not self._has_undetermined_prior:
            values_of = partial(self._values_after_adding, _eliminate_nuisance(base, self.interest))
        total = np.zeros(len(chosen))
        size = max(1, _CHUNK_SIZE // base.size)
        for start in range(0, len(chosen), size):
            total[start : start + size] = values_of(chosen[start : start + size])
        return total

    def _values_after_adding(self, before: _WithoutNuisance, chosen: Array) -> Array:
        """Return the criterion Φ after one test of each chosen candidate is added, shape (chosen,).

        ``before`` holds the precision S of the parameters of interest before the test is added. A
        test with the derivatives G = (G_n, G_s) adds HᵀW⁻¹H to S. Here n are the nuisance
        parameters and s the parameters of interest, H = G_s − G_n M_nn⁻¹ M_ns, and W = I + G_n
        M_nn⁻¹ G_nᵀ. The matrix W has one row for each value to which the readings of a test are
        reduced. It is much smaller than the precision matrix M of all parameters.
        """
        s = self.interest
        rows = self.rows[:, chosen]
        stacked = rows.reshape(len(rows), -1, rows.shape[-1])
        of_test = (*rows.shape[:3], -1)
        whitened = (stacked[:, :, :-s] @ before.whitening).reshape(of_test)
        effect = stacked[:, :, -s:] + stacked[:, :, :-s] @ before.projection
        covariance = np.eye(rows.shape[2]) + whitened @ np.swapaxes(whitened, -1, -2)
        added = np.linalg.solve(np.linalg.cholesky(covariance), effect.reshape(of_test))
        roots = np.linalg.cholesky(before.schur[:, None] + np.swapaxes(added, -1, -2) @ added)
        return np.asarray(self.criterion.value(roots).mean(axis=0))

    def _values_after_adding_to_undetermined(self, base: Array, chosen: Array) -> Array:
        """Return the criterion Φ after one test of each chosen candidate is added, shape (chosen,).

        ``base``, shape (K, p, p), are the precision matrices of all parameters before the test is
        added, for K values of the hyper-parameters. They may be singular.
        """
        rows = self.rows[:, chosen]
        precision = base + np.swapaxes(np.swapaxes(rows, -1, -2) @ rows, 0, 1)
        values = self._values(precision.reshape(-1, *base.shape[1:]))
        return np.asarray(values.reshape(-1, len(base)).mean(axis=1))

    def sensitivity(self, counts: Array) -> tuple[float, Array]:
        """Return the criterion Φ of a design, and its derivatives with respect to the counts n_i.

        ``counts`` holds the number n_i of runs of each candidate i, shape (candidates,); the
        derivatives ∂Φ/∂n_i have the same shape. They are the means of ‖G_ki D_k‖² over the values k
        of the hyper-parameters. Here G_ki are the derivatives of candidate i's readings with
        respect to the parameters, and D_k is defined by ∂Φ/∂M = D_k D_kᵀ, where M is the precision
        matrix of the parameters.
        """
        s = self.interest
        precision = self._precision(counts)
        nuisance = precision[..., :-s, :-s]
        cross = precision[..., :-s, -s:]
        projection = -np.linalg.solve(nuisance, cross)
        schur = precision[..., -s:, -s:] + np.swapaxes(cross, -1, -2) @ projection
        root = np.linalg.cholesky(schur)
        interest_directions = self.criterion.directions(root)
        directions = np.concatenate(
            [projection @ interest_directions, interest_directions], axis=-2
        )
        slope = np.zeros(self.candidates)
        for group in self._groups:
            for rows, direction in zip(group.rows, directions[:, group.columns], strict=True):
                projected = rows.reshape(-1, rows.shape[-1]) @ direction
                projected = projected.reshape(len(rows), -1)
                slope[group.candidates] += np.einsum("ij,ij->i", projected, projected)
        return float(self.criterion.value(root).mean()), slope / len(root)

    def _precision(self, counts: Array) -> Array:
        """Return the precision matrices of all p parameters after the tests of a design.

        The matrices have the shape (K, p, p), for K values of the hyper-parameters. ``counts`` is
        the number of runs of each candidate, shape (candidates,).
        """
        precision = self.prior.copy()
        for group in self._groups:
            counts_of_group = counts[group.candidates]
            support = np.flatnonzero(counts_of_group)
            scaled = group.rows[:, support] * np.sqrt(counts_of_group[support])[:, None, None]
            stacked = scaled.reshape(len(scaled), -1, scaled.shape[-1])
            block = np.ix_(np.arange(len(precision)), group.columns, group.columns)
            precision[block] += np.swapaxes(stacked, -1, -2) @ stacked
        return precision

    def _values(self, precision: Array) -> Array:
        """Return the design criterion Φ for each of n precision matrices, shape (n,).

        ``precision`` has the shape (n, p, p) for p parameters. The criterion is −inf where the
        matrix is singular.
        """
        try:
            root = np.linalg.cholesky(precision)
        except np.linalg.LinAlgError:
            if len(precision) == 1:
                return np.array([-np.inf])
            return np.concatenate([self._values(matrix[None]) for matrix in precision])
        values = self.criterion.value(root[:, -self.interest :, -self.interest :])
        if self._has_undetermined_prior:
            # Because of rounding errors, the Cholesky factorisation of a singular matrix may
            # succeed. Its factor then has a very small diagonal element, by which the matrix is
            # recognised.
            root_diagonal = np.diagonal(root, axis1=-2, axis2=-1)
            remaining_share = root_diagonal / np.sqrt(np.diagonal(precision, axis1=-2, axis2=-1))
            values = np.where(remaining_share.min(axis=-1) < _SINGULAR_SHARE, -np.inf, values)
        return values

    @cached_property
    def _groups(self) -> list[_CandidateGroup]:
        """Groups of candidate tests; the readings of a group depend on the same parameters.

        A candidate whose readings depend on fewer parameters joins the first group, in the order of
        decreasing number of parameters, that has all of them.
        """
        depends_on: NDArray[np.bool_] = np.asarray(self.rows.any(axis=(0, 2)))
        columns_of_groups: list[NDArray[np.bool_]] = []
        group_of = np.zeros(self.candidates, dtype=int)
        for candidate in np.argsort(-depends_on.sum(axis=1), kind="stable").tolist():
            needed = depends_on[candidate]
            for group, known in enumerate(columns_of_groups):
                if not (needed & ~known).any():
                    group_of[candidate] = group
                    break
            else:
                group_of[candidate] = len(columns_of_groups)
                columns_of_groups.append(needed)
        groups = []
        for group, is_column in enumerate(columns_of_groups):
            candidates = np.flatnonzero(group_of == group)
            columns = np.flatnonzero(is_column)
            rows = np.ascontiguousarray(self.rows[:, candidates][..., columns])
            groups.append(_CandidateGroup(candidates, columns, rows))
        return groups

    @cached_property
    def _has_undetermined_prior(self) -> bool:
        """Whether some parameter is undetermined before the design's tests, as with flat priors."""
        return bool(np.linalg.matrix_rank(self.prior).min() < self.prior.shape[-1])


def _eliminate_nuisance(precision: Array, interest: int) -> _WithoutNuisance:
    """Return the precision of the parameters of interest, from which all others are eliminated.

    ``precision``, shape (K, p, p), are the precision matrices M of p parameters. The last
    ``interest`` of these parameters are the parameters of interest; all others are nuisance
    parameters, which M must determine.
    """
    cross = precision[:, :-interest, -interest:]
    root = np.linalg.cholesky(precision[:, :-interest, :-interest])
    whitening = np.swapaxes(np.linalg.inv(root), -1, -2)
    whitened_cross = np.swapaxes(whitening, -1, -2) @ cross
    explained = np.swapaxes(whitened_cross, -1, -2) @ whitened_cross
    return _WithoutNuisance(
        schur=precision[:, -interest:, -interest:] - explained,
        projection=-whitening @ whitened_cross,
        whitening=whitening,
    )
