"""The design of the next campaign: which forces, how many circles, which clockings."""

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
from ldbb_bayes.analysis.design.search import MAX_TESTS, ExactDesign
from ldbb_bayes.analysis.design.shares import Optimum
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

# The largest sensitivity may exceed the bound by this share.
_CERTIFICATE_TOLERANCE = 1e-4
# Smaller shares are not listed.
_LISTED_SHARE = 1e-4
# A parameter whose floor exceeds this share of its expected sd gains little from more circles.
_STUCK_SHARE = 0.8
# Step of the force levels to choose from where none are given [N].
_FORCE_STEP_N = 1.0
_EQUAL_STEPS = "equal steps"
_RESERVED_NAMES = ("recommended", _EQUAL_STEPS)


@dataclass(frozen=True)
class Certificate(Result):
    """Whether no shares of as many tests are better (Kiefer and Wolfowitz 1960).

    The certificate holds if the largest sensitivity of all candidates does not exceed the bound
    (for D with flat priors the number of parameters) by more than a ten-thousandth. Where the
    criterion is not concave it is not ``global``: only designs nearby are ruled out.
    """

    max_sensitivity: float
    bound: float
    is_global: Annotated[bool, Field(alias="global")]
    holds: bool


@dataclass(frozen=True, eq=False)
class Judged(Forecast):
    """A design compared with the recommended one, and what to expect of it."""

    name: str
    tests: Records  #: one row per test: force_N and `Design.columns`
    efficiency: float  #: relative to the best shares of as many tests


@dataclass(frozen=True)
class Limits(Result):
    """What the tests of a design do not show."""

    #: number of forces, where they are too few to show that the degree in force is wrong
    levels: int | None
    #: planes whose circles all run one way although hysteresis counts, with their direction
    one_way: dict[str, str]
    #: whether there is a drift: it is assumed to be independent of what differs between the tests
    drift: bool
    #: parameters that more circles of this kind would narrow by less than a fifth
    shared: tuple[str, ...]
    degeneracies: tuple[Degeneracy, ...]  #: of these parameters
    cures: tuple[tuple[Cure, ...], ...]  #: of each degeneracy


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
    efficiency: float  #: relative to the best shares of as many tests
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
        """What tables say of a test beside its force.

        Clockings and radius; plane, direction and set-up where they differ.
        """
        return tuple(str(column) for column in self.table.columns[1:-1])

    @property
    def tests(self) -> tuple[CircularTest, ...]:
        """The tests by clocking, radius and force, each as often as it is to be run."""
        return self._require_planned().tests

    @property
    def model(self) -> HybridModel:
        """The model for the analysis of the plan.

        F0 and the slopes' prior sd are the pilot's, whatever the plan's forces.
        """
        return self._require_planned().model

    def plan(self, *, seed: int = 1) -> Campaign:
        """Return the tests as a plan, in the order in which to run them.

        Blocks are of one clocking, forces at random within. Where the model has a drift, the plan
        has the pilot's pace and mean temperature.

        Parameters
        ----------
        seed
            Of the random order.

        Returns
        -------
        Campaign
            The plan.

        Raises
        ------
        InputError
            If the design was read from a file.
        """
        planned = self._require_planned()
        pilot = planned.pilot
        ordered = running_order(planned.tests, np.random.default_rng(seed))
        tests = _with_drift_covariate(ordered, pilot, planned.model)
        return replace(pilot, tests=tests, foreseen=(), name=f"{pilot.name}, next campaign")

    def _require_planned(self) -> Planned:
        if not isinstance(self.planned, Planned):
            raise InputError(
                "a design must be at hand, got one read from a file. Read the plan and the"
                " model.toml beside it."
            )
        return self.planned

    def expected_table(self) -> pd.DataFrame:
        """Return expected sd and error of every parameter with prior, floor and baseline.

        Returns
        -------
        pandas.DataFrame
            One row per parameter, in inside units.
        """
        columns = ["unit", "prior_sd", "sd", "sd_error", "floor_sd"]
        frame = pd.DataFrame([vars(entry) for entry in self.expected.values()], columns=columns)
        frame.insert(0, "parameter", list(self.expected))
        baseline_sd = [self.baseline[name].sd for name in self.expected]
        return readable(frame.assign(baseline_sd=baseline_sd), "Expected sd")

    def __repr__(self) -> str:
        return (
            f"Design of {self.table['count'].sum()} tests, efficiency {self.efficiency:.3f} by"
            f" criterion {self.criterion}"
        )


