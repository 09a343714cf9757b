"""Nuisance terms of the instrument: bar length, mount, force device and angle reference.

Nuisance terms are effects that are modelled but not of interest.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign, Instrument
from ldbb_bayes.campaign.loading import ForceLaw
from ldbb_bayes.model.fourier import derivative
from ldbb_bayes.model.setting import Setting
from ldbb_bayes.model.terms.base import Term, Uncertainty, Unit, assumption
from ldbb_bayes.model.terms.columns import Columns

__all__ = ["Angle", "BarLength", "ForceError", "Mount"]


def _standard_uncertainty(
    expanded: float | None, assumed: float, unit_per_stated: float = 1.0
) -> float:
    """Return the standard uncertainty: half of the expanded uncertainty (k = 2) of a certificate.

    ``expanded`` is the expanded uncertainty. It is multiplied by ``unit_per_stated`` to convert it
    to the unit of the result, for example by 0.01 if it is in percent. If ``expanded`` is None,
    there is no certificate, and the result is the standard uncertainty ``assumed``.
    """
    return assumed if expanded is None else 0.5 * expanded * unit_per_stated


@dataclass(frozen=True)
class BarLength(Term):
    """Error of the bar's length, caused by ball radii, zero setting and bar temperature.

    The error is constant over the angle on the circle, and has a separate value for every nominal
    radius. Its prior mean and sd follow from the bar's certificate, if there is one. Otherwise the
    prior mean is zero and the prior sd is ``sd_um``.

    Examples
    --------
    >>> bar_length = lb.terms.BarLength(sd_um=2.0)
    >>> [(assumed.name, assumed.sd) for assumed in bar_length.assumed(campaign)]
    [('bar_length', 0.002)]
    >>> lb.terms.BarLength.describe("bar_length_150")
    'bar length at R = 150 mm'
    """

    #: prior sd of the bar's length error [µm]; used if no certificate states an uncertainty
    sd_um: float = 9.4
    calibration = "a calibration of the bar's length"
    remedy = "Calibrate the bar's length."
    instrument = True
    # Of the variance without a certificate, (9.4 µm)², a quarter comes from the radii of the balls,
    # (4.7 µm)². The zero is set anew in every campaign, and the bar has another temperature.
    campaign_correlation = 0.25

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        """Return the columns of the bar's length error, one for each nominal radius of a campaign.

        ``setting`` describes the test conditions. A column is the change of the reading per unit of
        length error: 1 in tests with this radius, 0 in all other tests.
        """
        names = []
        constants = []
        for group in setting.groups_by("radius"):
            names.append(f"bar_length{group.suffix}")
            constants.append(group.tests)
        values = setting.constant(np.column_stack(constants).astype(float))
        sd = np.full(len(names), self._sd_um(setting.instrument) * 1e-3)
        mean = np.full(len(names), setting.instrument.bar_length_error_um * 1e-3)
        return (Columns(tuple(names), values, sd, mean=mean if mean.any() else None),)

    def _sd_um(self, instrument: Instrument) -> float:
        """Return the standard uncertainty of the bar's length [µm].

        The uncertainty comes from the bar's certificate in ``instrument`` or, without a
        certificate, is the field ``sd_um`` of the term.
        """
        return _standard_uncertainty(instrument.bar_U_um, self.sd_um)

    def assumed(self, campaign: Campaign) -> Iterator[Uncertainty]:
        """Yield the error of the bar's length that the term assumes, with its standard uncertainty.

        The error and its standard uncertainty come from the bar's certificate in ``campaign``.
        Without a certificate, the error is zero and the standard uncertainty is ``sd_um``.
        """
        sd = self._sd_um(campaign.instrument) * 1e-3
        error = campaign.instrument.bar_length_error_um * 1e-3
        yield assumption(campaign, "bar_length", "bar_U_um", sd, error)

    @classmethod
    def describe(cls, coefficient: str) -> str:
        """Return words for a coefficient of the bar's length error, given its name.

        For example, bar_length_150 is described as "bar length at R = 150 mm".
        """
        radius = coefficient.removeprefix("bar_length").removeprefix("_")
        return cls.words + (f" at R = {radius} mm" if radius else "")


@dataclass(frozen=True)
class Mount(Term):
    """Error of the deflection of the work ball's mount, and curvature of this deflection.

    The nominal deflection is proportional to the pressure (Eq. 32 of the article on the model). The
    term has two coefficients. The first is the error of the deflection per pressure. Its prior sd
    follows from a certificate; without a certificate, it is the nominal deflection per pressure
    times ``relative_sd``. The second coefficient is the curvature, which is multiplied by q(F) = 4
    (F/F_max)(1 − F/F_max). F is the force, and F_max the largest force of the campaign. The prior
    sd of the curvature is ``curvature_um``; if this is 0, there is no curvature.

    Examples
    --------
    A deflection known to 2 % of 2.33 µm/bar, without curvature:

    >>> mount = lb.terms.Mount(relative_sd=0.02, curvature_um=0.0)
    >>> [(assumed.name, round(assumed.sd, 7)) for assumed in mount.assumed(campaign)]
    [('mount', 4.66e-05)]
    """

    #: prior sd of the error of the mount's deflection, as a fraction of the nominal deflection;
    #: used if no certificate states an uncertainty
    relative_sd: float = 0.10
    #: prior sd of the curvature [µm]. The curvature is the deviation of the mount's deflection from
    #: a straight line, at half of the largest force. If this sd is 0, there is no curvature
    curvature_um: float = 0.5
    unit = Unit("mm/bar", 1e-3, "µm/bar")
    calibration = "a measurement of the mount's deflection"
    remedy = "Measure the mount's deflection."
    instrument = True
    common = True

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        """Return the columns of the design matrix for two errors of the mount's deflection.

        The first is the error of the ratio of deflection to pressure. The second is the curvature,
        that is, the deviation of the deflection from a straight line; it has no column if
        ``curvature_um`` is zero. ``setting`` describes the test conditions. A column holds, for
        every test, the change of the reading per unit of one coefficient.
        """
        relative = self._relative_sd(setting.instrument)
        sd = np.array([relative * (setting.deflection_um_per_bar * 1e-3)])
        linear = Columns(("mount",), setting.constant(setting.pressure_bar), sd)
        if not self.curvature_um:
            return (linear,)
        sd = np.array([self.curvature_um * 1e-3])
        curved = Columns(("mount_curvature",), setting.constant(setting.bow), sd)
        return linear, curved

    def _relative_sd(self, instrument: Instrument) -> float:
        """Return the relative standard uncertainty of the deflection of the work ball's mount.

        The uncertainty is a fraction of the deflection. It comes from the certificate of the mount
        in ``instrument`` or, without a certificate, is the field ``relative_sd`` of the term.
        """
        return _standard_uncertainty(instrument.mount_U_percent, self.relative_sd, 0.01)

    def assumed(self, campaign: Campaign) -> Iterator[Uncertainty]:
        """Yield the assumed deflection of the work ball's mount, and its assumed curvature.

        The curvature is left out if the field ``curvature_um`` is zero. Each value has a standard
        uncertainty. That of the deflection comes from the certificate in ``campaign`` or, without a
        certificate, from the field ``relative_sd``. The curvature is assumed to be zero, with the
        standard uncertainty ``curvature_um``.
        """
        nominal = campaign.mount.deflection_um_per_bar * 1e-3
        sd = self._relative_sd(campaign.instrument) * nominal
        yield assumption(campaign, "mount", "mount_U_percent", sd, nominal)
        if self.curvature_um:
            yield assumption(campaign, "mount_curvature", "", self.curvature_um * 1e-3)

    @classmethod
    def nominal(cls, coefficient: str, campaign: Campaign) -> float:
        """Return the mount's deflection per pressure that a campaign states [mm/bar].

        The readings are compensated for this deflection; the coefficient ``mount`` is its error.
        The curvature has no nominal value.
        """
        if coefficient == "mount":
            return campaign.mount.deflection_um_per_bar * 1e-3
        return 0.0

    @classmethod
    def unit_of(cls, coefficient: str) -> Unit:
        """Return the unit of a coefficient of the mount's deflection, given the coefficient's name.

        The ratio of deflection to pressure has the unit µm/bar. The curvature has the unit µm,
        because it is the deviation of the deflection from a straight line.
        """
        return Term.unit if coefficient == "mount_curvature" else cls.unit

    @classmethod
    def describe(cls, coefficient: str) -> str:
        """Return words for a coefficient of the mount's deflection, given its name.

        For example, the coefficient ``mount`` is described as "mount deflection".
        """
        if coefficient == "mount_curvature":
            return "curvature of the mount's deflection"
        return "mount deflection"


@dataclass(frozen=True)
class ForceError(Term):
    """Errors of the force: a gain error, a curvature and a random error of every test.

    The error of the force is the sum of three parts: the gain error times the force F; the
    curvature times F_max q(F) with q(F) = 4 (F/F_max)(1 − F/F_max), where F_max is the largest
    force of the campaign; and a random error. If ``curvature_sd`` is 0, there is no curvature. The
    resulting error of the reading is the error of the force times j_C·Ĉ, the estimated change of
    the reading per newton. Ĉ are the estimated compliances, and j_C is the reading per unit force
    and compliance. The prior sds follow from the load cell's certificate, if there is one.

    Examples
    --------
    >>> force_error = lb.terms.ForceError(gain_sd=0.005, curvature_sd=0.0)
    >>> [(assumed.name, assumed.sd, assumed.unit) for assumed in force_error.assumed(campaign)]
    [('force_gain', 0.005, '1'), ('force_random', 4.0, 'N')]
    """

    #: prior sd of the gain error of the bar force, as a fraction of the force; used if no
    #: certificate states an uncertainty
    gain_sd: float = 0.01
    #: prior sd of the curvature of the force error, as a fraction of the largest force. The
    #: curvature is the deviation of the force error from a straight line at half of the largest
    #: force. This sd is used if no certificate states the linearity. If it is 0, there is no
    #: curvature.
    curvature_sd: float = 0.01
    #: prior sd of the random error of the bar force in every test [N]; used if no certificate
    #: states this sd
    random_sd_N: float = 4.0
    stem = ("force_gain", "force_curvature", "force_random")
    unit = Unit("1", 1e-2, "%")
    calibration = "a calibration of the force"
    remedy = "Calibrate the force."
    instrument = True
    common = True

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        """Return the columns of the design matrix for the three kinds of force error.

        They are gain error, curvature and random error. ``setting`` describes the test conditions.
        A column holds, for every test, the change of the reading per unit of one coefficient.
        """
        deflection = (setting.elastic @ setting.compliance_estimate)[:, :, None]
        sd = self._sd_by_name(setting.instrument)
        forces = {
            "force_gain": setting.force_N,
            "force_curvature": setting.largest_force_N * setting.bow,
        }
        columns = []
        for name, force in forces.items():
            if name in sd:
                values = force[:, None, None] * deflection
                columns.append(Columns((name,), values, np.array([sd[name]])))
        random_sd = np.array([sd["force_random"]])
        return (*columns, Columns(("force_random",), deflection, random_sd, private=True))

    def _sd_by_name(self, instrument: Instrument) -> dict[str, float]:
        """Return a dict with the prior sds of the force errors; its keys name the coefficients.

        An sd comes from the certificate in ``instrument`` if the certificate states it, and
        otherwise from the fields of the term. The linearity in a certificate is taken as the
        half-width of a uniform distribution.
        """
        sd = {
            "force_gain": _standard_uncertainty(instrument.force_U_percent, self.gain_sd, 0.01),
        }
        if self.curvature_sd:
            linearity = instrument.force_linearity_percent
            sd["force_curvature"] = self.curvature_sd
            if linearity is not None:
                sd["force_curvature"] = float(0.01 * linearity / np.sqrt(3.0))
        random = instrument.force_random_N
        sd["force_random"] = self.random_sd_N if random is None else random
        return sd

    def assumed(self, campaign: Campaign) -> Iterator[Uncertainty]:
        """Yield the errors of the force that the term models, with their standard uncertainties.

        The errors are gain error, curvature (unless ``curvature_sd`` is zero) and random error.
        Standard uncertainties come from the certificate in ``campaign`` if it states them, and
        otherwise from the fields of the term.
        """
        certificates = {
            "force_gain": "force_U_percent",
            "force_curvature": "force_linearity_percent",
            "force_random": "force_random_N",
        }
        for name, sd in self._sd_by_name(campaign.instrument).items():
            yield assumption(campaign, name, certificates[name], sd)

    @classmethod
    def nominal(cls, coefficient: str, campaign: Campaign) -> float:
        """Return the logarithm of the slope of the force law that a campaign states.

        The slope is divided by that of the default force law. The force is in error by the gain g
        if the slope of the regulator is 1 + g times the stated slope. To first order, ln(1 + g) is
        g, so that the logarithm of the true slope is the nominal value plus the coefficient
        ``force_gain``. The other errors have no nominal values. Nor has the gain if the tests state
        forces that do not follow from their pressures by the law, such as those of a load cell.
        """
        if coefficient == "force_gain" and campaign.forces_follow_law:
            slope_ratio = campaign.force_law.slope_N_per_bar / ForceLaw().slope_N_per_bar
            return float(np.log(slope_ratio))
        return 0.0

    @classmethod
    def unit_of(cls, coefficient: str) -> Unit:
        """Return the unit of a coefficient of the force error, given the coefficient's name.

        The random error is in N. Gain error and curvature are fractions of a force; reports display
        them in %.
        """
        return Unit("N", 1.0, "N") if coefficient == "force_random" else cls.unit

    @classmethod
    def describe(cls, coefficient: str) -> str:
        """Return words for a coefficient of the force error, given its name.

        For example, force_gain is described as "force gain".
        """
        return coefficient.replace("_", " ")


@dataclass(frozen=True)
class Angle(Term):
    """Zero error of the angle, and lag of the recorded readings behind the motion of the bar.

    Both effects shift the readings by a small angle along the circle. A reading then changes by
    this angle times dρ/dθ. θ is the angle on the circle, and ρ = F j_C·Ĉ + j_G·Ê is the reading
    predicted from the estimated compliances Ĉ and geometric errors Ê; F is the force, j_C the
    reading per unit force and compliance, and j_G the reading per unit geometric error. The zero
    error is the same in all tests. The effect of the lag changes its sign with the direction of
    travel; tests without a direction count as clockwise.

    Examples
    --------
    >>> columns = lb.terms.Angle(sd_deg=0.1).columns(model.bind(campaign).setting)
    >>> columns[0].names
    ('angle_reference', 'angle_lag')
    >>> np.rad2deg(columns[0].sd)
    array([0.1, 0.1])
    """

    #: prior sd [°] of two errors of the angle: its zero error, and the angle by which the recorded
    #: readings lag behind the motion; used if no certificate states an uncertainty
    sd_deg: float = 0.1
    unit = Unit("rad", np.pi / 180.0, "°")
    calibration = "a check of the angle's reference"
    remedy = "Check the angle's reference and the lag of the trace."
    instrument = True

    def columns(self, setting: Setting) -> tuple[Columns, ...]:
        """Return the columns of the angle's zero error and of the lag of the readings.

        ``setting`` describes the test conditions. For every test, a column holds the change of the
        reading per radian of zero error or of lag.
        """
        slope = derivative(setting.fitted)
        lag = slope * setting.travel[:, None]
        values = np.stack([slope, lag], axis=2)
        sd = np.full(2, self._sd_rad(setting.instrument))
        return (Columns(("angle_reference", "angle_lag"), values, sd),)

    def _sd_rad(self, instrument: Instrument) -> float:
        """Return the standard uncertainty of the angle of the bar [rad].

        The uncertainty comes from a certificate in ``instrument`` or, without a certificate, is the
        field ``sd_deg`` of the term converted to rad.
        """
        return float(np.deg2rad(_standard_uncertainty(instrument.angle_U_deg, self.sd_deg)))

    def assumed(self, campaign: Campaign) -> Iterator[Uncertainty]:
        """Yield the standard uncertainties that the term assumes for the errors of the angle.

        The errors are the zero error of the angle, and the angle by which the recorded readings lag
        behind the motion. If ``campaign`` holds an expanded uncertainty (k = 2) of the angle from a
        certificate, both standard uncertainties are half of it. Otherwise both are equal to the
        field ``sd_deg``.
        """
        sd = self._sd_rad(campaign.instrument)
        for name in ("angle_reference", "angle_lag"):
            yield assumption(campaign, name, "angle_U_deg", sd)

    @classmethod
    def describe(cls, coefficient: str) -> str:
        """Return words for a coefficient of the angle's errors, given its name.

        For example, angle_lag is described as "angle lag".
        """
        return coefficient.replace("_", " ")
