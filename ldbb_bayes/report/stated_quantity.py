"""One quantity that the sheets of the certificate state, with its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from ldbb_bayes.units import display_unit, is_skewed, state, value_and_uncertainty

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
    note
        A remark in the language of the sheets that stands before any other.
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
    hangs_on: tuple[str, ...] = ()
    direction: Literal["", "increases", "decreases", "no_change"] = ""
    change_entry: ChangeIdentifiability | None = None
    no_change: float = 0.0
    note: str = ""
    is_undetermined: bool = False

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
    def inseparable_partners(self) -> tuple[str, ...]:
        """Names of the assumed effects that an undetermined quantity is confounded with.

        There are none if the readings determine the quantity, or if it is not confounded.
        """
        if self.entry is None or not self.is_undetermined:
            return ()
        return self.entry.partners
