"""Steps that a mapping asks for on a channel: its derivative, and a low-pass without phase."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from rotorid.data.record import FlightRecord
from rotorid.errors import LogError, UsageError
from rotorid.io.registry import read
from rotorid.io.tables.mapping import parse_mapping
from rotorid.typing import FloatArray

TIME_S = np.arange(400) / 20.0


def through(folder: Path, keys: str, time_s: FloatArray = TIME_S) -> FlightRecord:
    np.savez(folder / "log.npz", x=np.sin(time_s) + 0.1 * np.sin(50.0 * time_s), t=time_s)
    text = f'[clock]\ntime = {{ source = "t" }}\n[channels.velocity_north]\nsource = "x"\n{keys}\n'
    return read(folder / "log.npz", mapping=parse_mapping(tomllib.loads(text), "map.toml"), sandbox=False)


def test_a_derivative_is_that_of_the_samples(tmp_path: Path) -> None:
    plain = through(tmp_path, "").topics[0].values[0]
    topic = through(tmp_path, "derivative = true").topics[0]
    inside = slice(2, -2)
    assert np.abs(topic.values[0] - np.gradient(plain, TIME_S))[inside].max() < 3.0
    assert topic.channels[0].source == "derivative of x"


def test_a_low_pass_keeps_phase_and_leaves_what_is_slow(tmp_path: Path) -> None:
    topic = through(tmp_path, "low_pass_hz = 2.0").topics[0]
    np.testing.assert_allclose(topic.values[0][20:-20], np.sin(TIME_S)[20:-20], atol=2e-3)
    assert topic.channels[0].source == "x, zero-phase low-pass at 2 Hz"


def test_both_steps_give_a_smooth_velocity(tmp_path: Path) -> None:
    topic = through(tmp_path, "derivative = true\nlow_pass_hz = 2.0").topics[0]
    np.testing.assert_allclose(topic.values[0][40:-40], np.cos(TIME_S)[40:-40], atol=2e-2)


@pytest.mark.parametrize(
    ("keys", "words"),
    [("derivative = 1", "true or false"), ("low_pass_hz = 0.0", "above zero"), ('low_pass_hz = "5"', "number")],
)
def test_steps_that_are_none(tmp_path: Path, keys: str, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        through(tmp_path, keys)


def test_what_no_filter_can_do(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="below half of the rate"):
        through(tmp_path, "low_pass_hz = 15.0")
    with pytest.raises(LogError, match="even clock"):
        through(tmp_path, "low_pass_hz = 2.0", np.r_[TIME_S[:200], TIME_S[200:] + 30.0])
    with pytest.raises(LogError, match="stops or steps back"):
        through(tmp_path, "derivative = true", np.r_[TIME_S[:200], TIME_S[199], TIME_S[201:]])
