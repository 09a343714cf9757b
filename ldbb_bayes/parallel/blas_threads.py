"""One BLAS thread a process: matrices here are small, and waiting threads cost far more."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

__all__ = ["ONE_THREAD", "one_blas_thread"]

P = ParamSpec("P")
R = TypeVar("R")

# Environment of a process whose BLAS shall start with one thread.
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


def one_blas_thread(function: Callable[P, R]) -> Callable[P, R]:
    """Return the same function, during which BLAS has one thread.

    Parameters
    ----------
    function : whatever computes with small matrices.

    Returns
    -------
    The function; afterwards BLAS has as many threads as before.
    """

    @functools.wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> R:
        with threadpool_limits(1, user_api="blas"):
            return function(*args, **kwargs)

    return limited
