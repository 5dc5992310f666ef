"""The formats that are known, and the two verbs on them: read a file of any of them, write a simulated flight as one.

A format is judged by the content, never by the extension. Readers do not know each other; this module knows them all by
the names of their modules, and imports only the one that is needed.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.autopilots.autopilot import LogFormat
from rotorid.autopilots.registry import named
from rotorid.data.flight_plan import SimulatedFlight
from rotorid.data.record import FlightRecord, Source
from rotorid.data.sensor_filters import with_sensor_filters
from rotorid.errors import LogError, UsageError
from rotorid.io.blank import blank_tail
from rotorid.io.documents import held_documents, require_file
from rotorid.io.files import compression_of, sha256_of, unpacked
from rotorid.io.formats import HEAD_BYTES, READ, READERS, WRITERS, Reader
from rotorid.io.motor_speeds import checked_speeds
from rotorid.io.screening import screened
from rotorid.io.tables.contradictions import require_agreement
from rotorid.io.tables.csv import table_rate_hz
from rotorid.io.tables.mapped import joined
from rotorid.io.tables.mapping import ChannelMapping, read_mapping
from rotorid.letters import visible

_DECRYPT = "decrypt it with decrypt_logs.py of PX4's Tools/log_encryption and your private key, and give the .ulg"
_NAMES_ALONE = "delete the lines above the names of the columns, and name the channels: --map FILE.toml"
_FOREIGN: tuple[tuple[bytes, str, str], ...] = (
    (b"ULogEnc", "an encrypted PX4 log (.ulge)", _DECRYPT),
    (b"ULogKey", "the key of an encrypted PX4 log (.ulgk)", _DECRYPT),
    (b"\x93NUMPY", "a NumPy array", "save it as CSV with a header"),
    (b"%PDF", "a PDF document", "give the flight log itself"),
    (b"<", "a web page or an XML file", "download the log itself, not the page about it"),
    (b"{", "a JSON document", "give the flight log itself"),
    *((name + end, "Vicon's export", _NAMES_ALONE) for name in (b"Objects", b"Trajectories") for end in (b"\n", b"\r")),
    (b"Format Version,", "OptiTrack's export", _NAMES_ALONE),
)


def read(
    path: str | os.PathLike[str],
    *,
    mapping: ChannelMapping | str | os.PathLike[str] | None = None,
    sandbox: bool = True,
) -> FlightRecord:
    r"""Read a flight log of any known format.

    Parameters
    ----------
    path
        A log: PX4 ``.ulg``, ArduPilot ``.BIN``, MATLAB ``.mat`` or CSV, also compressed. The content decides, the
        extension does not matter.
    mapping
        Names the channels of a CSV, MATLAB, NPZ, Parquet or ROS file: the path of a TOML file, or what
        `rotorid.io.tables.mapping.read_mapping` made of it. Some of the channels may stand in other files below the
        folder of the log.
    sandbox
        Let foreign parsers run in a child process with limits of memory and time. Switch it off only for files that you
        trust, where processes cannot be started.

    Returns
    -------
    FlightRecord
        Every channel that the package has a name for, each topic on its own clock, with the remarks of the reader.

    Raises
    ------
    LogError
        The file is missing, empty, damaged beyond reading, or no flight log.
    UsageError
        The mapping is wrong, or was given for a format that names its own channels.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     log = Path(folder) / "flight.csv"
    ...     _ = log.write_text("time [s],q [deg/s]\n0,180\n0.004,0\n")
    ...     record = read(log)
    >>> record.channel_names, record.source.format
    (('q',), 'CSV')
    >>> record.topics[0].values.round(4).tolist()
    [[3.1416, 0.0]]
    """
    # Any bits may stand in the place of a number: what is none leaves in the screen, and is no warning of arithmetic.
    with np.errstate(all="ignore"):
        return _read(Path(path), mapping, sandbox=sandbox)


def _read(path: Path, mapping: ChannelMapping | str | os.PathLike[str] | None, *, sandbox: bool) -> FlightRecord:
    named_by = ""
    if mapping is not None and not isinstance(mapping, ChannelMapping):
        named_by = visible(Path(mapping).name)
        mapping = read_mapping(Path(mapping))
    if path.is_dir() and mapping is None:
        return checked_record(_read_folder(path), None)
    parts = {file: mapping.part(file) for file in mapping.files} if mapping else {}
    record = _read_file(path, parts.pop("", None), sandbox=sandbox)
    others = {file: _read_file(_below(path.parent, file), part, sandbox=sandbox) for file, part in parts.items()}
    return checked_record(joined(record, others), mapping, named_by)


def checked_record(record: FlightRecord, mapping: ChannelMapping | None, named_by: str = "") -> FlightRecord:
    """A record that has passed the checks of every log: by its mapping, of impossible values and of motor speeds.

    Records of arrays pass the same ones.

    Parameters
    ----------
    named_by
        Name of the file of the mapping, where it has one.

    Raises
    ------
    UsageError
        The samples contradict the mapping.
    LogError
        Nothing was logged.
    """
    if mapping is not None:
        require_agreement(record, mapping)
        (record,) = with_sensor_filters((record,), mapping.filters, option=f"the mapping {named_by}".rstrip())
    if named_by:
        record = replace(record, source=replace(record.source, mapping=named_by))
    with np.errstate(all="ignore"):
        return checked_speeds(screened(record))


def _read_file(path: Path, mapping: ChannelMapping | None, *, sandbox: bool) -> FlightRecord:
    """One file by the reader of its format; of one that is blank from a place on, that is said first."""
    with _opened(path) as (log, head):
        blank = blank_tail(log)
        try:
            record = _read_opened(path, log, head, mapping, sandbox=sandbox)
        except LogError as error:
            if blank is None:
                raise
            raise blank.error(visible(path.name), error) from error
    finding = blank and blank.finding()
    return replace(record, findings=(finding, *record.findings)) if finding else record


def _read_opened(path: Path, log: Path, head: bytes, mapping: ChannelMapping | None, *, sandbox: bool) -> FlightRecord:
    """A file by the reader of its format: ``log`` is what ``path`` holds unpacked."""
    if mapping is None and _is_topic(path.name, head):
        return _read_topic(log, path)
    reader, module = _reader_of(head, path.name)
    options: dict[str, Any] = {"sandbox": sandbox} if reader.takes_sandbox else {}
    if reader.takes_mapping:
        options["mapping"] = mapping
    elif mapping is not None:
        raise UsageError(
            f"a mapping was given for {path.name}, which is {module.FORMAT}",
            needed="a mapping for CSV, MATLAB, NPZ, Parquet and ROS files only",
            remedy="leave --map out: this format names its own channels",
        )
    source = Source(name=visible(path.name), format=module.FORMAT, sha256=sha256_of(path))
    try:
        record: FlightRecord = module.read(log, source, **options)
    except LogError as error:
        if source.name in error.came:
            raise
        raise LogError(f"{source.name}: {error.came}", needed=error.needed, remedy=error.remedy) from error
    return record


def _below(folder: Path, file: str) -> Path:
    """A file that a mapping names, once it is certain that no link leads out of the log's folder."""
    place = folder / file
    if not place.resolve().is_relative_to(folder.resolve()):
        raise UsageError(
            f"{file}, which the mapping names, is outside the folder of the log",
            needed="a file below that folder",
            remedy="copy the file next to the log",
        )
    return place


