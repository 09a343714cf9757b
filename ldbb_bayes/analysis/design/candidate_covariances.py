"""Covariances of the parameters after one more circle, for many possible circles at once.

Let Σ be the covariance of all coefficients given the circles run so far. The readings of a possible
circle are reduced to a few values that contain all their information. Let G be the derivatives of
these values with respect to the coefficients, divided by the standard deviation of the noise. Let
Σ_s be the rows of Σ for the parameters of interest, and Σ_ss the part of Σ_s in the columns of
these parameters. After the circle, the covariance of the parameters of interest is

    Σ_ss − Σ_s Gᵀ (1 + G Σ Gᵀ)⁻¹ G Σ_sᵀ.

For the comparison of possible circles, all of them scatter alike: each noise factor λ is 1. The
circle that is then run may scatter more or less (`covariances_with_scatter`).
"""

from __future__ import annotations

import numpy as np

from ldbb_bayes.analysis.design.objective import Objective
from ldbb_bayes.analysis.design.states import extend_hyper_parameters
from ldbb_bayes.model.bound_information import informations_of
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array

__all__ = ["CandidateCovariances", "covariances_with_scatter"]

# Number of noise factors λ of a possible circle that are combined with each value of the
# hyper-parameters.
_SCATTERS = 4


class CandidateCovariances:
    """Covariances of the parameters of interest before and after each of several possible circles.

    Parameters
    ----------
    objective
        Objective of a search for the best next circle, at K values of the hyper-parameters. Its
        attribute ``prior`` is the precision of the p coefficients given the circles run so far, and
        ``rows`` holds the information of every possible circle. The s parameters of interest are
        the last of the p coefficients. All coefficients are in units of their prior standard
        deviations.
    """

    def __init__(self, objective: Objective) -> None:
        """Compute the posterior covariances of the coefficients given the circles run so far.

        ``objective`` holds the precision of the coefficients given these circles, and the
        information that each possible next circle would add.
        """
        self._rows = objective.rows
        self._interest = objective.interest
        self._covariance = np.linalg.inv(objective.prior)

    @property
    def before(self) -> Array:
        """Covariances of the s parameters of interest before the next circle, shape (K, s, s).

        There is one covariance matrix for each of K values of the hyper-parameters.
        """
        s = self._interest
        return np.asarray(self._covariance[:, -s:, -s:])

    def after(self) -> Array:
        """Return the covariances of the s parameters of interest if one more circle is run.

        The result has the shape (K, candidates, s, s), for K values of the hyper-parameters and all
        circles that could be run (candidates).
        """
        s = self._interest
        results = []
        for rows, covariance in zip(self._rows, self._covariance, strict=True):
            spread = rows @ covariance
            readings = spread @ np.swapaxes(rows, -1, -2) + np.eye(rows.shape[1])
            of_interest = spread[..., -s:]
            weighted = np.linalg.solve(readings, of_interest)
            results.append(covariance[-s:, -s:] - np.swapaxes(of_interest, -1, -2) @ weighted)
        return np.array(results)

    def run(self, candidate: int) -> None:
        """Update the covariances of the parameters as if the circle ``candidate`` had been run."""
        rows = self._rows[:, candidate]
        spread = rows @ self._covariance
        readings = spread @ np.swapaxes(rows, -1, -2) + np.eye(rows.shape[1])
        weighted = np.linalg.solve(readings, spread)
        self._covariance = self._covariance - np.swapaxes(spread, -1, -2) @ weighted


def covariances_with_scatter(
    bound: BoundModel, tests_run: int, candidate: int, phi: Array
) -> Array:
    """Return covariances of the parameters after one more circle whose scatter is not known yet.

    An uncertainty that depends mostly on a single new circle is proportional to the scatter of this
    circle. Its noise factor λ, by which the scatter is multiplied, therefore takes values that are
    spread evenly over its prior.

    Parameters
    ----------
    bound
        Model applied to the circles run so far, followed by all circles that could be run.
    tests_run
        Number of circles run so far.
    candidate
        Index of the new circle among the circles that could be run.
    phi
        K equally likely values of the h hyper-parameters given the circles run so far, shape (K,
        h); lengths in mm.

    Returns
    -------
    Array
        Covariances of the p parameters, in units of their prior standard deviations, shape (4 K, p,
        p): one for each value of the hyper-parameters and each of four values of λ.
    """
    repeated = np.tile(phi, (_SCATTERS, 1))
    extended = extend_hyper_parameters(bound, repeated, tests_run, scattering=True)
    covariances = []
    for information in informations_of(
        bound, extended, tests=[*range(tests_run), tests_run + candidate]
    ):
        rows = information.rows()
        covariance = np.linalg.inv(np.eye(rows.shape[1]) + rows.T @ rows)
        interest = information.interest
        covariances.append(covariance[np.ix_(interest, interest)])
    return np.array(covariances)
