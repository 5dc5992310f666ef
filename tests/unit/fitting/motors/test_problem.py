"""The equations of the motor chain: derivatives, invariances, exactness, and what is refused."""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.record import MotorRecord
from rotorid.errors import UsageError
from rotorid.fitting.motors.problem import Filter, MotorProblem
from rotorid.fitting.motors.speed import motor_speed
from rotorid.models.motors import Curve, motor_parameters
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

RATE_HZ = 100.0
LEVERS = np.array([[-0.2, 0.21, 0.2, -0.2], [0.2, -0.2, 0.22, -0.2], [1.0, 1.0, -1.0, -1.0]])
AXES = ("az", "weight", "p", "q", "r")
VALUES = {
    "m": 1.2,
    "c_0": 0.2,
    "c_1": 1.5,
    "c_2": 5.0,
    "I_xx": 0.015,
    "I_yy": 0.02,
    "kappa_per_I_zz": 0.8,
    "L_p": -1.0,
    "M_q": -2.0,
    "N_r": -0.5,
    "Z_w": -0.3,
    "T_motor": 0.04,
    "tau_gyro": 0.0137,
    "tau_accel": 0.006,
}
FILTERS: Mapping[str, Filter] = {
    "az": Filter(np.ones(1), 0.3),
    "weight": Filter(np.ones(1), 0.05),
    "p": Filter(np.array([1.0, -0.5, 0.1]), 0.02),
    "q": Filter(np.array([1.0, 0.3]), 0.03),
    "r": Filter(np.ones(1), 0.01),
}


def a_record(seed: int, samples: int = 60, *, velocity: bool = True) -> MotorRecord:
    rng = np.random.default_rng(seed)
    return MotorRecord(
        name=f"record {seed}",
        sample_rate_hz=RATE_HZ,
        outputs=rng.uniform(0.3, 0.8, (4, samples)),
        rates=rng.standard_normal((3, samples)),
        az=-9.81 + rng.standard_normal(samples),
        w=rng.standard_normal(samples) if velocity else np.zeros(0),
        strength=rng.uniform(0.8, 1.1, samples),
    )


def a_problem(known: Mapping[str, float], curve: Curve = "polynomial", **values: float) -> MotorProblem:
    parameters = motor_parameters(curve=curve, known=known)
    chosen = {name: value for name, value in (VALUES | values).items() if name in parameters.free}
    return MotorProblem(
        records=(a_record(0), a_record(1, 45)),
        levers=LEVERS,
        parameters=parameters.with_values(chosen),
        axes=AXES,
        filters=(FILTERS, {name: FILTERS[name] for name in ("az", "q", "r")}),
    )


KNOWN: Mapping[str, Mapping[str, float]] = {
    "mass": {"m": 1.2},
    "inertia and kappa": {"I_xx": 0.015, "kappa": 0.05},
    "thrust and inertia of yaw": {"c_2": 5.0, "I_zz": 0.03},
    "lag": {"m": 1.2, "T_motor": 0.04, "tau_gyro": 0.0},
}


@pytest.mark.parametrize("known", KNOWN.values(), ids=list(KNOWN))
@pytest.mark.parametrize("tau_gyro", [0.0, 0.0037, 0.0099999, 0.0100001, 0.0263])
def test_jacobian_is_that_of_finite_differences(known: Mapping[str, float], tau_gyro: float) -> None:
    problem = a_problem(known, tau_gyro=tau_gyro)
    theta = problem.parameters.pack()
    _, jacobian = problem.residuals(theta)
    for place, name in enumerate(problem.parameters.free):
        # One-sided to the right, where the delay stands on a kink; of second order.
        step = 1e-6 * max(abs(theta[place]), 1e-2)
        ahead = [problem.residuals(theta + number * step * np.eye(theta.size)[place])[0] for number in range(3)]
        if name == "tau_gyro" and tau_gyro == 0.0099999:
            continue  # The next sample is nearer than a step.
        difference = (-3.0 * ahead[0] + 4.0 * ahead[1] - ahead[2]) / (2.0 * step)
        size = np.max(np.abs(difference))
        np.testing.assert_allclose(jacobian[:, place], difference, atol=2e-6 * size, err_msg=name)


@pytest.mark.parametrize("curve", ["linear", "quadratic", "affine"])
def test_jacobian_of_every_curve(curve: Curve) -> None:
    problem = a_problem({"m": 1.2}, curve)
    theta = problem.parameters.pack()
    _, jacobian = problem.residuals(theta)
    rng = np.random.default_rng(3)
    direction = rng.standard_normal(theta.size) * np.maximum(np.abs(theta), 1e-2)
    ends = [problem.residuals(theta + sign * 1e-6 * direction)[0] for sign in (1.0, -1.0)]
    difference = (ends[0] - ends[1]) / 2e-6
    np.testing.assert_allclose(jacobian @ direction, difference, atol=1e-6 * np.max(np.abs(difference)))


def test_parts_are_the_residuals_axis_by_axis() -> None:
    problem = a_problem({"m": 1.2})
    theta = problem.parameters.pack()
    residual, jacobian = problem.residuals(theta)
    parts = problem.parts(theta)
    assert [len(part.residual) for part in parts] == [59, 1, 57, 58, 59, 44, 43, 44]
    np.testing.assert_array_equal(np.concatenate([part.residual[:, 0] for part in parts]), residual)
    np.testing.assert_array_equal(np.concatenate([part.slopes[:, 0] for part in parts]), jacobian)
    assert [part.unknown.shape[2] for part in parts] == [0, 0, 1, 1, 1, 0, 1, 1]
    for part in parts:
        np.testing.assert_allclose(np.einsum("nyk,nyk->k", part.unknown, part.unknown), 1.0)


