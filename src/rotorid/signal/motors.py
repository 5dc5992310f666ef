r"""The motors of a flight as one history: logged outputs, measured speeds, or what follows from faster commands.

Where the log holds the commands of the controllers faster than the motors, the mixer makes the motors from them.
ArduPilot asks each motor for a share of the largest thrust that is linear in the commands, and PX4 for an actuator that
is:

.. math:: d_i = m_{i1} u_{roll} + m_{i2} u_{pitch} + m_{i3} u_{yaw} + m_{i4} u_{thrust}

as long as no motor is at a limit; beyond, yaw and then thrust give way. ArduPilot then undoes what it knows of the
motor: with the expo :math:`e` (``MOT_THST_EXPO``), the air's density over that at sea level :math:`\rho` and the
battery's resting voltage over its highest :math:`v` (``MOT_BAT_VOLT_MAX``, one without it), the output is

.. math:: x_i = x_0 + \frac{x_1 - x_0}{v} s(d_i / \rho), \qquad s(t) = \frac{e - 1 + \sqrt{(1 - e)^2 + 4 e t}}{2 e}

between ``MOT_SPIN_MIN`` and ``MOT_SPIN_MAX``. The demand is therefore the better input for a model whose thrust is
linear, and the output for one whose curve is to be found. Whether motors that follow from commands are those of the
vehicle is checked against the logged ones, however slow.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from rotorid.autopilots.registry import autopilot_of
from rotorid.autopilots.thrust import Linearization
from rotorid.data.base import Immutable, cached_by_value, read_only
from rotorid.data.findings import Finding, refusal, remark, warn
from rotorid.data.record import AXES, LOWEST_RATE_HZ, MOTORS, STANDARD_UNITS, Channel, FlightRecord, Topic, places
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.signal.limits import MotorLimits, Range, limits_of
from rotorid.typing import FloatArray

COMMANDS = ("roll_command", "pitch_command", "yaw_command", "thrust_command")
"""Columns of a mixer."""

Kind: TypeAlias = Literal["output", "thrust_demand", "speed"]
"""``output``: what the motor controller receives; ``thrust_demand``: the share of the largest thrust that the autopilot
wants, before it straightens the motor's curve; ``speed``: measured, rad/s."""

_FASTER = 1.5
"""Factor by which one rate must exceed another to count as the faster one."""

_RELATED = 0.5
"""Correlation of an axis of commands and motors below which the layout or the mixer is another one."""

_PREFIX: dict[Kind, str] = {"output": "motor_", "thrust_demand": "motor_", "speed": "motor_speed_"}


@dataclass(frozen=True, kw_only=True, eq=False)
class MotorHistory(Immutable):
    """All motors of a flight on one clock.

    Parameters
    ----------
    kind
        What the values are.
    time_s
        Stamps on the log's own clock, shape ``(samples,)``, as logged: rising, not uniform.
    values
        Shape ``(motors, samples)``; 0 to 1, or rad/s.
    source
        Where they come from.
    findings
        What an engineer would remark on them.
    """

    kind: Kind
    time_s: FloatArray
    values: FloatArray
    source: str
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        time_s = read_only(self.time_s, np.float64, ndim=1)
        values = read_only(self.values, np.float64, ndim=2)
        if values.shape[1] != time_s.size:
            raise ValueError(f"got values of shape {values.shape} for {time_s.size} stamps")
        self._set(time_s=time_s, values=values, findings=tuple(self.findings))

    @property
    def motors(self) -> int:
        return int(self.values.shape[0])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the channels."""
        prefix = _PREFIX[self.kind]
        return tuple(f"{prefix}{number}" for number in range(1, self.motors + 1))

    @property
    def sample_rate_hz(self) -> float:
        """Median rate of the stamps; zero for fewer than two samples."""
        steps = np.diff(self.time_s)
        return float(1.0 / np.median(steps)) if steps.size else 0.0

    def topic(self) -> Topic:
        """The same as a topic of a record."""
        channels = tuple(Channel(name=name, unit=STANDARD_UNITS[name], source=self.source) for name in self.names)
        return Topic(name=self.source, time_s=self.time_s, channels=channels, values=self.values)


def motor_history(record: FlightRecord, mixer: FloatArray | None = None) -> MotorHistory:
    """The motors as truly and as fast as they were logged.

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


