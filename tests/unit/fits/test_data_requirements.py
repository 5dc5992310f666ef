"""A gain of uncertain sign is no model, whether noise or disagreeing logs leave it open."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from rotorid.data.findings import warn
from rotorid.errors import InsufficientDataError
from rotorid.fits.data_requirements import require_known_gain
from rotorid.models.library import rate_model

PARAMETERS = rate_model("rate.roll").parameters.with_values({"L_roll": 136.0})


def bounds(std: float) -> Any:
    return SimpleNamespace(names=("L_roll",), stds={"L_roll": std})


def test_a_gain_that_noise_leaves_open_is_refused() -> None:
    require_known_gain("L_roll", PARAMETERS, bounds(60.0))
    with pytest.raises(InsufficientDataError, match="the sign of L_roll is uncertain") as refusal:
        require_known_gain("L_roll", PARAMETERS, bounds(80.0))
    assert [one.kind for one in refusal.value.findings] == ["not_identifiable"]


def test_logs_of_two_vehicles_leave_no_gain() -> None:
    apart = warn("logs_disagree", "L_roll", "The logs disagree about L_roll: 117 in a, 440 in b.")
    other = warn("logs_disagree", "L_p", "The logs disagree about L_p.")
    with pytest.raises(InsufficientDataError, match="even the sign of L_roll is uncertain") as refusal:
        require_known_gain("L_roll", PARAMETERS, bounds(229.0), [apart, other])
    assert [(one.kind, one.severity, one.where) for one in refusal.value.findings] == [
        ("logs_disagree", "error", "L_roll")
    ]
    assert "each log by itself" in refusal.value.remedy
