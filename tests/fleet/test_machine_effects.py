"""What a machine keeps from campaign to campaign, and nominal values that campaigns state."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from campaigns import plan, refuses, simulated
from fleets import row
from reports import plan_of_three_planes

import ldbb_bayes as lb
from ldbb_bayes.campaign.loading import ForceLaw, MountCompensation
from ldbb_bayes.fleet.campaign_statistics import SufficientStatistics, sufficient_statistics
from ldbb_bayes.fleet.dataset import read_fleet
from ldbb_bayes.fleet.fleet_statistics import fleet_statistics
from ldbb_bayes.fleet.machine_effects import (
    VARIANCE_OF_CAMPAIGN,
    has_usual_circles,
    machine_effects,
    with_deviations,
    without_effects,
)
from ldbb_bayes.fleet.selection import CaveatKind
from ldbb_bayes.fleet.spread_density import machine_likelihoods
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.model.gaussian import Gaussian

MODEL = lb.HybridModel.default(degree=1).without("truncation")
FORCE_N = 300.0
COMPLIANCES = ("C_XXX", "C_XYX", "C_YYY", "C_CXY", "C_CYY", "C_CCY")


def moments_of(forces_N: tuple[float, ...], seed: int) -> SufficientStatistics:
    campaign = simulated(plan((40,) * len(forces_N), forces_N=forces_N), seed=seed)
    return sufficient_statistics(HyperPosterior(MODEL.bind(campaign), truncated=False))


@pytest.fixture(scope="module")
def rows() -> pd.DataFrame:
    """Two campaigns of one machine at other forces: F0 389 and 300 N, F_max 742 and 560 N."""
    wide = moments_of((36.0, 300.0, 520.0, 742.0), 1)
    narrow = moments_of((40.0, 200.0, 400.0, 560.0), 2)
    of_wide = row(wide, campaign="wide")
    of_narrow = row(narrow, campaign="narrow", reference_force_N=300.0, force_max_N=560.0)
    return pd.DataFrame([of_wide, of_narrow])


def _moments(entry: pd.Series) -> tuple[list[str], np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    names = list(entry["gaussian_names"])
    q = len(names)
    covariance = np.zeros((q, q))
    covariance[np.tril_indices(q)] = entry["gaussian_covariance"]
    covariance += np.tril(covariance, -1).T
    mean, prior_mean, prior_sd = (
        np.array(entry[f"gaussian_{name}"], dtype=float)
        for name in ("mean", "prior_mean", "prior_sd")
    )
    return names, mean, covariance, prior_mean, prior_sd


def _change(name: str, force_N: float, entry: pd.Series) -> dict[str, float]:
    """C(F) − C(F0) per unit of each coefficient, from the formula of the model."""
    reference_N = float(entry["reference_force_N"])
    largest_N = float(entry["force_max_N"])
    change = {f"{name}_1": force_N - reference_N}
    if name in ("C_XXX", "C_YYY"):
        axis = name[2]
        change[f"joint_load_{axis}_slope"] = (force_N - reference_N) / largest_N
        change[f"joint_load_{axis}_contact"] = np.cbrt(reference_N / force_N) - 1.0
        change[f"joint_load_{axis}_seat"] = np.cbrt(reference_N / force_N) - 1.0
    return change


def _ratio(name: str, entry: pd.Series) -> float:
    """A coefficient of the joint load beside that of the first campaign."""
    if name.startswith(("C_", "position")):
        return 1.0
    if name.endswith("_slope"):
        return float(entry["force_max_N"]) / 742.0
    return float(np.cbrt(389.0 / float(entry["reference_force_N"])))


def _dense(rows: pd.DataFrame) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of the compliances at 300 N from one Gaussian of everything: compliances,
    instrument, what the machine keeps, what differs from campaign to campaign, and what is each
    campaign's alone."""
    statistics = fleet_statistics(rows, reference_force_N=FORCE_N)
    scale = dict(
        zip(
            (*statistics.parameters, *statistics.instrument, *statistics.machine),
            statistics.prior_sd,
            strict=True,
        )
    )
    unknowns = list(scale)
    sd = list(scale.values())
    for k, (_, entry) in enumerate(rows.iterrows()):
        own_sd = dict(zip(entry["gaussian_names"], entry["gaussian_prior_sd"], strict=True))
        for name in statistics.machine:
            unknowns.append(f"{name} of {k}")
            sd.append(scale[name] * np.sqrt(1.0 / 0.99 - 1.0))
        for name in entry["gaussian_names"]:
            if name not in scale:
                unknowns.append(f"{name} of {k}")
                sd.append(own_sd[name])
    precision = np.diag(np.array(sd) ** -2.0)
    shift = np.zeros(len(sd))
    for k, (_, entry) in enumerate(rows.iterrows()):
        names, mean, covariance, prior_mean, prior_sd = _moments(entry)
        rows_of_names = np.zeros((len(names), len(unknowns)))
        for i, name in enumerate(names):
            if name in statistics.machine:
                places = [unknowns.index(name), unknowns.index(f"{name} of {k}")]
                rows_of_names[i, places] = _ratio(name, entry)
            elif name not in unknowns:
                rows_of_names[i, unknowns.index(f"{name} of {k}")] = 1.0
            else:
                rows_of_names[i, unknowns.index(name)] = 1.0
        rows_of_names += _of_force_errors(rows, k, unknowns)
        for name in COMPLIANCES:
            for coefficient, by in _change(name, FORCE_N, entry).items():
                of_coefficient = rows_of_names[names.index(coefficient)]
                rows_of_names[names.index(name)] -= by * of_coefficient
        squared = np.outer(prior_sd, prior_sd)
        inverse = np.linalg.inv(covariance / squared) / squared
        of_readings = inverse - np.diag(prior_sd**-2.0)
        # The mount's deflection is measured from its nominal value here, too.
        of_estimate = inverse @ (mean - prior_mean)
        precision += rows_of_names.T @ of_readings @ rows_of_names
        shift += rows_of_names.T @ of_estimate
    joint = np.linalg.inv(precision * np.outer(sd, sd)) * np.outer(sd, sd)
    c = len(COMPLIANCES)
    return (joint @ shift)[:c], joint[:c, :c]


