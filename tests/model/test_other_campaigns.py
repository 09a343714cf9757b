"""Campaigns of several planes, radii, centres, set-ups, directions and times.

The model is compared with a dense one that is built here.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from campaigns import refuses
from oracle import waves as wave_columns
from scipy import stats

import ldbb_bayes as lb
from ldbb_bayes.analysis.aliases import degeneracies
from ldbb_bayes.campaign.campaign import Campaign, CircularTest
from ldbb_bayes.machine.linear import compliance_jacobian, geometric_jacobian
from ldbb_bayes.machine.parameters import geometric_names
from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.model.terms import Drift

FORCES_N = (100.0, 400.0, 700.0)
ANGLE = np.arange(30) * 12.0


def waves(order: int, angle: np.ndarray) -> np.ndarray:
    """cos nθ and sin nθ as rows; of order 0 a row of ones."""
    return wave_columns(order, angle).T


def everything(*, arc_deg: float = 360.0) -> Campaign:
    """Three planes, two radii and centres, both directions in XY and YZ, two set-ups, times."""
    angle = ANGLE if arc_deg == 360.0 else np.linspace(0.0, arc_deg, 33)
    tests = []
    for i, plane in enumerate(("XY", "YZ", "ZX")):
        directions = ("CW",) if plane == "ZX" else ("CW", "CCW")
        for k, force in enumerate(FORCES_N):
            for direction in directions:
                tests.append(
                    CircularTest(
                        force,
                        angle,
                        plane=plane,
                        direction=direction,
                        radius_mm=(150.0, 100.0, 150.0)[k],
                        centre_x_mm=(0.0, 0.0, 20.0)[k],
                        centre_z_mm=-15.0,
                        setup=2 if plane == "YZ" else 1,
                        time_s=600.0 * len(tests) + 100.0 * k**2,
                        temperature_C=20.0 + 0.3 * i + 0.1 * k,
                        work_ball_deg=(0.0, 45.0, 0.0)[k],
                    )
                )
    return Campaign(
        tuple(tests),
        topology="wXFYZt",
        frames_mm={"X": (5.0, -40.0, 60.0), "Y": (0.0, 10.0, -200.0)},
    )


class DenseModel:
    """The model of a campaign by hand from the measurement model: no terms, basis or reduction.

    Columns of the parameters at the readings' own angles, and the covariance of all readings.
    """

    def __init__(self, bound: BoundModel, campaign: Campaign, phi: dict[str, float]) -> None:
        self.bound = bound
        self.tests = campaign.tests
        self.machine = campaign.machine()
        self.phi = phi
        self.angles = [np.deg2rad(test.angle_deg) for test in self.tests]
        self.compliance = [
            compliance_jacobian(self.machine, test.circle, theta, bound.compliances)
            for test, theta in zip(self.tests, self.angles, strict=True)
        ]

    def design(self) -> np.ndarray:
        """Columns of compliances, slopes and geometric errors, shape (readings, p)."""
        forces = np.array([test.force_N for test in self.tests])
        reference = 0.5 * (forces.min() + forces.max())
        rows = []
        for r, test in enumerate(self.tests):
            elastic = test.force_N * self.compliance[r]
            slope = (test.force_N - reference) * elastic
            rows.append(np.hstack([elastic, slope, self._geometry(r)]))
        return np.vstack(rows)

    def _geometry(self, r: int) -> np.ndarray:
        """Columns of the geometric errors; a tool offset only in its own set-up."""
        test = self.tests[r]
        errors = [name.label for name in geometric_names(self.machine)]
        values = geometric_jacobian(self.machine, test.circle, self.angles[r])
        by_error = dict(zip(errors, values.T, strict=True))
        columns = []
        for name in self.bound.names[2 * len(self.bound.compliances) :]:
            stem, _, suffix = name.partition("t0")
            if not suffix and stem not in ("E_X", "E_Y", "E_Z"):
                columns.append(by_error[name])
                continue
            setup = int(suffix[1:]) if suffix else 1
            columns.append(by_error[f"{stem}t0"] * (test.setup == setup))
        return np.stack(columns, axis=1)

    def covariance(self) -> np.ndarray:
        """Covariance of all readings given the parameters."""
        sizes = [len(theta) for theta in self.angles]
        ends = np.cumsum(sizes)
        blocks = [slice(end - size, end) for size, end in zip(sizes, ends, strict=True)]
        covariance = np.eye(ends[-1]) * self.phi["sigma"] ** 2
        shared: dict[tuple[Any, ...], np.ndarray] = {}
        for r, block in enumerate(blocks):
            for key, value in self._shared_columns(r).items():
                column = shared.setdefault(key, np.zeros(ends[-1]))
                column[block] = value
        for column in shared.values():
            covariance += np.outer(column, column)
        for r, block in enumerate(blocks):
            covariance[block, block] += self._private_covariance(r)
        return covariance

    def _shared_columns(self, r: int) -> dict[tuple[Any, ...], np.ndarray]:
        """Columns that tests share, times their sd, by what they are of."""
        test = self.tests[r]
        theta = self.angles[r]
        ones = np.ones(len(theta))
        deflection = self.compliance[r] @ self.bound.setting.compliance_estimate
        times = np.array([other.time_s for other in self.tests])
        hours = (test.time_s - times.mean()) / 3600.0
        columns: dict[tuple[Any, ...], np.ndarray] = {
            ("length", test.radius_mm): 9.4e-3 * ones,
            ("mount",): 0.233e-3 * test.pressure_bar * ones,
            ("gain",): 0.01 * test.force_N * deflection,
            ("drift",): 2e-3 * hours * ones,
            ("drift", test.plane[0]): 5e-3 * hours * np.cos(theta),
            ("drift", test.plane[1]): 5e-3 * hours * np.sin(theta),
        }
        turns = {"work": test.work_ball_deg, "tool": test.tool_ball_deg - 180.0}
        for ball, turn_deg in turns.items():
            for m in range(2, 13):
                sd = self.phi["tau"] / m / np.sqrt(2)
                for k, wave in enumerate(waves(m, theta - np.deg2rad(turn_deg))):
                    columns["form", test.plane, m, ball, k] = sd * wave
        if test.plane != "ZX":
            travel = 1.0 if test.direction == "CW" else -1.0
            for m in range(5):
                for k, wave in enumerate(waves(m, theta)):
                    hysteresis = travel * 2e-3 / max(m, 1) * wave
                    columns["hysteresis", test.plane, m, k] = hysteresis
                    columns["friction", test.plane, m, k] = hysteresis * test.force_N * 1e-3
        return columns

    def _private_covariance(self, r: int) -> np.ndarray:
        """Covariance of force error, set-up shift and discrepancy of one test."""
        deflection = 4.0 * self.compliance[r] @ self.bound.setting.compliance_estimate
        covariance = np.outer(deflection, deflection)
        for m in range(13):
            sd = self.phi["delta"] if m < 2 else self.phi["kappa"] / m
            for wave in waves(m, self.angles[r]):
                covariance += sd**2 * np.outer(wave, wave)
        return covariance


@pytest.mark.parametrize("arc_deg", [360.0, 250.0])
def test_against_a_dense_model(arc_deg: float) -> None:
    model = HybridModel.first(1).with_term(Drift("time"))
    hyper = {"sigma": 0.3, "delta": 0.5, "kappa": 0.3, "tau": 2.0}
    campaign = model.simulate(everything(arc_deg=arc_deg), seed=3, hyper_um=hyper).campaign
    bound = model.bind(campaign)
    phi_mm = {name: value * 1e-3 for name, value in hyper.items()}
    phi = np.array([[phi_mm[str(name)] for name in bound.hyper_prior.names]])
    dense = DenseModel(bound, campaign, phi_mm)
    design = dense.design()
    covariance = dense.covariance()
    sd = bound.prior_sd
    reading = np.concatenate([test.readings_mm() for test in campaign.tests])
    beta = bound.least_squares_estimate + 0.1 * bound.scale * np.random.default_rng(1).normal(
        size=len(bound.names)
    )
    log_likelihood = stats.multivariate_normal(design @ beta, covariance).logpdf(reading)
    assert bound.log_likelihood(phi, beta[None])[0] == pytest.approx(log_likelihood, abs=1e-5)
    predictive = covariance + (design * sd**2) @ design.T
    expected = stats.multivariate_normal(None, predictive).logpdf(reading)
    log_evidence, conditional = bound.given(phi)
    assert log_evidence[0] == pytest.approx(expected, abs=1e-5)
    gain = sd[:, None] ** 2 * design.T @ np.linalg.inv(predictive)
    mean = gain @ reading
    np.testing.assert_allclose((conditional.mean[0] - mean) / sd, 0.0, atol=1e-7)
    expected_covariance = np.diag(sd**2) - gain @ design * sd**2
    difference = conditional.covariance[0] - expected_covariance
    np.testing.assert_allclose(difference / np.outer(sd, sd), 0.0, atol=1e-7)


def test_clockwise_is_positive() -> None:
    setting = HybridModel.first(1).bind(everything()).setting
    signs = {"CW": 1.0, "CCW": -1.0}
    expected = [signs[str(test.direction)] for test in everything().tests]
    assert setting.travel.tolist() == expected


def test_one_direction_leaves_the_first_edition_as_it_was() -> None:
    one = replace(everything(), tests=tuple(t for t in everything().tests if t.direction == "CW"))
    bound = HybridModel.first(1).bind(one)
    assert "Hysteresis" not in bound.terms
    assert bound.nuisance_columns[-1].hyper == "kappa"


def test_models_that_do_not_suit_a_campaign_are_refused() -> None:
    plain = everything()
    silent = replace(plain, tests=(replace(plain.tests[0], direction=None), *plain.tests[1:]))
    refuses(r"'f100' must state its direction, CW or CCW", HybridModel.first(1).bind, silent)
    cold = replace(plain, tests=(replace(plain.tests[0], temperature_C=None), *plain.tests[1:]))
    with pytest.raises(
        lb.InputError, match=r"drift over temperature must have temperature_C in every test, got"
    ):
        _ = HybridModel.first(1).with_term(Drift("temperature")).bind(cold).terms
    refuses("Drift over must be one of time, temperature", Drift, "pressure")


def test_drift_of_a_sorted_campaign_is_stated() -> None:
    """Forces run in order at even times: a drift of the length looks like C_XXX and C_YYY; turned
    order, and it does not."""
    tests = tuple(
        CircularTest(f, np.arange(120) * 3.0, time_s=60.0 * k)
        for k, f in enumerate((100.0, 300.0, 500.0, 700.0))
    )
    model = HybridModel.first(1).with_term(Drift("time", length_um=20.0, centre_um=20.0))
    combinations = degeneracies(model.bind(Campaign(tests)))
    lengthwise = [d for d in combinations if d.nuisances and d.nuisances[0] == "drift_time_length"]
    assert lengthwise
    assert set(lengthwise[0].parameters) >= {"C_XXX", "C_YYY"}
    mixed = tuple(replace(t, time_s=60.0 * k) for t, k in zip(tests, (2, 0, 3, 1), strict=True))
    assert not [d for d in degeneracies(model.bind(Campaign(mixed))) if d.term == "Drift"]
