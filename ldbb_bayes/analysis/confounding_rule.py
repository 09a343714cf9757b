"""Rule that decides whether a parameter is confounded, and with which effects.

Only effects whose standard uncertainty is assumed are considered. A parameter is called confounded
with such effects if together they cause more than half of its variance, and if they act on the same
combination of parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ldbb_bayes.analysis.origins import MAJORITY, Origin
from ldbb_bayes.analysis.variance_sources import VarianceSource
from ldbb_bayes.model.terms.columns import PARAMETERS

__all__ = ["NEAR_TIE", "SAME_COMBINATION", "confounding_sources"]

# Two effects are said to act on the same combination of parameters if the errors that they cause
# are in nearly the same proportions. Each effect causes errors of all parameters, which form a
# vector. The squared cosine of the angle between the vectors of the two effects must be at least
# this number.
SAME_COMBINATION = 0.95
# A parameter is said to be confounded with an effect only if the effect's share of the parameter's
# variance is at least this number.
_NAMED_SHARE = 0.05
# A computed number that differs from a limit by less than this amount is treated as equal to the
# limit, so that rounding errors do not change verdicts. Two verdicts depend on limits. A parameter
# is "confounded" if certain sources cause more than a given share of its variance. It is
# "prior-limited" if its contraction (1 − posterior variance / prior variance) is below a limit.
NEAR_TIE = 1e-6


def confounding_sources(
    sources: Sequence[VarianceSource], likeness: Mapping[tuple[str, str], float] | None
) -> tuple[VarianceSource, ...]:
    """Return the sources of uncertainty with which a parameter is confounded, or an empty tuple.

    Only sources whose standard uncertainty is assumed (neither measured nor stated) are considered.
    A parameter is confounded with such sources if together they cause more than half of its
    variance, and act on the same combination of parameters. ``sources`` are all sources of the
    parameter's variance, the largest share first. Each source causes errors of all parameters,
    which form a vector. ``likeness`` holds, for each pair of sources, the squared cosine of the
    angle between their vectors; its keys are pairs of names of sources. If ``likeness`` is None,
    all sources are taken to act on the same combination.
    """
    candidates = []
    for source in sources:
        is_effect = source.origin == Origin.ASSUMED and source.name != PARAMETERS
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
