"""Sufficient statistics against other ways to the same posterior; which campaigns are relied on."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from batches import CONSTANT, write_campaigns
from campaigns import refuses
from fleets import doubts, drawn_rows, one_campaign, row

import ldbb_bayes as lb
from ldbb_bayes.analysis.compliance_meaning import stands_for
from ldbb_bayes.errors import InputError
from ldbb_bayes.fleet.campaign_likelihood import _map_to_force
from ldbb_bayes.fleet.campaign_row import Job, Settings, fit_row
from ldbb_bayes.fleet.campaign_statistics import SufficientStatistics, sufficient_statistics
from ldbb_bayes.fleet.common_priors import reference_sd
from ldbb_bayes.fleet.fleet_statistics import FleetStatistics, fleet_statistics
from ldbb_bayes.fleet.selection import Caveat, CaveatKind, choose
from ldbb_bayes.inference.force_curves import draws_at
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.specification import model_to_toml
from ldbb_bayes.report.wording import caveat_words

CAMPAIGN = lb.read_campaign(lb.embedded_campaign())
MODEL = lb.HybridModel.first(degree=1).without("truncation")


@pytest.fixture(scope="module")
def campaign_moments() -> SufficientStatistics:
    return sufficient_statistics(HyperPosterior(MODEL.bind(CAMPAIGN), truncated=False))


def test_moments_are_those_of_quadrature(campaign_moments: SufficientStatistics) -> None:
    table = lb.inference.marginalize(MODEL, CAMPAIGN)
    p = len(MODEL.bind(CAMPAIGN).names)
    assert campaign_moments.names[p:] == ("mount", "force_gain")
    sd = np.sqrt(np.diag(campaign_moments.covariance))[:p]
    rows = table.loc[list(campaign_moments.names[:p])]
    np.testing.assert_allclose(
        (campaign_moments.mean[:p] - rows["mean"]) / rows["sd"], 0.0, atol=0.02
    )
    np.testing.assert_allclose(sd, rows["sd"], rtol=0.03)


def test_instrument_errors_are_those_of_a_fit(campaign_moments: SufficientStatistics) -> None:
    """Drawn and averaged by other code, given β."""
    table = lb.inference.summarize_nuisances(
        lb.sample(
            MODEL, CAMPAIGN, sampler="independent", rule=lb.inference.StoppingRule(ess=2000.0)
        )
    )
    for name in ("mount", "force_gain"):
        k = campaign_moments.names.index(name)
        error = campaign_moments.mean[k] - campaign_moments.prior_mean[k]
        assert abs(error - table.loc[name, "mean"]) < 0.15 * table.loc[name, "sd"]
        assert np.sqrt(campaign_moments.covariance[k, k]) == pytest.approx(
            table.loc[name, "sd"], rel=0.1
        )


def test_likelihood_times_prior_is_the_posterior(campaign_moments: SufficientStatistics) -> None:
    names = ("C_XXX", "C_YYY", "C_CCY")
    one = fleet_statistics(
        pd.DataFrame([row(campaign_moments)]), parameters=names, reference_force_N=389.0
    )
    place = [campaign_moments.names.index(name) for name in (*names, "mount", "force_gain")]
    precision = one.likelihood.precision[0] / np.outer(one.prior_sd, one.prior_sd) + np.diag(
        1.0 / campaign_moments.prior_sd[place] ** 2
    )
    np.testing.assert_allclose(
        np.linalg.inv(precision),
        campaign_moments.covariance[np.ix_(place, place)],
        rtol=1e-6,
        atol=1e-30,
    )
    # Errors of the instrument are measured from their prior means.
    centre = campaign_moments.prior_mean[place]
    assert centre.tolist() == [0.0, 0.0, 0.0, 2.33e-3, 0.0]
    np.testing.assert_allclose(
        np.linalg.solve(precision, one.likelihood.shift[0] / one.prior_sd),
        campaign_moments.mean[place] - centre,
        rtol=1e-6,
    )


def posteriors(*fleets: FleetStatistics) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Means and sds of the first campaigns, in inside units, under the reference prior."""
    posteriors_by_fleet = [
        Gaussian(statistics.likelihood.precision[0] + np.eye(8), statistics.likelihood.shift[0])
        for statistics in fleets
    ]
    return [
        one.mean * statistics.prior_sd
        for one, statistics in zip(posteriors_by_fleet, fleets, strict=True)
    ], [
        one.sd * statistics.prior_sd
        for one, statistics in zip(posteriors_by_fleet, fleets, strict=True)
    ]


