"""Sliders of the browser page: their limits and their values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from ldbb_bayes.analysis.design.costs import Costs
from ldbb_bayes.errors import require

__all__ = ["COST_SLIDERS", "Slider", "slider_values"]


class Slider(NamedTuple):
    """A slider of the browser page: its default, lowest and highest value."""

    default: float
    lowest: float
    highest: float


_USUAL_COSTS = Costs()
# Sliders for what circles cost, with the names that the command ``design`` gives these options. The
# search for the cheapest campaign takes its costs from them, too.
COST_SLIDERS = {
    "minutes_per_circle": Slider(_USUAL_COSTS.minutes_per_circle, 0.5, 600),
    "minutes_per_setup": Slider(_USUAL_COSTS.minutes_per_setup, 0, 600),
    "minutes_per_clocking": Slider(_USUAL_COSTS.minutes_per_clocking, 0, 600),
    "price_per_hour": Slider(_USUAL_COSTS.price_per_hour, 1, 1e5),
}


def slider_values(settings: Mapping[str, Any], sliders: Mapping[str, Slider]) -> dict[str, float]:
    """Return the values of sliders as numbers; a slider without a value has its default.

    ``settings`` are the values that the page sent, and ``sliders`` the defaults and limits. The
    keys are the names of the sliders. Raise an `InputError` if a value is outside its limits.
    """
    values = {}
    for name, slider in sliders.items():
        value = settings.get(name, slider.default)
        is_number = isinstance(value, int | float) and math.isfinite(value)
        require(
            is_number and slider.lowest <= value <= slider.highest,
            f"{name} must be between {slider.lowest:g} and {slider.highest:g}, got {value!r}. Move"
            " its slider.",
        )
        values[name] = float(value)
    return values
