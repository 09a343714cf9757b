"""A machine as circular tests see it, as tables and sentences."""

from __future__ import annotations

from rich.table import Table

from ldbb_bayes.analysis.machine import DescribedMachine, Seen, sum_in_words
from ldbb_bayes.units import display_name, display_unit

__all__ = ["machine_lines", "machine_tables"]


def machine_tables(found: DescribedMachine) -> tuple[Table, Table]:
    """Compliances and geometric errors: name, unit, pattern in every plane, what it is, what it stands for."""
    return (
        _table("compliance", found.compliances, found.planes, sums=True),
        _table("geometric error", found.geometric_errors, found.planes, sums=False),
    )


def machine_lines(found: DescribedMachine) -> list[str]:
    """Joints, rank, and what does not show."""
    said = [
        f"{found.topology}, plane{'s' if len(found.planes) > 1 else ''} {', '.join(found.planes)}. {'; '.join(found.joints)}.",
        "Patterns: change of the reading per unit, of a compliance per unit and N; c = cos θ, s = sin θ, lengths in mm.",
        "Rotary joints, and slides that no plane here drives, count as rigid.",
        *_centres(found),
        f"{found.rank} compliances can be told apart; condition number of their columns {found.condition_number:.6g} "
        "(mm, N, R = 150 mm).",
    ]
    if found.null:
        said.append(f"Never seen: {', '.join(found.null)}.")
    bounded = [display_name(entry.name) for entry in found.compliances if entry.not_negative]
    said.append(f"Cannot be negative: {', '.join(bounded) or 'none'}.")
    if found.dependent:
        said.append(
            f"Combinations of several of those above, left out: {', '.join(found.dependent)}. What they are goes into the others."
        )
    return said


def _centres(found: DescribedMachine) -> list[str]:
    if not any(any(centre) for centre in found.centres_mm):
        return []
    listed = "; ".join(f"({', '.join(f'{x:g}' for x in centre)})" for centre in found.centres_mm)
    first = " Patterns are those at the first; what can be told apart is of all together." if len(found.centres_mm) > 1 else ""
    return [f"Circles centred at {listed} mm.{first}"]


def _table(title: str, entries: tuple[Seen, ...], planes: tuple[str, ...], *, sums: bool) -> Table:
    table = Table(box=None, pad_edge=False)
    table.add_column(title, no_wrap=True)
    table.add_column("unit", no_wrap=True)
    for plane in planes:
        table.add_column("pattern" if len(planes) == 1 else f"pattern in {plane}")
    table.add_column("what it is")
    if sums:
        table.add_column("stands for")
    for entry in entries:
        last = [sum_in_words(entry)] if sums else []
        patterns = [entry.pattern.get(plane, "·") for plane in planes]
        table.add_row(display_name(entry.name), display_unit(entry.unit)[1], *patterns, entry.meaning, *last)
    return table
