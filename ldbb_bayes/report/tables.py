"""A report's numbers as tables for files."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from ldbb_bayes.inference.origin import bound_of, draws_of
from ldbb_bayes.report.findings import Findings
from ldbb_bayes.report.sections.results import results_frame
from ldbb_bayes.report.sections.uncertainty import budget_frame

__all__ = ["tables"]


def tables(found: Findings, beside_it: Mapping[str, pd.DataFrame] | None = None) -> dict[str, pd.DataFrame]:
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
        "measured_circularity": found.measured.rename_axis("test"),
        "contributions": found.contributions.set_index("plane"),
    }
    if len(found.pairs):
        every["measured_pairs"] = found.pairs.rename_axis("tests")
    if beside_it:
        joined = pd.concat(beside_it, names=["campaign", "parameter"])
        every["differences"] = joined.reset_index().set_index("campaign")
    return every
