"""The DataFlash decoder on logs written here: every value comes back, whatever the payload looks like."""

from __future__ import annotations

import struct
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotorid.errors import LogError, UsageError
from rotorid.io.ardupilot import dataflash
from rotorid.io.ardupilot.dataflash import decode, sniff
from rotorid.io.files import file_bytes

MAGIC = b"\xa3\x95"
STRUCT = {letter: letter for letter in "bBhHiIqQfd"} | {"a": "64s", "g": "e", "n": "4s", "N": "16s", "Z": "64s"}
STRUCT |= {"c": "h", "C": "H", "e": "i", "E": "I", "L": "i", "M": "B"}
DIVISOR = {"c": 100.0, "C": 100.0, "e": 100.0, "E": 100.0, "L": 1e7}


def packing(letters: str) -> str:
    return "<" + "".join(STRUCT[letter] for letter in letters)


def fmt(number: int, name: str, letters: str, columns: str, length: int | None = None) -> bytes:
    length = 3 + struct.calcsize(packing(letters)) if length is None else length
    texts = (name.encode(), letters.encode(), columns.encode())
    return MAGIC + b"\x80" + struct.pack("<BB4s16s64s", number, length, *texts)


def message(number: int, letters: str, *values: Any) -> bytes:
    return MAGIC + bytes([number]) + struct.pack(packing(letters), *values)


