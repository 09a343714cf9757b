"""Circles whose readings scatter far more than those of circles usually do.

The noise factor λ of a circle multiplies the circle's set-up shift (of zero and centre) and its
discrepancy (unexplained deviations). A circle with a large λ hardly counts in the posterior of the
compliances and geometric errors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from ldbb_bayes.inference.posterior import bound_of

__all__ = ["LARGE_NOISE_FACTOR", "OddCircle", "odd_circles"]

# A circle is odd if its noise factor λ exceeds this value with a probability of 97.5 %. Under the
# prior, in which circles scatter as Student t with three degrees of freedom, every thirteenth λ
# exceeds it.
LARGE_NOISE_FACTOR = 2.5


@dataclass(frozen=True)
class OddCircle:
    """Circle that scatters far more than circles usually do."""

    test: str  #: name of the circle
    factor: float  #: posterior median of the circle's noise factor λ
    interval: tuple[float, float]  #: 95 % credible interval of λ, with equal tails


def odd_circles(posterior: xr.DataTree) -> tuple[OddCircle, ...]:
    """Return the circles that scatter far more than circles usually do, the oddest first.

    Parameters
    ----------
    posterior : DataTree
        Posterior of a fit. If its model has no noise factors of circles, the result is empty.

    Returns
    -------
    tuple of OddCircle
    """
    draws = posterior["posterior"].dataset
    circles = []
    for test in bound_of(posterior).campaign.tests:
        name = f"lambda_{test.name}"
        if name not in draws:
            continue
        low, median, high = np.quantile(draws[name].to_numpy(), [0.025, 0.5, 0.975])
        if low >= LARGE_NOISE_FACTOR:
            circles.append(OddCircle(test.name, float(median), (float(low), float(high))))
    return tuple(sorted(circles, key=lambda circle: -circle.factor))
