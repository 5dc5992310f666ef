"""Choices as text: what the command line reads, and what a provenance holds, which reads back as the same choice."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rotorid.errors import UsageError
from rotorid.settings.option import Text
from rotorid.units import read_measure, read_measures, require_units, writable

if TYPE_CHECKING:
    from rotorid.data.record import Maneuver
    from rotorid.data.sensor_filters import SensorFilter
    from rotorid.settings.given_controllers import GivenController
    from rotorid.typing import Axis
    from rotorid.verification.sampled import LowPass


def parse_segment(text: str) -> "Maneuver":
    """Read ``AXIS:START:STOP``, seconds on the log's own clock.

    Examples
    --------
    >>> parse_segment("pitch:50:76").duration_s
    26.0
    """
    from rotorid.data.record import AXES, Maneuver

    parts = text.split(":")
    wanted = "AXIS:START:STOP in log seconds, such as roll:31.7:57.7"
    if len(parts) != 3 or parts[0] not in AXES:
        raise UsageError(f"the segment {text!r} cannot be read", needed=wanted)
    came = f"the segment {text!r} cannot be read"
    start_s, stop_s = read_measures(":".join(parts[1:]), "s", ":", came=came, needed=wanted)
    if not start_s < stop_s:
        raise UsageError(f"the segment {text!r} ends before it starts", needed=wanted)
    return Maneuver(axis=parts[0], kind="other", start_s=start_s, stop_s=stop_s, origin="given")  # type: ignore[arg-type]


def parse_segments(texts: Sequence[str]) -> "tuple[Maneuver, ...]":
    """Read ``AXIS:START:STOP`` once or more."""
    return tuple(parse_segment(text) for text in texts)


def write_segments(segments: "Iterable[Maneuver]") -> list[str]:
    """Segments as :func:`parse_segments` reads them."""
    return [f"{segment.axis}:{float(segment.start_s)!r}:{float(segment.stop_s)!r}" for segment in segments]


def parse_band(text: str) -> tuple[float, float]:
    """Read ``LO:HI`` in rad/s, or in the unit behind it.

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
    needed = "seconds with commas, such as 20,10,5"
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
            raise UsageError(f"windows of {name} are given twice", remedy="give each input once")
        windows[name] = parse_numbers(lengths)
    return windows


def write_input_windows(windows: Mapping[str, Sequence[float]]) -> list[str]:
    """Windows as :func:`parse_input_windows` reads them."""
    return [f"{name}:{','.join(repr(float(length)) for length in lengths)}" for name, lengths in windows.items()]


def parse_names(text: str) -> tuple[str, ...]:
    """Read ``CHANNEL,...``.

    Examples
    --------
    >>> parse_names("p, ay")
    ('p', 'ay')
    """
    return tuple(name.strip() for name in text.split(","))


def parse_channels(text: str, *, option: str) -> tuple[str, ...]:
    """Read ``CHANNEL,...``, each once.

    Examples
    --------
    >>> parse_channels("p, ay", option="--outputs")
    ('p', 'ay')
    """
    names = parse_names(text)
    if not all(names) or len(set(names)) < len(names):
        needed = "channel names, each once, with commas: roll_command,p"
        raise UsageError(f"{option} {text!r} is not a list of channels", needed=needed)
    return names


def parse_paths(texts: Sequence[str]) -> tuple[Path, ...]:
    """Read a path once or more."""
    return tuple(map(Path, texts))


def parse_listed(texts: Sequence[str]) -> tuple[str, ...]:
    """Read ``NAME,...`` once or more.

    Examples
    --------
    >>> parse_listed(("rate.roll, rate.pitch", "rate.yaw"))
    ('rate.roll', 'rate.pitch', 'rate.yaw')
    """
    return tuple(name for text in texts for name in parse_names(text))


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


def write_known(known: Mapping[str, tuple[float, float]]) -> list[str]:
    """Values and their standard deviations as :func:`parse_known` reads them."""
    return [f"{name}={float(value)!r}:{float(std)!r}" for name, (value, std) in known.items()]


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
            raise UsageError(f"{name} is given twice", remedy="give each name once")
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


def write_pairs(pairs: Mapping[str, tuple[float, float] | None]) -> list[str]:
    """Responses and their bands as :func:`parse_pairs` reads them."""
    return [name if band is None else f"{name}:{float(band[0])!r}:{float(band[1])!r}" for name, band in pairs.items()]


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
            raise UsageError(f"{name.strip()} has two shifts", remedy="add them up")
        shifts[name.strip()] = seconds
    return shifts


def write_shifts(shifts: Mapping[str, float]) -> list[str]:
    """Shifts as :func:`parse_shifts` reads them."""
    return [f"{name}:{float(seconds)!r}" for name, seconds in shifts.items()]


