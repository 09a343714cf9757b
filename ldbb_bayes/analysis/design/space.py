"""TODO: say what this module is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import numpy as np
import pandas as pd

from ldbb_bayes.analysis.design.campaign_objective import _prediction_weight, objective_of
from ldbb_bayes.analysis.design.candidates import (
    Clocking,
    bind_tests,
    foreseen_by,
    grid_of_tests,
    templates,
)
from ldbb_bayes.analysis.design.criteria import Criterion, Determinant, LogBayesFactor, Variance
from ldbb_bayes.analysis.design.discrimination import discrimination_of
from ldbb_bayes.analysis.design.forecast import Expected, Forecast, narrowed, posteriors
from ldbb_bayes.analysis.design.objective import Objective
from ldbb_bayes.analysis.design.search import Found, Search
from ldbb_bayes.analysis.design.states import States, hyper_nodes, states_before
from ldbb_bayes.campaign.campaign import Campaign, CircularTest, Direction
from ldbb_bayes.errors import check_known, require
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.model.setting import TRAVEL_SIGNS
from ldbb_bayes.units import inside_name

__all__ = ["CriterionName", "Space"]


_ALWAYS = ("work_ball_deg", "tool_ball_deg", "radius_mm")


_WHERE_DIFFERENT = ("plane", "direction", "setup")


CriterionName = Literal["eig", "d", "a", "c", "i", "discriminate"]


_SEARCHED = 12


_REPORTED = 128


_MOST_CANDIDATES = 5000


@dataclass(frozen=True, eq=False)
class Space:
    """What is to be designed: the arguments of `ldbb_bayes.design` but for its goal, and what
    follows from them. ``judged`` are the tests of designs that are to be compared."""

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
    judged: tuple[CircularTest, ...] = ()
    seed: int = 1

    def __post_init__(self) -> None:
        radii = self.radii_mm or [
            float(test.radius_mm or self.pilot.radius_mm) for test in self.pilot.tests
        ]
        turned = {
            (work % 360.0, tool % 360.0): (work, tool)
            for work, tool in reversed(self.clockings_deg)
        }
        given = {"forces_N": self.forces_N, "radii_mm": radii, "directions": self.directions}
        self.__dict__.update({name: tuple(dict.fromkeys(values)) for name, values in given.items()})
        self.__dict__["clockings_deg"] = tuple(reversed(turned.values()))
        self._check()
        self.__dict__["pilot"] = foreseen_by(self.pilot, self.tests, self.judged)
        _ = self.chosen

    def _check(self) -> None:
        sizes = {"forces": self.forces_N, "radii": self.radii_mm, "slope_size": (self.slope_size,)}
        for name, values in sizes.items():
            wrong = [value for value in values if not (np.isfinite(value) and value > 0.0)]
            require(
                not wrong, f"{name} must be finite and > 0, got {[*wrong, 0.0][0]:g}. Correct it."
            )
        check_known("direction", self.directions, TRAVEL_SIGNS)
        count = (
            len(self.forces_N) * len(self.clockings_deg) * len(self.radii_mm) * len(self.templates)
        )
        got = f"got {count}. Give forces and clockings, in longer steps where they are too many."
        require(
            1 <= count <= _MOST_CANDIDATES,
            f"a design must choose among 1 to {_MOST_CANDIDATES} candidates, {got}",
        )

    @cached_property
    def bound(self) -> BoundModel:
        """The model bound to the pilot alone."""
        return self.model.bind(self.pilot)

    @cached_property
    def chosen(self) -> tuple[str, ...]:
        """The parameters of interest: those named, else all that the criterion is about."""
        check_known("criterion", [self.criterion], get_args(CriterionName))
        every = {"compliance", "slope", "geometric"}
        given = [inside_name(name) for name in self.parameters]
        check_known("parameter", given, self.bound.names)
        wanted = {"discriminate": {"slope"}, "i": {"compliance", "slope"}}.get(
            self.criterion, every
        )
        found = [
            p for p in self.bound.parameters if (p.name in given if given else p.group in wanted)
        ]
        groups = {p.group for p in found}
        only = self.criterion == "discriminate"
        slopes = (
            "criterion discriminate must be about slopes, got others or none. Name some (C_XYX_1),"
            " or use a degree above 0."
        )
        one = self.criterion != "c" or len(found) == 1
        require(one, f"criterion c must be given one parameter, got {len(found)}. Name it.")
        require(not only or groups == wanted, slopes)
        require(
            groups <= wanted,
            "criterion i must be about compliances and their slopes, got a geometric error. Leave"
            " it out.",
        )
        proper = (
            "criterion discriminate must have proper priors, got flat ones. Use the default preset."
        )
        require(not (only and self.model.prior.flat), proper)
        return tuple(p.name for p in found)

    @cached_property
    def templates(self) -> tuple[CircularTest, ...]:
        """One test for every plane and direction."""
        return templates(self.pilot, self.directions)

    @cached_property
    def tests(self) -> tuple[CircularTest, ...]:
        """The candidates."""
        return grid_of_tests(self.templates, self.forces_N, self.clockings_deg, self.radii_mm)

    def frame(self, tests: Sequence[CircularTest]) -> pd.DataFrame:
        """One row per test: its force, clockings and radius, and the rest where it differs among
        candidates and judged."""
        every = (*self.tests, *self.judged)
        columns = [
            "force_N",
            *_ALWAYS,
            *(
                name
                for name in _WHERE_DIFFERENT
                if len({getattr(test, name) for test in every}) > 1
            ),
        ]
        rows = [
            ["" if (v := getattr(test, name)) is None else v for name in columns] for test in tests
        ]
        return pd.DataFrame(rows, columns=columns)

    def tests_of(self, found: Found) -> tuple[CircularTest, ...]:
        """The tests of a design, one as often as it is to be run."""
        return tuple(self.tests[i] for i in np.repeat(np.arange(len(self.tests)), found.counts))

    def equal_steps(self, number: int) -> tuple[CircularTest, ...]:
        """Equal steps of force, each at the nearest level, first clocking and radius; over planes
        and directions in turn."""
        levels = np.array(sorted(self.forces_N))
        steps = np.linspace(levels[0], levels[-1], number)
        nearest = [float(levels[np.argmin(np.round(np.abs(levels - step), 9))]) for step in steps]
        every = len(self.templates)
        first = (self.clockings_deg[:1], self.radii_mm[:1])
        return tuple(
            test
            for k, like in enumerate(self.templates)
            for test in grid_of_tests([like], nearest[k::every], *first)
        )

    def objective(self, tests: Sequence[CircularTest]) -> Objective:
        """The criterion of any tests, candidates or not."""
        bound = bind_tests(self.model, self.pilot, tests, keep=self.augment)
        phi = hyper_nodes(self.model, self.pilot, _SEARCHED, self.seed)
        run = len(self.pilot.tests) if self.augment else 0
        size = len(self.chosen)
        criterion: Criterion = Determinant(size)
        if self.criterion == "discriminate":
            criterion = LogBayesFactor(self.slope_size)
        elif self.criterion in ("a", "c", "i"):
            criterion = Variance(
                _prediction_weight(bound, self.chosen)
                if self.criterion == "i"
                else np.eye(size) / size
            )
        return objective_of(bound, run, phi, self.chosen, criterion)

    @cached_property
    def search(self) -> Search:
        """The candidates under the criterion."""
        forces = np.array([test.force_N for test in self.tests])
        levels = 1 if self.augment or not self.model.degree else 2
        return Search(self.objective(self.tests), forces, levels, self.seed)

    def efficiency(self, tests: Sequence[CircularTest]) -> float:
        """Of any tests, candidates or not, beside the best shares of as many candidates."""
        value = self.objective(tests).value(np.ones(len(tests)))
        return self.search.objective.efficiency(value, self.search.shares(float(len(tests))).value)

    @cached_property
    def states(self) -> States:
        """The machine as it may be before these tests."""
        return states_before(self.model, self.pilot, _REPORTED, self.seed, augment=self.augment)

    def forecast(self, tests: Sequence[CircularTest], *, states: States | None = None) -> Forecast:
        """What to expect of tests (added to the pilot's own when ``augment``), over more
        hyper-parameters than the search uses. ``states``: the machine as it may be before them."""
        states = states or self.states
        bound = bind_tests(self.model, self.pilot, tests, keep=self.augment)
        after, floor = posteriors(bound, states.phi, len(self.pilot.tests) if self.augment else 0)
        if after is None:
            nothing = {
                p.name: Expected(p.unit, p.prior_sd, *[np.inf] * 4) for p in bound.parameters
            }
            return Forecast(nothing, np.inf, None)
        scale = bound.scale
        covariance = after.covariance
        gaussian = scale * np.sqrt(np.einsum("kii->ki", covariance).mean(axis=0))
        variance, error = narrowed(bound, states, covariance * np.outer(scale, scale), self.seed)
        inside = np.sqrt(variance)
        columns = np.array(
            [
                inside,
                0.5 * error / inside,
                gaussian,
                scale * floor * np.minimum(1.0, inside / gaussian),
            ]
        ).T
        expected = {
            p.name: Expected(p.unit, p.prior_sd, *own)
            for p, own in zip(bound.parameters, columns.tolist(), strict=True)
        }
        if self.model.prior.flat:
            return Forecast(expected, np.inf, None)
        gain = float(-0.5 * np.linalg.slogdet(covariance)[1].mean())
        slopes = (
            self.chosen
            if self.criterion == "discriminate"
            else [p.name for p in bound.parameters if p.group == "slope"]
        )
        own = [bound.names.index(name) for name in slopes]
        if not own:
            return Forecast(expected, gain, None)
        before = states.before.marginal(own) if self.augment and not self.pilot.is_plan else None
        decision = discrimination_of(
            covariance[:, own][:, :, own],
            tuple(slopes),
            size=self.slope_size,
            before=before
            and Gaussian.factored(before.mean / scale[own], before.root, before.scale / scale[own]),
            seed=self.seed,
        )
        return Forecast(expected, gain, decision)
