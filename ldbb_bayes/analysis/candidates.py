"""The tests one could run, in which order to run them, what to expect of them, and the space of
designs made of them.

Model properties, F0, force range and Ĉ, are the pilot's. Ball forms count as two terms as soon as
any clocking differs; where none does, two terms and one are the same model.

Expected are the posterior sd of every parameter, the information gained, constant or linear: of the
linear Gaussian model at given hyper-parameters, averaged over these; sd inside the truncation,
evidence without it. This takes the general route through `ldbb_bayes.model.information.Information`
and none of the search's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any, Literal, get_args
from weakref import WeakKeyDictionary

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.special import ndtr, ndtri
from scipy.stats import qmc

from ldbb_bayes.analysis.optimal import (
    Criterion,
    Determinant,
    Found,
    LogBayesFactor,
    Objective,
    Search,
    Variance,
)
from ldbb_bayes.campaign.campaign import Campaign, CircularTest, Direction
from ldbb_bayes.errors import check_known, require
from ldbb_bayes.inference.nodes import HyperPosterior, draw_parameters_given
from ldbb_bayes.machine.chain import PLANES
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.hybrid import BoundModel, HybridModel, information_of, informations_of
from ldbb_bayes.model.linear_algebra import singular_root
from ldbb_bayes.model.prior import Prior
from ldbb_bayes.model.setting import TRAVEL
from ldbb_bayes.model.terms import OWN
from ldbb_bayes.results import Array, Finite, Result
from ldbb_bayes.units import inside_name

__all__ = [
    "DECISIVE",
    "Clocking",
    "CriterionName",
    "Discrimination",
    "Expected",
    "Forecast",
    "Space",
    "States",
    "bind_tests",
    "carried",
    "hyper_nodes",
    "running_order",
    "states_before",
]

Clocking = tuple[float, float]
_ALWAYS = ("work_ball_deg", "tool_ball_deg", "radius_mm")
_WHERE_DIFFERENT = ("plane", "direction", "setup")
_ROUNDING = 1e-12


def templates(pilot: Campaign, directions: Sequence[Direction] = ()) -> tuple[CircularTest, ...]:
    """A test without readings for every plane of the pilot and every direction, by default those of
    the pilot there; else it is like the pilot's test in that plane with the median number of
    readings, its angles in equal steps."""
    made: list[CircularTest] = []
    for plane in dict.fromkeys(test.plane for test in pilot.tests):
        there = [test for test in pilot.tests if test.plane == plane]
        plain = sorted(there, key=lambda test: len(test.angle_deg))[len(there) // 2]
        plain = replace(
            plain.planned(), pressure_bar=None, name="", temperature_C=None, time_s=None
        )
        ways: Sequence[Direction | None] = directions or tuple(
            dict.fromkeys(test.direction for test in there)
        )
        made += [replace(plain, direction=way) for way in ways]
    return tuple(made)


def foreseen_by(
    pilot: Campaign, candidates: Sequence[CircularTest], judged: Sequence[CircularTest] = ()
) -> Campaign:
    """The pilot, knowing of tests of a kind it has not run: what only they can show is in its
    model. Where candidates go both ways in a plane, so do those foreseen: hysteresis then counts
    for every design. Tests that are only judged bring their parameters, not their direction."""
    both = {
        plane
        for plane in PLANES
        if {"CW", "CCW"} <= {test.direction for test in candidates if test.plane == plane}
    }
    possible = [(test, test.direction if str(test.plane) in both else None) for test in candidates]
    possible += [(test, None) for test in judged]
    offset = any(map(any, pilot.frames_mm.values())) or any(
        any(t.circle.centre_mm) for t in (*pilot.scope, *candidates, *judged)
    )

    def kind(test: CircularTest, *way: Any) -> tuple[Any, ...]:
        return (
            test.plane,
            test.setup,
            test.circle.centre_mm,
            test.radius_mm if offset else None,
            *way,
        )

    # A direction counts as foreseen only where it is: the pilot's own tests need not be part of
    # what is analysed.
    there = {kind(test) for test in pilot.scope} | {
        kind(test, test.direction) for test in pilot.foreseen
    }
    further = {kind(test, *([way] if way else [])): (test, way) for test, way in reversed(possible)}
    new = [replace(test, direction=way) for key, (test, way) in further.items() if key not in there]
    return replace(pilot, foreseen=(*pilot.foreseen, *new)) if new else pilot


def grid_of_tests(
    templates: Sequence[CircularTest],
    forces_N: Sequence[float],
    clockings_deg: Sequence[Clocking],
    radii_mm: Sequence[float],
) -> tuple[CircularTest, ...]:
    """Every combination as a planned test: all forces of the first template, radius and clocking,
    then of the next."""
    return tuple(
        replace(
            like,
            force_N=float(force),
            work_ball_deg=float(work),
            tool_ball_deg=float(tool),
            radius_mm=float(radius),
        )
        for like, radius, (work, tool), force in product(
            templates, radii_mm, clockings_deg, forces_N
        )
    )


def bind_tests(
    model: HybridModel, pilot: Campaign, tests: Sequence[CircularTest], *, keep: bool
) -> BoundModel:
    """The model bound to a plan of these tests, after the pilot's own where these are kept; F0,
    force range and Ĉ the pilot's."""
    run = pilot.plan().tests
    planned = tuple(replace(test, name="") if test.name else test for test in tests)
    known = (*pilot.foreseen, *(replace(test, direction=None) for test in run))
    return BoundModel(
        model, replace(pilot, tests=(*(run if keep else ()), *planned), foreseen=known), pilot=pilot
    )


