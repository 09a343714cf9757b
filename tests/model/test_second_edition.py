"""The second edition of the model against the dense oracle: every term alone and all together, on
campaigns of every kind."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from campaigns import TRUTH, oracle_of
from oracle import Oracle, Stated

import ldbb_bayes as lb
from ldbb_bayes.campaign.campaign import Ball, Campaign, CircularTest, Instrument, MountCompensation
from ldbb_bayes.inference.coefficients import compliance_curves
from ldbb_bayes.inference.integrals import Integral
from ldbb_bayes.inference.nodes import HyperPosterior, Nodes
from ldbb_bayes.inference.related_models import RelatedModels
from ldbb_bayes.model.hybrid import BoundModel

TERMS = {
    "ball-form": "form",
    "machine-pattern": "pattern",
    "bar-length": "length",
    "mount": "mount",
    "force-error": "force",
    "joint-load": "joint",
    "position": "position",
    "angle": "angle",
    "setup-shift": "setup",
    "discrepancy": "discrepancy",
    "hysteresis": "hysteresis",
    "circle-scale": "circle",
}
CERTIFIED = Instrument(
    work=Ball(grade="G20", harmonics_um=((2, 0.3, 35.0), (7, 0.1, -50.0)), U_um=0.08),
    tool=Ball(sphericity_um=0.7, harmonics_um=((3, 0.2, 110.0),), U_um=0.05),
    bar_length_error_um=-3.0,
    bar_U_um=1.2,
    mount_U_percent=2.0,
    force_U_percent=0.6,
    force_linearity_percent=0.3,
    force_random_N=1.5,
    angle_U_deg=0.05,
)
STATED = Stated(
    sphericity_um={"work": 0.5, "tool": 0.7},
    harmonics_um={
        "work": {2: (0.3, 35.0, 0.08), 7: (0.1, -50.0, 0.08)},
        "tool": {3: (0.2, 110.0, 0.05)},
    },
    length_error_um=-3.0,
    length_U_um=1.2,
    mount_U_percent=2.0,
    force_U_percent=0.6,
    linearity_percent=0.3,
    random_N=1.5,
    angle_U_deg=0.05,
)


def made(
    tests: int = 4,
    *,
    arc: bool = False,
    turns: Sequence[float] = (0.0, 0.0),
    ways: str = "",
    radii: Sequence[float] = (150.0,),
) -> Campaign:
    """Readings of a machine with waves and noise that are of no model; clockings grow by ``turns``
    from test to test."""
    angle = np.linspace(-10.0, 230.0, 36) if arc else np.arange(36) * 10.0
    circles = tuple(
        CircularTest(
            force,
            angle + 0.7 * i,
            np.zeros(36),
            work_ball_deg=turns[0] * i + 15.0,
            tool_ball_deg=turns[1] * i,
            radius_mm=radii[i % len(radii)],
            direction={"+": "CW", "-": "CCW"}[ways[i % len(ways)]] if ways else None,
        )
        for i, force in enumerate(np.linspace(742.0, 36.0, tests))
    )
    silent = Campaign(circles, mount=MountCompensation(compensated=False))
    machine = oracle_of(silent, 0, terms=())
    rng = np.random.default_rng(tests)
    reading = machine.J @ [TRUTH[name] for name in machine.names] - machine.y
    waves = np.cos(np.outer(machine.theta, [2, 4, 5])) @ [2e-3, 1e-3, 1e-3] + 5e-4 * rng.normal(
        size=reading.size
    )
    each = np.split((reading + waves) * 1e3, tests)
    return replace(
        silent,
        tests=tuple(t.with_reading_um(own) for t, own in zip(silent.tests, each, strict=True)),
    )


CAMPAIGNS = {
    "circles": made(),
    "three arcs": made(3, arc=True),
    "one ball clocked": made(5, turns=(40.0, 0.0)),
    "both balls clocked": made(arc=True, turns=(40.0, -25.0)),
    "both directions": made(6, ways="+-", radii=(150.0, 150.0, 100.0)),
    "all at once": replace(
        made(8, arc=True, turns=(0.0, 70.0), ways="++-", radii=(150.0, 100.0)), instrument=CERTIFIED
    ),
    "certified": replace(made(ways="-"), instrument=CERTIFIED),
}


def both(
    campaign: Campaign, degree: int, terms: Sequence[str]
) -> tuple[BoundModel, Oracle, dict[str, float], np.ndarray]:
    """The package's model and the oracle with these terms alone, and hyper-parameters by name and
    in the package's order."""
    bound = (
        lb.HybridModel.default(degree)
        .without(*(name for name in TERMS if name not in terms))
        .bind(campaign)
    )
    stated = STATED if campaign.instrument == CERTIFIED else Stated()
    oracle = oracle_of(
        campaign,
        degree,
        terms=tuple(TERMS[name] for name in terms),
        edition="second",
        stated=stated,
    )
    rng = np.random.default_rng(len(campaign.tests) + degree + len(terms))
    usual = {"sigma": 4e-4, "delta": 6e-4, "kappa": 4e-4, "tau": 1e-3, "omega": 5e-4, "eta": 8e-4}
    phi = {name: usual.get(name, 1.0) * float(np.exp(0.5 * rng.normal())) for name in oracle.hypers}
    phi |= {"p": float(rng.uniform(0.6, 3.4))} if "p" in phi else {}
    named = {f"lambda_{test.name}": f"lambda_{r + 1}" for r, test in enumerate(campaign.tests)} | {
        "decay": "p"
    }
    assert {named.get(name, name) for name in bound.hyper_prior.names} == set(phi)
    return (
        bound,
        oracle,
        phi,
        np.array([phi[named.get(name, name)] for name in bound.hyper_prior.names]),
    )


