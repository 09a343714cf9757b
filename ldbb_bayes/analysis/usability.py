"""Whether the numbers of a certificate can be used, and the reasons against it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from ldbb_bayes.analysis.verdicts import ParameterIdentifiability, Verdict
from ldbb_bayes.inference.fit import ConcernKind, Fit, State
from ldbb_bayes.results import Result

__all__ = ["Judgement", "Reason", "ReasonKind", "Use", "is_determined", "state_of"]

if TYPE_CHECKING:
    from ldbb_bayes.analysis.comparison import Comparison


_HARDLY = 0.9


class Use(StrEnum):
    """Whether the numbers of a certificate can be used."""

    CAN_BE_USED = "can be used"
    WITH_RESERVATION = "can be used with reservation"
    DO_NOT_USE = "do not use"


class ReasonKind(StrEnum):
    """Why not, or why not without reservation."""

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
    """One reason: the parameters or tests it is about, and of those not determined what they are
    confounded with."""

    kind: ReasonKind
    names: tuple[str, ...] = ()
    partners: tuple[str, ...] = ()


@dataclass(frozen=True)
class Judgement(Result):
    """Whether the numbers can be used, and all reasons against it, the gravest first."""

    use: Use
    reasons: tuple[Reason, ...] = ()


def is_determined(entry: ParameterIdentifiability) -> bool:
    """Whether the readings determine a parameter: identified, or its u at most a third of what the
    prior says."""
    return entry.verdict == Verdict.IDENTIFIED or not entry.contraction < _HARDLY


def state_of(
    fit: Fit,
    verdicts: Mapping[str, ParameterIdentifiability],
    stated: Collection[str],
    *,
    comparison: Comparison | None = None,
) -> Judgement:
    """Say whether the numbers of a certificate can be used.

    Not: where the sampler missed its target, the model does not expect the readings, or these
    contradict non-negative compliance. With reservation: where what is ``stated`` (parameters) is
    hardly determined by the readings, rests on the prior, noise is above what its prior expects,
    forces are too few for the degree, or the answer of ``comparison`` hangs on assumptions.
    """
    concerns = {own.kind: own for own in reversed(fit.concerns)}
    grave = []
    if fit.state == State.UNUSABLE:
        grave.append(Reason(ReasonKind.NOT_CONVERGED))
    if fit.misfits:
        grave.append(
            Reason(ReasonKind.MISFIT, tuple(dict.fromkeys(own.test for own in fit.misfits)))
        )
    if ConcernKind.TRUNCATION in concerns:
        grave.append(Reason(ReasonKind.TRUNCATION))
    weak = [own for name, own in verdicts.items() if name in stated and not is_determined(own)]
    minor = [Reason(ReasonKind.NOT_DETERMINED, (own.name,), own.partners) for own in weak]
    sensitive = tuple(
        name for name in fit.sensitive if name in stated and name not in {own.name for own in weak}
    )
    minor += [Reason(ReasonKind.PRIOR_SENSITIVE, sensitive)] if sensitive else []
    names = tuple(own.name for own in fit.concerns if own.kind == ConcernKind.HYPER)
    minor += [Reason(ReasonKind.HYPER, names)] if names else []
    minor += [Reason(ReasonKind.FORCES)] if ConcernKind.FORCES in concerns else []
    if comparison is not None:
        from ldbb_bayes.analysis.comparison import (
            Sign,
        )  # commands that compare nothing start without it

        minor += [] if comparison.within_tolerance else [Reason(ReasonKind.ROUGH_EVIDENCE)]
        minor += [Reason(ReasonKind.OPEN_SIGN)] if comparison.sign == Sign.OPEN else []
    use = Use.DO_NOT_USE if grave else Use.WITH_RESERVATION if minor else Use.CAN_BE_USED
    return Judgement(use, (*grave, *minor))
