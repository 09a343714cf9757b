"""Pairs of cures for parameters that the best single cure leaves confounded."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from ldbb_bayes.analysis.remedies import NARROWER, Remedy
from ldbb_bayes.analysis.tried_cures import CureStep, TriedCures
from ldbb_bayes.results import Result
from ldbb_bayes.units import ranked

__all__ = ["PairedRemedy", "paired_remedies"]

# Second cures whose ratios of standard uncertainties differ by less than this count as equal, and
# the cheaper one is taken.
_EQUAL_RATIOS = 0.02


@dataclass(frozen=True)
class PairedRemedy(Result):
    """Two cures together for a parameter that the better of them alone leaves confounded."""

    first: CureStep  #: the cheapest cure by itself
    second: CureStep  #: the cure that narrows the parameter most beside the first
    circles: int  #: number of circles that both add to those of the campaign
    sd: float  #: standard uncertainty of the parameter with both cures, in internal units
    ratio: float  #: ``sd`` divided by the standard uncertainty without them
    is_confounded: bool  #: whether the parameter is confounded even so


def paired_remedies(
    tried: TriedCures,
    chosen: Mapping[str, Remedy | None],
    sd: Mapping[str, float],
    confounded: Collection[str],
) -> dict[str, PairedRemedy]:
    """Return the best second cure where the best single one leaves a parameter confounded.

    The first cure is the cheapest one by itself. The second is the one with which the standard
    uncertainty becomes smallest if the first cure is taken too. A pair counts only if this standard
    uncertainty is less than 90 % of that with the first cure alone.

    Parameters
    ----------
    tried
        The campaign with each cure.
    chosen
        The cheapest cure of every parameter by name, from `remedies`.
    sd
        Standard uncertainties of the parameters without any cure, by name, in internal units.
    confounded
        Names of the parameters that are confounded.

    Returns
    -------
    dict of PairedRemedy
        By name of the parameter; others are left out.
    """
    pairs = {}
    for name in confounded:
        remedy = chosen[name]
        if remedy is None:
            continue
        first = CureStep(remedy.kind, remedy.certificate)
        if name in tried.confounded_with(first):
            pair = _best_pair(tried, name, first, sd[name])
            if pair is not None:
                pairs[name] = pair
    return pairs


def _best_pair(tried: TriedCures, name: str, first: CureStep, sd: float) -> PairedRemedy | None:
    """Return the first cure with the one that narrows a parameter most beside it, if any does."""
    before = tried.sd_with()[name]
    ratio_of: dict[CureStep, float] = {}
    for step in tried.steps:
        # All cures are tried: one that has no effect by itself may have one together with the
        # first.
        if step == first:
            continue
        after = tried.sd_with(first, step)
        if after:
            ratio_of[step] = after[name] / before
    if not ratio_of:
        return None
    second = ranked(ratio_of, lambda step: -ratio_of[step], tolerance=_EQUAL_RATIOS)[0]
    ratio = ratio_of[second]
    if ratio >= NARROWER * tried.sd_with(first)[name] / before:
        return None
    return PairedRemedy(
        first=first,
        second=second,
        circles=tried.circles_with(first, second),
        sd=ratio * sd,
        ratio=ratio,
        is_confounded=name in tried.confounded_with(first, second),
    )
