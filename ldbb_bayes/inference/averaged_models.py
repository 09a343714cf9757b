"""The single models of a posterior that is averaged over models, each with its own draws.

A draw of an averaged posterior comes from one of the models, and the share of its draws is the
model's posterior probability. A parameter that a model lacks is zero in all of its draws, and in no
draw of a model that has it.
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

    ``places`` are the places of the model's parameters among the p parameters of the average.
    """

    #: share of the model's draws among all draws: its posterior probability, rounded
    probability: float
    bound: BoundModel  #: the model, applied to the campaign
    places: NDArray[np.intp]
    #: draws of all p parameters of the average, those that the model lacks zero, shape (n, p)
    beta: Array
    phi: Array  #: draws of the h hyper-parameters [mm], shape (n, h)

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

    The mean of a parameter is Σ p_m mean_m, and its variance Σ p_m (var_m + (mean_m − mean)²), with
    the share p_m of model m among the draws.
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

    ``largest`` is the model with all parameters. ``places`` are the places of the model's own
    parameters among them, ``rivals`` its rival explanations.
    """
    present = {largest.names[place] for place in places}
    absent = [name for name in largest.names if name not in present]
    model = largest.model.fixing(*absent).with_rivals(*rivals)
    return model.bind(largest.campaign)
