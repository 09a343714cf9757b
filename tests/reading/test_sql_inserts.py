"""Dumps of a database whose rows stand in commands ``INSERT INTO``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.reading.layout import Layout

FORCES_N = {7: 238.0, 8: 36.0}
ROWS = [(k, 7 + k // 72, 5 * (k % 72), 100 * (k % 72)) for k in range(144)]
READING_UM = [0.1 * k for k in range(72)]
VALUES = [f"({k},{test},{angle},{reading})" for k, test, angle, reading in ROWS]


def imported(folder: Path, lines: list[str], **layout: object) -> lb.reading.Imported:
    path = folder / "dump.sql"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return lb.import_campaign(path, layout=Layout(**layout))


def assert_as_measured(tests: list[lb.CircularTest]) -> None:
    assert [test.force_N for test in tests] == list(FORCES_N.values())
    for test in tests:
        np.testing.assert_allclose(test.angle_deg, [5.0 * k for k in range(72)])
        np.testing.assert_allclose(test.reading_um, READING_UM)


def test_many_rows_in_one_line_are_read_with_comments_on_columns(tmp_path: Path) -> None:
    lines = [
        "-- MySQL dump 10.13",
        "CREATE TABLE `test` (`id` int NOT NULL, `load_N` decimal(6,2) DEFAULT '0', KEY (`id`));",
        "INSERT INTO `test` VALUES (7,238),(8,36.00);",
        "CREATE TABLE `sample` (",
        "  `id` bigint NOT NULL,",
        "  `test_id` int,",
        "  `angle` double DEFAULT NULL COMMENT 'degrees, counter-clockwise from +X; it''s sorted',",
        "  `dev` int COMMENT 'nm, bar shorter = negative',",
        "  CONSTRAINT `c` FOREIGN KEY (`test_id`) REFERENCES `test` (`id`)",
        ") ENGINE=InnoDB COMMENT='Nominal radius: 100 mm';",
        f"INSERT INTO `sample` VALUES {','.join(VALUES[:100])};",
        f"INSERT INTO `sample` VALUES {','.join(VALUES[100:])};",
        "-- Dump completed on 2026-03-14 11:20:33",
    ]
    result = imported(tmp_path, lines)
    assert_as_measured(result.campaign.tests)
    assert all(test.radius_mm == 100.0 for test in result.campaign.tests)
    assert "2026-03-14" not in str(result)


def test_a_command_for_each_row_names_its_columns(tmp_path: Path) -> None:
    lines = ["-- dev: radial deviation in nm, bar longer = negative"]
    for _, test, angle, reading in ROWS:
        row = f"({FORCES_N[test]},{angle},{-reading})"
        lines.append(f"INSERT INTO public.sample (force_n, angle_deg, dev) VALUES {row};")
    assert_as_measured(imported(tmp_path, lines, columns={"test": "force_n"}).campaign.tests)


def test_commands_may_comment_on_columns(tmp_path: Path) -> None:
    lines = [
        "CREATE TABLE public.sample (id integer, force_n real, angle_deg real, dev real);",
        "COMMENT ON COLUMN public.sample.dev IS 'nm, bar longer = positive';",
        *[f"INSERT INTO public.sample VALUES ({k}, 36, {a}, {d});" for k, _, a, d in ROWS[:72]],
    ]
    (test,) = imported(tmp_path, lines).campaign.tests
    np.testing.assert_allclose(test.reading_um, READING_UM)


def test_a_command_that_is_not_closed_does_not_delay_the_reading(tmp_path: Path) -> None:
    rows = ",".join(f"({k},'it''s')" for k in range(3000))
    lines = ["CREATE TABLE other (id int,", f"INSERT INTO other VALUES {rows};"]
    lines += [f"INSERT INTO s (force_n, angle_deg, c) VALUES (36,{5 * k},{k});" for k in range(72)]
    with pytest.raises(lb.InputError):
        imported(tmp_path, lines)


@pytest.mark.parametrize("orders", [("theta, dl", "theta, dl"), ("dl, theta", "theta, dl")])
def test_named_columns_keep_their_units_and_places(orders: tuple[str, str], tmp_path: Path) -> None:
    lines = ["CREATE TABLE t (theta double COMMENT 'deg', dl double COMMENT 'nm');"]
    for half, order in enumerate(orders):
        rows = [(5 * k, 100 * k) for k in range(36 * half, 36 * half + 36)]
        values = [f"({angle}, {reading})" for angle, reading in rows]
        if order == "dl, theta":
            values = [f"({reading}, {angle})" for angle, reading in rows]
        lines.append(f"INSERT INTO t ({order}) VALUES {', '.join(values)};")
    path = tmp_path / "100N.sql"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    (test,) = lb.import_campaign(path).campaign.tests
    np.testing.assert_allclose(test.angle_deg, [5.0 * k for k in range(72)])
    np.testing.assert_allclose(test.reading_um, READING_UM)
