"""Loops of gains: parts of a controller add up to it, figures are those of theory, rules by hand have known margins."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from rotorid.models.controller import RateController
from rotorid.tuning import ControllerParts, Gains, frequency_grid, loop_figures, uncertain_plant
from rotorid.tuning.loops import loop_phases
from rotorid.typing import ComplexArray

PX4 = RateController(
    proportional_s=0.15,
    integral=0.2,
    derivative_s2=0.003,
    angle_1_s=6.5,
    derivative_cutoff_hz=30.0,
    step_s=1.0 / 400.0,
    late_integral=True,
)
ARDUPILOT = RateController(
    proportional_s=0.135,
    integral=0.135,
    derivative_s2=0.0036,
    angle_1_s=4.5,
    derivative_of_error=True,
    derivative_cutoff_hz=20.0,
    target_cutoff_hz=20.0,
    error_cutoff_hz=30.0,
    feedforward=0.01,
    step_s=1.0 / 400.0,
    late_angle=True,
)


@pytest.mark.parametrize("controller", [PX4, ARDUPILOT], ids=["px4", "ardupilot"])
def test_parts_add_up_to_the_controller(controller: RateController) -> None:
    omega = frequency_grid(controller)
    seen = np.exp(-0.004j * omega)
    parts = ControllerParts(controller=controller, omega_rad_s=omega, filters=seen, logged=np.ones_like(seen))
    gains = Gains.of(controller)
    np.testing.assert_allclose(parts.whole(gains), controller.response(omega, seen), rtol=1e-12)
    np.testing.assert_allclose(parts.rate(gains), controller.rate_loop.response(omega, seen), rtol=1e-12)
    assert gains.on(controller) == controller
    other = Gains(P=0.3, I=0.9, D=0.001, A=3.0)
    np.testing.assert_allclose(parts.whole(other), other.on(controller).response(omega, seen), rtol=1e-12)


# SIMC for k exp(-theta s)/(s (T s + 1)): lambda, crossover times theta, phase margin, gain margin in dB, M_s.
BY_HAND = [
    (1.0, 0.515, 46.9, 9.4, 1.70),
    (1.5, 0.412, 52.8, 11.5, 1.50),
    (2.0, 0.343, 56.7, 13.1, 1.39),
    (3.0, 0.257, 61.6, 15.7, 1.27),
]


@pytest.mark.parametrize(("wish", "crossover", "phase", "gain_db", "peak"), BY_HAND)
def test_rules_by_hand_have_their_margins(
    wish: float, crossover: float, phase: float, gain_db: float, peak: float
) -> None:
    theta, lag = 0.02, 0.05
    slowness = theta * (1.0 + wish)
    gain, reset = 1.0 / slowness, 4.0 * slowness
    s = 1j * np.geomspace(0.01, 600.0, 20_000)
    controller = gain * (1.0 + lag / reset) + gain / reset / s + gain * lag * s
    found = loop_figures(s.imag, (controller * np.exp(-theta * s) / (s * (lag * s + 1.0)))[None])
    assert found.crossover_rad_s[0] * theta == pytest.approx(crossover, abs=6e-4)
    assert np.degrees(found.phase_margin_rad[0]) == pytest.approx(phase, abs=0.06)
    assert 20.0 * np.log10(found.gain_margin[0]) == pytest.approx(gain_db, abs=0.06)
    assert found.sensitivity_peak[0] == pytest.approx(peak, abs=6e-3)
    assert found.stable[0] == 1.0


@pytest.mark.parametrize("factor", np.geomspace(0.05, 30.0, 14).tolist())
def test_stability_is_that_of_the_closed_loop(factor: float) -> None:
    """Of a rational loop with an integral: by the roots of its characteristic polynomial."""
    numerator, denominator = (
        factor * np.array([2.0, 10.0]),
        np.polymul([1.0, 0.0, 0.0], np.polymul([0.05, 1.0], [0.02, 1.0])),
    )
    roots = np.roots(np.polyadd(denominator, numerator))
    s = 1j * np.geomspace(0.005, 3000.0, 6000)
    loop = np.polyval(numerator, s) / np.polyval(denominator, s)
    assert bool(loop_figures(s.imag, loop[None]).stable[0]) == bool((roots.real < 0.0).all())


INTEGRAL_TOO_STRONG = [
    lambda s: 100.0 / s * (0.002 + 1.0 / s) * (1.0 + 8.0 / s) * np.exp(-0.01 * s),
    lambda s: 20.0 / (s**2 * (1.0 + 0.05 * s)),
]


@pytest.mark.parametrize("loop", INTEGRAL_TOO_STRONG)
def test_a_loop_that_never_rises_above_a_half_turn_is_unstable(loop: Callable[[ComplexArray], ComplexArray]) -> None:
    """Shifted by its highest phase it would be stable, with hundreds of degrees of phase margin."""
    for grid in (np.geomspace(0.5, 600.0, 170), np.geomspace(0.05, 3000.0, 4000)):
        found = loop_figures(grid, loop(1j * grid)[None])
        assert not found.stable[0]
        assert -60.0 < np.degrees(found.phase_margin_rad[0]) < 0.0


def test_stability_is_the_winding_of_one_plus_the_loop() -> None:
    """Random rational loops with up to three integrals: by their roots, and by the phase of 1 + L on a close grid."""
    rng = np.random.default_rng(5)
    s = 1j * np.geomspace(0.02, 600.0, 3000)
    answers = []
    for _ in range(300):
        integrals = int(rng.integers(1, 4))
        zeros, lags = -rng.uniform(0.5, 60.0, integrals - 1 + rng.integers(0, 2)), rng.uniform(0.003, 0.2, 3)
        numerator = 10.0 ** rng.uniform(-1.0, 4.0) * np.atleast_1d(np.poly(zeros)) / np.abs(np.prod(zeros))
        denominator = np.eye(integrals + 1)[0]
        for lag in lags:
            denominator = np.polymul(denominator, [lag, 1.0])
        values = np.polyval(numerator, s) / np.polyval(denominator, s)
        if np.abs(1.0 + values).min() < 0.05 or not abs(values[-1]) < 0.5 or abs(values[0]) < 2.0:
            continue
        stable = bool((np.roots(np.polyadd(denominator, numerator)).real < 0.0).all())
        assert bool(loop_figures(s.imag, values[None]).stable[0]) == stable
        turned = np.unwrap(np.angle(1.0 + values))
        begins = np.angle(values[0]) - (2.0 * np.pi if np.angle(values[0]) > np.radians(30.0) else 0.0)
        assert (abs(turned[-1] - turned[0] + begins) < np.pi) == stable
        answers.append(stable)
    assert 30 < sum(answers) < len(answers) - 30


def test_stability_counts_from_where_the_plant_is_known() -> None:
    """Speed modes below the band turn the phase of an identified plant once more; a good loop stays good."""
    plant = uncertain_plant(lambda w: 100.0 / (1j * w), None, band_rad_s=(2.0, 100.0))
    omega = np.geomspace(0.5, 600.0, 170)
    s = 1j * omega
    # Unstable slow poles with a weak static gain, as hover has them: below 2 rad/s the response is not an integrator's.
    slow = s**2 / (s**2 - 0.8 * s + 2.4**2)
    loop = (100.0 / s * slow * 0.1 * (1.0 + 3.0 / s) * (1.0 + 3.0 / s) * np.exp(-0.01 * s))[None]
    assert not loop_figures(omega, loop).stable[0]
    assert loop_figures(omega, loop, from_rad_s=plant.known_from_rad_s).stable[0]
    assert not loop_figures(omega, loop, from_rad_s=plant.band_rad_s[0]).stable[0]


def test_a_loop_that_never_reaches_one_has_no_crossover() -> None:
    omega = np.geomspace(0.5, 100.0, 200)
    found = loop_figures(omega, (0.1 / (1j * omega))[None])
    assert np.isnan(found.crossover_rad_s[0])
    assert found.usual_crossover_rad_s == 0.0


@pytest.mark.parametrize("place", [0.0, 0.5])
def test_a_loop_whose_gain_is_one_right_at_a_point_crosses_over_there(place: float) -> None:
    omega = np.geomspace(0.5, 600.0, 170)
    crossover = float(omega[80] * (omega[81] / omega[80]) ** place)
    found = loop_figures(omega, (crossover / (1j * omega))[None])
    assert found.crossover_rad_s[0] == pytest.approx(crossover)
    assert np.degrees(found.phase_margin_rad[0]) == pytest.approx(90.0)


@pytest.mark.parametrize("draws", [1, 30])
def test_phases_of_loops_are_continuous(draws: int) -> None:
    rng = np.random.default_rng(3)
    phases = np.cumsum(rng.uniform(-3.0, 2.5, (draws, 150)), axis=1)
    found = loop_phases(np.exp(1j * phases), 40)
    np.testing.assert_allclose(np.diff(found, axis=1), np.diff(phases, axis=1), atol=1e-12)
    assert np.all((found[:, 40] > np.radians(-330.0)) & (found[:, 40] <= np.radians(30.0)))
