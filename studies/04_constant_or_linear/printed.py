"""Constant or linear compliance from the 78 printed numbers themselves: no reading, nothing
synthetic.

They are a linear map of 48 harmonics, each number known to its half-unit/√3.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from gain import ASSUMPTIONS, EQUAL
from harmonics import (
    COMPLIANCES,
    FORCES_N,
    GRID_OF_READINGS,
    RIVALS,
    Data,
    Model,
    Sizes,
    all_harmonics,
    printed_numbers,
    sizes_of_first_edition,
    sizes_of_second_edition,
    sizes_of_third_edition,
)
from make_campaign import recover
from numpy.typing import NDArray
from scipy.special import logsumexp
from undetermined import HARMONICS, MODELS, recovered

import ldbb_bayes as lb

Array = NDArray[np.float64]
ZERO_AND_CENTRE = "zero and centre move"
CENTRE = "the centre alone moves"
FIRST = "slopes of the first edition"
SECOND = "slopes of the second"
THIRD = "the third"
EDITIONS: Mapping[str, Callable[[], Sizes]] = {
    FIRST: sizes_of_first_edition,
    SECOND: sizes_of_second_edition,
    THIRD: sizes_of_third_edition,
}
SCALES = (0.0, 0.25, 0.5, 1.0, 2.0)
SLOPE_SCALES = (0.03, 0.1, 0.3, 1.0, 3.0)
# The discrepancy of order n: κ/n to a power, and what is added to the standard deviation of every
# harmonic [mm].
LAWS = {
    "κ, the same for all orders": {"decay": 0.0},
    "κ/n²": {"decay": 2.0},
    "κ/n³": {"decay": 3.0},
    "κ/n and 0.05 µm": {"unexplained_mm": 5e-5},
    "κ/n and 0.1 µm": {"unexplained_mm": 1e-4},
}
# Numbers that take minutes: `--quick` leaves them out.
LONG = ("slope_scale", "explanations", "laws", "laws if the zero stays", "scaled")
LONG += tuple(f"without/{force_N:.0f}" for force_N in FORCES_N[1:])


def subsets_of(names: tuple[str, ...]) -> list[tuple[str, ...]]:
    """Every subset, the empty one first, the whole last."""
    subsets: list[tuple[str, ...]] = []
    for size in range(len(names) + 1):
        subsets += combinations(names, size)
    return subsets


SUBSETS = tuple(subsets_of(COMPLIANCES))


@dataclass(frozen=True)
class Answer:
    """What one set of assumptions makes of the numbers.

    Attributes
    ----------
    log_evidence : dict of tuple of str to float
        Of every subset of slopes [nat].
    kappa_um, sd_of_kappa_um, tau_um : dict of str to float
        Posterior of κ and τ under constant and linear compliance.
    """

    log_evidence: dict[tuple[str, ...], float]
    kappa_um: dict[str, float]
    sd_of_kappa_um: dict[str, float]
    tau_um: dict[str, float]

    @property
    def log_bayes_factor(self) -> float:
        """Of all six slopes over none [nat]."""
        return self.log_evidence[COMPLIANCES] - self.log_evidence[()]

    def as_dict(self) -> dict[str, Any]:
        """ln B of all six slopes and of some slope over none; inclusion probabilities; κ."""
        values = np.array(list(self.log_evidence.values()))
        probability = np.exp(values - logsumexp(values))
        inclusion = {}
        for name in COMPLIANCES:
            includes = [name in subset for subset in self.log_evidence]
            inclusion[name] = float(probability @ includes)
        return {
            "log_bayes_factor": self.log_bayes_factor,
            "some_slope": float(logsumexp(values[1:]) - np.log(len(values) - 1) - values[0]),
            "inclusion": inclusion,
            "no_slope": float(probability[0]),
            "kappa_um": self.kappa_um,
            "sd_of_kappa_um": self.sd_of_kappa_um,
            "tau_um": self.tau_um,
        }


def answer(model: Model) -> Answer:
    """Of all subsets of slopes."""
    evidence = {subset: model.evidence(subset) for subset in SUBSETS}
    ends = {"constant": evidence[()], "linear": evidence[COMPLIANCES]}
    return Answer(
        log_evidence={subset: value.log_evidence for subset, value in evidence.items()},
        kappa_um={name: 1e3 * value.mean_mm["kappa"] for name, value in ends.items()},
        sd_of_kappa_um={name: 1e3 * value.sd_of_kappa_mm for name, value in ends.items()},
        tau_um={name: 1e3 * value.mean_mm["tau"] for name, value in ends.items()},
    )


def measure(quick: bool) -> dict[str, Any]:
    """What the printed numbers say, what that rests on, and what the shipped readings say with
    their synthetic part scaled.

    ``quick``: without what `LONG` names.
    """
    data = printed_numbers()
    zero_moves = Model(data)
    zero_stays = Model(data, zero_moves=False)
    usual = answer(zero_moves)
    constant = zero_stays.log_evidence()
    linear = zero_stays.log_evidence(COMPLIANCES)
    without = {f"{FORCES_N[0]:.0f}": without_circle(data, 0)}
    long: dict[str, Any] = {}
    if not quick:
        long = measure_long(data, usual)
        without |= long.pop("without")
    return {
        "numbers": len(data.values),
        "harmonics": data.jacobian.shape[1],
        "subsets": len(SUBSETS),
        **usual.as_dict(),
        "log_bayes_factor": {
            ZERO_AND_CENTRE: usual.log_bayes_factor,
            CENTRE: linear - constant,
        },
        "a zero that stays": {
            "constant": constant - usual.log_evidence[()],
            "linear": linear - usual.log_evidence[COMPLIANCES],
        },
        "parts": {
            ZERO_AND_CENTRE: log_bayes_factors_over_constant(zero_moves),
            CENTRE: log_bayes_factors_over_constant(zero_stays),
        },
        "curve_um": curve_um(),
        "of_readings": of_readings(),
        "without": without,
        **long,
    }


def measure_long(data: Data, usual: Answer) -> dict[str, Any]:
    """What takes minutes: other scales and laws, every further circle left out, the synthetic part
    scaled."""
    slope_scale = {}
    for scale in SLOPE_SCALES:
        slope_scale[f"{scale:g}"] = Model(data, slope_scale=scale).log_bayes_factor()
    without = {}
    for circle in range(1, len(FORCES_N)):
        without[f"{FORCES_N[circle]:.0f}"] = without_circle(data, circle)
    laws = {}
    laws_if_the_zero_stays = {}
    for law, options in LAWS.items():
        laws[law] = under_law(Model(data, **options), usual)
        zero_stays = Model(data, zero_moves=False, **options)
        laws_if_the_zero_stays[law] = zero_stays.log_bayes_factor()
    scaled = {f"{factor:g}": with_synthetic_part_scaled(factor) for factor in SCALES}
    return {
        "slope_scale": slope_scale,
        "without": without,
        "laws": laws,
        "laws if the zero stays": laws_if_the_zero_stays,
        "scaled": scaled,
        "explanations": explanations_by_edition(data),
    }


def explanations_by_edition(data: Data) -> dict[str, Any]:
    """What `explanations` finds with the slopes and rivals of every edition, by whether the zero
    moves."""
    by_edition = {}
    for edition, sizes_of_edition in EDITIONS.items():
        sizes = sizes_of_edition()
        by_edition[edition] = {
            ZERO_AND_CENTRE: explanations(Model(data, zero_moves=True, sizes=sizes)),
            CENTRE: explanations(Model(data, zero_moves=False, sizes=sizes)),
        }
    return by_edition


def explanations(model: Model) -> dict[str, Any]:
    """ln B of all six slopes over none [nat], with no rival and averaged over all combinations of
    these; how likely each."""
    combinations_of_rivals = subsets_of(RIVALS)
    rows = []
    for rivals in combinations_of_rivals:
        with_rivals = replace(model, rivals=rivals)
        rows.append([with_rivals.log_evidence(), with_rivals.log_evidence(COMPLIANCES)])
    log_evidence = np.array(rows)
    probability = np.exp(log_evidence - logsumexp(log_evidence))
    constant, linear = logsumexp(log_evidence, axis=0)
    inclusion = {"slopes": float(probability[:, 1].sum())}
    for name in RIVALS:
        includes = [name in rivals for rivals in combinations_of_rivals]
        inclusion[name] = float(probability[includes].sum())
    return {
        "alone": float(log_evidence[0, 1] - log_evidence[0, 0]),
        "averaged": float(linear - constant),
        "inclusion": inclusion,
    }


def curve_um() -> float:
    """Of sin 2θ, the pattern of C_XYX, over force: departure of its amplitudes from a straight
    line, peak to peak."""
    harmonics_um = np.reshape(recover().mean, (len(FORCES_N), -1))
    amplitude_um = harmonics_um[:, HARMONICS.index("sin 2θ")]
    line_um = np.polyval(np.polyfit(FORCES_N, amplitude_um, 1), FORCES_N)
    return float(np.ptp(amplitude_um - line_um))


def without_circle(data: Data, circle: int) -> dict[str, Any]:
    """The answer, whatever the harmonics of one circle are."""
    remaining = data.without(circle)
    return {
        "numbers": len(remaining.values),
        **answer(Model(remaining)).as_dict(),
        CENTRE: Model(remaining, zero_moves=False).log_bayes_factor(),
    }


def under_law(model: Model, usual: Answer) -> dict[str, Any]:
    """The answer under another law of the discrepancy, and the evidence of the law over the usual
    one [nat]."""
    new = answer(model)
    evidence = {}
    for name, slopes in (("constant", ()), ("linear", COMPLIANCES)):
        evidence[name] = new.log_evidence[slopes] - usual.log_evidence[slopes]
    return {**new.as_dict(), "evidence": evidence}


def log_bayes_factors_over_constant(model: Model) -> dict[str, float]:
    """ln B over constant compliance [nat] of common mode, of some slopes, and of all."""
    equal = tuple(name.removesuffix("_1") for name in EQUAL)
    other_slopes = tuple(name for name in COMPLIANCES if name not in equal)
    common = replace(model, common_mode=True)
    log_evidence = {
        "common mode": common.log_evidence(),
        "C_XXX_1 and C_YYY_1": model.log_evidence(equal),
        "C_XYX_1": model.log_evidence(("C_XYX",)),
        "the other four": model.log_evidence(other_slopes),
        "common mode and the other four": common.log_evidence(other_slopes),
        "all six": model.log_evidence(COMPLIANCES),
    }
    constant = model.log_evidence()
    return {name: value - constant for name, value in log_evidence.items()}


def log_bayes_factor_by_lb(
    constant: lb.HybridModel, linear: lb.HybridModel, campaign: lb.Campaign
) -> float:
    """ln B of linear over constant compliance of readings, by `lb.log_evidence` [nat]."""
    of_constant = lb.log_evidence(constant, campaign, tolerance=1e-2)
    of_linear = lb.log_evidence(linear, campaign, tolerance=1e-2)
    return lb.inference.log_bayes_factor(of_linear, of_constant)[0]


def of_readings() -> dict[str, Any]:
    """ln B by the dense model, given all 150 harmonics of the shipped readings; with the third
    edition's drift, hysteresis and joint load as well, beside the same by `lb.log_evidence`."""
    data = all_harmonics(recovered())
    first = Model(data, grid=GRID_OF_READINGS)
    third_terms = replace(sizes_of_first_edition(), third=True)
    third = replace(first, sizes=third_terms, rivals=("joint load",))
    linear = lb.HybridModel.first(1)
    for term in (lb.terms.Drift(), lb.terms.Hysteresis(), lb.terms.JointLoad()):
        linear = linear.with_term(term)
    return {
        "harmonics": len(data.values),
        "log_bayes_factor": first.log_bayes_factor(),
        "with_terms_of_third": third.log_bayes_factor(),
        "with_terms_of_third_by_lb": log_bayes_factor_by_lb(
            linear.with_degree(0), linear, recovered()
        ),
    }


