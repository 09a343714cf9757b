"""Names and units for display, and results with their uncertainty as metrologists write them.

Internal units are mm, N and rad; display units are, for example, µm and nm/N. Parameter names are
displayed as in the paper "A Novel Elasto-Geometric Model Exploiting Loaded Circular Test on a
Machine Tool", which defines the parameters.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

from ldbb_bayes.errors import InputError, require

__all__ = [
    "DISPLAY_UNITS",
    "MM_PER_INCH",
    "NO_VALUE",
    "UNITS_TO_WRITE",
    "U_PROBABILITY",
    "Statement",
    "counted",
    "digits_apart",
    "display_name",
    "display_unit",
    "inside_name",
    "interval_statement",
    "is_compliance_or_slope",
    "is_direct",
    "is_skewed",
    "is_slope",
    "keep_with_units",
    "needs_interval",
    "plus_minus",
    "ranked",
    "round_like",
    "round_uncertainty",
    "setting_to_inside",
    "state",
    "stated_decimals",
    "stiffness",
    "three_digits",
    "to_inside",
    "two_digits",
    "typeset",
    "value_and_uncertainty",
    "with_sign",
    "without_slopes",
]

T = TypeVar("T")
# Display unit of each internal unit of a compliance. The keys are the internal units. Each value is
# a pair: the factor from the internal unit to the display unit, and the label of the display unit.
_COMPLIANCE_UNITS = {
    "mm/N": (1e6, "nm/N"),
    "rad/N": (1e9, "nrad/N"),
    "rad/(N mm)": (1e9, "µrad/(N m)"),
}
# Display units of the internal units of quantities that are not compliances. The keys are the
# internal units. Each value is a pair: the factor from the internal unit to the display unit, and
# the label of the display unit.
_OTHER_UNITS = {
    "1": (1e6, "µm/m"),
    "1/mm": (1e9, "µm/m²"),
    "rad": (1e6, "µrad"),
    "mm": (1e3, "µm"),
    "N/mm": (1e-3, "N/µm"),
    "um": (1.0, "µm"),
    "deg": (1.0, "°"),
    "": (1.0, ""),
}


def _display_units() -> dict[str, tuple[float, str]]:
    """Return a dict with the display unit of each internal unit.

    The keys are the internal units, which are made of mm, N and rad. Each value is a pair: the
    factor from the internal unit to the display unit, and the label of the display unit.
    Coefficients of the change of a compliance with force are displayed per kN (linear) or per kN²
    (quadratic).
    """
    slopes = {}
    curvatures = {}
    for unit, (factor, label) in _COMPLIANCE_UNITS.items():
        slopes[f"{unit}/N"] = (factor * 1e3, f"{label} per kN")
        curvatures[f"{unit}/N^2"] = (factor * 1e6, f"{label} per kN²")
    return _COMPLIANCE_UNITS | slopes | curvatures | _OTHER_UNITS


# Display unit of each internal unit. The keys are the internal units, which are made of mm, N and
# rad. Each value is a pair: the factor from the internal unit to the display unit, and the label of
# the display unit.
DISPLAY_UNITS = _display_units()


class _Size(NamedTuple):
    """Size of a unit, and the exponents of length and force in its dimension.

    For angles and ratios, both exponents are zero. For mm/N, the exponent of length is 1, and the
    exponent of force is −1.
    """

    factor: float  # size of a unit, expressed in mm, N or rad: 1e-3 for µm
    length: int  # exponent of length in the dimension of a unit: 1 for mm/N
    force: int  # exponent of force in the dimension of a unit: −1 for mm/N


# Factors of the prefixes, such as k, that a user may write before the units m, N and rad.
_PREFIXES = {"n": 1e-9, "µ": 1e-6, "m": 1e-3, "": 1.0, "k": 1e3}


def _units_to_write() -> dict[str, _Size]:
    """Return a dict from names of units that a user may write, such as kN, to their conversions.

    A conversion has three numbers. The first is the value of the unit, expressed in mm, N or rad.
    The others are the exponents of length and of force in the dimension of the unit. For kN, the
    three numbers are 1000, 0 and 1. A user may also write quotients and squares of these units.
    """
    sizes = {
        "1": _Size(1.0, 0, 0),
        "%": _Size(1e-2, 0, 0),
        "ppm": _Size(1e-6, 0, 0),
        "°": _Size(math.pi / 180.0, 0, 0),
        "deg": _Size(math.pi / 180.0, 0, 0),
        "arcsec": _Size(math.pi / 648e3, 0, 0),
    }
    for prefix, factor in _PREFIXES.items():
        sizes[f"{prefix}m"] = _Size(factor * 1e3, 1, 0)
        sizes[f"{prefix}rad"] = _Size(factor, 0, 0)
        sizes[f"{prefix}N"] = _Size(factor, 0, 1)
    return sizes


# Conversions to mm, N and rad of the units that a user may write. The keys are the names of the
# units. A user may also write quotients and squares of these units.
UNITS_TO_WRITE = _units_to_write()
# Spaces at which no line may end: between a number and its unit, and beside ±.
_SPACE_BESIDE_UNIT = re.compile(
    r"(?<=\d) (?=(?:%|N|µm|mm|nm|µrad|nrad)(?![^\W\d_])|±)|(?<=±) (?=\d)"
    r"|(?<=[A-Z]) (?=±\s\d)|(?<=\(N) (?=mm?\))"
)
# Characters for the exponents of powers of ten: superscripts of the minus sign and digits.
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
# Units of settings, such as the standard deviation of a prior. The name of a setting ends with its
# unit: for example, the setting ``sd_um`` is in µm. The keys are such endings, and the values are
# the units.
_UNIT_BY_ENDING = {"um": "um", "mm": "mm", "N": "N", "rad": "rad", "deg": "°"}
# If the lower limit of a compliance's credible interval is below this fraction of the compliance's
# median, the compliance may be near zero. Its stiffness then has a lower limit, but no upper limit.
_NEAR_ZERO_SHARE = 0.2
# The function `ranked` sorts items by a number. Numbers below this fraction of the largest number
# are treated as zero, so that rounding errors do not affect the order.
_ZERO_SHARE = 1e-12
# Largest number of significant digits with which a limit and a value are compared. If their
# relative difference is at most ``_SAME_SIZE``, they may read alike.
_MOST_DIGITS = 6
_SAME_SIZE = 1e-5
# A credible interval is treated as skewed if the distance between the mean and the middle of the
# interval is above this fraction of half the interval's width.
_SKEWED_SHARE = 0.2
# Length of an inch [mm].
MM_PER_INCH = 25.4
# Text in place of a number that does not exist.
NO_VALUE = "–"
# Probability of the interval whose ends are stated where value ± U (k = 2) would not describe a
# result. It is the probability of value ± U itself for a normal distribution.
U_PROBABILITY = 0.95
# The expanded uncertainty U = 2 u does not describe a credible interval if it exceeds this multiple
# of half the interval's width. For a normal distribution it is 1.02 times that of an interval of 95
# %, and 1.2 times that of an interval of 90 %.
_HEAVY_TAILS = 1.5


def display_unit(unit: str) -> tuple[float, str]:
    """Return the factor from an internal unit to its display unit, and the display unit's label.

    For mm/N, the factor is 1e6 and the label is nm/N.
    """
    require(
        unit in DISPLAY_UNITS,
        f"unit must be one of {', '.join(DISPLAY_UNITS)}, got {unit!r}. Use one of the internal"
        " units.",
    )
    return DISPLAY_UNITS[unit]


def to_inside(text: str, unit: str, subject: str = "value", more: str = "") -> float:
    """Convert a text with a number and a unit to the number in an internal unit.

    For the text "0.5 nm/N" and the internal unit mm/N, the result is 5e-7. Any unit of the same
    kind as the internal unit may be used. Examples are nm/N, µm/kN or um/kN for a compliance,
    nm/N/kN or "nm/N per kN" for its change with force, and µrad/(N m) for a rotation.

    Parameters
    ----------
    text
        Number and unit.
    unit
        Internal unit, made of mm, N and rad, such as mm/N; empty for a ratio, which is a number
        without a unit.
    subject
        Name of the quantity, for the error message.
    more
        Further advice that is appended to the error message for a missing or wrong unit.

    Returns
    -------
    float
        The number in the internal unit.

    Raises
    ------
    InputError
        If the text is not a number with a unit of the same kind as ``unit``. If ``unit`` is empty,
        the text must be a number without a unit. The error is also raised if the number is too
        large for a computer, as 1e999 is, before or after the conversion.
    """
    match = re.fullmatch(
        r"([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)(.*)",
        text.strip().replace("−", "-"),
        re.IGNORECASE,
    )
    if unit == "":
        return _number_without_unit(match, text, subject)
    written = None
    if match is not None:
        written = _size_of(match[2])
    wanted = _size_of(unit)
    if match is None or written is None or wanted is None or written[1:] != wanted[1:]:
        label = DISPLAY_UNITS[unit][1] if unit in DISPLAY_UNITS else unit
        raise InputError(
            f"{subject} must be a number with its unit, got {text!r}. Write it in {label}, like 0.5"
            f" {label}.{more}"
        )
    # The converted number is rounded to fifteen digits, so that 60 nm/N is 6e-5 mm/N and not
    # 6.000000000000001e-05.
    number = float(f"{float(match[1]) * (written.factor / wanted.factor):.15g}")
    _check_finite(number, text, subject)
    return number


def _number_without_unit(match: re.Match[str] | None, text: str, subject: str) -> float:
    """Return the number in a text that must not contain a unit.

    ``match`` is the match of a regular expression: its group 1 is the number, and its group 2 holds
    the characters after the number. ``match`` is None if the text does not begin with a number.
    Raise an `InputError` if ``text`` is not a finite number alone; ``subject`` is the name of the
    quantity in the message.
    """
    if match is None or match[2].strip():
        raise InputError(f"{subject} must be a number without a unit, got {text!r}. Write 1.5.")
    number = float(match[1])
    _check_finite(number, text, subject)
    return number


def _check_finite(number: float, text: str, subject: str) -> None:
    """Raise an `InputError` if a number that was read from a text, such as 1e999, is infinite.

    The message quotes ``text``, and calls the quantity ``subject``.
    """
    require(
        math.isfinite(number),
        f"{subject} must be a finite number, got {text!r}. Correct it.",
    )


def setting_to_inside(name: str, value: Any, subject: str) -> Any:
    """Convert a setting from a text with a unit to a number in the unit that its name states.

    A setting is, for example, the standard deviation of a prior. For direct_mm_per_N, "60 nm/N" is
    6e-5; for sd_um, "3 µm" is 3. A setting whose name does not end with a unit is a ratio: "10 %"
    is 0.1. If the text of a ratio cannot be read as a number, it is returned unchanged. A value
    that is not a text is always returned unchanged.

    Parameters
    ----------
    name
        Name of the setting, such as sd_um.
    value
        Value of the setting.
    subject
        Name of the setting in error messages.
    """
    if not isinstance(value, str):
        return value
    numerator, _, denominator = name.partition("_per_")
    unit = _UNIT_BY_ENDING.get(numerator.rpartition("_")[2], "1")
    if "_" in denominator:
        unit += f"/({denominator.replace('_', ' ')})"
    elif denominator:
        unit += f"/{denominator}"
    try:
        return to_inside(value, unit, subject)
    except InputError:
        if unit == "1":
            return value
        raise


def _size_of(unit: str) -> _Size | None:
    """Return the factor that converts a unit to internal units, and the unit's dimension.

    Internal units are made of mm, N and rad; the factor for µm is 1e-3. The dimension consists of
    the exponents of length and force: 1 and −1 for mm/N. Return None if ``unit`` is not the name of
    a unit.
    """
    text = re.sub(r"\(([^()]*)\)", _as_quotients, unit.strip())
    text = re.sub(r"\s+per\s+", "/", text.replace("μ", "µ").replace("²", "^2"))
    factor = 1.0
    length = 0
    force = 0
    for k, term in enumerate(re.split(r"\s*/\s*", text)):
        name, _, power = term.partition("^")
        name = re.sub(r"^u(?=[mrN])", "µ", name)
        if name not in UNITS_TO_WRITE or power not in ("", "2"):
            return None
        exponent = int(power or 1)
        if k > 0:
            exponent = -exponent
        size = UNITS_TO_WRITE[name]
        factor *= size.factor**exponent
        length += exponent * size.length
        force += exponent * size.force
    return _Size(factor, length, force)


def _as_quotients(match: re.Match[str]) -> str:
    """Return the units in a bracket, such as (N m) in µrad/(N m), with slashes between them.

    ``match`` is the match of a regular expression, whose group 1 is the text in the bracket. In the
    example, the result is N/m. It takes the place of the bracket, and the whole unit becomes
    µrad/N/m.
    """
    return re.sub(r"[ ·*]+", "/", match[1].strip())


def is_direct(name: str) -> bool:
    """Return whether a parameter with this name is a direct compliance, such as C_XXX.

    A direct compliance is the displacement per force in the direction of the force; its reciprocal
    is a stiffness.
    """
    return re.fullmatch(r"C_([XYZ])\1.", name) is not None


def is_compliance_or_slope(name: str) -> bool:
    """Return whether a parameter with this name is a compliance or a slope of one.

    The names of compliances, such as C_XXX, and of their slopes, such as C_XXX_1, begin with C_.
    Those of geometric errors, such as E_XX1, begin with E_.
    """
    return name.startswith("C_")


def is_slope(name: str) -> bool:
    """Return whether a parameter with this name is a slope of a compliance, such as C_XXX_1.

    A slope states how a compliance changes with force. The last digit of its name is 1 for the
    linear change and 2 for the quadratic change.
    """
    return re.fullmatch(r"C_.*_\d", name) is not None


def without_slopes(names: Iterable[str]) -> list[str]:
    """Return ``names`` without the names of slopes, or all ``names`` if they are all slopes.

    Slopes are parameters that state how a compliance changes with force (`is_slope`).
    """
    listed = list(names)
    return [name for name in listed if not is_slope(name)] or listed


def display_name(name: str) -> str:
    """Return a parameter's name as the paper prints it: E_C(0Y)X for E_C0YX."""
    return re.sub(r"^(E_.)(0.)(.)$", r"\1(\2)\3", name)


