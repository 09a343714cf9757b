"""Difference of the parameters between two campaigns with the same instrument or machine.

If bar, balls, mount and force device are the same in both campaigns, the errors of these parts
largely cancel in the difference. These errors are described by nuisance coefficients (of effects
that are modelled but not of interest), which are common to both campaigns. Their prior is therefore
used only once. If the campaigns state different knowledge of an error, such as a certificate in
only one of them, the prior with the smaller standard deviation is used. If what they state
contradicts each other, they are in conflict, as if their readings were.

Other effects are only similar in both campaigns: some effects of the machine, if it is the same,
and the error of the bar's length, if no certificate states it (`similar_effects`).

β are the p parameters of interest; φ are the h hyper-parameters (such as the standard deviation of
the noise).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from ldbb_bayes.analysis.similar_effects import (
    correlate_priors,
    machine_terms,
    prior_difference,
    similar_units,
)
from ldbb_bayes.errors import require
from ldbb_bayes.inference.coefficients import shared_terms
from ldbb_bayes.model.bound_information import information_of
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.terms import Term
from ldbb_bayes.results import Array
from ldbb_bayes.units import ranked

__all__ = [
    "NOTHING_SHARED",
    "CampaignPosterior",
    "Conflict",
    "JointDifference",
    "Shared",
    "distances_of_readings",
    "joint_difference",
    "worst_conflict",
]

# The readings of a campaign are called informative about a nuisance coefficient of the instrument
# if they reduce its variance: the prior variance divided by the posterior variance must exceed 1 by
# more than this number.
_LEAST_INFORMATION = 0.05
# Names of the hyper-parameters that are common to both campaigns if the instrument is the same: the
# scale of the balls' form errors, and the decay. The decay is the exponent of the power law by
# which these errors decrease with the number of waves per turn.
_INSTRUMENT_HYPERS = ("tau", "decay")
# Names of the hyper-parameters that are common to both campaigns if the machine is the same: the
# scale of the machine's pattern.
_MACHINE_HYPERS = ("omega",)


@dataclass(frozen=True)
class Shared:
    """What two campaigns have in common."""

    #: whether bar, balls, mount and force device are the same in two campaigns
    instrument: bool = False
    machine: bool = False  #: whether two campaigns were run on the same machine
    #: whether two campaigns state different serial numbers, or different machines by name
    states_two_machines: bool = False

    @property
    def anything(self) -> bool:
        """Whether two campaigns have the instrument, the machine or both in common."""
        return self.instrument or self.machine

    @property
    def hypers(self) -> tuple[str, ...]:
        """Names of the hyper-parameters that have the same values in both campaigns."""
        names: tuple[str, ...] = ()
        if self.instrument:
            names += _INSTRUMENT_HYPERS
        if self.machine:
            names += _MACHINE_HYPERS
        return names


NOTHING_SHARED = Shared()  #: two campaigns with different instruments on different machines


class Conflict(NamedTuple):
    """The common effect whose estimates from two campaigns differ most.

    ``coefficient`` is the name of the nuisance coefficient that describes the effect.
    """

    coefficient: str
    #: p-value of the disagreement of two campaigns about an effect that they have in common: the
    #: probability of a larger disagreement by chance. It is multiplied by the number of comparisons
    #: (Bonferroni), of readings and of statements, and limited to 1. Compared are the estimates
    #: from the readings alone, and what the two campaigns state.
    p_value: float


class JointDifference(NamedTuple):
    """Joint estimate of n parameters in two campaigns, and the difference between the campaigns."""

    means: Array  #: posterior means of n parameters in two campaigns, shape (2, n)
    #: posterior mean of the difference of each of n parameters, second campaign minus first, shape
    #: (n,)
    difference: Array
    #: standard uncertainties of the differences of n parameters between two campaigns, shape (n,)
    sd: Array
    #: the common effect for which the estimates from the two campaigns, or what they state,
    #: disagree most; None if no common effect can be estimated from both campaigns, and they state
    #: the same
    conflict: Conflict | None


class CampaignPosterior(NamedTuple):
    """Posterior of the coefficients of one campaign's model, given the hyper-parameters."""

    information: Information
    #: names of the coefficients of a campaign's model: the parameters, and the nuisance
    #: coefficients (of effects not of interest) that act in several tests
    names: list[str]
    mean: Array  #: posterior mean of each coefficient of a model, in the order of ``names``
    #: prior mean of each coefficient of a model, in the order of ``names``. It is not zero if a
    #: certificate states the value of an error of the instrument.
    prior_mean: Array


