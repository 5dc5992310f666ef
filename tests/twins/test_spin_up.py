"""Yaw of vehicles with heavy rotors, and with light ones: models know the reaction to their spin-up."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from tests.twins.coverage_flights import flown_truth
from tests.twins.motor_twins import Twin, twin
from tests.twins.twin_flights import BAND, HUMMINGBIRD_YAW, flown, plan
from tests.unit.identifying.motor_logs import ARM_M, with_speeds

import rotorid
from rotorid.data.record import FlightRecord, MotorRecord
from rotorid.errors import InsufficientDataError
from rotorid.fits.motors import fit
from rotorid.fitting.motors.excitation import excitations
from rotorid.fitting.motors.fit import MotorFit, fit_motors
from rotorid.fitting.motors.problem import MotorProblem
from rotorid.fitting.motors.speed import measured_speed, motor_speed
from rotorid.identifying.identification import identify_motors
from rotorid.models.library import library_model
from rotorid.models.motors import motor_parameters
from rotorid.settings.motors import MotorSettings
from rotorid.vehicles import aircraft, hummingbird
from rotorid.vehicles.motor_flight import TRUTH, flights, levers


def swept(share: float) -> FlightRecord:
    """The Hummingbird's yaw in gusts, with this share of its reaction to the spin-up of its rotors."""
    system = library_model("axis.yaw").matrices({**hummingbird.YAW, "N_spin": share * hummingbird.YAW["N_spin"]})
    loop = replace(HUMMINGBIRD_YAW, system=system)
    rng = np.random.default_rng(1)
    return flown(loop, plan({"yaw": 10.0}, rng, (BAND[0], 70.0)), rng)


@pytest.mark.parametrize("share", [0.2, 0.5, 1.0])
def test_spin_up_comes_back(share: float) -> None:
    """Without it N_yaw takes the place of N_spin, and comes out several times too large."""
    truth = {**hummingbird.YAW, "N_spin": share * hummingbird.YAW["N_spin"]}
    found = rotorid.identify(swept(share), "rate.yaw")
    for name in ("N_yaw", "N_spin", "T_motor", "tau_yaw"):
        one = found[name]
        assert one.std is not None
        assert abs(one.value - truth[name]) < 2.5 * one.std, name
        assert one.std < 0.15 * one.value, name


@pytest.mark.parametrize("share", [0.0, -0.1])
def test_what_is_no_lead_gets_none(share: float) -> None:
    """Rotors turn a vehicle to one side by drag and by spin-up: what leads to the other side is something else."""
    found = rotorid.identify(swept(share), "rate.yaw")
    assert found["N_spin"].status == "dropped"
    assert [one for one in found.findings if (one.kind, one.where) == ("dropped_parameter", "N_spin")]


def test_a_lead_that_no_rotor_has_is_none(tmp_path: Path) -> None:
    """What turns the S500 beside its motors looks like rotors that react for seven seconds."""
    record = twin("s500", "calm", 1, tmp_path).record
    with pytest.raises(InsufficientDataError, match="longer than any rotor reacts"):
        rotorid.identify(record, "axis.yaw")
    found = rotorid.identify(record, "rate.yaw")
    assert found["N_spin"].status == "dropped"
    assert found["N_yaw"].std is not None
    assert abs(found["N_yaw"].value - flown_truth("s500", record)["N_yaw"]) < 2.0 * found["N_yaw"].std


MOMENTUM = 1.5
"""Of a rotor at full output over the inertia of yaw, rad/s: its spin-up is the torque beyond some 3 rad/s."""


@pytest.fixture(scope="module")
def light() -> MotorRecord:
    return flights(1, seed=21)[0]


def heavier(record: MotorRecord, momentum: float) -> MotorRecord:
    """The same motors and gusts, with rotors of which the vehicle takes up what they gain of their speed."""
    step_s = 1.0 / record.sample_rate_hz
    motors = motor_speed(record.outputs, lag_s=TRUTH["T_motor"], delay_s=TRUTH["tau_gyro"], step_s=step_s)
    gained = np.diff(levers()[2] @ np.asarray(motors.level), prepend=0.0)
    gained[0] = 0.0
    rates = record.rates.copy()
    rates[2] += momentum * lfilter([1.0], [1.0, -np.exp(TRUTH["N_r"] * step_s)], gained)
    return replace(record, rates=rates)


