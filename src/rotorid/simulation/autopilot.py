r"""A cascade that flies: velocity, attitude, rate, mixer, each at the same tick, as PX4's and ArduPilot's do.

The attitude error is that of quaternions and the rate controller, for each axis,

.. math::

    u = P e + I \int e \, dt + D \, \dot d + F \, r, \qquad e = F_e (F_t \, r - \omega), \qquad
    d = e \text{ (ArduPilot) or } -\omega \text{ (PX4)}

with first-order filters :math:`F` on target, error, derivative and command, a limit of the integral, which does not
grow while the motors cannot follow, and a low-pass of second order on the rates before all that. The mixer holds roll
and pitch as long as it can: yaw gives way first, then thrust moves, then roll and pitch shrink.

Left out of PX4: the slew of its set-points and the reduction of yaw in its attitude error. Left out of ArduPilot: the
input shaper of its sticks (that of attitude set-points is in :mod:`rotorid.simulation.shaping`), the square-root
controller beyond small errors, its own priorities in the mixer.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from rotorid.autopilots.filters import butterworth_low_pass
from rotorid.autopilots.registry import named
from rotorid.autopilots.thrust import Linearization
from rotorid.data.base import Immutable, read_only
from rotorid.data.record import AXES
from rotorid.errors import ModelError, UsageError
from rotorid.models.autopilots.layouts import mixer_like
from rotorid.simulation.multirotor import Control, Multirotor, plain
from rotorid.simulation.shaping import InputShaping, input_shaping
from rotorid.typing import Axis, FloatArray

Kind: TypeAlias = Literal["px4", "ardupilot", "betaflight", "simple"]
Three: TypeAlias = tuple[float, float, float]

_NONE: Three = (0.0, 0.0, 0.0)
_UNLIMITED: Three = (math.inf, math.inf, math.inf)


@dataclass(frozen=True, kw_only=True)
class RateLoop(Immutable):
    """Gains of the rate controllers; each tuple is roll, pitch, yaw.

    Parameters
    ----------
    proportional, integral, derivative, feedforward
        Command per rad/s, per rad, per rad/s², per rad/s of set-point.
    integral_limit
        Largest command of the integral.
    derivative_of_error
        Whether the derivative sees the set-point.
    derivative_cutoff_hz, error_cutoff_hz, target_cutoff_hz, command_cutoff_hz
        First-order filters; zero for none.
    """

    proportional: Three
    integral: Three = _NONE
    derivative: Three = _NONE
    feedforward: Three = _NONE
    integral_limit: Three = (0.3, 0.3, 0.3)
    derivative_of_error: bool = False
    derivative_cutoff_hz: Three = _NONE
    error_cutoff_hz: Three = _NONE
    target_cutoff_hz: Three = _NONE
    command_cutoff_hz: Three = _NONE


@dataclass(frozen=True, kw_only=True)
class Guidance(Immutable):
    """The outer loops: how sticks are read, and what is controlled.

    Parameters
    ----------
    tilt_limit_rad, stick_tilt_rad, stick_yaw_rate_rad_s, stick_climb_m_s, stick_thrust
        Largest tilt, and what a full stick asks for. The thrust stick asks for thrust where it does not for climb.
    velocity_p_1_s, velocity_i_1_s2, position_p_1_s
        Acceleration per m/s of velocity error and per meter of its integral; velocity per meter of position error.
    climb_p, climb_i, height_p_1_s
        Thrust command per m/s of sink and per meter of its integral; velocity per meter of height error.
    hold_velocity, hold_height
        Whether these loops are closed.
    tilt_compensation
        Whether a tilted vehicle gets more thrust.
    heading_follows
        Whether no heading is held while the yaw stick is out, as PX4 does it, or the one to which the stick leads.
    """

    tilt_limit_rad: float = 0.6
    stick_tilt_rad: float = 0.6
    stick_yaw_rate_rad_s: float = 2.0
    stick_climb_m_s: float = 0.0
    stick_thrust: float = 0.5
    velocity_p_1_s: float = 0.0
    velocity_i_1_s2: float = 0.0
    position_p_1_s: float = 0.0
    climb_p: float = 0.0
    climb_i: float = 0.0
    height_p_1_s: float = 0.0
    hold_velocity: bool = False
    hold_height: bool = False
    tilt_compensation: bool = False
    heading_follows: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Autopilot(Immutable):
    """A flight controller with its mixer.

    Parameters
    ----------
    kind
        Whose manner: ``px4``, ``ardupilot``, ``betaflight`` or ``simple``; decides the mixer unless one is given, and
        the log.
    rate_hz
        Of all loops.
    rates, guidance
        See :class:`RateLoop` and :class:`Guidance`.
    angle_1_s
        Rate set-point per rad of attitude error.
    rate_limit_rad_s
        Largest rate set-point.
    gyro_cutoff_hz, accelerometer_cutoff_hz
        Second-order Butterworth filters; zero for none.
    delay_s
        From each command to the motors: roll, pitch, yaw, thrust. They hold computing time and transport, and are
        rounded to steps of the integrator.
    mixer
        Demand of each motor per unit of command, shape ``(rotors, 4)``; by ``kind`` when none is given.
    linearization
        What turns demands into outputs.
    motor_range
        Least and greatest demand.
    parameters
        The autopilot's own parameters by its own names, for the log.
    """

    kind: Kind
    rate_hz: float
    rates: RateLoop
    angle_1_s: Three
    guidance: Guidance = field(default_factory=Guidance)
    rate_limit_rad_s: Three = _UNLIMITED
    gyro_cutoff_hz: float = 0.0
    accelerometer_cutoff_hz: float = 0.0
    delay_s: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    mixer: FloatArray | None = None
    linearization: Linearization = field(default_factory=Linearization)
    motor_range: tuple[float, float] = (0.0, 1.0)
    parameters: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not (0.0 < self.rate_hz < math.inf) or min(self.delay_s) < 0.0 or not all(map(math.isfinite, self.delay_s)):
            raise UsageError(
                f"the autopilot has a rate of {self.rate_hz:g} Hz and delays of {self.delay_s} s",
                needed="a positive rate and delays of zero or more",
            )
        mixer = None if self.mixer is None else read_only(self.mixer, np.float64, ndim=2)
        self._set(mixer=mixer, parameters=self.parameters)

    @property
    def shaping(self) -> dict[Axis, InputShaping]:
        """How attitude set-points are smoothed, by axis; those that fly as they are asked for are not in it."""
        if not named(self.kind).shapes_setpoints:
            return {}
        axes: tuple[Axis, ...] = ("roll", "pitch", "yaw")
        return {axis: own for axis in axes if (own := input_shaping(self.parameters, axis)) is not None}

    def mixer_for(self, vehicle: Multirotor) -> FloatArray:
        """Demand of each motor per unit of command, shape ``(rotors, 4)``."""
        if self.mixer is not None:
            return self.mixer
        return mixer_like(vehicle.rotors.layout, self.kind)

    def hover_commands(self, vehicle: Multirotor) -> FloatArray:
        """Commands of roll, pitch, yaw and thrust at which a vehicle hovers, at its rated voltage.

        Raises
        ------
        ModelError
            The mixer cannot make the outputs that hover needs.
        """
        rated_v = vehicle.battery.rated_v if vehicle.battery is not None else 0.0
        share = float(self.linearization.voltage_share(np.array([rated_v]))[0]) if rated_v else 1.0
        needed = self.linearization.demands(vehicle.hover_shares, voltage_share=share)
        mixer = self.mixer_for(vehicle)
        commands, *_ = np.linalg.lstsq(mixer, needed, rcond=None)
        if np.abs(mixer @ commands - needed).max() > 1e-6:
            raise ModelError(
                f"the mixer cannot make the outputs {needed.round(4).tolist()} with which {vehicle.name} hovers",
                needed="a mixer of these rotors",
            )
        return np.asarray(commands)

    def control(self, vehicle: Multirotor, *, substeps: int) -> Control:
        """The same as plain numbers, for the kernels."""
        step_s = 1.0 / (self.rate_hz * substeps)
        guidance, rates, line = self.guidance, self.rates, self.linearization
        return Control(
            tick_s=1.0 / self.rate_hz,
            substeps=int(substeps),
            proportional=plain(rates.proportional),
            integral=plain(rates.integral),
            derivative=plain(rates.derivative),
            feedforward=plain(rates.feedforward),
            integral_limit=plain(rates.integral_limit),
            derivative_of_error=bool(rates.derivative_of_error),
            derivative_keep=self._keep(rates.derivative_cutoff_hz),
            error_keep=self._keep(rates.error_cutoff_hz),
            target_keep=self._keep(rates.target_cutoff_hz),
            command_keep=self._keep(rates.command_cutoff_hz),
            gyro_filter=self._section(self.gyro_cutoff_hz),
            accelerometer_filter=self._section(self.accelerometer_cutoff_hz),
            angle=plain(self.angle_1_s),
            rate_limit=plain(self.rate_limit_rad_s),
            tilt_limit=float(guidance.tilt_limit_rad),
            velocity_p=float(guidance.velocity_p_1_s),
            velocity_i=float(guidance.velocity_i_1_s2),
            position_p=float(guidance.position_p_1_s),
            climb_p=float(guidance.climb_p),
            climb_i=float(guidance.climb_i),
            height_p=float(guidance.height_p_1_s),
            hold_velocity=bool(guidance.hold_velocity),
            heading_follows=bool(guidance.heading_follows),
            hold_height=bool(guidance.hold_height),
            tilt_compensation=bool(guidance.tilt_compensation),
            stick_tilt=float(guidance.stick_tilt_rad),
            stick_yaw_rate=float(guidance.stick_yaw_rate_rad_s),
            stick_climb=float(guidance.stick_climb_m_s),
            stick_thrust=0.0 if guidance.stick_climb_m_s else float(guidance.stick_thrust),
            hover_thrust=float(self.hover_commands(vehicle)[AXES.index("thrust")]),
            mixer=plain(self.mixer_for(vehicle)),
            low=float(self.motor_range[0]),
            high=float(self.motor_range[1]),
            expo=float(line.expo),
            output_low=float(line.low),
            output_high=float(line.high),
            voltage_max=float(line.voltage_max) if line.compensates_voltage else 0.0,
            voltage_min=float(line.voltage_min),
            delay_steps=np.round(np.array(self.delay_s) / step_s).astype(np.int64),
        )

    def _keep(self, cutoffs_hz: Three) -> FloatArray:
        """What a first-order filter keeps of its last value, as PX4's and ArduPilot's: 1 - dt/(dt + 1/(2 pi f))."""
        tick_s = 1.0 / self.rate_hz
        return plain([1.0 - tick_s / (tick_s + 0.5 / (math.pi * f)) if f > 0.0 else 0.0 for f in cutoffs_hz])

    def _section(self, cutoff_hz: float) -> FloatArray:
        """Coefficients b0 b1 b2 a1 a2."""
        if cutoff_hz <= 0.0:
            return plain([1.0, 0.0, 0.0, 0.0, 0.0])
        section = butterworth_low_pass(cutoff_hz, self.rate_hz)
        return plain(np.array([*section.numerator, *section.denominator[1:]]) / section.denominator[0])
