"""What the studies state: the paper's own numbers, right signs, calibrated intervals, and what the README says of them."""

from __future__ import annotations

import json
import sys
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pandas as pd
import pytest

import ldbb_bayes as lb
from ldbb_bayes.campaign.campaign import Campaign

ROOT = Path(__file__).parents[2]
STUDIES = ROOT / "studies"


@cache
def stated(name: str) -> dict[str, Any]:
    return dict(json.loads((STUDIES / name / "results.json").read_text(encoding="utf-8")))


def module_of(study: str, name: str) -> ModuleType:
    """A module of a study, which may import its neighbours."""
    for folder in (STUDIES, STUDIES / "02_recovered_experiment", STUDIES / study):
        sys.path.insert(0, str(folder))
    return import_module(name)


# Study 01


def test_tables_1_to_4_and_the_oval() -> None:
    """Section 4: 18 compliances, six left, rank 6, condition number 9742; two forces separate 13 parameters."""
    sets, table = stated("01_simulation")["sets"], stated("01_simulation")["table_4"]
    assert sets["table_1_same"]
    assert sets["table_2_same"]
    assert (sets["columns"], sets["geometric_columns"], sets["rank"], len(sets["null"])) == (18, 7, 6, 5)
    assert int(sets["condition_number"]) == 9742
    assert sets["rank_by_forces"] == {"1": 8, "2": 13, "7": 13}
    assert (table["same"], table["cut"], table["misprinted"]) == (11, ["C_CCY"], ["E_YY1"])
    assert (table["corrected"], table["same_with_the_sign_of_Eq_16"]) == ("−2.1995E−04", 7)
    for force, size in stated("01_simulation")["figures"]["oval_um"].items():  # R E_XX1 + F C_XXX
        assert size == pytest.approx(1e3 * (150.0 * 1.12e-4 + float(force) * 1.1e-4), rel=1e-9)


def test_the_limits_are_those_of_closed_forms() -> None:
    """A tool offset e makes e² sin²θ/(2R); a scale error E makes (R E cs)²/(2R): largest at 90° and 45°."""
    reach = stated("01_simulation")["reach"]
    radius, error = reach["radius_mm"], reach["resolution_um"] * 1e-3
    for name in ("E_Xt0", "E_Yt0"):
        assert reach["alone"][name]["limit"] == pytest.approx(np.sqrt(2.0 * radius * error), rel=1e-3)
    for name in ("E_XX1", "E_YY1"):
        assert reach["alone"][name]["limit"] == pytest.approx(np.sqrt(8.0 * error / radius), rel=5e-3)
    sizes, curve = np.array(reach["sizes"]), np.array(reach["curves"]["E_Xt0, E_Yt0 alone"])
    np.testing.assert_allclose(np.diff(np.log(curve)) / np.diff(np.log(sizes)), 2.0, atol=0.02)


# Study 02


def printed(name: str) -> pd.DataFrame:
    return pd.read_csv(ROOT / "data" / "published_tables" / f"{name}.csv", dtype=str)


def paper_estimate(campaign: Campaign) -> dict[str, float]:
    bound = lb.HybridModel.paper(0).bind(campaign)
    mean = bound.given(np.array([[1e-3]]))[1].mean
    np.testing.assert_allclose(mean[0] / bound.scale, bound.centre / bound.scale, atol=1e-9)
    return dict(zip(bound.names, mean[0], strict=True))


def misses(row: pd.Series, estimate: dict[str, float]) -> list[float]:
    """Distance from every printed number in half-units of its last digit."""
    found = []
    for name in (name for name in row.index if not name.startswith("force_")):
        mantissa, _, exponent = row[name].upper().partition("E")
        half_unit = 0.5 * 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
        found.append(abs(estimate[name.replace("(", "").replace(")", "")] - float(row[name])) / half_unit)
    return found


