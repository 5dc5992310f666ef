"""Margins of a review are what the likely plants have: intervals hold 95 % of them, deviations are theirs."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.loops.rate_loops import read_margins
from rotorid.tuning.loops import loop_figures
from rotorid.tuning.plant import uncertain_plant
from rotorid.typing import ComplexArray, FloatArray

FIELDS = {
    "crossover_rad_s": "crossover_rad_s",
    "phase_margin_deg": "phase_margin_rad",
    "delay_margin_s": "delay_margin_s",
    "gain_margin_db": "gain_margin",
    "sensitivity_peak": "sensitivity_peak",
    "disturbance_rejection_rad_s": "rejection_bandwidth_rad_s",
}


def in_unit(name: str, values: FloatArray) -> FloatArray:
    if name.endswith("_deg"):
        return np.degrees(values)
    return 20.0 * np.log10(values) if name.endswith("_db") else values


def vehicle(omega: FloatArray) -> ComplexArray:
    return np.asarray(20.0 / (1j * omega) * np.exp(-0.02j * omega))


@pytest.mark.parametrize("name", FIELDS)
def test_an_interval_holds_95_percent_of_the_likely_plants(name: str) -> None:
    plant = uncertain_plant(vehicle, None, band_rad_s=(0.5, 200.0), draws=1000, floor=0.05)
    omega = np.geomspace(0.5, 600.0, 170)
    figures = loop_figures(omega, plant.drawn(omega))
    found = read_margins(figures, plant)[0][name]
    drawn = in_unit(name, getattr(figures, FIELDS[name]))
    assert found.value == pytest.approx(np.median(drawn))
    assert np.mean((drawn >= found.lower) & (drawn <= found.upper)) == pytest.approx(0.95, abs=0.005)
    assert found.std == pytest.approx(np.std(drawn))
    assert found.lower < found.value < found.upper
