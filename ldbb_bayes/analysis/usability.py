"""Judgement of whether the results of a fit can be used, and the reasons for caution."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from ldbb_bayes.analysis.comparison import Comparison, Sign
from ldbb_bayes.analysis.verdicts import ParameterIdentifiability, Verdict
from ldbb_bayes.inference.fit import ConcernKind, Fit, State
from ldbb_bayes.results import Result

__all__ = [
    "Judgement",
    "Reason",
    "ReasonKind",
    "Use",
    "judge_certificate",
    "judge_fit",
    "undetermined_parameters",
]


# A parameter counts as hardly determined by the readings if its posterior standard deviation,
# divided by its prior standard deviation, is above a limit. The limit is placed between
# ``_LEAST_RATIO`` and ``_LARGEST_RATIO``, in the widest gap (on a logarithmic scale) between the
# ratios of the campaign's parameters. Parameters with nearly the same ratio are thus judged in the
# same way.
_LEAST_RATIO = 0.25
_LARGEST_RATIO = 0.4


class Use(StrEnum):
    """Whether the values on a test certificate can be used."""

    CAN_BE_USED = "can be used"
    WITH_RESERVATION = "can be used with reservation"
    DO_NOT_USE = "do not use"


class ReasonKind(StrEnum):
    """Kinds of reasons not to use values on a certificate, or to use them only with caution."""

    NOT_CONVERGED = "not-converged"
    MISFIT = "misfit"
    TRUNCATION = "truncation"
    UNIT = "unit"
    BALLS = "balls"
    ROUGH_WEIGHTS = "rough-weights"
    NOT_DETERMINED = "not-determined"
    PRIOR_SENSITIVE = "prior-sensitive"
    ZERO = "zero"
    HYPER = "hyper"
    FORCES = "forces"
    OPEN_SIGN = "open-sign"


@dataclass(frozen=True)
class Reason(Result):
    """Reason not to use values on a test certificate, or to use them only with caution."""

    kind: ReasonKind
    #: names of the parameters or tests to which the reason applies; empty if it applies to all
    #: values on the certificate
    names: tuple[str, ...] = ()
    #: names of the model terms or parameters whose effects the readings cannot distinguish from the
    #: effects of the parameters in ``names``
    partners: tuple[str, ...] = ()


@dataclass(frozen=True)
class Judgement(Result):
    """Whether the values on a test certificate can be used, and reasons against their use.

    The certificate is part of the report. The most serious of the ``reasons`` comes first.
    """

    use: Use
    reasons: tuple[Reason, ...] = ()


def undetermined_parameters(verdicts: Mapping[str, ParameterIdentifiability]) -> frozenset[str]:
    """Return the names of the parameters that the readings hardly determine.

    Parameters with the verdict "identified" (`Verdict`), or with a flat prior, count as determined.
    For each remaining parameter, a ratio is computed: the posterior standard deviation divided by
    the prior standard deviation. The readings hardly determine the parameter if this ratio is above
    a limit between 0.25 and 0.4. The limit lies in the widest gap between the ratios of the
    remaining parameters. Two parameters with nearly the same ratio are therefore judged in the same
    way.

    Parameters
    ----------
    verdicts : mapping of str to ParameterIdentifiability
        Verdict on each parameter (identified, prior-limited or confounded); the keys are names of
        parameters.

    Returns
    -------
    frozenset of str
        Names of the parameters.
    """
    ratios = {}
    for name, entry in verdicts.items():
        if entry.verdict != Verdict.IDENTIFIED and np.isfinite(entry.contraction):
            ratios[name] = float(np.sqrt(max(1.0 - entry.contraction, 0.0)))
    limit = _limit_in_widest_gap(list(ratios.values()))
    return frozenset(name for name, ratio in ratios.items() if ratio > limit)


def _limit_in_widest_gap(ratios: Sequence[float]) -> float:
    """Return the middle of the widest gap between ratios, on a logarithmic scale.

    A ratio is the posterior standard deviation of a parameter divided by its prior standard
    deviation. Only gaps between 0.25 and 0.4 are considered. The numbers 0.25 and 0.4 themselves
    count as ratios.
    """
    inside = sorted(ratio for ratio in ratios if _LEAST_RATIO < ratio < _LARGEST_RATIO)
    logarithms = np.log([_LEAST_RATIO, *inside, _LARGEST_RATIO])
    widest = int(np.diff(logarithms).argmax())
    return float(np.exp(0.5 * (logarithms[widest] + logarithms[widest + 1])))


def judge_certificate(
    fit: Fit,
    verdicts: Mapping[str, ParameterIdentifiability],
    stated: Collection[str],
    *,
    comparison: Comparison | None = None,
    rough_weights: bool = False,
) -> Judgement:
    """Return whether the values on a test certificate can be used, with reasons against their use.

    The values cannot be used if the sampler did not converge, the unit of the readings is in doubt,
    the readings do not fit the model, or the readings contradict the condition that compliances are
    not negative or the stated form of the balls. Otherwise, they can be used only with caution
    (``Use.WITH_RESERVATION``) in each of the following cases:

    - the readings hardly determine a parameter on the certificate;
    - a parameter on the certificate depends on the prior;
    - the standard deviation of the noise or of another effect is larger than its prior suggests;
    - the tests have too few different forces for the degree of the model;
    - the values are averages over models whose weights are not exact enough;
    - the result of the comparison depends on assumptions.

    Parameters
    ----------
    fit : Fit
        How well the model fits the readings.
    verdicts : mapping of str to ParameterIdentifiability
        Verdict on each parameter (identified, prior-limited or confounded); the keys are names of
        parameters.
    stated : collection of str
        Names of the parameters on the certificate.
    comparison : Comparison, optional
        Comparison of models, if the certificate states its result.
    rough_weights : bool
        Whether the values are averages over models, and the numerical error of a model's evidence
        may change its probability by more than `average` allows.
    """
    grave = _grave_reasons(fit)
    reservations = _reservations(fit, verdicts, stated)
    if rough_weights:
        reservations.append(Reason(ReasonKind.ROUGH_WEIGHTS))
    if comparison is not None and comparison.sign == Sign.OPEN:
        reservations.append(Reason(ReasonKind.OPEN_SIGN))
    use = Use.CAN_BE_USED
    if reservations:
        use = Use.WITH_RESERVATION
    if grave:
        use = Use.DO_NOT_USE
    return Judgement(use, (*grave, *reservations))


def judge_fit(fit: Fit) -> Judgement:
    """Return whether the results of a fit can be used, as far as the fit alone decides it.

    The reasons are those of `judge_certificate` that do not concern single parameters.
    """
    return judge_certificate(fit, verdicts={}, stated=())


def _grave_reasons(fit: Fit) -> list[Reason]:
    """Return the reasons why the values on a test certificate cannot be used."""
    reasons = []
    if fit.state == State.UNUSABLE:
        reasons.append(Reason(ReasonKind.NOT_CONVERGED))
    doubted = fit.names_of_concerns(ConcernKind.UNIT)
    if doubted:
        reasons.append(Reason(ReasonKind.UNIT, doubted))
    if fit.misfits:
        tests = dict.fromkeys(misfit.test for misfit in fit.misfits)
        reasons.append(Reason(ReasonKind.MISFIT, tuple(tests)))
    if _has_concern(fit, ConcernKind.TRUNCATION):
        reasons.append(Reason(ReasonKind.TRUNCATION))
    if _has_concern(fit, ConcernKind.BALLS):
        reasons.append(Reason(ReasonKind.BALLS))
    return reasons


def _reservations(
    fit: Fit, verdicts: Mapping[str, ParameterIdentifiability], stated: Collection[str]
) -> list[Reason]:
    """Return the reasons, found by the fit and the verdicts, to use a certificate with caution.

    A verdict on a parameter states how well the readings determine it. ``stated`` are the names of
    the parameters on the certificate.
    """
    reasons = []
    # Readings in a wrong unit have a wrong constant, too: the cure is to state their unit.
    if _has_concern(fit, ConcernKind.ZERO) and not _has_concern(fit, ConcernKind.UNIT):
        reasons.append(Reason(ReasonKind.ZERO))
    undetermined = []
    hardly_determined = undetermined_parameters(verdicts)
    for name, entry in verdicts.items():
        if name in stated and name in hardly_determined:
            undetermined.append(entry.name)
            reasons.append(Reason(ReasonKind.NOT_DETERMINED, (entry.name,), entry.partners))
    sensitive = [name for name in fit.sensitive if name in stated and name not in undetermined]
    if sensitive:
        reasons.append(Reason(ReasonKind.PRIOR_SENSITIVE, tuple(sensitive)))
    noisy = fit.names_of_concerns(ConcernKind.HYPER)
    if noisy:
        reasons.append(Reason(ReasonKind.HYPER, noisy))
    if _has_concern(fit, ConcernKind.FORCES):
        reasons.append(Reason(ReasonKind.FORCES))
    return reasons


def _has_concern(fit: Fit, kind: ConcernKind) -> bool:
    """Return whether one of the concerns about the fit is of the kind ``kind``."""
    return any(concern.kind == kind for concern in fit.concerns)
