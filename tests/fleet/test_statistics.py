"""A campaign's sufficient statistics against the dense model and against another way to the same posterior."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from batches import CONSTANT, write_campaigns

import ldbb_bayes as lb
from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet.population_prior import stands_for
from ldbb_bayes.fleet.row import Job, Settings, fit_row
from ldbb_bayes.fleet.statistics import SufficientStatistics, fleet_statistics, reference_sd, sufficient_statistics
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.model.specification import model_to_toml

CAMPAIGN = lb.read_campaign(lb.embedded_campaign())
MODEL = lb.HybridModel.default(degree=1).without("truncation")


@pytest.fixture(scope="module")
def found() -> SufficientStatistics:
    return sufficient_statistics(HyperPosterior(MODEL.bind(CAMPAIGN), truncated=False))


def row(found: SufficientStatistics, **fields: object) -> dict[str, object]:
    """As the batch keeps it."""
    usual = {
        "campaign": "a",
        "status": "done",
        "machine_id": "M1",
        "date": "2026-01-05",
        "topology": "wCAFYXZSt",
        "reference_force_N": 389.0,
        "force_min_N": 36.0,
        "force_max_N": 742.0,
        **found.columns(),
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
    table = lb.nuisances(lb.sample(MODEL, CAMPAIGN, sampler="independent", rule=lb.StoppingRule(ess=2000.0)))
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


def test_a_prior_with_means_is_divided_out(found: SufficientStatistics) -> None:
    """Whatever was believed before, the readings say the same; nearly, as hyper-parameters and Ĉ are judged with the prior."""
    told = replace(
        MODEL, prior=replace(MODEL.prior, overrides={"C_XXX": 2e-5, "C_YYY": 2e-5}, means={"C_XXX": 6e-5, "C_YYY": 4e-5})
    )
    other = sufficient_statistics(HyperPosterior(told.bind(CAMPAIGN), truncated=False))
    one, two = (fleet_statistics(pd.DataFrame([row(own)])) for own in (found, other))
    assert two.prior_mean.tolist() == [0.0] * 6
    assert two.prior_sd == pytest.approx(one.prior_sd)
    prior = np.diag(1.0 / np.concatenate([one.prior_sd, one.instrument_sd]) ** 2)
    precision = one.information[0] + prior
    means = [np.linalg.solve(own.information[0] + prior, own.weighted[0]) for own in (one, two)]
    np.testing.assert_allclose((means[0] - means[1]) / np.sqrt(np.diag(np.linalg.inv(precision))), 0.0, atol=0.15)
    np.testing.assert_allclose(np.diag(two.information[0]), np.diag(one.information[0]), rtol=0.1)


def test_reference_scales_are_those_of_the_kind() -> None:
    """Not a population's 4e-6 mm/N; wider ones of fits about zero are kept, the median of them."""
    names, units = ("C_XXX", "C_XYX", "C_CCY", "E_XX1", "E_YX2"), ("mm/N", "mm/N", "rad/(N mm)", "1", "1/mm")
    mean = np.zeros((3, 5))
    mean[0, 0] = 6e-5
    sd = np.tile([4e-6, 1e-6, 1e-9, 2e-4, 1e-6], (3, 1))
    assert reference_sd(names, units, mean, sd) == pytest.approx([1e-4, 1e-5, 1e-9, 2e-4, 1e-6])
    sd[:, 2] = (2e-9, 3e-9, 5e-9)
    sd[0, 0] = 5e-4
    assert reference_sd(names, units, mean, sd) == pytest.approx([1e-4, 1e-5, 3e-9, 2e-4, 1e-6])
    assert reference_sd(["other"], ["s"], mean[:, :1], sd[:, :1]) == pytest.approx([4e-6])


def test_each_its_own_instrument(found: SufficientStatistics) -> None:
    own = fleet_statistics(pd.DataFrame([row(found)]), one_instrument=False)
    assert own.instrument == ()
    assert own.information.shape == (1, 6, 6)
    one = fleet_statistics(pd.DataFrame([row(found)]))
    known, free = one.information[0][:6, :6], own.information[0]
    assert np.linalg.eigvalsh((known - free) * one.prior_sd[:, None] * one.prior_sd).min() > -1e-6


def test_compliances_that_are_not_the_same(found: SufficientStatistics) -> None:
    """Circles 100 mm higher: C_XXX holds a rotation of the joint as well; C_CCY is what it was. Old rows do not say it."""
    here, near, there = (json.dumps(stands_for(_at(z))) for z in (0.0, 0.5, 100.0))
    table = pd.DataFrame([row(found, campaign=name, compliances=own) for name, own in {"a": here, "b": near, "c": None}.items()])
    assert fleet_statistics(table).compliances["C_XXX"] == {"C_XXX": 1.0, "C_XXY": 1.0}
    other = pd.concat([table, pd.DataFrame([row(found, campaign="d", compliances=there)])])
    with pytest.raises(InputError, match=r"must mean the same by C_XXX, got a and d: circles or joints' frames stand elsewhere"):
        fleet_statistics(other)
    assert len(fleet_statistics(other, parameters=["C_CCY", "E_XX1"])) == 4


def test_one_campaign_without_the_mount_leaves_the_others_theirs(found: SufficientStatistics) -> None:
    """It took the mount as known; that of the others does not average out for it."""
    without = MODEL.without("mount")
    known = sufficient_statistics(HyperPosterior(without.bind(CAMPAIGN), truncated=False))
    both = fleet_statistics(pd.DataFrame([row(known), row(found), row(found)]))
    pair, alone = (fleet_statistics(pd.DataFrame([row(own)] * n)) for own, n in ((found, 2), (known, 1)))
    assert both.instrument == pair.instrument == ("mount", "force_gain")
    assert both.instrument_sd == pytest.approx(pair.instrument_sd)
    np.testing.assert_allclose(both.information[1:], pair.information)
    here = [0, 1, 2, 3, 4, 5, 7]
    np.testing.assert_allclose(both.information[0][np.ix_(here, here)], alone.information[0])
    np.testing.assert_allclose(both.weighted[0, here], alone.weighted[0])
    assert not both.information[0, 6].any()
    assert not both.information[0, :, 6].any()
    assert both.weighted[0, 6] == 0.0


def _at(centre_z_mm: float) -> lb.Campaign:
    return replace(CAMPAIGN, tests=tuple(replace(test, centre_z_mm=centre_z_mm) for test in CAMPAIGN.tests))


def test_a_row_says_what_compliances_stand_for(tmp_path: Path) -> None:
    (path,) = write_campaigns(tmp_path, 1)
    made = fit_row(Settings(model_to_toml(CONSTANT), ess=100.0, compare=False), Job(0, path))
    assert json.loads(made["compliances"]) == stands_for(lb.read_campaign(path))


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
