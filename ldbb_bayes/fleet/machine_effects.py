"""Effects that a machine keeps from campaign to campaign.

They are the changes of compliances with force (slopes), the coefficients of `JointLoad`, which
describe how direct compliances change with force in addition, and those of `Position`, which
describe how they change along the travel. One campaign hardly tells them from the compliances, and
their values are nearly the same in all campaigns of a machine. Their error does not average out
over the campaigns.

Let ν_i be a coefficient in campaign i, with the prior standard deviation σ. It is
ν_i = r_i (√ρ z + √(1 − ρ) e_i) σ, where z ~ N(0, 1) belongs to the machine, e_i ~ N(0, 1) to the
campaign, and ρ is `JointLoad.campaign_correlation`. r_i is the ratio by which the coefficient
differs because the campaign has other forces than the first one.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.model.terms import JointLoad, Position, Term
from ldbb_bayes.model.terms.joints import ForcesOfCampaign, ratio_of_coefficients
from ldbb_bayes.results import Array

__all__ = [
    "VARIANCE_OF_CAMPAIGN",
    "has_usual_circles",
    "machine_effects",
    "ratios_of_effects",
    "with_deviations",
    "with_effects_of_campaigns",
    "without_effects",
]

# Pattern of the names of slopes and of curvatures (compliances that are quadratic in force), such
# as C_XXX_1 and C_XXX_2.
_CHANGE_WITH_FORCE = re.compile(r"C_.+_([12])")
# Variance of √((1 − ρ)/ρ) e_i, the part of an effect of the machine that is another in every
# campaign. The unit is the standard deviation √ρ σ of the part that belongs to the machine.
VARIANCE_OF_CAMPAIGN = 1.0 / JointLoad.campaign_correlation - 1.0


def machine_effects(rows: pd.DataFrame, machines: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the effects that machines keep, sorted.

    Slopes are left out if compliance is quadratic in force in a campaign, because a slope then
    depends on the reference force of the campaign. Coefficients of `Position` depend on place and
    radius of the circles. They are left out unless at least two campaigns of a machine have its
    usual circles (`has_usual_circles`).

    Parameters
    ----------
    rows : rows of n campaigns in the table of a batch.
    machines : names of the machines of the n campaigns.

    Returns
    -------
    tuple of str
    """
    names = sorted(set[str]().union(*rows["gaussian_names"]))
    slopes = []
    is_quadratic = False
    for name in names:
        match = _CHANGE_WITH_FORCE.fullmatch(name)
        if match is not None and match.group(1) == "2":
            is_quadratic = True
        elif match is not None:
            slopes.append(name)
    effects = [name for name in names if Term.owner(name) is JointLoad]
    machines_with_usual_circles = np.array(machines)[has_usual_circles(rows, machines)]
    if len(set(machines_with_usual_circles)) < len(machines_with_usual_circles):
        effects += [name for name in names if Term.owner(name) is Position]
    if not is_quadratic:
        effects += slopes
    return tuple(effects)


def has_usual_circles(rows: pd.DataFrame, machines: Sequence[str]) -> NDArray[np.bool_]:
    """Return whether each of n campaigns has the circles that its machine usually has, shape (n,).

    Circles are the same if their planes, radii, centres and directions are. The usual circles of a
    machine are those that most of its campaigns have. Tables of earlier versions do not state the
    circles; the result is then false.

    Parameters
    ----------
    rows : rows of n campaigns in the table of a batch.
    machines : names of the machines of the n campaigns.

    Returns
    -------
    ndarray
    """
    is_usual = np.zeros(len(rows), dtype=bool)
    if "circles" not in rows:
        return is_usual
    machine_of_row = np.array(machines)
    for machine in set(machines):
        places = np.flatnonzero(machine_of_row == machine)
        circles = rows["circles"].iloc[places]
        stated = circles.dropna()
        if len(stated):
            usual = stated.mode().iloc[0]
            is_usual[places] = (circles == usual).to_numpy()
    return is_usual


