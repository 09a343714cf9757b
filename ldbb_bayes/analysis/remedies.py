"""The cheapest cure for the uncertainty of every parameter, and the uncertainty with the cure.

A cure is a change of the plan (another order, the other direction of travel, turned balls, more
circles, a second radius) or a certificate of the instrument. Each one is tried: the longer plan, or
the certified campaign, is bound to the same model, and its `Information` gives the standard
uncertainty of every parameter. Hyper-parameters φ (the scales of the noise and of other effects)
are carried over by name (`HyperPrior.carried`). The estimate of the machine that some effects need
stays that of the readings.

Changes of a plan that add circles double the number of circles. A part of their benefit comes from
this number alone: it is that of taking all readings twice at the same times. Another order,
direction, clocking or radius counts as a cure only if it helps more than that. More circles are
advised only if sources that are measured here, such as scatter between readings and circles, have
most of the variance. An assumed effect is the same in every circle, and does not average out.
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

# A cure is enough if the standard uncertainty with it is at most this share of that without it:
# half of the variance is then removed.
CURED_RATIO = 0.5**0.5
# A change counts as a cure only if the standard uncertainty with it is less than this share of that
# without it.
NARROWER = 0.9
# A change of the plan that adds circles counts as a cure only if the standard uncertainty with it
# is less than this share of that from taking all readings twice.
_BETTER_THAN_REPETITION = 0.9


@dataclass(frozen=True)
class Remedy(Result):
    """The cheapest cure for one parameter, and the uncertainty that it would leave."""

    kind: RemedyKind  #: kind of cure
    #: what is certified, by its key in ``CERTIFICATES``, such as "mount ± 2 %"; empty for a change
    #: of the plan
    certificate: str
    circles: int  #: number of circles that the cure adds to those of the campaign
    sd: float  #: standard uncertainty of the parameter with the cure, in internal units
    ratio: float  #: ``sd`` divided by the standard uncertainty without it


@dataclass(frozen=True)
class _Trial:
    """A single cure that was tried.

    ``ratio``, shape (p,), are the standard uncertainties of all parameters with the cure, divided
    by those without it.
    """

    kind: RemedyKind
    certificate: str
    circles: int
    ratio: Array


def remedies(tried: TriedCures, sd: Array, measured_share: Array) -> dict[str, Remedy | None]:
    """Return the cheapest cure of every parameter and change with force.

    It is None where no cure narrows the parameter by a tenth. Changes are those of compliances over
    the tested forces (`curve_changes`). They follow the parameters, under names such as "change of
    C_XXX".

    The cures are tried in the order of `RemedyKind`, certificates in that of ``CERTIFICATES``. The
    first one that leaves at most 71 % of the standard uncertainty (half of the variance) is
    returned; if none does, the one that leaves least, if that is less than 90 %.

    Parameters
    ----------
    tried
        The campaign with each cure.
    sd
        Standard uncertainties of the p parameters and changes without any cure, shape (p,), in
        internal units.
    measured_share
        Share of what is measured here, such as scatter between readings and circles, in the
        variance of each of them, shape (p,).
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
    """Return whether a cure narrows the parameter with index i by itself.

    Ratios are of the parameter's standard uncertainty with a change over that without it.
    ``repetition`` is the ratio if all readings are taken twice, with nothing else changed. A cure
    that adds circles under other conditions must narrow the parameter more than that. More circles
    of the same kind help only if most of the variance comes from effects whose size these readings
    tell; ``measured_share`` is the share of the variance that does.
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
    """Return the first cure that suffices for parameter i, else the one that narrows it most."""
    if not helpful:
        return None
    enough = [trial for trial in helpful if trial.ratio[i] <= CURED_RATIO]
    if enough:
        best = enough[0]
    else:
        best = ranked(helpful, lambda trial: -float(trial.ratio[i]))[0]
    ratio = float(best.ratio[i])
    return Remedy(best.kind, best.certificate, best.circles, ratio * sd, ratio)
