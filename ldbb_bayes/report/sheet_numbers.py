"""Quantities that the sheets of the certificate state, with remarks on how far each is determined.

Compliances and circular deviations are stated at one force. A quantity is confounded with a partner
if the partner (another parameter or effect) changes the readings in the same way.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ldbb_bayes.analysis.circularity import predict_circularity
from ldbb_bayes.analysis.compliance_change import change_with_force
from ldbb_bayes.analysis.conformity import draws_at
from ldbb_bayes.analysis.usability import is_determined
from ldbb_bayes.inference.posterior import bound_of
from ldbb_bayes.inference.summary import interval_numbers
from ldbb_bayes.model.setting import geometric_errors_of
from ldbb_bayes.model.terms import BarLength
from ldbb_bayes.report.findings import Findings
from ldbb_bayes.report.translation import Words
from ldbb_bayes.units import (
    display_name,
    display_unit,
    is_skewed,
    is_slope,
    state,
    three_digits,
    value_and_uncertainty,
)

if TYPE_CHECKING:
    from ldbb_bayes.analysis.compliance_change import ChangeWithForce
    from ldbb_bayes.analysis.verdicts import ChangeIdentifiability, ParameterIdentifiability
    from ldbb_bayes.model.hybrid import BoundModel

__all__ = ["SheetNumbers", "StatedQuantity", "ValueAndU", "remark"]

# A compliance is said to increase or to decrease with force if the probability of that is at least
# this.
_SURE = 0.95
_MOST_NAMES = 2  # largest number of effects that a remark names as confounded with a quantity
# If the credible interval of a compliance begins below this share of its median, only a limit of
# the stiffness 1 / C is stated.
_HARDLY_POSITIVE = 0.2
_ROTATED_AXIS = str.maketrans("ABC", "XYZ")  # linear axis about which each rotation A, B, C turns
_SHEET_1_KINDS = (
    "cross",
    "rotation_for_force",
    "rotation_for_moment",
    "rotation_for_other_moment",
    "squareness",
)


@dataclass(frozen=True)
class ValueAndU:
    """A value and its expanded uncertainty (k = 2), rounded to the same decimal place."""

    value: str
    expanded: str


@dataclass(frozen=True)
class StatedQuantity:
    """One quantity that the sheets of the certificate state.

    Parameters
    ----------
    words
        Name of the quantity in words.
    symbol
        Symbol of the quantity.
    estimate, sd, interval
        Estimate, standard uncertainty and credible interval, in ``unit``. The estimate is the mean
        of a parameter, the inverse of a compliance's median for a stiffness, and the median of a
        circular deviation.
    unit
        Unit of these numbers: that of a parameter or stiffness in mm, N and rad, and um for a
        circular deviation.
    entry
        Verdict on how far the readings determine the quantity. For a stiffness it is the verdict on
        the compliance. None for a quantity that is computed from several parameters.
    limit
        If only a limit of the quantity is stated, the limit in words; otherwise empty.
    hangs_on
        For a quantity that is computed from several parameters: effects that these parameters are
        confounded with.
    direction
        For the change of a compliance with force: whether it is an increase or a decrease, as the
        key of a remark; otherwise empty.
    change_entry
        For the change of a compliance with force: the verdict on it.
    no_change
        For the change of a compliance with force: probability that there is exactly none, which is
        zero unless the numbers are averaged over models.
    """

    words: str
    symbol: str
    estimate: float
    sd: float
    interval: tuple[float, float]
    unit: str
    entry: ParameterIdentifiability | None = None
    limit: str = ""
    hangs_on: tuple[str, ...] = ()
    direction: Literal["", "increases", "decreases", "no_change"] = ""
    change_entry: ChangeIdentifiability | None = None
    no_change: float = 0.0

    def value_and_U(self) -> ValueAndU:
        """Return value and expanded uncertainty (k = 2), in the unit shown on the sheets."""
        if self.limit:
            return ValueAndU(self.limit, "–")
        if is_skewed(self.estimate, self.interval):
            statement = state(self.estimate, self.sd, self.interval, self.unit)
            return ValueAndU(statement.value, statement.expanded)
        factor, _ = display_unit(self.unit)
        value, expanded = value_and_uncertainty(self.estimate * factor, 2.0 * self.sd * factor)
        return ValueAndU(value.replace("-", "−"), expanded)

    @property
    def is_undetermined(self) -> bool:
        """Whether the readings leave the quantity undetermined; False without a verdict."""
        return self.entry is not None and not is_determined(self.entry)

    @property
    def inseparable_partners(self) -> tuple[str, ...]:
        """Names of the assumed effects that an undetermined quantity is confounded with.

        There are none if the readings determine the quantity, or if it is not confounded.
        """
        if self.entry is None or not self.is_undetermined:
            return ()
        return self.entry.partners


@dataclass(frozen=True, eq=False)
class SheetNumbers:
    """All quantities that the sheets of the certificate state.

    Parameters
    ----------
    findings
        All results of the fit that the report shows.
    words
        Texts of the sheets in their language.
    force_N
        Force at which compliances and circular deviations are stated [N].
    """

    findings: Findings
    words: Words
    force_N: float

    @cached_property
    def parameters(self) -> dict[str, StatedQuantity]:
        """Compliances at the force ``force_N``, and geometric errors, by name.

        Offsets of the tool ball are not stated, and slopes are not: see `changes`.
        """
        return {name: stated for name, stated in self._stated.items() if not is_slope(name)}

    @cached_property
    def slopes(self) -> dict[str, StatedQuantity]:
        """Coefficients of the change of compliances with force, by name, for their tolerances."""
        return {name: stated for name, stated in self._stated.items() if is_slope(name)}

    @cached_property
    def changes(self) -> dict[str, StatedQuantity]:
        """Change of each compliance C(F) from the smallest force tested to the largest, by name."""
        stated = {}
        changes = change_with_force(self.findings.numbers, prob=self.findings.prob)
        for name, change in changes.items():
            stated[name] = StatedQuantity(
                words=self.words(
                    "quantities.change",
                    symbol=display_name(name),
                    low=self.words.number(f"{change.smallest_force_N:.4g}"),
                    high=self.words.number(f"{change.largest_force_N:.4g}"),
                ),
                symbol=f"Δ{display_name(name)}",
                estimate=change.change.mean,
                sd=change.change.sd,
                interval=change.change.interval,
                unit=change.unit,
                direction=_direction_of(change),
                change_entry=self.findings.change_verdicts.get(name),
                no_change=change.probability_of_no_change,
            )
        return stated

    @cached_property
    def _stated(self) -> dict[str, StatedQuantity]:
        """Compliances, slopes and geometric errors but for offsets of the tool ball, by name."""
        bound = bound_of(self.findings.numbers)
        names = _names_by_label(bound)
        stated = {}
        for parameter in bound.parameters:
            name = names[parameter.compliance]
            if name.kind == "offset":
                continue
            summary = self._summaries[parameter.name]
            stated[parameter.name] = StatedQuantity(
                words=self._quantity_words(name, parameter.degree),
                symbol=display_name(parameter.name),
                estimate=summary["mean"],
                sd=summary["sd"],
                interval=(summary["ci_low"], summary["ci_high"]),
                unit=parameter.unit,
                entry=self.findings.verdicts.get(parameter.name),
            )
        return stated

    @cached_property
    def _draws(self) -> Mapping[str, Any]:
        """Random draws of each parameter from the posterior, in internal units (mm, N, rad).

        Compliances are those at the force ``force_N``.
        """
        return draws_at(self.findings.numbers, self.force_N)

    @cached_property
    def _summaries(self) -> dict[str, Mapping[str, float]]:
        """Mean, sd, median and interval of each parameter's random draws, by parameter."""
        prob = self.findings.prob
        return {name: interval_numbers(draws, prob) for name, draws in self._draws.items()}

    def _quantity_words(self, name: Any, degree: int) -> str:
        """Return the name of a parameter in words, in the language of the sheets.

        ``name`` is a compliance or geometric error, split into its parts. ``degree`` is 0 for the
        parameter itself, 1 for the slope and 2 for the curvature of a compliance in force.
        """
        key = str(name.kind)
        if degree == 1:
            key = "slope"
        elif degree > 1:
            key = "curvature"
        twist = str(getattr(name, "twist", ""))
        wrench = str(getattr(name, "wrench", ""))
        return self.words(
            f"quantities.{key}",
            axis=str(getattr(name, "axis", "") or getattr(name, "joint", "")),
            component=str(getattr(name, "component", "")),
            reference=str(getattr(name, "reference", "")),
            moved=twist.translate(_ROTATED_AXIS),
            load=wrench.translate(_ROTATED_AXIS),
            symbol=display_name(name.label),
        )

    @cached_property
    def stiffnesses(self) -> dict[str, StatedQuantity]:
        """Stiffness of every axis: 1 / C at the median of its direct compliance C.

        Keys are the labels of C, such as ``C_XXX``. If the credible interval of C begins below a
        fifth of its median, only a lower limit of the stiffness is stated.
        """
        stated = {}
        for compliance in bound_of(self.findings.numbers).compliances:
            if compliance.kind == "direct":
                stated[compliance.label] = self._stiffness(compliance)
        return stated

    def _stiffness(self, compliance: Any) -> StatedQuantity:
        """Return the stiffness 1/C of a direct compliance C.

        The stiffness has a value and an uncertainty if the credible interval of C begins above a
        fifth of the median. Otherwise it has a lower limit: the stiffness at the upper end of the
        interval. If this end is not positive, no stiffness is stated.
        """
        summary = self._summaries[compliance.label]
        median = summary["median"]
        low = summary["ci_low"]
        high = summary["ci_high"]
        smallest = _HARDLY_POSITIVE * median
        limit = ""
        sd = np.nan
        if low > smallest > 0.0:
            # Raise the few draws of the compliance C that are near zero: they would dominate the
            # standard deviation of 1 / C.
            draws = np.maximum(self._draws[compliance.label], 0.5 * smallest)
            sd = float(np.std(1.0 / draws))
        elif high > 0.0:
            limit = self.words("quantities.at_least", value=three_digits(1e-3 / high))
        else:
            limit = "–"
        return StatedQuantity(
            words=self.words("quantities.stiffness", axis=compliance.joint),
            symbol=f"1 / {compliance.label}",
            estimate=1.0 / median,
            sd=sd,
            interval=(1.0 / high, 1.0 / low),
            unit="N/mm",
            entry=self.findings.verdicts.get(compliance.label),
            limit=limit,
        )

    @cached_property
    def further(self) -> dict[str, StatedQuantity]:
        """Quantities of sheet 1 other than stiffnesses and circular deviations, by label.

        The quantities are cross compliances, rotations caused by forces or moments, and squareness
        errors.
        """
        names = _names_by_label(bound_of(self.findings.numbers))
        stated = {}
        for label, quantity in self.parameters.items():
            if label in names and names[label].kind in _SHEET_1_KINDS:
                stated[label] = quantity
        return stated

    @cached_property
    def path(self) -> dict[str, StatedQuantity]:
        """Circular deviations G, F_max and F_min of the tool path in every plane, by symbol.

        The deviations are those at the force ``force_N`` of the bar [N]. Effects that the geometric
        errors are confounded with change these deviations, too.
        """
        prob = self.findings.prob
        table = predict_circularity(self.findings.numbers, [self.force_N], prob=prob)
        has_several_planes = table["plane"].nunique() > 1
        hangs_on = self._partners_of_geometry()
        stated = {}
        for row in table[table["quantity"].isin(["G", "F_max", "F_min"])].to_dict(orient="records"):
            symbol = row["quantity"]
            where = ""
            if has_several_planes:
                symbol = f"{row['quantity']}_{row['plane']}"
                where = self.words("quantities.plane", plane=row["plane"])
            stated[symbol] = StatedQuantity(
                words=self.words(f"quantities.{row['quantity']}", plane=where),
                symbol=row["quantity"],
                estimate=row["median"],
                sd=row["sd"],
                interval=(row["ci_low"], row["ci_high"]),
                unit="um",
                hangs_on=hangs_on,
            )
        return stated

    def _partners_of_geometry(self) -> tuple[str, ...]:
        """Return the names of effects confounded with undetermined geometric errors."""
        partners: dict[str, None] = {}
        for name, quantity in self.parameters.items():
            if name.startswith("E_") and quantity.is_undetermined:
                partners |= dict.fromkeys(quantity.inseparable_partners)
        # Leave out the error of the bar's length, which makes the circle larger but not less round.
        partners.pop(BarLength.__name__, None)
        return tuple(partners)


