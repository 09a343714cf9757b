"""Simulation-based calibration of every sampler, and of models that are wrong; its band against
simulation."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from campaigns import cases, plan, refuses

import ldbb_bayes as lb
from ldbb_bayes.analysis.calibration import LOG_LIKELIHOOD, Validation, _values_without_effect
from ldbb_bayes.analysis.rank_uniformity import ecdf, simultaneous_band
from ldbb_bayes.report.wording import validation_verdict

FORCES_N = (36.0, 238.0, 490.0, 742.0)
CIRCLES = plan((60,) * 4, forces_N=FORCES_N)
ARCS = plan((60, 45, 60, 30), forces_N=FORCES_N, arc_deg=240.0, work_deg=40.0)
CONSTANT = lb.HybridModel.first(0)


def made(ranks: np.ndarray, draws: int = 99) -> Validation:
    return Validation(
        tuple(f"q{k}" for k in range(ranks.shape[1])), ranks, draws, "independent", 0.99, ()
    )


@pytest.mark.slow
def test_uniform_ranks_are_calibrated_and_others_not() -> None:
    rng = np.random.default_rng(0)
    uniform = rng.integers(0, 100, (300, 20))
    assert made(uniform).calibrated
    shifted = uniform.copy()
    shifted[:, 3] = np.minimum(shifted[:, 3] + 15, 99)
    assert made(shifted).outside == ("q3",)
    assert "the ranks of q3 leave the band" in validation_verdict(made(shifted))
    narrow = uniform.copy()
    narrow[:, 5] = np.where(
        rng.random(300) < 0.3, np.where(rng.random(300) < 0.5, 0, 99), narrow[:, 5]
    )
    assert made(narrow).outside == ("q5",)


def test_coverage_counts_intervals() -> None:
    """All hundred ranks once: exactly what every interval claims."""
    coverage = made(np.arange(100)[:, None]).coverage().iloc[0]
    assert (coverage["50"], coverage["80"], coverage["95"]) == pytest.approx((0.5, 0.8, 0.95))
    assert coverage["u50"] == pytest.approx(0.05)


@pytest.mark.slow
def test_executors_change_nothing() -> None:
    """Processes are the business of `tests/fleet`."""
    model = CONSTANT.without("truncation")
    arguments = {"replicates": 10, "draws": 9, "seed": 3}
    serial = lb.calibrate(model, CIRCLES, **arguments)
    assert serial.names == (
        *model.bind(CIRCLES).names,
        "sigma",
        "delta",
        "kappa",
        "tau",
        LOG_LIKELIHOOD,
    )
    with ThreadPoolExecutor(3) as threads:
        np.testing.assert_array_equal(
            lb.calibrate(model, CIRCLES, executor=threads, **arguments).ranks, serial.ranks
        )
    record = serial.as_dict()
    assert (record["replicates"], record["band_probability"], "ranks" in record) == (
        10,
        0.99,
        False,
    )
    assert record["quantities"]["sigma"]["coverage"]["50"] == serial.coverage().loc["sigma", "50"]


FLAT = (
    {"model": lb.HybridModel.paper(0)},
    "validation must start from proper priors, got flat ones",
)


OTHER_FORCE = (
    {"generator": replace(CONSTANT, reference_force_N=36.0)},
    "reference force of the model that is validated, 389 N, got 36 N",
)


@pytest.mark.parametrize(
    ("arguments", "message"), [*cases(__file__, "refusals.toml")["validate"], FLAT, OTHER_FORCE]
)
def test_calibrations_that_cannot_be_are_refused(arguments: dict, message: str) -> None:
    refuses(message, lb.calibrate, **({"model": CONSTANT, "plan": CIRCLES} | arguments))


@pytest.mark.parametrize(("replicates", "draws", "prob"), [(100, 99, 0.9), (12, 9, 0.99)])
def test_holds_with_the_probability_it_claims(replicates: int, draws: int, prob: float) -> None:
    lower, upper = simultaneous_band(replicates, draws, prob)
    rng = np.random.default_rng(1)
    ecdfs = np.array([ecdf(rng.integers(0, draws + 1, replicates), draws) for _ in range(4000)])
    share = np.mean(np.all((ecdfs >= lower) & (ecdfs <= upper), axis=1))
    error = np.sqrt(prob * (1.0 - prob) / 4000)
    assert prob - 4.0 * error < share < prob + 4.0 * error + 0.03, (
        "counts are whole: a little more than asked for"
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("degree", "planned", "replicates"),
    [(1, CIRCLES, 200), (0, ARCS, 100)],
    ids=["linear, circles", "constant, arcs"],
)
def test_quadrature_is_calibrated(degree: int, planned: lb.Campaign, replicates: int) -> None:
    validation = lb.calibrate(lb.HybridModel.first(degree), planned, replicates=replicates, seed=11)
    assert validation.calibrated, validation.outside


@pytest.mark.slow
def test_what_a_generator_lacks_has_no_effect() -> None:
    """Circles that scatter alike have a factor of one, and not of zero."""
    assert lb.HybridModel.default(0).bind(CIRCLES).setting.circle[0]
    model = lb.HybridModel.default(0)
    hyper_prior = model.bind(CIRCLES).hyper_prior
    values = _values_without_effect(hyper_prior)
    for name, law in zip(hyper_prior.names, hyper_prior.laws, strict=True):
        expected = {"circle": 1.0, "decay": 2.0}.get(law, 0.0)
        assert values[name] == pytest.approx(expected, abs=0.1), name
    generator = model.without("circle-scale")
    validation = lb.calibrate(model, CIRCLES, generator=generator, replicates=20, draws=19, seed=3)
    for name in (name for name in validation.names if name.startswith("lambda")):
        ranks = validation.ranks[:, validation.names.index(name)]
        assert 0.2 * 19 < ranks.mean() < 0.8 * 19


@pytest.mark.slow
def test_emcee_is_calibrated_and_a_wrong_model_is_not() -> None:
    """Readings with a discrepancy that the model lacks: intervals far too narrow, and the ranks say
    so."""
    validation = lb.calibrate(CONSTANT, CIRCLES, replicates=100, draws=49, sampler="joint", seed=12)
    assert validation.calibrated, validation.outside
    validation = lb.calibrate(
        CONSTANT.without("discrepancy"), CIRCLES, generator=CONSTANT, replicates=100, seed=13
    )
    assert {"C_CXY", "C_CYY", LOG_LIKELIHOOD} & set(validation.outside)


def test_the_band_holds_for_all_quantities_together(rng: np.random.Generator) -> None:
    """Of uniform ranks of twenty quantities nine in ten stay inside the 90 % band; were it that of
    one alone, 0.9²⁰ would."""
    names = tuple(f"q{k}" for k in range(20))
    ranks = rng.integers(0, 20, size=(300, 40, len(names)))
    calibrated = [
        Validation(names, replicate_ranks, 19, "independent", 0.9, ()).calibrated
        for replicate_ranks in ranks
    ]
    assert 0.86 < np.mean(calibrated) <= 1.0


def test_ecdf_counts_ranks() -> None:
    np.testing.assert_allclose(ecdf(np.array([0, 0, 3, 4]), 4), [0.5, 0.5, 0.5, 0.75])
