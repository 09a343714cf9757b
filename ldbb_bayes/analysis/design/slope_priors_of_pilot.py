"""Priors of slopes for the analysis of planned tests whose range of force is not the pilot's.

The pilot is the campaign or plan that a design starts from. The default prior standard deviation of
a slope (change of a compliance with force) depends on the range of force. A plan is analysed with
the priors of its pilot, so that its model states them where its own range of force is another one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ldbb_bayes.analysis.design.named_parameters import unconstrained_names
from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.model.hybrid import HybridModel

__all__ = ["with_slope_priors_of_pilot"]


def with_slope_priors_of_pilot(model: HybridModel, plan: Campaign) -> HybridModel:
    """Return the model with which the tests of a plan are analysed.

    If the range of force of the analysed tests is not that of the plan's pilot, the result states
    the prior standard deviations that the slopes have in the model of the pilot. The analysed tests
    are those of the plan or, if these are added to the pilot's, both together. In all other cases,
    and if the plan has no pilot, the result is ``model`` itself.
    """
    pilot = plan.pilot
    if pilot is None or model.prior.flat or model.degree == 0:
        return model
    forces_N = plan.forces_N
    if plan.adds_to_pilot:
        forces_N = np.concatenate([pilot.forces_N, forces_N])
    if np.isclose(np.ptp(forces_N), np.ptp(pilot.forces_N), rtol=1e-9):
        return model
    alone = replace(plan, pilot=None, adds_to_pilot=False)
    names = unconstrained_names(model, alone, pilot=pilot)
    overrides = dict(model.prior.overrides)
    for parameter in model.bind(pilot).parameters:
        if parameter.group == "slope" and parameter.name in names:
            overrides[parameter.name] = parameter.prior_sd
    return replace(model, prior=replace(model.prior, overrides=overrides))
