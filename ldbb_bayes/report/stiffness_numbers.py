"""Stiffness by direction for the test certificate, with the directions in words."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ldbb_bayes.analysis.tolerances import name_in_plane
from ldbb_bayes.report.stated_quantity import StatedQuantity
from ldbb_bayes.report.translation import Words
from ldbb_bayes.units import (
    needs_interval,
    round_like,
    state,
    three_digits,
    value_and_uncertainty,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ldbb_bayes.analysis.directional_stiffness import (
        DirectionalStiffness,
        PlaneStiffness,
        PrincipalAxis,
    )
    from ldbb_bayes.analysis.stated_quantities import AxialDirection, StatedValue

__all__ = ["principal_direction", "stiffness_quantities"]

_N_PER_UM = 1e-3  # factor from N/mm to N/µm


def stiffness_quantities(
    result: DirectionalStiffness, words: Words, circles: Mapping[str, str]
) -> dict[str, StatedQuantity]:
    """Return the stiffness by direction as the test certificate states it.

    The quantities of each plane are the least and the greatest stiffness and their ratio. If only
    one plane was tested, the principal axis and the difference of the direct compliances are added.
    If three planes were tested, the principal stiffnesses in space are added.

    Parameters
    ----------
    result
        Stiffness by direction at one force.
    words
        Texts of the test certificate, in its language.
    circles
        For each plane, a phrase that says of which circle its stiffnesses are, or an empty string.

    Returns
    -------
    dict of str to StatedQuantity
        The keys are the names that tolerances use, such as ``k_min``, or ``k_min_YZ`` if several
        planes were tested.
    """
    planes = [plane.plane for plane in result.planes]
    stated = {}
    for plane in result.planes:
        circle = circles[plane.plane]
        is_only = len(planes) == 1
        for name, quantity in _quantities_of_plane(plane, circle, words, is_only=is_only).items():
            stated[name_in_plane(name, plane.plane, planes)] = quantity
    for principal in result.principal:
        for k, axis in enumerate(principal.axes, start=1):
            note = words("remarks.no_direction")
            if axis.is_determined:
                note = principal_direction(axis, words)
            symbol = f"k_{k}"
            title = words("quantities.principal", number=str(k))
            stated[symbol] = _stated_stiffness(title, symbol, axis.stiffness, note, words)
    return stated


def principal_direction(axis: PrincipalAxis, words: Words) -> str:
    """Return a text with the direction of a principal axis in space, and with its uncertainty.

    Parameters
    ----------
    axis
        Principal axis whose direction the readings determine.
    words
        Texts of the test certificate, in its language.

    Returns
    -------
    str
        The three components of the direction, and the half angle of the cone around it.
    """
    components = ", ".join(round_like(part, 2) for part in axis.direction)
    return words(
        "remarks.along",
        components=words.number(components.replace("-", "−")),
        cone=f"{axis.cone_deg:.0f}",
    )


def _quantities_of_plane(
    plane: PlaneStiffness, circle: str, words: Words, *, is_only: bool
) -> dict[str, StatedQuantity]:
    """Return a dict with the least and the greatest stiffness in a plane, and with their ratio.

    The keys are names such as ``k_min``. ``circle`` is a phrase that says of which circle they are,
    or an empty string. If ``is_only`` is true, no other plane was tested, and the dict also has the
    principal axis and the difference of the direct compliances.
    """
    where = circle
    if not is_only:
        where = words("quantities.plane", plane=plane.plane) + circle
    axis = plane.plane[0]
    stated = {}
    ends = {"k_min": (plane.least, plane.softest), "k_max": (plane.greatest, plane.stiffest)}
    for name, (value, direction) in ends.items():
        note = _direction_words(direction, axis, words)
        title = words(f"quantities.{name}", plane=where)
        stiffness = _stated_stiffness(title, name, value, note, words)
        stated[name] = replace(stiffness, where=_direction_in_sentence(direction, axis, words))
    ratio = plane.ratio
    limit = ""
    if ratio.only_lower_limit:
        limit = words("quantities.at_least", value=words.number(three_digits(ratio.ci_low)))
    stated["k_ratio"] = StatedQuantity(
        words=words("quantities.k_ratio", plane=where),
        symbol="k_max / k_min",
        estimate=ratio.median,
        sd=ratio.sd,
        interval=ratio.interval,
        unit="",
        limit=limit,
        note=words("remarks.gain_cancels"),
    )
    if is_only:
        stated |= _quantities_of_only_plane(plane, words)
    return stated


def _quantities_of_only_plane(plane: PlaneStiffness, words: Words) -> dict[str, StatedQuantity]:
    """Return a dict of two quantities that the certificate states if only one plane was tested.

    The key ``principal_axis`` is for the direction of the plane's principal axis. The key
    ``difference`` is for the difference of the direct compliances of the plane's two axes, such as
    C_XXX − C_YYY.
    """
    axis = plane.principal_axis
    limit = "–"
    note = words("remarks.no_direction")
    shift = 0.0
    if axis.is_determined:
        limit = ""
        note = _principal_axis_note(plane, words)
        shift = _turned(axis.angle_deg) - axis.angle_deg
    principal_axis = StatedQuantity(
        words=words("quantities.principal_axis", axis=plane.plane[0]),
        symbol="ψ",
        estimate=axis.angle_deg + shift,
        sd=axis.sd_deg,
        interval=(axis.ci_low_deg + shift, axis.ci_high_deg + shift),
        unit="deg",
        limit=limit,
        note=note,
    )
    difference = StatedQuantity(
        words=words("quantities.difference", axes=" − ".join(plane.plane)),
        symbol=plane.difference_name,
        estimate=plane.difference.mean,
        sd=plane.difference.sd,
        interval=plane.difference.interval,
        unit=plane.difference.unit,
        note=words("remarks.mount_cancels"),
    )
    return {"principal_axis": principal_axis, "difference": difference}


def _principal_axis_note(plane: PlaneStiffness, words: Words) -> str:
    """Return a remark that names the compliances from which a principal axis is computed.

    Where no tilt acts on the circle, the remark has no more to say. Otherwise, the directions of
    least and greatest stiffness, which stand above the principal axis on the certificate, are those
    along the whole circle. They also depend on the compliances that describe tilts of the axes.
    Without the remark, a reader might wonder why they differ from the principal axis.
    """
    direct_and_cross = {f"C_{axis}{axis}{axis}" for axis in plane.plane} | {plane.cross_name}
    remark = "remarks.at_centre"
    if not plane.counts_tilts:
        remark = "remarks.of_compliances"
    elif direct_and_cross.issuperset(plane.tensor_of):
        remark = "remarks.without_tilts"
    return words(remark, symbols=words.joined(plane.tensor_of))


def _stated_stiffness(
    title: str, symbol: str, value: StatedValue, note: str, words: Words
) -> StatedQuantity:
    """Return a stiffness in the form in which the test certificate states a quantity.

    ``title`` is the name of the stiffness in words, and ``note`` the remark on it. If only a lower
    limit of the stiffness is known, the certificate states only this limit.
    """
    limit = ""
    if value.only_lower_limit:
        lowest = three_digits(value.ci_low * _N_PER_UM)
        limit = words("quantities.at_least", value=words.number(lowest))
    return StatedQuantity(
        words=title,
        symbol=symbol,
        estimate=value.median,
        sd=value.sd,
        interval=value.interval,
        unit=value.unit,
        limit=limit,
        note=note,
    )


def _direction_words(direction: AxialDirection, axis: str, words: Words) -> str:
    """Return a string with a direction and its U (k = 2), such as "at 2° ± 17° from X".

    If the distribution of the direction is skewed, the distances to the ends of its credible
    interval stand in place of U. If the readings do not determine the direction, the string says
    so.
    """
    if not direction.is_determined:
        return words("remarks.no_direction")
    interval = (direction.ci_low_deg, direction.ci_high_deg)
    if needs_interval(direction.angle_deg, direction.sd_deg, interval):
        turn = _turned(direction.angle_deg) - direction.angle_deg
        turned_interval = (interval[0] + turn, interval[1] + turn)
        statement = state(direction.angle_deg + turn, direction.sd_deg, turned_interval, "deg")
        return words(
            "remarks.towards_skewed",
            angle=words.number(statement.value),
            distances=words.number(statement.expanded),
            axis=axis,
        )
    angle, expanded = value_and_uncertainty(_turned(direction.angle_deg), direction.U_deg)
    return words(
        "remarks.towards",
        angle=words.number(angle.replace("-", "−")),
        U=words.number(expanded),
        axis=axis,
    )


def _turned(angle_deg: float) -> float:
    """Convert the angle of an axial direction to an angle between −45° and 135°.

    ``angle_deg`` lies between 0° and 180°. An axial direction is the same as the opposite
    direction, so that 180° may be subtracted. If the direction is near one of the plane's two axes,
    the returned angle is near 0° or near 90°.
    """
    return angle_deg - 180.0 if angle_deg > 135.0 else angle_deg


def _direction_in_sentence(direction: AxialDirection, axis: str, words: Words) -> str:
    """Return a direction as a part of a sentence; see `_direction_words`."""
    if not direction.is_determined:
        return words("plain.no_direction")
    return _direction_words(direction, axis, words)
