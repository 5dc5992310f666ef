"""Nonlinear time responses against exact ones, against adaptive integrators, and against their own differences."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
import pytest

from rotorid.errors import UsageError
from rotorid.models.equations import structure_from_equations
from rotorid.models.library import nonlinear_model
from rotorid.models.nonlinear import NonlinearStructure, nonlinear_structure
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.simulation.linear import simulate_linear
from rotorid.simulation.nonlinear import (
    METHODS,
    AdaptiveMethod,
    Scheme,
    nonlinear_sensitivities,
    simulate_adaptive,
    simulate_nonlinear,
)

Hold = Literal["zero", "first"]
HOLDS: tuple[Hold, ...] = ("zero", "first")
RATE_HZ = 20.0

# Every function and operation of the language, two late inputs of which one acts nonlinearly, and a direct path. The
# speed stays below four: a kink would cost the methods their order, and the differences theirs.
EQUATIONS = (
    "x' = -a*x + sin(b*v)*exp(-x**2)/2 + u",
    "v' = -sqrt(1 + x**2)*v - k*abs(v - 4)*v/4 + cos(w)*tan(b*w/4) + x**3 - log(2 + x**2) + sign(a)*u*w",
)
OUTPUTS = ("x", "a_v = v'", "mixed = x*v + u*w")
VALUES = {"a": 2.0, "b": 1.5, "k": 0.7, "tau_u": 0.021, "tau_w": 0.063}


def busy_model() -> NonlinearStructure:
    return nonlinear_structure(
        name="busy",
        inputs=["u", "w"],
        states=["x", "v"],
        equations=EQUATIONS,
        outputs=OUTPUTS,
        delays={"u": "tau_u", "w": "tau_w"},
        parameters=ParameterSet(Parameter(name=name, value=value, unit="1") for name, value in VALUES.items()),
    )


def steps(seed: int, inputs: int, samples: int, *, every: int = 3) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.repeat(rng.standard_normal((inputs, -(-samples // every))), every, axis=1)[:, :samples]


@pytest.mark.parametrize("hold", HOLDS)
@pytest.mark.parametrize("delay_s", [0.0, 0.013, 0.05, 0.1287])
def test_a_linear_model_responds_as_its_exact_discretization(hold: Hold, delay_s: float) -> None:
    equations = ["x' = -3*x + 2*z + u", "z' = -x - z"]
    parameters = ParameterSet([Parameter(name="tau", value=delay_s, unit="s")])
    said = {"inputs": ["u"], "states": ["x", "z"], "outputs": ["x", "z"], "delays": {"u": "tau"}}
    linear = structure_from_equations(name="linear", equations=equations, parameters=parameters, **said)
    same = nonlinear_structure(name="same", equations=equations, parameters=parameters, **said)
    u, x0, before = steps(1, 1, 60), np.array([0.3, -0.2]), np.array([0.7])
    exact = simulate_linear(
        linear.matrices(parameters.values), u, sample_rate_hz=RATE_HZ, x0=x0, before=before, hold=hold
    )
    scheme = Scheme(method="rk45", substeps=64, hold=hold)
    found = simulate_nonlinear(same, parameters.values, u, sample_rate_hz=RATE_HZ, x0=x0, before=before, scheme=scheme)
    # A step of 1/1280 s times rates of 3 1/s: errors of the fifth order are (3/1280)^5 = 7e-14.
    assert np.abs(found - exact).max() < 1e-12
    past = steps(2, 1, 9)
    exact = simulate_linear(linear.matrices(parameters.values), u, sample_rate_hz=RATE_HZ, before=past, hold=hold)
    found = simulate_nonlinear(same, parameters.values, u, sample_rate_hz=RATE_HZ, before=past, scheme=scheme)
    assert np.abs(found - exact).max() < 1e-12


@pytest.mark.parametrize("hold", HOLDS)
@pytest.mark.parametrize("method", METHODS)
def test_the_error_falls_with_the_order_of_the_method(method: str, hold: Hold) -> None:
    model, u, rate_hz, start = busy_model(), steps(2, 2, 30), 5.0, np.array([0.2, 0.4])
    # Corners at half and quarter samples, so that twice the substeps are half the step in every piece.
    values = VALUES | {"tau_u": 0.5 / rate_hz, "tau_w": 1.25 / rate_hz}
    truth = simulate_adaptive(
        model, values, u, sample_rate_hz=rate_hz, x0=start, hold=hold, relative=1e-13, absolute=1e-14
    )

    def error(substeps: int) -> float:
        scheme = Scheme(method=method, substeps=substeps, hold=hold)
        found = simulate_nonlinear(model, values, u, sample_rate_hz=rate_hz, x0=start, scheme=scheme)
        return float(np.sqrt(np.mean((found - truth) ** 2)))

    slope = np.log2(error(16) / error(32))
    assert slope == pytest.approx(METHODS[method].order, abs=0.15)


@pytest.mark.parametrize("method", ["rk23", "rk45", "dop853", "radau", "bdf", "lsoda"])
def test_all_adaptive_integrators_agree(method: AdaptiveMethod) -> None:
    model, u = busy_model(), steps(3, 2, 12)
    truth = simulate_adaptive(model, VALUES, u, sample_rate_hz=RATE_HZ)
    found = simulate_adaptive(model, VALUES, u, sample_rate_hz=RATE_HZ, method=method, relative=1e-7, absolute=1e-9)
    # Tolerances hold for each of 36 pieces; errors of a stable model add up at most.
    assert np.abs(found - truth).max() < 36 * 1e-6


def differences(function: Callable[[np.ndarray], np.ndarray], theta: np.ndarray, step: float) -> np.ndarray:
    """Central differences of the sixth order, which leave some 1e-12 of truncation and rounding for a step of 1e-3."""
    columns = []
    for move in step * np.eye(theta.size):
        three, two, one = (function(theta + n * move) - function(theta - n * move) for n in (3, 2, 1))
        columns.append((three - 9.0 * two + 45.0 * one) / (60.0 * step))
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("hold", HOLDS)
@pytest.mark.parametrize("method", METHODS)
def test_sensitivities_are_the_derivatives_of_the_simulation(method: str, hold: Hold) -> None:
    model, u, before = busy_model(), steps(4, 2, 25, every=1), np.array([0.4, -0.3])
    scheme = Scheme(method=method, substeps=2, hold=hold)
    count, order = len(model.parameters), len(model.states)
    start = np.array([0.2, 0.4])

    def simulate(theta: np.ndarray) -> np.ndarray:
        values = dict(zip(model.parameters.names, theta[:count], strict=True))
        return simulate_nonlinear(
            model, values, u, sample_rate_hz=RATE_HZ, x0=theta[count:], before=before, scheme=scheme
        ).T

    theta = np.concatenate([model.parameters.pack(), start])
    found = nonlinear_sensitivities(
        model,
        model.parameters.values,
        u,
        sample_rate_hz=RATE_HZ,
        x0=start,
        before=before,
        directions=np.eye(count, count + order),
        start_directions=np.eye(order, count + order, count),
        scheme=scheme,
    )
    assert np.abs(found.outputs - simulate(theta)).max() < 1e-13
    expected = differences(simulate, theta, 1e-3)
    assert np.abs(found.slopes - expected).max() < 1e-8 * np.abs(expected).max()


def test_inputs_with_one_delay_each_move_by_it() -> None:
    """Corners that coincide leave no room between them, and still move apart."""
    model = busy_model()
    values = VALUES | {"tau_u": 0.05, "tau_w": 0.05}
    u, width = steps(5, 2, 20), len(values)
    found = nonlinear_sensitivities(
        model,
        values,
        u,
        sample_rate_hz=RATE_HZ,
        x0=np.zeros(2),
        before=np.zeros(2),
        directions=np.eye(width),
        start_directions=np.zeros((2, width)),
        scheme=Scheme(),
    )
    both = found.slopes[..., -2:].sum(axis=2)

    def later(delay_s: float) -> np.ndarray:
        return simulate_nonlinear(model, values | {"tau_u": delay_s, "tau_w": delay_s}, u, sample_rate_hz=RATE_HZ).T

    # Derivatives at a whole sample are those of a longer delay; an output with a direct path jumps there.
    step = 1e-6
    forward = (4.0 * later(0.05 + step) - later(0.05 + 2.0 * step) - 3.0 * later(0.05)) / (2.0 * step)
    assert np.abs(both - forward)[:, 0].max() < 1e-6 * np.abs(forward[:, 0]).max()


def test_an_early_input_is_one_with_a_negative_delay() -> None:
    model, u = busy_model(), steps(6, 2, 40)
    shifted = np.hstack([u[:, 2:], u[:, -1:], u[:, -1:]])
    early = simulate_nonlinear(model, VALUES | {"tau_u": -0.1, "tau_w": -0.1}, u, sample_rate_hz=RATE_HZ)
    at_once = simulate_nonlinear(model, VALUES | {"tau_u": 0.0, "tau_w": 0.0}, shifted, sample_rate_hz=RATE_HZ)
    assert np.array_equal(early, at_once)


def test_a_state_without_values_is_no_error() -> None:
    root = nonlinear_structure(
        name="root", inputs=[], states=["x"], equations=["x' = -sqrt(x)"], outputs=["x"], parameters=ParameterSet(())
    )
    x = simulate_nonlinear(root, {}, np.zeros((0, 60)), sample_rate_hz=RATE_HZ, x0=np.array([1.0]))
    assert np.isfinite(x[0, :20]).all()
    assert np.isnan(x[0, -1])


def test_a_flight_is_fast_enough_to_be_fitted() -> None:
    """Not a stopwatch: the number of operations for every stage of a step, on which the time depends."""
    dynamics = nonlinear_model("flight.first_order").dynamics
    assert len(dynamics.tape.operations) - dynamics.tape.settled <= 200
    assert len(dynamics.slopes) <= 45


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"u": np.zeros((1, 5))}, "inputs have shape (1, 5)"),
        ({"u": np.full((2, 5), np.nan)}, "not finite"),
        ({"x0": np.zeros(3)}, "x0 has shape (3,)"),
        ({"before": np.zeros(1)}, "before has shape (1,)"),
    ],
)
def test_wrong_shapes_are_named(change: dict[str, np.ndarray], message: str) -> None:
    given = {"u": np.zeros((2, 5)), **change}
    with pytest.raises(UsageError) as error:
        simulate_nonlinear(busy_model(), VALUES, given.pop("u"), sample_rate_hz=RATE_HZ, **given)
    assert message in str(error.value)


def test_an_unknown_method_suggests_the_nearest() -> None:
    with pytest.raises(UsageError, match="did you mean rk4"):
        Scheme(method="rk5")
    with pytest.raises(UsageError, match="one or more"):
        Scheme(substeps=0)
    with pytest.raises(UsageError, match="did you mean radau"):
        simulate_adaptive(busy_model(), VALUES, np.zeros((2, 3)), sample_rate_hz=RATE_HZ, method="rado")  # type: ignore[arg-type]
