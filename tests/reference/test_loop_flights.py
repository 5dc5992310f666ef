"""Loops of simulated flights of real autopilots, against the plant, the filters and the gains in the log.

What is stated with a margin (random error and the smooth model error of a loop) is what it is off by: the bars are
deviations, not percents.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from scipy.optimize import brentq

import rotorid
from rotorid.autopilots.filters import combined_response
from rotorid.data.record import FlightRecord, TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.errors import InsufficientDataError
from rotorid.flights.controllers import controllers_of, logged_controller
from rotorid.io.parameters import parameters_changed
from rotorid.loops.rate_loops import MODEL_ERROR
from rotorid.loops.responses import Responses
from rotorid.models.controller import RateController
from rotorid.signal.clock import resample
from rotorid.spectral.derived import with_model_error
from rotorid.spectral.estimate import frequency_response
from rotorid.spectral.loops import error_loop, feedback_controller, injected_loop, sensitivity, series
from rotorid.spectral.margins import attitude_bandwidth, disturbance_rejection, loop_margins
from rotorid.typing import ComplexArray, FloatArray

OMEGA = np.geomspace(0.7, 120.0, 60)
WINDOWS_S = (20.0, 12.0, 7.0, 4.0, 3.0)

ARDUPILOT = (
    ("x_calm_roll.BIN", "roll", "p", ((94.85, 186.33), (203.40, 264.90)), 1.987),
    ("x_wind_rollpitch.BIN.xz", "roll", "p", ((94.80, 176.29),), 2.15),
    ("x_wind_rollpitch.BIN.xz", "pitch", "q", ((194.40, 275.89),), 2.15),
)
ONE_LOOP_S = 1.0 / 400.0


class Measured(NamedTuple):
    """A loop as measured, and what plant and controller make of it: the plant as the flight shows it, and as known."""

    loop: FrequencyResponse
    of_plant: ComplexArray
    of_truth: ComplexArray

    def share(self, expected: ComplexArray) -> float:
        """Mean of the logarithm of measured over expected gain, weighed by what is stated."""
        seen = self.loop.omega_rad_s > 1.5
        weight = 1.0 / self.loop.random_error[0, 0] ** 2
        error = np.log(np.abs(self.loop.values[0, 0] / expected))
        return float(np.sum((weight * error)[seen]) / np.sum(weight[seen]))


@pytest.fixture(scope="module", params=ARDUPILOT, ids=lambda case: f"{case[0].split('.')[0]}-{case[1]}")
def ardupilot(request: pytest.FixtureRequest, unpacked: Callable[[str], Path]) -> Measured:
    log, axis, output, intervals, damping_1_s = request.param
    record = rotorid.read(unpacked(f"ardupilot_sitl/{log}"))
    channels = (f"{axis}_command", f"{axis}_excitation", output)
    histories = [
        resample(record, channels=channels, start_s=start_s, stop_s=stop_s, sample_rate_hz=200.0).histories[0]
        for start_s, stop_s in intervals
    ]
    grid = {"omega_rad_s": OMEGA, "windows_s": WINDOWS_S}
    loop = injected_loop(histories, command=channels[0], excitation=channels[1], injection_delay_s=ONE_LOOP_S, **grid)
    plant = frequency_response(histories, inputs=[channels[0]], outputs=[output], instruments=[channels[1]], **grid)
    source = next(channel.source for channel in histories[0].channels if channel.name == output)
    controller = logged_controller(record, channels[0], source=source)
    assert controller is not None
    omega = loop.omega_rad_s
    C = controller.response(omega)
    known = 437.2 / (1j * omega + damping_1_s) * np.exp(-2.45e-3j * omega)
    return Measured(with_model_error(loop, MODEL_ERROR), plant.values[0, 0] * C, known * C)


def test_ardupilot_loop_is_plant_times_controller(ardupilot: Measured) -> None:
    # The plant of the same flight: gusts and what it does beside the model are in both, the controller is what is left.
    assert abs(ardupilot.share(ardupilot.of_plant)) < 0.005
    error = np.log(ardupilot.loop.values[0, 0] / ardupilot.of_plant) / ardupilot.loop.random_error[0, 0]
    # The last points hold the end of the chirp, which is stated nowhere.
    inside = ardupilot.loop.omega_rad_s < 100.0
    for part in (error.real, error.imag):
        assert np.sqrt(np.mean(part[inside] ** 2)) < 1.3
    # The gain of the plant itself is known to a percent: the estimate of the battery moves it.
    assert abs(ardupilot.share(ardupilot.of_truth)) < 0.01


def test_ardupilot_with_one_filter_in_front_of_both_loops_is_three_percent_off(
    ardupilot: Measured, unpacked: Callable[[str], Path]
) -> None:
    record = rotorid.read(unpacked("ardupilot_sitl/x_calm_roll.BIN"))
    own = logged_controller(record, "roll_command", source="SIDD.Gx")
    assert own is not None
    omega = ardupilot.loop.omega_rad_s
    seen = combined_response(own.filters, omega)
    both = seen * own.controller.response(omega) / own.controller.response(omega, seen)
    assert ardupilot.share(ardupilot.of_plant * both) > 0.02


def test_ardupilot_test_signal_enters_one_loop_after_it_is_logged(ardupilot: Measured) -> None:
    loop, truth = ardupilot.loop, ardupilot.of_plant
    high = loop.omega_rad_s > 50.0
    as_logged = (1.0 + loop.values[0, 0]) * np.exp(1j * loop.omega_rad_s * ONE_LOOP_S) - 1.0
    late = np.angle(loop.values[0, 0] / truth)[high]
    uncorrected = np.angle(as_logged / truth)[high]
    assert np.sqrt(np.mean(late**2)) < 0.2 * np.sqrt(np.mean(uncorrected**2))


def test_ardupilot_rejection_bandwidth_is_right_within_what_is_stated(ardupilot: Measured) -> None:
    found = disturbance_rejection(sensitivity(ardupilot.loop)).bandwidth_rad_s
    assert found is not None
    for expected in (ardupilot.of_plant, ardupilot.of_truth):
        exact = disturbance_rejection(sensitivity(replace(ardupilot.loop, values=expected[None, None]))).bandwidth_rad_s
        assert exact is not None
        assert abs(found.value - exact.value) < 3.0 * found.std
    # Half a percent of gain moves it by 0.23 rad/s: nothing narrower is stated, nor anything that says little.
    assert 0.25 < found.std < 0.6


def test_ardupilot_gain_margin_is_beyond_the_chirp(ardupilot: Measured) -> None:
    margins = loop_margins(ardupilot.loop)
    assert margins.gain_margin_up is None
    assert margins.not_seen["gain_margin_up"].startswith("no crossing of −180° with a gain below one in 0.7 to 1")
    assert all(crossover.omega_rad_s.value > 110.0 for crossover in margins.gain_crossovers)


PX4_OMEGA = np.geomspace(0.7, 60.0, 40)
PX4 = {"omega_rad_s": PX4_OMEGA, "windows_s": WINDOWS_S}


@pytest.fixture(scope="module")
def px4(unpacked: Callable[[str], Path]) -> tuple[FlightRecord, list[TimeHistory]]:
    record = rotorid.read(unpacked("px4_sitl/roll.ulg"))
    histories = resample(
        record,
        channels=("roll_command", "p"),
        auxiliary=("roll_stick", "p_setpoint"),
        start_s=40.54,
        stop_s=122.54,
    ).histories
    return record, list(histories)


def px4_controller(record: FlightRecord) -> RateController:
    """The controller of roll as everything takes it from a log: by the firmware that its commands show."""
    found = controllers_of(record).axis("roll")
    assert found is not None
    return found.controller


def px4_plant(omega_rad_s: FloatArray) -> ComplexArray:
    s = 1j * omega_rad_s
    return 113.1 / ((0.048 * s + 1.0) * (s + 1.0)) * np.exp(-5.3e-3 * s)


def test_px4_plant_with_its_gains_makes_the_rate_loop(
    px4: tuple[FlightRecord, list[TimeHistory]],
) -> None:
    record, histories = px4
    controller = px4_controller(record)
    plant = frequency_response(histories, inputs=["roll_command"], outputs=["p"], instruments=["roll_stick"], **PX4)
    C = controller.rate_loop.response(plant.omega_rad_s)
    loop = series(plant, C)
    margins = loop_margins(loop)
    exact = px4_plant(loop.omega_rad_s) * C
    crossover = math.exp(np.interp(0.0, -np.log(np.abs(exact)), np.log(loop.omega_rad_s)))
    phase_margin = math.pi + np.interp(crossover, loop.omega_rad_s, np.unwrap(np.angle(exact)))
    (found,) = margins.gain_crossovers
    assert abs(found.omega_rad_s.value - crossover) < 2.0 * found.omega_rad_s.std
    assert abs(found.phase_margin_rad.value - phase_margin) < 2.0 * found.phase_margin_rad.std
    assert margins.gain_margin_up is None


def test_px4_error_is_not_all_that_the_controller_sees(
    px4: tuple[FlightRecord, list[TimeHistory]],
) -> None:
    record, histories = px4
    controller = px4_controller(record)
    found = error_loop(histories, setpoint="p_setpoint", output="p", instrument="roll_stick", **PX4)
    omega = found.omega_rad_s
    s = 1j * omega
    derivative = controller.derivative_s2 * s / (1.0 + s / (2.0 * math.pi * controller.derivative_cutoff_hz))
    G, C = px4_plant(omega), controller.rate_loop.response(omega)
    low = (omega > 1.5) & (omega < 15.0)
    answer = found.values[0, 0]
    # PX4 takes the derivative of the rate alone: the answer is the loop of the plant with that derivative around it.
    assert np.abs(np.abs(answer / ((C - derivative) * G / (1.0 + derivative * G))) - 1.0)[low].max() < 0.1
    assert np.abs(answer / (C * G))[low].max() < 0.85


def test_px4_controller_cannot_be_read_from_a_calm_flight(
    px4: tuple[FlightRecord, list[TimeHistory]],
) -> None:
    histories = px4[1]
    slow = np.geomspace(1.0, 10.0, 12)
    with pytest.raises(InsufficientDataError, match="p_setpoint and p have a coherence"):
        feedback_controller(
            histories,
            setpoint="p_setpoint",
            output="p",
            command="roll_command",
            omega_rad_s=slow,
            windows_s=WINDOWS_S,
        )


def test_px4_attitude_bandwidth_is_that_of_its_loops_behind_a_late_stick(unpacked: Callable[[str], Path]) -> None:
    record = rotorid.read(unpacked("px4_sitl/roll.ulg"))
    controller = px4_controller(record)
    histories = resample(
        record, channels=("roll_command", "phi"), auxiliary=("roll_stick",), start_s=40.54, stop_s=122.54
    ).histories
    quality = attitude_bandwidth(frequency_response(histories, inputs=["roll_stick"], outputs=["phi"], **PX4))
    assert quality.omega_180_rad_s is not None
    assert quality.phase_bandwidth_rad_s is not None
    assert quality.phase_delay_s is not None
    # Sticks come at 100 Hz: up to two of their periods are lost before the loops see them. One delay explains it all.
    late_s = brentq(lambda d: px4_attitude(controller, d)[0] - quality.omega_180_rad_s.value, 0.0, 0.020)
    _, bandwidth, delay_s = px4_attitude(controller, late_s)
    assert abs(quality.phase_bandwidth_rad_s.value - bandwidth) < 2.0 * quality.phase_bandwidth_rad_s.std
    assert abs(quality.phase_delay_s.value - delay_s) < 3.0 * quality.phase_delay_s.std
    assert quality.fitted_phase_delay_s is not None
    assert quality.fitted_phase_delay_s.value == pytest.approx(quality.phase_delay_s.value, rel=0.1)


def px4_attitude(controller: RateController, late_s: float) -> tuple[float, float, float]:
    """Frequencies of −180° and −135°, and phase delay, of rate loop and attitude loop around the simulator's plant."""
    omega = np.geomspace(0.7, 60.0, 4000)
    s = 1j * omega
    derivative = controller.derivative_s2 * s / (1.0 + s / (2.0 * math.pi * controller.derivative_cutoff_hz))
    G, C = px4_plant(omega), controller.rate_loop.response(omega)
    forward = controller.angle_1_s * (C - derivative) * G
    phase = np.unwrap(np.angle(forward / (s * (1.0 + C * G) + forward) * np.exp(-s * late_s)))
    half_turn, limit = (float(np.interp(level, -phase, omega)) for level in (math.pi, 0.75 * math.pi))
    twice = float(np.interp(2.0 * half_turn, omega, phase))
    return half_turn, limit, -(twice + math.pi) / (2.0 * half_turn)


