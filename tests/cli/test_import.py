"""``import``: every assumption it states has an option that exists; what is there is kept; what is
refused names the option."""

from __future__ import annotations

import json
import re
from pathlib import Path

import awkward
import pytest
from campaigns import Invoke, cases, written

import ldbb_bayes as lb


def test_it_says_what_it_assumed_and_what_to_do_next(
    files: list[Path], tmp_path: Path, invoke: Invoke
) -> None:
    code, stdout, _ = invoke("import", *files, "--out", tmp_path / "c")
    assert code == 0
    for option in ("--pressures-bar", "--topology", "--resolution-um"):
        assert re.search(rf" {option}$", stdout, re.MULTILINE), "an option must not be cut"
    stdout = " ".join(stdout.split())
    for word in (
        "separator: ';'",
        "decimal mark: ,",
        "pressure_bar: 3.5",
        "topology: wCAFYXZSt",
        "3 places",
        "ldbb-bayes check",
    ):
        assert word in stdout
    tables = {f"{file.stem}.csv" for file in files}
    assert {path.name for path in (tmp_path / "c").iterdir()} == {
        "campaign.toml",
        "import.toml",
        *tables,
    }
    assert invoke("check", tmp_path / "c")[0] == 0
    first = lb.read_campaign(tmp_path / "c").sha256
    code, _, stderr = invoke("import", *files, "--out", tmp_path / "c", "--sign", "-1")
    assert code == 2
    assert "--force" in stderr
    assert lb.read_campaign(tmp_path / "c").sha256 == first
    assert invoke("import", *files, "--out", tmp_path / "c", "--sign", "-1", "--force")[0] == 0
    assert lb.read_campaign(tmp_path / "c").sha256 != first


def test_every_option_that_is_named_exists(tmp_path: Path, invoke: Invoke) -> None:
    """Of awkward files, as JSON."""
    help_text = invoke("import", "--help")[1]
    for name in ("14_words", "20_no_header", "24_log", "19_distances", "22_tidy_psi", "09_windows"):
        case = awkward.CASES[name]
        folder = tmp_path / name
        folder.mkdir()
        arguments = (*written(folder, case.files), "--out", folder / "c", *case.options)
        record = json.loads(invoke("import", *arguments, "--json")[1])
        assert record["schema"] == 1
        assert record["campaign"]["tests"] == 3
        assert record["layout"]["columns"]
        for assumed in record["assumptions"]:
            for option in re.findall(r"--[\w-]+", assumed["option"]):
                assert option in help_text, (name, assumed)


def test_loads_and_names(files: list[Path], tmp_path: Path, invoke: Invoke) -> None:
    options = ("--forces-N", "100,200,300", "--name", "machine 7", "--raw", "--json")
    assert invoke("import", *files, "--out", tmp_path / "c", *options)[0] == 0
    campaign = lb.read_campaign(tmp_path / "c")
    assert campaign.forces_N.tolist() == [100.0, 200.0, 300.0]
    assert (campaign.name, campaign.mount.compensated) == ("machine 7", False)


def test_order_and_drift_are_written(files: list[Path], tmp_path: Path, invoke: Invoke) -> None:
    options = ("--forces-N", "100,200,300", "--order", "random", "--no-drift")
    assert invoke("import", *files, "--out", tmp_path / "c", *options)[0] == 0
    campaign = lb.read_campaign(tmp_path / "c")
    assert (campaign.order, campaign.drift) == ("random", False)


def test_the_order_listed_is_told_with_its_option(
    files: list[Path], tmp_path: Path, invoke: Invoke
) -> None:
    options = ("--forces-N", "100,200,300")
    stdout = invoke("import", *files, "--out", tmp_path / "c", *options)[1]
    assert "order: as listed (nothing says when the tests were run): --order" in stdout


def test_a_radius_in_metres_is_told(files: list[Path], tmp_path: Path, invoke: Invoke) -> None:
    options = ("--forces-N", "100,200,300", "--radius-mm", "0.15")
    stdout = invoke("import", *files, "--out", tmp_path / "c", *options)[1]
    assert "Note: a radius is 0.15 mm: check the unit." in stdout


def test_the_same_readings_twice_are_told(tmp_path: Path, invoke: Invoke) -> None:
    rows = "".join(f"{5 * k},{10 + k % 7}\n" for k in range(72))
    for name in ("a", "b"):
        (tmp_path / f"{name}.csv").write_text(f"angle_deg,reading_um\n{rows}", encoding="utf-8")
    files = (tmp_path / "a.csv", tmp_path / "b.csv")
    stdout = invoke("import", *files, "--out", tmp_path / "c", "--forces-N", "100,200")[1]
    assert "Note: Tests a and b hold the same readings: a file read twice?" in stdout


def test_readings_that_look_like_another_unit_are_told(tmp_path: Path, invoke: Invoke) -> None:
    rows = "".join(f"{5 * k},{1000 * (k % 7)}\n" for k in range(72))
    (tmp_path / "a.csv").write_text(f"angle_deg,reading_um\n{rows}", encoding="utf-8")
    options = ("--out", tmp_path / "c", "--forces-N", "100")
    stdout = invoke("import", tmp_path / "a.csv", *options)[1]
    assert "Note: Look at a: peak to peak is 6000 µm: check the unit." in stdout
    # What only shows when the readings are examined is left to check.
    assert stdout.count("Note: ") == 1


@pytest.mark.parametrize(("options", "message"), cases(__file__, "import.toml")["wrong"])
def test_wrong_options(
    options: str, message: str, files: list[Path], tmp_path: Path, invoke: Invoke
) -> None:
    code, _, stderr = invoke("import", *files, "--out", tmp_path / "c", *options.split(" "))
    assert (code, message in " ".join(stderr.split())) == (2, True), stderr
    assert not (tmp_path / "c").exists()


def test_brackets_are_printed_as_they_stand(tmp_path: Path, invoke: Invoke) -> None:
    """Not taken for marks of the printer, some of which end in a traceback."""
    path = tmp_path / "ma[x] 36N.csv"
    rows = [f"{5 * k},{k % 7},{k}" for k in range(72)]
    path.write_text("\n".join(["Angle [deg],Reading [um],Speed [/min]", *rows]), encoding="utf-8")
    code, stdout, _ = invoke("import", path, "--out", tmp_path / "c")
    assert code == 0
    for words in ("[deg]'", "[um]'", "[/min]", "[[test]]", "ma[x]"):
        assert words in stdout


def test_check_of_what_import_should_read_says_so(tmp_path: Path, invoke: Invoke) -> None:
    (tmp_path / "a.csv").write_text("Winkel,Messwert,\n1,2,\n", encoding="utf-8")
    code, _, stderr = invoke("check", tmp_path / "a.csv")
    assert (code, "let ldbb-bayes import read" in " ".join(stderr.split())) == (2, True)
    stderr = invoke("import", tmp_path, "--out", tmp_path / "c")[2]
    assert f"Name the files in it: {tmp_path}/*" in " ".join(stderr.split())
