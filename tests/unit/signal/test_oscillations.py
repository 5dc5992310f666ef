"""Loops that swing by themselves, in signals whose truth is known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Status, Topic
from rotorid.signal.oscillations import OscillationCheck, check_oscillations
from rotorid.typing import FloatArray

FLIGHT_S, FINE_HZ = 60.0, 8000.0
FORMATS = {10.0: "ArduPilot DataFlash", 50.0: "PX4 ULog", 400.0: "ArduPilot DataFlash", 2000.0: "Betaflight blackbox"}
RANGE = {"MOT_THST_EXPO": 0.0, "MOT_SPIN_MIN": 0.0, "MOT_SPIN_MAX": 1.0}
TIME_S = np.arange(0.0, FLIGHT_S, 1.0 / FINE_HZ)


def wave(frequency_hz: float, *, phase: float = 0.3) -> FloatArray:
    return np.sin(2.0 * np.pi * frequency_hz * TIME_S + phase)


def noise(size: float, seed: int = 0) -> FloatArray:
    return size * _white(seed)


@cache
def _white(seed: int) -> FloatArray:
    return np.random.default_rng(seed).standard_normal(TIME_S.size)


def swinging(frequency_hz: float, *, amplitude: float = 0.5, hover: float = 0.4) -> dict[str, FloatArray]:
    """A vehicle whose roll swings, with its rate and angle, and motors that reach zero."""
    command = amplitude * wave(frequency_hz)
    rate = 0.8 * wave(frequency_hz, phase=-1.0)
    angle = 0.8 / (2.0 * np.pi * frequency_hz) * wave(frequency_hz, phase=-1.0 - 0.5 * np.pi)
    return still(hover) | {
        "roll_command": command + noise(0.005),
        "p": rate + noise(0.005, 1),
        "phi": angle + noise(1e-5, 2),
        "p_setpoint": noise(0.005, 3),
        "phi_setpoint": noise(1e-4, 4),
        "motor_1": np.clip(hover + command, 0.0, 1.0),
        "motor_2": np.clip(hover - command, 0.0, 1.0),
    }


def still(hover: float = 0.4) -> dict[str, FloatArray]:
    names = ("roll_command", "pitch_command", "yaw_command", "p", "phi", "p_setpoint", "phi_setpoint")
    calm = {name: noise(0.003, place) for place, name in enumerate(names)}
    return calm | {"motor_1": hover + noise(0.003, 10), "motor_2": hover + noise(0.003, 11)}


def record(
    signals: Mapping[str, FloatArray],
    rate_hz: float,
    *,
    kind: str = "",
    late: float = 0.0,
    means: bool = False,
    ranged: bool = True,
) -> FlightRecord:
    """Signals as a logger picks them, each late by up to a share of a step; or their means."""
    step = round(FINE_HZ / rate_hz)
    places = np.arange(0, TIME_S.size - step, step)
    if means:
        rows = [values[: places.size * step].reshape(-1, step).mean(axis=1) for values in signals.values()]
        places = places + step // 2
    else:
        places = places + np.random.default_rng(5).integers(0, max(round(late * step), 1), places.size)
        rows = [values[places] for values in signals.values()]
    channels = tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in signals)
    topic = Topic(name="log", time_s=TIME_S[places], channels=channels, values=np.stack(rows))
    whole = ((0.0, FLIGHT_S),)
    return FlightRecord(
        source=Source(name="flight", format=kind or FORMATS[rate_hz], sha256=""),
        topics=(topic,),
        parameters=RANGE if ranged else {},
        status=Status(vehicle="multirotor", armed=whole, in_air=whole, flagged_in="test"),
    )


def axes(check: OscillationCheck) -> list[str]:
    return [one.axis for one in check.found]


@pytest.mark.parametrize("rate_hz", FORMATS)
@pytest.mark.parametrize("frequency_hz", [4.3, 17.3, 38.2])
@pytest.mark.parametrize("late", [0.0, 0.3])
def test_a_limit_cycle_is_found_at_any_rate_of_the_log(rate_hz: float, frequency_hz: float, late: float) -> None:
    check = check_oscillations(record(swinging(frequency_hz), rate_hz, late=late))
    assert axes(check) == ["roll"]
    (found,) = check.found
    assert found.loop == "rate"
    assert found.rms == pytest.approx(0.5 / np.sqrt(2.0), rel=0.15)
    # The command exceeds the hover of 0.4 for 41 % of the time: at zero of one motor or the other.
    assert found.at_limit_percent == pytest.approx(41.0, abs=4.0)
    if rate_hz > 2.5 * frequency_hz:
        assert found.frequency_hz == pytest.approx(frequency_hz, rel=0.02)
    else:
        assert found.frequency_hz is None
    assert set(check.calm) | set(check.unchecked) == {"pitch", "yaw"}


@pytest.mark.parametrize("rate_hz", FORMATS)
def test_a_quiet_flight_is_calm_at_any_rate(rate_hz: float) -> None:
    check = check_oscillations(record(still(), rate_hz))
    assert (check.found, check.calm, dict(check.unchecked)) == ((), ("roll", "pitch", "yaw"), {})


@pytest.mark.parametrize(
    ("amplitude", "hover", "swings"), [(0.16, 0.14, True), (0.12, 0.10, False), (0.3, 0.29, False)]
)
def test_both_the_size_and_the_limits_count(amplitude: float, hover: float, swings: bool) -> None:
    """At 10 Hz: an rms of 0.11 with limits in a third of the samples; 0.085; 0.21 with limits in a sixth."""
    check = check_oscillations(record(swinging(17.3, amplitude=amplitude, hover=hover), 10.0))
    assert bool(check.found) == swings


def test_a_cycle_that_stands_still_in_a_slow_log_is_found_or_left_unchecked() -> None:
    slow = check_oscillations(record(swinging(20.01), 10.0))
    assert axes(slow) == ["roll"]
    assert slow.found[0].frequency_hz is None
    # It stands where a motor is at its limit, and all samples are the same.
    exactly = swinging(20.0)
    exactly |= {"motor_1": np.full(TIME_S.size, 0.8), "motor_2": np.zeros(TIME_S.size)}
    check = check_oscillations(record(exactly, 10.0))
    assert check.calm == ()
    assert "A motor is at a limit" in check.unchecked["roll"]


@pytest.mark.parametrize("rate_hz", [10.0, 50.0])
@pytest.mark.parametrize("frequency_hz", [12.9, 22.9, 36.6])
def test_means_never_count_as_calm(rate_hz: float, frequency_hz: float) -> None:
    check = check_oscillations(record(swinging(frequency_hz), rate_hz, kind="CSV", means=True))
    assert "roll" not in check.calm
    # A table that moves little is no evidence either.
    quiet = check_oscillations(record(still(), rate_hz, kind="CSV"))
    assert quiet.calm == ()
    assert "means" in quiet.unchecked["roll"]
    assert check_oscillations(record(still(), 400.0, kind="CSV")).calm == ("roll", "pitch", "yaw")


@pytest.mark.parametrize("frequency_hz", [13.7, 36.3])
def test_rate_over_angle_decides_between_a_line_and_its_image(frequency_hz: float) -> None:
    """At 50 Hz both look like 13.7 Hz; without the angle neither is told."""
    (found,) = check_oscillations(record(swinging(frequency_hz), 50.0)).found
    assert found.frequency_hz == (pytest.approx(13.7, rel=0.02) if frequency_hz < 20.0 else None)
    without = {name: values for name, values in swinging(frequency_hz).items() if not name.startswith("phi")}
    (unknown,) = check_oscillations(record(without, 50.0)).found
    assert unknown.frequency_hz is None


def test_a_part_of_a_flight_counts_when_it_lasts() -> None:
    """15 s of 60 are found, with their frequency; 5 s are a scare."""
    for long_s, found in ((15.0, ["roll"]), (5.0, [])):
        inside = np.abs(TIME_S - 30.0 - 0.5 * long_s) < 0.5 * long_s
        calm, swing = still(), swinging(11.3)
        signals = {name: np.where(inside, swing[name], calm[name]) for name in calm}
        check = check_oscillations(record(signals, 400.0))
        assert axes(check) == found
        assert not found or check.found[0].frequency_hz == pytest.approx(11.3, rel=0.03)


def test_a_slow_log_without_motors_is_not_called_calm() -> None:
    # A cycle of exactly 30 Hz stands still in 10 Hz: the command looks as quiet as that of a calm flight.
    for signals in (still(), swinging(30.0)):
        alone = {name: values for name, values in signals.items() if not name.startswith("motor_")}
        seen = check_oscillations(record(alone, 10.0))
        assert "roll" not in seen.calm
    assert (
        "without motor outputs"
        in check_oscillations(
            record({name: values for name, values in still().items() if not name.startswith("motor_")}, 10.0)
        ).unchecked["roll"]
    )
    assert "roll" in check_oscillations(record(still(), 10.0)).calm


def test_a_line_without_limits_counts_when_no_setpoint_makes_it() -> None:
    signals = swinging(7.0, amplitude=0.3, hover=0.5)
    free = check_oscillations(record(signals, 400.0))
    assert axes(free) == ["roll"]
    assert free.found[0].at_limit_percent == 0.0
    assert axes(check_oscillations(record(signals | {"p_setpoint": signals["p"]}, 400.0))) == []
    # A slow log shows no line: the stick may have done it.
    slow = check_oscillations(record(signals, 10.0))
    assert (axes(slow), "roll" in slow.unchecked) == ([], True)
    without_motors = {name: values for name, values in swinging(7.0).items() if not name.startswith("motor")}
    (found,) = check_oscillations(record(without_motors, 400.0)).found
    assert found.at_limit_percent is None


@pytest.mark.parametrize("lost", ["p", "p_setpoint"])
@pytest.mark.parametrize("motors", [True, False])
def test_a_line_of_which_the_set_point_is_not_known_is_not_calm(lost: str, motors: bool) -> None:
    signals = swinging(7.0, amplitude=0.3, hover=0.5)
    kept = {name: one for name, one in signals.items() if name != lost and (motors or not name.startswith("motor"))}
    check = check_oscillations(record(kept, 400.0))
    assert (axes(check), "roll" in check.calm) == ([], False)
    assert "without the rate and its set-point" in check.unchecked["roll"]


def test_outputs_pile_up_where_their_range_is_not_known() -> None:
    signals = swinging(7.0, amplitude=0.3, hover=0.5)
    signals |= {name: np.clip(signals[name], 0.3, 0.7) for name in ("motor_1", "motor_2")}
    (found,) = check_oscillations(record(signals, 400.0, ranged=False)).found
    assert found.at_limit_percent == pytest.approx(100.0 * np.mean(np.abs(0.3 * wave(7.0)) >= 0.2), abs=1.0)


def test_motors_whose_range_is_not_known_are_at_no_limit_that_is_known() -> None:
    signals = swinging(7.0, amplitude=0.3, hover=0.5)
    # So coarse that no pile shows.
    signals |= {name: np.round(signals[name], 1) for name in ("motor_1", "motor_2")}
    (found,) = check_oscillations(record(signals, 400.0, ranged=False)).found
    assert found.at_limit_percent is None
    noisy = signals | {"roll_command": signals["roll_command"] + noise(0.3, 7)}
    assert check_oscillations(record(noisy, 400.0)).calm == ("roll", "pitch", "yaw")
    check = check_oscillations(record(noisy, 400.0, ranged=False))
    assert (axes(check), "roll" in check.calm) == ([], False)


def test_a_line_in_much_noise_needs_the_motors() -> None:
    loud = noise(0.4, 7)
    cycle = {name: loud + values if name == "roll_command" else values for name, values in swinging(17.0).items()}
    check = check_oscillations(record({name: one for name, one in cycle.items() if "motor" not in name}, 400.0))
    assert (axes(check), "motor outputs" in check.unchecked.get("roll", "")) == ([], True)


def test_noise_in_saturated_motors_is_no_oscillation() -> None:
    loud = noise(0.4, 7)
    signals = still() | {"roll_command": loud}
    signals |= {"motor_1": np.clip(0.4 + loud, 0.0, 1.0), "motor_2": np.clip(0.4 - loud, 0.0, 1.0)}
    check = check_oscillations(record(signals, 400.0))
    assert axes(check) == []
    # It is not calm either.
    assert "noise reaches the motors" in check.unchecked["roll"]
    # A line under as much noise is one.
    cycle = {name: loud + values if name == "roll_command" else values for name, values in swinging(17.0).items()}
    assert axes(check_oscillations(record(cycle, 400.0))) == ["roll"]


def test_a_huge_swing_needs_no_limits_in_a_slow_log() -> None:
    free = swinging(17.3, amplitude=0.6, hover=0.5) | {"motor_1": still()["motor_1"], "motor_2": still()["motor_2"]}
    assert axes(check_oscillations(record(free, 10.0))) == ["roll"]
    smaller = swinging(17.3, amplitude=0.4, hover=0.5)
    assert "roll" in check_oscillations(record(smaller, 10.0)).unchecked


def slow_swing(size_deg: float, envelope: FloatArray | float = 1.0) -> dict[str, FloatArray]:
    angle = np.radians(size_deg) * np.sqrt(2.0) * envelope * wave(0.9)
    return still() | {
        "phi": angle,
        "p": np.gradient(angle, TIME_S),
        "roll_command": 0.05 * envelope * wave(0.9, phase=1.2),
    }


@pytest.mark.parametrize("rate_hz", [10.0, 50.0, 400.0])
def test_a_slow_swing_shows_in_the_attitude(rate_hz: float) -> None:
    (found,) = check_oscillations(record(slow_swing(3.0), rate_hz)).found
    assert (found.axis, found.loop) == ("roll", "attitude")
    assert found.frequency_hz == pytest.approx(0.9, rel=0.03)
    assert np.degrees(found.error_rms_rad) == pytest.approx(3.0, rel=0.1)
    assert axes(check_oscillations(record(slow_swing(1.0), rate_hz))) == []


def test_a_pilot_and_kicks_are_no_slow_swing() -> None:
    signals = slow_swing(6.0)
    # The set-point leads, the attitude follows with a lag: their difference is large, and follows the set-point.
    driven = signals | {"phi_setpoint": np.radians(12.0) * wave(0.9, phase=1.0)}
    assert axes(check_oscillations(record(driven, 50.0))) == []
    kicks = slow_swing(12.0, np.exp(-(TIME_S % 10.0) / 3.0))
    assert axes(check_oscillations(record(kicks, 50.0))) == []


def test_gusts_and_a_wandering_line_are_no_slow_swing() -> None:
    """A fifth of the power in one line, and all of it in one that moves from 0.5 to 3 Hz."""
    broad = np.interp(TIME_S, np.arange(0.0, 61.0, 0.1), np.random.default_rng(3).standard_normal(610))
    gusts = slow_swing(1.5) | {"phi": slow_swing(1.5)["phi"] + np.radians(4.0) * broad}
    assert axes(check_oscillations(record(gusts, 50.0))) == []
    moving = np.radians(6.0) * np.sin(2.0 * np.pi * (0.5 * TIME_S + 0.5 * 2.5 / FLIGHT_S * TIME_S**2))
    assert axes(check_oscillations(record(still() | {"phi": moving}, 50.0))) == []


def test_motors_that_idle_in_a_dive_are_at_no_limit() -> None:
    """In acro the throttle is cut, all motors idle at their end, and the sticks go on."""
    dives = np.where(TIME_S % 20.0 < 9.0, 1.0, 0.0)
    sticks = 0.25 * wave(1.7)
    motors = {name: (1.0 - dives) * (0.4 + 0.5 * sign * sticks) for name, sign in (("motor_1", 1.0), ("motor_2", -1.0))}
    assert axes(check_oscillations(record(still() | {"roll_command": sticks, **motors}, 10.0))) == []


def test_a_test_input_is_no_oscillation() -> None:
    signals = swinging(9.0, amplitude=0.3, hover=0.5)
    injected = signals | {"roll_excitation": 0.3 * wave(9.0)}
    check = check_oscillations(record(injected, 400.0))
    assert check.found == ()
    assert "without tests" in check.unchecked["roll"]


def test_an_axis_that_only_shares_the_limits_is_not_named() -> None:
    signals = swinging(9.0) | {"pitch_command": 0.15 * wave(9.0, phase=0.9)}
    check = check_oscillations(record(signals, 400.0))
    assert axes(check) == ["roll"]
    assert "pitch" in check.unchecked


def test_other_vehicles_and_missing_commands_are_unchecked() -> None:
    plane = record(swinging(9.0), 400.0)
    plane = replace(plane, status=replace(plane.status, vehicle="fixed wing", named_in="MAV_TYPE 1"))
    assert set(check_oscillations(plane).unchecked) == {"roll", "pitch", "yaw"}
    without = {name: values for name, values in still().items() if name != "yaw_command"}
    assert check_oscillations(record(without, 50.0)).unchecked == {"yaw": "The log has no yaw_command."}
