"""Pictures of frequency responses: every number in them is one that came in, in the unit that was asked for."""

from __future__ import annotations

import itertools
import json
import re
from typing import Any, ClassVar

import numpy as np
import pytest
from tests.unit.report.sample import exact, response

from rotorid.data.trust import DIRECT_COHERENCE
from rotorid.errors import UsageError
from rotorid.plot.figure import DASHES, SERIES, SYMBOLS, Figure
from rotorid.plot.frequency import (
    Density,
    Named,
    _trusted,
    bode,
    coherence_map,
    input_spectrum,
    overlay,
    window_contributions,
)
from rotorid.plot.loops import Crossing, broken_loop, disturbance_rejection

OMEGA = np.geomspace(0.5, 90.0, 40)
HERTZ = OMEGA / (2.0 * np.pi)
LOOP = 10.0 * np.exp(-0.03j * OMEGA) / (1j * OMEGA)
PAIR = {"output": "p", "input": "roll_command"}

# Five significant digits.
DIGITS = {"rtol": 5.1e-5}


def named(figure: Figure, name: str) -> list[dict[str, Any]]:
    return [trace for trace in json.loads(json.dumps(figure, allow_nan=False))["data"] if trace.get("name") == name]


def labels(figure: Figure) -> list[str]:
    return [one["text"] for one in figure["layout"]["annotations"]]


class TestFigure:
    def test_a_notebook_gets_plain_json_that_is_the_figure(self) -> None:
        figure = bode(response(), **PAIR)
        bundle = figure._repr_mimebundle_()
        assert json.loads(json.dumps(bundle["application/vnd.plotly.v1+json"])) == json.loads(json.dumps(figure))
        assert type(bundle["application/vnd.plotly.v1+json"]) is dict
        assert f"{len(figure['data'])} traces" in bundle["text/plain"]

    def test_every_picture_is_such_a_figure(self) -> None:
        share = np.ones((1, OMEGA.size))
        pictures = (
            bode(response(), **PAIR),
            overlay([Named(name="a", omega_rad_s=OMEGA, values=LOOP)], **PAIR),
            window_contributions(OMEGA, [10.0], share, share),
            input_spectrum(OMEGA, OMEGA, input="roll_command"),
            coherence_map({("p", "roll_command"): [(1.0, 2.0)]}),
            broken_loop(OMEGA, LOOP),
            disturbance_rejection(OMEGA, 1.0 / (1.0 + LOOP)),
        )
        assert {type(picture) for picture in pictures} == {Figure}


class TestViews:
    def test_hertz_and_factors(self) -> None:
        measured = response()
        everything = np.ones(measured.values.shape, dtype=bool)
        figure = bode(measured, **PAIR, fitted=everything, frequency="Hz", magnitude="linear")
        level, turn, trust = named(figure, "measured")
        hertz = measured.omega_rad_s / (2.0 * np.pi)
        for trace in (level, turn, trust):
            np.testing.assert_allclose(trace["x"], hertz, **DIGITS)
            np.testing.assert_allclose(trace["customdata"], measured.omega_rad_s, **DIGITS)
        np.testing.assert_allclose(level["y"], np.abs(measured.values[0, 0]), **DIGITS)
        assert figure["layout"]["xaxis"]["title"]["text"] == "Frequency [Hz]"
        assert labels(figure)[0] == "Magnitude of roll rate p over roll command [rad/s]"
        ticks = figure["layout"]["xaxis"]["tickvals"]
        assert hertz[0] * 0.79 < ticks[0] < ticks[-1] < hertz[-1] * 1.26

    def test_the_band_is_the_same_in_both_units(self) -> None:
        name = "± 2 σ random error"
        decibels, factors = (named(bode(response(), **PAIR, magnitude=unit), name)[0] for unit in ("dB", "linear"))
        # Decibels of five digits, below 100: 5e-4 dB are 6e-5 of the factor, and the factor is rounded too.
        np.testing.assert_allclose(factors["y"], 10.0 ** (np.array(decibels["y"]) / 20.0), rtol=1.2e-4)

    def test_phase_and_coherence_know_no_decibels(self) -> None:
        one, other = (named(bode(response(), **PAIR, magnitude=unit), "measured") for unit in ("dB", "linear"))
        assert [trace["y"] for trace in one[1:]] == [trace["y"] for trace in other[1:]]

    @pytest.mark.parametrize("wrong", [{"frequency": "rpm"}, {"magnitude": "db"}])
    def test_an_unknown_unit_is_refused_with_those_that_are_known(self, wrong: Any) -> None:
        with pytest.raises(UsageError, match=r"expected '(rad/s' or 'Hz|dB' or 'linear)'"):
            bode(response(), **PAIR, **wrong)


