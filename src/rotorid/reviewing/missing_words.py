"""What was not measured, in words: a row for everything that has one reason."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from rotorid.data.display import listed
from rotorid.data.quantities import figure
from rotorid.reviewing.loops import LOOPS
from rotorid.reviewing.missing import Unavailable, merged_axes

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
