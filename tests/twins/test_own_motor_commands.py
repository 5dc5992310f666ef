"""A log of one's own with four motor commands in counts: axes by sums of a mapping, and the truth of pitch and yaw.

Columns, units and axes as an engineer of the Hummingbird's paper would log them: counts of a motor controller from 1 to
200, front motor first and clockwise, an IMU forward, left, up with thousandths of g, injected sweeps.
"""

from __future__ import annotations

import numpy as np
import pytest

import rotorid
from rotorid.data.record import FlightRecord
from rotorid.typing import FloatArray

TRUTH = {"M_pitch": 300.0, "M_q": -1.2, "N_yaw": 32.0, "N_spin": 12.0, "N_r": -0.75, "T_motor": 0.022}
STEP_S = 0.002
MAP = """frame = "FLU"
clock = "t [ms]"
channels.pitch_command = { sum = { n1 = 0.5, n3 = -0.5 }, scale = 0.005 }
channels.yaw_command = { sum = { n1 = -0.25, n2 = 0.25, n3 = -0.25, n4 = 0.25 }, scale = 0.005 }
channels.pitch_excitation = "inj_pitch"
channels.yaw_excitation = "inj_yaw"
vectors.rates = { sources = ["gx", "gy", "gz"], unit = "deg/s" }
vectors.specific_force = { sources = ["fx", "fy", "fz"], unit = "mG" }
"""


def sweep(time_s: FloatArray, begin_s: float, lasts_s: float = 30.0) -> FloatArray:
    """From 0.1 to 25 Hz, exponentially, about zero and faded at both ends."""
    t = np.clip(time_s - begin_s, 0.0, lasts_s)
    growth = np.log(250.0) / lasts_s
    edges = np.clip(np.minimum(t, lasts_s - t) / 1.0, 0.0, 1.0)
    return np.asarray(edges * np.sin(2.0 * np.pi * 0.1 * np.expm1(growth * t) / growth))


def fly(seed: int) -> dict[str, FloatArray]:
    """Pitch and yaw in a loop that holds the attitude, exactly discretized motors, noise of the gyro, gusts."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, 72.0, STEP_S)
    injected = {"pitch": 8.0 * sweep(time_s, 4.0), "yaw": 12.0 * sweep(time_s, 38.0)}
    keep = np.exp(-STEP_S / TRUTH["T_motor"])
    gusts = 0.6 * rng.standard_normal((2, time_s.size))
    q = r = theta = psi = fast_q = fast_r = 0.0
    counts, rates = np.empty((4, time_s.size)), np.empty((2, time_s.size))
    for k in range(time_s.size):
        rates[:, k] = q, r
        pitch = injected["pitch"][k] - 7.0 * q - 30.0 * theta
        yaw = injected["yaw"][k] - 18.0 * r - 15.0 * psi
        n1, n2, n3, n4 = counts[:, k] = np.round([130.0 + pitch - yaw, 130.0 + yaw, 130.0 - pitch - yaw, 130.0 + yaw])
        pitch, yaw = 0.0025 * (n1 - n3), 0.00125 * (-n1 + n2 - n3 + n4)
        before_q, before_r = fast_q, fast_r
        fast_q, fast_r = keep * fast_q + (1.0 - keep) * pitch, keep * fast_r + (1.0 - keep) * yaw
        moment_q = 0.5 * TRUTH["M_pitch"] * (before_q + fast_q) + gusts[0, k]
        moment_r = 0.5 * TRUTH["N_yaw"] * (before_r + fast_r) + gusts[1, k]
        theta, psi = theta + STEP_S * q, psi + STEP_S * r
        q += STEP_S * (TRUTH["M_q"] * q + moment_q)
        r += STEP_S * (TRUTH["N_r"] * r + moment_r) + TRUTH["N_spin"] * (fast_r - before_r)
    gyro = np.degrees(np.stack([0.0 * time_s, -rates[0], -rates[1]]) + 0.01 * rng.standard_normal((3, time_s.size)))
    force = 5.0 * rng.standard_normal((3, time_s.size)) + np.array([[0.0], [0.0], [1000.0]])
    return {
        "t [ms]": 1e3 * time_s,
        **{f"n{number}": row for number, row in enumerate(counts, start=1)},
        "inj_pitch": injected["pitch"],
        "inj_yaw": injected["yaw"],
        **dict(zip(("gx", "gy", "gz"), gyro, strict=True)),
        **dict(zip(("fx", "fy", "fz"), force, strict=True)),
    }


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> FlightRecord:
    folder, columns = tmp_path_factory.mktemp("own"), fly(1)
    rows = np.column_stack(list(columns.values()))
    np.savetxt(folder / "log.csv", rows, delimiter=",", header=",".join(columns), comments="", fmt="%.7g")
    (folder / "map.toml").write_text(MAP, encoding="utf-8")
    return rotorid.read(folder / "log.csv", mapping=folder / "map.toml")


@pytest.mark.parametrize(
    ("model", "names"),
    [("rate.pitch", ("M_pitch", "M_q", "T_motor")), ("axis.yaw", ("N_yaw", "N_spin", "N_r", "T_motor"))],
)
def test_counts_of_motors_give_the_truth_of_an_axis(record: FlightRecord, model: str, names: tuple[str, ...]) -> None:
    found = rotorid.identify([record], model).parameters
    for name in names:
        assert abs(found[name].value - TRUTH[name]) < 3.0 * found[name].std, (name, found[name])
        assert found[name].std < 0.3 * abs(TRUTH[name]), (name, found[name])
