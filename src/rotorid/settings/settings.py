"""What a user may choose: each choice with its default, its check, and how it is written on the command line.

A verb takes its choices whole (``settings=``), or one by one as keywords (:func:`as_settings`); the command line makes
an option of every field that carries an :class:`Option`. Nothing here is heavy: ``rotorid --help`` reads it.
"""

import difflib
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, TypeVar, Union, get_args

from rotorid.data.base import Immutable
from rotorid.data.trust import least_coherence
from rotorid.errors import UsageError
from rotorid.io.documents import read_text
from rotorid.units import read_measure, read_measures, require_units, writable

if TYPE_CHECKING:
    from dataclasses import Field

    from _typeshed import DataclassInstance

    from rotorid.data.record import FlightRecord, Maneuver
    from rotorid.flights.given_controllers import GivenController
    from rotorid.models.motors import Curve
    from rotorid.models.rotors import RotorLayout
    from rotorid.typing import Axis
    from rotorid.verification.sampled import LowPass

Settings = TypeVar("Settings", bound="MeasureSettings | FlySettings")
Setting: TypeAlias = str | int | float | bool | list[str] | list[float] | None
"""A choice as a provenance holds it."""


@dataclass(frozen=True)
class Option:
    """How a field is written on the command line, in the metadata of its ``Annotated`` type.

    Parameters
    ----------
    name
        Such as ``--band``.
    help
        A line for ``--help``.
    parse
        Makes the value out of the text, or out of all texts where the option may be repeated. Without it the command
        line reads what the type of the field says.
    repeats
        Whether it may be given more than once.
    metavar
        What ``--help`` calls the text.
    heading
        Where ``--help`` lists it.
    words
        All that it takes, where there are few and the type does not list them.
    default
        Text that stands where nothing is given, for fields whose own default is no text.
    """

    name: str
    help: str
    parse: Callable[[Any], Any] | None = None
    repeats: bool = False
    metavar: str | None = None
    heading: str | None = None
    words: tuple[str, ...] = ()
    default: str | None = None


def option_of(item: "Field[Any]") -> Option | None:
    """How a field of settings is written on the command line; ``None`` where it is not."""
    return next((part for part in getattr(item.type, "__metadata__", ()) if isinstance(part, Option)), None)


def options_given(settings: "DataclassInstance") -> dict[str, str]:
    """Fields that differ from their defaults, with the options that set them.

    Examples
    --------
    >>> options_given(IdentifySettings(reduce=True, arm_m=0.2))
    {'reduce': '--reduce', 'arm_m': '--arm'}
    """
    usual = type(settings)()
    changed = [one for one in fields(settings) if getattr(settings, one.name) != getattr(usual, one.name)]
    return {one.name: option.name if (option := option_of(one)) is not None else one.name for one in changed}


def options_of(settings: "type[DataclassInstance]", names: Sequence[str]) -> tuple[str, ...]:
    """The options of some fields.

    Examples
    --------
    >>> options_of(IdentifySettings, ("fix", "arm_m"))
    ('--fix', '--arm')
    """
    found = {one.name: option.name for one in fields(settings) if (option := option_of(one)) is not None}
    return tuple(found[name] for name in names if name in found)


def parse_segment(text: str) -> "Maneuver":
    """Read ``AXIS:START:STOP``, seconds on the log's own clock.

    Examples
    --------
    >>> parse_segment("pitch:50:76").duration_s
    26.0
    """
    from rotorid.data.record import AXES, Maneuver

    parts = text.split(":")
    wanted = "AXIS:START:STOP with an axis of roll, pitch, yaw, thrust and seconds on the log's own clock"
    if len(parts) != 3 or parts[0] not in AXES:
        raise UsageError(f"the segment {text!r} cannot be read", needed=wanted)
    came = f"the segment {text!r} cannot be read"
    start_s, stop_s = read_measures(":".join(parts[1:]), "s", ":", came=came, needed=wanted)
    if not start_s < stop_s:
        raise UsageError(f"the segment {text!r} stops before it starts", needed=wanted)
    return Maneuver(axis=parts[0], kind="other", start_s=start_s, stop_s=stop_s, origin="given")  # type: ignore[arg-type]


def parse_segments(texts: Sequence[str]) -> "tuple[Maneuver, ...]":
    """Read ``AXIS:START:STOP`` once or more."""
    return tuple(parse_segment(text) for text in texts)


def parse_band(text: str) -> tuple[float, float]:
    """Read ``LO:HI`` in rad/s, or in the unit that stands behind.

    Examples
    --------
    >>> parse_band("8:80"), [round(edge, 3) for edge in parse_band("0.1:8Hz")]
    ((8.0, 80.0), [0.628, 50.265])
    """
    needed = "LO:HI in rad/s, such as 1:60, or in Hz, such as 0.2:10Hz"
    came = f"the band {text!r} cannot be read"
    edges = read_measures(text, "rad/s", ":", came=came, needed=needed)
    if len(edges) != 2:
        raise UsageError(came, needed=needed)
    return edges[0], edges[1]


def parse_numbers(text: str) -> tuple[float, ...]:
    """Read ``S,S,...``: seconds, or with their units.

    Examples
    --------
    >>> parse_numbers("20,10"), parse_numbers("1min,800ms")
    ((20.0, 10.0), (60.0, 0.8))
    """
    needed = "seconds with commas between them"
    return read_measures(text, "s", ",", came=f"the list {text!r} cannot be read", needed=needed)


def parse_input_windows(texts: Sequence[str]) -> dict[str, tuple[float, ...]]:
    """Read ``INPUT:S,S,...`` once or more; each input once.

    Examples
    --------
    >>> parse_input_windows(("roll_command:14,9,6", "yaw_command:9"))
    {'roll_command': (14.0, 9.0, 6.0), 'yaw_command': (9.0,)}
    """
    windows: dict[str, tuple[float, ...]] = {}
    for text in texts:
        name, colon, lengths = (part.strip() for part in text.partition(":"))
        if not (name and colon and lengths):
            needed = "INPUT:S,S,... such as roll_command:14,9,6"
            raise UsageError(f"the windows {text!r} cannot be read", needed=needed)
        if name in windows:
            raise UsageError(f"windows of {name} came twice", needed="each input once")
        windows[name] = parse_numbers(lengths)
    return windows