def test_the_reference_force_is_that_of_another_model(
    campaign_moments: SufficientStatistics,
) -> None:
    """Carried along the slopes: C at 500 N is what a model about 500 N calls C, but for what priors
    of either say."""
    bound = replace(MODEL, reference_force_N=500.0).bind(CAMPAIGN)
    other = sufficient_statistics(HyperPosterior(bound, truncated=False))
    for force, direct_row, carried_row in (
        (500.0, row(other, reference_force_N=500.0), row(campaign_moments)),
        (389.0, row(campaign_moments), row(other, reference_force_N=500.0)),
    ):
        direct, carried = (
            fleet_statistics(pd.DataFrame([entry]), reference_force_N=force)
            for entry in (direct_row, carried_row)
        )
        for statistics in (carried, direct):
            assert statistics.prior_sd[6:] == pytest.approx([2.33e-4, 0.01])
        means, sds = posteriors(carried, direct)
        np.testing.assert_allclose(sds[0], sds[1], rtol=0.05)
        np.testing.assert_allclose((means[0] - means[1]) / sds[1], 0.0, atol=0.1)


def test_a_compliance_at_another_force_contains_the_joint_load() -> None:
    """It is the curve C(F) of a fit, which draws the coefficients of the joints' own load."""
    model = lb.HybridModel.default(degree=1).without("truncation")
    moments = sufficient_statistics(HyperPosterior(model.bind(CAMPAIGN), truncated=False))
    names = list(moments.names)
    rule = lb.inference.StoppingRule(ess=3000.0)
    fit = lb.sample(model, CAMPAIGN, sampler="independent", rule=rule, seed=2)
    for force_N in (36.0, 100.0, 742.0):
        draws = draws_at(fit, force_N)
        wanted = ("C_XXX", "C_YYY", "C_CCY")
        to_force = _map_to_force(names, wanted, force_N, row(moments))
        sd = np.sqrt(np.diag(to_force @ moments.covariance @ to_force.T))
        for k, name in enumerate(wanted):
            assert (to_force @ moments.mean)[k] == pytest.approx(
                draws[name].mean(), abs=0.1 * sd[k]
            )
            assert sd[k] == pytest.approx(draws[name].std(), rel=0.06)


def test_a_row_without_the_joint_load_of_its_model_is_refused_at_another_force(
    campaign_moments: SufficientStatistics,
) -> None:
    """It comes from a batch of an earlier version; at its own force nothing is missing."""
    names = [name for name in campaign_moments.names if not name.startswith("joint_load_")]
    places = [campaign_moments.names.index(name) for name in names]
    older = SufficientStatistics(
        tuple(names),
        tuple(campaign_moments.units[place] for place in places),
        campaign_moments.mean[places],
        campaign_moments.covariance[np.ix_(places, places)],
        campaign_moments.prior_mean[places],
        campaign_moments.prior_sd[places],
    )
    rows = pd.DataFrame([row(older, terms=["JointLoad"])])
    assert len(fleet_statistics(rows)) == 1
    with pytest.raises(InputError, match=r"got one of an earlier version\. Run batch again"):
        fleet_statistics(rows, reference_force_N=100.0)


def test_without_load_a_joint_that_yields_to_its_own_load_has_no_compliance() -> None:
    model = lb.HybridModel.default(degree=1).without("truncation")
    moments = sufficient_statistics(HyperPosterior(model.bind(CAMPAIGN), truncated=False))
    with pytest.raises(InputError, match=r"reference_force_N must be positive where joints yield"):
        fleet_statistics(pd.DataFrame([row(moments)]), reference_force_N=0.0)


