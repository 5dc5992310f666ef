r"""Logs of a plan that an identified model flies by itself: plan, fly, identify for one's own model.

A model of set-points flies as it is. A linear model of the airframe, whose inputs are commands, drifts or falls without
a controller; it gets one that its own equations give, a linear quadratic regulator of the sampled model with its delay,

.. math:: u_k = w_k + K_\theta r_k - K x_k, \qquad
    K = \arg\min \sum_k \bigl(y_k^T Q y_k + u_k^T R u_k\bigr)

with the test input :math:`w` of the plan at the commands, or :math:`r` at attitudes and rates. It acts on the true
motion, so that noise of the sensors does not reach the commands; air is still. The log has commands, test inputs, and
outputs with white noise: that of the flight which the model was identified from where the result knows it, as fits in
time do, else that of usual sensors.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.flight_plan import FlightPlan, PlannedInput
from rotorid.data.record import AXES, STANDARD_UNITS
from rotorid.errors import ModelError, UsageError
from rotorid.models.state_space import StateSpace
from rotorid.results.model import IdentifiedModel, SimulatedRecord
from rotorid.simulation.multirotor import Sensors
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

_TURNS = 2
"""Turns of the controller for each sample of the log."""

_USUAL_HZ = 250.0
_FASTEST_HZ = 500.0
_SLOWEST_HZ = 100.0

_SIZES: Mapping[str, float] = {"rad/s": 1.0, "rad": 0.3, "m/s": 2.0}
"""Motion by its unit that the controller weighs as much as :data:`_COMMAND`."""

_COMMAND = 0.15

_REMAINS = 1e-6
"""Weight of states that no output shows, such as a heading."""

_STICK: Mapping[str, tuple[tuple[str, float], ...]] = {
    "roll": (("phi", 0.6), ("p", 3.0)),
    "pitch": (("theta", 0.6), ("q", 3.0)),
    "yaw": (("r", 3.0),),
    "thrust": (("w", -2.0),),
}
"""What a full stick asks for, the first that a model has: tilt in rad, turn in rad/s, climb in m/s."""

_HEADING_1_S = 3.0
"""Turn in rad/s by error of the heading in rad."""

_ANGLES = {"roll": "phi", "pitch": "theta", "yaw": "r"}
_RATES = {"roll": "p", "pitch": "q", "yaw": "r"}

TRIM: Mapping[str, float] = {"thrust_command": 0.5, "az": -STANDARD_GRAVITY_M_S2}
"""Of a vehicle that hovers, to which a model about hover adds its motion."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelFlight(Immutable):
    """A plan as a model flew it, without noise.

    Parameters
    ----------
    time_s
        Stamps, shape ``(samples,)``.
    inputs, outputs
        By name; as the model has them, differences from trim.
    asked
        Test inputs and set-points by channel.
    left
        What of the plan moved nothing of the model.
    """

    time_s: FloatArray
    inputs: Mapping[str, FloatArray]
    outputs: Mapping[str, FloatArray]
    asked: Mapping[str, FloatArray] = field(default_factory=dict)
    left: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self._set(
            time_s=read_only(self.time_s, np.float64, ndim=1),
            inputs=self.inputs,
            outputs=self.outputs,
            asked=self.asked,
            left=tuple(self.left),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelLog(Immutable):
    """A log of such a flight.

    Parameters
    ----------
    file
        Its name.
    seed, run
        Of its noise.
    time_s, columns
        Stamps, and samples by channel.
    noise
        Output to the standard deviation of its white noise, in its unit.
    assumed
        Outputs whose noise is that of usual sensors, since the result does not know it.
    """

    file: str
    seed: int
    run: int
    time_s: FloatArray
    columns: Mapping[str, FloatArray]
    noise: Mapping[str, float]
    assumed: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self._set(columns=self.columns, noise=self.noise, assumed=tuple(self.assumed))


def flies_under_control(model: IdentifiedModel) -> bool:
    """Whether a model is a linear airframe by commands, which a plan can move with a controller around it."""
    commands = {f"{axis}_command" for axis in AXES}
    return model.motors is None and model.nonlinear is None and set(model.structure.inputs) <= commands


def sample_rate_of(model: IdentifiedModel) -> float:
    """Rate of the data that a model was identified from, within what a simulation takes."""
    rate_hz = model.data.response.sample_rate_hz or _USUAL_HZ
    return float(np.clip(rate_hz, _SLOWEST_HZ, _FASTEST_HZ))


def fly_under_control(model: IdentifiedModel, plan: FlightPlan) -> ModelFlight:
    """A linear model of the airframe through a plan, from rest, with a controller that keeps it in the air.

    Parameters
    ----------
    model
        Its inputs are commands.
    plan
        Test inputs at commands, attitudes, rates or sticks.

    Raises
    ------
    UsageError
        The plan moves nothing of the model.
    ModelError
        The model has no proper state space, or no controller holds it.
    """
    structure, log_hz = model.structure, sample_rate_of(model)
    rate_hz = _TURNS * log_hz
    system = model.system
    # A command that is held over a turn acts half a turn late, which is no delay of the model.
    whole = replace(
        system,
        input_delays_s=np.maximum(system.input_delays_s - 0.5 / rate_hz, 0.0),
        output_delays_s=np.zeros_like(system.output_delays_s),
    )
    from rotorid.simulation.rational_model import rational

    sampled = rational(whole, delays="states", sample_rate_hz=rate_hz, states=structure.states)
    gains = _regulator(sampled.A, sampled.B, _weighed(sampled.C, structure.outputs, sampled.states))
    count = _TURNS * round(plan.duration_s * log_hz) + 1
    time_s = np.arange(count) / rate_hz
    added = np.zeros((len(structure.inputs), count))
    asked: dict[str, FloatArray] = {}
    left = []
    for planned in plan.inputs:
        found = _entered(planned, structure.inputs, sampled.states, gains)
        if found is None:
            left.append(f"{planned.axis} by {planned.entry.replace('_', ' ')}")
            continue
        by_input, channel, factor = found
        values = shown = planned.at(time_s)
        if planned.entry == "attitude_setpoint" and planned.axis == "yaw":
            channel, values = "psi_setpoint", _turning(shown, rate_hz)
        added += by_input[:, None] * values
        asked[channel] = asked.get(channel, np.zeros(count)) + factor * shown
    if not added.any():
        raise UsageError(
            f"the plan moves {', '.join(dict.fromkeys(left))}, which {model.name} does not have",
            needed=f"a plan that moves {' or '.join(structure.inputs)}",
        )
    states = _closed(sampled.A - sampled.B @ gains, sampled.B @ added)
    commands = added - gains @ states
    rows = sampled.C @ states + sampled.D @ commands
    logged = slice(None, None, _TURNS)
    rows = np.stack([_late(time_s, row, late_s) for row, late_s in zip(rows, _behind(system), strict=True)])
    return ModelFlight(
        time_s=time_s[logged],
        inputs={name: row[logged] for name, row in zip(structure.inputs, commands, strict=True)},
        outputs={name: row[logged] for name, row in zip(structure.outputs, rows, strict=True)},
        asked={name: row[logged] for name, row in asked.items()},
        left=tuple(dict.fromkeys(left)),
    )


def _turning(heading: FloatArray, rate_hz: float) -> FloatArray:
    """The turn that a loop of a heading asks for, which models of rates do not have."""
    from scipy.signal import lfilter

    share = _HEADING_1_S / rate_hz
    followed = lfilter([0.0, share], [1.0, share - 1.0], heading)
    return np.asarray(_HEADING_1_S * (heading - followed))


def _behind(system: StateSpace) -> FloatArray:
    return np.maximum(system.output_delays_s, 0.0)


def _weighed(C: FloatArray, outputs: tuple[str, ...], states: tuple[str, ...]) -> FloatArray:
    """Rates, angles and speeds among outputs and states over their sizes; a heading is free."""
    rows = np.concatenate([C, np.eye(len(states))])
    sizes = [_SIZES.get(STANDARD_UNITS.get(name, ""), np.inf) for name in (*outputs, *states)]
    return np.asarray(rows / np.where([name == "psi" for name in (*outputs, *states)], np.inf, sizes)[:, None])


def _regulator(A: FloatArray, B: FloatArray, weighed: FloatArray) -> FloatArray:
    """Gains of the states, shape ``(u, x)``.

    Raises
    ------
    ModelError
        No gains hold the model.
    """
    from scipy.linalg import solve_discrete_are

    Q = weighed.T @ weighed + _REMAINS * np.eye(len(A))
    R = np.eye(B.shape[1]) / _COMMAND**2
    try:
        P = solve_discrete_are(A, B, Q, R)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise ModelError(
            "no controller keeps this model in the air",
            needed="commands that reach every mode that grows",
            remedy="simulate it as a vehicle with --like NAME",
        ) from error
    return np.asarray(np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A))


