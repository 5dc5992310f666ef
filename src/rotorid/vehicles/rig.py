r"""Quadrotor on a pivot, as published: three double integrators with four late motors.

The platform turns freely around its center and is driven by motor voltages, sampled at 100 Hz for 120 s
(*frequency-domain identification of a quadrotor with composite windows and K-means clustering*). Of roll:

.. math:: J_x \ddot\phi = L K_f \left[ u_3(t - \tau_3) - u_4(t - \tau_4) \right]

The input matrix of the whole attitude has these signs; the one printed for roll alone has the opposite ones and
contradicts it. J_x and K_f were published as two numbers, though the roll angle shows their ratio only: 0.457 rad/s² a
volt from the identified pair (0.458 is printed), 0.424 from the documentation of the platform. Delays of some 0.2 s are
long for motors; they hold the transport of the commands too.

Roll alone was published in numbers. Those of pitch and yaw are chosen, see :data:`ATTITUDE`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from rotorid.data.record import FlightRecord, Maneuver
from rotorid.excitation.sweep import pilot_sweep
from rotorid.models.library import library_model
from rotorid.models.state_space import StateSpace
from rotorid.simulation.hover_flight import STEP_RATE_HZ, Flight
from rotorid.simulation.linear_loop import LinearLoop, as_record, excitation_of, fly_linear
from rotorid.typing import FloatArray

TRUTH: Mapping[str, float] = MappingProxyType(
    {"J_x": 0.047, "K_f": 0.109, "L": 0.197, "tau_3": 0.2279, "tau_4": 0.1770}
)
"""As identified there; SI units and volts."""

ATTITUDE: Mapping[str, float] = MappingProxyType(
    {**TRUTH, "J_y": 0.047, "J_z": 0.094, "K_t": 0.0036, "tau_1": 0.205, "tau_2": 0.190}
)
"""The same with what the paper does not print, chosen.

