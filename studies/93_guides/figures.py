"""Figures that a guide prints, beside those that the package computes from the same inputs."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Figure"]

# A computed number may differ by rounding errors of this share of half a unit.
_ROUNDING = 1e-6


@dataclass(frozen=True)
class Figure:
    """One number of an example, as printed and as computed.

    A figure passes if it agrees within half a unit of its last printed digit. Where the guide drew
    its own figure at random, it passes within ``tolerance`` too: the numerical tolerance of JCGM
    101, 7.9.2, half a unit in the second significant digit of the standard uncertainty.
    """

    guide: str
    example: str
    quantity: str
    printed: str
    computed: float
    unit: str = ""
    tolerance: float = 0.0
    reason: str = ""  #: why the figure differs, where it does

    @property
    def half_unit(self) -> float:
        """Half a unit of the last printed digit."""
        digits, _, exponent = self.printed.replace("−", "-").partition("e")
        decimals = len(digits.partition(".")[2])
        return 0.5 * 10.0 ** (int(exponent or 0) - decimals)

    @property
    def difference(self) -> float:
        """Absolute difference between the computed and the printed figure."""
        return abs(self.computed - float(self.printed.replace("−", "-")))

    @property
    def outcome(self) -> str:
        """PASS or DIFF."""
        allowed = max(self.half_unit * (1.0 + _ROUNDING), self.tolerance)
        return "PASS" if self.difference <= allowed else "DIFF"
