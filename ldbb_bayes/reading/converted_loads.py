"""Note on forces and pressures that a file states in another unit than N and bar."""

from __future__ import annotations

from collections.abc import Iterable

from ldbb_bayes.reading.assumptions import AssumptionLog
from ldbb_bayes.reading.column_units import unit_in_file
from ldbb_bayes.reading.recording import LOAD_ROLES, UNITS_SHOWN, Recording

__all__ = ["note_converted_loads"]


def note_converted_loads(recordings: Iterable[Recording], log: AssumptionLog) -> None:
    """Add a note for each unit from which the forces or pressures of a column were converted.

    The note states one converted value, so that a reader can check the unit. There is no note on a
    unit that the user states.
    """
    noted = set()
    for recording in recordings:
        if any(recording.stated_value(key) is not None for key in LOAD_ROLES):
            continue
        for key, role in LOAD_ROLES.items():
            if role not in recording.numbers:
                continue
            unit = unit_in_file(recording, role)
            if unit in ("", UNITS_SHOWN[key]) or (role, unit) in noted:
                continue
            noted.add((role, unit))
            number = float(recording.numbers[role].mean())
            reason = f"{number:.6g} {unit} are {recording.fields[key]:.6g} {UNITS_SHOWN[key]}"
            log.add(recording.place, f"unit of the {role}", unit, reason, f"--{role}-unit")
