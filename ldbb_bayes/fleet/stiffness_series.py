"""Stiffness of one machine in several directions, as it changes over time.

The stiffness at each time is computed only from the campaign run at that time. The stiffnesses are
taken from a batch's table. No model of step changes is fitted to the stiffnesses, because
`change_point` already models step changes of the compliances from which the stiffnesses are
computed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import pandas as pd

from ldbb_bayes.fleet.dataset import STIFFNESS_NAME
from ldbb_bayes.results import Result, Table
from ldbb_bayes.units import plus_minus

__all__ = ["StiffnessOfVisit", "stiffness_series", "stiffness_table"]

# Plane at the end of the name of a quantity, such as k_min_YZ.
_PLANE = re.compile(r"_(XY|YZ|ZX)$")
# Names of the principal stiffnesses of a machine that was tested in three planes.
_PRINCIPAL = ("k_1", "k_2", "k_3")
# Probability of the intervals in batches that do not state it, because they were written before
# batches had a column for it: the default of such a batch.
_UNSTATED_PROBABILITY = 0.95
# Names that people read, as on the sheets, of quantities whose names in files are others.
_SHOWN_NAMES = {
    "k_ratio": "k_max / k_min",
    "softest_direction": "softest direction",
    "stiffest_direction": "stiffest direction",
    "principal_axis": "softer principal axis ψ",
}
# Text of a table cell for a quantity that the readings do not determine.
_NOT_DETERMINED = "not determined"


@dataclass(frozen=True)
class StiffnessOfVisit(Result):
    """Stiffness or a related quantity, computed from the readings of one campaign alone.

    The quantity is the stiffness in one direction, a ratio of stiffnesses, a direction, or a
    difference of compliances. It is given at the reference force of the campaign. If the readings
    do not determine the quantity, its mean, its uncertainties and the ends of its interval are
    None. There is one exception: for a stiffness or a ratio of stiffnesses, the lower end of the
    interval is then a lower limit of the quantity.
    """

    campaign: str  #: label of the campaign from which the stiffness is computed
    force_N: float  #: reference force of the campaign, for which the stiffness is given [N]
    unit: str  #: unit of the stiffness, ratio or direction: N/mm, mm/N, deg, or empty for a ratio
    mean: float | None  #: posterior mean of the stiffness, in the unit that ``unit`` names
    #: posterior median of the stiffness, in the unit that ``unit`` names. As on sheets, it is the
    #: value that is printed of a stiffness or of a ratio of stiffnesses.
    median: float | None
    sd: float | None  #: standard uncertainty u of the stiffness, in the unit that ``unit`` names
    #: expanded uncertainty U = 2 u of the stiffness, in the unit that ``unit`` names
    U_k2: float | None
    #: lower and upper end of the equal-tailed credible interval of the stiffness, in the unit that
    #: ``unit`` names
    interval: tuple[float | None, float | None]
    #: probability of the interval of the stiffness. It is that of the batch, and not that of the
    #: trend.
    prob: float

    @property
    def text(self) -> str:
        """Stiffness as text: value ± U with the unit, a lower limit, or "not determined"."""
        low, high = self.interval
        value = self.mean
        if self.unit in ("N/mm", ""):
            value = self.median
        if value is not None and self.sd is not None and low is not None and high is not None:
            return plus_minus(value, self.sd, (low, high), self.unit).rstrip()
        if low is None:
            return _NOT_DETERMINED
        if not self.unit:
            return f"at least {low:.3g}"
        return f"at least {low * 1e-3:.3g} N/µm"


def stiffness_series(
    rows: pd.DataFrame, campaigns: Sequence[str]
) -> dict[str, tuple[StiffnessOfVisit, ...]]:
    """Return the machine's stiffness by direction, computed from each campaign alone.

    The result is a dict. Its keys are the names of quantities, such as ``k_min``. If the campaigns
    were not all run in one and the same plane, the names end with the plane, as in ``k_min_YZ``.
    Quantities of a plane that no campaign tested are left out. Each value is a tuple with the
    results for this quantity from all campaigns, in the order of the rows. A campaign that did not
    test the plane of the quantity has a result without numbers.

    Parameters
    ----------
    rows
        Rows of a batch's table in the order of time. If the table has no stiffnesses by direction,
        the dict is empty.
    campaigns
        Labels of the campaigns, one for each row.
    """
    is_one_plane = rows["planes"].nunique() == 1 and len(_planes_of(rows.iloc[0])) == 1
    columns_of_rows = []
    for _, row in rows.iterrows():
        columns_of_rows.append(_columns_by_quantity(row, name_planes=not is_one_plane))
    names: dict[str, None] = {}
    for columns in columns_of_rows:
        names |= dict.fromkeys(columns)
    series = {}
    for name in names:
        visits = []
        for campaign, (_, row), columns in zip(
            campaigns, rows.iterrows(), columns_of_rows, strict=True
        ):
            visits.append(_stiffness_of_visit(columns.get(name), name, campaign, row))
        series[name] = tuple(visits)
    return series


def _planes_of(row: pd.Series) -> list[str]:
    """Return the planes that the campaign of a row of a batch's table tested."""
    return str(row["planes"]).split(",")


