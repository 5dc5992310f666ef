r"""Set-point, rate and command by frequency, in windows: how a logged command was made.

A controller makes its command of set-point and rate alone, :math:`U = C_r R - C_y Y`, whatever the vehicle is and
whatever moves it. So a controller is checked on any flight: no excitation is needed, and gusts do no harm.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.autopilots.advice import logging_advice
from rotorid.autopilots.registry import autopilot_of
from rotorid.data.axes import RATE_OF
from rotorid.data.base import Immutable
from rotorid.data.record import STANDARD_UNITS, FlightRecord, TimeHistory
from rotorid.errors import InsufficientDataError
from rotorid.signal.airborne import airborne
from rotorid.signal.clock import resample
from rotorid.typing import Axis, BoolArray, ComplexArray, FloatArray

_WINDOW_S = 4.0
"""Long enough that the lowest frequency is the second line of a window: the first contains the drift of the integral.
"""

_LONGEST_S = 300.0
"""Of a longer flight the middle is compared."""

_LOWEST_RAD_S, _NYQUIST_SHARE = 3.0, 0.8
"""Below the one the angle loop moves the set-point, beyond the other a log folds the command."""

_RELATED = 0.8
"""Share of the command that set-point and rate explain together, whatever the controller, at a frequency that counts:
elsewhere the log is too slow, or something else made the command."""

LEAST_RATE_HZ = 20.0
"""Slower logs fold what they hold onto other frequencies: one of a limit cycle at 23 Hz showed 2.6 times its gains."""

LEAST_WINDOWS, LEAST_FREQUENCIES = 4, 8

_LEAST_RELATED = 0.5
"""Least share of the power of a signal at the frequencies that count."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CommandRelation(Immutable):
    """Signals of a controller and what goes into them, transformed in windows that overlap by half.

    Parameters
    ----------
    omega_rad_s
        Shape ``(f,)``.
    signals
        Command, or terms of the controller, by channel; shape ``(windows, f)``. An excitation of the command is taken
        off.
    rate, setpoint
        What goes in, shape ``(windows, f)``; no set-point where none was asked for.
    throttle
        Mean of the throttle stick, shape ``(windows,)``; zero where it is not logged.
    source
        Where the rate stands in the log.
    sample_rate_hz
        Of the common clock.
    """

    omega_rad_s: FloatArray
    signals: Mapping[str, ComplexArray]
    rate: ComplexArray
    setpoint: ComplexArray | None
    throttle: FloatArray
    source: str
    sample_rate_hz: float

    def __post_init__(self) -> None:
        self._set(signals=self.signals)

    def unrelated(self, name: str) -> FloatArray:
        """Share of a signal's power that no linear relation to set-point and rate explains, shape ``(f,)``."""
        signal = self.signals[name]
        inside = [self.rate] if self.setpoint is None else [self.rate, self.setpoint]
        stacked = np.stack(inside, axis=-1)
        squares = np.einsum("wfi,wfj->fij", stacked.conj(), stacked)
        products = np.einsum("wfi,wf->fi", stacked.conj(), signal)
        fitted = np.linalg.pinv(squares, hermitian=True) @ products[..., None]
        size = np.sum(np.abs(signal) ** 2, axis=0)
        left = size - np.sum(products.conj() * fitted[..., 0], axis=1).real
        return np.asarray(np.divide(np.maximum(left, 0.0), size, out=np.ones_like(left), where=size > 0.0))

    def related(self, name: str, highest_rad_s: float = np.inf) -> BoolArray:
        """Frequencies at which what goes in explains a signal by some linear relation; none where these are too few.

        Parameters
        ----------
        highest_rad_s
            Faster motion is left out.
        """
        inside = self.omega_rad_s <= highest_rad_s
        found = np.asarray(inside & (self.unrelated(name) < 1.0 - _RELATED))
        power = np.sum(np.abs(self.signals[name]) ** 2, axis=0) * inside
        enough = np.count_nonzero(found) >= LEAST_FREQUENCIES and power[found].sum() >= _LEAST_RELATED * power.sum()
        return found if enough else np.zeros_like(found)


