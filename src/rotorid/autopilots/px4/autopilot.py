"""PX4: what is known of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rotorid.autopilots.autopilot import BY_DSHOT, Advice, Autopilot, Card, Log, sweep_by_stick
from rotorid.autopilots.px4 import advice
from rotorid.autopilots.px4.versions import firmware_shown

if TYPE_CHECKING:
    from rotorid.autopilots.notches import FilterChange, Motion, MovingNotches, NoiseLines
    from rotorid.autopilots.passages import Passage
    from rotorid.autopilots.thrust import Linearization, ThrustParameter
    from rotorid.data.flight_plan import FlightPlan, PlannedInput
    from rotorid.data.record import FlightRecord


def _passage(record: FlightRecord, source: str, sensor_rate_hz: float | None) -> Passage:
    from rotorid.autopilots.px4.filters import passage

    return passage(record, source, sensor_rate_hz)


def _moving_notches(record: FlightRecord, motion: Motion) -> MovingNotches:
    from rotorid.autopilots.px4.notches import moving_notches

    return moving_notches(record.parameters, motion)


def _filter_changes(record: FlightRecord, lines: NoiseLines) -> Sequence[FilterChange]:
    from rotorid.autopilots.px4.notches import filter_changes

    return filter_changes(record.parameters, lines)


def _linearization(_record: FlightRecord) -> Linearization:
    """What is logged as ``actuator_motors`` is the demand itself; ``THR_MDL_FAC`` acts after it."""
    from rotorid.autopilots.thrust import Linearization

    return Linearization()


def _thrust() -> ThrustParameter:
    from rotorid.autopilots.thrust import by_expo

    return by_expo("THR_MDL_FAC")


def _firmware(record: FlightRecord) -> str:
    """The firmware by its name, and by what the log holds: builds without tags call themselves 1.8.0."""
    sources = (channel.source.partition("[")[0] for topic in record.topics for channel in topic.channels)
    return firmware_shown(record.source.firmware, (*sources, *record.parameters))


def _logging(record: FlightRecord, _rate_hz: float, _channels: tuple[str, ...] = ()) -> str:
    return advice.logging_advice(record.parameters, _firmware(record))


def _raw_gyro(record: FlightRecord) -> str:
    return advice.raw_gyro_advice(record.parameters, _firmware(record))


def _motors(record: FlightRecord) -> str:
    return advice.motor_advice(record.parameters, _firmware(record))


def _gaps(record: FlightRecord) -> str:
    return advice.gap_advice(record.parameters)


def _wind(record: FlightRecord) -> str:
    return advice.wind_advice(record.parameters)


def _how(_plan: FlightPlan, _flown: Sequence[PlannedInput], _firmware: str) -> str:
    return (
        "Start the script, hover in the middle in Position mode, then switch to Offboard. Hands off: the script "
        "keeps position and height slowly; moving the sticks ends the test. It then returns to Position mode."
    )


PX4 = Autopilot(
    name="PX4",
    key="px4",
    log=Log(
        own=True,
        thrust_demand=True,
        rate_source="vehicle_angular_velocity.xyz[0]",
        # The sensor hub's mean over a few milliseconds passes none of the filters of the controllers.
        unfiltered_topic="sensor_combined",
        topics_listed=True,
        passage=_passage,
        moving_notches=_moving_notches,
        filter_changes=_filter_changes,
        linearization=_linearization,
    ),
    advice=Advice(
        logging=_logging,
        sensors=_logging,
        raw_gyro=_raw_gyro,
        motors=_motors,
        speeds=lambda _record: BY_DSHOT,
        gains="log the parameters",
        gaps=_gaps,
        wind=_wind,
        flying=sweep_by_stick,
    ),
    log_format="ulg",
    frequency="Hz",
    vehicle="px4_quad",
    gain="MC_ROLLRATE_P",
    takes_gains=True,
    hover="MPC_THR_HOVER",
    thrust_parameter=_thrust,
    waits_for_sensor=True,
    # Offboard takes attitudes and thrust, and no torques.
    entry="attitude_setpoint",
    has_plan_files=True,
    loading="In QGroundControl: Vehicle Setup > Parameters > Tools > Load from file. Or paste the .txt file into the "
    "MAVLink console.",
    card=Card(
        way_out="switch to Position",
        loaded="px4.params loaded; SDLOG_PROFILE reads {profile}; space on the card",
        how=_how,
    ),
)