def inside_name(text: str) -> str:
    """Return a parameter's name as files and options write it: E_C0YX for E_C(0Y)X."""
    return re.sub(r"^(E_.)\((0.)\)(.)$", r"\1\2\3", text.strip())


def ranked(items: Iterable[T], key: Callable[[T], float], *, tolerance: float = 1e-6) -> list[T]:
    """Return items in descending order of a number, such as the share of a variance.

    ``key`` is a function that returns this number for an item. Items keep their original order if
    the relative difference of their numbers is at most ``tolerance``; rounding errors therefore do
    not affect the order. Numbers below 1e-12 times the largest are treated as zero.
    """
    entries = [_Ranked(key(item), i, item) for i, item in enumerate(items)]
    entries.sort(key=_largest_key_first)
    finite_sizes = [abs(entry.key) for entry in entries if math.isfinite(entry.key)]
    zero = _ZERO_SHARE * max(finite_sizes, default=0.0)
    ordered: list[T] = []
    while entries:
        largest = entries[0].key
        width = 0.0
        if math.isfinite(largest):
            width = max(tolerance * abs(largest), zero)
        tied = [entry for entry in entries if entry.key >= largest - width]
        entries = entries[len(tied) :]
        ordered += [entry.item for entry in sorted(tied, key=_position)]
    return ordered


