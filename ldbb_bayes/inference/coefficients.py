"""Circles as basis coefficients, from draws of a model's parameters.

Three predictions are never mixed up:

- machine: H β;
- shared: plus ball form, bar length, mount and force error. RMSE and fitness (Eq. 34-35) are of
  this one;
- new circle: plus set-up shift, discrepancy and white noise, drawn anew.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from ldbb_bayes.inference.integrals import CHUNK
from ldbb_bayes.model.fourier import SIZE
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.terms import BasisNoise, Columns, JointLoad
from ldbb_bayes.results import Array

__all__ = [
    "ModelDraws",
    "compliance_curves",
    "draw_of_circle",
    "draw_shared",
    "draw_shared_coefficients",
    "evenly_spaced",
    "machine_coefficients",
    "new_circle_coefficients",
    "pool_draws",
    "private_terms",
    "shared_coefficients",
    "shared_columns",
    "shared_terms",
]


class ModelDraws(NamedTuple):
    """A bound model and draws of its parameters; an average over models has several."""

    bound: BoundModel
    phi: Array  #: hyper-parameters, (n, h) [mm]
    beta: Array  #: parameters, (n, p)

    def thinned(self, size: int) -> ModelDraws:
        """Return so many draws at most, evenly picked."""
        chosen = evenly_spaced(len(self.phi), size)
        return ModelDraws(self.bound, self.phi[chosen], self.beta[chosen])


class PrivateTerm(NamedTuple):
    """What a circle has for itself, drawn anew for every circle."""

    columns: Array  #: of the basis, (25, v) [mm]
    sd: Array  #: of the coefficients, (draws, v)


def evenly_spaced(total: int, size: int) -> Array:
    """Return so many positions at most, evenly spaced from the first to the last of ``total``."""
    return np.linspace(0, total - 1, min(size, total)).astype(int)


def pool_draws(beta: Array, phi: Array, size: int | None = None) -> tuple[Array, Array]:
    """Return draws (chains, draws, …) of all chains in one row, all or so many, evenly picked."""
    flat_beta = beta.reshape(-1, beta.shape[2])
    flat_phi = phi.reshape(-1, phi.shape[2])
    if size is None:
        return flat_beta, flat_phi
    chosen = evenly_spaced(len(flat_beta), size)
    return flat_beta[chosen], flat_phi[chosen]


def machine_coefficients(bound: BoundModel, beta: Array) -> Array:
    """Return coefficients of H β plus nominal mount deflection, shape (draws, tests, 25) [mm]."""
    return np.einsum("tkp,wp->wtk", bound.interest, beta) + bound.known_offset


def shared_terms(
    columns: Iterable[Columns | BasisNoise], *, private: bool = False
) -> list[Columns]:
    """Return the nuisances' columns whose coefficients tests share, or that each test has alone."""
    return [term for term in columns if isinstance(term, Columns) and term.private == private]


def shared_columns(bound: BoundModel, *, private: bool = False) -> Array:
    """Return the columns of `shared_terms` side by side, shape (tests, 25, q) [mm]."""
    columns = [np.zeros((len(bound.test_names), SIZE, 0))]
    columns += [term.values for term in shared_terms(bound.nuisance_columns, private=private)]
    return np.concatenate(columns, axis=2)


def draw_shared(bound: BoundModel, phi: Array, beta: Array, rng: np.random.Generator) -> Array:
    """Draw the shared nuisance coefficients given each β, φ and y, shape (draws, q)."""
    draws = []
    for start in range(0, len(phi), CHUNK):
        chunk = slice(start, start + CHUNK)
        shifted = beta[chunk] - bound.centre
        draws.append(bound.given_interest.conditional(phi[chunk], shifted)[1].draw(rng))
    return np.concatenate(draws)


