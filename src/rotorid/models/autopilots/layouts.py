"""Which rotors a log has, and which mixer: what the parameters of each autopilot say of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from rotorid.autopilots.ardupilot.autopilot import ARDUPILOT
from rotorid.autopilots.betaflight.autopilot import BETAFLIGHT
from rotorid.autopilots.crazyflie import CRAZYFLIE
from rotorid.autopilots.numbers import whole
from rotorid.autopilots.px4.autopilot import PX4
from rotorid.autopilots.registry import autopilot_of, named
from rotorid.data.base import cached_by_value
from rotorid.data.findings import Finding, refusal, remark
from rotorid.data.record import MOTORS, FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.models.rotors import UP, RotorLayout, ardupilot_mixer, library_layout, named_by, px4_mixer
from rotorid.typing import FloatArray

REMEDY = "name a layout of the library with --layout, such as quad.x, or a TOML file of [[rotor]] tables"

_OLD_CLASSES: Mapping[int, int] = MappingProxyType({4: 1, 6: 2})
"""Motors to the class of frame of ArduPilot before 3.5, which the firmware, and no parameter, decided."""

_Y6_CLASS, _Y6_TYPES = 5, (10, 11)
_OLD_Y6 = 10


@cached_by_value
def layout_of(record: FlightRecord) -> RotorLayout:
    """Rotors of the vehicle that flew a log, in the order of its motors.

    PX4 describes each rotor (``CA_ROTORn_PX``, ``PY``, ``PZ``, ``AX``, ``AY``, ``AZ``, ``KM``), or before 1.13 names a
    generic geometry (``SYS_AUTOSTART``); ArduPilot names a frame (``FRAME_CLASS``, ``FRAME_TYPE``, before 3.5
    ``FRAME``); Betaflight and INAV do not log theirs, and four motors are taken for their usual X; Crazyflies are X.
    None of them needs to know the size of the vehicle, and what they say of it is often a placeholder: positions are in
    units of the arm, and :meth:`~rotorid.models.rotors.RotorLayout.scaled` gives them meters.

    Parameters
    ----------
    record
        The log.

    Raises
    ------
    InsufficientDataError
        The log does not show the layout.

    Examples
    --------
    >>> from rotorid.data.record import Source
    >>> source = Source(name="flight.BIN", format="ArduPilot DataFlash", sha256="")
    >>> layout_of(FlightRecord(source=source, topics=(), parameters={"FRAME_CLASS": 2, "FRAME_TYPE": 1})).name
    'hexa.x'
    """
    flown = autopilot_of(record)
    # Telemetry carries the parameters of a frame, whoever sends it.
    reader = _LAYOUTS.get(ARDUPILOT.name if flown.log.telemetry else flown.name)
    if reader is None:
        raise _unknown(record, f"a log of the format {record.source.format} does not describe its rotors")
    return reader(record)


def _unknown(record: FlightRecord, why: str) -> InsufficientDataError:
    message = f"The layout of the rotors of {record.source.name} is not known: {why}."
    finding = refusal("missing_channel", "rotor layout", message)
    return InsufficientDataError(message, needed="positions and spins of the rotors", remedy=REMEDY, findings=[finding])


def _found(record: FlightRecord, name: str, source: str, *remarks: Finding) -> RotorLayout:
    layout = replace(library_layout(name), source=source, findings=remarks)
    motors = _motors(record)
    if motors and motors != layout.rotors:
        raise _unknown(record, f"{source} is {name} with {layout.rotors} rotors, and the log has {motors} motors")
    return layout


def _motors(record: FlightRecord) -> int:
    channels = set(record.channel_names)
    return sum(f"motor_{number}" in channels for number in range(1, MOTORS + 1))


def _remark(where: str, message: str, **numbers: float) -> Finding:
    return remark("rotor_layout", where, message, **numbers)


def _ardupilot(record: FlightRecord) -> RotorLayout:
    parameters = record.parameters
    kind = whole(parameters, "FRAME_TYPE" if "FRAME_TYPE" in parameters else "FRAME", -1)
    frame = whole(parameters, "FRAME_CLASS")
    frame_words = f"FRAME_CLASS = {frame}, FRAME_TYPE = {kind}"
    if frame <= 0:
        frame = _OLD_CLASSES.get(_motors(record), 0)
        frame = _Y6_CLASS if frame == 2 and kind == _OLD_Y6 else frame
        frame_words = f"FRAME = {kind} with {_motors(record)} motors"
    if frame == _Y6_CLASS and kind not in _Y6_TYPES:
        kind = 0
    name = named_by("ardupilot", [frame, kind])
    if name is None:
        raise _unknown(record, f"{frame_words} is no frame of the library")
    message = (
        f"{frame_words}: {name}. ArduPilot normalizes roll and pitch each for itself, so that a frame that is longer "
        "than wide logs the same; describe the rotors where that matters."
    )
    return _found(record, name, frame_words, _remark("FRAME_TYPE", message))


def _px4(record: FlightRecord) -> RotorLayout:
    count = whole(record.parameters, "CA_ROTOR_COUNT")
    if 0 < count <= MOTORS:
        return _px4_rotors(record, count)
    start = whole(record.parameters, "SYS_AUTOSTART")
    name = named_by("px4", start // 1000) if start < 13000 else None
    if name is None:
        raise _unknown(
            record, f"it has no CA_ROTOR_COUNT of up to {MOTORS}, and SYS_AUTOSTART = {start} is no generic geometry"
        )
    message = f"SYS_AUTOSTART = {start} is taken for {name}; a frame of that group may be longer than wide."
    return _found(record, name, f"SYS_AUTOSTART = {start}", _remark("SYS_AUTOSTART", message))


def _px4_rotors(record: FlightRecord, count: int) -> RotorLayout:
    positions = _px4_column(record, count, "P", (0.0, 0.0, 0.0))
    ratios = np.array([record.parameters.get(f"CA_ROTOR{index}_KM", 0.05) for index in range(count)])
    arm = float(np.hypot(positions[:, 0], positions[:, 1]).max())
    if not (0.0 < arm < np.inf and np.all(np.abs(ratios) > 0.0)):
        raise _unknown(record, "its CA_ROTOR parameters put every rotor in the center, or give one no torque")
    message = (
        f"CA_ROTOR parameters describe {count} rotors with an arm of {arm:.4g} m; PX4 uses only their ratios: "
        "it may be a placeholder and is not used as a length."
    )
    return RotorLayout(
        name=f"{count} rotors of CA_ROTOR parameters",
        positions=positions / arm,
        spins=np.sign(ratios),
        axes=_px4_column(record, count, "A", UP),
        source="CA_ROTOR parameters",
        findings=(_remark("CA_ROTOR0_PX", message, stated_arm_m=arm),),
    )


def _px4_column(record: FlightRecord, count: int, letter: str, usual: tuple[float, float, float]) -> FloatArray:
    names = [[f"CA_ROTOR{index}_{letter}{axis}" for axis in "XYZ"] for index in range(count)]
    return np.array(
        [[record.parameters.get(name, value) for name, value in zip(row, usual, strict=True)] for row in names]
    )


def _betaflight(record: FlightRecord) -> RotorLayout:
    parameters = record.parameters
    if _motors(record) != 4:
        raise _unknown(record, f"the header does not describe the mixer of {_motors(record)} motors")
    turned = parameters.get("yaw_motors_reversed", 0.0) == 1.0 or parameters.get("yaw_motor_direction", 1.0) == -1.0
    name = "quad.x.betaflight.reversed" if turned else "quad.x.betaflight"
    message = f"The header does not describe the mixer; four motors are taken for {name}, the default."
    return _found(record, name, "four motors", _remark("motor_1", message))


def _crazyflie(record: FlightRecord) -> RotorLayout:
    return _found(record, "quad.x.crazyflie", "Crazyflie")


_LAYOUTS: Mapping[str, Callable[[FlightRecord], RotorLayout]] = MappingProxyType(
    {ARDUPILOT.name: _ardupilot, PX4.name: _px4, BETAFLIGHT.name: _betaflight, CRAZYFLIE.name: _crazyflie}
)
_MIXERS: Mapping[str, Callable[[RotorLayout], FloatArray]] = MappingProxyType(
    {ARDUPILOT.name: ardupilot_mixer, PX4.name: px4_mixer}
)


def mixer_of(layout: RotorLayout, source_format: str) -> FloatArray | None:
    """The mixer of the autopilot that wrote a log, shape ``(rotors, 4)``; ``None`` where its rule is not known.

    Parameters
    ----------
    layout
        The rotors.
    source_format
        ``record.source.format``, such as ``ArduPilot DataFlash``.
    """
    mixer = _MIXERS.get(named(source_format).name)
    return None if mixer is None else mixer(layout)


def mixer_like(layout: RotorLayout, autopilot: str) -> FloatArray:
    """The mixer of a simulated autopilot: its own where its rule is known, and one that normalizes all axes alike."""
    return _MIXERS.get(named(autopilot).name, px4_mixer)(layout)
