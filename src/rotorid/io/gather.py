"""Bytes of a large file without a copy of it, and values collected from anywhere in them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np

from rotorid.errors import LogError
from rotorid.typing import AnyArray, IntArray

PART = 1 << 13
"""Places read at once: what stands around them fits into the cache, so that many values cost little more than one."""


def file_bytes(path: Path) -> AnyArray:
    """Content of a file, ``uint8``, mapped and read-only: only what is looked at is loaded, and may be evicted.

    The file must not be cut while the array is in use.

    Raises
    ------
    LogError
        The file cannot be read.
    """
    try:
        if path.stat().st_size == 0:
            return np.empty(0, dtype=np.uint8)
        # A plain view: indexing the subclass costs more than the indexing itself.
        return np.memmap(path, dtype=np.uint8, mode="r").view(np.ndarray)
    except OSError as error:
        raise LogError(f"{path.name} cannot be read: {error.strerror}", needed="a readable log file") from error


Place: TypeAlias = tuple[int, np.dtype[np.generic]]
"""Distance of a value behind a position in bytes, and its type as stored; it need not be aligned."""


def gather(data: AnyArray, positions: IntArray, places: Sequence[Place]) -> list[AnyArray]:
    """Values that stand at fixed distances behind each position, one array of shape ``(positions,)`` for each place.

    Parameters
    ----------
    data
        Bytes, ``uint8``.
    positions
        Every position must have room for all values behind it.
    places
        Distance and type of each value.

    Examples
    --------
    >>> data = np.frombuffer(b"-abc--def", dtype=np.uint8)
    >>> [values.tolist() for values in gather(data, np.array([0, 5]), [(1, np.dtype("S3")), (3, np.dtype("u1"))])]
    [[b'abc', b'def'], [99, 102]]
    """
    gathered: list[AnyArray] = [np.empty(positions.size, dtype=dtype) for _, dtype in places]
    gather_into(gathered, data, positions, places)
    return gathered


def gather_into(targets: Sequence[AnyArray], data: AnyArray, positions: IntArray, places: Sequence[Place]) -> None:
    """Do as `gather` does, but convert the values to the types of arrays that are there already and fill these."""
    if not positions.size or not places:
        return
    first = min(offset for offset, _ in places)
    width = max(offset + dtype.itemsize for offset, dtype in places) - first
    # Every byte starts an item of this overlapping view, so that one indexing collects the surroundings of many places.
    overlapping: AnyArray = np.ndarray(
        shape=(data.size - first - width + 1,),
        dtype=np.dtype((np.void, width)),
        buffer=data,
        offset=first,
        strides=(1,),
    )
    for begin in range(0, positions.size, PART):
        part = slice(begin, begin + PART)
        rows = overlapping[positions[part]].view(np.uint8).reshape(-1, width)
        for values, (offset, dtype) in zip(targets, places, strict=True):
            values[part] = rows[:, offset - first : offset - first + dtype.itemsize].view(dtype)[:, 0]
