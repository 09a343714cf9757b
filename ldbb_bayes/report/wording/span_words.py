"""Words on circles whose readings span less or more than a ball bar shows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

from ldbb_bayes.units import digits_apart

if TYPE_CHECKING:
    from ldbb_bayes.inference.fit import Concern

__all__ = ["DoubtedSpans", "doubted_spans"]


class DoubtedSpans(NamedTuple):
    """Circles whose readings all span less, or all span more, than a ball bar shows."""

    is_large: bool  #: whether the readings span more than a ball bar shows; if false, less
    tests: tuple[str, ...]  #: names of the circles
    span: str  #: smallest and largest range of their readings with the unit: "0.010 … 0.013 µm"
    limit: str  #: smallest or largest range that a ball bar shows, with the unit: "0.090 µm"


def doubted_spans(concerns: Sequence[Concern]) -> Iterator[DoubtedSpans]:
    """Yield the circles whose readings probably are in another unit than stated.

    Those whose readings span less than a ball bar shows come first, then those whose readings span
    more, with one object for each of the two kinds that occurs.

    Parameters
    ----------
    concerns
        Warnings of a fit. Those of other kinds than UNIT are left out.

    Yields
    ------
    DoubtedSpans
    """
    of_units = [concern for concern in concerns if concern.kind == "unit"]
    small = [concern for concern in of_units if concern.value < concern.limit]
    large = [concern for concern in of_units if concern.value >= concern.limit]
    if small:
        yield _spans_in_words(small, is_large=False, factor=1e3, unit="µm")
    if large:
        yield _spans_in_words(large, is_large=True, factor=1.0, unit="mm")


def _spans_in_words(
    concerns: Sequence[Concern], *, is_large: bool, factor: float, unit: str
) -> DoubtedSpans:
    """Return circles in doubt with the range of their readings in words.

    ``factor`` converts mm to the unit shown, whose label is ``unit``.
    """
    spans_mm = [concern.value for concern in concerns]
    ends_mm = (min(spans_mm), max(spans_mm))
    limit, *ends = digits_apart(concerns[0].limit, ends_mm, factor)
    return DoubtedSpans(
        is_large=is_large,
        tests=tuple(concern.name for concern in concerns),
        span=f"{' … '.join(dict.fromkeys(ends))} {unit}",
        limit=f"{limit} {unit}",
    )
