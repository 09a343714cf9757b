"""Circles as basis coefficients, from draws of a model's parameters.

Three predictions are never mixed up. Machine: H β. Shared: plus ball form, bar length, mount and
force error; RMSE and fitness (Eq. 34-35) are of this one. New circle: plus set-up shift,
discrepancy and white noise, drawn anew.
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
    "machine_coefficients",
    "new_circle_coefficients",
    "pooled_draws",
    "private_terms",
    "shared_coefficients",
    "shared_columns",
    "shared_terms",
]


class ModelDraws(NamedTuple):
    """A bound model and its draws of φ, shape (n, h) [mm], and β, shape (n, p): those of one model
    where several are averaged."""

    bound: BoundModel
    phi: Array
    beta: Array

    def thinned(self, most: int) -> ModelDraws:
        """The same with so many draws at most, evenly picked."""
        pick = np.linspace(0, len(self.phi) - 1, min(most, len(self.phi))).astype(int)
        return ModelDraws(self.bound, self.phi[pick], self.beta[pick])


def machine_coefficients(bound: BoundModel, beta: Array) -> Array:
    """Basis coefficients of H β plus the nominal mount deflection, shape (draws, tests, 25)
    [mm]."""
    return np.einsum("tkp,wp->wtk", bound.interest, beta) + bound.known_offset


def shared_terms(
    columns: Iterable[Columns | BasisNoise], *, private: bool = False
) -> list[Columns]:
    """Those of the nuisances' columns whose coefficients tests share; or that every test has for
    itself."""
    return [term for term in columns if isinstance(term, Columns) and term.private == private]


def shared_columns(bound: BoundModel, *, private: bool = False) -> Array:
    """The same side by side, shape (tests, 25, q) [mm]."""
    values = [term.values for term in shared_terms(bound.nuisance_columns, private=private)]
    return np.concatenate([np.zeros((len(bound.test_names), SIZE, 0)), *values], axis=2)


def draw_shared(bound: BoundModel, phi: Array, beta: Array, rng: np.random.Generator) -> Array:
    """One draw of the shared nuisance coefficients given each β, φ and y, shape (draws, q)."""
    parts = [slice(start, start + CHUNK) for start in range(0, len(phi), CHUNK)]
    return np.concatenate(
        [
            bound.given_interest.conditional(phi[i], beta[i] - bound.centre)[1].draw(rng)
            for i in parts
        ]
    )


def compliance_curves(
    bound: BoundModel, phi: Array, beta: Array, force_N: Array, rng: np.random.Generator
) -> Array:
    """C(F) of every kept compliance at forces (n,), shape (draws, n, compliances): C and its
    slopes; of an axis, its deflection over a bar force along it, also what `JointLoad` adds, drawn
    given each β, φ and y."""
    curves = np.einsum(
        "fcp,wp->wfc", np.stack([bound.compliance_at(force) for force in force_N]), beta
    )
    term = next((term for term in bound.model.nuisances if isinstance(term, JointLoad)), None)
    if term is not None:
        names = [name for part in shared_terms(bound.nuisance_columns) for name in part.names]
        drawn = draw_shared(bound, phi, beta, rng)
        secants = term.secants(bound.setting, force_N)
        for j, own in enumerate(bound.compliances):
            along = [
                k
                for k, name in enumerate(names)
                if own.kind == "direct" and name.startswith(f"joint_load_{own.twist}_")
            ]
            curves[:, :, j] += drawn[:, along] @ secants[:, : len(along)].T
    return np.asarray(curves)


def shared_coefficients(bound: BoundModel, phi: Array, beta: Array) -> Array:
    """Machine plus the expected ball form, bar length, mount and force error given β, φ and y;
    (draws, tests, 25) [mm]."""
    shifted = beta - bound.centre
    mean = bound.given_interest.conditional(phi, shifted)[1].mean
    total = machine_coefficients(bound, beta) + np.einsum(
        "tkq,wq->wtk", shared_columns(bound), mean
    )
    private = shared_columns(bound, private=True)
    if not private.size:
        return np.asarray(total)
    own = bound.given_interest.private_mean(phi, shifted, mean)[:, :, : private.shape[2]]
    return np.asarray(total + np.einsum("tkv,wtv->wtk", private, own))


def new_circle_coefficients(
    bound: BoundModel, phi: Array, beta: Array, rng: np.random.Generator
) -> Array:
    """A new circle in the place of every test, white noise aside: shared nuisances drawn from their
    posterior, force error, set-up shift and discrepancy drawn anew; (draws, tests, 25) [mm]."""
    shared = draw_shared_coefficients(bound, phi, beta, rng)
    return shared + np.stack(
        [draw_of_circle(bound, phi, r, rng) for r in range(len(bound.test_names))], axis=1
    )


def draw_shared_coefficients(
    bound: BoundModel, phi: Array, beta: Array, rng: np.random.Generator
) -> Array:
    """Draw machine plus shared nuisances given each β, φ and y; (draws, tests, 25) [mm]."""
    drawn = draw_shared(bound, phi, beta, rng)
    return np.asarray(
        machine_coefficients(bound, beta) + np.einsum("tkq,wq->wtk", shared_columns(bound), drawn)
    )


def draw_of_circle(bound: BoundModel, phi: Array, r: int, rng: np.random.Generator) -> Array:
    """Fresh draws of what circle r has for itself: random force error, set-up shift, discrepancy;
    (draws, 25) [mm]."""
    total = np.zeros((len(phi), SIZE))
    for columns, sd in private_terms(bound, phi, r):
        total = total + (sd * rng.standard_normal(sd.shape)) @ columns.T
    return total


def private_terms(bound: BoundModel, phi: Array, r: int) -> Iterator[tuple[Array, Array]]:
    """Columns (25, v) of what circle r has for itself, and the sd of their coefficients (draws,
    v)."""
    value = dict(zip(bound.hyper_prior.names, phi.T, strict=True))
    for term in bound.nuisance_columns:
        if isinstance(term, BasisNoise):
            yield np.eye(SIZE), term.sd_at(value, r)
        elif term.private:
            yield term.values[r], np.broadcast_to(term.sd_at(value), (len(phi), len(term.names)))


def pooled_draws(beta: Array, phi: Array, most: int | None = None) -> tuple[Array, Array]:
    """Draws of all chains in one row, all or evenly picked."""
    flat_beta = beta.reshape(-1, beta.shape[2])
    flat_phi = phi.reshape(-1, phi.shape[2])
    pick = np.linspace(0, len(flat_beta) - 1, min(most or len(flat_beta), len(flat_beta))).astype(
        int
    )
    return flat_beta[pick], flat_phi[pick]
