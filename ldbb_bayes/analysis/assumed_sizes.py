"""Effects with assumed standard uncertainties, and the parameters that depend on them most.

A standard uncertainty is called assumed if it is neither measured in the campaign nor stated by a
certificate or by the user.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ldbb_bayes.analysis.budgets import Budget, Contribution
from ldbb_bayes.analysis.origins import Origin
from ldbb_bayes.model.terms.columns import PARAMETERS
from ldbb_bayes.results import Result
from ldbb_bayes.units import ranked

__all__ = ["AssumedSize", "DecidingAssumption", "deciding_assumptions"]

# A parameter is said to depend on an effect with an assumed standard uncertainty if the effect
# causes at least this fraction of the parameter's variance.
_DECIDING_SHARE = 0.05
# The prior standard deviations of two coefficients are treated as equal if the larger divided by
# the smaller is below this number.
_SAME_SIZE = 1.0 + 1e-9


@dataclass(frozen=True)
class AssumedSize:
    """Largest prior standard deviation of those coefficients of a model term that share a unit.

    The coefficients of a model term may have different units, such as mm and rad. There is one
    object for each unit.
    """

    source: str  #: name of the coefficient or noise whose prior standard deviation is ``sd``
    sd: float  #: prior standard deviation of the coefficient or noise ``source``
    #: internal unit of ``sd``, which is composed of mm, N and rad
    unit: str
    #: whether another coefficient of the same model term, in the same unit, has a smaller prior
    #: standard deviation
    differs: bool


@dataclass(frozen=True)
class DecidingAssumption(Result):
    """An effect with an assumed standard uncertainty, and the parameter that depends on it most."""

    #: class name of the model term, such as ``Mount``, whose standard uncertainty is assumed
    term: str
    #: name of the parameter in whose variance the model term ``term`` has the largest share
    parameter: str
    #: share of the variance of ``parameter`` that the model term ``term`` causes
    share: float
    #: largest prior standard deviation of the coefficients of the model term ``term``, one entry
    #: for each unit in which the term has coefficients
    sizes: tuple[AssumedSize, ...]


def deciding_assumptions(
    budgets: Mapping[str, Budget], origin: Origin = Origin.ASSUMED
) -> tuple[DecidingAssumption, ...]:
    """Return the effects that matter for a parameter although their size is only assumed.

    An effect is a model term, such as the deflection of the mount. The standard uncertainty of its
    coefficients is assumed if it is neither measured in this campaign nor stated by a certificate
    or by the user. An effect is returned if it causes at least 5 % of the variance of at least one
    parameter. The priors of the parameters do not count as effects.

    Parameters
    ----------
    budgets
        Uncertainty budgets by parameter, from `budget_uncertainty`.
    origin
        If ``stated``, return the effects whose size a certificate or the user states, by the same
        rule.

    Returns
    -------
    tuple of DecidingAssumption
        One entry for each effect. The effect with the largest share of a parameter's variance comes
        first.
    """
    lines_by_term: dict[str, list[Contribution]] = {}
    shares: dict[str, dict[str, float]] = {}
    for name, budget in budgets.items():
        for line in budget.contributions:
            if line.origin == origin and line.term != PARAMETERS:
                lines_by_term.setdefault(line.term, []).append(line)
                of_term = shares.setdefault(line.term, {})
                of_term[name] = of_term.get(name, 0.0) + line.share
    assumptions = []
    for term, lines in lines_by_term.items():
        parameter = ranked(shares[term], shares[term].__getitem__)[0]
        share = shares[term][parameter]
        if share >= _DECIDING_SHARE:
            assumptions.append(DecidingAssumption(term, parameter, share, _largest_sizes(lines)))
    return tuple(ranked(assumptions, lambda assumption: assumption.share))


def _largest_sizes(lines: list[Contribution]) -> tuple[AssumedSize, ...]:
    """Return the largest prior standard deviation of an effect's coefficients, one for each unit.

    An effect is a model term, such as the deflection of the mount. Its coefficients may have
    different units. ``lines`` are the lines of the effect in the uncertainty budgets of the
    parameters. A line for one coefficient states the prior standard deviation of the coefficient. A
    line for several coefficients states no standard deviation, and is left out.
    """
    by_unit: dict[str, dict[str, float]] = {}
    for line in lines:
        if line.u is not None:
            by_unit.setdefault(line.unit, {})[line.source] = line.u
    sizes = []
    for unit, sd_by_source in by_unit.items():
        source = ranked(sd_by_source, sd_by_source.__getitem__)[0]
        largest = sd_by_source[source]
        differs = min(sd_by_source.values()) * _SAME_SIZE < largest
        sizes.append(AssumedSize(source, largest, unit, differs))
    return tuple(sizes)