def _of_force_errors(rows: pd.DataFrame, k: int, unknowns: list[str]) -> np.ndarray:
    """Errors of the force act on the median of the estimates, not on the campaign's own."""
    entry = rows.iloc[k]
    names, mean, *_ = _moments(entry)
    change = np.zeros((len(names), len(unknowns)))
    bow = 4.0 / entry["force_max_N"]
    for name in COMPLIANCES:
        distance = _median(name, rows) - mean[names.index(name)]
        place = names.index(name)
        change[place, unknowns.index("force_gain")] = distance
        at_reference = 4.0 - bow * entry["reference_force_N"]
        change[place, unknowns.index("force_curvature")] = at_reference * distance
        slope = names.index(f"{name}_1")
        change[slope, unknowns.index("force_curvature")] = -bow * distance
    return change


def _median(name: str, rows: pd.DataFrame) -> float:
    """Median of a quantity's estimates from all campaigns."""
    estimates = []
    for _, entry in rows.iterrows():
        estimates.append(entry["gaussian_mean"][list(entry["gaussian_names"]).index(name)])
    return float(np.median(estimates))


@pytest.mark.parametrize("circles", ["the same", None])
def test_the_campaigns_of_a_machine_are_those_of_one_dense_gaussian(
    rows: pd.DataFrame, circles: str | None
) -> None:
    rows = rows.assign(circles=circles)
    statistics = fleet_statistics(rows, reference_force_N=FORCE_N)
    of_joints = [
        f"joint_load_{axis}_{law}" for axis in "XY" for law in ("contact", "seat", "slope")
    ]
    of_travel = [f"position_{axis}_{law}" for axis in "XY" for law in ("linear", "quadratic")]
    if circles is None:
        of_travel = []
    slopes = sorted(f"{name}_1" for name in COMPLIANCES)
    assert statistics.machine == (*of_joints, *of_travel, *slopes)
    mean, covariance = _dense(rows)
    _, of_machine = machine_likelihoods(statistics)
    q = of_machine.shift.shape[-1]
    posterior = Gaussian(of_machine.precision[0] + np.eye(q), of_machine.shift[0])
    scale = statistics.prior_sd[: len(COMPLIANCES)]
    sd = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(posterior.sd[:6] * scale, sd, rtol=1e-3)
    np.testing.assert_allclose((posterior.mean[:6] * scale - mean) / sd, 0.0, atol=2e-3)


