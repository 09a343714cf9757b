"""Model that is written beside a plan, for the analysis of its readings.

The pilot is the campaign or plan that a design starts from. The model takes its reference force,
and the prior standard deviations of the slopes (changes of compliance with force), from the pilot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ldbb_bayes.analysis.design.named_parameters import restricted_to, unconstrained_names
from ldbb_bayes.analysis.design.slope_priors_of_pilot import with_slope_priors_of_pilot
from ldbb_bayes.analysis.design.space import Space
from ldbb_bayes.campaign.campaign import CircularTest
from ldbb_bayes.model.hybrid import HybridModel

__all__ = ["analysis_model"]


def analysis_model(space: Space, tests: Sequence[CircularTest]) -> HybridModel:
    """Return the model that is written beside a plan, for the analysis of its readings.

    The model takes its reference force from the pilot, and also the prior standard deviations of
    the slopes if the analysed tests have another range of force (`with_slope_priors_of_pilot`).
    ``space`` holds the model and the pilot of the design, and ``tests`` are the planned tests.
    """
    plan = replace(
        space.pilot,
        tests=tuple(tests),
        foreseen=(),
        pilot=space.pilot,
        adds_to_pilot=space.augment,
    )
    model = with_slope_priors_of_pilot(space.model, plan)
    alone = replace(plan, pilot=None, adds_to_pilot=False)
    names = unconstrained_names(model, alone, pilot=space.pilot)
    at_force_of_pilot = replace(model, reference_force_N=space.bound.setting.reference_force_N)
    return restricted_to(at_force_of_pilot, names)
