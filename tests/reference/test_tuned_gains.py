"""Gains from real autopilots' own simulators: what flew is told, other gains are refused, and the proposal holds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.errors import InsufficientDataError
from rotorid.pipeline import tune

SWEEP = "ardupilot_sitl/x_calm_roll.BIN"


@pytest.fixture(scope="module")
def sweep(shared_data: Path) -> rotorid.FlightRecord:
    return rotorid.read(shared_data / SWEEP)


@pytest.fixture(scope="module")
def model(sweep: rotorid.FlightRecord) -> rotorid.IdentifiedModel:
    return rotorid.identify(sweep, "rate.roll")


def test_hot_gains_of_ardupilot_come_down(sweep: rotorid.FlightRecord, model: rotorid.IdentifiedModel) -> None:
    found = tune(model, sweep, axes=("roll",))
    one = found.axes["roll"]
    assert np.median(one.proposal.flown.whole.sensitivity_peak) > 3.0
    assert np.quantile(one.proposal.proposed.whole.sensitivity_peak, 0.9) < 1.75
    assert one.parameters["ATC_RAT_RLL_P"][1] < 0.8 * one.parameters["ATC_RAT_RLL_P"][0]
    assert sorted(found.files) == ["proposed.param"]
    # The sweep logs the rate in front of the filters of the gyro, and still says that these gains flew.
    assert not [one for one in found.findings if one.kind == "controller_unchecked"]


@pytest.mark.parametrize("factor", [0.4, 2.5])
def test_other_gains_than_those_of_the_log_are_refused(
    sweep: rotorid.FlightRecord, model: rotorid.IdentifiedModel, factor: float
) -> None:
    names = ("ATC_RAT_RLL_P", "ATC_RAT_RLL_I", "ATC_RAT_RLL_D")
    wrong = {name: factor * sweep.parameters[name] for name in names}
    with pytest.raises(InsufficientDataError) as refused:
        tune(model, replace(sweep, parameters={**sweep.parameters, **wrong}), axes=("roll",))
    assert "other_controller" in {finding.kind for finding in refused.value.findings}


def test_another_filter_is_judged_and_written(sweep: rotorid.FlightRecord, model: rotorid.IdentifiedModel) -> None:
    plain = tune(model, sweep, axes=("roll",))
    faster = tune(model, sweep, axes=("roll",), filters={"INS_GYRO_FILTER": 60.0})
    prices = {price.name: price.phase_deg for price in plain.axes["roll"].prices}
    assert max(prices, key=lambda name: prices[name]).startswith("gyro: ")
    assert max(prices.values()) > 5.0
    assert faster.axes["roll"].proposal.better < plain.axes["roll"].proposal.better
    assert "INS_GYRO_FILTER,60" in faster.files["proposed.param"]
    assert "INS_GYRO_FILTER,20" in faster.rollback_files["rollback.param"]
