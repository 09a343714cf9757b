"""The peers of the speed study: the same posterior by NumPyro's NUTS, and its evidence by dynesty
and by a bridge.

`ReducedNuts` samples p(β, φ | y) with the nuisances integrated out, from the 25 reduced numbers of
every test: the density the package's joint sampler sees, written again in JAX.
`nested_log_evidence` is ln p(y) by nested sampling, `bridged_log_evidence` by bridge sampling on
draws.

Only public attributes of `BoundModel` are used. NumPyro, JAX and dynesty are imported where they
are needed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, stdtrit

from ldbb_bayes.errors import InputError
from ldbb_bayes.inference.diagnostics import diagnose
from ldbb_bayes.model.fourier import SIZE
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.reduction import Reduced
from ldbb_bayes.model.terms import BasisNoise

__all__ = ["ReducedDensity", "ReducedNuts", "bridged_log_evidence", "check", "nested_log_evidence"]

Array = NDArray[Any]
_LOG_2PI = float(np.log(2 * np.pi))


@dataclass(frozen=True, eq=False)
class _Nuisances:
    """All Gaussian latents of the reduced readings.

    ``values`` (tests, 25, q): columns, those of one test alone being zero elsewhere. Their sd is
    ``sd`` (q,) times component ``owner`` (q,) of (φ, 1). ``noise`` (h, 25): variance of the
    independent noise on the basis in units of φ².
    """

    values: Array
    sd: Array
    owner: Array
    noise: Array


def _is_uniform(test: Reduced) -> bool:
    """Whether the basis is orthogonal over the readings of a test, so that its factor is
    diagonal."""
    circle = test.near_uniform
    return circle is not None and not circle.significant.any()


def _nuisances(bound: BoundModel) -> _Nuisances:
    hypers = bound.hyper_prior.names
    tests = len(bound.reduced)
    values = [np.zeros((tests, SIZE, 0))]
    sd = [np.zeros(0)]
    owner = [np.zeros(0, dtype=int)]
    noise = np.zeros((len(hypers), SIZE))
    for term in bound.nuisance_columns:
        if isinstance(term, BasisNoise):
            noise[hypers.index(term.hyper)] += term.sd**2
            continue
        copies = tests if term.private else 1
        columns = term.values
        if term.private:
            columns = np.einsum("rkq,rs->rkqs", term.values, np.eye(tests)).reshape(tests, SIZE, -1)
        values.append(columns)
        sd.append(np.repeat(term.sd, copies))
        owner.append(
            np.full(
                columns.shape[2], len(hypers) if term.hyper is None else hypers.index(term.hyper)
            )
        )
    return _Nuisances(
        np.concatenate(values, axis=2), np.concatenate(sd), np.concatenate(owner), noise
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
        return (
            -0.5 * cotangent * (inverse_root.T @ inverse_root + jnp.outer(solved, solved)),
            cotangent * solved,
        )

    integrated = jax.custom_vjp(lambda matrix, vector: forward(matrix, vector)[0])
    integrated.defvjp(forward, backward)
    return integrated


def _uniform_log_likelihood(bound: BoundModel) -> Callable[[Any, Any], Any]:
    """ln p(y | β, φ) for uniform circles as a function of β − centre and φ.

    The factor is diagonal, so that set-up shift and discrepancy are. Basis functions that a single
    column holds alone (form of high order) are scalars; the others meet in one Woodbury. Rows whose
    noise is the same function of φ share their Gram matrix, computed once.
    """
    import jax.numpy as jnp

    latent = _nuisances(bound)
    tests = len(bound.reduced)
    hypers = bound.hyper_prior.names
    sigma = hypers.index("sigma")
    factor = np.stack([np.diag(test.factor) for test in bound.reduced])
    projection = np.stack([np.asarray(test.reading_mm) for test in bound.reduced])
    residual = projection - factor * (bound.interest @ bound.centre + bound.known_offset)
    columns = factor[:, :, None] * latent.values
    weight = factor[:, :, None] ** 2 * latent.noise.T + np.eye(len(hypers))[sigma]

    touched = (latent.values != 0).any(axis=0)
    crowded = (touched.sum(axis=1) > 1) | touched[:, touched.sum(axis=0) > 1].any(axis=1)
    main = crowded | (bound.interest != 0).any(axis=(0, 2))
    linked = touched[main].any(axis=0)

    rows = residual[:, main].ravel()
    design = (factor[:, main, None] * bound.interest[:, main]).reshape(len(rows), -1)
    shared = columns[:, main][:, :, linked].reshape(len(rows), -1)
    kinds, kind = np.unique(
        np.round(weight[:, main].reshape(len(rows), -1), 9), axis=0, return_inverse=True
    )
    count = np.bincount(kind).astype(float)
    gram = np.stack([(shared[kind == k].T @ shared[kind == k]).ravel() for k in range(len(kinds))])
    q = shared.shape[1]

    alone = np.flatnonzero(~main)
    none = latent.sd.size
    held = np.array([np.append(np.flatnonzero(touched[k]), none)[0] for k in alone], dtype=int)
    own_columns = np.concatenate([columns, np.zeros((tests, SIZE, 1))], axis=2)[:, alone, held]
    own_sd = np.append(latent.sd, 0.0)[held]
    own_owner = np.append(latent.owner, len(hypers))[held]
    flat = np.round(weight[:, alone].reshape(tests, -1), 9)
    own_kinds, own_kind = np.unique(flat, axis=0, return_inverse=True)
    own_weight = own_kinds.reshape(len(own_kinds), len(alone), len(hypers))
    own_count = np.bincount(own_kind).astype(float)[:, None]

    def by_kind(products: Array) -> Array:
        return np.stack([products[own_kind == k].sum(axis=0) for k in range(len(own_kinds))])

    square_rows = by_kind(residual[:, alone] ** 2)
    square_columns = by_kind(own_columns**2)
    crossed = by_kind(own_columns * residual[:, alone])

    readings = np.array([test.readings for test in bound.reduced])
    outside_ss = float(sum(test.residual_ss for test in bound.reduced))
    outside = float((readings - SIZE).sum())
    constant = -0.5 * _LOG_2PI * readings.sum()
    integrated = _integrated()

    def log_likelihood(offset: Any, phi: Any) -> Any:
        square = phi**2
        scale = jnp.append(phi, 1.0)
        variance = kinds @ square
        precision = 1.0 / variance
        difference = rows - design @ offset
        weighted = difference * precision[kind]
        sd = latent.sd[linked] * scale[latent.owner[linked]]
        matrix = (precision @ gram).reshape(q, q) * (sd[:, None] * sd) + jnp.eye(q)
        together = integrated(matrix, (weighted @ shared) * sd) - 0.5 * (
            (count * jnp.log(variance)).sum() + difference @ weighted
        )

        own_variance = own_weight @ square
        own_square = (own_sd * scale[own_owner]) ** 2
        inflation = 1.0 + own_square * (square_columns / own_variance).sum(axis=0)
        explained = own_square * (crossed / own_variance).sum(axis=0) ** 2 / inflation
        apart = (own_count * jnp.log(own_variance) + square_rows / own_variance).sum() + (
            jnp.log(inflation) - explained
        ).sum()
        return (
            constant
            + together
            - 0.5 * (apart + outside * jnp.log(square[sigma]) + outside_ss / square[sigma])
        )

    return log_likelihood


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
            at_lower - np.log(bound.prior_sd).sum() - 0.5 * _LOG_2PI * len(bound.names)
        )
        self._second_order: Callable[[Any], Any] | None = None

    def __call__(self, x: Any) -> Any:
        """The log density at x, a scalar."""
        import jax.numpy as jnp

        bound, p = self.bound, len(self.bound.names)
        standard = x[:p]
        free = x[p:]
        phi = bound.hyper_prior.lower + jnp.exp(free)
        beta_square = ((standard + bound.centre / bound.prior_sd) ** 2).sum()
        log_prior = free.sum() - 0.5 * (beta_square + ((phi / bound.hyper_prior.scale) ** 2).sum())
        return self._constant + log_prior + self._log_likelihood(standard * bound.prior_sd, phi)

    def split(self, x: Array) -> tuple[Array, Array]:
        """β [mm, N, rad] and the free coordinates, shapes (..., p) and (..., h)."""
        p = len(self.bound.names)
        return self.bound.centre + x[..., :p] * self.bound.prior_sd, x[..., p:]

    def prepare(self) -> None:
        """Compile value, gradient and Hessian."""
        import jax
        import jax.numpy as jnp

        gradient = jax.grad(self.__call__)
        size = len(self.bound.names) + len(self.bound.hyper_prior.names)

        def second_order(x: Any) -> tuple[Any, Any, Any]:
            hessian = jax.lax.map(
                lambda direction: jax.jvp(gradient, (x,), (direction,))[1], jnp.eye(size)
            )
            return self(x), gradient(x), hessian

        self._second_order = jax.jit(second_order).lower(jnp.zeros(size)).compile()

    def laplace(self) -> tuple[Array, Array]:
        """Mode, shape (p + h,), and root of the inverse curvature there, lower triangular, by
        damped Newton steps.

        Raises
        ------
        RuntimeError
            Where no mode is found.
        """
        x = self._origin()
        value, gradient, hessian = self._evaluate(x)
        for _ in range(200):
            curvature, vectors = np.linalg.eigh(-hessian)
            step = vectors @ ((vectors.T @ gradient) / np.maximum(np.abs(curvature), 1e-3))
            if gradient @ step < 1e-8 and curvature[0] > 0:
                return x, np.linalg.cholesky((vectors / curvature) @ vectors.T)
            length = 1.0
            while length > 1e-8:
                trial = self._evaluate(x + length * step)
                if trial[0] > value - 1e-9:
                    break
                length /= 2.0
            x, (value, gradient, hessian) = x + length * step, trial
        raise RuntimeError("no mode of the reduced posterior found in 200 Newton steps.")

    def start(self) -> tuple[Array, Array]:
        """β by least squares and the prior median of φ, shape (p + h,), and the diagonal root of
        the curvatures there."""
        x = self._origin()
        curvature = np.diag(self._evaluate(x)[2])
        return x, np.diag(1.0 / np.sqrt(np.abs(curvature)))

    def _origin(self) -> Array:
        hyper = self.bound.hyper_prior
        return np.concatenate(
            [
                np.zeros(len(self.bound.names)),
                hyper.free(hyper.quantile(np.full(len(hyper.names), 0.5))),
            ]
        )

    def _evaluate(self, x: Array) -> tuple[Array, Array, Array]:
        if self._second_order is None:
            self.prepare()
        evaluate: Any = self._second_order
        value, gradient, hessian = (np.asarray(part) for part in evaluate(x))
        return value, gradient, hessian


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
    beta, free = density.split(x)
    package = bound.log_prior(beta) + bound.hyper_prior.log_density_of_free(free)
    package = package + bound.log_likelihood(bound.hyper_prior.phi(free), beta)
    if bound.truncation.active:
        package = np.where(np.isfinite(package), package + bound.log_prob_truncation_prior, np.nan)
    difference = float(np.nanmax(np.abs(np.array([evaluate(point) for point in x]) - package)))
    if not difference < tolerance:
        raise RuntimeError(
            f"the JAX density differs from the package's by {difference:.2g}, more than"
            f" {tolerance:g}."
        )
    return difference


class ReducedNuts:
    """NumPyro's NUTS on the reduced posterior, four chains, the whole run one compiled function.

    ``prepare`` compiles; ``run`` finds where to start, warms up and draws. The kernel and its
    adaptation are NumPyro's own; its ``MCMC`` driver is left out because it traces and compiles
    again at every call.

    Parameters
    ----------
    bound : BoundModel
        With proper priors and without truncation.
    whitened : bool
        Sample in the coordinates of the Laplace approximation, starting from draws of it, and adapt
        the step size alone; the chains go side by side. Otherwise in coordinates of unit curvature
        at the least-squares estimate and the prior median of φ, starting there, with a dense mass
        matrix that is adapted; the chains go one after the other. Each is the cheaper way in CPU
        seconds.
    draws : int
        Of each chain.
    """

    def __init__(self, bound: BoundModel, *, whitened: bool, draws: int = 2000) -> None:
        if bound.truncation.active:
            raise InputError(
                "the model must be without truncation, got it on. Use"
                ' HybridModel.without("truncation").'
            )
        self.whitened = whitened
        self.draws = draws
        self.chains = 4
        self.warmup = 200 if whitened else 1000
        self.density = ReducedDensity(bound)
        self._compiled: Callable[..., Any] | None = None

    def prepare(self) -> None:
        """Compile, and run once."""
        import jax
        import jax.numpy as jnp

        self.density.prepare()
        size = len(self.density.bound.names) + len(self.density.bound.hyper_prior.names)
        keys = jax.random.split(jax.random.key(0), self.chains)
        if self.whitened:
            over_chains = jax.jit(jax.vmap(self._one_chain, in_axes=(0, 0, None, None)))
        else:
            over_chains = jax.jit(
                lambda keys, starts, centre, root: jax.lax.map(
                    lambda own: self._one_chain(*own, centre, root), (keys, starts)
                )
            )
        self._compiled = over_chains.lower(
            keys, jnp.zeros((self.chains, size)), jnp.zeros(size), jnp.zeros((size, size))
        ).compile()
        self.run(0)

    def run(self, seed: int) -> Array:
        """One fresh run, search of the start and warm-up included: β [mm, N, rad] and φ [mm], shape
        (chains, draws, p + h)."""
        import jax

        if self._compiled is None:
            self.prepare()
        compiled: Any = self._compiled
        centre, root = self.density.laplace() if self.whitened else self.density.start()
        starts = np.random.default_rng(seed).standard_normal((self.chains, len(centre)))
        draws = compiled(jax.random.split(jax.random.key(seed), self.chains), starts, centre, root)
        beta, free = self.density.split(centre + np.asarray(draws) @ root.T)
        return np.concatenate([beta, self.density.bound.hyper_prior.phi(free)], axis=-1)

    def _one_chain(self, key: Any, start: Any, centre: Any, root: Any) -> Any:
        """Warm up and draw at centre + root z, shape (draws, p + h)."""
        import jax
        from numpyro.infer import NUTS

        kernel = NUTS(
            potential_fn=lambda z: -self.density(centre + root @ z),
            dense_mass=not self.whitened,
            adapt_mass_matrix=not self.whitened,
            target_accept_prob=0.7,
        )
        state = kernel.init(key, self.warmup, start, (), {})
        state = jax.lax.fori_loop(
            0, self.warmup, lambda _, state: kernel.sample(state, (), {}), state
        )

        def draw(state: Any, _: Any) -> tuple[Any, Any]:
            state = kernel.sample(state, (), {})
            return state, state.z

        return jax.lax.scan(draw, state, None, length=self.draws)[1]


def nested_log_evidence(
    density: ReducedDensity, *, seed: int, live_points: int = 400, dlogz: float = 0.05
) -> tuple[float, float]:
    """ln p(y) by dynesty's nested sampling over β and φ (random walks within one ellipsoid), and
    its error.

    Live points come from independent Student t (4 degrees of freedom) about the mode of p(β, φ | y)
    in its own units, with L π / t as likelihood: the same integral as from the prior, far less to
    compress. With truncation ln ∫ L π 1_T − ln P(T).
    """
    import dynesty
    import jax

    bound, (mode, root), evaluate = density.bound, density.laplace(), jax.jit(density)
    freedom = 4.0
    size = len(mode)
    log_peak = gammaln((freedom + 1) / 2) - gammaln(freedom / 2) - 0.5 * np.log(freedom * np.pi)
    constant = np.log(np.diag(root)).sum() + np.log(bound.prior_sd).sum() - size * log_peak
    truncated = bound.truncation.active
    constant -= bound.log_prob_truncation_prior if truncated else 0.0

    def log_density(point: Array) -> float:
        x = mode + root @ point
        if truncated and not bound.truncation.holds(density.split(x[None])[0])[0]:
            return -np.inf
        return (
            float(evaluate(x))
            + constant
            + 0.5 * (freedom + 1) * float(np.log1p(point**2 / freedom).sum())
        )

    rng = np.random.default_rng(seed)
    sampler = dynesty.NestedSampler(
        log_density,
        lambda level: stdtrit(freedom, level),
        size,
        nlive=live_points,
        bound="single",
        sample="rwalk",
        rstate=rng,
    )
    sampler.run_nested(dlogz=dlogz, print_progress=False)
    return float(sampler.results["logz"][-1]), float(sampler.results["logzerr"][-1])


def bridged_log_evidence(bound: BoundModel, chain: Array, *, seed: int) -> tuple[float, float]:
    """ln p(y) by bridge sampling (Meng and Wong 1996) on draws (chains, draws, p + h) without
    truncation, and its error.

    The bridge leads to a normal distribution fitted to the first half of every chain; the second
    half is used. Error: relative, draws counted by their effective number (Frühwirth-Schnatter
    2004).
    """
    p = len(bound.names)
    half = chain.shape[1] // 2
    x = np.concatenate([chain[..., :p], bound.hyper_prior.free(chain[..., p:])], axis=2)
    fitted = x[:, :half].reshape(-1, x.shape[2])
    own = x[:, half:].reshape(-1, x.shape[2])
    mean = fitted.mean(axis=0)
    root = np.linalg.cholesky(np.cov(fitted.T))
    white = np.random.default_rng(seed).standard_normal(own.shape)

    def log_ratio(points: Array, standard: Array) -> Array:
        beta = points[:, :p]
        free = points[:, p:]
        target = bound.log_prior(beta) + bound.hyper_prior.log_density_of_free(free)
        target = target + bound.log_likelihood(bound.hyper_prior.phi(free), beta)
        return (
            target
            + 0.5 * (_LOG_2PI * x.shape[2] + (standard**2).sum(axis=1))
            + np.log(np.diag(root)).sum()
        )

    of_draws = log_ratio(own, np.linalg.solve(root, (own - mean).T).T)

    of_normal = log_ratio(mean + white @ root.T, white)
    shift = float(np.median(of_draws))
    drawn = np.exp(of_draws - shift)
    proposed = np.exp(of_normal - shift)
    ratio = 1.0
    effective = float(diagnose(of_draws.reshape(len(chain), -1, 1)).ess_bulk[0])
    share = effective / (effective + len(white))
    for _ in range(1000):
        before = ratio
        above = proposed / (share * proposed + (1 - share) * ratio)
        below = 1.0 / (share * drawn + (1 - share) * ratio)
        ratio = above.mean() / below.mean()
        if abs(np.log(ratio / before)) < 1e-10:
            break
    effective = float(diagnose(below.reshape(len(chain), -1, 1)).ess_bulk[0])
    variance = (
        above.var() / above.mean() ** 2 / len(above) + below.var() / below.mean() ** 2 / effective
    )
    return shift + float(np.log(ratio)), float(np.sqrt(variance))
