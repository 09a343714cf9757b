"""What certificates say of balls, bar, mount, force and angle."""

from __future__ import annotations

from dataclasses import field

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
from ldbb_bayes.files import refusing
from ldbb_bayes.results import Shown

__all__ = ["Ball", "Instrument"]

# Deviation from sphericity that each grade of ISO 3290 allows [µm].
_SPHERICITY_BY_GRADE_UM = {
    "G3": 0.08,
    "G5": 0.13,
    "G10": 0.25,
    "G20": 0.5,
    "G40": 1.0,
    "G100": 2.5,
    "G200": 5.0,
}


@refusing("ball")
@dataclass(frozen=True, config=STRICT)
class Ball(Shown):
    """What a certificate, or a grade of ISO 3290, says of a ball's form.

    It says the deviation from sphericity, peak to valley, and the harmonics a cos n(θ − phase) in
    the ball's own angle, as (n, a [µm], phase [deg]), with the expanded uncertainty (k = 2) of each
    coefficient.
    """

    sphericity_um: Certified | None = None  #: deviation from sphericity, peak to valley
    grade: str | None = None  #: of ISO 3290: G3 to G200, in its place
    harmonics_um: tuple[Harmonic, ...] = ()  #: (order, amplitude [µm], phase [deg])
    U_um: Certified | None = None  #: of their coefficients
    certificate: Label | None = None  #: which one says so: a name, no number depends on it

    def __post_init__(self) -> None:
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
        """Deviation from sphericity as certificate or grade says [µm], None where neither does."""
        if self.grade is None:
            return self.sphericity_um
        return _SPHERICITY_BY_GRADE_UM[self.grade]


@refusing("instrument")
@dataclass(frozen=True, config=STRICT)
class Instrument(Shown):
    """What certificates say of balls, bar, mount, force and angle.

    U are expanded uncertainties (k = 2). None: the model's.
    """

    work: Ball = field(default_factory=Ball)  #: ball
    tool: Ball = field(default_factory=Ball)  #: ball
    bar_length_error_um: Number = 0.0  #: by which readings are too large
    bar_U_um: Certified | None = None  #: of the bar's length
    mount_U_percent: Percent | None = None  #: of its deflection
    force_U_percent: Percent | None = None  #: of the force's gain
    #: largest deviation from the line, of the largest force
    force_linearity_percent: Percent | None = None
    force_random_N: Certified | None = None  #: random error of every force, one sd
    angle_U_deg: CertifiedAngle | None = None  #: of reference and lag
    #: which certificate says so: names, no number depends on them
    bar_certificate: Label | None = None
    force_certificate: Label | None = None  #: likewise

    def __post_init__(self) -> None:
        require(
            self.bar_U_um or not self.bar_length_error_um,
            "the bar's length error must come with its U_um, got it alone. Give the U of its"
            " certificate (k = 2).",
        )

    @property
    def certificates(self) -> dict[str, str]:
        """Names of the certificates, by what they are of."""
        name_by_object = {
            "bar": self.bar_certificate,
            "force device": self.force_certificate,
            "work ball": self.work.certificate,
            "tool ball": self.tool.certificate,
        }
        return {certified: name for certified, name in name_by_object.items() if name}