def check(bound: BoundModel, oracle: Oracle, phi: dict[str, float], own: np.ndarray) -> None:
    """ln p(y | φ), ln p(y | φ, β), β given y and φ, and the prior of φ, of parameters in any
    order."""
    place = [oracle.names.index(name) for name in bound.names]
    sd, (expected, mean, covariance) = oracle.sd[place], oracle.given(phi)
    np.testing.assert_allclose(bound.prior_sd, sd, rtol=1e-8)
    log_evidence, given = bound.given(own[None])
    assert log_evidence[0] == pytest.approx(expected, rel=1e-8)
    np.testing.assert_allclose((given.mean[0] - mean[place]) / sd, 0.0, atol=1e-8)
    np.testing.assert_allclose(
        np.linalg.norm(given.spread()[0], axis=1), np.sqrt(np.diag(covariance))[place], rtol=1e-8
    )
    beta = mean[place] + 0.1 * sd
    named = dict(zip(bound.names, beta, strict=True))
    assert bound.log_likelihood(own[None], beta[None])[0] == pytest.approx(
        oracle.log_likelihood(phi, named), rel=1e-8
    )
    prior = bound.hyper_prior
    assert prior.log_density(own) == pytest.approx(oracle.log_prior(phi), rel=1e-10)
    free = prior.free(own)
    slopes = [
        (prior.phi(free + step) - prior.phi(free - step))[k] / 2e-5
        for k, step in enumerate(1e-5 * np.eye(len(own)))
    ]
    assert prior.log_density_of_free(free) == pytest.approx(
        oracle.log_prior(phi) + np.log(slopes).sum(), rel=1e-8
    )


@pytest.mark.parametrize("degree", [0, 1, 2])
@pytest.mark.parametrize("name", CAMPAIGNS)
def test_all_terms_together(name: str, degree: int) -> None:
    check(*both(CAMPAIGNS[name], degree, list(TERMS)))


@pytest.mark.parametrize("term", TERMS)
@pytest.mark.parametrize("name", ["circles", "both directions", "all at once"])
def test_every_term_alone_and_left_out(name: str, term: str) -> None:
    check(*both(CAMPAIGNS[name], 1, [term]))
    check(*both(CAMPAIGNS[name], 1, [other for other in TERMS if other != term]))