def joint_difference(
    bounds: Sequence[BoundModel],
    phi: Sequence[Array],
    rows: Sequence[Mapping[str, Array]],
    shared: Shared,
) -> JointDifference:
    """Return how the parameters differ between two campaigns with effects in common.

    Parameters
    ----------
    bounds : sequence of BoundModel
        Models applied to the first and to the second campaign.
    phi : sequence of ndarray
        Hyper-parameters of each campaign, shape (h,); lengths in mm.
    rows : sequence of mapping
        For each campaign, what one unit of each of its coefficients adds to the n compared
        parameters, shape (n,). The keys are the names of the coefficients; others add nothing.
    shared : Shared
        Whether the campaigns have the instrument, the machine or both in common.
    """
    if shared.instrument and _several_clockings(bounds):
        bounds = [bound.with_two_balls() for bound in bounds]
    phi = _share_hypers(bounds, phi, shared)
    campaigns = [
        _information_and_means(bound, values) for bound, values in zip(bounds, phi, strict=True)
    ]
    require(
        not any(campaign.information.flat for campaign in campaigns),
        "same_instrument and same_machine must go with proper priors, got flat ones. Fit with the"
        " default preset.",
    )
    first, second = campaigns
    common = _common_coefficients(first, second, shared, bounds)
    similar = _similar_coefficients(first, second, shared, bounds, common)
    all_names = [*first.names, *(name for name in second.names if name not in common)]
    size = len(all_names)
    places = [
        _joint_places(campaign, all_names, common, is_first=campaign is first)
        for campaign in campaigns
    ]
    joint = _joint_posterior(campaigns, places, common, size)
    joint = joint + _correlation(campaigns, places, similar, bounds, size)
    rows_of_first = _joint_rows(first, places[0], rows[0], size)
    rows_of_second = _joint_rows(second, places[1], rows[1], size)
    difference_rows = rows_of_second - rows_of_first
    return JointDifference(
        means=np.stack([rows_of_first, rows_of_second]) @ joint.mean,
        difference=difference_rows @ joint.mean,
        sd=np.sqrt((joint.spread(difference_rows) ** 2).sum(axis=1)),
        conflict=_conflict(campaigns, common, similar, bounds),
    )


def _conflict(
    campaigns: Sequence[CampaignPosterior],
    common: Sequence[str],
    similar: Sequence[str],
    bounds: Sequence[BoundModel],
) -> Conflict | None:
    """Return the effect about which two campaigns disagree most, or None.

    They disagree if their readings do, or if they state different values of an error of the common
    instrument. ``common`` are the names of the coefficients that have the same value in both
    campaigns, and ``similar`` those of the coefficients that are similar. ``bounds`` are the
    models.
    """
    similar_sd = np.stack([_prior_sds(campaign, similar) for campaign in campaigns])
    units = np.hstack([np.ones((2, len(common))), similar_units(similar, similar_sd, bounds)])
    of_readings = distances_of_readings(
        [*common, *similar],
        units,
        [0.0] * len(common) + [prior_difference(name) for name in similar],
        campaigns,
    )
    return worst_conflict(of_readings, _distances_of_statements(campaigns, common, bounds))


