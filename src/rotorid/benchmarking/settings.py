"""Choices of ``bench``."""

from dataclasses import dataclass
from typing import Annotated

from rotorid.settings.option import Option, Settings


@dataclass(frozen=True, kw_only=True)
class BenchSettings(Settings):
    """Whose predictions a benchmark scores, apart from those of rotorid.

    Parameters
    ----------
    predictions
        A CSV file of predictions, or a Python function as ``module:function``; ``None`` for models of rotorid alone.
    label
        What the table calls them; by default the name of the file or the function.
    seed
        As every provenance has; nothing here is random.
    """

    predictions: Annotated[
        str | None,
        Option(
            "--predictions",
            "Predictions to score too: a CSV file, or a Python function that makes them.",
            metavar="FILE.csv|MODULE:FUNCTION",
        ),
    ] = None
    label: Annotated[str | None, Option("--label", "Name of these predictions in the table.", metavar="NAME")] = None
    seed: int = 0
