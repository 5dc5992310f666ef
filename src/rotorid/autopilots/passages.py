"""Which filters stand between the motion and a logged channel, as far as the parameters in a log say it.

A chain is known as far as the log carries its parameters. Not in any log, and not here: the sensor's own analog and
hardware filters, and the time between a sample and its stamp. The chains of each autopilot stand in its room.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial

from rotorid.autopilots.filters import KnownFilter, butterworth_low_pass
from rotorid.autopilots.numbers import Parameters
from rotorid.errors import UsageError

Build = Callable[[tuple[float, ...], float], KnownFilter]

NARROWEST = 1e-5
"""Bandwidth over center of a notch below which it is none in single precision."""

UNKNOWN = "it is not known which filters it has passed"


@dataclass(frozen=True, kw_only=True, slots=True)
class Passage:
    """Filters that a channel has passed.

    Parameters
    ----------
    doubts
        Why these are not, or perhaps not, all; each the rest of a sentence.
    """

    filters: tuple[KnownFilter, ...] = ()
    doubts: tuple[str, ...] = ()


def doubtful(doubt: str) -> Passage:
    """A passage of which only this is known."""
    return Passage(doubts=(doubt,))


def moving(setting: str, value: float) -> Passage:
    """A filter that follows the motors or a spectrum: no response that is constant in time undoes it."""
    return doubtful(f"a filter that moves in flight is on ({setting} = {value:g}); what it took cannot be given back")


def built(settings: str, make: Callable[[], KnownFilter]) -> Passage:
    """The filter that settings of a log ask for, or that they ask for none that can be."""
    try:
        return Passage(filters=(make(),))
    except UsageError as error:
        return doubtful(f"{settings} makes no filter: {error.came}")


def joined(passages: Iterable[Passage]) -> Passage:
    """One passage behind the other.

    Examples
    --------
    >>> joined([doubtful("a"), Passage(), doubtful("b")]).doubts
    ('a', 'b')
    """
    parts = tuple(passages)
    return Passage(
        filters=tuple(known for part in parts for known in part.filters),
        doubts=tuple(doubt for part in parts for doubt in part.doubts),
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class Stage:
    """One filter of a chain.

    Parameters
    ----------
    names
        Its parameters; the filter is off where the first is zero.
    build
        Makes it from their values and the rate.
    needed
        Whether a log without the parameters leaves the chain unknown. A notch that the firmware did not have yet is
        none.
    """

    names: tuple[str, ...]
    build: Build
    needed: bool = False


@dataclass(frozen=True, kw_only=True, slots=True)
class Chain:
    """What a source of a log has passed.

    Parameters
    ----------
    source
        Pattern of :attr:`rotorid.data.record.Channel.source`, matched from end to end.
    stages
        Filters with constant parameters.
    moving
        Parameters that switch on a filter which follows the motors' speed or a spectrum.
    nonlinear
        Parameters that, when positive, put something between channel and motor that is no linear filter.
    also
        Filters that take more than a row of parameters, from these and the rate.
    """

    source: str
    stages: tuple[Stage, ...] = ()
    also: Callable[[Parameters, float], Passage] | None = None
    moving: tuple[str, ...] = ()
    nonlinear: tuple[str, ...] = ()


def second_order(values: tuple[float, ...], rate_hz: float) -> KnownFilter:
    """A low-pass of second order from its cutoff."""
    return butterworth_low_pass(values[0], rate_hz)


def stage(names: str, build: Build, *, needed: bool = False) -> Stage:
    """A filter by the names of its parameters in one text."""
    return Stage(names=tuple(names.split()), build=build, needed=needed)


def through(chains: Sequence[Chain], source: str, parameters: Parameters, rate_hz: float) -> Passage:
    """What a source has passed by the chains of its autopilot.

    Parameters
    ----------
    chains
        Of the autopilot; the first that knows the source counts.
    source
        Of the channel.
    parameters
        Of the log.
    rate_hz
        Of the filters.
    """
    chain = next((chain for chain in chains if re.fullmatch(chain.source, source)), None)
    if chain is None:
        return doubtful(UNKNOWN)
    active = [f"{name} = {parameters[name]:g}" for name in chain.nonlinear if parameters.get(name, 0.0) > 0.0]
    return joined(
        (
            *(_built(stage, parameters, rate_hz) for stage in chain.stages),
            *([chain.also(parameters, rate_hz)] if chain.also else []),
            *(moving(name, parameters[name]) for name in chain.moving if parameters.get(name, 0.0) != 0.0),
            *([doubtful(f"what follows it is not linear ({', '.join(active)})")] if active else []),
        )
    )


def _built(stage: Stage, parameters: Parameters, rate_hz: float) -> Passage:
    missing = [name for name in stage.names if name not in parameters]
    if missing:
        return doubtful(f"the log does not carry {', '.join(missing)}") if stage.needed else Passage()
    values = tuple(parameters[name] for name in stage.names)
    # What is no number is not off: no filter can be made of it.
    if values[0] <= 0.0:
        return Passage()
    setting_words = ", ".join(f"{name} = {parameters[name]:g}" for name in stage.names)
    return built(setting_words, partial(stage.build, values, rate_hz))
