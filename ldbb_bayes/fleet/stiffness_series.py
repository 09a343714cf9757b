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
_PLANE = re.compile(r"_(?:XY|YZ|ZX)$")
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
    sd: float | None  #: standard uncertainty u of the stiffness, in the unit that ``unit`` names
    #: expanded uncertainty U = 2 u of the stiffness, in the unit that ``unit`` names
    U_k2: float | None
    #: lower and upper end of the equal-tailed credible interval of the stiffness, in the unit that
    #: ``unit`` names
    interval: tuple[float | None, float | None]

    @property
    def text(self) -> str:
        """Stiffness as text: value ± U with the unit, a lower limit, or "not determined"."""
        low, high = self.interval
        if self.mean is not None and self.sd is not None and low is not None and high is not None:
            return plus_minus(self.mean, self.sd, (low, high), self.unit).rstrip()
        if low is None:
            return _NOT_DETERMINED
        if not self.unit:
            return f"at least {low:.3g}"
        return f"at least {low * 1e-3:.3g} N/µm"


def stiffness_series(
    rows: pd.DataFrame, campaigns: Sequence[str]
) -> dict[str, tuple[StiffnessOfVisit, ...]]:
    """Return the machine's stiffness by direction, computed from each campaign alone.

    The result is a dict. Its keys are the names of quantities, such as ``k_min``. Quantities of a
    plane that no campaign tested are left out. Each value is a
    tuple with the results for this quantity from all campaigns, in the order of the rows.

    Parameters
    ----------
    rows
        Rows of a batch's table in the order of time. If the table has no stiffnesses by direction,
        the dict is empty.
    campaigns
        Labels of the campaigns, one for each row.
    """
    names: dict[str, None] = {}
    for column in rows.columns:
        name, _, number = str(column).rpartition(".")
        if number == "mean" and STIFFNESS_NAME.fullmatch(name) and _is_tested(name, rows):
            names[name] = None
    series = {}
    for name in names:
        visits = []
        for campaign, (_, row) in zip(campaigns, rows.iterrows(), strict=True):
            visits.append(_stiffness_of_visit(name, campaign, row))
        series[name] = tuple(visits)
    return series


def _is_tested(name: str, rows: pd.DataFrame) -> bool:
    """Return whether at least one campaign tested the plane of a quantity.

    ``rows`` are rows of the table of a batch, which has a column for every quantity that any of its
    campaigns has. A difference of compliances always has a value. Of stiffnesses and directions in
    a plane, at least one stiffness has a lower limit.
    """
    if "_minus_" in name:
        return bool(rows[f"{name}.mean"].notna().any())
    plane = _PLANE.search(name)
    suffix = plane[0] if plane else ""
    limits = [f"{stiffness}{suffix}.ci_low" for stiffness in ("k_min", "k_max", "k_ratio")]
    known = [column for column in limits if column in rows.columns]
    return bool(rows[known].notna().any(axis=None))


def _stiffness_of_visit(name: str, campaign: str, row: pd.Series) -> StiffnessOfVisit:
    """Return the stiffness with the given name, computed from one campaign alone.

    ``row`` is the campaign's row in the table of a batch, and ``campaign`` is its label. If the
    name is ``k_min``, for example, the stiffness is in the columns ``k_min.mean``, ``k_min.sd`` and
    so on.
    """
    sd = _number_or_none(row[f"{name}.sd"])
    return StiffnessOfVisit(
        campaign=campaign,
        force_N=float(row["reference_force_N"]),
        unit=_unit_of(name),
        mean=_number_or_none(row[f"{name}.mean"]),
        sd=sd,
        U_k2=None if sd is None else 2.0 * sd,
        interval=(_number_or_none(row[f"{name}.ci_low"]), _number_or_none(row[f"{name}.ci_high"])),
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


def stiffness_table(series: Mapping[str, Sequence[StiffnessOfVisit]]) -> Table:
    """Return a table of the stiffness by direction in the first and in the newest campaign.

    The heads of the columns state the reference forces of the two campaigns.
    """
    first_visits = next(iter(series.values()))
    first = f"first, at {first_visits[0].force_N:g} N"
    newest = f"newest, at {first_visits[-1].force_N:g} N"
    rows = []
    heads = ("quantity", first, newest)
    for name, visits in series.items():
        rows.append((name.replace("_minus_", " − "), visits[0].text, visits[-1].text))
    return Table.of("Stiffness by direction, each campaign alone", heads, rows, text=heads[1:])
