"""Which forces, how many circles, which clockings: the best tests to run next, and what to expect of them."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from enum import StrEnum
from itertools import product
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
import pandas as pd
from pydantic import Field

from ldbb_bayes.analysis.aliases import Cure, Degeneracy, cures, degeneracies
from ldbb_bayes.analysis.design.candidates import Clocking, Costs, Space, bind_tests, frame_of, place_columns, running_order
from ldbb_bayes.analysis.design.criteria import CriterionName, Variance
from ldbb_bayes.analysis.design.forecast import DECISIVE, Expected, Forecast
from ldbb_bayes.analysis.design.solvers import MOST_TESTS, Found
from ldbb_bayes.campaign.campaign import Campaign, CircularTest, Direction, check_campaign, distinct_forces
from ldbb_bayes.errors import InputError, require
from ldbb_bayes.jobs import one_blas_thread
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.model.terms import Drift, Hysteresis
from ldbb_bayes.result import ByRow, Records, Result, read_result

__all__ = [
    "Certificate",
    "Design",
    "Goal",
    "Judged",
    "Limits",
    "Outcome",
    "Remedy",
    "RemedyKind",
    "design",
    "fewest",
    "read_design",
]

_MOST = 100
_HOLDS, _SHOWN_SHARE, _STUCK = 1e-4, 1e-4, 0.8
_STEPS = "equal steps"
_RESERVED = ("recommended", _STEPS)


@dataclass(frozen=True)
class Certificate(Result):
    """That no shares of as many tests are better (Kiefer and Wolfowitz 1960): the largest sensitivity of all candidates does not
    exceed the bound (for D with flat priors the number of parameters) by more than a ten-thousandth. Where the criterion is not
    concave it is not ``global``: only designs nearby are ruled out."""

    max_sensitivity: float
    bound: float
    is_global: Annotated[bool, Field(alias="global")]
    holds: bool


@dataclass(frozen=True, eq=False)
class Judged(Forecast):
    """A design compared with the recommended one: name, one row per test (force_N and `Design.columns`), cost, efficiency beside
    the best shares of as many tests, and what to expect of it."""

    name: str
    tests: Records
    cost: float
    efficiency: float


class Outcome(StrEnum):
    """How a search for the fewest tests ended."""

    ALREADY = "already reached"
    REACHED = "reached"
    OUT_OF_REACH = "out of reach"


class RemedyKind(StrEnum):
    """What may do where force levels alone do not."""

    LEVELS = "levels"
    WORK_BALL = "work ball"
    TOOL_BALL = "tool ball"
    BOTH_BALLS = "both balls"
    RADIUS = "radius"


@dataclass(frozen=True)
class Remedy(Result):
    """What would reach a goal, with the fewest circles: balls clocked at 0, 45 and 90°, levels in between, a second radius."""

    kind: RemedyKind
    tests: int
    radius_mm: float | None = None


@dataclass(frozen=True)
class Goal(Result):
    """A target or a power, and whether it is reached.

    Attributes
    ----------
    targets : dict of parameter to sd
        In inside units; empty where a power is asked for.
    power : float, optional
        Probability of decisive evidence, |ln B| above ``threshold`` [nat].
    tests, most : int
        Of the design, and tried at most.
    remedies : tuple of Remedy
        What would reach it, where no number of tests does.
    """

    outcome: Outcome
    targets: dict[str, float]
    power: float | None
    threshold: float
    tests: int
    most: int = _MOST
    remedies: tuple[Remedy, ...] = ()


@dataclass(frozen=True)
class Limits(Result):
    """What the tests of a design do not show.

    Attributes
    ----------
    levels : int, optional
        Number of different forces where they are too few to show that the degree in force is wrong.
    one_way : dict of plane to direction
        Planes whose circles all run one way, while hysteresis counts.
    drift, clockings_of_budget : bool
        Whether there is a drift, which is taken to have nothing to do with what differs between the tests; whether efficiency and
        certificate are among the clockings that the budget pays for.
    shared : tuple of str
        Parameters that more circles of this kind would narrow by less than a fifth; ``degeneracies`` and ``cures`` are theirs.
    """

    levels: int | None
    one_way: dict[str, str]
    drift: bool
    clockings_of_budget: bool
    shared: tuple[str, ...]
    degeneracies: tuple[Degeneracy, ...]
    cures: tuple[tuple[Cure, ...], ...]


@dataclass(frozen=True)
class Pilot(Result):
    """The campaign or plan that a design starts from."""

    name: str
    sha256: str


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
    parameters : tuple of str
        Parameters of interest; all others are nuisances.
    table, shares : DataFrame
        One row per different test: force_N, `columns`, count (in JSON ``tests``), or its share in the best shares.
    augment, reached : bool
        Whether the pilot's tests count as run; whether the target or power asked for is reached.
    efficiency : float
        Beside the best shares of as many tests.
    baseline : dict of parameter to Expected
        Of equal steps of force at the first clocking and radius.
    compared : tuple of Judged
        Equal steps of force, and the designs brought for comparison.
    trade_off, robustness : DataFrame
        Number of tests against efficiency and expected sd; efficiency of the best designs under each assumption, under each
        assumption. Empty unless asked for.
    goal : Goal, optional
    hyper_um : dict of hyper-parameter to float
        Root mean square of the values averaged over: of their posterior given the pilot's readings where ``measured``, else of
        their prior [µm].
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
    clockings_deg: Sequence[Clocking] = ((0.0, 0.0),),
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
    curve: bool = False,
    seed: int = 1,
) -> Design:
    """The best tests to run next.

    Everything is of the linear Gaussian model, averaged over the hyper-parameters: their posterior given the pilot, or their
    prior when the pilot is a plan. Criteria and evidence leave the truncation aside, expected sd are inside it. Model properties,
    F0, force range and Ĉ, are the pilot's: analyse the plan with `Design.model`.

    Parameters
    ----------
    pilot : Campaign
        A campaign already run, or a plan.
    tests, budget : int, float
        Number of circles, or instead what they may cost; default: as many as the pilot has.
    targets : mapping of parameter to sd
        Instead: the fewest circles whose expected sd are no larger; inside units (mm, N, rad).
    power : float
        Instead: the fewest circles that give decisive evidence for slopes of ``slope_size`` with this probability.
    forces_N : sequence of float, optional
        Levels to choose from; default: the pilot's range in steps of 1 N.
    clockings_deg, radii_mm, planes, directions, centres_mm : sequences
        Clockings (work ball, tool ball), radii, planes, directions of travel (CW, CCW) and centres (X, Y, Z) to choose from;
        default: those of the pilot. A plane or centre that the pilot lacks is another set-up. Where both directions may be
        chosen, hysteresis counts for every design.
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
    slope_size, threshold : float
        Size of the slopes that are to be found [prior sd]; |ln B| called decisive [nat].
    robust : bool
        A design good over several assumptions: the criterion is averaged over them, and `Design.robustness` compares the best
        designs under each.
    curve : bool
        Also the trade-off: number of tests against efficiency and expected sd.

    Raises
    ------
    InputError
        For unknown names, several goals at once, or tests that leave parameters undetermined.
    """
    given = dict(locals())
    _check(given)
    given["criterion"] = _criterion(model, criterion, targets, power)
    given["forces_N"] = _levels(pilot) if forces_N is None else tuple(map(float, forces_N))
    given |= {"parameters": tuple(targets) or tuple(parameters), "costs": costs or Costs()}
    given["judged"] = tuple(test for campaign in against.values() for test in campaign.tests)
    space = Space(**{option.name: given[option.name] for option in fields(Space)})
    goal = None
    if targets or power is not None:
        found, goal = fewest(space, power)
    elif budget is not None:
        found = space.of_budget(budget)
    else:
        found = space.search.of_number(len(pilot.tests) if tests is None else tests)
    return _designed(space, found, against, goal, of_budget=budget is not None, curve=curve)


def _check(given: Mapping[str, Any]) -> None:
    """Answer arguments of the wrong kind with the right call."""
    pilot, tests, budget, seed, against = (given[name] for name in ("pilot", "tests", "budget", "seed", "against"))
    check_campaign(pilot)
    require(tests is None or isinstance(tests, int | np.integer), f"tests must be a whole number, got {tests!r}. For example 6.")
    require(isinstance(seed, int | np.integer) and seed >= 0, f"seed must be a whole number ≥ 0, got {seed!r}. For example 1.")
    for name in ("forces_N", "clockings_deg", "radii_mm", "planes", "directions", "centres_mm", "parameters"):
        value = given[name]
        several = value is None or (isinstance(value, Iterable) and not isinstance(value, str))
        require(several, f"{name} must be a sequence, got {value!r}. Put it into a list.")
    for name, size, example in (
        ("clockings_deg", 2, "pairs (work ball, tool ball), got {}. For example [(0, 0), (45, 0)]."),
        ("centres_mm", 3, "triples (X, Y, Z), got {}. For example [(0, 0, 0), (100, 0, 0)]."),
    ):
        right = all(isinstance(own, Sequence) and len(own) == size for own in given[name])
        require(right, f"{name} must be {example.format(given[name])}")
    kind = type(against).__name__
    require(isinstance(against, Mapping), f"against must be a mapping of names to campaigns, got {kind}. Give each a name.")
    for name, campaign in against.items():
        own_names = f"against must not use the name {name!r}, which is the design's own. Choose another name."
        require(name not in _RESERVED, own_names)
        check_campaign(campaign)
        for what, own, other in (
            ("machine", campaign.topology, pilot.topology),
            ("machine, its frames at", dict(campaign.frames_mm), dict(pilot.frames_mm)),
        ):
            require(own == other, f"{name} must be of the pilot's {what} {other}, got {own}. Leave it out.")
    goals = [name for name in ("tests", "budget", "targets", "power") if given[name] not in (None, {})]
    require(len(goals) <= 1, f"a design must have one goal, got {' and '.join(goals)}. Keep one of them.")
    number = f"tests must be between 1 and {MOST_TESTS}, got {tests}. Give the number of circles."
    require(1 <= (tests or len(pilot.tests) if tests is None else tests) <= MOST_TESTS, number)
    positive = budget is None or (np.isfinite(budget) and budget > 0.0)
    require(positive, f"budget must be a positive number, got {budget}. Correct it.")


def _criterion(
    model: HybridModel, criterion: CriterionName | None, targets: Mapping[str, float], power: float | None
) -> CriterionName:
    wanted: CriterionName | None = "a" if targets else "discriminate" if power is not None else None
    require(
        wanted is None or criterion in (None, wanted),
        f"criterion must be left to the goal here, which needs {wanted!r}, got {criterion!r}. Leave it out.",
    )
    return wanted or criterion or ("d" if model.prior.flat else "eig")


def _levels(pilot: Campaign) -> tuple[float, ...]:
    """The pilot's range in steps of 1 N, its ends included."""
    low, high = float(pilot.forces_N.min()), float(pilot.forces_N.max())
    return tuple(np.unique([*np.arange(low, high, 1.0), high]).tolist())


