"""Results as files and back: what a command writes, a program can write and read too."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from rotorid.data.display import cut
from rotorid.documents.base import Document, checked, to_json
from rotorid.documents.compare import compare_document
from rotorid.documents.result import read_text
from rotorid.documents.result import save as save_model
from rotorid.documents.review import review_arrays, review_document
from rotorid.documents.schemas import SCHEMAS
from rotorid.documents.stitched import stitched_document
from rotorid.documents.track import track_arrays, track_document
from rotorid.documents.verify import verify_document
from rotorid.errors import UsageError
from rotorid.flying.stitching import Stitched
from rotorid.identifying.comparison import Comparison
from rotorid.identifying.tracking import FlightTracking
from rotorid.identifying.verification import Verified
from rotorid.io.documents import DocumentError, parse_json
from rotorid.io.files import write_atomically, write_npz
from rotorid.results.model import IdentifiedModel
from rotorid.reviewing.values import Review

Result: TypeAlias = IdentifiedModel | Review | FlightTracking | Comparison | Verified | Stitched


class _Files(NamedTuple):
    """The file of a kind of result, its document, and its arrays."""

    file: str
    document: Callable[[Any], Document]
    arrays: Callable[[Any], Mapping[str, Any]] | None = None


_FILES: Mapping[type[Any], _Files] = {
    Review: _Files("review.json", review_document, review_arrays),
    FlightTracking: _Files("track.json", track_document, track_arrays),
    Comparison: _Files("compare.json", compare_document),
    Verified: _Files("verification.json", verify_document),
    Stitched: _Files("stitched.json", stitched_document),
}


def save(result: Result, folder: str | Path) -> None:
    """Write a result into a folder: the JSON of its command, and its curves as ``.npz``.

    Parameters
    ----------
    result
        A model, which :func:`rotorid.load` makes again; or a review, a tracked flight, a comparison, a verification or
        a stitched model, whose numbers :func:`load_document` reads.
    folder
        Where it goes; made when missing. Files of the same names are replaced.

    Raises
    ------
    UsageError
        It is no result.
    """
    if isinstance(result, IdentifiedModel):
        save_model(result, folder)
        return
    files = _FILES.get(type(result))
    if files is None:
        raise UsageError(
            f"{type(result).__name__} cannot be saved",
            needed="a model, Review, FlightTracking, Comparison, Verified or Stitched",
        )
    # All is made before the first file is written.
    text, arrays = to_json(files.document(result)), files.arrays and files.arrays(result)
    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    if arrays is not None:
        write_npz((place / files.file).with_suffix(".npz"), dict(arrays))
    write_atomically(place / files.file, text)


def load_document(path: str | Path) -> Document:
    """The document that a command or :func:`save` wrote, with its fields as attributes.

    Parameters
    ----------
    path
        The JSON file, or its folder.

    Raises
    ------
    UsageError
        The path leads to no document, to several, or to a damaged one.

    Examples
    --------
    >>> import rotorid
    >>> rotorid.load_document("rotorid-out/flight-review").margins["roll"].phase_margin_deg  # doctest: +SKIP
    """
    file = _file_of(Path(path))
    try:
        table = parse_json(read_text(file))
        schema = table.get("schema", "") if isinstance(table, dict) else ""
        kind = SCHEMAS.get(str(schema).replace("/", "-"))
        if kind is None:
            raise DocumentError(f"its schema is {cut(repr(schema), 60)}")
        return checked(kind, table)
    except DocumentError as error:
        raise UsageError(
            f"{file} is no document of this version: {error}", needed="a JSON that rotorid wrote"
        ) from error


def _file_of(path: Path) -> Path:
    """The one document of a folder; a file as it is."""
    if not path.is_dir():
        return path
    found = sorted(path.glob("*.json"))
    main = [file for file in found if file.name not in ("settings.json", "plan.json")] or found
    if len(main) != 1:
        names = ", ".join(file.name for file in main[:6])
        raise UsageError(
            f"{path} has {names or 'no JSON'}", needed="one document", remedy=f"give {main[0]}" if main else ""
        )
    return main[0]