def test_the_best_certificate_of_the_common_instrument_is_of_all_campaigns() -> None:
    rows = []
    for percent in (None, 1.0, None):
        instrument = lb.Instrument(mount_U_percent=percent)
        bound = MODEL.without("force-error").bind(replace(CAMPAIGN, instrument=instrument))
        moments = sufficient_statistics(HyperPosterior(bound, truncated=False))
        rows.append(row(moments, machine_id=f"M{len(rows)}"))
    first, stated, last = (fleet_statistics(pd.DataFrame([one])) for one in rows)
    of_all = fleet_statistics(pd.DataFrame(rows))
    assert of_all.prior_sd[-1] == pytest.approx(stated.prior_sd[-1])
    assert of_all.prior_sd[-1] < 0.5 * first.prior_sd[-1]
    # What a campaign says of the mount is the same, in whatever unit.
    for k, one in enumerate((first, stated, last)):
        ratio = of_all.prior_sd / one.prior_sd
        np.testing.assert_allclose(
            of_all.likelihood.precision[k],
            one.likelihood.precision[0] * np.outer(ratio, ratio),
            rtol=1e-6,
            atol=1e-6,
        )


def test_reference_scales_are_those_of_the_kind() -> None:
    """Not a population's 4e-6 mm/N; wider ones of fits about zero are kept, the median of them."""
    names = ("C_XXX", "C_XYX", "C_CCY", "E_XX1", "E_YX2")
    units = ("mm/N", "mm/N", "rad/(N mm)", "1", "1/mm")
    mean = np.zeros((3, 5))
    mean[0, 0] = 6e-5
    sd = np.tile([4e-6, 1e-6, 1e-9, 2e-4, 1e-6], (3, 1))
    assert reference_sd(names, units, mean, sd) == pytest.approx([1e-4, 1e-5, 1e-9, 2e-4, 1e-6])
    sd[:, 2] = (2e-9, 3e-9, 5e-9)
    sd[0, 0] = 5e-4
    assert reference_sd(names, units, mean, sd) == pytest.approx([1e-4, 1e-5, 3e-9, 2e-4, 1e-6])


def test_each_its_own_instrument(campaign_moments: SufficientStatistics) -> None:
    separate = fleet_statistics(pd.DataFrame([row(campaign_moments)]), one_instrument=False)
    assert separate.instrument == ()
    assert separate.likelihood.shift.shape == (1, 6)
    one = fleet_statistics(pd.DataFrame([row(campaign_moments)]))
    assert (
        np.linalg.eigvalsh(
            one.likelihood.precision[0][:6, :6] - separate.likelihood.precision[0]
        ).min()
        > -1e-6
    )


def test_compliances_that_are_not_the_same(campaign_moments: SufficientStatistics) -> None:
    """Circles 100 mm higher: C_XXX holds a rotation of the joint as well; C_CCY is what it was. Old
    rows do not say it."""
    centred, near, raised = (json.dumps(stands_for(_at(z))) for z in (0.0, 0.5, 100.0))
    table = pd.DataFrame(
        [
            row(campaign_moments, campaign=name, compliances=meaning)
            for name, meaning in {"a": centred, "b": near, "c": None}.items()
        ]
    )
    assert fleet_statistics(table).compliances["C_XXX"] == {"C_XXX": 1.0, "C_XXY": 1.0}
    other = pd.concat(
        [table, pd.DataFrame([row(campaign_moments, campaign="d", compliances=raised)])]
    )
    with pytest.raises(
        InputError,
        match=(
            r"must mean the same by C_XXX, got a and d: circles or joints' frames stand elsewhere"
        ),
    ):
        fleet_statistics(other)
    assert len(fleet_statistics(other, parameters=["C_CCY", "E_XX1"])) == 4


