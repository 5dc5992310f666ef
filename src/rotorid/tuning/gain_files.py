"""Reads files of gains: what an autopilot's tools write, or a line by hand. Nothing in them is guessed.

PX4's ``.params`` and lines for its shell, ArduPilot's ``.param``, Betaflight's ``diff``, ``dump`` and presets, lines
such as ``roll: P=0.12 I=0.2 D=0.003 A=6`` or ``climb: P=3``, in the firmware's own numbers. A file that is damaged,
names a value twice or mixes autopilots is refused with the line that is wrong.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace

from rotorid.autopilots.firmware import Version, version_of
from rotorid.autopilots.registry import named
from rotorid.data.base import Immutable
from rotorid.errors import UsageError
from rotorid.models.autopilots import ardupilot, betaflight, px4
from rotorid.models.autopilots.betaflight import as_in_header, is_other_program
from rotorid.models.autopilots.betaflight_settings import LOW_PASSES, command_line_name, header_name, is_type
from rotorid.models.autopilots.betaflight_sliders import MODES, sliders_applied
from rotorid.models.autopilots.outer import OUTER_LOOPS
from rotorid.typing import LoopName

LARGEST_BYTES = 2_000_000

_NAME = r"[A-Za-z][A-Za-z0-9_]{1,39}"
_TABLE = re.compile(rf"\d+\s+\d+\s+(?P<name>{_NAME})\s+(?P<value>\S+)\s+\d+")
_SHELL = re.compile(rf"param\s+set(?:-default)?\s+(?P<name>{_NAME})\s+(?P<value>\S+)")
_PAIR = re.compile(r"(?P<name>[A-Z][A-Za-z0-9_]{1,39})(?:\s*,\s*|\s+)(?P<value>[^\s,]+)(?:\s+@READONLY)?")
_SET = re.compile(r"set\s+(?P<name>\w{1,64})\s{0,40}=(?P<value>.*)", re.A)
_PROFILE = re.compile(r"profile\s+(?P<number>\d+)", re.A)
_BY_HAND = re.compile(
    rf"(?:(?P<axis>roll|pitch|yaw|{'|'.join(OUTER_LOOPS)})[\s:,]{{1,20}})?"
    r"(?P<gains>(?:[PIDA]\s{0,9}=\s{0,9}[^\s,;=]+[\s,;]*)+)",
    re.I | re.A,
)
_GAIN = re.compile(r"([PIDA])\s*=\s*([^\s,;=]+)", re.I)
_FIRMWARE = re.compile(
    r"#[\s#]{0,9}(?:version[\s#]{0,9})?(?P<name>(?:Betaflight|INAV|Cleanflight|EmuFlight)\b.*)", re.I
)

_PRESET = re.compile(
    r"#\$\s{0,9}(?P<key>[A-Z_ ]{1,40}?)\s{0,9}(?:\((?P<state>[A-Z ]{1,20})\)\s{0,9})?(?::(?P<text>.*))?", re.I
)
_DEEPEST, _MOST_LINES = 8, 100_000
"""Presets that include presets, and lines of all of them together."""

_OLD_ARDUPILOT = re.compile(r"(?:RATE|STB)_(?:RLL|PIT|YAW)_\w+")
"""Gains of ArduPilot before 3.4, whose controller was another one."""

_WORDS: Mapping[str, tuple[str, ...]] = {
    "iterm_relax": ("OFF", "RP", "RPY", "RP_INC", "RPY_INC"),
    "tpa_mode": ("PD", "D"),
    "simplified_pids_mode": MODES,
}
"""Words of Betaflight's command line for settings that its headers have as numbers."""

_FLAGS = {"ON": 1.0, "OFF": 0.0}


