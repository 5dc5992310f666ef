"""Choices of ``review``."""

from dataclasses import dataclass
from typing import Annotated

from rotorid.data.base import Immutable
from rotorid.settings.option import Option


@dataclass(frozen=True, kw_only=True)
class ReviewSettings(Immutable):
    """What is looked for in ordinary flights.

    Parameters
    ----------
    models
        Whether models are identified too, which takes most of the time.
    """

    models: Annotated[bool, Option("--models/--no-models", "Identify models too; the longest part.")] = True
