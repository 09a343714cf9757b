"""Parts in which the models of two fits differ.

A difference between two campaigns may come from these instead of the machines.
"""

from __future__ import annotations

from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.model.terms import Term

__all__ = ["differing_parts"]


def differing_parts(model: HybridModel, other: HybridModel) -> tuple[str, ...]:
    """Return the parts in which two models differ.

    The reference force is no such part, because parameters are compared at one force.

    Parameters
    ----------
    model, other : HybridModel
        The two models.

    Returns
    -------
    tuple of str
        Some of ``priors``, ``terms``, ``degree`` and ``fixed parameters``; empty if the models are
        alike.
    """
    differs = {
        "priors": model.prior != other.prior,
        "terms": _terms_by_name(model) != _terms_by_name(other),
        "degree": model.degree != other.degree,
        "fixed parameters": set(model.fixed) != set(other.fixed),
    }
    return tuple(part for part, is_different in differs.items() if is_different)


def _terms_by_name(model: HybridModel) -> dict[str, Term]:
    """Return the terms of a model; the keys are the names of their classes."""
    return {type(term).__name__: term for term in model.nuisances}
