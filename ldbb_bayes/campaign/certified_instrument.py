"""Certified properties of the instrument: of balls, bar, mount, force device and angles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from typing import Annotated

from pydantic import AfterValidator
from pydantic.dataclasses import dataclass

from ldbb_bayes.campaign.field_types import (
    STRICT,
    Certified,
    CertifiedAngle,
    Harmonic,
    Label,
    Number,
    Percent,
)
from ldbb_bayes.errors import InputError, check_known, require
from ldbb_bayes.files import raises_input_error
from ldbb_bayes.results import Shown

__all__ = ["Ball", "Instrument"]

# Largest peak-to-valley deviation from sphericity [µm] that ISO 3290-1 allows for a ball of each
# grade.
_SPHERICITY_BY_GRADE_UM = {
    "G3": 0.08,
    "G5": 0.13,
    "G10": 0.25,
    "G16": 0.4,
    "G20": 0.5,
    "G24": 0.6,
    "G28": 0.7,
    "G40": 1.0,
    "G100": 2.5,
    "G200": 5.0,
}


@raises_input_error("ball")
@dataclass(frozen=True, config=STRICT)
class Ball(Shown):
    """Form deviation of a ball, as stated by a certificate or by a grade of ISO 3290.

    A certificate states the deviation from sphericity, peak to valley. It may also state harmonics
    of the form deviation. Each harmonic a cos n(θ − phase) is given as (n, a [µm], phase [deg]),
    where θ is the angle on the ball; ``U_um`` is the expanded uncertainty (k = 2) of its cosine and
    sine coefficients. A harmonic is the amount by which readings are too large, like the length
    error of a bar. Where the surface stands out, readings are too small. To state the height of the
    surface, as roundness certificates give it, add 180°/n to its phase.

    Raises
    ------
    InputError
        If the grade is unknown or is given together with a deviation from sphericity; if only one
        of ``harmonics_um`` and ``U_um`` is given; or if an order is outside 2 to 12 or given twice.

    Examples
    --------
    >>> lb.Ball(grade="G20").stated_sphericity_um
    0.5
    >>> lb.Ball(harmonics_um=[(2, 0.05, 30.0)], U_um=0.02)
    Ball(harmonics_um=((2, 0.05, 30.0),), U_um=0.02)
    """

    #: deviation of the ball from sphericity, peak to valley [µm]
    sphericity_um: Certified | None = None
    #: grade of the ball in ISO 3290, from G3 to G200, given instead of ``sphericity_um``
    grade: str | None = None
    #: harmonics of the ball's form deviation, each as (order, amplitude [µm], phase [deg]): the
    #: amount by which readings are too large. The phase is that of the height of the ball's surface
    #: plus 180°/order
    harmonics_um: Annotated[Sequence[Harmonic], AfterValidator(tuple)] = ()
    #: expanded uncertainty (k = 2) of each cosine and sine coefficient of ``harmonics_um`` [µm]
    U_um: Certified | None = None
    #: name of the ball's calibration certificate; it does not influence any computed number
    certificate: Label | None = None

    def __post_init__(self) -> None:
        """Raise an `InputError` if grade, sphericity and harmonics of a ball are inconsistent."""
        if self.grade is not None:
            check_known("grade of a ball", [self.grade], _SPHERICITY_BY_GRADE_UM)
            require(
                self.sphericity_um is None,
                "a ball must have sphericity_um or grade, got both. Keep what its certificate"
                " says.",
            )
        orders = [order for order, _, _ in self.harmonics_um]
        require(
            len(set(orders)) == len(orders),
            f"harmonics_um must give each order once, got {orders}. Remove one.",
        )
        if bool(orders) != (self.U_um is not None):
            single = "harmonics_um" if orders else "U_um"
            raise InputError(
                f"harmonics_um and U_um of a ball must come together, got {single} alone. Give"
                " both: U_um is their expanded uncertainty (k = 2)."
            )

    @property
    def stated_sphericity_um(self) -> float | None:
        """Deviation from sphericity [µm] that the certificate or the grade states, or None."""
        if self.grade is None:
            return self.sphericity_um
        return _SPHERICITY_BY_GRADE_UM[self.grade]


@raises_input_error("instrument")
@dataclass(frozen=True, config=STRICT)
class Instrument(Shown):
    """Certified properties of balls, bar, mount, force device and angles.

    Fields with U in their names are expanded uncertainties (k = 2). If a field is None, the model
    assumes a value; the function `terms.uncertainties` lists the assumed values.

    Raises
    ------
    InputError
        For a field out of its range, and for an error of the bar's length without ``bar_U_um``.

    Examples
    --------
    >>> instrument = lb.Instrument(work=lb.Ball(grade="G20"), bar_U_um=1.0)
    >>> angle_deg = np.arange(0.0, 360.0, 5.0)
    >>> plan = lb.Plan([lb.CircularTest(500.0, angle_deg)], instrument=instrument)
    >>> bar = lb.terms.uncertainties(plan, [lb.terms.BarLength()]).assumed[0]
    >>> bar.sd, bar.unit
    (0.0005, 'mm')
    """

    #: form deviation of the work ball according to its certificate or grade
    work: Ball = field(default_factory=Ball)
    #: form deviation of the tool ball according to its certificate or grade
    tool: Ball = field(default_factory=Ball)
    #: error of the bar's length [µm]: the amount by which all readings are too large
    bar_length_error_um: Number = 0.0
    #: expanded uncertainty (k = 2) of the bar's length [µm]
    bar_U_um: Certified | None = None
    #: expanded uncertainty (k = 2) of the deflection of the work ball's mount, in percent of this
    #: deflection
    mount_U_percent: Percent | None = None
    #: expanded uncertainty (k = 2) of the gain of the force measurement, in percent
    force_U_percent: Percent | None = None
    #: largest deviation of the force measurement from a straight line, in percent of the largest
    #: force
    force_linearity_percent: Percent | None = None
    #: random error of the force in each test, as one standard deviation [N]
    force_random_N: Certified | None = None
    #: expanded uncertainty (k = 2) [deg] that applies to each of two errors of the angle: the zero
    #: error of the angle, and the angle by which the recorded readings lag behind the bar
    angle_U_deg: CertifiedAngle | None = None
    #: name of the bar's calibration certificate; no computed number depends on this name
    bar_certificate: Label | None = None
    #: name of the force device's calibration certificate; no computed number depends on this name
    force_certificate: Label | None = None

    def __post_init__(self) -> None:
        """Raise an `InputError` if the bar's length error is given without its uncertainty."""
        require(
            self.bar_U_um or not self.bar_length_error_um,
            "the bar's length error must come with its U_um, got it alone. Give the U of its"
            " certificate (k = 2).",
        )

    @property
    def certificates(self) -> dict[str, str]:
        """Dictionary with the names of the calibration certificates of the certified objects.

        The keys are the objects: bar, force device, work ball and tool ball. Objects without a
        certificate are left out.
        """
        name_by_object = {
            "bar": self.bar_certificate,
            "force device": self.force_certificate,
            "work ball": self.work.certificate,
            "tool ball": self.tool.certificate,
        }
        return {certified: name for certified, name in name_by_object.items() if name}
