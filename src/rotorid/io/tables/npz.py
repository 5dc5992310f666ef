"""NumPy archives (``.npz``): named arrays of numbers, without pickles and without more memory than they may take."""

from __future__ import annotations

import math
import re
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rotorid.data.record import FlightRecord, Source
from rotorid.errors import LogError, UsageError
from rotorid.io.documents import require_file
from rotorid.io.files import UnpackLimits
from rotorid.io.tables.mapped import assemble, by_variables, sources_of
from rotorid.io.tables.mapping import ChannelMapping
from rotorid.typing import AnyArray

FORMAT = "NumPy archive"

# RuntimeError is zipfile's word for an encrypted member, NotImplementedError for a method that it does not know,
# UnicodeDecodeError and ValueError for names and offsets that are none, TypeError NumPy's for numbers of no width.
_DAMAGE = (zipfile.BadZipFile, zlib.error, EOFError, OSError, RuntimeError, ValueError, TypeError)
_ZIP = b"PK\x03\x04"
_NPY = b"\x93NUMPY"
_LONGEST_HEADER = 10_000
_MOST_DIMENSIONS = 32
# The header is a Python literal; only the form that NumPy writes is understood, so that nothing has to be evaluated.
# Nothing that was taken is given back, and each size of the shape ends with a comma or is the last one.
_HEADER = re.compile(
    r"\{'descr': (?P<type>'[^']*+'|\[[^\]]*+\]), 'fortran_order': (?P<columns>True|False), "
    r"'shape': \((?P<shape>(?:\d{1,18}+, ?+)*+(?:\d{1,18}+)?+)\),?+ ?+\}\s*+",
)
_SIZE = re.compile(r"\d++")
_NUMBERS = re.compile(r"'[<>|=][biuf]\d{1,2}'")
_OF_RESULTS = re.compile(r"'[<>|=][biufcU]\d{1,6}'")


@dataclass(frozen=True, kw_only=True, slots=True)
class _Layout:
    """What the header of a member declares; ``dtype`` is ``None`` for text, objects and records."""

    dtype: np.dtype[np.generic] | None
    by_columns: bool
    shape: tuple[int, ...]
    data_start: int


def sniff(head: bytes) -> bool:
    """Whether a file that starts like this is an NPZ: a zip whose first member is called ``NAME.npy``."""
    length = int.from_bytes(head[26:28], "little")
    return head.startswith(_ZIP) and head[30 : 30 + length].endswith(b".npy")


