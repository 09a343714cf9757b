"""The cheapest cure for the uncertainty of every parameter, and the uncertainty with the cure.

A cure is a change of the plan (another order of the circles, the other direction of travel, turned
balls, more circles, a second radius) or a certificate of the instrument. Each cure is tried: the
longer plan, or the certified campaign, is bound to the same model, and its `Information` gives the
standard uncertainty of every parameter. The hyper-parameters φ (the scales of the noise and of
other effects) keep their values under the same names (`HyperPrior.carried`). Effects that depend on
an estimate of the machine keep the estimate from the readings.

Changes of a plan that add circles double the number of circles. A part of the benefit comes from
this larger number alone. The same part would result if all readings were taken twice under the same
conditions. Another order, direction of travel, angle of the balls or radius counts as a cure only
if it helps more than taking all readings twice. More circles are advised only if sources that are
measured here, such as scatter between readings and circles, have most of the variance. An assumed
effect is the same in every circle, and does not average out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ldbb_bayes.analysis.origins import MAJORITY
from ldbb_bayes.analysis.tried_cures import RemedyKind, TriedCures, sd_by_name
from ldbb_bayes.model.bound_information import information_of
from ldbb_bayes.results import Array, Result
from ldbb_bayes.units import ranked

__all__ = ["CURED_RATIO", "NARROWER", "Remedy", "remedies"]

# A cure is enough if the standard uncertainty with the cure, divided by that without the cure, is
# at most this number: at least half of the variance is then removed.
CURED_RATIO = 0.5**0.5
# A change counts as a cure only if the standard uncertainty with the change, divided by that
# without the change, is less than this number.
NARROWER = 0.9
# A change of the plan that adds circles counts as a cure only if it is better than taking all
# readings twice: the standard uncertainty with the change, divided by that from taking all readings
# twice, must be less than this number.
_BETTER_THAN_REPETITION = 0.9


@dataclass(frozen=True)
class Remedy(Result):
    """The cheapest cure for one parameter, and the parameter's uncertainty with this cure."""

    kind: RemedyKind  #: kind of cure
    #: certificate, as a key of ``CERTIFICATES`` such as "mount ± 2 %"; empty for a change of the
    #: plan
    certificate: str
    circles: int  #: number of circles that the cure adds to those of the campaign
    sd: float  #: standard uncertainty of the parameter with the cure, in internal units
    ratio: float  #: ``sd`` divided by the standard uncertainty without the cure


@dataclass(frozen=True)
class _Trial:
    """A single cure that was tried.

    ``ratio``, shape (p,), are the standard uncertainties of all parameters with the cure, divided
    by those without the cure.
    """

    kind: RemedyKind
    certificate: str
    circles: int
    ratio: Array


def remedies(tried: TriedCures, sd: Array, measured_share: Array) -> dict[str, Remedy | None]:
    """Return the cheapest cure of every parameter and of every change with force, by name.

    The cure is None if no cure reduces the standard uncertainty by more than 10 %. Changes with
    force are those of compliances over the tested forces (`curve_changes`). In the result, changes
    with force follow the parameters, under names such as "change of C_XXX".

    The cures are tried in the order of `RemedyKind`, and certificates in the order of
    ``CERTIFICATES``. The first cure that reduces the standard uncertainty to at most 71 % (the
    variance to half) is returned. If there is no such cure, the cure that reduces the standard
    uncertainty most is returned, provided that the result is less than 90 % of the standard
    uncertainty without any cure.

    Parameters
    ----------
    tried
        The campaign, with its uncertainties after each cure.
    sd
        Standard uncertainties of the p parameters and changes without any cure, shape (p,), in
        internal units.
    measured_share
        Share of the sources that are measured here, such as scatter between readings and circles,
        in the variance of each of these p quantities, shape (p,).
    """
    bound = tried.bound
    once = tried.sd_with()
    trials = []
    for step in tried.steps:
        after = tried.sd_with(step)
        ratio = np.array([after[name] / sd_before for name, sd_before in once.items()])
        circles = tried.circles_with(step)
        trials.append(_Trial(step.kind, step.certificate, circles, ratio))
    twice = sd_by_name(bound, information_of(bound, tried.phi), times=2.0)
    repetition = [twice[name] / once[name] for name in once]
    cheapest: dict[str, Remedy | None] = {}
    for i, name in enumerate(once):
        helpful = []
        for trial in trials:
            if _helps(trial, i, repetition[i], float(measured_share[i])):
                helpful.append(trial)
        cheapest[name] = _cheapest(helpful, i, float(sd[i]))
    return cheapest


def _helps(trial: _Trial, i: int, repetition: float, measured_share: float) -> bool:
    """Return whether a cure by itself reduces the standard uncertainty of parameter i enough.

    The standard uncertainty with the cure must be less than 90 % of that without the cure. A cure
    that adds circles under other conditions must also be better than taking all readings twice with
    nothing else changed; ``repetition`` is the standard uncertainty from all readings taken twice,
    divided by the present standard uncertainty. More circles under the same conditions help only if
    most of the variance comes from sources that are measured here; ``measured_share`` is the share
    of these sources.
    """
    ratio = float(trial.ratio[i])
    if not ratio < NARROWER:
        return False
    if trial.kind == RemedyKind.CIRCLES:
        return measured_share > MAJORITY
    if trial.circles:
        return ratio < _BETTER_THAN_REPETITION * repetition
    return True


def _cheapest(helpful: Sequence[_Trial], i: int, sd: float) -> Remedy | None:
    """Return the first cure that is enough for parameter i; if none is, return the best cure.

    ``helpful`` are the cures that help, the cheapest first. A cure is enough if it removes at least
    half of the variance; the best cure leaves the smallest standard uncertainty. ``sd`` is the
    standard uncertainty without any cure. Return None if no cure helps.
    """
    if not helpful:
        return None
    enough = [trial for trial in helpful if trial.ratio[i] <= CURED_RATIO]
    if enough:
        best = enough[0]
    else:
        best = ranked(helpful, lambda trial: -float(trial.ratio[i]))[0]
    ratio = float(best.ratio[i])
    return Remedy(best.kind, best.certificate, best.circles, ratio * sd, ratio)
