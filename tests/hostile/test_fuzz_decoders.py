"""The package's own decoders against mutated, spliced, repeated and invented bytes, found by search and not by hand.

Every decoder that runs in the user's own process is here. What they promise for any bytes at all: a record whose parts
fit together, or one sentence; and memory in proportion to the file.
"""

from __future__ import annotations

import random
import tracemalloc
from collections.abc import Callable, Mapping
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.hostile.damage import Sample, assert_complete, hang_limit, malformed
from tests.hostile.samples import SAMPLES

from rotorid.errors import LogError, RotoridError
from rotorid.io import crazyflie as crazyflie_walk
from rotorid.io import read
from rotorid.io.ardupilot import dataflash
from rotorid.io.betaflight import blackbox as blackbox_decode
from rotorid.io.mavlink import messages as mavlink
from rotorid.io.px4.ulog import walk

MIB = 1 << 20
OWN = ("DataFlash", "blackbox", "Crazyflie", "tlog", "NPZ", "CSV", "ulog2csv", "mapping")
"""Formats that are decoded in this process; of ULog only the walk is, which has a test of its own."""

TOKENS: Mapping[str, tuple[bytes, ...]] = MappingProxyType(
    {
        "DataFlash": (b"\xa3\x95\x80", b"\xa3\x95\x01", b"\xa3\x95", b"FMT\0", b"PARM", b"QBIfanNZ", b"TimeUS,"),
        "blackbox": (b"H Product:Blackbox", b"H Field I name:", b"H P interval:", b"I", b"P", b"E\xff", b"\xff\xff"),
        "Crazyflie": (b"\xbc\x02\0", b"gyro.x(f)\0", b"(d)\0", b"\xff\xff", b"\0\0"),
        "tlog": (b"\0\x06\x5b", b"\xfd\x1c\0\0", b"\xfe\x1c", b"\x1e\0\0", b"\xff\xff"),
        "NPZ": (
            b"PK\x03\x04",
            b"PK\x01\x02",
            b"PK\x05\x06",
            b"\x93NUMPY\x01\0",
            b"'<f9'",
            b"'|O'",
            b"(9,)",
            b"\xff" * 4,
        ),
        "CSV": (b",", b'"', b"\r", b"\n", b"nan", b"1e999", b"\xef\xbb\xbf", b"[deg/s]", b"time [s]", b"\xff"),
        "ulog2csv": (b",", b"\n", b"nan", b"-1", b"1e19", b"timestamp", b"xyz[0]"),
        "mapping": (b"[", b"[[", b"]", b"{", b"=", b'"""', b"inf", b"nan", b"-1", b"true", b"1979-05-27", b"\\u0000"),
    }
)
"""Bytes that mean something in a format, to be put where they do not belong."""


def mutated(content: bytes, tokens: tuple[bytes, ...]) -> st.SearchStrategy[bytes]:
    """Up to eight changes to a sound file, each of which keeps most of its structure."""
    place = st.integers(0, len(content))
    part = st.tuples(place, st.integers(1, 300))
    piece = st.one_of(st.binary(max_size=24), st.sampled_from(tokens))
    change = st.one_of(
        st.tuples(st.just("overwrite"), place, piece),
        st.tuples(st.just("insert"), place, piece),
        st.tuples(st.just("repeat"), place, st.tuples(piece, st.integers(2, 200))),
        st.tuples(st.just("delete"), place, st.integers(1, 400)),
        st.tuples(st.just("copy"), place, part),
        st.tuples(st.just("move"), place, part),
    )
    return st.lists(change, min_size=1, max_size=8).map(lambda changes: _applied(content, changes))


def _applied(content: bytes, changes: list[tuple[str, int, object]]) -> bytes:
    data = content
    for kind, at, what in changes:
        match kind, what:
            case "overwrite", bytes(piece):
                data = data[:at] + piece + data[at + len(piece) :]
            case "insert", bytes(piece):
                data = data[:at] + piece + data[at:]
            case "repeat", (bytes(piece), int(times)):
                data = data[:at] + times * piece + data[at:]
            case "delete", int(length):
                data = data[:at] + data[at + length :]
            case "copy", (int(start), int(length)):
                data = data[:at] + data[start : start + length] + data[at:]
            case "move", (int(start), int(length)):
                data = data[:at] + data[start : start + length] + data[at + length :]
    return data


def promise(sample: Sample, folder: Path, content: bytes) -> None:
    """Read it, and hold the reader to what it promises."""
    sample.put(folder, content)
    mapping = folder / sample.mapping if sample.mapping else None
    try:
        record = read(folder / (sample.read or sample.name), mapping=mapping)
    except RotoridError as error:
        assert_complete(error)
    else:
        assert malformed(record) == ""


