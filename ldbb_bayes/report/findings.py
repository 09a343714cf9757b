"""Everything a report shows of one fit: what the fit kept, and what is worked out for the report."""

from __future__ import annotations

import os
from collections.abc import Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, TypeAlias

import pandas as pd
import xarray as xr

from ldbb_bayes.analysis.aliases import degeneracies, standing_degeneracies
from ldbb_bayes.analysis.budget import Budget, budgets
from ldbb_bayes.analysis.circularity import circularity, contributions, measured_circularity
from ldbb_bayes.analysis.comparison import Comparison, compare
from ldbb_bayes.analysis.design.design import Design, design
from ldbb_bayes.analysis.identifiability import Identifiability, ParameterIdentifiability, identify, verdicts
from ldbb_bayes.campaign.preview import CampaignPreview, RemarkKind, preview
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.posterior import (
    bound_of,
    campaign_of,
    fit_of,
    load,
    model_of,
    nuisances,
    record_of,
    result_json,
    summarize,
)
from ldbb_bayes.report.wording import (
    DEGREES,
    alias_sentences,
    check_words,
    concern_sentences,
    fit_verdict,
    look_sentences,
    remark_words,
    standing_words,
)

__all__ = [
    "Compared",
    "Findings",
    "Recommended",
    "compare_for_report",
    "find",
    "fit_in_words",
    "full_result",
    "further_remarks",
    "sizes_of",
]


def full_result(posterior: xr.DataTree, ci_prob: float) -> dict[str, Any]:
    """The JSON of a fit, with nuisances, and what a look at the readings finds among its warnings."""
    result = result_json(posterior, ci_prob=ci_prob)
    result["nuisances"] = nuisances(posterior).to_dict(orient="index")
    result["fit"] |= fit_in_words(posterior)
    return result


def fit_in_words(posterior: xr.DataTree) -> dict[str, Any]:
    """Return the state of a fit, the kinds of what to mind, and its verdict, misfits and warnings in words."""
    fit, bound = fit_of(posterior), bound_of(posterior)
    alike = degeneracies(bound)
    return {
        "state": str(fit.state),
        "kinds": list(fit.kinds),
        "verdict": fit_verdict(fit),
        "misfits": [check_words(check) for check in fit.misfits],
        "warnings": [
            *concern_sentences(fit.concerns, record_of(posterior)["sampler"]),
            *alias_sentences(alike),
            *map(standing_words, standing_degeneracies(bound, alike)),
            *look_sentences(seen := preview(bound.campaign)),
            *further_remarks(seen),
        ],
    }


def further_remarks(seen: CampaignPreview) -> list[str]:
    """Remarks on a campaign that a fit does not make itself."""
    own = (RemarkKind.ONE_LEVEL, RemarkKind.TWO_LEVELS, RemarkKind.ONE_WAY)
    return [remark_words(remark) for remark in seen.remarks if remark.kind not in own]


def sizes_of(posterior: xr.DataTree) -> dict[str, list[float]]:
    """Means and U (k = 2) of the parameters by inside unit: what units for reading are chosen by."""
    found: dict[str, list[float]] = {}
    for entry in result_json(posterior)["parameters"].values():
        found.setdefault(entry["unit"], []).extend((entry["mean"], 2.0 * entry["sd"]))
    return found


Compared: TypeAlias = Comparison | str
Recommended: TypeAlias = Design | str


@dataclass(frozen=True, eq=False)
class Findings:
    """All that a report shows of one posterior.

    Attributes
    ----------
    posterior : DataTree
    ci_prob : float
    result : dict
        The JSON of the fit.
    summary : DataFrame
        Of the draws.
    seen : CampaignPreview
        The campaign without a model.
    verdicts : mapping of parameter to ParameterIdentifiability
        What the readings tell of it.
    identifiability : Identifiability
        The same of campaign and model, degeneracies included.
    budgets : mapping of parameter to Budget
    path : DataFrame
        Circular-test quantities of the machine.
    measured : tuple of DataFrame
        The same of the readings, and of pairs of them.
    contributions : DataFrame
        Of every parameter to the reading.
    comparing : Comparison, str, or a future of either
    design : Design or str
        The circles to run next, or why none are recommended.
    design_given : bool
        Whether the design was brought, not worked out for the report.
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
    measured: tuple[pd.DataFrame, pd.DataFrame]
    contributions: pd.DataFrame
    comparing: Compared | Future[Compared]
    design: Recommended
    design_given: bool

    @property
    def comparison(self) -> Compared:
        """The comparison, or why there is none; waited for where it is still at work."""
        return self.comparing.result() if isinstance(self.comparing, Future) else self.comparing

    @property
    def flat(self) -> bool:
        """Whether the parameters have flat priors."""
        return all(entry["prior_sd"] is None for entry in self.result["parameters"].values())


def find(
    posterior: xr.DataTree,
    *,
    ci_prob: float = 0.95,
    tests: int | None = None,
    comparison: Compared | Future[Compared] | None = None,
    recommended: Recommended | None = None,
) -> Findings:
    """Return what a report shows of a fit, after a look whether what is brought is of the same readings.

    Parameters
    ----------
    tests : int, optional
        Circles to recommend; default: as many as the campaign has.
    comparison : Comparison, str or future, optional
        Of `compare` on the same readings, or what `compare_for_report` returns; default: the latter.
    recommended : Design or str, optional
        Of `design` after the same readings, or why there is none; default: worked out.
    """
    campaign = campaign_of(posterior)
    brought = (
        ("comparison", "of", "Compare", comparison.campaign if isinstance(comparison, Comparison) else None),
        ("design", "made after", "Design", recommended.pilot if isinstance(recommended, Design) else None),
    )
    for what, relation, verb, own in brought:
        if own is not None and own.sha256 != campaign.sha256:
            raise InputError(
                f"{what} must be {relation} the readings of the fit, got one {relation.split()[-1]} {own.name!r} (SHA-256 "
                f"{own.sha256[:12]}… instead of {campaign.sha256[:12]}…). {verb} again."
            )
    return Findings(
        posterior,
        ci_prob,
        full_result(posterior, ci_prob),
        summarize(posterior, ci_prob=ci_prob),
        preview(campaign),
        verdicts(posterior),
        identify(model_of(posterior), campaign),
        budgets(posterior),
        circularity(posterior, ci_prob=ci_prob),
        measured_circularity(posterior),
        contributions(posterior, ci_prob=ci_prob),
        compare_for_report(posterior) if comparison is None else comparison,
        _next_tests(posterior, tests) if recommended is None else recommended,
        recommended is not None,
    )


def _next_tests(posterior: xr.DataTree, tests: int | None) -> Recommended:
    model = model_of(posterior)
    try:
        return design(model.with_degree(max(model.degree, 1)), pilot=campaign_of(posterior), tests=tests)
    except InputError as error:
        if tests is not None:
            raise
        return str(error)


def compare_for_report(posterior: xr.DataTree | str | os.PathLike[str]) -> Compared:
    """Constant against linear compliance (and quadratic where that was fitted) by evidence alone, or why not.

    Parameters
    ----------
    posterior : DataTree, or path to one
    """
    tree = posterior if isinstance(posterior, xr.DataTree) else load(posterior)
    model = model_of(tree)
    largest = model.with_degree(max(model.degree, 1))
    models = {DEGREES[k]: largest.with_degree(k) for k in range(largest.degree + 1)}
    try:
        return compare(models, campaign_of(tree), evidence_only=True)
    except InputError as error:
        return str(error)
