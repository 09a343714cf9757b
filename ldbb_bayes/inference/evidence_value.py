"""Log evidence of a model for the readings of one campaign, as a number with its error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ldbb_bayes.units import value_and_uncertainty

__all__ = ["Evidence"]


@dataclass(frozen=True)
class Evidence:
    """Log evidence ln Z of a model: the log density of a campaign's readings under the model."""

    #: log evidence ln Z: the log density of the readings in mm under the model; only differences
    #: between models of the same readings have a meaning
    log_value: float
    #: error of the log evidence [nat]; infinite if the weights of the nodes (values of the
    #: hyper-parameters) cannot be trusted
    error: float
    #: number of nodes (values of the hyper-parameters) from which the log evidence was computed
    nodes: int
    #: digest (SHA-256) of the readings and of the conditions under which they were taken
    sha256: str

    @property
    def trusted(self) -> bool:
        """Whether the log evidence can be trusted, that is, whether its error is finite.

        The error is infinite if the weights of the nodes (values of the hyper-parameters) cannot be
        trusted.
        """
        return bool(np.isfinite(self.error))

    def __repr__(self) -> str:
        """Return a line of text with the log evidence, its error and the number of nodes.

        Nodes are weighted values of the hyper-parameters.
        """
        value = " ± ".join(value_and_uncertainty(self.log_value, self.error))
        return f"<Evidence: ln Z = {value} nat, {self.nodes} nodes; readings {self.sha256[:8]}>"
