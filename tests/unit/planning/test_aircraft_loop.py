"""Loops of nonlinear multirotors against their flights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.planning.plans import sweeps

from rotorid.data.flight_plan import Entry, FlightPlan
from rotorid.excitation.plan import planned, together
from rotorid.planning.aircraft import aircraft_loop
from rotorid.planning.expected import as_planned, excited_flight
from rotorid.simulation.multirotor import PERFECT
from rotorid.simulation.multirotor_flight import fly_multirotor
from rotorid.simulation.shaping import shaped_plan
from rotorid.simulation.wind import Wind
from rotorid.typing import Axis
from rotorid.vehicles import px4 as px4_quad
from rotorid.vehicles.catalog import aircraft

AIRCRAFT = px4_quad.aircraft()


@pytest.mark.parametrize(
    ("entry", "amplitude"), [("command", 0.02), ("rate_setpoint", 0.1), ("attitude_setpoint", 0.02)]
)
def test_a_quiet_flight_is_predicted_from_every_entry(entry: Entry, amplitude: float) -> None:
    plan = sweeps({"roll": amplitude}, 20.0)
    plan = FlightPlan(name=entry, inputs=tuple(replace(one, entry=entry) for one in plan.inputs), trim_s=5.0)
    loop = aircraft_loop(AIRCRAFT)
    names = ("roll_command", "p", "phi")
    found = excited_flight(loop, as_planned(plan, ["roll"], loop.log_rate_hz), names, highest_rad_s=300.0)
    flown = fly_multirotor(replace(AIRCRAFT, sensors=PERFECT), plan)
    slow = np.fft.rfftfreq(flown.samples, 1.0 / flown.sample_rate_hz) < 10.0
    slow[0] = False  # means are taken off before anything is estimated
    for name in names:
        truth, ours = (np.fft.rfft(values[: flown.samples])[slow] for values in (flown.columns[name], found[name]))
        # Each part of the cascade is of second order in the turn of 4 ms: (50 * 0.004)^2 / 12 = 0.3 %, and they add up.
        assert np.linalg.norm(ours - truth) < 0.02 * np.linalg.norm(truth)


@pytest.mark.parametrize("amplitude", [0.02, 0.5])
def test_a_quiet_flight_of_shaped_set_points_is_predicted(amplitude: float) -> None:
    craft = aircraft("ardupilot_quad")
    rate_hz = craft.autopilot.rate_hz
    asked = sweeps({"roll": amplitude}, 20.0)
    asked = FlightPlan(
        name="guided", inputs=tuple(replace(one, entry="attitude_setpoint") for one in asked.inputs), trim_s=5.0
    )
    flies = shaped_plan(asked, craft.autopilot.shaping, rate_hz)
    loop = aircraft_loop(craft, filtered=True)
    found = excited_flight(
        loop, as_planned(flies, ["roll"], rate_hz), ("roll_command", "p", "phi"), highest_rad_s=600.0
    )
    flown = fly_multirotor(replace(craft, sensors=PERFECT), asked)
    samples = min(flown.samples, found.values.shape[1])
    slow = np.fft.rfftfreq(samples, 1.0 / rate_hz) < 10.0
    slow[0] = False
    target = np.interp(found.time_s, flown.time_s, flown.columns["phi_setpoint"])
    # The target of the large sweep is at its largest acceleration most of the time, and yet it is what flies.
    assert np.abs(found["roll_excitation"] - target).max() < 0.01 * np.abs(target).max()
    for name in ("roll_command", "p", "phi"):
        truth, ours = (np.fft.rfft(values[:samples])[slow] for values in (flown.columns[name], found[name]))
        assert np.linalg.norm(ours - truth) < 0.02 * np.linalg.norm(truth)


@pytest.mark.parametrize("filtered", [True, False])
def test_a_flight_in_wind_shows_the_spectra_of_its_loop(filtered: bool) -> None:
    wind = Wind(turbulence_m_s=0.5, north_m_s=0.0)
    flown = fly_multirotor(AIRCRAFT, duration_s=120.0, wind=wind, seed=3)
    loop = aircraft_loop(AIRCRAFT, wind=wind, filtered=filtered)
    columns = flown.columns if filtered else {**flown.columns, **flown.raw}
    names = ("roll_command", "yaw_command", "p", "r", "phi", "ay", "az")
    rows = [(*loop.inputs, *loop.outputs).index(name) for name in names]
    rate_hz, taper = flown.sample_rate_hz, np.hanning(flown.samples)
    hertz = np.fft.rfftfreq(flown.samples, 1.0 / rate_hz)
    for low_hz, high_hz in ((1.0, 5.0), (5.0, 25.0)):
        band = (hertz >= low_hz) & (hertz < high_hz)
        expected = loop.logged_noise(2.0 * np.pi * hertz[band])[rows, rows].real.mean(axis=1)
        spectra = [np.fft.rfft((columns[name] - columns[name].mean()) * taper)[band] for name in names]
        found = [2.0 * np.mean(np.abs(one) ** 2) / (rate_hz * np.sum(taper**2)) for one in spectra]
        # Five standard deviations of a sum over so many lines, and 5 % for what the loop is not linear in.
        np.testing.assert_allclose(found / expected, 1.0, atol=5.0 / np.sqrt(0.5 * np.count_nonzero(band)) + 0.05)


@pytest.mark.parametrize("entry", ["command", "stick", "rate_setpoint"])
@pytest.mark.parametrize("name", ["px4_quad", "ardupilot_quad"])
def test_a_flight_answers_multisines_as_its_loop_says(name: str, entry: Entry) -> None:
    period_s = 10.0
    craft = aircraft(name)
    craft = replace(craft, sensors=replace(PERFECT, gyro_lag_s=0.002))
    loop, rate_hz = aircraft_loop(craft), craft.autopilot.rate_hz
    amplitudes: dict[Axis, float] = {"roll": 0.002, "pitch": 0.002}
    inputs = together(
        amplitudes,
        start_s=0.0,
        band_rad_s=(3.0, 60.0),
        period_s=period_s,
        sample_rate_hz=rate_hz,
        periods=3,
        entry=entry,
    )
    flown = fly_multirotor(craft, FlightPlan(name="multisine", inputs=inputs, trim_s=0.0), duration_s=3 * period_s)
    samples = round(period_s * rate_hz)
    last = slice(2 * samples, 3 * samples)
    omega = 2.0 * np.pi * np.fft.rfftfreq(samples, 1.0 / rate_hz)
    signals = flown.raw if craft.autopilot.kind == "ardupilot" else flown.columns
    for place, one in enumerate(inputs):
        asked = np.fft.rfft(one.at(flown.time_s)[last])
        lines = np.flatnonzero(np.abs(asked) > 1e-3 * np.abs(asked).max())
        command = np.fft.rfft(flown.columns[f"{one.axis}_command"][last])[lines]
        responses = loop.at(omega[lines])
        entered = np.einsum("ijf,jkf->ikf", responses.excited, loop.excitation(omega[lines], entry))[place, place]
        # What stands for turns of the loop is of second order, (60 * 0.004)^2 / 12 = 0.5 % at the highest line each.
        assert np.median(np.abs(command / asked[lines] / entered - 1.0)) < 0.01
        answer = np.fft.rfft(signals["pq"[place]][last])[lines] / command
        assert np.median(np.abs(answer / responses.plant[loop.outputs.index("pq"[place]), place] - 1.0)) < 0.01


@pytest.mark.parametrize("delay_s", [0.0, 0.0025, 0.004])
def test_rotors_without_lag_are_felt_with_the_first_tick_after_the_delay(delay_s: float) -> None:
    craft = aircraft("ardupilot_quad")
    autopilot = replace(craft.autopilot, delay_s=(delay_s,) * 4)
    craft = replace(craft, autopilot=autopilot, sensors=PERFECT)
    step = planned("thrust", "doublet", start_s=1.0, amplitude=0.05, duration_s=1.0, sample_rate_hz=400.0)
    flown = fly_multirotor(craft, FlightPlan(name="step", inputs=(step,), trim_s=1.0))
    command, felt = (np.abs(np.diff(row)) for row in (flown.columns["thrust_command"], flown.raw["az"]))
    ticks = int(np.argmax(felt > 0.1)) - int(np.argmax(command > 0.01))
    omega = np.array([20.0, 40.0])
    loop = aircraft_loop(craft)
    answer = loop.at(omega).plant[loop.outputs.index("az"), 3]
    # Heave damping adds a lead of 0.24/w rad, less than 0.7 degrees.
    assert -np.angle(-answer) / omega * 400.0 == pytest.approx(ticks, abs=0.25)