def compliance_curves(
    bound: BoundModel, phi: Array, beta: Array, force_N: Array, rng: np.random.Generator
) -> Array:
    """Return C(F) of every kept compliance at forces (n,), shape (draws, n, compliances).

    C(F) is C and its slopes; of an axis, its deflection over a bar force along it, also what
    `JointLoad` adds, drawn given each β, φ and y.
    """
    at_forces = np.stack([bound.compliance_at(force) for force in force_N])
    curves = np.einsum("fcp,wp->wfc", at_forces, beta)
    joint_load = _joint_load_of(bound)
    if joint_load is None:
        return np.asarray(curves)
    names = _names_of_shared(bound)
    coefficients = draw_shared(bound, phi, beta, rng)
    secants = joint_load.secants(bound.setting, force_N)
    for index, compliance in enumerate(bound.compliances):
        if compliance.kind != "direct":
            continue
        prefix = f"joint_load_{compliance.twist}_"
        along_axis = [k for k, name in enumerate(names) if name.startswith(prefix)]
        added = coefficients[:, along_axis] @ secants[:, : len(along_axis)].T
        curves[:, :, index] += added
    return np.asarray(curves)


def _joint_load_of(bound: BoundModel) -> JointLoad | None:
    for term in bound.model.nuisances:
        if isinstance(term, JointLoad):
            return term
    return None


def _names_of_shared(bound: BoundModel) -> list[str]:
    names: list[str] = []
    for term in shared_terms(bound.nuisance_columns):
        names += term.names
    return names


def shared_coefficients(bound: BoundModel, phi: Array, beta: Array) -> Array:
    """Return machine plus expected ball form, bar length, mount and force error given β, φ and y.

    Shape (draws, tests, 25) [mm].
    """
    shifted = beta - bound.centre
    mean = bound.given_interest.conditional(phi, shifted)[1].mean
    shared = np.einsum("tkq,wq->wtk", shared_columns(bound), mean)
    coefficients = machine_coefficients(bound, beta) + shared
    private = shared_columns(bound, private=True)
    if not private.size:
        return np.asarray(coefficients)
    private_mean = bound.given_interest.private_mean(phi, shifted, mean)
    private_mean = private_mean[:, :, : private.shape[2]]
    return np.asarray(coefficients + np.einsum("tkv,wtv->wtk", private, private_mean))


def new_circle_coefficients(
    bound: BoundModel, phi: Array, beta: Array, rng: np.random.Generator
) -> Array:
    """Draw a new circle in the place of every test, white noise aside, (draws, tests, 25) [mm].

    Shared nuisances are drawn from their posterior; force error, set-up shift and discrepancy are
    drawn anew.
    """
    shared = draw_shared_coefficients(bound, phi, beta, rng)
    circles = [draw_of_circle(bound, phi, r, rng) for r in range(len(bound.test_names))]
    return shared + np.stack(circles, axis=1)


def draw_shared_coefficients(
    bound: BoundModel, phi: Array, beta: Array, rng: np.random.Generator
) -> Array:
    """Draw machine plus shared nuisances given each β, φ and y, shape (draws, tests, 25) [mm]."""
    nuisances = draw_shared(bound, phi, beta, rng)
    shared = np.einsum("tkq,wq->wtk", shared_columns(bound), nuisances)
    return np.asarray(machine_coefficients(bound, beta) + shared)


def draw_of_circle(bound: BoundModel, phi: Array, r: int, rng: np.random.Generator) -> Array:
    """Draw anew what circle r has for itself, shape (draws, 25) [mm].

    That is random force error, set-up shift and discrepancy.
    """
    coefficients = np.zeros((len(phi), SIZE))
    for term in private_terms(bound, phi, r):
        standard = rng.standard_normal(term.sd.shape)
        coefficients = coefficients + (term.sd * standard) @ term.columns.T
    return coefficients


def private_terms(bound: BoundModel, phi: Array, r: int) -> Iterator[PrivateTerm]:
    """Yield what circle r has for itself."""
    value = dict(zip(bound.hyper_prior.names, phi.T, strict=True))
    for term in bound.nuisance_columns:
        if isinstance(term, BasisNoise):
            yield PrivateTerm(np.eye(SIZE), term.sd_at(value, r))
        elif term.private:
            sd = np.broadcast_to(term.sd_at(value), (len(phi), len(term.names)))
            yield PrivateTerm(term.values[r], sd)
