"""Parameters in which two campaigns differ, one by one and with all comparisons allowed for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ldbb_bayes.analysis.multiple_testing import holm
from ldbb_bayes.errors import check_probability, require
from ldbb_bayes.results import Result
from ldbb_bayes.units import is_slope

if TYPE_CHECKING:
    from collections.abc import Mapping

    import pandas as pd

__all__ = [
    "LARGEST_P_OF_CONFLICT",
    "ChangedParameters",
    "changed_parameters",
    "differences_can_be_used",
]

# Two campaigns with the same instrument or machine have two estimates of each effect that they have
# in common. The campaigns are in conflict if the p-value of the largest disagreement, which allows
# for the number of comparisons, is below this value.
LARGEST_P_OF_CONFLICT = 0.01


@dataclass(frozen=True)
class ChangedParameters(Result):
    """Parameters in which two campaigns differ; slopes (changes with force) are not compared.

    Examples
    --------
    >>> changed = lb.analysis.ChangedParameters(("C_XXX", "C_YYY"), ("C_XXX",), 11)
    >>> changed.together
    ('C_XXX',)
    """

    #: names of parameters whose difference has a credible interval without zero, each parameter
    #: considered by itself
    alone: tuple[str, ...]
    #: names of those that also differ if all comparisons are considered together
    together: tuple[str, ...]
    #: number of parameters compared
    compared: int


def changed_parameters(table: pd.DataFrame, prob: float) -> ChangedParameters:
    """Return the parameters in which two campaigns differ.

    If many parameters are compared, some intervals exclude zero by chance. The parameters in
    ``together`` are therefore chosen by Holm's method: if nothing has changed, the probability that
    one or more of them are named is at most 1 − ``prob``.

    Parameters
    ----------
    table : DataFrame
        Differences of all parameters, from `compare_posteriors`.
    prob : float
        Probability of the equal-tailed intervals, between 0 and 1.

    Returns
    -------
    ChangedParameters
        Names of the parameters, in the order of the table.

    Raises
    ------
    InputError
        For a probability that is not between 0 and 1. Also if the differences cannot be used, so
        that no changes can be named: the campaigns disagree about what they should have in common,
        readings contradict a prior, or the results of one of the two fits cannot be used.

    Examples
    --------
    >>> softer = model.simulate(campaign, seed=2, parameters={"C_XXX": 150e-6}).campaign
    >>> before = lb.sample(model, campaign, sampler="independent", seed=1)
    >>> after = lb.sample(model, softer, sampler="independent", seed=1)
    >>> table = lb.analysis.compare_posteriors(before, after)
    >>> "C_XXX" in lb.analysis.changed_parameters(table, 0.95).together
    True
    """
    check_probability(prob)
    require(
        differences_can_be_used(table.attrs),
        "differences must be usable to name changes, got two campaigns that disagree about what"
        " they should have in common, or a fit that cannot be used. See conflict,"
        " contradicted_priors and fits in the table's attrs.",
    )
    names = [str(name) for name in table.index if not is_slope(str(name))]
    increase = table.loc[names, "probability_of_increase"].to_numpy(dtype=float)
    p_alone = 2.0 * np.minimum(increase, 1.0 - increase)
    p_together = holm(p_alone)
    alone = [name for name, p_value in zip(names, p_alone, strict=True) if p_value < 1.0 - prob]
    together = []
    for name, p_value in zip(names, p_together, strict=True):
        if p_value < 1.0 - prob:
            together.append(name)
    return ChangedParameters(tuple(alone), tuple(together), len(names))


def differences_can_be_used(attributes: Mapping[Any, Any]) -> bool:
    """Return whether the differences between two campaigns can be used.

    They cannot be used, and no changes are named, in each of the following cases:

    - the campaigns disagree about an effect that they should have in common (``conflict``);
    - readings contradict a prior of their model (``contradicted_priors``);
    - the results of one of the two fits cannot be used (``fits``).

    Parameters
    ----------
    attributes : mapping
        Attributes of the table of differences (`compare_posteriors`). Those that are missing say
        nothing against the differences.
    """
    conflict = attributes.get("conflict")
    if conflict is not None and conflict[1] < LARGEST_P_OF_CONFLICT:
        return False
    if any(attributes.get("contradicted_priors", ())):
        return False
    return all(fit.is_usable for fit in attributes.get("fits", ()))
