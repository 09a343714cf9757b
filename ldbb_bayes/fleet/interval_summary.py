"""Split from its neighbours; see there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ldbb_bayes.results import Result

__all__ = ["Summary", "keyed"]


@dataclass(frozen=True)
class Summary(Result):
    """Mean, sd and equal-tailed credible interval, inside units."""

    mean: float
    sd: float
    interval: tuple[float, float]


def keyed(record: Any, ci_prob: float) -> Any:
    """The same with intervals under their probability: interval → ci95."""
    if isinstance(record, dict):
        key = f"ci{100 * ci_prob:g}"
        return {
            name.replace("interval", key): keyed(value, ci_prob) for name, value in record.items()
        }
    return [keyed(value, ci_prob) for value in record] if isinstance(record, list) else record
