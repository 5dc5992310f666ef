"""Proposals: closed-form bounds are those of a scan, limits hold on plants that were not drawn, good gains stay."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from rotorid.data.trust import REFUSED_PEAK, REFUSED_QUANTILE, ROBUSTNESS, SAFE_PEAK
from rotorid.models.controller import RateController
from rotorid.tuning import (
    ControllerParts,
    Gains,
    MeasuredRatio,
    UncertainPlant,
    Wishes,
    frequency_grid,
    judged,
    loop_figures,
    propose,
    uncertain_plant,
)
from rotorid.tuning.proposal import (
    _bounds,
    _gain,
    _kept,
    _limits_of_loops,
    _Shape,
    flights_between,
    robustness_in_words,
    steps_beyond,
)
from rotorid.typing import ComplexArray, FloatArray

FLOWN = RateController(
    proportional_s=0.08,
    integral=0.08,
    derivative_s2=0.0015,
    angle_1_s=4.0,
    derivative_cutoff_hz=30.0,
    step_s=1.0 / 400.0,
    late_integral=True,
)


def vehicle(w: FloatArray) -> ComplexArray:
    """The default roll of PX4's own simulator, with a delay."""
    return np.asarray(113.1 / ((0.048j * w + 1.0) * (1j * w + 1.0)) * np.exp(-0.012j * w))


def known(draws: int = 40, seed: int = 0) -> UncertainPlant:
    return uncertain_plant(vehicle, None, band_rad_s=(1.0, 100.0), draws=draws, seed=seed)


@pytest.mark.parametrize("shape", [(0.5, 0.0, 3.0), (2.0, 0.02, 4.0), (8.0, 0.015, 5.0)])
def test_bounds_in_closed_form_are_those_of_a_scan(shape: tuple[float, float, float]) -> None:
    a, d, A = shape
    omega = frequency_grid(FLOWN)
    ones = np.ones(omega.size, dtype=np.complex128)
    parts = ControllerParts(controller=FLOWN, omega_rad_s=omega, filters=ones, logged=ones)
    loop = vehicle(omega) * parts.whole(Gains(P=1.0, I=a, D=d, A=A))
    low, high = _bounds(loop[None], Wishes(gain_margin=1.0), None)
    tried = np.geomspace(1e-3, 3.0, 800)
    peaks = loop_figures(omega, tried[:, None] * loop[None])
    holds = tried[(peaks.sensitivity_peak <= 1.7) & (peaks.stable == 1.0)]
    if not holds.size:
        assert high[0] < 1.05 * low[0]
        return
    # Below all integral action a loop is calm again; the bounds look at the part where it acts.
    holds = holds[holds >= 0.5 * low[0]]
    step = tried[1] / tried[0]
    assert holds.max() == pytest.approx(high[0], rel=step - 1.0)
    assert holds.min() == pytest.approx(max(low[0], holds.min()), rel=step - 1.0)


def test_limits_of_shapes_together_are_those_of_each() -> None:
    parts = bare_parts()
    plants = np.array([[0.8], [1.0], [1.3]]) * vehicle(parts.omega_rad_s)
    shapes = [_Shape(2.0, 0.015, A) for A in (0.0, 2.0, 4.0, 9.0)]
    together = _limits_of_loops(parts, plants, 3, shapes, Wishes())
    for shape, limits in zip(shapes, together, strict=True):
        (alone,) = _limits_of_loops(parts, plants, 3, [shape], Wishes())
        for shared, own in zip(limits, alone, strict=True):
            assert np.array_equal(shared, own)
        unit = Gains(P=1.0, I=shape.a, D=shape.d, A=shape.A)
        assert limits.noise == parts.noise(unit)
        assert np.array_equal(limits.rate, parts.rate(unit))
        rate = _bounds(plants * parts.rate(unit), Wishes(), Wishes().phase_margin_rad, start=3)
        whole = _bounds(plants * parts.whole(unit), Wishes(), None, start=3)
        assert np.array_equal(limits.low, np.maximum(rate[0], whole[0]))
        assert np.array_equal(limits.high, np.minimum(rate[1], whole[1]))


