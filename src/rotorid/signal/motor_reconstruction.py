"""Motors from the commands of the controllers, where the log holds those faster than the motors themselves."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rotorid.data.channel import AXES, LOWEST_RATE_HZ
from rotorid.data.findings import Finding
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.signal.autopilot_mixer import COMMANDS, linearization_of
from rotorid.signal.motor_agreement import Agreement, agreement_of, or_none, voltage_share
from rotorid.signal.motor_outputs import MotorHistory, judged, logged_outputs, logged_speeds, on_one_clock
from rotorid.typing import FloatArray

_FASTER = 1.5
_RELATED = 0.5


def reconstructed_demands(record: FlightRecord, mixer: FloatArray) -> tuple[MotorHistory, Agreement | None]:
    r"""Share of the largest thrust that the autopilot asked of each motor, at the rate of its commands.

    .. math:: d_i = m_{i1} u_{roll} + m_{i2} u_{pitch} + m_{i3} u_{yaw} + m_{i4} u_{thrust}

    Holds where no motor is at a limit, and for the shape of the demand alone where the autopilot scales all of it. It
    is checked against the logged outputs, however slow; a wrong mixer, order of motors or curve shows there.

    Parameters
    ----------
    record
        Holds the four commands.
    mixer
        Columns roll, pitch, yaw and thrust, shape ``(motors, 4)``.

    Returns
    -------
    MotorHistory
        Of the kind ``thrust_demand``, with a finding ``motor_reconstruction``.
    Agreement or None
        With the logged outputs; ``None`` where the log holds none, or how they follow from the demand is not known.

    Raises
    ------
    InsufficientDataError
        A command is missing.
    UsageError
        The mixer has another number of motors than the log.
    """
    time_s, commands, source = on_one_clock(record, COMMANDS)
    history = MotorHistory(
        kind="thrust_demand",
        time_s=time_s,
        values=np.asarray(mixer, dtype=np.float64) @ commands,
        source=f"mixer of {source}",
    )
    agreement = agreement_of(record, history, mixer)
    remarks = (*_told(history, agreement), *_slow_thrust(record))
    return judged(record, replace(history, findings=remarks)), agreement


def reconstructed_outputs(record: FlightRecord, mixer: FloatArray) -> MotorHistory:
    """Outputs to the motors at the rate of the commands, through what the autopilot does to its demands.

    The gain that the slow outputs show, and the logged voltage, take the places of the density of the air and of the
    resting voltage, which logs do not hold.

    Parameters
    ----------
    record, mixer
        As for :func:`reconstructed_demands`.

    Raises
    ------
    InsufficientDataError
        A command or all outputs are missing, or how outputs follow from demands is not known.
    """
    demands, agreement = reconstructed_demands(record, mixer)
    known = linearization_of(record)
    if known is None or agreement is None:
        raise InsufficientDataError(
            f"{record.source.name} does not tell how outputs follow from demands of thrust",
            needed="motor outputs, and MOT_THST_EXPO, MOT_SPIN_MIN and MOT_SPIN_MAX",
            remedy="use the demands, or log the motors faster",
        )
    share = voltage_share(record, known, demands.time_s)
    values = known.outputs(demands.values, gain=agreement.gain, voltage_share=share)
    told = tuple(finding for finding in demands.findings if finding.kind not in ("saturation", "rate_too_low"))
    return judged(record, replace(demands, kind="output", values=values, findings=told))


def motor_history(record: FlightRecord, mixer: FloatArray | None = None) -> MotorHistory:
    """The motors as truly and as fast as the log tells them.

    Measured speeds, where all motors have them at 40 Hz and more; else the logged outputs; else, where the commands are
    faster by half and the mixer is known, the demands of thrust that follow from them and agree with the outputs.

    Parameters
    ----------
    record
        The log.
    mixer
        Columns roll, pitch, yaw and thrust, shape ``(motors, 4)``.

    Raises
    ------
    InsufficientDataError
        The log holds no motors, and no commands with a mixer.
    """
    speeds = or_none(logged_speeds, record)
    if speeds is not None and speeds.sample_rate_hz >= LOWEST_RATE_HZ:
        return speeds
    outputs = or_none(logged_outputs, record)
    if mixer is None:
        return outputs or speeds or logged_outputs(record)
    try:
        demands, agreement = reconstructed_demands(record, mixer)
    except InsufficientDataError:
        return outputs or speeds or logged_outputs(record)
    if outputs is None:
        return demands
    faster = demands.sample_rate_hz >= _FASTER * outputs.sample_rate_hz
    if faster and agreement is not None and agreement.agrees:
        return demands
    disagreeing = [finding for finding in demands.findings if finding.kind == "motor_reconstruction"]
    return replace(outputs, findings=(*outputs.findings, *(disagreeing if faster else ())))


def _told(history: MotorHistory, agreement: Agreement | None) -> Iterator[Finding]:
    if agreement is None:
        yield Finding(
            kind="motor_reconstruction",
            severity="warning",
            where=history.source,
            message="The motors follow from the commands and the mixer, and could not be checked against logged ones.",
        )
        return
    agrees = agreement.agrees
    message = (
        f"Motors at {history.sample_rate_hz:.0f} Hz from the commands {'agree' if agrees else 'do not agree'} with "
        f"{agreement.samples} samples of the logged ones: {100.0 * agreement.rms:.2f} % of their range rms, "
        f"{100.0 * agreement.unexplained:.2f} % of their variance."
    )
    yield Finding(
        kind="motor_reconstruction",
        severity="info" if agrees else "warning",
        where=history.source,
        message=message if agrees else f"{message} {_reason(agreement)}",
        numbers={
            "samples": float(agreement.samples),
            "gain": agreement.gain,
            "rms": agreement.rms,
            "unexplained": agreement.unexplained,
            "shift": float(agreement.shift),
            **{f"correlation_{axis}": one for axis, one in zip(AXES, agreement.correlations, strict=True)},
        },
    )


def _reason(agreement: Agreement) -> str:
    """Why the two do not agree: a wrong layout turns a sign around or mixes axes, and slow logs lose what is fast."""
    wrong = [axis for axis, one in zip(AXES, agreement.correlations, strict=True) if one < _RELATED]
    if wrong:
        return f"{' and '.join(wrong)} do not fit: the layout or the mixer is not what it is taken for."
    return "All axes fit: commands and motors were not logged at the same instants, and move in between."


def _slow_thrust(record: FlightRecord) -> Iterator[Finding]:
    """A thrust command that is slower than the others is interpolated, and its motion between samples lost."""
    rates = {name: next(record.holding(name))[0].sample_rate_hz for name in COMMANDS}
    if rates["thrust_command"] * _FASTER < rates["roll_command"]:
        rate_hz = rates["thrust_command"]
        yield Finding(
            kind="rate_too_low",
            severity="warning",
            where="thrust_command",
            message=f"thrust_command is logged at {rate_hz:.1f} Hz, roll_command at {rates['roll_command']:.1f} Hz: "
            "thrust in between is interpolated.",
            numbers={"rate_hz": rate_hz, "needed_hz": rates["roll_command"]},
        )