def with_motors(record: FlightRecord, history: MotorHistory) -> FlightRecord:
    """The record with these motors as its first choice, so that they come onto one clock with everything else."""
    return replace(record, topics=(history.topic(), *record.topics))


def logged_outputs(record: FlightRecord) -> MotorHistory:
    """Outputs ``motor_1`` and on as the log holds them: demands of thrust in a PX4 log, outputs in all others.

    Raises
    ------
    InsufficientDataError
        There are none.

    Examples
    --------
    >>> from rotorid.data.record import Source
    >>> channels = tuple(Channel(name=f"motor_{number}", unit="1") for number in (1, 2))
    >>> topic = Topic(name="RCOU", time_s=np.arange(5.0), channels=channels, values=np.full((2, 5), 0.4))
    >>> record = FlightRecord(source=Source(name="a.bin", format="ArduPilot DataFlash", sha256=""), topics=(topic,))
    >>> history = logged_outputs(record)
    >>> history.kind, history.motors, [finding.kind for finding in history.findings]
    ('output', 2, ['rate_too_low'])
    """
    return with_remarks(record, _outputs(record))


def _outputs(record: FlightRecord) -> MotorHistory:
    time_s, values, source = on_common_stamps(record, motor_channels(record, "motor_"))
    kind: Kind = "thrust_demand" if autopilot_of(record).log.thrust_demand else "output"
    return MotorHistory(kind=kind, time_s=time_s, values=values, source=source)


@cached_by_value
def motor_limits(record: FlightRecord) -> MotorLimits:
    """When each motor of a log was at a limit, and why: the answer of every command.

    Parameters
    ----------
    record
        The log. One without the outputs of all motors, without a flight or without their range gives limits that are
        not known, and says why.

    Examples
    --------
    >>> from rotorid.data.record import Source
    >>> wave = 0.5 + 0.6 * np.sin(np.arange(0.0, 100.0, 0.01))
    >>> values = np.clip(np.stack([wave, 1.0 - wave]), 0.0, 1.0)
    >>> channels = tuple(Channel(name=f"motor_{number}", unit="1") for number in (1, 2))
    >>> topic = Topic(name="motors", time_s=np.arange(wave.size) / 100.0, channels=channels, values=values)
    >>> source = Source(name="log.bbl", format="Betaflight blackbox", sha256="")
    >>> limits = motor_limits(FlightRecord(source=source, topics=(topic,)))
    >>> round(limits.share, 2), round(limits.upper_share, 2), limits.causes["unknown"] == limits.share
    (0.38, 0.38, True)
    """
    try:
        outputs = _outputs(record)
    except InsufficientDataError:
        return limits_of(record, np.zeros(0), np.zeros((1, 0)), None)
    return _limits_of(record, outputs)


def _limits_of(record: FlightRecord, history: MotorHistory) -> MotorLimits:
    return limits_of(record, history.time_s, history.values, _motor_range(record, history))


def _motor_range(record: FlightRecord, history: MotorHistory) -> Range | None:
    """Outputs of no and of full thrust; ``None`` where the log does not say them."""
    if history.kind == "thrust_demand" or autopilot_of(record).log.outputs_scaled:
        return 0.0, 1.0
    known = linearization_of(record)
    return None if known is None else (known.low, known.high)


def logged_speeds(record: FlightRecord) -> MotorHistory:
    """Measured speeds ``motor_speed_1`` and on, rad/s, without the sign that some logs give to a direction.

    Raises
    ------
    InsufficientDataError
        There are none, or only those of some motors.
    """
    numbers, outputs = _motor_numbers(record, "motor_speed_"), _motor_numbers(record, "motor_")
    if 0 < len(numbers) < len(outputs):
        # As motors of the vehicle they would be those of one with fewer rotors.
        one = len(numbers) == 1
        message = (
            f"The speed{'' if one else 's'} of {len(numbers)} motor{'' if one else 's'} of {len(outputs)} "
            f"{'is' if one else 'are'} logged."
        )
        finding = refusal("missing_channel", "motor speeds", message)
        raise InsufficientDataError(message, needed="the speeds of all motors", findings=[finding])
    time_s, values, source = on_common_stamps(record, motor_channels(record, "motor_speed_"))
    return with_remarks(record, MotorHistory(kind="speed", time_s=time_s, values=np.abs(values), source=source))


