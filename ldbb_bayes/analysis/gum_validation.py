"""Validation of the GUM's law of propagation of uncertainty by the posterior (JCGM 101, section 8).

y is the estimate of a parameter, u its standard uncertainty and k the coverage factor. The law of
propagation gives the interval y ± k u. It assumes a linear model, in which the scales of the noise
and of other effects (the hyper-parameters φ) are known. JCGM 101 propagates distributions instead.
In this module, the distribution is the posterior, in which φ is unknown. If the model requires
compliances that are not negative, the posterior satisfies this condition.

The law of propagation and the posterior each give a coverage interval. The two intervals agree if
the distance between their lower endpoints, and the distance between their upper endpoints, are both
at most the numerical tolerance δ. The tolerance depends on the number n of significant digits of u
that are regarded as meaningful: u, rounded to n digits, is a whole number times 10^l, and δ = 10^l
/ 2 (JCGM 101, 7.9.2 and 8.1). Here u is the posterior standard deviation. If the two intervals do
not agree, JCGM 101 requires the interval of the distribution to be stated.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtri

from ldbb_bayes.errors import check_probability, require
from ldbb_bayes.inference.averaged_models import AveragedModel, averaged_models
from ldbb_bayes.inference.marginal_mixtures import marginal_mixtures
from ldbb_bayes.inference.posterior import bound_of, draws_of
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import ByName, Result

if TYPE_CHECKING:
    import xarray as xr

__all__ = [
    "GumComparison",
    "GumValidation",
    "agreeing_digits",
    "numerical_tolerance",
    "validate_gum",
]

# Largest number of significant digits of the standard uncertainty that may be regarded as
# meaningful.
_MOST_DIGITS = 2
# Largest numerical error allowed for the endpoints of the posterior's coverage interval, as a
# fraction of the numerical tolerance δ (JCGM 101, 8.2).
_SHARE_OF_TOLERANCE = 0.2
# The numerical error of an endpoint of the posterior's coverage interval is this number times the
# standard error of the endpoint, as in JCGM 101, 7.9.4.
_STANDARD_ERRORS = 2.0


@dataclass(frozen=True)
class GumComparison(Result):
    """Coverage intervals of one parameter by the GUM's law of propagation and by JCGM 101.

    The interval by JCGM 101 is computed from the posterior distribution of the parameter.

    Examples
    --------
    >>> entry = lb.analysis.validate_gum(posterior).parameters["C_YYY"]
    >>> entry.gum_low < entry.gum_estimate < entry.gum_high, entry.low < entry.mean < entry.high
    (True, True)
    """

    #: unit of the parameter, in which all fields of this comparison except ``digits`` are stated
    unit: str
    #: estimate y of the parameter by the linear model, in which the hyper-parameters (for example
    #: the standard deviation of the noise) are fixed at their posterior means
    gum_estimate: float
    #: standard uncertainty u of the parameter's estimate ``gum_estimate``, by the GUM's law of
    #: propagation
    gum_u: float
    #: lower endpoint y − k u of the parameter's coverage interval by the GUM's law of propagation
    gum_low: float
    #: upper endpoint y + k u of the parameter's coverage interval by the GUM's law of propagation
    gum_high: float
    mean: float  #: mean of the parameter's posterior distribution
    sd: float  #: standard deviation of the parameter's posterior distribution
    #: lower endpoint of the equal-tailed interval of the parameter's posterior distribution
    low: float
    #: upper endpoint of the equal-tailed interval of the parameter's posterior distribution
    high: float
    #: numerical error of ``low`` and ``high``, the endpoints of the posterior interval. They are
    #: computed from random draws; the error is twice the larger of their two standard errors.
    error: float
    #: numerical tolerance δ of JCGM 101, computed from ``GumValidation.digits`` and ``sd``. The two
    #: coverage intervals (computed with the GUM's law of propagation and from the posterior) agree
    #: if their endpoints differ by at most this value.
    tolerance: float
    #: largest number n of significant digits of the standard uncertainty ``sd``, from 0 to 2, such
    #: that the two coverage intervals (computed with the GUM's law of propagation and from the
    #: posterior) agree within the numerical tolerance that follows from n (JCGM 101, 7.9.2). 0 if
    #: they do not agree even for n = 1.
    digits: int

    @property
    def d_low(self) -> float:
        """Distance between the lower endpoints of the parameter's two coverage intervals.

        ``gum_low`` is the lower endpoint computed with the GUM's law of propagation of uncertainty,
        and ``low`` is the lower endpoint computed from the posterior.
        """
        return abs(self.gum_low - self.low)

    @property
    def d_high(self) -> float:
        """Distance between the upper endpoints of the parameter's two coverage intervals.

        ``gum_high`` is the upper endpoint computed with the GUM's law of propagation of
        uncertainty, and ``high`` is the upper endpoint computed from the posterior.
        """
        return abs(self.gum_high - self.high)

    @property
    def validated(self) -> bool:
        """Whether the parameter's two coverage intervals agree.

        One interval is computed with the GUM's law of propagation of uncertainty, the other from
        the posterior. They agree if their endpoints differ by at most the numerical ``tolerance``.
        The differences are ``d_low`` and ``d_high``. If the intervals agree, the GUM's interval may
        be used.
        """
        return max(self.d_low, self.d_high) <= self.tolerance

    @property
    def decided(self) -> bool:
        """Whether the numerical error is small enough to decide whether the two intervals agree.

        The intervals are the coverage intervals computed with the GUM's law of propagation and from
        the posterior. The error is small enough if it is at most a fifth of the tolerance, as JCGM
        101, 8.2, requires. A larger error is accepted if it cannot change ``validated``. This is
        the case if the error is at most the difference between the tolerance and the larger of
        ``d_low`` and ``d_high``.
        """
        distance = abs(max(self.d_low, self.d_high) - self.tolerance)
        return self.error <= max(_SHARE_OF_TOLERANCE * self.tolerance, distance)


@dataclass(frozen=True, eq=False)
class GumValidation(Result):
    """Comparison of the GUM's law of propagation with the posterior, for every parameter.

    Examples
    --------
    >>> validation = lb.analysis.validate_gum(posterior)
    >>> entry = validation.parameters["C_YYY"]
    >>> validation.digits, entry.digits <= 2
    (2, True)
    """

    prob: float  #: coverage probability of the coverage intervals of the parameters
    #: number of significant digits of a parameter's standard uncertainty that are regarded as
    #: meaningful (JCGM 101)
    digits: int
    #: posterior probability of the model to which the law of propagation is applied; 1 unless the
    #: posterior is an average over models
    probability_of_model: float
    #: comparison of two coverage intervals for each parameter: one computed with the law of
    #: propagation, and one computed from the posterior. The keys are the names of the parameters.
    parameters: dict[str, GumComparison]

    @property
    def validated(self) -> tuple[str, ...]:
        """Names of the parameters for which the GUM's and the posterior's intervals agree."""
        return tuple(name for name, entry in self.parameters.items() if entry.validated)

    @property
    def not_validated(self) -> tuple[str, ...]:
        """Names of the parameters for which the GUM's and the posterior's intervals disagree."""
        return tuple(name for name, entry in self.parameters.items() if not entry.validated)


@one_blas_thread
def validate_gum(
    posterior: xr.DataTree, *, prob: float = 0.95, digits: int = _MOST_DIGITS
) -> GumValidation:
    """Compare the GUM's linear propagation with the posterior, as in JCGM 101, section 8.

    The law of propagation is applied to the linear model, in which compliances may be negative. The
    hyper-parameters (for example the standard deviation of the noise) are fixed at their posterior
    means, as in uncertainty budgets. The interval is y ± k u, with the coverage factor k of a
    normal distribution. For an average over models, the law is applied to the most probable model,
    because the law needs a single model.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample`, `load` or `average`.
    prob : float
        Probability of the intervals, between 0 and 1.
    digits : {1, 2}
        Number of significant digits of the standard uncertainty that are regarded as meaningful. It
        sets the numerical tolerance for the agreement of the two intervals.

    Returns
    -------
    GumValidation
        Comparison for every parameter of the model to which the law is applied, in mm, N and rad.

    Raises
    ------
    InputError
        For a probability that is not between 0 and 1, or a number of digits other than 1 or 2.

    Examples
    --------
    >>> entry = lb.analysis.validate_gum(posterior, digits=1).parameters["C_YYY"]
    >>> entry.unit, entry.tolerance  # half a unit of the only digit of u
    ('mm/N', 5e-07)
    """
    check_probability(prob)
    require(
        digits in range(1, _MOST_DIGITS + 1),
        f"digits must be 1 or 2, got {digits}. Uncertainties are stated with two.",
    )
    model = _most_probable(averaged_models(posterior))
    tail = 0.5 - 0.5 * prob
    levels = np.array([tail, 1.0 - tail])
    mixtures = marginal_mixtures(posterior)
    bound = bound_of(posterior)
    beta, _ = draws_of(posterior, bound)
    mean = beta.mean(axis=0)
    sd = beta.std(axis=0, ddof=1)
    low, high = mixtures.quantiles(levels)
    errors = _STANDARD_ERRORS * mixtures.quantile_errors(levels).max(axis=0)
    linear = model.bound.given(model.phi.mean(axis=0)[None]).parameters
    expanded = float(ndtri(1.0 - tail)) * linear.sd[0]
    parameters = bound.parameters
    comparisons = ByName[GumComparison]()
    for row, place in enumerate(model.parameter_indices.tolist()):
        estimate = linear.mean[0, row]
        gum_low = estimate - expanded[row]
        gum_high = estimate + expanded[row]
        distance = max(abs(gum_low - low[place]), abs(gum_high - high[place]))
        comparisons[parameters[place].name] = GumComparison(
            unit=parameters[place].unit,
            gum_estimate=float(estimate),
            gum_u=float(linear.sd[0, row]),
            gum_low=float(gum_low),
            gum_high=float(gum_high),
            mean=float(mean[place]),
            sd=float(sd[place]),
            low=float(low[place]),
            high=float(high[place]),
            error=float(errors[place]),
            tolerance=numerical_tolerance(float(sd[place]), digits),
            digits=agreeing_digits(float(distance), float(sd[place])),
        )
    return GumValidation(prob, digits, model.probability, comparisons)


def _most_probable(models: list[AveragedModel]) -> AveragedModel:
    """Return the most probable model of a model average.

    If several models are equally probable, the first of them is returned.
    """
    probabilities = [model.probability for model in models]
    return models[int(np.argmax(probabilities))]


def numerical_tolerance(u: float, digits: int) -> float:
    """Return the numerical tolerance δ of a standard uncertainty u.

    Rounded to ``digits`` significant digits, u is a whole number times 10^l; δ is half of 10^l
    (JCGM 101, 7.9.2). The tolerance is zero if u is zero.
    """
    if u == 0.0:
        return 0.0
    exponent = int(f"{u:.{digits - 1}e}".partition("e")[2])
    return float(f"5e{exponent - digits}")


def agreeing_digits(distance: float, u: float) -> int:
    """Return the largest number of significant digits, at most two, for which two intervals agree.

    The digits are those of the standard uncertainty ``u``. For each number of digits, there is a
    tolerance (`numerical_tolerance`). The intervals agree if ``distance`` is at most this
    tolerance. ``distance`` is the larger of two distances: between the lower endpoints of the
    intervals, and between their upper endpoints. If the intervals do not agree even for one digit,
    the result is zero.
    """
    for digits in range(_MOST_DIGITS, 0, -1):
        if distance <= numerical_tolerance(u, digits):
            return digits
    return 0
