"""Moments of Gaussian distributions of the parameters, given that no compliance is negative."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.results import Array

__all__ = ["TruncatedMoments", "symmetric_root", "truncated_moments"]


class TruncatedMoments(NamedTuple):
    """Means and variances of p parameters, given that no compliance is negative.

    They are those of several distributions of the parameters. The leading dimensions of the arrays
    count the distributions.
    """

    mean: Array  # means of the p parameters, shape (..., p), in internal units (mm, N, rad)
    variance: Array  # variances of the p parameters, shape (..., p), in internal units
    # log probability that no compliance is negative, if negative compliances are not excluded,
    # shape (...)
    log_probability: Array


def truncated_moments(
    bound: BoundModel, mean: Array, covariance: Array, *, points: int = 512
) -> TruncatedMoments:
    """Return moments of Gaussian distributions, given that no compliance is negative.

    If the model permits negative compliances, the moments do not change, and the log probabilities
    are 0.

    Parameters
    ----------
    bound
        Model applied to the tests. No compliance may be negative at the forces of these tests.
    mean
        Means of the p parameters in each Gaussian, in internal units (mm, N, rad), shape (..., p).
    covariance
        Covariances of the parameters, of a shape that broadcasts to (..., p, p), in internal units.
        A covariance may be singular, for example because a parameter is zero.
    points
        Number of quasi-random points from which the moments of each Gaussian are computed.
    """
    shape = mean.shape
    variance = np.broadcast_to(np.diagonal(covariance, axis1=-2, axis2=-1), shape)
    if not bound.truncation.active:
        return TruncatedMoments(mean, variance, np.zeros(shape[:-1]))
    scale = bound.scale
    p = len(scale)
    root = symmetric_root(covariance / np.outer(scale, scale)) * scale[:, None]
    spread = np.broadcast_to(root, (*shape, p)).reshape(-1, p, p)
    inside = bound.truncation.orthants(mean.reshape(-1, p), spread).moments(points)
    # In standardized coordinates, the covariance of the parameters is the identity matrix. The
    # condition that no compliance is negative limits the parameters only along the directions
    # ``axes``. ``inside.covariance`` is the covariance along these directions under the condition.
    along_axes = spread @ np.swapaxes(inside.axes, 1, 2)
    change_along_axes = along_axes @ (inside.covariance - np.eye(inside.mean.shape[1]))
    change = np.einsum("kpd,kpd->kp", change_along_axes, along_axes).reshape(shape)
    mean_shift = np.einsum("kpd,kd->kp", along_axes, inside.mean).reshape(shape)
    return TruncatedMoments(
        mean + mean_shift,
        np.maximum(variance + change, 0.0),
        inside.log_probability.reshape(shape[:-1]),
    )


def symmetric_root(covariance: Array) -> Array:
    """Return the symmetric square root of covariance matrices, shape (..., p, p).

    Rows and columns of coordinates with a variance of zero are exactly zero.
    """
    symmetric = 0.5 * (covariance + np.swapaxes(covariance, -1, -2))
    size, axes = np.linalg.eigh(symmetric)
    scaled_axes = axes * np.sqrt(np.maximum(size, 0.0))[..., None, :]
    root = scaled_axes @ np.swapaxes(axes, -1, -2)
    # The root of a rounding error of 1e-16 is 1e-8, which would not be negligible.
    varies = np.diagonal(covariance, axis1=-2, axis2=-1) != 0.0
    return np.asarray(root * (varies[..., :, None] & varies[..., None, :]))