def _columns_by_quantity(row: pd.Series, *, name_planes: bool) -> dict[str, str]:
    """Return the beginnings of the columns that hold the stiffness quantities of one campaign.

    ``row`` is the campaign's row in the table of a batch, which has columns for the quantities of
    all its campaigns. The keys of the result are the names of the quantities. If ``name_planes`` is
    true, names of quantities of a plane end with the plane. The columns of a campaign of one plane
    do not name it.
    """
    planes = _planes_of(row)
    columns = {}
    for label in row.index:
        column, _, number = str(label).rpartition(".")
        if number != "mean" or not STIFFNESS_NAME.fullmatch(column):
            continue
        is_always_known = "_minus_" in column or column in _PRINCIPAL
        if is_always_known and pd.isna(row[label]):
            continue  # It belongs to campaigns of other planes.
        quantity = _quantity_in(column, planes, name_planes=name_planes)
        if quantity is not None:
            columns[quantity] = column
    return columns


def _quantity_in(column: str, planes: Sequence[str], *, name_planes: bool) -> str | None:
    """Return the name of the quantity that columns of a batch's table hold for a campaign.

    ``column`` is the beginning of the columns' names, such as ``k_min``, and ``planes`` are the
    planes that the campaign tested. The result is None if the quantity is of another plane.
    ``name_planes`` has the same meaning as in `_columns_by_quantity`.
    """
    if column in _PRINCIPAL:
        return column
    plane_of_column = _PLANE.search(column)
    if len(planes) > 1:
        is_tested = plane_of_column is not None and plane_of_column[1] in planes
        return column if is_tested else None
    if plane_of_column is not None:
        return None
    return f"{column}_{planes[0]}" if name_planes else column


def _stiffness_of_visit(
    column: str | None, name: str, campaign: str, row: pd.Series
) -> StiffnessOfVisit:
    """Return the stiffness with the given name, computed from one campaign alone.

    ``row`` is the campaign's row in the table of a batch, and ``campaign`` is its label. If the
    ``column`` is ``k_min``, for example, the stiffness is in the columns ``k_min.mean``,
    ``k_min.sd`` and so on. If it is None, the campaign did not test the plane of the quantity.
    """
    numbers: dict[str, float | None] = {}
    for number in ("mean", "median", "sd", "ci_low", "ci_high"):
        numbers[number] = None
        if column is not None:
            numbers[number] = _number_or_none(row[f"{column}.{number}"])
    sd = numbers["sd"]
    return StiffnessOfVisit(
        campaign=campaign,
        force_N=float(row["reference_force_N"]),
        unit=_unit_of(name),
        mean=numbers["mean"],
        median=numbers["median"],
        sd=sd,
        U_k2=None if sd is None else 2.0 * sd,
        interval=(numbers["ci_low"], numbers["ci_high"]),
        prob=_number_or_none(row.get("prob")) or _UNSTATED_PROBABILITY,
    )


def _number_or_none(value: float | None) -> float | None:
    """Return the number in a cell of a table; None if the cell is empty."""
    return None if pd.isna(value) else float(value)


def _unit_of(name: str) -> str:
    """Return the unit of a stiffness, ratio of stiffnesses, direction or difference of compliances.

    ``name`` is the name of the quantity, such as ``k_min``. The unit of a ratio is an empty text.
    """
    if name.startswith("k_ratio"):
        return ""
    if name.startswith("k_"):
        return "N/mm"
    if "_minus_" in name:
        return "mm/N"
    return "deg"


def _shown_name(name: str) -> str:
    """Return the name that people read of a quantity, with the plane in brackets if it has one.

    ``name`` is the name of the quantity in files, such as ``k_ratio_YZ``.
    """
    plane = _PLANE.search(name)
    quantity = name if plane is None else name[: plane.start()]
    shown = _SHOWN_NAMES.get(quantity, quantity.replace("_minus_", " − "))
    return shown if plane is None else f"{shown} ({plane[1]})"


def stiffness_table(series: Mapping[str, Sequence[StiffnessOfVisit]]) -> Table:
    """Return a table of the stiffness by direction in the first and in the newest campaign.

    The heads of the columns state the reference forces of the two campaigns. The caption states the
    probability of the intervals. The quantities have the names that the sheets have for them.
    """
    first_visits = next(iter(series.values()))
    first = f"first, at {first_visits[0].force_N:g} N"
    newest = f"newest, at {first_visits[-1].force_N:g} N"
    probabilities = sorted({visit.prob for visit in (first_visits[0], first_visits[-1])})
    percent = " and ".join(f"{100.0 * prob:g} %" for prob in probabilities)
    rows = []
    heads = ("quantity", first, newest)
    for name, visits in series.items():
        rows.append((_shown_name(name), visits[0].text, visits[-1].text))
    caption = (
        f"Stiffness by direction, each campaign alone, {percent} intervals of its batch; angles are"
        " from the plane's first axis"
    )
    return Table.of(caption, heads, rows, text=heads[1:])
