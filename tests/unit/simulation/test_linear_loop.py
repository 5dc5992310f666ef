"""A linear vehicle in its loop: both halves of the loop hold exactly, and what cannot be flown is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.record import Maneuver
from rotorid.errors import ModelError, UsageError
from rotorid.models.state_space import StateSpace
from rotorid.simulation.hover_flight import SILENT, fly, gauss_markov
from rotorid.simulation.linear import simulate_linear
from rotorid.simulation.linear_loop import LinearLoop, as_record, fly_linear
from rotorid.typing import FloatArray
from rotorid.vehicles import hummingbird, rig, s500

STEP_HZ = 1000.0
PITCH = LinearLoop(
    name="pitch",
    system=hummingbird.pitch(),
    inputs=("pitch_command",),
    outputs=("q", "u", "theta", "ax"),
    error=np.array([[-1.0, 0.5, -3.5, 0.0]]),
    proportional=(4.0,),
    integral=(3.0,),
    noise_std=(0.01, 0.03, 0.002, 0.1),
    gust_input=-hummingbird.pitch().F[:, [1]],
    gust_std=(0.08,),
)
CALM = replace(PITCH, gust_input=np.zeros((0, 0)), gust_std=(), noise_std=(0.0,) * 4)
RIG = LinearLoop(
    name="rig",
    system=rig.roll(),
    inputs=("motor_3", "motor_4"),
    outputs=("phi", "p"),
    error=np.array([[-0.3, -1.0], [0.3, 1.0]]),
    proportional=(1.2, 1.2),
    integral=(0.0, 0.0),
    noise_std=(0.01, 0.01),
)


def wave(steps: int = 4000, inputs: int = 1) -> FloatArray:
    time_s = np.arange(steps) / STEP_HZ
    return np.stack([2.0 * np.sin((3.0 + row) * time_s) for row in range(inputs)])


def columns(loop: LinearLoop, names: tuple[str, ...], seed: int = 0, steps: int = 4000) -> FloatArray:
    excitation = wave(steps, len(loop.inputs))
    flight = fly_linear(loop, excitation, sample_rate_hz=STEP_HZ, rng=np.random.default_rng(seed))
    return np.stack([flight.columns[name] for name in names])


@pytest.mark.parametrize("loop", [PITCH, RIG], ids=["pitch", "rig"])
def test_the_commands_are_the_controller_of_the_noisy_outputs(loop: LinearLoop) -> None:
    commands, outputs = columns(loop, loop.inputs), columns(loop, loop.outputs)
    error = loop.error @ outputs
    # The integral holds what came before the sample.
    integral = (np.cumsum(error, axis=1) - error) / STEP_HZ
    wanted = np.array(loop.proportional)[:, None] * error + np.array(loop.integral)[:, None] * integral
    np.testing.assert_allclose(commands, wanted + wave(inputs=len(loop.inputs)), atol=1e-12 * np.abs(commands).max())


def test_the_outputs_are_those_of_the_vehicle_for_the_logged_commands() -> None:
    commands, outputs = columns(CALM, CALM.inputs), columns(CALM, CALM.outputs)
    wanted = simulate_linear(CALM.system, commands, sample_rate_hz=STEP_HZ, hold="first")
    scale = np.abs(wanted).max(axis=1, keepdims=True)
    np.testing.assert_allclose(outputs[:3] / scale[:3], wanted[:3] / scale[:3], atol=1e-9)
    # A late output is read linearly between steps. Across a corner of slope s that is off by s/4 steps at most, and the
    # second difference on one side of the corner is s/2 or more.
    corner = np.abs(np.diff(wanted[3], n=2)).max() / 2.0
    np.testing.assert_allclose(outputs[3], wanted[3], atol=corner)


def test_gusts_enter_the_state_equation_and_the_accelerometer_at_once() -> None:
    open_loop = replace(PITCH, proportional=(0.0,), integral=(0.0,), noise_std=(0.0,) * 4)
    system = replace(PITCH.system, output_delays_s=np.zeros(4))
    open_loop = replace(open_loop, system=system)
    rng = np.random.default_rng(3)
    gust = gauss_markov(1000, intensity=0.08, correlation_s=1.0, sample_rate_hz=STEP_HZ, rng=rng)
    pushed = replace(system, G=PITCH.gust_input, input_delays_s=np.zeros(1))
    wanted = simulate_linear(
        pushed, gust[None], sample_rate_hz=STEP_HZ, hold="first", before=gust[:1]
    ) + simulate_linear(system, wave(1000), sample_rate_hz=STEP_HZ, hold="first")
    outputs = columns(open_loop, PITCH.outputs, seed=3, steps=1000)
    np.testing.assert_allclose(outputs, wanted, atol=1e-9 * np.abs(wanted).max())


def test_noise_is_as_large_as_stated() -> None:
    steps = 20000
    quiet = replace(PITCH, proportional=(0.0,), integral=(0.0,), gust_std=(0.0,))
    still = replace(quiet, system=replace(PITCH.system, F=-np.eye(3)))
    flight = fly_linear(still, np.zeros((1, steps)), sample_rate_hz=STEP_HZ, rng=np.random.default_rng(0))
    for name, std in zip(PITCH.outputs, PITCH.noise_std, strict=True):
        # Four standard deviations of a sample standard deviation.
        assert np.std(flight.columns[name]) == pytest.approx(std, rel=4.0 / math.sqrt(2.0 * steps))


def test_one_seed_is_one_flight_and_another_seed_another() -> None:
    first, again, other = (columns(PITCH, ("q",), seed=seed, steps=500) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.allclose(first, other)


def test_the_log_picks_samples() -> None:
    fast = fly_linear(PITCH, wave(), sample_rate_hz=STEP_HZ, rng=np.random.default_rng(0))
    slow = fly_linear(PITCH, wave(), sample_rate_hz=200.0, rng=np.random.default_rng(0))
    for name, values in slow.columns.items():
        np.testing.assert_array_equal(values, fast.columns[name][::5])
    np.testing.assert_allclose(np.diff(slow.time_s), 0.005, rtol=1e-9)


def test_a_record_of_a_flight_has_its_channels_units_and_maneuvers() -> None:
    maneuver = Maneuver(axis="pitch", kind="sweep", start_s=0.5, stop_s=3.5, origin="declared")
    flight = fly_linear(PITCH, wave(), maneuvers=(maneuver,), rng=np.random.default_rng(0))
    record = as_record(flight)
    assert record.channel_names == tuple(flight.columns)
    assert {c.name: c.unit for c in record.topics[0].channels}["ax"] == "m/s^2"
    assert record.declared == (maneuver,)
    assert dict(record.instruments) == {"pitch": ("pitch_excitation",)}


def test_records_of_two_flights_are_told_apart() -> None:
    calm = [
        fly(s500.vehicle(), (), turbulence_m_s=0.1, noise=SILENT, rng=np.random.default_rng(seed)) for seed in (1, 2)
    ]
    first, second = (as_record(flight).source.sha256 for flight in calm)
    assert first != second
    assert as_record(calm[0]).source.sha256 == first


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"outputs": ("q", "u", "theta")}, "outputs of pitch"),
        ({"inputs": ("pitch_command", "thrust_command")}, "inputs of pitch"),
        ({"error": np.ones((1, 3))}, "error of pitch"),
        ({"proportional": (1.0, 2.0)}, "proportional of pitch"),
        ({"integral": ()}, "integral of pitch"),
        ({"noise_std": (0.1,)}, "noise_std of pitch"),
        ({"gust_std": (0.1, 0.1)}, "gust_input of pitch"),
        ({"gust_input": np.ones((2, 1))}, "gust_input of pitch"),
        ({"error": np.array([[0.0, 0.0, 0.0, 1.0]])}, "ax of pitch cannot be fed back"),
    ],
)
def test_a_loop_that_does_not_fit_together_is_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        replace(PITCH, **change)  # type: ignore[arg-type]


def test_an_input_that_acts_within_its_own_step_is_refused() -> None:
    system = replace(PITCH.system, input_delays_s=np.array([0.0005]))
    with pytest.raises(ModelError, match=r"delay of \w+ is 0\.5 ms"):
        replace(PITCH, system=system)


def test_an_output_that_jumps_with_a_gust_cannot_be_fed_back() -> None:
    still = StateSpace(
        M=np.eye(1),
        F=-np.eye(1),
        G=np.ones((1, 1)),
        H0=np.zeros((1, 1)),
        H1=np.ones((1, 1)),
        input_delays_s=np.array([0.01]),
        output_delays_s=np.zeros(1),
    )
    with pytest.raises(ModelError, match="az of heave cannot be fed back"):
        LinearLoop(
            name="heave",
            system=still,
            inputs=("thrust_command",),
            outputs=("az",),
            error=np.ones((1, 1)),
            proportional=(1.0,),
            integral=(0.0,),
            noise_std=(0.0,),
        )


@pytest.mark.parametrize("rate_hz", [0.0, -200.0, 300.0, 2000.0])
def test_a_rate_that_does_not_divide_a_kilohertz_is_refused(rate_hz: float) -> None:
    with pytest.raises(UsageError, match="a log at"):
        fly_linear(PITCH, wave(), sample_rate_hz=rate_hz, rng=np.random.default_rng(0))


@pytest.mark.parametrize("shape", [(2, 10), (1, 0), (10,)])
def test_test_inputs_of_another_shape_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(UsageError, match="test inputs have shape"):
        fly_linear(PITCH, np.zeros(shape), rng=np.random.default_rng(0))
