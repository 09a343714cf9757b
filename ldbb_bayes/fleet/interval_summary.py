"""Summary of the distribution of one quantity: mean, sd and equal-tailed credible interval."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ldbb_bayes.results import Result

__all__ = ["Summary", "name_intervals"]


@dataclass(frozen=True)
class Summary(Result):
    """Mean, sd and equal-tailed credible interval of a quantity, in its internal unit.

    Internal units are made of mm, N and rad.
    """

    mean: float  #: mean of the quantity's distribution, in the internal unit of the quantity
    #: standard deviation of the quantity's distribution, in the internal unit of the quantity
    sd: float
    #: lower and upper end of the quantity's equal-tailed credible interval, in the internal unit of
    #: the quantity
    interval: tuple[float, float]


def name_intervals(record: Any, prob: float) -> Any:
    """Return a copy of a record in which keys such as ``ci95`` take the place of ``interval``.

    The key ``interval`` of a pair of numbers is replaced with ``ci`` and the probability of the
    credible interval in per cent. Names of machines, campaigns and parameters are keys too; they
    are kept, whatever they contain.

    Parameters
    ----------
    record
        Nested dictionaries, lists and values that are to be written as JSON.
    prob
        Probability of the intervals.
    """
    if isinstance(record, dict):
        key = f"ci{100 * prob:g}"
        renamed: dict[str, Any] = {}
        for name, value in record.items():
            if name == "interval" and not isinstance(value, dict):
                renamed[key] = value
            else:
                renamed[name] = name_intervals(value, prob)
        return renamed
    if isinstance(record, list):
        return [name_intervals(value, prob) for value in record]
    return record