class TestOverlay:
    def curves(self) -> list[Named]:
        flights = [Named.of(response(seed=seed), **PAIR, name=f"flight {seed}") for seed in range(2)]
        omega = np.geomspace(2.0, 40.0, 30)
        return [*flights, Named(name="model", omega_rad_s=omega, values=exact(omega), measured=False)]

    def test_each_curve_keeps_its_own_grid_and_numbers(self) -> None:
        curves = self.curves()
        figure = overlay(curves, **PAIR)
        for one in curves:
            level = next(trace for trace in named(figure, one.name) if trace["showlegend"])
            used = _trusted(one, DIRECT_COHERENCE) if one.measured else np.ones(one.omega_rad_s.size, dtype=bool)
            np.testing.assert_allclose(level["x"], one.omega_rad_s[used], **DIGITS)
            # Half a unit of the third decimal.
            np.testing.assert_allclose(level["y"], 20.0 * np.log10(np.abs(one.values[used])), atol=5.1e-4)

    def test_the_legend_names_each_once_and_switches_its_band_too(self) -> None:
        figure = overlay(self.curves(), **PAIR)
        assert [trace["name"] for trace in figure["data"] if trace["showlegend"]] == ["flight 0", "flight 1", "model"]
        banded = [trace["legendgroup"] for trace in figure["data"] if "fill" in trace]
        assert sorted(banded) == ["flight 0", "flight 0", "flight 1", "flight 1"]

    def test_bands_lie_below_all_points(self) -> None:
        for axis in ("y", "y2"):
            filled = ["fill" in trace for trace in overlay(self.curves(), **PAIR)["data"] if trace["yaxis"] == axis]
            assert filled == sorted(filled, reverse=True)

    def test_phases_lie_on_one_branch(self) -> None:
        values = np.exp(-0.02j * OMEGA) / (1j * OMEGA)
        curves = [
            Named(name="first", omega_rad_s=OMEGA, values=values, measured=False),
            # Its own slope would put it another way round: seen late, where it has turned far.
            Named(name="late", omega_rad_s=OMEGA[-8:], values=(values * np.exp(-0.05j))[-8:], measured=False),
        ]
        phases = {trace["name"]: trace["y"] for trace in overlay(curves, **PAIR)["data"] if trace["yaxis"] == "y2"}
        # A hundredth of a degree in each.
        np.testing.assert_allclose(phases["late"], np.array(phases["first"][-8:]) - np.degrees(0.05), atol=0.011)

    def test_more_curves_than_colors_still_differ(self) -> None:
        curves = [Named(name=str(number), omega_rad_s=OMEGA, values=LOOP, measured=False) for number in range(9)]
        drawn = [trace for trace in overlay(curves, **PAIR)["data"] if trace["showlegend"]]
        assert len({(trace["line"]["color"], trace["line"]["dash"]) for trace in drawn}) == 9

    def test_what_cannot_be_drawn_is_refused(self) -> None:
        with pytest.raises(UsageError, match="at least one curve"):
            overlay([], **PAIR)
        with pytest.raises(UsageError, match="a name of its own"):
            overlay([Named(name="a", omega_rad_s=OMEGA, values=LOOP)] * 2, **PAIR)
        with pytest.raises(UsageError, match=r"random_error of the curve 'a' has the shape \(3,\)"):
            Named(name="a", omega_rad_s=OMEGA, values=LOOP, random_error=np.zeros(3))


