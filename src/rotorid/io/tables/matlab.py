"""MATLAB files: plain arrays, structs and identification data, named by a mapping or by the vocabulary.

Files up to version 7 are read by SciPy, those of 7.3 are HDF5 and need the extra ``hdf5``. Both run in the sandbox's
child: a hostile file can crash the library that reads it.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from rotorid.data.record import FlightRecord, Source
from rotorid.errors import LogError
from rotorid.io import sandbox as sandboxed
from rotorid.io.files import UnpackLimits
from rotorid.io.sandbox import Extract
from rotorid.io.tables.mapped import assemble, by_variables, sampling_instants, sources_of
from rotorid.io.tables.mapping import ChannelMapping
from rotorid.typing import AnyArray

FORMAT = "MATLAB"

_MAGIC = b"MATLAB 5.0 MAT-file"


def sniff(head: bytes) -> bool:
    """Whether a file that starts like this is a MATLAB file of version 5 to 7, or HDF5, as which 7.3 is written."""
    return head.startswith((_MAGIC, *MAGICS))


def read(path: Path, source: Source, mapping: ChannelMapping | None = None, *, sandbox: bool = True) -> FlightRecord:
    """Read a MATLAB file.

    Parameters
    ----------
    path
        A file saved by MATLAB, Octave or SciPy; version 7.3, which is HDF5, needs the extra ``hdf5``.
    source
        Name, format and hash of the file as the user gave it.
    mapping
        Where each channel stands. Without one, the variables (or the fields of the one struct that holds ``time``)
        must carry the names of the vocabulary, in SI units. A struct with the fields of an ``iddata`` object has a
        clock named ``SamplingInstants`` (see `rotorid.io.tables.mapped.sampling_instants`); the object itself is saved
        in a form that only MATLAB understands.
    sandbox
        Parse in a child process with limits.

    Raises
    ------
    LogError
        The file is damaged, needs an extra that is not installed, or holds nothing with a known name.
    UsageError
        The mapping does not fit the file.
    """
    options = {"names": list(sources_of(mapping)) if mapping else []}
    if sandbox:
        extract = sandboxed.extract("mat", path, options, name=source.name)
    else:
        extract = sandboxed.extract_here("mat", path, options)
    arrays = {name: np.asarray(array, dtype=np.float64) for name, array in extract.arrays.items()}
    return assemble(arrays, mapping or by_variables(arrays, source.name), source)


def extract(path: Path, options: Mapping[str, Any]) -> Extract:
    """Numeric arrays of a MATLAB file by dotted names. Runs in the sandbox's child.

    Parameters
    ----------
    path
        A MATLAB or HDF5 file.
    options
        ``names``: what to bring back. When one of them is missing, or none is given, everything is brought back, so
        that the message about it can say what there is.
    """
    with path.open("rb") as file:
        arrays = numbers_of(path) if file.read(128).startswith(MAGICS) else _numbers_before_7_3(path)
    arrays |= sampling_instants(arrays)
    names = options["names"]
    if names and arrays.keys() >= set(names):
        arrays = {name: arrays[name] for name in names}
    if len(arrays) > _MOST_ARRAYS:
        raise LogError(
            f"{path.name} has {len(arrays)} arrays",
            needed=f"at most {_MOST_ARRAYS}",
            remedy="save the needed ones only",
        )
    return Extract(arrays=arrays, facts={})


def _numbers_before_7_3(path: Path) -> dict[str, AnyArray]:
    from scipy.io import loadmat

    _require_few_parts(path)
    content = loadmat(path, struct_as_record=False, squeeze_me=True, appendmat=False)
    return dict(
        item for name, value in content.items() if not name.startswith("__") for item in _flattened(name, value, 0)
    )


def _require_few_parts(path: Path) -> None:
    """Refuse structs and cells of so many parts that SciPy, at 70 µs each, would take longer than a log may.

    Parts that are damaged are left to SciPy, which says so.
    """
    data = memoryview(path.read_bytes())
    order: Literal["little", "big"] = "little" if bytes(data[126:128]) == b"IM" else "big"
    count, at = 0, 128
    while at + 8 <= len(data):
        kind, begin, end, at = _element(data, at, order)
        part = data[begin:end]
        if kind == _COMPRESSED:
            # As many bytes as so many parts take; more of them are refused before that.
            try:
                part = memoryview(zlib.decompressobj().decompress(part, _MOST_PARTS * _BYTES_OF_PART))
            except zlib.error:
                return
            kind, begin, end, _ = _element(part, 0, order)
            part = part[begin:end]
        if kind == _MATRIX:
            count += _parts(part, order, _MOST_PARTS - count)
        if count >= _MOST_PARTS:
            raise LogError(
                f"{path.name} has more than {_MOST_PARTS} arrays in its structs and cells",
                needed=f"at most {_MOST_PARTS}",
                remedy="save the needed ones only",
            )


def _element(data: memoryview, at: int, order: Literal["little", "big"]) -> tuple[int, int, int, int]:
    """Kind of the element at a place, begin and end of its data, and the place of the next one."""
    word = int.from_bytes(data[at : at + 4], order)
    if word >> 16:  # up to four bytes stand in the tag itself
        return word & 0xFFFF, at + 4, at + 4 + (word >> 16), at + 8
    end = at + 8 + int.from_bytes(data[at + 4 : at + 8], order)
    # Only what is compressed is not padded.
    return word, at + 8, end, end if word == _COMPRESSED else end + (-end + at) % 8


def _parts(data: memoryview, order: Literal["little", "big"], most: int) -> int:
    """Matrices in a matrix, itself among them; no more than ``most`` are counted."""
    count, waiting = 0, [data]
    while waiting and count < most:
        matrix = waiting.pop()
        count += 1
        if len(matrix) < _LEAST_MATRIX_BYTES:
            continue
        kind = int.from_bytes(matrix[8:12], order) & 0xFF
        # Flags, sizes, the name; the class of objects; length of the names of fields, and these.
        heads = {_CELL: 3, _STRUCT: 5, _OBJECT: 6}.get(kind, 0)
        at = 0
        for _ in range(heads):
            at = _element(matrix, at, order)[3]
        while heads and at + 8 <= len(matrix) and count + len(waiting) < most:
            _, begin, end, at = _element(matrix, at, order)
            waiting.append(matrix[begin:end])
    return count + len(waiting)


def _flattened(name: str, value: object, depth: int) -> Iterator[tuple[str, AnyArray]]:
    """Real numbers in a variable, in its structs (``a.b``) and in its cells (``a[0,1]``); text carries no channels."""
    if depth > _DEEPEST:
        return
    if isinstance(value, np.ndarray) and value.dtype.hasobject:
        if value.dtype.names is None and value.size <= _MOST_CELLS:
            for index in np.ndindex(value.shape):
                yield from _flattened(f"{name}[{','.join(map(str, index))}]", value[index], depth + 1)
    elif hasattr(value, "_fieldnames"):
        for label in value._fieldnames:
            yield from _flattened(f"{name}.{label}", getattr(value, label), depth + 1)
    elif isinstance(value, np.ndarray | int | float | np.number):
        array = np.asarray(value)
        if array.dtype.kind in "biuf":
            yield name, array


MAGICS = (b"MATLAB 7.3 MAT-file", b"\x89HDF\r\n\x1a\n")

_DEEPEST = 16
_MOST_CELLS = 1000
_MOST_ARRAYS = 5000
_MOST_PARTS = 20_000
_BYTES_OF_PART = 256
_LEAST_MATRIX_BYTES = 16
_MATRIX, _COMPRESSED = 14, 15
_CELL, _STRUCT, _OBJECT = 1, 2, 3
_OLDER = "in MATLAB, load it and save it again with `save(NAME, '-v7')`"


def numbers_of(path: Path) -> dict[str, AnyArray]:
    """All real numbers of a file.

    Structs and groups give ``a.b``, cells ``a[0,1]``. MATLAB stores its arrays transposed, which is undone, and scalars
    as matrices, whose axes of length one are dropped as they are for older versions; a plain HDF5 file is taken as it
    stands.

    Parameters
    ----------
    path
        A file that MATLAB saved with ``-v7.3``, or any other HDF5 file.

    Raises
    ------
    LogError
        h5py is not installed, the file is damaged, or its arrays declare more memory than a log may take.
    """
    try:
        import h5py
    except ImportError as error:
        raise LogError(
            f"{path.name} is a MATLAB file of version 7.3 or another HDF5 file, and h5py is not installed",
            needed="the extra [hdf5]",
            remedy=f"run `pip install 'rotorid[hdf5]'`, or {_OLDER}",
        ) from error
    try:
        with h5py.File(path, "r", locking=False) as file:
            return dict(_Visit(path, file).group("", file, 0))
    # h5py passes on whatever the library trips over; RuntimeError and KeyError are damaged links and types.
    except (OSError, RuntimeError, KeyError, ValueError, TypeError) as error:
        raise LogError(
            f"{path.name} cannot be read as HDF5: {str(error)[:200]}", needed="an undamaged file", remedy=_OLDER
        ) from error


class _Visit:
    """One pass over a file, which counts what its arrays will take and enters no group twice."""

    def __init__(self, path: Path, file: Any) -> None:
        limits = UnpackLimits()
        size_bytes = path.stat().st_size
        with path.open("rb") as stream:
            self._is_matlab = stream.read(len(MAGICS[0])) == MAGICS[0]
        self._name, self._file = path.name, file
        self._allowed = min(limits.size_bytes, max(limits.free_bytes, int(limits.ratio * size_bytes)))
        self._taken = 0
        self._entered: set[Any] = set()

    def group(self, name: str, group: Any, depth: int) -> Iterator[tuple[str, AnyArray]]:
        """Numbers in a group; links to other files are not followed, which could read anything on this machine."""
        import h5py

        if depth > _DEEPEST or not self._is_new(group):
            return
        for label in group:
            # MATLAB keeps what cells refer to in groups of its own, `#refs#` and `#subsystem#`.
            if not label.startswith("#") and isinstance(group.get(label, getlink=True), h5py.HardLink):
                yield from self._item(f"{name}.{label}" if name else label, group[label], depth + 1)

    def _item(self, name: str, item: Any, depth: int) -> Iterator[tuple[str, AnyArray]]:
        import h5py

        if isinstance(item, h5py.Group):
            yield from self.group(name, item, depth)
        elif isinstance(item, h5py.Dataset):
            if h5py.check_ref_dtype(item.dtype) is not None:
                yield from self._cells(name, item, depth)
            elif item.dtype.kind in "biuf" and item.shape is not None and item.attrs.get("MATLAB_class") != b"char":
                yield name, self._array(name, item)

    def _cells(self, name: str, dataset: Any, depth: int) -> Iterator[tuple[str, AnyArray]]:
        """Numbers that the references of a cell, or of a field in an array of structs, lead to."""
        import h5py

        if depth > _DEEPEST or dataset.size > _MOST_CELLS or not self._is_new(dataset):
            return
        references = self._oriented(self._loaded(name, dataset))
        for index in np.ndindex(references.shape):
            if isinstance(references[index], h5py.Reference) and references[index]:
                label = f"{name}[{','.join(map(str, index))}]" if index else name
                yield from self._item(label, self._file[references[index]], depth + 1)

    def _array(self, name: str, dataset: Any) -> AnyArray:
        if dataset.attrs.get("MATLAB_empty"):
            return np.empty(0)
        return self._oriented(self._loaded(name, dataset))

    def _oriented(self, array: AnyArray) -> AnyArray:
        return np.squeeze(array.T) if self._is_matlab else array

    def _loaded(self, name: str, dataset: Any) -> AnyArray:
        """The content, once its declared size was found possible and all of it stands in this file."""
        if dataset.external or dataset.is_virtual:
            raise LogError(
                f"{self._name}: {name} is in another file",
                needed="a file that contains its own arrays",
                remedy="save the array itself",
            )
        # Everything leaves as double precision.
        self._taken += dataset.size * max(dataset.dtype.itemsize, 8)
        if self._taken > self._allowed:
            raise LogError(
                f"{self._name} declares arrays of more than {self._allowed / 2**20:.0f} MiB, {name} of shape "
                f"{dataset.shape} among them",
                needed="arrays that fit into a file of this size",
                remedy="save the channels that are needed, without compression, if it is really a flight log",
            )
        content: AnyArray = dataset[()]
        return np.asarray(content)

    def _is_new(self, item: Any) -> bool:
        import h5py

        place = h5py.h5o.get_info(item.id).addr
        if place in self._entered:
            return False
        self._entered.add(place)
        return True