def parse_sensor_filters(texts: Sequence[str]) -> "dict[str, tuple[SensorFilter, ...]]":
    """Read ``CHANNEL=KIND:HZ`` once or more; each channel once, with commas between its filters.

    Examples
    --------
    >>> parse_sensor_filters(("az=lp:60", "q=lp:40@1000,delay:2ms"))["az"][0].frequency_hz
    60.0
    """
    from rotorid.data.sensor_filters import FORM, parse_filters

    found = {}
    for text in texts:
        name, equals, written = (part.strip() for part in text.partition("="))
        if not (name and equals and written):
            raise UsageError(f"--filter {text} cannot be read", needed=f"CHANNEL={FORM}")
        if name in found:
            raise UsageError(
                f"--filter gives {name} twice", remedy=f"give several filters with commas: {name}=lp:60,delay:2ms"
            )
        found[name] = parse_filters(written, of=f"--filter {text}")
    return found


def write_sensor_filters(filters: "Mapping[str, Sequence[SensorFilter]]") -> list[str]:
    """Filters as :func:`parse_sensor_filters` reads them."""
    return [f"{name}={','.join(given.text for given in chain)}" for name, chain in filters.items()]


def parse_low_pass(text: str) -> "LowPass":
    """Read a cutoff in rad/s or with its unit, ``auto`` or ``none``.

    Examples
    --------
    >>> parse_low_pass("20"), parse_low_pass("none")
    (20.0, None)
    """
    if text in ("auto", "none"):
        return None if text == "none" else "auto"
    return read_measure(
        text, "rad/s", came=f"the low-pass {text!r} cannot be read", needed="a cutoff in rad/s, auto or none"
    )


def parse_assignments(
    texts: Sequence[str], *, option: str, units: Mapping[str, str], otherwise: str | None = "1"
) -> dict[str, float]:
    """Read ``NAME=VALUE`` once or more.

    Parameters
    ----------
    texts
        What was written.
    option
        What an error names.
    units, otherwise
        What the answers are in: by name, and those of other names. None is written behind one that has no short name.
        Without ``otherwise`` they are each a :class:`~rotorid.units.Measure`, whose unit is looked at later.

    Examples
    --------
    >>> parse_assignments(["d=1500mm", "n=2"], option="--set", units={"d": "m"})
    {'d': 1.5, 'n': 2.0}
    """
    numbers: dict[str, float] = {}
    for text in texts:
        name, sign, value = (part.strip() for part in text.partition("="))
        came, known = f"{option} {text} cannot be read", units.get(name, otherwise)
        unit = None if known is None else writable(known)
        if not (name and sign):
            raise UsageError(came, needed="NAME=VALUE with a finite number")
        if name in numbers:
            raise UsageError(f"{option} {name} is given twice", remedy="give each name once")
        needed = "NAME=VALUE with a finite number" + ("" if unit in (None, "1") else f", {name} in {unit}")
        numbers[name] = read_measure(value, unit, came=came, needed=needed)
    return numbers


def parse_controllers(path: str) -> "Mapping[Axis, GivenController]":
    """Read the controllers of a TOML file."""
    from rotorid.settings.given_controllers import read_controllers

    return read_controllers(Path(path))


def write_controllers(controllers: "Mapping[Axis, GivenController]") -> list[str]:
    """Each axis and its controller."""
    return [f"{axis}: {given}" for axis, given in controllers.items()]


BAND = Text("LO:HI", parse_band)
SECONDS = Text("S,S,...", parse_numbers)
INPUT_WINDOWS = Text("INPUT:S,S,...", parse_input_windows, repeats=True, write=write_input_windows)
SEGMENTS = Text("AXIS:START:STOP", parse_segments, repeats=True, write=write_segments)
SHIFTS = Text("CHANNEL:SECONDS", parse_shifts, repeats=True, write=write_shifts)
FILTERS = Text("CHANNEL=KIND:HZ", parse_sensor_filters, repeats=True, write=write_sensor_filters)
NAMES = Text("NAME,...", parse_names)
LISTED = Text("NAME,...", parse_listed, repeats=True)
WORDS = Text("NAME", tuple, repeats=True)
PATHS = Text("<path>", parse_paths, repeats=True)
FIXED = Text("NAME=VALUE", parse_fix, repeats=True)
CONSTANTS = Text("NAME=VALUE", parse_constants, repeats=True)
KNOWN = Text("NAME=VALUE[:STD]", parse_known, repeats=True, write=write_known)
TIES = Text("NAME=EXPRESSION", parse_ties, repeats=True)
PAIRS = Text("OUTPUT/INPUT[:LO:HI]", parse_pairs, repeats=True, write=write_pairs)
WEIGHTS = Text("OUTPUT/INPUT=FACTOR", parse_weights, repeats=True)
LOW_PASS = Text("CUTOFF|auto|none", parse_low_pass)
CONTROLLERS = Text("<path>", parse_controllers, write=write_controllers)
