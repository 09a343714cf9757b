"""Uncertainty budgets of the parameters, in the form of the GUM.

A budget lists the sources of the uncertainty of one parameter. For each source it states the
standard uncertainty, the sensitivity and the share of the variance. In the following, nuisance
coefficients describe effects that are modelled but not of interest. Hyper-parameters φ are
quantities such as the standard deviation of the noise.

Given φ, the estimation error of the parameters is a sum of independent parts, one for every source.
A source is the deviation of a nuisance coefficient from its prior mean, noise of the readings, or
the deviation of the parameters from their prior means. As in the GUM, the share of source s in the
variance of a parameter y is u_s²(y) / u²(y), where u_s(y) is the standard uncertainty of y due to s
alone; the shares sum to one (`Information.shares`). Unlike in the GUM, u²(y) is the variance of the
posterior draws, which includes the uncertainty of φ, and the condition that no compliance is
negative. The shares are averages over values of φ from the posterior.

In an average over models, the share of a source is a weighted mean of its shares under the models.
The weight of a model is its probability times the parameter's variance under this model. The
parameter's posterior mean differs between the models. The variance of these means is listed as a
separate source, the choice between the models.

The standard uncertainty of every source is measured (determined by the readings of this campaign),
stated (by a certificate or by the user) or assumed; see `origins`. If stated and assumed sources
together cause more than half of the variance, the budget names the largest of these sources,
because further circles would not reduce the uncertainty that these sources cause.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from ldbb_bayes.analysis.origins import MAJORITY, Origin, is_prior_stated, origins
from ldbb_bayes.analysis.variance_sources import MODEL_CHOICE
from ldbb_bayes.errors import check_known
from ldbb_bayes.inference.averaged_models import AveragedModel, averaged_models
from ldbb_bayes.inference.posterior import bound_of, draws_of
from ldbb_bayes.model.bound_information import information_of, informations_of
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.terms import BasisNoise, Columns, Term
from ldbb_bayes.model.terms.columns import NOISE, PARAMETERS
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, ByName, Result
from ldbb_bayes.units import ranked

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["Budget", "Contribution", "budget_uncertainty"]

Kind = Literal["A", "B"]

# A nuisance coefficient (of an effect not of interest) whose share of a parameter's variance is
# below this number has no separate line in the uncertainty budget of the parameter.
_LISTED_SHARE = 1e-3
# The shares of all sources in the variance of a parameter are averaged over at most this number of
# posterior draws of the hyper-parameters. The draws are evenly spaced among all draws.
_MOST_AVERAGED = 16


@dataclass(frozen=True)
class Contribution:
    """One line of an uncertainty budget: the contribution of one source to one parameter."""

    #: name of the source of uncertainty: the name of a nuisance coefficient (a coefficient of an
    #: effect that is not of interest); the name of a kind of noise, such as ``ReadingNoise``;
    #: ``Parameters`` for the priors of the parameters; ``ModelChoice`` for the differences between
    #: averaged models; or a name such as "other Mount", for all coefficients of the term ``Mount``
    #: that each have a small share
    source: str
    term: str  #: model term, such as ``Mount``, that the source of uncertainty belongs to
    #: type of evaluation of the uncertainty (GUM 2.3.2, 2.3.3): "A" if it is evaluated from the
    #: scatter of the readings, "B" if it is evaluated by other means
    kind: Kind
    #: origin of the standard uncertainty of the source: measured in this campaign, stated by a
    #: certificate or by the user, or assumed
    origin: Origin
    #: standard uncertainty of the source itself, in the unit ``unit``; None if the source has no
    #: single standard uncertainty, for example if it consists of several coefficients
    u: float | None
    unit: str  #: unit of ``u``, the standard uncertainty of the source
    #: sensitivity coefficient of the GUM: change of the parameter's estimate per unit of the source
    #: of uncertainty. For noise, it is ``contribution`` divided by ``u``, which is always positive.
    #: None if ``u``, the standard uncertainty of the source, is None.
    sensitivity: float | None
    #: standard uncertainty of the parameter due to one source of uncertainty alone, in the
    #: parameter's unit
    contribution: float
    share: float  #: share of one source of uncertainty in the variance of a parameter


@dataclass(frozen=True)
class Budget(Result):
    """The uncertainty budget of one parameter.

    ``contributions`` are the lines of the budget, sorted by their share of the parameter's
    variance, the largest first. The shares sum to one.
    """

    parameter: str
    unit: str
    u: float  #: standard uncertainty of the parameter: its posterior standard deviation
    contributions: tuple[Contribution, ...]
    #: name of the model term with the largest share of the parameter's variance. If more than half
    #: of the variance comes from sources whose standard uncertainty is stated or assumed, the term
    #: with the largest share among these sources is taken instead.
    heaviest: str
    #: standard uncertainty that the parameter would have if the effect of the model term
    #: ``heaviest`` were known exactly; None for reading noise and for the priors of the parameters,
    #: which can never be known exactly
    u_if_known: float | None

    def share(self, term: str) -> float:
        """Return the share of a parameter's variance that one model term causes.

        The result is the sum of the shares of all sources of uncertainty that belong to the term.
        It is zero for a term that contributes nothing. Raise an `InputError` for an unknown name.
        """
        self._check_term(term)
        return sum(line.share for line in self.contributions if line.term == term)

    def origin_of(self, term: str) -> Origin:
        """Return whether the uncertainty of a model term is mainly measured, stated or assumed.

        ``term`` is the name of the model term, to which several sources may belong. Their shares of
        the parameter's variance are added up separately for each origin (measured, stated or
        assumed). The origin with the largest sum is returned. Raise an `InputError` for an unknown
        name.
        """
        self._check_term(term)
        shares = dict.fromkeys(Origin, 0.0)
        for line in self.contributions:
            if line.term == term:
                shares[line.origin] += line.share
        return ranked(shares, shares.__getitem__)[0]

    def _check_term(self, term: str) -> None:
        """Raise an `InputError` unless ``term`` is the name of a source's term, or of any term."""
        listed = [line.term for line in self.contributions]
        check_known(
            "term", [term], dict.fromkeys([*listed, PARAMETERS, NOISE, MODEL_CHOICE, *Term.kinds])
        )


