"""Limitation of BLAS, the linear algebra library behind NumPy, to one thread per process.

The matrices of this package are small. With several threads, more time would be lost by waiting
than gained by sharing the work.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

__all__ = ["ONE_THREAD", "one_blas_thread"]

P = ParamSpec("P")
R = TypeVar("R")

# Values of the environment variables that limit BLAS (the linear algebra library behind NumPy) to
# one thread in a new process. The keys are the names of the variables.
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


def one_blas_thread(function: Callable[P, R]) -> Callable[P, R]:
    """Return a function that calls ``function`` with BLAS limited to a single thread.

    BLAS is the linear algebra library behind NumPy. One thread is faster for small matrices.

    Parameters
    ----------
    function : function that computes with small matrices.

    Returns
    -------
    The new function. After each of its calls, BLAS has as many threads as before the call.
    """

    @functools.wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> R:
        """Call ``function`` while the linear algebra library BLAS is limited to a single thread."""
        with _loaded_libraries().limit(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return limited


@functools.cache
def _loaded_libraries() -> ThreadpoolController:
    """Return the multi-threaded libraries that this process has loaded, such as BLAS.

    The libraries are searched for only once, because the search takes milliseconds. NumPy and SciPy
    have loaded all their libraries before this function is called for the first time.
    """
    return ThreadpoolController()
