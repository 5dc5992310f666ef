"""MATLAB files: plain arrays, structs and identification data, named by a mapping or by the vocabulary."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.data.record import FlightRecord, Source
from rotorid.io import sandbox as sandboxed
from rotorid.io.hdf5 import MAGICS, numbers_of
from rotorid.io.mapped import assemble, sources_of
from rotorid.io.mapping import ChannelMapping
from rotorid.io.naming import by_variables, sampling_instants
from rotorid.io.sandbox import Extract
from rotorid.typing import AnyArray

FORMAT = "MATLAB"

_MAGIC = b"MATLAB 5.0 MAT-file"
_DEEPEST = 16
_MOST_CELLS = 1000


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
        clock named ``SamplingInstants`` (see `rotorid.io.naming.sampling_instants`); the object itself is saved in a
        form that only MATLAB understands.
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
    return Extract(arrays=arrays, facts={})


def _numbers_before_7_3(path: Path) -> dict[str, AnyArray]:
    from scipy.io import loadmat

    content = loadmat(path, struct_as_record=False, squeeze_me=True, appendmat=False)
    return dict(
        item for name, value in content.items() if not name.startswith("__") for item in _flattened(name, value, 0)
    )


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
