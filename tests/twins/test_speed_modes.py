"""A rate model of a flight that shows speed modes: it is fitted above them, and says so."""

from __future__ import annotations

from pathlib import Path

import pytest

import rotorid
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.flying.designs import plan_for
from rotorid.flying.settings import PlanSettings, SimulateSettings
from rotorid.flying.simulation import fly_run, truth_of, write_run


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> FlightRecord:
    """An X500 as it is swept when nothing else is asked for: its speed turns it up to 2 rad/s."""
    craft = SimulateSettings(vehicle="x500").aircraft
    choices = SimulateSettings(vehicle="x500", plan=plan_for(craft, PlanSettings(axes=("roll",))).plan, seed=1)
    path = tmp_path_factory.mktemp("x500") / choices.file_names[0]
    write_run(path, fly_run(choices, 0), choices)
    return rotorid.read(path)


def test_a_rate_model_is_fitted_above_the_speed_modes(swept: FlightRecord) -> None:
    found = rotorid.identify(swept, "rate.roll")
    (said,) = (one for one in found.findings if one.kind == "speed_modes_left_out")
    assert said.numbers["whole_cost"] > 100.0 > 50.0 >= said.numbers["average_cost"]
    assert 1.0 < said.numbers["low_rad_s"] < 8.0
    truth = truth_of(SimulateSettings(vehicle="x500").aircraft)
    for name in ("L_roll", "T_motor"):
        one = found[name]
        assert one.lower is not None
        assert one.upper is not None
        assert one.lower < truth[name].value < one.upper
    assert found["L_roll"].std is not None
    assert found["L_roll"].std < 0.1 * found["L_roll"].value


def test_a_band_that_was_chosen_is_kept(swept: FlightRecord) -> None:
    with pytest.raises(InsufficientDataError) as refused:
        rotorid.identify(swept, "rate.roll", band_rad_s=(0.7, 44.0))
    assert "poor_fit" in {one.kind for one in refused.value.findings}


@pytest.mark.parametrize("method", ["prediction_error", "equation_error"])
def test_a_fit_in_time_that_misses_the_responses_is_refused(swept: FlightRecord, method: str) -> None:
    """Its random errors are a thousandth, and its values are 12 and 20 of its deviations off."""
    with pytest.raises(InsufficientDataError, match="In the frequency domain the average cost") as refused:
        rotorid.identify(swept, "rate.roll", method=method)
    assert "poor_fit" in {one.kind for one in refused.value.findings}


def test_a_fit_in_time_that_exchanges_lag_and_damping_is_refused(tmp_path: Path) -> None:
    """In gusts the noise of a px4_quad's yaw fits a motor of 1.2 s and a damping of 110/s better than the truth."""
    craft = SimulateSettings(vehicle="px4_quad").aircraft
    plan = plan_for(craft, PlanSettings(axes=("yaw",))).plan
    choices = SimulateSettings(vehicle="px4_quad", plan=plan, seed=1)
    path = tmp_path / choices.file_names[0]
    write_run(path, fly_run(choices, 0), choices)
    with pytest.raises(InsufficientDataError, match=r"in the time domain but 13\.") as refused:
        rotorid.identify(rotorid.read(path), "rate.yaw", method="prediction_error")
    assert {one.kind for one in refused.value.findings} == {"not_identifiable"}