def _designed(
    space: Space, found: Found, against: Mapping[str, Campaign], goal: Goal | None, *, of_budget: bool, curve: bool
) -> Design:
    tests, optimum = space.tests_of(found), found.optimum
    columns = place_columns((*space.tests, *space.judged))
    compared = {_STEPS: space.equal_steps(len(tests))}
    compared |= {
        name: tuple(replace(test.with_reading_um(None), name="") for test in campaign.tests) for name, campaign in against.items()
    }
    judged = tuple(_judged(space, name, own, found, columns) for name, own in compared.items())
    highest = float(optimum.sensitivity.max())
    concave = all(case.criterion.concave for case in space.search.objective.cases)
    candidates = frame_of([space.tests[i] for i in found.allowed], columns)
    shown = optimum.share > _SHOWN_SHARE
    expected = space.forecast(tests)
    sizes = 1e3 * np.sqrt((space.states.phi**2).mean(axis=0))
    return Design(
        **vars(expected),
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
        trade_off=space.trade_off(len(tests)) if curve else pd.DataFrame(),
        robustness=space.robustness(found, compared[_STEPS]) if space.robust else pd.DataFrame(),
        goal=goal,
        limits=_limits(space, tests, expected, of_budget=of_budget and len(space.clockings_deg) > 1),
        hyper_um=dict(zip(space.bound.hyper_prior.names, sizes.tolist(), strict=True)),
        measured=not space.pilot.is_plan,
        pilot=Pilot(space.pilot.name, space.pilot.sha256),
        sensitivity=candidates.assign(sensitivity=optimum.sensitivity),
        planned=Planned(tests, space.pilot, _model_of(space, tests)),
    )


