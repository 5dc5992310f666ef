"""Start values that nobody has to type: known models, from parameters of zero and data with 3 % of noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.fitting.known_models import at_zero, posed

from rotorid.fitting.frequency.fit import fit_frequency
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.fitting.frequency.screening import without_structural_zeros
from rotorid.fitting.frequency.starts import (
    delay_grid_s,
    equation_error,
    equation_error_start,
    fraction_starts,
    own_starts,
    roles,
    start_values,
)
from rotorid.fitting.least_squares import LevenbergMarquardt, Outcome
from rotorid.models.library import library_model, transfer_function
from rotorid.models.parameter import ParameterSet
from rotorid.models.toml import from_toml
from rotorid.uncertainty.cramer_rao import bounds

# Published: System Identification of an S500 Quadrotor UAV, tables 4 and 7; Open-Loop Quadrotor Flight Dynamics
# Identification, table 2; the rig of Frequency-domain identification of a quadrotor.
LONGITUDINAL = {
    "M_q": 0.9, "M_u": 10.8, "M_w": 26.6, "X_q": -0.0805, "X_u": -0.25, "Z_u": 0.3558, "Z_w": 0.7,
    "M_pitch": 149.8, "X_pitch": -7.2, "Z_pitch": -5.7, "Z_thrust": -13.8, "tau_pitch": 0.037, "tau_thrust": 0.039,
}  # fmt: skip
LATERAL = {
    "L_r": -21.6, "L_v": -6.7, "N_p": 0.06, "N_r": -3.8, "Y_p": 0.11, "Y_v": -0.18, "L_roll": 153.4,
    "N_roll": -4.0, "Y_roll": 7.4, "N_yaw": 31.1, "tau_roll": 0.041, "tau_yaw": 0.041,
}  # fmt: skip
PITCH = {"M_pitch": 220.0, "M_u": 6.0, "X_u": -0.209, "z_imu": 0.0135, "tau_pitch": 0.0242, "tau_ax": 0.0337}
RIG = {"J_x": 0.047, "K_f": 0.109, "L": 0.197, "tau_3": 0.2279, "tau_4": 0.1770}
OUTPUTS = {
    "hover.longitudinal": ("q", "u", "w", "theta", "ax", "az"),
    "hover.lateral": ("p", "r", "v", "phi", "ay"),
    "axis.pitch": ("q", "ax"),
    "rig.roll": ("phi",),
}
NOISE = 0.03


def flown(
    name: str, truth: dict[str, float], *, motor_s: float = 0.0, band: tuple[float, float] = (1.0, 30.0)
) -> FrequencyProblem:
    """A library model of a published vehicle; what the publication leaves out is zero and free all the same."""
    structure = library_model(name).select(outputs=OUTPUTS[name])
    parameters = structure.parameters
    if not motor_s and "T_motor" in parameters.names:
        parameters = parameters.drop("T_motor")
    values = {name: truth.get(name, 0.0) for name in parameters.names} | {"T_motor": motor_s}
    problem = posed(structure, values, np.geomspace(*band, 50), parameters=parameters, noise=NOISE)
    return without_structural_zeros(problem)[0]


def assert_true(problem: FrequencyProblem, truth: dict[str, float]) -> None:
    """The fit ends at the truth, within five of the standard deviations that the noise of every point leaves."""
    solution = fit_frequency(problem)
    assert solution.outcome is Outcome.CONVERGED
    error = problem.data.random_error**2 * np.abs(problem.data.values) ** 2
    covariance = 2.0 * np.einsum("yuf,fg->yufg", error, np.eye(error.shape[-1]))
    spread = bounds(replace(problem, data=replace(problem.data, covariance=covariance)), solution).std
    for name, value, std in zip(problem.parameters.free, solution.theta, spread, strict=True):
        assert value == pytest.approx(truth.get(name, 0.0), abs=5.0 * std), name


@pytest.mark.parametrize(
    ("name", "truth", "motor_s"),
    [
        ("hover.longitudinal", LONGITUDINAL, 0.0),
        ("hover.longitudinal", LONGITUDINAL, 0.04),
        ("hover.lateral", LATERAL, 0.0),
        ("axis.pitch", PITCH, 0.0),
        ("axis.pitch", PITCH, 0.04),
    ],
)
@pytest.mark.parametrize("zeros", [True, False], ids=["from zeros", "from the library's values"])
def test_hover_models_are_found_from_no_start_at_all(
    name: str, truth: dict[str, float], motor_s: float, zeros: bool
) -> None:
    problem = flown(name, truth, motor_s=motor_s)
    start = at_zero(problem.parameters) if zeros else problem.parameters
    assert_true(problem.with_parameters(start), truth | {"T_motor": motor_s})


@pytest.mark.parametrize("band", [(0.3, 12.0), (0.3, 40.0)])
def test_delays_of_several_turns_are_found(band: tuple[float, float]) -> None:
    """At 40 rad/s a delay of 0.23 s is a turn and a half, and the wrapped phase has a minimum for each turn."""
    problem = flown("rig.roll", RIG, band=band)
    parameters = problem.parameters.fix("J_x", RIG["J_x"]).with_values({"tau_3": 0.0, "tau_4": 0.0, "K_f": 0.01})
    plain = ParameterSet(replace(one, starts=()) for one in parameters)
    assert_true(problem.with_parameters(plain), RIG)


@pytest.mark.parametrize(
    ("poles", "zeros", "gain", "delay"),
    [
        ([-2.0], [], 60.0, 0.02),
        ([-2 + 3j, -2 - 3j], [-5.0], 40.0, 0.03),
        ([1.8 + 3.5j, 1.8 - 3.5j, -3.9], [-0.2, 0.0], 150.0, 0.04),
        ([1.8 + 3.5j, 1.8 - 3.5j, -3.9, -25.0], [-0.2, -0.1], 3000.0, 0.04),
        ([-1 + 8j, -1 - 8j, -3.9, -25.0], [-0.5, -6.0, -2 + 20j, -2 - 20j], 3.0, 0.015),
    ],
)
def test_transfer_functions_are_found_from_zeros(
    poles: list[complex], zeros: list[complex], gain: float, delay: float
) -> None:
    structure = transfer_function(numerator=len(zeros), denominator=len(poles))
    numerator, denominator = gain * np.atleast_1d(np.poly(zeros))[::-1].real, np.poly(poles)[::-1].real
    truth = {f"b{k}": float(value) for k, value in enumerate(numerator)} | {"tau": delay}
    truth |= {f"a{k}": float(value) for k, value in enumerate(denominator[:-1])}
    problem = posed(structure, truth, np.geomspace(0.5, 60.0, 80), noise=NOISE)
    assert_true(problem.with_parameters(at_zero(structure.parameters)), truth)


def test_shared_denominators_are_found_from_zeros() -> None:
    structure = transfer_function(numerator=1, denominator=2, inputs=["a", "b"], outputs=["p", "q"])
    rng = np.random.default_rng(3)
    truth = {name: float(rng.uniform(10.0, 60.0)) for name in structure.parameters.names}
    truth |= {"a0": 13.0, "a1": 4.0, "tau_a": 0.05, "tau_b": 0.01}
    problem = posed(structure, truth, np.geomspace(0.5, 60.0, 60), noise=NOISE)
    assert_true(problem.with_parameters(at_zero(structure.parameters)), truth)


def test_equation_error_is_exact_on_exact_responses() -> None:
    """Every equation holds for the states that the outputs show: the parameters come back to rounding."""
    structure = library_model("hover.longitudinal").select(outputs=OUTPUTS["hover.longitudinal"])
    parameters = at_zero(structure.parameters.drop("T_motor"))
    values = {name: LONGITUDINAL.get(name, 0.0) for name in parameters.names}
    problem = posed(structure, values, np.geomspace(1.0, 30.0, 40), parameters=parameters)
    late = parameters.with_values({"tau_pitch": 0.037, "tau_thrust": 0.039})
    role = roles(problem, late.pack())
    assert role is not None
    (theta,), (misfit,) = equation_error(problem, late.pack()[None], role)
    truth = np.array([LONGITUDINAL.get(name, 0.0) for name in parameters.free])
    np.testing.assert_allclose(theta, truth, rtol=1e-7, atol=1e-7)
    assert misfit < 1e-12


def test_many_parameters_at_once_are_each_on_its_own() -> None:
    """Delays and lags of a grid, the last of them below its bound, where the model has no value."""
    problem = flown("hover.longitudinal", LONGITUDINAL, motor_s=0.04)
    role = roles(problem, problem.parameters.pack())
    assert role is not None
    free = problem.parameters.free
    thetas = np.tile(problem.parameters.pack(), (4, 1))
    thetas[:, free.index("tau_pitch")] = [0.0, 0.02, 0.05, 0.02]
    thetas[:, free.index("T_motor")] = [0.03, 0.03, 0.1, -0.1]
    found, misfit = equation_error(problem, thetas, role)
    for row, theta in enumerate(thetas):
        (alone,), (left,) = equation_error(problem, theta[None], role)
        np.testing.assert_allclose(found[row], alone, rtol=1e-9, atol=1e-12)
        assert misfit[row] == pytest.approx(left, rel=1e-9)
    assert np.isfinite(misfit).tolist() == [True, True, True, False]


def test_levy_s_step_is_exact_on_exact_responses() -> None:
    """Linear in the coefficients: with the delay known, the first step ends at the truth."""
    structure = transfer_function(numerator=1, denominator=2)
    truth = {"b0": 200.0, "b1": 40.0, "a0": 13.0, "a1": 4.0, "tau": 0.03}
    problem = posed(structure, truth, np.geomspace(0.5, 60.0, 40))
    start = np.array([0.03 if name == "tau" else 0.0 for name in problem.parameters.free])
    (theta,) = fraction_starts(problem, start[None])
    np.testing.assert_allclose(theta, [truth[name] for name in problem.parameters.free], rtol=1e-8)


def test_delays_are_tried_close_enough_for_their_phase() -> None:
    problem = flown("rig.roll", RIG, band=(0.3, 40.0))
    assert np.diff(delay_grid_s(problem)).max() <= 0.5 / 40.0 + 1e-12
    assert delay_grid_s(problem)[-1] >= 0.3


def test_starts_differ_and_are_the_same_every_time() -> None:
    problem = flown("hover.lateral", LATERAL)
    once, again = start_values(problem, count=4), start_values(problem, count=4)
    assert len(once) == 4
    for one, other in zip(once, again, strict=True):
        np.testing.assert_array_equal(one, other)
    costs = problem.many_costs(np.array(once))
    assert list(costs) == sorted(costs)
    for k, one in enumerate(once):
        for other in once[:k]:
            assert np.any(np.abs(one - other) > 0.04 * np.abs(one))


def test_own_values_that_mean_nothing_are_no_start() -> None:
    problem = flown("hover.longitudinal", LONGITUDINAL)
    assert own_starts(problem.with_parameters(at_zero(problem.parameters))) == ()
    near = problem.parameters.with_values({name: 1.1 * LONGITUDINAL.get(name, 0.0) for name in problem.parameters.free})
    (start,) = own_starts(problem.with_parameters(near))
    np.testing.assert_array_equal(start, near.pack())


ODD = """
name = "odd"
inputs = ["a"]
states = ["x", "y"]
outputs = ["p"]
F = [["k", "k"], [0, "c*k"]]
G = [["k"], [1]]
H0 = [["c", "k"]]
[parameters.k]
value = 0.0
[parameters.c]
value = 0.0
"""


def test_structures_that_no_way_suits_are_searched_all_the_same() -> None:
    structure = from_toml(ODD)
    problem = posed(structure, {"k": -2.0, "c": 3.0}, np.geomspace(0.5, 20.0, 30))
    assert start_values(problem)
    solution = fit_frequency(problem, count=6)
    assert np.isfinite(solution.cost)
    nothing = problem.with_parameters(problem.parameters.fix("k", -2.0).fix("c", 3.0))
    assert fit_frequency(nothing).cost == pytest.approx(0.0, abs=1e-12)
    assert equation_error_start(nothing) is None


def test_a_start_from_the_data_is_close() -> None:
    problem = flown("hover.longitudinal", LONGITUDINAL)
    start = equation_error_start(problem.with_parameters(at_zero(problem.parameters)))
    assert start is not None
    solution = LevenbergMarquardt().minimize(problem.residuals, start, *problem.box)
    assert solution.evaluations <= 10
