"""Radii that no bar has, such as the 0.1 of ``Radius: 0.1``, which may be in metres."""

from __future__ import annotations

from ldbb_bayes.errors import InputError

__all__ = ["check_radius_is_possible"]

# Smallest and largest radius of a circle that a ball bar measures, with a wide margin [mm].
_SMALLEST_MM = 10.0
_LARGEST_MM = 5000.0


def check_radius_is_possible(place: str, radius_mm: float | None) -> None:
    """Raise an error if no bar measures a circle of the radius that a file states.

    Parameters
    ----------
    place
        Name of the test in the error message.
    radius_mm
        Radius of the circle [mm]; None if the file states none.

    Raises
    ------
    InputError
        If the radius is below 10 mm or above 5 m.
    """
    if radius_mm is None or _SMALLEST_MM <= radius_mm <= _LARGEST_MM:
        return
    raise InputError(
        f"{place}: the radius must be {_SMALLEST_MM:g} to {_LARGEST_MM:g} mm, got {radius_mm:g} mm"
        " in the file. Write its unit into the file, or give --radius-mm."
    )
