"""The methods side by side. Each is given a campaign and says 95 % intervals of the parameters and,
of a circle that is not among its tests, a 95 % band and the density of every reading.

    least squares      θ̂ = J⁺ y, u² by propagation: the scatter of the residuals (type A) and the
    budget (type B) Gaussian process   y = J θ + B b + d(angle, force) + ε, d a Gaussian process
    (Kennedy and O'Hagan 2001) ours               the default model, linear in force; and averaged
    over constant, linear and the rivals of slopes

J is the hybrid Jacobian (Eq. 33), B the budget: its short form has bar length, mount and force; its
full form everything that `lb.terms.uncertainties` states, ball form and angle among it, and how far
zero and centre move between circles. Ours and the Gaussian process have the same prior of θ. The
kernel and the density of the scales of d are those of ACBICI; the rest is linear, and is integrated
out here: `as_it_stands` compares that with the package's own sampling.
"""

from __future__ import annotations

import io
import itertools
import tempfile
import time
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize
from scipy.special import logsumexp
from scipy.stats import multivariate_normal, norm

import ldbb_bayes as lb
from ldbb_bayes.inference.circle_spread import draw_new_noise_factors
from ldbb_bayes.inference.coefficients import (
    draw_shared,
    machine_coefficients,
    private_terms,
    shared_columns,
)
from ldbb_bayes.inference.evidence import probabilities
from ldbb_bayes.inference.evidences import Evidences
from ldbb_bayes.inference.nodes import Nodes
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.parallel import one_blas_thread

Array = NDArray[np.float64]
MODEL = lb.HybridModel.default(1)
HAS_PACKAGE = find_spec("ACBICI") is not None
LEVELS = np.array([0.025, 0.975])
PICKED = 36  # readings of a circle that the Gaussian process is given, and that all methods predict
GEOMETRIC = 7
RANGE_N = 706.0  # geometric errors, the last columns of J; from the smallest force to the largest
DRAWS = 4000
NOISE_UM = 1.0
DISCREPANCY_UM2 = 100.0  # scales of the half-normal priors of σ and of the variance of d
SETUP_UM = MODEL.prior.delta_um  # of zero and centre from circle to circle
STEP_RAD = 1e-4
FEW = 12  # where the package samples everything
LENGTHS = (0.2, 1.0)  # where the search for the mode begins: it may have two
PROPOSED = 80
USED = 40
SPREAD = 1.3
LEAST_CURVATURE = 0.25
ALL_WALKERS = 72
ALL_STEPS = 3000
ALL_BURNT = 0.5


@dataclass(frozen=True, eq=False)
class Circle:
    """What a method says of a new circle: band (2, n) [µm] and log density of every reading (n,)
    [nat, per µm]."""

    band_um: Array
    log_density: Array


Said = tuple[
    Array, Circle | None
]  # intervals of the parameters, shape (2, p) [mm, N, rad], and of the new circle, if any


