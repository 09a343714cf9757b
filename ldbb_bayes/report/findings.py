"""Everything a report shows of one fit: what the fit kept, and what is worked out for the report."""

from __future__ import annotations

import os
from collections.abc import Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import pandas as pd
import xarray as xr

from ldbb_bayes.analysis.budget import Budget, budgets
from ldbb_bayes.analysis.circularity import circularity, measured_circularity
from ldbb_bayes.analysis.compared import Comparison
from ldbb_bayes.analysis.comparison import compare
from ldbb_bayes.analysis.contributions import contributions
from ldbb_bayes.analysis.design import design
from ldbb_bayes.analysis.designed import Design
from ldbb_bayes.analysis.identifiability import identify, verdicts
from ldbb_bayes.analysis.identified import Identifiability, ParameterIdentifiability
from ldbb_bayes.analysis.preview import CampaignPreview, preview
from ldbb_bayes.analysis.recorded import RecordedDesign, recorded
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.origin import campaign_of, model_of
from ldbb_bayes.inference.posterior import load
from ldbb_bayes.inference.summary import summarize
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.report.result import full_result

__all__ = ["Compared", "Findings", "Recommended", "compare_for_report", "find"]

Compared: TypeAlias = Comparison | str
Recommended: TypeAlias = Design | RecordedDesign | str

_NAMES = ("constant", "linear", "quadratic")


@dataclass(frozen=True, eq=False)
class Findings:
    """Of one posterior.

    Attributes
    ----------
    posterior : DataTree
    ci_prob : float
    result : dict
        The JSON of the fit.
    summary : DataFrame
    seen : CampaignPreview
    verdicts : dict of parameter to ParameterIdentifiability
    identifiability : Identifiability
    budgets : dict of parameter to Budget
    path : DataFrame
        Circular-test quantities of the machine.
    measured, pairs : DataFrame
        Of the readings.
    contributions : DataFrame
    comparing : Comparison, str, or a future of either
    design : Design, RecordedDesign, or str
        Why there is none.
    design_given : bool
        Whether it was brought, not worked out for the report.
    """

    posterior: xr.DataTree
    ci_prob: float
    result: dict[str, Any]
    summary: pd.DataFrame
    seen: CampaignPreview
    verdicts: Mapping[str, ParameterIdentifiability]
    identifiability: Identifiability
    budgets: Mapping[str, Budget]
    path: pd.DataFrame
    measured: pd.DataFrame
    pairs: pd.DataFrame
    contributions: pd.DataFrame
    comparing: Compared | Future[Compared]
    design: Recommended
    design_given: bool

    @property
    def flat(self) -> bool:
        """Whether the parameters have flat priors."""
        return all(entry["prior_sd"] is None for entry in self.result["parameters"].values())

    @cached_property
    def comparison(self) -> Compared:
        """The comparison, or why there is none; waited for where it is still at work."""
        return self.comparing.result() if isinstance(self.comparing, Future) else self.comparing

    @property
    def interval_key(self) -> str:
        """Of the intervals in the JSON."""
        return f"ci{100 * self.ci_prob:g}"


def find(
    posterior: xr.DataTree,
    *,
    ci_prob: float = 0.95,
    tests: int | None = None,
    comparison: Compared | Future[Compared] | None = None,
    recommended: Recommended | None = None,
) -> Findings:
    """Work out what the fit did not keep.

    Parameters
    ----------
    tests : int, optional
        Circles to recommend; default: as many as the campaign has.
    comparison : Comparison, str or future, optional
        Of `compare` on the same readings, or what `compare_for_report` returns; default: the latter.
    recommended : Design, RecordedDesign or str, optional
        Of `design` after the same readings, or why there is none; default: worked out.
    """
    campaign, model = campaign_of(posterior), model_of(posterior)
    if isinstance(comparison, Comparison) and comparison.sha256 != campaign.sha256:
        raise InputError(
            f"comparison must be of the readings of the fit, got one of {comparison.campaign!r} (SHA-256 "
            f"{comparison.sha256[:12]}… instead of {campaign.sha256[:12]}…). Compare again."
        )
    if isinstance(recommended, Design | RecordedDesign):
        told = recorded(recommended) if isinstance(recommended, Design) else recommended
        if told.sha256 != campaign.sha256:
            raise InputError(
                f"design must be made after the readings of the fit, got one after {told.campaign!r} (SHA-256 "
                f"{told.sha256[:12]}… instead of {campaign.sha256[:12]}…). Design again."
            )
    measured, pairs = measured_circularity(posterior)
    return Findings(
        posterior,
        ci_prob,
        full_result(posterior, ci_prob),
        summarize(posterior, ci_prob=ci_prob),
        preview(campaign),
        verdicts(posterior),
        identify(model, campaign),
        budgets(posterior),
        circularity(posterior, ci_prob=ci_prob),
        measured,
        pairs,
        contributions(posterior, ci_prob=ci_prob),
        compare_for_report(posterior) if comparison is None else comparison,
        _design(model, campaign, tests) if recommended is None else recommended,
        recommended is not None,
    )


def compare_for_report(posterior: xr.DataTree | str | os.PathLike[str]) -> Compared:
    """Constant against linear compliance (and quadratic where that was fitted) by evidence alone, or why not.

    Parameters
    ----------
    posterior : DataTree, or path to one
    """
    tree = posterior if isinstance(posterior, xr.DataTree) else load(posterior)
    model = model_of(tree)
    largest = model.with_degree(max(model.degree, 1))
    models = {_NAMES[k]: largest.with_degree(k) for k in range(largest.degree + 1)}
    try:
        return compare(models, campaign_of(tree), evidence_only=True)
    except InputError as error:
        return str(error)


def _design(model: HybridModel, campaign: Campaign, tests: int | None) -> Design | str:
    try:
        return design(model.with_degree(max(model.degree, 1)), pilot=campaign, tests=tests)
    except InputError as error:
        if tests is not None:
            raise
        return str(error)
