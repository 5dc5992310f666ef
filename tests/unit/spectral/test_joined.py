"""Responses that were estimated apart and joined: by input, and from records that lack channels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.record import Channel, TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.errors import UsageError
from rotorid.spectral.derived import selected
from rotorid.spectral.estimate import diagnosed_response
from rotorid.spectral.joined import by_input, joined_diagnostics, joined_responses

INPUTS, OUTPUTS = ("pitch_command", "thrust_command"), ("q", "az")
GAINS = np.array([[2.0, 0.3], [0.1, -5.0]])


def record(seed: int, noise: float = 0.5) -> TimeHistory:
    rng = np.random.default_rng(seed)
    inputs = rng.standard_normal((2, 12000))
    outputs = GAINS @ inputs + noise * rng.standard_normal((2, 12000))
    units = {"pitch_command": "1", "thrust_command": "1", "q": "rad/s", "az": "m/s^2"}
    return TimeHistory(
        values=np.vstack([inputs, outputs]),
        sample_rate_hz=100.0,
        start_s=0.0,
        channels=tuple(Channel(name=name, unit=unit) for name, unit in units.items()),
    )


def measured(
    *records: TimeHistory, windows_s: tuple[float, ...] = (8.0, 4.0), inputs: tuple[str, ...] = INPUTS
) -> FrequencyResponse:
    return diagnosed_response(
        list(records), inputs=inputs, outputs=OUTPUTS, omega_rad_s=np.geomspace(2.0, 60.0, 20), windows_s=windows_s
    )[0]


def test_columns_of_the_same_windows_are_the_estimate_itself() -> None:
    one = measured(record(1))
    both = by_input(dict.fromkeys(INPUTS, one))
    for name in ("values", "coherence", "random_error", "covariance", "output_correlation", "input_correlation"):
        np.testing.assert_allclose(getattr(both, name), getattr(one, name), rtol=1e-9, atol=1e-12, err_msg=name)


def test_each_input_has_the_windows_that_were_chosen_for_it() -> None:
    long, short = measured(record(1)), measured(record(1), windows_s=(4.0, 2.0))
    both = by_input({"pitch_command": long, "thrust_command": short})
    assert both.windows_s == tuple(sorted({*long.windows_s, *short.windows_s}, reverse=True))
    np.testing.assert_array_equal(both.values[:, 0], long.values[:, 0])
    points = np.isin(both.omega_rad_s, short.omega_rad_s)
    np.testing.assert_array_equal(both.values[:, 1, points], short.values[:, 1])
    np.testing.assert_array_equal(both.random_error[:, 1, points], short.random_error[:, 1])
    matrix = np.moveaxis(np.asarray(both.input_correlation), 1, 2).reshape(2 * both.omega_rad_s.size, -1)
    assert np.linalg.eigvalsh(matrix).min() > -1e-9


def test_what_stands_behind_each_input_is_that_of_its_windows() -> None:
    told = [
        diagnosed_response(
            [record(1)], inputs=INPUTS, outputs=OUTPUTS, omega_rad_s=np.geomspace(4.0, 60.0, 9), windows_s=windows
        )
        for windows in ((8.0, 4.0), (5.0, 3.0))
    ]
    whole = by_input(dict(zip(INPUTS, [response for response, _ in told], strict=True)))
    behind = joined_diagnostics(told, whole, columns=(0, 1))
    np.testing.assert_allclose(behind.share.sum(axis=2), 1.0)
    used = {(u, length) for u in range(2) for w, length in enumerate(behind.windows_s) if behind.share[:, u, w].any()}
    assert {length for u, length in used if u == 0} <= set(told[0][0].windows_s)
    assert {length for u, length in used if u == 1} <= set(told[1][0].windows_s)


def test_a_pair_comes_from_the_part_that_holds_it() -> None:
    one, other = measured(record(1)), measured(record(2))
    parts = [selected(one, outputs=["q"], inputs=["pitch_command"]), selected(other, inputs=["thrust_command"])]
    both = joined_responses(parts, inputs=INPUTS, outputs=OUTPUTS)
    np.testing.assert_allclose(both.values[0, 0], one.values[0, 0])
    np.testing.assert_allclose(both.values[:, 1], other.values[:, 1])
    np.testing.assert_allclose(both.covariance[:, 1], other.covariance[:, 1])
    np.testing.assert_allclose(both.random_error[0, 0], one.random_error[0, 0], rtol=1e-9)
    assert np.isnan(both.values[1, 0]).all()
    assert not both.coherence[1, 0].any()
    assert both.output_correlation is not None
    np.testing.assert_allclose(both.output_correlation[1], np.asarray(other.output_correlation)[1])


def test_two_records_are_weighed_by_their_variances() -> None:
    noisy, clean = measured(record(1, 2.0)), measured(record(2, 0.2))
    both = joined_responses([noisy, clean], inputs=INPUTS, outputs=OUTPUTS)
    expected = 1.0 / (1.0 / np.einsum("yuff->yuf", noisy.covariance) + 1.0 / np.einsum("yuff->yuf", clean.covariance))
    np.testing.assert_allclose(np.einsum("yuff->yuf", both.covariance), expected, rtol=1e-9)
    assert np.abs(both.values - clean.values).max() < np.abs(both.values - noisy.values).max()


def test_the_stated_error_of_a_joined_response_is_its_scatter() -> None:
    each = []
    for seed in range(0, 20, 2):
        both = joined_responses(
            [measured(record(seed)), measured(record(seed + 1, 1.0))], inputs=INPUTS, outputs=OUTPUTS
        )
        each.append(np.abs(both.values - GAINS[..., None]) ** 2 / np.einsum("yuff->yuf", both.covariance).real)
    # Ten seeds of some ten independent frequencies and four pairs: known to 5 %.
    assert np.mean(each) == pytest.approx(1.0, abs=0.15)


def test_points_that_no_part_knows_are_held_and_count_for_nothing() -> None:
    long, short = measured(record(1)), measured(record(2), windows_s=(4.0, 2.0))
    parts = [selected(long, inputs=["pitch_command"]), selected(short, inputs=["thrust_command"])]
    both = joined_responses(parts, inputs=INPUTS, outputs=OUTPUTS)
    below = both.omega_rad_s < short.omega_rad_s[0]
    assert below.any()
    assert np.all(both.values[:, 1, below] == short.values[:, 1, :1])
    assert not both.coherence[:, 1, below].any()
    assert np.all(both.random_error[:, 1, below] == 1e3)


def test_a_part_with_another_channel_is_refused() -> None:
    with pytest.raises(UsageError, match="got a response of pitch_command, q"):
        joined_responses(
            [selected(measured(record(1)), outputs=["q"], inputs=["pitch_command"])], inputs=(), outputs=()
        )
    with pytest.raises(UsageError, match="got no response"):
        joined_responses([], inputs=INPUTS, outputs=OUTPUTS)


def test_direct_and_joint_parts_are_a_direct_estimate() -> None:
    one = measured(record(1))
    joint = replace(one, estimate="joint", instruments=("theta_setpoint", "thrust_stick"))
    assert joined_responses([joint, joint], inputs=INPUTS, outputs=OUTPUTS).instruments == joint.instruments
    assert joined_responses([joint, one], inputs=INPUTS, outputs=OUTPUTS).estimate == "direct"
