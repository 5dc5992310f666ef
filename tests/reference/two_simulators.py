"""Flights of other simulators flown again: the same sticks or chirps, in ours, as a log of the same format."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from rotorid.data.flight_plan import Entry, FlightPlan, PlannedInput
from rotorid.data.record import FlightRecord
from rotorid.io.px4.writer import write_px4
from rotorid.io.registry import read
from rotorid.simulation.multirotor_flight import Aircraft, fly_multirotor
from rotorid.simulation.wind import CALM, Wind
from rotorid.typing import Axis, FloatArray
from rotorid.vehicles import ardupilot as ardupilot_quad
from rotorid.vehicles import px4 as px4_quad

SAMPLE_RATE_HZ = 250.0
MANUAL_YAW_LAG_S = 0.08
"""``MPC_MAN_Y_TAU``: PX4 smooths the yaw stick before it asks for a rate."""

STICKS_HELD_S = 0.010
"""The stick's stamp is that of its sending; it is flown with the next one."""


def signal(record: FlightRecord, name: str, time_s: FloatArray) -> FloatArray:
    """A channel of a log at some instants."""
    topic, row = next(iter(record.holding(name)))
    return np.interp(time_s, topic.time_s, topic.values[row])


def steady(record: FlightRecord, name: str, time_s: FloatArray) -> FloatArray:
    """A channel as difference from its mean."""
    values = signal(record, name, time_s)
    return np.asarray(values - values.mean())


def px4_sticks(record: FlightRecord, start_s: float, stop_s: float) -> FlightPlan:
    """What the pilot of a flight in PX4's mode Stabilized asked for.

    The throttle goes through a curve with a bend in the middle; what it asks for is logged as thrust set-point, which
    no loop touches in this mode, and that is flown again.
    """
    from scipy.signal import lfilter

    time_s = np.arange(start_s, stop_s, 1.0 / SAMPLE_RATE_HZ) - STICKS_HELD_S
    keep = np.exp(-1.0 / (SAMPLE_RATE_HZ * MANUAL_YAW_LAG_S))
    thrust = px4_quad.aircraft().autopilot.guidance.stick_thrust
    values: dict[Axis, FloatArray] = {
        "roll": signal(record, "roll_stick", time_s),
        "pitch": signal(record, "pitch_stick", time_s),
        "yaw": np.asarray(lfilter([1.0 - keep], [1.0, -keep], signal(record, "yaw_stick", time_s))),
        "thrust": steady(record, "thrust_command", time_s + STICKS_HELD_S) / thrust,
    }
    return _plan({axis: (samples, "stick") for axis, samples in values.items()})


def ardupilot_chirp(record: FlightRecord, axis: Axis, start_s: float, stop_s: float) -> FlightPlan:
    """The injection of a flight in ArduPilot's mode SYSTEMID, and the throttle of its pilot."""
    time_s = np.arange(start_s, stop_s, 1.0 / SAMPLE_RATE_HZ)
    topic = next(topic for topic, _ in record.holding(f"{axis}_excitation") if topic.time_s[0] < stop_s)
    row = topic.row(f"{axis}_excitation")
    assert row is not None
    injected = np.interp(time_s, topic.time_s, topic.values[row], left=0.0, right=0.0)
    parts: dict[Axis, tuple[FloatArray, Entry]] = {axis: (injected, "command")}
    return _plan(parts)


def _plan(parts: dict[Axis, tuple[FloatArray, Entry]]) -> FlightPlan:
    inputs = tuple(
        PlannedInput(
            axis=axis,
            shape="pilot_sweep",
            start_s=0.0,
            values=values,
            sample_rate_hz=SAMPLE_RATE_HZ,
            amplitude=float(np.abs(values).max()),
            entry=entry,
        )
        for axis, (values, entry) in parts.items()
    )
    return FlightPlan(name="flown again", inputs=inputs, trim_s=0.0)


def flown_again_px4(
    record: FlightRecord, start_s: float, stop_s: float, path: Path, *, gyro_cutoff_hz: float = px4_quad.GYRO_CUTOFF_HZ
) -> FlightRecord:
    """A flight of PX4's simulator flown again in ours, on the same clock."""
    aircraft = px4_quad.aircraft()
    aircraft = replace(aircraft, autopilot=replace(aircraft.autopilot, gyro_cutoff_hz=gyro_cutoff_hz))
    flown = fly_multirotor(aircraft, px4_sticks(record, start_s, stop_s))
    write_px4(path, flown, start_s=start_s)
    return read(path)


def flown_again_ardupilot(
    record: FlightRecord, axis: Axis, start_s: float, stop_s: float, path: Path, wind: Wind = CALM
) -> FlightRecord:
    """A chirp of ArduPilot's simulator flown again in ours, on the same clock; height is held, as its pilot did."""
    from rotorid.io.ardupilot.writer import write_ardupilot

    aircraft = held_in_height(ardupilot_quad.aircraft())
    flown = fly_multirotor(aircraft, ardupilot_chirp(record, axis, start_s, stop_s), wind=wind)
    sweeps = tuple(replace(one, signal=f"{axis}_excitation") for one in flown.maneuvers)
    write_ardupilot(path, replace(flown, maneuvers=sweeps), start_s=start_s)
    return read(path)


def flown_setpoints_ardupilot(record: FlightRecord, start_s: float, stop_s: float, path: Path) -> FlightRecord:
    """Stick doublets of ArduPilot's simulator flown again in ours from the rates that its input shaper asked for."""
    from rotorid.io.ardupilot.writer import write_ardupilot

    time_s = np.arange(start_s, stop_s, 1.0 / SAMPLE_RATE_HZ)
    channels: dict[Axis, str] = {"roll": "p_setpoint", "pitch": "q_setpoint", "yaw": "r_setpoint"}
    plan = _plan({axis: (signal(record, name, time_s), "rate_setpoint") for axis, name in channels.items()})
    aircraft = held_in_height(ardupilot_quad.aircraft())
    # The logged set-points hold the answer of the angle loop already.
    alone = replace(aircraft, autopilot=replace(aircraft.autopilot, angle_1_s=(0.0, 0.0, 0.0)))
    write_ardupilot(path, replace(fly_multirotor(alone, plan), maneuvers=()), start_s=start_s)
    return read(path)


def held_in_height(aircraft: Aircraft) -> Aircraft:
    """With the slow loop of a pilot on the throttle."""
    guidance = replace(
        aircraft.autopilot.guidance, hold_height=True, climb_p=0.04, climb_i=0.005, height_p_1_s=0.3, stick_thrust=0.0
    )
    return replace(aircraft, autopilot=replace(aircraft.autopilot, guidance=guidance))
