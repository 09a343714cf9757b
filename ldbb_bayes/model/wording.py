"""Nuisance coefficients and changes of parameters in words."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from ldbb_bayes.units import display_name, display_unit

__all__ = [
    "amount_words",
    "change_words",
    "company_words",
    "inside_unit",
    "joined",
    "natural_amount",
    "nuisance_words",
    "pattern",
    "signed",
    "term_words",
    "three",
    "unit_words",
]

_SMALL = 0.01
# Stem of the name → inside unit, inside value of one as it is told, and how that is called.
_UNITS: Mapping[str, tuple[str, float, str]] = {
    "mount": ("mm/bar", 1e-3, "µm/bar"),
    "force_gain": ("1", 1e-2, "%"),
    "hysteresis_force": ("mm/N", 1e-6, "µm/kN"),
    "drift_time": ("mm/h", 1e-3, "µm/h"),
    "drift_temperature": ("mm/K", 1e-3, "µm/K"),
}
_LENGTHS = ("mm", 1e-3, "µm")
_NATURAL: Mapping[str, tuple[float, str]] = {"ForceError": (0.01, "1 % of force gain")}


def natural_amount(term: str, name: str) -> float:
    """One of the unit it is told in."""
    return _NATURAL[term][0] if term in _NATURAL else unit_words(name)[0]


def inside_unit(name: str) -> str:
    """Unit of a nuisance coefficient in files and JSON."""
    return _told_in(name)[0]


def unit_words(name: str) -> tuple[float, str]:
    """What a nuisance coefficient is told in: inside value of one, and label."""
    return _told_in(name)[1:]


def _told_in(name: str) -> tuple[str, float, str]:
    return next((unit for stem, unit in _UNITS.items() if name.startswith(stem)), _LENGTHS)


def company_words(lead: str, amount: float, name: str, change: float) -> str:
    """0.5 times as much mount deflection; of another unit, how much."""
    (_, unit), (own, other) = unit_words(lead), unit_words(name)
    if unit != other:
        return f"{signed(change / own)} {other} of {nuisance_words(name)}"
    ratio = change / amount
    much = {1.0: "as much", -1.0: "minus as much"}.get(round(ratio, 6), f"{signed(ratio)} times as much")
    return f"{much} {nuisance_words(name)}"


def term_words(term: str) -> str:
    """BallForm → ball form, SetupShift → set-up shift; a parameter's name stays."""
    spaced = re.sub(r"(?<!^)(?=[A-Z])", " ", term).lower()
    return display_name(term) if "_" in term else spaced.replace("setup", "set-up")


_FORM = re.compile(r"(work_|tool_)?form(?:_(XY|YZ|ZX))?_(cos|sin)(\d+)")
_TRAVEL = re.compile(r"hysteresis(_force)?(?:_(XY|YZ|ZX))?_(?:(cos|sin)(\d+)|0)")
_LENGTH = re.compile(r"bar_length(?:_([\d.]+))?")
_BALL = {"work_": "the work ball", "tool_": "the tool ball"}


def pattern(name: str) -> str:
    """form_cos2 →  in cos 2θ; empty where the term has a single column."""
    form, travel = _FORM.fullmatch(name), _TRAVEL.fullmatch(name)
    if form:
        ball = f" of {_BALL[form[1]]}" if form[1] else ""
        return f" in {form[3]} {form[4]}θ{ball}{_in_plane(form[2])}"
    if travel:
        return f" in {_order(travel)}{' times force' if travel[1] else ''}{_in_plane(travel[2])}"
    return ""


def _order(travel: re.Match[str]) -> str:
    if not travel[3]:
        return "order 0"
    return f"{travel[3]} θ" if travel[4] == "1" else f"{travel[3]} {travel[4]}θ"


def _in_plane(plane: str | None) -> str:
    return f" in plane {plane}" if plane else ""


def nuisance_words(name: str) -> str:
    """form_cos2 → 2-lobe form (cos 2θ)."""
    form, travel, length = (pattern.fullmatch(name) for pattern in (_FORM, _TRAVEL, _LENGTH))
    if form:
        ball = f"{_BALL[form[1]]}'s " if form[1] else ""
        return f"{ball}{form[4]}-lobe form ({form[3]} {form[4]}θ{_in_plane(form[2])})"
    if travel:
        order = _order(travel)
        return f"hysteresis{' in proportion to force' if travel[1] else ''} ({order}{_in_plane(travel[2])})"
    if length:
        return "bar length" + (f" at R = {length[1]} mm" if length[1] else "")
    if name.startswith("drift_"):
        over, what = name.removeprefix("drift_").split("_")
        moved = "the bar's length" if what == "length" else f"the centre along {what}"
        return f"drift of {moved} over {over}"
    return {"mount": "mount deflection", "force_gain": "force gain"}.get(name, name)


def amount_words(term: str, name: str, amount: float) -> str:
    """1.00 µm of bar length; 1 % of force gain."""
    if term in _NATURAL:
        return _NATURAL[term][1]
    one, unit = unit_words(name)
    return f"{three(amount / one)} {unit} of {nuisance_words(name)}"


def change_words(name: str, change: float, unit: str) -> str:
    """+6.67 µm/m of E_XX1."""
    factor, label = display_unit(unit)
    value = abs(change) * factor
    if value < _SMALL and label.startswith("µ"):
        value, label = value * 1e3, "n" + label[1:]
    return f"{'+' if change > 0 else '−'}{three(value)} {label} of {display_name(name)}"


def signed(ratio: float) -> str:
    """Two significant digits."""
    return f"{ratio:.2g}".replace("-", "−")


def three(value: float) -> str:
    """Three significant digits without an exponent."""
    if value == 0.0 or not np.isfinite(value):
        return f"{value:g}"
    decimals = max(2 - int(np.floor(np.log10(abs(float(f"{value:.2e}"))))), 0)
    return f"{value:.{decimals}f}" if decimals <= 6 else f"{value:.2e}"


def joined(parts: Sequence[str], word: str = "and") -> str:
    """a, b and c."""
    return f" {word} ".join(parts) if len(parts) < 3 else f"{', '.join(parts[:-1])} {word} {parts[-1]}"
