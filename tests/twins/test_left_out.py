"""A hover model in wind: what yaw does beside yaw is no hover, goes whole, and the rest holds."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.twins.coverage_flights import flown_truth
from tests.twins.motor_twins import twin

import rotorid


@pytest.mark.slow
def test_what_yaw_does_to_roll_in_wind_is_left_out(tmp_path: Path) -> None:
    record = twin("hummingbird", "wind", 3, tmp_path).record
    found = rotorid.identify(record, "hover.lateral")
    gone = {one.where for one in found.findings if one.kind == "structure_error" and "left out" in one.message}
    assert {"p/yaw_command", "ay/yaw_command"} <= gone
    assert all(name.endswith("/yaw_command") and not name.startswith("r/") for name in gone)
    truth = flown_truth("hummingbird", record)
    for name in ("L_roll", "L_p", "L_v", "N_yaw", "N_spin", "T_motor", "Y_v"):
        one = found[name]
        assert one.std is not None
        assert abs(one.value - truth[name]) < 2.5 * one.std, name