def parse_names(text: str) -> tuple[str, ...]:
    """Read ``CHANNEL,...``.

    Examples
    --------
    >>> parse_names("p, ay")
    ('p', 'ay')
    """
    return tuple(name.strip() for name in text.split(","))


def parse_fix(texts: Sequence[str]) -> dict[str, float]:
    """Read ``NAME=VALUE`` once or more; the model alone knows what is in which unit.

    Examples
    --------
    >>> parse_fix(("L_p=-2", "arm=20cm"))
    {'L_p': -2.0, 'arm': 0.2}
    """
    fixed = {}
    needed = "NAME=VALUE with a finite number, such as L_p=-2 or arm=20cm"
    for name, value in _assignments(texts, "NAME=VALUE, such as L_p=-2").items():
        fixed[name] = read_measure(value, came=f"{f'{name}={value}'!r} cannot be read", needed=needed)
    return fixed


_CONSTANTS = {"g": "m/s^2", "theta0": "rad", "phi0": "rad", "U0": "m/s", "W0": "m/s", "z_imu": "m"}


def parse_constants(texts: Sequence[str]) -> dict[str, float]:
    """Read ``NAME=VALUE`` of constants once or more.

    Examples
    --------
    >>> parse_constants(("U0=36km/h", "theta0=-0.1"))
    {'U0': 10.0, 'theta0': -0.1}
    """
    fixed = parse_fix(texts)
    require_units(fixed, _CONSTANTS, option="--constant")
    return fixed


def parse_weights(texts: Sequence[str]) -> dict[str, float]:
    """Read ``OUTPUT/INPUT=FACTOR`` once or more.

    Examples
    --------
    >>> parse_weights(("q/pitch_command=0.5",))
    {'q/pitch_command': 0.5}
    """
    wanted = "OUTPUT/INPUT=FACTOR, such as q/pitch_command=0.5"
    return {
        name: read_measure(value, "1", came=f"{f'{name}={value}'!r} cannot be read", needed=wanted)
        for name, value in _assignments(texts, wanted).items()
    }