def motor_fit(record: MotorRecord, *, spin_up: bool = True) -> MotorFit:
    parameters = motor_parameters(known={"m": TRUTH["m"]}, spin_up=spin_up)
    return fit_motors(MotorProblem(records=(record,), levers=levers(), parameters=parameters))


def test_motors_know_the_momentum_of_their_rotors(light: MotorRecord) -> None:
    found = motor_fit(heavier(light, MOMENTUM)).parameters.values
    assert found["h_per_I_zz"] == pytest.approx(MOMENTUM, rel=0.02)
    assert found["kappa_per_I_zz"] == pytest.approx(TRUTH["kappa_per_I_zz"], rel=0.1)
    assert found["T_motor"] == pytest.approx(TRUTH["T_motor"], rel=0.05)


def test_slopes_of_yaw_with_spin_up_are_exact(light: MotorRecord) -> None:
    short = replace(
        light,
        outputs=light.outputs[:, :2000],
        rates=light.rates[:, :2000],
        az=light.az[:2000],
        w=light.w[:2000],
        strength=np.linspace(1.0, 0.8, 2000),
    )
    parameters = motor_parameters(known={"m": TRUTH["m"]}, spin_up=True, yaw_delay=True).with_values(
        {"h_per_I_zz": 0.7, "tau_gyro": 0.004, "tau_gyro_yaw": 0.0105, "T_motor": 0.04, "N_r": -0.6}
    )
    problem = MotorProblem(records=(short,), levers=levers(), parameters=parameters)
    theta = problem.parameters.pack()
    _, jacobian = problem.residuals(theta)
    for name in ("h_per_I_zz", "kappa_per_I_zz", "N_r", "T_motor", "tau_gyro", "tau_gyro_yaw", "c_2"):
        place = problem.parameters.free.index(name)
        ends = []
        for sign in (-1.0, 1.0):
            moved = theta.copy()
            moved[place] += sign * 1e-6
            ends.append(problem.residuals(moved)[0])
        slope = (ends[1] - ends[0]) / 2e-6
        np.testing.assert_allclose(jacobian[:, place], slope, atol=1e-6 * np.max(np.abs(slope)), err_msg=name)


@pytest.mark.parametrize("delay_s", [0.0004, 0.0041])
def test_slopes_of_measured_speeds_are_exact(light: MotorRecord, delay_s: float) -> None:
    """Within a sample, and over more than one."""
    short = replace(
        light,
        outputs=light.outputs[:, :2000],
        rates=light.rates[:, :2000],
        az=light.az[:2000],
        w=light.w[:2000],
        strength=np.ones(2000),
        between="lines",
    )
    parameters = motor_parameters(known={"m": TRUTH["m"]}, spin_up=True, lag=False).with_values(
        {"h_per_I_zz": 0.7, "tau_gyro": delay_s, "N_r": -0.6}
    )
    problem = MotorProblem(records=(short,), levers=levers(), parameters=parameters)
    theta = problem.parameters.pack()
    _, jacobian = problem.residuals(theta)
    for name in ("h_per_I_zz", "kappa_per_I_zz", "tau_gyro", "c_2"):
        place = problem.parameters.free.index(name)
        moved = [theta.copy() for _ in range(2)]
        moved[0][place] -= 1e-6
        moved[1][place] += 1e-6
        slope = (problem.residuals(moved[1])[0] - problem.residuals(moved[0])[0]) / 2e-6
        np.testing.assert_allclose(jacobian[:, place], slope, atol=1e-6 * np.max(np.abs(slope)), err_msg=name)


