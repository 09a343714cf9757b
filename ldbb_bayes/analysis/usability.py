"""Judgement whether the values on a certificate can be used, with reasons against their use."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from enum import StrEnum

from ldbb_bayes.analysis.comparison import Comparison, Sign
from ldbb_bayes.analysis.verdicts import ParameterIdentifiability, Verdict
from ldbb_bayes.inference.fit import ConcernKind, Fit, State
from ldbb_bayes.results import Result

__all__ = ["Judgement", "Reason", "ReasonKind", "Use", "is_determined", "state_of"]


# Readings y hardly determine a parameter β whose contraction 1 − Var(β | y) / Var(β) is below this:
# its standard uncertainty is then more than about a third of its prior standard deviation.
_HARDLY_DETERMINED = 0.9


class Use(StrEnum):
    """Whether the values on a certificate can be used."""

    CAN_BE_USED = "can be used"
    WITH_RESERVATION = "can be used with reservation"
    DO_NOT_USE = "do not use"


class ReasonKind(StrEnum):
    """Kind of reason against the use of the values on a certificate."""

    NOT_CONVERGED = "not-converged"
    MISFIT = "misfit"
    TRUNCATION = "truncation"
    ROUGH_EVIDENCE = "rough-evidence"
    NOT_DETERMINED = "not-determined"
    PRIOR_SENSITIVE = "prior-sensitive"
    HYPER = "hyper"
    FORCES = "forces"
    OPEN_SIGN = "open-sign"


@dataclass(frozen=True)
class Reason(Result):
    """One reason why values on a certificate cannot be used, or only with reservation."""

    kind: ReasonKind
    names: tuple[str, ...] = ()  #: names of the parameters or tests that the reason is about
    #: model terms or parameters that the readings cannot distinguish from the parameters in
    #: ``names``
    partners: tuple[str, ...] = ()


@dataclass(frozen=True)
class Judgement(Result):
    """Judgement whether the values on a certificate can be used.

    ``reasons`` are all reasons against their use, the gravest first.
    """

    use: Use
    reasons: tuple[Reason, ...] = ()


def is_determined(entry: ParameterIdentifiability) -> bool:
    """Return whether the readings determine a parameter.

    They do so if its verdict is identified, or if its posterior standard deviation is at most about
    a third of its prior standard deviation. For a flat prior they always do.
    """
    return entry.verdict == Verdict.IDENTIFIED or not entry.contraction < _HARDLY_DETERMINED


def state_of(
    fit: Fit,
    verdicts: Mapping[str, ParameterIdentifiability],
    stated: Collection[str],
    *,
    comparison: Comparison | None = None,
) -> Judgement:
    """Return whether the values on a certificate can be used, with reasons against their use.

    The values cannot be used if the sampler missed its target, the readings do not fit the model,
    or the readings speak against non-negative compliances. Otherwise, they can be used with
    reservation if one of these holds: the readings hardly determine a stated parameter; a result
    depends on the prior; the noise, or the scale of another effect, is larger than its prior
    expects; the tests have too few different forces for the degree of the model; the evidences of
    the compared models are not precise enough; or the result of the comparison depends on
    assumptions.

    Parameters
    ----------
    fit : Fit
        How well the model fits the readings.
    verdicts : mapping of str to ParameterIdentifiability
        Verdict on each parameter, by name.
    stated : collection of str
        Names of the parameters on the certificate.
    comparison : Comparison, optional
        Comparison of models, where the certificate states one.
    """
    grave = _grave_reasons(fit)
    reservations = _reservations(fit, verdicts, stated)
    if comparison is not None:
        reservations += _reservations_of_comparison(comparison)
    use = Use.CAN_BE_USED
    if reservations:
        use = Use.WITH_RESERVATION
    if grave:
        use = Use.DO_NOT_USE
    return Judgement(use, (*grave, *reservations))


def _grave_reasons(fit: Fit) -> list[Reason]:
    """Return the reasons why the values on a certificate cannot be used."""
    reasons = []
    if fit.state == State.UNUSABLE:
        reasons.append(Reason(ReasonKind.NOT_CONVERGED))
    if fit.misfits:
        tests = dict.fromkeys(misfit.test for misfit in fit.misfits)
        reasons.append(Reason(ReasonKind.MISFIT, tuple(tests)))
    if _has_concern(fit, ConcernKind.TRUNCATION):
        reasons.append(Reason(ReasonKind.TRUNCATION))
    return reasons


def _reservations(
    fit: Fit, verdicts: Mapping[str, ParameterIdentifiability], stated: Collection[str]
) -> list[Reason]:
    """Return the reasons for reservation that come from the fit and from the verdicts.

    ``stated`` are the names of the parameters on the certificate.
    """
    reasons = []
    undetermined = []
    for name, entry in verdicts.items():
        if name in stated and not is_determined(entry):
            undetermined.append(entry.name)
            reasons.append(Reason(ReasonKind.NOT_DETERMINED, (entry.name,), entry.partners))
    sensitive = [name for name in fit.sensitive if name in stated and name not in undetermined]
    if sensitive:
        reasons.append(Reason(ReasonKind.PRIOR_SENSITIVE, tuple(sensitive)))
    noisy = [concern.name for concern in fit.concerns if concern.kind == ConcernKind.HYPER]
    if noisy:
        reasons.append(Reason(ReasonKind.HYPER, tuple(noisy)))
    if _has_concern(fit, ConcernKind.FORCES):
        reasons.append(Reason(ReasonKind.FORCES))
    return reasons


def _reservations_of_comparison(comparison: Comparison) -> list[Reason]:
    """Return the reasons for reservation that come from a comparison of models."""
    reasons = []
    if not comparison.within_tolerance:
        reasons.append(Reason(ReasonKind.ROUGH_EVIDENCE))
    if comparison.sign == Sign.OPEN:
        reasons.append(Reason(ReasonKind.OPEN_SIGN))
    return reasons


def _has_concern(fit: Fit, kind: ConcernKind) -> bool:
    return any(concern.kind == kind for concern in fit.concerns)