def parse_known(texts: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Read ``NAME=VALUE`` or ``NAME=VALUE:STD`` once or more; a value without a standard deviation is exact.

    Examples
    --------
    >>> parse_known(("I_zz=0.012:0.0004", "k_n=100"))
    {'I_zz': (0.012, 0.0004), 'k_n': (100.0, 0.0)}
    """
    from rotorid.models.derived import KNOWN_UNITS

    wanted = "NAME=VALUE or NAME=VALUE:STD, such as I_zz=0.012:0.0004"
    known = {}
    for name, text in _assignments(texts, wanted).items():
        came = f"{f'{name}={text}'!r} cannot be read"
        numbers = read_measures(text, writable(KNOWN_UNITS.get(name, "1")), ":", came=came, needed=wanted)
        if len(numbers) > 2:
            raise UsageError(came, needed=wanted)
        known[name] = numbers[0], numbers[1] if len(numbers) > 1 else 0.0
    return known


def parse_ties(texts: Sequence[str]) -> dict[str, str]:
    """Read ``NAME=EXPRESSION`` once or more.

    Examples
    --------
    >>> parse_ties(("tau_pitch=tau_roll",))
    {'tau_pitch': 'tau_roll'}
    """
    return _assignments(texts, "NAME=EXPRESSION, such as tau_pitch=tau_roll")


def _assignments(texts: Sequence[str], wanted: str) -> dict[str, str]:
    found: dict[str, str] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise UsageError(f"{text!r} cannot be read", needed=wanted)
        if name in found:
            raise UsageError(f"{name} came twice", needed="each name once")
        found[name] = value
    return found


def parse_pairs(texts: Sequence[str]) -> dict[str, tuple[float, float] | None]:
    """Read ``OUTPUT/INPUT`` or ``OUTPUT/INPUT:LO:HI`` (rad/s) once or more.

    Examples
    --------
    >>> parse_pairs(("q/pitch_command:3:45", "az/thrust_command"))
    {'q/pitch_command': (3.0, 45.0), 'az/thrust_command': None}
    """
    pairs: dict[str, tuple[float, float] | None] = {}
    for text in texts:
        name, colon, band = text.partition(":")
        pairs[name.strip()] = parse_band(band) if colon else None
    return pairs


def parse_shifts(texts: Sequence[str]) -> dict[str, float]:
    """Read ``CHANNEL:SECONDS`` once or more; each channel once.

    Examples
    --------
    >>> parse_shifts(("q:0.0037", "roll_command:-0.004"))
    {'q': 0.0037, 'roll_command': -0.004}
    """
    shifts: dict[str, float] = {}
    for text in texts:
        name, _, value = text.rpartition(":")
        came, needed = f"the shift {text!r} cannot be read", "CHANNEL:SECONDS, such as q:0.0037"
        if not name.strip():
            raise UsageError(came, needed=needed)
        seconds = read_measure(value, "s", came=came, needed=needed)
        if name.strip() in shifts:
            raise UsageError(f"two shifts of {name.strip()} came", needed="one for each channel", remedy="add them up")
        shifts[name.strip()] = seconds
    return shifts


def parse_low_pass(text: str) -> "LowPass":
    """Read a cutoff in rad/s or with its unit, ``auto`` or ``none``.

    Examples
    --------
    >>> parse_low_pass("20"), parse_low_pass("none")
    (20.0, None)
    """
    if text in ("auto", "none"):
        return None if text == "none" else "auto"
    return read_measure(text, "rad/s", came=f"the low-pass {text!r} came", needed="a cutoff in rad/s, auto or none")


def _read_controllers(path: str) -> "Mapping[Axis, GivenController]":
    from rotorid.flights.given_controllers import read_controllers

    return read_controllers(Path(path))


def as_settings(kind: type[Settings], settings: Settings | None, options: Mapping[str, Any]) -> Settings:
    """Choices of a verb, given whole, one by one, or both; one by one goes before.

    Parameters
    ----------
    kind
        Their class.
    settings
        All of them; by default those of the class.
    options
        Fields by name.

    Raises
    ------
    TypeError
        There is no such field; the nearest name is suggested.
    UsageError
        A value cannot be.

    Examples
    --------
    >>> as_settings(ResponseSettings, None, {"band_rad_s": (1.0, 60.0)}).band_rad_s
    (1.0, 60.0)
    """
    known = [field.name for field in fields(kind)]
    for name in options:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise TypeError(f"there is no option {name!r}{hint}")
    chosen = settings or kind()
    return replace(chosen, **options) if options else chosen


def as_names(names: str | Iterable[str]) -> tuple[str, ...]:
    """Names of channels or parameters; a single one may come without a list around it.

    Examples
    --------
    >>> as_names("roll_command"), as_names(["p", "ay"])
    (('roll_command',), ('p', 'ay'))
    """
    return (names,) if isinstance(names, str) else tuple(names)


def as_records(
    records: "FlightRecord | str | Path | Iterable[FlightRecord | str | Path]",
) -> "tuple[FlightRecord, ...]":
    """Flight records; a path is read, and a single one may come without a list around it.

    Parameters
    ----------
    records
        Records as :func:`rotorid.read` gives them, files that it reads, or both.

    Raises
    ------
    LogError
        A file cannot be read.
    """
    from rotorid.data.record import FlightRecord
    from rotorid.io.registry import read

    several = (records,) if isinstance(records, str | Path | FlightRecord) else records
    return _told_apart([record if isinstance(record, FlightRecord) else read(record) for record in several])


def _told_apart(records: "Sequence[FlightRecord]") -> "tuple[FlightRecord, ...]":
    """Records whose names differ: several cards hold a ``00000012.BIN``, and findings and fits go by names.

    One that is given twice keeps its name, under which it is refused.
    """
    names = [record.source.name for record in records]
    contents = {(record.source.name, record.source.sha256 or id(record)) for record in records}
    several = {name for name in names if sum(one == name for one, _ in contents) > 1}
    return tuple(
        replace(record, source=replace(record.source, name=f"{name} ({1 + names[:place].count(name)})"))
        if name in several
        else record
        for place, (name, record) in enumerate(zip(names, records, strict=True))
    )


EVALUATIONS = 2000
"""Budget of a search unless another is asked for."""

_FEWEST_RUNS = 2


def require_search(search: str | None, evaluations: int | None, starts: str, runs: int | None = None) -> None:
    """Refuse searches that there are not, and options that need one.

    Parameters
    ----------
    search
        A name of :func:`rotorid.search.catalog.searches` with its options.
    evaluations
        Its budget, where one was asked for.
    starts
        The design of starts, ``default`` for none.
    runs
        How often it is repeated, where that was asked for.

    Raises
    ------
    UsageError
        There is no such search, or what came does not go together.
    """
    if search is None:
        if evaluations is not None:
            raise UsageError("--evaluations came without a search", needed="--search NAME beside it")
        if runs is not None:
            raise UsageError("--runs came without a search", needed="--search NAME beside it, such as genetic:15x50")
        return
    if runs is not None and runs < _FEWEST_RUNS:
        raise UsageError(f"{runs} runs of a search came", needed="two or more, and some hundred for a table")
    if starts != "default":
        raise UsageError("--search and --starts came", needed="one of them: a design of starts is a search too")
    if evaluations is not None and evaluations < 1:
        raise UsageError(f"a budget of {evaluations} evaluations came", needed="1 or more")
    from rotorid.search.catalog import search as known

    known(search)


def require_runs(runs: int | None) -> None:
    """Refuse a bootstrap of less than two runs.

    Raises
    ------
    UsageError
        There are fewer.
    """
    if runs is not None and runs < _FEWEST_RUNS:
        raise UsageError(f"a bootstrap of {runs} runs came", needed="two or more, and some hundred for intervals")


def pair_text(name: str, band_rad_s: tuple[float, float] | None) -> str:
    """A response and its band as :func:`parse_pairs` reads them."""
    return name if band_rad_s is None else f"{name}:{float(band_rad_s[0])!r}:{float(band_rad_s[1])!r}"


def require_seed(seed: int) -> None:
    """Refuse a seed that no generator takes.

    Raises
    ------
    UsageError
        It is negative.
    """
    if seed < 0:
        raise UsageError(f"the seed {seed} came", needed="zero or a positive whole number")


EstimateChoice: TypeAlias = Literal["auto", "direct", "joint"]

CompositionChoice: TypeAlias = Literal["variance", "least_squares", "weights"]
"""How windows of several lengths are joined: with the least variance, by least squares over spectra and coherence as
CIFER does, or as the weighted mean from which that starts."""

TaperChoice: TypeAlias = Literal["hann", "half_sine"]

OVERLAP = 0.8
"""Of neighboring windows, unless another one is asked for."""

LARGEST_OVERLAP = 0.95

LONGEST_WINDOW_S = 3600.0


@dataclass(frozen=True, kw_only=True)
class MeasureSettings(Immutable):
    """Choices about how responses are measured.

    Parameters
    ----------
    band_rad_s
        Band to look at; by default what was excited and is coherent.
    windows_s
        Window lengths; by default five by rule.
    input_windows_s
        Window lengths of the responses to one input, by input, in place of ``windows_s`` for it.
    composition
        How windows are joined: ``variance`` makes the stated error least, ``least_squares`` over spectra and coherence
        is CIFER's, ``weights`` the mean from which it starts.
    taper
        How windows fade: ``hann`` or ``half_sine``.
    overlap
        Share of a window that the next one covers too.
    coherence
        Least coherence of a point; by default 0.6 for a direct and 0.2 for a joint estimate.
    estimate
        ``auto`` takes the joint estimate whenever an instrument is logged.
    instruments
        Channels to use as instruments, one for each input, instead of the ones found.
    segments
        Intervals to use, instead of the excitations found.
    shifts
        Channel to seconds by which it is delayed before anything is estimated.
    seed
        For what is drawn at random; nothing is by default.
    correct_filters
        Take known filters of the autopilot off the outputs.
    """

    band_rad_s: Annotated[
        tuple[float, float] | None,
        Option(
            "--band",
            heading="Responses",
            metavar="LO:HI",
            help="In rad/s, or LO:HIHz. [default: what was excited]",
            parse=parse_band,
        ),
    ] = None
    windows_s: Annotated[
        tuple[float, ...],
        Option(
            "--windows", heading="Responses", metavar="S,S,...", help="Window lengths in seconds.", parse=parse_numbers
        ),
    ] = ()
    input_windows_s: Annotated[
        Mapping[str, tuple[float, ...]],
        Option(
            "--input-windows",
            heading="Responses",
            metavar="INPUT:S,S,...",
            help="Window lengths for the responses to one input. Repeatable.",
            parse=parse_input_windows,
            repeats=True,
        ),
    ] = field(default_factory=dict)
    composition: Annotated[
        CompositionChoice,
        Option("--composition", heading="Responses", help="How windows are joined; least_squares is CIFER's way."),
    ] = "variance"
    taper: Annotated[TaperChoice, Option("--taper", heading="Responses", help="How windows fade.")] = "hann"
    overlap: Annotated[
        float, Option("--overlap", heading="Responses", help="Share of a window that the next one covers too.")
    ] = OVERLAP
    coherence: Annotated[
        float | None,
        Option("--coherence", heading="Responses", help="Least coherence of a point. [default: 0.6 direct, 0.2 joint]"),
    ] = None
    estimate: Annotated[
        EstimateChoice,
        Option(
            "--estimate",
            heading="Responses",
            help="How responses are estimated: direct, or joint with an instrument; auto is joint where one is logged.",
        ),
    ] = "auto"
    instruments: Annotated[
        tuple[str, ...],
        Option(
            "--instrument",
            heading="Responses",
            metavar="CHANNEL,...",
            help="Channels to use as instruments, one for each input.",
            parse=parse_names,
        ),
    ] = ()
    segments: Annotated[
        "tuple[Maneuver, ...]",
        Option(
            "--segment",
            heading="Data",
            metavar="AXIS:START:STOP",
            help="A stretch to use instead of what is found, in log seconds. Repeatable.",
            parse=parse_segments,
            repeats=True,
        ),
    ] = ()
    shifts: Annotated[
        Mapping[str, float],
        Option(
            "--shift",
            heading="Data",
            metavar="CHANNEL:SECONDS",
            help="What to delay a channel by, where inspect finds its stamps wrong. Repeatable.",
            parse=parse_shifts,
            repeats=True,
        ),
    ] = field(default_factory=dict)
    seed: Annotated[int, Option("--seed", help="Seed of everything drawn at random.")] = 0
    correct_filters: bool = False

    def __post_init__(self) -> None:
        self._set(
            windows_s=tuple(self.windows_s),
            input_windows_s={name: tuple(lengths) for name, lengths in self.input_windows_s.items()},
            instruments=as_names(self.instruments),
            segments=tuple(self.segments),
            shifts=self.shifts,
        )
        if self.band_rad_s is not None and not 0.0 < self.band_rad_s[0] < self.band_rad_s[1] < math.inf:
            raise UsageError(f"the band {self.band_rad_s[0]:g}:{self.band_rad_s[1]:g} is empty", needed="0 < LO < HI")
        for name, lengths in self.input_windows_s.items():
            if not lengths:
                raise UsageError(f"no window of {name} came", needed="one length or more")
        for length in (*self.windows_s, *(one for lengths in self.input_windows_s.values() for one in lengths)):
            if not 0.0 < length <= LONGEST_WINDOW_S:
                needed = f"lengths above 0 and up to {LONGEST_WINDOW_S:g} s"
                raise UsageError(f"a window of {length:g} s came", needed=needed)
        for segment in self.segments:
            if not (math.isfinite(segment.start_s) and math.isfinite(segment.stop_s)):
                raise UsageError(
                    f"a segment from {segment.start_s:g} to {segment.stop_s:g} s came",
                    needed="seconds on the log's own clock, as rotorid inspect shows them",
                )
        for name, seconds in self.shifts.items():
            if not math.isfinite(seconds):
                raise UsageError(f"a shift of {name} by {seconds:g} s came", needed="a finite number of seconds")
        require_seed(self.seed)
        if self.coherence is not None and not 0.0 <= self.coherence < 1.0:
            raise UsageError(f"a coherence of {self.coherence:g} came", needed="a number from 0 to below 1")
        for what, given, kind in (
            ("estimate", self.estimate, EstimateChoice),
            ("composition", self.composition, CompositionChoice),
            ("taper", self.taper, TaperChoice),
        ):
            if given not in get_args(kind):
                raise UsageError(f"the {what} {given!r} came", needed=f"one of {', '.join(get_args(kind))}")
        if not 0.0 <= self.overlap <= LARGEST_OVERLAP:
            raise UsageError(f"an overlap of {self.overlap:g} came", needed=f"a share from 0 to {LARGEST_OVERLAP:g}")
        if self.estimate == "direct" and self.instruments:
            raise UsageError("a direct estimate takes no instrument", remedy="leave out --instrument or --estimate")

    def least_coherence(self, *, joint: bool) -> float:
        """The limit in force."""
        return least_coherence(self.coherence, joint=joint)

    def as_json(self) -> dict[str, Setting]:
        """The choices for the provenance of a result."""
        usual = MeasureSettings()
        # Told only where they were asked for, as most runs know nothing of them.
        asked: dict[str, Setting] = {
            name: getattr(self, name)
            for name in ("composition", "taper", "overlap")
            if getattr(self, name) != getattr(usual, name)
        }
        if self.input_windows_s:
            asked["input_windows_s"] = [
                f"{name}:{','.join(repr(float(one)) for one in lengths)}"
                for name, lengths in self.input_windows_s.items()
            ]
        return {
            "band_rad_s": list(self.band_rad_s) if self.band_rad_s else None,
            "windows_s": list(self.windows_s),
            "coherence": self.coherence,
            "estimate": self.estimate,
            "instruments": list(self.instruments),
            # All digits, so that the text gives the same run again.
            "segments": [f"{m.axis}:{float(m.start_s)!r}:{float(m.stop_s)!r}" for m in self.segments],
            "shifts": [f"{name}:{float(seconds)!r}" for name, seconds in self.shifts.items()],
            **asked,
        }


@dataclass(frozen=True, kw_only=True)
class ResponseSettings(MeasureSettings):
    """Choices of one run of ``response``.

    Parameters
    ----------
    band_rad_s, windows_s, input_windows_s, composition, taper, overlap
        As in :class:`MeasureSettings`.
    coherence, estimate, instruments, segments, shifts, seed
        As in :class:`MeasureSettings`.
    correct_filters
        Take known filters of the autopilot off the outputs, so that a response is that of the vehicle alone.
    correct_sensors
        Estimate scale, bias, misalignment and place of rate gyros and accelerometer by the kinematics, and take them
        out before anything is measured.
    """

    correct_filters: Annotated[
        bool, Option("--correct-filters", heading="Data", help="Take known filters of the autopilot off the outputs.")
    ] = False
    correct_sensors: Annotated[
        bool,
        Option(
            "--correct-sensors",
            heading="Data",
            help="Take scale, bias, misalignment and place of the sensors out, as attitude and velocity tell them.",
        ),
    ] = False

    def as_json(self) -> dict[str, Setting]:
        """The choices for the provenance of a result."""
        asked: dict[str, Setting] = {"correct_sensors": True} if self.correct_sensors else {}
        return super().as_json() | {"correct_filters": self.correct_filters} | asked


@dataclass(frozen=True, kw_only=True)
class VerifySettings(MeasureSettings):
    """Choices of one run of ``verify``.

    Parameters
    ----------
    band_rad_s, windows_s, input_windows_s, composition, taper, overlap
        As in :class:`MeasureSettings`; a band given here replaces that of the fit.
    coherence, estimate, instruments, segments, shifts, seed, correct_filters
        As in :class:`MeasureSettings`.
    scale
        Diameter of a full-scale rotor over the size of the vehicle, for the guideline of J_rms.
    vibration_filter
        Cutoff of the matched low-pass in rad/s, ``None`` for none, ``auto`` to decide by the data.
    controllers
        Controllers to fly the model under; by default those whose gains the logs hold.
    """

    seed: int = 0
    scale: Annotated[
        float | None,
        Option("--scale", heading="Judging", help="Full-scale rotor diameter over the size of the vehicle."),
    ] = None
    vibration_filter: Annotated[
        "LowPass",
        Option(
            "--low-pass",
            heading="Judging",
            metavar="CUTOFF|auto|none",
            help="First-order low-pass on measurement and prediction alike, in rad/s.",
            parse=parse_low_pass,
        ),
    ] = "auto"
    controllers: Annotated[
        "Mapping[Axis, GivenController]",
        Option(
            "--controller",
            heading="Judging",
            help="TOML file with the gains of each axis, to fly in closed loop.",
            parse=_read_controllers,
            metavar="<path>",
        ),
    ] = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set(controllers=self.controllers)
        if self.scale is not None and not 0.0 < self.scale < math.inf:
            raise UsageError(f"a scale of {self.scale:g} came", needed="a finite number above zero")

    def as_json(self) -> dict[str, Setting]:
        """The choices for the provenance of a result."""
        return super().as_json() | {
            "scale": self.scale,
            "vibration_filter": self.vibration_filter,
            "controllers": [f"{axis}: {given}" for axis, given in self.controllers.items()],
        }


WeightsChoice: TypeAlias = Literal["auto", "cifer", "covariance"]
SpeedDamping: TypeAlias = Literal["joint", "two_step"]
MethodChoice: TypeAlias = Literal[
    "auto", "frequency", "output_error", "prediction_error", "equation_error", "accelerations"
]
HoldChoice: TypeAlias = Literal["auto", "zero", "first"]


@dataclass(frozen=True, kw_only=True)
class FlySettings(Immutable):
    """Choices of one run of :func:`rotorid.flying.flown_models.fly_log`.

    Parameters
    ----------
    segments
        Intervals to fly in place of the longest flight of each log.
    pieces_s
        Seconds after which a simulation begins anew; by default whole flights where the model allows it.
    hold
        What inputs do between their samples, as in :class:`IdentifySettings`.
    seed
        Of the draws for the bands.

    Raises
    ------
    UsageError
        A number is out of range.
    """

    segments: "tuple[Maneuver, ...]" = ()
    pieces_s: float | None = None
    hold: HoldChoice = "auto"
    seed: int = 0

    def __post_init__(self) -> None:
        require_seed(self.seed)
        if self.pieces_s is not None and not 0.0 < self.pieces_s < math.inf:
            raise UsageError(f"pieces of {self.pieces_s:g} s came", needed="a finite length above zero")
        self._set(segments=tuple(self.segments))

    def as_json(self) -> dict[str, Setting]:
        """The choices for the provenance of a result."""
        return {
            "segments": [f"{m.axis}:{float(m.start_s)!r}:{float(m.stop_s)!r}" for m in self.segments],
            "pieces_s": self.pieces_s,
            "hold": self.hold,
            "seed": self.seed,
        }


_STARTS = re.compile(r"default|central|(sobol|random):[1-9]\d*")


@dataclass(frozen=True, kw_only=True)
class IdentifySettings(MeasureSettings):
    """Choices of one run of ``identify``.

    Parameters
    ----------
    band_rad_s, windows_s, input_windows_s, composition, taper, overlap
        As in :class:`MeasureSettings`.
    coherence, estimate, instruments, segments, shifts, seed
        As in :class:`MeasureSettings`.
    fix
        Parameters held at given values.
    known
        Value and standard deviation of what no log tells, such as an inertia or the speed of the rotors, from which
        more follows; see :mod:`rotorid.models.derived`.
    ties
        Parameters that follow others: name to an expression such as ``-L_p``.
    correct_filters
        Take known filters of the autopilot off the outputs, so that the model is that of the vehicle alone.
    correct_sensors
        Estimate scale, bias, misalignment and place of rate gyros and accelerometer by the kinematics, and take them
        out before anything is measured.
    free
        Parameters to free again that the model holds.
    constants
        Constants of the model, such as the trim ``theta0``, in place of what the record shows.
    outputs
        Outputs to fit; by default those that the log holds as sensors measured them.
    pairs
        Responses ``output/input`` to fit, each with its band or ``None``; by default all that are coherent.
    pair_weights
        Response to a factor on its cost.
    weights
        ``cifer`` minimizes CIFER's cost; ``covariance`` goes on from there with weights made of the measured covariance
        of all errors; ``auto`` does so where several outputs are fitted.
    reduce
        Drop step by step what the data do not show.
    speed_damping
        ``two_step`` takes X_u and Y_v from the responses of u_dot to theta and v_dot to phi before everything else.
    method
        ``frequency`` fits responses; ``output_error``, ``prediction_error`` and ``equation_error`` fit time histories;
        ``auto`` takes output error for responses to set-points and black boxes, and responses for all other models.
    hold
        What inputs do between their samples in a time-domain fit: ``zero`` order, ``first`` order, or ``auto``: zero
        for commands that stand in the log at the rate of the fit, first for all others.
    pieces_s
        Length of the pieces in which a time-domain fit begins anew; by default whole records for stable models.
    starts
        Where time-domain searches begin: ``default``, ``central`` (composite design), ``sobol:N`` or ``random:N``.
    search
        A global search before the fit, by its name in :func:`rotorid.search.catalog.searches` with its options.
    evaluations
        Its budget; by default 2000.
    runs
        How often the search is repeated from other seeds, to tell how far its answers lie apart.
    bootstrap
        Refits to noise drawn anew, beside the stated standard deviations.
    layout, arm_m, curve, rotor_diameter_m
        Of ``physical.motors``, as in :class:`MotorChoices`; all but ``curve`` of ``physical.hover`` too, which has its
        arm and the diameter of its propellers from them.
    """

    fix: Annotated[
        Mapping[str, float],
        Option(
            "--fix",
            heading="Models",
            metavar="NAME=VALUE",
            help="A parameter to hold. Repeatable.",
            parse=parse_fix,
            repeats=True,
        ),
    ] = field(default_factory=dict)
    known: Annotated[
        Mapping[str, tuple[float, float]],
        Option(
            "--known",
            heading="Models",
            metavar="NAME=VALUE[:STD]",
            help="What no log tells, such as I_zz=0.012:0.0004; motors, rotors and thrust follow with it. Repeatable.",
            parse=parse_known,
            repeats=True,
        ),
    ] = field(default_factory=dict)
    ties: Annotated[
        Mapping[str, str],
        Option(
            "--tie",
            heading="Models",
            metavar="NAME=EXPRESSION",
            help="A parameter that follows others. Repeatable.",
            parse=parse_ties,
            repeats=True,
        ),
    ] = field(default_factory=dict)
    correct_filters: Annotated[
        bool,
        Option(
            "--correct-filters",
            heading="Data",
            help="Take known filters of the autopilot off the outputs, out of the model.",
        ),
    ] = False
    correct_sensors: Annotated[
        bool,
        Option(
            "--correct-sensors",
            heading="Data",
            help="Take scale, bias, misalignment and place of the sensors out, as attitude and velocity tell them.",
        ),
    ] = False
    free: Annotated[
        tuple[str, ...],
        Option(
            "--free",
            heading="Models",
            metavar="NAME",
            help="A held parameter of the model, to be fitted. Repeatable.",
            parse=tuple,
            repeats=True,
        ),
    ] = ()
    constants: Annotated[
        Mapping[str, float],
        Option(
            "--constant",
            heading="Models",
            metavar="NAME=VALUE",
            help="A constant, such as the trim. Repeatable.",
            parse=parse_constants,
            repeats=True,
        ),
    ] = field(default_factory=dict)
    outputs: Annotated[
        tuple[str, ...],
        Option(
            "--outputs",
            heading="Models",
            metavar="CHANNEL,...",
            help="Channels to fit. [default: sensors]",
            parse=parse_names,
        ),
    ] = ()
    pairs: Annotated[
        Mapping[str, tuple[float, float] | None],
        Option(
            "--pair",
            heading="Models",
            metavar="OUTPUT/INPUT[:LO:HI]",
            help="A response to fit, and no others. Repeatable.",
            parse=parse_pairs,
            repeats=True,
        ),
    ] = field(default_factory=dict)
    pair_weights: Annotated[
        Mapping[str, float],
        Option(
            "--weight",
            heading="Models",
            metavar="OUTPUT/INPUT=FACTOR",
            help="A factor on the cost of a response. Repeatable.",
            parse=parse_weights,
            repeats=True,
        ),
    ] = field(default_factory=dict)
    weights: Annotated[
        WeightsChoice,
        Option(
            "--weights",
            heading="Models",
            help="How the cost weighs errors: covariance is that of all errors, auto goes by the number of outputs.",
        ),
    ] = "auto"
    reduce: Annotated[
        bool, Option("--reduce", heading="Models", help="Drop step by step what the data do not show.")
    ] = False
    speed_damping: Annotated[
        SpeedDamping, Option("--speed-damping", heading="Models", help="X_u and Y_v: with all else, or before it.")
    ] = "joint"
    method: Annotated[
        MethodChoice,
        Option(
            "--method",
            heading="Fit",
            help="How to fit; auto is output_error for response.* and black_box:N, and frequency for others. "
            "physical.motors has prediction_error or accelerations.",
        ),
    ] = "auto"
    hold: Annotated[
        HoldChoice,
        Option(
            "--hold", heading="Fit", help="Order of hold between samples, in time; auto is zero for logged commands."
        ),
    ] = "auto"
    pieces_s: Annotated[
        float | None,
        Option(
            "--pieces",
            heading="Fit",
            help="Seconds after which a fit in time begins anew. [default: as growing modes need]",
        ),
    ] = None
    starts: Annotated[
        str,
        Option(
            "--starts", heading="Fit", metavar="default|central|sobol:N|random:N", help="Where searches in time begin."
        ),
    ] = "default"
    search: Annotated[
        str | None,
        Option(
            "--search",
            heading="Fit",
            metavar="NAME[:OPTIONS]",
            help="A global search before the fit: evolution[:POPULATION] (when in doubt), cma[:POPULATION], "
            "genetic[:POPULATIONxGENERATIONS], kmeans[:CANDIDATES], sobol[:STARTS], random[:STARTS] or central. "
            "[default: none, the starts of the model]",
        ),
    ] = None
    evaluations: Annotated[
        int | None, Option("--evaluations", heading="Fit", help="Costs that --search may compute. [default: 2000]")
    ] = None
    runs: Annotated[
        int | None,
        Option("--runs", heading="Fit", help="Repeat --search from so many seeds: mean, spread, extremes."),
    ] = None
    bootstrap: Annotated[
        int | None,
        Option(
            "--bootstrap", heading="Fit", help="Refits to noise drawn anew, for spreads and intervals: 200 and more."
        ),
    ] = None
    layout: Annotated[
        str | None,
        Option(
            "--layout",
            heading="Models in physical parameters",
            metavar="NAME|FILE.toml",
            help="Of physical.*: quad.x, hexa.plus, ..., or a file of rotors. [default: as the log says]",
        ),
    ] = None
    arm_m: Annotated[
        float | None,
        Option(
            "--arm",
            heading="Models in physical parameters",
            help="Of physical.*: meters from the center of gravity to the farthest rotor.",
        ),
    ] = None
    curve: Annotated[
        "ChosenCurve",
        Option(
            "--curve",
            words=("auto", "linear", "quadratic", "affine", "polynomial"),
            heading="Models in physical parameters",
            help="Of physical.motors: thrust by output.",
        ),
    ] = "auto"
    rotor_diameter_m: Annotated[
        float | None,
        Option(
            "--rotor-diameter",
            heading="Models in physical parameters",
            help="In meters: checks the thrust of rotors whose speed is logged; D of physical.hover.",
        ),
    ] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        mappings = ("fix", "known", "ties", "constants", "pairs", "pair_weights")
        self._set(
            free=as_names(self.free), outputs=as_names(self.outputs), **{name: getattr(self, name) for name in mappings}
        )
        for what, given, kind in (
            ("weights", self.weights, WeightsChoice),
            ("speed damping", self.speed_damping, SpeedDamping),
            ("method", self.method, MethodChoice),
            ("hold", self.hold, HoldChoice),
        ):
            if given not in get_args(kind):
                raise UsageError(f"the {what} {given!r} came", needed=f"one of {', '.join(get_args(kind))}")
        for name in {*self.fix, *self.ties, *self.free}:
            if sum(name in group for group in (self.fix, self.ties, self.free)) > 1:
                raise UsageError(f"{name} is to be two things at once", needed="one of --fix, --tie and --free")
        if self.pieces_s is not None and not 0.0 < self.pieces_s < math.inf:
            raise UsageError(f"pieces of {self.pieces_s:g} s came", needed="a length above 0 s")
        if not _STARTS.fullmatch(self.starts):
            raise UsageError(f"the starts {self.starts!r} came", needed="default, central, sobol:N or random:N")
        require_search(self.search, self.evaluations, self.starts, self.runs)
        require_runs(self.bootstrap)

    def as_json(self) -> dict[str, Setting]:
        """The choices for the provenance of a result."""
        asked: dict[str, Setting] = {
            name: True for name in ("correct_filters", "correct_sensors") if getattr(self, name)
        }
        asked |= {"runs": self.runs} if self.runs is not None else {}
        if self.known:
            asked["known"] = [f"{name}={float(value)!r}:{float(std)!r}" for name, (value, std) in self.known.items()]
        return (
            super().as_json()
            | asked
            | {
                "fix": [f"{name}={float(value)!r}" for name, value in self.fix.items()],
                "ties": [f"{name}={text}" for name, text in self.ties.items()],
                "free": list(self.free),
                "constants": [f"{name}={float(value)!r}" for name, value in self.constants.items()],
                "outputs": list(self.outputs),
                "pairs": [pair_text(name, band) for name, band in self.pairs.items()],
                "pair_weights": [f"{name}={float(value)!r}" for name, value in self.pair_weights.items()],
                "weights": self.weights,
                "reduce": self.reduce,
                "speed_damping": self.speed_damping,
                "method": self.method,
                "hold": self.hold,
                "pieces_s": self.pieces_s,
                "starts": self.starts,
                "search": self.search,
                "evaluations": self.evaluations,
                "bootstrap": self.bootstrap,
            }
        )


ALL = "all"
"""In place of the names of models: every one of the library that the logs may support."""


def asks_all(models: object) -> bool:
    """Whether :data:`ALL` stands in place of names, alone or as the only one."""
    return models in (ALL, [ALL])


MotorMethod: TypeAlias = Literal["prediction_error", "accelerations"]

FROM_ANGLES = ("phi", "theta", "psi", "down")
"""Channels that are differentiated twice where gyros or accelerometer are missing, or where they are asked for."""

ChosenCurve: TypeAlias = Union[Literal["auto"], "Curve"]
"""``auto``: linear for demands of thrust, quadratic for speeds, and for outputs all that the flight can tell."""


@dataclass(frozen=True, kw_only=True)
class MotorChoices:
    """Choices of one run.

    Parameters
    ----------
    known
        Values that were measured otherwise, by parameter.
    layout
        Name of a layout or a TOML file of rotors; what the log says by default.
    arm_m
        Horizontal distance of the farthest rotor from the center of gravity.
    curve
        Thrust of a rotor by its output.
    rotor_diameter_m
        Of each rotor, to judge its figure of merit where speeds were measured.
    segments
        Stretches to use instead of the excitations that are found.
    voltage
        Whether thrust follows the voltage of the battery, where outputs of motors were logged.
    bootstrap
        Refits to noise drawn anew, beside the stated standard deviations.
    search
        A global search for a start, with its options, as ``genetic:15x50``.
    evaluations
        Its budget.
    runs
        How often it is repeated from other seeds.
    method
        ``prediction_error``, or ``accelerations``: the sum of absolute errors of accelerations.
    outputs
        Angles and height in place of gyros and accelerometer, for ``accelerations`` alone.
    seed
        Of what a bootstrap or a search draws.

    Raises
    ------
    UsageError
        A length is not positive, or there is no such curve or search.
    """

    known: Mapping[str, float] = field(default_factory=dict)
    layout: str | None = None
    arm_m: float | None = None
    curve: ChosenCurve = "auto"
    rotor_diameter_m: float | None = None
    segments: "tuple[Maneuver, ...]" = ()
    voltage: bool = True
    bootstrap: int | None = None
    search: str | None = None
    evaluations: int | None = None
    runs: int | None = None
    method: MotorMethod = "prediction_error"
    outputs: tuple[str, ...] = ()
    seed: int = 0

    def __post_init__(self) -> None:
        require_search(self.search, self.evaluations, "default", self.runs)
        if self.method not in get_args(MotorMethod):
            raise UsageError(
                f"the method {self.method!r} came with physical.motors", needed=" or ".join(get_args(MotorMethod))
            )
        if self.method == "accelerations" and self.bootstrap is not None:
            raise UsageError(
                "--bootstrap came with --method accelerations, which has none",
                needed="--runs N beside --search NAME, or --method prediction_error",
            )
        if self.outputs and (self.method != "accelerations" or not set(self.outputs) <= set(FROM_ANGLES)):
            raise UsageError(
                f"--outputs {','.join(self.outputs)} came with physical.motors",
                needed=f"--method accelerations and {','.join(FROM_ANGLES)}, or some of them, to be differentiated",
                remedy="leave --outputs out for gyros and accelerometer",
            )
        for name, length_m in (("an arm", self.arm_m), ("a rotor diameter", self.rotor_diameter_m)):
            if length_m is not None and not length_m > 0.0:
                raise UsageError(f"{name} of {length_m:g} m came", needed="a positive length")
        from rotorid.models.motors import CURVE_TERMS

        if self.curve not in ("auto", *CURVE_TERMS):
            near = difflib.get_close_matches(self.curve, ["auto", *CURVE_TERMS], n=1)
            raise UsageError(
                f"the curve {self.curve!r} came",
                needed=f"auto, {', '.join(CURVE_TERMS)}",
                remedy=f"did you mean {near[0]}?" if near else "",
            )

    def as_json(self) -> dict[str, Setting]:
        """The choices for a provenance."""
        choices: dict[str, Setting] = {
            "known": [f"{name}={value:g}" for name, value in self.known.items()],
            "layout": Path(self.layout).name if self.layout else None,
            "arm_m": self.arm_m,
            "curve": self.curve,
            "rotor_diameter_m": self.rotor_diameter_m,
            "segments": [f"{m.axis}:{m.start_s:g}:{m.stop_s:g}" for m in self.segments],
            "voltage": self.voltage,
        }
        # Told only where there is one, as the values do not depend on it.
        asked: dict[str, Setting] = {
            name: getattr(self, name) for name in ("bootstrap", "search", "evaluations", "runs")
        }
        asked["method"] = self.method if self.method != "prediction_error" else None
        asked["outputs"] = list(self.outputs) or None
        return choices | {name: value for name, value in asked.items() if value is not None}


def motor_choices(settings: IdentifySettings) -> MotorChoices:
    """What of the choices of a run is about ``physical.motors``.

    Raises
    ------
    UsageError
        A choice is impossible.
    """
    return MotorChoices(
        known=settings.fix,
        layout=settings.layout,
        arm_m=settings.arm_m,
        curve=settings.curve,
        rotor_diameter_m=settings.rotor_diameter_m,
        segments=settings.segments,
        seed=settings.seed,
        bootstrap=settings.bootstrap,
        search=settings.search,
        evaluations=settings.evaluations,
        runs=settings.runs,
        method="accelerations" if settings.method == "accelerations" else "prediction_error",
        outputs=settings.outputs,
    )


def chosen_layout(text: str) -> "RotorLayout":
    """A layout of the library by its name, or that of a TOML file.

    Raises
    ------
    UsageError
        There is neither; the nearest name is suggested.
    ModelError
        The file does not describe rotors.
    """
    from rotorid.models.rotors import layout_from_toml, layout_names, library_layout

    if text in layout_names():
        return library_layout(text)
    path = Path(text)
    if path.suffix != ".toml":
        near = difflib.get_close_matches(text, layout_names(), n=1)
        raise UsageError(
            f"there is no layout {text!r}",
            needed=f"a TOML file, or one of {', '.join(layout_names())}",
            remedy=f"did you mean {near[0]}?" if near else "",
        )
    return layout_from_toml(read_text(path, needed="a TOML file of [[rotor]] tables"), where=path.name)