def worst_conflict(
    of_readings: Mapping[str, float], of_statements: Mapping[str, float]
) -> Conflict | None:
    """Return the common effect about which two campaigns disagree most, or None.

    Each comparison is of two values, such as the estimates from the readings of the two campaigns.
    Its distance is the absolute difference of the values, divided by the standard uncertainty of
    this difference. The p-value allows for all comparisons together, of readings and of statements.

    Parameters
    ----------
    of_readings
        Distances of what the readings say. The keys are the names of the coefficients.
    of_statements
        Distances of what the campaigns state, likewise.

    Returns
    -------
    Conflict or None
        Coefficient and p-value of the largest distance. None if nothing was compared.
    """
    compared = len(of_readings) + len(of_statements)
    if compared == 0:
        return None
    distances = dict(of_statements)
    for name, distance in of_readings.items():
        distances[name] = max(distance, distances.get(name, 0.0))
    worst = ranked(distances, distances.__getitem__)[0]
    return Conflict(worst, min(1.0, float(2.0 * ndtr(-distances[worst])) * compared))


def _distances_of_statements(
    campaigns: Sequence[CampaignPosterior], common: Sequence[str], bounds: Sequence[BoundModel]
) -> dict[str, float]:
    """Return how far apart the statements of two campaigns about errors of one instrument are.

    A statement is a certificate, or a nominal value such as the mount's deflection. The difference
    of the two prior means is divided by the standard uncertainty of this difference. Errors of
    which the campaigns state the same are left out. ``common`` are the names of the coefficients
    that have the same value in both campaigns, and ``bounds`` are the models.
    """
    first, second = (_prior_of(campaign, common) for campaign in campaigns)
    sd = np.sqrt(1.0 / first.precision + 1.0 / second.precision)
    distance = np.abs(first.mean - second.mean) / sd
    distances = {}
    for j, name in enumerate(common):
        nominal = {Term.owner(name).nominal(name, bound.campaign) for bound in bounds}
        is_stated = all(_is_stated(name, bound) for bound in bounds)
        if (is_stated or len(nominal) > 1) and distance[j] > 0.0:
            distances[name] = float(distance[j])
    return distances


def _several_clockings(bounds: Sequence[BoundModel]) -> bool:
    """Return whether the tests of both campaigns together have more than one clocking.

    A clocking is the pair of angles by which the work ball and the tool ball are turned in their
    sockets.
    """
    clockings = set()
    for bound in bounds:
        for test in bound.campaign.tests:
            clockings.add((test.work_ball_deg % 360.0, test.tool_ball_deg % 360.0))
    return len(clockings) > 1


def _share_hypers(
    bounds: Sequence[BoundModel], phi: Sequence[Array], shared: Shared
) -> list[Array]:
    """Return the hyper-parameters of both campaigns, with the same values for common effects.

    ``bounds`` are the models of the two campaigns, and ``phi`` holds for each of them the values of
    its h hyper-parameters, shape (h,); h may differ. ``shared`` states which hyper-parameters the
    campaigns have in common. If the models of both campaigns have one of them, its two values are
    replaced by their mean.
    """
    of_campaigns = [values.copy() for values in phi]
    for name in shared.hypers:
        if any(name not in bound.hyper_prior.names for bound in bounds):
            continue
        indices = [bound.hyper_prior.names.index(name) for bound in bounds]
        mean = 0.5 * (of_campaigns[0][indices[0]] + of_campaigns[1][indices[1]])
        for values, index in zip(of_campaigns, indices, strict=True):
            values[index] = mean
    return of_campaigns


def _information_and_means(bound: BoundModel, phi: Array) -> CampaignPosterior:
    """Return the posterior of one campaign's coefficients, given its hyper-parameters.

    The coefficients are the parameters of the campaign, and those nuisance coefficients (of effects
    not of interest) that act in several tests. ``phi`` are the h hyper-parameters, shape (h,), with
    lengths in mm.
    """
    information = information_of(bound, phi)
    # The error of the bar's length is common to both campaigns only if the radius is the same in
    # both. The radius is therefore part of the name of this error.
    bar_length = f"bar_length_{bound.setting.radii_mm[0]:g}"
    names = []
    for name in information.names:
        if name == "bar_length":
            name = bar_length
        names.append(name)
    # An error of the instrument is one of a nominal value, which may differ between the campaigns.
    # The mean of the quantity itself is compared.
    nominal = np.array(
        [Term.owner(name).nominal(name, bound.campaign) for name in information.names]
    )
    return CampaignPosterior(
        information, names, _posterior_mean(bound, phi) + nominal, _prior_mean(bound) + nominal
    )


