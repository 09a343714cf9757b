"""Certificates that the readings of a campaign contradict.

The grade of a ball bounds its form error. If the readings show that the balls are less round, a
certificate with this grade cannot be had, and what it would bring need not be forecast. The other
certificates state a value that is not known beforehand; readings cannot contradict them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.special import logsumexp

from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array

__all__ = ["contradicted_certificates", "is_contradicted"]

# Readings contradict a certificate if they are less probable with it than without it, and the log
# of the ratio is below this number [nat].
_LEAST_LOG_RATIO = -5.0
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
    much too large, few of the values of φ hold the whole mean, which is then too small.) See
    `contradicted_certificates` for the arguments; ``statements`` are the fields of the instrument
    that the certificate states.
    """
    states_a_ball = "work" in statements or "tool" in statements
    if bound.campaign.is_plan or not states_a_ball:
        return False
    instrument = replace(bound.campaign.instrument, **statements)
    campaign = replace(bound.campaign, instrument=instrument)
    certified = BoundModel(bound.model, campaign, pilot=bound.pilot)
    carried = certified.hyper_prior.carried(bound.hyper_prior, phi)
    log_ratio = certified.given(carried)[0] - bound.given(phi)[0]
    if logsumexp(log_ratio, b=weight / np.sum(weight)) >= _LEAST_LOG_RATIO:
        return False
    return _log_evidence(certified) - _log_evidence(bound) < _LEAST_LOG_RATIO


def _log_evidence(bound: BoundModel) -> float:
    """Return the log evidence of a campaign's model in which compliances may be negative [nat]."""
    return HyperPosterior(bound, truncated=False).nodes(_TOLERANCE).evidence.log_value
