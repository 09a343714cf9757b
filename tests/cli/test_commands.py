"""Every command once: what it prints, what it writes, its exit codes; run in this process."""

from __future__ import annotations

import inspect
import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from campaigns import Invoke, plan, refuses, simulated, tidy
from matplotlib.figure import Figure

import ldbb_bayes as lb
from ldbb_bayes.analysis.calibration import LOG_LIKELIHOOD, Validation
from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.cli.chosen_model import model_from
from ldbb_bayes.fleet.population_prior import digest_of
from ldbb_bayes.inference.posterior import campaign_of
from ldbb_bayes.model.specification import model_to_toml
from ldbb_bayes.report.figures import style
from ldbb_bayes.units import display_name, typeset

FIT = ("--degree", 0, "--sampler", "independent")


def names_in(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def figure_files(text: str) -> set[str]:
    names_of_figures = text.split()
    pngs = {f"{name}.png" for name in names_of_figures}
    return pngs | {f"{name}.svg" for name in names_of_figures}


@pytest.fixture(autouse=True)
def blank(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are drawn in tests/report; here they are asked for with what they are functions of,
    and written."""

    def empty(draw: Callable[..., Figure]) -> Callable[..., Figure]:
        def draw_nothing(*arguments: object) -> Figure:
            inspect.signature(draw).bind(*arguments)
            return style.new_figure(1.0, 1.0)

        return draw_nothing

    for name in set(lb.figures.__all__) - set(dir(style)):
        draw = getattr(lb.figures, name)
        if inspect.isfunction(draw) and name != "save_figures":
            monkeypatch.setattr(lb.figures, name, empty(draw))


def test_options_act_on_a_model_file_too(tmp_path: Path) -> None:
    """--degree, --without and --drift beside --model, one by one."""
    file = tmp_path / "m.toml"
    model = lb.HybridModel.first(1)
    file.write_text(model_to_toml(model), encoding="utf-8")
    assert model_from(model=file) == model
    assert model_from(model=file, degree=0) == model.with_degree(0)
    assert model_from(model=file, without=("mount", "truncation")) == model.without(
        "mount", "truncation"
    )
    assert model_from(model=file, drift="time") == model.with_term(lb.terms.Drift("time"))


@pytest.mark.parametrize("preset", ["default", "first", "paper"])
def test_a_model_file_is_one_model_for_commands_and_python(tmp_path: Path, preset: str) -> None:
    file = tmp_path / "m.toml"
    file.write_text(f'schema = 1\npreset = "{preset}"\n', encoding="utf-8")
    assert model_from(model=file) == lb.read_model(file)


def test_option_drift_keeps_the_uncertainties_of_the_model_file(tmp_path: Path) -> None:
    file = tmp_path / "m.toml"
    model = lb.HybridModel.first(1).with_term(lb.terms.Drift("time", length_um=1.7))
    file.write_text(model_to_toml(model), encoding="utf-8")
    assert model_from(model=file) == model
    assert model_from(model=file, drift="temperature") == model.with_term(
        lb.terms.Drift("temperature", length_um=1.7)
    )


def test_drift_is_not_both_added_and_left_out() -> None:
    refuses(
        "drift must be added or left out, got --drift time and",
        model_from,
        drift="time",
        without=("mount", "drift"),
    )


def refuse(name: str) -> None:
    raise AssertionError(name)


@pytest.mark.slow
def test_fit_and_summarize(folder: Path, tmp_path: Path, invoke: Invoke) -> None:
    out = tmp_path / "r"
    limits = ("--tolerance", "C_XXX=60 nm/N", "--tolerance", "E_C(0Y)X=20µrad")
    code, stdout, err = invoke("fit", folder, *FIT, *limits, "--out", out, "--json", "--seed", 5)
    assert (code, err) == (0, "")
    result = json.loads(stdout)
    conformity = lb.assess_conformity(lb.load(out), {"C_XXX": "60 nm/N", "E_C0YX": "± 20 µrad"})
    assert result["conformity"] == {
        name: statement.as_dict() for name, statement in conformity.items()
    }
    assert (result["model"]["degree"], result["provenance"]["seed"]) == (0, 5)
    assert json.loads((out / "summary.json").read_text()) == result
    assert names_in(out) == {"model.toml", "posterior.nc", "summary.json"}
    assert lb.read_model(out / "model.toml") == lb.HybridModel.default(0)
    assert json.loads(invoke("summarize", out, "--json")[1]) == result
    assert invoke("summarize", out, "--out", tmp_path / "s", "--quiet")[0] == 0
    assert json.loads((tmp_path / "s" / "summary.json").read_text()) == result
    narrow = json.loads(invoke("summarize", out / "posterior.nc", "--json", "--ci", 0.5)[1])[
        "parameters"
    ]["C_XXX"]["ci50"]
    wide = result["parameters"]["C_XXX"]["ci95"]
    assert wide[0] < narrow[0] < narrow[1] < wide[1]
    table = invoke("summarize", out)[1]
    assert table.startswith("Verdict: ")
    assert table[: table.index("Conformity")].count("\n") < 46
    for words in (
        "C_XXX",
        "nm/N",
        "E_C(0Y)X",
        "E_XX1 and E_YY1 with bar length",
        "± 20",
    ):
        assert words in table.replace("\n", " ")


@pytest.mark.slow
def test_fit_that_misses_its_target(
    folder: Path, tmp_path: Path, invoke: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, stdout, _ = invoke(
        "fit", folder, "--ess", "1e6", "--max-steps", 200, "--preset", "paper", "--degree", 0
    )
    assert code == 1
    assert "NOT CONVERGED" in stdout
    assert names_in(tmp_path) == set()


def test_fit_of_nearly_equal_forces_with_flat_priors(tmp_path: Path, invoke: Invoke) -> None:
    """Two thousandths apart: answered, with an uncertainty that says the number is worth
    nothing."""
    campaign = simulated(plan((40, 40), forces_N=(100.0, 100.2)))
    code, stdout, _ = invoke(
        "fit", lb.write_campaign(campaign, tmp_path / "c"), "--preset", "paper", *FIT, "--json"
    )
    assert code == 0
    assert (
        json.loads(stdout)["parameters"]["C_XXX"]["sd"] > 1e-3
    )  # mm/N, a hundred times the compliance of a soft machine


@pytest.mark.slow
def test_fit_of_dead_circles_gives_valid_json(tmp_path: Path, invoke: Invoke) -> None:
    campaign = simulated(plan())
    dead = lb.Campaign((campaign.tests[0].with_reading_um(np.zeros(40)), *campaign.tests[1:]))
    stdout = invoke("fit", lb.write_campaign(dead, tmp_path / "c"), *FIT, "--json")[1]
    assert json.loads(stdout, parse_constant=refuse)["fit"]["fitness_percent"]["f036"] is None


@pytest.mark.slow
def test_fit_with_the_prior_of_a_population(folder: Path, tmp_path: Path, invoke: Invoke) -> None:
    record: dict[str, object] = {
        "schema": 1,
        "kind": "population",
        "reference_force_N": 389.0,
        "machines": 4,
        "campaigns": 9,
    }
    record |= {"compliances": {}, "machine": {}, "readings_sha256": []}
    record |= {"doubts": ["With 4 machines how much they differ rests on what was assumed."]}
    record |= {
        "topology": "wCAFYXZSt",
        "next": {"C_XXX": {"unit": "mm/N", "mean": 5.1e-5, "sd": 4e-6}},
    }
    population = tmp_path / "population.json"
    out = tmp_path / "out"
    population.write_text(json.dumps(record | {"sha256": digest_of(record)}))
    fit = ("fit", folder, "--sampler", "independent", "--json")
    code, stdout, err = invoke(*fit, "--prior-from", population, "--out", out)
    assert code == 0
    result = json.loads(stdout)
    assert (result["prior_from"]["sha256"], result["prior_from"]["machines"]) == (
        digest_of(record),
        4,
    )
    (doubt,) = result["prior_from"]["doubts"]
    assert (
        doubt
        == "The population says: With 4 machines how much they differ rests on what was assumed."
    )
    assert f"--prior-from: {doubt}" in err
    entry = result["parameters"]["C_XXX"]
    assert (entry["prior_mean"], entry["prior_sd"], result["model"]["reference_force_N"]) == (
        5.1e-5,
        4e-6,
        389.0,
    )
    again = lb.read_model(out / "model.toml")
    assert (dict(again.prior.means), again.reference_force_N) == ({"C_XXX": 5.1e-5}, 389.0)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), "the order in which the tests are listed, one every 6 min"),
        (("--order", "random"), "The tests were run in random order"),
        (("--no-drift",), "Nothing drifts from test to test (stated)."),
    ],
)
def test_order_and_drift_of_a_table(
    options: tuple[str, ...], words: str, folder: Path, tmp_path: Path, invoke: Invoke
) -> None:
    table = tidy(lb.read_campaign(folder), tmp_path / "t.csv")
    record = json.loads(invoke("check", table, *options, "--json")[1])
    assert any(words in assumption for assumption in record["assumptions"])


def test_an_unknown_order_of_a_table_is_refused(
    folder: Path, tmp_path: Path, invoke: Invoke
) -> None:
    table = tidy(lb.read_campaign(folder), tmp_path / "t.csv")
    code, _, stderr = invoke("check", table, "--order", "sorted")
    assert code == 2
    assert "order must be 'random', got 'sorted'. Correct it." in " ".join(stderr.split())


def test_check_refuses_directions_that_some_tests_state(tmp_path: Path, invoke: Invoke) -> None:
    """As every fit does: unstated directions among stated ones are no campaign."""
    recovered = lb.embedded_campaign()
    shutil.copytree(recovered, tmp_path / "c")
    description = (recovered / "campaign.toml").read_text()
    (tmp_path / "c" / "campaign.toml").write_text(description.replace('direction = "CW"\n', "", 1))
    code, stdout, err = invoke("check", tmp_path / "c")
    assert (code, stdout) == (2, "")
    assert "test 'f036' must state its direction, CW or CCW" in err


def test_check_of_a_table(tmp_path: Path, invoke: Invoke) -> None:
    """Its options are fields of the campaign; what looks odd in several tests is said once. The
    rest is held by its golden."""
    lines = ["test;pressure_bar;angle_deg;reading_um"]
    for test in "ab":
        lines += [f"{test};2;{angle};{angle // 20 % 5}" for angle in range(0, 360, 10)]
    (tmp_path / "all.csv").write_text("\n".join(lines))
    options = (
        "--raw",
        "--mount-um-per-bar",
        1.5,
        "--force-slope",
        100,
        "--force-offset",
        0,
        "--plane",
        "YZ",
        "--json",
    )
    record = json.loads(invoke("check", tmp_path / "all.csv", *options)[1])
    assert (record["tests"][0]["force_N"], record["plane"]) == (200.0, "YZ")
    assert any("1.5 µm/bar, not compensated" in text for text in record["assumptions"])
    stdout = invoke("check", tmp_path / "all.csv", *options[:-1], "--mount-U-percent", 2)[1]
    assert stdout.count("Look at a, b: readings go in steps of 1 µm") == 1
    assert re.search(
        r"mount deflection +1.500 +0.015 +µm/bar +certificate\s+(in campaign.toml: )?\[mount\]"
        r" U_percent",
        stdout,
    )
    assert [
        uncertainty["sd"]
        for uncertainty in record["uncertainties"]
        if uncertainty["name"] == "bar_length"
    ] == [9.4e-3]


def test_a_model_may_allow_a_negative_compliance(tmp_path: Path, invoke: Invoke) -> None:
    truths = tmp_path / "truths.toml"
    truths.write_text("schema = 1\nforces_N = [100.0, 300.0, 500.0]\n[parameters]\nC_XXX = -6e-5\n")
    assert invoke("simulate", truths, "--out", tmp_path / "no")[0] == 2
    assert invoke("simulate", truths, "--out", tmp_path / "yes", "--without", "truncation")[0] == 0


def test_check_writes_what_json_prints(folder: Path, tmp_path: Path, invoke: Invoke) -> None:
    out = tmp_path / "checked"
    printed = json.loads(invoke("check", folder, "--json")[1])
    assert f"Written: {out}" in invoke("check", folder, "--out", out)[1]
    assert json.loads((out / "check.json").read_text()) == printed
    code, _, err = invoke("check", folder, "--out", out)
    assert (code, "--force" in err) == (2, True)


def test_quiet_commands_do_not_say_what_they_wrote(
    folder: Path, tmp_path: Path, invoke: Invoke
) -> None:
    assert "Written" in invoke("simulate", folder, "--out", tmp_path / "loud")[1]
    assert invoke("simulate", folder, "--out", tmp_path / "quiet", "--quiet") == (0, "", "")
    assert names_in(tmp_path / "quiet") == names_in(tmp_path / "loud")


def test_simulate_writes_angles_in_the_direction_in_which_a_plan_is_run(
    tmp_path: Path, invoke: Invoke
) -> None:
    """Angles increase counterclockwise. The arc from 20° to 240° is run clockwise from 240°."""
    (tmp_path / "plan").mkdir()
    arc = "readings = 100\nstart_deg = 20.0\narc_deg = 220.0\n"
    tests = [
        '[[test]]\nforce_N = 36.0\ndirection = "CW"\n',
        '[[test]]\nforce_N = 200.0\ndirection = "CCW"\n',
        '[[test]]\nforce_N = 742.0\ndirection = "CW"\n' + arc,
    ]
    head = 'schema = 1\ntopology = "wCAFYXZSt"\nplane = "XY"\nradius_mm = 150.0\n'
    (tmp_path / "plan" / "campaign.toml").write_text(head + "".join(tests))
    assert invoke("simulate", tmp_path / "plan", "--out", tmp_path / "run")[0] == 0
    clockwise, other, arc_clockwise = lb.read_campaign(tmp_path / "run").tests
    assert np.all(np.diff(clockwise.angle_deg) < 0.0)
    assert np.all(np.diff(other.angle_deg) > 0.0)
    assert np.all(np.diff(arc_clockwise.angle_deg) < 0.0)
    assert arc_clockwise.angle_deg[[0, -1]] == pytest.approx([240.0, 20.0])


def test_simulate_from_truths(tmp_path: Path, invoke: Invoke) -> None:
    truths = tmp_path / "truths.toml"
    lines = [
        "schema = 1",
        "forces_N = [50.0, 300.0, 700.0]",
        "readings = 90",
        'machine_id = "VMC 07"',
        "date = 2026-11-20",
        'order = "random"',
        "drift = false",
        "[parameters]",
        "C_XXX = 6e-5",
        "C_YYY = 4e-5",
        "[hyper_um]",
        "sigma = 0.2",
        "delta = 0.0",
        "kappa = 0.0",
        "tau = 0.0",
    ]
    truths.write_text("\n".join(lines), encoding="utf-8")
    options = ("--preset", "first", "--without", "bar-length,mount,force-error", "--seed", 3)
    assert invoke("simulate", truths, "--out", tmp_path / "c", *options)[0] == 0
    campaign = lb.read_campaign(tmp_path / "c")
    truth = json.loads((tmp_path / "c" / "truth.json").read_text())
    assert (truth["sha256"], truth["parameters"]["C_XXX"]) == (campaign.sha256, 6e-5)
    assert (campaign.machine_id, campaign.date) == ("VMC 07", "2026-11-20")
    assert (campaign.order, campaign.drift) == ("random", False)
    angle = campaign.tests[2].angles_rad()
    expected = 700.0 * (6e-5 * np.cos(angle) ** 2 + 4e-5 * np.sin(angle) ** 2)
    assert np.std(campaign.tests[2].readings_mm() - expected) == pytest.approx(0.2e-3, rel=0.3)
    assert invoke("simulate", truths, "--out", tmp_path / "d", *options)[0] == 0
    assert lb.read_campaign(tmp_path / "d").sha256 == campaign.sha256


def test_truth_states_what_was_drawn_and_can_be_simulated_again(
    planned: Path, tmp_path: Path, invoke: Invoke
) -> None:
    """Effects and C(F) stand in truth.json; another simulation takes parameters and scales from it,
    draws the rest anew and says so."""
    assert invoke("simulate", planned, "--out", tmp_path / "c", "--seed", 1)[0] == 0
    path = tmp_path / "c" / "truth.json"
    truth = json.loads(path.read_text())
    assert truth["units"]["joint_load_X_seat"] == "mm/N"
    assert truth["change_with_force"]["C_XXX"]["forces_N"] == [36.0, 400.0, 742.0]
    again = tmp_path / "again"
    code, out, err = invoke("simulate", planned, "--truth", path, "--out", again, "--seed", 2)
    assert code == 0
    assert "effects, and the scales of its circles, are not used" in " ".join((out + err).split())
    second = json.loads((again / "truth.json").read_text())
    assert second["parameters"] == truth["parameters"]
    assert second["hyper_um"]["sigma"] == pytest.approx(truth["hyper_um"]["sigma"])
    assert second["effects"] != truth["effects"]
    damaged = tmp_path / "damaged.json"
    damaged.write_text('{"schema": 1}', encoding="utf-8")
    code, _, err = invoke("simulate", planned, "--truth", damaged, "--out", tmp_path / "no")
    assert code == 2
    assert "must be a truth written by this version of ldbb-bayes simulate" in " ".join(err.split())


@pytest.mark.slow
def test_certificates_are_options_too(
    folder: Path, planned: Path, tmp_path: Path, invoke: Invoke
) -> None:
    """Of what reads, and of what writes a campaign: they say what is written over what
    campaign.toml says."""
    table = tidy(lb.read_campaign(folder), tmp_path / "t.csv")
    stated = ("--balls", "G20", "--tool-ball", "0.1um", "--bar-U-um", 2)
    work_ball = lb.Ball(grade="G20")
    instrument = lb.Instrument(work_ball, lb.Ball(sphericity_um=0.1), bar_U_um=2.0)
    for command in (
        ("simulate", planned),
        ("design", folder, "--tests", 3, "--forces", "36,742"),
        ("import", table),
    ):
        out = tmp_path / command[0]
        assert invoke(*command, *stated, "--out", out)[0] == 0
        assert lb.read_campaign(out).instrument == instrument
    assert (
        invoke("fit", folder, *FIT, "--preset", "first", *stated, "--out", tmp_path / "fit")[0] == 0
    )
    assert campaign_of(lb.load(tmp_path / "fit")).instrument == instrument
    assert invoke("simulate", out, "--out", tmp_path / "again", "--bar-U-um", 3)[0] == 0
    assert lb.read_campaign(tmp_path / "again").instrument == replace(instrument, bar_U_um=3.0)


def test_identify_prints_degeneracies_on_request(planned: Path, invoke: Invoke) -> None:
    """One screen without, and every statement with --details."""
    plain = invoke("identify", planned, "--degree", 0)[1]
    detailed = " ".join(invoke("identify", planned, "--degree", 0, "--details")[1].split())
    assert len(plain.splitlines()) <= 45
    assert "looks exactly like" not in plain
    assert "--details" in plain
    record = json.loads(invoke("identify", planned, "--degree", 0, "--json")[1])
    assert record["degeneracies"]
    for entry in record["degeneracies"]:
        assert typeset(entry["statement"]) in detailed
    for name in record["parameters"]:
        assert f"\n{display_name(name)} " in plain


def test_identify(planned: Path, tmp_path: Path, invoke: Invoke) -> None:
    """What it answers is held by its goldens."""
    out = tmp_path / "i"
    record = json.loads(invoke("identify", planned, "--degree", 0, "--json", "--out", out)[1])
    figures = figure_files("prior_and_posterior compliance_atlas geometric_atlas")
    assert (
        names_in(out)
        == {"identify.json", "parameters.csv", "alias.csv", "correlation.csv"} | figures
    )
    assert json.loads((out / "identify.json").read_text()) == record
    assert np.isfinite(pd.read_csv(out / "alias.csv", index_col="parameter").to_numpy()).all()


@pytest.fixture(scope="module")
def three(tmp_path_factory: pytest.TempPathFactory) -> Path:
    campaign = simulated(plan((30, 30, 30), forces_N=(36.0, 400.0, 742.0)), seed=1)
    return lb.write_campaign(campaign, tmp_path_factory.mktemp("campaign") / "c")


@pytest.mark.slow
def test_compare_with_another_model(three: Path, tmp_path: Path, invoke: Invoke) -> None:
    out = tmp_path / "out"
    other = tmp_path / "own.toml"
    without = ("truncation", "force-error", "mount", "discrepancy", "hysteresis")
    slopes = (f"{name}_1" for name in ("C_XXX", "C_YYY", "C_CXY", "C_CYY", "C_CCY"))
    one_slope = lb.HybridModel.first(1).without(*without).fixing(*slopes)
    other.write_text(model_to_toml(one_slope))
    options = (
        "--without",
        ",".join(without),
        "--tolerance",
        0.1,
        "--also",
        f"one slope={other}",
        "--json",
        "--seed",
        2,
    )
    code, stdout, _ = invoke("compare", three, *options, "--out", out)
    record = json.loads(stdout)
    assert (code, set(record["models"])) == (0, {"constant", "linear", "one slope"})
    assert set(record["log_bayes_factor"]) == {"linear/constant", "one slope/constant"}
    assert (record["seed"], record["sensitivity_of"]) == (2, "linear/constant")
    assert json.loads((out / "comparison.json").read_text()) == record
    assert len(pd.read_csv(out / "local_fits.csv")) == 2 * 13
    figures = figure_files("evidence compliance_with_local_fits geometry_with_local_fits")
    assert names_in(out) == {"comparison.json", "local_fits.csv"} | figures


def test_what_looks_odd_is_said_whoever_reads_it(
    folder: Path, tmp_path: Path, invoke: Invoke
) -> None:
    campaign = lb.read_campaign(folder)
    tests = [
        replace(test, force_N=test.force_N / 1000.0, direction="CW") for test in campaign.tests
    ]
    lb.write_campaign(replace(campaign, tests=tuple(tests)), tmp_path / "odd")
    stdout = " ".join(invoke("identify", tmp_path / "odd")[1].split())
    assert "Note: the largest force is 0.742 N: check the unit" in stdout
    assert "stated CW, but the angles run CCW" in stdout


@pytest.mark.slow
@pytest.mark.usefixtures("few_states")
def test_design_is_a_plan_that_others_read(folder: Path, tmp_path: Path, invoke: Invoke) -> None:
    """Identify asks it, simulate runs it, design judges it; an existing one is kept."""
    out = tmp_path / "next"
    arguments = (
        "design",
        folder,
        "--tests",
        3,
        "--forces",
        "36:742:353",
        "--clockings",
        "0/0,45/90",
    )
    record = json.loads(invoke(*arguments, "--against", f"own={folder}", "--json", "--out", out)[1])
    assert record == json.loads((out / "design.json").read_text())
    tables = {"expected.csv", "sensitivity.csv"}
    figures = figure_files("expected_widths")
    files = {"campaign.toml", "model.toml", "design.json", "pilot", "sheet.html"}
    assert names_in(out) == files | tables | figures
    next_tests = lb.read_campaign(out)
    assert next_tests.pilot is not None
    assert next_tests.pilot.sha256 == lb.read_campaign(folder).sha256
    assert next_tests.is_plan
    listed = []
    for test in record["tests"]:
        circle = (test["force_N"], test["work_ball_deg"], test["tool_ball_deg"])
        listed += [circle] * test["count"]
    assert sorted(listed) == sorted(
        (t.force_N, t.work_ball_deg, t.tool_ball_deg) for t in next_tests.tests
    )
    assert len(listed) == 3
    assert {force for force, *_ in listed} <= {36.0, 389.0, 742.0}
    assert [entry["name"] for entry in record["compared"]] == ["equal steps", "own"]
    assert len(pd.read_csv(out / "expected.csv")) == 19
    assert len(pd.read_csv(out / "sensitivity.csv")) == 6
    assert (
        json.loads(invoke("identify", out, "--model", out / "model.toml", "--json")[1])["measured"]
        is False
    )
    assert invoke("simulate", out, "--out", tmp_path / "run")[0] == 0
    assert not lb.read_campaign(tmp_path / "run").is_plan
    assert "must not exist" in invoke(*arguments, "--out", out)[2]
    stdout = " ".join(
        invoke("design", folder, "--forces", "36,742", "--radii", "150,100", "--tests", 4)[
            1
        ].split()
    )
    assert re.search(r"Run in this order: (f\w+ \(1[05]0 mm(, balls [\d/]+°)?\),? ?){4}", stdout)


@pytest.mark.usefixtures("few_states")
def test_design_of_a_table(folder: Path, tmp_path: Path, invoke: Invoke) -> None:
    """A tidy table as pilot, with its options; the paper's preset; added to what was run."""
    table = tidy(lb.read_campaign(folder), tmp_path / "tidy.csv")
    options = (
        "--radius-mm",
        100,
        "--preset",
        "paper",
        "--augment",
        "--tests",
        2,
        "--forces",
        "36,742",
        "--json",
    )
    record = json.loads(invoke("design", table, *options)[1])
    assert (record["criterion"], record["expected"]["C_XXX"]["prior_sd"]) == ("d", None)
    assert record["tests"][0]["radius_mm"] == 100.0


@pytest.mark.slow
def test_validate(planned: Path, tmp_path: Path, invoke: Invoke) -> None:
    """What it answers is held by its golden."""
    out = tmp_path / "v"
    common = (
        "validate",
        planned,
        "--degree",
        0,
        "--replicates",
        10,
        "--draws",
        19,
        "--seed",
        3,
        "--workers",
        1,
    )
    record = json.loads(invoke(*common, "--json", "--out", out)[1])
    assert names_in(out) == {"ranks.csv", "validation.json"} | figure_files("rank_ecdf")
    assert json.loads((out / "validation.json").read_text()) == record
    ranks = pd.read_csv(out / "ranks.csv", index_col="replicate")
    assert (ranks.shape, ranks.min().min() >= 0, ranks.max().max() <= 19) == ((10, 19), True, True)
    assert "must not exist" in invoke(*common, "--out", out)[2]


@pytest.mark.slow
def test_workflow(three: Path, tmp_path: Path, invoke: Invoke) -> None:
    out = tmp_path / "w"
    common = ("validate", three, "--workflow", "--preset", "first", "--degree", 0)
    few = ("--replicates", 10, "--draws", 19, "--workers", 1)
    code, stdout, _ = invoke(*common, *few, "--json", "--out", out)
    record = json.loads(stdout)
    assert code == (0 if record["passed"] else 1)
    assert json.loads((out / "workflow.json").read_text()) == record
    assert names_in(out) == {"ranks.csv", "workflow.json"} | figure_files(
        "rank_ecdf workflow_checks"
    )
    assert len(record["prior_ranges"]) == len(record["left_out"]) == 3
    assert record["calibration"]["draws"] == 19


def always(answer: object) -> Callable[..., object]:
    """Return a function that gives the same answer to everything."""

    def give(*_: object, **__: object) -> object:
        return answer

    return give


@pytest.mark.usefixtures("few_states")
def test_answers_that_miss(
    three: Path, compared: Comparison, invoke: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An evidence less exact than asked, a design that is not proven best, ranks that are not
    uniform: exit code 1."""
    rough = replace(compared, largest_error=1.0, by_emcee=2)
    best = lb.design(
        lb.HybridModel.first(1), lb.read_campaign(three), tests=3, forces_N=(36.0, 742.0)
    )
    bound = best.certificate.bound
    broken = replace(
        best, certificate=replace(best.certificate, max_sensitivity=2.0 * bound, holds=False)
    )
    wrong = Validation(
        ("C_XXX", LOG_LIKELIHOOD), np.zeros((10, 2), dtype=int), 19, "joint", 0.95, ()
    )
    sentences = (
        "For 2 of the log evidences weights could not be trusted",
        "Not proven best",
        "NOT CALIBRATED",
    )
    functions = {"compare": "compare", "design": "design", "validate": "calibrate"}
    for name, answer, words in zip(functions, (rough, broken, wrong), sentences, strict=True):
        monkeypatch.setattr(lb, functions[name], always(answer))
        code, stdout, _ = invoke(name, three)
        assert (code, words in " ".join(stdout.split())) == (1, True), name
    assert json.loads(invoke("compare", three, "--json")[1])["largest_error"] == 1.0


def test_machine_writes_its_record_and_atlases(tmp_path: Path, invoke: Invoke) -> None:
    """What it answers is held by its golden."""
    out = tmp_path / "m"
    atlases = "compliance_atlas_XY compliance_atlas_YZ geometric_atlas_XY geometric_atlas_YZ"
    assert invoke("machine", "wXFYZt", "--plane", "XY,YZ", "--out", out)[0] == 0
    assert names_in(out) == {"machine.json"} | figure_files(atlases)
    assert invoke("machine", "wXFYZt", "--out", out)[0] == 2
    assert invoke("machine", "wXFYZt", "--out", out, "--force")[0] == 0
    assert not (out / "compliance_atlas_YZ.svg").exists()
