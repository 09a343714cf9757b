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


@dataclass(frozen=True)
class JointLoad(Term):
    """What yields to the load F u_a of its own axis a, not to the bar's force: F u_a² (F |u_a| −
    F0)/F_max, preload and rolling contact, and F^⅔ F0^⅓ |u_a|^(5/3) − F u_a², bolted contact (δ ~
    f^⅔); u the bar's direction.

    Both are zero along the axis at F0, where C_aa stays the secant compliance. One sd of each is
    ``relative_sd`` Ĉ_aa.
    """

    relative_sd: float = 0.2
    unit = Unit("mm/N", 1e-6, "nm/N")
    calibration = "a narrower prior of it"
    remedy = "Measure the axis' deflection under its own load."

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        found = []
        for axis, estimate in setting.driven_axes():
            values = self._laws(
                setting,
                setting.force_N[:, None],
                *(setting.along(axis, a) for a in (2.0, 3.0, 5.0 / 3.0)),
            )
            names = (f"joint_load_{LINEAR[axis]}_slope", f"joint_load_{LINEAR[axis]}_contact")
            found.append(Columns(names, values, np.full(2, self.relative_sd * estimate)))
        return tuple(found)

    def secants(self, setting: Setting, force_N: Array) -> Array:
        """What an axis' two coefficients add to its C_aa(F): the columns along the axis over F,
        shape (n, 2), at forces (n,)."""
        return self._laws(setting, force_N, 1.0, 1.0, 1.0) / force_N[:, None]

    def _laws(
        self,
        setting: Setting,
        force: Array,
        square: Array | float,
        cube: Array | float,
        contact: Array | float,
    ) -> Array:
        """Both columns from u², |u|³ and |u|^(5/3), shape (..., 2)."""
        middle = setting.reference_force_N
        own = force * (force * cube - middle * square) / setting.largest_force_N
        return np.stack([own, np.cbrt(force**2 * middle) * contact - force * square], axis=-1)

    @classmethod
    def describe(cls, coefficient: str) -> str:
        axis, kind = coefficient.removeprefix("joint_load_").split("_")
        return f"{'stiffening' if kind == 'slope' else 'contact'} of axis {axis} under its own load"


@dataclass(frozen=True)
class Position(Term):
    """F u_a³ and F (u_a⁴ − u_a²/2): compliance of axis a changes along its travel, screw and
    guideway being stiffer near their bearings. One sd is ``linear_sd`` Ĉ_aa and ``quadratic_sd``
    Ĉ_aa; u the bar's direction."""

    linear_sd: float = 0.07
    quadratic_sd: float = 0.04
    unit = Unit("mm/N", 1e-6, "nm/N")
    calibration = "a narrower prior of it"
    remedy = "Run circles at several centres."

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        force = setting.force_N[:, None]
        found = []
        for axis, estimate in setting.driven_axes():
            linear = setting.along(axis, 3.0, signed=True)
            quadratic = setting.along(axis, 4.0) - 0.5 * setting.along(axis, 2.0)
            names = (f"position_{LINEAR[axis]}_linear", f"position_{LINEAR[axis]}_quadratic")
            sd = np.array([self.linear_sd, self.quadratic_sd]) * estimate
            found.append(Columns(names, np.stack([force * linear, force * quadratic], axis=2), sd))
        return tuple(found)

    @classmethod
    def describe(cls, coefficient: str) -> str:
        axis, kind = coefficient.removeprefix("position_").split("_")
        return f"{kind} change of the compliance along {axis}"
