"""Errors of responses to two inputs that one instrument moves: drawn many times, and as stated."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.data.record import Channel, TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.spectral.estimate import frequency_response
from rotorid.typing import ComplexArray

RATE_HZ = 10.0
OMEGA = np.geomspace(3.0, 20.0, 8)
DRAWS = 120


def respond(shared: float, windows_s: tuple[float, ...], *, joint: bool, draws: int = 2) -> FrequencyResponse:
    """One flight in which ``shared`` of the first instrument moves the second input, and many disturbances of it."""
    rng = np.random.default_rng(0)
    first, second = rng.standard_normal((2, 1500))
    inputs = np.stack([first, shared * first + second])
    outputs = np.array([2.0, -1.0]) @ inputs + rng.standard_normal((draws, 1500))
    names = ["r", "s", "a", "b", *(f"y{k}" for k in range(draws))]
    history = TimeHistory(
        values=np.vstack([first[None], second[None], inputs, outputs]),
        channels=tuple(Channel(name=name, unit="1") for name in names),
        sample_rate_hz=RATE_HZ,
        start_s=0.0,
    )
    return frequency_response(
        [history],
        inputs=["a", "b"],
        outputs=names[4:],
        instruments=["r", "s"] if joint else [],
        omega_rad_s=OMEGA,
        windows_s=windows_s,
    )


def errors(response: FrequencyResponse) -> ComplexArray:
    """Errors over their stated deviations, shape ``(draws, u, f)``."""
    level = np.sqrt(np.einsum("yuff->yuf", response.covariance).real)
    return np.asarray((response.values - np.array([2.0, -1.0])[:, None]) / level)


@pytest.mark.parametrize("joint", [False, True], ids=["direct", "joint"])
@pytest.mark.parametrize("windows_s", [(12.0,), (24.0, 6.0)], ids=["one window", "composite"])
def test_errors_go_together_as_stated(windows_s: tuple[float, ...], joint: bool) -> None:
    response = respond(0.8, windows_s, joint=joint, draws=DRAWS)
    stated = response.input_correlation
    assert stated is not None
    drawn = errors(response)
    found = np.einsum("kui,kvj->uvij", drawn, drawn.conj())
    level = np.sqrt(np.einsum("uuii->ui", found).real)
    found = found / level[:, None, :, None] / level[None, :, None, :]
    # An entry of n draws errs by 1 / sqrt(n) at most; the mean square over all of them hardly scatters. The moments of
    # the influence are a midpoint rule, right within 3 %.
    assert np.sqrt(np.mean(np.abs(found - stated) ** 2)) <= 1.2 / np.sqrt(DRAWS) + 0.03
    # What is stated is no small matter: of one frequency the two responses err against each other.
    cross = stated[0, 1].diagonal()
    assert np.abs(cross).mean() > 0.4
    assert np.all(cross.real < 0.0)


def test_inputs_that_move_on_their_own_err_on_their_own() -> None:
    response = respond(0.0, (6.0,), joint=False)
    stated = response.input_correlation
    assert stated is not None
    # Two random signals of n windows are correlated by 1 / sqrt(n) by chance.
    assert np.abs(stated[0, 1].diagonal()).mean() <= 2.0 / np.sqrt(150.0 / 6.0)


def test_correlation_is_a_correlation() -> None:
    stated = respond(0.8, (24.0, 6.0), joint=False).input_correlation
    assert stated is not None
    inputs, _, count, _ = stated.shape
    flat = np.moveaxis(stated, 2, 1).reshape(inputs * count, inputs * count)
    np.testing.assert_allclose(np.diag(flat), 1.0, atol=1e-12)
    np.testing.assert_allclose(flat, flat.conj().T, atol=1e-12)
    assert np.linalg.eigvalsh(flat)[0] >= -1e-12


def test_one_input_needs_none() -> None:
    rng = np.random.default_rng(1)
    history = TimeHistory(
        values=rng.standard_normal((2, 800)),
        channels=(Channel(name="a", unit="1"), Channel(name="y", unit="1")),
        sample_rate_hz=RATE_HZ,
        start_s=0.0,
    )
    response = frequency_response([history], inputs=["a"], outputs=["y"], omega_rad_s=OMEGA, windows_s=[8.0])
    assert response.input_correlation is None
