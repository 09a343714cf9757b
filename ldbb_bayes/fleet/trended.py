"""What `trend` finds: estimates over time with control limits, the probability of a change, how soon one would be found."""

from __future__ import annotations

import html
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ldbb_bayes.fleet.detection import Detection
from ldbb_bayes.notebook import table_html
from ldbb_bayes.report.rounding import plus_minus, round_uncertainty
from ldbb_bayes.units import display_name, display_unit, units_for

__all__ = ["LIMITS", "MostProbable", "ParameterChange", "Trend", "probability_words"]

Array = NDArray[Any]
LIMITS = 0.997
_UNLIKELY = 5e-4


@dataclass(frozen=True)
class ParameterChange:
    """A step of one parameter, inside units.

    Attributes
    ----------
    probability : float
        That this parameter is the one that changed.
    size, sd, interval
        Of the step, given that it is this parameter that changed.
    percent, percent_interval : float or None
        Of the level before, the interval of the change alone; None where the level is not known to a fifth.
    before : float
        Level before the step.
    level, level_sd : float
        Level at the last campaign, averaged over hypotheses.
    common_sd : float
        What the instrument's errors add to the level of all campaigns together; in no point, limit or level.
    """

    unit: str
    probability: float
    size: float
    sd: float
    interval: tuple[float, float]
    percent: float | None
    percent_interval: tuple[float, float] | None
    before: float
    level: float
    level_sd: float
    common_sd: float


@dataclass(frozen=True)
class MostProbable:
    """The one step that is named where a change is found.

    Attributes
    ----------
    parameter : str
        The one that most probably changed.
    place : int
        Of the campaign just before which it most probably did, given that it is this one; 1 is the second.
    change : ParameterChange
        Of this parameter at that time; its probability is that of both.
    """

    parameter: str
    place: int
    change: ParameterChange


