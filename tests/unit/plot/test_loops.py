"""The plane of s: crosses where the poles are, ellipses of their deviations, rays of equal damping."""

from __future__ import annotations

import itertools
import json
from typing import Any

import numpy as np
import pytest

from rotorid.errors import UsageError
from rotorid.plot.curves import SIGMAS
from rotorid.plot.figure import Figure
from rotorid.plot.loops import DAMPING_RATIOS, s_plane

POLES = np.array([-4.6, 2.6 + 4.3j, 2.6 - 4.3j])
STD = np.array([complex(0.1, 0.0), complex(0.1, 0.2), complex(0.1, 0.2)])


def named(figure: Figure, name: str) -> list[dict[str, Any]]:
    return [trace for trace in json.loads(json.dumps(figure, allow_nan=False))["data"] if trace["name"] == name]


def complete(trace: dict[str, Any]) -> np.ndarray:
    """Points of a trace as complex numbers, gaps as not-a-number."""
    x, y = (np.array(trace[key], dtype=float) for key in ("x", "y"))
    return np.asarray(x + 1j * y)


def test_crosses_are_the_poles_and_say_their_words() -> None:
    figure = s_plane(POLES, words=["<b>slow</b>", "up", "down"])
    (decays,), (grows,) = named(figure, "decays"), named(figure, "grows")
    np.testing.assert_allclose(complete(decays), POLES[:1])
    np.testing.assert_allclose(complete(grows), POLES[1:])
    assert decays["text"] == ["&lt;b&gt;slow&lt;/b&gt;"]
    assert grows["text"] == ["up", "down"]


def test_ellipses_are_two_sigma_to_each_side() -> None:
    (ellipses,) = named(s_plane(POLES, std=STD), f"± {SIGMAS:g} σ")
    points = complete(ellipses)
    starts = np.concatenate([[0], np.flatnonzero(np.isnan(points)) + 1])
    outlines = [points[a : b - 1] for a, b in itertools.pairwise(starts.tolist())]
    for outline, pole, std in zip(outlines, POLES, STD, strict=True):
        # 48 corners miss the top of an ellipse by at most 1 - cos(π/47); five digits of numbers below ten add 5e-5.
        near = {"rtol": 0.0, "atol": SIGMAS * 0.2 * (1 - np.cos(np.pi / 47)) + 5e-5}
        np.testing.assert_allclose(outline.real.max() - pole.real, SIGMAS * std.real, **near)
        np.testing.assert_allclose(outline.imag.max() - pole.imag, SIGMAS * std.imag, **near)
        np.testing.assert_allclose(pole.imag - outline.imag.min(), SIGMAS * std.imag, **near)


def test_a_pole_without_deviation_has_no_ellipse() -> None:
    unknown = np.full(3, complex(np.nan, np.nan))
    assert named(s_plane(POLES, std=unknown), f"± {SIGMAS:g} σ") == []
    one = np.array([STD[0], *unknown[1:]])
    (ellipse,) = named(s_plane(POLES, std=one), f"± {SIGMAS:g} σ")
    assert ellipse["x"].count(None) == 1


def test_rays_have_their_damping() -> None:
    lines, labels = named(s_plane(POLES), "equal damping")
    ends = complete(lines)[1::3]
    np.testing.assert_allclose(-ends.real / np.abs(ends), [*DAMPING_RATIOS, *DAMPING_RATIOS], rtol=1e-4)
    at = complete(labels)
    np.testing.assert_allclose(-at.real / np.abs(at), [float(ratio) for ratio in labels["text"]], rtol=1e-4)


@pytest.mark.parametrize("poles", [POLES, np.array([-1e-3]), np.array([-900.0, -0.1]), np.zeros(1), np.zeros(0)])
def test_poles_origin_and_labels_lie_inside(poles: np.ndarray) -> None:
    figure = s_plane(poles.astype(np.complex128))
    (left, right), (bottom, top) = (figure["layout"][axis]["range"] for axis in ("xaxis", "yaxis"))
    shown = np.concatenate([poles, [0.0], complete(named(figure, "equal damping")[1])])
    assert np.all((left < shown.real) & (shown.real < right))
    assert np.all((bottom < shown.imag) & (shown.imag < top))


def test_both_parts_have_one_scale_and_growth_is_shaded() -> None:
    layout = s_plane(POLES)["layout"]
    assert (layout["yaxis"]["scaleanchor"], layout["yaxis"]["scaleratio"]) == ("x", 1)
    (shade,) = layout["shapes"]
    assert shade["x0"] == 0.0
    assert shade["x1"] > layout["xaxis"]["range"][1]


@pytest.mark.parametrize(
    "wrong",
    [
        {"poles": POLES.reshape(3, 1)},
        {"poles": POLES, "std": STD[:2]},
        {"poles": POLES, "words": ["one"]},
        {"poles": np.array([np.nan + 0j])},
    ],
)
def test_wrong_shapes_and_lost_poles_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match=r"have the shape|not finite"):
        s_plane(**wrong)


def test_a_pole_at_rest_is_drawn_at_rest() -> None:
    figure = s_plane(np.array([3e-7 + 0.0j]))
    for axis in ("xaxis", "yaxis"):
        low, high = figure["layout"][axis]["range"]
        assert high - low > 0.03
    figure = s_plane(np.array([-0.3 + 0.0j]))
    low, high = figure["layout"]["xaxis"]["range"]
    assert low < -0.3 < high < 0.3
