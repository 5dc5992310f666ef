"""Files that name their channels themselves: by the names of variables, or by column headers with units."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from rotorid.data.channel import STANDARD_UNITS
from rotorid.data.findings import Finding
from rotorid.errors import LogError, UsageError
from rotorid.io.mapping import ChannelMapping, Clock, MappedChannel, Series, nearest
from rotorid.typing import AnyArray
from rotorid.units import parse_unit

HEADER_RULE = "a header `time [s],NAME [UNIT],...` with names such as pitch_command, q, az"

_IDENTIFICATION_DATA = (("OutputData", "InputData"), ("y", "u"))
_INSTANTS = "SamplingInstants"


def by_variables(names: Collection[str], file: str) -> ChannelMapping:
    """The mapping that says the names mean themselves, in SI units, for variables next to the one called ``time``.

    Parameters
    ----------
    names
        Variables of the file; those inside of a struct carry its name and a dot in front.
    file
        What the messages call the file.

    Raises
    ------
    LogError
        There is not exactly one ``time``, or nothing next to it has a name of the vocabulary.

    Examples
    --------
    >>> [channel.name for channel in by_variables(["flight.time", "flight.q", "other"], "x.npz").channels]
    ['q']
    """
    clocks = [name for name in names if name.rpartition(".")[2] == "time"]
    prefix = clocks[0].removesuffix("time") if clocks else ""
    channels = tuple(
        MappedChannel(name=label, samples=Series(source=name))
        for name in names
        if name.startswith(prefix) and (label := name.removeprefix(prefix)) in STANDARD_UNITS
    )
    if len(clocks) != 1 or not channels:
        held = ", ".join(list(names)[:20]) or "no numbers at all"
        raise LogError(
            f"{file} holds {held}",
            needed="one variable `time` (s) and variables with names such as pitch_command, q, az",
            remedy="name its variables with a mapping: --map FILE.toml",
        )
    return ChannelMapping(channels=channels, clock=Clock(time=Series(source=clocks[0])))


def by_header(header: Sequence[str], file: str) -> tuple[ChannelMapping, tuple[Finding, ...]]:
    """The mapping that the columns ``name [unit]`` of a table spell out, and what was left out.

    Parameters
    ----------
    header
        Names of the columns; the first one is ``time [s]``.
    file
        What the messages call the file.

    Raises
    ------
    LogError
        The first column is not the time, or no column has a name of the vocabulary.
    UsageError
        A unit is unknown or does not measure what the channel holds.

    Examples
    --------
    >>> mapping, findings = by_header(["time [s]", "q [deg/s]", "note"], "x.csv")
    >>> mapping.channels[0].samples.unit, findings[0].kind
    ('deg/s', 'unknown_column')
    """
    names = [_name_and_unit(cell) for cell in header]
    if not names or names[0][0] != "time":
        first = repr(header[0]) if header else "missing"
        raise _no_header(f"{file} is a table whose first column is {first}")
    channels: list[MappedChannel] = []
    findings: list[Finding] = []
    for cell, (name, unit) in zip(header[1:], names[1:], strict=True):
        if name in STANDARD_UNITS:
            _check_unit(name, unit, cell, file)
            channels.append(MappedChannel(name=name, samples=Series(source=cell, unit=unit)))
        else:
            findings.append(_unknown(cell, name))
    if not channels:
        raise _no_header(f"{file} has the columns {', '.join(header[:20])}")
    _check_unit("time", names[0][1], header[0], file)
    clock = Clock(time=Series(source=header[0], unit=names[0][1]))
    return ChannelMapping(channels=tuple(channels), clock=clock), tuple(findings)


def sampling_instants(arrays: Mapping[str, AnyArray]) -> dict[str, AnyArray]:
    """Clocks of structs that hold identification data, under the name that MATLAB gives to them.

    A struct with ``OutputData``, ``InputData`` and ``Ts`` (or ``y``, ``u`` and ``Ts``), as the fields of an ``iddata``
    object are called, has a sampling period and no stamps. They are ``Tstart + Ts k``; MATLAB starts at ``Ts`` where
    ``Tstart`` is not given, and so does this. A mapping asks for them by ``STRUCT.SamplingInstants``.

    Parameters
    ----------
    arrays
        Variables of the file by dotted names, seconds.

    Examples
    --------
    >>> data = {"z.OutputData": np.zeros(3), "z.InputData": np.zeros(3), "z.Ts": np.array(0.5)}
    >>> sampling_instants(data)["z.SamplingInstants"].tolist()
    [0.5, 1.0, 1.5]
    """
    instants: dict[str, AnyArray] = {}
    for name, period in arrays.items():
        prefix = name.removesuffix("Ts")
        if prefix == name or (prefix and not prefix.endswith(".")) or f"{prefix}{_INSTANTS}" in arrays:
            continue
        outputs = next((y for y, u in _IDENTIFICATION_DATA if {f"{prefix}{y}", f"{prefix}{u}"} <= arrays.keys()), None)
        if outputs is None or period.size != 1 or not 0.0 < float(period.ravel()[0]) < np.inf:
            continue
        step_s = float(period.ravel()[0])
        start = arrays.get(f"{prefix}Tstart", np.empty(0)).ravel()
        start_s = float(start[0]) if start.size == 1 and np.isfinite(start[0]) else step_s
        # Samples are rows; of data that were squeezed to one channel there is but one axis.
        count = arrays[f"{prefix}{outputs}"].shape[:1]
        instants[f"{prefix}{_INSTANTS}"] = start_s + step_s * np.arange(*(count or (1,)))
    return instants


def _name_and_unit(cell: str) -> tuple[str, str]:
    name, _, rest = cell.partition("[")
    return name.strip(), rest.rstrip().removesuffix("]").strip()


def _no_header(came: str) -> LogError:
    return LogError(
        came, needed=HEADER_RULE, remedy="correct the header, or name the columns with a mapping: --map FILE.toml"
    )


def _check_unit(name: str, unit: str, cell: str, file: str) -> None:
    needed = STANDARD_UNITS.get(name, "s")
    try:
        found = parse_unit(unit).si if unit else needed
    except UsageError as error:
        raise UsageError(f"{file}, column {cell!r}: {error.came}", needed=error.needed, remedy=error.remedy) from error
    if found != needed:
        raise UsageError(
            f"{file}, column {cell!r} has the unit {unit!r}", needed=f"a unit of {needed}", remedy="correct the header"
        )


def _unknown(cell: str, name: str) -> Finding:
    close = nearest(name, STANDARD_UNITS)
    return Finding(
        kind="unknown_column",
        severity="info",
        where=cell or "(no name)",
        message=f"The column {cell!r} has no name of the vocabulary and was left out."
        + (f" Did you mean {close}?" if close else ""),
    )
