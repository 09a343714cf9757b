"""Which forces, how many circles, which clockings: the best tests to run next, and what to expect of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
import pandas as pd
from pydantic import Field

from ldbb_bayes.analysis.aliases import Cure, Degeneracy, cures, degeneracies
from ldbb_bayes.analysis.design.candidates import Costs, CriterionName, bind_tests, frame_of, running_order
from ldbb_bayes.analysis.design.forecast import DECISIVE, Expected, Forecast
from ldbb_bayes.analysis.design.planning import (
    DesignSpace,
    Goal,
    Outcome,
    default_assumptions,
    fewest,
    robustness,
    trade_off,
)
from ldbb_bayes.analysis.design.solvers import MOST_TESTS, Found
from ldbb_bayes.campaign.campaign import Campaign, CircularTest, Direction, check_campaign
from ldbb_bayes.errors import InputError
from ldbb_bayes.jobs import one_blas_thread
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.model.terms import Drift, Hysteresis
from ldbb_bayes.result import ByRow, Records, Result, read_result

__all__ = ["Certificate", "Design", "Judged", "Limits", "Pilot", "Planned", "design", "read_design"]

_HOLDS = 1e-4
_SHOWN_SHARE = 1e-4
_ALONE, _AMONG_SEVERAL = 12, 3
_STUCK = 0.8
_APART = 0.05
_STEPS = "equal steps"
_RESERVED = ("recommended", _STEPS)


@dataclass(frozen=True)
class Certificate(Result):
    """That no shares of as many tests are better (Kiefer and Wolfowitz 1960).

    Attributes
    ----------
    max_sensitivity : float
        Of all candidates, for the best shares.
    bound : float
        What it does not exceed for the best shares: for D with flat priors the number of parameters.
    is_global : bool
        False where the criterion is not concave: then only designs nearby are ruled out. In JSON ``global``.
    holds : bool
        Whether it does, within a ten-thousandth.
    """

    max_sensitivity: float
    bound: float
    is_global: Annotated[bool, Field(alias="global")]
    holds: bool


@dataclass(frozen=True, eq=False)
class Judged(Forecast):
    """A design that is compared with the recommended one, and what to expect of it.

    Attributes
    ----------
    name : str
    tests : DataFrame
        One row per test: force_N and `Design.columns`.
    cost : float
    efficiency : float
        Beside the best shares of as many tests.
    """

    name: str
    tests: Records
    cost: float
    efficiency: float


@dataclass(frozen=True)
class Pilot(Result):
    """The campaign or plan that a design starts from."""

    name: str
    sha256: str


@dataclass(frozen=True)
class Limits(Result):
    """What the tests of a design do not show.

    Attributes
    ----------
    levels : int, optional
        Number of different forces where they are too few to show that the degree in force is wrong.
    one_way : dict of plane to direction
        Planes whose circles all run one way, while hysteresis counts.
    drift : bool
        Whether the model has a drift, which is taken to have nothing to do with what differs between the tests.
    clockings_of_budget : bool
        Whether efficiency and certificate are among the clockings that the budget pays for.
    shared : tuple of str
        Parameters of interest that more circles of this kind would narrow by less than a fifth.
    degeneracies : tuple of Degeneracy
        Of these parameters.
    cures : tuple of tuple of Cure
        What would end each of them.
    """

    levels: int | None
    one_way: dict[str, str]
    drift: bool
    clockings_of_budget: bool
    shared: tuple[str, ...]
    degeneracies: tuple[Degeneracy, ...]
    cures: tuple[tuple[Cure, ...], ...]


@dataclass(frozen=True)
class Planned:
    """Tests that a design recommends, what they follow, and the model for their analysis."""

    tests: tuple[CircularTest, ...]
    pilot: Campaign
    model: HybridModel


@dataclass(frozen=True, eq=False, repr=False)
class Design(Forecast):
    """Recommended tests, and what to expect of them.

    Attributes
    ----------
    criterion : str
    parameters : tuple of str
        Parameters of interest; all others are nuisances.
    table : DataFrame
        One row per different test: force_N, `columns`, count. In JSON ``tests``.
    augment, reached : bool
        Whether the pilot's tests count as run; whether the target or power asked for is reached.
    degree : int
    reference_force_N : float
    cost : float
    efficiency : float
        Beside the best shares of as many tests.
    certificate : Certificate
    shares : DataFrame
        The best shares: force_N, `columns`, share.
    baseline : dict of parameter to Expected
        Of equal steps of force at the first clocking and radius.
    compared : tuple of Judged
        Equal steps of force, and the designs brought for comparison.
    trade_off : DataFrame
        Number of tests against efficiency and expected sd; empty unless asked for.
    robustness : DataFrame
        Efficiency of the best designs under each assumption, under each assumption; empty unless asked for.
    goal : Goal, optional
        The target or power asked for.
    limits : Limits
    hyper_um : dict of hyper-parameter to float
        Root mean square of the values averaged over: of their posterior given the pilot's readings where ``measured``, else of
        their prior [µm].
    measured : bool
    pilot : Pilot
    sensitivity : DataFrame
        Of every candidate, for the best shares: force_N, `columns`, sensitivity. Not in JSON.
    planned : Planned, optional
        The tests themselves; none where a design was read from a file.
    """

    criterion: str
    parameters: tuple[str, ...]
    table: Annotated[Records, Field(alias="tests")]
    augment: bool
    reached: bool
    degree: int
    reference_force_N: float
    cost: float
    efficiency: float
    certificate: Certificate
    shares: Records
    baseline: dict[str, Expected]
    compared: tuple[Judged, ...]
    trade_off: Records
    robustness: ByRow
    goal: Goal | None
    limits: Limits
    hyper_um: dict[str, float]
    measured: bool
    pilot: Pilot
    sensitivity: Annotated[Records, Field(exclude=True)] = field(default_factory=pd.DataFrame)
    planned: Annotated[Any, Field(exclude=True)] = None

    @property
    def columns(self) -> tuple[str, ...]:
        """What tables say of a test beside its force: clockings and radius; plane, direction, set-up and centre where candidates
        differ in them."""
        return tuple(map(str, self.table.columns[1:-1]))

    @property
    def tests(self) -> tuple[CircularTest, ...]:
        """The tests by clocking, radius and force; a test to be run twice is there twice."""
        return self._at_hand().tests

    @property
    def model(self) -> HybridModel:
        """The model for the analysis of the plan: F0 and the slopes' prior sd are the pilot's, whatever the plan's forces."""
        return self._at_hand().model

    def plan(self, *, seed: int = 1) -> Campaign:
        """The tests as a plan, in the order in which to run them: blocks of one clocking, forces at random within.

        Where the model has a drift, at the pilot's pace and mean temperature.

        Raises
        ------
        InputError
            For a design read from a file.
        """
        own = self._at_hand()
        tests = _timed(running_order(own.tests, np.random.default_rng(seed)), own.pilot, own.model)
        return replace(own.pilot, tests=tests, foreseen=(), name=f"{own.pilot.name}, next campaign")

    def _at_hand(self) -> Planned:
        if not isinstance(self.planned, Planned):
            raise InputError("a design must be at hand, got one read from a file. Read the plan and the model.toml beside it.")
        return self.planned

    def expected_table(self) -> pd.DataFrame:
        """Expected sd of every parameter beside prior, floor and baseline; inside units."""
        rows = [
            {"parameter": name, **{key: getattr(entry, key) for key in ("unit", "prior_sd", "sd", "floor_sd")}}
            | {"baseline_sd": self.baseline[name].sd}
            for name, entry in self.expected.items()
        ]
        return pd.DataFrame(rows)

    def __repr__(self) -> str:
        return f"Design of {self.table['count'].sum()} tests, efficiency {self.efficiency:.3f} by criterion {self.criterion}"