def or_none(read: Callable[[FlightRecord], MotorHistory], record: FlightRecord) -> MotorHistory | None:
    """Motors that a log may not hold."""
    try:
        return read(record)
    except InsufficientDataError:
        return None


def motor_channels(record: FlightRecord, prefix: str) -> tuple[str, ...]:
    """The motors that a log holds, from the first without a gap in the numbers.

    Raises
    ------
    InsufficientDataError
        There are none, or one is missing in between.
    """
    numbers = _motor_numbers(record, prefix)
    if numbers != list(range(1, len(numbers) + 1)) or not numbers:
        available = ", ".join(f"{prefix}{number}" for number in numbers)
        found = f"only {available}" if numbers else "none"
        message = f"{record.source.name} has {found} of {prefix}1, {prefix}2 and so on."
        finding = refusal("missing_channel", f"{prefix}1", message)
        raise InsufficientDataError(message, needed="all motors", findings=[finding])
    return tuple(f"{prefix}{number}" for number in numbers[:MOTORS])


def _motor_numbers(record: FlightRecord, prefix: str) -> list[int]:
    pattern, names = re.compile(rf"{prefix}(\d+)"), record.outputs if prefix == "motor_" else record.channel_names
    return sorted(int(match[1]) for name in names if (match := pattern.fullmatch(name)))


def on_common_stamps(record: FlightRecord, names: Sequence[str]) -> tuple[FloatArray, FloatArray, str]:
    """Channels on the stamps of the first of them, where all of them last: stamps, values and where they come from.

    Channels of one topic pass unchanged; others are interpolated by straight lines.

    Raises
    ------
    InsufficientDataError
        A channel is missing, or they do not last together.
    """
    series: dict[str, tuple[FloatArray, FloatArray, tuple[Topic, int]]] = {}
    for name in names:
        source = next(record.holding(name), None)
        if source is not None:
            topic, row = source
            kept = np.isfinite(topic.values[row]) & np.isfinite(topic.time_s)
            stamps, first = np.unique(topic.time_s[kept], return_index=True)
            series[name] = stamps, topic.values[row][kept][first], source
    missing = [name for name in names if name not in series or series[name][0].size < 2]
    clock = series[names[0]][0] if not missing else np.empty(0)
    if not missing:
        start = max(stamps[0] for stamps, _, _ in series.values())
        stop = min(stamps[-1] for stamps, _, _ in series.values())
        clock = clock[(clock >= start) & (clock <= stop)]
    if clock.size < 2:
        message = f"{record.source.name} has no {', '.join(missing or names)} that last together."
        finding = refusal("missing_channel", names[0], message)
        raise InsufficientDataError(message, needed=", ".join(names), findings=[finding])
    rows = [np.interp(clock, series[name][0], series[name][1]) for name in names]
    return clock, np.stack(rows), places(source for _, _, source in series.values())


def with_remarks(record: FlightRecord, history: MotorHistory) -> MotorHistory:
    """The history with remarks on its rate and its limits."""
    findings = [*history.findings]
    rate_hz = history.sample_rate_hz
    if rate_hz < LOWEST_RATE_HZ:
        findings.append(
            warn(
                "rate_too_low",
                history.source,
                f"{history.source} logs the motors at {rate_hz:.1f} Hz, too slowly for the lag of a motor, "
                f"which needs at least {LOWEST_RATE_HZ:.0f} Hz.",
                rate_hz=rate_hz,
                needed_hz=LOWEST_RATE_HZ,
            )
        )
    if history.kind != "speed":
        # Logged outputs are what the motors got; demands say it where no output is logged.
        logged = motor_limits(record)
        limits = _limits_of(record, history) if logged.unknown else logged
        findings += limits.remarks()
    return replace(history, findings=tuple(findings))


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
    time_s, commands, source = on_common_stamps(record, COMMANDS)
    history = MotorHistory(
        kind="thrust_demand",
        time_s=time_s,
        values=np.asarray(mixer, dtype=np.float64) @ commands,
        source=f"mixer of {source}",
    )
    agreement = agreement_of(record, history, mixer)
    remarks = (*_reconstruction_findings(history, agreement), *_slow_thrust(record))
    return with_remarks(record, replace(history, findings=remarks)), agreement


