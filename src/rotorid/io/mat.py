"""MATLAB files of version 5 to 7: plain arrays and structs, named by a mapping or by the vocabulary."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.data.channel import STANDARD_UNITS
from rotorid.data.record import FlightRecord, Source
from rotorid.errors import LogError
from rotorid.io import sandbox as sandboxed
from rotorid.io.mapped import assemble, sources_of
from rotorid.io.mapping import ChannelMapping, Clock, MappedChannel, Series
from rotorid.io.sandbox import Extract
from rotorid.typing import AnyArray

FORMAT = "MATLAB"

_MAGIC = b"MATLAB 5.0 MAT-file"
_HDF5_MAGICS = (b"MATLAB 7.3 MAT-file", b"\x89HDF\r\n\x1a\n")
_DEEPEST = 16
_MOST_CELLS = 1000


def sniff(head: bytes) -> bool:
    """Whether a file that starts like this is a MATLAB file, of a version that is read or of 7.3."""
    return head.startswith((_MAGIC, *_HDF5_MAGICS))


def read(path: Path, source: Source, mapping: ChannelMapping | None = None, *, sandbox: bool = True) -> FlightRecord:
    """Read a MATLAB file.

    Parameters
    ----------
    path
        A file saved by MATLAB (``-v6`` or ``-v7``), Octave or SciPy.
    source
        Name, format and hash of the file as the user gave it.
    mapping
        Where each channel stands. Without one, the variables (or the fields of the one struct that holds ``time``)
        must carry the names of the vocabulary, in SI units.
    sandbox
        Parse in a child process with limits.

    Raises
    ------
    LogError
        The file is damaged, of version 7.3, or holds nothing with a known name.
    UsageError
        The mapping does not fit the file.
    """
    with path.open("rb") as file:
        if file.read(128).startswith(_HDF5_MAGICS):
            raise LogError(
                f"{source.name} is a MATLAB file of version 7.3 (HDF5)",
                needed="version 5 to 7",
                remedy="in MATLAB, load it and save it again with `save(NAME, '-v7')`",
            )
    options = {"names": list(sources_of(mapping)) if mapping else []}
    if sandbox:
        extract = sandboxed.extract("mat", path, options, name=source.name)
    else:
        extract = sandboxed.extract_here("mat", path, options)
    arrays = {name: np.asarray(array, dtype=np.float64) for name, array in extract.arrays.items()}
    return assemble(arrays, mapping or _by_vocabulary(arrays, source.name), source)


def extract(path: Path, options: Mapping[str, Any]) -> Extract:
    """Numeric arrays of a MATLAB file by dotted names. Runs in the sandbox's child.

    Parameters
    ----------
    path
        A file of version 5 to 7.
    options
        ``names``: what to bring back. When one of them is missing, or none is given, everything is brought back, so
        that the message about it can say what there is.
    """
    from scipy.io import loadmat

    content = loadmat(path, struct_as_record=False, squeeze_me=True, appendmat=False)
    arrays = dict(
        item for name, value in content.items() if not name.startswith("__") for item in _flattened(name, value, 0)
    )
    names = options["names"]
    if names and arrays.keys() >= set(names):
        arrays = {name: arrays[name] for name in names}
    return Extract(arrays=arrays, facts={})


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


def _by_vocabulary(arrays: Mapping[str, AnyArray], file: str) -> ChannelMapping:
    """The mapping that says the names mean themselves, for variables next to the one called ``time``."""
    clocks = [name for name in arrays if name.rpartition(".")[2] == "time"]
    prefix = clocks[0].removesuffix("time") if clocks else ""
    channels = tuple(
        MappedChannel(name=label, samples=Series(source=name))
        for name in arrays
        if name.startswith(prefix) and (label := name.removeprefix(prefix)) in STANDARD_UNITS
    )
    if len(clocks) != 1 or not channels:
        held = ", ".join(list(arrays)[:20]) or "no numbers at all"
        raise LogError(
            f"{file} holds {held}",
            needed="one variable `time` (s) and variables with names such as pitch_command, q, az",
            remedy="name its variables with a mapping: --map FILE.toml",
        )
    return ChannelMapping(channels=channels, clock=Clock(time=Series(source=clocks[0])))
