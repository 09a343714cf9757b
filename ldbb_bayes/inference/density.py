"""Log posterior density of parameters β and hyper-parameters φ, for samplers.

β are the p parameters: compliances, their changes with force, and geometric errors. φ are the h
hyper-parameters, such as the standard deviation of the noise. y are the readings. Nuisances
(effects that are modelled but not of interest) are integrated out.

The log density is ln p(y | β, φ) + ln p(β) + ln p(φ); the log evidence ln p(y) is not subtracted.
The three densities in this sum are normalised. β has the prior N(m, S), with mean m of shape (p,)
and covariance S of shape (p, p). If the model forbids negative compliances, this prior is truncated
to values of β for which no compliance is negative. The compliances are the elements of A β, where A
has the shape (rows, p). φ has its own prior, independent of β. Because the three densities are
normalised, the integral of their product over x = (β, φ) is the evidence; `log_evidence` returns
its logarithm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ldbb_bayes.campaign.campaign import Campaign, require_campaign
from ldbb_bayes.errors import InputError, require
from ldbb_bayes.inference.hyper_posterior import HyperPosterior
from ldbb_bayes.inference.mcmc import WeightedPoints
from ldbb_bayes.model.hybrid import BoundModel, HybridModel, require_model
from ldbb_bayes.results import Array, Shown

__all__ = ["JointDensity", "LinearRedraw", "LogDensity", "log_density", "starting_points"]

# The starting points of a sampler are drawn at random. Their hyper-parameters are drawn from a
# density close to the posterior, but wider: all its standard deviations are multiplied by the
# square root of this number (the temperature).
_START_TEMPERATURE = 1.5
# Number of random points that are drawn for each starting point of a sampler. More than one point
# is drawn, because points with a negative compliance are dropped.
_DRAWS_PER_START = 2
# Cumulative prior probabilities are limited to the range from this value to 1 minus this value, so
# that quantiles of the prior are finite.
_SMALLEST_PROBABILITY = 1e-15


def log_density(model: HybridModel, campaign: Campaign) -> LogDensity:
    """Return the log density of the posterior, for use with other samplers and optimisers.

    Parameters
    ----------
    model : HybridModel
        Model with its nuisances (effects that are modelled but not of interest) and priors.
    campaign : Campaign
        Campaign with readings.

    Returns
    -------
    LogDensity
        Log density of parameters and hyper-parameters, in mm, N and rad.

    Raises
    ------
    InputError
        For a plan (a campaign without readings), or for a model that cannot be fitted to the
        campaign.

    Examples
    --------
    >>> import emcee
    >>> density = lb.log_density(lb.HybridModel.first(0), campaign)
    >>> sampler = emcee.EnsembleSampler(40, len(density.names), density.log_prob, vectorize=True)
    >>> last = sampler.run_mcmc(density.initial(40, seed=1), 5)  # in practice, a few thousand steps
    >>> sampler.get_chain().shape
    (5, 40, 17)
    """
    require_model(model)
    require_campaign(campaign)
    require(
        not campaign.is_plan,
        "campaign must have readings to have a posterior, got a plan. Run the tests, or"
        " simulate it.",
    )
    return LogDensity(model.bind(campaign))


@dataclass(frozen=True, eq=False, repr=False)
class LogDensity(Shown):
    """Log density ln p(x, y) of a model at x = (β, φ), for the readings y of a campaign.

    x holds the parameters β (compliances, their changes with force, and geometric errors), then the
    hyper-parameters φ (such as the standard deviation of the noise), in mm, N and rad. For one
    point of d coordinates, shape (d,), a density is a number; for n points, shape (n, d), densities
    have the shape (n,). Logarithms are natural and every density is normalised, so that a nested
    sampler gives the same evidence as `log_evidence`.

    Examples
    --------
    >>> density = lb.log_density(lb.HybridModel.first(0), campaign)
    >>> density.names[0], density.units[0]
    ('C_XXX', 'mm/N')
    >>> points = density.initial(3, seed=1)
    >>> points[0, 0] = -1e-6  # a direct compliance cannot be negative
    >>> np.isfinite(density.log_prob(points)).tolist()
    [False, True, True]
    """

    bound: BoundModel  #: the model of one campaign, with the tests and the readings of the campaign

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the d coordinates of a point: parameters, then hyper-parameters.

        Parameters are compliances, their changes with force, and geometric errors. Hyper-parameters
        are quantities such as the standard deviation of the noise.
        """
        return (*self.bound.names, *self.bound.hyper_prior.names)

    @property
    def units(self) -> tuple[str, ...]:
        """Return the units of the d coordinates: of parameters first, then of hyper-parameters.

        Units are made of mm, N and rad, such as "mm/N"; a pure number has the unit "".
        """
        of_parameters = [parameter.unit for parameter in self.bound.parameters]
        return (*of_parameters, *self.bound.hyper_prior.units)

    @cached_property
    def bounds(self) -> Array:
        """Return the least and the greatest value of each of the d coordinates, shape (d, 2).

        The coordinates are the parameters, then the hyper-parameters. A bound that does not exist
        is −inf or inf. The condition that no compliance is negative at any tested force also
        restricts combinations of parameters, such as a compliance and its change with force.
        `log_prior` takes this restriction of combinations into account; the bounds do not.
        """
        return np.concatenate([self.bound.truncation.bounds, self.bound.hyper_prior.bounds])

    @property
    def scale(self) -> Array:
        """Return the typical magnitude of each of the d coordinates under the prior, shape (d,).

        The coordinates are the parameters, then the hyper-parameters. The value for a parameter is
        its prior standard deviation. The value for a hyper-parameter that is a length is the scale
        of its prior; for any other hyper-parameter, the value is one. For an optimiser, use the
        standard deviations of the points from `initial` instead, because these points scatter about
        as much as the posterior.
        """
        prior = self.bound.hyper_prior
        return np.concatenate([self.bound.scale, np.where(prior.in_mm, prior.scale, 1.0)])

    def __repr__(self) -> str:
        """Return a line of text with the name of the campaign and the numbers of coordinates.

        The first number is that of the parameters, the second that of the hyper-parameters.
        """
        campaign = self.bound.campaign.name
        parameters = len(self.bound.names)
        scales = len(self.bound.hyper_prior.names)
        return f"LogDensity of {campaign!r}: {parameters} parameters, {scales} scales"

    def log_prob(self, x: Array) -> Array:
        """Return the joint log density ln p(y | x) + ln p(x) of the readings y and of x.

        ``x`` is one point, shape (d,), or n points, shape (n, d). The d coordinates of a point are
        the parameters, then the hyper-parameters. The result is −inf where the prior density p(x)
        is zero. The result is never NaN.
        """
        return self._evaluate(x, self._log_joint)

    def log_prior(self, x: Array) -> Array:
        """Return the log prior density ln p(x) at x.

        ``x`` is one point, shape (d,), or n points, shape (n, d). The d coordinates of a point are
        the parameters, then the hyper-parameters. If the model forbids negative compliances, the
        result is −inf where a compliance is negative. If the parameters have a flat prior, the
        result is the log prior density of the hyper-parameters alone.
        """
        return self._evaluate(x, self._log_prior)

    def log_likelihood(self, x: Array) -> Array:
        """Return the log density ln p(y | x) of the readings y in mm, given x.

        ``x`` is one point, shape (d,), or n points, shape (n, d). The d coordinates of a point are
        the parameters, then the hyper-parameters. The result is −inf if a hyper-parameter is
        outside its bounds or x is not finite.
        """
        return self._evaluate(x, self._log_likelihood)

    def prior_transform(self, u: Array) -> Array:
        """Return the points x at cumulative prior probabilities u, for nested samplers.

        ``x`` is one point, shape (d,), or n points, shape (n, d). The d coordinates of a point are
        the parameters, then the hyper-parameters. ``u``, of the same shape, holds a number between
        0 and 1 for each coordinate of x. It is the prior probability of smaller values of the
        coordinate, given the coordinates before it. If the model forbids negative compliances, no
        compliance is negative at any x returned.

        Raises
        ------
        InputError
            For a flat prior, which has no cumulative probabilities, or for u outside the unit cube.
        """
        bound = self.bound
        require(
            not bound.model.prior.flat,
            "a prior to transform to must be proper, got a flat one. Use the default preset.",
        )
        probability = np.atleast_2d(self._check_points(u, "u"))
        outside = probability[~((probability >= 0.0) & (probability <= 1.0))]
        require(
            not len(outside),
            f"u must lie between 0 and 1, got {outside[:1].sum()}. Give prior probabilities, one"
            " each.",
        )
        probability = np.clip(probability, _SMALLEST_PROBABILITY, 1.0 - _SMALLEST_PROBABILITY)
        of_beta, of_phi = np.split(probability, [len(bound.names)], axis=1)
        beta = bound.truncation.quantile(of_beta, bound.prior_mean, bound.prior_sd)
        phi = bound.hyper_prior.quantile(of_phi)
        return np.concatenate([beta, phi], axis=1).reshape(np.shape(u))

    def split(self, x: Array) -> dict[str, dict[str, Any]]:
        """Return parameters and hyper-parameters by name, ``{"parameters": {…}, "hyper": {…}}``.

        The inner dicts have the names of the parameters or hyper-parameters as keys. If ``x`` is
        one point, shape (d,), their values are numbers. If ``x`` holds n points, shape (n, d),
        their values are arrays of shape (n,). The d coordinates of a point are the parameters, then
        the hyper-parameters.
        """
        points = self._check_points(x)
        by_coordinate: Any = np.moveaxis(points, -1, 0)
        if points.ndim == 1:
            by_coordinate = points.tolist()
        by_name = dict(zip(self.names, by_coordinate, strict=True))
        return {
            "parameters": {name: by_name[name] for name in self.bound.names},
            "hyper": {name: by_name[name] for name in self.bound.hyper_prior.names},
        }

    def initial(self, n: int, seed: int = 1) -> Array:
        """Return n starting points for a sampler, shape (n, d).

        A point holds the d coordinates: the parameters, then the hyper-parameters. The points are
        drawn at random, with the given ``seed``, and are spread a little wider than the posterior.
        If the model forbids negative compliances, no compliance is negative at any point.
        """
        joint = JointDensity(self.bound)
        random = np.random.RandomState(seed)
        points = starting_points(LinearRedraw(joint, self._hyper_posterior), n, random)
        beta, free = joint.split(points)
        return np.concatenate([beta, self.bound.hyper_prior.phi(free)], axis=1)

    @cached_property
    def _hyper_posterior(self) -> HyperPosterior:
        """Posterior density of the model's hyper-parameters.

        If the model requires that no compliance is negative, this condition is part of the density.
        """
        return HyperPosterior(self.bound, truncated=self.bound.truncation.active)

    def _log_joint(self, beta: Array, phi: Array) -> Array:
        """Return the joint log density ln p(y, β, φ) at n points, shape (n,); y are the readings.

        ``beta``, shape (n, p), holds the p parameters β; ``phi``, shape (n, h), holds the h
        hyper-parameters φ.
        """
        log_hyper_prior = self.bound.hyper_prior.log_density(phi)
        return _log_joint_density(self.bound, beta, phi, log_hyper_prior)

    def _log_prior(self, beta: Array, phi: Array) -> Array:
        """Return the log prior density ln p(β) + ln p(φ) at n points, shape (n,).

        ``beta``, shape (n, p), holds the p parameters β; ``phi``, shape (n, h), holds the h
        hyper-parameters φ.
        """
        return self.bound.parameter_prior.log_density(beta) + self.bound.hyper_prior.log_density(
            phi
        )

    def _log_likelihood(self, beta: Array, phi: Array) -> Array:
        """Return the log likelihood ln p(y | β, φ) of the readings y at n points, shape (n,).

        ``beta``, shape (n, p), holds the p parameters β; ``phi``, shape (n, h), holds the h
        hyper-parameters φ.
        """
        return self.bound.log_likelihood(phi, beta)

    def _check_points(self, x: Array, argument: str = "x") -> Array:
        """Return points as an array of floats, after a check of its shape.

        The shape must be (d,) for one point of d coordinates, or (n, d) for n points. Raise an
        `InputError` for any other shape, and for what is no number; its message calls the points by
        the name ``argument``.
        """
        try:
            points = np.asarray(x, dtype=float)
        except (TypeError, ValueError):
            raise InputError(
                f"{argument} must be an array of numbers, got {type(x).__name__}. Order it as in"
                " names."
            ) from None
        d = len(self.names)
        fits = points.ndim in (1, 2) and points.shape[-1] == d
        require(
            fits,
            f"{argument} must have shape ({d},) or (n, {d}), got {points.shape}. Order it as in"
            " names.",
        )
        return points

    def _evaluate(self, x: Array, density: Callable[[Array, Array], Array]) -> Array:
        """Return a log density at points x; −inf where x is not finite or outside the bounds.

        ``x`` is one point, shape (d,), or n points, shape (n, d). The d coordinates of a point are
        the parameters, then the hyper-parameters. Only the bounds of the hyper-parameters are
        checked here. ``density`` is a function that takes the p parameters and the h
        hyper-parameters of m points, shapes (m, p) and (m, h), and returns their log densities,
        shape (m,).
        """
        values = self._check_points(x)
        points = values.reshape(-1, len(self.names))
        beta, phi = np.split(points, [len(self.bound.names)], axis=1)
        lowest, highest = self.bound.hyper_prior.bounds.T
        within_bounds = ((phi >= lowest) & (phi <= highest)).all(axis=1)
        inside = np.isfinite(points).all(axis=1) & within_bounds
        log_density = np.full(len(points), -np.inf)
        if inside.any():
            log_density[inside] = density(beta[inside], phi[inside])
        # For a single point, the result is an array without dimensions; the empty index converts
        # this array to a number.
        of_points: Array = log_density.reshape(values.shape[:-1])[()]
        return of_points


