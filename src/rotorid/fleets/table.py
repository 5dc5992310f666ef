"""The table of a fleet: rows, the answer of one log, the journal that a run goes on from, and the Parquet file.

A run writes the answer of each log as a line of a journal as soon as it is there, and the table from the journal. A
line that was cut off by a crash is left out when the journal is read again, so that what is missing is done and
nothing twice.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

from rotorid import __version__
from rotorid.data.base import Immutable
from rotorid.errors import LogError, RotoridError, UsageError
from rotorid.io.documents import parse_json, read_lines, require_file
from rotorid.io.folders import replacing
from rotorid.io.sandbox import extract
from rotorid.letters import visible

TABLE, FAILED, JOURNAL, SALT = "fleet.parquet", "failed.parquet", "fleet.journal", "fleet.salt"
FILE, PAGE = "fleet.json", "fleet.html"
SCHEMA = "rotorid.fleet.table/1"
_JOURNAL_SCHEMA = "rotorid.fleet.journal/1"
_JOURNAL_HEAD = json.dumps({"schema": _JOURNAL_SCHEMA}).encode() + b"\n"
REVIEW = "review"
"""What the table calls measures of a review in the place of a model."""

_MOST_LINE_BYTES = 64 << 20
_WRITTEN = re.compile(r"[0-9a-f]{32}/")
MEMBER = "!"
"""Between an archive and the name of a log in it."""


@dataclass(frozen=True, kw_only=True)
class Row(Immutable):
    """One parameter of one model of one flight of one log.

    Parameters
    ----------
    log, log_sha256
        Name and content of the log.
    vehicle
        Who flew: a name that was given, a salted hash of its board, or the folder of its logs.
    time_utc
        When, as the log's name says it; empty where it does not.
    flight
        Number of the flight within its log, from 1.
    model, parameter
        What was identified; ``review`` for a measure.
    value, std, std_random, lower, upper
        Estimate, standard deviation of all errors and of the random ones alone, 95 % interval; nan where not stated.
    unit
        Of these.
    findings
        Kinds of the warnings of the model, with commas.
    format, firmware
        Of the log.
    autopilot, kind, frame
        Of the vehicle, as the log names them; empty where it does not.
    basis
        What was fitted with a delay or a lag, and by which method; only those of one basis are comparable.
    settings
        Hash of what was asked.
    version
        Of the program.
    """

    log: str
    log_sha256: str
    vehicle: str
    time_utc: str
    flight: int
    model: str
    parameter: str
    value: float
    std: float
    std_random: float
    lower: float
    upper: float
    unit: str
    findings: str
    format: str
    firmware: str
    settings: str
    autopilot: str = ""
    kind: str = ""
    frame: str = ""
    basis: str = ""
    version: str = __version__

    @property
    def key(self) -> tuple[str, str, int, str, str]:
        """Unique key by which rows are sorted."""
        return self.log, self.log_sha256, self.flight, self.model, self.parameter


Failure: TypeAlias = Literal["refused", "unreadable", "unreachable", "died", "time", "memory", "error"]


@dataclass(frozen=True, kw_only=True)
class Failed(Immutable):
    """A log, or a model of one of its flights, without an answer, and why."""

    log: str
    log_sha256: str
    vehicle: str
    flight: int
    model: str
    kind: Failure
    reason: str
    version: str = __version__

    @property
    def key(self) -> tuple[str, str, int, str]:
        """Key by which failures are sorted."""
        return self.log, self.log_sha256, self.flight, self.model


@dataclass(frozen=True, kw_only=True)
class LogAnswer(Immutable):
    """All that one log answered.

    Parameters
    ----------
    log
        Name of the log.
    place
        Where it was found.
    mark
        Size and time of the file, or what the store gives instead; another one means that the file changed.
    log_sha256
        Content; empty where it could not be read.
    settings
        Hash of what was asked.
    rows, failed
        What it gave, and what it could not.
    gains
        Of the rate loops, by the firmware's names.
    patterns
        Over the rotors, as :func:`rotorid.flights.motor_balance.patterns_of` gives them; empty where they are unknown.
    seconds
        That the worker took.
    version
        Of the program.
    """

    log: str
    place: str
    mark: str
    log_sha256: str
    settings: str
    rows: tuple[Row, ...] = ()
    failed: tuple[Failed, ...] = ()
    gains: Mapping[str, float] = field(default_factory=dict)
    patterns: tuple[tuple[float, ...], ...] = ()
    seconds: float = 0.0
    version: str = __version__

    def __post_init__(self) -> None:
        # A journal has lists.
        self._set(gains=self.gains, patterns=tuple(tuple(row) for row in self.patterns))

    @property
    def done(self) -> bool:
        """Whether another run would answer the same: a worker or a store that failed may not fail the next."""
        return all(failure.kind in ("refused", "unreadable") for failure in self.failed)

    def as_json(self) -> str:
        """One line."""
        table = {item.name: getattr(self, item.name) for item in fields(self)}
        table["rows"] = [asdict(row) for row in self.rows]
        table["failed"] = [asdict(failure) for failure in self.failed]
        table["gains"] = dict(self.gains)
        return json.dumps(_without_nan(table), ensure_ascii=True, allow_nan=False)

    @classmethod
    def from_json(cls, text: str) -> LogAnswer:
        """The answer in a line.

        Raises
        ------
        ValueError
            It holds none.
        """
        try:
            table = parse_json(text)
            rows = tuple(Row(**_typed(Row, row)) for row in table.pop("rows"))
            failed = tuple(Failed(**_typed(Failed, failure)) for failure in table.pop("failed"))
            gains = {name: _typed_value("float", value) for name, value in table.pop("gains").items()}
            patterns = tuple(tuple(_typed_value("float", value) for value in row) for row in table.pop("patterns"))
            return cls(**_typed(cls, table), rows=rows, failed=failed, gains=gains, patterns=patterns)
        except (KeyError, TypeError, AttributeError, RotoridError) as error:
            raise ValueError(f"no answer of a log: {error}") from error


@dataclass(frozen=True, kw_only=True)
class Counts(Immutable):
    """Logs of a run: each is answered, refused, unreadable or a copy.

    Parameters
    ----------
    logs
        That were found.
    answered
        That gave a number.
    refused
        That were read and support none of what was asked.
    unreadable
        That could not be read, or ended their worker.
    duplicates
        With the content of another.
    resumed
        Known from earlier runs.
    rows
        Numbers.
    skipped
        Names of other files in the same folders, which are no logs.
    """

    logs: int
    answered: int
    refused: int
    unreadable: int
    duplicates: int
    resumed: int
    rows: int
    skipped: tuple[str, ...] = ()


def _typed(kind: type[Row | Failed | LogAnswer], table: Mapping[str, Any]) -> dict[str, Any]:
    """A table of a journal, each value found to be what the field of its name holds."""
    types = {item.name: str(item.type) for item in fields(kind)}
    return {name: _typed_value(types[name], value) for name, value in table.items()}


def _typed_value(needed: str, value: Any) -> Any:
    """A value of a journal: ``nan`` is written as ``null``."""
    if needed == "float" and not isinstance(value, bool):
        value = math.nan if value is None else value
        if isinstance(value, int | float):
            return float(value)
    sound = {
        "int": type(value) is int and abs(value) < 1 << 31,
        "str": isinstance(value, str),
        "Failure": value in get_args(Failure),
    }
    if sound.get(needed):
        return value
    raise TypeError(f"{value!r:.40} is no {needed}")


def _without_nan(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {name: _without_nan(item) for name, item in value.items()}
    return [_without_nan(item) for item in value] if isinstance(value, list | tuple) else value


def settings_hash(asked: Mapping[str, Any]) -> str:
    """Hash of the settings."""
    return hashlib.sha256(json.dumps(asked, sort_keys=True).encode()).hexdigest()[:16]


@dataclass(eq=False)
class Journal:
    """Answers in the order of arrival, one per line; an interrupted run loses at most the last one.

    Folders of this machine are not written: a place is a hash of its address and its last two names.

    Parameters
    ----------
    path
        Where it is.
    salt
        Of the hashes.
    answers
        By the written place and the hash of the settings.
    """

    path: Path
    salt: str = ""
    answers: dict[tuple[str, str], LogAnswer] = field(default_factory=dict)

    def written(self, place: str) -> str:
        """An address as it is written.

        Examples
        --------
        >>> Journal(Path("fleet.journal"), "salt").written("/home/someone/quad/a.ulg")[32:]
        '/quad/a.ulg'
        """
        if _WRITTEN.match(place):
            return place
        names = place.replace(MEMBER, "/").replace("\\", "/").split("/")
        digest = hashlib.blake2b(place.encode("utf-8", "replace"), key=self.salt.encode()[:64], digest_size=16)
        return "/".join([digest.hexdigest(), *names[-2:]])

    def known(self, place: str, settings: str) -> LogAnswer | None:
        """What an earlier run answered for a place."""
        found = self.answers.get((self.written(place), settings))
        return None if found is None else replace(found, place=place)

    def read(self) -> None:
        """Take in what earlier runs wrote, the later answer for each log; a line that was cut off is cut away.

        Raises
        ------
        UsageError
            The file is of something else, or cannot be read.
        """
        if not os.path.lexists(self.path):
            return
        whole = 0
        lines = read_lines(self.path, needed=_JOURNAL_SCHEMA, most_bytes=_MOST_LINE_BYTES)
        for number, line in enumerate(lines):
            if number == 0:
                self._require(line)
            if not line.endswith(b"\n"):
                break
            if number:
                with suppress(ValueError):
                    self._keep(LogAnswer.from_json(line.decode()))
            whole += len(line)
        if whole < self.path.stat().st_size:
            with self.path.open("rb+") as file:
                file.truncate(whole)

    def _require(self, line: bytes) -> None:
        """Refuse a first line of something else; the beginning of the right one was cut off by a crash."""
        if not (line == _JOURNAL_HEAD or (_JOURNAL_HEAD.startswith(line) and not line.endswith(b"\n"))):
            raise UsageError(
                f"{self.path} is not a journal of this version", needed=_JOURNAL_SCHEMA, remedy="choose another --out"
            )

    def _keep(self, answer: LogAnswer) -> LogAnswer:
        answer = replace(answer, place=self.written(answer.place))
        self.answers[answer.place, answer.settings] = answer
        return answer

    def add(self, answer: LogAnswer) -> None:
        """Write one answer down.

        Raises
        ------
        UsageError
            There is no room; what was written before stays whole.
        """
        answer = self._keep(answer)
        before = self.path.stat().st_size if self.path.exists() else 0
        head = b"" if before else _JOURNAL_HEAD
        try:
            with self.path.open("ab", buffering=0) as file:
                data = head + answer.as_json().encode() + b"\n"
                if file.write(data) != len(data):
                    raise OSError(28, os.strerror(28))
        except OSError as error:
            if self.path.exists():
                with self.path.open("rb+") as file:
                    file.truncate(before)
            raise UsageError(
                f"{self.path} cannot be written: {error.strerror or error}",
                needed="free space in a folder that you may write to",
                remedy="make room and run the command again: finished logs are kept",
            ) from error


def sorted_rows(answers: Iterable[LogAnswer]) -> list[Row]:
    """All rows in the order of the table."""
    return sorted((row for answer in answers for row in answer.rows), key=lambda row: row.key)


def sorted_failures(answers: Iterable[LogAnswer]) -> list[Failed]:
    """All failures in the order of their table."""
    return sorted((failure for answer in answers for failure in answer.failed), key=lambda failure: failure.key)


def write_table(path: Path, values: Sequence[Row] | Sequence[Failed], kind: type[Row] | type[Failed]) -> None:
    """Write rows as Parquet, in one step: equal rows give equal bytes.

    Raises
    ------
    UsageError
        The place cannot be written, or pyarrow is missing.
    """
    require_parquet()
    import pyarrow as arrow
    from pyarrow import parquet

    types = {"float": arrow.float64(), "int": arrow.int32()}
    schema = arrow.schema(
        [(item.name, types.get(str(item.type), arrow.string())) for item in fields(kind)], metadata={"rotorid": SCHEMA}
    )
    columns = {item.name: [getattr(value, item.name) for value in values] for item in fields(kind)}
    try:
        with replacing(path) as place:
            parquet.write_table(arrow.table(columns, schema=schema), place, compression="zstd")
    except OSError as error:
        raise UsageError(
            f"{path} cannot be written: {error.strerror or error}",
            needed="free space in a folder that you may write to",
            remedy="make room and run the command again: finished logs are kept",
        ) from error


def require_table(path: Path) -> None:
    """Refuse a table of another schema.

    Raises
    ------
    UsageError
        The file is no table of rotorid, or of another version.
    """
    require_parquet()
    try:
        require_file(path)
        found = extract("parquet", path, {"metadata": "rotorid"}).facts["metadata"]
        came = f"{path} is {visible(found) or 'not a table of rotorid'}"
    except LogError as error:
        found, came = "", f"{path} is not a table of rotorid: {error.came}"
    except OSError as error:
        found, came = "", f"{path} cannot be read: {error.strerror}"
    if found != SCHEMA:
        raise UsageError(came, needed=SCHEMA, remedy="choose another folder with --out")


def require_parquet() -> None:
    """Refuse to begin where the table could not be written.

    Raises
    ------
    UsageError
        pyarrow is missing.
    """
    from importlib.util import find_spec

    if find_spec("pyarrow") is None:
        raise UsageError("the table of a fleet needs pyarrow", remedy="pip install 'rotorid[parquet]'")
