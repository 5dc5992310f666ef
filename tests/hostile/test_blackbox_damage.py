"""Damaged blackbox logs: nothing crashes or hangs, what is left is right, and what is lost is counted."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from tests.work import require_linear

from rotorid.data.record import FlightRecord, Source
from rotorid.errors import LogError
from rotorid.io.betaflight.blackbox import decode
from rotorid.io.betaflight.log import FORMAT, read

FIELDS = """H Product:Blackbox flight data recorder by Nicholas Sherlock
H Data version:2
H I interval:8
H P interval:1/2
H Firmware type:Cleanflight
H Field I name:loopIteration,time,gyroADC[0],gyroADC[1],gyroADC[2]
H Field I signed:0,0,1,1,1
H Field I predictor:0,0,0,0,0
H Field I encoding:1,1,0,0,0
H Field P predictor:6,2,1,1,1
H Field P encoding:9,0,7,7,7
"""
HEADER = FIELDS.encode()
BLOCKS = 60


def unsigned(value: int) -> bytes:
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes([*out, value])


def block(number: int) -> bytes:
    """One I frame and three P frames; the time of the first P frame is a step from an I frame."""
    first = b"I" + unsigned(8 * number) + unsigned(10_000 + 4000 * number) + b"\x02\x04\x06"
    return first + b"P" + unsigned(2000) + b"\x15" + (b"P" + unsigned(0) + b"\x15") * 2


BODY = [block(number) for number in range(BLOCKS)]
LOG = HEADER + b"".join(BODY) + b"E\xffEnd of log\x00"
STARTS = np.cumsum([len(HEADER), *map(len, BODY)]).tolist()
TRUE = {8 * number + 2 * step: 10_000 + 4000 * number + 1000 * step for number in range(BLOCKS) for step in range(4)}


def record_of(data: bytes, folder: Path) -> FlightRecord | None:
    path = folder / "log.bbl"
    path.write_bytes(data)
    try:
        return read(path, Source(name=path.name, format=FORMAT, sha256=""))
    except LogError as error:
        if not (error.needed and error.remedy):
            pytest.fail(f"{error} does not say what was needed or what to do")
        return None


def kinds(record: FlightRecord) -> set[str]:
    return {finding.kind for finding in record.findings}


def test_the_log_is_sound(tmp_path: Path) -> None:
    flight = decode(LOG)

    assert dict(zip(flight.field("loopIteration").tolist(), flight.field("time").tolist(), strict=True)) == TRUE
    assert (flight.damage.skipped_bytes, flight.damage.lost_frames, flight.damage.ended) == (0, 0, True)


def test_every_cut_is_said_and_keeps_what_is_complete(tmp_path: Path) -> None:
    cuts = np.linspace(1, len(LOG) - 3, 300).astype(int).tolist()
    for cut in cuts:
        record = record_of(LOG[:cut], tmp_path)
        complete = sum(start <= cut for start in STARTS[1:])
        if record is None:
            assert complete <= 1
            continue
        assert "corrupt_log" in kinds(record)
        assert record.topics[0].time_s.size >= 4 * complete - 1


@pytest.mark.parametrize("count", [80, pytest.param(500, marks=pytest.mark.slow)])
def test_flipped_bits_never_crash_and_frames_stay_in_order(tmp_path: Path, count: int) -> None:
    rng = np.random.default_rng(0)
    noticed = 0
    for _ in range(count):
        data = bytearray(LOG)
        data[int(rng.integers(len(HEADER), len(LOG)))] ^= 1 << int(rng.integers(8))
        flight = decode(bytes(data))
        damage = flight.damage
        noticed += bool(damage.skipped_bytes or damage.cut_bytes or not damage.ended)
        # A block is at most lost with the next one, which has to show that it goes on from there.
        assert len(flight.frames) >= len(TRUE) - 12
        iterations = flight.field("loopIteration")
        assert damage.lost_frames >= 0
        assert np.count_nonzero(np.diff(iterations) <= 0) <= 1
        assert record_of(bytes(data), tmp_path) is not None
    # There is no checksum: a changed number that keeps its length cannot be told from a true one.
    assert noticed > 0.3 * count


def test_flipped_bits_in_the_header(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    for _ in range(500):
        data = bytearray(LOG)
        data[int(rng.integers(len(HEADER)))] ^= 1 << int(rng.integers(8))
        record = record_of(bytes(data), tmp_path)
        assert record is None or record.topics[0].values.shape[1] == record.topics[0].time_s.size


@pytest.mark.parametrize("place", range(2, BLOCKS - 14, 5))
@pytest.mark.parametrize("length", [1, 3, 40, 200])
def test_lost_bytes_cost_their_blocks(place: int, length: int) -> None:
    at = STARTS[place] + 2

    flight = decode(LOG[:at] + LOG[at + length :])

    times = dict(zip(flight.field("loopIteration").tolist(), flight.field("time").tolist(), strict=True))
    touched = {8 * (place + block) + 2 * step for block in range(length // 17 + 2) for step in range(4)}
    assert {loop for loop, time_us in TRUE.items() if times.get(loop) != time_us} <= touched
    assert flight.damage.skipped_bytes > 0


def test_bits_flipped_in_a_real_log(shared_data: Path) -> None:
    with (shared_data / "betaflight" / "smooth_tune.BBL").open("rb") as file:
        whole = np.frombuffer(file.read(60_000), dtype=np.uint8)
    sound = decode(whole.tobytes())
    rng = np.random.default_rng(0)
    for _ in range(100):
        data = whole.copy()
        places = rng.integers(3000, data.size, size=10)
        data[places] ^= 1 << rng.integers(8, size=10).astype(np.uint8)
        flight = decode(data.tobytes())
        assert len(flight.frames) > 0.8 * len(sound.frames)


def with_line(name: str, value: str) -> bytes:
    lines = [f"H {name}:{value}" if line.startswith(f"H {name}:") else line for line in FIELDS.splitlines()]
    return ("\n".join(lines) + "\n").encode() + b"".join(BODY)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("Field I name", ",".join(["loopIteration", "time", *["x"] * 100_000])),
        ("Field I encoding", "1,1,0,0,99"),
        ("Field P encoding", "9,0,7,7,0"),
        ("Field P predictor", "6,2,1,1,77"),
        ("Field P predictor", "6,2,1,1,5"),
        ("Field P predictor", "6,2,1,1,4"),
        ("Field I predictor", "0,0,1,1,1"),
        ("Field I signed", "0,0"),
        ("I interval", "0"),
        ("I interval", "99999999999"),
        ("P interval", "7/2"),
        ("P interval", "-1"),
        ("P interval", "1/4000000000"),
    ],
)
def test_a_header_that_contradicts_itself_is_said_to(name: str, value: str, tmp_path: Path) -> None:
    assert record_of(with_line(name, value), tmp_path) is None


@pytest.mark.parametrize("data", [b"", b"\x00" * 5000, b"ULog\x01\x12\x35", HEADER, HEADER * 50, b"H Product:Blackbox"])
def test_empty_and_foreign_files(data: bytes, tmp_path: Path) -> None:
    assert record_of(data, tmp_path) is None


@pytest.mark.parametrize(
    "tail",
    [
        pytest.param(b"I" * 1_000_000, id="frames that are letters"),
        pytest.param(b"P" * 1_000_000, id="letters of P frames"),
        pytest.param(b"E\x0f\x00" * 300_000, id="events"),
        pytest.param(b"I\xff\xff\xff\xff" * 200_000, id="numbers without an end"),
        pytest.param(bytes(1_000_000), id="zeros"),
    ],
)
def test_a_megabyte_of_malice_is_linear_work(tail: bytes) -> None:
    flight = decode(LOG[:-12] + tail)

    assert len(flight.frames) >= len(TRUE) - 1
    require_linear(lambda size: decode(LOG[:-12] + tail[:size]), size=len(tail) // 64)


def test_frames_without_bytes_cannot_inflate_a_file(tmp_path: Path) -> None:
    count = 120
    fields = {"name": ["loopIteration", "time", *["x"] * count], "signed": [0] * (count + 2)}
    text = "".join(f"H Field I {key}:{','.join(map(str, values))}\n" for key, values in fields.items())
    zeros, null = ",".join(["0"] * (count + 2)), ",".join(["9"] * (count + 2))
    text += f"H Field I predictor:{zeros}\nH Field I encoding:{null}\n"
    text += f"H Field P predictor:{zeros}\nH Field P encoding:{null}\n"
    data = HEADER[: HEADER.index(b"H Field")] + text.encode() + b"P" * 1_000_000
    tracemalloc.start()
    try:
        assert record_of(data, tmp_path) is None
        assert tracemalloc.get_traced_memory()[1] < 50_000_000
    finally:
        tracemalloc.stop()


def test_what_a_sentence_quotes_is_text_on_one_line(tmp_path: Path) -> None:
    (tmp_path / "log.bbl").write_bytes(LOG.replace(b"loopIteration", b"loop\x1b[2J\r\x07" + b"x" * 3000))
    with pytest.raises(LogError) as caught:
        read(tmp_path / "log.bbl", Source(name="log.bbl", format=FORMAT, sha256=""))
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 500
