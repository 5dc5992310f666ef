"""Flights of every published model in closed loop, and what the identification makes of each of them.

A twin is a published model with an autopilot that holds it, a plan of sweeps, gusts and noisy sensors. Each flight goes
the way of a user's log: one record in, responses with the injected sweeps as instruments, the model of the library
fitted from its own start values. What the publication dropped is held at zero, everything else is free.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Maneuver, Source, Topic
from rotorid.excitation.sweep import pilot_sweep
from rotorid.fits.frequency.fit import pose
from rotorid.fitting.frequency.fit import fit_frequency, refine
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.flights.flights import Flight
from rotorid.flights.measure import measure
from rotorid.models.library import library_model
from rotorid.settings.identifying import IdentifySettings
from rotorid.simulation.hover_flight import Excitation, fly
from rotorid.simulation.linear_loop import LinearLoop, fly_linear
from rotorid.typing import Axis, FloatArray
from rotorid.uncertainty.cramer_rao import Bounds, Weights, bounds
from rotorid.vehicles import hummingbird, rig, s500

STEP_HZ = 1000.0
BAND = (2.0 * math.pi * 0.1, 2.0 * math.pi * 8.0)
SWEEP_S, REST_S = 50.0, 5.0
GYRO, ATTITUDE, SPEED, ACCELEROMETER = 0.01, 0.002, 0.03, 0.1
"""Standard deviations of the noise of a sample, those of :class:`rotorid.simulation.hover_flight.SensorNoise`."""


@dataclass(frozen=True, kw_only=True)
class Twin:
    """A published model that flies.

    ``truth`` holds the parameters that the publication kept; ``held`` those that it dropped or that cannot be seen.
    """

    model: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    truth: Mapping[str, float]
    held: Mapping[str, float]
    flight: Callable[[np.random.Generator], FlightRecord]
    settings: Mapping[str, object] = field(default_factory=dict)


def record_of(columns: Mapping[str, FloatArray], log_hz: float, maneuvers: Sequence[Maneuver]) -> FlightRecord:
    """Columns as a log with one clock."""
    units = {name: STANDARD_UNITS.get(name, "1") for name in columns}
    topic = Topic(
        name="twin",
        time_s=np.arange(next(iter(columns.values())).size) / log_hz,
        channels=tuple(Channel(name=name, unit=unit) for name, unit in units.items()),
        values=np.stack(list(columns.values())),
    )
    known = {axis: (f"{axis}_excitation",) for axis in {m.axis for m in maneuvers} if f"{axis}_excitation" in columns}
    source = Source(name="twin", format="twin", sha256="")
    return FlightRecord(source=source, topics=(topic,), declared=tuple(maneuvers), instruments=known)


def sweep(
    amplitude: float, rng: np.random.Generator, band: tuple[float, float] = BAND, duration_s: float = SWEEP_S
) -> FloatArray:
    return pilot_sweep(
        amplitude=amplitude,
        band_rad_s=band,
        duration_s=duration_s,
        sample_rate_hz=STEP_HZ,
        fade_s=0.5,
        trim_s=0.0,
        noise_fraction=0.1,
        rng=rng,
    )


def plan(
    amplitudes: Mapping[Axis, float],
    rng: np.random.Generator,
    band: tuple[float, float] = BAND,
    duration_s: float = SWEEP_S,
) -> tuple[Excitation, ...]:
    """Two sweeps on each axis, one after the other, with rests between them."""
    parts = []
    start_s = REST_S
    for axis, amplitude in amplitudes.items():
        for _ in range(2):
            stop_s = start_s + duration_s
            maneuver = Maneuver(
                axis=axis,
                kind="sweep",
                start_s=start_s,
                stop_s=stop_s,
                band_rad_s=band,
                origin="declared",
                signal=f"{axis}_excitation",
            )
            values = sweep(amplitude, rng, band, duration_s)
            parts.append(Excitation(maneuver=maneuver, values=values, sample_rate_hz=STEP_HZ))
            start_s = stop_s + REST_S
    return tuple(parts)


def flown(loop: LinearLoop, parts: Sequence[Excitation], rng: np.random.Generator) -> FlightRecord:
    """The log of a loop with one input that flies a plan."""
    steps = round((parts[-1].maneuver.stop_s + REST_S) * STEP_HZ)
    excitation = np.zeros((1, steps))
    for part in parts:
        first = round(part.maneuver.start_s * STEP_HZ)
        excitation[0, first : first + part.values.size] += part.values
    log = fly_linear(loop, excitation, rng=rng)
    return record_of(log.columns, log.sample_rate_hz, [part.maneuver for part in parts])


# The S500 flies with the autopilot and the gusts that ship with it.


def s500_flight(amplitudes: Mapping[Axis, float]) -> Callable[[np.random.Generator], FlightRecord]:
    def flight(rng: np.random.Generator) -> FlightRecord:
        log = fly(s500.vehicle(), plan(amplitudes, rng), rng=rng)
        kept = {name: values for name, values in log.columns.items() if not name.endswith("_setpoint")}
        return record_of(kept, log.sample_rate_hz, log.maneuvers)

    return flight


def without_zeros(truth: Mapping[str, float]) -> dict[str, float]:
    return {name: value for name, value in truth.items() if value}


def zeros(truth: Mapping[str, float]) -> dict[str, float]:
    return {name: value for name, value in truth.items() if not value}


LONGITUDINAL = Twin(
    model="hover.longitudinal",
    inputs=("pitch_command", "thrust_command"),
    outputs=("q", "u", "w", "theta", "ax", "az"),
    truth=without_zeros(s500.LONGITUDINAL),
    held={**zeros(s500.LONGITUDINAL), "T_motor": 0.0},
    flight=s500_flight({"pitch": 0.04, "thrust": 0.1}),
)

LATERAL = Twin(
    model="hover.lateral",
    inputs=("roll_command", "yaw_command"),
    outputs=("p", "r", "v", "phi", "ay"),
    truth=without_zeros(s500.LATERAL),
    held={**zeros(s500.LATERAL), "T_motor": 0.0, "N_spin": 0.0},
    flight=s500_flight({"roll": 0.035, "yaw": 0.1}),
)

# Its autopilot was not published: rate, angle and drift in pitch, rate and heading in yaw, climb in heave.
GUST_M_S, GUST_TORQUE = 0.08, 0.1

HUMMINGBIRD_PITCH = LinearLoop(
    name="hummingbird pitch",
    system=hummingbird.pitch(),
    inputs=("pitch_command",),
    outputs=("q", "u", "theta", "ax"),
    error=np.array([[-1.0, 0.5, -3.5, 0.0]]),
    proportional=(4.0,),
    integral=(3.0,),
    noise_std=(GYRO, SPEED, ATTITUDE, ACCELEROMETER),
    gust_input=-hummingbird.pitch().F[:, [1]],
    gust_std=(GUST_M_S,),
)


def hummingbird_flight(
    loop: LinearLoop, axis: Axis, amplitude: float, band: tuple[float, float] = BAND
) -> Callable[[np.random.Generator], FlightRecord]:
    return lambda rng: flown(loop, plan({axis: amplitude}, rng, band), rng)


PITCH = Twin(
    model="axis.pitch",
    inputs=("pitch_command",),
    outputs=("q", "ax"),
    truth=without_zeros(hummingbird.PITCH),
    held=zeros(hummingbird.PITCH),
    flight=hummingbird_flight(HUMMINGBIRD_PITCH, "pitch", 3.0),
)

HUMMINGBIRD_YAW = LinearLoop(
    name="hummingbird yaw",
    system=hummingbird.yaw(),
    inputs=("yaw_command",),
    outputs=("r",),
    error=np.array([[-1.0]]),
    proportional=(6.0,),
    integral=(6.0,),
    noise_std=(GYRO,),
    gust_input=np.array([[1.0], [0.0]]),
    gust_std=(GUST_TORQUE,),
)

YAW = Twin(
    model="axis.yaw",
    inputs=("yaw_command",),
    outputs=("r",),
    truth=without_zeros(hummingbird.YAW),
    held=zeros(hummingbird.YAW),
    flight=hummingbird_flight(HUMMINGBIRD_YAW, "yaw", 10.0, (BAND[0], 2.0 * math.pi * 12.0)),
)

HUMMINGBIRD_VERTICAL = LinearLoop(
    name="hummingbird vertical",
    system=hummingbird.vertical(),
    inputs=("thrust_command",),
    outputs=("w", "az"),
    error=np.array([[1.0, 0.0]]),
    proportional=(5.0,),
    integral=(1.0,),
    noise_std=(SPEED, ACCELEROMETER),
    gust_input=np.array([[0.5934]]),
    gust_std=(GUST_M_S,),
)

VERTICAL = Twin(
    model="axis.vertical",
    inputs=("thrust_command",),
    outputs=("az",),
    truth=without_zeros(hummingbird.VERTICAL),
    held=zeros(hummingbird.VERTICAL),
    flight=hummingbird_flight(HUMMINGBIRD_VERTICAL, "thrust", 10.0, (0.3, BAND[1])),
)

# The rig of the third paper, 120 s at 100 Hz: both motors are swept at once, one upward and one downward.
RIG_S, RIG_HZ, RIG_WINDOWS_S = 120.0, 100.0, (71.0, 60.0, 40.0)
RIG_BAND = (0.15, 12.0)
RIG_AMPLITUDE_V = 0.6

RIG = LinearLoop(
    name="rig",
    system=rig.roll(),
    inputs=("motor_3", "motor_4"),
    outputs=("phi", "p"),
    error=np.array([[-0.3, -1.0], [0.3, 1.0]]),
    proportional=(1.2, 1.2),
    integral=(0.0, 0.0),
    noise_std=(0.01, GYRO),
    gust_input=np.zeros((2, 1)),
    gust_std=(0.0,),
)


def rig_flight(rng: np.random.Generator) -> FlightRecord:
    up, down = (sweep(RIG_AMPLITUDE_V, rng, RIG_BAND, RIG_S) for _ in range(2))
    columns = fly_linear(RIG, np.stack([up, down[::-1]]), sample_rate_hz=RIG_HZ, rng=rng).columns
    whole = Maneuver(axis="roll", kind="sweep", start_s=0.0, stop_s=RIG_S, band_rad_s=RIG_BAND, origin="declared")
    return record_of(columns, RIG_HZ, [whole])


RIG_ROLL = Twin(
    model="rig.roll",
    inputs=("motor_3", "motor_4"),
    outputs=("phi",),
    truth={name: rig.TRUTH[name] for name in ("K_f", "tau_3", "tau_4")},
    held={"J_x": rig.TRUTH["J_x"]},
    flight=rig_flight,
    settings={"windows_s": RIG_WINDOWS_S, "instruments": ("motor_3_excitation", "motor_4_excitation")},
)

TWINS = {twin.model: twin for twin in (LONGITUDINAL, LATERAL, PITCH, YAW, VERTICAL, RIG_ROLL)}


@dataclass(frozen=True, kw_only=True)
class Result:
    """What came out of one flight: errors of the estimates and their stated standard deviations, by weights.

    The deviations are those of random errors: a twin is linear, and its structure leaves nothing out.
    """

    names: tuple[str, ...]
    error: Mapping[Weights, FloatArray]
    std: Mapping[Weights, FloatArray]


def problem_of(twin: Twin, record: FlightRecord) -> FrequencyProblem:
    settings = IdentifySettings(fix=twin.held, outputs=twin.outputs, **twin.settings)  # type: ignore[arg-type]
    whole = library_model(twin.model).select(outputs=twin.outputs, inputs=twin.inputs)
    data = measure(
        [Flight(record, maneuver) for maneuver in record.declared],
        inputs=whole.inputs,
        outputs=whole.outputs,
        settings=settings,
    )
    return pose(whole, data, settings)


def refined(problem: FrequencyProblem) -> tuple[FloatArray, Bounds]:
    """Values and their uncertainty, with weights by the covariance of all errors."""
    found = refine(problem, fit_frequency(problem))
    return found.theta, bounds(problem, found, weights="covariance")


def identify(twin: Twin, seed: int) -> Result:
    """Fly with a seed and identify, with both kinds of weights."""
    problem = problem_of(twin, twin.flight(np.random.default_rng(seed)))
    plain = fit_frequency(problem)
    found = {"cifer": plain, "covariance": refine(problem, plain)}
    truth = np.array([twin.truth[name] for name in problem.parameters.free])
    return Result(
        names=problem.parameters.free,
        error={weights: one.theta - truth for weights, one in found.items()},  # type: ignore[misc]
        std={weights: bounds(problem, one, weights=weights).random_std for weights, one in found.items()},  # type: ignore[misc]
    )
