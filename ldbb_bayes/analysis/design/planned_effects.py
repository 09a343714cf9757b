"""All effects on the readings of planned tests, and the covariance of the readings.

Effects are the parameters of interest, the nuisances (modelled but not of interest) and the white
noise. The readings have the covariance V = Σ_c s_c x_c x_cᵀ + σ² 1: x_c are the changes of the
readings per unit of effect c, s_c is the prior variance of the effect, and σ² is the variance of
the white noise. The variances depend on the hyper-parameters (such as the standard deviation of the
noise). The readings of each test are reduced to a few combinations, which contain all information
about the effects.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import scipy.linalg

from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.terms.columns import BasisNoise, Columns
from ldbb_bayes.results import Array

__all__ = ["EffectBlock", "Effects", "effects_at", "inverse_covariance"]


class EffectBlock(NamedTuple):
    """A block of the design matrix: the effects on all tests, or the effects on one test alone.

    The design matrix has one row for each of the N reduced readings (combinations of a test's
    readings) of all tests, and one column for each of the C effects. The block has n of these rows
    and c of these columns. In these c columns, the elements in all other rows are zero.
    """

    # indices of this block's n reduced readings in the list of the reduced readings of all tests. A
    # reduced reading is a combination of the readings of one test.
    readings: slice
    # indices of this block's c effects in the list of all effects on the readings
    effects: slice
    # block of the design matrix: change of each of n reduced readings per unit of each of c
    # effects, shape (n, c)
    columns: Array


def inverse_covariance(blocks: list[EffectBlock], variances: Array, noise: float) -> Array:
    """Return the inverse covariance of N reduced readings (combinations of readings), shape (N, N).

    The covariance is V = B + X Xᵀ. B is the block-diagonal covariance due to the white noise and to
    the effects on single tests, with one block for each test. X are the changes of the readings
    when each effect on all tests changes by its standard deviation. By the Woodbury identity, V⁻¹ =
    B⁻¹ − B⁻¹ X (1 + Xᵀ B⁻¹ X)⁻¹ Xᵀ B⁻¹.
    """
    on_all_tests, *on_one_test = blocks
    shared = on_all_tests.columns * np.sqrt(variances[on_all_tests.effects])
    inverse = np.zeros((len(shared), len(shared)))
    weighted = np.empty_like(shared)
    for block in on_one_test:
        of_effects = (block.columns * variances[block.effects]) @ block.columns.T
        covariance = of_effects + noise * np.eye(len(of_effects))
        of_test = np.linalg.inv(covariance)
        inverse[block.readings, block.readings] = of_test
        weighted[block.readings] = of_test @ shared[block.readings]
    root = np.linalg.cholesky(np.eye(shared.shape[1]) + shared.T @ weighted)
    update = scipy.linalg.solve_triangular(root, weighted.T, lower=True)
    return np.asarray(inverse - update.T @ update)


class Effects(NamedTuple):
    """All effects on the reduced readings of planned tests, and the variances of these effects.

    The readings of a test are reduced to a few combinations of the readings, which contain all
    information about the effects. Each effect has w variances, one for each of w sets of
    hyper-parameters.
    """

    # blocks of the design matrix of the readings: first the block of the effects on all tests, then
    # one block for the effects on each single test
    blocks: list[EffectBlock]
    # variances of all C effects on the readings, for each of w sets of hyper-parameters, shape (w,
    # C)
    variances: Array
    # variance of the white noise of the readings [mm²] for each of w sets of hyper-parameters,
    # shape (w,)
    noise_variance: Array


def effects_at(bound: BoundModel, phi: Array) -> Effects:
    """Return all effects on the planned readings, and the variances of these effects.

    ``phi``, shape (w, h), are w sets of the h hyper-parameters, with lengths in mm. The variances
    are computed for each set.
    """
    values = dict(zip(bound.hyper_prior.names, phi.T, strict=True))
    on_all_tests = _effects_on_all_tests(bound, values)
    on_single_tests = [_effects_on_one_test(bound, values, r) for r in range(len(bound.reduced))]
    all_readings, common_effects = on_all_tests.columns.shape
    first_block = EffectBlock(
        slice(0, all_readings), slice(0, common_effects), on_all_tests.columns
    )
    blocks = [first_block]
    # Readings are counted through all tests, and so are effects. ``readings`` and ``effects`` state
    # how many of them come before the next test; they are the first indices of this test.
    readings = 0
    effects = common_effects
    for on_one_test in on_single_tests:
        n, c = on_one_test.columns.shape
        readings_of_test = slice(readings, readings + n)
        effects_of_test = slice(effects, effects + c)
        blocks.append(EffectBlock(readings_of_test, effects_of_test, on_one_test.columns))
        readings += n
        effects += c
    variances = np.concatenate(
        [group.variances for group in (on_all_tests, *on_single_tests)], axis=1
    )
    return Effects(blocks, variances, values["sigma"] ** 2)


class _EffectColumns(NamedTuple):
    """Changes of n readings per unit of each of c effects, and the variances of these effects."""

    # changes of n reduced readings (combinations of a test's readings) per unit of each of c
    # effects, shape (n, c)
    columns: Array
    # variances of the c effects for each of w sets of hyper-parameters, shape (w, c)
    variances: Array


def _effects_on_all_tests(bound: BoundModel, values: Mapping[str, Array]) -> _EffectColumns:
    """Return the design matrix of the effects on all tests, and the variances of these effects.

    These effects are the parameters, and the nuisance coefficients that have the same value in all
    tests. `_effects_on_one_test` treats all other effects: noise, and coefficients that have a
    separate value in each test. ``values`` holds w values of each hyper-parameter, by name; lengths
    are in mm. The variances are prior variances, computed for each of the w values.
    """
    factors = [test.factor for test in bound.reduced]
    interest = [factor @ bound.interest_columns[r] for r, factor in enumerate(factors)]
    columns = [np.concatenate(interest)]
    sds = [bound.scale]
    for effect in bound.nuisance_columns:
        if isinstance(effect, Columns) and effect.names and not effect.private:
            of_tests = [factor @ effect.values[r] for r, factor in enumerate(factors)]
            columns.append(np.concatenate(of_tests))
            sds.append(effect.sd_at(values))
    return _combine_groups(columns, sds, len(values["sigma"]))


def _effects_on_one_test(bound: BoundModel, values: Mapping[str, Array], r: int) -> _EffectColumns:
    """Return the design matrix of the effects on one test only, and the variances of these effects.

    ``r`` is the index of the test. ``values`` holds w values of each hyper-parameter, by name;
    lengths are in mm. The variances are prior variances, computed for each of the w values.
    """
    factor = bound.reduced[r].factor
    columns = [np.empty((len(factor), 0))]
    sds = [np.empty(0)]
    for effect in bound.nuisance_columns:
        if isinstance(effect, BasisNoise):
            columns.append(factor)
            sds.append(effect.sd_at(values, r))
        elif effect.private:
            columns.append(factor @ effect.values[r])
            sds.append(effect.sd_at(values, r))
    return _combine_groups(columns, sds, len(values["sigma"]))


def _combine_groups(columns: list[Array], sds: list[Array], sets: int) -> _EffectColumns:
    """Return one design matrix for several groups of effects, with the variances of the effects.

    For each group, ``columns`` holds the design matrix of the group, and ``sds`` the standard
    deviations of its effects. ``sets`` is the number of sets of hyper-parameters; the result holds
    one variance of each effect for each set.
    """
    variances = []
    for column, sd in zip(columns, sds, strict=True):
        variances.append(np.broadcast_to(sd**2, (sets, column.shape[1])))
    return _EffectColumns(np.concatenate(columns, axis=1), np.concatenate(variances, axis=1))
