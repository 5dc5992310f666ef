r"""RotorPy: a Python file with ``quad_params``, and how outputs of the motors become its speeds of rotors.

Its equations, in axes forward, left, up, with the speed :math:`\Omega_i` of a rotor and the velocity :math:`V_i` of its
hub through the air:

.. math::

    \tau_m \dot\Omega_i = \Omega_{c,i} - \Omega_i, \qquad
    F_i = (k_\eta \Omega_i^2 + k_h |h_i|^2) e_z - \Omega_i \, \mathrm{diag}(k_d, k_d, k_z) V_i, \qquad
    M_i = r_i \times F_i + d_i k_m \Omega_i^2 e_z - k_{flap} \Omega_i \, V_i \times e_z

with the part :math:`h_i` of that velocity across the rotor, and of the body :math:`-c_D |V| V`.

Its controllers command speeds, and the vehicle was identified by outputs :math:`x`; with
:math:`\Omega = \Omega_1 (x + b)/(1 + b)` the thrust of a rotor is :math:`a (x + b)^2`, which holds its force and slope
at hover for

.. math:: b = \frac{2 F_h}{F'_h} - x_h, \qquad k_\eta = \frac{F_h'^2}{4 F_h} \frac{(1 + b)^2}{\Omega_1^2}

The largest speed :math:`\Omega_1` only says in what unit outputs are counted, as long as no speeds were measured.

References
----------
RotorPy, ``rotorpy/vehicles/multirotor.py``, ``hummingbird_params.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.findings import Finding, remark
from rotorid.exports.arrangement import require_four_upright
from rotorid.exports.mujoco import FLU, own_slopes, tangents
from rotorid.exports.px4_sih import lag_of
from rotorid.exports.round_trip import (
    accelerations_of,
    compared,
    fastest_m_s,
    hover_air,
    identified_motion,
    in_flight,
    linearized,
    lost_air,
)
from rotorid.exports.settings import ExportSettings
from rotorid.exports.target import Compared, Exported, Fidelity, table_lines
from rotorid.exports.thrust import delay_words, full_thrust_words, lag_words
from rotorid.typing import FloatArray

if TYPE_CHECKING:
    from rotorid.flying.vehicle_from_results import JoinedVehicle
    from rotorid.flying.vehicle_numbers import VehicleNumber
    from rotorid.simulation.multirotor import Multirotor

NAME = "rotorpy"

FASTEST_RAD_S = 1000.0
"""Speed at full output where none is known."""

_GRAVITY_M_S2 = 9.81
"""RotorPy's own."""

