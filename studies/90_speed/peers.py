"""The peers of the speed study: the same posterior by NumPyro, by PyMC with nutpie, and its evidence by dynesty.

`ReducedNuts` is NumPyro's NUTS on p(β, φ | y) with the nuisances integrated out, from the 25 reduced numbers of every test:
the density the package's joint sampler sees, written again in JAX. `PlainNutpie` is the model written out in PyMC, all
readings and all latent nuisances, sampled by nutpie. `nested_log_evidence` is ln p(y) by dynesty's nested sampling.

Only public attributes of `BoundModel` are used. NumPyro, JAX, PyMC, nutpie and dynesty are imported where they are needed.
"""

from __future__ import annotations

import contextlib
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ldbb_bayes.errors import InputError
from ldbb_bayes.model.fourier import SIZE, basis
from ldbb_bayes.model.hybrid import BoundModel
from ldbb_bayes.model.terms import BasisNoise, Columns

__all__ = ["PlainNutpie", "ReducedDensity", "ReducedNuts", "check", "nested_log_evidence", "plain_model"]

Array = NDArray[Any]
ChainMethod = Literal["parallel", "vectorized", "sequential"]
Parametrisation = Literal["hierarchical", "centred", "noncentred"]
_LOG_2PI = float(np.log(2 * np.pi))


@dataclass(frozen=True, eq=False)
class _Nuisances:
    """All Gaussian latents of the reduced readings.

    ``values`` (tests, 25, q): columns, those of one test alone being zero elsewhere. Their sd is ``sd`` (q,) times component
    ``owner`` (q,) of (φ, 1). ``noise`` (h, 25): variance of the independent noise on the basis in units of φ².
    """

    values: Array
    sd: Array
    owner: Array
    noise: Array


def _nuisances(bound: BoundModel) -> _Nuisances:
    hypers, tests = bound.hyper_prior.names, len(bound.reduced)
    values, sd, owner = [np.zeros((tests, SIZE, 0))], [np.zeros(0)], [np.zeros(0, dtype=int)]
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
        owner.append(np.full(columns.shape[2], len(hypers) if term.hyper is None else hypers.index(term.hyper)))
    return _Nuisances(np.concatenate(values, axis=2), np.concatenate(sd), np.concatenate(owner), noise)


def _integrated() -> Callable[[Any, Any], Any]:
    """(M, b) → ½ bᵀ M⁻¹ b − ½ ln|M|: what Gaussian columns add once integrated out. Its gradient reuses the inverse root."""
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
        return -0.5 * cotangent * (inverse_root.T @ inverse_root + jnp.outer(solved, solved)), cotangent * solved

    integrated = jax.custom_vjp(lambda matrix, vector: forward(matrix, vector)[0])
    integrated.defvjp(forward, backward)
    return integrated


def _uniform_log_likelihood(bound: BoundModel) -> Callable[[Any, Any], Any]:
    """ln p(y | β, φ) for uniform circles as a function of β − centre and φ.

    The factor is diagonal, so that set-up shift and discrepancy are. Basis functions that a single column holds alone (form
    of high order) are scalars; the others meet in one Woodbury. Rows whose noise is the same function of φ share their Gram
    matrix, computed once.
    """
    import jax.numpy as jnp

    latent, tests = _nuisances(bound), len(bound.reduced)
    hypers = bound.hyper_prior.names
    sigma = hypers.index("sigma")
    factor = np.stack([np.diag(test.factor) for test in bound.reduced])
    projection = np.stack([np.asarray(test.projection) for test in bound.reduced])
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
    kinds, kind = np.unique(np.round(weight[:, main].reshape(len(rows), -1), 9), axis=0, return_inverse=True)
    count = np.bincount(kind).astype(float)
    gram = np.stack([(shared[kind == k].T @ shared[kind == k]).ravel() for k in range(len(kinds))])
    q = shared.shape[1]

    alone = np.flatnonzero(~main)
    none = latent.sd.size
    held = np.array([np.append(np.flatnonzero(touched[k]), none)[0] for k in alone], dtype=int)
    own_columns = np.concatenate([columns, np.zeros((tests, SIZE, 1))], axis=2)[:, alone, held]
    own_sd, own_owner = np.append(latent.sd, 0.0)[held], np.append(latent.owner, len(hypers))[held]
    flat = np.round(weight[:, alone].reshape(tests, -1), 9)
    own_kinds, own_kind = np.unique(flat, axis=0, return_inverse=True)
    own_weight = own_kinds.reshape(len(own_kinds), len(alone), len(hypers))
    own_count = np.bincount(own_kind).astype(float)[:, None]

    def by_kind(products: Array) -> Array:
        return np.stack([products[own_kind == k].sum(axis=0) for k in range(len(own_kinds))])

    square_rows = by_kind(residual[:, alone] ** 2)
    square_columns, crossed = by_kind(own_columns**2), by_kind(own_columns * residual[:, alone])

    readings = np.array([test.readings for test in bound.reduced])
    outside_ss, outside = float(sum(test.residual_ss for test in bound.reduced)), float((readings - SIZE).sum())
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
        apart = (own_count * jnp.log(own_variance) + square_rows / own_variance).sum() + (jnp.log(inflation) - explained).sum()
        return constant + together - 0.5 * (apart + outside * jnp.log(square[sigma]) + outside_ss / square[sigma])

    return log_likelihood


