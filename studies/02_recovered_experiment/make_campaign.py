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
READINGS = 720
SEED = 20_24
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
    found: list[Printed] = []
    for name, first in (
        ("table_5_global_compliances", 0),
        ("table_6_global_geometric_errors", 6),
        ("table_7_local_compliances", 0),
        ("table_8_local_geometric_errors", 6),
    ):
        table = pd.read_csv(TABLES / f"{name}.csv", dtype=str)
        pair = [column for column in table.columns if column.startswith("force_")]
        for _, row in table.iterrows():
            forces = tuple(float(row[column]) for column in pair) or tuple(FORCES_N)
            cells = row.drop(pair)
            found += [
                Printed(forces, first + j, float(text), half_unit(text))
                for j, text in enumerate(cells)
            ]
    return found


def harmonics(angle_rad: np.ndarray) -> np.ndarray:
    """1, cos θ, sin θ, cos 2θ, sin 2θ, cos 3θ, sin 3θ, cos 4θ: shape (n, 8)."""
    columns = [np.ones_like(angle_rad)]
    for n in (1, 2, 3):
        columns += [np.cos(n * angle_rad), np.sin(n * angle_rad)]
    return np.column_stack([*columns, np.cos(4 * angle_rad)])


def estimation_map(forces_N: tuple[float, ...]) -> np.ndarray:
    """Eq. 31 as a map from the 48 harmonic coefficients to the 13 parameters."""
    angle = np.arange(READINGS) * 2 * np.pi / READINGS
    basis = harmonics(angle)
    jacobian = np.vstack(
        [
            lb.machine.hybrid_jacobian(lb.Machine(), lb.machine.Circle(), angle, force)
            for force in forces_N
        ]
    )
    scale = np.linalg.norm(jacobian, axis=0)
    pseudo_inverse = np.linalg.pinv(jacobian / scale, rcond=1e-12) / scale[:, None]
    mapping = np.zeros((13, FORCES_N.size, 8))
    for k, force in enumerate(forces_N):
        mapping[:, int(np.flatnonzero(force == FORCES_N)[0])] = (
            pseudo_inverse[:, k * READINGS : (k + 1) * READINGS] @ basis
        )
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
    def misses(self) -> np.ndarray:
        """What the mean returns minus what is printed, in half-units of the last printed digit,
        shape (78,)."""
        printed, unit = (
            np.array([getattr(n, name) for n in self.numbers]) for name in ("value", "half_unit")
        )
        return (self.jacobian @ self.mean - printed) / unit

    @property
    def open_directions(self) -> np.ndarray:
        """Orthonormal directions in which no printed number changes, shape (k, 48)."""
        unit = np.array([number.half_unit for number in self.numbers])
        singular, right = np.linalg.svd(self.jacobian / unit[:, None])[1:]
        return right[
            np.concatenate([singular, np.zeros(len(right) - len(singular))]) < 1e-8 * singular[0]
        ]


def recover() -> Recovered:
    """The 78 printed numbers, known to half-unit/√3 each, and the weak prior: each harmonic = a +
    bF + N(0, 0.5 µm)."""
    numbers = printed_numbers()
    maps = {forces: estimation_map(forces) for forces in {number.forces_N for number in numbers}}
    jacobian = np.array([maps[number.forces_N][number.parameter] for number in numbers]) * 1e-3
    lever = (FORCES_N - 389.0) / 353.0
    across = 20.0**2 + 30.0**2 * np.outer(lever, lever) + WEAK_UM**2 * np.eye(FORCES_N.size)
    unit = np.array([number.half_unit for number in numbers]) / np.sqrt(3.0)
    root = np.kron(np.linalg.cholesky(across), np.eye(8))
    left, singular, right = np.linalg.svd(jacobian @ root / unit[:, None], full_matrices=True)
    singular = np.concatenate([singular, np.zeros(48 - len(singular))])
    along = left.T[:48] @ (np.array([number.value for number in numbers]) / unit)
    spread = root @ right.T / np.sqrt(1.0 + singular**2)
    return Recovered(
        spread @ (along * singular / np.sqrt(1.0 + singular**2)),
        spread @ spread.T,
        numbers,
        jacobian,
    )


def synthetic_um(angle_rad: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """What the tables do not hold, shape (6, n) [µm]: white noise, discrepancy per test, and one
    shared form."""
    basis = harmonics(angle_rad)

    def project_off(values: np.ndarray) -> np.ndarray:
        return values - basis @ np.linalg.lstsq(basis, values, rcond=None)[0]

    def waves(sd_of_order_one: float, orders: range) -> np.ndarray:
        total = np.zeros_like(angle_rad)
        for n in orders:
            a, b = rng.normal(0.0, sd_of_order_one / n, 2)
            total += a * np.cos(n * angle_rad) + b * np.sin(n * angle_rad)
        return total

    own = []
    for _ in FORCES_N:
        white = rng.normal(0.0, WHITE_UM, angle_rad.size)
        lobe = rng.normal(0.0, DISCREPANCY_UM / 4) * np.sin(4 * angle_rad)
        own.append(project_off(white + waves(DISCREPANCY_UM, range(5, 13)) + lobe))
    form = project_off(waves(1.0, range(5, 13)))
    rest = np.array(own)
    a = np.mean(form**2)
    b = np.mean(rest * form)
    c = np.mean(rest**2) - OUT_OF_BAND_RMS_UM**2
    size = (-b + np.sqrt(b**2 - a * c)) / a
    return rest + size * form


def make_campaign() -> lb.Campaign:
    """The recovered experiment: 720 readings per circle, clockwise."""
    return campaign_of(recover().mean)


def campaign_of(harmonics_um: np.ndarray) -> lb.Campaign:
    """The campaign with these 48 harmonics, 720 readings per circle, and the same synthetic
    part."""
    angle_deg = 360.0 - 0.5 * np.arange(READINGS)
    angle = np.deg2rad(angle_deg)
    readings = harmonics_um.reshape(FORCES_N.size, 8) @ harmonics(angle).T + synthetic_um(
        angle, np.random.default_rng(SEED)
    )
    tests = tuple(
        lb.CircularTest(
            float(force),
            angle_deg,
            reading,
            pressure_bar=float(pressure),
            name=f"f{force:03.0f}",
            direction="CW",
        )
        for force, pressure, reading in zip(FORCES_N, PRESSURES_BAR, readings, strict=True)
    )
    return lb.Campaign(tests, name="wCAFYXZSt, recovered experiment", feed_mm_per_min=2000.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder to write the campaign to")
    out = parser.parse_args().out
    found = recover()
    campaign = make_campaign()
    try:
        lb.write_campaign(campaign, out, force=True)
    except lb.InputError as error:
        sys.exit(f"make_campaign: {error}")
    print(
        f"{len(found.numbers)} printed numbers returned, worst {np.abs(found.misses).max():.3f}"
        " half-units"
    )
    print(f"SHA-256 {campaign.sha256}")


if __name__ == "__main__":
    main()
