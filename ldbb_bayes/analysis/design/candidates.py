"""The tests one could run: candidates of a design, what they cost, in which order to run them, and their information.

Model properties, F0, force range and Ĉ, are the pilot's. Ball forms count as two terms as soon as any clocking differs; where
none does, two terms and one are the same model.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, permutations, product
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ldbb_bayes.analysis.design.criteria import Case, Criterion, Determinant, LogBayesFactor, SmallestEigenvalue, Variance
from ldbb_bayes.campaign.campaign import Campaign, CircularTest, Direction
from ldbb_bayes.errors import InputError, check_known
from ldbb_bayes.machine.chain import PLANES
from ldbb_bayes.model.hybrid import BoundModel, HybridModel, informations_of
from ldbb_bayes.model.prior import Prior

__all__ = [
    "ALWAYS",
    "CRITERIA",
    "Costs",
    "CriterionName",
    "bind_tests",
    "case_of",
    "chosen_parameters",
    "criterion_of",
    "foreseen_by",
    "frame_of",
    "grid_of_tests",
    "place_columns",
    "running_order",
    "templates",
]

Array = NDArray[Any]
CriterionName = Literal["eig", "d", "a", "c", "i", "e", "discriminate"]
CRITERIA: tuple[CriterionName, ...] = ("eig", "d", "a", "c", "i", "e", "discriminate")
_PREDICTED_FORCES = 33
_NEGLIGIBLE = 1e-12
_ALL_ORDERS, _DRAWN = 5, 50
ALWAYS = ("work_ball_deg", "tool_ball_deg", "radius_mm")
_WHERE_DIFFERENT = ("plane", "direction", "setup", "centre_x_mm", "centre_y_mm", "centre_z_mm")


def place_columns(tests: Sequence[CircularTest]) -> tuple[str, ...]:
    """What to say of every test beside its force: clockings and radius, and the rest where it differs."""
    return (*ALWAYS, *(name for name in _WHERE_DIFFERENT if len({getattr(test, name) for test in tests}) > 1))


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
    found = []
    new = max(test.setup or 1 for test in pilot.tests)
    for plane in planes or tuple(dict.fromkeys(str(test.plane) for test in pilot.tests)):
        own = [test for test in pilot.tests if test.plane == plane]
        ordered = sorted(own or pilot.tests, key=lambda test: len(test.angle_deg))
        plain = ordered[len(ordered) // 2].with_reading_um(None)
        plain = replace(plain, pressure_bar=None, name="", temperature_C=None, time_s=None, plane=plane)
        ways: Sequence[Direction | None] = directions or tuple(dict.fromkeys(test.direction for test in (own or pilot.tests)))
        for x, y, z in centres_mm or (plain.circle.centre_mm,):
            like = replace(plain, centre_x_mm=x, centre_y_mm=y, centre_z_mm=z)
            there = next((test for test in own if test.circle.centre_mm == like.circle.centre_mm), None)
            new += there is None
            like = replace(like, setup=new if there is None else there.setup)
            found += [replace(like, direction=way) for way in ways]
    return tuple(found)


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
    clockings_deg: Sequence[tuple[float, float]],
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

    def setups(self, clockings_deg: Collection[tuple[float, float]]) -> float:
        """Cost of changing over between clockings (work ball, tool ball), in the order that changes the tool ball least."""
        works = len({work for work, _ in clockings_deg})
        return self.work_ball * max(works - 1, 0) + self.tool_ball * _tool_changes(_best_sequence(clockings_deg))


def _best_sequence(clockings_deg: Collection[tuple[float, float]]) -> list[tuple[float, float]]:
    """Clockings in blocks of the work ball, with few changes of the tool ball."""
    works = sorted({work for work, _ in clockings_deg})
    orders = permutations(works) if len(works) <= _ALL_ORDERS else [tuple(works)]
    return min((_sequence(clockings_deg, order) for order in orders), key=_tool_changes)


def _sequence(clockings_deg: Collection[tuple[float, float]], works: Sequence[float]) -> list[tuple[float, float]]:
    """Blocks in this order: each begins with the tool-ball clocking in place and ends with one that the next block needs."""
    tools = {work: sorted({tool for own, tool in clockings_deg if own == work}) for work in works}
    found: list[tuple[float, float]] = []
    for i, work in enumerate(works):
        left = list(tools[work])
        first = found[-1][1] if found and found[-1][1] in left else None
        following = tools[works[i + 1]] if i + 1 < len(works) else []
        last = next((tool for tool in left if tool in following and tool != first), None) if len(left) > 1 else None
        middle = [tool for tool in left if tool not in (first, last)]
        ordered = [*([] if first is None else [first]), *middle, *([] if last is None else [last])]
        found += [(work, tool) for tool in ordered]
    return found


def _tool_changes(sequence: Sequence[tuple[float, float]]) -> int:
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
    return [ordered[i] for i in rng.permutation(len(ordered))] if len(ordered) > 1 else ordered


def _order_of_block(tests: Sequence[CircularTest], rng: np.random.Generator) -> list[CircularTest]:
    clockings = {(test.work_ball_deg, test.tool_ball_deg) for test in tests}
    best = _best_sequence(clockings)
    works = sorted({work for work, _ in clockings})
    drawn = (_sequence(clockings, rng.permutation(works).tolist()) for _ in range(_DRAWN))
    ordered: list[CircularTest] = []
    for clocking in next((own for own in drawn if _tool_changes(own) <= _tool_changes(best)), best):
        block = [test for test in tests if (test.work_ball_deg, test.tool_ball_deg) == clocking]
        ordered += [block[i] for i in rng.permutation(len(block))]
    return ordered


def bind_tests(model: HybridModel, pilot: Campaign, tests: Sequence[CircularTest], *, keep: bool) -> BoundModel:
    """The model bound to a plan of these tests, after the pilot's own where these are kept; F0, force range and Ĉ the pilot's."""
    run = pilot.plan().tests if keep else ()
    planned = tuple(replace(test, name="") for test in tests)
    known = (*pilot.foreseen, *(replace(test, direction=None) for test in pilot.plan().tests))
    return BoundModel(model, replace(pilot, tests=(*run, *planned), foreseen=known), pilot=pilot)


def chosen_parameters(bound: BoundModel, criterion: CriterionName, names: Sequence[str]) -> tuple[str, ...]:
    """The parameters of interest: those named, else all that the criterion is about."""
    check_known("criterion", [criterion], CRITERIA)
    check_known("parameter", names, bound.names)
    if names:
        chosen = tuple(name for name in bound.names if name in names)
    elif criterion == "discriminate":
        chosen = tuple(p.name for p in bound.parameters if p.group == "slope")
    elif criterion == "i":
        chosen = tuple(p.name for p in bound.parameters if p.group != "geometric")
    else:
        chosen = bound.names
    if criterion == "c" and len(chosen) != 1:
        raise InputError(f"criterion c must be given one parameter, got {len(chosen)}. Name it, for example E_C0YX.")
    groups = {p.group for p in bound.parameters if p.name in chosen}
    if criterion == "discriminate" and groups != {"slope"}:
        raise InputError(
            "criterion discriminate must be about slopes, got others or none. Name slopes such as C_XYX_1, or use a model of "
            "degree 1 or 2."
        )
    if criterion == "discriminate" and bound.model.prior.flat:
        raise InputError("criterion discriminate must have proper priors, got flat ones. Use the default preset.")
    if criterion == "i" and "geometric" in groups:
        raise InputError("criterion i must be about compliances and their slopes, got a geometric error. Leave it out.")
    return chosen


def criterion_of(
    bound: BoundModel,
    criterion: CriterionName,
    chosen: Sequence[str],
    *,
    size: float = 1.0,
    targets: Mapping[str, float] = MappingProxyType({}),
) -> Criterion:
    """The criterion, its parameters in units of their prior sd (their default prior sd when flat).

    ``size`` is that of slopes for ``discriminate`` [prior sd]; ``targets`` are units for ``a`` and ``c`` instead of that.
    """
    if criterion in ("eig", "d"):
        return Determinant(len(chosen))
    if criterion in ("a", "c"):
        scale = dict(zip(bound.names, bound.scale, strict=True))
        unit = np.array([scale[name] / targets.get(name, scale[name]) for name in chosen])
        return Variance(np.diag(unit**2) / len(chosen))
    if criterion == "e":
        return SmallestEigenvalue()
    if criterion == "discriminate":
        return LogBayesFactor(size)
    return Variance(_prediction_weight(bound, chosen))


def _prediction_weight(bound: BoundModel, chosen: Sequence[str]) -> Array:
    """W with tr(W S⁻¹) the variance of C_j(F) / var prior of C_j, averaged over the pilot's forces and the compliances."""
    forces = (bound.pilot or bound.campaign).forces_N
    own = [bound.names.index(name) for name in chosen]
    prior = Prior.default() if bound.model.prior.flat else bound.model.prior
    unit = prior.compliance_sd(bound.compliances, 0, bound.setting.force_range_N)
    concerned = {parameter.compliance for parameter in bound.parameters if parameter.name in chosen}
    used = [k for k, compliance in enumerate(bound.compliances) if compliance.label in concerned]
    rows = [
        (bound.compliance_at(force)[:, own] * bound.scale[own] / unit[:, None])[used]
        for force in np.linspace(forces.min(), forces.max(), _PREDICTED_FORCES)
    ]
    stacked = np.concatenate(rows)
    return np.asarray(stacked.T @ stacked / len(stacked))


