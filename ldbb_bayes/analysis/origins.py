"""Origins of the sources of uncertainty: measured in this campaign, stated or assumed.

Every source in the uncertainty budget of a parameter has one of three origins:

- *stated*, if a certificate, or a prior that the user gave, states the standard uncertainty of the
  source;
- *measured here*, if the readings of this campaign alone determine the effect of the source well
  enough: the standard uncertainty of the effect, computed with a flat prior, is less than half of
  the standard deviation of the model's prior;
- *assumed*, if neither is the case.

The origin is determined for each coefficient separately, at the Fourier order of the coefficient.
For example, the readings may determine a form error of the balls at the orders 5 to 12. The prior
of the form error may extend this knowledge to the orders 2 and 3. At these two orders, the form
error still does not count as measured. When an origin is determined, the priors of the parameters
of interest (compliances, their changes with force, and geometric errors) are made flat, too.
Otherwise, the narrow prior of a squareness error would count as a measurement of a form error that
changes the readings in the same way. All other effects keep their priors. Nuisance terms are the
terms of a model for effects that are modelled but not of interest.

Scatter differs from reading to reading, or from circle to circle, and is not described by
coefficients that several circles have in common. Reading noise counts as measured here, because the
readings determine its standard deviation. The same holds for shifts from one set-up to the next,
and for the discrepancy between model and readings. Scatter with a fixed standard deviation, such as
the random error of the force, is stated or assumed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from enum import StrEnum
from functools import cache
from typing import Any, NamedTuple, cast

from ldbb_bayes.model.hybrid import BoundModel, HybridModel
from ldbb_bayes.model.information import Information
from ldbb_bayes.model.parameter_kinds import settings_of_sd
from ldbb_bayes.model.terms import BasisNoise, Columns, Term
from ldbb_bayes.model.terms.columns import NOISE, PARAMETERS, Source

__all__ = [
    "MAJORITY",
    "Origin",
    "is_prior_stated",
    "is_size_stated",
    "origins",
    "ready_made_terms",
    "term_named",
]

# Sources of uncertainty are said to cause most of a parameter's variance if their share of the
# variance, taken together, is above this number. If these sources were removed, the standard
# uncertainty of the parameter would be smaller by about 30 % or more.
MAJORITY = 0.5
# The readings of a campaign are said to measure an effect if they alone determine it well enough:
# its standard uncertainty, computed with a flat prior of the effect, is below this share of the
# standard deviation of the model's prior.
MEASURED_SD_RATIO = 0.5


class Origin(StrEnum):
    """Origin of a source's standard uncertainty: measured in this campaign, stated or assumed."""

    #: the readings of this campaign determine the standard uncertainty
    MEASURED = "measured here"
    #: a certificate, or a prior that the user gave, states the standard uncertainty
    STATED = "stated"
    #: the standard uncertainty is that of a default prior
    ASSUMED = "assumed"


def origins(bound: BoundModel, information: Information) -> dict[tuple[str, str], Origin]:
    """Return the origin of each source of uncertainty of a model's parameters.

    The standard uncertainty of a source is measured by the readings of this campaign, stated by a
    certificate or by the user, or assumed by the model.

    The keys are the same as in `Information.shares`. Each key is a pair of names: the name of the
    source (a coefficient or a kind of noise), and the class name of the model term to which the
    source belongs. In this function, the priors of the parameters (key ``(PARAMETERS,
    PARAMETERS)``) count as assumed. Use `is_prior_stated` to find out whether the user gave the
    prior of a parameter.

    Parameters
    ----------
    bound
        Model of a campaign or of a plan.
    information
        Linear model of the readings (`Information`), at one value of the hyper-parameters.
    """
    sd_ratio = information.sd_from_readings()
    origin_of: dict[tuple[str, str], Origin] = {(PARAMETERS, PARAMETERS): Origin.ASSUMED}
    for k, (name, owner) in enumerate(zip(information.names, information.owners, strict=True)):
        if owner == PARAMETERS:
            continue
        origin = Origin.ASSUMED
        if is_size_stated(bound, name, term_named(bound, owner)):
            origin = Origin.STATED
        elif sd_ratio[k] < MEASURED_SD_RATIO:
            origin = Origin.MEASURED
        origin_of[name, owner] = origin
    for sources in information.noise:
        for name in sources:
            if (name, name) not in origin_of:
                origin_of[name, name] = _origin_of_noise(bound, name)
    return origin_of


def is_size_stated(bound: BoundModel, coefficient: str, term: Term | None) -> bool:
    """Return whether the user or a certificate states the prior sd of a nuisance coefficient.

    ``term`` is the model term to which the coefficient belongs. Return False if ``term`` is None,
    which means that the model has no such term. The prior sd counts as stated in three cases: a
    certificate states it, the user has changed it, or the model has the term only because the user
    has added it with ``with_term``. Changes of other settings do not count. For example, the user
    may remove the curvature from a mount's deflection. The prior sd of the deflection is then still
    not stated.
    """
    if term is None:
        return False
    return _is_size_edited(bound, coefficient, term) or term.is_stated(coefficient, bound.campaign)


def _is_size_edited(bound: BoundModel, coefficient: str, term: Term) -> bool:
    """Return whether the user has changed the prior sd of a coefficient.

    ``term`` is the model term to which the coefficient belongs. The result is also True for a term
    that no model has by default, because the user must have added such a term.
    """
    if type(term).on_demand:
        return True
    usual = _with_usual_sizes(bound, term)
    if usual == term:
        return False
    stated_size = _prior_size(term, bound, coefficient)
    usual_size = _prior_size(usual, bound, coefficient)
    return stated_size != usual_size


