"""A small encoder of blackbox logs: what the tests of the decoder know to be true."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rotorid.data.record import FlightRecord, Source
from rotorid.io.betaflight.blackbox import Flight, flights
from rotorid.io.betaflight.log import FORMAT, read

PRODUCT = "H Product:Blackbox flight data recorder by Nicholas Sherlock\n"
END = b"E\xffEnd of log\x00"


def unsigned(value: int) -> bytes:
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes([*out, value])


def signed(value: int) -> bytes:
    return unsigned(2 * value if value >= 0 else -2 * value - 1)


def header(
    names: Sequence[str],
    *,
    inter_encoding: Sequence[int],
    inter_predictor: Sequence[int],
    lines: str = "",
    signs: Sequence[int] | None = None,
) -> bytes:
    """I frames of plain numbers; P frames as given, after loop number and time."""
    count = len(names) + 2
    signs = [1] * len(names) if signs is None else signs
    text = {
        "Field I name": ["loopIteration", "time", *names],
        "Field I signed": [0, 0, *signs],
        "Field I predictor": [0] * count,
        "Field I encoding": [1, 1, *[0] * len(names)],
        "Field P predictor": [6, 1, *inter_predictor],
        "Field P encoding": [9, 1, *inter_encoding],
    }
    fields = "".join(f"H {key}:{','.join(map(str, values))}\n" for key, values in text.items())
    return f"{PRODUCT}H Data version:2\nH I interval:8\nH P interval:1/2\n{fields}{lines}".encode()


def intra(iteration: int, time: int, *values: int) -> bytes:
    return b"I" + unsigned(iteration) + unsigned(time) + b"".join(map(signed, values))


def inter(body: bytes, step: int = 1000) -> bytes:
    return b"P" + unsigned(step) + body


def only(data: bytes) -> Flight:
    ((_, flight),) = flights(data)
    assert isinstance(flight, Flight)
    return flight


def record_of(data: bytes, folder: Path) -> FlightRecord:
    path = folder / "log.bbl"
    path.write_bytes(data)
    return read(path, Source(name=path.name, format=FORMAT, sha256=""))
