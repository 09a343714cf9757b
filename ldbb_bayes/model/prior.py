"""Priors of the parameters of interest and of the hyper-parameters, with units, and the truncation to physical compliances."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfc, erfcinv

from ldbb_bayes.errors import require
from ldbb_bayes.machine.chain import ComplianceKind, ComplianceName, GeometricKind, GeometricName
from ldbb_bayes.model.terms import Hyper, Scale

__all__ = ["HyperPrior", "Prior", "compliance_unit", "degree_of", "geometric_unit"]

Array = NDArray[Any]

# By kind: the unit, and the field of `Prior` that holds one sd.
_COMPLIANCES: dict[ComplianceKind, tuple[str, str]] = {
    "direct": ("mm/N", "direct_mm_per_N"),
    "cross": ("mm/N", "cross_mm_per_N"),
    "rotation_for_force": ("rad/N", "rotation_for_force_rad_per_N"),
    "rotation_for_moment": ("rad/(N mm)", "rotation_for_moment_rad_per_N_mm"),
    "rotation_for_other_moment": ("rad/(N mm)", "rotation_for_moment_rad_per_N_mm"),
}
_GEOMETRIC: dict[GeometricKind, tuple[str, str]] = {
    "gain": ("1", "gain"),
    "straightness": ("1/mm", "straightness_per_mm"),
    "squareness": ("rad", "squareness_rad"),
    "offset": ("mm", "offset_mm"),
}


def compliance_unit(name: ComplianceName, degree: int = 0) -> str:
    """Unit of a compliance or of its slope of the given degree."""
    return _COMPLIANCES[name.kind][0] + ("", "/N", "/N^2")[degree]


def geometric_unit(kind: GeometricKind) -> str:
    """Unit of a geometric error."""
    return _GEOMETRIC[kind][0]


def degree_of(parameter: str) -> int:
    """Power of force a compliance goes with: 1 for C_XXX_1, 0 for what is no slope."""
    stem, _, last = parameter.rpartition("_")
    return int(last) if stem.startswith("C_") and last.isdigit() else 0


@dataclass(frozen=True)
class Prior:
    """Gaussian priors of the parameters of interest, zero-mean unless ``means`` says otherwise; half-normal priors of the
    hyper-parameters.

    The defaults are wide for any machine tool: a compliance of 1e-4 mm/N is a stiffness of 10 N/µm, a scale gain of 2e-4 is
    200 µm/m. Give your own by ``replace(Prior.default(), ...)``, by ``overrides`` or in TOML.

    Attributes
    ----------
    direct_mm_per_N, cross_mm_per_N, rotation_for_force_rad_per_N, rotation_for_moment_rad_per_N_mm : float
        One sd of C_XXX and C_YYY; of C_XYX; of C_CXY and C_CYY; of C_CCY.
    slope_scale : float
        sd(C_k) = slope_scale · sd(C) / (F_max − F_min)^k.
    gain, squareness_rad, straightness_per_mm, offset_mm : float
        One sd of E_XX1 and E_YY1; of E_C(0Y)X; of E_YX2 and E_XY2; of E_Xt0 and E_Yt0.
    sigma_um, delta_um, kappa_um, tau_um : float
        Scales of the half-normal priors of white noise, set-up shift, discrepancy and ball form.
    truncated : bool
        C_XXX(F), C_YYY(F), C_CCY(F) ≥ 0 at every tested force: F C(F) is a deflection under the force itself.
    flat : bool
        No prior on the parameters of interest (the paper's least squares).
    overrides : mapping of parameter name to sd
        In inside units (mm, N, rad).
    means : mapping of parameter to prior mean
        In inside units; zero for all others. A force slope's mean stays zero: constant compliance is the linear model with its
        slopes at zero. The override of a compliance named here says how well it is known, no longer how large it may be: its
        slopes keep the sd that the kind of compliance gives them.
    """

    direct_mm_per_N: float = 1e-4
    cross_mm_per_N: float = 1e-5
    rotation_for_force_rad_per_N: float = 1e-7
    rotation_for_moment_rad_per_N_mm: float = 1e-9
    slope_scale: float = 0.3
    gain: float = 2e-4
    squareness_rad: float = 5e-5
    straightness_per_mm: float = 1e-6
    offset_mm: float = 0.02
    sigma_um: float = 1.0
    delta_um: float = 1.0
    kappa_um: float = 1.0
    tau_um: float = 5.0
    truncated: bool = True
    flat: bool = False
    overrides: Mapping[str, float] = field(default_factory=dict)
    means: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, int | float) and not isinstance(value, bool):
                object.__setattr__(self, name, float(value))
        for name in ("overrides", "means"):
            own = {parameter: float(value) for parameter, value in getattr(self, name).items()}
            object.__setattr__(self, name, MappingProxyType(own))
        scales = {name: value for name, value in vars(self).items() if isinstance(value, float)} | dict(self.overrides)
        for name, value in scales.items():
            cure = f"got {value}. To drop a term, leave it out instead."
            require(np.isfinite(value) and value > 0, f"prior {name} must be a positive number, {cure}")
        both = self.flat and self.truncated
        require(not both, "a flat prior must not be truncated, got both. Set truncated = false or flat = false.")
        for name in ("overrides", "means"):
            some = self.flat and getattr(self, name)
            require(not some, f"a flat prior must have no {name}, got some. Set flat = false or remove them.")
        for name, mean in self.means.items():
            what = f"prior mean of {name} must be"
            require(np.isfinite(mean), f"{what} a finite number, got {mean}. Correct it or leave it out.")
            why = "a slope's is zero, because constant compliance is the linear model with its slopes at zero. Remove it."
            require(not degree_of(name), f"{what} left out, got {mean:g}: {why}")

    def __reduce__(self) -> tuple[Any, ...]:
        """To other processes; a read-only mapping does not pickle."""
        return _prior_from, (dict(vars(self), overrides=dict(self.overrides), means=dict(self.means)),)

    @classmethod
    def default(cls) -> Prior:
        """The documented default."""
        return cls()

    @classmethod
    def paper(cls) -> Prior:
        """Flat and untruncated: least squares."""
        return cls(truncated=False, flat=True)

    def compliance_sd(self, names: Sequence[ComplianceName], degree: int, force_range_N: float) -> Array:
        """Prior sd of every compliance of one degree, shape (compliances,)."""
        labels = [name.label for name in names]
        usual = np.array([getattr(self, _COMPLIANCES[name.kind][1]) for name in names])
        constant = self._overridden(labels, usual)
        if degree == 0:
            return constant
        size = np.where([label in self.means for label in labels], usual, constant)
        return self._overridden([f"{label}_{degree}" for label in labels], self.slope_scale * size / force_range_N**degree)

    def geometric_sd(self, names: Sequence[GeometricName]) -> Array:
        """Prior sd of every geometric error, shape (geometric errors,)."""
        return self._overridden([name.label for name in names], [getattr(self, _GEOMETRIC[name.kind][1]) for name in names])

    def _overridden(self, names: Sequence[str], default: Any) -> Array:
        return np.array([self.overrides.get(name, value) for name, value in zip(names, default, strict=True)], dtype=float)

    def hyper(self, scales: Sequence[Scale], resolution_um: float) -> HyperPrior:
        """Priors of hyper-parameters; σ is restricted to σ ≥ resolution/√12."""
        own = [getattr(self, scale.prior_um) if isinstance(scale.prior_um, str) else scale.prior_um for scale in scales]
        lower = np.array([resolution_um / np.sqrt(12.0) if scale.name == "sigma" else 0.0 for scale in scales])
        return HyperPrior(tuple(scale.name for scale in scales), np.array(own) * 1e-3, lower * 1e-3)


def _prior_from(fields: Mapping[str, Any]) -> Prior:
    return Prior(**fields)


@dataclass(frozen=True, eq=False)
class HyperPrior:
    """Independent half-normal densities in the hyper-parameters ``names`` themselves, of ``scale_mm``, each restricted to φ ≥
    ``lower_mm``, both (h,)."""

    names: tuple[Hyper, ...]
    scale_mm: Array
    lower_mm: Array

    def log_density(self, phi: Array) -> Array:
        """ln p(φ), shape (..., h) → (...); −inf below the restriction."""
        with np.errstate(over="ignore"):
            quadratic = -0.5 * (phi / self.scale_mm) ** 2
        constant = 0.5 * np.log(2.0 / np.pi) - np.log(self.scale_mm) - np.log(self._mass)
        return np.where(phi >= self.lower_mm, quadratic + constant, -np.inf).sum(axis=-1)

    def free(self, phi: Array) -> Array:
        """Free coordinates ln(φ − lower): logarithms, and no edge for σ at the resolution's floor."""
        with np.errstate(divide="ignore"):
            return np.log(phi - self.lower_mm)

    def phi(self, free: Array) -> Array:
        """φ [mm] from free coordinates."""
        with np.errstate(over="ignore"):
            return self.lower_mm + np.exp(free)

    def log_density_of_free(self, free: Array) -> Array:
        """Density in the free coordinates, the Jacobian φ − lower included, shape (..., h) → (...)."""
        return self.log_density(self.phi(free)) + free.sum(axis=-1)

    @property
    def _mass(self) -> Array:
        return np.asarray(erfc(self.lower_mm / self.scale_mm / np.sqrt(2.0)))

    def draw(self, size: int, rng: np.random.Generator) -> Array:
        """Draws of φ, shape (size, h) [mm]."""
        return self.quantile(rng.random((size, len(self.names))))

    def quantile(self, level: Array) -> Array:
        """Quantiles of φ, shape (..., h) [mm]."""
        return self.scale_mm * np.sqrt(2.0) * erfcinv((1.0 - level) * self._mass)
