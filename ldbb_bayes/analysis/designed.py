"""A design: which tests to run, how good that is, and what they will tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from ldbb_bayes.analysis.advice import recommendation
from ldbb_bayes.analysis.costs import running_order
from ldbb_bayes.analysis.forecast import Forecast
from ldbb_bayes.analysis.places import frame_of
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.circular_test import CircularTest
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.terms import Drift
from ldbb_bayes.notebook import table_html

__all__ = ["Certificate", "Design", "Judged"]


@dataclass(frozen=True)
class Certificate:
    """That no shares of as many tests are better (Kiefer and Wolfowitz 1960).

    Attributes
    ----------
    max_sensitivity : float
        Of all candidates, for the best shares.
    bound : float
        What it does not exceed for the best shares: for D with flat priors the number of parameters.
    is_global : bool
        False where the criterion is not concave: then only designs nearby are ruled out.
    """

    max_sensitivity: float
    bound: float
    is_global: bool

    @property
    def holds(self) -> bool:
        """Whether it does, within a ten-thousandth."""
        return self.max_sensitivity <= self.bound * (1.0 + 1e-4)


@dataclass(frozen=True, eq=False)
class Judged:
    """A design that is compared with the recommended one.

    Attributes
    ----------
    name : str
    tests : tuple of CircularTest
    efficiency : float
        Beside the best shares of as many tests.
    forecast : Forecast
    cost : float
    """

    name: str
    tests: tuple[CircularTest, ...]
    efficiency: float
    forecast: Forecast
    cost: float


@dataclass(frozen=True, eq=False, repr=False)
class Design:
    """Recommended tests.

    Attributes
    ----------
    tests : tuple of CircularTest
        By clocking, radius and force; a test to be run twice is there twice.
    criterion : str
    parameters : tuple of str
        Parameters of interest; all others are nuisances.
    efficiency : float
        Beside the best shares of as many tests.
    certificate : Certificate
    shares : DataFrame
        The best shares: force_N, `columns`, share.
    sensitivity : DataFrame
        Of every candidate, for the best shares: force_N, `columns`, sensitivity.
    columns : tuple of str
        What tables say of a test beside its force: clockings and radius; plane, direction, set-up and centre where candidates
        differ in them.
    forecast : Forecast
    baseline : Judged
        Equal steps of force at the first clocking and radius.
    others : tuple of Judged
        Designs brought for comparison.
    cost : float
    pilot : Campaign
    model : HybridModel
        For the analysis of the plan: F0 and the slopes' prior sd are the pilot's, whatever the plan's forces.
    augment : bool
    reached : bool
        Whether the target or power asked for is reached.
    notes : tuple of str
        What force levels cannot do, and what would; what the numbers rest on.
    trade_off : DataFrame
        Number of tests against efficiency and expected sd; empty unless asked for.
    robustness : DataFrame
        Efficiency of the best designs under each assumption, under each assumption; empty unless asked for.
    """

    tests: tuple[CircularTest, ...]
    criterion: str
    parameters: tuple[str, ...]
    efficiency: float
    certificate: Certificate
    shares: pd.DataFrame
    sensitivity: pd.DataFrame
    columns: tuple[str, ...]
    forecast: Forecast
    baseline: Judged
    others: tuple[Judged, ...]
    cost: float
    pilot: Campaign
    model: HybridModel
    augment: bool
    reached: bool
    notes: tuple[str, ...]
    trade_off: pd.DataFrame
    robustness: pd.DataFrame

    def table(self) -> pd.DataFrame:
        """One row per different test: force_N, `columns`, count."""
        frame = frame_of(self.tests, self.columns)
        return frame.value_counts(sort=False).rename("count").reset_index()

    def plan(self, *, seed: int = 1) -> Campaign:
        """The tests as a plan, in the order in which to run them: blocks of one clocking, forces at random within.

        Where the model has a drift, at the pilot's pace and mean temperature.
        """
        tests = _timed(running_order(self.tests, np.random.default_rng(seed)), self.pilot, self.model)
        return replace(self.pilot, tests=tests, foreseen=(), name=f"{self.pilot.name}, next campaign")

    def expected_table(self) -> pd.DataFrame:
        """Expected sd of every parameter beside prior, floor and baseline; inside units."""
        baseline = self.baseline.forecast.expected
        rows = [
            {
                "parameter": name,
                "unit": entry.unit,
                "prior_sd": entry.prior_sd,
                "sd": entry.sd,
                "floor_sd": entry.floor_sd,
                "baseline_sd": baseline[name].sd,
            }
            for name, entry in self.forecast.expected.items()
        ]
        return pd.DataFrame(rows)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "criterion": self.criterion,
            "parameters": list(self.parameters),
            "tests": self.table().to_dict(orient="records"),
            "augment": self.augment,
            "reached": self.reached,
            "reference_force_N": self.model.reference_force_N,
            "cost": self.cost,
            "efficiency": self.efficiency,
            "certificate": {
                "max_sensitivity": self.certificate.max_sensitivity,
                "bound": self.certificate.bound,
                "global": self.certificate.is_global,
                "holds": self.certificate.holds,
            },
            "shares": self.shares.to_dict(orient="records"),
            **self.forecast.as_dict(),
            "baseline": {name: entry.as_dict() for name, entry in self.baseline.forecast.expected.items()},
            "compared": [_judged_dict(judged, self.columns) for judged in (self.baseline, *self.others)],
            "trade_off": self.trade_off.to_dict(orient="records"),
            "robustness": self.robustness.to_dict(orient="index"),
            "degree": self.model.degree,
            "notes": list(self.notes),
            "sentences": list(self.sentences()),
        }

    def sentences(self) -> tuple[str, ...]:
        """The recommendation in words."""
        return recommendation(self)

    def __repr__(self) -> str:
        return f"Design of {len(self.tests)} tests, efficiency {self.efficiency:.3f} by criterion {self.criterion}"

    def __str__(self) -> str:
        return "\n".join([self.table().to_string(index=False), "", *self.sentences()])

    def _repr_html_(self) -> str:
        rows = [{str(k): v for k, v in row.items()} for row in self.table().to_dict(orient="records")]
        said = [{"in words": sentence} for sentence in self.sentences()]
        return table_html("Tests to run", rows) + table_html("Design", said)


def _timed(tests: tuple[CircularTest, ...], pilot: Campaign, model: HybridModel) -> tuple[CircularTest, ...]:
    over = {term.over for term in model.nuisances if isinstance(term, Drift)}
    times = np.sort([test.time_s for test in pilot.tests if test.time_s is not None])
    degrees = [test.temperature_C for test in pilot.tests if test.temperature_C is not None]
    if "time" in over and len(times) > 1:
        pace = float(np.median(np.diff(times)))
        return tuple(replace(test, time_s=k * pace) for k, test in enumerate(tests))
    return tuple(replace(test, temperature_C=float(np.mean(degrees))) for test in tests) if "temperature" in over else tests


def _judged_dict(judged: Judged, columns: Sequence[str]) -> dict[str, Any]:
    forces = frame_of(judged.tests, columns).to_dict(orient="records")
    own: Mapping[str, Any] = judged.forecast.as_dict()
    return {"name": judged.name, "tests": forces, "cost": judged.cost, "efficiency": judged.efficiency, **own}