def test_tables_5_to_8(recovered: Campaign) -> None:
    """All 78 printed numbers within 1.05 half-units of their last digit."""
    found: list[float] = []
    everything = paper_estimate(recovered)
    for name in ("table_5_global_compliances", "table_6_global_geometric_errors"):
        found += misses(printed(name).iloc[0], everything)
    for name in ("table_7_local_compliances", "table_8_local_geometric_errors"):
        for _, row in printed(name).iterrows():
            pair = [f"f{int(row[column]):03d}" for column in ("force_low_N", "force_high_N")]
            found += misses(row, paper_estimate(recovered.select(pair)))
    assert len(found) == 78
    assert max(found) <= 1.05


def test_equation_34_as_published(recovered: Campaign) -> None:
    """1.1 µm with constant and 0.9 µm with linear compliance, predicted by plain matrix algebra on the readings."""
    for degree, published in ((0, "1.1"), (1, "0.9")):
        bound = lb.HybridModel.paper(degree).bind(recovered)
        squares = 0.0
        for r, test in enumerate(bound.reduced):
            squares += np.sum((test.projection - test.factor @ bound.interest[r] @ bound.centre) ** 2) + test.residual_ss
        assert f"{np.sqrt(squares / recovered.readings) * 1e3:.1f}" == published


def test_the_script_makes_the_campaign_that_is_shipped(recovered: Campaign) -> None:
    """From the printed tables alone, whose printing error stands as printed."""
    made = module_of("02_recovered_experiment", "make_campaign").make_campaign()
    assert [t.name for t in made.tests] == [t.name for t in recovered.tests]
    np.testing.assert_array_equal(made.forces_N, recovered.forces_N)
    np.testing.assert_array_equal(made.pressures_bar, recovered.pressures_bar)
    for ours, shipped in zip(made.tests, recovered.tests, strict=True):
        assert (len(shipped.angle_deg), shipped.direction) == (720, "CW")
        np.testing.assert_array_equal(ours.angle_deg, shipped.angle_deg)
        np.testing.assert_allclose(ours.reading_um, shipped.reading_um, atol=1e-8)
    table = printed("table_4_simulation").set_index("error")
    assert (table.loc["E_YY1", "estimated"], table.loc["E_YY1", "percent_difference"]) == ("-2.2195E-04", "0.8863")


def test_what_the_tables_leave_open() -> None:
    """78 numbers, 45 of 48 dimensions; least squares sees none of the open directions. Tables 5 to 9, Figures 8 to 14."""
    results = stated("02_recovered_experiment")
    assert (results["printed_numbers"], results["dimensions"], results["determined"]) == (78, 48, 45)
    assert sum(len(rows) for rows in results["tables"].values()) == 78
    assert max(row["half_units"] for rows in results["tables"].values() for row in rows) <= 1.05
    lowest = results["open"]["cos4_at_lowest_um"]
    assert lowest["set to zero"] == pytest.approx(0.26, abs=0.005)
    assert lowest["sd"] == pytest.approx(0.7, abs=0.05)
    assert results["open"]["orthonormal"]
    assert all(results["open"]["alternating"].values())
    assert results["completions"]["least_squares_unchanged"]
    table = results["table_9"]
    for row in table["rows"].values():  # misfits linear to constant in the ratio of the printed RMSE, 0.9 to 1.1
        low = (100.0 - row["linear"]["printed"] - 0.05) / (100.0 - row["constant"]["printed"] + 0.05)
        high = (100.0 - row["linear"]["printed"] + 0.05) / (100.0 - row["constant"]["printed"] - 0.05)
        assert low < table["rmse_ratio"] + 0.01
        assert high > 0.9 / 1.1
    assert table["worst"]["constant"]["all"] < 0.7 < table["worst"]["constant"]["own"]
    assert [row["figure"] for row in results["figure_values"] if row["units_of_last_digit"] > 2.0] == ["12"]
    assert len(results["figure_values"]) == 31


# Study 04