def test_what_the_machine_keeps_does_not_average_out(rows: pd.DataFrame) -> None:
    """Nine times the same campaign: with a joint load of its own in each campaign, the level of
    C_XXX would be better known than the one joint load of the machine lets it be."""
    first = rows.iloc[:1]
    many = pd.concat([first] * 9)
    of_one = fleet_statistics(many, one_instrument=False)
    of_nine_machines = many.assign(machine_id=[f"M{k}" for k in range(9)])
    of_many = fleet_statistics(of_nine_machines, one_instrument=False)
    assert of_many.machine == ()
    sds = []
    for statistics in (of_one, of_many):
        precision = statistics.likelihood.precision.sum(axis=0)
        q = len(precision)
        sds.append(Gaussian(precision + np.eye(q), np.zeros(q)).sd[0])
    assert sds[0] > 1.2 * sds[1]


def test_compliance_along_the_travel_is_kept_where_the_circles_are_the_same(
    rows: pd.DataFrame,
) -> None:
    machines = ["M1", "M1"]
    of_same_circles = rows.assign(circles="the same")
    with_travel = machine_effects(of_same_circles, machines)
    assert "position_Y_linear" in with_travel
    for circles in (["one", "another"], ["one", None]):
        without_travel = machine_effects(rows.assign(circles=circles), machines)
        assert [name for name in with_travel if name not in without_travel] == [
            f"position_{axis}_{law}" for axis in "XY" for law in ("linear", "quadratic")
        ]
    assert machine_effects(rows.drop(columns="circles"), machines) == without_travel
    of_two = pd.concat([of_same_circles, rows.assign(circles=["others", "again others"])])
    assert machine_effects(of_two, ["M1", "M1", "M2", "M2"]) == with_travel


def test_a_campaign_with_other_circles_tells_nothing_of_what_the_machine_keeps_along_the_travel(
    rows: pd.DataFrame,
) -> None:
    """Its effects are integrated out, with their prior variance; those of the others stay."""
    three = pd.concat([rows, rows.iloc[:1]]).assign(circles=["usual", "usual", "other"])
    assert has_usual_circles(three, ["M1"] * 3).tolist() == [True, True, False]
    with_other_circle = fleet_statistics(three, one_machine=True)
    with_same_circles = fleet_statistics(three.assign(circles="usual"), one_machine=True)
    along = [k for k, name in enumerate(with_other_circle.machine) if name.startswith("position")]
    first = len(with_other_circle.prior_sd) - len(with_other_circle.machine)
    effects = first + np.array(along)
    of_other = with_other_circle.likelihood.precision[2]
    assert not of_other[effects].any()
    assert not of_other[:, effects].any()
    np.testing.assert_array_equal(
        with_other_circle.likelihood.precision[:2], with_same_circles.likelihood.precision[:2]
    )
    # The posterior of the parameters from this campaign alone does not depend on whose effects
    # these are: the deviations of the campaign have the rest of their variance.
    posteriors = []
    for statistics in (with_other_circle, with_same_circles):
        precision = statistics.likelihood.precision[2]
        q = len(precision)
        posteriors.append(Gaussian(precision + np.eye(q), statistics.likelihood.shift[2]))
    np.testing.assert_allclose(posteriors[0].mean[:first], posteriors[1].mean[:first], rtol=1e-6)
    np.testing.assert_allclose(posteriors[0].sd[:first], posteriors[1].sd[:first], rtol=1e-6)


def test_a_batch_states_the_circles(tmp_path: Path) -> None:
    """The commands read it as `read_fleet` does."""
    fast = lb.HybridModel.first(0)
    folder = lb.write_campaign(simulated(plan()), tmp_path / "campaign")
    lb.fleet.run_batch([folder], tmp_path / "fitted", model=fast, ess=100.0, compare=False)
    circles = read_fleet([tmp_path / "fitted"])["circles"]
    assert json.loads(circles.iloc[0])[0][:2] == ["XY", 150.0]


