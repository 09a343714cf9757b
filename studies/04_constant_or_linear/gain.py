"""Where the gain of linear over constant compliance comes from: by Fourier order, common-mode
curvature, the other slopes.

C_XXX_1 = C_YYY_1 = a adds a F (F − F0) to every reading (c² + s² = 1): so does a curved mount. A
curved force law adds slopes in proportion to the compliances themselves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

import ldbb_bayes as lb

Array = NDArray[np.float64]
SLOPES = ("C_XXX_1", "C_XYX_1", "C_YYY_1", "C_CXY_1", "C_CYY_1", "C_CCY_1")
EQUAL = ("C_XXX_1", "C_YYY_1")
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
        constant = [
            name
            for name in self.columns
            if name not in (*SLOPES, "equal", "difference", "force law")
        ]
        matrix = self.columns[[*constant, *slopes]].to_numpy()
        matrix = matrix / np.linalg.norm(matrix, axis=0)
        return matrix @ np.linalg.lstsq(matrix, self.reading_um, rcond=None)[0]

    def squares(self, *slopes: str) -> float:
        """Residual sum of squares [µm²]."""
        return float(np.sum((self.reading_um - self.predicted(*slopes)) ** 2))


def fits_of(campaign: lb.Campaign) -> Fits:
    """Columns of a campaign of one circle."""
    middle = 0.5 * (campaign.forces_N.min() + campaign.forces_N.max())
    machine = campaign.machine()
    circle = lb.machine.Circle(campaign.radius_mm)
    columns = pd.concat(
        [
            lb.machine.hybrid_jacobian(
                machine, circle, test.angles_rad(), test.force_N, degree=1, reference_force_N=middle
            )
            for test in campaign.tests
        ],
        ignore_index=True,
    )
    constant = lb.fit_least_squares(campaign).estimate
    columns["equal"] = columns["C_XXX_1"] + columns["C_YYY_1"]
    columns["difference"] = columns["C_XXX_1"] - columns["C_YYY_1"]
    columns["force law"] = sum(constant[name.removesuffix("_1")] * columns[name] for name in SLOPES)
    return Fits(columns, np.concatenate([test.reading_um for test in campaign.tests]))


def least_squares(campaign: lb.Campaign) -> dict[str, Any]:
    """The gain as a sum of squares [µm²] and its shares [1]: by order, and by the order in which
    columns enter."""
    fits = fits_of(campaign)
    others = tuple(name for name in SLOPES if name not in EQUAL)
    constant = fits.squares()
    linear = fits.squares(*SLOPES)
    gain = constant - linear

    def first(*slopes: str) -> float:
        return (constant - fits.squares(*slopes)) / gain

    def last(*rest: str) -> float:
        return (fits.squares(*rest) - linear) / gain

    equal = {"first": first("equal"), "last": last("difference", *others)}
    return {
        "gain_um2": gain,
        "readings": campaign.readings,
        "share_of_constant": gain / constant,
        "order": by_order(campaign, fits.predicted(*SLOPES) - fits.predicted(), gain),
        "equal slopes": {**equal, "shapley": 0.5 * (equal["first"] + equal["last"])},
        "force law first": first("force law"),
        "C_CCY_1": {
            "first": first("C_CCY_1"),
            "last": last(*(name for name in SLOPES if name != "C_CCY_1")),
        },
        "equal slopes after C_CCY_1": first("equal", "C_CCY_1") - first("C_CCY_1"),
        "neither": 1.0 - first("equal", "C_CCY_1"),
        "rmse_um": {
            "constant": np.sqrt(constant / campaign.readings),
            "linear": np.sqrt(linear / campaign.readings),
        },
        "rmse_with_equal_um": np.sqrt(fits.squares("equal") / campaign.readings),
        "C_CCY": {
            f"{force:g} N": c_ccy(campaign, force)
            for force in (campaign.forces_N.min(), campaign.forces_N.max())
        },
    }


def c_ccy(campaign: lb.Campaign, force_N: float) -> float:
    """C_CCY(F) by least squares with linear compliance [µrad/(N m)]."""
    found = lb.fit_least_squares(campaign, 1, reference_force_N=force_N).estimate
    return 1e9 * found["C_CCY"]


def by_order(campaign: lb.Campaign, change_um: Array, gain: float) -> dict[str, float]:
    """Shares of the gain by Fourier order: on full circles the orders do not mix."""
    own = np.split(change_um, np.cumsum([len(test.angle_deg) for test in campaign.tests])[:-1])
    shares = {}
    for n in ORDERS:
        total = 0.0
        for test, change in zip(campaign.tests, own, strict=True):
            waves = [f(n * test.angles_rad()) for f in ((np.cos, np.sin) if n else (np.cos,))]
            total += sum(float((wave @ change) ** 2 / (wave @ wave)) for wave in waves)
        shares[str(n)] = total / gain
    return shares


def with_setup_shift(model: lb.HybridModel, moves: str) -> lb.HybridModel:
    """The model with what moves between circles: together, apart, or the centre alone."""
    return replace(
        model,
        nuisances=tuple(
            replace(t, moves=moves) if type(t).__name__ == "SetupShift" else t
            for t in model.nuisances
        ),
    )


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
    curve = campaign.forces_N * (
        campaign.forces_N - 0.5 * (campaign.forces_N.min() + campaign.forces_N.max())
    )
    hours = curve / np.abs(curve).max()
    timed = replace(
        campaign,
        tests=tuple(
            replace(t, time_s=3600.0 * h) for t, h in zip(campaign.tests, hours, strict=True)
        ),
    )
    constant = lb.HybridModel.first(0)
    linear = lb.HybridModel.first(1)
    slope_sd = float(lb.identify(linear, campaign).parameters["C_XXX_1"].prior_sd)
    length_um = 1e3 * slope_sd * float(np.abs(curve).max())
    common = lb.terms.Drift("time", length_um=length_um, centre_um=CENTRE_UM)
    others = [name for name in SLOPES if name not in EQUAL]
    models = {
        "common mode": constant.with_term(common),
        "C_XXX_1 and C_YYY_1": linear.fixing(*others),
        "C_XXX_1": linear.fixing("C_YYY_1", *others),
        "C_YYY_1": linear.fixing("C_XXX_1", *others),
        "C_XYX_1": linear.fixing(*(name for name in SLOPES if name != "C_XYX_1")),
        "the other four": linear.fixing(*EQUAL),
        "common mode and the other four": linear.fixing(*EQUAL).with_term(common),
        "all six": linear,
    }
    found: dict[str, Any] = {"length_um": length_um}
    for label, change in ASSUMPTIONS.items():
        least = lb.log_evidence(change(constant), timed, tolerance=1e-2)
        each = {
            name: lb.log_evidence(change(model), timed, tolerance=1e-2)
            for name, model in models.items()
        }
        found[label] = {
            name: lb.inference.log_bayes_factor(own, least)[0] for name, own in each.items()
        }
    return found


def slopes(campaign: lb.Campaign) -> dict[str, Any]:
    """Posterior of the mean slope (C_XXX_1 + C_YYY_1) / 2 and of their difference [nm/N per kN],
    linear compliance."""
    found = {}
    for label in ("zero and centre move", "the centre alone moves"):
        posterior = lb.sample(
            ASSUMPTIONS[label](lb.HybridModel.first(1)), campaign, sampler="independent", seed=1
        )["posterior"]
        x, y = (1e9 * posterior[name].to_numpy().ravel() for name in EQUAL)
        found[label] = {"mean": interval(0.5 * (x + y)), "difference": interval(x - y)}
    return found


def interval(draws: Array) -> dict[str, float]:
    """Mean, sd and 95 % interval."""
    low, high = np.quantile(draws, [0.025, 0.975])
    return {"mean": draws.mean(), "sd": draws.std(ddof=1), "low": low, "high": high}