def _read_folder(path: Path) -> FlightRecord:
    """The log that was exported into a folder, topic by topic."""
    from rotorid.io.px4.folder import FORMAT, is_folder_log, read_folder

    if not is_folder_log(path):
        held = held_documents(path)
        raise LogError(
            f"{path.name or path} is a folder" + (f" with {held} and no log" if held else ""),
            needed=f"one flight log: {READ}",
            remedy="give the log itself" if held else "give a file in it, or a folder of ulog2csv files",
        )
    return read_folder(path, Source(name=visible(path.name), format=FORMAT, sha256=""))


def _is_topic(name: str, head: bytes) -> bool:
    # The name alone shows the topic, and few files begin with this word: nothing of PX4 is imported for the others.
    return head.startswith(b"timestamp,") and bool(import_module("rotorid.io.px4.folder").is_topic_file(name, head))


def _read_topic(log: Path, path: Path) -> FlightRecord:
    """One topic of a log that was exported into a folder."""
    from rotorid.io.px4.folder import FORMAT, read_topic

    return read_topic(log, Source(name=visible(path.name), format=FORMAT, sha256=sha256_of(path)))


@contextmanager
def _opened(path: Path) -> Iterator[tuple[Path, bytes]]:
    """The log behind a path, unpacked when it was compressed, and its first bytes."""
    head = _head(path, path.name)
    compression = compression_of(head)
    # An NPZ file is a zip archive itself.
    if not compression or import_module("rotorid.io.tables.npz").sniff(head):
        yield path, head
        return
    with unpacked(path, compression) as log:
        yield log, _head(log, path.name)


