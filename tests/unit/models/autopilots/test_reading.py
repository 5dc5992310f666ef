"""Controllers of three autopilots from their parameters, against programs written out sample by sample."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from rotorid.errors import UsageError
from rotorid.models.autopilots.betaflight import BASE, TOP
from rotorid.models.autopilots.reading import axis_controller, rate_controller
from rotorid.models.autopilots.settings import AxisController, described
from rotorid.models.controller import stepped
from rotorid.models.loop_filter import FilterKind, LoopFilter
from rotorid.typing import Axis, ComplexArray, FloatArray

OMEGA = np.geomspace(0.5, 400.0, 60)
RATE_HZ = 400.0
STEP_S = 1.0 / RATE_HZ
ALGEBRAIC = 1e-12


def impulse_response(numerator: FloatArray, denominator: FloatArray, rate_hz: float) -> ComplexArray:
    """Transform of the impulse response of a recursion, summed until nothing is left of it."""
    impulse = np.zeros(200_000)
    impulse[0] = 1.0
    answer = signal.lfilter(numerator, denominator, impulse)
    last = int(np.flatnonzero(np.abs(answer) > 1e-18)[-1]) + 1
    late = np.exp(-1j * OMEGA / rate_hz)
    # Horner's way: powers of the delay do not lose digits.
    total = np.zeros(OMEGA.size, dtype=np.complex128)
    for value in answer[:last][::-1]:
        total = total * late + value
    return total


@pytest.mark.parametrize(("kind", "stages"), [("PT1", 1), ("PT2", 2), ("PT3", 3)])
def test_first_order_stages_are_those_of_the_recursion(kind: FilterKind, stages: int) -> None:
    rate_hz, cutoff_hz = 4000.0, 75.0
    corner = 2.0 * math.pi * cutoff_hz / math.sqrt(2.0 ** (1.0 / stages) - 1.0)
    share = (1.0 / rate_hz) / (1.0 / rate_hz + 1.0 / corner)
    denominator = np.array([1.0])
    for _ in range(stages):
        denominator = np.polymul(denominator, [1.0, share - 1.0])
    expected = impulse_response(np.array([share**stages]), denominator, rate_hz)
    found = LoopFilter(kind=kind, frequency_hz=cutoff_hz).response(1j * OMEGA, 1.0 / rate_hz)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=ALGEBRAIC)


def test_the_factors_of_the_cascades_are_those_of_the_firmware() -> None:
    for stages, factor in ((2, 1.553773974), (3, 1.961459177)):
        assert 1.0 / math.sqrt(2.0 ** (1.0 / stages) - 1.0) == pytest.approx(factor, abs=1e-9)


def test_the_butterworth_low_pass_is_that_of_scipy() -> None:
    numerator, denominator = signal.butter(2, 75.0, fs=4000.0)
    expected = impulse_response(numerator, denominator, 4000.0)
    found = LoopFilter(kind="Butterworth", frequency_hz=75.0).response(1j * OMEGA, 1.0 / 4000.0)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=ALGEBRAIC)


def test_the_notch_is_that_of_scipy() -> None:
    # Theirs takes the tangent of the half bandwidth, the autopilots' the sine over twice the quality.
    center_hz, rate_hz, quality = 60.0, 1000.0, 2.0
    angle = 2.0 * math.pi * center_hz / rate_hz
    numerator, denominator = signal.iirnotch(
        center_hz, angle / (2.0 * math.atan(math.sin(angle) / (2.0 * quality))), fs=rate_hz
    )
    found = LoopFilter(kind="notch", frequency_hz=center_hz, quality=quality).response(1j * OMEGA, 1.0 / rate_hz)
    np.testing.assert_allclose(found, impulse_response(numerator, denominator, rate_hz), rtol=0.0, atol=ALGEBRAIC)


@pytest.mark.parametrize("kind", ["PT1", "PT2", "PT3", "Butterworth", "notch"])
def test_small_steps_go_to_continuous_time(kind: FilterKind) -> None:
    one = LoopFilter(kind=kind, frequency_hz=30.0, quality=1.5, floor=0.1)
    exact = one.response(1j * OMEGA)
    coarse, fine = (np.abs(one.response(1j * OMEGA, h) - exact).max() for h in (1e-4, 5e-5))
    order = 1 if kind.startswith("PT") else 2
    assert coarse / fine == pytest.approx(2.0**order, rel=0.05)


def test_filters_at_half_of_the_rate_are_left_out_where_the_firmware_does() -> None:
    assert LoopFilter(kind="Butterworth", frequency_hz=200.0).sampled(RATE_HZ) is None
    assert LoopFilter(kind="notch", frequency_hz=250.0, quality=1.0).sampled(RATE_HZ) is None
    assert LoopFilter(kind="PT1", frequency_hz=1000.0).sampled(RATE_HZ) is not None


@pytest.mark.parametrize("wrong", [{"kind": "PT4"}, {"frequency_hz": 0.0}, {"kind": "notch", "quality": 0.0}])
def test_impossible_filters_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(UsageError):
        LoopFilter(**{"kind": "PT1", "frequency_hz": 20.0, **wrong})  # type: ignore[arg-type]


# Programs, sample by sample: what goes in is a set-point or a rate, what comes out the command.

Program = Callable[[FloatArray, FloatArray], FloatArray]
COUNT = 2**15


def low_pass(values: FloatArray, cutoff_hz: float, rate_hz: float = RATE_HZ) -> FloatArray:
    share = 1.0 / (1.0 + rate_hz / (2.0 * math.pi * cutoff_hz))
    return signal.lfilter([share], [1.0, share - 1.0], values)


def slope(values: FloatArray, rate_hz: float = RATE_HZ) -> FloatArray:
    return np.diff(values, prepend=0.0) * rate_hz


def measured(program: Program, of: str, rate_hz: float = RATE_HZ) -> tuple[FloatArray, ComplexArray]:
    """Response of a program without integral at the lines of a period, by an impulse."""
    impulse, none = np.zeros(COUNT), np.zeros(COUNT)
    impulse[0] = 1.0
    command = program(impulse, none) if of == "set-point" else -program(none, impulse)
    lines = np.unique(np.geomspace(5, 0.4 * COUNT, 40).astype(int))
    return 2.0 * math.pi * lines * rate_hz / COUNT, np.fft.fft(command)[lines]


PX4 = {
    "MC_YAWRATE_K": 2.0,
    "MC_YAWRATE_P": 0.1,
    "MC_YAWRATE_I": 0.15,
    "MC_YAWRATE_D": 0.003,
    "MC_YAWRATE_FF": 0.04,
    "MC_YR_INT_LIM": 0.3,
    "MC_YAW_P": 2.8,
    "IMU_DGYRO_CUTOFF": 20.0,
    "MC_YAW_TQ_CUTOFF": 5.0,
    "IMU_GYRO_RATEMAX": RATE_HZ,
}


def px4_program(target: FloatArray, rate: FloatArray) -> FloatArray:
    error = target - rate
    summed = np.concatenate([[0.0], np.cumsum(error)[:-1]]) * STEP_S
    torque = 2.0 * (0.1 * error + 0.15 * summed - 0.003 * low_pass(slope(rate), 20.0)) + 0.04 * target
    return low_pass(torque, 5.0)


ARDUPILOT = {
    "ATC_RAT_RLL_P": 0.135,
    "ATC_RAT_RLL_I": 0.2,
    "ATC_RAT_RLL_D": 0.0036,
    "ATC_RAT_RLL_FF": 0.05,
    "ATC_RAT_RLL_D_FF": 0.002,
    "ATC_RAT_RLL_FLTT": 20.0,
    "ATC_RAT_RLL_FLTE": 15.0,
    "ATC_RAT_RLL_FLTD": 25.0,
    "ATC_RAT_RLL_NTF": 1.0,
    "ATC_RAT_RLL_NEF": 2.0,
    "FILT1_TYPE": 1.0,
    "FILT1_NOTCH_FREQ": 40.0,
    "FILT1_NOTCH_Q": 2.0,
    "FILT1_NOTCH_ATT": 30.0,
    "FILT2_TYPE": 1.0,
    "FILT2_NOTCH_FREQ": 60.0,
    "FILT2_NOTCH_Q": 3.0,
    "FILT2_NOTCH_ATT": 20.0,
    "ATC_ANG_RLL_P": 4.5,
    "SCHED_LOOP_RATE": RATE_HZ,
}


def ardupilot_notch(values: FloatArray, center_hz: float, quality: float, attenuation_db: float) -> FloatArray:
    angle = 2.0 * math.pi * center_hz / RATE_HZ
    alpha, left = math.sin(angle) / (2.0 * quality), 10.0 ** (-attenuation_db / 20.0)
    over = [1.0 + alpha * left, -2.0 * math.cos(angle), 1.0 - alpha * left]
    return signal.lfilter(over, [1.0 + alpha, -2.0 * math.cos(angle), 1.0 - alpha], values)


def ardupilot_program(target: FloatArray, rate: FloatArray) -> FloatArray:
    target = low_pass(ardupilot_notch(target, 40.0, 2.0, 30.0), 20.0)
    error = low_pass(ardupilot_notch(target - rate, 60.0, 3.0, 20.0), 15.0)
    pid = 0.135 * error + 0.2 * np.cumsum(error) * STEP_S + 0.0036 * low_pass(slope(error), 25.0)
    return pid + 0.05 * target + 0.002 * slope(target)


BETAFLIGHT = {
    "rollPID_P": 45.0,
    "rollPID_I": 80.0,
    "rollPID_D": 40.0,
    "yawPID_P": 45.0,
    "yawPID_I": 80.0,
    "yawPID_D": 0.0,
    "levelPID_P": 50.0,
    "d_min_0": 30.0,
    "d_min_2": 0.0,
    "ff_weight_0": 120.0,
    "dterm_lpf1_type": 2.0,
    "dterm_lpf1_static_hz": 75.0,
    "dterm_lpf1_dyn_hz_0": 75.0,
    "dterm_lpf1_dyn_hz_1": 150.0,
    "dterm_lpf1_dyn_expo": 5.0,
    "dterm_lpf2_type": 0.0,
    "dterm_lpf2_static_hz": 150.0,
    "dterm_notch_hz": 260.0,
    "dterm_notch_cutoff": 160.0,
    "yaw_lowpass_hz": 100.0,
    "tpa_rate": 40.0,
    "tpa_breakpoint": 1400.0,
    "iterm_relax": 1.0,
    "looptime": 125.0,
    "pid_process_denom": 2.0,
}
BETAFLIGHT_HZ = 4000.0
THROTTLE = 0.5


def betaflight_roll(target: FloatArray, rate: FloatArray) -> FloatArray:
    """In degrees per second and thousandths, as the firmware counts."""
    error, rate = np.degrees(target - rate), np.degrees(rate)
    cutoff_hz = 75.0 + 75.0 * (THROTTLE + THROTTLE * (1.0 - THROTTLE) * 0.5)
    for _ in range(2):
        rate = low_pass(rate, cutoff_hz / math.sqrt(math.sqrt(2.0) - 1.0), BETAFLIGHT_HZ)
    rate = low_pass(rate, 150.0, BETAFLIGHT_HZ)
    angle = 2.0 * math.pi * 260.0 / BETAFLIGHT_HZ
    alpha = math.sin(angle) * (260.0**2 - 160.0**2) / (2.0 * 260.0 * 160.0)
    rate = signal.lfilter([1.0, -2.0 * math.cos(angle), 1.0], [1.0 + alpha, -2.0 * math.cos(angle), 1.0 - alpha], rate)
    tpa = 1.0 - 0.4 * (THROTTLE - 0.4) / 0.6
    pid = 0.032029 * 45.0 * error + 0.244381 * 80.0 * np.cumsum(error) / BETAFLIGHT_HZ
    return (pid - tpa * 0.000529 * 30.0 * slope(rate, BETAFLIGHT_HZ)) / 1000.0


def betaflight_yaw(target: FloatArray, rate: FloatArray) -> FloatArray:
    error = np.degrees(target - rate)
    proportional = low_pass(0.032029 * 45.0 * error, 100.0, BETAFLIGHT_HZ)
    return (proportional + 2.5 * 0.244381 * 80.0 * np.cumsum(error) / BETAFLIGHT_HZ) / 1000.0


CASES = {
    "PX4": (PX4, "yaw", "PX4 1.16.0", px4_program, RATE_HZ),
    "ArduPilot": (ARDUPILOT, "roll", "ArduCopter V4.6.2", ardupilot_program, RATE_HZ),
    "Betaflight": (BETAFLIGHT, "roll", "Betaflight 4.3.1 (8d4f005) STM32F7X2", betaflight_roll, BETAFLIGHT_HZ),
    "Betaflight yaw": (BETAFLIGHT, "yaw", "Betaflight 4.3.1", betaflight_yaw, BETAFLIGHT_HZ),
}


def controller_of(name: str) -> AxisController:
    parameters, axis, firmware, _, _ = CASES[name]
    found = axis_controller(parameters, axis, firmware=firmware, throttle=THROTTLE)  # type: ignore[arg-type]
    assert found is not None
    return found


@pytest.mark.parametrize("name", CASES)
def test_the_response_is_that_of_the_program(name: str) -> None:
    own = controller_of(name).controller.rate_loop
    program, rate_hz = CASES[name][3:]
    step_s = 1.0 / rate_hz
    for of, response in (("rate", own.response), ("set-point", own.setpoint_response)):
        omega, found = measured(program, of, rate_hz)
        # An integral never forgets its impulse, of which a period holds the first part only.
        held = own.integral * step_s / (1.0 - np.exp(-1j * omega * step_s))
        largest = np.abs(response(omega)).max()
        np.testing.assert_allclose(found + held, response(omega), rtol=0.0, atol=ALGEBRAIC * largest)


def test_px4_filters_its_derivative_by_second_order_before_1_12() -> None:
    old = rate_controller(PX4, "yaw", firmware="PX4 1.11.3")
    older = {name: value for name, value in PX4.items() if name != "IMU_DGYRO_CUTOFF"} | {"MC_DTERM_CUTOFF": 30.0}
    oldest = rate_controller(older, "yaw")
    for found, cutoff_hz in ((old, 20.0), (oldest, 30.0)):
        assert found is not None
        assert found.derivative_cutoff_hz == 0.0
        assert found.derivative_filters == (LoopFilter(kind="Butterworth", frequency_hz=cutoff_hz),)
    new = rate_controller(PX4, "yaw", firmware="PX4 1.12.0")
    assert new is not None
    assert (new.derivative_cutoff_hz, new.derivative_filters) == (20.0, ())


def test_px4_derivative_at_the_rate_of_the_sensor() -> None:
    found = axis_controller(PX4, "yaw", sensor_rate_hz=8000.0)
    assert found is not None
    rate_hz = 8000.0
    late = np.exp(-1j * OMEGA / rate_hz)
    share = 1.0 / (1.0 + rate_hz / (2.0 * math.pi * 20.0))
    expected = 0.006 * (1.0 - late) * rate_hz * share / (1.0 - (1.0 - share) * late)
    np.testing.assert_allclose(found.controller.derivative_response(OMEGA), expected, rtol=1e-10)


def test_the_scales_of_betaflight() -> None:
    header = {"rollPID_P": 45.0, "rollPID_I": 80.0, "rollPID_D": 30.0, "looptime": 125.0}
    found = rate_controller(header, "roll", firmware="Betaflight 4.5.1")
    assert found is not None
    assert found.proportional_s == pytest.approx(0.08258, abs=5e-6)
    assert found.integral == pytest.approx(1.1202, abs=5e-5)
    assert found.derivative_s2 == pytest.approx(9.093e-4, abs=5e-8)


def test_d_of_betaflight_moves_between_two_ends() -> None:
    older = controller_of("Betaflight")
    tpa = 1.0 - 0.4 * (THROTTLE - 0.4) / 0.6
    per_unit = 0.000529 * 180.0 / math.pi / 1000.0 * tpa
    found = {name: one.derivative_s2 / per_unit for name, one in older.ends.items()}
    assert found == {BASE: pytest.approx(30.0), TOP: pytest.approx(40.0)}
    assert older.controller == older.ends[BASE]
    newer = {name: value for name, value in BETAFLIGHT.items() if not name.startswith("d_min")} | {"d_max_0": 46.0}
    moved = axis_controller(newer, "roll", firmware="Betaflight 2025.12.0", throttle=THROTTLE)
    assert moved is not None
    assert moved.ends[TOP].derivative_s2 / moved.ends[BASE].derivative_s2 == pytest.approx(46.0 / 40.0)
    assert not controller_of("Betaflight yaw").ends


def test_betaflight_needs_a_version_that_is_known() -> None:
    for firmware in ("", "Betaflight 3.5.7", "INAV", "INAV 7.1.2 (f5c7a1e) MATEKF405"):
        assert axis_controller(BETAFLIGHT, "roll", firmware=firmware) is None
    assert axis_controller(BETAFLIGHT | {"use_integrated_yaw": 1.0}, "yaw", firmware="Betaflight 4.3.1") is None


def test_names_of_betaflight_before_4_3() -> None:
    renamed = {"dterm_lpf1_type": "dterm_filter_type", "dterm_lpf2_type": "dterm_filter2_type"}
    renamed |= {f"dterm_lpf1_{rest}": f"dterm_lowpass_{rest}" for rest in ("dyn_hz_0", "dyn_hz_1")}
    renamed |= {"dterm_lpf2_static_hz": "dterm_lowpass2_hz", "dterm_lpf1_static_hz": "dterm_lowpass_hz"}
    header = {renamed.get(name, name): value for name, value in BETAFLIGHT.items()} | {"dterm_filter_type": 0.0}
    for firmware, cutoff_hz in (("Betaflight 4.2.0", 121.875), ("Betaflight 4.1.0", 103.125)):
        found = rate_controller(header, "roll", firmware=firmware, throttle=THROTTLE)
        assert found is not None
        assert [(one.kind, one.frequency_hz) for one in found.derivative_filters[1:]] == [
            ("PT1", pytest.approx(cutoff_hz)),
            ("PT1", 150.0),
        ]


def test_tpa_of_both_terms() -> None:
    of_d, of_both = (
        rate_controller(BETAFLIGHT | {"tpa_mode": mode}, "roll", firmware="Betaflight 4.5.0", throttle=1.0)
        for mode in (1.0, 0.0)
    )
    assert of_d is not None
    assert of_both is not None
    assert of_both.proportional_s == pytest.approx(0.6 * of_d.proportional_s)
    assert of_both.derivative_s2 == of_d.derivative_s2


def test_angle_mode_of_betaflight() -> None:
    newer = rate_controller(BETAFLIGHT, "roll", firmware="Betaflight 4.5.1")
    older = rate_controller(BETAFLIGHT, "roll", firmware="Betaflight 4.3.1")
    yaw = rate_controller(BETAFLIGHT, "yaw", firmware="Betaflight 4.5.1")
    assert newer is not None
    assert older is not None
    assert yaw is not None
    assert (newer.angle_1_s, older.angle_1_s, yaw.angle_1_s) == (5.0, 5.0, 0.0)
    assert newer.angle_filters == (LoopFilter(kind="PT3", frequency_hz=50.0),)
    assert older.angle_filters == ()


def test_what_is_fed_forward_is_inside_of_the_angle_loop() -> None:
    own = controller_of("ArduPilot").controller
    angle = own.response(OMEGA) - own.rate_loop.response(OMEGA)
    late = np.exp(-1j * OMEGA * STEP_S)
    np.testing.assert_allclose(angle, own.setpoint_response(OMEGA) * 4.5 * late / (1j * OMEGA), rtol=1e-9)
    bare = {name: value for name, value in ARDUPILOT.items() if not name.endswith("FF")}
    without = rate_controller(bare, "roll")
    assert without is not None
    np.testing.assert_allclose(own.rate_loop.response(OMEGA), without.rate_loop.response(OMEGA), rtol=1e-12)
    assert np.abs(own.setpoint_response(OMEGA) / without.setpoint_response(OMEGA) - 1.0).max() > 0.1


@pytest.mark.parametrize("driven", ["rate", "angle"])
@pytest.mark.parametrize("name", CASES)
def test_steps_with_filters_go_to_the_response(name: str, driven: str) -> None:
    own = replace(controller_of(name).controller, step_s=0.0, late_angle=False, late_integral=False)
    wanted = own if driven == "angle" else own.rate_loop
    omega = np.geomspace(0.5, 60.0, 12)
    exact = wanted.response(omega)
    off = []
    for step_s in (1e-4, 5e-5):
        program = stepped(own, step_s=step_s, driven=driven)  # type: ignore[arg-type]
        z = np.exp(1j * omega * step_s)[:, None, None]
        states = np.linalg.solve(z * np.eye(len(program.transition)) - program.transition, program.drive[:, 1:][None])
        off.append(np.abs(-(program.read @ states + program.direct[:, 1:])[:, 0, 0] / exact - 1.0))
    assert off[0].max() < 60.0 * 1e-4 * 3.0
    some = off[0] > 1e-7
    np.testing.assert_allclose(off[1][some] / off[0][some], 0.5, atol=0.05)


def test_what_the_firmware_calls_it() -> None:
    roll, yaw = controller_of("Betaflight"), controller_of("Betaflight yaw")
    told = described([roll, yaw])
    assert told["autopilot"] == "Betaflight"
    assert told["loop_rate_hz"] == pytest.approx(BETAFLIGHT_HZ)
    assert told["gains"]["p_roll"] == 45.0
    assert told["gains"]["d_min_roll"] == 30.0
    assert told["gains"]["i_yaw"] == 80.0
    assert told["filters"]["dterm_lpf1_dyn_min_hz"] == 75.0
    assert told["filters"]["yaw_lowpass_hz"] == 100.0
    copter = controller_of("ArduPilot").described()
    assert copter["gains"]["ATC_RAT_RLL_D_FF"] == 0.002
    assert copter["filters"]["FILT1_NOTCH_FREQ"] == 40.0
    px4 = controller_of("PX4").described()
    assert px4["gains"]["MC_YR_INT_LIM"] == 0.3
    assert px4["filters"] == {"IMU_DGYRO_CUTOFF": 20.0, "MC_YAW_TQ_CUTOFF": 5.0}


def test_what_is_on_and_not_linear_is_said() -> None:
    assert any("iterm_relax" in note for note in controller_of("Betaflight").notes)
    assert any("TPA" in note for note in controller_of("Betaflight").notes)
    limited = axis_controller(ARDUPILOT | {"ATC_RAT_RLL_SMAX": 50.0, "ATC_RAT_RLL_PDMX": 0.3}, "roll")
    assert limited is not None
    assert [note.split()[0] for note in limited.notes] == ["ATC_RAT_RLL_SMAX", "ATC_RAT_RLL_PDMX"]
    lost = axis_controller(ARDUPILOT | {"ATC_RAT_RLL_NTF": 7.0}, "roll")
    assert lost is not None
    assert any("FILT7_" in note for note in lost.notes)


@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf, 1e-300, 1e-9, 1e9, 1e300])
@pytest.mark.parametrize(("parameters", "axis", "firmware"), [case[:3] for case in CASES.values()])
def test_damaged_parameters_make_no_controller_or_a_sound_one(
    parameters: dict[str, float], axis: Axis, firmware: str, value: float
) -> None:
    for name in parameters:
        found = axis_controller(parameters | {name: value}, axis, firmware=firmware, throttle=THROTTLE)
        if found is not None:
            assert np.isfinite(found.controller.response(OMEGA)).all()
