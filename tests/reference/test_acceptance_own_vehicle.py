"""A vehicle made from results of its own logs: it flies like the one that was flown, and plans are as good with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.documents.vehicle import parse_vehicle, vehicle_toml
from rotorid.flying.designs import design, plan_with
from rotorid.flying.settings import DesignSettings, PlanSettings, SimulateSettings
from rotorid.flying.simulation import fly_run, simulate, write_run
from rotorid.flying.user_vehicles import own_vehicle
from rotorid.identifying.identification import identify_motors
from rotorid.settings.motors import MotorSettings
from rotorid.signal.motors import logged_outputs
from rotorid.simulation.multirotor import PERFECT
from rotorid.simulation.multirotor_flight import Aircraft, piloted
from rotorid.simulation.wind import Wind
from rotorid.vehicles.catalog import aircraft, entry_of
from rotorid.verification.scores import theil_inequality

Unpacked = Callable[[str], Path]

LARGEST_TIC = 0.1
BOUNDS = 0.25
ARM_M = 0.2 * 2.0**0.5
SEEN = {"p": 0, "q": 1, "r": 2}
LIKE = "px4_quad"
SHOWN = ("p", "q", "r", "az", "phi", "theta", "psi", "roll_command", "pitch_command", "yaw_command", "thrust_command")


def through_a_file(craft: Aircraft) -> Aircraft:
    return parse_vehicle(vehicle_toml(entry_of(craft), base=LIKE), where="mine.toml").aircraft


def quiet(craft: Aircraft) -> Aircraft:
    return piloted(replace(craft, sensors=PERFECT))


def test_a_vehicle_from_a_simulated_flight_answers_unseen_doublets(tmp_path: Path) -> None:
    craft = SimulateSettings(vehicle=LIKE).aircraft
    sizes = {"roll": 0.07, "pitch": 0.07, "yaw": 0.12, "thrust": 0.08}
    excited = PlanSettings(shape="multisine", entry="command", band_rad_s=(1.0, 60.0), duration_s=20.0)
    flight = SimulateSettings(
        vehicle=LIKE, plan=plan_with(craft, excited, sizes), wind=Wind(turbulence_m_s=0.3), seed=5
    )
    write_run(tmp_path / "flight.ulg", fly_run(flight, 0), flight)
    model = identify_motors([tmp_path / "flight.ulg"], MotorSettings(known={"m": 1.0}, arm_m=ARM_M))
    own = through_a_file(own_vehicle([model], like=aircraft(LIKE), name="mine").aircraft)

    unseen = plan_with(craft, PlanSettings(shape="doublet"), {"roll": 0.15, "pitch": 0.15, "yaw": 0.5, "thrust": 0.06})
    flown, predicted = (simulate(quiet(one), unseen, seed=1).columns for one in (aircraft(LIKE), own))
    for name in SHOWN:
        pair = (one[name] - one[name].mean() for one in (flown, predicted))
        assert theil_inequality(*pair) <= LARGEST_TIC, name


@pytest.fixture(scope="module")
def of_logs(unpacked: Unpacked) -> Aircraft:
    """From the logs of PX4's simulator, in which every axis was excited in a flight of its own."""
    logs = [unpacked(f"px4_sitl/{name}") for name in ("roll.ulg", "pitch.ulg.xz", "yaw.ulg.xz", "thrust.ulg.xz")]
    model = identify_motors(logs, MotorSettings(known={"m": 1.0, "I_zz": 0.03}, arm_m=ARM_M))
    return through_a_file(own_vehicle([model], like=aircraft(LIKE), name="mine").aircraft)


@pytest.mark.slow
def test_a_vehicle_from_logs_predicts_an_unseen_flight_by_its_motor_outputs(
    of_logs: Aircraft, unpacked: Unpacked
) -> None:
    """Open loop over whole doublets; start and a constant moment are those of the flight."""
    log = rotorid.read(unpacked("px4_sitl/verify.ulg.xz"))
    doublets = [one for one in rotorid.inspect(log).excitations if one.axis != "thrust"]
    assert len(doublets) == 6
    for one in doublets:
        name = {"roll": "p", "pitch": "q", "yaw": "r"}[one.axis]
        measured, simulated = predicted_rate(of_logs, log, name, one.start_s, one.stop_s)
        assert theil_inequality(measured, simulated) <= LARGEST_TIC, one


def predicted_rate(
    craft: Aircraft, log: rotorid.FlightRecord, name: str, start_s: float, stop_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """A rate over a stretch as the log has it, and as the vehicle makes it of the logged outputs."""
    body, axis = craft.vehicle, SEEN[name]
    outputs = logged_outputs(log)
    step_s = 1.0 / outputs.sample_rate_hz
    topic = next(topic for topic in log.topics if topic.row(name) is not None)
    row = topic.row(name)
    assert row is not None
    keep = np.exp(-step_s / body.rotors.lag_up_s)
    lagged = np.empty_like(outputs.values)
    lagged[:, 0] = outputs.values[:, 0]
    for k in range(1, lagged.shape[1]):
        lagged[:, k] = keep * lagged[:, k - 1] + (1.0 - keep) * outputs.values[:, k - 1]
    thrusts = np.polynomial.polynomial.polyval(lagged, body.rotors.thrust)
    acceleration = np.linalg.solve(body.inertia_kg_m2, body.wrench[3:] @ thrusts)[axis]
    assert body.aerodynamics is not None
    damping_1_s = body.aerodynamics[3 + axis, 3 + axis] / body.inertia_kg_m2[axis, axis]

    inside = (outputs.time_s >= start_s) & (outputs.time_s <= stop_s)
    measured = np.interp(outputs.time_s[inside], topic.time_s, topic.values[row])

    def rates(driven: np.ndarray, start: float) -> np.ndarray:
        found = np.empty(driven.size)
        found[0] = start
        for k in range(1, driven.size):
            found[k] = np.exp(damping_1_s * step_s) * found[k - 1] + step_s * driven[k - 1]
        return found

    still = np.zeros(measured.size)
    base = rates(acceleration[inside], 0.0)
    free = np.stack([rates(still + 1.0, 0.0), rates(still, 1.0)], axis=1)
    shift, *_ = np.linalg.lstsq(free, measured - base, rcond=None)
    return measured, base + free @ shift


@pytest.mark.slow
def test_bounds_that_are_predicted_with_a_vehicle_from_logs_hold(of_logs: Aircraft, tmp_path: Path) -> None:
    """The plan is made with the vehicle from logs, and flown by the one that PX4's simulator has."""
    air = Wind(turbulence_m_s=0.5)
    plan = PlanSettings(axes=("roll",), band_rad_s=(1.0, 50.0), duration_s=40.0, wind=air)
    (made,) = design(DesignSettings(vehicle=of_logs, kinds=("pilot_sweep",), plan=plan, models=("rate.roll",)))
    prediction = made.told[0].prediction
    assert prediction is not None
    flight = SimulateSettings(vehicle=LIKE, plan=made.planned.plan, wind=air, runs=4, seed=7)
    stated: dict[str, list[float]] = {one.name: [] for one in prediction.parameters}
    for number in range(flight.runs):
        path = tmp_path / f"{number}.ulg"
        write_run(path, fly_run(flight, number), flight)
        found = rotorid.identify([path], "rate.roll")
        for name, known in stated.items():
            known.append(found[name].std_random or 0.0)
    for name, known in stated.items():
        assert abs(prediction[name].std / np.mean(known) - 1.0) <= BOUNDS, name