@pytest.fixture(scope="module")
def in_wind(unpacked: Callable[[str], Path]) -> tuple[FlightRecord, Responses]:
    record = rotorid.read(unpacked("ardupilot_sitl/x_wind_rollpitch.BIN.xz"))
    return record, rotorid.response([record], inputs="roll_command", outputs="p")


def test_a_margin_at_the_edge_of_the_band_is_a_bound_and_a_finding(
    in_wind: tuple[FlightRecord, Responses],
) -> None:
    loop = in_wind[1].loops["roll"]
    peak = loop.bounds["disturbance_rejection_peak"]
    assert peak.at_least
    assert 20.0 * math.log10(peak.value) > 4.0
    assert not loop.bounds["phase_margin_rad"].at_least
    (finding,) = (each for each in in_wind[1].findings if each.kind == "margin_beyond_band")
    assert finding.severity == "warning"
    assert "at least" in finding.message
    assert "rising" in finding.message
    # Neither a bound nor what a model says beyond it goes without its error.
    assert finding.message.count("±") == 2 * len(
        loop.bounds.keys() & {"disturbance_rejection_peak", "phase_margin_rad"}
    )


def test_beyond_the_band_model_times_controller_goes_on(in_wind: tuple[FlightRecord, Responses]) -> None:
    record, result = in_wind
    beyond = result.loops["roll"].beyond
    assert beyond is not None
    controller = logged_controller(record, "roll_command", source="SIDD.Gx")
    assert controller is not None
    omega = np.geomspace(60.0, 400.0, 4000)
    exact = 437.2 / (1j * omega + 2.15) * np.exp(-2.45e-3j * omega) * controller.response(omega)
    crossover = float(np.interp(0.0, -np.log(np.abs(exact)), omega))
    truth = {
        "crossover_rad_s": crossover,
        "phase_margin_rad": math.pi + float(np.interp(crossover, omega, np.unwrap(np.angle(exact)))),
        "modulus_margin": float(np.abs(1.0 + exact).min()),
        "disturbance_rejection_peak_omega_rad_s": float(omega[np.abs(1.0 + exact).argmin()]),
    }
    for name, value in truth.items():
        number = beyond.numbers[name]
        assert abs(number.value - value) < 2.0 * number.std, name
    assert not set(beyond.numbers) & set(result.loops["roll"].numbers)


def test_no_loop_is_computed_of_gains_that_changed_in_the_log(px4: tuple[FlightRecord, list[TimeHistory]]) -> None:
    record, _ = px4
    options = {"inputs": ["roll_command"], "outputs": ["p"]}
    assert "gains in the log" in rotorid.response(record, **options).loops["roll"].method
    changed = parameters_changed({"MC_ROLLRATE_P": (0.1, 0.15)}, "Parameters changed in the log")
    told = rotorid.response(replace(record, findings=(*record.findings, changed)), **options)
    assert told.loops["roll"].loop is None
    assert "the gains changed in the log" in told.loops["roll"].method
    assert "parameters_changed" in {finding.kind for finding in told.findings}
