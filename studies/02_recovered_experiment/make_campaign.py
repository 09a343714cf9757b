"""Recover the published experiment from the paper's Tables 5-8 and write it as a campaign.

The raw readings are not public. Tables 5-8 are 78 printed numbers, each a known linear map of 48
harmonic coefficients (orders 0-3 and cos 4θ at six forces): least squares (Eq. 31) on full uniform
circles. They determine 45 of the 48 dimensions; a weak prior supplies the rest. What lies outside
these harmonics is synthetic and seeded.

    python studies/02_recovered_experiment/make_campaign.py --out data/recovered_experiment
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

import ldbb_bayes as lb

TABLES = Path(__file__).resolve().parents[2] / "data" / "published_tables"
FORCES_N = np.array([36.0, 238.0, 364.0, 490.0, 616.0, 742.0])
PRESSURES_BAR = np.array([0.4, 2.0, 3.0, 4.0, 5.0, 6.0])
# Which of the 13 parameters stands in the first column of a table.
FIRST_PARAMETER = {
    "table_5_global_compliances": 0,
    "table_6_global_geometric_errors": 6,
    "table_7_local_compliances": 0,
    "table_8_local_geometric_errors": 6,
}
READINGS = 720
SEED = 20_24
# The weak prior: harmonic = a + b (F − 389 N) / 353 N + scatter.
LEVEL_UM = 20.0
TREND_UM = 30.0
WEAK_UM = 0.5
OUT_OF_BAND_RMS_UM = 0.60
WHITE_UM = 0.12
DISCREPANCY_UM = 0.27


@dataclass(frozen=True)
class Printed:
    """One printed number: which forces it was estimated from, which of the 13 parameters, value and
    half-unit."""

    forces_N: tuple[float, ...]
    parameter: int
    value: float
    half_unit: float


def half_unit(text: str) -> float:
    """Half a unit of the last printed digit."""
    mantissa, _, exponent = text.upper().partition("E")
    decimals = len(mantissa.partition(".")[2])
    return 0.5 * 10.0 ** (int(exponent or 0) - decimals)


def printed_numbers() -> list[Printed]:
    """The 78 numbers of Tables 5-8 as printed."""
    numbers: list[Printed] = []
    for name, first_parameter in FIRST_PARAMETER.items():
        table = pd.read_csv(TABLES / f"{name}.csv", dtype=str)
        force_columns = [column for column in table.columns if column.startswith("force_")]
        for _, row in table.iterrows():
            forces_N = tuple(float(row[column]) for column in force_columns)
            if not forces_N:
                forces_N = tuple(FORCES_N)
            for parameter, text in enumerate(row.drop(force_columns), start=first_parameter):
                numbers.append(Printed(forces_N, parameter, float(text), half_unit(text)))
    return numbers


def harmonics(angle_rad: np.ndarray) -> np.ndarray:
    """1, cos θ, sin θ, cos 2θ, sin 2θ, cos 3θ, sin 3θ, cos 4θ: shape (n, 8)."""
    columns = [np.ones_like(angle_rad)]
    for order in (1, 2, 3):
        columns += [np.cos(order * angle_rad), np.sin(order * angle_rad)]
    return np.column_stack([*columns, np.cos(4 * angle_rad)])


def estimation_map(forces_N: tuple[float, ...]) -> np.ndarray:
    """Eq. 31 as a map from the 48 harmonic coefficients to the 13 parameters."""
    angle_rad = np.arange(READINGS) * 2 * np.pi / READINGS
    basis = harmonics(angle_rad)
    jacobian = np.vstack(
        [
            lb.machine.hybrid_jacobian(lb.Machine(), lb.machine.Circle(), angle_rad, force_N)
            for force_N in forces_N
        ]
    )
    scale = np.linalg.norm(jacobian, axis=0)
    pseudo_inverse = np.linalg.pinv(jacobian / scale, rcond=1e-12) / scale[:, None]
    mapping = np.zeros((13, FORCES_N.size, 8))
    for k, force_N in enumerate(forces_N):
        circle = int(np.flatnonzero(force_N == FORCES_N)[0])
        of_readings = pseudo_inverse[:, k * READINGS : (k + 1) * READINGS]
        mapping[:, circle] = of_readings @ basis
    return mapping.reshape(13, -1)


@dataclass(frozen=True)
class Recovered:
    """Gaussian posterior of the 48 harmonics given the printed numbers.

    Attributes
    ----------
    mean, covariance : ndarray, shapes (48,), (48, 48) [µm, µm²]
        Order: force, then harmonic.
    numbers : list of Printed
    jacobian : ndarray, shape (78, 48)
        Printed number per µm of a harmonic.
    """

    mean: np.ndarray
    covariance: np.ndarray
    numbers: list[Printed]
    jacobian: np.ndarray

    @property
    def sd(self) -> np.ndarray:
        """Of every harmonic, shape (48,) [µm]."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def half_units(self) -> np.ndarray:
        """Half a unit of the last digit of every printed number, shape (78,)."""
        return np.array([number.half_unit for number in self.numbers])

    @property
    def misses(self) -> np.ndarray:
        """What the mean returns minus what is printed, in half-units of the last printed digit,
        shape (78,)."""
        printed = np.array([number.value for number in self.numbers])
        return (self.jacobian @ self.mean - printed) / self.half_units

    @property
    def open_directions(self) -> np.ndarray:
        """Orthonormal directions in which no printed number changes, shape (k, 48)."""
        _, singular, right = np.linalg.svd(self.jacobian / self.half_units[:, None])
        singular = np.concatenate([singular, np.zeros(len(right) - len(singular))])
        return right[singular < 1e-8 * singular[0]]


