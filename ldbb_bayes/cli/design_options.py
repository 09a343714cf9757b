"""Options of the command ``design``, and how their typed values are read."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import ldbb_bayes as lb
from ldbb_bayes.cli.options import Kind, Option, options_of
from ldbb_bayes.cli.ranges import read_clockings, read_force_levels, read_radii
from ldbb_bayes.cli.values import directions_in, names_in, pairs_in
from ldbb_bayes.errors import placed

__all__ = ["COST_OPTIONS", "DESIGN_OPTIONS"]


def _read_designs(entries: list[str], flag: str) -> dict[str, lb.Campaign]:
    """Return the campaigns or plans typed as NAME=PATH; the keys are the names that were typed."""
    designs = {}
    for name, path in pairs_in(entries, flag, "NAME=PATH").items():
        with placed(f"{flag} {name}"):
            designs[name] = lb.read_campaign(Path(path))
    return designs


def _read_prices(entry: str, flag: str) -> dict[str, float]:
    """Return the prices of certificates that a string states, such as ``balls G10=300,bar=150``.

    The keys of the result are the names of the certificates. ``flag`` names the option in error
    messages. Raise an `InputError` for a price that is not a number.
    """
    prices = {}
    for name, text in pairs_in(names_in(entry), flag, "NAME=PRICE").items():
        try:
            prices[name.strip()] = float(text)
        except ValueError:
            raise lb.InputError(
                f"{flag} must hold the price of each certificate, got {text!r} for"
                f" {name.strip()!r}. Write it like '{name.strip()}=150'."
            ) from None
    return prices


# Options of the command ``design`` of ``ldbb-bayes``; the keys are the names of the options.
DESIGN_OPTIONS: Mapping[str, Option] = options_of(
    "design",
    force_levels=Kind(str, read_force_levels),
    radii=Kind(str, read_radii),
    clockings=Kind(str, read_clockings),
    designs=Kind(list[str], _read_designs),
    directions=Kind(str, directions_in),
    prices=Kind(str, _read_prices),
)
# Options of the command design that state machine times (in minutes or hours) and the price of an
# hour. They are permitted only with --goal.
COST_OPTIONS = (
    "minutes_per_circle",
    "minutes_per_setup",
    "minutes_per_clocking",
    "price_per_hour",
    "hours",
)
