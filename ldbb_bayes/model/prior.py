"""Priors of the parameters of interest and of the hyper-parameters, with units, and the truncation
to physical compliances."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfc, erfcinv, expit, gammainccinv, gammaln, log_expit, ndtr, ndtri

from ldbb_bayes.errors import nearest, require
from ldbb_bayes.machine.parameters import (
    ComplianceKind,
    ComplianceName,
    GeometricKind,
    GeometricName,
)
from ldbb_bayes.model.terms import Hyper, Law, Scale
from ldbb_bayes.results import Array, Shown
from ldbb_bayes.units import display_unit, inside_name, setting_to_inside, to_inside

__all__ = ["EXAMPLES", "HyperPrior", "Prior", "compliance_unit", "degree_of", "geometric_unit"]


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
EXAMPLES = [
    "C_XXX",
    "C_XYX",
    "C_YYY",
    "C_CXY",
    "C_CYY",
    "C_CCY",
    "E_XX1",
    "E_YX2",
    "E_XY2",
    "E_YY1",
    "E_C0YX",
    "E_Xt0",
    "E_Yt0",
]
_ABSURD = 1000.0
_KINDS: dict[str, GeometricKind] = {"0": "offset", "1": "gain", "2": "straightness"}


def compliance_unit(name: ComplianceName, degree: int = 0) -> str:
    """Unit of a compliance or of its slope of the given degree."""
    return _COMPLIANCES[name.kind][0] + ("", "/N", "/N^2")[degree]


def geometric_unit(kind: GeometricKind) -> str:
    """Unit of a geometric error."""
    return _GEOMETRIC[kind][0]


def parameter_to_inside(parameter: str, value: float | str, what: str) -> float:
    """A value of a parameter in inside units, from a number in them or text with its unit, "5
    nm/N"."""
    if not isinstance(value, str):
        require(
            isinstance(value, int | float | np.number),
            f"{what} {parameter} must be a number or text with its unit, got {value!r}."
            " Correct it.",
        )
        return float(value)
    usual = _usual_of(parameter)
    like = nearest(parameter, EXAMPLES)
    cure = f"Did you mean {like!r}? Else correct the name."
    require(
        usual is not None,
        f"{what} {parameter} must be of a parameter to have a unit, got {value!r}. {cure}",
    )
    return to_inside(value, usual[0], f"{what} {parameter}")  # type: ignore[index]


def _usual_of(parameter: str) -> tuple[str, str] | None:
    """By a parameter's name its unit, and the field of `Prior` with the sd of its kind; None of
    what is no such name."""
    degree = degree_of(parameter)
    match = re.fullmatch(r"C_([A-Z])([A-Z])(.)(?:_\d)?|E_(?:.(.)([012])(?:_\d+)?|.0..)", parameter)
    if match is None or degree > 2:
        return None
    twist, wrench, joint, axis, order = match.groups()
    if twist:
        own = ComplianceName(twist, wrench, joint)
        return compliance_unit(own, degree), _COMPLIANCES[own.kind][1]
    return _GEOMETRIC[_KINDS[order] if axis else "squareness"]


def degree_of(parameter: str) -> int:
    """Power of force a compliance goes with: 1 for C_XXX_1, 0 for what is no slope."""
    stem, _, last = parameter.rpartition("_")
    return int(last) if stem.startswith("C_") and last.isdigit() else 0