@dataclass(frozen=True, eq=False)
class Readings:
    """Readings (n,) [µm], where they were taken (n,) [rad], [N], [bar], in which test (n,), and J
    (n, p) [µm per prior sd] and its derivative along the angle."""

    reading: Array
    angle: Array
    force: Array
    pressure: Array
    test: NDArray[np.int64]
    jacobian: Array
    turning: Array

    def deflection(self, theta: Array) -> Array:
        """By the compliances and their slopes, the first columns, shape (n,) [µm]."""
        elastic = self.jacobian.shape[1] - GEOMETRIC
        return np.asarray(self.jacobian[:, :elastic] @ theta[:elastic])

    def budget(self, campaign: lb.Campaign, theta: Array, *, full: bool) -> tuple[Array, Array]:
        """What one standard uncertainty adds to the readings: of what all circles share (n, q), and
        of what each has for itself (n, k) [µm]. Circles that state no direction, and these all run
        the same way, lag as the angle's reference is off."""
        sd = {own.name: own.sd for own in lb.terms.uncertainties(campaign).assumed}
        deflection = self.deflection(theta)
        same = np.ones(len(deflection))
        softness = deflection / self.force
        largest = float(campaign.forces_N.max())
        shared = [
            1e3 * sd["bar_length"] * same,
            1e3 * sd["mount"] * self.pressure,
            sd["force_gain"] * deflection,
        ]
        own = [sd["force_random"] * softness]
        if full:
            bow = 4.0 * self.force / largest * (1.0 - self.force / largest)
            shared += [
                1e3 * sd["mount_curvature"] * bow,
                sd["force_curvature"] * largest * bow * softness,
            ]
            shared += [np.hypot(sd["angle_reference"], sd["angle_lag"]) * (self.turning @ theta)]
            form = {n: 1e3 * np.hypot(sd[f"work_form_{n}"], sd[f"tool_form_{n}"]) for n in (2, 3)}
            shared += [
                size * wave(n * self.angle) for n, size in form.items() for wave in (np.cos, np.sin)
            ]
            own += [SETUP_UM * each for each in (same, np.cos(self.angle), np.sin(self.angle))]
        return np.column_stack(shared), np.column_stack(own)

    def of_tests(self, own: Array) -> Array:
        """What each circle has for itself (n, k) as columns of all, shape (n, k · tests)."""
        its = self.test[:, None] == np.arange(self.test.max() + 1)
        return np.asarray((own[:, :, None] * its[:, None, :]).reshape(len(own), -1))

    def places(self) -> Array:
        """Where the Gaussian process sees them, shape (n, 3): on the unit circle, and the range of
        forces one radius long."""
        return np.column_stack([np.cos(self.angle), np.sin(self.angle), self.force / RANGE_N])


def picked(test: lb.CircularTest, count: int = PICKED) -> NDArray[np.int64]:
    """So many readings of a circle, evenly picked."""
    return np.arange(count) * len(test.angle_deg) // count


def readings_of(
    campaign: lb.Campaign,
    tests: tuple[lb.CircularTest, ...],
    scale: Array,
    count: int | None = None,
) -> Readings:
    """So many readings of each of these tests, or all; J for slopes about mid-range of the
    campaign's forces."""
    middle = 0.5 * float(campaign.forces_N.min() + campaign.forces_N.max())
    parts = []
    for k, test in enumerate(tests):
        index = np.arange(len(test.angle_deg)) if count is None else picked(test, count)
        angle = np.deg2rad(test.angle_deg[index])
        force = float(test.force_N or 0.0)
        pressure = (
            lb.campaign.ForceLaw().pressure_bar(force)
            if test.pressure_bar is None
            else test.pressure_bar
        )
        before, columns, after = (
            lb.machine.hybrid_jacobian(
                campaign.machine(), test.circle, at, force, degree=1, reference_force_N=middle
            ).to_numpy()
            for at in (angle - STEP_RAD, angle, angle + STEP_RAD)
        )
        same = np.ones(len(index))
        parts.append(
            (
                np.asarray(test.reading_um)[index],
                angle,
                force * same,
                pressure * same,
                np.full(len(index), k),
                columns * scale * 1e3,
                (after - before) / (2.0 * STEP_RAD) * scale * 1e3,
            )
        )
    return Readings(*map(np.concatenate, zip(*parts, strict=True)))


def by_least_squares(
    campaign: lb.Campaign, new: lb.CircularTest | None = None, *, full: bool
) -> Said:
    """Least squares of all readings on J, with the uncertainty that a budget after the GUM
    gives."""
    scale = MODEL.bind(campaign).prior_sd
    own = readings_of(campaign, campaign.tests, scale)
    inverse = np.linalg.pinv(own.jacobian, rcond=1e-12)
    theta = inverse @ own.reading
    variance = float(np.sum((own.reading - own.jacobian @ theta) ** 2)) / (
        len(own.reading) - len(theta)
    )
    shared, its_own = own.budget(campaign, theta, full=full)
    of_tests = own.of_tests(its_own)
    propagated = inverse @ np.column_stack([shared, of_tests])
    u = np.sqrt(variance * (inverse**2).sum(axis=1) + (propagated**2).sum(axis=1))
    interval = (theta + norm.ppf(LEVELS)[:, None] * u) * scale
    if new is None:
        return interval, None
    there = readings_of(campaign, (new,), scale, PICKED)
    added, anew = there.budget(campaign, theta, full=full)
    apart = there.jacobian @ propagated - np.column_stack(
        [added, np.zeros((len(added), of_tests.shape[1]))]
    )
    square = (
        variance * (1.0 + ((there.jacobian @ inverse) ** 2).sum(axis=1))
        + (apart**2).sum(axis=1)
        + (anew**2).sum(axis=1)
    )
    mean = there.jacobian @ theta
    sd = np.sqrt(square)
    return interval, Circle(
        mean + norm.ppf(LEVELS)[:, None] * sd, norm.logpdf(there.reading, mean, sd)
    )


