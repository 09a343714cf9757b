"""The posterior that the peers sample: that of the package's joint sampler, written again in JAX.

p(β, φ | y) has the nuisances integrated out, and is computed from the 25 reduced numbers of every
test. Only public attributes of `BoundModel` are used. JAX is imported where it is needed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError
from ldbb_bayes.model.fourier import SIZE
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.reduction import Reduced
from ldbb_bayes.model.terms import BasisNoise

__all__ = ["LOG_2PI", "Laplace", "ReducedDensity", "check"]

Array = NDArray[Any]
LOG_2PI = float(np.log(2 * np.pi))
# Decimals to which weights of the noise are compared.
WEIGHT_DECIMALS = 9


@dataclass(frozen=True, eq=False)
class _Nuisances:
    """All Gaussian latents of the reduced readings.

    ``values`` (tests, 25, q): columns, those of one test being zero in the others. Their sd is
    ``sd`` (q,) times component ``scale_index`` (q,) of (φ, 1). ``noise`` (h, 25): variance of the
    independent noise on the basis in units of φ².
    """

    values: Array
    sd: Array
    scale_index: Array
    noise: Array


def _is_uniform(test: Reduced) -> bool:
    """Whether the basis is orthogonal over the readings of a test, so that its factor is
    diagonal."""
    circle = test.near_uniform
    return circle is not None and not circle.significant.any()


def _nuisances(bound: BoundModel) -> _Nuisances:
    """All Gaussian latents, terms that each test has for itself as columns of their own."""
    scale_names = bound.hyper_prior.names
    tests = len(bound.reduced)
    values = [np.zeros((tests, SIZE, 0))]
    sd = [np.zeros(0)]
    scale_index = [np.zeros(0, dtype=int)]
    noise = np.zeros((len(scale_names), SIZE))
    for term in bound.nuisance_columns:
        if isinstance(term, BasisNoise):
            noise[scale_names.index(term.hyper)] += term.sd**2
            continue
        copies = 1
        columns = term.values
        if term.private:
            copies = tests
            columns = np.einsum("rkq,rs->rkqs", term.values, np.eye(tests)).reshape(tests, SIZE, -1)
        scale = len(scale_names)
        if term.hyper is not None:
            scale = scale_names.index(term.hyper)
        values.append(columns)
        sd.append(np.repeat(term.sd, copies))
        scale_index.append(np.full(columns.shape[2], scale))
    return _Nuisances(
        values=np.concatenate(values, axis=2),
        sd=np.concatenate(sd),
        scale_index=np.concatenate(scale_index),
        noise=noise,
    )


def _integrated() -> Callable[[Any, Any], Any]:
    """(M, b) → ½ bᵀ M⁻¹ b − ½ ln|M|: what Gaussian columns add once integrated out. Its gradient
    reuses the inverse root."""
    import jax
    import jax.numpy as jnp
    from jax.scipy.linalg import solve_triangular

    def forward(matrix: Any, vector: Any) -> tuple[Any, tuple[Any, Any]]:
        root = jnp.linalg.cholesky(matrix)
        inverse_root = solve_triangular(root, jnp.eye(matrix.shape[0]), lower=True)
        white = inverse_root @ vector
        return 0.5 * white @ white - jnp.log(jnp.diag(root)).sum(), (inverse_root, white)

    def backward(saved: tuple[Any, Any], cotangent: Any) -> tuple[Any, Any]:
        inverse_root, white = saved
        solved = inverse_root.T @ white
        by_matrix = inverse_root.T @ inverse_root + jnp.outer(solved, solved)
        return -0.5 * cotangent * by_matrix, cotangent * solved

    def value(matrix: Any, vector: Any) -> Any:
        return forward(matrix, vector)[0]

    integrated = jax.custom_vjp(value)
    integrated.defvjp(forward, backward)
    return integrated


@dataclass(frozen=True, eq=False)
class _UniformReadings:
    """Reduced readings of uniform circles less what the centre of β and known offsets explain.

    ``residual`` (tests, 25); ``design`` (tests, 25, p) multiplies β − centre; ``columns``
    (tests, 25, q) multiply the latents; ``weight`` (tests, 25, h) times φ² is the variance of the
    noise.
    """

    residual: Array
    design: Array
    columns: Array
    weight: Array
    latent: _Nuisances


def _uniform_readings(bound: BoundModel) -> _UniformReadings:
    latent = _nuisances(bound)
    scale_names = bound.hyper_prior.names
    factor = np.stack([np.diag(test.factor) for test in bound.reduced])
    projection = np.stack([np.asarray(test.reading_mm) for test in bound.reduced])
    of_readings = np.eye(len(scale_names))[scale_names.index("sigma")]
    return _UniformReadings(
        residual=projection
        - factor * (bound.interest_columns @ bound.least_squares_estimate + bound.known_offset),
        design=factor[:, :, None] * bound.interest_columns,
        columns=factor[:, :, None] * latent.values,
        weight=factor[:, :, None] ** 2 * latent.noise.T + of_readings,
        latent=latent,
    )


def _coupled_coefficients(latent: _Nuisances, interest: Array) -> Array:
    """Which of the 25 coefficients must be treated jointly, shape (25,).

    Those that β acts on, that several latents act on, or whose latent acts on others too.
    """
    touched = (latent.values != 0).any(axis=0)
    has_several_latents = touched.sum(axis=1) > 1
    latent_of_several = touched.sum(axis=0) > 1
    crowded = has_several_latents | touched[:, latent_of_several].any(axis=1)
    return np.asarray(crowded | (interest != 0).any(axis=(0, 2)))


@dataclass(frozen=True, eq=False)
class _CoupledRows:
    """Coefficients that share latents: n rows of all tests, integrated over q latents by Woodbury.

    Rows whose noise is the same function of φ are of one kind, and share their Gram matrix.
    """

    rows: Array  #: residuals, shape (n,)
    design: Array  #: shape (n, p)
    shared: Array  #: columns of the latents, shape (n, q)
    latent_sd: Array  #: shape (q,)
    latent_scale: Array  #: component of (φ, 1) that scales each latent, shape (q,)
    weight_of_kind: Array  #: shape (kinds, h)
    kind: Array  #: of every row, shape (n,)
    count: Array  #: rows of every kind, shape (kinds,)
    gram: Array  #: of every kind, flattened, shape (kinds, q²)
    integrated: Callable[[Any, Any], Any]

    def log_likelihood(self, offset: Any, phi: Any) -> Any:
        """ln p of these rows, but for the factors of 2π."""
        import jax.numpy as jnp

        variance = self.weight_of_kind @ phi**2
        precision = 1.0 / variance
        difference = self.rows - self.design @ offset
        weighted = difference * precision[self.kind]
        sd = self.latent_sd * jnp.append(phi, 1.0)[self.latent_scale]
        latents = len(self.latent_sd)
        gram = (precision @ self.gram).reshape(latents, latents)
        matrix = gram * (sd[:, None] * sd) + jnp.eye(latents)
        explained = self.integrated(matrix, (weighted @ self.shared) * sd)
        log_determinant = (self.count * jnp.log(variance)).sum()
        return explained - 0.5 * (log_determinant + difference @ weighted)


def _coupled_rows(readings: _UniformReadings, coupled: Array) -> _CoupledRows:
    latent = readings.latent
    acting = (latent.values != 0).any(axis=0)[coupled].any(axis=0)
    rows = readings.residual[:, coupled].ravel()
    shared = readings.columns[:, coupled][:, :, acting].reshape(len(rows), -1)
    weight = np.round(readings.weight[:, coupled].reshape(len(rows), -1), WEIGHT_DECIMALS)
    weight_of_kind, kind = np.unique(weight, axis=0, return_inverse=True)
    grams = []
    for number in range(len(weight_of_kind)):
        of_kind = shared[kind == number]
        grams.append((of_kind.T @ of_kind).ravel())
    return _CoupledRows(
        rows=rows,
        design=readings.design[:, coupled].reshape(len(rows), -1),
        shared=shared,
        latent_sd=latent.sd[acting],
        latent_scale=latent.scale_index[acting],
        weight_of_kind=weight_of_kind,
        kind=kind,
        count=np.bincount(kind).astype(float),
        gram=np.stack(grams),
        integrated=_integrated(),
    )


@dataclass(frozen=True, eq=False)
class _SeparateRows:
    """Coefficients (form of high order) with one latent at most, which acts on nothing else.

    Tests whose noise is the same function of φ are of one kind; m is the number of coefficients.
    Sums over the tests of a kind have shape (kinds, m).
    """

    latent_sd: Array  #: shape (m,); 0 where there is no latent
    latent_scale: Array  #: component of (φ, 1) that scales each latent, shape (m,)
    weight_of_kind: Array  #: shape (kinds, m, h)
    count: Array  #: tests of every kind, shape (kinds, 1)
    residual_square: Array  #: sums of squared residuals
    column_square: Array  #: sums of squared columns
    cross_product: Array  #: sums of products of columns and residuals

    def minus_twice_log_likelihood(self, phi: Any) -> Any:
        """−2 ln p of these coefficients, but for the factors of 2π."""
        import jax.numpy as jnp

        variance = self.weight_of_kind @ phi**2
        latent_variance = (self.latent_sd * jnp.append(phi, 1.0)[self.latent_scale]) ** 2
        inflation = 1.0 + latent_variance * (self.column_square / variance).sum(axis=0)
        cross = (self.cross_product / variance).sum(axis=0)
        explained = latent_variance * cross**2 / inflation
        of_noise = (self.count * jnp.log(variance) + self.residual_square / variance).sum()
        return of_noise + (jnp.log(inflation) - explained).sum()


def _separate_rows(readings: _UniformReadings, separate: Array) -> _SeparateRows:
    """Of coefficients ``separate`` (m,), by their numbers."""
    latent = readings.latent
    tests, _, scales = readings.weight.shape
    # A latent of sd 0 stands where a coefficient has none.
    touched = (latent.values != 0).any(axis=0)
    no_latent = latent.sd.size
    latent_of = [np.append(np.flatnonzero(touched[k]), no_latent)[0] for k in separate]
    latent_index = np.array(latent_of, dtype=int)
    with_none = np.concatenate([readings.columns, np.zeros((tests, SIZE, 1))], axis=2)
    columns = with_none[:, separate, latent_index]
    residual = readings.residual[:, separate]

    weight = np.round(readings.weight[:, separate].reshape(tests, -1), WEIGHT_DECIMALS)
    weight_of_kind, kind = np.unique(weight, axis=0, return_inverse=True)
    return _SeparateRows(
        latent_sd=np.append(latent.sd, 0.0)[latent_index],
        latent_scale=np.append(latent.scale_index, scales)[latent_index],
        weight_of_kind=weight_of_kind.reshape(len(weight_of_kind), len(separate), scales),
        count=np.bincount(kind).astype(float)[:, None],
        residual_square=_sums_by_kind(residual**2, kind),
        column_square=_sums_by_kind(columns**2, kind),
        cross_product=_sums_by_kind(columns * residual, kind),
    )


def _sums_by_kind(products: Array, kind: Array) -> Array:
    """Sums over the tests of every kind, (tests, m) → (kinds, m)."""
    return np.stack([products[kind == number].sum(axis=0) for number in range(kind.max() + 1)])


def _uniform_log_likelihood(bound: BoundModel) -> Callable[[Any, Any], Any]:
    """ln p(y | β, φ) for uniform circles as a function of β − centre and φ.

    The factor is diagonal, so that set-up shift and discrepancy are. Coefficients whose latent acts
    on nothing else are scalars; the others meet in one Woodbury.
    """
    import jax.numpy as jnp

    readings = _uniform_readings(bound)
    coupled = _coupled_coefficients(readings.latent, bound.interest_columns)
    coupled_rows = _coupled_rows(readings, coupled)
    separate_rows = _separate_rows(readings, np.flatnonzero(~coupled))
    # Outside the basis there is white noise and nothing else.
    sigma = bound.hyper_prior.names.index("sigma")
    reading_counts = np.array([test.readings for test in bound.reduced])
    outside_count = float((reading_counts - SIZE).sum())
    outside_square = float(sum(test.residual_ss for test in bound.reduced))
    constant = -0.5 * LOG_2PI * reading_counts.sum()

    def log_likelihood(offset: Any, phi: Any) -> Any:
        variance = phi[sigma] ** 2
        minus_twice = separate_rows.minus_twice_log_likelihood(phi)
        minus_twice = minus_twice + outside_count * jnp.log(variance) + outside_square / variance
        return constant + coupled_rows.log_likelihood(offset, phi) - 0.5 * minus_twice

    return log_likelihood


class Laplace(NamedTuple):
    """A normal approximation: ``centre`` (p + h,), ``root`` (p + h, p + h) of its covariance."""

    centre: Array
    root: Array


class _Expansion(NamedTuple):
    """Value, gradient and Hessian of a function at a point."""

    value: Array
    gradient: Array
    hessian: Array


class ReducedDensity:
    """ln p(y | β, φ) p(β) p(free coordinates of φ) in JAX; truncation left aside.

    x = ((β − centre) / prior sd, ln(φ − lower)), shape (p + h,).

    Parameters
    ----------
    bound : BoundModel
        With readings of uniform circles and proper priors.

    Raises
    ------
    InputError
        For a flat prior, or another sampling of the circle.
    """

    def __init__(self, bound: BoundModel) -> None:
        import jax

        if bound.model.prior.flat:
            raise InputError(
                "the prior must be proper for a peer, got a flat one. Use the default preset."
            )
        jax.config.update("jax_enable_x64", True)
        self.bound = bound
        if not all(_is_uniform(test) for test in bound.reduced):
            raise InputError(
                "tests must be uniform circles for a peer, got another sampling. Leave the peers"
                " out."
            )
        self._log_likelihood = _uniform_log_likelihood(bound)
        hyper = bound.hyper_prior
        at_lower = hyper.log_density(hyper.lower) + 0.5 * ((hyper.lower / hyper.scale) ** 2).sum()
        self._constant = float(
            at_lower - np.log(bound.prior_sd).sum() - 0.5 * LOG_2PI * len(bound.names)
        )
        self._second_order: Callable[[Any], Any] | None = None

    @property
    def size(self) -> int:
        """Number of coordinates, p + h."""
        return len(self.bound.names) + len(self.bound.hyper_prior.names)

    def __call__(self, x: Any) -> Any:
        """The log density at x, a scalar."""
        import jax.numpy as jnp

        bound = self.bound
        p = len(bound.names)
        standard = x[:p]
        free = x[p:]
        phi = bound.hyper_prior.lower + jnp.exp(free)
        beta_square = ((standard + bound.least_squares_estimate / bound.prior_sd) ** 2).sum()
        phi_square = ((phi / bound.hyper_prior.scale) ** 2).sum()
        log_prior = free.sum() - 0.5 * (beta_square + phi_square)
        return self._constant + log_prior + self._log_likelihood(standard * bound.prior_sd, phi)

    def split(self, x: Array) -> tuple[Array, Array]:
        """β [mm, N, rad] and the free coordinates, shapes (..., p) and (..., h)."""
        p = len(self.bound.names)
        return self.bound.least_squares_estimate + x[..., :p] * self.bound.prior_sd, x[..., p:]

    def prepare(self) -> None:
        """Compile value, gradient and Hessian."""
        import jax
        import jax.numpy as jnp

        gradient = jax.grad(self.__call__)

        def second_order(x: Any) -> tuple[Any, Any, Any]:
            def hessian_column(direction: Any) -> Any:
                return jax.jvp(gradient, (x,), (direction,))[1]

            return self(x), gradient(x), jax.lax.map(hessian_column, jnp.eye(self.size))

        self._second_order = jax.jit(second_order).lower(jnp.zeros(self.size)).compile()

    def laplace(self) -> Laplace:
        """Mode and lower triangular root of the inverse curvature there, by damped Newton steps.

        Raises
        ------
        RuntimeError
            When no mode is reached.
        """
        x = self._origin()
        value, gradient, hessian = self._evaluate(x)
        for _ in range(200):
            curvature, vectors = np.linalg.eigh(-hessian)
            step = vectors @ ((vectors.T @ gradient) / np.maximum(np.abs(curvature), 1e-3))
            if gradient @ step < 1e-8 and curvature[0] > 0:
                return Laplace(x, np.linalg.cholesky((vectors / curvature) @ vectors.T))
            length = 1.0
            while length > 1e-8:
                trial = self._evaluate(x + length * step)
                if trial.value > value - 1e-9:
                    break
                length /= 2.0
            x = x + length * step
            value, gradient, hessian = trial
        raise RuntimeError("no mode of the reduced posterior found in 200 Newton steps.")

    def start(self) -> Laplace:
        """β by least squares and the prior median of φ, and the diagonal root of the inverse
        curvatures there."""
        x = self._origin()
        curvature = np.diag(self._evaluate(x).hessian)
        return Laplace(x, np.diag(1.0 / np.sqrt(np.abs(curvature))))

    def _origin(self) -> Array:
        """β by least squares and the prior median of φ, shape (p + h,)."""
        hyper = self.bound.hyper_prior
        median = hyper.quantile(np.full(len(hyper.names), 0.5))
        return np.concatenate([np.zeros(len(self.bound.names)), hyper.free(median)])

    def _evaluate(self, x: Array) -> _Expansion:
        """The log density about x."""
        if self._second_order is None:
            self.prepare()
        evaluate: Any = self._second_order
        value, gradient, hessian = evaluate(x)
        return _Expansion(np.asarray(value), np.asarray(gradient), np.asarray(hessian))


def check(bound: BoundModel, *, points: int = 24, seed: int = 1, tolerance: float = 1e-6) -> float:
    """Compare the JAX density with the package's at posterior-like points.

    Returns
    -------
    float
        Largest difference [nat]; constants are not left out.

    Raises
    ------
    RuntimeError
        When it exceeds the tolerance.
    """
    import jax

    density = ReducedDensity(bound)
    evaluate = jax.jit(density)
    mode, root = density.laplace()
    x = mode + np.random.default_rng(seed).standard_normal((points, len(mode))) @ root.T
    by_jax = np.array([evaluate(point) for point in x])
    beta, free = density.split(x)
    package = bound.parameter_prior.log_density(beta) + bound.hyper_prior.log_density_of_free(free)
    package = package + bound.log_likelihood(bound.hyper_prior.phi(free), beta)
    if bound.truncation.active:
        package = np.where(
            np.isfinite(package), package + bound.parameter_prior.normalisation.log_value, np.nan
        )
    difference = float(np.nanmax(np.abs(by_jax - package)))
    if not difference < tolerance:
        raise RuntimeError(
            f"the JAX density differs from the package's by {difference:.2g}, more than"
            f" {tolerance:g}."
        )
    return difference