def case_of(bound: BoundModel, run: int, phi: Array, chosen: Sequence[str], criterion: Criterion) -> Case:
    """The candidates' information on the chosen parameters at every φ (K, h); nuisances that touch none of them are left out.

    The model is bound to the tests already run, ``run`` of them, followed by the candidates.
    """
    rows, prior = [], []
    order, kept = np.zeros(0, dtype=int), np.zeros(0, dtype=int)
    for k, information in enumerate(informations_of(bound, phi)):
        blocks = _compact(information.blocks())
        if not k:
            own = [information.names.index(name) for name in chosen]
            order = _connected(blocks, own)
            kept = np.flatnonzero(np.abs(blocks[:, :, order]).max(axis=(0, 2)) > 0.0)
            flat = np.array([information.flat and owner == "Parameters" for owner in information.owners])[order]
        blocks = blocks[:, :, order][:, kept]
        before = blocks[:run].reshape(-1, len(order))
        prior.append(np.diag(np.where(flat, 0.0, 1.0)) + before.T @ before)
        rows.append(blocks[run:])
    return Case(np.array(rows), np.array(prior), np.full(len(phi), 1.0 / len(phi)), len(chosen), criterion)


def _compact(blocks: Sequence[Array]) -> Array:
    """Blocks of at most 25 rows as one array, rounding errors set to zero."""
    size = max(len(block) for block in blocks)
    stacked = np.zeros((len(blocks), size, blocks[0].shape[1]))
    for out, block in zip(stacked, blocks, strict=True):
        out[: len(block)] = block
    stacked[np.abs(stacked) < _NEGLIGIBLE * np.abs(stacked).max(axis=(0, 1))] = 0.0
    return stacked


def _connected(blocks: Array, own: Sequence[int]) -> NDArray[np.int_]:
    """Columns that share readings with those of interest, directly or through others; those of interest last."""
    size = np.abs(blocks)
    together = np.einsum("rij,rik->jk", size, size) > 0.0
    label = connected_components(together, directed=False)[1]
    rest = [j for j in range(len(label)) if label[j] in set(label[list(own)]) and j not in own]
    return np.array([*rest, *own], dtype=int)
