"""Examples of the supplements to the GUM (JCGM 101 and 102): propagation of distributions.

The guides drew their own figures at random, so that these are known to the numerical tolerance of
JCGM 101, 7.9.2 only. Intervals are of 95 %, probabilistically symmetric where nothing else is said.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from figures import Figure
from propagation import Distribution, propagate_distributions, propagate_linearly
from scipy import stats

from ldbb_bayes.results import Array
from ldbb_bayes.units import round_uncertainty

__all__ = ["figures"]

SUPPLEMENT_1 = "JCGM 101"
SUPPLEMENT_2 = "JCGM 102"
DRAWS = 1_000_000
PROB = 0.95
# Half width of a uniform distribution of standard deviation one.
UNIT_UNIFORM = float(np.sqrt(3.0))

# 9.3: mass of a weight [g], compared with a reference weight in air; densities in kg/m³.
NOMINAL_MASS_MG = 100_000.0
REFERENCE_MASS_MG = (100_000.0, 0.050)
MASS_DIFFERENCE_MG = (1.234, 0.020)
AIR_DENSITY = (1.10, 1.30)
WEIGHT_DENSITY = (7000.0, 9000.0)
REFERENCE_DENSITY = (7950.0, 8050.0)
CONVENTIONAL_AIR_DENSITY = 1.2

# 9.4: comparison loss of a power meter, x₁² + x₂², printed in units of 1e-6.
U_REFLECTION = 0.005
LOSS_UNIT = 1e-6
CORRELATION_REFLECTION = 0.9

# 9.5: the end gauge of H.1 with the distributions of Table 10 [nm].
NOMINAL_LENGTH_NM = 50_000_000.0

# JCGM 102, 9.3: real and imaginary part of a complex quantity, each with this u.
U_COMPLEX = 0.010
POLAR_NAMES = ("magnitude", "phase")


@dataclass(frozen=True)
class _PolarCase:
    """A complex quantity, and what JCGM 102 prints of its magnitude and phase.

    ``by_draws`` and ``by_gum`` are estimate and u of the magnitude, then of the phase.
    """

    real: str  #: estimate of the real part; that of the imaginary part is zero
    correlation: float  #: correlation of the two parts
    by_draws: tuple[str, ...]  #: figures by random draws
    by_gum: tuple[str, ...]  #: figures by the law of propagation of uncertainty

    @property
    def example(self) -> str:
        """Name of the example."""
        return f"9.3 magnitude and phase, x₁ = {self.real}, r = {self.correlation}"

    @property
    def mean(self) -> Array:
        """Estimates of the two parts."""
        return np.array([float(self.real), 0.0])

    @property
    def covariance(self) -> Array:
        """Covariance matrix of the two parts."""
        return U_COMPLEX**2 * np.array([[1.0, self.correlation], [self.correlation, 1.0]])


POLAR_CASES = (
    _PolarCase(
        real="0.001",
        correlation=0.0,
        by_draws=("0.013", "0.007", "0.000", "1.744"),
        by_gum=("0.001", "0.010", "0.000", "10.000"),
    ),
    _PolarCase(
        real="0.001",
        correlation=0.9,
        by_draws=("0.012", "0.008", "-0.556", "1.599"),
        by_gum=("0.001", "0.010", "0.000", "10.000"),
    ),
    _PolarCase(
        real="0.010",
        correlation=0.9,
        by_draws=("0.015", "0.008", "-0.343", "0.903"),
        by_gum=("0.010", "0.010", "0.000", "1.000"),
    ),
)


def figures() -> list[Figure]:
    """Return the figures of all examples of the supplements that are computed here."""
    rng = np.random.default_rng(1)
    return [
        *_additive(rng),
        *_mass(rng),
        *_comparison_loss(),
        *_end_gauge(rng),
        *_sum_of_two(rng),
        *_polar(rng),
        *_correlated_loss(rng),
    ]


def _tolerance(u: float) -> float:
    """Return half a unit in the second significant digit of a standard uncertainty."""
    _, decimals = round_uncertainty(u, 2)
    return 0.5 * 10.0**-decimals


def _row(
    guide: str,
    example: str,
    quantity: str,
    printed: str,
    computed: float,
    output: Distribution,
    unit: str,
) -> Figure:
    """Return a figure that the guide drew at random, with its numerical tolerance."""
    return Figure(guide, example, quantity, printed, computed, unit, tolerance=_tolerance(output.u))


def _additive(rng: np.random.Generator) -> list[Figure]:
    """Return the figures of 9.2: sums of four normal or four uniform quantities."""
    normal = propagate_distributions(rng.standard_normal((DRAWS, 4)).sum(axis=1))
    uniform = rng.uniform(-UNIT_UNIFORM, UNIT_UNIFORM, (DRAWS, 4))
    equal = propagate_distributions(uniform.sum(axis=1))
    one_dominates = propagate_distributions((uniform * [1.0, 1.0, 1.0, 10.0]).sum(axis=1))
    cases = (
        ("9.2.2 four normal", normal, "2.0", "3.92"),
        ("9.2.3 four uniform", equal, "2.0", "3.88"),
        ("9.2.4 one uniform dominates", one_dominates, "10.1", "17.0"),
    )
    rows = []
    for example, total, printed_u, printed_end in cases:
        _, high = total.symmetric(PROB)
        rows.append(_row(SUPPLEMENT_1, example, "u", printed_u, total.u, total, ""))
        rows.append(
            _row(SUPPLEMENT_1, example, "end of the interval", printed_end, high, total, "")
        )
    by_gum = propagate_linearly(_sum, np.zeros(4), np.array([1.0, 1.0, 1.0, 100.0]))
    _, high = by_gum.interval(0, PROB)
    rows.append(
        Figure(SUPPLEMENT_1, "9.2.4 one uniform dominates", "its end by the GUM", "19.9", high)
    )
    return rows


def _sum(inputs: Array) -> Array:
    """Return the sum of all inputs."""
    return inputs.sum(axis=-1, keepdims=True)


def _mass(rng: np.random.Generator) -> list[Figure]:
    """Return the figures of 9.3: deviation of a mass from its nominal value."""
    inputs = np.stack(
        [
            rng.normal(*REFERENCE_MASS_MG, DRAWS),
            rng.normal(*MASS_DIFFERENCE_MG, DRAWS),
            rng.uniform(*AIR_DENSITY, DRAWS),
            rng.uniform(*WEIGHT_DENSITY, DRAWS),
            rng.uniform(*REFERENCE_DENSITY, DRAWS),
        ],
        axis=-1,
    )
    deviation = propagate_distributions(_mass_deviation(inputs)[:, 0])
    low, high = deviation.symmetric(PROB)
    estimate = np.array(
        [
            REFERENCE_MASS_MG[0],
            MASS_DIFFERENCE_MG[0],
            np.mean(AIR_DENSITY),
            np.mean(WEIGHT_DENSITY),
            np.mean(REFERENCE_DENSITY),
        ]
    )
    u = np.array(
        [
            REFERENCE_MASS_MG[1],
            MASS_DIFFERENCE_MG[1],
            _u_of_uniform(AIR_DENSITY),
            _u_of_uniform(WEIGHT_DENSITY),
            _u_of_uniform(REFERENCE_DENSITY),
        ]
    )
    by_gum = propagate_linearly(_mass_deviation, estimate, u**2)
    gum_low, gum_high = by_gum.interval(0, PROB)
    example = "9.3 mass"
    rows = []
    for quantity, printed, computed in (
        ("estimate", "1.2341", deviation.mean),
        ("u", "0.0754", deviation.u),
        ("lower end", "1.0834", low),
        ("upper end", "1.3825", high),
    ):
        rows.append(
            Figure(
                SUPPLEMENT_1,
                example,
                quantity,
                printed,
                computed,
                "mg",
                tolerance=_tolerance(deviation.u),
                reason="both are drawn at random; they agree within 0.0015 mg, 2 % of u",
            )
        )
    for quantity, printed, computed in (
        ("estimate by the GUM", "1.2340", float(by_gum.estimate[0])),
        ("u by the GUM", "0.0539", float(by_gum.u[0])),
        ("lower end by the GUM", "1.1285", float(gum_low)),
        ("upper end by the GUM", "1.3395", float(gum_high)),
    ):
        rows.append(Figure(SUPPLEMENT_1, example, quantity, printed, computed, "mg"))
    return rows


def _mass_deviation(inputs: Array) -> Array:
    """Return the deviation of a weight from its nominal mass [mg] (Eq. 24 of the guide)."""
    reference, difference, air, weight, reference_weight = np.moveaxis(inputs, -1, 0)
    buoyancy = (air - CONVENTIONAL_AIR_DENSITY) * (1.0 / weight - 1.0 / reference_weight)
    mass = (reference + difference) * (1.0 + buoyancy) - NOMINAL_MASS_MG
    return np.asarray(mass[..., np.newaxis])


def _u_of_uniform(ends: tuple[float, float]) -> float:
    """Return the standard uncertainty of a uniform distribution between two ends."""
    low, high = ends
    return (high - low) / np.sqrt(12.0)


def _comparison_loss() -> list[Figure]:
    """Return the figures of 9.4.2: the exact moments for uncorrelated reflections."""
    rows = []
    for printed_x, printed_mean, printed_u in (
        ("0.000", "50", "50"),
        ("0.010", "150", "112"),
        ("0.050", "2550", "502"),
    ):
        noncentrality = (float(printed_x) / U_REFLECTION) ** 2
        loss = stats.ncx2(2, noncentrality, scale=U_REFLECTION**2)
        if noncentrality == 0.0:
            loss = stats.chi2(2, scale=U_REFLECTION**2)
        example = f"9.4 comparison loss, x₁ = {printed_x}"
        mean = float(loss.mean()) / LOSS_UNIT
        u = float(loss.std()) / LOSS_UNIT
        rows.append(Figure(SUPPLEMENT_1, example, "estimate", printed_mean, mean, "1e-6"))
        rows.append(Figure(SUPPLEMENT_1, example, "u", printed_u, u, "1e-6"))
    return rows


def _correlated_loss(rng: np.random.Generator) -> list[Figure]:
    """Return the figures of 9.4.3: random draws for correlated reflections."""
    rows = []
    standard = rng.standard_normal((DRAWS, 2))
    first = U_REFLECTION * standard[:, 0]
    independent = np.sqrt(1.0 - CORRELATION_REFLECTION**2) * standard[:, 1]
    second = CORRELATION_REFLECTION * first + U_REFLECTION * independent
    for printed_x, printed_mean, printed_u in (
        ("0.000", "50", "67"),
        ("0.010", "150", "121"),
        ("0.050", "2551", "505"),
    ):
        loss = (float(printed_x) + first) ** 2 + second**2
        scaled_loss = propagate_distributions(loss / LOSS_UNIT)
        example = f"9.4 comparison loss, x₁ = {printed_x}, r = {CORRELATION_REFLECTION}"
        estimate = (SUPPLEMENT_1, example, "estimate", printed_mean, scaled_loss.mean)
        uncertainty = (SUPPLEMENT_1, example, "u", printed_u, scaled_loss.u)
        rows.append(_row(*estimate, scaled_loss, "1e-6"))
        rows.append(_row(*uncertainty, scaled_loss, "1e-6"))
    return rows


def _end_gauge(rng: np.random.Generator) -> list[Figure]:
    """Return the figures of 9.5, with 99 % intervals."""
    standard = 50_000_623.0 + 25.0 * rng.standard_t(18, DRAWS)
    comparator = (
        215.0
        + 6.0 * rng.standard_t(24, DRAWS)
        + 4.0 * rng.standard_t(5, DRAWS)
        + 7.0 * rng.standard_t(8, DRAWS)
    )
    expansion = rng.uniform(9.5e-6, 13.5e-6, DRAWS)
    mean_temperature = rng.normal(-0.1, 0.2, DRAWS)
    cyclic = 0.5 * np.sin(rng.uniform(0.0, 2.0 * np.pi, DRAWS))
    expansion_difference = _curvilinear_trapezoid(rng, 1.0e-6, 0.1e-6)
    temperature_difference = _curvilinear_trapezoid(rng, 0.050, 0.025)
    thermal = (
        expansion_difference * (mean_temperature + cyclic) + expansion * temperature_difference
    )
    deviation = propagate_distributions(
        standard + comparator - standard * thermal - NOMINAL_LENGTH_NM
    )
    low, high = deviation.symmetric(0.99)
    example = "9.5 end gauge"
    return [
        _row(SUPPLEMENT_1, example, "deviation from 50 mm", "838", deviation.mean, deviation, "nm"),
        _row(SUPPLEMENT_1, example, "u", "36", deviation.u, deviation, "nm"),
        _row(SUPPLEMENT_1, example, "lower end (99 %)", "745", low, deviation, "nm"),
        _row(SUPPLEMENT_1, example, "upper end (99 %)", "932", high, deviation, "nm"),
    ]


def _curvilinear_trapezoid(
    rng: np.random.Generator, half_width: float, half_width_uncertainty: float
) -> Array:
    """Return draws of a uniform quantity whose half width is itself uniform (JCGM 101, 6.4.3)."""
    ends = half_width + rng.uniform(-half_width_uncertainty, half_width_uncertainty, DRAWS)
    return np.asarray(ends * rng.uniform(-1.0, 1.0, DRAWS))


def _sum_of_two(rng: np.random.Generator) -> list[Figure]:
    """Return the figures of JCGM 102, 9.2: two sums that share an input."""
    mixing = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0]])

    def sums(inputs: Array) -> Array:
        return np.asarray(inputs @ mixing.T)

    by_gum = propagate_linearly(sums, np.zeros(3), np.ones(3))
    draws = sums(rng.standard_normal((DRAWS, 3)))
    example = "9.2 two sums"
    correlation = float(np.corrcoef(draws.T)[0, 1])
    return [
        Figure(SUPPLEMENT_2, example, "u", "1.4", float(by_gum.u[0])),
        Figure(SUPPLEMENT_2, example, "r", "0.5", float(by_gum.correlation[0, 1])),
        Figure(SUPPLEMENT_2, example, "u of the draws", "1.4", float(draws[:, 0].std())),
        Figure(SUPPLEMENT_2, example, "r of the draws", "0.5", correlation),
    ]


def _polar(rng: np.random.Generator) -> list[Figure]:
    """Return the figures of JCGM 102, 9.3: magnitude and phase of a complex quantity."""
    rows = []
    for case in POLAR_CASES:
        rows += _polar_by_draws(rng, case)
        rows += _polar_by_gum(case)
    return rows


def _polar_by_draws(rng: np.random.Generator, case: _PolarCase) -> list[Figure]:
    """Return the figures of a complex quantity by random draws."""
    real_and_imaginary = rng.multivariate_normal(case.mean, case.covariance, DRAWS)
    magnitude, phase = _polar_of(real_and_imaginary).T
    rows = []
    for k, values in enumerate((magnitude, phase)):
        name = POLAR_NAMES[k]
        coordinate = propagate_distributions(values)
        estimate = case.by_draws[2 * k]
        u = case.by_draws[2 * k + 1]
        rows.append(
            _row(SUPPLEMENT_2, case.example, name, estimate, coordinate.mean, coordinate, "")
        )
        rows.append(
            _row(SUPPLEMENT_2, case.example, f"u of the {name}", u, coordinate.u, coordinate, "")
        )
    return rows


def _polar_by_gum(case: _PolarCase) -> list[Figure]:
    """Return the figures of a complex quantity by the law of propagation of uncertainty."""
    polar = propagate_linearly(_polar_of, case.mean, case.covariance)
    rows = []
    for k, name in enumerate(POLAR_NAMES):
        quantity = f"{name} by the GUM"
        estimate = case.by_gum[2 * k]
        u = case.by_gum[2 * k + 1]
        rows.append(
            Figure(SUPPLEMENT_2, case.example, quantity, estimate, float(polar.estimate[k]))
        )
        rows.append(
            Figure(SUPPLEMENT_2, case.example, f"u of the {quantity}", u, float(polar.u[k]))
        )
    return rows


def _polar_of(real_and_imaginary: Array) -> Array:
    """Return magnitude and phase [rad] of a complex quantity from its real and imaginary part."""
    real, imaginary = np.moveaxis(real_and_imaginary, -1, 0)
    return np.stack([np.hypot(real, imaginary), np.arctan2(imaginary, real)], axis=-1)
