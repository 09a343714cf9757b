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

from ldbb_bayes.analysis.aliases import degeneracies, standing_degeneracies
from ldbb_bayes.analysis.budget import Budget, budgets
from ldbb_bayes.analysis.circularity import circularity, contributions, measured_circularity
from ldbb_bayes.analysis.comparison import Comparison, compare
from ldbb_bayes.analysis.design.design import Design, design
from ldbb_bayes.analysis.identifiability import Identifiability, ParameterIdentifiability, identify, verdicts
from ldbb_bayes.campaign.campaign import Campaign
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
    "look_warnings",
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
            *look_warnings(bound.campaign),
        ],
    }


def look_warnings(campaign: Campaign) -> list[str]:
    """What a look at the readings adds to a fit's own warnings."""
    seen = preview(campaign)
    return look_sentences(seen) + further_remarks(seen)


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

_NAMES = ("constant", "linear", "quadratic")


@dataclass(frozen=True, eq=False)
class Findings:
    """All that a report shows of one posterior, each worked out when it is first asked for.

    Attributes
    ----------
    posterior : DataTree
    ci_prob : float
    tests : int or None
        Circles to recommend.
    comparing : Comparison, str, or a future of either
        None: worked out.
    recommended : Design, str or None
        What was brought, or why there is none. None: worked out.
    """

    posterior: xr.DataTree
    ci_prob: float
    tests: int | None
    comparing: Compared | Future[Compared] | None
    recommended: Recommended | None

    @cached_property
    def result(self) -> dict[str, Any]:
        """The JSON of the fit."""
        return full_result(self.posterior, self.ci_prob)

    @cached_property
    def summary(self) -> pd.DataFrame:
        """Of the draws."""
        return summarize(self.posterior, ci_prob=self.ci_prob)

    @cached_property
    def seen(self) -> CampaignPreview:
        """The campaign without a model."""
        return preview(campaign_of(self.posterior))

    @cached_property
    def verdicts(self) -> Mapping[str, ParameterIdentifiability]:
        """What the readings tell of every parameter."""
        return verdicts(self.posterior)

    @cached_property
    def identifiability(self) -> Identifiability:
        """The same of campaign and model, degeneracies included."""
        return identify(model_of(self.posterior), campaign_of(self.posterior))

    @cached_property
    def budgets(self) -> Mapping[str, Budget]:
        """Of every parameter."""
        return budgets(self.posterior)

    @cached_property
    def path(self) -> pd.DataFrame:
        """Circular-test quantities of the machine."""
        return circularity(self.posterior, ci_prob=self.ci_prob)

    @cached_property
    def measured(self) -> tuple[pd.DataFrame, pd.DataFrame]:
        """The same of the readings, and of pairs of them."""
        return measured_circularity(self.posterior)

    @cached_property
    def contributions(self) -> pd.DataFrame:
        """Of every parameter to the reading."""
        return contributions(self.posterior, ci_prob=self.ci_prob)

    @cached_property
    def comparison(self) -> Compared:
        """The comparison, or why there is none; waited for where it is still at work."""
        if self.comparing is None:
            return compare_for_report(self.posterior)
        return self.comparing.result() if isinstance(self.comparing, Future) else self.comparing

    @cached_property
    def design(self) -> Recommended:
        """The circles to run next, or why none are recommended."""
        if self.recommended is not None:
            return self.recommended
        model = model_of(self.posterior)
        try:
            return design(model.with_degree(max(model.degree, 1)), pilot=campaign_of(self.posterior), tests=self.tests)
        except InputError as error:
            if self.tests is not None:
                raise
            return str(error)

    @property
    def design_given(self) -> bool:
        """Whether the design was brought, not worked out for the report."""
        return self.recommended is not None

    @property
    def flat(self) -> bool:
        """Whether the parameters have flat priors."""
        return all(entry["prior_sd"] is None for entry in self.result["parameters"].values())

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
    if isinstance(comparison, Comparison) and comparison.campaign.sha256 != campaign.sha256:
        raise InputError(
            f"comparison must be of the readings of the fit, got one of {comparison.campaign.name!r} (SHA-256 "
            f"{comparison.campaign.sha256[:12]}… instead of {campaign.sha256[:12]}…). Compare again."
        )
    if isinstance(recommended, Design) and recommended.pilot.sha256 != campaign.sha256:
        pilot = recommended.pilot
        raise InputError(
            f"design must be made after the readings of the fit, got one after {pilot.name!r} (SHA-256 "
            f"{pilot.sha256[:12]}… instead of {campaign.sha256[:12]}…). Design again."
        )
    return Findings(posterior, ci_prob, tests, comparison, recommended)


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
