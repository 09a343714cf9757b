"""Which forces, how many circles, which clockings: the best tests to run next, and what to expect
of them."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
import pandas as pd
from pydantic import Field

from ldbb_bayes.analysis.aliases import Degeneracy, degeneracies
from ldbb_bayes.analysis.cures import Cure, cures
from ldbb_bayes.analysis.design.candidates import Clocking, bind_tests, running_order
from ldbb_bayes.analysis.design.forecast import Expected, Forecast
from ldbb_bayes.analysis.design.search import MOST_TESTS, Found
from ldbb_bayes.analysis.design.space import CriterionName, Space
from ldbb_bayes.campaign.campaign import (
    Campaign,
    CircularTest,
    Direction,
    check_campaign,
    distinct_forces,
)
from ldbb_bayes.errors import InputError, require
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.model.terms import Drift, Hysteresis
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Records, Result, read_result, readable

__all__ = ["Certificate", "Design", "Judged", "Limits", "design", "read_design"]

_HOLDS = 1e-4
_SHOWN_SHARE = 1e-4
_STUCK = 0.8
_STEPS = "equal steps"
_RESERVED = ("recommended", _STEPS)


@dataclass(frozen=True)
class Certificate(Result):
    """That no shares of as many tests are better (Kiefer and Wolfowitz 1960): the largest
    sensitivity of all candidates does not exceed the bound (for D with flat priors the number of
    parameters) by more than a ten-thousandth. Where the criterion is not concave it is not
    ``global``: only designs nearby are ruled out."""

    max_sensitivity: float
    bound: float
    is_global: Annotated[bool, Field(alias="global")]
    holds: bool


@dataclass(frozen=True, eq=False)
class Judged(Forecast):
    """A design compared with the recommended one: name, one row per test (force_N and
    `Design.columns`), efficiency beside the best shares of as many tests, and what to expect of
    it."""

    name: str
    tests: Records
    efficiency: float


@dataclass(frozen=True)
class Limits(Result):
    """What the tests of a design do not show: number of forces where they are too few to show that
    the degree in force is wrong; planes (with their direction) whose circles all run one way while
    hysteresis counts; whether there is a drift, which is taken to have nothing to do with what
    differs between the tests; parameters that more circles of this kind would narrow by less than a
    fifth, with their degeneracies and the cures of these."""

    levels: int | None
    one_way: dict[str, str]
    drift: bool
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
    """Recommended tests, and what to expect of them."""

    criterion: str  #: of the design
    parameters: tuple[str, ...]  #: of interest; all others are nuisances
    #: one row per different test: force_N, `columns`, count
    table: Annotated[Records, Field(alias="tests")]
    augment: bool  #: whether the pilot's tests count as run
    degree: int  #: of the model
    reference_force_N: float  #: F0, the pilot's
    efficiency: float  #: beside the best shares of as many tests
    certificate: Certificate  #: that no other shares are better
    shares: Records  #: the best: one row per test, force_N, `columns`, share
    baseline: dict[str, Expected]  #: of equal steps of force at the first clocking and radius
    compared: tuple[Judged, ...]  #: equal steps of force, and the designs brought for comparison
    limits: Limits  #: what the tests do not show
    hyper_um: dict[str, float]  #: root mean square of the values averaged over [µm]
    #: whether these are of their posterior given the pilot's readings, else of their prior
    measured: bool
    pilot: Pilot  #: what it starts from
    #: Of every candidate, for the best shares: force_N, `columns`, sensitivity.
    sensitivity: Annotated[Records, Field(exclude=True)] = field(default_factory=pd.DataFrame)
    #: the tests themselves; none where read from a file
    planned: Annotated[Any, Field(exclude=True)] = None

    @property
    def columns(self) -> tuple[str, ...]:
        """What tables say of a test beside its force: clockings and radius; plane, direction and
        set-up where they differ."""
        return tuple(map(str, self.table.columns[1:-1]))

    @property
    def tests(self) -> tuple[CircularTest, ...]:
        """The tests by clocking, radius and force, each as often as it is to be run."""
        return self._at_hand().tests

    @property
    def model(self) -> HybridModel:
        """The model for the analysis of the plan: F0 and the slopes' prior sd are the pilot's,
        whatever the plan's forces."""
        return self._at_hand().model

    def plan(self, *, seed: int = 1) -> Campaign:
        """The tests as a plan, in the order in which to run them: blocks of one clocking, forces at
        random within.

        Where the model has a drift, at the pilot's pace and mean temperature. None of a design read
        from a file.
        """
        own = self._at_hand()
        tests = _timed(running_order(own.tests, np.random.default_rng(seed)), own.pilot, own.model)
        return replace(own.pilot, tests=tests, foreseen=(), name=f"{own.pilot.name}, next campaign")

    def _at_hand(self) -> Planned:
        if not isinstance(self.planned, Planned):
            raise InputError(
                "a design must be at hand, got one read from a file. Read the plan and the"
                " model.toml beside it."
            )
        return self.planned

    def expected_table(self) -> pd.DataFrame:
        """Expected sd of every parameter and its error beside prior, floor and baseline; inside
        units."""
        columns = ["unit", "prior_sd", "sd", "sd_error", "floor_sd"]
        frame = pd.DataFrame([vars(entry) for entry in self.expected.values()], columns=columns)
        frame.insert(0, "parameter", list(self.expected))
        return readable(
            frame.assign(baseline_sd=[self.baseline[name].sd for name in self.expected]),
            "Expected sd",
        )

    def __repr__(self) -> str:
        return (
            f"Design of {self.table['count'].sum()} tests, efficiency {self.efficiency:.3f} by"
            f" criterion {self.criterion}"
        )


