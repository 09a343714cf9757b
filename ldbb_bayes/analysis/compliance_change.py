"""Change of each compliance C(F) from the smallest to the largest tested force.

This change may have two parts. One part is described by slopes such as C_XXX_1 (coefficients of the
force), the other by the term `JointLoad` (nonlinear deflection of joints under load).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr

from ldbb_bayes.errors import check_probability
from ldbb_bayes.inference.force_curves import CurveDraws, ForceCurves, force_curves
from ldbb_bayes.inference.summary import interval_numbers
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, ByName, Result

__all__ = ["ChangeWithForce", "DrawnValue", "change_with_force"]

# Differences of probabilities are rounded to this number of decimals, so that a difference which is
# zero apart from rounding errors becomes exactly zero. True differences are much larger, because
# each probability is a share of the posterior draws.
_DECIMALS_OF_PROBABILITY = 12
# An interval of the changes that are not zero is stated only if at least this many draws have one.
_FEWEST_CHANGES = 20


@dataclass(frozen=True)
class DrawnValue(Result):
    """The mean, sd, median and credible interval of a compliance or of its change with force."""

    mean: float  #: posterior mean
    sd: float  #: posterior standard deviation
    median: float  #: posterior median
    ci_low: float  #: lower end of the equal-tailed credible interval
    ci_high: float  #: upper end of the equal-tailed credible interval

    @property
    def interval(self) -> tuple[float, float]:
        """Lower and upper end of the credible interval."""
        return self.ci_low, self.ci_high


@dataclass(frozen=True)
class ChangeWithForce(Result):
    """Change of one compliance C(F) over the tested forces F, in units composed of mm, N and rad.

    C(F) of a direct compliance is the deflection along an axis, divided by a bar force F along the
    same axis. C(F) depends on three quantities: the compliance at the reference force F0, its
    slopes (coefficients of powers of F − F0), and the coefficients of the term `JointLoad`
    (nonlinear deflection of joints under load).

    Examples
    --------
    >>> change = lb.analysis.change_with_force(posterior)["C_YYY"]
    >>> change.smallest_force_N, change.largest_force_N
    (36.0, 742.0)
    >>> change.change.ci_low < change.change.mean < change.change.ci_high
    True
    """

    #: unit of a compliance, composed of mm, N and rad, such as mm/N; the change of the compliance
    #: over the tested forces has the same unit
    unit: str
    #: probability of the credible intervals of a compliance and of its change with force
    prob: float
    smallest_force_N: float  #: smallest force tested, F_min [N]
    reference_force_N: float  #: reference force of the model, F0 [N]
    largest_force_N: float  #: largest force tested, F_max [N]
    at_smallest: DrawnValue  #: compliance C(F_min) at the smallest force tested
    at_reference: DrawnValue  #: compliance C(F0) at the reference force
    at_largest: DrawnValue  #: compliance C(F_max) at the largest force tested
    change: DrawnValue  #: change of the compliance, C(F_max) − C(F_min)
    #: change of the compliance, divided by the compliance C(F0) at the reference force. The ratio
    #: has no unit; it is None if the credible interval of C(F0) contains zero.
    relative: DrawnValue | None
    #: probability that the compliance is larger at the largest force tested, F_max, than at the
    #: smallest, F_min
    probability_of_increase: float
    #: probability that the compliance is smaller at the largest force tested, F_max, than at the
    #: smallest, F_min. In an average over models, the compliance may be constant under some models.
    #: The probabilities of increase and decrease then sum to less than one.
    probability_of_decrease: float
    #: change of the compliance, C(F_max) − C(F_min), given that it is not exactly zero. None if all
    #: models have a change, or if too few posterior draws have one.
    if_any: DrawnValue | None

    @property
    def probability_of_no_change(self) -> float:
        """Probability that a compliance does not change at all with force.

        In an average over models, this is the probability of the models in which the compliance is
        constant. For a single model, it is zero: `change_with_force` returns only compliances that
        change with force in the model.
        """
        remaining = 1.0 - self.probability_of_increase - self.probability_of_decrease
        return max(round(remaining, _DECIMALS_OF_PROBABILITY), 0.0)


@one_blas_thread
def change_with_force(posterior: xr.DataTree, *, prob: float = 0.95) -> dict[str, ChangeWithForce]:
    """Return how much each compliance C(F) changes from the smallest tested force to the largest.

    All results are computed from posterior draws of the curve C(F). Each draw gives the compliance
    at both forces. If the posterior is an average over models, draws of models with constant
    compliance are included, with a change of zero.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample`, `load` or `average`.
    prob : float
        Probability of the equal-tailed credible intervals, between 0 and 1.

    Returns
    -------
    dict of str to ChangeWithForce
        Change of every compliance that has a slope or depends on the term `JointLoad`. The keys are
        names of compliances, such as ``C_XXX``. The result is empty if there is no such compliance,
        or if all tests have the same force.

    Raises
    ------
    InputError
        For a probability that is not between 0 and 1, or a posterior from `to_units`.

    Examples
    --------
    >>> changes = lb.analysis.change_with_force(posterior)
    >>> list(changes)
    ['C_XXX', 'C_XYX', 'C_YYY', 'C_CXY', 'C_CYY', 'C_CCY']
    >>> change = changes["C_XXX"]
    >>> round(change.probability_of_increase + change.probability_of_decrease)
    1
    """
    check_probability(prob)
    curves = force_curves(posterior)
    changes = ByName[ChangeWithForce]()
    for name, draws in curves.compliances.items():
        changes[name] = _change_of(curves, draws, prob)
    return changes


def _change_of(curves: ForceCurves, draws: CurveDraws, prob: float) -> ChangeWithForce:
    """Return the change of one compliance C(F) with the force F, computed from posterior draws.

    ``draws`` holds draws of C(F) at the smallest, the reference and the largest force. ``prob`` is
    the probability of the credible intervals.
    """
    at_reference = _summary_of(draws.at_reference, prob)
    relative = None
    if at_reference.ci_low > 0.0 or at_reference.ci_high < 0.0:
        relative = _summary_of(draws.change / draws.at_reference, prob)
    return ChangeWithForce(
        unit=draws.unit,
        prob=prob,
        smallest_force_N=curves.smallest_force_N,
        reference_force_N=curves.reference_force_N,
        largest_force_N=curves.largest_force_N,
        at_smallest=_summary_of(draws.at_smallest, prob),
        at_reference=at_reference,
        at_largest=_summary_of(draws.at_largest, prob),
        change=_summary_of(draws.change, prob),
        relative=relative,
        probability_of_increase=float(np.mean(draws.change > 0.0)),
        probability_of_decrease=float(np.mean(draws.change < 0.0)),
        if_any=_change_if_any(draws.change, prob),
    )


def _change_if_any(change: Array, prob: float) -> DrawnValue | None:
    """Return the summary of those draws of a change that are not exactly zero.

    ``change``, shape (draws,), holds posterior draws of the change of a compliance with force. The
    result is None if no draw is zero, or if too few draws are not zero. ``prob`` is the probability
    of the credible interval.
    """
    changed = change[change != 0.0]
    if len(changed) == len(change) or len(changed) < _FEWEST_CHANGES:
        return None
    return _summary_of(changed, prob)


def _summary_of(draws: Array, prob: float) -> DrawnValue:
    """Return the mean, sd, median and credible interval of posterior draws.

    ``draws``, shape (draws,), are draws of a compliance or of its change with force. ``prob`` is
    the probability of the equal-tailed credible interval.
    """
    return DrawnValue(**interval_numbers(draws, prob))