def test_speeds_between_samples_are_integrated_as_lines() -> None:
    """A delayed ramp, and its integrals, as a fine grid has them."""
    step_s, delay_s = 0.01, 0.023
    speeds = np.array([[100.0, 130.0, 90.0, 120.0, 150.0, 110.0, 100.0, 90.0]])
    time_s = step_s * np.arange(8)
    found = measured_speed(speeds, delay_s=delay_s, step_s=step_s)
    fine_s = np.linspace(0.0, time_s[-1], 70001)
    late = np.interp(fine_s - delay_s, time_s, speeds[0])
    np.testing.assert_allclose(found.level[0], np.interp(time_s - delay_s, time_s, speeds[0]), rtol=1e-12)
    for power, integrals in ((1, found.first), (2, found.second)):
        whole = np.array([np.trapezoid(late[10000 * k : 10000 * (k + 1) + 1] ** power, dx=1e-6) for k in range(7)])
        np.testing.assert_allclose(integrals[0], whole, rtol=1e-6)


def test_speeding_up_counts_as_excitation_and_slowing_down_what_turns_does_not(light: MotorRecord) -> None:
    """Yaw that hardly follows torque is seen by its spin-up; a controller is what turns the other way."""
    heavy = heavier(light, 4.0)
    by_torque, by_both = (excitations([heavy], levers(), spin_up=spin)[0]["r"] for spin in (False, True))
    assert by_torque.correlation < 0.8 < by_both.correlation
    opposite = heavier(light, -4.0)
    assert excitations([opposite], levers(), spin_up=True)[0]["r"].correlation < 0.8


@pytest.fixture(scope="module")
def heavy_flight(tmp_path_factory: pytest.TempPathFactory) -> Twin:
    return twin("hummingbird", "calm", 1, tmp_path_factory.mktemp("heavy"), sweep_s=15.0)


@pytest.fixture(scope="module")
def flown_heavy(heavy_flight: Twin) -> tuple[rotorid.IdentifiedModel, dict[str, float]]:
    return identify_motors(heavy_flight.record, heavy_flight.choices), dict(heavy_flight.truth)


@pytest.mark.slow
def test_motors_of_a_flight_with_heavy_rotors(
    flown_heavy: tuple[rotorid.IdentifiedModel, dict[str, float]],
) -> None:
    """Without the spin-up nothing could be said of yaw; its delay is the published one, another than that of roll."""
    found, truth = flown_heavy
    for name, share in (("h_per_I_zz", 0.02), ("kappa_per_I_zz", 0.06), ("N_r", 0.06), ("T_motor", 0.04)):
        one = found[name]
        assert one.std is not None
        assert abs(one.value - truth[name]) < 2.5 * one.std, name
        assert one.std < share * abs(one.value), name
    assert found["tau_gyro_yaw"].value == pytest.approx(truth["tau_gyro_yaw"], abs=5e-4)
    kinds = {finding.kind for finding in found.findings}
    assert {"spin_up", "delay_of_yaw"} <= kinds
    assert "no_excitation" not in kinds


@pytest.mark.slow
def test_the_linear_model_of_motors_leads_in_yaw(
    flown_heavy: tuple[rotorid.IdentifiedModel, dict[str, float]],
) -> None:
    """Beyond a few rad/s yaw is spin-up: h s / (T s + 1) over s of what a motor is asked for."""
    found, truth = flown_heavy
    omega = np.array([20.0])
    reply = found.response(omega)
    row, column = found.structure.outputs.index("r"), 0
    lagged = 1.0 / (1j * omega[0] * truth["T_motor"] + 1.0)
    by_spin_up = truth["h_per_I_zz"] * lagged
    assert abs(reply[row, column, 0]) == pytest.approx(abs(by_spin_up), rel=0.15)
    # The delay of yaw alone is in it: 12.6 ms, and the torque trails the spin-up by a quarter of a turn.
    torque = -1j * truth["kappa_per_I_zz"] * truth["thrust_slope"] * lagged / omega[0]
    late = np.exp(-1j * omega[0] * truth["tau_gyro_yaw"])
    spin = np.sign((reply[row, column, 0] / by_spin_up).real)
    assert reply[row, column, 0] == pytest.approx(spin * (by_spin_up + torque) * late, rel=0.06)


@pytest.fixture(scope="module")
def of_speeds(tmp_path_factory: pytest.TempPathFactory) -> rotorid.IdentifiedModel:
    """Of a flight whose log has speeds of rotors that weigh something."""
    log = with_speeds(tmp_path_factory.mktemp("speeds") / "speeds.csv", momentum=SHARE)
    return identify_motors([rotorid.read(log)], MotorSettings(known={"m": TRUTH["m"]}, layout="quad.x", arm_m=ARM_M))


