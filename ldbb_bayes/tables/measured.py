"""The columns of numbers of one test, in our units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError
from ldbb_bayes.tables.assumptions import Notes
from ldbb_bayes.tables.heading import Heading
from ldbb_bayes.tables.layout import Layout
from ldbb_bayes.tables.units import UNITS, in_ours

__all__ = ["Measured"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Measured:
    """Of one test.

    Attributes
    ----------
    place : str
        What a message calls the test.
    lines : sequence of int
        Of its rows in the file.
    numbers : mapping of role to ndarray, shape (n,)
        As the file has them.
    """

    place: str
    heading: Heading
    layout: Layout
    notes: Notes
    lines: Sequence[int]
    numbers: Mapping[str, Array]

    def unit(self, role: str, default: str, because: str = "no unit in the header") -> float:
        """Of one unit in ours: the unit that was given, else the one the header names, else the default, told.

        Raises
        ------
        InputError
            When it is none of the role's.
        """
        header: str = self.heading.units[self.heading.roles[role]]
        given: str | None = getattr(self.layout, f"{role}_unit")
        named = given or header
        option = "--unit" if role == "reading" else f"--{role}-unit"
        one = in_ours(role, named or default)
        if one is None:
            raise InputError(
                f"{self.place}: the {role} must be in {', '.join(UNITS[role])}, got {named[:40]!r} in line {self.heading.line}. "
                f"Correct the header, or give {option}."
            )
        if not named:
            self.notes.add(self.place, f"unit of the {role}", default, because, option)
        elif not given and " " in header:
            self.notes.add(self.place, f"unit of the {role}", header, f"line {self.heading.line}", option)
        elif header and in_ours(role, header) != one:
            says = f"line {self.heading.line} says {header}"
            self.notes.add(self.place, f"unit of the {role}", f"{named}, as given", says, option)
        self.notes.keep(**{f"{role}_unit": None if header else named or default})
        return one

    def one_value(self, role: str, default: str, *, may_change: bool) -> float | None:
        """The one value of a column of loads; one that changes is left out, and told, where a load is given.

        Raises
        ------
        InputError
            Naming the line where it changes.
        """
        if role not in self.numbers:
            return None
        try:
            values = self.numbers[role] * self.unit(role, default)
        except InputError as error:
            if not may_change:
                raise
            self.notes.add(
                self.place, f"column of the {role}", "not used", str(error).removeprefix(f"{self.place}: "), f"--{role}-column"
            )
            return None
        if np.ptp(values) <= 1e-9 * max(float(np.abs(values).max()), 1.0):
            return float(values[0])
        span = f"{values.min():g} to {values.max():g} {default}"
        line = self.lines[int(np.flatnonzero(values != values[0])[0])]
        if may_change:
            self.notes.add(self.place, f"column of the {role}", "not used", f"it changes, {span}", f"--{role}-column")
            return None
        raise InputError(
            f"{self.place}, line {line}: {role} must be the same in all rows of a test, got {span}. "
            "Name the test of each row in a column "
            f"(--test-column), or give the nominal value (--{'forces-N' if role == 'force' else 'pressures-bar'})."
        )
