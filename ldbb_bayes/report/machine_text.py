"""Tables and sentences on the parameters of a machine that circular tests can determine."""

from __future__ import annotations

from ldbb_bayes.analysis.machine_description import DescribedMachine, VisibleParameter
from ldbb_bayes.report import wording
from ldbb_bayes.results import Passage, Table, parts_of
from ldbb_bayes.units import display_name, display_unit

__all__ = ["parts_of"]


@parts_of.register
def _passages_of_described_machine(machine: DescribedMachine) -> tuple[Passage, ...]:
    """Return sentences on a machine, and tables of its compliances and geometric errors."""
    first, *notes = wording.machine_sentences(machine)
    compliances = _machine_table(machine, "compliance", machine.compliances, with_sums=True)
    errors = _machine_table(machine, "geometric error", machine.geometric_errors, with_sums=False)
    return (first, compliances, errors, *notes)


def _machine_table(
    machine: DescribedMachine,
    title: str,
    entries: tuple[VisibleParameter, ...],
    *,
    with_sums: bool,
) -> Table:
    """Return a table of parameters of a machine, with one row for each of ``entries``.

    The columns are the name of the parameter, its unit, its pattern in each of the machine's
    planes, and its meaning. The pattern is the parameter's effect on the readings. Some parameters
    stand for a sum of several parameters. If ``with_sums`` is true, one more column states this
    sum. ``title`` is the heading of the first column.
    """
    heads = [title, "unit", "pattern", "what it is"]
    if len(machine.planes) > 1:
        heads[2:3] = [f"pattern in {plane}" for plane in machine.planes]
    if with_sums:
        heads.append("stands for")
    rows = []
    for entry in entries:
        cells = [display_name(entry.name), display_unit(entry.unit)[1]]
        cells += [entry.pattern.get(plane, "·") for plane in machine.planes]
        cells.append(entry.meaning)
        if with_sums:
            cells.append(wording.sum_in_words(entry))
        rows.append(tuple(cells))
    return Table.of("", tuple(heads), rows, text=tuple(heads))
