"""What a review could not measure, in words: a row for everything that has one reason."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType

from rotorid.data.display import listed
from rotorid.data.quantities import figure
from rotorid.reviewing.loops import LOOPS
from rotorid.reviewing.values import Unavailable

_LOOPS: Mapping[str, str] = MappingProxyType({loop.name: f"{loop.words} loop" for loop in LOOPS})

_PARTS: Mapping[str, str] = MappingProxyType(
    {
        "flight": "flight",
        "flight.battery": "battery",
        "flight.wind": "wind",
        "flight.modes": "flight modes",
        "logging": "logging",
        "logging.rates": "rates of the log",
        "loops": "loops",
        "margins": "margins",
        "models": "models",
        "motors": "motors",
        "motors.events": "motors that lose their step",
        "oscillations": "oscillation",
        "noise": "noise",
        "noise.maps": "noise maps",
        "noise.maps.before": "noise before the filters",
        "noise.maps.throttle": "noise against throttle",
        "noise.peaks": "lines in the noise",
        "step": "step response",
        "vehicle.kind": "kind of vehicle",
        "vehicle.frame": "frame",
    }
)
"""Parts of a review that are no figures."""


def unavailable_words(name: str) -> tuple[str, str]:
    """What a quantity that cannot be told is called: the thing itself, and which number of it, if one alone.

    Examples
    --------
    >>> unavailable_words("loops.p.rise_time_s"), unavailable_words("loops.p")
    (('roll rate loop', 'rise time'), ('roll rate loop', ''))
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
    """A thing with the numbers of it that are meant.

    Examples
    --------
    >>> of_numbers("roll rate loop", ["rise time", "peak"]), of_numbers("wind", [""])
    ('roll rate loop: rise time and peak', 'wind')
    """
    named = [number for number in numbers if number]
    return f"{thing}: {listed(named)}" if named else thing


_AXIS_WORDS = re.compile(r"\b(roll|pitch|yaw|p|q|r|phi|theta|psi)(_setpoint|_stick|_command)?\b")
"""What is said of one axis in the words of another: one row for both, with the words of each."""


def gathered(unavailable: Iterable[Unavailable]) -> tuple[Unavailable, ...]:
    """What cannot be told for one reason in one row: the numbers of a loop that a slow log hides, for instance.

    Examples
    --------
    >>> slow = [Unavailable(what=f"loops.p.{name}", why="It is too slow.") for name in ("rise_time_s", "peak_db")]
    >>> [one.what for one in gathered(slow)]
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
    alike: dict[tuple[str, str], list[Unavailable]] = {}
    for row in numbers:
        alike.setdefault((_AXIS_WORDS.sub("…", row.why), _AXIS_WORDS.sub("…", row.remedy)), []).append(row)
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
    'move the roll and pitch stick'
    """
    words = [[found.group() for found in _AXIS_WORDS.finditer(sentence)] for sentence in sentences]
    each = iter([listed(list(dict.fromkeys(same))) for same in zip(*words, strict=True)])
    return _AXIS_WORDS.sub(lambda _: next(each), sentences[0])
