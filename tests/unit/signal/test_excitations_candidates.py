"""Candidates: what moves an axis enough to try, and is left to the person who flew it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Topic
from rotorid.signal.excitations import candidate_excitations, classify, find_excitations
from rotorid.typing import FloatArray

RATE_HZ = 20.0


def record(**channels: FloatArray) -> FlightRecord:
    values = np.stack(list(channels.values()))
    topic = Topic(
        name="t",
        time_s=np.arange(values.shape[1]) / RATE_HZ,
        channels=tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in channels),
        values=values,
    )
    return FlightRecord(source=Source(name="a.csv", format="CSV", sha256=""), topics=(topic,))


def random_binary(seed: int, seconds: float = 20.0) -> FloatArray:
    """Levels held for 0.3 to 1.5 s, which never rest."""
    holds = np.random.default_rng(seed).integers(6, 31, 200)
    levels = np.repeat(0.1 * (-1.0) ** np.arange(holds.size), holds)
    return levels[: round(seconds * RATE_HZ)]


def wandering(seconds: float = 20.0) -> FloatArray:
    """Five sines without a common period in the time that they last."""
    time_s = np.arange(0.0, seconds, 1.0 / RATE_HZ)
    return 0.05 * sum(np.sin(2.0 * np.pi * f * time_s + f**2) for f in (0.31, 0.53, 0.82, 1.13, 1.37))


@pytest.mark.parametrize("seed", range(20))
def test_a_binary_signal_that_fills_its_log_is_found_or_a_candidate(seed: int) -> None:
    values = random_binary(seed)
    flight = record(phi_setpoint=values)
    found = find_excitations(flight, "roll")
    candidates = candidate_excitations(flight, "roll")
    (only,) = (*found, *candidates)
    assert only.kind == "random_binary"
    assert (only.start_s, only.stop_s) == (0.0, (values.size - 1) / RATE_HZ)


def test_motion_of_no_pattern_is_a_candidate_and_no_excitation() -> None:
    flight = record(roll_command=np.concatenate([np.zeros(100), wandering(), np.zeros(100)]))
    assert find_excitations(flight, "roll") == ()
    (candidate,) = candidate_excitations(flight, "roll")
    assert candidate.kind == "other"
    # The sum starts and ends within one period of its slowest part, 3.3 s, of where it was put.
    assert candidate.start_s == pytest.approx(5.0, abs=3.3)
    assert candidate.stop_s == pytest.approx(25.0, abs=3.3)


@pytest.mark.parametrize("seed", range(5))
def test_noise_and_rest_are_no_candidates(seed: int) -> None:
    noise = 0.05 * np.random.default_rng(seed).standard_normal(600)
    assert candidate_excitations(record(roll_command=noise), "roll") == ()
    assert candidate_excitations(record(roll_command=np.zeros(600)), "roll") == ()
    assert candidate_excitations(record(roll_command=np.full(600, np.nan)), "roll") == ()


def test_what_was_found_is_no_candidate_too() -> None:
    values = np.concatenate([np.zeros(100), random_binary(0), np.zeros(100)])
    flight = record(phi_setpoint=values)
    assert [m.kind for m in find_excitations(flight, "roll")] == ["random_binary"]
    assert candidate_excitations(flight, "roll") == ()


def test_a_setpoint_inside_a_quiet_one_is_feedback() -> None:
    quiet = np.zeros(400)
    flight = record(roll_stick=quiet, phi_setpoint=wandering(), roll_command=wandering())
    assert candidate_excitations(flight, "roll") == ()


def test_the_answer_of_a_controller_to_another_axis_is_no_candidate() -> None:
    excited = np.concatenate([np.zeros(100), random_binary(1), np.zeros(100)])
    answer = np.concatenate([np.zeros(100), wandering(), np.zeros(100)])
    flight = record(theta_setpoint=excited, phi_setpoint=answer)
    assert [m.kind for m in find_excitations(flight, "pitch")] == ["random_binary"]
    assert candidate_excitations(flight, "roll") == ()
    assert len(candidate_excitations(record(phi_setpoint=answer), "roll")) == 1


@pytest.mark.parametrize("seed", range(10))
def test_samples_between_two_levels_do_not_count(seed: int) -> None:
    holds = np.random.default_rng(seed).integers(3, 9, 60)
    levels = np.repeat((-1.0) ** np.arange(holds.size), holds)
    # A slow link or a filter: the last sample before a change and the first one after it are on the way.
    softened = levels.copy()
    change = np.flatnonzero(np.diff(levels))
    softened[change], softened[change + 1] = 0.4 * levels[change], 0.5 * levels[change + 1]
    # Two of 5.5 samples are: the levels alone do not fill the share of the time that tells them otherwise.
    assert np.mean(np.abs(softened) > 0.7) < 0.7
    assert classify(np.arange(levels.size) / RATE_HZ, softened)[0] == "random_binary"


# Not 5 Hz: four samples of a period may all lie at two levels, and nothing tells them from a square wave.
@pytest.mark.parametrize("frequency_hz", [0.3, 0.7, 1.0, 1.5, 2.0, 2.5, 3.3])
@pytest.mark.parametrize("phase", [0.1, 0.8, 1.5, 2.5])
def test_a_sine_is_not_binary_however_coarsely_it_is_sampled(frequency_hz: float, phase: float) -> None:
    time_s = np.arange(0.0, 30.0, 1.0 / RATE_HZ)
    assert classify(time_s, np.sin(2.0 * np.pi * frequency_hz * time_s + phase))[0] != "random_binary"


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("smooth", [2, 3, 5, 8])
def test_smooth_noise_is_not_binary(seed: int, smooth: int) -> None:
    white = np.random.default_rng(seed).standard_normal(800)
    noise = np.convolve(white, np.hanning(2 * smooth + 1), mode="same")
    assert classify(np.arange(noise.size) / RATE_HZ, noise)[0] != "random_binary"


@pytest.mark.parametrize("name", ["120935", "121028", "121250", "122633"])
def test_every_axis_of_the_bebop_flights_can_be_tried(
    name: str, shared_data: Path, unpacked: Callable[[str], Path]
) -> None:
    flight = rotorid.read(unpacked(f"bebop/ident/{name}.mat"), mapping=shared_data / "bebop" / "map.toml")
    for axis in ("roll", "pitch", "thrust"):
        (only,) = (*find_excitations(flight, axis), *candidate_excitations(flight, axis))
        assert only.kind == "random_binary"
        assert only.duration_s == pytest.approx(flight.stop_s - flight.start_s, abs=0.06)
