"""Campaign folders: round trip, plans, and one clear message for everything wrong."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from campaigns import cases, plan, refuses, simulated
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import ldbb_bayes as lb
from ldbb_bayes.campaign.campaign import LABELS
from ldbb_bayes.campaign.folder import labels_of
from ldbb_bayes.campaign.remarks import RemarkKind
from ldbb_bayes.errors import InputError
from ldbb_bayes.report.wording import remark_words

CASES = cases(__file__, "folder.toml")

TOML = Path(__file__).with_name("two_circles.toml").read_text(encoding="utf-8")
ROWS = "\n".join(f"{angle},{angle / 7}" for angle in range(0, 360, 20))
CSV = f"angle_deg,reading_um\n{ROWS}\n"


def write(folder: Path, toml: str = TOML, **files: str) -> Path:
    (folder / "campaign.toml").write_text(toml, encoding="utf-8")
    for name, text in ({"a": CSV, "b": CSV} | files).items():
        (folder / f"{name}.csv").write_text(text, encoding="utf-8")
    return folder


def test_a_written_campaign_is_read_back(tmp_path: Path) -> None:
    campaign = simulated(plan(work_deg=30.0, compensated=False))
    folder = lb.write_campaign(campaign, tmp_path / "c")
    back = lb.read_campaign(folder)
    assert back.sha256 == campaign.sha256
    assert back.mount == campaign.mount
    assert lb.read_campaign(folder / "campaign.toml").sha256 == campaign.sha256
    lb.write_campaign(campaign.without("f036"), folder, force=True)
    assert len(lb.read_campaign(folder).tests) == 3
    assert len([*folder.glob("*.csv")]) == 3


def test_order_and_drift_are_written_and_read(tmp_path: Path) -> None:
    stated = replace(simulated(plan()), order="random", drift=False)
    folder = lb.write_campaign(stated, tmp_path / "stated")
    again = lb.read_campaign(folder)
    assert (again.order, again.drift) == ("random", False)
    assert again.sha256 == stated.sha256

    usual = lb.write_campaign(simulated(plan()), tmp_path / "usual")
    text = (usual / "campaign.toml").read_text(encoding="utf-8")
    assert "order" not in text
    assert "drift" not in text


def test_foreseen_tests_are_written_and_read(tmp_path: Path) -> None:
    measured = simulated(plan())
    uneven_deg = np.concatenate([np.arange(0.0, 180.0, 10.0), np.arange(180.0, 360.0, 5.0)])
    foreseen = (
        lb.CircularTest(500.0, np.arange(36) * 10.0, plane="YZ", direction="CW", setup=2),
        lb.CircularTest(300.0, np.linspace(10.0, 230.0, 45), radius_mm=100.0),
        lb.CircularTest(pressure_bar=4.0, angle_deg=uneven_deg),
    )
    campaign = replace(measured, foreseen=foreseen)
    assert campaign.sha256 != measured.sha256
    back = lb.read_campaign(lb.write_campaign(campaign, tmp_path / "c"))
    assert back.sha256 == campaign.sha256
    for read, written in zip(back.foreseen[:2], foreseen[:2], strict=True):
        np.testing.assert_allclose(read.angle_deg, written.angle_deg)
    np.testing.assert_allclose(back.foreseen[2].angle_deg, np.arange(54) * 360.0 / 54)


def test_foreseen_tests_have_no_readings(tmp_path: Path) -> None:
    write(tmp_path, TOML + '\n[[foreseen]]\nfile = "a.csv"\nforce_N = 100.0\n')
    refuses("foreseen.*file", lb.read_campaign, tmp_path)


def test_mistakes_in_foreseen_tests_are_refused_with_their_number(tmp_path: Path) -> None:
    write(tmp_path, TOML + "\n[[foreseen]]\nforce_N = 100.0\narc_deg = 90.0\n")
    refuses("foreseen test 1", lb.read_campaign, tmp_path)


def test_certificates_are_read_and_written(root: Path, tmp_path: Path) -> None:
    """Those of the docs."""
    blocks = re.findall(
        r"```toml\n(.*?)```", (root / "docs/reference/files.md").read_text("utf-8"), re.S
    )
    (block,) = [text for text in blocks if "[balls.work]" in text]
    stated = lb.read_campaign(write(tmp_path, TOML.replace("[[test]]", f"{block}[[test]]", 1)))
    balls = (
        lb.Ball(grade="G20"),
        lb.Ball(harmonics_um=((2, 0.21, 35.0), (3, 0.1, -10.0)), U_um=0.05),
    )
    assert stated.instrument == lb.Instrument(*balls, -0.4, 1.0, 2.0, 1.0, 0.6, 1.5, 0.05)
    assert stated.mount == lb.campaign.MountCompensation(130.0 / 50.0)
    back = lb.read_campaign(
        lb.write_campaign(stated, tmp_path / "c"), certificates={"tool": balls[0]}
    )
    assert back.instrument == replace(stated.instrument, tool=balls[0])
    assert (back.mount, back.force_law, back.sha256) == (
        stated.mount,
        stated.force_law,
        stated.sha256,
    )


@given(reading=hnp.arrays(float, 12, elements=st.floats(-1e5, 1e5)), force=st.floats(1.0, 2000.0))
def test_numbers_read_back_to_the_same_doubles(
    tmp_path_factory, reading: np.ndarray, force: float
) -> None:
    test = lb.CircularTest(force_N=force, angle_deg=np.arange(12) * 30.0 + 1e-9, reading_um=reading)
    campaign = lb.Campaign((test,))
    folder = lb.write_campaign(campaign, tmp_path_factory.mktemp("c") / "c")
    assert lb.read_campaign(folder).sha256 == campaign.sha256


def test_a_plan_is_a_campaign_when_its_circles_have_files(tmp_path: Path) -> None:
    """As the operator's sheet says: save the readings, enter the file. What the plan says of the
    circle stays and means nothing."""
    campaign = simulated(plan())
    planned = lb.write_campaign(campaign.plan(), tmp_path / "plan")
    measured = lb.write_campaign(campaign, tmp_path / "measured")
    text = (planned / "campaign.toml").read_text(encoding="utf-8")
    for test in campaign.tests:
        name = f"{test.name}.csv"
        (planned / name).write_bytes((measured / name).read_bytes())
        text = text.replace(f'name = "{test.name}"', f'name = "{test.name}"\nfile = "{name}"')
    assert "readings = " in text
    (planned / "campaign.toml").write_text(text, encoding="utf-8")
    run = lb.read_campaign(planned)
    for test, expected in zip(run.tests, campaign.tests, strict=True):
        np.testing.assert_allclose(test.readings_mm(), expected.readings_mm())


def test_circles_of_a_plan_that_have_no_file_yet_are_foreseen(tmp_path: Path) -> None:
    """Their order and their names do not count: a circle may be run out of turn."""
    campaign = simulated(plan())
    folder = lb.write_campaign(campaign, tmp_path / "half")
    toml = folder / "campaign.toml"
    text = toml.read_text(encoding="utf-8")
    for test in (campaign.tests[0], campaign.tests[2]):
        text = text.replace(f'file = "{test.name}.csv"\n', "")
    toml.write_text(text, encoding="utf-8")
    half = lb.read_campaign(folder)
    assert not half.is_plan
    assert [test.force_N for test in half.tests] == [300.0, 742.0]
    assert [test.force_N for test in half.foreseen] == [36.0, 520.0]
    remarks = {remark.kind: remark for remark in lb.check_campaign(half).remarks}
    words = remark_words(remarks[RemarkKind.NOT_RUN])
    assert words == (
        "2 more tests have no readings yet and are left out, at 36, 520 N. The 2 tests with"
        " readings are used."
    )
    assert RemarkKind.NOT_RUN not in {r.kind for r in lb.check_campaign(campaign).remarks}


def test_a_written_plan_is_read_back(tmp_path: Path) -> None:
    """Arcs, and circles in both directions."""
    angle = 360.0 - np.arange(720) / 2.0
    arc = 220.0 / 39.0 * np.arange(40) - 20.0
    planned = lb.Campaign(tuple(lb.CircularTest(100.0, angles) for angles in (angle, -angle, arc)))
    back = lb.read_campaign(lb.write_campaign(planned, tmp_path / "p"))
    assert back.is_plan
    for written_test, read_test in zip(planned.tests, back.tests, strict=True):
        np.testing.assert_allclose(read_test.angle_deg, written_test.angle_deg, atol=1e-9)
    bare = TOML.replace('file = "a.csv"\n', "").replace('file = "b.csv"\n', "")
    (tmp_path / "campaign.toml").write_text(bare)
    assert [len(t.angle_deg) for t in lb.read_campaign(tmp_path).tests] == [720, 720]
    twice = lb.Campaign((lb.CircularTest(100.0, np.arange(720.0)),))
    refuses("must be evenly spaced within one turn", lb.write_campaign, twice, tmp_path / "q")


def test_radians_millimetres_bom_crlf_semicolons_and_decimal_commas(tmp_path: Path) -> None:
    rows = "\r\n".join(f"{float(np.deg2rad(a))!r},{a / 7e3!r}" for a in range(0, 360, 20))
    (write(tmp_path) / "b.csv").write_bytes(
        b"\xef\xbb\xbfangle_rad,reading_mm\r\n" + rows.encode() + b"\r\n\r\n"
    )
    first, second = lb.read_campaign(tmp_path).tests
    np.testing.assert_allclose(first.reading_um, second.reading_um)
    np.testing.assert_allclose(first.angle_deg, second.angle_deg)
    write(tmp_path, b=CSV.replace(",", ";").replace(".", ","))
    first, second = lb.read_campaign(tmp_path).tests
    np.testing.assert_array_equal(first.reading_um, second.reading_um)


@pytest.mark.parametrize(("old", "new", "message"), CASES["toml_refused"])
def test_toml_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in TOML
    refuses(message, lb.read_campaign, write(tmp_path, TOML.replace(old, new, 1)))


def rows(header: str, form: str, angles: Iterable[int]) -> str:
    return (
        header
        + "\n"
        + "\n".join(
            form.format(a=angle, tenth=angle / 10, r=f"{angle / 7:.3f}") for angle in angles
        )
    )


WHOLE = [
    (
        "",
        rows("angle_deg,reading_um", "{a},0,{a},5", range(0, 360, 20)),
        "with decimal commas separate the cells by semicolons",
    ),
    (
        "",
        rows("angle_deg;reading_um", "{a};{r}", range(0, 360, 20)).replace("20;2.857", "20;1,000"),
        r"b\.csv, line 3: reading_um must be a finite number, got '1,000'",
    ),
    ("", rows("angle_deg,reading_um", "{tenth},1", range(20)), "angle_deg must span more than 7°"),
    (
        "",
        rows("angle_rad,reading_um", "{a},1", range(0, 360, 5)),
        "angle_rad must span at most 4 turns",
    ),
]


@pytest.mark.parametrize(("old", "new", "message"), [*CASES["csv_refused"], *WHOLE])
def test_a_csv_that_cannot_be_is_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    refuses(message, lb.read_campaign, write(tmp_path, b=CSV.replace(old, new) if old else new))


def test_binary_and_missing_files_are_refused(tmp_path: Path) -> None:
    write(tmp_path)
    for content, problem in (
        (bytes(range(256)), "text must be utf-8, got other bytes"),
        (b"angle_deg,\0\n1,2\n", "got binary data"),
    ):
        (tmp_path / "b.csv").write_bytes(content)
        refuses(problem, lb.read_campaign, tmp_path)
    for path, options, message in (
        ("nowhere", {}, "does not exist"),
        ("a.csv", {"plan": "XY"}, r"option must be one of .*Did you mean 'plane'"),
        ("a.csv", {}, "must hold 'test'"),
    ):
        refuses(message, lb.read_campaign, tmp_path / path, **options)


def test_links_out_of_the_folder_are_refused(tmp_path: Path) -> None:
    (tmp_path / "c").mkdir()
    write(tmp_path / "c")
    (tmp_path / "c" / "a.csv").rename(tmp_path / "outside.csv")
    (tmp_path / "c" / "a.csv").symlink_to(tmp_path / "outside.csv")
    refuses("must lie inside", lb.read_campaign, tmp_path / "c")


def test_a_campaign_names_its_machine_and_date(tmp_path: Path) -> None:
    """Kept in the folder and in a fit, not part of the digest: they change no number."""
    plain = lb.read_campaign(lb.embedded_campaign())
    labels = {key: f"{key} ÄÖ/7" for key in LABELS} | {
        "date": "2026-11-20T14:30",
        "ball_bar_calibrated": "2026-01-05",
    }
    named = replace(plain, **labels)
    back = lb.read_campaign(lb.write_campaign(named, tmp_path / "c"))
    assert ({key: getattr(back, key) for key in LABELS}, back.sha256) == (labels, plain.sha256)
    by_number = lb.write_campaign(replace(plain, serial_number="S 12"), tmp_path / "s")
    assert (lb.read_campaign(by_number).machine_id, labels_of(by_number)["machine_id"]) == (
        "S 12",
        "S 12",
    )
    (tmp_path / "bare").mkdir()
    write(tmp_path / "bare", TOML.replace("[[test]]", 'serial_number = "S 12"\n[[test]]', 1))
    assert labels_of(tmp_path / "bare") == {"machine_id": "S 12"}
    empty_id = 'machine_id = ""\nserial_number = "S 12"\n[[test]]'
    write(tmp_path / "bare", TOML.replace("[[test]]", empty_id, 1))
    assert labels_of(tmp_path / "bare") == {"machine_id": "S 12"}
    toml = tmp_path / "c" / "campaign.toml"
    toml.write_text(toml.read_text().replace('"2026-11-20T14:30"', "2026-11-21"))
    assert lb.read_campaign(toml).date == "2026-11-21"
    refuses(
        r"date must be valid, got '20\.11\.26': it should be a date as ISO 8601",
        replace,
        plain,
        date="20.11.26",
    )
    refuses("machine_id must be valid", replace, plain, machine_id=" ")


# ---- tidy tables


def test_tidy_is_the_same_campaign(tmp_path: Path) -> None:
    """An empty column is none; rows of a test must agree."""
    campaign = simulated(plan(work_deg=20.0))
    path = tmp_path / "all.csv"
    lines = ["test,force_N,pressure_bar,work_ball_deg,angle_deg,reading_um,direction"]
    for test in campaign.tests:
        for angle, reading in zip(test.angle_deg, test.reading_um, strict=True):
            settings = f"{test.force_N},{test.pressure_bar},{test.work_ball_deg}"
            lines.append(f"{test.name},{settings},{angle},{reading},")
    path.write_text("\n".join(lines))
    assert lb.read_campaign(path).sha256 == campaign.sha256
    assert lb.read_campaign(path, radius_mm=100.0).tests[0].radius_mm == 100.0
    path.write_text(path.read_text().replace("f036,36.0", "f036,37.0", 1))
    refuses(
        r"all\.csv: force_N must be the same in all rows of a test, got 36.0 to 37.0 in 'f036'",
        lb.read_campaign,
        path,
    )


def test_tables_of_no_sensible_shape_are_refused_at_once(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    for content, message in (
        (",".join(["a"] * 2000) + "\n1\n", "at most 1000 columns, got 2000"),
        (
            "angle_deg,reading_um\n1," + "1" * 99_000 + "x\n",
            "reading_um must be a finite number, got '1111",
        ),
    ):
        path.write_text(content)
        with pytest.raises(InputError, match=message) as refused:
            lb.read_campaign(path)
        assert len(str(refused.value)) < 400
