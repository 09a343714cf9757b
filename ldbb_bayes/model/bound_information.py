"""Information that readings carry about all coefficients of a bound model.

A bound model is the model of one campaign. Its hyper-parameters φ are the scales of the noise and
of the nuisances, which are effects that are modelled but not of interest.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.terms import BasisNoise, Columns
from ldbb_bayes.model.terms.columns import NOISE, OWN
from ldbb_bayes.results import Array

__all__ = ["information_of", "informations_of"]


@dataclass(frozen=True, eq=False)
class _Noise:
    """Effect of a nuisance term that differs between tests, treated as noise of each test."""

    term: str
    columns: Columns | BasisNoise

    def covariance(self, factor: Array, hyper: Mapping[str, float], test: int) -> Array:
        """Return the covariance of this noise in the reduced readings of one test [mm²].

        ``factor`` is the matrix from Fourier coefficients to the test's reduced readings, and
        ``hyper`` holds the values of the scales by name.
        """
        if isinstance(self.columns, BasisNoise):
            root = factor * self.columns.sd_at(hyper, test)
        else:
            root = factor @ (self.columns.values[test] * self.columns.sd_at(hyper))
        return root @ root.T


class _SortedColumns(NamedTuple):
    """Columns of the nuisances, sorted by whether all tests share their coefficients.

    Nuisances are effects that are modelled but not of interest.
    """

    #: columns with coefficients that all tests share
    shared: list[Columns]
    #: class name of the nuisance term that each shared coefficient belongs to
    owners: list[str]
    #: columns whose coefficients differ between tests; they are treated as noise
    noises: list[_Noise]


def information_of(bound: BoundModel, phi: Array) -> Information:
    """Return the information that readings carry about all coefficients of a campaign's model.

    ``phi`` (h,) [mm] are the hyper-parameters, the scales of noise and nuisances. Effects whose
    coefficients differ between tests are treated as noise of each test.
    """
    return next(informations_of(bound, phi[None]))


def informations_of(bound: BoundModel, phi: Array) -> Iterator[Information]:
    """Yield the information about all coefficients for each of w values of the hyper-parameters.

    ``phi`` (w, h) [mm] are the hyper-parameters, the scales of noise and nuisances. The design
    matrix does not depend on them and is computed once. Tests with the same noise share one
    covariance.
    """
    shared, shared_owners, noises = _sort_columns(bound)
    names = list(bound.names)
    for columns in shared:
        names += columns.names
    owners = [OWN] * len(bound.names) + shared_owners
    values = np.concatenate([bound.interest, *(columns.values for columns in shared)], axis=2)
    design = tuple(test.factor @ values[r] for r, test in enumerate(bound.reduced))
    representatives = _first_tests_of_equal_noise(bound, noises, phi)
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
    """Return the nuisances' columns, sorted by whether all tests share their coefficients."""
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
    """Return for each test the index of the first test that has the same noise covariance.

    Two tests have the same noise if their angles, the noise factors λ of their circles and their
    columns of noise are equal.
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
    """Return the noise covariances of one test [mm²] by term, with that of the reading noise."""
    blocks = {NOISE: np.eye(len(factor)) * hyper["sigma"] ** 2}
    for noise in noises:
        covariance = noise.covariance(factor, hyper, test)
        blocks[noise.term] = blocks.get(noise.term, 0.0) + covariance
    return blocks