def read_design(path: str | os.PathLike[str]) -> Design:
    """Return the design in a folder written by ``ldbb-bayes design --out``, or in a design.json.

    Parameters
    ----------
    path
        Folder or file.

    Returns
    -------
    Design
        Without its tests: read the plan beside it.
    """
    return read_result(path, "design", "design", Design.from_dict)


def _with_drift_covariate(
    tests: tuple[CircularTest, ...], pilot: Campaign, model: HybridModel
) -> tuple[CircularTest, ...]:
    """Return the tests with the times or the temperature that the model's drift needs."""
    covariates = {term.over for term in model.nuisances if isinstance(term, Drift)}
    times = np.sort([test.time_s for test in pilot.tests if test.time_s is not None])
    if "time" in covariates and len(times) > 1:
        pace_s = float(np.median(np.diff(times)))
        return tuple(replace(test, time_s=k * pace_s) for k, test in enumerate(tests))
    if "temperature" in covariates:
        temperatures = [t.temperature_C for t in pilot.tests if t.temperature_C is not None]
        mean_C = float(np.mean(temperatures))
        return tuple(replace(test, temperature_C=mean_C) for test in tests)
    return tests


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
    """Return the best tests to run next.

    Everything is of the linear Gaussian model, averaged over the hyper-parameters: their posterior
    given the pilot, or their prior when the pilot is a plan. Criteria and evidence are without
    truncation, expected sd are inside it. F0, force range and Ĉ are the pilot's: analyse the plan
    with `Design.model`.

    Parameters
    ----------
    model
        The model that the tests are to determine.
    pilot
        A campaign already run, or a plan.
    tests
        Number of circles; default: as many as the pilot has.
    forces_N
        Levels to choose from; default: the pilot's range in steps of 1 N.
    clockings_deg, radii_mm, directions
        Clockings (work ball, tool ball), radii and directions of travel (CW, CCW) to choose from;
        default: balls not turned, the rest as in the pilot. If both directions may be chosen,
        hysteresis always counts.
    criterion : {"eig", "d", "a", "c", "i", "discriminate"}, optional
        Default: ``eig`` with proper priors, ``d`` with flat ones.
    parameters
        Parameters of interest, all others nuisances; default: all that the criterion is about.
    augment
        Whether the pilot's tests count as run: ``tests`` is how many are added.
    against
        Campaigns or plans by name: designs to compare with.
    slope_size
        Size of the slopes that are to be found [prior sd].
    seed
        Of the search and the forecast.

    Returns
    -------
    Design
        The tests and what to expect of them.

    Raises
    ------
    InputError
        For unknown names, or tests that leave parameters undetermined.
    """
    check_campaign(pilot)
    number = len(pilot.tests) if tests is None else tests
    require(
        1 <= number <= MAX_TESTS,
        f"tests must be between 1 and {MAX_TESTS}, got {number}. Give the number of circles.",
    )
    judged: list[CircularTest] = []
    for name, campaign in against.items():
        _check_compared(name, campaign, pilot)
        judged += campaign.tests
    if forces_N is None:
        forces_N = _levels_in_range(pilot)
    if criterion is None:
        criterion = "d" if model.prior.flat else "eig"
    space = Space(
        model=model,
        pilot=pilot,
        forces_N=tuple(float(force) for force in forces_N),
        clockings_deg=clockings_deg,
        radii_mm=radii_mm,
        directions=directions,
        criterion=criterion,
        parameters=tuple(parameters),
        augment=augment,
        slope_size=slope_size,
        judged=tuple(judged),
        seed=seed,
    )
    compared = {_EQUAL_STEPS: space.equal_steps(number)}
    for name, campaign in against.items():
        planned = [replace(test.with_reading_um(None), name="") for test in campaign.tests]
        compared[name] = tuple(planned)
    exact = space.search.find_design(number)
    return _describe_design(space, exact, Pilot(pilot.name, pilot.sha256), compared)


def _levels_in_range(pilot: Campaign) -> list[float]:
    """Return forces over the pilot's range in steps of 1 N."""
    low = float(pilot.forces_N.min())
    high = float(pilot.forces_N.max())
    levels: list[float] = np.unique([*np.arange(low, high, _FORCE_STEP_N), high]).tolist()
    return levels


def _check_compared(name: str, campaign: Campaign, pilot: Campaign) -> None:
    """Refuse a design for comparison of a reserved name or of another machine."""
    require(
        name not in _RESERVED_NAMES,
        f"against must not use the name {name!r}, which is the design's own. Choose another name.",
    )
    check_campaign(campaign)
    same_frames = dict(campaign.frames_mm) == dict(pilot.frames_mm)
    require(
        campaign.topology == pilot.topology and same_frames,
        f"{name} must be of the pilot's machine {pilot.topology}, frames too, got"
        f" {campaign.topology}. Leave it out.",
    )


