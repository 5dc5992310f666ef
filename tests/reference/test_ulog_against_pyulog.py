"""What `px4.read` gives is what pyulog gives, sample by sample."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rotorid.data.record import Source
from rotorid.io import px4


@pytest.mark.parametrize("name", ["px4_sitl/roll.ulg", "px4/sample.ulg", "px4/sample_log_small.ulg"])
def test_every_sample_is_that_of_pyulog(name: str, unpacked: Callable[[str], Path]) -> None:
    from pyulog.core import ULog

    path = unpacked(name)
    log = ULog(str(path))
    reference = {dataset.name: dataset.data for dataset in log.data_list if dataset.multi_id == 0}
    record = px4.read(path, Source(name=path.name, format=px4.FORMAT, sha256=""))

    compared = 0
    for topic in record.topics:
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
    assert all(record.parameters[key] == pytest.approx(value) for key, value in log.initial_parameters.items())


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
