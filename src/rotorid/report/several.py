"""Files of several models of the same logs: a folder for each, one report, one list of results."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from rotorid.io.files import write_atomically
from rotorid.report.files import to_json, write_results, write_together

if TYPE_CHECKING:
    from rotorid.pipeline.several import SeveralModels


def write_several(folder: Path, models: SeveralModels, *, title: str) -> None:
    """Write a folder for each model that stands, then ``report.html`` and ``results.json``, both or none.

    Parameters
    ----------
    folder
        Where they go; it is made when missing.
    models
        What to write; those that were refused stand in ``results.json`` alone.
    title
        Heading of the report.
    """
    from rotorid.documents.results import RESULTS, results_document
    from rotorid.report.identification import render_report

    for name, model in models.identified.items():
        write_results(folder / Path(name).name, model, title=f"{name} of {title}")
    text, page = to_json(results_document(models)), render_report(list(models.identified.values()), title=title)
    files: dict[str, Callable[[Path], None]] = {
        "report.html": lambda path: write_atomically(path, page),
        RESULTS: lambda path: write_atomically(path, text),
    }
    write_together(folder, files)