def test_three_answers_side_by_side() -> None:
    """RMSE and white noise say linear, the honest answer says constant, and one assumption turns it."""
    compared = stated("04_constant_or_linear")["compared"]
    assert (f"{compared['least_squares_rmse_um']['constant']:.1f}", f"{compared['least_squares_rmse_um']['linear']:.1f}") == (
        "1.1",
        "0.9",
    )
    assert compared["assumptions"]["white noise only, no truncation"]["log_bayes_factor"] > 500.0
    assert compared["log_bayes_factor"] == pytest.approx(compared["savage_dickey"], abs=0.02)
    assert compared["log_bayes_factor"] < -5.0
    assert compared["assumptions"]["set-up shift of order 1 (centre) only"]["log_bayes_factor"] > 5.0
    assert len(compared["slope_scale"]) >= 5


def test_the_printed_numbers_alone() -> None:
    """The dense model returns the package's ln B where both see the same; which way the numbers lean, and what turns the sign."""
    results = stated("04_constant_or_linear")
    found, compared = results["printed"], results["compared"]
    assert found["of_readings"]["log_bayes_factor"] == pytest.approx(compared["log_bayes_factor"], abs=0.01)
    assert found["scaled"]["1"]["zero and centre move"] == pytest.approx(compared["log_bayes_factor"], abs=0.01)
    assert found["numbers"] == results["undetermined"]["printed"]
    assert found["slope_scale"]["0.3"] == pytest.approx(found["log_bayes_factor"]["zero and centre move"], abs=1e-3)
    assert [row["numbers"] for row in found["without"].values()] == [found["numbers"] - 8] * 6
    lightest, *others = (row["log_bayes_factor"] for row in found["without"].values())
    assert lightest < -5.0 < min(others)
    for label, value in found["log_bayes_factor"].items():
        assert found["parts"][label]["all six"] == pytest.approx(value, abs=1e-3)
    assert found["log_bayes_factor"]["zero and centre move"] > 0.0 > compared["log_bayes_factor"]
    assert found["kappa_um"]["linear"] < found["kappa_um"]["constant"] < compared["kappa_um"]
    assert found["scaled"]["0.25"]["zero and centre move"] > 0.0 > found["scaled"]["0.5"]["zero and centre move"]


def test_one_circle_ignored() -> None:
    """The same as saying of every harmonic of that circle that it is known to a millimetre."""
    harmonics = module_of("04_constant_or_linear", "harmonics")
    grid = {"delta": np.array([7e-4]), "kappa": np.array([1e-4]), "tau": np.array([5e-3])}
    data = harmonics.printed_numbers()
    for circle in (0, 3):
        own = slice(8 * circle, 8 * circle + 8)
        vague = harmonics.Model(data, grid=grid)
        vague.fixed[:] += data.jacobian[:, own] @ data.jacobian[:, own].T
        ignored = harmonics.Model(data.without(circle), grid=grid).log_bayes_factor()
        assert ignored == pytest.approx(vague.log_bayes_factor(), abs=0.01)
        assert ignored != pytest.approx(harmonics.Model(data, grid=grid).log_bayes_factor(), abs=0.5)


def test_the_three_undetermined_directions_and_the_gain() -> None:
    """The null space that study 02 found another way; the sign turns along cos 4θ alone. Shares of Fourier orders add to one."""
    results, other = stated("04_constant_or_linear"), stated("02_recovered_experiment")["open"]
    found, squares, compared = results["undetermined"], results["gain"]["least_squares"], results["compared"]
    assert (found["printed"], found["determined"]) == (78, 45)
    for name, sd in zip(found["paths"], other["sd_um"].values(), strict=True):
        assert found["paths"][name]["sd_um"] == pytest.approx(sd, rel=1e-4)
    assert found["smallest"]["cos4_um"] == pytest.approx(other["cos4_at_lowest_um"]["set to zero"], abs=1e-4)
    assert found["as_recovered"] == pytest.approx(compared["log_bayes_factor"], abs=0.01)
    assert found["exchanges"]["most"] < -5.0
    assert found["drawn"]["least"] < 0.0 < found["drawn"]["most"]
    assert sum(squares["order"].values()) == pytest.approx(1.0, abs=1e-6)
    assert squares["equal slopes"]["first"] == pytest.approx(squares["order"]["0"], rel=1e-6)  # c² + s² = 1
    gain = squares["readings"] * (squares["rmse_um"]["constant"] ** 2 - squares["rmse_um"]["linear"] ** 2)
    assert squares["gain_um2"] == pytest.approx(gain, rel=1e-9)
    evidence = results["gain"]["evidence"]["zero and centre move"]["all six"]
    assert evidence == pytest.approx(compared["log_bayes_factor"], abs=0.02)