def _general_log_likelihood(bound: BoundModel) -> Callable[[Any, Any], Any]:
    """ln p(y | β, φ) for any sampling as a function of β − centre and φ: a dense covariance per test, then Woodbury."""
    import jax.numpy as jnp
    from jax.scipy.linalg import solve_triangular

    latent, tests = _nuisances(bound), len(bound.reduced)
    sigma = bound.hyper_prior.names.index("sigma")
    factor, projection = np.zeros((tests, SIZE, SIZE)), np.zeros((tests, SIZE))
    for r, test in enumerate(bound.reduced):
        factor[r, : len(test.factor)], projection[r, : len(test.factor)] = test.factor, np.asarray(test.projection)
    offset_rows = np.einsum("rik,rk->ri", factor, bound.interest @ bound.centre + bound.known_offset)
    rows, design, shared = projection - offset_rows, factor @ bound.interest, factor @ latent.values
    readings = np.array([test.readings for test in bound.reduced])
    outside_ss, outside = float(sum(test.residual_ss for test in bound.reduced)), float((readings - SIZE).sum())
    constant = -0.5 * _LOG_2PI * readings.sum()
    q = shared.shape[2]
    integrated = _integrated()

    def log_likelihood(offset: Any, phi: Any) -> Any:
        square = phi**2
        noise = factor * (square @ latent.noise) @ jnp.swapaxes(jnp.asarray(factor), 1, 2)
        sd = latent.sd * jnp.append(phi, 1.0)[latent.owner]
        log_root, matrix, vector, remainder = 0.0, jnp.eye(q), jnp.zeros(q), 0.0
        for r in range(tests):
            root = jnp.linalg.cholesky(noise[r] + square[sigma] * jnp.eye(SIZE))
            columns = solve_triangular(root, shared[r] * sd, lower=True)
            difference = solve_triangular(root, rows[r] - design[r] @ offset, lower=True)
            log_root = log_root + jnp.log(jnp.diag(root)).sum()
            matrix, vector = matrix + columns.T @ columns, vector + columns.T @ difference
            remainder = remainder + difference @ difference
        together = integrated(matrix, vector) - 0.5 * remainder
        return constant + together - log_root - 0.5 * (outside * jnp.log(square[sigma]) + outside_ss / square[sigma])

    return log_likelihood


