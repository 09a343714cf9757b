"""What an evidence of the default model costs, by planes, circles, radii, directions and clockings.

Each density is timed beside two limits: the operations that its elimination counts, and a dense
Cholesky factorisation of the covariance of the same Fourier coefficients by LAPACK.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from itertools import product
from typing import Any

import numpy as np
from scipy.linalg import lapack

import ldbb_bayes as lb
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.integrals import CHUNK
from ldbb_bayes.inference.nodes import compute_nodes
from ldbb_bayes.model.fourier import SIZE
from ldbb_bayes.model.hybrid import BoundModel

MODEL = lb.HybridModel.default(degree=1)
READINGS = 90
LOWEST_N = 36.0
HIGHEST_N = 742.0
# Scales of the simulated campaigns [µm]: usual ones, and a quiet machine without set-up shift and
# discrepancy, whose scales are near zero.
USUAL_UM = {"sigma": 0.15, "delta": 0.4, "kappa": 0.3, "tau": 2.0}
QUIET_UM = {"sigma": 0.15, "delta": 0.0, "kappa": 0.0, "tau": 2.0}
TRUTH = {"C_XXX": 6e-5, "C_YYY": 5e-5, "C_CCY": 5e-10}
FRAMES_MM = {"X": (5.0, -40.0, 60.0), "Y": (0.0, 10.0, -200.0)}
ALL_PLANES = ("XY", "YZ", "ZX")
# Error asked of a log evidence [nat].
TOLERANCE = 1e-2
# CPU seconds asked of an evidence: up to twelve circles in one plane, otherwise.
SHORT_S = 0.3
LONG_S = 3.0
SHORT_CIRCLES = 12


@dataclass(frozen=True)
class Kind:
    """A kind of campaign: circles at equal steps of force in every plane, radius and direction."""

    forces: int
    planes: tuple[str, ...] = ("XY",)
    radii_mm: tuple[float, ...] = (150.0,)
    directions: tuple[str, ...] = ("CW",)
    work_ball_deg: tuple[float, ...] = (0.0,)
    quiet: bool = False

    @property
    def circles(self) -> int:
        """Number of circles of all planes."""
        settings = len(self.radii_mm) * len(self.directions) * len(self.work_ball_deg)
        return self.forces * len(self.planes) * settings

    def tests(self) -> list[lb.CircularTest]:
        """Return all circles, with angles and no readings."""
        angle_deg = np.arange(READINGS) * 360.0 / READINGS
        forces_N = np.linspace(LOWEST_N, HIGHEST_N, self.forces)
        settings = product(
            forces_N, self.planes, self.radii_mm, self.directions, self.work_ball_deg
        )
        tests = []
        for force_N, plane, radius_mm, direction, work_ball_deg in settings:
            tests.append(
                lb.CircularTest(
                    force_N,
                    angle_deg,
                    plane=plane,
                    radius_mm=radius_mm,
                    direction=direction,
                    work_ball_deg=work_ball_deg,
                )
            )
        return tests

    def campaign(self, seed: int = 2) -> lb.Campaign:
        """Return a simulated campaign; ``seed`` is the seed of its readings."""
        plan = lb.Campaign(self.tests())
        if len(self.planes) > 1:
            plan = lb.Campaign(self.tests(), topology="wXFYZt", frames_mm=FRAMES_MM)
        hyper_um = QUIET_UM if self.quiet else USUAL_UM
        names = MODEL.bind(plan).names
        truth = {name: value for name, value in TRUTH.items() if name in names}
        return MODEL.simulate(plan, seed=seed, parameters=truth, hyper_um=hyper_um).campaign


def kinds(largest: int) -> dict[str, Kind]:
    """Return the kinds of campaigns that have at most so many circles."""
    everything: dict[str, Kind] = {}
    for quiet in (False, True):
        for forces in (3, 4, 6, 12, 24, 40):
            name = f"one plane, {forces} circles"
            if quiet:
                name += ", quiet"
            everything[name] = Kind(forces, quiet=quiet)
    everything |= {
        "one plane, 6 forces, both directions": Kind(6, directions=("CW", "CCW")),
        "one plane, 6 forces, two radii": Kind(6, radii_mm=(100.0, 150.0)),
        "one plane, 6 forces, work ball clocked": Kind(6, work_ball_deg=(0.0, 90.0)),
        "two planes, 3 forces": Kind(3, ("XY", "YZ")),
        "three planes, 3 forces": Kind(3, ALL_PLANES),
        "three planes, 3 forces, quiet": Kind(3, ALL_PLANES, quiet=True),
        "three planes, 4 forces": Kind(4, ALL_PLANES),
        "three planes, 3 forces, both directions": Kind(3, ALL_PLANES, directions=("CW", "CCW")),
        "three planes, 3 forces, two radii": Kind(3, ALL_PLANES, radii_mm=(100.0, 150.0)),
        "three planes, 3 forces, work ball clocked": Kind(3, ALL_PLANES, work_ball_deg=(0.0, 90.0)),
    }
    return {name: kind for name, kind in everything.items() if kind.circles <= largest}


def cost_of_campaigns(largest: int, rounds: int) -> dict[str, dict[str, Any]]:
    """Return what a density and an evidence of each kind of campaign cost, by kind."""
    # What is compiled and loaded at the first evidence does not count.
    _evidence(Kind(3).campaign())
    return {name: _cost(kind, rounds) for name, kind in kinds(largest).items()}


def _cost(kind: Kind, rounds: int) -> dict[str, Any]:
    campaign = kind.campaign()
    bound = MODEL.bind(campaign)
    evidence = _evidence(campaign)
    asked = LONG_S
    if len(kind.planes) == 1 and kind.circles <= SHORT_CIRCLES:
        asked = SHORT_S
    return {
        "circles": kind.circles,
        "parameters": len(bound.names),
        "scales": len(bound.hyper_prior.names),
        "operations": _operations(bound),
        "asked_s": asked,
        **asdict(evidence),
        **_densities(bound, rounds),
    }


@dataclass(frozen=True)
class EvidenceCost:
    """A log evidence with its error, and what it took."""

    log_evidence: float  #: [nat]
    error: float  #: [nat]
    evidence_s: float  #: CPU seconds, binding of the model and search for modes included


def _evidence(campaign: lb.Campaign) -> EvidenceCost:
    start = time.process_time()
    evidence = lb.log_evidence(MODEL, campaign, tolerance=TOLERANCE)
    return EvidenceCost(evidence.log_value, evidence.error, time.process_time() - start)


def _densities(bound: BoundModel, rounds: int) -> dict[str, float]:
    """Return median CPU µs of densities at one value of φ, computed in stacks of many."""
    prior = bound.hyper_prior
    rng = np.random.default_rng(1)
    nodes = compute_nodes(HyperPosterior(bound, truncated=False), TOLERANCE)
    phi = prior.phi(nodes.integral.resample(CHUNK, rng))
    size = SIZE * len(bound.reduced)
    covariance = np.asfortranarray(np.eye(size) + 0.5 / size)
    works: Mapping[str, Callable[[], object]] = {
        "density_us": partial(bound.log_evidence, phi),
        "conditional_us": partial(bound.given, phi),
        "dense_us": partial(lapack.dpotrf, covariance),
    }
    per_call = {"density_us": CHUNK, "conditional_us": CHUNK, "dense_us": 1}
    times_us: dict[str, list[float]] = {name: [] for name in works}
    for _ in range(rounds + 1):
        for name, work in works.items():
            start = time.process_time()
            work()
            seconds = time.process_time() - start
            times_us[name].append(seconds / per_call[name] * 1e6)
    return {name: float(np.median(times[1:])) for name, times in times_us.items()}


def _operations(bound: BoundModel) -> int:
    """Return multiplications of the elimination of all coefficients, for one value of φ.

    A group of s columns whose border has m entries takes s³/6 for its own Cholesky factor, s² m/2
    for its border and s m (m + 1)/2 for the products that change later columns.
    """
    total = 0.0
    for front in bound.collapsed._design.elimination(len(bound.names)).plan.fronts:
        groups, columns, width = front.shape
        border = width - columns
        factor_and_border = columns**3 / 6.0 + columns**2 * border / 2.0
        changes_of_later = columns * border * (border + 1) / 2.0
        total += groups * (factor_and_border + changes_of_later)
    return int(total)
