"""Log evidences of many models of one campaign, each computed once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.inference.evidence import Evidence, check_comparable, evidence_on
from ldbb_bayes.inference.lattice import Lattice
from ldbb_bayes.inference.quadrature import HyperPosterior
from ldbb_bayes.model.columns import Hyper
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.spec import model_to_toml

__all__ = ["Evidences", "Weighed", "probabilities"]

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Weighed:
    """A model, its posterior over the hyper-parameters as weighted nodes, and its evidence."""

    posterior: HyperPosterior
    lattice: Lattice
    evidence: Evidence


class Evidences:
    """Evidences of the models of one campaign.

    Parameters
    ----------
    campaign : Campaign
    tolerance : float
        Error asked of each [nat].
    progress : callable, optional
        Called after each one asked for.
    """

    def __init__(self, campaign: Campaign, *, tolerance: float, progress: Callable[[], None] | None = None) -> None:
        self.campaign, self.tolerance = campaign, tolerance
        self._progress = progress
        self._found: dict[str, Weighed] = {}
        self._modes: dict[tuple[Hyper, ...], Array] = {}

    def of(self, model: HybridModel) -> Weighed:
        """Of one model; the search starts where another model with the same hyper-parameters had its mode."""
        key = model_to_toml(model)
        if key not in self._found:
            check_comparable(model, self.campaign)
            bound = model.bind(self.campaign)
            posterior = HyperPosterior(bound, truncated=bound.truncation.active, near=self._modes.get(model.hypers))
            lattice = posterior.lattice(self.tolerance)
            self._modes.setdefault(model.hypers, posterior.mode)
            self._found[key] = Weighed(posterior, lattice, evidence_on(posterior, lattice))
        self.tick()
        return self._found[key]

    @property
    def largest_error(self) -> float:
        """Of all evidences so far [nat]."""
        return max((weighed.evidence.error for weighed in self._found.values()), default=0.0)

    def tick(self) -> None:
        """One more step is done."""
        if self._progress is not None:
            self._progress()


def probabilities(log_evidence: Array) -> Array:
    """Posterior probabilities of models from their log evidences, shape (n,), at equal prior probabilities."""
    share = np.exp(log_evidence - log_evidence.max())
    return np.asarray(share / share.sum())
