"""The single models of a posterior that is averaged over models, each with its own draws.

Every draw of an averaged posterior comes from one of the models. The share of the draws that come
from a model is its posterior probability. The draws of a model are zero for a parameter that the
model lacks, and for no other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ldbb_bayes.inference.posterior import bound_of, draws_of, record_of
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array

__all__ = ["AveragedModel", "averaged_models"]


@dataclass(frozen=True, eq=False)
class AveragedModel:
    """One of the models that a posterior is averaged over, with its share of the draws.

    The average has p parameters: all those of its models.
    """

    #: share of the model's draws among all draws: its posterior probability, rounded
    probability: float
    bound: BoundModel  #: the model, applied to the campaign
    places: NDArray[np.intp]  #: indices of the model's parameters among those of the average
    #: draws of all p parameters of the average, shape (n, p); those that the model lacks are zero
    beta: Array
    #: draws of the h hyper-parameters (scales of the noise and of other effects), shape (n, h);
    #: lengths are in mm
    phi: Array

    @cached_property
    def mean(self) -> Array:
        """Mean of the p parameters under this model, shape (p,)."""
        return np.asarray(self.beta.mean(axis=0))

    @cached_property
    def sd(self) -> Array:
        """Standard deviation of the p parameters under this model, shape (p,)."""
        return np.asarray(self.beta.std(axis=0))


def averaged_models(posterior: xr.DataTree) -> list[AveragedModel]:
    """Return the models of a posterior that have draws in it; a single model if it is no average.

    In the average, a parameter has the mean Σ p_m mean_m and the variance Σ p_m (var_m + (mean_m −
    mean)²). p_m is the share of model m among the draws; mean_m and var_m are mean and variance of
    the parameter in these.
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
        places = np.flatnonzero(beta[is_drawn].any(axis=0))
        models.append(
            AveragedModel(
                probability=float(is_drawn.mean()),
                bound=_bound_of_model(bound, places, description["rivals"]),
                places=places,
                beta=beta[is_drawn],
                phi=phi[is_drawn],
            )
        )
    return models


def _bound_of_model(
    largest: BoundModel, places: NDArray[np.intp], rivals: Sequence[str]
) -> BoundModel:
    """Return one model of an average, applied to the campaign.

    ``largest`` is the model with all parameters, and ``places`` are the indices among them of the
    parameters that this model has. ``rivals`` are its rival explanations: effects that look like a
    change of compliance with force.
    """
    present = {largest.names[place] for place in places}
    absent = [name for name in largest.names if name not in present]
    model = largest.model.fixing(*absent).with_rivals(*rivals)
    return model.bind(largest.campaign)
