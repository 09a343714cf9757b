"""Priors of the parameters of interest, and settings of the priors of the hyper-parameters.

Parameters of interest are the compliances, their slopes (changes with force) and the geometric
errors. Hyper-parameters are the scales (standard deviations) of the noise and of other effects, and
an exponent, the decay p. The standard deviation of a form error of the balls with n waves around
the circle is proportional to n^(−p).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from ldbb_bayes.errors import require
from ldbb_bayes.machine.parameters import ComplianceName, GeometricName
from ldbb_bayes.model.hyper_prior import HyperPrior
from ldbb_bayes.model.parameter_kinds import (
    COMPLIANCE_KINDS,
    GEOMETRIC_KINDS,
    ParameterKind,
    degree_of,
    kind_of,
    parameter_to_inside,
)
from ldbb_bayes.model.terms import Scale
from ldbb_bayes.results import Array, Shown
from ldbb_bayes.units import display_unit, inside_name, setting_to_inside

__all__ = ["Prior"]

# A prior mean of a parameter is refused if its absolute value exceeds the default prior sd times
# this number, because the unit is then probably wrong. A compliance of a usual machine, about half
# of this sd, is found if it is written in µm/N in place of nm/N.
_LARGEST_MEAN_PER_SD = 100.0


@dataclass(frozen=True)
class Prior(Shown):
    """Gaussian priors of the parameters of interest and half-normal priors of hyper-parameters.

    Parameters of interest are compliances, their slopes (changes with force) and geometric errors.
    Hyper-parameters are the prior standard deviations of the noise and of other effects. The
    defaults are so wide that the parameters of any machine tool are plausible: a compliance of 1e-4
    mm/N is a stiffness of 10 N/µm, and a scale error of 2e-4 is 200 µm/m. Give other priors by
    `HybridModel.with_prior` or in the TOML file of a model; every value may be a string with a
    unit.

    The prior mean is zero for every parameter that ``means`` does not name. The prior mean of a
    slope is always zero: before the readings are taken, the compliance is expected to be constant,
    and ``slope_scale`` states how far it may change with force. If ``means`` contains a compliance,
    the prior sd of this compliance expresses how well the compliance is known, not how large it may
    be. The prior sds of its slopes are therefore computed from the default prior sd of this kind of
    compliance.

    Raises
    ------
    InputError
        If a prior sd or scale is not positive, if a unit does not fit, if a mean belongs to a slope
        or is too large for any machine, or if a flat prior is truncated or has means or overrides.

    Examples
    --------
    >>> prior = lb.Prior(direct_mm_per_N="50 nm/N", overrides={"E_XX1": "100 µm/m"})
    >>> prior.direct_mm_per_N
    5e-05
    >>> dict(prior.overrides)
    {'E_XX1': 0.0001}
    """

    #: prior sd of direct compliances, such as C_XXX (displacement along an axis per force along the
    #: same axis) [mm/N]
    direct_mm_per_N: float = 1e-4
    #: prior sd of cross compliances, such as C_XYX (displacement along one axis per force along
    #: another axis) [mm/N]
    cross_mm_per_N: float = 1e-5
    #: prior sd of compliances that are a rotation per force, such as C_CXY (rotation about Z per
    #: force along X) [rad/N]
    rotation_for_force_rad_per_N: float = 1e-7
    #: prior sd of compliances that are a rotation per moment, such as C_CCY (rotation about Z per
    #: moment about Z) [rad/(N mm)]
    rotation_for_moment_rad_per_N_mm: float = 1e-9
    #: factor in the prior sd of slopes, without unit. A slope of degree k has the prior sd
    #: slope_scale · c / (F_max − F_min)^k. c is a typical magnitude of the compliance
    #: (``slopes_of_estimate`` explains how it is computed); F_min and F_max are the campaign's
    #: smallest and largest force.
    slope_scale: float = 0.3
    gain: float = 2e-4  #: prior sd of a scale error, such as E_XX1 of the X axis, without unit
    squareness_rad: float = 5e-5  #: prior sd of squareness errors, such as E_C(0Y)X [rad]
    #: prior sd of quadratic straightness errors, such as E_YX2 [1/mm]
    straightness_per_mm: float = 1e-6
    offset_mm: float = 0.02  #: prior sd of offsets of the tool ball, such as E_Xt0 [mm]
    sigma_um: float = 1.0  #: scale of the half-normal prior of σ, the sd of white noise [µm]
    #: scale of the half-normal prior of δ [µm]. δ is the sd of random shifts from one circle to the
    #: next: shifts of the zero of the readings, and of the centre of the circle
    delta_um: float = 1.0
    #: scale of the half-normal prior of κ [µm]. κ is the sd of the discrepancy, which consists of
    #: errors of the model and of variation from circle to circle
    kappa_um: float = 1.0
    #: scale of the half-normal prior of τ, the sd of the balls' form error with 6 waves around the
    #: circle [µm]
    tau_um: float = 1.5
    #: scale of the half-normal prior of ω [µm]. ω is the sd of those geometric and cyclic errors of
    #: the machine that have 6 waves around the circle
    omega_um: float = 1.5
    #: scale of the half-normal prior of η, the sd of hysteresis that does not depend on force [µm]
    eta_um: float = 2.0
    #: prior mean of the decay p: the sds of the balls' form errors, and of the machine's errors of
    #: higher orders, are proportional to n^(−p), where the order n is the number of waves around
    #: the circle. The prior is Gaussian, truncated to [0.5, 3.5].
    decay: float = 2.0
    #: prior sd, before truncation to [0.5, 3.5], of the decay p: the exponent with which form
    #: errors decrease with their order
    decay_sd: float = 0.7
    #: whether the prior sd of a slope depends on the estimate of its compliance. If true, the
    #: typical magnitude c in the formula of ``slope_scale`` is max(√(Ĉ² + u²), sd(C)/20), where Ĉ
    #: is the estimate of the compliance, u the standard uncertainty of the estimate, and sd(C) the
    #: prior sd of the compliance. If false, c is sd(C), as in the model's first edition (preset
    #: ``first``).
    slopes_of_estimate: bool = True
    #: whether the prior is truncated so that compliances that are deflections in the direction of
    #: the load itself (such as C_XXX, C_YYY and C_CCY) are not negative at the tested forces
    truncated: bool = True
    #: whether all parameters of interest (compliances, their changes with force, and geometric
    #: errors) have flat (constant) priors. The estimates are then those of a least-squares fit, as
    #: in the article on the model
    flat: bool = False
    #: prior sds that the user gave instead of the defaults, in internal units (mm, N, rad); the
    #: keys are names of parameters of interest, such as C_XXX
    overrides: Mapping[str, float] = field(default_factory=dict)
    #: dict of the prior means that are not zero, in internal units (mm, N, rad); its keys are names
    #: of parameters of interest, such as C_XXX
    means: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Convert values with units to numbers, and raise an `InputError` if a value is invalid."""
        self._convert_settings()
        self._convert_table("overrides", "prior sd of")
        self._convert_table("means", "prior mean of")
        scales = {name: value for name, value in vars(self).items() if isinstance(value, float)}
        for name, value in {**scales, **self.overrides}.items():
            require(
                bool(np.isfinite(value) and value > 0),
                f"prior {name} must be a positive number, got {value}."
                " To drop a term, leave it out instead.",
            )
        self._check_flat()
        for name, mean in self.means.items():
            _check_mean(name, mean)

    def _convert_settings(self) -> None:
        """Convert all numerical settings of the prior to numbers in the units given in their names.

        Settings may be given as strings with a unit: "5 nm/N" for direct_mm_per_N becomes 5e-6.
        """
        for name, value in vars(self).items():
            if isinstance(value, int | float | str) and not isinstance(value, bool):
                number = setting_to_inside(name, value, f"prior {name}")
                require(
                    not isinstance(number, str),
                    f"prior {name} must be a number, got {value!r}. Correct it.",
                )
                object.__setattr__(self, name, float(number))

    def _convert_table(self, table: str, words: str) -> None:
        """Convert ``overrides`` or ``means`` to a read-only table of numbers in internal units.

        Strings with a unit are converted to mm, N and rad. Numbers are in these units already, and
        are kept. The names of parameters are written as in files: E_C0YX for E_C(0Y)X. ``table`` is
        the name of one of the two fields. ``words`` describes the values in error messages, for
        example as "prior sd of".
        """
        values = {inside_name(name): value for name, value in getattr(self, table).items()}
        for name, value in values.items():
            values[name] = parameter_to_inside(name, value, words)
        object.__setattr__(self, table, MappingProxyType(values))

    def _check_flat(self) -> None:
        """Raise an `InputError` if the prior is flat and has settings that contradict it.

        A flat prior cannot be combined with the exclusion of negative compliances (``truncated``),
        with prior sds (``overrides``) or with prior means (``means``).
        """
        if not self.flat:
            return
        require(
            not self.truncated,
            "a flat prior must allow negative compliances, got truncated = true too."
            " Set truncated = false or flat = false.",
        )
        for name in ("overrides", "means"):
            require(
                not getattr(self, name),
                f"a flat prior must have no {name}, got some. Set flat = false or remove them.",
            )

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the class and all settings, from which pickle creates the same prior.

        Read-only mappings are replaced with dictionaries, because pickle cannot store read-only
        mappings.
        """
        settings = {**vars(self), "overrides": dict(self.overrides), "means": dict(self.means)}
        return partial(Prior, **settings), ()

    @classmethod
    def default(cls) -> Prior:
        """Return the default prior, under which parameters of any machine tool are plausible."""
        return cls()

    @classmethod
    def first(cls) -> Prior:
        """Return the prior of the model's first edition (preset ``first``).

        The prior of the balls' form errors is wider than in the default prior, and the prior sds of
        slopes do not depend on the readings.
        """
        return cls(tau_um=5.0, slopes_of_estimate=False)

    @classmethod
    def paper(cls) -> Prior:
        """Return the flat prior, with which estimates are least-squares estimates.

        The estimates are those of the article on the model. Compliances may be negative.
        """
        return cls(truncated=False, flat=True)

    def compliance_sd(self, names: Sequence[ComplianceName]) -> Array:
        """Return the prior sd of each named compliance, shape (compliances,), in mm, N and rad.

        ``names`` are the names of the compliances. A prior sd that the user gave for a compliance
        is used; otherwise the sd is the default for this kind of compliance.
        """
        return self._with_overrides([name.label for name in names], self._usual_sd(names))

    def slope_sd(
        self, names: Sequence[ComplianceName], degree: int, force_range_N: float, size: Array
    ) -> Array:
        """Return the prior sd of the slope of each named compliance, shape (compliances,).

        A prior sd that the user gave for a slope is used; otherwise the sd is ``slope_scale`` ·
        size / (force range)^degree, where ``slope_scale`` is a field of the prior. The sds are in
        mm, N and rad.

        Parameters
        ----------
        names
            Names of the compliances.
        degree
            Degree of the slope: 1 for linear, 2 for quadratic change of the compliance with force.
        force_range_N
            Largest minus smallest force of the campaign [N].
        size
            Typical magnitude of each compliance, shape (compliances,).
        """
        return self._with_overrides(
            [f"{name.label}_{degree}" for name in names],
            self.slope_scale * size / force_range_N**degree,
        )

    def compliance_size(self, names: Sequence[ComplianceName]) -> Array:
        """Return the typical magnitude of each named compliance, shape (compliances,).

        ``names`` are the names of the compliances. The magnitude, in mm, N and rad, is the prior sd
        of the compliance. If the user gave a prior mean for the compliance, the magnitude is the
        default prior sd of this kind of compliance instead.
        """
        has_mean = [name.label in self.means for name in names]
        return np.where(has_mean, self._usual_sd(names), self.compliance_sd(names))

    def _usual_sd(self, names: Sequence[ComplianceName]) -> Array:
        """Return the default prior sd for the kind of each named compliance, shape (names,).

        Prior sds that the user gave for single compliances are not taken into account.
        """
        return np.array([getattr(self, COMPLIANCE_KINDS[name.kind].sd_field) for name in names])

    def geometric_sd(self, names: Sequence[GeometricName]) -> Array:
        """Return the prior sd of each named geometric error, shape (errors,), in mm and rad.

        ``names`` are the names of the errors. A prior sd that the user gave for an error is used;
        otherwise the sd is the default for this kind of error.
        """
        return self._with_overrides(
            [name.label for name in names],
            [getattr(self, GEOMETRIC_KINDS[name.kind].sd_field) for name in names],
        )

    def _with_overrides(self, names: Sequence[str], default: Any) -> Array:
        """Return the prior sds of named parameters, in mm, N and rad, shape (names,).

        A prior sd that the user gave is used if there is one; otherwise the parameter's element of
        ``default`` is used.
        """
        return np.array(
            [self.overrides.get(name, value) for name, value in zip(names, default, strict=True)],
            dtype=float,
        )

    def hyper(self, scales: Sequence[Scale], resolution_um: float) -> HyperPrior:
        """Return the joint prior of the hyper-parameters, with lengths in mm.

        Parameters
        ----------
        scales
            Hyper-parameters of the model. Each `Scale` contains the scale of its prior [µm], or the
            name of the field of this `Prior` in which the scale is given.
        resolution_um
            Resolution of the readout [µm]. The sd σ of white noise is at least resolution/√12; the
            other hyper-parameters are at least zero.
        """
        prior_scales = []
        lower_bounds = []
        for scale in scales:
            prior_scale = scale.prior_um
            if isinstance(prior_scale, str):
                prior_scale = getattr(self, prior_scale)
            lower_bound = 0.0
            if scale.name == "sigma":
                lower_bound = resolution_um / np.sqrt(12.0)
            # Hyper-parameters with a half-normal prior are lengths and are converted from µm to mm.
            # All other hyper-parameters have no unit.
            mm_per_unit = 1e-3 if scale.law == "half-normal" else 1.0
            prior_scales.append(prior_scale * mm_per_unit)
            lower_bounds.append(lower_bound * mm_per_unit)
        return HyperPrior(
            tuple(scale.name for scale in scales),
            np.array(prior_scales, dtype=float),
            np.array(lower_bounds, dtype=float),
            tuple(scale.law for scale in scales),
            self.decay_sd,
        )


def _check_mean(name: str, mean: float) -> None:
    """Raise an `InputError` if the prior mean of a named parameter is not permitted.

    ``name`` is the name of the parameter and ``mean`` the prior mean, in internal units (mm, N,
    rad). A prior mean is refused if it is not finite, if its absolute value exceeds 100 default
    prior sds, or if the parameter is a slope.
    """
    require(
        bool(np.isfinite(mean)),
        f"prior mean of {name} must be a finite number, got {mean}. Correct it or leave it out.",
    )
    require(
        not degree_of(name),
        f"prior mean of {name} must be left out, got {mean:g}: a slope's is zero, because constant"
        " compliance is the linear model with its slopes at zero. Remove it.",
    )
    kind = kind_of(name) or ParameterKind("", "")
    largest = _LARGEST_MEAN_PER_SD * getattr(Prior, kind.sd_field, np.inf)
    factor, shown_unit = display_unit(kind.unit)
    require(
        abs(mean) <= largest,
        f"prior mean of {name} must be within ±{largest * factor:g} {shown_unit}, got"
        f" {mean * factor:g} {shown_unit}. Correct its unit; numbers without one are in mm, N and"
        " rad.",
    )