def read_design(path: str | os.PathLike[str]) -> Design:
    """Return the design in a folder written by ``ldbb-bayes design --out``, or in its
    design.json."""
    return read_result(path, "design", "design", Design.from_dict)


def _timed(
    tests: tuple[CircularTest, ...], pilot: Campaign, model: HybridModel
) -> tuple[CircularTest, ...]:
    over = {term.over for term in model.nuisances if isinstance(term, Drift)}
    times = np.sort([test.time_s for test in pilot.tests if test.time_s is not None])
    degrees = [test.temperature_C for test in pilot.tests if test.temperature_C is not None]
    if "time" in over and len(times) > 1:
        pace = float(np.median(np.diff(times)))
        return tuple(replace(test, time_s=k * pace) for k, test in enumerate(tests))
    return (
        tuple(replace(test, temperature_C=float(np.mean(degrees))) for test in tests)
        if "temperature" in over
        else tests
    )


@one_blas_thread
def design(
    model: HybridModel,
    pilot: Campaign,
    *,
    tests: int | None = None,
    forces_N: Sequence[float] | None = None,
    clockings_deg: Sequence[Clocking] = ((0.0, 0.0),),
    radii_mm: Sequence[float] = (),
    directions: Sequence[Direction] = (),
    criterion: CriterionName | None = None,
    parameters: Sequence[str] = (),
    augment: bool = False,
    against: Mapping[str, Campaign] = MappingProxyType({}),
    slope_size: float = 1.0,
    seed: int = 1,
) -> Design:
    """The best tests to run next.

    Everything is of the linear Gaussian model, averaged over the hyper-parameters: their posterior
    given the pilot, or their prior when the pilot is a plan. Criteria and evidence are without
    truncation, expected sd are inside it. F0, force range and Ĉ are the pilot's: analyse the plan
    with `Design.model`. InputError for unknown names, or tests that leave parameters undetermined.

    Parameters
    ----------
    pilot : a campaign already run, or a plan.
    tests : number of circles; default: as many as the pilot has.
    forces_N : levels to choose from; default: the pilot's range in steps of 1 N.
    clockings_deg, radii_mm, directions : clockings (work ball, tool ball), radii and directions of
        travel (CW, CCW) to choose from; default: balls not turned, the rest as in the pilot. If
        both directions may be chosen, hysteresis always counts.
    criterion : {"eig", "d", "a", "c", "i", "discriminate"}, optional
        Default: ``eig`` with proper priors, ``d`` with flat ones.
    parameters : parameters of interest, all others nuisances; default: all that the criterion is
        about.
    augment : the pilot's tests count as run: ``tests`` is how many are added.
    against : mapping of name to campaign or plan
        Designs to be judged beside.
    slope_size : size of the slopes that are to be found [prior sd].
    """
    check_campaign(pilot)
    number = len(pilot.tests) if tests is None else tests
    require(
        1 <= number <= MOST_TESTS,
        f"tests must be between 1 and {MOST_TESTS}, got {number}. Give the number of circles.",
    )
    for name, campaign in against.items():
        require(
            name not in _RESERVED,
            f"against must not use the name {name!r}, which is the design's own. Choose another"
            " name.",
        )
        check_campaign(campaign)
        machine, own = ((one.topology, dict(one.frames_mm)) for one in (pilot, campaign))
        require(
            own == machine,
            f"{name} must be of the pilot's machine {machine[0]}, frames too, got {own[0]}. Leave"
            " it out.",
        )
    if forces_N is None:
        low = float(pilot.forces_N.min())
        high = float(pilot.forces_N.max())
        forces_N = np.unique([*np.arange(low, high, 1.0), high]).tolist()
    space = Space(
        model,
        pilot,
        tuple(map(float, forces_N)),
        clockings_deg,
        radii_mm,
        directions,
        criterion=criterion or ("d" if model.prior.flat else "eig"),
        parameters=tuple(parameters),
        augment=augment,
        slope_size=slope_size,
        judged=tuple(test for campaign in against.values() for test in campaign.tests),
        seed=seed,
    )
    compared = {_STEPS: space.equal_steps(number)}
    for name, campaign in against.items():
        compared[name] = tuple(
            replace(test.with_reading_um(None), name="") for test in campaign.tests
        )
    return _designed(
        space, space.search.of_number(number), Pilot(pilot.name, pilot.sha256), compared
    )


