"""Range of the data: speed, angle, rate, command, throttle, battery voltage and trim."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotorid.autopilots.registry import autopilot_of
from rotorid.data.record import AXES, TimeHistory
from rotorid.errors import InsufficientDataError
from rotorid.flights.flights import Flight
from rotorid.results.summary import Range, Trim
from rotorid.typing import FloatArray

HOVER_M_S = 0.5
"""Below this speed a trim is a hover, and the speed is zero: gusts and the estimator alone make as much."""

_LEAST_SAMPLES = 10
_QUIET_S = 3.0
_LEAST_QUIET = 5

COVERED = (
    *("u", "v", "w"),
    *("phi", "theta"),
    *("p", "q", "r"),
    *(f"{axis}_command" for axis in AXES),
    "battery_voltage",
)
"""Channels whose ranges describe where a model was identified; the thrust command is the throttle."""


def covered_by(flights: Sequence[Flight]) -> dict[str, Range]:
    """Ranges of what describes a flight condition, over all maneuvers together.

    They are read straight from the logs, so that channels count that no model uses, such as the battery.

    Parameters
    ----------
    flights
        Records and maneuvers; channels that none of the records holds are left out.

    Examples
    --------
    >>> from rotorid.data.record import Channel, FlightRecord, Maneuver, Source, Topic
    >>> u = (Channel(name="u", unit="m/s"),)
    >>> topic = Topic(name="speed", time_s=np.arange(3.0), channels=u, values=np.array([[-1.0, 2.0, 2.0]]))
    >>> record = FlightRecord(source=Source(name="a.csv", format="CSV", sha256=""), topics=(topic,))
    >>> covered_by([Flight(record, Maneuver(axis="roll", kind="other", start_s=0.0, stop_s=2.0))])["u"]
    Range(unit='m/s', lowest=-1.0, highest=2.0, rms=1.7320508075688772, mean=1.0)
    """
    samples = []
    for flight in flights:
        for name in _in(flight.record.channel_names):
            for found in flight.samples(name):
                if found.values.size:
                    samples.append((found.values, found.unit, name))
                    break
    return _ranges(samples)


def thrust_spread(flights: Sequence[Flight], lag_s: float) -> float:
    """Standard deviation of the thrust command in maneuvers of thrust, behind the lag of the motors.

    Zero where nothing of thrust was flown, and where the autopilot asks for thrust instead of outputs, so that thrust
    goes in proportion to the command.

    Parameters
    ----------
    flights
        Records and maneuvers.
    lag_s
        Time constant of the motors.
    """
    from scipy.signal import lfilter

    power, count = 0.0, 0
    for flight in flights:
        if flight.axis != "thrust" or autopilot_of(flight.record).log.straightened:
            continue
        samples = next(flight.samples("thrust_command"), None)
        if samples is None or samples.values.size < _LEAST_SAMPLES:
            continue
        share = 1.0 / (1.0 + lag_s / float(np.mean(np.diff(samples.time_s))))
        moved = lfilter([share], [1.0, share - 1.0], samples.values - samples.values.mean())
        power += float(np.sum(np.square(moved)))
        count += moved.size
    return float(np.sqrt(power / count)) if count else 0.0


def _in(names: Sequence[str]) -> list[str]:
    return [name for name in COVERED if name in names]


def _ranges(samples: Sequence[tuple[FloatArray, str, str]]) -> dict[str, Range]:
    ranges = {}
    for name in COVERED:
        parts = [values for values, _, of in samples if of == name]
        if parts:
            values = np.concatenate(parts)
            unit = next(unit for _, unit, of in samples if of == name)
            size = float(np.sqrt(np.mean(values**2)))
            ranges[name] = Range(
                unit=unit,
                lowest=float(values.min()),
                highest=float(values.max()),
                rms=size,
                mean=float(values.mean()),
            )
    return ranges


def trim_of(history: TimeHistory, *, until_s: float | None = None) -> Trim:
    """Trim of a record: the mean over its quiet start.

    Parameters
    ----------
    history
        A maneuver with quiet time before it.
    until_s
        End of the quiet time on the log's own clock; by default 3 s after the first sample. A gust or a drift in that
        time is taken for trim.

    Raises
    ------
    InsufficientDataError
        Fewer than five samples lie in the quiet time.
    """
    quiet = history.time_s <= (history.start_s + _QUIET_S if until_s is None else until_s)
    if np.count_nonzero(quiet) < _LEAST_QUIET:
        raise InsufficientDataError(
            f"there are only {np.count_nonzero(quiet)} samples of quiet flight",
            needed=f"at least {_LEAST_QUIET}",
            remedy="fly quietly for longer before the maneuver",
        )
    means = {
        name: float(history[name][quiet].mean()) for name in ("u", "v", "w", "theta", "phi") if name in history.names
    }
    speeds = {name: value for name, value in means.items() if name in ("u", "v", "w")}
    hover = all(abs(value) < HOVER_M_S for value in speeds.values())
    return Trim(values={name: 0.0 if hover and name in speeds else value for name, value in means.items()}, hover=hover)
