"""Twins 30 % off the library, flown and identified: what is made of their results has their numbers, in every verb."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest
from tests.unit.flying.test_user_vehicles_twins import CONTROLS, body_numbers, of_library
from tests.unit.flying.vehicle_twins import DENSITY, DIAMETER_M, twin_of

from rotorid.documents.vehicle import parse_vehicle, vehicle_toml
from rotorid.exports.exporting import export
from rotorid.flying.designs import plan_for
from rotorid.flying.settings import PlanSettings
from rotorid.flying.simulation import simulate, truth_of
from rotorid.flying.user_vehicles import OwnVehicle, own_vehicle
from rotorid.flying.vehicle_from_results import joined_vehicle
from rotorid.identifying.identification import identify, identify_motors
from rotorid.io.registry import write_log
from rotorid.results.model import IdentifiedModel
from rotorid.settings.motors import MotorSettings
from rotorid.simulation.linearization import hover_derivatives_of
from rotorid.simulation.multirotor_flight import Aircraft, piloted
from rotorid.units import STANDARD_GRAVITY_M_S2
from rotorid.vehicles.catalog import aircraft, entry_of

AXES = ("roll", "pitch", "yaw", "thrust")
FORMATS = {"px4_quad": "ulg", "hummingbird": "csv"}
CLOSE, LATE_S = 0.05, 0.003
"""Share of a number, and seconds of a delay, that a vehicle may be off: unless its result is less certain."""


def log_of(craft: Aircraft, folder: Path, kind: str, axes: Sequence[str] = AXES) -> Path:
    """A flight with sweeps of the axes one after the other, in calm air."""
    flies = piloted(craft)
    choices = PlanSettings(
        shape="logarithmic_sweep",
        axes=tuple(axes),
        amplitudes={"thrust": 0.06} if "thrust" in axes else {},
        band_rad_s=(0.6, 50.0),
        duration_s=50.0,
    )
    path = folder / f"flight.{kind}"
    write_log(path, simulate(flies, plan_for(flies, choices).plan, seed=3), format=kind)
    return path


@pytest.fixture(scope="module", params=tuple(FORMATS))
def flown(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Aircraft, Path]:
    name = str(request.param)
    craft = twin_of(name)
    return name, craft, log_of(craft, tmp_path_factory.mktemp(name), FORMATS[name])


def physics(name: str, craft: Aircraft, log: Path) -> IdentifiedModel:
    """``physical.hover``, with what a person measures: mass, arm, propeller, air, speed by output."""
    numbers, rotors = body_numbers(craft), craft.vehicle.rotors
    weight_n = numbers["m"] * STANDARD_GRAVITY_M_S2 / rotors.layout.rotors
    k_n = numbers["slope"] * 90.0 / (2.0 * weight_n)
    layout = {"layout": "quad.plus"} if name == "hummingbird" else {}
    fix = {"m": numbers["m"], "rho": DENSITY, "k_n": k_n}
    constants = {"z_imu": -craft.sensors.accelerometer_place_m[2]}
    return identify(
        log,
        "physical.hover",
        arm_m=rotors.layout.arm,
        rotor_diameter_m=DIAMETER_M,
        fix=fix,
        constants=constants,
        **layout,
    )


def require_answers(own: OwnVehicle, craft: Aircraft) -> None:
    built, truth = (hover_derivatives_of(made.vehicle, made.autopilot) for made in (own.aircraft, craft))
    for key in CONTROLS:
        assert built[key] == pytest.approx(truth[key], rel=CLOSE), key


def require_lags(own: OwnVehicle, craft: Aircraft) -> None:
    made, true = truth_of(own.aircraft), truth_of(craft)
    for axis in AXES:
        shown, wanted = (one[f"tau_{axis}"].value + one["T_motor"].value for one in (made, true))
        std_s = own.joined.numbers[f"delay_{axis}"].std or 0.0
        assert shown == pytest.approx(wanted, abs=max(LATE_S, 3.0 * std_s)), axis


@pytest.mark.slow
def test_identified_physics_is_the_vehicle_in_every_verb(flown: tuple[str, Aircraft, Path], tmp_path: Path) -> None:
    name, craft, log = flown
    model = physics(name, craft, log)
    own = own_vehicle([model], like=aircraft(name), name="mine")
    assert not of_library(own)
    require_answers(own, craft)
    require_lags(own, craft)
    numbers, truth = body_numbers(own.aircraft), body_numbers(craft)
    assert {key: numbers[key] for key in ("m", "arm")} == pytest.approx({key: truth[key] for key in ("m", "arm")})
    for key, std in (("I_xx", None), ("I_yy", None), ("slope", "c_1"), ("hover", None)):
        known = own.joined.numbers.get(std or key)
        room = max(CLOSE * truth[key], 3.0 * (known.std or 0.0) if known is not None else 0.0)
        assert numbers[key] == pytest.approx(truth[key], abs=room), key
    yaw = own.joined.numbers["I_zz"]
    assert numbers["I_zz"] == pytest.approx(truth["I_zz"], abs=3.0 * (yaw.std or 0.0))

    read = parse_vehicle(vehicle_toml(entry_of(own.aircraft), base=name), where="mine.toml").aircraft
    assert body_numbers(read) == pytest.approx(numbers, rel=1e-9)
    rows = {row.name: row for row in export(joined_vehicle([model]), "mujoco").compared}
    rotors = craft.vehicle.rotors.layout.rotors
    assert rows["vertical acceleration per output"].exported == pytest.approx(
        rotors * truth["slope"] / truth["m"], rel=CLOSE
    )
    again = identify(log_of(read, tmp_path, FORMATS[name], ("pitch",)), "axis.pitch")
    assert again.parameters["M_pitch"].value == pytest.approx(truth_of(craft)["M_pitch"].value, rel=CLOSE)


@pytest.mark.slow
@pytest.mark.parametrize(
    "models", [("hover.longitudinal", "hover.lateral"), ("axis.roll", "axis.pitch", "axis.yaw", "axis.vertical")]
)
def test_identified_ratios_are_those_of_the_vehicle(flown: tuple[str, Aircraft, Path], models: tuple[str, ...]) -> None:
    name, craft, log = flown
    own = own_vehicle([identify(log, model) for model in models], like=aircraft(name), name="mine")
    require_answers(own, craft)
    require_lags(own, craft)
    assert {"m", "arm"} <= set(of_library(own))


@pytest.mark.slow
def test_identified_motors_are_those_of_the_vehicle(flown: tuple[str, Aircraft, Path]) -> None:
    name, craft, log = flown
    if name == "hummingbird":
        pytest.skip("its log has no channels of motor outputs at their own rate")
    truth = body_numbers(craft)
    known = {"m": truth["m"], "I_zz": truth["I_zz"]}
    model = identify_motors([log], MotorSettings(known=known, arm_m=truth["arm"]))
    own = own_vehicle([model], like=aircraft(name), name="mine")
    numbers = body_numbers(own.aircraft)
    for key in ("m", "arm", "I_xx", "I_yy", "I_zz", "slope", "hover", "kappa", "T_motor"):
        assert numbers[key] == pytest.approx(truth[key], rel=2.0 * CLOSE if key == "T_motor" else CLOSE), key
