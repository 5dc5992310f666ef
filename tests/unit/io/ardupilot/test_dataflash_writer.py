"""The DataFlash writer: whatever is written comes back, through our reader and through pymavlink."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotorid.errors import UsageError
from rotorid.io.ardupilot.dataflash import LETTERS, decode
from rotorid.io.ardupilot.dataflash_writer import Layout, Messages, encode, write_dataflash
from rotorid.io.ardupilot.writer import LAYOUTS

WHOLE = {letter for letter in "bBhHiIqQM" if LETTERS[letter].dtype.kind in "iu"}
TEXTS = "nNZ"


def layout_of(letters: str, number: int = 1, **settings: Any) -> Layout:
    return Layout(
        number=number,
        name=f"M{number}",
        letters="Q" + letters,
        columns=",".join(["TimeUS", *(f"c{index}" for index in range(len(letters)))]),
        units="s" + "-" * len(letters),
        multipliers="F" + "-" * len(letters),
        **settings,
    )


def one_column(letter: str, values: Any, **settings: Any) -> Messages:
    return Messages(
        layout=layout_of(letter, **settings), values={"TimeUS": np.arange(len(values)), "c0": np.asarray(values)}
    )


def with_pymavlink(path: Path) -> list[Any]:
    reader = pytest.importorskip("pymavlink.DFReader")
    log = reader.DFReader_binary(str(path.resolve()))
    messages = []
    while (message := log.recv_msg()) is not None:
        messages.append(message)
    log.close()
    return messages


def values_of(letter: str) -> st.SearchStrategy[Any]:
    kind = LETTERS[letter]
    if letter in TEXTS:
        return st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=kind.dtype.itemsize)
    if kind.dtype.kind == "f":
        return st.floats(allow_nan=False, allow_infinity=False, width=8 * kind.dtype.itemsize)  # type: ignore[arg-type]
    limits = np.iinfo(kind.dtype.name)
    return st.integers(int(limits.min), int(limits.max)).map(
        lambda raw: raw / kind.divisor if kind.divisor > 1 else raw
    )


@st.composite
def tables(draw: st.DrawFn) -> Messages:
    each = st.lists(st.sampled_from(sorted(LETTERS.keys() - {"a"})), min_size=1, max_size=4)
    # Four texts of 64 bytes are longer than a message can be.
    letters = "".join(draw(each.filter(lambda chosen: chosen.count("Z") < 4)))
    stamps = draw(st.lists(st.integers(0, 50), min_size=1, max_size=8).map(sorted))
    columns: dict[str, Any] = {"TimeUS": np.array(stamps)}
    for index, letter in enumerate(letters):
        values = draw(st.lists(values_of(letter), min_size=len(stamps), max_size=len(stamps)))
        columns[f"c{index}"] = (
            values if letter in TEXTS else np.array(values, dtype=np.uint64 if letter == "Q" else None)
        )
    return Messages(layout=layout_of(letters), values=columns)


@given(table=tables())
@settings(deadline=None, max_examples=150)
def test_every_value_comes_back(table: Messages) -> None:
    log = decode(encode([table]))

    assert log.gaps == ()
    assert log.findings == ()
    for name, letter in zip(table.layout.format.columns, table.layout.letters, strict=True):
        assert np.array_equal(log.tables["M1"].column(name), np.asarray(table.values[name])), letter


@pytest.mark.parametrize("letter", sorted(WHOLE))
def test_both_ends_of_whole_numbers_come_back(letter: str) -> None:
    limits = np.iinfo(LETTERS[letter].dtype.name)
    ends = np.array([limits.min, limits.max], dtype=LETTERS[letter].dtype)

    back = decode(encode([one_column(letter, ends)])).tables["M1"].column("c0")

    assert back.tolist() == ends.tolist()


def test_messages_stand_in_the_order_of_their_stamps_and_then_of_their_kinds(tmp_path: Path) -> None:
    first = Messages(layout=layout_of("B", 1), values={"TimeUS": np.array([5, 20, 20]), "c0": np.arange(3)})
    second = Messages(layout=layout_of("f", 2), values={"TimeUS": np.array([5, 10, 20]), "c0": np.arange(3.0)})
    write_dataflash(tmp_path / "log.bin", [first, second])

    told = [
        (one.get_type(), one.TimeUS) for one in with_pymavlink(tmp_path / "log.bin") if one.get_type().startswith("M")
    ]

    assert [one for one in told if one[0] != "MULT"] == [
        ("M1", 5),
        ("M2", 5),
        ("M2", 10),
        ("M1", 20),
        ("M1", 20),
        ("M2", 20),
    ]


def test_scaled_letters_are_rounded_to_their_steps() -> None:
    angles = np.array([0.004, 0.006, -1.239, 327.67])

    back = decode(encode([one_column("c", angles)])).tables["M1"].column("c0")

    assert back.tolist() == [0.0, 0.01, -1.24, 327.67]


def test_units_come_back_with_their_multipliers() -> None:
    layout = Layout(number=9, name="SPD", letters="Qhf", columns="TimeUS,V,W", units="snk", multipliers="FB-")
    log = decode(encode([Messages(layout=layout, values={"TimeUS": np.array([1]), "V": 3.0, "W": 0.5})]))

    assert dict(log.tables["SPD"].units) == {"TimeUS": "µs", "V": "cm/s", "W": "deg/s"}


def test_one_value_holds_for_all_messages() -> None:
    log = decode(encode([Messages(layout=layout_of("f"), values={"TimeUS": np.arange(3), "c0": 0.5})]))

    assert log.tables["M1"].column("c0").tolist() == [0.5, 0.5, 0.5]


def test_equal_tables_give_equal_bytes() -> None:
    assert encode([one_column("f", [0.1, 0.2])]) == encode([one_column("f", [0.1, 0.2])])


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("letter", ["f", "d", "g", "H", "c"])
def test_what_is_not_finite_is_refused_and_nothing_is_written(letter: str, bad: float, tmp_path: Path) -> None:
    path = tmp_path / "log.bin"
    path.write_bytes(b"before")

    with pytest.raises(UsageError, match=r"M1\.c0 contains 1 values that are not finite, the first at message 2"):
        write_dataflash(path, [one_column(letter, [1.0, 2.0, bad])])

    assert path.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [path]


def test_a_column_may_lack_values_where_its_layout_says_so() -> None:
    back = decode(encode([one_column("f", [1.0, math.nan], absent=frozenset({"c0"}))])).tables["M1"].column("c0")

    assert np.array_equal(back, [1.0, math.nan], equal_nan=True)


@pytest.mark.parametrize(
    ("letter", "values"),
    [("B", [256]), ("B", [-1]), ("H", [65536.0]), ("c", [327.68]), ("f", [1e39]), ("g", [7e4]), ("i", [2**31])],
)
def test_what_does_not_fit_is_refused(letter: str, values: list[float]) -> None:
    with pytest.raises(UsageError, match=rf"M1\.c0 reaches .* which its letter {letter} can hold"):
        encode([one_column(letter, values)])


def test_long_texts_are_refused() -> None:
    with pytest.raises(UsageError, match="at most 16 bytes"):
        encode([one_column("N", ["A_NAME_OF_SEVENTEEN"])])


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"TimeUS": np.arange(2)}, "messages M1 have no c0"),
        ({"TimeUS": np.arange(2), "c0": np.arange(3.0)}, r"M1\.c0 has shape \(3,\)"),
    ],
)
def test_missing_and_uneven_columns_are_refused(values: dict[str, Any], said: str) -> None:
    with pytest.raises(UsageError, match=said):
        encode([Messages(layout=layout_of("f"), values=values)])


def test_two_kinds_of_one_number_and_no_kind_at_all_are_refused() -> None:
    with pytest.raises(UsageError, match="a number of its own"):
        encode([one_column("f", [1.0]), one_column("f", [1.0])])
    with pytest.raises(UsageError, match="of no kind"):
        encode([])


@pytest.mark.parametrize(
    "wrong",
    [
        {"letters": "Qx"},
        {"units": "s"},
        {"multipliers": "F~"},
        {"units": "s~"},
        {"name": "LONGER"},
        {"number": 256},
        {"letters": "QZZZZ", "columns": "TimeUS,a,b,c,d", "units": "s----", "multipliers": "F----"},
    ],
)
def test_layouts_that_no_log_can_hold_are_refused(wrong: dict[str, Any]) -> None:
    right: dict[str, Any] = {
        "number": 1,
        "name": "M1",
        "letters": "Qf",
        "columns": "TimeUS,c0",
        "units": "s-",
        "multipliers": "F-",
    }
    Layout(**right)
    with pytest.raises(UsageError, match="layout"):
        Layout(**(right | wrong))


def test_layouts_are_those_of_a_log_of_the_firmware(unpacked: Callable[[str], Path]) -> None:
    tables = decode(unpacked("ardupilot_sitl/x_calm_roll.BIN").read_bytes(), ("FMT", "FMTU")).tables
    names = ("Type", "Length", "Name", "Format", "Columns")
    definitions = {row[2]: row for row in zip(*(tables["FMT"].column(name).tolist() for name in names), strict=True)}
    units = {
        number: letters
        for number, *letters in zip(
            *(tables["FMTU"].column(name).tolist() for name in ("FmtType", "UnitIds", "MultIds")), strict=True
        )
    }
    for name, layout in LAYOUTS.items():
        ours = (layout.number, layout.format.length, name, layout.letters, layout.columns)
        assert ours == definitions[name]
        assert [layout.units, layout.multipliers] == units[layout.number], name
