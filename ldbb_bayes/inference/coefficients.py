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

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ldbb_bayes.inference.integrals import CHUNK
from ldbb_bayes.machine.chain import LINEAR
from ldbb_bayes.model.fourier import SIZE
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.terms import BasisNoise, Columns, JointLoad
from ldbb_bayes.model.terms.columns import Hyper
from ldbb_bayes.model.terms.joints import joint_load_columns
from ldbb_bayes.results import Array

__all__ = [
    "ElasticDraws",
    "ModelDraws",
    "compliance_curves",
    "draw_from_prior",
    "draw_of_circle",
    "draw_shared",
    "draw_shared_coefficients",
    "elastic_draws",
    "elastic_draws_with",
    "evenly_spaced",
    "joint_load_circles",
    "joint_load_secants",
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


class ElasticDraws(NamedTuple):
    """Posterior draws of compliances C(F) and of deflections along the bar, at n bar forces F."""

    #: draws of the compliances C(F) at n bar forces F, shape (draws, n, compliances) [mm/N, rad/N,
    #: rad/(N mm)]
    compliances: Array
    #: draws of the elastic deflection along the bar divided by the bar force [mm/N], shape (draws,
    #: circles, n, 25). The deflection of a circle at one of n bar forces is described by 25 Fourier
    #: coefficients.
    per_force: Array


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
    return np.einsum("tkp,wp->wtk", bound.interest, beta) + bound.known_offset


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
        shifted = beta[chunk] - bound.centre
        draws.append(bound.given_interest.conditional(phi[chunk], shifted)[1].draw(rng))
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


def compliance_curves(
    bound: BoundModel, phi: Array, beta: Array, force_N: Array, rng: np.random.Generator
) -> Array:
    """Return the compliances C(F) at n bar forces F, shape (draws, n, compliances).

    ``force_N``, shape (n,), holds the forces [N]. C(F) is computed from the compliance at the
    reference force and from its change with force. There is one curve for each draw of the p
    parameters ``beta``, shape (draws, p), and of the h hyper-parameters ``phi``, shape (draws, h).
    The direct compliance of a machine axis is the deflection of the axis divided by the bar force
    along the axis. If the model has the term `JointLoad` (joints that deflect under their own
    load), the direct compliances include the contribution of this term. The coefficients of the
    term are then drawn at random, conditional on the parameters, the hyper-parameters and the
    readings. ``bound`` is the model of the campaign.
    """
    return elastic_draws(ModelDraws(bound, phi, beta), (), force_N, rng).compliances


def elastic_draws(
    draws: ModelDraws, circles: Sequence[int], force_N: Array, rng: np.random.Generator
) -> ElasticDraws:
    """Return posterior draws of compliances and of the elastic deflection around circles.

    If the model has the term `JointLoad` (joints that deflect under their own load), compliances
    and deflections both include the contribution of this term. The coefficients of the term are
    drawn at random, conditional on the parameters, the hyper-parameters and the readings.
    Compliances and deflections are computed from the same draws of these coefficients.

    Parameters
    ----------
    draws
        Posterior draws of a model.
    circles
        Indices of the tests for whose circles the deflection is returned.
    force_N
        The n forces F of the bar, shape (n,), none of them zero [N]. Forces other than those tested
        are allowed.
    rng
        Generator of the random draws.

    Returns
    -------
    ElasticDraws
    """
    shared = np.zeros((len(draws.beta), 0))
    if _joint_load_of(draws.bound) is not None:
        shared = draw_shared(draws.bound, draws.phi, draws.beta, rng)
    return elastic_draws_with(shared, draws, circles, force_N)


def elastic_draws_with(
    shared: Array, draws: ModelDraws, circles: Sequence[int], force_N: Array
) -> ElasticDraws:
    """Return draws of compliances and elastic deflections, for given nuisance coefficients.

    The function does the same as `elastic_draws`, but takes the coefficients of the shared
    nuisances as an argument instead of drawing them. Shared nuisances are effects that are modelled
    but not of interest and that are common to several tests. ``shared``, shape (draws, q), holds q
    coefficients of these nuisances for each draw. The coefficients are used only if the model has
    the term `JointLoad` (joints that deflect under their own load). The other arguments are the
    same as in `elastic_draws`.
    """
    bound = draws.bound
    at_forces = np.stack([bound.compliance_at(force) for force in force_N])
    compliances = np.einsum("fcp,wp->wfc", at_forces, draws.beta)
    elastic = bound.setting.elastic[list(circles)]
    per_force = np.einsum("rkc,wfc->wrfk", elastic, compliances)
    joint_load = _joint_load_of(bound)
    if joint_load is None:
        return ElasticDraws(compliances, per_force)
    names = names_of_shared(bound)
    secants = joint_load.secants(bound.setting, force_N)
    columns_by_axis = joint_load_columns(bound.setting, bound.columns_of[type(joint_load)])
    for index, compliance in enumerate(bound.compliances):
        if compliance.kind != "direct" or compliance.twist not in columns_by_axis:
            continue
        along_axis = [names.index(name) for name in columns_by_axis[compliance.twist].names]
        of_axis = shared[:, along_axis]
        compliances[:, :, index] += of_axis @ secants.T
        axis = LINEAR.index(compliance.twist)
        for k, r in enumerate(circles):
            deflections = joint_load.deflections(bound.setting, axis, r, force_N)
            added = deflections / force_N[:, None, None]
            per_force[:, k] += np.einsum("fkl,wl->wfk", added, of_axis)
    return ElasticDraws(compliances, per_force)


def joint_load_circles(
    draws: ModelDraws, r: int, force_N: float, rng: np.random.Generator
) -> dict[str, Array]:
    """Return posterior draws of what `JointLoad` adds to each direct compliance around one circle.

    The keys of the result are the names of the direct compliances. Each value holds the Fourier
    coefficients of the deflection that is added to that of the compliance, shape (draws, 25) [mm].
    The result is empty if the model has no such term. ``r`` is the index of the test whose circle
    is run, and ``force_N`` the force of the bar [N].
    """
    bound = draws.bound
    joint_load = _joint_load_of(bound)
    if joint_load is None:
        return {}
    shared = draw_shared(bound, draws.phi, draws.beta, rng)
    names = names_of_shared(bound)
    columns_by_axis = joint_load_columns(bound.setting, bound.columns_of[type(joint_load)])
    circles = {}
    for compliance in bound.compliances:
        if compliance.kind == "direct" and compliance.twist in columns_by_axis:
            along_axis = [names.index(name) for name in columns_by_axis[compliance.twist].names]
            axis = LINEAR.index(compliance.twist)
            (deflections,) = joint_load.deflections(bound.setting, axis, r, np.array([force_N]))
            circles[compliance.label] = shared[:, along_axis] @ deflections.T
    return circles


def joint_load_secants(bound: BoundModel, force_N: float) -> dict[str, dict[str, float]]:
    """Return by how much the coefficients of `JointLoad` change direct compliances at a force.

    The keys of the result are the names of the direct compliances; the keys of each value are the
    names of the coefficients. The result is empty if the model has no such term, or if ``force_N``
    [N] is the reference force, at which the term changes no compliance. ``bound`` is the model of
    the campaign.
    """
    setting = bound.setting
    joint_load = _joint_load_of(bound)
    if joint_load is None or force_N == setting.reference_force_N:
        return {}
    (secants,) = joint_load.secants(setting, np.array([force_N])).tolist()
    columns_by_axis = joint_load_columns(setting, bound.columns_of[type(joint_load)])
    changes = {}
    for compliance in bound.compliances:
        if compliance.kind == "direct" and compliance.twist in columns_by_axis:
            names = columns_by_axis[compliance.twist].names
            changes[compliance.label] = dict(zip(names, secants, strict=True))
    return changes


def _joint_load_of(bound: BoundModel) -> JointLoad | None:
    """Return the term of a model for joints that deflect under their own load.

    The result is None if the model has no such term. ``bound`` is the model of a campaign.
    """
    for term in bound.model.nuisances:
        if isinstance(term, JointLoad):
            return term
    return None


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
    shared_means, private_means = bound.given_interest.means(phi, beta - bound.centre)
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
