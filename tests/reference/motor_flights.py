"""Flights as the physics of motors needs them, by the package's own readers, layouts and mixers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

import rotorid
from rotorid.data.record import FlightRecord, MotorRecord
from rotorid.models.autopilots.layouts import layout_of, mixer_of
from rotorid.models.rotors import RotorLayout
from rotorid.signal.clock import interpolated
from rotorid.signal.motors import motor_history
from rotorid.typing import FloatArray

Span = tuple[float, float]

PX4_TOPICS = ("vehicle_angular_velocity", "vehicle_acceleration")
PX4_SPANS: dict[str, Span] = {
    "roll.ulg": (40.54, 122.54),
    "pitch.ulg": (39.44, 121.44),
    "yaw.ulg": (39.38, 111.39),
    "thrust.ulg": (39.39, 111.39),
    "verify.ulg": (39.4, 95.4),
}
ARDUPILOT_SPANS: dict[str, tuple[Span, ...]] = {
    "x_calm_roll.BIN": ((95.0, 186.0),),
    "x_calm_thrust.BIN": ((95.0, 186.0),),
    "x_wind_rollpitch.BIN": ((95.0, 176.0), (194.6, 275.8)),
    "x_wind_yawthrust.BIN": ((95.0, 176.0), (194.5, 265.7)),
}
CRAZYFLIE_SPAN = (35.0, 65.0)


def motor_record(
    flight: FlightRecord, span: Span, rate_hz: float, *, topics: tuple[str, ...] = (), velocity: bool = True
) -> MotorRecord:
    """One stretch of a log on a clock of its own: motors held, motion interpolated.

    Parameters
    ----------
    flight
        The log.
    span
        On its own clock.
    rate_hz
        Of the clock.
    topics
        Beginnings of the names of topics to take rates and specific force from; by default the first choice.
    velocity
        Whether to take the velocity downward for that along z.
    """
    clock = np.arange(span[0], span[1], 1.0 / rate_hz)
    motors = motor_history(flight, mixer_of(layout_of(flight), flight.source.format))
    held = np.clip(np.searchsorted(motors.time_s, clock + 1e-6, side="right") - 1, 0, None)
    rows = {name: _interpolated(flight, name, clock, topics) for name in ("p", "q", "r", "az")}
    return MotorRecord(
        name=Path(flight.source.name).name,
        sample_rate_hz=rate_hz,
        outputs=motors.values[:, held],
        rates=np.stack([rows[name] for name in "pqr"]),
        az=rows["az"],
        w=_interpolated(flight, "velocity_down", clock, ()) if velocity else np.zeros(0),
        start_s=span[0],
    )


def _interpolated(flight: FlightRecord, name: str, clock: FloatArray, topics: tuple[str, ...]) -> FloatArray:
    for topic, row in flight.holding(name):
        whole = topic.time_s[0] <= clock[0] and topic.time_s[-1] >= clock[-1]
        if whole and (not topics or topic.name.startswith(topics)):
            return np.asarray(np.interp(clock, topic.time_s, topic.values[row]))
    raise LookupError(f"{flight.source.name} holds no {name} over the whole span")


def levers_of(layout: RotorLayout) -> FloatArray:
    """Roll, pitch and yaw moment of a newton of each rotor, as the problem wants them."""
    return np.vstack([layout.moment_arms[:2], layout.torque_axes[2:]])


def px4_record(path: Path) -> MotorRecord:
    """One of the simulated PX4 flights."""
    return motor_record(rotorid.read(path), PX4_SPANS[path.name], 250.0, topics=PX4_TOPICS)


def ardupilot_records(path: Path, *, held: bool = False) -> list[MotorRecord]:
    """The stretches of one of the simulated ArduPilot flights, from its unfiltered gyros.

    Parameters
    ----------
    path
        Of the log.
    held
        Whether outputs are taken as held from sample to sample, though the loop is faster than the log.
    """
    flight = rotorid.read(path)
    loops = 1 if held else round(flight.parameters["SCHED_LOOP_RATE"] / 200.0)
    records = [motor_record(flight, span, 200.0, topics=("SIDD",)) for span in ARDUPILOT_SPANS[path.name]]
    return [
        replace(one, name=f"{path.name} {one.start_s:g} s", outputs=_between(one.outputs, loops)) for one in records
    ]


def _between(outputs: FloatArray, loops: int) -> FloatArray:
    """Mean output over each sample, where a loop that is so many times faster went on to the next one by even steps."""
    following = np.concatenate([outputs[:, 1:], outputs[:, -1:]], axis=1)
    share = (loops - 1) / (2.0 * loops)
    mean: FloatArray = (1.0 - share) * outputs + share * following
    return mean


IRIS_LEVERS = np.array([[-0.22, 0.20, 0.22, -0.20], [0.13, -0.13, 0.13, -0.13], [1.0, 1.0, -1.0, -1.0]])


def iris_record(path: Path, *, smooth: bool = True) -> MotorRecord:
    """The simulated iris at 100 Hz; its motors, joined by straight lines in the file, joined anew if ``smooth``."""
    table = _columns(path)
    clock = (table["timestamp"] - table["timestamp"][0]) * 1e-6
    outputs = np.stack([table[f"u{motor}"] for motor in range(4)]) / 1000.0 - 1.0
    joined = interpolated(clock, outputs)
    if smooth and joined is not None:
        outputs = joined.smooth(clock)
    q0, q1, q2, q3 = (table[f"q{part}"] for part in range(4))
    down = np.stack([2.0 * (q1 * q3 + q0 * q2), 2.0 * (q2 * q3 - q0 * q1), 1.0 - 2.0 * (q1**2 + q2**2)])
    return MotorRecord(
        name=path.name,
        sample_rate_hz=float(1.0 / np.median(np.diff(clock))),
        outputs=outputs,
        rates=np.stack([table[f"ang_vel_{axis}"] for axis in "xyz"]),
        az=table["acc_b_z"],
        w=down[0] * table["vx"] + down[1] * table["vy"] + down[2] * table["vz"],
    )


def iris_speed_m_s(path: Path) -> FloatArray:
    """Speed of the simulated iris over the ground, and through its still air."""
    table = _columns(path)
    return np.sqrt(table["vx"] ** 2 + table["vy"] ** 2 + table["vz"] ** 2)


def _columns(path: Path) -> dict[str, FloatArray]:
    with path.open(encoding="utf-8") as file:
        names = file.readline().strip().split(",")
        return dict(zip(names, np.loadtxt(file, delimiter=",").T, strict=True))
