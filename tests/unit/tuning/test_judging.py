"""The rule by which gains are judged: its thresholds, what is not known, noise, and the plant that breaks a loop."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from rotorid.models.controller import RateController
from rotorid.tuning import LoopFigures, UncertainPlant, frequency_grid, situations_of, uncertain_plant
from rotorid.tuning.judging import CommandNoise, Figures, LoopVerdict, loop_verdict, worst
from rotorid.typing import ComplexArray, FloatArray

OMEGA = frequency_grid(RateController(proportional_s=0.1, step_s=1.0 / 400.0))


def vehicle(omega: FloatArray) -> ComplexArray:
    return np.asarray(100.0 / (1j * omega) * np.exp(-0.01j * omega))


def plant(top_rad_s: float = 200.0, *, floor: float = 0.02) -> UncertainPlant:
    return uncertain_plant(vehicle, None, band_rad_s=(1.0, top_rad_s), floor=floor)


def verdict(
    known: UncertainPlant,
    P: float,
    I: float = 0.0,  # noqa: E741 - as everybody calls it
    A: float = 0.0,
    *,
    gain_range: tuple[float, float] = (1.0, 1.0),
    noise: CommandNoise | None = None,
) -> LoopVerdict:
    rate = P + I / (1j * OMEGA)
    whole = rate * (1.0 + A / (1j * OMEGA))
    return loop_verdict(known, situations_of(known, OMEGA, {"": (rate, whole)}, gain_range=gain_range), noise=noise)


@pytest.mark.parametrize(
    ("P", "expected"), [(0.2, "fly"), (0.5, "fly"), (0.73, "gently"), (0.9, "do_not_fly"), (3.0, "do_not_fly")]
)
def test_the_larger_the_gain_the_worse_the_verdict(P: float, expected: str) -> None:
    assert verdict(plant(), P).verdict == expected


@pytest.mark.parametrize(("integral", "angle"), [(1.0, 8.0), (3.0, 10.0)])
def test_an_integral_that_swings_slowly_is_never_flown(integral: float, angle: float) -> None:
    """Its peak sensitivity is small beyond the crossover; only the branch of the phase shows that it is unstable."""
    found = verdict(plant(), 0.002, integral, angle)
    assert (found.verdict, found.unstable) == ("do_not_fly", 1.0)
    assert np.isinf(found.breaking.sensitivity_peak)


def test_the_plant_that_breaks_the_loop_is_named() -> None:
    found = verdict(plant(), 0.9)
    assert found.breaking.sensitivity_peak == found.refused_peak > 2.4
    assert 80.0 < found.breaking.omega_rad_s < 200.0
    assert 0.9 < found.breaking.gain < 1.1
    assert abs(found.breaking.phase_deg) < 5.0


@pytest.mark.parametrize(("top", "expected"), [(40.0, "not_enough_data"), (200.0, "do_not_fly")])
def test_a_peak_that_was_not_measured_refuses_nothing(top: float, expected: str) -> None:
    """The most likely plant is good enough, and only the error beyond the band makes the loop worse."""
    found = verdict(plant(top, floor=0.04), 0.81)
    assert found.usual_peak < 2.4
    assert found.verdict == expected
    assert (found.known_to_rad_s > top) == (expected == "not_enough_data")


def test_what_is_bad_on_the_likeliest_plant_is_refused_wherever_its_peak_lies() -> None:
    assert verdict(plant(40.0), 1.2).verdict == "do_not_fly"


def test_a_crossover_beyond_all_that_is_known_is_never_safe() -> None:
    assert verdict(plant(5.0), 0.5).verdict == "not_enough_data"


def test_both_ends_of_the_throttle_count() -> None:
    assert verdict(plant(), 0.5).verdict == "fly"
    found = verdict(plant(), 0.5, gain_range=(0.8, 1.9))
    assert found.verdict == "do_not_fly"
    assert found.breaking.situation == "at 1.90 times the gain in hover"


@pytest.mark.parametrize(
    ("noise", "expected"),
    [
        (CommandNoise(ratio=1.5), "fly"),
        (CommandNoise(ratio=3.0), "gently"),
        (CommandNoise(ratio=3.0, rms=0.005), "fly"),
        (CommandNoise(ratio=3.0, rms=0.05), "gently"),
        (CommandNoise(ratio=3.0, rms=0.2), "do_not_fly"),
    ],
)
def test_noise_at_the_motors_counts(noise: CommandNoise, expected: str) -> None:
    found = verdict(plant(), 0.3, noise=noise)
    assert (found.verdict, found.noisy) == (expected, expected != "fly")


def test_the_worst_axis_decides() -> None:
    assert worst({"roll": "not_enough_data", "pitch": "do_not_fly", "yaw": "fly"}) == "do_not_fly"
    assert worst({"roll": "not_enough_data", "yaw": "gently"}) == "not_enough_data"


def shared_out(*groups: tuple[float, float]) -> LoopFigures:
    """Loops of 200 draws by the peaks of their sensitivities: share of the draws, and the peak of these."""
    peaks = np.concatenate([np.full(round(200 * share), peak) for share, peak in groups])
    same = {item.name: np.full(200, 10.0) for item in fields(LoopFigures)}
    return LoopFigures(**{**same, "sensitivity_peak": peaks, "stable": (peaks < 9.0).astype(float)})


CALM = shared_out((1.0, 1.2))


@pytest.mark.parametrize(
    ("groups", "expected"),
    [
        # The peak that every likely plant has.
        ([(1.0, 1.99)], "fly"),
        ([(1.0, 2.01)], "gently"),
        ([(1.0, 2.39)], "gently"),
        ([(1.0, 2.41)], "do_not_fly"),
        # The share of the plants that has a bad one.
        ([(0.955, 1.5), (0.045, 2.6)], "fly"),
        ([(0.945, 1.5), (0.055, 2.6)], "gently"),
        ([(0.905, 1.5), (0.095, 2.6)], "gently"),
        ([(0.895, 1.5), (0.105, 2.6)], "do_not_fly"),
    ],
)
@pytest.mark.parametrize("loop", ["rate", "whole"])
def test_a_twentieth_of_the_plants_may_be_above_2_and_a_tenth_above_2_4(
    groups: list[tuple[float, float]], expected: str, loop: str
) -> None:
    found = shared_out(*groups)
    figures = Figures(found, CALM) if loop == "rate" else Figures(CALM, found)
    assert loop_verdict(plant(), {"": figures}).verdict == expected


def test_a_loop_that_a_tenth_of_the_plants_makes_unstable_is_refused_whatever_its_peak() -> None:
    stable = np.arange(200) >= 21
    found = loop_verdict(plant(), {"": Figures(CALM, replace(CALM, stable=stable.astype(float)))})
    assert (found.verdict, found.refused_peak, found.unstable) == ("do_not_fly", np.inf, 0.105)


@pytest.mark.parametrize(("top", "expected"), [(1.7, "fly"), (1.6, "not_enough_data")])
def test_calm_loops_are_not_called_safe_where_they_cross_over_beyond_six_times_the_band(
    top: float, expected: str
) -> None:
    """They cross over at 10 rad/s."""
    assert loop_verdict(plant(top), {"": Figures(CALM, CALM)}).verdict == expected


@pytest.mark.parametrize(("floor", "expected"), [(0.09, "do_not_fly"), (0.12, "not_enough_data")])
def test_a_plant_that_is_known_to_10_percent_refuses_gains(floor: float, expected: str) -> None:
    figures = shared_out((0.8, 2.2), (0.2, 2.6))
    assert loop_verdict(plant(floor=floor), {"": Figures(figures, figures)}).verdict == expected
