"""Models beside logs: of one autopilot, and said where the log is another one than the model's."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from rotorid.data.record import FlightRecord, Source
from rotorid.errors import UsageError
from rotorid.flights.same_vehicle import require_one_autopilot
from rotorid.results.provenance import Provenance


def model(autopilot: str | None = "PX4") -> Any:
    controller = SimpleNamespace(autopilot=autopilot) if autopilot else None
    return SimpleNamespace(
        name="rate.roll", controller=controller, provenance=Provenance(inputs={"first.ulg": "1" * 64})
    )


def log(format: str, *, sha256: str = "2" * 64) -> FlightRecord:
    return FlightRecord(source=Source(name="second", format=format, sha256=sha256), topics=())


@pytest.mark.parametrize("format", ["ArduPilot DataFlash", "Betaflight blackbox"])
def test_a_model_of_another_autopilot_is_refused(format: str) -> None:
    with pytest.raises(UsageError, match=r"rate\.roll was identified on first\.ulg of PX4, but second is from"):
        require_one_autopilot([model()], [log("PX4 ULog"), log(format)])


@pytest.mark.parametrize(
    ("known", "format"), [("PX4", "PX4 ULog"), ("PX4", "CSV"), (None, "ArduPilot DataFlash"), ("PX4", "MAVLink tlog")]
)
def test_a_model_of_another_log_is_said_to_be_one(known: str | None, format: str) -> None:
    (said,) = require_one_autopilot([model(known)], [log(format)])
    assert (said.kind, said.severity, said.where) == ("other_log", "warning", "rate.roll")
    assert "identified on first.ulg, not on second" in said.message


def test_of_the_log_of_the_model_nothing_is_said() -> None:
    assert require_one_autopilot([model()], [log("PX4 ULog", sha256="1" * 64), log("PX4 ULog")]) == ()
    # A record that came from no file has no content that is known.
    assert require_one_autopilot([model()], [log("PX4 ULog", sha256="")]) == ()
    assert require_one_autopilot([], [log("PX4 ULog")]) == ()
