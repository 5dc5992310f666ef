"""Figures hold the right numbers at the right place, and nothing but JSON."""

from __future__ import annotations

import itertools
import json
import math
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from tests.unit.report.sample import RATE_HZ, doublet, exact, response, sweep

from rotorid.data.response import FrequencyResponse
from rotorid.data.trust import DIRECT_COHERENCE, trusted
from rotorid.plot.curves import SIGMAS, near_deg, unwrapped_deg
from rotorid.plot.figure import (
    SECONDARY,
    SERIES,
    Panel,
    envelope,
    frequency_ticks,
    numbers,
    phase_step_deg,
    stacked,
    stamps,
    template,
)
from rotorid.plot.frequency import bode
from rotorid.plot.time import timeline, verification

ALL = np.ones((1, 1, 90), dtype=bool)


def traces(figure: dict[str, Any], *, axis: str, name: str) -> list[dict[str, Any]]:
    return [trace for trace in figure["data"] if trace["yaxis"] == axis and trace["name"] == name]


def drawn(figure: dict[str, Any]) -> dict[str, Any]:
    """The figure after a round trip through strict JSON."""
    back: dict[str, Any] = json.loads(json.dumps(figure, allow_nan=False))
    return back


def sample_bode(**changes: Any) -> dict[str, Any]:
    measured = response()
    options = {
        "model": exact(measured.omega_rad_s).reshape(1, 1, -1),
        "beside": response(seed=3, estimate="direct"),
        "fitted": measured.coherence >= 0.6,
    }
    return drawn(bode(measured, output="p", input="roll_command", **{**options, **changes}))


class TestBode:
    def test_points_are_fitted_or_left_out_and_none_is_lost(self) -> None:
        fitted = response().coherence[0, 0] >= 0.6
        figure = sample_bode()
        for axis in ("y", "y2", "y3"):
            (used,) = traces(figure, axis=axis, name="measured")
            (left,) = traces(figure, axis=axis, name="measured, left out")
            assert (len(used["x"]), len(left["x"])) == (fitted.sum(), (~fitted).sum())

    def test_without_a_choice_the_points_of_the_tables_are_drawn_and_all_others_gray(self) -> None:
        measured = response()
        used = trusted(measured.random_error, measured.coherence, DIRECT_COHERENCE)[0, 0]
        figure = drawn(bode(replace(measured, estimate="direct"), output="p", input="roll_command"))
        for axis in ("y", "y2", "y3"):
            (solid,) = traces(figure, axis=axis, name="measured")
            (gray,) = traces(figure, axis=axis, name="measured, left out")
            assert (len(solid["x"]), len(gray["x"])) == (used.sum(), (~used).sum())
            assert gray["marker"]["color"] == SECONDARY != solid["marker"]["color"]

    def test_magnitude_is_in_decibels(self) -> None:
        (points,) = traces(sample_bode(fitted=ALL), axis="y", name="measured")
        # Five significant digits of numbers below 100 leave half a unit of the third decimal.
        np.testing.assert_allclose(points["y"], 20 * np.log10(np.abs(response().values[0, 0])), atol=5.1e-4)

    def test_hertz_are_at_hand(self) -> None:
        (points,) = traces(sample_bode(fitted=None), axis="y", name="measured")
        np.testing.assert_allclose(points["customdata"], np.array(points["x"]) / (2 * np.pi), rtol=2e-4)

    def test_band_is_two_sigma_wide(self) -> None:
        measured = response()
        (band,) = traces(sample_bode(fitted=np.ones((1, 1, 90), dtype=bool)), axis="y", name="± 2 σ random error")
        half = (np.array(band["y"][90:][::-1]) - np.array(band["y"][:90])) / 2
        np.testing.assert_allclose(half, 20 * np.log10(1 + SIGMAS * measured.random_error[0, 0]), atol=1e-3)

    def test_measured_phase_stays_near_the_model_after_many_turns(self) -> None:
        measured = response()
        late = exact(measured.omega_rad_s) * np.exp(-0.2j * measured.omega_rad_s)
        data = _with(measured, late)
        figure = drawn(bode(data, output="p", input="roll_command", model=late.reshape(1, 1, -1), fitted=ALL))
        (points,) = traces(figure, axis="y2", name="measured")
        model = traces(figure, axis="y2", name="model")[0]
        assert min(model["y"]) < -720
        np.testing.assert_allclose(points["y"], model["y"], atol=0.11)

    def test_without_a_model_the_phase_is_unwrapped_from_trusted_points(self) -> None:
        measured = response()
        late = exact(measured.omega_rad_s) * np.exp(-0.1j * measured.omega_rad_s)
        figure = drawn(bode(_with(measured, late), output="p", input="roll_command", fitted=ALL))
        (points,) = traces(figure, axis="y2", name="measured")
        trusted = measured.coherence[0, 0] >= 0.6
        truth = np.degrees(np.unwrap(np.angle(late)))
        np.testing.assert_allclose(np.array(points["y"])[trusted], truth[trusted], atol=0.11)

    def test_gaps_do_not_break_it(self) -> None:
        measured = response()
        broken = measured.values[0, 0].copy()
        broken[10:14] = np.nan
        broken[20] = 0.0
        figure = sample_bode_of(_with(measured, broken))
        (points,) = traces(figure, axis="y", name="measured")
        assert points["y"].count(None) == 1

    @pytest.mark.parametrize("limit", [0.4, 0.85])
    def test_line_of_coherence_is_the_limit_in_force(self, limit: float) -> None:
        (line,) = sample_bode(least_coherence=limit)["layout"]["shapes"]
        assert (line["yref"], line["y0"], line["y1"]) == ("y3", limit, limit)

    def test_unknown_pair_is_refused(self) -> None:
        with pytest.raises(ValueError, match="not in tuple"):
            bode(response(), output="q", input="roll_command")

    def test_names_of_channels_are_not_markup(self) -> None:
        named = _with(response(), response().values[0, 0], output="<a href='x'>y</a>")
        figure = bode(named, output="<a href='x'>y</a>", input="roll_command")
        assert "<a" not in json.dumps(figure)


