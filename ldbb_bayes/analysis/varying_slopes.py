"""Probabilities that compliances change with force, and averaged curves of the compliances.

A slope is the change of a compliance with force. Every compliance may have a slope or none, and
each subset of slopes defines a model, whose evidence is computed. Curves of compliance against
force are averaged over these models. If there are too many subsets, a search selects some of them.
The search starts with the subset without slopes and the subset with all slopes. Each step takes the
subset with the largest evidence that no earlier step has taken. It then adds all subsets that
differ from this subset in one slope.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.inference.coefficients import ModelDraws
from ldbb_bayes.inference.elastic_deflections import elastic_draws_with
from ldbb_bayes.inference.evidence import probabilities
from ldbb_bayes.inference.evidences import Evidences
from ldbb_bayes.inference.nodes import Nodes
from ldbb_bayes.inference.shared_draws import draw_with_shared
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.parameter_kinds import compliance_unit
from ldbb_bayes.results import Array, Numbers
from ldbb_bayes.units import ranked

__all__ = [
    "AveragedSlopes",
    "Curve",
    "SlopeSubset",
    "VaryingSlope",
    "averaged_curves",
    "count_subsets",
    "slope_subsets",
]

# ``_DRAWS`` is the number of posterior draws from which the curves of compliance against force are
# computed; ``_CURVE_POINTS`` is the number of forces at which each curve is computed.
_DRAWS = 4000
_CURVE_POINTS = 41
# To draw from the posterior of a model, values of the hyper-parameters are drawn first. At each
# value, the parameters are drawn ``_DRAWS_PER_NODE`` times, or fewer times if there would otherwise
# be fewer than ``_FEWEST_NODES`` values.
_DRAWS_PER_NODE = 8
_FEWEST_NODES = 64
# A subset of slopes states which compliances change with force. If at most ``_ALL_SUBSETS`` subsets
# are possible, the evidences of all subsets are computed; if more are possible, only the evidences
# of ``_SEARCHED_SUBSETS`` subsets.
_ALL_SUBSETS = 729
_SEARCHED_SUBSETS = 100

# Type of a subset of slopes. A subset has one entry for each slope of the full model; the entry is
# true if the slope belongs to the subset.
Choice = tuple[bool, ...]


@dataclass(frozen=True)
class SlopeSubset:
    """A model in which only the compliances ``varying`` change with force (have slopes)."""

    varying: tuple[str, ...]  #: names of the compliances that vary with force in the model
    #: log evidence of the model in which only the compliances ``varying`` vary with force [nat]
    log_evidence: float
    #: posterior probability of the model in which only the compliances ``varying`` vary with force
    probability: float


@dataclass(frozen=True)
class VaryingSlope:
    """Posterior probability that one compliance changes with force."""

    inclusion_probability: float


@dataclass(frozen=True, eq=False)
class Curve:
    """Compliance C(F) against force F, with credible intervals.

    The arrays ``mean``, ``median``, ``low`` and ``high`` have one value for each of the forces
    ``force_N`` [N], in the compliance's internal unit ``unit``, which is composed of mm, N and rad.
    ``low`` and ``high`` are the ends of the equal-tailed credible interval, and ``prob`` is the
    probability of this interval.
    """

    unit: str
    force_N: Numbers
    mean: Numbers
    median: Numbers
    low: Numbers
    high: Numbers
    prob: float


class AveragedSlopes(NamedTuple):
    """Probability that each compliance changes with force, and the curve of each compliance."""

    slopes: dict[str, VaryingSlope]  #: probability that each compliance changes with force
    #: models in which different subsets of the compliances change with force (have slopes), the
    #: most probable model first
    subsets: tuple[SlopeSubset, ...]
    #: curve of each compliance against force, averaged over models in which different subsets of
    #: the compliances change with force
    curves: dict[str, Curve]


def count_subsets(model: HybridModel, campaign: Campaign) -> int:
    """Return the number of models whose evidence `slope_subsets` computes.

    In each model, a different subset of the compliances changes with force.
    """
    possible = 2 ** len(_slope_names(model, campaign))
    if possible <= _ALL_SUBSETS:
        return possible
    return _SEARCHED_SUBSETS


def slope_subsets(
    model: HybridModel, evidences: Evidences, *, seed: int, prob: float = 0.95
) -> AveragedSlopes:
    """Compute the evidence of models with different slopes, and average over these models.

    In each model, some compliances have a slope, and all others are constant.

    Parameters
    ----------
    model : HybridModel
        Model in which every compliance may change linearly with force (degree 1).
    evidences : Evidences
        Evidences that have been computed before; new evidences are added to this object.
    seed : int
        Seed of the random draws from which the curves C(F) are computed.
    prob : float
        Probability of the credible intervals of the curves.

    Returns
    -------
    AveragedSlopes
        Probability of the slope of each compliance, probability of each subset of slopes, and the
        curve C(F) of each compliance, averaged over the subsets.
    """
    slope_names = _slope_names(model, evidences.campaign)

    def weigh(choice: Choice) -> Nodes:
        """Return the posterior and evidence of a model in which only some compliances have slopes.

        A slope is the change of a compliance with force. ``choice`` has one entry for each slope,
        true if the model has this slope.
        """
        fixed = [
            slope for slope, varies in zip(slope_names.values(), choice, strict=True) if not varies
        ]
        return evidences.nodes(model.fixing(*fixed))[0]

    if 2 ** len(slope_names) <= _ALL_SUBSETS:
        choices = itertools.product((False, True), repeat=len(slope_names))
        nodes_by_choice = {choice: weigh(choice) for choice in choices}
    else:
        nodes_by_choice = _best_first(len(slope_names), weigh)
    log_evidence = np.array([nodes.evidence.log_value for nodes in nodes_by_choice.values()])
    probability = probabilities(log_evidence)
    subsets = []
    for choice, value, share in zip(
        nodes_by_choice, log_evidence.tolist(), probability.tolist(), strict=True
    ):
        subsets.append(SlopeSubset(tuple(itertools.compress(slope_names, choice)), value, share))
    inclusion = (probability @ np.array(list(nodes_by_choice))).tolist()
    slopes = {}
    for name, share in zip(slope_names, inclusion, strict=True):
        slopes[name] = VaryingSlope(share)
    return AveragedSlopes(
        slopes,
        tuple(ranked(subsets, lambda subset: subset.probability)),
        averaged_curves(list(nodes_by_choice.values()), probability, seed, prob),
    )


def _slope_names(model: HybridModel, campaign: Campaign) -> dict[str, str]:
    """Return the name of each compliance's slope: ``C_XXX_1`` for ``C_XXX``."""
    names = {}
    for parameter in model.bind(campaign).parameters:
        if parameter.group == "slope":
            names[parameter.compliance] = parameter.name
    return names


