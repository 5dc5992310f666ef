"""Forecast over statement: what a design says of plans, and what identifications of simulated flights state.

Seeds of the flights are others than those of the rehearsals of a plan. Model errors scatter from flight to flight where
a structure does not fit, and so the bar is one of plans: the median over its parameters and flights.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from rotorid.data.flight_plan import Shape
from rotorid.documents.result import result_document
from rotorid.flying.designs import design
from rotorid.flying.settings import DesignSettings, PlanSettings, SimulateSettings, plan_settings
from rotorid.flying.simulation import fly_run, write_run
from rotorid.identifying.identification import identify
from rotorid.io.registry import read
from rotorid.simulation.wind import Wind
from rotorid.typing import Axis
from rotorid.vehicles.catalog import entry_of


class Case(NamedTuple):
    vehicle: str
    axes: tuple[Axis, ...]
    shape: Shape
    models: tuple[str, ...]
    turbulence_m_s: float
    duration_s: float
    low_rad_s: float = 1.0


CASES = (
    Case("px4_quad", ("pitch", "yaw"), "pilot_sweep", ("rate.pitch", "rate.yaw"), 0.8, 70.0),
    Case("px4_quad", ("roll", "yaw"), "pilot_sweep", ("hover.lateral",), 0.5, 80.0, 0.6),
    Case("ardupilot_quad", ("roll", "yaw"), "logarithmic_sweep", ("hover.lateral", "rate.roll"), 0.3, 60.0, 0.6),
    Case("iris", ("roll", "thrust"), "pilot_sweep", ("rate.roll", "rate.vertical"), 0.3, 50.0),
    Case("x500", ("pitch",), "pilot_sweep", ("rate.pitch",), 0.0, 35.0),
    Case("hummingbird", ("pitch", "thrust"), "pilot_sweep", ("hover.longitudinal", "rate.pitch"), 0.0, 50.0, 0.6),
    Case("s500", ("yaw", "pitch"), "pilot_sweep", ("rate.yaw",), 0.2, 45.0),
    Case("crazyflie", ("pitch",), "pilot_sweep", ("rate.pitch",), 0.0, 60.0),
    Case("bebop", ("roll", "pitch", "thrust"), "random_binary", ("response.first_order_delay",), 0.0, 45.0),
)
LOW, HIGH = 0.7, 1.4
FLIGHTS = 2


def ratios(case: Case, folder: Path) -> dict[str, list[float]]:
    """Forecast over statement, random and model error together, of each model over parameters and flights."""
    wind, entry = Wind(turbulence_m_s=case.turbulence_m_s), entry_of(case.vehicle)
    if entry.interface is None:
        plan = PlanSettings(
            shape=case.shape, axes=case.axes, band_rad_s=(case.low_rad_s, 50.0), duration_s=case.duration_s, wind=wind
        )
    else:
        plan = plan_settings(
            entry, wind=wind, inputs=(), models=case.models, axes=case.axes, duration_s=case.duration_s
        )
    choices = DesignSettings(vehicle=case.vehicle, kinds=(case.shape,), plan=plan, models=case.models)
    (found,) = design(choices)
    flies = SimulateSettings(vehicle=case.vehicle, plan=found.planned.plan, wind=wind, runs=FLIGHTS, seed=900)
    records = []
    for number, name in enumerate(flies.file_names):
        write_run(folder / name, fly_run(flies, number), flies)
        records.append(read(folder / name))
    compared: dict[str, list[float]] = {}
    for predicted in found.told:
        assert predicted.prediction is not None, predicted.refused
        stated = [result_document(identify([record], predicted.model)).parameters for record in records]
        compared[predicted.model] = [
            parameter.std / std
            for parameter in predicted.prediction.parameters
            for each in stated
            if parameter.name in each and (std := each[parameter.name].std)
        ]
    return compared


@pytest.mark.slow
def test_forecasts_are_what_flights_state(tmp_path: Path) -> None:
    every = {f"{case.vehicle} {model}": found for case in CASES for model, found in ratios(case, tmp_path).items()}
    medians = np.array([np.median(found) for found in every.values()])
    assert np.mean((medians > LOW) & (medians < HIGH)) >= 0.9, {name: np.median(found) for name, found in every.items()}
    single = np.concatenate([np.array(found) for found in every.values()])
    assert np.mean((single > LOW) & (single < HIGH)) >= 0.8
