"""Rule for confounding: assumed effects that cause more than half of a parameter's variance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ldbb_bayes.analysis.origins import MAJORITY, Origin
from ldbb_bayes.analysis.variance_sources import VarianceSource
from ldbb_bayes.model.terms.columns import OWN

__all__ = ["NEAR_TIE", "SAME_COMBINATION", "confounding_sources"]

# An effect causes an error of every parameter; these errors form a vector. Two effects act on the
# same combination of parameters if the squared cosine of the angle between the vectors of the two
# effects is at least this number.
SAME_COMBINATION = 0.95
# A parameter is never said to be confounded with an effect that causes less than this share of the
# parameter's variance.
_NAMED_SHARE = 0.05
# A share of a variance, or a contraction, counts as equal to its limit if the difference is below
# this number, so that no verdict on a parameter depends on rounding errors. The contraction is one
# minus the ratio of posterior to prior variance. A parameter is confounded only if a share is above
# the limit for shares, and prior-limited only if the contraction is below the limit for
# contractions.
NEAR_TIE = 1e-6


def confounding_sources(
    sources: Sequence[VarianceSource], likeness: Mapping[tuple[str, str], float] | None
) -> tuple[VarianceSource, ...]:
    """Return the assumed sources with which a parameter is confounded, or an empty tuple.

    A parameter is confounded with assumed sources if they together cause more than half of its
    variance, and if they act on the same combination of parameters. ``sources`` are all sources of
    the parameter's variance, the largest share first. ``likeness`` is the squared cosine of the
    angle between the vectors of parameter errors that two sources cause; its keys are pairs of
    names of sources. If ``likeness`` is None, all sources are taken to act on the same combination.
    """
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