class TestWindows:
    SHARE = np.stack([np.linspace(1.0, 0.0, 40), np.linspace(0.0, 1.0, 40)])
    ERRORS = np.stack([np.geomspace(0.02, 2.0, 40), np.geomspace(0.5, 0.01, 40)])

    def test_shares_in_percent_over_errors(self) -> None:
        figure = window_contributions(OMEGA, [20.0, 5.0], self.SHARE, self.ERRORS, composite_error=self.ERRORS[0])
        for row, name in enumerate(("20 s", "5 s")):
            area, error = named(figure, name)
            np.testing.assert_allclose(area["y"], 100.0 * self.SHARE[row], **DIGITS)
            np.testing.assert_allclose(error["y"], self.ERRORS[row], **DIGITS)
            assert area["stackgroup"] == "share"
        assert figure["layout"]["yaxis2"]["type"] == "log"
        (composite,) = named(figure, "composite")
        np.testing.assert_allclose(composite["y"], self.ERRORS[0], **DIGITS)

    def test_frequencies_without_a_window_are_left_out(self) -> None:
        share, errors = self.SHARE.copy(), self.ERRORS.copy()
        share[:, :4], errors[1, :6] = np.nan, np.inf
        area, error = named(window_contributions(OMEGA, [20.0, 5.0], share, errors), "5 s")
        np.testing.assert_allclose(area["x"], OMEGA[4:], **DIGITS)
        assert error["y"][:6] == [None] * 6

    @pytest.mark.parametrize(
        ("share", "match"), [(np.ones((1, 40)), r"the shape \(1, 40\); expected the shape \(2, 40\)"), (-SHARE, "neg")]
    )
    def test_what_is_no_share_is_refused(self, share: Any, match: str) -> None:
        with pytest.raises(UsageError, match=match):
            window_contributions(OMEGA, [20.0, 5.0], share, self.ERRORS)


class TestSpectrum:
    DENSITY = 1e-3 / (1.0 + (OMEGA / 30.0) ** 4)

    def test_densities_in_decibels_and_units_of_paper(self) -> None:
        figure = input_spectrum(
            OMEGA,
            self.DENSITY,
            input="roll_command",
            instrument=Density(channel="roll_excitation", values=2.0 * self.DENSITY),
            output=Density(channel="p", values=self.DENSITY),
            noise=0.1 * self.DENSITY,
            excited=[(1.0, 40.0)],
            frequency="Hz",
        )
        degrees = np.degrees(1.0) ** 2
        expected = {"input": 1.0, "instrument": 2.0, "output": degrees, "not explained by the input": 0.1 * degrees}
        for name, factor in expected.items():
            (trace,) = named(figure, name)
            np.testing.assert_allclose(trace["y"], 10.0 * np.log10(factor * self.DENSITY), atol=5.1e-4)
            np.testing.assert_allclose(trace["x"], HERTZ, **DIGITS)
        assert labels(figure) == [
            "Density of roll command and roll excitation [dB re 1/Hz]",
            "Density of roll rate p [dB re (°/s)²/Hz]",
        ]
        shaded = [(shape["x0"], shape["x1"]) for shape in figure["layout"]["shapes"]]
        assert shaded == [pytest.approx((1.0 / (2 * np.pi), 40.0 / (2 * np.pi)))] * 2

    def test_an_instrument_of_another_unit_has_its_own_panel(self) -> None:
        setpoint = Density(channel="p_setpoint", values=self.DENSITY)
        figure = input_spectrum(OMEGA, self.DENSITY, input="roll_command", instrument=setpoint, magnitude="linear")
        assert labels(figure) == ["Density of roll rate setpoint [(°/s)²/Hz]", "Density of roll command [1/Hz]"]
        np.testing.assert_allclose(named(figure, "input")[0]["y"], self.DENSITY, **DIGITS)

    def test_noise_of_nothing_and_wrong_shapes_are_refused(self) -> None:
        with pytest.raises(UsageError, match="needs the density of its output"):
            input_spectrum(OMEGA, self.DENSITY, input="roll_command", noise=self.DENSITY)
        short = Density(channel="p", values=self.DENSITY[1:])
        with pytest.raises(UsageError, match="output has the shape"):
            input_spectrum(OMEGA, self.DENSITY, input="roll_command", output=short)


