"""Filters of a loop: phase lag and noise of each, and a log with other filters.

The next flight may use another filter in front of the controller or inside it; the plant does not change. So the
parameters of the log are changed, and the controller is read from them again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rotorid.autopilots.firmware import Version, version_of
from rotorid.autopilots.registry import autopilot_of
from rotorid.data.base import Immutable
from rotorid.data.record import FlightRecord
from rotorid.errors import UsageError, nearest_name
from rotorid.models.autopilots.betaflight_settings import (
    LOW_PASSES,
    MOVING_GYRO,
    NAMED_BY_NUMBER,
    command_line_name,
    header_name,
    is_type,
    types_of,
)
from rotorid.models.autopilots.settings import AxisController
from rotorid.models.controller import FILTERS, RateController
from rotorid.signal.autopilot_filters import controller_filters
from rotorid.tuning.loops import ControllerParts, Gains
from rotorid.typing import ComplexArray

_OF_GYRO = ("IMU_GYRO_", "INS_GYRO_FILTER", "INS_HNTCH_", "INS_HNTC2_", "INS_NOTCH_", "gyro_", "rpm_filter_")
_OF_LOOP = ("IMU_DGYRO_CUTOFF", "MC_DTERM_CUTOFF", "MC_YAW_TQ_CUTOFF", "ATC_RAT_", "dterm_", "yaw_lowpass_hz")
_ARDUPILOT_FILTERS = ("_FLTT", "_FLTE", "_FLTD", "_NTF", "_NEF")

_CUTOFFS: Mapping[str, str] = {
    "derivative_cutoff_hz": "D low-pass",
    "error_cutoff_hz": "error low-pass",
    "target_cutoff_hz": "set-point low-pass",
    "command_cutoff_hz": "command low-pass",
    "proportional_cutoff_hz": "P low-pass",
}
_ROWS: Mapping[str, str] = {
    "derivative_filters": "of D",
    "error_filters": "of the error",
    "target_filters": "of the set-point",
    "angle_filters": "of the angle",
}


@dataclass(frozen=True, kw_only=True)
class FilterPrice(Immutable):
    """The effect of one filter on a loop.

    Parameters
    ----------
    name
        Its kind and place.
    phase_deg
        Phase that the whole loop gains at its crossover without it, in degrees.
    noise_ratio
        Noise of the command without it, relative to with it.
    """

    name: str
    phase_deg: float
    noise_ratio: float


def with_filters(record: FlightRecord, values: Mapping[str, float]) -> FlightRecord:
    """A log with other filters among its parameters.

    Parameters
    ----------
    values
        Parameters of the firmware, with their new values; those of Betaflight by the names of its command line or of
        its header.

    Raises
    ------
    UsageError
        The log has no such parameter, it is not a filter's, or its effect is not modeled.
    """
    # Some are in no log while they are off.
    own = {**autopilot_of(record).log.hidden_filters, **record.parameters}
    known = [name for name in own if _is_filter(name)]
    changed: dict[str, float] = {}
    for name, value in values.items():
        place = header_name(name)
        if place not in known:
            near = nearest_name(name, [command_line_name(name) for name in known])
            raise UsageError(
                f"{record.source.name} has no filter parameter {name!r}",
                remedy=f"did you mean {near}?" if near else "--set takes filters; gains are proposed by tune",
            )
        if not (np.isfinite(value) and value >= 0.0):
            raise UsageError(f"--set {name}={value:g} is out of range", needed="a finite number, 0 or more")
        if place in MOVING_GYRO and (value > 0.0 or record.parameters[place] > 0.0):
            raise UsageError(
                f"{name} follows the throttle, which is not modeled",
                needed="a filter with a fixed frequency",
            )
        if is_type(place):
            _require_type(name, value, version_of(record.source.firmware))
        changed[place] = float(value)
    return replace(
        record,
        parameters={**(own if changed.keys() - record.parameters.keys() else {}), **record.parameters, **changed},
    )


def _require_type(name: str, value: float, version: Version | None) -> None:
    words = types_of(version or NAMED_BY_NUMBER)
    if value not in range(len(words)):
        raise UsageError(f"--set {name}={value:g} is not a filter type", needed=f"one of {', '.join(words)}")


def numbered(text: str) -> str:
    """An assignment whose value may be the word of a type of low-pass, with its number.

    Examples
    --------
    >>> numbered("dterm_lpf1_type = PT3"), numbered("IMU_GYRO_CUTOFF=40")
    ('dterm_lpf1_type=3', 'IMU_GYRO_CUTOFF=40')
    """
    name, _, value = (part.strip() for part in text.partition("="))
    if is_type(name) and value.upper() in LOW_PASSES:
        return f"{name}={LOW_PASSES.index(value.upper())}"
    return text


def changed_filters(
    record: FlightRecord, values: Mapping[str, float], *, gyro: bool = False
) -> dict[str, tuple[float, float]]:
    """Filters that change, by the firmware's name: flown and new value.

    Parameters
    ----------
    values
        As for :func:`with_filters`.
    gyro
        Only those of the gyro, which are in the loops of all axes.
    """
    own = {**autopilot_of(record).log.hidden_filters, **record.parameters}
    return {
        command_line_name(place): (float(own[place]), float(value))
        for name, value in values.items()
        if (place := header_name(name)) in own
        and (not gyro or place.startswith(_OF_GYRO))
        and (own[place] != value or place not in record.parameters)
    }


def _is_filter(name: str) -> bool:
    if name.startswith("ATC_RAT_"):
        return name.endswith(_ARDUPILOT_FILTERS)
    return name.startswith((*_OF_GYRO, *_OF_LOOP))


def prices(
    record: FlightRecord | None, controller: AxisController, parts: ControllerParts, plant: ComplexArray, gains: Gains
) -> tuple[FilterPrice, ...]:
    """Phase lag of every filter of a loop at its crossover, the largest first.

    Parameters
    ----------
    record
        The log, for the filters of its gyro.
    plant
        Response of the plant on the frequencies of the parts, shape ``(f,)``.
    gains
        The gains of the loop.
    """
    loop, rate = plant * parts.whole(gains), plant * parts.rate(gains)
    above = np.flatnonzero(np.abs(rate) > 1.0)
    if not above.size:
        return ()
    at, noise = int(above[-1]), parts.noise(gains)
    found = []
    for name, without in _each_left_out(record, controller.controller, parts):
        phase = float(np.degrees(np.angle(plant[at] * without.whole(gains)[at] / loop[at])))
        found.append(FilterPrice(name=name, phase_deg=phase, noise_ratio=without.noise(gains) / noise))
    return tuple(sorted(found, key=lambda price: -price.phase_deg))


def _each_left_out(
    record: FlightRecord | None, controller: RateController, parts: ControllerParts
) -> list[tuple[str, ControllerParts]]:
    found = []
    without: dict[str, Any]
    for known in controller_filters(record) if record is not None else ():
        noise = parts.gyro_noise
        others = replace(
            parts,
            filters=parts.filters / known.response(parts.omega_rad_s),
            gyro_noise=None if noise is None else noise.without(known.response(noise.omega_rad_s)),
        )
        found.append((f"gyro: {known.name}", others))
    for field, words in _CUTOFFS.items():
        if cutoff := getattr(controller, field):
            without = {field: 0.0}
            found.append((f"{words} at {cutoff:g} Hz", replace(parts, controller=replace(controller, **without))))
    for field in FILTERS:
        row = getattr(controller, field)
        for index, value in enumerate(row):
            without = {field: (*row[:index], *row[index + 1 :])}
            name = f"{value.kind} {_ROWS[field]} at {value.frequency_hz:g} Hz"
            found.append((name, replace(parts, controller=replace(controller, **without))))
    return found
