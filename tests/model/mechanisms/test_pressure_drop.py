"""A narrow line: the flow into the muscle reduces the pressure."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from pamjax.model.mechanisms.pressure_drop import PressureDrop
from tests.agreement import SOLVED, agree
from tests.model.mechanisms.triangle import one_run, past


def test_inner_pressure_is_lower_during_filling():
    # P − Z dV/dt with Z = 1e9 Pa s/m³: ±2 ml/s changes the pressure by ∓2 kPa.
    time = np.arange(9.0)
    for flow, inside in ((2e-6, 98e3), (-2e-6, 102e3)):
        filling = eqx.tree_at(
            lambda p: p.state.volume, past(np.full(9, 0.2), 1e5), 1e-4 + flow * jnp.asarray(time)
        )
        agree(PressureDrop(1e9).pressure(one_run(time), filling), inside, SOLVED)


def test_turbulent_drop_is_quadratic_in_the_flow():
    # K Q |Q| with K = 1e15 Pa s²/m⁶: ±2 ml/s changes the pressure by ∓4 kPa, ±4 ml/s by ∓16 kPa.
    time = np.arange(9.0)
    for flow, inside in ((2e-6, 96e3), (-2e-6, 104e3), (4e-6, 84e3)):
        filling = eqx.tree_at(
            lambda p: p.state.volume, past(np.full(9, 0.2), 1e5), 1e-4 + flow * jnp.asarray(time)
        )
        agree(PressureDrop(0.0, 1e15).pressure(one_run(time), filling), inside, SOLVED)


def test_turbulent_drop_of_a_gas_is_proportional_to_absolute_pressure():
    # K (1 + P / Pa) Q² with K = 1e15 Pa s²/m⁶ and Q = 2 ml/s: 4 kPa at 0, 8 kPa at one atmosphere of gauge.
    time = np.arange(9.0)
    for pressure, drop in ((0.0, 4e3), (101325.0, 8e3), (303975.0, 16e3)):
        filling = eqx.tree_at(
            lambda p: p.state.volume, past(np.full(9, 0.2), pressure), 1e-4 + 2e-6 * jnp.asarray(time)
        )
        gas = PressureDrop(0.0, 1e15, compressibility=1.0)
        agree(pressure - gas.pressure(one_run(time), filling), drop, SOLVED)
