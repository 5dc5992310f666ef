"""Loops of an axis: which records show what."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rotorid.data.record import STANDARD_UNITS, Channel, TimeHistory
from rotorid.loops.rate_loops import _attitude


def record(*names: str) -> TimeHistory:
    """A minute in which the roll angle follows the first channel as a lag of 0.2 s."""
    command = np.random.default_rng(0).standard_normal(3000).repeat(2)
    angle = np.zeros(6000)
    for k in range(1, 6000):
        angle[k] = angle[k - 1] + 0.05 * (command[k - 1] - angle[k - 1])
    channels = tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in names)
    return TimeHistory(
        values=np.stack([command, angle])[: len(names)], channels=channels, sample_rate_hz=100.0, start_s=0.0
    )


@pytest.mark.parametrize("others", [("phi_setpoint", "phi"), ("roll_stick",)])
def test_the_answer_of_the_attitude_is_of_the_records_that_hold_its_command(others: tuple[str, ...]) -> None:
    omega = np.geomspace(1.0, 20.0, 30)
    measured: Any = SimpleNamespace(
        response=SimpleNamespace(instruments=("roll_stick",), omega_rad_s=omega, windows_s=(10.0, 5.0))
    )
    found = _attitude("roll", measured, [record("roll_stick", "phi"), record(*others)])
    assert found is not None
    assert _attitude("roll", measured, [record("phi_setpoint", "phi")]) is None
