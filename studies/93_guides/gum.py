"""Annex H of the GUM (JCGM 100:2008): its examples by the kernel of the package.

Inputs are those that the annex prints; lengths are in nm where nothing else is said.
"""

from __future__ import annotations

import numpy as np
from figures import Figure
from propagation import propagate_linearly
from scipy import stats

from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.results import Array

__all__ = ["figures"]

GUIDE = "JCGM 100"

# H.1: length of an end gauge of nominally 50 mm.
STANDARD_NM = 50_000_623.0
COMPARATOR_NM = 215.0
# Standard uncertainties of the length of the standard and of the three parts of the comparison.
U_STANDARD_NM = 25.0
U_COMPARATOR_NM = (5.8, 3.9, 6.7)
THERMAL_EXPANSION = 11.5e-6
TEMPERATURE_DEVIATION = -0.1
U_TEMPERATURE_DEVIATION = 0.41
# Half widths of the uniform distributions of the expansion coefficient, of the difference of the
# coefficients and of the difference of the temperatures.
HALF_WIDTH_EXPANSION = 2e-6
HALF_WIDTH_EXPANSION_DIFFERENCE = 1e-6
HALF_WIDTH_TEMPERATURE_DIFFERENCE = 0.05
# Degrees of freedom of the six inputs; infinite where the annex states none.
DEGREES_OF_FREEDOM = (18.0, 25.6, 50.0, np.inf, np.inf, 2.0)

# H.2: voltage [V], current [mA] and phase [rad] of a circuit element, measured five times.
VOLTAGE = (5.007, 4.994, 5.005, 4.990, 4.999)
CURRENT = (19.663, 19.639, 19.640, 19.685, 19.678)
PHASE = (1.0456, 1.0438, 1.0468, 1.0428, 1.0433)

# H.3: readings of a thermometer and their corrections [°C].
READING = (21.521, 22.012, 22.512, 23.003, 23.507, 23.999, 24.513, 25.002, 25.503, 26.010, 26.511)
CORRECTION = (-0.171, -0.169, -0.166, -0.159, -0.164, -0.165, -0.156, -0.157, -0.159, -0.161, -0.16)
REFERENCE_TEMPERATURE = 20.0

# H.4: times [min] and counts of a standard, a blank and a sample in six cycles of 60 minutes.
STANDARD_MIN = (243.74, 984.53, 1723.87, 2463.17, 3217.56, 3956.83)
STANDARD_COUNTS = (15380, 14978, 14394, 13254, 12516, 11058)
BLANK_COUNTS = (4054, 3922, 4200, 3830, 3956, 3980)
SAMPLE_MIN = (367.37, 1107.66, 1846.99, 2586.28, 3340.68, 4079.94)
SAMPLE_COUNTS = (41432, 38706, 35860, 32238, 29640, 26356)
COUNTING_MIN = 60.0
DECAY_PER_MIN = 1.25894e-4
STANDARD_ACTIVITY_BQ_PER_G = (0.1368, 0.0018)
STANDARD_MASS_G = (5.0192, 0.005)
SAMPLE_MASS_G = (5.0571, 0.001)

# H.5: means of five readings of a Zener voltage on ten days [V].
DAILY_MEANS_V = (
    10.000172,
    10.000116,
    10.000013,
    10.000144,
    10.000106,
    10.000031,
    10.000060,
    10.000125,
    10.000163,
    10.000041,
)
DAILY_SD_UV = (60.0, 77.0, 111.0, 101.0, 67.0, 93.0, 80.0, 73.0, 88.0, 86.0)
READINGS_A_DAY = 5

# H.6: hardness of a block on the scale Rockwell C, in units of the scale. The hardness is 100 units
# minus the mean depth of five indentations; DEPTH is what the printed hardness leaves.
SCALE_UNIT_MM = 0.002
FULL_SCALE = 100.0
PRINTED_HARDNESS = 64.0
DEPTH = FULL_SCALE - PRINTED_HARDNESS
# Standard uncertainties of the three contributions that the annex states: repeatability of the mean
# depth, unequal hardness of the transfer block, and the national standard with the definition of
# hardness. Those of the resolution and of the comparison of both machines are smaller.
U_HARDNESS = (0.20, 0.11, 0.5)


def figures() -> list[Figure]:
    """Return the figures of examples H.1 to H.6."""
    return [
        *_end_gauge(),
        *_impedance(),
        *_thermometer(),
        *_activity(),
        *_zener(),
        *_hardness(),
    ]


