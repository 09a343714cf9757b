"""Design of the next campaign: its forces, its number of circles and its clockings.

The pilot is the campaign or plan that a design starts from. Candidates are the tests from which a
design is chosen; each can be run once or several times. A clocking is the pair of angles by which
the two balls are turned. A criterion, such as the expected information gain, measures how good a
design is. `design_result` explains the other terms.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import overload

import numpy as np

from ldbb_bayes.analysis.aliases import Degeneracy, degeneracies
from ldbb_bayes.analysis.cures import Cure, cures
from ldbb_bayes.analysis.design.analysis_model import analysis_model
from ldbb_bayes.analysis.design.bound_plans import bind_tests
from ldbb_bayes.analysis.design.candidates import Clocking
from ldbb_bayes.analysis.design.costs import Costs
from ldbb_bayes.analysis.design.design_result import (
    Certificate,
    Design,
    Judged,
    Limits,
    Pilot,
    Planned,
)
from ldbb_bayes.analysis.design.forecast import Forecast
from ldbb_bayes.analysis.design.goal_design import design_for_goals
from ldbb_bayes.analysis.design.goal_design_result import GoalDesign
from ldbb_bayes.analysis.design.goals import USUAL_PROBABILITY, Goal
from ldbb_bayes.analysis.design.search import MAX_TESTS, ExactDesign
from ldbb_bayes.analysis.design.shares import Optimum
from ldbb_bayes.analysis.design.simulated_analyses import states_of
from ldbb_bayes.analysis.design.space import CriterionName, Space
from ldbb_bayes.campaign.campaign import (
    Campaign,
    CircularTest,
    Direction,
    distinct_forces,
    require_campaign,
)
from ldbb_bayes.errors import InputError, check_seed, require, require_whole
from ldbb_bayes.model.hybrid import BoundModel, HybridModel, require_model
from ldbb_bayes.model.terms import Drift, Hysteresis
from ldbb_bayes.parallel import one_blas_thread

__all__ = ["design"]

# Relative tolerance when shares are tested for optimality. The share of a candidate test is its
# number of runs divided by the number of all runs. The sensitivity of a candidate test is the
# derivative of the design criterion with respect to its share. The shares are optimal if no
# sensitivity is larger than the mean of all sensitivities, weighted by the shares.
_CERTIFICATE_TOLERANCE = 1e-4
# Candidate tests whose share (number of runs divided by the number of all runs) is below this
# number are left out of the table of the best shares.
_LISTED_SHARE = 1e-4
# Further circles are said to be of little use for a parameter if its standard uncertainty after
# very many runs of every circle would still exceed this fraction of the standard uncertainty that
# is expected from the design.
_STUCK_SHARE = 0.8
# Default step between the force levels that a design chooses from [N].
_FORCE_STEP_N = 1.0
# Default clocking: the balls are not turned.
_NOT_TURNED: tuple[Clocking, ...] = ((0.0, 0.0),)
_EQUAL_STEPS = "equal steps"
_RESERVED_NAMES = ("recommended", _EQUAL_STEPS)


@overload
def design(
    model: HybridModel,
    pilot: Campaign,
    *,
    tests: int | None = None,
    forces_N: Sequence[float] | None = None,
    clockings_deg: Sequence[Clocking] | None = None,
    radii_mm: Sequence[float] = (),
    directions: Sequence[Direction] = (),
    criterion: CriterionName | None = None,
    parameters: Sequence[str] = (),
    augment: bool = False,
    against: Mapping[str, Campaign] = MappingProxyType({}),
    slope_size: float = 1.0,
    seed: int = 1,
    goals: None = None,
) -> Design: ...


@overload
def design(
    model: HybridModel,
    pilot: Campaign,
    *,
    forces_N: Sequence[float] | None = None,
    clockings_deg: Sequence[Clocking] | None = None,
    radii_mm: Sequence[float] = (),
    directions: Sequence[Direction] = (),
    augment: bool = False,
    seed: int = 1,
    goals: Mapping[str, str | float | Goal],
    costs: Costs | None = None,
    certificates: Mapping[str, float] = MappingProxyType({}),
    probability: float = USUAL_PROBABILITY,
    progress: Callable[[int, int], None] | None = None,
) -> GoalDesign: ...


@one_blas_thread
def design(
    model: HybridModel,
    pilot: Campaign,
    *,
    tests: int | None = None,
    forces_N: Sequence[float] | None = None,
    clockings_deg: Sequence[Clocking] | None = None,
    radii_mm: Sequence[float] = (),
    directions: Sequence[Direction] = (),
    criterion: CriterionName | None = None,
    parameters: Sequence[str] = (),
    augment: bool = False,
    against: Mapping[str, Campaign] = MappingProxyType({}),
    slope_size: float = 1.0,
    seed: int = 1,
    goals: Mapping[str, str | float | Goal] | None = None,
    costs: Costs | None = None,
    certificates: Mapping[str, float] = MappingProxyType({}),
    probability: float = USUAL_PROBABILITY,
    progress: Callable[[int, int], None] | None = None,
) -> Design | GoalDesign:
    """Return the best tests to run next or, with goals, the cheapest campaigns for these goals.

    The pilot is the campaign or plan that the design starts from. Everything is computed for the
    linear Gaussian model and averaged over the hyper-parameters (such as the standard deviation of
    the noise): over their posterior given the pilot's readings, or over their prior if the pilot is
    a plan. The expected standard deviations account for the condition that compliances are not
    negative. The criteria, and the expected evidence about slopes, ignore this condition. The
    reference force F0, the force range and the estimate Ĉ of the compliances about which the model
    is linearised are those of the pilot. To analyse the tests of the design, use the attribute
    ``model`` of the design: this model uses the same values.

    Parameters
    ----------
    model : HybridModel
        Model whose parameters the tests are to determine.
    pilot : Campaign
        Campaign that has already been run, or plan, from which the design starts.
    tests : int, optional
        Number of circles to run, at most 300. Default: as many as the pilot has.
    forces_N : sequence of float, optional
        Force levels to choose from [N]. Default: the pilot's range in steps of 1 N.
    clockings_deg : sequence of pair of float
        Clockings to choose from: angles by which the work ball and the tool ball are turned [°].
        Default: balls not turned; with goals, also both balls turned by 45°.
    radii_mm : sequence of float
        Radii to choose from [mm]. Default: as in the pilot.
    directions : sequence of {"CW", "CCW"}
        Directions of travel to choose from. Default: as in the pilot. If both directions may be
        chosen, the model always includes hysteresis. With goals, the default is both directions if
        the pilot states its directions.
    criterion : {"eig", "d", "a", "c", "i", "discriminate"}, optional
        Criterion to optimize. ``eig``: expected information gain. ``d``: determinant of the
        covariance of the parameters. ``a``: sum of their variances. ``c``: variance of one
        parameter. ``i``: mean variance of the compliances C(F). ``discriminate``: evidence about
        the slopes. Default: ``eig`` with proper priors, ``d`` with flat priors.
    parameters : sequence of str
        Names of the parameters of interest; all other parameters are nuisance parameters. Default:
        all parameters that the criterion can be applied to.
    augment : bool
        Whether the new tests are analysed together with the tests of the pilot. If true, ``tests``
        is the number of new tests.
    against : mapping of str to Campaign
        Campaigns or plans that are compared with the design; the keys are names for them.
    slope_size : float
        Root mean square of the slopes (changes of compliance with force) that the tests are to
        detect, in prior standard deviations.
    seed : int
        Seed of the random numbers for the search and for the forecast.
    goals : mapping of str to str, float or Goal, optional
        Largest expanded uncertainties U (k = 2); the keys are the names of the parameters, as in
        {"C_XXX": "5 %", "E_C0YX": "10 µrad"}; numbers are in internal units (mm, N, rad). The goals
        then determine the number of circles, and ``tests``, ``criterion``, ``parameters``,
        ``against`` and ``slope_size`` must not be given.
    costs : Costs, optional
        With goals: machine times, and the price of machine time. Default: 3 min for a circle, 15
        min for a set-up and 5 min for a turn of the balls; 60 units of money for an hour.
    certificates : mapping of str to float
        With goals: prices of certificates that could be bought, such as {"balls G10": 300.0, "bar":
        150.0}. The other names are "work ball G10", "tool ball G10", "mount" (its compliance),
        "force" and "angle".
    probability : float
        With goals: minimum share of the possible machines on which all goals are to be met.
        Possible machines are drawn from the posterior given the pilot's readings, or from the prior
        if the pilot is a plan.
    progress : callable, optional
        With goals: function that is called with the number of steps done and the number of all
        steps. Steps are the search for each of three campaigns, the forecast of each of them, and
        the comparison with each of two customary campaigns (one in equal steps of force, one with
        the forces of the published experiment).

    Returns
    -------
    Design or GoalDesign
        Recommended tests and their forecast; with goals, the cheapest campaigns.

    Raises
    ------
    InputError
        For numbers out of range or unknown names. The error is also raised if a campaign in
        ``against`` belongs to another machine, if the model or the criterion does not suit the
        parameters, or if the tests do not determine all parameters.

    Examples
    --------
    >>> model = lb.HybridModel.first(0)
    >>> best = lb.design(model, campaign, tests=3, forces_N=(36.0, 742.0))
    >>> best.table["force_N"].to_list(), best.table["count"].to_list()
    ([36.0, 742.0], [1, 2])
    """
    require_model(model)
    require_campaign(pilot)
    if pilot.is_plan and pilot.pilot is not None:
        # If the pilot is itself a plan that starts from an earlier campaign, use that campaign as
        # the pilot, because the plan has no readings of its own.
        pilot = pilot.pilot
    check_seed(seed)
    if goals is not None:
        chosen = {
            "tests": tests is not None,
            "criterion": criterion is not None,
            "parameters": bool(parameters),
            "against": bool(against),
            "slope_size": slope_size != 1.0,
        }
        _refuse_beside_goals([name for name, is_given in chosen.items() if is_given])
        return design_for_goals(
            model,
            pilot,
            goals,
            costs=costs,
            certificates=certificates,
            probability=probability,
            forces_N=None if forces_N is None else _force_levels(forces_N),
            clockings_deg=clockings_deg,
            radii_mm=radii_mm,
            directions=directions,
            augment=augment,
            seed=seed,
            progress=progress,
        )
    require(
        costs is None and not certificates,
        "costs and certificates must go with goals, got none. Give for example goals={'C_XXX':"
        " '5 %'}.",
    )
    number = _number_of_tests(tests, pilot)
    compared_tests: list[CircularTest] = []
    for name, campaign in against.items():
        _check_compared(name, campaign, pilot)
        compared_tests += campaign.tests
    if forces_N is None:
        forces_N = _levels_in_range(pilot)
    if criterion is None:
        criterion = _default_criterion(model)
    space = Space(
        model=model,
        pilot=pilot,
        forces_N=_force_levels(forces_N),
        clockings_deg=clockings_deg or _NOT_TURNED,
        radii_mm=radii_mm,
        directions=directions,
        criterion=criterion,
        parameters=tuple(parameters),
        augment=augment,
        slope_size=slope_size,
        compared_tests=tuple(compared_tests),
        seed=seed,
    )
    compared = {_EQUAL_STEPS: space.equal_steps(number)}
    for name, campaign in against.items():
        compared[name] = _planned_tests(campaign)
    exact = space.search.find_design(number)
    return _describe_design(space, exact, Pilot(pilot.name, pilot.sha256), compared)


def _refuse_beside_goals(names: Sequence[str]) -> None:
    """Raise an `InputError` if arguments were given that cannot be combined with goals.

    Goals are upper limits of uncertainties. ``names`` are the names of those arguments that were
    given although they cannot be combined with goals. If ``names`` is empty, no error is raised.
    """
    require(
        not names,
        f"goals must go without {', '.join(names)}: they decide on the number of circles and on"
        " what is of interest. Leave out one or the other.",
    )


def _number_of_tests(tests: int | None, pilot: Campaign) -> int:
    """Return the number of circles to run: ``tests`` or, if None, as many as the pilot has."""
    number = len(pilot.tests) if tests is None else tests
    require_whole("tests", number)
    require(
        1 <= number <= MAX_TESTS,
        f"tests must be between 1 and {MAX_TESTS}, got {number}. Give the number of circles.",
    )
    return number


def _default_criterion(model: HybridModel) -> CriterionName:
    """Return the name of the default design criterion: ``eig``, or ``d`` for flat priors.

    The criterion ``eig`` is the expected information gain; ``d`` is the determinant of the
    covariance of the parameters.
    """
    # With flat priors, the information gain ``eig`` is infinite and cannot be optimized.
    return "d" if model.prior.flat else "eig"


def _planned_tests(campaign: Campaign) -> tuple[CircularTest, ...]:
    """Return the tests of a campaign without their readings and names."""
    tests = [replace(test.with_reading_um(None), name="") for test in campaign.tests]
    return tuple(tests)


def _force_levels(forces_N: Sequence[float]) -> tuple[float, ...]:
    """Return the force levels [N] that the user gave as ``forces_N``, converted to ``float``.

    An `InputError` is raised if a force level is not a number.
    """
    try:
        return tuple(float(force) for force in forces_N)
    except (TypeError, ValueError):
        raise InputError(
            f"forces_N must be a list of numbers [N], got {forces_N!r}. Give for example"
            " forces_N=(100.0, 400.0, 700.0)."
        ) from None


def _levels_in_range(pilot: Campaign) -> list[float]:
    """Return the force levels [N] from the lowest to the highest force of a pilot, in 1 N steps.

    The highest force of the pilot is always the last level.
    """
    low = float(pilot.forces_N.min())
    high = float(pilot.forces_N.max())
    levels: list[float] = np.unique([*np.arange(low, high, _FORCE_STEP_N), high]).tolist()
    return levels


def _check_compared(name: str, campaign: Campaign, pilot: Campaign) -> None:
    """Raise an `InputError` if a design for comparison has a wrong name or a different machine.

    ``campaign`` holds the tests of the design for comparison, and ``name`` is the name that the
    caller gave it. The name must not be one that the result uses for another design. ``pilot`` is
    the campaign or plan that the best design starts from. The machines count as the same if their
    topologies and frames are equal. An `InputError` is also raised if ``campaign`` is not a
    `Campaign`.
    """
    require(
        name not in _RESERVED_NAMES,
        f"against must not use the name {name!r}, which is the design's own. Choose another name.",
    )
    require_campaign(campaign)
    same_frames = dict(campaign.frames_mm) == dict(pilot.frames_mm)
    require(
        campaign.topology == pilot.topology and same_frames,
        f"{name} must be of the pilot's machine {pilot.topology}, frames too, got"
        f" {campaign.topology}. Leave it out.",
    )


def _describe_design(
    space: Space, exact: ExactDesign, pilot: Pilot, compared: Mapping[str, tuple[CircularTest, ...]]
) -> Design:
    """Return the design that the search found, with the forecast of its results.

    ``space`` holds the tests to choose from, the criterion and the parameters of interest;
    ``exact`` is the design that the search found. ``pilot`` holds the name and the digest of the
    campaign or plan that the design starts from. ``compared`` holds the tests of the designs for
    comparison, by name; the result includes the forecasts of these designs.
    """
    tests = space.tests_of(exact)
    optimum = exact.optimum
    judged = tuple(_judge_tests(space, name, planned) for name, planned in compared.items())
    candidates = space.frame(space.tests)
    listed = optimum.share > _LISTED_SHARE
    plan = space.plan_of(tests, seed=space.seed)
    forecast = space.forecast(plan)
    hyper_rms = np.sqrt((states_of(space.model, plan).phi ** 2).mean(axis=0))
    return Design(
        expected=forecast.expected,
        information_gain=forecast.information_gain,
        discrimination=forecast.discrimination,
        criterion=space.criterion,
        parameters=space.chosen,
        table=space.frame(tests).value_counts(sort=False).rename("count").reset_index(),
        augment=space.augment,
        degree=space.model.degree,
        reference_force_N=space.bound.setting.reference_force_N,
        efficiency=min(exact.efficiency, 1.0),
        certificate=_certificate_of(space, optimum),
        shares=candidates[listed].assign(share=optimum.share[listed]).reset_index(drop=True),
        baseline=judged[0].expected,
        compared=judged,
        limits=_limits(space, tests, forecast),
        hyper_um=space.bound.hyper_prior.display_values(hyper_rms),
        measured=not space.pilot.is_plan,
        pilot=pilot,
        sensitivity=candidates.assign(sensitivity=optimum.sensitivity),
        planned=Planned(tests, space, analysis_model(space, tests)),
    )


def _judge_tests(space: Space, name: str, tests: tuple[CircularTest, ...]) -> Judged:
    """Return the forecast and the efficiency of a design with which the best design is compared.

    ``tests`` are the tests of this design, and ``name`` is its name in the comparison. The
    efficiency is 1 if these tests are as good, by the criterion of ``space``, as the optimal
    allocation of the same number of runs to the candidate tests. It is 0 if they do not determine
    all parameters.
    """
    forecast = space.forecast(space.plan_of(tests, seed=space.seed))
    efficiency = space.efficiency(tests) if forecast.determined else 0.0
    return Judged(
        expected=forecast.expected,
        information_gain=forecast.information_gain,
        discrimination=forecast.discrimination,
        name=name,
        tests=space.frame(tests),
        efficiency=efficiency,
    )


def _certificate_of(space: Space, optimum: Optimum) -> Certificate:
    """Return the certificate that states whether the shares of the candidate tests are the best.

    ``optimum`` holds the shares, the sensitivities of the candidates (derivatives of the design
    criterion) and their bound. The shares are the best if no sensitivity exceeds the bound by more
    than 0.01 %.
    """
    highest = float(optimum.sensitivity.max())
    return Certificate(
        max_sensitivity=highest,
        bound=optimum.bound,
        is_global=space.search.objective.criterion.concave,
        holds=highest <= optimum.bound * (1.0 + _CERTIFICATE_TOLERANCE),
    )


def _limits(space: Space, tests: Sequence[CircularTest], forecast: Forecast) -> Limits:
    """Return the weaknesses of a design that more runs of the same tests would not remove.

    The result names, for example, the parameters whose uncertainties would remain large, and the
    kinds of further tests or the calibrations that would reduce these uncertainties. ``space``
    holds the pilot, the model and the parameters of interest. ``forecast`` is the forecast of the
    results of the tests ``tests``.
    """
    bound = bind_tests(space.model, space.pilot, tests, keep_pilot_tests=space.augment)
    term_types = {type(term) for term in space.model.nuisances}
    one_way = {}
    if Hysteresis in term_types:
        one_way = _planes_run_one_way(bound)
    not_shown = _parameters_that_no_circle_shows(space, bound, len(tests))
    stuck = _parameters_that_circles_cannot_improve(space, forecast)
    shared = tuple(name for name in stuck if name not in not_shown)
    shared_degeneracies: tuple[Degeneracy, ...] = ()
    if shared:
        shared_degeneracies = _degeneracies_of(bound, shared)
    shared_cures: tuple[tuple[Cure, ...], ...] = ()
    if shared_degeneracies:
        shared_cures = cures(bound, shared_degeneracies)
    return Limits(
        levels=_levels_if_too_few(space, tests),
        one_way=one_way,
        drift=Drift in term_types and space.pilot.drift,
        shared=shared,
        degeneracies=shared_degeneracies,
        cures=shared_cures,
        not_shown=not_shown,
    )


def _levels_if_too_few(space: Space, tests: Sequence[CircularTest]) -> int | None:
    """Return the number of different forces if there are too few of them; otherwise None.

    The model of ``space`` describes compliances as polynomials of force. There are too few forces
    if ``tests`` could not show that these polynomials need a higher degree. If ``tests`` are to be
    analysed together with tests that have been run before, the result is always None.
    """
    levels = len(distinct_forces([float(test.force_N or 0.0) for test in tests]))
    if space.augment or levels > space.model.degree + 2:
        return None
    return levels


def _parameters_that_circles_cannot_improve(space: Space, forecast: Forecast) -> tuple[str, ...]:
    """Return the names of the parameters that further circles would hardly improve.

    ``forecast`` holds the expected standard deviations of the parameters. For the parameters
    returned, this standard deviation would decrease by less than 20 % even if every test were run
    very many times. Only the parameters of interest of ``space`` are examined.
    """
    names = []
    for name in space.chosen:
        entry = forecast.expected[name]
        if entry.floor_sd > _STUCK_SHARE * entry.sd:
            names.append(name)
    return tuple(names)


def _parameters_that_no_circle_shows(
    space: Space, bound: BoundModel, planned: int
) -> tuple[str, ...]:
    """Return the names of the parameters that have no effect on any planned test.

    Such parameters are, for example, the offsets of the tool ball in a set-up that only tests of
    the pilot have. ``bound`` is the model applied to all tests; the last ``planned`` of these tests
    are the planned ones. Only the parameters of interest of ``space`` are examined.
    """
    effects = np.abs(bound.interest_columns[len(bound.interest_columns) - planned :])
    largest = effects.reshape(-1, len(bound.names)).max(axis=0)
    shown = {bound.names[index] for index in np.flatnonzero(largest)}
    return tuple(name for name in space.chosen if name not in shown)


def _degeneracies_of(bound: BoundModel, names: Sequence[str]) -> tuple[Degeneracy, ...]:
    """Return those degeneracies of a campaign that involve a parameter in ``names``.

    A degeneracy is a combination of coefficients whose effects on every reading cancel.
    """
    involved = []
    for degeneracy in degeneracies(bound):
        if set(degeneracy.parameters) & set(names):
            involved.append(degeneracy)
    return tuple(involved)


def _planes_run_one_way(bound: BoundModel) -> dict[str, str]:
    """Return a dict of the planes in which all circles run in one direction.

    The keys are the planes, and the values are the directions "CW" or "CCW". Only those planes are
    considered for which the model includes both directions of travel.
    """
    one_way = {}
    for plane in bound.setting.both_ways:
        directions = {test.direction for test in bound.campaign.tests if test.plane == plane}
        if len(directions) == 1:
            one_way[plane] = str(next(iter(directions)))
    return one_way
