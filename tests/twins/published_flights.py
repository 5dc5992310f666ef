"""Flights of every published model in closed loop, and what the identification makes of them.

A twin is a published model with an autopilot that holds it, a plan of test inputs, gusts and noisy sensors. Its flights go
the way of a user's log: one record in, joint responses with the injected signals as instruments and default settings, the
model of the library fitted from its own start values. What the publication dropped is held at zero; all else is free.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rotorid.data.channel import STANDARD_UNITS, Channel
from rotorid.data.maneuver import Maneuver
from rotorid.data.record import FlightRecord, Source, Topic
from rotorid.excitation.sweep import pilot_sweep
from rotorid.fit.covariance_fit import refine
from rotorid.fit.identify import fit
from rotorid.fit.problem import FrequencyProblem
from rotorid.models.catalog import library_model
from rotorid.models.state_space import StateSpace
from rotorid.pipeline.fitting import pose
from rotorid.pipeline.measure import measure
from rotorid.pipeline.settings import IdentifySettings
from rotorid.simulate.flight import STEP_RATE_HZ, Excitation, SensorNoise, fly
from rotorid.simulate.hold import discretize
from rotorid.simulate.turbulence import gauss_markov
from rotorid.typing import Axis, FloatArray
from rotorid.uncertainty.bounds import Weights, bounds
from rotorid.vehicles import hummingbird, rig, s500

Band = tuple[float, float]
Fly = Callable[[np.random.Generator], FlightRecord]

BAND: Band = (2.0 * math.pi * 0.1, 2.0 * math.pi * 8.0)
SWEEPS, SWEEP_S, REST_S = 2, 50.0, 5.0
GUST_S = 1.0
"""Correlation time of gusts."""

NOISE = SensorNoise()


@dataclass(frozen=True, kw_only=True)
class Twin:
    """A published model that flies.

    ``truth`` holds what the publication kept, ``held`` what it dropped or what no flight can show; ``settings`` are those
    beside the default ones.
    """

    model: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    truth: Mapping[str, float]
    held: Mapping[str, float]
    flight: Fly
    settings: Mapping[str, tuple[float, ...] | tuple[str, ...]] = field(default_factory=dict)

    @property
    def weights(self) -> Weights:
        """Those that the pipeline takes by itself."""
        return "covariance" if len(self.outputs) > 1 else "cifer"


@dataclass(frozen=True, kw_only=True)
class Loop:
    """A vehicle under proportional-integral control of combinations of its outputs, pushed by gusts.

    ``error`` takes outputs to the error of each input, ``gusts`` are columns of the state equation and ``strength`` their
    standard deviations, ``noise`` is that of each sample of an output.
    """

    system: StateSpace
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    error: FloatArray
    proportional: tuple[float, ...]
    integral: tuple[float, ...]
    noise: tuple[float, ...]
    gusts: FloatArray
    strength: tuple[float, ...]
    log_hz: float = 200.0

    def fly(self, excitation: FloatArray, rng: np.random.Generator) -> dict[str, FloatArray]:
        """Columns of a log; ``excitation`` is added to the commands, shape ``(u, steps)``.

        Commands and gusts go linearly from one millisecond to the next, between which the vehicle is exact; the log
        picks samples.
        """
        from rotorid.simulate.kernels import closed_loop

        steps, inputs = excitation.shape[1], len(self.inputs)
        A, B, C, D = self.system.proper()
        pushed = np.linalg.solve(self.system.M, self.gusts)
        delays_s = np.append(self.system.input_delays_s, np.zeros(pushed.shape[1]))
        step = discretize(A, np.hstack([B, pushed]), delays_s=delays_s, step_s=1.0 / STEP_RATE_HZ, hold="first")
        gusts = np.stack([_gust(steps, intensity, rng) for intensity in self.strength])
        past = np.append(np.zeros(inputs), gusts[:, 0])
        noise = np.array(self.noise) * rng.standard_normal((steps, len(self.outputs)))
        states, commands = closed_loop(
            step.transition,
            np.ascontiguousarray(step.taps[:, :inputs]),
            step.lags[:inputs],
            step.forcing(np.vstack([np.zeros_like(excitation), gusts]), past),
            np.ascontiguousarray(C),
            noise,
            self.error,
            np.array(self.proportional),
            np.array(self.integral) / STEP_RATE_HZ,
            np.ascontiguousarray(excitation.T),
        )
        late = step.delayed(np.vstack([commands.T, gusts]), past)
        # An output that shows a derivative shows what inputs and gusts do to it at once.
        outputs = C @ states.T + np.hstack([D, self.system.H1 @ pushed]) @ late
        outputs = np.stack([_later(y, d) for y, d in zip(outputs, self.system.output_delays_s, strict=True)]) + noise.T
        rows = (*commands.T, *excitation, *outputs)
        names = (*self.inputs, *map(excitation_of, self.inputs), *self.outputs)
        every = slice(None, None, round(STEP_RATE_HZ / self.log_hz))
        return {name: row[every] for name, row in zip(names, rows, strict=True)}


def _gust(steps: int, intensity: float, rng: np.random.Generator) -> FloatArray:
    return gauss_markov(steps, intensity=intensity, correlation_s=GUST_S, sample_rate_hz=STEP_RATE_HZ, rng=rng)


def _later(values: FloatArray, delay_s: float) -> FloatArray:
    """A signal that goes linearly between steps, read with a delay."""
    clock = np.arange(values.size)
    return np.interp(clock - delay_s * STEP_RATE_HZ, clock, values)


def excitation_of(name: str) -> str:
    return f"{name.removesuffix('_command')}_excitation"


def record_of(columns: Mapping[str, FloatArray], log_hz: float, maneuvers: Sequence[Maneuver]) -> FlightRecord:
    """Columns as a log with one clock, which declares its maneuvers."""
    channels = tuple(Channel(name=name, unit=STANDARD_UNITS.get(name, "1")) for name in columns)
    values = np.stack(list(columns.values()))
    topic = Topic(name="log", time_s=np.arange(values.shape[1]) / log_hz, channels=channels, values=values)
    injected = {m.axis: (m.signal,) for m in maneuvers if m.signal}
    source = Source(name="twin", format="twin", sha256="")
    return FlightRecord(source=source, topics=(topic,), declared=tuple(maneuvers), instruments=injected)


def plan(amplitudes: Mapping[Axis, float], band: Band, rng: np.random.Generator) -> tuple[Excitation, ...]:
    """Sweeps of each axis, one after the other, with rests around them."""
    parts = []
    start_s = REST_S
    for axis, amplitude in amplitudes.items():
        for _ in range(SWEEPS):
            values = pilot_sweep(
                amplitude=amplitude,
                band_rad_s=band,
                duration_s=SWEEP_S,
                sample_rate_hz=STEP_RATE_HZ,
                fade_s=0.5,
                trim_s=0.0,
                noise_fraction=0.1,
                rng=rng,
            )
            maneuver = Maneuver(
                axis=axis,
                kind="sweep",
                start_s=start_s,
                stop_s=start_s + SWEEP_S,
                band_rad_s=band,
                origin="declared",
                signal=f"{axis}_excitation",
            )
            parts.append(Excitation(maneuver=maneuver, values=values, sample_rate_hz=STEP_RATE_HZ))
            start_s += SWEEP_S + REST_S
    return tuple(parts)


def sweeps_of(loop: Loop, axis: Axis, amplitude: float, band: Band = BAND) -> Fly:
    """Flights of a loop with one input that is swept."""

    def flight(rng: np.random.Generator) -> FlightRecord:
        parts = plan({axis: amplitude}, band, rng)
        excitation = np.zeros((1, round((parts[-1].maneuver.stop_s + REST_S) * STEP_RATE_HZ)))
        for part in parts:
            first = round(part.maneuver.start_s * STEP_RATE_HZ)
            excitation[0, first : first + part.values.size] = part.values
        return record_of(loop.fly(excitation, rng), loop.log_hz, [part.maneuver for part in parts])

    return flight


def sweeps_of_s500(amplitudes: Mapping[Axis, float]) -> Fly:
    """Flights of the S500 with the autopilot and the gusts that ship with it."""

    def flight(rng: np.random.Generator) -> FlightRecord:
        log = fly(s500.vehicle(), plan(amplitudes, BAND, rng), rng=rng)
        return record_of(log.columns, log.sample_rate_hz, log.maneuvers)

    return flight


def kept(truth: Mapping[str, float]) -> dict[str, float]:
    return {name: value for name, value in truth.items() if value}


def dropped(truth: Mapping[str, float]) -> dict[str, float]:
    return {name: value for name, value in truth.items() if not value}


LONGITUDINAL = Twin(
    model="hover.longitudinal",
    inputs=("pitch_command", "thrust_command"),
    outputs=("q", "u", "w", "theta", "ax", "az"),
    truth=kept(s500.LONGITUDINAL),
    held={**dropped(s500.LONGITUDINAL), "T_motor": 0.0},
    flight=sweeps_of_s500({"pitch": 0.04, "thrust": 0.1}),
)

LATERAL = Twin(
    model="hover.lateral",
    inputs=("roll_command", "yaw_command"),
    outputs=("p", "r", "v", "phi", "ay"),
    truth=kept(s500.LATERAL),
    held={**dropped(s500.LATERAL), "T_motor": 0.0},
    flight=sweeps_of_s500({"roll": 0.035, "yaw": 0.1}),
)

# The Hummingbird's autopilot was not published. Here it is drift to angle to rate in pitch, the yaw rate, and the climb.
GUST_M_S, GUST_RAD_S2 = 0.08, 0.1

PITCH_LOOP = Loop(
    system=hummingbird.pitch(),
    inputs=("pitch_command",),
    outputs=("q", "u", "theta", "ax"),
    error=np.array([[-1.0, 0.5, -3.5, 0.0]]),
    proportional=(4.0,),
    integral=(3.0,),
    noise=(NOISE.gyro_rad_s, NOISE.velocity_m_s, NOISE.attitude_rad, NOISE.accelerometer_m_s2),
    gusts=np.array([[-hummingbird.PITCH["M_u"]], [-hummingbird.PITCH["X_u"]], [0.0]]),
    strength=(GUST_M_S,),
)

PITCH = Twin(
    model="axis.pitch",
    inputs=("pitch_command",),
    outputs=("q", "ax"),
    truth=kept(hummingbird.PITCH),
    held=dropped(hummingbird.PITCH),
    flight=sweeps_of(PITCH_LOOP, "pitch", 3.0),
)

YAW_LOOP = Loop(
    system=hummingbird.yaw(),
    inputs=("yaw_command",),
    outputs=("r",),
    error=np.array([[-1.0]]),
    proportional=(6.0,),
    integral=(6.0,),
    noise=(NOISE.gyro_rad_s,),
    gusts=np.array([[1.0], [0.0]]),
    strength=(GUST_RAD_S2,),
)

YAW = Twin(
    model="axis.yaw",
    inputs=("yaw_command",),
    outputs=("r",),
    truth=kept(hummingbird.YAW),
    held=dropped(hummingbird.YAW),
    flight=sweeps_of(YAW_LOOP, "yaw", 10.0, (BAND[0], 2.0 * math.pi * 12.0)),
)

VERTICAL_LOOP = Loop(
    system=hummingbird.vertical(),
    inputs=("thrust_command",),
    outputs=("w", "az"),
    error=np.array([[1.0, 0.0]]),
    proportional=(5.0,),
    integral=(1.0,),
    noise=(NOISE.velocity_m_s, NOISE.accelerometer_m_s2),
    gusts=np.array([[-hummingbird.VERTICAL["Z_w"]]]),
    strength=(GUST_M_S,),
)

VERTICAL = Twin(
    model="axis.vertical",
    inputs=("thrust_command",),
    outputs=("az",),
    truth=kept(hummingbird.VERTICAL),
    held=dropped(hummingbird.VERTICAL),
    flight=sweeps_of(VERTICAL_LOOP, "thrust", 10.0, (0.3, BAND[1])),
)

# The rig as in its paper: 120 s at 100 Hz, long windows, noise of 5 % of the roll angle. It turns freely, so something has
# to hold it, slowly: its delays leave no more than some 1 rad/s.
RIG_S, RIG_BAND = 120.0, (0.35, 12.0)
RIG_EXCITATION_V, RIG_TORQUE_RAD_S2 = 0.8, 0.015

RIG_LOOP = Loop(
    system=rig.roll(),
    inputs=("motor_3", "motor_4"),
    outputs=("phi", "p"),
    error=np.array([[-0.3, -1.0], [0.3, 1.0]]),
    proportional=(1.2, 1.2),
    integral=(0.0, 0.0),
    noise=(0.01, NOISE.gyro_rad_s),
    gusts=np.array([[0.0], [1.0]]),
    strength=(RIG_TORQUE_RAD_S2,),
    log_hz=100.0,
)


def rig_flight(rng: np.random.Generator) -> FlightRecord:
    """Both motors at once, each with a random signal of its own.

    A sweep passes each frequency once, and windows of half the record see it at their edge or not at all: K_f is then
    0.2 to 0.7 % off, which is one to two of its standard deviations.
    """
    from scipy.signal import butter, sosfilt

    steps, settling = round(RIG_S * STEP_RATE_HZ), round(20.0 * STEP_RATE_HZ)
    shape = butter(2, RIG_BAND, btype="bandpass", fs=2.0 * math.pi * STEP_RATE_HZ, output="sos")
    signals = sosfilt(shape, rng.standard_normal((2, settling + steps)))[:, settling:]
    columns = RIG_LOOP.fly(RIG_EXCITATION_V * signals / signals.std(axis=1, keepdims=True), rng)
    whole = Maneuver(axis="roll", kind="other", start_s=0.0, stop_s=RIG_S, band_rad_s=RIG_BAND, origin="declared")
    return record_of(columns, RIG_LOOP.log_hz, [whole])


RIG_ROLL = Twin(
    model="rig.roll",
    inputs=("motor_3", "motor_4"),
    outputs=("phi",),
    truth={name: rig.TRUTH[name] for name in ("K_f", "tau_3", "tau_4")},
    held={"J_x": rig.TRUTH["J_x"]},
    flight=rig_flight,
    settings={
        "band_rad_s": RIG_BAND,
        "windows_s": (71.0, 60.0, 40.0),
        "instruments": ("motor_3_excitation", "motor_4_excitation"),
    },
)

TWINS: Mapping[str, Twin] = {twin.model: twin for twin in (LONGITUDINAL, LATERAL, PITCH, YAW, VERTICAL, RIG_ROLL)}


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """What came out of one flight with one kind of weights: errors of the parameters, and what they were stated to be."""

    error: FloatArray
    std: FloatArray


def problem_of(twin: Twin, record: FlightRecord) -> FrequencyProblem:
    """From a record to what is fitted, as the pipeline does it."""
    settings = IdentifySettings(fix=twin.held, outputs=twin.outputs, **twin.settings)  # type: ignore[arg-type]
    structure = library_model(twin.model).select(outputs=twin.outputs, inputs=twin.inputs)
    flown = [(record, maneuver) for maneuver in record.declared]
    measured = measure(flown, inputs=structure.inputs, outputs=structure.outputs, settings=settings)
    return pose(structure, measured, settings)


def identify(twin: Twin, seed: int) -> dict[Weights, Estimate]:
    """Fly, and identify with both kinds of weights; parameters in the order of ``twin.truth``."""
    problem = problem_of(twin, twin.flight(np.random.default_rng(seed)))
    plain = fit(problem)
    solutions: dict[Weights, FloatArray] = {}
    estimates: dict[Weights, Estimate] = {}
    order = [problem.parameters.free.index(name) for name in twin.truth]
    truth = np.array(list(twin.truth.values()))
    for weights, solution in (("cifer", plain), ("covariance", refine(problem, plain))):
        std = bounds(problem, solution, weights=weights).std
        estimates[weights] = Estimate(error=solution.theta[order] - truth, std=std[order])
    del solutions
    return estimates
