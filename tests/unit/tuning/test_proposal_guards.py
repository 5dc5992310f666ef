"""Each limit of a proposal on a loop that it alone bounds: gain range, both ends of D, margins, share of the plants."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.models.controller import RateController
from rotorid.tuning import (
    ControllerParts,
    Gains,
    Judged,
    LoopFigures,
    Wishes,
    frequency_grid,
    judged,
    loop_figures,
    uncertain_plant,
)
from rotorid.tuning.proposal import _broken, _broken_limit, _gain, _inside, _kept, _limits_of_loops, _Plants, _Shape
from rotorid.typing import ComplexArray

CONTROLLER = RateController(proportional_s=0.1, derivative_s2=0.001, step_s=1.0 / 400.0)
OMEGA = frequency_grid(CONTROLLER)
ONES = np.ones(OMEGA.size, dtype=np.complex128)
PARTS = ControllerParts(controller=CONTROLLER, omega_rad_s=OMEGA, filters=ONES, logged=ONES)
BY_P = PARTS.rate(Gains(P=1.0, I=0.0, D=0.0, A=0.0))
FREE = Wishes(most_up=1e9, most_down=1e-9, noise=1e9)
"""No limit but those of the loop."""


def power_law(exponent: float, delay_s: float) -> ComplexArray:
    """A loop of a constant phase and a delay."""
    return np.asarray((1j * OMEGA) ** -exponent * np.exp(-1j * OMEGA * delay_s))


def gain_of(shape: _Shape, plants: ComplexArray, flown: Judged, wishes: Wishes) -> float | None:
    (limits,) = _limits_of_loops(PARTS, plants, 0, [shape], wishes)
    return _gain(PARTS, plants, limits, shape, flown, wishes, _kept(flown.gains, wishes))


def largest(loops: ComplexArray, wishes: Wishes) -> float:
    """The largest factor that the search allows on some loops of P alone."""
    plants = np.atleast_2d(loops) / BY_P
    flown = judged(PARTS, plants, Gains(P=1.0, I=0.0, D=0.0, A=0.0))
    found = gain_of(_Shape(0.0, 0.0, 0.0), plants, flown, wishes)
    assert found is not None
    return found


def figures(loop: ComplexArray, wishes: Wishes) -> LoopFigures:
    """Of the loop with that factor."""
    return loop_figures(OMEGA, largest(loop, wishes) * loop[None])


def scores(loop: ComplexArray) -> Judged:
    return judged(PARTS, loop[None] / BY_P, Gains(P=1.0, I=0.0, D=0.0, A=0.0))


def test_the_phase_margin_alone_bounds_a_loop_whose_phase_falls_slowly() -> None:
    found = figures(power_law(1.4, 0.01), FREE)
    assert np.degrees(found.phase_margin_rad[0]) == pytest.approx(45.0, abs=1.5)
    assert found.sensitivity_peak[0] < 1.6
    assert found.gain_margin[0] > 4.0


def test_the_gain_margin_alone_bounds_a_loop_whose_gain_falls_slowly() -> None:
    found = figures(power_law(0.5, 0.02), replace(FREE, sensitivity_peak=10.0))
    assert found.gain_margin[0] == pytest.approx(2.0, rel=0.03)
    assert np.degrees(found.phase_margin_rad[0]) > 60.0


def test_the_peak_alone_bounds_an_integral_with_a_delay() -> None:
    found = figures(power_law(1.0, 0.02), FREE)
    assert found.sensitivity_peak[0] == pytest.approx(1.7, abs=0.03)


def test_gains_hold_at_both_ends_of_the_flown_throttle() -> None:
    loop = power_law(1.0, 0.02)
    assert largest(loop, replace(FREE, gain_range=(0.7, 1.6))) == pytest.approx(largest(loop, FREE) / 1.6)


def test_a_loop_that_must_not_be_weaker_in_hover_has_to_hold_at_the_weak_end() -> None:
    """Given P: what holds between 0.7 and 1.6 times the gain in hover lies as far from both bounds."""
    s = 1j * OMEGA
    loop = 20.0 * (1.0 + 8.0 / s) / s**2 * (1.0 + 0.2 * s) * np.exp(-0.01 * s)
    plants = loop[None] / BY_P
    flown = judged(PARTS, plants, Gains(P=1.0, I=0.0, D=0.0, A=0.0))

    def allowed(P: float, gain_range: tuple[float, float]) -> bool:
        wishes = replace(FREE, sensitivity_peak=2.5, phase_margin_rad=0.3, gain_range=gain_range)
        return gain_of(_Shape(0.0, 0.0, 0.0, P), plants, flown, wishes) is not None

    tried = np.geomspace(0.05, 20.0, 60)
    wide, narrow = (np.array([allowed(float(P), both) for P in tried]) for both in ((1.0, 1.0), (0.5, 1.0)))
    assert wide.any()
    assert tried[narrow].min() == pytest.approx(2.0 * tried[wide].min(), rel=0.12)
    assert tried[narrow].max() == tried[wide].max()


def test_a_twentieth_of_the_likely_plants_may_miss_a_limit() -> None:
    sizes = np.exp(0.2 * np.random.default_rng(0).standard_normal(400))
    loop = power_law(1.0, 0.02)
    most = largest(loop, FREE)
    assert np.mean(largest(sizes[:, None] * loop, FREE) * sizes > most) == pytest.approx(0.05, abs=0.005)


def test_gains_hold_at_both_ends_of_a_d_that_moves() -> None:
    """Enough D for a calm loop, and far too much at the upper end: the gains of both ends are judged."""
    plants = _Plants(*(np.atleast_2d(60.0 / (1j * OMEGA) * np.exp(-0.01j * OMEGA)),) * 2, 0.0)
    gains = Gains(P=0.3, I=0.0, D=0.001, A=0.0)
    flown = judged(PARTS, plants.drawn, gains)
    upper = replace(PARTS, controller=replace(CONTROLLER, derivative_s2=0.02))
    reasons: list[str] = []
    for ends in ((), (PARTS,)):
        found = _inside(PARTS, plants, gains, flown, FREE, reasons, ends)
        assert found is not None
        assert found.gains == gains
    assert _inside(PARTS, plants, gains, flown, FREE, reasons, (PARTS, upper)) is None
    assert _inside(PARTS, plants, gains, flown, FREE, reasons, (upper, PARTS)) is None
    assert "with every set of gains that was tried" in reasons[0]


@pytest.mark.parametrize(("margin_deg", "broken"), [(46.0, ""), (44.0, "the phase margin is below 45°")])
def test_exact_gains_keep_45_degrees(margin_deg: float, broken: str) -> None:
    """The loop is calm by its peak, whatever its phase margin."""
    loop = power_law((180.0 - margin_deg) / 90.0, 0.0) * 5.0
    assert scores(loop).rate.sensitivity_peak[0] < 1.6
    assert _broken(scores(loop), replace(FREE, sensitivity_peak=1.7)) == broken


@pytest.mark.parametrize(("margin_deg", "broken"), [(41.0, ""), (39.0, "the phase margin is below 40°")])
def test_flown_gains_are_fine_down_to_40_degrees(margin_deg: float, broken: str) -> None:
    loop = power_law((180.0 - margin_deg) / 90.0, 0.0) * 5.0
    plant = uncertain_plant(lambda omega: 5.0 / (1j * omega), None, band_rad_s=(1.0, 100.0), draws=2)
    assert _broken_limit(scores(loop), plant, Wishes()) == broken
