"""Expected evidence for or against slopes (changes of compliance with force) from planned tests.

B is the Bayes factor of the model with the slopes over the model without slopes. ln B is computed
for the linear Gaussian model, in which compliances may be negative. The results are averaged over
the hyper-parameters φ (such as the standard deviation of the noise).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri
from scipy.stats import qmc

from ldbb_bayes.model.gaussian import Gaussian
from ldbb_bayes.results import Array, Result

__all__ = ["DECISIVE", "Discrimination", "discrimination_of"]

# Evidence is called decisive if the absolute value of the log Bayes factor is at least this number
# [nat] (Kass and Raftery 1995: "very strong").
DECISIVE = 5.0
# The distribution of the log Bayes factor is computed from this number of quasi-random samples for
# each value of the hyper-parameters.
_POINTS = 256
# Lower limit for two quantities: the variances of the components of the posterior mean of the
# slopes, and the shares of the slopes' variances that remain after the tests. Smaller values are
# replaced by the limit, to avoid a division by zero.
_LEAST_VARIANCE = 1e-12


@dataclass(frozen=True)
class Discrimination(Result):
    """Evidence that planned tests are expected to give for or against slopes.

    The Bayes factor is that of a model with slopes over a model without slopes. Attributes whose
    names end in ``_with`` assume that the machine has slopes; those whose names end in ``_without``
    assume that it has none.
    """

    #: root mean square that the slopes are assumed to have on a machine with slopes, in prior
    #: standard deviations
    size: float
    #: whether the analysis includes tests that have already been run. If so, the slopes are assumed
    #: to follow their posterior given these tests. If not, they are assumed to follow their prior,
    #: with standard deviations multiplied by ``size``.
    augmented: bool
    #: smallest absolute value of the log Bayes factor at which evidence is decisive [nat]. The
    #: Bayes factor compares the model with slopes to the model without slopes.
    threshold: float
    #: expected log Bayes factor [nat] of the model with slopes over the model without slopes, if
    #: the machine has slopes
    expected_with: float
    #: expected log Bayes factor [nat] of the model with slopes over the model without slopes, if
    #: the machine has no slopes
    expected_without: float
    #: probability of decisive evidence for slopes if slopes exist
    decisive_with: float
    #: probability of decisive evidence against slopes if none exist
    decisive_without: float
    #: probability of decisive, but wrong evidence against slopes if slopes exist
    misleading_with: float
    #: probability of decisive, but wrong evidence for slopes if none exist
    misleading_without: float
    #: a dict with the names of the slopes as keys. Each value is the probability of decisive
    #: evidence for slopes if this slope is plus or minus ``size`` prior standard deviations, and
    #: all other slopes are zero.
    power: dict[str, float]


def discrimination_of(
    covariance: Array,
    names: tuple[str, ...],
    *,
    size: float,
    before: Gaussian | None = None,
    threshold: float = DECISIVE,
    present: float | None = None,
    seed: int = 1,
) -> Discrimination:
    """Return the expected log Bayes factor for slopes, and the probabilities of decisive evidence.

    The results are computed for two cases: the machine has slopes, or it has none. B is the Bayes
    factor of the model with the slopes over the model without slopes.

    Let m, shape (s,), be the posterior mean of the s slopes after the tests, and C, shape (s, s),
    their posterior covariance. The log Bayes factor is ln B = ½ (ln det C + mᵀ C⁻¹ m). Let m₁ be
    the mean and P₁ the precision of the slopes before the tests, C = L Lᵀ (Cholesky), and
    Lᵀ P₁ L = U e Uᵀ (eigenvalues e). The components of z = Uᵀ L⁻¹ m are then independent. If the
    true slopes are β, these components have the means e Uᵀ L⁻¹ m₁ + (1 − e) Uᵀ L⁻¹ β and the
    variances 1 − e.

    Parameters
    ----------
    covariance
        C for each of K values of the hyper-parameters, shape (K, s, s), in units of the slopes'
        prior standard deviations.
    names
        Names of the s slopes.
    size
        Root mean square that the slopes are assumed to have on a machine with slopes, in prior
        standard deviations.
    before
        Posterior of the slopes given the tests that have already been run, in units of the slopes'
        prior standard deviations. Default: no tests have been run.
    threshold
        Minimum absolute value of ln B at which evidence is decisive [nat].
    present
        ln B of the tests that have already been run, if it is known better than from ``before``,
        as with other models in it [nat]. ln B after the tests is then this value and the change of
        ln B that the tests cause. Default: as ``before`` gives it, for each value of the
        hyper-parameters.
    seed
        Seed of the quasi-random numbers.

    Returns
    -------
    Discrimination
        Expected ln B and probabilities of decisive evidence.
    """
    nodes, s = covariance.shape[:2]
    start = before
    slope_variance = 1.0
    if start is None:
        start = Gaussian.of(np.zeros((nodes, s)), np.ones((nodes, s)))
        slope_variance = size**2
    root = np.linalg.cholesky(covariance)
    remaining, axes = np.linalg.eigh(np.swapaxes(root, 1, 2) @ start.precision @ root)
    # Each eigenvalue in ``remaining`` belongs to a combination of the slopes. The eigenvalue is the
    # share of the variance of this combination that remains after the planned tests.
    remaining = np.clip(remaining, _LEAST_VARIANCE, 1.0)
    learnt = 1.0 - remaining
    to_components = np.linalg.solve(root @ axes, np.broadcast_to(np.eye(s), covariance.shape))
    mean = np.einsum("kij,kj->ki", to_components, start.mean)
    log_volume = np.linalg.slogdet(covariance)[1]
    correction = np.zeros(nodes)
    if present is not None:
        correction = present - _log_bayes_factor(start)
    evidence = _LogBayesFactorDistribution(
        log_volume, _normal_points(nodes, s - 1, seed), correction
    )

    mean_with = mean[:, None]
    variance_with = learnt * (1.0 + learnt * slope_variance / remaining)
    mean_without = (remaining * mean)[:, None]
    variance_without = learnt
    both_signs = size * np.array([1.0, -1.0])[:, None]
    shift = both_signs * (learnt[:, None] * np.swapaxes(to_components, 1, 2))[:, :, None]
    power = {}
    for j, name in enumerate(names):
        mean_with_slope = mean_without + shift[:, j]
        power[name] = evidence.probability_above(threshold, mean_with_slope, learnt)
    return Discrimination(
        size=size,
        augmented=before is not None,
        threshold=threshold,
        expected_with=evidence.expected(mean_with, variance_with),
        expected_without=evidence.expected(mean_without, variance_without),
        decisive_with=evidence.probability_above(threshold, mean_with, variance_with),
        decisive_without=1.0
        - evidence.probability_above(-threshold, mean_without, variance_without),
        misleading_with=1.0 - evidence.probability_above(-threshold, mean_with, variance_with),
        misleading_without=evidence.probability_above(threshold, mean_without, variance_without),
        power=power,
    )


def _log_bayes_factor(slopes: Gaussian) -> Array:
    """Return ln B in favour of slopes, ½ (ln det C + mᵀ C⁻¹ m), of every posterior of the slopes.

    ``slopes`` holds the means m and the covariances C of K posterior distributions, in units of the
    slopes' prior standard deviations. The result has the shape (K,) [nat].
    """
    squares = np.einsum("ki,kij,kj->k", slopes.mean, slopes.precision, slopes.mean)
    return np.asarray(0.5 * (squares - np.linalg.slogdet(slopes.precision)[1]))


@dataclass(frozen=True, eq=False)
class _LogBayesFactorDistribution:
    """Distribution of the log Bayes factor in favour of slopes, ½ (ln det C + Σ z²) + correction.

    C is the posterior covariance of the s slopes, for each of K values of the hyper-parameters, in
    units of the slopes' prior standard deviations. The s components z of the slopes' posterior mean
    are independent and normally distributed.
    """

    # ln det C, where C is the posterior covariance of the slopes, for each of K values of the
    # hyper-parameters, shape (K,)
    log_volume: Array
    # quasi-random standard normal numbers, shape (K, samples, s − 1), for K values of the
    # hyper-parameters. The posterior mean of s slopes has s independent normal components z. The
    # component with the largest variance is not sampled: its probabilities are computed from the
    # normal distribution. The numbers are samples of the other components, scaled to mean 0 and
    # variance 1.
    points: Array
    # what is added to the log Bayes factor at each value of the hyper-parameters, shape (K,) [nat]
    correction: Array

    def expected(self, mean: Array, variance: Array) -> float:
        """Return the expected log Bayes factor in favour of slopes [nat].

        The expectation is averaged over the hyper-parameters. Before the tests, the posterior mean
        of the slopes is random, with s independent normal components. ``mean``, shape (K, 1, s),
        and ``variance``, shape (K, s), are the means and variances of these components, for K
        values of the hyper-parameters.
        """
        squares = (mean[:, 0] ** 2 + variance).sum(axis=1)
        return float((0.5 * (self.log_volume + squares) + self.correction).mean())

    def probability_above(self, level: float, mean: Array, variance: Array) -> float:
        """Return the probability that the log Bayes factor exceeds ``level`` [nat].

        The Bayes factor compares the models with and without slopes. It depends on the posterior
        mean of the slopes. Before the tests, this mean is random; in suitable coordinates, it has s
        independent normal components. ``mean``, shape (K, 1 or 2, s), and ``variance``, shape (K,
        s), are the means and variances of these components for K values of the hyper-parameters.
        The probability is averaged over these values. If ``mean`` holds two values for each
        component, each value is used for half of the quasi-random samples.
        """
        order = np.argsort(-variance, axis=1)[:, None]
        sorted_variance = np.take_along_axis(variance[:, None], order, axis=2)
        sd = np.sqrt(np.maximum(sorted_variance, _LEAST_VARIANCE))
        mean_of_point = np.arange(self.points.shape[1]) % mean.shape[1]
        centre = np.take_along_axis(mean, order, axis=2)[:, mean_of_point]
        squares = ((centre[..., 1:] + sd[..., 1:] * self.points) ** 2).sum(axis=2)
        # The log Bayes factor depends on independent components of the posterior mean of the
        # slopes. They are sorted, so that the first component has the largest variance. If the
        # other components are known, the probability that the log Bayes factor exceeds ``level``
        # follows from the normal distribution of the first component. This probability is averaged
        # over quasi-random samples of the other components.
        needed = 2.0 * (level - self.correction) - self.log_volume
        needed_square = needed[:, None] - squares
        edge = np.sqrt(np.maximum(needed_square, 0.0)) / sd[..., 0]
        middle = centre[..., 0] / sd[..., 0]
        both_tails = ndtr(-edge - middle) + ndtr(middle - edge)
        return float(np.where(needed_square > 0.0, both_tails, 1.0).mean())


def _normal_points(nodes: int, dimensions: int, seed: int) -> Array:
    """Return quasi-random standard normal numbers, shape (nodes, samples, dimensions).

    Each sample has ``dimensions`` independent components. There is one set of samples for each of
    ``nodes`` values of the hyper-parameters. All sets consist of the same points, which are shifted
    by different random amounts in each set.
    """
    rng = np.random.default_rng(seed)
    points = np.zeros((_POINTS, 0))
    if dimensions:
        points = qmc.Sobol(dimensions, rng=rng).random(_POINTS)
    return np.asarray(ndtri((points + rng.random((nodes, 1, dimensions))) % 1.0))
