"""The same gains of a simulated flight, whether tune has its log, the result of identify, or both."""

from __future__ import annotations

from dataclasses import replace

import pytest
from tests.documents_alike import alike

import rotorid
from rotorid.data.record import FlightRecord
from rotorid.documents.result import load, save
from rotorid.documents.tune import tune_document
from rotorid.flying.designs import plan_with
from rotorid.flying.settings import DesignSettings, PlanSettings
from rotorid.io.registry import read, write_log
from rotorid.proposing import tune
from rotorid.proposing.bands import designed_for_tune
from rotorid.results.model import IdentifiedModel
from rotorid.simulation import Wind
from rotorid.simulation.multirotor_flight import fly_multirotor

GUSTY = Wind(north_m_s=3.0, turbulence_m_s=0.5)
VEHICLES = [("ardupilot_quad", "bin", "command"), ("px4_quad", "ulg", "command")]


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(VEHICLES[0], id=VEHICLES[0][0]),
        pytest.param(VEHICLES[1], id=VEHICLES[1][0], marks=pytest.mark.slow),
    ],
)
def flight(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[DesignSettings, FlightRecord, IdentifiedModel]:
    """A sweep of roll in gusts, and its result as it is read from files."""
    vehicle, form, entry = request.param
    folder = tmp_path_factory.mktemp(vehicle)
    plan = PlanSettings(
        shape="logarithmic_sweep", axes=("roll",), duration_s=40.0, band_rad_s=(0.6, 60.0), entry=entry, wind=GUSTY
    )
    choices = DesignSettings(vehicle=vehicle, kinds=("logarithmic_sweep",), plan=plan)
    craft = choices.aircraft
    write_log(
        folder / f"flight.{form}",
        fly_multirotor(craft, plan_with(craft, plan, {"roll": 0.05}), wind=GUSTY, seed=7),
        format=form,
    )
    log = read(folder / f"flight.{form}")
    save(rotorid.identify(log, "rate.roll"), folder / "result")
    return choices, log, load(folder / "result")


def test_a_log_its_result_and_both_give_one_proposal(
    flight: tuple[DesignSettings, FlightRecord, IdentifiedModel],
) -> None:
    _, log, result = flight
    by_log, by_result, by_both = (
        tune(models, records, axes=("roll",)) for models, records in (((), log), (result, ()), (result, log))
    )
    documents = [tune_document(found).model_dump()["axes"]["roll"] for found in (by_log, by_result, by_both)]
    assert alike(documents[1], documents[0])
    assert alike(documents[2], documents[0])
    assert by_result.files == by_log.files == by_both.files
    assert by_result.axes["roll"].noise_seen == by_log.axes["roll"].noise_seen
    assert "room_not_checked" in {one.kind for one in by_result.findings}


def test_a_plan_is_for_the_band_that_tune_asks_for(
    flight: tuple[DesignSettings, FlightRecord, IdentifiedModel],
) -> None:
    choices, log, result = flight
    needed = tune(records=log, axes=("roll",)).axes["roll"].needed_rad_s
    assert designed_for_tune(choices, record=log).plan.band_rad_s[1] == needed
    assert designed_for_tune(choices, models=(result,)).plan.band_rad_s[1] == needed


def test_a_result_without_the_filters_of_the_gyro_has_no_gains(
    flight: tuple[DesignSettings, FlightRecord, IdentifiedModel],
) -> None:
    """As older versions wrote them: gains of it would not be those of its log."""
    _, _, result = flight
    assert result.controller is not None
    older = replace(result, controller=replace(result.controller, settings={}))
    with pytest.raises(rotorid.InsufficientDataError) as refused:
        tune(older, axes=("roll",))
    assert any("identify again, or give the log" in finding.message for finding in refused.value.findings)
