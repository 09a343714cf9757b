"""Differences between campaigns: independent ones by hand, those of one instrument by a dense model of both at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaigns import HYPER_UM, TRUTH, plan

import ldbb_bayes as lb
from ldbb_bayes.inference.posterior import bound_of, draws_of
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.terms import BasisNoise, Columns

SAME = {name: value for name, value in HYPER_UM.items() if name != "tau"}
MODEL = lb.HybridModel.default(1).without("truncation")


def posterior_of(seed: int, model: lb.HybridModel = MODEL, **options: object) -> object:
    radii = options.pop("radius_mm", ())
    planned = plan(**options)  # type: ignore[arg-type]
    if radii:
        radii = radii if isinstance(radii, tuple) else (radii,)
        tests = [replace(test, radius_mm=r, name=f"{test.name} {r:g}") for r in radii for test in planned.tests]
        planned = replace(planned, tests=tuple(tests))
    campaign = lb.HybridModel.default(0).simulate(planned, seed=seed, parameters=TRUTH, hyper_um=HYPER_UM).campaign
    return lb.sample(model, campaign, seed=1, sampler="independent")


@pytest.fixture(scope="module")
def two() -> tuple[object, object]:
    return posterior_of(1), posterior_of(2, forces_N=(50.0, 200.0, 400.0, 800.0))


def test_independent_instruments(two: tuple[object, object]) -> None:
    first, second = two
    table = lb.differences(first, second)  # type: ignore[arg-type]
    one, other = (lb.summarize(posterior) for posterior in two)  # type: ignore[arg-type]
    for name in ("E_XX1", "E_YX2", "C_XXX_1", "C_CCY_1"):
        assert table.loc[name, "difference"] == pytest.approx(other.loc[name, "mean"] - one.loc[name, "mean"], rel=1e-6)
        assert table.loc[name, "sd"] == pytest.approx(np.hypot(one.loc[name, "sd"], other.loc[name, "sd"]), rel=1e-3)
        half = 0.5 * (table.loc[name, "ci_high"] - table.loc[name, "ci_low"])
        assert half == pytest.approx(1.96 * table.loc[name, "sd"], rel=0.08)
    # C is compared at the first one's reference force, 389 N; the second one's is 425 N.
    draws = second["posterior"]  # type: ignore[index]
    moved = (draws["C_XXX"] - 36.0 * draws["C_XXX_1"]).to_numpy()
    assert table.loc["C_XXX", "second"] == pytest.approx(moved.mean(), rel=1e-9)
    assert not any(name.startswith(("E_Xt", "E_Yt")) for name in table.index)
    row = table.loc["C_XYX"]
    assert 0.0 <= row["probability_of_increase"] <= 1.0
    assert (row["probability_of_increase"] > 0.5) == (row["difference"] > 0.0)


def dense(two: tuple[object, object], *, two_balls: bool = False) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Posterior of both parameter vectors from all readings stacked: y = J₁ β₁ + J₂ β₂ + N ν + noise, N shared by both."""
    bounds = [bound_of(posterior) for posterior in two]  # type: ignore[arg-type]
    if two_balls:
        for bound in bounds:
            bound.setting = replace(bound.setting, two_balls=True)
    phi = [draws_of(posterior, bound)[1].mean(axis=0) for posterior, bound in zip(two, bounds, strict=True)]  # type: ignore[arg-type]
    tau = bounds[0].hyper_prior.names.index("tau")
    phi[0][tau] = phi[1][tau] = 0.5 * (phi[0][tau] + phi[1][tau])
    designs, shared, noises, readings = [], [], [], []
    for bound, values in zip(bounds, phi, strict=True):
        value = dict(zip(bound.hyper_prior.names, values, strict=True))
        turns = [basis(test.angles_rad()) for test in bound.campaign.tests]
        designs.append(np.concatenate([own @ bound.interest[r] for r, own in enumerate(turns)]))
        readings.append(np.concatenate([test.readings_mm() for test in bound.campaign.tests]))
        noise, columns = [], []
        for r, own in enumerate(turns):
            covariance = np.eye(len(own)) * value["sigma"] ** 2
            for term in bound.model.nuisances:
                for part in term.columns(bound.setting):
                    if isinstance(part, BasisNoise):
                        scaled = own * part.sd * value[part.hyper]
                    elif part.private:
                        scaled = own @ part.values[r] * part.sd * (value[part.hyper] if part.hyper else 1.0)
                    else:
                        continue
                    covariance = covariance + scaled @ scaled.T
            noise.append(covariance)
            columns.append(
                np.concatenate(
                    [
                        own @ part.values[r] * part.sd * (value[part.hyper] if part.hyper else 1.0)
                        for term in bound.model.nuisances
                        for part in term.columns(bound.setting)
                        if isinstance(part, Columns) and not part.private
                    ],
                    axis=1,
                )
            )
        shared.append(np.concatenate(columns))
        noises.append(noise)
    n, p = [len(own) for own in readings], [own.shape[1] for own in designs]
    jacobian = np.zeros((sum(n), sum(p)))
    jacobian[: n[0], : p[0]], jacobian[n[0] :, p[0] :] = designs
    every = np.concatenate(shared)
    covariance = every @ every.T
    start = 0
    for block in (own for noise in noises for own in noise):
        rows = slice(start, start + len(block))
        covariance[rows, rows] += block
        start += len(block)
    prior = np.concatenate([bound.prior_sd for bound in bounds])
    scaled = jacobian * prior
    total = covariance + scaled @ scaled.T
    gain = np.linalg.solve(total, scaled).T * prior[:, None]
    mean = gain @ np.concatenate(readings)
    return mean, np.diag(prior**2) - gain @ (jacobian * prior**2), [*bounds[0].names, *bounds[1].names]


