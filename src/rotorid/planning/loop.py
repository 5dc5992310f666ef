r"""A loop as frequency responses: vehicle, feedback, test inputs, disturbances and noises before anyone has flown it.

.. math:: u = K y + E r, \qquad y = G u + v

with commands u, outputs y, test inputs r, the plant G, the feedback K (its sign included) and disturbances and noises
v as they stand at the outputs with the loop open. Solved for what is logged,

.. math:: u = T E r + B v, \quad y = G T E r + (1 + G B) v, \qquad T = (1 - K G)^{-1}, \quad B = T K

The loop may be a hover vehicle with its autopilot or one axis under a rate controller; noise white, a gust, or what a
flight showed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.flight_plan import Entry
from rotorid.data.record import AXES
from rotorid.data.response import FrequencyResponse
from rotorid.errors import UsageError
from rotorid.models.controller import RateController
from rotorid.models.structure import LinearStructure
from rotorid.simulation.hover_flight import (
    ACCELERATIONS,
    GUST_CORRELATION_S,
    MEASURED,
    OUTPUTS,
    STEP_RATE_HZ,
    VELOCITIES,
    HoverController,
    HoverVehicle,
    SensorNoise,
)
from rotorid.typing import Axis, ComplexArray, FloatArray


class Responds(Protocol):
    """What has a frequency response: a state space, a controller."""

    def response(self, omega_rad_s: FloatArray) -> ComplexArray:
        """Response at frequencies above zero, shape ``(outputs, inputs, f)``."""
        ...


class Density(Protocol):
    """What has a spectrum."""

    def density(self, omega_rad_s: FloatArray) -> ComplexArray:
        r"""One-sided densities :math:`E[a b^*]` in unit²/Hz, shape ``(n, n, f)``."""
        ...


@dataclass(frozen=True, kw_only=True)
class Noise:
    """A source of disturbance or noise.

    Parameters
    ----------
    source
        Its spectrum.
    path
        From the source to the outputs; a source that stands at the outputs has none.
    logged_only
        Whether it enters the log but not the controller, sample by sample of the log.
    """

    source: Density
    path: Responds | None = None
    logged_only: bool = False

    def at(self, omega_rad_s: FloatArray) -> ComplexArray:
        """What it is at the outputs with the loop open, shape ``(y, y, f)``."""
        density = self.source.density(omega_rad_s)
        if self.path is None:
            return density
        path = self.path.response(omega_rad_s)
        return np.asarray(np.einsum("amf,mnf,bnf->abf", path, density, path.conj(), optimize=True))


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopResponses(Immutable):
    r"""A closed loop on one frequency grid.

    Parameters
    ----------
    omega_rad_s
        Shape ``(f,)``.
    plant
        Outputs by commands, the loop open, shape ``(y, u, f)``.
    excited
        :math:`T`, commands by test inputs added to them, shape ``(u, u, f)``.
    disturbed
        :math:`B`, commands by disturbances at the outputs, shape ``(u, y, f)``.
    density
        One-sided :math:`E[v v^*]` of these disturbances, shape ``(y, y, f)``.
    """

    omega_rad_s: FloatArray
    plant: ComplexArray
    excited: ComplexArray
    disturbed: ComplexArray
    density: ComplexArray

    def __post_init__(self) -> None:
        self._set(
            omega_rad_s=read_only(self.omega_rad_s, np.float64, ndim=1),
            **{
                name: read_only(getattr(self, name), np.complex128, ndim=3)
                for name in ("plant", "excited", "disturbed", "density")
            },
        )

    @property
    def logged_noise(self) -> ComplexArray:
        """One-sided densities of what commands and outputs do without test inputs, shape ``(u + y, u + y, f)``."""
        outputs = np.eye(len(self.plant))[:, :, None] + np.einsum("auf,ubf->abf", self.plant, self.disturbed)
        both = np.concatenate([self.disturbed, outputs])
        return np.asarray(np.einsum("amf,mnf,bnf->abf", both, self.density, both.conj(), optimize=True))


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopModel(Immutable):
    """A vehicle under feedback, and how it is logged.

    Linear and stable: that the loop is stable is not checked, and the answers of one that is not mean nothing.

    Parameters
    ----------
    name
        What messages call it.
    inputs, outputs
        Channel names of commands and outputs.
    plant
        Outputs by commands.
    feedback
        Commands by outputs, with its sign; ``None`` in open loop.
    noises
        Disturbances and sensor noises.
    entries
        Commands by test inputs that enter elsewhere, one column for each command; ``command`` needs none.
    log_rate_hz
        Rate of the log.
    loop_rate_hz
        Rate of the controller, of which the log picks samples: what the loop does above half of the rate of the log
        shows below it. ``None`` takes the noises as the log shows them.
    declared
        Where test inputs enter that the log declares with their band, as ArduPilot's does with its own sweeps. Of all
        others an identification finds the band in the signals.
    alone
        Whether the log holds these, and what answers them, only while they are flown, as ArduPilot's fast samples are.
    axes
        Axis of each input; by default the one that its command is named after.
    held
        Whether inputs are sent at the samples of the log, and stand until the next one.
    """

    name: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    plant: Responds
    feedback: Responds | None
    noises: tuple[Noise, ...]
    entries: Mapping[Entry, Responds] = field(default_factory=dict)
    log_rate_hz: float = 200.0
    loop_rate_hz: float | None = None
    declared: tuple[Entry, ...] = ("command",)
    alone: bool = False
    axes: tuple[Axis, ...] = ()
    held: bool = False

    def __post_init__(self) -> None:
        self._set(inputs=tuple(self.inputs), outputs=tuple(self.outputs), noises=tuple(self.noises))
        self._set(entries=self.entries, declared=tuple(self.declared), axes=tuple(self.axes))
        if not self.log_rate_hz > 0.0 or (self.loop_rate_hz is not None and self.loop_rate_hz < self.log_rate_hz):
            raise UsageError(
                f"a log at {self.log_rate_hz:g} Hz does not fit a loop at {self.loop_rate_hz} Hz",
                needed="a positive log rate, at most that of the loop",
            )

    def input_of(self, axis: Axis) -> str:
        """The input that moves an axis."""
        return self.inputs[self.axes.index(axis)] if self.axes else f"{axis}_command"

    def at(self, omega_rad_s: FloatArray) -> LoopResponses:
        """The loop at some frequencies above zero, shape ``(f,)``; noises that only the log sees are left out."""
        plant = self.plant.response(omega_rad_s)
        outputs, inputs, points = plant.shape
        feedback = np.zeros((inputs, outputs, points), dtype=np.complex128)
        if self.feedback is not None:
            feedback = self.feedback.response(omega_rad_s)
        around = np.eye(inputs) - np.einsum("iyf,yjf->fij", feedback, plant)
        excited = np.moveaxis(np.linalg.inv(around), 0, -1)
        return LoopResponses(
            omega_rad_s=omega_rad_s,
            plant=plant,
            excited=excited,
            disturbed=np.einsum("ijf,jyf->iyf", excited, feedback),
            density=_summed([noise for noise in self.noises if not noise.logged_only], omega_rad_s, outputs),
        )

    def excitation(self, omega_rad_s: FloatArray, entry: Entry) -> ComplexArray:
        """Commands by test inputs with the loop open, :math:`E`, shape ``(u, u, f)``.

        Raises
        ------
        UsageError
            The loop does not say how a test input gets from there to the commands.
        """
        if entry == "command":
            return np.repeat(np.eye(len(self.inputs), dtype=np.complex128)[:, :, None], omega_rad_s.size, axis=2)
        if entry not in self.entries:
            raise UsageError(
                f"the plan has test inputs at the {entry}",
                needed=f"test inputs at {' or '.join(['command', *self.entries])} for the loop {self.name}",
            )
        return self.entries[entry].response(omega_rad_s)

    def logged_noise(self, omega_rad_s: FloatArray) -> ComplexArray:
        r"""One-sided densities of commands and outputs in the log without test inputs, shape ``(u + y, u + y, f)``.

        Samples that are picked and not averaged fold the spectrum of the loop,
        :math:`S(\omega) = \sum_m S_{loop}(\omega + m \omega_{log})`.
        """
        total = np.zeros((*[len(self.inputs) + len(self.outputs)] * 2, omega_rad_s.size), dtype=np.complex128)
        for shift in self._images:
            moved = omega_rad_s + shift
            inside = np.abs(moved) <= np.pi * (self.loop_rate_hz or np.inf)
            density = self.at(np.abs(moved[inside])).logged_noise
            # Of a real signal the spectrum at a negative frequency is the conjugate one.
            total[..., inside] += np.where(moved[inside] < 0.0, density.conj(), density)
        outputs = slice(len(self.inputs), None)
        logged_only = [noise for noise in self.noises if noise.logged_only]
        total[outputs, outputs] += _summed(logged_only, omega_rad_s, len(self.outputs))
        return total

    @property
    def _images(self) -> list[float]:
        if self.loop_rate_hz is None or all(noise.logged_only for noise in self.noises):
            return [0.0]
        count = int(np.ceil(self.loop_rate_hz / self.log_rate_hz))
        return [2.0 * np.pi * self.log_rate_hz * number for number in range(-count, count + 1)]


def loop_model(
    plant: Responds,
    feedback: Responds | None,
    noises: Sequence[Noise],
    *,
    name: str,
    inputs: Sequence[str],
    outputs: Sequence[str],
    entries: Mapping[Entry, Responds] | None = None,
    log_rate_hz: float = 200.0,
    loop_rate_hz: float | None = None,
    declared: Sequence[Entry] = ("command",),
    alone: bool = False,
) -> LoopModel:
    """A loop of a plant and its controller, checked for shapes.

    Parameters
    ----------
    plant
        State space from commands to outputs, or anything else with such a response.
    feedback
        From outputs to commands, its sign included; ``None`` in open loop.
    noises
        Sources of disturbance and noise, each with its path to the outputs.
    name, inputs, outputs, entries, log_rate_hz, loop_rate_hz, declared, alone
        As in :class:`LoopModel`.

    Raises
    ------
    UsageError
        The shapes of plant, feedback, entries and noises do not fit the names.

    Examples
    --------
    A rate that is the integral of ten times the command, held by a gain of 0.5, noisy as a gyro is:

    >>> from rotorid.planning.loop import White
    >>> from rotorid.models.state_space import StateSpace
    >>> one, none = np.eye(1), np.zeros((1, 1))
    >>> rate = StateSpace(M=one, F=none, G=10.0 * one, H0=one, H1=none, input_delays_s=[0.0], output_delays_s=[0.0])
    >>> gain = StateSpace(M=one, F=-1e6 * one, G=-0.5e6 * one, H0=one, H1=none,
    ...                   input_delays_s=[0.0], output_delays_s=[0.0])
    >>> loop = loop_model(rate, gain, [Noise(source=White(std=(0.01,), sample_rate_hz=200.0))],
    ...                   name="rate loop", inputs=["roll_command"], outputs=["p"])
    >>> abs(loop.at(np.array([5.0])).excited[0, 0]).round(3)
    array([0.707])
    """
    loop = LoopModel(
        name=name,
        inputs=tuple(inputs),
        outputs=tuple(outputs),
        plant=plant,
        feedback=feedback,
        noises=tuple(noises),
        entries=entries or {},
        log_rate_hz=log_rate_hz,
        loop_rate_hz=loop_rate_hz,
        declared=tuple(declared),
        alone=alone,
    )
    u, y, one = len(loop.inputs), len(loop.outputs), np.ones(1)
    shapes = [("the plant", plant.response(one).shape, (y, u, 1))]
    if feedback is not None:
        shapes.append(("the feedback", feedback.response(one).shape, (u, y, 1)))
    shapes += [(f"the entry {entry}", path.response(one).shape, (u, u, 1)) for entry, path in loop.entries.items()]
    shapes += [(f"noise {number}", noise.at(one).shape, (y, y, 1)) for number, noise in enumerate(noises)]
    for what, came, needed in shapes:
        if came != needed:
            raise UsageError(f"{what} of {name} has a response of shape {came}", needed=f"shape {needed}")
    return loop


def _summed(noises: Sequence[Noise], omega_rad_s: FloatArray, outputs: int) -> ComplexArray:
    total = np.zeros((outputs, outputs, omega_rad_s.size), dtype=np.complex128)
    for noise in noises:
        total += noise.at(omega_rad_s)
    return total


@dataclass(frozen=True, kw_only=True)
class White:
    r"""Independent samples, :math:`S = 2 \sigma^2 / f_s`.

    Parameters
    ----------
    std
        Standard deviation of each source, per sample.

    Examples
    --------
    >>> White(std=(0.1,), sample_rate_hz=200.0).density(np.array([1.0])).real.round(6)
    array([[[0.0001]]])
    """

    std: tuple[float, ...]
    sample_rate_hz: float

    def density(self, omega_rad_s: FloatArray) -> ComplexArray:
        """One-sided density, shape ``(n, n, f)``."""
        return _diagonal(2.0 * np.square(self.std) / self.sample_rate_hz, np.ones(omega_rad_s.size))


@dataclass(frozen=True, kw_only=True)
class GaussMarkov:
    r"""Gusts of :func:`rotorid.simulation.hover_flight.gauss_markov`, :math:`S = 4 \sigma^2 T / (1 + \omega^2 T^2)`.

    Parameters
    ----------
    std
        Standard deviation of each source.
    correlation_s
        :math:`T`.
    """

    std: tuple[float, ...]
    correlation_s: float

    def density(self, omega_rad_s: FloatArray) -> ComplexArray:
        """One-sided density, shape ``(n, n, f)``."""
        shape = 4.0 * self.correlation_s / (1.0 + (omega_rad_s * self.correlation_s) ** 2)
        return _diagonal(np.square(self.std), shape)


@dataclass(frozen=True, kw_only=True)
class Dryden:
    r"""Gusts of :func:`rotorid.simulation.wind.blown` to north, east and down.

    .. math:: S_{along} = \frac{4 \sigma^2 T}{1 + \omega^2 T^2}, \qquad
        S_{across} = 2 \sigma^2 T \frac{1 + 3 \omega^2 T^2}{(1 + \omega^2 T^2)^2}

    Parameters
    ----------
    level_std, vertical_std
        Standard deviations along and across the wind, and vertically.
    level_s, vertical_s
        :math:`T` of both.
    heading_rad
        Where the wind blows to, from north over east.
    """

    level_std: float
    vertical_std: float
    level_s: float
    vertical_s: float
    heading_rad: float = 0.0

    def density(self, omega_rad_s: FloatArray) -> ComplexArray:
        """One-sided density, shape ``(3, 3, f)``."""
        along = GaussMarkov(std=(self.level_std,), correlation_s=self.level_s).density(omega_rad_s)[0, 0]
        total = np.zeros((3, 3, omega_rad_s.size), dtype=np.complex128)
        total[0, 0], total[1, 1] = along, _across(self.level_std, self.level_s, omega_rad_s)
        total[2, 2] = _across(self.vertical_std, self.vertical_s, omega_rad_s)
        cosine, sine = np.cos(self.heading_rad), np.sin(self.heading_rad)
        turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        return np.asarray(np.einsum("am,mnf,bn->abf", turn, total, turn))


@dataclass(frozen=True, kw_only=True, eq=False)
class Tabulated(Immutable):
    """A spectrum given at some frequencies: straight lines over the logarithm of frequency, flat beyond both ends.

    Parameters
    ----------
    omega_rad_s
        Rising, above zero, shape ``(f,)``.
    values
        One-sided densities :math:`E[a b^*]`, shape ``(n, n, f)``.
    """

    omega_rad_s: FloatArray
    values: ComplexArray

    def __post_init__(self) -> None:
        omega, values = read_only(self.omega_rad_s, np.float64, ndim=1), read_only(self.values, np.complex128, ndim=3)
        if not omega.size or omega[0] <= 0.0 or np.any(np.diff(omega) <= 0.0) or values.shape[2] != omega.size:
            raise UsageError(
                f"densities of shape {values.shape} do not fit {omega.size} frequencies",
                needed="rising frequencies above zero, with a density for each",
            )
        self._set(omega_rad_s=omega, values=values)

    def density(self, omega_rad_s: FloatArray) -> ComplexArray:
        """One-sided density, shape ``(n, n, f)``."""
        place = np.interp(np.log(omega_rad_s), np.log(self.omega_rad_s), np.arange(self.omega_rad_s.size))
        first = np.minimum(place.astype(np.int64), max(self.omega_rad_s.size - 2, 0))
        second = np.minimum(first + 1, self.omega_rad_s.size - 1)
        share = place - first
        # A mean of covariances is one, so that no noise of negative power comes out.
        return np.asarray((1.0 - share) * self.values[..., first] + share * self.values[..., second])


def disturbances_of(response: FrequencyResponse) -> Tabulated:
    """What moved the outputs of a measured response beside its inputs, as a spectrum for the next flight.

    Of a joint estimate it is what stands at the outputs with the loop open; a direct one in closed loop takes a part of
    it for the response. The noise of the log, folded as it was, is in it: use it in a loop without ``loop_rate_hz``.

    Raises
    ------
    UsageError
        The response holds no disturbances, because it is no plain estimate any more.
    """
    if response.disturbance is None or response.output_correlation is None:
        raise UsageError("the response has no disturbances", needed="a response as estimated")
    level = np.sqrt(response.disturbance.level)
    return Tabulated(
        omega_rad_s=response.omega_rad_s, values=response.output_correlation[0] * level[:, None] * level[None, :]
    )


def _diagonal(powers: FloatArray, shape: FloatArray) -> ComplexArray:
    return np.asarray(np.diag(powers)[:, :, None] * shape, dtype=np.complex128)


def _across(std: float, correlation_s: float, omega_rad_s: FloatArray) -> FloatArray:
    squared = (omega_rad_s * correlation_s) ** 2
    return np.asarray(2.0 * std**2 * correlation_s * (1.0 + 3.0 * squared) / (1.0 + squared) ** 2)


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
        return (own.angle_response if self.angle else own.setpoint_response)(omega_rad_s)[None, None, :]


def vehicle_loop(
    vehicle: HoverVehicle,
    *,
    turbulence_m_s: float = 0.08,
    noise: SensorNoise | None = None,
    log_rate_hz: float = 200.0,
) -> LoopModel:
    """A hover vehicle as :func:`rotorid.simulation.hover_flight.fly` flies it.

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
        :func:`rotorid.planning.loop.disturbances_of`, or a plain :class:`rotorid.planning.loop.White`.
    log_rate_hz
        Rate of the log.

    Raises
    ------
    UsageError
        The structure has several inputs or outputs.

    Examples
    --------
    >>> from rotorid.models.library import rate_model
    >>> loop = axis_loop(rate_model("rate.roll"), {"L_roll": 80.0, "L_p": -4.0, "T_motor": 0.05, "tau_roll": 0.006},
    ...                  RateController(proportional_s=0.08), White(std=(0.02,), sample_rate_hz=200.0))
    >>> abs(loop.at(np.array([10.0])).excited[0, 0]).round(2)
    array([0.94])
    """
    if len(structure.inputs) != 1 or len(structure.outputs) != 1:
        raise UsageError(
            f"{structure.name} has {len(structure.inputs)} inputs and {len(structure.outputs)} outputs",
            needed="one input and one output",
            remedy="select them, or build the loop with rotorid.planning.loop.loop_model",
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