def _end_gauge() -> list[Figure]:
    """Return the figures of H.1, with the contributions of the inputs."""
    estimate = np.array(
        [STANDARD_NM, COMPARATOR_NM, 0.0, TEMPERATURE_DEVIATION, THERMAL_EXPANSION, 0.0]
    )
    u = np.array(
        [
            U_STANDARD_NM,
            np.linalg.norm(U_COMPARATOR_NM),
            HALF_WIDTH_EXPANSION_DIFFERENCE / np.sqrt(3.0),
            U_TEMPERATURE_DEVIATION,
            HALF_WIDTH_EXPANSION / np.sqrt(3.0),
            HALF_WIDTH_TEMPERATURE_DIFFERENCE / np.sqrt(3.0),
        ]
    )
    length = propagate_linearly(_end_gauge_length, estimate, u**2)
    contributions = np.abs(length.contributions[0])
    total = length.u[0]
    effective = total**4 / (contributions**4 / np.array(DEGREES_OF_FREEDOM)).sum()
    expanded = stats.t.ppf(0.995, np.floor(effective)) * total
    # Second-order terms of H.1.7: products of two inputs that are both zero or nearly so.
    second_order = STANDARD_NM * np.array([u[2] * u[3], u[4] * u[5]])
    with_second_order = np.hypot(total, np.linalg.norm(second_order))
    example = "H.1 end gauge"
    return [
        Figure(GUIDE, example, "length", "50000838", float(length.estimate[0]), "nm"),
        Figure(GUIDE, example, "u from the standard", "25", float(contributions[0]), "nm"),
        Figure(GUIDE, example, "u from the comparator", "9.7", float(contributions[1]), "nm"),
        Figure(GUIDE, example, "u from the expansion", "2.9", float(contributions[2]), "nm"),
        Figure(GUIDE, example, "u from the temperature", "16.6", float(contributions[5]), "nm"),
        Figure(GUIDE, example, "combined u", "32", float(total), "nm"),
        Figure(GUIDE, example, "effective degrees of freedom", "16", float(np.floor(effective))),
        Figure(
            GUIDE,
            example,
            "U (99 %)",
            "93",
            float(expanded),
            "nm",
            reason="the annex multiplies u rounded to 32 nm by 2.92; unrounded it is 92.5 nm",
        ),
        Figure(GUIDE, example, "u with second order", "34", float(with_second_order), "nm"),
    ]


def _end_gauge_length(inputs: Array) -> Array:
    """Return the length of an end gauge (Eq. H.3) from its six input quantities [nm]."""
    standard, comparator, expansion_difference, deviation, expansion, temperature_difference = (
        np.moveaxis(inputs, -1, 0)
    )
    thermal = expansion_difference * deviation + expansion * temperature_difference
    return (standard + comparator - standard * thermal)[..., np.newaxis]


def _impedance() -> list[Figure]:
    """Return the figures of H.2: from means with their covariances, and set by set."""
    readings = np.array([VOLTAGE, np.array(CURRENT) * 1e-3, PHASE])
    covariance = np.cov(readings) / readings.shape[1]
    u = np.sqrt(np.diag(covariance))
    correlation = np.corrcoef(readings)
    impedance = propagate_linearly(_impedance_of, readings.mean(axis=1), covariance)
    outputs = zip(("R", "X", "Z"), ("127.732", "219.847", "254.260"), strict=True)
    printed_u = ("0.071", "0.295", "0.236")
    example = "H.2 impedance"
    rows = [
        Figure(GUIDE, example, "u of the voltage", "0.0032", float(u[0]), "V"),
        Figure(GUIDE, example, "u of the current", "0.0095", float(u[1] * 1e3), "mA"),
        Figure(GUIDE, example, "u of the phase", "0.00075", float(u[2]), "rad"),
        Figure(GUIDE, example, "r(V, I)", "-0.36", float(correlation[0, 1])),
        Figure(GUIDE, example, "r(V, φ)", "0.86", float(correlation[0, 2])),
        Figure(GUIDE, example, "r(I, φ)", "-0.65", float(correlation[1, 2])),
    ]
    for k, (name, printed) in enumerate(outputs):
        estimate = float(impedance.estimate[k])
        rows.append(Figure(GUIDE, example, name, printed, estimate, "Ω"))
        rows.append(
            Figure(
                GUIDE,
                example,
                f"u of {name}",
                printed_u[k],
                float(impedance.u[k]),
                "Ω",
                reason="by the second approach of the annex, below, it is 0.29549 Ω",
            )
        )
    by_set = _impedance_of(readings.T)
    u_by_set = by_set.std(axis=0, ddof=1) / np.sqrt(len(by_set))
    for k, name in enumerate(("R", "X", "Z")):
        quantity = f"u of {name}, second approach"
        rows.append(Figure(GUIDE, example, quantity, printed_u[k], float(u_by_set[k]), "Ω"))
    rows += [
        Figure(GUIDE, example, "r(R, X)", "-0.588", float(impedance.correlation[0, 1])),
        Figure(GUIDE, example, "r(R, Z)", "-0.485", float(impedance.correlation[0, 2])),
        Figure(GUIDE, example, "r(X, Z)", "0.993", float(impedance.correlation[1, 2])),
    ]
    return rows