@dataclass(frozen=True, eq=False)
class _ModelBudget:
    """Posterior variance of the parameters under one model, and the sources of this variance."""

    model: AveragedModel  #: the model and its posterior draws
    phi: Mapping[Any, float]  #: means of the hyper-parameters, by name
    information: Information  #: linear model of the readings at these means
    #: posterior covariance of all m coefficients (parameters and nuisance coefficients) at these
    #: means, shape (m, m), in units of the prior standard deviations
    covariance: Array
    #: variances of the model's p parameters, shape (p,), in units of mm, N and rad
    variance: Array
    #: for each source, its share in the variance of each parameter, shape (p,). A key is a pair:
    #: the name of the source and the name of its model term.
    shares: Mapping[tuple[str, str], Array]
    #: whether the standard uncertainty of each source is measured in this campaign, stated or
    #: assumed. The keys are pairs as in ``shares``.
    origins: Mapping[tuple[str, str], Origin]
    #: for each model term, the variances that the parameters would have if the effect of the term
    #: were known exactly, divided by their present variances, shape (p,)
    ratio_if_known: Mapping[str, Array]

    @property
    def bound(self) -> BoundModel:
        """The model of the uncertainty budget, applied to the tests of the campaign."""
        return self.model.bound


class _WeightedBudget(NamedTuple):
    """Budget under one model that has a certain parameter, and the weight of this model."""

    budget: _ModelBudget
    row: int  #: index of the parameter among the parameters of the model
    #: probability of the model times the variance of the parameter under this model
    weight: float


