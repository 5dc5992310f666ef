"""What the motors were told, or how fast they turned, at the fastest rate that a log tells truly."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from rotorid.data.channel import LOWEST_RATE_HZ, MOTORS, STANDARD_UNITS, Channel
from rotorid.data.findings import Finding
from rotorid.data.immutable import Immutable, read_only
from rotorid.data.record import FlightRecord, Topic
from rotorid.errors import InsufficientDataError
from rotorid.signal.airborne import airborne
from rotorid.signal.autopilot_mixer import linearization_of
from rotorid.typing import BoolArray, FloatArray

Kind: TypeAlias = Literal["output", "thrust_demand", "speed"]
"""``output``: what the motor controller receives; ``thrust_demand``: the share of the largest thrust that the autopilot
wants, before it straightens the motor's curve; ``speed``: measured, rad/s."""

_AT_LIMIT = 1e-3
_WORTH_SAYING = 1e-3
_REMEDIES = {
    "ArduPilot": "log fast attitude (bit 0 of LOG_BITMASK), from which the motors follow at the rate of the loop",
    "PX4": "log at a high rate (bit 4 of SDLOG_PROFILE)",
    "Betaflight": "raise the rate of the blackbox (blackbox_sample_rate)",
    "Crazyflie": "set a higher frequency in config.txt on the card",
}


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
    saturated_share
        Part of the samples in flight in which a motor stood at a limit.
    findings
        What an engineer would remark on them.
    """

    kind: Kind
    time_s: FloatArray
    values: FloatArray
    source: str
    saturated_share: float = 0.0
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        time_s = read_only(self.time_s, np.float64, ndim=1)
        values = read_only(self.values, np.float64, ndim=2)
        if values.shape[1] != time_s.size:
            raise ValueError(f"values of shape {values.shape} came for {time_s.size} stamps")
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


_PREFIX: dict[Kind, str] = {"output": "motor_", "thrust_demand": "motor_", "speed": "motor_speed_"}


def with_motors(record: FlightRecord, history: MotorHistory) -> FlightRecord:
    """The record with these motors as its first choice, so that they come onto one clock with everything else."""
    return replace(record, topics=(history.topic(), *record.topics))


def logged_outputs(record: FlightRecord) -> MotorHistory:
    """Outputs ``motor_1`` and on as the log holds them: demands of thrust in a PX4 log, outputs in all others.

    Parameters
    ----------
    record
        The log.

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
    time_s, values, source = on_one_clock(record, motor_channels(record, "motor_"))
    # What PX4 logs is asked of the motors in thrust; THR_MDL_FAC bends it on its way out.
    kind: Kind = "thrust_demand" if record.source.format.startswith("PX4") else "output"
    return judged(record, MotorHistory(kind=kind, time_s=time_s, values=values, source=source))


def logged_speeds(record: FlightRecord) -> MotorHistory:
    """Measured speeds ``motor_speed_1`` and on, rad/s.

    Raises
    ------
    InsufficientDataError
        There are none.
    """
    time_s, values, source = on_one_clock(record, motor_channels(record, "motor_speed_"))
    return judged(record, MotorHistory(kind="speed", time_s=time_s, values=values, source=source))


def motor_channels(record: FlightRecord, prefix: str) -> tuple[str, ...]:
    """The motors that a log holds, from the first without a gap in the numbers.

    Raises
    ------
    InsufficientDataError
        There are none, or one is missing in between.
    """
    pattern = re.compile(rf"{prefix}(\d+)")
    numbers = sorted(int(match[1]) for name in record.channel_names if (match := pattern.fullmatch(name)))
    if numbers != list(range(1, len(numbers) + 1)) or not numbers:
        held = ", ".join(f"{prefix}{number}" for number in numbers) or "none of them"
        message = f"{record.source.name} holds {held} of {prefix}1, {prefix}2 and on."
        finding = Finding(kind="missing_channel", severity="error", where=f"{prefix}1", message=message)
        raise InsufficientDataError(message, needed="all motors", remedy=_remedy(record), findings=[finding])
    return tuple(f"{prefix}{number}" for number in numbers[:MOTORS])


