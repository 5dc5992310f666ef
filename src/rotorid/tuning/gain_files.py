"""Reads files of gains: what an autopilot's tools write, or a line by hand. Nothing in them is guessed.

PX4's ``.params`` and lines for its shell, ArduPilot's ``.param``, Betaflight's ``diff`` and ``dump``, and lines such as
``roll: P=0.12 I=0.2 D=0.003 A=6``, in the firmware's own numbers. A file that is damaged, names a value twice or mixes
autopilots is refused with the line that is wrong.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from rotorid.autopilots.registry import named
from rotorid.data.base import Immutable
from rotorid.errors import UsageError
from rotorid.models.autopilots import ardupilot, betaflight, px4
from rotorid.models.autopilots.betaflight import as_in_header, is_other_program
from rotorid.models.autopilots.betaflight_settings import LOW_PASSES, header_name, is_type
from rotorid.models.autopilots.settings import version_of
from rotorid.typing import Axis

LARGEST_BYTES = 2_000_000

_NAME = r"[A-Za-z][A-Za-z0-9_]{1,39}"
_TABLE = re.compile(rf"\d+\s+\d+\s+(?P<name>{_NAME})\s+(?P<value>\S+)\s+\d+")
_SHELL = re.compile(rf"param\s+set(?:-default)?\s+(?P<name>{_NAME})\s+(?P<value>\S+)")
_PAIR = re.compile(r"(?P<name>[A-Z]\w{1,39})(?:\s*,\s*|\s+)(?P<value>[^\s,]+)(?:\s+@READONLY)?")
_SET = re.compile(r"set\s+(?P<name>\w{1,64})\s{0,40}=(?P<value>.*)")
_PROFILE = re.compile(r"profile\s+(?P<number>\d+)")
_BY_HAND = re.compile(
    r"(?:(?P<axis>roll|pitch|yaw)[\s:,]{1,20})?(?P<gains>(?:[PIDA]\s{0,9}=\s{0,9}[^\s,;=]+[\s,;]*)+)", re.I
)
_GAIN = re.compile(r"([PIDA])\s*=\s*([^\s,;=]+)", re.I)
_FIRMWARE = re.compile(
    r"#[\s#]{0,9}(?:version[\s#]{0,9})?(?P<name>(?:Betaflight|INAV|Cleanflight|EmuFlight)\b.*)", re.I
)

_OLD_ARDUPILOT = re.compile(r"(?:RATE|STB)_(?:RLL|PIT|YAW)_\w+")
"""Gains of ArduPilot before 3.4, whose controller was another one."""

_WORDS: Mapping[str, tuple[str, ...]] = {
    "iterm_relax": ("OFF", "RP", "RPY", "RP_INC", "RPY_INC"),
    "tpa_mode": ("PD", "D"),
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
        Axis to its gains ``P``, ``I``, ``D``, ``A``; an empty axis for a line that names none.
    defaults_first
        Whether a file of Betaflight holds only what differs from its defaults.
    """

    name: str
    autopilot: str = ""
    firmware: str = ""
    values: Mapping[str, float] = field(default_factory=dict)
    written: Mapping[str, str] = field(default_factory=dict)
    by_hand: Mapping[Axis | str, Mapping[str, float]] = field(default_factory=dict)
    defaults_first: bool = False

    def __post_init__(self) -> None:
        self._set(
            values=self.values,
            written=self.written,
            by_hand={axis: dict(gains) for axis, gains in self.by_hand.items()},
        )


def read_gains(text: str, *, name: str) -> GainFile:
    r"""Gains of a file.

    Parameters
    ----------
    text
        Its content.
    name
        For messages.

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
        return _betaflight(lines, name)
    by_hand: dict[Axis | str, dict[str, float]] = {}
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


def _betaflight(lines: list[str], name: str) -> GainFile:
    """Settings of the command line; of several profiles those of the one that is selected at the end."""
    firmware, defaults_first = "", False
    shared: dict[str, tuple[float, str, str]] = {}
    profiles: dict[str, dict[str, tuple[float, str, str]]] = {}
    place, selected, selections = shared, "", 0
    for number, line in enumerate(lines, 1):
        where = f"line {number} of {name}"
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
        if line.startswith("set ") or line == "set":
            entry = _SET.fullmatch(line)
            if entry is None:
                raise UsageError(f"{where} cannot be read: {line[:60]!r}", needed="set NAME = VALUE")
            value = _setting(entry["name"], entry["value"].strip(), where)
            # Sliders have made the gains that stand in the file.
            if value is None or entry["name"].startswith("simplified_"):
                continue
            key = next(iter(as_in_header({entry["name"]: 0.0})), header_name(entry["name"]))
            if key in place and place[key][0] != value:
                raise UsageError(f"{where} gives {entry['name']} a second value", needed="one value")
            place[key] = (value, entry["name"], where)
    if len(profiles) > 1 and selections == len(profiles):
        raise UsageError(
            f"{name} contains {len(profiles)} PID profiles and selects none of them",
            needed="one PID profile",
            remedy="keep one profile in the file, or end it with the line 'profile 0'",
        )
    if is_other_program(firmware) or (firmware and named(firmware).name != betaflight.NAME):
        raise UsageError(f"{name} is from {firmware.partition(' ')[0]}", needed="settings of Betaflight 4.0 or later")
    version = version_of(firmware.partition(")")[2] or firmware)
    if version is not None and version < betaflight.OLDEST:
        raise UsageError(
            f"{name} is from Betaflight {version[0]}.{version[1]}, whose gains have other units",
            needed="settings of Betaflight 4.0 or later",
        )
    chosen = {**shared, **profiles.get(selected, {})}
    return GainFile(
        name=name,
        autopilot=betaflight.NAME,
        firmware=f"Betaflight {version[0]}.{version[1]}" if version else "",
        values={key: value for key, (value, _, _) in chosen.items()},
        written={key: written for key, (_, written, _) in chosen.items()},
        defaults_first=defaults_first,
    )


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
        if is_gain_or_filter(name):
            raise
        return None


_LOOP = re.compile(
    r"[pidf]_(?:roll|pitch|yaw|level)|d_(?:min|max)_(?:roll|pitch|yaw)|angle_(?:p_gain|level_strength)|tpa_(?:rate|breakpoint|mode)|"
    r"(?:gyro|dterm)_\w*(?:hz|cutoff|type|expo)\w*|yaw_lowpass_hz|dyn_lpf_\w+|pid_process_denom|looptime|thrust_linear"
)


def is_gain_or_filter(name: str) -> bool:
    """Whether a loop of Betaflight depends on a setting of its command line.

    Examples
    --------
    >>> is_gain_or_filter("p_roll"), is_gain_or_filter("gyro_lpf1_static_hz"), is_gain_or_filter("osd_units")
    (True, True, False)
    """
    return _LOOP.fullmatch(name) is not None
