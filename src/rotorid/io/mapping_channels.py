"""Tables of a mapping that name channels: one by one, or as the vectors that they are parts of."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, cast, get_args

from rotorid.data.channel import STANDARD_UNITS
from rotorid.errors import UsageError
from rotorid.frames import BodyFrame, SignedAngles, WorldFrame, signed_angles, signed_axes
from rotorid.io.mapping_keys import choice, file_below, index, names, nearest, number, only_keys, table, text, unit
from rotorid.io.mapping_values import MappedAttitude, MappedChannel, Series
from rotorid.units import parse_unit

SERIES_KEYS = ("source", "unit", "scale", "offset", "row", "column")
FRAME_KEYS = ("frame", "world")
_PLACE_KEYS = ("time", "time_unit", "file", *FRAME_KEYS)
_CHANNEL_KEYS = (*SERIES_KEYS, *_PLACE_KEYS)
_VECTOR_KEYS = ("sources", "source", "by", "unit", "scale", *_PLACE_KEYS)

BODY_VECTORS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "rates": ("p", "q", "r"),
        "body_velocity": ("u", "v", "w"),
        "specific_force": ("ax", "ay", "az"),
        "angular_acceleration": ("p_dot", "q_dot", "r_dot"),
        "body_acceleration": ("u_dot", "v_dot", "w_dot"),
        "rates_setpoint": ("p_setpoint", "q_setpoint", "r_setpoint"),
        "body_velocity_setpoint": ("u_setpoint", "v_setpoint", "w_setpoint"),
    }
)
EARTH_VECTORS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "position": ("north", "east", "down"),
        "velocity": ("velocity_north", "velocity_east", "velocity_down"),
        "position_setpoint": ("north_setpoint", "east_setpoint", "down_setpoint"),
        "velocity_setpoint": ("velocity_north_setpoint", "velocity_east_setpoint", "velocity_down_setpoint"),
    }
)
ANGLES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"attitude": ("phi", "theta", "psi"), "attitude_setpoint": ("phi_setpoint", "theta_setpoint", "psi_setpoint")}
)
QUATERNION = "quaternion"

_OWN_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")
_TOO_LIKE = 0.9
"""A name of the user's own that is more like one of the vocabulary is taken for a misspelling of it."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Frames:
    """Axes that a table of a mapping is written in, and what the messages call it."""

    frame: BodyFrame
    world: WorldFrame
    where: str

    def angles(self) -> SignedAngles:
        """Sign and offset of the attitude angles."""
        try:
            return signed_angles(self.frame, self.world)
        except UsageError as error:
            raise UsageError(
                f"{self.where}: {error.came}", needed=error.needed, remedy='write frame = "..." and world = "..."'
            ) from error

    def turned(self, name: str, series: Series) -> Series:
        """A channel that is named after its component here, out of the same component there, with its sign.

        North out of ENU is north, whichever place it has in a vector.
        """
        for vectors, frame in ((BODY_VECTORS, self.frame), (EARTH_VECTORS, self.world)):
            for channels in vectors.values():
                if name in channels:
                    sign = _own_signs(frame)[channels.index(name)]
                    return replace(series, scale=sign * series.scale)
        for channels in ANGLES.values():
            if name in channels:
                sign, offset_rad = self.angles()[channels.index(name)]
                # sign * value + offset, written as (number + offset) * scale in the unit of the file.
                factor = series.scale * parse_unit(series.unit or "rad").factor
                moved = sign * offset_rad / factor if offset_rad else 0.0
                return replace(series, scale=sign * series.scale, offset=series.offset + moved)
        return series


def read_frames(values: Mapping[str, Any], where: str, outer: Frames | None = None) -> Frames:
    """The keys ``frame`` and ``world``; what is missing is as around the table, and FRD and NED at the top."""
    frame = choice(values, "frame", get_args(BodyFrame), outer.frame if outer else "FRD", where)
    world = choice(values, "world", get_args(WorldFrame), outer.world if outer else "NED", where)
    return Frames(frame=cast("BodyFrame", frame), world=cast("WorldFrame", world), where=where)


def read_channel(name: str, value: object, frames: Frames, where: str) -> MappedChannel:
    """A table ``[channels.NAME]``."""
    values = table(value, where)
    only_keys(values, _CHANNEL_KEYS, where)
    if name not in STANDARD_UNITS:
        _check_own_name(name, values, where)
    series = replace(read_series(values, where, si=STANDARD_UNITS.get(name, "")), file=file_below(values, where))
    if name in STANDARD_UNITS:
        series = read_frames(values, where, frames).turned(name, series)
    return MappedChannel(name=name, samples=series, time=_own_time(values, where))


