"""``physical.hover`` on a flight of the Hummingbird, whose forces are those of the model: physics within intervals."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from rotorid.data.flight_plan import SimulatedFlight
from rotorid.flying.designs import plan_for
from rotorid.flying.settings import PlanSettings
from rotorid.flying.simulation import simulate
from rotorid.identifying.identification import identify
from rotorid.io.registry import write_log
from rotorid.results.model import IdentifiedModel
from rotorid.vehicles import aircraft, hummingbird

STEPS = hummingbird.STEPS
TRUTH = {
    **hummingbird.PHYSICS,
    "k_n": STEPS * hummingbird.PHYSICS["k_n"],
    "J_r": hummingbird.YAW["N_spin"] * hummingbird.PHYSICS["I_zz"] / (8.0 * math.pi * hummingbird.PHYSICS["k_n"]),
}
AXES = ("roll", "pitch", "yaw", "thrust")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    craft = aircraft("hummingbird")
    choices = PlanSettings(
        shape="logarithmic_sweep", axes=AXES, amplitudes={"thrust": 0.06}, band_rad_s=(0.6, 50.0), duration_s=60.0
    )
    flight: SimulatedFlight = simulate(craft, plan_for(craft, choices).plan, seed=3)
    path = tmp_path_factory.mktemp("hummingbird") / "flight.csv"
    write_log(path, flight, format="csv")
    return path


def identified(log: Path, **known: float) -> IdentifiedModel:
    fix = {name: TRUTH[name] for name in ("m", "rho", "k_n")} | known
    return identify(
        log,
        "physical.hover",
        layout="quad.plus",
        arm_m=TRUTH["l"],
        rotor_diameter_m=TRUTH["D"],
        fix=fix,
        constants={"z_imu": hummingbird.PITCH["z_imu"]},
    )


@pytest.fixture(scope="module")
def model(log: Path) -> IdentifiedModel:
    return identified(log)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["I_xx", "I_yy", "I_zz", "c_T", "c_H", "c_P", "J_r", "z", "dc_T_dJ"])
def test_physics_of_the_hummingbird_lie_within_their_intervals(model: IdentifiedModel, name: str) -> None:
    one = model.parameters[name]
    assert one.lower is not None
    assert one.upper is not None
    assert one.lower <= TRUTH[name] <= one.upper


@pytest.mark.slow
def test_no_parameter_of_the_hummingbird_is_far_off(model: IdentifiedModel) -> None:
    for name in ("I_xx", "I_yy", "I_zz", "c_T", "c_H", "c_P", "J_r", "z", "dc_T_dJ"):
        one = model.parameters[name]
        assert one.std is not None
        assert abs(one.value - TRUTH[name]) <= min(4.0 * one.std, 0.15 * abs(TRUTH[name])), name


@pytest.mark.slow
def test_a_known_inertia_gives_the_rotors_with_their_own_errors(log: Path, model: IdentifiedModel) -> None:
    known = identified(log, I_zz=TRUTH["I_zz"])
    for name in ("c_P", "J_r"):
        one = known.parameters[name]
        before = model.parameters[name].std
        assert one.std is not None
        assert before is not None
        assert abs(one.value - TRUTH[name]) <= 3.0 * one.std, name
        assert one.std < before, name


@pytest.mark.slow
def test_yaw_alone_tells_the_motors_behind_it(log: Path) -> None:
    """Inertia of a motor, torque and power of a rotor out of ``axis.yaw``, and the numbers of the publication."""
    spread = {"I_zz": 0.03, "n_h": 0.01, "m": 0.004}
    model = identify(
        log,
        "axis.yaw",
        known={name: (TRUTH[name], share * TRUTH[name]) for name, share in spread.items()}
        | {name: (TRUTH[name], 0.0) for name in ("k_n", "rho", "D")}
        | {"k_omega_delta": (STEPS * 3.94, 0.0)},
    )
    assert model.derived is not None
    truth = {
        **TRUTH,
        "kappa": TRUTH["c_P"] * TRUTH["D"] / (2.0 * math.pi * TRUTH["c_T"]),
        "M_motor_omega": -42.21,
        "N_omega": -0.5541,
    }
    for name in ("J_r", "c_P", "kappa", "M_motor_omega", "N_omega"):
        one = model.derived.quantities[name]
        # What is known is exactly true here, so that the part of the flight alone is what errs.
        assert abs(one.value - truth[name]) <= 3.0 * one.std_identified, name
        assert one.std >= one.std_identified


@pytest.mark.slow
def test_thrust_over_the_advance_ratio_holds_the_truth(model: IdentifiedModel) -> None:
    assert model.derived is not None
    for one in model.derived.thrust:
        assert one.lower <= TRUTH["c_T"] + TRUTH["dc_T_dJ"] * one.advance_ratio <= one.upper
