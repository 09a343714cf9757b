"""The rule by which assumed effects confound a parameter: they hold most of its variance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ldbb_bayes.analysis.origins import MAJORITY, Origin
from ldbb_bayes.analysis.variance_sources import VarianceSource
from ldbb_bayes.model.terms.columns import OWN

__all__ = ["NEAR_TIE", "SAME_COMBINATION", "confounding_sources"]

# Two effects act on the same combination of parameters if the squared cosine of the angle between
# the errors that they cause is at least this.
SAME_COMBINATION = 0.95
# An effect that holds less than this share of a parameter's variance is not named with the verdict
# on the parameter.
_NAMED_SHARE = 0.05
# Shares and contractions that differ from their limit by less than this count as equal to it, so
# that no verdict depends on rounding errors: a share equal to the limit is no majority, and a
# contraction equal to it is none that limits.
NEAR_TIE = 1e-6


def confounding_sources(
    sources: Sequence[VarianceSource], likeness: Mapping[tuple[str, str], float] | None
) -> tuple[VarianceSource, ...]:
    """Return the assumed sources that hold most of a parameter's variance; empty if none do."""
    candidates = []
    for source in sources:
        is_effect = source.origin == Origin.ASSUMED and source.name != OWN
        if is_effect and source.share >= _NAMED_SHARE:
            candidates.append(source)
    for first in candidates:
        partners: list[VarianceSource] = []
        share = 0.0
        for source in candidates:
            if likeness is not None and likeness[first.name, source.name] < SAME_COMBINATION:
                continue
            partners.append(source)
            share += source.share
            if share > MAJORITY + NEAR_TIE:
                return tuple(partners)
    return ()