def read_design(path: Path) -> Design:
    """Return the design in a folder written by ``ldbb-bayes design --out``, or in its design.json.

    Raises
    ------
    InputError
        When the file is missing, damaged, or not one of ours.
    """
    return read_result(path, "design", "design", Design.from_dict)


def _timed(tests: tuple[CircularTest, ...], pilot: Campaign, model: HybridModel) -> tuple[CircularTest, ...]:
    over = {term.over for term in model.nuisances if isinstance(term, Drift)}
    times = np.sort([test.time_s for test in pilot.tests if test.time_s is not None])
    degrees = [test.temperature_C for test in pilot.tests if test.temperature_C is not None]
    if "time" in over and len(times) > 1:
        pace = float(np.median(np.diff(times)))
        return tuple(replace(test, time_s=k * pace) for k, test in enumerate(tests))
    return tuple(replace(test, temperature_C=float(np.mean(degrees))) for test in tests) if "temperature" in over else tests


@one_blas_thread
def design(
    model: HybridModel,
    pilot: Campaign,
    *,
    tests: int | None = None,
    budget: float | None = None,
    targets: Mapping[str, float] = MappingProxyType({}),
    power: float | None = None,
    forces_N: Sequence[float] | None = None,
    clockings_deg: Sequence[tuple[float, float]] = ((0.0, 0.0),),
    radii_mm: Sequence[float] = (),
    planes: Sequence[str] = (),
    directions: Sequence[Direction] = (),
    centres_mm: Sequence[tuple[float, float, float]] = (),
    readings: int | None = None,
    criterion: CriterionName | None = None,
    parameters: Sequence[str] = (),
    augment: bool = False,
    costs: Costs | None = None,
    against: Mapping[str, Campaign] = MappingProxyType({}),
    slope_size: float = 1.0,
    threshold: float = DECISIVE,
    robust: bool = False,
    assumptions: Mapping[str, tuple[HybridModel, Mapping[str, float]]] | None = None,
    curve: bool = False,
    starts: int = 6,
    seed: int = 1,
) -> Design:
    """The best tests to run next.

    Everything is of the linear Gaussian model, averaged over the hyper-parameters: their posterior given the pilot, or their
    prior when the pilot is a plan. Criteria and evidence leave the truncation aside, expected sd are inside it. Model properties,
    F0, force range and Ĉ, are the pilot's: analyse the plan with `Design.model`.

    Parameters
    ----------
    model : HybridModel
    pilot : Campaign
        A campaign already run, or a plan.
    tests : int, optional
        Number of circles; default: as many as the pilot has.
    budget : float, optional
        Instead of ``tests``: what they may cost.
    targets : mapping of parameter to sd
        Instead of ``tests``: the fewest circles whose expected sd are no larger; inside units (mm, N, rad).
    power : float, optional
        Instead of ``tests``: the fewest circles that give decisive evidence for slopes of ``slope_size`` with this probability.
    forces_N : sequence of float, optional
        Levels to choose from; default: the pilot's range in steps of 1 N.
    clockings_deg : sequence of (work ball, tool ball)
        Clockings to choose from.
    radii_mm : sequence of float
        Radii to choose from; default: the pilot's.
    planes, directions, centres_mm : sequences
        Planes, directions of travel (CW, CCW) and centres (X, Y, Z) to choose from; default: those of the pilot. A plane that the
        pilot lacks is another set-up. Where both directions may be chosen, hysteresis counts for every design.
    readings : int, optional
        Readings per full circle; default: as in the pilot.
    criterion : {"eig", "d", "a", "c", "i", "e", "discriminate"}, optional
        Default: ``eig`` with proper priors, ``d`` with flat ones.
    parameters : sequence of str
        Parameters of interest, all others nuisances; default: all that the criterion is about.
    augment : bool
        The pilot's tests count as run: ``tests`` is how many are added.
    costs : Costs, optional
        Default: 1 per circle.
    against : mapping of name to campaign or plan
        Designs to be judged beside.
    slope_size : float
        Size of the slopes that are to be found [prior sd].
    threshold : float
        |ln B| called decisive [nat].
    robust : bool
        A design good over several assumptions: the criterion is averaged over them, and `Design.robustness` compares the best
        designs under each.
    assumptions : mapping of label to (HybridModel, factors of hyper-parameters), optional
        What these are; default: `default_assumptions`.
    curve : bool
        Also the trade-off: number of tests against efficiency and expected sd.
    starts : int
        Designs from which the exchange of single tests starts.
    seed : int

    Raises
    ------
    InputError
        For unknown names, several goals at once, or tests that leave parameters undetermined.
    """
    check_campaign(pilot)
    places = {"radii_mm": radii_mm, "planes": planes, "directions": directions, "centres_mm": centres_mm}
    _check_kinds(tests, forces_N, clockings_deg, {**places, "parameters": parameters}, against, seed)
    goals = {"tests": tests, "budget": budget, "targets": targets or None, "power": power}
    given = [name for name, value in goals.items() if value is not None]
    if len(given) > 1:
        raise InputError(f"a design must have one goal, got {' and '.join(given)}. Keep one of them.")
    for name, campaign in against.items():
        check_campaign(campaign)
        _check_same_machine(name, campaign, pilot)
    space = DesignSpace(
        model,
        pilot,
        _levels(pilot) if forces_N is None else tuple(float(force) for force in forces_N),
        tuple(clockings_deg),
        tuple(radii_mm),
        tuple(planes),
        tuple(directions),
        tuple(tuple(centre) for centre in centres_mm),  # type: ignore[misc]
        readings,
        _criterion(model, criterion, targets, power),
        tuple(targets) or tuple(parameters),
        augment,
        costs or Costs(),
        slope_size,
        threshold,
        targets=targets,
        nodes=_AMONG_SEVERAL if robust else _ALONE,
        judged=tuple(test for campaign in against.values() for test in campaign.tests),
        starts=starts,
        seed=seed,
    )
    if robust:
        space = replace(space, assumptions=default_assumptions(space) if assumptions is None else assumptions)
    goal = None
    if targets or power is not None:
        found, goal = fewest(space, power)
    elif budget is not None:
        if not (np.isfinite(budget) and budget > 0.0):
            raise InputError(f"budget must be a positive number, got {budget}. Correct it.")
        found = space.search.of_budget(budget)
    else:
        number = len(pilot.tests) if tests is None else tests
        if not 1 <= number <= MOST_TESTS:
            raise InputError(f"tests must be between 1 and {MOST_TESTS}, got {number}. Give the number of circles.")
        found = space.search.of_number(number)
    return _designed(
        space, found, against, goal, clockings_of_budget=budget is not None and len(space.clockings_deg) > 1, curve=curve
    )