def weak_prior() -> np.ndarray:
    """Covariance of one harmonic over the six forces, shape (6, 6) [µm²]."""
    lever = (FORCES_N - 389.0) / 353.0
    trend = TREND_UM**2 * np.outer(lever, lever)
    return LEVEL_UM**2 + trend + WEAK_UM**2 * np.eye(FORCES_N.size)


def recover() -> Recovered:
    """The 78 printed numbers, known to half-unit/√3 each, and the weak prior: each harmonic = a +
    bF + N(0, 0.5 µm)."""
    numbers = printed_numbers()
    sets_of_forces_N = {number.forces_N for number in numbers}
    maps = {forces_N: estimation_map(forces_N) for forces_N in sets_of_forces_N}
    rows = [maps[number.forces_N][number.parameter] for number in numbers]
    jacobian = np.array(rows) * 1e-3
    values = np.array([number.value for number in numbers])
    sd = np.array([number.half_unit for number in numbers]) / np.sqrt(3.0)
    prior_root = np.kron(np.linalg.cholesky(weak_prior()), np.eye(8))
    whitened = jacobian @ prior_root / sd[:, None]
    left, singular, right = np.linalg.svd(whitened, full_matrices=True)
    singular = np.concatenate([singular, np.zeros(48 - len(singular))])
    projected = left.T[:48] @ (values / sd)
    posterior_root = prior_root @ right.T / np.sqrt(1.0 + singular**2)
    return Recovered(
        mean=posterior_root @ (projected * singular / np.sqrt(1.0 + singular**2)),
        covariance=posterior_root @ posterior_root.T,
        numbers=numbers,
        jacobian=jacobian,
    )


def random_waves(
    angle_rad: np.ndarray, sd_of_order_one: float, rng: np.random.Generator
) -> np.ndarray:
    """Orders 5 to 12 with random coefficients, whose sd falls as 1/order, shape (n,)."""
    total = np.zeros_like(angle_rad)
    for order in range(5, 13):
        of_cosine, of_sine = rng.normal(0.0, sd_of_order_one / order, 2)
        total += of_cosine * np.cos(order * angle_rad) + of_sine * np.sin(order * angle_rad)
    return total


def without_harmonics(trace: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """A trace less its least-squares fit by the harmonics that the tables hold."""
    return trace - basis @ np.linalg.lstsq(basis, trace, rcond=None)[0]


def synthetic_um(angle_rad: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """What the tables do not hold, shape (6, n) [µm]: white noise, discrepancy per test, and one
    shared form."""
    basis = harmonics(angle_rad)
    traces = []
    for _ in FORCES_N:
        white = rng.normal(0.0, WHITE_UM, angle_rad.size)
        lobe = rng.normal(0.0, DISCREPANCY_UM / 4) * np.sin(4 * angle_rad)
        discrepancy = random_waves(angle_rad, DISCREPANCY_UM, rng)
        traces.append(without_harmonics(white + discrepancy + lobe, basis))
    of_tests = np.array(traces)
    form = without_harmonics(random_waves(angle_rad, 1.0, rng), basis)
    return of_tests + size_of_form(of_tests, form) * form


def size_of_form(of_tests: np.ndarray, form: np.ndarray) -> float:
    """Factor on the shared form with which the synthetic part has the RMS that returns the paper's
    RMSE."""
    a = np.mean(form**2)
    b = np.mean(of_tests * form)
    c = np.mean(of_tests**2) - OUT_OF_BAND_RMS_UM**2
    return float((-b + np.sqrt(b**2 - a * c)) / a)


def make_campaign() -> lb.Campaign:
    """The recovered experiment: 720 readings per circle, clockwise."""
    return campaign_of(recover().mean)


def campaign_of(harmonics_um: np.ndarray) -> lb.Campaign:
    """The campaign with these 48 harmonics, 720 readings per circle, and the same synthetic
    part."""
    angle_deg = 360.0 - 0.5 * np.arange(READINGS)
    angle_rad = np.deg2rad(angle_deg)
    readings_um = harmonics_um.reshape(FORCES_N.size, 8) @ harmonics(angle_rad).T
    readings_um = readings_um + synthetic_um(angle_rad, np.random.default_rng(SEED))
    tests = []
    for force_N, pressure_bar, reading_um in zip(FORCES_N, PRESSURES_BAR, readings_um, strict=True):
        tests.append(
            lb.CircularTest(
                float(force_N),
                angle_deg,
                reading_um,
                pressure_bar=float(pressure_bar),
                name=f"f{force_N:03.0f}",
                direction="CW",
            )
        )
    return lb.Campaign(tuple(tests), name="wCAFYXZSt, recovered experiment", feed_mm_per_min=2000.0)


def main() -> None:
    """Write the campaign, and say how well it returns the printed numbers."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder to write the campaign to")
    out = parser.parse_args().out
    recovered = recover()
    campaign = make_campaign()
    try:
        lb.write_campaign(campaign, out, force=True)
    except lb.InputError as error:
        sys.exit(f"make_campaign: {error}")
    worst = np.abs(recovered.misses).max()
    print(f"{len(recovered.numbers)} printed numbers returned, worst {worst:.3f} half-units")
    print(f"SHA-256 {campaign.sha256}")


if __name__ == "__main__":
    main()
