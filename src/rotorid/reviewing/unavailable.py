"""What was not measured, in words: a row for everything that has one reason."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType

from rotorid.data.display import listed
from rotorid.data.quantities import figure
from rotorid.reviewing.loops import LOOPS
from rotorid.reviewing.values import Unavailable

_LOOPS: Mapping[str, str] = MappingProxyType({loop.name: f"{loop.words} loop" for loop in LOOPS})

_TRACKED: Mapping[str, str] = MappingProxyType({loop.name: f"{loop.words} against its set-point" for loop in LOOPS})

_PARTS: Mapping[str, str] = MappingProxyType(
    {
        "channels": "agreement of channels",
        "control": "control",
        "flight": "flight",
        "flight.battery": "battery",
        "flight.drag": "drag",
        "flight.wind": "wind",
        "flight.yaw": "yaw drift",
        "flight.modes": "flight modes",
        "logging": "logging",
        "logging.rates": "rates of the log",
        "loops": "loops",
        "margins": "margins",
        "models": "models",
        "motors": "motors",
        "motors.events": "desync",
        "motors.rotor_order": "motor numbering",
        "motors.stamps": "motor time stamps",
        "oscillations": "oscillation",
        "noise": "noise",
        "noise.maps": "noise maps",
        "noise.maps.before": "noise before the filters",
        "noise.maps.throttle": "noise over throttle",
        "noise.peaks": "lines in the noise",
        "step": "step response",
        "tracking": "tracking of set-points",
        "vehicle.kind": "kind of vehicle",
        "vehicle.frame": "frame",
    }
)
"""Parts of a review that are not numbers."""


def unavailable_words(name: str) -> tuple[str, str]:
    """Name of a quantity that was not measured: the thing itself, and its number, if it is one alone.

    Examples
    --------
    >>> unavailable_words("loops.p.rise_time_s"), unavailable_words("loops.p")
    (('roll rate loop', 'rise time'), ('roll rate loop', ''))
    >>> unavailable_words("tracking.phi"), unavailable_words("page.noise")
    (('roll angle against its set-point', ''), ('pictures of noise', ''))
    >>> unavailable_words("margins.yaw.gain_margin_db"), unavailable_words("models.physical.motors")
    (('margins of yaw', 'gain margin'), ('model physical.motors', ''))
    >>> unavailable_words("noise.roll_p_noise_share")
    ('noise through P of roll', '')
    """
    if name in _PARTS:
        return _PARTS[name], ""
    part, _, rest = name.partition(".")
    if part == "models":
        return f"model {rest}", ""
    which, _, number = rest.partition(".")
    if part == "loops" and which in _LOOPS:
        return _LOOPS[which], _number_words(number)
    if part == "tracking" and which in _TRACKED:
        return _TRACKED[which], _number_words(number)
    if part == "page":
        return f"pictures of {rest}", ""
    if part == "oscillations":
        return f"oscillation of {which}", ""
    if part == "margins":
        return f"margins of {which}", _number_words(number)
    row = figure(name.rpartition(".")[2])
    return name.replace(".", " ").replace("_", " ") if row is None else row.words, ""


def _number_words(name: str) -> str:
    row = figure(name)
    return _PARTS.get(name, name) if row is None else row.words


def of_numbers(thing: str, numbers: list[str]) -> str:
    """A thing with its numbers.

    Examples
    --------
    >>> of_numbers("roll rate loop", ["rise time", "peak"]), of_numbers("wind", [""])
    ('roll rate loop: rise time and peak', 'wind')
    """
    named = [number for number in numbers if number]
    return f"{thing}: {listed(named)}" if named else thing


_AXIS_WORDS = re.compile(r"\b(?:cmd_)?(roll|pitch|yaw|thrust|p|q|r|phi|theta|psi)(_setpoint|_stick|_command|Rate)?\b")
"""Words of an axis. Rows that differ in these alone become one row that lists them."""

_AXES = {"p": "roll", "phi": "roll", "q": "pitch", "theta": "pitch", "r": "yaw", "psi": "yaw"}


def gathered(unavailable: Iterable[Unavailable]) -> tuple[Unavailable, ...]:
    """One row for all that has one reason, such as the numbers of a loop that a slow log hides.

    Examples
    --------
    >>> slow = [Unavailable(what=f"loops.p.{name}", why="It is too slow.") for name in ("rise_time_s", "peak_db")]
    >>> [row.what for row in gathered(slow)]
    ['roll rate loop: rise time and resonance peak']
    """
    rows: dict[tuple[str, str, str], list[str]] = {}
    for gap in unavailable:
        thing, number = unavailable_words(gap.what)
        rows.setdefault((thing, gap.why, gap.remedy), []).append(number)
    numbers = [
        Unavailable(what=of_numbers(thing, labels), why=why, remedy=remedy)
        for (thing, why, remedy), labels in rows.items()
    ]
    return merged_axes(numbers)


def merged_axes(rows: Iterable[Unavailable]) -> tuple[Unavailable, ...]:
    """One row for those that differ in their axes alone; each of these rows is about a single axis.

    Examples
    --------
    >>> idle = [Unavailable(what=f"rate.{axis}", why=f"The {axis} stick did not move.") for axis in ("roll", "yaw")]
    >>> [(row.what, row.why) for row in merged_axes(idle)]
    [('rate.roll; rate.yaw', 'The roll and yaw sticks did not move.')]
    """
    alike: dict[tuple[str, str], list[Unavailable]] = {}
    for row in rows:
        several = len({_AXES.get(found[1], found[1]) for found in _AXIS_WORDS.finditer(f"{row.why} {row.remedy}")}) > 1
        words = (row.why, row.remedy) if several else (_AXIS_WORDS.sub("…", row.why), _AXIS_WORDS.sub("…", row.remedy))
        alike.setdefault(words, []).append(row)
    return tuple(
        Unavailable(
            what="; ".join(row.what for row in same),
            why=_of_all_axes([row.why for row in same]),
            remedy=_of_all_axes([row.remedy for row in same]),
        )
        for same in alike.values()
    )


def _of_all_axes(sentences: Sequence[str]) -> str:
    """Sentences that differ in their axes as one that lists them.

    Examples
    --------
    >>> _of_all_axes(["move the roll stick", "move the pitch stick", "move the roll stick"])
    'move the roll and pitch sticks'
    >>> _of_all_axes(["the pitch stick does not move", "the yaw stick does not move"])
    'the pitch and yaw sticks do not move'
    """
    words = [[found.group() for found in _AXIS_WORDS.finditer(sentence)] for sentence in sentences]
    each = iter([listed(list(dict.fromkeys(same))) for same in zip(*words, strict=True)])
    merged = _AXIS_WORDS.sub(lambda _: next(each), sentences[0])
    return re.sub(r"( and \w+ stick)\b", r"\1s", merged).replace("sticks does not", "sticks do not")