def test_no_factor_is_offered_where_none_makes_the_loop_stable() -> None:
    """The phase lies below -180 degrees everywhere, that of the last loop below -180 degrees plus the margin."""
    s = 1j * np.geomspace(0.5, 600.0, 170)
    unstable = np.stack(
        [100.0 / s * (0.002 + 1.0 / s) * (1.0 + 8.0 / s) * np.exp(-0.01 * s), 20.0 / s**2 / (1.0 + 0.05 * s)]
    )
    low, high = _bounds(unstable, Wishes(), None)
    assert (low > 1e3 * high).all()
    little = (20.0 * (1.0 + s / 8.0) / s**2 / (1.0 + 0.05 * s))[None]
    assert loop_figures(s.imag, little).stable[0]
    low, high = _bounds(little, Wishes(sensitivity_peak=2.5, gain_margin=1.0), float(np.radians(45.0)))
    assert (low > 1e3 * high).all()


def test_flown_gains_with_too_much_integral_are_unstable_and_come_down() -> None:
    """They swing slowly; shifted by its highest phase their loop had a peak inside the limits."""
    swinging = Gains(P=0.002, I=0.5, D=0.0, A=8.0).on(replace(FLOWN, derivative_s2=0.0))
    found = propose("roll", known(), swinging)
    assert not found.flown.whole.stable.any()
    assert np.median(found.flown.whole.phase_margin_rad) < 0.0
    assert any("today the loop may be unstable" in reason for reason in found.reasons)
    assert found.proposed.whole.stable.all() or not found.changed


def test_the_advice_names_the_gain_that_swings_the_loop() -> None:
    """Slow swings are those of the integral, fast ones those of P and D."""
    none = Wishes(most_up=1.0, most_down=1.0, angle_down=1.0, noise=0.1)
    slow = Gains(P=0.03, I=0.5, D=0.001, A=3.0).on(FLOWN)
    fast = Gains(P=1.5, I=0.3, D=0.02, A=5.0).on(FLOWN)
    for controller, name in ((slow, "lower I by hand"), (fast, "lower P and D by hand")):
        found = propose("roll", known(), controller, wishes=none)
        assert not found.changed
        assert not found.flown.whole.stable.any()
        assert any(name in reason for reason in found.reasons)


def test_soft_gains_are_raised_and_hold_on_other_draws() -> None:
    found = propose("roll", known(), FLOWN)
    assert found.changed
    assert found.better < 0.8
    parts = ControllerParts(
        controller=FLOWN,
        omega_rad_s=(omega := frequency_grid(FLOWN)),
        filters=np.ones(omega.size, dtype=np.complex128),
        logged=np.ones(omega.size, dtype=np.complex128),
    )
    again = judged(parts, known(200, seed=7).drawn(omega), found.proposed.gains)
    assert np.mean(again.whole.sensitivity_peak <= 1.75) > 0.9
    assert np.mean(again.rate.sensitivity_peak <= 1.75) == 1.0
    assert again.rate.stable.all()
    assert again.whole.stable.all()


def test_hot_gains_come_down() -> None:
    hot = Gains(P=0.45, I=0.6, D=0.004, A=10.0).on(FLOWN)
    found = propose("roll", known(), hot)
    assert found.changed
    assert np.median(found.flown.whole.sensitivity_peak) > 1.8
    assert np.quantile(found.proposed.whole.sensitivity_peak, 0.95) <= 1.75
    assert any("today M_s" in reason for reason in found.reasons)


