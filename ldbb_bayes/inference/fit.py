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
    averaged_checks,
    centre_shift,
    effects,
    every_check,
    failing,
    predictive_checks,
)
from ldbb_bayes.inference.coefficients import (
    ModelDraws,
    pool_draws,
    shared_coefficients,
)
from ldbb_bayes.inference.diagnostics import power_sensitivity
from ldbb_bayes.inference.residuals import quality_of
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array, Finite, Result
from ldbb_bayes.units import ranked

__all__ = ["Concern", "ConcernKind", "Fit", "State", "fit_of_parts"]


_SENSITIVE = 0.05


_MOVED = 0.5


_WIDER = 0.1


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
    #: Of tests with an order of the circle that is not expected: the largest change of a parameter in its u when the test is left
    #: out; not of flat priors.
    shift: dict[str, float]
    #: By which share an interval grows at most with noise as strong as what tests do not share at the orders 13 to 16, where the
    #: checks of noise and of its autocorrelation fail.
    widening: float

    @property
    def checks(self) -> list[Check]:
        """Posterior predictive checks, the smallest p first."""
        return every_check(self.predictive_checks)

    @property
    def unexpected(self) -> tuple[Check, ...]:
        """Checks that fail at 1 % after allowing for their number (Bonferroni), worst first."""
        return failing(self.checks)

    @property
    def misfits(self) -> tuple[Check, ...]:
        """Those for which intervals would move: by half a u without the test, or by a tenth of
        their width."""

        def moves(own: Check) -> bool:
            return (
                self.shift.get(own.test, np.inf) > _MOVED
                if own.kind == CheckKind.ORDER
                else self.widening > _WIDER
            )

        return tuple(filter(moves, self.unexpected))

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of concerns and of checks that fail, each once."""
        return tuple(
            dict.fromkeys(
                [str(found.kind) for found in self.concerns]
                + [str(check.kind) for check in self.misfits]
            )
        )

    @property
    def state(self) -> State:
        """Unusable: not converged. Doubtful: readings that the model does not expect, or against
        non-negative compliance."""
        kinds = {concern.kind for concern in self.concerns}
        if ConcernKind.NOT_CONVERGED in kinds:
            return State.UNUSABLE
        return State.DOUBTFUL if self.misfits or ConcernKind.TRUNCATION in kinds else State.USABLE

    @property
    def sensitive(self) -> tuple[str, ...]:
        """Parameters whose posterior moves with the prior (power-scaling sensitivity above 0.05),
        most first."""
        found = [name for name in self.parameters if self.sensitivity[name]["prior"] > _SENSITIVE]
        return tuple(ranked(found, lambda name: self.sensitivity[name]["prior"]))

    @property
    def parameters(self) -> tuple[str, ...]:
        """Those of ``sensitivity`` but for the hyper-parameters."""
        return tuple(name for name in self.sensitivity if name.startswith(("C_", "E_")))


_QUALITY_DRAWS = 1000


_CHECKED_DRAWS = 500


_IMPROBABLE = float(np.log(1e-3))


_EXTREME = 0.999


_FAR = 3.0


_CLOSE = 0.05


def fit_of_parts(
    bound: BoundModel,
    parts: Sequence[ModelDraws],
    groups: Mapping[str, Mapping[str, Array]],
    truncation: tuple[float, float],
    missed: Sequence[Concern],
    rng: np.random.Generator,
    prior_level: Array | float = 0.0,
) -> Fit:
    """How well models fit whose draws, part by part, are those of ``groups``; ``bound`` has all
    their parameters, ``prior_level`` is the mean of ln p(β) in the prior of each draw's model: what
    scaling the prior must not count."""
    share = np.array([len(part.phi) for part in parts]) / sum(len(part.phi) for part in parts)
    few, thinned = (
        [part.thinned(int(np.ceil(own * most))) for own, part in zip(share, parts, strict=True)]
        for most in (_QUALITY_DRAWS, _CHECKED_DRAWS)
    )
    predicted = [shared_coefficients(*part).mean(axis=0) for part in few]
    quality = quality_of(bound, np.tensordot(share, predicted, axes=1))
    group = groups["posterior"]
    beta, phi = (
        np.stack([group[str(name)] for name in names], axis=-1)
        for names in (bound.names, bound.hyper_prior.names)
    )
    flat_beta, flat_phi = pool_draws(beta, phi)
    prior = groups["log_prior"]["parameters"]
    hyper_prior = groups["log_prior"]["hyper"]
    jacobian = bound.hyper_prior.log_density_of_free(bound.hyper_prior.free(phi)) - hyper_prior
    likelihood = groups["sample_stats"]["lp"] - prior - hyper_prior - jacobian
    checks = averaged_checks(share, [predictive_checks(*own, rng) for own in thinned])
    scaled = {"prior": prior - prior_level, "hyper_prior": hyper_prior, "likelihood": likelihood}
    return Fit(
        quality.rmse_um,
        quality.fitness_percent,
        *truncation,
        bound.log_prob_truncation_prior,
        bound.largest_linearisation_error_mm(flat_beta.mean(axis=0)) * 1e3,
        (*missed, *_concerns(bound, flat_phi, flat_beta, truncation[0])),
        checks,
        power_sensitivity(group, scaled),
        *effects(bound, flat_phi.mean(axis=0), checks),
    )


def _concerns(
    bound: BoundModel, phi: Array, beta: Array, log_prob_truncation: float
) -> Iterator[Concern]:
    if log_prob_truncation < _IMPROBABLE:
        yield Concern(ConcernKind.TRUNCATION, log_prob_truncation, _IMPROBABLE)
    levels = bound.campaign.force_levels
    needed = bound.model.degree + 2
    if levels < needed:
        yield Concern(ConcernKind.FORCES, levels, needed)
    limit = bound.hyper_prior.quantile(np.full(phi.shape[1], _EXTREME))
    sizes = zip(
        bound.hyper_prior.names, np.median(phi, axis=0), limit, bound.hyper_prior.in_mm, strict=True
    )
    for name, median, top, is_length in sizes:
        if is_length and median > top:
            yield Concern(ConcernKind.HYPER, float(median), float(top), str(name))
    moved = np.abs(beta.mean(axis=0) - bound.prior_mean)
    variance = bound.prior_sd**2
    stated = {
        *bound.model.prior.overrides,
        *bound.model.prior.means,
    }  # the data move a mean by a draw of N(0, sd0² − u²)
    for name, z in zip(
        bound.names,
        moved / np.sqrt(np.maximum(variance - beta.var(axis=0), _CLOSE * variance)),
        strict=True,
    ):
        if z > _FAR and name in stated:
            yield Concern(ConcernKind.PRIOR, float(z), _FAR, name)
    for axis, p in centre_shift(bound, beta.mean(axis=0)).items():
        yield Concern(ConcernKind.CENTRE, p, SHIFTED, axis)
