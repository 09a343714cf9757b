"""Terms of the joints: stiffening under their own load, compliance along the travel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ldbb_bayes.machine.chain import LINEAR
from ldbb_bayes.model.setting import Setting
from ldbb_bayes.model.terms.base import Term, Unit
from ldbb_bayes.model.terms.columns import Columns
from ldbb_bayes.results import Array

__all__ = ["JointLoad", "Position"]

# Deflection of a bolted contact δ ~ f^(2/3) gives |u|^(5/3) along the bar.
_CONTACT_POWER = 5.0 / 3.0


@dataclass(frozen=True)
class JointLoad(Term):
    """F u_a² (F |u_a| − F0)/F_max and F^⅔ F0^⅓ |u_a|^(5/3) − F u_a²; u the bar's direction.

    An axis a yields to the load F u_a of its own axis, not to the bar's force: preload and rolling
    contact, and bolted contact (δ ~ f^⅔). Both are zero along the axis at F0, where C_aa stays the
    secant compliance. One sd of each is ``relative_sd`` Ĉ_aa.
    """

    relative_sd: float = 0.2
    unit = Unit("mm/N", 1e-6, "nm/N")
    calibration = "a narrower prior of it"
    remedy = "Measure the axis' deflection under its own load."

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        """Return its columns in a setting."""
        columns = []
        for axis, estimate in setting.driven_axes():
            values = self._laws(
                setting,
                setting.force_N[:, None],
                square=setting.along(axis, 2.0),
                cube=setting.along(axis, 3.0),
                contact=setting.along(axis, _CONTACT_POWER),
            )
            letter = LINEAR[axis]
            names = (f"joint_load_{letter}_slope", f"joint_load_{letter}_contact")
            columns.append(Columns(names, values, np.full(2, self.relative_sd * estimate)))
        return tuple(columns)

    def secants(self, setting: Setting, force_N: Array) -> Array:
        """Return what an axis' two coefficients add to its C_aa(F), shape (n, 2).

        These are the columns along the axis over F, at forces (n,).
        """
        deflections = self._laws(setting, force_N, square=1.0, cube=1.0, contact=1.0)
        return deflections / force_N[:, None]

    def _laws(
        self,
        setting: Setting,
        force: Array,
        *,
        square: Array | float,
        cube: Array | float,
        contact: Array | float,
    ) -> Array:
        """Return both columns from u², |u|³ and |u|^(5/3), shape (..., 2)."""
        middle = setting.reference_force_N
        rolling = force * (force * cube - middle * square) / setting.largest_force_N
        bolted = np.cbrt(force**2 * middle) * contact - force * square
        return np.stack([rolling, bolted], axis=-1)

    @classmethod
    def describe(cls, coefficient: str) -> str:
        """Return a coefficient in words."""
        axis, law = coefficient.removeprefix("joint_load_").split("_")
        effect = "stiffening" if law == "slope" else "contact"
        return f"{effect} of axis {axis} under its own load"


@dataclass(frozen=True)
class Position(Term):
    """F u_a³ and F (u_a⁴ − u_a²/2): compliance of axis a changes along its travel.

    Screw and guideway are stiffer near their bearings. One sd is ``linear_sd`` Ĉ_aa and
    ``quadratic_sd`` Ĉ_aa; u the bar's direction.
    """

    linear_sd: float = 0.07
    quadratic_sd: float = 0.04
    unit = Unit("mm/N", 1e-6, "nm/N")
    calibration = "a narrower prior of it"
    remedy = "Run circles at several centres."

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        """Return its columns in a setting."""
        force = setting.force_N[:, None]
        columns = []
        for axis, estimate in setting.driven_axes():
            linear = force * setting.along(axis, 3.0, signed=True)
            bow = setting.along(axis, 4.0) - 0.5 * setting.along(axis, 2.0)
            values = np.stack([linear, force * bow], axis=2)
            letter = LINEAR[axis]
            names = (f"position_{letter}_linear", f"position_{letter}_quadratic")
            sd = np.array([self.linear_sd, self.quadratic_sd]) * estimate
            columns.append(Columns(names, values, sd))
        return tuple(columns)

    @classmethod
    def describe(cls, coefficient: str) -> str:
        """Return a coefficient in words."""
        axis, law = coefficient.removeprefix("position_").split("_")
        return f"{law} change of the compliance along {axis}"
