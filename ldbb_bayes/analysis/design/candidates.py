"""The tests one could run, what they cost, in which order to run them; and the space of designs made of them.

Model properties, F0, force range and Ĉ, are the pilot's. Ball forms count as two terms as soon as any clocking differs; where
none does, two terms and one are the same model.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations, islice, pairwise, permutations, product
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ldbb_bayes.analysis.design.criteria import CriterionName, Objective, case_of, chosen_parameters, criterion_of, together
from ldbb_bayes.analysis.design.forecast import (
    DECISIVE,
    Expected,
    Forecast,
    States,
    discrimination_of,
    hyper_nodes,
    narrowed,
    posteriors,
    states_before,
)
from ldbb_bayes.analysis.design.solvers import MOST_TESTS, Found, Search, better, optimal_shares
from ldbb_bayes.campaign.campaign import Campaign, CircularTest, Direction
from ldbb_bayes.errors import InputError, check_known, require
from ldbb_bayes.machine.chain import PLANES
from ldbb_bayes.model.fourier import TRAVEL
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.hybrid import BoundModel, HybridModel

__all__ = [
    "Clocking",
    "Costs",
    "Space",
    "bind_tests",
    "foreseen_by",
    "frame_of",
    "grid_of_tests",
    "place_columns",
    "running_order",
    "templates",
]

Array = NDArray[Any]
Clocking = tuple[float, float]
_ALWAYS = ("work_ball_deg", "tool_ball_deg", "radius_mm")
_WHERE_DIFFERENT = ("plane", "direction", "setup", "centre_x_mm", "centre_y_mm", "centre_z_mm")
_ALL_ORDERS, _DRAWN = 5, 50


def place_columns(tests: Sequence[CircularTest]) -> tuple[str, ...]:
    """What to say of every test beside its force: clockings and radius, and the rest where it differs."""
    return (*_ALWAYS, *(name for name in _WHERE_DIFFERENT if len({getattr(test, name) for test in tests}) > 1))


def frame_of(tests: Sequence[CircularTest], columns: Sequence[str]) -> pd.DataFrame:
    """One row per test: force_N and these columns."""
    rows = [[test.force_N, *("" if (v := getattr(test, name)) is None else v for name in columns)] for test in tests]
    return pd.DataFrame(rows, columns=["force_N", *columns])


def templates(
    pilot: Campaign, planes: Sequence[str], directions: Sequence[Direction], centres_mm: Sequence[tuple[float, float, float]]
) -> tuple[CircularTest, ...]:
    """A test without readings for every plane, direction and centre; what is left open is as in the pilot.

    In a plane it is like the pilot's test there with the median number of readings. A plane or a centre that the pilot lacks is
    another set-up: the work ball is mounted anew.
    """
    made = []
    new = max(test.setup or 1 for test in pilot.tests)
    for plane in planes or tuple(dict.fromkeys(str(test.plane) for test in pilot.tests)):
        there = [test for test in pilot.tests if test.plane == plane]
        ordered = sorted(there or pilot.tests, key=lambda test: len(test.angle_deg))
        plain = ordered[len(ordered) // 2].with_reading_um(None)
        plain = replace(plain, pressure_bar=None, name="", temperature_C=None, time_s=None, plane=plane)
        ways: Sequence[Direction | None] = directions or tuple(dict.fromkeys(test.direction for test in (there or pilot.tests)))
        for x, y, z in centres_mm or (plain.circle.centre_mm,):
            like = replace(plain, centre_x_mm=x, centre_y_mm=y, centre_z_mm=z)
            mounted = next((test.setup for test in there if test.circle.centre_mm == like.circle.centre_mm), 0)
            new += mounted == 0
            made += [replace(like, setup=new if mounted == 0 else mounted, direction=way) for way in ways]
    return tuple(made)


def foreseen_by(pilot: Campaign, candidates: Sequence[CircularTest], judged: Sequence[CircularTest] = ()) -> Campaign:
    """The pilot, knowing of tests of a kind it has not run: what only they can show is in its model.

    Where candidates go both ways in a plane, so do those foreseen: hysteresis then counts for every design. Tests that are only
    judged bring their parameters, not their direction.
    """
    both = {plane for plane in PLANES if {"CW", "CCW"} <= {test.direction for test in candidates if test.plane == plane}}
    possible = [test if str(test.plane) in both else replace(test, direction=None) for test in candidates]
    possible += [replace(test, direction=None) for test in judged]
    centres = [test.circle.centre_mm for test in (*pilot.scope, *possible)]
    offset = any(any(place) for place in (*pilot.frames_mm.values(), *centres))

    def kind(test: CircularTest, *way: Any) -> tuple[Any, ...]:
        return (test.plane, test.setup, test.circle.centre_mm, test.radius_mm if offset else None, *way)

    # A direction counts as foreseen only where it is: the pilot's own tests need not be part of what is analysed.
    there = {kind(test) for test in pilot.scope} | {kind(test, test.direction) for test in pilot.foreseen}
    further = {kind(test, *([test.direction] if test.direction else [])): test for test in reversed(possible)}
    new = [test for key, test in further.items() if key not in there]
    return replace(pilot, foreseen=(*pilot.foreseen, *new)) if new else pilot


def grid_of_tests(
    templates: Sequence[CircularTest],
    forces_N: Sequence[float],
    clockings_deg: Sequence[Clocking],
    radii_mm: Sequence[float],
    readings: int | None,
) -> tuple[CircularTest, ...]:
    """Every combination as a planned test: all forces of the first template, radius and clocking (work, tool), then of the next.

    Templates give all else, and the angles where the number of readings of a full circle is not given.
    """
    plain = [t if readings is None else replace(t, angle_deg=np.arange(readings) * 360.0 / readings) for t in templates]
    return tuple(
        replace(like, force_N=float(force), work_ball_deg=float(work), tool_ball_deg=float(tool), radius_mm=float(radius))
        for like, radius, (work, tool), force in product(plain, radii_mm, clockings_deg, forces_N)
    )


def bind_tests(model: HybridModel, pilot: Campaign, tests: Sequence[CircularTest], *, keep: bool) -> BoundModel:
    """The model bound to a plan of these tests, after the pilot's own where these are kept; F0, force range and Ĉ the pilot's."""
    run = pilot.plan().tests
    planned = tuple(replace(test, name="") for test in tests)
    known = (*pilot.foreseen, *(replace(test, direction=None) for test in run))
    return BoundModel(model, replace(pilot, tests=(*(run if keep else ()), *planned), foreseen=known), pilot=pilot)


@dataclass(frozen=True)
class Costs:
    """Costs in one unit, for example minutes.

    Parameters
    ----------
    circle : float
        Of each circle.
    work_ball : float
        Of each change of the work ball's clocking: a set-up anew.
    tool_ball : float
        Of each change of the tool ball's clocking, which the spindle turns.
    """

    circle: float = 1.0
    work_ball: float = 0.0
    tool_ball: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value >= 0.0) or (name == "circle" and value == 0.0):
                raise InputError(f"cost of {name} must be a number ≥ 0, that of a circle > 0, got {value}. Correct it.")

    def of(self, tests: Sequence[CircularTest]) -> float:
        """Cost of tests run in blocks of one work-ball clocking, each in blocks of one tool-ball clocking."""
        return self.circle * len(tests) + self.setups({(test.work_ball_deg, test.tool_ball_deg) for test in tests})

    def setups(self, clockings_deg: Collection[Clocking]) -> float:
        """Cost of changing over between clockings (work ball, tool ball), in the order that changes the tool ball least."""
        works = len({work for work, _ in clockings_deg})
        return self.work_ball * max(works - 1, 0) + self.tool_ball * _tool_changes(_best_sequence(clockings_deg))


def _best_sequence(clockings_deg: Collection[Clocking]) -> list[Clocking]:
    """Clockings in blocks of the work ball, with few changes of the tool ball."""
    works = sorted({work for work, _ in clockings_deg})
    orders: Iterable[Sequence[float]] = permutations(works) if len(works) <= _ALL_ORDERS else [works]
    return min((_sequence(clockings_deg, order) for order in orders), key=_tool_changes)


def _sequence(clockings_deg: Collection[Clocking], works: Sequence[float]) -> list[Clocking]:
    """Blocks in this order: each begins with the tool-ball clocking in place and ends with one that the next block needs."""
    tools = {work: sorted({tool for own, tool in clockings_deg if own == work}) for work in works}
    made: list[Clocking] = []
    for work, following in zip(works, (*works[1:], None), strict=True):
        block = tools[work]
        first = made[-1][1] if made else None
        last = next((tool for tool in block if tool in tools.get(following, ()) and tool != first), None)  # type: ignore[arg-type]
        rank = {first: -1, last: 1} if len(block) > 1 else {}
        made += [(work, tool) for tool in sorted(block, key=lambda tool: rank.get(tool, 0))]
    return made


def _tool_changes(sequence: Sequence[Clocking]) -> int:
    return sum(one[1] != other[1] for one, other in pairwise(sequence))


def running_order(tests: Sequence[CircularTest], rng: np.random.Generator) -> tuple[CircularTest, ...]:
    """The tests in the order in which to run them, so that drift is not force: blocks of one set-up and radius, in them of one
    work-ball clocking, in them of one tool-ball clocking, forces and directions of travel at random.

    The clockings' order is drawn among those that change the tool ball least.
    """
    ordered: list[CircularTest] = []
    for setup in _shuffled({test.setup or 1 for test in tests}, rng):
        mounted = [test for test in tests if (test.setup or 1) == setup]
        for place in _shuffled({_mounting(test) for test in mounted}, rng):
            ordered += _order_of_block([test for test in mounted if _mounting(test) == place], rng)
    return tuple(replace(test, name="") for test in ordered)


def _mounting(test: CircularTest) -> tuple[Any, ...]:
    """What cannot be changed without touching the bar or its mounts."""
    return (str(test.plane), float(test.radius_mm or 0.0), test.circle.centre_mm)


def _shuffled(places: Collection[Any], rng: np.random.Generator) -> list[Any]:
    ordered = sorted(places)
    return [ordered[i] for i in rng.permutation(len(ordered))]


def _order_of_block(tests: Sequence[CircularTest], rng: np.random.Generator) -> list[CircularTest]:
    clockings = {(test.work_ball_deg, test.tool_ball_deg) for test in tests}
    best = _best_sequence(clockings)
    drawn = (_sequence(clockings, _shuffled({work for work, _ in clockings}, rng)) for _ in range(_DRAWN))
    ordered: list[CircularTest] = []
    for clocking in next((own for own in drawn if _tool_changes(own) <= _tool_changes(best)), best):
        block = [test for test in tests if (test.work_ball_deg, test.tool_ball_deg) == clocking]
        ordered += [block[i] for i in rng.permutation(len(block))]
    return ordered


Assumption = tuple[HybridModel, Mapping[str, float]]
_ALONE, _AMONG_SEVERAL, _REPORTED = 12, 3, 128
_MOST_CANDIDATES, _FEWEST_READINGS, _MOST_READINGS = 5000, 25, 100_000
_GIVEN = "as in the model"
_MOST_TRIALS, _FEW_STARTS, _AS_GOOD, _QUICK, _ROUGH = 120, 2, 0.998, 4, 1e-3
_POINTS = 8
_HYPERS = {
    "kappa": "discrepancy",
    "tau": "ball form",
    "delta": "set-up shift",
    "delta_0": "set-up shift of order 0",
    "delta_1": "set-up shift of order 1",
}


@dataclass(frozen=True, eq=False)
class Space:
    """What is to be designed: the arguments of `ldbb_bayes.design` but for its goal, and what follows from them.

    ``judged`` are the tests of designs that are to be compared; ``robust`` averages over `assumptions`.
    """

    model: HybridModel
    pilot: Campaign
    forces_N: Sequence[float]
    clockings_deg: Sequence[Clocking] = ((0.0, 0.0),)
    radii_mm: Sequence[float] = ()
    planes: Sequence[str] = ()
    directions: Sequence[Direction] = ()
    centres_mm: Sequence[tuple[float, float, float]] = ()
    readings: int | None = None
    criterion: CriterionName = "eig"
    parameters: Sequence[str] = ()
    augment: bool = False
    costs: Costs = field(default_factory=Costs)
    slope_size: float = 1.0
    threshold: float = DECISIVE
    targets: Mapping[str, float] = field(default_factory=dict)
    robust: bool = False
    judged: tuple[CircularTest, ...] = ()
    seed: int = 1

    def __post_init__(self) -> None:
        radii = self.radii_mm or [float(test.radius_mm or self.pilot.radius_mm) for test in self.pilot.tests]
        turned = {(work % 360.0, tool % 360.0): (work, tool) for work, tool in reversed(self.clockings_deg)}
        options = {"forces_N": self.forces_N, "radii_mm": radii, "clockings_deg": reversed(turned.values())}
        options |= {name: getattr(self, name) for name in ("planes", "directions")} | {"centres_mm": map(tuple, self.centres_mm)}
        self.__dict__.update({name: tuple(dict.fromkeys(values)) for name, values in options.items()})
        self._check()
        self.__dict__["pilot"] = foreseen_by(self.pilot, self.tests, self.judged)
        check_known("target", self.targets, self.bound.names)
        _ = self.chosen

    def _check(self) -> None:
        for name, values, unit in (("forces", self.forces_N, "N"), ("radii", self.radii_mm, "mm")):
            wrong = next((value for value in values if not (np.isfinite(value) and value > 0.0)), None)
            require(wrong is None, f"{name} must be > 0 {unit}, got {wrong or 0:g}. Correct the range.")
        require(
            bool(self.forces_N and self.clockings_deg),
            "a design must have forces and clockings to choose from, got none. Give at least one of each.",
        )
        for name in ("slope_size", "threshold"):
            value = getattr(self, name)
            require(np.isfinite(value) and value > 0.0, f"{name} must be a positive number, got {value}. Correct it.")
        check_known("plane", self.planes, PLANES)
        check_known("direction", self.directions, TRAVEL)
        count = len(self.forces_N) * len(self.clockings_deg) * len(self.radii_mm) * len(self.templates)
        require(
            count <= _MOST_CANDIDATES,
            f"a design must choose among at most {_MOST_CANDIDATES} candidates, got {count}. Take longer steps of force or fewer "
            "clockings.",
        )
        require(
            self.readings is None or _FEWEST_READINGS <= self.readings <= _MOST_READINGS,
            f"readings must be between {_FEWEST_READINGS} and {_MOST_READINGS} per circle, got {self.readings}. Correct it.",
        )
        require(
            isinstance(self.costs, Costs),
            f"costs must be Costs, got {type(self.costs).__name__}. Write lb.Costs(circle=10.0, work_ball=30.0).",
        )

    @cached_property
    def bound(self) -> BoundModel:
        """The model bound to the pilot alone."""
        return self.model.bind(self.pilot)

    @cached_property
    def chosen(self) -> tuple[str, ...]:
        """The parameters of interest."""
        return chosen_parameters(self.bound, self.criterion, self.parameters)

    @cached_property
    def templates(self) -> tuple[CircularTest, ...]:
        """One test for every plane, direction and centre."""
        return templates(self.pilot, self.planes, self.directions, self.centres_mm)

    @cached_property
    def tests(self) -> tuple[CircularTest, ...]:
        """The candidates."""
        return grid_of_tests(self.templates, self.forces_N, self.clockings_deg, self.radii_mm, self.readings)

    def tests_of(self, found: Found) -> tuple[CircularTest, ...]:
        """The tests of a design, one as often as it is to be run."""
        return tuple(self.tests[i] for i in np.repeat(np.arange(len(self.tests)), found.counts))

    def equal_steps(self, number: int) -> tuple[CircularTest, ...]:
        """Equal steps of force, each at the nearest level there is, at the first clocking and radius; in turn over planes,
        directions and centres."""
        levels = np.array(sorted(self.forces_N))
        steps = np.linspace(levels[0], levels[-1], number)
        nearest = [float(levels[np.argmin(np.round(np.abs(levels - step), 9))]) for step in steps]
        every, first = len(self.templates), (self.clockings_deg[:1], self.radii_mm[:1], self.readings)
        return tuple(test for k, like in enumerate(self.templates) for test in grid_of_tests([like], nearest[k::every], *first))

    @cached_property
    def assumptions(self) -> dict[str, Assumption]:
        """Models with factors of their hyper-parameters: as given; where robust, discrepancy, ball form and set-up shift half and
        twice as large, slopes expected a third and three times as large, and no slopes where parameters of interest are left."""
        model = self.model
        every: dict[str, Assumption] = {_GIVEN: (model, {})}
        if not self.robust:
            return every
        for hyper, name in _HYPERS.items():
            if hyper in model.hypers:
                every |= {f"{name} {much}": (model, {hyper: factor}) for much, factor in (("a half", 0.5), ("twice", 2.0))}
        if model.degree and not model.prior.flat:
            for much, factor in (("a third", 1.0 / 3.0), ("three times", 3.0)):
                every[f"slopes {much}"] = (model.with_slope_scale(factor * model.prior.slope_scale), {})
        if model.degree:
            every["constant compliance"] = (model.with_degree(0), {})
        return {label: own for label, own in every.items() if set(self.chosen) & set(own[0].bind(self.pilot).names)}

    def objectives(self, tests: Sequence[CircularTest]) -> dict[str, Objective]:
        """The criterion of any tests under every assumption alone."""
        bounds: list[tuple[BoundModel, Array]] = []
        found = {}
        for label, (model, factors) in self.assumptions.items():
            if not any(bound.model == model for bound, _ in bounds):
                nodes = hyper_nodes(model, self.pilot, _AMONG_SEVERAL if self.robust else _ALONE, self.seed)
                bounds.append((bind_tests(model, self.pilot, tests, keep=self.augment), nodes))
            bound, nodes = next(own for own in bounds if own[0].model == model)
            phi = nodes * np.array([factors.get(name, 1.0) for name in bound.hyper_prior.names])
            names = tuple(name for name in self.chosen if name in bound.names)
            criterion = criterion_of(bound, self.criterion, names, size=self.slope_size, targets=self.targets)
            found[label] = Objective((case_of(bound, len(self.pilot.tests) if self.augment else 0, phi, names, criterion),))
        return found

    @cached_property
    def alone(self) -> dict[str, Search]:
        """The candidates under every assumption alone."""
        forces, levels = np.array([test.force_N for test in self.tests]), 1 if self.augment or not self.model.degree else 2
        return {label: Search(own, forces, levels, self.seed) for label, own in self.objectives(self.tests).items()}

    @cached_property
    def search(self) -> Search:
        """The candidates under the criterion, averaged over all assumptions."""
        return replace(self.alone[_GIVEN], objective=together(search.objective for search in self.alone.values()))

    def of_budget(self, budget: float) -> Found:
        """The best design that costs no more: ever more clockings of the balls are tried while they are worth their set-ups."""
        if budget / self.costs.circle > MOST_TESTS:
            raise InputError(
                f"budget must pay for at most {MOST_TESTS} circles, got {budget:g} with {self.costs.circle:g} each. Lower it."
            )
        best: Found | None = None
        used: tuple[Clocking, ...] = ()
        # Two more clockings at once where one alone is not worth its set-up.
        more = 1
        while more <= 2:
            wider = self._wider(budget, used, more)
            if wider is not None and (best is None or better(wider[0].value, best.value)):
                (best, used), more = wider, 1
            else:
                more += 1
        if best is None:
            raise InputError(
                f"budget must pay for at least {self.search.levels} circle{'s' * (self.search.levels > 1)}, got {budget:g} with "
                f"{self.costs.circle:g} per circle. Raise it."
            )
        return best

    def _wider(self, budget: float, used: tuple[Clocking, ...], more: int) -> tuple[Found, tuple[Clocking, ...]] | None:
        """The first design with so many more clockings that is as good as any, ranked with few values of the hyper-parameters."""
        clocked = [(test.work_ball_deg, test.tool_ball_deg) for test in self.tests]
        quick, trials = self.search.objective.at_few(_QUICK), []
        for further in islice(combinations([own for own in dict.fromkeys(clocked) if own not in used], more), _MOST_TRIALS):
            clockings = (*used, *further)
            number = int(np.floor((budget - self.costs.setups(clockings)) / self.costs.circle * (1.0 + 1e-12)))
            if number >= max(len(clockings), self.search.levels):
                allowed = np.flatnonzero([own in clockings for own in clocked])
                value = optimal_shares(quick.among(allowed), float(number), tolerance=_ROUGH).value
                trials.append((value, clockings, number, allowed))
        highest = max((trial[0] for trial in trials), default=0.0)
        for value, clockings, number, allowed in trials:
            if quick.efficiency(value, highest) >= _AS_GOOD:
                best = self.search.among(allowed).of_number(number, starts=_FEW_STARTS)
                counts = np.bincount(allowed, best.counts, len(clocked)).astype(int)
                return replace(best, counts=counts, allowed=allowed), clockings
        return None

    def value(self, tests: Sequence[CircularTest]) -> float:
        """The criterion of any tests, candidates or not."""
        return together(self.objectives(tests).values()).value(np.ones(len(tests)))

    def efficiency(self, tests: Sequence[CircularTest]) -> float:
        """Of any tests, candidates or not, beside the best shares of as many candidates."""
        return self.search.objective.efficiency(self.value(tests), self.search.shares(float(len(tests))).value)

    @cached_property
    def states(self) -> States:
        """The machine as it may be before these tests."""
        return states_before(self.model, self.pilot, _REPORTED, self.seed, augment=self.augment)

    def forecast(self, tests: Sequence[CircularTest], *, decide: bool = True, states: States | None = None) -> Forecast:
        """What to expect of tests (added to the pilot's own when ``augment``), over more hyper-parameters than the search uses;
        with ``decide`` of slopes or none too. ``states``: the machine as it may be before them."""
        states = self.states if states is None else states
        bound = bind_tests(self.model, self.pilot, tests, keep=self.augment)
        after, floor = posteriors(bound, states.phi)
        if after is None:
            nothing = {p.name: Expected(p.unit, p.prior_sd, np.inf, np.inf, np.inf) for p in bound.parameters}
            return Forecast(nothing, np.inf, None)
        scale, covariance = bound.scale, after.covariance
        gaussian = scale * np.sqrt(np.einsum("kii->ki", covariance).mean(axis=0))
        inside = np.sqrt(narrowed(bound, states, covariance * np.outer(scale, scale), self.seed))
        expected = {
            p.name: Expected(p.unit, p.prior_sd, float(sd), float(plain), float(min(least, least * sd / plain)))
            for p, sd, plain, least in zip(bound.parameters, inside, gaussian, scale * floor, strict=True)
        }
        if self.model.prior.flat:
            return Forecast(expected, np.inf, None)
        gain = float(-0.5 * np.linalg.slogdet(covariance)[1].mean())
        slopes = self.chosen if self.criterion == "discriminate" else [p.name for p in bound.parameters if p.group == "slope"]
        own = [bound.names.index(name) for name in slopes] if decide else []
        if not own:
            return Forecast(expected, gain, None)
        before = states.before.marginal(own) if self.augment and not self.pilot.is_plan else None
        decision = discrimination_of(
            covariance[:, own][:, :, own],
            tuple(slopes),
            size=self.slope_size,
            before=before and Gaussian.factored(before.mean / scale[own], before.root, before.scale / scale[own]),
            threshold=self.threshold,
            seed=self.seed,
        )
        return Forecast(expected, gain, decision)

    def trade_off(self, tests: int) -> pd.DataFrame:
        """Number of tests, up to twice that of a design, their cost, efficiency, that of equal steps, and every expected sd."""
        around = np.rint(np.geomspace(max(2, tests // 2), max(2 * tests, 4), _POINTS)).astype(int)
        rows = []
        for number in np.union1d(around, [tests]).tolist():
            try:
                found = self.search.of_number(number, starts=_FEW_STARTS)
            except InputError:
                continue
            own = self.tests_of(found)
            row = {"tests": number, "cost": self.costs.of(own), "efficiency": min(found.efficiency, 1.0)}
            row["efficiency_equal_steps"] = self.efficiency(self.equal_steps(number))
            expected = self.forecast(own, decide=False).expected
            rows.append(row | {f"sd_{name}": entry.sd for name, entry in expected.items()})
        return pd.DataFrame(rows)

    def robustness(self, found: Found, steps: tuple[CircularTest, ...]) -> pd.DataFrame:
        """Efficiency under each assumption (columns) of the design good over all, of the best for each, and of equal steps.

        Column ``tests`` lists their forces, ``worst`` is the smallest efficiency.
        """
        alone = self.alone
        objectives = {label: search.objective for label, search in alone.items()}
        designs = {"good over all": found}
        designs |= {f"best for: {label}": own.of_number(found.tests, starts=1, thorough=False) for label, own in alone.items()}
        rows = {name: (objectives, own.counts.astype(float), self.tests_of(own)) for name, own in designs.items()}
        rows["equal steps"] = self.objectives(steps), np.ones(len(steps)), steps
        shown = {}
        for name, (judges, counts, tests) in rows.items():
            best = {label: alone[label].shares(float(found.tests)).value for label in judges}
            own = {label: min(judge.efficiency(judge.value(counts), best[label]), 1.0) for label, judge in judges.items()}
            forces = ", ".join(f"{force:.4g}" for force in sorted(float(test.force_N or 0.0) for test in tests))
            shown[name] = own | {"tests": forces, "worst": min(own.values())}
        return pd.DataFrame.from_dict(shown, orient="index")
