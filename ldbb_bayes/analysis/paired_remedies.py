"""Pairs of remedies for parameters that stay confounded after one remedy.

A remedy for a large uncertainty is a change of the plan, such as more circles, or a certificate of
the instrument. A parameter is confounded if effects whose size nobody measured or stated cause more
than half of its variance.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from ldbb_bayes.analysis.remedies import NARROWER, Remedy
from ldbb_bayes.analysis.tried_cures import CureStep, TriedCures
from ldbb_bayes.results import Result
from ldbb_bayes.units import ranked

__all__ = ["PairedRemedy", "paired_remedies"]

# A second remedy (a change of the plan or a certificate) is compared with another by the ratio of
# the parameter's standard uncertainty with both remedies to that without any remedy. If the two
# ratios differ by less than this number, the cheaper remedy is taken.
_EQUAL_RATIOS = 0.02


@dataclass(frozen=True)
class PairedRemedy(Result):
    """Two remedies together for a parameter that stays confounded after the first remedy alone.

    A remedy is a change of the plan, such as more circles, or a certificate of the instrument. A
    parameter is confounded if assumed effects cause more than half of its variance.
    """

    #: first remedy, a change of the plan or a certificate: the cheapest if only one remedy is used
    first: CureStep
    #: second remedy, a change of the plan or a certificate: of all remedies, that which reduces the
    #: parameter's standard uncertainty most if it is added to the first remedy
    second: CureStep
    #: number of circles that both remedies (changes of the plan or certificates) add together
    circles: int
    #: standard uncertainty of the parameter that remains after both remedies, in internal units
    sd: float
    ratio: float  #: ``sd`` divided by the standard uncertainty without any remedy
    #: whether the parameter stays confounded with assumed effects after both remedies
    is_confounded: bool


def paired_remedies(
    tried: TriedCures,
    chosen: Mapping[str, Remedy | None],
    sd: Mapping[str, float],
    confounded: Collection[str],
) -> dict[str, PairedRemedy]:
    """Return a pair of remedies for every parameter that stays confounded after one remedy.

    A remedy is a change of the plan, such as more circles, or a certificate of the instrument. The
    first remedy is the parameter's cheapest remedy from `remedies`. The second remedy is that
    which, added to the first, makes the standard uncertainty of the parameter smallest. A pair is
    returned only if this standard uncertainty is less than 90 % of that with the first remedy
    alone.

    Parameters
    ----------
    tried
        The campaign, with its standard uncertainties after each remedy.
    chosen
        The cheapest remedy for every parameter, from `remedies`. The keys are names of parameters.
    sd
        Standard uncertainties of the parameters without any remedy, by name, in internal units.
    confounded
        Names of the parameters that are confounded.

    Returns
    -------
    dict of PairedRemedy
        Pairs of remedies; the keys are names of parameters. Parameters without a useful pair are
        left out.
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
    """Return the first remedy for a parameter together with the best second remedy.

    A remedy is a change of the plan or a certificate. The best second remedy is that which, added
    to the first, makes the parameter's standard uncertainty smallest. ``sd`` is the standard
    uncertainty without any remedy. Return None if no second remedy reduces the standard uncertainty
    to less than 90 % of that with the first remedy.
    """
    before = tried.sd_with()[name]
    ratio_of: dict[CureStep, float] = {}
    for step in tried.steps:
        # All changes of the plan and all certificates are tried, because a remedy that has no
        # effect by itself may have an effect together with the first remedy.
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
