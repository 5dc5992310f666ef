"""Twin of the rate models: a known axis flies in closed loop in gusts, and comes back inside its own bounds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rotorid.data.record import STANDARD_UNITS, Channel, TimeHistory
from rotorid.excitation.sweep import pilot_sweep
from rotorid.fitting.frequency.fit import fit_frequency
from rotorid.fitting.frequency.problem import FrequencyProblem, usable_points
from rotorid.models.library import rate_model
from rotorid.simulation.hover_flight import gauss_markov
from rotorid.simulation.linear import discretize
from rotorid.spectral.estimate import frequency_response
from rotorid.typing import FloatArray
from rotorid.uncertainty.cramer_rao import bounds

TRUTH = {"L_roll": 80.0, "L_p": -4.0, "T_motor": 0.05, "tau_roll": 0.006}
STRUCTURE = rate_model("rate.roll")
STEP_HZ, LOG_HZ = 1000.0, 250.0
BAND = (2.0 * math.pi * 0.3, 2.0 * math.pi * 8.0)
OMEGA = np.geomspace(2.0, 45.0, 60)
WINDOWS_S = (20.0, 13.0, 8.0, 5.0, 3.0)
GAIN, INTEGRAL = 0.08, 0.1
GUST_RAD_S2, GYRO_RAD_S = 1.5, 0.01
NAMES = ("roll_command", "p", "roll_excitation")


def fly(seed: int) -> TimeHistory:
    """Two sweeps of 50 s added to the command of a rate loop that fights gusts on a noisy gyro.

    Commands go linearly from one millisecond to the next and the plant is exact between them; the log picks every
    fourth sample.
    """
    rng = np.random.default_rng(seed)
    sweep = pilot_sweep(
        amplitude=0.12, band_rad_s=BAND, duration_s=50.0, sample_rate_hz=STEP_HZ, noise_fraction=0.1, rng=rng
    )
    excitation = np.concatenate([sweep, sweep])
    steps = excitation.size
    gust = gauss_markov(steps, intensity=GUST_RAD_S2, correlation_s=0.5, sample_rate_hz=STEP_HZ, rng=rng)
    system = STRUCTURE.matrices(TRUTH)
    A, B, C, _ = system.proper()
    both = np.column_stack([B, [1.0, 0.0]])
    step = discretize(A, both, delays_s=np.append(system.input_delays_s, 0.0), step_s=1.0 / STEP_HZ, hold="first")
    pushed = step.forcing(np.stack([np.zeros(steps), gust]), np.zeros(2))
    rate, command = _loop(step.transition, step.taps[:, 0], int(step.lags[0]), C[0], pushed, excitation, rng)
    every = slice(None, None, round(STEP_HZ / LOG_HZ))
    return TimeHistory(
        values=np.stack([command[every], rate[every], excitation[every]]),
        channels=tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in NAMES),
        sample_rate_hz=LOG_HZ,
        start_s=0.0,
    )


def _loop(
    transition: FloatArray,
    taps: FloatArray,
    lag: int,
    output: FloatArray,
    pushed: FloatArray,
    excitation: FloatArray,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """Measured rate and command, sample by sample: a proportional and integral controller, then the plant."""
    noise = GYRO_RAD_S * rng.standard_normal(excitation.size)
    history = np.zeros(excitation.size + lag + 1)
    rates, state, integral = np.empty(excitation.size), np.zeros(2), 0.0
    for k in range(excitation.size):
        rate = float(output @ state) + noise[k]
        integral += rate / STEP_HZ
        rates[k] = rate
        history[k + lag + 1] = excitation[k] - GAIN * rate - INTEGRAL * integral
        state = transition @ state + taps.T @ history[k : k + 3] + pushed[k]
    return rates, history[lag + 1 :]


def identify(seed: int) -> tuple[FloatArray, FloatArray]:
    """Errors of the parameters and their random standard deviations: the twin is linear, and its stamps are exact."""
    response = frequency_response(
        [fly(seed)],
        inputs=["roll_command"],
        outputs=["p"],
        instruments=["roll_excitation"],
        omega_rad_s=OMEGA,
        windows_s=WINDOWS_S,
    )
    posed = FrequencyProblem(
        structure=STRUCTURE,
        parameters=STRUCTURE.parameters,
        data=response,
        used=usable_points(response, coherence=0.3),
    )
    solution = fit_frequency(posed)
    return solution.theta - np.array(list(TRUTH.values())), np.sqrt(np.diag(bounds(posed, solution).random))


@pytest.mark.parametrize("seed", range(5))
def test_the_truth_lies_within_four_standard_deviations(seed: int) -> None:
    errors, spreads = identify(seed)
    assert np.all(np.abs(errors) <= 4.0 * spreads)
    # The bounds say something: 5 % of the gain, and 3 ms of lag and delay.
    assert np.all(spreads <= np.array([0.05 * 80.0, 1.0, 0.01, 0.003]))


@pytest.mark.slow
def test_intervals_of_95_percent_cover_95_percent_of_flights() -> None:
    flights = 150
    ratios = np.array([errors / spreads for errors, spreads in map(identify, range(100, 100 + flights))])
    covered = dict(zip(TRUTH, np.mean(np.abs(ratios) <= 1.96, axis=0), strict=True))
    # Binomial scatter of 150 flights is 1.8 %: two of them below 95 %; above 98.5 % the bounds would say too little.
    assert all(0.91 <= share <= 0.985 for share in covered.values()), covered