def _judged(space: Space, name: str, tests: tuple[CircularTest, ...], found: Found, columns: Sequence[str]) -> Judged:
    own, efficiency = space.forecast(tests), 0.0
    if own.determined:
        best = found.optimum if len(tests) == found.tests else space.search.shares(float(len(tests)))
        efficiency = space.search.objective.efficiency(space.value(tests), best.value)
    return Judged(**vars(own), name=name, tests=frame_of(tests, columns), cost=space.costs.of(tests), efficiency=efficiency)


def _model_of(space: Space, tests: Sequence[CircularTest]) -> HybridModel:
    """The model as it should analyse these tests alone: F0 and the slopes' prior sd those of the pilot."""
    model, setting, prior = space.model, space.bound.setting, space.model.prior
    plain = replace(model, fixed=(), prior=replace(prior, overrides={}, means={}))
    there = BoundModel(plain, replace(space.pilot, tests=tuple(tests), foreseen=()), pilot=space.pilot).names
    overrides = dict(prior.overrides)
    forces = [float(test.force_N or 0.0) for test in tests]
    if not (prior.flat or np.isclose(max(forces) - min(forces), setting.force_range_N, rtol=1e-9)):
        overrides |= {p.name: p.prior_sd for p in space.bound.parameters if p.group == "slope"}
    own = {name: sd for name, sd in overrides.items() if name in there}
    means = {name: mean for name, mean in prior.means.items() if name in there}
    fixed = tuple(name for name in model.fixed if name in there)
    return replace(
        model, reference_force_N=setting.reference_force_N, fixed=fixed, prior=replace(prior, overrides=own, means=means)
    )


