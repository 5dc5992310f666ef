"""A gyro with late stamps is told of twice, against the attitude and against a second gyro: the two lines agree."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from tests.unit.cli.commands import fly_roll_sweeps

from rotorid.cli.inspect import _setting
from rotorid.data.record import Topic
from rotorid.io.registry import read
from rotorid.reviewing.inspection import inspect

LATE_S = 12e-3


def test_two_lines_about_one_delay_agree(tmp_path: Path) -> None:
    log = tmp_path / "sweeps.csv"
    fly_roll_sweeps(log)
    record = read(log)
    (clock,) = record.topics
    row = clock.row("p")
    assert row is not None
    late = Topic(
        name="late", time_s=clock.time_s + LATE_S, channels=(clock.channels[row],), values=clock.values[row][None]
    )
    found = inspect(replace(record, topics=(late, clock)))
    (against_attitude,) = (one for one in found.kinematics if one.channel == "p")
    (against_gyro,) = (one for one in found.skews if one.channel == "p" and one.nature == "same_channel")
    sign = 1.0 if against_gyro.delayed.startswith("late") else -1.0
    assert against_attitude.lag_s == pytest.approx(LATE_S, abs=1e-3)
    assert sign * against_gyro.seconds == pytest.approx(LATE_S, abs=1e-3)
    both = 2.0 * (against_attitude.lag_std_s**2 + against_gyro.std_s**2) ** 0.5
    assert against_attitude.lag_s == pytest.approx(sign * against_gyro.seconds, abs=both)


@pytest.mark.parametrize(
    ("value", "shown"),
    [(2496209.0, "2496209"), (176126.0, "176126"), (4294967295.0, "4294967295"), (-3.0, "-3"), (0.135, "0.135")],
)
def test_a_mask_of_bits_is_shown_with_all_digits(value: float, shown: str) -> None:
    assert _setting(value) == shown
