"""Campaigns of several planes, radii, centres, set-ups, directions and times: the model against a
dense one built here."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaigns import refuses
from scipy import stats

import ldbb_bayes as lb
from ldbb_bayes.analysis.aliases import degeneracies, standing_degeneracies
from ldbb_bayes.campaign.campaign import Campaign, CircularTest
from ldbb_bayes.machine.linear import compliance_jacobian, geometric_jacobian
from ldbb_bayes.machine.parameters import geometric_names
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.terms import Drift
from ldbb_bayes.report.wording import standing_words

FORCES_N = (100.0, 400.0, 700.0)
ANGLE = np.arange(30) * 12.0


def everything(*, arc_deg: float = 360.0) -> Campaign:
    """Three planes, two radii, two centres, both directions in XY and YZ, two set-ups, times and
    temperatures."""
    angle = ANGLE if arc_deg == 360.0 else np.linspace(0.0, arc_deg, 33)
    tests = []
    for i, plane in enumerate(("XY", "YZ", "ZX")):
        for k, force in enumerate(FORCES_N):
            for way in ("CW", "CCW") if plane != "ZX" else ("CW",):
                tests.append(
                    CircularTest(
                        force,
                        angle,
                        plane=plane,
                        direction=way,
                        radius_mm=100.0 if k == 1 else 150.0,
                        centre_x_mm=20.0 if k == 2 else 0.0,
                        centre_z_mm=-15.0,
                        setup=2 if plane == "YZ" else 1,
                        time_s=600.0 * len(tests) + 100.0 * k**2,
                        temperature_C=20.0 + 0.3 * i + 0.1 * k,
                        work_ball_deg=45.0 * (k == 1),
                    )
                )
    return Campaign(
        tuple(tests),
        topology="wXFYZt",
        frames_mm={"X": (5.0, -40.0, 60.0), "Y": (0.0, 10.0, -200.0)},
    )


def dense(
    bound: object, campaign: Campaign, phi: dict[str, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Columns of the parameters at the readings' own angles, and the covariance of all readings by
    hand from the measurement model: nothing of terms, basis or reduction."""
    forces = np.array([t.force_N for t in campaign.tests])
    reference = 0.5 * (forces.min() + forces.max())
    machine = campaign.machine()
    errors = [name.label for name in geometric_names(machine)]
    rows = []
    parts = []
    own: dict[tuple, list[np.ndarray]] = {}
    start = 0
    hours = np.array([t.time_s for t in campaign.tests]) / 3600.0
    for r, t in enumerate(campaign.tests):
        theta = np.deg2rad(t.angle_deg)
        way = 1.0 if t.direction == "CW" else -1.0
        n = len(t.angle_deg)
        c = compliance_jacobian(machine, t.circle, theta, bound.compliances)
        g = dict(zip(errors, geometric_jacobian(machine, t.circle, theta).T, strict=True))
        geometry = []
        for name in bound.names[2 * len(bound.compliances) :]:
            stem, _, setup = name.partition("t0")
            if setup or stem in ("E_X", "E_Y", "E_Z"):
                mine = t.setup == (int(setup[1:]) if setup else 1)
                geometry.append(g[f"{stem}t0"] if mine else np.zeros(n))
            else:
                geometry.append(g[name])
        rows.append(
            np.hstack(
                [t.force_N * c, t.force_N * (t.force_N - reference) * c, np.stack(geometry, axis=1)]
            )
        )
        columns = {
            ("length", t.radius_mm): 9.4e-3 * np.ones(n),
            ("mount",): 0.233e-3 * t.pressure_bar * np.ones(n),
        }
        columns[("gain",)] = 0.01 * t.force_N * c @ bound.setting.compliance_estimate
        for m in range(2, 13):
            for ball, turn in (("w", t.work_ball_deg), ("t", t.tool_ball_deg - 180.0)):
                for trig in (np.cos, np.sin):
                    value = phi["tau"] / m / np.sqrt(2) * trig(m * (theta - np.deg2rad(turn)))
                    columns[("form", t.plane, m, ball, trig.__name__)] = value
        if t.plane != "ZX":
            for m in range(5):
                for trig in (np.cos, np.sin)[: 1 if m == 0 else 2]:
                    value = way * 2e-3 / max(m, 1) * trig(m * theta)
                    columns[("way", t.plane, m, trig.__name__)] = value
                    columns[("friction", t.plane, m, trig.__name__)] = value * t.force_N * 1e-3
        u = hours[r] - hours.mean()
        columns[("drift",)] = 2e-3 * u * np.ones(n)
        for axis, value in zip(t.plane, (np.cos(theta), np.sin(theta)), strict=True):
            columns[("drift", axis)] = 5e-3 * u * value
        parts.append((slice(start, start + n), t, theta, c))
        for key, value in columns.items():
            own.setdefault(key, []).append((slice(start, start + n), value))
        start += n
    covariance = np.eye(start) * phi["sigma"] ** 2
    for blocks in own.values():
        column = np.zeros(start)
        for part, value in blocks:
            column[part] = value
        covariance += np.outer(column, column)
    for part, _t, theta, c in parts:
        deflection = 4.0 * c @ bound.setting.compliance_estimate
        covariance[part, part] += np.outer(deflection, deflection)
        for m in range(13):
            scale = phi["delta"] if m < 2 else phi["kappa"] / m
            for trig in (np.cos, np.sin)[: 1 if m == 0 else 2]:
                covariance[part, part] += scale**2 * np.outer(trig(m * theta), trig(m * theta))
    return np.vstack(rows), covariance