def _direction_of(change: ChangeWithForce) -> Literal["increases", "decreases", "no_change"]:
    if change.probability_of_increase >= _SURE:
        return "increases"
    if change.probability_of_decrease >= _SURE:
        return "decreases"
    return "no_change"


def _names_by_label(bound: BoundModel) -> dict[str, Any]:
    """Return the names of compliances and geometric errors as objects, by label such as ``C_XXX``.

    An object has the parts of the name, such as the axis, as attributes.
    """
    names: list[Any] = [*bound.compliances, *geometric_errors_of(bound.campaign)]
    return {name.label: name for name in names}


def remark(quantity: StatedQuantity, words: Words) -> str:
    """Return a remark in a few words on how far the readings determine a quantity.

    Parameters
    ----------
    quantity
        Quantity that a sheet states.
    words
        Texts of the sheet in its language.

    Returns
    -------
    str
        The remark, in the language of the sheet; empty if none is needed.
    """
    if quantity.direction:
        return _change_remark(quantity, words)
    if quantity.entry is None:
        if not quantity.hangs_on:
            return ""
        return words("remarks.confounded", partners=_partner_words(quantity.hangs_on, words))
    return _verdict_remark(quantity.entry, words)


def _change_remark(quantity: StatedQuantity, words: Words) -> str:
    """Return a remark on a change with force: its direction, and the verdict on it."""
    direction = words(f"remarks.{quantity.direction}")
    if quantity.direction == "no_change" and quantity.no_change > 0.0:
        probability = words.percent(quantity.no_change)
        direction = words("remarks.exactly_none", probability=probability)
    if quantity.change_entry is None:
        return direction
    return f"{direction}; {_verdict_remark(quantity.change_entry, words)}"


def _verdict_remark(entry: ParameterIdentifiability | ChangeIdentifiability, words: Words) -> str:
    """Return the verdict on a parameter, or on a change with force, in a few words."""
    if entry.verdict == "confounded":
        return words(
            "remarks.confounded", partners=_partner_words(tuple(entry.partner_shares), words)
        )
    if entry.verdict == "prior-limited":
        return words("remarks.prior")
    return words(
        "remarks.identified",
        source=words.term(entry.held_by.name),
        share=words.percent(entry.held_by.share),
        origin=words(f"origins.{entry.held_by.origin}"),
    )


def _partner_words(names: Any, words: Words) -> str:
    return words.joined([words.term(name) for name in names[:_MOST_NAMES]])
