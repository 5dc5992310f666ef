"""ArduPilot logs in text hold what the binary log holds, whichever program printed them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.data import FlightRecord
from rotorid.errors import LogError
from rotorid.io.ardupilot.dataflash import Table, decode
from rotorid.io.ardupilot.dataflash_writer import Layout, Messages, encode

Printer = Callable[[str, dict[str, object]], str]


def written(n: int = 400) -> bytes:
    """A small flight of old firmware: whole centivolts, centidegrees in letters that carry a factor."""
    time_us = 1_000_000 + 5_000 * np.arange(n)
    wave = np.sin(0.05 * np.arange(n))
    rate = Layout(
        number=150,
        name="RATE",
        letters="Q" + "f" * 6,
        columns="TimeUS,R,ROut,P,POut,Y,YOut",
        units="s" + "-" * 6,
        multipliers="F" + "-" * 6,
    )
    attitude = Layout(
        number=151, name="ATT", letters="Qcc", columns="TimeUS,Roll,Pitch", units="sdd", multipliers="FBB"
    )
    battery = Layout(number=152, name="CURR", letters="Qh", columns="TimeUS,Volt", units="s-", multipliers="F-")
    text = Layout(number=153, name="MSG", letters="QZ", columns="TimeUS,Message", units="s-", multipliers="F-")
    values = {"TimeUS": time_us, "R": 100.0 * wave, "ROut": 0.3 * wave, "P": wave, "POut": wave, "Y": wave}
    return encode(
        [
            Messages(layout=text, values={"TimeUS": time_us[:2], "Message": ["ArduCopter V3.3 (1, 2)", "Frame: QUAD"]}),
            Messages(layout=rate, values={**values, "YOut": wave}),
            Messages(layout=attitude, values={"TimeUS": time_us, "Roll": 10.0 * wave, "Pitch": -wave}),
            Messages(layout=battery, values={"TimeUS": time_us[::20], "Volt": np.full(n // 20, 1239)}),
        ]
    )


def planner(name: str, cells: dict[str, object]) -> str:
    return ", ".join([name, *(str(cell) for cell in cells.values())])


def dumped(name: str, cells: dict[str, object]) -> str:
    inner = ", ".join(f"{column} : {cell}" for column, cell in cells.items())
    return f"2023-05-06 07:08:09.10: {name} {{{inner}}}"


def as_json(name: str, cells: dict[str, object]) -> str:
    return json.dumps({"meta": {"type": name, "timestamp": 1.0}, "data": cells})


PRINTERS: tuple[Printer, ...] = (planner, dumped, as_json)


def lines(content: bytes, printer: Printer) -> list[str]:
    """The messages of a binary log as a program prints them, in their order."""
    found: list[tuple[int, str]] = []
    for table in decode(content).tables.values():
        for position, cells in zip(table.positions.tolist(), _rows(table), strict=True):
            found.append((position, printer(table.name, cells)))
    return [line for _, line in sorted(found)]


def _rows(table: Table) -> Iterator[dict[str, object]]:
    columns = table.read()
    for index in range(len(table)):
        yield {name: values[index].item() for name, values in columns.items()}


def read(folder: Path, name: str, content: bytes | str) -> FlightRecord:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return rotorid.read(path)


@pytest.mark.parametrize("printer", PRINTERS)
def test_a_printed_log_is_the_log(tmp_path: Path, printer: Printer) -> None:
    content = written()
    binary = read(tmp_path, "a.BIN", content)
    text = read(tmp_path, "a.log", "\n".join(lines(content, printer)))
    assert text.source.format == "ArduPilot DataFlash as text"
    assert (text.source.firmware, text.parameters) == (binary.source.firmware, binary.parameters)
    assert [topic.name for topic in text.topics] == [topic.name for topic in binary.topics]
    for ours, theirs in zip(text.topics, binary.topics, strict=True):
        np.testing.assert_array_equal(ours.time_s, theirs.time_s)
        np.testing.assert_array_equal(ours.values, theirs.values)
        assert ours.channels == theirs.channels
    assert [finding.kind for finding in text.findings] == [finding.kind for finding in binary.findings]


def test_words_in_front_of_the_first_definition_are_no_obstacle(tmp_path: Path) -> None:
    text = "\n".join(["Ready to drive.", "log 12, 3 pages", *lines(written(), planner)])
    assert read(tmp_path, "a.log", text)["p"].values.size == 400


def test_broken_lines_are_counted(tmp_path: Path) -> None:
    printed = lines(written(), planner)
    rates = [index for index, line in enumerate(printed) if line.startswith("RATE")]
    printed[rates[10]] = printed[rates[10]][:20]
    printed[rates[20]] = printed[rates[20]].replace(".", "x")
    record = read(tmp_path, "a.log", "\n".join(printed))
    assert record["p"].values.size == 398
    (finding,) = [finding for finding in record.findings if finding.kind == "corrupt_log"]
    assert finding.numbers["lines"] == 2.0


def test_messages_without_their_definition_are_read_by_their_names(tmp_path: Path) -> None:
    printed = [line for line in lines(written(), dumped) if " RATE {" in line]
    assert read(tmp_path, "a.log", "\n".join(printed))["p"].values.size == 400


@pytest.mark.parametrize("printer", PRINTERS)
def test_every_cut_is_read_or_refused_in_one_sentence(tmp_path: Path, printer: Printer) -> None:
    text = "\n".join(lines(written(40), printer))
    for cut in np.linspace(1, len(text) - 1, 60).astype(int).tolist():
        try:
            record = read(tmp_path, "a.log", text[:cut])
        except LogError as error:
            assert_complete(error)
        else:
            assert all(np.isfinite(topic.values).all() for topic in record.topics)


def assert_complete(error: LogError) -> None:
    assert error.needed
    assert error.remedy


@pytest.mark.parametrize(
    "text",
    [
        "2023-05-06 07:08:09.10: HEARTBEAT {type : 2, autopilot : 3}\n",
        '{"meta": {"type": "HEARTBEAT", "timestamp": 1.0}, "data": {"type": 2}}\n',
        "FMT, 128, 89, FMT, BBnNZ, Type,Length\n",
        '{"meta": {"type": "RATE"}, "data": 3}\n{"meta": {"type":\n',
    ],
)
def test_text_without_a_message_of_a_log_is_named(tmp_path: Path, text: str) -> None:
    with pytest.raises(LogError, match=r"give the \.BIN or \.tlog"):
        read(tmp_path, "a.txt", text)


@pytest.mark.parametrize("magic", [b"ULogEnc", b"ULogKey"])
def test_an_encrypted_log_is_named_with_the_way_to_decrypt_it(tmp_path: Path, magic: bytes) -> None:
    with pytest.raises(LogError, match=r"encrypted PX4 log.*decrypt_logs\.py") as error:
        read(tmp_path, "a.ulge", magic + bytes(100))
    assert error.value.exit_code == 2


WITHOUT_STAMPS = """ArduCopter V3.0.1
FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns
FMT, 1, 19, ATT, cccc, RollIn,Roll,PitchIn,Pitch
FMT, 3, 27, IMU, ffffff, GyrX,GyrY,GyrZ,AccX,AccY,AccZ
ATT, 0.00, -0.50, 0.00, 1.20
IMU, 0.01, 0.02, 0.00, 0.1, 0.2, -9.8
ATT, 0.00, -0.52, 0.00, 1.21
"""


@pytest.mark.parametrize(
    ("text", "came"),
    [
        (WITHOUT_STAMPS, "contains 2 ATT, 1 IMU, which have no stamps .TimeUS, TimeMS., as firmware before 3.2 logs"),
        (
            "ATT, 0.00, -0.50, 0.00\r\nCTUN, 0, 0.00, 0.2\r\n",
            "contains 1 ATT, 1 CTUN of ArduPilot, without definitions",
        ),
    ],
)
def test_messages_without_stamps_are_named_for_what_they_are(tmp_path: Path, text: str, came: str) -> None:
    (tmp_path / "old.log").write_text(text)
    with pytest.raises(LogError, match=came) as error:
        rotorid.read(tmp_path / "old.log")
    assert ".bin" in error.value.remedy.lower()
