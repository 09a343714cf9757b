"""Force of the bar and deflection of the work ball's mount, from the regulator's pressure."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, StrictBool
from pydantic.dataclasses import dataclass

from ldbb_bayes.campaign.field_types import STRICT, Number, Positive
from ldbb_bayes.files import raises_input_error
from ldbb_bayes.results import Shown

__all__ = ["ForceLaw", "MountCompensation"]


@raises_input_error("force law ([force])")
@dataclass(frozen=True, config=STRICT)
class ForceLaw(Shown):
    """Force F of the bar as a function of the regulator's pressure P, F = slope · P + offset.

    The default values are valid for the bar in the published experiment (`embedded_campaign`). If
    only the force or only the pressure of a test is given, the missing quantity is computed with
    the campaign's force law.

    Examples
    --------
    >>> law = lb.campaign.ForceLaw(slope_N_per_bar=125.0, offset_N=-10.0)
    >>> law.force_N(2.0)
    240.0
    >>> law.pressure_bar(240.0)
    2.0
    """

    #: slope of the force law: increase of the bar's force per unit of the regulator's pressure
    #: [N/bar]
    slope_N_per_bar: Positive = 126.04
    #: offset of the force law: force of the bar at zero pressure of the regulator [N]
    offset_N: Number = -14.2

    def force_N(self, pressure_bar: float) -> float:
        """Return the force of the bar [N] at a given pressure of the regulator [bar]."""
        return self.slope_N_per_bar * pressure_bar + self.offset_N

    def pressure_bar(self, force_N: float) -> float:
        """Return the pressure of the regulator [bar] that produces a given force of the bar [N]."""
        return (force_N - self.offset_N) / self.slope_N_per_bar


@raises_input_error("mount ([mount])")
@dataclass(frozen=True, config=STRICT)
class MountCompensation(Shown):
    """Deflection of the work ball's mount, and whether it is compensated in the readings.

    The deflection is ``deflection_um_per_bar`` times the regulator's pressure in bar. If it is not
    compensated in the readings, the model adds the deflection to the predicted readings.

    Examples
    --------
    >>> lb.campaign.MountCompensation(deflection_um_per_bar=1.8, compensated=False)
    MountCompensation(deflection_um_per_bar=1.8, compensated=False)
    """

    #: nominal deflection of the work ball's mount per unit of the regulator's pressure [µm/bar]
    deflection_um_per_bar: Annotated[Number, Field(ge=0.0, le=1e3)] = 2.33
    #: whether the readings are compensated for the deflection of the work ball's mount
    compensated: StrictBool = True
