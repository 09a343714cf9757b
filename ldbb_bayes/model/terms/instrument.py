"""Terms of the measuring instrument: bar length, mount, force device, angle reference."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign, Instrument
from ldbb_bayes.model.fourier import derivative
from ldbb_bayes.model.setting import Setting
from ldbb_bayes.model.terms.base import Term, Uncertainty, Unit, _assumed
from ldbb_bayes.model.terms.columns import Columns

__all__ = ["Angle", "BarLength", "ForceError", "Mount"]


@dataclass(frozen=True)
class BarLength(Term):
    """1: calibration of the bar's length (ball radii, zero setting, bar temperature); another
    radius is another length. Mean and sd are those of the bar's certificate where there is one."""

    sd_um: float = 9.4  #: one sd of the bar's length
    calibration = "a calibration of the bar's length"
    remedy = "Calibrate the bar's length."
    instrument = True

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        names, own = zip(
            *((f"bar_length{radius}", own) for _, radius, own in setting.each("radius")),
            strict=True,
        )
        values = setting.constant(np.column_stack(own).astype(float))
        stated = setting.instrument
        sd = _expanded(stated.bar_U_um, self.sd_um)
        mean = np.full(len(names), stated.bar_length_error_um * 1e-3)
        return (
            Columns(
                names, values, np.full(len(names), sd * 1e-3), mean=mean if mean.any() else None
            ),
        )

    def assumed(self, campaign: Campaign) -> Iterator[Uncertainty]:
        own = campaign.instrument
        yield _assumed(
            campaign,
            "bar_length",
            "bar_U_um",
            _expanded(own.bar_U_um, self.sd_um) * 1e-3,
            own.bar_length_error_um * 1e-3,
        )

    @classmethod
    def describe(cls, coefficient: str) -> str:
        radius = coefficient.removeprefix("bar_length").removeprefix("_")
        return cls.words + (f" at R = {radius} mm" if radius else "")


def _expanded(stated: float | None, assumed: float, factor: float = 1.0) -> float:
    """Standard uncertainty of a stated expanded one (k = 2), times ``factor``; what is assumed
    where none is stated."""
    return assumed if stated is None else 0.5 * stated * factor


@dataclass(frozen=True)
class Mount(Term):
    """P: deflection of the work ball's mount per bar, known to ``relative_sd`` of its nominal value
    (Eq. 32) or as its certificate says; and a curvature, q(F) = 4 (F/F_max)(1 − F/F_max) times
    ``curvature_um`` (0: none)."""

    relative_sd: float = 0.10
    curvature_um: float = 0.5
    unit = Unit("mm/bar", 1e-3, "µm/bar")
    calibration = "a measurement of the mount's deflection"
    remedy = "Measure the mount's deflection."
    instrument = True
    common = True

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        relative = _expanded(setting.instrument.mount_U_percent, self.relative_sd, 0.01)
        sd = np.array([relative * (setting.deflection_um_per_bar * 1e-3)])
        linear = Columns(("mount",), setting.constant(setting.pressure_bar), sd)
        if not self.curvature_um:
            return (linear,)
        sd = np.array([self.curvature_um * 1e-3])
        return linear, Columns(("mount_curvature",), setting.constant(setting.bow), sd)

    def assumed(self, campaign: Campaign) -> Iterator[Uncertainty]:
        nominal = campaign.mount.deflection_um_per_bar * 1e-3
        relative = _expanded(campaign.instrument.mount_U_percent, self.relative_sd, 0.01)
        yield _assumed(campaign, "mount", "mount_U_percent", relative * nominal, nominal)
        if self.curvature_um:
            yield _assumed(campaign, "mount_curvature", "", self.curvature_um * 1e-3)

    @classmethod
    def unit_of(cls, coefficient: str) -> Unit:
        return Term.unit if coefficient == "mount_curvature" else cls.unit

    @classmethod
    def describe(cls, coefficient: str) -> str:
        return (
            "curvature of the mount's deflection"
            if coefficient == "mount_curvature"
            else "mount deflection"
        )


