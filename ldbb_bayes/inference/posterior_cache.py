"""Cache for results that are computed from a posterior and needed several times.

A report asks for the same results of one posterior many times, such as its summary and its
compliances C(F) as functions of the force F. The cache holds the latest results, so that a result
is not computed again each time. A posterior is identified by its contents. The results of a changed
posterior are therefore computed anew, and the results of a posterior that was written to a file and
read again are found in the cache.
"""

from __future__ import annotations

import copy
import functools
import hashlib
from collections.abc import Callable, Hashable
from typing import Any, TypeVar, cast

import numpy as np
import xarray as xr

__all__ = ["cached_by_posterior"]

F = TypeVar("F", bound=Callable[..., Any])

# Groups of arrays by which a posterior is recognised. A hash is computed from all numbers in these
# arrays, and from the record in the posterior that describes the model and the sampler.
_IDENTIFYING_GROUPS = ("posterior", "prior", "sample_stats", "constant_data", "observed_data")
# Largest number of results that the cache holds. This number is enough for a report, which needs
# several results of each of two posteriors: a fit, and an average over models.
_MOST_RESULTS = 32
# Cache of results that functions have computed from posteriors, the oldest result first. A key
# consists of the function, the hash of the posterior and the other arguments of the function.
_RESULTS: dict[Hashable, Any] = {}


def cached_by_posterior(work: F) -> F:
    """Return ``work``, a function of a posterior, with a cache for its results.

    Each call returns a shallow copy of the result. A caller can therefore add entries to a returned
    dictionary without changing the cache. All arguments of ``work`` except the posterior must be
    hashable.
    """

    @functools.wraps(work)
    def work_once(posterior: xr.DataTree, *args: Any, **kwargs: Any) -> Any:
        # Return the result of the function ``work`` for a posterior and further arguments. A result
        # that is not yet in the cache is computed and added to the cache.
        if not isinstance(posterior, xr.DataTree) or "provenance" not in posterior.children:
            # The first argument, which should be a posterior, is something else. Call the function
            # ``work`` without the cache, so that ``work`` itself raises an error.
            return work(posterior, *args, **kwargs)
        key = (work, _fingerprint(posterior), args, tuple(sorted(kwargs.items())))
        if key not in _RESULTS:
            _RESULTS[key] = work(posterior, *args, **kwargs)
            for oldest in list(_RESULTS)[:-_MOST_RESULTS]:
                _RESULTS.pop(oldest, None)
        return copy.copy(_RESULTS[key])

    return cast("F", work_once)


def _fingerprint(posterior: xr.DataTree) -> bytes:
    """Return a cryptographic hash by which a posterior is recognised.

    The hash is computed from the draws and readings in the posterior, and from its record, which
    states the model and how the sampler ran.
    """
    digest = hashlib.blake2b(posterior["provenance"].attrs["json"].encode())
    for group in _IDENTIFYING_GROUPS:
        if group not in posterior.children:
            continue
        for name, variable in posterior[group].data_vars.items():
            values = np.ascontiguousarray(variable.values)
            digest.update(f"{group}/{name} {values.shape} {values.dtype}".encode())
            digest.update(values.tobytes())
    return digest.digest()
