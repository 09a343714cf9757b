"""Files as they are found into a campaign: what they say is taken, what they leave open is assumed and said."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.circular_test import CircularTest
from ldbb_bayes.errors import InputError, nearest
from ldbb_bayes.notebook import table_html
from ldbb_bayes.tables.assumptions import Assumption, Notes
from ldbb_bayes.tables.cells import read_sheets
from ldbb_bayes.tables.dividing import tests_in
from ldbb_bayes.tables.heading import Heading, NoTableError, find_heading
from ldbb_bayes.tables.layout import Layout
from ldbb_bayes.tables.sheet import Sheet
from ldbb_bayes.tables.tabled import TabledTest

__all__ = ["Imported", "import_campaign"]

LARGEST_TESTS = 1000
_LONGEST_LIST = 200


@dataclass(frozen=True, eq=False)
class Imported:
    """A campaign from files, with everything that was assumed.

    Attributes
    ----------
    campaign : Campaign
    layout : Layout
        With what was found out filled in: reading the same files with it guesses nothing of them.
    assumptions : tuple of Assumption
    """

    campaign: Campaign
    layout: Layout
    assumptions: tuple[Assumption, ...]

    def _repr_html_(self) -> str:
        tests, readings = len(self.campaign.tests), self.campaign.readings
        return table_html(
            f"{self.campaign.name}: {tests} tests, {readings} readings; assumed", [vars(a) for a in self.assumptions]
        )

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "schema": 1,
            "campaign": {"name": self.campaign.name, "tests": len(self.campaign.tests), "readings": self.campaign.readings},
            "layout": self.layout.model_dump(by_alias=True, exclude_none=True),
            "assumptions": [vars(assumption) for assumption in self.assumptions],
        }


def import_campaign(
    files: Sequence[str | os.PathLike[str]] | str | os.PathLike[str], *, layout: Layout | None = None, **campaign: Any
) -> Imported:
    """Read tables as they are found into one campaign.

    Every file (or sheet of a workbook) is one test, or holds a column that names the test of each row.

    Parameters
    ----------
    files : path or sequence of paths
        CSV or text of any encoding and separator, XLSX.
    layout : Layout, optional
        What is known of the tables; the rest is found out and told.
    **campaign
        Fields of `Campaign`: topology, plane, radius_mm, …

    Raises
    ------
    InputError
        One message that names the file, the line and the cure.
    """
    layout = layout or Layout()
    paths = [Path(file) for file in ([files] if isinstance(files, str | os.PathLike) else files)]
    if not paths:
        raise InputError("files must be given, got none. Name the tables to read.")
    notes = Notes()
    tests: list[CircularTest] = []
    used: set[str] = set()
    for path in paths:
        sheets = read_sheets(path, encoding=layout.encoding, separator=layout.separator, sheets=layout.sheets)
        for sheet, heading in _tables(sheets, layout, notes):
            for tabled, entries in tests_in(sheet, heading, layout, campaign, notes):
                used |= entries
                tests.append(_named_apart(tabled.with_loads(len(tests)).test(), tabled, tests, notes))
                if len(tests) > LARGEST_TESTS:
                    raise InputError(
                        f"{path}: a campaign must have at most {LARGEST_TESTS} tests, got more. Import fewer at once."
                    )
    _check_loads(layout, tests)
    _check_names(paths, tests)
    known = {path.name for path in paths} | {test.name for test in tests}
    for entry in layout.test:
        if entry.file not in used:
            why = f"no file, sheet or label of that name; did you mean {nearest(entry.file, known)!r}?"
            notes.add("", "[[test]] not used", entry.file[:_LONGEST_LIST], why, "--layout")
    _note_machine(campaign, tests, notes)
    campaign.setdefault("name", paths[0].stem if len(paths) == 1 else paths[0].resolve().parent.name or "campaign")
    return Imported(Campaign(tuple(tests), **campaign), notes.layout(layout), notes.told())


def _check_loads(layout: Layout, tests: Sequence[CircularTest]) -> None:
    """One force or pressure for each test."""
    for option, given in (("--forces-N", layout.forces_N), ("--pressures-bar", layout.pressures_bar)):
        if given and len(given) != len(tests):
            names = ", ".join(test.name for test in tests)[:_LONGEST_LIST]
            raise InputError(
                f"{option} must hold one number for each test, got {len(given)} for {len(tests)} tests ({names}). "
                "Give all, in that order."
            )


def _named_apart(test: CircularTest, tabled: TabledTest, before: Sequence[CircularTest], notes: Notes) -> CircularTest:
    """A label that another file or sheet has used comes behind the name of its own."""
    if not tabled.label or test.name not in [own.name for own in before]:
        return test
    name = tabled.name_of_file(f"{tabled.sheet.own_name or tabled.sheet.path.stem} {test.name}")
    notes.add(tabled.place, "name of the test", name, f"{test.name!r} stands elsewhere too", "a [[test]] in --layout")
    return replace(test, name=name)


def _check_names(paths: Sequence[Path], tests: Sequence[CircularTest]) -> None:
    names = [test.name for test in tests]
    twice = next((name for k, name in enumerate(names) if name in names[:k]), None)
    if twice is not None:
        raise InputError(
            f"{', '.join(map(str, paths))[:_LONGEST_LIST]}: tests must bear different names, got {twice!r} twice. "
            "A file or sheet named twice? Else rename one, or give it a name in a [[test]] of --layout."
        )


def _tables(sheets: Sequence[Sheet], layout: Layout, notes: Notes) -> Iterator[tuple[Sheet, Heading]]:
    """Sheets with their headings; of several in a workbook those without a table are left out, and told."""
    found, without = [], []
    for sheet in sheets:
        try:
            found.append((sheet, find_heading(sheet, layout)))
        except NoTableError:
            if len(sheets) == 1 or layout.sheets:
                raise
            without.append(sheet)
    if not found:
        find_heading(sheets[0], layout)
    for sheet in without:
        notes.add(sheet.place, "left out", "the sheet", "it holds no table", "--sheets")
    for sheet, heading in found:
        yield (replace(sheet, only=True) if len(found) == 1 else sheet), heading


def _note_machine(campaign: Mapping[str, Any], tests: Sequence[CircularTest], notes: Notes) -> None:
    """What the model needs to know of the machine and no table says."""
    for key, value, option in (
        ("topology", "wCAFYXZSt", "--topology"),
        ("plane", "XY", "--plane"),
        ("radius_mm", "150 mm", "--radius-mm"),
        ("resolution_um", "0.24 µm", "--resolution-um"),
        ("mount", "readings compensated for its deflection", "--raw"),
    ):
        if key not in campaign and not (key == "radius_mm" and all(test.radius_mm for test in tests)):
            notes.add("", key, value, "nothing says otherwise", option)
    if any(test.force_N is None for test in tests) and "force_law" not in campaign:
        notes.add("", "force", "126.04 N/bar × pressure − 14.2 N", "pressure alone is given", "--force-slope, --force-offset")
