"""Tables of the changes of compliances with force.

A table has either one row for each compliance, or several rows for one compliance.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from ldbb_bayes.report import wording
from ldbb_bayes.results import Passage, Table
from ldbb_bayes.units import Statement, display_name, display_unit, state, value_and_uncertainty

__all__ = ["ResultCells", "change_cells", "change_parts", "change_table", "statement_cells"]


def change_table(changes: Mapping[str, Mapping[str, Any]]) -> Table:
    """Return a table of the changes of compliances over the tested forces.

    The table has one row for each compliance.

    Parameters
    ----------
    changes
        Mapping from the names of the compliances to their changes. Each change is a dictionary, as
        `change_with_force` describes it.

    Returns
    -------
    Table
    """
    rows = []
    caption = wording.PAGE["change"]
    percent = "95 %"
    for name, change in changes.items():
        factor, _ = display_unit(change["unit"])
        by_force = []
        for key in ("at_smallest", "at_largest"):
            value = change[key]
            by_force.append(value_and_uncertainty(value["mean"] * factor, value["sd"] * factor)[0])
        cells = change_cells(change)
        rows.append(
            (
                display_name(name),
                *by_force,
                cells.value,
                cells.u,
                cells.interval,
                cells.unit,
                _relative_change_cell(change["relative"]),
                wording.direction_words(change),
            )
        )
        percent = f"{100 * change['prob']:g} %"
        smallest = change["smallest_force_N"]
        largest = change["largest_force_N"]
        caption = f"{wording.PAGE['change']} from {smallest:.4g} N to {largest:.4g} N"
    heads = (
        "compliance",
        "C(F_min)",
        "C(F_max)",
        "change",
        "u",
        f"{percent} interval",
        "unit",
        "relative change",
        "direction",
    )
    return Table.of(caption, heads, rows, text=("unit", "direction"))


def change_parts(change: Mapping[str, Any]) -> tuple[Passage, ...]:
    """Return a table and a sentence on the change of one compliance with force.

    The table has the compliance at the smallest force tested, at the reference force and at the
    largest force tested, and the change over the tested forces. The sentence states whether the
    compliance increases or decreases.

    Parameters
    ----------
    change
        Change of the compliance as a dictionary; see `change_with_force`.

    Returns
    -------
    tuple
        The table and the sentence.
    """
    rows = []
    for key in ("smallest", "reference", "largest"):
        label = f"C({change[f'{key}_force_N']:.4g} N)"
        rows.append(_value_row(label, change[f"at_{key}"], change["unit"]))
    cells = change_cells(change)
    rows.append(("change", cells.value, cells.u, cells.interval, cells.unit))
    relative = change["relative"]
    if relative is not None and wording.is_exactly_none(change):
        rows.append(("change / C(F0)", "0", "–", "–", "%"))
    elif relative is not None:
        in_percent = {key: 100.0 * value for key, value in relative.items()}
        rows.append((*_value_row("change / C(F0)", in_percent, "")[:-1], "%"))
    heads = ("quantity", "value", "u", f"{100 * change['prob']:g} % interval", "unit")
    table = Table.of(wording.PAGE["change"], heads, rows, text=("unit",))
    return (table, f"Direction: {wording.direction_words(change)}.")


def _value_row(label: str, value: Mapping[str, float], unit: str) -> tuple[str, ...]:
    """Return the cells of a row: label, value, standard uncertainty, credible interval and unit.

    ``value`` holds the entries ``mean``, ``sd``, ``ci_low`` and ``ci_high``, in the internal unit
    ``unit`` (mm, N, rad).
    """
    statement = state(value["mean"], value["sd"], (value["ci_low"], value["ci_high"]), unit)
    return (label, statement.value, statement.u, statement.interval, statement.unit)


class ResultCells(NamedTuple):
    """Five cells of a row in a table of results: value, u, U (k = 2), credible interval, unit."""

    value: str
    u: str
    expanded: str
    interval: str
    unit: str


def change_cells(change: Mapping[str, Any]) -> ResultCells:
    """Return the change of a compliance as texts.

    A change that is almost certainly zero has no uncertainty to state.
    ``change`` is the JSON record of the change over the tested forces, see `change_with_force`.
    """
    if wording.is_exactly_none(change):
        return ResultCells("0", "–", "–", "–", display_unit(change["unit"])[1])
    value = change["change"]
    interval = (value["ci_low"], value["ci_high"])
    return statement_cells(state(value["mean"], value["sd"], interval, change["unit"]))


def _relative_change_cell(relative: Mapping[str, float] | None) -> str:
    """Return the relative change of a compliance as a string in per cent.

    ``relative`` is a dictionary with the median of the relative change. A dash is returned if
    ``relative`` is None.
    """
    if relative is None:
        return "–"
    return f"{100.0 * relative['median']:.0f} %"


def statement_cells(statement: Statement) -> ResultCells:
    """Return five cells of a parameter's row in a table of results, as texts."""
    return ResultCells(
        statement.value,
        statement.u,
        statement.expanded,
        statement.interval,
        statement.unit,
    )