def _impedance_of(inputs: Array) -> Array:
    """Return resistance, reactance and impedance [Ω] from voltage, current and phase (Eq. H.7)."""
    voltage, current, phase = np.moveaxis(inputs, -1, 0)
    impedance = voltage / current
    return np.stack([impedance * np.cos(phase), impedance * np.sin(phase), impedance], axis=-1)


def _thermometer() -> list[Figure]:
    """Return the figures of H.3: a straight line by least squares, and its value at 30 °C."""
    temperature = np.array(READING) - REFERENCE_TEMPERATURE
    rows = np.stack([np.ones(len(temperature)), temperature], axis=1)
    line = Gaussian.from_rows(rows, np.array(CORRECTION))
    residual = np.array(CORRECTION) - rows @ line.mean
    scatter = float(np.sqrt((residual**2).sum() / (len(residual) - 2)))
    correlation = line.covariance[0, 1] / line.sd.prod()
    at_30 = np.array([[1.0, 10.0]])
    example = "H.3 thermometer"
    return [
        Figure(GUIDE, example, "intercept", "-0.1712", float(line.mean[0]), "°C"),
        Figure(GUIDE, example, "u of the intercept", "0.0029", float(line.sd[0] * scatter), "°C"),
        Figure(GUIDE, example, "slope", "0.00218", float(line.mean[1])),
        Figure(GUIDE, example, "u of the slope", "0.00067", float(line.sd[1] * scatter)),
        Figure(GUIDE, example, "r(intercept, slope)", "-0.930", float(correlation)),
        Figure(GUIDE, example, "s of the residuals", "0.0035", scatter, "°C"),
        Figure(
            GUIDE, example, "correction at 30 °C", "-0.1494", float((at_30 @ line.mean)[0]), "°C"
        ),
        Figure(
            GUIDE,
            example,
            "u of the correction",
            "0.0041",
            float(np.linalg.norm(line.spread(at_30)) * scatter),
            "°C",
        ),
    ]


def _activity() -> list[Figure]:
    """Return the figures of H.4, by both approaches of the annex."""
    blank = np.array(BLANK_COUNTS)
    standard = _counts_per_minute(STANDARD_COUNTS, blank, STANDARD_MIN)
    sample = _counts_per_minute(SAMPLE_COUNTS, blank, SAMPLE_MIN)
    cycles = len(blank)
    covariance = np.cov(sample, standard) / cycles
    means = np.array([sample.mean(), standard.mean()])
    of_means = propagate_linearly(_ratio, means, covariance)
    ratios = sample / standard
    ratio_u = float(ratios.std(ddof=1) / np.sqrt(cycles))
    by_means = _activity_of_sample(float(of_means.estimate[0]), float(of_means.u[0]))
    by_ratios = _activity_of_sample(float(ratios.mean()), ratio_u)
    example = "H.4 activity"
    r = float(covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1]))
    return [
        Figure(GUIDE, example, "rate of the sample", "652.60", float(means[0]), "1/min"),
        Figure(GUIDE, example, "its u", "6.42", float(np.sqrt(covariance[0, 0])), "1/min"),
        Figure(GUIDE, example, "rate of the standard", "206.09", float(means[1]), "1/min"),
        Figure(GUIDE, example, "its u", "3.79", float(np.sqrt(covariance[1, 1])), "1/min"),
        Figure(GUIDE, example, "r of the rates", "0.646", r),
        Figure(GUIDE, example, "ratio of the means", "3.167", float(of_means.estimate[0])),
        Figure(GUIDE, example, "its u", "0.045", float(of_means.u[0])),
        Figure(GUIDE, example, "mean of the ratios", "3.170", float(ratios.mean())),
        Figure(GUIDE, example, "its u", "0.046", ratio_u),
        Figure(
            GUIDE,
            example,
            "activity, approach 1",
            "0.4300",
            by_means[0],
            "Bq/g",
            reason="the annex goes on with the ratio rounded to 3.167; unrounded it is 3.1666",
        ),
        Figure(GUIDE, example, "its u", "0.0083", by_means[1], "Bq/g"),
        Figure(GUIDE, example, "activity, approach 2", "0.4304", by_ratios[0], "Bq/g"),
        Figure(GUIDE, example, "its u", "0.0084", by_ratios[1], "Bq/g"),
    ]


