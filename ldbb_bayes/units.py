"""Names and units for reading: parameters as the paper prints them, inside units (mm, N, rad) as
users speak of them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from typing import Any, TypeVar

from ldbb_bayes.errors import InputError, require

__all__ = [
    "Statement",
    "display_name",
    "display_unit",
    "inside_name",
    "is_direct",
    "is_skewed",
    "plus_minus",
    "ranked",
    "round_like",
    "round_uncertainty",
    "setting_to_inside",
    "state",
    "stiffness",
    "to_inside",
    "typeset",
    "value_and_uncertainty",
]

T = TypeVar("T")
# By inside unit: factor and label for reading; of what changes with force per kN, per kN².
_OF_A_COMPLIANCE = {
    "mm/N": (1e6, "nm/N"),
    "rad/N": (1e9, "nrad/N"),
    "rad/(N mm)": (1e9, "µrad/(N m)"),
}
_UNITS: Mapping[str, tuple[float, str]] = {
    **_OF_A_COMPLIANCE,
    **{
        f"{unit}/N": (factor * 1e3, f"{label} per kN")
        for unit, (factor, label) in _OF_A_COMPLIANCE.items()
    },
    **{
        f"{unit}/N^2": (factor * 1e6, f"{label} per kN²")
        for unit, (factor, label) in _OF_A_COMPLIANCE.items()
    },
    "1": (1e6, "µm/m"),
    "1/mm": (1e9, "µm/m²"),
    "rad": (1e6, "µrad"),
    "mm": (1e3, "µm"),
    "N/mm": (1e-3, "N/µm"),
    "um": (1.0, "µm"),
    "": (1.0, ""),
}
# Units one may write: in mm and N, and their powers of length and force; angles and ratios have
# neither.
_PREFIXES = {"n": 1e-9, "µ": 1e-6, "m": 1e-3, "": 1.0, "k": 1e3}
_ATOMS: Mapping[str, tuple[float, int, int]] = {
    **{prefix + "m": (size * 1e3, 1, 0) for prefix, size in _PREFIXES.items()},
    **{prefix + "rad": (size, 0, 0) for prefix, size in _PREFIXES.items()},
    **{prefix + "N": (size, 0, 1) for prefix, size in _PREFIXES.items()},
    "1": (1.0, 0, 0),
    "%": (1e-2, 0, 0),
    "ppm": (1e-6, 0, 0),
    "°": (math.pi / 180.0, 0, 0),
    "arcsec": (math.pi / 648e3, 0, 0),
}
_ENDINGS = {"um": "um", "mm": "mm", "N": "N", "rad": "rad", "deg": "°"}
_HARDLY = 0.2
_ZERO = 1e-12


def display_unit(unit: str) -> tuple[float, str]:
    """Factor and label that turn an inside unit into the one for reading, the same everywhere."""
    require(
        unit in _UNITS,
        f"unit must be one of {', '.join(_UNITS)}, got {unit!r}. Use an inside unit.",
    )
    return _UNITS[unit]


def to_inside(text: str, unit: str, what: str = "value") -> float:
    """A number with its unit, "0.5 nm/N", as the number in an inside unit, here of mm/N: 5e-7.

    Any unit of the same kind will do: nm/N, µm/kN or um/kN; nm/N per kN, nm/N/kN; µrad/(N m),
    µrad/N/m. InputError for a number alone, and a unit of another kind.
    """
    parts = re.fullmatch(
        r"([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)(.*)",
        text.strip().replace("−", "-"),
        re.IGNORECASE,
    )
    written = _size(parts[2]) if parts else None
    wanted = _size(unit)
    if parts is None or written is None or wanted is None or written[1:] != wanted[1:]:
        label = _UNITS[unit][1] if unit in _UNITS else unit
        raise InputError(
            f"{what} must be a number with its unit, got {text!r}. Write it in {label}, like 0.5"
            f" {label}."
        )
    return float(f"{float(parts[1]) * (written[0] / wanted[0]):.15g}")


def setting_to_inside(name: str, value: Any, what: str) -> Any:
    """A setting written with its unit as the number in the unit that ends its name: "60 nm/N" for
    direct_mm_per_N is 6e-5, "3 µm" for sd_um is 3; a ratio, "10 %", where it names none. Anything
    else, such as a number, as it is."""
    if not isinstance(value, str):
        return value
    above, _, below = name.partition("_per_")
    unit = _ENDINGS.get(above.rpartition("_")[2], "1")
    unit += f"/({below.replace('_', ' ')})" if "_" in below else f"/{below}" if below else ""
    with suppress(InputError) if unit == "1" else nullcontext():
        return to_inside(value, unit, what)
    return value


def _size(unit: str) -> tuple[float, int, int] | None:
    """What a unit is in mm and N, and its powers of length and force; None for what is no unit."""
    text = re.sub(
        r"\(([^()]*)\)", lambda match: re.sub(r"[ ·*]+", "/", match[1].strip()), unit.strip()
    )
    text = re.sub(r"\s+per\s+", "/", text.replace("μ", "µ").replace("²", "^2"))
    size = 1.0
    length = 0
    force = 0
    for k, factor in enumerate(re.split(r"\s*/\s*", text)):
        atom, _, power = factor.partition("^")
        atom = re.sub(r"^u(?=[mrN])", "µ", atom)
        if atom not in _ATOMS or power not in ("", "2"):
            return None
        sign = (-1 if k else 1) * int(power or 1)
        one, of_length, of_force = _ATOMS[atom]
        size = size * one**sign
        length = length + sign * of_length
        force = force + sign * of_force
    return size, length, force


def is_direct(name: str) -> bool:
    """Whether a parameter is a translation along the force: its reciprocal is a stiffness."""
    return re.fullmatch(r"C_([XYZ])\1.", name) is not None


def display_name(name: str) -> str:
    """The name as the paper prints it: E_C0YX → E_C(0Y)X."""
    return re.sub(r"^(E_.)(0.)(.)$", r"\1(\2)\3", name)


def inside_name(text: str) -> str:
    """The name as files and options have it, of one as the paper prints it: E_C(0Y)X → E_C0YX."""
    return re.sub(r"^(E_.)\((0.)\)(.)$", r"\1\2\3", text.strip())


def ranked(items: Iterable[T], key: Callable[[T], float], *, tolerance: float = 1e-6) -> list[T]:
    """Return the items from the largest key to the smallest; those within the relative tolerance of
    one another keep their order. So what is named first does not hang on the rounding of a
    processor. A trillionth of the largest key counts as zero."""
    left = sorted(
        ((key(item), i, item) for i, item in enumerate(items)),
        key=lambda entry: (-entry[0], entry[1]),
    )
    zero = _ZERO * max((abs(value) for value, _, _ in left if math.isfinite(value)), default=0.0)
    found: list[T] = []
    while left:
        top = left[0][0]
        width = max(tolerance * abs(top), zero) if math.isfinite(top) else 0.0
        group = [entry for entry in left if entry[0] >= top - width]
        found += [item for _, _, item in sorted(group, key=lambda entry: entry[1])]
        left = left[len(group) :]
    return found


def round_uncertainty(uncertainty: float, digits: int = 2) -> tuple[str, int]:
    """The uncertainty to significant ``digits``, and the number of decimals it leaves (negative
    left of the point)."""
    if not math.isfinite(uncertainty) or uncertainty <= 0:
        return ("0" if uncertainty == 0 else "?"), digits
    decimals = digits - 1 - int(f"{uncertainty:.{digits - 1}e}".partition("e")[2])
    return round_like(uncertainty, decimals), decimals


def round_like(value: float, decimals: int) -> str:
    """The value rounded to a decimal place; a value that rounds to nothing has no sign."""
    return f"{round(value, decimals) or 0.0:.{max(decimals, 0)}f}" if math.isfinite(value) else "?"


def value_and_uncertainty(value: float, uncertainty: float) -> tuple[str, str]:
    """Value and uncertainty to the same place, the uncertainty with two significant digits."""
    text, decimals = round_uncertainty(uncertainty)
    return round_like(value, decimals), text


@dataclass(frozen=True)
class Statement:
    """A result as a metrologist writes it; every text without the unit."""

    value: str  # to the place of u
    u: str  # standard uncertainty, two significant digits
    expanded: (
        str  # U (k = 2); of a skewed distribution the distances to the ends of the interval, +a/−b
    )
    ends: tuple[str, str]  # of the credible interval
    unit: str

    @property
    def interval(self) -> str:
        """Both ends in brackets."""
        return f"[{self.ends[0]}, {self.ends[1]}]"


def state(mean: float, sd: float, interval: tuple[float, float], unit: str) -> Statement:
    """A result in a unit for reading, from numbers in an inside unit."""
    factor, label = display_unit(unit)
    middle, low, high = (number * factor for number in (mean, *interval))
    u, decimals = round_uncertainty(sd * factor)
    expanded = round_uncertainty(2.0 * sd * factor)[0]
    if is_skewed(mean, interval):
        above, below = (
            round_like(distance, decimals) for distance in (high - middle, middle - low)
        )
        expanded = f"+{above} / −{below}" if low <= middle <= high else "see interval"
    value, least, most = (
        round_like(number, decimals).replace("-", "−") for number in (middle, low, high)
    )
    return Statement(value, u, expanded, (least, most), label)


def is_skewed(mean: float, interval: tuple[float, float]) -> bool:
    """Whether the middle of the interval lies off the mean by more than a tenth of the interval's
    width."""
    low, high = interval
    return abs(low + high - 2.0 * mean) > 0.2 * (high - low)


def stiffness(median: float, interval: tuple[float, float]) -> str:
    """1/C in N/µm with its interval, from a compliance in mm/N.

    Only a lower limit where C may be a fifth of its median or less; nothing where C is negative.
    """
    low, high = interval
    if high <= 0.0:
        return ""
    if low < _HARDLY * median or low <= 0.0:
        limit = 1e-3 / high
        return f"at least {round_like(limit, 2 - math.floor(math.log10(limit)))}"
    _, decimals = round_uncertainty(1e-3 / median - 1e-3 / high)
    middle, least, most = (round_like(1e-3 / value, decimals) for value in (median, high, low))
    return f"{middle} [{least}, {most}]"


def plus_minus(mean: float, sd: float, interval: tuple[float, float], unit: str) -> str:
    """Value ± U (k = 2) to the same place and unit; value and interval where the distribution is
    skewed."""
    factor, label = display_unit(unit)
    if is_skewed(mean, interval):
        whole = state(mean, sd, interval, unit)
        return f"{whole.value} {whole.interval} {label}"
    value, expanded = value_and_uncertainty(mean * factor, 2.0 * sd * factor)
    return f"{value.replace('-', '−')} ± {expanded} {label}"


def typeset(text: str) -> str:
    """Return the text with minus signs before numbers and powers of ten in full: -5.85 → −5.85,
    3.1e-05 → 3.1·10⁻⁵."""
    raised = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
    text = re.sub(
        r"(?<=\d)e([+-])0*(\d+)\b",
        lambda own: f"·10{(own[1].replace('+', '') + own[2]).translate(raised)}",
        text,
    )
    return re.sub(r"(?<![\w./\-])-(?=\.?\d)", "−", text)