@dataclass(frozen=True, eq=False)
class _ParameterVariance:
    """The variance of one parameter under one model, or in an average over several models."""

    by_model: Sequence[_WeightedBudget]  #: the models that have the parameter
    #: variance of the parameter's posterior means, which differ between the models; None if there
    #: is only one model
    spread: float | None

    @property
    def total(self) -> float:
        """Total variance of the parameter, including the differences between the models.

        The share of a source of uncertainty is its contribution divided by this variance. If the
        variance is zero, the result is 1, to avoid a division by zero.
        """
        total = sum(of_model.weight for of_model in self.by_model) + (self.spread or 0.0)
        return total or 1.0


class _SourceKey(NamedTuple):
    """A source of uncertainty, identified by three values: its name, model term and origin."""

    source: str
    term: str
    origin: Origin


@dataclass
class _SourceShare:
    """Share of one source of uncertainty in the variance of a parameter, summed over the models."""

    share: float  #: sum of the parts that all models contribute to the share
    largest: float  #: largest of these parts
    budget: _ModelBudget  #: budget under the model that contributes the largest part
    row: int  #: index of the parameter among the parameters of this model


class _NoiseSource(NamedTuple):
    """One kind of noise of the readings, as a source of uncertainty.

    ``kind`` is the type of evaluation of the GUM, A or B. ``u`` is the standard uncertainty in the
    unit ``unit``, or None if one line of the budget combines several kinds of noise.
    """

    kind: Kind
    u: float | None
    unit: str


@one_blas_thread
def budget_uncertainty(posterior: xr.DataTree) -> dict[str, Budget]:
    """Return the uncertainty budget of every parameter of a posterior, in the form of the GUM.

    The share of a source s in the variance of a parameter y is u_s²(y) / u²(y) as in the GUM, where
    u_s(y) is the standard uncertainty of y due to s alone. The variance u²(y) is the variance of
    the posterior draws. Unlike the variance of the GUM, it includes the truncation (compliances are
    not negative) and the uncertainty of the hyper-parameters (such as the standard deviation of the
    noise). The shares are averages over up to 16 draws of the hyper-parameters. The standard
    uncertainty of every source is measured (determined by the readings of this campaign), stated
    (by a certificate or the user) or assumed. Which of the three applies is determined at the mean
    of the hyper-parameters.

    In an average over models m with probabilities p_m, u² is Σ p_m (var_m + (mean_m − mean)²). Here
    mean_m and var_m are the posterior mean and variance of the parameter under model m, and mean is
    the average of mean_m. The weight of the shares under model m is p_m var_m. The variance of the
    means mean_m is a separate source, ``ModelChoice``.

    Parameters
    ----------
    posterior : DataTree
        Posterior from `sample`, `load` or `average`.

    Returns
    -------
    dict of str to Budget
        Budget of each parameter by name, in internal units (mm, N, rad). ``contributions`` of a
        budget are its lines, the largest share first. ``heaviest`` is the model term with the
        largest share. If sources whose standard uncertainty is stated or assumed cause more than
        half of the variance, the term is chosen from these sources.

    Raises
    ------
    InputError
        For a posterior from `to_units`.

    Examples
    --------
    >>> budget = lb.analysis.budget_uncertainty(posterior)["C_XXX"]
    >>> budget.heaviest
    'Mount'
    >>> round(budget.share("Mount"), 1), budget.origin_of("Mount").value
    (0.3, 'assumed')
    >>> round(sum(line.share for line in budget.contributions), 6)
    1.0
    """
    bound = bound_of(posterior)
    models = averaged_models(posterior)
    budgets_of_models = [_budget_of_model(model) for model in models]
    beta, _ = draws_of(posterior, bound)
    sd = beta.std(axis=0, ddof=1)
    mean = beta.mean(axis=0)
    spread = np.zeros(len(mean))
    for model in models:
        spread += model.probability * (model.mean - mean) ** 2
    budgets_by_name = ByName[Budget]()
    for i, parameter in enumerate(bound.parameters):
        u = float(sd[i])
        spread_of_models = float(spread[i]) if len(models) > 1 else None
        variance = _variance_of_parameter(budgets_of_models, i, spread_of_models)
        contributions = _contributions(variance, u)
        heaviest = _heaviest_term(contributions)
        budgets_by_name[parameter.name] = Budget(
            parameter=parameter.name,
            unit=parameter.unit,
            u=u,
            contributions=contributions,
            heaviest=heaviest,
            u_if_known=_uncertainty_if_known(variance, heaviest, u),
        )
    return budgets_by_name