def running_order(
    tests: Sequence[CircularTest], rng: np.random.Generator
) -> tuple[CircularTest, ...]:
    """The tests in the order in which to run them, so that drift is not force: blocks of one
    set-up, plane and radius, in them of one work-ball clocking, in them of one tool-ball clocking,
    there and back; forces and directions of travel at random."""

    def blocks(
        tests: Sequence[CircularTest], key: Callable[[CircularTest], Any]
    ) -> list[list[CircularTest]]:
        keys = sorted({key(test) for test in tests})
        return [
            [test for test in tests if key(test) == keys[i]] for i in rng.permutation(len(keys))
        ]

    ordered: list[CircularTest] = []
    for mounted in blocks(tests, lambda test: test.setup or 1):
        for place in blocks(mounted, lambda test: (str(test.plane), float(test.radius_mm or 0.0))):
            for k, turned in enumerate(blocks(place, lambda test: test.work_ball_deg)):
                for tool in sorted({test.tool_ball_deg for test in turned}, reverse=bool(k % 2)):
                    alike = [test for test in turned if test.tool_ball_deg == tool]
                    ordered += [alike[i] for i in rng.permutation(len(alike))]
    return tuple(replace(test, name="") for test in ordered)


CriterionName = Literal["eig", "d", "a", "c", "i", "discriminate"]
_PREDICTED_FORCES = 33


def _prediction_weight(bound: BoundModel, chosen: Sequence[str]) -> Array:
    """W with tr(W S⁻¹) the variance of C_j(F) / var prior of C_j, averaged over the pilot's forces
    and the compliances."""
    forces = (bound.pilot or bound.campaign).forces_N
    own = [bound.names.index(name) for name in chosen]
    prior = Prior.first() if bound.model.prior.flat else bound.model.prior
    unit = prior.compliance_sd(bound.compliances)
    concerned = {parameter.compliance for parameter in bound.parameters if parameter.name in chosen}
    used = [k for k, compliance in enumerate(bound.compliances) if compliance.label in concerned]
    at = np.linspace(forces.min(), forces.max(), _PREDICTED_FORCES)
    rows = np.concatenate(
        [
            (bound.compliance_at(force)[:, own] * bound.scale[own] / unit[:, None])[used]
            for force in at
        ]
    )
    return np.asarray(rows.T @ rows / len(rows))