def _log_joint_density(bound: BoundModel, beta: Array, phi: Array, log_hyper_prior: Array) -> Array:
    """Return ln p(y | β, φ) + ln p(β) + ``log_hyper_prior`` at n points, shape (n,).

    y are the readings. ``beta``, shape (n, p), holds the p parameters β; ``phi``, shape (n, h),
    holds the h hyper-parameters φ. ``log_hyper_prior``, shape (n,), is the log prior density of φ.
    ``bound`` is the model of the campaign.
    """
    total = bound.parameter_prior.log_density(beta) + log_hyper_prior
    inside = np.isfinite(total)
    if inside.any():
        total[inside] += bound.log_likelihood(phi[inside], beta[inside])
    return np.asarray(total)


@dataclass(frozen=True, eq=False)
class JointDensity:
    """Log posterior density as a function of the coordinates that a sampler uses.

    The first p coordinates are (β − centre) / scale for the p parameters β, where ``centre`` holds
    the least-squares estimates and ``scale`` the typical magnitudes of the parameters. The other h
    coordinates are unbounded coordinates of the hyper-parameters φ, mostly ln(φ − lower bound). The
    density includes the Jacobian of these transformations except for a constant factor, and is not
    divided by the evidence.
    """

    bound: BoundModel  #: model applied to a campaign with readings

    def __call__(self, x: Array) -> Array:
        """Return the log posterior density, shape (n,), at n points x of shape (n, p + h).

        The first p coordinates of a point are the parameters minus their least-squares estimates,
        divided by their typical magnitudes. The other h coordinates are unbounded coordinates of
        the hyper-parameters, mostly ln(value − lower bound).
        """
        beta, free = self.split(x)
        prior = self.bound.hyper_prior
        log_hyper_prior = prior.log_density_of_free(free)
        return _log_joint_density(self.bound, beta, prior.phi(free), log_hyper_prior)

    def split(self, x: Array) -> tuple[Array, Array]:
        """Convert a sampler's points to parameters and free coordinates of hyper-parameters.

        ``x``, shape (..., p + h), holds the points; the first p coordinates of a point are scaled
        parameters (see `JointDensity`). The results are the parameters in mm, N and rad, shape
        (..., p), and the free coordinates, shape (..., h). Free coordinates are the h
        hyper-parameters transformed to be unbounded, mostly ln(value − lower bound).
        """
        p = len(self.bound.names)
        return self.bound.least_squares_estimate + x[..., :p] * self.bound.scale, x[..., p:]

    def join(self, beta: Array, free: Array) -> Array:
        """Convert parameters and hyper-parameters to points of a sampler, shape (..., p + h).

        The first p coordinates of a point are scaled parameters (see `JointDensity`). ``beta``,
        shape (..., p), holds the p parameters. ``free``, shape (..., h), holds the h
        hyper-parameters transformed to be unbounded, mostly ln(value − lower bound). `split` is the
        inverse.
        """
        return np.concatenate(
            [(beta - self.bound.least_squares_estimate) / self.bound.scale, free], axis=-1
        )


