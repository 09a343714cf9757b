"""What files do not state is told, and so are texts that nothing was taken from."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import ldbb_bayes as lb
from ldbb_bayes.reading.unit_lines import units_stated
from ldbb_bayes.reading.unused_segments import unused_segments


def notes_of(folder: Path, lines: list[str], **layout: Any) -> dict[str, str]:
    """Write a circle of 100 N with lines around its table; return value and reason of each note."""
    rows = [f"{5 * k},{k % 7}.25" for k in range(72)]
    path = folder / "100 N.csv"
    path.write_text("\n".join([*lines, "angle [deg],dR [um]", *rows, ""]), encoding="utf-8")
    return notes_on(path, **layout)


def notes_on(path: Path, **layout: Any) -> dict[str, str]:
    imported = lb.import_campaign(path, layout=lb.reading.Layout.model_validate(layout))
    return {note.what: f"{note.value} ({note.because})" for note in imported.assumptions}


@pytest.mark.parametrize(
    ("subject", "note"),
    [
        ("sign of the reading", "1: a longer bar is positive (nothing says otherwise)"),
        ("reading", "of the radius, not of the diameter (nothing says otherwise)"),
        ("angle", "from the plane's first axis, CCW (nothing says otherwise)"),
        ("direction", "not stated (nothing says otherwise)"),
    ],
)
def test_a_convention_that_nothing_states_is_told(tmp_path: Path, subject: str, note: str) -> None:
    assert notes_of(tmp_path, [])[subject] == note


@pytest.mark.parametrize(
    ("subject", "stated"),
    [
        ("sign of the reading", {"sign": 1}),
        ("reading", {"measured": "radius"}),
        ("angle", {"angle_sense": "CCW"}),
        ("angle", {"angle_sign": 1}),
        ("direction", {"direction": "CCW"}),
    ],
)
def test_a_convention_that_the_user_states_is_not(
    tmp_path: Path, subject: str, stated: dict[str, Any]
) -> None:
    assert "nothing says otherwise" not in notes_of(tmp_path, [], **stated).get(subject, "")


@pytest.mark.parametrize(
    "line",
    [
        "# e = L0 - L",
        "# tare 20 N not subtracted",
        "# scale: 1 digit = 0.5 um",
        "# run 3 invalid: air hose blocked",
    ],
)
def test_a_line_that_is_not_used_is_told(tmp_path: Path, line: str) -> None:
    assert notes_of(tmp_path, [line])["texts not used"] == f"{line!r} (line 1)"


@pytest.mark.parametrize("label", ["Startzeit", "Start time"])
def test_the_label_of_a_time_in_a_cell_of_its_own_is_used(label: str) -> None:
    line = f"{label};20.11.2026 09:11"
    assert unused_segments(line, [""]) == ""
    assert unused_segments(f"{line};gauge turned over", [""]) == "gauge turned over"


def test_a_line_that_is_used_is_not_told(tmp_path: Path) -> None:
    notes = notes_of(tmp_path, ["Positive reading: bar shorter", "Operator: Meier"])
    assert notes["sign of the reading"] == "-1: a longer bar is negative (line 1)"
    assert "texts not used" not in notes


def notes_below(folder: Path, line: str) -> dict[str, str]:
    """Write a circle of 100 N with a line below its table; return value and reason of each note."""
    rows = "\n".join(f"{5 * k},{k % 7}.25" for k in range(72))
    path = folder / "100 N.csv"
    path.write_text(f"angle [deg],dR [um]\n{rows}\n\n{line}\n", encoding="utf-8")
    return notes_on(path)


def test_lines_below_the_table_are_told(tmp_path: Path) -> None:
    notes = notes_below(tmp_path, "# tare 20 N not subtracted")
    assert notes["texts not used"] == "'# tare 20 N not subtracted' (line 75)"


@pytest.mark.parametrize(
    ("line", "subject", "note"),
    [
        (
            "Positive reading: bar shorter",
            "sign of the reading",
            "-1: a longer bar is negative (line 75)",
        ),
        (
            "Readings are of the diameter",
            "reading",
            "half of each, as it is of the diameter (line 75)",
        ),
        ("Readings are raw", "mount", "raw (line 75)"),
        ("Angles from +Y, clockwise", "angle", "from +Y, CW (line 75)"),
        (
            "travel: left",
            "direction",
            "not taken from there (line 75 says 'travel: left', not understood)",
        ),
    ],
)
def test_a_line_below_the_table_is_read(tmp_path: Path, line: str, subject: str, note: str) -> None:
    assert notes_below(tmp_path, line)[subject] == note


def test_a_direction_below_the_table_is_used(tmp_path: Path) -> None:
    notes = notes_below(tmp_path, "Direction: clockwise")
    assert notes["direction"].startswith("CW")


@pytest.mark.parametrize(
    ("line", "subject"),
    [
        ("Nominal - measured: 0.012 mm", "sign of the reading"),
        ("Circularity of circle CW: 12.3 um", "direction"),
        ("Angle of the maximum from +Y: 30 deg", "angle"),
    ],
)
def test_a_result_below_the_table_states_nothing(tmp_path: Path, line: str, subject: str) -> None:
    assert "says otherwise" in notes_below(tmp_path, line)[subject]


def test_a_label_of_the_sign_beside_a_force_is_refused(tmp_path: Path) -> None:
    with pytest.raises(lb.errors.InputError, match="--sign"):
        notes_of(tmp_path, ["Sign;reversed;Force;100 N"])


def test_an_unclear_line_on_the_mount_below_the_table_is_refused(tmp_path: Path) -> None:
    with pytest.raises(lb.errors.InputError, match="not compensated for the mount"):
        notes_below(tmp_path, "Note: readings are not compensated for the mount.")


@pytest.mark.parametrize(
    "line",
    [
        "# nominal minus measured; angles ccw from +X",
        "Force 100 N, nominal minus measured",
        "Winkel ab +X gegen den Uhrzeigersinn; Soll - Ist",
        "Machine DMU 50; nominal minus measured; Force 100 N",
    ],
)
def test_a_sign_beside_another_statement_is_used(tmp_path: Path, line: str) -> None:
    notes = notes_of(tmp_path, [line])
    assert notes["sign of the reading"] == "-1: a longer bar is negative (line 1)"


@pytest.mark.parametrize(
    "line",
    [
        "Force 100 N, diameter deviation",
        "R = 100 mm, travel CW, deviation of the diameter",
        "Date: 2026-11-20, deviation of the diameter",
    ],
)
def test_a_diameter_beside_another_statement_is_used(tmp_path: Path, line: str) -> None:
    note = notes_of(tmp_path, [line])["reading"]
    assert note == "half of each, as it is of the diameter (line 1)"


@pytest.mark.parametrize(
    "line",
    [
        "Force 100 N; travel clockwise",
        "Force 100 N, plane YZ, R 100 mm, travel clockwise",
        "Force 100 N; CW",
        "Kraft 100 N   Rechtslauf: ja",
        "Kraft 100 N   Linkslauf: nein   Rechtslauf: ja",
        "CW [x]  CCW [ ]",
    ],
)
def test_a_direction_beside_another_statement_is_used(tmp_path: Path, line: str) -> None:
    assert notes_of(tmp_path, [line])["direction"].startswith("CW")


@pytest.mark.parametrize("line", ["Spindle;CW", "Angles from +X, measured clockwise"])
def test_the_sense_of_something_else_is_no_direction(tmp_path: Path, line: str) -> None:
    assert notes_of(tmp_path, [line])["direction"].startswith("not stated")


def test_a_direction_that_only_an_answer_denies_is_told(tmp_path: Path) -> None:
    notes = notes_of(tmp_path, ["Kraft 100 N   Linkslauf: nein"])
    assert notes["direction"].startswith("not taken from there")


@pytest.mark.parametrize(
    ("line", "segment"),
    [
        ("Force 100 N; e = L0 - L", "e = L0 - L"),
        ("Force 100 N, Soll-Ist-Vergleich", "Soll-Ist-Vergleich"),
        ("Force 100 N nominal minus measured", "Force 100 N nominal minus measured"),
    ],
)
def test_a_segment_that_is_not_used_is_told(tmp_path: Path, line: str, segment: str) -> None:
    assert notes_of(tmp_path, [line])["texts not used"] == f"{segment!r} (line 1)"


@pytest.mark.parametrize(
    "line",
    [
        "Drehsinn der Bahn: im Uhrzeigersinn",
        "Die Bahn wurde im Uhrzeigersinn durchfahren.",
        "Operator;Meier;Machine;DMU 50;Date;2026-11-12",
        "Feed 2000 mm/min   Plane XY   Radius 150 mm",
        "Angles in deg, positive clockwise from +X",
        "Winkel in Grad, von +X aus im Uhrzeigersinn",
    ],
)
def test_a_line_of_which_all_is_used_is_not_told(tmp_path: Path, line: str) -> None:
    assert "texts not used" not in notes_of(tmp_path, [line])


def test_a_diameter_in_a_title_with_a_number_is_refused(tmp_path: Path) -> None:
    title = "Tabelle 3: Durchmesserabweichung ΔD in µm bei verschiedenen Prüflasten (in daN)"
    with pytest.raises(lb.errors.InputError, match="--measured"):
        notes_of(tmp_path, [title])


def test_cells_beside_the_table_are_told(tmp_path: Path) -> None:
    rows = [f"{5 * k},{k % 7}.25,," for k in range(72)]
    rows[0] = "0,0.25,,Gauge turned over"
    path = tmp_path / "100 N.csv"
    path.write_text("\n".join(["angle [deg],dR [um],,", *rows, ""]), encoding="utf-8")
    assert "'Gauge turned over'" in notes_on(path)["texts not used"]


def test_texts_beyond_six_are_counted(tmp_path: Path) -> None:
    notes = notes_of(tmp_path, [f"# remark {word}" for word in "abcdefgh"])
    assert notes["texts not used"] == "2 (further lines)"


def test_radius_or_diameter_is_told_beside_a_stated_sign(tmp_path: Path) -> None:
    notes = notes_of(tmp_path, ["Positive reading: bar shorter"])
    assert notes["reading"] == "of the radius, not of the diameter (nothing says otherwise)"


def test_a_note_on_one_file_does_not_hide_a_line_of_another(tmp_path: Path) -> None:
    """Line 1 of the first file states the sign; line 1 of the second file is not understood."""
    rows = "\n".join(f"{5 * k},{k % 7}.25" for k in range(72))
    texts = {"100 N.csv": "Positive reading: bar shorter", "200 N.csv": "# tare not subtracted"}
    for name, line in texts.items():
        path = tmp_path / name
        path.write_text(f"{line}\nangle [deg],dR [um]\n{rows}\n", encoding="utf-8")
    imported = lb.import_campaign([tmp_path / name for name in texts])
    values = [note.value for note in imported.assumptions if note.what == "texts not used"]
    assert values == ["'# tare not subtracted'"]


def test_lines_below_several_columns_of_readings_are_told(tmp_path: Path) -> None:
    rows = "\n".join(f"{5 * k},{k % 7}.25,{k % 5}.5" for k in range(72))
    text = f"angle [deg],100 N [um],200 N [um]\n{rows}\n\n# tare not subtracted,,\n"
    path = tmp_path / "all.csv"
    path.write_text(text, encoding="utf-8")
    assert "# tare not subtracted" in notes_on(path)["texts not used"]


def unused_texts_of(folder: Path, lines: list[str]) -> list[str]:
    rows = [f"{5 * k};{k % 7}.25" for k in range(72)]
    path = folder / "100 N.csv"
    path.write_text("\n".join([*lines, "angle [deg];dR [um]", *rows, ""]), encoding="utf-8")
    notes = lb.import_campaign(path).assumptions
    return [note.value for note in notes if note.what == "texts not used"]


def test_a_text_on_a_convention_is_told_before_other_texts(tmp_path: Path) -> None:
    remarks = [f"Remark {letter}" for letter in "abcdefgh"]
    unused = unused_texts_of(tmp_path, [*remarks, "Spindle turned clockwise"])
    assert unused[0] == "'Spindle turned clockwise'"


def test_texts_that_differ_only_in_numbers_are_told_once(tmp_path: Path) -> None:
    unused = unused_texts_of(tmp_path, ["Pressione 1 mmHg", "Pressione 2 mmHg", "Remark"])
    assert unused == ["'Pressione 1 mmHg'", "'Remark'", "1"]


@pytest.mark.parametrize(
    "line",
    [
        "Winkel ab +X, im Uhrzeigersinn positiv",
        "Bediener: Vogel, Huber",
        "Sensor 3, + = longer",
    ],
)
def test_a_text_that_is_used_is_not_told_as_unused(tmp_path: Path, line: str) -> None:
    unused = unused_texts_of(tmp_path, [line])
    assert not set(line.split(", ")[1:]) & {text.strip("'") for text in unused}


def test_a_convention_beside_texts_that_are_not_understood_says_so(tmp_path: Path) -> None:
    notes = notes_of(tmp_path, ["Alkusuunta pohjoiseen"])
    assert notes["angle"].endswith("(no text that is understood says otherwise)")


def test_the_type_of_a_machine_ends_before_the_next_name_and_value(tmp_path: Path) -> None:
    notes = notes_of(tmp_path, ["machine=VMC-4711 plane=XY R=150mm"])
    assert notes["machine_type"] == "VMC-4711 (line 1)"


def test_a_plus_sign_that_means_longer_is_no_sum_of_lengths(tmp_path: Path) -> None:
    notes = notes_of(tmp_path, ["Analogue input ball bar, 1 V = 10 µm, + = longer"])
    assert notes["sign of the reading"] == "1: a longer bar is positive (line 1)"


def test_all_texts_on_conventions_are_told(tmp_path: Path) -> None:
    colours = ("red", "green", "blue", "white", "black", "brown", "grey", "pink")
    lines = [f"# the {colour} spring: deflection of the mount unknown" for colour in colours]
    rows = [f"{5 * k},{k % 7}.25" for k in range(72)]
    path = tmp_path / "100 N.csv"
    path.write_text("\n".join([*lines, "angle [deg],dR [um]", *rows, ""]))
    notes = lb.import_campaign(path).assumptions
    told = " ".join(f"{note.value} {note.because}" for note in notes)
    assert [line for line in lines if line not in told] == []


def test_values_of_the_campaign_may_be_stated_by_a_text_that_is_not_understood(
    tmp_path: Path,
) -> None:
    notes = notes_of(tmp_path, ["Magnetfuß kompensiert"])
    assert notes["mount"].endswith("(no text that is understood says otherwise)")


@pytest.mark.parametrize(
    "line",
    [
        "Feed 2000 mm/min - positive reading = bar shorter",
        "Temperature 20.3 °C: positive reading = bar shorter",
        "Temperature 20.3 °C (positive reading = bar shorter)",
        "Temperature 20.3 °C and positive reading = bar shorter",
        "Temp: 20 °C / lecture comptée négative quand la barre s'allonge",
        "Winkel ab +X im UZS - Anzeige positiv beim Einfahren (Stab kürzer)",
        "Kladný údaj znamená zkrácení tyče",
    ],
)
def test_a_sign_beside_another_quantity_is_used(tmp_path: Path, line: str) -> None:
    note = notes_of(tmp_path, [line])["sign of the reading"]
    assert note == "-1: a longer bar is negative (line 1)"


def test_a_part_of_a_line_that_nothing_was_taken_from_is_told(tmp_path: Path) -> None:
    notes = notes_of(tmp_path, ["Temperature 20.3 °C - gauge turned over"])
    assert notes["texts not used"] == "'gauge turned over' (line 1)"


def test_parts_of_a_line_that_are_used_are_not_told(tmp_path: Path) -> None:
    notes = notes_of(tmp_path, ["Radius 150 mm - clockwise run"])
    assert "texts not used" not in notes


@pytest.mark.parametrize(
    ("line", "convention"),
    [
        ("角度の基準,+Y軸から時計回り", "from +Y, CW (line 1)"),
        ("角度: X軸の負方向から反時計回り", "from -X, CCW (line 1)"),
        ("角度从+Y轴起顺时针", "from +Y, CW (line 1)"),
        ("각도: +Y축부터 시계방향", "from +Y, CW (line 1)"),
        ("angulo_deg: desde +Y, sentido horario", "from +Y, CW (line 1)"),
        ("Referência angular;eixo -X, sentido horário", "from -X, CW (line 1)"),
        ("Vinkel fra +Y, mot klokka", "from +Y, CCW (line 1)"),
        ("Відлік кутів: від осі +Y за годинниковою стрілкою", "from +Y, CW (line 1)"),
        ("Winkel 0° liegt auf -Y, positiv im Uhrzeigersinn", "from -Y, CW (line 1)"),
    ],
)
def test_the_convention_of_angles_is_read_in_many_languages(
    tmp_path: Path, line: str, convention: str
) -> None:
    notes = notes_of(tmp_path, [line])
    assert notes["angle"] == convention


def test_a_plus_before_an_axis_is_no_sum_of_lengths(tmp_path: Path) -> None:
    line = "Radius 100 mm - 1 Digit = 0,1 µm - Winkel ab +Y im UZS"
    assert notes_of(tmp_path, [line])["radius_mm"] == "100 mm (line 1)"


@pytest.mark.parametrize(
    "line", ["Siła promieniowa: 36 N", "Terhelés: 36 N", "Навантаження: 36 N", "Voima: 36 N"]
)
def test_a_force_is_read_in_many_languages(tmp_path: Path, line: str) -> None:
    path = tmp_path / "circle.csv"
    rows = [f"{5 * k},{k % 7}.25" for k in range(72)]
    path.write_text("\n".join([line, "angle [deg],dR [um]", *rows, ""]), encoding="utf-8")
    assert notes_on(path)["force_N"] == "36 N (line 1)"


def test_a_sense_of_angles_is_no_direction_of_travel(tmp_path: Path) -> None:
    notes = notes_of(tmp_path, ["angulo_deg: desde +X, sentido horario"])
    assert notes["direction"].startswith("not stated")


def texts_not_used(folder: Path, above: str) -> list[str]:
    """Return the texts that the notes of an import list as not used."""
    lines = [*above.split("\n"), "Angle [deg],Reading [um]"]
    lines += [f"{5 * k},{k % 7}.25" for k in range(72)]
    path = folder / "36N.csv"
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    notes = lb.import_campaign(path).assumptions
    return [note.value for note in notes if note.what == "texts not used"]


@pytest.mark.parametrize(
    "line",
    [
        "true deviation of the radius = gauge reading - preset",
        "Preset: 10 um",
        "Offset of the gauge 3.5 um to be subtracted",
        "Vorhalt: 10 µm",
        "Correzione: 10 µm",
    ],
)
def test_a_correction_of_readings_is_told_in_front_of_other_texts(
    line: str, tmp_path: Path
) -> None:
    others = "\n".join(f"remark {word}" for word in ("a", "b", "c", "d", "e", "f", "g"))
    assert texts_not_used(tmp_path, f"{others}\n{line}")[0] == repr(line)


def test_a_correction_beside_used_words_is_told_whole(tmp_path: Path) -> None:
    formula = "true deviation of the radius = gauge reading - preset"
    line = f"Gauge was preset; {formula}. Longer bar positive. Angles anticlockwise from +X."
    assert any(formula in text for text in texts_not_used(tmp_path, line))


def test_corrections_that_differ_in_numbers_are_all_told(tmp_path: Path) -> None:
    texts = texts_not_used(tmp_path, "Preset 1: 10 um\nPreset 2: 25 um")
    assert texts == ["'Preset 1: 10 um'", "'Preset 2: 25 um'"]


def test_a_unit_before_remarks_is_used() -> None:
    assert units_stated("Ch2=dR; Unit=0.01 um; dR=R_nominal-R_actual") == {
        "reading_unit": "0.01 um"
    }


def test_a_sense_of_angles_is_no_unclear_sign(tmp_path: Path) -> None:
    path = tmp_path / "36N.csv"
    rows = [f"{5 * k},{k % 7}.25" for k in range(72)]
    above = ["Angle from +X; positive=CCW", "dR=R_nominal-R_actual"]
    path.write_text("\n".join([*above, "Angle [deg],Reading [um]", *rows, ""]), encoding="utf-8")
    notes = lb.import_campaign(path).assumptions
    signs = [note.value for note in notes if note.what == "sign of the reading"]
    assert signs == ["-1: a longer bar is negative"]


@pytest.mark.parametrize(
    ("line", "convention"),
    [
        ("Angoli da +Y in senso orario", "from +Y, CW"),
        ("Angoli in gradi, senso antiorario, lo zero è sull'asse -X.", "from -X, CCW"),
        ("Angles en degrés, sens trigonométrique, zéro sur l'axe -X.", "from -X, CCW"),
        ("Winkel in Grad, gegen den Uhrzeigersinn, Null auf der Achse -X.", "from -X, CCW"),
    ],
)
def test_the_axis_of_zero_is_read_and_its_segment_is_not_told(
    tmp_path: Path, line: str, convention: str
) -> None:
    notes = notes_of(tmp_path, [line])
    assert notes["angle"].startswith(convention)
    assert "texts not used" not in notes


def test_a_segment_that_is_only_a_unit_is_not_told(tmp_path: Path) -> None:
    notes = notes_of(tmp_path, ["Plane: XY; in µm"])
    assert "texts not used" not in notes