def on_one_clock(record: FlightRecord, names: Sequence[str]) -> tuple[FloatArray, FloatArray, str]:
    """Channels on the stamps of the first of them, where all of them last: stamps, values and where they come from.

    Channels of one topic pass unchanged; others are interpolated by straight lines.

    Raises
    ------
    InsufficientDataError
        A channel is missing, or they do not last together.
    """
    series: dict[str, tuple[FloatArray, FloatArray, str]] = {}
    for name in names:
        held = next(record.holding(name), None)
        if held is not None:
            topic, row = held
            kept = np.isfinite(topic.values[row]) & np.isfinite(topic.time_s)
            stamps, first = np.unique(topic.time_s[kept], return_index=True)
            series[name] = stamps, topic.values[row][kept][first], topic.name
    missing = [name for name in names if name not in series or series[name][0].size < 2]
    clock = series[names[0]][0] if not missing else np.empty(0)
    if not missing:
        start = max(stamps[0] for stamps, _, _ in series.values())
        stop = min(stamps[-1] for stamps, _, _ in series.values())
        clock = clock[(clock >= start) & (clock <= stop)]
    if clock.size < 2:
        message = f"{record.source.name} holds no {', '.join(missing or names)} that last together."
        finding = Finding(kind="missing_channel", severity="error", where=names[0], message=message)
        raise InsufficientDataError(message, needed=", ".join(names), remedy=_remedy(record), findings=[finding])
    rows = [np.interp(clock, series[name][0], series[name][1]) for name in names]
    return clock, np.stack(rows), ", ".join(dict.fromkeys(source for _, _, source in series.values()))


def _remedy(record: FlightRecord) -> str:
    return next((text for name, text in _REMEDIES.items() if record.source.format.startswith(name)), "")


def judged(record: FlightRecord, history: MotorHistory) -> MotorHistory:
    """The history with its saturation and with remarks on its rate and saturation."""
    share = saturated_share(record, history)
    findings = [*history.findings]
    rate_hz = history.sample_rate_hz
    if rate_hz < LOWEST_RATE_HZ:
        findings.append(
            Finding(
                kind="rate_too_low",
                severity="warning",
                where=history.source,
                message=f"{history.source} tells the motors at {rate_hz:.1f} Hz, too slowly for the lag of a motor, "
                f"which needs at least {LOWEST_RATE_HZ:.0f} Hz{'; ' if _remedy(record) else ''}{_remedy(record)}.",
                numbers={"rate_hz": rate_hz, "needed_hz": LOWEST_RATE_HZ},
            )
        )
    if share > _WORTH_SAYING:
        findings.append(
            Finding(
                kind="saturation",
                severity="warning" if share > 10.0 * _WORTH_SAYING else "info",
                where=history.source,
                message=f"A motor stood at a limit in {100.0 * share:.1f} % of the flight.",
                numbers={"saturated_share": share},
            )
        )
    return replace(history, saturated_share=share, findings=tuple(findings))


def saturated_share(record: FlightRecord, history: MotorHistory) -> float:
    """Part of the samples in flight in which a motor stood at a limit; zero for measured speeds."""
    if history.kind == "speed":
        return 0.0
    flown = in_flight(record, history.time_s)
    return float(np.mean(at_limit(record, history)[flown])) if flown.any() else 0.0


def at_limit(record: FlightRecord, history: MotorHistory) -> BoolArray:
    """Samples in which a motor has no output left to give or to take, shape ``(samples,)``."""
    known = linearization_of(record) if history.kind == "output" else None
    low, high = (known.low, known.high) if known is not None else (0.0, 1.0)
    near = (history.values <= low + _AT_LIMIT) | (history.values >= high - _AT_LIMIT)
    return np.asarray(near.any(axis=0))


def in_flight(record: FlightRecord, time_s: FloatArray) -> BoolArray:
    """Which stamps lie in a flight; all of them where no flight can be told."""
    try:
        intervals = airborne(record).intervals
    except InsufficientDataError:
        return np.ones(time_s.size, dtype=np.bool_)
    inside = [(time_s >= start) & (time_s <= stop) for start, stop in intervals]
    return np.asarray(np.any(inside, axis=0))