def objective_of(
    bound: BoundModel, run: int, phi: Array, chosen: Sequence[str], criterion: Criterion
) -> Objective:
    """The candidates' information on the chosen parameters at every φ (K, h); nuisances that touch
    none of them are left out. The model is bound to the tests already run, ``run`` of them,
    followed by the candidates."""
    rows = []
    prior = []
    order = kept = proper = np.zeros(0, dtype=int)
    for k, information in enumerate(informations_of(bound, carried(bound, phi, run))):
        blocks = _compact(information.blocks())
        if not k:
            own = [information.names.index(name) for name in chosen]
            order = _connected(blocks, own)
            kept = np.flatnonzero(np.abs(blocks[:, :, order]).max(axis=(0, 2)) > 0.0)
            proper = np.array(
                [not (information.flat and owner == OWN) for owner in information.owners]
            )[order]
        blocks = blocks[:, :, order][:, kept]
        before = blocks[:run].reshape(-1, len(order))
        prior.append(np.diag(proper.astype(float)) + before.T @ before)
        rows.append(blocks[run:])
    return Objective(np.array(rows), np.array(prior), len(chosen), criterion)


def _compact(blocks: Sequence[Array]) -> Array:
    """Blocks of at most 25 rows as one array, rounding errors set to zero."""
    stacked = np.zeros((len(blocks), max(map(len, blocks)), blocks[0].shape[1]))
    for own, block in zip(stacked, blocks, strict=True):
        own[: len(block)] = block
    stacked[np.abs(stacked) < _ROUNDING * np.abs(stacked).max(axis=(0, 1))] = 0.0
    return stacked


def _connected(blocks: Array, own: Sequence[int]) -> NDArray[np.int_]:
    """Columns that share readings with those of interest, directly or through others; those of
    interest last."""
    size = np.abs(blocks)
    _, label = connected_components(np.einsum("rij,rik->jk", size, size) > 0.0, directed=False)
    joined = np.isin(label, label[list(own)])
    joined[list(own)] = False
    return np.array([*np.flatnonzero(joined), *own], dtype=int)


# ---- what to expect of tests before they are run

DECISIVE = 5.0
_REPEATS = 4
_EACH = 256
_LEAST = 1e-12
_VERY_OFTEN = 1e6
_RANK = 1e-6
_KEPT: WeakKeyDictionary[Campaign, list[HyperPosterior]] = WeakKeyDictionary()


@dataclass(frozen=True)
class Expected(Result):
    """Prior sd of one parameter (infinite when flat), in inside units, and its expected posterior
    sd.

    ``sd`` is inside the truncation, ``untruncated_sd`` without it: their squares are averaged over
    the hyper-parameters; infinite where flat priors leave something undetermined. ``sd_error`` is
    the standard error of ``sd``, a mean over states of the machine, as if these were independent;
    they are spread more evenly. ``floor_sd`` is what nuisances shared by all tests leave if every
    test were run a million times, narrowed by the truncation as ``sd``.
    """

    unit: str
    prior_sd: Finite
    sd: Finite
    sd_error: Finite
    untruncated_sd: Finite
    floor_sd: Finite


@dataclass(frozen=True)
class Discrimination(Result):
    """What ln B(with the slopes / without) will be: its mean [nat] and the probabilities of
    decisive evidence for what is true, and for what is false, if there are slopes, and if there are
    none."""

    size: float  #: of the slopes, in prior sd
    #: tests already run are part of it: slopes are as those leave them, else drawn from their prior
    #: × ``size``
    augmented: bool
    threshold: float  #: |ln B| from which evidence is called decisive [nat]
    expected_with: float
    expected_without: float
    decisive_with: float
    decisive_without: float
    misleading_with: float
    misleading_without: float
    #: probability of decisive evidence if this slope alone is there, of plus or minus ``size``
    #: prior sd
    power: dict[str, float]


