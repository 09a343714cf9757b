"""Read option values that are ranges LO:HI:STEP or lists of forces, radii or ball angles."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ldbb_bayes.cli.values import numbers_in
from ldbb_bayes.errors import InputError, require

__all__ = ["read_clockings", "read_force_levels", "read_radii"]

# Largest number of values in a range LO:HI:STEP. A larger number is probably due to a mistyped
# step.
_MOST_VALUES = 5000
# Largest rounding error that is allowed in the number of steps of a range LO:HI:STEP. The range
# 0:0.3:0.1, for example, must have three steps and end at 0.3, although a computer cannot store 0.1
# exactly.
_ROUNDING = 1e-8
# Example of a list of angles [deg] that error messages show. Each entry WORK/TOOL consists of the
# angle of the work ball and the angle of the tool ball.
_PAIRS = "0/0,45/90"


def read_force_levels(entry: str, flag: str) -> tuple[float, ...]:
    """Return the forces [N] that the user typed as a range LO:HI:STEP or as a list.

    ``flag`` names the option in error messages.
    """
    return _read_range(entry, flag, "36:742:1", "36,364,742")


def read_radii(entry: str, flag: str) -> tuple[float, ...]:
    """Return the radii [mm] that the user typed as a range LO:HI:STEP or as a list.

    ``flag`` names the option in error messages.
    """
    return _read_range(entry, flag, "100:200:50", "100,150,200")


def _read_range(entry: str, flag: str, range_example: str, list_example: str) -> tuple[float, ...]:
    """Return the numbers that the user typed as the value of an option.

    The string ``entry`` is a range LO:HI:STEP, with both ends included, or a comma-separated list.
    ``flag`` names the option in error messages. ``range_example`` and ``list_example`` are examples
    of a range and of a list; a message about a mistyped value shows one of them or both.
    """
    if ":" not in entry:
        return numbers_in(entry, flag, f"{range_example} or {list_example}")
    limits = _finite_numbers(entry.split(":"))
    if len(limits) != 3 or limits[2] <= 0 or limits[1] < limits[0]:
        raise InputError(
            f"{flag} must be LO:HI:STEP with LO ≤ HI and STEP > 0, or a list, got {entry!r}. For"
            f" example {range_example} or {list_example}."
        )
    low, high, step = limits
    steps = (high - low) / step
    if steps > _MOST_VALUES:
        raise InputError(
            f"{flag} must give at most {_MOST_VALUES} values, got {steps:.3g}. Take a longer step."
        )
    values_below = math.ceil(steps - _ROUNDING)
    if values_below >= _MOST_VALUES:
        raise InputError(
            f"{flag} must give at most {_MOST_VALUES} values, got {values_below + 1}. Take a longer"
            " step."
        )
    return (*(low + step * k for k in range(values_below)), high)


def _finite_numbers(entries: Sequence[str]) -> tuple[float, ...]:
    """Return the numbers in strings; an empty tuple if any string is not a finite number."""
    try:
        numbers = tuple(map(float, entries))
    except ValueError:
        return ()
    return numbers if all(map(math.isfinite, numbers)) else ()


def read_clockings(entry: str, flag: str) -> tuple[tuple[float, float], ...]:
    """Return pairs of angles [deg] by which work ball and tool ball are turned about their stems.

    The typed string ``entry`` is a list or range of angles of the work ball alone, or a list of
    pairs WORK/TOOL. ``flag`` names the option in error messages. Raise an `InputError` for an angle
    of more than one turn.
    """
    if "/" not in entry:
        work_deg = _read_range(entry, flag, "0:315:45", "0,120,240")
        _check_turns(work_deg, flag)
        return tuple((angle, 0.0) for angle in work_deg)
    clockings = []
    for pair in entry.split(","):
        angles = numbers_in(pair, flag, _PAIRS, "/")
        if len(angles) != 2:
            raise InputError(
                f"{flag} must be all angles of the work ball, or all WORK/TOOL, got {entry!r}. For"
                f" example {_PAIRS}."
            )
        _check_turns(angles, flag)
        clockings.append((angles[0], angles[1]))
    return tuple(clockings)


def _check_turns(angles_deg: Sequence[float], flag: str) -> None:
    """Raise an `InputError` if a ball is turned by more than one turn.

    ``angles_deg`` are the angles of the balls [deg]. ``flag`` names the option in the message.
    """
    for angle in angles_deg:
        require(
            abs(angle) <= 360.0,
            f"{flag} must hold angles between -360 and 360 degrees, got {angle:g}. Correct it.",
        )
