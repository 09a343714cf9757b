"""Headers which say that angles are multiplied by a number, such as ``Angle x10 [deg]``."""

from __future__ import annotations

from ldbb_bayes.reading.open_question import OpenQuestionError
from ldbb_bayes.reading.recording import Recording
from ldbb_bayes.reading.unit_lines import header_has_factor
from ldbb_bayes.reading.words import LONGEST_NAME, UNITS

__all__ = ["check_angles_are_not_multiplied"]


def check_angles_are_not_multiplied(recording: Recording) -> None:
    """Raise an error if the header of the angles says that they are multiplied by a number.

    Nothing is checked if the user states the unit of the angles.

    Parameters
    ----------
    recording
        Rows of the test in the file, and everything that the file or the user states about the
        test.

    Raises
    ------
    OpenQuestionError
        If the header states a factor, or a number by which angles are divided.
    """
    column = recording.heading.roles.get("angle")
    if column is None or recording.layout.angle_unit is not None:
        return
    header = recording.heading.headers[column][:LONGEST_NAME]
    if header_has_factor(header):
        raise OpenQuestionError(
            f"{recording.place}: the unit of angles must be known, got the header {header!r}. Say"
            " which unit the numbers in the file have: --angle-unit (a tenth of a degree:"
            " --angle-unit '0.1 deg').",
            "angle_unit",
            list(UNITS["angle"]),
        )
