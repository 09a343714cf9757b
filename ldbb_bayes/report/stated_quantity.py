"""One quantity that the sheets of the test certificate state, with its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from ldbb_bayes.report.wording.number_words import SURE
from ldbb_bayes.units import display_unit, needs_interval, state, value_and_uncertainty

if TYPE_CHECKING:
    from ldbb_bayes.analysis.verdicts import ChangeIdentifiability, ParameterIdentifiability

__all__ = ["StatedQuantity", "ValueAndU"]


@dataclass(frozen=True)
class ValueAndU:
    """A value and its expanded uncertainty (k = 2), rounded to the same decimal place."""

    value: str
    expanded: str


@dataclass(frozen=True)
class StatedQuantity:
    """One quantity that the sheets of the test certificate state.

    Parameters
    ----------
    words
        Name of the quantity in words.
    symbol
        Symbol of the quantity.
    estimate, sd, interval
        Estimate, standard uncertainty and credible interval, in ``unit``. The estimate of most
        quantities is their posterior mean. The estimate of the stiffness 1 / C of an axis is the
        inverse of the median of C. The estimate of a stiffness by direction is the median of this
        stiffness.
    unit
        Unit of ``estimate``, ``sd`` and ``interval``: a unit made of mm, N and rad for a parameter
        or a stiffness, um for a circular deviation, and deg for a direction.
    entry
        Verdict on how well the readings determine the quantity. For a stiffness 1 / C, it is the
        verdict on the compliance C. None for a quantity that is computed from several parameters.
    limit
        String with the limit if the sheet states only a limit of the quantity, and otherwise an
        empty string.
    confounding_effects
        For a quantity that is computed from several parameters, the names of the effects with which
        these parameters are confounded. Empty for all other quantities.
    direction
        For the change of a compliance with force: whether the compliance increases, decreases, or
        shows no clear change (no_change). An empty string for all other quantities.
    change_entry
        Verdict on the change of a compliance with force. None for all other quantities.
    no_change
        Probability that a compliance is constant. It is zero if the results come from a single
        model and not from an average over models.
    if_any
        Interval of the change of a compliance in ``unit``, given that it is not exactly zero. None
        if it is not known, and for all other quantities.
    note
        First remark on the quantity, in the language of the sheets. Empty if there is none.
    where
        For the least or greatest stiffness in a plane: its direction as a part of a sentence, such
        as "at 2° ± 17° from X". An empty string for all other quantities.
    limit_near_zero
        For a compliance that cannot be negative and may be zero: the value in ``unit`` below which
        it lies with a probability of 95 %. None for all other quantities.
    is_undetermined
        Whether the readings leave the quantity undetermined, see `undetermined_parameters`.
    """

    words: str
    symbol: str
    estimate: float
    sd: float
    interval: tuple[float, float]
    unit: str
    entry: ParameterIdentifiability | None = None
    limit: str = ""
    confounding_effects: tuple[str, ...] = ()
    direction: Literal["", "increases", "decreases", "no_change"] = ""
    change_entry: ChangeIdentifiability | None = None
    no_change: float = 0.0
    if_any: tuple[float, float] | None = None
    note: str = ""
    where: str = ""
    limit_near_zero: float | None = None
    is_undetermined: bool = False

    def value_and_U(self) -> ValueAndU:
        """Return the value and its expanded uncertainty (k = 2), in the unit that readers see.

        If the test certificate states only a limit of the quantity, the limit takes the place of
        the value, and no U is stated. Nor is it of a change that is exactly zero, or of a value
        outside its own credible interval: the interval is then the statement.
        """
        if self.is_exactly_none:
            return ValueAndU("0", "–")
        if self.limit:
            return ValueAndU(self.limit, "–")
        if needs_interval(self.estimate, self.sd, self.interval):
            statement = state(self.estimate, self.sd, self.interval, self.unit)
            low, high = self.interval
            if not low <= self.estimate <= high:
                return ValueAndU(statement.value, "–")
            return ValueAndU(statement.value, statement.expanded)
        factor, _ = display_unit(self.unit)
        value, expanded = value_and_uncertainty(self.estimate * factor, 2.0 * self.sd * factor)
        return ValueAndU(value.replace("-", "−"), expanded)

    @property
    def is_exactly_none(self) -> bool:
        """Whether a compliance almost certainly does not change with force at all.

        This is the case if it is constant with a probability of at least 95 %, or if the credible
        interval of its change is the single value zero.
        """
        is_zero = self.no_change >= SURE or self.interval == (0.0, 0.0)
        return self.direction == "no_change" and is_zero

    @property
    def inseparable_partners(self) -> tuple[str, ...]:
        """Names of the effects with which an undetermined quantity is confounded.

        The tuple is empty if the readings determine the quantity, or if the quantity is not
        confounded.
        """
        if self.entry is None or not self.is_undetermined:
            return ()
        return self.entry.partners
