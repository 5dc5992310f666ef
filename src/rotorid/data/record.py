"""Contents of a log as values: channels on their own clocks, and histories on a common clock.

A :class:`Channel` says what a row of numbers is, in which unit, and where it came from. Rows with common stamps are a
:class:`Topic`; a :class:`FlightRecord` is all topics of a log in the vocabulary of the package, each on its own clock,
with what the autopilot says of the vehicle and the flight (:class:`Status`). A :class:`Maneuver` is an interval in
which an axis was excited; it holds no data. A :class:`TimeHistory` is channels brought onto one uniform clock, and a
:class:`MotorRecord` one with what the physics of motors needs: outputs, rates, specific force.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import ArrayLike

from rotorid._faces import attached, attached_method
from rotorid.data.base import Immutable, optional, read_only
from rotorid.data.display import counted, html_table, lines_of
from rotorid.data.findings import Finding, Findings
from rotorid.errors import UsageError
from rotorid.typing import AnyArray, Axis, FloatArray, IntArray

if TYPE_CHECKING:
    from rotorid.data.sensor_filters import SensorFilter
    from rotorid.plot.accessors import HistoryPictures, RecordPictures, TrackPictures

MOTORS = 16

LOWEST_RATE_HZ = 40.0
"""Rates and commands logged more slowly show neither motor lag nor delay of a small multirotor."""

AXES = ("roll", "pitch", "yaw", "thrust")


_OF_AXES = ("command", "excitation", "setpoint_excitation", "stick")
"""Channels of each axis: what the mixer receives, what was added to it, what was added to a set-point, the stick."""


_FILTERED = {**dict.fromkeys("pqr", "rad/s"), **dict.fromkeys(("ax", "ay", "az"), "m/s^2")}
"""Channels that autopilots filter: ``p_raw`` before the filter, ``p_filtered`` after it at the rate of the sensor."""


def _standard() -> Mapping[str, str]:
    units = {f"{axis}_{kind}": "1" for axis in AXES for kind in _OF_AXES}
    units |= {f"motor_{number}": "1" for number in range(1, MOTORS + 1)}
    units |= {f"motor_{number}_excitation": "1" for number in range(1, MOTORS + 1)}
    units |= {f"motor_speed_{number}": "rad/s" for number in range(1, MOTORS + 1)}
    units |= {f"notch_frequency_{number}": "rad/s" for number in range(1, MOTORS + 1)}
    groups = {
        "rad/s": "p q r",
        "rad": "phi theta psi",
        "m/s": "u v w velocity_north velocity_east velocity_down",
        "m": "north east down",
        "m/s^2": "ax ay az",
    }
    controlled = {name: unit for unit, names in groups.items() for name in names.split()}
    units |= controlled
    units |= {f"{name}_setpoint": unit for name, unit in controlled.items() if unit != "m/s^2"}
    units |= {f"{name}_dot": "rad/s^2" for name in "pqr"} | {f"{name}_dot": "m/s^2" for name in "uvw"}
    units |= {f"{name}_{stage}": unit for name, unit in _FILTERED.items() for stage in ("raw", "filtered")}
    units |= {f"{axis}_{term}_term": "1" for axis in AXES[:3] for term in "pidf"}
    units |= {f"{axis}_slew_factor": "1" for axis in AXES[:3]}
    units |= {"velocity_forward": "m/s", "velocity_right": "m/s"}
    units |= {f"velocity_{way}_dot": "m/s^2" for way in ("forward", "right", "down")}
    # Of outer loops: the velocity that stick or path ask for, and the acceleration that they ask for themselves.
    units |= {f"velocity_{way}_feedforward": "m/s" for way in ("north", "east", "down")}
    units |= {f"acceleration_{way}_setpoint": "m/s^2" for way in ("north", "east", "down")}
    units |= {"wind_north": "m/s", "wind_east": "m/s", "accel_clips": "1", "hover_thrust": "1"}
    units |= {f"{name}_vibration": "m/s^2" for name in ("ax", "ay", "az")}
    return MappingProxyType(units | {"battery_voltage": "V", "battery_current": "A"})


STANDARD_UNITS: Mapping[str, str] = _standard()
"""Every channel name of the vocabulary and its SI unit. Axes are FRD/NED, angles radians."""


_BENCH_UNITS = ("1", "V", "us", "rad/s")
"""Of what drives a motor on a bench: share of full output, volts, width of the pulses, speed that is asked for."""

_DRIVING = re.compile(r"motor_[1-9][0-9]?(_excitation)?")


def units_of(name: str) -> tuple[str, ...]:
    """Units that a channel may have, that of the vocabulary first; empty for a name outside of it.

    Parameters
    ----------
    name
        What drives a motor, on a bench also in V, in µs of pulses or in rad/s; all others have one unit.

    Examples
    --------
    >>> units_of("motor_1"), units_of("p"), units_of("my_channel")
    (('1', 'V', 'us', 'rad/s'), ('rad/s',), ())
    """
    if name not in STANDARD_UNITS:
        return ()
    return _BENCH_UNITS if _DRIVING.fullmatch(name) else (STANDARD_UNITS[name],)


@dataclass(frozen=True, kw_only=True, slots=True)
class Channel:
    """Name, unit and origin of one row of samples.

    Parameters
    ----------
    name
        A name of the vocabulary (``STANDARD_UNITS``) or one that the user gave.
    unit
        SI unit of the values; pulses that drive a motor are in µs.
    source
        Where the values stand in the log, as the log names it: ``SIDD.Gx``, ``vehicle_angular_velocity.xyz[0]``.
    filters
        Filters that the values have passed, as far as the user gives them.
    """

    name: str
    unit: str
    source: str = ""
    filters: tuple[SensorFilter, ...] = ()


Kind: TypeAlias = Literal["sweep", "random_binary", "multisine", "doublet", "multistep", "other"]
Origin: TypeAlias = Literal["declared", "found", "given"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Maneuver:
    """An excited interval on the log's own clock.

    Parameters
    ----------
    axis
        The excited axis.
    kind
        What was flown. ``other`` is an excitation that fits no pattern, or one that the user gave by hand.
    start_s, stop_s
        Interval on the log's own clock, never shifted.
    band_rad_s
        Lowest and highest excited frequency, or ``None`` when it is not known.
    origin
        ``declared`` by the log itself, ``found`` in the signals, or ``given`` by the user.
    signal
        Channel in which the excitation was seen.
    """

    axis: Axis
    kind: Kind
    start_s: float
    stop_s: float
    band_rad_s: tuple[float, float] | None = None
    origin: Origin = "found"
    signal: str = ""

    def __post_init__(self) -> None:
        if not self.start_s < self.stop_s:
            raise ValueError(f"a maneuver must stop after it starts, not last from {self.start_s} s to {self.stop_s} s")

    @property
    def duration_s(self) -> float:
        return self.stop_s - self.start_s

    @property
    def band_text(self) -> str:
        """The band for a person, empty where it is not known."""
        return "" if self.band_rad_s is None else f"{self.band_rad_s[0]:.3g} to {self.band_rad_s[1]:.3g} rad/s"


class Maneuvers(tuple[Maneuver, ...]):
    """Maneuvers as a tuple that shows itself: one a line, and as a table in a notebook.

    Examples
    --------
    >>> Maneuvers([Maneuver(axis="roll", kind="sweep", start_s=3.0, stop_s=63.0, band_rad_s=(0.3, 60.0))])
    1 maneuver
      roll  sweep  3.00 to 63.00 s  0.3 to 60 rad/s  found
    """

    __slots__ = ()

    def __repr__(self) -> str:
        return lines_of(self._head, self._rows)

    def _repr_html_(self) -> str:
        return html_table(self._head, ["axis", "kind", "from, to", "band", "origin", "signal"], self._rows)

    @property
    def _head(self) -> str:
        return counted(len(self), "maneuver")

    @property
    def _rows(self) -> list[tuple[str, ...]]:
        return [(m.axis, m.kind, f"{m.start_s:.2f} to {m.stop_s:.2f} s", m.band_text, m.origin, m.signal) for m in self]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Track(NDArrayOperatorsMixin, Immutable):
    """Samples of one channel with their stamps, as they were logged.

    It calculates and plots like the array of its values: ``np.degrees(track)``, ``track - track[0]``,
    ``plt.plot(track.time_s, track)``; what comes out is a plain array. Samples of two topics do not lie on one clock;
    :func:`rotorid.resample` brings them onto one.

    Parameters
    ----------
    channel
        Name, unit and origin.
    topic
        The log's own name of the topic that holds it.
    time_s
        Stamps, shape ``(samples,)``, seconds on the log's own clock; as logged, so they may repeat or step back.
    values
        Shape ``(samples,)``, SI units, FRD/NED.

    Examples
    --------
    >>> track = Track(channel=Channel(name="p", unit="rad/s"), topic="SIDD", time_s=[0.0, 0.1], values=[1.0, 2.0])
    >>> track
    p [rad/s] of SIDD: 2 samples at 10 Hz, 0 to 0.1 s
    >>> (2.0 * track).tolist(), float(np.mean(track)), len(track)
    ([2.0, 4.0], 1.5, 2)
    """

    channel: Channel
    topic: str
    time_s: FloatArray
    values: FloatArray

    def __post_init__(self) -> None:
        time_s, values = (read_only(array, np.float64, ndim=1) for array in (self.time_s, self.values))
        if time_s.size != values.size:
            raise ValueError(f"{self.name} has {time_s.size} time stamps but {values.size} samples")
        self._set(time_s=time_s, values=values)

    @property
    def name(self) -> str:
        return self.channel.name

    @property
    def unit(self) -> str:
        return self.channel.unit

    @property
    def sample_rate_hz(self) -> float:
        """Median rate of the stamps; zero for fewer than two samples."""
        return _median_rate_hz(self.time_s)

    @property
    def plot(self) -> TrackPictures:
        """Its picture: ``track.plot()``."""
        pictures: TrackPictures = attached(self)
        return pictures

    def to_pandas(self) -> Any:
        """A ``pandas.Series`` over the stamps.

        Raises
        ------
        UsageError
            pandas is not installed.
        """
        index = optional("pandas").Index(self.time_s, name="time_s")
        return optional("pandas").Series(self.values, index=index, name=self.name)

    def __len__(self) -> int:
        return int(self.values.size)

    def __getitem__(self, index: Any) -> Any:
        return self.values[index]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> AnyArray:
        return np.array(self.values, dtype=dtype) if copy else np.asarray(self.values, dtype=dtype)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **keywords: Any) -> Any:
        plain = [given.values if isinstance(given, Track) else given for given in inputs]
        return getattr(ufunc, method)(*plain, **keywords)

    def __repr__(self) -> str:
        span = f", {self.time_s.min():.6g} to {self.time_s.max():.6g} s" if len(self) else ""
        return f"{self.name} [{self.unit}] of {self.topic}: {len(self)} samples at {self.sample_rate_hz:.4g} Hz{span}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Topic(Immutable):
    """Channels that share one clock.

    Parameters
    ----------
    name
        The log's own name of the topic.
    time_s
        Stamps, shape ``(samples,)``, seconds on the log's own clock; as logged, so they may repeat or step back.
    channels
        What the rows of ``values`` are.
    values
        Shape ``(channels, samples)``, SI units, FRD/NED.
    of_table
        Whether it is part of a table, whose name is that of its stamps, so that people know columns alone.
    """

    name: str
    time_s: FloatArray
    channels: tuple[Channel, ...]
    values: FloatArray
    of_table: bool = False

    def __post_init__(self) -> None:
        time_s = read_only(self.time_s, np.float64, ndim=1)
        values = read_only(self.values, np.float64, ndim=2)
        if values.shape != (len(self.channels), time_s.size):
            raise ValueError(
                f"topic {self.name} has {len(self.channels)} channels and {time_s.size} time stamps, but values "
                f"of shape {values.shape}"
            )
        self._set(time_s=time_s, values=values, channels=tuple(self.channels))

    def row(self, name: str) -> int | None:
        """Row of the channel ``name``, or ``None``."""
        return self._rows.get(name)

    @cached_property
    def _rows(self) -> Mapping[str, int]:
        """Name of each channel to its row, of a name that is there twice to the first."""
        return {self.channels[row].name: row for row in reversed(range(len(self.channels)))}

    def within(self, start_s: float, stop_s: float) -> slice | IntArray:
        """Index of the samples from `start_s` to `stop_s`, both included, in ``time_s`` and each row of ``values``.

        Examples
        --------
        >>> topic = Topic(name="imu", time_s=[0.0, 0.1, 0.2, 0.3], channels=(), values=np.empty((0, 4)))
        >>> topic.within(0.1, 0.25), topic.time_s[topic.within(0.1, 0.25)]
        (slice(1, 3, None), array([0.1, 0.2]))
        """
        if not self._rises:
            return np.flatnonzero((self.time_s >= start_s) & (self.time_s <= stop_s))
        first, last = np.searchsorted(self.time_s, start_s), np.searchsorted(self.time_s, stop_s, side="right")
        return slice(int(first), int(last))

    @cached_property
    def _rises(self) -> bool:
        return bool(np.all(np.diff(self.time_s) >= 0.0))

    def place(self, row: int) -> str:
        """Where a row comes from, in words: the topic, or the column of a table."""
        return (self.of_table and self.channels[row].source) or self.name

    @cached_property
    def sample_rate_hz(self) -> float:
        """Median rate of the stamps; zero for fewer than two samples."""
        return _median_rate_hz(self.time_s)


def places(sources: Iterable[tuple[Topic, int]]) -> str:
    """Where rows of topics come from, each place once; of many columns of a table the first and the last.

    Examples
    --------
    >>> speeds = [Channel(name=f"motor_speed_{n}", unit="rad/s", source=f"rpm_{n}") for n in range(1, 5)]
    >>> table = Topic(name="t", time_s=[0.0], channels=tuple(speeds), values=np.zeros((4, 1)), of_table=True)
    >>> places([(table, row) for row in range(4)]), places([(table, 0)])
    ('rpm_1 to rpm_4', 'rpm_1')
    """
    found: dict[int, list[str]] = {}
    for topic, row in sources:
        found.setdefault(id(topic), []).append(topic.place(row))
    names = (list(dict.fromkeys(of_topic)) for of_topic in found.values())
    parts = (part for own in names for part in (own if len(own) < 4 else [f"{own[0]} to {own[-1]}"]))
    return ", ".join(dict.fromkeys(parts))


def require_record(record: object) -> None:
    """Raise where something else came in place of a record, such as the name of its file.

    Raises
    ------
    UsageError
        It is no record.
    """
    if not isinstance(record, FlightRecord):
        raise UsageError(f"{type(record).__name__} is no FlightRecord", needed="what rotorid.read gave")


def silences(topics: Sequence[Topic], longer_than_s: float) -> Intervals:
    """Start and stop of each pause in which no topic has a sample.

    Parameters
    ----------
    topics
        Of one record.
    longer_than_s
        A shorter pause is none.

    Examples
    --------
    >>> slow = Topic(name="BAT", time_s=[0.0, 40.0, 80.0], channels=(), values=np.zeros((0, 3)))
    >>> fast = Topic(name="IMU", time_s=[0.0, 1.0, 2.0, 80.0], channels=(), values=np.zeros((0, 4)))
    >>> silences([slow, fast], 39.0), silences([slow, fast], 50.0)
    (((40.0, 80.0),), ())
    """
    runs: list[FloatArray] = []
    for topic in topics:
        stamps = topic.time_s if bool(np.all(np.diff(topic.time_s) >= 0.0)) else np.sort(topic.time_s)
        ends = np.flatnonzero(np.diff(stamps) > longer_than_s)
        if stamps.size:
            runs.append(np.stack([stamps[np.r_[0, ends + 1]], stamps[np.r_[ends, stamps.size - 1]]]))
    if not runs:
        return ()
    starts, stops = np.concatenate(runs, axis=1)
    order = np.argsort(starts, kind="stable")
    starts, latest = starts[order][1:], np.maximum.accumulate(stops[order])[:-1]
    silent = starts - latest > longer_than_s
    return tuple(zip(latest[silent].tolist(), starts[silent].tolist(), strict=True))


def _median_rate_hz(time_s: FloatArray) -> float:
    steps = np.diff(time_s)
    steps = steps[steps > 0.0]
    return float(1.0 / np.median(steps)) if steps.size else 0.0


@dataclass(frozen=True, kw_only=True)
class Source(Immutable):
    """Source of a record: enough to find the file again, to recognize it and to read it the same way."""

    name: str
    format: str
    sha256: str
    firmware: str = ""
    mapping: str = ""


@dataclass(frozen=True, kw_only=True, slots=True)
class Unread:
    """What a log holds near to channels that it may lack, and no reader turns into them.

    Parameters
    ----------
    name
        Of the topic, message or variable, as the log calls it.
    channels
        What it is near to: names of channels, or ``motor_`` and ``motor_speed_`` of all motors.
    why
        Reason, as a clause.
    rate_hz
        How often it was logged; zero where that was not counted.
    """

    name: str
    channels: tuple[str, ...]
    why: str
    rate_hz: float = 0.0

    def near(self, channel: str) -> bool:
        """Whether a channel could have come from this.

        Examples
        --------
        >>> speeds = Unread(name="escRPM", channels=("motor_speed_",), why="it is the mean of all motors")
        >>> speeds.near("motor_speed_3"), speeds.near("motor_3")
        (True, False)
        """
        head = channel.rstrip("0123456789")
        return channel in self.channels or (head.endswith("_") and head in self.channels)


Vehicle: TypeAlias = Literal[
    "", "multirotor", "helicopter", "plane", "VTOL", "rover", "boat", "submarine", "airship", "antenna tracker"
]
Intervals: TypeAlias = tuple[tuple[float, float], ...]
"""Start and stop of each, in seconds on the log's own clock."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Status:
    """Status of vehicle and flight as reported by the autopilot: parameters, modes and flags.

    Parameters
    ----------
    vehicle
        Kind of vehicle; empty where the log does not say.
    named_in
        What says so, such as ``MAV_TYPE 1``.
    armed
        When the motors could run; empty: never; ``None`` where the log does not say.
    in_air
        When the autopilot held that it flew; empty: never; ``None`` where the log does not say.
    early
        Whether the autopilot may hold that it flies as soon as the throttle rises.
    unlogged
        When neither arming nor landing had been logged yet, so that nothing is known of either.
    flagged_in
        What says when it was armed and in the air, such as ``vehicle_land_detected``.
    direct_rates
        When the set-points of the body rates came straight from the sticks, so that no feedback was in them.
    modes
        Flight mode, as the autopilot calls it, with start and stop of each stay in it.
    planned
        When a program flew a plan through the set-points of the attitude, as the log says.
    """

    vehicle: Vehicle = ""
    named_in: str = ""
    armed: Intervals | None = None
    in_air: Intervals | None = None
    early: bool = False
    unlogged: Intervals = ()
    flagged_in: str = ""
    direct_rates: Intervals = ()
    modes: tuple[tuple[str, float, float], ...] = ()
    planned: Intervals = ()

    @property
    def foreign(self) -> bool:
        """Whether the log comes from another vehicle than a multirotor."""
        return self.vehicle not in ("", "multirotor")