@dataclass(frozen=True, eq=False)
class Forecast(Result):
    """What to expect of tests: sd of every parameter; the expected Kullback-Leibler divergence of
    the posterior from the prior [nat], infinite when that is flat; constant or linear, None without
    slopes or with flat priors."""

    expected: dict[str, Expected]  #: by parameter
    information_gain: Finite  #: expected [nat]
    discrimination: Discrimination | None  #: None where degree is 0

    @property
    def determined(self) -> bool:
        """Whether the tests determine every parameter; with proper priors they do."""
        return all(np.isfinite(entry.sd) for entry in self.expected.values())


@dataclass(frozen=True, eq=False)
class States:
    """K equally likely states of the machine: hyper-parameters φ (K, h) [mm], and parameters β (K,
    p) inside the truncation, none when their prior is flat. ``before``, at each φ, untruncated: the
    prior, or the posterior of tests that count as run."""

    phi: Array
    beta: Array
    before: Gaussian


def hyper_nodes(model: HybridModel, pilot: Campaign, size: int, seed: int) -> Array:
    """Values of φ, equally likely, shape (size, h) [mm]: of its posterior given the pilot, or of
    its prior for a plan. For a prior their number is rounded up to a power of two. With flat priors
    variances are σ² times something that does not depend on it: one node, the root mean square."""
    if pilot.is_plan:
        prior = model.bind(pilot).hyper_prior
        points = qmc.Sobol(len(prior.names), rng=np.random.default_rng(seed))
        nodes = np.asarray(prior.quantile(points.random(1 << int(np.ceil(np.log2(size))))))
    else:
        posterior = _posterior(model, pilot)
        nodes = posterior.bound.hyper_prior.phi(
            posterior.brief.pick(size, np.random.default_rng(seed))
        )
    return np.sqrt((nodes**2).mean(axis=0, keepdims=True)) if model.prior.flat else nodes


def carried(bound: BoundModel, phi: Array, run: int) -> Array:
    """φ (K, h) of the pilot for a binding of ``run`` of its circles and of circles to come. These
    have λ = 1, as 1/λ² is one on average; scales that do not act on the pilot are spread over their
    prior."""
    pilot = bound.pilot or bound.campaign
    before = bound if pilot is bound.campaign else _posterior(bound.model, pilot).bound
    place = {name: k for k, name in enumerate(before.hyper_prior.names)}
    circles = dict(
        zip(bound.setting.circle[:run].tolist(), before.setting.circle.tolist(), strict=False)
    )
    levels = np.random.default_rng(0).permuted(
        np.tile((np.arange(len(phi)) + 0.5) / len(phi), (len(bound.hyper_prior.names), 1)), axis=1
    )
    found = bound.hyper_prior.quantile(levels.T)
    for k, (name, law) in enumerate(
        zip(bound.hyper_prior.names, bound.hyper_prior.laws, strict=True)
    ):
        own = circles.get(name, "") if law == "circle" else name
        if own in place:
            found[:, k] = phi[:, place[own]]
        elif law == "circle":
            found[:, k] = 1.0
    return found


def states_before(
    model: HybridModel, pilot: Campaign, size: int, seed: int, *, augment: bool
) -> States:
    """States drawn from the pilot's posterior, or from the prior for a plan."""
    bound = model.bind(pilot)
    rng = np.random.default_rng(seed)
    phi = hyper_nodes(model, pilot, size, seed)
    shape = len(phi), len(bound.names)
    if model.prior.flat:
        return States(
            phi, np.zeros((len(phi), 0)), Gaussian(np.zeros((*shape, shape[1])), np.zeros(shape))
        )
    if pilot.is_plan:
        beta = bound.draw_parameters(len(phi), rng)
    else:
        beta = draw_parameters_given(_posterior(model, pilot), bound.hyper_prior.free(phi), rng)
    if augment and not pilot.is_plan:
        given = bound.given(phi)[1]
        return States(phi, beta, Gaussian.factored(given.mean, given.root, given.scale))
    return States(
        phi,
        beta,
        Gaussian.of(
            np.broadcast_to(bound.prior_mean, shape), np.broadcast_to(bound.prior_sd**2, shape)
        ),
    )


