r"""The Parrot Bebop 2 of `rotorid.vehicles.bebop` as a vehicle that flies freely, behind its set-points.

Roll, pitch and vertical speed answer their set-points like the published responses. Those disagree: at any frequency
from 0.5 to 10 rad/s, the models of first order, of first order with delay and of second order lie within a circle about
their mean, whose radius is 0.03 to 0.2 of the set-point, and the responses here lie in that circle too. Drag over mass
is the published one, 0.25 1/s ahead and 0.33 1/s to the side.

What is ours: everything inside. Mass and inertia are those that users of the vehicle fly it with (LADAC, TU
Braunschweig), the arm, the thrust curve, the torque and the gains are chosen. There is no integral: as with the
published responses, what stays is not quite what was asked for.

A plan moves the attitude at the entry ``attitude_setpoint``, and the vertical speed by the thrust stick, of which one
asks for 1 m/s upward. :func:`interface` makes of a flight what the autopilot's interface shows, at 20 Hz.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rotorid.data.simulated_flight import SimulatedFlight
from rotorid.models.rotor_layout_library import library_layout
from rotorid.simulate.autopilot import Autopilot, Guidance, RateLoop
from rotorid.simulate.multirotor import Multirotor, Rotors
from rotorid.simulate.multirotor_flight import Aircraft
from rotorid.simulate.sensors import Sensors
from rotorid.typing import IntArray
from rotorid.units import STANDARD_GRAVITY_M_S2
from rotorid.vehicles.bebop import DRAG_1_S, PAIRS, SAMPLE_S

SOURCE = (
    "System identification for an autonomous drone, table I and appendix L (drag, responses); LADAC, TU Braunschweig "
    "(mass, inertia); arm, thrust, torque and gains are ours"
)

MASS_KG = 0.5
INERTIA_KG_M2 = (0.0019, 0.0019, 0.0033)
ARM_M = 0.16
THRUST_PER_WEIGHT = 2.2
TORQUE_PER_THRUST_M = 0.02
LAG_S = 0.02
CLIMB_DRAG_1_S = 0.3
RATE_HZ = 400.0

RATE_1_S = (29.0, 29.0, 5.0)
"""What the rate controllers make of the vehicle: angular acceleration per rate error."""

ANGLE_1_S = (4.6, 4.7, 2.0)
CLIMB_1_S = 3.6
CLIMB_GAIN = 1.1
"""Vertical speed wanted inside over the one that was asked for; published steady gains are 0.92 to 1.23."""

TILT_DELAY_S, CLIMB_DELAY_S = 0.005, 0.06
"""Of the loops inside, with the half tick that a held command shows as."""

_MIXER = np.array([[-0.5, 0.5, 1.0, 1.0], [0.5, -0.5, 1.0, 1.0], [0.5, 0.5, -1.0, 1.0], [-0.5, -0.5, -1.0, 1.0]])


def aircraft() -> Aircraft:
    """What flies.

    Examples
    --------
    >>> aircraft().vehicle.hover_shares.round(3).tolist()
    [0.674, 0.674, 0.674, 0.674]
    """
    weight_n = MASS_KG * STANDARD_GRAVITY_M_S2
    layout = library_layout("quad.x").scaled(ARM_M)
    drag = MASS_KG * np.array([DRAG_1_S["forward"][0], DRAG_1_S["right"][0], CLIMB_DRAG_1_S])
    vehicle = Multirotor(
        name="bebop",
        mass_kg=MASS_KG,
        inertia_kg_m2=np.array(INERTIA_KG_M2),
        rotors=Rotors(
            layout=layout,
            thrust=(0.0, 0.0, THRUST_PER_WEIGHT * weight_n / layout.rotors),
            torque_per_thrust_m=TORQUE_PER_THRUST_M,
            lag_up_s=LAG_S,
        ),
        aerodynamics=np.diag([*-drag, 0.0, 0.0, 0.0]),
        source=SOURCE,
    )
    return Aircraft(vehicle=vehicle, autopilot=_autopilot(vehicle), sensors=Sensors())


def _autopilot(vehicle: Multirotor) -> Autopilot:
    roll, pitch, yaw, lift = _accelerations(vehicle)
    tilting_s, climbing_s = (delay - 0.5 / RATE_HZ for delay in (TILT_DELAY_S, CLIMB_DELAY_S))
    return Autopilot(
        kind="simple",
        rate_hz=RATE_HZ,
        rates=RateLoop(proportional=(RATE_1_S[0] / roll, RATE_1_S[1] / pitch, RATE_1_S[2] / yaw)),
        angle_1_s=ANGLE_1_S,
        guidance=Guidance(stick_climb_m_s=CLIMB_GAIN, climb_p=CLIMB_1_S / lift, hold_height=True),
        delay_s=(tilting_s, tilting_s, tilting_s, climbing_s),
        mixer=_MIXER,
    )


def _accelerations(vehicle: Multirotor) -> list[float]:
    """Of roll, pitch, yaw (rad/s²) and upward (m/s²), per unit of command in hover."""
    share = float(vehicle.hover_shares[0])
    slope_n = vehicle.rotors.thrust[1] + 2.0 * share * vehicle.rotors.thrust[2]
    per_command = slope_n * vehicle.wrench @ _MIXER
    moments = np.diag(per_command[3:, :3]) / np.diag(vehicle.inertia_kg_m2)
    return [*moments.tolist(), -float(per_command[2, 3]) / vehicle.mass_kg]


def interface(
    flown: SimulatedFlight, *, rng: np.random.Generator | None = None, jitter_s: float = 0.002
) -> SimulatedFlight:
    """What a flight looks like from outside: set-points and answers at 20 Hz, and nothing from inside.

    Parameters
    ----------
    flown
        A flight of :func:`aircraft`.
    rng
        Of the stamps; without one they are even.
    jitter_s
        Their standard deviation. A stamp goes to the nearest turn of the control loop, and they stay in order.

    Returns
    -------
    SimulatedFlight
        ``phi_setpoint theta_setpoint velocity_down_setpoint`` and ``phi theta psi velocity_north velocity_east
        velocity_down north east down``.

    Examples
    --------
    >>> from rotorid.simulate.multirotor_flight import fly_multirotor
    >>> outside = interface(fly_multirotor(aircraft(), duration_s=2.0))
    >>> outside.samples, outside.time_s[:3].tolist(), "p" in outside.columns
    (40, [0.0, 0.05, 0.1], False)
    """
    picked = _picked(flown, rng, jitter_s)
    columns = {name: values[picked] for name, values in flown.columns.items() if name in _OUTSIDE}
    stick = flown.columns.get("thrust_stick", np.zeros(flown.samples))
    columns["velocity_down_setpoint"] = 0.0 - stick[picked]
    return replace(
        flown,
        sample_rate_hz=1.0 / SAMPLE_S,
        time_s=flown.time_s[picked],
        columns=columns,
        raw={},
        truth={name: values[picked] for name, values in flown.truth.items()},
        parameters={},
    )


_OUTSIDE = frozenset(name for pair in PAIRS for name in pair) | {
    *("psi", "velocity_north", "velocity_east", "north", "east", "down")
}


def _picked(flown: SimulatedFlight, rng: np.random.Generator | None, jitter_s: float) -> IntArray:
    """Turns of the control loop at which the interface looks."""
    stride = SAMPLE_S * flown.sample_rate_hz
    places = np.arange(int(flown.samples / stride)) * stride
    if rng is not None:
        places = places + jitter_s * flown.sample_rate_hz * rng.standard_normal(places.size)
    return np.unique(np.clip(np.rint(places), 0, flown.samples - 1).astype(np.int64))
