"""Twins of output error: flights of a known model under colored noise, and what the stated errors are worth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from scipy.signal import lfilter

from rotorid.fitting.time.output_error import TimeData, TimeProblem, fit_output_error
from rotorid.models.library import response_model
from rotorid.simulation.linear import simulate_linear
from rotorid.typing import FloatArray
from rotorid.uncertainty.colored import colored_covariance
from rotorid.uncertainty.cramer_rao import bounds_of_parts
from rotorid.uncertainty.time_error import with_time_error

NORMAL_95 = 1.96
LOWEST, HIGHEST = 0.91, 0.985
WHOLE_LOWEST, WHOLE_HIGHEST, LARGEST_RMS = 0.93, 0.98, 1.2
DULLEST = 1.8
"""Standard deviation over the median error, at most; half of normal errors lie within 0.67 of one, so 1.48 is perfect.
"""

SEEDS = 400


class Twin(NamedTuple):
    """A model in flight: its truth, the rate, length and number of its records, and the noise at its output."""

    truth: dict[str, float]
    rate_hz: float
    samples: int
    records: int
    hold_samples: int
    coefficients: tuple[float, ...]
    noise: float


ANGLE = Twin({"K_phi": 0.95, "omega_phi": 7.0, "zeta_phi": 0.7, "tau_phi": 0.083}, 20.0, 700, 2, 8, (1.0, -0.8), 0.2)
"""A roll angle at 20 Hz under random binary commands, as Bebop flies; noise with a memory of a fifth of a second."""

SWAYING = Twin(
    {"K_phi": 0.95, "omega_phi": 7.0, "zeta_phi": 0.7, "tau_phi": 0.083}, 50.0, 3000, 1, 25, (1.0, -1.9, 0.925), 0.2
)
"""The same at 50 Hz in gusts that sway at 7 rad/s, where the model itself has its natural frequency."""

STRUCTURE = response_model("response.second_order_delay", [("phi_setpoint", "phi")])


def fly(twin: Twin, seed: int) -> tuple[TimeData, ...]:
    rng = np.random.default_rng(seed)
    system = STRUCTURE.matrices(STRUCTURE.parameters.with_values(twin.truth).values)
    records = []
    for record in range(twin.records):
        switches = rng.standard_normal((1, -(-twin.samples // twin.hold_samples)))
        u = np.sign(np.repeat(switches, twin.hold_samples, axis=1))[:, : twin.samples]
        y = simulate_linear(system, u, sample_rate_hz=twin.rate_hz, x0=0.3 * rng.standard_normal(2), before=u[:, 0])
        color = lfilter([1.0], twin.coefficients, rng.standard_normal(twin.samples + 500))[500:]
        y = y + 0.05 + twin.noise * color / color.std()
        records.append(TimeData(name=f"flight {record}", inputs=u, outputs=y, sample_rate_hz=twin.rate_hz))
    return tuple(records)


def errors(twin: Twin, seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Errors of the parameters over their stated deviations: corrected for color, as white noise has it, and whole.

    The whole one has the model error too, of a structure that has none, but no clocks: these are exact here.
    """
    problem = TimeProblem(structure=STRUCTURE, parameters=STRUCTURE.parameters, records=fly(twin, seed))
    fit = fit_output_error(problem)
    parts = fit.problem.parts(fit.solution.theta)
    covariance = colored_covariance(parts)
    whole = with_time_error(bounds_of_parts(parts, fit.parameters.free), parts).std
    off = fit.solution.theta - np.array([twin.truth[name] for name in fit.parameters.free])
    return off / np.sqrt(covariance.corrected.diagonal()), off / np.sqrt(covariance.white.diagonal()), off / whole


def test_an_angle_under_colored_noise_comes_back_within_its_errors() -> None:
    off = np.array([errors(ANGLE, seed)[0] for seed in range(6)])
    # The 99.9 % point of chi-squared with 24 degrees of freedom.
    assert np.sum(off**2) < 51.2


@pytest.mark.slow
@pytest.mark.parametrize("twin", [ANGLE, SWAYING], ids=["angle", "swaying"])
def test_intervals_cover_the_truth_with_the_correction_and_not_without(twin: Twin) -> None:
    runs = [errors(twin, seed) for seed in range(SEEDS)]
    corrected, white, whole = (np.mean(np.abs(np.array(off)) < NORMAL_95, axis=0) for off in zip(*runs, strict=True))
    print(dict(zip(twin.truth, np.stack([corrected, white, whole], axis=1).tolist(), strict=True)))
    off = np.abs([run[2] for run in runs])
    rms, sharpness = np.sqrt(np.mean(off**2, axis=0)), 1.0 / np.median(off, axis=0)
    print("rms", rms.round(2), "sharpness", sharpness.round(2))
    assert (corrected >= LOWEST).all(), corrected
    assert (corrected <= HIGHEST).all(), corrected
    assert (white < LOWEST).all(), white
    assert (whole >= WHOLE_LOWEST).all(), whole
    assert (whole <= WHOLE_HIGHEST).all(), whole
    assert (rms <= LARGEST_RMS).all(), rms
    assert (sharpness <= DULLEST).all(), sharpness
