"""PX4's ULog container: a header walk for the damage, then pyulog for the arrays. Runs in the sandbox's child."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rotorid.errors import LogError
from rotorid.io.sandbox import Extract
from rotorid.io.ulog_walk import HEADER_BYTES, MAGIC, walk, without_damage
from rotorid.typing import AnyArray

_CLOCKS = ("timestamp", "timestamp_sample")


def extract(path: Path, options: Mapping[str, Any]) -> Extract:
    """Arrays of the wanted topics, and what the log says about itself.

    Parameters
    ----------
    path
        A ULog file.
    options
        ``topics``: name of a topic to the names of its fields. Only these are read, and only the first instance.

    Returns
    -------
    Extract
        Arrays ``topic/field`` as logged, for the fields that exist. Facts: ``parameters`` at the end of the log,
        ``info``, ``dropouts`` as ``[time_s, duration_s]``, ``damage`` as ``[start, stop, reason]``, ``size_bytes``.

    Raises
    ------
    LogError
        The file is cut inside its header, or of a kind that is not understood.
    """
    # Imported where it is used: only the sandbox's child needs the parser.
    from pyulog.core import ULog
    from pyulog.exceptions import ULogException

    data = path.read_bytes()
    if len(data) <= HEADER_BYTES or not data.startswith(MAGIC):
        raise LogError(
            f"a ULog file of {len(data)} bytes came, which ends inside its header",
            needed="a whole log",
            remedy="copy it again from the vehicle",
        )
    found = walk(data)
    wanted: Mapping[str, list[str]] = options["topics"]
    try:
        log = ULog(io.BytesIO(without_damage(data, found)), list(wanted))
    except ULogException as error:
        raise LogError(
            f"the ULog file is of a kind that is not understood: {error}",
            needed="a log of PX4 1.3 to 1.17",
            remedy="look for a newer version of pyulog",
        ) from error
    damage = [[item.start, item.stop, item.reason] for item in found.damage]
    arrays: dict[str, AnyArray] = {}
    for dataset in log.data_list:
        if dataset.multi_id != 0:
            continue
        clocks = [name for name in _CLOCKS if name in dataset.data and dataset.data[name].dtype == "<u8"]
        if "timestamp" not in clocks:
            damage.append([HEADER_BYTES, HEADER_BYTES, f"the definition of {dataset.name} names no time stamps"])
            continue
        names = [*clocks, *(name for name in wanted[dataset.name] if name in dataset.data)]
        arrays |= {f"{dataset.name}/{name}": dataset.data[name] for name in names}
    facts = {
        "parameters": _parameters(log),
        "info": {key: value for key, value in log.msg_info_dict.items() if isinstance(value, str | int)},
        "dropouts": [[drop.timestamp * 1e-6, drop.duration * 1e-3] for drop in log.dropouts],
        "damage": damage,
        "size_bytes": len(data),
    }
    return Extract(arrays=arrays, facts=facts)


def _parameters(log: Any) -> dict[str, float]:
    """The autopilot's parameters as they were at the end of the log."""
    values = dict(log.initial_parameters) | {name: value for _, name, value in log.changed_parameters}
    return {name: float(value) for name, value in values.items() if isinstance(value, int | float)}
