"""Units beside words without blanks, degrees-minutes-seconds in Japanese, and the Polish kG."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.reading.sexagesimal import names_sexagesimal
from ldbb_bayes.reading.unit_lines import units_stated
from ldbb_bayes.reading.words import unit_named

CHINESE = "注:角度单位0.01度;位移单位0.1微米,杆伸长为正;力单位0.1N"


@pytest.mark.parametrize(
    ("text", "units"),
    [
        (CHINESE, {"angle_unit": "0.01 deg", "reading_unit": "0.1 um", "force_unit": "0.1 N"}),
        ("位移单位:0.1微米", {"reading_unit": "0.1 um"}),
        ("変位単位は0.1μm", {"reading_unit": "0.1 um"}),
        ("角度单位0.1微米", {}),
        ("温度单位0.1度", {}),
    ],
)
def test_a_quantity_and_its_unit_may_be_written_without_blanks(
    text: str, units: dict[str, str]
) -> None:
    assert units_stated(text) == units


def test_a_chinese_file_is_read_with_the_units_of_its_remark(tmp_path: Path) -> None:
    lines = [CHINESE, "试验号,角度,位移,力"]
    for number, force in enumerate((360, 1220), start=1):
        lines += [f"{number},{500 * k},{k},{force}" for k in range(72)]
    path = tmp_path / "log.csv"
    path.write_bytes("\n".join([*lines, ""]).encode("gb18030"))
    tests = lb.import_campaign(path).campaign.tests
    np.testing.assert_allclose([test.force_N for test in tests], [36.0, 122.0])
    for test in tests:
        np.testing.assert_allclose(test.angle_deg, 5.0 * np.arange(72))
        np.testing.assert_allclose(test.reading_um, 0.1 * np.arange(72))


@pytest.mark.parametrize("header", ["角度(度分秒)", "각도(도분초)", "角度 [度/分/秒]"])
def test_headers_may_name_degrees_minutes_and_seconds_in_east_asian_words(header: str) -> None:
    assert names_sexagesimal(header)


def test_a_header_in_degrees_names_no_minutes() -> None:
    assert not names_sexagesimal("角度(度)")


def test_a_capital_letter_makes_a_force_of_a_mass() -> None:
    assert (unit_named("kG"), unit_named("kg")) == ("kgf", "")


def test_a_force_in_the_polish_kilogram_force_is_read(tmp_path: Path) -> None:
    rows = [f"{5 * k}\t{0.1 * k:.1f}" for k in range(72)]
    path = tmp_path / "pomiar.txt"
    path.write_text("\n".join(["Siła: 3,6710 kG", "kąt [°]\todchyłka [µm]", *rows, ""]))
    (test,) = lb.import_campaign(path).campaign.tests
    assert test.force_N == pytest.approx(3.671 * 9.80665)
