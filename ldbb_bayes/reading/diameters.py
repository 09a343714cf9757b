"""Readings of the diameter of a circle, which are twice those of its radius."""

from __future__ import annotations

from ldbb_bayes.errors import require
from ldbb_bayes.reading.measured_length import measured_length
from ldbb_bayes.reading.recording import Recording

__all__ = ["halve_diameters"]


def halve_diameters(recording: Recording) -> None:
    """Halve the readings of a test if they are of the diameter, and note that they were halved.

    The user says so, or the header of the readings, or a line above the table.

    Raises
    ------
    InputError
        If header and lines contradict each other and the user does not decide.
    """
    readings = recording.numbers.get("reading")
    if readings is None:
        return
    header = recording.heading.headers[recording.heading.roles["reading"]]
    sources: dict[str, str] = {}
    length = measured_length(header)
    if length:
        sources[length] = f"the header {header!r}"
    for statement in recording.statements.get("measured", ()):
        sources.setdefault(statement.value, f"line {statement.line}")
    stated: str | None = recording.layout.measured
    listed = " and ".join(f"{length} in {source}" for length, source in sources.items())
    require(
        stated is not None or len(sources) < 2,
        f"{recording.place}: readings must be of radius or diameter, got {listed}. Say which:"
        " --measured.",
    )
    if stated is None and sources:
        stated = next(iter(sources))
    if stated != "diameter":
        return
    recording.numbers["reading"] = 0.5 * readings
    source = sources.get("diameter", "as given")
    recording.note("reading", "half of each, as it is of the diameter", source, "--measured")
