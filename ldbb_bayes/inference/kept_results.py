"""Results of a posterior that several tables, figures and files state, each worked out once.

A report asks for the verdicts, the curves C(F) and the summary of one posterior many times. The
results asked for last are kept. A posterior is recognised by its contents, so that one that was
changed, or read from a file, gets the results that belong to it.
"""

from __future__ import annotations

import copy
import functools
import hashlib
from collections.abc import Callable, Hashable
from typing import Any, TypeVar, cast

import numpy as np
import xarray as xr

__all__ = ["kept"]

F = TypeVar("F", bound=Callable[..., Any])

# Groups of a posterior's tree whose numbers identify it, beside its record.
_IDENTIFYING_GROUPS = ("posterior", "prior", "sample_stats", "constant_data", "observed_data")
# Largest number of results that are kept: those of the fit and of the average of a report.
_MOST_RESULTS = 32
# Results that were asked for last, the oldest first, by function, posterior and other arguments.
_RESULTS: dict[Hashable, Any] = {}


def kept(work: F) -> F:
    """Return a function of a posterior whose last results are kept.

    Each call returns a shallow copy, so that a caller may add entries to a dictionary. The other
    arguments of the function must be hashable.
    """

    @functools.wraps(work)
    def work_once(posterior: xr.DataTree, *args: Any, **kwargs: Any) -> Any:
        if not isinstance(posterior, xr.DataTree) or "provenance" not in posterior.children:
            # The function itself says what is wrong with such a posterior.
            return work(posterior, *args, **kwargs)
        key = (work, _fingerprint(posterior), args, tuple(sorted(kwargs.items())))
        if key not in _RESULTS:
            _RESULTS[key] = work(posterior, *args, **kwargs)
            for oldest in list(_RESULTS)[:-_MOST_RESULTS]:
                _RESULTS.pop(oldest, None)
        return copy.copy(_RESULTS[key])

    return cast("F", work_once)


def _fingerprint(posterior: xr.DataTree) -> bytes:
    """Return a digest of the numbers and of the record of a posterior."""
    digest = hashlib.blake2b(posterior["provenance"].attrs["json"].encode())
    for group in _IDENTIFYING_GROUPS:
        if group not in posterior.children:
            continue
        for name, variable in posterior[group].data_vars.items():
            values = np.ascontiguousarray(variable.values)
            digest.update(f"{group}/{name} {values.shape} {values.dtype}".encode())
            digest.update(values.tobytes())
    return digest.digest()
