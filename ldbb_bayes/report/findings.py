"""Class that holds all results of one fit that a report shows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias

import pandas as pd
import xarray as xr

from ldbb_bayes.analysis.budgets import budget_uncertainty
from ldbb_bayes.analysis.circularity import predict_circularity
from ldbb_bayes.analysis.comparison import Comparison
from ldbb_bayes.analysis.conformity import assess_conformity
from ldbb_bayes.analysis.design import Design, design
from ldbb_bayes.analysis.gum_validation import GumValidation, validate_gum
from ldbb_bayes.analysis.model_comparison import compare
from ldbb_bayes.analysis.posterior_verdicts import (
    JudgedQuantities,
    judge_posterior,
    judge_quantities,
)
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.campaign.preview import CampaignPreview, check_campaign, preview_of_model
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.posterior import campaign_of, model_of, record_of
from ldbb_bayes.inference.summary import summarize
from ldbb_bayes.model.parameter_kinds import DEGREE_NAMES
from ldbb_bayes.report import wording
from ldbb_bayes.report.fit_record import full_result
from ldbb_bayes.units import U_PROBABILITY

if TYPE_CHECKING:
    from ldbb_bayes.analysis.budgets import Budget
    from ldbb_bayes.analysis.decision_rule import Conformity
    from ldbb_bayes.analysis.verdicts import ChangeIdentifiability, ParameterIdentifiability

__all__ = ["Compared", "Findings", "FurtherCampaign", "Recommended", "findings_of_fit"]

Compared: TypeAlias = "Comparison | str"
"""A comparison of models, or a text with the reason why no comparison is available."""

Recommended: TypeAlias = "Design | str"
"""A design of the next tests, or a text with the reason why no design is available."""


@dataclass(frozen=True, eq=False)
class Findings:
    """All results of one fit that a report shows.

    Quantities that are not stored with the posterior are computed when they are first used.

    Parameters
    ----------
    posterior
        Posterior of the fit.
    prob
        Probability of the credible intervals.
    comparison
        Comparison of the models with constant and with linear compliance, or a string that states
        why there is no comparison.
    recommended
        Function that returns a design of the next tests, or a string that states why there is no
        design.
    averaged
        Posterior averaged over models. If it is present, the sheets of the test certificate
        state its estimates. None if no average was computed.
    tolerances
        Tolerances; the keys are names of quantities. Default: the tolerances of the campaign.
    sheets_only
        Whether the report has no annex (no sections after the sheets of the test certificate). If
        true, nothing is computed that only the annex shows.
    """

    posterior: xr.DataTree
    prob: float
    comparison: Compared
    recommended: Callable[[], Recommended]
    averaged: xr.DataTree | None = None
    tolerances: Mapping[str, Any] | None = None
    sheets_only: bool = False

    @property
    def posterior_of_certificate(self) -> xr.DataTree:
        """Posterior from which the estimates on the test certificate are computed.

        This is the averaged posterior if an average over models was computed, and otherwise the
        posterior of the fit.
        """
        return self.posterior if self.averaged is None else self.averaged

    @property
    def has_rough_weights(self) -> bool:
        """Whether the certificate states averages over models whose weights are not exact enough.

        The weight of a model is its probability. `average` says how exact it must be.
        """
        return self.averaged is not None and not record_of(self.averaged)["sampler"]["converged"]

    @cached_property
    def probabilities(self) -> Mapping[str, float]:
        """Posterior probabilities of the averaged models and of alternative explanations.

        The keys are the names of models and explanations. The probabilities of the models sum to
        one. An alternative explanation is an effect other than compliance, such as a nonlinear
        mount, that may explain why the readings change with force. The probability of such an
        explanation, from 0 to 1, is the sum of the probabilities of all models that include it. The
        mapping is empty if no average over models was computed.
        """
        averaged = record_of(self.posterior_of_certificate).get("averaged", {})
        probabilities: dict[str, float] = averaged.get("probability", {})
        return probabilities

    @property
    def probability_of_change(self) -> float:
        """Posterior probability that compliance changes with force.

        If an average over models was computed, the value is 1 minus the posterior probability of
        the model with constant compliance. If no average was computed, the report shows results of
        a single model with slopes (changes of compliance with force), and the value is 1.
        """
        return 1.0 - self.probabilities.get(DEGREE_NAMES[0], 0.0)

    @cached_property
    def design(self) -> Recommended:
        """Design of the tests to run next, or a string that states why there is no design."""
        return self.recommended()

    @cached_property
    def result(self) -> dict[str, Any]:
        """Results of the fit as a dictionary, as the command ``fit --json`` prints them."""
        return full_result(self.posterior, self.prob)

    @cached_property
    def result_of_U(self) -> dict[str, Any]:
        """The same results with intervals of 95 %, from which tables state U (k = 2)."""
        if self.prob == U_PROBABILITY:
            return self.result
        return full_result(self.posterior, U_PROBABILITY)

    @cached_property
    def summary(self) -> pd.DataFrame:
        """Table of the fit's results, one row per parameter, with diagnostics of the sampling."""
        return summarize(self.posterior, prob=self.prob)

    @cached_property
    def preview(self) -> CampaignPreview:
        """Preview of the campaign, which states what the readings show without a fit.

        It states no assumptions about terms that the model of the fit does not have.
        """
        preview = check_campaign(campaign_of(self.posterior))
        return preview_of_model(preview, model_of(self.posterior).terms)

    @cached_property
    def judged_quantities(self) -> JudgedQuantities:
        """Verdicts on the quantities that the test certificate states.

        A verdict states how well the readings determine a quantity. If the estimates on the
        certificate are averages over models, the verdicts are averages, too.
        """
        return judge_quantities(self.posterior_of_certificate)

    @property
    def verdicts(self) -> Mapping[str, ParameterIdentifiability]:
        """Verdicts on the parameters that the test certificate states.

        A verdict states how well the readings determine a parameter. The keys are the names of the
        parameters.
        """
        return self.judged_quantities.parameters

    @property
    def change_verdicts(self) -> Mapping[str, ChangeIdentifiability]:
        """Verdicts on how well the readings determine the change of each compliance with force.

        The keys of the mapping are the names of the compliances. A change that no posterior draw
        has is left out.
        """
        return self.judged_quantities.changes

    @cached_property
    def verdicts_of_fit(self) -> Mapping[str, ParameterIdentifiability]:
        """Verdicts on how well the readings determine each parameter of the fitted model.

        These verdicts are not averages over models. The keys of the mapping are the names of the
        parameters.
        """
        if self.averaged is None:
            return self.verdicts
        return judge_posterior(self.posterior)

    @cached_property
    def budgets(self) -> Mapping[str, Budget]:
        """Uncertainty budgets of the parameters that the test certificate states.

        The keys of the mapping are the names of the parameters.
        """
        return budget_uncertainty(self.posterior_of_certificate)

    @cached_property
    def gum_validation(self) -> GumValidation:
        """Comparison of each parameter's credible interval with an interval according to the GUM.

        The interval according to the GUM is computed with the law of propagation of uncertainty.
        The comparison follows the validation procedure of JCGM 101.
        """
        return validate_gum(self.posterior_of_certificate, prob=self.prob)

    @cached_property
    def circularity(self) -> pd.DataFrame:
        """Table of circular-test quantities of the tool path, such as the circular deviation G.

        The tool path is computed for the machine alone, without the errors of the instrument.
        """
        return predict_circularity(self.posterior, prob=self.prob)

    def conformity(self, force_N: float | None = None) -> Mapping[str, Conformity]:
        """Return the decision on conformity for each quantity that has a tolerance.

        The keys of the mapping are the names of the quantities.

        Compliances and circular deviations are assessed at the force ``force_N`` [N], or at the
        model's reference force if ``force_N`` is None.
        """
        return assess_conformity(
            self.posterior_of_certificate, self.tolerances or None, force_N=force_N
        )

    @property
    def has_flat_priors(self) -> bool:
        """Whether the parameters have flat priors, as in a fit by least squares."""
        return all(entry["prior_sd"] is None for entry in self.result["parameters"].values())