class ReducedDensity:
    """ln p(y | β, φ) p(β) p(free coordinates of φ) in JAX; truncation left aside.

    x = ((β − centre) / prior sd, ln(φ − lower)), shape (p + h,).

    Parameters
    ----------
    bound : BoundModel
        With readings and proper priors.
    general : bool, optional
        Use the form that is right for any sampling; default: only where a test is not a uniform circle.

    Raises
    ------
    InputError
        For a flat prior.
    """

    def __init__(self, bound: BoundModel, *, general: bool | None = None) -> None:
        import jax

        if bound.model.prior.flat:
            raise InputError("the prior must be proper for a peer, got a flat one. Use the default preset.")
        jax.config.update("jax_enable_x64", True)
        self.bound = bound
        if general is None:
            general = not all(test.is_orthogonal for test in bound.reduced)
        self._log_likelihood = _general_log_likelihood(bound) if general else _uniform_log_likelihood(bound)
        hyper = bound.hyper_prior
        at_lower = hyper.log_density(hyper.lower_mm) + 0.5 * ((hyper.lower_mm / hyper.scale_mm) ** 2).sum()
        self._constant = float(at_lower - np.log(bound.prior_sd).sum() - 0.5 * _LOG_2PI * len(bound.names))
        self._second_order: Callable[[Any], Any] | None = None

    def __call__(self, x: Any) -> Any:
        """The log density at x, a scalar."""
        import jax.numpy as jnp

        bound, p = self.bound, len(self.bound.names)
        standard, free = x[:p], x[p:]
        phi = bound.hyper_prior.lower_mm + jnp.exp(free)
        beta_square = ((standard + bound.centre / bound.prior_sd) ** 2).sum()
        log_prior = free.sum() - 0.5 * (beta_square + ((phi / bound.hyper_prior.scale_mm) ** 2).sum())
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
            hessian = jax.lax.map(lambda direction: jax.jvp(gradient, (x,), (direction,))[1], jnp.eye(size))
            return self(x), gradient(x), hessian

        self._second_order = jax.jit(second_order).lower(jnp.zeros(size)).compile()

    def laplace(self) -> tuple[Array, Array]:
        """Mode, shape (p + h,), and root of the inverse curvature there, lower triangular, by damped Newton steps.

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
        """β by least squares and the prior median of φ, shape (p + h,), and the diagonal root of the curvatures there."""
        x = self._origin()
        curvature = np.diag(self._evaluate(x)[2])
        return x, np.diag(1.0 / np.sqrt(np.abs(curvature)))

    def _origin(self) -> Array:
        hyper = self.bound.hyper_prior
        return np.concatenate([np.zeros(len(self.bound.names)), hyper.free(hyper.quantile(np.full(len(hyper.names), 0.5)))])

    def _evaluate(self, x: Array) -> tuple[Array, Array, Array]:
        if self._second_order is None:
            self.prepare()
        evaluate: Any = self._second_order
        value, gradient, hessian = (np.asarray(part) for part in evaluate(x))
        return value, gradient, hessian


def check(bound: BoundModel, *, points: int = 24, seed: int = 1, general: bool | None = None, tolerance: float = 1e-6) -> float:
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

    density = ReducedDensity(bound, general=general)
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
        raise RuntimeError(f"the JAX density differs from the package's by {difference:.2g}, more than {tolerance:g}.")
    return difference


class ReducedNuts:
    """NumPyro's NUTS on the reduced posterior, the whole run one compiled function.

    ``prepare`` compiles; ``run`` finds where to start, warms up and draws. The kernel and its adaptation are NumPyro's own; its
    ``MCMC`` driver is left out because it traces and compiles again at every call.

    Parameters
    ----------
    bound : BoundModel
        With proper priors and without truncation.
    whitened : bool
        Sample in the coordinates of the Laplace approximation, starting from draws of it. Otherwise in coordinates of unit
        curvature at the least-squares estimate and the prior median of φ, starting there: NUTS finds the correlations.
    draws, chains : int
    warmup : int, optional
        Default: 200 whitened, 1000 otherwise.
    target_accept : float
    dense_mass, adapt_mass : bool, optional
        Mass matrix. Default: whitened, none and the step size alone is adapted; otherwise dense and adapted.
    chain_method : {"parallel", "vectorized", "sequential"}
        ``parallel``: one XLA host device per chain. They must be asked for before JAX is used for the first time; where they
        are fewer than chains, the chains are vectorized instead.
    general : bool, optional
        See `ReducedDensity`.

    Attributes
    ----------
    diagnostics : dict
        Of the last run: divergences, mean leapfrog steps per draw, mean step size.
    """

    def __init__(
        self,
        bound: BoundModel,
        *,
        whitened: bool = True,
        draws: int = 2000,
        chains: int = 4,
        warmup: int | None = None,
        target_accept: float = 0.7,
        dense_mass: bool | None = None,
        adapt_mass: bool | None = None,
        chain_method: ChainMethod = "parallel",
        general: bool | None = None,
    ) -> None:
        _refuse_truncation(bound)
        self.whitened, self.draws, self.chains = whitened, draws, chains
        self.warmup = warmup if warmup is not None else 200 if whitened else 1000
        self.target_accept = target_accept
        self.dense_mass = dense_mass if dense_mass is not None else not whitened
        self.adapt_mass = adapt_mass if adapt_mass is not None else not whitened
        self.chain_method: ChainMethod = self._ask_for_devices(chain_method)
        self.density = ReducedDensity(bound, general=general)
        self.diagnostics: dict[str, float] = {}
        self._compiled: Callable[..., Any] | None = None

    def prepare(self) -> float:
        """Compile, and return the seconds it took."""
        import jax
        import jax.numpy as jnp

        clock = time.perf_counter()
        self.density.prepare()
        size = len(self.density.bound.names) + len(self.density.bound.hyper_prior.names)
        keys = jax.random.split(jax.random.key(0), self.chains)
        shapes = (keys, jnp.zeros((self.chains, size)), jnp.zeros(size), jnp.zeros((size, size)))
        axes = (0, 0, None, None)
        if self.chain_method == "parallel":
            over_chains = jax.pmap(self._one_chain, in_axes=axes)
        elif self.chain_method == "vectorized":
            over_chains = jax.jit(jax.vmap(self._one_chain, in_axes=axes))
        else:
            over_chains = jax.jit(
                lambda keys, starts, centre, root: jax.lax.map(lambda own: self._one_chain(*own, centre, root), (keys, starts))
            )
        self._compiled = over_chains.lower(*shapes).compile()
        self._sample(np.random.default_rng(0), keys)
        return time.perf_counter() - clock

    def run(self, seed: int) -> tuple[Array, float]:
        """One fresh run.

        Returns
        -------
        chain : ndarray, shape (chains, draws, p + h)
            β [mm, N, rad] and φ [mm].
        seconds : float
            Search of the start and warm-up included, compilation excluded.
        """
        import jax

        if self._compiled is None:
            self.prepare()
        clock = time.perf_counter()
        keys = jax.random.split(jax.random.key(seed), self.chains)
        chain = self._sample(np.random.default_rng(seed), keys)
        return chain, time.perf_counter() - clock

    def _sample(self, rng: np.random.Generator, keys: Any) -> Array:
        compiled: Any = self._compiled
        centre, root = self.density.laplace() if self.whitened else self.density.start()
        starts = rng.standard_normal((self.chains, len(centre)))
        (draws, steps, diverging), step_size = compiled(keys, starts, centre, root)
        beta, free = self.density.split(centre + np.asarray(draws) @ root.T)
        self.diagnostics = {
            "divergences": float(np.asarray(diverging).sum()),
            "steps_per_draw": float(np.asarray(steps).mean()),
            "step_size": float(np.asarray(step_size).mean()),
        }
        return np.concatenate([beta, self.density.bound.hyper_prior.phi(free)], axis=-1)

    def _one_chain(self, key: Any, start: Any, centre: Any, root: Any) -> Any:
        """Warm up and draw at centre + root z: draws, leapfrog steps and divergences, and the step size."""
        import jax
        from numpyro.infer import NUTS

        kernel = NUTS(
            potential_fn=lambda z: -self.density(centre + root @ z),
            dense_mass=self.dense_mass,
            adapt_mass_matrix=self.adapt_mass,
            target_accept_prob=self.target_accept,
        )
        state = kernel.init(key, self.warmup, start, (), {})
        state = jax.lax.fori_loop(0, self.warmup, lambda _, state: kernel.sample(state, (), {}), state)

        def draw(state: Any, _: Any) -> tuple[Any, Any]:
            state = kernel.sample(state, (), {})
            return state, (state.z, state.num_steps, state.diverging)

        state, drawn = jax.lax.scan(draw, state, None, length=self.draws)
        return drawn, state.adapt_state.step_size

    def _ask_for_devices(self, chain_method: ChainMethod) -> ChainMethod:
        import jax

        if chain_method != "parallel":
            return chain_method
        with contextlib.suppress(RuntimeError):
            jax.config.update("jax_num_cpu_devices", self.chains)
        if jax.local_device_count() >= self.chains:
            return "parallel"
        warnings.warn("JAX was started with fewer devices than chains; chains are vectorized.", stacklevel=3)
        return "vectorized"


def plain_model(bound: BoundModel, *, parametrisation: Parametrisation = "hierarchical") -> tuple[Any, dict[str, Array]]:
    """The model as it stands, in PyMC: every reading is data, every nuisance a latent parameter.

    Parameters
    ----------
    bound : BoundModel
        With proper priors and without truncation.
    parametrisation : {"hierarchical", "centred", "noncentred"}
        ``hierarchical``: the 25 harmonics of every test are latent, scattered by set-up shift and discrepancy about what the
        shared parameters predict, and ball form is centred. ``centred``: ball form, shifts and discrepancies are latent with
        their own sd. ``noncentred``: all latents are standard normal.

    Returns
    -------
    model : pymc.Model
        β is ``beta``; φ has the names of the hyper-parameters.
    start : dict
        Initial values from least squares.

    Raises
    ------
    InputError
        For ``hierarchical`` without set-up shift or discrepancy: the harmonics would not scatter.
    """
    import pymc as pm
    import pytensor.tensor as pt

    _refuse_truncation(bound)
    by_name = {test.name: test for test in bound.campaign.tests}
    tests = [by_name[name] for name in bound.test_names]
    bases = [basis(test.angles_rad()) for test in tests]
    readings = [test.readings_mm() for test in tests]
    harmonics = np.stack([np.linalg.lstsq(b, y, rcond=None)[0] for b, y in zip(bases, readings, strict=True)])
    noise = [term for term in bound.nuisance_columns if isinstance(term, BasisNoise)]
    if parametrisation == "hierarchical" and not np.all(sum(term.sd for term in noise) > 0):
        raise InputError("hierarchical must have set-up shift and discrepancy, got a model without. Use centred.")

    hyper = bound.hyper_prior
    start: dict[str, Array] = {"beta_standard": bound.centre / bound.prior_sd}
    residual = np.concatenate([y - b @ a for b, y, a in zip(bases, readings, harmonics, strict=True)])
    sigma = hyper.names.index("sigma")
    start["sigma"] = np.asarray(max(residual.std(), 1.05 * hyper.lower_mm[sigma]))
    with pm.Model() as model:
        phi = {
            name: pm.TruncatedNormal(name, 0.0, scale, lower=lower) if lower > 0 else pm.HalfNormal(name, scale)
            for name, scale, lower in zip(hyper.names, hyper.scale_mm, hyper.lower_mm, strict=True)
        }
        standard = pm.Normal("beta_standard", 0.0, 1.0, shape=len(bound.names))
        beta = pm.Deterministic("beta", standard * bound.prior_sd)
        mean = _spread(bound.interest, beta) + bound.known_offset
        for term in bound.nuisance_columns:
            if isinstance(term, Columns):
                mean = mean + _latent_columns(term, phi, centred=parametrisation != "noncentred")
        if parametrisation == "hierarchical":
            sd = sum(term.sd * phi[term.hyper] for term in noise)
            mean = pm.Normal("harmonics", mean, sd, shape=harmonics.shape)
            start["harmonics"] = harmonics
        else:
            for term in noise:
                mean = mean + _latent_noise(term, phi[term.hyper], len(tests), centred=parametrisation == "centred")
        if all(np.array_equal(bases[0], own) for own in bases):
            pm.Normal("reading", pt.as_tensor(bases[0]) @ mean.T, phi["sigma"], observed=np.stack(readings, axis=1))
        else:
            means = pt.concatenate([pt.as_tensor(own) @ mean[r] for r, own in enumerate(bases)])
            pm.Normal("reading", means, phi["sigma"], observed=np.concatenate(readings))
    return model, start


def _spread(values: Array, coefficients: Any) -> Any:
    """Columns (tests, 25, q) times coefficients (q,), shape (tests, 25)."""
    import pytensor.tensor as pt

    tests, size, q = values.shape
    return (pt.as_tensor(values.reshape(tests * size, q)) @ coefficients).reshape((tests, size))


def _latent_columns(term: Columns, phi: dict[Any, Any], *, centred: bool) -> Any:
    """Contribution of one nuisance term with its latent coefficients, shape (tests, 25)."""
    import pymc as pm

    name = term.names[0].rstrip("0123456789").removesuffix("_cos")
    sd = term.sd if term.hyper is None else term.sd * phi[term.hyper]
    if term.private:
        tests = len(term.values)
        own = pm.Normal(f"{name}_standard", 0.0, 1.0, shape=(tests, len(term.names))) * sd
        return (own[:, None, :] * term.values).sum(axis=2)
    if centred and term.hyper is not None:
        return _spread(term.values, pm.Normal(name, 0.0, sd, shape=len(term.names)))
    return _spread(term.values, pm.Normal(f"{name}_standard", 0.0, 1.0, shape=len(term.names)) * sd)


def _latent_noise(term: BasisNoise, scale: Any, tests: int, *, centred: bool) -> Any:
    """Latent coefficients on the basis itself, separate for every test, shape (tests, 25)."""
    import pymc as pm

    used = np.flatnonzero(term.sd)
    sd, shape = term.sd[used] * scale, (tests, len(used))
    own = (
        pm.Normal(f"{term.hyper}_own", 0.0, sd, shape=shape)
        if centred
        else pm.Normal(f"{term.hyper}_own_standard", 0.0, 1.0, shape=shape) * sd
    )
    return own @ np.eye(SIZE)[used]


class PlainNutpie:
    """nutpie's NUTS on the model written out in PyMC.

    Parameters
    ----------
    bound : BoundModel
        With proper priors and without truncation.
    warmup, draws, chains, cores : int
    parametrisation : {"hierarchical", "centred", "noncentred"}
        See `plain_model`.
    low_rank : bool
        Let the mass matrix follow correlations (nutpie's low-rank modification), not variances alone.
    backend : {"numba", "jax"}
    target_accept : float
    max_depth : int

    Attributes
    ----------
    diagnostics : dict
        Of the last run: divergences, mean leapfrog steps per draw, leapfrog steps of the warm-up.
    """

    def __init__(
        self,
        bound: BoundModel,
        *,
        warmup: int = 400,
        draws: int = 2000,
        chains: int = 4,
        cores: int = 2,
        parametrisation: Parametrisation = "hierarchical",
        low_rank: bool = True,
        backend: Literal["numba", "jax"] = "numba",
        target_accept: float = 0.8,
        max_depth: int = 10,
    ) -> None:
        self.bound = bound
        self.warmup, self.draws, self.chains, self.cores = warmup, draws, chains, cores
        self.parametrisation, self.low_rank, self.backend = parametrisation, low_rank, backend
        self.target_accept, self.max_depth = target_accept, max_depth
        self.diagnostics: dict[str, float] = {}
        self._compiled: Any = None

    def prepare(self) -> float:
        """Build and compile the model, and return the seconds it took."""
        import nutpie

        clock = time.perf_counter()
        model, start = plain_model(self.bound, parametrisation=self.parametrisation)
        gradient = {"gradient_backend": "jax"} if self.backend == "jax" else {}
        self._compiled = nutpie.compile_pymc_model(
            model, backend=self.backend, initial_points=start, var_names=["beta", *self.bound.hyper_prior.names], **gradient
        )
        self._sample(seed=0, warmup=10, draws=5)
        return time.perf_counter() - clock

    def run(self, seed: int) -> tuple[Array, float]:
        """One fresh run.

        Returns
        -------
        chain : ndarray, shape (chains, draws, p + h)
            β [mm, N, rad] and φ [mm].
        seconds : float
            Warm-up included, compilation excluded.
        """
        if self._compiled is None:
            self.prepare()
        clock = time.perf_counter()
        trace = self._sample(seed=seed, warmup=self.warmup, draws=self.draws)
        hypers = [trace.posterior[name].values[..., None] for name in self.bound.hyper_prior.names]
        chain = np.concatenate([trace.posterior["beta"].values, *hypers], axis=-1)
        seconds = time.perf_counter() - clock
        self.diagnostics = {
            "divergences": float(trace.sample_stats["diverging"].values.sum()),
            "steps_per_draw": float(trace.sample_stats["n_steps"].values.mean()),
            "warmup_steps": float(trace.warmup_sample_stats["n_steps"].values.sum()),
        }
        return chain, seconds

    def _sample(self, *, seed: int, warmup: int, draws: int) -> Any:
        import nutpie

        return nutpie.sample(
            self._compiled,
            draws=draws,
            tune=warmup,
            chains=self.chains,
            cores=min(self.cores, self.chains),
            seed=seed,
            progress_bar=False,
            low_rank_modified_mass_matrix=self.low_rank,
            target_accept=self.target_accept,
            maxdepth=self.max_depth,
        )


def _refuse_truncation(bound: BoundModel) -> None:
    if bound.truncation.active:
        raise InputError('the model must be without truncation, got it on. Use HybridModel.without("truncation").')


def nested_log_evidence(
    bound: BoundModel,
    seed: int = 1,
    *,
    over: Literal["all", "hyper"] = "all",
    reference: Literal["laplace", "prior"] = "laplace",
    live_points: int = 400,
    dlogz: float = 0.05,
) -> tuple[float, float]:
    """ln p(y) by dynesty's nested sampling (random walks within one ellipsoid): no quadrature, no conjugacy in φ.

    Parameters
    ----------
    bound : BoundModel
        With proper priors. With truncation, ln ∫ L π 1_T − ln P(T | prior).
    over : {"all", "hyper"}
        ``all``: over β and φ, of ln p(y | β, φ). ``hyper``: over φ alone, of ln p(y | φ); refused with truncation.
    reference : {"laplace", "prior"}
        The density from which live points are drawn, ``over="all"`` only. ``prior``: β and φ from their priors, β in
        coordinates turned to the readings' principal axes. ``laplace``: independent Student t (4 degrees of freedom) about
        the mode of p(β, φ | y) in its own units, with L π / t as likelihood: the same integral, far less to compress.
    live_points : int
    dlogz : float
        Remaining evidence at which to stop.

    Returns
    -------
    log_z, log_z_err : float

    Raises
    ------
    InputError
        For a flat prior, or ``hyper`` with truncation.
    """
    import dynesty

    if bound.model.prior.flat:
        raise InputError("the evidence must have a proper prior, got a flat one. Use the default preset.")
    if over == "hyper":
        _refuse_truncation(bound)
        transform, log_density, size = _hyper_problem(bound)
    elif reference == "prior":
        transform, log_density, size = _prior_problem(bound)
    else:
        transform, log_density, size = _laplace_problem(bound)
    rng = np.random.default_rng(seed)
    sampler = dynesty.NestedSampler(log_density, transform, size, nlive=live_points, bound="single", sample="rwalk", rstate=rng)
    sampler.run_nested(dlogz=dlogz, print_progress=False)
    results = sampler.results
    return float(results["logz"][-1]), float(results["logzerr"][-1])


_Problem = tuple[Callable[[Array], Array], Callable[[Array], float], int]


def _hyper_problem(bound: BoundModel) -> _Problem:
    return bound.hyper_prior.quantile, lambda phi: float(bound.log_evidence(phi[None])[0]), len(bound.hyper_prior.names)


def _prior_problem(bound: BoundModel) -> _Problem:
    from scipy.special import ndtri

    p = len(bound.names)
    rows = np.concatenate([test.factor @ bound.interest[r] for r, test in enumerate(bound.reduced)]) * bound.prior_sd
    turn = bound.prior_sd[:, None] * np.linalg.svd(rows)[2].T

    def transform(level: Array) -> Array:
        return np.concatenate([turn @ ndtri(level[:p]), bound.hyper_prior.quantile(level[p:])])

    def log_density(point: Array) -> float:
        beta, phi = point[None, :p], point[None, p:]
        if bound.truncation.active and not bound.truncation.holds(beta)[0]:
            return -np.inf
        return float(bound.log_likelihood(phi, beta)[0]) - bound.log_prob_truncation_prior

    return transform, log_density, p + len(bound.hyper_prior.names)


def _laplace_problem(bound: BoundModel) -> _Problem:
    from scipy.special import gammaln, stdtrit

    density = ReducedDensity(bound)
    mode, root = density.laplace()
    freedom, size = 4.0, len(mode)
    log_peak = gammaln((freedom + 1) / 2) - gammaln(freedom / 2) - 0.5 * np.log(freedom * np.pi)
    log_volume = np.log(np.diag(root)).sum() + np.log(bound.prior_sd).sum()

    def log_density(point: Array) -> float:
        beta, free = density.split((mode + root @ point)[None])
        log_prior = float(bound.log_prior(beta)[0] + bound.hyper_prior.log_density_of_free(free)[0])
        if not np.isfinite(log_prior):
            return -np.inf
        log_reference = size * log_peak - 0.5 * (freedom + 1) * np.log1p(point**2 / freedom).sum()
        log_likelihood = float(bound.log_likelihood(bound.hyper_prior.phi(free), beta)[0])
        return log_prior + log_likelihood + log_volume - log_reference

    return lambda level: stdtrit(freedom, level), log_density, size