class TestCoherenceMap:
    USABLE: ClassVar = {
        ("q", "pitch_command"): [(0.6, 42.0)],
        ("q", "thrust_command"): [],
        ("u", "pitch_command"): [(0.5, 3.2), (4.0, 5.5)],
    }

    def test_a_panel_for_each_output_and_a_bar_for_each_band(self) -> None:
        figure = coherence_map(self.USABLE)
        assert labels(figure) == ["pitch rate q over", "forward speed u over"]
        bars = [trace for trace in figure["data"] if trace["mode"] == "lines"]
        assert [(bar["yaxis"], bar["x"]) for bar in bars] == [
            ("y", [0.6, 42.0, None]),
            ("y2", [0.5, 3.2, None, 4.0, 5.5, None]),
        ]
        rows = figure["layout"]["yaxis"]
        assert dict(zip(rows["ticktext"], rows["tickvals"], strict=True)) == {"pitch command": 1, "thrust command": 0}

    def test_a_pair_without_a_band_says_so_in_its_row(self) -> None:
        (words,) = (trace for trace in coherence_map(self.USABLE)["data"] if trace.get("text") == ["no usable band"])
        assert (words["yaxis"], words["y"]) == ("y", [0])

    def test_hertz_and_the_band_that_was_asked_for(self) -> None:
        figure = coherence_map(self.USABLE, asked=(0.5, 50.0), frequency="Hz")
        low, high = 0.5 / (2 * np.pi), 50.0 / (2 * np.pi)
        assert [shape["x0"] for shape in figure["layout"]["shapes"]] == pytest.approx([low] * 2)
        assert [shape["x1"] for shape in figure["layout"]["shapes"]] == pytest.approx([high] * 2)
        first, last = 10.0 ** np.array(figure["layout"]["xaxis"]["range"])
        assert first < low < high < last

    @pytest.mark.parametrize(
        ("usable", "match"),
        [({("p", "roll_command"): []}, "no band"), ({("p", "roll_command"): [(3.0, 2.0)]}, "3 to")],
    )
    def test_nothing_to_fit_the_axis_to_is_refused(self, usable: Any, match: str) -> None:
        with pytest.raises(UsageError, match=match):
            coherence_map(usable)


class TestLoops:
    GAIN = Crossing(omega_rad_s=10.0, omega_std_rad_s=0.4, value=np.pi / 2 - 0.3, value_std=0.05)
    PHASE = Crossing(omega_rad_s=np.pi / 2 / 0.03, omega_std_rad_s=1.0, value=np.pi / 2 / 0.3, value_std=0.2)

    def test_margins_reach_from_the_critical_lines_to_the_loop(self) -> None:
        figure = broken_loop(OMEGA, LOOP, gain_crossovers=[self.GAIN], phase_crossovers=[self.PHASE])
        (gain,) = (trace for trace in figure["data"] if "gain margin" in trace["name"])
        (phase,) = (trace for trace in figure["data"] if "phase margin" in trace["name"])
        assert (gain["yaxis"], phase["yaxis"]) == ("y", "y2")
        np.testing.assert_allclose(gain["y"], [0.0, 20.0 * np.log10(0.3 / (np.pi / 2))], **DIGITS)
        np.testing.assert_allclose(phase["y"], [-180.0, -90.0 - np.degrees(0.3)], **DIGITS)
        assert phase["error_y"]["array"][-1] == pytest.approx(2.0 * np.degrees(0.05))
        assert phase["error_x"]["array"][-1] == pytest.approx(0.8)
        assert phase["name"] == "phase margin 72.8 ± 2.9° at 10.0 ± 0.4 rad/s"
        down, up = gain["error_y"]["arrayminus"][-1], gain["error_y"]["array"][-1]
        assert down == pytest.approx(up)
        assert up == pytest.approx(20.0 * np.log10(1.0 + 0.4 * 0.6 / np.pi))

    def test_a_crossover_one_turn_further_down_stands_on_its_own_line(self) -> None:
        late = np.exp(-0.3j * OMEGA) * 10.0 / (1j * OMEGA)
        there = -90.0 - np.degrees(0.3 * 20.0)
        margin = np.radians((there + 180.0 + 180.0) % 360.0 - 180.0)
        figure = broken_loop(OMEGA, late, gain_crossovers=[Crossing(omega_rad_s=20.0, value=float(margin))])
        foot, top = figure["data"][-1]["y"]
        assert foot == -540.0
        assert top == pytest.approx(there, rel=1e-4)

    def test_linear_hertz(self) -> None:
        figure = broken_loop(OMEGA, LOOP, phase_crossovers=[self.PHASE], frequency="Hz", magnitude="linear")
        (gain,) = (trace for trace in figure["data"] if "gain margin" in trace["name"])
        np.testing.assert_allclose(gain["y"], [1.0, 1.0 / self.PHASE.value], **DIGITS)
        np.testing.assert_allclose(gain["x"], [self.PHASE.omega_rad_s / (2 * np.pi)] * 2, **DIGITS)
        assert figure["layout"]["shapes"][0]["y0"] == 1.0

    def test_rejection_is_shaded_up_to_its_bandwidth(self) -> None:
        sensitivity = 1.0 / (1.0 + LOOP)
        bandwidth = Crossing(omega_rad_s=7.0, omega_std_rad_s=0.5, value=10.0 ** (-3.0 / 20.0))
        peak = Crossing(omega_rad_s=18.0, value=1.5, value_std=0.1)
        error = np.full(OMEGA.size, 0.05)
        figure = disturbance_rejection(OMEGA, sensitivity, random_error=error, bandwidth=bandwidth, peak=peak)
        curve = next(trace for trace in named(figure, "sensitivity") if trace["showlegend"])
        np.testing.assert_allclose(curve["y"], 20.0 * np.log10(np.abs(sensitivity)), atol=5.1e-4)
        held, level = figure["layout"]["shapes"]
        assert (held["x0"], held["x1"], level["y0"]) == (OMEGA[0], 7.0, -3.0)
        assert named(figure, "bandwidth 7.0 ± 0.5 rad/s")[0]["y"] == pytest.approx([-3.0])
        assert named(figure, "peak 3.5 ± 0.6 dB at 18 rad/s")[0]["y"] == pytest.approx([20.0 * np.log10(1.5)], rel=1e-4)

    def test_impossible_crossings_are_refused(self) -> None:
        with pytest.raises(UsageError, match="positive frequency"):
            Crossing(omega_rad_s=0.0, value=1.0)
        with pytest.raises(UsageError, match="not positive"):
            broken_loop(OMEGA, LOOP, phase_crossovers=[Crossing(omega_rad_s=1.0, value=-2.0)])
        with pytest.raises(UsageError, match="random_error has the shape"):
            broken_loop(OMEGA, LOOP, random_error=np.zeros(3))