def test_flown_gains_are_fine_up_to_where_every_command_calls_them_so() -> None:
    """Gains come down where half of the plants are above 2, or a tenth above 2.4, and not for being above 1.7."""
    best = propose("roll", known(), FLOWN).proposed.gains
    found_peaks = []
    for factor in (1.1, 1.2, 1.3, 1.5, 1.8):
        hot = Gains(P=factor * best.P, I=best.I, D=factor * best.D, A=best.A).on(FLOWN)
        found = propose("roll", known(), hot, wishes=Wishes(most_up=1.0))
        peaks = np.maximum(found.flown.rate.sensitivity_peak, found.flown.whole.sensitivity_peak)
        lowered = any("today M_s" in reason for reason in found.reasons)
        assert lowered == (np.median(peaks) > SAFE_PEAK or np.quantile(peaks, REFUSED_QUANTILE) > REFUSED_PEAK)
        assert found.better <= 1.0 or lowered
        found_peaks.append(float(np.median(peaks)))
    assert any(ROBUSTNESS < peak < SAFE_PEAK for peak in found_peaks)


def test_proposed_gains_stay_when_they_are_flown() -> None:
    wishes = Wishes(most_up=1.0)
    best = propose("roll", known(), Gains(P=0.25, I=0.8, D=0.006, A=5.5).on(FLOWN)).proposed.gains
    found = propose("roll", known(), best.on(FLOWN), wishes=wishes)
    assert not found.changed
    assert "clearly better" in found.reasons[0]


def test_caps_ranges_and_kept_gains() -> None:
    found = propose("roll", known(), FLOWN)
    assert 2.0 * FLOWN.proportional_s * 1.0001 >= found.proposed.gains.P
    assert 2.0 * FLOWN.angle_1_s >= found.proposed.gains.A
    kept = propose("roll", known(), FLOWN, wishes=Wishes(keep=("I", "A")))
    assert kept.changed
    assert (FLOWN.integral, FLOWN.angle_1_s) == (kept.proposed.gains.I, kept.proposed.gains.A)
    capped = propose("roll", known(), FLOWN, wishes=Wishes(ranges={"I": (0.0, 0.1), "P": (0.0, 0.1)}))
    assert capped.proposed.gains.I <= 0.1001
    assert capped.proposed.gains.P <= 0.1001
    quiet = propose("roll", known(), FLOWN, wishes=Wishes(noise=1.0))
    assert quiet.proposed.noise <= 1.001 * quiet.flown.noise


@pytest.mark.parametrize("keep", ["I", "D", "ID", "PD", "IDA"])
def test_kept_gains_stay_to_the_last_digit(keep: str) -> None:
    """Others move around them, and hold their limits with them."""
    found = propose("roll", known(), FLOWN, wishes=Wishes(keep=tuple(keep)))
    flown, proposed = found.flown.gains.as_dict(), found.proposed.gains.as_dict()
    assert {name: proposed[name] for name in keep} == {name: flown[name] for name in keep}
    assert found.changed
    assert proposed["P"] > flown["P"] or "P" in keep
    assert np.quantile(found.proposed.whole.sensitivity_peak, 0.9) <= 1.75


def test_a_kept_gain_may_lie_outside_the_range_of_its_firmware() -> None:
    """Bounds of a gain are for those that move."""
    found = propose("roll", known(), FLOWN, wishes=Wishes(keep=("D",), ranges={"D": (0.0, 0.001)}))
    assert found.changed
    assert FLOWN.derivative_s2 == found.proposed.gains.D


@pytest.mark.parametrize(
    ("name", "limits"), [("A", (10.0, 12.0)), ("P", (0.2, 0.5)), ("P", (0.001, 0.03)), ("D", (0.004, 0.05))]
)
def test_a_gain_far_outside_its_range_stays(name: str, limits: tuple[float, float]) -> None:
    """The range is no reason to more than double a gain, nor to more than halve P."""
    found = propose("roll", known(), FLOWN, wishes=Wishes(ranges={name: limits}))
    assert found.changed
    assert getattr(found.proposed.gains, name) == getattr(found.flown.gains, name)
    assert any(reason.startswith(f"{'angle P' if name == 'A' else name} stays at") for reason in found.reasons)


