"""Every log of the data folder is read, through the mapping that a user would take; none is left out in silence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.data.record import FlightRecord

MAPPINGS = Path(__file__).resolve().parents[2] / "docs" / "mappings"

NO_LOGS = frozenset({"MANIFEST.md", "LICENSE", "LICENSE.txt", "LICENSE.pyulog.md", "truth.json"})
"""Licenses and answers beside the logs; scripts, mappings and layouts are known by their endings."""
HOSTILE = "field/hostile/"
"""Logs, journals, projects and settings that are wrong on purpose: ``tests/hostile`` has their like."""
OTHER_HALVES = frozenset({"polimi/output.mat"})
"""Read together with the log that the mapping belongs to."""

REFUSED = frozenset({"everyday/px4_sdlog2.px4log.xz"})
"""Named with the way to convert them, see the tests of everyday flights."""

OWN_NAMES = (
    "ardupilot",
    "ardupilot_sitl",
    "betaflight",
    "crazyflie",
    "everyday",
    "field",
    "px4",
    "px4_sitl",
    "real_stacks",
    "s500",
)
DAMAGED = frozenset(
    {
        "everyday/betaflight_damaged_test_log.BFL.xz",
        "everyday/px4_115_s500.ulg.xz",
        "flight/idsia_multisine_20251017_run4.parquet.xz",
    }
)
"""The only ones with values or stamps that cannot be."""
MAPPED = {
    "antx": "antx/map.toml",
    "bebop/ident": "bebop_random_binary.toml",
    "bebop/sim": "bebop_flight.toml",
    "bebop/unfiltered": "bebop_random_binary.toml",
    "bebop/step": "bebop_steps.toml",
    "bebop/steadystate": "bebop_drag.toml",
    "bebop/command_rate": "bebop_steps.toml",
    "bebop/yaw_drift": "bebop_steps.toml",
    "bebop/yaw_drift/0_yawDriftmetC_constant1_log_03052019_144521.mat": "bebop_time_steps.toml",
    "field/b12_crazyswarm": "field/b12.toml",
    "flight/idsia": "idsia_nanodrone.toml",
    "flight/nanobench": "nanobench.toml",
    "flight/neurobem": "neurobem.toml",
    "iris_sim": "gazebo_iris.toml",
    "polimi": "pitch_rig_two_files.toml",
}
"""File or folder to its mapping, in the data folder or in the documentation."""


def mapping_of(log: str, shared_data: Path) -> Path | None:
    """The mapping of the longest name that fits; a log of an unknown folder fails."""
    fitting = [known for known in MAPPED if log.startswith(known)]
    if not fitting and log.partition("/")[0] in OWN_NAMES:
        return None
    name = MAPPED[max(fitting, key=len)]
    return shared_data / name if "/" in name else MAPPINGS / name


def logs_of(folder: Path) -> list[str]:
    """Every file that is not known to be something else; a folder of exported topics is one log."""
    found = set()
    for path in folder.rglob("*"):
        if path.is_file() and path.name not in NO_LOGS and path.suffix not in (".py", ".toml"):
            whole = path.parent if path.parent.name == "zmr250" else path
            found.add(whole.relative_to(folder).as_posix())
    return sorted(name for name in found - OTHER_HALVES - REFUSED if not name.startswith(HOSTILE))


@pytest.fixture(scope="module")
def logs(shared_data: Path) -> list[str]:
    return logs_of(shared_data)


@pytest.mark.slow
def test_every_log_reads(shared_data: Path, logs: list[str]) -> None:
    silent, screened = [], []
    for log in logs:
        record = rotorid.read(shared_data / log, mapping=mapping_of(log, shared_data), sandbox=False)
        samples = sum(topic.values.size for topic in record.topics)
        if not samples or not all(np.isfinite(topic.time_s).all() for topic in record.topics):
            silent.append(log)
        lost = {finding.kind for finding in record.findings if finding.severity != "info"}
        if {"impossible_value", "clock_disorder"} & lost:
            screened.append(log)
    assert silent == []
    # No sound flight loses a sample, whatever flew it.
    assert set(screened) == DAMAGED
    assert len(logs) > 80


def test_nothing_is_named_that_does_not_exist(shared_data: Path, logs: list[str]) -> None:
    missing = [name for name in (*MAPPED, *OTHER_HALVES) if not list(shared_data.glob(f"{name}*"))]
    assert missing == []
    used = {path.name for log in logs if (path := mapping_of(log, shared_data)) and path.parent == MAPPINGS}
    # These have no log in the folder; their own tests are with the documentation and with tables of other programs.
    without_log = {"motion_capture_enu.toml", "rostopic_imu.toml", "qgroundcontrol.toml", "crazyflie_client.toml"}
    assert {path.name for path in MAPPINGS.glob("*.toml")} - used == without_log


@pytest.mark.slow
def test_two_files_give_three_experiments_on_one_clock(shared_data: Path) -> None:
    from scipy.io import loadmat

    record = rotorid.read(shared_data / "polimi/input.mat", mapping=MAPPINGS / "pitch_rig_two_files.toml")
    (topic,) = record.topics
    cells = {name: loadmat(shared_data / f"polimi/{name}.mat")[name]["data"][0, 0] for name in ("input", "output")}
    truth = [np.concatenate([cell[row, 3].ravel() for row in range(3)]) for cell in cells.values()]
    np.testing.assert_array_equal(topic.values, truth)
    starts = np.flatnonzero(np.diff(topic.time_s, prepend=-1.0) > 0.5)
    assert np.diff([*starts, topic.time_s.size]).tolist() == [2668, 2668, 2834]
    assert topic.time_s[starts].tolist() == [0.0, 600.0, 1200.0]
    # The second cell of each experiment is its random binary part, which the segments name by sample.
    for row, maneuver in enumerate(record.declared):
        first, stop = np.searchsorted(topic.time_s, [maneuver.start_s - 0.01, maneuver.stop_s + 0.01])
        np.testing.assert_array_equal(topic.values[0, first:stop], cells["input"][row, 1].ravel())


def agreement_with_newton(record: FlightRecord) -> list[float]:
    """Correlation of the change of velocity in NED with the specific force in FRD that the attitude turns, per axis.

    Both pass a mean of 20 samples. Wrong axes or signs make one of them small or negative.
    """
    (topic,) = record.topics
    named = {channel.name: topic.values[row] for row, channel in enumerate(topic.channels)}
    cf, ct, cp = (np.cos(named[name]) for name in ("phi", "theta", "psi"))
    sf, st, sp = (np.sin(named[name]) for name in ("phi", "theta", "psi"))
    turn = np.array(
        [
            [cp * ct, cp * st * sf - sp * cf, cp * st * cf + sp * sf],
            [sp * ct, sp * st * sf + cp * cf, sp * st * cf - cp * sf],
            [-st, ct * sf, ct * cf],
        ]
    )
    force = np.stack([named[name] for name in ("ax", "ay", "az")])
    acceleration = np.einsum("ijn,jn->in", turn, force) + np.array([[0.0], [0.0], [9.80665]])
    velocity = np.stack([named[f"velocity_{name}"] for name in ("north", "east", "down")])
    measured = np.gradient(velocity, topic.time_s, axis=1)
    smooth = np.ones(20) / 20.0
    pairs = zip(measured, acceleration, strict=True)
    return [np.corrcoef(*(np.convolve(row, smooth, "same") for row in pair))[0, 1] for pair in pairs]


def test_simulated_iris_obeys_newton_in_the_axes_of_its_mapping(shared_data: Path) -> None:
    record = rotorid.read(shared_data / "iris_sim/quadrotor_model.csv", mapping=MAPPINGS / "gazebo_iris.toml")
    assert min(agreement_with_newton(record)) > 0.99


@pytest.mark.slow
@pytest.mark.parametrize(
    ("log", "mapping"),
    [
        ("flight/idsia_square_20251017_run1.parquet.xz", "idsia_nanodrone.toml"),
        ("flight/nanobench_B8_star_fast_rep1.csv.xz", "nanobench.toml"),
    ],
)
def test_fast_flights_obey_newton_in_the_axes_of_their_mapping(shared_data: Path, log: str, mapping: str) -> None:
    record = rotorid.read(shared_data / log, mapping=MAPPINGS / mapping)
    assert min(agreement_with_newton(record)) > 0.75


def test_random_binary_records_declare_what_was_flown(shared_data: Path) -> None:
    for name in ("ident/120935", "sim/121028", "unfiltered/122633"):
        record = rotorid.read(
            shared_data / f"bebop/{name}.mat", mapping=MAPPINGS / "bebop_random_binary.toml", sandbox=False
        )
        assert [(maneuver.axis, maneuver.kind, maneuver.signal) for maneuver in record.declared] == [
            ("roll", "random_binary", "phi_setpoint"),
            ("pitch", "random_binary", "theta_setpoint"),
            ("thrust", "random_binary", "velocity_down_setpoint"),
        ]
        shown = [item for item in rotorid.inspect(record).excitations if item.origin == "declared"]
        assert [(item.start_s, item.stop_s) for item in shown] == 3 * [(record.start_s, record.stop_s)]
