r"""The two quadrotors of PX4's Gazebo worlds, from their model files: the x500 and the iris.

Each rotor follows what it is asked for with one lag upward and another one downward, and

.. math::

    \Omega_i = \Omega_0 + (\Omega_1 - \Omega_0) u_i, \qquad T_i = k \Omega_i^2, \qquad Q_i = k_m T_i, \qquad
    F_i = -d \, \Omega_i (u, v, 0)^T

with the speeds :math:`\Omega_0` and :math:`\Omega_1` at no and at full output. The speed of a rotor here is its output,
so that the drag of a rotor is exact in hover and goes with :math:`u_i` away from it.

Left out: the rotors' own masses and inertias, their rolling moment (a thousandth of the others), and in the iris the
thrust that Gazebo classic takes away with airspeed. What is ours: the delay of one step of the simulation, 4 ms, and in
PX4's parameters the places of the rotors, which are those of the model here; PX4's airframe of the x500 has 0.13 and
0.20 to 0.22 m.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rotorid.models.rotors import RotorLayout
from rotorid.simulation.multirotor import Multirotor, Rotors, Sensors
from rotorid.simulation.multirotor_flight import Aircraft
from rotorid.units import STANDARD_GRAVITY_M_S2
from rotorid.vehicles.px4 import PX4_PARAMETERS, hover_guidance, px4_autopilot, rotor_parameters

X500_SOURCE = "PX4-gazebo-models, x500 and x500_base; PX4, airframe 4001_gz_x500"
IRIS_SOURCE = "PX4-SITL_gazebo-classic, iris"

_STEP_S = 0.004
_SPINS = (1.0, 1.0, -1.0, -1.0)


@dataclass(frozen=True, kw_only=True, slots=True)
class Motor:
    """A motor model of Gazebo.

    Parameters
    ----------
    idle_rad_s, full_rad_s
        Speeds at no and at full output.
    thrust_n_s2
        Thrust over speed squared, ``motorConstant``.
    torque_per_thrust_m
        ``momentConstant``.
    drag_n_s2_m
        Force over speed and velocity across, ``rotorDragCoefficient``.
    """

    idle_rad_s: float
    full_rad_s: float
    thrust_n_s2: float
    torque_per_thrust_m: float
    drag_n_s2_m: float

    def rotors(self, layout: RotorLayout, weight_n: float) -> Rotors:
        """Rotors of a vehicle of this weight; the lags are those of all these models."""
        range_rad_s = self.full_rad_s - self.idle_rad_s
        c_0, c_1, c_2 = self.idle_rad_s**2, 2.0 * self.idle_rad_s * range_rad_s, range_rad_s**2
        hover_rad_s = (weight_n / layout.rotors / self.thrust_n_s2) ** 0.5
        hover_share = (hover_rad_s - self.idle_rad_s) / range_rad_s
        return Rotors(
            layout=layout,
            thrust=(self.thrust_n_s2 * c_0, self.thrust_n_s2 * c_1, self.thrust_n_s2 * c_2),
            torque_per_thrust_m=self.torque_per_thrust_m,
            lag_up_s=0.0125,
            lag_down_s=0.025,
            induced_drag_n_s_m=self.drag_n_s2_m * hover_rad_s / hover_share,
        )


X500_MOTOR = Motor(
    idle_rad_s=150.0, full_rad_s=1000.0, thrust_n_s2=8.54858e-6, torque_per_thrust_m=0.016, drag_n_s2_m=8.06428e-5
)
X500_MASS_KG = 2.0
X500_INERTIA_KG_M2 = (0.02167, 0.02167, 0.04)
X500_LAYOUT = RotorLayout(
    name="x500",
    positions=np.array(
        [[0.174, 0.174, -0.06], [-0.174, -0.174, -0.06], [0.174, -0.174, -0.06], [-0.174, 0.174, -0.06]]
    ),
    spins=np.array(_SPINS),
    arm_known=True,
    source=X500_SOURCE,
)

IRIS_MOTOR = Motor(
    idle_rad_s=100.0, full_rad_s=1100.0, thrust_n_s2=5.84e-6, torque_per_thrust_m=0.06, drag_n_s2_m=1.75e-4
)
IRIS_MASS_KG = 1.5
IRIS_INERTIA_KG_M2 = (0.029125, 0.029125, 0.055225)
IRIS_LAYOUT = RotorLayout(
    name="iris",
    positions=np.array([[0.13, 0.22, -0.023], [-0.13, -0.2, -0.023], [0.13, -0.22, -0.023], [-0.13, 0.2, -0.023]]),
    spins=np.array(_SPINS),
    arm_known=True,
    source=IRIS_SOURCE,
)

_SENSORS = Sensors(gyro_noise_rad_s=1.9e-4, accelerometer_noise_m_s2=1.9e-3)
"""As in the model of the x500, which is quieter than any real vehicle."""


def x500() -> Aircraft:
    """The x500 of Gazebo, held in velocity and height.

    Examples
    --------
    >>> float(x500().vehicle.hover_shares[0].round(4))
    0.7145
    """
    vehicle = Multirotor(
        name="x500",
        mass_kg=X500_MASS_KG,
        inertia_kg_m2=np.array(X500_INERTIA_KG_M2),
        rotors=X500_MOTOR.rotors(X500_LAYOUT, X500_MASS_KG * STANDARD_GRAVITY_M_S2),
        source=X500_SOURCE,
    )
    return _with_px4(vehicle, {"MPC_THR_HOVER": 0.6})


def iris() -> Aircraft:
    """The iris of Gazebo classic, held in velocity and height.

    Examples
    --------
    >>> float(iris().vehicle.hover_shares[0].round(4))
    0.6935
    """
    vehicle = Multirotor(
        name="iris",
        mass_kg=IRIS_MASS_KG,
        inertia_kg_m2=np.array(IRIS_INERTIA_KG_M2),
        rotors=IRIS_MOTOR.rotors(IRIS_LAYOUT, IRIS_MASS_KG * STANDARD_GRAVITY_M_S2),
        source=IRIS_SOURCE,
    )
    return _with_px4(vehicle, {"SYS_AUTOSTART": 10015.0})


def _with_px4(vehicle: Multirotor, others: Mapping[str, float]) -> Aircraft:
    rotors = vehicle.rotors
    placed = rotor_parameters(rotors.layout, torque_per_thrust_m=rotors.torque_per_thrust_m)
    parameters = {**PX4_PARAMETERS, **placed, **others}
    autopilot = px4_autopilot(parameters, guidance=hover_guidance(parameters), delay_s=(_STEP_S,) * 4)
    return Aircraft(vehicle=vehicle, autopilot=autopilot, sensors=_SENSORS)
