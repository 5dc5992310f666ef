"""Files of several models of the same logs: a folder for each, one report, one list of results."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rotorid.report.files import write_results, write_together

if TYPE_CHECKING:
    from rotorid.identifying.identify_many import SeveralModels
    from rotorid.plot.printed import PrintedAs
    from rotorid.report.tables import TableFormat


def write_several(
    folder: Path,
    models: SeveralModels,
    *,
    title: str,
    figures: PrintedAs | None = None,
    tables: Sequence[TableFormat] = (),
) -> None:
    """Write a folder for each identified model, then ``report.html`` and ``results.json``, both or none.

    Parameters
    ----------
    folder
        Where they go; it is made when missing.
    models
        What to write; models that were refused are in ``results.json`` and on the page alone.
    figures, tables
        Kinds of files for a paper, written into the folder of each model.
    """
    from rotorid.data.display import counted
    from rotorid.documents.results import RESULTS, results_document
    from rotorid.flying.model_from_results import joined_halves
    from rotorid.report.frame import with_files
    from rotorid.report.identification import render_report
    from rotorid.report.publication import of_model, write_publication

    logs = title.partition(" from ")[2] or title
    folders = [Path(name).name for name in models.identified]
    for name, model in models.identified.items():
        own = folder / Path(name).name
        write_results(own, model, title=f"{name} from {logs}")
        if figures is not None or tables:
            write_publication(own, of_model(model), figures=figures, tables=tables)
    whole = joined_halves(list(models.identified.values()))
    if whole is not None:
        write_results(folder / whole.name, whole, title=f"{whole.name} from {logs}")
        folders.append(whole.name)
    page = render_report(
        list(models.identified.values()), title=f"{counted(len(models), 'model')} from {logs}", refused=models.refused
    )
    linked = with_files(page, [f"{folder}/report.html" for folder in folders])
    write_together(folder, {"report.html": linked, RESULTS: results_document(models)})