def _reconstruction_findings(history: MotorHistory, agreement: Agreement | None) -> Iterator[Finding]:
    if agreement is None:
        yield warn(
            "motor_reconstruction",
            history.source,
            "The motors follow from the commands and the mixer, and could not be checked against logged ones.",
        )
        return
    agrees = agreement.agrees
    message = (
        f"Motors at {history.sample_rate_hz:.0f} Hz from the commands {'agree' if agrees else 'do not agree'} with "
        f"{agreement.samples} samples of the logged ones: {100.0 * agreement.rms:.2f} % of their range rms, "
        f"{100.0 * agreement.unexplained:.2f} % of their variance."
    )
    yield (remark if agrees else warn)(
        "motor_reconstruction",
        history.source,
        message if agrees else f"{message} {_reason(agreement)}",
        **{
            "samples": float(agreement.samples),
            "gain": agreement.gain,
            "rms": agreement.rms,
            "unexplained": agreement.unexplained,
            "shift": float(agreement.shift),
            **{
                f"correlation_{axis}": correlation
                for axis, correlation in zip(AXES, agreement.correlations, strict=True)
            },
        },
    )


def _reason(agreement: Agreement) -> str:
    """Why the two do not agree: a wrong layout turns a sign around or mixes axes, and slow logs lose what is fast."""
    wrong = [axis for axis, correlation in zip(AXES, agreement.correlations, strict=True) if correlation < _RELATED]
    if wrong:
        return f"{' and '.join(wrong)} do not fit: the layout or the mixer is not what it is taken for."
    return "All axes fit: commands and motors were not logged at the same instants, and move in between."


def _slow_thrust(record: FlightRecord) -> Iterator[Finding]:
    """A thrust command that is slower than the others is interpolated, and its motion between samples lost."""
    rates = {name: next(record.holding(name))[0].sample_rate_hz for name in COMMANDS}
    if rates["thrust_command"] * _FASTER < rates["roll_command"]:
        rate_hz = rates["thrust_command"]
        yield warn(
            "rate_too_low",
            "thrust_command",
            f"thrust_command is logged at {rate_hz:.1f} Hz, roll_command at {rates['roll_command']:.1f} Hz: "
            "thrust in between is interpolated.",
            rate_hz=rate_hz,
            needed_hz=rates["roll_command"],
        )


EXPLAINED = 0.01
"""A reconstruction agrees when it leaves no more than this part of the variance of the logged outputs."""

_SHIFTS = range(-3, 4)

_FEWEST = 20
"""Samples without which commands and motors are not compared."""

_RESOLUTION = 1e-3
"""Outputs are logged in microseconds, a thousandth of their range."""


@dataclass(frozen=True, kw_only=True)
class Agreement(Immutable):
    """Reconstructed against logged outputs, in flight and away from the limits.

    Parameters
    ----------
    samples
        Logged samples that were compared, of each motor.
    gain
        Factor on the demands that agrees best: one over the density of the air for ArduPilot, which compensates it.
    rms
        Of the difference, as a part of the range of the outputs.
    unexplained
        Variance of the difference over that of the logged outputs.
    shift
        Samples of the commands by which these are later than the outputs; zero where both are logged in one loop.
    correlations
        Of roll, pitch, yaw and thrust command with what the mixer, inverted, makes of the logged outputs: near one for
        the right layout, negative for a wrong sign, whatever the rates.
    """

    samples: int
    gain: float
    rms: float
    unexplained: float
    shift: int
    correlations: tuple[float, ...]

    @property
    def agrees(self) -> bool:
        """Whether what is left is small, or no more than the resolution of the log."""
        return self.samples >= _FEWEST and (self.unexplained <= EXPLAINED or self.rms <= _RESOLUTION)