def _head(path: Path, name: str) -> bytes:
    if path.is_dir():
        raise LogError(
            f"{name or path} is a folder",
            needed=f"one flight log: {READ}",
            remedy="give a file in it, without a mapping",
        )
    try:
        require_file(path)
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
    # ValueError is Python's word for a name that no file can have.
    except (OSError, ValueError) as error:
        why = f"{path} cannot be opened: {getattr(error, 'strerror', None) or error}"
        raise LogError(why, remedy="check the path and the permissions") from error
    if not head:
        raise LogError(f"{name} is empty", needed=f"a flight log: {READ}", remedy="copy it again from the vehicle")
    return head


def _reader_of(head: bytes, name: str) -> tuple[Reader, Any]:
    came, remedy = "not in a known format", "give the log that the autopilot wrote, or export the data to CSV"
    foreign = next((known for known in _FOREIGN if head.startswith(known[0])), None)
    for reader in READERS:
        # The last one takes nearly every text for a table, also one that is known to be something else.
        if foreign is not None and reader is READERS[-1]:
            break
        module = import_module(reader.module)
        if module.sniff(head):
            return reader, module
    if foreign is not None:
        _, came, remedy = foreign
    elif compression_of(head):
        came, remedy = "an archive inside an archive", "unpack it and give the log itself"
    raise LogError(f"{name} is {came}", needed=f"a flight log: {READ}", remedy=remedy)


def format_of(autopilot: str) -> LogFormat:
    """The format in which an autopilot logs; a table for one without a format of its own.

    Parameters
    ----------
    autopilot
        Name of the autopilot.

    Examples
    --------
    >>> format_of("px4"), format_of("ardupilot"), format_of("simple")
    ('ulg', 'bin', 'csv')
    """
    return named(autopilot).log_format


def log_rate_hz(format: LogFormat, loop_rate_hz: float) -> float:
    """Rate at which a log holds commands and rates of a loop.

    Parameters
    ----------
    format
        Of the log.
    loop_rate_hz
        Rate of the loop.

    Examples
    --------
    >>> log_rate_hz("bin", 400.0), log_rate_hz("csv", 1000.0)
    (400.0, 500.0)
    """
    return table_rate_hz(loop_rate_hz) if format == "csv" else loop_rate_hz


def write_log(path: str | os.PathLike[str], flight: SimulatedFlight, *, format: LogFormat) -> None:
    """Write a flight so that :func:`read` reads it back like any other log.

    Parameters
    ----------
    path
        File to write or replace, whole or not at all.
    flight
        The flight.
    format
        ``ulg`` as PX4 would have logged it, ``bin`` as ArduPilot, ``bbl`` as Betaflight, or ``csv``: every channel at
        the rate of the loop, or at the next part of it that is 500 Hz or less.

    Raises
    ------
    UsageError
        There is no such format, a signal holds something that is no number, or the place cannot be written.
    """
    if format not in WRITERS:
        raise UsageError(f"unknown log format {format!r}", needed=f"one of {', '.join(WRITERS)}")
    writer = WRITERS[format]
    getattr(import_module(writer.module), writer.name)(Path(path), flight, start_s=writer.start_s)