def test_softer_wishes_give_softer_loops() -> None:
    firm = propose("roll", known(), Gains(P=0.2, I=0.2, D=0.003, A=5.0).on(FLOWN))
    soft = propose("roll", known(), Gains(P=0.2, I=0.2, D=0.003, A=5.0).on(FLOWN), wishes=Wishes(sensitivity_peak=1.4))
    assert np.median(soft.proposed.whole.sensitivity_peak) < np.median(firm.proposed.whole.sensitivity_peak)


def test_yaw_has_no_derivative() -> None:
    flown = replace(FLOWN, derivative_s2=0.0, command_cutoff_hz=2.0)

    def slow(w: FloatArray) -> ComplexArray:
        return np.asarray(20.0 / (1j * w + 0.5) * np.exp(-0.02j * w))

    found = propose("yaw", uncertain_plant(slow, None, band_rad_s=(0.5, 60.0), draws=30), flown)
    assert found.proposed.gains.D == 0.0


def test_a_measurement_pulls_the_plant_from_a_wrong_model() -> None:
    """A model without the lag of its motors is corrected by what was measured, inside the band."""
    omega = np.geomspace(2.0, 80.0, 40)

    def lagless(w: FloatArray) -> ComplexArray:
        return np.asarray(113.1 / (1j * w + 1.0) * np.exp(-0.012j * w))

    noise = 1e-4 * np.eye(omega.size)
    ratio = MeasuredRatio(omega_rad_s=omega, ratio=vehicle(omega) / lagless(omega), covariance=noise)
    plant = uncertain_plant(lagless, ratio, band_rad_s=(2.0, 80.0), draws=100)
    inside = np.geomspace(4.0, 60.0, 20)
    error = np.abs(plant.response(inside) / vehicle(inside) - 1.0)
    assert error.max() < 0.05
    drawn = np.abs(plant.drawn(inside) / vehicle(inside) - 1.0)
    assert np.median(drawn) < 0.05
    outside = np.array([0.2, 400.0])
    spread = np.std(np.log(np.abs(plant.drawn(outside))), axis=0)
    assert (spread > 0.1).all()


def bare_parts(controller: RateController = FLOWN) -> ControllerParts:
    omega = frequency_grid(controller)
    ones = np.ones(omega.size, dtype=np.complex128)
    return ControllerParts(controller=controller, omega_rad_s=omega, filters=ones, logged=ones)


def slow_yaw(w: FloatArray) -> ComplexArray:
    return np.asarray(20.0 / (1j * w + 0.5) * np.exp(-0.02j * w))


def test_the_rate_loop_crosses_over_far_above_the_angle_gain() -> None:
    """Without that rule this yaw would be given an angle gain at its crossover."""
    flown = replace(FLOWN, derivative_s2=0.0, command_cutoff_hz=2.0)
    found = propose("yaw", uncertain_plant(slow_yaw, None, band_rad_s=(0.5, 60.0), draws=30), flown).proposed
    assert np.quantile(found.rate.crossover_rad_s, 0.1) >= 3.0 * found.gains.A


def test_a_shape_that_leaves_no_room_between_its_least_and_largest_gain_is_refused() -> None:
    """A battery that sags takes a quarter of the gain, and a loop with a strong integral swings then."""
    parts, plants = bare_parts(), vehicle(frequency_grid(FLOWN))[None]
    flown, wishes = judged(parts, plants, Gains.of(FLOWN)), Wishes(most_up=1e3, most_down=1e-3, noise=1e3)
    answers = {}
    for a in np.geomspace(1.0, 12.0, 60):
        unit = Gains(P=1.0, I=a, D=0.015, A=4.0)
        pairs = [
            _bounds(plants * loop, wishes, margin)
            for loop, margin in ((parts.rate(unit), wishes.phase_margin_rad), (parts.whole(unit), None))
        ]
        room = min(high[0] for _, high in pairs) / max(max(low[0] for low, _ in pairs), 1e-9)
        shape = _Shape(a, 0.015, 4.0)
        (limits,) = _limits_of_loops(parts, plants, 0, [shape], wishes)
        answers[room] = _gain(parts, plants, limits, shape, flown, wishes, _kept(flown.gains, wishes))
    narrow = [k for room, k in answers.items() if 1.02 < room < 1.28]
    assert narrow
    assert all(k is None for k in narrow)
    assert any(k is not None for room, k in answers.items() if room > 1.5)


