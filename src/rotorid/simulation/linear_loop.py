"""A linear vehicle flown in closed loop: any state space, a controller of its outputs, gusts, noise, test inputs."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Maneuver, Source, Topic
from rotorid.errors import ModelError, UsageError
from rotorid.models.state_space import StateSpace
from rotorid.simulation.hover_flight import STEP_RATE_HZ, Flight, gauss_markov, stride_of
from rotorid.simulation.linear import Discretized, discretize
from rotorid.typing import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearLoop(Immutable):
    r"""A vehicle under proportional and integral control of combinations of its outputs, pushed by gusts.

    .. math::

        M \dot x &= F x + G u(t - \tau_u) + E g, \qquad y(t + \tau_y) = H_0 x + H_1 \dot x + n

        u &= P e + I \int e \, dt + d, \qquad e = K y

    with gusts :math:`g`, sensor noise :math:`n` and the test inputs :math:`d`. A derivative in the controller is a rate
    among the outputs; a cascade of angle over rate is a row of K with both.

    Parameters
    ----------
    name
        What it is called.
    system
        The vehicle, as differences from trim. Its inputs are at least 1 ms late, one step of the simulation.
    inputs, outputs
        Channel names of its inputs and outputs.
    error
        K, shape ``(u, y)``. Outputs that are late, or that show an input or a gust at once, cannot be fed back.
    proportional, integral
        P and I, one for each input, per unit of error and per second of it.
    noise_std
        Standard deviation of the white noise of each output, per step.
    gust_input
        E, shape ``(x, g)``; no gusts by default.
    gust_std
        Standard deviation of each gust.
    gust_correlation_s
        Time after which the correlation of a gust has fallen to 1/e.

    Raises
    ------
    ModelError
        A shape does not match the system, an input is less than a step late, or an output cannot be fed back.
    """

    name: str
    system: StateSpace
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    error: FloatArray
    proportional: tuple[float, ...]
    integral: tuple[float, ...]
    noise_std: tuple[float, ...]
    gust_input: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    gust_std: tuple[float, ...] = ()
    gust_correlation_s: float = 1.0

    def __post_init__(self) -> None:
        states = self.system.F.shape[0]
        given = read_only(self.gust_input, np.float64, ndim=2)
        gusts = given if given.size else read_only(np.zeros((states, 0)), np.float64, ndim=2)
        names = ("inputs", "outputs", "proportional", "integral", "noise_std", "gust_std")
        self._set(
            error=read_only(self.error, np.float64, ndim=2),
            gust_input=gusts,
            **{name: tuple(getattr(self, name)) for name in names},
        )
        self._require_shapes()
        self._require_feedback()

    @property
    def gusty(self) -> StateSpace:
        """The system with its gusts as further inputs, which no delay holds up."""
        return replace(
            self.system,
            G=np.hstack([self.system.G, self.gust_input]),
            input_delays_s=np.append(self.system.input_delays_s, np.zeros(len(self.gust_std))),
        )

    def _require_shapes(self) -> None:
        u, y, g = len(self.inputs), len(self.outputs), len(self.gust_std)
        states = self.system.F.shape[0]
        rows = (
            ("inputs", (u,), (self.system.G.shape[1],)),
            ("outputs", (y,), (self.system.H0.shape[0],)),
            ("error", self.error.shape, (u, y)),
            ("proportional", (len(self.proportional),), (u,)),
            ("integral", (len(self.integral),), (u,)),
            ("noise_std", (len(self.noise_std),), (y,)),
            ("gust_input", self.gust_input.shape, (states, g)),
        )
        for name, came, needed in rows:
            if came != needed:
                raise ModelError(f"{name} of {self.name} has shape {came}", needed=f"shape {needed}")

    def _require_feedback(self) -> None:
        """The controller acts on what it has measured, and the vehicle on what it was commanded before."""
        shortest = float(self.system.input_delays_s.min(initial=np.inf))
        if shortest < 1.0 / STEP_RATE_HZ:
            raise ModelError(
                f"the input delay of {self.name} is {1e3 * shortest:g} ms",
                needed=f"at least one step of {1e3 / STEP_RATE_HZ:g} ms",
                remedy="use the delay of the real path",
            )
        at_once = np.any(self.gusty.proper()[3] != 0.0, axis=1) | (self.system.output_delays_s != 0.0)
        for name, wrong, fed in zip(self.outputs, at_once, np.any(self.error != 0.0, axis=0), strict=True):
            if wrong and fed:
                raise ModelError(
                    f"{name} of {self.name} cannot be fed back: it is delayed, or follows an input or a gust at once",
                    needed="states or sums of them",
                    remedy="feed back a rate, an angle or a speed",
                )


def fly_linear(
    loop: LinearLoop,
    excitation: FloatArray,
    *,
    sample_rate_hz: float = 200.0,
    maneuvers: Sequence[Maneuver] = (),
    rng: np.random.Generator,
) -> Flight:
    """Fly test inputs in closed loop and log commands, test inputs and outputs.

    Controller and vehicle advance at 1 kHz. Commands go linearly from one step to the next, with their fractional
    delays; between the steps the vehicle is exact. An output with a delay is read between two steps linearly. Nothing
    is limited: a loop that is not stable diverges.

    Parameters
    ----------
    loop
        Vehicle and controller.
    excitation
        Test inputs at 1 kHz, added to the commands after the controller, shape ``(u, steps)``.
    sample_rate_hz
        Rate of the log, 1 kHz divided by a whole number. Samples are picked, not averaged.
    maneuvers
        What the test inputs are, for a log that declares it; by default whoever reads it has to find out.
    rng
        Random generator of gusts and noise. Same generator state, same flight.

    Returns
    -------
    Flight
        Columns ``pitch_command``, ``pitch_excitation`` and the like, and the outputs; as differences from trim.

    Raises
    ------
    UsageError
        The rate does not divide 1 kHz, or the test inputs have another shape.

    Examples
    --------
    The yaw of the Hummingbird with a rate loop, 4 s on a calm day:

    >>> from rotorid.vehicles import hummingbird
    >>> loop = LinearLoop(name="yaw", system=hummingbird.yaw(), inputs=("yaw_command",), outputs=("r",),
    ...     error=-np.ones((1, 1)), proportional=(6.0,), integral=(6.0,), noise_std=(0.0,))
    >>> flight = fly_linear(loop, np.ones((1, 4000)), rng=np.random.default_rng(0))
    >>> list(flight.columns), flight.time_s.size
    (['yaw_command', 'yaw_excitation', 'r'], 800)

    The integral part of the controller takes the answer to the step out again:

    >>> rate = flight.columns["r"]
    >>> round(float(rate.max()), 2), bool(abs(rate[-1]) < 0.01)
    (0.08, True)
    """
    stride = stride_of(sample_rate_hz)
    values = np.asarray(excitation, dtype=np.float64)
    if values.ndim != 2 or values.shape[0] != len(loop.inputs) or not values.size:
        raise UsageError(f"the test inputs have shape {values.shape}", needed=f"({len(loop.inputs)}, steps)")
    commands, outputs = _advance(loop, values, rng)
    names = (*loop.inputs, *map(excitation_of, loop.inputs), *loop.outputs)
    rows = np.vstack([commands, values, outputs])[:, ::stride]
    return Flight(
        vehicle=loop.name,
        time_s=np.arange(rows.shape[1]) / sample_rate_hz,
        sample_rate_hz=sample_rate_hz,
        columns=dict(zip(names, rows, strict=True)),
        maneuvers=tuple(maneuvers),
    )


def excitation_of(name: str) -> str:
    """Channel of the test input that is added to a command.

    Parameters
    ----------
    name
        Of the command.

    Examples
    --------
    >>> excitation_of("pitch_command"), excitation_of("motor_3")
    ('pitch_excitation', 'motor_3_excitation')
    """
    return f"{name.removesuffix('_command')}_excitation"


def as_record(flight: Flight, units: Mapping[str, str] | None = None) -> FlightRecord:
    """A flight as the record that reading its log would give, without a file.

    Parameters
    ----------
    flight
        What :func:`fly_linear` or :func:`rotorid.simulation.hover_flight.fly` made. Its maneuvers become declared ones.
    units
        Channel to unit, where that is not the one of the vocabulary.

    Examples
    --------
    >>> from rotorid.simulation.hover_flight import SILENT, fly
    >>> from rotorid.vehicles import s500
    >>> calm = fly(s500.vehicle(), (), turbulence_m_s=0.0, noise=SILENT, rng=np.random.default_rng(0))
    >>> as_record(calm).channel_names[:4]
    ('roll_command', 'pitch_command', 'yaw_command', 'thrust_command')
    """
    values = np.stack(list(flight.columns.values()))
    topic = Topic(
        name=flight.vehicle,
        time_s=flight.time_s,
        channels=tuple(
            Channel(name=name, unit=(units or {}).get(name) or STANDARD_UNITS.get(name, "1")) for name in flight.columns
        ),
        values=values,
    )
    digest = hashlib.sha256(values.tobytes()).hexdigest()
    return FlightRecord(
        source=Source(name=flight.vehicle, format="simulated", sha256=digest),
        topics=(topic,),
        declared=flight.maneuvers,
        instruments=_instruments(flight.columns, flight.maneuvers),
    )


def _instruments(columns: Mapping[str, FloatArray], maneuvers: Sequence[Maneuver]) -> dict[str, tuple[str, ...]]:
    """Axes with a declared excitation, and the test input that made it."""
    known = {maneuver.axis: f"{maneuver.axis}_excitation" for maneuver in maneuvers}
    return {axis: (name,) for axis, name in known.items() if name in columns}


def _advance(loop: LinearLoop, excitation: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Commands and measured outputs, shapes ``(u, steps)`` and ``(y, steps)``."""
    from rotorid.simulation.linear_kernels import closed_loop

    inputs, steps = excitation.shape
    step, C, D = _discrete(loop)
    gusts = np.array([_gust(loop, each, steps, rng) for each in loop.gust_std]).reshape(-1, steps)
    noise = np.array(loop.noise_std) * rng.standard_normal((steps, len(loop.outputs)))
    # Gusts are known beforehand; only the commands depend on the flight.
    past = np.append(np.zeros(inputs), gusts[:, 0])
    states, commands = closed_loop(
        step.transition,
        np.ascontiguousarray(step.taps[:, :inputs]),
        step.lags[:inputs],
        step.forcing(np.vstack([np.zeros_like(excitation), gusts]), past),
        np.ascontiguousarray(C),
        noise,
        loop.error,
        np.array(loop.proportional),
        np.array(loop.integral) / STEP_RATE_HZ,
        np.ascontiguousarray(excitation.T),
    )
    exact = C @ states.T + D @ step.delayed(np.vstack([commands.T, gusts]), past)
    delayed = [_delayed(y, delay_s) for y, delay_s in zip(exact, loop.system.output_delays_s, strict=True)]
    return commands.T, np.stack(delayed) + noise.T


def _discrete(loop: LinearLoop) -> tuple[Discretized, FloatArray, FloatArray]:
    """A step of the vehicle for commands and gusts, and its output matrices."""
    system = loop.gusty
    A, B, C, D = system.proper()
    step = discretize(A, B, delays_s=system.input_delays_s, step_s=1.0 / STEP_RATE_HZ, hold="first")
    return step, C, D


def _gust(loop: LinearLoop, std: float, steps: int, rng: np.random.Generator) -> FloatArray:
    return gauss_markov(
        steps, intensity=std, correlation_s=loop.gust_correlation_s, sample_rate_hz=STEP_RATE_HZ, rng=rng
    )


def _delayed(values: FloatArray, delay_s: float) -> FloatArray:
    """A signal that goes linearly between steps, read with a delay."""
    if not delay_s:
        return values
    clock = np.arange(values.size)
    delayed: FloatArray = np.interp(clock - delay_s * STEP_RATE_HZ, clock, values)
    return delayed
