"""``ldbb-bayes machine``: what circles show of a machine, as words, as JSON, into a folder."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import ldbb_bayes as lb
from ldbb_bayes.cli.main import app
from ldbb_bayes.machine.jacobian import compliance_jacobian, geometric_jacobian
from ldbb_bayes.machine.kept import kept_compliances

ANGLE = np.linspace(0.1, 6.0, 37)


def invoke(*arguments: object) -> int:
    with pytest.raises(SystemExit) as left:
        app([str(argument) for argument in arguments])
    return int(left.value.code or 0)


def test_the_papers_machine(capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke("machine", "wCAFYXZSt", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    patterns = {entry["name"]: entry["pattern"]["XY"] for entry in found["compliances"] + found["geometric_errors"]}
    assert patterns == {
        "C_XXX": "c²",
        "C_XYX": "cs",
        "C_YYY": "s²",
        "C_CXY": "R c²s",
        "C_CYY": "R cs²",
        "C_CCY": "R² c²s²",
        "E_XX1": "R c²",
        "E_YX2": "R² c²s",
        "E_XY2": "R² cs²",
        "E_YY1": "R s²",
        "E_C0YX": "R cs",
        "E_Xt0": "c",
        "E_Yt0": "s",
    }
    units = {entry["name"]: entry["unit"] for entry in found["compliances"] + found["geometric_errors"]}
    assert (units["C_CCY"], units["E_YX2"], units["E_C0YX"]) == ("rad/(N mm)", "1/mm", "rad")
    assert found["compliances"][0]["members"] == {"C_XXX": 1.0, "C_XXY": 1.0}
    assert found["condition_number"] == pytest.approx(9742.79, abs=0.01)
    assert found["rank"] == 6
    assert len(found["null"]) == 5


def value_of(pattern: str, radius: float, angle: np.ndarray) -> np.ndarray:
    """A printed pattern as numbers, by reading it back."""
    text = pattern.replace("−", "-").replace(" - ", " + -").removeprefix("+")
    total = np.zeros_like(angle)
    for term in text.split(" + "):
        sign, body = (-1.0, term[1:]) if term.startswith("-") else (1.0, term)
        value = np.full_like(angle, sign)
        for word in body.split():
            if word[0] in "0123456789.":
                value = value * float(word)
                continue
            for letter, power in zip(word, (*word[1:], ""), strict=True):
                base = {"R": radius, "c": np.cos(angle), "s": np.sin(angle)}.get(letter)
                if base is not None:
                    value = value * base ** {"²": 2, "³": 3, "⁴": 4}.get(power, 1)
        total = total + value
    return total


@pytest.mark.parametrize(
    ("topology", "planes", "frames", "centre"),
    [
        ("wYXFZt", ("XY",), {"X": (0.0, -200.0, 350.0)}, (10.0, 20.0, 0.0)),
        ("wXFYZt", ("XY", "YZ", "ZX"), {"Y": (30.0, 0.0, -120.0)}, (0.0, -15.0, 40.0)),
    ],
)
def test_patterns_say_what_the_columns_are(topology: str, planes: tuple[str, ...], frames: dict, centre: tuple) -> None:
    machine = lb.Machine(topology, planes, frames)
    circles = [lb.Circle(150.0, centre, plane) for plane in planes]
    found = lb.describe(machine, circles)
    kept = kept_compliances(machine, *circles)
    for plane in planes:
        small = lb.Circle(80.0, centre, plane)
        columns = {
            name.label: column
            for name, column in zip(kept.names, compliance_jacobian(machine, small, ANGLE, kept.names).T, strict=True)
        }
        columns |= {
            entry.name: column
            for entry, column in zip(found.geometric_errors, geometric_jacobian(machine, small, ANGLE).T, strict=True)
        }
        for entry in (*found.compliances, *found.geometric_errors):
            shown = entry.pattern.get(plane)
            expected = np.zeros_like(ANGLE) if shown is None else value_of(shown, 80.0, ANGLE)
            np.testing.assert_allclose(columns[entry.name], expected, rtol=1e-5, atol=1e-5 * max(1.0, np.abs(expected).max()))


def test_words_and_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "m"
    assert invoke("machine", "wXFYZt", "--plane", "XY,YZ", "--out", out) == 0
    shown = " ".join(capsys.readouterr().out.split())
    for words in ("X in the workpiece branch", "pattern in YZ", "E_A(0Y)Z", "squareness error of Z to Y", "can be told apart"):
        assert words in shown
    assert sorted(path.name for path in out.iterdir()) == sorted(
        [
            "machine.json",
            *(f"{k}_atlas_{p}.{e}" for k in ("compliance", "geometric") for p in ("XY", "YZ") for e in ("png", "svg")),
        ]
    )
    assert invoke("machine", "wXFYZt", "--out", out) == 2
    assert invoke("machine", "wXFYZt", "--out", out, "--force") == 0
    assert (out / "compliance_atlas.svg").exists()
    assert not (out / "compliance_atlas_YZ.svg").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("wCAFYXZSt", "--plane", "XZ"), "plane must be one of XY, YZ, ZX, got 'XZ'. Did you mean 'ZX'"),
        (("YXZ",), "topology must read w…F…t"),
        (("wFYXt", "--plane", "YZ"), "got 'wFYXt' without Z"),
        (("wFYXZt", "--frame", "Y=1,2"), "--frame must hold three finite numbers X,Y,Z in mm, got '1,2'"),
        (("wFYXZt", "--frame", "Y"), "--frame must be AXIS=X,Y,Z, got 'Y'"),
        (("wFYXZt", "--frame", "Q=1,2,3"), "frames_mm must name linear axes of 'wFYXZt', got 'Q'"),
        (("wFYXZt", "--frame", "Y=1,2,nan"), "three finite numbers"),
        (("wFYXZt", "--centre", "a,b,c"), "--centre must hold three finite numbers"),
        (("wFYXZt", "--centre", "inf,0,0"), "--centre must hold three finite numbers"),
    ],
)
def test_wrong_input(arguments: tuple[str, ...], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert invoke("machine", *arguments) == 2
    error = capsys.readouterr().err
    assert message in error
    assert "Traceback" not in error
