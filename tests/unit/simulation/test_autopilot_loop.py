"""The cascade of the simulated autopilots: rate loops against their frequency response, and the mixer at its limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.unit.simulation import craft

from rotorid.autopilots.thrust import Linearization
from rotorid.models.controller import RateController
from rotorid.models.rotors import library_layout
from rotorid.simulation import flight_kernels
from rotorid.simulation import multirotor as logged
from rotorid.simulation.autopilot import Autopilot, RateLoop
from rotorid.simulation.hover_flight import OUTPUTS
from rotorid.simulation.linearization import feedback_of
from rotorid.simulation.multirotor import Control
from rotorid.typing import FloatArray


def controls(autopilot: Autopilot) -> Control:
    return autopilot.control(craft.vehicle(), substeps=1)


def commanded(autopilot: Autopilot, omega: float, *, turns: int = 3) -> complex:
    """What the pitch command makes of a rate of one at a frequency, the angle being its integral."""
    control = controls(autopilot)
    samples = round(2.0 * math.pi / omega * autopilot.rate_hz)
    omega = 2.0 * math.pi * autopilot.rate_hz / samples
    settled = math.ceil(3.0 * autopilot.rate_hz / samples)
    phase = omega * np.arange((turns + settled) * samples) / autopilot.rate_hz
    size = 1e-3
    rates, angles = size * np.cos(phase), size * np.sin(phase) / omega
    row, memory = np.zeros(logged.MOTORS + 4), np.zeros((7, 3))
    asked, commands = np.zeros(16), np.empty(phase.size)
    for k in range(phase.size):
        row[logged.RATE + 1] = rates[k]
        row[logged.RATE_SETPOINT + 1] = -autopilot.angle_1_s[1] * angles[k]
        flight_kernels._rates(row, asked, memory, k == 0, control)
        commands[k] = row[logged.COMMAND + 1]
    last = slice(-turns * samples, None)
    return complex(2.0 * np.mean(commands[last] * np.exp(-1j * phase[last])) / size)


@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
@pytest.mark.parametrize("omega", [2.0, 7.0, 20.0])
def test_rate_loops_are_their_frequency_response(kind: str, omega: float) -> None:
    its = kind == "ardupilot"
    rates = RateLoop(
        proportional=(0.12, 0.13, 0.25),
        integral=(0.15, 0.2, 0.1),
        derivative=(0.003, 0.004, 0.0),
        derivative_of_error=its,
        derivative_cutoff_hz=(20.0, 25.0, 0.0),
        error_cutoff_hz=(0.0, 30.0 if its else 0.0, 0.0),
        target_cutoff_hz=(0.0, 15.0 if its else 0.0, 0.0),
        command_cutoff_hz=(0.0, 0.0 if its else 40.0, 0.0),
    )
    autopilot = craft.autopilot("simple", rates=rates, gyro_cutoff_hz=0.0, rate_hz=2000.0)
    controller = RateController(
        proportional_s=0.13,
        integral=0.2,
        derivative_s2=0.004,
        angle_1_s=autopilot.angle_1_s[1],
        derivative_of_error=its,
        derivative_cutoff_hz=25.0,
        error_cutoff_hz=rates.error_cutoff_hz[1],
        target_cutoff_hz=rates.target_cutoff_hz[1],
        command_cutoff_hz=rates.command_cutoff_hz[1],
    )
    found = commanded(autopilot, omega)
    omega = 2.0 * math.pi * autopilot.rate_hz / round(2.0 * math.pi / omega * autopilot.rate_hz)
    wanted = -complex(controller.response(np.array([omega]))[0])
    # Differences and sums of a digital loop are half a turn late; nothing else is of first order.
    assert abs(found - wanted) < 0.6 * omega / autopilot.rate_hz * abs(wanted)
    feedback = feedback_of(autopilot).response(np.array([omega]))[1, :, 0]
    linear = feedback[OUTPUTS.index("q")] + feedback[OUTPUTS.index("theta")] / (1j * omega)
    # With that in the continuous model too, the second order is left, of the fastest time constant of 4 ms.
    fastest = 2.0 * math.pi * 40.0
    assert abs(found - linear) < omega * max(omega, fastest) / autopilot.rate_hz**2 * abs(wanted)


def mixed(autopilot: Autopilot, commands: tuple[float, ...]) -> tuple[FloatArray, int]:
    """Outputs and what was cut."""
    outputs = np.empty(4)
    cut = flight_kernels._mixed(np.array(commands), controls(autopilot), 1.0, outputs)
    return outputs, int(cut)


def reached(autopilot: Autopilot, outputs: FloatArray) -> FloatArray:
    """Commands that a set of outputs answers to."""
    return np.asarray(np.linalg.pinv(autopilot.mixer_for(craft.vehicle())) @ outputs)


PLAIN = craft.autopilot("ardupilot", linearization=Linearization())


def test_the_mixer_away_from_its_limits() -> None:
    commands = (0.1, -0.05, 0.04, 0.5)
    outputs, cut = mixed(PLAIN, commands)
    np.testing.assert_allclose(outputs, PLAIN.mixer_for(craft.vehicle()) @ commands, atol=1e-15)
    assert cut == 0


def test_yaw_gives_way_first() -> None:
    outputs, cut = mixed(PLAIN, (0.4, 0.4, 0.9, 0.5))
    roll, pitch, yaw, thrust = reached(PLAIN, outputs)
    np.testing.assert_allclose((roll, pitch, thrust), (0.4, 0.4, 0.5), atol=1e-12)
    # A rotor at 0.9 and one at 0.1 leave a tenth of the range for yaw, by a weight of one half.
    assert yaw == pytest.approx(0.2, abs=1e-12)
    assert cut == 2


def test_thrust_moves_before_roll_and_pitch_shrink() -> None:
    outputs, cut = mixed(PLAIN, (0.4, 0.2, 0.0, 0.1))
    np.testing.assert_allclose(reached(PLAIN, outputs), (0.4, 0.2, 0.0, 0.3), atol=1e-12)
    assert cut == 4
    outputs, cut = mixed(PLAIN, (0.4, 0.2, 0.0, 0.95))
    np.testing.assert_allclose(reached(PLAIN, outputs), (0.4, 0.2, 0.0, 0.7), atol=1e-12)
    assert cut == 4


def test_roll_and_pitch_shrink_together_at_last() -> None:
    outputs, cut = mixed(PLAIN, (1.0, 0.6, 0.3, 0.2))
    roll, pitch, yaw, thrust = reached(PLAIN, outputs)
    assert (roll, pitch) == pytest.approx((1.0 / 1.6, 0.6 / 1.6), abs=1e-12)
    assert thrust == pytest.approx(0.5, abs=1e-12)
    assert yaw == pytest.approx(0.0, abs=1e-12)
    assert outputs.min() == pytest.approx(0.0, abs=1e-12)
    assert outputs.max() == pytest.approx(1.0, abs=1e-12)
    assert cut & 1


def test_rotors_that_share_the_thrust_unequally() -> None:
    mixer = PLAIN.mixer_for(craft.vehicle()) * np.array([1.0, 1.0, 1.0, 1.0])
    mixer[:, 3] = (1.0, 0.9, 0.8, 0.7)
    autopilot = craft.autopilot("simple", mixer=mixer, linearization=Linearization())
    commands = (0.1, -0.05, 0.04, 0.5)
    outputs, cut = mixed(autopilot, commands)
    np.testing.assert_allclose(outputs, mixer @ commands, atol=1e-15)
    assert cut == 0
    outputs, cut = mixed(autopilot, (0.2, 0.0, 0.0, 1.5))
    assert outputs.max() == pytest.approx(1.0, abs=1e-12)
    assert cut == 4


def test_outputs_follow_the_linearization() -> None:
    autopilot = craft.autopilot("ardupilot")
    commands = np.array([0.1, -0.05, 0.04, 0.5])
    outputs, _ = mixed(autopilot, tuple(commands))
    np.testing.assert_allclose(outputs, craft.outputs_for(autopilot, craft.vehicle(), commands), atol=1e-14)


def test_a_saturated_axis_winds_nothing_up() -> None:
    control = controls(craft.autopilot())
    row, asked, memory = np.zeros(logged.MOTORS + 4), np.zeros(16), np.zeros((7, 3))
    row[logged.RATE_SETPOINT : logged.RATE_SETPOINT + 3] = 0.5
    for k in range(50):
        flight_kernels._rates(row, asked, memory, k == 0, control)
    wound = memory[3].copy()
    assert np.all(wound > 0.0)
    memory[6] = memory[5]
    flight_kernels._rates(row, asked, memory, False, control)
    np.testing.assert_array_equal(memory[3], wound)
    row[logged.RATE_SETPOINT : logged.RATE_SETPOINT + 3] = -20.0
    flight_kernels._rates(row, asked, memory, False, control)
    assert np.all(memory[3] < wound)


def test_the_integral_has_its_limit() -> None:
    control = controls(craft.autopilot())
    row, asked, memory = np.zeros(logged.MOTORS + 4), np.zeros(16), np.zeros((7, 3))
    row[logged.RATE_SETPOINT : logged.RATE_SETPOINT + 3] = 5.0
    for k in range(4000):
        flight_kernels._rates(row, asked, memory, k == 0, control)
    np.testing.assert_allclose(memory[3], 0.3, rtol=1e-12)


def test_mixers_of_the_kinds() -> None:
    assert library_layout("quad.x").rotors == 4
    px4, ardupilot = (craft.autopilot(kind).mixer_for(craft.vehicle()) for kind in ("px4", "ardupilot"))
    np.testing.assert_allclose(np.abs(ardupilot[:, :3]), 0.5, atol=1e-12)
    np.testing.assert_allclose(np.abs(px4[:, :2]), 0.7071, atol=1e-4)
