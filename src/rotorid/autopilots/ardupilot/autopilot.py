"""ArduPilot: what is known of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rotorid.autopilots.autopilot import Advice, Autopilot, Card, Log

if TYPE_CHECKING:
    from rotorid.autopilots.notches import FilterChange, Motion, MovingNotches, NoiseLines
    from rotorid.autopilots.passages import Passage
    from rotorid.autopilots.thrust import Linearization, ThrustParameter
    from rotorid.data.findings import Finding
    from rotorid.data.flight_plan import FlightPlan, PlannedInput
    from rotorid.data.record import FlightRecord
    from rotorid.typing import Axis


def _passage(record: FlightRecord, source: str, sensor_rate_hz: float | None) -> Passage:
    from rotorid.autopilots.ardupilot.filters import passage

    return passage(record, source, sensor_rate_hz)


def _moving_notches(record: FlightRecord, motion: Motion) -> MovingNotches:
    from rotorid.autopilots.ardupilot.notches import moving_notches

    return moving_notches(record.parameters, motion)


def _filter_changes(record: FlightRecord, lines: NoiseLines) -> Sequence[FilterChange]:
    from rotorid.autopilots.ardupilot.notches import filter_changes

    return filter_changes(record.parameters, lines)


def _linearization(record: FlightRecord) -> Linearization | None:
    from rotorid.autopilots.ardupilot.thrust import linearization

    return linearization(record.parameters)


def _frame(record: FlightRecord) -> tuple[str, str] | None:
    from rotorid.autopilots.ardupilot.frames import frame_of

    return frame_of(record)


def _frame_of_class(record: FlightRecord) -> tuple[str, str] | None:
    from rotorid.autopilots.ardupilot.frames import frame_of_class

    return frame_of_class(record)


def _thrust() -> ThrustParameter:
    from rotorid.autopilots.thrust import by_expo

    return by_expo("MOT_THST_EXPO")


def _logging(record: FlightRecord, rate_hz: float, _channels: tuple[str, ...]) -> str:
    from rotorid.autopilots.ardupilot.advice import logging_advice, message_rates_hz

    return logging_advice(record.parameters, record.source.firmware, rate_hz, message_rates_hz(record.topics))


def _sensors(record: FlightRecord, rate_hz: float) -> str:
    from rotorid.autopilots.ardupilot.advice import message_rates_hz, sensor_advice

    return sensor_advice(record.parameters, record.source.firmware, rate_hz, message_rates_hz(record.topics))


def _raw_gyro(record: FlightRecord) -> str:
    from rotorid.autopilots.ardupilot.advice import raw_gyro_advice

    return raw_gyro_advice(record.parameters, record.source.firmware)


def _motors(record: FlightRecord) -> str:
    from rotorid.autopilots.ardupilot.advice import motor_advice

    return motor_advice(record.parameters)


def _slow_motors(record: FlightRecord, _rate_hz: float) -> str:
    from rotorid.autopilots.ardupilot.advice import message_rates_hz, slow_motor_advice

    return slow_motor_advice(message_rates_hz(record.topics))


def _speeds(record: FlightRecord) -> str:
    from rotorid.autopilots.ardupilot.advice import speed_advice

    return speed_advice(record.source.firmware)


def _gaps(_record: FlightRecord) -> str:
    return "use a faster SD card, a larger LOG_FILE_BUFSIZE, or fewer messages (LOG_BITMASK)"


def _wind(record: FlightRecord) -> str:
    from rotorid.autopilots.ardupilot.advice import wind_advice

    return wind_advice(record.parameters)


def _flying(record: FlightRecord, axes: Sequence[Axis]) -> str:
    from rotorid.autopilots.ardupilot.advice import flying_advice

    return flying_advice(record.parameters, record.source.firmware, *axes)


def _hand_on_throttle(plan: FlightPlan) -> bool:
    """SYSTEMID mode flies like Stabilize for most of its axes: the throttle stick is the thrust."""
    from rotorid.autopilots.ardupilot.system_id import sid_axes, throttle_of

    return any(throttle_of(axis) == "pilot" for axis in sid_axes(plan))


def _plan_findings(plan: FlightPlan, firmware: str) -> tuple[Finding, ...]:
    from rotorid.autopilots.ardupilot.system_id import firmware_findings

    return firmware_findings(plan, firmware)


def _how(plan: FlightPlan, flown: Sequence[PlannedInput], firmware: str) -> str:
    from rotorid.autopilots.ardupilot.system_id import how_to_fly

    if all(planned.shape == "logarithmic_sweep" for planned in flown):
        return how_to_fly(plan, firmware)
    return (
        "Hover in the middle in Loiter, switch to Guided, then turn on the switch of the script. Hands off: the script "
        "keeps the position slowly, and the autopilot works the throttle. The flight-mode switch takes over at any "
        "time. "
        "It ends in Loiter."
    )


ARDUPILOT = Autopilot(
    name="ArduPilot",
    key="ardupilot",
    called=("ArduCopter",),
    log=Log(
        own=True,
        straightened=True,
        rate_source="RATE.R",
        in_one_turn=True,
        frame=_frame,
        passage=_passage,
        moving_notches=_moving_notches,
        filter_changes=_filter_changes,
        hidden_filters={
            f"{prefix}_{name}": value
            for prefix in ("INS_HNTCH", "INS_HNTC2")
            for name, value in (
                ("FREQ", 80.0),
                ("BW", 40.0),
                ("ATT", 40.0),
                ("HMNCS", 3.0),
                ("REF", 0.0),
                ("MODE", 1.0),
                ("OPTS", 0.0),
                ("FM_RAT", 1.0),
            )
        },
        linearization=_linearization,
    ),
    telemetry=Log(telemetry=True, frame=_frame_of_class, linearization=_linearization),
    advice=Advice(
        logging=_logging,
        sensors=_sensors,
        raw_gyro=_raw_gyro,
        motors=_motors,
        slow_motors=_slow_motors,
        speeds=_speeds,
        gains="log the parameters",
        gaps=_gaps,
        wind=_wind,
        flying=_flying,
    ),
    log_format="bin",
    frequency="Hz",
    vehicle="ardupilot_quad",
    gain="ATC_RAT_RLL_P",
    takes_gains=True,
    hover="MOT_THST_HOVER",
    thrust_parameter=_thrust,
    shapes_setpoints=True,
    adds_sweeps=True,
    # Its own chirps and no other shape; steps are flown by no script.
    sweep="logarithmic_sweep",
    step_entry="stick",
    leaves_steps=True,
    hand_on_throttle=_hand_on_throttle,
    plan_findings=_plan_findings,
    has_plan_files=True,
    loading="In Mission Planner: Config > Full Parameter List > Load from file. In MAVProxy: param load FILE.",
    card=Card(
        way_out="switch to Loiter",
        way_height="throttle near the middle",
        way_tried="Stabilize, throttle near the middle",
        loaded="Parameter file loaded; LOG_BITMASK reads {mask}; space on the card",
        hand_mode=", in Stabilize",
        how=_how,
    ),
)
