"""What of a result goes into a paper: its pictures as files of their own, responses side by side, tables as text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rotorid.io.files import write_atomically
from rotorid.report.files import link_files
from rotorid.report.frame import Picture
from rotorid.report.parts import by_axis
from rotorid.report.tables import (
    WRITERS,
    Table,
    TableFormat,
    comparison_tables,
    response_tables,
    result_tables,
    verification_tables,
)

if TYPE_CHECKING:
    from rotorid.benchmarking.benchmark import Benchmarked
    from rotorid.flying.flown_models import FlownModel
    from rotorid.identifying.comparison import Comparison
    from rotorid.identifying.verification import Verified
    from rotorid.loops.responses import Responses
    from rotorid.plot.paper import Fitted
    from rotorid.plot.printed import PrintedAs
    from rotorid.results.model import IdentifiedModel
    from rotorid.typing import BoolArray

FIGURES, TABLES, CAPTIONS = "figures", "tables", "captions.txt"
_MOST_SIDE_BY_SIDE = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class SideBySide:
    """Responses to one input side by side in one figure, as pairs of output and input."""

    name: str
    caption: str
    fitted: Fitted
    pairs: tuple[tuple[str, str], ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Publication:
    """Pictures by the name of their file, figures of several responses, and tables."""

    pictures: Mapping[str, Picture]
    figures: tuple[SideBySide, ...] = ()
    tables: tuple[Table, ...] = ()


def of_model(model: IdentifiedModel) -> Publication:
    """Of an identified model: all pictures of its report, responses to each input side by side, its tables."""
    from rotorid.report.identification import section
    from rotorid.report.parts import Shown

    shown = Shown.of(model)
    drawn = section(shown, anchor="fit", truth={})
    return Publication(
        pictures=_named(drawn.pictures, "fit-"),
        figures=_side_by_side(shown.data, shown.data.used),
        tables=result_tables(shown.document),
    )


def of_responses(result: Responses) -> Publication:
    """Of measured responses: all pictures of their report, those to each input side by side, their tables."""
    from rotorid.documents.response import response_document
    from rotorid.report.response import pictures_of

    return Publication(
        pictures=_named(pictures_of(result)),
        figures=_side_by_side(_Measured(result), result.used),
        tables=response_tables(response_document(result)),
    )


def of_verification(verified: Verified) -> Publication:
    """Of a judgment on unseen flight: the pictures of its report and its tables."""
    from rotorid.documents.verify import verify_document
    from rotorid.report.verification import pictures_of

    return Publication(
        pictures=_named(pictures_of(verified.found)), tables=verification_tables(verify_document(verified))
    )


def of_simulated(flown: FlownModel) -> Publication:
    """Of a model flown through logs: positions, velocities and attitude, and their scores."""
    from rotorid.documents.flown import flown_document
    from rotorid.report.flown import flown_table, pictures_of

    table = flown_table(flown_document(flown))
    return Publication(pictures=_named(pictures_of(flown)), tables=(table,) if table.rows else ())


def of_comparison(compared: Comparison) -> Publication:
    """Of several results side by side: the pictures of their report and their tables."""
    from rotorid.documents.compare import compare_document, steps_of
    from rotorid.report.compare import pictures_of

    steps = steps_of(compared)
    document = compare_document(compared, steps)
    return Publication(
        pictures=_named(pictures_of(document, compared.maneuvers, steps)), tables=comparison_tables(document)
    )


def of_benchmark(found: Benchmarked) -> Publication:
    """Of a public benchmark: its table, with the source of each row."""
    from rotorid.documents.benchmark import bench_document
    from rotorid.report.benchmark import bench_table

    return Publication(pictures={}, tables=(bench_table(bench_document(found)),))


def write_publication(
    folder: Path, made: Publication, *, figures: PrintedAs | None = None, tables: Sequence[TableFormat] = ()
) -> None:
    """Write ``figures`` with a list of captions, and ``tables``, into the folder of a result.

    Parameters
    ----------
    made
        What there is.
    figures
        Kind of the pictures; ``None`` writes none.
    tables
        Kinds of the tables.

    Raises
    ------
    UsageError
        matplotlib is not installed and pictures are wanted.
    """
    if figures is not None:
        _write_figures(folder / FIGURES, made, figures)
    if tables:
        (folder / TABLES).mkdir()
        for table in made.tables:
            for kind in tables:
                write_atomically(folder / TABLES / f"{table.name}.{kind}", WRITERS[kind](table))
    report = folder / "report.html"
    if report.is_file():
        parts = [folder / part for part in (FIGURES, TABLES)]
        written = sorted(file for part in parts if part.is_dir() for file in part.iterdir())
        link_files(report, [file.relative_to(folder).as_posix() for file in written])


def _write_figures(folder: Path, made: Publication, kind: PrintedAs) -> None:
    from rotorid.plot.paper import side_by_side
    from rotorid.plot.printed import printed, saved

    folder.mkdir()
    captions = []
    for figure in made.figures:
        write_atomically(folder / f"{figure.name}.{kind}", saved(side_by_side(figure.fitted, figure.pairs), kind))
        captions.append(f"{figure.name}.{kind}: {figure.caption}\n")
    for name, picture in made.pictures.items():
        write_atomically(folder / f"{name}.{kind}", printed(picture.figure, kind))
        captions.append(f"{name}.{kind}: {picture.description}\n")
    write_atomically(folder / CAPTIONS, "".join(captions))


def _named(pictures: Sequence[Picture], prefix: str = "") -> dict[str, Picture]:
    return {picture.key.removeprefix(prefix): picture for picture in pictures}


def _side_by_side(fitted: Fitted, used: BoolArray) -> tuple[SideBySide, ...]:
    """Responses with usable points, by input, so many in a figure as one can read, those on its axis first."""
    response = fitted.response
    found = []
    for u, input in enumerate(response.inputs):
        pairs = by_axis([(output, input) for y, output in enumerate(response.outputs) if used[y, u].any()])
        figures = -(-len(pairs) // _MOST_SIDE_BY_SIDE)
        for number in range(figures):
            few = tuple(pairs[len(pairs) * number // figures : len(pairs) * (number + 1) // figures])
            name = f"responses-{input}" + (f"-{number + 1}" if figures > 1 else "")
            caption = (
                f"Responses of {', '.join(output for output, _ in few)} to {input}, with ± 2 σ of the random error"
            )
            found.append(SideBySide(name=_file(name), caption=caption, fitted=fitted, pairs=few))
    return tuple(found)


def _file(name: str) -> str:
    """A name for a file out of names of channels, which may hold anything."""
    return "".join(character if character.isalnum() or character in "-_." else "_" for character in name)


class _Measured:
    """Measured responses without a model, as :func:`rotorid.plot.paper.side_by_side` takes them."""

    model_response = None

    def __init__(self, result: Responses) -> None:
        self.response = result.response
        self.used = result.used
        self.least_coherence = result.least_coherence
