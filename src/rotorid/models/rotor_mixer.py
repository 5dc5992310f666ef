"""What the autopilots' mixers make of commands, from the layout of the rotors.

The columns of a mixer are those of `rotorid.signal.autopilot_mixer.COMMANDS`: roll, pitch, yaw, thrust.
"""

from __future__ import annotations

import numpy as np

from rotorid.models.rotor_layout import RotorLayout
from rotorid.typing import FloatArray

_ANY_KAPPA = 0.05


def mixer_of(layout: RotorLayout, source_format: str) -> FloatArray | None:
    """The mixer of the autopilot that wrote a log, shape ``(rotors, 4)``; ``None`` where its rule is not known.

    Parameters
    ----------
    layout
        The rotors.
    source_format
        ``record.source.format``, such as ``ArduPilot DataFlash``.
    """
    if source_format.startswith("ArduPilot"):
        return ardupilot_mixer(layout)
    return px4_mixer(layout) if source_format.startswith("PX4") else None


def ardupilot_mixer(layout: RotorLayout) -> FloatArray:
    r"""Share of full thrust that ArduPilot asks of each motor per unit of roll, pitch, yaw and thrust, ``(rotors, 4)``.

    .. math:: m_i = -\frac{y_i}{2 \max|y|}, \; \frac{x_i}{2 \max|x|}, \; \frac{w_i}{2 \max|w|}, \; 1

    with the weights of yaw :math:`w`, which are the spins for most frames. Each axis is normalized for itself, so that
    the length and width of the frame do not matter. Tilted rotors are mixed as if they were not.

    References
    ----------
    ArduPilot, AP_MotorsMatrix: factors of the motors, normalized to one half.

    Examples
    --------
    >>> from rotorid.models.rotor_layout_library import library_layout
    >>> ardupilot_mixer(library_layout("quad.x")).round(12).tolist()[0]
    [-0.5, 0.5, 0.5, 1.0]
    """
    assert layout.yaw_weights is not None
    factors = np.stack([-layout.positions[:, 1], layout.positions[:, 0], layout.yaw_weights], axis=1)
    largest = np.abs(factors).max(axis=0)
    return np.column_stack([0.5 * factors / np.where(largest > 0.0, largest, 1.0), np.ones(layout.rotors)])


def px4_mixer(layout: RotorLayout) -> FloatArray:
    r"""Actuator of each motor per unit of torque set-point (roll, pitch, yaw) and of thrust, shape ``(rotors, 4)``.

    PX4 (1.13 and later) inverts the effectiveness, :math:`B = E^+`, and divides the columns: roll and pitch by the
    larger of :math:`\sqrt{2 \sum_i b_i^2 / n}` of the two, with :math:`n` the motors that take part; yaw by its largest
    element; thrust by the mean of its absolute values. The rows of the effectiveness may then have any scale, so that
    neither the arm nor the torque of the rotors matters. Holds while no actuator is at a limit.

    References
    ----------
    PX4, ControlAllocationPseudoInverse and ActuatorEffectivenessRotors.

    Examples
    --------
    >>> from rotorid.models.rotor_layout_library import library_layout
    >>> px4_mixer(library_layout("quad.x")).round(4).tolist()[0]
    [-0.7071, 0.7071, 1.0, 1.0]
    """
    rows = layout.effectiveness(_ANY_KAPPA * layout.arm)
    inverse = np.linalg.pinv(rows)[:, [3, 4, 5, 2]]
    inverse[:, 3] *= -1.0
    largest = np.abs(inverse).max(axis=0)
    used = np.abs(inverse) > 1e-3 * np.where(largest > 0.0, largest, np.inf)
    root = np.sqrt(2.0 * np.sum(inverse**2, axis=0) / np.maximum(used.sum(axis=0), 1))
    tilt = max(root[0], root[1])
    mean = np.sum(np.abs(inverse[:, 3])) / max(int(used[:, 3].sum()), 1)
    scale = np.array([tilt, tilt, inverse[:, 2].max(), mean])
    return np.asarray(inverse / np.where(scale > 0.0, scale, 1.0))
