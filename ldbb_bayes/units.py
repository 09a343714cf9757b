"""Names and units for reading: parameters as the paper prints them, inside units (mm, N, rad) as users speak of them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from types import MappingProxyType

from ldbb_bayes.errors import InputError

__all__ = ["DISPLAY_UNITS", "display_name", "display_unit", "is_direct", "reading_unit", "units_for"]

DISPLAY_UNITS: Mapping[str, tuple[float, str]] = MappingProxyType(
    {
        "mm/N": (1e3, "µm/N"),
        "mm/N/N": (1e6, "µm/N per kN"),
        "mm/N/N^2": (1e9, "µm/N per kN²"),
        "rad/N": (1e9, "nrad/N"),
        "rad/N/N": (1e12, "nrad/N per kN"),
        "rad/N/N^2": (1e15, "nrad/N per kN²"),
        "rad/(N mm)": (1e9, "µrad/(N m)"),
        "rad/(N mm)/N": (1e12, "µrad/(N m) per kN"),
        "rad/(N mm)/N^2": (1e15, "µrad/(N m) per kN²"),
        "1": (1e6, "µm/m"),
        "1/mm": (1e9, "µm/m²"),
        "rad": (1e6, "µrad"),
        "mm": (1e3, "µm"),
        "um": (1.0, "µm"),
    }
)


def display_unit(unit: str) -> tuple[float, str]:
    """Factor and label that turn an inside unit into one for reading: those of `units_for`, else of `DISPLAY_UNITS`.

    Raises
    ------
    InputError
        For a unit that is not one of ours.
    """
    if unit not in DISPLAY_UNITS:
        raise InputError(f"unit must be one of {', '.join(DISPLAY_UNITS)}, got {unit!r}. Use an inside unit.")
    return _CHOSEN.get().get(unit, DISPLAY_UNITS[unit])


_READABLE = 0.1
_CHOSEN: ContextVar[Mapping[str, tuple[float, str]]] = ContextVar("units chosen for reading", default=MappingProxyType({}))


def reading_unit(unit: str, *sizes: float) -> tuple[float, str]:
    """As in `DISPLAY_UNITS`, a thousand times smaller where every size would stay below 0.1: 0.058 µm/N → 58 nm/N.

    Parameters
    ----------
    sizes : float
        What will be shown, in the inside unit.
    """
    factor, label = DISPLAY_UNITS[unit]
    smaller = {"µ": "n", "n": "p"}[label[0]]
    if any(sizes) and all(abs(size) * factor < _READABLE for size in sizes):
        return factor * 1e3, smaller + label[1:]
    return factor, label


@contextmanager
def units_for(sizes: Mapping[str, Collection[float]]) -> Iterator[None]:
    """Choose one unit for each kind of number and keep to it: `display_unit` gives it until the block ends.

    Parameters
    ----------
    sizes : mapping of inside unit to sizes
        Of the numbers that will be shown.
    """
    token = _CHOSEN.set({unit: reading_unit(unit, *shown) for unit, shown in sizes.items()})
    try:
        yield
    finally:
        _CHOSEN.reset(token)


def is_direct(name: str) -> bool:
    """Whether a parameter is a translation along the force: its reciprocal is a stiffness."""
    return len(name) == 5 and name.startswith("C_") and name[2] == name[3] and name[2] in "XYZ"


def display_name(name: str) -> str:
    """The name as the paper prints it: E_C0YX → E_C(0Y)X."""
    if len(name) == 6 and name.startswith("E_") and name[3] == "0":
        return f"{name[:3]}({name[3:5]}){name[5]}"
    return name
