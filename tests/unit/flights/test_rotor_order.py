"""The order and the directions of motors, from flights whose rotors are known."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Topic
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flights.rotor_order import LEAST_GAP, RotorOrder, require_order, rotor_order
from rotorid.models.rotors import RotorLayout, ardupilot_mixer, library_layout
from rotorid.typing import FloatArray

X = library_layout("quad.x")
GAIN = (200.0, 150.0, 30.0)
"""Angular acceleration per unit of output of rotors with levers of one, rad/s^2."""


def lagged(rows: FloatArray, lag_s: float, rate_hz: float) -> FloatArray:
    made, state, share = np.empty_like(rows), rows[:, 0].copy(), -np.expm1(-1.0 / (lag_s * rate_hz))
    for sample in range(rows.shape[1]):
        state += share * (rows[:, sample] - state)
        made[:, sample] = state
    return made


def a_flight(
    layout: RotorLayout = X,
    *,
    duration_s: float = 12.0,
    rate_hz: float = 200.0,
    commands: float = 0.01,
    noise: float = 0.02,
    feedback: float = 0.0,
    seed: int = 0,
) -> FlightRecord:
    """Motors by the mixer of a layout, moved by commands and by the noise that comes back; rates that follow them."""
    rng = np.random.default_rng(seed)
    count = round(duration_s * rate_hz)
    moved = lagged(rng.normal(size=(3, count)), 0.03, rate_hz) * commands * np.sqrt(rate_hz / 15.0)
    mixer = ardupilot_mixer(layout)[:, :3]
    gyro = noise * rng.normal(size=(3, count))
    arms = np.vstack([layout.moment_arms[:2], layout.spins[None]]) * np.array(GAIN)[:, None]
    outputs, rates = np.empty((layout.rotors, count)), np.zeros((3, count))
    thrust, rate, share = np.full(layout.rotors, 0.4), np.zeros(3), -np.expm1(-1.0 / (0.04 * rate_hz))
    for sample in range(count):
        rates[:, sample] = rate + gyro[:, sample]
        outputs[:, sample] = 0.4 + mixer @ (moved[:, sample] - feedback * rates[:, sample])
        thrust = thrust + share * (outputs[:, sample] - thrust)
        rate = rate + (arms @ (thrust - 0.4) - 1.5 * rate) / rate_hz
    names = [*(f"motor_{number + 1}" for number in range(layout.rotors)), "p", "q", "r"]
    channels = tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in names)
    topic = Topic(name="t", time_s=np.arange(count) / rate_hz, channels=channels, values=np.vstack([outputs, rates]))
    return FlightRecord(source=Source(name="flight.csv", format="CSV", sha256=""), topics=(topic,))


def asked(record: FlightRecord, layout: RotorLayout) -> RotorOrder:
    return rotor_order(record, layout, intervals=((record.start_s, record.stop_s),))


@pytest.fixture(scope="module")
def flight() -> FlightRecord:
    return a_flight(feedback=0.05)


def test_the_layout_that_flew_fits(flight: FlightRecord) -> None:
    order = asked(flight, X)
    assert (order.verdict, order.directions, order.to_type) == ("fits", "fits", "")
    assert order.misfit == order.best < order.second
    assert [finding.severity for finding in order.findings("flight")] == ["info"]


@pytest.mark.parametrize("order", [*permutations(range(4))][1::4], ids=str)
def test_another_order_is_named_wrong_with_the_one_that_fits(flight: FlightRecord, order: tuple[int, ...]) -> None:
    numbers = list(order)
    claimed = replace(X, positions=X.positions[numbers], spins=X.spins[numbers], yaw_weights=None)
    found = asked(flight, claimed)
    assert found.verdict == "wrong"
    assert found.to_type == "--layout quad.x"
    assert found.misfit > found.best + LEAST_GAP
    with pytest.raises(InsufficientDataError, match="not numbered as in"):
        require_order(found, "flight")


def test_motors_that_turn_the_other_way_are_named(flight: FlightRecord) -> None:
    found = asked(flight, library_layout("quad.h"))
    assert (found.verdict, found.directions, found.to_type) == ("fits", "wrong", "--layout quad.x")
    (finding,) = require_order(found, "flight")
    assert finding.severity == "warning"
    assert "--layout quad.x" in finding.message


def test_an_order_that_no_library_layout_has_is_described() -> None:
    numbers = [0, 2, 1, 3]
    odd = replace(X, positions=X.positions[numbers], spins=X.spins[numbers], yaw_weights=None)
    found = asked(a_flight(odd, seed=1), X)
    assert found.verdict == "wrong"
    assert "motor 1 front right" in found.to_type or found.to_type.startswith("--layout quad.x")


@pytest.mark.parametrize("name", ["hexa.x", "octo.x"])
def test_more_rotors_fit_their_layout_and_no_turned_one(name: str) -> None:
    layout = library_layout(name)
    record = a_flight(layout, feedback=0.05)
    assert asked(record, layout).verdict == "fits"
    turned = np.roll(np.arange(layout.rotors), 1)
    wrong = replace(layout, positions=layout.positions[turned], spins=layout.spins[turned], yaw_weights=None)
    assert asked(record, wrong).verdict != "fits"


def test_noise_that_comes_back_through_the_controller_is_no_order() -> None:
    """Gyro noise moves the motors against itself: every sign is turned around, and nothing is decided wrongly."""
    for seed in range(4):
        record = a_flight(commands=0.0, feedback=0.3, noise=0.05, seed=seed)
        assert asked(record, X).verdict != "wrong"


@pytest.mark.parametrize(
    ("record", "why"),
    [
        (a_flight(rate_hz=20.0), "at 20 Hz; 40 Hz are needed"),
        (a_flight(commands=0.0, noise=0.0), "do not move"),
        (a_flight(duration_s=4.0), "5 s are needed"),
        (a_flight(noise=3.0), "explain too little"),
    ],
    ids=["slow", "still", "short", "noisy"],
)
def test_what_is_missing_is_named(record: FlightRecord, why: str) -> None:
    found = asked(record, X)
    assert (found.verdict, found.directions, found.fitting) == ("not enough data", "not enough data", None)
    assert why in found.why
    assert require_order(found, "flight") == ()


def test_another_number_of_rotors_is_refused(flight: FlightRecord) -> None:
    with pytest.raises(UsageError, match=r"4 motors, but hexa\.x has 6"):
        asked(flight, library_layout("hexa.x"))
