"""Loops of what the package can fly: a hover vehicle with its autopilot, and one axis under a rate controller."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.channel import AXES
from rotorid.data.flight_plan import Entry
from rotorid.design.loop import Density, LoopModel, Noise, Responds, loop_model
from rotorid.design.spectrum import GaussMarkov, White
from rotorid.errors import UsageError
from rotorid.models.controller import RateController
from rotorid.models.structure import LinearStructure
from rotorid.simulate.controller import MEASURED, HoverController
from rotorid.simulate.flight import GUST_CORRELATION_S, STEP_RATE_HZ, SensorNoise
from rotorid.simulate.vehicle import ACCELERATIONS, OUTPUTS, VELOCITIES, HoverVehicle
from rotorid.typing import ComplexArray, FloatArray


@dataclass(frozen=True, kw_only=True)
class _HoverFeedback:
    """Commands of a hover controller by the outputs of its vehicle."""

    controller: HoverController

    def response(self, omega_rad_s: FloatArray) -> ComplexArray:
        error = np.hstack([self.controller.error, np.zeros((len(AXES), len(ACCELERATIONS)))])
        return np.asarray(_gains(self.controller, omega_rad_s)[:, None, :] * error[:, :, None])


@dataclass(frozen=True, kw_only=True)
class _HoverEntry:
    """Commands of a hover controller by test inputs at the set-points of its rates or angles."""

    controller: HoverController
    angle: bool

    def response(self, omega_rad_s: FloatArray) -> ComplexArray:
        # The innermost set-point of thrust is that of the climb, which stands for both.
        inner = np.array([*self.controller.angle_p, 1.0]) if self.angle else np.ones(len(AXES))
        return np.asarray(np.eye(len(AXES))[:, :, None] * inner[:, None] * _gains(self.controller, omega_rad_s))


@dataclass(frozen=True, kw_only=True)
class _Single:
    """A controller of one rate as a response of one command to it, with a sign."""

    controller: RateController
    sign: float

    def response(self, omega_rad_s: FloatArray) -> ComplexArray:
        return np.asarray(self.sign * self.controller.response(omega_rad_s)[None, None, :])


@dataclass(frozen=True, kw_only=True)
class _RateSetpoint:
    """Command of a rate controller by test inputs at the set-point of the rate, or of the angle around it."""

    controller: RateController
    angle: bool

    def response(self, omega_rad_s: FloatArray) -> ComplexArray:
        own = self.controller
        derivative = own.derivative_s2 if own.derivative_of_error else 0.0
        inside = replace(own.rate_loop, derivative_s2=derivative, delay_s=0.0).response(omega_rad_s)
        cutoff = own.target_cutoff_hz
        late = 1.0 / (1.0 + 1j * omega_rad_s / (2.0 * np.pi * cutoff)) if cutoff > 0.0 else 1.0
        return np.asarray((inside * late * (own.angle_1_s if self.angle else 1.0))[None, None, :])


def vehicle_loop(
    vehicle: HoverVehicle,
    *,
    turbulence_m_s: float = 0.08,
    noise: SensorNoise | None = None,
    log_rate_hz: float = 200.0,
) -> LoopModel:
    """A hover vehicle as :func:`rotorid.simulate.flight.fly` flies it.

    Parameters
    ----------
    vehicle
        Airframe and autopilot.
    turbulence_m_s
        Standard deviation of the gusts along each axis.
    noise
        Sensor noise; the standard one when omitted.
    log_rate_hz
        Rate of the log; the loop runs at 1 kHz.

    Examples
    --------
    >>> from rotorid.vehicles import s500
    >>> loop = vehicle_loop(s500.vehicle(), turbulence_m_s=0.1)
    >>> loop.inputs, loop.at(np.array([10.0])).plant.shape
    (('roll_command', 'pitch_command', 'yaw_command', 'thrust_command'), (12, 4, 1))
    """
    noise = noise or SensorNoise()
    system = vehicle.system
    wind = replace(system, G=vehicle.gust_input, input_delays_s=np.zeros(len(VELOCITIES)))
    measured = (*noise.of_measured, *[0.0] * len(ACCELERATIONS))
    accelerometer = (*[0.0] * len(MEASURED), *[noise.accelerometer_m_s2] * len(ACCELERATIONS))
    gusts = GaussMarkov(std=(turbulence_m_s,) * len(VELOCITIES), correlation_s=GUST_CORRELATION_S)
    entries: dict[Entry, Responds] = {
        "rate_setpoint": _HoverEntry(controller=vehicle.controller, angle=False),
        "attitude_setpoint": _HoverEntry(controller=vehicle.controller, angle=True),
    }
    return loop_model(
        system,
        _HoverFeedback(controller=vehicle.controller),
        [
            Noise(source=gusts, path=wind),
            Noise(source=White(std=measured, sample_rate_hz=STEP_RATE_HZ)),
            Noise(source=White(std=accelerometer, sample_rate_hz=log_rate_hz), logged_only=True),
        ],
        name=vehicle.name,
        inputs=[f"{axis}_command" for axis in AXES],
        outputs=OUTPUTS,
        entries=entries,
        log_rate_hz=log_rate_hz,
        loop_rate_hz=STEP_RATE_HZ,
    )


def axis_loop(
    structure: LinearStructure,
    values: Mapping[str, float],
    controller: RateController | None,
    disturbances: Density,
    *,
    log_rate_hz: float = 200.0,
) -> LoopModel:
    """One axis under its rate controller: a previous result, or physics, with the noise it is expected to meet.

    Parameters
    ----------
    structure
        With one input and one output, a body rate.
    values
        Every parameter.
    controller
        As the autopilot's parameters give it; ``None`` in open loop.
    disturbances
        What stands at the output with the loop open, as the log shows it: that of a previous flight from
        :func:`rotorid.design.spectrum.disturbances_of`, or a plain :class:`rotorid.design.spectrum.White`.
    log_rate_hz
        Rate of the log.

    Raises
    ------
    UsageError
        The structure has several inputs or outputs.

    Examples
    --------
    >>> from rotorid.models.rate import rate_model
    >>> loop = axis_loop(rate_model("rate.roll"), {"L_roll": 80.0, "L_p": -4.0, "T_motor": 0.05, "tau_roll": 0.006},
    ...                  RateController(proportional_s=0.08), White(std=(0.02,), sample_rate_hz=200.0))
    >>> abs(loop.at(np.array([10.0])).excited[0, 0]).round(2)
    array([0.94])
    """
    if len(structure.inputs) != 1 or len(structure.outputs) != 1:
        raise UsageError(
            f"{structure.name} with {len(structure.inputs)} inputs and {len(structure.outputs)} outputs came",
            needed="one of each",
            remedy="select them, or build the loop with rotorid.design.loop.loop_model",
        )
    entries: dict[Entry, Responds] = {}
    if controller is not None:
        entries = {"rate_setpoint": _RateSetpoint(controller=controller, angle=False)}
        if controller.angle_1_s > 0.0:
            entries["attitude_setpoint"] = _RateSetpoint(controller=controller, angle=True)
    return loop_model(
        structure.matrices(values),
        None if controller is None else _Single(controller=controller, sign=-1.0),
        [Noise(source=disturbances)],
        name=structure.name,
        inputs=structure.inputs,
        outputs=structure.outputs,
        entries=entries,
        log_rate_hz=log_rate_hz,
    )


def _gains(controller: HoverController, omega_rad_s: FloatArray) -> ComplexArray:
    """Command by the innermost error of each axis, shape ``(4, f)``."""
    return np.asarray(controller.proportional[:, None] + controller.integral[:, None] / (1j * omega_rad_s))
