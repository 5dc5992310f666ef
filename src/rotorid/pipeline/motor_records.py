"""From logs to records of motors: the best source of the outputs, the rotors, stretches that moved, one clock."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rotorid.data.channel import LOWEST_RATE_HZ
from rotorid.data.findings import Finding
from rotorid.data.maneuver import Maneuver
from rotorid.data.motor_record import MotorRecord
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.models.rotor_layout import RotorLayout
from rotorid.models.rotor_layout_log import layout_of
from rotorid.models.rotor_mixer import mixer_of
from rotorid.pipeline.flights import while_flying
from rotorid.pipeline.instruments import Flown
from rotorid.pipeline.motor_choices import MotorChoices, chosen_layout
from rotorid.pipeline.motor_sampling import MotorFlight, on_one_clock, true_motors
from rotorid.pipeline.motor_voltage import FlownMotors, Voltage, common_voltage
from rotorid.pipeline.selection import described, each_once, inside
from rotorid.signal.airborne import airborne
from rotorid.signal.motor_outputs import Kind, MotorHistory
from rotorid.signal.motor_reconstruction import motor_history
from rotorid.signal.segment import find_excitations
from rotorid.typing import Axis

_AXES: tuple[Axis, ...] = ("roll", "pitch", "yaw", "thrust")
_TELLING = ("sweep", "random_binary", "doublet", "multistep", "multisine")
_TOGETHER_S = 5.0
_MARGIN_S = 1.0


class MotorData(NamedTuple):
    """What a fit of motors is made to.

    Parameters
    ----------
    flights
        Stretches of all logs.
    layout
        The rotors, in meters where the arm is known.
    histories
        Motors of each log.
    flown
        Logs and stretches, for the provenance.
    findings
        Remarks on the way.
    straightened
        Whether thrust follows the motors in a line, because the autopilot takes their curve out.
    reference_v
        Voltage at which thrust is told; ``None`` where it is no matter.
    """

    flights: tuple[MotorFlight, ...]
    layout: RotorLayout
    histories: tuple[MotorHistory, ...]
    flown: tuple[Flown, ...]
    findings: tuple[Finding, ...]
    straightened: bool = False
    reference_v: float | None = None

    @property
    def slow(self) -> bool:
        """Whether the motors of some log were logged more slowly than they act."""
        return min(history.sample_rate_hz for history in self.histories) < LOWEST_RATE_HZ

    @property
    def records(self) -> tuple[MotorRecord, ...]:
        return tuple(flight.record for flight in self.flights)

    @property
    def kind(self) -> Kind:
        """What the outputs are, of all logs the same."""
        return self.flights[0].kind


def motor_data(
    records: Sequence[FlightRecord],
    choices: MotorChoices,
    progress: Callable[[str], None] = lambda _: None,
    *,
    reference_v: float | None = None,
) -> MotorData:
    """Motors, rates and specific force of every log on one clock.

    Outputs are held from one stamp to the next, as a motor controller holds them; measured speeds are joined by lines.

    Parameters
    ----------
    records, choices, progress
        As for :func:`rotorid.pipeline.motor_identify.identify_motors`.
    reference_v
        Voltage at which thrust is told; the median of all stretches by default.

    Raises
    ------
    InsufficientDataError
        A log tells no motors, no rotors, or no motion.
    UsageError
        Logs are of different vehicles, or of motors of different kind.
    """
    each_once(records)
    layout = _layout(records, choices)
    findings: list[Finding] = [*layout.findings]
    flown: list[FlownMotors] = []
    for record in records:
        progress(f"{record.source.name}: motors")
        motors = true_motors(motor_history(record, mixer_of(layout, record.source.format)))
        if motors.history.motors != layout.rotors:
            raise UsageError(
                f"{record.source.name} holds {motors.history.motors} motors, and {layout.name} has "
                f"{layout.rotors} rotors",
                needed="a layout of the vehicle that flew",
                remedy="name it with --layout",
            )
        stretches, remarks = _stretches(record, choices)
        findings += [*motors.history.findings, *remarks]
        flown += [FlownMotors(record, motors, stretch) for stretch in stretches]
    voltage = common_voltage(flown, reference_v) if choices.voltage else Voltage(None)
    findings += voltage.findings
    flights: list[MotorFlight] = []
    for one in flown:
        progress(f"{one.record.source.name}: {one.stretch.start_s:.1f} to {one.stretch.stop_s:.1f} s")
        found, remarks = on_one_clock(one.record, one.motors, one.stretch, voltage.reference_v)
        flights += found
        findings += remarks
    _require_one_kind(flights, records)
    return MotorData(
        tuple(flights),
        layout,
        tuple({id(one.record): one.motors.history for one in flown}.values()),
        tuple((one.record, one.stretch) for one in flown),
        _each_once(findings),
        straightened=all(_straightened(record, flights[0].kind) for record in records),
        reference_v=voltage.reference_v,
    )


def _layout(records: Sequence[FlightRecord], choices: MotorChoices) -> RotorLayout:
    formats = sorted({record.source.format for record in records})
    if len(formats) > 1:
        raise UsageError(
            f"logs of {' and '.join(formats)} came", needed="logs of one vehicle", remedy="identify each by itself"
        )
    layouts = [chosen_layout(choices.layout)] if choices.layout else [layout_of(record) for record in records]
    first = layouts[0]
    for record, other in zip(records, layouts, strict=False):
        same = other.rotors == first.rotors and np.allclose(other.positions, first.positions)
        if not (same and np.array_equal(other.spins, first.spins)):
            raise UsageError(
                f"{record.source.name} is of {other.name}, and {records[0].source.name} of {first.name}",
                needed="logs of one vehicle",
                remedy="identify each vehicle by itself, or name the layout with --layout",
            )
    return first.scaled(choices.arm_m) if choices.arm_m else first


def _stretches(record: FlightRecord, choices: MotorChoices) -> tuple[list[Maneuver], list[Finding]]:
    """What was given; else excitations, joined where they follow each other; else the flight."""
    if choices.segments:
        given = [described(record, one) for one in choices.segments if inside(record, one)]
        if not given:
            span = f"{record.start_s:.1f} to {record.stop_s:.1f} s of {record.source.name}"
            raise UsageError("no given segment lies inside the record", needed=f"segments within {span}")
        return given, []
    moved = [one for axis in _AXES for one in find_excitations(record, axis) if one.kind in _TELLING]
    if moved:
        flown, remarks = while_flying([(record, one) for one in _joined(moved)])
        return [one for _, one in flown], remarks
    start_s, stop_s = _flight(record)
    whole = Maneuver(axis="roll", kind="other", start_s=start_s, stop_s=stop_s, origin="found")
    message = f"No excitation stands out in {record.source.name}; its flight was used, {start_s:.1f} to {stop_s:.1f} s."
    return [whole], [Finding(kind="no_excitation", severity="info", where=record.source.name, message=message)]


def _flight(record: FlightRecord) -> tuple[float, float]:
    try:
        return airborne(record).longest
    except InsufficientDataError as error:
        if any(finding.kind == "never_airborne" for finding in error.findings):
            raise
        return record.start_s, record.stop_s


def _joined(moved: Sequence[Maneuver]) -> list[Maneuver]:
    """Maneuvers with a second around them, those that follow within seconds as one."""
    joined: list[Maneuver] = []
    for one in sorted(moved, key=lambda maneuver: maneuver.start_s):
        wider = replace(one, start_s=one.start_s - _MARGIN_S, stop_s=one.stop_s + _MARGIN_S)
        if joined and wider.start_s <= joined[-1].stop_s + _TOGETHER_S:
            joined[-1] = replace(joined[-1], stop_s=max(joined[-1].stop_s, wider.stop_s))
        else:
            joined.append(wider)
    return joined


def _straightened(record: FlightRecord, kind: Kind) -> bool:
    """Whether the autopilot takes the curve of the motors out, so that thrust follows what was logged in a line."""
    if kind != "thrust_demand":
        return False
    return record.source.format.startswith("ArduPilot") or record.parameters.get("THR_MDL_FAC", 0.0) > 0.0


def _require_one_kind(flights: Sequence[MotorFlight], records: Sequence[FlightRecord]) -> None:
    names = ", ".join(record.source.name for record in records)
    if not flights:
        message = f"No stretch of a second without a gap is left in {names}."
        raise InsufficientDataError(
            message,
            needed="motors, rates and accelerometer logged without gaps",
            findings=[Finding(kind="gap", severity="error", where=names, message=message)],
        )
    if len(kinds := {flight.kind for flight in flights}) > 1:
        raise UsageError(
            f"{names} tell motors as {' and '.join(sorted(kinds))}",
            needed="logs that tell them in one way",
            remedy="identify on those of one kind",
        )


def _each_once(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Findings of several stretches: what is wrong with the rate of a channel is said once."""

    def said(finding: Finding) -> tuple[str, str, str]:
        return finding.kind, finding.where, "" if finding.kind == "rate_too_low" else finding.message

    return tuple({said(finding): finding for finding in reversed(findings)}.values())[::-1]
