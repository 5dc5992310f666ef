"""Moments of flights whose physics are known come back, and what was not flown is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.fitting.flight.made_up import FRAME, TRUTH, made_up_flight

from rotorid.data.record import MotorRecord
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.flight.fit import FlightChoices, fit_flight
from rotorid.fitting.flight.moment import MomentChoices, MomentFit, _gains, fit_moments, moment_error
from rotorid.fitting.flight.motion import motion
from rotorid.models.flight import FORCE_TERMS

FORCE = {name: value for name, value in TRUTH.items() if name in FORCE_TERMS}


@pytest.fixture(scope="module")
def flights() -> list[MotorRecord]:
    return [made_up_flight(seed, gusts_nm=0.003) for seed in (1, 2)]


@pytest.fixture(scope="module")
def fitted(flights: list[MotorRecord]) -> MomentFit:
    choices = MomentChoices(known={"I_zz": TRUTH["I_zz"]}, predictor=True)
    return fit_moments(flights, FRAME, [motion(record) for record in flights], FORCE, choices)


def test_inertia_and_hub_moment_come_back(fitted: MomentFit) -> None:
    for name in ("I_xx", "I_yy", "kappa", "m_f"):
        assert fitted.values[name] == pytest.approx(TRUTH[name], rel=0.05), name
    assert fitted.values["J_r"] == pytest.approx(TRUTH["J_r"], rel=0.35)
    assert abs(fitted.delay_s) < 0.002


def test_the_ladder_lets_in_what_was_flown_alone(fitted: MomentFit) -> None:
    assert fitted.entered == ("m_f",)
    assert fitted.ladder[0].entered
    assert fitted.ladder[0].after < 0.5 * fitted.ladder[0].before


def test_forward_flight_tilts_back_by_more() -> None:
    truth = {**TRUTH, "m_fx": 3e-6}
    flights = [made_up_flight(seed, gusts_nm=0.003, seconds=20.0, truth=truth) for seed in (1, 2)]
    choices = MomentChoices(known={"I_zz": TRUTH["I_zz"]}, terms=("m_f", "m_fx"))
    found = fit_moments(flights, FRAME, [motion(record) for record in flights], FORCE, choices)
    assert found.entered == ("m_f", "m_fx")
    assert found.values["m_f"] == pytest.approx(truth["m_f"], rel=0.05)
    assert found.values["m_fx"] == pytest.approx(truth["m_fx"], rel=0.1)


def test_drag_above_the_center_of_gravity_is_no_flapping() -> None:
    """Of a layout without heights: by speed, both tilt the vehicle back, and nothing else distinguishes them."""
    truth = {name: value for name, value in TRUTH.items() if name != "m_f"} | {"z_cg": 0.04}
    flights = [made_up_flight(seed, gusts_nm=0.003, seconds=20.0, truth=truth) for seed in (1, 2)]
    choices = MomentChoices(known={"I_zz": TRUTH["I_zz"]})
    found = fit_moments(flights, FRAME, [motion(record) for record in flights], FORCE, choices)
    assert found.entered == ("z_cg",)
    assert found.values["z_cg"] == pytest.approx(0.04, rel=0.05)
    assert [rung.terms for rung in found.ladder if rung.entered] == [("z_cg",)]


def test_flapping_and_drag_above_the_center_of_gravity_are_told_apart() -> None:
    truth = {**TRUTH, "z_cg": 0.03}
    flights = [made_up_flight(seed, gusts_nm=0.003, seconds=20.0, truth=truth) for seed in (1, 2)]
    choices = MomentChoices(known={"I_zz": TRUTH["I_zz"]})
    found = fit_moments(flights, FRAME, [motion(record) for record in flights], FORCE, choices)
    assert set(found.entered) == {"m_f", "z_cg"}
    assert found.values["z_cg"] == pytest.approx(0.03, rel=0.15)
    assert found.values["m_f"] == pytest.approx(truth["m_f"], rel=0.1)


def test_what_is_left_are_the_gusts(fitted: MomentFit) -> None:
    assert np.all(fitted.axes_nm < 0.0045)
    assert np.all(fitted.rms_nm < 1.6 * 0.003 * np.sqrt(3.0))


def test_an_unseen_flight_is_predicted(fitted: MomentFit) -> None:
    unseen = made_up_flight(7, gusts_nm=0.003)
    left = moment_error(FORCE | fitted.values, FRAME, unseen, motion(unseen), delay_s=fitted.delay_s)
    assert np.sqrt(np.mean(np.sum(left**2, axis=0))) < 0.008


def test_octaves_say_where_inertia_comes_from(fitted: MomentFit) -> None:
    assert {octave.axis for octave in fitted.octaves if octave.kept} == {"p", "q", "r"}
    assert all(octave.correlation > 0.8 for octave in fitted.octaves if octave.kept)


def test_the_predictor_is_kept_apart(fitted: MomentFit) -> None:
    assert {"gain_p", "gain_q", "gain_r"} <= fitted.predictor.keys()
    assert not {"I_xx", "I_yy", "I_zz"} & fitted.predictor.keys()


def test_known_inertia_is_held(flights: list[MotorRecord]) -> None:
    known = {"I_xx": 3.0e-3, "I_zz": TRUTH["I_zz"]}
    fit = fit_moments(flights[:1], FRAME, [motion(flights[0])], FORCE, MomentChoices(known=known))
    assert fit.values["I_xx"] == 3.0e-3
    assert "I_xx" not in fit.free
    assert "I_yy" in fit.free


def test_without_inertia_of_yaw_that_of_a_flat_vehicle_is_assumed(flights: list[MotorRecord]) -> None:
    fit = fit_moments(flights[:1], FRAME, [motion(flights[0])], FORCE)
    assert fit.assumed == ("I_zz",)
    assert fit.values["I_zz"] == pytest.approx(fit.values["I_xx"] + fit.values["I_yy"])
    assert fit.values["kappa"] / fit.values["I_zz"] == pytest.approx(TRUTH["kappa"] / TRUTH["I_zz"], rel=0.15)


def test_a_flight_that_shows_no_torque_has_no_inertia(flights: list[MotorRecord]) -> None:
    rng = np.random.default_rng(5)
    still = replace(flights[0], rates=0.1 * rng.normal(size=flights[0].rates.shape))
    fit = fit_moments([still], FRAME, [motion(still)], FORCE)
    assert not fit.values
    assert fit.missing.keys() >= {"I_xx", "I_yy", "kappa"}
    assert "0.8 over two neighboring octaves together is needed" in fit.missing["I_xx"]
    assert np.isnan(fit.axes_nm).all()


def test_slow_flight_has_no_hub_moment() -> None:
    slow = made_up_flight(3, speed=0.5)
    fit = fit_moments([slow], FRAME, [motion(slow)], FORCE, MomentChoices(known={"I_zz": TRUTH["I_zz"]}))
    assert "m_f" not in fit.values
    assert "slower than 2.9 m/s" in fit.missing["m_f"]


def test_yaw_is_as_late_as_roll_and_pitch(fitted: MomentFit) -> None:
    for alone in fitted.alone:
        tilting, yawing = alone.chains
        held = yawing.parameters["tau_gyro"]
        assert held.status == "fixed"
        assert held.value == tilting.parameters["tau_gyro"].value


def test_unknown_drag_of_the_hubs_is_no_yaw_damping() -> None:
    """It damps yaw by its share at the arms."""
    thrust = {name: value for name, value in FORCE.items() if name != "k_d"}
    flight = made_up_flight(1, gusts_nm=0.003, seconds=10.0, truth={**TRUTH, "k_d": 1e-9})
    choices = MomentChoices(known={"I_zz": TRUTH["I_zz"]}, terms=("k_r",))
    fit = fit_moments([flight], FRAME, [motion(flight)], thrust, choices)
    assert "k_r" not in fit.values
    assert fit.missing["k_r"] == "rotor drag is not known, whose moment looks alike"


def test_a_gain_of_some_blocks_is_none() -> None:
    before = np.ones((3, 5))
    assert _gains(before, before - 0.1, flights=1)
    lucky = before.copy()
    lucky[:, 0] -= 0.5
    assert not _gains(before, lucky, flights=1)
    assert _gains(before, lucky, flights=3)


def test_seconds_of_flight_and_motors_that_stand_still_are_no_data(flights: list[MotorRecord]) -> None:
    with pytest.raises(InsufficientDataError, match="last 5 s"):
        fit_flight([made_up_flight(1, seconds=5.0)], FRAME)
    with pytest.raises(InsufficientDataError, match="stand still"):
        fit_flight([replace(flights[0], outputs=np.zeros_like(flights[0].outputs))], FRAME)


def test_yaw_without_inertia_says_so(flights: list[MotorRecord]) -> None:
    """Motors explain yaw, but pitch is still: there is no inertia that follows from roll and pitch."""
    rates = flights[0].rates.copy()
    rates[1] = 0.1 * np.random.default_rng(5).normal(size=rates.shape[1])
    fit = fit_moments([replace(flights[0], rates=rates)], FRAME, [motion(flights[0])], FORCE)
    assert "kappa" not in fit.values
    assert fit.missing["kappa"] == "I_zz is not known"


def test_without_steady_airspeed_there_is_no_center_of_gravity() -> None:
    """The hub moment of an airspeed that stays looks like it."""
    truth = {name: value for name, value in TRUTH.items() if name != "m_f"} | {"x_cg": 0.004}
    flight = made_up_flight(1, gusts_nm=0.003, seconds=8.0, truth=truth)
    choices = MomentChoices(known={"I_zz": TRUTH["I_zz"]}, terms=("x_cg", "y_cg"))
    shown, hidden = (
        fit_moments([flight], FRAME, [motion(flight)], FORCE, replace(choices, airspeed=airspeed))
        for airspeed in (True, False)
    )
    assert "x_cg" in shown.entered
    assert hidden.entered == ()
    assert {"x_cg", "y_cg"} <= hidden.missing.keys()


def test_a_thrust_curve_that_is_known_in_part_is_refused() -> None:
    flight = made_up_flight(1, seconds=7.0)
    with pytest.raises(UsageError, match="only c_1 is known"):
        fit_flight([flight], FRAME, FlightChoices(values={"c_1": 1.0}))
