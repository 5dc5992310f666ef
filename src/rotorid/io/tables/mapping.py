"""Mapping files: the user's own names for the channels of a foreign file, in TOML.

A mapping says where each channel of the vocabulary stands in the file, one by one or as part of a vector, in which unit
and frame, and on which clock. Every mistake names the table, the key and what to write. The language has a page of its
own in the documentation, ``docs/mapping.md``.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath, PureWindowsPath
from types import MappingProxyType
from typing import Any, cast, get_args

from rotorid.data.record import AXES, STANDARD_UNITS, Kind, units_of
from rotorid.data.sensor_filters import SensorFilter, parse_filters
from rotorid.errors import UsageError
from rotorid.frames import BodyFrame, SignedAngles, WorldFrame, signed_angles, signed_axes
from rotorid.io.documents import DocumentError, parse_toml, read_text
from rotorid.typing import Axis
from rotorid.units import parse_unit

PLACEHOLDER = "{experiment}"
"""Stands in a source for the name of each experiment."""

ONLY_VARIABLE = "*"
"""Source that is the only variable of its file, whatever its name."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Series:
    """One row of numbers in a foreign file: ``(number + offset) * scale``, then the unit is converted.

    Parameters
    ----------
    source
        Variable, struct field by dots, or column name.
    unit
        Unit of the numbers once offset and scale are applied; empty means SI.
    scale
        Sign and factor.
    offset
        Added first, in the numbers of the file: ``-1000.0`` for pulses that rest at 1000 µs.
    row, column
        Which one of a matrix, counted from zero; at most one of them.
    file
        Path of the file below the folder of the log; empty for the log itself.
    derivative
        Whether the channel is the derivative of these numbers; their unit is then that of the derivative.
    low_pass_hz
        Cutoff of a zero-phase low-pass that the channel passes; ``None`` for none.
    logged_range
        Whether the channel goes from 0 at the smallest of these numbers to 1 at their largest.
    parts
        Variables and factors of a weighted sum, such as an axis command of motor commands; `source` then spells it out.
    """

    source: str
    unit: str = ""
    scale: float = 1.0
    offset: float = 0.0
    row: int | None = None
    column: int | None = None
    file: str = ""
    derivative: bool = False
    low_pass_hz: float | None = None
    logged_range: bool = False
    parts: tuple[tuple[str, float], ...] = ()

    @property
    def terms(self) -> tuple[tuple[str, float], ...]:
        """Variables of the file and their factors: those of a sum, or the source alone."""
        return self.parts or ((self.source, 1.0),)

    def of_experiment(self, name: str) -> Series:
        """The same row in one of several experiments."""
        return replace(
            self,
            source=self.source.replace(PLACEHOLDER, name),
            parts=tuple((part.replace(PLACEHOLDER, name), factor) for part, factor in self.parts),
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class Clock:
    """Stamps for the channels that have none of their own: exactly one of the three.

    Parameters
    ----------
    time
        The stamps themselves.
    steps
        Differences of the stamps: from each sample to the next. The first stamp is zero.
    sample_rate_hz
        A uniform clock that starts at zero.
    """

    time: Series | None = None
    steps: Series | None = None
    sample_rate_hz: float | None = None

    def of_experiment(self, name: str) -> Clock:
        """The same clock in one of several experiments."""
        return replace(
            self,
            time=self.time and self.time.of_experiment(name),
            steps=self.steps and self.steps.of_experiment(name),
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class MappedChannel:
    """A channel, where its samples stand, its own stamps if it has some, and the table that says so.

    ``along_world`` marks a component of a body vector that the file has along north, east or down: all three are turned
    into the body by the quaternion. ``filters`` are those that the samples have passed.
    """

    name: str
    samples: Series
    time: Series | None = None
    where: str = field(default="", compare=False)
    along_world: bool = False
    filters: tuple[SensorFilter, ...] = ()

    @property
    def si(self) -> str:
        """Unit in the record: that of the vocabulary or, where it has a choice or none, that of what was written."""
        return measured_unit(self.name, self.samples.unit) or parse_unit(self.samples.unit).si

    def of_experiment(self, name: str) -> MappedChannel:
        """The same channel in one of several experiments."""
        return replace(self, samples=self.samples.of_experiment(name), time=self.time and self.time.of_experiment(name))


@dataclass(frozen=True, kw_only=True, slots=True)
class MappedAttitude:
    """A quaternion that becomes ``phi``, ``theta`` and ``psi``.

    Parameters
    ----------
    parts
        Its w, x, y and z, from the body to the earth.
    angles
        Sign and offset that bring each angle from the frames of the file to FRD and NED.
    time
        Its own stamps, if it has some.
    """

    parts: tuple[Series, Series, Series, Series]
    angles: SignedAngles
    time: Series | None = None

    def of_experiment(self, name: str) -> MappedAttitude:
        """The same quaternion in one of several experiments."""
        w, x, y, z = (part.of_experiment(name) for part in self.parts)
        return replace(self, parts=(w, x, y, z), time=self.time and self.time.of_experiment(name))


@dataclass(frozen=True, kw_only=True, slots=True)
class Segment:
    """A part of the record to use, by time on the log's own clock or by sample of the first channel.

    With neither it is the whole record, or the whole of each experiment. ``signal`` is the channel in which the
    excitation shows and ``band_rad_s`` its lowest and highest frequency, where they are known.
    """

    axis: Axis
    kind: Kind = "other"
    start_s: float | None = None
    stop_s: float | None = None
    start_sample: int | None = None
    stop_sample: int | None = None
    signal: str = ""
    band_rad_s: tuple[float, float] | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class Experiments:
    """Several experiments in one file, which follow each other on one clock.

    Parameters
    ----------
    names
        What stands for ``{experiment}`` in the sources, in the order of time.
    spacing_s
        From the zero of one experiment's stamps to that of the next, s; zero where the stamps go on by themselves.
    """

    names: tuple[str, ...]
    spacing_s: float = 0.0


@dataclass(frozen=True, kw_only=True, slots=True)
class ChannelMapping:
    """What a mapping file says.

    Parameters
    ----------
    channels
        At least one, unless there is an attitude.
    clock
        Clock of the channels without their own.
    segments
        Parts of the record that were excited.
    attitude
        Quaternion behind the attitude angles.
    experiments
        Several experiments in one file.
    """

    channels: tuple[MappedChannel, ...]
    clock: Clock | None = None
    segments: tuple[Segment, ...] = ()
    attitude: MappedAttitude | None = None
    experiments: Experiments | None = None

    @property
    def filters(self) -> dict[str, tuple[SensorFilter, ...]]:
        """Channel to the filters that it has passed, where the file says some."""
        return {channel.name: channel.filters for channel in self.channels if channel.filters}

    @property
    def files(self) -> tuple[str, ...]:
        """The files that hold the channels, each once; the log itself is the empty name."""
        owners = [channel.samples.file for channel in self.channels]
        owners += [self.attitude.parts[0].file] if self.attitude else []
        return tuple(dict.fromkeys(owners))

    def part(self, file: str) -> ChannelMapping:
        """What stands in one of the files, as the mapping of that file alone."""
        channels = (
            replace(
                channel, samples=replace(channel.samples, file=""), time=channel.time and replace(channel.time, file="")
            )
            for channel in self.channels
            if channel.samples.file == file
        )
        attitude = self.attitude
        if attitude is not None:
            w, x, y, z = (replace(series, file="") for series in attitude.parts)
            own = replace(attitude, parts=(w, x, y, z), time=attitude.time and replace(attitude.time, file=""))
            attitude = own if self.attitude and self.attitude.parts[0].file == file else None
        kept = tuple(channels)
        # A file whose channels all have their own stamps need not contain those of the common clock.
        timed = all(channel.time for channel in kept) and (attitude is None or attitude.time is not None)
        return replace(
            self,
            channels=kept,
            attitude=attitude,
            clock=None if timed else self.clock,
            segments=() if file else self.segments,
        )

    def each_experiment(self) -> Iterator[ChannelMapping]:
        """One mapping for each experiment; itself where there is but one."""
        if self.experiments is None:
            yield self
            return
        for name in self.experiments.names:
            yield replace(
                self,
                channels=tuple(channel.of_experiment(name) for channel in self.channels),
                clock=self.clock and self.clock.of_experiment(name),
                attitude=self.attitude and self.attitude.of_experiment(name),
                experiments=None,
            )


def measured_unit(name: str, written: str) -> str:
    """Unit in which a record holds a channel that a file has in a unit; empty where it measures something else.

    Examples
    --------
    >>> measured_unit("motor_1", "ms"), measured_unit("motor_1", ""), measured_unit("phi", "deg")
    ('us', '1', 'rad')
    >>> measured_unit("phi", "V")
    ''
    """
    known = units_of(name)
    si = parse_unit(written).si if written else ""
    return known[0] if known and not si else next((unit for unit in known if parse_unit(unit).si == si), "")


_SERIES_KEYS = ("source", "unit", "scale", "offset", "range", "row", "column")
FRAME_KEYS = ("frame", "world")
_PLACE_KEYS = ("time", "time_unit", "file", *FRAME_KEYS)
_STEPS = ("derivative", "low_pass_hz")
_CHANNEL_KEYS = (*_SERIES_KEYS, "sum", *_STEPS, "filter", *_PLACE_KEYS)
_VECTOR_KEYS = ("sources", "source", "by", "columns", "along", "unit", "scale", "filter", *_PLACE_KEYS)

_LARGEST_BYTES = 20_000

_SHARE = (
    "a share of the full travel has no unit: write `scale` in its place, such as scale = 0.05 for 20 deg, or "
    "offset = -1500 and scale = 0.002 for 1000 to 2000 us"
)

_KEYS = ("channels", "vectors", "clock", "experiments", "segments", *FRAME_KEYS)
_CLOCK_KEYS = ("time", "steps", "sample_rate_hz")
_CLOCK_SERIES_KEYS = ("source", "unit", "row", "column")
_SEGMENT_KEYS = ("start_s", "stop_s", "start_sample", "stop_sample", "axis", "kind", "signal", "band_rad_s")


def read_mapping(path: Path) -> ChannelMapping:
    """Read a mapping file.

    Parameters
    ----------
    path
        The TOML file.

    Raises
    ------
    UsageError
        The file is missing, is not valid TOML, or says something impossible; the message names the key.
    """
    wanted = "a TOML file with a table [channels.NAME] for each channel"
    try:
        document = parse_toml(read_text(path, needed=wanted, most_bytes=_LARGEST_BYTES))
    except UsageError as error:
        remedy = "give the mapping to --map, and the log before it"
        raise UsageError(
            f"the mapping {error.came.replace('cannot be read', 'cannot be opened')}",
            needed=error.needed,
            remedy=remedy,
        ) from error
    except DocumentError as error:
        raise UsageError(
            f"the mapping {path.name} is not valid TOML: {error}",
            needed='text such as `[channels.q]` followed by `source = "gyro_y"`',
            remedy="correct the line",
        ) from error
    return parse_mapping(document, path.name)


def parse_mapping(document: Mapping[str, Any], where: str = "mapping") -> ChannelMapping:
    """Check a mapping that was read from TOML, and give it types.

    Parameters
    ----------
    document
        Tables ``channels`` and ``vectors``, of which one may be missing; optionally ``clock``, ``experiments`` and
        ``segments``, and the axes ``frame`` (FRD or FLU) and ``world`` (NED, ENU or NWU) that the file is written in.
    where
        What the messages call it.

    Raises
    ------
    UsageError
        A key is unknown or missing, a value has the wrong type, a name looks like a misspelling of one of the
        vocabulary, or a unit does not measure what the channel holds.

    Examples
    --------
    >>> document = {"clock": {"sample_rate_hz": 250.0}, "channels": {"q": {"source": "gyro", "unit": "deg/s"}}}
    >>> mapping = parse_mapping(document)
    >>> mapping.channels[0].samples.source
    'gyro'
    """
    only_keys(document, _KEYS, where)
    frames = read_frames(document, where)
    clock = _clock(document["clock"], f"{where}: [clock]") if "clock" in document else None
    channels, attitude = _channels(document, frames, where)
    mapping = ChannelMapping(
        channels=channels,
        attitude=attitude,
        clock=clock,
        experiments=_experiments(document, where),
        segments=_segments(document, {channel.name for channel in channels}, where),
    )
    _check_whole(mapping, where)
    return mapping


def _channels(
    document: Mapping[str, Any], frames: Frames, where: str
) -> tuple[tuple[MappedChannel, ...], MappedAttitude | None]:
    """All channels, those of vectors among them, and the quaternion."""
    tables = table(document.get("channels", {}), f"{where}: [channels]")
    channels = [_read_channel(name, value, frames, f"{where}: [channels.{name}]") for name, value in tables.items()]
    attitude = None
    for name, value in table(document.get("vectors", {}), f"{where}: [vectors]").items():
        found, quaternion = _read_vector(name, value, frames, f"{where}: [vectors.{name}]")
        channels += found
        attitude = quaternion or attitude
    if not channels and attitude is None:
        raise UsageError(f"{where} names no channel", needed="a table [channels.NAME]", remedy="add one per channel")
    channel_names = [channel.name for channel in channels] + (["phi", "theta", "psi"] if attitude else [])
    twins = sorted({name for name in channel_names if channel_names.count(name) > 1})
    if twins:
        raise UsageError(
            f"{where} names {', '.join(twins)} twice",
            needed="each channel once",
            remedy="remove it from [channels] or from [vectors]",
        )
    return tuple(channels), attitude


def _check_whole(mapping: ChannelMapping, where: str) -> None:
    """What only all of a mapping together can get wrong."""
    timed = [(f"[channels.{channel.name}]", channel.time) for channel in mapping.channels]
    timed += [("[vectors.quaternion]", mapping.attitude.time)] if mapping.attitude else []
    for name, time in timed:
        if mapping.clock is None and time is None:
            raise UsageError(
                f"{where}: {name} has no stamps",
                needed="a key `time` in it, or a table [clock] for all",
                remedy="add one of them; `sample_rate_hz = 250.0` in [clock] is enough for a uniform rate",
            )
    for channel in mapping.channels:
        attitude = mapping.attitude
        if channel.along_world and (attitude is None or attitude.time != channel.time):
            raise UsageError(
                f"{channel.where} is along the world",
                needed="the attitude at the same stamps, to turn it into the body",
                remedy="add a table [vectors.quaternion] with the same `time`",
            )
    if "" not in mapping.files:
        raise UsageError(
            f"{where}: every channel is in a file other than the log",
            needed="at least one channel without `file`",
            remedy=f"give {mapping.files[0]} as the log and remove `file` from its channels",
        )
    sources = [channel.samples.source for channel in mapping.channels]
    sources += [part.source for part in mapping.attitude.parts] if mapping.attitude else []
    if any(PLACEHOLDER in source for source in sources) != (mapping.experiments is not None):
        raise UsageError(
            f"{where} has {'[experiments]' if mapping.experiments else f'a source with {PLACEHOLDER}'} alone",
            needed=f"a table [experiments] and {PLACEHOLDER} in the sources of its channels",
            remedy='write names = ["1", "2"] in [experiments], and source = "data{experiment}"',
        )


def _clock(value: object, where: str) -> Clock:
    values = {"time": _in_brackets(value)} if isinstance(value, str) else table(value, where)
    only_keys(values, _CLOCK_KEYS, where)
    if len(values) != 1:
        raise UsageError(
            f"{where} has {len(values)} keys", needed=f"exactly one of {', '.join(_CLOCK_KEYS)}", remedy="keep one"
        )
    rate = number(values, "sample_rate_hz", where)
    if rate is not None:
        if rate <= 0.0:
            raise UsageError(
                f"{where} has `sample_rate_hz` = {rate:g}", needed="a rate above zero", remedy="correct it"
            )
        return Clock(sample_rate_hz=rate)
    key = next(iter(values))
    series = table(values[key], f"{where} {key}")
    only_keys(series, _CLOCK_SERIES_KEYS, f"{where} {key}")
    found = read_series(series, f"{where} {key}", si=("s",))
    return Clock(time=found) if key == "time" else Clock(steps=found)


def _experiments(document: Mapping[str, Any], where: str) -> Experiments | None:
    if "experiments" not in document:
        return None
    where = f"{where}: [experiments]"
    values = table(document["experiments"], where)
    only_keys(values, ("names", "spacing_s"), where)
    spacing_s = number(values, "spacing_s", where) or 0.0
    if spacing_s < 0.0:
        raise UsageError(f"{where} has `spacing_s` = {spacing_s:g}", needed="zero or more", remedy="correct it")
    return Experiments(names=names(values, "names", None, where), spacing_s=spacing_s)


def _segments(document: Mapping[str, Any], channel_names: set[str], where: str) -> tuple[Segment, ...]:
    where = f"{where}: [segments]"
    values = table(document.get("segments", {}), where)
    only_keys(values, ("use",), where)
    items = values.get("use", [])
    if not isinstance(items, list):
        raise UsageError(f"{where} `use` is {items!r}", needed="a list of tables", remedy="add brackets")
    return tuple(
        _segment(item, channel_names, f"{where} use, number {place}") for place, item in enumerate(items, start=1)
    )


def _segment(value: object, channel_names: set[str], where: str) -> Segment:
    values = table(value, where)
    only_keys(values, _SEGMENT_KEYS, where)
    excited = {axis for axis in AXES if f"{axis}_command" in channel_names or f"{axis}_excitation" in channel_names}
    axis = values.get("axis", next(iter(excited)) if len(excited) == 1 else None)
    if axis not in AXES:
        raise UsageError(
            f"{where} has `axis` = {axis!r}" if axis else f"{where} does not name its axis",
            needed=f"one of {', '.join(AXES)}",
            remedy='write axis = "pitch"',
        )
    kind = cast("Kind", choice(values, "kind", get_args(Kind), "other", where))
    by_time = (number(values, "start_s", where), number(values, "stop_s", where))
    by_sample = (index(values, "start_sample", where), index(values, "stop_sample", where))
    whole = Segment(
        axis=cast("Axis", axis),
        kind=kind,
        signal=_signal(values, str(axis), channel_names, where),
        band_rad_s=band(values, "band_rad_s", where),
    )
    if (*by_time, *by_sample) == (None,) * 4:
        return whole
    start, stop = by_time if None not in by_time else by_sample
    if (by_time != (None, None)) == (by_sample != (None, None)) or start is None or stop is None or not start < stop:
        raise UsageError(
            f"{where} is no interval",
            needed="start_s and stop_s, or start_sample and stop_sample, the start before the stop; or none of them",
            remedy="give one of the two pairs, or neither for the whole record",
        )
    return replace(whole, start_s=by_time[0], stop_s=by_time[1], start_sample=by_sample[0], stop_sample=by_sample[1])


def _signal(values: Mapping[str, Any], axis: str, channel_names: set[str], where: str) -> str:
    """The channel in which a segment shows: the one that is named, else the injected signal or the command."""
    if "signal" in values:
        return choice(values, "signal", sorted(channel_names), "", where)
    return next((name for kind in ("excitation", "command") if (name := f"{axis}_{kind}") in channel_names), "")


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


def _read_channel(name: str, value: object, frames: Frames, where: str) -> MappedChannel:
    """A table ``[channels.NAME]``, or a source with its unit alone: ``"U3 [V]"``."""
    values = _in_brackets(value) if isinstance(value, str) else table(value, where)
    only_keys(values, _CHANNEL_KEYS, where)
    if name not in STANDARD_UNITS:
        _check_own_name(name, values, where)
    series = replace(
        read_series(values, where, si=units_of(name)),
        file=file_below(values, where),
        **_steps(values, where),
    )
    if name in STANDARD_UNITS:
        series = read_frames(values, where, frames).turned(name, series)
    time, filters = _own_time(values, where), _filters(values, where)
    return MappedChannel(name=name, samples=series, time=time, where=where, filters=filters)


def _filters(values: Mapping[str, Any], where: str) -> tuple[SensorFilter, ...]:
    """The key ``filter``: what the channel has passed before it was logged."""
    if "filter" not in values:
        return ()
    return parse_filters(text(values, "filter", where), of=f'{where} filter = "{values["filter"]}"')


def _in_brackets(words: str) -> Mapping[str, str]:
    """Source and unit of words such as ``U3 [V]``."""
    source, _, unit = words.strip().removesuffix("]").rpartition(" [")
    return {"source": source.strip(), "unit": unit.strip()} if source else {"source": words.strip()}


def _steps(values: Mapping[str, Any], where: str) -> dict[str, Any]:
    """The keys ``derivative`` and ``low_pass_hz``: what a channel passes before anybody sees it."""
    derivative = values.get("derivative", False)
    if not isinstance(derivative, bool):
        raise UsageError(f"{where} has `derivative` = {derivative!r}", needed="true or false", remedy="correct it")
    cutoff_hz = number(values, "low_pass_hz", where)
    if cutoff_hz is not None and not 0.0 < cutoff_hz < math.inf:
        raise UsageError(
            f"{where} has `low_pass_hz` = {cutoff_hz:g}", needed="a cutoff above zero", remedy="correct it"
        )
    return {"derivative": derivative, "low_pass_hz": cutoff_hz}


def _read_vector(
    name: str, value: object, frames: Frames, where: str
) -> tuple[tuple[MappedChannel, ...], MappedAttitude | None]:
    """A table ``[vectors.NAME]``: the channels that it spells out, or the quaternion."""
    values = table(value, where)
    only_keys(values, _VECTOR_KEYS, where)
    known = {**BODY_VECTORS, **EARTH_VECTORS, **ANGLES}
    if name not in known and name != QUATERNION:
        close = nearest(name, (*known, QUATERNION))
        raise UsageError(
            f"{where} is not a known vector",
            needed=f"one of {', '.join((*known, QUATERNION))}",
            remedy=f"did you mean {close}?" if close else "name its parts as channels",
        )
    own = read_frames(values, where, frames)
    along_world = choice(values, "along", ("body", "world"), "body", where) == "world"
    if "along" in values and name not in BODY_VECTORS:
        raise UsageError(f"{where} has `along`", needed=f"it in one of {', '.join(BODY_VECTORS)}", remedy="remove it")
    si = "1" if name == QUATERNION else STANDARD_UNITS[known[name][0]]
    parts = _parts(values, 4 if name == QUATERNION else 3, si, where)
    time = _own_time(values, where)
    filters = _filters(values, where)
    if filters and (name == QUATERNION or along_world):
        raise UsageError(
            f"{where} has `filter`", needed="it in a table whose numbers are channels as they are", remedy="remove it"
        )
    if name == QUATERNION:
        w, x, y, z = parts
        return (), MappedAttitude(parts=(w, x, y, z), angles=own.angles(), time=time)
    if name in ANGLES:
        turned = [own.turned(channel, part) for channel, part in zip(known[name], parts, strict=True)]
    else:
        axes = signed_axes(own.frame if name in BODY_VECTORS and not along_world else own.world)
        turned = [replace(parts[place], scale=sign * parts[place].scale) for place, sign in axes]
    channels = zip(known[name], turned, strict=True)
    found = (
        MappedChannel(name=channel, samples=part, time=time, where=where, along_world=along_world, filters=filters)
        for channel, part in channels
    )
    return tuple(found), None


def read_series(values: Mapping[str, Any], where: str, *, si: Sequence[str]) -> Series:
    """The keys ``source`` or ``sum``, ``unit``, ``scale``, ``offset`` and ``row`` or ``column``."""
    row, column = index(values, "row", where), index(values, "column", where)
    if row is not None and column is not None:
        raise UsageError(f"{where} has `row` and `column`", needed="one of them", remedy="remove the other")
    source, parts = _source(values, where)
    series = Series(source=source, parts=parts, row=row, column=column)
    if "range" in values:
        return _over_range(series, values, where, si=si)
    return replace(
        series,
        unit=unit(values, "unit", si, where),
        scale=_scale(values, where),
        offset=number(values, "offset", where) or 0.0,
    )


def _source(values: Mapping[str, Any], where: str) -> tuple[str, tuple[tuple[str, float], ...]]:
    """The variable of a channel, or the weighted sum of several in words and its parts."""
    if "sum" not in values:
        return text(values, "source", where), ()
    if "source" in values:
        raise UsageError(f"{where} has `source` and `sum`", needed="one of them", remedy="remove the other")
    factors = table(values["sum"], f"{where} `sum`")
    if not factors:
        raise UsageError(
            f"{where} has an empty `sum`",
            needed="a factor for each variable",
            remedy="write sum = { A = 0.5, B = -0.5 }",
        )
    parts = [(name, number(factors, name, f"{where} `sum`") or 0.0) for name in factors]
    return " + ".join(f"{factor:g} {name}" for name, factor in parts).replace("+ -", "- "), tuple(parts)


def _over_range(series: Series, values: Mapping[str, Any], where: str, *, si: Sequence[str]) -> Series:
    """A share of the range between the smallest and the largest number: those that are given, or ``"logged"``."""
    if "1" not in si and si:
        raise UsageError(
            f"{where} has `range`", needed="it for a share, such as motor_1 or thrust_command", remedy="use `scale`"
        )
    if other := [key for key in ("unit", "scale", "offset") if key in values]:
        raise UsageError(f"{where} has `range` and `{other[0]}`", needed="one of them", remedy=f"remove `{other[0]}`")
    if values["range"] == "logged":
        return replace(series, logged_range=True)
    value = values["range"]
    ends = {str(place): end for place, end in enumerate(value)} if isinstance(value, list) else {}
    low, high = number(ends, "0", f"{where} `range`"), number(ends, "1", f"{where} `range`")
    if len(ends) != 2 or low is None or high is None or not low < high:
        raise UsageError(
            f"{where} has `range` = {value!r}",
            needed='two rising numbers, or "logged"',
            remedy="write [LOW, HIGH], such as SERVO1_MIN and SERVO1_MAX",
        )
    return replace(series, offset=-low, scale=1.0 / (high - low))


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
        source="", unit=unit(values, "unit", (si,), where), scale=_scale(values, where), file=file_below(values, where)
    )
    if ("sources" in values) == ("source" in values):
        raise UsageError(
            f"{where} has {'both' if 'source' in values else 'neither'} of `sources` and `source`",
            needed="one of them",
            remedy=f"give {count} names as `sources`, or a matrix as `source`",
        )
    if "sources" in values:
        for key in ("by", "columns"):
            if key in values:
                raise UsageError(
                    f"{where} has `{key}` and `sources`", needed=f"`{key}` for a matrix", remedy="remove it"
                )
        return tuple(replace(common, source=source) for source in names(values, "sources", count, where))
    source = text(values, "source", where)
    if "columns" in values:
        return tuple(replace(common, source=source, column=place) for place in _columns(values, count, where))
    by_row = choice(values, "by", ("row", "column"), "row", where) == "row"
    return tuple(
        replace(common, source=source, row=place if by_row else None, column=None if by_row else place)
        for place in range(count)
    )


def _columns(values: Mapping[str, Any], count: int, where: str) -> tuple[int, ...]:
    """Places of the components of a vector in a matrix that holds more."""
    value = values["columns"]
    whole = isinstance(value, list) and all(type(place) is int and place >= 0 for place in value)
    if not whole or len(set(value)) != count or len(value) != count or "by" in values:
        raise UsageError(
            f"{where} has `columns` = {value!r}" + (" and `by`" if "by" in values else ""),
            needed=f"{count} different columns, counted from zero, and no `by`",
            remedy=f"write columns = {list(range(count))}",
        )
    return tuple(value)


def _own_time(values: Mapping[str, Any], where: str) -> Series | None:
    if "time" not in values:
        if "time_unit" in values:
            raise UsageError(
                f"{where} has `time_unit` and no `time`", needed="both", remedy="give the unit in [clock] instead"
            )
        return None
    return Series(
        source=text(values, "time", where),
        unit=unit(values, "time_unit", ("s",), where),
        file=file_below(values, where),
    )


def _check_own_name(name: str, values: Mapping[str, Any], where: str) -> None:
    """A name outside the vocabulary needs a unit, and must not look like a misspelling."""
    close = nearest(name, STANDARD_UNITS, likeness=_TOO_LIKE)
    if close or not _OWN_NAME.fullmatch(name):
        raise UsageError(
            f"{where} is not a known channel",
            needed="a name such as roll_command, p, phi, ax, or one of your own in letters, digits and underscores",
            remedy=f"did you mean {close}? A name of your own must differ more" if close else "choose another name",
        )
    if "unit" not in values:
        suggested = nearest(name, STANDARD_UNITS)
        raise UsageError(
            f"{where} is not a known channel and has no `unit`",
            needed='a unit for a name of your own, such as unit = "1"',
            remedy=f"add it, or did you mean {suggested}?" if suggested else "add it",
        )


def nearest(name: str, known: Iterable[str], *, likeness: float = 0.6) -> str:
    """The known names that look most like ``name``, as words for a message; empty when none does.

    Examples
    --------
    >>> nearest("pich_command", ["pitch_command", "yaw_command", "battery_voltage"])
    'pitch_command, yaw_command'
    """
    return ", ".join(difflib.get_close_matches(name, list(known), n=3, cutoff=likeness))


def only_keys(table: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    """Refuse a key that means nothing here."""
    for key in table:
        if key not in known:
            raise UsageError(
                f"{where} has a key `{key}`",
                needed=f"one of {', '.join(known)}",
                remedy=f"did you mean {close}?" if (close := nearest(key, known)) else "remove it",
            )


def table(value: object, where: str) -> Mapping[str, Any]:
    """A table, as ``[name]`` or ``{...}`` writes it."""
    if not isinstance(value, Mapping):
        raise UsageError(f"{where} is {value!r}", needed="a table", remedy="write it as in the documentation of --map")
    return value


def text(values: Mapping[str, Any], key: str, where: str) -> str:
    """A name that must be there."""
    value = values.get(key)
    if not isinstance(value, str) or not value:
        came = f"has no `{key}`" if value is None else f"has `{key}` = {value!r}"
        raise UsageError(f"{where} {came}", needed="a name in quotes", remedy=f'write {key} = "NAME"')
    return value


def names(values: Mapping[str, Any], key: str, count: int | None, where: str) -> tuple[str, ...]:
    """A list of names, or of whole numbers that serve as such; each once."""
    value = values.get(key)
    number = "several" if count is None else str(count)
    if (
        not isinstance(value, list)
        or not value
        or (count is not None and len(value) != count)
        or not all((isinstance(item, str) and item) or type(item) is int for item in value)
        or len({str(item) for item in value}) < len(value)
    ):
        came = f"has no `{key}`" if value is None else f"has `{key}` = {value!r}"
        raise UsageError(
            f"{where} {came}", needed=f"a list of {number} different names", remedy=f'write {key} = ["A", "B", ...]'
        )
    return tuple(str(item) for item in value)


def number(values: Mapping[str, Any], key: str, where: str) -> float | None:
    """A finite number, or ``None`` where the key is missing."""
    value = values.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < float("inf"):
        raise UsageError(f"{where} has `{key}` = {value!r}", needed="a finite number", remedy="write it without quotes")
    return float(value)


def band(values: Mapping[str, Any], key: str, where: str) -> tuple[float, float] | None:
    """Two rising numbers above zero, or ``None`` where the key is missing."""
    if key not in values:
        return None
    value = values[key]
    ends = {str(place): end for place, end in enumerate(value)} if isinstance(value, list) else {}
    low, high = number(ends, "0", f"{where} `{key}`"), number(ends, "1", f"{where} `{key}`")
    if len(ends) != 2 or low is None or high is None or not 0.0 < low < high:
        raise UsageError(
            f"{where} has `{key}` = {value!r}", needed="two rising numbers above zero", remedy="write [LOW, HIGH]"
        )
    return low, high


def index(values: Mapping[str, Any], key: str, where: str) -> int | None:
    """A place counted from zero, or ``None`` where the key is missing."""
    value = values.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise UsageError(f"{where} has `{key}` = {value!r}", needed="a whole number from 0", remedy="count from zero")
    return value


def choice(values: Mapping[str, Any], key: str, known: Sequence[str], default: str, where: str) -> str:
    """One of a few words."""
    value = values.get(key, default)
    if value not in known:
        raise UsageError(f"{where} has `{key}` = {value!r}", needed=f"one of {', '.join(known)}", remedy="correct it")
    return str(value)


def unit(values: Mapping[str, Any], key: str, si: Sequence[str], where: str) -> str:
    """A unit that measures what it should, or the empty text where the key is missing.

    Parameters
    ----------
    values, key, where
        The table, the key in it, and what the messages call the table.
    si
        Units of the quantity; empty when any known unit will do.
    """
    if key not in values:
        return ""
    found = text(values, key, where)
    try:
        measured = parse_unit(found).si
    except UsageError as error:
        raise UsageError(f"{where} `{key}`: {error.came}", needed=error.needed, remedy=error.remedy) from error
    if si and measured not in {parse_unit(one).si for one in si}:
        raise UsageError(
            f"{where} `{key}` is {found!r}",
            needed=f"a unit of {' or '.join(si)}",
            remedy=_SHARE if tuple(si) == ("1",) else "correct the unit or the channel name",
        )
    return found


def file_below(values: Mapping[str, Any], where: str) -> str:
    """The key ``file``: a path that cannot lead out of the log's folder, or the empty text where it is missing."""
    if "file" not in values:
        return ""
    found = text(values, "file", where)
    as_windows = PureWindowsPath(found)
    leads_away = PurePosixPath(found).is_absolute() or as_windows.anchor or ".." in as_windows.parts
    if leads_away or "\0" in found:
        raise UsageError(
            f"{where} has `file` = {found!r}",
            needed="a path below the folder of the log",
            remedy="put the file next to the log and give its name alone",
        )
    return found
