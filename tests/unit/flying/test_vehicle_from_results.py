"""Several results as one vehicle: what each knows, what is asked for, what contradicts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from rotorid.documents.base import ProvenanceDocument
from rotorid.documents.result import ResultDocument, identified_model
from rotorid.errors import UsageError
from rotorid.flying.vehicle_from_results import joined_vehicle, require
from rotorid.flying.vehicle_numbers import VehicleNumber
from rotorid.models.rotors import library_layout
from rotorid.results.model import IdentifiedModel
from rotorid.results.summary import Correlation, MotorPhysics, ParameterEstimate
from rotorid.units import STANDARD_GRAVITY_M_S2

TRUTH = {
    "m": 1.5,
    "c_0": 0.1,
    "c_1": 4.0,
    "c_2": 6.0,
    "I_xx": 0.02,
    "I_yy": 0.022,
    "kappa_per_I_zz": 0.5,
    "T_motor": 0.03,
    "tau_gyro": 0.004,
    "L_p": -0.8,
    "M_q": -0.7,
    "N_r": -0.3,
    "Z_w": -0.4,
}
UNITS = {
    "m": "kg",
    "I_xx": "kg m^2",
    "I_yy": "kg m^2",
    "kappa_per_I_zz": "1/(kg m)",
    "T_motor": "s",
    "tau_gyro": "s",
    "h_per_I_zz": "rad/s",
}
ARM_M = 0.25


def result(
    name: str,
    values: Mapping[str, float],
    *,
    share: float = 0.01,
    fixed: Mapping[str, float] | None = None,
    units: Mapping[str, str] | None = None,
    motors: MotorPhysics | None = None,
    log: str = "one.ulg",
) -> IdentifiedModel:
    """A model as its ``result.json`` would hold it, every free value known to a share of itself."""
    parameters = {
        key: ParameterEstimate(value=value, unit=(units or {}).get(key, "1/s"), std=share * abs(value), status="free")
        for key, value in values.items()
    }
    free = tuple(parameters)
    parameters |= {
        key: ParameterEstimate(value=value, unit=(units or {}).get(key, "1/s"), status="fixed")
        for key, value in (fixed or {}).items()
    }
    document = ResultDocument(
        model=name,
        inputs=["motor_1"],
        outputs=["p"],
        states=["p"],
        parameters=parameters,
        correlation=Correlation(names=free, matrix=tuple(map(tuple, np.eye(len(free)).tolist()))),
        motors=motors,
        provenance=ProvenanceDocument(version="0", command=[], inputs={log: "0" * 64}, settings={}, seed=0),
    )
    return identified_model(document, None)


def physics(
    *, arm_m: float | None = ARM_M, scale: str | None = "m", outputs: str = "output", load_factor: float | None = None
) -> MotorPhysics:
    layout = library_layout("quad.x").scaled(arm_m or 1.0)
    return MotorPhysics(
        layout="quad.x",
        arm_m=arm_m,
        rotors=tuple(map(tuple, layout.positions.tolist())),
        spins=tuple(layout.spins.tolist()),
        outputs=outputs,
        source="outputs",
        outputs_rate_hz=250.0,
        curve="polynomial",
        hover_output=0.5233,
        flown_outputs=(0.2, 0.8),
        scale=scale,
        load_factor=load_factor,
    )


def motors(
    *, factor: float = 1.0, arm_m: float | None = ARM_M, scale: str | None = "m", log: str = "one.ulg", **values: float
) -> IdentifiedModel:
    """A result of motors of the true vehicle; ``factor`` is that of its scale."""
    held = {**TRUTH, **values}
    length = 1.0 if arm_m is not None else ARM_M
    scaled = dict.fromkeys(("m", "c_0", "c_1", "c_2"), factor) | dict.fromkeys(("I_xx", "I_yy"), factor / length)
    scaled["kappa_per_I_zz"] = 1.0 / factor
    held = {name: value * scaled.get(name, 1.0) for name, value in held.items()}
    mass = {"m": held.pop("m")}
    known = {name: held.pop(name) for name in ("kappa", "I_zz") if name in held}
    return result(
        "physical.motors", held, fixed=mass | known, units=UNITS, motors=physics(arm_m=arm_m, scale=scale), log=log
    )


def hover(share: float = 0.05, **values: float) -> IdentifiedModel:
    return result(
        "hover.longitudinal",
        values,
        share=share,
        units={"M_u": "rad/(s m)", "X_u": "1/s", "M_q": "1/s"},
        log="hover.ulg",
    )


@pytest.mark.parametrize(("load_factor", "remarked"), [(None, True), (1.0, True), (1.16, False)])
def test_the_mean_output_of_a_turn_is_not_that_of_hover(load_factor: float | None, remarked: bool) -> None:
    """2.8 kg hover above the mean output of 0.52, which says something of a hover, and nothing of a turn."""
    known = motors(m=2.8)
    assert known.motors is not None
    flown = replace(known.motors, load_factor=load_factor)
    vehicle = joined_vehicle([replace(known, motors=flown)], given={"I_zz": 0.04})
    assert ("implausible_physics" in {finding.kind for finding in vehicle.findings}) == remarked
    assert (vehicle.stated_hover_output == pytest.approx(vehicle.hover_output)) != remarked


def test_a_result_of_motors_is_a_body() -> None:
    vehicle = joined_vehicle([motors()], given={"I_zz": 0.04})
    body = require(vehicle, "T_motor", target="test")
    assert body.mass_kg == TRUTH["m"]
    np.testing.assert_allclose(body.inertia_kg_m2.diagonal(), [0.02, 0.022, 0.04])
    assert body.rotors.thrust == (0.1, 4.0, 6.0)
    assert body.rotors.torque_per_thrust_m == pytest.approx(0.02)
    assert body.rotors.lag_up_s == 0.03
    assert body.rotors.layout.arm == pytest.approx(ARM_M)
    assert body.aerodynamics is not None
    assert body.aerodynamics[3, 3] == pytest.approx(-0.8 * 0.02)
    assert body.aerodynamics[2, 2] == pytest.approx(-0.4 * 1.5)
    weight_n = TRUTH["m"] * STANDARD_GRAVITY_M_S2 / 4.0
    assert vehicle.hover_force_n == pytest.approx(weight_n)
    x = vehicle.hover_output
    assert 0.1 + 4.0 * x + 6.0 * x**2 == pytest.approx(weight_n)
    assert vehicle.hover_slope_n == pytest.approx(4.0 + 12.0 * x)
    sources = {name: one.source for name, one in vehicle.numbers.items()}
    assert (sources["m"], sources["I_xx"], sources["I_zz"], sources["kappa"]) == (
        "given",
        "identified",
        "given",
        "derived",
    )
    assert vehicle.numbers["delay"].value == TRUTH["tau_gyro"]


def test_the_momentum_of_rotors_follows_from_motors() -> None:
    vehicle = joined_vehicle([motors(h_per_I_zz=1.5)], given={"I_zz": 0.04, "speed_max": 800.0})
    rotors = require(vehicle, target="test").rotors
    assert vehicle.numbers["h"].value == pytest.approx(0.06)
    assert (rotors.full_speed_rad_s, rotors.inertia_kg_m2) == pytest.approx((800.0, 0.06 / 800.0))
    assert [finding.kind for finding in vehicle.findings if finding.where == "h"] == ["spin_up"]


def test_the_momentum_of_rotors_follows_from_yaw() -> None:
    """A command shows spin-up over torque, and the torque of a rotor makes a momentum of that."""
    yaw = result(
        "rate.yaw", {"N_yaw": 10.0, "N_spin": 2.0}, units={"N_yaw": "rad/s^2", "N_spin": "rad/s"}, log="yaw.ulg"
    )
    vehicle = joined_vehicle([motors(), yaw], given={"I_zz": 0.04})
    assert vehicle.numbers["h"].value == pytest.approx(0.2 * 0.02 * vehicle.hover_slope_n)
    rotors = require(vehicle, target="test").rotors
    assert rotors.inertia_kg_m2 * rotors.full_speed_rad_s == pytest.approx(vehicle.numbers["h"].value)


def test_the_momentum_of_another_vehicle_counts_where_nothing_is_known() -> None:
    usual = {"h": VehicleNumber(value=0.5, unit="kg m^2/s", source="default", of="another")}
    unknown = joined_vehicle([motors()], given={"I_zz": 0.04}, usual=usual)
    known = joined_vehicle([motors(h_per_I_zz=1.5)], given={"I_zz": 0.04}, usual=usual)
    assert (unknown.numbers["h"].value, known.numbers["h"].value) == pytest.approx((0.5, 0.06))


def test_light_rotors_have_no_momentum() -> None:
    rotors = require(joined_vehicle([motors()], given={"I_zz": 0.04}), target="test").rotors
    assert (rotors.full_speed_rad_s, rotors.inertia_kg_m2) == (0.0, 0.0)


@pytest.mark.parametrize("scale", [None, "m"])
def test_a_given_mass_scales_thrust_and_inertia(scale: str | None) -> None:
    """Per kilogram, or with the mass that was wrong."""
    vehicle = joined_vehicle([motors(factor=1.0 / 1.5, scale=scale)], given={"m": 1.5, "kappa": 0.02})
    body = require(vehicle, target="test")
    np.testing.assert_allclose(body.inertia_kg_m2.diagonal(), [0.02, 0.022, 0.04])
    np.testing.assert_allclose(body.rotors.thrust, (0.1, 4.0, 6.0))


def test_another_known_number_scales_as_well() -> None:
    vehicle = joined_vehicle([motors(factor=1.0 / 1.5, scale=None)], given={"I_xx": 0.02, "kappa": 0.02})
    assert require(vehicle, target="test").mass_kg == pytest.approx(1.5)


def test_a_given_arm_scales_inertia_in_roll_and_pitch() -> None:
    vehicle = joined_vehicle([motors(arm_m=None)], given={"arm": ARM_M, "kappa": 0.02})
    np.testing.assert_allclose(require(vehicle, target="test").inertia_kg_m2.diagonal(), [0.02, 0.022, 0.04])


def test_speeds_become_shares_of_the_largest() -> None:
    model = result(
        "physical.motors",
        {"c_2": 6e-6, "I_xx": 0.02, "I_yy": 0.022, "kappa_per_I_zz": 0.5},
        fixed={"m": 1.5},
        units=UNITS,
        motors=MotorPhysics(**{**_fields(physics(outputs="speed")), "curve": "quadratic"}),
    )
    vehicle = joined_vehicle([model], given={"kappa": 0.02, "speed_max": 1000.0})
    assert require(vehicle, target="test").rotors.thrust == pytest.approx((0.0, 0.0, 6.0))


def test_what_yaw_takes_up_of_speeds_becomes_a_momentum_at_the_largest() -> None:
    model = result(
        "physical.motors",
        {"c_2": 6e-6, "I_xx": 0.02, "I_yy": 0.022, "kappa_per_I_zz": 0.5, "h_per_I_zz": 0.003},
        fixed={"m": 1.5},
        units={**UNITS, "h_per_I_zz": "1"},
        motors=MotorPhysics(**{**_fields(physics(outputs="speed")), "curve": "quadratic"}),
    )
    given = {"I_zz": 0.04, "speed_max": 1000.0}
    vehicle = joined_vehicle([model], given=given)
    rotors = require(vehicle, target="test").rotors
    # A share of the inertia of yaw, whatever the speed.
    assert rotors.inertia_kg_m2 == pytest.approx(0.003 * 0.04)
    assert vehicle.numbers["h"].value == pytest.approx(0.003 * 0.04 * 1000.0)
    unknown = joined_vehicle([model], given={"I_zz": 0.04})
    assert "h" not in unknown.numbers


def _fields(value: object) -> dict[str, object]:
    return {name: getattr(value, name) for name in type(value).__dataclass_fields__}  # type: ignore[attr-defined]


def test_what_is_missing_is_asked_for_at_once() -> None:
    with pytest.raises(
        UsageError, match=r"needs m \(kg\), .* arm \(m, .*--set m=KG --set kappa=M --set arm=M\.$"
    ) as error:
        require(joined_vehicle([motors(scale=None, arm_m=None)]), target="px4-sih")
    assert all(f"--set {name}=" in str(error.value) for name in ("m", "kappa", "arm"))
    assert "I_xx" not in str(error.value).split(";")[0]


def test_an_unknown_torque_constant_is_bound_by_physics() -> None:
    vehicle = joined_vehicle([motors()])
    assert vehicle.multirotor is None
    with pytest.raises(
        UsageError, match=r"I_zz \(kg m\^2\), kappa .*at most 0\.042 kg.*at most 0\.021 m.*--set kappa=M"
    ):
        require(vehicle, target="px4-sih")
    with pytest.raises(UsageError, match="no rigid body has that"):
        joined_vehicle([motors()], given={"kappa": 0.05})


def test_results_of_motors_and_of_hover_join() -> None:
    vehicle = joined_vehicle([motors(), hover(X_u=-0.2, M_u=3.0)], given={"kappa": 0.02})
    body = require(vehicle, "X_u", "M_u", target="test")
    assert body.aerodynamics is not None
    assert body.aerodynamics[0, 0] == pytest.approx(-0.3)
    assert body.aerodynamics[4, 0] == pytest.approx(3.0 * 0.022)
    assert vehicle.numbers["X_u"].of == "hover.longitudinal of hover.ulg"


def test_two_values_are_weighted_by_their_variances() -> None:
    vehicle = joined_vehicle([motors(), motors(I_xx=0.0204, log="two.ulg")], given={"kappa": 0.02})
    inertia = vehicle.numbers["I_xx"]
    weights = np.array([1.0 / 0.0002**2, 1.0 / 0.000204**2])
    assert inertia.value == pytest.approx(float(weights @ [0.02, 0.0204] / weights.sum()))
    assert inertia.std == pytest.approx(float(weights.sum() ** -0.5))
    assert "one.ulg" in inertia.of
    assert "two.ulg" in inertia.of
    alike = joined_vehicle([motors(), motors(log="two.ulg")])
    assert alike.numbers["c_1"].value == pytest.approx(4.0)
    assert alike.numbers["c_1"].std == pytest.approx(0.04 / 2.0**0.5)


def test_a_contradiction_names_both_and_is_decided_by_hand() -> None:
    pair = [motors(), hover(share=0.01, M_q=-2.0)]
    with pytest.raises(UsageError, match=r"one\.ulg and .*hover\.ulg contradict each other in M_q.*--set M_q="):
        joined_vehicle(pair)
    assert joined_vehicle(pair, given={"M_q": -1.0}).numbers["M_q"].value == -1.0


def test_rates_fill_in_what_motors_do_not_hold() -> None:
    rate = result("rate.roll", {"L_p": -4.0, "T_motor": 0.05}, units={"T_motor": "s"}, log="rate.ulg")
    assert joined_vehicle([motors(), rate]).numbers["L_p"].value == TRUTH["L_p"]
    alone = joined_vehicle([rate]).numbers
    assert (alone["L_p"].value, alone["T_motor"].value) == (-4.0, 0.05)


def test_lags_from_measured_speeds_are_those_of_the_rotors() -> None:
    lags = {"T_motor_up": 0.02, "T_motor_down": 0.044}
    speeds = result("motor.speed", lags, units=dict.fromkeys(lags, "s"), log="bench.bbl")
    vehicle = joined_vehicle([motors(), speeds], given={"kappa": 0.016})
    assert vehicle.numbers["T_motor"].value == pytest.approx(0.032)
    assert vehicle.multirotor is not None
    assert (vehicle.multirotor.rotors.lag_up_s, vehicle.multirotor.rotors.lag_down_s) == (0.02, 0.044)
    by_hand = joined_vehicle([motors(), speeds], given={"kappa": 0.016, "T_motor": 0.05})
    assert by_hand.numbers["T_motor"].value == 0.05
    assert "T_motor_up" not in by_hand.numbers


def test_other_numbers_fill_in_what_is_missing() -> None:
    usual = {
        "kappa": VehicleNumber(value=0.02, unit="m", source="default", of="px4_quad"),
        "X_u": VehicleNumber(value=-1.0, unit="1/s", source="default", of="px4_quad"),
        "m": VehicleNumber(value=9.0, unit="kg", source="default", of="px4_quad"),
        "I_zz": VehicleNumber(value=9.0, unit="kg m^2", source="default", of="px4_quad"),
    }
    vehicle = joined_vehicle([motors()], usual=usual)
    assert {name for name, one in vehicle.numbers.items() if one.source == "default"} == {"kappa", "X_u", "I_zz"}
    assert require(vehicle, target="test").inertia_kg_m2[2, 2] == pytest.approx(0.04)
    known = joined_vehicle([motors()], usual=usual, given={"I_zz": 0.036}).numbers
    assert (known["kappa"].value, known["kappa"].source) == (pytest.approx(0.018), "derived")


def test_mass_and_arm_of_another_vehicle_scale_what_is_relative() -> None:
    usual = {
        "m": VehicleNumber(value=1.5, unit="kg", source="default", of="px4_quad"),
        "arm": VehicleNumber(value=ARM_M, unit="m", source="default", of="px4_quad"),
        "kappa": VehicleNumber(value=0.02, unit="m", source="default", of="px4_quad"),
    }
    vehicle = joined_vehicle([motors(factor=1.0 / 1.5, scale=None, arm_m=None)], usual=usual)
    np.testing.assert_allclose(require(vehicle, target="test").inertia_kg_m2.diagonal(), [0.02, 0.022, 0.04])
    assert {vehicle.numbers[name].source for name in ("m", "arm", "kappa")} == {"default"}


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"mass": 1.0}, r"no number of a vehicle 'mass'"),
        ({"I_xz_": 1.0}, r"did you mean I_xz"),
        ({"m": -1.0}, r"m = -1 kg is out of range; expected a positive number"),
        ({"T_motor": float("nan")}, r"T_motor = nan"),
    ],
)
def test_impossible_numbers_are_refused(given: dict[str, float], said: str) -> None:
    with pytest.raises(UsageError, match=said):
        joined_vehicle([motors()], given=given)


def test_rotors_turn_as_the_flight_shows() -> None:
    vehicle = joined_vehicle([motors(kappa_per_I_zz=-0.5)], given={"kappa": 0.02})
    body = require(vehicle, target="test")
    np.testing.assert_array_equal(body.rotors.layout.spins, -library_layout("quad.x").spins)
    assert [finding.kind for finding in vehicle.findings] == ["assumed_geometry"]


def test_a_hover_at_another_output_is_said() -> None:
    model = motors(c_1=5.0)
    (finding,) = joined_vehicle([model], given={"kappa": 0.02}).findings
    assert finding.where == "hover"
    assert finding.numbers["flown_output"] == 0.5233


def test_a_layout_of_other_rotors_than_those_that_flew_is_refused() -> None:
    with pytest.raises(UsageError, match=r"hexa\.x has 6 rotors, and physical\.motors"):
        joined_vehicle([motors()], given={"arm": 0.25}, layout=library_layout("hexa.x"))
