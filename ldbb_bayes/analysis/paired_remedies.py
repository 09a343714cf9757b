"""Second remedies for parameters that remain confounded after the first remedy.

A remedy for a large uncertainty is a change of the plan, such as more circles, or a certificate of
the instrument. A parameter is confounded if effects whose standard uncertainty is assumed cause
more than half of its variance.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from ldbb_bayes.analysis.remedies import NARROWER, Remedy
from ldbb_bayes.analysis.tried_remedies import RemedyStep, TriedRemedies
from ldbb_bayes.results import Result
from ldbb_bayes.units import ranked

__all__ = ["PairedRemedy", "paired_remedies"]

# Several remedies (certificates or changes of the plan) can be added to the first remedy. For each
# of them, the ratio is the parameter's standard uncertainty after both remedies, divided by its
# standard uncertainty without any remedy. If two ratios differ by less than this share of the
# smaller ratio, the cheaper remedy is chosen.
_EQUAL_RATIOS = 0.02


@dataclass(frozen=True)
class PairedRemedy(Result):
    """Two remedies for a parameter that remains confounded after the first remedy alone.

    A remedy is a change of the plan, such as more circles, or a certificate of the instrument. A
    parameter is confounded if more than half of its variance comes from effects whose standard
    uncertainties are assumed.
    """

    #: first remedy (a certificate or a change of the plan): the cheapest single remedy for the
    #: parameter
    first: RemedyStep
    #: second remedy (a certificate or a change of the plan): the remedy that reduces the
    #: parameter's standard uncertainty most when it is added to the first remedy
    second: RemedyStep
    #: number of circles that both remedies (certificates or changes of the plan) together add to
    #: the campaign
    circles: int
    #: standard uncertainty of the parameter after both remedies (certificates or changes of the
    #: plan), in the parameter's internal unit, which is composed of mm, N and rad
    sd: float
    #: standard uncertainty of the parameter after both remedies (certificates or changes of the
    #: plan), divided by its standard uncertainty without any remedy
    ratio: float
    #: whether the parameter remains confounded after both remedies (certificates or changes of the
    #: plan)
    is_confounded: bool


def paired_remedies(
    tried: TriedRemedies,
    chosen: Mapping[str, Remedy | None],
    sd: Mapping[str, float],
    confounded: Collection[str],
) -> dict[str, PairedRemedy]:
    """Return two remedies for every parameter that remains confounded after one remedy.

    A remedy is a change of the plan, such as more circles, or a certificate of the instrument. The
    first remedy is the parameter's cheapest remedy from `remedies`. The second remedy is the one
    that minimises the standard uncertainty of the parameter when it is added to the first. The two
    remedies are returned only if the standard uncertainty with both is less than 90 % of the
    standard uncertainty with the first remedy alone.

    Parameters
    ----------
    tried
        The campaign, with the standard uncertainties of its parameters after each remedy.
    chosen
        The cheapest remedy for every parameter, from `remedies`. The keys are names of parameters.
    sd
        Standard uncertainties of the parameters without any remedy, in internal units. The keys are
        names of parameters.
    confounded
        Names of the parameters that are confounded.

    Returns
    -------
    dict of PairedRemedy
        First and second remedy for each parameter; the keys are names of parameters. A parameter is
        left out if no second remedy reduces its standard uncertainty enough.
    """
    pairs = {}
    for name in confounded:
        remedy = chosen[name]
        if remedy is None:
            continue
        first = RemedyStep(remedy.kind, remedy.certificate)
        if name in tried.confounded_with(first):
            pair = _best_pair(tried, name, first, sd[name])
            if pair is not None:
                pairs[name] = pair
    return pairs


def _best_pair(
    tried: TriedRemedies, name: str, first: RemedyStep, sd: float
) -> PairedRemedy | None:
    """Return two remedies for a parameter: ``first``, and the remedy that is best added to it.

    A remedy for a large uncertainty is a certificate or a change of the plan. The second remedy is
    the one that, together with ``first``, minimises the parameter's standard uncertainty. Return
    None if this standard uncertainty is at least 90 % of the standard uncertainty with ``first``
    alone. ``tried`` computes the standard uncertainties of the parameters with any set of remedies.
    ``name`` is the name of the parameter, and ``sd`` its standard uncertainty without any remedy.
    """
    before = tried.sd_with()[name]
    ratio_of: dict[RemedyStep, float] = {}
    for step in tried.steps:
        # All changes of the plan and all certificates are tried. A change or certificate that has
        # no effect by itself may have an effect together with the first remedy.
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
