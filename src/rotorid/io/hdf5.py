"""Numbers in HDF5 files, MATLAB's version 7.3 among them, by dotted names. Needs the extra ``hdf5``.

Runs in the sandbox's child: a hostile HDF5 file can crash the library that reads it.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.errors import LogError
from rotorid.io.archive import UnpackLimits
from rotorid.typing import AnyArray

MAGICS = (b"MATLAB 7.3 MAT-file", b"\x89HDF\r\n\x1a\n")

_DEEPEST = 16
_MOST_CELLS = 1000
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
                f"{self._name}: {name} stands in another file",
                needed="a file that holds its own arrays",
                remedy="save the array itself",
            )
        # Everything leaves as double precision.
        self._taken += dataset.size * max(dataset.dtype.itemsize, 8)
        if self._taken > self._allowed:
            raise LogError(
                f"{self._name} declares arrays of more than {self._allowed / 2**20:.0f} MiB, {name} of shape "
                f"{dataset.shape} among them",
                needed="arrays that a file of its size can hold",
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
