"""Flights that the physics of flight cannot be fitted to, or not as they are: six messages with six remedies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.twins.flight_flights import Case, FlightTwin, twin

import rotorid
from rotorid.data.findings import Finding
from rotorid.data.record import FlightRecord, Topic
from rotorid.errors import InsufficientDataError
from rotorid.flights.flight_data import flight_data
from rotorid.models.rotors import SPINS
from rotorid.settings.motors import MotorSettings

MOTORS = tuple(f"motor_speed_{number}" for number in range(1, 5))
VELOCITIES = ("velocity_north", "velocity_east", "velocity_down")


@pytest.fixture(scope="module")
def flown() -> FlightTwin:
    return twin(Case("x500", "slow", duration_s=30.0, wind=(2.0, -1.0, 0.2)))


@pytest.fixture(scope="module")
def layout(flown: FlightTwin, tmp_path_factory: pytest.TempPathFactory) -> str:
    words = {sign: word for word, sign in SPINS.items()}
    rotors = zip(flown.layout.positions.tolist(), flown.layout.spins.tolist(), strict=True)
    path = tmp_path_factory.mktemp("layout") / "x500.toml"
    text = "".join(f'[[rotor]]\nposition_m = {place}\nspin = "{words[spin]}"\n' for place, spin in rotors)
    path.write_text(text, encoding="utf-8")
    return str(path)


def parted(record: FlightRecord, names: tuple[str, ...]) -> tuple[Topic, Topic]:
    """The one topic as two: these channels, and all others."""
    (topic,) = record.topics
    inside = [channel.name in names for channel in topic.channels]
    first, second = (
        replace(
            topic,
            channels=tuple(channel for channel, there in zip(topic.channels, inside, strict=True) if there == side),
            values=topic.values[np.array(inside) == side],
        )
        for side in (True, False)
    )
    return replace(first, name=names[0]), second


def with_motors(record: FlightRecord, change: Callable[[Topic], Topic]) -> FlightRecord:
    motors, others = parted(record, MOTORS)
    return replace(record, topics=(change(motors), others))


def late(topic: Topic) -> Topic:
    return replace(topic, time_s=topic.time_s - 1.3)


def slow(topic: Topic) -> Topic:
    return replace(topic, time_s=topic.time_s[::25], values=topic.values[:, ::25])


def still(topic: Topic) -> Topic:
    return replace(topic, values=np.broadcast_to(topic.values.mean(axis=1, keepdims=True), topic.values.shape).copy())


def swapped(topic: Topic) -> Topic:
    return replace(topic, values=topic.values[[1, 0, 2, 3]])


REFUSED = {
    "wrong order": (swapped, "rotor_order"),
    "out of step": (late, "motor_stamps"),
    "too slow": (slow, "rate_too_low"),
}
WARNED = {"did not move": (still, "no_excitation", "do not move")}


def identified(record: FlightRecord, layout: str, flown: FlightTwin) -> tuple[Finding, ...]:
    found = rotorid.identify([record], model="physical.flight", layout=layout, fix={"m": flown.frame.mass_kg})
    return tuple(found.findings)


@pytest.mark.parametrize(("change", "kind"), REFUSED.values(), ids=REFUSED)
def test_motors_of_no_use_are_refused_with_a_remedy_of_their_own(
    change: Callable[[Topic], Topic], kind: str, flown: FlightTwin, layout: str
) -> None:
    with pytest.raises(InsufficientDataError) as error:
        identified(with_motors(flown.record, change), layout, flown)
    assert {finding.kind for finding in error.value.findings} == {kind}
    assert error.value.remedy


@pytest.mark.parametrize(("change", "kind", "words"), WARNED.values(), ids=WARNED)
def test_motors_that_show_force_alone_are_warned_of(
    change: Callable[[Topic], Topic], kind: str, words: str, flown: FlightTwin, layout: str
) -> None:
    """Thrust in hover can still be fitted; stamps, torques and inertia cannot."""
    found = identified(with_motors(flown.record, change), layout, flown)
    (finding,) = (each for each in found if each.kind == kind and words in each.message)
    assert finding.severity == "warning"


def test_a_late_velocity_is_moved_and_said(flown: FlightTwin, layout: str) -> None:
    velocity, others = parted(flown.record, VELOCITIES)
    record = replace(flown.record, topics=(replace(velocity, time_s=velocity.time_s + 0.12), others))
    choices = MotorSettings(known={"m": flown.frame.mass_kg}, layout=layout)
    as_flown, moved = flight_data([flown.record], choices), flight_data([record], choices)
    assert "velocity_late" in {finding.kind for finding in moved.findings}
    assert "velocity_late" not in {finding.kind for finding in as_flown.findings}
    size = min(as_flown.records[0].samples, moved.records[0].samples) - 20
    offset = round((moved.records[0].start_s - as_flown.records[0].start_s) * as_flown.records[0].sample_rate_hz)
    both = as_flown.records[0].velocity[:, 10 + offset : size + offset], moved.records[0].velocity[:, 10:size]
    assert float(np.abs(both[0] - both[1]).std()) < 0.1


def test_the_wind_of_a_flight_that_hardly_turned_may_be_a_bias(flown: FlightTwin, layout: str) -> None:
    record = twin(Case("x500", "steps", duration_s=30.0, wind=(2.0, -1.0, 0.2))).record
    found = [finding for finding in identified(record, layout, flown) if finding.kind == "wind_or_bias"]
    turned = float(np.ptp(np.unwrap(record["psi"].values)))
    assert bool(found) == (turned < 0.5 * np.pi)


def test_the_layout_file_is_that_of_the_vehicle(flown: FlightTwin, layout: str) -> None:
    assert Path(layout).exists()
    assert flight_data([flown.record], MotorSettings(layout=layout)).layout.rotors == flown.layout.rotors
