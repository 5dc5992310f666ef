"""Responses made of responses: values, names, covariance, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rotorid.autopilots.filters import KnownFilter, butterworth_low_pass, notch
from rotorid.data.record import STANDARD_UNITS
from rotorid.data.response import FrequencyResponse
from rotorid.errors import UsageError
from rotorid.spectral.derived import corrected, differentiated, integrated, inverse, ratio, renamed, selected
from rotorid.typing import ComplexArray

OMEGA = np.array([2.0, 5.0, 11.0, 20.0])
RNG_SEED = 3


def measured(
    inputs: tuple[str, ...] = ("pitch_command", "thrust_command"),
    outputs: tuple[str, ...] = ("u", "theta"),
    *,
    seed: int = RNG_SEED,
    spread: float = 0.01,
    instruments: tuple[str, ...] = (),
) -> FrequencyResponse:
    """Any values, and a covariance with neighbors that share data."""
    rng = np.random.default_rng(seed)
    shape = (len(outputs), len(inputs), OMEGA.size)
    values = rng.standard_normal(shape) + 1j * rng.standard_normal(shape) + 2.0
    root = rng.standard_normal((*shape, OMEGA.size)) + 1j * rng.standard_normal((*shape, OMEGA.size))
    covariance = spread**2 * root @ root.conj().swapaxes(-1, -2)
    return FrequencyResponse(
        omega_rad_s=OMEGA,
        values=values,
        coherence=rng.uniform(0.5, 1.0, shape),
        random_error=np.sqrt(0.5 * np.einsum("yuff->yuf", covariance).real) / np.abs(values),
        covariance=covariance,
        inputs=inputs,
        outputs=outputs,
        estimate="joint" if instruments else "direct",
        instruments=instruments,
        windows_s=(10.0,),
    )


def outer(factor: ComplexArray) -> ComplexArray:
    return np.asarray(factor[:, None] * factor.conj())


def test_derivative_is_multiplied_with_the_frequency_and_takes_its_covariance_along() -> None:
    response = measured()
    rate = differentiated(response, "u")
    factor = 1j * OMEGA
    assert rate.outputs == ("u_dot", "theta")
    assert "u_dot" in STANDARD_UNITS
    assert rate.values[0] == pytest.approx(factor * response.values[0], rel=1e-12)
    assert rate.covariance[0] == pytest.approx(outer(factor) * response.covariance[0], rel=1e-12)
    np.testing.assert_array_equal(rate.values[1], response.values[1])
    np.testing.assert_array_equal(rate.random_error, response.random_error)
    np.testing.assert_array_equal(rate.coherence, response.coherence)
    assert rate.processing == ("u differentiated",)
    assert response.processing == ()


def test_integral_undoes_the_derivative() -> None:
    response = measured()
    back = integrated(differentiated(response, "theta"), "theta_dot")
    assert back.outputs == response.outputs
    assert back.values == pytest.approx(response.values, rel=1e-12)
    assert back.covariance == pytest.approx(response.covariance, rel=1e-12)
    assert back.processing == ("theta differentiated", "theta_dot integrated")


def test_random_error_stays_that_of_the_covariance() -> None:
    filters = {"u": [butterworth_low_pass(5.0, 100.0)], "pitch_command": [butterworth_low_pass(9.0, 100.0)]}
    for response in (differentiated(measured(), "u"), corrected(measured(), filters), inverse(single("u"))):
        spread = np.sqrt(0.5 * np.einsum("yuff->yuf", response.covariance).real) / np.abs(response.values)
        assert response.random_error == pytest.approx(spread, rel=1e-12)


def test_known_filters_are_taken_off_outputs_and_put_back_on_inputs() -> None:
    response = measured()
    gyro, gap, stick = butterworth_low_pass(20.0, 400.0), notch(30.0, 2.0, 400.0), butterworth_low_pass(8.0, 100.0)
    behind = gyro.response(OMEGA) * gap.response(OMEGA)
    in_front = stick.response(OMEGA)
    filtered = corrected(response, {"theta": [gyro, gap], "thrust_command": [stick]})
    assert filtered.values[0, 0] == pytest.approx(response.values[0, 0], rel=1e-12)
    assert filtered.values[1, 0] == pytest.approx(response.values[1, 0] / behind, rel=1e-12)
    assert filtered.values[0, 1] == pytest.approx(response.values[0, 1] * in_front, rel=1e-12)
    factor = in_front / behind
    assert filtered.values[1, 1] == pytest.approx(response.values[1, 1] * factor, rel=1e-12)
    assert filtered.covariance[1, 1] == pytest.approx(response.covariance[1, 1] * outer(factor), rel=1e-12)
    assert filtered.processing == (
        f"theta corrected for {gyro.name}, {gap.name}",
        f"thrust_command corrected for {stick.name}",
    )


def test_nothing_known_changes_nothing() -> None:
    response = measured()
    same = corrected(response, {"u": []})
    np.testing.assert_array_equal(same.values, response.values)
    assert same.processing == ()


def single(output: str, *, seed: int = RNG_SEED, spread: float = 0.01) -> FrequencyResponse:
    return measured(("pitch_command",), (output,), seed=seed, spread=spread)


def test_ratio_makes_the_common_input_the_instrument() -> None:
    over, under = single("u", seed=1), single("theta", seed=2)
    quotient = ratio(over, under)
    assert (quotient.outputs, quotient.inputs) == (("u",), ("theta",))
    assert (quotient.estimate, quotient.instruments) == ("joint", ("pitch_command",))
    assert quotient.values == pytest.approx(over.values / under.values, rel=1e-12)
    np.testing.assert_array_equal(quotient.coherence, np.minimum(over.coherence, under.coherence))
    assert "independent" in quotient.processing[-1]


def test_ratio_of_joint_responses_keeps_their_instrument() -> None:
    over, under = (measured(("pitch_command",), (name,), instruments=("pitch_stick",)) for name in ("u", "theta"))
    assert ratio(over, under).instruments == ("pitch_stick",)


DRAWS = 20_000


def drawn(response: FrequencyResponse, rng: np.random.Generator) -> ComplexArray:
    """Responses as they would come out of repeated flights, shape ``(draws, f)``."""
    root = np.linalg.cholesky(response.covariance[0, 0])
    shape = (DRAWS, OMEGA.size)
    noise = (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2.0)
    return np.asarray(response.values[0, 0] + noise @ root.T)


def sample_covariance(values: ComplexArray) -> ComplexArray:
    away = values - values.mean(axis=0)
    return np.asarray(away.T @ away.conj() / (DRAWS - 1))


def assert_covariance_is_seen(predicted: ComplexArray, values: ComplexArray) -> None:
    # An entry of a sample covariance scatters by the root of the product of its variances over the draws.
    power = np.einsum("ff->f", predicted).real
    scatter = np.sqrt(np.outer(power, power) / DRAWS)
    assert np.all(np.abs(sample_covariance(values) - predicted) < 5.0 * scatter)


def test_covariance_of_a_ratio_is_that_of_repeated_flights() -> None:
    rng = np.random.default_rng(RNG_SEED)
    over, under = single("u", seed=1, spread=1e-3), single("theta", seed=2, spread=1e-3)
    values = drawn(over, rng) / drawn(under, rng)
    assert_covariance_is_seen(ratio(over, under).covariance[0, 0], values)


def test_covariance_of_an_inverse_is_that_of_repeated_flights() -> None:
    response = single("u", spread=1e-3)
    values = 1.0 / drawn(response, np.random.default_rng(RNG_SEED))
    assert_covariance_is_seen(inverse(response).covariance[0, 0], values)


def test_inverse_undoes_itself() -> None:
    response = single("u")
    there = inverse(response)
    assert (there.outputs, there.inputs) == (("pitch_command",), ("u",))
    back = inverse(there)
    assert back.values == pytest.approx(response.values, rel=1e-12)
    assert back.covariance == pytest.approx(response.covariance, rel=1e-12)


def test_selected_pairs_keep_their_numbers() -> None:
    response = measured(instruments=("pitch_stick", "thrust_stick"))
    part = selected(response, outputs=["theta", "u"], inputs=["thrust_command"], band_rad_s=(5.0, 11.0))
    assert (part.outputs, part.inputs, part.instruments) == (("theta", "u"), ("thrust_command",), ("thrust_stick",))
    np.testing.assert_array_equal(part.omega_rad_s, OMEGA[1:3])
    np.testing.assert_array_equal(part.values, response.values[[1, 0]][:, [1], 1:3])
    np.testing.assert_array_equal(part.covariance, response.covariance[[1, 0]][:, [1], 1:3, 1:3])
    assert part.processing == ("band 5:11 rad/s selected",)


def test_selected_pairs_keep_errors_of_sensors_and_changes_of_the_slope() -> None:
    errors, changes = np.arange(4.0).reshape(2, 2), np.arange(2.0 * OMEGA.size).reshape(2, -1)
    response = replace(measured(), sensor_errors=errors, slope_changes=changes)
    part = selected(response, outputs=["theta"], inputs=["thrust_command"], band_rad_s=(5.0, 11.0))
    np.testing.assert_array_equal(part.sensor_errors, errors[[1]])
    np.testing.assert_array_equal(part.slope_changes, changes[[1]][:, 1:3])


def test_all_is_selected_when_nothing_is_said() -> None:
    response = measured()
    same = selected(response)
    np.testing.assert_array_equal(same.covariance, response.covariance)
    assert same.processing == ()


def test_renamed_swaps_names_alone() -> None:
    response = renamed(measured(), {"u": "v", "pitch_command": "roll_command"})
    assert (response.outputs, response.inputs) == (("v", "theta"), ("roll_command", "thrust_command"))
    assert response.processing == ("u renamed v", "pitch_command renamed roll_command")


def test_what_was_done_survives_one_step_after_the_other() -> None:
    steps = integrated(renamed(differentiated(single("u"), "u"), {"u_dot": "v_dot"}), "v_dot")
    assert steps.processing == ("u differentiated", "u_dot renamed v_dot", "v_dot integrated")
    assert inverse(steps).processing[:3] == steps.processing


SLOW = KnownFilter(name="slow", numerator=(1.0,), denominator=(1.0,), rate_hz=6.0)
DEAF = notch(11.0 / (2.0 * np.pi), 2.0, 100.0)
REFUSED: dict[str, tuple[Callable[[], FrequencyResponse], str]] = {
    "no output": (lambda: differentiated(measured(), "w"), "no output w"),
    "no channel": (lambda: renamed(measured(), {"w": "u"}), "no channel w"),
    "no derivative": (lambda: integrated(measured(), "u"), "has no name"),
    "same name": (lambda: renamed(measured(), {"u": "theta"}), "named alike"),
    "derivative is there": (lambda: differentiated(measured(outputs=("u", "u_dot")), "u"), "named alike"),
    "empty band": (lambda: selected(measured(), band_rad_s=(6.0, 7.0)), "no frequency"),
    "no input": (lambda: selected(measured(), inputs=["yaw_command"]), "no input yaw_command"),
    "nothing to correct": (lambda: corrected(measured(), {"w": [SLOW]}), "no w in the response"),
    "beyond half of the rate": (lambda: corrected(measured(), {"u": [SLOW]}), "filtered at 6 Hz"),
    "nothing left": (lambda: corrected(measured(), {"u": [DEAF]}), "filters leave"),
    "several": (lambda: inverse(measured()), "got"),
    "other input": (lambda: ratio(single("u"), measured(("thrust_command",), ("theta",))), "the same input"),
    "other instrument": (
        lambda: ratio(single("u"), measured(("pitch_command",), ("theta",), instruments=("pitch_stick",))),
        "the same instrument",
    ),
    "other grid": (lambda: ratio(single("u"), selected(single("theta"), band_rad_s=(2.0, 11.0))), "same frequencies"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_is_refused(name: str) -> None:
    call, said = REFUSED[name]
    with pytest.raises(UsageError, match=said):
        call()


def test_zeros_have_no_inverse_and_no_ratio() -> None:
    nothing = selected(measured(("pitch_command",), ("u",)))
    zero = FrequencyResponse(
        omega_rad_s=OMEGA,
        values=np.zeros((1, 1, OMEGA.size)),
        coherence=nothing.coherence,
        random_error=nothing.random_error,
        covariance=nothing.covariance,
        inputs=nothing.inputs,
        outputs=("theta",),
        estimate="direct",
    )
    with pytest.raises(UsageError, match="zero"):
        inverse(zero)
    with pytest.raises(UsageError, match="zero"):
        ratio(nothing, zero)