def _budget_of_model(model: AveragedModel) -> _ModelBudget:
    """Return the variance of the parameters under one model, and the sources of this variance.

    The variances of the parameters are those of the posterior draws in ``model``. The shares of the
    sources are averaged over draws of the hyper-parameters; there are more draws for a more
    probable model. All other results are computed at the mean of the hyper-parameters.
    """
    bound = model.bound
    phi = model.phi.mean(axis=0)
    information = information_of(bound, phi)
    interest = information.interest
    scale = information.scale[interest]
    covariance_of_draws = np.atleast_2d(np.cov(model.beta[:, model.parameter_indices].T, ddof=0))
    scaled_covariance = covariance_of_draws / np.outer(scale, scale)
    covariance = information.covariance()
    present_variance = np.diag(covariance)[interest]
    ratio_if_known = {}
    for term in information.terms:
        ratio_if_known[term] = information.variances([term]) / present_variance
    number_of_draws = int(np.ceil(_MOST_AVERAGED * model.probability))
    return _ModelBudget(
        model=model,
        information=information,
        variance=np.diag(covariance_of_draws),
        covariance=covariance,
        shares=_average_shares(bound, model.phi, scaled_covariance, number_of_draws),
        ratio_if_known=ratio_if_known,
        phi=dict(zip(bound.hyper_prior.names, phi.tolist(), strict=True)),
        origins=origins(bound, information),
    )


def _variance_of_parameter(
    budgets: Sequence[_ModelBudget], i: int, spread: float | None
) -> _ParameterVariance:
    """Return the variance of one parameter, from all models that have this parameter.

    ``budgets`` holds the uncertainty budget under each model. ``i`` is the index of the parameter
    in the list of all parameters of these models. The parameter's posterior mean differs between
    the models; ``spread`` is the variance of these means, or None if there is only one model.
    """
    by_model = []
    for budget in budgets:
        # Row of the parameter in the arrays of this model's budget; empty if the model does not
        # have the parameter.
        rows_of_parameter = np.flatnonzero(budget.model.parameter_indices == i)
        for row in rows_of_parameter.tolist():
            weight = budget.model.probability * float(budget.variance[row])
            by_model.append(_WeightedBudget(budget, row, weight))
    return _ParameterVariance(by_model, spread)


def _average_shares(
    bound: BoundModel, phi: Array, covariance: Array, count: int
) -> dict[tuple[str, str], Array]:
    """Return the shares of all sources, averaged over ``count`` draws of the hyper-parameters φ.

    ``phi``, shape (draws, h), are posterior draws of the h hyper-parameters φ; ``covariance``,
    shape (p, p), is the covariance of the p parameters in units of their prior standard deviations.
    The result is a dict. Each key is a pair: the name of a source and the name of its model term.
    Each value, shape (p,), holds the share of every parameter's variance that this source causes
    (see `Information.shares`).
    """
    count = min(count, len(phi))
    chosen = phi[np.linspace(0, len(phi) - 1, count).round().astype(int)]
    average: dict[tuple[str, str], Array] = {}
    for information in informations_of(bound, chosen):
        for key, share in information.shares(covariance).items():
            average[key] = average.get(key, 0.0) + share / count
    return average


