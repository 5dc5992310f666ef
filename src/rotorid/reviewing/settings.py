"""Choices of ``review``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from rotorid.data.base import Immutable
from rotorid.errors import UsageError, unknown_name
from rotorid.settings.option import Option, Text
from rotorid.settings.parsing import parse_assignments


def parse_known(texts: Sequence[str]) -> dict[str, float]:
    """Read numbers of the vehicle that a review uses: its mass.

    Raises
    ------
    UsageError
        Another number came, or a mass that is not positive.

    Examples
    --------
    >>> parse_known(["m=0.037"])
    {'m': 0.037}
    """
    known = parse_assignments(texts, option="--set", units={"m": "kg"})
    for name, value in known.items():
        if name != "m":
            raise unknown_name("number of a review", name, ["m"])
        if not 0.0 < value < float("inf"):
            raise UsageError(f"the mass is {value:g} kg", needed="a positive number", remedy="add --set m=KG")
    return known


@dataclass(frozen=True, kw_only=True)
class ReviewSettings(Immutable):
    """What is looked for in ordinary flights.

    Parameters
    ----------
    models
        Whether models are identified too, which takes most of the time.
    known
        Numbers of the vehicle: ``m``, its mass in flight in kg.
    baseline
        Folder of earlier flights of the vehicle, to see what changed; in Python also a list of logs or records.
    """

    models: Annotated[bool, Option("--models/--no-models", "Identify models too; the longest part.")] = True
    known: Annotated[
        Mapping[str, float],
        Option(
            "--set", "Mass in flight, such as m=1.4: thrust in newtons.", text=Text("m=KG", parse_known, repeats=True)
        ),
    ] = field(default_factory=dict)
    baseline: Annotated[
        Any,
        Option("--baseline", "Earlier flights of the vehicle: what changed since, and why.", text=Text("FOLDER", Path)),
    ] = None
