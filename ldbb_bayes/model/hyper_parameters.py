"""Hyper-parameters φ of a model: the noise of the readings and the scales of its nuisance terms.

Nuisances are effects that are modelled but not of interest. Most hyper-parameters are sds of
effects. Some are numbers without unit, such as the exponent with which form errors decrease with
their order.
"""

from __future__ import annotations

from collections.abc import Sequence

from ldbb_bayes.model.column_checks import checked_columns
from ldbb_bayes.model.setting import Setting
from ldbb_bayes.model.terms import Scale, Term

__all__ = ["acting_hyper_parameters", "hyper_parameters_of"]

# Hyper-parameter that every model has: the standard deviation σ of the readings' white noise.
_SIGMA = Scale("sigma", "sigma_um", "σ", "white noise")
# Order of the hyper-parameters in all arrays and lists. Hyper-parameters that are not named here
# follow. The factors λ, each of which multiplies the noise of one circle, are last.
_ORDER = ("sigma", "delta", "delta_0", "delta_1", "kappa", "tau", "decay", "omega", "eta")


def hyper_parameters_of(nuisances: Sequence[Term]) -> tuple[Scale, ...]:
    """Return the sd σ of white noise, then the hyper-parameters of the terms ``nuisances``."""
    scales = [_SIGMA]
    for term in nuisances:
        scales.extend(term.scales)
    return _ordered(scales)


def acting_hyper_parameters(nuisances: Sequence[Term], setting: Setting) -> tuple[Scale, ...]:
    """Return the hyper-parameters that have an effect on the tests of a campaign.

    If the noise of each circle is multiplied by a factor λ, these factors are included.
    ``nuisances`` are the terms of the model, and ``setting`` describes the test conditions.
    """
    scales = [_SIGMA]
    for term in nuisances:
        scales.extend(term.scales_in(setting))
    names = {scale.name for scale in scales}
    acting = {_SIGMA.name}
    for term in nuisances:
        for columns in checked_columns(term, setting, names):
            for source in columns.sources:
                acting.update(source.names)
    return _ordered([scale for scale in scales if scale.name in acting])


def _ordered(scales: Sequence[Scale]) -> tuple[Scale, ...]:
    """Return the hyper-parameters ``scales`` without repetition, in the order of ``_ORDER``.

    Hyper-parameters that are not in ``_ORDER`` follow. The factors λ, each of which multiplies the
    noise of one circle, are last.
    """

    def rank(scale: Scale) -> int:
        """Return the rank of the hyper-parameter ``scale``; hyper-parameters are sorted by rank."""
        if scale.name in _ORDER:
            return _ORDER.index(scale.name)
        return len(_ORDER) + int(scale.law == "circle")

    return tuple(sorted(dict.fromkeys(scales), key=rank))