class _Ranked(NamedTuple):
    """An item that `ranked` sorts, with the number by which it is sorted.

    ``key`` is this number, and ``position`` the index of ``item`` in the original order.
    """

    key: float
    position: int
    item: Any


def _largest_key_first(entry: _Ranked) -> tuple[float, int]:
    """Return a key with which Python sorts items by a number, the largest number first.

    ``entry`` holds an item and its number. Items with equal numbers keep their original order.
    """
    return -entry.key, entry.position


def _position(entry: _Ranked) -> int:
    """Return the position that an item had before the function `ranked` sorted the items."""
    return entry.position


def counted(number: int, noun: str) -> str:
    """Return a number with its noun, such as "1 campaign" or "3 campaigns".

    Parameters
    ----------
    number : int
        The number.
    noun : str
        The noun in the singular. Its plural ends in s.

    Returns
    -------
    str

    Examples
    --------
    >>> counted(1, "test"), counted(12, "test")
    ('1 test', '12 tests')
    """
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def round_uncertainty(uncertainty: float, digits: int = 2) -> tuple[str, int]:
    """Return an uncertainty rounded to significant digits as text, and its number of decimals.

    ``digits`` is the number of significant digits. The number of decimals is negative if digits
    left of the decimal point are rounded: −1 means rounded to tens. An uncertainty that is negative
    or not finite gives a question mark.
    """
    if uncertainty == 0:
        return "0", digits
    if not math.isfinite(uncertainty) or uncertainty < 0:
        return "?", digits
    exponent = int(f"{uncertainty:.{digits - 1}e}".partition("e")[2])
    decimals = digits - 1 - exponent
    return round_like(uncertainty, decimals), decimals