def test_signs_outliers_and_probabilities_in_simulation() -> None:
    """Signs right in 95 and 90 % (two standard errors allowed), outliers found in 95 % at no more than 5 % false alarms."""
    found = stated("04_constant_or_linear")["simulated"]
    asked = {"no slope": 0.95, "six slopes": 0.9, "one slope, that one in the model": 0.9, "outlier flagged": 0.95}
    for kind, share in asked.items():
        assert found[kind]["share"] + 2.0 * found[kind]["se"] >= share, kind
    assert max(found["false alarm"]["share"], found["false alarm, from the priors"]["share"]) <= 0.05
    claimed, seen, count = (np.array(found["reliability"][name]) for name in ("claimed", "was linear", "count"))
    assert abs(found["reliability"]["spiegelhalter_z"]) < 3.0
    assert np.all(np.abs(seen - claimed) < 4.0 * np.sqrt(np.maximum(claimed * (1.0 - claimed), 0.25 / count) / count))


def test_a_broken_evidence_would_be_seen() -> None:
    """Probabilities that are too sure by a factor of 4 in log odds fail the test of calibration."""
    reliability = module_of("04_constant_or_linear", "simulated").reliability
    rng = np.random.default_rng(1)
    log_odds = rng.normal(0.0, 2.0, 400)
    outcome = (rng.random(400) < 1.0 / (1.0 + np.exp(-log_odds))).astype(float)
    honest, sure = (reliability(1.0 / (1.0 + np.exp(-factor * log_odds)), outcome) for factor in (1.0, 4.0))
    assert abs(honest["spiegelhalter_z"]) < 3.0 < abs(sure["spiegelhalter_z"])


# Study 05


def test_designs() -> None:
    results = stated("05_next_campaign")
    six, flat = results["six"], results["flat"]
    assert six["forces_N"] == [36.0, 36.0, 389.0, 389.0, 742.0, 742.0]
    assert six["efficiency"]["recommended"] > 0.999 > 0.9 > six["efficiency"]["the paper's six"]
    assert flat["constant"]["forces_N"] == [36.0, 742.0]
    assert sum(flat["linear"]["shares"]) == pytest.approx(1.0, abs=1e-3)
    wanted = {"forces alone": 3.0, "two radii": 3.0, "both balls clocked": 1.0}
    for name, squareness in results["squareness"].items():
        assert (squareness["urad"] <= wanted[name]) == (name != "forces alone")
    assert results["squareness"]["forces alone"]["floor_urad"] > 3.0


def test_predicted_widths_coverage_and_decisions() -> None:
    """Widths within 10 % of the forecast in 200 campaigns of each design; decisive shares within three standard errors."""
    results = stated("05_next_campaign")
    assert results["simulated"]["largest_miss"] < 0.1
    for name, own in results["simulated"]["widths"].items():
        assert own["count"] == 200
        covered = {p: entry["coverage_95"] for p, entry in own["parameters"].items()}
        assert min(share for p, share in covered.items() if p != "C_CCY") >= 0.90, name
        assert covered["C_CCY"] >= 0.86, name
        assert own["coverage_mean"] == pytest.approx(0.95, abs=0.02), name
    forecast, seen = results["settling"]["discrimination"], results["simulated"]["decisions"]
    against = seen["settling: constant"]["decisive without"]["share"]
    assert against == pytest.approx(forecast["decisive_without"], abs=3.0 * 0.02)
    power = results["finding"]["C_XYX_1"]["power"]
    assert seen["C_XYX_1: there"]["decisive with"]["share"] == pytest.approx(power, abs=3.0 * 0.021)
    assert seen["settling: equal slopes"]["median"] < 0.0 < seen["settling: equal slopes, zero kept"]["median"]


# Studies 06 and 07


