"""Goals that no number of circles can reach: the causes, and certificates that would help.

An uncertainty may remain above its goal even if every possible circle is run very many times. The
cause is then an effect that is the same in all circles and that the circles cannot measure.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ldbb_bayes.analysis.design.campaign_family import CampaignFamily
from ldbb_bayes.analysis.design.candidates import VERY_MANY_REPETITIONS
from ldbb_bayes.analysis.design.certificate_offers import CertificateOffer
from ldbb_bayes.analysis.design.possible_certificates import possible_certificates
from ldbb_bayes.analysis.design.states import extend_hyper_parameters
from ldbb_bayes.analysis.variance_sources import sources_of
from ldbb_bayes.campaign.campaign import Instrument
from ldbb_bayes.model.bound_information import information_of
from ldbb_bayes.model.information import Information
from ldbb_bayes.results import Array, Result

__all__ = ["NearMiss", "Obstacle", "near_miss_of", "obstacles_of"]

# A certificate is recommended only if it is useful enough: after very many circles, the uncertainty
# with the certificate must be less than this share of the uncertainty without the certificate.
_WORTH_SHARE = 0.9
_ALL_CERTIFICATES = "all certificates together"


@dataclass(frozen=True)
class Obstacle(Result):
    """Why no number of circles can meet an uncertainty goal, and which certificate would help."""

    #: expanded uncertainty (k = 2) of the goal's parameter that would remain after very many
    #: circles, in the unit of the parameter; always above the largest U that the goal permits. Of a
    #: goal in percent, it is that percentage of the present estimate which would remain.
    U_floor: float
    #: name of the model term or parameter, such as ``Mount`` (compliance of the mount), that would
    #: contribute most to the variance of the goal's parameter if very many circles were run
    held_by: str
    #: share of the variance of the goal's parameter that would come from the model term ``held_by``
    #: (or from the prior, if ``held_by`` is a parameter) if very many circles were run
    share: float
    #: calibration certificate that would help most: one with which the goal could be reached, such
    #: as "mount ± 2 %"; otherwise "all certificates together", if the goal could be reached with
    #: all of them; otherwise the one that would reduce the uncertainty most. An empty string if
    #: the goal cannot be reached and no certificate would reduce the uncertainty by a tenth.
    certificate: str
    #: expanded uncertainty (k = 2) of the goal's parameter that would remain after very many
    #: circles if the instrument had the calibration certificate ``certificate``
    U_with_certificate: float
    #: whether the goal for the parameter's uncertainty could be reached if the instrument had the
    #: calibration certificate ``certificate``
    reached: bool
    #: expanded uncertainty (k = 2) of the goal's parameter that is in reach, together with what is
    #: in reach of all other goals (`GoalDesign.nearest`), in the unit of the parameter. None if no
    #: campaign is as short as the longest machine time.
    reachable_U: float | None = None


@dataclass(frozen=True)
class NearMiss(Result):
    """A goal that could be reached with very many circles, but not with 40 circles or fewer.

    With few circles, the hyper-parameters, such as the standard deviation of the noise, are less
    well known than with very many circles. A campaign of 40 circles may therefore miss a goal that
    is only slightly larger than the uncertainty after very many circles.
    """

    #: number of circles of the largest campaign that was tried in the search for a campaign that
    #: reaches the goals
    circles: int
    #: the expanded uncertainty (k = 2) of the goal's parameter after the largest campaign tried is
    #: at most this value on 90 % of the possible machines; in the parameter's unit
    likely_U: float
    #: share of the possible machines on which the campaign with the largest number of circles
    #: allowed meets the goal
    probability: float
    #: name of the model term or parameter, such as ``Mount`` (compliance of the mount), that would
    #: contribute most to the variance of the goal's parameter if very many circles were run
    held_by: str
    #: share of the variance of the goal's parameter that would come from the model term ``held_by``
    #: (or from the prior, if ``held_by`` is a parameter) if very many circles were run
    share: float
    #: calibration certificate that would reduce the uncertainty of the goal's parameter most, such
    #: as "mount ± 2 %"; an empty string if no certificate would reduce it by at least a tenth
    certificate: str
    #: expanded uncertainty (k = 2) of the goal's parameter that is in reach, as in `Obstacle`
    reachable_U: float | None = None
    #: certificates that the largest campaign tried buys
    bought: tuple[str, ...] = ()


def near_miss_of(
    family: CampaignFamily,
    name: str,
    *,
    circles: int,
    likely_U: float,
    probability: float,
) -> NearMiss:
    """Return the reason why the largest campaign of a family does not reach a goal.

    The reason is the source that would contribute most to the variance of the goal's parameter if
    very many circles were run. The certificate that would reduce the uncertainty most is returned
    with it, if it would reduce the uncertainty by at least a tenth.

    Parameters
    ----------
    family
        Family of campaigns: all campaigns with the same angles of the balls in their sockets, radii
        and certificates.
    name
        Name of the goal's parameter.
    circles, likely_U, probability
        Values of the attributes with the same names in the `NearMiss` that is returned.
    """
    floor = dict(zip(family.goals, family.quick.floor().tolist(), strict=True))[name]
    certificate = ""
    lowest = floor + float(np.log(_WORTH_SHARE))
    for missing, statements in _possible(family, family.bound.campaign.instrument).items():
        distance = _floors_with_certificate(family, missing, statements)[name]
        if distance < lowest:
            certificate = missing
            lowest = distance
    holder = _largest_remaining_sources(family)[name]
    return NearMiss(
        circles=circles,
        likely_U=likely_U,
        probability=probability,
        held_by=holder.name,
        share=holder.share,
        certificate=certificate,
        bought=tuple(offer.name for offer in family.offers),
    )


def obstacles_of(family: CampaignFamily, limits: Mapping[str, float]) -> dict[str, Obstacle]:
    """Return the reasons why goals cannot be reached with any number of circles.

    The result is a dict; its keys are the names of the goals' parameters. Goals that can be reached
    are left out. ``family`` is the family of campaigns whose goals are examined. The family has all
    angles of the balls in their sockets and radii that may be used, and only the certificates that
    the instrument already has. ``limits`` is the largest expanded uncertainty U (k = 2) that each
    goal permits for the present estimate of its parameter. A goal in percent permits another U on
    every possible machine; an uncertainty is therefore computed as a multiple of what the goal
    permits, and stated for the present estimate.
    """
    floor = dict(zip(family.goals, family.quick.floor().tolist(), strict=True))
    stuck = [name for name, distance in floor.items() if distance > 0.0]
    if not stuck:
        return {}
    floors_with: dict[str, dict[str, float]] = {}
    statements_of_all: dict[str, object] = {}
    missing = _possible(family, family.space.pilot.instrument)
    for certificate, statements in missing.items():
        floors_with[certificate] = _floors_with_certificate(family, certificate, statements)
        statements_of_all.update(statements)
    if len(missing) > 1:
        floors_with[_ALL_CERTIFICATES] = _floors_with_certificate(
            family, _ALL_CERTIFICATES, statements_of_all
        )
    held_by = _largest_remaining_sources(family)
    obstacles = {}
    for name in stuck:
        certificate, distance = _most_helpful_certificate(name, floor[name], floors_with)
        obstacles[name] = Obstacle(
            U_floor=limits[name] * float(np.exp(floor[name])),
            held_by=held_by[name].name,
            share=held_by[name].share,
            certificate=certificate,
            U_with_certificate=limits[name] * float(np.exp(distance)),
            reached=distance <= 0.0,
        )
    return obstacles


def _possible(family: CampaignFamily, instrument: Instrument) -> dict[str, Mapping[str, Any]]:
    """Return the certificates that ``instrument`` does not have but can have."""
    return possible_certificates(family.space.model, family.space.pilot, instrument)


def _floors_with_certificate(
    family: CampaignFamily, name: str, statements: Mapping[str, object]
) -> dict[str, float]:
    """Return ln(u/u*) of every goal after very many circles, with one more certificate.

    u is the standard uncertainty that the goal's parameter would have after very many circles, and
    u* the largest standard uncertainty that the goal permits. ``name`` is the name of the
    certificate, and ``statements`` are the values that it states for properties of the instrument,
    such as the length of the bar. The result is a dict; its keys are the names of the goals'
    parameters.
    """
    offer = CertificateOffer(name, 0.0, statements)
    offers = (*family.offers, offer)
    certified = replace(family, offers=offers)
    return dict(zip(family.goals, certified.quick.floor().tolist(), strict=True))


def _most_helpful_certificate(
    name: str, floor: float, floors_with: Mapping[str, Mapping[str, float]]
) -> tuple[str, float]:
    """Return the most helpful certificate for a goal, and ln(u/u*) with this certificate.

    u is the standard uncertainty that the goal's parameter ``name`` would have if very many circles
    were run, and u* the largest standard uncertainty that the goal permits. ``floor`` is ln(u/u*)
    without further certificates. ``floors_with`` holds ln(u/u*) with each certificate; the outer
    keys are the names of the certificates, and the inner keys are the names of the goals'
    parameters. The result is the first of the following certificates that exists:

    1. the first single certificate with which the goal is reached;
    2. "all certificates together", if the goal is reached with all certificates;
    3. the single certificate that reduces u most, if it reduces u by at least a tenth;
    4. an empty string, if there is no such certificate.
    """
    singles = [key for key in floors_with if key != _ALL_CERTIFICATES]
    for key in floors_with:
        if floors_with[key][name] <= 0.0:
            return key, floors_with[key][name]
    if not singles:
        return "", floor
    best = min(singles, key=lambda key: floors_with[key][name])
    distance = floors_with[best][name]
    if distance > floor + np.log(_WORTH_SHARE):
        return "", floor
    return best, distance


@dataclass(frozen=True)
class _LargestSource:
    """Source that would contribute most to a parameter's variance if very many circles were run."""

    name: str  #: source of variance: class name of a model term, or name of a parameter
    #: share of the variance of the goal's parameter that would come from this source of uncertainty
    #: if very many circles were run
    share: float


