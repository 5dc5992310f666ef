"""What PX4 logs of sensors and motors beside the channels of its table.

Gyro and accelerometer before all filters, counts of clipped samples, current, throttle of hover, speeds of the motors.
The driver hands on the whole FIFO of a sensor at once: one message holds up to 32 samples of each axis, the last of
them taken at the message's stamp.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from rotorid.data.record import Channel, Topic
from rotorid.typing import AnyArray, FloatArray
from rotorid.units import parse_unit

_SAMPLES = 32
_ESCS = 8
_FIFOS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {"sensor_gyro_fifo": ("p_raw q_raw r_raw", "rad/s"), "sensor_accel_fifo": ("ax_raw ay_raw az_raw", "m/s^2")}
)
_FIFO_FIELDS = ("dt", "scale", "samples", *(f"{axis}[{index}]" for axis in "xyz" for index in range(_SAMPLES)))
_CLIPPED = tuple(f"accel_clipping[{index}]" for index in range(3))
_FIRST_MOTOR = 101
"""``actuator_function`` of the first motor; others follow."""

_ESTIMATES: Mapping[str, tuple[str, str, str]] = MappingProxyType(
    {
        "battery_status": ("current_a", "battery_current", "A"),
        "hover_thrust_estimate": ("hover_thrust", "hover_thrust", "1"),
    }
)
"""Topics whose values are negative or no number while there are none."""

SENSOR_FIELDS: Mapping[str, Sequence[str]] = MappingProxyType(
    {
        **dict.fromkeys(_FIFOS, _FIFO_FIELDS),
        **{topic: (field,) for topic, (field, _, _) in _ESTIMATES.items()},
        "vehicle_imu_status": _CLIPPED,
        "esc_status": tuple(
            f"esc[{index}].{field}" for index in range(_ESCS) for field in ("esc_rpm", "actuator_function")
        ),
    }
)
"""Topics and fields to read besides those of the channels' table."""


def sensor_topics(arrays: Mapping[str, AnyArray], parameters: Mapping[str, float]) -> Iterator[Topic]:
    """Topics ``sensor_gyro_fifo`` and ``sensor_accel_fifo``, ``vehicle_imu_status`` and ``esc_status``, where they are.

    Parameters
    ----------
    arrays
        ``topic/field`` to samples as logged.
    parameters
        Of the autopilot; FIFOs of a board that is mounted turned are in its axes, and left out.
    """
    for topic, (names, unit) in _FIFOS.items():
        if parameters.get("SENS_BOARD_ROT", 0.0) == 0.0 and f"{topic}/scale" in arrays:
            found = _fifo(topic, names.split(), unit, arrays)
            if found is not None:
                yield found
    if all(f"vehicle_imu_status/{field}" in arrays for field in _CLIPPED):
        counts = [arrays[f"vehicle_imu_status/{field}"].astype(np.float64) for field in _CLIPPED]
        yield _topic(
            "vehicle_imu_status", _seconds(arrays, "vehicle_imu_status"), {"accel_clips": np.sum(counts, axis=0)}, "1"
        )
    for topic, (field, channel, unit) in _ESTIMATES.items():
        if f"{topic}/{field}" in arrays:
            values = arrays[f"{topic}/{field}"].astype(np.float64)
            kept = values >= 0.0
            if kept.any():
                yield _topic(topic, _seconds(arrays, topic)[kept], {channel: values[kept]}, unit, field)
    if "esc_status/timestamp" in arrays:
        speeds = dict(_speeds(arrays))
        if speeds:
            yield _topic("esc_status", _seconds(arrays, "esc_status"), speeds, "rad/s")


def _fifo(topic: str, names: Sequence[str], unit: str, arrays: Mapping[str, AnyArray]) -> Topic | None:
    needed = [f"{topic}/{field}" for field in (*_FIFO_FIELDS, "timestamp_sample")]
    if not all(field in arrays for field in needed):
        return None
    stamp_s = arrays[f"{topic}/timestamp_sample"].astype(np.float64) * 1e-6
    step_s, scale = (arrays[f"{topic}/{field}"].astype(np.float64) for field in ("dt", "scale"))
    step_s = step_s * 1e-6
    count = np.clip(arrays[f"{topic}/samples"].astype(np.int64), 0, _SAMPLES)
    place = np.arange(_SAMPLES)
    # Shape (messages, 32): the last of a message's samples is the one of its stamp.
    filled = (place < count[:, None]) & np.isfinite(step_s * scale)[:, None]
    time_s = (stamp_s[:, None] - (count[:, None] - 1 - place) * step_s[:, None])[filled]
    values = [
        (np.stack([arrays[f"{topic}/{axis}[{index}]"] for index in range(_SAMPLES)], axis=1) * scale[:, None])[filled]
        for axis in "xyz"
    ]
    if time_s.size < 2:
        return None
    # Messages of one instance come in order; where a stamp jitters by less than a step, their samples interleave.
    order = np.argsort(time_s, kind="stable")
    return _topic(topic, time_s[order], {name: row[order] for name, row in zip(names, values, strict=True)}, unit)


def _speeds(arrays: Mapping[str, AnyArray]) -> Iterator[tuple[str, FloatArray]]:
    for index in range(_ESCS):
        rpm, function = (arrays.get(f"esc_status/esc[{index}].{field}") for field in ("esc_rpm", "actuator_function"))
        if rpm is None or not np.any(rpm):
            continue
        numbers = np.zeros(0) if function is None else function[function >= _FIRST_MOTOR]
        motor = int(np.median(numbers)) - _FIRST_MOTOR + 1 if numbers.size else index + 1
        yield f"motor_speed_{motor}", np.abs(rpm.astype(np.float64)) * parse_unit("rpm").factor


def _seconds(arrays: Mapping[str, AnyArray], topic: str) -> FloatArray:
    return np.asarray(arrays[f"{topic}/timestamp"].astype(np.float64) * 1e-6)


def _topic(name: str, time_s: FloatArray, rows: Mapping[str, AnyArray], unit: str, field: str = "") -> Topic:
    channels = tuple(Channel(name=channel, unit=unit, source=f"{name}.{field or channel}") for channel in rows)
    return Topic(name=name, time_s=time_s, channels=channels, values=np.stack(list(rows.values())))
