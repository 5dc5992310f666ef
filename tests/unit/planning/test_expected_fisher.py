"""Fisher's information against the same sum over samples."""

from __future__ import annotations

import numpy as np
from tests.unit.planning.plans import LOG_HZ, STRUCTURE, TRUTH, sweeps

from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.planning.expected import as_planned, excited_flight, expected_response
from rotorid.planning.loop import White, axis_loop
from rotorid.planning.prediction import fisher_information

NOISE = 0.02


def test_the_integral_over_frequency_is_the_sum_over_samples() -> None:
    """In open loop with white noise, information is the sum of squared derivatives of the output (Parseval)."""
    plan = sweeps({"roll": 0.1}, 40.0)
    white = White(std=(NOISE,), sample_rate_hz=LOG_HZ)
    loop = axis_loop(STRUCTURE, TRUTH, None, white, log_rate_hz=LOG_HZ)
    planned = as_planned(plan, ["roll"], LOG_HZ)
    data = expected_response(
        loop,
        planned,
        inputs=["roll_command"],
        outputs=["p"],
        omega_rad_s=np.geomspace(0.9, 90.0, 40),
        windows_s=(14.0, 4.0),
    )
    free = STRUCTURE.parameters.with_values(TRUTH)
    used = np.ones(data.values.shape, dtype=bool)
    problem = FrequencyProblem(structure=STRUCTURE, parameters=free, data=data, used=used)
    found = fisher_information(problem, free.pack(), loop, planned)
    columns = []
    for name, value in TRUTH.items():
        step = 1e-4 * value
        ends = [
            excited_flight(
                axis_loop(STRUCTURE, {**TRUTH, name: value + sign * step}, None, white, log_rate_hz=LOG_HZ),
                planned,
                ["p"],
                highest_rad_s=200.0,
            )["p"]
            for sign in (1.0, -1.0)
        ]
        columns.append((ends[0] - ends[1]) / (2.0 * step))
    spectra = np.fft.rfft(np.stack(columns), axis=1)
    omega = 2.0 * np.pi * np.fft.rfftfreq(len(columns[0]), 1.0 / LOG_HZ)
    spectra[:, (omega < data.omega_rad_s[0]) | (omega > data.omega_rad_s[-1])] = 0.0
    slopes = np.fft.irfft(spectra, n=len(columns[0]), axis=1)
    expected = slopes @ slopes.T / NOISE**2
    scale = np.sqrt(np.diag(expected))
    # The record ends while the vehicle still moves a little, and derivatives are differences: a thousandth of each.
    np.testing.assert_allclose(found / np.outer(scale, scale), expected / np.outer(scale, scale), atol=2e-3)
