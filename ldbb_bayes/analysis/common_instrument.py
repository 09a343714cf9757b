"""The difference of two campaigns run with one instrument, whose errors cancel.

Bar, balls, mount and force device are the same in both: their coefficients, and the prior of these,
count once.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from ldbb_bayes.errors import require
from ldbb_bayes.model.bound_information import information_of
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.terms import Columns, Term
from ldbb_bayes.results import Array
from ldbb_bayes.units import ranked

__all__ = ["Conflict", "JointDifference", "joint_difference", "worst_conflict"]

# Readings say something of a coefficient where they lower its variance by at least this share of
# what they leave.
_LEAST_INFORMATION = 0.05
# Hyper-parameters of the instrument: scale and decay of the form of the balls.
_INSTRUMENT_HYPERS = ("tau", "decay")


class Conflict(NamedTuple):
    """The coefficient of the instrument about which two campaigns disagree most."""

    coefficient: str
    p_value: float  #: allowing for the number of coefficients


class JointDifference(NamedTuple):
    """What both campaigns say together of the parameters compared."""

    means: Array  #: of both campaigns (2, names)
    difference: Array  #: second less first (names,)
    sd: Array  #: of the difference (names,)
    conflict: Conflict | None  #: None where neither campaign says anything of the instrument


class _Campaign(NamedTuple):
    """One campaign at its hyper-parameters."""

    information: Information
    names: list[str]  #: of the coefficients
    mean: Array  #: of the coefficients


def joint_difference(
    bounds: Sequence[BoundModel], phi: Sequence[Array], rows: Sequence[Array]
) -> JointDifference:
    """Return the difference of two campaigns run with one instrument.

    Parameters
    ----------
    bounds : sequence of BoundModel
        Of both campaigns.
    phi : sequence of ndarray
        Hyper-parameters of each, (h,) [mm].
    rows : sequence of ndarray
        Rows that take β of each to the parameters compared, each (names, p).
    """
    if _several_clockings(bounds):
        bounds = [bound.with_two_balls() for bound in bounds]
    phi = _share_hypers(bounds, phi)
    campaigns = [_solve(bound, values) for bound, values in zip(bounds, phi, strict=True)]
    require(
        not any(campaign.information.flat for campaign in campaigns),
        "same_instrument must go with proper priors, got flat ones. Fit with the default preset.",
    )
    first, second = campaigns
    common = _common_coefficients(first, second)
    all_names = [*first.names, *(name for name in second.names if name not in common)]
    size = len(all_names)
    # The prior of what both have is in both posteriors and counts once.
    common_places = np.array([first.names.index(name) for name in common], dtype=int)
    prior_precision = np.zeros((size, size))
    prior_precision[common_places, common_places] = first.information.scale[common_places] ** -2.0
    joint = Gaussian(-prior_precision, np.zeros(size))
    joint_rows = np.zeros((2, len(rows[0]), size))
    for k, campaign in enumerate(campaigns):
        places = _places(campaign, all_names, common, is_first=k == 0)
        root = campaign.information.root()[0] / campaign.information.scale
        precision = np.zeros((size, size))
        shift = np.zeros(size)
        precision[np.ix_(places, places)] = root.T @ root
        shift[places] = root.T @ (root @ campaign.mean)
        joint = joint + Gaussian(precision, shift)
        joint_rows[k][:, places[: rows[k].shape[1]]] = rows[k]
    difference_rows = joint_rows[1] - joint_rows[0]
    return JointDifference(
        joint_rows @ joint.mean,
        difference_rows @ joint.mean,
        np.sqrt((joint.spread(difference_rows) ** 2).sum(axis=1)),
        worst_conflict(
            common,
            [campaign.names for campaign in campaigns],
            [campaign.information for campaign in campaigns],
            [campaign.mean for campaign in campaigns],
        ),
    )


def _several_clockings(bounds: Sequence[BoundModel]) -> bool:
    """Say whether the balls were turned between any two tests."""
    clockings = set()
    for bound in bounds:
        for test in bound.campaign.tests:
            clockings.add((test.work_ball_deg % 360.0, test.tool_ball_deg % 360.0))
    return len(clockings) > 1


def _share_hypers(bounds: Sequence[BoundModel], phi: Sequence[Array]) -> list[Array]:
    """Return hyper-parameters in which those of the instrument are the mean of both campaigns."""
    shared = [values.copy() for values in phi]
    for name in _INSTRUMENT_HYPERS:
        if any(name not in bound.hyper_prior.names for bound in bounds):
            continue
        indices = [bound.hyper_prior.names.index(name) for bound in bounds]
        mean = 0.5 * (shared[0][indices[0]] + shared[1][indices[1]])
        for values, index in zip(shared, indices, strict=True):
            values[index] = mean
    return shared


def _solve(bound: BoundModel, phi: Array) -> _Campaign:
    """Return information, names and posterior mean of a campaign's coefficients."""
    information = information_of(bound, phi)
    # Bar lengths are the same only of the same radius.
    bar_length = f"bar_length_{bound.setting.radii_mm[0]:g}"
    names = []
    for name in information.names:
        if name == "bar_length":
            name = bar_length
        names.append(name)
    return _Campaign(information, names, _posterior_mean(bound, phi))


