"""Tests that do not agree with the other tests of their campaign.

Each test r is compared with replicates: circles simulated from p(y_r | y_−r), the distribution of
its readings y_r given the readings y_−r of the other tests. If there are several models, each model
simulates a share of the replicates equal to its posterior probability given the other tests. A test
has 13 p-values, one for each Fourier order from 0 to 12. Each p-value is the share of replicates
that deviate at least as much as the test in this order. The smallest of 13 p-values is often small
by chance alone. The smallest p-value of the test is therefore compared with the smallest p-values
of the replicates.

Holm's method limits the family-wise error: the probability that at least one test is flagged
although all tests agree. A flagged test is removed before the remaining tests are compared again.
Otherwise, the flagged test would make the tests at neighbouring forces seem to deviate.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy import special

from ldbb_bayes.analysis.multiple_testing import holm
from ldbb_bayes.campaign.campaign import Campaign, require_campaign
from ldbb_bayes.errors import require
from ldbb_bayes.inference.evidence import probabilities, require_models
from ldbb_bayes.inference.evidences import Evidences, leave_one_out
from ldbb_bayes.inference.nodes import Nodes
from ldbb_bayes.inference.prediction import replicate_left_out
from ldbb_bayes.inference.residuals import matrix_to_harmonics
from ldbb_bayes.model.fourier import MAX_ORDER, ORDERS
from ldbb_bayes.model.hybrid import HybridModel
from ldbb_bayes.parallel import one_blas_thread
from ldbb_bayes.results import Array, readable

__all__ = ["FALSE_ALARMS", "JudgedTest", "find_outlying_tests", "judge_circle", "judge_tests"]

# Family-wise error: probability that at least one test of a campaign is flagged although all tests
# agree.
FALSE_ALARMS = 0.02
# Minimum number of replicates (simulated circles) that each test is compared with.
_REPLICATES = 20_000
# In a campaign of n tests, each test is compared with at least n times this number of replicates
# (simulated circles). More tests need more replicates, because Holm's method requires smaller
# p-values if there are more tests.
_REPLICATES_PER_TEST = 400
# Number of replicates (simulated circles) from each posterior draw when a test is first compared
# with its replicates.
_CIRCLES_PER_DRAW = 5
# A test whose p-value is at most this number is compared again with more replicates (simulated
# circles).
_SMALL_P_VALUE = 0.05
# Factor by which the number of replicates (simulated circles) is increased when a test is compared
# with its replicates a second time.
_MORE_REPLICATES = 2
# Number of replicates (simulated circles) from each posterior draw in the second, more accurate
# comparison of a test with its replicates. A small p-value is reliable only if the replicates come
# from many draws, because replicates from the same draw are correlated. Few replicates are
# therefore taken from each of many draws.
_CIRCLES_PER_DRAW_AGAIN = 2
# Number of iterations of Tyler's estimator. After five of them, p-values change by less than 0.01.
_SCATTER_STEPS = 5


@dataclass(frozen=True)
class JudgedTest:
    """Comparison of one test with the prediction from the other tests that are not flagged.

    If a campaign has only two tests and they disagree, both have small p-values. Neither test is
    flagged, because nothing shows which test is wrong.
    """

    #: probability that another circle of the same machine would deviate from the prediction at
    #: least as much as the test does, in at least one Fourier order. The prediction is made from
    #: the other tests.
    p_value: float
    family_wise_p_value: float  #: p-value of the test, adjusted for the number of tests (Holm)
    #: p-value of the test's deviation from the prediction in each single Fourier order, 0 … 12
    order_p_values: tuple[float, ...]
    worst_order: int  #: Fourier order in which the test deviates most from the prediction
    #: whether the test is flagged as not in agreement with the other tests. A test is flagged if
    #: its family-wise p-value is below 2 % and more than half of the tests remain unflagged.
    flag: bool
    #: negative logarithm of the probability (from a χ² distribution) that another circle of the
    #: same machine would deviate from the prediction more than the test does, in the Fourier order
    #: ``worst_order``. If several tests have the same p-value, the one with the largest
    #: ``distance`` is flagged first.
    distance: float


@one_blas_thread
def find_outlying_tests(
    models: Mapping[str, HybridModel],
    campaign: Campaign,
    *,
    seed: int = 1,
    tolerance: float = 1e-2,
    replicates: int | None = None,
) -> pd.DataFrame:
    """Find the tests that do not agree with the other tests, under one or several models.

    Each test is compared with circles that are simulated from the posterior given the other tests.
    The p-value of the test is the probability that another circle of the same machine would deviate
    from the prediction at least as much as the test does, in at least one Fourier order. A test is
    flagged if its family-wise p-value (Holm) is below 2 % and more than half of the tests remain
    unflagged.

    Parameters
    ----------
    models : mapping of str to HybridModel
        Models; the keys are names of models. Each model is weighted by its posterior probability
        given the other tests.
    campaign : Campaign
        Campaign with readings of at least two tests.
    seed : int
        Seed of the simulated circles.
    tolerance : float
        Error allowed in every log evidence [nat].
    replicates : int, optional
        Number of circles that are simulated at first for each test. A test with a p-value of at
        most 5 % is judged again with twice as many circles. Default: the larger of 20,000 and 400
        times the number of tests.

    Returns
    -------
    DataFrame
        One row per test. The columns force_N, p_value, family_wise_p_value and flag describe the
        test. The columns order_0, order_1 … order_12 hold the p-values of the single Fourier
        orders.

    Raises
    ------
    InputError
        For fewer than two tests, a plan (a campaign without readings), an improper prior, or too
        few replicates.

    Examples
    --------
    >>> models = {"constant": lb.HybridModel.first(0)}
    >>> table = lb.find_outlying_tests(models, campaign, tolerance=0.1, replicates=400)
    >>> table.columns.to_list()[:4]
    ['force_N', 'p_value', 'family_wise_p_value', 'flag']
    >>> bool(table["flag"].any())
    False
    """
    require_models(models)
    require_campaign(campaign)
    tests = len(campaign.tests)
    require(
        tests > 1, "a campaign must have at least two tests to compare them, got one. Add tests."
    )
    fewest = int(tests / (_MORE_REPLICATES * FALSE_ALARMS)) + 1
    require(
        replicates is None or replicates >= fewest,
        f"replicates must be at least {fewest} to judge {tests} tests, got {replicates}. Leave the"
        " argument replicates out.",
    )
    evidences = Evidences(campaign, tolerance=tolerance)
    nodes_by_model = dict(zip(models, evidences.nodes(*models.values()), strict=True))
    left_out_nodes = leave_one_out(nodes_by_model, tolerance=tolerance)
    judged = judge_tests(
        nodes_by_model, left_out_nodes, seed=seed, tolerance=tolerance, replicates=replicates
    )
    rows = {}
    for test in campaign.tests:
        judged_test = judged[test.name]
        row = {
            "force_N": test.force_N,
            "p_value": judged_test.p_value,
            "family_wise_p_value": judged_test.family_wise_p_value,
            "flag": judged_test.flag,
        }
        for order, p_value in enumerate(judged_test.order_p_values):
            row[f"order_{order}"] = p_value
        rows[test.name] = row
    return readable(pd.DataFrame.from_dict(rows, orient="index"), "Which tests do not belong")


def judge_tests(
    nodes_by_model: Mapping[str, Nodes],
    left_out_nodes: Mapping[str, Mapping[str, Nodes]],
    *,
    seed: int,
    tolerance: float,
    replicates: int | None = None,
) -> dict[str, JudgedTest]:
    """Return the comparison of every test with the other tests; the keys are names of tests.

    Parameters
    ----------
    nodes_by_model
        Quadrature nodes (weighted values of the hyper-parameters) of the posterior given all tests,
        for each model.
    left_out_nodes
        Quadrature nodes of the posterior given all tests but one, for each model and each test left
        out, as returned by `leave_one_out`.
    seed
        Seed of the simulated circles.
    tolerance
        Error allowed in every log evidence [nat].
    replicates
        Number of circles that are simulated at first for each test; see `find_outlying_tests`.
    """
    rng = np.random.default_rng(seed)
    names = _any_nodes(nodes_by_model).bound.test_names
    size = replicates or max(_REPLICATES, _REPLICATES_PER_TEST * len(names))
    flagged: dict[str, JudgedTest] = {}
    largest_flagged_p_value = 0.0
    while True:
        judged = {}
        for name in names:
            if name not in flagged:
                judged[name] = _judge_left_out(nodes_by_model, left_out_nodes, name, size, rng)
        worst = _most_outlying(judged)
        adjusted = min(1.0, len(judged) * judged[worst].p_value)
        family_wise = max(largest_flagged_p_value, adjusted)
        majority_agrees = 2 * (len(flagged) + 1) < len(names)
        if family_wise >= FALSE_ALARMS or not majority_agrees:
            break
        flagged[worst] = replace(judged[worst], family_wise_p_value=family_wise, flag=True)
        largest_flagged_p_value = family_wise
        nodes_by_model = {model: by_test[worst] for model, by_test in left_out_nodes.items()}
        left_out_nodes = leave_one_out(nodes_by_model, tolerance=tolerance)
    judged = _adjust_p_values(judged, largest_flagged_p_value)
    return {name: flagged[name] if name in flagged else judged[name] for name in names}


def _any_nodes(nodes_by_model: Mapping[str, Nodes]) -> Nodes:
    """Return the quadrature nodes of the first model.

    Nodes are weighted values of the hyper-parameters, together with the model applied to the
    campaign. ``nodes_by_model`` holds the nodes of all models. The caller uses only properties of
    the campaign, which are the same for all models.
    """
    return next(iter(nodes_by_model.values()))


def _most_outlying(judged: Mapping[str, JudgedTest]) -> str:
    """Return the name of the test that deviates most from its prediction by the other tests.

    This is the test with the smallest p-value. Among tests with equal p-values, it is the test with
    the largest ``JudgedTest.distance``.
    """
    return min(judged, key=lambda name: (judged[name].p_value, -judged[name].distance))


def _adjust_p_values(judged: Mapping[str, JudgedTest], lowest: float) -> dict[str, JudgedTest]:
    """Return the results ``judged`` with family-wise p-values, computed by Holm's method.

    Holm's method orders the tests by their p-values. In this order, family-wise p-values must not
    decrease. Tests that have been flagged and removed earlier count as coming before the tests in
    ``judged``. ``lowest`` is the largest family-wise p-value of the flagged tests; in the result,
    any smaller family-wise p-value is raised to this number.
    """
    p_values = np.array([judged_test.p_value for judged_test in judged.values()])
    family_wise = np.maximum(holm(p_values), lowest)
    adjusted = {}
    for (name, judged_test), p_value in zip(judged.items(), family_wise, strict=True):
        adjusted[name] = replace(judged_test, family_wise_p_value=float(p_value))
    return adjusted


def _judge_left_out(
    nodes_by_model: Mapping[str, Nodes],
    left_out_nodes: Mapping[str, Mapping[str, Nodes]],
    name: str,
    size: int,
    rng: np.random.Generator,
) -> JudgedTest:
    """Return the comparison of the test ``name`` with circles predicted from the other tests.

    ``size`` is the number of circles that are simulated at first. If the test's p-value is at most
    5 %, the test is judged again with twice as many circles. ``nodes_by_model`` holds the posterior
    of each model given all tests. ``left_out_nodes`` holds, for each model and test, the posterior
    given all other tests.
    """
    bound = _any_nodes(nodes_by_model).bound
    r = bound.test_names.index(name)
    observed = matrix_to_harmonics(bound, r) @ np.asarray(bound.reduced[r].reading_mm)
    judged = judge_circle(
        observed, _replicates(nodes_by_model, left_out_nodes, name, size, _CIRCLES_PER_DRAW, rng)
    )
    if judged.p_value > _SMALL_P_VALUE:
        return judged
    larger_size = _MORE_REPLICATES * size
    return judge_circle(
        observed,
        _replicates(
            nodes_by_model, left_out_nodes, name, larger_size, _CIRCLES_PER_DRAW_AGAIN, rng
        ),
    )


def _replicates(
    nodes_by_model: Mapping[str, Nodes],
    left_out_nodes: Mapping[str, Mapping[str, Nodes]],
    name: str,
    size: int,
    circles_per_draw: int,
    rng: np.random.Generator,
) -> Array:
    """Return replicates (simulated circles) of the test ``name``.

    Each replicate is described by 25 Fourier coefficients. The result has the shape (n, 25) [mm];
    the number n of replicates is about ``size``. From each posterior draw, ``circles_per_draw``
    replicates are simulated. The number of replicates from each model is in proportion to the
    posterior probability of the model given the other tests. ``nodes_by_model`` and
    ``left_out_nodes`` are the posteriors that `judge_tests` describes.
    """
    log_evidence = [by_test[name].evidence.log_value for by_test in left_out_nodes.values()]
    counts = np.round(probabilities(np.array(log_evidence)) * size).astype(int)
    circles = []
    for (model, nodes), count in zip(nodes_by_model.items(), counts, strict=True):
        if count:
            replicates = replicate_left_out(
                nodes.bound,
                left_out_nodes[model][name],
                name,
                int(count),
                rng,
                circles_per_draw=circles_per_draw,
            )
            circles.append(replicates)
    return np.concatenate(circles)


def judge_circle(observed: Array, replicates: Array) -> JudgedTest:
    """Return the comparison of one test's circle with its replicates (simulated circles).

    The p-value is the probability that another circle of the same machine would deviate from the
    mean of the replicates at least as much as the test, in any Fourier order. It is an estimate
    from simulated circles; with 20 000 of them its standard error is about 0.01 or less. The
    p-value is not adjusted for the number of tests: in the result, the family-wise p-value is 1,
    and the flag is false.

    Parameters
    ----------
    observed
        Fourier coefficients of the circle's radial deviation, shape (25,).
    replicates
        Fourier coefficients of the n replicates, shape (n, 25).
    """
    n = len(replicates)
    centre = replicates.mean(axis=0)
    scatter = np.ascontiguousarray((replicates - centre).T)
    deviation = (observed - centre)[:, None]
    nearer_counts = []
    replicate_distances = []
    tails = []
    for order in range(MAX_ORDER + 1):
        in_order = order == ORDERS
        harmonics = scatter[in_order]
        precision = np.linalg.inv(_scatter_matrix(harmonics))
        distances = _squared_distances(harmonics, precision)
        distance = _squared_distances(deviation[in_order], precision)[0]
        nearer_counts.append(int(np.sum(distances < distance)))
        replicate_distances.append(distances)
        tails.append(_minus_log_tail(float(distance), len(harmonics)))
    # Replicates are simulated circles. For each Fourier order, ``nearer_counts`` is the number of
    # replicates that deviate less than the observed circle. Let m be the largest of these numbers.
    # In each order, all replicates except the m with the smallest deviations count as strongly
    # deviating. The p-value is the share of replicates that deviate strongly in at least one order.
    most_nearer = max(nearer_counts)
    edge = np.full((MAX_ORDER + 1, 1), -np.inf)
    if most_nearer:
        edge = np.partition(replicate_distances, most_nearer - 1, axis=1)[:, [most_nearer - 1]]
    is_further = (np.array(replicate_distances) > edge).any(axis=0)
    return JudgedTest(
        p_value=(1.0 + int(is_further.sum())) / (n + 1.0),
        family_wise_p_value=1.0,
        order_p_values=tuple((1.0 + n - nearer) / (n + 1.0) for nearer in nearer_counts),
        worst_order=int(np.argmax(tails)),
        flag=False,
        distance=max(tails),
    )


def _scatter_matrix(harmonics: Array) -> Array:
    """Return the scatter matrix of k Fourier coefficients, shape (k, k), by Tyler's M-estimator.

    For normally distributed coefficients the scatter matrix is the covariance. Replicates come from
    posterior draws with different standard deviations of the noise, so that a few replicates are
    very large. A covariance would depend on these few replicates. In Tyler's estimator (Tyler,
    Ann. Statist. 15, 1987), every replicate has the same weight, however large it is. The result is
    scaled so that the median of the squared distances is the median of a χ² distribution with k
    degrees of freedom.

    ``harmonics``, shape (k, n), are the coefficients of n replicates minus their means.
    """
    components, n = harmonics.shape
    scatter = np.cov(harmonics).reshape(components, components)
    for _ in range(_SCATTER_STEPS):
        distances = _squared_distances(harmonics, np.linalg.inv(scatter))
        # A replicate exactly at the mean has no direction, and gets no weight.
        weights = np.divide(1.0, distances, out=np.zeros(n), where=distances > 0.0)
        scatter = components / n * (harmonics * weights) @ harmonics.T
    distances = _squared_distances(harmonics, np.linalg.inv(scatter))
    return scatter * float(np.median(distances) / special.chdtri(components, 0.5))


def _squared_distances(harmonics: Array, precision: Array) -> Array:
    """Return squared Mahalanobis distances of n circles from their mean, shape (n,).

    ``harmonics``, shape (k, n), are k Fourier coefficients of each circle minus the means of these
    coefficients. ``precision``, shape (k, k), is the inverse of the coefficients' scatter matrix.
    """
    return np.asarray((precision @ harmonics * harmonics).sum(axis=0))


def _minus_log_tail(squared_distance: float, components: int) -> float:
    """Return −ln p, where p is the probability that a circle deviates more than an observed one.

    The deviation is that of the Fourier coefficients of one order. ``squared_distance`` is the
    squared Mahalanobis distance of the observed circle from the prediction; it is taken to have a
    χ² distribution. ``components`` is the number of Fourier coefficients of the order, one or two;
    the χ² distribution has the same number of degrees of freedom.
    """
    if components == 2:
        return 0.5 * squared_distance
    return -float(special.log_ndtr(-np.sqrt(squared_distance)) + np.log(2.0))