def test_force_curves_with_joint_load() -> None:
    """C_aa(F) by dense algebra, where the coefficients of the joint load are parameters beside the
    others."""
    bound, oracle, phi, own = both(CAMPAIGNS["circles"], 1, list(TERMS))
    dense = oracle_of(
        bound.campaign, 1, terms=tuple(set(TERMS.values()) - {"joint"}), edition="second"
    )
    columns, sd = zip(*oracle.joint_columns(), strict=True)
    dense.J, dense.sd, dense.mean = (
        np.column_stack([dense.J, *columns]),
        np.append(dense.sd, sd),
        np.append(dense.mean, 4 * [0]),
    )
    _, mean, covariance = dense.given(phi)
    rng = np.random.default_rng(1)
    force = np.array([36.0, 150.0, 389.0, 742.0])
    every = np.tile(own, (40_000, 1))
    beta = bound.given(own[None])[1].draw(rng, (40_000,))[:, 0]
    plain = bound.model.without("joint-load").bind(bound.campaign)
    slopes, found = (compliance_curves(model, every, beta, force, rng) for model in (plain, bound))
    along = np.stack(
        [np.ones(4), force - 389.0, (force - 389.0) / 742.0, np.cbrt(389.0 / force) - 1.0], axis=1
    )
    for k, axis, first in ((0, "C_XXX", -4), (2, "C_YYY", -2)):
        index = [dense.names.index(axis), dense.names.index(f"{axis}_1"), first, first + 1]
        u = np.sqrt(np.diag(along @ covariance[np.ix_(index, index)] @ along.T))
        np.testing.assert_allclose(
            (found[:, :, k].mean(axis=0) - along @ mean[index]) / u, 0.0, atol=0.02
        )
        np.testing.assert_allclose(found[:, :, k].std(axis=0), u, rtol=0.015)
        assert abs(slopes[:, 0, k].std() / u[0] - 1.0) > 0.1
    # At F0, to the rounding of the sum with slopes times zero.
    np.testing.assert_allclose(found[:, 2], beta[:, :6], rtol=1e-14)
    np.testing.assert_array_equal(found[:, :, [1, 3, 4, 5]], slopes[:, :, [1, 3, 4, 5]])


@pytest.mark.parametrize("name", ["circles", "both directions", "all at once"])
def test_without_rivals_of_slopes(name: str) -> None:
    """ln p(y | φ) of the fullest model, conditioned on some coefficients being zero, against the
    oracle without their columns."""
    bound, oracle, phi, own = both(CAMPAIGNS[name], 1, list(TERMS))
    zero = np.zeros(1)
    integral = Integral(
        bound.hyper_prior.free(own)[None], zero, zero, zero.astype(int), zero > 1.0, None
    )
    related = RelatedModels(Nodes(HyperPosterior(bound, truncated=False), integral), 1.0)
    for kept, degree in itertools.product(
        [(), ("joint load",), ("curved mount",), ("curved force law",)], [0, 1]
    ):
        without = bound.model.with_rivals(*kept).with_degree(degree).bind(bound.campaign)
        stated = (
            oracle.stated
            if "curved force law" in kept
            else replace(oracle.stated, linearity_percent=0.0)
        )
        terms = tuple(term for term in TERMS.values() if term != "joint" or "joint load" in kept)
        dense = oracle_of(bound.campaign, degree, terms=terms, edition="second", stated=stated)
        if "curved mount" not in kept:
            dense.grams[(), 0] = dense.grams[(), 0] - np.outer(dense.bow, dense.bow) * 0.5e-3**2
        found = (
            bound.log_evidence(own[None])
            + related._change_prior(without, [], np.arange(1)).log_ratio
        )
        assert found[0] == pytest.approx(dense.given(phi)[0], rel=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["three arcs", "both directions"])
def test_evidence(name: str) -> None:
    """Of all terms, truncation included: the oracle integrates over φ on its own."""
    campaign = replace(CAMPAIGNS[name], tests=CAMPAIGNS[name].tests[:3])
    expected, error = oracle_of(campaign, 1, edition="second").log_evidence(points=8192, seed=1)
    found = lb.log_evidence(lb.HybridModel.default(1), campaign, tolerance=1e-2)
    assert error < 0.01
    assert found.log_value == pytest.approx(expected, abs=4.0 * (error + found.error), rel=0.0)
