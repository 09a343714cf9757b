"""Functions for least squares and for sparse matrices."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from ldbb_bayes.results import Array

__all__ = ["minimum_norm_solution", "sparse_or_dense"]

# A matrix is stored as a sparse matrix if fewer than this fraction of its elements differ from
# zero. For each element that is not zero, a product with a sparse matrix takes about three times as
# long as a product with a dense matrix (measured).
_SPARSE_SHARE = 0.35
# In a least-squares problem, combinations of parameters whose singular value is below this fraction
# of the largest singular value count as undetermined by the readings.
_RANK_TOLERANCE = 1e-10


def minimum_norm_solution(
    jacobian: Array,
    y: Array,
    scale: Array | None = None,
) -> Array:
    """Return the p parameters β of smallest norm that minimise |jacobian β − y|, shape (p,).

    Parameters
    ----------
    jacobian
        Derivatives of the n readings with respect to the p parameters, shape (n, p).
    y
        Readings, shape (n,).
    scale
        Units of the parameters, shape (p,), in which the norm of β is computed. By default the
        units are the reciprocal norms of the columns of ``jacobian``.
    """
    if scale is None:
        norms = np.linalg.norm(jacobian, axis=0)
        scale = 1.0 / np.where(norms > 0, norms, 1.0)
    solution, *_ = np.linalg.lstsq(jacobian * scale, y, rcond=_RANK_TOLERANCE)
    return solution * scale


def sparse_or_dense(matrix: Array) -> Array | csr_array:
    """Return a matrix in sparse or dense storage, whichever makes products faster.

    The result is a sparse matrix if most elements of ``matrix`` are zero; otherwise it is
    ``matrix`` itself.
    """
    if np.count_nonzero(matrix) < _SPARSE_SHARE * matrix.size:
        return csr_array(matrix)
    return matrix
