"""Mapping files: every mistake is answered with the key and the nearest name."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

from rotorid.errors import UsageError
from rotorid.io.tables.mapping import ChannelMapping, Clock, Segment, Series, parse_mapping, read_mapping

PRODUCT = """
[clock]
time = { source = "Time_real" }
[channels.pitch_command]
source = "M.value"
time = "M.timestamp"
time_unit = "us"
unit = "%"
scale = -1.0
[channels.q]
source = "gyr"
column = 1
unit = "deg/s"
[segments]
use = [{ start_s = 31.7, stop_s = 57.7 }, { start_sample = 10, stop_sample = 20, axis = "yaw", kind = "sweep" }]
"""


def parse(text: str) -> ChannelMapping:
    return parse_mapping(tomllib.loads(text), "map.toml")


def test_a_whole_mapping_is_understood() -> None:
    mapping = parse(PRODUCT)
    command, rate = mapping.channels
    assert mapping.clock == Clock(time=Series(source="Time_real"))
    assert command.samples == Series(source="M.value", unit="%", scale=-1.0)
    assert command.time == Series(source="M.timestamp", unit="us")
    assert rate.samples == Series(source="gyr", unit="deg/s", column=1)
    assert rate.time is None
    # The axis of the first segment is that of the only command.
    assert mapping.segments == (
        Segment(axis="pitch", start_s=31.7, stop_s=57.7, signal="pitch_command"),
        Segment(axis="yaw", kind="sweep", start_sample=10, stop_sample=20),
    )


CHANNEL = '[channels.q]\nsource = "a"\ntime = "t"\n'


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "names no channel"),
        ("[channels]\nq = 1", r"\[channels.q\] is 1"),
        ('[channels.q]\nsource = "a"', r"\[channels.q\] has no stamps"),
        ('[channels.q]\ntime = "t"', r"\[channels.q\] has no `source`"),
        ('[channels.q]\nsource = 3\ntime = "t"', "`source` = 3"),
        (CHANNEL + 'sorce = "b"', "a key `sorce`.* did you mean source"),
        (CHANNEL + 'unit = "m/s"', r"\[channels.q\] `unit` is 'm/s'; expected a unit of rad/s"),
        (CHANNEL + 'unit = "furlong"', "unknown unit .furlong."),
        (CHANNEL.replace("q]", "roll_command]") + 'unit = "us"', "no unit: write `scale`.* offset = -1500 and scale"),
        (CHANNEL + 'time_unit = "deg"', "`time_unit` is 'deg'; expected a unit of s"),
        (CHANNEL + 'scale = "2"', "`scale` = '2'"),
        (CHANNEL + "scale = nan", "`scale` = nan"),
        (CHANNEL + "row = -1", "`row` = -1"),
        (CHANNEL + "row = true", "`row` = True"),
        (CHANNEL + "row = 1\ncolumn = 1", "`row` and `column`"),
        (CHANNEL + "[chanels]", "a key `chanels`.* did you mean channels"),
        (CHANNEL.replace("q]", "pich_command]"), "pich_command.* did you mean pitch_command"),
        (CHANNEL.replace("q]", "rotor_current]"), "rotor_current.* has no `unit`"),
        (CHANNEL.replace("q]", "2q]"), "is not a known channel.*letters, digits"),
        (CHANNEL + "scale = 0", "`scale` = 0"),
        (CHANNEL + 'frame = "flu"', "`frame` = 'flu'; expected one of FRD, FLU"),
        (CHANNEL + 'world = "UP"', "`world` = 'UP'; expected one of NED, ENU, NWU"),
        ('frame = "FLU"\n' + CHANNEL.replace("q]", "theta]"), "FLU and NED do not form an attitude.* FLU with ENU"),
        (CHANNEL + 'file = "/tmp/log.mat"', "`file` = '/tmp/log.mat'; expected a path below"),
        (CHANNEL + 'file = "../log.mat"', "expected a path below"),
        (CHANNEL + 'file = "a/../../log.mat"', "expected a path below"),
        (CHANNEL + "file = 'C:\\log.mat'", "expected a path below"),
        (CHANNEL + "file = '..\\log.mat'", "expected a path below"),
        (CHANNEL + 'file = "log\\u0000.mat"', "expected a path below"),
        (CHANNEL + 'file = "other.mat"', "every channel is in a file other.*give other.mat as the log"),
        ('[channels.q]\nsource = "a"\ntime_unit = "ms"\n[clock]\nsample_rate_hz = 1', "`time_unit` and no `time`"),
        (CHANNEL + '[experiments]\nnames = ["1", "2"]', r"\[experiments\] alone"),
        (CHANNEL.replace('"a"', '"a{experiment}"'), "a source with {experiment} alone"),
        (CHANNEL + "[experiments]\nnames = [1, 1]", "a list of several different names"),
        (CHANNEL + "[experiments]\nspacing_s = 1", "has no `names`"),
        (CHANNEL + "[experiments]\nnames = [1]\nspacing_s = -1", "`spacing_s` = -1"),
        (CHANNEL + '[vectors.rate]\nsources = ["a"]', "not a known vector.* did you mean rates"),
        (CHANNEL + "[vectors.velocity]", "neither of `sources` and `source`"),
        (CHANNEL + '[vectors.velocity]\nsource = "a"\nsources = ["a", "b", "c"]', "both of `sources` and `source`"),
        (CHANNEL + '[vectors.velocity]\nsources = ["a", "b"]', "a list of 3 different names"),
        (CHANNEL + '[vectors.velocity]\nsources = ["a", "b", "b"]', "a list of 3 different names"),
        (CHANNEL + '[vectors.quaternion]\nsources = ["x", "y", "z"]', "a list of 4 different names"),
        (CHANNEL + '[vectors.velocity]\nsources = ["a", "b", "c"]\nby = "row"', "`by` and `sources`"),
        (CHANNEL + '[vectors.velocity]\nsource = "a"\nby = "line"', "`by` = 'line'; expected one of row, column"),
        (CHANNEL + '[vectors.velocity]\nsource = "a"\nunit = "rad"', "expected a unit of m/s"),
        (CHANNEL + '[vectors.velocity]\nsource = "a"', r"\[channels.velocity_north\] has no stamps"),
        (CHANNEL + '[vectors.quaternion]\nsource = "a"', r"\[vectors.quaternion\] has no stamps"),
        (CHANNEL + '[vectors.rates]\nsource = "a"\ntime = "t"', "names q twice"),
        (CHANNEL + "[clock]", "has 0 keys"),
        (CHANNEL + '[clock]\nsample_rate_hz = 1\nsteps = {source = "d"}', "has 2 keys"),
        (CHANNEL + "[clock]\nsample_rate_hz = 0", "`sample_rate_hz` = 0"),
        (CHANNEL + "[clock]\nsampel_rate_hz = 2", "did you mean sample_rate_hz"),
        (CHANNEL + '[clock]\ntime = "t"', "is 't'; expected a table"),
        (CHANNEL + "[segments]\nuse = 3", "a list of tables"),
        (CHANNEL + "[segments]\nuse = [{start_s = 1, stop_s = 2}]", "does not name its axis"),
        (CHANNEL + '[segments]\nuse = [{start_s = 1, stop_s = 2, axis = "up"}]', "`axis` = 'up'"),
        (CHANNEL + '[segments]\nuse = [{start_s = 2, stop_s = 1, axis = "yaw"}]', "number 1 is no interval"),
        (CHANNEL + '[segments]\nuse = [{start_s = 2, stop_sample = 9, axis = "yaw"}]', "is no interval"),
        (CHANNEL + '[segments]\nuse = [{signal = "phi", axis = "yaw"}]', "`signal` = 'phi'; expected one of q"),
        (
            CHANNEL + '[segments]\nuse = [{axis = "yaw", band_rad_s = [2, 1]}]',
            "`band_rad_s` = .2, 1.; expected two rising",
        ),
        (CHANNEL + '[segments]\nuse = [{axis = "yaw", band_rad_s = 3}]', "`band_rad_s` = 3; expected two rising"),
        (CHANNEL + '[segments]\nuse = [{axis = "yaw", band_rad_s = ["1", 2]}]', "= '1'; expected a finite number"),
        (CHANNEL + '[segments]\nuse = [{start_s = 2, axis = "yaw"}]', "is no interval"),
        (
            CHANNEL + '[segments]\nuse = [{start_s = 1, stop_s = 2, start_sample = 1, stop_sample = 2, axis = "yaw"}]',
            "is no interval",
        ),
        (CHANNEL + '[segments]\nuse = [{start_s = 1, stop_s = 2, axis = "yaw", kind = "chirp"}]', "`kind` = 'chirp'"),
    ],
)
def test_every_mistake_names_its_key(text: str, sentence: str) -> None:
    with pytest.raises(UsageError, match=sentence) as caught:
        parse(text)
    assert str(caught.value).startswith("map.toml")


def test_a_missing_or_broken_file_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be opened"):
        read_mapping(tmp_path / "none.toml")
    (tmp_path / "map.toml").write_text("[channels\n")
    with pytest.raises(UsageError, match=r"map.toml is not valid TOML: .*line 1"):
        read_mapping(tmp_path / "map.toml")


@pytest.mark.parametrize(
    "wrong",
    [{"columns": [4, 5]}, {"columns": [4, 4, 5]}, {"columns": [-1, 4, 5]}, {"columns": [4, 5, 6], "by": "row"}],
    ids=["few", "twice", "negative", "by"],
)
def test_columns_of_a_vector_are_checked(wrong: dict[str, Any]) -> None:
    document = {"clock": {"sample_rate_hz": 100.0}, "vectors": {"rates": {"source": "M", **wrong}}}
    with pytest.raises(UsageError, match=r"columns = \[0, 1, 2\]"):
        parse_mapping(document)


def test_columns_pick_a_vector_out_of_a_wide_matrix() -> None:
    document = {"clock": {"sample_rate_hz": 100.0}, "vectors": {"rates": {"source": "M", "columns": [4, 5, 6]}}}
    assert [channel.samples.column for channel in parse_mapping(document).channels] == [4, 5, 6]