def log_of(*parts: bytes) -> bytes:
    return fmt(128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns", 89) + b"".join(parts)


def expected_value(letter: str, raw: Any) -> Any:
    if letter in "nNZ":
        try:
            return raw.decode().split("\0")[0]
        except UnicodeDecodeError:
            return raw.decode("latin-1").split("\0")[0]
    if letter == "a":
        return np.frombuffer(raw, dtype="<i2")
    return raw / DIVISOR[letter] if letter in DIVISOR else raw


# Bytes that look like headers, of a known type, of the definitions' type, or cut in half, are what a log may contain.
treacherous = st.sampled_from([MAGIC + b"\x01", MAGIC + b"\x02", MAGIC + b"\x80", MAGIC, b"\xa3", b"\x95", b"\x00"])
payload = st.lists(st.one_of(treacherous, st.binary(min_size=1, max_size=8)), min_size=1, max_size=30).map(b"".join)
formats = (
    st.lists(st.sampled_from(sorted(STRUCT)), min_size=1, max_size=12)
    .map("".join)
    .filter(lambda letters: 3 + struct.calcsize(packing(letters)) <= 255)
)


@given(
    layouts=st.lists(formats, min_size=1, max_size=3),
    order=st.lists(st.integers(0, 2), max_size=12),
    payloads=st.lists(payload, min_size=1, max_size=12),
)
@settings(deadline=None, max_examples=150)
def test_every_value_comes_back_from_any_payload(layouts: list[str], order: list[int], payloads: list[bytes]) -> None:
    written: dict[int, list[bytes]] = {number: [] for number in range(1, len(layouts) + 1)}
    parts = []
    for place, choice in enumerate(order):
        number = 1 + choice % len(layouts)
        size = struct.calcsize(packing(layouts[number - 1]))
        body = (payloads[place % len(payloads)] * size)[:size]
        written[number].append(body)
        parts.append(MAGIC + bytes([number]) + body)
    definitions = [
        fmt(number, f"M{number}", letters, ",".join(f"c{index}" for index in range(len(letters))))
        for number, letters in enumerate(layouts, start=1)
    ]
    data = log_of(*definitions, *parts)

    log = decode(data)

    assert log.gaps == ()
    assert set(log.tables) - {"FMT"} == {f"M{number}" for number, bodies in written.items() if bodies}
    for number, bodies in written.items():
        rows = [struct.unpack(packing(layouts[number - 1]), body) for body in bodies]
        for index, letter in enumerate(layouts[number - 1] if bodies else ""):
            column = log.tables[f"M{number}"].column(f"c{index}")
            assert np.array_equal(
                column, [expected_value(letter, row[index]) for row in rows], equal_nan=letter in "gfd"
            )


def test_definition_inside_a_message_is_not_believed() -> None:
    trap = fmt(1, "EVIL", "f", "x").ljust(128, b"\0")
    body = message(1, "Qaa", 7, trap[:64], trap[64:])
    data = log_of(fmt(1, "ISBD", "Qaa", "TimeUS,x,y"), body, body, body)

    log = decode(data)

    assert log.gaps == ()
    assert log.tables["ISBD"].column("TimeUS").tolist() == [7, 7, 7]
    assert "EVIL" not in log.tables


def test_last_message_counts_whatever_header_it_holds() -> None:
    body = bytes(10) + MAGIC + b"\x02" + bytes(1)
    data = log_of(fmt(1, "A", "BBBBBBBBBBBBBB", "x"), fmt(2, "B", "B", "y"), MAGIC + b"\x01" + body)

    log = decode(data)

    assert log.gaps == ()
    assert len(log.tables["A"]) == 1


def test_definitions_may_follow_in_the_middle_and_change() -> None:
    data = log_of(
        fmt(1, "A", "H", "x"),
        message(1, "H", 5),
        fmt(2, "B", "b", "y"),
        message(2, "b", -3),
        fmt(1, "A", "H", "x"),
        message(1, "H", 6),
        fmt(1, "A", "IB", "x,z"),
        message(1, "IB", 70000, 1),
    )

    log = decode(data)

    assert log.gaps == ()
    assert log.tables["A"].column("x").tolist() == [5, 6]
    assert log.tables["B"].column("y").tolist() == [-3]
    assert log.tables["A#2"].column("x").tolist() == [70000]


def test_scaled_letters_are_divided_not_multiplied() -> None:
    data = log_of(fmt(1, "A", "cCeEL", "c,C,e,E,L"), message(1, "cCeEL", -29, 29, -57, 57, -353632621))

    table = decode(data).tables["A"]

    assert [table.column(name)[0] for name in table.columns] == [-0.29, 0.29, -0.57, 0.57, -35.3632621]
    assert all(table.column(name).dtype == np.float64 for name in table.columns)


def test_text_ends_at_the_first_zero_and_files_stay_bytes() -> None:
    data = log_of(
        fmt(1, "MSG", "Z", "Message"),
        message(1, "Z", b"armed\0rubbish"),
        message(1, "Z", "5 µs".encode()),
        message(1, "Z", b"5 \xb5s"),
        fmt(2, "FILE", "NZ", "FileName,Data"),
        message(2, "NZ", b"@SYS/x", b"a\0b\xff"),
    )

    tables = decode(data).tables

    assert tables["MSG"].column("Message").tolist() == ["armed", "5 µs", "5 µs"]
    assert tables["FILE"].column("FileName").tolist() == ["@SYS/x"]
    assert tables["FILE"].column("Data")[0].tobytes() == b"a\0b\xff".ljust(64, b"\0")


def test_units_join_label_and_multiplier() -> None:
    labels = {"s": "s", "n": "m/s", "d": "deg", "#": "instance"}
    factors = {"F": 1e-6, "B": float(np.float32(0.01))}
    data = log_of(
        fmt(1, "A", "QhcB", "TimeUS,Rate,Angle,I"),
        fmt(2, "UNIT", "QbZ", "TimeUS,Id,Label"),
        fmt(3, "MULT", "Qbd", "TimeUS,Id,Mult"),
        fmt(4, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds"),
        *(message(2, "QbZ", 0, ord(key), label.encode()) for key, label in labels.items()),
        *(message(3, "Qbd", 0, ord(key), factor) for key, factor in factors.items()),
        message(4, "QBNN", 0, 1, b"snd#", b"FBB-"),
        message(1, "QhcB", 2_500_000, 3, 450, 1),
    )

    table = decode(data).tables["A"]

    assert dict(table.units) == {"TimeUS": "µs", "Rate": "cm/s", "Angle": "deg", "I": "instance"}
    assert table.instance_column == "I"
    assert table.time_s is not None
    assert table.time_s.tolist() == [2.5]


def test_old_stamps_are_milliseconds() -> None:
    table = decode(log_of(fmt(1, "ATT", "If", "TimeMS,Roll"), message(1, "If", 1500, 1.0))).tables["ATT"]

    assert table.time_s is not None
    assert table.time_s.tolist() == [1.5]


def test_of_two_columns_with_one_name_the_later_counts() -> None:
    table = decode(log_of(fmt(1, "A", "BB", "x,x"), message(1, "BB", 1, 2))).tables["A"]

    assert table.columns == ("x",)
    assert table.column("x").tolist() == [2]


def test_unknown_column_names_those_that_exist() -> None:
    table = decode(log_of(fmt(1, "A", "B", "x"), message(1, "B", 1))).tables["A"]

    with pytest.raises(UsageError, match="one of x"):
        table.column("y")


@pytest.mark.parametrize("data", [b"", b"\xa3", MAGIC + b"\x80", b"no log at all" * 99, bytes(4096)])
def test_foreign_bytes_are_refused_with_a_reason(data: bytes) -> None:
    with pytest.raises(LogError, match="no message definitions"):
        decode(data)


def test_sniff_knows_its_own_and_not_others() -> None:
    assert sniff(log_of())
    assert sniff(b"\xff" * 5 + log_of())
    assert not sniff(b"ULog\x01\x12\x35")
    assert not sniff(b"time [s],p [rad/s]\n")


@pytest.mark.parametrize("seed", range(10))
def test_the_size_of_the_sections_does_not_matter(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(seed)
    parts = [fmt(1, "A", "QZ", "TimeUS,x"), fmt(2, "B", "Q", "TimeUS")]
    for index in range(600):
        parts.append(message(2, "Q", index) if rng.random() < 0.5 else message(1, "QZ", index, rng.bytes(64)))
        if rng.random() < 0.05:
            parts.append(rng.choice([MAGIC + b"\x01", bytes(3000), rng.bytes(200), fmt(1, "A", "QZB", "TimeUS,x,y")]))
    data = log_of(*parts)[: -int(rng.integers(1, 60))]
    whole = decode(data)
    for section in (2048, 3001, 8192):
        monkeypatch.setattr(dataflash, "SECTION_BYTES", section)
        log = decode(data)
        assert log.gaps == whole.gaps
        assert list(log.tables) == list(whole.tables)
        assert all(np.array_equal(log.tables[name].positions, whole.tables[name].positions) for name in log.tables)


def test_only_the_messages_that_are_named_are_kept_and_damage_is_looked_for_in_all() -> None:
    data = log_of(
        fmt(1, "A", "B", "x"),
        fmt(2, "B", "B", "y"),
        fmt(3, "C", "B", "z", length=9),
        message(1, "B", 5),
        message(2, "B", 6),
        MAGIC + b"\x03" + bytes(6),
        b"rubbish",
        message(1, "B", 7),
    )

    log = decode(data, {"A"})

    assert {name: table.column("x").tolist() for name, table in log.tables.items()} == {"A": [5, 7]}
    assert log.undecodable == ("C",)
    assert log.skipped_bytes == len(b"rubbish")


def test_numbers_are_the_columns_widened() -> None:
    data = log_of(fmt(1, "A", "hcLf", "x,y,z,w"), *(message(1, "hcLf", k, -k, k * 10**6, k / 8) for k in range(5)))

    table = decode(data).tables["A"].chosen(np.array([True, False, True, True, False]))

    expected = [table.column(name).astype(np.float64) for name in ("w", "y", "z")]
    assert np.array_equal(table.numbers("w", "y", "z"), expected)
    assert table.numbers("y").tolist() == [[0.0, -0.02, -0.03]]


def test_memory_follows_the_messages_that_are_asked_for_not_the_log(monkeypatch: pytest.MonkeyPatch) -> None:
    count, section = 400_000, 1 << 20
    data = log_of(
        fmt(1, "A", "QZZ", "TimeUS,x,y"),
        fmt(2, "B", "B", "x"),
        (message(1, "QZZ", 7, b"", b"") * 9 + message(2, "B", 1)) * (count // 10),
    )
    monkeypatch.setattr(dataflash, "SECTION_BYTES", section)

    tracemalloc.start()
    log = decode(data, {"B"})
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()

    assert len(log.tables["B"]) == count // 10
    # Positions of 4 bytes, once in pieces and once joined; for a section, a dozen arrays with 8 bytes for each of its
    # messages of 130. The log has 50 MB, the positions of all its messages 1.6.
    assert peak < 8 * (count // 10) + section


def test_an_empty_and_a_missing_file_are_told_apart(tmp_path: Path) -> None:
    (tmp_path / "empty.bin").touch()

    assert file_bytes(tmp_path / "empty.bin").size == 0
    with pytest.raises(LogError, match="No such file"):
        file_bytes(tmp_path / "absent.bin")
