"""Nuisance terms (effects modelled but not of interest) of the model's first edition.

The first edition is the model of the first version of this software. Its preset is named ``first``.
"""

from __future__ import annotations

from ldbb_bayes.model.terms.balls import BallForm
from ldbb_bayes.model.terms.base import Term
from ldbb_bayes.model.terms.circles import Discrepancy, Hysteresis, SetupShift
from ldbb_bayes.model.terms.instrument import BarLength, ForceError, Mount

__all__ = ["first_edition"]


def first_edition() -> tuple[Term, ...]:
    """Return the nuisance terms of the model's first edition (preset ``first``).

    Nuisance terms are effects modelled but not of interest. The prior sd of a form error of the
    balls with n waves around the circle is proportional to 1/n. Mount deflection and force error
    are modelled without curvature. Circles have no noise factors, so that random effects have the
    same prior sds in all circles. The part of hysteresis that does not depend on force has a fixed
    prior sd.
    """
    return (
        BallForm(law="1/n"),
        BarLength(),
        Mount(curvature_um=0.0),
        ForceError(curvature_sd=0.0),
        SetupShift(),
        Discrepancy(),
        Hysteresis(law="fixed"),
    )
