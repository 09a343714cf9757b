"""Field files beside other files, and tables with forces between, above or beside them."""

from __future__ import annotations

import field_files as field
from field_files import FieldCase

__all__ = ["layout_cases"]

HEADER = "Angle [deg],Reading [um]"


def layout_cases() -> dict[str, FieldCase]:
    """Return the cases of companion files and of layouts of several tables."""
    return {**companion_cases()}


def companion_cases() -> dict[str, FieldCase]:
    """Return files of three circles beside a file that holds no circle."""
    kind = "companion files"
    circles = field.texts(HEADER)
    temperatures = "".join(f"{60 * k};{20 + k / 10}\n" for k in range(30))
    forces = "".join(f"{k},{100 * k}\n" for k in range(1, 12))
    texts = {
        "README.txt": "Ball bar measurements\nLoads 100, 300 and 600 N, see the names.\n",
        "Protokoll.md": "# Protokoll\n\n| Bediener | NN |\n|---|---|\n| Ebene | XY |\n",
    }
    refused = {
        "temperatures.csv": f"Time [s];Spindle [°C]\n{temperatures}",
        "Temperaturen.csv": f"Zeit [s];Messwert [°C]\n{temperatures}",
        "calibration.csv": f"Pressure [bar],Force [N]\n{forces}",
        "protocol.pdf": "%PDF-1.4\n",
    }
    cases = {}
    for name, content in texts.items():
        cases[f"companion_{name}"] = FieldCase(
            kind, f"{name} beside three circles", {**circles, name: content.encode()}, told=name
        )
    for name, content in refused.items():
        cases[f"companion_{name}"] = FieldCase(
            kind,
            f"{name} beside three circles",
            {**circles, name: content.encode()},
            refusal="eave it out" if name.endswith("pdf") else f"leave this file out: {name}",
            mended=circles,
        )
    return cases
