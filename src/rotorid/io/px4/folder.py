"""A folder of CSV files that ``ulog2csv`` made of a PX4 log, read like the log that it came from."""

from __future__ import annotations

import hashlib
import io
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rotorid.data.findings import Finding, warn
from rotorid.data.record import FlightRecord, Source
from rotorid.errors import LogError
from rotorid.io.formats import PACKED
from rotorid.io.parameters import kept_parameters
from rotorid.typing import AnyArray, FloatArray

FORMAT = "PX4 ULog as CSV"

_CLOCKS = ("timestamp", "timestamp_sample")
_LARGEST_STAMP_US = float(1 << 53)
# Nothing that was taken is given back: one pass over a line is all there is.
_NUMBER = r"[-+]?(?:\d++\.?\d*+|\.\d++)(?:[eE][-+]?\d++)?"
_ASSIGNED = re.compile(rf"([A-Za-z]\w*+)\s*+(?:(?:(?<=\s)|[=,])\s*+)({_NUMBER})\s*+;?")
_OCTAVE_NAME = re.compile(r"#\s*+name:?\s++([A-Za-z]\w*+)")
_ROW = re.compile(rf"{_NUMBER}(?:\s++{_NUMBER})*+")


@dataclass(frozen=True, kw_only=True, slots=True)
class _Export:
    """Files of one log: the first instance of each known topic, and the autopilot's parameters if they were kept."""

    topics: Mapping[str, Path]
    parameters: Path | None


def is_folder_log(path: Path) -> bool:
    """Whether a path is a folder that holds a known topic as ``PREFIX_TOPIC_0.csv``, as ``ulog2csv`` names it."""
    return path.is_dir() and any(_topic_of(file) for file in path.iterdir())


def read_folder(path: Path, source: Source) -> FlightRecord:
    """Read a folder of ``ulog2csv`` files.

    Topics, channels and clocks are those of the log itself; stamps are microseconds since the autopilot was switched
    on. What the CSV files do not hold is not known: firmware and dropouts of the logger. Parameters come from a file
    named ``parameters*`` or ``*_params*`` with lines ``NAME = VALUE``, ``NAME VALUE`` or Octave's text form; a line of
    any other kind is left out.

    Parameters
    ----------
    path
        The folder.
    source
        What is known of it; the hash, over names and contents of the files that belong to the log, is filled in.

    Raises
    ------
    LogError
        The folder holds no known topic or those of two logs, or a file is damaged; the message names file and line.
    """
    from rotorid.io.px4.log import record_of, wanted_fields

    export = _export(path, source.name)
    arrays: dict[str, AnyArray] = {}
    findings: list[Finding] = []
    fields = wanted_fields()
    for topic, file in export.topics.items():
        columns, cut_bytes = _columns(file, (*_CLOCKS, *fields[topic]))
        arrays |= {f"{topic}/{name}": values for name, values in columns.items()}
        findings += [_cut(file.name, cut_bytes)] if cut_bytes else []
    size_bytes = sum(file.stat().st_size for file in export.topics.values())
    parameters = kept_parameters(_parameters(export.parameters)) if export.parameters else {}
    facts = {"parameters": parameters, "damage": [], "dropouts": [], "size_bytes": size_bytes}
    record = record_of(arrays, facts, replace(source, sha256=_sha256(export)))
    return replace(record, findings=(*findings, *record.findings))


def read_topic(path: Path, source: Source) -> FlightRecord:
    """Read a single file of ``ulog2csv``: one topic of a log, which its name shows.

    Raises
    ------
    LogError
        The file is damaged, or holds no channel that the package has a name for.
    """
    from rotorid.io.px4.log import record_of, wanted_fields

    named = _named(_unpacked(source.name))
    topic = named[1] if named else ""
    columns, cut_bytes = _columns(path, (*_CLOCKS, *wanted_fields().get(topic, ())))
    facts = {"parameters": {}, "damage": [], "dropouts": [], "size_bytes": path.stat().st_size}
    arrays = {f"{topic}/{name}": values for name, values in columns.items()}
    record = record_of(arrays, facts, replace(source, format=FORMAT))
    # What one topic lacks, the log need not lack.
    others = [finding for finding in record.findings if finding.kind != "missing_channel"]
    finding = warn(
        "missing_channel",
        topic,
        f"{source.name} is one topic of a log; give the folder of all files that ulog2csv wrote for the others",
    )
    return replace(record, findings=(*([_cut(source.name, cut_bytes)] if cut_bytes else []), *others, finding))


def is_topic_file(name: str, head: bytes) -> bool:
    """Whether a file of this name that starts like this is one topic as ``ulog2csv`` wrote it, packed or not.

    Examples
    --------
    >>> is_topic_file("log_sensor_combined_0.csv.gz", b"timestamp,gyro_rad[0]"), is_topic_file("a.csv", b"timestamp,a")
    (True, False)
    """
    return head.startswith(b"timestamp,") and _named(_unpacked(name)) is not None


def _unpacked(name: str) -> Path:
    path = Path(name)
    return path.with_suffix("") if path.suffix in PACKED else path


def _topic_of(file: Path) -> tuple[str, str] | None:
    """Name of the log and of the topic in the name of a file that exists."""
    return _named(file) if file.is_file() else None