def _best_first(slopes: int, weigh: Callable[[Choice], Nodes]) -> dict[Choice, Nodes]:
    """Search for the subsets of slopes with the largest evidence.

    The search starts from the subset without slopes and the subset of all slopes. Each step takes
    the subset with the largest evidence that no earlier step has taken, and tries all subsets that
    differ from it in one slope. The search ends after ``_SEARCHED_SUBSETS`` subsets, or when all
    subsets have been tried. Return, for every subset tried, the quadrature nodes of the posterior:
    weighted values of the hyper-parameters, with the evidence of the subset. ``weigh`` returns the
    nodes for a subset. ``slopes`` is the number of possible slopes.
    """
    weighed: dict[Choice, Nodes] = {}
    for choice in ((False,) * slopes, (True,) * slopes):
        weighed[choice] = weigh(choice)
    expanded: set[Choice] = set()

    def log_evidence(choice: Choice) -> float:
        """Return the log evidence of a model in which only some compliances have slopes [nat].

        A slope is the change of a compliance with force. ``choice`` has one entry for each slope,
        true if the model has this slope.
        """
        return weighed[choice].evidence.log_value

    while len(weighed) < _SEARCHED_SUBSETS and len(expanded) < len(weighed):
        best = max((choice for choice in weighed if choice not in expanded), key=log_evidence)
        expanded.add(best)
        for i in range(slopes):
            neighbour = (*best[:i], not best[i], *best[i + 1 :])
            if neighbour not in weighed and len(weighed) < _SEARCHED_SUBSETS:
                weighed[neighbour] = weigh(neighbour)
    return weighed


def averaged_curves(
    weighed: Sequence[Nodes], probability: Array, seed: int, prob: float
) -> dict[str, Curve]:
    """Return the curve C(F) of each compliance over the tested forces F, averaged over models.

    The result is a dict; its keys are names of compliances. Each curve is computed at 41 equally
    spaced forces, from the lowest to the highest force tested. If all tests were run at one force,
    each curve is computed at this force only.

    Parameters
    ----------
    weighed : sequence of Nodes
        Quadrature nodes (weighted values of the hyper-parameters) of each model's posterior.
    probability : ndarray, shape (models,)
        Posterior probabilities of the models.
    seed : int
        Seed of the random draws.
    prob : float
        Probability of the credible intervals of the curves.
    """
    rng = np.random.default_rng(seed)
    bound = weighed[0].bound
    tested = bound.campaign.forces_N
    forces = tested[:1]
    if np.ptp(tested) > 0:
        forces = np.linspace(tested.min(), tested.max(), _CURVE_POINTS)
    counts = np.floor(probability * _DRAWS + rng.random()).astype(int)
    draws = []
    for nodes, count in zip(weighed, counts, strict=True):
        if count:
            repeats = int(np.clip(count // _FEWEST_NODES, 1, _DRAWS_PER_NODE))
            free = nodes.integral.resample(math.ceil(count / repeats), rng)
            of_model = draw_with_shared(nodes.bound, free, repeats, rng)
            machine = ModelDraws(nodes.bound, of_model.phi, of_model.beta)
            curves_of_model = elastic_draws_with(of_model.shared, machine, (), forces).compliances
            draws.append(curves_of_model[:count])
    curves = np.concatenate(draws)
    levels = [0.5 - 0.5 * prob, 0.5, 0.5 + 0.5 * prob]
    low, median, high = np.quantile(curves, levels, axis=0)
    mean = curves.mean(axis=0)
    by_compliance = {}
    for j, name in enumerate(bound.compliances):
        by_compliance[name.label] = Curve(
            unit=compliance_unit(name),
            force_N=forces,
            mean=mean[:, j],
            median=median[:, j],
            low=low[:, j],
            high=high[:, j],
            prob=prob,
        )
    return by_compliance
