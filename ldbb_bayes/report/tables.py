"""A report's numbers as tables for files."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from ldbb_bayes.analysis.circularity import BIDIRECTIONAL, QUANTITIES
from ldbb_bayes.inference.origin import bound_of, draws_of
from ldbb_bayes.report.findings import Findings
from ldbb_bayes.report.sections.beside import Beside
from ldbb_bayes.report.sections.results import results_frame
from ldbb_bayes.report.sections.uncertainty import budget_frame

__all__ = ["tables"]


def tables(found: Findings, others: Sequence[Beside] = ()) -> dict[str, pd.DataFrame]:
    """Everything in numbers for files: inside units (mm, N, rad) for parameters, µm and µm/m for circular-test quantities."""
    bound = bound_of(found.posterior)
    beta, phi = draws_of(found.posterior, bound)
    names = [*bound.names, *map(str, bound.hyper_prior.names)]
    draws = np.concatenate([beta, phi], axis=1)
    every = {
        "results": results_frame(found).rename_axis("parameter"),
        "covariance": pd.DataFrame(np.cov(draws.T), names, names).rename_axis("parameter"),
        "correlation": pd.DataFrame(np.corrcoef(draws.T), names, names).rename_axis("parameter"),
        "budget": budget_frame(found).set_index("parameter"),
        "circularity": found.path.set_index("plane"),
        "measured_circularity": _with_units(found.measured).rename_axis("test"),
        "contributions": _with_units(found.contributions).set_index("plane"),
    }
    if len(found.pairs):
        every["measured_pairs"] = _with_units(found.pairs).rename_axis("tests")
    if others:
        joined = pd.concat({other.name: other.differences for other in others}, names=["campaign", "parameter"])
        every["differences"] = joined.reset_index().set_index("campaign")
    return every


def _with_units(frame: pd.DataFrame) -> pd.DataFrame:
    """Columns that stand for a quantity carry its unit in their names."""
    units = {"µm": "_um", "µm/m": "_um_per_m"}
    named = {name: f"{name}{units[unit]}" for name, unit in (QUANTITIES | BIDIRECTIONAL).items()}
    sizes = ("maximum", "minimum", "peak_to_peak", "median", "sd", "ci_low", "ci_high")
    return frame.rename(columns=named | {name: f"{name}_um" for name in sizes})
