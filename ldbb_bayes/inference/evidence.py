"""ln Z = ln ∫ p(y | φ) p(φ) dφ, everything linear integrated out exactly; truncated: ln Z + ln P(T | y) − ln P(T | prior)."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.lattice import Lattice
from ldbb_bayes.inference.quadrature import HyperPosterior
from ldbb_bayes.model.bound import BoundModel
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.threads import one_blas_thread

__all__ = [
    "Evidence",
    "TruncationProbability",
    "check_comparable",
    "evidence_of",
    "evidence_on",
    "log_bayes_factor",
    "log_evidence",
    "log_prob_truncation",
]

Array = NDArray[Any]
_NEARLY_ONE = 0.1
_CHECKED = 64


@dataclass(frozen=True)
class Evidence:
    """ln Z of a model and a campaign.

    Attributes
    ----------
    log_value : float
        ln of the density of the readings in mm; only differences between models of the same readings mean anything.
    error : float
        Of ``log_value`` [nat].
    nodes : int
        Of the quadrature.
    sha256 : str
        Digest of the readings it is of.
    """

    log_value: float
    error: float
    nodes: int
    sha256: str


@dataclass(frozen=True)
class TruncationProbability:
    """ln P(T | y) of the untruncated posterior, with its error [nat]."""

    log_value: float
    error: float


@one_blas_thread
def log_evidence(model: HybridModel, campaign: Campaign, *, tolerance: float = 1e-3) -> Evidence:
    """The exact log evidence by quadrature over the hyper-parameters, truncation included.

    Parameters
    ----------
    tolerance : float
        Error asked for [nat]; ``error`` of the result says what was reached.

    Raises
    ------
    InputError
        For a flat prior, whose evidence is undefined, a plan, or a tolerance that is not positive.
    """
    check_comparable(model, campaign)
    if not tolerance > 0:
        raise InputError(f"tolerance must be a positive number of nats, got {tolerance}. For example 1e-3.")
    bound = model.bind(campaign)
    return evidence_of(HyperPosterior(bound, truncated=bound.truncation.active), tolerance=tolerance)


def check_comparable(model: HybridModel, campaign: Campaign) -> None:
    """Refuse what has no evidence: improper priors, and plans."""
    if model.prior.flat:
        raise InputError(
            "a model must have a proper prior to have an evidence, got a flat one, under which it is undefined. "
            "Use the default preset."
        )
    if campaign.is_plan:
        raise InputError("a campaign must have readings to give an evidence, got a plan. Run the tests, or simulate it.")


def evidence_of(posterior: HyperPosterior, *, tolerance: float = 1e-3) -> Evidence:
    """The same from the density over the hyper-parameters."""
    return evidence_on(posterior, posterior.lattice(tolerance))


def evidence_on(posterior: HyperPosterior, lattice: Lattice) -> Evidence:
    """The same from nodes at hand."""
    bound = posterior.bound
    prior = bound.log_prob_truncation_prior if posterior.truncated else 0.0
    error = lattice.error + _orthant_error(posterior, lattice)
    return Evidence(lattice.log_integral - prior, error, len(lattice.weight), _digest(bound))


def log_bayes_factor(evidence: Evidence, other: Evidence) -> tuple[float, float]:
    """ln of the Bayes factor of a model over another, and its error [nat].

    Raises
    ------
    InputError
        When the two are of different readings.
    """
    if evidence.sha256 != other.sha256:
        raise InputError(
            "a Bayes factor must be between models of the same readings, got two campaigns "
            f"({evidence.sha256[:12]}… and {other.sha256[:12]}…). Compute both evidences with the same campaign."
        )
    return evidence.log_value - other.log_value, evidence.error + other.error


def log_prob_truncation(plain: HyperPosterior, truncated: HyperPosterior) -> TruncationProbability:
    """ln P(T | y): the ratio of the integrals with and without the truncation, from coarse lattices."""
    inside, every = truncated.brief, plain.brief
    error = inside.error + every.error + _orthant_error(truncated, inside)
    log_value = inside.log_integral - every.log_integral
    if log_value > _NEARLY_ONE + error:
        raise InputError(
            f"the probability of physical compliances must not exceed one, got ln P = {log_value:.3g} ± {error:.2g}: readings "
            "out of reach of double precision. Check their sign, the mount compensation and the forces."
        )
    return TruncationProbability(min(log_value, 0.0), error)


def _digest(bound: BoundModel) -> str:
    """Of the readings the model is bound to."""
    campaign = bound.campaign
    if len(bound.test_names) == len(campaign.tests):
        return campaign.sha256
    return hashlib.sha256("\n".join([campaign.sha256, *bound.test_names]).encode()).hexdigest()


def _orthant_error(posterior: HyperPosterior, lattice: Lattice) -> float:
    """Error of P(T | y, φ), which all nodes share, over the heaviest nodes."""
    if not posterior.truncated:
        return 0.0
    weight = lattice.weight
    heaviest = np.argsort(-weight)[:_CHECKED]
    _, given = posterior.bound.given(posterior.bound.hyper_prior.phi(lattice.free[heaviest]))
    _, error = given.orthant.log_probability()
    return float(weight[heaviest] @ error / weight[heaviest].sum())
