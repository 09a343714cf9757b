"""Constant compliance over windows of force: what varies from window to window is what a slope would have to explain.

For every window both the paper's least squares (Tables 7 and 8) and the posterior with nuisances. Windows overlap and share ball
form, bar length and mount: neighbouring estimates err together, so the scatter of the points says less than their bars seem to.
Geometry is free in every window, so that a window estimates the tangent d(F C)/dF = C + F dC/dF, not C(F) itself: the two are one
only where compliance is constant.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ldbb_bayes.campaign.campaign import Campaign, check_campaign
from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.evidence import check_comparable
from ldbb_bayes.inference.least_squares import least_squares
from ldbb_bayes.inference.nodes import HyperPosterior
from ldbb_bayes.inference.posterior import check_probability
from ldbb_bayes.jobs import one_blas_thread
from ldbb_bayes.model.hybrid import HybridModel

__all__ = ["local_fits", "windows"]

Array = NDArray[Any]
_SAME_FORCE = 1e-6
_TOLERANCE = 1e-2
_SPARE, _COMPONENTS = 1e-3, 2048


@one_blas_thread
def local_fits(model: HybridModel, campaign: Campaign, *, width: int = 2, ci_prob: float = 0.95, seed: int = 0) -> pd.DataFrame:
    """Fit constant compliance and geometry to every window of neighbouring force levels.

    Parameters
    ----------
    model : HybridModel
        Nuisances and priors; its degree is set to 0. What belongs to the campaign (two balls, Ĉ) stays the campaign's.
    width : int
        Force levels in a window; 2 gives the paper's adjacent pairs.
    ci_prob : float
        Probability of the equal-tailed credible intervals.

    Returns
    -------
    DataFrame
        One row per window and parameter: force_low_N, force_high_N, force_N (mean of the window's tests), tests, parameter, unit,
        least_squares, least_squares_u (white noise alone; not a number where the window does not determine it), mean, sd,
        ci_low, ci_high; in inside units.

    Raises
    ------
    InputError
        For fewer force levels than the width, a width below 2, a plan, or a flat prior.
    """
    check_campaign(campaign)
    check_comparable(model, campaign)
    check_probability(ci_prob)
    constant = model.with_degree(0)
    whole = constant.bind(campaign)
    levels = np.array([0.5 - 0.5 * ci_prob, 0.5 + 0.5 * ci_prob])
    tables = []
    near = None
    for names in windows(campaign, width):
        bound = whole.keeping(names)
        posterior = HyperPosterior(bound, truncated=bound.truncation.active, near=near)
        near, nodes = posterior.mode, posterior.nodes(_TOLERANCE)
        mean, sd = nodes.moments(spare=_SPARE)
        low, high = nodes.quantiles(levels, seed=seed, components=_COMPONENTS)
        window = replace(campaign.select(names), foreseen=campaign.scope)
        squares = least_squares(window, fixed=constant.fixed).table
        forces = bound.setting.force_N
        columns = {
            "force_low_N": float(forces.min()),
            "force_high_N": float(forces.max()),
            "force_N": float(forces.mean()),
            "tests": len(names),
            "parameter": bound.names,
            "unit": [parameter.unit for parameter in bound.parameters],
            "least_squares": squares["estimate"].to_numpy(),
            "least_squares_u": squares["u"].to_numpy(),
            "mean": mean,
            "sd": sd,
            "ci_low": low,
            "ci_high": high,
        }
        tables.append(pd.DataFrame(columns))
    return pd.concat(tables, ignore_index=True)


def windows(campaign: Campaign, width: int) -> list[tuple[str, ...]]:
    """Names of the tests of every window of ``width`` neighbouring force levels."""
    if width < 2:
        raise InputError(
            f"width must be at least 2 force levels, got {width}. At one force compliance and geometry cannot be separated."
        )
    if campaign.force_levels < width:
        levels = campaign.force_levels
        raise InputError(f"width must be at most the campaign's {levels} force levels, got {width}. Use a smaller one.")
    order = np.argsort(campaign.forces_N, kind="stable")
    forces = campaign.forces_N[order]
    level = np.concatenate([[0], np.cumsum(np.diff(forces) > _SAME_FORCE * forces[-1])])
    names = [campaign.tests[i].name for i in order]
    return [
        tuple(name for name, own in zip(names, level, strict=True) if first <= own < first + width)
        for first in range(level[-1] - width + 2)
    ]
