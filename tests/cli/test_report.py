"""``ldbb-bayes report``: what it writes, what it refuses."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
from campaigns import Invoke, cases, plan, refuses, simulated
from reports import NOT_COMPARED, fitted, undrawn

import ldbb_bayes as lb
from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.cli.fit_results import write_result
from ldbb_bayes.cli.report_making import report_figure_files
from ldbb_bayes.report.fit_record import full_result
from ldbb_bayes.report.page import REPORT_FILES
from ldbb_bayes.results import json_text


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    """Designs and figures have tests of their own."""
    if request.function is not test_a_report_writes_its_figures:
        undrawn(monkeypatch)
    monkeypatch.setattr("ldbb_bayes.report.findings.design", refuse_to_design)


def refuse_to_design(*_: object, **__: object) -> None:
    raise lb.InputError(NOT_COMPARED)


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory, recovered: lb.Campaign) -> Path:
    posterior = fitted(lb.HybridModel.first(1), recovered)
    folder = tmp_path_factory.mktemp("fit") / "result"
    write_result(posterior, full_result(posterior, 0.95), folder)
    return folder


@pytest.fixture(scope="module")
def comparison(tmp_path_factory: pytest.TempPathFactory, compared: Comparison) -> Path:
    folder = tmp_path_factory.mktemp("comparison")
    record = {"schema": 1, "seed": 1, **compared.as_dict()}
    (folder / "comparison.json").write_text(json_text(record), encoding="utf-8")
    return folder


@pytest.mark.slow
def test_everything_written(result: Path, comparison: Path, tmp_path: Path, invoke: Invoke) -> None:
    out = tmp_path / "out"
    limits = ("--tolerance", "C_XXX=60 nm/N", "--tolerance", "stiffness_Y=18N/um")
    code, stdout, _ = invoke(
        "report", result, "--out", out, "--comparison", comparison, *limits, "--quiet", "--json"
    )
    record = json.loads(stdout)
    assert code == 0
    decided = lb.assess_conformity(lb.load(result), {"C_XXX": "60 nm/N", "stiffness_Y": "18 N/µm"})
    conform = {name: sources.as_dict() for name, sources in decided.items()}
    assert record["conformity"] == conform
    filed = pd.read_csv(out / "tables" / "conformity.csv", index_col="quantity")
    assert filed["probability"].to_dict() == {
        name: pytest.approx(sources["probability"]) for name, sources in conform.items()
    }
    assert record == json.loads((out / "report.json").read_text(encoding="utf-8"))
    assert sorted(path.name for path in out.iterdir()) == sorted(REPORT_FILES)
    assert sorted(path.name for path in result.iterdir()) == [
        "model.toml",
        "posterior.nc",
        "summary.json",
    ]
    summary = json.loads((result / "summary.json").read_text())["parameters"]
    table = pd.read_csv(out / "tables" / "results.csv", index_col="parameter")
    covariance = pd.read_csv(out / "tables" / "covariance.csv", index_col="parameter")
    assert list(covariance.index) == list(covariance.columns)
    budget = pd.read_csv(out / "tables" / "budget.csv")
    for name, entry in summary.items():
        assert table.loc[name, "mean"] == pytest.approx(entry["mean"], rel=1e-12)
        assert table.loc[name, "U_k2"] == pytest.approx(2.0 * entry["sd"], rel=1e-9)
        assert [table.loc[name, "ci_low"], table.loc[name, "ci_high"]] == pytest.approx(
            entry["ci95"], rel=1e-9
        )
        assert covariance.loc[name, name] == pytest.approx(entry["sd"] ** 2, rel=1e-9)
        sources = budget[budget["parameter"] == name]
        assert sources["share"].sum() == pytest.approx(1.0, abs=1e-9)
        assert (sources["share"] * entry["sd"] ** 2).sum() == pytest.approx(
            entry["sd"] ** 2, rel=1e-2
        )
    np.testing.assert_allclose(
        np.diag(pd.read_csv(out / "tables" / "correlation.csv", index_col="parameter")), 1.0
    )
    assert set(record["tables"]) == {path.stem for path in (out / "tables").iterdir()}
    page = (out / "report.html").read_text(encoding="utf-8")
    for phrase in (
        "Slopes one by one",
        "does not belong" if "does not belong" in page else "Every test belongs",
        NOT_COMPARED,
    ):
        assert phrase in page
    assert (
        f"{out / 'report.html'} must not exist"
        in invoke("report", result, "--out", out, "--comparison", comparison)[2]
    )


@pytest.mark.slow
def test_a_report_writes_its_figures(
    result: Path, comparison: Path, tmp_path: Path, invoke: Invoke
) -> None:
    figures = tmp_path / "figures"
    assert (
        invoke(
            "report",
            result,
            "--out",
            tmp_path,
            "--comparison",
            comparison,
            "--figures",
            figures,
            "--quiet",
        )[0]
        == 0
    )
    names = {path.name for path in figures.iterdir()}
    for figure in ("traces", "budget", "evidence"):
        assert {f"{figure}.svg", f"{figure}.png", f"{figure}.pdf"} <= names
    assert all((figures / name).stat().st_size > 1000 for name in names)
    assert names <= set(report_figure_files())


@pytest.mark.slow
def test_side_by_side(result: Path, comparison: Path, tmp_path: Path, invoke: Invoke) -> None:
    campaign = lb.HybridModel.first(1).simulate(plan(), seed=1).campaign
    lb.save(
        fitted(lb.HybridModel.first(1), replace(campaign, name="after | <b>repair</b>")),
        tmp_path / "after.nc",
    )
    out = tmp_path / "out"
    arguments = [
        "report",
        result,
        tmp_path / "after.nc",
        "--out",
        out,
        "--comparison",
        comparison,
        "--quiet",
    ]
    code, printed, _ = invoke(*arguments)
    assert code == 0
    assert "Instruments are taken as independent" in " ".join(printed.split())
    assert re.search(r"^parameter +first +second +difference", printed, re.MULTILINE)
    table = pd.read_csv(out / "tables" / "differences.csv")
    assert set(table["campaign"]) == {"after | <b>repair</b>"}
    assert table["probability_of_increase"].between(0.0, 1.0).all()
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "Second: after | &lt;b&gt;repair&lt;/b&gt; (readings" in page
    assert "beside after | &lt;b&gt;repair&lt;/b&gt;</h2>" in page
    assert "Instruments are taken as independent" in page
    assert invoke(*arguments, "--same-instrument", "--force")[0] == 0
    again = (out / "report.html").read_text(encoding="utf-8")
    assert "The instrument was the same" in again
    assert again.index("Not one instrument") < again.index("<nav")
    narrower = (
        pd.read_csv(out / "tables" / "differences.csv").set_index("parameter")["sd"]
        / table.set_index("parameter")["sd"]
    )
    assert narrower["E_YX2"] < 0.6
    assert invoke(*arguments, "--same-machine", "--force", "--language", "de")[0] == 0
    german = (out / "report.html").read_text(encoding="utf-8")
    assert "Die Maschine war dieselbe" in german
    assert "Die Messgeräte gelten als unabhängig" in german
    assert "The machine" not in german
    assert (
        invoke("report", result, "--out", out, "--comparison", comparison, "--force", "--quiet")[0]
        == 0
    )
    assert not (out / "tables" / "differences.csv").exists()


def test_a_circle_of_the_second_campaign_that_was_read_twice_is_named(
    result: Path, comparison: Path, tmp_path: Path, invoke: Invoke
) -> None:
    """Nothing in the fit shows it, and the differences rest on it."""
    campaign = lb.HybridModel.first(1).simulate(plan(), seed=1).campaign
    again = replace(campaign.tests[0], name="again")
    twice = replace(campaign, name="after", tests=(*campaign.tests, again))
    lb.save(fitted(lb.HybridModel.first(1), twice), tmp_path / "after.nc")
    arguments = ("--out", tmp_path / "out", "--comparison", comparison, "--quiet")
    code, printed, _ = invoke("report", result, tmp_path / "after.nc", *arguments)
    assert code == 0
    note = "Note: after: Tests f036 and again hold the same readings: a file read twice?"
    assert note in " ".join(printed.split())


def spoiled(result: Path, folder: Path, *, cut: bool) -> Path:
    """A result whose posterior is cut short, or has a few bytes of its draws changed."""
    folder.mkdir()
    data = bytearray((result / "posterior.nc").read_bytes())
    middle = len(data) // 2
    data[middle : middle + 64] = bytes(255 - byte for byte in data[middle : middle + 64])
    (folder / "posterior.nc").write_bytes(data[:5000] if cut else data)
    return folder


@pytest.mark.slow
def test_reports_that_cannot_be_are_refused(
    result: Path, comparison: Path, tmp_path: Path, invoke: Invoke, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One line, exit code 2, nothing written."""
    monkeypatch.setattr(lb, "load", cache(lb.load))
    other = tmp_path / "other.nc"
    lb.save(
        fitted(lb.HybridModel.first(0), simulated(plan((40, 40), forces_N=(100.0, 600.0)))), other
    )
    damaged = tmp_path / "damaged"
    foreign = tmp_path / "foreign"
    damaged.mkdir()
    (damaged / "comparison.json").write_text("{")
    foreign.mkdir()
    (foreign / "mine.txt").write_text("mine")
    out = tmp_path / "out"
    folders = {
        "RESULT": result,
        "NOTHING": tmp_path / "nothing",
        "OTHER": other,
        "COMPARISON": comparison,
        "DAMAGED": damaged,
        "FOREIGN": foreign,
        "SPOILED": spoiled(result, tmp_path / "spoiled", cut=True),
        "ALTERED": spoiled(result, tmp_path / "altered", cut=False),
    }
    for words, message in cases(__file__, "report.toml")["refused"]:
        code, _, error = invoke(
            "report", *(folders.get(word, word) for word in words), "--out", out, "--quiet"
        )
        assert code == 2, message
        assert message in " ".join(error.split()), error
        assert "Traceback" not in error
        assert not out.exists(), message
    assert (foreign / "mine.txt").read_text() == "mine"


