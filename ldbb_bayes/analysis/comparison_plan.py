"""Plan of a comparison of models: which models are compared, and which results are computed.

The first two of the models that the user gives are compared several times: as they are, with other
priors of the slopes (changes of compliance with force), and with other assumptions about the random
differences between circles.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ldbb_bayes.analysis import sensitivity, varying_slopes
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.model.hybrid import HybridModel

__all__ = [
    "SLOPE_SCALES",
    "ComparisonPlan",
    "count_steps",
    "largest_model",
    "plan_comparison",
]

# Scales of the prior of the slopes at which the Bayes factor is computed. The scale is the prior
# standard deviation of a compliance's change over the range of force, divided by a reference value
# of the compliance. The reference value is the estimate of the compliance or, if
# ``slopes_of_estimate`` of the prior is false, the prior standard deviation of the compliance.
SLOPE_SCALES = (0.03, 0.05, 0.1, 0.15, 0.2, 0.3, 0.45, 0.7, 1.0, 1.5, 2.0, 3.0)


@dataclass(frozen=True)
class ComparisonPlan:
    """Plan of a comparison: the models to compare by evidence, and the further results to compute.

    The first two of the compared models are also compared under other priors of the slopes, and
    under other assumptions about the random differences between circles. Three dictionaries hold
    copies of these two models: ``by_slope_scale`` for the other priors, ``by_assumption`` for the
    other assumptions, and ``unchanged`` for none of these.
    """

    #: the first two of the compared models; the keys are the names that the caller gave them
    pair: dict[str, HybridModel]
    #: the model with the most parameters among the compared models. It is also fitted separately to
    #: the tests at each pair of neighbouring forces.
    largest: HybridModel
    #: the largest model, with its compliances reduced to constant or linear functions of force;
    #: models in which only some compliances change with force are derived from this model
    linear: HybridModel
    #: copies of the first two of the compared models, with narrower and wider priors of the slopes.
    #: The dict has one entry for each scale in `SLOPE_SCALES`. The key states the scale, as in
    #: "slope scale 0.3". The value holds copies of the two models in which the width of the prior
    #: is proportional to this scale. The dict is empty if neither model has slopes, or if the two
    #: models differ only in this prior.
    by_slope_scale: dict[str, tuple[HybridModel, ...]]
    #: dict with one entry. Its value is the pair of the first two compared models, as the caller
    #: gave them. Its key is a label of the assumption that these two models make about the random
    #: differences between circles.
    unchanged: dict[str, tuple[HybridModel, ...]]
    #: copies of the first two of the compared models that make other assumptions about the random
    #: differences between circles. Each key is a label of an assumption, such as "without set-up
    #: shift"; the value holds copies of the two models that make this assumption.
    by_assumption: dict[str, tuple[HybridModel, ...]]
    #: whether every test of the campaign is predicted from the other tests
    leaves_tests_out: bool
    #: whether models are compared in which only some compliances change with force
    has_slope_subsets: bool
    #: whether models of constant compliance are fitted to the tests at each pair of neighbouring
    #: forces
    has_local_fits: bool
    #: whether slopes are compared with alternative explanations: other effects, such as a nonlinear
    #: mount, that change the readings in a similar way
    has_rival_explanations: bool

    @property
    def slope_scales(self) -> tuple[float, ...]:
        """Return the widths of the slopes' prior for which two models are compared once more.

        The two models are the first two of the compared models. The result is empty if neither of
        them has slopes, or if they differ only in the prior of the slopes.
        """
        return SLOPE_SCALES if self.by_slope_scale else ()


def largest_model(models: Mapping[str, HybridModel]) -> HybridModel:
    """Return the model whose compliances are polynomials of the highest degree in the force.

    Of several such models, the one with the fewest parameters fixed at zero is returned. ``models``
    holds the models by name.
    """
    return max(models.values(), key=lambda model: (model.degree, -len(model.fixed)))


def plan_comparison(
    models: Mapping[str, HybridModel], campaign: Campaign, *, evidence_only: bool
) -> ComparisonPlan:
    """Return the plan of a comparison: which models to compare, and which results to compute.

    If ``evidence_only`` is true, only evidences are computed. Three results are then missing: the
    prediction of each test from the other tests, models with only some of the slopes, and fits to
    the tests at each pair of neighbouring forces. Alternative explanations (other effects that
    influence the readings in a similar way to slopes) are compared if two conditions hold: the
    second model is the first model with slopes added, and the second model has alternative
    explanations.
    """
    first, second = tuple(models)[:2]
    pair = {first: models[first], second: models[second]}
    largest = largest_model(models)
    linear = largest.with_degree(min(largest.degree, 1))
    by_slope_scale = _models_by_slope_scale(pair)
    by_assumption = sensitivity.pairs_by_change(
        pair.values(), sensitivity.discrepancy_assumptions(pair.values())
    )
    # The first entry of ``by_assumption`` holds the two compared models with their own assumption
    # about the random differences between circles, and is moved to ``unchanged``. All later entries
    # hold the models with another assumption.
    unchanged_label = next(iter(by_assumption))
    unchanged = {unchanged_label: by_assumption.pop(unchanged_label)}
    constant = models[second].with_degree(0)
    adds_slopes = models[first] == constant and constant != models[second]
    return ComparisonPlan(
        pair=pair,
        largest=largest,
        linear=linear,
        by_slope_scale=by_slope_scale,
        unchanged=unchanged,
        by_assumption=by_assumption,
        leaves_tests_out=not evidence_only and len(campaign.tests) > 1,
        has_slope_subsets=not evidence_only and linear.degree > 0,
        has_local_fits=not evidence_only and campaign.force_levels > 1,
        has_rival_explanations=adds_slopes and models[second].rivals != (),
    )


def _models_by_slope_scale(pair: Mapping[str, HybridModel]) -> dict[str, tuple[HybridModel, ...]]:
    """Return the two compared models with wider and with narrower priors of the slopes.

    ``pair`` holds the two models by name. The result is a dict with one entry for each scale in
    ``SLOPE_SCALES``. Its key states the scale, as in "slope scale 0.3". Its value holds both
    models, changed so that the prior sds of the slopes are proportional to the scale. The result is
    empty if neither model has slopes, or if the two models differ only in this prior.
    """
    changes: dict[str, sensitivity.Change] = {}
    if any(model.degree for model in pair.values()):
        for scale in SLOPE_SCALES:
            changes[f"slope scale {scale:g}"] = _change_of_slope_scale(scale)
    return sensitivity.pairs_by_change(pair.values(), changes)


def _change_of_slope_scale(scale: float) -> sensitivity.Change:
    """Return a function that returns a copy of a model with another width of the slopes' prior.

    In the copy, the prior sd of a slope is proportional to ``scale``. A model without slopes is
    returned unchanged, so that its evidence is computed only once for all scales.
    """

    def change(model: HybridModel) -> HybridModel:
        """Return a copy of ``model`` in which the width of the slopes' prior is ``scale``."""
        if model.degree == 0:
            return model
        return model.with_slope_scale(scale)

    return change


def count_steps(plan: ComparisonPlan, models: int, campaign: Campaign) -> int:
    """Return the number of evidences that `compare` computes.

    ``plan`` says which results are computed, and ``models`` is the number of models that the caller
    gave. If every test of ``campaign`` is left out once, this adds one evidence for each model and
    each test.
    """
    steps = models
    if plan.leaves_tests_out:
        steps += models * len(campaign.tests)
    steps += 2 * (len(plan.by_slope_scale) + len(plan.unchanged))
    if plan.has_rival_explanations:
        _, with_slopes = plan.pair.values()
        steps += 2 ** (1 + len(with_slopes.rivals))
    steps += 2 * len(plan.by_assumption)
    if plan.has_slope_subsets:
        steps += varying_slopes.count_subsets(plan.linear, campaign)
    return steps