def _largest_remaining_sources(family: CampaignFamily) -> dict[str, _LargestSource]:
    """Return, for every goal, the largest source of variance that remains after very many circles.

    The variance is that of the goal's parameter, if every possible circle is run very many times.
    The result is a dict; its keys are the names of the goals' parameters.
    """
    bound = family.bound
    tests_run = len(family.space.pilot.tests) if family.space.augment else 0
    phi = np.sqrt((extend_hyper_parameters(bound, family.states.phi, tests_run) ** 2).mean(axis=0))
    sources = sources_of(bound, _as_if_run_very_often(information_of(bound, phi), tests_run))
    holders = {}
    for name in family.goals:
        largest = sources[name].sources[0]
        holders[name] = _LargestSource(largest.name, largest.share)
    return holders


def _as_if_run_very_often(information: Information, tests_run: int) -> Information:
    """Return the linear model of the readings as if each planned circle were run very many times.

    The random errors that differ from circle to circle then average out; effects that are the same
    in all circles remain. The first ``tests_run`` circles have already been run, and are not
    repeated.
    """
    # ``information.noise`` holds a dictionary for each test: the covariances of the test's noise.
    # If several tests have the same noise, their entries are one and the same dictionary. In the
    # result, too, their entries are one and the same dictionary.
    averaged: dict[int, dict[str, Array]] = {}
    for noises in information.noise[tests_run:]:
        averaged[id(noises)] = {name: cov / VERY_MANY_REPETITIONS for name, cov in noises.items()}
    planned = tuple(averaged[id(noises)] for noises in information.noise[tests_run:])
    return replace(information, noise=(*information.noise[:tests_run], *planned))