@pytest.mark.parametrize("name", OWN)
def test_any_mutation_is_a_sound_record_or_one_sentence(name: str, tmp_path: Path) -> None:
    sample = SAMPLES[name]()

    @settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
    @given(mutated(sample.content, TOKENS[name]))
    def search(content: bytes) -> None:
        promise(sample, tmp_path, content)

    search()


def test_a_flight_of_which_no_field_is_known_is_left_out(tmp_path: Path) -> None:
    """Found by the search above: names that were overwritten, in one flight of several."""
    sample = SAMPLES["blackbox"]()
    promise(sample, tmp_path, _applied(sample.content, [("overwrite", 172, b"\0"), ("move", 183, (167, 11))]))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("name", OWN)
def test_thousands_of_mutations(name: str, seed: int, tmp_path: Path) -> None:
    """The same search without shrinking and bookkeeping, which is an order of magnitude faster."""
    sample, chance = SAMPLES[name](), random.Random(seed)
    size = len(sample.content)
    for _ in range(1500):
        changes: list[tuple[str, int, object]] = []
        for _ in range(chance.randint(1, 8)):
            kind = chance.choice(["overwrite", "insert", "repeat", "delete", "copy", "move"])
            piece = chance.choice([chance.randbytes(chance.randint(1, 24)), *TOKENS[name]])
            part = (chance.randrange(size), chance.randint(1, 300))
            what = {"overwrite": piece, "insert": piece, "repeat": (piece, chance.randint(2, 200)), "delete": part[1]}
            changes.append((kind, chance.randrange(size + 1), what.get(kind, part)))
        promise(sample, tmp_path, _applied(sample.content, changes))


def test_any_mutation_of_a_ulog_is_walked_and_every_byte_accounted_for() -> None:
    content = SAMPLES["ULog"]().content
    tokens = (b"D", b"\x15\0F", b"\x05\0A\0\0\0", b"uint64_t timestamp;", b"a:a x;", b"float[99999] y;", b"\xff\xff")

    @settings(max_examples=300, deadline=None)
    @given(mutated(content, tokens))
    def search(data: bytes) -> None:
        try:
            found = walk(data)
        except LogError as error:
            assert_complete(error)
            return
        spans = sorted([*found.intact, *((item.start, item.stop) for item in found.damage if item.stop > item.start)])
        if len(data) >= 16:
            assert sum(stop - start for start, stop in spans) == len(data)
        assert all(before[1] <= after[0] for before, after in pairwise(spans))

    search()


DECODERS: Mapping[str, Callable[[bytes], object]] = MappingProxyType(
    {
        "DataFlash": dataflash.decode,
        "blackbox": lambda data: list(blackbox_decode.flights(data)),
        "Crazyflie": crazyflie_walk.decode,
        "tlog": mavlink.decode,
        "ULog": walk,
    }
)


@pytest.mark.parametrize("filling", ["noise", "zeros", "ones", "itself", "head", "tail"])
@pytest.mark.parametrize("name", DECODERS)
def test_memory_is_in_proportion_to_the_file(name: str, filling: str) -> None:
    """One MiB behind a sound beginning, or of the file over and over again."""
    content = SAMPLES[name]().content
    fillings = {
        "noise": np.random.default_rng(0).bytes(MIB),
        "zeros": bytes(MIB),
        "ones": b"\xff" * MIB,
        "itself": content * (MIB // len(content)),
        "head": content[:64] * (MIB // 64),
        "tail": content[-16:] * (MIB // 16),
    }
    DECODERS[name](content)
    tracemalloc.start()
    try:
        DECODERS[name](content + fillings[filling])
    except LogError as error:
        assert_complete(error)
    finally:
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    # The densest sound content is a byte for each number of eight bytes, with room to copy it twice.
    assert peak < 60 * MIB


def test_headers_of_flights_without_end_are_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "flight.bbl").write_bytes(b"H Product:Blackbox" * 100_000)
    tracemalloc.start()
    with pytest.raises(LogError, match="starts more than 10000 flights"):
        read(tmp_path / "flight.bbl")
    assert tracemalloc.get_traced_memory()[1] < 16 * MIB
    tracemalloc.stop()


def test_a_search_does_not_slow_down_with_the_number_of_event_types(tmp_path: Path) -> None:
    """Each failed try once looked at all of the types, which made minutes of what takes a second or two."""
    kinds = 30_000
    header = b"\xbc\x02\0" + kinds.to_bytes(2, "little")
    header += b"".join(number.to_bytes(2, "little") + b"e\0\0\0" for number in range(kinds))
    near_hits = b"".join((number % kinds).to_bytes(2, "little") + bytes(8) + b"\xff\xff" for number in range(150_000))
    (tmp_path / "log00").write_bytes(header + near_hits)
    with hang_limit(), pytest.raises(LogError, match="contains a header and no samples"):
        read(tmp_path / "log00")