def _check_same_machine(name: str, campaign: Campaign, pilot: Campaign) -> None:
    """Refuse a design of another machine."""
    for what, own, other in (
        ("machine", campaign.topology, pilot.topology),
        ("machine, its frames at", dict(campaign.frames_mm), dict(pilot.frames_mm)),
    ):
        if own != other:
            raise InputError(f"{name} must be of the pilot's {what} {other}, got {own}. Leave it out.")


def _check_kinds(
    tests: object, forces_N: object, clockings_deg: object, several: Mapping[str, object], against: object, seed: object
) -> None:
    """Answer arguments of the wrong kind with the right call."""
    if tests is not None and not isinstance(tests, int | np.integer):
        raise InputError(f"tests must be a whole number, got {tests!r}. For example 6.")
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise InputError(f"seed must be a whole number ≥ 0, got {seed!r}. For example 1.")
    for name, values in {"forces_N": forces_N, "clockings_deg": clockings_deg, **several}.items():
        if values is not None and (isinstance(values, str) or not isinstance(values, Iterable)):
            raise InputError(f"{name} must be a sequence, got {values!r}. Put it into a list.")
    if any(not isinstance(pair, Sequence) or len(pair) != 2 for pair in clockings_deg):  # type: ignore[attr-defined]
        raise InputError(
            f"clockings_deg must be pairs (work ball, tool ball), got {clockings_deg!r}. For example [(0, 0), (45, 0)]."
        )
    for centre in several["centres_mm"]:  # type: ignore[attr-defined]
        if not isinstance(centre, Sequence) or len(centre) != 3:
            raise InputError(f"centres_mm must be triples (X, Y, Z), got {centre!r}. For example [(0, 0, 0), (100, 0, 0)].")
    if not isinstance(against, Mapping):
        raise InputError(f"against must be a mapping of names to campaigns, got {type(against).__name__}. Give each a name.")
    reserved = next((name for name in against if name in _RESERVED), None)
    if reserved is not None:
        raise InputError(f"against must not use the name {reserved!r}, which is the design's own. Choose another name.")