def agreement_of(record: FlightRecord, demands: MotorHistory, mixer: FloatArray) -> Agreement | None:
    """Demands from commands against the logged outputs, in flight and away from limits.

    Parameters
    ----------
    demands
        Of the kind ``thrust_demand``, faster or slower than the outputs.
    mixer
        Columns roll, pitch, yaw and thrust, shape ``(motors, 4)``.

    Returns
    -------
    Agreement or None
        ``None`` where there are no or too few outputs, or how they follow from demands is not known.

    Raises
    ------
    UsageError
        The log holds another number of motors.
    """
    outputs, known = or_none(logged_outputs, record), linearization_of(record)
    if outputs is None or known is None:
        return None
    if outputs.motors != demands.motors:
        raise UsageError(
            f"got a mixer of {demands.motors} motors for a log of {outputs.motors}",
            needed="the layout of this vehicle",
        )
    clock, step_s = demands.time_s, float(np.median(np.diff(demands.time_s)))
    margin_s = max(_SHIFTS) * step_s
    inside = (outputs.time_s >= clock[0] + margin_s) & (outputs.time_s <= clock[-1] - margin_s)
    limits = motor_limits(record)
    kept = inside & (limits.counted | ~limits.counted.any()) & ~limits.limited
    if np.count_nonzero(kept) < _FEWEST:
        return None
    stamps, share = outputs.time_s[kept], voltage_share(record, known, outputs.time_s[kept])
    logged = known.demands(outputs.values[:, kept], voltage_share=share)
    shift = min(_SHIFTS, key=lambda trial: _rest(_sampled(demands, stamps + trial * step_s), logged)[1])
    wanted = _sampled(demands, stamps + shift * step_s)
    gain = _rest(wanted, logged)[0]
    actual = known.outputs(logged, voltage_share=share)
    difference = known.outputs(wanted, gain=gain, voltage_share=share) - actual
    variance, residual = float(np.mean(np.var(actual, axis=1))), float(np.mean(difference**2))
    return Agreement(
        samples=stamps.size,
        gain=gain,
        rms=float(np.sqrt(residual)) / (known.high - known.low),
        unexplained=residual / variance if variance > 0.0 else np.inf,
        shift=shift,
        correlations=_correlations(mixer, wanted, logged),
    )


def _sampled(history: MotorHistory, time_s: FloatArray) -> FloatArray:
    return np.stack([np.interp(time_s, history.time_s, row) for row in history.values])


def _rest(wanted: FloatArray, logged: FloatArray) -> tuple[float, float]:
    """Gain of the demands that agrees best, and the mean square that it leaves."""
    gain = float(np.sum(wanted * logged) / np.sum(wanted**2))
    return gain, float(np.mean((gain * wanted - logged) ** 2))


def _correlations(mixer: FloatArray, wanted: FloatArray, logged: FloatArray) -> tuple[float, ...]:
    """Of each command in the demands with that in the outputs; zero for a command that never moved."""
    inverse = np.linalg.pinv(mixer)
    pairs = zip(inverse @ wanted, inverse @ logged, strict=True)
    return tuple(
        float(np.corrcoef(asked, made)[0, 1]) if np.ptp(asked) > 0.0 and np.ptp(made) > 0.0 else 0.0
        for asked, made in pairs
    )


def voltage_share(record: FlightRecord, known: Linearization, time_s: FloatArray) -> FloatArray:
    """What the autopilot divided its outputs by; one where the log does not hold the voltage, which the gain takes."""
    source = next(record.holding("battery_voltage"), None)
    if source is None or not known.compensates_voltage:
        return np.ones(time_s.size)
    topic, row = source
    return known.voltage_share(np.interp(time_s, topic.time_s, topic.values[row]))


def linearization_of(record: FlightRecord) -> Linearization | None:
    """How the autopilot that wrote a log turns demands into its motor outputs; ``None`` when that is not known."""
    return autopilot_of(record).log.linearization(record)


WINDOW_S = 2.0
"""The voltage is averaged over this time: faster changes are noise, or sag that follows the motors themselves."""


@dataclass(frozen=True, kw_only=True, eq=False)
class VoltageFactor(Immutable):
    r"""Thrust at the logged voltage over thrust at the reference voltage, for the same output.

    Parameters
    ----------
    values
        :math:`(V / V_0)^2`, shape ``(samples,)``.
    reference_v
        :math:`V_0`.
    spread
        Highest over lowest value, less one: what a model without this factor is wrong by.
    """

    values: FloatArray
    reference_v: float
    spread: float

    def __post_init__(self) -> None:
        self._set(values=read_only(self.values, np.float64, ndim=1))