@dataclass(frozen=True, eq=False)
class LinearRedraw:
    """Source of independent random draws of the parameters β and hyper-parameters φ.

    A sampler proposes these draws to its walkers as their next points. φ is drawn from a density
    fitted to p(φ | y), where y are the readings. β is drawn from its exact Gaussian density given φ
    and y. If the model forbids negative compliances, β is drawn from a density that is shifted
    towards non-negative compliances; importance weights correct for this shift.
    """

    density: JointDensity  #: joint posterior density of parameters and hyper-parameters
    #: posterior density of the hyper-parameters alone, with the parameters integrated out
    start: HyperPosterior

    def draw(
        self, size: int, random: np.random.RandomState, *, temperature: float = 1.0
    ) -> WeightedPoints:
        """Return ``size`` random points with log importance weights and log posterior densities.

        A point holds p parameters and h hyper-parameters in the coordinates of `JointDensity`. The
        density from which the hyper-parameters are drawn is widened: its standard deviations are
        multiplied by the square root of ``temperature``.
        """
        bound = self.density.bound
        free = self.start.weighted_sample.draw(size, random, temperature=temperature)
        log_evidence, conditional = self.start.given(free)
        standard = random.standard_normal(conditional.mean.shape)
        log_tilt = np.zeros(size)
        if bound.truncation.active:
            uniform = random.random_sample((size, len(bound.truncation.rows)))
            standard, log_tilt = conditional.orthant.propose_standard(uniform, standard)
        beta = conditional.from_standard(standard)
        log_marginal = bound.hyper_prior.log_density_of_free(free) + log_evidence
        log_joint = log_marginal + conditional.log_density(beta)
        log_target = np.where(bound.truncation.holds(beta), log_joint, -np.inf)
        log_weight = log_marginal - self.start.weighted_sample.log_proposal(free) + log_tilt
        return WeightedPoints(
            self.density.join(beta, free),
            np.where(np.isfinite(log_target), log_weight, -np.inf),
            log_target - bound.parameter_prior.normalisation.log_value,
        )

    def log_weight(self, points: Array) -> Array:
        """Return the log importance weights of n points, shape (n,).

        ``points``, shape (n, p + h), holds p parameters and h hyper-parameters in the coordinates
        of `JointDensity`. The weight of a point is the posterior density at the point divided by
        the density from which `draw` draws points, up to a constant factor. If the model forbids
        negative compliances, the caller must ensure that no compliance is negative at any of the
        points; this is not checked.
        """
        bound = self.density.bound
        beta, free = self.density.split(points)
        log_evidence, conditional = self.start.given(free)
        log_marginal = bound.hyper_prior.log_density_of_free(free) + log_evidence
        log_weight = log_marginal - self.start.weighted_sample.log_proposal(free)
        if bound.truncation.active:
            log_weight = log_weight + conditional.orthant.log_proposal_weight(
                conditional.standardize(beta)
            )
        return np.asarray(log_weight)


def starting_points(redraw: LinearRedraw, n: int, random: np.random.RandomState) -> Array:
    """Return n random starting points of a sampler, shape (n, p + h).

    The points are in the coordinates of `JointDensity`. The h hyper-parameters (such as the
    standard deviation of the noise) are drawn from a density a little wider than their posterior.
    The p parameters (compliances, their changes with force, geometric errors) are drawn from their
    density given the hyper-parameters and the readings. If the model forbids negative compliances,
    no compliance is negative at any point. ``redraw`` makes the draws.

    Raises
    ------
    InputError
        If almost all draws have a negative compliance.
    """
    candidates = redraw.draw(_DRAWS_PER_START * n, random, temperature=_START_TEMPERATURE)
    inside = candidates.points[np.isfinite(candidates.log_target)]
    require(
        len(inside) >= n,
        "the posterior must leave room where no compliance is negative, got almost none. The"
        " readings contradict non-negative compliance: check the sign of the readings, the mount"
        " compensation and the forces, or fit --without truncation.",
    )
    return np.asarray(inside[:n])
