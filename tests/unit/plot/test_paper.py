"""The Bode plot for papers holds the numbers of the one for the screen."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from tests.unit.report.sample import exact, response

from rotorid.errors import UsageError
from rotorid.plot.frequency import bode
from rotorid.plot.paper import bode_figure


def test_points_are_those_of_the_screen() -> None:
    measured = response()
    fitted = measured.coherence >= 0.6
    options = {"output": "p", "input": "roll_command", "fitted": fitted, "frequency": "Hz", "magnitude": "linear"}
    cells = bode_figure(measured, **options).axes
    screen = [trace for trace in bode(measured, **options)["data"] if trace["name"] == "measured"]
    for cell, trace in zip(cells, screen, strict=True):
        used = cell.get_lines()[0]
        # Five significant digits on the screen.
        np.testing.assert_allclose(used.get_xdata(), trace["x"], rtol=5.1e-5)
        np.testing.assert_allclose(used.get_ydata(), trace["y"], rtol=5.1e-5)
        assert cell.get_lines()[1].get_xdata().size == (~fitted).sum()
    assert cells[2].get_xlabel() == "frequency [Hz]"
    assert cells[0].get_ylabel() == "magnitude [rad/s]"


ALL = np.ones((1, 1, 90), dtype=bool)


def test_the_model_lies_over_it() -> None:
    measured = response()
    values = exact(measured.omega_rad_s)
    figure = bode_figure(measured, output="p", input="roll_command", model=values.reshape(1, 1, -1), fitted=ALL)
    (line,) = (line for line in figure.axes[0].get_lines() if line.get_label() == "model")
    np.testing.assert_allclose(line.get_ydata(), 20.0 * np.log10(np.abs(values)))


def test_missing_matplotlib_is_said_with_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(UsageError, match=r"pip install 'rotorid\[figures\]'"):
        bode_figure(response(), output="p", input="roll_command")
