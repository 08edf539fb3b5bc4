"""No-U-turn sampler (blackjax) in the coordinates of the posterior's Gaussian approximation.

All directions have similar scales in these coordinates, so the warm-up adapts only the step size. The library
blackjax needs only a log-density, and its state is an array that can be saved.

Source: Hoffman & Gelman, J. Mach. Learn. Res. 15, 1593 (2014).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from pamjax.errors import BadInput
from pamjax.infer.posterior.checkpoint import Arrays
from pamjax.infer.posterior.laplace import GaussianApproximation
from pamjax.infer.posterior.log_density import PosteriorDensity
from pamjax.infer.posterior.sampler import Sampler
from pamjax.jit import compile_on_call

_CHAIN_COUNT = 4
#: Draws that adapt the step size (as in Stan's first phase), and the target acceptance.
_WARMUP_DRAWS, _TARGET_ACCEPTANCE = 75, 0.8


@dataclass(frozen=True)
class NutsSampler(Sampler):
    """No-U-turn sampler. Its state has positions, step size, random key and the number of draws."""

    #: R̂ and ESS of independent chains suffice.
    needs_long_chain: ClassVar[bool] = False

    def draw_start(self, seed: int) -> Arrays:
        """Return chains after the warm-up, with their common step size."""
        keys = jax.random.split(jax.random.key(seed), 3)
        x = jax.random.normal(keys[0], (_CHAIN_COUNT, self.density.space.size))
        x, step = _run_warmup(self.density, self.gaussian, x, keys[1])
        # All chains have the median step size.
        return {
            "x": np.asarray(x),
            "step": np.median(np.asarray(step)),
            "key": np.asarray(jax.random.key_data(keys[2])),
            "n": np.array(0),
        }

    def advance(self, state: Arrays) -> tuple[Arrays, Arrays]:
        """Return `chunk` draws (n, chains, p) with their statistics, and the new state."""
        base = jax.random.wrap_key_data(jnp.asarray(state["key"]))
        # The key depends on the number of the draw, so chunks of any size give the same chain.
        keys = jax.vmap(jax.random.fold_in, (None, 0))(base, int(state["n"]) + jnp.arange(self.chunk))
        draws = _run_chains(
            self.density, self.gaussian, jnp.asarray(state["x"]), jnp.asarray(state["step"]), keys
        )
        draws = {name: np.asarray(v) for name, v in draws.items()}
        return draws, {**state, "x": draws["x"][-1], "n": state["n"] + self.chunk}


def _import_blackjax() -> Any:
    try:
        import blackjax
    except ImportError as error:
        remedy = "Run `pip install -e '.[nuts]'` in the folder of the pamjax repository."
        raise BadInput.from_rule("the sampler nuts needs blackjax", "no such package", "", remedy) from error
    return blackjax


def _build_log_density(density: PosteriorDensity, gaussian: GaussianApproximation):
    def value(x):
        # A finite value, because −∞ has no gradient; NUTS counts it as a divergence.
        return jnp.maximum(density(gaussian(x)), -1e30)

    return value


@compile_on_call
def _run_warmup(
    density: PosteriorDensity, gaussian: GaussianApproximation, x: Float[Array, "c p"], key: Array
) -> tuple[Array, Array]:
    """Return positions and step sizes after the warm-up."""
    blackjax = _import_blackjax()
    from blackjax.optimizers.dual_averaging import dual_averaging

    value, identity = _build_log_density(density, gaussian), jnp.ones(x.shape[1])
    kernel = blackjax.nuts.build_kernel()
    first, update, final = dual_averaging()

    def warm_up_chain(x, key):
        def draw(carry, key):
            state, average = carry
            step = jnp.exp(average.log_x)
            state, info = kernel(key, state, value, step, identity)
            return (state, update(average, _TARGET_ACCEPTANCE - info.acceptance_rate)), None

        start = (blackjax.nuts.init(x, value), first(0.5))
        (state, average), _ = jax.lax.scan(draw, start, jax.random.split(key, _WARMUP_DRAWS))
        return state.position, final(average)

    return jax.vmap(warm_up_chain)(x, jax.random.split(key, len(x)))


@compile_on_call
def _run_chains(
    density: PosteriorDensity, gaussian: GaussianApproximation, x: Array, step: Array, keys: Array
) -> dict[str, Array]:
    """Return one draw of every chain for each key, (n, chains, ...)."""
    blackjax = _import_blackjax()
    nuts = blackjax.nuts(_build_log_density(density, gaussian), step, jnp.ones(x.shape[1]))

    def draw(states, key):
        states, info = jax.vmap(nuts.step)(jax.random.split(key, len(x)), states)
        return states, {
            "x": states.position,
            "logp": states.logdensity,
            "accepted": info.acceptance_rate,
            "diverging": info.is_divergent,
            "steps": info.num_integration_steps,
        }

    _, draws = jax.lax.scan(draw, jax.vmap(nuts.init)(x), keys)
    return draws