def _limits(space: Space, tests: Sequence[CircularTest], expected: Forecast, *, of_budget: bool = False) -> Limits:
    """What no number of such tests shows, and what would."""
    levels = len(distinct_forces([float(test.force_N or 0.0) for test in tests]))
    bound = bind_tests(space.model, space.pilot, tests, keep=space.augment)
    terms = {type(term) for term in space.model.nuisances}
    ways = {plane: {test.direction for test in bound.campaign.tests if test.plane == plane} for plane in bound.setting.both_ways}
    entries = {name: expected.expected[name] for name in space.chosen}
    shared = tuple(name for name, entry in entries.items() if entry.floor_sd > _STUCK * entry.sd)
    found = tuple(d for d in degeneracies(bound) if set(d.parameters) & set(shared)) if shared else ()
    return Limits(
        levels if levels <= space.model.degree + 2 and not space.augment else None,
        {plane: str(next(iter(own))) for plane, own in ways.items() if len(own) == 1 and Hysteresis in terms},
        Drift in terms,
        of_budget,
        shared,
        found,
        cures(bound, found) if found else (),
    )


_TURNS_DEG, _SMALLER, _LEVELS = (0.0, 45.0, 90.0), 2.0 / 3.0, 5
_MISSED, _TRUNCATED, _REWEIGHTED = 1.1, 8.0, 3
_STARTS = 2


def fewest(space: Space, power: float | None) -> tuple[Found, Goal]:
    """The design of the fewest tests that reach the targets of the space (in units of which its criterion is "a"), or the power
    (criterion "discriminate"); where none does, that of as many as the pilot has."""
    for name, value in space.targets.items():
        positive = np.isfinite(value) and value > 0.0
        require(positive, f"target of {name} must be a positive sd, got {value}. Give it in mm, N and rad.")
    require(power is None or 0.0 < power < 1.0, f"power must lie between 0 and 1, got {power}. For example 0.9.")
    goal = Goal(Outcome.REACHED, dict(space.targets), power, space.threshold, 0)
    if space.augment and _shortfall(space.forecast((), decide=not goal.targets), goal) <= 1.0:
        return space.search.of_number(1), replace(goal, outcome=Outcome.ALREADY, tests=1)
    found = _fewest(space, goal)
    if found is not None:
        return found, replace(goal, tests=found.tests)
    found = space.search.of_number(max(len(space.pilot.tests), space.search.levels))
    remedies = []
    for kind, wider in _wider(space):
        better = _fewest(wider, goal)
        if better is not None:
            remedies.append(Remedy(kind, better.tests, wider.radii_mm[-1] if kind is RemedyKind.RADIUS else None))
    return found, replace(goal, outcome=Outcome.OUT_OF_REACH, tests=found.tests, remedies=tuple(remedies))