@dataclass(frozen=True, kw_only=True)
class GainFile(Immutable):
    """Gains and filters of a file, by the names of the log of its autopilot.

    Parameters
    ----------
    name
        Of the file.
    autopilot
        ``PX4``, ``ArduPilot`` or ``Betaflight``; empty for gains by hand.
    firmware
        As the file names it; empty where it does not.
    values
        Parameters by the names of a log: those of Betaflight by its header.
    written
        The same names to those of the file.
    by_hand
        Axis, or outer loop, to its gains ``P``, ``I``, ``D``, ``A``; an empty one for a line that names none.
    defaults_first
        Whether a file of Betaflight holds only what differs from its defaults.
    preset
        Whether it is a preset of Betaflight, which leaves as flown what it does not name.
    options
        Those of a preset that are checked in it, and count.
    profiles
        PID profiles of a file that selects none of them, by their numbers: the flown one counts.
    sliders
        Sliders of Betaflight (``simplified_...``) with which ``simplified_tuning apply`` computes the gains.
    after_sliders
        Values that were set after that.
    """

    name: str
    autopilot: str = ""
    firmware: str = ""
    values: Mapping[str, float] = field(default_factory=dict)
    written: Mapping[str, str] = field(default_factory=dict)
    by_hand: Mapping[LoopName | str, Mapping[str, float]] = field(default_factory=dict)
    defaults_first: bool = False
    preset: bool = False
    options: tuple[str, ...] = ()
    profiles: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    sliders: Mapping[str, float] | None = None
    after_sliders: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        self._set(
            values=self.values,
            profiles={number: dict(values) for number, values in self.profiles.items()},
            sliders=None if self.sliders is None else dict(self.sliders),
            written=self.written,
            by_hand={axis: dict(gains) for axis, gains in self.by_hand.items()},
        )

    def of(self, loop: LoopName) -> GainFile:
        """The same gains, where those of lines that name no axis are of a loop."""
        return replace(self, by_hand={loop if name == "" else name: gains for name, gains in self.by_hand.items()})

    def on(self, flown: Mapping[str, float], version: Version | None) -> tuple[GainFile, str]:
        """The gains that this file would leave on a vehicle, and a sentence on how it was read; empty if as it stands.

        Parameters
        ----------
        flown
            Parameters of the log: they show which profile flew, and hold the sliders that the file leaves out.
        version
            Of the firmware that flew.

        Raises
        ------
        UsageError
            None of several profiles flew, or a slider is not known.
        """
        read, words = self, []
        if self.options:
            words.append(f"its checked options count ({', '.join(self.options)})")
        if self.profiles:
            number = self._flown_profile(flown)
            read = replace(self, values={**self.values, **self.profiles[number]}, profiles={})
            words.append(f"it selects no PID profile, so profile {number} counts: it has the gains of the log")
        if self.sliders is not None and version is not None:
            read = read._with_sliders(flown, version)
            words.append("its sliders make the gains")
        return read, f"{self.name}: {'; '.join(words)}." if words else ""

    def _flown_profile(self, flown: Mapping[str, float]) -> str:
        """The number of the profile whose gains flew."""
        same = [
            number
            for number, values in self.profiles.items()
            if (gains := {name: value for name, value in values.items() if _AXIS_GAIN.fullmatch(name)})
            and all(flown.get(name) == value for name, value in gains.items())
        ]
        if len(same) != 1:
            raise UsageError(
                f"{self.name} contains {len(self.profiles)} PID profiles, selects none of them, and "
                f"{'none' if not same else 'more than one'} has the gains of the log",
                needed="one PID profile",
                remedy="keep one profile in the file, or end it with the line 'profile 0'",
            )
        return same[0]

    def _with_sliders(self, flown: Mapping[str, float], version: Version) -> GainFile:
        """With the gains and cutoffs that the firmware makes of the sliders."""
        sliders = {name: value for name, value in flown.items() if name.startswith(_SLIDER)} | dict(self.sliders or {})
        current = {command_line_name(name): value for name, value in {**flown, **self.values}.items()}
        made = sliders_applied(sliders, current, version)
        values, written = dict(self.values), dict(self.written)
        for name, value in made.items():
            key = _key(name)
            if key not in self.after_sliders:
                values[key], written[key] = value, name
        return replace(self, values=values, written=written, sliders=None)


