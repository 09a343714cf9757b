"""Priors of the quantities that the campaigns of a batch have in common, in n campaigns.

Every campaign states its own prior of each quantity. One prior is found that counts for all of
them: for errors of the common instrument the best that any campaign states, for effects of the
machine the usual one, and for the parameters a reference standard deviation, which serves as their
unit.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, get_args

import numpy as np
from scipy.special import ndtr

from ldbb_bayes.fleet.machine_effects import VARIANCE_OF_CAMPAIGN
from ldbb_bayes.fleet.selection import Caveat, CaveatKind
from ldbb_bayes.machine.parameters import ComplianceName, GeometricKind, GeometricName
from ldbb_bayes.model.parameter_kinds import geometric_unit
from ldbb_bayes.model.prior import Prior
from ldbb_bayes.model.terms import Term
from ldbb_bayes.results import Array
from ldbb_bayes.units import is_compliance_or_slope

__all__ = [
    "NormalPriors",
    "best_priors",
    "contradictory_statements",
    "reference_sd",
    "usual_priors",
]

# Two relative standard deviations count as equal if they differ by less than this share.
_SAME_SD = 1e-6
# What a campaign states of the common instrument contradicts the best statement if the probability
# of a larger difference by chance is below this number.
_CONTRADICTION = 0.01


class NormalPriors(NamedTuple):
    """Independent normal priors of several quantities, in one campaign or in n campaigns."""

    #: prior mean of each quantity in internal units, shape (quantities,) or (n, quantities)
    mean: Array
    #: prior standard deviation of each quantity in internal units, shape (quantities,) or (n,
    #: quantities); zero in a campaign whose model lacks the quantity
    sd: Array


def best_priors(names: Sequence[str], stated: NormalPriors) -> NormalPriors:
    """Return the priors of s instrument errors that all campaigns have in common.

    A certificate that one campaign states of the common instrument is of all campaigns. The prior
    with the smallest standard deviation, relative to its mean if this is not zero, is therefore
    that of all. An sd without a unit, such as that of the force's gain, is relative already.
    Campaigns without a certificate assume the same share of the mount's deflection that they state.
    If several priors are equally narrow, the one with the median mean is taken.

    Parameters
    ----------
    names : names of the errors.
    stated : priors of the errors in n campaigns, shape (n, s).
    """
    mean, sd = stated
    best = NormalPriors(np.zeros(len(names)), np.zeros(len(names)))
    for j, name in enumerate(names):
        having = np.flatnonzero(sd[:, j] > 0.0)
        means = mean[having, j]
        is_relative = Term.owner(name).unit_of(name).inside == "1"
        size = np.where((means == 0.0) | is_relative, 1.0, np.abs(means))
        relative_sd = sd[having, j] / size
        narrowest = having[relative_sd <= relative_sd.min() * (1.0 + _SAME_SD)]
        by_mean = narrowest[np.argsort(mean[narrowest, j])]
        median = by_mean[len(by_mean) // 2]
        best.mean[j] = mean[median, j]
        best.sd[j] = sd[median, j]
    return best


def contradictory_statements(
    names: Sequence[str], stated: NormalPriors, best: NormalPriors, campaigns: Sequence[str]
) -> tuple[Caveat, ...]:
    """Return one caveat for each instrument error of which campaigns state contradictory values.

    A campaign contradicts the best statement if the probability of a larger difference by chance is
    below 1 %, multiplied by the number of campaigns (Bonferroni).

    Parameters
    ----------
    names : names of s instrument errors.
    stated : priors of the errors in n campaigns, shape (n, s).
    best : prior of each error that counts for all campaigns.
    campaigns : names of the n campaigns for the caveat.
    """
    difference_sd = np.hypot(stated.sd, best.sd)
    distance = np.where(stated.sd > 0.0, np.abs(stated.mean - best.mean) / difference_sd, 0.0)
    p_values = 2.0 * ndtr(-distance) * len(campaigns)
    caveats = []
    for j, name in enumerate(names):
        contradicts = np.flatnonzero(p_values[:, j] < _CONTRADICTION)
        others = tuple(campaigns[i] for i in contradicts.tolist())
        if others:
            text = Term.owner(name).describe(name)
            caveats.append(Caveat(CaveatKind.CONTRADICTED_INSTRUMENT, others, text=text))
    return tuple(caveats)


def usual_priors(stated: NormalPriors) -> NormalPriors:
    """Return the priors of the parts of k effects that belong to the machine.

    Campaigns size the priors of effects by the compliances that their own readings show, which
    differ little; the median is that of the machine.

    Parameters
    ----------
    stated : priors of the effects in n campaigns, shape (n, k).
    """
    k = stated.sd.shape[1]
    usual = NormalPriors(np.zeros(k), np.zeros(k))
    for j in range(k):
        is_stated = stated.sd[:, j] > 0.0
        usual.mean[j] = np.median(stated.mean[is_stated, j])
        usual.sd[j] = np.median(stated.sd[is_stated, j]) / np.sqrt(1.0 + VARIANCE_OF_CAMPAIGN)
    return usual


def reference_sd(
    names: Sequence[str], units: Sequence[str], prior_mean: Array, prior_sd: Array
) -> Array:
    """Return the reference sd of every parameter, shape (c,), in internal units (mm, N, rad).

    The reference sd of a parameter is the larger of two values: the sd of the parameter's default
    prior, and the median of the sds of the parameter's priors in the fits of the campaigns. A prior
    in a fit may be wider than the default prior because a compliance stands for the compliances of
    several joints, or because the user expects a more compliant machine. Priors whose mean is not
    zero are left out: they state how well a parameter is known, not how large it may be.

    Parameters
    ----------
    names, units : names and internal units of the c parameters.
    prior_mean, prior_sd : prior means and prior sds of the parameters in n fits, shape (n, c) each.
    """
    prior = Prior.first()
    kind_by_unit = {geometric_unit(kind): kind for kind in get_args(GeometricKind)}
    reference = np.empty(len(names))
    for j, (name, unit) in enumerate(zip(names, units, strict=True)):
        if is_compliance_or_slope(name):
            (default_sd,) = prior.compliance_sd([ComplianceName(*name[2:])])
        else:
            (default_sd,) = prior.geometric_sd([GeometricName("X", "X", kind_by_unit[unit])])
        is_centred = prior_mean[:, j] == 0.0
        reference[j] = default_sd
        if is_centred.any():
            reference[j] = max(default_sd, np.median(prior_sd[is_centred, j]))
    return reference