def test_the_right_model_is_calibrated_and_wrong_ones_are_seen() -> None:
    results = stated("06_validation")
    assert {"linear", "constant", "untruncated", "arcs", "clocked"} == set(results["calibrated"])
    for kind, case in results["cases"].items():
        if kind in results["calibrated"]:
            assert (case["outside"], case["replicates"] >= 300) == (0, True)
            assert case["worst_coverage"] > 0.95 - 4.0 * case["se_of_one"]
            assert case["mean_coverage"] == pytest.approx(0.95, abs=0.01)
        else:
            assert case["outside"] > 5, kind
            assert case["worst_coverage"] < 0.7, kind
    more, fewer = (results["cases"][f"no discrepancy{kind}"]["mean_coverage"] for kind in (", more readings", ""))
    assert more < fewer - 0.02


def test_disturbances() -> None:
    """The baseline is calibrated and quiet; other shapes are noticed; the README names what fails in silence, and its remedy."""
    kinds = stated("07_misspecification")["kinds"]
    words = ("backlash", "centre, sorted", "centre, random", "hysteresis", "Student-t", "saturation", "pressure law", "curvature")
    assert [word for word in words if not any(word in kind for kind in kinds)] == []
    for group in kinds["baseline"]["coverage"].values():
        assert group["mean"] == pytest.approx(0.95, abs=3.0 * group["se"])
    assert kinds["baseline"]["noticed"]["share"] < 0.05
    for kind in ("backlash small", "backlash large", "backlash closed by load", "hysteresis, both, unstated", "outliers"):
        assert kinds[kind]["noticed"]["share"] > 0.9, kind
    for kind in ("bar large, sorted", "hysteresis, CW", "pressure law large", "saturation large", "curvature large"):
        assert kinds[kind]["noticed"]["share"] < 0.05, kind
        assert kinds[kind]["worst"]["coverage"]["share"] < 0.7, kind
    for kind in ("bar large, random, Drift", "hysteresis, both, stated", "centre, sorted, Drift"):
        assert min(entry["coverage"] for entry in kinds[kind]["parameters"].values()) > 0.86, kind


# Study 08


def test_other_campaigns() -> None:
    """A second radius identifies squareness and straightness; intervals hold; one direction takes friction for compliance."""
    results = stated("08_other_campaigns")
    seen, (one, two) = results["simulated"], (results["predicted"][name] for name in ("one radius", "two radii"))
    for name in ("E_C0YX", "E_YX2", "E_XY2"):
        assert (one[name]["verdict"], two[name]["verdict"]) == ("confounded", "identified")
        assert seen["two radii"]["shown"][name]["u"] < 0.5 * seen["one radius"]["shown"][name]["u"]
    for kind in ("one radius", "two radii", "both directions", "three planes"):
        covered = list(seen[kind]["coverage"].values())
        assert seen[kind]["campaigns"] == 200
        assert min(covered) > 0.95 - 4.0 * results["se"], kind
        assert sum(covered) / len(covered) == pytest.approx(0.95, abs=0.01), kind
        for name, entry in seen[kind]["shown"].items():
            assert entry["error"] == pytest.approx(entry["u"], rel=0.2), (kind, name)
    assert results["calibration"]["outside"] == []
    assert all(seen[kind]["shown"]["C_XYX"]["coverage"] < 0.88 for kind in ("five clockwise", "ten clockwise"))
    assert seen["both directions"]["shown"]["C_XYX"]["coverage"] > 0.91
    page = (ROOT / "docs" / "machines.md").read_text(encoding="utf-8")
    radii, ways = ("one radius", "two radii"), ("five clockwise", "ten clockwise", "both directions")
    shown = (("E_C0YX", 1e6, "µrad", radii), ("E_YX2", 1e9, "µm/m²", radii), ("C_XYX", 1e6, "nm/N", ways))
    for name, factor, unit, kinds in shown:
        for kind in kinds:
            entry = seen[kind]["shown"][name]
            assert f"{entry['u'] * factor:.3g} {unit}, {entry['coverage']:.3f}" in page, (name, kind)
    covered = list(seen["three planes"]["coverage"].values())
    assert f"{min(covered):.3f} to {max(covered):.3f}, mean {sum(covered) / len(covered):.3f}" in page