@dataclass(frozen=True, kw_only=True, eq=False)
class FlightRecord(Immutable):
    """All of a log that the package has a name for.

    Parameters
    ----------
    source
        File name, format, hash, firmware.
    topics
        In order of preference: where two topics hold the same channel, the earlier one is used for as long as it lasts.
    parameters
        The autopilot's own parameters.
    declared
        Excitations that the log itself announces.
    instruments
        Axis to channels that excite it and contain no feedback, best first.
    findings
        What the reader had to remark.
    status
        What the autopilot says of vehicle and flight.
    unread
        What the log holds near to channels that it lacks: no reason to say that it was not logged.

    Examples
    --------
    >>> rate = Channel(name="p", unit="rad/s")
    >>> rates = Topic(name="RATE", time_s=[0.0, 0.1, 0.2], channels=(rate,), values=[[1.0, 2.0, 3.0]])
    >>> record = FlightRecord(source=Source(name="flight.BIN", format="dataflash", sha256=""), topics=(rates,))
    >>> record
    FlightRecord flight.BIN (dataflash): 1 channel, 0 to 0.2 s
      RATE  10 Hz  3 samples  p
    >>> record["p"].time_s.tolist(), record["p"].values.tolist()
    ([0.0, 0.1, 0.2], [1.0, 2.0, 3.0])
    """

    source: Source
    topics: tuple[Topic, ...]
    parameters: Mapping[str, float] = field(default_factory=dict)
    declared: tuple[Maneuver, ...] = ()
    instruments: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    status: Status = Status()
    unread: tuple[Unread, ...] = ()

    def __post_init__(self) -> None:
        self._set(
            topics=tuple(self.topics),
            parameters=self.parameters,
            declared=Maneuvers(self.declared),
            instruments=self.instruments,
            findings=Findings(self.findings),
        )

    @classmethod
    def from_arrays(
        cls,
        time_s: ArrayLike,
        channels: Mapping[str, ArrayLike | tuple[ArrayLike, ArrayLike]],
        *,
        mapping: Any = None,
        name: str = "arrays",
    ) -> FlightRecord:
        """A record of arrays, checked as a log is; all verbs take it.

        Parameters
        ----------
        time_s
            Stamps of the samples, shape ``(n,)``.
        channels
            Name to samples, shape ``(n,)``. Names and units are those of tables: ``p`` in SI, or ``p [deg/s]``; other
            names are left out, with a finding. A sample that is not a number was not taken. A tuple ``(time_s,
            samples)`` has stamps of its own.
        mapping
            Names the channels of other arrays, also of matrices: a TOML file, its tables as dictionaries, or what
            :func:`rotorid.io.read_mapping` made of it. Its clock is `time_s`.
        name
            What findings call the record.

        Raises
        ------
        LogError
            Stamps and samples differ in number, or nothing has a known name.
        UsageError
            A unit or the mapping does not fit.

        Examples
        --------
        >>> import rotorid
        >>> rotorid.FlightRecord.from_arrays([0.0, 0.1, 0.2], {"q [deg/s]": [0.0, 90.0, 180.0]})
        FlightRecord arrays (arrays): 1 channel, 0 to 0.2 s
          clock  10 Hz  3 samples  q
        """
        record: FlightRecord = attached_method("FlightRecord.from_arrays")(time_s, channels, mapping=mapping, name=name)
        return record

    @classmethod
    def from_pandas(cls, frames: Any, *, mapping: Any = None, name: str = "arrays") -> FlightRecord:
        """A record of a ``pandas.DataFrame`` with stamps in seconds as its index, or of several by topic.

        Parameters
        ----------
        frames
            Columns are named as in :meth:`from_arrays`; units may also be in ``attrs["units"]``, where
            :meth:`to_pandas` leaves them.
        mapping, name
            As of :meth:`from_arrays`.

        Raises
        ------
        LogError, UsageError
            As of :meth:`from_arrays`, or the index counts rows.

        Examples
        --------
        >>> import pandas, rotorid
        >>> frame = pandas.DataFrame({"p": [0.0, 1.0, 0.0]}, index=[0.0, 0.1, 0.2])
        >>> rotorid.FlightRecord.from_pandas(frame).channel_names
        ('p',)
        """
        record: FlightRecord = attached_method("FlightRecord.from_pandas")(frames, mapping=mapping, name=name)
        return record

    @property
    def channel_names(self) -> tuple[str, ...]:
        """Names of all channels, each once, in order of preference."""
        return tuple(dict.fromkeys(channel.name for topic in self.topics for channel in topic.channels))

    def holding(self, name: str) -> Iterator[tuple[Topic, int]]:
        """The topics that hold the channel ``name``, best first, with its row in each."""
        yield from self._holders.get(name, ())

    @cached_property
    def _holders(self) -> Mapping[str, Sequence[tuple[Topic, int]]]:
        """Name of each channel to the topics that hold it, best first, with its row in each."""
        holders: dict[str, list[tuple[Topic, int]]] = {}
        for topic in self.topics:
            for name, row in topic._rows.items():
                holders.setdefault(name, []).append((topic, row))
        return holders

    def rate_hz(self, name: str) -> float:
        """Sample rate of the fastest copy of a channel; zero if the log has none."""
        return max((topic.sample_rate_hz for topic, _ in self.holding(name)), default=0.0)

    def unit_of(self, name: str) -> str:
        """Unit of the best copy of a channel; that of the vocabulary, or 1, where the log has none."""
        source = next(self.holding(name), None)
        return STANDARD_UNITS.get(name, "1") if source is None else source[0].channels[source[1]].unit

    @cached_property
    def outputs(self) -> tuple[str, ...]:
        """Outputs ``motor_1`` and on that are shares of full output; volts, pulses and speeds of a bench are none."""
        names = (f"motor_{number}" for number in range(1, MOTORS + 1))
        return tuple(name for name in names if name in self.channel_names and self.unit_of(name) == "1")

    @property
    def start_s(self) -> float:
        """First stamp of any topic."""
        return min((float(topic.time_s[0]) for topic in self.topics if topic.time_s.size), default=0.0)

    @property
    def stop_s(self) -> float:
        """Last stamp of any topic."""
        return max((float(topic.time_s[-1]) for topic in self.topics if topic.time_s.size), default=0.0)

    def __getitem__(self, name: str) -> Track:
        """Samples of one channel with their stamps, from the preferred topic; :meth:`holding` has the others."""
        for topic, row in self.holding(name):
            return Track(channel=topic.channels[row], topic=topic.name, time_s=topic.time_s, values=topic.values[row])
        raise KeyError(f"no channel {name!r}; there are {', '.join(self.channel_names) or 'none'}")

    def __contains__(self, name: object) -> bool:
        return name in self.channel_names

    # Neither its topics nor its channels are meant by a loop over a record: who wants either says so.
    __iter__ = None

    @property
    def plot(self) -> RecordPictures:
        """Its picture: ``record.plot()``, ``record.plot("roll_command", "p")``."""
        pictures: RecordPictures = attached(self)
        return pictures

    def to_pandas(self) -> dict[str, Any]:
        """Topic to a ``pandas.DataFrame`` of its channels over its stamps: every topic has its own clock.

        Raises
        ------
        UsageError
            pandas is not installed.
        """
        return {
            topic.name: _frame(topic.time_s, topic.channels, topic.values) for topic in self.topics if topic.channels
        }

    def __repr__(self) -> str:
        return lines_of(self._head, self._rows)

    def _repr_html_(self) -> str:
        findings_html = Findings(self.findings)._repr_html_() if self.findings else ""
        return html_table(self._head, ["topic", "rate", "samples", "channels"], self._rows) + findings_html

    @property
    def _head(self) -> str:
        count, firmware = len(self.channel_names), f", {self.source.firmware}" if self.source.firmware else ""
        remarks = f", {counted(len(self.findings), 'finding')}" if self.findings else ""
        return (
            f"FlightRecord {self.source.name} ({self.source.format}{firmware}): {counted(count, 'channel')}, "
            f"{self.start_s:.6g} to {self.stop_s:.6g} s{remarks}"
        )

    @property
    def _rows(self) -> list[tuple[str, ...]]:
        return [
            (
                topic.name,
                f"{topic.sample_rate_hz:.4g} Hz",
                f"{topic.time_s.size} samples",
                " ".join(channel.name for channel in topic.channels),
            )
            for topic in self.topics
        ]


