"""How the bar is loaded: the law between regulator pressure and force, and the deflection of the work ball's mount (Eq. 32)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ldbb_bayes.errors import InputError

__all__ = ["ForceLaw", "MountCompensation"]


@dataclass(frozen=True)
class ForceLaw:
    """F = slope · P + offset: what the regulator pressure does to the force (default: the paper's bar)."""

    slope_N_per_bar: float = 126.04
    offset_N: float = -14.2

    def __post_init__(self) -> None:
        if not (np.isfinite(self.slope_N_per_bar) and self.slope_N_per_bar > 0 and np.isfinite(self.offset_N)):
            raise InputError(
                f"force law must have a positive finite slope and a finite offset, got {self.slope_N_per_bar} N/bar and "
                f"{self.offset_N} N. Correct the [force] table."
            )

    def force_N(self, pressure_bar: float) -> float:
        """Force at a pressure [N]."""
        return self.slope_N_per_bar * pressure_bar + self.offset_N

    def pressure_bar(self, force_N: float) -> float:
        """Pressure for a force [bar]."""
        return (force_N - self.offset_N) / self.slope_N_per_bar


@dataclass(frozen=True)
class MountCompensation:
    """Deflection of the work ball's mount per bar (Eq. 32) and whether the readings are already free of it."""

    deflection_um_per_bar: float = 2.33
    compensated: bool = True

    def __post_init__(self) -> None:
        if not (np.isfinite(self.deflection_um_per_bar) and self.deflection_um_per_bar >= 0):
            raise InputError(
                f"mount deflection must be a number ≥ 0 in µm/bar, got {self.deflection_um_per_bar}. Correct the [mount] table."
            )
