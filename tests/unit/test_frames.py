"""Axes and angles of other frames, against rotation matrices."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.errors import UsageError
from rotorid.frames import (
    BodyFrame,
    WorldFrame,
    euler_from_quaternion,
    quaternion_from_euler,
    signed_angles,
    signed_axes,
)
from rotorid.typing import FloatArray

# Columns: the axes of the frame, written in FRD or NED.
BODY: dict[BodyFrame, FloatArray] = {"FRD": np.eye(3), "FLU": np.diag([1.0, -1.0, -1.0])}
WORLD: dict[WorldFrame, FloatArray] = {
    "NED": np.eye(3),
    "ENU": np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
    "NWU": np.diag([1.0, -1.0, -1.0]),
}


def rotation(phi: float, theta: float, psi: float) -> FloatArray:
    """Yaw, then pitch, then roll: from the body to the earth."""
    (cf, sf), (ct, st), (cp, sp) = ((np.cos(a), np.sin(a)) for a in (phi, theta, psi))
    roll = np.array([[1.0, 0.0, 0.0], [0.0, cf, -sf], [0.0, sf, cf]])
    pitch = np.array([[ct, 0.0, st], [0.0, 1.0, 0.0], [-st, 0.0, ct]])
    yaw = np.array([[cp, -sp, 0.0], [sp, cp, 0.0], [0.0, 0.0, 1.0]])
    result: FloatArray = yaw @ pitch @ roll
    return result


@pytest.mark.parametrize("frame", [*BODY, *WORLD])
def test_axes_are_those_of_the_matrix(frame: BodyFrame | WorldFrame) -> None:
    vector = np.array([1.0, 2.0, 3.0])
    turned = [sign * vector[place] for place, sign in signed_axes(frame)]
    np.testing.assert_array_equal(turned, {**BODY, **WORLD}[frame] @ vector)  # type: ignore[misc]


@pytest.mark.parametrize(("frame", "world"), [("FRD", "NED"), ("FLU", "ENU"), ("FLU", "NWU")])
def test_angles_describe_the_same_attitude(frame: BodyFrame, world: WorldFrame) -> None:
    there = (0.3, -0.4, 2.0)
    here = [sign * angle + offset for angle, (sign, offset) in zip(there, signed_angles(frame, world), strict=True)]
    turned = WORLD[world] @ rotation(*there) @ BODY[frame].T
    np.testing.assert_allclose(rotation(*here), turned, atol=1e-15)


@pytest.mark.parametrize(("frame", "world"), [("FRD", "ENU"), ("FLU", "NED"), ("FRD", "NWU")])
def test_an_attitude_between_up_and_down_is_refused(frame: BodyFrame, world: WorldFrame) -> None:
    with pytest.raises(UsageError, match=f"{frame} and {world} .*FLU with ENU"):
        signed_angles(frame, world)


def test_euler_angles_of_a_quaternion_build_its_matrix() -> None:
    rng = np.random.default_rng(0)
    quaternions = rng.normal(size=(4, 50))
    for (w, x, y, z), angles in zip(
        (quaternions / np.linalg.norm(quaternions, axis=0)).T, euler_from_quaternion(quaternions).T, strict=True
    ):
        matrix = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
        np.testing.assert_allclose(rotation(*angles), matrix, atol=1e-12)


def test_a_quaternion_of_angles_has_these_angles() -> None:
    rng = np.random.default_rng(1)
    angles = rng.uniform(-1.0, 1.0, size=(3, 50)) * np.array([np.pi, 0.5 * np.pi, np.pi])[:, None]
    quaternions = quaternion_from_euler(angles)
    np.testing.assert_allclose(np.linalg.norm(quaternions, axis=0), 1.0, rtol=1e-14)
    np.testing.assert_allclose(euler_from_quaternion(quaternions), angles, atol=1e-12)