def _entered(
    planned: PlannedInput, inputs: tuple[str, ...], states: tuple[str, ...], gains: FloatArray
) -> tuple[FloatArray, str, float] | None:
    """What a test input adds to each command, its channel and the factor of that; ``None`` where it moves nothing."""
    command = f"{planned.axis}_command"
    if planned.entry == "command":
        if command not in inputs:
            return None
        return np.eye(len(inputs))[inputs.index(command)], planned.signal, 1.0
    asks = {
        "stick": _STICK.get(planned.axis, ()),
        "attitude_setpoint": ((_ANGLES.get(planned.axis, ""), 1.0),),
        "rate_setpoint": ((_RATES.get(planned.axis, ""), 1.0),),
    }[planned.entry]
    state, factor = next(((name, size) for name, size in asks if name in states), ("", 0.0))
    if command not in inputs or not state:
        return None
    channel, shown = (planned.signal, 1.0) if planned.entry == "stick" else (f"{state}_setpoint", factor)
    return factor * gains[:, states.index(state)], channel, shown


def _closed(A: FloatArray, driven: FloatArray) -> FloatArray:
    """States of a sampled system from rest, shape ``(x, samples)``."""
    states = np.zeros((driven.shape[1], len(A)))
    x = states[0]
    for k, push in enumerate(driven.T[:-1]):
        x = A @ x + push
        states[k + 1] = x
    return states.T