_SLIDER = "simplified_"
_AXIS_GAIN = re.compile(r"(?:roll|pitch|yaw)PID_[PID]")


def read_gains(text: str, *, name: str, include: Callable[[str], str] | None = None) -> GainFile:
    r"""Gains of a file.

    Parameters
    ----------
    text
        Its content.
    name
        For messages.
    include
        Content of the presets that a preset names.

    Raises
    ------
    UsageError
        It is none of the formats, damaged, of another program, or contradicts itself.

    Examples
    --------
    >>> read_gains("ATC_RAT_RLL_P,0.117\nATC_RAT_RLL_D,0.0006\n", name="autotune.param").autopilot
    'ArduPilot'
    >>> dict(read_gains("roll: P=0.12 I=0.2 D=0.003", name="line.txt").by_hand)
    {'roll': {'P': 0.12, 'I': 0.2, 'D': 0.003}}
    """
    lines = [line.strip() for line in text.lstrip("\ufeff").splitlines()]
    if "\0" in text or not any(lines):
        raise UsageError(
            f"{name} contains no gains", needed="a .params, .param, diff, dump, or a line such as P=0.1 D=0.002"
        )
    if any(_SET.fullmatch(line) for line in lines):
        return _betaflight(lines, name, include)
    by_hand: dict[LoopName | str, dict[str, float]] = {}
    values: dict[str, float] = {}
    for number, line in enumerate(lines, 1):
        if not line or line.startswith(("#", "//")):
            continue
        where = f"line {number} of {name}"
        if hand := _BY_HAND.fullmatch(line):
            gains = by_hand.setdefault((hand["axis"] or "").lower(), {})
            for letter, value in _GAIN.findall(hand["gains"]):
                _put(gains, letter.upper(), _number(value, letter.upper(), where), where)
            continue
        found = _TABLE.fullmatch(line) or _SHELL.fullmatch(line) or _PAIR.fullmatch(line)
        if found is None:
            raise UsageError(
                f"{where} cannot be read: {line[:60]!r}",
                needed="NAME and a value",
                remedy="export the parameters again; the file may be cut off",
            )
        _put(values, found["name"], _number(found["value"], found["name"], where), where)
    if values and by_hand:
        raise UsageError(f"{name} mixes parameters and lines of gains", needed="one of them")
    if by_hand:
        return GainFile(name=name, by_hand=by_hand)
    return GainFile(
        name=name,
        autopilot=_autopilot_of(values, name),
        values=values,
        written={parameter: parameter for parameter in values},
    )