def _designed(
    space: DesignSpace,
    found: Found,
    against: Mapping[str, Campaign],
    goal: Goal | None,
    *,
    clockings_of_budget: bool,
    curve: bool,
) -> Design:
    tests, columns, optimum = space.tests_of(found), space.columns, found.optimum
    compared = {_STEPS: space.equal_steps(len(tests))}
    compared |= {
        name: tuple(replace(test.with_reading_um(None), name="") for test in campaign.tests) for name, campaign in against.items()
    }
    judged = tuple(_judged(space, name, own, found) for name, own in compared.items())
    highest = float(optimum.sensitivity.max())
    concave = all(case.criterion.concave for case in space.search.objective.cases)
    candidates = frame_of([space.tests[i] for i in found.allowed], columns)
    shown = optimum.share > _SHOWN_SHARE
    planned = Planned(tests, space.pilot, _model_of(space, tests))
    forecast = space.forecast(tests)
    sizes = 1e3 * np.sqrt((space.states.phi**2).mean(axis=0))
    return Design(
        **vars(forecast),
        criterion=space.criterion,
        parameters=space.chosen,
        table=frame_of(tests, columns).value_counts(sort=False).rename("count").reset_index(),
        augment=space.augment,
        reached=goal is None or goal.outcome is not Outcome.OUT_OF_REACH,
        degree=space.model.degree,
        reference_force_N=space.bound.setting.reference_force_N,
        cost=space.costs.of(tests),
        efficiency=min(found.efficiency, 1.0),
        certificate=Certificate(highest, optimum.bound, concave, highest <= optimum.bound * (1.0 + _HOLDS)),
        shares=candidates[shown].assign(share=optimum.share[shown]).reset_index(drop=True),
        baseline=judged[0].expected,
        compared=judged,
        trade_off=trade_off(space, len(tests)) if curve else pd.DataFrame(),
        robustness=robustness(space, found, compared[_STEPS]) if space.assumptions else pd.DataFrame(),
        goal=goal,
        limits=_limits(space, tests, forecast, clockings_of_budget=clockings_of_budget),
        hyper_um=dict(zip(space.bound.hyper_prior.names, sizes.tolist(), strict=True)),
        measured=not space.pilot.is_plan,
        pilot=Pilot(space.pilot.name, space.pilot.sha256),
        sensitivity=candidates.assign(sensitivity=optimum.sensitivity),
        planned=planned,
    )