@dataclass(frozen=True)
class Prior(Shown):
    """Gaussian priors of the parameters of interest, zero-mean unless ``means`` says otherwise;
    half-normal priors of the hyper-parameters.

    The defaults are wide for any machine tool: a compliance of 1e-4 mm/N is a stiffness of 10 N/µm,
    a scale gain of 2e-4 is 200 µm/m. Give your own by `HybridModel.with_prior` or in TOML; every
    value may be text with its unit.

    ``means`` are zero for all parameters not named; a force slope's stays zero: constant compliance
    is the linear model with its slopes at zero. The override of a compliance named there says how
    well it is known, no longer how large it may be: its slopes keep the sd that the kind of
    compliance gives them.
    """

    direct_mm_per_N: float = 1e-4  #: one sd of C_XXX and C_YYY
    cross_mm_per_N: float = 1e-5  #: one sd of C_XYX
    rotation_for_force_rad_per_N: float = 1e-7  #: one sd of C_CXY and C_CYY
    rotation_for_moment_rad_per_N_mm: float = 1e-9  #: one sd of C_CCY
    slope_scale: float = 0.3  #: sd(C_k) = slope_scale · size / (F_max − F_min)^k
    gain: float = 2e-4  #: one sd of E_XX1 and E_YY1
    squareness_rad: float = 5e-5  #: one sd of E_C(0Y)X
    straightness_per_mm: float = 1e-6  #: one sd of E_YX2 and E_XY2
    offset_mm: float = 0.02  #: one sd of E_Xt0 and E_Yt0
    sigma_um: float = 1.0  #: scale of the half-normal prior of white noise
    delta_um: float = 1.0  #: likewise: set-up shift
    kappa_um: float = 1.0  #: likewise: discrepancy
    tau_um: float = 1.5  #: likewise: ball form at order 6
    omega_um: float = 1.5  #: likewise: machine pattern at order 6
    eta_um: float = 2.0  #: likewise: hysteresis
    decay: float = 2.0  #: the power by which form falls with its order, Normal within [0.5, 3.5]
    decay_sd: float = 0.7  #: its sd
    #: the size is of the compliance itself, max(|Ĉ|, sd(C)/20), else sd(C) (first edition)
    slopes_of_estimate: bool = True
    #: C_XXX(F), C_YYY(F), C_CCY(F) ≥ 0 at tested forces: F C(F) is a deflection under the force
    #: itself
    truncated: bool = True
    flat: bool = False  #: no prior on the parameters of interest (the paper's least squares)
    #: sd by parameter, in inside units (mm, N, rad)
    overrides: Mapping[str, float] = field(default_factory=dict)
    means: Mapping[str, float] = field(default_factory=dict)  #: prior means, in inside units

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, int | float | str) and not isinstance(value, bool):
                number = setting_to_inside(name, value, f"prior {name}")
                require(
                    not isinstance(number, str),
                    f"prior {name} must be a number, got {value!r}. Correct it.",
                )
                object.__setattr__(self, name, float(number))
        for name, what in (("overrides", "prior sd of"), ("means", "prior mean of")):
            given = {
                inside_name(parameter): value for parameter, value in getattr(self, name).items()
            }
            own = {
                parameter: parameter_to_inside(parameter, value, what)
                for parameter, value in given.items()
            }
            object.__setattr__(self, name, MappingProxyType(own))
        scales = {
            name: value for name, value in vars(self).items() if isinstance(value, float)
        } | dict(self.overrides)
        for name, value in scales.items():
            cure = f"got {value}. To drop a term, leave it out instead."
            require(
                np.isfinite(value) and value > 0, f"prior {name} must be a positive number, {cure}"
            )
        both = self.flat and self.truncated
        cure = "Set truncated = false or flat = false."
        require(
            not both,
            f"a flat prior must allow negative compliances, got truncated = true too. {cure}",
        )
        for name in ("overrides", "means"):
            some = self.flat and getattr(self, name)
            require(
                not some,
                f"a flat prior must have no {name}, got some. Set flat = false or remove them.",
            )
        for name, mean in self.means.items():
            what = f"prior mean of {name} must be"
            require(
                np.isfinite(mean),
                f"{what} a finite number, got {mean}. Correct it or leave it out.",
            )
            why = (
                "a slope's is zero, because constant compliance is the linear model with its slopes"
                " at zero. Remove it."
            )
            require(not degree_of(name), f"{what} left out, got {mean:g}: {why}")
            unit, usual = _usual_of(name) or ("", "")
            most = _ABSURD * getattr(Prior, usual, np.inf)
            shown = display_unit(unit)[1]
            got = f"got {mean:g}. Numbers are in mm, N and rad; write the unit: '{mean:g} {shown}'."
            require(abs(mean) <= most, f"{what} within ±{most:g}, {got}")

    def __reduce__(self) -> tuple[Any, ...]:
        """To other processes; a read-only mapping does not pickle."""
        return (
            partial(
                Prior,
                **{**vars(self), "overrides": dict(self.overrides), "means": dict(self.means)},
            ),
            (),
        )

    @classmethod
    def default(cls) -> Prior:
        """The documented default."""
        return cls()

    @classmethod
    def first(cls) -> Prior:
        """That of the model's first edition."""
        return cls(tau_um=5.0, slopes_of_estimate=False)

    @classmethod
    def paper(cls) -> Prior:
        """Flat and untruncated: least squares."""
        return cls(truncated=False, flat=True)

    def compliance_sd(self, names: Sequence[ComplianceName]) -> Array:
        """Prior sd of every compliance, shape (compliances,)."""
        return self._overridden([name.label for name in names], self._usual(names))

    def slope_sd(
        self, names: Sequence[ComplianceName], degree: int, force_range_N: float, size: Array
    ) -> Array:
        """Prior sd of every slope of one degree, shape (compliances,), of compliances of these
        sizes."""
        return self._overridden(
            [f"{name.label}_{degree}" for name in names],
            self.slope_scale * size / force_range_N**degree,
        )

    def compliance_size(self, names: Sequence[ComplianceName]) -> Array:
        """How large compliances may be, shape (compliances,): their prior sd, but the usual one of
        those with a prior mean."""
        given = [name.label in self.means for name in names]
        return np.where(given, self._usual(names), self.compliance_sd(names))

    def _usual(self, names: Sequence[ComplianceName]) -> Array:
        return np.array([getattr(self, _COMPLIANCES[name.kind][1]) for name in names])

    def geometric_sd(self, names: Sequence[GeometricName]) -> Array:
        """Prior sd of every geometric error, shape (geometric errors,)."""
        return self._overridden(
            [name.label for name in names],
            [getattr(self, _GEOMETRIC[name.kind][1]) for name in names],
        )

    def _overridden(self, names: Sequence[str], default: Any) -> Array:
        return np.array(
            [self.overrides.get(name, value) for name, value in zip(names, default, strict=True)],
            dtype=float,
        )

    def hyper(self, scales: Sequence[Scale], resolution_um: float) -> HyperPrior:
        """Priors of hyper-parameters; σ is restricted to σ ≥ resolution/√12."""
        own = [
            getattr(self, scale.prior_um) if isinstance(scale.prior_um, str) else scale.prior_um
            for scale in scales
        ]
        lower = np.array(
            [resolution_um / np.sqrt(12.0) if scale.name == "sigma" else 0.0 for scale in scales]
        )
        laws = tuple(scale.law for scale in scales)
        unit = np.array([1e-3 if law == "half-normal" else 1.0 for law in laws])
        return HyperPrior(
            tuple(scale.name for scale in scales),
            np.array(own) * unit,
            lower * unit,
            laws,
            self.decay_sd,
        )