def _contributions(variance: _ParameterVariance, u: float) -> tuple[Contribution, ...]:
    """Return the lines of the budget of one parameter, the largest share of the variance first.

    ``u`` is the parameter's standard uncertainty. Coefficients with shares below 0.1 % are listed
    together in one line if they have the same model term and the same origin.
    """
    lines = []
    unlisted_shares: dict[tuple[str, Origin], float] = {}
    for key, portion in _shares_of_sources(variance).items():
        if key.source == key.term:
            noise = _noise_source(portion.budget.bound, key.term, portion.budget.phi)
            lines.append(_contribution(key, noise.kind, portion.share, u, noise.u, noise.unit))
        elif abs(portion.share) < _LISTED_SHARE:
            group = (key.term, key.origin)
            unlisted_shares[group] = unlisted_shares.get(group, 0.0) + portion.share
        else:
            lines.append(_coefficient_line(key, portion, u))
    if variance.spread is not None:
        key = _SourceKey(MODEL_CHOICE, MODEL_CHOICE, Origin.MEASURED)
        lines.append(_contribution(key, "A", variance.spread / variance.total, u))
    for (term, origin), share in unlisted_shares.items():
        lines.append(_contribution(_SourceKey(f"other {term}", term, origin), "B", share, u))
    return tuple(ranked(lines, lambda line: line.share))


def _shares_of_sources(variance: _ParameterVariance) -> dict[_SourceKey, _SourceShare]:
    """Return the share of one parameter's variance that each source of uncertainty causes.

    If the posterior is an average over models, the shares are averaged over these models.
    """
    portions: dict[_SourceKey, _SourceShare] = {}
    for budget, row, weight in variance.by_model:
        for (source, term), shares in budget.shares.items():
            key = _SourceKey(source, term, _origin_of(budget, row, source, term))
            share = weight / variance.total * float(shares[row])
            portion = portions.setdefault(key, _SourceShare(0.0, -np.inf, budget, row))
            portion.share += share
            if share > portion.largest:
                portion.largest = share
                portion.budget = budget
                portion.row = row
    return portions


def _origin_of(budget: _ModelBudget, row: int, source: str, term: str) -> Origin:
    """Return whether the standard uncertainty of a source is measured, stated or assumed.

    The source is in the budget of the parameter with the index ``row``. ``source`` and ``term`` are
    the names of the source and of its model term.
    """
    if term == PARAMETERS and is_prior_stated(budget.bound, budget.bound.names[row]):
        return Origin.STATED
    return budget.origins[source, term]


def _coefficient_line(key: _SourceKey, portion: _SourceShare, u: float) -> Contribution:
    """Return the line of one nuisance coefficient in the budget of a parameter.

    ``key`` names the coefficient, ``portion`` holds its share of the parameter's variance, and
    ``u`` is the standard uncertainty of the parameter. In an average over models, the coefficient's
    standard uncertainty and the sign of its sensitivity come from the model that contributes most
    to the share.
    """
    information = portion.budget.information
    place = information.interest[portion.row]
    column = information.names.index(key.source)
    # If the true value of the nuisance coefficient is larger than its prior mean, the estimate of
    # the parameter has an error. The sign of this error is opposite to the sign of the posterior
    # covariance between coefficient and parameter.
    sign = -float(np.sign(portion.budget.covariance[place, column]))
    source_u = float(information.scale[column])
    unit = Term.owner(key.source).unit_of(key.source).inside
    return _contribution(key, "B", portion.share, u, source_u, unit, sign)


