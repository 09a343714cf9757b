"""What is to be designed, and questions to it: the fewest tests for a target or a power, the trade-off, robustness."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ldbb_bayes.analysis.design.candidates import (
    Costs,
    CriterionName,
    bind_tests,
    case_of,
    chosen_parameters,
    criterion_of,
    foreseen_by,
    grid_of_tests,
    place_columns,
    templates,
)
from ldbb_bayes.analysis.design.criteria import Determinant, Objective, Variance
from ldbb_bayes.analysis.design.forecast import DECISIVE, Forecast, States, forecast, hyper_nodes, states_before
from ldbb_bayes.analysis.design.solvers import Found, Optimum, Search
from ldbb_bayes.campaign.campaign import Campaign, CircularTest, Direction
from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.machine.chain import PLANES
from ldbb_bayes.model.fourier import TRAVEL
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.result import Result

__all__ = ["DesignSpace", "Goal", "Outcome", "Remedy", "RemedyKind", "default_assumptions", "fewest", "robustness", "trade_off"]

Array = NDArray[Any]
Assumptions = Mapping[str, tuple[HybridModel, Mapping[str, float]]]
_SEARCHED, _REPORTED = 12, 128
_MOST_CANDIDATES = 5000
_FEWEST_READINGS, _MOST_READINGS = 25, 100_000
_AS_GIVEN = "as in the model"


@dataclass(frozen=True, eq=False)
class DesignSpace:
    """What is to be designed: the arguments of `ldbb_bayes.design` and what follows from them.

    The pilot gives the machine, F0, force range, Ĉ and, where it has readings, the posterior of the hyper-parameters, else their
    prior; the search averages over ``nodes`` values of these, and over ``assumptions``, other models and factors of the
    hyper-parameters, beside the model. ``judged`` are the tests of designs that are to be compared.
    """

    model: HybridModel
    pilot: Campaign
    forces_N: tuple[float, ...]
    clockings_deg: tuple[tuple[float, float], ...] = ((0.0, 0.0),)
    radii_mm: tuple[float, ...] = ()
    planes: tuple[str, ...] = ()
    directions: tuple[Direction, ...] = ()
    centres_mm: tuple[tuple[float, float, float], ...] = ()
    readings: int | None = None
    criterion: CriterionName = "eig"
    parameters: tuple[str, ...] = ()
    augment: bool = False
    costs: Costs = field(default_factory=Costs)
    slope_size: float = 1.0
    threshold: float = DECISIVE
    assumptions: Assumptions = field(default_factory=dict)
    targets: Mapping[str, float] = field(default_factory=dict)
    nodes: int = _SEARCHED
    judged: tuple[CircularTest, ...] = ()
    starts: int = 6
    seed: int = 1

    def __post_init__(self) -> None:
        radii = self.radii_mm or [float(test.radius_mm or self.pilot.radius_mm) for test in self.pilot.tests]
        turned = {(work % 360.0, tool % 360.0): (work, tool) for work, tool in reversed(self.clockings_deg)}
        object.__setattr__(self, "radii_mm", radii)
        object.__setattr__(self, "clockings_deg", tuple(reversed(turned.values())))
        for name in ("forces_N", "radii_mm", "planes", "directions", "centres_mm"):
            object.__setattr__(self, name, tuple(dict.fromkeys(getattr(self, name))))
        self._check()
        object.__setattr__(self, "pilot", foreseen_by(self.pilot, self.tests, self.judged))
        check_known("target", self.targets, self.bound.names)
        chosen_parameters(self.bound, self.criterion, self.parameters)
        for label, (model, _) in self.assumptions.items():
            if not set(self.chosen) & set(model.bind(self.pilot).names):
                raise InputError(f"assumption {label!r} must leave parameters of interest, got none. Leave it out.")

    def _check(self) -> None:
        for name, values, unit in (("forces", self.forces_N, "N"), ("radii", self.radii_mm, "mm")):
            for value in values:
                if not (np.isfinite(value) and value > 0.0):
                    raise InputError(f"{name} must be > 0 {unit}, got {value:g}. Correct the range.")
        if not self.forces_N or not self.clockings_deg:
            raise InputError("a design must have forces and clockings to choose from, got none. Give at least one of each.")
        for name, value in (("slope_size", self.slope_size), ("threshold", self.threshold)):
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(f"{name} must be a positive number, got {value}. Correct it.")
        check_known("plane", self.planes, PLANES)
        check_known("direction", self.directions, TRAVEL)
        count = len(self.forces_N) * len(self.clockings_deg) * max(len(self.radii_mm), 1) * len(self.templates)
        if count > _MOST_CANDIDATES:
            raise InputError(
                f"a design must choose among at most {_MOST_CANDIDATES} candidates, got {count}. Take longer steps of "
                "force or fewer clockings."
            )
        if self.readings is not None and not _FEWEST_READINGS <= self.readings <= _MOST_READINGS:
            raise InputError(
                f"readings must be between {_FEWEST_READINGS} and {_MOST_READINGS} per circle, got {self.readings}. Correct it."
            )
        if not isinstance(self.costs, Costs):
            raise InputError(
                f"costs must be Costs, got {type(self.costs).__name__}. Write lb.Costs(circle=10.0, work_ball=30.0)."
            )
        if self.starts < 1:
            raise InputError(f"starts must be at least 1, got {self.starts}. Give the number of designs to start from.")

    @cached_property
    def bound(self) -> BoundModel:
        """The model bound to the pilot alone."""
        return self.model.bind(self.pilot)

    @cached_property
    def templates(self) -> tuple[CircularTest, ...]:
        """One test for every plane, direction and centre."""
        return templates(self.pilot, self.planes, self.directions, self.centres_mm)

    @cached_property
    def tests(self) -> tuple[CircularTest, ...]:
        """The candidates."""
        return grid_of_tests(self.templates, self.forces_N, self.clockings_deg, self.radii_mm, self.readings)

    @property
    def columns(self) -> tuple[str, ...]:
        """What tables say of a test beside its force."""
        return place_columns((*self.tests, *self.judged))

    def tests_of(self, found: Found) -> tuple[CircularTest, ...]:
        """The tests of a design, one as often as it is to be run."""
        return tuple(test for test, count in zip(self.tests, found.counts, strict=True) for _ in range(count))

    def equal_steps(self, number: int) -> tuple[CircularTest, ...]:
        """Equal steps of force, each at the nearest level there is, at the first clocking and radius; in turn over planes,
        directions and centres."""
        levels = np.array(sorted(self.forces_N))
        steps = np.linspace(levels[0], levels[-1], number)
        nearest = [float(levels[np.argmin(np.round(np.abs(levels - step), 9))]) for step in steps]
        return tuple(
            test
            for k, like in enumerate(self.templates)
            for test in grid_of_tests(
                [like], nearest[k :: len(self.templates)], self.clockings_deg[:1], self.radii_mm[:1], self.readings
            )
        )

    @cached_property
    def chosen(self) -> tuple[str, ...]:
        """The parameters of interest."""
        return chosen_parameters(self.bound, self.criterion, self.parameters)

    @property
    def levels(self) -> int:
        """Fewest different forces of the new tests with which the model can be fitted."""
        return 1 if self.augment or not self.model.degree else 2

    @cached_property
    def search(self) -> Search:
        """The candidates under the criterion, averaged over all assumptions."""
        return self._search(_together(search.objective for search in self.alone.values()))

    @cached_property
    def alone(self) -> dict[str, Search]:
        """The candidates under every assumption alone."""
        return {label: self._search(objective) for label, objective in self.objectives(self.tests).items()}

    def _search(self, objective: Objective) -> Search:
        return Search(objective, self.tests, self.costs, self.levels, self.starts, self.seed)

    def objectives(self, tests: Sequence[CircularTest]) -> dict[str, Objective]:
        """The criterion of any tests under every assumption alone."""
        bounds: list[BoundModel] = []
        found = {}
        for label, (model, factors) in {_AS_GIVEN: (self.model, {}), **self.assumptions}.items():
            bound = next((bound for bound in bounds if bound.model == model), None)
            if bound is None:
                bound = bind_tests(model, self.pilot, tests, keep=self.augment)
                bounds.append(bound)
            phi = self.hyper(model) * np.array([factors.get(name, 1.0) for name in bound.hyper_prior.names])
            names = tuple(name for name in self.chosen if name in bound.names)
            criterion = criterion_of(bound, self.criterion, names, size=self.slope_size, targets=self.targets)
            found[label] = Objective((case_of(bound, len(self.pilot.tests) if self.augment else 0, phi, names, criterion),))
        return found

    def hyper(self, model: HybridModel) -> Array:
        """Values of the hyper-parameters that the search averages over, shape (nodes, h) [mm]."""
        phi = next((phi for other, phi in self._nodes if other == model), None)
        if phi is None:
            phi = hyper_nodes(model, self.pilot, self.nodes, self.seed)
            self._nodes.append((model, phi))
        return phi

    @cached_property
    def _nodes(self) -> list[tuple[HybridModel, Array]]:
        return []

    def value(self, tests: Sequence[CircularTest]) -> float:
        """The criterion of any tests, candidates or not."""
        return _together(self.objectives(tests).values()).value(np.ones(len(tests)))

    def efficiency(self, tests: Sequence[CircularTest], best: Optimum | None = None) -> float:
        """Of any tests, candidates or not, beside the best shares of as many candidates."""
        best = self.search.shares(float(len(tests))) if best is None else best
        return self.search.objective.efficiency(self.value(tests), best.value)

    def forecast(self, tests: Sequence[CircularTest], *, decide: bool = True) -> Forecast:
        """What to expect of tests, over more hyper-parameters than the search uses; with ``decide`` of slopes or none too."""
        slopes = self.chosen if self.criterion == "discriminate" else ()
        return forecast(
            self.model,
            self.pilot,
            tests,
            self.states,
            augment=self.augment,
            slopes=slopes if decide else None,
            slope_size=self.slope_size,
            threshold=self.threshold,
            seed=self.seed,
        )

    @cached_property
    def states(self) -> States:
        """The machine as it may be before these tests."""
        return states_before(self.model, self.pilot, _REPORTED, self.seed, augment=self.augment)


def _together(objectives: Iterable[Objective]) -> Objective:
    """The average of objectives; of ln det, which grows with the number of parameters, every model counts by its efficiency."""
    cases = [case for objective in objectives for case in objective.cases]
    sizes = [case.interest if isinstance(case.criterion, Determinant) else 1 for case in cases]
    shares = [sizes[0] / size / len(cases) for size in sizes]
    return Objective(tuple(replace(case, weight=case.weight * share) for case, share in zip(cases, shares, strict=True)))


_MOST = 100
_TURNS_DEG = (0.0, 45.0, 90.0)
_SMALLER = 2.0 / 3.0
_MISSED, _TRUNCATED = 1.1, 8.0
_REWEIGHTED = 3
_POINTS = 8
_LEVELS = 5
_STARTS = 2


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
    outcome : Outcome
    targets : dict of parameter to sd
        In inside units; empty where a power is asked for.
    power : float, optional
        Probability of decisive evidence.
    threshold : float
        |ln B| called decisive [nat].
    tests : int
        Of the design.
    most : int
        Tests tried at most.
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


def fewest(space: DesignSpace, power: float | None) -> tuple[Found, Goal]:
    """The design of the fewest tests that reach the targets of the space (in units of which its criterion is "a"), or the power
    (criterion "discriminate"); where none does, that of as many as the pilot has."""
    for name, value in space.targets.items():
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(f"target of {name} must be a positive sd, got {value}. Give it in mm, N and rad.")
    if power is not None and not 0.0 < power < 1.0:
        raise InputError(f"power must lie between 0 and 1, got {power}. For example 0.9.")
    goal = Goal(Outcome.REACHED, dict(space.targets), power, space.threshold, 0)
    if space.augment and _shortfall(space.forecast((), decide=not goal.targets), goal) <= 1.0:
        return space.search.of_number(1), replace(goal, outcome=Outcome.ALREADY, tests=1)
    found = _fewest(space, goal)
    if found is not None:
        return found, replace(goal, tests=int(found.counts.sum()))
    found = space.search.of_number(max(len(space.pilot.tests), space.levels))
    remedies = []
    for kind, wider in _wider(space):
        better = _fewest(wider, goal)
        if better is not None:
            radius = wider.radii_mm[-1] if kind is RemedyKind.RADIUS else None
            remedies.append(Remedy(kind, int(better.counts.sum()), radius))
    return found, replace(goal, outcome=Outcome.OUT_OF_REACH, tests=int(found.counts.sum()), remedies=tuple(remedies))


def _fewest(space: DesignSpace, goal: Goal) -> Found | None:
    """The design of the fewest tests that reaches the goal, by bisection; None where no number does."""
    tried: dict[int, tuple[Found, bool]] = {}

    def met(number: int) -> bool:
        if number not in tried:
            tried[number] = _try(space, goal, number)
        return tried[number][1]

    if _hopeless(space):
        return None
    low, high = space.levels - 1, max(space.levels, _first_possible(space))
    while not met(high):
        if high == _MOST:
            return None
        low, high = high, min(2 * high, _MOST)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if met(middle) else (middle, high)
    return tried[high][0]


def _shortfall(forecast: Forecast, goal: Goal) -> float:
    """The largest ratio of expected sd to target, or of the power wanted to that expected."""
    if goal.targets:
        return max(forecast.expected[name].sd / value for name, value in goal.targets.items())
    found = forecast.discrimination
    if found is None:
        raise InputError("power must be asked of a model with slopes and proper priors. Use degree 1 and the default preset.")
    expected = next(iter(found.power.values())) if len(found.power) == 1 else found.decisive_with
    return float(goal.power or 0.0) / max(expected, 1e-12)


def _hopeless(space: DesignSpace) -> bool:
    """Whether even the best shares of the largest number miss the targets by far; truncation may more than halve an sd."""
    if not space.targets:
        return False
    bound = space.bound
    bounded = any(bound.truncation.rows[:, bound.names.index(name)].any() for name in space.targets)
    return space.search.shares(float(_MOST)).value < -(_TRUNCATED if bounded else _MISSED)


def _first_possible(space: DesignSpace) -> int:
    """Where to begin: the smallest power of two whose best shares reach the targets on average, truncation aside."""
    number = 1
    while space.targets and number < _MOST and space.search.shares(float(number)).value < -1.0:
        number *= 2
    return min(number, _MOST)


def _try(space: DesignSpace, goal: Goal, number: int) -> tuple[Found, bool]:
    """The best whole tests of a number, and whether they reach the goal; targets missed while others are exceeded gain weight."""
    plain = search = space.search
    reached = False
    for _ in range(_REWEIGHTED):
        found = search.of_number(number, starts=_STARTS)
        forecast = space.forecast(space.tests_of(found), decide=not goal.targets)
        reached = _shortfall(forecast, goal) <= 1.0
        criterion = search.objective.cases[0].criterion
        value = plain.objective.value(found.counts.astype(float))
        if reached or not isinstance(criterion, Variance) or value < -1.0:
            break
        ratio = np.array([forecast.expected[name].sd / goal.targets[name] for name in space.chosen])
        search = space._search(search.objective.under(Variance(ratio[:, None] * criterion.weight * ratio)))
    # Value and efficiency by the criterion that was asked for.
    optimum = plain.shares(float(number))
    return replace(found, value=value, optimum=optimum, efficiency=plain.objective.efficiency(value, optimum.value)), reached


def _wider(space: DesignSpace) -> Iterator[tuple[RemedyKind, DesignSpace]]:
    """The space enlarged by what its force levels cannot do, one thing at a time, at few of its own levels."""
    levels = sorted(space.forces_N)
    few = tuple(dict.fromkeys(levels[round(i)] for i in np.linspace(0, len(levels) - 1, _LEVELS)))
    if len(levels) < _LEVELS:
        between = tuple(np.linspace(levels[0], levels[-1], 2 * _LEVELS - 1).tolist())
        yield RemedyKind.LEVELS, replace(space, forces_N=between)
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


def trade_off(space: DesignSpace, tests: int) -> pd.DataFrame:
    """Number of tests, up to twice that of a design, their cost, efficiency, that of equal steps, and every expected sd."""
    around = np.rint(np.geomspace(max(2, tests // 2), max(2 * tests, 4), _POINTS)).astype(int)
    rows = []
    for number in np.union1d(around, [tests]).tolist():
        try:
            found = space.search.of_number(number, starts=_STARTS)
        except InputError:
            continue
        own = space.tests_of(found)
        rows.append(
            {
                "tests": number,
                "cost": space.costs.of(own),
                "efficiency": min(found.efficiency, 1.0),
                "efficiency_equal_steps": space.efficiency(space.equal_steps(number)),
                **{f"sd_{name}": entry.sd for name, entry in space.forecast(own, decide=False).expected.items()},
            }
        )
    return pd.DataFrame(rows)


_HYPERS = {
    "kappa": "discrepancy",
    "tau": "ball form",
    "delta": "set-up shift",
    "delta_0": "set-up shift of order 0",
    "delta_1": "set-up shift of order 1",
}


def default_assumptions(space: DesignSpace) -> dict[str, tuple[HybridModel, Mapping[str, float]]]:
    """Discrepancy, ball form and set-up shift half and twice as large, slopes expected a third and three times as large, and no
    slopes where parameters of interest are left."""
    model = space.model
    every: dict[str, tuple[HybridModel, Mapping[str, float]]] = {
        f"{name} {much}": (model, {hyper: factor})
        for hyper, name in _HYPERS.items()
        if hyper in model.hypers
        for much, factor in (("a half", 0.5), ("twice", 2.0))
    }
    if model.degree and not model.prior.flat:
        for much, factor in (("a third", 1.0 / 3.0), ("three times", 3.0)):
            every[f"slopes {much}"] = (model.with_slope_scale(factor * model.prior.slope_scale), {})
    if model.degree:
        every["constant compliance"] = (model.with_degree(0), {})
    return {label: own for label, own in every.items() if set(space.chosen) & set(own[0].bind(space.pilot).names)}


def robustness(space: DesignSpace, found: Found, steps: Sequence[CircularTest]) -> pd.DataFrame:
    """Efficiency under each assumption (columns) of the design good over all, of the best for each, and of equal steps of force.

    Column ``tests`` lists their forces, ``worst`` is the smallest efficiency.
    """
    number = int(found.counts.sum())
    best = {label: search.shares(float(number)).value for label, search in space.alone.items()}
    designs = {"good over all": found}
    designs |= {f"best for: {label}": search.of_number(number, starts=1, thorough=False) for label, search in space.alone.items()}

    def row(objectives: Mapping[str, Objective], counts: Array, tests: Sequence[CircularTest]) -> dict[str, Any]:
        own = {
            label: min(objective.efficiency(objective.value(counts), best[label]), 1.0) for label, objective in objectives.items()
        }
        forces = sorted(float(test.force_N or 0.0) for test in tests)
        return own | {"tests": ", ".join(f"{force:.4g}" for force in forces), "worst": min(own.values())}

    alone = {label: search.objective for label, search in space.alone.items()}
    rows = {name: row(alone, own.counts.astype(float), space.tests_of(own)) for name, own in designs.items()}
    rows["equal steps"] = row(space.objectives(steps), np.ones(len(steps)), steps)
    return pd.DataFrame.from_dict(rows, orient="index")
