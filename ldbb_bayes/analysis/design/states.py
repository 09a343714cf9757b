"""States of the machine before the tests of a design.

A state consists of values of the hyper-parameters φ (such as the standard deviation of the noise)
and of the parameters β (compliances, their changes with force, and geometric errors). The pilot is
the campaign or plan that a design starts from. States are drawn at random from the posterior given
the pilot's readings, or from the prior if the pilot is a plan.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from scipy.stats import qmc

from ldbb_bayes.analysis.design.named_parameters import restricted_to, unconstrained_names
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.inference.coefficients import draw_shared, names_of_shared, shared_terms
from ldbb_bayes.inference.conditional_sampling import draw_parameters_given
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.model.terms import BarLength, Drift, JointLoad, Position, Term
from ldbb_bayes.results import Array

__all__ = [
    "PossibleMachine",
    "States",
    "draw_machine_like_pilot",
    "extend_hyper_parameters",
    "hyper_nodes",
    "states_before",
]

# Posteriors of the hyper-parameters that have already been computed. The keys are the pilots
# (campaigns that designs start from); each value is a list of posteriors, one for each model. The
# posteriors are stored because their computation takes a long time.
_POSTERIORS: WeakKeyDictionary[Campaign, list[HyperPosterior]] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class States:
    """K equally likely states of the machine before the tests of a design.

    A state is one possible machine: values of its parameters and hyper-parameters. The states are
    drawn from the distribution that describes what is known before the tests.
    """

    #: values of the h hyper-parameters φ (such as the standard deviation of the noise) in each of
    #: the K states, shape (K, h). Lengths are in mm; the other hyper-parameters have no unit.
    phi: Array
    #: values of the p parameters β of the machine in each of the K states, shape (K, p), in
    #: internal units (composed of mm, N and rad). No compliance is negative. If the prior is flat,
    #: no parameters are drawn, and p = 0.
    beta: Array
    #: Gaussian density of the parameters given the hyper-parameters, before the new tests. If
    #: earlier readings are analysed together with the new tests, the density is the posterior given
    #: these readings. Otherwise, it is the prior. Compliances may be negative.
    before: Gaussian


def hyper_nodes(model: HybridModel, pilot: Campaign, size: int, seed: int) -> Array:
    """Return ``size`` equally likely values of the h hyper-parameters φ, shape (size, h).

    A hyper-parameter is, for example, the standard deviation of the noise. The pilot is the
    campaign or plan that a design starts from. If it has readings, the values are a random sample
    of the posterior of ``model`` given these readings; ``seed`` is the seed of the sample. If the
    pilot is a plan, the values are spread evenly over the prior, and their number is rounded up to
    a power of two. If the priors of the parameters are flat, the posterior variances of all
    parameters are proportional to the variance of the noise. In this case, only the root mean
    square of the values is returned, shape (1, h). Lengths are in mm; the other hyper-parameters
    have no unit.
    """
    if pilot.is_plan:
        prior = model.bind(pilot).hyper_prior
        points = qmc.Sobol(len(prior.names), rng=np.random.default_rng(seed))
        power_of_two = 1 << int(np.ceil(np.log2(size)))
        nodes = np.asarray(prior.quantile(points.random(power_of_two)))
    else:
        posterior = _hyper_posterior(model, pilot)
        free = posterior.coarse_integral_truncated.resample(size, np.random.default_rng(seed))
        nodes = posterior.bound.hyper_prior.phi(free)
    if model.prior.flat:
        return np.sqrt((nodes**2).mean(axis=0, keepdims=True))
    return nodes


def extend_hyper_parameters(
    bound: BoundModel, phi: Array, tests_run: int, *, scattering: bool = False
) -> Array:
    """Return the hyper-parameters of a model applied to the circles run so far and to new circles.

    The pilot is the campaign that a design starts from. Its hyper-parameters φ are completed with
    those of the new circles. Each new circle has a noise factor λ, by which the noise of this
    circle is multiplied. λ is set to 1, because the prior mean of 1/λ² is 1. If ``scattering`` is
    true, λ gets values spread evenly over its prior instead. All other hyper-parameters that the
    pilot does not have always get values spread evenly over their priors. Lengths are in mm; the
    other hyper-parameters have no unit.

    Parameters
    ----------
    bound
        Model applied to the circles run so far, followed by the new circles.
    phi
        K values of the pilot's φ, shape (K, h).
    tests_run
        Number of the pilot's circles that ``bound`` includes.
    scattering
        Whether the noise factors λ of the new circles differ, as they do under the prior. Default:
        λ is 1 for all new circles.

    Returns
    -------
    Array
        K values of the H hyper-parameters of ``bound``, shape (K, H).
    """
    pilot = bound.pilot or bound.campaign
    pilot_bound = bound
    if pilot is not bound.campaign:
        pilot_bound = _hyper_posterior(bound.model, pilot).bound
    pilot_column = {name: k for k, name in enumerate(pilot_bound.hyper_prior.names)}
    # The noise of each circle that has already been run is multiplied by a factor λ. ``bound`` is
    # the model of these circles and the new ones together; ``circles_run`` holds the names of the
    # factors in ``bound``. In the model of the pilot (the campaign that the design starts from),
    # the same factor may have another name.
    circles_run = bound.setting.circle[:tests_run].tolist()
    pilot_circle = dict(zip(circles_run, pilot_bound.setting.circle.tolist(), strict=False))

    # First, every hyper-parameter gets values spread evenly over its prior, in random order. The
    # values of hyper-parameters that the pilot (the campaign that the design starts from) also has
    # are then replaced by those of the pilot. Unless ``scattering`` is true, the factors λ of the
    # new circles are replaced by 1. The noise of a circle is multiplied by its λ.
    hyper_prior = bound.hyper_prior
    nodes = len(phi)
    even_levels = np.tile((np.arange(nodes) + 0.5) / nodes, (len(hyper_prior.names), 1))
    levels = np.random.default_rng(0).permuted(even_levels, axis=1)
    extended = hyper_prior.quantile(levels.T)
    for k, (name, law) in enumerate(zip(hyper_prior.names, hyper_prior.laws, strict=True)):
        is_circle = law == "circle"
        pilot_name = pilot_circle.get(name, "") if is_circle else name
        if pilot_name in pilot_column:
            extended[:, k] = phi[:, pilot_column[pilot_name]]
        elif is_circle and not scattering:
            extended[:, k] = 1.0
    return extended


def states_before(
    model: HybridModel, pilot: Campaign, size: int, seed: int, *, augment: bool
) -> States:
    """Return random draws of the machine's state before the tests of a design.

    A state consists of values of the hyper-parameters φ and of the parameters β. States are drawn
    from the posterior given the pilot's readings. If the pilot is a plan, they are drawn from the
    prior.

    Parameters
    ----------
    model
        Model whose parameters the tests are to determine.
    pilot
        Campaign that has already been run, or plan, from which the design starts.
    size
        Number of states.
    seed
        Seed of the random numbers.
    augment
        Whether the new tests are analysed together with the pilot's readings. The density p(β | φ)
        is then the posterior given these readings, not the prior.

    Returns
    -------
    States
        Values of φ and β, and the density p(β | φ) before the new tests.
    """
    bound = model.bind(pilot)
    rng = np.random.default_rng(seed)
    phi = hyper_nodes(model, pilot, size, seed)
    nodes = len(phi)
    p = len(bound.names)
    if model.prior.flat:
        no_information = Gaussian(np.zeros((nodes, p, p)), np.zeros((nodes, p)))
        return States(phi, np.zeros((nodes, 0)), no_information)
    if pilot.is_plan:
        beta = bound.parameter_prior.draw(nodes, rng)
    else:
        posterior = _hyper_posterior(model, pilot)
        beta = draw_parameters_given(posterior.bound, bound.hyper_prior.free(phi), rng)
    if augment and not pilot.is_plan:
        posterior_given_phi = bound.given(phi).parameters
        before = Gaussian.factored(
            posterior_given_phi.mean, posterior_given_phi.root, posterior_given_phi.scale
        )
        return States(phi, beta, before)
    prior_mean = np.broadcast_to(bound.prior_mean, (nodes, p))
    prior_variance = np.broadcast_to(bound.prior_sd**2, (nodes, p))
    return States(phi, beta, Gaussian.of(prior_mean, prior_variance))


class PossibleMachine(NamedTuple):
    """Parameters and hyper-parameters of one machine that the readings of a pilot leave likely."""

    #: compliances, their changes with force, and geometric errors, in internal units (mm, N, rad);
    #: the keys are the names of the parameters
    parameters: dict[str, float]
    #: hyper-parameters, such as the standard deviation of the noise, with lengths in µm; the keys
    #: are their names. Noise factors of single circles are left out.
    hyper_um: dict[str, float]
    #: coefficients of effects that tests have in common, such as the load on the joints, in
    #: internal units; the keys are their names. Those that may differ on another day are left out.
    effects: dict[str, float]


def draw_machine_like_pilot(
    model: HybridModel, plan: Campaign, seed: int
) -> PossibleMachine | None:
    """Draw a machine at random from the posterior given the readings of a plan's pilot.

    The pilot is the campaign from which the plan was designed. Parameters of the plan that the
    pilot lacks are drawn from the prior; those of the pilot that the plan lacks are left out.
    Effects that tests have in common are drawn, too, because the compliance at a force depends on
    them. Drift is left out, because the planned circles are simulated as if it began with them, and
    so is the length of the bar if the plan is not run together with the pilot. Both are then to be
    drawn from their priors. The result is None if the plan has no pilot with readings, or if the
    priors are flat. ``seed`` is the seed of the random numbers.
    """
    pilot = plan.pilot
    if pilot is None or pilot.is_plan or model.prior.flat:
        return None
    of_plan = model.bind_to_simulate(plan)
    # Compliances are those at the reference force of the plan, for which readings are simulated.
    at_force = replace(model, reference_force_N=of_plan.setting.reference_force_N)
    pilot_model = restricted_to(at_force, unconstrained_names(at_force, pilot))
    of_pilot = pilot_model.bind(pilot)
    state = states_before(pilot_model, pilot, 1, seed, augment=False)
    named = of_pilot.hyper_prior.display_values(state.phi[0])
    hyper_um = {}
    for name, law in zip(of_pilot.hyper_prior.names, of_pilot.hyper_prior.laws, strict=True):
        if law != "circle" and name in of_plan.hyper_prior.names:
            hyper_um[name] = named[name]
    like_pilot = dict(zip(of_pilot.names, state.beta[0].tolist(), strict=True))
    parameters = {name: like_pilot[name] for name in of_plan.names if name in like_pilot}
    if len(parameters) < len(of_plan.names):
        from_prior = of_plan.draw_machine(np.random.default_rng([seed, 1]))
        parameters = dict(zip(of_plan.names, from_prior.tolist(), strict=True)) | parameters
    effects = _effects_like_pilot(of_pilot, of_plan, state, np.random.default_rng([seed, 2]))
    return PossibleMachine(parameters, hyper_um, effects)


def _effects_like_pilot(
    of_pilot: BoundModel, of_plan: BoundModel, state: States, rng: np.random.Generator
) -> dict[str, float]:
    """Draw effects that tests have in common, given the pilot's readings and one state.

    The result holds the coefficients that ``of_pilot`` and ``of_plan`` have both, by name. Drift is
    left out, and so is the length of the bar if the plan is not run together with the pilot.
    Coefficients of joint load and position are scaled by the largest force and the smallest radius
    of a campaign. If those of the plan differ, they are converted so that they have the same effect
    on the planned circles.
    """
    (drawn,) = draw_shared(of_pilot, state.phi, state.beta, rng)
    value_of = dict(zip(names_of_shared(of_pilot), drawn.tolist(), strict=True))
    for name, ratio in _ratios_of_scale(of_pilot, of_plan).items():
        if name in value_of:
            value_of[name] *= ratio
    effects: dict[str, float] = {}
    left_out: tuple[type[Term], ...] = (Drift, BarLength)
    if of_plan.campaign.adds_to_pilot:
        left_out = (Drift,)
    for term, columns_of_term in of_plan.columns_of.items():
        if issubclass(term, left_out):
            continue
        for columns in shared_terms(columns_of_term):
            effects |= {name: value_of[name] for name in columns.names if name in value_of}
    return effects


def _ratios_of_scale(of_pilot: BoundModel, of_plan: BoundModel) -> dict[str, float]:
    """Return by how much larger some coefficients are in a plan than in its pilot, by name.

    They are the coefficients of joint load and position. Both have the same effect on the planned
    circles. A coefficient without effect on these is left out.
    """
    as_in_pilot = BoundModel(
        of_pilot.model, of_plan.campaign, pilot=of_pilot.campaign, coefficients_of_pilot=True
    )
    effects_in_pilot = _effects_by_name(as_in_pilot)
    ratios = {}
    for name, effect in _effects_by_name(of_plan).items():
        size = float((effect**2).sum())
        if name in effects_in_pilot and size > 0.0:
            ratios[name] = float((effect * effects_in_pilot[name]).sum()) / size
    return ratios


def _effects_by_name(bound: BoundModel) -> dict[str, Array]:
    """Return the effect of each coefficient of joint load and position on the readings, by name.

    An effect, shape (tests, 25), holds the change of the readings per unit of the coefficient, as
    Fourier coefficients.
    """
    effects: dict[str, Array] = {}
    for term, columns_of_term in bound.columns_of.items():
        if issubclass(term, JointLoad | Position):
            for columns in shared_terms(columns_of_term):
                values = np.moveaxis(columns.values, 2, 0)
                effects |= dict(zip(columns.names, values, strict=True))
    return effects


def _hyper_posterior(model: HybridModel, pilot: Campaign) -> HyperPosterior:
    """Return the posterior of the hyper-parameters given the pilot's readings.

    The pilot is the campaign that a design starts from. The posterior is computed only once for
    each model and pilot.
    """
    posteriors = _POSTERIORS.setdefault(pilot, [])
    for posterior in posteriors:
        if posterior.bound.model == model:
            return posterior
    bound = model.bind(pilot)
    posterior = HyperPosterior(bound, truncated=bound.truncation.active)
    posteriors.append(posterior)
    return posterior
