"""Rotations and axes: body FRD, earth NED, quaternions w, x, y, z from body to earth."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, TypeAlias

import numpy as np

from rotorid.errors import UsageError
from rotorid.typing import AnyArray, FloatArray

BodyFrame: TypeAlias = Literal["FRD", "FLU"]
WorldFrame: TypeAlias = Literal["NED", "ENU", "NWU"]

SignedAxes: TypeAlias = tuple[tuple[int, float], tuple[int, float], tuple[int, float]]
SignedAngles: TypeAlias = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]

_AXES: Mapping[str, SignedAxes] = MappingProxyType(
    {
        "FRD": ((0, 1.0), (1, 1.0), (2, 1.0)),
        "FLU": ((0, 1.0), (1, -1.0), (2, -1.0)),
        "NED": ((0, 1.0), (1, 1.0), (2, 1.0)),
        "ENU": ((1, 1.0), (0, 1.0), (2, -1.0)),
        "NWU": ((0, 1.0), (1, -1.0), (2, -1.0)),
    }
)
_ANGLES: Mapping[tuple[str, str], SignedAngles] = MappingProxyType(
    {
        ("FRD", "NED"): ((1.0, 0.0), (1.0, 0.0), (1.0, 0.0)),
        ("FLU", "ENU"): ((1.0, 0.0), (-1.0, 0.0), (-1.0, 0.5 * math.pi)),
        ("FLU", "NWU"): ((1.0, 0.0), (-1.0, 0.0), (-1.0, 0.0)),
    }
)


def signed_axes(frame: BodyFrame | WorldFrame) -> SignedAxes:
    """Place and sign of each FRD or NED component of a vector in another frame.

    Parameters
    ----------
    frame
        Of the body: ``FRD`` or ``FLU``, forward, left, up. Of the earth: ``NED``, ``ENU`` (east, north, up) or ``NWU``
        (north, west, up).

    Returns
    -------
    tuple of (int, float)
        For each of the three components here: its place in the vector of that frame, from zero, and its sign.

    Examples
    --------
    North is the second component of a vector in ENU, and down the negative of its third:

    >>> signed_axes("ENU")
    ((1, 1.0), (0, 1.0), (2, -1.0))
    """
    return _AXES[frame]


def signed_angles(frame: BodyFrame, world: WorldFrame) -> SignedAngles:
    r"""Signs and offsets that turn roll, pitch and yaw between two other frames into those from FRD to NED.

    With :math:`(s, o)` from here, :math:`\phi = s_1 \phi' + o_1` and so on. From FLU to ENU roll stays, pitch changes
    its sign, and :math:`\psi = \pi/2 - \psi'`.

    Parameters
    ----------
    frame, world
        The frames that the angles turn between, as `signed_axes` names them; angles are yaw–pitch–roll.

    Returns
    -------
    tuple of (float, float)
        Sign and offset in rad of phi, theta and psi.

    Raises
    ------
    UsageError
        One frame points up and the other down, so the vehicle would be upside down.

    Examples
    --------
    >>> signed_angles("FLU", "NWU")
    ((1.0, 0.0), (-1.0, 0.0), (-1.0, 0.0))
    """
    if (frame, world) not in _ANGLES:
        raise UsageError(
            f"{frame} and {world} do not form an attitude",
            needed=" or ".join(f"{body} with {earth}" for body, earth in _ANGLES),
            remedy="correct the frame of the body or that of the earth",
        )
    return _ANGLES[frame, world]


def euler_from_quaternion(quaternion: FloatArray) -> FloatArray:
    r"""Yaw–pitch–roll angles of an attitude quaternion.

    .. math::

        \phi = \operatorname{atan2}(2(wx + yz),\; w^2 - x^2 - y^2 + z^2), \quad
        \theta = \operatorname{atan2}(2(wy - xz),\; \sqrt{a^2 + b^2}), \quad
        \psi = \operatorname{atan2}(b, a)

    with :math:`a = w^2 + x^2 - y^2 - z^2` and :math:`b = 2(xy + wz)`. Every ratio is free of the norm, so that a
    quaternion which a log rounded needs no normalization. Roll and yaw lose their meaning where the pitch angle nears
    ±90°, and yaw jumps by :math:`2\pi` where the heading crosses south.

    Parameters
    ----------
    quaternion
        Body to earth, rows w, x, y, z; shape ``(4, samples)``.

    Returns
    -------
    FloatArray
        Rows phi, theta, psi in rad; shape ``(3, samples)``; roll and yaw within ±π, pitch within ±π/2.

    References
    ----------
    J. Diebel, "Representing attitude: Euler angles, unit quaternions, and rotation vectors", Stanford University, 2006,
    section 8.

    Examples
    --------
    A quarter turn to the right about the down axis:

    >>> import numpy as np
    >>> half = np.pi / 4
    >>> euler_from_quaternion(np.array([[np.cos(half)], [0.0], [0.0], [np.sin(half)]])).ravel().round(6).tolist()
    [0.0, 0.0, 1.570796]
    """
    w, x, y, z = quaternion
    a = w**2 + x**2 - y**2 - z**2
    b = 2.0 * (x * y + w * z)
    phi = np.arctan2(2.0 * (w * x + y * z), w**2 - x**2 - y**2 + z**2)
    theta = np.arctan2(2.0 * (w * y - x * z), np.hypot(a, b))
    return np.stack([phi, theta, np.arctan2(b, a)])


def earth_to_body(attitude: FloatArray, vectors: FloatArray) -> FloatArray:
    r"""Vectors over the earth in body axes: :math:`R^T(\phi, \theta, \psi) \, v`, by yaw, pitch and roll in this order.

    Parameters
    ----------
    attitude
        Roll, pitch and heading in rad, shape ``(3, samples)``.
    vectors
        North, east, down; shape ``(3, samples)``.

    Returns
    -------
    FloatArray
        Forward, right, down; shape ``(3, samples)``.

    Examples
    --------
    Heading east, north is to the left:

    >>> import numpy as np
    >>> earth_to_body(np.array([[0.0], [0.0], [0.5 * np.pi]]), np.array([[1.0], [0.0], [0.0]])).round(6).T.tolist()
    [[0.0, -1.0, 0.0]]
    """
    for angle, (i, j) in ((2, (0, 1)), (1, (2, 0)), (0, (1, 2))):
        cosine, sine = np.cos(attitude[angle]), np.sin(attitude[angle])
        turned = vectors.copy()
        turned[i] = cosine * vectors[i] + sine * vectors[j]
        turned[j] = cosine * vectors[j] - sine * vectors[i]
        vectors = turned
    return vectors


def body_to_earth(attitude: FloatArray, vectors: FloatArray) -> FloatArray:
    r"""Vectors in body axes over the earth, :math:`R v`: the inverse of :func:`earth_to_body`, in its shapes."""
    for angle, (i, j) in ((0, (1, 2)), (1, (2, 0)), (2, (0, 1))):
        cosine, sine = np.cos(attitude[angle]), np.sin(attitude[angle])
        turned = vectors.copy()
        turned[i] = cosine * vectors[i] - sine * vectors[j]
        turned[j] = cosine * vectors[j] + sine * vectors[i]
        vectors = turned
    return vectors


def quaternion_from_euler(angles: AnyArray) -> AnyArray:
    """Attitude quaternion of yaw–pitch–roll angles, body to earth: what :func:`euler_from_quaternion` undoes.

    Parameters
    ----------
    angles
        Rows phi, theta, psi in rad; shape ``(3, ...)``. Complex ones give the analytic continuation.

    Returns
    -------
    AnyArray
        Rows w, x, y, z; shape ``(4, ...)``.

    Examples
    --------
    >>> import numpy as np
    >>> quaternion_from_euler(np.array([[np.pi], [0.0], [0.0]])).ravel().round(6).tolist()
    [0.0, 1.0, 0.0, 0.0]
    """
    (cr, cp, cy), (sr, sp, sy) = np.cos(0.5 * angles), np.sin(0.5 * angles)
    return np.stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )


def rates_from_attitude(angles: FloatArray, change: FloatArray) -> FloatArray:
    r"""Body rates of an attitude that changes.

    .. math:: p = \dot\phi - \dot\psi \sin\theta, \quad q = \dot\theta \cos\phi + \dot\psi \cos\theta \sin\phi, \quad
        r = \dot\psi \cos\theta \cos\phi - \dot\theta \sin\phi

    Parameters
    ----------
    angles
        Rows phi, theta, psi in rad; shape ``(3, samples)``.
    change
        Their derivatives, rad/s, in the same shape.

    Returns
    -------
    FloatArray
        Rows p, q, r in rad/s; shape ``(3, samples)``.

    Examples
    --------
    Turning with the right side down, the nose rises in body axes:

    >>> import numpy as np
    >>> on_its_side, turning = np.array([[0.5 * np.pi], [0.0], [0.0]]), np.array([[0.0], [0.0], [1.0]])
    >>> rates_from_attitude(on_its_side, turning).ravel().round(6).tolist()
    [0.0, 1.0, 0.0]
    """
    phi, theta, _ = angles
    d_phi, d_theta, d_psi = change
    return np.stack(
        [
            d_phi - d_psi * np.sin(theta),
            d_theta * np.cos(phi) + d_psi * np.cos(theta) * np.sin(phi),
            d_psi * np.cos(theta) * np.cos(phi) - d_theta * np.sin(phi),
        ]
    )
