"""What commands share: read the logs, compute, write the files, or explain why the data do not support it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from rotorid.cli.console import log_progress, print_refusal, progress, say
from rotorid.letters import visible

if TYPE_CHECKING:
    from rotorid.cli.options import ForPaper, Output
    from rotorid.data.record import FlightRecord
    from rotorid.errors import InsufficientDataError
    from rotorid.io.folders import Target
    from rotorid.report.publication import Publication


def carry_out(
    logs: Sequence[Path],
    *,
    output: Output,
    folder: Path,
    file: str,
    compute: Callable[[Sequence[FlightRecord]], Any],
    write: Callable[[Path, Any], None],
    refused: Callable[[InsufficientDataError, Sequence[FlightRecord]], Any],
    document: Callable[[Any], Any],
    show: Callable[..., None],
    mapping: Path | None = None,
    paper: ForPaper | None = None,
    publication: Callable[[Any], Publication] | None = None,
) -> None:
    """Read logs, compute a result of them, write its files, and print it as JSON or for a person.

    Parameters
    ----------
    output
        What to write and how much to print.
    folder
        For the files, unless ``--out`` is given; numbered if the name is taken.
    file
        Name of the JSON file there, which identifies the kind of result.
    compute
        The verb: records in, result out.
    write
        Writes all files of a result into a folder of the run's own, which takes the place of the target afterwards.
    refused
        Makes the document that explains why there is no result.
    document
        Makes the document of a result, which ``--json`` prints.
    show
        Prints it for a person: ``show(document, folder, verbose=...)``.
    mapping
        File that names the channels of other sources.
    paper, publication
        Which figures and tables to write with the report, and what makes them from a result.

    Raises
    ------
    typer.Exit
        With code 1: the data cannot support a result.
    UsageError
        Other files are in the way, or the folder cannot be written; raised before any log is read.
    """
    from rotorid.documents.base import to_json
    from rotorid.errors import InsufficientDataError
    from rotorid.io.folders import making

    target = target_of(output, folder, file, paper)
    records: list[FlightRecord] = []
    try:
        with progress(quiet=output.quiet):
            for record in read_logs(logs, mapping):
                records.append(record)  # noqa: PERF402 - a refusal lists those that were read
            result = with_command(compute(records))
            log_progress("writing the report")
            with making(target) as made:
                write(made.place, result)
                if paper is not None and publication is not None and (paper.figures or paper.tables):
                    illustrate(made.place, publication(result), paper)
                print_if_asked(made.place, paper)
    except InsufficientDataError as error:
        why = with_command(refused(error, records))
        if output.json:
            sys.stdout.write(to_json(why))
        print_refusal(error, why.findings, target.folder / file, quiet=output.quiet)
        raise typer.Exit(1) from None
    if output.json:
        sys.stdout.write(to_json(document(result)))
    elif not output.quiet:
        show(document(result), made.folder, verbose=output.verbose)


def illustrate(folder: Path, publication: Publication, paper: ForPaper) -> None:
    """Write the figures and tables of a result for a paper."""
    from rotorid.report.publication import write_publication

    log_progress("drawing the figures")
    write_publication(folder, publication, figures=paper.figures, tables=paper.tables)


def target_of(output: Output, default: Path, file: str, paper: ForPaper | None = None) -> Target:
    """Where a command's results go, with pages on paper among them; checked before any work is done.

    Parameters
    ----------
    output, paper
        What the user wants to be written.
    default
        The folder, unless the user names another.
    file
        By which a result is known again.

    Raises
    ------
    UsageError
        Other files are in the way, the folder cannot be written, or no browser prints.
    """
    from rotorid.io.folders import target_folder
    from rotorid.report.files import result_kind

    kind = result_kind(file)
    pages = [f"{name.removesuffix('.html')}.pdf" for name in kind.files if name.endswith(".html")]
    printed = ["*.pdf", *(name for name in pages if "*" in name)]
    require_printing(paper)
    if paper is not None and paper.pdf:
        # Only now is a PDF that somebody else wrote under one of these names in the way.
        printed += [name for name in pages if "*" not in name]
    return target_folder(output.out, default, replace(kind, files=(*kind.files, *printed)), force=output.force)


def require_printing(paper: ForPaper | None) -> None:
    """Raise for ``--pdf`` before any work if no browser prints."""
    if paper is not None and paper.pdf:
        from rotorid.report.printing import require_browser

        require_browser()


def print_if_asked(folder: Path, paper: ForPaper | None) -> None:
    """Print the pages of a folder if ``--pdf`` was given; a page that cannot be printed does not end the command."""
    if paper is not None and paper.pdf:
        from rotorid.errors import UsageError
        from rotorid.report.printing import print_pages

        log_progress("printing")
        try:
            print_pages(folder)
        except (UsageError, OSError) as error:
            say(f"rotorid: {error}; all other files are written")


def read_logs(logs: Sequence[Path], mapping: Path | None) -> Iterator[FlightRecord]:
    """Records of the logs, one after the other."""
    from rotorid.io.registry import read

    for number, log in enumerate(logs):
        log_progress(f"reading {log.name}", extra={"done": number, "total": len(logs)})
        yield read(log, mapping=mapping)


def with_command(result: Any) -> Any:
    """A result, or its document, with the words of the command line in its provenance."""
    return _changed(result, provenance=_changed(result.provenance, command=command_line()))


def command_line() -> list[str]:
    """The command line as typed, with paths shortened to names for privacy.

    Examples
    --------
    >>> _without_folder("/home/someone/flights/a.ulg"), _without_folder("--out=~/b"), _without_folder("transfer:0/1")
    ('a.ulg', '--out=b', 'transfer:0/1')
    """
    return ["rotorid", *(visible(_without_folder(word)) for word in sys.argv[1:])]


def _without_folder(word: str) -> str:
    option, equals, value = word.partition("=") if word.startswith("-") else ("", "", word)
    path = Path(value)
    outside = path.is_absolute() or value.startswith(("~", "./", "../", ".\\", "..\\"))
    if len(path.parts) > 1 and (outside or path.exists()):
        value = path.name or value
    return f"{option}{equals}{value}"


def _changed(value: Any, **fields: Any) -> Any:
    """A copy of a value or a document with other fields."""
    return value.model_copy(update=fields) if hasattr(value, "model_copy") else replace(value, **fields)
