"""Betaflight: what is known of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rotorid.autopilots.autopilot import Advice, Autopilot, Card, Log, sweep_by_stick
from rotorid.autopilots.betaflight import advice

if TYPE_CHECKING:
    from rotorid.autopilots.notches import FilterChange, Motion, MovingNotches, NoiseLines
    from rotorid.autopilots.passages import Passage
    from rotorid.autopilots.thrust import ThrustParameter
    from rotorid.data.flight_plan import FlightPlan, PlannedInput
    from rotorid.data.record import FlightRecord


def _passage(record: FlightRecord, source: str, sensor_rate_hz: float | None) -> Passage:
    from rotorid.autopilots.betaflight.filters import passage

    return passage(record, source, sensor_rate_hz)


def _moving_notches(record: FlightRecord, motion: Motion) -> MovingNotches:
    from rotorid.autopilots.betaflight.notches import moving_notches

    return moving_notches(record.parameters, motion)


def _filter_changes(record: FlightRecord, lines: NoiseLines) -> Sequence[FilterChange]:
    from rotorid.autopilots.betaflight.notches import filter_changes

    return filter_changes(record.parameters, lines)


def _accelerometer_cutoff_hz(record: FlightRecord) -> float:
    # Betaflight writes hundredths, INAV whole numbers; both begin with 10 Hz.
    per_hz = 1.0 if "INAV" in record.source.firmware else 100.0
    return record.parameters.get("acc_lpf_hz", 10.0 * per_hz) / per_hz


def _thrust() -> ThrustParameter:
    from rotorid.autopilots.betaflight.thrust import THRUST_LINEAR

    return THRUST_LINEAR


def _logging(record: FlightRecord, _rate_hz: float, channels: tuple[str, ...]) -> str:
    return advice.field_advice(record.source.firmware, channels)


def _sensors(record: FlightRecord, _rate_hz: float) -> str:
    return advice.rate_advice(record.source.firmware)


def _raw_gyro(record: FlightRecord) -> str:
    return advice.raw_gyro_advice(record.source.firmware)


def _motors(record: FlightRecord) -> str:
    return advice.field_advice(record.source.firmware, ("motor_1",))


def _speeds(record: FlightRecord) -> str:
    return advice.speed_advice(record.source.firmware)


def _gaps(record: FlightRecord) -> str:
    return advice.gap_advice(record.source.firmware)


def _hand_on_throttle(_plan: FlightPlan) -> bool:
    """CHIRP runs in ANGLE: the throttle stick is the thrust."""
    return True


def _how(_plan: FlightPlan, _flown: Sequence[PlannedInput], _firmware: str) -> str:
    return (
        "You work the throttle. Each run: steady hover in ANGLE, turn CHIRP on, correct drift slowly and "
        "gently until CHIRP IS FINISHED, then off. Every turn takes the next axis."
    )


BETAFLIGHT = Autopilot(
    name="Betaflight",
    key="betaflight",
    log=Log(
        own=True,
        outputs_scaled=True,
        hover_by_motors=True,
        rate_source="gyroADC[0]",
        sensor_rate_logged=True,
        fields_chosen=True,
        in_one_turn=True,
        passage=_passage,
        moving_notches=_moving_notches,
        filter_changes=_filter_changes,
        accelerometer_cutoff_hz=_accelerometer_cutoff_hz,
    ),
    advice=Advice(
        logging=_logging,
        sensors=_sensors,
        raw_gyro=_raw_gyro,
        motors=_motors,
        speeds=_speeds,
        gains="fly Betaflight 4.0 or newer, whose gains are known",
        gaps=_gaps,
        flying=sweep_by_stick,
    ),
    log_format="bbl",
    frequency="Hz",
    vehicle="betaflight_quad",
    gain="rollPID_P",
    thrust_parameter=_thrust,
    gains_by_throttle=True,
    # Few firmwares have CHIRP, and it sweeps no thrust.
    entry="stick",
    leaves_steps=True,
    hand_on_throttle=_hand_on_throttle,
    has_plan_files=True,
    loading="In the Betaflight Configurator: open the CLI tab and paste the file.",
    card=Card(
        way_out="switch CHIRP off, level, land",
        hand_way_out="level, land",
        loaded="CLI lines pasted; debug_mode reads CHIRP; blackbox empty enough",
        ready="ANGLE mode on a switch; failsafe set and tried",
        hand_mode=", in ANGLE",
        how=_how,
    ),
)
