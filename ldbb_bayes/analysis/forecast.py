"""What a set of tests will tell, before it is run: posterior sd of every parameter, information gained, constant or linear.

Of the linear Gaussian model at given hyper-parameters, averaged over these; sd inside the truncation, evidence without it. It
takes the general route through `ldbb_bayes.model.information` and none of the design search's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.analysis.candidates import bind_tests
from ldbb_bayes.analysis.discrimination import DECISIVE, Discrimination, discrimination_of
from ldbb_bayes.analysis.known import Known, narrowed
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.circular_test import CircularTest
from ldbb_bayes.model.bound import BoundModel
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.information import informations_of

__all__ = ["Expected", "Forecast", "forecast"]

Array = NDArray[Any]
_VERY_OFTEN = 1e6
_RANK = 1e-6


@dataclass(frozen=True)
class Expected:
    """Of one parameter, in inside units.

    Attributes
    ----------
    unit : str
    prior_sd : float
        Infinite when flat.
    sd : float
        Posterior sd inside the truncation, its square averaged over what is known; infinite where flat priors leave something
        undetermined.
    untruncated_sd : float
        The same without truncation.
    floor_sd : float
        If every test were run a million times: what nuisances shared by all of them leave, narrowed by the truncation as ``sd``.
    """

    unit: str
    prior_sd: float
    sd: float
    untruncated_sd: float
    floor_sd: float

    def as_dict(self) -> dict[str, Any]:
        """For JSON; what is infinite is null."""
        return {name: value if isinstance(value, str) or np.isfinite(value) else None for name, value in vars(self).items()}


@dataclass(frozen=True)
class Forecast:
    """What tests will tell.

    Attributes
    ----------
    expected : mapping of parameter to Expected
    information_gain : float
        Expected Kullback-Leibler divergence of the posterior from the prior, of all parameters of interest [nat]; infinite when
        the prior is flat.
    discrimination : Discrimination, optional
        Of the model with its slopes against the one without; None without slopes or with flat priors.
    """

    expected: Mapping[str, Expected]
    information_gain: float
    discrimination: Discrimination | None

    @property
    def determined(self) -> bool:
        """Whether the tests determine every parameter; with proper priors they do."""
        return all(np.isfinite(entry.sd) for entry in self.expected.values())

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "expected": {name: entry.as_dict() for name, entry in self.expected.items()},
            "information_gain": self.information_gain if np.isfinite(self.information_gain) else None,
            "discrimination": None if self.discrimination is None else self.discrimination.as_dict(),
        }


def forecast(
    model: HybridModel,
    pilot: Campaign,
    tests: Sequence[CircularTest],
    known: Known,
    *,
    augment: bool = False,
    slopes: Sequence[str] | None = (),
    slope_size: float = 1.0,
    threshold: float = DECISIVE,
    seed: int = 1,
) -> Forecast:
    """Forecast of tests (added to the pilot's own when ``augment``).

    Parameters
    ----------
    known : Known
        What is known before these tests.
    slopes : sequence of str
        Slopes to be decided on; empty for all, None for no decision.
    slope_size : float
        Size of the slopes for the decision between constant and linear [prior sd].
    threshold : float
        |ln B| called decisive [nat].
    seed : int
        Of the means drawn for truncated parameters.
    """
    bound = bind_tests(model, pilot, tests, keep=augment)
    scale, flat = bound.scale, model.prior.flat
    covariance, floor = _covariances(bound, known)
    if covariance is None:
        nothing = {p.name: Expected(p.unit, p.prior_sd, np.inf, np.inf, np.inf) for p in bound.parameters}
        return Forecast(nothing, np.inf, None)
    gaussian = scale * np.sqrt(np.einsum("kii->ki", covariance).mean(axis=0))
    inside = np.sqrt(narrowed(bound, known, covariance * np.outer(scale, scale), seed))
    expected = {
        p.name: Expected(p.unit, p.prior_sd, float(sd), float(plain), float(min(least, least * sd / plain)))
        for p, sd, plain, least in zip(bound.parameters, inside, gaussian, floor, strict=True)
    }
    gain = np.inf if flat else float(-0.5 * np.linalg.slogdet(covariance)[1].mean())
    decided = [i for i, p in enumerate(bound.parameters) if p.group == "slope" and (not slopes or p.name in slopes)]
    if flat or not decided or slopes is None:
        return Forecast(expected, gain, None)
    before = _slopes_before(known, decided, scale[decided]) if augment and not pilot.is_plan else None
    decision = discrimination_of(
        covariance[:, decided][:, :, decided],
        tuple(bound.names[i] for i in decided),
        size=slope_size,
        before=before,
        threshold=threshold,
        seed=seed,
    )
    return Forecast(expected, gain, decision)


def _covariances(bound: BoundModel, known: Known) -> tuple[Array | None, Array]:
    """Posterior covariances (K, p, p) in units of the prior sd, and floor sd (p,); None where flat priors leave one open."""
    covariances, floors = [], []
    for information in informations_of(bound, known.phi):
        own = information.own
        if information.flat and np.linalg.matrix_rank(information.rows()[:, own], tol=_RANK) < len(own):
            return None, np.zeros(0)
        covariances.append(information.covariance()[np.ix_(own, own)])
        floors.append(information.variances(times=_VERY_OFTEN))
    return np.array(covariances), bound.scale * np.sqrt(np.mean(floors, axis=0))


def _slopes_before(known: Known, decided: Sequence[int], unit: Array) -> tuple[Array, Array]:
    """Mean and covariance of some parameters after the tests already run, in these units."""
    return known.mean[:, decided] / unit, known.covariance[:, decided][:, :, decided] / np.outer(unit, unit)
