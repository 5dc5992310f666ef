"""What a result knows comes from nowhere else: vehicles 30 % off those of the library, in what is made of results."""

from __future__ import annotations

from dataclasses import replace

import pytest
from tests.unit.flying.vehicle_twins import LIBRARY, derivatives_of, hover_physics, own_torque, twin_of

from rotorid.documents.vehicle import parse_vehicle, vehicle_toml
from rotorid.flying.simulation import truth_of
from rotorid.flying.user_vehicles import OwnVehicle, hovering_at, own_vehicle
from rotorid.models.structure import LinearStructure
from rotorid.simulation.linearization import hover_derivatives_of
from rotorid.simulation.multirotor_flight import Aircraft
from rotorid.vehicles.catalog import aircraft, entry_of

CONTROLS = ("L_roll", "M_pitch", "N_yaw", "Z_thrust")
EXACT = 1e-6


def body_numbers(craft: Aircraft) -> dict[str, float]:
    """Mass, inertia, rotors and lags of what flies."""
    body, rotors = craft.vehicle, craft.vehicle.rotors
    hover = float(body.hover_shares.mean())
    numbers = {"m": body.mass_kg, "arm": rotors.layout.arm, "T_motor": rotors.mean_lag_s, "hover": hover}
    numbers |= dict(zip(("I_xx", "I_yy", "I_zz"), body.inertia_kg_m2.diagonal().tolist(), strict=True))
    numbers |= {"slope": rotors.thrust[1] + 2.0 * hover * rotors.thrust[2], "kappa": own_torque(craft)[0]}
    return numbers | {"h": rotors.inertia_kg_m2 * rotors.full_speed_rad_s}


def of_library(own: OwnVehicle) -> list[str]:
    """Numbers that a vehicle of the library gave."""
    return [name for name, number in own.joined.numbers.items() if number.source == "default"]


@pytest.mark.parametrize("name", LIBRARY)
def test_the_physics_of_hover_is_the_vehicle(name: str) -> None:
    """Mass, inertia, arm, torque, thrust, momentum, lag and delays are those of the result, flown and in a file."""
    craft = twin_of(name)
    own = own_vehicle([hover_physics(craft)], like=aircraft(name), name="mine")
    assert not of_library(own)
    read = parse_vehicle(vehicle_toml(entry_of(own.aircraft), base=name), where="mine.toml").aircraft
    for made in (own.aircraft, read):
        assert body_numbers(made) == pytest.approx(body_numbers(craft), rel=EXACT)
        built, truth = truth_of(made), truth_of(craft)
        for key in (*CONTROLS, "X_u", "Z_w"):
            assert built[key].value == pytest.approx(truth[key].value, rel=EXACT), key
        for axis in ("roll", "pitch", "yaw", "thrust"):
            assert built[f"tau_{axis}"].value == pytest.approx(truth[f"tau_{axis}"].value, abs=1e-9), axis


@pytest.mark.parametrize("name", LIBRARY)
def test_a_log_without_outputs_of_motors_gives_the_same_answers(name: str) -> None:
    """Speed is then in proportion to output, and named as assumed; accelerations by commands are the same."""
    craft = twin_of(name)
    own = own_vehicle([hover_physics(craft, output=False)], like=aircraft(name), name="mine")
    built, truth = (hover_derivatives_of(made.vehicle, made.autopilot) for made in (own.aircraft, craft))
    for key in CONTROLS:
        assert built[key] == pytest.approx(truth[key], rel=EXACT), key
    assert "proportion" in own.joined.numbers["c_2"].of


@pytest.mark.parametrize("name", LIBRARY)
@pytest.mark.parametrize(
    "models", [("hover.longitudinal", "hover.lateral"), ("axis.roll", "axis.pitch", "axis.yaw", "axis.vertical")]
)
def test_ratios_of_a_linear_model_stay_and_what_splits_them_is_named(name: str, models: tuple[str, ...]) -> None:
    craft = twin_of(name)
    results = [derivatives_of(craft, model) for model in models]
    own = own_vehicle(results, like=aircraft(name), name="mine")
    built, truth = (hover_derivatives_of(made.vehicle, made.autopilot) for made in (own.aircraft, craft))
    for key in CONTROLS:
        assert built[key] == pytest.approx(truth[key], rel=EXACT), key
    assert f"m of {name}" in own.joined.numbers["c_2"].of
    assert f"arm of {name}" in own.joined.numbers["I_xx"].of
    assert own.aircraft.vehicle.rotors.mean_lag_s == pytest.approx(craft.vehicle.rotors.mean_lag_s)
    assert not own.joined.findings or "implausible_physics" not in {one.kind for one in own.joined.findings}


