"""Machines in the names of sheets and files, such as ``VMC 07 100N`` beside ``VMC 08 100N``."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from ldbb_bayes.errors import InputError
from ldbb_bayes.reading.names import name_as_words
from ldbb_bayes.reading.recording import FIELDS_OF_MACHINE, Recording
from ldbb_bayes.reading.words import LONGEST_NAME, WORDS

__all__ = ["check_names_are_of_one_machine"]

# Regular expression for a word such as "machine" or "VMC" and the number of the machine. A number
# with a unit, as in "machine 100 N", is no number of a machine.
_MACHINE = re.compile(
    rf"(?<![^\W_])(?:{WORDS['machines']['kinds']})[ _-]?(?:no\.?|nr\.?|#)?[ _-]?\d+(?![\d.,])"
    r"(?![-_]\d\d)(?![ _-]?(?:k?N|daN|lbf|kgf|m?bar|psi|[MkP]Pa|mm|µm|um|°)(?![^\W_]))",
    re.IGNORECASE,
)


def check_names_are_of_one_machine(
    recordings: Sequence[Recording], campaign: Mapping[str, Any]
) -> None:
    """Raise an error if the names of sheets or files number several machines.

    Without this check, the circles of ``VMC 07 100N`` and ``VMC 08 100N`` would become circles of
    one machine.

    Parameters
    ----------
    recordings
        All tests.
    campaign
        Fields of the campaign that options or lines of files state. A machine that they state is
        that of all tests.

    Raises
    ------
    InputError
        If two names differ in the number of the machine.
    """
    if any(campaign.get(key) for key in (*FIELDS_OF_MACHINE, "machine_id")):
        return
    first: tuple[str, Recording] | None = None
    for recording in recordings:
        machine = _machine_of(recording)
        if not machine:
            continue
        if first is None:
            first = (machine, recording)
        other, place = first
        if _number_of(machine) != _number_of(other):
            remedy = "Import machines one by one (name the files of one)."
            if recording.sheet.name:
                remedy = "Import machines one by one (--sheets with those of one)."
            raise InputError(
                f"{recording.place}: machine_type must be said once, got {machine!r} in its name"
                f" and {other!r} in {place.title[:LONGEST_NAME]!r}. {remedy} Of one machine, give"
                " --machine-type."
            )


def _machine_of(recording: Recording) -> str:
    """Return the machine that the names of a test state, such as ``VMC 07``; empty if none does."""
    for name in recording.names_of_files():
        match = _MACHINE.search(name_as_words(name[:LONGEST_NAME]))
        if match is not None:
            return match[0]
    return ""


def _number_of(machine: str) -> int:
    """Return the number of a machine such as ``VMC 07``."""
    return int(re.findall(r"\d+", machine)[-1])