def _counts_per_minute(counts: tuple[int, ...], blank: Array, minutes: tuple[float, ...]) -> Array:
    """Return counting rates at the reference time, with the background subtracted [1/min]."""
    decay = np.exp(DECAY_PER_MIN * np.array(minutes))
    return (np.array(counts) - blank) / COUNTING_MIN * decay


def _ratio(rates: Array) -> Array:
    """Return the ratio of two rates."""
    return rates[..., :1] / rates[..., 1:]


def _activity_of_sample(ratio: float, ratio_u: float) -> tuple[float, float]:
    """Return the activity of the sample and its standard uncertainty [Bq/g] (Eq. H.21)."""
    inputs = (STANDARD_ACTIVITY_BQ_PER_G, STANDARD_MASS_G, SAMPLE_MASS_G, (ratio, ratio_u))
    estimate = np.array([value for value, _ in inputs])
    u = np.array([uncertainty for _, uncertainty in inputs])
    activity = propagate_linearly(_activity_model, estimate, u**2)
    return float(activity.estimate[0]), float(activity.u[0])


def _activity_model(inputs: Array) -> Array:
    """Return the activity of the sample from that of the standard, both masses and the ratio."""
    activity, standard_mass, sample_mass, ratio = np.moveaxis(inputs, -1, 0)
    return (activity * standard_mass / sample_mass * ratio)[..., np.newaxis]


def _zener() -> list[Figure]:
    """Return the figures of H.5: an analysis of variance between and within days."""
    means = np.array(DAILY_MEANS_V)
    days = len(means)
    sd_of_means_uv = float(means.std(ddof=1) * 1e6)
    between_uv = float(np.sqrt(READINGS_A_DAY) * sd_of_means_uv)
    within_uv = float(np.sqrt((np.array(DAILY_SD_UV) ** 2).mean()))
    mean = Gaussian.from_rows(
        np.ones((days, 1)) / (sd_of_means_uv * 1e-6), means / (sd_of_means_uv * 1e-6)
    )
    # If the day has no effect, all readings scatter alike; their degrees of freedom are pooled.
    readings = days * READINGS_A_DAY
    pooled_uv = np.sqrt(
        ((days - 1) * between_uv**2 + (readings - days) * within_uv**2) / (readings - 1)
    )
    same_day = Gaussian.from_rows(np.ones((readings, 1)) / pooled_uv, np.zeros(readings))
    example = "H.5 Zener voltage"
    return [
        Figure(GUIDE, example, "mean", "10.000097", float(mean.mean[0]), "V"),
        Figure(GUIDE, example, "s of the daily means", "57", sd_of_means_uv, "µV"),
        Figure(GUIDE, example, "s between days", "128", between_uv, "µV"),
        Figure(GUIDE, example, "s within days", "85", within_uv, "µV"),
        Figure(
            GUIDE,
            example,
            "F",
            "2.25",
            (between_uv / within_uv) ** 2,
            reason="the annex divides numbers rounded to 57 µV and 85 µV",
        ),
        Figure(GUIDE, example, "u of the mean", "18", float(mean.sd[0] * 1e6), "µV"),
        Figure(
            GUIDE,
            example,
            "u of the mean without effect of the day",
            "13",
            float(same_day.sd[0]),
            "µV",
        ),
    ]


def _hardness() -> list[Figure]:
    """Return the figures of H.6: the hardness of a block by a calibrated machine."""
    inputs = np.array([DEPTH, 0.0, 0.0])
    hardness = propagate_linearly(_hardness_of, inputs, np.square(U_HARDNESS))
    u = float(hardness.u[0])
    example = "H.6 hardness"
    return [
        Figure(
            GUIDE,
            example,
            "hardness",
            "0.1280",
            float(hardness.estimate[0]) * SCALE_UNIT_MM,
            "mm",
        ),
        Figure(GUIDE, example, "combined u", "0.55", u, "HRC"),
        Figure(GUIDE, example, "combined u", "0.0011", u * SCALE_UNIT_MM, "mm"),
    ]


def _hardness_of(inputs: Array) -> Array:
    """Return the hardness (Eq. H.33a) from the mean depth and two corrections of zero [HRC]."""
    return FULL_SCALE - inputs.sum(axis=-1, keepdims=True)
