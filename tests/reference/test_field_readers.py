"""Logs as people record them: motors, angles and headers that a reader must not leave unread, with known answers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.autopilots.advice import motor_advice
from rotorid.flights.supports import supports


def test_slow_frames_that_announce_a_frame_before_them_read_as_before(
    unpacked: Callable[[str], Path], tmp_path: Path
) -> None:
    """INAV 7 to 9 announce the last field of their slow frames as counted from the frame before."""
    sound = unpacked("betaflight/smooth_tune.BBL").read_bytes()[:400_000]
    start = sound.index(b"H Field S predictor:")
    stop = sound.index(b"\n", start)
    changed = sound[: stop - 1] + b"1" + sound[stop:]
    records = []
    for name, data in (("sound.BBL", sound), ("changed.BBL", changed)):
        (tmp_path / name).write_bytes(data)
        records.append(rotorid.read(tmp_path / name))
    before, after = records
    assert after.channel_names == before.channel_names
    assert all(np.array_equal(mine.values, his.values) for mine, his in zip(after.topics, before.topics, strict=True))
    assert after.status == before.status


def test_outputs_of_timers_and_quaternions_of_a_crazyflie(shared_data: Path) -> None:
    record = rotorid.read(shared_data / "field/f4_crazyflie_pwm.xz")
    assert {f"motor_{number}" for number in range(1, 5)} | {"phi", "theta", "psi"} <= set(record.channel_names)
    assert record["motor_1"].channel.source == "pwm.m1_pwm"
    assert record.findings == ()
    assert supports(record)["physical.motors"].possible
    model = rotorid.identify(record, "physical.motors", fix={"m": 0.037})
    assert model.parameters["c_2"].value == pytest.approx(3.72e-8, rel=0.01)


def test_motors_alone_are_advised_the_variables_that_are_missing(shared_data: Path) -> None:
    record = rotorid.read(shared_data / "field/f7_motors_only.xz")
    assert {finding.where for finding in record.findings if finding.kind == "missing_channel"} == {"p", "az"}
    assert "gyro.x" in supports(record)["rate.roll"].remedy
    assert "acc.x" in supports(record)["rate.vertical"].remedy
    assert "--map" not in motor_advice(record)
