"""Sensors of a simulated vehicle: noise, bias, lag, steps, lever arm, vibration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from tests.unit.simulation import craft

from rotorid.data.flight_plan import FlightPlan, PlannedInput, SimulatedFlight
from rotorid.errors import UsageError
from rotorid.simulation.multirotor import PERFECT, Sensors
from rotorid.simulation.multirotor_flight import Aircraft, fly_multirotor
from rotorid.typing import Axis, FloatArray

TURNED: tuple[Axis, ...] = ("roll", "pitch", "yaw")
RATES, FORCES = ("p", "q", "r"), ("ax", "ay", "az")


def flown(sensors: Sensors, *, rate_hz: float = 1000.0, moving: bool = True, seed: int = 0) -> SimulatedFlight:
    """A flight of six seconds that rolls and pitches and yaws, where it is asked to move."""
    values = 0.1 * np.sin(2.0 * np.pi * np.outer((0.7, 1.1, 0.4), np.arange(0.0, 6.0, 0.005)))
    inputs = tuple(
        PlannedInput(
            axis=axis, shape="multisine", start_s=0.0, values=one, sample_rate_hz=200.0, amplitude=0.1, entry="stick"
        )
        for axis, one in zip(TURNED, values, strict=True)
    )
    # The position is not held: it would bring the noise of its sensors into the motion.
    autopilot = craft.autopilot("simple", rate_hz=rate_hz, guidance=replace(craft.HOLDING, hold_velocity=False))
    plan = FlightPlan(name="moving", inputs=inputs, trim_s=0.0) if moving else None
    aircraft = Aircraft(vehicle=craft.vehicle(), autopilot=autopilot, sensors=sensors)
    return fly_multirotor(aircraft, plan, duration_s=6.0, settle_s=1.0, seed=seed)


def table(flight: SimulatedFlight, where: str, names: tuple[str, ...]) -> FloatArray:
    return np.stack([getattr(flight, where)[name] for name in names])


def test_perfect_sensors_read_the_truth() -> None:
    flight = flown(PERFECT)
    for names in (RATES, FORCES):
        np.testing.assert_array_equal(table(flight, "raw", names), table(flight, "truth", names))
    np.testing.assert_allclose(flight.columns["phi"], flight.truth["phi"], atol=1e-14)
    np.testing.assert_array_equal(flight.columns["velocity_north"], flight.truth["velocity_north"])


def test_biases() -> None:
    gyro, force = (0.01, -0.02, 0.03), (0.1, -0.2, 0.3)
    flight = flown(replace(PERFECT, gyro_bias_rad_s=gyro, accelerometer_bias_m_s2=force))
    for names, bias in ((RATES, gyro), (FORCES, force)):
        off = table(flight, "raw", names) - table(flight, "truth", names)
        np.testing.assert_allclose(off, np.tile(np.array(bias)[:, None], off.shape[1]), atol=1e-13)


def test_noise_has_its_deviation_and_is_white() -> None:
    flight = flown(replace(PERFECT, gyro_noise_rad_s=0.005, accelerometer_noise_m_s2=0.08, velocity_noise_m_s=0.02))
    samples = flight.samples
    rates = table(flight, "raw", RATES) - table(flight, "truth", RATES)
    forces = table(flight, "raw", FORCES) - table(flight, "truth", FORCES)
    sinking = flight.columns["velocity_down"] - flight.truth["velocity_down"]
    for noise, size in ((rates, 0.005), (forces, 0.08), (sinking[None, :], 0.02)):
        assert np.all(np.abs(noise.std(axis=1) / size - 1.0) < 4.0 / np.sqrt(2.0 * samples))
        following = np.mean(noise[:, 1:] * noise[:, :-1], axis=1) / size**2
        assert np.all(np.abs(following) < 4.0 / np.sqrt(samples))


def test_noise_of_the_attitude_is_that_of_small_turns() -> None:
    flight = flown(replace(PERFECT, attitude_noise_rad=0.002), moving=False)
    off = np.stack([flight.columns[name] - flight.truth[name] for name in ("phi", "theta", "psi")])
    assert np.all(np.abs(off.std(axis=1) / 0.002 - 1.0) < 4.0 / np.sqrt(2.0 * flight.samples) + 0.005)


@pytest.mark.parametrize("lag_s", [0.0007, 0.003, 0.02])
def test_lag_of_the_gyroscope(lag_s: float) -> None:
    flight = flown(replace(PERFECT, gyro_lag_s=lag_s))
    time_s, step_s = flight.time_s, 1e-3
    # The exact answer of a lag to the true rates: each tick a quadrature over their spline.
    nodes, weights = np.polynomial.legendre.leggauss(8)
    inside = 0.5 * step_s * (nodes + 1.0)
    fading = 0.5 * step_s * weights * np.exp(-(step_s - inside) / lag_s) / lag_s
    for name in RATES:
        spline = CubicSpline(time_s, flight.truth[name])
        felt = np.empty(flight.samples)
        felt[0] = flight.raw[name][0]
        arriving = spline(time_s[:-1, None] + inside) @ fading
        for k in range(1, flight.samples):
            felt[k] = np.exp(-step_s / lag_s) * felt[k - 1] + arriving[k - 1]
        off = np.abs(flight.raw[name] - felt)[100:]
        late = np.abs(flight.raw[name] - flight.truth[name]).max()
        # Rates have a kink in their second derivative each time a command arrives, which a spline rounds off.
        assert off.max() < 2e-3 * late


def test_quantization() -> None:
    steps = {"p": 0.001, "az": 0.0005}
    flight = flown(replace(PERFECT, gyro_step_rad_s=steps["p"], accelerometer_step_m_s2=steps["az"]))
    for name, step in steps.items():
        counts = flight.raw[name] / step
        np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
        assert len(np.unique(np.round(counts))) > 10
        assert np.abs(flight.raw[name] - flight.truth[name]).max() <= 0.5 * step * (1.0 + 1e-9)


def test_an_accelerometer_away_from_the_center_feels_the_turning() -> None:
    place = np.array([0.08, -0.05, 0.06])
    x, y, z = (float(one) for one in place)
    flight = flown(replace(PERFECT, accelerometer_place_m=(x, y, z)))
    rates = table(flight, "truth", RATES).T
    spline = CubicSpline(flight.time_s, rates)
    motor_speed = spline(flight.time_s, 1)
    wanted = np.cross(motor_speed, place) + np.cross(rates, np.cross(rates, place))
    off = (table(flight, "raw", FORCES) - table(flight, "truth", FORCES)).T
    # The slope of a spline is off by a share of the jumps of the true one, which follow the commands.
    assert np.abs(off - wanted)[50:-50].max() < 0.01 * np.abs(wanted).max()


def test_vibration_folds_down() -> None:
    share = float(craft.vehicle().hover_shares.mean())
    full = 2.0 * np.pi * 180.0 / share
    flight = flown(replace(PERFECT, gyro_vibration_rad_s=0.02, rotor_speed_rad_s=full), rate_hz=250.0, moving=False)
    shaking = flight.raw["p"] - flight.truth["p"]
    density = np.abs(np.fft.rfft(shaking * np.hanning(shaking.size)))
    peak = np.fft.rfftfreq(shaking.size, 1.0 / 250.0)[density.argmax()]
    # Rotors of a vehicle off its center turn a little faster and slower than their mean.
    spread = 180.0 * float(np.ptp(craft.vehicle().hover_shares)) / share
    assert peak == pytest.approx(250.0 - 180.0, abs=spread + 1.0)
    assert np.abs(shaking).max() <= 0.02 * 4 * 1.1 * share**2


def test_sensors_that_cannot_be() -> None:
    with pytest.raises(UsageError, match="gyro_noise_rad_s"):
        Sensors(gyro_noise_rad_s=-1.0)