_USUAL_LAG_S, _USUAL_RADIUS_M = 0.005, 0.1
_USUAL_GAINS = {"k_w": 1.0, "k_v": 10.0, "kp_att": 544.0, "kd_att": 46.64}
"""Of the Hummingbird that comes with RotorPy."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SpeedVehicle(Immutable):
    """A vehicle by the speeds of its rotors, forward, left, up.

    Parameters
    ----------
    mass_kg, inertia_kg_m2
        Inertia as a matrix, shape ``(3, 3)``.
    hubs_m
        Shape ``(rotors, 3)``.
    directions
        Of the torque on the body, shape ``(rotors,)``.
    thrust, torque
        By the square of speed, N s²/rad² and N m s²/rad².
    drag, climb_drag, flapping
        ``k_d``, ``k_z`` and ``k_flap``.
    lift
        ``k_h``, N s²/m².
    body_drag
        ``c_Dz``, N s²/m².
    lag_s
        Of the speeds.
    fastest_rad_s, shift
        Speed at full output, and :math:`b`.
    """

    mass_kg: float
    inertia_kg_m2: FloatArray
    hubs_m: FloatArray
    directions: FloatArray
    thrust: float
    torque: float
    drag: float
    climb_drag: float
    flapping: float
    lag_s: float
    fastest_rad_s: float
    shift: float
    lift: float = 0.0
    body_drag: float = 0.0

    def __post_init__(self) -> None:
        self._set(
            inertia_kg_m2=read_only(self.inertia_kg_m2, np.float64, ndim=2),
            hubs_m=read_only(self.hubs_m, np.float64, ndim=2),
            directions=read_only(self.directions, np.float64, ndim=1),
        )

    def speed(self, output: FloatArray | float) -> FloatArray:
        """Speed at an output, rad/s."""
        return np.asarray(self.fastest_rad_s * np.maximum(np.asarray(output) + self.shift, 0.0) / (1.0 + self.shift))

    def output(self, speed: FloatArray | float) -> FloatArray:
        """Output at a speed."""
        return np.asarray(speed) / self.fastest_rad_s * (1.0 + self.shift) - self.shift


def export(vehicle: JoinedVehicle, choices: ExportSettings) -> Exported:
    """A Python file with the dictionary that RotorPy's multirotor takes.

    Parameters
    ----------
    vehicle
        With four upright rotors.
    choices
        ``delay="lag"`` adds the delay to the lag.

    Raises
    ------
    UsageError
        Mass, inertia or another number is not known.
    ModelError
        There are not four rotors, or they are tilted.
    """
    from rotorid.flying.vehicle_from_results import require
    from rotorid.flying.vehicle_numbers import VehicleNumber

    body = require(vehicle, "m", "I_xx", "I_yy", "I_zz", "kappa", "arm", target=NAME)
    require_four_upright(body.rotors.layout, NAME)
    defaults: dict[str, VehicleNumber] = {}
    findings: list[Finding] = []
    lag_s = lag_of(vehicle, choices)
    if lag_s is None:
        lag_s = _USUAL_LAG_S
        defaults["tau_m"] = VehicleNumber(value=lag_s, unit="s", source="default", of="the Hummingbird")
    radius_m = rotor_radius(vehicle, body, "rotor_radius", _USUAL_RADIUS_M, defaults)
    model = speed_vehicle(vehicle, body, lag_s, defaults, findings)
    rows = _compared(vehicle, body, model, choices)
    name = choices.names
    title = f"{name}: an identified multirotor for RotorPy, by rotorid"
    return Exported(
        target=NAME,
        files={f"{name}_rotorpy.py": _file(body, model, radius_m, [title, "", *table_lines(rows)])},
        compared=rows,
        defaults=defaults,
        left_out=tuple(_left_out(vehicle, body, model, choices)),
        start=(
            "from rotorpy.vehicles.multirotor import Multirotor\n"
            f"from {name}_rotorpy import hovering, quad_params, speeds\n"
            "vehicle = Multirotor(quad_params, initial_state=hovering())\n"
            'state = vehicle.step(vehicle.initial_state, {"cmd_motor_speeds": speeds([0.5] * 4)}, 0.01)'
        ),
        findings=tuple(findings),
    )


def rotor_radius(
    vehicle: JoinedVehicle, body: Multirotor, name: str, usual_m: float, defaults: dict[str, VehicleNumber]
) -> float:
    """Radius of a propeller, meters, by the area of all discs where that is known."""
    from rotorid.flying.vehicle_numbers import VehicleNumber

    area = vehicle.numbers.get("disc_area")
    if area is not None:
        return float(np.sqrt(area.value / (np.pi * body.rotors.layout.rotors)))
    defaults[name] = VehicleNumber(value=usual_m, unit="m", source="default", of="--set disc_area=… gives it")
    return usual_m


def speed_vehicle(
    vehicle: JoinedVehicle,
    body: Multirotor,
    lag_s: float,
    defaults: dict[str, VehicleNumber],
    findings: list[Finding],
) -> SpeedVehicle:
    """The vehicle by the speeds of its rotors.

    Parameters
    ----------
    vehicle, body
        What was identified, and the body of it.
    lag_s
        Of the speeds.
    defaults, findings
        What is not known and what is no drag is added to them.
    """
    from rotorid.flying.vehicle_numbers import VehicleNumber

    force, slope, output = vehicle.hover_force_n, vehicle.hover_slope_n, vehicle.hover_output
    known = vehicle.numbers.get("speed_max")
    fastest = FASTEST_RAD_S if known is None else known.value
    if known is None:
        unit = "the unit of speeds; --set speed_max=… gives the speed at full output"
        defaults["rotor_speed_max"] = VehicleNumber(value=fastest, unit="rad/s", source="default", of=unit)
    shift = 2.0 * force / slope - output
    thrust = slope**2 / (4.0 * force) * ((1.0 + shift) / fastest) ** 2
    all_rad_s = body.rotors.layout.rotors * float(np.sqrt(force / thrust))
    drag = _braking(vehicle, body, ("X_u", "Y_v"), "k_d", findings) / all_rad_s
    hubs = body.hubs_m @ FLU
    return SpeedVehicle(
        mass_kg=body.mass_kg,
        inertia_kg_m2=FLU @ body.inertia_kg_m2 @ FLU,
        hubs_m=hubs,
        directions=-body.rotors.layout.spins,
        thrust=thrust,
        torque=body.rotors.torque_per_thrust_m * thrust,
        drag=drag,
        climb_drag=_braking(vehicle, body, ("Z_w",), "k_z", findings) / all_rad_s,
        flapping=_flapping(vehicle, body, all_rad_s, drag * float(hubs[:, 2].mean())),
        lag_s=lag_s,
        fastest_rad_s=fastest,
        shift=shift,
        lift=_lift(vehicle, body),
        body_drag=body.vertical_drag_n_s2_m2,
    )


_SPEEDS = 24


def _lift(vehicle: JoinedVehicle, body: Multirotor) -> float:
    """``k_h`` of the thrust that a rotor gains by edgewise flow, by least squares over the speeds identified."""
    fastest = fastest_m_s(vehicle)
    if fastest is None or body.rotors.flow is None:
        return 0.0
    speeds = np.linspace(0.0, fastest, _SPEEDS)
    outputs = body.hover_shares
    pushed = np.array([-accelerations_of(body, outputs, np.array([speed, 0.0, 0.0]))[2] for speed in speeds])
    gained = body.mass_kg * (pushed - pushed[0]) / body.rotors.layout.rotors
    return float(gained @ speeds**2 / (speeds**2 @ speeds**2))


def _braking(
    vehicle: JoinedVehicle, body: Multirotor, names: Sequence[str], parameter: str, findings: list[Finding]
) -> float:
    """Force against the motion per m/s, the mean of what is known; zero where it would push."""
    known = [-vehicle.numbers[name].value * body.mass_kg for name in names if name in vehicle.numbers]
    mean = float(np.mean(known)) if known else 0.0
    if mean < 0.0:
        message = f"{' and '.join(names)} would push instead of brake; {parameter} was set to zero."
        findings.append(remark("export_compromise", parameter, message, identified=mean))
    return max(mean, 0.0)


def _flapping(vehicle: JoinedVehicle, body: Multirotor, all_rad_s: float, by_drag: float) -> float:
    """``k_flap`` by which the moment by velocity is right, the part included that drag at the hubs makes."""
    air = hover_air(body)
    known = [value for name, value in (("M_u", -air[4, 0]), ("L_v", air[3, 1])) if name in vehicle.numbers]
    return float(np.mean(known)) / all_rad_s + by_drag if known else 0.0


# The equations


def rotorpy_accelerations(
    model: SpeedVehicle, speeds_rad_s: FloatArray, velocity_m_s: FloatArray, rates_rad_s: FloatArray
) -> FloatArray:
    """RotorPy's equations: accelerations without gravity, FRD.

    Parameters
    ----------
    model
        The numbers of the file.
    speeds_rad_s
        Of the rotors, shape ``(rotors,)``.
    velocity_m_s, rates_rad_s
        Through the air and of the body, FRD.
    """
    speed, turn, up = FLU @ velocity_m_s, FLU @ rates_rad_s, np.array([0.0, 0.0, 1.0])
    local = speed + np.cross(turn, model.hubs_m)
    square = speeds_rad_s[:, None] ** 2 * up
    push = model.thrust * square - speeds_rad_s[:, None] * local * [model.drag, model.drag, model.climb_drag]
    push = push + model.lift * (local[:, :2] ** 2).sum(axis=1)[:, None] * up
    moment = np.cross(model.hubs_m, push) + model.torque * model.directions[:, None] * square
    moment = moment - model.flapping * speeds_rad_s[:, None] * np.cross(local, up)
    total = moment.sum(axis=0) - np.cross(turn, model.inertia_kg_m2 @ turn)
    force = push.sum(axis=0) - model.body_drag * float(np.linalg.norm(speed)) * speed * up
    return np.concatenate([FLU @ force / model.mass_kg, FLU @ np.linalg.solve(model.inertia_kg_m2, total)])


def _hover_speeds(body: Multirotor, model: SpeedVehicle) -> FloatArray:
    """Speeds at which RotorPy's gravity is carried, shape ``(rotors,)``."""
    forces = tangents(body) @ [1.0, 0.0] + tangents(body)[:, 1] * body.hover_shares
    weight = model.mass_kg * _GRAVITY_M_S2
    return np.asarray(np.sqrt(forces * weight / forces.sum() / model.thrust))


