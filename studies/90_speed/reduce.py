"""Reduce a huge test, or solve it by `numpy.linalg.lstsq`; prints seconds and peak memory of the work itself as JSON."""

from __future__ import annotations

import json
import sys
import time
import tracemalloc

import numpy as np

from ldbb_bayes.model.fourier import reduce_readings


def design(angle: np.ndarray) -> np.ndarray:
    """The 13 columns of compliances at 400 N and geometric errors, R = 150 mm (Eq. 16-33)."""
    c, s, radius, force = np.cos(angle), np.sin(angle), 150.0, 400.0
    compliance = [c * c, c * s, s * s, radius * c * c * s, radius * c * s * s, radius**2 * c * c * s * s]
    geometric = [radius * c * c, radius**2 * c * c * s, radius**2 * s * s * c, radius * s * s, radius * c * s, c, s]
    return np.stack([force * column for column in compliance] + geometric, axis=1)


def main() -> None:
    """Time once, then once more under the memory tracer."""
    what, readings = sys.argv[1], int(sys.argv[2])
    angle = np.arange(readings) * (2.0 * np.pi / readings)
    reading = 1e-4 * np.random.default_rng(0).standard_normal(readings)

    def work() -> None:
        if what == "reduce":
            reduce_readings(angle, reading)
        else:
            np.linalg.lstsq(design(angle), reading, rcond=None)

    clock = time.perf_counter()
    work()
    seconds = time.perf_counter() - clock
    tracemalloc.start()
    work()
    print(json.dumps({"seconds": seconds, "peak_mb": tracemalloc.get_traced_memory()[1] / 1e6}))


if __name__ == "__main__":
    main()
