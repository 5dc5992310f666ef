"""Which responses take part in a fit, by their names ``output/input``."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping

import numpy as np

from rotorid.data.response import FrequencyResponse
from rotorid.errors import UsageError
from rotorid.typing import BoolArray

_ROUNDING = 1e-9


def pair_names(data: FrequencyResponse) -> tuple[str, ...]:
    """Names of all responses, ``output/input``, in the order of their values."""
    return tuple(f"{output}/{source}" for output in data.outputs for source in data.inputs)


def pair_index(data: FrequencyResponse, name: str) -> tuple[int, int]:
    """Indices of a response ``output/input``.

    Raises
    ------
    UsageError
        There is none of that name; the nearest one is suggested.
    """
    names = pair_names(data)
    if name not in names:
        near = difflib.get_close_matches(name, names, n=1)
        raise UsageError(
            f"there is no response {name!r}",
            needed=f"one of {', '.join(names)}",
            remedy=f"did you mean {near[0]}?" if near else "",
        )
    y, u = divmod(names.index(name), len(data.inputs))
    return y, u


def only_pairs(used: BoolArray, data: FrequencyResponse, names: Iterable[str]) -> BoolArray:
    """Points of the named responses alone, shape ``(y, u, f)``.

    Parameters
    ----------
    used
        Points that could be used, shape ``(y, u, f)``.
    data
        Their responses.
    names
        Responses to keep, for instance ``["q/pitch_command", "ax/pitch_command"]``.

    Raises
    ------
    UsageError
        A name is unknown.
    """
    kept = np.zeros(used.shape, dtype=np.bool_)
    for name in names:
        pair = pair_index(data, name)
        kept[pair] = used[pair]
    return kept


def within_bands(used: BoolArray, data: FrequencyResponse, bands: Mapping[str, tuple[float, float]]) -> BoolArray:
    """Points inside the band of each named response, and all points of the others, shape ``(y, u, f)``.

    Parameters
    ----------
    used
        Points that could be used, shape ``(y, u, f)``.
    data
        Their responses.
    bands
        Lowest and highest frequency of a response, rad/s.

    Raises
    ------
    UsageError
        A name is unknown, or a band is empty.
    """
    kept = used.copy()
    for name, (low, high) in bands.items():
        pair = pair_index(data, name)
        if not 0.0 <= low < high:
            raise UsageError(f"the band {low:g} to {high:g} rad/s of {name} came", needed="0 <= low < high")
        omega = data.omega_rad_s
        kept[pair] &= (omega >= low * (1.0 - _ROUNDING)) & (omega <= high * (1.0 + _ROUNDING))
    return kept
