"""Gains are proposed from flights in which the motors had room, by the range in which each autopilot moves them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from rotorid.data.record import Channel, FlightRecord, Source, Topic
from rotorid.errors import InsufficientDataError
from rotorid.proposing.flown_gains import require_room
from rotorid.results.model import IdentifiedModel
from rotorid.results.provenance import LoggedManeuver
from rotorid.typing import FloatArray

SPIN = {"MOT_SPIN_MIN": 0.15, "MOT_SPIN_MAX": 0.95, "MOT_THST_EXPO": 0.65}
FORMATS: dict[str, dict[str, float]] = {"ArduPilot DataFlash": SPIN, "PX4 ULog": {}, "Betaflight blackbox": {}}
SQUARE = np.where(np.arange(1000) // 25 % 2 == 0, 1.0, -1.0)


def log(values: FloatArray, kind: str, parameters: dict[str, float]) -> FlightRecord:
    """Four motors, two of which do the opposite of the others."""
    channels = tuple(Channel(name=f"motor_{number}", unit="1") for number in range(1, 5))
    both = np.stack([values, values.max() + values.min() - values] * 2)
    topic = Topic(name="motors", time_s=np.arange(values.size) / 100.0, channels=channels, values=both)
    return FlightRecord(source=Source(name="flight", format=kind, sha256=""), topics=(topic,), parameters=parameters)


@pytest.mark.parametrize("kind", FORMATS)
def test_a_limit_cycle_between_both_ends_is_refused(kind: str) -> None:
    parameters = FORMATS[kind]
    low, high = (0.15, 0.95) if parameters else (0.0, 1.0)
    middle, half = (high + low) / 2.0, (high - low) / 2.0
    with pytest.raises(InsufficientDataError, match="at a limit for 100 %"):
        require_room(log(middle + half * SQUARE, kind, parameters))
    assert require_room(log(middle + 0.5 * half * SQUARE, kind, parameters)) == []


def test_motors_that_idle_on_the_ground_are_at_no_limit() -> None:
    idle = np.where(np.arange(1000) < 500, 0.1, 0.4)
    channels = tuple(Channel(name=f"motor_{number}", unit="1") for number in range(1, 5))
    topic = Topic(name="RCOU", time_s=np.arange(1000) / 100.0, channels=channels, values=np.stack([idle] * 4))
    source = Source(name="flight", format="ArduPilot DataFlash", sha256="")
    assert require_room(FlightRecord(source=source, topics=(topic,), parameters=SPIN)) == []


@pytest.mark.parametrize(("level", "refused"), [(0.0, False), (1.0, False), (0.45, True)])
@pytest.mark.parametrize("share", [0.01, 0.03, 0.3])
def test_only_limits_that_a_loop_makes_are_refused(level: float, refused: bool, share: float) -> None:
    """Chopped and full throttle take all motors to one end; a loop takes them to both, with thrust in between."""
    limited = np.arange(1000) % 100 < 100 * share
    rows = [np.where(limited, np.clip(level + sign, 0.0, 1.0) if refused else level, 0.5) for sign in (1.0, -1.0)]
    channels = tuple(Channel(name=f"motor_{number}", unit="1") for number in range(1, 5))
    topic = Topic(name="motors", time_s=np.arange(1000) / 100.0, channels=channels, values=np.stack(rows * 2))
    record = FlightRecord(source=Source(name="flight", format="PX4 ULog", sha256=""), topics=(topic,))
    if refused and share > 0.02:
        with pytest.raises(InsufficientDataError, match="lower the gains first"):
            require_room(record)
    else:
        assert require_room(record) == []


@pytest.mark.parametrize(("part", "refused"), [((0.0, 4.0), False), ((5.0, 9.0), True), (None, True)])
def test_limits_count_where_the_plant_was_measured(part: tuple[float, float] | None, refused: bool) -> None:
    record = log(0.5 + np.where(np.arange(1000) < 500, 0.2, 0.5) * SQUARE, "PX4 ULog", {})
    model = None
    if part is not None:
        maneuver = LoggedManeuver(record="flight", axis="roll", kind="sweep", start_s=part[0], stop_s=part[1])
        model = cast("IdentifiedModel", SimpleNamespace(provenance=SimpleNamespace(maneuvers=(maneuver,))))
    if refused:
        with pytest.raises(InsufficientDataError, match="analyzed maneuvers" if part else "of the flight") as found:
            require_room(record, model)
        (finding,) = found.value.findings
        assert (finding.kind, finding.numbers["share"]) == ("saturation", pytest.approx(1.0 if part else 0.5))
    else:
        assert require_room(record, model) == []


def test_what_is_not_seen_is_said() -> None:
    nothing = FlightRecord(source=Source(name="flight", format="PX4 ULog", sha256=""), topics=(), parameters={})
    (said,) = require_room(nothing)
    assert (said.kind, "outputs of all motors" in said.message) == ("room_not_checked", True)
    (said,) = require_room(log(0.5 + 0.1 * SQUARE, "ArduPilot DataFlash", {}))
    assert "in which range" in said.message
