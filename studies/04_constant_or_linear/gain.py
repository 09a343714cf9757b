"""Where the gain of linear over constant compliance comes from: by Fourier order, common-mode
curvature, the other slopes.

C_XXX_1 = C_YYY_1 = a adds a F (F − F0) to every reading (c² + s² = 1): so does a curved mount. A
curved force law adds slopes in proportion to the compliances themselves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

import ldbb_bayes as lb

Array = NDArray[np.float64]
SLOPES = ("C_XXX_1", "C_XYX_1", "C_YYY_1", "C_CXY_1", "C_CYY_1", "C_CCY_1")
EQUAL = ("C_XXX_1", "C_YYY_1")
OTHER_SLOPES = tuple(name for name in SLOPES if name not in EQUAL)
ORDERS = range(5)
# Of the column of common-mode curvature; the centre stands still.
CENTRE_UM = 1e-6


@dataclass(frozen=True, eq=False)
class Fits:
    """Columns of all readings, and least squares on some of them.

    Attributes
    ----------
    columns : DataFrame, shape (n, 19)
        Eq. 33, with C_XXX_1 and C_YYY_1 replaced by their sum ("equal") and difference, and slopes
        in proportion to the compliances ("force law") added.
    reading_um : ndarray, shape (n,)
    """

    columns: pd.DataFrame
    reading_um: Array

    def predicted(self, *slopes: str) -> Array:
        """Least-squares prediction of constant compliance, geometry and these columns, shape (n,)
        [µm]."""
        optional = (*SLOPES, "equal", "difference", "force law")
        constant = [name for name in self.columns if name not in optional]
        matrix = self.columns[[*constant, *slopes]].to_numpy()
        matrix = matrix / np.linalg.norm(matrix, axis=0)
        return matrix @ np.linalg.lstsq(matrix, self.reading_um, rcond=None)[0]

    def squares(self, *slopes: str) -> float:
        """Residual sum of squares [µm²]."""
        return float(np.sum((self.reading_um - self.predicted(*slopes)) ** 2))

    @cached_property
    def squares_of_constant(self) -> float:
        """Residual sum of squares with no slope [µm²]."""
        return self.squares()

    @cached_property
    def squares_of_linear(self) -> float:
        """Residual sum of squares with all six slopes [µm²]."""
        return self.squares(*SLOPES)

    @property
    def gain(self) -> float:
        """How far six slopes let the sum of squares fall [µm²]."""
        return self.squares_of_constant - self.squares_of_linear

    def share_if_first(self, *slopes: str) -> float:
        """Share of the gain that these columns take when they enter first [1]."""
        return (self.squares_of_constant - self.squares(*slopes)) / self.gain

    def share_if_last(self, *entered: str) -> float:
        """Share of the gain that is not yet taken when these columns have entered [1]."""
        return (self.squares(*entered) - self.squares_of_linear) / self.gain


def fits_of(campaign: lb.Campaign) -> Fits:
    """Columns of a campaign of one circle."""
    middle_N = 0.5 * (campaign.forces_N.min() + campaign.forces_N.max())
    machine = campaign.machine()
    circle = lb.machine.Circle(campaign.radius_mm)
    jacobians = [
        lb.machine.hybrid_jacobian(
            machine, circle, test.angles_rad(), test.force_N, degree=1, reference_force_N=middle_N
        )
        for test in campaign.tests
    ]
    columns = pd.concat(jacobians, ignore_index=True)
    constant = lb.fit_least_squares(campaign).estimate
    columns["equal"] = columns["C_XXX_1"] + columns["C_YYY_1"]
    columns["difference"] = columns["C_XXX_1"] - columns["C_YYY_1"]
    columns["force law"] = sum(constant[name.removesuffix("_1")] * columns[name] for name in SLOPES)
    return Fits(columns, np.concatenate([test.reading_um for test in campaign.tests]))


def least_squares(campaign: lb.Campaign) -> dict[str, Any]:
    """The gain as a sum of squares [µm²] and its shares [1]: by order, and by the order in which
    columns enter."""
    fits = fits_of(campaign)
    first = fits.share_if_first("equal")
    last = fits.share_if_last("difference", *OTHER_SLOPES)
    all_but_C_CCY_1 = [name for name in SLOPES if name != "C_CCY_1"]
    C_CCY_1_first = fits.share_if_first("C_CCY_1")
    both_first = fits.share_if_first("equal", "C_CCY_1")
    change_um = fits.predicted(*SLOPES) - fits.predicted()
    ends_N = (campaign.forces_N.min(), campaign.forces_N.max())
    return {
        "gain_um2": fits.gain,
        "readings": campaign.readings,
        "share_of_constant": fits.gain / fits.squares_of_constant,
        "order": by_order(campaign, change_um, fits.gain),
        "equal slopes": {"first": first, "last": last, "shapley": 0.5 * (first + last)},
        "force law first": fits.share_if_first("force law"),
        "C_CCY_1": {"first": C_CCY_1_first, "last": fits.share_if_last(*all_but_C_CCY_1)},
        "equal slopes after C_CCY_1": both_first - C_CCY_1_first,
        "neither": 1.0 - both_first,
        "rmse_um": {
            "constant": np.sqrt(fits.squares_of_constant / campaign.readings),
            "linear": np.sqrt(fits.squares_of_linear / campaign.readings),
        },
        "rmse_with_equal_um": np.sqrt(fits.squares("equal") / campaign.readings),
        "C_CCY": {f"{force_N:g} N": c_ccy(campaign, force_N) for force_N in ends_N},
    }


def c_ccy(campaign: lb.Campaign, force_N: float) -> float:
    """C_CCY(F) by least squares with linear compliance [µrad/(N m)]."""
    fit = lb.fit_least_squares(campaign, 1, reference_force_N=force_N)
    return 1e9 * fit.estimate["C_CCY"]


def by_order(campaign: lb.Campaign, change_um: Array, gain: float) -> dict[str, float]:
    """Shares of the gain by Fourier order: on full circles the orders do not mix."""
    ends_of_circles = np.cumsum([len(test.angle_deg) for test in campaign.tests])
    changes_um = np.split(change_um, ends_of_circles[:-1])
    shares = {}
    for order in ORDERS:
        total = 0.0
        for test, change in zip(campaign.tests, changes_um, strict=True):
            total += squares_of_order(order, test.angles_rad(), change)
        shares[str(order)] = total / gain
    return shares


def squares_of_order(order: int, angle_rad: Array, trace_um: Array) -> float:
    """Sum of squares of one Fourier order of a trace around a full circle [µm²]."""
    waves = [np.cos(order * angle_rad)]
    if order > 0:
        waves.append(np.sin(order * angle_rad))
    return sum(float((wave @ trace_um) ** 2 / (wave @ wave)) for wave in waves)


def with_setup_shift(model: lb.HybridModel, moves: str) -> lb.HybridModel:
    """The model with what moves between circles: together, apart, or the centre alone."""
    nuisances = []
    for term in model.nuisances:
        if type(term).__name__ == "SetupShift":
            nuisances.append(replace(term, moves=moves))
        else:
            nuisances.append(term)
    return replace(model, nuisances=tuple(nuisances))


def white(model: lb.HybridModel) -> lb.HybridModel:
    """White noise alone, no truncation."""
    names = (
        "ball-form",
        "bar-length",
        "mount",
        "force-error",
        "setup-shift",
        "discrepancy",
        "hysteresis",
        "truncation",
    )
    return model.without(*names)


ASSUMPTIONS: dict[str, Callable[[lb.HybridModel], lb.HybridModel]] = {
    "zero and centre move": lambda model: model,
    "each with its own scale": lambda model: with_setup_shift(model, "apart"),
    "the centre alone moves": lambda model: with_setup_shift(model, "centre"),
    "white noise alone": white,
}


def evidence(campaign: lb.Campaign) -> dict[str, Any]:
    """ln B over constant compliance [nat] of a common-mode curvature, of subsets of slopes, and of
    all six, by assumption.

    The curvature is a bar length that changes with F (F − F0): `lb.terms.Drift` over times chosen
    so, its prior sd that of a slope.
    """
    middle_N = 0.5 * (campaign.forces_N.min() + campaign.forces_N.max())
    curve = campaign.forces_N * (campaign.forces_N - middle_N)
    height = float(np.abs(curve).max())
    timed = with_times(campaign, curve / height)
    constant = lb.HybridModel.first(0)
    linear = lb.HybridModel.first(1)
    slope_sd = float(lb.identify(linear, campaign).parameters["C_XXX_1"].prior_sd)
    length_um = 1e3 * slope_sd * height
    common = lb.terms.Drift("time", length_um=length_um, centre_um=CENTRE_UM)
    all_but_C_XYX_1 = [name for name in SLOPES if name != "C_XYX_1"]
    models = {
        "common mode": constant.with_term(common),
        "C_XXX_1 and C_YYY_1": linear.fixing(*OTHER_SLOPES),
        "C_XXX_1": linear.fixing("C_YYY_1", *OTHER_SLOPES),
        "C_YYY_1": linear.fixing("C_XXX_1", *OTHER_SLOPES),
        "C_XYX_1": linear.fixing(*all_but_C_XYX_1),
        "the other four": linear.fixing(*EQUAL),
        "common mode and the other four": linear.fixing(*EQUAL).with_term(common),
        "all six": linear,
    }
    results: dict[str, Any] = {"length_um": length_um}
    for label, change in ASSUMPTIONS.items():
        reference = lb.log_evidence(change(constant), timed, tolerance=1e-2)
        results[label] = {}
        for name, model in models.items():
            of_model = lb.log_evidence(change(model), timed, tolerance=1e-2)
            results[label][name] = lb.inference.log_bayes_factor(of_model, reference)[0]
    return results


def with_times(campaign: lb.Campaign, hours: Array) -> lb.Campaign:
    """The campaign with its tests at these times [h]."""
    tests = []
    for test, hour in zip(campaign.tests, hours, strict=True):
        tests.append(replace(test, time_s=3600.0 * hour))
    return replace(campaign, tests=tuple(tests))


def slopes(campaign: lb.Campaign) -> dict[str, Any]:
    """Posterior of the mean slope (C_XXX_1 + C_YYY_1) / 2 and of their difference [nm/N per kN],
    linear compliance."""
    results = {}
    for label in ("zero and centre move", "the centre alone moves"):
        model = ASSUMPTIONS[label](lb.HybridModel.first(1))
        posterior = lb.sample(model, campaign, sampler="independent", seed=1)["posterior"]
        of_x = 1e9 * posterior["C_XXX_1"].to_numpy().ravel()
        of_y = 1e9 * posterior["C_YYY_1"].to_numpy().ravel()
        results[label] = {
            "mean": interval(0.5 * (of_x + of_y)),
            "difference": interval(of_x - of_y),
        }
    return results


def interval(draws: Array) -> dict[str, float]:
    """Mean, sd and 95 % interval."""
    low, high = np.quantile(draws, [0.025, 0.975])
    return {"mean": draws.mean(), "sd": draws.std(ddof=1), "low": low, "high": high}