def _late(time_s: FloatArray, row: FloatArray, late_s: float) -> FloatArray:
    """A smooth signal by a delay later, at rest before."""
    if late_s == 0.0:
        return row
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(time_s, row)(np.maximum(time_s - late_s, 0.0)))


# Noise


def noise_of(model: IdentifiedModel, sample_rate_hz: float) -> tuple[dict[str, float], tuple[str, ...]]:
    r"""White noise of each output, in its unit, and the outputs whose noise is assumed.

    Known noise keeps its density: at another rate :math:`f` its deviation is :math:`\sigma \sqrt{f / f_0}`.

    Parameters
    ----------
    model
        Of a fit in time, its result holds the deviation of each output from the model.
    sample_rate_hz
        Of the log.
    """
    sensors, rates_hz = Sensors(), [_rate_of(record) for record in model.data.simulated]
    factor = float(np.sqrt(sample_rate_hz / np.mean(rates_hz))) if rates_hz else 1.0
    known = {name: factor * std for name, std in (model.fit.noise or {}).items()}
    usual = {
        **dict.fromkeys(("p", "q", "r"), sensors.gyro_noise_rad_s),
        **dict.fromkeys(("ax", "ay", "az"), sensors.accelerometer_noise_m_s2),
        **dict.fromkeys(("phi", "theta", "psi"), sensors.attitude_noise_rad),
        **dict.fromkeys(("north", "east", "down"), sensors.position_noise_m),
    }
    by_unit = {"m/s": sensors.velocity_noise_m_s, "m": sensors.position_noise_m, "rad": sensors.attitude_noise_rad}
    names = model.nonlinear.outputs if model.nonlinear is not None else model.structure.outputs
    noise = {name: known.get(name, usual.get(name, by_unit.get(STANDARD_UNITS.get(name, ""), 0.0))) for name in names}
    return noise, tuple(name for name in names if name not in known)


def _rate_of(record: SimulatedRecord) -> float:
    return float((record.time_s.size - 1) / (record.time_s[-1] - record.time_s[0]))


def model_logs(model: IdentifiedModel, flight: ModelFlight, *, seed: int = 0, runs: int = 1) -> tuple[ModelLog, ...]:
    """Logs of a flight, each with its own noise.

    Parameters
    ----------
    model
        What flew.
    flight
        Its motion.
    seed, runs
        Of the noise, and how many logs.
    """
    rate_hz = (flight.time_s.size - 1) / float(flight.time_s[-1] - flight.time_s[0])
    noise, assumed = noise_of(model, rate_hz)
    commands = {name: row + TRIM.get(name, 0.0) for name, row in flight.inputs.items()}
    digits = len(str(runs))
    logs = []
    for run in range(runs):
        rng = np.random.default_rng([seed, run])
        outputs = {
            name: row + TRIM.get(name, 0.0) + noise[name] * rng.standard_normal(row.size)
            for name, row in flight.outputs.items()
            if name in STANDARD_UNITS and not name.endswith("_dot")
        }
        logs.append(
            ModelLog(
                file="flight.csv" if runs == 1 else f"flight_{run + 1:0{digits}d}.csv",
                seed=seed,
                run=run,
                time_s=flight.time_s,
                columns={**commands, **flight.asked, **outputs},
                noise={name: noise[name] for name in outputs},
                assumed=tuple(name for name in assumed if name in outputs),
            )
        )
    return tuple(logs)