def two_digits(value: float | None, factor: float = 1.0) -> str:
    """Return a number with two significant digits and no exponent, as text.

    Parameters
    ----------
    value
        Number, which may be negative; None or a number that is not finite gives a dash.
    factor
        Factor from the unit of the value to the unit shown.

    Returns
    -------
    str
        Number as text.
    """
    if value is None or not math.isfinite(value):
        return NO_VALUE
    sign = "−" if value < 0 else ""
    return sign + round_uncertainty(abs(value) * factor)[0]


def digits_apart(limit: float, values: Iterable[float], factor: float = 1.0) -> list[str]:
    """Return a limit and values as texts in which no value that differs from the limit reads as it.

    Each text has two significant digits, or as many more as are needed, at most six.

    Parameters
    ----------
    limit
        Limit, above zero.
    values
        Values to be compared with the limit.
    factor
        Factor from the unit of the values to the unit shown.

    Returns
    -------
    list
        Text of the limit, followed by the text of each value.

    Examples
    --------
    >>> from ldbb_bayes.units import digits_apart
    >>> digits_apart(5.4e-6, [5.43e-6, 9.27e-6], factor=1e6)
    ['5.40', '5.43', '9.27']
    """
    sizes = [limit * factor, *(value * factor for value in values)]
    differing = [size for size in sizes if not math.isclose(size, sizes[0], rel_tol=_SAME_SIZE)]
    for digits in range(2, _MOST_DIGITS + 1):
        text_of_limit = round_uncertainty(sizes[0], digits)[0]
        if all(round_uncertainty(size, digits)[0] != text_of_limit for size in differing):
            break
    return [round_uncertainty(size, digits)[0] for size in sizes]


