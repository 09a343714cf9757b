"""Objective of the search for a design: the function that the search maximises.

The objective measures how good a design is, for a given model. Its arguments are the numbers of
runs of the candidate tests (tests that could be run). It is averaged over values of the
hyper-parameters φ (such as the standard deviation of the noise).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ldbb_bayes.analysis.design.criteria import Criterion
from ldbb_bayes.analysis.design.objective import Objective
from ldbb_bayes.analysis.design.states import extend_hyper_parameters
from ldbb_bayes.model.bound_information import informations_of
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.prior import Prior
from ldbb_bayes.model.terms.columns import PARAMETERS
from ldbb_bayes.results import Array

__all__ = ["objective_of", "prediction_weight"]

# A test has a matrix G with one column for each coefficient of the model, and adds GᵀG to the
# information about the coefficients. An element of G counts as a rounding error if it is below this
# fraction of the largest element in the same column.
_ROUNDING_ERROR = 1e-12
# Number of forces over which criterion I averages the variance of predicted compliances. These
# forces span the range of force of the pilot.
_PREDICTED_FORCES = 33


def prediction_weight(bound: BoundModel, chosen: Sequence[str]) -> Array:
    """Return the weights W, shape (s, s), of criterion I for s chosen parameters.

    Criterion I (I-optimality) is the mean relative variance of the predicted compliances, tr(W
    S⁻¹). S is the posterior precision matrix of the chosen parameters; each parameter is in units
    of its entry in ``bound.scale``. The relative variance of compliance j at force F is the
    variance of C_j(F), divided by the prior variance of C_j at the reference force. The mean is
    over the compliances that the chosen parameters describe, and over the range of force of the
    pilot: the campaign that the design starts from.
    """
    pilot_forces = (bound.pilot or bound.campaign).forces_N
    columns = [bound.names.index(name) for name in chosen]
    prior = Prior.first() if bound.model.prior.flat else bound.model.prior
    compliance_sd = prior.compliance_sd(bound.compliances)
    concerned = {parameter.compliance for parameter in bound.parameters if parameter.name in chosen}
    predicted = [
        k for k, compliance in enumerate(bound.compliances) if compliance.label in concerned
    ]
    rows_by_force = []
    for force in np.linspace(pilot_forces.min(), pilot_forces.max(), _PREDICTED_FORCES):
        derivatives = bound.compliance_at(force)[:, columns] * bound.scale[columns]
        rows_by_force.append((derivatives / compliance_sd[:, None])[predicted])
    rows = np.concatenate(rows_by_force)
    return np.asarray(rows.T @ rows / len(rows))


def objective_of(
    bound: BoundModel, tests_run: int, phi: Array, chosen: Sequence[str], criterion: Criterion
) -> Objective:
    """Return the objective of a search among candidate tests, for the chosen parameters.

    Nuisance coefficients describe effects that are modelled but not of interest. A nuisance
    coefficient is omitted unless it is connected with a chosen parameter. Two coefficients are
    connected if they change the same readings, or if other coefficients form a chain of such
    connections between them.

    Parameters
    ----------
    bound
        Model applied to the tests that have already been run, followed by the candidate tests.
    tests_run
        Number of tests that have already been run.
    phi
        K sets of the h hyper-parameters φ of the campaign that the design starts from, shape (K,
        h); lengths in mm.
    chosen
        Names of the parameters of interest.
    criterion
        Criterion of the design.

    Returns
    -------
    Objective
        Objective for the candidate tests. Its attribute ``rows``, shape (K, candidates, m, p),
        holds the information that every candidate test adds, where p is the number of coefficients
        and m the number of values to which the readings of a test are reduced. Its attribute
        ``prior``, shape (K, p, p), is the precision of the coefficients before these tests. The
        chosen parameters are the last of the p coefficients, in the order of ``chosen``.
    """
    rows = []
    prior = []
    layout = None
    for information in informations_of(bound, extend_hyper_parameters(bound, phi, tests_run)):
        blocks = _stack_blocks(information.blocks())
        if layout is None:
            layout = _layout_of(information, blocks, chosen)
        blocks = blocks[:, :, layout.columns][:, layout.rows]
        rows_run = blocks[:tests_run].reshape(-1, len(layout.columns))
        prior.append(np.diag(layout.has_prior.astype(float)) + rows_run.T @ rows_run)
        rows.append(blocks[tests_run:])
    return Objective(np.array(rows), np.array(prior), len(chosen), criterion)


class _Layout(NamedTuple):
    """Indices of those rows and columns of the matrices G that the search for a design needs.

    Each test has a matrix G. It has one column for each coefficient of the model, and one row for
    each of at most 25 values to which the readings of the test are reduced. A test adds the
    information GᵀG to the precision (inverse covariance) of the coefficients.
    """

    # indices of the needed columns of the tests' matrices G (derivatives of the readings), which
    # have one column for each coefficient of the model. The columns of the parameters of interest
    # come last.
    columns: NDArray[np.int_]
    # indices of the needed rows of the tests' matrices G (derivatives of the readings): rows with
    # an element other than zero in the matrix G of at least one test
    rows: NDArray[np.int_]
    # whether each coefficient of the model has a proper prior, not a flat prior
    has_prior: NDArray[np.bool_]


def _layout_of(information: Information, blocks: Array, chosen: Sequence[str]) -> _Layout:
    """Return the indices of those rows and columns of the matrices G that a design search needs.

    Each test has a matrix G with one column for each of m coefficients; GᵀG is the information of
    the test. ``blocks``, shape (tests, rows, m), holds the matrices G at one value of the
    hyper-parameters. The result is the same for all values of the hyper-parameters. ``chosen`` are
    the names of the parameters of interest. ``information`` holds the names of the coefficients,
    and says whether their priors are flat.
    """
    interest = [information.names.index(name) for name in chosen]
    columns = _connected_columns(blocks, interest)
    largest_by_row = np.abs(blocks[:, :, columns]).max(axis=(0, 2))
    has_prior = np.array(
        [not (information.flat and owner == PARAMETERS) for owner in information.owners]
    )
    return _Layout(columns, np.flatnonzero(largest_by_row > 0.0), has_prior[columns])


def _stack_blocks(blocks: Sequence[Array]) -> Array:
    """Return the matrices G of all tests as one array, with rounding errors set to zero.

    ``blocks`` has one matrix G per test, with at most 25 rows and one column per coefficient of the
    model. The test adds GᵀG to the precision (inverse covariance) of the coefficients. The result
    has the shape (tests, rows, coefficients). Zeros are appended to matrices with fewer rows.
    """
    rows = max(len(block) for block in blocks)
    stacked = np.zeros((len(blocks), rows, blocks[0].shape[1]))
    for k, block in enumerate(blocks):
        stacked[k, : len(block)] = block
    stacked[np.abs(stacked) < _ROUNDING_ERROR * np.abs(stacked).max(axis=(0, 1))] = 0.0
    return stacked


def _connected_columns(blocks: Array, interest: Sequence[int]) -> NDArray[np.int_]:
    """Return the indices of all coefficients that are connected with those of interest.

    Two coefficients are connected if they both have an effect on the same readings, or if other
    coefficients form a chain of such connections between them. ``blocks``, shape (tests, rows, m),
    holds the matrix G of each test for m coefficients; GᵀG is the information of the test.
    ``interest`` are the indices of the coefficients of interest, which come last in the result.
    """
    size = np.abs(blocks)
    shares_readings = np.einsum("rij,rik->jk", size, size) > 0.0
    _, component = connected_components(shares_readings, directed=False)
    connected = np.isin(component, component[list(interest)])
    connected[list(interest)] = False
    return np.array([*np.flatnonzero(connected), *interest], dtype=int)
