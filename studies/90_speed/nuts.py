"""NumPyro's NUTS on the reduced posterior. NumPyro and JAX are imported where they are needed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from reduced_density import Laplace, ReducedDensity

from ldbb_bayes.errors import InputError
from ldbb_bayes.model.hybrid import BoundModel

__all__ = ["NUTS", "ReducedNuts"]

Array = NDArray[Any]
# Both ways to run it, and whether it samples in the coordinates of the Laplace approximation.
NUTS = {"NUTS, dense mass matrix": False, "NUTS, whitened by hand": True}


class ReducedNuts:
    """NumPyro's NUTS on the reduced posterior, four chains, the whole run one compiled function.

    ``prepare`` compiles; ``run`` finds where to start, warms up and draws. The kernel and its
    adaptation are NumPyro's; its ``MCMC`` driver is left out because it traces and compiles again
    at every call.

    Parameters
    ----------
    bound : BoundModel
        With proper priors and without truncation.
    whitened : bool
        Sample in the coordinates of the Laplace approximation, starting from draws of it, and adapt
        the step size only; the chains go side by side. Otherwise in coordinates of unit curvature
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
        self.warmup = 1000
        if whitened:
            self.warmup = 200
        self.density = ReducedDensity(bound)
        self._compiled: Callable[..., Any] | None = None

    def prepare(self) -> None:
        """Compile, and run once."""
        import jax
        import jax.numpy as jnp

        self.density.prepare()
        size = self.density.size
        keys = jax.random.split(jax.random.key(0), self.chains)
        starts = jnp.zeros((self.chains, size))

        def one_after_the_other(keys: Any, starts: Any, centre: Any, root: Any) -> Any:
            def one_chain(key_and_start: Any) -> Any:
                key, start = key_and_start
                return self._one_chain(key, start, centre, root)

            return jax.lax.map(one_chain, (keys, starts))

        if self.whitened:
            over_chains = jax.jit(jax.vmap(self._one_chain, in_axes=(0, 0, None, None)))
        else:
            over_chains = jax.jit(one_after_the_other)
        lowered = over_chains.lower(keys, starts, jnp.zeros(size), jnp.zeros((size, size)))
        self._compiled = lowered.compile()
        self.run(0)

    def run(self, seed: int) -> Array:
        """One fresh run, search of the start and warm-up included: β [mm, N, rad] and φ [mm], shape
        (chains, draws, p + h)."""
        import jax

        if self._compiled is None:
            self.prepare()
        compiled: Any = self._compiled
        centre, root = self._coordinates()
        starts = np.random.default_rng(seed).standard_normal((self.chains, len(centre)))
        keys = jax.random.split(jax.random.key(seed), self.chains)
        draws = compiled(keys, starts, centre, root)
        beta, free = self.density.split(centre + np.asarray(draws) @ root.T)
        return np.concatenate([beta, self.density.bound.hyper_prior.phi(free)], axis=-1)

    def _coordinates(self) -> Laplace:
        """The normal approximation in whose coordinates the chains go."""
        if self.whitened:
            return self.density.laplace()
        return self.density.start()

    def _one_chain(self, key: Any, start: Any, centre: Any, root: Any) -> Any:
        """Warm up and draw at centre + root z, shape (draws, p + h)."""
        import jax
        from numpyro.infer import NUTS as Kernel

        def potential(z: Any) -> Any:
            return -self.density(centre + root @ z)

        kernel = Kernel(
            potential_fn=potential,
            dense_mass=not self.whitened,
            adapt_mass_matrix=not self.whitened,
            target_accept_prob=0.7,
        )

        def warm_up(_: Any, state: Any) -> Any:
            return kernel.sample(state, (), {})

        def draw(state: Any, _: Any) -> tuple[Any, Any]:
            state = kernel.sample(state, (), {})
            return state, state.z

        state = kernel.init(key, self.warmup, start, (), {})
        state = jax.lax.fori_loop(0, self.warmup, warm_up, state)
        _, draws = jax.lax.scan(draw, state, None, length=self.draws)
        return draws