def three_digits(value: float) -> str:
    """Return ``value`` as text with three significant digits.

    A value of 1000 or more is written as a whole number.
    """
    return f"{value:.3g}" if value < 999.5 else f"{value:.0f}"


def round_like(value: float, decimals: int) -> str:
    """Return a value rounded to a number of decimals, as text.

    A negative number of decimals rounds left of the decimal point: −1 rounds to tens. A value that
    is rounded to zero has no sign. A value that is not finite gives a question mark.
    """
    if not math.isfinite(value):
        return "?"
    rounded = round(value, decimals) or 0.0
    return f"{rounded:.{max(decimals, 0)}f}"


def with_sign(value: float, decimals: int) -> str:
    """Return a value with its sign and a number of decimals, as text.

    A value that would be rounded to zero keeps its sign: it is stated with one significant digit.
    Below a hundredth of the last decimal it is stated as zero, which has no sign.

    Parameters
    ----------
    value
        Value; one that is not finite is stated as it is.
    decimals
        Number of decimals, zero or above.

    Returns
    -------
    str
        Value as text.

    Examples
    --------
    >>> from ldbb_bayes.units import with_sign
    >>> [with_sign(value, 1) for value in (-8.44, 2.0, -0.032, 0.0)]
    ['-8.4', '+2.0', '-0.03', '0.0']
    """
    size = abs(value)
    if size < 10.0 ** -(decimals + 2):
        return f"{0.0:.{decimals}f}"
    if float(f"{size:.{decimals}f}") == 0.0:
        return f"{value:+.1g}"
    return f"{value:+.{decimals}f}"


