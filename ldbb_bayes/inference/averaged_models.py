"""Posterior draws of an average over several models, split into the draws of each model.

Every draw of an averaged posterior comes from one of the models. The share of draws that come from
a model estimates the posterior probability of this model. In the draws that come from a model, only
the parameters that this model has differ from zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ldbb_bayes.inference.posterior import bound_of, draws_of, record_of
from ldbb_bayes.inference.posterior_cache import cached_by_posterior
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array

__all__ = ["AveragedModel", "averaged_models"]


@dataclass(frozen=True, eq=False)
class AveragedModel:
    """One of the models over which a posterior is averaged, with the draws that come from it.

    The average has p parameters: all parameters that occur in at least one of the averaged models.
    """

    #: fraction of the draws of an averaged posterior that come from one of the models; it estimates
    #: the posterior probability of this model
    probability: float
    bound: BoundModel  #: one of the averaged models, applied to the campaign
    #: indices of the model's parameters among the p parameters of all averaged models
    parameter_indices: NDArray[np.intp]
    #: n posterior draws that come from this model: values of the p parameters, shape (n, p). The p
    #: parameters are those of all averaged models; the parameters that this model lacks are zero.
    beta: Array
    #: n posterior draws that come from this model: values of the h hyper-parameters (such as the
    #: standard deviation of the noise), shape (n, h); values that are lengths are in mm
    phi: Array

    @cached_property
    def mean(self) -> Array:
        """Posterior means of p parameters under this model alone, shape (p,).

        The p parameters are those of all averaged models. Parameters that this model lacks have the
        mean zero.
        """
        return np.asarray(self.beta.mean(axis=0))

    @cached_property
    def sd(self) -> Array:
        """Posterior standard deviations of p parameters under this model alone, shape (p,).

        The p parameters are those of all averaged models. Parameters that this model lacks have the
        standard deviation zero.
        """
        return np.asarray(self.beta.std(axis=0))


@cached_by_posterior
def averaged_models(posterior: xr.DataTree) -> list[AveragedModel]:
    """Return the models over which a posterior is averaged, each with its posterior draws.

    The list has one item if the posterior is of a single model. Averaged models without any draw
    are left out.

    In the average, a parameter has the mean Σ p_m mean_m and the variance Σ p_m (var_m + (mean_m −
    mean)²). p_m is the share of model m among the draws; mean_m and var_m are mean and variance of
    the parameter in the draws of model m.
    """
    bound = bound_of(posterior)
    beta, phi = draws_of(posterior, bound)
    averaged = record_of(posterior).get("averaged")
    if averaged is None:
        return [AveragedModel(1.0, bound, np.arange(len(bound.names)), beta, phi)]
    model_of_draw = np.asarray(posterior["sample_stats"]["model"]).ravel()
    models = []
    for index, description in enumerate(averaged["models"]):
        is_drawn = model_of_draw == index
        if not is_drawn.any():
            continue
        parameter_indices = np.flatnonzero(beta[is_drawn].any(axis=0))
        models.append(
            AveragedModel(
                probability=float(is_drawn.mean()),
                bound=_bound_of_model(bound, parameter_indices, description["rivals"]),
                parameter_indices=parameter_indices,
                beta=beta[is_drawn],
                phi=phi[is_drawn],
            )
        )
    return models


def _bound_of_model(
    largest: BoundModel, parameter_indices: NDArray[np.intp], rivals: Sequence[str]
) -> BoundModel:
    """Return one of the averaged models, applied to the readings of a campaign.

    ``largest`` is the model with the parameters of all averaged models. ``parameter_indices``
    holds, for each parameter of the returned model, its index among the parameters of ``largest``.
    ``rivals`` are the names of the alternative explanations that the returned model contains.
    Alternative explanations are effects that look like a change of compliance with force.
    """
    present = {largest.names[index] for index in parameter_indices}
    absent = [name for name in largest.names if name not in present]
    model = largest.model.fixing(*absent).with_rivals(*rivals)
    return model.bind(largest.campaign)