def _frame(time_s: FloatArray, channels: tuple[Channel, ...], values: FloatArray) -> Any:
    """A ``pandas.DataFrame`` over stamps; its ``attrs`` hold the units."""
    pandas = optional("pandas")
    names = [channel.name for channel in channels]
    frame = pandas.DataFrame(values.T, index=pandas.Index(time_s, name="time_s"), columns=names)
    frame.attrs["units"] = {channel.name: channel.unit for channel in channels}
    return frame


@dataclass(frozen=True, kw_only=True, eq=False)
class TimeHistory(Immutable):
    """Samples of several channels at one rate, without a gap.

    Parameters
    ----------
    values
        Shape ``(channels, samples)``, SI units.
    channels
        What the rows are.
    sample_rate_hz
        One rate for all.
    start_s
        Time of the first sample on the log's own clock.
    processing
        What was done to the data since they were read, oldest first.

    Examples
    --------
    >>> history = TimeHistory(values=[[3.0, -3.0]], channels=(Channel(name="p", unit="rad/s"),), sample_rate_hz=10.0,
    ...                       start_s=2.0)
    >>> history
    TimeHistory of 1 channel: 2 samples at 10 Hz, 2 to 2.1 s
      p  rad/s  rms 3
    >>> history["p"].tolist()
    [3.0, -3.0]
    """

    values: FloatArray
    channels: tuple[Channel, ...]
    sample_rate_hz: float
    start_s: float
    processing: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        values = read_only(self.values, np.float64, ndim=2)
        if values.shape[0] != len(self.channels):
            raise ValueError(f"{len(self.channels)} channels are named but there are {values.shape[0]} rows")
        if not self.sample_rate_hz > 0.0:
            raise ValueError(f"the sample rate must be positive, not {self.sample_rate_hz} Hz")
        self._set(values=values, channels=tuple(self.channels), processing=tuple(self.processing))

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(channel.name for channel in self.channels)

    @property
    def time_s(self) -> FloatArray:
        """Stamps on the log's own clock, shape ``(samples,)``."""
        return self.start_s + np.arange(self.values.shape[1]) / self.sample_rate_hz

    @property
    def duration_s(self) -> float:
        return float(self.values.shape[1] / self.sample_rate_hz)

    def __getitem__(self, name: str) -> FloatArray:
        """Samples of one channel, shape ``(samples,)``."""
        try:
            row = self.names.index(name)
        except ValueError:
            raise KeyError(f"no channel {name!r}; there are {', '.join(self.names)}") from None
        samples: FloatArray = self.values[row]
        return samples

    def __contains__(self, name: object) -> bool:
        return name in self.names

    __iter__ = None

    @property
    def plot(self) -> HistoryPictures:
        """Its picture: ``history.plot()``, ``history.plot("p")``."""
        pictures: HistoryPictures = attached(self)
        return pictures

    def to_pandas(self) -> Any:
        """A ``pandas.DataFrame`` of the channels over the stamps; its ``attrs`` hold the units.

        Raises
        ------
        UsageError
            pandas is not installed.
        """
        return _frame(self.time_s, self.channels, self.values)

    def __repr__(self) -> str:
        return lines_of(self._head, self._rows)

    def _repr_html_(self) -> str:
        return html_table(self._head, ["channel", "unit", "size"], self._rows)

    @property
    def _head(self) -> str:
        count, samples = self.values.shape
        stop_s = self.start_s + max(samples - 1, 0) / self.sample_rate_hz
        return (
            f"TimeHistory of {counted(count, 'channel')}: {samples} samples at {self.sample_rate_hz:.6g} Hz, "
            f"{self.start_s:.6g} to {stop_s:.6g} s"
        )

    @property
    def _rows(self) -> list[tuple[str, ...]]:
        sizes = np.sqrt(np.mean(self.values**2, axis=1)) if self.values.size else np.zeros(len(self.channels))
        return [
            (channel.name, channel.unit, f"rms {size:.4g}")
            for channel, size in zip(self.channels, sizes.tolist(), strict=True)
        ]


