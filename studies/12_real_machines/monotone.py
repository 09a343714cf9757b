"""Research: a deflection of each axis that only grows with its own load, beside slopes in the bar's
force. Not in the package.

    δ_a(f) = Σ_k w_k g_k(f),   w_k ≥ 0,   g = f, f^⅔ F0^⅓, (f − f_k)₊,   f = F |u_a| the axis' own
    load

against degrees 1 and 2 with `JointLoad`. All three share data, nuisances and hyper-parameters
(those `identify` works out, at their mean), so that only the law differs; w is drawn exactly inside
w ≥ 0. Compared is the force curve C_aa(F) = δ_a(F)/F.

Not better, so not proposed: its curve is nearer the truth where joints are in contact, further from
it elsewhere, and its intervals of the change with force are too narrow in all three families, with
the prior sd of w at these values or half of them.

python studies/12_real_machines/monotone.py 30    # campaigns of each family
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

import ldbb_bayes as lb
from ldbb_bayes.model.orthant import Orthant

sys.path.insert(0, str(Path(__file__).resolve().parent))
from machines import FAMILIES, LARGEST_N, MIDDLE_N, RADIUS_MM, Machine, simulate

Array = NDArray[Any]
LAWS = ("degree 1", "degree 2", "monotone")
COMPARED = ("mild", "contact", "own load")
DRAWS = 400
KNOTS_N = (150.0, 300.0, 450.0, 600.0)
HIGHEST_ORDER = 12
# Order of every column of the basis: 0, 1, 1, 2, 2, …
ORDERS = np.append(0, np.repeat(np.arange(1, HIGHEST_ORDER + 1), 2))
# Prior sd of the compliances and of the geometric errors, as the model has them.
PRIOR = np.array([1e-4, 1e-5, 1e-4, 1e-7, 1e-7, 1e-9, 2e-4, 1e-6, 1e-6, 2e-4, 5e-5, 0.02, 0.02])
COMPLIANCES = ("C_XXX", "C_XYX", "C_YYY", "C_CXY", "C_CYY", "C_CCY")


def basis(angle: Array) -> Array:
    """1, cos θ, sin θ, … sin 12θ, shape (n, 25)."""
    columns = [np.ones_like(angle)]
    for order in range(1, HIGHEST_ORDER + 1):
        columns += [np.cos(order * angle), np.sin(order * angle)]
    return np.column_stack(columns)


def _wrench(angle: Array) -> Array:
    """j_C, shape (6, n)."""
    c = np.cos(angle)
    s = np.sin(angle)
    r = RADIUS_MM
    x = r * c
    return np.array([c**2, c * s, s**2, x * c * s, x * s**2, (x * s) ** 2])


class Columns(NamedTuple):
    """Columns of what a law says of C_XXX, C_YYY and their change with force."""

    effect: Array  # on the readings of one circle, (n, k)
    prior_sd: Array  # (k,)
    compliance: Array  # on C_XX and C_YY at this force, (2, k)


class Column(NamedTuple):
    """One of them: effect on the deflection of one axis, prior sd and effect on its C_aa."""

    effect: Array
    prior_sd: float
    compliance: float


def laws_columns(
    law: str, force: float, angle: Array, estimate: dict[str, float], span: float
) -> Columns:
    """Columns of C_XXX, C_YYY and what changes with force."""
    effects = []
    prior_sd = []
    compliances = []
    for axis, name in enumerate(("C_XXX", "C_YYY")):
        direction = np.abs((np.cos(angle), np.sin(angle))[axis])
        for column in axis_columns(law, force, direction, abs(estimate[name])):
            effects.append(column.effect)
            prior_sd.append(column.prior_sd)
            compliances.append(column.compliance * np.eye(2)[axis])
    wrench = _wrench(angle)
    degrees = 0 if law == "monotone" else int(law[-1])
    for degree in range(1, degrees + 1):
        power = (force - MIDDLE_N) ** degree
        for k, name in enumerate(COMPLIANCES):
            size = max(abs(estimate[name]), PRIOR[k] / 20.0)
            effects.append(force * power * wrench[k])
            prior_sd.append(0.3 * size / span**degree)
            compliances.append(power * np.array([k == 0, k == 2], dtype=float))
    return Columns(np.column_stack(effects), np.array(prior_sd), np.array(compliances).T)


def axis_columns(law: str, force: float, direction: Array, compliance: float) -> list[Column]:
    """Columns of one axis; ``direction`` is |u_a|, ``compliance`` the size of its C."""
    if law == "monotone":
        return monotone_columns(force, direction, compliance)
    load = force * direction
    growth = load * direction * (load - MIDDLE_N) / LARGEST_N
    contact = np.cbrt(force**2 * MIDDLE_N) * direction ** (5 / 3) - load * direction
    return [
        Column(load * direction, 1e-4, 1.0),
        Column(growth, 0.2 * compliance, (force - MIDDLE_N) / LARGEST_N),
        Column(contact, 0.2 * compliance, np.cbrt(MIDDLE_N / force) - 1.0),
    ]


def monotone_columns(force: float, direction: Array, compliance: float) -> list[Column]:
    """The deflections g_k of one axis, which only grow with its own load."""
    load = force * direction
    columns = [
        Column(direction * load, 1e-4, 1.0),
        Column(
            direction * np.cbrt(load**2 * MIDDLE_N),
            compliance,
            np.cbrt(force**2 * MIDDLE_N) / force,
        ),
    ]
    for knot_N in KNOTS_N:
        effect = direction * np.maximum(load - knot_N, 0.0)
        columns.append(Column(effect, 0.3 * compliance, max(force - knot_N, 0.0) / force))
    return columns


def other_columns(
    force: float,
    pressure: float,
    angle: Array,
    estimate: dict[str, float],
    hyper: dict[str, float],
    fitted: Array,
) -> tuple[Array, Array]:
    """Columns of the other compliances, geometry and nuisances of one circle, shape (n, k), and
    their prior sd (k,)."""
    c = np.cos(angle)
    s = np.sin(angle)
    x = RADIUS_MM * c
    y = RADIUS_MM * s
    wrench = _wrench(angle)
    yields = wrench.T @ np.array([estimate[name] for name in COMPLIANCES])
    columns = list(force * wrench[[1, 3, 4, 5]])
    sd = list(PRIOR[[1, 3, 4, 5]])
    columns += [x * c, x * x * s, y * y * c, y * s, x * s, c, s]
    sd += list(PRIOR[6:])
    constant = np.ones_like(c)
    bow = 4.0 * force / LARGEST_N * (1.0 - force / LARGEST_N)
    columns += [constant, pressure * constant, bow * constant]
    sd += [9.4e-3, 0.233e-3, 0.5e-3]
    columns += [force * yields, LARGEST_N * bow * yields]
    sd += [0.01, 0.01]
    columns.append(np.gradient(fitted, angle))
    sd.append(np.deg2rad(0.1) * np.sqrt(2.0))
    for u, name in ((c, "C_XXX"), (s, "C_YYY")):
        columns += [force * u**3, force * (u**4 - u**2 / 2.0)]
        sd += [0.07 * abs(estimate[name]), 0.04 * abs(estimate[name])]
    for order in range(2, HIGHEST_ORDER + 1):
        graded_mm = 2.5e-3 * np.sqrt(2.0 / 24.0) if order <= 3 else 0.0
        form_mm = hyper["tau"] * 1e-3 * (order / 6.0) ** -hyper["decay"]
        columns += [np.cos(order * angle), np.sin(order * angle)]
        sd += 2 * [float(np.hypot(form_mm, graded_mm))]
    return np.column_stack(columns), np.array(sd)


def curves(campaign: lb.Campaign, law: str, hyper: dict[str, float]) -> Array:
    """Draws of C_XX, C_YY at every tested force, shape (draws, tests, 2)."""
    estimate = lb.fit_least_squares(campaign).estimate
    span = float(np.ptp(campaign.forces_N))
    angle = campaign.tests[0].angles_rad()
    precision = 0.0
    shift = 0.0
    compliances = []
    project = np.linalg.pinv(basis(angle))
    for k, test in enumerate(campaign.tests):
        force = campaign.forces_N[k]
        pressure = campaign.pressures_bar[k]
        coefficients = project @ test.readings_mm()
        fitted = basis(angle) @ coefficients
        changing = laws_columns(law, force, angle, estimate, span)
        common, common_sd = other_columns(force, pressure, angle, estimate, hyper, fitted)
        scaled = np.column_stack([changing.effect * changing.prior_sd, common * common_sd])
        columns = project @ scaled
        covariance = noise_covariance(angle, estimate, hyper, test.name, project)
        inverse = np.linalg.inv(covariance)
        precision = precision + columns.T @ inverse @ columns
        shift = shift + columns.T @ inverse @ coefficients
        compliances.append(changing.compliance * changing.prior_sd)
    mean, root = _gaussian(np.eye(len(shift)) + precision, shift)
    first = slice(0, compliances[0].shape[1])
    draws = _draws(mean, root, first, law == "monotone")
    return np.einsum("tak,dk->dta", np.array(compliances), draws)


def noise_covariance(
    angle: Array,
    estimate: dict[str, float],
    hyper: dict[str, float],
    test_name: str,
    project: Array,
) -> Array:
    """Covariance of a circle's Fourier coefficients [mm²]: white noise, what differs from circle to
    circle, and the error of its force, shape (25, 25)."""
    scatter_mm = hyper[f"lambda_{test_name}"] * 1e-3
    order = np.maximum(ORDERS, 1)
    white = (hyper["sigma"] * 1e-3) ** 2 * np.where(ORDERS, 2.0, 1.0) / len(angle)
    centring_mm = hyper["delta"] * scatter_mm
    pattern_mm = hyper["kappa"] * scatter_mm / order
    variance = white + np.where(ORDERS < 2, centring_mm, pattern_mm) ** 2
    yields = _wrench(angle).T @ np.array([estimate[name] for name in COMPLIANCES])
    force_error = 4.0 * project @ yields
    return np.diag(variance) + np.outer(force_error, force_error)


def _gaussian(precision: Array, shift: Array) -> tuple[Array, Array]:
    """Mean and a root of the covariance."""
    lower = np.linalg.cholesky(precision)
    return np.linalg.solve(precision, shift), np.linalg.inv(lower).T


def _draws(mean: Array, root: Array, rows: slice, truncated: bool) -> Array:
    """Draws of the first coefficients, shape (draws, k); all of them not negative where
    truncated."""
    rng = np.random.default_rng(1)
    centre = mean[rows]
    spread = root[rows]
    if not truncated:
        return np.asarray(centre + rng.standard_normal((DRAWS, spread.shape[1])) @ spread.T)
    orthant = Orthant(np.tile(centre, (DRAWS, 1)), np.tile(spread, (DRAWS, 1, 1)))
    white, exact = orthant.draw_standard(rng)
    if exact.mean() < 0.9:
        raise lb.InputError(
            f"draws inside w ≥ 0 must be exact, got {exact.mean():.0%} of them. Take fewer knots."
        )
    return np.asarray(centre + white[exact] @ spread.T)


def truth(machine: Machine, force_N: Array) -> Array:
    """C_XX, C_YY over the bar's force along the axis, shape (forces, 2)."""
    columns = []
    for axis, name in enumerate(("C_XXX", "C_YYY")):
        share = machine.contact[axis]
        contact = 1.0 - share + share * np.cbrt(MIDDLE_N / force_N)
        stiffening = machine.own_load[axis] * (force_N - MIDDLE_N) / LARGEST_N
        slope = machine.slope[name] * (force_N - MIDDLE_N)
        columns.append(machine.compliance[name] * (contact + stiffening) + slope)
    return np.array(columns).T