def _with_usual_sizes(bound: BoundModel, term: Term) -> Term:
    """Return a model term with default settings instead of the user's settings.

    The default settings are those of the term in the ready-made model, such as
    ``HybridModel.first``, from which the model was made. If the ready-made model does not have the
    term, the defaults of the term's class are used. Settings that are strings, such as the
    covariate of a drift, are kept, because they state which effect is modelled, and not how large
    the effect is.
    """
    usual = ready_made_terms(bound).get(type(term), type(term)())
    kinds_of_effect = {name: value for name, value in vars(term).items() if isinstance(value, str)}
    with_usual_sizes: Term = replace(cast("Any", usual), **kinds_of_effect)
    return with_usual_sizes


class _PriorSize(NamedTuple):
    """Three values from which the prior standard deviation of a coefficient is computed.

    One part of the prior standard deviation may be proportional to hyper-parameters; another part
    may be fixed.
    """

    #: the prior standard deviation or, if it is proportional to ``hyper_parameters``, the factor of
    #: proportionality
    sd: float
    #: the hyper-parameters to whose product the prior standard deviation is proportional
    hyper_parameters: Source
    #: the fixed part of the prior standard deviation, which the user or a certificate states
    stated: float


def _prior_size(term: Term, bound: BoundModel, coefficient: str) -> _PriorSize | None:
    """Return the values that determine the prior standard deviation of a coefficient.

    ``coefficient`` is the name of a coefficient of the model term ``term``. Return None if the term
    has no coefficient of this name.
    """
    for columns in term.columns(bound.setting):
        if isinstance(columns, Columns) and coefficient in columns.names:
            k = columns.names.index(coefficient)
            stated = 0.0 if columns.stated is None else float(columns.stated[k])
            return _PriorSize(float(columns.sd[k]), columns.sources[k], stated)
    return None


def is_prior_stated(bound: BoundModel, parameter: str) -> bool:
    """Return whether the user gave the prior of a parameter of interest.

    The prior counts as given by the user in two cases. Either the user has stated a mean or an sd
    for this parameter, or the user has changed a setting of the model's `Prior` on which the sd
    depends.
    """
    prior = bound.model.prior
    if parameter in prior.overrides or parameter in prior.means:
        return True
    default = _ready_made_model(bound).prior
    settings = settings_of_sd(parameter)
    return any(getattr(prior, name) != getattr(default, name) for name in settings)


def ready_made_terms(bound: BoundModel) -> dict[type[Term], Term]:
    """Return the nuisance terms of a model, with the settings that they have by default.

    The terms are those of the ready-made model, such as ``HybridModel.first``, from which the model
    ``bound`` was made. Changes that the user has made since are ignored. The keys are the classes
    of the terms.
    """
    return {type(term): term for term in _ready_made_model(bound).nuisances}


def _ready_made_model(bound: BoundModel) -> HybridModel:
    """Return the ready-made model, such as ``HybridModel.first``, from which a model was made.

    The ready-made model ``paper`` has no nuisance terms; ``HybridModel.first`` is returned in its
    place.
    """
    return _ready_made_model_named(bound.model.preset, bound.model.degree)


@cache
def _ready_made_model_named(preset: str, degree: int) -> HybridModel:
    """Return the ready-made model ``HybridModel.default`` or ``HybridModel.first``.

    ``preset`` is the name of a ready-made model. For every name except "default", the result is
    ``HybridModel.first``. ``degree`` is the degree of the compliances as polynomials of force.
    """
    if preset == "default":
        return HybridModel.default(degree)
    return HybridModel.first(degree)


def term_named(bound: BoundModel, owner: str) -> Term | None:
    """Return the nuisance term of the class named ``owner``; None if the model has no such term.

    ``bound`` is the model, applied to a campaign or to a plan.
    """
    for term in bound.model.nuisances:
        if type(term).__name__ == owner:
            return term
    return None


def _origin_of_noise(bound: BoundModel, name: str) -> Origin:
    """Return where the standard deviation of scatter, such as the reading noise, comes from.

    The result is ``MEASURED`` if the readings determine the standard deviation, ``STATED`` if a
    certificate or the user states it, and otherwise ``ASSUMED``. ``name`` is the class name of the
    model term that causes the scatter, or the name of the reading noise.
    """
    if name == NOISE:
        return Origin.MEASURED
    noises = _noises_of(bound).get(name, ())
    if noises and all(noise.hyper is not None for noise in noises):
        return Origin.MEASURED
    term = term_named(bound, name)
    for noise in noises:
        names = noise.names if isinstance(noise, Columns) else ()
        if names and all(is_size_stated(bound, coefficient, term) for coefficient in names):
            return Origin.STATED
    return Origin.ASSUMED


def _noises_of(bound: BoundModel) -> Mapping[str, tuple[Columns | BasisNoise, ...]]:
    """Return the effects of those coefficients that have a separate value in each test.

    Such coefficients act as noise. The keys of the result are class names of model terms; each
    value holds the effects of a term's coefficients as columns of the design matrix. A column is
    the change of the readings per unit of a coefficient.
    """
    noises = {}
    for kind, columns in bound.columns_of.items():
        noises[kind.__name__] = tuple(
            block for block in columns if isinstance(block, BasisNoise) or block.private
        )
    return noises
