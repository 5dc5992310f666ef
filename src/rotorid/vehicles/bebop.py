"""The Parrot Bebop 2: published responses to set-points, and a vehicle that flies freely behind the same set-points.

**Published.** Flown under motion capture at 20 Hz with random binary commands of all three at once (*System
identification for an autonomous drone*; the paper's appendix L has the numbers). Inputs are ``phi_setpoint``,
``theta_setpoint`` and ``velocity_down_setpoint``, outputs ``phi``, ``theta`` and ``velocity_down``; the paper counts
vertical speed upward, which changes both sides alike.

The parameters of first order are averages over four records, those of second and third order the fit to the first of
them. The states of those have no meaning. Of the fourth order only pitch is printed whole: in roll one entry of B is
missing and another stands twice, and the output matrix of vertical speed is not there.

Higher orders took a trim of the pitch angle for slow dynamics: the third order has a pole of pitch at -0.005 1/s and a
steady gain of -13.4, the fourth one of -109. Over the 18 s of a record this hardly shows. A command that stays would
in the end tilt these models the wrong way.

**Flying.** Roll, pitch and vertical speed answer their set-points like the published responses. Those disagree: at any
frequency from 0.5 to 10 rad/s, the models of first order, of first order with delay and of second order lie within a
circle about their mean, whose radius is 0.03 to 0.2 of the set-point, and the responses here lie in that circle too.
Drag over mass is the published one, 0.25 1/s ahead and 0.33 1/s to the side.

What is ours: everything inside. Mass and inertia are those that users of the vehicle fly it with (LADAC, TU
Braunschweig), the arm, the thrust curve, the torque and the gains are chosen. There is no integral: as with the
published responses, what stays is not quite what was asked for.

A plan moves the attitude at the entry ``attitude_setpoint``, and the vertical speed by the thrust stick, of which one
asks for 1 m/s upward. :func:`interface` makes of a flight what the autopilot's interface shows, at 20 Hz.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from rotorid.data.flight_plan import SimulatedFlight
from rotorid.models.library import response_model
from rotorid.models.rotors import library_layout
from rotorid.models.state_space import StateSpace
from rotorid.simulation.autopilot import Autopilot, Guidance, RateLoop
from rotorid.simulation.multirotor import Multirotor, Rotors, Sensors
from rotorid.simulation.multirotor_flight import Aircraft
from rotorid.typing import Axis, FloatArray, IntArray
from rotorid.units import STANDARD_GRAVITY_M_S2

PAIRS: tuple[tuple[str, str], ...] = (
    ("phi_setpoint", "phi"),
    ("theta_setpoint", "theta"),
    ("velocity_down_setpoint", "velocity_down"),
)
"""Set-point and response of each channel."""

SAMPLE_S = 0.05
"""Interval of the commands and of the motion capture."""

BAND_RAD_S = (1.5, 8.5)
"""What its test inputs excite: up to 0.35 over the shortest rise time; below, attitudes carry it out of the room."""

LARGEST: Mapping[Axis, float] = MappingProxyType({"roll": 0.1047, "pitch": 0.1047, "thrust": 0.5})
"""Set-points of the published records: 6° and 0.5 m/s."""

SIMULATED_SAMPLE_S = 0.0504
"""Mean interval of the stamps with the pauses before the maneuvers, with which the printed fits come out."""

FIRST_ORDER: Mapping[str, float] = MappingProxyType(
    {
        "K_phi": 1.126,
        "T_phi": 0.2368,
        "K_theta": 1.1075,
        "T_theta": 0.2318,
        "K_velocity_down": 1.2270,
        "T_velocity_down": 0.3367,
    }
)
"""Appendix L, A; parameters of ``response.first_order``."""

FIRST_ORDER_DELAY: Mapping[str, float] = MappingProxyType(
    {
        "K_phi": 0.9655,
        "T_phi": 0.1598,
        "tau_phi": SAMPLE_S,
        "K_theta": 0.9795,
        "T_theta": 0.1621,
        "tau_theta": SAMPLE_S,
        "K_velocity_down": 1.1635,
        "T_velocity_down": 0.2599,
        "tau_velocity_down": SAMPLE_S,
    }
)
"""Appendix L, B; parameters of ``response.first_order_delay``. Delays of one sample each, the least they could be."""

YAW_RATE: Mapping[str, float] = MappingProxyType({"K_r": 1.5979, "T_r": 1.3542, "tau_r": 0.15})
"""Appendix J, from a record of someone else; parameters of ``response.first_order_delay`` on ``r``."""

DRAG_1_S: Mapping[str, tuple[float, float]] = MappingProxyType({"forward": (0.25, 0.08), "right": (0.33, 0.05)})
"""Table I: drag over mass and its standard deviation over the steps."""

RISE_TIME_S: Mapping[str, tuple[float, float]] = MappingProxyType(
    {"theta": (0.260, 0.055), "phi": (0.410, 0.0424), "velocity_down": (0.313, 0.025)}
)
"""Table III: mean and standard deviation, read to a sample."""

_SECOND = (
    ([[-3.6268, 4.5680], [-4.2580, -3.8136]], [3.3057, -1.5443], [-0.1337, -1.4979]),
    ([[-6.5559, 5.4182], [-4.8719, -5.1334]], [-0.2825, -3.9654], [-2.2622, -0.1050]),
    ([[-4.5702, 4.4186], [-4.9402, -4.7852]], [3.3742, 0.4442], [0.1768, -2.5312]),
)
_THIRD = (
    (
        [[-3.0696, -3.5650, -2.4296], [0.0520, -5.4143, -5.9011], [3.7089, 1.0430, -1.4279]],
        [-2.1462, 1.6727, 3.5351],
        [-0.5915, -0.8319, 0.4358],
    ),
    (
        [[-6.1824, -1.8848, -5.5527], [-2.7956, -1.6305, 2.0099], [2.9196, 2.5074, -6.8438]],
        [3.2526, 1.1928, -0.7547],
        [1.5283, -0.8466, 3.8820],
    ),
    (
        [[-4.4829, 4.6997, 8.1645], [-3.2938, -5.6196, 2.7175], [-7.0201, -1.7885, -3.5407]],
        [1.4509, -3.2656, 3.3287],
        [0.5327, -2.8051, -2.4470],
    ),
)
_FOURTH_PITCH = (
    [
        [-1.6003, -1.6104, 2.5787, 0.8336],
        [0.5943, -1.7293, 1.4047, 2.9910],
        [-2.1009, 4.1525, -4.5706, -3.7690],
        [0.4700, -3.0666, 5.0265, -0.7570],
    ],
    [0.5930, 1.3859, -3.3685, -0.0717],
    [1.2238, 0.4942, -0.2987, -1.6873],
)


def first_order() -> StateSpace:
    """All three channels as lags.

    Examples
    --------
    >>> first_order().poles().real.round(2).tolist()
    [-2.97, -4.22, -4.31]
    """
    return response_model("response.first_order", PAIRS).matrices(FIRST_ORDER)


def first_order_delay() -> StateSpace:
    """All three channels as lags behind a delay of one sample.

    Examples
    --------
    >>> first_order_delay().input_delays_s.tolist()
    [0.05, 0.05, 0.05]
    """
    return response_model("response.first_order_delay", PAIRS).matrices(FIRST_ORDER_DELAY)


def second_order() -> StateSpace:
    """All three channels, two states each.

    Examples
    --------
    >>> second_order().poles()[[0, 2, 4]].round(2)
    array([-3.72-4.41j, -4.68-4.67j, -5.84-5.09j])
    """
    return _side_by_side(_SECOND)


def third_order() -> StateSpace:
    """All three channels, three states each, with a pole of pitch next to zero.

    Examples
    --------
    >>> float(third_order().poles()[0].real.round(4))
    -0.0049
    """
    return _side_by_side(_THIRD)


def fourth_order_pitch() -> StateSpace:
    """Pitch alone, the only channel of the fourth order that is printed whole.

    Examples
    --------
    >>> fourth_order_pitch().F.shape
    (4, 4)
    """
    return _side_by_side((_FOURTH_PITCH,))


def _side_by_side(channels: Sequence[tuple[list[list[float]], list[float], list[float]]]) -> StateSpace:
    from scipy.linalg import block_diag

    def diagonal(blocks: Sequence[FloatArray]) -> FloatArray:
        return np.asarray(block_diag(*blocks), dtype=np.float64)

    A = diagonal([np.array(a) for a, _, _ in channels])
    C = diagonal([np.array([c]) for _, _, c in channels])
    return StateSpace(
        M=np.eye(len(A)),
        F=A,
        G=diagonal([np.array(b)[:, None] for _, b, _ in channels]),
        H0=C,
        H1=np.zeros_like(C),
        input_delays_s=np.zeros(len(channels)),
        output_delays_s=np.zeros(len(channels)),
    )


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
    flight: SimulatedFlight, *, rng: np.random.Generator | None = None, jitter_s: float = 0.002
) -> SimulatedFlight:
    """What a flight looks like from outside: set-points and answers at 20 Hz, and nothing from inside.

    A set-point is what was sent at a stamp and held until the next one: the value in the middle between the two.

    Parameters
    ----------
    flight
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
    >>> from rotorid.simulation.multirotor_flight import fly_multirotor
    >>> outside = interface(fly_multirotor(aircraft(), duration_s=2.0))
    >>> outside.samples, outside.time_s[:3].tolist(), "p" in outside.columns
    (40, [0.0, 0.05, 0.1], False)
    """
    picked = _picked(flight, rng, jitter_s)
    sent = _sent(flight, picked)
    columns = {
        name: values[sent if name in _ASKED else picked] for name, values in flight.columns.items() if name in _OUTSIDE
    }
    stick = flight.columns.get("thrust_stick", np.zeros(flight.samples))
    columns["velocity_down_setpoint"] = 0.0 - stick[sent]
    return replace(
        flight,
        sample_rate_hz=1.0 / SAMPLE_S,
        time_s=flight.time_s[picked],
        columns=columns,
        raw={},
        truth={name: values[picked] for name, values in flight.truth.items()},
        parameters={},
    )


_ASKED = frozenset(setpoint for setpoint, _ in PAIRS)
_OUTSIDE = frozenset(name for pair in PAIRS for name in pair) | {
    *("psi", "velocity_north", "velocity_east", "north", "east", "down")
}


def _sent(flight: SimulatedFlight, picked: IntArray) -> IntArray:
    """Turns of the control loop in the middle of the time for which what was sent at a stamp is held."""
    stride = SAMPLE_S * flight.sample_rate_hz
    middle = (np.rint(picked / stride) + 0.5) * stride
    return np.clip(np.rint(middle), 0, flight.samples - 1).astype(np.int64)


def _picked(flight: SimulatedFlight, rng: np.random.Generator | None, jitter_s: float) -> IntArray:
    """Turns of the control loop at which the interface looks."""
    stride = SAMPLE_S * flight.sample_rate_hz
    places = np.arange(int(flight.samples / stride)) * stride
    if rng is not None:
        places = places + jitter_s * flight.sample_rate_hz * rng.standard_normal(places.size)
    return np.unique(np.clip(np.rint(places), 0, flight.samples - 1).astype(np.int64))


LOOP_HZ = 20.0
"""Rate at which the vehicle takes commands, appendix D."""

BUFFERED = 4
"""Commands that wait at most; ours: the paper shows that they wait, not how many."""


def commanded(
    rate_hz: float,
    *,
    rng: np.random.Generator,
    duration_s: float = 40.0,
    buffered: int = BUFFERED,
    noise_rad: float = 0.002,
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Steps of pitch that are sent at some rate to a vehicle that takes one command a turn, as in appendix D.

    Commands wait in a queue for the loop of :data:`LOOP_HZ`, whose turns come half of one after the first command; one
    that finds it full is lost. Slower ones never wait for each other. The vehicle answers by
    :func:`first_order_delay`. The log is made in the loop that sends, at its rate.

    Parameters
    ----------
    rate_hz
        Of the commands: a whole part of 400 Hz.
    rng
        Of the steps, which are 0.8 to 2 s long, and of the noise.
    buffered
        Commands that wait at most; with none the newest is taken.
    noise_rad
        White noise of the angle, standard deviation.

    Returns
    -------
    tuple
        Stamps in s, and ``theta_setpoint theta``, each of the same shape.

    Examples
    --------
    >>> time_s, columns = commanded(50.0, rng=np.random.default_rng(0), duration_s=4.0)
    >>> time_s.size, sorted(columns)
    (200, ['theta', 'theta_setpoint'])
    """
    from rotorid.simulation.linear import simulate_linear

    every, turn = round(RATE_HZ / rate_hz), round(RATE_HZ / LOOP_HZ)
    ends = np.cumsum(rng.uniform(0.8, 2.0, 2 + round(duration_s / 0.8)))
    levels = LARGEST["pitch"] * rng.choice([-1.0, 0.0, 1.0], ends.size)
    time_s = np.arange(round(duration_s * RATE_HZ)) / RATE_HZ
    sent = levels[np.searchsorted(ends, time_s[::every], side="right")]
    waiting: list[float] = []
    executed, taken = np.zeros(time_s.size), 0.0
    for tick in range(time_s.size):
        if tick % every == 0:
            newest = float(sent[tick // every])
            waiting = [*waiting, newest][:buffered] if buffered else [newest]
        if tick % turn == turn // 2 and waiting:
            taken = waiting.pop(0)
        executed[tick] = taken
    asked = np.stack([0.0 * executed, executed, 0.0 * executed])
    theta = simulate_linear(first_order_delay(), asked, sample_rate_hz=RATE_HZ)
    measured = theta[1, ::every] + noise_rad * rng.standard_normal(sent.size)
    return time_s[::every], {"theta_setpoint": sent, "theta": measured}
