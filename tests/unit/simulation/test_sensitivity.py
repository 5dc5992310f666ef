"""Simulations with exact derivatives, against the simulation without and against differences of it."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.errors import ModelError
from rotorid.models.library import library_model
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.models.toml import from_toml
from rotorid.simulation.linear import Hold, simulate_linear
from rotorid.simulation.sensitivity import Motion, Slopes, stepped
from rotorid.typing import FloatArray

RATE_HZ = 200.0
EXACT = 1e-12
STEP = 1e-4
DIFFERENCED = 1e-6
"""Central differences with a relative step of 1e-4 are off by its square times the third derivative."""

TWO_LATE_OUTPUTS = from_toml(
    """
    name = "late"
    inputs = ["u"]
    states = ["x", "v"]
    equations = ["x' = v", "v' = -k*x - d*v + b*u"]
    outputs = ["x", "rate = v"]
    [delays]
    u = "tau"
    rate = "tau_rate"
    [parameters]
    k = { value = 30.0, unit = "1" }
    d = { value = 4.0, unit = "1" }
    b = { value = 9.0, unit = "1" }
    tau = { value = 0.0123, unit = "s" }
    tau_rate = { value = 0.0031, unit = "s" }
    """
)


def hover() -> LinearStructure:
    structure = library_model("hover.longitudinal")
    values = {"M_q": -3.0, "M_u": 1.0, "X_u": -0.25, "Z_w": -0.7, "M_pitch": 149.0, "X_pitch": -7.2, "Z_thrust": -13.8}
    parameters = structure.parameters.with_values({**values, "tau_pitch": 0.0371, "tau_thrust": 0.0395})
    return structure.condensed(parameters)


def run(
    structure: LinearStructure, parameters: ParameterSet, u: FloatArray, hold: Hold, *, biases: bool = False
) -> Motion:
    system, slopes = structure.matrices_and_jacobian(parameters.values, parameters.directions)
    shared = stepped(system, Slopes(*slopes), sample_rate_hz=RATE_HZ, hold=hold)
    return shared.motion(u, u[:, 0], biases=biases)


def simulated(structure: LinearStructure, parameters: ParameterSet, u: FloatArray, hold: Hold) -> FloatArray:
    system = structure.matrices(parameters.values)
    return simulate_linear(system, u, sample_rate_hz=RATE_HZ, before=u[:, 0], hold=hold).T


@pytest.mark.parametrize("hold", ["zero", "first"])
@pytest.mark.parametrize("structure", [hover(), TWO_LATE_OUTPUTS], ids=["hover", "late outputs"])
def test_outputs_are_exact_and_slopes_are_those_of_differences(structure: LinearStructure, hold: Hold) -> None:
    u = np.random.default_rng(0).standard_normal((len(structure.inputs), 150))
    parameters = structure.parameters
    got = run(structure, parameters, u, hold)
    exact = simulated(structure, parameters, u, hold)
    assert np.abs(got.outputs - exact).max() <= EXACT * np.abs(exact).max()
    slopes, theta = got.slopes(np.zeros(got.free.shape[2])), parameters.pack()
    for slot, name in enumerate(parameters.free):
        step = np.zeros_like(theta)
        # A delay must not cross a sample, where a held input has a corner.
        step[slot] = STEP * (1e-2 if name.startswith("tau") else max(abs(theta[slot]), 0.1))
        ahead, behind = (simulated(structure, parameters.unpack(theta + sign * step), u, hold) for sign in (1.0, -1.0))
        slope = (ahead - behind) / (2.0 * step[slot])
        assert np.abs(slopes[:, :, slot] - slope).max() <= DIFFERENCED * np.abs(slope).max() + EXACT, name


def test_free_and_biased_responses_are_those_of_the_simulation() -> None:
    structure = hover()
    order = len(structure.states)
    got = run(structure, structure.parameters, np.zeros((len(structure.inputs), 60)), "zero", biases=True)
    system = structure.matrices(structure.parameters.values)
    for state in range(order):
        unit = np.eye(order)[state]
        nothing = np.zeros((len(structure.inputs), 60))
        free = simulate_linear(system, nothing, sample_rate_hz=RATE_HZ, x0=unit).T
        biased = simulate_linear(system, nothing, sample_rate_hz=RATE_HZ, bias=unit).T
        assert np.allclose(got.free[:, :, state], free, rtol=0.0, atol=EXACT * np.abs(free).max())
        assert np.allclose(got.free[:, :, order + state], biased, rtol=0.0, atol=EXACT * np.abs(biased).max())


def test_outputs_of_two_delays_have_two_initial_states() -> None:
    got = run(TWO_LATE_OUTPUTS, TWO_LATE_OUTPUTS.parameters, np.zeros((1, 20)), "zero")
    assert got.free.shape == (20, 2, 4)
    assert not got.free[:, 1, :2].any()
    assert not got.free[:, 0, 2:].any()


def test_a_lag_of_zero_is_refused() -> None:
    lag = from_toml(
        """
        name = "lag"
        inputs = ["u"]
        states = ["x"]
        equations = ["T*x' = -x + u"]
        outputs = ["x"]
        [parameters.T]
        value = 0.0
        unit = "s"
        """
    )
    with pytest.raises(ModelError, match="lag is zero"):
        run(lag, lag.parameters, np.zeros((1, 5)), "zero")