def sample_bode_of(measured: FrequencyResponse) -> dict[str, Any]:
    return drawn(bode(measured, output="p", input="roll_command"))


def _with(of: FrequencyResponse, values: Any, *, output: str = "p") -> FrequencyResponse:
    return FrequencyResponse(
        omega_rad_s=of.omega_rad_s,
        values=np.reshape(values, (1, 1, -1)),
        coherence=of.coherence,
        random_error=of.random_error,
        covariance=of.covariance,
        inputs=of.inputs,
        outputs=(output,),
        estimate=of.estimate,
    )


class TestPhase:
    @pytest.mark.parametrize(
        ("value", "expected"), [(1.0, 0.0), (-1.0, -180.0), (complex(-1.0, -0.0), -180.0), (-1j, -90.0), (1j, -270.0)]
    )
    def test_starting_branch(self, value: complex, expected: float) -> None:
        assert unwrapped_deg(np.array([1.0]), np.array([value])) == pytest.approx([expected])

    @given(st.floats(-2000, 2000), st.floats(-3.1, 3.1))
    def test_nearest_branch_is_at_most_half_a_turn_away(self, reference: float, angle: float) -> None:
        phase = near_deg(np.array([np.exp(1j * angle)]), np.array([reference]))
        assert abs(phase[0] - reference) <= 180.0 + 1e-9
        assert np.exp(1j * np.radians(phase[0])) == pytest.approx(np.exp(1j * angle))


