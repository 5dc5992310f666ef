"""Each guard of the tracker, on signals whose gain is known: a first-order vehicle under feedback, stirred by gusts."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from rotorid.typing import FloatArray
from rotorid.verification.tracking import BLOCK_S, LEAST_LEVEL, RATE_HZ, Tracking, _Sums, _why, track_gain

DAMPING_1_S, GAIN, FEEDBACK_S, FULL_RAD_S = 3.0, 40.0, 0.2, 3.0
_KEPT = float(np.exp(-DAMPING_1_S / RATE_HZ))
_MOVED = GAIN * (1.0 - _KEPT) / DAMPING_1_S


def predict(command: FloatArray) -> FloatArray:
    return np.asarray(signal.lfilter([0.0, _MOVED], [1.0, -_KEPT], command))


def tracked(
    seconds: float,
    *,
    gusts: float | FloatArray = 0.05,
    gain: float | FloatArray = 1.0,
    stick_hz: tuple[float, float] = (0.1, 2.0),
    seed: int = 0,
) -> Tracking:
    """A flight in which the controller answers the gusts, followed."""
    count, rng = round(seconds * RATE_HZ), np.random.default_rng(seed)
    stick = signal.sosfilt(signal.butter(2, stick_hz, "bandpass", fs=RATE_HZ, output="sos"), rng.standard_normal(count))
    stick *= 0.4 / np.std(stick)
    pushed = np.broadcast_to(gusts, count) * signal.lfilter([1.0], [1.0, -0.8], rng.standard_normal(count))
    factor = np.broadcast_to(gain, count)
    rate, command = np.zeros(count), np.zeros(count)
    for k in range(count):
        command[k] = FEEDBACK_S * (FULL_RAD_S * stick[k] - rate[k])
        if k + 1 < count:
            rate[k + 1] = _KEPT * rate[k] + factor[k] * _MOVED * command[k] + pushed[k]
    return track_gain(command, rate, stick, predict=predict)


def test_commands_that_answer_gusts_do_not_bias_the_gain() -> None:
    """The prediction as its own instrument finds two thirds of the gain: it moves with the gusts."""
    assert np.mean([tracked(70.0, gusts=0.1, seed=seed).reference_gain for seed in range(8)]) == pytest.approx(
        1.0, abs=0.1
    )


def test_no_single_block_is_an_alarm() -> None:
    sums = _Sums(1.0)
    assert [sums.add(k, 1e6, 1.0, 1.0, 0.13) for k in range(3)] == [None] * 3
    assert sums.add(3, 1e6, 1.0, 1.0, 0.13) == 1.0


def test_rough_air_says_nothing_until_it_is_nearly_as_calm_as_before() -> None:
    level, rougher = np.ones(12), np.array([1.0, 1.0, 1.0, 1.9, 2.1, 1.9, 1.5, 1.31, 1.29, 1.9, 1.0, 1.0])
    usable, air = "", "air"
    assert _why(level, rougher, 50) == ("reference", "reference", usable, usable, *[air] * 4, *[usable] * 4)


def test_gusts_that_grow_are_no_change_of_the_gain() -> None:
    gusts = np.full(round(180 * RATE_HZ), 0.05)
    gusts[round(100 * RATE_HZ) : round(140 * RATE_HZ)] = 0.2
    found = tracked(180.0, gusts=gusts)
    assert not found.steps
    assert found.cannot_tell.count("air") * BLOCK_S > 30.0
    assert found.cannot_tell[-1] == ""


def test_a_stick_that_barely_moves_says_nothing() -> None:
    level = np.array([1.0, 1.0, 0.9 * LEAST_LEVEL, 1.1 * LEAST_LEVEL])
    assert (_why(level, np.ones(4), 50), LEAST_LEVEL) == (("reference", "reference", "stick", ""), 0.15)


def test_the_band_reaches_as_high_as_quick_sticks() -> None:
    """Sticks of 2.5 to 5 Hz: a band that ended at a fifth of the frequency would know the gain half as well."""
    found = [tracked(90.0, stick_hz=(2.5, 5.0), seed=seed) for seed in range(4)]
    assert np.mean([flight.std[-1] for flight in found]) < 0.045
    assert np.mean([flight.reference_gain for flight in found]) == pytest.approx(1.0, abs=0.03)


def test_a_model_is_never_followed_more_exactly_than_its_shape_is_known() -> None:
    found = tracked(180.0, gusts=1e-4)
    assert found.std.min() >= 1.5 * 0.02


def test_a_quiet_hour_has_about_one_false_alarm() -> None:
    assert sum(len(tracked(300.0, seed=seed).steps) for seed in range(4)) <= 1


def test_the_reference_is_the_first_minute() -> None:
    assert tracked(70.0).cannot_tell.count("reference") * BLOCK_S == 60.0


def test_a_step_of_15_percent_is_found_within_a_minute() -> None:
    gain = np.ones(round(180 * RATE_HZ))
    gain[round(120 * RATE_HZ) :] = 1.0 / 1.15
    steps = [found.steps for seed in range(4) for found in [tracked(180.0, gain=gain, seed=seed)]]
    assert [bool(found) and 120.0 < found[0].at_s < 180.0 for found in steps] == [True] * 4