@pytest.mark.slow
def test_a_failure_leaves_the_old_page(
    result: Path, comparison: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, invoke: Invoke
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "report.html").write_text("old")
    (out / "tables").mkdir()
    (out / "tables" / "budget.csv").write_text("old")

    def fail(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(pd.DataFrame, "to_csv", fail)
    code, _, error = invoke(
        "report", result, "--comparison", comparison, "--out", out, "--force", "--quiet"
    )
    monkeypatch.undo()
    assert (code, "No space left on device" in error) == (2, True)
    contents = {path.name: path.read_text() for path in out.rglob("*") if path.is_file()}
    assert contents == {"report.html": "old", "budget.csv": "old"}


@pytest.mark.parametrize("change", ["no digest", "unit"])
def test_a_posterior_of_which_the_digest_says_nothing_is_refused(
    result: Path, tmp_path: Path, change: str
) -> None:
    shutil.copytree(result, tmp_path / "changed")
    with h5py.File(tmp_path / "changed" / "posterior.nc", "r+") as file:
        if change == "no digest":
            del file["provenance"].attrs["sha256"]
        else:
            file["posterior"]["C_XXX"].attrs["unit"] = "um"
    refuses("not those of its digest", lb.load, tmp_path / "changed")


def test_the_terminal_states_what_sheet_1_states(
    result: Path, tmp_path: Path, invoke: Invoke
) -> None:
    out = tmp_path / "out"
    code, stdout, _ = invoke("report", result, "--out", out, "--sheets-only")
    state = json.loads((out / "report.json").read_text(encoding="utf-8"))["state"]
    printed = " ".join(stdout.split())
    assert code == 0
    assert state.startswith("THE RESULTS CAN BE USED")
    assert " ".join(state.split()) in printed


def test_the_cure_of_readings_at_one_force_is_one_that_report_takes(
    tmp_path: Path, invoke: Invoke
) -> None:
    """A report of readings refuses --degree 0: not that, but a fit of it, leads to a report."""
    campaign = simulated(plan())
    one_force = replace(campaign, tests=campaign.tests[:1])
    lb.write_campaign(one_force, tmp_path / "one")
    code, _, stderr = invoke("report", tmp_path / "one", "--yes", "--out", tmp_path / "out")
    assert code == 2
    message = " ".join(stderr.split())
    assert "Use degree 0" not in message
    assert "fit CAMPAIGN --degree 0 --out DIR, then ldbb-bayes report DIR" in message
    result = tmp_path / "result"
    posterior = fitted(lb.HybridModel.first(0), one_force)
    write_result(posterior, full_result(posterior, 0.95), result)
    code, _, stderr = invoke("report", result, "--out", tmp_path / "page", "--sheets-only")
    assert code == 0, stderr


def test_the_help_says_what_yes_assumes_and_what_it_refuses(tmp_path: Path, invoke: Invoke) -> None:
    """A unit that the numbers leave open is refused; machine, mount and balls are assumed."""
    _, stdout, _ = invoke("report", "--help")
    words = " ".join(stdout.replace("│", " ").split())
    assert "machine, mount and balls that nothing states are assumed" in words
    assert "tables that leave something else open are refused" in words
    table = tmp_path / "150N.csv"
    rows = [f"{angle},{0.75 * (angle % 90) / 90}" for angle in range(0, 360, 5)]
    table.write_text("\n".join(["angle_deg,deviation", *rows]))
    code, _, stderr = invoke("report", table, "--yes", "--out", tmp_path / "out")
    assert code == 2
    assert "readings must have a unit" in stderr
