"""Hostile mapping files: whatever stands in them, one sentence that names the file."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.hostile.damage import assert_complete, hang_limit

from rotorid.errors import UsageError
from rotorid.io.tables.mapping import ChannelMapping, parse_mapping, read_mapping


def refusal(folder: Path, text: str | bytes) -> str:
    (folder / "map.toml").write_bytes(text if isinstance(text, bytes) else text.encode())
    with hang_limit(), pytest.raises(UsageError) as caught:
        read_mapping(folder / "map.toml")
    assert_complete(caught.value)
    return str(caught.value)


CLOCK = "[clock]\nsample_rate_hz = 250.0\n"
CHANNEL = '[channels.q]\nsource = "gyro"\n'


@pytest.mark.parametrize(
    "text",
    [
        pytest.param("", id="empty"),
        pytest.param(b"\xff\xfe\0\0", id="no text"),
        pytest.param(bytes(999), id="zeros"),
        pytest.param(b"PK\x03\x04" + bytes(99), id="a zip"),
        pytest.param("<html></html>", id="a web page"),
        pytest.param("x = 1979-02-30", id="a day that is none"),
        pytest.param("[channels]\nq = 1", id="a channel that is a number"),
        pytest.param("channels = [1, 2]", id="channels in a list"),
        pytest.param(CLOCK + CHANNEL + "scale = nan", id="scale is no number"),
        pytest.param(CLOCK + CHANNEL + "scale = inf", id="scale without end"),
        pytest.param(CLOCK + CHANNEL + "row = -1", id="negative row"),
        pytest.param(CLOCK + CHANNEL + "row = 1.5", id="half a row"),
        pytest.param(CLOCK + CHANNEL + "row = true", id="a row that is true"),
        pytest.param(CLOCK + CHANNEL + 'unit = "' + "m*" * 20_000 + 'm"', id="a unit of many factors"),
        pytest.param(CLOCK + CHANNEL + 'unit = "' + "(" * 20_000 + '"', id="a unit of brackets"),
        pytest.param(CLOCK + CHANNEL + 'unit = "m^999999999999"', id="a unit to a high power"),
        pytest.param("[clock]\nsample_rate_hz = -1.0\n" + CHANNEL, id="negative rate"),
        pytest.param("[clock]\nsample_rate_hz = nan\n" + CHANNEL, id="rate is no number"),
        pytest.param(CLOCK + CHANNEL + "[segments]\nuse = [{ start_s = 3, stop_s = 1 }]", id="segment backwards"),
        pytest.param(CLOCK + CHANNEL + "[segments]\nuse = [[1, 2]]", id="segment that is a list"),
        pytest.param(CLOCK + CHANNEL + "[segments]\nuse = 1979-05-27", id="segment that is a day"),
        pytest.param(
            CLOCK + "[channels]\n" + "".join(f"q{n} = {{}}\n" for n in range(3000)), id="thousands of channels"
        ),
        pytest.param("[" + ".".join("a" * 900) + "]", id="a table deep inside of tables"),
        pytest.param(
            f"{CLOCK}{CHANNEL}[segments]\nuse = [{{ start_s = 0, stop_s = {'9' * 400} }}]", id="a segment without end"
        ),
    ],
)
def test_nonsense_is_one_sentence(text: str | bytes, tmp_path: Path) -> None:
    assert "map.toml" in refusal(tmp_path, text)


@pytest.mark.parametrize(
    "text",
    [
        pytest.param("a = " + "[" * 5000, id="lists in lists"),
        pytest.param("a = " + "{b=" * 5000, id="tables in tables"),
        pytest.param(f"[clock]\nsample_rate_hz = {'9' * 5000}\n{CHANNEL}", id="a number of thousands of digits"),
        pytest.param(f"[clock]\nsample_rate_hz = {'9' * 400}\n{CHANNEL}", id="a number beyond all floats"),
        pytest.param(f"{CLOCK}[channels.q]\nsource = 0x{'F' * 5000}", id="a name that is a huge number"),
    ],
)
def test_absurd_nesting_and_numbers_are_one_sentence(text: str, tmp_path: Path) -> None:
    assert "map.toml" in refusal(tmp_path, text)


@pytest.mark.parametrize("name", ["missing.toml", "folder.toml"])
def test_a_mapping_that_cannot_be_opened_is_one_sentence(name: str, tmp_path: Path) -> None:
    (tmp_path / "folder.toml").mkdir()
    with pytest.raises(UsageError, match="cannot be opened") as caught:
        read_mapping(tmp_path / name)
    assert_complete(caught.value)


TABLES = ("channels", "clock", "segments", "vectors", "experiments", "frame", "world", "q", "pitch_command")
SERIES = ("source", "time", "unit", "scale", "row", "column", "time_unit", "sample_rate_hz", "steps")
PARTS = ("use", "start_s", "stop_s", "start_sample", "stop_sample", "axis", "kind")
KEYS = st.sampled_from((*TABLES, *SERIES, *PARTS))
VALUES = st.recursive(
    st.one_of(
        st.booleans(), st.integers(), st.floats(), st.text(max_size=8), st.sampled_from(["pitch", "deg/s", "FLU"])
    ),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=4),
    max_leaves=12,
)
CHANNELS = st.dictionaries(st.sampled_from(["q", "pitch_command", "az"]), st.dictionaries(KEYS, VALUES, max_size=4))


@given(st.dictionaries(KEYS, VALUES, max_size=4), CHANNELS)
@settings(max_examples=400, deadline=None)
def test_any_document_is_a_mapping_or_one_sentence(document: dict[str, object], channels: dict[str, object]) -> None:
    for candidate in (document, document | {"channels": channels}):
        try:
            found = parse_mapping(candidate, "map.toml")
        except UsageError as error:
            assert_complete(error)
        else:
            assert isinstance(found, ChannelMapping)
