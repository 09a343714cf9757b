"""Types of fields that a user fills in: numbers, lengths, forces, names and dates with limits."""

from __future__ import annotations

import re
from datetime import date, datetime
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field

__all__ = [
    "STRICT",
    "Certified",
    "CertifiedAngle",
    "Coordinate",
    "Date",
    "FileName",
    "Force",
    "Harmonic",
    "Label",
    "Length",
    "Number",
    "Percent",
    "Positive",
    "Pressure",
    "Resolution",
    "SetupNumber",
]

# Set-ups are numbered from 1. This is the largest permitted number.
_LARGEST_SETUP = 1000
# Configuration of pydantic, the library that checks input. With this configuration, pydantic
# refuses arguments that do not correspond to a field of the class.
STRICT = ConfigDict(extra="forbid")


def _refuse_text(value: Any) -> Any:
    """Raise a ValueError if a value is a string or a bool; otherwise return the value."""
    if isinstance(value, str | bool):
        raise ValueError("it should be a number")
    return value


def _require_printable(text: str) -> str:
    """Raise a ValueError if a name is blank or cannot be printed; otherwise return the name."""
    if not (text.strip() and text.isprintable()):
        raise ValueError("it should be a name that can be printed")
    return text


def _iso_date(when: Any) -> str:
    """Return a date as a string in ISO 8601, such as 2026-11-20.

    ``when`` is a Python date or a string. A string in ISO 8601, with or without the time of day, is
    returned unchanged. Raise a ValueError for anything else.
    """
    if isinstance(when, date):
        return when.isoformat()
    try:
        datetime.fromisoformat(when)
    except (TypeError, ValueError):
        raise ValueError("it should be a date as ISO 8601, for example 2026-11-20") from None
    return str(when)


def _require_file_name(name: str) -> str:
    """Return the name of a test; raise a ValueError if no file can have this name."""
    if name and not re.fullmatch(r"[\w+\-][\w+\-. ]{0,99}", name):
        raise ValueError(
            "it names a file: letters, digits, spaces, '_', '-', '+' or '.', not starting with"
            " a dot"
        )
    return name


Number = Annotated[float, BeforeValidator(_refuse_text), Field(allow_inf_nan=False)]
Positive = Annotated[Number, Field(gt=0.0)]
# Resolution of a readout [µm]. A dial gauge resolves 10 µm; a larger number is likely to be in
# another unit.
Resolution = Annotated[Number, Field(gt=0.0, le=20.0)]
Percent = Annotated[Number, Field(gt=0.0, le=100.0)]
# Type of a force [N] that a user gives: above zero, at most 1e6.
Force = Annotated[Number, Field(gt=0.0, le=1e6)]
# Type of a pressure [bar] that a user gives: zero or more.
Pressure = Annotated[Number, Field(ge=0.0)]
# Type of a length [mm] that a user gives: above zero, at most 1e5.
Length = Annotated[Number, Field(gt=0.0, le=1e5)]
# Type of a coordinate [mm] that a user gives: from −1e5 to 1e5.
Coordinate = Annotated[Number, Field(ge=-1e5, le=1e5)]
# Type of an uncertainty or deviation, in µm or N, from a certificate: above zero, at most 1000. A
# larger value is probably in another unit.
Certified = Annotated[Number, Field(gt=0.0, le=1e3)]
# Type of an uncertainty of angles [deg] from a certificate: above zero, at most 10. A larger value
# is probably in another unit.
CertifiedAngle = Annotated[Number, Field(gt=0.0, le=10.0)]
# Type of a harmonic a cos n(θ − phase) of a ball's form deviation: order n from 2 to 12, amplitude
# a [µm] and phase [deg].
Harmonic = tuple[
    Annotated[int, BeforeValidator(_refuse_text), Field(ge=2, le=12)],
    Annotated[Number, Field(ge=0.0)],
    Number,
]
SetupNumber = Annotated[int, BeforeValidator(_refuse_text), Field(ge=1, le=_LARGEST_SETUP)]
Label = Annotated[str, AfterValidator(_require_printable)]
# Type of the name of a test, which must also be permitted as the name of a file.
FileName = Annotated[str, AfterValidator(_require_file_name)]
# Type of a date, kept as a string in ISO 8601, such as 2026-11-20.
Date = Annotated[str, BeforeValidator(_iso_date)]