def _describe_design(
    space: Space,
    exact: ExactDesign,
    pilot: Pilot,
    compared: Mapping[str, tuple[CircularTest, ...]],
) -> Design:
    """Return the design that the search found, with its forecast and those of others."""
    tests = space.tests_of(exact)
    optimum = exact.optimum
    judged = tuple(_judge_tests(space, name, planned) for name, planned in compared.items())
    candidates = space.frame(space.tests)
    listed = optimum.share > _LISTED_SHARE
    forecast = space.forecast(tests)
    hyper_rms = np.sqrt((space.states.phi**2).mean(axis=0))
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
        hyper_um=space.bound.hyper_prior.named(hyper_rms),
        measured=not space.pilot.is_plan,
        pilot=pilot,
        sensitivity=candidates.assign(sensitivity=optimum.sensitivity),
        planned=Planned(tests, space.pilot, _analysis_model(space, tests)),
    )


def _judge_tests(space: Space, name: str, tests: tuple[CircularTest, ...]) -> Judged:
    forecast = space.forecast(tests)
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
    highest = float(optimum.sensitivity.max())
    return Certificate(
        max_sensitivity=highest,
        bound=optimum.bound,
        is_global=space.search.objective.criterion.concave,
        holds=highest <= optimum.bound * (1.0 + _CERTIFICATE_TOLERANCE),
    )


def _analysis_model(space: Space, tests: Sequence[CircularTest]) -> HybridModel:
    """Return the model for an analysis of these tests alone, with the pilot's F0 and slope sd."""
    model = space.model
    setting = space.bound.setting
    prior = model.prior
    unconstrained = replace(model, fixed=(), prior=replace(prior, overrides={}, means={}))
    plan = replace(space.pilot, tests=tuple(tests), foreseen=())
    names = BoundModel(unconstrained, plan, pilot=space.pilot).names

    overrides = dict(prior.overrides)
    forces = [float(test.force_N or 0.0) for test in tests]
    force_range_N = max(forces) - min(forces)
    if not (prior.flat or np.isclose(force_range_N, setting.force_range_N, rtol=1e-9)):
        # The default prior sd of a slope goes with the force range.
        for parameter in space.bound.parameters:
            if parameter.group == "slope":
                overrides[parameter.name] = parameter.prior_sd
    overrides = {name: sd for name, sd in overrides.items() if name in names}
    means = {name: mean for name, mean in prior.means.items() if name in names}
    return replace(
        model,
        reference_force_N=setting.reference_force_N,
        fixed=tuple(name for name in model.fixed if name in names),
        prior=replace(prior, overrides=overrides, means=means),
    )


def _limits(space: Space, tests: Sequence[CircularTest], forecast: Forecast) -> Limits:
    """Return what no number of such tests shows, and what would."""
    levels = len(distinct_forces([float(test.force_N or 0.0) for test in tests]))
    too_few_levels = levels <= space.model.degree + 2 and not space.augment
    bound = bind_tests(space.model, space.pilot, tests, keep=space.augment)
    term_types = {type(term) for term in space.model.nuisances}
    one_way = {}
    if Hysteresis in term_types:
        one_way = _planes_run_one_way(bound)
    shared = []
    for name in space.chosen:
        entry = forecast.expected[name]
        if entry.floor_sd > _STUCK_SHARE * entry.sd:
            shared.append(name)
    shared_degeneracies: tuple[Degeneracy, ...] = ()
    shared_cures: tuple[tuple[Cure, ...], ...] = ()
    if shared:
        shared_degeneracies = tuple(
            degeneracy
            for degeneracy in degeneracies(bound)
            if set(degeneracy.parameters) & set(shared)
        )
    if shared_degeneracies:
        shared_cures = cures(bound, shared_degeneracies)
    return Limits(
        levels=levels if too_few_levels else None,
        one_way=one_way,
        drift=Drift in term_types,
        shared=tuple(shared),
        degeneracies=shared_degeneracies,
        cures=shared_cures,
    )


def _planes_run_one_way(bound: BoundModel) -> dict[str, str]:
    """Return the direction of planes modelled both ways whose circles all run one way."""
    one_way = {}
    for plane in bound.setting.both_ways:
        directions = {test.direction for test in bound.campaign.tests if test.plane == plane}
        if len(directions) == 1:
            one_way[plane] = str(next(iter(directions)))
    return one_way