_LEAST_DECAY = 0.5
_MOST_DECAY = 3.5
# λ² ~ InvGamma(a, b).
_SHAPE = 1.5
_RATE = 1.5


@dataclass(frozen=True, eq=False)
class HyperPrior:
    """Independent densities in the hyper-parameters ``names`` themselves, each by its law:
    half-normal of this ``scale``, restricted to φ ≥ ``lower``, both (h,) [mm]; the decay's
    Normal(``scale``, ``decay_sd``) within [0.5, 3.5]; of a circle's λ, λ² ~ InvGamma(3/2, 3/2). φ
    is in mm, or a number."""

    names: tuple[Hyper, ...]
    scale: Array
    lower: Array
    laws: tuple[Law, ...]
    decay_sd: float

    @cached_property
    def in_mm(self) -> NDArray[np.bool_]:
        """Which are lengths, shape (h,)."""
        return np.array([law == "half-normal" for law in self.laws])

    @property
    def units(self) -> tuple[str, ...]:
        """mm, or none of a number."""
        return tuple("mm" if length else "" for length in self.in_mm)

    @property
    def shown(self) -> Array:
        """Factors to what is shown, µm or a number, shape (h,)."""
        return np.where(self.in_mm, 1e3, 1.0)

    def named(self, phi: Array) -> dict[str, float]:
        """One φ (h,) by name, lengths in µm."""
        return dict(zip(self.names, (phi * self.shown).tolist(), strict=True))

    @cached_property
    def _decay(self) -> NDArray[np.bool_]:
        return np.array([law == "decay" for law in self.laws])

    @cached_property
    def _circle(self) -> NDArray[np.bool_]:
        return np.array([law == "circle" for law in self.laws])

    @property
    def bounds(self) -> Array:
        """The least and the greatest value of each, shape (h, 2)."""
        low, high = (
            np.where(self._decay, limit, other)
            for limit, other in ((_LEAST_DECAY, self.lower), (_MOST_DECAY, np.inf))
        )
        return np.stack([low, high], axis=1)

    def log_density(self, phi: Array) -> Array:
        """ln p(φ), shape (..., h) → (...); −inf outside the restrictions."""
        scale = self.scale[self.in_mm]
        length = phi[..., self.in_mm]
        with np.errstate(over="ignore"):
            quadratic = -0.5 * (length / scale) ** 2
        constant = 0.5 * np.log(2.0 / np.pi) - np.log(scale) - np.log(self._mass)
        total = np.where(length >= self.lower[self.in_mm], quadratic + constant, -np.inf).sum(
            axis=-1
        )
        if self._decay.any():
            p, (low, high) = phi[..., self._decay], self._decay_levels
            white = (p - self.scale[self._decay]) / self.decay_sd
            constant = -np.log(self.decay_sd * np.sqrt(2.0 * np.pi) * (high - low))
            total = total + np.where(
                (p >= _LEAST_DECAY) & (p <= _MOST_DECAY), constant - 0.5 * white**2, -np.inf
            ).sum(axis=-1)
        if self._circle.any():
            with np.errstate(divide="ignore", over="ignore"):
                precision = phi[..., self._circle] ** -2.0
                constant = np.log(2.0) + _SHAPE * np.log(_RATE) - gammaln(_SHAPE)
                total = total + (
                    constant + (_SHAPE + 0.5) * np.log(precision) - _RATE * precision
                ).sum(axis=-1)
        return np.asarray(total)

    def free(self, phi: Array) -> Array:
        """Free coordinates: ln(φ − lower), logarithms, and no edge for σ at the resolution's floor;
        of a decay its logit."""
        with np.errstate(divide="ignore"):
            found = np.log(phi - self.lower)
            p = phi[..., self._decay]
            found[..., self._decay] = np.log((p - _LEAST_DECAY) / (_MOST_DECAY - p))
        return found

    def phi(self, free: Array) -> Array:
        """φ from free coordinates."""
        with np.errstate(over="ignore"):
            found = self.lower + np.exp(free)
        found[..., self._decay] = _LEAST_DECAY + (_MOST_DECAY - _LEAST_DECAY) * expit(
            free[..., self._decay]
        )
        return found

    def log_density_of_free(self, free: Array) -> Array:
        """Density in the free coordinates, the Jacobian included, shape (..., h) → (...)."""
        jacobian = free[..., ~self._decay].sum(axis=-1)
        logit = free[..., self._decay]
        if logit.shape[-1]:
            slope = np.log(_MOST_DECAY - _LEAST_DECAY) + log_expit(logit) + log_expit(-logit)
            jacobian = jacobian + slope.sum(axis=-1)
        return np.asarray(self.log_density(self.phi(free)) + jacobian)

    @cached_property
    def _mass(self) -> Array:
        return np.asarray(erfc(self.lower[self.in_mm] / self.scale[self.in_mm] / np.sqrt(2.0)))

    @cached_property
    def _decay_levels(self) -> Array:
        """Probabilities below the least and the greatest decay of the unrestricted normal, (2,
        1)."""
        limits = np.array([[_LEAST_DECAY], [_MOST_DECAY]])
        return np.asarray(ndtr((limits - self.scale[self._decay]) / self.decay_sd))

    def draw(self, size: int, rng: np.random.Generator) -> Array:
        """Draws of φ, shape (size, h)."""
        return self.quantile(rng.random((size, len(self.names))))

    def quantile(self, level: Array) -> Array:
        """Quantiles of φ, shape (..., h)."""
        level = np.broadcast_to(level, (*level.shape[:-1], len(self.names)))
        found, (low, high) = np.empty(level.shape), self._decay_levels
        found[..., self.in_mm] = (
            self.scale[self.in_mm]
            * np.sqrt(2.0)
            * erfcinv((1.0 - level[..., self.in_mm]) * self._mass)
        )
        white = ndtri(low + (high - low) * level[..., self._decay])
        found[..., self._decay] = np.clip(
            self.scale[self._decay] + self.decay_sd * white, _LEAST_DECAY, _MOST_DECAY
        )
        found[..., self._circle] = np.sqrt(_RATE / gammainccinv(_SHAPE, level[..., self._circle]))
        return found

    @property
    def sd(self) -> Array:
        """Their standard deviations, shape (h,)."""
        centre = np.where(self._decay, self.scale, 0.0)
        spread = np.where(self._decay, self.decay_sd, self.scale)
        edges = (self.bounds - centre[:, None]) / spread[:, None]
        mass = -np.diff(ndtr(-edges))
        density = np.exp(-0.5 * edges**2) / np.sqrt(2.0 * np.pi)
        moments = np.diff([density, np.where(density > 0.0, edges, 0.0) * density]) / mass
        variance = 1.0 - moments[1, :, 0] - moments[0, :, 0] ** 2
        mean = np.sqrt(_RATE) * np.exp(gammaln(_SHAPE - 0.5) - gammaln(_SHAPE))
        return np.where(
            self._circle, np.sqrt(_RATE / (_SHAPE - 1.0) - mean**2), spread * np.sqrt(variance)
        )

    def starts(self, level: Array) -> Array:
        """Free coordinates (..., h) from which to look for modes, of levels from 0 to 1."""
        reach = np.where(self.lower > 0.0, 12.0, 6.0)
        inside = self.free(self.quantile(0.1 + 0.8 * level))
        return np.where(self.in_mm, np.log(2.0 * self.scale) - level * reach, inside)