def _posterior(model: HybridModel, pilot: Campaign) -> HyperPosterior:
    """p(φ | pilot), computed once while the pilot lives."""
    kept = _KEPT.setdefault(pilot, [])
    if not any(posterior.bound.model == model for posterior in kept):
        bound = model.bind(pilot)
        kept.append(HyperPosterior(bound, truncated=bound.truncation.active))
    return next(posterior for posterior in kept if posterior.bound.model == model)


def narrowed(
    bound: BoundModel, states: States, covariance: Array, seed: int
) -> tuple[Array, Array]:
    """Expected posterior variances inside the truncation and their standard errors, (p,) each, from
    the covariances without it (K, p, p). States that the new tests' forces rule out are left out.
    For every state the mean that the analysis would find is drawn, and the truncated Gaussian about
    it is taken. The errors are those of a mean over as many states."""
    each = np.einsum("kii->ki", covariance)
    plain = each.mean(axis=0)
    change = np.zeros_like(each)
    if bound.truncation.active:
        possible = bound.truncation.holds(states.beta)
        possible |= not possible.any()
        each = each[possible]
        change = _change_inside(bound, states, possible, covariance, seed)
    error = (each + change).std(axis=0) / np.sqrt(max(len(each) - 1, 1))
    return np.maximum(plain + change.mean(axis=0), 0.0), error


def _change_inside(
    bound: BoundModel, states: States, possible: Array, covariance: Array, seed: int
) -> Array:
    """What the truncation adds to the variances in possible states, shape (states, p). The mean m
    that an analysis will find is m | β ~ N(m₁ + W (β − m₁), W C), W = 1 − C P₁, with the precision
    P₁ before the tests and the covariance C after them."""
    scale = bound.scale
    start = states.before.mean[possible]
    both = np.outer(scale, scale)
    after = covariance[possible] / both
    weight = np.eye(len(scale)) - after @ (states.before.precision[possible] * both)
    root = singular_root(weight @ after)
    mean = start / scale + np.einsum("kij,kj->ki", weight, (states.beta[possible] - start) / scale)
    spread = singular_root(after) * scale[:, None]
    noise = np.random.default_rng(seed).standard_normal((_REPEATS, *mean.shape))
    drawn = scale * (mean + np.einsum("kij,rkj->rki", root, noise)).reshape(-1, len(scale))
    spread = np.tile(spread, (_REPEATS, 1, 1))
    shift, inside, axes = bound.truncation.orthants(drawn, spread).moments()
    along = spread @ np.swapaxes(axes, 1, 2)
    change = np.einsum("kpd,kpd->kp", along @ (inside - np.eye(shift.shape[1])), along)
    return np.asarray(change.reshape(_REPEATS, *mean.shape).mean(axis=0))