@dataclass(frozen=True, kw_only=True, eq=False)
class MotorRecord(Immutable):
    """Motor outputs and what the vehicle did, sample by sample.

    Parameters
    ----------
    name
        Where it comes from.
    sample_rate_hz
        Of everything.
    outputs
        Of the motors, each held until the next sample, shape ``(motors, n)``.
    between
        ``held`` for outputs, and ``lines`` for measured speeds, which go on to the next sample.
    rates
        Body rates p, q, r in rad/s, shape ``(3, n)``.
    az
        Specific force along the body's z axis in m/s², shape ``(n,)``; -9.81 in hover.
    w
        Velocity along the body's z axis in m/s, shape ``(n,)``; empty where it was not logged.
    force
        Specific force along all three axes in m/s², shape ``(3, n)``; empty where only ``az`` is wanted.
    velocity
        Over ground, in body axes, m/s, shape ``(3, n)``; empty where it was not logged.
    attitude
        Roll, pitch and heading in rad, shape ``(3, n)``; empty where it was not logged.
    strength
        Thrust at a given output relative to that at the reference voltage, shape ``(n,)``; one by default.
    gyro_taps, accel_taps
        Impulse responses, at this rate, of known filters that rates and specific force have passed; none by default.
    start_s
        Time of the first sample on the log's own clock.

    Raises
    ------
    UsageError
        Lengths differ, or a sample is no number.
    """

    name: str
    sample_rate_hz: float
    outputs: FloatArray
    rates: FloatArray
    az: FloatArray
    w: FloatArray = field(default_factory=lambda: np.zeros(0))
    force: FloatArray = field(default_factory=lambda: np.zeros((3, 0)))
    velocity: FloatArray = field(default_factory=lambda: np.zeros((3, 0)))
    attitude: FloatArray = field(default_factory=lambda: np.zeros((3, 0)))
    strength: FloatArray = field(default_factory=lambda: np.zeros(0))
    gyro_taps: FloatArray = field(default_factory=lambda: np.ones(1))
    accel_taps: FloatArray = field(default_factory=lambda: np.ones(1))
    start_s: float = 0.0
    between: Literal["held", "lines"] = "held"

    def __post_init__(self) -> None:
        outputs, rates = (read_only(values, np.float64, ndim=2) for values in (self.outputs, self.rates))
        samples = outputs.shape[1]
        strength = self.strength if self.strength.size else np.ones(samples)
        az, w, strength = (read_only(values, np.float64, ndim=1) for values in (self.az, self.w, strength))
        sizes = {"rates": rates.shape[1], "az": az.size, "w": w.size or samples, "strength": strength.size}
        motion = {
            name: read_only(getattr(self, name), np.float64, ndim=2) for name in ("force", "velocity", "attitude")
        }
        sizes |= {name: rows.shape[1] or samples for name, rows in motion.items()}
        for name, size in sizes.items():
            if size != samples:
                raise UsageError(f"{self.name} has {size} samples of {name} and {samples} of motor outputs")
        if not all(np.isfinite(values).all() for values in (outputs, rates, az, w, strength, *motion.values())):
            raise UsageError(f"{self.name} contains samples that are not finite", needed="records without gaps")
        gyro, accel = (read_only(taps, np.float64, ndim=1) for taps in (self.gyro_taps, self.accel_taps))
        self._set(
            outputs=outputs, rates=rates, az=az, w=w, strength=strength, gyro_taps=gyro, accel_taps=accel, **motion
        )

    @property
    def samples(self) -> int:
        return int(self.outputs.shape[1])

    @property
    def duration_s(self) -> float:
        return self.samples / self.sample_rate_hz

    @property
    def time_s(self) -> FloatArray:
        return self.start_s + np.arange(self.samples) / self.sample_rate_hz
