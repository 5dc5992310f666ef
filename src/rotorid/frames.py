"""Rotations and axes: body FRD, earth NED, quaternions w, x, y, z from body to earth."""

from __future__ import annotations

import numpy as np

from rotorid.typing import FloatArray


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
