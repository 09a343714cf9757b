"""Conversion of readings that measure the diameter of a circle to readings of its radius."""

from __future__ import annotations

from ldbb_bayes.errors import require
from ldbb_bayes.reading.cited_lines import TEXT_SHOWN, CitedLine, cited_line
from ldbb_bayes.reading.measured_length import (
    doubles_readings,
    leaves_length_open,
    may_be_diameter,
    measured_length,
    names_diameter,
)
from ldbb_bayes.reading.open_question import OpenQuestionError
from ldbb_bayes.reading.recording import Recording

__all__ = ["halve_readings_of_diameter"]


def halve_readings_of_diameter(recording: Recording) -> None:
    """Halve the readings of a test if they measure the diameter, and note that they were halved.

    The user, the header of the column of readings, or a line outside the table states whether the
    readings measure the radius or the diameter. Nothing is done for a test without readings.

    Raises
    ------
    InputError
        If the user does not state which of the two is measured, in three cases. First, the header
        and the lines state both. Second, the header, a line or a name (of the test, sheet or file)
        may mean the diameter, but neither the header nor a line says clearly whether the radius or
        the diameter is measured. Third, a line says that readings are doubled.
    """
    readings = recording.numbers.get("reading")
    if readings is None:
        return
    header = recording.heading.headers[recording.heading.roles["reading"]]
    sources: dict[str, str | CitedLine] = {}
    length = measured_length(header)
    if length:
        sources[length] = f"the header {header!r}"
    for statement in recording.statements.get("measured", ()):
        sources.setdefault(statement.value, cited_line(statement.line))
    stated: str | None = recording.layout.measured
    listed = " and ".join(f"{length} in {source}" for length, source in sources.items())
    require(
        stated is not None or len(sources) < 2,
        f"{recording.place}: readings must be of radius or diameter, got {listed}. Say which:"
        " --measured.",
    )
    if stated is None:
        _check_open_lines(recording, bool(sources))
    if stated is None and sources:
        stated = next(iter(sources))
    if stated != "diameter":
        return
    recording.numbers["reading"] = 0.5 * readings
    source = sources.get("diameter", "as given")
    recording.note("reading", "half of each, as it is of the diameter", source, "--measured")


def _check_open_lines(recording: Recording, is_stated: bool) -> None:
    """Raise an error if a line, header or name may mean that readings measure the diameter.

    ``is_stated`` states whether the header or a line clearly says that the radius or the diameter
    is measured. If so, an error is raised only for lines which say that readings are doubled.
    """
    for line, text in recording.lines_outside:
        if doubles_readings(text) or (leaves_length_open(text) and not is_stated):
            raise OpenQuestionError(
                f"{recording.place}: readings must be of radius or diameter, got"
                f" {text.strip()[:TEXT_SHOWN]!r} in line {line}. Say which: --measured.",
                "measured",
                ("radius", "diameter"),
            )
    header = recording.heading.headers[recording.heading.roles["reading"]]
    if may_be_diameter(header) and not is_stated:
        raise OpenQuestionError(
            f"{recording.place}: readings must be of radius or diameter, got the header"
            f" {header[:TEXT_SHOWN]!r}. Say which: --measured.",
            "measured",
            ("radius", "diameter"),
        )
    for name in recording.names_of_files():
        if names_diameter(name) and not is_stated:
            raise OpenQuestionError(
                f"{recording.place}: readings must be of radius or diameter, got the name"
                f" {name[:TEXT_SHOWN]!r}. Say which: --measured.",
                "measured",
                ("radius", "diameter"),
            )
