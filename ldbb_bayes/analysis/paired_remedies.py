"""Pairs of cures for parameters that stay confounded after the best single cure.

A cure is a change of the plan, such as more circles, or a certificate of the instrument. A
parameter is confounded if assumed effects cause more than half of its variance.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from ldbb_bayes.analysis.remedies import NARROWER, Remedy
from ldbb_bayes.analysis.tried_cures import CureStep, TriedCures
from ldbb_bayes.results import Result
from ldbb_bayes.units import ranked

__all__ = ["PairedRemedy", "paired_remedies"]

# Two second cures count as equal if the parameter's standard uncertainties with them, divided by
# that without any cure, differ by less than this number. Of two equal cures, the cheaper is taken.
_EQUAL_RATIOS = 0.02


@dataclass(frozen=True)
class PairedRemedy(Result):
    """Two cures together for a parameter that stays confounded after the first cure alone.

    A cure is a change of the plan, such as more circles, or a certificate of the instrument.
    """

    first: CureStep  #: cheapest cure, if only one cure is used
    #: cure that, added to the first, reduces the parameter's standard uncertainty most
    second: CureStep
    circles: int  #: number of circles that both cures together add to those of the campaign
    sd: float  #: standard uncertainty of the parameter after both cures, in internal units
    ratio: float  #: ``sd`` divided by the standard uncertainty without any cure
    is_confounded: bool  #: whether the parameter stays confounded after both cures


def paired_remedies(
    tried: TriedCures,
    chosen: Mapping[str, Remedy | None],
    sd: Mapping[str, float],
    confounded: Collection[str],
) -> dict[str, PairedRemedy]:
    """Return pairs of cures for parameters that stay confounded after the best single cure.

    A cure is a change of the plan, such as more circles, or a certificate of the instrument. The
    first cure is the parameter's cheapest cure from `remedies`. The second cure is the one that,
    added to the first, makes the standard uncertainty of the parameter smallest. A pair counts only
    if this standard uncertainty is less than 90 % of that with the first cure alone.

    Parameters
    ----------
    tried
        The campaign, with its uncertainties after each cure.
    chosen
        The cheapest cure of every parameter by name, from `remedies`.
    sd
        Standard uncertainties of the parameters without any cure, by name, in internal units.
    confounded
        Names of the parameters that are confounded.

    Returns
    -------
    dict of PairedRemedy
        The keys are names of parameters. Parameters without a useful pair are left out.
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
    """Return the first cure together with the best second cure for a parameter.

    The best second cure is the one that, added to the first, makes the parameter's standard
    uncertainty smallest. ``sd`` is the standard uncertainty without any cure. Return None if no
    second cure reduces the standard uncertainty to less than 90 % of that with the first cure.
    """
    before = tried.sd_with()[name]
    ratio_of: dict[CureStep, float] = {}
    for step in tried.steps:
        # All cures are tried, because a cure that has no effect by itself may have an effect
        # together with the first cure.
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
