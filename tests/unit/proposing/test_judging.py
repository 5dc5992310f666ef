"""Foreign gains on a vehicle whose plant is known: judged with their filters, or refused by name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rotorid.data.record import FlightRecord, Source
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flights.controllers import controllers_of
from rotorid.proposing import tune
from rotorid.proposing.axis import KnownAxis
from rotorid.proposing.flown_gains import LoggedLoop
from rotorid.proposing.judging import JudgedGains, judge_axis, judge_gains, load_gains
from rotorid.tuning import frequency_grid, judged, read_gains, uncertain_plant
from rotorid.typing import Axis, ComplexArray, FloatArray

PX4 = {
    **{
        f"MC_{axis}RATE_{letter}": value
        for axis in ("ROLL", "PITCH")
        for letter, value in zip("PID", (0.15, 0.2, 0.003), strict=True)
    },
    "MC_YAWRATE_P": 0.2,
    "MC_YAWRATE_I": 0.1,
    "MC_YAWRATE_D": 0.0,
    "MC_ROLL_P": 6.5,
    "MC_PITCH_P": 6.5,
    "MC_YAW_P": 2.8,
    "IMU_DGYRO_CUTOFF": 30.0,
    "IMU_GYRO_CUTOFF": 40.0,
    "IMU_GYRO_RATEMAX": 400.0,
    "CA_ROTOR_COUNT": 4.0,
    "MPC_XY_P": 0.95,
    "THR_MDL_FAC": 0.3,
}
BETAFLIGHT = {
    "rollPID_P": 45.0,
    "rollPID_I": 80.0,
    "rollPID_D": 30.0,
    "levelPID_P": 50.0,
    "looptime": 125.0,
    "pid_process_denom": 2.0,
    "dterm_lpf1_static_hz": 90.0,
    "dterm_lpf1_type": 0.0,
    "gyro_lpf1_static_hz": 250.0,
}


def log(parameters: dict[str, float], firmware: str = "PX4 1.16.0") -> FlightRecord:
    format = "Betaflight blackbox" if firmware.startswith("Betaflight") else "PX4 ULog"
    source = Source(name="flight.log", format=format, sha256="", firmware=firmware)
    return FlightRecord(source=source, topics=(), parameters=parameters)


def vehicle(omega: FloatArray) -> ComplexArray:
    return np.asarray(113.1 / ((0.03j * omega + 1.0) * (1j * omega + 1.0)) * np.exp(-0.008j * omega))


def known(axis: Axis, record: FlightRecord) -> KnownAxis:
    flown = controllers_of(record)
    controller = flown.axis(axis)
    assert controller is not None
    source = "vehicle_angular_velocity.xyz[0]" if controller.autopilot == "PX4" else "gyroADC[0]"
    loop = LoggedLoop(axis=axis, controller=controller, known=flown, record=record, source=source)
    plant = uncertain_plant(vehicle, None, band_rad_s=(1.0, 120.0), draws=20)
    omega = frequency_grid(controller.controller)
    parts = loop.parts(omega)
    return KnownAxis(
        flown=loop,
        plant=plant,
        omega_rad_s=omega,
        flown_parts=parts,
        then=None,
        controller=controller,
        parts=parts,
    )


def judge(text: str, *axes: Axis, record: FlightRecord | None = None) -> JudgedGains:
    record = record or log(PX4)
    return judge_gains(
        read_gains(text, name="new.params"), {axis: known(axis, record) for axis in axes or ("roll",)}, {}
    )


def test_gains_take_the_place_of_the_flown_ones_and_the_rest_stays() -> None:
    found = judge("MC_ROLLRATE_P,0.12\nMC_ROLL_P,5")
    roll = found.axes["roll"]
    assert roll.verdict == found.verdict == "fly"
    assert (roll.judged.gains.P, roll.judged.gains.A) == (0.12, 5.0)
    assert (roll.judged.gains.I, roll.judged.gains.D) == (0.2, 0.003)
    assert roll.parameters["MC_ROLLRATE_P"] == (0.15, 0.12)


def test_the_flown_gains_have_the_figures_of_the_flight() -> None:
    roll = judge("MC_ROLLRATE_P,0.15").axes["roll"]
    np.testing.assert_allclose(roll.judged.whole.sensitivity_peak, roll.flown.whole.sensitivity_peak, rtol=1e-12)
    assert roll.noise.ratio == 1.0


def test_too_strong_gains_are_refused_with_what_to_lower() -> None:
    roll = judge("MC_ROLLRATE_P,0.45\nMC_ROLLRATE_I,1\nMC_ROLLRATE_D,0\nMC_ROLL_P,11").axes["roll"]
    assert roll.verdict == "do_not_fly"
    assert roll.lower
    gains = {"MC_ROLLRATE_P": 0.45, "MC_ROLLRATE_I": 1.0, "MC_ROLLRATE_D": 0.0, "MC_ROLL_P": 11.0, **roll.lower}
    assert judge("\n".join(f"{name},{value}" for name, value in gains.items())).axes["roll"].found.flies


@pytest.mark.parametrize(("cutoff", "worse"), [(5.0, True), (100.0, False)])
def test_filters_of_the_file_count(cutoff: float, worse: bool) -> None:
    roll = judge(f"IMU_GYRO_CUTOFF,{cutoff}").axes["roll"]
    assert (np.median(roll.judged.rate.sensitivity_peak) > np.median(roll.flown.rate.sensitivity_peak)) == worse
    assert (roll.verdict == "do_not_fly") == worse


def test_a_file_concerns_the_axes_that_it_names_and_filters_all() -> None:
    assert set(judge("MC_ROLLRATE_P,0.12", "roll", "yaw").axes) == {"roll"}
    assert set(judge("IMU_GYRO_CUTOFF,60", "roll", "yaw").axes) == {"roll", "yaw"}
    assert set(judge("yaw: P=0.15", "roll", "yaw").axes) == {"yaw"}
    refused = {"pitch": InsufficientDataError("pitch was not moved")}
    found = judge_gains(read_gains("pitch: P=0.1\nroll: P=0.12", name="x"), {"roll": known("roll", log(PX4))}, refused)
    assert (found.axes["roll"].verdict, found.verdict) == ("fly", "not_enough_data")
    assert "pitch was not moved" in found.unknown["pitch"]


def test_betaflight_has_whole_numbers_and_names_of_its_command_line() -> None:
    record = log(BETAFLIGHT, "Betaflight 4.4.3")
    roll = judge("set p_roll = 60\nset dterm_lpf1_type = PT2\n", record=record).axes["roll"]
    assert roll.parameters["p_roll"] == (45.0, 60.0)
    assert roll.parameters["dterm_lpf1_type"] == (0.0, 2.0)
    assert pytest.approx(roll.flown.gains.P * 60.0 / 45.0) == roll.judged.gains.P
    by_hand = judge("P=60", record=record).axes["roll"]
    assert by_hand.judged.gains.P == roll.judged.gains.P


def test_what_changes_the_vehicle_itself_is_not_called_safe() -> None:
    roll = judge("MC_ROLLRATE_P,0.12\nTHR_MDL_FAC,0.8").axes["roll"]
    assert (roll.found.verdict, roll.verdict) == ("fly", "not_enough_data")
    assert "THR_MDL_FAC changes from 0.3 to 0.8" in roll.reasons[0]
    rounded = log({**PX4, "THR_MDL_FAC": float(np.float32(0.3))})
    assert judge("MC_ROLLRATE_P,0.12\nTHR_MDL_FAC,0.3", record=rounded).axes["roll"].verdict == "fly"


def test_other_loops_are_left_out_by_name() -> None:
    (left_out,) = judge("MC_ROLLRATE_P,0.12\nWV_YRATE,3").findings
    assert "WV_YRATE" in left_out.message


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("ATC_RAT_RLL_P,0.1", "gains of ArduPilot, but flight.log is from PX4"),
        ("MC_ROLLRATE_P,0.1\nCA_ROTOR_COUNT,6", "another vehicle: CA_ROTOR_COUNT is 6, and 4 in"),
        ("MC_ROLLRTE_P,0.1", "no parameter MC_ROLLRTE_P.*did you mean MC_ROLLRATE_P"),
        ("MC_ROLLRATE_P,45", "MC_ROLLRATE_P = 45 is out of range"),
        ("MC_ROLLRATE_P,-0.1", "MC_ROLLRATE_P = -0.1 is out of range"),
        ("MPC_XY_P,0.9", "no gains of roll; expected gains of an axis to judge; these are of velocity"),
        ("MC_DTERM_CUTOFF,30", "no parameter MC_DTERM_CUTOFF"),
        ("P=0.1 X=3", "cannot be read"),
        ("MC_PITCHRATE_P,0.1", "no gains of roll; expected gains of an axis to judge; these are of pitch"),
    ],
)
def test_what_is_not_for_this_vehicle_is_refused(text: str, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        judge(text)


def test_what_an_autotune_leaves_outside_its_own_range_is_judged_with_a_warning() -> None:
    found = judge("MC_ROLL_P,20")
    assert "MC_ROLL_P = 20 (usually 0 to 12)" in found.findings[0].message
    assert found.verdict == "do_not_fly"
    with pytest.raises(UsageError, match="p_roll = 251 is out of range"):
        judge("set p_roll = 251", record=log(BETAFLIGHT, "Betaflight 4.4.3"))


def test_half_a_file_is_refused() -> None:
    whole = "\n".join(f"{name},{value}" for name, value in PX4.items())
    padding = "\n".join(f"MPC_EXTRA{k},1" for k in range(60))
    cut = whole[: whole.index("MC_PITCHRATE_I")]
    with pytest.raises(UsageError, match="does not contain MC_ROLL_P, MC_PITCHRATE_I"):
        judge(f"{padding}\n{cut}", "roll", "pitch")
    assert judge(f"{padding}\n{whole}", "roll", "pitch", "yaw").axes


def test_a_diff_leaves_nothing_to_be_guessed() -> None:
    record = log(BETAFLIGHT, "Betaflight 4.4.3")
    with pytest.raises(UsageError, match=r"does not contain i_roll, d_roll.*give a dump"):
        judge("defaults nosave\nset p_roll = 60\n", record=record)
    with pytest.raises(UsageError, match=r"from Betaflight 4.1, but flight.log from Betaflight 4.4"):
        judge("# Betaflight / STM32F405 (S405) 4.1.7 / x\nset p_roll = 60\n", record=record)


def test_a_line_without_an_axis_needs_one_axis() -> None:
    with pytest.raises(UsageError, match="names no axis"):
        judge("P=0.1", "roll", "yaw")


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be read"):
        load_gains(tmp_path / "none.params")
    large = tmp_path / "large.params"
    large.write_bytes(b"#" * 2_000_001)
    with pytest.raises(UsageError, match="at most 2000000 bytes"):
        load_gains(large)


def test_settings_of_a_flight_without_noise_have_ratios_only() -> None:
    roll = judge("MC_ROLLRATE_D,0.009\nMC_ROLLRATE_P,0.3").axes["roll"]
    assert roll.noise.rms is None
    assert roll.noise.ratio > 2.0
    assert replace(roll, reasons=()).found.verdict in ("gently", "do_not_fly")


@pytest.mark.parametrize(
    ("parameters", "firmware", "names"),
    [
        (PX4, "PX4 1.16.0", ("MC_ROLLRATE_P", "MC_ROLLRATE_I", "MC_ROLLRATE_D", "MC_ROLL_P")),
        (BETAFLIGHT, "Betaflight 4.4.3", ("rollPID_P", "rollPID_I", "rollPID_D", "levelPID_P")),
    ],
)
def test_gains_that_nobody_flew_are_told_apart(
    parameters: dict[str, float], firmware: str, names: tuple[str, ...]
) -> None:
    """The truth is another draw of the plant: no bad set may fly, and no good one is refused."""
    roll = known("roll", log(parameters, firmware))
    true = uncertain_plant(vehicle, None, band_rad_s=(1.0, 120.0), draws=1, seed=77).drawn(roll.omega_rad_s)
    rng = np.random.default_rng(3)
    bad, good = [], []
    for _ in range(20):
        values = {name: parameters[name] * float(np.exp(rng.uniform(-1.6, 1.6))) for name in names}
        found = judge_axis("roll", roll, values, advise=False)
        exact = judged(found.parts, true, found.judged.gains, from_rad_s=roll.plant.known_from_rad_s)
        stable = exact.rate.stable[0] and exact.whole.stable[0]
        peak = max(exact.rate.sensitivity_peak[0], exact.whole.sensitivity_peak[0]) if stable else np.inf
        bad += [found.verdict] if peak > 3.0 else []
        good += [found.verdict] if peak < 1.7 else []
    assert bad
    assert good
    assert set(bad) == {"do_not_fly"}
    assert set(good) <= {"fly", "gently"}


def test_a_preset_is_judged_by_its_sliders_and_only_for_its_versions(tmp_path: Path) -> None:
    even = ("i_gain", "d_gain", "pi_gain", "dmax_gain", "feedforward_gain", "pitch_d_gain", "pitch_pi_gain")
    record = log(
        {
            **BETAFLIGHT,
            **dict.fromkeys((f"simplified_{name}" for name in even), 100.0),
            "simplified_dterm_filter": 0.0,
            "simplified_gyro_filter": 0.0,
            **{f"{axis}PID_{letter}": 45.0 for axis in ("pitch", "yaw") for letter in "PID"},
            **{f"{name}_{axis}": 30.0 for name in ("d_min", "ff_weight") for axis in range(3)},
        },
        "Betaflight 4.4.3",
    )
    folder = tmp_path / "presets" / "4.4"
    folder.mkdir(parents=True)
    (folder / "defaults.txt").write_text("set simplified_pids_mode = RPY\nset d_roll = 40\n")
    file = folder / "tune.txt"
    preset = (
        "#$ FIRMWARE_VERSION: 4.4\n#$ INCLUDE: presets/4.4/defaults.txt\n"
        "set simplified_master_multiplier = 130\nsimplified_tuning apply\n"
    )
    file.write_text(preset)
    found = judge_gains(load_gains(file), {"roll": known("roll", record)}, {})
    roll = found.axes["roll"]
    assert (roll.parameters["p_roll"][1], roll.parameters["d_roll"][1], roll.parameters["d_min_roll"][1]) == (
        58,
        52,
        39,
    )
    assert "its sliders make the gains" in found.findings[0].message
    file.write_text(preset.replace("4.4/", "4.4/no"))
    with pytest.raises(UsageError, match=r"includes presets/4.4/nodefaults.txt, which is not there"):
        load_gains(file)
    file.write_text(preset.replace("VERSION: 4.4", "VERSION: 2025.12"))
    with pytest.raises(UsageError, match=r"from Betaflight 2025.12, but flight.log from Betaflight 4.4"):
        judge_gains(load_gains(file), {"roll": known("roll", record)}, {})


def test_feedforward_of_the_stick_changes_no_margin_and_is_named() -> None:
    record = log({**BETAFLIGHT, "ff_weight_0": 120.0}, "Betaflight 4.4.3")
    found = judge("set f_roll = 60\nset p_roll = 45", record=record)
    roll = found.axes["roll"]
    np.testing.assert_allclose(roll.judged.whole.sensitivity_peak, roll.flown.whole.sensitivity_peak, rtol=1e-12)
    assert "f_roll: feed-forward changes how the vehicle follows the stick" in found.findings[-1].message


def test_feedforward_inside_of_the_angle_loop_counts() -> None:
    record = log({**PX4, "MC_ROLLRATE_FF": 0.0})
    roll = judge("MC_ROLLRATE_FF,0.1", record=record).axes["roll"]
    assert np.median(roll.judged.whole.sensitivity_peak) > 1.1 * np.median(roll.flown.whole.sensitivity_peak)
    np.testing.assert_allclose(roll.judged.rate.sensitivity_peak, roll.flown.rate.sensitivity_peak, rtol=1e-12)


def test_what_the_log_does_not_contain_of_the_vehicle_is_named() -> None:
    record = log(BETAFLIGHT, "Betaflight 4.4.3")
    (found,) = judge("set p_roll = 50\nset thrust_linear = 0", record=record).findings
    assert found.message == "The log does not contain thrust_linear; judged as if the file does not change them."


def test_what_to_lower_is_a_whole_number_where_the_firmware_has_only_those() -> None:
    roll = judge("set p_roll = 249\nset d_roll = 7", record=log(BETAFLIGHT, "Betaflight 4.4.3")).axes["roll"]
    assert roll.verdict == "do_not_fly"
    assert roll.lower
    assert all(value == pytest.approx(round(value), abs=1e-9) for value in roll.lower.values())


def test_gains_of_another_autopilot_are_refused_before_the_long_work() -> None:
    """A log without a flight: what fails first is the file."""
    with pytest.raises(UsageError, match=r"x contains gains of ArduPilot, but flight.log is from PX4"):
        tune(records=log(PX4), judge=read_gains("ATC_RAT_RLL_P,0.1", name="x"))


def test_gains_in_place_of_their_file_are_asked_for_as_a_file() -> None:
    with pytest.raises(UsageError, match=r"'P=0.1 D=0.002' is no file; expected a file of gains; write lines"):
        load_gains("P=0.1 D=0.002")
