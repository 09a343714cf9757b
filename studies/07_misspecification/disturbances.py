"""Campaigns whose readings are not what the model believes: truths and nuisances as it believes,
and something else on top."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

import ldbb_bayes as lb

Array = NDArray[np.float64]
Direction = Literal["CW", "CCW"]
FORCES_N = (36.0, 112.0, 238.0, 364.0, 490.0, 616.0, 742.0)
RANGE_N = FORCES_N[-1] - FORCES_N[0]
MID_N = (FORCES_N[0] + FORCES_N[-1]) / 2.0
READINGS = 360
Edition = Literal["first", "third"]
EDITIONS: dict[Edition, lb.HybridModel] = {
    "first": lb.HybridModel.first(degree=1),
    "third": lb.HybridModel.default(degree=1),
}
# Terms that no simulated machine has but for what its kind adds.
ADDED: dict[Edition, tuple[str, ...]] = {
    "first": ("hysteresis",),
    "third": ("hysteresis", "drift"),
}
# τ is the form at order 1, and in the third edition at order 6.
HYPER_UM: dict[Edition, dict[str, float]] = {
    "first": {"sigma": 0.3, "delta": 0.5, "kappa": 0.3, "tau": 2.0},
    "third": {"sigma": 0.3, "delta": 0.5, "kappa": 0.3, "tau": 0.5},
}
DIRECT = {"C_XXX": 5.5e-5, "C_YYY": 4.2e-5}  # mm/N
PRIOR_SD = {
    "C_XXX": 1e-4,
    "C_XYX": 1e-5,
    "C_YYY": 1e-4,
    "C_CXY": 1e-7,
    "C_CYY": 1e-7,
    "C_CCY": 1e-9,
}  # mm, N, rad
GEOMETRY_SD = {
    "E_XX1": 2e-4,
    "E_YX2": 1e-6,
    "E_XY2": 1e-6,
    "E_YY1": 2e-4,
    "E_C0YX": 5e-5,
    "E_Xt0": 0.02,
    "E_Yt0": 0.02,
}  # mm, rad
SLOPE_SCALE = 0.3
# In the third edition slopes go with the compliance, and no less than its prior sd over this.
LEAST_SIZE_DIVISOR = 20.0
# Truths are drawn from the prior with its sd times this; direct compliances within this share.
NARROWER = 0.5
DIRECT_SPREAD = 0.3
CIRCLE_S = 600.0
WARM_UP_S = 3600.0
SPIKE_DEG = 2.0
OUTLIER_UM = 10.0
KNEE_N = 500.0
QUADRANTS_DEG = (0.0, 90.0, 180.0, 270.0)


@dataclass(frozen=True)
class Kind:
    """What the readings have that the model does not believe, and what the user does about it.

    Attributes
    ----------
    backlash_um, backlash_um_per_kN : tuple of float
        Of X and Y: lag against the direction of travel, constant and in proportion to force.
    closed_above_N : float, optional
        The load closes the backlash of an axis outwards where its share of the force is larger.
    spike_um : float
        Height at every reversal, outwards, fading within `SPIKE_DEG`.
    hysteresis_um, hysteresis_um_per_kN : float
        Amplitude of sin 2θ with the sign of travel (servo mismatch), constant and in proportion to
        force.
    centre_um, bar_um : float
        How far warm-up with time constant `WARM_UP_S` leads centre (in a random direction) and bar
        length in the end.
    random_order : bool
        Forces run in random order, not from low to high.
    both_ways, stated : bool
        Every force CW and CCW, not CW alone; direction of travel given to the analysis.
    degrees_of_freedom, outliers : float, optional
        Noise of Student's t with the same sd; share of readings displaced by ± `OUTLIER_UM`.
    lost_N : float
        Of the largest force; what is lost grows with the square of the excess over `KNEE_N`.
    slope_error, offset_N : float
        Actual law of pressure against the one used: relative error of slope, and offset.
    curvature_um : float
        Deflection of the mount at the largest force that is quadratic in force.
    drift_term, masked : bool
        Remedies: the model with drift over time, which the third edition has; readings near the
        reversals left out.
    """

    backlash_um: tuple[float, float] = (0.0, 0.0)
    backlash_um_per_kN: tuple[float, float] = (0.0, 0.0)
    closed_above_N: float | None = None
    spike_um: float = 0.0
    hysteresis_um: float = 0.0
    hysteresis_um_per_kN: float = 0.0
    centre_um: float = 0.0
    bar_um: float = 0.0
    random_order: bool = False
    both_ways: bool = False
    stated: bool = True
    degrees_of_freedom: float | None = None
    outliers: float = 0.0
    lost_N: float = 0.0
    slope_error: float = 0.0
    offset_N: float = 0.0
    curvature_um: float = 0.0
    drift_term: bool = False
    masked: bool = False

    def model(self, edition: Edition) -> lb.HybridModel:
        """For the analysis."""
        believed = EDITIONS[edition]
        if self.drift_term and edition == "first":
            return believed.with_term(lb.terms.Drift("time"))
        return believed


KINDS = {
    "baseline": Kind(),
    "backlash small": Kind(backlash_um=(1.5, 0.5), spike_um=1.5),
    "backlash large": Kind(backlash_um=(6.0, 2.0), spike_um=6.0),
    "backlash large, masked": Kind(backlash_um=(6.0, 2.0), spike_um=6.0, masked=True),
    "backlash closed by load": Kind(backlash_um=(6.0, 2.0), closed_above_N=100.0),
    "centre, sorted": Kind(centre_um=15.0),
    "centre, random": Kind(centre_um=15.0, random_order=True),
    "centre, sorted, Drift": Kind(centre_um=15.0, drift_term=True),
    "bar small, sorted": Kind(bar_um=3.0),
    "bar large, sorted": Kind(bar_um=6.0),
    "bar large, random": Kind(bar_um=6.0, random_order=True),
    "bar large, sorted, Drift": Kind(bar_um=6.0, drift_term=True),
    "bar large, random, Drift": Kind(bar_um=6.0, random_order=True, drift_term=True),
    "hysteresis, CW": Kind(hysteresis_um=2.0, hysteresis_um_per_kN=2.0),
    "hysteresis, both, unstated": Kind(
        hysteresis_um=2.0, hysteresis_um_per_kN=2.0, both_ways=True, stated=False
    ),
    "hysteresis, both, stated": Kind(hysteresis_um=2.0, hysteresis_um_per_kN=2.0, both_ways=True),
    "lost motion, CW": Kind(backlash_um=(2.0, 1.0), backlash_um_per_kN=(6.0, 2.0)),
    "lost motion, both, stated": Kind(
        backlash_um=(2.0, 1.0), backlash_um_per_kN=(6.0, 2.0), both_ways=True
    ),
    "Student-t": Kind(degrees_of_freedom=3.0),
    "outliers": Kind(outliers=0.01),
    "saturation small": Kind(lost_N=15.0),
    "saturation large": Kind(lost_N=42.0),
    "pressure law small": Kind(slope_error=0.03, offset_N=-10.0),
    "pressure law large": Kind(slope_error=0.10, offset_N=-30.0),
    "curvature small": Kind(curvature_um=2.0),
    "curvature large": Kind(curvature_um=5.0),
}


def simulated(kind: Kind, seed: int, edition: Edition) -> tuple[lb.Campaign, dict[str, float]]:
    """Readings as the user has them, and the true parameters; truths, nuisances and noise of a seed
    are those of every kind, as this edition of the model believes them."""
    rng = np.random.default_rng([seed, 0])
    plan = _plan(kind, rng)
    actual_tests = [replace(test, force_N=actual_force_N(kind, test)) for test in plan.tests]
    truth = _truth(rng, edition)
    quiet = replace(EDITIONS[edition].without(*ADDED[edition]), reference_force_N=MID_N)
    actual = quiet.simulate(
        replace(plan, tests=tuple(actual_tests)),
        seed=seed,
        parameters=truth,
        hyper_um=HYPER_UM[edition] | {"sigma": 0.0},
    ).campaign
    heading = rng.uniform(0.0, 2.0 * np.pi)
    noise_rng = np.random.default_rng([seed, 1])
    mean_warmth = float(np.mean([warmth(test) for test in plan.tests]))
    sigma_um = HYPER_UM[edition]["sigma"]
    tests = []
    for planned, measured in zip(plan.tests, actual.tests, strict=True):
        noise_um = _noise_um(kind, sigma_um, len(measured.angle_deg), noise_rng)
        disturbance_um = added_um(kind, measured, heading, mean_warmth) + noise_um
        test = planned.with_reading_um(measured.reading_um + disturbance_um)
        if kind.masked:
            test = lb.reading.mask_reversals(test)
        if not kind.stated:
            test = replace(test, direction=None)
        tests.append(test)
    return replace(plan, tests=tuple(tests)), truth


def actual_force_N(kind: Kind, test: lb.CircularTest) -> float:
    """What the bar really pulls with where the user believes ``test.force_N``."""
    law = lb.campaign.ForceLaw()
    believed = float(test.force_N or 0.0)
    lost = kind.lost_N * (max(believed - KNEE_N, 0.0) / (FORCES_N[-1] - KNEE_N)) ** 2
    return believed + kind.slope_error * (believed - law.offset_N) + kind.offset_N - lost


def warmth(test: lb.CircularTest) -> float:
    """How far warm-up has gone when the test begins [1]."""
    return float(1.0 - np.exp(-float(test.time_s or 0.0) / WARM_UP_S))


def added_um(kind: Kind, test: lb.CircularTest, heading: float, mean_warmth: float) -> Array:
    """What the readings have on top of truth and nuisances, noise aside, shape (n,) [µm]; drift is
    about its mean."""
    angle = test.angle_deg
    force = float(test.force_N or 0.0)
    x = np.cos(np.deg2rad(angle))
    y = np.sin(np.deg2rad(angle))
    travel = 1.0 if test.direction == "CCW" else -1.0
    since_reversal_deg = np.array(
        [np.mod(travel * (angle - quadrant), 360.0) for quadrant in QUADRANTS_DEG]
    )
    spikes = kind.spike_um * np.exp(-since_reversal_deg / SPIKE_DEG).sum(axis=0)
    mismatch_um = kind.hysteresis_um + kind.hysteresis_um_per_kN * force * 1e-3
    mismatch = travel * mismatch_um * 2.0 * x * y
    drift = (warmth(test) - mean_warmth) * (
        kind.centre_um * (x * np.cos(heading) + y * np.sin(heading)) + kind.bar_um
    )
    mount = kind.curvature_um * (force / FORCES_N[-1]) ** 2
    return np.asarray(_backlash_um(kind, force, angle, travel) + spikes + mismatch + drift + mount)


def _backlash_um(kind: Kind, force: float, angle: Array, travel: float) -> Array:
    """Backlash of both axes along the bar, shape (n,) [µm]; ``travel``: 1 counter-clockwise."""
    x = np.cos(np.deg2rad(angle))
    y = np.sin(np.deg2rad(angle))
    gaps = np.array(kind.backlash_um) + np.array(kind.backlash_um_per_kN) * force * 1e-3
    lag_x = np.where(np.mod(angle, 360.0) < 180.0, travel, -travel)
    lag_y = np.where(np.mod(angle - 90.0, 360.0) < 180.0, travel, -travel)
    if kind.closed_above_N is not None:
        lag_x = np.where(force * np.abs(x) > kind.closed_above_N, np.sign(x), lag_x)
        lag_y = np.where(force * np.abs(y) > kind.closed_above_N, np.sign(y), lag_y)
    return np.asarray(0.5 * (gaps[0] * lag_x * x + gaps[1] * lag_y * y))


def _plan(kind: Kind, rng: np.random.Generator) -> lb.Campaign:
    """Seven forces, low to high or in random order, one circle every `CIRCLE_S`; CW, or CW and
    CCW."""
    # Drawn for every kind, so that all kinds of a seed have the same truth.
    places = rng.permutation(len(FORCES_N))
    if not kind.random_order:
        places = np.arange(len(FORCES_N))
    directions: tuple[Direction, ...] = ("CW",)
    if kind.both_ways:
        directions = ("CW", "CCW")
    angle_deg = np.arange(0.0, 360.0, 360.0 / READINGS)
    law = lb.campaign.ForceLaw()
    tests = []
    for force_N, place in zip(FORCES_N, places, strict=True):
        for i, direction in enumerate(directions):
            test = lb.CircularTest(
                force_N,
                angle_deg,
                pressure_bar=law.pressure_bar(force_N),
                direction=direction,
                time_s=float(place * len(directions) + i) * CIRCLE_S,
            )
            tests.append(test)
    return lb.Campaign(tuple(tests))


def _truth(rng: np.random.Generator, edition: Edition) -> dict[str, float]:
    """True parameters: direct compliances about the published ones, the others within `NARROWER` of
    their prior, slopes in proportion to the prior's compliance or, in the third edition, to the
    machine's; C_XXX(F), C_YYY(F), C_CCY(F) ≥ 0."""
    spread = np.array([rng.uniform(1.0 - DIRECT_SPREAD, 1.0 + DIRECT_SPREAD) for _ in DIRECT])
    truth = {
        name: NARROWER * sd * rng.standard_normal() for name, sd in (PRIOR_SD | GEOMETRY_SD).items()
    }
    for (name, value), factor in zip(DIRECT.items(), spread, strict=True):
        truth[name] = value * factor
    truth["C_CCY"] = abs(truth["C_CCY"])
    size = PRIOR_SD
    if edition == "third":
        smallest = {name: sd / LEAST_SIZE_DIVISOR for name, sd in PRIOR_SD.items()}
        size = {name: max(abs(truth[name]), smallest[name]) for name in PRIOR_SD}
    slopes = {
        name: NARROWER * SLOPE_SCALE * sd / RANGE_N * rng.standard_normal()
        for name, sd in size.items()
    }
    for name in (*DIRECT, "C_CCY"):
        steepest = 2.0 * truth[name] / RANGE_N
        slopes[name] = float(np.clip(slopes[name], -steepest, steepest))
    return truth | {f"{name}_1": slope for name, slope in slopes.items()}


def _noise_um(kind: Kind, sigma: float, count: int, rng: np.random.Generator) -> Array:
    """White noise, shape (count,) [µm]."""
    if kind.degrees_of_freedom is not None:
        nu = kind.degrees_of_freedom
        return np.asarray(sigma * np.sqrt((nu - 2.0) / nu) * rng.standard_t(nu, count))
    noise = sigma * rng.standard_normal(count)
    is_outlier = rng.random(count) < kind.outliers
    return np.asarray(noise + OUTLIER_UM * is_outlier * rng.choice([-1.0, 1.0], count))
