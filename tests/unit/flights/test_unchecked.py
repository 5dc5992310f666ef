"""Errors that a log does not show have their usual size: none of them may count as zero."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.response import FrequencyResponse
from rotorid.fitting.frequency.error_shapes import response_error_shapes
from rotorid.flights.consistency import Consistency, Stretch
from rotorid.flights.unchecked import (
    USUAL_BIAS,
    USUAL_LEAN,
    USUAL_OTHER_LEAN,
    USUAL_SCALE,
    USUAL_SLOPE,
    unchecked_scales,
    with_unchecked_errors,
)
from rotorid.signal.kinematics import KinematicCheck
from rotorid.typing import FloatArray

OMEGA = np.geomspace(0.7, 50.0, 60)
STRETCH = Stretch(axes=("roll",), start_s=0.0, stop_s=60.0)


def response(source: str = "roll_command", **known: FloatArray) -> FrequencyResponse:
    ones = np.ones((1, 1, OMEGA.size))
    found = FrequencyResponse(
        omega_rad_s=OMEGA,
        values=ones.astype(np.complex128),
        coherence=0.99 * ones,
        random_error=0.01 * ones,
        covariance=1e-4 * np.eye(OMEGA.size)[None, None].astype(np.complex128),
        inputs=(source,),
        outputs=("p",),
        estimate="joint",
    )
    return replace(found, **known)  # type: ignore[arg-type]


LOOKED_AT = {"lean_errors": 0.001 * np.ones((1, OMEGA.size)), "slope_changes": 0.001 * np.ones((1, OMEGA.size))}


@pytest.mark.parametrize(
    ("source", "known", "feedback", "alike", "own"),
    [
        ("roll_command", (), False, USUAL_SLOPE, USUAL_LEAN),
        ("roll_command", ("lean_errors", "theta"), False, USUAL_SLOPE, USUAL_LEAN),
        ("roll_command", ("lean_errors", "phi"), False, USUAL_SLOPE, USUAL_OTHER_LEAN),
        ("pitch_command", ("slope_changes",), False, 0.0, USUAL_LEAN),
        ("roll_command", ("lean_errors",), False, USUAL_SLOPE, 0.0),
        ("yaw_command", (), False, USUAL_SLOPE, 0.0),  # nothing leans in yaw
        ("roll_command", ("lean_errors", "slope_changes"), True, 0.0, USUAL_BIAS),
        ("roll_command", ("slope_changes",), True, 0.0, float(np.hypot(USUAL_LEAN, USUAL_BIAS))),
        ("phi_setpoint", (), False, 0.0, 0.0),  # no command: thrust has no part in it
    ],
)
def test_what_was_not_looked_at_has_its_usual_size(
    source: str, known: tuple[str, ...], feedback: bool, alike: float, own: float
) -> None:
    looked_at = {name: LOOKED_AT[name] for name in known if name in LOOKED_AT}
    angles = [name for name in ("phi", "theta") if name in known] or (
        ["phi", "theta"] if "lean_errors" in known else []
    )
    found, findings = with_unchecked_errors(
        response(source, **looked_at), angles=angles, curvature=1.0, feedback=feedback
    )
    if not alike and not own:
        assert (found.unchecked_errors, findings) == (None, ())
        return
    assert found.unchecked_errors is not None
    fast = found.unchecked_errors[:, 0, -1]  # where feedback biases least
    np.testing.assert_allclose(fast, [alike, own], rtol=1e-12)
    assert {finding.kind for finding in findings} == {"error_not_checked"}


def test_thrust_in_proportion_to_its_command_leaves_nothing_to_look_at() -> None:
    found, findings = with_unchecked_errors(response(), angles=[], curvature=0.0, feedback=False)
    assert found.unchecked_errors is None
    assert findings == ()


def test_the_columns_have_the_size_that_is_stated() -> None:
    """Magnitudes of all responses to an input err alike, and magnitude and phase of each by themselves."""
    count = OMEGA.size
    omega = np.tile(OMEGA, 2)
    output, source = np.repeat([0, 1], count), np.zeros(2 * count, dtype=np.int64)
    sizes = np.stack([np.full(2 * count, 0.015), np.full(2 * count, 0.02)])
    common: Mapping[str, object] = {"outputs": ["p", "ay"], "inputs": ["roll_command"], "clock_error_s": None}
    shapes = response_error_shapes(
        omega,
        output,
        source,
        np.ones(4 * count),
        unchecked_errors=sizes,
        **common,  # type: ignore[arg-type]
    )
    # Behind the scales of one input and two outputs.
    known = shapes.known[:, 3:]
    covariance = known @ known.T
    np.testing.assert_allclose(np.diag(covariance)[: 2 * count], 0.015**2 + 0.02**2, rtol=0.02)
    np.testing.assert_allclose(np.diag(covariance)[2 * count :], 0.02**2, rtol=0.02)
    # The same frequency of the other output shares the slope of thrust, and nothing else.
    assert covariance[30, count + 30] == pytest.approx(0.015**2, rel=0.02)
    assert covariance[2 * count + 30, 3 * count + 30] == pytest.approx(0.0, abs=1e-12)


def check(verdict: str, scale: float = 1.0, std: float = 0.001, channel: str = "p") -> Consistency:
    one = KinematicCheck(
        channel=channel,
        against="phi",
        scale=scale,
        scale_std=std,
        bias=0.0,
        bias_std=0.001,
        lag_s=0.0,
        lag_std_s=0.001,
        band_rad_s=(1.0, 30.0),
        relation="same",
        coherence=0.99,
        verdict=verdict,  # type: ignore[arg-type]
    )
    return Consistency(checks=((STRETCH, one),))


def test_a_gyro_that_was_compared_has_no_error_beyond_what_it_shows() -> None:
    assert unchecked_scales([check("consistent")], ["p", "ay"], None) == (None, ())


@pytest.mark.parametrize("agreement", [[], [check("uncertain", std=0.2)], [check("consistent", std=0.05)]], ids=str)
def test_a_gyro_that_could_not_be_compared_counts_with_its_data_sheet(agreement: list[Consistency]) -> None:
    errors, findings = unchecked_scales(agreement, ["ay", "p"], None)
    assert errors is not None
    np.testing.assert_array_equal(errors, [[0.0, 0.0], [USUAL_SCALE, 0.0]])
    assert [finding.kind for finding in findings] == ["error_not_checked"]


def test_what_contradicts_keeps_its_own_error() -> None:
    shown = np.array([[0.08, 0.0], [0.0, 0.0]])
    errors, _ = unchecked_scales([check("inconsistent", scale=1.08)], ["p", "q"], shown)
    assert errors is not None
    np.testing.assert_array_equal(errors, [[0.08, 0.0], [USUAL_SCALE, 0.0]])


@pytest.mark.parametrize(
    ("usual", "seen"),
    [(USUAL_LEAN, 0.015), (USUAL_OTHER_LEAN, 0.002), (USUAL_SLOPE, 0.015), (USUAL_BIAS, 0.013), (USUAL_SCALE, 0.01)],
)
def test_usual_sizes_are_no_smaller_than_flights_that_show_them_have(usual: float, seen: float) -> None:
    """95 % of 24 sweeps and 12 flights, and the data sheet of a gyro: with less, intervals are too narrow."""
    assert seen <= usual < 1.5 * seen