def command_relation(
    record: FlightRecord, axis: Axis, signals: Sequence[str], *, setpoint: str | None, differences: int = 1
) -> CommandRelation:
    """Signals of the controller of an axis over the longest flight, and what went into them.

    Parameters
    ----------
    axis
        ``roll``, ``pitch`` or ``yaw``.
    signals
        Channels that the controller made.
    setpoint
        What drove it; ``None`` where the signals do not depend on it.
    differences
        How often each signal is differenced before it is cut into windows. Two keep slow motion that is a hundred times
        larger out of the lowest frequencies, and bring more noise of the fast ones there.

    Raises
    ------
    InsufficientDataError
        A channel is not logged, or not fast or not long enough.
    """
    rate = RATE_OF[axis]
    needed = [*signals, rate, *([setpoint] if setpoint else [])]
    further = [name for name in _accompanying(record, axis) if name in record.channel_names]
    for name in needed:
        if name not in record.channel_names:
            raise InsufficientDataError(f"The log has no {name}", needed=f"{name}, with command and rate")
    start_s, stop_s = _flight(record)
    flown = resample(record, channels=(*needed, *further), start_s=start_s, stop_s=stop_s)
    rate_hz = flown.longest.sample_rate_hz
    if rate_hz < LEAST_RATE_HZ:
        raise InsufficientDataError(
            f"Command, rate and set-point of {axis} are logged at {rate_hz:.0f} Hz, below {LEAST_RATE_HZ:.0f} Hz",
            needed=f"{LEAST_RATE_HZ:.0f} Hz",
            remedy=logging_advice(record, rate_hz),
        )
    length = round(_WINDOW_S * rate_hz)
    histories = [history for history in flown.histories if history.values.shape[1] >= length]
    if sum(2 * (history.values.shape[1] // length) - 1 for history in histories) < LEAST_WINDOWS:
        raise InsufficientDataError(
            f"The flight has no {0.5 * (LEAST_WINDOWS + 1) * _WINDOW_S:.0f} s of {axis} command and rate without a gap",
            needed="a longer flight",
            remedy="Fly longer, or log without gaps.",
        )
    delay_s = injection_delay_s(record)
    return _transformed(histories, axis, signals, setpoint, length, delay_s, differences)


def _accompanying(record: FlightRecord, axis: Axis) -> list[str]:
    """Excitation, and the stick where the controller moves with it: elsewhere a slow one would thin all others out."""
    moved = ["thrust_stick"] if autopilot_of(record).gains_by_throttle else []
    return [*moved, f"{axis}_excitation"]


def _flight(record: FlightRecord) -> tuple[float, float]:
    """The middle of the longest flight; the whole log where nothing shows when it flew."""
    try:
        start_s, stop_s = airborne(record).longest
    except InsufficientDataError:
        if record.status.in_air is not None or record.status.armed is not None:
            raise
        start_s = min(float(topic.time_s[0]) for topic in record.topics if topic.time_s.size)
        stop_s = max(float(topic.time_s[-1]) for topic in record.topics if topic.time_s.size)
    spare_s = max(stop_s - start_s - _LONGEST_S, 0.0)
    return start_s + 0.5 * spare_s, stop_s - 0.5 * spare_s


def injection_delay_s(record: FlightRecord) -> float:
    """How much later than its stamp an excitation enters the command: one loop in ArduPilot's system identification."""
    rate_hz = record.parameters.get("SCHED_LOOP_RATE", 0.0) if "SID_AXIS" in record.parameters else 0.0
    return 1.0 / rate_hz if rate_hz > 0.0 else 0.0


def _transformed(
    histories: Sequence[TimeHistory],
    axis: Axis,
    signals: Sequence[str],
    setpoint: str | None,
    length: int,
    delay_s: float,
    differences: int,
) -> CommandRelation:
    first = histories[0]
    omega = np.asarray(2.0 * np.pi * np.fft.rfftfreq(length, 1.0 / first.sample_rate_hz), dtype=np.float64)
    inside = (omega > _LOWEST_RAD_S) & (omega < _NYQUIST_SHARE * np.pi * first.sample_rate_hz)
    omega = omega[inside]

    def spectra(name: str) -> ComplexArray:
        return np.concatenate(
            [windowed(np.nan_to_num(history[name]), length, differences)[:, inside] for history in histories]
        )

    found = {name: spectra(name) for name in signals}
    command, excitation = f"{axis}_command", f"{axis}_excitation"
    if command in found and excitation in first.names:
        channel = first.channels[first.names.index(excitation)]
        # In another unit it enters in front of the controller, and the set-point holds it.
        if channel.unit == STANDARD_UNITS[command]:
            found[command] = found[command] - spectra(excitation) * np.exp(-1j * omega * delay_s)
    sticks = [_cut(h["thrust_stick"], length).mean(axis=1) for h in histories if "thrust_stick" in h.names]
    rate = spectra(RATE_OF[axis])
    return CommandRelation(
        omega_rad_s=omega,
        signals=found,
        rate=rate,
        setpoint=spectra(setpoint) if setpoint else None,
        throttle=np.concatenate(sticks) if sticks else np.zeros(len(rate)),
        source=first.channels[first.names.index(RATE_OF[axis])].source,
        sample_rate_hz=first.sample_rate_hz,
    )


def _cut(values: FloatArray, length: int) -> FloatArray:
    """Windows that overlap by half, shape ``(windows, length)``."""
    return np.asarray(np.lib.stride_tricks.sliding_window_view(values, length)[:: length // 2])


def windowed(values: FloatArray, length: int, differences: int) -> ComplexArray:
    """Spectra of windows, of the differences from sample to sample: what drifts leaks into no other frequency."""
    for _ in range(differences):
        values = np.diff(values, prepend=values[:1])
    windows = _cut(values, length)
    windows = windows - windows.mean(axis=1, keepdims=True)
    spectra = np.fft.rfft(windows * np.hanning(length + 2)[1:-1], axis=1)
    difference = 1.0 - np.exp(-2j * np.pi * np.arange(spectra.shape[1]) / length)
    difference[0] = 1.0
    return np.asarray(spectra / difference**differences)
