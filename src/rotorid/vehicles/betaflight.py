r"""A racing quadrotor of 5 inches under Betaflight's cascade, from Betaflight's own settings.

The settings fly the simulation and fill its log. Gains are those of the firmware's scales
(:mod:`rotorid.models.autopilots.betaflight`); the rate loop runs at 1 kHz, with the derivative of the gyro behind one
first-order low-pass. Off, as their settings in the log say: feedforward, TPA, the second low-pass and the notches, the
relaxed integral, D that moves. Sticks ask for angles, as in ANGLE mode before version 4.5.

No vehicle was measured for it: mass, arm and thrust are what such frames have, the inertia is that of four motors of
30 g on the arms with a body of 0.5 kg, and the thrust is linear and quadratic in the output:

.. math::

    T = 3\,\mathrm{N}\, x + 10\,\mathrm{N}\, x^2, \quad 0.022\,\mathrm{s}\;\dot x = u - x
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from rotorid.models.autopilots.betaflight import PER_D, PER_I, PER_P, YAW_I
from rotorid.models.rotors import RotorLayout, library_layout
from rotorid.simulation.autopilot import Autopilot, Guidance, RateLoop, Three
from rotorid.simulation.multirotor import Multirotor, Rotors, Sensors
from rotorid.simulation.multirotor_flight import Aircraft

SOURCE = "values of a common frame of 5 inches; Betaflight 4.4's settings and scales"
RATE_HZ = 1000.0

SETTINGS: Mapping[str, float] = MappingProxyType(
    {
        "looptime": 125.0,
        "pid_process_denom": 8.0,
        "rollPID_P": 40.0,
        "rollPID_I": 60.0,
        "rollPID_D": 30.0,
        "pitchPID_P": 46.0,
        "pitchPID_I": 66.0,
        "pitchPID_D": 34.0,
        "yawPID_P": 80.0,
        "yawPID_I": 12.0,
        "yawPID_D": 0.0,
        "levelPID_P": 50.0,
        "levelPID_I": 50.0,
        "levelPID_D": 75.0,
        "d_min_0": 0.0,
        "d_min_1": 0.0,
        "d_min_2": 0.0,
        "ff_weight_0": 0.0,
        "ff_weight_1": 0.0,
        "ff_weight_2": 0.0,
        "tpa_rate": 0.0,
        "tpa_breakpoint": 1350.0,
        "iterm_relax": 0.0,
        "anti_gravity_gain": 0.0,
        "gyro_lpf1_type": 1.0,
        "gyro_lpf1_static_hz": 120.0,
        "gyro_lpf1_dyn_hz_0": 0.0,
        "gyro_lpf1_dyn_hz_1": 0.0,
        "gyro_lpf2_static_hz": 0.0,
        "acc_lpf_hz": 5000.0,
        "dterm_lpf1_type": 0.0,
        "dterm_lpf1_static_hz": 90.0,
        "dterm_lpf1_dyn_hz_0": 0.0,
        "dterm_lpf1_dyn_hz_1": 0.0,
        "dterm_lpf2_static_hz": 0.0,
        "yaw_lowpass_hz": 0.0,
        "dyn_notch_count": 0.0,
        "rpm_filter_harmonics": 0.0,
        "thrust_linear": 0.0,
        "vbat_sag_compensation": 0.0,
    }
)
"""By the names that the header of a log has; lists are numbered, and parts of gains are named."""

MASS_KG = 0.62
INERTIA_KG_M2 = (0.0030, 0.0036, 0.0055)
ARM_M = 0.11
THRUST_N = (0.0, 3.0, 10.0)
"""By powers of the output."""
TORQUE_PER_THRUST_M = 0.012
LAG_S = 0.022
DRAG_N_S_M, DAMPING_N_M_S = 0.25, 0.002
SENSORS = Sensors(gyro_noise_rad_s=0.02, accelerometer_noise_m_s2=0.6)

_TILT_RAD = math.radians(55.0)
"""``angle_limit``."""
_MIX = np.array(
    [[-1.0, -1.0, -1.0, 1.0], [-1.0, 1.0, 1.0, 1.0], [1.0, -1.0, 1.0, 1.0], [1.0, 1.0, -1.0, 1.0]],
)  # fmt: skip
"""Motors rear right, front right, rear left, front left by roll, pitch, yaw, thrust."""


def betaflight_autopilot() -> Autopilot:
    """The cascade that Betaflight flies with :data:`SETTINGS`, which go to the log as they are.

    Examples
    --------
    >>> [round(gain, 4) for gain in betaflight_autopilot().rates.proportional]
    [0.0734, 0.0844, 0.1468]
    """

    def each(letter: str, scale: float) -> Three:
        roll, pitch, yaw = (scale * SETTINGS[f"{axis}PID_{letter}"] for axis in ("roll", "pitch", "yaw"))
        return roll, pitch, yaw

    roll, pitch, yaw = each("I", PER_I)
    angle = SETTINGS["levelPID_P"] / 10.0
    return Autopilot(
        kind="betaflight",
        rate_hz=1e6 / (SETTINGS["looptime"] * SETTINGS["pid_process_denom"]),
        rates=RateLoop(
            proportional=each("P", PER_P),
            integral=(roll, pitch, YAW_I * yaw),
            derivative=each("D", PER_D),
            integral_limit=(0.4, 0.4, 0.4),
            derivative_cutoff_hz=(SETTINGS["dterm_lpf1_static_hz"],) * 3,
        ),
        angle_1_s=(angle, angle, 2.0),
        guidance=Guidance(
            tilt_limit_rad=_TILT_RAD,
            stick_tilt_rad=_TILT_RAD,
            stick_yaw_rate_rad_s=math.radians(200.0),
            stick_thrust=0.25,
            heading_follows=True,
        ),
        rate_limit_rad_s=(math.radians(670.0),) * 3,
        gyro_cutoff_hz=SETTINGS["gyro_lpf1_static_hz"],
        # The header has hundredths.
        accelerometer_cutoff_hz=SETTINGS["acc_lpf_hz"] / 100.0,
        mixer=_MIX,
        parameters=SETTINGS,
    )


def layout() -> RotorLayout:
    """The rotors, in meters, in Betaflight's order.

    Examples
    --------
    >>> layout().positions[0].round(3).tolist()
    [-0.078, 0.078, 0.0]
    """
    return library_layout("quad.x.betaflight").scaled(ARM_M)


def aircraft() -> Aircraft:
    """What flies.

    Examples
    --------
    >>> aircraft().vehicle.hover_shares.round(3).tolist()
    [0.268, 0.268, 0.268, 0.268]
    """
    vehicle = Multirotor(
        name="betaflight_quad",
        mass_kg=MASS_KG,
        inertia_kg_m2=np.array(INERTIA_KG_M2),
        rotors=Rotors(layout=layout(), thrust=THRUST_N, torque_per_thrust_m=TORQUE_PER_THRUST_M, lag_up_s=LAG_S),
        aerodynamics=-np.diag([DRAG_N_S_M] * 3 + [DAMPING_N_M_S] * 3),
        source=SOURCE,
    )
    return Aircraft(vehicle=vehicle, autopilot=betaflight_autopilot(), sensors=SENSORS)
