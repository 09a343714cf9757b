"""Verdicts on the parameters of a posterior, which may be averaged over several models.

The standard uncertainties are the standard deviations of the posterior's draws. In an average over
models, shares and variances are averaged over the models, weighted by the models' probabilities
(`variance_sources`). The verdicts are then determined by the same rules as for a single model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ldbb_bayes.analysis.confounding_rule import confounding_sources
from ldbb_bayes.analysis.curve_changes import (
    CurveChange,
    compliance_weights,
    curve_changes,
    slopes_of,
)
from ldbb_bayes.analysis.variance_sources import (
    AveragedVariance,
    ModelVariance,
    weights_of_parameters,
)
from ldbb_bayes.analysis.verdicts import (
    ChangeIdentifiability,
    ParameterIdentifiability,
    SampledSd,
    judge_average,
    judge_changes,
    shares_by_name,
)
from ldbb_bayes.inference.averaged_models import AveragedModel, averaged_models
from ldbb_bayes.inference.elastic_deflections import compliance_curves
from ldbb_bayes.inference.posterior import bound_of
from ldbb_bayes.inference.posterior_cache import cached_by_posterior
from ldbb_bayes.model.bound_information import information_of
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array
from ldbb_bayes.units import is_slope

if TYPE_CHECKING:
    import xarray as xr

__all__ = [
    "JudgedQuantities",
    "confounded_at",
    "confounded_in",
    "judge_at_force",
    "judge_posterior",
    "judge_quantities",
]


class JudgedQuantities(NamedTuple):
    """How well the readings determine the parameters and the changes of compliances with force.

    The keys of ``parameters`` are names of parameters; the keys of ``changes`` are names of
    compliances. A change that no posterior draw has is left out of ``changes``.
    """

    parameters: dict[str, ParameterIdentifiability]
    changes: dict[str, ChangeIdentifiability]


@one_blas_thread
def judge_posterior(posterior: xr.DataTree) -> dict[str, ParameterIdentifiability]:
    """Return the verdict on every parameter of a posterior.

    The verdict is identified, prior-limited (the readings hardly narrow the parameter's prior) or
    confounded (most of the parameter's variance comes from effects whose standard uncertainty is
    assumed). The field ``remedy`` is None for every parameter; `identify` finds remedies for large
    uncertainties.

    If the posterior is an average over models (`average`), the variance of a parameter is the sum
    of two parts. The first part is the mean of the parameter's variances under the models, and the
    second part is the variance of its means under the models. The second part is a separate source
    of uncertainty, ``ModelChoice``. The share of every other source in the first part is averaged
    over the models. In this average, the weight of a model is its probability times the parameter's
    variance under this model.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample`, `load` or `average`.

    Returns
    -------
    dict of str to ParameterIdentifiability
        Verdict on each parameter; the keys are names of parameters. The verdict is computed at the
        posterior mean of the hyper-parameters (such as the standard deviation of the noise) under
        each model. The fields ``mean``, ``sd`` and ``contraction`` come from the posterior draws.

    Raises
    ------
    InputError
        For a posterior from `to_units`.

    Examples
    --------
    >>> judged = lb.analysis.judge_posterior(posterior)
    >>> judged["E_YX2"].verdict.value, judged["E_YX2"].partners
    ('confounded', ('BallForm',))
    >>> judged["C_XYX_1"].verdict.value
    'prior-limited'
    """
    return dict(judge_quantities(posterior).parameters)


@cached_by_posterior
@one_blas_thread
def judge_quantities(posterior: xr.DataTree) -> JudgedQuantities:
    """Return the verdict on every parameter, and on every compliance's change with force.

    Each verdict is identified, prior-limited or confounded. The verdicts on the parameters are
    those that `judge_posterior` returns. The change of a compliance is its value at the largest
    force tested minus its value at the smallest. The same rules give the verdict on a change, from
    posterior draws of the change. If the posterior is an average over models, the prior variance of
    a change is the mean of its prior variances under the models, all with the same weight; models
    without posterior draws are left out.
    """
    bound = bound_of(posterior)
    variance, all_changes = _variance_with_changes(posterior)
    prior_variance = np.zeros(len(all_changes))
    for model_variance in variance.models:
        weights = model_variance.weights[variance.number_of_parameters :]
        prior_variance += np.sum(weights**2, axis=1) / len(variance.models)
    if bound.model.prior.flat:
        prior_variance = np.full(len(all_changes), np.inf)
    return JudgedQuantities(
        judge_average(variance, bound, _sampled_sd(posterior, bound, variance)),
        judge_changes(variance, all_changes, np.sqrt(prior_variance)),
    )


@cached_by_posterior
@one_blas_thread
def judge_at_force(posterior: xr.DataTree, force_N: float) -> dict[str, ParameterIdentifiability]:
    """Return the verdict on every parameter, with the compliances C(F) at one force F.

    The verdicts are those of `judge_posterior`, except that each compliance is judged at the force
    ``force_N`` [N] instead of the reference force. It then depends on its slopes and, if it is a
    direct compliance, on the term `JointLoad`. Their share grows with the distance from the
    reference force.
    """
    bound = bound_of(posterior)
    if force_N == bound.setting.reference_force_N:
        return judge_quantities(posterior).parameters
    models = averaged_models(posterior)
    number = len(bound.names)
    at_force = [_variance_at_force(model, force_N) for model in models]
    at_reference = [_variance_of_model(model, {}) for model in models]
    variance = AveragedVariance(tuple(at_force), number)
    reported = _sampled_sd(posterior, bound, AveragedVariance(tuple(at_reference), number))
    # What slopes and joint loads add to the prior variance of a compliance at this force.
    added = np.zeros(number)
    for model_at_force, model_at_reference in zip(at_force, at_reference, strict=True):
        difference = model_at_force.weights**2 - model_at_reference.weights**2
        added += difference.sum(axis=1) / len(models)
    prior_sd = np.sqrt(reported.prior**2 + np.maximum(added, 0.0))
    slopes = {entry.label: slopes_of(bound, entry.label) for entry in bound.compliances}
    return judge_average(variance, bound, SampledSd(prior_sd, np.sqrt(variance.variance)), slopes)


def _variance_at_force(model: AveragedModel, force_N: float) -> ModelVariance:
    """Return the variances of all parameters in one model, with compliances at one force [N].

    ``model`` is one of several models whose results are averaged.
    """
    variance = _variance_of_model(model, {})
    bound = model.bound
    beta = model.beta[:, model.parameter_indices]
    forces_N = np.array([force_N])
    curves = compliance_curves(bound, model.phi, beta, forces_N, np.random.default_rng(0))[:, 0]
    weights_of = compliance_weights(bound, variance.information, force_N)
    weights = variance.weights.copy()
    mean = variance.mean.copy()
    sd = variance.sd.copy()
    for index, compliance in enumerate(bound.compliances):
        if compliance.label not in bound.names:
            continue
        place = model.parameter_indices[bound.names.index(compliance.label)]
        weights[place] = weights_of[compliance.label]
        mean[place] = curves[:, index].mean()
        sd[place] = curves[:, index].std()
    return replace(variance, weights=weights, mean=mean, sd=sd)


class _VarianceWithChanges(NamedTuple):
    """Variances of parameters and of compliances' changes with force, and the changes by name."""

    #: variances of all parameters and, after them, of the changes of compliances with force
    variance: AveragedVariance
    changes: dict[str, CurveChange]  #: changes of compliances with force, by name of compliance


@cached_by_posterior
def _variance_with_changes(posterior: xr.DataTree) -> _VarianceWithChanges:
    """Return the variances of parameters and of compliances' changes with force in a posterior.

    The posterior may be an average over models.
    """
    bound = bound_of(posterior)
    models = averaged_models(posterior)
    # The changes of compliances with force are computed from the model ``bound``, because this
    # model has all parameters that occur in any of the averaged models.
    phi = np.concatenate([model.phi for model in models]).mean(axis=0)
    changes = curve_changes(bound, information_of(bound, phi))
    variances = tuple(_variance_of_model(model, changes) for model in models)
    return _VarianceWithChanges(AveragedVariance(variances, len(bound.names)), changes)


def _variance_of_model(model: AveragedModel, changes: Mapping[str, CurveChange]) -> ModelVariance:
    """Return the variances of parameters and of compliances' changes with force in one model.

    ``model`` is one of several models whose results are averaged. ``changes`` holds the changes of
    compliances with force that occur in any of these models; the keys are names of compliances. In
    the result, the parameters come first, then the changes. If a change does not occur in
    ``model``, its row of ``ModelVariance.weights`` is zero. This row states how much the change
    depends on each coefficient of the model.
    """
    bound = model.bound
    information = information_of(bound, model.phi.mean(axis=0))
    number_of_parameters = model.beta.shape[1]
    weights = np.zeros((number_of_parameters + len(changes), len(information.names)))
    weights[model.parameter_indices] = weights_of_parameters(information)
    mean = [model.mean]
    sd = [model.sd]
    if changes:
        changes_of_model = curve_changes(bound, information)
        for k, name in enumerate(changes):
            if name in changes_of_model:
                weights[number_of_parameters + k] = changes_of_model[name].weights
        drawn = _drawn_changes(model, list(changes))
        mean.append(drawn.mean(axis=0))
        sd.append(drawn.std(axis=0))
    return ModelVariance(
        probability=model.probability,
        bound=bound,
        information=information,
        weights=weights,
        mean=np.concatenate(mean),
        sd=np.concatenate(sd),
    )


def _drawn_changes(model: AveragedModel, names: Sequence[str]) -> Array:
    """Return posterior draws of changes of compliances with force, shape (draws, names).

    A change is the compliance at the largest force tested minus the compliance at the smallest.
    ``names`` are the names of the compliances.
    """
    bound = model.bound
    tested_N = bound.setting.force_N
    ends_N = np.array([tested_N.min(), tested_N.max()])
    beta = model.beta[:, model.parameter_indices]
    curves = compliance_curves(bound, model.phi, beta, ends_N, np.random.default_rng(0))
    labels = [compliance.label for compliance in bound.compliances]
    places = [labels.index(name) for name in names]
    return np.asarray(curves[:, 1, places] - curves[:, 0, places])


def _sampled_sd(posterior: xr.DataTree, bound: BoundModel, variance: AveragedVariance) -> SampledSd:
    """Return the prior and the posterior standard deviations of all parameters.

    ``variance`` holds the variances of the posterior draws. For a parameter with a flat prior, the
    prior standard deviation is infinite.
    """
    prior_sd = np.full(len(bound.names), np.inf)
    for j, name in enumerate(bound.names):
        if bound.parameters[j].group == "geometric":
            prior_sd[j] = bound.prior_sd[j]
        elif np.isfinite(bound.prior_sd[j]):
            # The condition that no compliance is negative changes the priors of compliances, and in
            # an average only some of the models have slopes.
            prior_sd[j] = float(posterior["prior"][name].std())
    return SampledSd(prior_sd, np.sqrt(variance.variance[: variance.number_of_parameters]))


@one_blas_thread
def confounded_in(posterior: xr.DataTree) -> dict[str, tuple[str, ...]]:
    """Return the effects confounded with each parameter, and with each change with force.

    The result is a dictionary. Its keys are the names of the confounded parameters, and names such
    as ``ΔC_XXX`` of the confounded changes of compliances over the tested forces. All others are
    left out, and so are slopes, the coefficients of these changes. A quantity is confounded if most
    of its variance comes from effects whose standard uncertainty is assumed. `judge_quantities`
    finds the same effects, but needs draws from the prior, because it returns complete verdicts.
    The posterior may be an average over models.
    """
    variance, changes = _variance_with_changes(posterior)
    return _confounded(variance, bound_of(posterior).names, changes)


@one_blas_thread
def confounded_at(bound: BoundModel, phi: Array) -> dict[str, tuple[str, ...]]:
    """Return what `confounded_in` returns, for one model at one value of the hyper-parameters.

    No posterior draws are needed, which saves time in a batch of campaigns.

    Parameters
    ----------
    bound
        Model of a campaign.
    phi
        Values of the h hyper-parameters, such as the standard deviation of the noise, shape (h,);
        lengths in mm.
    """
    information = information_of(bound, phi)
    changes = curve_changes(bound, information)
    weights_of_changes = [change.weights for change in changes.values()]
    weights = np.vstack([weights_of_parameters(information), *weights_of_changes])
    variances = np.einsum("qm,qm->q", weights @ information.covariance(), weights)
    model = ModelVariance(
        probability=1.0,
        bound=bound,
        information=information,
        weights=weights,
        mean=np.zeros(len(weights)),
        sd=np.sqrt(variances),
    )
    return _confounded(AveragedVariance((model,), len(bound.names)), bound.names, changes)


def _confounded(
    variance: AveragedVariance, names: Sequence[str], changes: Mapping[str, CurveChange]
) -> dict[str, tuple[str, ...]]:
    """Return the effects confounded with each parameter, and with each change with force.

    ``variance`` holds the variances of all parameters, whose names are ``names``, and then those of
    ``changes``. See `confounded_in` for the result.
    """
    slopes_of_quantities: dict[str, Sequence[str]] = {}
    for name in names:
        slopes_of_quantities[name] = (name,)
    for name, change in changes.items():
        slopes_of_quantities[f"Δ{name}"] = change.slopes
    confounded = {}
    for i, (name, slopes) in enumerate(slopes_of_quantities.items()):
        if is_slope(name) or variance.variance[i] == 0.0:
            continue
        sources, likeness = variance.sources(i, slopes)
        partners = confounding_sources(sources, likeness)
        if partners:
            confounded[name] = tuple(shares_by_name(partners))
    return confounded
