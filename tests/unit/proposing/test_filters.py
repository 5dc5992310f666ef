"""Filters as a choice, the curve of thrust, attitude figures, and which gains a log was flown with."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from tests.unit.tuning.gain_files import parsed

from rotorid.autopilots.registry import named
from rotorid.data.quantity import Quantity
from rotorid.data.record import FlightRecord, Source
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flights.filter_effects import ratio_at_slowest
from rotorid.models.autopilots import axis_controller
from rotorid.models.controller import RateController
from rotorid.proposing.axis import differing_gains
from rotorid.proposing.check import Foretold, _which
from rotorid.proposing.filters import changed_filters, numbered, prices, with_filters
from rotorid.proposing.proposal_files import proposal_files
from rotorid.proposing.thrust import ThrustLinearization, linearization
from rotorid.tuning import ControllerParts, Gains, attitude_figures, frequency_grid, quantities
from rotorid.tuning.files import parameter_files

PARAMETERS = {
    "MC_ROLLRATE_P": 0.15,
    "MC_ROLLRATE_I": 0.2,
    "MC_ROLLRATE_D": 0.003,
    "MC_ROLL_P": 6.5,
    "IMU_DGYRO_CUTOFF": 30.0,
    "IMU_GYRO_CUTOFF": 40.0,
    "IMU_GYRO_RATEMAX": 400.0,
}


def log(**changed: float) -> FlightRecord:
    source = Source(name="flight.ulg", format="PX4 ULog", sha256="", firmware="PX4 1.16.0")
    return FlightRecord(source=source, topics=(), parameters={**PARAMETERS, **changed})


def test_logs_of_different_gains_say_which_count() -> None:
    first, same, other = (
        log(),
        log(),
        replace(
            log(MC_ROLLRATE_P=0.22, MC_ROLL_P=7.0),
            source=Source(name="after.ulg", format="PX4 ULog", sha256="1", firmware="PX4 1.16.0"),
        ),
    )
    assert differing_gains(("roll", "pitch"), [first, same]) == []
    (told,) = differing_gains(("roll", "pitch"), [first, same, other])
    assert (told.kind, told.where) == ("gains_differ", "after.ulg")
    assert (
        "after.ulg was flown with other gains than flight.ulg: MC_ROLLRATE_P 0.22 instead of 0.15, "
        "MC_ROLL_P 7 instead of 6.5." in told.message
    )


def test_other_filters_are_parameters_of_the_log() -> None:
    found = with_filters(log(), {"IMU_DGYRO_CUTOFF": 60.0})
    assert found.parameters["IMU_DGYRO_CUTOFF"] == 60.0
    assert log().parameters["IMU_DGYRO_CUTOFF"] == 30.0


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("MC_ROLLRATE_P", 0.3, "no filter parameter"),
        ("IMU_DGYRO_CUTOF", 60.0, "no filter parameter"),
        ("IMU_DGYRO_CUTOFF", -1.0, "a finite number"),
        ("IMU_DGYRO_CUTOFF", float("nan"), "a finite number"),
    ],
)
def test_what_is_no_filter_is_refused(name: str, value: float, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        with_filters(log(), {name: value})


def blackbox(version: str, **header: float) -> FlightRecord:
    source = Source(name="flight.bbl", format="Betaflight blackbox", sha256="", firmware=f"Betaflight {version}")
    return FlightRecord(source=source, topics=(), parameters={"rollPID_P": 45.0, "looptime": 125.0, **header})


SETTINGS = [
    ("4.4.2", "dterm_lpf1_dyn_hz_0", "dterm_lpf1_dyn_min_hz"),
    ("4.4.2", "gyro_lpf1_static_hz", "gyro_lpf1_static_hz"),
    ("4.4.2", "gyro_notch_hz_0", "gyro_notch1_hz"),
    ("4.4.2", "gyro_notch_cutoff_1", "gyro_notch2_cutoff"),
    ("4.2.11", "dterm_lowpass_dyn_hz_1", "dyn_lpf_dterm_max_hz"),
    ("4.2.11", "dterm_lowpass2_hz", "dterm_lowpass2_hz"),
]


@pytest.mark.parametrize(("version", "header", "command_line"), SETTINGS)
def test_either_name_of_a_setting_is_taken_and_that_of_the_command_line_written(
    version: str, header: str, command_line: str
) -> None:
    record = blackbox(version, **{header: 100.0})
    for name in (header, command_line):
        assert with_filters(record, {name: 150.0}).parameters[header] == 150.0
        assert changed_filters(record, {name: 150.0}) == {command_line: (100.0, 150.0)}
    assert changed_filters(record, {header: 100.0}) == {}


@pytest.mark.parametrize(("version", "header"), [("4.4.2", "dterm_lpf1_type"), ("4.2.11", "dterm_filter_type")])
def test_a_type_is_a_word_of_its_version(version: str, header: str) -> None:
    record = blackbox(version, **{header: 0.0})
    assert with_filters(record, {header: 1.0}).parameters[header] == 1.0
    assert numbered(f"{header} = biquad") == f"{header}=1"
    with pytest.raises(UsageError, match="one of PT1, BIQUAD"):
        with_filters(record, {header: 4.0 if version == "4.4.2" else 2.0})


@pytest.mark.parametrize(("flown", "wanted"), [(0.0, 150.0), (150.0, 200.0), (150.0, 0.0)])
def test_a_low_pass_of_the_gyro_that_moves_is_refused(flown: float, wanted: float) -> None:
    """It would be written and not judged."""
    with pytest.raises(UsageError, match="fixed frequency"):
        with_filters(blackbox("4.4.2", gyro_lpf1_dyn_hz_0=flown), {"gyro_lpf1_dyn_min_hz": wanted})


@pytest.mark.parametrize("version", ["4.2.11", "4.4.2"])
def test_filters_of_a_controller_have_the_names_of_the_command_line(version: str) -> None:
    """And make the same controller again, from a result."""
    older = version < "4.3"
    header = (
        {"dterm_filter_type": 1.0, "dterm_lowpass_dyn_hz_0": 70.0, "dterm_lowpass_dyn_hz_1": 170.0}
        if older
        else {"dterm_lpf1_type": 1.0, "dterm_lpf1_dyn_hz_0": 70.0, "dterm_lpf1_dyn_hz_1": 170.0}
    )
    record = blackbox(version, **header, rollPID_D=30.0)
    found = axis_controller(record.parameters, "roll", firmware=record.source.firmware)
    assert found is not None
    named = {"dterm_lowpass_type", "dyn_lpf_dterm_min_hz", "dyn_lpf_dterm_max_hz"}
    assert set(found.filters) == (
        named if older else {"dterm_lpf1_type", "dterm_lpf1_dyn_min_hz", "dterm_lpf1_dyn_max_hz"}
    )
    again = axis_controller(
        {**found.gains, **found.filters, "looptime": 125.0}, "roll", firmware=record.source.firmware
    )
    assert again is not None
    assert again.controller == found.controller


def test_a_filter_costs_the_phase_that_it_has() -> None:
    """Of a loop that is P alone the price of a low-pass of the command is its own phase."""
    controller = RateController(proportional_s=0.2, command_cutoff_hz=10.0)
    omega = frequency_grid(controller)
    ones = np.ones(omega.size, dtype=np.complex128)
    parts = ControllerParts(controller=controller, omega_rad_s=omega, filters=ones, logged=ones)
    plant = np.asarray(100.0 / (1j * omega))
    axis = axis_controller(PARAMETERS, "roll")
    assert axis is not None
    (found,) = prices(None, replace(axis, controller=controller), parts, plant, Gains.of(controller))
    loop = np.abs(plant * parts.rate(Gains.of(controller)))
    crossover = omega[np.flatnonzero(loop > 1.0)[-1]]
    assert found.name == "command low-pass at 10 Hz"
    assert found.phase_deg == pytest.approx(np.degrees(np.arctan(crossover / (20.0 * np.pi))), abs=0.01)
    assert found.noise_ratio > 1.0


@pytest.mark.parametrize("autopilot", ["ArduPilot", "Betaflight", "PX4"])
def test_the_bend_is_the_derivative_of_the_demand(autopilot: str) -> None:
    straightens = named(autopilot).thrust_parameter
    assert straightens is not None
    kind = straightens()
    outputs, step = np.linspace(0.2, 0.8, 13)[None], 1e-5
    for value in (0.0, 0.4, 0.8):
        parameter = np.array([[value * kind.largest]])
        slope = (kind.demand(outputs + step, parameter) - kind.demand(outputs - step, parameter)) / (2.0 * step)
        assert kind.bend(outputs, parameter) == pytest.approx(slope, rel=1e-4)


def motors(c_1: float, c_2: float, *, std: float, outputs: str = "output") -> SimpleNamespace:
    """As much of an identified model as the curve of thrust takes."""
    physics = SimpleNamespace(
        outputs=outputs,
        straightening=None,
        flown_outputs=(0.3, 0.7),
        hover_output=0.5,
        curve_assumed=False,
        curve="polynomial",
        arm_m=0.25,
    )
    names = ("c_1", "c_2")
    covariance = std**2 * np.array([[0.25, -0.24], [-0.24, 0.25]])
    return SimpleNamespace(
        flight=None,
        motors=physics,
        parameters={"c_1": SimpleNamespace(value=c_1), "c_2": SimpleNamespace(value=c_2)},
        bounds=SimpleNamespace(names=names, covariance=covariance),
    )


@pytest.fixture(autouse=True)
def plain_bounds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rotorid.proposing.thrust.bounds_of", lambda bounds, names: bounds)


@pytest.mark.parametrize("expo", [0.3, 0.65, 1.0])
def test_the_curve_of_a_vehicle_is_its_own_parameter(expo: float) -> None:
    """Thrust (1 - e) x + e x² is straightened by e, and the gain in hover is what it then is."""
    found = linearization([motors(1.0 - expo, expo, std=0.01)], log(THR_MDL_FAC=0.0), autopilot="PX4")  # type: ignore[list-item]
    assert found is not None
    assert found.changed
    assert found.proposed == pytest.approx(expo, abs=0.011)
    assert found.best.lower <= expo + 0.005
    assert found.best.upper >= expo - 0.005
    assert found.proposed_range == pytest.approx((1.0, 1.0), abs=0.02)
    assert found.hover_gain == pytest.approx(1.0, abs=0.02)  # the slope of the demand at half of the range is one
    assert found.hover_demand == pytest.approx((1.0 - expo) * 0.5 + expo * 0.25, abs=0.01)


def test_a_curve_that_is_not_known_stays() -> None:
    found = linearization([motors(0.5, 0.5, std=3.0)], log(THR_MDL_FAC=0.2), autopilot="PX4")  # type: ignore[list-item]
    assert found is not None
    assert not found.changed
    assert [one.kind for one in found.findings] == ["thrust_stays"]
    assert found.proposed == 0.2


def test_betaflight_has_whole_percents() -> None:
    found = linearization([motors(0.4, 0.6, std=0.01)], None, autopilot="Betaflight")  # type: ignore[list-item]
    assert found is not None
    assert found.changed
    assert found.proposed == round(found.proposed)
    assert np.ptp(np.log(found.proposed_range)) < 0.5 * np.ptp(np.log(found.flown_range))


def test_without_motors_nothing_is_said() -> None:
    assert linearization([], log(), autopilot="PX4") is None


def test_attitude_figures_of_a_second_order() -> None:
    omega = np.geomspace(0.5, 400.0, 800)
    natural, damping, late = 10.0, 0.7, 0.02
    closed = natural**2 / (natural**2 - omega**2 + 2j * damping * natural * omega) * np.exp(-1j * late * omega)
    found = attitude_figures(omega, closed[None])

    def phase(w: float) -> float:
        return float(-np.arctan2(2.0 * damping * natural * w, natural**2 - w**2) - late * w)

    assert phase(float(found.bandwidth_rad_s[0])) == pytest.approx(-0.75 * np.pi, abs=1e-3)
    tried = np.linspace(5.0, 100.0, 20001)
    half = tried[np.argmin(np.abs(np.array([phase(w) for w in tried]) + np.pi))]
    assert found.phase_delay_s[0] == pytest.approx(-(phase(2.0 * half) + np.pi) / (2.0 * half), rel=1e-3)
    assert set(quantities(found)) == {"attitude_bandwidth_rad_s", "phase_delay_s"}


def test_gains_of_a_log_are_told_apart() -> None:
    told = {"crossover_rad_s": Quantity.normal(20.0, 1.0, "rad/s")}
    before = Foretold(flown={"P": 0.15, "K": 1.0}, proposed={"P": 0.28, "K": 1.0}, rate=told, whole=told)
    assert _which(before, {"P": float(np.float32(0.28)), "K": 1.0}) == "proposed"
    assert _which(before, {"P": float(np.float32(0.15)), "K": 1.0}) == "flown"
    assert _which(before, {"P": 0.2, "K": 1.0}) == "other"


def test_filters_turn_off_the_sliders_that_would_overwrite_them() -> None:
    files = parameter_files(
        "Betaflight", {"p_roll": 45.0, "dterm_lpf2_static_hz": 200.0}, role="proposed", firmware="Betaflight 4.5.1"
    )
    text = files["proposed.cli.txt"]
    assert "set simplified_dterm_filter = OFF" in text
    assert text.index("simplified_dterm_filter") < text.index("dterm_lpf2_static_hz")
    assert parsed(text) == {"p_roll": 45.0, "dterm_lpf2_static_hz": 200.0}


@pytest.mark.parametrize("version", ["Betaflight 3.5.7", "Betaflight 2027.6.0", "Betaflight", ""])
def test_settings_of_an_unknown_version_are_not_written(version: str) -> None:
    with pytest.raises(UsageError, match=r"expected Betaflight 4\.0 to 2025\.12"):
        parameter_files("Betaflight", {"p_roll": 45.0}, role="proposed", firmware=version)


def test_whole_numbers_have_their_own_type() -> None:
    text = parameter_files("PX4", {"IMU_GYRO_RATEMAX": 800.0, "MC_ROLLRATE_P": 0.2}, role="proposed")["proposed.params"]
    rows = {line.split("\t")[2]: line.split("\t")[3:] for line in text.splitlines() if not line.startswith("#")}
    assert rows["IMU_GYRO_RATEMAX"] == ["800", "6"]
    assert rows["MC_ROLLRATE_P"][1] == "9"
    assert parsed(text)["IMU_GYRO_RATEMAX"] == 800.0


@pytest.mark.parametrize(
    ("least", "others", "why"),
    [
        (0.18, ("RLL", "PIT"), ""),
        (0.11, ("RLL", "PIT"), "with 0.65, ATC_RAT_YAW_P = 0.088 is out of range"),
        (0.18, ("RLL",), "the gains of pitch would have to change too and are not known"),
    ],
    ids=["every axis", "a gain leaves its range", "an axis without gains"],
)
def test_a_curve_of_thrust_moves_every_axis_or_stays(least: float, others: tuple[str, ...], why: str) -> None:
    """Yaw alone was tuned; where the curve stays, the rest of the proposal stands."""
    yaw = {"ATC_RAT_YAW_P": least, "ATC_RAT_YAW_I": 0.1, "ATC_RAT_YAW_D": 0.0, "ATC_RAT_YAW_FF": 0.02}
    controller = axis_controller({**yaw, "ATC_ANG_YAW_P": 4.5}, "yaw", firmware="ArduCopter V4.6.0")
    assert controller is not None
    flown = SimpleNamespace(flown=SimpleNamespace(gains=Gains.of(controller.controller)))
    axes = {"yaw": SimpleNamespace(controller=controller, parameters={}, proposal=flown)}
    best = Quantity.normal(0.65, 0.01, "1")
    thrust = ThrustLinearization(
        parameter="MOT_THST_EXPO",
        flown=0.0,
        proposed=0.65,
        best=best,
        flown_range=(0.7, 1.3),
        proposed_range=(1.0, 1.0),
        hover_gain=1.25,
        hover_demand=0.2,
        flown_hover_demand=0.25,
    )
    source = Source(name="flight.BIN", format="ArduPilot DataFlash", sha256="", firmware="ArduCopter V4.6.0")
    parameters = {
        name.replace("YAW", axis): value for axis in others for name, value in (yaw | {"ATC_RAT_YAW_P": 0.135}).items()
    }
    record = FlightRecord(source=source, topics=(), parameters=parameters)
    found = proposal_files(axes, thrust, [], [record], {})  # type: ignore[arg-type]
    assert ("thrust.param" in found.proposed) == (not why)
    assert found.thrust is not None
    assert found.thrust.changed == (not why)
    assert [one.message for one in found.findings] == ([f"MOT_THST_EXPO is not changed: {why}."] if why else [])
    back = parsed(found.rollback["rollback.param"])
    assert back["ATC_RAT_YAW_P"] == pytest.approx(least)
    if not why:
        new = parsed(found.proposed["thrust.param"])
        assert new["ATC_RAT_YAW_FF"] == pytest.approx(0.8 * 0.02)
        assert [new[f"ATC_RAT_{axis}_P"] for axis in others] == pytest.approx([0.8 * 0.135, 0.8 * 0.135])
        assert [back[f"ATC_RAT_{axis}_P"] for axis in others] == pytest.approx([0.135, 0.135])
        assert (back["ATC_RAT_YAW_FF"], back["MOT_THST_EXPO"]) == (pytest.approx(0.02), 0.0)
    else:
        assert found.thrust.hover_demand == 0.25


def test_a_notch_that_follows_unknown_speeds_is_not_flown_as_if_it_were_none() -> None:
    """It lags too: without the speeds nobody knows how much."""
    flown = log(IMU_GYRO_DNF_EN=0.0)
    then = with_filters(flown, {"IMU_GYRO_DNF_EN": 1.0})
    with pytest.raises(InsufficientDataError):
        ratio_at_slowest(flown, then, np.array([30.0]))
    np.testing.assert_array_equal(ratio_at_slowest(flown, flown, np.array([30.0])), [1.0])


def test_a_notch_that_was_off_has_its_parameters_all_the_same() -> None:
    """ArduPilot hides them until it is on."""
    source = Source(name="flight.bin", format="ArduPilot DataFlash", sha256="", firmware="ArduCopter V4.6.2")
    record = FlightRecord(source=source, topics=(), parameters={"INS_HNTCH_ENABLE": 0.0, "INS_GYRO_FILTER": 40.0})
    wanted = {"INS_HNTCH_ENABLE": 1.0, "INS_HNTCH_FREQ": 90.0, "INS_HNTCH_MODE": 0.0}
    then = with_filters(record, wanted)
    assert then.parameters["INS_HNTCH_FREQ"] == 90.0
    assert then.parameters["INS_HNTCH_BW"] == 40.0
    assert changed_filters(record, wanted)["INS_HNTCH_FREQ"] == (80.0, 90.0)
    size = abs(ratio_at_slowest(record, then, 2.0 * np.pi * np.array([90.0]))[0])
    # The second harmonic takes a little more.
    assert size == pytest.approx(10.0 ** (-40.0 / 20.0), rel=0.1)
