"""`import`: what it prints, writes and keeps; every assumption it tells has an option that exists."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

import ldbb_bayes as lb
from ldbb_bayes.cli.main import app

sys.path.insert(0, str(Path(__file__).parents[2] / "studies" / "10_files"))
import awkward

runner = CliRunner()


@pytest.fixture
def files(tmp_path: Path) -> list[str]:
    case = awkward.CASES["02_semicolon"]
    for name, content in case.files.items():
        (tmp_path / name).write_bytes(content)
    return [str(tmp_path / name) for name in case.files]


def test_it_says_what_it_assumed_and_what_to_do_next(files: list[str], tmp_path: Path) -> None:
    found = runner.invoke(app, ["import", *files, "--out", str(tmp_path / "c")], env={"COLUMNS": "200"})
    assert found.exit_code == 0
    for word in ("separator: ';'", "decimal mark: ,", "pressure_bar: 3.5", "topology: wCAFYXZSt", "3 places", "ldbb-bayes check"):
        assert word in found.output
    tables = {f"{Path(file).stem}.csv" for file in files}
    assert {path.name for path in (tmp_path / "c").iterdir()} == {"campaign.toml", "import.toml", *tables}
    assert runner.invoke(app, ["check", str(tmp_path / "c")]).exit_code == 0


def test_every_option_that_is_told_exists(tmp_path: Path) -> None:
    """Of all awkward files, as JSON."""
    known = runner.invoke(app, ["import", "--help"], env={"COLUMNS": "200"}).output
    for name in ("14_words", "20_no_header", "24_log", "19_distances", "22_tidy_psi", "09_windows"):
        case, place = awkward.CASES[name], tmp_path / name
        place.mkdir()
        for file, content in case.files.items():
            (place / file).write_bytes(content)
        found = runner.invoke(
            app, ["import", *(str(place / f) for f in case.files), "--out", str(place / "c"), "--json", *case.options]
        )
        record = json.loads(found.stdout)
        assert record["schema"] == 1
        assert record["campaign"]["tests"] == 3
        assert record["layout"]["columns"]
        for assumed in record["assumptions"]:
            for option in re.findall(r"--[\w-]+", assumed["option"]):
                assert option in known, (name, assumed)


def test_an_existing_folder_is_kept_unless_forced(files: list[str], tmp_path: Path) -> None:
    command = ["import", *files, "--out", str(tmp_path / "c")]
    assert runner.invoke(app, command).exit_code == 0
    first = lb.read_campaign(tmp_path / "c").sha256
    again = runner.invoke(app, [*command, "--sign", "-1"])
    assert again.exit_code == 2
    assert "--force" in again.output
    assert lb.read_campaign(tmp_path / "c").sha256 == first
    assert runner.invoke(app, [*command, "--sign", "-1", "--force"]).exit_code == 0
    assert lb.read_campaign(tmp_path / "c").sha256 != first


def test_loads_are_given_in_the_order_of_the_files(files: list[str], tmp_path: Path) -> None:
    given = ["--forces-N", "100,200,300", "--name", "machine 7", "--raw"]
    assert runner.invoke(app, ["import", *files, "--out", str(tmp_path / "c"), *given]).exit_code == 0
    campaign = lb.read_campaign(tmp_path / "c")
    assert campaign.forces_N.tolist() == [100.0, 200.0, 300.0]
    assert (campaign.name, campaign.mount.compensated) == ("machine 7", False)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--forces-N", "1,2"], "one number for each test, got 2 for 3 tests"),
        (["--pressures-bar", "1;2;3"], "numbers separated by commas"),
        (["--sign", "3"], "sign must be valid, got 3"),
        (["--start-deg", "nan"], "--start-deg must be valid, got nan"),
        (["--separator", "dot"], "separator must be one of comma, semicolon"),
        (["--layout", "none.toml"], "none.toml must be a readable TOML file, got nothing"),
        (["--plane", "AB"], "plane must be one of XY, YZ, ZX"),
        (["--header-line", "70"], "line 70"),
    ],
)
def test_wrong_options(options: list[str], said: str, files: list[str], tmp_path: Path) -> None:
    found = runner.invoke(app, ["import", *files, "--out", str(tmp_path / "c"), *options])
    assert found.exit_code == 2
    assert said in " ".join(found.output.split())
    assert not (tmp_path / "c").exists()


def test_brackets_are_printed_as_they_stand(tmp_path: Path) -> None:
    """Not taken for marks of the printer, some of which end in a traceback."""
    rows = [f"{5 * k},{k % 7},{k}" for k in range(72)]
    path = tmp_path / "ma[x] 36N.csv"
    path.write_text("\n".join(["Angle [deg],Reading [um],Speed [/min]", *rows]), encoding="utf-8")
    found = runner.invoke(app, ["import", str(path), "--out", str(tmp_path / "c")], env={"COLUMNS": "300"})
    assert found.exit_code == 0
    for words in ("[deg]'", "[um]'", "[/min]", "[[test]]", "ma[x]"):
        assert words in found.output


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--unit", "furlong"], "--unit must be valid, got 'furlong': it should be one of um"),
        (["--mount-um-per-bar", "nan"], "--mount-um-per-bar must be a finite number"),
        (["--force-slope", "0"], "--force-slope must be above zero, got 0"),
        (["--radius-mm", "-1"], "--radius-mm must be above zero, got -1"),
        (["--name", ""], "--name must not be empty"),
        (["--angle-column", "Winkel"], "column of the angle must be one of"),
        (["--overshoot-deg", "-5"], "--overshoot-deg must be valid"),
    ],
)
def test_messages_name_the_option(options: list[str], said: str, files: list[str], tmp_path: Path) -> None:
    found = runner.invoke(app, ["import", *files, "--out", str(tmp_path / "c"), *options])
    assert (found.exit_code, said in " ".join(found.output.split())) == (2, True), found.output
    assert not (tmp_path / "c").exists()


def test_options_that_cannot_apply_are_told(files: list[str], tmp_path: Path) -> None:
    found = runner.invoke(app, ["import", *files, "--out", str(tmp_path / "c"), "--force-unit", "kN", "--json"])
    told = [own["value"] for own in json.loads(found.stdout)["assumptions"] if own["what"] == "not used"]
    assert told == ["--force-unit"]


def test_check_of_what_import_should_read_says_so(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("Winkel,Messwert,\n1,2,\n", encoding="utf-8")
    found = runner.invoke(app, ["check", str(tmp_path / "a.csv")])
    assert found.exit_code == 2
    assert "let ldbb-bayes import read" in " ".join(found.output.split())
    found = runner.invoke(app, ["import", str(tmp_path), "--out", str(tmp_path / "c")])
    assert f"Name the files in it: {tmp_path}/*" in " ".join(found.output.split())