class TestTicks:
    @given(st.floats(0.01, 10.0), st.floats(1.5, 1000.0))
    def test_a_readable_number_of_frequencies(self, low: float, ratio: float) -> None:
        ticks = frequency_ticks(np.array([low, low * ratio]))
        assert 1 <= len(ticks) <= 3 * (np.log10(ratio) + 2) + 4
        assert ticks == sorted(ticks)

    @given(st.floats(15.0, 2400.0))
    def test_a_readable_number_of_phases(self, span: float) -> None:
        assert 1 <= span / phase_step_deg(span) <= 7

    def test_flat_response_looks_flat(self) -> None:
        measured = response()
        flat = _with(measured, np.full(90, 10.0 + 0.0j))
        good = measured.coherence > 0.98
        figure = drawn(bode(flat, output="p", input="roll_command", fitted=good))
        assert figure["layout"]["yaxis"]["range"] == [15.0, 25.0]
        assert "range" not in sample_bode()["layout"]["yaxis"]


class TestTime:
    def test_rates_are_in_degrees_per_second(self) -> None:
        check = doublet()
        figure = drawn(verification(check))
        (trace,) = traces(figure, axis="y", name="predicted")
        np.testing.assert_allclose(trace["y"], np.degrees(check.predicted[0]), rtol=1e-4)
        assert figure["layout"]["annotations"][0]["text"] == "roll rate p [°/s]"

    def test_late_stamps_keep_their_resolution(self) -> None:
        time_s = 12345.0 + np.arange(50) / 400.0
        np.testing.assert_allclose(np.diff(np.array(stamps(time_s), dtype=float)), 1 / 400.0, atol=1.01e-4)

    def test_every_maneuver_is_shaded_in_every_panel(self) -> None:
        segments = (sweep(12.0), sweep(62.0))
        figure = drawn(timeline(segments, inputs=["roll_command"], outputs=["p"]))
        shaded = [(shape["yref"], shape["x0"], shape["x1"]) for shape in figure["layout"]["shapes"]]
        assert shaded == [(f"{y} domain", start, start + 40.0) for y in ("y", "y2") for start in (12.0, 62.0)]

    def test_long_records_are_thinned(self) -> None:
        segment = sweep(12.0)
        assert segment.history.values.shape[1] == 46 * RATE_HZ
        figure = drawn(timeline([segment], inputs=["roll_command"], outputs=["p"]))
        assert {len(trace["x"]) for trace in figure["data"]} == {4000}

    def test_channel_that_a_segment_lacks_leaves_an_empty_panel(self) -> None:
        figure = drawn(timeline([sweep(12.0)], inputs=["roll_command"], outputs=["q"]))
        assert {trace["yaxis"] for trace in figure["data"]} == {"y"}


class TestNumbers:
    @given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=300), st.sampled_from([10, 40, 100]))
    def test_envelope_keeps_extremes_and_order(self, values: list[float], most: int) -> None:
        time, shown = envelope(np.arange(float(len(values))), np.array(values), most=most)
        assert shown.size <= most
        assert (shown.min(), shown.max()) == (min(values), max(values))
        assert np.all(np.diff(time) >= 0)
        assert np.array_equal(np.array(values)[time.astype(int)], shown)

    @given(st.lists(st.sampled_from([-2.0, -0.0, 0.0, 1.0, np.nan, np.inf]), min_size=11, max_size=60))
    def test_of_equal_extremes_of_a_bucket_the_first_is_kept(self, values: list[float]) -> None:
        time, _ = envelope(np.arange(float(len(values))), np.array(values), most=10)
        edges = np.linspace(0, len(values), 6).astype(int)
        expected = []
        for start, stop in itertools.pairwise(edges):
            of_bucket = range(start, stop)
            low = min(of_bucket, key=lambda k: values[k] if math.isfinite(values[k]) else math.inf)
            high = max(of_bucket, key=lambda k: values[k] if math.isfinite(values[k]) else -math.inf)
            expected += sorted((low, high))
        assert time.tolist() == expected

    def test_a_trace_may_change_its_numbers(self) -> None:
        values = np.array([1.0, 2.0])
        numbers(values).append(None)
        assert numbers(values) == [1.0, 2.0]

    def test_gaps_among_numbers_stay_gaps(self) -> None:
        assert numbers(np.array([1.0, np.nan, np.inf, 2.0])) == [1.0, None, None, 2.0]

    @given(st.floats(-1e300, 1e300))
    def test_numbers_keep_five_digits(self, value: float) -> None:
        assert numbers(np.array([value])) == [pytest.approx(value, rel=5.1e-5)]

    @given(st.floats())
    @example(sys.float_info.max)
    def test_any_number_becomes_json(self, value: float) -> None:
        json.dumps(numbers(np.array([value])), allow_nan=False)


