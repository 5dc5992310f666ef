"""Paper 1 end to end: its K-means search on the rig, flown in simulation; roll alone and all of the attitude."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.kmeans import Case, attitude, late, roll

from rotorid.fitting.frequency.fit import fit_frequency
from rotorid.fitting.problem import search_box
from rotorid.search.catalog import search
from rotorid.vehicles import rig

RATIO_BAR = 0.02
SAMPLE_S = 1.0 / rig.SAMPLE_RATE_HZ
"""Delays within one sample of the log."""

SAME_MINIMUM = 1e-6


@pytest.fixture(scope="module")
def one_axis() -> Case:
    return roll(seed=0, noise=0.05)


@pytest.fixture(scope="module")
def three_axes() -> Case:
    return attitude(seed=0, noise=0.05)


def require_truth(case: Case, theta: np.ndarray) -> None:
    for name, found, true in zip(case.problem.parameters.free, theta, case.truth, strict=True):
        if name.startswith("tau"):
            assert found == pytest.approx(true, abs=SAMPLE_S), name
        else:
            assert found == pytest.approx(true, rel=RATIO_BAR), name


@pytest.mark.parametrize("candidates", [3, 4, 5])
@pytest.mark.parametrize("seed", range(3))
def test_roll_from_anywhere(one_axis: Case, candidates: int, seed: int) -> None:
    found = search(f"kmeans:{candidates}").run(one_axis.problem, budget=120, seed=seed)
    require_truth(one_axis, found.best.theta)
    assert found.best.cost == pytest.approx(one_axis.problem.polish(one_axis.truth).cost, rel=SAME_MINIMUM)


def test_limit_of_the_paper_ends_the_search_early(one_axis: Case) -> None:
    # An average of 100 for each of two responses, within the first round: three costs and a few exchanges.
    ends = [search("kmeans:3:200").run(one_axis.problem, budget=1000, seed=seed) for seed in range(5)]
    assert all(end.evaluations + end.polishing < 100 for end in ends)
    assert all(end.local_searches == 1 for end in ends)
    for end in ends:
        require_truth(one_axis, end.best.theta)


@pytest.mark.parametrize("candidates", [3, 4, 5])
def test_attitude_from_anywhere(three_axes: Case, candidates: int) -> None:
    found = search(f"kmeans:{candidates}").run(three_axes.problem, budget=160, seed=0)
    require_truth(three_axes, found.best.theta)
    assert found.best.cost == pytest.approx(three_axes.problem.polish(three_axes.truth).cost, rel=SAME_MINIMUM)


def test_package_needs_no_search(one_axis: Case, three_axes: Case) -> None:
    for case in (one_axis, three_axes):
        assert fit_frequency(case.problem).cost == pytest.approx(case.problem.polish(case.truth).cost, rel=SAME_MINIMUM)


def test_box_has_one_minimum(one_axis: Case) -> None:
    starts = search("sobol:64").run(one_axis.problem, budget=10_000, seed=0)
    assert starts.local_searches == 64
    assert len(starts.basins) == 1


def test_delays_below_three_seconds_have_many_minima() -> None:
    starts = search("sobol:64").run(late().problem, budget=10_000, seed=0)
    assert len(starts.basins) > 10


def test_inertia_and_thrust_are_wherever_the_search_began(one_axis: Case) -> None:
    problem = one_axis.problem
    both = problem.with_parameters(problem.structure.parameters)
    free = both.parameters.free
    wide = both.within(search_box(both.parameters, wider=10.0))
    ends = np.array([search("kmeans:3").run(wide, budget=60, seed=seed).best.theta for seed in range(8)])
    J_x, K_f = (ends[:, free.index(name)] for name in ("J_x", "K_f"))
    assert J_x.max() > 3.0 * J_x.min()
    np.testing.assert_allclose(K_f / J_x, K_f[0] / J_x[0], rtol=1e-4)
    assert K_f[0] / J_x[0] == pytest.approx(rig.TRUTH["K_f"] / rig.TRUTH["J_x"], rel=RATIO_BAR)


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.01, 0.10, 0.20])
def test_ratio_stands_noise(noise: float) -> None:
    ratios, delays = [], []
    for seed in range(10):
        case = roll(seed, noise)
        K_f, *late_s = search("kmeans:3").run(case.problem, budget=60, seed=seed).best.theta
        ratios.append(K_f / rig.TRUTH["K_f"])
        delays.append(late_s)
    assert np.mean(ratios) == pytest.approx(1.0, abs=RATIO_BAR)
    np.testing.assert_allclose(np.mean(delays, axis=0), [rig.TRUTH["tau_3"], rig.TRUTH["tau_4"]], atol=SAMPLE_S)


def test_flown_rig_has_the_printed_input_matrix() -> None:
    p = rig.ATTITUDE
    roll_gain, pitch_gain = p["L"] * p["K_f"] / p["J_x"], p["L"] * p["K_f"] / p["J_y"]
    yaw_gain = p["K_t"] / p["J_z"]
    printed = [
        [0.0, 0.0, roll_gain, -roll_gain],
        [pitch_gain, -pitch_gain, 0.0, 0.0],
        [-yaw_gain, -yaw_gain, yaw_gain, yaw_gain],
    ]
    np.testing.assert_allclose(rig.attitude().G[3:], printed, rtol=1e-12)
    np.testing.assert_array_equal(rig.attitude().G[:3], 0.0)


def test_noise_is_the_stated_share_of_the_angle() -> None:
    noise, pair = 0.2, ("motor_3", "motor_4")
    (topic,) = rig.fly(pair, np.random.default_rng(0), noise=noise).topics
    phi = topic.values[[channel.name for channel in topic.channels].index("phi")]
    # White noise has differences of sqrt(2) of its size; the angle itself moves by a hundredth of its own in a sample.
    assert np.std(np.diff(phi)) / np.sqrt(2.0) == pytest.approx(noise * np.std(phi), rel=0.1)