def read_vector(
    name: str, value: object, frames: Frames, where: str
) -> tuple[tuple[MappedChannel, ...], MappedAttitude | None]:
    """A table ``[vectors.NAME]``: the channels that it spells out, or the quaternion."""
    values = table(value, where)
    only_keys(values, _VECTOR_KEYS, where)
    known = {**BODY_VECTORS, **EARTH_VECTORS, **ANGLES}
    if name not in known and name != QUATERNION:
        close = nearest(name, (*known, QUATERNION))
        raise UsageError(
            f"{where} is no vector of the vocabulary",
            needed=f"one of {', '.join((*known, QUATERNION))}",
            remedy=f"did you mean {close}?" if close else "name its parts as channels",
        )
    own = read_frames(values, where, frames)
    si = "1" if name == QUATERNION else STANDARD_UNITS[known[name][0]]
    parts = _parts(values, 4 if name == QUATERNION else 3, si, where)
    time = _own_time(values, where)
    if name == QUATERNION:
        w, x, y, z = parts
        return (), MappedAttitude(parts=(w, x, y, z), angles=own.angles(), time=time)
    if name in ANGLES:
        turned = [own.turned(channel, part) for channel, part in zip(known[name], parts, strict=True)]
    else:
        axes = signed_axes(own.frame if name in BODY_VECTORS else own.world)
        turned = [replace(parts[place], scale=sign * parts[place].scale) for place, sign in axes]
    channels = zip(known[name], turned, strict=True)
    return tuple(MappedChannel(name=channel, samples=part, time=time) for channel, part in channels), None


def read_series(values: Mapping[str, Any], where: str, *, si: str) -> Series:
    """The keys ``source``, ``unit``, ``scale``, ``offset`` and ``row`` or ``column``."""
    row, column = index(values, "row", where), index(values, "column", where)
    if row is not None and column is not None:
        raise UsageError(f"{where} has `row` and `column`", needed="one of them", remedy="remove the other")
    measured = unit(values, "unit", si, where)
    scale = _scale(values, where)
    return Series(
        source=text(values, "source", where),
        unit=measured,
        scale=scale,
        offset=number(values, "offset", where) or 0.0,
        row=row,
        column=column,
    )


def _own_signs(frame: str) -> tuple[float, float, float]:
    """Signs of forward, right, down or north, east, down against the same line in another frame."""
    return (1.0, 1.0, -1.0) if frame == "ENU" else ((1.0, -1.0, -1.0) if frame in ("FLU", "NWU") else (1.0, 1.0, 1.0))


def _scale(values: Mapping[str, Any], where: str) -> float:
    scale = number(values, "scale", where)
    if scale == 0.0:
        raise UsageError(f"{where} has `scale` = 0", needed="a sign and factor", remedy="correct it or remove it")
    return 1.0 if scale is None else scale


def _parts(values: Mapping[str, Any], count: int, si: str, where: str) -> tuple[Series, ...]:
    """The components in the order of the file: variables of their own, or rows or columns of a matrix."""
    common = Series(
        source="", unit=unit(values, "unit", si, where), scale=_scale(values, where), file=file_below(values, where)
    )
    if ("sources" in values) == ("source" in values):
        raise UsageError(
            f"{where} has {'both' if 'source' in values else 'neither'} of `sources` and `source`",
            needed="one of them",
            remedy=f"give {count} names as `sources`, or a matrix as `source`",
        )
    if "sources" in values:
        if "by" in values:
            raise UsageError(f"{where} has `by` beside `sources`", needed="`by` for a matrix", remedy="remove it")
        return tuple(replace(common, source=source) for source in names(values, "sources", count, where))
    source = text(values, "source", where)
    by_row = choice(values, "by", ("row", "column"), "row", where) == "row"
    return tuple(
        replace(common, source=source, row=place if by_row else None, column=None if by_row else place)
        for place in range(count)
    )


def _own_time(values: Mapping[str, Any], where: str) -> Series | None:
    if "time" not in values:
        if "time_unit" in values:
            raise UsageError(
                f"{where} has `time_unit` and no `time`", needed="both", remedy="give the unit in [clock] instead"
            )
        return None
    return Series(
        source=text(values, "time", where),
        unit=unit(values, "time_unit", "s", where),
        file=file_below(values, where),
    )


def _check_own_name(name: str, values: Mapping[str, Any], where: str) -> None:
    """A name outside the vocabulary needs a unit, and must not look like a misspelling."""
    close = nearest(name, STANDARD_UNITS, likeness=_TOO_LIKE)
    if close or not _OWN_NAME.fullmatch(name):
        raise UsageError(
            f"{where} is no channel of the vocabulary",
            needed="a name such as roll_command, p, phi, ax, or one of your own in letters, digits and underscores",
            remedy=f"did you mean {close}? A name of your own must differ more" if close else "choose another name",
        )
    if "unit" not in values:
        suggested = nearest(name, STANDARD_UNITS)
        raise UsageError(
            f"{where} is no channel of the vocabulary and has no `unit`",
            needed='a unit for a name of your own, such as unit = "1"',
            remedy=f"add it, or did you mean {suggested}?" if suggested else "add it",
        )
