"""Impulse and step responses of known systems, back from points of their frequency responses."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rotorid.data.quantity import Quantity
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.spectral.impulse import ImpulseResponse, bound_of_band, impulse_response, phase_crossing, step_numbers
from rotorid.typing import ComplexArray, FloatArray

OMEGA = np.geomspace(0.7, 200.0, 55)


def second_order(
    omega: FloatArray, natural: float, damping: float, delay_s: float = 0.0, gain: float = 1.0
) -> ComplexArray:
    s = 1j * omega
    return np.asarray(gain * natural**2 / (s**2 + 2.0 * damping * natural * s + natural**2) * np.exp(-s * delay_s))


def errors_of(values: ComplexArray, independent: float = 0.003, shared: float = 0.01) -> ComplexArray:
    distance = np.abs(np.subtract.outer(np.log(OMEGA), np.log(OMEGA)))
    kernel = shared**2 * np.exp(-distance / 0.5) + independent**2 * np.eye(OMEGA.size)
    return np.asarray(np.outer(values, values.conj()) * kernel)


def truth_of(natural: float, damping: float, delay_s: float) -> dict[str, float]:
    """By the closed form of the step of an underdamped system, and by its frequency response on a fine grid."""
    time_s = np.linspace(0.0, 1.0, 200_001)
    damped = natural * math.sqrt(1.0 - damping**2)
    lag = np.exp(-damping * natural * time_s)
    step = 1.0 - lag * (np.cos(damped * time_s) + damping * natural / damped * np.sin(damped * time_s))
    first, middle, last = (time_s[np.argmax(step >= level)] for level in (0.1, 0.5, 0.9))
    omega = np.geomspace(1.0, 400.0, 40_000)
    response = second_order(omega, natural, damping, delay_s)
    return {
        "rise_time_s": last - first,
        "delay_s": middle + delay_s,
        "overshoot_percent": 100.0 * (step.max() - 1.0),
        "bandwidth_3db_rad_s": omega[np.argmax(np.abs(response) < 10.0 ** (-0.15))],
        "bandwidth_90deg_rad_s": omega[np.argmax(np.unwrap(np.angle(response)) < -0.5 * math.pi)],
    }


SYSTEMS = [(20.0, 0.7, 0.005), (60.0, 0.5, 0.003), (20.0, 0.3, 0.02), (120.0, 0.7, 0.003)]


@pytest.mark.parametrize("end_rad_s", [20.0, 40.0, 100.0])
def test_no_number_lies_outside_of_its_band(end_rad_s: float) -> None:
    """−90° of 50 rad/s with a delay of 3 ms are at 43 rad/s, −3 dB at 53 rad/s; it rises within 37 ms."""
    kept = end_rad_s >= OMEGA
    values = second_order(OMEGA, 50.0, 0.7, 0.003)
    found = impulse_response(OMEGA[kept], values[kept], errors_of(values)[np.ix_(kept, kept)])
    numbers = step_numbers(found)
    top = found.band_rad_s[1]
    assert ("bandwidth_90deg_rad_s" in numbers) == (top > 43.0)
    assert all(numbers[name].value <= top for name in numbers if name.startswith("bandwidth"))
    least = bound_of_band("rise_time_s", found.band_rad_s)
    assert least is not None
    assert "rise_time_s" not in numbers or numbers["rise_time_s"].value >= least
    assert bound_of_band("delay_s", found.band_rad_s) is None


@pytest.mark.parametrize(("natural", "damping", "delay_s"), SYSTEMS)
def test_the_step_of_a_known_system_comes_back(natural: float, damping: float, delay_s: float) -> None:
    values = second_order(OMEGA, natural, damping, delay_s)
    found = impulse_response(OMEGA, values, errors_of(values))
    numbers, truth = step_numbers(found), truth_of(natural, damping, delay_s)
    # Exact points with an error of 1 % stated: what is left is that of the cells, 0.06 / ω.
    for name, value in truth.items():
        near = 0.2 if name == "overshoot_percent" else 0.01 * value
        assert numbers[name].value == pytest.approx(value, abs=near), name
        assert numbers[name].lower <= value <= numbers[name].upper, name
    assert found.misfit < 1.0


@pytest.mark.parametrize("later_s", [0.004, 0.02])
def test_a_pure_delay_moves_the_step_and_nothing_else(later_s: float) -> None:
    early = second_order(OMEGA, 40.0, 0.6, 0.002)
    late = early * np.exp(-1j * OMEGA * later_s)
    before, after = (step_numbers(impulse_response(OMEGA, v, errors_of(v))) for v in (early, late))
    assert after["delay_s"].value - before["delay_s"].value == pytest.approx(later_s, abs=2e-4)
    assert after["rise_time_s"].value == pytest.approx(before["rise_time_s"].value, rel=0.02)


def test_who_droops_never_rises_to_the_setpoint_and_is_not_rescaled() -> None:
    values = second_order(OMEGA, 20.0, 0.8, gain=0.85)
    numbers = step_numbers(impulse_response(OMEGA, values, errors_of(values)))
    assert "rise_time_s" not in numbers
    assert "settling_time_s" not in numbers
    assert numbers["delay_s"].value > 0.0
    assert numbers["overshoot_percent"].value == 0.0


def test_a_resonance_is_told_and_a_flat_response_has_none() -> None:
    peaked, flat = (second_order(OMEGA, 20.0, damping) for damping in (0.3, 0.8))
    told = step_numbers(impulse_response(OMEGA, peaked, errors_of(peaked)))["peak_db"]
    assert told.value == pytest.approx(20.0 * math.log10(1.0 / (0.6 * math.sqrt(1.0 - 0.09))), abs=0.1)
    assert "peak_db" not in step_numbers(impulse_response(OMEGA, flat, errors_of(flat)))


def test_a_response_that_no_linear_system_has_is_noticed_and_made_uncertain() -> None:
    values = second_order(OMEGA, 20.0, 0.7)
    rng = np.random.default_rng(1)
    torn = values * (1.0 + 0.1 * rng.standard_normal(OMEGA.size))
    whole, broken = (impulse_response(OMEGA, points, errors_of(values, shared=0.0)) for points in (values, torn))
    assert broken.misfit > 3.0
    assert np.median(broken.step_std / whole.step_std) > 3.0


def test_points_beyond_which_nothing_is_known_leave_it_uncertain_not_wrong() -> None:
    values = second_order(OMEGA, 120.0, 0.7, 0.003)
    low = OMEGA < 90.0
    impulse = impulse_response(OMEGA[low], values[low], errors_of(values)[np.ix_(low, low)])
    found, truth = step_numbers(impulse), truth_of(120.0, 0.7, 0.003)
    assert found["delay_s"].lower <= truth["delay_s"] <= found["delay_s"].upper
    # The rise is faster than a loop of that band: what is left is a bound, and it holds.
    bound_s = bound_of_band("rise_time_s", impulse.band_rad_s)
    assert "rise_time_s" not in found
    assert bound_s is not None
    assert truth["rise_time_s"] < bound_s


@pytest.mark.slow
@pytest.mark.parametrize(("natural", "damping", "delay_s"), SYSTEMS[:2])
def test_intervals_hold_as_often_as_they_say(natural: float, damping: float, delay_s: float) -> None:
    """Errors drawn from the covariance that is stated; 40 draws of 0.95 are 34 and more in 999 of 1000."""
    values = second_order(OMEGA, natural, damping, delay_s)
    covariance, truth = errors_of(values, 0.01, 0.02), truth_of(natural, damping, delay_s)
    level, directions = np.linalg.eigh(covariance)
    root = directions * np.sqrt(np.maximum(level, 0.0))
    held = dict.fromkeys(truth, 0)
    for seed in range(40):
        rng = np.random.default_rng(seed)
        noise = root @ (rng.standard_normal((OMEGA.size, 2)) @ np.array([1.0, 1.0j]) / math.sqrt(2.0))
        numbers = step_numbers(impulse_response(OMEGA, values + noise, covariance))
        for name, value in truth.items():
            quantity = numbers.get(name, Quantity.normal(np.pi, 0.0, "1"))
            held[name] += quantity.lower <= value <= quantity.upper
    assert min(held.values()) >= 34, held


def test_the_same_answer_twice_and_its_own_response() -> None:
    values = second_order(OMEGA, 30.0, 0.7)
    one, two = (impulse_response(OMEGA, values, errors_of(values)) for _ in range(2))
    assert np.array_equal(one.values, two.values)
    assert step_numbers(one) == step_numbers(two)
    assert np.abs(one.at(OMEGA) - values).max() < 0.01
    assert isinstance(one, ImpulseResponse)
    assert one.step().shape == one.time_s.shape == one.step_std.shape


def test_the_phase_crossing_is_the_first_one_and_may_not_be_there() -> None:
    assert phase_crossing(OMEGA, second_order(OMEGA, 20.0, 0.7)) == pytest.approx(20.0, rel=1e-3)
    assert phase_crossing(OMEGA[:10], second_order(OMEGA[:10], 200.0, 0.7)) == math.inf


@pytest.mark.parametrize(
    ("omega", "values", "covariance", "error"),
    [
        (OMEGA[:5], np.ones(5), np.eye(5), InsufficientDataError),
        (OMEGA, np.ones(54), np.eye(55), UsageError),
        (OMEGA, np.ones(55), np.eye(54), UsageError),
        (OMEGA, np.full(55, np.nan), np.eye(55), UsageError),
    ],
)
def test_what_is_no_response_is_refused(
    omega: FloatArray, values: ComplexArray, covariance: ComplexArray, error: type[Exception]
) -> None:
    with pytest.raises(error):
        impulse_response(omega, values.astype(complex), covariance.astype(complex))