def read(path: Path, source: Source, mapping: ChannelMapping | None = None) -> FlightRecord:
    """Read a NumPy archive.

    Parameters
    ----------
    path
        A file that ``numpy.savez`` or ``numpy.savez_compressed`` wrote.
    source
        Name, format and hash of the file as the user gave it.
    mapping
        Which array is which channel. Without one, the arrays must carry the names of the vocabulary, in SI units, next
        to one called ``time``. Arrays of text and of Python objects are never read.

    Raises
    ------
    LogError
        The file is damaged, would take more memory than a log may, or holds nothing with a known name.
    UsageError
        The mapping does not fit the file.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            arrays, mapping = _arrays(archive, path.stat().st_size, mapping, source.name)
    except _DAMAGE as error:
        raise LogError(
            f"{source.name} cannot be read as a NumPy archive: {error}",
            needed="an undamaged file, as numpy.savez writes it",
            remedy="save it again",
        ) from error
    return assemble(arrays, mapping, source)


def read_arrays(path: Path) -> dict[str, AnyArray]:
    """All arrays of numbers and of texts of an archive of ours, within the limits that logs have.

    Parameters
    ----------
    path
        A file as :func:`rotorid.io.files.write_npz` writes it.

    Raises
    ------
    UsageError
        It cannot be read, is damaged, or asks for more memory than it may.
    """
    try:
        require_file(path)
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            _check_size(sum(item.file_size for item in members), path.stat().st_size, path.name)
            layouts = {item.filename: _layout(archive, item, _OF_RESULTS) for item in members}
            return {
                item.filename.removesuffix(".npy"): _load(archive, item, layouts[item.filename])
                for item in members
                if layouts[item.filename].dtype is not None
            }
    except LogError as error:
        raise UsageError(error.came, needed=error.needed, remedy=error.remedy) from None
    except _DAMAGE as error:
        raise UsageError(
            f"{path} cannot be read as a NumPy archive: {error!s:.200}",
            needed="the file that identify wrote with the result",
            remedy="run identify again",
        ) from error


def _arrays(
    archive: zipfile.ZipFile, packed_bytes: int, mapping: ChannelMapping | None, file: str
) -> tuple[Mapping[str, AnyArray], ChannelMapping]:
    """The arrays that are needed, as floating-point numbers, and the mapping that names them."""
    members = {
        item.filename.removesuffix(".npy"): item for item in archive.infolist() if item.filename.endswith(".npy")
    }
    layouts = {name: _layout(archive, item) for name, item in members.items()}
    numeric = [name for name, layout in layouts.items() if layout.dtype is not None]
    mapping = mapping or by_variables(numeric, file)
    wanted = [name for name in sources_of(mapping) if name in numeric]
    if len(wanted) < len(sources_of(mapping)):
        # The names alone, without samples, let the message about the missing one say what there is.
        return {name: np.empty(0) for name in numeric}, mapping
    _check_size(sum(members[name].file_size for name in wanted), packed_bytes, file)
    return {name: _load(archive, members[name], layouts[name]).astype(np.float64) for name in wanted}, mapping


def _check_size(size_bytes: int, packed_bytes: int, file: str) -> None:
    limits = UnpackLimits()
    allowed = min(limits.size_bytes, max(limits.free_bytes, int(limits.ratio * packed_bytes)))
    if size_bytes > allowed:
        raise LogError(
            f"{file} has {packed_bytes} bytes and declares arrays of {size_bytes / 2**20:.0f} MiB",
            needed=f"at most {allowed / 2**20:.0f} MiB",
            remedy="save the channels that are needed, without compression, if it is really a flight log",
        )


def _layout(archive: zipfile.ZipFile, item: zipfile.ZipInfo, understood: re.Pattern[str] = _NUMBERS) -> _Layout:
    """The header of a member, checked against its declared size before anything is taken."""
    if item.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise zipfile.BadZipFile(f"{item.filename} is packed by a method that NumPy does not write")
    with archive.open(item) as stream:
        start = stream.read(len(_NPY) + 2)
        if not start.startswith(_NPY) or len(start) < len(_NPY) + 2 or start[-2] not in (1, 2, 3):
            raise zipfile.BadZipFile(f"{item.filename} is not a NumPy array")
        width = 2 if start[-2] == 1 else 4
        length = int.from_bytes(stream.read(width), "little")
        text = stream.read(min(length, _LONGEST_HEADER)).decode("utf-8" if start[-2] == 3 else "latin-1")
    found = _HEADER.fullmatch(text)
    if found is None or length > _LONGEST_HEADER:
        raise zipfile.BadZipFile(f"the header of {item.filename} is damaged")
    shape = tuple(int(size) for size in _SIZE.findall(found["shape"]))
    layout = _Layout(
        dtype=np.dtype(found["type"].strip("'")) if understood.fullmatch(found["type"]) else None,
        by_columns=found["columns"] == "True",
        shape=shape,
        data_start=len(start) + width + length,
    )
    declared = math.prod(shape) * layout.dtype.itemsize if layout.dtype else 0
    if layout.dtype and (declared != item.file_size - layout.data_start or len(shape) > _MOST_DIMENSIONS):
        raise zipfile.BadZipFile(f"{item.filename} declares the shape {shape}, which its size contradicts")
    return layout


def _load(archive: zipfile.ZipFile, item: zipfile.ZipInfo, layout: _Layout) -> AnyArray:
    # zipfile stops at the declared size, and compares the checksum.
    data = archive.read(item)
    flat: AnyArray = np.frombuffer(data, dtype=layout.dtype, offset=layout.data_start)
    return flat.reshape(layout.shape, order="F" if layout.by_columns else "C")
