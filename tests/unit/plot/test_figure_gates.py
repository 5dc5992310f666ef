"""No picture draws as measured what the tables do not count: it is gray, dashed or not there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from tests.unit.report.made_reviews import OMEGA as REVIEWED
from tests.unit.report.made_reviews import made_review
from tests.unit.report.response_sample import axis_loop
from tests.unit.report.sample import exact, response

from rotorid.data.response import FrequencyResponse
from rotorid.data.trust import DIRECT_COHERENCE, LARGEST_RANDOM_ERROR, trusted
from rotorid.plot.figure import SECONDARY, Figure, Trace, translucent
from rotorid.plot.frequency import Named, bode, overlay
from rotorid.plot.loops import broken_loop, disturbance_rejection
from rotorid.plot.tuning import responses
from rotorid.report.response import loop_pictures
from rotorid.report.review import pictures_of
from rotorid.reviewing.values import Review
from rotorid.spectral.derived import read_points
from rotorid.typing import BoolArray, FloatArray

GRAY = translucent(SECONDARY, 0.1).rpartition(",")[0]
PAIR = {"output": "p", "input": "roll_command"}


def solid(trace: Trace) -> bool:
    """Whether a trace looks like something that was measured: neither gray, nor dashed, nor a band in gray."""
    line, marker = trace.get("line", {}), trace.get("marker", {})
    if trace["mode"] == "markers":
        return bool(marker["color"] != SECONDARY)
    if "fill" in trace:
        return not str(trace["fillcolor"]).startswith(GRAY)
    return bool(line.get("dash", "solid") == "solid" and line.get("color") != SECONDARY and line.get("width", 1))


def drawn_rad_s(figure: Figure) -> FloatArray:
    """Where a figure in rad/s has solid traces."""
    along = [
        x
        for trace in figure["data"]
        if solid(trace) and trace.get("name") != "model"
        for x, y in zip(trace["x"], trace["y"], strict=True)
        if x is not None and y is not None
    ]
    return np.unique(np.array(along, dtype=np.float64))


def within(drawn: FloatArray, omega: FloatArray, gate: BoolArray) -> bool:
    """Whether everything that is drawn lies at a point within the gate."""
    return bool(all(np.min(np.abs(omega[gate] / one - 1.0), initial=np.inf) < 1e-4 for one in drawn))


def measured(estimate: str = "direct") -> FrequencyResponse:
    """A response that fades into noise at both ends."""
    return replace(response(), estimate=estimate)  # type: ignore[arg-type]


def of_bode(**options: object) -> Callable[[], tuple[Figure, FloatArray, BoolArray]]:
    def made() -> tuple[Figure, FloatArray, BoolArray]:
        data = measured()
        gate = trusted(data.random_error, data.coherence, DIRECT_COHERENCE)
        given = {name: gate if one == "gate" else one for name, one in options.items()}
        return bode(data, **PAIR, **given), data.omega_rad_s, gate[0, 0]  # type: ignore[arg-type]

    return made


def of_model() -> tuple[Figure, FloatArray, BoolArray]:
    data = measured()
    gate = np.zeros(data.values.shape, dtype=bool)
    gate[..., 20:50] = True
    model = exact(data.omega_rad_s).reshape(1, 1, -1)
    figure = bode(data, **PAIR, model=model, beside=response(seed=3, estimate="direct"), fitted=gate)  # type: ignore[arg-type]
    return figure, data.omega_rad_s, gate[0, 0]


def of_overlay() -> tuple[Figure, FloatArray, BoolArray]:
    data = measured()
    gate = trusted(data.random_error, data.coherence, DIRECT_COHERENCE)[0, 0]
    return overlay([Named.of(data, **PAIR, name="flight")], **PAIR), data.omega_rad_s, gate


def of_loop(draw: Callable[..., Figure]) -> Callable[[], tuple[Figure, FloatArray, BoolArray]]:
    def made() -> tuple[Figure, FloatArray, BoolArray]:
        omega = np.geomspace(1.0, 100.0, 60)
        gate = (omega > 3.0) & (omega < 40.0)
        values = 20.0 * np.exp(-0.02j * omega) / (1j * omega)
        return draw(omega, values, random_error=np.full(60, 0.1), used=gate), omega, gate

    return made


def of_tune() -> tuple[Figure, FloatArray, BoolArray]:
    omega = np.geomspace(1.0, 100.0, 60)
    ones = np.ones(60)
    figure = responses(omega, {"flown": (0.9 * ones, ones, 1.1 * ones)}, label="S", seen_rad_s=(3.0, 40.0))
    lines = Figure(data=[one for one in figure["data"] if "fill" not in one], layout=figure["layout"])
    # The bands stay: beyond what was measured a curve is dotted and has its error.
    return lines, omega, (omega >= 3.0) & (omega <= 40.0)


def noisy(seen: Review) -> Review:
    """A review whose responses know nothing above 40 rad/s."""

    def fading(one: FrequencyResponse) -> FrequencyResponse:
        return replace(one, random_error=np.where(REVIEWED > 40.0, 0.6, one.random_error))

    return replace(
        seen,
        loops={name: replace(one, response=fading(one.response)) for name, one in seen.loops.items()},
        margins={axis: replace(one, loop=fading(one.loop)) for axis, one in seen.margins.items()},
    )


def of_review(name: str) -> Callable[[], tuple[Figure, FloatArray, BoolArray]]:
    return lambda: (pictures_of([noisy(made_review())])[name], REVIEWED, REVIEWED <= 40.0)


MAKERS = {
    "bode without a choice": of_bode(),
    "bode of a response page": of_bode(fitted="gate"),
    "bode of a model": of_model,
    "overlay": of_overlay,
    "broken loop": of_loop(broken_loop),
    "sensitivity": of_loop(disturbance_rejection),
    "tune": of_tune,
    "review: loop": of_review("bode-p"),
    "review: broken loop": of_review("broken-roll"),
}


@pytest.mark.parametrize("maker", MAKERS)
def test_nothing_beyond_the_gate_is_drawn_as_measured(maker: str) -> None:
    figure, omega, gate = MAKERS[maker]()
    assert gate.any()
    assert not gate.all()
    marks = [trace for trace in figure["data"] if "phase margin" not in trace.get("name", "")]
    drawn = drawn_rad_s(Figure(data=marks, layout=figure["layout"]))
    assert drawn.size
    assert within(drawn, omega, gate)


def test_one_gate_for_tables_and_pictures() -> None:
    error, coherence = np.array([0.1, LARGEST_RANDOM_ERROR, 0.31, 0.1]), np.array([0.6, 0.9, 0.9, 0.59])
    assert trusted(error, coherence, DIRECT_COHERENCE).tolist() == [True, True, False, False]


def test_a_loop_that_no_number_was_read_from_has_no_picture() -> None:
    loop = axis_loop()
    assert loop.loop is not None
    assert len(loop_pictures("roll", loop)) == 2
    unknown = replace(loop.loop, random_error=np.full(loop.loop.random_error.shape, 0.9))
    assert not read_points(unknown).any()
    assert loop_pictures("roll", replace(loop, loop=unknown)) == ()


def test_an_axis_whose_stick_rested_has_numbers_and_no_picture() -> None:
    seen = made_review()
    by_gusts = replace(seen.margins["pitch"], stick_idle=True)
    names = pictures_of([replace(seen, margins={**seen.margins, "pitch": by_gusts})])
    assert "broken-roll" in names
    assert "broken-pitch" not in names