def _terms_in_common(shared: Shared, bounds: Sequence[BoundModel]) -> frozenset[str]:
    """Return the class names of the terms of the instrument and machine that two campaigns share.

    ``shared`` states what the campaigns have in common, and ``bounds`` are their models.
    """
    terms: frozenset[str] = frozenset()
    if shared.instrument:
        terms |= {name for name, kind in Term.kinds.items() if kind.instrument}
    if shared.machine:
        terms |= machine_terms(bounds)
    return terms


def _common_coefficients(
    first: CampaignPosterior,
    second: CampaignPosterior,
    shared: Shared,
    bounds: Sequence[BoundModel],
) -> list[str]:
    """Return the names of the coefficients that have the same value in both campaigns.

    They are the nuisance coefficients of the instrument, and those of the machine that do not
    change from campaign to campaign, as far as instrument and machine are the same. A coefficient
    of which a part is another in every campaign is among them only if a certificate of one of the
    campaigns states it. ``bounds`` are the models.
    """
    names = []
    for name in _coefficients_in_both(first, second, _terms_in_common(shared, bounds)):
        is_constant = Term.owner(name).campaign_correlation == 1.0
        if is_constant or any(_is_stated(name, bound) for bound in bounds):
            names.append(name)
    return names


def _is_stated(coefficient: str, bound: BoundModel) -> bool:
    """Return whether a certificate of a campaign states a nuisance coefficient of its model."""
    for term in bound.model.nuisances:
        if type(term) is Term.owner(coefficient):
            return term.is_stated(coefficient, bound.campaign)
    return False


def _similar_coefficients(
    first: CampaignPosterior,
    second: CampaignPosterior,
    shared: Shared,
    bounds: Sequence[BoundModel],
    common: Collection[str],
) -> list[str]:
    """Return the names of the coefficients that are similar in both campaigns.

    They are the nuisance coefficients of the machine, if both campaigns were run on it, and those
    of the instrument that are not ``common``, if the instrument is the same. ``bounds`` are the
    models of the campaigns.
    """
    in_both = _coefficients_in_both(first, second, _terms_in_common(shared, bounds))
    return [name for name in in_both if name not in common]


def _coefficients_in_both(
    first: CampaignPosterior, second: CampaignPosterior, terms: Collection[str]
) -> list[str]:
    """Return the names of nuisance coefficients that occur in both campaigns.

    ``terms`` are the class names of the terms to which the coefficients belong.
    """
    names = []
    for name, owner in zip(first.names, first.information.owners, strict=True):
        if owner in terms and name in second.names:
            names.append(name)
    return names


def _joint_posterior(
    campaigns: Sequence[CampaignPosterior],
    places: Sequence[Sequence[int]],
    common: Sequence[str],
    size: int,
) -> Gaussian:
    """Return the posterior of all coefficients, given the readings of both campaigns.

    The result is the product of the posteriors of the two campaigns, each divided by its prior of
    the coefficients that both campaigns have, and of one prior of these coefficients. Of the two
    priors of a coefficient, it is the one with the smaller standard deviation.

    Parameters
    ----------
    campaigns
        Posterior of each campaign's coefficients.
    places
        For each campaign, the indices of its coefficients in the joint list of all coefficients.
    common
        Names of the coefficients that both campaigns have.
    size
        Number of coefficients in the joint list.
    """
    # The product contains the priors of both campaigns. The wider of the two priors of each common
    # coefficient is divided out.
    wider = _wider_prior(*(_prior_of(campaign, common) for campaign in campaigns))
    common_places = [campaigns[0].names.index(name) for name in common]
    divided_precision = np.zeros((size, size))
    divided_precision[common_places, common_places] = -wider.precision
    divided_shift = np.zeros(size)
    divided_shift[common_places] = -wider.precision * wider.mean
    joint = Gaussian(divided_precision, divided_shift)
    for campaign, places_of_campaign in zip(campaigns, places, strict=True):
        root = campaign.information.root()[0] / campaign.information.scale
        precision = np.zeros((size, size))
        shift = np.zeros(size)
        precision[np.ix_(places_of_campaign, places_of_campaign)] = root.T @ root
        shift[places_of_campaign] = root.T @ (root @ campaign.mean)
        joint = joint + Gaussian(precision, shift)
    return joint