def _designed(
    space: Space, found: Found, pilot: Pilot, compared: Mapping[str, tuple[CircularTest, ...]]
) -> Design:
    tests = space.tests_of(found)
    optimum = found.optimum

    def judged(name: str, tests: tuple[CircularTest, ...]) -> Judged:
        own = space.forecast(tests)
        efficiency = space.efficiency(tests) if own.determined else 0.0
        return Judged(**vars(own), name=name, tests=space.frame(tests), efficiency=efficiency)

    others = tuple(judged(name, own) for name, own in compared.items())
    highest = float(optimum.sensitivity.max())
    concave = space.search.objective.criterion.concave
    candidates = space.frame(space.tests)
    shown = optimum.share > _SHOWN_SHARE
    expected = space.forecast(tests)
    sizes = np.sqrt((space.states.phi**2).mean(axis=0))
    return Design(
        **vars(expected),
        criterion=space.criterion,
        parameters=space.chosen,
        table=space.frame(tests).value_counts(sort=False).rename("count").reset_index(),
        augment=space.augment,
        degree=space.model.degree,
        reference_force_N=space.bound.setting.reference_force_N,
        efficiency=min(found.efficiency, 1.0),
        certificate=Certificate(
            highest, optimum.bound, concave, highest <= optimum.bound * (1.0 + _HOLDS)
        ),
        shares=candidates[shown].assign(share=optimum.share[shown]).reset_index(drop=True),
        baseline=others[0].expected,
        compared=others,
        limits=_limits(space, tests, expected),
        hyper_um=space.bound.hyper_prior.named(sizes),
        measured=not space.pilot.is_plan,
        pilot=pilot,
        sensitivity=candidates.assign(sensitivity=optimum.sensitivity),
        planned=Planned(tests, space.pilot, _model_of(space, tests)),
    )


def _model_of(space: Space, tests: Sequence[CircularTest]) -> HybridModel:
    """The model as it should analyse these tests alone: F0 and the slopes' prior sd those of the
    pilot."""
    model, setting, prior = space.model, space.bound.setting, space.model.prior
    plain = replace(model, fixed=(), prior=replace(prior, overrides={}, means={}))
    there = BoundModel(
        plain, replace(space.pilot, tests=tuple(tests), foreseen=()), pilot=space.pilot
    ).names
    overrides = dict(prior.overrides)
    forces = [float(test.force_N or 0.0) for test in tests]
    if not (prior.flat or np.isclose(max(forces) - min(forces), setting.force_range_N, rtol=1e-9)):
        overrides |= {p.name: p.prior_sd for p in space.bound.parameters if p.group == "slope"}
    own = {name: sd for name, sd in overrides.items() if name in there}
    means = {name: mean for name, mean in prior.means.items() if name in there}
    fixed = tuple(name for name in model.fixed if name in there)
    return replace(
        model,
        reference_force_N=setting.reference_force_N,
        fixed=fixed,
        prior=replace(prior, overrides=own, means=means),
    )


def _limits(space: Space, tests: Sequence[CircularTest], expected: Forecast) -> Limits:
    """What no number of such tests shows, and what would."""
    levels = len(distinct_forces([float(test.force_N or 0.0) for test in tests]))
    bound = bind_tests(space.model, space.pilot, tests, keep=space.augment)
    terms = {type(term) for term in space.model.nuisances}
    ways = {
        plane: {test.direction for test in bound.campaign.tests if test.plane == plane}
        for plane in bound.setting.both_ways
    }
    entries = {name: expected.expected[name] for name in space.chosen}
    shared = tuple(name for name, entry in entries.items() if entry.floor_sd > _STUCK * entry.sd)
    found = (
        tuple(d for d in degeneracies(bound) if set(d.parameters) & set(shared)) if shared else ()
    )
    return Limits(
        levels if levels <= space.model.degree + 2 and not space.augment else None,
        {
            plane: str(next(iter(own)))
            for plane, own in ways.items()
            if len(own) == 1 and Hysteresis in terms
        },
        Drift in terms,
        shared,
        found,
        cures(bound, found) if found else (),
    )