@dataclass(frozen=True)
class ForceError(Term):
    """F j_C·Ĉ times a gain error and F_max q(F) j_C·Ĉ times a curvature of the force law, 0 for
    none, both common to all tests; and j_C·Ĉ times a random force error of each test. Each as the
    load cell's certificate says where there is one."""

    gain_sd: float = 0.01  #: one sd, a share of the force
    curvature_sd: float = 0.01  #: one sd, a share of F_max
    random_sd_N: float = 4.0  #: of every test
    stem = ("force_gain", "force_curvature", "force_random")
    unit = Unit("1", 1e-2, "%")
    calibration = "a calibration of the force"
    remedy = "Calibrate the force."
    instrument = True
    common = True

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        deflection = (setting.wrench @ setting.compliance_estimate)[:, :, None]
        sd = self._sds(setting.instrument)
        forces = {
            "force_gain": setting.force_N,
            "force_curvature": setting.largest_force_N * setting.bow,
        }
        parts = [
            (name, force[:, None, None] * deflection)
            for name, force in forces.items()
            if name in sd
        ]
        return (
            *(Columns((name,), values, np.array([sd[name]])) for name, values in parts),
            Columns(("force_random",), deflection, np.array([sd["force_random"]]), private=True),
        )

    def _sds(self, stated: Instrument) -> dict[str, float]:
        """As it is, or as a certificate states; a linearity is a bound, each value within it as
        likely as another."""
        linearity = stated.force_linearity_percent
        random = stated.force_random_N
        curvature = self.curvature_sd if linearity is None else 0.01 * linearity / np.sqrt(3.0)
        found = {
            "force_gain": _expanded(stated.force_U_percent, self.gain_sd, 0.01),
            "force_curvature": float(curvature),
        }
        found |= {"force_random": self.random_sd_N if random is None else random}
        return {
            name: sd for name, sd in found.items() if self.curvature_sd or name != "force_curvature"
        }

    def assumed(self, campaign: Campaign) -> Iterator[Uncertainty]:
        for name, sd in self._sds(campaign.instrument).items():
            named = zip(
                self.stem,
                ("force_U_percent", "force_linearity_percent", "force_random_N"),
                strict=True,
            )
            yield _assumed(campaign, name, dict(named)[name], sd)

    @classmethod
    def unit_of(cls, coefficient: str) -> Unit:
        return Unit("N", 1.0, "N") if coefficient == "force_random" else cls.unit

    @classmethod
    def describe(cls, coefficient: str) -> str:
        return coefficient.replace("_", " ")


@dataclass(frozen=True)
class Angle(Term):
    """dρ/dθ of the fitted circle, F j_C·Ĉ + j_G·Ê, once for all tests and once times the direction
    of travel: angle reference and lag of the trace. Tests that state no direction count as
    clockwise."""

    sd_deg: float = 0.1
    unit = Unit("rad", np.pi / 180.0, "°")
    calibration = "a check of the angle's reference"
    remedy = "Check the angle's reference and the lag of the trace."
    instrument = True

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        slope = derivative(setting.fitted)
        lag = slope * setting.travel[:, None]
        sd = np.deg2rad(_expanded(setting.instrument.angle_U_deg, self.sd_deg))
        return (
            Columns(
                ("angle_reference", "angle_lag"), np.stack([slope, lag], axis=2), np.full(2, sd)
            ),
        )

    def assumed(self, campaign: Campaign) -> Iterator[Uncertainty]:
        sd = float(np.deg2rad(_expanded(campaign.instrument.angle_U_deg, self.sd_deg)))
        for name in ("angle_reference", "angle_lag"):
            yield _assumed(campaign, name, "angle_U_deg", sd)

    @classmethod
    def describe(cls, coefficient: str) -> str:
        return coefficient.replace("_", " ")
