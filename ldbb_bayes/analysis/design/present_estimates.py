"""Present estimates of the parameters: what the circles run so far say, before any further circle.

The choice of the next circle and the search for the cheapest campaign start from these estimates.
The model of both includes every effect that the planned circles can show. If they may run in both
directions, for example, the size of hysteresis is unknown, and U is larger than the U of a fit of
the circles run so far.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ldbb_bayes.analysis.nested_models import averaged_sds
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.inference.evidences import Evidences
from ldbb_bayes.inference.nodes import Nodes
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.model.terms import Columns
from ldbb_bayes.results import Array

__all__ = [
    "EVIDENCE_TOLERANCE",
    "PRESENT_DRAWS",
    "FittedSds",
    "PresentEstimates",
    "averaged_sds_now",
    "has_effects_of_fit",
    "present_estimates",
    "sds_of_fit",
]

# Largest numerical error allowed for the log evidence of a model [nat]. The error is small compared
# with the log Bayes factor of 3 nat that a decision with 95 % probability needs.
EVIDENCE_TOLERANCE = 0.2
# Number of posterior draws of the parameters: for the probability that a goal in percent is met.
PRESENT_DRAWS = 1024
# Largest number of values of the hyper-parameters, such as the standard deviation of the noise,
# over which posterior means and standard deviations are averaged.
_COMPONENTS = 1024
# Number of quasi-random points from which, for each value of the hyper-parameters, moments are
# computed under the condition that no compliance is negative. With 4096 points, means change by at
# most 0.02 standard deviations, and standard deviations by at most 0.2 %.
_POINTS_INSIDE = 256
# Number of values over which uncertainties are averaged that are averaged over models too, and the
# seed with which these values are drawn.
_AVERAGED_VALUES = 128
_SEED = 1


class PresentEstimates(NamedTuple):
    """Posterior means and standard deviations of p parameters, in units of mm, N and rad."""

    mean: Array  # posterior means, shape (p,)
    sd: Array  # posterior standard deviations, shape (p,)


def present_estimates(nodes: Nodes) -> PresentEstimates:
    """Return the posterior means and standard deviations of the parameters.

    ``nodes`` are weighted values of the hyper-parameters, from which the posterior is computed.
    """
    mean, sd = nodes.moments(points=_POINTS_INSIDE, components=_COMPONENTS)
    return PresentEstimates(mean, sd)


class FittedSds(NamedTuple):
    """Standard uncertainties that analyses of the circles run so far state, without any others.

    The keys of both dictionaries are names of parameters.
    """

    #: those of a fit; empty if a design of further circles states the same
    of_fit: dict[str, float]
    #: those of the average over constant and linear compliance, as the sheets of a report state
    #: them; empty if there is nothing to average
    averaged: dict[str, float]


def sds_of_fit(model: HybridModel, evidences: Evidences, nodes: Nodes) -> FittedSds:
    """Return the standard uncertainties that analyses of the circles run so far state.

    ``model`` is the model, and ``evidences`` are of the circles run so far. ``nodes`` represent the
    posterior under the model that a design uses for the same circles. This model may have further
    effects, such as hysteresis if further circles may run in both directions.
    """
    if has_effects_of_fit(model, evidences.campaign, nodes.bound):
        return FittedSds({}, averaged_sds_now(nodes))
    nodes_of_fit = evidences.nodes(model)[0]
    sds = present_estimates(nodes_of_fit).sd.tolist()
    of_fit = dict(zip(nodes_of_fit.bound.names, sds, strict=True))
    return FittedSds(of_fit, averaged_sds_now(nodes_of_fit))


def averaged_sds_now(nodes: Nodes) -> dict[str, float]:
    """Return standard uncertainties that are averaged over constant and linear compliance.

    ``nodes`` are weighted values of the hyper-parameters, from which the posterior of the model
    with linear compliance is computed. See `averaged_sds`.
    """
    bound = nodes.bound
    free = nodes.integral.resample(_AVERAGED_VALUES, np.random.default_rng(_SEED))
    phi = bound.hyper_prior.phi(free)
    return averaged_sds(bound, phi, truncated=bound.truncation.active)


def has_effects_of_fit(model: HybridModel, campaign: Campaign, bound: BoundModel) -> bool:
    """Return whether a design's model has the effects of a fit, and no others.

    The fit is that of ``model`` to ``campaign``, the circles run so far. ``bound`` is the model
    that a design uses for the same circles. It has other effects, such as hysteresis that changes
    sign, if only further circles can show them.
    """
    return _effects(model.bind(campaign)) == _effects(bound)


def _effects(bound: BoundModel) -> list[str]:
    """Return the names of the effects in a model, and of its parameters and hyper-parameters."""
    names = [*bound.names, *bound.hyper_prior.names]
    for effect in bound.nuisance_columns:
        if isinstance(effect, Columns):
            names += effect.names
    return names
