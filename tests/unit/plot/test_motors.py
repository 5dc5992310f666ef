"""Rotors from above, the curve of thrust, accelerations and the motors that make them."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from rotorid.errors import UsageError
from rotorid.plot.figure import Figure
from rotorid.plot.motors import made_by_motors, rotor_layout, thrust_curve

CROSS = np.array([[0.2, 0.2, 0.0], [-0.2, -0.2, 0.0], [0.2, -0.2, 0.0], [-0.2, 0.2, 0.0]])
SPINS = np.array([1.0, 1.0, -1.0, -1.0])


def named(figure: Figure, name: str) -> dict[str, Any]:
    (found,) = (one for one in json.loads(json.dumps(figure, allow_nan=False))["data"] if one["name"] == name)
    return dict(found)


def points(trace: dict[str, Any]) -> np.ndarray:
    """Points of a trace as complex numbers, right and forward, gaps as not-a-number."""
    x, y = (np.array(trace[key], dtype=float) for key in ("x", "y"))
    return np.asarray(x + 1j * y)


def pieces(trace: dict[str, Any]) -> list[np.ndarray]:
    found = points(trace)
    return [piece[~np.isnan(piece)] for piece in np.split(found, np.flatnonzero(np.isnan(found))) if piece.size > 1]


def test_motors_stand_where_they_are_nose_up() -> None:
    figure = rotor_layout(CROSS, SPINS, in_meters=True)
    numbers = named(figure, "motors")
    assert dict(zip(numbers["text"], zip(numbers["x"], numbers["y"], strict=True), strict=True)) == {
        "1": (0.2, 0.2),
        "2": (-0.2, -0.2),
        "3": (-0.2, 0.2),
        "4": (0.2, -0.2),
    }
    assert figure["layout"]["xaxis"]["title"]["text"] == "Right [m]"
    assert rotor_layout(CROSS, SPINS, in_meters=False)["layout"]["xaxis"]["title"]["text"] == "Right [arms]"


@pytest.mark.parametrize(("name", "sign"), [("counterclockwise", 1.0), ("clockwise", -1.0)])
def test_arrows_turn_as_the_rotors_do(name: str, sign: float) -> None:
    arcs = [piece for number, piece in enumerate(pieces(named(rotor_layout(CROSS, SPINS, in_meters=True), name)))]
    # Each rotor: its circle, the arc, the head of the arrow.
    circle, arc, head = arcs[:3]
    center = circle[:-1].mean()
    turn = np.diff(np.unwrap(np.angle(arc - center)))
    assert np.all(sign * turn > 0.0)
    # The tip leads: both other corners lie behind it in the direction of turning.
    tip = head[1]
    assert abs(tip - arc[-1]) < 1e-3 * abs(tip - center)
    behind = np.angle((head[[0, 2]] - center) / (tip - center))
    assert np.all(sign * behind < 0.0)


def test_rotors_do_not_touch_and_arms_end_at_their_circles() -> None:
    figure = rotor_layout(CROSS, SPINS, in_meters=True)
    circles = [piece for piece in pieces(named(figure, "clockwise")) if piece.size > 10][::2]
    radius = np.abs(circles[0] - circles[0][:-1].mean()).max()
    assert 0.2 < 2.0 * radius < 0.4
    arm = pieces(named(figure, "arms and nose"))[0]
    assert np.abs(arm[-1]) == pytest.approx(0.2 * np.sqrt(2.0) - radius, rel=1e-2)


def test_coaxial_rotors_share_a_place() -> None:
    pair = np.array([[0.2, 0.0, 0.0], [-0.2, 0.0, 0.0], [0.2, 0.0, 0.1], [-0.2, 0.0, 0.1]])
    figure = rotor_layout(pair, np.array([1.0, -1.0, -1.0, 1.0]), in_meters=True)
    assert named(figure, "motors")["text"] == ["1 + 3", "2 + 4"]
    upper, lower = (pieces(named(figure, "counterclockwise"))[number] for number in (0, 3))
    assert np.abs(lower - lower[:-1].mean()).max() < np.abs(upper - upper[:-1].mean()).max()


def test_a_single_rotor_at_the_center_has_a_size() -> None:
    figure = rotor_layout(np.zeros((1, 3)), np.ones(1), in_meters=True)
    low, high = figure["layout"]["xaxis"]["range"]
    assert high > 0.0 > low


def test_layouts_that_do_not_fit_are_refused() -> None:
    with pytest.raises(UsageError, match="spins"):
        rotor_layout(CROSS, SPINS[:2], in_meters=True)
    with pytest.raises(UsageError):
        rotor_layout(np.zeros((0, 3)), np.zeros(0), in_meters=True)


def test_the_curve_is_dotted_where_nothing_was_flown() -> None:
    outputs = np.linspace(0.0, 1.0, 101)
    thrust = 5.0 * outputs**2
    figure = thrust_curve(outputs, thrust, 0.1 + 0.0 * thrust, flown=(0.3, 0.7), hover=0.5, weight_n=1.25)
    flown, beyond = (np.array(named(figure, name)["y"], dtype=float) for name in ("flown", "extrapolated"))
    assert outputs[np.isfinite(flown)].min() >= 0.3
    assert outputs[np.isfinite(flown)].max() <= 0.7
    # Both together are the whole curve, and meet.
    assert np.all(np.isfinite(flown) | np.isfinite(beyond))
    assert np.sum(np.isfinite(flown) & np.isfinite(beyond)) == 2
    mark = named(figure, "mean of the flight")
    assert (mark["x"], mark["y"]) == ([0.5], [1.25])
    band = np.array(named(figure, "± 1 σ")["y"])
    np.testing.assert_allclose(band[:101] - band[101:][::-1], 0.2, atol=1e-4)
    levels = [shape["y0"] for shape in figure["layout"]["shapes"] if shape["type"] == "line"]
    assert levels == [1.25]


def test_curves_of_unequal_length_are_refused() -> None:
    with pytest.raises(UsageError, match="deviations"):
        thrust_curve(np.zeros(3), np.zeros(3), np.zeros(2), flown=(0.0, 1.0), hover=0.5, weight_n=1.0)


def test_angles_are_drawn_in_degrees_and_each_motor_has_a_panel() -> None:
    time_s = np.arange(5) / 100.0
    rows = np.stack([np.arange(5.0), -9.81 + 0.0 * time_s])
    figure = made_by_motors(
        time_s,
        np.zeros((2, 5)),
        rows,
        0.5 * rows,
        motor_names=("motor_1", "motor_2"),
        channels=("p_dot", "az"),
        held=False,
    )
    measured = [one for one in figure["data"] if one["name"] == "measured"]
    np.testing.assert_allclose(measured[0]["y"], np.degrees(rows[0]), rtol=1e-4)
    np.testing.assert_allclose(measured[1]["y"], rows[1], rtol=1e-4)
    assert [one["text"] for one in figure["layout"]["annotations"]][2:] == ["motor 1", "motor 2"]
    assert sum(bool(one["showlegend"]) for one in figure["data"]) == 3
