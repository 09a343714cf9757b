"""The cheapest remedy for each parameter's uncertainty, and the uncertainty that then remains.

A remedy is a change of the plan (another order of the circles, the other direction of travel,
turned balls, more circles, a second radius) or a certificate of the instrument. Each remedy is
tried: the standard uncertainty of every parameter is computed for the changed plan, or for the
campaign with the certificate (`Information`). The hyper-parameters φ, such as the standard
deviation of the noise, keep their values (`HyperPrior.values_from`).

If a remedy adds circles to a plan, it at most doubles their number. The uncertainty would also
decrease if all readings were taken twice under the same conditions. Circles under other conditions
(order, direction of travel, angles of the balls or radius) are therefore a remedy only if they
reduce the uncertainty more than taking all readings twice does. More circles under the same
conditions are recommended only if most of the variance comes from scatter between readings or
between circles, whose standard deviation the readings determine. Other effects are modelled as the
same in every circle, and do not average out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ldbb_bayes.analysis.origins import MAJORITY
from ldbb_bayes.analysis.tried_remedies import RemedyKind, TriedRemedies, sd_by_name
from ldbb_bayes.model.bound_information import information_of
from ldbb_bayes.results import Array, Result
from ldbb_bayes.units import ranked

__all__ = ["CURED_RATIO", "NARROWER", "Remedy", "remedies"]

# A remedy (a certificate or a change of the plan) is sufficient if it removes at least half of the
# variance. The standard uncertainty with the remedy, divided by the standard uncertainty without
# it, is then at most this number.
CURED_RATIO = 0.5**0.5
# Relative difference from a limit that counts as a rounding error.
_ROUNDING = 1e-9
# A certificate or a change of the plan counts as a remedy only if it reduces the standard
# uncertainty enough: the reduced standard uncertainty, divided by the present one, must be less
# than this number.
NARROWER = 0.9
# A change of the plan that adds circles under other conditions must be clearly better than taking
# all readings twice. It counts as a remedy only if the standard uncertainty after the change,
# divided by the standard uncertainty from all readings taken twice, is less than this number.
_BETTER_THAN_REPETITION = 0.9


@dataclass(frozen=True)
class Remedy(Result):
    """The cheapest remedy (a certificate or a changed plan), and the uncertainty after it."""

    kind: RemedyKind  #: kind of remedy for a large uncertainty, such as more circles
    #: name of the certificate (a key of ``CERTIFICATES``, such as "mount ± 2 %"); empty if the
    #: remedy is not a certificate but a change of the plan
    certificate: str
    circles: int  #: number of circles that the remedy adds to the plan; 0 for a certificate
    #: standard uncertainty of the parameter after the remedy (a certificate or a change of the
    #: plan), in the parameter's internal unit, which is composed of mm, N and rad
    sd: float
    #: standard uncertainty of the parameter with the remedy (a certificate or a change of the
    #: plan), divided by its standard uncertainty without the remedy
    ratio: float


@dataclass(frozen=True)
class _Trial:
    """One remedy (a certificate or a change of the plan) that was tried.

    ``ratio``, shape (p,), holds the standard uncertainty with the remedy, divided by the standard
    uncertainty without the remedy. There are p ratios: one for each parameter, and one for each
    change of a compliance with force.
    """

    kind: RemedyKind
    certificate: str
    circles: int
    ratio: Array


def remedies(tried: TriedRemedies, sd: Array, measured_share: Array) -> dict[str, Remedy | None]:
    """Return the cheapest remedy for every parameter and every change of a compliance with force.

    A remedy for a large uncertainty is a change of the plan, such as more circles, or a calibration
    certificate of the instrument. The keys of the result are the names of the parameters, followed
    by names such as "change of C_XXX" for the changes of compliances over the tested forces
    (`curve_changes`). A value is None if no remedy reduces the standard uncertainty by more than
    10 %.

    Remedies are tried in the order of `RemedyKind`, and certificates in the order of
    ``CERTIFICATES``. The first remedy that reduces the standard uncertainty to at most 71 % (the
    variance to at most half) is returned. If there is no such remedy, the remedy that reduces the
    standard uncertainty most is returned.

    Parameters
    ----------
    tried
        The campaign, with the standard uncertainties of its parameters after each remedy.
    sd
        Standard uncertainties without any remedy, shape (p,), in internal units. There is one for
        each parameter and one for each change of a compliance with force, p in all.
    measured_share
        For each of these p quantities, the share of its variance that comes from sources measured
        in this campaign, such as scatter between readings and circles, shape (p,).
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
            if _is_helpful(trial, i, repetition[i], float(measured_share[i])):
                helpful.append(trial)
        cheapest[name] = _choose_remedy(helpful, i, float(sd[i]))
    return cheapest


def _is_helpful(trial: _Trial, i: int, repetition: float, measured_share: float) -> bool:
    """Return whether a remedy by itself reduces the standard uncertainty of parameter i noticeably.

    A remedy is a certificate or a change of the plan; ``trial`` holds the remedy and its effect on
    all parameters. The standard uncertainty with the remedy must be less than 90 % of the standard
    uncertainty without the remedy. A remedy that adds circles under other conditions must also be
    better than taking all readings twice under the same conditions. More circles under the same
    conditions help only if most of the variance comes from sources that are measured in this
    campaign. ``measured_share`` is the share of these sources in the variance. ``repetition`` is
    the standard uncertainty from all readings taken twice, divided by the present standard
    uncertainty.
    """
    ratio = float(trial.ratio[i])
    if not ratio < NARROWER:
        return False
    if trial.kind == RemedyKind.CIRCLES:
        return measured_share > MAJORITY
    if trial.circles:
        return ratio < _BETTER_THAN_REPETITION * repetition
    return True


def _choose_remedy(helpful: Sequence[_Trial], i: int, sd: float) -> Remedy | None:
    """Return the first sufficient remedy for parameter i, or the best remedy if none is sufficient.

    A remedy is a certificate or a change of the plan. A remedy is sufficient if it removes at least
    half of the parameter's variance. The best remedy leaves the smallest standard uncertainty.
    ``helpful`` are the remedies that reduce the standard uncertainty noticeably, the cheapest
    first. Return None if ``helpful`` is empty. ``sd`` is the standard uncertainty of the parameter
    without any remedy.
    """
    if not helpful:
        return None
    # Ratios that are exactly the limit must not depend on rounding errors.
    limit = CURED_RATIO * (1.0 + _ROUNDING)
    enough = [trial for trial in helpful if trial.ratio[i] <= limit]
    if enough:
        best = enough[0]
    else:
        best = ranked(helpful, lambda trial: -float(trial.ratio[i]))[0]
    ratio = float(best.ratio[i])
    return Remedy(best.kind, best.certificate, best.circles, ratio * sd, ratio)
