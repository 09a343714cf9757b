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
    of_first,
    of_second,
    of_third,
    printed_numbers,
)
from make_campaign import recover
from scipy.special import logsumexp
from undetermined import HARMONICS, MODELS, recovered

import ldbb_bayes as lb

ZERO_AND_CENTRE = "zero and centre move"
CENTRE = "the centre alone moves"
FIRST = "slopes of the first edition"
SECOND = "slopes of the second"
THIRD = "the third"
EDITIONS: Mapping[str, Callable[[], Sizes]] = {FIRST: of_first, SECOND: of_second, THIRD: of_third}
SCALES = (0.0, 0.25, 0.5, 1.0, 2.0)
SLOPE_SCALES = (0.03, 0.1, 0.3, 1.0, 3.0)
SUBSETS = tuple(
    own for size in range(len(COMPLIANCES) + 1) for own in combinations(COMPLIANCES, size)
)
# The discrepancy of order n: κ/n to a power, and what is added to the standard deviation of every
# harmonic [mm].
LAWS = {
    "κ, the same for all orders": {"decay": 0.0},
    "κ/n²": {"decay": 2.0},
    "κ/n³": {"decay": 3.0},
    "κ/n and 0.05 µm": {"unexplained_mm": 5e-5},
    "κ/n and 0.1 µm": {"unexplained_mm": 1e-4},
}


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
        return {
            "log_bayes_factor": self.log_bayes_factor,
            "some_slope": float(logsumexp(values[1:]) - np.log(len(values) - 1) - values[0]),
            "inclusion": {
                name: float(probability @ [name in own for own in self.log_evidence])
                for name in COMPLIANCES
            },
            "no_slope": float(probability[0]),
            "kappa_um": self.kappa_um,
            "sd_of_kappa_um": self.sd_of_kappa_um,
            "tau_um": self.tau_um,
        }


def answer(model: Model) -> Answer:
    """Of all subsets of slopes."""
    found = {own: model.evidence(own) for own in SUBSETS}
    ends = {"constant": found[()], "linear": found[COMPLIANCES]}
    return Answer(
        {own: value["log_evidence"] for own, value in found.items()},
        {name: 1e3 * value["kappa"] for name, value in ends.items()},
        {name: 1e3 * value["sd_of_kappa"] for name, value in ends.items()},
        {name: 1e3 * value["tau"] for name, value in ends.items()},
    )


def measure(quick: bool) -> dict[str, Any]:
    """What the printed numbers say, what that rests on, and what the shipped readings say with
    their synthetic part scaled.

    ``quick``: without what `LONG` names.
    """
    data = printed_numbers()
    moves = Model(data)
    found = answer(moves)
    stays = Model(data, zero_moves=False)
    held = {own: stays.evidence(own)["log_evidence"] for own in ((), COMPLIANCES)}
    changed = {
        "constant": held[()] - found.log_evidence[()],
        "linear": held[COMPLIANCES] - found.log_evidence[COMPLIANCES],
    }
    lightest = {f"{FORCES_N[0]:.0f}": without(data, 0)}
    long = {} if quick else measure_long(data, found)
    return {
        "numbers": len(data.values),
        "harmonics": data.jacobian.shape[1],
        "subsets": len(SUBSETS),
        **found.as_dict(),
        "log_bayes_factor": {
            ZERO_AND_CENTRE: found.log_bayes_factor,
            CENTRE: held[COMPLIANCES] - held[()],
        },
        "a zero that stays": changed,
        "parts": {ZERO_AND_CENTRE: parts(moves), CENTRE: parts(stays)},
        "curve_um": curve_um(),
        "of_readings": of_readings(),
        "without": lightest | long.pop("without", {}),
        **long,
    }


LONG = ("slope_scale", "explanations", "laws", "laws if the zero stays", "scaled")
LONG += tuple(f"without/{force:.0f}" for force in FORCES_N[1:])


def measure_long(data: Data, found: Answer) -> dict[str, Any]:
    """What takes minutes: other scales and laws, every further circle left out, the synthetic part
    scaled."""
    return {
        "slope_scale": {
            f"{scale:g}": Model(data, slope_scale=scale).log_bayes_factor()
            for scale in SLOPE_SCALES
        },
        "without": {
            f"{force:.0f}": without(data, circle) for circle, force in enumerate(FORCES_N) if circle
        },
        "laws": {law: under(Model(data, **options), found) for law, options in LAWS.items()},
        "laws if the zero stays": {
            law: Model(data, zero_moves=False, **options).log_bayes_factor()
            for law, options in LAWS.items()
        },
        "scaled": {f"{factor:g}": with_scaled(factor) for factor in SCALES},
        "explanations": {
            size: {
                label: explanations(Model(data, zero_moves=label == ZERO_AND_CENTRE, sizes=sizes()))
                for label in (ZERO_AND_CENTRE, CENTRE)
            }
            for size, sizes in EDITIONS.items()
        },
    }