def _number(text: str, name: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise UsageError(f"{name} in {where} is {text!r}", needed="a number") from None
    # Digits of other scripts and underscores are numbers for Python alone.
    if not text.isascii() or "_" in text:
        raise UsageError(f"{name} in {where} is {text!r}", needed="a number in plain digits")
    if not math.isfinite(value):
        raise UsageError(f"{name} in {where} is {text}", needed="a finite number")
    return value


def _put(values: dict[str, float], name: str, value: float, where: str) -> None:
    if values.get(name, value) != value:
        raise UsageError(f"{where} gives {name} = {value:g}, and an earlier line {values[name]:g}", needed="one value")
    values[name] = value


def _autopilot_of(values: Mapping[str, float], name: str) -> str:
    """The autopilot with such parameters."""
    if old := next((each for each in values if _OLD_ARDUPILOT.fullmatch(each)), ""):
        raise UsageError(
            f"{name} is from ArduPilot before 3.4: {old}",
            needed="gains of the controller that flies, ATC_RAT_RLL_P and so on",
            remedy="export the parameters of the vehicle that will fly",
        )
    marks = {px4.NAME: ("MC_", "IMU_", "MPC_"), ardupilot.NAME: ("ATC_", "INS_", "MOT_", "PSC_")}
    found = [autopilot for autopilot, stems in marks.items() if any(each.startswith(stems) for each in values)]
    if len(found) == 1:
        return found[0]
    came = f"{name} mixes gains of {' and '.join(found)}" if found else f"{name} contains no gains of a multicopter"
    raise UsageError(came, needed="parameters of PX4, ArduPilot or Betaflight")


class _PresetLines:
    """The lines of a preset that count: its own, those of options that are checked, and of presets that it includes.

    Versions and options are those of the preset itself.
    """

    def __init__(self, name: str, include: Callable[[str], str] | None) -> None:
        self.name, self.include = name, include
        self.versions: list[str] = []
        self.options: list[str] = []
        self.found = False
        self._count = 0

    def of(self, lines: list[str], *, depth: int = 0) -> Iterator[tuple[int, str, bool]]:
        """Number of each line in the file, the line, and whether an included preset has it."""
        skipped = False
        for number, line in enumerate(lines, 1):
            self._count += 1
            if self._count > _MOST_LINES or depth > _DEEPEST:
                raise UsageError(f"{self.name} includes too many presets", needed="a preset that includes a few")
            entry = _PRESET.fullmatch(line)
            if entry is None:
                if not skipped:
                    yield number, line, depth > 0
                continue
            self.found = True
            key, text = entry["key"].upper(), (entry["text"] or "").strip()
            if key in ("OPTION BEGIN", "OPTION END"):
                skipped = key == "OPTION BEGIN" and (entry["state"] or "").upper() != "CHECKED"
                if key == "OPTION BEGIN" and not skipped and depth == 0:
                    self.options.append(text)
            elif key == "FIRMWARE_VERSION" and depth == 0:
                self.versions.append(text)
            elif key == "INCLUDE" and not skipped:
                yield from self.of(self._included(text, number), depth=depth + 1)

    def _included(self, text: str, number: int) -> list[str]:
        if self.include is None:
            raise UsageError(
                f"line {number} of {self.name} includes {text}, which is not there",
                needed="all lines of the preset",
                remedy="keep the preset in its folder of firmware-presets, or paste the lines that it includes",
            )
        return [line.strip() for line in self.include(text).splitlines()]


def _betaflight(lines: list[str], name: str, include: Callable[[str], str] | None) -> GainFile:
    """Settings of the command line; of several profiles those of the one that is selected at the end."""
    firmware, defaults_first, sliders, after = "", False, None, set[str]()
    shared: dict[str, tuple[float, str, str]] = {}
    moved: dict[str, float] = {}
    profiles: dict[str, dict[str, tuple[float, str, str]]] = {}
    place, selected, selections = shared, "", 0
    preset = _PresetLines(name, include)
    for number, line, included in preset.of(lines):
        where = f"line {number} of {name}" if not included else f"line {number} of what {name} includes"
        if called := _FIRMWARE.fullmatch(line):
            firmware = firmware or called["name"].strip()
        if profile := _PROFILE.fullmatch(line):
            selected, selections = profile["number"], selections + 1
            place = profiles.setdefault(selected, {})
            continue
        if line.startswith(("rateprofile", "# master")):
            # Rates have profiles of their own, and act outside of the loops.
            place = shared if line.startswith("#") else {}
        defaults_first |= line.startswith(("defaults", "# diff"))
        if line.startswith("simplified_tuning"):
            applied = line.split()[1:] == ["apply"]
            moved |= {} if applied else dict.fromkeys(_SWITCHES, 0.0)
            sliders, after = (dict(moved), set()) if applied else (sliders, after)
        if line.startswith("set ") or line == "set":
            entry = _SET.fullmatch(line)
            if entry is None:
                raise UsageError(f"{where} cannot be read: {line[:60]!r}", needed="set NAME = VALUE")
            value = _setting(entry["name"], entry["value"].strip(), where)
            if value is None:
                continue
            # Sliders alone change no gain: those that stand in the file count until they are applied.
            if entry["name"].startswith(_SLIDER):
                moved[entry["name"]] = value
                continue
            key = _key(entry["name"])
            if key in place and place[key][0] != value and not preset.found:
                raise UsageError(f"{where} gives {entry['name']} a second value", needed="one value")
            place[key] = (value, entry["name"], where)
            after.add(key)
    firmware = firmware or (f"Betaflight {', '.join(preset.versions)}" if preset.versions else "")
    if is_other_program(firmware) or (firmware and named(firmware).name != betaflight.NAME):
        raise UsageError(f"{name} is from {firmware.partition(' ')[0]}", needed="settings of Betaflight 4.0 or later")
    version = version_of(firmware.partition(")")[2] or firmware)
    if version is not None and version < betaflight.OLDEST:
        raise UsageError(
            f"{name} is from Betaflight {version[0]}.{version[1]}, whose gains have other units",
            needed="settings of Betaflight 4.0 or later",
        )
    unselected = len(profiles) > 1 and selections == len(profiles)
    chosen = shared if unselected else {**shared, **profiles.get(selected, {})}
    if moved and sliders is None and not any(is_gain_or_filter(written) for _, written, _ in chosen.values()):
        raise UsageError(
            f"{name} moves sliders and applies them to no gain",
            needed="gains, or the line 'simplified_tuning apply'",
            remedy="add that line if the sliders are to make the gains",
        )
    every = {**shared, **{key: entry for values in profiles.values() for key, entry in values.items()}}
    return GainFile(
        name=name,
        autopilot=betaflight.NAME,
        firmware=_named_firmware(firmware, version, preset),
        values={key: value for key, (value, _, _) in chosen.items()},
        written={key: written for key, (_, written, _) in (every if unselected else chosen).items()},
        defaults_first=defaults_first,
        preset=preset.found,
        options=tuple(preset.options),
        profiles={number: {key: value for key, (value, _, _) in values.items()} for number, values in profiles.items()}
        if unselected
        else {},
        sliders=sliders,
        after_sliders=frozenset(after) if sliders is not None else frozenset(),
    )


_SWITCHES = ("simplified_pids_mode", "simplified_dterm_filter", "simplified_gyro_filter")


def _named_firmware(firmware: str, version: Version | None, preset: _PresetLines) -> str:
    """A short name with its version; of a preset all versions that it is for."""
    if version is None:
        return ""
    return firmware if preset.versions else f"Betaflight {version[0]}.{version[1]}"


def _key(name: str) -> str:
    """The header's name of a setting of the command line."""
    return next(iter(as_in_header({name: 0.0})), header_name(name))


def _setting(name: str, text: str, where: str) -> float | None:
    """A setting as a number; ``None`` for words and lists, which no loop depends on."""
    word = text.upper()
    if is_type(name):
        if word in LOW_PASSES:
            return float(LOW_PASSES.index(word))
    elif name in _WORDS and word in _WORDS[name]:
        return float(_WORDS[name].index(word))
    elif word in _FLAGS:
        return _FLAGS[word]
    try:
        return _number(text, name, where)
    except UsageError:
        if is_gain_or_filter(name) or name.startswith(_SLIDER):
            raise
        return None


_LOOP = re.compile(
    r"[pidf]_(?:roll|pitch|yaw|level)|d_(?:min|max)_(?:roll|pitch|yaw)|angle_(?:p_gain|level_strength)|tpa_(?:rate|breakpoint|mode)|"
    r"(?:gyro|dterm)_\w{0,40}(?:hz|cutoff|type|expo)\w{0,20}|yaw_lowpass_hz|dyn_lpf_\w+|pid_process_denom|looptime|"
    r"thrust_linear"
)


def is_gain_or_filter(name: str) -> bool:
    """Whether a loop of Betaflight depends on a setting of its command line.

    Examples
    --------
    >>> is_gain_or_filter("p_roll"), is_gain_or_filter("gyro_lpf1_static_hz"), is_gain_or_filter("osd_units")
    (True, True, False)
    """
    return _LOOP.fullmatch(name) is not None