SHARE = 0.003
"""Inertia of a rotor over that of yaw."""


def test_speeds_show_what_yaw_takes_up_of_them(of_speeds: rotorid.IdentifiedModel) -> None:
    """Without a lag of the motors, which measured speeds have not; a number of what is gained of them."""
    for name, truth, share in (
        ("h_per_I_zz", SHARE, 0.01),
        # Beyond 2 rad/s the spin-up hides torque, and below it damping trades with it.
        ("kappa_per_I_zz", TRUTH["kappa_per_I_zz"], 0.3),
        ("N_r", TRUTH["N_r"], 0.6),
    ):
        one = of_speeds[name]
        assert one.std is not None
        assert abs(one.value - truth) < 2.5 * one.std, name
        assert one.std < share * abs(one.value), name
    assert of_speeds.parameters["h_per_I_zz"].unit == "1"
    assert "T_motor" not in of_speeds.parameters
    (told,) = (one for one in of_speeds.findings if one.kind == "spin_up")
    assert "of the speed gained by one" in told.message
    assert told.numbers["share"] == pytest.approx(SHARE, rel=0.1)


def test_the_linear_model_of_speeds_has_them_in_yaw_at_once(of_speeds: rotorid.IdentifiedModel) -> None:
    omega = np.array([30.0])
    reply = of_speeds.response(omega)
    row = of_speeds.structure.outputs.index("r")
    slope = 2.0 * of_speeds["c_2"].value * of_speeds.motors.hover_output  # type: ignore[union-attr]
    spin = levers()[2][0]
    torque = TRUTH["kappa_per_I_zz"] * slope / (1j * omega[0] - TRUTH["N_r"])
    late = np.exp(-1j * omega[0] * of_speeds["tau_gyro"].value)
    assert reply[row, 0, 0] == pytest.approx(spin * (SHARE + torque) * late, rel=0.05)


@pytest.mark.slow
def test_a_momentum_that_could_be_none_is_none(heavy_flight: Twin, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing else explains this yaw: it is left out, and the rest is as without it."""
    monkeypatch.setattr(fit, "_CERTAIN", 1e4)
    found = identify_motors(heavy_flight.record, heavy_flight.choices)
    assert not {"h_per_I_zz", "kappa_per_I_zz", "N_r", "tau_gyro_yaw"} & set(found.parameters)
    assert [one.where for one in found.findings if one.kind == "no_excitation"] == ["yaw"]
    assert found["I_xx"].value == pytest.approx(heavy_flight.truth["I_xx"], rel=0.02)


@pytest.mark.slow
def test_a_momentum_may_be_known(heavy_flight: Twin) -> None:
    """Held at zero it is no spin-up, so that torque has to explain yaw, and does not."""
    choices = replace(heavy_flight.choices, known={**heavy_flight.choices.known, "h_per_I_zz": 0.0})
    found = identify_motors(heavy_flight.record, choices)
    assert "kappa_per_I_zz" not in found.parameters
    assert "no_excitation" in {one.kind for one in found.findings}
    choices = replace(choices, known={**choices.known, "h_per_I_zz": heavy_flight.truth["h_per_I_zz"]})
    found = identify_motors(heavy_flight.record, choices)
    assert found["h_per_I_zz"].status == "fixed"
    assert found["kappa_per_I_zz"].value == pytest.approx(heavy_flight.truth["kappa_per_I_zz"], rel=0.05)
    assert found["I_xx"].value == pytest.approx(heavy_flight.truth["I_xx"], rel=0.02)


@pytest.mark.slow
def test_light_rotors_have_no_momentum(tmp_path: Path) -> None:
    flight = twin("s500", "calm", 1, tmp_path)
    found = identify_motors(flight.record, flight.choices)
    assert "h_per_I_zz" not in found.parameters
    assert "tau_gyro_yaw" not in found.parameters
    assert aircraft("s500").vehicle.rotors.inertia_kg_m2 == 0.0