def value_and_uncertainty(value: float, uncertainty: float) -> tuple[str, str]:
    """Return a value and its uncertainty as texts, rounded to the same decimal place.

    The uncertainty has two significant digits.
    """
    text, decimals = round_uncertainty(uncertainty)
    return round_like(value, decimals), text


@dataclass(frozen=True)
class Statement:
    """A result and its uncertainty in the same unit, as texts that metrologists would write."""

    #: value of the result as text, rounded to the decimal place of the standard uncertainty
    value: str
    u: str  #: standard uncertainty of the result as text, with two significant digits
    #: expanded uncertainty (k = 2) of the result as text. If the distribution is skewed, this text
    #: states instead the distances from the value to the ends of the credible interval, as +a / −b.
    #: If the value is outside the interval, the text is "see interval".
    expanded: str
    ends: tuple[str, str]  #: lower and upper limit of the credible interval of the result, as texts
    unit: str  #: display unit of the result's value, uncertainties and limits, such as nm/N

    @property
    def interval(self) -> str:
        """Credible interval of a result as text: lower and upper limit in brackets."""
        return f"[{self.ends[0]}, {self.ends[1]}]"


def state(mean: float, sd: float, interval: tuple[float, float], unit: str) -> Statement:
    """Return a result and its uncertainty as texts, in the display unit, such as nm/N.

    ``mean`` is the value, ``sd`` its standard uncertainty and ``interval`` its credible interval.
    All of them are in the internal unit ``unit``, such as mm/N.
    """
    factor, label = display_unit(unit)
    middle = mean * factor
    low = interval[0] * factor
    high = interval[1] * factor
    u, decimals = round_uncertainty(sd * factor)
    expanded = round_uncertainty(2.0 * sd * factor)[0]
    if needs_interval(mean, sd, interval):
        expanded = "see interval"
        if low <= middle <= high:
            above = round_like(high - middle, decimals)
            below = round_like(middle - low, decimals)
            expanded = f"+{above} / −{below}"
    ends = (_with_minus_sign(low, decimals), _with_minus_sign(high, decimals))
    return Statement(_with_minus_sign(middle, decimals), u, expanded, ends, label)


def interval_statement(interval: tuple[float, float], unit: str) -> Statement:
    """Return the limits of an interval as texts, in the display unit, such as nm/N.

    The limits are rounded to two significant digits of a quarter of the interval's width. They are
    in the internal unit ``unit``, such as mm/N. The value is the middle of the interval.
    """
    low, high = interval
    return state(0.5 * (low + high), 0.25 * (high - low), interval, unit)


def _with_minus_sign(value: float, decimals: int) -> str:
    """Return a value as text, with ``decimals`` decimals and a true minus sign."""
    return round_like(value, decimals).replace("-", "−")


def is_skewed(mean: float, interval: tuple[float, float]) -> bool:
    """Return whether a credible interval is skewed about the mean of its distribution.

    The interval is skewed if its middle differs from the mean by more than a tenth of the
    interval's width. ``interval`` holds the lower and the upper end of the interval, in the same
    unit as ``mean``.
    """
    low, high = interval
    return abs(low + high - 2.0 * mean) > _SKEWED_SHARE * (high - low)


