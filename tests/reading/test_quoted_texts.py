"""Tables that a mail quotes, and tables in the dump of a database."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import ldbb_bayes as lb
from ldbb_bayes.reading.layout import Layout
from ldbb_bayes.reading.quoted_texts import with_names_of_dump, without_quote_marks

ROWS = [(5.0 * k, 0.1 * k) for k in range(72)]


def imported(path: Path, lines: list[str], **layout: object) -> lb.Campaign:
    """Write lines to a file, and return the campaign that is read from it."""
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return lb.import_campaign(path, layout=Layout(**layout)).campaign


def test_quote_marks_of_a_mail_are_left_out(tmp_path: Path) -> None:
    rows = [f"> > {angle} | {reading:.1f}" for angle, reading in ROWS]
    lines = ["Hello,", "", "> Force: 36 N", "> angle [deg] | reading [um]", *rows]
    (test,) = imported(tmp_path / "mail.txt", lines).tests
    assert test.force_N == 36.0
    np.testing.assert_allclose(test.reading_um, [reading for _, reading in ROWS])


def test_a_few_lines_with_a_mark_are_no_quotation() -> None:
    text = "\n".join(["> 0: bar longer", *[f"{angle},{reading}" for angle, reading in ROWS]])
    assert without_quote_marks(text) == text


def test_names_of_a_dump_stand_above_its_rows(tmp_path: Path) -> None:
    rows = [f"{k}\t7\t{angle}\t{reading:.1f}" for k, (angle, reading) in enumerate(ROWS)]
    lines = [
        "SET client_encoding = 'UTF8';",
        "-- positive: bar shorter",
        "COPY public.runs (id, load) FROM stdin;",
        "7\t36",
        r"\.",
        "COPY public.readings (id, run_id, angle_deg, reading_um) FROM stdin;",
        *rows,
        r"\.",
        "ALTER TABLE ONLY public.readings ADD CONSTRAINT readings_pkey PRIMARY KEY (id);",
    ]
    (test,) = imported(tmp_path / "dump.sql", lines, forces_N=[36.0]).tests
    np.testing.assert_allclose(test.reading_um, [-reading for _, reading in ROWS])


def test_a_text_without_copy_commands_is_no_dump() -> None:
    assert with_names_of_dump("angle,reading\n0,1\n\\.\n") == "angle,reading\n0,1\n\\.\n"
