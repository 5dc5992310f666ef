"""Hostile files of gains: numbers that stand in the file, or one sentence. Nothing is guessed."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.hostile.damage import hang_limit
from tests.unit.proposing.test_judging import BETAFLIGHT, PX4, known, log

from rotorid.errors import UsageError
from rotorid.proposing.judging import judge_gains, load_gains
from rotorid.tuning.gain_files import GainFile, read_gains

SOUND = {
    "px4.params": "# Onboard parameters for Vehicle 1\n# Vehicle-Id Component-Id Name Value Type\n"
    + "".join(f"1\t1\t{name}\t{value:.18f}\t9\n" for name, value in PX4.items()),
    "px4.txt": "".join(f"param set {name} {value:.9g}\n" for name, value in PX4.items()),
    "copter.param": "#NOTE: 29.11.2026\nATC_RAT_RLL_P,0.117\nATC_RAT_RLL_I,0.117\nATC_RAT_RLL_D,0.0006 @READONLY\n"
    "ATC_ANG_RLL_P,34\nINS_GYRO_FILTER 20\n",
    "dump.txt": "# Betaflight / STM32F7X2 (S7X2) 4.4.3 Nov 17 2023 / 10:58:20 (738127e7e) MSP API: 1.45\n"
    "# master\nset gyro_lpf1_type = PT1\nset gyro_lpf1_static_hz = 250\nset osd_units = METRIC\nprofile 0\n"
    "set p_roll = 45\nset i_roll = 80\nset d_roll = 40\nset d_min_roll = 30\nprofile 1\nset p_roll = 30\n"
    "# restore original profile selection\nprofile 0\nrateprofile 0\nset roll_rc_rate = 7\n",
    "preset.txt": "#$ TITLE: A tune\n#$ FIRMWARE_VERSION: 4.4\n#$ OPTION BEGIN (CHECKED): 4S\nset p_roll = 50\n"
    "set simplified_master_multiplier = 120\n#$ OPTION END\n#$ OPTION BEGIN (UNCHECKED): 6S\nset p_roll = 40\n"
    "#$ OPTION END\nsimplified_tuning apply\n",
    "line.txt": "roll: P=0.12 I=0.2 D=0.003 A=6\nyaw: P = 0.3\n",
}
WORDS = {"PT1": 0.0, "ON": 1.0, "OFF": 0.0, "METRIC": 0.0}
VALUES = ("nan", "-inf", "1e999", "1_000", "0x1p-3", "--", "", "٠.١٥", "0,15", "½", "1e-320", "-0.1", "9" * 400)
LINES = (
    "set",
    "profile",
    "profile ٣",
    "=",
    "1\t1\t",
    "#$ INCLUDE: ../../etc/passwd",
    "#$ OPTION BEGIN",
    "P=",
    "\x1b[2J",
    "∞",
)


def numbers_in(text: str) -> set[float]:
    """Every number that stands in a text in plain digits."""
    found = set()
    for word in re.findall(r"[-+.0-9eE]+", text):
        try:
            found.add(float(word))
        except ValueError:
            continue
    return found


def assert_one_line(error: UsageError) -> None:
    """An error says in one line what came and what was needed."""
    assert error.came
    assert error.needed
    assert len(str(error).splitlines()) == 1


def read(text: str) -> GainFile | None:
    """What a text holds; none where it is refused with a complete sentence."""
    try:
        with hang_limit():
            return read_gains(text, name="x")
    except UsageError as error:
        assert_one_line(error)
        return None


@st.composite
def damaged(draw: st.DrawFn) -> str:
    """A sound file of gains with some of its lines cut, swapped, repeated with other values, or of another file."""
    lines = draw(st.sampled_from(sorted(SOUND.values()))).splitlines()
    for _ in range(draw(st.integers(1, 4))):
        place = draw(st.integers(0, len(lines) - 1))
        match draw(st.sampled_from(("cut", "swap", "repeat", "value", "line", "foreign", "drop", "digits", "space"))):
            case "cut":
                lines[place:] = [lines[place][: draw(st.integers(0, len(lines[place])))]]
            case "swap":
                other = draw(st.integers(0, len(lines) - 1))
                lines[place], lines[other] = lines[other], lines[place]
            case "repeat":
                lines.append(re.sub(r"\d+(?=\D*$)", str(draw(st.integers(0, 99))), lines[place]))
            case "value":
                lines[place] = re.sub(r"[\d.]+(?=\D*$)", draw(st.sampled_from(VALUES)), lines[place], count=1)
            case "line":
                lines.insert(place, draw(st.one_of(st.sampled_from(LINES), st.text(max_size=40))))
            case "foreign":
                lines.insert(place, draw(st.sampled_from(sorted(SOUND.values()))).splitlines()[-1])
            case "drop":
                lines[place] = ""
            case "digits":
                lines[place] = lines[place].translate({ord("0") + digit: 0x0660 + digit for digit in range(10)})
            case _:
                lines[place] = lines[place].replace(" ", "\u00a0").replace("\t", "\u2003")
    ending = draw(st.sampled_from(("\n", "\r\n", "\r")))
    return draw(st.sampled_from(("", "\ufeff"))) + ending.join(lines)


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(damaged())
def test_what_is_read_stands_in_the_file(text: str) -> None:
    found = read(text)
    if found is None:
        return
    there = numbers_in(text) | set(WORDS.values()) | {float(index) for index in range(5)}
    by_hand = [value for gains in found.by_hand.values() for value in gains.values()]
    for value in (*found.values.values(), *by_hand, *(found.sliders or {}).values()):
        assert math.isfinite(value)
        assert value in there


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(damaged())
def test_what_is_judged_is_a_verdict_or_one_sentence(text: str) -> None:
    found = read(text)
    if found is None:
        return
    record = log(BETAFLIGHT, "Betaflight 4.4.3") if found.autopilot == "Betaflight" else log(PX4)
    try:
        judged = judge_gains(found, {"roll": known("roll", record)}, {})
    except UsageError as error:
        assert_one_line(error)
        return
    assert judged.verdict in ("fly", "gently", "do_not_fly", "not_enough_data")


@pytest.mark.parametrize("change", [lambda text: f"\ufeff{text}", lambda text: text.replace("\n", "\r\n")])
@pytest.mark.parametrize("name", SOUND)
def test_windows_writes_the_same_gains(name: str, change: Callable[[str], str]) -> None:
    assert read(change(SOUND[name])) == read(SOUND[name])


def test_large_files_pipes_and_other_encodings_are_one_sentence(tmp_path: Path) -> None:
    place = tmp_path / "gains.params"
    for content, words in (
        (SOUND["px4.params"].encode() * 5000, "at most 2000000 bytes"),
        (SOUND["px4.params"].encode("utf-16"), "contains no gains"),
        (bytes(range(256)) * 9, "contains no gains"),
        (SOUND["px4.params"].encode()[:-7], "cannot be read"),
    ):
        place.write_bytes(content)
        with hang_limit(), pytest.raises(UsageError, match=words) as caught:
            load_gains(place)
        assert_one_line(caught.value)
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe")
        with hang_limit(), pytest.raises(UsageError, match="is a pipe"):
            load_gains(tmp_path / "pipe")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("IMU_GYRO_NF_FREQ,80", "has IMU_GYRO_NF0_FRQ instead, maybe in other units"),
        ("MC_DTERM_CUTOFF,30", "has IMU_DGYRO_CUTOFF instead"),
        ("MPC_XY_VEL_P,0.09", "has MPC_XY_VEL_P_ACC instead"),
        ("ATC_ANG_RLL_P,450", "gains of ArduPilot, but flight.log is from PX4"),
    ],
)
@pytest.mark.parametrize("size", [0, 60])
def test_names_of_other_versions_are_refused_in_files_of_any_size(text: str, words: str, size: int) -> None:
    record = log({**PX4, "IMU_GYRO_NF0_FRQ": 0.0, "MPC_XY_VEL_P_ACC": 1.8})
    stem = "ATC_X" if text.startswith("ATC") else "MPC_X"
    whole = "" if text.startswith("ATC") else "\n".join(f"{name},{value}" for name, value in PX4.items())
    padding = "\n".join(f"{stem}{k},1" for k in range(size))
    with pytest.raises(UsageError, match=words):
        judge_gains(
            read_gains(f"{text}\n{padding}\n{whole if size else ''}", name="x"), {"roll": known("roll", record)}, {}
        )
