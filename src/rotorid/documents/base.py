"""The base of all documents, and the parts that nearly all have: findings and provenance.

A document is made from a value at the border, ``FindingDocument.model_validate(finding)``: its fields are read from
attributes of the same names, so a value needs no copy of its own for JSON.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError
from pydantic_core import PydanticSerializationError
from pydantic_core import to_json as in_json

from rotorid.data.display import cut, html_table, lines_of
from rotorid.io.documents import DocumentError
from rotorid.letters import HIDDEN, visible


class Document(BaseModel):
    """Base of all documents: immutable, no unknown fields, numbers finite or ``null``; a value validates as it is."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", from_attributes=True, ser_json_inf_nan="null", populate_by_name=True
    )


class Shown(NamedTuple):
    """What a person sees first of a document: a heading, and a table below it."""

    heading: str
    columns: tuple[str, ...]
    rows: list[tuple[str, ...]]


class ShownDocument(Document):
    """A document that shows itself in a few lines, and as a table in a notebook."""

    def shown(self) -> Shown:
        """What a person sees first."""
        raise NotImplementedError

    def __repr__(self) -> str:
        heading, _, rows = self.shown()
        return lines_of(heading, rows)

    def __str__(self) -> str:
        return repr(self)

    def _repr_html_(self) -> str:
        return html_table(*self.shown())


def finding_lines(findings: Sequence[FindingDocument], width: int) -> list[tuple[str, ...]]:
    """Rows of warnings and errors, with the message in the last cell of a width."""
    return [
        (finding.severity, finding.kind, *[""] * (width - 3), finding.message)
        for finding in findings
        if finding.severity != "info"
    ]


def to_json(document: Document, *, indent: int | None = 2) -> str:
    """A document as JSON text, with the names of its schema.

    Parameters
    ----------
    document
        With numbers as they are; what is not finite is ``null``.
    indent
        Spaces of each level; ``None`` writes one line, for programs.
    """
    try:
        text = document.model_dump_json(by_alias=True, indent=indent)
    except PydanticSerializationError:
        # A name of a file that is no text.
        text = in_json(_shown(document.model_dump(by_alias=True)), indent=indent, inf_nan_mode="null").decode()
    # JSON writes out what ASCII hides, and may write out the rest.
    return HIDDEN.sub(lambda found: f"\\u{ord(found[0]):04x}", text) + "\n"


def _shown(value: Any) -> Any:
    """A document with every text in letters that can be written to a file."""
    if isinstance(value, str):
        return visible(value)
    if isinstance(value, dict):
        return {_shown(name): _shown(entry) for name, entry in value.items()}
    return [_shown(entry) for entry in value] if isinstance(value, list | tuple) else value


Checked = TypeVar("Checked", bound=Document)


def checked(kind: type[Checked], table: Any) -> Checked:
    """A table that was read from a file as the document that it should be.

    Parameters
    ----------
    table
        As :func:`rotorid.io.documents.parse_json` returns it.

    Raises
    ------
    DocumentError
        It does not fit; the message names the first place that is wrong.
    """
    try:
        return kind.model_validate(table)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        place = cut(".".join(str(part) for part in first["loc"]), 80) or "the file"
        raise DocumentError(f"{place}: {first['msg']}") from error


def _listed(values: Any) -> Any:
    return values.tolist() if hasattr(values, "tolist") else values


Numbers: TypeAlias = Annotated[list[float], BeforeValidator(_listed)]
"""Numbers of a list or of an array of one dimension."""

Flags: TypeAlias = Annotated[list[bool], BeforeValidator(_listed)]
"""The same for what is true or false."""


class FindingDocument(Document):
    """An engineer's remark."""

    kind: str
    severity: Literal["info", "warning", "error"]
    where: str
    message: str
    numbers: dict[str, float] = Field(default_factory=dict)


class ManeuverDocument(Document):
    """An excited interval on the log's own clock."""

    record: str
    axis: str
    kind: str
    start_s: float
    stop_s: float
    band_rad_s: tuple[float, float] | None = None
    origin: str
    signal: str


class ProvenanceDocument(Document):
    """Where the result came from: enough to make it again."""

    version: str
    command: list[str]
    inputs: dict[str, str]
    settings: dict[str, str | int | float | bool | list[str] | list[float] | None]
    seed: int
    estimate: Literal["direct", "joint"] | None = None
    instruments: list[str] = Field(default_factory=list)
    sources: dict[str, str] = Field(default_factory=dict)
    maneuvers: list[ManeuverDocument] = Field(default_factory=list)
