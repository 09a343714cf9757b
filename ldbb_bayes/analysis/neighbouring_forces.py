"""Local fits of constant compliance and geometry to each pair of neighbouring force levels.

If compliance changes with force, the estimates from different pairs of levels differ. Each pair is
fitted twice. The first fit is the least-squares method of the published article (Tables 7 and 8
there). The second fit is the posterior of the model with its nuisances (effects that are modelled
but not of interest). Neighbouring pairs have a force level in common, and all pairs are affected by
the same ball form, bar length and mount. The errors of the estimates are therefore correlated, and
the estimates scatter less than their uncertainties suggest.

Geometric errors are fitted separately in every pair. Only the change of the readings between the
two forces therefore determines the compliance. At the force F, a compliance C(F) causes the
deflection F · C(F). A pair therefore estimates the derivative d(F C)/dF = C + F dC/dF. This
derivative equals the compliance only if the compliance does not change with force.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from ldbb_bayes.campaign.campaign import Campaign, distinct_forces
from ldbb_bayes.deprecation import renamed_keyword
from ldbb_bayes.errors import InputError, check_probability
from ldbb_bayes.inference.evidence import check_comparable
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.least_squares import fit_least_squares
from ldbb_bayes.inference.nodes import compute_nodes
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import readable

__all__ = ["local_fits"]

# Settings of the numerical integration (quadrature) over the hyper-parameters, for fits to two
# neighbouring forces. With these settings, the errors of standard deviations are at most 2 %, which
# is enough for a figure. The nodes are weighted values of the hyper-parameters. ``_TOLERANCE`` is
# the error allowed for the log evidence [nat]. Nodes with the smallest weights are left out, up to
# the share ``_SPARE`` of the total weight. ``_POINTS_INSIDE`` is the number of quasi-random points
# from which the probability that no compliance is negative is computed. ``_MOMENT_NODES`` is the
# number of nodes for means and standard deviations. ``_COMPONENTS`` is the number of components of
# the mixture from which the quantiles are computed.
_TOLERANCE = 5e-2
_SPARE = 1e-3
_POINTS_INSIDE = 128
_MOMENT_NODES = 512
_COMPONENTS = 1024


@one_blas_thread
@renamed_keyword("ci_prob", "prob")
def local_fits(
    model: HybridModel, campaign: Campaign, *, prob: float = 0.95, seed: int = 0
) -> pd.DataFrame:
    """Fit constant compliance and geometry to every pair of neighbouring force levels.

    If the estimates of a compliance from different pairs differ by more than their uncertainties,
    the compliance changes with force. The estimate from a pair is then about C + F dC/dF, where F
    is the mean force of the pair and C the compliance at this force.

    Parameters
    ----------
    model : HybridModel
        Model with its nuisance terms (effects not of interest) and priors. Its compliances are made
        constant (degree 0 in force). Two properties of the model are determined from the whole
        campaign, not from a pair: whether the two balls have one common form error or one each, and
        the estimate Ĉ of the compliances about which the model is linearised.
    campaign : Campaign
        Campaign with readings at two or more force levels.
    prob : float
        Probability of the equal-tailed credible intervals, between 0 and 1.
    seed : int
        Seed of the random numbers from which the quantiles are computed.

    Returns
    -------
    DataFrame
        One row per pair of force levels and parameter, in internal units (mm, N, rad). The columns
        force_low_N, force_high_N, force_N (mean over the pair's tests), tests (number of tests in
        the pair), parameter and unit describe the row. The column least_squares holds the
        least-squares estimate, and least_squares_u its standard uncertainty if there is only white
        noise; both are NaN if the pair does not determine the parameter. The columns mean, sd,
        ci_low and ci_high describe the posterior.

    Raises
    ------
    InputError
        For one force level, a plan (a campaign without readings), readings that are all zero, a
        flat prior, or a probability that is not between 0 and 1.

    Examples
    --------
    >>> table = lb.local_fits(lb.HybridModel.first(0), campaign)
    >>> of_x = table[table["parameter"] == "C_XXX"]
    >>> of_x["force_N"].to_list()  # six circles at different forces make five pairs
    [137.0, 301.0, 427.0, 553.0, 679.0]
    >>> bool(of_x["mean"].between(45e-6, 70e-6).all())  # mm/N
    True
    """
    check_comparable(model, campaign)
    check_probability(prob)
    # Leave out the model term that gives each circle a noise level of its own, because the readings
    # of two circles do not show which circle has more noise.
    constant = model.with_degree(0).without("circle-scale")
    all_tests = constant.bind(campaign)
    levels = np.array([0.5 - 0.5 * prob, 0.5 + 0.5 * prob])
    tables = []
    previous_mode = None
    for names in _neighbouring_pairs(campaign):
        bound = all_tests.keeping(names)
        # The search for the mode of the posterior starts from the mode of the previous pair.
        posterior = HyperPosterior(bound, truncated=bound.truncation.active, near=previous_mode)
        previous_mode = posterior.without_truncation.mode
        nodes = compute_nodes(posterior, _TOLERANCE)
        mean, sd = nodes.moments(spare=_SPARE, points=_POINTS_INSIDE, components=_MOMENT_NODES)
        low, high = nodes.quantiles(levels, seed=seed, components=_COMPONENTS)
        # The least-squares fit must have the same parameters for every pair of force levels. All
        # tests of the campaign are therefore listed as foreseen, that is, as tests that may be run
        # later: the fit then includes every parameter that any of these tests can determine.
        pair = replace(campaign.select(names), foreseen=campaign.scope)
        squares = fit_least_squares(pair, fixed=constant.fixed).table
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
    return readable(
        pd.concat(tables, ignore_index=True),
        f"Fits of neighbouring forces, {100 * prob:g} % intervals",
    )


def _neighbouring_pairs(campaign: Campaign) -> list[tuple[str, ...]]:
    """Return the names of the tests at each pair of neighbouring force levels."""
    if campaign.force_levels < 2:
        raise InputError(
            "local fits must have at least two force levels, got one: compliance and geometry"
            " cannot be separated."
        )
    order = np.argsort(campaign.forces_N, kind="stable")
    forces = campaign.forces_N[order]
    levels = np.searchsorted(distinct_forces(forces), forces, side="right") - 1
    names_by_level: list[list[str]] = [[] for _ in range(levels[-1] + 1)]
    for index, level in zip(order, levels, strict=True):
        names_by_level[level].append(campaign.tests[index].name)
    pairs = []
    for level in range(levels[-1]):
        pairs.append((*names_by_level[level], *names_by_level[level + 1]))
    return pairs
