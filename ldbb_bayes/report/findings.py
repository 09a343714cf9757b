"""Everything a report shows of one fit: what the fit kept, and what is worked out for the report."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, TypeAlias

import ldbb_bayes as lb
from ldbb_bayes.analysis.aliases import degeneracies, standing_degeneracies
from ldbb_bayes.analysis.conformity import state_of
from ldbb_bayes.campaign.preview import CampaignPreview, RemarkKind, preview
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.posterior import bound_of, campaign_of, fit_of, model_of, nuisances, record_of, result_json
from ldbb_bayes.report import wording
from ldbb_bayes.report.wording import DEGREES
from ldbb_bayes.result import Shown

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from ldbb_bayes.analysis.comparison import Comparison
    from ldbb_bayes.analysis.conformity import Conformity, Judgement
    from ldbb_bayes.analysis.design import Design
    from ldbb_bayes.analysis.identifiability import Budget, ParameterIdentifiability

__all__ = ["Compared", "Findings", "Recommended", "find", "fit_in_words", "full_result", "further_remarks"]


def full_result(posterior: xr.DataTree, ci_prob: float) -> dict[str, Any]:
    """The JSON of a fit, with nuisances, and what a look at the readings finds among its warnings."""
    result = result_json(posterior, ci_prob=ci_prob)
    result["nuisances"] = nuisances(posterior).to_dict(orient="index")
    result["fit"] |= fit_in_words(posterior)
    if campaign_of(posterior).tolerances:
        result["conformity"] = {name: own.as_dict() for name, own in lb.conformity(posterior).items()}
    return result


class FitWords(Shown, dict[str, Any]):
    """A fit in words, by key; printed as the verdict and what to mind."""

    def __repr__(self) -> str:
        return f"<fit in words: {self['state']}, {len(self['warnings'])} warnings>"


def fit_in_words(posterior: xr.DataTree) -> FitWords:
    """Return a fit's state, the kinds of what to mind, and verdict, misfits and warnings in words; it prints as sentences."""
    fit, bound = fit_of(posterior), bound_of(posterior)
    alike, seen = degeneracies(bound), preview(bound.campaign)
    concerns = wording.concern_sentences(fit.concerns, record_of(posterior)["sampler"])
    standing = map(wording.standing_words, standing_degeneracies(bound, alike))
    return FitWords(
        state=str(fit.state), kinds=list(fit.kinds), verdict=wording.fit_verdict(fit),
        misfits=[wording.check_words(check) for check in fit.misfits],
        warnings=[
            *concerns, *wording.check_notes(fit), *wording.alias_sentences(alike), *standing, *wording.look_sentences(seen),
            *further_remarks(seen),
        ],
    )  # fmt: skip


def further_remarks(seen: CampaignPreview) -> list[str]:
    """Remarks on a campaign that a fit does not make itself."""
    own = (RemarkKind.ONE_LEVEL, RemarkKind.TWO_LEVELS, RemarkKind.ONE_WAY)
    return [wording.remark_words(remark) for remark in seen.remarks if remark.kind not in own]


Compared: TypeAlias = "Comparison | str"
Recommended: TypeAlias = "Design | str"


