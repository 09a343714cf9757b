"""Renishaw's ball-bar files: header and features as a record, beside readings of known circularity;
refused with a reason."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from campaigns import plan, refuses, tidy
from typer.testing import CliRunner

import ldbb_bayes as lb
from ldbb_bayes.cli import app

TEXT = Path(__file__).with_name("ballbar.b5r").read_text(encoding="utf-8")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    (tmp_path / "x.b5r").write_text(TEXT, encoding="utf-8")
    return tmp_path / "x.b5r"


@pytest.fixture(scope="module")
def campaign() -> lb.Campaign:
    """ρ = 5 µm sin 2θ about a centre 3 µm off, both ways: G and G_b are 10 µm, the squareness 10 µm
    in 150 mm."""
    angle = np.arange(0.0, 360.0, 5.0)
    reading = 5.0 * np.sin(np.deg2rad(2.0 * angle)) + 3.0 * np.cos(np.deg2rad(angle))
    return lb.Campaign(
        tuple(
            lb.CircularTest(300.0, angle, reading, name=way, direction=way) for way in ("CW", "CCW")
        )
    )  # type: ignore[arg-type]


def test_header_and_features(path: Path) -> None:
    record = lb.read_b5r(path)
    assert (record.test, record.machine, record.operator, record.ball_bar) == (
        "150mm XY 2000",
        "VMC 07",
        "A & B",
        "Renishaw QC20-W",
    )
    assert (record.ball_bar, record.serial_number, record.started, record.completed) == (
        "Renishaw QC20-W",
        "1A2B",
        "2026-04-01T08:00:05",
        "",
    )
    assert (record.plane, record.radius_mm, record.feed_mm_per_min) == ("XY", 150.0, None)
    found = [(own.name, own.value, own.unit, own.run, own.analysis) for own in record.features]
    assert found[0] == ("AF_CIRCULARITY", pytest.approx(9.0), "µm", "CW", "")
    assert found[1] == ("AF_SQUARENESS", -12.5, "µm/m", "", "RENISHAW_DIAGNOSTICS")
    assert [own[:3] for own in found[2:]] == [
        ("AF_CIRCULARITY", 9.5, "µm"),
        ("AF_NEW", 1.0, "UT_NEW"),
    ]
    assert "AF_NEW" in str(record)
    assert lb.BallbarRecord.from_dict(record.as_dict()) == record


def test_beside_the_readings(path: Path, campaign: lb.Campaign) -> None:
    table = lb.compare_record(lb.read_b5r(path), campaign)
    assert list(table.index) == ["CW"] * 3 + ["CCW"] * 2 + ["CW + CCW"]
    assert list(table["feature"]) == [
        "AF_CIRCULARITY CW",
        *["AF_SQUARENESS", "AF_CIRCULARITY"] * 2,
        "AF_CIRCULARITY",
    ]
    round_ones = table[table["quantity"] != "squareness"]
    assert round_ones["measured"].to_numpy() == pytest.approx(10.0, abs=0.05)
    assert list(round_ones["quantity"]) == ["G", "G", "G", "G_b"]
    assert round_ones["difference"].to_numpy() == pytest.approx([1.0, 0.5, 0.5, 0.5], abs=0.05)
    square = table[table["quantity"] == "squareness"]
    assert square["measured"].abs().to_numpy() == pytest.approx(10.0 / 0.15, rel=1e-6)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("angle;reading", "must be XML"),
        ("<a/>", "got <A> without"),
        ("<a>" * 200, "nested at most"),
        (
            TEXT.replace("<TEST_DOCUMENT>", '<!DOCTYPE t [<!ENTITY e "x">]><TEST_DOCUMENT>'),
            "no document type",
        ),
    ],
)
def test_what_is_none(path: Path, text: str, why: str) -> None:
    path.write_text(text, encoding="utf-8")
    refuses(why, lb.read_b5r, path)


def test_refused_with_the_reason(path: Path, campaign: lb.Campaign) -> None:
    refuses(r"x.b5r alone.*described nowhere.*Export the trace as text", lb.import_campaign, path)
    path.write_text(TEXT.replace('"YX"', '"XZ"'), encoding="utf-8")
    refuses("of plane XY, got ZX", lb.compare_record, lb.read_b5r(path), campaign)
    refuses("got a plan", lb.compare_record, lb.read_b5r(path), plan())


def test_imported_with_the_tables(path: Path, campaign: lb.Campaign, tmp_path: Path) -> None:
    files = ["import", str(tidy(campaign, tmp_path / "t.csv")), str(path), "--out"]
    shown = CliRunner().invoke(app, [*files, str(tmp_path / "c")])
    assert shown.exit_code == 0
    assert "x.b5r, plane XY, R = 150 mm, beside the readings" in shown.stdout
    record = json.loads(CliRunner().invoke(app, [*files, str(tmp_path / "d"), "--json"]).stdout)[
        "records"
    ][0]
    assert (record["file"], record["features"][0]["unit"]) == ("x.b5r", "µm")