def _correlation(
    campaigns: Sequence[CampaignPosterior],
    places: Sequence[Sequence[int]],
    similar: Sequence[str],
    bounds: Sequence[BoundModel],
    size: int,
) -> Gaussian:
    """Return the factor that makes the priors of similar coefficients correlated.

    ``similar`` are the names of these coefficients, which are independent in the posteriors of the
    two ``campaigns``. ``places`` and ``size`` have the same meaning as in `_joint_posterior`.
    ``bounds`` are the models of the campaigns.
    """
    rows = []
    for campaign, places_of_campaign in zip(campaigns, places, strict=True):
        rows += [places_of_campaign[campaign.names.index(name)] for name in similar]
    prior_sd = np.stack([_prior_sds(campaign, similar) for campaign in campaigns])
    factor = correlate_priors(similar, prior_sd, bounds)
    precision = np.zeros((size, size))
    precision[np.ix_(rows, rows)] = factor.precision
    return Gaussian(precision, np.zeros(size))


def _prior_sds(campaign: CampaignPosterior, names: Sequence[str]) -> Array:
    """Return the prior standard deviations of the coefficients ``names`` in a campaign, (c,)."""
    indices = np.array([campaign.names.index(name) for name in names], dtype=int)
    return np.asarray(campaign.information.scale[indices])


def _joint_rows(
    campaign: CampaignPosterior, places: Sequence[int], rows: Mapping[str, Array], size: int
) -> Array:
    """Return the matrix that computes the compared parameters of a campaign from all coefficients.

    The vector of all coefficients of both campaigns has ``size`` elements, and ``places`` are the
    positions of the campaign's coefficients in this vector. ``rows`` holds what one unit of each
    coefficient adds to the n compared parameters, shape (n,). The matrix has the shape (n, size).
    """
    n = len(next(iter(rows.values())))
    matrix = np.zeros((n, size))
    for name, place in zip(campaign.names, places, strict=True):
        matrix[:, place] = rows.get(name, 0.0)
    return matrix


class _Prior(NamedTuple):
    """Independent normal priors of the c coefficients that both campaigns have."""

    mean: Array  #: prior means of the c coefficients in internal units (mm, N, rad), shape (c,)
    #: inverse prior variances of the c coefficients in internal units (mm, N, rad), shape (c,)
    precision: Array


def _prior_of(campaign: CampaignPosterior, common: Sequence[str]) -> _Prior:
    """Return the priors that one campaign states of the c coefficients named ``common``."""
    places = np.array([campaign.names.index(name) for name in common], dtype=int)
    return _Prior(campaign.prior_mean[places], campaign.information.scale[places] ** -2.0)


def _wider_prior(first: _Prior, second: _Prior) -> _Prior:
    """Return, for each coefficient, the prior with the larger standard deviation of two priors."""
    first_is_wider = first.precision < second.precision
    return _Prior(
        np.where(first_is_wider, first.mean, second.mean),
        np.where(first_is_wider, first.precision, second.precision),
    )


