"""Fourier coefficients of circles, predicted from posterior draws of a model's parameters.

A circle is described by 25 Fourier coefficients of the orders 0 to 12. β are the p parameters:
compliances, their changes with force, and geometric errors. φ are the h hyper-parameters, such as
the standard deviation of the noise. y are the readings. Nuisances are effects that are modelled but
not of interest: shared nuisances are common to several tests, private nuisances belong to a single
circle. There are three kinds of prediction:

- machine: the effects H β of the parameters. The matrix H holds the change of every circle per unit
  of each parameter. If the readings are not compensated for the nominal deflection of the work
  ball's mount, this deflection is added;
- shared: the machine prediction plus the effects of ball form, bar length, deflection of the mount,
  and force error. The quality of a fit (root-mean-square residual and fitness, Eq. 34-35 of the
  article on the model) is computed from this prediction;
- new circle: the shared prediction plus random effects that are drawn for the new circle: set-up
  shift (of zero and centre), discrepancy (unexplained deviations) and white noise.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from ldbb_bayes.inference.integrals import CHUNK
from ldbb_bayes.model.fourier import SIZE
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.terms import BasisNoise, Columns
from ldbb_bayes.model.terms.columns import Hyper
from ldbb_bayes.results import Array

__all__ = [
    "ModelDraws",
    "draw_from_prior",
    "draw_of_circle",
    "draw_shared",
    "draw_shared_coefficients",
    "evenly_spaced",
    "machine_coefficients",
    "mean_shared_coefficients",
    "names_of_shared",
    "new_circle_coefficients",
    "pool_draws",
    "private_terms",
    "shared_columns",
    "shared_terms",
]


class ModelDraws(NamedTuple):
    """A model applied to a campaign, and n posterior draws of the model's unknowns.

    The unknowns are the hyper-parameters (such as the standard deviation of the noise) and the
    parameters.
    """

    bound: BoundModel  #: model that is applied to a campaign
    #: n random draws of the h hyper-parameters (such as the standard deviation of the noise), shape
    #: (n, h); values that are lengths are in mm, all others are pure numbers
    phi: Array
    #: n random draws of the p parameters (compliances, their changes with force, geometric errors)
    #: in mm, N and rad, shape (n, p)
    beta: Array

    def thinned(self, size: int) -> ModelDraws:
        """Return the same model with at most ``size`` of its n posterior draws, evenly spaced."""
        chosen = evenly_spaced(len(self.phi), size)
        return ModelDraws(self.bound, self.phi[chosen], self.beta[chosen])


class PrivateTerm(NamedTuple):
    """Effect that acts on a single circle only, described by v coefficients."""

    #: change of the circle's 25 Fourier coefficients (orders 0 to 12) [mm] per unit of each of the
    #: v coefficients that describe an effect, shape (25, v)
    columns: Array
    #: standard deviations of the v coefficients of an effect on one circle, for every random draw
    #: of the hyper-parameters, shape (draws, v)
    sd: Array


def evenly_spaced(total: int, size: int) -> Array:
    """Return indices that pick at most ``size`` of ``total`` random draws, evenly spaced."""
    return np.linspace(0, total - 1, min(size, total)).astype(int)


def pool_draws(beta: Array, phi: Array, size: int | None = None) -> tuple[Array, Array]:
    """Return draws of the parameters and of the hyper-parameters, with all chains joined.

    ``beta``, shape (chains, draws, p), are draws of the p parameters; ``phi``, shape (chains,
    draws, h), are draws of the h hyper-parameters. The results have the shapes (chains × draws, p)
    and (chains × draws, h), with all draws of the first chain first. If ``size`` is not None, at
    most that many draws are returned, evenly spaced.
    """
    flat_beta = beta.reshape(-1, beta.shape[2])
    flat_phi = phi.reshape(-1, phi.shape[2])
    if size is None:
        return flat_beta, flat_phi
    chosen = evenly_spaced(len(flat_beta), size)
    return flat_beta[chosen], flat_phi[chosen]


def machine_coefficients(bound: BoundModel, beta: Array) -> Array:
    """Return the Fourier coefficients that the machine's parameters predict for each circle [mm].

    ``beta``, shape (draws, p), are draws of the p parameters (compliances, their changes with
    force, geometric errors). If the readings are not compensated for the nominal deflection of the
    work ball's mount, this deflection is included. The result holds Fourier coefficients of the
    orders 0 to 12, shape (draws, tests, 25). ``bound`` is the model of the campaign.
    """
    return np.einsum("tkp,wp->wtk", bound.interest_columns, beta) + bound.known_offset


def shared_terms(
    columns: Iterable[Columns | BasisNoise], *, private: bool = False
) -> list[Columns]:
    """Return the effects of shared nuisances or, if ``private`` is True, of private nuisances.

    Nuisances are effects that are modelled but not of interest. Shared nuisances are common to
    several tests; private nuisances belong to a single test. ``columns`` describes all nuisances of
    a model: how the readings of every test change per unit of each nuisance coefficient. Noise that
    acts on the Fourier coefficients directly (`BasisNoise`) is left out of the result.
    """
    return [term for term in columns if isinstance(term, Columns) and term.private == private]


def shared_columns(bound: BoundModel, *, private: bool = False) -> Array:
    """Return the effect of each nuisance coefficient on the Fourier coefficients of each test [mm].

    Nuisances are effects that are modelled but not of interest. Each of the q nuisance coefficients
    is the size of such an effect. The q coefficients are common to several tests or, if ``private``
    is True, belong to a single test. The result, shape (tests, 25, q), holds the change of each of
    the 25 Fourier coefficients per unit of each nuisance coefficient. ``bound`` is the model of the
    campaign.
    """
    columns = [np.zeros((len(bound.test_names), SIZE, 0))]
    columns += [term.values for term in shared_terms(bound.nuisance_columns, private=private)]
    return np.concatenate(columns, axis=2)


def draw_shared(bound: BoundModel, phi: Array, beta: Array, rng: np.random.Generator) -> Array:
    """Return random draws of the q nuisance coefficients that tests share, shape (draws, q).

    Nuisances are effects that are modelled but not of interest, such as ball form. ``beta``, shape
    (draws, p), and ``phi``, shape (draws, h), hold draws of the p parameters and of the h
    hyper-parameters. For each of these draws, all q coefficients are drawn once, conditional on the
    readings and on the parameters and hyper-parameters of the draw. ``bound`` is the model of
    the campaign.
    """
    draws = []
    for start in range(0, len(phi), CHUNK):
        chunk = slice(start, start + CHUNK)
        shifted = beta[chunk] - bound.least_squares_estimate
        draws.append(
            bound.likelihood_given_parameters.conditional(phi[chunk], shifted)[1].draw(rng)
        )
    return np.concatenate(draws)


def draw_from_prior(
    term: Columns, value: Mapping[Hyper, Array], size: int, rng: np.random.Generator
) -> Array:
    """Return ``size`` random draws of a term's v coefficients from their prior, shape (size, v).

    ``term`` describes an effect that tests share. ``value`` holds ``size`` draws of each
    hyper-parameter (such as the standard deviation of the noise), shape (size,); its keys are the
    names of the hyper-parameters.
    """
    draws = term.sd_at(value) * rng.standard_normal((size, len(term.names)))
    if term.mean is not None:
        draws = draws + term.mean
    return draws


def names_of_shared(bound: BoundModel) -> list[str]:
    """Return the names of the nuisance coefficients that tests share, in the model's order.

    Nuisances are effects that are modelled but not of interest. ``bound`` is the model of the
    campaign.
    """
    names: list[str] = []
    for term in shared_terms(bound.nuisance_columns):
        names += term.names
    return names


def mean_shared_coefficients(bound: BoundModel, phi: Array, beta: Array) -> Array:
    """Return the Fourier coefficients that posterior draws predict on average for each circle [mm].

    The prediction has no random scatter. It includes the effects of the machine, of ball form, of
    bar length, of the deflection of the mount, and of force error. Nuisances are effects that are
    modelled but not of interest. The nuisances are set to their means conditional on the readings,
    on the p parameters ``beta``, shape (draws, p), and on the h hyper-parameters ``phi``, shape
    (draws, h). The prediction depends linearly on parameters and nuisances. The average over the
    draws is therefore the prediction for their averages. The result holds Fourier coefficients of
    the orders 0 to 12, shape (tests, 25). ``bound`` is the model of the campaign.
    """
    shared_means, private_means = bound.likelihood_given_parameters.means(
        phi, beta - bound.least_squares_estimate
    )
    machine = machine_coefficients(bound, beta.mean(axis=0, keepdims=True))[0]
    shared = shared_columns(bound) @ shared_means.mean(axis=0)
    columns = shared_columns(bound, private=True)
    private_mean = private_means.mean(axis=0)[:, : columns.shape[2]]
    private = np.einsum("tkv,tv->tk", columns, private_mean)
    return np.asarray(machine + shared + private)


def new_circle_coefficients(
    bound: BoundModel, phi: Array, beta: Array, rng: np.random.Generator
) -> Array:
    """Return random draws of a new circle under the conditions of each test [mm].

    The result holds Fourier coefficients of the orders 0 to 12, shape (draws, tests, 25), without
    white noise. Nuisances are effects that are modelled but not of interest. Nuisances that are
    common to several tests are drawn from their posterior, conditional on the p parameters
    ``beta``, shape (draws, p), and on the h hyper-parameters ``phi``, shape (draws, h). Effects on
    one circle only are drawn independently of the measured circle: random force error, set-up shift
    (of zero and centre) and discrepancy (unexplained deviations). ``rng`` generates the random
    numbers. ``bound`` is the model of the campaign.
    """
    shared = draw_shared_coefficients(bound, phi, beta, rng)
    circles = [draw_of_circle(bound, phi, r, rng) for r in range(len(bound.test_names))]
    return shared + np.stack(circles, axis=1)


def draw_shared_coefficients(
    bound: BoundModel, phi: Array, beta: Array, rng: np.random.Generator
) -> Array:
    """Return the sum of the machine's effects and of random draws of effects that tests share [mm].

    Effects that tests share, such as ball form, are modelled but not of interest. They are drawn
    given the readings, the p parameters ``beta``, shape (draws, p), and the h hyper-parameters
    ``phi``, shape (draws, h). The sum is given as Fourier coefficients of the orders 0 to 12 of
    every test, shape (draws, tests, 25). ``bound`` is the model of the campaign.
    """
    nuisances = draw_shared(bound, phi, beta, rng)
    shared = np.einsum("tkq,wq->wtk", shared_columns(bound), nuisances)
    return np.asarray(machine_coefficients(bound, beta) + shared)


def draw_of_circle(bound: BoundModel, phi: Array, r: int, rng: np.random.Generator) -> Array:
    """Return random draws of the sum of all effects that act on one test only [mm].

    The effects are the random force error, the set-up shift (of zero and centre) and the
    discrepancy (unexplained deviations of the orders 2 to 12). The result holds Fourier
    coefficients of the orders 0 to 12, shape (draws, 25), for the test with the index r. ``phi``,
    shape (draws, h), holds draws of the h hyper-parameters, which are the scales of these and other
    effects. ``bound`` is the model of the campaign.
    """
    coefficients = np.zeros((len(phi), SIZE))
    for term in private_terms(bound, phi, r):
        standard = rng.standard_normal(term.sd.shape)
        coefficients = coefficients + (term.sd * standard) @ term.columns.T
    return coefficients


def private_terms(bound: BoundModel, phi: Array, r: int) -> Iterator[PrivateTerm]:
    """Yield the effects that act on one test only: force error, set-up shift, discrepancy.

    The set-up shift is a shift of the circle's zero and centre; the discrepancy consists of the
    unexplained deviations of the orders 2 to 12. r is the index of the test. ``phi``, shape (draws,
    h), holds draws of the h hyper-parameters, which are the scales of these and other effects.
    ``bound`` is the model of the campaign.
    """
    value = dict(zip(bound.hyper_prior.names, phi.T, strict=True))
    for term in bound.nuisance_columns:
        if isinstance(term, BasisNoise):
            yield PrivateTerm(np.eye(SIZE), term.sd_at(value, r))
        elif term.private:
            sd = np.broadcast_to(term.sd_at(value, r), (len(phi), len(term.names)))
            yield PrivateTerm(term.values[r], sd)
