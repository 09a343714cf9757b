"""The space a design is searched in: the tests that could be run, what is known before them, and what they are to tell."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.analysis.candidates import (
    CriterionName,
    bind_tests,
    case_of,
    chosen_parameters,
    criterion_of,
    grid_of_tests,
)
from ldbb_bayes.analysis.costs import Costs
from ldbb_bayes.analysis.discrimination import DECISIVE
from ldbb_bayes.analysis.forecast import Forecast, forecast
from ldbb_bayes.analysis.known import Known, hyper_nodes, known_before
from ldbb_bayes.analysis.optimal.continuous import Optimum
from ldbb_bayes.analysis.optimal.objective import Case, Objective
from ldbb_bayes.analysis.places import foreseen_by, place_columns, templates
from ldbb_bayes.analysis.search import Search
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.circular_test import CircularTest, Direction
from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.machine.chain import PLANES
from ldbb_bayes.model.bound import BoundModel, Parameter
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.setting import TRAVEL

__all__ = ["AS_GIVEN", "DesignSpace"]

Array = NDArray[Any]
_SEARCHED, _REPORTED = 12, 128
_MOST_CANDIDATES = 5000
_FEWEST_READINGS, _MOST_READINGS = 25, 100_000
AS_GIVEN = "as in the model"


@dataclass(frozen=True, eq=False)
class DesignSpace:
    """What is to be designed.

    Attributes
    ----------
    model : HybridModel
    pilot : Campaign
        Gives the machine, F0, force range, Ĉ and, where it has readings, the posterior of the hyper-parameters; else their prior.
    forces_N : sequence of float
    clockings_deg : sequence of (work ball, tool ball)
        Whole turns apart count as one.
    radii_mm : sequence of float
        Default: those of the pilot.
    planes, directions, centres_mm : tuple
        Planes, directions of travel (CW, CCW) and centres (X, Y, Z) to choose from; default: those of the pilot. A plane that it
        lacks is another set-up.
    readings : int, optional
        Readings per circle; default: as in the pilot.
    criterion : {"eig", "d", "a", "c", "i", "e", "discriminate"}
    parameters : tuple of str
        Of interest; empty for all that the criterion is about. All others are nuisances.
    augment : bool
        Whether the pilot's tests count as already run.
    costs : Costs
    slope_size : float
        Size of the slopes that are to be found [prior sd].
    threshold : float
        |ln B| called decisive [nat].
    assumptions : mapping of label to (HybridModel, factors)
        Models over which the criterion is averaged beside ``model``, hyper-parameters scaled by these factors.
    factors : mapping of hyper-parameter to float
        The same for ``model``.
    nodes : int
        Values of the hyper-parameters the search averages over.
    targets : mapping of parameter to sd
        With criterion "a": sd in these units are averaged, instead of in units of the prior sd.
    judged : tuple of CircularTest
        Tests of other designs that are to be compared.
    starts, seed : int
        Of the search.
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
    assumptions: Mapping[str, tuple[HybridModel, Mapping[str, float]]] = field(default_factory=dict)
    targets: Mapping[str, float] = field(default_factory=dict)
    factors: Mapping[str, float] = field(default_factory=dict)
    nodes: int = _SEARCHED
    judged: tuple[CircularTest, ...] = ()
    starts: int = 6
    seed: int = 1

    def __post_init__(self) -> None:
        radii = self.radii_mm or [float(test.radius_mm or self.pilot.radius_mm) for test in self.pilot.tests]
        turned = {(work % 360.0, tool % 360.0): (work, tool) for work, tool in reversed(self.clockings_deg)}
        object.__setattr__(self, "forces_N", tuple(dict.fromkeys(self.forces_N)))
        object.__setattr__(self, "radii_mm", tuple(dict.fromkeys(radii)))
        object.__setattr__(self, "clockings_deg", tuple(reversed(turned.values())))
        for name, values, unit in (("forces", self.forces_N, "N"), ("radii", self.radii_mm, "mm")):
            bad = [value for value in values if not (np.isfinite(value) and value > 0.0)]
            if bad:
                raise InputError(f"{name} must be > 0 {unit}, got {bad[0]:g}. Correct the range.")
        if not self.forces_N or not self.clockings_deg:
            raise InputError("a design must have forces and clockings to choose from, got none. Give at least one of each.")
        for name, value in (("slope_size", self.slope_size), ("threshold", self.threshold)):
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(f"{name} must be a positive number, got {value}. Correct it.")
        check_known("plane", self.planes, PLANES)
        check_known("direction", self.directions, TRAVEL)
        for name in ("planes", "directions", "centres_mm"):
            object.__setattr__(self, name, tuple(dict.fromkeys(getattr(self, name))))
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
        object.__setattr__(self, "pilot", foreseen_by(self.pilot, self.tests, self.judged))
        check_known("target", self.targets, self._bound_alone.names)
        chosen_parameters(self._bound_alone, self.criterion, self.parameters)
        for label, (model, _) in self.assumptions.items():
            if not set(self.chosen) & set(model.bind(self.pilot).names):
                raise InputError(f"assumption {label!r} must leave parameters of interest, got none. Leave it out.")

    @cached_property
    def templates(self) -> tuple[CircularTest, ...]:
        """One test for every plane, direction and centre."""
        return templates(self.pilot, self.planes, self.directions, self.centres_mm)

    @cached_property
    def tests(self) -> tuple[CircularTest, ...]:
        """The candidates."""
        return grid_of_tests(self.templates, self.forces_N, self.clockings_deg, self.radii_mm, self.readings)

    @cached_property
    def columns(self) -> tuple[str, ...]:
        """What tables say of a test beside its force."""
        return place_columns((*self.tests, *self.judged))

    def equal_steps(self, number: int) -> tuple[CircularTest, ...]:
        """Equal steps of force, each at the nearest level there is, at the first clocking and radius; in turn over planes,
        directions and centres."""
        levels = np.array(sorted(self.forces_N))
        steps = np.linspace(levels[0], levels[-1], number)
        nearest = [float(levels[np.argmin(np.abs(levels - step))]) for step in steps]
        found: list[CircularTest] = []
        for k, like in enumerate(self.templates):
            own = nearest[k :: len(self.templates)]
            found += grid_of_tests([like], own, self.clockings_deg[:1], self.radii_mm[:1], self.readings)
        return tuple(found)

    @cached_property
    def chosen(self) -> tuple[str, ...]:
        """The parameters of interest."""
        return chosen_parameters(self._bound_alone, self.criterion, self.parameters)

    @property
    def decided(self) -> tuple[str, ...]:
        """Slopes whose evidence is reported: those of interest where the criterion is about them, else all (empty)."""
        return self.chosen if self.criterion == "discriminate" else ()

    @cached_property
    def search(self) -> Search:
        """The candidates under the criterion, averaged over all assumptions."""
        objective = self._together(search.objective for search in self.alone.values())
        return Search(objective, self.tests, self.costs, levels=self.levels, starts=self.starts, seed=self.seed)

    def value(self, tests: Sequence[CircularTest]) -> float:
        """The criterion of any tests, candidates or not."""
        return self._together(self.objectives(tests).values()).value(np.ones(len(tests)))

    def efficiency(self, tests: Sequence[CircularTest], best: Optimum | None = None) -> float:
        """Of any tests, candidates or not, beside the best shares of as many candidates."""
        best = self.search.shares(float(len(tests))) if best is None else best
        return self.search.objective.efficiency(self.value(tests), best.value)

    def forecast(self, tests: Sequence[CircularTest], *, decide: bool = True) -> Forecast:
        """What tests will tell, over more hyper-parameters than the search uses; with ``decide`` of slopes against none too."""
        return forecast(
            self.model,
            self.pilot,
            tests,
            self._known,
            augment=self.augment,
            slopes=self.decided if decide else None,
            slope_size=self.slope_size,
            threshold=self.threshold,
            seed=self.seed,
        )

    def objectives(self, tests: Sequence[CircularTest]) -> dict[str, Objective]:
        """The criterion of any tests under every assumption alone."""
        several = {AS_GIVEN: (self.model, self.factors), **self.assumptions}
        bounds: list[BoundModel] = []
        found = {}
        for label, (model, factors) in several.items():
            if not any(bound.model == model for bound in bounds):
                bounds.append(bind_tests(model, self.pilot, tests, keep=self.augment))
            bound = next(bound for bound in bounds if bound.model == model)
            found[label] = Objective([self._case(bound, factors)], np.ones(1))
        return found

    @cached_property
    def alone(self) -> dict[str, Search]:
        """The candidates under every assumption alone."""
        return {
            label: Search(objective, self.tests, self.costs, levels=self.levels, starts=self.starts, seed=self.seed)
            for label, objective in self.objectives(self.tests).items()
        }

    def _together(self, objectives: Iterable[Objective]) -> Objective:
        cases = [case for objective in objectives for case in objective.cases]
        # ln det grows with the number of parameters: every model counts by its efficiency.
        size = np.array([cases[0].interest / case.interest if self.criterion in ("eig", "d") else 1.0 for case in cases])
        return Objective(cases, size / len(cases))

    def _case(self, bound: BoundModel, factors: Mapping[str, float]) -> Case:
        phi = self._searched(bound.model)
        phi = phi * np.array([factors.get(name, 1.0) for name in bound.hyper_prior.names])
        names = tuple(name for name in self.chosen if name in bound.names)
        run = len(self.pilot.tests) if self.augment else 0
        criterion = criterion_of(bound, self.criterion, names, size=self.slope_size, targets=self.targets)
        return case_of(bound, run, phi, names, criterion)

    def _searched(self, model: HybridModel) -> Array:
        known = next((phi for own, phi in self._nodes if own == model), None)
        if known is None:
            known = hyper_nodes(model, self.pilot, self.nodes, self.seed)
            self._nodes.append((model, known))
        return known

    @property
    def levels(self) -> int:
        """Fewest different forces of the new tests with which the model can be fitted."""
        return 1 if self.augment or not self.model.degree else 2

    @cached_property
    def _nodes(self) -> list[tuple[HybridModel, Array]]:
        return []

    @cached_property
    def _known(self) -> Known:
        return known_before(self.model, self.pilot, _REPORTED, self.seed, augment=self.augment)

    def model_of(self, tests: Sequence[CircularTest]) -> HybridModel:
        """The model as it should analyse these tests alone: F0 and the slopes' prior sd those of the pilot."""
        bound = self._bound_alone
        plain = replace(self.model, fixed=(), prior=replace(self.model.prior, overrides={}, means={}))
        there = BoundModel(plain, replace(self.pilot, tests=tuple(tests), foreseen=()), pilot=self.pilot).names
        overrides = dict(self.model.prior.overrides)
        forces = [float(test.force_N or 0.0) for test in tests]
        if not (self.model.prior.flat or np.isclose(max(forces) - min(forces), bound.setting.force_range_N, rtol=1e-9)):
            overrides |= {p.name: p.prior_sd for p in bound.parameters if p.group == "slope"}
        return replace(
            self.model,
            reference_force_N=bound.setting.reference_force_N,
            fixed=tuple(name for name in self.model.fixed if name in there),
            prior=replace(
                self.model.prior,
                overrides={name: sd for name, sd in overrides.items() if name in there},
                means={name: mean for name, mean in self.model.prior.means.items() if name in there},
            ),
        )

    @property
    def basis(self) -> str:
        """What the numbers rest on, in words."""
        bound = self._bound_alone
        mean = 1e3 * np.sqrt((self._known.phi**2).mean(axis=0))
        values = ", ".join(f"{name} {value:.2g}" for name, value in zip(bound.hyper_prior.names, mean, strict=True))
        source = "their prior" if self.pilot.is_plan else f"what {self.pilot.name!r} leaves likely"
        return (
            f"Parameters are at F0 = {bound.setting.reference_force_N:g} N. Averaged over the hyper-parameters, {source} "
            f"(root mean square {values} µm); model.toml beside a written plan keeps F0 and the slopes' prior for its analysis."
        )

    @cached_property
    def parameters_of_pilot(self) -> tuple[Parameter, ...]:
        """Names, units and priors."""
        return self._bound_alone.parameters

    @property
    def truncated(self) -> tuple[str, ...]:
        """Parameters that the truncation narrows."""
        bound = self._bound_alone
        return tuple(name for name, column in zip(bound.names, bound.truncation.rows.T, strict=True) if column.any())

    @cached_property
    def _bound_alone(self) -> BoundModel:
        return self.model.bind(self.pilot)
