"""Memory of arrays that come and go: kept by the process instead of being given back and fetched again page by page."""

from __future__ import annotations

from functools import cache

import numpy as np

__all__ = ["keep_freed_memory"]

_BYTES = 31 << 20


@cache
def keep_freed_memory() -> None:
    """Let go of one large array that was never touched.

    GNU's malloc takes its size as a sign: arrays up to it, and twice as much freed memory in all, then stay with the process
    (mallopt(3), M_MMAP_THRESHOLD, dynamic up to 32 MiB). Stacks of small matrices are two to three times faster for it. Without
    effect elsewhere.
    """
    np.empty(_BYTES, dtype=np.uint8)