def _joint_places(
    campaign: CampaignPosterior, all_names: Sequence[str], common: Sequence[str], *, is_first: bool
) -> list[int]:
    """Return the positions of a campaign's coefficients in the list of all coefficients.

    ``all_names`` is this list: the names of the coefficients of the first campaign, then of those
    of the second campaign that the first does not have. ``common`` are the names of the
    coefficients that both campaigns have; they are listed only once. ``is_first`` is true if
    ``campaign`` is the first campaign.
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


def distances_of_readings(
    common: Sequence[str],
    units: Array,
    prior_differences: Sequence[float],
    campaigns: Sequence[CampaignPosterior],
) -> dict[str, float]:
    """Return how far apart the readings of two campaigns are about each common effect.

    The campaigns have the instrument, the machine or both in common; each of the effects that they
    have in common is described by a coefficient ν. From the readings y of each campaign, ν is
    estimated without its prior. The standard uncertainty of the estimate is 1/√l, where
    l = 1/Var(ν | y) − 1/S and S is the prior variance of ν. For each ν, the difference of the two
    estimates is divided by the standard uncertainty of this difference.

    Parameters
    ----------
    common : sequence of str
        Names of the nuisance coefficients that both campaigns have in common.
    units : ndarray, shape (2, c)
        Units in which each of these c coefficients is the same, or nearly the same, in both
        campaigns.
    prior_differences : sequence of float
        Prior standard deviation of the difference of each of these coefficients between the
        campaigns, in these units.
    campaigns : sequence of CampaignPosterior
        Posterior of the coefficients of each campaign.

    Returns
    -------
    dict
        Absolute values of these ratios. The keys are the names of the coefficients about which the
        readings of both campaigns are informative.
    """
    scales = []
    variances = []
    common_means = []
    common_prior_means = []
    for campaign in campaigns:
        places = np.array([campaign.names.index(name) for name in common], dtype=int)
        scales.append(campaign.information.scale[places])
        variances.append(np.diag(campaign.information.covariance())[places])
        common_means.append(campaign.mean[places])
        common_prior_means.append(campaign.prior_mean[places])
    scale = np.array(scales)
    variance = np.array(variances)
    # ``variance`` holds the coefficients' variances in units of their prior variances. ``estimate``
    # is the estimate of each coefficient from the readings of a campaign alone, without the prior.
    # ``precision`` is the inverse variance of this estimate.
    precision_in_prior_units = 1.0 / variance - 1.0
    precision = precision_in_prior_units / scale**2
    is_informed = precision_in_prior_units.min(axis=0) > _LEAST_INFORMATION
    shrinkage = variance * np.maximum(precision_in_prior_units, _LEAST_INFORMATION)
    prior_mean = np.array(common_prior_means)
    estimate = (prior_mean + (np.array(common_means) - prior_mean) / shrinkage) / units
    distances = {}
    for j in np.flatnonzero(is_informed).tolist():
        variance_of_estimates = 1.0 / (precision[:, j] * units[:, j] ** 2)
        sd = np.sqrt(variance_of_estimates.sum() + prior_differences[j] ** 2)
        distances[common[j]] = float(abs(estimate[0, j] - estimate[1, j]) / sd)
    return distances


def _posterior_mean(bound: BoundModel, phi: Array) -> Array:
    """Return the posterior mean of parameters and shared nuisance coefficients, given ``phi``.

    ``phi`` are the h hyper-parameters, shape (h,), with lengths in mm. Shared nuisance coefficients
    act in several tests. The means have the order of `information_of`: parameters first.
    """
    parameters = bound.given(phi[None]).parameters
    beta = parameters.mean[0]
    if not shared_terms(bound.nuisance_columns):
        return np.asarray(beta)
    _, nuisances = bound.likelihood_given_parameters.conditional(
        phi[None], (beta - bound.least_squares_estimate)[None]
    )
    return np.concatenate([beta, nuisances.mean[0]])


def _prior_mean(bound: BoundModel) -> Array:
    """Return the prior means of q parameters and shared nuisance coefficients, shape (q,).

    Shared nuisance coefficients act in several tests. The means are in internal units (mm, N, rad)
    and have the order of `information_of`: parameters first.
    """
    means = [bound.prior_mean]
    for term in shared_terms(bound.nuisance_columns):
        means.append(term.prior_mean)
    return np.concatenate(means)