def _contribution(
    key: _SourceKey,
    kind: Kind,
    share: float,
    u: float,
    source_u: float | None = None,
    unit: str = "",
    sign: float = 1.0,
) -> Contribution:
    """Return the line of a source in the uncertainty budget of a parameter.

    ``key`` holds the names of the source and of its model term, and the origin of the source's
    uncertainty: measured, stated or assumed. ``share`` is the source's share of the variance. ``u``
    is the standard uncertainty of the parameter. ``source_u`` is the standard uncertainty of the
    source in the unit ``unit``, or None if the source has no single standard uncertainty. ``kind``
    is the type of evaluation, A or B of the GUM. ``sign`` is the sign of the sensitivity.
    """
    contribution = float(np.sqrt(max(share, 0.0))) * u
    sensitivity = None
    if source_u is not None:
        sensitivity = sign * contribution / source_u
    return Contribution(
        source=key.source,
        term=key.term,
        kind=kind,
        origin=key.origin,
        u=source_u,
        unit=unit,
        sensitivity=sensitivity,
        contribution=contribution,
        share=share,
    )


def _noise_source(bound: BoundModel, term: str, phi: Mapping[Any, float]) -> _NoiseSource:
    """Return the type of evaluation, standard uncertainty and unit of one source of uncertainty.

    ``term`` names the source in the budget. The source is either an effect that acts on single
    tests like noise of the readings, or white noise, or the priors of all parameters together. The
    type of evaluation is A or B, as in the GUM: A for noise, B for the priors and for effects with
    separate coefficients in each test. The standard uncertainty is the hyper-parameter that scales
    the source. If there is none, it is the prior sd of the effect's only coefficient in each test.
    If the source has no such single number, the standard uncertainty is None and the unit is an
    empty string. ``phi`` are the hyper-parameters by name, with lengths in mm.
    """
    if term == NOISE:
        return _NoiseSource("A", phi["sigma"], "mm")
    columns: Sequence[Columns | BasisNoise] = ()
    if term in Term.kinds:
        columns = bound.columns_of.get(Term.kinds[term], ())
    noises = [block for block in columns if isinstance(block, BasisNoise) or block.private]
    is_scatter = len(noises) > 0 and all(isinstance(block, BasisNoise) for block in noises)
    kind: Kind = "A" if is_scatter else "B"
    if len(noises) != 1:
        return _NoiseSource(kind, None, "")
    (noise,) = noises
    if noise.hyper is not None:
        return _NoiseSource(kind, phi[noise.hyper], "mm")
    if isinstance(noise, Columns) and len(noise.names) == 1:
        unit = Term.kinds[term].unit_of(noise.names[0]).inside
        return _NoiseSource(kind, float(noise.sd[0]), unit)
    return _NoiseSource(kind, None, "")


def _heaviest_term(contributions: Sequence[Contribution]) -> str:
    """Return the model term with the largest share of a parameter's variance.

    Some sources have a standard uncertainty that is not determined by the readings, but stated by a
    certificate or by the user, or assumed. If these sources cause more than half of the variance,
    only they are compared, because more circles would not reduce their uncertainty.
    ``contributions`` are the lines of the parameter's budget.
    """
    shares: dict[str, float] = {}
    not_measured: dict[str, float] = {}
    for line in contributions:
        shares[line.term] = shares.get(line.term, 0.0) + line.share
        if line.origin != Origin.MEASURED:
            not_measured[line.term] = not_measured.get(line.term, 0.0) + line.share
    candidates = not_measured if sum(not_measured.values()) > MAJORITY else shares
    return ranked(candidates, candidates.__getitem__)[0]


def _uncertainty_if_known(variance: _ParameterVariance, term: str, u: float) -> float | None:
    """Return the standard uncertainty that a parameter would have if one effect were known exactly.

    ``variance`` is the variance of the parameter, averaged over models. ``term`` is the name of the
    model term that describes the effect, and ``u`` is the present standard uncertainty of the
    parameter. Return None if the effect can never be known exactly, as in the case of reading
    noise.
    """
    remaining = variance.spread or 0.0
    can_be_known = False
    for budget, row, weight in variance.by_model:
        ratio = 1.0
        if term in budget.ratio_if_known:
            ratio = float(budget.ratio_if_known[term][row])
            can_be_known = True
        remaining += weight * ratio
    if not can_be_known:
        return None
    return u * float(np.sqrt(remaining / variance.total))