def _compared(
    vehicle: JoinedVehicle, body: Multirotor, model: SpeedVehicle, choices: ExportSettings
) -> tuple[Compared, ...]:
    identified = own_slopes(vehicle, body, identified_motion(vehicle, body, lag_s=lag_of(vehicle, choices)))
    exported = linearized(
        lambda x, v, w: rotorpy_accelerations(model, model.speed(x), v, w),
        model.output(_hover_speeds(body, model)),
        lag_s=model.lag_s,
    )
    rows = compared(vehicle, identified, exported, _fidelities(vehicle, model), delay=choices.delay == "lag")
    return rows + in_flight(
        vehicle,
        body,
        lambda x, v, w: rotorpy_accelerations(model, model.speed(x), v, w),
        model.output(_hover_speeds(body, model)),
        lift="approximated",
    )


def _fidelities(vehicle: JoinedVehicle, model: SpeedVehicle) -> Mapping[str, Fidelity]:
    """One drag for two axes, and damping that follows from the others."""
    fidelities: dict[str, Fidelity] = dict.fromkeys(("M_u", "L_v"), "approximated")
    fidelities |= dict.fromkeys(("L_p", "M_q"), "approximated" if model.climb_drag else "not")
    fidelities["N_r"] = "approximated" if model.drag else "not"
    across = {vehicle.numbers[name].value for name in ("X_u", "Y_v") if name in vehicle.numbers}
    if len(across) > 1 or not model.drag:
        fidelities |= dict.fromkeys(("X_u", "Y_v"), "approximated")
    if not model.climb_drag:
        fidelities["Z_w"] = "approximated"
    return fidelities