# Machado, Oliveira, Fernandes: A physiologically-based model for simulation of color vision deficiency, IEEE
# Transactions on Visualization and Computer Graphics 15 (2009): severity 1, on linear RGB.
EYES = {
    "all cones": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.01182, 0.04294, 0.968881]]
    ),
    "tritanopia": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.3039]]
    ),
}
"""Linear RGB as eyes without one kind of cone see it."""


def lightness_and_color(linear: Any) -> Any:
    """CIELAB of linear sRGB."""
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    x, y, z = np.cbrt(np.maximum(to_xyz @ np.clip(linear, 0.0, 1.0) / np.array([0.9505, 1.0, 1.089]), 0.008856))
    return np.array([116.0 * y, 500.0 * (x - y), 200.0 * (y - z)])


def linear_rgb(color: str) -> Any:
    parts = np.array([int(color[at : at + 2], 16) for at in (1, 3, 5)]) / 255.0
    return np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)


class TestColors:
    @pytest.mark.parametrize("eye", EYES)
    def test_colors_differ_for_every_eye(self, eye: str) -> None:
        """A distance of 2.3 in CIELAB is just seen; ten are seen at a glance, on lines apart from each other."""
        seen = [lightness_and_color(EYES[eye] @ linear_rgb(color)) for color in SERIES]
        assert min(np.linalg.norm(one - other) for one, other in itertools.combinations(seen, 2)) >= 10.0

    def test_dashes_and_symbols_differ_too(self) -> None:
        assert len(set(DASHES)) == len(set(SYMBOLS)) == len(set(SERIES)) == 6


def test_the_package_page_names_functions_that_exist() -> None:
    import rotorid.plot

    listed = re.findall(r"^``rotorid\.plot\.(\w+)``", rotorid.plot.__doc__ or "", flags=re.MULTILINE)
    assert len(listed) >= 11
    assert set(listed) <= set(rotorid.plot.__all__)  # type: ignore[attr-defined]
