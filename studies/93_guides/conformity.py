"""Examples of JCGM 106 (conformity): single items, guard bands, a decision, and global risks.

A specific risk is that of one item with its reading, a global risk the average over all items that
a process makes and a measuring system inspects. Both follow here from the Gaussian kernel of the
package and from its probability of conformance.
"""

from __future__ import annotations

import numpy as np
from figures import Figure
from scipy.optimize import brentq

import ldbb_bayes as lb
from ldbb_bayes.analysis.normal_conformity import normal_conformity
from ldbb_bayes.model.gaussian import Gaussian

__all__ = ["figures"]

GUIDE = "JCGM 106"
# Table 1: distances of the estimate from one limit in units of u, by the probability of
# conformance.
GUARD_BANDS = {"0.80": "0.84", "0.90": "1.28", "0.95": "1.64", "0.99": "2.33", "0.999": "3.09"}

# 7.3 and 7.4: single items, each with its estimate, standard uncertainty, tolerance, unit, and the
# printed probability that it conforms.
SINGLE_ITEMS = {
    "7.3 breakdown voltage of a Zener diode": (
        -5.47,
        0.05,
        lb.analysis.Tolerance(upper=-5.40),
        "V",
        "0.92",
    ),
    "7.3 burst pressure of a container": (
        509.7,
        8.6,
        lb.analysis.Tolerance(lower=490.0),
        "kPa",
        "0.99",
    ),
    "7.4 viscosity of motor oil": (
        13.6,
        1.8,
        lb.analysis.Tolerance(12.5, 16.3),
        "mm²/s",
        "0.66",
    ),
}

# 8.3: a car whose speed is measured by radar: speed limit [km/h], relative standard uncertainty of
# a speed between 50 km/h and 150 km/h, and probability at which the limit counts as exceeded.
SPEED_LIMIT = 100.0
RELATIVE_U_SPEED = 0.02
HIGHEST_SPEED = 150.0
SPEED_CONFIDENCE = 0.999

# 9.5: resistors of nominally 1500 Ω: tolerance and acceptance interval about the nominal value,
# standard deviation of the process, and standard uncertainty of the ohmmeter [Ω].
NOMINAL_OHM = 1500.0
TOLERANCE_OHM = 0.20
ACCEPTANCE_OHM = 0.18
PROCESS_SD_OHM = 0.12
U_OHMMETER = 0.04
# Number of Gauss-Legendre nodes on the acceptance interval.
NODES = 40


def figures() -> list[Figure]:
    """Return the figures of JCGM 106 that are computed here."""
    return [*_single_items(), *_guard_bands(), *_speed(), *_resistors()]


def _single_items() -> list[Figure]:
    """Return the probabilities that single items conform."""
    rows = []
    for example, (estimate, u, tolerance, unit, printed) in SINGLE_ITEMS.items():
        conformity = normal_conformity(unit, estimate, u, tolerance)
        quantity = "probability of conformance"
        rows.append(Figure(GUIDE, example, quantity, printed, conformity.probability))
    return rows


def _guard_bands() -> list[Figure]:
    """Return the guard bands and probabilities of one-sided tolerances."""
    rows = []
    limit = lb.analysis.Tolerance(upper=0.0)
    for probability, printed in GUARD_BANDS.items():
        conformity = normal_conformity("", 0.0, 1.0, limit, confidence=float(probability))
        at_guard_band = normal_conformity("", -conformity.guard_band, 1.0, limit)
        example = f"Table 1, p = {probability}"
        rows.append(Figure(GUIDE, example, "guard band in u", printed, conformity.guard_band))
        rows.append(
            Figure(
                GUIDE,
                example,
                "probability of conformance at it",
                probability,
                at_guard_band.probability,
            )
        )
    return rows


def _speed() -> list[Figure]:
    """Return the least measured speed at which the speed limit was exceeded."""
    fastest = brentq(_beyond_guard_band, SPEED_LIMIT, HIGHEST_SPEED)
    return [Figure(GUIDE, "8.3 speed of a car", "acceptance limit", "107", fastest, "km/h")]


def _beyond_guard_band(speed: float) -> float:
    """Return how far a measured speed lies beyond the guard band of the speed limit [km/h]."""
    limit = lb.analysis.Tolerance(upper=SPEED_LIMIT)
    conformity = normal_conformity(
        "km/h", speed, RELATIVE_U_SPEED * speed, limit, confidence=SPEED_CONFIDENCE
    )
    return speed - SPEED_LIMIT - conformity.guard_band


def _resistors() -> list[Figure]:
    """Return the global risks of resistors that an ohmmeter accepts or rejects."""
    process = Gaussian.of(np.array([NOMINAL_OHM]), np.array([PROCESS_SD_OHM**2]))
    conforming = _probability_of_conformance(process)
    accepted = 0.0
    accepted_and_conforming = 0.0
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    for node, weight in zip(nodes, weights, strict=True):
        reading = NOMINAL_OHM + ACCEPTANCE_OHM * node
        resistance = process.observe(
            np.array([[1.0 / U_OHMMETER]]), np.array([reading / U_OHMMETER])
        )
        # The log integral is the log density of the reading in units of the ohmmeter's u.
        density = float(np.exp(resistance.log_integral)) / U_OHMMETER
        share = ACCEPTANCE_OHM * float(weight) * density
        accepted += share
        accepted_and_conforming += share * _probability_of_conformance(resistance)
    consumers_risk = accepted - accepted_and_conforming
    producers_risk = conforming - accepted_and_conforming
    example = "9.5 resistors"
    return [
        Figure(GUIDE, example, "not conforming", "10", 100.0 * (1.0 - conforming), "%"),
        Figure(GUIDE, example, "consumer's risk", "1", 100.0 * consumers_risk, "%"),
        Figure(GUIDE, example, "producer's risk", "7", 100.0 * producers_risk, "%"),
    ]


def _probability_of_conformance(resistance: Gaussian) -> float:
    """Return the probability that a resistance lies within its tolerance."""
    tolerance = lb.analysis.Tolerance(NOMINAL_OHM - TOLERANCE_OHM, NOMINAL_OHM + TOLERANCE_OHM)
    mean = float(resistance.mean[0])
    sd = float(resistance.sd[0])
    return normal_conformity("Ω", mean, sd, tolerance).probability
