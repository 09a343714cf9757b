"""Nuisances against dense conditionals."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from campaigns import HYPER_UM, plan

import ldbb_bayes as lb
from ldbb_bayes.inference.posterior import draws_of
from ldbb_bayes.model.bound_information import information_of
from ldbb_bayes.model.fourier import basis
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.terms import Columns

DRIFTING = lb.HybridModel.first(0).without("truncation").with_term(lb.terms.Drift("time"))


@pytest.fixture(scope="module")
def drifting() -> lb.Campaign:
    planned = plan((40,) * 6, forces_N=(36.0, 300.0, 742.0, 36.0, 300.0, 742.0))
    tests = [
        replace(test, direction="CW" if index < 3 else "CCW", time_s=600.0 * (index * 5 % 6))
        for index, test in enumerate(planned.tests)
    ]
    timed = replace(planned, tests=tuple(tests))
    return DRIFTING.simulate(timed, seed=3, hyper_um=HYPER_UM).campaign


class Moments(NamedTuple):
    mean: np.ndarray
    variance: np.ndarray


def dense_moments(bound: BoundModel, campaign: lb.Campaign, phi: np.ndarray) -> Moments:
    """Moments of the shared nuisances given φ and the readings, by one dense matrix."""
    value = dict(zip(bound.hyper_prior.names, phi, strict=True))
    bases = [basis(test.angles_rad()) for test in campaign.tests]
    start = np.cumsum([0, *(len(test.angle_deg) for test in campaign.tests)])
    reading = np.concatenate([test.readings_mm() for test in campaign.tests])
    covariance = np.eye(len(reading)) * value["sigma"] ** 2
    columns = [np.concatenate([bases[r] @ bound.interest_columns[r] for r in range(len(bases))])]
    sd = [bound.prior_sd]
    for term in bound.nuisance_columns:
        if isinstance(term, Columns) and not term.private:
            columns.append(np.concatenate([bases[r] @ term.values[r] for r in range(len(bases))]))
            sd.append(term.sd_at(value))
            continue
        for r, basis_of_test in enumerate(bases):
            of_test = slice(start[r], start[r + 1])
            if isinstance(term, Columns):
                scaled = basis_of_test @ term.values[r] * term.sd_at(value)
            else:
                scaled = basis_of_test * term.sd_at(value, r)
            covariance[of_test, of_test] += scaled @ scaled.T
    design = np.concatenate(columns, axis=1)
    weight = np.linalg.solve(covariance, design)
    posterior = np.linalg.inv(design.T @ weight + np.diag(1.0 / np.concatenate(sd) ** 2))
    parameters = len(bound.names)
    mean = posterior @ weight.T @ reading
    return Moments(mean[parameters:], np.diag(posterior)[parameters:])


@pytest.mark.slow
@pytest.mark.parametrize(
    "model",
    [DRIFTING, lb.HybridModel.default(0).without("truncation").with_term(lb.terms.Drift("time"))],
)
def test_nuisances_against_dense_conditionals(model: lb.HybridModel, drifting: lb.Campaign) -> None:
    """Means and variances of all coefficients, parameters integrated out, averaged over φ."""
    posterior = lb.sample(model, drifting, seed=2, sampler="independent")
    bound = model.bind(drifting)
    names = []
    for term in bound.nuisance_columns:
        if isinstance(term, Columns) and not term.private:
            names += term.names
    table = lb.inference.summarize_nuisances(posterior).loc[names]
    _, phi = draws_of(posterior, bound, 1000)
    moments = [dense_moments(bound, drifting, value) for value in phi]
    means = np.array([of_draw.mean for of_draw in moments])
    variances = np.array([of_draw.variance for of_draw in moments])
    sd = np.sqrt(variances.mean(axis=0) + means.var(axis=0))
    np.testing.assert_allclose((table["mean"] - means.mean(axis=0)) / sd, 0.0, atol=0.25)
    np.testing.assert_allclose(table["sd"] / sd, 1.0, atol=0.12)
    assert set(table.index) == set(information_of(bound, phi[0]).names) - set(bound.names)
    assert table.loc["drift_time_length", "unit"] == "mm/h"
    assert table.loc["hysteresis_sin2", "unit"] == "mm"


def test_the_paper_has_no_nuisances(drifting: lb.Campaign) -> None:
    rule = lb.inference.StoppingRule(ess=100.0)
    flat = lb.sample(lb.HybridModel.paper(0), drifting, seed=1, sampler="independent", rule=rule)
    assert lb.inference.summarize_nuisances(flat).empty