def test_several_flights_lead_to_a_goal_that_keeps_the_limits() -> None:
    """A quarter of the gains: the first flight doubles them, the second goes on, each inside the limits."""
    soft = Gains(P=0.03, I=0.03, D=0.0006, A=1.5).on(FLOWN)
    wishes, parts = Wishes(), bare_parts()
    first = propose("roll", known(), soft, parts=parts)
    steps = steps_beyond("roll", known(), first, parts=parts, wishes=wishes)
    assert len(steps) == 2
    path = [first.flown, first.proposed, *steps]
    for before, after in pairwise(path[:3]):
        assert after.gains.P <= 2.0001 * before.gains.P
        assert after.gains.A <= 2.0001 * before.gains.A
        assert after.gains.D <= 2.0001 * before.gains.D
    for one in path[1:]:
        assert np.quantile(one.whole.sensitivity_peak, 0.95) <= 1.72
        assert one.whole.stable.all()
        assert one.noise <= 2.0 * first.flown.noise * 1.001
    stiffness = [float(np.median(one.attitude_rms)) for one in path]
    assert stiffness == sorted(stiffness, reverse=True)
    assert flights_between(path[1].gains, path[3].gains, wishes) >= 2


def test_a_proposal_that_no_step_ends_has_no_further_flights() -> None:
    best = propose("roll", known(), FLOWN, wishes=Wishes(most_up=16.0, noise=10.0)).proposed.gains
    softer = Gains(P=0.7 * best.P, I=0.7 * best.I, D=0.7 * best.D, A=best.A).on(FLOWN)
    first = propose("roll", known(), softer, parts=bare_parts())
    assert first.changed
    assert steps_beyond("roll", known(), first, parts=bare_parts(), wishes=Wishes()) == ()


def test_robustness_is_told_in_words() -> None:
    assert robustness_in_words(1.4).startswith("M_s up to 1.4 (soft): stable if the gain grows 3.5 times")
    assert "the phase drops 29°" in robustness_in_words(2.0)
    assert "firm" in robustness_in_words(2.0)
    assert "AutoTune" in robustness_in_words(2.5)


@pytest.mark.parametrize("lowest", [0.0, 3.0])
def test_a_slow_yaw_may_keep_its_angle_gain_where_the_firmware_takes_no_lower_one(lowest: float) -> None:
    """ArduPilot's yaw: an error filter of 2.5 Hz, a crossover of 3 rad/s, and no A below 3 1/s."""
    plant = uncertain_plant(
        lambda omega: 20.0 / (1j * omega) * np.exp(-0.003j * omega), None, band_rad_s=(0.6, 60.0), draws=40
    )
    flown = RateController(
        proportional_s=0.16, integral=0.01, angle_1_s=4.5, error_cutoff_hz=2.5, step_s=1.0 / 400.0, late_integral=True
    )
    found = propose("yaw", plant, flown, wishes=Wishes(ranges={"A": (lowest, 12.0)}))
    crossover = found.proposed.rate.usual_crossover_rad_s
    if lowest == 0.0:
        assert not found.changed or crossover >= 2.9 * found.proposed.gains.A
        return
    assert found.changed
    assert lowest <= found.proposed.gains.A
    assert crossover < 3.0 * found.proposed.gains.A
    assert np.quantile(found.proposed.whole.sensitivity_peak, 0.95) <= 1.72