def ratios_of_effects(names: Sequence[str], rows: pd.DataFrame) -> Array:
    """Return the coefficients of n campaigns if those of the first campaign are one, shape (n, k).

    The first campaign is the first whose model has the coefficient; the ratio is 1 for campaigns
    without it. Slopes are the same for all forces, so that their ratio is 1.

    Parameters
    ----------
    names : names of k effects of the machine.
    rows : rows of n campaigns in the table of a batch.

    Returns
    -------
    ndarray
    """
    ratios = np.ones((len(rows), len(names)))
    forces = [
        ForcesOfCampaign(float(reference_N), float(largest_N))
        for reference_N, largest_N in zip(
            rows["reference_force_N"], rows["force_max_N"], strict=True
        )
    ]
    for k, name in enumerate(names):
        if Term.owner(name) is not JointLoad:
            continue
        places = [i for i, of_row in enumerate(rows["gaussian_names"]) if name in list(of_row)]
        first = forces[places[0]]
        ratios[places, k] = [ratio_of_coefficients(name, first, forces[i]) for i in places]
    return ratios


def with_deviations(likelihood: Gaussian, variance: Array) -> Gaussian:
    """Return likelihoods with independent deviations integrated out: ∫ g(x + e) N(e; 0, diag v) de.

    Let Λ be the precision matrix of g and η its shift. Those of the result are (I + Λ V)⁻¹ Λ and
    (I + Λ V)⁻¹ η, where V = diag v; Λ may be singular. The constant of the result is that of g.

    Parameters
    ----------
    likelihood : likelihoods g of q quantities from n campaigns, shape (n, q).
    variance : variances v of the deviations, shape (q,); zero for a quantity without deviation.

    Returns
    -------
    Gaussian
    """
    q = len(variance)
    factor = np.eye(q) + likelihood.precision * variance
    precision = np.linalg.solve(factor, likelihood.precision)
    symmetric = 0.5 * (precision + np.swapaxes(precision, -1, -2))
    return Gaussian(symmetric, np.linalg.solve(factor, likelihood.shift[..., None])[..., 0])


def with_effects_of_campaigns(
    likelihood: Gaussian, campaigns: NDArray[np.intp], effects: NDArray[np.intp]
) -> Gaussian:
    """Return likelihoods in which some effects of some campaigns are integrated out.

    Such an effect is another in every campaign, with the variance of the part that belongs to the
    machine plus that of the part that belongs to the campaign. The result tells nothing of what the
    machine keeps of it.

    Parameters
    ----------
    likelihood : likelihoods of q quantities from n campaigns, in units of the sd of the part of an
        effect that belongs to the machine.
    campaigns : indices of the campaigns.
    effects : indices of the effects among the q quantities.

    Returns
    -------
    Gaussian
    """
    precision = likelihood.precision.copy()
    shift = likelihood.shift.copy()
    prior_precision = np.eye(len(effects)) / (1.0 + VARIANCE_OF_CAMPAIGN)
    for i in campaigns:
        rows = precision[i][effects]
        gain = np.linalg.solve(prior_precision + rows[:, effects], rows).T
        shift[i] -= gain @ shift[i][effects]
        precision[i] -= gain @ rows
        shift[i][effects] = 0.0
        precision[i][effects, :] = 0.0
        precision[i][:, effects] = 0.0
    return Gaussian(precision, shift)


def without_effects(likelihood: Gaussian, effects: int) -> Gaussian:
    """Return likelihoods with the effects of each machine integrated out.

    Let P and η be the precision matrix and the shift of a likelihood, k the effects and q the other
    quantities. Those of the result are P_qq − P_qk (I + P_kk)⁻¹ P_kq and
    η_q − P_qk (I + P_kk)⁻¹ η_k, because the prior of the effects is N(0, I). The constant of the
    result is that of the likelihood.

    Parameters
    ----------
    likelihood : likelihoods of n machines; the last quantities are the effects, in units of their
        prior standard deviations.
    effects : number of effects.

    Returns
    -------
    Gaussian
    """
    if effects == 0:
        return likelihood
    q = likelihood.shift.shape[-1] - effects
    mixed = likelihood.precision[..., :q, q:]
    posterior_precision = np.eye(effects) + likelihood.precision[..., q:, q:]
    gain = mixed @ np.linalg.inv(posterior_precision)
    return Gaussian(
        likelihood.precision[..., :q, :q] - gain @ np.swapaxes(mixed, -1, -2),
        likelihood.shift[..., :q] - (gain @ likelihood.shift[..., q:, None])[..., 0],
    )