@pytest.mark.parametrize("arc_deg", [360.0, 250.0])
def test_against_a_dense_model(arc_deg: float) -> None:
    model = HybridModel.first(1).with_term(Drift("time"))
    hyper = {"sigma": 0.3, "delta": 0.5, "kappa": 0.3, "tau": 2.0}
    campaign = model.simulate(everything(arc_deg=arc_deg), seed=3, hyper_um=hyper).campaign
    bound = model.bind(campaign)
    phi = np.array([[hyper[str(name)] * 1e-3 for name in bound.hyper_prior.names]])
    design, covariance = dense(
        bound, campaign, {name: value * 1e-3 for name, value in hyper.items()}
    )
    reading = np.concatenate([t.readings_mm() for t in campaign.tests])
    beta = bound.centre + 0.1 * bound.scale * np.random.default_rng(1).normal(size=len(bound.names))
    expected = stats.multivariate_normal(design @ beta, covariance).logpdf(reading)
    assert bound.log_likelihood(phi, beta[None])[0] == pytest.approx(expected, abs=1e-5)
    evidence = stats.multivariate_normal(
        None, covariance + (design * bound.prior_sd**2) @ design.T
    ).logpdf(reading)
    found, given = bound.given(phi)
    assert found[0] == pytest.approx(evidence, abs=1e-5)
    gain = (
        bound.prior_sd[:, None] ** 2
        * design.T
        @ np.linalg.inv(covariance + (design * bound.prior_sd**2) @ design.T)
    )
    mean = gain @ reading
    spread = given.spread()[0]
    after = np.diag(bound.prior_sd**2) - gain @ design * bound.prior_sd**2
    np.testing.assert_allclose((given.mean[0] - mean) / bound.prior_sd, 0.0, atol=1e-7)
    np.testing.assert_allclose(
        (spread @ spread.T - after) / np.outer(bound.prior_sd, bound.prior_sd), 0.0, atol=1e-7
    )


def test_clockwise_is_positive() -> None:
    setting = HybridModel.first(1).bind(everything()).setting
    assert [
        {"CW": 1.0, "CCW": -1.0}[test.direction or ""] for test in everything().tests
    ] == setting.travel.tolist()


def test_one_direction_leaves_the_model_as_it_was() -> None:
    one = replace(everything(), tests=tuple(t for t in everything().tests if t.direction == "CW"))
    bound = HybridModel.first(1).bind(one)
    assert "Hysteresis" not in bound.terms
    assert bound.nuisance_columns[-1].hyper == "kappa"
    notes = tuple(map(standing_words, standing_degeneracies(bound, degeneracies(bound))))
    assert any("looks exactly like C_XYX, C_XZX and C_YZY" in note for note in notes)
    both = tuple(
        map(standing_words, standing_degeneracies(HybridModel.first(1).bind(everything()), ()))
    )
    assert any("looks exactly like C_XZX " in note for note in both)


def test_refused() -> None:
    plain = everything()
    silent = replace(plain, tests=(replace(plain.tests[0], direction=None), *plain.tests[1:]))
    refuses(r"'f100' must state its direction, CW or CCW", HybridModel.first(1).bind, silent)
    timeless = replace(plain, tests=(replace(plain.tests[0], time_s=None), *plain.tests[1:]))
    with pytest.raises(
        lb.InputError, match=r"drift over time must have time_s in every test, got 1 without"
    ):
        _ = HybridModel.first(1).with_term(Drift("time")).bind(timeless).terms
    refuses("Drift over must be one of time, temperature", Drift, "pressure")


def test_drift_of_a_sorted_campaign_is_stated() -> None:
    """Forces run in order at even times: a drift of the length looks like C_XXX and C_YYY; turned
    order, and it does not."""
    tests = tuple(
        CircularTest(f, np.arange(120) * 3.0, time_s=60.0 * k)
        for k, f in enumerate((100.0, 300.0, 500.0, 700.0))
    )
    model = HybridModel.first(1).with_term(Drift("time", length_um=20.0, centre_um=20.0))
    found = degeneracies(model.bind(Campaign(tests)))
    lengthwise = [d for d in found if d.nuisances and d.nuisances[0] == "drift_time_length"]
    assert lengthwise
    assert set(lengthwise[0].parameters) >= {"C_XXX", "C_YYY"}
    mixed = tuple(replace(t, time_s=60.0 * k) for t, k in zip(tests, (2, 0, 3, 1), strict=True))
    assert not [d for d in degeneracies(model.bind(Campaign(mixed))) if d.term == "Drift"]