@dataclass(frozen=True, eq=False)
class Linear:
    """What is linear in the model of the Gaussian process: readings, and columns (n, q) of unit
    prior sd, θ first [µm]."""

    readings: Readings
    columns: Array

    @classmethod
    def of(
        cls, campaign: lb.Campaign, scale: Array, count: int, *, full: bool
    ) -> tuple[Linear, Array]:
        """Of so many readings of each test; and the θ about which errors of force and angle are
        linear."""
        own = readings_of(campaign, campaign.tests, scale, count)
        theta = np.linalg.lstsq(own.jacobian, own.reading, rcond=1e-12)[0]
        shared, its_own = own.budget(campaign, theta, full=full)
        return cls(own, np.column_stack([own.jacobian, shared, own.of_tests(its_own)])), theta


def calibrator(linear: Linear, *, integrated: bool) -> Any:
    """ACBICI's calibrator with a Gaussian process as discrepancy; what is linear as parameters, or
    integrated out."""
    import ACBICI

    columns = linear.columns
    normal = ACBICI.Normal(mu=0.0, sigma=1.0)

    class Model(ACBICI.ACBICImodel):
        def __init__(self) -> None:
            self.xdim = 3
            self.ydim = 1
            for k in range(0 if integrated else columns.shape[1]):
                self.addParameter(label=f"t{k}", prior=normal)

        def symbolicModel(self, x: Array, t: Array) -> Array:
            return np.asarray(columns @ t[0])

    class Integrated(ACBICI.discrepancyCalibrator):
        def logLikelihood_vect(self) -> float:
            covariance = self.covd(self.xExp, self.xExp) + gram
            covariance[np.diag_indices_from(covariance)] += self.expSTD**2
            return float(
                self.gaussianLogLikelihood(self.yExp, np.zeros(len(covariance)), covariance)
            )

    gram = columns @ columns.T
    found = (Integrated if integrated else ACBICI.discrepancyCalibrator)(Model(), name="d")
    found.storeExperimentalData(
        np.column_stack([linear.readings.places(), linear.readings.reading])
    )
    found.setExperimentalSTDPrior(ACBICI.HalfNormal(mu=0.0, sigma=NOISE_UM))
    found.replaceHyperparameterPrior(
        label=r"$\lambda_d$", prior=ACBICI.HalfNormal(mu=0.0, sigma=DISCREPANCY_UM2)
    )
    found.setDefaultHyperparametersPriors()
    return found


def scales_of(found: Any, seed: int) -> Array:
    """Draws (n, 3) of the length, the variance of the discrepancy and the noise: importance
    resampling about the higher mode."""

    def log_density(u: Array) -> float:
        return float(found.logPosterior(np.exp(u)) + u.sum())

    starts = [np.log([length, 0.5, 0.3]) for length in LENGTHS]
    options = {"xatol": 0.02, "fatol": 0.02}
    found_modes = [
        minimize(lambda u: -log_density(u), start, method="Nelder-Mead", options=options)
        for start in starts
    ]
    mode = min(found_modes, key=lambda own: own.fun).x
    step = 0.1 * np.eye(3)
    each = range(3)
    four = ((1, 1), (1, -1), (-1, 1), (-1, -1))
    hessian = [
        [
            sum(a * b * log_density(mode + a * step[i] + b * step[j]) for a, b in four) / 0.04
            for j in each
        ]
        for i in each
    ]
    curvature, vectors = np.linalg.eigh(-np.array(hessian))
    white = SPREAD * multivariate_normal(np.zeros(3), seed=seed).rvs(PROPOSED)
    proposed = mode + white / np.sqrt(np.maximum(curvature, LEAST_CURVATURE)) @ vectors.T
    log_weight = (
        np.array([log_density(u) for u in proposed]) + 0.5 * (white**2).sum(axis=1) / SPREAD**2
    )
    share = np.cumsum(np.exp(log_weight - log_weight.max()))
    return np.exp(proposed[np.searchsorted(share / share[-1], (np.arange(USED) + 0.5) / USED)])