def test_what_the_chain_itself_flies_is_explained_to_the_order_of_the_step() -> None:
    errors = [np.max(np.abs(_flown(steps)["p"])) for steps in (1, 2, 4)]
    ratios = np.array(errors[:-1]) / errors[1:]
    # Damping acts on the mean of both ends: increments are exact to the third order of the step.
    np.testing.assert_allclose(ratios, 8.0, rtol=0.25)


def _flown(finer: int) -> dict[str, FloatArray]:
    """Errors of a chain at its truth on a flight of smooth torque that was integrated much finer than it is sampled."""
    rate_hz, fine = RATE_HZ * finer, 200 // finer
    clock = np.arange(int(rate_hz)) / rate_hz
    wave = 0.1 * np.sin(2.0 * np.pi * clock)
    outputs = 0.5 + np.stack([-wave, wave, wave, -wave])
    held = np.repeat(outputs, fine, axis=1)
    values = {name: VALUES[name] for name in VALUES}
    short = 1.0 / (rate_hz * fine)
    motors = motor_speed(held, lag_s=values["T_motor"], delay_s=0.0, step_s=short)
    thrust = values["c_0"] * short + values["c_1"] * motors.first + values["c_2"] * motors.second
    rate = np.zeros(held.shape[1])
    for place, push in enumerate(LEVERS[0] @ thrust / values["I_xx"]):
        half = 0.5 * short * values["L_p"]
        rate[place + 1] = ((1.0 + half) * rate[place] + push) / (1.0 - half)
    record = MotorRecord(
        name="smooth",
        sample_rate_hz=rate_hz,
        outputs=outputs,
        rates=np.stack([rate[::fine], 0.0 * rate[::fine], 0.0 * rate[::fine]]),
        az=np.full(clock.size, -STANDARD_GRAVITY_M_S2),
    )
    parameters = motor_parameters(known={"m": 1.2}, axes=("p",))
    parameters = parameters.with_values({name: VALUES[name] for name in parameters.free} | {"tau_gyro": 0.0})
    problem = MotorProblem(records=(record,), levers=LEVERS, parameters=parameters, axes=("p",))
    (axis,) = problem.equations(parameters.pack())[0]
    return {"p": axis.measured - axis.predicted}


def test_the_order_of_the_motors_does_not_matter() -> None:
    problem = a_problem({"m": 1.2})
    order = [2, 0, 3, 1]
    turned = replace(
        problem,
        records=tuple(replace(record, outputs=record.outputs[order]) for record in problem.records),
        levers=LEVERS[:, order],
    )
    theta = problem.parameters.pack()
    for one, other in zip(problem.residuals(theta), turned.residuals(theta), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("factor", [0.001, 2.0])
def test_mass_scales_thrust_and_inertia(factor: float) -> None:
    problem, heavy = a_problem({"m": 1.2}), a_problem({"m": 1.2 * factor})
    scaled = {name: factor * VALUES[name] for name in ("c_0", "c_1", "c_2", "I_xx", "I_yy")}
    scaled["kappa_per_I_zz"] = VALUES["kappa_per_I_zz"] / factor
    heavy = heavy.with_parameters(heavy.parameters.with_values(scaled))
    one, _ = problem.residuals(problem.parameters.pack())
    other, _ = heavy.residuals(heavy.parameters.pack())
    np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-10)


def test_longer_levers_scale_inertia_alone() -> None:
    problem = a_problem({"m": 1.2})
    longer = replace(problem, levers=LEVERS * np.array([[2.0], [3.0], [1.0]]))
    scaled = longer.parameters.with_values({"I_xx": 2.0 * VALUES["I_xx"], "I_yy": 3.0 * VALUES["I_yy"]})
    one, _ = problem.residuals(problem.parameters.pack())
    other, _ = longer.residuals(scaled.pack())
    np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-10)


def test_a_weak_battery_is_a_weak_curve() -> None:
    record = replace(a_record(0), strength=np.full(60, 0.8))
    full = replace(record, strength=np.ones(60))
    problem = replace(a_problem({"m": 1.2}), records=(record,), filters=(FILTERS,))
    weak = problem.parameters.with_values({name: 0.8 * VALUES[name] for name in ("c_0", "c_1", "c_2")})
    one, _ = problem.residuals(problem.parameters.pack())
    other, _ = replace(problem, records=(full,)).residuals(weak.pack())
    np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-10)


def test_another_number_of_motors_is_refused() -> None:
    with pytest.raises(UsageError, match="record 0 has 4 motors; expected 6, as in the rotor layout"):
        MotorProblem(records=(a_record(0),), levers=np.ones((3, 6)), parameters=motor_parameters())
    with pytest.raises(UsageError, match="no records were given"):
        MotorProblem(records=(), levers=LEVERS, parameters=motor_parameters())


def test_problems_can_be_sent() -> None:
    problem = a_problem({"m": 1.2, "kappa": 0.05})
    again = pickle.loads(pickle.dumps(problem))
    theta = problem.parameters.pack()
    for one, other in zip(problem.residuals(theta), again.residuals(theta), strict=True):
        np.testing.assert_array_equal(one, other)
