"""Test inputs as parts of a plan: by name, at once, one after the other."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest

from rotorid.data.flight_plan import PlannedInput, Shape
from rotorid.errors import UsageError
from rotorid.excitation import (
    balanced_three_two_one_one,
    halved,
    interleaved,
    logarithmic_sweep,
    multisine,
    pilot_sweep,
    planned,
    random_binary,
    relative_peak_factor,
    sequence,
    together,
    two_one_one,
)

HZ = 2.0 * math.pi
BAND = (HZ * 0.2, HZ * 4.0)
STEPS = ("doublet", "two_one_one", "three_two_one_one")


def wish(shape: str, **change: Any) -> dict[str, Any]:
    settings: dict[str, Any] = {"start_s": 2.0, "amplitude": 0.1, "duration_s": 14.0, "sample_rate_hz": 50.0}
    if shape not in STEPS:
        settings["band_rad_s"] = BAND
    return settings | change


@pytest.mark.parametrize("shape", [shape for shape in get_args(Shape) if shape != "sticks"])
def test_every_shape_of_a_plan_can_be_planned(shape: Shape) -> None:
    one = planned("pitch", shape, **wish(shape), entry="rate_setpoint")
    assert (one.axis, one.shape, one.start_s, one.entry) == ("pitch", shape, 2.0, "rate_setpoint")
    # A multisine has one zero more, with which it ends.
    assert one.stop_s - one.start_s == pytest.approx(14.0, abs=0.02 + 1e-9)
    assert 0.09 < np.abs(one.values).max() <= 0.1
    assert one.band_rad_s == (None if shape in STEPS else BAND)
    again = planned("pitch", shape, **wish(shape), **dict(one.settings))
    np.testing.assert_array_equal(again.values, one.values)
    assert dict(again.settings) == dict(one.settings)


@pytest.mark.parametrize(
    ("shape", "settings", "make"),
    [
        (
            "pilot_sweep",
            {"slow_cycles": 1.0, "fade_s": 2.0, "noise_fraction": 0.1, "seed": 3},
            lambda common: pilot_sweep(
                **common, slow_cycles=1.0, fade_s=2.0, noise_fraction=0.1, rng=np.random.default_rng(3), trim_s=0.0
            ),
        ),
        (
            "logarithmic_sweep",
            {"constant_s": 5.0, "fade_in_s": 3.0, "fade_out_s": 0.5},
            lambda common: logarithmic_sweep(**common, constant_s=5.0, fade_in_s=3.0, fade_out_s=0.5, trim_s=0.0),
        ),
        (
            "random_binary",
            {"passes": 2, "seed": 5},
            lambda common: random_binary(**common, passes=2, rng=np.random.default_rng(5), trim_s=0.0),
        ),
        (
            "multisine",
            {"periods": 2, "first_harmonic": 3, "harmonic_step": 2, "seed": 1},
            lambda common: multisine(np.arange(3, 29, 2), amplitude=0.1, period_s=7.0, seed=1).sampled(50.0, periods=2),
        ),
    ],
)
def test_settings_reach_their_shape(shape: Shape, settings: dict[str, Any], make: Any) -> None:
    one = planned("roll", shape, **wish(shape), **settings)
    common = {"amplitude": 0.1, "band_rad_s": BAND, "duration_s": 14.0, "sample_rate_hz": 50.0}
    np.testing.assert_array_equal(one.values, make(common))
    assert settings.items() <= dict(one.settings).items()


def test_duration_of_steps_is_that_of_all_of_them() -> None:
    one = planned("yaw", "two_one_one", **wish("two_one_one", duration_s=2.0))
    np.testing.assert_array_equal(one.values, two_one_one(amplitude=0.1, unit_s=0.5, sample_rate_hz=50.0, trim_s=0.0))
    two = planned("yaw", "three_two_one_one", **wish("three_two_one_one", balanced=1.0))
    balanced = balanced_three_two_one_one(amplitude=0.1, unit_s=2.0, sample_rate_hz=50.0, trim_s=0.0)
    np.testing.assert_array_equal(two.values, balanced)


def test_trim_is_part_of_the_input() -> None:
    plain, rested = (planned("roll", "doublet", **wish("doublet"), trim_s=trim_s) for trim_s in (0.0, 1.5))
    np.testing.assert_array_equal(rested.values, np.pad(plain.values, 75))


@pytest.mark.parametrize(
    ("shape", "change", "said"),
    [
        ("multisin", {}, "did you mean multisine"),
        ("logarithmic_sweep", {"fade_ins": 1.0}, "did you mean fade_in_s"),
        ("doublet", {"passes": 3.0}, "no setting of a doublet"),
        ("doublet", {"band_rad_s": BAND}, "takes no band"),
        ("multisine", {"band_rad_s": None}, "needs a band"),
        ("multisine", {"periods": 1.5}, "whole number from 1"),
        ("multisine", {"first_harmonic": 500.0}, "invalid harmonics none"),
        ("random_binary", {"seed": -1}, "whole number from 0"),
    ],
)
def test_what_cannot_be_planned_is_refused(shape: Any, change: dict[str, Any], said: str) -> None:
    with pytest.raises(UsageError, match=said):
        planned("roll", shape, **wish(shape, **change))


@pytest.mark.parametrize(("layout", "combs"), [("halved", halved), ("interleaved", interleaved)])
def test_axes_together_are_orthogonal_and_take_the_combs(layout: Any, combs: Any) -> None:
    amplitudes: Any = {"yaw": 0.3, "roll": 0.1, "pitch": 0.2}
    inputs = together(
        amplitudes, start_s=5.0, band_rad_s=BAND, period_s=10.0, sample_rate_hz=50.0, periods=3, layout=layout
    )
    assert [one.axis for one in inputs] == ["yaw", "roll", "pitch"]
    values = np.stack([one.values for one in inputs])
    for window in (slice(0, None), slice(500, 1000)):
        products = values[:, window] @ values[:, window].T
        energies = np.sqrt(np.diag(products))
        np.testing.assert_allclose(products / np.outer(energies, energies), np.eye(3), atol=1e-12)
    for one, comb in zip(inputs, combs(3, band_rad_s=BAND, period_s=10.0), strict=True):
        lines = np.abs(np.fft.rfft(one.values[:500]))
        np.testing.assert_array_equal(np.flatnonzero(lines > 1e-9 * lines.max()), comb)
        assert np.abs(one.values).max() <= amplitudes[one.axis]
        assert relative_peak_factor(one.values) <= 1.1


def test_a_single_harmonic_per_axis_is_a_sine() -> None:
    inputs = together(
        {"roll": 1.0, "pitch": 1.0}, start_s=0.0, band_rad_s=(HZ * 0.2, HZ * 0.3), period_s=10.0, sample_rate_hz=50.0
    )
    for one, cycles in zip(inputs, (3, 2), strict=True):
        lines = np.abs(np.fft.rfft(one.values[:500]))
        np.testing.assert_array_equal(np.flatnonzero(lines > 1e-9 * lines.max()), [cycles])


def test_unknown_layouts_are_refused() -> None:
    with pytest.raises(UsageError, match="did you mean interleaved"):
        together({"roll": 1.0}, start_s=0.0, band_rad_s=BAND, period_s=9.0, sample_rate_hz=50.0, layout="interleave")  # type: ignore[arg-type]


def test_a_sequence_rests_between_its_parts_and_keeps_groups_together() -> None:
    step = planned("roll", "doublet", **wish("doublet", duration_s=1.0))
    pair = (replace(step, start_s=7.0), replace(step, axis="pitch", start_s=7.5))
    plan = sequence("mixed", [step, pair, step], trim_s=4.0)
    starts = [(one.axis, one.start_s) for one in plan.inputs]
    assert starts == [("roll", 4.0), ("roll", 9.0), ("pitch", 9.5), ("roll", 14.5)]
    assert plan.duration_s == 19.5
    assert all(isinstance(one, PlannedInput) for one in plan.inputs)
    with pytest.raises(UsageError, match="empty part"):
        sequence("nothing", [()])
