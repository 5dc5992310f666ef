"""What responses of flights with a known answer must show."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import rotorid
from rotorid.data.response import FrequencyResponse
from rotorid.errors import InsufficientDataError
from rotorid.loops.responses import Responses
from rotorid.spectral.estimate import frequency_response
from rotorid.typing import ComplexArray, FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

DELAY_S = 0.00245


class Bar(NamedTuple):
    log: str
    axis: str
    output: str
    band_rad_s: tuple[float, float]
    decibels: float
    degrees: float


BARS = (
    Bar("x_wind_rollpitch", "roll", "p", (2.0, 60.0), 0.7, 5.0),
    Bar("x_wind_rollpitch", "pitch", "q", (2.0, 60.0), 0.7, 5.0),
    Bar("x_wind_yawthrust", "yaw", "r", (2.0, 60.0), 0.7, 5.0),
    Bar("x_wind_yawthrust", "thrust", "az", (3.0, 60.0), 1.0, 8.0),
)


def simulated_quad(axis: str, omega_rad_s: FloatArray) -> ComplexArray:
    s = 1j * omega_rad_s
    late = np.exp(-s * DELAY_S)
    if axis == "thrust":
        return -27.05 * s / (s + 0.241) * late
    return {"roll": 437.2, "pitch": 437.2, "yaw": 14.18}[axis] / (s + 1.987) * late


@pytest.mark.parametrize("bar", BARS, ids=lambda bar: bar.axis)
def test_joint_response_in_wind_is_the_simulators(bar: Bar, shared_data: Path) -> None:
    record = rotorid.read(shared_data / "ardupilot_sitl" / f"{bar.log}.BIN.xz")
    found = rotorid.response([record], inputs=[f"{bar.axis}_command"], outputs=[bar.output])
    assert found.response.estimate == "joint"
    omega = found.response.omega_rad_s
    inside = found.used[0, 0] & (omega >= bar.band_rad_s[0]) & (omega <= bar.band_rad_s[1])
    assert inside.sum() >= 60
    ratio = found.response.values[0, 0, inside] / simulated_quad(bar.axis, omega[inside])
    assert np.abs(20.0 * np.log10(np.abs(ratio))).max() < bar.decibels
    assert np.abs(np.degrees(np.angle(ratio))).max() < bar.degrees


class Motion(NamedTuple):
    axes: tuple[str, str]
    instruments: tuple[str, str]
    outputs: tuple[str, ...]


MOTIONS: Mapping[str, Motion] = {
    "longitudinal": Motion(("pitch", "thrust"), ("theta_setpoint", "thrust_excitation"), ("q", "u", "w", "ax", "az")),
    "lateral": Motion(("roll", "yaw"), ("phi_setpoint", "r_setpoint"), ("p", "r", "v", "ay")),
}


def exact_s500(folder: Path, motion: str, omega_rad_s: FloatArray) -> Mapping[str, ComplexArray]:
    """Responses of the vehicle to its two commands by output, each of shape ``(2, f)``."""
    known = json.loads((folder / "truth.json").read_text())[motion]
    g = STANDARD_GRAVITY_M_S2
    if motion == "longitudinal":
        F = [[known["M_q"], known["M_u"], known["M_w"], 0.0], [known["X_q"], known["X_u"], 0.0, -g]]
        F += [[0.0, known["Z_u"], known["Z_w"], 0.0], [1.0, 0.0, 0.0, 0.0]]
        G = [[known["M_pitch"], 0.0], [known["X_pitch"], 0.0], [known["Z_pitch"], known["Z_thrust"]], [0.0, 0.0]]
        taus, states, forces = ("tau_pitch", "tau_thrust"), ("q", "u", "w"), {"ax": (1, g), "az": (2, 0.0)}
    else:
        F = [[0.0, known["L_r"], known["L_v"], 0.0], [known["N_p"], known["N_r"], 0.0, 0.0]]
        F += [[known["Y_p"], 0.0, known["Y_v"], g], [1.0, 0.0, 0.0, 0.0]]
        G = [[known["L_roll"], 0.0], [known["N_roll"], known["N_yaw"]], [known["Y_roll"], 0.0], [0.0, 0.0]]
        taus, states, forces = ("tau_roll", "tau_yaw"), ("p", "r", "v"), {"ay": (2, -g)}
    s = 1j * omega_rad_s[:, None, None]
    state = np.linalg.solve(s * np.eye(4) - np.array(F), np.array(G)[None])
    delays = np.array([known[name] for name in taus])
    late = np.exp(-1j * omega_rad_s[:, None] * delays)
    # The direct path to the accelerations has half a millisecond less than the states show.
    sooner = np.exp(-1j * omega_rad_s[:, None] * (delays - 0.0005))
    found = {name: (state[:, row] * late).T for row, name in enumerate(states)}
    for name, (row, gravity) in forces.items():
        moved = np.einsum("s,fsu->fu", np.array(F)[row], state) + gravity * state[:, 3]
        found[name] = (moved * late + np.array(G)[row] * sooner).T
    return found


@pytest.fixture(scope="module", params=MOTIONS)
def s500(request: pytest.FixtureRequest, shared_data: Path) -> tuple[str, Responses]:
    motion = MOTIONS[request.param]
    records = [rotorid.read(shared_data / "s500" / f"{axis}_sweeps.csv") for axis in motion.axes]
    inputs = [f"{axis}_command" for axis in motion.axes]
    return request.param, rotorid.response(records, inputs=inputs, outputs=motion.outputs)


def certain(response: FrequencyResponse) -> np.ndarray:
    return np.asarray(response.random_error < 0.3)


def test_errors_of_a_gusty_flight_are_those_that_were_stated(s500: tuple[str, Responses], shared_data: Path) -> None:
    motion, found = s500
    response = found.response
    assert response.instruments == MOTIONS[motion].instruments
    exact = exact_s500(shared_data / "s500", motion, response.omega_rad_s)
    for row, output in enumerate(response.outputs):
        error = response.values[row] - exact[output]
        stated = np.sqrt(2.0) * response.random_error[row] * np.abs(response.values[row])
        normalized = (np.abs(error) / stated)[certain(response)[row]]
        assert normalized.size > 150, output
        assert 0.8 <= np.sqrt(np.mean(normalized**2)) <= 1.2, output


def test_stated_errors_are_those_of_the_best_single_window(s500: tuple[str, Responses]) -> None:
    response = s500[1].response
    records = [segment.history for segment in s500[1].segments]
    best = np.full(response.random_error.shape, np.inf)
    for window_s in response.windows_s:
        single = frequency_response(
            records,
            inputs=response.inputs,
            outputs=response.outputs,
            instruments=response.instruments,
            omega_rad_s=response.omega_rad_s,
            windows_s=[window_s],
        )
        count = single.omega_rad_s.size
        best[..., -count:] = np.minimum(best[..., -count:], single.random_error)
    ratio = (response.random_error / best)[certain(response)]
    # The least of five noisy numbers lies below each of them by some percent; on the whole nothing is lost.
    assert np.median(ratio) < 1.02
    assert np.quantile(ratio, 0.9) < 1.1


def test_yaw_of_a_quad_that_hovers_in_wind_is_its_controller_above_five_and_not_below_three(shared_data: Path) -> None:
    record = rotorid.read(shared_data / "ardupilot_sitl" / "x_wind_yawthrust.BIN.xz")
    hover = rotorid.Maneuver(axis="yaw", kind="other", start_s=30.0, stop_s=93.0, origin="given")
    found = rotorid.response(
        [record],
        inputs=["yaw_command"],
        outputs=["r"],
        settings=rotorid.ResponseSettings(segments=(hover,), band_rad_s=(0.8, 60.0)),
    )
    (finding,) = [f for f in found.findings if f.kind == "inverse_controller"]
    assert finding.numbers["low_rad_s"] < 5.0
    assert finding.numbers["high_rad_s"] > 40.0
    omega = found.response.omega_rad_s
    assert not found.used[0, 0, omega > 5.0].any()
    assert finding.numbers["low_rad_s"] > 3.0
    assert found.used[0, 0, omega < 3.0].any()


def test_yaw_of_an_ordinary_flight_is_refused_as_the_inverse_of_the_controller(shared_data: Path) -> None:
    record = rotorid.read(shared_data / "px4" / "zmr250")
    with pytest.raises(InsufficientDataError, match=r"the inverse of the controller.*not the vehicle") as caught:
        rotorid.response([record], inputs=["yaw_command"], outputs=["r"])
    assert caught.value.exit_code == 1
    assert "inverse_controller" in [finding.kind for finding in caught.value.findings]


@pytest.mark.parametrize(
    ("axis", "output", "phases_deg"),
    [("roll", "p", {3.0: -95.0, 19.0: -130.0}), ("pitch", "q", {})],
)
def test_roll_and_pitch_of_the_same_flight_are_the_vehicle(
    axis: str, output: str, phases_deg: Mapping[float, float], shared_data: Path
) -> None:
    record = rotorid.read(shared_data / "px4" / "zmr250")
    found = rotorid.response([record], inputs=[f"{axis}_command"], outputs=[output])
    assert "inverse_controller" not in {finding.kind for finding in found.findings}
    assert "no_excitation" in {finding.kind for finding in found.findings}
    pair = found.pairs[f"{output}/{axis}_command"]
    assert pair.band_rad_s is not None
    assert pair.band_rad_s[1] > 30.0
    for omega, phase in phases_deg.items():
        seen = np.degrees(np.interp(omega, found.omega_rad_s, pair.phase_rad))
        # What a person read off the same flight, within what its random error and the reading leave.
        assert seen == pytest.approx(phase, abs=15.0)