def test_one_campaign_without_the_mount_leaves_the_others_theirs() -> None:
    """It took the mount as known; that of the others does not average out for it."""
    model = MODEL.without("force-error")
    without = model.without("mount")
    with_mount = sufficient_statistics(HyperPosterior(model.bind(CAMPAIGN), truncated=False))
    without_mount = sufficient_statistics(HyperPosterior(without.bind(CAMPAIGN), truncated=False))
    both = fleet_statistics(
        pd.DataFrame(
            [
                row(without_mount, machine_id="M0"),
                row(with_mount, machine_id="M1"),
                row(with_mount, machine_id="M2"),
            ]
        )
    )
    pair = fleet_statistics(pd.DataFrame([row(with_mount, machine_id=f"M{k}") for k in (1, 2)]))
    single = fleet_statistics(pd.DataFrame([row(without_mount)]))
    assert both.instrument == pair.instrument == ("mount",)
    assert both.prior_sd == pytest.approx(pair.prior_sd)
    places = [0, 1, 2, 3, 4, 5]
    for kind in ("precision", "shift"):
        np.testing.assert_allclose(
            getattr(both.likelihood, kind)[1:], getattr(pair.likelihood, kind)
        )
    np.testing.assert_allclose(
        both.likelihood.precision[0][np.ix_(places, places)], single.likelihood.precision[0]
    )
    np.testing.assert_allclose(both.likelihood.shift[0, places], single.likelihood.shift[0])
    assert not both.likelihood.precision[0, 6].any()
    assert not both.likelihood.precision[0, :, 6].any()
    assert both.likelihood.shift[0, 6] == 0.0


def _at(centre_z_mm: float) -> lb.Campaign:
    return replace(
        CAMPAIGN, tests=tuple(replace(test, centre_z_mm=centre_z_mm) for test in CAMPAIGN.tests)
    )


def test_a_row_says_what_compliances_stand_for(tmp_path: Path) -> None:
    (path,) = write_campaigns(tmp_path, 1)
    fitted = fit_row(
        Settings(model_to_toml(CONSTANT), ess=100.0, compare=False), Job(0, path, path)
    )
    assert json.loads(fitted["compliances"]) == stands_for(lb.read_campaign(path))


def test_what_statistics_refuse(campaign_moments: SufficientStatistics) -> None:
    table = pd.DataFrame([row(campaign_moments), row(campaign_moments, topology="wXYZt")])
    refuses("same joints, got wCAFYXZSt and wXYZt", fleet_statistics, table)
    refuses("C_XXX", fleet_statistics, table[:1], parameters=["C_XX"])


def test_campaigns_without_a_common_compliance_are_named_by_their_planes(
    campaign_moments: SufficientStatistics,
) -> None:
    other = replace(
        campaign_moments,
        names=tuple(name.replace("C_X", "C_Z") for name in campaign_moments.names),
    )
    names = [name for name in other.names if not name.startswith(("C_Y", "C_C"))]
    rows = [row(campaign_moments), row(other, planes="YZ", gaussian_names=names)]
    table = pd.DataFrame(rows)
    refuses("in common, got those of the planes XY; YZ. Take", fleet_statistics, table)


# ---- which campaigns count

SLIP = ["order", "noise"]


@pytest.fixture(scope="module")
def rows() -> pd.DataFrame:
    return drawn_rows(8, np.random.default_rng(6)).assign(
        machine_id=[f"M{m}" for m in range(7)] + ["M6"]
    )


def slipped(rows: pd.DataFrame, place: int) -> pd.DataFrame:
    """One campaign says a compliance thirty times too large, as sure of it as of a right one."""
    changed = rows.copy()
    mean = list(changed["gaussian_mean"].iloc[place])
    mean[one_campaign().names.index("C_XXX")] *= 30.0
    changed.at[place, "gaussian_mean"] = mean
    changed.at[place, "kinds"] = SLIP
    return changed


def test_a_slip_does_not_reach_the_others(rows: pd.DataFrame) -> None:
    bad = slipped(rows, 2)
    cleaned = lb.fleet.fit_population(bad)
    clean = lb.fleet.fit_population(rows.drop(index=2))
    assert {name: parameter.mean for name, parameter in cleaned.parameters.items()} == {
        n: parameter.mean for n, parameter in clean.parameters.items()
    }
    assert "M2" not in cleaned.machine
    assert (
        doubts(cleaned)[0]
        == "Left out, because the model does not expect their readings (--include-misfits keeps"
        " them): c03."
    )
    everything = lb.fleet.fit_population(bad, include_misfits=True)
    assert everything.campaigns == 8
    assert everything.parameters["C_XXX"].spread.mean > 5.0 * clean.parameters["C_XXX"].spread.mean


