"""A campaign's sufficient statistics against the dense model and against another way to the same posterior."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet.statistics import fleet_statistics
from ldbb_bayes.inference.quadrature import HyperPosterior
from ldbb_bayes.inference.sufficient import SufficientStatistics, sufficient_statistics

CAMPAIGN = lb.read_campaign(lb.embedded_campaign())
MODEL = lb.HybridModel.default(degree=1).without("truncation")


@pytest.fixture(scope="module")
def found() -> SufficientStatistics:
    return sufficient_statistics(HyperPosterior(MODEL.bind(CAMPAIGN), truncated=False))


def row(found: SufficientStatistics, **fields: object) -> dict[str, object]:
    """As the batch keeps it."""
    q = len(found.names)
    usual = {
        "campaign": "a",
        "status": "done",
        "machine_id": "M1",
        "date": "2026-01-05",
        "topology": "wCAFYXZSt",
        "reference_force_N": 389.0,
        "force_min_N": 36.0,
        "force_max_N": 742.0,
        "gaussian_names": list(found.names),
        "gaussian_units": list(found.units),
        "gaussian_mean": found.mean.tolist(),
        "gaussian_covariance": found.covariance[np.tril_indices(q)].tolist(),
        "gaussian_prior_mean": found.prior_mean.tolist(),
        "gaussian_prior_sd": found.prior_sd.tolist(),
    }
    return usual | fields


def test_moments_are_those_of_quadrature(found: SufficientStatistics) -> None:
    table = lb.marginals(MODEL, CAMPAIGN)
    p = len(MODEL.bind(CAMPAIGN).names)
    assert found.names[p:] == ("mount", "force_gain")
    sd = np.sqrt(np.diag(found.covariance))[:p]
    rows = table.loc[list(found.names[:p])]
    np.testing.assert_allclose((found.mean[:p] - rows["mean"]) / rows["sd"], 0.0, atol=0.02)
    np.testing.assert_allclose(sd, rows["sd"], rtol=0.03)


def test_instrument_errors_are_those_of_a_fit(found: SufficientStatistics) -> None:
    """Drawn and averaged by other code, given β."""
    table = lb.nuisances(lb.sample(MODEL, CAMPAIGN, sampler="quadrature", rule=lb.StoppingRule(ess=2000.0)))
    for name in ("mount", "force_gain"):
        k = found.names.index(name)
        assert abs(found.mean[k] - table.loc[name, "mean"]) < 0.15 * table.loc[name, "sd"]
        assert np.sqrt(found.covariance[k, k]) == pytest.approx(table.loc[name, "sd"], rel=0.1)


def test_likelihood_times_prior_is_the_posterior(found: SufficientStatistics) -> None:
    names = ("C_XXX", "C_YYY", "C_CCY")
    one = fleet_statistics(pd.DataFrame([row(found)]), parameters=names, reference_force_N=389.0)
    place = [found.names.index(name) for name in (*names, "mount", "force_gain")]
    precision = one.information[0] + np.diag(1.0 / found.prior_sd[place] ** 2)
    np.testing.assert_allclose(np.linalg.inv(precision), found.covariance[np.ix_(place, place)], rtol=1e-6, atol=1e-30)
    np.testing.assert_allclose(np.linalg.solve(precision, one.weighted[0]), found.mean[place], rtol=1e-6)


def test_the_reference_force_is_that_of_another_model(found: SufficientStatistics) -> None:
    """Carried along the slopes: C at 500 N is what a model about 500 N calls C, but for what priors of either say."""
    there = replace(MODEL, reference_force_N=500.0).bind(CAMPAIGN)
    other = sufficient_statistics(HyperPosterior(there, truncated=False))
    carried = fleet_statistics(pd.DataFrame([row(found)]), reference_force_N=500.0)
    direct = fleet_statistics(pd.DataFrame([row(other, reference_force_N=500.0)]))
    for own in (carried, direct):
        assert own.instrument_sd == pytest.approx([2.33e-4, 0.01])
    prior = np.diag(1.0 / np.concatenate([carried.prior_sd, carried.instrument_sd]) ** 2)
    sds = [np.sqrt(np.diag(np.linalg.inv(own.information[0] + prior))) for own in (carried, direct)]
    np.testing.assert_allclose(sds[0], sds[1], rtol=0.05)


def test_each_its_own_instrument(found: SufficientStatistics) -> None:
    own = fleet_statistics(pd.DataFrame([row(found)]), one_instrument=False)
    assert own.instrument == ()
    assert own.information.shape == (1, 6, 6)
    one = fleet_statistics(pd.DataFrame([row(found)]))
    known, free = one.information[0][:6, :6], own.information[0]
    assert np.linalg.eigvalsh((known - free) * one.prior_sd[:, None] * one.prior_sd).min() > -1e-6


def test_what_is_refused(found: SufficientStatistics) -> None:
    table = pd.DataFrame([row(found), row(found, topology="wXYZt")])
    with pytest.raises(InputError, match="same joints, got wCAFYXZSt and wXYZt"):
        fleet_statistics(table)
    with pytest.raises(InputError, match="C_XXX"):
        fleet_statistics(table[:1], parameters=["C_XX"])
    with pytest.raises(InputError, match="once each"):
        fleet_statistics(table[:1], parameters=["C_XXX", "C_XXX"])
    with pytest.raises(InputError, match="none of 1"):
        fleet_statistics(pd.DataFrame([row(found, status="failed")]))
