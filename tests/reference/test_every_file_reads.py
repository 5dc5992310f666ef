"""Every log of the data folder is read, through the mapping that a user would take; none is left out in silence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rotorid

MAPPINGS = Path(__file__).resolve().parents[2] / "docs" / "mappings"

NO_LOGS = frozenset({"MANIFEST.md", "LICENSE", "LICENSE.txt", "LICENSE.pyulog.md", "map.toml", "truth.json"})
"""What stands beside the logs: licenses, mappings, answers."""
OTHER_HALVES = frozenset({"polimi/output.mat"})
"""Read together with the log that the mapping belongs to."""

REFUSED = frozenset({"everyday/px4_sdlog2.px4log.xz"})
"""Named with the way to convert them, see the tests of everyday flights."""

OWN_NAMES = ("ardupilot", "ardupilot_sitl", "betaflight", "crazyflie", "everyday", "px4", "px4_sitl", "s500")
DAMAGED = frozenset({"everyday/betaflight_damaged_test_log.BFL.xz", "everyday/px4_115_s500.ulg.xz"})
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
    "iris_sim": "gazebo_iris.toml",
    "polimi": "pitch_rig_two_files.toml",
}
"""File or folder to its mapping, in the data folder or in the documentation."""


def mapping_of(log: str, shared_data: Path) -> Path | None:
    """The mapping of the longest name that fits; a log of an unknown folder fails."""
    if log.partition("/")[0] in OWN_NAMES:
        return None
    name = MAPPED[max((known for known in MAPPED if log.startswith(known)), key=len)]
    return shared_data / name if "/" in name else MAPPINGS / name


def logs_of(folder: Path) -> list[str]:
    """Every file that is not known to be something else; a folder of exported topics is one log."""
    found = set()
    for path in folder.rglob("*"):
        if path.is_file() and path.name not in NO_LOGS:
            whole = path.parent if path.parent.name == "zmr250" else path
            found.add(whole.relative_to(folder).as_posix())
    return sorted(found - OTHER_HALVES - REFUSED)


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
    missing = [name for name in (*MAPPED, *OTHER_HALVES) if not (shared_data / name).exists()]
    assert missing == []
    used = {path.name for log in logs if (path := mapping_of(log, shared_data)) and path.parent == MAPPINGS}
    # That of motion capture has no log in the folder; its own test is with the documentation.
    assert {path.name for path in MAPPINGS.glob("*.toml")} - used == {"motion_capture_enu.toml"}


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


def test_simulated_iris_obeys_newton_in_the_axes_of_its_mapping(shared_data: Path) -> None:
    """Velocity in NED changes as the specific force in FRD says that the attitude turns it: wrong axes could not."""
    record = rotorid.read(shared_data / "iris_sim/quadrotor_model.csv", mapping=MAPPINGS / "gazebo_iris.toml")
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
    for one, other in zip(measured, acceleration, strict=True):
        likeness = np.corrcoef(np.convolve(one, smooth, "same"), np.convolve(other, smooth, "same"))[0, 1]
        assert likeness > 0.99


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
