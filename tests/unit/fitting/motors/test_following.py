"""Motor speeds by written-out derivatives against the general integrator of nonlinear models."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.fitting.motors.following import MotorSpeedProblem
from rotorid.fitting.time.nonlinear import NonlinearProblem
from rotorid.fitting.time.output_error import TimeData
from rotorid.models.motor_speed import Operation, motor_speed_model
from rotorid.simulation.linear import Hold
from rotorid.simulation.nonlinear import Scheme

RNG = np.random.default_rng(0)
SAMPLES, MOTORS = 60, 3


def record(volts: bool) -> TimeData:
    outputs = 0.5 + 0.1 * RNG.normal(size=(MOTORS, SAMPLES)).cumsum(axis=1).clip(-3.0, 3.0)
    inputs = np.vstack([outputs, np.linspace(16.5, 14.5, SAMPLES)[None]]) if volts else outputs
    speeds = 1200.0 + 300.0 * RNG.normal(size=(MOTORS, SAMPLES))
    return TimeData(name="bench", inputs=inputs, outputs=speeds, sample_rate_hz=100.0, before=inputs[:, :1])


@pytest.mark.parametrize("hold", ["zero", "first"])
@pytest.mark.parametrize("volts", [None, 16.0])
@pytest.mark.parametrize("lead", [False, True])
@pytest.mark.parametrize("chosen", [(1, 2, 3), (2, 3)])
def test_residuals_and_derivatives_are_those_of_the_general_integrator(
    hold: Hold, volts: float | None, lead: bool, chosen: tuple[int, ...]
) -> None:
    model = motor_speed_model(MOTORS, Operation(output=0.5, speed=1200.0, slope=1500.0, volts=volts))
    model = model.select([f"motor_speed_{number}" for number in chosen])
    parameters = model.parameters.with_values(
        {"T_motor_up": 0.03, "T_motor_down": 0.05, "Omega_2": -400.0, "tau": 0.0134, "f_2": 1.03}
    )
    if lead:
        parameters = parameters.fix("tau", 0.0).free_again("tau_y").with_values({"tau_y": 0.004})
    whole = record(volts is not None)
    rows = [f"motor_{k}" for k in (1, 2, 3)] + ["battery_voltage"]
    flown = TimeData(
        name="bench",
        inputs=whole.inputs[[rows.index(name) for name in model.inputs]],
        outputs=whole.outputs[[number - 1 for number in chosen]],
        sample_rate_hz=whole.sample_rate_hz,
        before=whole.before[[rows.index(name) for name in model.inputs]],
    )
    posed = {"structure": model, "parameters": parameters, "records": (flown,), "scheme": Scheme(hold=hold)}
    own, general = MotorSpeedProblem(**posed), NonlinearProblem(**posed)
    residual, jacobian = own.residuals(own.start)
    expected, slopes = general.residuals(general.start)
    np.testing.assert_allclose(residual, expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(jacobian, slopes, rtol=1e-7, atol=1e-9 * np.abs(slopes).max())
