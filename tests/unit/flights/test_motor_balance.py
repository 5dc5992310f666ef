"""Which motor changed: amplitudes drawn with a known scatter, and what was made of them."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.flights.motor_balance import PAIR_PATTERNS, BalanceChange, amplitudes, balance_change, patterns_of
from rotorid.models.rotors import library_layout
from rotorid.typing import FloatArray

ERROR = 0.001


def patterns(layout: str) -> FloatArray:
    rotors = library_layout(layout)
    return patterns_of(rotors.positions[:, :2], rotors.spins)


def compared(
    rng: np.random.Generator, change: FloatArray, layout: str = "quad.x", *, spread: float = 0.004, flights: int = 5
) -> BalanceChange:
    rotors = patterns(layout)
    drawn = spread * rng.standard_normal((flights + 1, 3))
    errors = np.full((flights, 3), ERROR)
    return balance_change(drawn[:-1], errors, drawn[-1] + change, errors[0], patterns=rotors)


def alone(layout: str, motor: int, rise: float) -> FloatArray:
    """Amplitudes of a motor whose output alone rises."""
    outputs = np.full(patterns(layout).shape[0], 0.5)
    outputs[motor - 1] *= np.exp(rise)
    return amplitudes(outputs, patterns(layout))


@pytest.mark.parametrize("layout", ["quad.x", "quad.plus", "hexa.x"])
def test_patterns_are_orthogonal(layout: str) -> None:
    known = patterns(layout)
    assert np.allclose(known.T @ known / known.shape[0], np.eye(3), atol=1e-12)
    assert np.allclose(known.sum(axis=0), 0.0, atol=1e-12)


@pytest.mark.parametrize("motor", range(1, 5))
def test_the_motor_that_rose_is_named(motor: int) -> None:
    rng = np.random.default_rng(motor)
    found = [compared(rng, alone("quad.x", motor, 0.08)) for _ in range(50)]

    assert sum(one.motor == motor for one in found) >= 45
    assert not [one for one in found if one.motor not in (None, motor)]
    rises = [one.rise for one in found if one.rise is not None]
    assert sum(rise.lower <= 0.08 <= rise.upper for rise in rises) >= 0.85 * len(rises)
    assert {one.usual for one in found if one.motor == motor} == {f"damaged propeller or weak motor {motor}"}


def test_the_motor_of_an_unknown_layout_is_named_too() -> None:
    rng, error = np.random.default_rng(8), np.full(3, ERROR)
    before = 0.003 * rng.standard_normal((5, 3))
    now = amplitudes([0.5, 0.5, 0.5, 0.56], PAIR_PATTERNS)
    found = balance_change(before, np.tile(error, (5, 1)), now, error, patterns=PAIR_PATTERNS, placed=False)
    assert (found.motor, found.patterns) == (4, ("motor_4",))
    moved = amplitudes([0.56, 0.56, 0.5, 0.5], PAIR_PATTERNS)
    found = balance_change(before, np.tile(error, (5, 1)), moved, error, patterns=PAIR_PATTERNS, placed=False)
    assert (found.motor, found.patterns) == (None, ("pair",))


def test_a_motor_of_a_hexarotor_is_named() -> None:
    rng = np.random.default_rng(1)
    found = [compared(rng, alone("hexa.x", 2, 0.15), "hexa.x") for _ in range(30)]
    assert sum(one.motor == 2 for one in found) >= 20
    assert not [one for one in found if one.motor not in (None, 2)]


@pytest.mark.parametrize(
    ("change", "pattern"), [([0.04, 0.0, 0.0], "side"), ([0.02, -0.035, 0.0], "side"), ([0.0, 0.0, 0.04], "diagonal")]
)
def test_a_load_and_a_twisted_arm_are_no_motor(change: list[float], pattern: str) -> None:
    rng = np.random.default_rng(2)
    found = [compared(rng, np.array(change)) for _ in range(40)]
    assert sum(one.patterns[:1] == (pattern,) for one in found) >= 32
    assert sum(one.motor is not None for one in found) <= 1


@pytest.mark.parametrize("spread", [0.002, 0.004, 0.008])
@pytest.mark.parametrize("flights", [2, 5, 10])
def test_a_healthy_flight_is_seldom_called_changed(spread: float, flights: int) -> None:
    rng = np.random.default_rng(3)
    found = [compared(rng, np.zeros(3), spread=spread, flights=flights) for _ in range(300)]
    # Half a percent is meant, also of a vehicle that scatters twice as much as usual.
    assert sum(one.verdict == "changed" for one in found) <= 8


def test_a_motor_that_works_less_is_no_damaged_one() -> None:
    found = compared(np.random.default_rng(4), alone("quad.x", 1, -0.2))
    assert (found.motor, found.usual) == (1, "another propeller or motor 1")


def test_one_earlier_flight_decides_nothing() -> None:
    found = compared(np.random.default_rng(5), alone("quad.x", 1, 0.3), flights=1)
    assert (found.verdict, found.words, found.usual) == ("undecided", "", "")


def test_a_short_flight_is_judged_by_its_own_error() -> None:
    rotors, rng = patterns("quad.x"), np.random.default_rng(6)
    before, error = 0.003 * rng.standard_normal((5, 3)), np.full((5, 3), ERROR)
    change = alone("quad.x", 2, 0.08)
    assert balance_change(before, error, change, error[0], patterns=rotors).verdict == "changed"
    assert balance_change(before, error, change, np.full(3, 0.03), patterns=rotors).verdict == "undecided"