def by_process(
    campaign: lb.Campaign,
    new: lb.CircularTest | None = None,
    *,
    seed: int,
    full: bool,
    count: int = PICKED,
) -> Said:
    """Kennedy and O'Hagan's calibration: the linear part and the three scales integrated out."""
    scale = MODEL.bind(campaign).prior_sd
    linear, theta = Linear.of(campaign, scale, count, full=full)
    with tempfile.TemporaryDirectory() as folder, chdir(folder), redirect_stdout(io.StringIO()):
        found = calibrator(linear, integrated=True)
        chosen = scales_of(found, seed)
    there = None if new is None else readings_of(campaign, (new,), scale, PICKED)
    drawn = []
    circles = []
    each = DRAWS // USED
    p = len(scale)
    rng = np.random.default_rng(seed)
    for scales in chosen:
        found.storePHE(scales)
        covariance = (
            found.covd(found.xExp, found.xExp)
            + linear.columns @ linear.columns.T
            + scales[2] ** 2 * np.eye(found.nExp)
        )
        factor = cho_factor(covariance, lower=True)
        solved = cho_solve(factor, linear.readings.reading)
        parameters = linear.columns[:, :p]
        given = np.eye(p) - parameters.T @ cho_solve(factor, parameters)
        drawn.append(rng.multivariate_normal(parameters.T @ solved, given, each, method="eigh"))
        if there is not None:
            added, anew = there.budget(campaign, theta, full=full)
            known = np.column_stack([there.jacobian, added])
            columns = np.column_stack(
                [known, np.zeros((len(known), linear.columns.shape[1] - known.shape[1]))]
            )
            places = there.places()
            across = found.covd(found.xExp, places) + linear.columns @ columns.T
            prior = scales[1] + (columns**2).sum(axis=1) + (anew**2).sum(axis=1) + scales[2] ** 2
            circles.append(
                (
                    across.T @ solved,
                    np.sqrt(prior - (across * cho_solve(factor, across)).sum(axis=0)),
                )
            )
    interval = np.quantile(np.concatenate(drawn), LEVELS, axis=0) * scale
    if there is None:
        return interval, None
    mean, sd = (np.array(own) for own in zip(*circles, strict=True))
    return interval, _circle(mean, sd, there.reading, each, rng)


@one_blas_thread
def as_it_stands(campaign: lb.Campaign, *, seed: int) -> dict[str, float]:
    """ACBICI's own sampling of everything against what is integrated here, with the short budget:
    intervals, CPU time."""
    scale = MODEL.bind(campaign).prior_sd
    linear, _ = Linear.of(campaign, scale, FEW, full=False)
    start = time.process_time()
    sink = io.StringIO()
    with (
        tempfile.TemporaryDirectory() as folder,
        chdir(folder),
        redirect_stdout(sink),
        redirect_stderr(sink),
    ):
        np.random.seed(seed)  # noqa: NPY002, the library draws from it
        found = calibrator(linear, integrated=False)
        found.mcmcCalibration(nsteps=ALL_STEPS, burn=ALL_BURNT, nwalkers=ALL_WALKERS)
        chain = np.load("d.out/samples.npy")[:, : len(scale)] * scale
    taken = time.process_time() - start
    start = time.process_time()
    low, high = by_process(campaign, seed=seed, full=False, count=FEW)[0]
    alone = time.process_time() - start
    middle = 0.5 * (low + high)
    half = 0.5 * (high - low)
    lowest, highest = np.quantile(chain, LEVELS, axis=0)
    return {
        "times": taken / alone,
        "middle_apart": float(np.max(np.abs(0.5 * (lowest + highest) - middle) / half)),
        "least_width": float(np.min(0.5 * (highest - lowest) / half)),
        "most_width": float(np.max(0.5 * (highest - lowest) / half)),
        "parameters": linear.columns.shape[1] + 3,
        "steps": ALL_STEPS,
        "walkers": ALL_WALKERS,
    }