# Study 09


def test_the_report(recovered: lb.Campaign) -> None:
    results = stated("09_report")
    assert results["page_MB"] < 3.0
    assert results["shares_sum_to_one"]
    assert f"{100 * results['E_XX1_bar_length']:.0f} %" in (ROOT / "docs" / "report.md").read_text(encoding="utf-8")
    posterior = lb.sample(lb.HybridModel.paper(0), recovered, sampler="independent", seed=1)
    size = lb.contributions(posterior).set_index("source")["peak_to_peak"]
    for name, value in results["peak_to_peak_um"].items():
        assert size[name] == pytest.approx(value["found"], rel=1e-6)
        assert 0.0 <= value["found"] - value["printed"] < 1.0


def test_the_six_lines_of_the_readme() -> None:
    """They say what the studies found, and link to them."""
    text = (ROOT / "README.md").read_text(encoding="utf-8").split("## The paper, re-examined")[1].split("\n## ")[0]
    lines = [line for line in text.splitlines() if line[:2] in {f"{n}." for n in range(1, 10)}]
    assert (len(lines), "](studies/README.md)" in text) == (6, True)
    first, second, third, fourth = map(
        stated, ("01_simulation", "02_recovered_experiment", "03_confounding", "04_constant_or_linear")
    )
    fifth, sixth = stated("05_next_campaign"), stated("06_validation")
    ccy, gain, scale = second["completions"]["range"]["C_CCY"], third["parameters"]["E_XX1"], fourth["compared"]
    alone, lightest = fourth["printed"]["log_bayes_factor"], fourth["printed"]["without"]["36"]
    white = scale["assumptions"]["white noise only, no truncation"]["log_bayes_factor"]
    rmse = scale["least_squares_rmse_um"]
    right = [share for kind in sixth["calibrated"] for share in sixth["cases"][kind]["coverage"].values()]
    claims = [
        (
            f"in {first['table_4']['same']} of 13 estimates",
            f"a {first['table_4']['step_deg']:.0f}° step",
            f"up to {first['reach']['limit_in_prior_sd']:.1f} times",
        ),
        (
            f"{second['printed_numbers']} printed numbers",
            f"but for {second['open']['count']} of {second['dimensions']} directions",
            f"C_CCY is {ccy[0] * 1e9:.2f} or {ccy[1] * 1e9:.1f} µrad/(N m)",
        ),
        (
            f"{gain['least squares']['mean']:.2f} ± {gain['least squares']['sd']:.2f}",
            f"{gain['with form']['mean']:.0f} ± {gain['with form']['sd']:.0f}",
            f"prints E_XX1 = {gain['published']:.0f} µm/m",
        ),
        (
            f"falls by {100 * (1 - rmse['linear'] / rmse['constant']):.0f} %",
            f"ln B = {white:+.0f}",
            f"printed numbers themselves say {alone['zero and centre move']:+.1f}",
            f"({alone['the centre alone moves']:+.0f} if the bar's zero stays)",
            f"recovered readings {scale['log_bayes_factor']:.1f}",
            f"probability {fourth['printed']['inclusion']['C_XYX']:.4f}",
            f"but {lightest['inclusion']['C_XYX']:.2f} without the circle at 36 N",
            f"ln B is then {lightest['log_bayes_factor']:.1f} ({lightest['the centre alone moves']:.1f})",
        ),
        (f"{fifth['settling']['tests']['number']} circles at three forces",),
        (
            f"cover {100 * min(right):.0f} to {100 * max(right):.0f} %",
            f"as little as {100 * sixth['cases']['no discrepancy']['worst_coverage']:.0f}",
            f"({100 * sixth['cases']['no discrepancy, more readings']['worst_coverage']:.0f} with four times the readings)",
        ),
    ]
    for line, own in zip(lines, claims, strict=True):
        assert [claim for claim in own if claim.replace("-", "−") not in line.replace("-", "−")] == []
        assert "](studies/0" in line
