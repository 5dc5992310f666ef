"""What D is worth beside P: the phase margin of the same gains without it, on all likely plants."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.unit.proposing.test_outer import INNER, PX4, roll, vehicle

from rotorid.data.quantity import Quantity
from rotorid.models.autopilots import axis_controller
from rotorid.proposing.axis_tuning import AxisTuning, axis_tuning
from rotorid.proposing.new_gains import axis_gains
from rotorid.report.tune_words import balance_sentence
from rotorid.tuning import Wishes

DAMPED = {"MC_ROLLRATE_P": 0.2, "MC_ROLLRATE_D": 0.006}


def tuned(**changed: float) -> AxisTuning:
    known = roll({**PX4, **changed})
    return axis_tuning("roll", known, axis_gains("roll", known, Wishes(keep=("P", "I", "D"))), {})


def test_the_margin_without_d_is_that_of_the_known_vehicle() -> None:
    found = tuned(**DAMPED).without_derivative["flown"]
    assert found is not None
    without = axis_controller({**INNER, **DAMPED, "MC_ROLLRATE_D": 0.0}, "roll", firmware="PX4 1.16.0")
    assert without is not None
    omega = np.geomspace(1.0, 200.0, 20_000)
    loop = vehicle(omega) * without.controller.rate_loop.response(omega)
    crossing = int(np.flatnonzero(np.abs(loop) > 1.0)[-1])
    margin = 180.0 + float(np.degrees(np.unwrap(np.angle(loop)))[crossing])
    assert found.lower < margin < found.upper
    assert found.value == pytest.approx(margin, abs=2.0)


def test_a_loop_without_d_has_no_balance() -> None:
    assert tuned(MC_ROLLRATE_D=0.0).without_derivative == {}


def sentence(without: dict[str, Quantity | None]) -> str:
    margin = {"phase_margin_deg": SimpleNamespace(value=58.0, lower=55.0, upper=61.0)}
    axis: Any = SimpleNamespace(changed=False, flown=margin, proposed=margin, without_d=without)
    return balance_sentence("roll", axis)


def test_the_balance_is_one_sentence_with_its_intervals() -> None:
    assert sentence({"flown": Quantity(value=27.0, std=1.5, lower=24.0, upper=30.0, unit="deg")}) == (
        "P/D balance: with today's gains the phase margin of the rate loop is 58° (55 to 61); without D it would be "
        "27° (24 to 30)."
    )
    assert sentence({"flown": None}).endswith("; without D the loop may be unstable.")
    assert sentence({}) == ""
