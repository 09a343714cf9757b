"""Calibration with a Gaussian process as discrepancy (Kennedy and O'Hagan 2001).

    y = J θ + B b + d(angle, force) + ε

J is the hybrid Jacobian (Eq. 33), B the budget of the instrument and d a Gaussian process. The
prior of θ is that of ldbb_bayes. The kernel and the density of the scales of d are those of ACBICI;
the rest is linear, and is integrated out here: `as_it_stands` compares that with ACBICI's own
sampling.
"""

from __future__ import annotations

import io
import tempfile
import time
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np
from mixtures import Normals, mixture_prediction
from readings import (
    LEVELS,
    MODEL,
    READINGS_OF_A_CIRCLE,
    Answer,
    Array,
    Readings,
    readings_of,
)
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize
from scipy.stats import multivariate_normal

import ldbb_bayes as lb
from ldbb_bayes.parallel import one_blas_thread

__all__ = [
    "DISCREPANCY_UM2",
    "HAS_PACKAGE",
    "NOISE_UM",
    "READINGS_SAMPLED",
    "as_it_stands",
    "by_gaussian_process",
]

HAS_PACKAGE = find_spec("ACBICI") is not None
# Scales of the half-normal priors of the noise [µm] and of the variance of the discrepancy [µm²].
NOISE_UM = 1.0
DISCREPANCY_UM2 = 100.0
# Draws of the parameters, over all scales.
DRAWS = 4000

# The search for the mode of the scales begins at these lengths, for there may be two modes.
START_LENGTHS = (0.2, 1.0)
# Step of the second differences of the log density at the mode, in log scales.
HESSIAN_STEP = 0.1
HESSIAN_DIVISOR = 0.04  # 4 HESSIAN_STEP²
# Scales proposed about the mode and resampled; how much wider the proposal is than the mode.
SCALES_PROPOSED = 80
SCALES_RESAMPLED = 40
PROPOSAL_WIDTH = 1.3
LEAST_CURVATURE = 0.25

# What the package samples where it samples everything: readings of a circle, and its chains.
READINGS_SAMPLED = 12
WALKERS = 72
STEPS = 3000
BURN_IN = 0.5


@dataclass(frozen=True, eq=False)
class LinearPart:
    """What is linear in the model.

    Attributes
    ----------
    readings : Readings
    columns : array, shape (n, q)
        Columns whose coefficients have a standard normal prior, those of θ first [µm].
    theta : array, shape (p,)
        Parameters about which errors of force and angle are linear.
    """

    readings: Readings
    columns: Array
    theta: Array


def linear_part(campaign: lb.Campaign, prior_sd: Array, count: int, *, full: bool) -> LinearPart:
    """Return what is linear, for ``count`` readings of every test."""
    readings = readings_of(campaign, campaign.tests, prior_sd, count)
    theta = np.linalg.lstsq(readings.jacobian, readings.reading_um, rcond=1e-12)[0]
    budget = readings.budget(campaign, theta, full=full)
    by_test = readings.separated_by_test(budget.by_circle)
    columns = np.column_stack([readings.jacobian, budget.shared, by_test])
    return LinearPart(readings, columns, theta)


def calibrator(linear: LinearPart, *, integrated: bool) -> Any:
    """Return ACBICI's calibrator; what is linear is integrated out, or is sampled as parameters."""
    import ACBICI

    columns = linear.columns
    prior_covariance = columns @ columns.T
    standard_normal = ACBICI.Normal(mu=0.0, sigma=1.0)

    class Model(ACBICI.ACBICImodel):
        def __init__(self) -> None:
            self.xdim = 3
            self.ydim = 1
            if not integrated:
                for k in range(columns.shape[1]):
                    self.addParameter(label=f"t{k}", prior=standard_normal)

        def symbolicModel(self, x: Array, t: Array) -> Array:
            return np.asarray(columns @ t[0])

    class Integrated(ACBICI.discrepancyCalibrator):
        def logLikelihood_vect(self) -> float:
            covariance = self.covd(self.xExp, self.xExp) + prior_covariance
            covariance[np.diag_indices_from(covariance)] += self.expSTD**2
            mean = np.zeros(len(covariance))
            return float(self.gaussianLogLikelihood(self.yExp, mean, covariance))

    if integrated:
        process = Integrated(Model(), name="d")
    else:
        process = ACBICI.discrepancyCalibrator(Model(), name="d")
    readings = linear.readings
    process.storeExperimentalData(np.column_stack([readings.coordinates(), readings.reading_um]))
    process.setExperimentalSTDPrior(ACBICI.HalfNormal(mu=0.0, sigma=NOISE_UM))
    process.replaceHyperparameterPrior(
        label=r"$\lambda_d$", prior=ACBICI.HalfNormal(mu=0.0, sigma=DISCREPANCY_UM2)
    )
    process.setDefaultHyperparametersPriors()
    return process


