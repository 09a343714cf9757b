"""Each choice of the page's form means what its words say: said in words, then read back."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import field_files
import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.app import fields, page_words

WORDS = page_words.words_of_page("en")
CIRCLE = field_files.TRUTH[0]
ANGLE_DEG = CIRCLE.angle_deg
READING_UM = CIRCLE.reading_um
PLAIN = field_files.texts("Angle [deg];Reading [um]", separator=";", circles=[CIRCLE])
TWO_LAPS = field_files.texts(
    "Angle [deg];Reading [um]",
    lambda circle, k: [f"{5 * k}", f"{circle.reading_um[k % 72]:.3f}"],
    separator=";",
    circles=[
        field_files.Circle(100.0, np.arange(0.0, 720.0, 5.0), np.tile(READING_UM, 2)),
    ],
)
DISTANCES = field_files.texts(
    "Angle [deg];Reading [mm]",
    lambda circle, k: [f"{ANGLE_DEG[k]:g}", f"{150.0 + READING_UM[k] / 1e3:.6f}"],
    separator=";",
    circles=[CIRCLE],
)
COMMAS = field_files.texts(
    "Angle [deg];Reading [um]",
    lambda circle, k: [f"{ANGLE_DEG[k]:g}", f"{READING_UM[k]:.3f}".replace(".", ",")],
    separator=";",
    circles=[CIRCLE],
)
FEED = "Feed: 2000 mm/min"
PAUSE = field_files.texts(
    "Time [s];Reading [um]",
    field_files.logged(field_files.with_jump(14.0, 30.0)),
    above=f"{FEED}\nRun-in: 0 deg",
    separator=";",
    circles=[CIRCLE],
)
PRESSURES = {"2.5bar.csv": PLAIN["100N.csv"]}


class Said(NamedTuple):
    """One choice of the form, in the words of the page, and what the campaign must then be."""

    name: str
    value: str
    label: str
    choice: str
    holds: Callable[[lb.Campaign], bool]
    files: dict[str, bytes] = PLAIN


def angle_of_first(campaign: lb.Campaign) -> float:
    """Return where the first reading of the file was taken [deg]."""
    return float(np.mod(campaign.tests[0].angle_deg[0], 360.0))


def angle_of_second(campaign: lb.Campaign) -> float:
    return float(np.mod(campaign.tests[0].angle_deg[1], 360.0))


def first_reading(campaign: lb.Campaign) -> float:
    return float(campaign.tests[0].reading_um[0])


def is_first_reading(factor: float) -> Callable[[lb.Campaign], bool]:
    return lambda campaign: bool(np.isclose(first_reading(campaign), factor * READING_UM[0]))


ZERO = "Axis at which the file's angles begin: +X, -X, +Y or -Y (of the plane)."
SENSE = "How the file counts angles: CCW or CW. Default: CCW."
SIGN = "-1 where a longer bar counts as negative."
COUNTING = "-1 where the file counts angles clockwise."
MEASURED = "Readings are of the radius or of the diameter; the latter are halved."
READINGS = "Readings are a deviation (from the nominal radius) or distance (of the balls)."
DIRECTION = "Direction of all tests: CW or CCW."
LAPS = "Laps of a recording longer than a turn: keep or average."
GAPS = "What the machine did in a gap of the log: still (it stood) or moving (it went on)."
DECIMAL = "Decimal mark: . or ,"
PLANE = "Plane"
MOUNT = "Readings not compensated for the mount"
CHOICES = (
    Said("raw", "yes", MOUNT, "not compensated", lambda c: not c.mount.compensated),
    Said("raw", "", MOUNT, "", lambda c: c.mount.compensated),
    Said("order", "random", "Order of the tests", "random", lambda c: c.order == "random"),
    Said(
        "no_drift",
        "yes",
        "Drift from test to test",
        "none, as after a long warm-up",
        lambda c: not c.drift,
    ),
    Said("no_drift", "", "Drift from test to test", "", lambda c: c.drift),
    Said("direction", "CW", DIRECTION, "CW", lambda c: c.tests[0].direction == "CW"),
    Said("direction", "CCW", DIRECTION, "CCW", lambda c: c.tests[0].direction == "CCW"),
    Said("sign", "1", SIGN, "1", is_first_reading(1.0)),
    Said("sign", "-1", SIGN, "-1", is_first_reading(-1.0)),
    Said("measured", "radius", MEASURED, "of the radius (radius)", is_first_reading(1.0)),
    Said("measured", "diameter", MEASURED, "of the diameter (diameter)", is_first_reading(0.5)),
    Said(
        "zero",
        "distance",
        READINGS,
        "distances of the balls (distance)",
        is_first_reading(1.0),
        DISTANCES,
    ),
    Said(
        "zero",
        "deviation",
        READINGS,
        "deviations from the radius (deviation)",
        is_first_reading(1.0),
    ),
    Said("angle_sense", "CW", SENSE, "CW", lambda c: angle_of_second(c) == 355.0),
    Said("angle_sense", "CCW", SENSE, "CCW", lambda c: angle_of_second(c) == 5.0),
    Said("angle_sign", "-1", COUNTING, "-1", lambda c: angle_of_second(c) == 355.0),
    Said("angle_sign", "1", COUNTING, "1", lambda c: angle_of_second(c) == 5.0),
    Said("laps", "keep", LAPS, "keep every lap (keep)", lambda c: c.readings == 144, TWO_LAPS),
    Said(
        "laps", "average", LAPS, "average the laps (average)", lambda c: c.readings == 72, TWO_LAPS
    ),
    Said("decimal", ",", DECIMAL, ",", is_first_reading(1.0), COMMAS),
    Said("decimal", ".", DECIMAL, ".", is_first_reading(1.0)),
    Said("gaps", "still", GAPS, "stood still (still)", lambda c: c.readings == 72, PAUSE),
    Said(
        "gaps",
        "moving",
        GAPS,
        "moved on (moving)",
        lambda c: c.tests[0].angle_deg.max() > 400.0,
        PAUSE,
    ),
)
AXES_DEG = {"+X": 0.0, "+Y": 90.0, "-X": 180.0, "-Y": 270.0}


def read_with(folder: Path, files: dict[str, bytes], choices: dict[str, str]) -> lb.Campaign:
    """Return the campaign that the page reads from files with entries of its form."""
    (folder / fields.FILES).mkdir()
    for name, content in files.items():
        (folder / fields.FILES / name).write_bytes(content)
    return fields.read_files(folder, choices).campaign


def label_of(name: str) -> str:
    return str(WORDS["labels"].get(name, fields.FIELDS[name].help))


def words_of_choice(name: str, value: str) -> str:
    """Return what the page shows for a choice, as its template does."""
    values = dict(fields.FIELDS[name].choices)
    choices = WORDS["choices"]
    return str(choices.get(f"{name} {value}", choices.get(value, values.get(value, ""))))


@pytest.mark.parametrize("case", CHOICES, ids=lambda case: f"{case.name} {case.value}")
def test_a_choice_means_what_its_words_say(case: Said, tmp_path: Path) -> None:
    assert label_of(case.name).startswith(case.label)
    assert words_of_choice(case.name, case.value) == case.choice
    campaign = read_with(tmp_path, case.files, {case.name: case.value})
    assert case.holds(campaign)


@pytest.mark.parametrize("axis", AXES_DEG)
@pytest.mark.parametrize(("sense", "step_deg"), [("CCW", 5.0), ("CW", -5.0)])
def test_angles_begin_at_the_axis_that_is_chosen(
    axis: str, sense: str, step_deg: float, tmp_path: Path
) -> None:
    assert label_of("angle_zero").startswith(ZERO)
    campaign = read_with(tmp_path, PLAIN, {"angle_zero": axis, "angle_sense": sense})
    assert angle_of_first(campaign) == AXES_DEG[axis]
    assert angle_of_second(campaign) == (AXES_DEG[axis] + step_deg) % 360.0


@pytest.mark.parametrize("plane", ["XY", "YZ", "ZX"])
def test_the_plane_that_is_chosen_is_that_of_the_tests(plane: str, tmp_path: Path) -> None:
    assert label_of("plane") == PLANE
    assert read_with(tmp_path, PLAIN, {"plane": plane}).plane == plane


@pytest.mark.parametrize(("value", "words"), fields.FIELDS["topology"].choices)
def test_the_machine_that_is_chosen_is_that_of_the_campaign(
    value: str, words: str, tmp_path: Path
) -> None:
    assert value in words
    plane = lb.Machine(value).planes[0]
    campaign = read_with(tmp_path, PLAIN, {"topology": value, "plane": plane})
    assert campaign.topology == value


NUMBERS = {
    "radius_mm": ("Nominal radius (mm)", lambda c: c.radius_mm),
    "resolution_um": ("Step of the readout (µm)", lambda c: c.resolution_um),
    "mount_um_per_bar": (
        "Deflection of the mount (µm/bar)",
        lambda c: c.mount.deflection_um_per_bar,
    ),
    "force_slope": ("Force law: N per bar", lambda c: c.force_law.slope_N_per_bar),
    "force_offset": ("Force law: N at zero pressure", lambda c: c.force_law.offset_N),
    "bar_U_um": ("U of the bar's length (µm)", lambda c: c.instrument.bar_U_um),
    "mount_U_percent": (
        "U of the mount's deflection (%)",
        lambda c: c.instrument.mount_U_percent,
    ),
    "force_U_percent": ("U of the force (%)", lambda c: c.instrument.force_U_percent),
    "force_linearity_percent": (
        "Non-linearity of the force (%)",
        lambda c: c.instrument.force_linearity_percent,
    ),
    "force_random_N": (
        "Random error of the force (N, 1 sd)",
        lambda c: c.instrument.force_random_N,
    ),
    "angle_U_deg": ("U of the angle (°)", lambda c: c.instrument.angle_U_deg),
}


@pytest.mark.parametrize("name", NUMBERS)
def test_a_number_of_the_form_is_that_of_the_campaign(name: str, tmp_path: Path) -> None:
    label, number_of = NUMBERS[name]
    assert label_of(name) == label
    assert number_of(read_with(tmp_path, PLAIN, {name: "1,25"})) == 1.25


def test_the_force_law_of_the_form_gives_the_force_of_a_pressure(tmp_path: Path) -> None:
    law = {"force_slope": "100", "force_offset": "-10"}
    campaign = read_with(tmp_path, PRESSURES, law)
    assert campaign.forces_N.tolist() == [240.0]


def test_all_choices_of_the_form_are_tried() -> None:
    tried = {(case.name, case.value) for case in CHOICES}
    elsewhere = {"angle_zero", "plane", "topology", "language"}
    missing = []
    for name, field in fields.FIELDS.items():
        for value, _ in field.choices:
            if name not in elsewhere and (name, value) not in tried:
                missing.append((name, value))
    assert missing == []


def test_the_radius_of_the_form_chooses_the_bar_of_a_certificate(tmp_path: Path) -> None:
    number = (
        r"<si:real><si:value>{}</si:value><si:unit>\micro\metre</si:unit><si:expandedUnc>"
        "<si:uncertainty>0.6</si:uncertainty><si:coverageFactor>2</si:coverageFactor>"
        "</si:expandedUnc></si:real>"
    )
    results = ""
    for name, deviation_um in (("Bar 100 mm", 0.8), ("Bar 150 mm", -0.4)):
        results += (
            f"<dcc:result><dcc:name><dcc:content>{name}</dcc:content></dcc:name><dcc:quantity>"
            "<dcc:name><dcc:content>Deviation of length</dcc:content></dcc:name>"
            f"{number.format(deviation_um)}</dcc:quantity></dcc:result>"
        )
    certificate = (
        '<dcc:digitalCalibrationCertificate xmlns:dcc="https://ptb.de/dcc"'
        f' xmlns:si="https://ptb.de/si"><dcc:measurementResults>{results}'
        "</dcc:measurementResults></dcc:digitalCalibrationCertificate>"
    )
    files = {**PLAIN, "bar.xml": certificate.encode()}
    campaign = read_with(tmp_path, files, {"radius_mm": "100", "bar_dcc": "bar.xml"})
    assert campaign.instrument.bar_length_error_um == -0.8