def _common_coefficients(first: _Campaign, second: _Campaign) -> list[str]:
    """Return the instrument's coefficients that both campaigns have."""
    common = []
    for name, owner in zip(first.names, first.information.owners, strict=True):
        of_instrument = owner in Term.kinds and Term.kinds[owner].instrument
        if of_instrument and name in second.names:
            common.append(name)
    return common


def _places(
    campaign: _Campaign, all_names: Sequence[str], common: Sequence[str], *, is_first: bool
) -> list[int]:
    """Return where a campaign's coefficients stand among those of both.

    Those of the first come first; the others' own follow in their order.
    """
    if is_first:
        return list(range(len(campaign.names)))
    private_count = sum(name not in common for name in campaign.names)
    place = len(all_names) - private_count
    places = []
    for name in campaign.names:
        if name in common:
            places.append(all_names.index(name))
        else:
            places.append(place)
            place += 1
    return places


def worst_conflict(
    common: Sequence[str],
    names: Sequence[Sequence[str]],
    information: Sequence[Information],
    means: Sequence[Array],
) -> Conflict | None:
    """Return where the readings of two campaigns disagree most about a coefficient.

    What they say of it beyond its prior, n ± 1/√l with l = 1/Var(ν | y) − 1/S, must be the same
    number.

    Parameters
    ----------
    common : sequence of str
        Coefficients that both have.
    names : sequence of sequence of str
        All coefficients of each campaign.
    information : sequence of Information
        Of each.
    means : sequence of ndarray
        Posterior means of each.
    """
    scales = []
    variances = []
    common_means = []
    for k in range(len(names)):
        places = np.array([names[k].index(name) for name in common], dtype=int)
        scales.append(information[k].scale[places])
        variances.append(np.diag(information[k].covariance())[places])
        common_means.append(means[k][places])
    scale = np.array(scales)
    variance = np.array(variances)
    gained = 1.0 / variance - 1.0
    precision = gained / scale**2
    informed = precision.min(axis=0) * scale[0] ** 2 > _LEAST_INFORMATION
    if not informed.any():
        return None
    stated = np.array(common_means) / (variance * np.maximum(gained, _LEAST_INFORMATION))
    distances = {}
    for j in np.flatnonzero(informed).tolist():
        sd = np.sqrt((1.0 / precision[:, j]).sum())
        distances[common[j]] = float(abs(stated[0, j] - stated[1, j]) / sd)
    worst = ranked(distances, distances.__getitem__)[0]
    p_value = float(2.0 * ndtr(-distances[worst])) * len(distances)
    return Conflict(worst, min(1.0, p_value))


def _posterior_mean(bound: BoundModel, phi: Array) -> Array:
    """Return the posterior mean of parameters and shared nuisances at φ.

    The order is that of `information_of`.
    """
    beta = bound.given(phi[None])[1].mean[0]
    has_shared_nuisances = any(
        isinstance(term, Columns) and not term.private for term in bound.nuisance_columns
    )
    if not has_shared_nuisances:
        return np.asarray(beta)
    _, nuisances = bound.given_interest.conditional(phi[None], (beta - bound.centre)[None])
    return np.concatenate([beta, nuisances.mean[0]])