class LogScaleDensity:
    """Posterior density of the logarithms of the three scales: length, variance of the discrepancy,
    noise."""

    def __init__(self, process: Any) -> None:
        self.process = process

    def log_density(self, log_scales: Array) -> float:
        """Return its logarithm at one point, shape (3,)."""
        return float(self.process.logPosterior(np.exp(log_scales)) + log_scales.sum())

    def minus_log_density(self, log_scales: Array) -> float:
        """Return what is minimized to find the mode."""
        return -self.log_density(log_scales)

    def mode(self) -> Array:
        """Return the higher of the modes that are reached from both lengths, shape (3,)."""
        options = {"xatol": 0.02, "fatol": 0.02}
        searches = []
        for length in START_LENGTHS:
            start = np.log([length, 0.5, 0.3])
            searches.append(
                minimize(self.minus_log_density, start, method="Nelder-Mead", options=options)
            )
        depths = [search.fun for search in searches]
        return np.asarray(searches[int(np.argmin(depths))].x)

    def hessian(self, mode: Array) -> Array:
        """Return the second derivatives of the log density at the mode, shape (3, 3)."""
        step = HESSIAN_STEP * np.eye(3)
        second = np.empty((3, 3))
        for i in range(3):
            for j in range(3):
                second[i, j] = (
                    self.log_density(mode + step[i] + step[j])
                    - self.log_density(mode + step[i] - step[j])
                    - self.log_density(mode - step[i] + step[j])
                    + self.log_density(mode - step[i] - step[j])
                ) / HESSIAN_DIVISOR
        return second


def draw_scales(process: Any, seed: int) -> Array:
    """Return draws of length, variance of the discrepancy and noise, shape (draws, 3).

    They are resampled by importance from a normal proposal about the higher mode.
    """
    density = LogScaleDensity(process)
    mode = density.mode()
    curvature, directions = np.linalg.eigh(-density.hessian(mode))
    standard = multivariate_normal(np.zeros(3), seed=seed).rvs(SCALES_PROPOSED)
    white = PROPOSAL_WIDTH * standard
    root_curvature = np.sqrt(np.maximum(curvature, LEAST_CURVATURE))
    proposed = mode + white / root_curvature @ directions.T
    log_target = np.array([density.log_density(point) for point in proposed])
    log_weight = log_target + 0.5 * (white**2).sum(axis=1) / PROPOSAL_WIDTH**2
    cumulative = np.cumsum(np.exp(log_weight - log_weight.max()))
    levels = (np.arange(SCALES_RESAMPLED) + 0.5) / SCALES_RESAMPLED
    resampled = np.searchsorted(cumulative / cumulative[-1], levels)
    return np.exp(proposed[resampled])


class ConditionedProcess:
    """The posterior of θ and of new readings when the scales of the process are fixed."""

    def __init__(self, process: Any, linear: LinearPart, scales: Array) -> None:
        process.storePHE(scales)
        self.process = process
        self.linear = linear
        self.discrepancy_um2 = scales[1]
        self.noise_um2 = scales[2] ** 2
        covariance = (
            process.covd(process.xExp, process.xExp)
            + linear.columns @ linear.columns.T
            + self.noise_um2 * np.eye(process.nExp)
        )
        self.factor = cho_factor(covariance, lower=True)
        self.solved = cho_solve(self.factor, linear.readings.reading_um)

    def draw_parameters(self, count: int, rng: np.random.Generator) -> Array:
        """Return draws of θ, shape (count, p), in prior standard deviations."""
        jacobian = self.linear.readings.jacobian
        covariance = np.eye(jacobian.shape[1]) - jacobian.T @ cho_solve(self.factor, jacobian)
        mean = jacobian.T @ self.solved
        return np.asarray(rng.multivariate_normal(mean, covariance, count, method="eigh"))

    def predict(self, campaign: lb.Campaign, new: Readings, *, full: bool) -> Normals:
        """Return mean and standard deviation of new readings, each (n,) [µm]."""
        budget = new.budget(campaign, self.linear.theta, full=full)
        common = np.column_stack([new.jacobian, budget.shared])
        of_fitted_circles = self.linear.columns.shape[1] - common.shape[1]
        columns = np.column_stack([common, np.zeros((len(common), of_fitted_circles))])
        across = self.process.covd(self.process.xExp, new.coordinates())
        across = across + self.linear.columns @ columns.T
        prior_variance = (
            self.discrepancy_um2
            + (columns**2).sum(axis=1)
            + (budget.by_circle**2).sum(axis=1)
            + self.noise_um2
        )
        explained = (across * cho_solve(self.factor, across)).sum(axis=0)
        return Normals(across.T @ self.solved, np.sqrt(prior_variance - explained))