def _fewest(space: Space, goal: Goal) -> Found | None:
    """The design of the fewest tests that reaches the goal, by bisection; None where no number does."""
    tried: dict[int, tuple[Found, bool]] = {}

    def met(number: int) -> bool:
        if number not in tried:
            tried[number] = _try(space, goal, number)
        return tried[number][1]

    # Best shares that miss the targets on average, truncation aside; truncation may more than halve an sd.
    bound, shares, number = space.bound, space.search.shares, 1
    bounded = any(bound.truncation.rows[:, bound.names.index(name)].any() for name in goal.targets)
    if goal.targets and shares(float(_MOST)).value < -(_TRUNCATED if bounded else _MISSED):
        return None
    while goal.targets and number < _MOST and shares(float(number)).value < -1.0:
        number *= 2
    low, high = space.search.levels - 1, max(space.search.levels, min(number, _MOST))
    while not met(high):
        if high == _MOST:
            return None
        low, high = high, min(2 * high, _MOST)
    return tried[bisect_left(range(high), True, low + 1, key=met)][0]


def _shortfall(expected: Forecast, goal: Goal) -> float:
    """The largest ratio of expected sd to target, or of the power wanted to that expected."""
    if goal.targets:
        return max(expected.expected[name].sd / value for name, value in goal.targets.items())
    found = expected.discrimination
    if found is None:
        raise InputError("power must be asked of a model with slopes and proper priors. Use degree 1 and the default preset.")
    power = next(iter(found.power.values())) if len(found.power) == 1 else found.decisive_with
    return float(goal.power or 0.0) / max(power, 1e-12)


def _try(space: Space, goal: Goal, number: int) -> tuple[Found, bool]:
    """The best whole tests of a number, and whether they reach the goal; targets missed while others are exceeded gain weight."""
    plain = search = space.search
    for _ in range(_REWEIGHTED):
        found = search.of_number(number, starts=_STARTS)
        expected = space.forecast(space.tests_of(found), decide=not goal.targets)
        reached = _shortfall(expected, goal) <= 1.0
        criterion = search.objective.cases[0].criterion
        value = plain.objective.value(found.counts.astype(float))
        if reached or not isinstance(criterion, Variance) or value < -1.0:
            break
        ratio = np.array([expected.expected[name].sd / goal.targets[name] for name in space.chosen])
        search = replace(search, objective=search.objective.under(Variance(ratio[:, None] * criterion.weight * ratio)))
    # Value and efficiency by the criterion that was asked for.
    optimum = plain.shares(float(number))
    return replace(found, value=value, optimum=optimum, efficiency=plain.objective.efficiency(value, optimum.value)), reached


def _wider(space: Space) -> Iterator[tuple[RemedyKind, Space]]:
    """The space enlarged by what its force levels cannot do, one thing at a time, at few of its own levels."""
    levels = sorted(space.forces_N)
    few = tuple(dict.fromkeys(levels[round(i)] for i in np.linspace(0, len(levels) - 1, _LEVELS)))
    if len(levels) < _LEVELS:
        yield RemedyKind.LEVELS, replace(space, forces_N=np.linspace(levels[0], levels[-1], 2 * _LEVELS - 1).tolist())
    for kind, works, tools in (
        (RemedyKind.WORK_BALL, _TURNS_DEG, (0.0,)),
        (RemedyKind.TOOL_BALL, (0.0,), _TURNS_DEG),
        (RemedyKind.BOTH_BALLS, _TURNS_DEG, _TURNS_DEG),
    ):
        own = tuple(product(works, tools))
        if not set(own) <= set(space.clockings_deg):
            yield kind, replace(space, clockings_deg=(*space.clockings_deg, *own), forces_N=few)
    if len(space.radii_mm) == 1:
        second = float(round(_SMALLER * space.radii_mm[0]))
        yield RemedyKind.RADIUS, replace(space, radii_mm=(*space.radii_mm, second), forces_N=few)
