"""Choices from which a design is made: candidate tests, criterion and parameters of interest.

The pilot is the campaign or plan that a design starts from. Candidates are tests that could be run,
once or several times. A clocking is the pair of angles by which the balls are turned. The criterion
measures how good a design is.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Literal, get_args

import numpy as np
import pandas as pd

from ldbb_bayes.analysis.design.bound_plans import bind_tests
from ldbb_bayes.analysis.design.campaign_objective import objective_of, prediction_weight
from ldbb_bayes.analysis.design.candidates import (
    Clocking,
    add_foreseen_tests,
    grid_of_tests,
    templates,
)
from ldbb_bayes.analysis.design.criteria import Criterion, Determinant, LogBayesFactor, Variance
from ldbb_bayes.analysis.design.forecast import Forecast, Slopes, forecast_plan
from ldbb_bayes.analysis.design.objective import Objective
from ldbb_bayes.analysis.design.randomisation import running_order
from ldbb_bayes.analysis.design.search import ExactDesign, Search
from ldbb_bayes.analysis.design.simulated_analyses import SimulatedAnalyses
from ldbb_bayes.analysis.design.states import hyper_nodes
from ldbb_bayes.campaign.campaign import Campaign, CircularTest, Direction
from ldbb_bayes.errors import check_known, require
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.model.setting import TRAVEL_SIGNS
from ldbb_bayes.model.terms import Drift
from ldbb_bayes.units import inside_name

__all__ = ["CriterionName", "Space"]

CriterionName = Literal["eig", "d", "a", "c", "i", "discriminate"]
# Columns of tables of tests, in addition to the force. Every table contains the columns
# ``_FIXED_COLUMNS``. A column of ``_OPTIONAL_COLUMNS`` is included only if the tests differ in the
# property that it shows; the direction also if it is not that of the pilot's tests.
_FIXED_COLUMNS = ("work_ball_deg", "tool_ball_deg", "radius_mm")
_OPTIONAL_COLUMNS = ("plane", "direction", "setup")
# Regular expression for the name of a campaign that ends in its number, such as "spindle 4 (2)".
_NUMBERED = re.compile(r"(?P<name>.*) \((?P<number>\d{1,3})\)")
# Number of values of the hyper-parameters that the search for a design averages over. Larger
# numbers have led to the same designs.
_SEARCH_NODES = 12
_MAX_CANDIDATES = 5000
# ``_ALL_GROUPS`` holds all groups of parameters: compliances, slopes (changes of compliance with
# force) and geometric errors. The keys of ``_GROUPS_BY_CRITERION`` are design criteria; each value
# holds the groups whose parameters may be of interest. For a criterion without an entry, the
# parameters of all groups may be of interest.
_ALL_GROUPS = {"compliance", "slope", "geometric"}
_GROUPS_BY_CRITERION = {"discriminate": {"slope"}, "i": {"compliance", "slope"}}


@dataclass(frozen=True, eq=False)
class Space:
    """Candidate tests of a design, criterion by which they are chosen, and parameters of interest.

    The attributes are the arguments of `ldbb_bayes.design` except the number of tests. Repeated
    values are removed.

    The pilot may list foreseen tests, that is, tests that may be run later; the model includes
    every effect that these tests can reveal. Two tests are of the same kind if they agree in plane,
    set-up, centre, radius and direction. If the candidates include a kind of test that the pilot
    does not have, one candidate of this kind is added to the foreseen tests.
    """

    model: HybridModel
    pilot: Campaign
    forces_N: Sequence[float]
    clockings_deg: Sequence[Clocking] = ((0.0, 0.0),)
    radii_mm: Sequence[float] = ()
    directions: Sequence[Direction] = ()
    criterion: CriterionName = "eig"
    parameters: Sequence[str] = ()
    augment: bool = False
    slope_size: float = 1.0
    #: tests of designs that will be compared with the best design. The search does not choose among
    #: these tests, but the model includes the parameters that they can determine.
    compared_tests: tuple[CircularTest, ...] = ()
    seed: int = 1

    def __post_init__(self) -> None:
        """Remove repeated values from the attributes, and add foreseen tests to the pilot.

        Foreseen tests are tests that may be run later; the model includes their effects. If no
        radii are given, the radii of the pilot's tests are used. An `InputError` is raised if the
        candidate tests, the criterion or the parameters of interest are not valid.
        """
        radii_mm = self.radii_mm or _radii_of(self.pilot)
        self._store("forces_N", tuple(dict.fromkeys(self.forces_N)))
        self._store("radii_mm", tuple(dict.fromkeys(radii_mm)))
        # CW comes first, so that no result depends on the order in which directions are given.
        directions = sorted(set(self.directions), key=str, reverse=True)
        self._store("directions", tuple(directions))
        self._store("clockings_deg", _distinct_clockings(self.clockings_deg))
        self._check_candidates()
        # The candidate tests are derived from the pilot. They must be made from the pilot that the
        # user gave, before tests that may be run later are added to its field ``foreseen``.
        candidates = self.tests
        self._store("pilot", add_foreseen_tests(self.pilot, candidates, self.compared_tests))
        # Check the parameters of interest last. The check applies the model to the pilot, whose
        # field ``foreseen`` must already contain the added tests.
        self._check_interest()

    def __getstate__(self) -> dict[str, object]:
        """Return the fields for a pickled copy, without the results that were computed from them.

        The derivatives of the readings of all candidate tests, for example, fill hundreds of
        megabytes for three planes. The copy computes such results again if it needs them.
        """
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def _store(self, name: str, value: object) -> None:
        """Set the attribute ``name``; the class is frozen and does not allow a plain assignment."""
        object.__setattr__(self, name, value)

    def _check_candidates(self) -> None:
        """Raise an `InputError` for invalid values, or for too many candidate tests.

        Forces, radii and ``slope_size`` must be positive, and directions of travel must be CW or
        CCW.
        """
        sizes = {"forces": self.forces_N, "radii": self.radii_mm, "slope_size": [self.slope_size]}
        for name, values in sizes.items():
            for value in values:
                require(
                    np.isfinite(value) and value > 0.0,
                    f"{name} must be finite and > 0, got {value:g}. Correct it.",
                )
        check_known("direction", self.directions, TRAVEL_SIGNS)
        circles = len(self.clockings_deg) * len(self.radii_mm) * len(self.templates)
        count = len(self.forces_N) * circles
        require(
            1 <= count <= _MAX_CANDIDATES,
            f"a design must choose among 1 to {_MAX_CANDIDATES} candidates, got {count}. Give"
            " forces and clockings, in longer steps where they are too many.",
        )

    def _check_interest(self) -> None:
        """Raise an `InputError` if the criterion cannot be used for these parameters or priors."""
        groups = {p.group for p in self.bound.parameters if p.name in self.chosen}
        number = len(self.chosen)
        if self.criterion == "c":
            require(number == 1, f"criterion c must be given one parameter, got {number}. Name it.")
        if self.criterion == "discriminate":
            require(
                groups == {"slope"},
                "criterion discriminate must be about slopes, got others or none. Name some"
                " (C_XYX_1), or use a degree above 0.",
            )
        require(
            groups <= _GROUPS_BY_CRITERION.get(self.criterion, _ALL_GROUPS),
            "criterion i must be about compliances and their slopes, got a geometric error. Leave"
            " it out.",
        )
        if self.criterion == "discriminate":
            require(
                not self.model.prior.flat,
                "criterion discriminate must have proper priors, got flat ones. Use the default"
                " preset.",
            )

    @cached_property
    def bound(self) -> BoundModel:
        """The model applied to the tests of the pilot alone, without the candidate tests."""
        return self.model.bind(self.pilot)

    @cached_property
    def chosen(self) -> tuple[str, ...]:
        """Names of the parameters of interest.

        These are the names in ``parameters``. If ``parameters`` is empty, all parameters that the
        design criterion can be applied to are of interest.
        """
        check_known("criterion", [self.criterion], get_args(CriterionName))
        named = [inside_name(name) for name in self.parameters]
        check_known("parameter", named, self.bound.names)
        if named:
            return tuple(name for name in self.bound.names if name in named)
        groups = _GROUPS_BY_CRITERION.get(self.criterion, _ALL_GROUPS)
        return tuple(p.name for p in self.bound.parameters if p.group in groups)

    @cached_property
    def templates(self) -> tuple[CircularTest, ...]:
        """Tests without readings: one for each combination of plane and direction of travel."""
        return templates(self.pilot, self.directions)

    @cached_property
    def tests(self) -> tuple[CircularTest, ...]:
        """The candidate tests: every combination of template, force, clocking and radius.

        A template is a test without readings.
        """
        return grid_of_tests(self.templates, self.forces_N, self.clockings_deg, self.radii_mm)

    def frame(self, tests: Sequence[CircularTest]) -> pd.DataFrame:
        """Return a table of tests with force, angles of the balls and radius, one row per test.

        The table also has columns for plane, direction and set-up. Each of these three columns is
        included only if the property differs between candidate tests or tests of compared designs.
        The direction is also included if it differs from that of the pilot's tests.
        """
        all_tests = (*self.tests, *self.compared_tests)
        values = {name: {getattr(test, name) for test in all_tests} for name in _OPTIONAL_COLUMNS}
        values["direction"] |= {test.direction for test in self.pilot.tests}
        varied = [name for name in _OPTIONAL_COLUMNS if len(values[name]) > 1]
        columns = ["force_N", *_FIXED_COLUMNS, *varied]
        rows = []
        for test in tests:
            row = [getattr(test, name) for name in columns]
            rows.append(["" if value is None else value for value in row])
        return pd.DataFrame(rows, columns=columns)

    def tests_of(self, design: ExactDesign) -> tuple[CircularTest, ...]:
        """Return the tests of a design, each repeated as often as it is to be run."""
        positions = np.repeat(np.arange(len(self.tests)), design.counts)
        return tuple(self.tests[i] for i in positions)

    def equal_steps(self, number: int) -> tuple[CircularTest, ...]:
        """Return ``number`` tests at forces in equal steps, as nearly as the force levels allow.

        Forces in equal steps are computed first. Each is then replaced by the nearest force level.
        All tests have the first clocking in ``clockings_deg`` and the first radius in ``radii_mm``.
        Planes and directions of travel alternate from one force step to the next.
        """
        levels = np.array(sorted(self.forces_N))
        nearest_levels = []
        for step in np.linspace(levels[0], levels[-1], number):
            distances = np.round(np.abs(levels - step), 9)
            nearest_levels.append(float(levels[np.argmin(distances)]))
        tests: list[CircularTest] = []
        for k, template in enumerate(self.templates):
            forces_N = nearest_levels[k :: len(self.templates)]
            tests += grid_of_tests([template], forces_N, self.clockings_deg[:1], self.radii_mm[:1])
        return tuple(tests)

    @property
    def _tests_run(self) -> int:
        """Number of the pilot's tests that are analysed together with the new tests.

        If ``augment`` is true, all tests of the pilot are counted; otherwise the number is zero.
        """
        return len(self.pilot.tests) if self.augment else 0

    def objective(self, tests: Sequence[CircularTest]) -> Objective:
        """Return the objective that a search maximises to find how often to run each of ``tests``.

        These tests need not be among the candidate tests of the design.
        """
        bound = bind_tests(self.model, self.pilot, tests, keep_pilot_tests=self.augment)
        phi = hyper_nodes(self.model, self.pilot, _SEARCH_NODES, self.seed)
        criterion = self._criterion(bound)
        return objective_of(bound, self._tests_run, phi, self.chosen, criterion)

    def _criterion(self, bound: BoundModel) -> Criterion:
        """Return the criterion (figure of merit) by which designs are compared.

        The criterion is computed from the precision (inverse covariance) of the parameters of
        interest.
        """
        size = len(self.chosen)
        if self.criterion == "discriminate":
            return LogBayesFactor(self.slope_size)
        if self.criterion == "i":
            return Variance(prediction_weight(bound, self.chosen))
        if self.criterion in ("a", "c"):
            return Variance(np.eye(size) / size)
        return Determinant(size)

    @cached_property
    def search(self) -> Search:
        """The search that finds how often each candidate test is to be run in the best design."""
        forces_N = np.array([test.force_N for test in self.tests])
        levels = 2
        if self.augment or self.model.degree == 0:
            levels = 1
        return Search(self.objective(self.tests), forces_N, levels, self.seed)

    def efficiency(self, tests: Sequence[CircularTest]) -> float:
        """Return the efficiency of tests, relative to the best design with equally many tests.

        In this best design, the number of runs of a candidate test need not be a whole number.
        """
        value = self.objective(tests).value(np.ones(len(tests)))
        best = self.search.shares(float(len(tests))).value
        return self.search.objective.efficiency(value, best)

    def plan_of(self, tests: Sequence[CircularTest], *, seed: int = 1) -> Campaign:
        """Return a plan of ``tests`` for the pilot's machine, in the order in which to run them.

        ``seed`` is the seed of the random order. Tests that are run in addition to those of the
        pilot have names that none of these has, so that their readings cannot replace others in
        the folder of the pilot.
        """
        ordered = running_order(tests, np.random.default_rng(seed))
        plan = replace(
            self.pilot,
            tests=_with_temperature(ordered, self.pilot, self.model),
            foreseen=(),
            name=_numbered(self.pilot.name),
            date=None,
            operator=None,
            order=None,
            pilot=self.pilot,
            adds_to_pilot=self.augment,
        )
        if self.augment:
            return replace(plan, tests=_named_apart(plan.tests, self.pilot))
        return plan

    def forecast(
        self,
        plan: Campaign,
        *,
        machines: int | None = None,
        analyses: SimulatedAnalyses | None = None,
    ) -> Forecast:
        """Return the forecast of the results of planned tests.

        ``plan`` holds the planned tests; it is a plan that `plan_of` returned. ``machines`` is the
        number of possible machines over which the forecast averages, by default 64. ``analyses``
        are the analyses of these tests, if they have already been simulated.
        """
        slopes = None
        if self.criterion == "discriminate":
            slopes = Slopes(self.chosen, self.slope_size)
        elif self.slope_size != 1.0:
            names = tuple(p.name for p in self.bound.parameters if p.group == "slope")
            slopes = Slopes(names, self.slope_size)
        return forecast_plan(self.model, plan, slopes=slopes, machines=machines, analyses=analyses)


def _named_apart(tests: Sequence[CircularTest], pilot: Campaign) -> tuple[CircularTest, ...]:
    """Return planned tests with names that no test of the pilot has."""
    so_far = pilot.plan()
    unnamed = [replace(test, name="") for test in tests]
    together = replace(so_far, tests=(*so_far.tests, *unnamed), foreseen=())
    return tuple(together.tests[len(so_far.tests) :])


def _numbered(name: str) -> str:
    """Return the name of the campaign that follows the campaign ``name``.

    The name has a number and no words, because it also stands on sheets in other languages:
    "spindle 4" is followed by "spindle 4 (2)", and this by "spindle 4 (3)".
    """
    match = _NUMBERED.fullmatch(name)
    if match is None:
        return f"{name} (2)"
    return f"{match['name']} ({int(match['number']) + 1})"


def _radii_of(pilot: Campaign) -> list[float]:
    """Return the radius of every test of a campaign or plan [mm]."""
    return [float(test.radius_mm or pilot.radius_mm) for test in pilot.tests]


def _distinct_clockings(clockings_deg: Sequence[Clocking]) -> tuple[Clocking, ...]:
    """Return every different clocking once; a clocking is a pair of angles of the balls.

    Angles that differ by whole turns are treated as equal.
    """
    first_by_angles: dict[Clocking, Clocking] = {}
    for work_deg, tool_deg in reversed(clockings_deg):
        first_by_angles[work_deg % 360.0, tool_deg % 360.0] = (work_deg, tool_deg)
    return tuple(reversed(first_by_angles.values()))


def _with_temperature(
    tests: tuple[CircularTest, ...], pilot: Campaign, model: HybridModel
) -> tuple[CircularTest, ...]:
    """Return the tests with a temperature, if the model has a drift that depends on temperature.

    The temperature is the mean temperature of ``pilot``, the campaign that the design starts from.
    For a model without such a drift, the tests are returned unchanged.
    """
    covariates = {term.over for term in model.nuisances if isinstance(term, Drift)}
    if "temperature" not in covariates:
        return tests
    temperatures = [t.temperature_C for t in pilot.tests if t.temperature_C is not None]
    mean_C = float(np.mean(temperatures))
    return tuple(replace(test, temperature_C=mean_C) for test in tests)
