"""Loops as frequency responses: algebra, folding, and the spectra that a simulated flight shows."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.data.flight_plan import Entry
from rotorid.data.record import Maneuver
from rotorid.errors import UsageError
from rotorid.models.controller import RateController
from rotorid.models.library import rate_model
from rotorid.planning.loop import LoopModel, Noise, White, axis_loop, loop_model, vehicle_loop
from rotorid.simulation.hover_flight import Excitation, fly
from rotorid.typing import FloatArray
from rotorid.vehicles import s500

OMEGA = np.geomspace(0.3, 300.0, 40)
ROLL = {"L_roll": 80.0, "L_p": -4.0, "T_motor": 0.05, "tau_roll": 0.006}
WHITE = White(std=(0.02,), sample_rate_hz=200.0)


def test_one_axis_is_closed_as_on_paper() -> None:
    structure, controller = rate_model("rate.roll"), RateController(proportional_s=0.08, integral=0.1)
    found = axis_loop(structure, ROLL, controller, WHITE).at(OMEGA)
    plant, feedback = structure.response(ROLL, OMEGA)[0, 0], controller.response(OMEGA)
    np.testing.assert_allclose(found.excited[0, 0], 1.0 / (1.0 + feedback * plant), rtol=1e-12)
    np.testing.assert_allclose(found.disturbed[0, 0], -feedback / (1.0 + feedback * plant), rtol=1e-12)
    # The disturbance reaches the output through the sensitivity, and the command with the controller behind it.
    sensitivity = np.abs(1.0 / (1.0 + feedback * plant)) ** 2
    power = WHITE.density(OMEGA)[0, 0].real
    np.testing.assert_allclose(found.logged_noise[1, 1].real, sensitivity * power, rtol=1e-11)
    np.testing.assert_allclose(found.logged_noise[0, 0].real, np.abs(feedback) ** 2 * sensitivity * power, rtol=1e-11)


def test_all_axes_of_a_vehicle_are_closed_at_once() -> None:
    loop = vehicle_loop(s500.vehicle())
    found = loop.at(OMEGA)
    assert loop.feedback is not None
    feedback = loop.feedback.response(OMEGA)
    around = np.eye(4)[:, :, None] - np.einsum("iyf,yjf->ijf", feedback, found.plant)
    np.testing.assert_allclose(
        np.einsum("ijf,jkf->ikf", around, found.excited), np.repeat(np.eye(4)[:, :, None], OMEGA.size, 2), atol=1e-9
    )
    np.testing.assert_allclose(found.disturbed, np.einsum("ijf,jyf->iyf", found.excited, feedback), atol=1e-12)


def test_a_log_that_picks_samples_folds_the_noise() -> None:
    loop = LoopModel(
        name="open",
        inputs=("roll_command",),
        outputs=("p",),
        plant=rate_model("rate.roll").matrices(ROLL),
        feedback=None,
        noises=(Noise(source=White(std=(0.1,), sample_rate_hz=1000.0)),),
        log_rate_hz=200.0,
        loop_rate_hz=1000.0,
    )
    omega = np.array([3.0, 100.0, 500.0])
    np.testing.assert_allclose(loop.logged_noise(omega)[1, 1].real, 2.0 * 0.1**2 / 200.0, rtol=1e-12)


@pytest.mark.parametrize("band_hz", [(1.0, 5.0), (5.0, 20.0), (60.0, 98.0)])
def test_a_flight_without_test_inputs_shows_these_spectra(band_hz: tuple[float, float]) -> None:
    rest_s = 120.0
    maneuver = Maneuver(axis="roll", kind="other", start_s=1.0, stop_s=rest_s)
    still = Excitation(maneuver=maneuver, values=np.zeros(round((rest_s - 1.0) * 1000)), sample_rate_hz=1000.0)
    flight = fly(s500.vehicle(), [still], rng=np.random.default_rng(4))
    loop = vehicle_loop(s500.vehicle())
    names = ("roll_command", "yaw_command", "p", "r", "phi", "v", "ay")
    line_hz = flight.sample_rate_hz / flight.time_s.size
    hertz = np.arange(*band_hz, line_hz)
    rows = [(*loop.inputs, *loop.outputs).index(name) for name in names]
    expected = loop.logged_noise(2.0 * np.pi * hertz)[rows, rows].real.mean(axis=1)
    found = np.array([_mean_density(flight.columns[name], flight.sample_rate_hz, band_hz) for name in names])
    # A sum over n lines, each with two degrees of freedom: five standard deviations, and 2 % for the clock.
    np.testing.assert_allclose(found / expected, 1.0, atol=5.0 / np.sqrt(hertz.size * 0.5) + 0.02)


def _mean_density(samples: FloatArray, rate_hz: float, band_hz: tuple[float, float]) -> float:
    taper = np.hanning(samples.size)
    power = np.abs(np.fft.rfft((samples - samples.mean()) * taper)) ** 2 * 2.0 / (rate_hz * np.sum(taper**2))
    hertz = np.fft.rfftfreq(samples.size, 1.0 / rate_hz)
    return float(power[(hertz >= band_hz[0]) & (hertz < band_hz[1])].mean())


@pytest.mark.parametrize("entry", ["rate_setpoint", "attitude_setpoint"])
def test_set_points_pass_the_gains_between_them_and_the_command(entry: Entry) -> None:
    controller = RateController(proportional_s=0.1, integral=0.2, derivative_s2=0.01, angle_1_s=5.0)
    loop = axis_loop(rate_model("rate.roll"), ROLL, controller, WHITE)
    expected = (0.1 + 0.2 / (1j * OMEGA)) * (5.0 if entry == "attitude_setpoint" else 1.0)
    np.testing.assert_allclose(loop.excitation(OMEGA, entry)[0, 0], expected, rtol=1e-12)
    hover = vehicle_loop(s500.vehicle())
    gains = s500.CONTROLLER
    outer = gains.angle_p[0] if entry == "attitude_setpoint" else 1.0
    np.testing.assert_allclose(
        hover.excitation(OMEGA, entry)[0, 0], outer * (gains.rate_p[0] + gains.rate_i[0] / (1j * OMEGA)), rtol=1e-12
    )


def test_an_entry_that_the_loop_does_not_know_is_refused() -> None:
    with pytest.raises(UsageError, match="stick"):
        axis_loop(rate_model("rate.roll"), ROLL, None, WHITE).excitation(OMEGA, "stick")


def test_shapes_that_do_not_fit_are_named() -> None:
    plant = rate_model("rate.roll").matrices(ROLL)
    with pytest.raises(UsageError, match="noise 0"):
        loop_model(
            plant,
            None,
            [Noise(source=White(std=(0.1, 0.1), sample_rate_hz=200.0))],
            name="odd",
            inputs=["roll_command"],
            outputs=["p"],
        )
    with pytest.raises(UsageError, match="the plant"):
        loop_model(plant, None, [], name="odd", inputs=["roll_command"], outputs=["p", "q"])
    with pytest.raises(UsageError, match="positive log rate"):
        loop_model(plant, None, [], name="odd", inputs=["roll_command"], outputs=["p"], log_rate_hz=0.0)