@dataclass(frozen=True, eq=False)
class Findings:
    """All that a report shows of one posterior; what the fit did not keep is worked out when it is first asked for. Where a
    comparison or design is missing stands why."""

    posterior: xr.DataTree
    ci_prob: float
    comparison: Compared
    recommended: Callable[[], Recommended]
    averaged: xr.DataTree | None = None
    tolerances: Mapping[str, Any] | None = None

    @property
    def numbers(self) -> xr.DataTree:
        """What the sheets state: averaged over the models where that was worked out."""
        return self.posterior if self.averaged is None else self.averaged

    @cached_property
    def probabilities(self) -> Mapping[str, float]:
        """Of the models that were averaged over, and of the rivals of slopes; none where nothing was."""
        found: dict[str, float] = record_of(self.numbers).get("averaged", {}).get("probability", {})
        return found

    @property
    def varying(self) -> float:
        """Probability that compliance changes with force; one where that is what was fitted."""
        return 1.0 - self.probabilities.get(DEGREES[0], 0.0)

    @cached_property
    def design(self) -> Recommended:
        """The tests to run next."""
        return self.recommended()

    @cached_property
    def result(self) -> dict[str, Any]:
        """The JSON of the fit."""
        return full_result(self.posterior, self.ci_prob)

    @cached_property
    def summary(self) -> pd.DataFrame:
        """Of the draws."""
        return lb.summarize(self.posterior, ci_prob=self.ci_prob)

    @cached_property
    def seen(self) -> CampaignPreview:
        """The campaign without a model."""
        return preview(campaign_of(self.posterior))

    @cached_property
    def verdicts(self) -> Mapping[str, ParameterIdentifiability]:
        """What the readings tell of every parameter."""
        return lb.verdicts(self.posterior)

    @cached_property
    def budgets(self) -> Mapping[str, Budget]:
        """Of every parameter."""
        return lb.budgets(self.posterior)

    @cached_property
    def path(self) -> pd.DataFrame:
        """Circular-test quantities of the machine."""
        return lb.circularity(self.posterior, ci_prob=self.ci_prob)

    def conformity(self, force_N: float | None = None) -> Mapping[str, Conformity]:
        """With the tolerances given or else those of the campaign."""
        return lb.conformity(self.numbers, self.tolerances or None, force_N=force_N)

    def judged(self, stated: Collection[str]) -> Judgement:
        """Whether a certificate that states these parameters can be used."""
        compared = None if isinstance(self.comparison, str) else self.comparison
        return state_of(fit_of(self.posterior), self.verdicts, stated, comparison=compared)

    @property
    def flat(self) -> bool:
        """Whether the parameters have flat priors."""
        return all(entry["prior_sd"] is None for entry in self.result["parameters"].values())


def find(
    posterior: xr.DataTree,
    *,
    ci_prob: float = 0.95,
    tests: int | None = None,
    comparison: Compared | None = None,
    recommended: Recommended | Callable[[], Recommended] | None = None,
    averaged: xr.DataTree | None = None,
    tolerances: Mapping[str, Any] | None = None,
) -> Findings:
    """Return what a report shows of a fit, after a look whether what is brought is of the same readings; as `write_report`."""
    digest = campaign_of(posterior).sha256
    for what, own in (("comparison", getattr(comparison, "campaign", None)), ("design", getattr(recommended, "pilot", None))):
        if own is not None and own.sha256 != digest:
            got = f"got one of {own.name!r} (SHA-256 {own.sha256[:12]}… instead of {digest[:12]}…)"
            raise InputError(f"{what} must be of the readings of the fit, {got}. Make the {what} again.")
    planned = partial(_next_tests, posterior, tests) if recommended is None else recommended
    return Findings(
        posterior, ci_prob, _compared(posterior) if comparison is None else comparison,
        planned if callable(planned) else lambda: planned, averaged, tolerances,
    )  # fmt: skip


def _next_tests(posterior: xr.DataTree, tests: int | None) -> Recommended:
    model = model_of(posterior)
    try:
        return lb.design(model.with_degree(max(model.degree, 1)), pilot=campaign_of(posterior), tests=tests)
    except InputError as error:
        if tests is not None:
            raise
        return str(error)


def _compared(posterior: xr.DataTree) -> Compared:
    """Constant against linear compliance (and quadratic where that was fitted) by evidence alone, or why not."""
    model = model_of(posterior)
    largest = model.with_degree(max(model.degree, 1))
    models = {DEGREES[k]: largest.with_degree(k) for k in range(largest.degree + 1)}
    try:
        return lb.compare(models, campaign_of(posterior), evidence_only=True)
    except InputError as error:
        return str(error)