def _named(file: Path) -> tuple[str, str] | None:
    """Name of the log and of the topic in a file name; the longest topic that fits, since names are parts of names."""
    from rotorid.io.px4.log import wanted_fields

    endings = {
        topic: "_{}_{}".format(*(topic if ":" in topic else f"{topic}:0").split(":")) for topic in wanted_fields()
    }
    topic = max((topic for topic, ending in endings.items() if file.stem.endswith(ending)), key=len, default="")
    return (file.stem.removesuffix(endings[topic]), topic) if topic and file.suffix == ".csv" else None


def _export(path: Path, name: str) -> _Export:
    files = sorted(path.iterdir())
    found = [(file, known) for file in files if (known := _topic_of(file))]
    prefixes = sorted({prefix for _, (prefix, _) in found})
    if not found:
        raise LogError(
            f"the folder {name} contains no topic of a PX4 log",
            needed="files such as LOG_vehicle_angular_velocity_0.csv, made by ulog2csv",
            remedy="give the .ulg file itself",
        )
    if len(prefixes) > 1:
        raise LogError(
            f"the folder {name} contains the topics of {len(prefixes)} logs: {', '.join(prefixes[:5])}",
            needed="the files of one log",
            remedy="put each log into a folder of its own",
        )
    kept = [file for file in files if file.is_file() and _is_parameters(file, prefixes[0])]
    return _Export(topics={topic: file for file, (_, topic) in found}, parameters=kept[0] if kept else None)


def _is_parameters(file: Path, prefix: str) -> bool:
    return file.name.startswith("parameters") or (file.stem.startswith(prefix) and "_params" in file.name)


def _sha256(export: _Export) -> str:
    """One hash over the sorted names and the contents, each with its length, so that no two folders share one."""
    total = hashlib.sha256()
    files = [*export.topics.values(), *([export.parameters] if export.parameters else [])]
    for file in sorted(files, key=lambda file: file.name):
        total.update(f"{file.name}\0{file.stat().st_size}\0".encode())
        with file.open("rb") as stream:
            total.update(hashlib.file_digest(stream, "sha256").digest())
    return total.hexdigest()


def _columns(file: Path, wanted: Sequence[str]) -> tuple[dict[str, AnyArray], int]:
    """The wanted columns that a file has, stamps as unsigned microseconds, and the bytes of a last line that is cut."""
    try:
        text = file.read_bytes().decode("utf-8")
    except UnicodeDecodeError as error:
        raise _damaged(file.name, 1, "is not UTF-8 text") from error
    except OSError as error:
        raise LogError(f"{file.name} cannot be read: {error.strerror}", needed="a readable file") from error
    whole, _, cut = text.rpartition("\n")
    header, _, body = whole.partition("\n")
    names = header.strip().split(",")
    if names[0] != "timestamp" or len(set(names)) < len(names):
        raise _damaged(file.name, 1, "is no header that starts with `timestamp` and names each column once")
    indices = [names.index(name) for name in dict.fromkeys(wanted) if name in names]
    table = _table(file.name, body, indices, len(names))
    columns: dict[str, AnyArray] = {names[column]: table[:, place] for place, column in enumerate(indices)}
    for name in _CLOCKS:
        if name in columns:
            columns[name] = _stamps(file.name, columns[name])
    return columns, len(cut.encode())


def _table(file: str, body: str, indices: Sequence[int], width: int) -> FloatArray:
    lines = body.splitlines()
    wrong = next((number for number, line in enumerate(lines, start=2) if line.count(",") != width - 1), None)
    if wrong is not None:
        raise _damaged(file, wrong, f"has not the {width} cells of the header")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # a topic that was never published has a header alone
            return np.loadtxt(io.StringIO(body), delimiter=",", usecols=indices, comments=None, ndmin=2)
    except ValueError as error:
        raise _damaged(file, _first_text(lines, indices), "contains a cell that is no number") from error


def _first_text(lines: Sequence[str], indices: Sequence[int]) -> int:
    """Number of the first line with a wanted cell that is no number: slow, and only looked for when there is one."""
    for number, line in enumerate(lines, start=2):
        cells = line.split(",")
        try:
            for column in indices:
                float(cells[column])
        except ValueError:
            return number
    return 1


def _stamps(file: str, values: FloatArray) -> AnyArray:
    wrong = np.flatnonzero(~((values >= 0.0) & (values < _LARGEST_STAMP_US)))
    if wrong.size:
        raise _damaged(file, int(wrong[0]) + 2, "has a time stamp that is no count of microseconds")
    return values.astype(np.uint64)


def _damaged(file: str, line: int, reason: str) -> LogError:
    return LogError(
        f"{file}, line {line} {reason}", needed="a file as ulog2csv writes it", remedy="export it again from the .ulg"
    )


def _parameters(file: Path) -> dict[str, float]:
    text = file.read_text(encoding="utf-8", errors="replace")
    return {name: value for name, value in _assignments(text) if np.isfinite(value)}


def _assignments(text: str) -> Iterator[tuple[str, float]]:
    """Names and values, of the last value of a row where a parameter changed in flight."""
    named = ""
    for line in map(str.strip, text.splitlines()):
        if octave := _OCTAVE_NAME.fullmatch(line):
            named = octave[1]
        elif assigned := _ASSIGNED.fullmatch(line):
            yield assigned[1], float(assigned[2])
        elif named and _ROW.fullmatch(line):
            yield named, float(line.split()[-1])
            named = ""


def _cut(file: str, cut_bytes: int) -> Finding:
    return warn(
        "corrupt_log",
        file,
        f"{file} ends inside its last line: {cut_bytes} bytes were left out. Export it again from the .ulg.",
        lost_bytes=cut_bytes,
    )