def _judged(space: DesignSpace, name: str, tests: tuple[CircularTest, ...], found: Found) -> Judged:
    own = space.forecast(tests)
    efficiency = 0.0
    if own.determined:
        efficiency = space.efficiency(tests, found.optimum if len(tests) == found.counts.sum() else None)
    return Judged(**vars(own), name=name, tests=frame_of(tests, space.columns), cost=space.costs.of(tests), efficiency=efficiency)


def _model_of(space: DesignSpace, tests: Sequence[CircularTest]) -> HybridModel:
    """The model as it should analyse these tests alone: F0 and the slopes' prior sd those of the pilot."""
    model, setting, prior = space.model, space.bound.setting, space.model.prior
    plain = replace(model, fixed=(), prior=replace(prior, overrides={}, means={}))
    there = BoundModel(plain, replace(space.pilot, tests=tuple(tests), foreseen=()), pilot=space.pilot).names
    overrides = dict(prior.overrides)
    forces = [float(test.force_N or 0.0) for test in tests]
    if not (prior.flat or np.isclose(max(forces) - min(forces), setting.force_range_N, rtol=1e-9)):
        overrides |= {p.name: p.prior_sd for p in space.bound.parameters if p.group == "slope"}
    return replace(
        model,
        reference_force_N=setting.reference_force_N,
        fixed=tuple(name for name in model.fixed if name in there),
        prior=replace(
            prior,
            overrides={name: sd for name, sd in overrides.items() if name in there},
            means={name: mean for name, mean in prior.means.items() if name in there},
        ),
    )


def _limits(
    space: DesignSpace, tests: Sequence[CircularTest], forecast: Forecast, *, clockings_of_budget: bool = False
) -> Limits:
    """What no number of such tests shows, and what would."""
    expected = forecast.expected
    levels = _levels_apart([float(test.force_N or 0.0) for test in tests])
    bound = bind_tests(space.model, space.pilot, tests, keep=space.augment)
    terms = {type(term) for term in space.model.nuisances}
    ways = {plane: {test.direction for test in bound.campaign.tests if test.plane == plane} for plane in bound.setting.both_ways}
    shared = tuple(name for name in space.chosen if expected[name].floor_sd > _STUCK * expected[name].sd)
    found = [d for d in degeneracies(bound) if set(d.parameters) & set(shared)] if shared else []
    return Limits(
        levels if levels <= space.model.degree + 2 and not space.augment else None,
        {plane: str(next(iter(own))) for plane, own in ways.items() if len(own) == 1 and Hysteresis in terms},
        Drift in terms,
        clockings_of_budget,
        shared,
        tuple(found),
        cures(bound, found) if found else (),
    )


def _levels_apart(forces_N: Sequence[float]) -> int:
    """Forces further apart than a twentieth of their range."""
    forces = np.sort(forces_N)
    return 1 + int(np.sum(np.diff(forces) > _APART * max(np.ptp(forces), 1e-12)))


def _levels(pilot: Campaign) -> tuple[float, ...]:
    """The pilot's range in steps of 1 N, its ends included."""
    low, high = float(pilot.forces_N.min()), float(pilot.forces_N.max())
    return tuple(np.unique([*np.arange(low, high, 1.0), high]).tolist())


def _criterion(
    model: HybridModel, criterion: CriterionName | None, targets: Mapping[str, float], power: float | None
) -> CriterionName:
    wanted: CriterionName | None = "a" if targets else "discriminate" if power is not None else None
    if wanted is not None and criterion not in (None, wanted):
        raise InputError(f"criterion must be left to the goal here, which needs {wanted!r}, got {criterion!r}. Leave it out.")
    return wanted or criterion or ("d" if model.prior.flat else "eig")
