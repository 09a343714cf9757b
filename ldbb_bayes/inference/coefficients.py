"""Predicted circles as basis coefficients, from random draws of the parameters of a model.

The 25 basis coefficients of a circle are its harmonics of the orders 0 to 12. β are the p
parameters: compliances, their slopes and geometric errors. φ are the h hyper-parameters, the scales
of the noise and of other effects. y are the readings. Nuisances are effects that are modelled but
not of interest: shared ones are common to several tests, private ones belong to a single circle.
There are three kinds of prediction:

- machine: H β, where the matrix H holds the effect of each parameter on each circle;
- shared: the machine plus ball form, bar length, mount and force error. Root-mean-square residual
  and fitness (Eq. 34-35 of the paper) refer to this prediction;
- new circle: the shared prediction plus set-up shift, discrepancy and white noise, drawn anew.
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
    """Model bound to a campaign, and n random draws of its hyper-parameters and parameters."""

    bound: BoundModel
    phi: Array  #: n random draws of h hyper-parameters [mm], shape (n, h)
    beta: Array  #: n random draws of p parameters, shape (n, p)

    def thinned(self, size: int) -> ModelDraws:
        """Return at most ``size`` of the random draws, evenly spaced."""
        chosen = evenly_spaced(len(self.phi), size)
        return ModelDraws(self.bound, self.phi[chosen], self.beta[chosen])


class PrivateTerm(NamedTuple):
    """An effect on one circle only, with v coefficients that are drawn anew for every circle."""

    #: Fourier coefficients of the circle per unit of each of v coefficients [mm], shape (25, v)
    columns: Array
    sd: Array  #: standard deviations of the v coefficients, shape (draws, v)


def evenly_spaced(total: int, size: int) -> Array:
    """Return at most ``size`` indices, evenly spaced from 0 to ``total`` − 1."""
    return np.linspace(0, total - 1, min(size, total)).astype(int)


def pool_draws(beta: Array, phi: Array, size: int | None = None) -> tuple[Array, Array]:
    """Return the draws of all chains in one array for β and one for φ, shape (draws, variables).

    β are parameters and φ hyper-parameters, given in the shape (chains, draws, variables). If
    ``size`` is given, at most that many draws are returned, evenly spaced.
    """
    flat_beta = beta.reshape(-1, beta.shape[2])
    flat_phi = phi.reshape(-1, phi.shape[2])
    if size is None:
        return flat_beta, flat_phi
    chosen = evenly_spaced(len(flat_beta), size)
    return flat_beta[chosen], flat_phi[chosen]


def machine_coefficients(bound: BoundModel, beta: Array) -> Array:
    """Return what the machine's parameters predict for each circle [mm].

    ``beta``, shape (draws, p), are draws of the parameters. The nominal deflection of the mount is
    included. The result holds Fourier coefficients of the orders 0 to 12, shape (draws, tests, 25).
    """
    return np.einsum("tkp,wp->wtk", bound.interest, beta) + bound.known_offset


def shared_terms(
    columns: Iterable[Columns | BasisNoise], *, private: bool = False
) -> list[Columns]:
    """Return the columns of nuisances that tests share or, if ``private``, of those of one test.

    A column holds the effect of one nuisance coefficient on every circle.
    """
    return [term for term in columns if isinstance(term, Columns) and term.private == private]


def shared_columns(bound: BoundModel, *, private: bool = False) -> Array:
    """Return the columns that `shared_terms` returns as one array [mm], shape (tests, 25, q).

    It holds the effects of q nuisance coefficients on the 25 Fourier coefficients of every test.
    """
    columns = [np.zeros((len(bound.test_names), SIZE, 0))]
    columns += [term.values for term in shared_terms(bound.nuisance_columns, private=private)]
    return np.concatenate(columns, axis=2)


def draw_shared(bound: BoundModel, phi: Array, beta: Array, rng: np.random.Generator) -> Array:
    """Return random draws of the q nuisance coefficients that tests share, shape (draws, q).

    One is drawn for each draw of the parameters β and hyper-parameters φ, given these and the
    readings.
    """
    draws = []
    for start in range(0, len(phi), CHUNK):
        chunk = slice(start, start + CHUNK)
        shifted = beta[chunk] - bound.centre
        draws.append(bound.given_interest.conditional(phi[chunk], shifted)[1].draw(rng))
    return np.concatenate(draws)


def compliance_curves(
    bound: BoundModel, phi: Array, beta: Array, force_N: Array, rng: np.random.Generator
) -> Array:
    """Return the compliances C(F) at n forces F, shape (draws, n, compliances).

    C(F) follows from C and its slopes, for each draw of the parameters β and hyper-parameters φ.
    C(F) of a machine axis is its deflection divided by the bar force along it. It includes what the
    term `JointLoad` adds, which is drawn at random given β, φ and the readings.
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
    """Return the prediction for each circle without scatter, from draws of the parameters [mm].

    It includes the machine, ball form, bar length, mount and force error. The nuisances are at
    their means given the parameters β, the hyper-parameters φ and the readings. The result are
    Fourier coefficients, shape (draws, tests, 25).
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
    """Return random draws of a new circle under the conditions of every test [mm].

    The result holds Fourier coefficients, shape (draws, tests, 25), without white noise. Nuisances
    that tests share are drawn from their posterior given the parameters β and hyper-parameters φ.
    Random force error, set-up shift and discrepancy are drawn anew.
    """
    shared = draw_shared_coefficients(bound, phi, beta, rng)
    circles = [draw_of_circle(bound, phi, r, rng) for r in range(len(bound.test_names))]
    return shared + np.stack(circles, axis=1)


def draw_shared_coefficients(
    bound: BoundModel, phi: Array, beta: Array, rng: np.random.Generator
) -> Array:
    """Return the machine's effects plus random draws of nuisances that tests share [mm].

    The nuisances are drawn given the parameters β, the hyper-parameters φ and the readings. The
    result are Fourier coefficients, shape (draws, tests, 25).
    """
    nuisances = draw_shared(bound, phi, beta, rng)
    shared = np.einsum("tkq,wq->wtk", shared_columns(bound), nuisances)
    return np.asarray(machine_coefficients(bound, beta) + shared)


def draw_of_circle(bound: BoundModel, phi: Array, r: int, rng: np.random.Generator) -> Array:
    """Return random draws of the effects that act on test r only, shape (draws, 25) [mm].

    These are random force error, set-up shift and discrepancy, as Fourier coefficients. ``phi`` are
    draws of the hyper-parameters.
    """
    coefficients = np.zeros((len(phi), SIZE))
    for term in private_terms(bound, phi, r):
        standard = rng.standard_normal(term.sd.shape)
        coefficients = coefficients + (term.sd * standard) @ term.columns.T
    return coefficients


def private_terms(bound: BoundModel, phi: Array, r: int) -> Iterator[PrivateTerm]:
    """Yield the effects that act on test r only: force error, set-up shift, discrepancy.

    ``phi`` are draws of the hyper-parameters, which hold the scales of these effects.
    """
    value = dict(zip(bound.hyper_prior.names, phi.T, strict=True))
    for term in bound.nuisance_columns:
        if isinstance(term, BasisNoise):
            yield PrivateTerm(np.eye(SIZE), term.sd_at(value, r))
        elif term.private:
            sd = np.broadcast_to(term.sd_at(value), (len(phi), len(term.names)))
            yield PrivateTerm(term.values[r], sd)
