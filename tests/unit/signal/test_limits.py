"""Every command states the share of time at a limit that was flown, from the log of every autopilot."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.limit_callers import CALLERS
from tests.unit.signal.test_motors_limits import FORMATS, record_of

from rotorid.signal.motors import motor_limits


@pytest.mark.parametrize("format", [*FORMATS, "crazyflie"])
def test_all_callers_state_what_was_flown(format: str, tmp_path: Path) -> None:
    record = record_of(tmp_path, format)
    limits = motor_limits(record)
    known = {"share": limits.share, "upper_share": limits.upper_share, "lower_share": limits.lower_share}
    assert known == pytest.approx({"share": 0.17, "upper_share": 0.09, "lower_share": 0.14}, abs=0.002)
    stated = {caller: ask(record) for caller, ask in CALLERS.items()}
    for caller, shares in stated.items():
        assert shares == pytest.approx({name: known[name] for name in shares}, abs=1e-9), caller
    silent = {caller for caller, shares in stated.items() if not shares}
    # No loop can be measured, and none swings.
    assert silent == {"review, loops", "oscillations"}
