"""Answers that do not depend on how coarse a grid was asked."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from rotorid.data.record import Channel, TimeHistory
from rotorid.spectral.estimate import diagnosed_response
from rotorid.spectral.windows import refined

RATE_HZ = 100.0
LOW, HIGH = 1.0, 50.0
FINE = np.geomspace(LOW, HIGH, 41)


@pytest.fixture(scope="module")
def record() -> TimeHistory:
    """A rate with two lags and 30 ms of delay, swept for a minute, with gusts."""
    rng = np.random.default_rng(0)
    time_s = np.arange(0.0, 70.0, 1.0 / RATE_HZ)
    u = np.asarray(signal.chirp(time_s, LOW / 7.0, 70.0, HIGH / 5.0, method="logarithmic"))
    p = signal.lfilter([0.0, 0.0, 0.0, 2e-3], np.polymul([1.0, -0.98], [1.0, -0.82]), u)
    values = np.stack([u, p + 0.1 * p.std() * signal.lfilter([0.25], [1.0, -0.97], rng.standard_normal(u.size))])
    channels = tuple(Channel(name=name, unit="1") for name in ("roll_command", "p"))
    return TimeHistory(values=values, channels=channels, sample_rate_hz=RATE_HZ, start_s=0.0)


def test_a_refined_grid_keeps_every_point_and_leaves_no_gap() -> None:
    omega = np.array([0.7, 0.71, 1.0, 30.0, 30.0001])
    fine, asked = refined(omega)
    assert np.array_equal(fine[asked], omega)
    assert np.all(np.diff(fine) > 0.0)
    assert np.diff(np.log(fine)).max() <= 0.1 + 1e-12


def test_a_fine_grid_and_a_single_point_stay_as_they_are() -> None:
    for omega in (FINE, np.array([3.0])):
        fine, asked = refined(omega)
        assert np.array_equal(fine, omega)
        assert asked.all()


def test_every_fifth_point_alone_has_the_answer_that_it_has_among_the_others(record: TimeHistory) -> None:
    coarse = FINE[::5]
    answers = [
        diagnosed_response(
            [record], inputs=["roll_command"], outputs=["p"], omega_rad_s=omega, windows_s=[12.0, 6.0, 3.0]
        )
        for omega in (FINE, coarse)
    ]
    (full, all_of_it), (few, some_of_it) = answers
    picked = np.isin(full.omega_rad_s, coarse)
    assert np.array_equal(few.omega_rad_s, full.omega_rad_s[picked])
    # The first windows count from 1.05 rad/s on, so both grids lose their first point.
    assert few.omega_rad_s.size == coarse.size - 1
    difference = np.abs(few.values / full.values[..., picked] - 1.0)
    # Company is spread evenly between two asked points, here where the fine grid has its own.
    assert difference.max() < 1e-9
    assert few.random_error == pytest.approx(full.random_error[..., picked], rel=1e-6)
    assert few.covariance.shape == (1, 1, few.omega_rad_s.size, few.omega_rad_s.size)
    assert some_of_it.share == pytest.approx(all_of_it.share[..., picked], abs=1e-6)
    assert some_of_it.condition.shape == few.omega_rad_s.shape
