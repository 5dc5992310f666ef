"""What a result of ``physical.flight`` makes of a vehicle: the body that flew, and nothing beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from tests.unit.flying.flights import DISC_M2, FULL_RAD_S, LIMITS, OF_OUTPUTS, OF_SPEEDS, flight, vehicle
from tests.unit.flying.test_vehicle_from_results import hover, motors

from rotorid.errors import UsageError
from rotorid.flying.simulation import beyond_tested
from rotorid.flying.user_vehicles import own_vehicle
from rotorid.flying.vehicle_air import PLACE
from rotorid.flying.vehicle_from_results import joined_vehicle, require
from rotorid.models.flight_derivatives import flight_derivatives
from rotorid.results.model import bounds_of
from rotorid.results.summary import airframe_of
from rotorid.simulation.flight_kernels import derivative
from rotorid.simulation.linearization import hover_slopes
from rotorid.simulation.multirotor import STATES, Multirotor
from rotorid.simulation.multirotor_flight import fly_multirotor
from rotorid.vehicles.catalog import aircraft

FULL = {**OF_OUTPUTS, "k_w": 0.004, "c_h": 0.03, "d_z": 0.02, "kappa_lambda": 0.0004}


def _moving(body: Multirotor) -> np.ndarray:
    """Accelerations in some states."""
    rng, found = np.random.default_rng(4), []
    for _ in range(20):
        state = rng.standard_normal(STATES + 4)
        state[3:6] *= 3.0
        state[6:10] /= np.linalg.norm(state[6:10])
        state[STATES:] = rng.uniform(0.3, 0.8, 4)
        out = np.zeros(state.size + 3)
        derivative(state, rng.uniform(0.3, 0.8, 4), np.zeros(3), 1.0, body.body(), out)
        found.append(out)
    return np.array(found)


@pytest.mark.parametrize("values", [OF_OUTPUTS, FULL, {**FULL, "c_1": 3.0}], ids=["basic", "full", "bent"])
def test_the_vehicle_that_flew_comes_out(values: Mapping[str, float]) -> None:
    joined = joined_vehicle([flight(values)])
    np.testing.assert_allclose(_moving(require(joined, target="test")), _moving(vehicle(values)), rtol=1e-9, atol=1e-9)
    assert joined.hover_output == pytest.approx(vehicle(values).hover_shares[0])
    assert joined.numbers["disc_area"].value == pytest.approx(4.0 * DISC_M2)


def test_speeds_become_outputs() -> None:
    model = flight(OF_SPEEDS, outputs="speed")
    joined = joined_vehicle([model], given={"speed_max": FULL_RAD_S})
    np.testing.assert_allclose(_moving(require(joined, target="test")), _moving(vehicle()), rtol=1e-9, atol=1e-9)
    assert joined.numbers["k_d"].value == pytest.approx(OF_OUTPUTS["k_d"])
    assert joined.numbers["k_d"].std == pytest.approx(0.01 * OF_OUTPUTS["k_d"])
    unknown = joined_vehicle([model])
    assert not {"k_d", "c_lambda", "h"} & set(unknown.numbers)


def test_a_mass_gives_numbers_by_the_kilogram_their_scale() -> None:
    joined = joined_vehicle([flight(known=("kappa",))], given={"m": OF_OUTPUTS["m"]})
    np.testing.assert_allclose(_moving(require(joined, target="test")), _moving(vehicle()), rtol=1e-9, atol=1e-9)
    assert not {"m", "k_d", "disc_area"} & set(joined_vehicle([flight(known=("kappa",))]).numbers)


def test_derivatives_of_hover_follow_with_their_errors() -> None:
    joined = joined_vehicle([flight()])
    slopes = hover_slopes(vehicle())
    for name, place in {"X_u": (0, 0), "Y_v": (1, 1), "Z_w": (2, 2), "M_u": (4, 0), "L_p": (3, 3)}.items():
        number = joined.numbers[name]
        assert (number.value, number.source) == (pytest.approx(float(slopes[place]), rel=1e-9), "derived")
    # Drag goes with the speed of hover, which is as sure as thrust: 1 % and half of 1.3 % or so.
    assert joined.numbers["X_u"].std == pytest.approx(0.0115 * abs(joined.numbers["X_u"].value), rel=0.1)
    body = require(joined, target="test")
    assert body.aerodynamics is not None
    assert not body.aerodynamics.any()


@pytest.mark.parametrize("values", [OF_OUTPUTS, {**FULL, "c_1": 3.0}], ids=["basic", "full"])
def test_derivatives_are_those_that_the_physics_implies(values: Mapping[str, float]) -> None:
    model = flight(values)
    assert model.flight is not None
    assert model.motors is not None
    held = {name: estimate.value for name, estimate in model.parameters.items()}
    airframe = airframe_of(model.motors, model.flight, held["m"])
    names = [name for name in model.bounds.names if name not in ("T_motor", "J_r", *PLACE)]
    spread = bounds_of(model.bounds, names).covariance
    implied = flight_derivatives(held, airframe, (0.0,), free=names, covariance=spread)
    stds = np.sqrt(implied.covariance.diagonal())
    joined = joined_vehicle([model]).numbers
    for name, value, std in zip(implied.names, implied.values[0], stds, strict=True):
        if name in ("X_u", "Y_v", "Z_w"):
            assert joined[name].value == pytest.approx(float(value), rel=1e-4)
            assert joined[name].std == pytest.approx(float(std))
        elif name in joined:
            assert joined[name].value == pytest.approx(float(value), rel=1e-3)
            assert joined[name].std == pytest.approx(float(std))


def test_a_derivative_that_was_given_is_that_of_rotors_and_body() -> None:
    body = require(joined_vehicle([flight()], given={"X_u": -0.5}), target="test")
    assert float(hover_slopes(body)[0, 0]) == pytest.approx(-0.5)


def test_what_contradicts_is_refused() -> None:
    with pytest.raises(UsageError, match="contradict each other in X_u"):
        joined_vehicle([flight(), hover(X_u=-2.0)])
    own = joined_vehicle([flight()]).numbers["X_u"].value
    assert joined_vehicle([flight(), hover(X_u=1.02 * own)]).numbers["X_u"].value == pytest.approx(own, rel=0.01)


def test_a_disc_of_the_usual_size_is_none_that_was_given() -> None:
    assert joined_vehicle([flight(disc_assumed=True)]).numbers["disc_area"].source == "default"
    assert joined_vehicle([flight()]).numbers["disc_area"].source == "given"


def test_inertia_of_a_flat_vehicle_is_none_that_was_given() -> None:
    numbers = joined_vehicle([flight(known=("m",))]).numbers
    assert (numbers["I_zz"].source, numbers["I_zz"].value) == ("default", pytest.approx(OF_OUTPUTS["I_zz"]))
    assert numbers["I_zz"].std
    assert joined_vehicle([flight()]).numbers["I_zz"].source == "given"
    # By the kilogram it is as much more as the mass.
    scaled = joined_vehicle([flight(known=())], given={"m": OF_OUTPUTS["m"]}).numbers
    assert scaled["I_zz"].value == pytest.approx(OF_OUTPUTS["I_zz"])
    assert scaled["kappa"].value == pytest.approx(numbers["kappa"].value)


def test_nothing_is_known_of_the_air_without_it() -> None:
    joined = joined_vehicle([motors()], given={"I_zz": 0.04})
    body = require(joined, target="test")
    assert body.rotors.flow is None
    assert (body.rotors.induced_drag_n_s_m, body.rotors.inflow_n_s_m, body.vertical_drag_n_s2_m2) == (0.0, 0.0, 0.0)
    assert not {"k_d", "c_lambda", "X_u"} & set(joined.numbers)


def test_simulations_say_when_they_leave_the_range() -> None:
    own = own_vehicle([flight()], like=aircraft("x500"), given={})
    tested = own.tested
    assert tested is not None
    assert tested.load == LIMITS.load
    assert own.aircraft.sensors.accelerometer_place_m == (0.02, -0.01, 0.03)
    flown = fly_multirotor(own.aircraft, duration_s=4.0)
    assert beyond_tested("calm", flown, tested, own.aircraft.vehicle.rotors) == []
    fast = fly_multirotor(own.aircraft, duration_s=4.0, speed_m_s=(12.0, 12.0))
    (found,) = beyond_tested("fast", fast, tested, own.aircraft.vehicle.rotors)
    assert found.kind == "beyond_range"
    assert found.numbers["airspeed"] > 50.0
    assert beyond_tested("fast", fast, None, own.aircraft.vehicle.rotors) == []


def test_the_range_of_speeds_is_one_of_outputs() -> None:
    model = flight(OF_SPEEDS, outputs="speed")
    assert model.flight is not None
    limits = replace(model.flight.limits, motors=(300.0, 700.0))
    fast = replace(model, flight=replace(model.flight, limits=limits))
    own = own_vehicle([fast], like=aircraft("px4_quad"), given={"speed_max": FULL_RAD_S})
    assert own.tested is not None
    assert own.tested.speed == pytest.approx((300.0 / FULL_RAD_S, 700.0 / FULL_RAD_S))
