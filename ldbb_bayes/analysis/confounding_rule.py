"""Rule for confounding: assumed effects that cause more than half of a parameter's variance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ldbb_bayes.analysis.origins import MAJORITY, Origin
from ldbb_bayes.analysis.variance_sources import VarianceSource
from ldbb_bayes.model.terms.columns import OWN

__all__ = ["NEAR_TIE", "SAME_COMBINATION", "confounding_sources"]

# Two effects are said to act on the same combination of parameters if the errors that they cause
# are in nearly the same proportions. The errors of all parameters that one effect causes form a
# vector. The squared cosine of the angle between the vectors of the two effects must be at least
# this number.
SAME_COMBINATION = 0.95
# A parameter is never said to be confounded with an effect that causes less than this share of the
# parameter's variance.
_NAMED_SHARE = 0.05
# Verdicts on parameters must not depend on rounding errors. A number that differs from its limit by
# less than this amount is therefore treated as equal to the limit. There are two such numbers. A
# share of a variance must be above its limit for the verdict "confounded". The contraction, which
# is one minus the ratio of posterior to prior variance, must be below its limit for the verdict
# "prior-limited".
NEAR_TIE = 1e-6


def confounding_sources(
    sources: Sequence[VarianceSource], likeness: Mapping[tuple[str, str], float] | None
) -> tuple[VarianceSource, ...]:
    """Return the assumed sources with which a parameter is confounded, or an empty tuple.

    A parameter is confounded with assumed sources if they together cause more than half of its
    variance, and if they act on the same combination of parameters. ``sources`` are all sources of
    the parameter's variance, the largest share first. ``likeness`` states how similarly two sources
    act: each source causes errors of all parameters, which form a vector, and the likeness is the
    squared cosine of the angle between the vectors of the two sources. The keys are pairs of names
    of sources. If ``likeness`` is None, all sources are taken to act on the same combination.
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
