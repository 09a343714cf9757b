"""Model for an analysis of planned tests alone, without the readings of the pilot.

The pilot is the campaign or plan that a design starts from. The model takes its reference force,
and the prior standard deviations of the slopes (changes of compliance with force), from the pilot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ldbb_bayes.analysis.design.named_parameters import restricted_to, unconstrained_names
from ldbb_bayes.analysis.design.space import Space
from ldbb_bayes.campaign.campaign import CircularTest
from ldbb_bayes.model.hybrid import HybridModel

__all__ = ["analysis_model"]


def analysis_model(space: Space, tests: Sequence[CircularTest]) -> HybridModel:
    """Return the model for an analysis of planned tests alone, without the readings of the pilot.

    The model takes its reference force, and the prior standard deviations of the slopes, from the
    pilot. ``space`` holds the model and the pilot of the design, and ``tests`` are the planned
    tests.
    """
    model = space.model
    setting = space.bound.setting
    prior = model.prior
    plan = replace(space.pilot, tests=tuple(tests), foreseen=())
    names = unconstrained_names(model, plan, pilot=space.pilot)

    overrides = dict(prior.overrides)
    forces = [float(test.force_N or 0.0) for test in tests]
    force_range_N = max(forces) - min(forces)
    if not (prior.flat or np.isclose(force_range_N, setting.force_range_N, rtol=1e-9)):
        # The default prior standard deviation of a slope depends on the range of force of the
        # tests. Set this prior standard deviation to its value for the campaign that the design
        # starts from.
        for parameter in space.bound.parameters:
            if parameter.group == "slope":
                overrides[parameter.name] = parameter.prior_sd
    with_slopes = replace(
        model,
        reference_force_N=setting.reference_force_N,
        prior=replace(prior, overrides=overrides),
    )
    return restricted_to(with_slopes, names)