def test_given_numbers_split_the_ratios() -> None:
    """With the true mass, inertia and yaw inertia, thrust, arm and torque follow, and are the true ones."""
    craft = twin_of("px4_quad")
    roll, pitch, yaw = craft.vehicle.inertia_kg_m2.diagonal().tolist()
    results = [derivatives_of(craft, model) for model in ("hover.longitudinal", "hover.lateral")]
    given = {"m": craft.vehicle.mass_kg, "I_xx": roll, "I_yy": pitch, "I_zz": yaw}
    own = own_vehicle(results, like=aircraft("px4_quad"), given=given, name="mine")
    numbers, truth = body_numbers(own.aircraft), body_numbers(craft)
    for key in ("m", "arm", "slope", "kappa"):
        assert numbers[key] == pytest.approx(truth[key], rel=EXACT), key
    assert {own.joined.numbers[key].source for key in given} == {"given"}
    assert {own.joined.numbers[key].source for key in ("arm", "kappa", "c_1")} == {"derived"}


def test_the_user_comes_before_the_result() -> None:
    """A mass scales thrust, inertia and momentum, an arm inertia: the vehicle flies the same."""
    craft = twin_of("px4_quad")
    given = {"m": 2.0 * craft.vehicle.mass_kg, "arm": 0.5 * craft.vehicle.rotors.layout.arm, "T_motor": 0.05}
    own = own_vehicle([hover_physics(craft)], like=aircraft("px4_quad"), given=given, name="mine")
    numbers, truth = body_numbers(own.aircraft), body_numbers(craft)
    assert numbers["m"] == pytest.approx(2.0 * truth["m"])
    assert numbers["I_xx"] == pytest.approx(truth["I_xx"])
    assert numbers["hover"] == pytest.approx(truth["hover"])
    assert own.aircraft.vehicle.rotors.mean_lag_s == 0.05
    built, flown = (hover_derivatives_of(made.vehicle, made.autopilot) for made in (own.aircraft, craft))
    for key in CONTROLS:
        assert built[key] == pytest.approx(flown[key], rel=EXACT), key


def test_a_given_number_that_contradicts_the_answers_is_remarked() -> None:
    craft = twin_of("px4_quad")
    given = {"I_xx": 2.0 * float(craft.vehicle.inertia_kg_m2[0, 0])}
    own = own_vehicle([hover_physics(craft)], like=aircraft("px4_quad"), given=given, name="mine")
    assert [one.where for one in own.joined.findings if one.kind == "implausible_physics"] == ["L_roll"]


def test_delays_of_each_axis_are_its_own_and_one_given_is_that_of_all() -> None:
    craft = twin_of("px4_quad")
    model = hover_physics(craft)
    own = own_vehicle([model], like=aircraft("px4_quad"), given={"delay": 0.02, "delay_yaw": 0.03}, name="mine")
    assert own.aircraft.autopilot.delay_s == (0.02, 0.02, 0.03, 0.02)


def test_a_logged_hover_throttle_and_known_answers_are_both_kept() -> None:
    craft = twin_of("px4_quad")
    results = [derivatives_of(craft, model) for model in ("hover.longitudinal", "hover.lateral")]
    own = own_vehicle(results, like=aircraft("px4_quad"), name="mine")
    assert own.has_thrust_slope
    hovers = hovering_at(own.aircraft, 0.3, answers=own.answers, slope_known=True)
    assert float(hovers.autopilot.hover_commands(hovers.vehicle)[-1]) == pytest.approx(0.3)
    built, truth = (hover_derivatives_of(made.vehicle, made.autopilot) for made in (hovers, craft))
    for key in CONTROLS:
        assert built[key] == pytest.approx(truth[key], rel=EXACT), key


def test_an_axis_of_unknown_delay_has_that_of_another_axis() -> None:
    own = own_vehicle([derivatives_of(twin_of("px4_quad"), "axis.pitch")], like=aircraft("px4_quad"), name="mine")
    assert own.aircraft.autopilot.delay_s == pytest.approx((0.002,) * 4)
    assert "delay of yaw: that of pitch" in own.taken


def test_a_result_without_its_rotors_has_those_of_the_similar_vehicle_on_its_own_arm() -> None:
    craft = twin_of("px4_quad")
    model = replace(hover_physics(craft), rotors=None)
    own = own_vehicle([model], like=aircraft("px4_quad"), name="mine")
    assert own.aircraft.vehicle.rotors.layout.arm == pytest.approx(craft.vehicle.rotors.layout.arm)
    assert "the places of the rotors" in own.taken
    assert isinstance(model.structure, LinearStructure)
