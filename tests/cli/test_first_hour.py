"""demo, check and simulate: what a new user runs first."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from campaigns import plan, simulated

import ldbb_bayes as lb
from ldbb_bayes.cli.main import app
from ldbb_bayes.report.figures import FIGURES


def run_inside(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as left:
        app(arguments)
    assert left.value.code in (0, None), capsys.readouterr().err
    return capsys.readouterr().out


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    place = tmp_path_factory.mktemp("demo")
    command = [sys.executable, "-W", "error", "-m", "ldbb_bayes", "demo"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=place, timeout=200, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return place, done.stdout


def test_demo_says_what_it_found(demo: tuple[Path, str]) -> None:
    _, text = demo
    words = " ".join(text.split())
    for expected in (
        "Constant compliance",
        "Linear compliance",
        "± U (k = 2)",
        "N/µm",
        "aliased with ball form",
        "identified",
    ):
        assert expected in words
    assert "With constant compliance C_XXX = 0.05" in words
    assert "E_XX1 =" not in words
    assert "95 % interval" in words
    assert "Files: ldbb_demo/campaign, ldbb_demo/constant, ldbb_demo/linear, ldbb_demo/figures" in words


def test_demo_leaves_its_files(demo: tuple[Path, str]) -> None:
    place, _ = demo
    out = place / "ldbb_demo"
    assert [p.name for p in place.iterdir()] == ["ldbb_demo"]
    figures = {p.name for p in (out / "figures").iterdir()}
    assert figures == {f"{name}.{kind}" for name in FIGURES for kind in ("png", "svg")}
    assert "<svg" in (out / "linear" / "report.html").read_text(encoding="utf-8")
    assert all((out / "figures" / name).stat().st_size > 5000 for name in figures)
    linear = json.loads((out / "linear" / "summary.json").read_text())
    assert linear["sampler"]["converged"]
    assert linear["campaign"]["sha256"] == lb.read_campaign(out / "campaign").sha256
    again = subprocess.run([sys.executable, "-m", "ldbb_bayes", "demo"], capture_output=True, text=True, cwd=place, check=False)
    assert again.returncode == 2
    assert "--force" in again.stderr


def test_check_previews(recovered: lb.Campaign, root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = run_inside(["check", str(root / "data" / "recovered_experiment")], capsys)
    assert "f742" in text
    assert "Mount (Eq. 32) 2.33 µm/bar, already compensated." in text
    assert "friction in the bar cannot be told from C_XYX" in text
    seen = json.loads(run_inside(["check", str(root / "data" / "recovered_experiment"), "--json"], capsys))
    test = seen["tests"][3]
    assert (test["readings"], test["arc_deg"], test["travel"], test["force_N"]) == (720, 360.0, "CW", 490.0)
    assert test["largest_gap_deg"] == pytest.approx(0.5)
    assert test["noise_um"] == pytest.approx(0.12, abs=0.01)
    reading = recovered.tests[3].reading_um
    assert test["start_end_um"] == pytest.approx(reading[-1] - reading[0])
    assert seen["sha256"] == recovered.sha256


def odd(**changes: object) -> lb.Campaign:
    angle = np.arange(0.0, 360.0, 1.0)
    fields = {"force_N": 300.0, "angle_deg": angle, "reading_um": 0.1 * np.sin(37 * np.deg2rad(angle)), "name": "a"} | changes
    return lb.Campaign((lb.CircularTest(**fields),))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "remark"),
    [
        ({"direction": "CW"}, "stated CW, but the angles run CCW"),
        ({"angle_deg": np.linspace(0, 220, 360)}, "arc of 220° only"),
        ({"angle_deg": np.linspace(0, 300, 360)}, "arc of 300° only"),
        ({"reading_um": np.linspace(0, 30, 360)}, "start and end differ by +30.0 µm"),
        ({"reading_um": np.zeros(360)}, "all readings equal"),
        ({"pressure_bar": 6.0}, "force 300 N, but the force law gives 742 N at 6 bar"),
    ],
)
def test_preview_notices(changes: dict, remark: str) -> None:
    seen = lb.preview(odd(**changes))
    assert any(remark in found for found in seen.tests[0].remarks)
    assert any("One force level" in found for found in seen.remarks)


def test_preview_notices_spikes_copies_and_units() -> None:
    campaign = simulated(plan((720,) * 4))
    reading = campaign.tests[1].reading_um.copy()
    reading[100] += 50.0
    tests = (campaign.tests[0], campaign.tests[1].with_reading_um(reading), campaign.tests[2], campaign.tests[3])
    copied = lb.Campaign((*tests[:3], tests[3].with_reading_um(tests[2].reading_um)))
    seen = lb.preview(copied)
    (remark,) = seen.tests[1].remarks
    found = re.fullmatch(r"reading 101 at 50° stands \+(\d+\.\d) µm off its neighbours", remark)
    assert found
    assert float(found[1]) == pytest.approx(50.0, abs=3.0)
    assert "Tests f520 and f742 hold the same readings: a file read twice?" in seen.remarks
    kilo = lb.preview(plan(forces_N=(0.036, 0.3, 0.52, 0.742)))
    assert any("check the unit of force_N" in remark for remark in kilo.remarks)


def test_preview_is_silent_on_a_good_campaign() -> None:
    seen = lb.preview(simulated(plan((720,) * 4)))
    assert all(test.remarks == () for test in seen.tests)


def test_simulate_from_truths(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    truths = tmp_path / "truths.toml"
    truths.write_text(
        'schema = 1\nforces_N = [50.0, 300.0, 700.0]\nreadings = 90\nmachine_id = "VMC 07"\ndate = 2026-11-20\n'
        "[parameters]\nC_XXX = 6e-5\nC_YYY = 4e-5\n[hyper_um]\nsigma = 0.2\ndelta = 0.0\nkappa = 0.0\ntau = 0.0\n"
    )
    options = ["--without", "bar-length,mount,force-error", "--seed", "3"]
    run_inside(["simulate", str(truths), "--out", str(tmp_path / "c"), *options], capsys)
    campaign = lb.read_campaign(tmp_path / "c")
    truth = json.loads((tmp_path / "c" / "truth.json").read_text())
    assert truth["sha256"] == campaign.sha256
    assert (campaign.machine_id, campaign.date) == ("VMC 07", "2026-11-20")
    assert truth["parameters"]["C_XXX"] == 6e-5
    angle = campaign.tests[2].angles_rad()
    expected = 700.0 * (6e-5 * np.cos(angle) ** 2 + 4e-5 * np.sin(angle) ** 2)
    assert np.std(campaign.tests[2].readings_mm() - expected) == pytest.approx(0.2e-3, rel=0.3)
    run_inside(["simulate", str(truths), "--out", str(tmp_path / "d"), *options], capsys)
    assert lb.read_campaign(tmp_path / "d").sha256 == campaign.sha256


def test_simulate_from_a_plan(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lb.write_campaign(plan(work_deg=30.0), tmp_path / "plan")
    truth = tmp_path / "truth.toml"
    truth.write_text("schema = 1\n[parameters]\nC_XXX = 6e-5\n")
    out = run_inside(["simulate", str(tmp_path / "plan"), "--truth", str(truth), "--out", str(tmp_path / "c"), "--json"], capsys)
    assert json.loads(out)["parameters"]["C_XXX"] == 6e-5
    campaign = lb.read_campaign(tmp_path / "c")
    assert [t.work_ball_deg for t in campaign.tests] == [0.0, 30.0, 60.0, 90.0]
    run_inside(["simulate", str(tmp_path / "plan"), "--out", str(tmp_path / "prior")], capsys)
    assert not lb.read_campaign(tmp_path / "prior").is_plan


def test_a_table_made_elsewhere(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Semicolons, decimal commas, a byte-order mark, radians, millimetres, pressure only: the same campaign."""
    campaign = simulated(plan((60, 60, 60, 60)))
    lines = ["test;pressure_bar;angle_rad;reading_mm"]
    for test in campaign.tests:
        for angle, reading in zip(test.angles_rad(), test.readings_mm(), strict=True):
            lines.append(";".join([test.name, *(f"{x:.12g}".replace(".", ",") for x in (test.pressure_bar, angle, reading))]))
    path = tmp_path / "all.csv"
    path.write_bytes(b"\xef\xbb\xbf" + "\r\n".join(lines).encode())
    options = [
        "--degree",
        "0",
        "--sampler",
        "quadrature",
        "--json",
        "--radius-mm",
        "150",
        "--topology",
        "wCAFYXZSt",
        "--resolution-um",
        "0.24",
    ]
    found = json.loads(run_inside(["fit", str(path), *options], capsys))
    lb.write_campaign(campaign, tmp_path / "c")
    direct = json.loads(run_inside(["fit", str(tmp_path / "c"), "--degree", "0", "--sampler", "quadrature", "--json"], capsys))
    ours, theirs = found["parameters"]["C_XXX"], direct["parameters"]["C_XXX"]
    assert ours["mean"] == pytest.approx(theirs["mean"], abs=0.15 * theirs["sd"])
    assert found["campaign"]["forces_N"] == pytest.approx(direct["campaign"]["forces_N"])


def test_options_of_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "all.csv"
    rows = [f"a;{p};{angle};1" for p in (2,) for angle in range(0, 360, 10)]
    path.write_text("test;pressure_bar;angle_deg;reading_um\n" + "\n".join(rows))
    options = ["--raw", "--mount-um-per-bar", "1.5", "--force-slope", "100", "--force-offset", "0", "--plane", "YZ", "--json"]
    seen = json.loads(run_inside(["check", str(path), *options], capsys))
    assert seen["tests"][0]["force_N"] == 200.0
    assert seen["plane"] == "YZ"
    assert any("1.5 µm/bar, not compensated" in text for text in seen["assumptions"])


def test_help_is_quick() -> None:
    """Nothing heavy is imported for --help."""
    code = (
        "import sys; sys.argv = ['ldbb-bayes', '--help']\n"
        "from ldbb_bayes.cli.main import main\n"
        "try: main()\nexcept SystemExit: pass\n"
        "print([m for m in ('numpy', 'scipy', 'pandas', 'xarray', 'emcee', 'matplotlib') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip().endswith("[]")
