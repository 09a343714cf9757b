"""Decision on conformity with a tolerance, by the rules of ISO 14253-1.

The probability of conformance is p = P(lower ≤ η ≤ upper | y) of JCGM 106, for a quantity η with
tolerance limits ``lower`` and ``upper``, given the readings y. The quantity conforms if p is at
least the confidence that the user asks for. It does not conform if 1 − p is at least this
confidence. In all other cases, no decision is made. For a normal posterior and one limit, a
quantity conforms if its estimate lies inside the limit, at least a guard band away from it.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from scipy.special import ndtri

from ldbb_bayes.analysis.tolerances import Tolerance
from ldbb_bayes.results import Result

__all__ = ["INTERVAL_LEVELS", "Conformity", "Decision", "Distribution", "decide"]

# Probabilities below the lower and the upper end of the equal-tailed 95 % credible intervals.
INTERVAL_LEVELS = (0.025, 0.975)


class Decision(StrEnum):
    """Decision on conformity with a tolerance by the rules of ISO 14253-1."""

    CONFORMS = "conforms"
    DOES_NOT_CONFORM = "does not conform"
    NOT_DECIDED = "not decided"


@dataclass(frozen=True)
class Conformity(Result):
    """Decision whether a quantity conforms with its tolerance.

    The unit ``unit`` of the quantity is composed of mm, N and rad. If a stiffness may be infinite,
    because its compliance may be zero, only the lower end of its 95 % interval is known: its value,
    mean, standard uncertainty, guard band and upper end are None.

    Examples
    --------
    >>> decisions = lb.assess_conformity(posterior, {"stiffness_X": "18 N/µm"})
    >>> stiffness = decisions["stiffness_X"]
    >>> stiffness.limits  # N/mm
    (18000.0, inf)
    >>> round(stiffness.probability, 1), stiffness.decision.value
    (0.6, 'not decided')
    """

    #: unit of the quantity that has the tolerance, and of its limits, mean, sd and guard band
    unit: str
    #: bar force for which the quantity that has the tolerance is computed [N]; None for geometric
    #: errors and changes of compliance with force, which do not depend on this force
    force_N: float | None
    lower: float | None  #: lower limit of the tolerance; None if it has no lower limit
    upper: float | None  #: upper limit of the tolerance; None if it has no upper limit
    #: value that tables and sheets state of the quantity that has the tolerance: the posterior
    #: median of a stiffness or of a ratio of stiffnesses, and otherwise the posterior mean; None
    #: for a stiffness that may be infinite
    value: float | None
    #: posterior mean of the quantity that has the tolerance; None for a stiffness that may be
    #: infinite
    mean: float | None
    #: standard uncertainty of the quantity that has the tolerance: its posterior standard
    #: deviation; None for a stiffness that may be infinite
    sd: float | None
    #: probability of conformance: the probability that the quantity lies between the limits of its
    #: tolerance
    probability: float
    #: guard band of ISO 14253-1 for a normally distributed quantity with a single tolerance limit.
    #: A decision is made if the estimate is at least this far from the limit. If the estimate meets
    #: the limit, the quantity conforms; otherwise it does not. None for a stiffness that may be
    #: infinite.
    guard_band: float | None
    #: minimum probability of conformance with the tolerance, or of non-conformance, at which a
    #: decision is made
    confidence: float
    #: decision on conformity of the quantity with its tolerance, by the rules of ISO 14253-1
    decision: Decision
    #: lower end of the equal-tailed 95 % credible interval of the quantity that has the tolerance;
    #: None if the quantity is a stiffness that is infinite in the whole interval
    ci_low: float | None
    #: upper end of the equal-tailed 95 % credible interval of the quantity that has the tolerance;
    #: None if it has no upper end, because the quantity is a stiffness and may be infinite
    ci_high: float | None
    #: numerical standard error of the probability of conformance, which is a share of posterior
    #: draws; zero if the probability is computed from a normal distribution
    probability_error: float = 0.0

    @property
    def limits(self) -> tuple[float, float]:
        """Lower and upper limit of the tolerance of a quantity; a missing limit is infinite."""
        return Tolerance(self.lower, self.upper).ends


class Distribution(NamedTuple):
    """Posterior mean, standard deviation and 95 % credible interval of a quantity."""

    mean: float | None  #: posterior mean of the quantity; None if it is not known
    #: posterior standard deviation of the quantity; None if it is not known
    sd: float | None
    #: lower end of the quantity's 95 % credible interval; None if the whole interval is infinite
    low: float | None
    #: upper end of the quantity's 95 % credible interval; None if it has no upper end
    high: float | None


def decide(
    unit: str,
    distribution: Distribution,
    tolerance: Tolerance,
    probability: float,
    confidence: float,
    force: float | None,
) -> Conformity:
    """Return the decision on conformity with a tolerance, for a given probability of conformance.

    ``probability`` is the probability of conformance, and ``confidence`` the minimum probability at
    which a decision is made. ``distribution`` is the posterior of the quantity, in ``unit``; its
    mean is also the value that is stated. ``force`` is the bar force for which the quantity is
    computed [N].
    """
    decision = Decision.NOT_DECIDED
    if probability <= 1.0 - confidence:
        decision = Decision.DOES_NOT_CONFORM
    elif probability >= confidence:
        decision = Decision.CONFORMS
    guard_band = None
    if distribution.sd is not None:
        guard_band = float(ndtri(confidence)) * distribution.sd
    return Conformity(
        unit=unit,
        force_N=force,
        lower=tolerance.lower,
        upper=tolerance.upper,
        value=distribution.mean,
        mean=distribution.mean,
        sd=distribution.sd,
        probability=probability,
        guard_band=guard_band,
        confidence=confidence,
        decision=decision,
        ci_low=distribution.low,
        ci_high=distribution.high,
    )
