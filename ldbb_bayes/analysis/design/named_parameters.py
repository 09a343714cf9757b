"""Restriction of what a model states about single parameters to the parameters of a campaign."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from ldbb_bayes.campaign.campaign import Campaign
from ldbb_bayes.model.hybrid import BoundModel, HybridModel

__all__ = ["restricted_to", "unconstrained_names"]


def unconstrained_names(
    model: HybridModel, campaign: Campaign, *, pilot: Campaign | None = None
) -> list[str]:
    """Return the names of the parameters of a campaign, if none has a fixed value.

    Parameters
    ----------
    model
        Model whose fixed parameters, and whose priors of single parameters, are ignored.
    campaign
        Campaign or plan.
    pilot
        Campaign that gives the reference force and the range of force. Default: ``campaign``.
    """
    prior = replace(model.prior, overrides={}, means={})
    unconstrained = replace(model, fixed=(), prior=prior)
    return list(BoundModel(unconstrained, campaign, pilot=pilot).names)


def restricted_to(model: HybridModel, names: Collection[str]) -> HybridModel:
    """Return a model that states fixed values and priors of the named parameters alone.

    What ``model`` states about other single parameters is left out, because a model cannot be
    applied to a campaign that lacks a parameter that the model names.
    """
    prior = model.prior
    overrides = {name: sd for name, sd in prior.overrides.items() if name in names}
    means = {name: mean for name, mean in prior.means.items() if name in names}
    fixed = tuple(name for name in model.fixed if name in names)
    return replace(model, fixed=fixed, prior=replace(prior, overrides=overrides, means=means))