def needs_interval(mean: float, sd: float, interval: tuple[float, float]) -> bool:
    """Return whether value ± U would not describe a result, so that its interval must be stated.

    This is the case if the credible interval is skewed (`is_skewed`), or if U = 2 u is much larger
    than half the width of the interval: a few improbable, very large values can then dominate the
    standard uncertainty u. ``mean`` is the value, ``sd`` its standard uncertainty, and ``interval``
    its credible interval, all in the same unit.
    """
    low, high = interval
    return is_skewed(mean, interval) or 2.0 * sd > _HEAVY_TAILS * 0.5 * (high - low)


def stiffness(median: float, interval: tuple[float, float]) -> str:
    """Return a stiffness [N/µm] with its credible interval as text, from a compliance [mm/N].

    ``median`` is the median of the compliance, and ``interval`` its credible interval. If the lower
    limit of the interval is not positive, or is below a fifth of the median, the text states only a
    lower limit of the stiffness. If the upper limit of the interval is not positive, the text is
    empty.
    """
    low, high = interval
    if high <= 0.0:
        return ""
    if low < _NEAR_ZERO_SHARE * median or low <= 0.0:
        limit = 1e-3 / high
        return f"at least {round_like(limit, 2 - math.floor(math.log10(limit)))}"
    _, decimals = round_uncertainty(1e-3 / median - 1e-3 / high)
    middle = round_like(1e-3 / median, decimals)
    lower = round_like(1e-3 / high, decimals)
    upper = round_like(1e-3 / low, decimals)
    return f"{middle} [{lower}, {upper}]"


def stated_decimals(mean: float, sd: float, interval: tuple[float, float], unit: str) -> int:
    """Return the number of decimals with which a value is stated beside its expanded uncertainty.

    They are those of U (k = 2) with two significant digits, or those of the standard uncertainty if
    value ± U would not describe the interval (`needs_interval`). The number refers to the display
    unit and is negative if digits left of the decimal point are rounded, see `round_uncertainty`.
    ``mean`` is the value, ``sd`` its standard uncertainty and ``interval`` its credible interval.
    All of them are in the internal unit ``unit``, such as mm/N.
    """
    factor, _ = display_unit(unit)
    uncertainty = sd if needs_interval(mean, sd, interval) else 2.0 * sd
    return round_uncertainty(uncertainty * factor)[1]


def plus_minus(mean: float, sd: float, interval: tuple[float, float], unit: str) -> str:
    """Return a result as text in the display unit: value ± expanded uncertainty (k = 2).

    ``mean`` is the value, ``sd`` its standard uncertainty and ``interval`` its credible interval.
    All of them are in the internal unit ``unit``, such as mm/N. If value ± U would not describe the
    interval (`needs_interval`), the text states the value and the interval instead.
    """
    factor, label = display_unit(unit)
    if needs_interval(mean, sd, interval):
        statement = state(mean, sd, interval, unit)
        return f"{statement.value} {statement.interval} {label}"
    value, expanded = value_and_uncertainty(mean * factor, 2.0 * sd * factor)
    return f"{value.replace('-', '−')} ± {expanded} {label}"


def keep_with_units(text: str) -> str:
    """Return a text in which no line can end before or within a unit, or beside ±.

    The spaces there become no-break spaces.
    """
    return _SPACE_BESIDE_UNIT.sub("\u00a0", text)


def typeset(text: str) -> str:
    """Return a text with true minus signs and powers of ten, such as −5.85 and 3.1·10⁻⁵.

    A hyphen before a number becomes a minus sign, and 3.1e-05 becomes 3.1·10⁻⁵.
    """
    text = re.sub(r"(?<=\d)e([+-])0*(\d+)\b", _power_of_ten, text)
    return re.sub(r"(?<![\w./\-])-(?=\.?\d)", "−", text)


def _power_of_ten(match: re.Match[str]) -> str:
    """Return the text of a power of ten, such as ·10⁻⁵, for an exponent such as e-05.

    Group 1 of ``match`` is the sign of the exponent, and group 2 its digits without leading zeros.
    """
    exponent = match[1].replace("+", "") + match[2]
    return f"·10{exponent.translate(_SUPERSCRIPTS)}"