def test_rows_of_an_earlier_version_are_refused_beside_others(rows: pd.DataFrame) -> None:
    """Where their force laws are not the default one: the same slope would be another number."""
    mixed = rows.assign(circles=["one", None])
    fleet_statistics(mixed)
    names = list(rows["gaussian_names"].iloc[0])
    means = [list(rows["gaussian_prior_mean"].iloc[0]), rows["gaussian_prior_mean"].iloc[1]]
    means[0][names.index("force_gain")] = 0.03
    other_law = mixed.assign(gaussian_prior_mean=means)
    refuses("narrow must hold the slope .* Run batch again", fleet_statistics, other_law)
    fleet_statistics(other_law, one_instrument=False)


def test_deviations_widen_a_likelihood() -> None:
    """Against the covariance, where the precision matrix has an inverse."""
    rng = np.random.default_rng(1)
    root = rng.standard_normal((3, 5, 5))
    precision = root @ np.swapaxes(root, 1, 2)
    mean = rng.standard_normal((3, 5))
    likelihood = Gaussian(precision, np.einsum("nij,nj->ni", precision, mean))
    variance = np.array([0.0, 0.0, 0.3, 1.0, 2.0])
    wider = with_deviations(likelihood, variance)
    np.testing.assert_allclose(
        np.linalg.inv(wider.precision), np.linalg.inv(precision) + np.diag(variance)
    )
    np.testing.assert_allclose(
        np.linalg.solve(wider.precision, wider.shift[..., None])[..., 0], mean
    )
    assert pytest.approx(1.0 / 0.99 - 1.0) == VARIANCE_OF_CAMPAIGN


def test_effects_are_integrated_out_under_their_prior() -> None:
    rng = np.random.default_rng(2)
    root = rng.standard_normal((2, 4, 4))
    precision = root @ np.swapaxes(root, 1, 2)
    shift = rng.standard_normal((2, 4))
    marginal = without_effects(Gaussian(precision, shift), 2)
    joint = np.linalg.inv(precision + np.diag([0.0, 0.0, 1.0, 1.0]))
    np.testing.assert_allclose(np.linalg.inv(marginal.precision), joint[:, :2, :2])
    means = np.einsum("nij,nj->ni", joint, shift)[:, :2]
    np.testing.assert_allclose(
        np.linalg.solve(marginal.precision, marginal.shift[..., None])[..., 0], means
    )


def test_slopes_are_kept_only_of_linear_compliance(rows: pd.DataFrame) -> None:
    names = [[*rows["gaussian_names"].iloc[0], "C_XXX_2"], rows["gaussian_names"].iloc[1]]
    assert all(
        name.startswith("joint_load")
        for name in machine_effects(pd.DataFrame({"gaussian_names": names}), ["M1", "M1"])
    )


# ---- the mount's deflection


def restated(campaign: lb.Campaign, deflection_um_per_bar: float, u_um: float) -> lb.Campaign:
    """The same readings, compensated for another deflection, whose U is the same in µm/bar."""
    change = campaign.mount.deflection_um_per_bar - deflection_um_per_bar
    tests = []
    for test in campaign.tests:
        reading_um = np.asarray(test.reading_um) + change * float(test.pressure_bar or 0.0)
        tests.append(test.with_reading_um(reading_um))
    percent = 100.0 * u_um / deflection_um_per_bar
    return replace(
        campaign,
        tests=tuple(tests),
        mount=MountCompensation(deflection_um_per_bar),
        instrument=replace(campaign.instrument, mount_U_percent=percent),
    )


def test_one_mount_has_one_deflection_whatever_campaigns_state() -> None:
    """With priors that no compliance sizes: the estimate of one follows the compensation."""
    model = lb.HybridModel.first(degree=1).without("truncation")
    measured = simulated(plan())
    rows = []
    for deflection in (2.33, 2.0):
        campaign = restated(measured, deflection, 0.2)
        moments = sufficient_statistics(HyperPosterior(model.bind(campaign), truncated=False))
        rows.append(row(moments, machine_id=f"{deflection}"))
    statistics = fleet_statistics(pd.DataFrame(rows))
    q = statistics.likelihood.shift.shape[1]
    posterior = Gaussian(statistics.likelihood.precision + np.eye(q), statistics.likelihood.shift)
    first, second = posterior.mean
    np.testing.assert_allclose((second - first) / posterior.sd[0], 0.0, atol=0.05)


