"""What `px4.read` gives is what pyulog gives, sample by sample."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rotorid.data.record import Source
from rotorid.io.parameters import kept_parameters
from rotorid.io.px4 import log as px4
from rotorid.io.px4.ulog import extract

LOGS = (
    *(f"px4/{name}.ulg" for name in ("s250_2017", "sample", "sample_log_small", "sample_old_1MB")),
    "px4/sample_logging_tagged_and_default_params.ulg",
    "px4_sitl/roll.ulg",
    *(f"px4_sitl/{name}.ulg.xz" for name in ("pitch", "yaw", "thrust", "verify")),
)


@pytest.mark.parametrize("name", LOGS)
def test_every_field_of_every_topic_is_that_of_pyulog(name: str, unpacked: Callable[[str], Path]) -> None:
    from pyulog.core import ULog

    path = unpacked(name)
    theirs = ULog(str(path))
    topics = {dataset.name: dataset.data for dataset in theirs.data_list if dataset.multi_id == 0}
    ours = extract(path, topics)

    numbers = {
        f"{dataset.name}/{field.field_name}": dataset.data[field.field_name]
        for dataset in theirs.data_list
        for field in dataset.field_data
        if dataset.multi_id == 0 and field.type_str != "char"
    }
    assert set(ours.arrays) == set(numbers)
    for label, values in numbers.items():
        np.testing.assert_array_equal(ours.arrays[label], values, err_msg=label)
    final = dict(theirs.initial_parameters) | {name: value for _, name, value in theirs.changed_parameters}
    np.testing.assert_equal(dict(ours.parameters), {name: float(value) for name, value in final.items()})
    assert ours.dropouts == [(drop.timestamp * 1e-6, drop.duration * 1e-3) for drop in theirs.dropouts]


@pytest.mark.parametrize("name", ["px4_sitl/roll.ulg", "px4/sample.ulg", "px4/sample_log_small.ulg"])
def test_every_sample_is_that_of_pyulog(name: str, unpacked: Callable[[str], Path]) -> None:
    from pyulog.core import ULog

    path = unpacked(name)
    log = ULog(str(path))
    reference = {dataset.name: dataset.data for dataset in log.data_list if dataset.multi_id == 0}
    record = px4.read(path, Source(name=path.name, format=px4.FORMAT, sha256=""))

    compared = 0
    for topic in record.topics:
        if topic.name in ("hover_thrust_estimate", "actuator_outputs"):
            continue  # without the samples in which there is no estimate; shares of the range of the pulses
        data = reference[topic.name]
        for channel, values in zip(topic.channels, topic.values, strict=True):
            field = channel.source.removeprefix(f"{topic.name}.")
            if field not in data:
                continue  # angles out of a quaternion
            sign = -1.0 if topic.name == "vehicle_thrust_setpoint" else 1.0
            np.testing.assert_array_equal(values, sign * data[field].astype(np.float64))
            compared += 1
        clocks = [data[clock].astype(np.float64) * 1e-6 for clock in ("timestamp", "timestamp_sample") if clock in data]
        assert any(np.array_equal(topic.time_s, clock) for clock in clocks)
    assert compared >= 20
    final = dict(log.initial_parameters) | {name: value for _, name, value in log.changed_parameters}
    assert record.parameters == kept_parameters({name: float(value) for name, value in final.items()})


def test_angles_turn_the_axes_as_the_quaternion_does(unpacked: Callable[[str], Path]) -> None:
    """The rotation matrix of the three angles equals that of SciPy for the logged quaternion."""
    from pyulog.core import ULog
    from scipy.spatial.transform import Rotation

    path = unpacked("px4_sitl/roll.ulg")
    quaternion = ULog(str(path), ["vehicle_attitude"]).get_dataset("vehicle_attitude").data
    logged = np.stack([quaternion[f"q[{part}]"] for part in (1, 2, 3, 0)], axis=1).astype(np.float64)
    topic, row = next(px4.read(path, Source(name="", format="", sha256="")).holding("phi"))
    ours = Rotation.from_euler("ZYX", topic.values[row : row + 3][::-1].T)
    difference = (ours.inv() * Rotation.from_quat(logged)).magnitude()
    # Products of unit quaternions in double precision, and the square root at small angles.
    assert difference.max() < 1e-7