def test_the_same_instrument() -> None:
    """Against the dense model of both campaigns at once, forces alike."""
    both = (posterior_of(1), posterior_of(2))
    table = lb.differences(*both, same_instrument=True)  # type: ignore[arg-type]
    mean, covariance, names = dense(both)
    p = len(names) // 2
    for name in table.index:
        i = names.index(name)
        apart = np.zeros(2 * p)
        apart[i], apart[p + i] = -1.0, 1.0
        sd = float(np.sqrt(apart @ covariance @ apart))
        assert table.loc[name, "sd"] == pytest.approx(sd, rel=2e-4), name
        assert table.loc[name, "difference"] == pytest.approx(apart @ mean, abs=2e-3 * sd), name
        assert table.loc[name, "ci_high"] - table.loc[name, "difference"] == pytest.approx(1.96 * sd, rel=1e-3)
    independent = lb.differences(*both)  # type: ignore[arg-type]
    assert table.loc["E_XX1", "sd"] < 0.4 * independent.loc["E_XX1", "sd"]
    assert (table["sd"] < 1.05 * independent["sd"]).all()


def test_balls_turned_in_one_of_them() -> None:
    """The same balls: their forms are shared although only one campaign turns them; against the dense model of both balls."""
    both = (posterior_of(1), posterior_of(2, work_deg=40.0))
    table = lb.differences(*both, same_instrument=True)  # type: ignore[arg-type]
    mean, covariance, names = dense(both, two_balls=True)
    p = len(names) // 2
    for name in ("E_C0YX", "E_YX2", "E_XX1", "C_CCY"):
        apart = np.zeros(2 * p)
        apart[names.index(name)], apart[p + names.index(name)] = -1.0, 1.0
        sd = float(np.sqrt(apart @ covariance @ apart))
        assert table.loc[name, "sd"] == pytest.approx(sd, rel=2e-4), name
        assert table.loc[name, "difference"] == pytest.approx(apart @ mean, abs=2e-3 * sd), name


def test_another_radius_is_another_length() -> None:
    """One length at 150 mm in both cancels, those of 150 and 100 mm do not."""
    first, shorter = posterior_of(1), posterior_of(2, radius_mm=100.0)
    alone = lb.differences(first, shorter, same_instrument=True).loc["E_XX1", "sd"]  # type: ignore[arg-type]
    independent = lb.differences(first, shorter).loc["E_XX1", "sd"]  # type: ignore[arg-type]
    assert alone > 0.9 * independent
    both_radii = lb.differences(first, posterior_of(3, radius_mm=(150.0, 100.0)), same_instrument=True)  # type: ignore[arg-type]
    assert both_radii.loc["E_XX1", "sd"] < 0.4 * alone


def test_two_instruments_taken_for_one() -> None:
    """Campaigns simulated with forms of their own disagree about them; with one form they do so at p below 1 % hardly ever."""
    table = lb.differences(posterior_of(1), posterior_of(2), same_instrument=True)  # type: ignore[arg-type]
    name, p = table.attrs["conflict"]
    assert name.startswith("form_")
    assert p < 1e-6
    assert lb.differences(posterior_of(1), posterior_of(2)).attrs["conflict"] is None  # type: ignore[arg-type]
    one_form = lb.HybridModel.default(0).without("ball-form", "bar-length")
    told = []
    for seed in range(3, 9):
        both = [
            lb.sample(
                MODEL,
                one_form.simulate(plan(), seed=own, parameters=TRUTH, hyper_um=SAME).campaign,
                seed=1,
                sampler="independent",
            )
            for own in (seed, seed + 100)
        ]
        told.append(lb.differences(*both, same_instrument=True).attrs["conflict"][1])
    assert min(told) > 0.01 / len(told)


def test_refused(two: tuple[object, object]) -> None:
    campaign = replace(plan(), topology="wYFXZt")
    model = lb.HybridModel.default(0)
    other = lb.sample(model, model.simulate(campaign, seed=1).campaign, sampler="independent")
    with pytest.raises(lb.InputError, match="same topology"):
        lb.differences(two[0], other)  # type: ignore[arg-type]
    flat = posterior_of(1, lb.HybridModel.paper(0))
    with pytest.raises(lb.InputError, match="different readings"):
        lb.differences(flat, flat)  # type: ignore[arg-type]
    with pytest.raises(lb.InputError, match="proper priors"):
        lb.differences(flat, posterior_of(2, lb.HybridModel.paper(0)), same_instrument=True)  # type: ignore[arg-type]