@dataclass(frozen=True, eq=False)
class FurtherCampaign:
    """A further campaign, which a report compares with the campaign of the report.

    Parameters
    ----------
    name
        Name of the further campaign.
    campaign
        The further campaign.
    result
        Results of the fit of the further campaign, as the command ``fit --json`` prints them.
    differences
        Differences of the parameters between the two campaigns, see `compare_posteriors`.
    differences_with_95
        The same differences with intervals of 95 %, from which U (k = 2) is stated. None if the
        intervals of ``differences`` are of 95 %.
    """

    name: str
    campaign: Campaign
    result: Mapping[str, Any]
    differences: pd.DataFrame
    differences_with_95: pd.DataFrame | None = None

    @property
    def differences_of_U(self) -> pd.DataFrame:
        """Differences of the parameters with intervals of 95 %, from which U is stated."""
        if self.differences_with_95 is None:
            return self.differences
        return self.differences_with_95


def findings_of_fit(
    posterior: xr.DataTree,
    *,
    prob: float = 0.95,
    tests: int | None = None,
    comparison: Compared | None = None,
    recommended: Recommended | Callable[[], Recommended] | None = None,
    averaged: xr.DataTree | None = None,
    tolerances: Mapping[str, Any] | None = None,
    sheets_only: bool = False,
) -> Findings:
    """Return an object with all results that a report shows about a fit.

    Parameters
    ----------
    posterior, prob, tests, comparison, recommended, averaged, tolerances, sheets_only
        See the arguments of `ldbb_bayes.write_report` with the same names.

    Returns
    -------
    Findings

    Raises
    ------
    InputError
        The comparison or the design was made from readings other than those of the fit.
    """
    campaign = campaign_of(posterior)
    _check_readings("comparison", getattr(comparison, "campaign", None), campaign)
    _check_readings("design", getattr(recommended, "pilot", None), campaign)
    if sheets_only:
        comparison = comparison or wording.NO_ANNEX
        recommended = recommended or wording.NO_ANNEX
    if comparison is None:
        comparison = _compare_degrees(posterior)

    def next_tests() -> Recommended:
        """Return the user's design of the next tests, or compute one if the user gives none."""
        if recommended is None:
            return _design_next_tests(posterior, tests)
        if callable(recommended):
            return recommended()
        return recommended

    return Findings(posterior, prob, comparison, next_tests, averaged, tolerances, sheets_only)