@dataclass(frozen=True, eq=False)
class Trend:
    """Parameters of one machine over time.

    Attributes
    ----------
    machine : str or None
    campaigns : tuple of str, length n
        In order of time.
    dates : tuple of datetime or None, length n
    reference_force_N : float
    assumptions : mapping
        change_scale, repeatability (units of the prior's sd), probability, threshold, detect, ci, one_instrument, seed.
    probability : float
        That one parameter has changed once.
    by_time : ndarray, shape (n,)
        That it changed just before each campaign; the first is 0.
    parameters : mapping of name to ParameterChange
        Each whenever it was.
    most_probable : MostProbable
    scatter : tuple of float
        r, what the machine changes from campaign to campaign in units of the prior's sd: mean, ends of its interval.
    estimates : DataFrame
        One row per campaign and parameter, inside units: campaign, date, parameter, unit, estimate, sd, ci_low, ci_high (of this
        campaign alone), limit_low, limit_high (99.7 % from the campaigns before, no change), outside, level, level_low,
        level_high, change_here, change_by_here (probabilities). The instrument's errors are at their posterior mean throughout.
    sensitivity : mapping of assumption to probability of a change
    detection : Detection
    doubts, verdict : tuple of str
    """

    machine: str | None
    campaigns: tuple[str, ...]
    dates: tuple[datetime | None, ...]
    reference_force_N: float
    assumptions: Mapping[str, Any]
    probability: float
    by_time: Array
    parameters: Mapping[str, ParameterChange]
    most_probable: MostProbable
    scatter: tuple[float, float, float]
    estimates: pd.DataFrame
    sensitivity: Mapping[str, float]
    detection: Detection
    doubts: tuple[str, ...]
    verdict: tuple[str, ...]

    @property
    def changed(self) -> bool:
        """Whether the probability of a change is above the threshold."""
        return bool(self.probability > self.assumptions["threshold"])

    def sizes(self) -> dict[str, list[float]]:
        """Sizes of the estimates by inside unit, for `units_for`."""
        found: dict[str, list[float]] = {}
        for unit, value in zip(self.estimates["unit"], self.estimates["estimate"], strict=True):
            found.setdefault(unit, []).append(value)
        return found

    def table(self) -> pd.DataFrame:
        """One row per parameter, inside units."""
        rows = []
        for k, own in enumerate(self.parameters.values()):
            rows.append(
                {
                    "unit": own.unit,
                    "level": own.level,
                    "level_sd": own.level_sd,
                    "common_sd": own.common_sd,
                    "probability": own.probability,
                    "change": own.size,
                    "sd": own.sd,
                    "ci_low": own.interval[0],
                    "ci_high": own.interval[1],
                    "percent": np.nan if own.percent is None else own.percent,
                    "campaigns_to_find": self.detection.campaigns(k),
                }
            )
        return pd.DataFrame(rows, index=pd.Index(list(self.parameters), name="parameter"))

    def reading_rows(self) -> list[dict[str, str]]:
        """The same for reading: rounded, in units as one speaks of them."""
        rows = []
        last = self.estimates[self.estimates["campaign"] == self.campaigns[-1]].set_index("parameter")
        lows, highs = (last[name].to_dict() for name in ("level_low", "level_high"))
        asked = self.assumptions["detect"]
        with units_for(self.sizes()):
            for k, (name, own) in enumerate(self.parameters.items()):
                ends = (float(lows[name]), float(highs[name]))
                likely = own.probability >= _UNLIKELY
                needed = self.detection.campaigns(k)
                none = f"over {len(self.detection.false_alarm)}" if np.isfinite(self.detection.changes[k]) else "–"
                rows.append(
                    {
                        "parameter": display_name(name),
                        "level now": plus_minus(own.level, own.level_sd, ends, own.unit),
                        "u, common": _amount(own.common_sd, own.unit),
                        "P(changed)": probability_words(own.probability),
                        "change, if it did": plus_minus(own.size, own.sd, own.interval, own.unit) if likely else "–",
                        "of level": f"{own.percent:+.0f} %".replace("-", "−") if likely and own.percent is not None else "–",
                        f"{100 * asked:+.0f} % found within".replace("-", "−"): none if needed is None else str(needed),
                    }
                )
        return rows

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers, inside units."""
        soon, ci = self.detection, f"ci{100 * self.assumptions['ci']:g}"
        return {
            "machine": self.machine,
            "reference_force_N": self.reference_force_N,
            "assumptions": dict(self.assumptions),
            "probability_of_change": self.probability,
            "changed": self.changed,
            "campaigns": [
                {"campaign": name, "date": None if date is None else date.isoformat(), "change_just_before": float(one)}
                for name, date, one in zip(self.campaigns, self.dates, self.by_time, strict=True)
            ],
            "parameters": {
                name: {
                    "unit": own.unit,
                    "probability": own.probability,
                    "change": {"mean": own.size, "sd": own.sd, ci: list(own.interval)},
                    "percent": own.percent,
                    f"percent_{ci}": None if own.percent_interval is None else list(own.percent_interval),
                    "level_before": own.before,
                    "level_now": own.level,
                    "level_now_sd": own.level_sd,
                    "common_sd": own.common_sd,
                    "detection": {
                        "found_within": [None if np.isnan(one) else float(one) for one in soon.found[k]],
                        "error": [None if np.isnan(one) else float(one) for one in soon.error(soon.found[k])],
                        "campaigns_for_90_percent": soon.campaigns(k),
                    },
                }
                for k, (name, own) in enumerate(self.parameters.items())
            },
            "most_probable": {
                "parameter": self.most_probable.parameter,
                "just_before": self.campaigns[self.most_probable.place],
                "probability": self.most_probable.change.probability,
                "change": {
                    "mean": self.most_probable.change.size,
                    "sd": self.most_probable.change.sd,
                    ci: list(self.most_probable.change.interval),
                },
            },
            "scatter": {"mean": self.scatter[0], ci: list(self.scatter[1:])},
            "sensitivity": dict(self.sensitivity),
            "false_alarm": {
                "within": [float(one) for one in soon.false_alarm],
                "error": [float(one) for one in soon.error(soon.false_alarm)],
                "campaigns_before": soon.before,
                "replicates": soon.replicates,
            },
            "limits_probability": LIMITS,
            "doubts": list(self.doubts),
            "verdict": list(self.verdict),
        }

    def _repr_html_(self) -> str:
        said = "".join(f"<p>{html.escape(sentence)}</p>" for sentence in (*self.verdict, *self.doubts))
        whose = f"{self.machine}, " if self.machine else ""
        return table_html(f"{whose}{len(self.campaigns)} campaigns", self.reading_rows()) + said


def probability_words(probability: float) -> str:
    """Three decimals, and never quite 0 or 1."""
    if probability < _UNLIKELY:
        return "< 0.001"
    return "> 0.999" if probability > 1.0 - _UNLIKELY else f"{probability:.3f}"


def _amount(sd: float, unit: str) -> str:
    factor, label = display_unit(unit)
    return f"{round_uncertainty(sd * factor)[0]} {label}" if sd > 0.0 else "–"