def test_which_campaigns_are_relied_on(rows: pd.DataFrame) -> None:
    """Noise alone is kept; what speaks against the model is left out, and what is asked for."""
    relied, caveats = choose(rows.assign(kinds=[["noise"], *[[]] * 7]))
    assert len(relied) == 8
    assert caveats == [Caveat(CaveatKind.NOT_WHITE, ("c01",))]
    relied, caveats = choose(
        rows.assign(kinds=[["truncation"], ["hyper", "forces"], None, *[[]] * 5])
    )
    assert list(relied["name"]) == [f"c{k:02d}" for k in range(2, 9)]
    relied, caveats = choose(rows.assign(kinds=[["unit"], *[[]] * 7]))
    assert caveats == [Caveat(CaveatKind.UNEXPECTED, ("c01",))]
    relied, caveats = choose(rows, ["year/c01", "c02", "M2", "M6"])
    assert list(relied["name"]) == ["c04", "c05", "c06"]
    assert caveats == [Caveat(CaveatKind.EXCLUDED, ("c01", "c02", "c03", "c07", "c08"))]
    relied, caveats = choose(rows.assign(date=[None, *rows["date"][1:]]), since="2025-03-16")
    assert list(relied["name"]) == [f"c{k:02d}" for k in range(3, 9)]
    assert [caveat_words(caveat) for caveat in caveats] == [
        "Left out, without a date or before 2025-03-16: c01, c02."
    ]
    assert list(choose(rows, since="2025-08-13T00:00:00+02:00")[0]["name"]) == ["c08"]


def test_labels_of_campaigns_left_out_are_unique_in_the_batch(rows: pd.DataFrame) -> None:
    """One of two campaigns of one name is named by its path, whether or not the other is left out
    with it."""
    of_one_name = rows.copy()
    of_one_name.loc[[0, 1], "name"] = "campaign"
    path = of_one_name.loc[0, "campaign"]
    _, caveats = choose(of_one_name, exclude=[path])
    (caveat,) = [caveat for caveat in caveats if caveat.kind == CaveatKind.EXCLUDED]
    assert caveat.names == (path,)


def test_what_is_refused(rows: pd.DataFrame) -> None:
    for options, message in (
        (
            {"exclude": ["m2"]},
            "must be a campaign or machine of the batch, got 'm2'. Did you mean 'M2'",
        ),
        (
            {"exclude": ["qqq"]},
            "must be a campaign or machine of the batch, got 'qqq'. It has ",
        ),
        ({"since": "March"}, "since must be a date or time in ISO 8601, got 'March'"),
        ({"since": ""}, "since must be a date or time in ISO 8601, got ''"),
        (
            {"since": "2030-01-01"},
            "campaigns must be left to rely on, got none of 8. Left out, without a date",
        ),
    ):
        refuses(message, choose, rows, **options)
    refuses(
        r"campaigns must be left to rely on, got none of 8. .*--include-misfits",
        choose,
        rows.assign(kinds=[SLIP] * 8),
    )
    refuses(
        r"got none of 8. Left out, because the fit failed: c01",
        choose,
        rows.assign(status="failed"),
    )
    with pytest.raises(InputError, match="rows must be the table of a batch, got one without name"):
        lb.fleet.fit_population(pd.DataFrame({"campaign": ["a"], "status": ["done"]}))
    with pytest.raises(
        InputError,
        match=r"two machines, got only M6. Add campaigns of others. Left out on request: c01",
    ):
        lb.fleet.fit_population(rows, exclude=[f"M{k}" for k in range(6)])
    with pytest.raises(
        InputError,
        match=r"campaigns of one machine to rely on, got 1. Measure again. Left out on request",
    ):
        lb.fleet.find_trend(rows, machine="M6", exclude=["c08"])