def test_one_regulator_has_one_slope_whatever_campaigns_state() -> None:
    """The same readings at the same pressures, whose forces another law states: the compliances are
    those of the law that most campaigns state."""
    model = lb.HybridModel.first(degree=1).without("truncation")
    measured = simulated(plan())
    rows = []
    for slope_N_per_bar in (126.04, 126.04, 130.0):
        law = ForceLaw(slope_N_per_bar)
        tests = tuple(
            replace(test, force_N=law.force_N(float(test.pressure_bar or 0.0)))
            for test in measured.tests
        )
        campaign = replace(measured, tests=tests, force_law=law)
        bound = model.bind(campaign)
        moments = sufficient_statistics(HyperPosterior(bound, truncated=False))
        number = len(rows)
        fields = {"campaign": f"{number}", "machine_id": f"M{number}"}
        reference_N = bound.setting.reference_force_N
        rows.append(row(moments, reference_force_N=reference_N, **fields))
    statistics = fleet_statistics(pd.DataFrame(rows))
    place = len(statistics.parameters) + statistics.instrument.index("force_gain")
    assert statistics.prior_sd[place] == pytest.approx(0.01)
    q = statistics.likelihood.shift.shape[1]
    posterior = Gaussian(statistics.likelihood.precision + np.eye(q), statistics.likelihood.shift)
    first, _, third = posterior.mean
    np.testing.assert_allclose((third - first)[:6] / posterior.sd[0, :6], 0.0, atol=0.1)


def test_a_row_that_states_the_error_of_the_mount_alone_is_refused(rows: pd.DataFrame) -> None:
    older = rows.iloc[0].to_dict()
    place = list(older["gaussian_names"]).index("mount")
    older["gaussian_prior_mean"] = list(older["gaussian_prior_mean"])
    older["gaussian_prior_mean"][place] = 0.0
    with pytest.raises(lb.InputError, match=r"got one of an earlier version.*Run batch again"):
        fleet_statistics(pd.DataFrame([older]))


def test_a_difference_knows_that_the_mount_is_the_same() -> None:
    """Readings compensated for another deflection are the same readings, but for one that is
    nudged: differences of the same readings are refused."""
    measured = simulated(plan())
    first = measured.tests[0]
    reading_um = np.asarray(first.reading_um).copy()
    reading_um[3] += 1e-4
    nudged = replace(measured, tests=(first.with_reading_um(reading_um), *measured.tests[1:]))
    rule = lb.inference.StoppingRule(ess=500.0)
    posterior, restated_posterior, nudged_posterior = (
        lb.sample(MODEL, restated(campaign, by, 0.2), sampler="independent", rule=rule)
        for campaign, by in ((measured, 2.33), (measured, 2.0), (nudged, 2.0))
    )
    refuses(
        "results must be of different readings, got those of 'campaign' twice",
        lb.analysis.compare_posteriors,
        posterior,
        restated_posterior,
    )
    for same_machine in (False, True):
        result = lb.analysis.compare_posteriors(
            posterior, nudged_posterior, same_instrument=True, same_machine=same_machine
        )
        for name in ("C_XXX", "C_YYY"):
            change = result.loc[name]
            assert abs(change["difference"]) < 0.1 * change["sd"], (name, same_machine)


def test_without_certificates_most_campaigns_say_how_far_the_mount_yields() -> None:
    """Each assumes a tenth of what it states; the smallest deflection is not the best known."""
    measured = simulated(plan())
    rows = []
    for deflection in (2.33, 2.33, 1.0):
        campaign = replace(
            restated(measured, deflection, 0.2),
            instrument=measured.instrument,
            name=f"{deflection}",
        )
        moments = sufficient_statistics(HyperPosterior(MODEL.bind(campaign), truncated=False))
        rows.append(row(moments, campaign=f"{len(rows)}", machine_id=f"M{len(rows)}"))
    statistics = fleet_statistics(pd.DataFrame(rows))
    place = len(statistics.parameters) + statistics.instrument.index("mount")
    assert statistics.prior_sd[place] == pytest.approx(2.33e-4)
    # One sd of the two statements is 0.233 and 0.1 µm/bar; they differ by 1.33.
    (caveat,) = statistics.caveats
    assert caveat.kind == CaveatKind.CONTRADICTED_INSTRUMENT
    assert (caveat.names, caveat.text) == (("2",), "mount deflection")


