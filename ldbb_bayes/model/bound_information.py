"""Information that readings carry about all coefficients of a bound model.

A bound model is a model that has been applied to one campaign. Its coefficients are the parameters
of interest (compliances, their changes with force, and geometric errors) and the coefficients of
nuisances, which are effects that are modelled but not of interest. The hyper-parameters φ of the
model are quantities such as the standard deviation of the noise. The readings of a test are
replaced by at most 25 numbers without loss of information (module `reduction`); these numbers are
called reduced readings.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.terms import BasisNoise, Columns
from ldbb_bayes.model.terms.columns import NOISE, PARAMETERS
from ldbb_bayes.results import Array

__all__ = ["information_of", "informations_of"]


@dataclass(frozen=True, eq=False)
class _Noise:
    """Nuisance effect that varies randomly between tests and is therefore treated as noise.

    ``term`` is the class name of the nuisance term, and ``columns`` holds the change of the reading
    per unit of each coefficient of this term.
    """

    term: str
    columns: Columns | BasisNoise

    def covariance(self, factor: Array, hyper: Mapping[str, float], test: int) -> Array:
        """Return a nuisance effect's contribution to the covariance of reduced readings [mm²].

        The result has the shape (m, m), for m reduced readings.

        Parameters
        ----------
        factor
            Matrix that converts 25 Fourier coefficients into the test's reduced readings, (m, 25).
        hyper
            Values of the hyper-parameters by name; lengths in mm.
        test
            Index of the test, from 0.
        """
        sd = self.columns.sd_at(hyper, test)
        if isinstance(self.columns, BasisNoise):
            root = factor * sd
        else:
            root = factor @ (self.columns.values[test] * sd)
        return root @ root.T


class _SortedColumns(NamedTuple):
    """Columns of the design matrix for all nuisance terms, sorted into two groups.

    The coefficients of one group are the same in all tests; those of the other group differ between
    tests.
    """

    #: columns of nuisance terms whose coefficients are the same in all tests. A column holds the
    #: change of each reading per unit of one coefficient
    shared: list[Columns]
    #: for each coefficient of the columns in ``shared``, the class name of the nuisance term to
    #: which it belongs
    owners: list[str]
    #: nuisance effects with coefficients that differ between tests; they are treated as noise that
    #: is independent between tests
    noises: list[_Noise]


def information_of(bound: BoundModel, phi: Array) -> Information:
    """Return the information that readings carry about all coefficients of a campaign's model.

    The coefficients are the parameters of interest, and the nuisance coefficients that have the
    same value in all tests. Nuisances are effects modelled but not of interest; those whose
    coefficients differ between tests are treated as noise. ``bound`` is the model of the campaign.
    ``phi``, shape (h,), holds the h hyper-parameters, with lengths in mm.
    """
    return next(informations_of(bound, phi[None]))


def informations_of(
    bound: BoundModel, phi: Array, *, tests: Sequence[int] | None = None
) -> Iterator[Information]:
    """Yield the information about all coefficients for each of w values of the hyper-parameters.

    The coefficients are the parameters of interest, and the nuisance coefficients that have the
    same value in all tests. Nuisances are effects modelled but not of interest; those whose
    coefficients differ between tests are treated as noise. ``bound`` is the model of a campaign.
    ``phi``, shape (w, h), holds w values of the h hyper-parameters, with lengths in mm. The design
    matrix holds the effect of one unit of each coefficient on the reduced readings. It does not
    depend on the hyper-parameters and is computed once. Tests with the same noise share one
    covariance. ``tests`` are the indices of the tests that give information, from 0. Default: all
    tests.
    """
    if tests is None:
        tests = range(len(bound.reduced))
    shared, shared_owners, noises = _sort_columns(bound)
    names = list(bound.names)
    for columns in shared:
        names += columns.names
    owners = [PARAMETERS] * len(bound.names) + shared_owners
    values = np.concatenate(
        [bound.interest_columns, *(columns.values for columns in shared)], axis=2
    )
    design = tuple(bound.reduced[r].factor @ values[r] for r in tests)
    first_tests = _first_tests_of_equal_noise(bound, noises, phi)
    representatives = [first_tests[r] for r in tests]
    for phi_values in phi:
        hyper = dict(zip(bound.hyper_prior.names, phi_values.tolist(), strict=True))
        scales = np.concatenate([bound.scale, *(columns.sd_at(hyper) for columns in shared)])
        blocks = {
            r: _noise_covariances(bound.reduced[r].factor, noises, hyper, r)
            for r in dict.fromkeys(representatives)
        }
        blocks_of_tests = tuple(blocks[r] for r in representatives)
        yield Information(
            tuple(names), tuple(owners), scales, bound.model.prior.flat, design, blocks_of_tests
        )


def _sort_columns(bound: BoundModel) -> _SortedColumns:
    """Return the columns of all nuisance terms of a campaign's model, sorted into two groups.

    A column holds the change of each reading when one coefficient of a nuisance increases by one
    unit. The first group holds the columns whose coefficients are the same in all tests, the second
    group those whose coefficients differ between tests. The result also names the term to which
    each coefficient of the first group belongs. ``bound`` is the model of the campaign.
    """
    shared: list[Columns] = []
    owners: list[str] = []
    noises: list[_Noise] = []
    for kind, columns_of_term in bound.columns_of.items():
        for columns in columns_of_term:
            if isinstance(columns, BasisNoise) or columns.private:
                noises.append(_Noise(kind.__name__, columns))
            else:
                shared.append(columns)
                owners += [kind.__name__] * len(columns.names)
    return _SortedColumns(shared, owners, noises)


def _first_tests_of_equal_noise(bound: BoundModel, noises: list[_Noise], phi: Array) -> list[int]:
    """Return, for each test, the index of the first test that has the same noise covariance.

    Two tests have the same noise covariance if they have the same angles, the same factor λ that
    multiplies the noise of the circle, and the same columns of all nuisance effects that act as
    noise (``noises``). Nuisances are effects that are modelled but not of interest; a column holds
    the change of the reading per unit of one coefficient. In a campaign with readings, the angles
    of different tests are always treated as different. ``bound`` is the model of the campaign.
    ``phi``, shape (w, h), holds w values of the h hyper-parameters, among which are the factors λ.
    Indices count from 0.
    """
    scale_of = dict(zip(bound.hyper_prior.names, phi.T, strict=True))
    first_of_kind: dict[tuple[object, ...], int] = {}
    representatives = []
    for r, (test, circle) in enumerate(zip(bound.reduced, bound.setting.circle, strict=True)):
        scale = scale_of[str(circle)].tobytes() if circle else b""
        kind: list[object] = [id(test.factor), scale]
        for noise in noises:
            if isinstance(noise.columns, Columns):
                kind.append(noise.columns.values[r].tobytes())
        representatives.append(first_of_kind.setdefault(tuple(kind), r))
    return representatives


def _noise_covariances(
    factor: Array, noises: list[_Noise], hyper: Mapping[str, float], test: int
) -> dict[str, Array]:
    """Return, for each source of noise, the covariance of one test's reduced readings [mm²].

    The result is a dict of arrays of shape (m, m), for m reduced readings. ``noises`` are the
    nuisance terms that are treated as noise. The keys of the result are the class names of these
    terms; the white noise of the readings has the key ``NOISE``. ``factor``, shape (m, 25),
    converts Fourier coefficients into reduced readings. ``hyper`` holds the hyper-parameters by
    name, with lengths in mm. ``test`` is the index of the test, from 0.
    """
    blocks = {NOISE: np.eye(len(factor)) * hyper["sigma"] ** 2}
    for noise in noises:
        covariance = noise.covariance(factor, hyper, test)
        blocks[noise.term] = blocks.get(noise.term, 0.0) + covariance
    return blocks