def by_gaussian_process(
    campaign: lb.Campaign,
    left_out: lb.CircularTest | None = None,
    *,
    seed: int,
    full: bool,
    count: int = READINGS_OF_A_CIRCLE,
) -> Answer:
    """Calibrate with ``count`` readings of every circle; the linear part and the three scales are
    integrated out."""
    prior_sd = MODEL.bind(campaign).prior_sd
    linear = linear_part(campaign, prior_sd, count, full=full)
    with tempfile.TemporaryDirectory() as folder, chdir(folder), redirect_stdout(io.StringIO()):
        process = calibrator(linear, integrated=True)
        draws_of_scales = draw_scales(process, seed)
    new = None
    if left_out is not None:
        new = readings_of(campaign, (left_out,), prior_sd, READINGS_OF_A_CIRCLE)
    draws_per_scale = DRAWS // SCALES_RESAMPLED
    rng = np.random.default_rng(seed)
    draws = []
    means_um = []
    sds_um = []
    for scales in draws_of_scales:
        conditioned = ConditionedProcess(process, linear, scales)
        draws.append(conditioned.draw_parameters(draws_per_scale, rng))
        if new is not None:
            component = conditioned.predict(campaign, new, full=full)
            means_um.append(component.mean_um)
            sds_um.append(component.sd_um)
    interval = np.quantile(np.concatenate(draws), LEVELS, axis=0) * prior_sd
    if new is None:
        return Answer(interval, None)
    components = Normals(np.array(means_um), np.array(sds_um))
    return Answer(interval, mixture_prediction(components, new.reading_um, draws_per_scale, rng))


@one_blas_thread
def as_it_stands(campaign: lb.Campaign, *, seed: int) -> dict[str, float]:
    """Return how ACBICI's own sampling of everything compares with what is integrated here.

    Both have the short budget; intervals and CPU times are compared.
    """
    prior_sd = MODEL.bind(campaign).prior_sd
    linear = linear_part(campaign, prior_sd, READINGS_SAMPLED, full=False)
    start = time.process_time()
    samples = _sampled_by_the_package(linear, seed) * prior_sd
    sampling_s = time.process_time() - start
    start = time.process_time()
    answer = by_gaussian_process(campaign, seed=seed, full=False, count=READINGS_SAMPLED)
    integration_s = time.process_time() - start
    low, high = answer.interval
    sampled_low, sampled_high = np.quantile(samples, LEVELS, axis=0)
    half_width = 0.5 * (high - low)
    middle_difference = 0.5 * (sampled_low + sampled_high) - 0.5 * (low + high)
    width_ratio = 0.5 * (sampled_high - sampled_low) / half_width
    return {
        "times": sampling_s / integration_s,
        "middle_apart": float(np.max(np.abs(middle_difference) / half_width)),
        "least_width": float(np.min(width_ratio)),
        "most_width": float(np.max(width_ratio)),
        "parameters": linear.columns.shape[1] + 3,
        "steps": STEPS,
        "walkers": WALKERS,
    }


def _sampled_by_the_package(linear: LinearPart, seed: int) -> Array:
    """Samples of θ by ACBICI's Markov chains, in prior standard deviations; it writes files and
    prints."""
    sink = io.StringIO()
    with (
        tempfile.TemporaryDirectory() as folder,
        chdir(folder),
        redirect_stdout(sink),
        redirect_stderr(sink),
    ):
        np.random.seed(seed)  # noqa: NPY002, the library draws from it
        process = calibrator(linear, integrated=False)
        process.mcmcCalibration(nsteps=STEPS, burn=BURN_IN, nwalkers=WALKERS)
        samples = np.load("d.out/samples.npy")
    parameters = linear.readings.jacobian.shape[1]
    return np.asarray(samples[:, :parameters])
