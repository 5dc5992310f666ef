r"""Horizontal accelerations that thrust, tilt and drag make, in level axes: x forward and y to the right.

.. math::

    \ddot x &= a_z \sin\theta \cos\phi + X_u u \cos\theta + Y_v v \sin\theta \sin\phi \\
    \ddot y &= -a_z \sin\phi + Y_v v \cos\phi

with the specific force :math:`a_z` of the rotors, which points up, body velocities u and v, and drag over mass by them.
For small angles and without drag these are the printed equations of the paper on the genetic algorithm
(:mod:`rotorid.fitting.motors.accelerations`), turned by the heading. What is compared are increments of the velocity
over the earth, turned into level axes at the middle of each sample, so that a turning heading adds nothing.

Assumes air at rest or in steady wind, and the attitude on the clock of the velocity. What breaks it: gusts that a
controller tilts against, and a velocity that an estimator smooths or delays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rotorid.data.record import MotorRecord
from rotorid.fitting.motors.excitation import Excitation, slow_correlation
from rotorid.frames import body_to_earth, earth_to_body
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

DRAG: Mapping[str, str] = {"x": "X_u", "y": "Y_v"}
"""Level axis to the drag over mass of the body axis next to it."""


class Translation(NamedTuple):
    """What a record shows of its horizontal motion, between samples; rows x and y, shape ``(2, n - 1)`` each.

    Parameters
    ----------
    measured
        Acceleration in m/s².
    lean
        Acceleration by a specific force of one along the body's z axis, at samples, shape ``(2, n)``.
    drag
        Acceleration by each drag of one: parameter to rows.
    """

    measured: FloatArray
    lean: FloatArray
    drag: Mapping[str, FloatArray]


def shows_translation(record: MotorRecord) -> bool:
    """Whether velocity and attitude are known."""
    return record.velocity.size > 0 and record.attitude.size > 0


def translation(record: MotorRecord) -> Translation:
    """Horizontal motion of a record that has velocity and attitude.

    Examples
    --------
    Leaning forward by 0.1 rad, a vehicle gains speed until its drag balances that:

    >>> still, attitude = np.zeros(50), np.zeros((3, 50))
    >>> attitude[1] = -0.1
    >>> record = MotorRecord(name="lean", sample_rate_hz=50.0, outputs=np.zeros((4, 50)), rates=np.zeros((3, 50)),
    ...                      az=still, velocity=np.stack([2.0 + still, still, still]), attitude=attitude)
    >>> moved = translation(record)
    >>> (-9.81 * moved.lean[0]).round(2)[0], moved.drag["X_u"][0].round(2)[0]
    (np.float64(0.98), np.float64(1.99))
    """
    phi, theta, psi = record.attitude
    u, v, _ = record.velocity
    over_earth = body_to_earth(record.attitude, record.velocity)[:2]
    turn = np.diff(psi)
    heading = psi[:-1] + 0.5 * np.arctan2(np.sin(turn), np.cos(turn))
    north, east = record.sample_rate_hz * np.diff(over_earth, axis=1)
    cosine, sine = np.cos(heading), np.sin(heading)
    return Translation(
        measured=np.stack([cosine * north + sine * east, cosine * east - sine * north]),
        lean=np.stack([np.sin(theta) * np.cos(phi), -np.sin(phi)]),
        drag={
            "X_u": between(np.stack([np.cos(theta) * u, np.zeros(u.size)])),
            "Y_v": between(np.stack([np.sin(theta) * np.sin(phi) * v, np.cos(phi) * v])),
        },
    )


def between(rows: FloatArray) -> FloatArray:
    """Mean of both ends of each sample, along the last axis."""
    return np.asarray(0.5 * (rows[..., 1:] + rows[..., :-1]))


def with_translation(
    found: Sequence[Mapping[str, Excitation]], records: Sequence[MotorRecord]
) -> tuple[dict[str, Excitation], ...]:
    """Excitations of every record, with those of x and y where velocity and attitude are known.

    Tilt that speeds the vehicle up and drag that slows it down are both taken for what the vehicle does itself; gusts
    are what they leave.

    Parameters
    ----------
    found
        Of :func:`rotorid.fitting.motors.excitation.excitations`.
    records
        The same records.
    """
    return tuple({**excited, **_excited(record)} for excited, record in zip(found, records, strict=True))


def _excited(record: MotorRecord) -> dict[str, Excitation]:
    if not shows_translation(record):
        return {}
    moved = translation(record)
    made = -STANDARD_GRAVITY_M_S2 * between(moved.lean)
    return {
        axis: Excitation(
            slow_correlation(np.stack([made[row], -moved.drag[name][row]]), moved.measured[row], record.sample_rate_hz),
            0.0,
        )
        for row, (axis, name) in enumerate(DRAG.items())
    }


def translated_axes(found: Sequence[Mapping[str, Excitation]]) -> tuple[str, ...]:
    """Level axes along which some record moves by tilt."""
    return tuple(axis for axis in DRAG if any(axis in record and record[axis].counts for record in found))


def translation_behind(record: MotorRecord, taps: FloatArray) -> MotorRecord:
    """A record whose velocity and attitude are behind a filter that has long settled on their first values.

    The velocity passes it over the earth, where turning axes do not count as motion.
    """
    if not shows_translation(record) or taps.size == 1:
        return record

    def passed(rows: FloatArray) -> FloatArray:
        first = rows[:, :1]
        moved = [np.convolve(row, taps)[: row.size] for row in rows - first]
        return np.asarray(np.stack(moved) + taps.sum() * first)

    attitude = passed(np.unwrap(record.attitude, axis=1))
    velocity = passed(body_to_earth(record.attitude, record.velocity))
    return replace(record, attitude=attitude, velocity=earth_to_body(attitude, velocity))
