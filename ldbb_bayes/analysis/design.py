"""Which forces, how many circles, which clockings: the tests that tell most, and what they will tell."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ldbb_bayes.analysis.candidates import CriterionName, bind_tests
from ldbb_bayes.analysis.costs import Costs
from ldbb_bayes.analysis.designed import Certificate, Design, Judged
from ldbb_bayes.analysis.discrimination import DECISIVE
from ldbb_bayes.analysis.places import frame_of
from ldbb_bayes.analysis.planning import Needed, trade_off
from ldbb_bayes.analysis.robustness import default_assumptions, robustness
from ldbb_bayes.analysis.search import MOST_TESTS, Found
from ldbb_bayes.analysis.space import DesignSpace
from ldbb_bayes.campaign.campaign import Campaign, check_campaign
from ldbb_bayes.campaign.circular_test import CircularTest, Direction
from ldbb_bayes.errors import InputError
from ldbb_bayes.model.cures import cures
from ldbb_bayes.model.degeneracies import degeneracies
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.terms import Drift, Hysteresis
from ldbb_bayes.model.wording import joined
from ldbb_bayes.threads import one_blas_thread
from ldbb_bayes.units import display_name

__all__ = ["design"]

Array = NDArray[Any]
_SHOWN_SHARE = 1e-4
_ALONE, _AMONG_SEVERAL = 12, 3
_STUCK = 0.8
_APART = 0.05
_RESERVED = ("recommended", "equal steps")
_ASSUMED = ("constant", "linear", "quadratic")


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
        Size of slopes to be told from none [prior sd].
    threshold : float
        |ln B| called decisive [nat].
    robust : bool
        A design good over several assumptions: the criterion is averaged over them, and `Design.robustness` says how the best
        designs under each compare.
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
    several = {
        "radii_mm": radii_mm,
        "planes": planes,
        "directions": directions,
        "centres_mm": centres_mm,
        "parameters": parameters,
    }
    _check_kinds(tests, forces_N, clockings_deg, several, against, seed)
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
    notes: list[str] = []
    reached = True
    if targets or power is not None:
        needed = Needed(space, targets, power)
        found, reached, said = needed.fewest()
        notes += said
    elif budget is not None:
        found = space.search.of_budget(_positive("budget", budget))
        if len(space.clockings_deg) > 1:
            notes.append(
                "Efficiency and certificate are among the clockings chosen; more of them would not pay for their set-ups."
            )
    else:
        found = space.search.of_number(_number(tests, pilot))
    return _designed(space, found, against, notes, reached=reached, curve=curve)


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
    space: DesignSpace, found: Found, against: Mapping[str, Campaign], notes: Sequence[str], *, reached: bool, curve: bool
) -> Design:
    tests = _chosen(space, found)
    optimum, allowed = found.optimum, found.allowed
    shown = optimum.share > _SHOWN_SHARE
    compared = {"equal steps": space.equal_steps(len(tests))}
    compared |= {name: _tests_of(campaign) for name, campaign in against.items()}
    baseline, *others = (_judged(space, name, own, found) for name, own in compared.items())
    return Design(
        tests,
        space.criterion,
        space.chosen,
        min(found.efficiency, 1.0),
        Certificate(optimum.max_sensitivity, optimum.bound, optimum.concave),
        _frame(space, allowed[shown], "share", optimum.share[shown]),
        _frame(space, allowed, "sensitivity", optimum.sensitivity),
        space.columns,
        space.forecast(tests),
        baseline,
        tuple(others),
        space.costs.of(tests),
        space.pilot,
        space.model_of(tests),
        space.augment,
        reached,
        (*notes, *_limits(space, tests), space.basis),
        trade_off(space, len(tests), space.equal_steps) if curve else pd.DataFrame(),
        robustness(space, found.counts, compared["equal steps"]) if space.assumptions else pd.DataFrame(),
    )


def _chosen(space: DesignSpace, found: Found) -> tuple[CircularTest, ...]:
    return tuple(test for test, count in zip(space.tests, found.counts, strict=True) for _ in range(count))


def _judged(space: DesignSpace, name: str, tests: tuple[CircularTest, ...], found: Found) -> Judged:
    best = found.optimum if len(tests) == found.counts.sum() else None
    own = space.forecast(tests)
    efficiency = space.efficiency(tests, best) if own.determined else 0.0
    return Judged(name, tests, efficiency, own, space.costs.of(tests))


def _tests_of(campaign: Campaign) -> tuple[CircularTest, ...]:
    """The tests of another campaign or plan, as they were or would be run."""
    return tuple(replace(test.with_reading_um(None), name="") for test in campaign.tests)


def _frame(space: DesignSpace, chosen: Array, name: str, values: Array) -> pd.DataFrame:
    return frame_of([space.tests[i] for i in chosen], space.columns).assign(**{name: values})


def _limits(space: DesignSpace, tests: Sequence[CircularTest]) -> tuple[str, ...]:
    """What no number of such tests tells apart, and what would."""
    own = space.forecast(tests, decide=False).expected
    said = []
    levels = _levels_apart([float(test.force_N or 0.0) for test in tests])
    if levels <= space.model.degree + 2 and not space.augment:
        said.append(
            f"With {levels} different force{'s' if levels > 1 else ''} the readings cannot show that compliance is not "
            f"{_ASSUMED[space.model.degree]} in force: the design trusts the model. Another level would tell."
        )
    bound = bind_tests(space.model, space.pilot, tests, keep=space.augment)
    for plane in bound.setting.both_ways:
        ways = {test.direction for test in bound.campaign.tests if test.plane == plane}
        if len(ways) == 1 and any(isinstance(term, Hysteresis) for term in space.model.nuisances):
            said.append(
                f"Its circles of plane {plane} all run {ways.pop()}: they cannot show the hysteresis that is counted here, and "
                "their analysis would not have it. Take more circles, or both directions of each."
            )
    if any(isinstance(term, Drift) for term in space.model.nuisances):
        said.append(
            "Drift is taken to have nothing to do with what differs between the new circles: run them in the order given, "
            "which is at random, and record time and temperature."
        )
    stuck = [name for name in space.chosen if own[name].floor_sd > _STUCK * own[name].sd]
    if not stuck:
        return tuple(said)
    found = [d for d in degeneracies(bound) if set(d.parameters) & set(stuck)]
    names = joined([display_name(name) for name in stuck])
    said += [
        f"More circles of this kind, at whatever forces, would narrow {names} by less than a fifth: what is left is shared by "
        "all circles."
    ]
    said += [f"{d.statement} Cure: {cure}" for d, cure in zip(found, cures(bound, found), strict=True)]
    return tuple(dict.fromkeys(said))


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


def _number(tests: int | None, pilot: Campaign) -> int:
    number = len(pilot.tests) if tests is None else tests
    if not 1 <= number <= MOST_TESTS:
        raise InputError(f"tests must be between 1 and {MOST_TESTS}, got {number}. Give the number of circles.")
    return number


def _positive(name: str, value: float) -> float:
    if not (np.isfinite(value) and value > 0.0):
        raise InputError(f"{name} must be a positive number, got {value}. Correct it.")
    return value