A rig alike in roll and pitch and flat, so that J_z = J_x + J_y, a torque of 3.3 cm times the thrust, delays of motors
1 and 2 between those of 3 and 4.
"""

DOCUMENTATION: Mapping[str, float] = MappingProxyType({"J_x": 0.0552, "K_f": 0.1188, "L": 0.197})
"""As the documentation of the platform has them."""

MOTORS = ("motor_1", "motor_2", "motor_3", "motor_4")
SAMPLE_RATE_HZ = 100.0
DURATION_S = 120.0
BAND_RAD_S = (0.3, 12.0)
SWEEP_V = 0.6
# Volts for angles and rates: roll and pitch turn with 1 rad/s and a half, yaw with half of it.
_FEEDBACK = np.array(
    [
        [0.0, -1.2, 2.4, 0.0, -1.2, 4.8],
        [0.0, 1.2, 2.4, 0.0, 1.2, 4.8],
        [-1.2, 0.0, -2.4, -1.2, 0.0, -4.8],
        [1.2, 0.0, -2.4, 1.2, 0.0, -4.8],
    ]
)
_GYRO_RAD_S = 0.01


def roll() -> StateSpace:
    """Roll angle and rate after the voltages of motors 3 and 4.

    Examples
    --------
    >>> roll().G.round(3)
    array([[ 0.   ,  0.   ],
           [ 0.457, -0.457]])
    """
    return library_model("rig.roll").matrices(TRUTH)


def attitude() -> StateSpace:
    """Three angles and rates after the voltages of all motors.

    Examples
    --------
    >>> attitude().G[3:].round(3)
    array([[ 0.   ,  0.   ,  0.457, -0.457],
           [ 0.457, -0.457,  0.   ,  0.   ],
           [-0.038, -0.038,  0.038,  0.038]])
    """
    return library_model("rig.attitude").matrices(ATTITUDE)


def fly(
    motors: Sequence[str], rng: np.random.Generator, *, noise: float = 0.05, system: StateSpace | None = None
) -> FlightRecord:
    """Log of 120 s at 100 Hz in which two motors are swept at once, one upward in frequency and one downward, or one.

    A loop holds the angles, since nothing else does; the sweeps are added behind it. Each swept pair moves one axis of
    its own and yaw: all of the attitude takes two flights.

    Parameters
    ----------
    motors
        The one or two that are swept, ``("motor_3", "motor_4")`` for roll.
    rng
        Of the sweeps' irregularity and of the noise.
    noise
        White noise on roll and pitch, as a fraction of the root mean square of the one that is swept, and on yaw, as
        a fraction of its own.
    system
        Another rig with the same inputs and states; by default :func:`attitude`.

    Examples
    --------
    >>> record = fly(("motor_3", "motor_4"), np.random.default_rng(0))
    >>> record.topics[0].values.shape, [str(maneuver.axis) for maneuver in record.declared]
    ((14, 12000), ['roll'])
    """
    test_inputs = np.zeros((len(MOTORS), round(DURATION_S * STEP_RATE_HZ)))
    for row, direction in zip((MOTORS.index(name) for name in motors), (1, -1), strict=False):
        test_inputs[row] = sweep(rng)[::direction]
    return move(test_inputs, rng, noise=noise, system=system)


def move(
    test_inputs: FloatArray,
    rng: np.random.Generator,
    *,
    noise: float = 0.05,
    system: StateSpace | None = None,
    stiffness: float = 1.0,
    unit: str = "V",
    band_rad_s: tuple[float, float] = BAND_RAD_S,
) -> FlightRecord:
    """Log of the rig, at 100 Hz, with test inputs of one's own.

    Parameters
    ----------
    test_inputs
        What the loop adds to each motor, shape ``(4, steps)`` at 1 kHz.
    rng, noise, system
        As for :func:`fly`.
    stiffness
        Gains of the loop over its own, for a rig that answers otherwise.
    unit
        Of the motors.
    band_rad_s
        What the test inputs excite.
    """
    system = system or attitude()

    def flown(noise_rad: FloatArray) -> Flight:
        return _flight(system, test_inputs, noise_rad, rng, stiffness=stiffness, band_rad_s=band_rad_s)

    quiet = flown(np.zeros(3)).columns
    tilt, heading = max(np.std(quiet["phi"]), np.std(quiet["theta"])), np.std(quiet["psi"])
    units = {name: unit for motor in MOTORS for name in (motor, excitation_of(motor))}
    return as_record(flown(noise * np.array([tilt, tilt, heading])), units)


def sweep(
    rng: np.random.Generator,
    *,
    amplitude: float = SWEEP_V,
    band_rad_s: tuple[float, float] = BAND_RAD_S,
    duration_s: float = DURATION_S,
) -> FloatArray:
    """Sweep of one motor at 1 kHz, upward in frequency, shape ``(steps,)``."""
    return pilot_sweep(
        amplitude=amplitude,
        band_rad_s=band_rad_s,
        duration_s=duration_s,
        sample_rate_hz=STEP_RATE_HZ,
        slow_cycles=2.0,
        fade_s=0.5,
        trim_s=0.0,
        noise_fraction=0.1,
        rng=rng,
    )


def _flight(
    system: StateSpace,
    test_inputs: FloatArray,
    noise_rad: FloatArray,
    rng: np.random.Generator,
    *,
    stiffness: float,
    band_rad_s: tuple[float, float],
) -> Flight:
    loop = LinearLoop(
        name="rig",
        system=system,
        inputs=MOTORS,
        outputs=("phi", "theta", "psi", "p", "q", "r"),
        error=stiffness * _FEEDBACK,
        proportional=(1.0,) * len(MOTORS),
        integral=(0.0,) * len(MOTORS),
        noise_std=(*noise_rad.tolist(), _GYRO_RAD_S, _GYRO_RAD_S, _GYRO_RAD_S),
    )
    whole = Maneuver(
        axis="roll" if test_inputs[2:].any() else "pitch",
        kind="sweep",
        start_s=0.0,
        stop_s=test_inputs.shape[1] / STEP_RATE_HZ,
        band_rad_s=band_rad_s,
        origin="declared",
    )
    return fly_linear(loop, test_inputs, sample_rate_hz=SAMPLE_RATE_HZ, maneuvers=[whole], rng=rng)