def voltage_factor(record: FlightRecord, time_s: FloatArray, *, reference_v: float | None = None) -> VoltageFactor:
    r"""What to multiply the thrust of an output with, since motors turn more slowly on a weaker battery.

    .. math:: T(x, V) = T(x, V_0) \, (V / V_0)^2

    Holds for controllers of the motors' duty cycle, whose speed is proportional to the voltage; those that control the
    speed itself, measured speeds, and demands that the autopilot compensates (ArduPilot with ``MOT_BAT_VOLT_MAX``) need
    no factor. Voltage under load is not that at the motor: the resistance of the wires is left out.

    Parameters
    ----------
    record
        Holds ``battery_voltage``.
    time_s
        Stamps on the log's own clock at which the factor is wanted, shape ``(samples,)``.
    reference_v
        :math:`V_0`; the median over ``time_s`` by default, so that parameters belong to the middle of the record.

    Raises
    ------
    InsufficientDataError
        The log holds no voltage.

    Examples
    --------
    >>> from rotorid.data.record import Channel
    >>> from rotorid.data.record import Source, Topic
    >>> time_s = np.arange(0.0, 60.0, 0.1)
    >>> topic = Topic(name="BAT", time_s=time_s, channels=(Channel(name="battery_voltage", unit="V"),),
    ...               values=(12.0 - 0.02 * time_s)[None])
    >>> record = FlightRecord(source=Source(name="a.bin", format="ArduPilot DataFlash", sha256=""), topics=(topic,))
    >>> voltage_factor(record, np.array([10.0, 50.0]), reference_v=12.0).values.round(4).tolist()
    [0.9669, 0.8403]
    """
    stamps, volts = _voltage(record)
    smooth = _averaged(stamps, volts, np.asarray(time_s, dtype=np.float64))
    reference = float(np.median(smooth)) if reference_v is None else reference_v
    values = (smooth / reference) ** 2
    spread = float(values.max() / values.min() - 1.0) if values.size else 0.0
    return VoltageFactor(values=values, reference_v=reference, spread=spread)


def _voltage(record: FlightRecord) -> tuple[FloatArray, FloatArray]:
    for topic, row in record.holding("battery_voltage"):
        kept = np.isfinite(topic.values[row]) & (topic.values[row] > 0.0) & np.isfinite(topic.time_s)
        order = np.argsort(topic.time_s[kept], kind="stable")
        if kept.any():
            return topic.time_s[kept][order], topic.values[row][kept][order]
    raise InsufficientDataError(
        f"{record.source.name} has no battery_voltage",
        needed="the voltage of the battery",
        remedy="turn on the battery monitor, or leave the compensation out",
    )


def _averaged(stamps: FloatArray, volts: FloatArray, time_s: FloatArray) -> FloatArray:
    """Mean voltage around each time: a difference of the integral of the straight lines between the samples."""
    if stamps.size == 1:
        return np.full(time_s.shape, volts[0])
    area = np.concatenate([[0.0], np.cumsum(0.5 * (volts[1:] + volts[:-1]) * np.diff(stamps))])
    low = np.clip(time_s - 0.5 * WINDOW_S, stamps[0], stamps[-1])
    high = np.clip(time_s + 0.5 * WINDOW_S, stamps[0], stamps[-1])
    width = high - low
    mean = np.divide(
        _integral(stamps, volts, area, high) - _integral(stamps, volts, area, low),
        width,
        out=np.interp(time_s, stamps, volts),
        where=width > 0.5 * min(WINDOW_S, float(stamps[-1] - stamps[0])),
    )
    return np.asarray(mean)


def _integral(stamps: FloatArray, volts: FloatArray, area: FloatArray, time_s: FloatArray) -> FloatArray:
    before = np.clip(np.searchsorted(stamps, time_s, side="right") - 1, 0, stamps.size - 2)
    step = time_s - stamps[before]
    here = np.interp(time_s, stamps, volts)
    return np.asarray(area[before] + 0.5 * (volts[before] + here) * step)
