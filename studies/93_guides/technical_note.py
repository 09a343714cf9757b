"""Examples of NIST Technical Note 1900: measurement models with normal and other inputs."""

from __future__ import annotations

import numpy as np
from figures import Figure
from propagation import Distribution, propagate_distributions, propagate_linearly
from scipy import stats

from ldbb_bayes.results import Array
from ldbb_bayes.units import round_uncertainty

__all__ = ["figures"]

TECHNICAL_NOTE = "NIST TN 1900"
DRAWS = 1_000_000
PROB = 0.95

# E3, falling-ball viscometer: estimates and standard uncertainties of the viscosity of the
# calibration liquid [mPa s], of both fall times [s], and of the densities of ball, liquid and
# calibration liquid [kg/m³].
VISCOMETER = (
    (4.63, 0.0463),
    (61.0, 6.1),
    (36.6, 5.49),
    (2217.0, 0.5),
    (1180.0, 0.5),
    (810.0, 0.5),
)
# E13, thermal expansion: both lengths [m] and temperatures [K], each with t distribution of three
# degrees of freedom.
EXPANSION = ((1.4999, 0.0001), (1.5021, 0.0002), (288.15, 0.02), (373.10, 0.05))
EXPANSION_DEGREES_OF_FREEDOM = 3


def figures() -> list[Figure]:
    """Return the figures of NIST TN 1900 that are computed here."""
    rng = np.random.default_rng(1)
    return [*_viscometer(rng), *_attenuator(rng), *_expansion(rng)]


def _row(
    example: str, quantity: str, printed: str, computed: float, output: Distribution, unit: str
) -> Figure:
    """Return a figure that the note drew at random, with its numerical tolerance."""
    _, decimals = round_uncertainty(output.u, 2)
    tolerance = 0.5 * 10.0**-decimals
    return Figure(TECHNICAL_NOTE, example, quantity, printed, computed, unit, tolerance=tolerance)


def _viscometer(rng: np.random.Generator) -> list[Figure]:
    """Return the figures of E3: viscosity of a sodium hydroxide solution."""
    means = np.array([mean for mean, _ in VISCOMETER])
    u = np.array([sd for _, sd in VISCOMETER])
    viscosity = propagate_distributions(_viscosity(rng.normal(means, u, (DRAWS, len(u))))[:, 0])
    low, high = viscosity.symmetric(PROB)
    by_gum = propagate_linearly(_viscosity, means, u**2)
    example = "E3 viscometer"
    return [
        _row(example, "viscosity", "5.82", viscosity.mean, viscosity, "mPa s"),
        _row(example, "u", "1.11", viscosity.u, viscosity, "mPa s"),
        _row(example, "lower end", "4.05", low, viscosity, "mPa s"),
        _row(example, "upper end", "8.39", high, viscosity, "mPa s"),
        Figure(
            TECHNICAL_NOTE,
            example,
            "viscosity by the GUM",
            "5.69",
            float(by_gum.estimate[0]),
            "mPa s",
        ),
    ]


def _viscosity(inputs: Array) -> Array:
    """Return the viscosity of a liquid from two fall times of one ball [mPa s]."""
    calibration, time, calibration_time, ball, liquid, calibration_liquid = np.moveaxis(
        inputs, -1, 0
    )
    buoyancy = (ball - liquid) / (ball - calibration_liquid)
    return np.asarray((calibration * buoyancy * time / calibration_time)[..., np.newaxis])


def _attenuator(rng: np.random.Generator) -> list[Figure]:
    """Return the figures of E11: attenuation of a microwave step attenuator [dB]."""
    attenuation = propagate_distributions(
        30.0402
        + _scaled_t(rng, 0.0091)
        + 0.0030
        + _uniform(rng, 0.0025)
        + _uniform(rng, 0.0003)
        - _uniform(rng, 0.0003)
        + rng.normal(0.0, 0.0020, DRAWS)
        - rng.normal(0.0, 0.0020, DRAWS)
        + _arcsine(rng, 0.0200)
        + _arcsine(rng, 0.0014)
        + _arcsine(rng, 0.0021)
    )
    low, high = attenuation.symmetric(PROB)
    example = "E11 step attenuator"
    return [
        _row(example, "attenuation", "30.043", attenuation.mean, attenuation, "dB"),
        _row(example, "u", "0.0224", attenuation.u, attenuation, "dB"),
        _row(example, "lower end", "30.006", low, attenuation, "dB"),
        _row(example, "upper end", "30.081", high, attenuation, "dB"),
    ]


def _expansion(rng: np.random.Generator) -> list[Figure]:
    """Return the figures of E13: thermal expansion coefficient of copper [1e-5 1/K]."""
    means = np.array([mean for mean, _ in EXPANSION])
    u = np.array([sd for _, sd in EXPANSION])
    inputs = np.stack(
        [mean + _scaled_t(rng, sd) for mean, sd in EXPANSION],
        axis=-1,
    )
    coefficient = propagate_distributions(_expansion_coefficient(inputs)[:, 0])
    by_gum = propagate_linearly(_expansion_coefficient, means, u**2)
    example = "E13 thermal expansion"
    return [
        _row(example, "coefficient", "1.727", coefficient.mean, coefficient, "1e-5/K"),
        _row(example, "u", "0.174", coefficient.u, coefficient, "1e-5/K"),
        Figure(
            TECHNICAL_NOTE,
            example,
            "coefficient by the GUM",
            "1.7266",
            float(by_gum.estimate[0]),
            "1e-5/K",
        ),
        Figure(TECHNICAL_NOTE, example, "u by the GUM", "0.176", float(by_gum.u[0]), "1e-5/K"),
    ]


def _expansion_coefficient(inputs: Array) -> Array:
    """Return a thermal expansion coefficient from two lengths at two temperatures [1e-5 1/K]."""
    length, longer, temperature, higher = np.moveaxis(inputs, -1, 0)
    coefficient = (longer - length) / (length * (higher - temperature))
    return np.asarray((coefficient * 1e5)[..., np.newaxis])


def _scaled_t(rng: np.random.Generator, u: float) -> Array:
    """Return draws of a t distribution with three degrees of freedom and standard deviation u."""
    scale = u / stats.t(EXPANSION_DEGREES_OF_FREEDOM).std()
    return np.asarray(scale * rng.standard_t(EXPANSION_DEGREES_OF_FREEDOM, DRAWS))


def _uniform(rng: np.random.Generator, u: float) -> Array:
    """Return draws of a uniform distribution with mean zero and standard deviation u."""
    half_width = np.sqrt(3.0) * u
    return rng.uniform(-half_width, half_width, DRAWS)


def _arcsine(rng: np.random.Generator, u: float) -> Array:
    """Return draws of an arcsine distribution with mean zero and standard deviation u."""
    return np.asarray(np.sqrt(2.0) * u * np.sin(rng.uniform(0.0, 2.0 * np.pi, DRAWS)))