def _circle(mean: Array, sd: Array, reading: Array, each: int, rng: np.random.Generator) -> Circle:
    """Of a mixture of normal distributions, shape (draws, n), of each reading."""
    drawn = np.concatenate([mean + sd * rng.standard_normal(mean.shape) for _ in range(each)])
    density = logsumexp(norm.logpdf(reading, mean, sd), axis=0) - np.log(len(mean))
    return Circle(np.quantile(drawn, LEVELS, axis=0), density)


def linear(campaign: lb.Campaign, new: lb.CircularTest | None = None, *, seed: int) -> Said:
    """The default model."""
    return _ours((MODEL,), campaign, new, seed)


def averaged(campaign: lb.Campaign, new: lb.CircularTest | None = None, *, seed: int) -> Said:
    """Averaged over constant and linear compliance, with and without each rival of slopes, as
    `lb.average` does."""
    kinds = [
        model.with_rivals(*itertools.compress(model.rivals, there))
        for model in (MODEL.with_degree(0), MODEL)
        for there in itertools.product((True, False), repeat=len(model.rivals))
    ]
    return _ours(tuple(kinds), campaign, new, seed)


def _ours(
    models: tuple[lb.HybridModel, ...],
    campaign: lb.Campaign,
    new: lb.CircularTest | None,
    seed: int,
) -> Said:
    """Independent draws of each model as its posterior probability says."""
    weighed = Evidences(campaign).of(*models)
    rng = np.random.default_rng(seed)
    names = MODEL.bind(campaign).names
    counts = rng.multinomial(
        DRAWS, probabilities(np.array([nodes.evidence.log_value for nodes in weighed]))
    )
    drawn = []
    circles = []
    for nodes, count in zip(weighed, counts.tolist(), strict=True):
        if count:
            beta, phi = nodes.draw(count, rng)
            full = np.zeros((count, len(names)))
            full[:, [names.index(name) for name in nodes.bound.names]] = beta
            drawn.append(full)
            circles += [] if new is None else [_new_circle(nodes, campaign, new, beta, phi, rng)]
    interval = np.quantile(np.concatenate(drawn), LEVELS, axis=0)
    if new is None:
        return interval, None
    mean, sd = (np.concatenate(own) for own in zip(*circles, strict=True))
    return interval, _circle(mean, sd, np.asarray(new.reading_um)[picked(new)], 1, rng)


def _new_circle(
    nodes: Nodes,
    campaign: lb.Campaign,
    new: lb.CircularTest,
    beta: Array,
    phi: Array,
    rng: np.random.Generator,
) -> tuple[Array, Array]:
    """Mean and sd of every picked reading of the new circle, each (draws, n) [µm], given β, φ and
    shared nuisances drawn."""
    bound = BoundModel(
        nodes.bound.model, replace(campaign, tests=(*campaign.tests, new)), pilot=campaign
    )
    hyper = bound.hyper_prior
    known = nodes.bound.hyper_prior.names
    scales = hyper.quantile(rng.random((len(phi), len(hyper.names))))
    scales[:, [hyper.names.index(name) for name in known]] = phi
    factors = [known.index(str(name)) for name in nodes.bound.setting.circle if name in known]
    if factors:
        new_factor = hyper.names.index(str(bound.setting.circle[-1]))
        scales[:, new_factor] = draw_new_noise_factors(phi[:, factors], rng)
    angle = np.deg2rad(new.angle_deg[picked(new)])
    turned = basis(angle) * 1e3
    shared = draw_shared(nodes.bound, phi, beta, rng)
    mean = (
        machine_coefficients(bound, beta)[:, -1] + shared @ shared_columns(bound)[-1].T
    ) @ turned.T
    square = (scales[:, [hyper.names.index("sigma")]] * 1e3) ** 2
    for columns, sd in private_terms(bound, scales, len(campaign.tests)):
        square = square + sd**2 @ ((turned @ columns) ** 2).T
    return mean, np.sqrt(square)
