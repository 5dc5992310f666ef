"""Filters proposed from spectra, flown again: what they save and cost is what was predicted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.twins.filter_flights import SOURCES, Craft, fly, turns_hz

from rotorid.autopilots.notches import SPECTRUM as SPECTRUM_UNKNOWN
from rotorid.autopilots.notches import Motion
from rotorid.autopilots.registry import autopilot_of
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.flights.controllers import controllers_of
from rotorid.flights.filter_effects import filtered_density, phase_cost, with_parameters
from rotorid.flights.gyro_noise import gyro_noise
from rotorid.loops.filter_choice import FilterProposal, KnownLoop, filter_sets, propose_filters, verdict_with
from rotorid.tuning import uncertain_plant
from rotorid.typing import Axis, ComplexArray, FloatArray

CROSSOVER_RAD_S = 25.0
STEMS = {"roll": "RLL", "pitch": "PIT"}
ARDUPILOT = Craft(
    format="ArduPilot DataFlash",
    firmware="ArduCopter V4.6.2",
    sensor_hz=1000.0,
    log_hz=500.0,
    parameters={
        **{
            f"ATC_RAT_{stem}_{name}": value
            for stem in STEMS.values()
            for name, value in {"P": 0.12, "I": 0.12, "D": 0.003, "FLTD": 20.0, "FLTT": 20.0, "FLTE": 0.0}.items()
        },
        **{f"ATC_ANG_{stem}_P": 4.5 for stem in STEMS.values()},
        "INS_GYRO_FILTER": 60.0,
        "INS_HNTCH_ENABLE": 0.0,
        "INS_HNTC2_ENABLE": 0.0,
        "SCHED_LOOP_RATE": 500.0,
    },
)
PX4 = Craft(
    format="PX4 ULog",
    firmware="PX4 1.15.4",
    sensor_hz=8000.0,
    log_hz=1000.0,
    parameters={
        **{
            f"MC_{axis}RATE_{name}": value
            for axis in ("ROLL", "PITCH")
            for name, value in {"P": 0.12, "I": 0.12, "D": 0.003, "K": 1.0}.items()
        },
        "MC_ROLL_P": 4.5,
        "MC_PITCH_P": 4.5,
        "IMU_GYRO_CUTOFF": 60.0,
        "IMU_DGYRO_CUTOFF": 30.0,
        "IMU_GYRO_RATEMAX": 1000.0,
        "IMU_GYRO_DNF_EN": 0.0,
        "IMU_GYRO_DNF_BW": 15.0,
        "IMU_GYRO_DNF_HMC": 3.0,
        "IMU_GYRO_DNF_MIN": 25.0,
        "IMU_GYRO_NF0_FRQ": 0.0,
        "IMU_GYRO_NF0_BW": 20.0,
    },
)
BETAFLIGHT = Craft(
    format="Betaflight blackbox",
    firmware="Betaflight 4.5.1",
    sensor_hz=4000.0,
    log_hz=1000.0,
    parameters={
        **{f"{axis}PID_{name}": value for axis in STEMS for name, value in {"P": 45.0, "I": 80.0, "D": 30.0}.items()},
        "levelPID_P": 50.0,
        "looptime": 250.0,
        "pid_process_denom": 1.0,
        "dshot_bidir": 1.0,
        "rpm_filter_harmonics": 0.0,
        "rpm_filter_q": 500.0,
        "rpm_filter_min_hz": 100.0,
        "gyro_lpf1_type": 0.0,
        "gyro_lpf1_static_hz": 250.0,
        "gyro_lpf1_dyn_hz_0": 0.0,
        "gyro_lpf2_type": 0.0,
        "gyro_lpf2_static_hz": 500.0,
        "gyro_notch_hz_0": 0.0,
        "gyro_notch_cutoff_0": 0.0,
        "dterm_lpf1_type": 0.0,
        "dterm_lpf1_static_hz": 75.0,
        "dterm_lpf2_type": 0.0,
        "dterm_lpf2_static_hz": 150.0,
    },
)
CRAFTS = {"PX4": PX4, "ArduPilot": ARDUPILOT, "Betaflight": BETAFLIGHT}
LETTERS = {"ArduPilot": ("R", "P")}


def vehicle(w: FloatArray, late_s: float = 0.004) -> ComplexArray:
    return np.asarray(60.0 / ((0.03j * w + 1.0) * (1j * w + 0.5)) * np.exp(-1j * late_s * w))


def loops_of(name: str, *, late_s: float = 0.004, gain: float = 1.0) -> dict[Axis, KnownLoop]:
    letters = LETTERS.get(name, (0, 1))
    plant = uncertain_plant(lambda w: gain * vehicle(w, late_s), None, band_rad_s=(1.0, 150.0), draws=40)
    source = SOURCES[CRAFTS[name].format]
    axes: tuple[Axis, ...] = ("roll", "pitch")
    return {
        axis: KnownLoop(plant=plant, source=source.format(letter), crossover_rad_s=CROSSOVER_RAD_S)
        for axis, letter in zip(axes, letters, strict=True)
    }


SPECTRUM = {
    "INS_HNTCH_ENABLE": 1.0,
    "INS_HNTCH_MODE": 4.0,
    "INS_HNTCH_REF": 1.0,
    "INS_HNTCH_FREQ": 60.0,
    "INS_HNTCH_BW": 30.0,
    "INS_HNTCH_ATT": 40.0,
    "INS_HNTCH_HMNCS": 3.0,
    "INS_HNTCH_OPTS": 0.0,
}
"""A notch of ArduPilot that follows the spectrum."""


def test_a_notch_by_the_spectrum_counts_where_its_centers_are_logged() -> None:
    """A wider one costs the phase of the notch at the mean speed, moment by moment, and passes that much less noise."""
    craft = replace(ARDUPILOT, centers=True, speeds=False)
    record = fly(craft, seconds=15.0, **SPECTRUM)
    noise, wider = gyro_noise(record), with_parameters(record, {"INS_HNTCH_BW": 60.0})
    cost = phase_cost(record, wider, noise, "roll", CROSSOVER_RAD_S, flown=controllers_of(record))
    omega = np.array([CROSSOVER_RAD_S])
    turns = turns_hz(np.interp(noise.time_s, record["motor_1"].time_s, record["motor_1"].values), craft)
    true = [
        autopilot_of(one).log.moving_notches(one, Motion(None, None, turns.mean(axis=0)[None]))
        for one in (record, wider)
    ]
    angles = np.degrees(np.angle(true[0].response(omega) / true[1].response(omega)))[:, 0]
    assert 1.0 < cost.value == pytest.approx(float(np.median(angles)), rel=0.02)
    again = fly(craft, seed=2, seconds=15.0, **{**SPECTRUM, "INS_HNTCH_BW": 60.0})
    powers = [filter_sets(one, gyro_noise(one), {})[0] for one in (record, again)]
    foretold = filtered_density(record, wider, noise)["p"].mean(axis=0)
    measured = gyro_noise(again).density["p"].mean(axis=0)
    lines = (noise.frequency_hz > 90.0) & (noise.frequency_hz < 180.0)
    assert powers[1].rms < powers[0].rms
    assert foretold[lines].sum() == pytest.approx(measured[lines].sum(), rel=0.25)


def test_a_notch_by_the_spectrum_without_logged_centers_is_not_called_checked() -> None:
    record = fly(replace(ARDUPILOT, speeds=False, tones=(0.002,), white=0.0007), seconds=15.0, **SPECTRUM)
    found = propose_filters(record, gyro_noise(record), loops_of("ArduPilot"))
    assert found.unseen == SPECTRUM_UNKNOWN
    logged = fly(replace(ARDUPILOT, centers=True, tones=(0.002,), white=0.0007), seconds=15.0, **SPECTRUM)
    assert not propose_filters(logged, gyro_noise(logged), loops_of("ArduPilot")).unseen


def proposal(name: str, craft: Craft, **known: float) -> tuple[FlightRecord, FilterProposal]:
    record = fly(craft, seconds=20.0)
    return record, propose_filters(record, gyro_noise(record), loops_of(name, **known))


@pytest.mark.parametrize("name", ["ArduPilot", "Betaflight"])
def test_a_notch_that_follows_the_motors_saves_what_was_predicted(name: str) -> None:
    """The second flight has other noise, other throttles and the proposed filters, sample by sample."""
    craft = CRAFTS[name]
    record, found = proposal(name, craft)
    assert found.need == "noise"
    assert {part.group for part in found.parts} >= {"moving notch"}
    assert found.saves_percent.value > 40.0

    again = fly(craft, seed=2, seconds=20.0, **found.proposed.values)
    before, after = (filter_sets(one, gyro_noise(one), {})[0] for one in (record, again))
    measured = after.saves_over(before)
    assert found.saves_percent.lower - 2.0 * measured.std <= measured.value
    assert measured.value <= found.saves_percent.upper + 2.0 * measured.std


def test_the_phase_of_moving_notches_is_that_of_the_firmware() -> None:
    """A tone at the crossover through the filters as they run, sample by sample."""
    _, found = proposal("ArduPilot", ARDUPILOT)
    tone = replace(ARDUPILOT, tones=(), white=0.0)
    flown, then = (fly(tone, **values) for values in ({}, dict(found.proposed.values)))
    rates = [record["p"].values[2000:] for record in (flown, then)]
    time_s = flown["p"].time_s[2000:]
    # The motion is common to both: the phase of the ratio at the crossover, from many windows.
    size = 1500
    spectra = [
        np.stack([np.fft.rfft(rate[k : k + size] * np.hanning(size)) for k in range(0, rate.size - size, size // 2)])
        for rate in rates
    ]
    hz = np.fft.rfftfreq(size, float(np.median(np.diff(time_s))))
    at = int(np.argmin(np.abs(hz - CROSSOVER_RAD_S / 2.0 / np.pi)))
    cross = np.sum(spectra[0][:, at].conj() * spectra[1][:, at])
    gyro_deg = -np.degrees(np.angle(cross))
    moving = next(part for part in found.parts if part.group == "moving notch")
    scale = CROSSOVER_RAD_S / (2.0 * np.pi * hz[at])
    assert moving.costs_deg.lower - 0.3 <= gyro_deg * scale <= moving.costs_deg.upper + 0.3


@pytest.mark.parametrize("name", list(CRAFTS))
def test_a_clean_vehicle_keeps_its_filters(name: str) -> None:
    clean = replace(CRAFTS[name], tones=(0.002,), white=0.0007)
    _, found = proposal(name, clean)
    assert not found.changed
    assert found.need != "noise", found.rms
    assert found.saves_percent.value == 0.0
    assert found.offered


@pytest.mark.parametrize("name", list(CRAFTS))
def test_a_resonance_gets_a_fixed_notch_where_it_is(name: str) -> None:
    ringing = replace(CRAFTS[name], tones=(), frame_hz=74.0, frame=0.6, speeds=False)
    _, found = proposal(name, ringing)
    (part,) = (part for part in found.parts if part.group == "fixed notch")
    center = next(after for name, (_, after) in part.values.items() if name.endswith(("FRQ", "FREQ", "hz_0")))
    assert center == pytest.approx(74.0, abs=3.0)
    assert part.saves_percent.lower > 10.0


def test_a_slow_log_is_no_good_news() -> None:
    slow = replace(ARDUPILOT, log_hz=50.0)
    with pytest.raises(InsufficientDataError, match="logged at 50 Hz, too slow for the noise of the motors") as error:
        gyro_noise(fly(slow))
    assert error.value.remedy


def test_rotors_above_the_log_are_not_judged() -> None:
    """Half of the rate of the log lies below the first line of the rotors: it would be seen where nothing vibrates."""
    fast = replace(BETAFLIGHT, log_hz=250.0)
    with pytest.raises(InsufficientDataError, match="logged at 250 Hz"):
        gyro_noise(fly(fast))


def test_filters_that_break_margins_are_not_proposed() -> None:
    """The same noise around a loop with little reserve: nothing that takes more of it may be flown."""
    tight = loops_of("ArduPilot", late_s=0.017, gain=4.5)
    record = fly(ARDUPILOT, seconds=20.0)
    noise = gyro_noise(record)
    found = propose_filters(record, noise, tight)
    for axis, loop in tight.items():
        before = verdict_with(record, axis, loop, {})
        assert before.verdict == "do_not_fly"
        assert found.verdicts[axis].refused_peak <= 1.02 * before.refused_peak
        lag = {"INS_GYRO_FILTER": 30.0}
        assert verdict_with(record, axis, loop, lag).refused_peak > 1.02 * before.refused_peak


def test_unknown_loops_propose_nothing() -> None:
    record = fly(ARDUPILOT)
    with pytest.raises(InsufficientDataError, match="phase that a filter may cost is not known"):
        propose_filters(record, gyro_noise(record), {})


def test_filters_are_not_proposed_for_half_of_the_vehicle() -> None:
    """They act on pitch too, and nobody knows what it can bear."""
    record = fly(ARDUPILOT, seconds=15.0)
    loops: dict[Axis, KnownLoop] = {"roll": loops_of("ArduPilot")["roll"]}
    with pytest.raises(InsufficientDataError, match="act on pitch too"):
        propose_filters(record, gyro_noise(record), loops)


@pytest.mark.parametrize("name", list(CRAFTS))
def test_moving_notches_are_zero_where_the_motors_are(name: str) -> None:
    craft = CRAFTS[name]
    throttle = np.array([0.2, 0.5])
    motion = Motion(turns_hz(throttle, craft), throttle)
    record = fly(replace(craft, tones=()), seconds=10.0)
    changes = autopilot_of(record).log.filter_changes(record, gyro_noise(fly(craft)).lines)
    first = next(change for change in changes if change.group == "moving notch")
    then = with_parameters(record, first.values)
    notches = autopilot_of(then).log.moving_notches(then, motion)
    for row, hz in enumerate(motion.speeds_hz.T if motion.speeds_hz is not None else ()):
        left = np.abs(notches.response(2.0 * np.pi * hz)[row])
        assert left.max() < 0.02
