"""How well a model fits, and what to mind before its numbers are used."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from ldbb_bayes.inference.checks import (
    SHIFTED,
    Check,
    CheckKind,
    TestChecks,
    all_checks,
    average_checks,
    centre_shift,
    check_predictions,
    effects_of_failures,
    failing_checks,
)
from ldbb_bayes.inference.coefficients import ModelDraws, pool_draws, shared_coefficients
from ldbb_bayes.inference.diagnostics import power_sensitivity
from ldbb_bayes.inference.residuals import FitQuality, quality_of
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array, Finite, Result
from ldbb_bayes.units import ranked

__all__ = ["Concern", "ConcernKind", "Fit", "State", "assess_fit"]

# Power-scaling sensitivity above which a posterior moves with the prior (Kallioinen et al. 2023).
_SENSITIVE = 0.05
# A failing check matters where leaving its test out changes a parameter by more than so many u ...
_LARGEST_SHIFT = 0.5
# ... or where the noise it finds widens an interval by more than this share.
_LARGEST_WIDENING = 0.1
# Draws by which the quality of the fit is computed.
_QUALITY_DRAWS = 1000
# Draws by which the posterior predictive checks are computed.
_CHECKED_DRAWS = 500
# ln P(T | y) below which the readings speak against non-negative compliance.
_IMPROBABLE = float(np.log(1e-3))
# Prior probability below which a hyper-parameter is expected.
_EXPECTED_HYPER = 0.999
# A mean farther from its stated prior mean, in sd of what the prior expects, is a concern.
_LARGEST_PRIOR_DISTANCE = 3.0
# Share of the prior variance that the data are taken to explain at least.
_SMALLEST_VARIANCE_SHARE = 0.05


class State(StrEnum):
    """Whether the numbers of a fit can be used: not at all where the sampler missed its target."""

    USABLE = "usable"
    DOUBTFUL = "doubtful"
    UNUSABLE = "unusable"


class ConcernKind(StrEnum):
    """What a fit has to say besides its numbers."""

    NOT_CONVERGED = "not-converged"
    TRUNCATION = "truncation"
    FORCES = "forces"
    HYPER = "hyper"
    CENTRE = "centre"
    PRIOR = "prior"


@dataclass(frozen=True)
class Concern(Result):
    """One thing to mind, with ``value`` and ``limit``.

    NOT_CONVERGED: steps, and the ESS they were to reach. TRUNCATION: ln P(T | y), and the least
    expected. FORCES: force levels, and how many the degree needs. HYPER: median [mm] of the
    hyper-parameter ``name``, and its prior's quantile at 99.9 %. CENTRE: the p-value of no shift of
    the circle's centre along the axis ``name`` in proportion to force. PRIOR: distance of the mean
    of the parameter ``name`` from its stated prior mean, and the largest expected, in sd of what
    the prior lets one expect.
    """

    kind: ConcernKind
    value: float
    limit: float
    name: str = ""


@dataclass(frozen=True)
class Fit(Result):
    """How well a model fits, and what to mind."""

    rmse_um: float  #: Eq. 34 over all readings
    #: Eq. 35, by test; not a number where its readings are all the same
    fitness_percent: dict[str, float]
    log_prob_truncation: float  #: ln P(T | y) of the untruncated posterior
    log_prob_truncation_error: Finite  #: [nat]
    log_prob_truncation_prior: float  #: ln P(T) of the prior
    linearisation_error_um: float  #: largest difference of the linear model from the exact geometry
    concerns: tuple[Concern, ...]
    predictive_checks: dict[str, TestChecks]
    #: by power-scaling of prior, hyper_prior and likelihood, of each parameter
    sensitivity: dict[str, dict[str, float]]
    #: Of tests with an order of the circle that is not expected: the largest change of a parameter,
    #: in its u, when the test is left out; not of flat priors.
    shift: dict[str, float]
    #: By which share an interval grows at most with noise as strong as what tests do not share at
    #: the orders 13 to 16, where the checks of noise and of its autocorrelation fail.
    widening: float

    @property
    def checks(self) -> list[Check]:
        """Return the posterior predictive checks, the smallest p first."""
        return all_checks(self.predictive_checks)

    @property
    def unexpected(self) -> tuple[Check, ...]:
        """Return the checks that fail at 1 %, allowing for their number, worst first."""
        return failing_checks(self.checks)

    @property
    def misfits(self) -> tuple[Check, ...]:
        """Return the failing checks for which intervals would move.

        By half a u without the test, or by a tenth of their width.
        """
        return tuple(check for check in self.unexpected if self._moves_intervals(check))

    def _moves_intervals(self, check: Check) -> bool:
        if check.kind == CheckKind.ORDER:
            return self.shift.get(check.test, np.inf) > _LARGEST_SHIFT
        return self.widening > _LARGEST_WIDENING

    @property
    def kinds(self) -> tuple[str, ...]:
        """Return the kinds of concerns and of checks that fail, each once."""
        concerns = [str(concern.kind) for concern in self.concerns]
        misfits = [str(check.kind) for check in self.misfits]
        return tuple(dict.fromkeys(concerns + misfits))

    @property
    def state(self) -> State:
        """Return whether the numbers can be used.

        Unusable: not converged. Doubtful: readings that the model does not expect, or against
        non-negative compliance.
        """
        kinds = {concern.kind for concern in self.concerns}
        if ConcernKind.NOT_CONVERGED in kinds:
            return State.UNUSABLE
        if self.misfits or ConcernKind.TRUNCATION in kinds:
            return State.DOUBTFUL
        return State.USABLE

    @property
    def sensitive(self) -> tuple[str, ...]:
        """Return the parameters whose posterior moves with the prior, the most sensitive first.

        Their power-scaling sensitivity is above 0.05.
        """
        names = [name for name in self.parameters if self._prior_sensitivity(name) > _SENSITIVE]
        return tuple(ranked(names, self._prior_sensitivity))

    def _prior_sensitivity(self, name: str) -> float:
        return self.sensitivity[name]["prior"]

    @property
    def parameters(self) -> tuple[str, ...]:
        """Return the names in ``sensitivity`` but for the hyper-parameters."""
        return tuple(name for name in self.sensitivity if name.startswith(("C_", "E_")))


def assess_fit(
    bound: BoundModel,
    draws_by_model: Sequence[ModelDraws],
    groups: Mapping[str, Mapping[str, Array]],
    truncation: tuple[float, float],
    concerns: Sequence[Concern],
    rng: np.random.Generator,
    prior_level: Array | float = 0.0,
) -> Fit:
    """Return how well one model or several fit.

    Parameters
    ----------
    bound : BoundModel
        With the parameters of all models.
    draws_by_model : sequence of ModelDraws
        The draws of ``groups``, model by model.
    groups : mapping
        Groups posterior, log_prior and sample_stats of the tree.
    truncation : pair
        ln P(T | y) and its error.
    concerns : sequence of Concern
        Of the sampler.
    rng : Generator
    prior_level : float or array
        Mean of ln p(β) in the prior of each draw's model, which scaling the prior must not count.

    Returns
    -------
    Fit
    """
    sizes = np.array([len(draws.phi) for draws in draws_by_model])
    shares = sizes / sizes.sum()
    quality = _quality(bound, draws_by_model, shares)
    checks = _average_checks(draws_by_model, shares, rng)
    posterior = groups["posterior"]
    beta, phi = pool_draws(
        _stack(posterior, bound.names), _stack(posterior, bound.hyper_prior.names)
    )
    log_prob_truncation, log_prob_truncation_error = truncation
    linearisation_error_mm = bound.largest_linearisation_error_mm(beta.mean(axis=0))
    of_posterior = _concerns(bound, phi, beta, log_prob_truncation)
    shift, widening = effects_of_failures(bound, phi.mean(axis=0), checks)
    return Fit(
        rmse_um=quality.rmse_um,
        fitness_percent=quality.fitness_percent,
        log_prob_truncation=log_prob_truncation,
        log_prob_truncation_error=log_prob_truncation_error,
        log_prob_truncation_prior=bound.log_prob_truncation_prior,
        linearisation_error_um=linearisation_error_mm * 1e3,
        concerns=(*concerns, *of_posterior),
        predictive_checks=checks,
        sensitivity=power_sensitivity(posterior, _log_densities(bound, groups, prior_level)),
        shift=shift,
        widening=widening,
    )


def _quality(bound: BoundModel, draws_by_model: Sequence[ModelDraws], shares: Array) -> FitQuality:
    """Return the quality of the mean prediction of all models."""
    predictions = []
    for share, draws in zip(shares, draws_by_model, strict=True):
        thinned = draws.thinned(int(np.ceil(share * _QUALITY_DRAWS)))
        predictions.append(
            shared_coefficients(thinned.bound, thinned.phi, thinned.beta).mean(axis=0)
        )
    return quality_of(bound, np.tensordot(shares, predictions, axes=1))


def _average_checks(
    draws_by_model: Sequence[ModelDraws], shares: Array, rng: np.random.Generator
) -> dict[str, TestChecks]:
    """Return the posterior predictive checks, averaged over models."""
    checks = []
    for share, draws in zip(shares, draws_by_model, strict=True):
        thinned = draws.thinned(int(np.ceil(share * _CHECKED_DRAWS)))
        checks.append(check_predictions(thinned.bound, thinned.phi, thinned.beta, rng))
    return average_checks(shares, checks)


def _stack(group: Mapping[str, Array], names: Sequence[str]) -> Array:
    """Return variables side by side, shape (chains, draws, variables)."""
    return np.stack([group[str(name)] for name in names], axis=-1)


def _log_densities(
    bound: BoundModel, groups: Mapping[str, Mapping[str, Array]], prior_level: Array | float
) -> dict[str, Array]:
    """Return the log densities that power-scaling scales, each (chains, draws)."""
    phi = _stack(groups["posterior"], bound.hyper_prior.names)
    log_prior = groups["log_prior"]["parameters"]
    log_hyper_prior = groups["log_prior"]["hyper"]
    free = bound.hyper_prior.free(phi)
    log_jacobian = bound.hyper_prior.log_density_of_free(free) - log_hyper_prior
    log_posterior = groups["sample_stats"]["lp"]
    return {
        "prior": log_prior - prior_level,
        "hyper_prior": log_hyper_prior,
        "likelihood": log_posterior - log_prior - log_hyper_prior - log_jacobian,
    }


def _concerns(
    bound: BoundModel, phi: Array, beta: Array, log_prob_truncation: float
) -> Iterator[Concern]:
    """Yield what to mind of a posterior, from draws of φ (n, h) [mm] and β (n, p)."""
    if log_prob_truncation < _IMPROBABLE:
        yield Concern(ConcernKind.TRUNCATION, log_prob_truncation, _IMPROBABLE)
    levels = bound.campaign.force_levels
    needed = bound.model.degree + 2
    if levels < needed:
        yield Concern(ConcernKind.FORCES, levels, needed)
    yield from _large_hyper_parameters(bound, phi)
    yield from _distant_means(bound, beta)
    for axis, p in centre_shift(bound, beta.mean(axis=0)).items():
        yield Concern(ConcernKind.CENTRE, p, SHIFTED, axis)


def _large_hyper_parameters(bound: BoundModel, phi: Array) -> Iterator[Concern]:
    """Yield the hyper-parameters whose median is beyond their prior."""
    prior = bound.hyper_prior
    limits = prior.quantile(np.full(phi.shape[1], _EXPECTED_HYPER))
    medians = np.median(phi, axis=0)
    for name, median, limit, is_length in zip(
        prior.names, medians, limits, prior.in_mm, strict=True
    ):
        if is_length and median > limit:
            yield Concern(ConcernKind.HYPER, float(median), float(limit), str(name))


def _distant_means(bound: BoundModel, beta: Array) -> Iterator[Concern]:
    """Yield the parameters whose mean is far from their stated prior mean."""
    stated = {*bound.model.prior.overrides, *bound.model.prior.means}
    prior_variance = bound.prior_sd**2
    # By the prior, the data move a mean by a draw of N(0, sd0² − u²).
    expected_variance = np.maximum(
        prior_variance - beta.var(axis=0), _SMALLEST_VARIANCE_SHARE * prior_variance
    )
    distance = np.abs(beta.mean(axis=0) - bound.prior_mean) / np.sqrt(expected_variance)
    for name, z in zip(bound.names, distance, strict=True):
        if z > _LARGEST_PRIOR_DISTANCE and name in stated:
            yield Concern(ConcernKind.PRIOR, float(z), _LARGEST_PRIOR_DISTANCE, name)
