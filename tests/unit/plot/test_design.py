"""Pictures of planned flights."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from tests.unit.report.response_sample import HOLLOW, OMEGA, measured_response

from rotorid.plot.design import (
    Excited,
    Signal,
    Strip,
    excited_bands,
    percent_dots,
    percent_over_duration,
    planned_flight,
    predicted_bode,
)

TIME = np.linspace(0.0, 2.0, 50)


def test_an_axis_has_one_color_in_all_panels_and_stands_in_the_legend_once() -> None:
    strips = [
        Strip(label="Test inputs", signals=[Signal("pitch", "theta_setpoint", TIME, TIME)]),
        Strip(
            label="Rates", signals=[Signal(axis, rate, TIME, TIME) for axis, rate in (("roll", "p"), ("pitch", "q"))]
        ),
        Strip(label="Tilt", signals=[Signal("tilt", "phi", TIME, TIME)]),
    ]
    traces = planned_flight(strips)["data"]
    assert [trace["name"] for trace in traces] == ["pitch", "roll", "pitch", "tilt"]
    pitch = [trace for trace in traces if trace["name"] == "pitch"]
    assert pitch[0]["line"]["color"] == pitch[1]["line"]["color"] != traces[1]["line"]["color"]
    # The only signal of its panel is named by the panel.
    assert [trace["showlegend"] for trace in traces] == [True, True, False, False]


def test_limits_are_drawn_in_units_of_paper_over_the_whole_flight() -> None:
    limit = math.radians(180.0)
    strip = Strip(label="Rates", signals=[Signal("roll", "p", TIME, 0.0 * TIME)], limits=(-limit, limit))
    figure = planned_flight([strip])
    low, high = (trace for trace in figure["data"] if trace["name"] == "limit")
    assert (low["y"], high["y"]) == ([-180.0, -180.0], [180.0, 180.0])
    assert low["x"] == [0.0, 2.0]
    assert [low["showlegend"], high["showlegend"]] == [True, False]
    assert figure["layout"]["annotations"][0]["text"] == "Rates [°/s]"


def test_inputs_of_one_unit_share_a_panel_and_their_bands_are_shaded() -> None:
    omega = np.array([1.0, 10.0])
    angle = Excited(
        words="roll", channel="phi_setpoint", omega_rad_s=omega, density=np.ones(2), band_rad_s=(1.0, 8.0), lines=True
    )
    other = Excited(words="pitch", channel="theta_setpoint", omega_rad_s=omega, density=np.ones(2))
    thrust = Excited(words="thrust", channel="thrust_excitation", omega_rad_s=omega, density=np.ones(2))
    figure = excited_bands([angle, other, thrust], frequency="Hz", magnitude="linear")
    roll, pitch, up = figure["data"]
    assert (roll["yaxis"], pitch["yaxis"], up["yaxis"]) == ("y", "y", "y2")
    assert (roll["mode"], pitch["mode"]) == ("markers", "lines")
    # 1 rad²/Hz in degrees.
    np.testing.assert_allclose(roll["y"], (180.0 / math.pi) ** 2, rtol=1e-4)
    np.testing.assert_allclose(roll["x"], omega / (2.0 * math.pi), rtol=1e-4)
    shades = [(shape["x0"], shape["x1"]) for shape in figure["layout"]["shapes"]]
    np.testing.assert_allclose(shades, [(0.5 / math.pi, 4.0 / math.pi)])


def test_a_flat_density_looks_flat() -> None:
    omega = np.array([1.0, 10.0])
    flat = Excited(words="roll", channel="roll_excitation", omega_rad_s=omega, density=np.array([1.0, 1.01]))
    low, high = excited_bands([flat])["layout"]["yaxis"]["range"]
    assert high - low >= 10.0


def test_what_is_far_down_does_not_stretch_the_axis() -> None:
    omega = np.array([1.0, 10.0])
    deep = Excited(words="roll", channel="roll_excitation", omega_rad_s=omega, density=np.array([1.0, 1e-14]))
    assert excited_bands([deep])["layout"]["yaxis"]["range"] == [-60.0, 3.0]


def test_test_inputs_of_one_axis_have_one_color() -> None:
    omega = np.array([1.0, 10.0])
    inputs = [
        Excited(words=words, channel="roll_excitation", omega_rad_s=omega, density=np.ones(2))
        for words in ("roll sweep", "pitch sweep", "roll doublet")
    ]
    sweep, other, doublet = (trace["line"] for trace in excited_bands(inputs)["data"])
    assert sweep["color"] == doublet["color"] != other["color"]
    assert len({sweep["dash"], other["dash"], doublet["dash"]}) == 3


def test_a_predicted_response_is_not_called_measured() -> None:
    output, input = HOLLOW.split("/")
    used = np.ones((2, 2, OMEGA.size), dtype=bool)
    used[..., 40:] = False
    figure = predicted_bode(measured_response(), output=output, input=input, used=used, least_coherence=0.2)
    names = {trace["name"] for trace in figure["data"]}
    assert names == {"± 2 σ random error", "expected", "expected, not usable", "± 2 σ, not usable"}
    assert all(trace["legendgroup"] == trace["name"] for trace in figure["data"])


def test_every_parameter_has_a_row_in_which_plans_stand_apart() -> None:
    percent = {"sweep": [0.4, 2.0, math.inf], "multisine": [0.5, 3.0, 10.0], "binary": [0.6, 1.0, 20.0]}
    figure = percent_dots(["L_roll", "L_p", "<b>"], percent)
    rows = np.array([trace["y"] for trace in figure["data"]])
    np.testing.assert_allclose(rows.mean(axis=0), [0.0, 1.0, 2.0], atol=5e-5)
    assert all(low < high for low, high in pairwise(rows[:, 0]))
    assert np.ptp(rows[:, 0]) < 0.5
    assert figure["data"][0]["x"] == [0.4, 2.0, None]
    assert figure["layout"]["xaxis"]["type"] == "log"
    assert figure["layout"]["yaxis"]["ticktext"][-1] == "&lt;b&gt;"


def test_the_answer_is_shaded_from_where_it_is_enough() -> None:
    duration_s = np.array([15.0, 30.0, 300.0])
    percent = {"L_p": np.array([np.inf, 3.0, 1.0])}
    found = percent_over_duration(duration_s, percent, wanted={"L_p": 4.0}, found_s=30.0)
    tried, wanted = found["data"]
    assert (tried["x"], tried["y"]) == ([15.0, 30.0, 300.0], [None, 3.0, 1.0])
    assert (wanted["x"], wanted["y"]) == ([15.0, 300.0], [4.0, 4.0])
    assert [(shape["x0"], shape["x1"]) for shape in found["layout"]["shapes"]] == [(30.0, 300.0)]
    assert percent_over_duration(duration_s, percent, wanted={})["layout"]["shapes"] == []