def synthetic_harmonics(angle_rad: Array) -> Array:
    """sin 4θ and orders 5 to 12, which no printed number determines, shape (n, 17)."""
    columns = [np.sin(4.0 * angle_rad)]
    for order in range(5, 13):
        columns += [np.cos(order * angle_rad), np.sin(order * angle_rad)]
    return np.column_stack(columns)


def synthetic_part_scaled(factor: float) -> lb.Campaign:
    """The recovered experiment; what is synthetic and differs from circle to circle (sin 4θ, orders
    5 to 12) times ``factor``."""
    campaign = recovered()
    basis = synthetic_harmonics(campaign.tests[0].angles_rad())
    readings_um = np.array([test.reading_um for test in campaign.tests]).T
    harmonics_um = np.linalg.lstsq(basis, readings_um, rcond=None)[0]
    deviation_um = harmonics_um - harmonics_um.mean(axis=1, keepdims=True)
    change_um = (factor - 1.0) * basis @ deviation_um
    tests = []
    for test, change in zip(campaign.tests, change_um.T, strict=True):
        tests.append(test.with_reading_um(test.reading_um + change))
    return replace(campaign, tests=tuple(tests))


def with_synthetic_part_scaled(factor: float) -> dict[str, Any]:
    """ln B of the readings by `lb.log_evidence`, κ and the two RMSE, with the synthetic part
    scaled."""
    campaign = synthetic_part_scaled(factor)
    log_bayes_factor = {}
    for label in (ZERO_AND_CENTRE, CENTRE):
        assume = ASSUMPTIONS[label]
        log_bayes_factor[label] = log_bayes_factor_by_lb(
            assume(MODELS["constant"]), assume(MODELS["linear"]), campaign
        )
    marginals = lb.inference.marginalize(MODELS["constant"], campaign, tolerance=1e-2)
    rmse_um = {}
    for degree, name in enumerate(MODELS):
        rmse_um[name] = lb.fit_least_squares(campaign, degree).quality.rmse_um
    return {
        **log_bayes_factor,
        "kappa_um": 1e3 * marginals.loc["kappa", "mean"],
        "rmse_um": rmse_um,
    }