def explanations(model: Model) -> dict[str, Any]:
    """ln B of all six slopes over none [nat], with no rival and averaged over all combinations of
    these; how likely each."""
    combined = [own for size in range(len(RIVALS) + 1) for own in combinations(RIVALS, size)]
    own = np.array(
        [
            [found.evidence(slopes)["log_evidence"] for slopes in ((), COMPLIANCES)]
            for found in (replace(model, rivals=rivals) for rivals in combined)
        ]
    )
    probability = np.exp(own - logsumexp(own))
    constant, linear = logsumexp(own, axis=0)
    included = {
        name: float(probability[[name in rivals for rivals in combined]].sum()) for name in RIVALS
    }
    return {
        "alone": float(own[0, 1] - own[0, 0]),
        "averaged": float(linear - constant),
        "inclusion": {"slopes": float(probability[:, 1].sum()), **included},
    }


def curve_um() -> float:
    """Of sin 2θ, the pattern of C_XYX, over force: departure of its amplitudes from a straight
    line, peak to peak."""
    amplitude = np.reshape(recover().mean, (len(FORCES_N), -1))[:, HARMONICS.index("sin 2θ")]
    return float(np.ptp(amplitude - np.polyval(np.polyfit(FORCES_N, amplitude, 1), FORCES_N)))


def without(data: Data, circle: int) -> dict[str, Any]:
    """The answer, whatever the harmonics of one circle are."""
    left = data.without(circle)
    found = answer(Model(left)).as_dict()
    return {
        "numbers": len(left.values),
        **found,
        CENTRE: Model(left, zero_moves=False).log_bayes_factor(),
    }


def under(model: Model, usual: Answer) -> dict[str, Any]:
    """The answer under another law of the discrepancy, and the evidence of the law over the usual
    one [nat]."""
    found = answer(model)
    evidence = {
        name: found.log_evidence[own] - usual.log_evidence[own]
        for name, own in (("constant", ()), ("linear", COMPLIANCES))
    }
    return {**found.as_dict(), "evidence": evidence}


def parts(model: Model) -> dict[str, float]:
    """ln B over constant compliance [nat] of common mode, of some slopes, and of all."""
    equal = tuple(name.removesuffix("_1") for name in EQUAL)
    others = tuple(name for name in COMPLIANCES if name not in equal)
    common = replace(model, common_mode=True)
    models = {
        "common mode": (common, ()),
        "C_XXX_1 and C_YYY_1": (model, equal),
        "C_XYX_1": (model, ("C_XYX",)),
        "the other four": (model, others),
        "common mode and the other four": (common, others),
        "all six": (model, COMPLIANCES),
    }
    least = model.evidence()["log_evidence"]
    return {
        name: own.evidence(slopes)["log_evidence"] - least for name, (own, slopes) in models.items()
    }


def of_readings() -> dict[str, Any]:
    """ln B by the dense model, given all 150 harmonics of the shipped readings; with the third
    edition's drift, hysteresis and joint load as well, beside the same by `lb.log_evidence`."""
    data = all_harmonics(recovered())
    third = Model(
        data,
        grid=GRID_OF_READINGS,
        sizes=replace(of_first(), third=True),
        rivals=RIVALS[:1],
    )
    linear = lb.HybridModel.first(1)
    for term in (lb.terms.Drift(), lb.terms.Hysteresis(), lb.terms.JointLoad()):
        linear = linear.with_term(term)
    least, most = (
        lb.log_evidence(model, recovered(), tolerance=1e-2)
        for model in (linear.with_degree(0), linear)
    )
    return {
        "harmonics": len(data.values),
        "log_bayes_factor": Model(data, grid=GRID_OF_READINGS).log_bayes_factor(),
        "with_terms_of_third": third.log_bayes_factor(),
        "with_terms_of_third_by_lb": lb.inference.log_bayes_factor(most, least)[0],
    }


def scaled(factor: float) -> lb.Campaign:
    """The recovered experiment; what is synthetic and differs from circle to circle (sin 4θ, orders
    5 to 12) times ``factor``."""
    angle = recovered().tests[0].angles_rad()
    basis = np.column_stack(
        [np.sin(4.0 * angle), *(f(n * angle) for n in range(5, 13) for f in (np.cos, np.sin))]
    )
    own = np.linalg.lstsq(
        basis, np.array([test.reading_um for test in recovered().tests]).T, rcond=None
    )[0]
    change = (factor - 1.0) * basis @ (own - own.mean(axis=1, keepdims=True))
    tests = (
        test.with_reading_um(test.reading_um + add)
        for test, add in zip(recovered().tests, change.T, strict=True)
    )
    return replace(recovered(), tests=tuple(tests))


def with_scaled(factor: float) -> dict[str, Any]:
    """ln B of the readings by `lb.log_evidence`, κ and the two RMSE, with the synthetic part
    scaled."""
    campaign = scaled(factor)
    found: dict[str, Any] = {}
    for label in (ZERO_AND_CENTRE, CENTRE):
        least, most = (
            lb.log_evidence(ASSUMPTIONS[label](model), campaign, tolerance=1e-2)
            for model in MODELS.values()
        )
        found[label] = lb.inference.log_bayes_factor(most, least)[0]
    kappa = (
        1e3
        * lb.inference.marginalize(MODELS["constant"], campaign, tolerance=1e-2).loc[
            "kappa", "mean"
        ]
    )
    rmse = {
        name: lb.fit_least_squares(campaign, degree).quality.rmse_um
        for degree, name in enumerate(MODELS)
    }
    return {**found, "kappa_um": kappa, "rmse_um": rmse}
