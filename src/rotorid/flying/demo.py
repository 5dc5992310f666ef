"""The demonstration: fly the built-in vehicle, and identify it from its log like any other."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from rotorid.data.flight_plan import FlightPlan
from rotorid.data.record import FlightRecord
from rotorid.flying.designs import plan_with
from rotorid.flying.settings import PlanSettings
from rotorid.flying.simulation import truth_of
from rotorid.identifying.identification import identify
from rotorid.results.model import IdentifiedModel
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.option import require_seed
from rotorid.simulation.multirotor_flight import Aircraft
from rotorid.vehicles.catalog import aircraft as library_aircraft

LOG_NAME = "flight.ulg"
VEHICLE = "s500"

TURBULENCE_M_S = 0.08
"""As much as the published vehicle bears: a gust of 1 m/s turns it with 27 rad/s²."""

SWEEP_BAND_RAD_S = (2.0 * math.pi * 0.1, 2.0 * math.pi * 8.0)
SWEEP_STICKS = {"roll": 0.44, "pitch": 0.3, "yaw": 0.39, "thrust": 0.13}
DOUBLET_STICKS = {"roll": 0.7, "pitch": 0.6, "yaw": 0.9, "thrust": 0.25}

MODELS = ("hover.lateral", "hover.longitudinal")
"""What flies: an S500 couples roll with yaw and pitch with heave, and gusts turn it; no rate model can show that."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Demonstration:
    """What the demonstration made.

    Parameters
    ----------
    identifications
        Of roll with yaw, and of pitch with heave.
    truth
        The parameters of the vehicle that flew: its exact linearization in hover, in still air.
    """

    identifications: tuple[IdentifiedModel, ...]
    truth: dict[str, float]

    def distances(self) -> dict[str, float]:
        """How far each parameter that was found lies from the truth, in its own standard deviations.

        Examples
        --------
        >>> Demonstration(identifications=(), truth={"L_roll": 153.4}).distances()
        {}
        """
        return {
            name: (parameter.value - self.truth[name]) / parameter.std
            for result in self.identifications
            for name, parameter in result.parameters.items()
            if name in self.truth and parameter.std
        }


def demo_plan(aircraft: Aircraft) -> FlightPlan:
    """Sweeps of the sticks, two on every axis, and two doublets that no model is fitted to; eight minutes.

    As large as keeps the tilt below 25°, found with :func:`rotorid.flying.designs.plan_for`.
    """
    choices = PlanSettings(
        shape="pilot_sweep", band_rad_s=SWEEP_BAND_RAD_S, duration_s=50.0, repeats=2, doublets=True, entry="stick"
    )
    return plan_with(aircraft, choices, SWEEP_STICKS, doublets=DOUBLET_STICKS, name="demonstration")


def fly_demo(path: Path, *, seed: int) -> None:
    """Fly sweeps and doublets with the S500 of the literature in gusts, and write the log as PX4 would have.

    Parameters
    ----------
    path
        Log to write, a ULog.
    seed
        Seed of gusts and sensor noise.
    """
    from rotorid.io.registry import write_log
    from rotorid.simulation.multirotor_flight import fly_multirotor
    from rotorid.simulation.wind import Wind

    require_seed(seed)
    craft = library_aircraft(VEHICLE)
    flown = fly_multirotor(craft, demo_plan(craft), wind=Wind(turbulence_m_s=TURBULENCE_M_S), seed=seed)
    write_log(path, flown, format="ulg")


def identify_demo(record: FlightRecord, *, seed: int) -> Demonstration:
    """Identify the hover models from the log of the demonstration.

    Parameters
    ----------
    record
        That log.
    seed
        Of what is random in the search.
    """
    results = tuple(identify([record], model, settings=IdentifySettings(seed=seed)) for model in MODELS)
    names = {name for result in results for name in result.parameters}
    truth = {name: true.value for name, true in truth_of(library_aircraft(VEHICLE)).items() if name in names}
    return Demonstration(identifications=results, truth=truth)
