"""Certificates that the readings of a campaign contradict.

The grade of a ball bounds its form error. If the readings show that the balls are less round, a
certificate with this grade cannot be had, and what it would bring need not be forecast. If the
grade is stated already, the results must not be used. The other certificates state a value that is
not known beforehand; readings cannot contradict them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.special import logsumexp

from ldbb_bayes.campaign.certified_instrument import Ball
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.nodes import compute_nodes
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array

__all__ = [
    "LEAST_RATIO_OF_STATED_BALLS",
    "contradicted_certificates",
    "is_contradicted",
    "log_ratio_of_stated_balls",
]

# Readings contradict a certificate if they are less probable with it than without it, and the log
# of the ratio is below this number [nat].
_LEAST_LOG_RATIO = -5.0
# The same for a form of the balls that is stated already [nat]: a probability ratio of 1 : 1000.
LEAST_RATIO_OF_STATED_BALLS = float(np.log(1e-3))
# Form deviation of balls for comparison, in multiples of what the certificate states. If readings
# are more probable with it, the balls are less round than the certificate states.
_LESS_ROUND = 2.0
# Error allowed in each log evidence with which the ratio is confirmed [nat].
_TOLERANCE = 0.3


def contradicted_certificates(
    bound: BoundModel,
    certificates: Mapping[str, Mapping[str, Any]],
    weight: Array,
    phi: Array,
) -> tuple[str, ...]:
    """Return the names of the certificates that the readings of a campaign contradict.

    Parameters
    ----------
    bound
        Model of the campaign; for a plan, the result is empty.
    certificates
        What each certificate states: names and values of fields of the instrument. The keys are the
        names of the certificates.
    weight, phi
        Weights, shape (w,), and values, shape (w, h), of the h hyper-parameters given the readings;
        lengths in mm.
    """
    names = []
    for name, statements in certificates.items():
        if is_contradicted(bound, statements, weight, phi):
            names.append(name)
    return tuple(names)


def is_contradicted(
    bound: BoundModel, statements: Mapping[str, Any], weight: Array, phi: Array
) -> bool:
    """Return whether the readings contradict what a certificate states of the balls' form.

    With the certificate, the density of the readings is a mean over the hyper-parameters φ of its
    ratio to the density without the certificate, weighted by the posterior of φ. The certificate is
    contradicted if this ratio is below exp(−5), and the ratio of the evidences too. (If the form is
    much too large, few of the values of φ hold the whole mean, which is then too small.) The ratio
    is also small if the balls are much rounder than the certificate states, which does not
    contradict it. It would then be still smaller for balls that are half as round. See
    `contradicted_certificates` for the arguments; ``statements`` are the fields of the instrument
    that the certificate states.
    """
    balls = {name: ball for name, ball in statements.items() if name in ("work", "tool")}
    if bound.campaign.is_plan or not balls:
        return False
    certified = _with_statements(bound, statements)
    log_ratio = _log_mean_ratio(certified, bound, weight, phi)
    if log_ratio >= _LEAST_LOG_RATIO:
        return False
    less_round = _with_statements(bound, dict(statements) | _less_round(balls))
    if _log_mean_ratio(less_round, bound, weight, phi) <= log_ratio:
        return False
    return _log_evidence(certified) - _log_evidence(bound) < _LEAST_LOG_RATIO


def log_ratio_of_stated_balls(bound: BoundModel, weight: Array, phi: Array) -> float:
    """Return how much less probable the readings are with the stated form of the balls [nat].

    The result is the log evidence with what is stated of the balls' sphericity, minus the log
    evidence without it. It is zero if nothing is stated, if the priors are flat, and if the
    readings are no more probable with balls that are half as round: such readings do not contradict
    the statement, even if they would be more probable without it.

    Parameters
    ----------
    bound
        Model applied to a campaign, whose instrument may state the form of one or both balls.
    weight, phi
        Weights, shape (w,), and values, shape (w, h), of the h hyper-parameters given the readings;
        lengths in mm.
    """
    stated = {}
    for name in ("work", "tool"):
        ball = getattr(bound.campaign.instrument, name)
        if ball is not None and ball.stated_sphericity_um is not None:
            stated[name] = ball
    if not stated or bound.campaign.is_plan or bound.model.prior.flat:
        return 0.0
    less_round = _with_statements(bound, _less_round(stated))
    if _log_mean_ratio(less_round, bound, weight, phi) <= 0.0:
        return 0.0
    unstated = {}
    for name, ball in stated.items():
        unstated[name] = replace(ball, grade=None, sphericity_um=None)
    return _log_evidence(bound) - _log_evidence(_with_statements(bound, unstated))


def _less_round(balls: Mapping[str, Ball]) -> dict[str, Ball]:
    """Return balls whose form deviation is twice what is stated of ``balls``.

    The keys of both mappings are "work" and "tool".
    """
    less_round = {}
    for name, ball in balls.items():
        if ball.stated_sphericity_um is not None:
            sphericity_um = _LESS_ROUND * ball.stated_sphericity_um
            less_round[name] = replace(ball, grade=None, sphericity_um=sphericity_um)
    return less_round


def _with_statements(bound: BoundModel, statements: Mapping[str, Any]) -> BoundModel:
    """Return the model of the campaign with what certificates state of the instrument."""
    instrument = replace(bound.campaign.instrument, **statements)
    campaign = replace(bound.campaign, instrument=instrument)
    return BoundModel(bound.model, campaign, pilot=bound.pilot)


def _log_mean_ratio(certified: BoundModel, bound: BoundModel, weight: Array, phi: Array) -> float:
    """Return ln of the mean ratio of the readings' densities with and without a certificate [nat].

    ``weight``, shape (w,), and ``phi``, shape (w, h), are weights and values of the h
    hyper-parameters given the readings.
    """
    carried = certified.hyper_prior.values_from(bound.hyper_prior, phi)
    log_ratio = certified.given(carried).log_evidence - bound.given(phi).log_evidence
    return float(logsumexp(log_ratio, b=weight / np.sum(weight)))


def _log_evidence(bound: BoundModel) -> float:
    """Return the log evidence of a campaign's model in which compliances may be negative [nat]."""
    return compute_nodes(HyperPosterior(bound, truncated=False), _TOLERANCE).evidence.log_value