class TestTheme:
    @pytest.mark.parametrize("background", ["#ffffff", "#191d22"])
    @pytest.mark.parametrize("color", [*SERIES, SECONDARY])
    def test_lines_stand_out_on_light_and_dark(self, color: str, background: str) -> None:
        """WCAG 2.1, 1.4.11: graphics need a contrast of 3 : 1."""
        assert contrast(color, background) >= 3.0

    @pytest.mark.parametrize(("dark", "background"), [(False, "#ffffff"), (True, "#191d22")])
    def test_text_can_be_read(self, dark: bool, background: str) -> None:
        """WCAG 2.1, 1.4.3: text needs 4.5 : 1."""
        layout = template(dark=dark)["layout"]
        for color in (layout["font"]["color"], layout["xaxis"]["tickfont"]["color"]):
            assert contrast(color, background) >= 4.5

    def test_panels_fill_the_figure_without_touching(self) -> None:
        panels = [Panel(label=str(height), traces=(), height_px=height) for height in (200.0, 100.0, 50.0)]
        layout = stacked(panels, x_axis={})["layout"]
        domains = [layout[name]["domain"] for name in ("yaxis", "yaxis2", "yaxis3")]
        assert domains[0][1] == 1.0
        assert domains[-1][0] == pytest.approx(0.0, abs=2e-5)
        assert all(upper[0] > lower[1] for upper, lower in itertools.pairwise(domains))


def contrast(one: str, other: str) -> float:
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def luminance(color: str) -> float:
    parts = np.array([int(color[at : at + 2], 16) for at in (1, 3, 5)]) / 255.0
    linear = np.where(parts <= 0.03928, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(linear @ np.array([0.2126, 0.7152, 0.0722]))


def spanned(*values: float) -> tuple[float, float] | None:
    """What the vertical axis of a picture of these values shows at least."""
    panel = Panel(label="", traces=[{"y": list(values)}], height_px=100.0)
    found = stacked([panel], x_axis={})["layout"]["yaxis"].get("autorangeoptions")
    return None if found is None else (found["include"][0], found["include"][1])


@pytest.mark.parametrize("unit", [1e-6, 1e-3, 1.0, 1e6])
def test_an_axis_is_spanned_by_its_values_in_any_unit(unit: float) -> None:
    # A delay of some milliseconds in s, or a torque of some micronewton meters, is as good as any number.
    assert spanned(0.0, unit) is None
    assert spanned(2.0 * unit, 2.01 * unit) is None


def test_what_hardly_differs_looks_the_same() -> None:
    low, high = spanned(5.0, 5.0 + 1e-12) or (math.nan, math.nan)
    assert (low, high) == pytest.approx((5.0 - 0.0025, 5.0 + 0.0025))
    # At the limit the forced span is the one that the values have: nothing jumps.
    values = (1000.0, 1000.999)
    low, high = spanned(*values) or (math.nan, math.nan)
    assert high - low == pytest.approx(values[1] - values[0], rel=0.01)


def test_rounding_at_zero_spans_no_axis() -> None:
    low, high = spanned(-3e-17, 2e-16) or (math.nan, math.nan)
    assert high - low == pytest.approx(1e-9)
