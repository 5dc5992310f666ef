"""Responses made of one loop response: identities, and errors that go through to first order."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from rotorid.data.record import Channel, TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.spectral.loops import (
    at_points,
    closed_loop,
    error_loop,
    feedback_controller,
    injected_loop,
    sensitivity,
    series,
)
from rotorid.typing import ComplexArray

OMEGA = np.geomspace(1.0, 60.0, 30)
LOOP = 20.0 / (1j * OMEGA) * (1.0 + 2.0 / (1j * OMEGA)) * np.exp(-0.02j * OMEGA)
SPREAD = 0.05


def correlation() -> ComplexArray:
    """Neighbors on the logarithm of frequency err together, with a phase between them."""
    distance = np.log(OMEGA)[:, None] - np.log(OMEGA)
    return np.exp(-0.5 * (distance / 0.15) ** 2 + 1j * distance)


def response(
    values: ComplexArray, covariance: ComplexArray, *, input: str = "roll_command", output: str = "roll_feedback"
) -> FrequencyResponse:
    error = np.sqrt(0.5 * np.diag(covariance).real) / np.abs(values)
    return FrequencyResponse(
        omega_rad_s=OMEGA,
        values=values[None, None],
        coherence=np.full((1, 1, OMEGA.size), 0.9),
        random_error=error[None, None],
        covariance=covariance[None, None],
        inputs=(input,),
        outputs=(output,),
        estimate="joint",
    )


def relative(values: ComplexArray, spread: float) -> ComplexArray:
    """Covariance of a response with the same relative error everywhere."""
    return 2.0 * spread**2 * correlation() * values[:, None] * values.conj()


def draws(covariance: ComplexArray, count: int, seed: int) -> ComplexArray:
    """Circular errors with the covariance, shape ``(count, f)``."""
    size = len(covariance)
    root = np.linalg.cholesky(covariance + 1e-12 * np.trace(covariance).real / size * np.eye(size))
    white = np.random.default_rng(seed).standard_normal((2, count, size)) / np.sqrt(2.0)
    return (white[0] + 1j * white[1]) @ root.T


@pytest.fixture
def loop() -> FrequencyResponse:
    return response(LOOP, relative(LOOP, SPREAD))


def test_sensitivity_and_closed_loop_add_up_to_one(loop: FrequencyResponse) -> None:
    S, T = sensitivity(loop), closed_loop(loop)
    np.testing.assert_allclose(S.values + T.values, 1.0, rtol=1e-12)
    np.testing.assert_allclose(S.values * loop.values, T.values, rtol=1e-12)
    # What one has too much the other has too little.
    np.testing.assert_allclose(S.covariance, T.covariance, rtol=1e-12)


def test_processing_says_what_was_done_and_the_rest_stays(loop: FrequencyResponse) -> None:
    S = sensitivity(loop)
    assert S.processing == ("sensitivity of the closed loop",)
    assert (S.estimate, S.inputs) == (loop.estimate, loop.inputs)
    np.testing.assert_array_equal(S.coherence, loop.coherence)


@pytest.mark.parametrize("function", [sensitivity, closed_loop])
def test_error_goes_through_to_first_order(function: Callable[..., Any], loop: FrequencyResponse) -> None:
    count = 4000
    small = response(LOOP, relative(LOOP, 0.01))
    errors = draws(small.covariance[0, 0], count, seed=0)
    exact = np.stack([function(response(LOOP + e, small.covariance[0, 0])).values[0, 0] for e in errors])
    deviation = exact - function(small).values[0, 0]
    predicted = function(small).covariance[0, 0]
    seen = deviation.T @ deviation.conj() / count
    scale = np.sqrt(np.diag(predicted).real[:, None] * np.diag(predicted).real)
    # A mean of products scatters by 1/sqrt(count); the second order of a 1 % error adds of the order of 1 %.
    assert np.abs((seen - predicted) / scale).max() < 5.0 / np.sqrt(count) + 0.02
    error = np.sqrt(0.5 * np.diag(predicted).real) / np.abs(function(small).values[0, 0])
    np.testing.assert_allclose(function(small).random_error[0, 0], error, rtol=1e-12)


def test_known_controller_keeps_the_relative_error() -> None:
    plant = response(LOOP, relative(LOOP, SPREAD), output="p")
    controller = 0.1 + 0.3 / (1j * OMEGA)
    loop = series(plant, controller)
    np.testing.assert_allclose(loop.values[0, 0], controller * LOOP, rtol=1e-12)
    np.testing.assert_allclose(loop.random_error, SPREAD, rtol=1e-12)
    assert loop.outputs == ("roll_feedback",)


def test_measured_controller_brings_its_own_error() -> None:
    plant = response(LOOP, relative(LOOP, SPREAD), output="p")
    C = 0.1 + 0.3 / (1j * OMEGA)
    controller = response(C, relative(C, 0.12), input="p", output="roll_command")
    loop = series(plant, controller)
    # Independent relative errors add up as squares, here to 0.13.
    np.testing.assert_allclose(loop.random_error, np.hypot(SPREAD, 0.12), rtol=1e-12)
    np.testing.assert_allclose(loop.covariance[0, 0], relative(C * LOOP, 0.13), rtol=1e-9)


def test_parts_that_do_not_belong_together_are_refused() -> None:
    plant = response(LOOP, relative(LOOP, SPREAD), output="p")
    with pytest.raises(UsageError, match="one from p to roll_command"):
        series(plant, response(LOOP, relative(LOOP, SPREAD), input="q", output="roll_command"))
    with pytest.raises(UsageError, match="one value per frequency"):
        series(plant, np.ones(3, dtype=np.complex128))


def closed_circle(late: int = 0, seed: int = 0) -> TimeHistory:
    """A loop that feeds back 0.6 of the last sample; its log shows the signal ``late`` samples too early."""
    rng = np.random.default_rng(seed)
    d, u = rng.standard_normal(8000), np.zeros(8000)
    for k in range(1, d.size):
        u[k] = d[k] - 0.6 * u[k - 1]
    channels = (Channel(name="roll_excitation", unit="1"), Channel(name="roll_command", unit="1"))
    return TimeHistory(
        values=np.stack([np.roll(d, -late), u])[:, 1 : 8000 - late], channels=channels, sample_rate_hz=50.0, start_s=0.0
    )


@pytest.mark.parametrize("late", [0, 2])
def test_injected_loop_takes_the_late_entry_of_the_signal_out(late: int) -> None:
    loop = injected_loop(
        [closed_circle(late)],
        command="roll_command",
        excitation="roll_excitation",
        omega_rad_s=np.geomspace(5.0, 100.0, 12),
        windows_s=[8.0, 4.0],
        injection_delay_s=late / 50.0,
    )
    truth = 0.6 * np.exp(-1j * loop.omega_rad_s / 50.0)
    # Nothing but the ends of the windows is left: a shift of samples leaks by its part of the window, 3/200 at most.
    assert np.abs(loop.values[0, 0] - truth).max() < 0.02


def test_what_the_records_lack_is_named() -> None:
    with pytest.raises(UsageError, match="no channel p_setpoint"):
        error_loop([closed_circle()], setpoint="p_setpoint", output="roll_command", omega_rad_s=OMEGA, windows_s=[8.0])
    with pytest.raises(UsageError, match="injection delay"):
        injected_loop(
            [closed_circle()],
            command="roll_command",
            excitation="roll_excitation",
            omega_rad_s=OMEGA,
            windows_s=[8.0],
            injection_delay_s=np.nan,
        )


def test_several_responses_at_once_are_refused(loop: FrequencyResponse) -> None:
    double = FrequencyResponse(
        omega_rad_s=OMEGA,
        values=np.repeat(loop.values, 2, axis=0),
        coherence=np.repeat(loop.coherence, 2, axis=0),
        random_error=np.repeat(loop.random_error, 2, axis=0),
        covariance=np.repeat(loop.covariance, 2, axis=0),
        inputs=loop.inputs,
        outputs=("a", "b"),
        estimate="joint",
    )
    for function in (sensitivity, closed_loop):
        with pytest.raises(UsageError, match="one response"):
            function(double)


def servo(*, gust: float, seed: int = 0) -> TimeHistory:
    """Plant ``y[k+1] = 0.9 y + 0.1 u + gust`` under ``u = 2 r - 1.5 y``, at 50 Hz."""
    rng = np.random.default_rng(seed)
    r = np.convolve(rng.standard_normal(10000), np.ones(5) / 5.0, mode="same")
    y, u = np.zeros(r.size), np.zeros(r.size)
    for k in range(r.size - 1):
        u[k] = 2.0 * r[k] - 1.5 * y[k]
        y[k + 1] = 0.9 * y[k] + 0.1 * u[k] + gust * rng.standard_normal()
    channels = tuple(
        Channel(name=name, unit=unit) for name, unit in (("p_setpoint", "rad/s"), ("p", "rad/s"), ("roll_command", "1"))
    )
    return TimeHistory(values=np.stack([r, y, u])[:, :-1], channels=channels, sample_rate_hz=50.0, start_s=0.0)


def measured_feedback(record: TimeHistory) -> FrequencyResponse:
    return feedback_controller(
        [record],
        setpoint="p_setpoint",
        output="p",
        command="roll_command",
        omega_rad_s=np.geomspace(2.0, 40.0, 15),
        windows_s=[20.0, 8.0],
    )


def test_controller_is_measured_where_gusts_tell_its_inputs_apart() -> None:
    controller = measured_feedback(servo(gust=0.2))
    np.testing.assert_allclose(controller.values, 1.5, rtol=1e-9)
    assert (controller.inputs, controller.outputs) == (("p",), ("roll_command",))
    assert controller.omega_rad_s.size > 5


def test_controller_is_not_measured_in_calm_air() -> None:
    with pytest.raises(InsufficientDataError, match="p_setpoint and p have a coherence") as caught:
        measured_feedback(servo(gust=0.001))
    assert [finding.kind for finding in caught.value.findings] == ["correlated_inputs"]


def test_plant_is_cut_to_the_points_of_the_controller() -> None:
    plant = response(LOOP, relative(LOOP, SPREAD), output="p")
    C = np.full(OMEGA.size, 0.5, dtype=np.complex128)
    controller = at_points(response(C, relative(C, SPREAD), input="p", output="roll_command"), np.arange(5, 20))
    loop = series(plant, controller)
    np.testing.assert_array_equal(loop.omega_rad_s, OMEGA[5:20])
    np.testing.assert_allclose(loop.values[0, 0], 0.5 * LOOP[5:20], rtol=1e-12)