def compare_laws(kind: str, seed: int) -> list[dict[str, float | str]]:
    """Errors of C_aa(F) and of its change from the middle force, one row for each law."""
    campaign, machine = simulate(FAMILIES[kind], seed)
    hyper = lb.identify(lb.HybridModel.default(1), campaign).hyper_um
    true_curve = truth(machine, campaign.forces_N)
    size = np.array([machine.compliance["C_XXX"], machine.compliance["C_YYY"]])
    middle = len(true_curve) // 2
    off_middle = np.arange(len(true_curve)) != middle
    rows = []
    for law in LAWS:
        draws = curves(campaign, law, hyper)
        changes = (draws - draws[:, [middle]])[:, off_middle]
        true_changes = (true_curve - true_curve[middle])[off_middle]
        row: dict[str, float | str] = {"kind": kind, "seed": seed, "law": law}
        row |= errors_of("curve", draws / size, true_curve / size)
        row |= errors_of("change", changes / size, true_changes / size)
        rows.append(row)
    return rows


def errors_of(name: str, draws: Array, true: Array) -> dict[str, float]:
    """Rms error, coverage and mean half width of the draws."""
    low, high = np.quantile(draws, [0.025, 0.975], axis=0)
    return {
        f"{name}/error": float(np.sqrt(np.mean((draws.mean(axis=0) - true) ** 2))),
        f"{name}/covered": float(((low <= true) & (true <= high)).mean()),
        f"{name}/half_width": float((0.5 * (high - low)).mean()),
    }


def main() -> None:
    """Print the means over the campaigns of each family, in percent of C_aa."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    rows = []
    for kind in COMPARED:
        for seed in range(count):
            rows += compare_laws(kind, seed)
    means = pd.DataFrame(rows).drop(columns="seed").groupby(["kind", "law"], sort=False).mean()
    print(means.mul(100.0).round(1).to_string())


if __name__ == "__main__":
    main()