def discrimination_of(
    covariance: Array,
    names: tuple[str, ...],
    *,
    size: float,
    before: Gaussian | None = None,
    threshold: float = DECISIVE,
    seed: int = 1,
) -> Discrimination:
    """What ln B will be, from the slopes' posterior covariances C (K, s, s) in units of their prior
    sd, one for every value of φ.

    ``before`` is their posterior after tests already run, in the same units; default: none were.
    With the mean m that the analysis will find, ln B = ½ (ln det C + mᵀ C⁻¹ m). With P₁ the
    precision before, C = L Lᵀ and Lᵀ P₁ L = U e Uᵀ, what z = Uᵀ L⁻¹ m consists of is independent:
    given slopes β with means e Uᵀ L⁻¹ m₁ + (1 − e) Uᵀ L⁻¹ β and variances 1 − e.
    """
    count, s = covariance.shape[:2]
    start = Gaussian.of(np.zeros((count, s)), np.ones((count, s))) if before is None else before
    root = np.linalg.cholesky(covariance)
    left, axes = np.linalg.eigh(np.swapaxes(root, 1, 2) @ start.precision @ root)
    left = np.clip(left, _LEAST, 1.0)
    learnt = 1.0 - left
    turn = np.linalg.solve(root @ axes, np.broadcast_to(np.eye(s), covariance.shape))
    log_volume = np.linalg.slogdet(covariance)[1]
    mean = np.einsum("kij,kj->ki", turn, start.mean)
    points = _points(count, s - 1, seed)

    def probability(centre: Array, variance: Array, level: float) -> float:
        """P(ln B > level), z of these means (K, 1 or 2, s), which the points take in turn, and
        variances (K, s)."""
        first = np.argsort(-variance, axis=1)[:, None]
        sd = np.sqrt(np.maximum(np.take_along_axis(variance[:, None], first, axis=2), _LEAST))
        own = np.take_along_axis(centre, first, axis=2)[
            :, np.arange(points.shape[1]) % centre.shape[1]
        ]
        rest = (
            2.0 * level
            - log_volume[:, None]
            - ((own[..., 1:] + sd[..., 1:] * points) ** 2).sum(axis=2)
        )
        # The component of the largest variance is integrated out.
        edge = np.sqrt(np.maximum(rest, 0.0)) / sd[..., 0]
        middle = own[..., 0] / sd[..., 0]
        return float(np.where(rest > 0.0, ndtr(-edge - middle) + ndtr(middle - edge), 1.0).mean())

    there = mean[:, None], learnt * (1.0 + learnt * (size**2 if before is None else 1.0) / left)
    nothing = (left * mean)[:, None], learnt
    expected = [
        0.5 * (log_volume + (own[:, 0] ** 2 + variance).sum(axis=1)).mean()
        for own, variance in (there, nothing)
    ]
    moved = (
        size
        * np.array([1.0, -1.0])[:, None]
        * (learnt[:, None] * np.swapaxes(turn, 1, 2))[:, :, None]
    )
    return Discrimination(
        size,
        before is not None,
        threshold,
        float(expected[0]),
        float(expected[1]),
        probability(*there, threshold),
        1.0 - probability(*nothing, -threshold),
        1.0 - probability(*there, -threshold),
        probability(*nothing, threshold),
        {
            name: probability(nothing[0] + moved[:, j], learnt, threshold)
            for j, name in enumerate(names)
        },
    )


def _points(count: int, dimensions: int, seed: int) -> Array:
    """Standard normal points, shape (count, _EACH, dimensions): quasi-random ones, moved at random
    for each."""
    rng = np.random.default_rng(seed)
    points = qmc.Sobol(dimensions, rng=rng).random(_EACH) if dimensions else np.zeros((_EACH, 0))
    return np.asarray(ndtri((points + rng.random((count, 1, dimensions))) % 1.0))


def posteriors(bound: BoundModel, phi: Array, run: int) -> tuple[Gaussian | None, Array]:
    """p(β | y, φ), ``run`` circles being the pilot's, about zero and floor sd (p,), both in units
    of the prior sd; none where flat priors leave something open."""
    phi = carried(bound, phi, run)
    one = information_of(bound, phi[0])
    own = one.interest
    flat = one.flat
    size = len(one.names)
    # All that the readings say of the coefficients, in as few rows as these are.
    rows = np.array(
        [np.linalg.qr(information.rows(), mode="r") for information in informations_of(bound, phi)]
    )
    if flat and np.linalg.matrix_rank(rows[..., own], tol=_RANK).min() < len(own):
        return None, np.zeros(0)
    repeated = np.array([1.0, np.sqrt(_VERY_OFTEN)])[:, None, None, None] * rows
    nothing = np.zeros(repeated.shape[:-1])
    prior = Gaussian.of(np.zeros(size), np.ones(size))
    both = (
        Gaussian.from_rows(repeated, nothing)
        if flat
        else prior.observe(repeated, nothing).marginal(own.tolist())
    )
    return Gaussian.factored(both.mean[0], both.root[0], both.scale[0]), np.sqrt(
        (both.sd[1] ** 2).mean(axis=0)
    )


# ---- the space of designs

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
        check_known("direction", self.directions, TRAVEL)
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
