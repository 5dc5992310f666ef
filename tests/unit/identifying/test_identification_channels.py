"""The channels of a response are keywords of ``identify``, as they are options of the command."""

from __future__ import annotations

import pytest
from tests.unit.identifying.small_logs import at_rest, log

from rotorid.errors import InsufficientDataError, UsageError
from rotorid.identifying.identification import identify

RECORD = log(at_rest("rates", 100.0, "p", "q", "roll_command"))


def test_a_response_needs_its_channels() -> None:
    with pytest.raises(UsageError, match=r"transfer:0/1 needs channels"):
        identify(RECORD, "transfer:0/1", inputs="roll_command")
    with pytest.raises(InsufficientDataError, match="contains no excitation of roll"):
        identify(RECORD, "transfer:0/1", inputs="roll_command", outputs="p")


def test_a_model_with_channels_of_its_own_takes_no_others() -> None:
    with pytest.raises(UsageError, match=r"--inputs does not apply to drag\.linear"):
        identify(RECORD, "drag.linear", inputs=["roll_command"])
    with pytest.raises(UsageError, match=r"rate\.roll"):
        identify(RECORD, "rate.roll", inputs=["roll_command"])
