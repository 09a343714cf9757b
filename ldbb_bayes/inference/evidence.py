"""ln Z = ln ∫ p(y | φ) p(φ) dφ, everything linear integrated out exactly; truncated: ln Z + ln P(T | y) − ln P(T | prior)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.lattice import Lattice
from ldbb_bayes.inference.quadrature import HyperPosterior
from ldbb_bayes.model.hybrid import HybridModel

__all__ = ["Evidence", "TruncationProbability", "evidence_of", "log_evidence", "log_prob_truncation"]

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
    """

    log_value: float
    error: float
    nodes: int


@dataclass(frozen=True)
class TruncationProbability:
    """ln P(T | y) of the untruncated posterior, with its error [nat]."""

    log_value: float
    error: float


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
    if model.prior.flat:
        raise InputError("log_evidence must be asked of a proper prior, got a flat one: it is undefined. Use the default preset.")
    if campaign.is_plan:
        raise InputError("log_evidence must be asked of a campaign with readings, got a plan. Run the tests, or simulate it.")
    if not tolerance > 0:
        raise InputError(f"tolerance must be a positive number of nats, got {tolerance}. For example 1e-3.")
    bound = model.bind(campaign)
    return evidence_of(HyperPosterior(bound, truncated=bound.truncation.active), tolerance=tolerance)


def evidence_of(posterior: HyperPosterior, *, tolerance: float = 1e-3) -> Evidence:
    """The same from the density over the hyper-parameters."""
    lattice = posterior.lattice(tolerance)
    bound = posterior.bound
    prior = bound.log_prob_truncation_prior if posterior.truncated else 0.0
    return Evidence(lattice.log_integral - prior, lattice.error + _orthant_error(posterior, lattice), len(lattice.weight))


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


def _orthant_error(posterior: HyperPosterior, lattice: Lattice) -> float:
    """Error of P(T | y, φ), which all nodes share, over the heaviest nodes."""
    if not posterior.truncated:
        return 0.0
    weight = lattice.weight
    heaviest = np.argsort(-weight)[:_CHECKED]
    _, given = posterior.bound.given(posterior.bound.hyper_prior.phi(lattice.free[heaviest]))
    _, error = given.orthant.log_probability()
    return float(weight[heaviest] @ error / weight[heaviest].sum())