def _left_out(vehicle: JoinedVehicle, body: Multirotor, model: SpeedVehicle, choices: ExportSettings) -> list[str]:
    remarks = [
        "RotorPy has one drag across the rotors, and no damping of rates but what the drag of the rotors makes: L_p, "
        "M_q and N_r follow from it.",
        f"Its gravity is {_GRAVITY_M_S2:g} m/s^2: outputs in hover are higher by 0.02 %.",
    ]
    full = model.thrust * model.fastest_rad_s**2
    remarks += full_thrust_words("a square of the speed", full, body.rotors.thrust_at(1.0))
    words = "RotorPy has no delay: {} are lost; --delay-as-lag adds them to the lag."
    remarks += delay_words(vehicle, words, as_lag=choices.delay == "lag")
    if not {"X_u", "Y_v"} & set(vehicle.numbers):
        remarks.append("Drag is not identified: the vehicle has none.")
    return [*remarks, *lost_air(vehicle, "c_lambda", "c_h", "m_f", "d_z"), *lag_words(vehicle)]


# The file


def _file(body: Multirotor, model: SpeedVehicle, radius_m: float, head: Sequence[str]) -> str:
    inertia = model.inertia_kg_m2
    values: dict[str, float] = {
        "mass": model.mass_kg,
        "Ixx": inertia[0, 0],
        "Iyy": inertia[1, 1],
        "Izz": inertia[2, 2],
        "Ixy": inertia[0, 1],
        "Iyz": inertia[1, 2],
        "Ixz": inertia[0, 2],
        "rotor_radius": radius_m,
        "c_Dx": 0.0,
        "c_Dy": 0.0,
        "c_Dz": model.body_drag,
        "k_eta": model.thrust,
        "k_m": model.torque,
        "k_d": model.drag,
        "k_z": model.climb_drag,
        "k_h": model.lift,
        "k_flap": model.flapping,
        "tau_m": model.lag_s,
        "rotor_speed_min": float(model.speed(0.0)),
        "rotor_speed_max": model.fastest_rad_s,
        "motor_noise_std": 0.0,
        **_USUAL_GAINS,
    }
    return _TEXT.format(
        table="\n".join(line.rstrip() for line in head),
        count=len(model.hubs_m),
        values="\n".join(f'    "{key}": {value + 0.0:.9g},' for key, value in values.items()),
        places="\n".join(
            f'        "r{index}": np.array({_list(hub)}),' for index, hub in enumerate(model.hubs_m, start=1)
        ),
        directions=_list(model.directions),
        hover=_list(_hover_speeds(body, model)),
        shift=model.shift,
    )


def _list(values: FloatArray) -> str:
    return "[" + ", ".join(f"{float(value) + 0.0:.9g}" for value in values) + "]"


_TEXT = '''"""{table}

Axes are forward, left, up; rotors are in the order of the vehicle's motors. It needs numpy alone.
"""

import numpy as np

quad_params = {{
    "num_rotors": {count},
{values}
    "rotor_pos": {{
{places}
    }},
    "rotor_directions": np.array({directions}),
    "rI": np.zeros(3),
}}

HOVER_SPEEDS = np.array({hover})

# Speeds are in proportion to the output plus this.
SHIFT = {shift:.9g}


def speeds(outputs):
    """Speeds of the rotors, rad/s, for outputs of the motors from 0 to 1."""
    outputs = np.maximum(np.asarray(outputs, dtype=float) + SHIFT, 0.0)
    return quad_params["rotor_speed_max"] * outputs / (1.0 + SHIFT)


def hovering(height=1.0):
    """State in hover, for RotorPy's initial_state."""
    return {{
        "x": np.array([0.0, 0.0, height]),
        "v": np.zeros(3),
        "q": np.array([0.0, 0.0, 0.0, 1.0]),
        "w": np.zeros(3),
        "wind": np.zeros(3),
        "rotor_speeds": HOVER_SPEEDS.copy(),
    }}
'''