@pytest.mark.parametrize(
    ("deflection", "contradicted"), [(2.33, False), (2.28, False), (2.0, True)]
)
def test_certificates_that_contradict_each_other_are_told(
    deflection: float, contradicted: bool
) -> None:
    """Both with u = 1 %: 2.28 is 1.5 standard uncertainties of the difference from 2.33, 2.0 is
    11. Campaigns with instruments of their own contradict nobody."""
    measured = simulated(plan())
    rows = []
    for stated in (2.33, deflection):
        campaign = restated(measured, stated, 0.02 * stated)
        moments = sufficient_statistics(HyperPosterior(MODEL.bind(campaign), truncated=False))
        name = f"c{len(rows)}"
        rows.append(row(moments, campaign=name, name=name, machine_id=f"M{len(rows)}"))
    caveats = fleet_statistics(pd.DataFrame(rows)).caveats
    assert [caveat.text for caveat in caveats] == ["mount deflection"] * contradicted
    assert fleet_statistics(pd.DataFrame(rows), one_instrument=False).caveats == []


def test_a_row_without_joint_load_may_have_its_reference_force_at_zero(rows: pd.DataFrame) -> None:
    """Its F0 scales no coefficient of the others."""
    model = replace(MODEL.without("joint-load"), reference_force_N=0.0)
    moments = sufficient_statistics(HyperPosterior(model.bind(simulated(plan())), truncated=False))
    first = row(moments, campaign="zero", reference_force_N=0.0)
    with_zero = pd.concat([pd.DataFrame([first]), rows])
    statistics = fleet_statistics(with_zero, reference_force_N=FORCE_N)
    assert np.isfinite(statistics.prior_sd).all()
    without_zero = fleet_statistics(rows, reference_force_N=FORCE_N)
    assert statistics.machine == without_zero.machine
    loads = [k for k, name in enumerate(without_zero.machine) if name.startswith("joint_load")]
    places = [len(without_zero.prior_sd) - len(without_zero.machine) + k for k in loads]
    np.testing.assert_allclose(statistics.prior_sd[places], without_zero.prior_sd[places])


def test_forces_of_a_load_cell_do_not_follow_the_law() -> None:
    """What the law states then says nothing about the forces."""
    campaign = simulated(plan())
    law = ForceLaw(slope_N_per_bar=130.0)
    assert campaign.forces_follow_law
    of_cell = replace(campaign, force_law=law)
    assert not of_cell.forces_follow_law
    assert lb.terms.ForceError.nominal("force_gain", of_cell) == 0.0
    by_law = []
    for test in campaign.tests:
        by_law.append(replace(test, force_N=law.force_N(float(test.pressure_bar or 0.0))))
    following = replace(campaign, force_law=law, tests=tuple(by_law))
    assert following.forces_follow_law
    stated = lb.terms.ForceError.nominal("force_gain", following)
    assert stated == pytest.approx(np.log(130.0 / 126.04))


def test_no_trend_decides_on_a_plane_that_has_not_been_run() -> None:
    planned = plan_of_three_planes()
    run = planned.select([test.name for test in planned.tests if test.plane == "XY"])
    tests_in_yz = tuple(test for test in planned.tests if test.plane == "YZ")
    entries = []
    for seed in (1, 2):
        campaign = replace(simulated(run, seed=seed), foreseen=tests_in_yz)
        posterior = HyperPosterior(MODEL.bind(campaign), truncated=False)
        fields = {"campaign": f"c{seed}", "reference_force_N": 400.0, "force_max_N": 700.0}
        entries.append(row(sufficient_statistics(posterior), force_min_N=100.0, **fields))
    tolerances = {"C_ZZZ": "1 mm/N", "C_XXX": "1 mm/N"}
    trend = lb.fleet.find_trend(pd.DataFrame(entries), tolerances=tolerances)
    decided = {name: {one.decision for one in of.values()} for name, of in trend.conformity.items()}
    assert decided == {"C_ZZZ": {"not decided"}, "C_XXX": {"conforms"}}