def _check_readings(kind: str, stated: Campaign | None, campaign: Campaign) -> None:
    """Raise an `InputError` if a comparison or a design was made from other readings than the fit.

    ``kind`` is "comparison" or "design". ``stated`` is the campaign from which the comparison or
    design was made; None if it is not known. ``campaign`` is the campaign of the fit.
    """
    if stated is not None and stated.sha256 != campaign.sha256:
        raise InputError(
            f"{kind} must be of the readings of the fit, got one of {stated.name!r} (SHA-256"
            f" {stated.sha256[:12]}… instead of {campaign.sha256[:12]}…). Make the {kind} again."
        )


def _design_next_tests(posterior: xr.DataTree, tests: int | None) -> Recommended:
    """Return a design of the next ``tests`` circles, or the reason why no design is possible.

    If the user stated the number of circles and no design is possible, an `InputError` is raised
    instead. The design is made for the model of the fit. If compliance is constant in this model,
    the design is made for the same model with compliance linear in force.
    """
    model = model_of(posterior)
    model = model.with_degree(max(model.degree, 1))
    try:
        return design(model, pilot=campaign_of(posterior), tests=tests)
    except InputError as error:
        if tests is not None:
            raise
        return str(error)


def _compare_degrees(posterior: xr.DataTree) -> Compared:
    """Return a comparison of the evidences of models with constant and with linear compliance.

    If compliance in the fitted model is quadratic in force, the comparison also includes the
    quadratic model. If the comparison is not possible, return a string that states the reason.
    """
    model = model_of(posterior)
    largest = model.with_degree(max(model.degree, 1))
    models = {DEGREE_NAMES[k]: largest.with_degree(k) for k in range(largest.degree + 1)}
    try:
        return compare(models, campaign_of(posterior), evidence_only=True)
    except InputError as error:
        return str(error)
