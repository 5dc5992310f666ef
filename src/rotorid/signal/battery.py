r"""How the voltage of the battery changes what an output does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.typing import FloatArray

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
    >>> from rotorid.data.channel import Channel
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
        f"{record.source.name} holds no battery_voltage",
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
