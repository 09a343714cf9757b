"""Predicted readings of new circles, and their credible intervals at every angle.

β are the p parameters: compliances, their changes with force, and geometric errors. φ are the h
hyper-parameters, such as the standard deviation of the noise. Shared nuisances are effects that are
modelled but not of interest and that are common to several tests. A circle is described by 25
Fourier coefficients of the orders 0 to 12.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from ldbb_bayes.campaign.campaign import Campaign, require_campaign
from ldbb_bayes.campaign.circular_test import CircularTest
from ldbb_bayes.campaign.run_times import after_the_others, with_listed_times
from ldbb_bayes.campaign.tested_forces import check_force
from ldbb_bayes.deprecation import renamed_keyword
from ldbb_bayes.errors import check_probability, check_seed, require
from ldbb_bayes.inference.circle_spread import draw_new_noise_factors
from ldbb_bayes.inference.coefficients import (
    ModelDraws,
    draw_from_prior,
    draw_of_circle,
    draw_shared,
    machine_coefficients,
    names_of_shared,
    shared_columns,
    shared_terms,
)
from ldbb_bayes.inference.nodes import Nodes
from ldbb_bayes.inference.posterior import campaign_of, model_draws_of
from ldbb_bayes.inference.residuals import matrix_to_harmonics, tests_in_order
from ldbb_bayes.inference.shared_draws import SharedDraws, draw_with_shared
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array

__all__ = [
    "band_um",
    "new_circles",
    "predict",
    "predict_left_out",
    "readings_drawn",
    "replicate_left_out",
]

# Largest number of posterior draws from which the readings of new circles are predicted.
_DRAWS = 4000
# The circle of a test may be predicted from the other tests. This is the number of random draws
# that are then made for each value of the hyper-parameters. A draw consists of the parameters and
# of the nuisances (effects modelled but not of interest) that are common to several tests.
_DRAWS_PER_NODE = 8
# Probability that a reading lies between the limits of `band_um`.
_BAND_PROBABILITY = 0.95


@one_blas_thread
@renamed_keyword("ci_prob", "prob")
def predict(
    posterior: xr.DataTree, plan: Campaign, *, prob: float = 0.95, seed: int = 1
) -> pd.DataFrame:
    """Return predicted readings of new circles on the machine that a posterior describes.

    The circles are predicted for the bar, balls, mount and force device of the posterior's
    campaign. The effects of the machine and of shared nuisances (effects that are modelled but not
    of interest, such as ball form) are drawn from the posterior. Effects that differ between
    circles are drawn at random for each new circle. These are the set-up shift (a shift of zero and
    centre), the discrepancy (the unexplained deviations of a circle), the random force error and
    the white noise. The scatter of set-up shift and discrepancy is learnt from the measured
    circles. Effects that do not occur in the measured circles, such as the length of the bar at
    another radius, are drawn from their prior. How the compliance of an axis changes along its
    travel is carried to circles at other places and of other radii. If the times of the tests are
    not stated, the new circles are predicted as if they were run after the measured circles. To
    predict a circle that is run between measured circles, state ``time_s`` of all tests.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample`, `load` or `average`.
    plan : Campaign
        Circles to predict; any readings in the plan are ignored.
    prob : float
        Probability of the equal-tailed interval of a reading, between 0 and 1.
    seed : int
        Seed of the random draws.

    Returns
    -------
    DataFrame
        Table with the columns test, force_N, angle_deg, mean_um, median_um, ci_low_um and
        ci_high_um, and one row per test and angle; readings are in µm.

    Raises
    ------
    InputError
        For a probability that is not between 0 and 1, a plan on another machine, a circle with a
        force below a tenth of the smallest force tested or above 1.5 times the largest, or circles
        that depend on parameters which the fit lacks.

    Examples
    --------
    >>> circle = lb.CircularTest(300.0, np.arange(0.0, 360.0, 5.0), direction="CW")
    >>> table = lb.predict(posterior, lb.Plan((circle,)))
    >>> len(table)
    72
    >>> table.columns.to_list()[3:]
    ['mean_um', 'median_um', 'ci_low_um', 'ci_high_um']
    """
    check_probability(prob)
    check_seed(seed)
    require_campaign(plan)
    measured = campaign_of(posterior)
    for test in plan.tests:
        check_force(measured, test.force_N, f"force_N of {test.label}")
    rng = np.random.default_rng(seed)
    levels = [0.5, 0.5 - 0.5 * prob, 0.5 + 0.5 * prob]
    circles = [new_circles(draws, plan, rng) for draws in model_draws_of(posterior, _DRAWS)]
    tables = []
    for test, *readings_by_model in zip(plan.tests, *circles, strict=True):
        readings_um = np.concatenate(readings_by_model) * 1e3
        median, low, high = np.quantile(readings_um, levels, axis=0)
        columns = {
            "test": test.name,
            "force_N": test.force_N,
            "angle_deg": test.angle_deg,
            "mean_um": readings_um.mean(axis=0),
            "median_um": median,
            "ci_low_um": low,
            "ci_high_um": high,
        }
        tables.append(pd.DataFrame(columns))
    return pd.concat(tables, ignore_index=True)


def new_circles(
    draws: ModelDraws, plan: Campaign, rng: np.random.Generator, *, learn_spread: bool = True
) -> Iterator[Array]:
    """Yield predicted readings of each planned test in turn [mm], shape (draws, n).

    Each posterior draw of the hyper-parameters and parameters gives one circle of n readings, with
    white noise.

    Parameters
    ----------
    draws
        Posterior draws of one model.
    plan
        Tests to predict.
    rng
        Generator of random numbers.
    learn_spread
        Whether the scatter of the new circles is learnt from the scatter of the measured circles
        (`circle_spread`). If False, the factors that multiply the noise of the new circles are
        drawn from the model's prior.
    """
    measured, planned = _bind_with_plan(draws.bound, plan)
    names = planned.hyper_prior.names
    phi = planned.hyper_prior.draw(len(draws.beta), rng)
    for column, name in enumerate(draws.bound.hyper_prior.names):
        phi[:, names.index(name)] = draws.phi[:, column]
    measured_factors = _noise_factors(draws)
    for name in planned.setting.circle:
        if learn_spread and measured_factors.size and str(name) in names:
            phi[:, names.index(str(name))] = draw_new_noise_factors(measured_factors, rng)
    coefficients = _draw_shared_of_plan(measured, planned, phi, draws.beta, rng)
    sigma = phi[:, names.index("sigma")]
    for r, test in enumerate(plan.tests):
        circle = coefficients[:, r] + draw_of_circle(planned, phi, r, rng)
        yield readings_drawn(circle, sigma, test.angles_rad(), rng)


def _noise_factors(draws: ModelDraws) -> Array:
    """Return the factors that multiply the noise of the R measured circles, shape (draws, R).

    There is one value for each circle in each posterior draw. R is zero if the model has no such
    factors.
    """
    names = draws.bound.hyper_prior.names
    factors = [str(name) for name in draws.bound.setting.circle if str(name) in names]
    return draws.phi[:, [names.index(name) for name in factors]]


def _draw_shared_of_plan(
    measured: BoundModel,
    planned: BoundModel,
    phi: Array,
    beta: Array,
    rng: np.random.Generator,
) -> Array:
    """Return random circles of planned tests, without noise [mm].

    A circle is the sum of the effects of the machine and of shared nuisances. Shared nuisances are
    effects that are modelled but not of interest and that are common to several tests. Nuisances
    that also occur in the measured tests are drawn from their posterior, all other nuisances from
    their prior. The result holds the Fourier coefficients of the circles (orders 0 to 12), shape
    (draws, tests, 25). ``measured`` and ``planned`` are the model applied to the measured and to
    the planned tests. ``phi``, shape (draws, h), holds draws of the h hyper-parameters; ``beta``,
    shape (draws, p), holds posterior draws of the p parameters.
    """
    value = dict(zip(planned.hyper_prior.names, phi.T, strict=True))
    learnt = names_of_shared(measured)
    posterior_draws = draw_shared(measured, phi, beta, rng)
    total = machine_coefficients(planned, beta)
    for term in shared_terms(planned.nuisance_columns):
        nuisances = draw_from_prior(term, value, len(beta), rng)
        for column, name in enumerate(term.names):
            if name in learnt:
                nuisances[:, column] = posterior_draws[:, learnt.index(name)]
        total = total + np.einsum("tkq,wq->wtk", term.values, nuisances)
    return total


def readings_drawn(
    coefficients: Array, sigma_mm: Array, angle_rad: Array, rng: np.random.Generator
) -> Array:
    """Return readings of circles with random white noise [mm], shape (draws, n).

    Each draw is one circle. ``coefficients``, shape (draws, 25), holds the Fourier coefficients of
    the circles (orders 0 to 12) [mm]; ``sigma_mm``, shape (draws,), holds the standard deviations
    of the white noise [mm]. ``angle_rad``, shape (n,), holds the angles of the n readings of a
    circle, and ``rng`` generates the noise.
    """
    smooth = coefficients @ basis(angle_rad).T
    return np.asarray(smooth + sigma_mm[:, None] * rng.standard_normal(smooth.shape))


class _MeasuredAndPlanned(NamedTuple):
    """One model in two forms: applied to the measured tests, and applied to the planned tests.

    The two forms have the same nuisances (effects that are modelled but not of interest).
    """

    measured: BoundModel
    planned: BoundModel


def _bind_with_plan(bound: BoundModel, plan: Campaign) -> _MeasuredAndPlanned:
    """Return a model applied to the measured tests, and the same model applied to planned tests.

    The model is first applied to all measured and planned tests together. Therefore it has the same
    nuisances (effects that are modelled but not of interest, such as ball forms and bar lengths) in
    both results. Planned tests without times follow the measured tests. ``bound`` is the model
    applied to the measured campaign; ``plan`` holds the planned tests. Raise an `InputError` if the
    planned tests are for another machine, or if they depend on parameters that the model lacks.
    """
    campaign = bound.campaign
    machine = (campaign.topology, dict(campaign.frames_mm))
    planned_machine = (plan.topology, dict(plan.frames_mm))
    require(
        planned_machine == machine,
        f"the plan must be of the posterior's machine {campaign.topology}, its frames too, got"
        f" {plan.topology}. Make the plan with the campaign's topology and frames.",
    )
    new_tests = [replace(test, name="") for test in _with_pressures_of(campaign, plan)]
    timed = with_listed_times(campaign)
    union = replace(timed, tests=(*timed.plan().tests, *after_the_others(timed, new_tests)))
    model = bound.model
    if not bound.setting.circle[0]:
        model = model.without("circle-scale")
    union_bound = BoundModel(model, union, pilot=timed, coefficients_of_pilot=True)
    unknown = ", ".join(sorted(set(union_bound.names) ^ set(bound.names)))
    require(
        not unknown,
        f"the plan must show only what the fit has, got planes or set-ups with {unknown} too. Fit"
        " with replace(campaign, foreseen=plan.tests), so that the model knows of them.",
    )
    names = [test.name for test in union.tests]
    measured = union_bound.keeping(names[: len(campaign.tests)])
    measured.reduced = bound.reduced
    return _MeasuredAndPlanned(measured, union_bound.keeping(names[len(campaign.tests) :]))


def _with_pressures_of(campaign: Campaign, plan: Campaign) -> list[CircularTest]:
    """Return planned tests without readings, with the pressures that a campaign would have.

    The regulator is that of the campaign. A pressure that follows from the force by the law of the
    plan is replaced by the one that follows by the law of the campaign. A pressure that the user
    stated otherwise is kept.
    """
    tests = []
    for test in plan.tests:
        force_N = float(test.force_N or 0.0)
        by_plan = plan.force_law.pressure_bar(force_N)
        if math.isclose(float(test.pressure_bar or 0.0), by_plan, rel_tol=1e-9):
            test = replace(test, pressure_bar=campaign.force_law.pressure_bar(force_N))
        tests.append(test.with_reading_um(None))
    return tests


def replicate_left_out(
    bound: BoundModel,
    remaining: Nodes,
    name: str,
    size: int,
    rng: np.random.Generator,
    *,
    circles_per_draw: int = 1,
) -> Array:
    """Return random circles of a test that is left out, predicted from the other tests.

    Parameters
    ----------
    bound : BoundModel
        Model applied to all tests, including the test left out.
    remaining : Nodes
        Nodes (weighted values of the hyper-parameters) of the posterior without that test.
    name : str
        Name of the test left out.
    size : int
        Number of circles.
    rng : Generator
        Generator of random numbers.
    circles_per_draw : int
        Number of circles that are predicted from the same random draw of parameters and
        hyper-parameters.

    Returns
    -------
    array, shape (size, 25)
        Fourier coefficients of the orders 0 to 12 of each circle [mm], fitted by least squares to
        readings with white noise.
    """
    r = bound.test_names.index(name)
    draws_per_node = min(_DRAWS_PER_NODE, size)
    nodes = -(-size // (draws_per_node * circles_per_draw))
    free = remaining.integral.resample(nodes, rng)
    draws = draw_with_shared(remaining.bound, free, draws_per_node, rng)
    coefficients = np.repeat(_expected_circle(bound, draws, r), circles_per_draw, axis=0)[:size]
    phi = np.repeat(draws.phi, circles_per_draw, axis=0)[:size]
    phi = _with_new_noise_factor(bound, phi, r, rng)
    factor = bound.reduced[r].factor
    sigma = phi[:, [bound.hyper_prior.names.index("sigma")]]
    noise = sigma * rng.standard_normal((size, len(factor)))
    circle = (coefficients + draw_of_circle(bound, phi, r, rng)) @ factor.T + noise
    return np.asarray(circle @ matrix_to_harmonics(bound, r).T)


def predict_left_out(
    bound: BoundModel, remaining: BoundModel, phi: Array, name: str, rng: np.random.Generator
) -> Array:
    """Return random readings of a test that is left out, for given hyper-parameters [mm].

    Each row is drawn from p(y_r | y_−r, φ), the density of the test's n readings given the readings
    of the other tests and one value of the hyper-parameters φ. If the model has a factor that
    multiplies the noise of the test, the factor is drawn from its prior. The result has the shape
    (w, n).

    Parameters
    ----------
    bound : BoundModel
        Model applied to all tests, including the test left out.
    remaining : BoundModel
        The same model applied to all other tests.
    phi : ndarray, shape (w, h)
        Values of the h hyper-parameters of ``bound``; lengths in mm.
    name : str
        Name of the test left out.
    rng : Generator
        Generator of random numbers.
    """
    r = bound.test_names.index(name)
    draws = draw_with_shared(remaining, remaining.hyper_prior.free(phi), 1, rng)
    with_new_factor = _with_new_noise_factor(bound, draws.phi, r, rng)
    circle = _expected_circle(bound, draws, r) + draw_of_circle(bound, with_new_factor, r, rng)
    sigma = with_new_factor[:, bound.hyper_prior.names.index("sigma")]
    return readings_drawn(circle, sigma, tests_in_order(bound)[r].angles_rad(), rng)


def _expected_circle(bound: BoundModel, draws: SharedDraws, r: int) -> Array:
    """Return the circle of test r without its own effects and without noise, shape (n, 25) [mm].

    The circle is given by its Fourier coefficients, for each of n draws of the parameters and of
    the nuisance coefficients (of effects that are modelled but not of interest) that act in several
    tests.
    """
    machine = draws.beta @ bound.interest_columns[r].T + bound.known_offset[r]
    return np.asarray(machine + draws.shared @ shared_columns(bound)[r].T)


def _with_new_noise_factor(
    bound: BoundModel, phi: Array, r: int, rng: np.random.Generator
) -> Array:
    """Return ``phi`` with new draws of λ, the factor that multiplies the noise of a test.

    ``phi`` and the result have the shape (n, h). ``phi`` holds n posterior draws of the h
    hyper-parameters from an analysis without the readings of the test with the index ``r``. Without
    these readings, the posterior density of λ is equal to its prior density, which has a heavy
    tail. ``phi`` contains only a few different values of λ; new draws from the prior represent the
    tail better. All other hyper-parameters are returned unchanged. If the model ``bound`` has no λ
    for this test, ``phi`` is returned unchanged.
    """
    name = str(bound.setting.circle[r])
    if name not in bound.hyper_prior.names:
        return phi
    column = bound.hyper_prior.names.index(name)
    renewed = phi.copy()
    renewed[:, column] = bound.hyper_prior.draw_noise_factor(len(phi), rng)
    return renewed


def band_um(
    coefficients: Array,
    sigma_mm: Array,
    angle_rad: Array,
    rng: np.random.Generator,
) -> Array:
    """Return the lower and upper limit of readings at every angle [µm], shape (2, angles).

    At each angle, a reading with white noise lies between the limits with the probability 95 %.
    It lies below the lower limit with the same probability as above the upper limit. The limits are
    computed from random draws of circles: ``coefficients``, shape (draws, 25), holds the Fourier
    coefficients of the circles (orders 0 to 12) [mm]; ``sigma_mm``, shape (draws,), holds the
    standard deviations of the white noise [mm]. ``angle_rad``, shape (angles,), holds the angles,
    and ``rng`` generates the noise.
    """
    readings = readings_drawn(coefficients, sigma_mm, angle_rad, rng)
    levels = [(1.0 - _BAND_PROBABILITY) / 2.0, (1.0 + _BAND_PROBABILITY) / 2.0]
    return np.quantile(readings, levels, axis=0) * 1e3
