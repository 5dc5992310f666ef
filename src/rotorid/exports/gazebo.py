r"""Gazebo: a model whose rotors are those of ``MulticopterMotorModel``, for PX4 and by itself, and PX4's airframe.

The plugin turns each rotor with a first-order lag to a commanded speed, and makes of the speed :math:`\Omega`

.. math:: F = k \Omega^2, \qquad Q = \kappa F, \qquad D = -|\Omega| c_d v_\perp

with the velocity of the rotor across its axis. PX4 commands :math:`\Omega = \Omega_0 + u (\Omega_1 - \Omega_0)`, so
that thrust is :math:`a (u + b)^2`. The force and the slope of a rotor at hover, at the output :math:`x_h`, are held by

.. math::
    b = \frac{2 F_h}{F'_h} - x_h, \quad a = \frac{F_h'^2}{4 F_h}, \quad
    \Omega_0 = \Omega_1 \frac{b}{1 + b}, \quad k = a \frac{(1 + b)^2}{\Omega_1^2}

Where no such :math:`b \ge 0` is, it is zero: force and slope at hover are still held, and the output there is not. The
rotors weigh a little, as they must in Gazebo; what they weigh is taken off the body.

References
----------
gz-sim, ``src/systems/multicopter_motor_model``; PX4-Autopilot, ``src/modules/simulation/gz_bridge``, airframe
``4001_gz_x500``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.findings import Finding, remark, warn
from rotorid.errors import ModelError
from rotorid.exports.arrangement import refuse_tilted
from rotorid.exports.px4_sih import allocated, lag_of
from rotorid.exports.round_trip import HOVER, compared, identified_motion, in_flight, linearized, lost_air
from rotorid.exports.settings import ExportSettings
from rotorid.exports.target import EXACT_PERCENT, Compared, Exported, Fidelity, number_text, table_lines, xml_comment
from rotorid.exports.thrust import delay_words, full_thrust_words, lag_words
from rotorid.models.rotors import RotorLayout
from rotorid.typing import FloatArray

if TYPE_CHECKING:
    from rotorid.flying.vehicle_from_results import JoinedVehicle
    from rotorid.flying.vehicle_numbers import VehicleNumber
    from rotorid.simulation.multirotor import Multirotor

NAME = "gazebo"

AIRFRAME = 22002
_FASTEST_RAD_S = 1000.0
_LAG_UP_S, _LAG_DOWN_S = 0.0125, 0.025
"""Of the plugin's own x500."""

_SLOWDOWN = 10.0
_FEWEST_SPEEDS = 10
_ROUNDING_RAD_S = 1.0
"""Of the two ends of the range, half each."""

_ROTOR_SHARE, _ROD_SHARE, _ROD_RATIO = 0.005, 0.5, 0.02
"""A rotor's share of the mass, its length as a share of the arm, and its thickness as a share of its length."""

_DIAGONAL = np.diag([1.0, -1.0, -1.0])
"""Forward, right, down to forward, left, up."""

_PLUGIN = 'filename="gz-sim-multicopter-motor-model-system" name="gz::sim::systems::MulticopterMotorModel"'


@dataclass(frozen=True, kw_only=True, eq=False)
class GazeboVehicle(Immutable):
    """The numbers of a model, forward, left, up.

    Parameters
    ----------
    mass_kg, inertia_kg_m2, center_m
        Of the body without its rotors: inertia about its own center of gravity, shape ``(3, 3)``.
    rotor_kg, rotor_inertia_kg_m2
        Of a rotor, which is a thin rod: about its length, and across.
    hubs_m
        Shape ``(rotors, 3)``.
    spins
        +1 counterclockwise seen from above, shape ``(rotors,)``.
    thrust
        ``motorConstant``, N s²/rad².
    torque_m
        ``momentConstant``.
    drag
        ``rotorDragCoefficient``, N s²/(m rad).
    rolling
        ``rollingMomentCoefficient`` of a rotor that turns clockwise, N s²/rad; of the others it is less than zero.
    lag_up_s, lag_down_s
        Time constants.
    slowest, fastest
        Whole rad/s that PX4 commands at outputs of 0 and 1.
    """

    mass_kg: float
    inertia_kg_m2: FloatArray
    center_m: FloatArray
    rotor_kg: float
    rotor_inertia_kg_m2: tuple[float, float]
    hubs_m: FloatArray
    spins: FloatArray
    thrust: float
    torque_m: float
    drag: float
    lag_up_s: float
    lag_down_s: float
    slowest: int
    fastest: int
    rolling: float = 0.0

    def __post_init__(self) -> None:
        self._set(
            inertia_kg_m2=read_only(self.inertia_kg_m2, np.float64, ndim=2),
            center_m=read_only(self.center_m, np.float64, ndim=1),
            hubs_m=read_only(self.hubs_m, np.float64, ndim=2),
            spins=read_only(self.spins, np.float64, ndim=1),
        )

    def speed(self, output: FloatArray | float) -> FloatArray:
        """What PX4 commands at an output, rad/s."""
        return np.asarray(self.slowest + np.asarray(output) * (self.fastest - self.slowest))

    @property
    def rotor_tensor(self) -> FloatArray:
        """Inertia of a rotor, which turns: the mean of its ends, shape ``(3, 3)``."""
        along, across = self.rotor_inertia_kg_m2
        return np.diag([0.5 * (along + across)] * 2 + [across])

    def whole(self) -> tuple[float, FloatArray]:
        """Mass and inertia of all links together, about the origin."""
        mass = self.mass_kg + self.rotor_kg * len(self.hubs_m)
        inertia = self.inertia_kg_m2 + self.mass_kg * _inertia_about_origin(self.center_m)
        for hub in self.hubs_m:
            inertia = inertia + self.rotor_tensor + self.rotor_kg * _inertia_about_origin(hub)
        return mass, np.asarray(inertia)


def _inertia_about_origin(place: FloatArray) -> FloatArray:
    """What a kilogram at a place adds to the inertia about the origin."""
    return np.asarray(place @ place * np.eye(3) - np.outer(place, place))


def export(vehicle: JoinedVehicle, choices: ExportSettings) -> Exported:
    """A model with its configuration, a world for it alone, and an airframe of PX4.

    Parameters
    ----------
    vehicle
        With any number of upright rotors.
    choices
        ``delay="lag"`` adds the delay to the lag.

    Raises
    ------
    UsageError
        Mass, inertia or another number is not known.
    ModelError
        The rotors are tilted, or their speeds are too few to be commanded as whole ones.
    """
    from rotorid.flying.vehicle_from_results import require

    body = require(vehicle, "m", "I_xx", "I_yy", "I_zz", "kappa", "arm", target=NAME)
    refuse_tilted(body.rotors.layout, NAME)
    defaults: dict[str, VehicleNumber] = {}
    findings: list[Finding] = []
    model = gazebo_vehicle(vehicle, body, choices, defaults, findings)
    exact = _exact_hover(vehicle)
    rows = _compared(vehicle, body, model, choices, exact=exact)
    name = choices.names
    title = f"{name}: an identified multirotor for Gazebo, by rotorid"
    head = [title, "", *table_lines(rows)]
    return Exported(
        target=NAME,
        files={
            f"{name}/model.config": _config(name),
            f"{name}/model.sdf": model_sdf(name, model, head),
            f"{name}.world.sdf": _world(name),
            f"{AIRFRAME}_gz_{name}": _airframe(name, model, rows, head),
        },
        compared=rows,
        defaults=defaults,
        left_out=tuple(_left_out(vehicle, choices, model)),
        start=_start(name, model, float(rows_hover(rows))),
        findings=tuple(findings),
    )


def rows_hover(rows: Sequence[Compared]) -> float:
    """Output in hover of the model."""
    return next(row.exported for row in rows if row.name == HOVER)


def _exact_hover(vehicle: JoinedVehicle) -> bool:
    return 2.0 * vehicle.hover_force_n / vehicle.hover_slope_n >= vehicle.hover_output


def gazebo_vehicle(
    vehicle: JoinedVehicle,
    body: Multirotor,
    choices: ExportSettings,
    defaults: dict[str, VehicleNumber],
    findings: list[Finding],
) -> GazeboVehicle:
    """The numbers of the model; what was taken from the plugin's own vehicle goes to ``defaults``."""
    from rotorid.flying.vehicle_numbers import VehicleNumber

    def usual(name: str, value: float, unit: str, of: str) -> float:
        defaults[name] = VehicleNumber(value=value, unit=unit, source="default", of=of)
        return value

    force, slope, output = vehicle.hover_force_n, vehicle.hover_slope_n, vehicle.hover_output
    known = vehicle.numbers.get("speed_max")
    fastest = round(usual("maxRotVelocity", _FASTEST_RAD_S, "rad/s", "x500") if known is None else known.value)
    shift = max(2.0 * force / slope - output, 0.0)
    slowest = round(fastest * shift / (1.0 + shift))
    if fastest - slowest < _FEWEST_SPEEDS:
        raise ModelError(
            f"outputs from 0 to 1 are speeds from {slowest} to {fastest} rad/s",
            needed=f"at least {_FEWEST_SPEEDS} rad/s between them, for PX4 commands whole ones",
            remedy="--set speed_max=… of the speed at full output, in rad/s",
        )
    if not _exact_hover(vehicle):
        message = (
            "The slope of thrust at hover is steeper than that of a square through zero: PX4's speeds begin at zero, "
            f"and the model hovers at an output of {2.0 * force / slope:.3f} where the vehicle hovers at {output:.3f}."
        )
        findings.append(warn("export_compromise", "SIM_GZ_EC_MIN1", message, hover_output=2.0 * force / slope))
    # Of whole speeds the force and the slope at hover stay exact, and the output moves by a rounding.
    thrust = slope**2 / (4.0 * force * (fastest - slowest) ** 2)
    lag_s = lag_of(vehicle, choices)
    if lag_s is None:
        usual("timeConstantUp", _LAG_UP_S, "s", "x500")
        usual("timeConstantDown", _LAG_DOWN_S, "s", "x500")
    mass, inertia, center, rotor_kg, rod = _weighed(body)
    usual("rotor mass", rotor_kg, "kg", f"{100.0 * rotor_kg / body.mass_kg:.2g} % of the vehicle, taken off the body")
    return GazeboVehicle(
        mass_kg=mass,
        inertia_kg_m2=inertia,
        center_m=center,
        rotor_kg=rotor_kg,
        rotor_inertia_kg_m2=rod,
        hubs_m=body.hubs_m @ _DIAGONAL,
        spins=body.rotors.layout.spins,
        thrust=thrust,
        torque_m=body.rotors.torque_per_thrust_m,
        drag=_drag(vehicle, body, float(np.sqrt(force / thrust)), findings),
        lag_up_s=_LAG_UP_S if lag_s is None else _own(vehicle, "T_motor_up", lag_s),
        lag_down_s=_LAG_DOWN_S if lag_s is None else _own(vehicle, "T_motor_down", lag_s),
        slowest=slowest,
        fastest=fastest,
        rolling=_rolling(body, float(np.sqrt(thrust / body.rotors.thrust_at(1.0)))),
    )


def _rolling(body: Multirotor, per_rad_s: float) -> float:
    """Moment to the side of a rotor's turn, by its speed instead of its output."""
    flow = body.rotors.flow
    return 0.0 if flow is None else flow.side_flapping_n_s * per_rad_s


def _own(vehicle: JoinedVehicle, name: str, lag_s: float) -> float:
    """The lag in one direction, with the delay that the other one holds; that one where it is not known."""
    if name not in vehicle.numbers:
        return lag_s
    return vehicle.numbers[name].value + lag_s - vehicle.numbers["T_motor"].value


def _drag(vehicle: JoinedVehicle, body: Multirotor, hover_rad_s: float, findings: list[Finding]) -> float:
    """``rotorDragCoefficient`` of the mean drag along x and y."""
    known = [-vehicle.numbers[name].value * body.mass_kg for name in ("X_u", "Y_v") if name in vehicle.numbers]
    mean = float(np.mean(known)) if known else 0.0
    if mean < 0.0:
        message = "The identified drag is negative; rotorDragCoefficient was set to zero."
        findings.append(remark("export_compromise", "rotorDragCoefficient", message, identified=mean))
    return max(mean, 0.0) / (body.rotors.layout.rotors * hover_rad_s)


def _weighed(body: Multirotor) -> tuple[float, FloatArray, FloatArray, float, tuple[float, float]]:
    """Body and rotors apart: what is left of mass, inertia and center, and a rotor light enough that it is a body."""
    hubs, whole = body.hubs_m @ _DIAGONAL, _DIAGONAL @ body.inertia_kg_m2 @ _DIAGONAL
    length = _ROD_SHARE * float(np.hypot(hubs[:, 0], hubs[:, 1]).max())
    share = _ROTOR_SHARE
    while True:
        rotor = share * body.mass_kg
        across, along = rotor * length**2 / 12.0, rotor * (_ROD_RATIO * length) ** 2 / 12.0
        mass = body.mass_kg - rotor * len(hubs)
        center = -rotor * hubs.sum(axis=0) / mass
        tensor = np.diag([0.5 * (along + across)] * 2 + [across])
        left = (
            whole
            - mass * _inertia_about_origin(center)
            - sum(tensor + rotor * _inertia_about_origin(hub) for hub in hubs)
        )
        low, middle, high = np.linalg.eigvalsh(left)
        # A body has no moment of inertia beyond the sum of the other two; where the whole has, the rest may.
        limit = np.linalg.eigvalsh(whole)
        if low > 0.0 and (low + middle >= high or limit[0] + limit[1] < limit[2] or share < _LIGHTEST):
            return mass, left, center, rotor, (along, across)
        share *= 0.5


_LIGHTEST = 1e-6


# The equations


def gazebo_accelerations(
    model: GazeboVehicle, x: FloatArray, velocity_m_s: FloatArray, rates_rad_s: FloatArray
) -> FloatArray:
    """The plugin's equations on the links together: accelerations without gravity, FRD.

    Parameters
    ----------
    model
        The numbers of the model.
    x
        Lagged outputs: shares of the range of speeds, shape ``(rotors,)``.
    velocity_m_s, rates_rad_s
        Through the air and of the body, FRD.
    """
    speed, turn = _DIAGONAL @ velocity_m_s, _DIAGONAL @ rates_rad_s
    mass, inertia = model.whole()
    omega = np.clip(model.speed(x), 0.0, model.fastest)
    force, moment = np.zeros(3), -np.cross(turn, inertia @ turn)
    up = np.array([0.0, 0.0, 1.0])
    for rad_s, hub, spin in zip(omega, model.hubs_m, model.spins, strict=True):
        local = speed + np.cross(turn, hub)
        thrust = model.thrust * rad_s**2
        push = thrust * up - abs(rad_s) * model.drag * (local - up * local[2])
        force = force + push
        moment = moment + np.cross(hub, push) - spin * model.torque_m * thrust * up
        moment = moment + abs(rad_s) * spin * model.rolling * (local - up * local[2])
    return np.concatenate([_DIAGONAL @ force / mass, _DIAGONAL @ np.linalg.solve(inertia, moment)])


def _compared(
    vehicle: JoinedVehicle, body: Multirotor, model: GazeboVehicle, choices: ExportSettings, *, exact: bool
) -> tuple[Compared, ...]:
    identified = identified_motion(vehicle, body, lag_s=lag_of(vehicle, choices))
    hover_rad_s = np.sqrt(vehicle.hover_force_n / model.thrust)
    output = float((hover_rad_s - model.slowest) / (model.fastest - model.slowest))
    exported = linearized(
        lambda x, v, w: gazebo_accelerations(model, x, v, w),
        np.full(len(model.hubs_m), output),
        lag_s=0.5 * (model.lag_up_s + model.lag_down_s),
    )
    rounding = _ROUNDING_RAD_S / (model.fastest - model.slowest)
    fidelities: dict[str, Fidelity] = dict.fromkeys(("Z_w", "L_p", "M_q", "N_r", "M_u", "L_v"), "not")
    if {"X_u", "Y_v"} <= set(vehicle.numbers) or model.drag == 0.0:
        fidelities |= dict.fromkeys(("X_u", "Y_v"), "approximated")
    if not exact or 100.0 * rounding > EXACT_PERCENT * vehicle.hover_output:
        fidelities[HOVER] = "approximated"
    rows = compared(vehicle, identified, exported, fidelities, delay=choices.delay == "lag")
    return rows + in_flight(
        vehicle, body, lambda x, v, w: gazebo_accelerations(model, x, v, w), np.full(len(model.hubs_m), output)
    )


def _left_out(vehicle: JoinedVehicle, choices: ExportSettings, model: GazeboVehicle) -> list[str]:
    remarks = ["Gazebo's rotors have no drag along their axis, and the body has none: Z_w and damping are lost."]
    words = "There is no delay: {} are lost; --delay-as-lag adds them to the lag."
    remarks += delay_words(vehicle, words, as_lag=choices.delay == "lag")
    if any(name in vehicle.numbers for name in ("M_u", "L_v")):
        remarks.append("M_u and L_v are those of drag at the height of the rotors, not the identified ones.")
    if not {"X_u", "Y_v"} & set(vehicle.numbers):
        remarks.append("Drag is not identified: the model has none.")
    remarks += [*lost_air(vehicle, "m_s"), *lag_words(vehicle)]
    assert vehicle.multirotor is not None
    full_n = model.thrust * float(model.fastest) ** 2
    return remarks + full_thrust_words("a square of the speed", full_n, vehicle.multirotor.rotors.thrust_at(1.0))


# The files


def model_sdf(name: str, model: GazeboVehicle, head: Sequence[str]) -> str:
    """The model as SDF."""
    arm = float(np.abs(model.hubs_m[:, :2]).max())
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        *xml_comment(head),
        '<sdf version="1.9">',
        f'  <model name="{name}">',
    ]
    lines += [f"    <pose>0 0 {0.5 * arm:.4g} 0 0 0</pose>", "    <self_collide>false</self_collide>"]
    lines += ['    <link name="base_link">', *_inertial(model.mass_kg, model.inertia_kg_m2, model.center_m)]
    box = f"<geometry><box><size>{2 * arm:.4g} {2 * arm:.4g} {0.4 * arm:.4g}</size></box></geometry>"
    body = f"<geometry><box><size>{arm:.4g} {0.6 * arm:.4g} {0.3 * arm:.4g}</size></box></geometry>"
    lines += [
        f'      <collision name="base_link_collision">{box}</collision>',
        f'      <visual name="base_link_visual">{body}{_color("0.2 0.2 0.25 1")}</visual>',
        *_sensors(),
        "    </link>",
    ]
    for index, (hub, spin) in enumerate(zip(model.hubs_m, model.spins, strict=True)):
        lines += _rotor(index, hub, float(spin), model, arm)
    return "\n".join([*lines, "  </model>", "</sdf>"]) + "\n"


def _color(rgba: str) -> str:
    return f"<material><ambient>{rgba}</ambient><diffuse>{rgba}</diffuse></material>"


def _inertial(mass: float, inertia: FloatArray, place: FloatArray | None = None) -> list[str]:
    entries = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    tensor = "".join(f"<{key}>{number_text(float(inertia[at]))}</{key}>" for key, at in entries.items())
    pose = [] if place is None else [f"        <pose>{' '.join(map(number_text, place.tolist()))} 0 0 0</pose>"]
    return [
        "      <inertial>",
        *pose,
        f"        <mass>{number_text(mass)}</mass>",
        f"        <inertia>{tensor}</inertia>",
        "      </inertial>",
    ]


def _sensors() -> list[str]:
    """What PX4 reads; without a world's systems for them they do nothing."""
    rates = {"air_pressure": 50, "magnetometer": 100, "imu": 250, "navsat": 30}
    return [
        f'      <sensor name="{kind}_sensor" type="{kind}"><always_on>1</always_on>'
        f"<update_rate>{rate}</update_rate></sensor>"
        for kind, rate in rates.items()
    ]


def _rotor(index: int, hub: FloatArray, spin: float, model: GazeboVehicle, arm: float) -> list[str]:
    disc = (
        f"<geometry><cylinder><radius>{0.5 * arm:.4g}</radius><length>{0.01 * arm:.4g}</length></cylinder></geometry>"
    )
    color = "0.1 0.4 0.8 0.5" if spin > 0.0 else "0.8 0.3 0.1 0.5"
    values = {
        "jointName": f"rotor_{index}_joint",
        "linkName": f"rotor_{index}",
        "turningDirection": "ccw" if spin > 0.0 else "cw",
        "timeConstantUp": number_text(model.lag_up_s),
        "timeConstantDown": number_text(model.lag_down_s),
        "maxRotVelocity": str(model.fastest),
        "motorConstant": number_text(model.thrust),
        "momentConstant": number_text(model.torque_m),
        "commandSubTopic": "command/motor_speed",
        # The first name is that of today, the second that of older versions.
        "actuator_number": str(index),
        "motorNumber": str(index),
        "rotorDragCoefficient": number_text(model.drag),
        "rollingMomentCoefficient": number_text(-spin * model.rolling + 0.0) if model.rolling else "0",
        "rotorVelocitySlowdownSim": number_text(_SLOWDOWN),
        "motorType": "velocity",
    }
    return [
        f'    <link name="rotor_{index}">',
        f"      <pose>{' '.join(map(number_text, hub.tolist()))} 0 0 0</pose>",
        *_inertial(model.rotor_kg, model.rotor_tensor),
        f'      <visual name="rotor_{index}_visual">{disc}{_color(color)}</visual>',
        "    </link>",
        f'    <joint name="rotor_{index}_joint" type="revolute">',
        "      <parent>base_link</parent>",
        f"      <child>rotor_{index}</child>",
        "      <axis><xyz>0 0 1</xyz><limit><lower>-1e16</lower><upper>1e16</upper></limit></axis>",
        "    </joint>",
        f"    <plugin {_PLUGIN}>",
        *(f"      <{key}>{value}</{key}>" for key, value in values.items()),
        "    </plugin>",
    ]


def _config(name: str) -> str:
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<model>\n'
        f"  <name>{name}</name>\n  <version>1.0</version>\n"
        '  <sdf version="1.9">model.sdf</sdf>\n'
        "  <description>An identified multirotor, by rotorid.</description>\n</model>\n"
    )


def _world(name: str) -> str:
    systems = {
        "gz-sim-physics-system": "gz::sim::systems::Physics",
        "gz-sim-user-commands-system": "gz::sim::systems::UserCommands",
        "gz-sim-scene-broadcaster-system": "gz::sim::systems::SceneBroadcaster",
        "gz-sim-imu-system": "gz::sim::systems::Imu",
        "gz-sim-air-pressure-system": "gz::sim::systems::AirPressure",
        "gz-sim-magnetometer-system": "gz::sim::systems::Magnetometer",
        "gz-sim-navsat-system": "gz::sim::systems::NavSat",
    }
    plane = "<geometry><plane><normal>0 0 1</normal><size>100 100</size></plane></geometry>"
    return (
        "\n".join(
            [
                '<?xml version="1.0" encoding="UTF-8"?>',
                '<sdf version="1.9">',
                f'  <world name="{name}_alone">',
                '    <physics name="steps" type="ode"><max_step_size>0.002</max_step_size></physics>',
                *(f'    <plugin filename="{file}" name="{system}"/>' for file, system in systems.items()),
                "    <gravity>0 0 -9.80665</gravity>",
                '    <light name="sun" type="directional"><direction>-0.5 0.1 -0.9</direction></light>',
                "    <spherical_coordinates><surface_model>EARTH_WGS84</surface_model><latitude_deg>47.4</latitude_deg>"
                "<longitude_deg>8.5</longitude_deg><elevation>0</elevation></spherical_coordinates>",
                '    <model name="ground"><static>true</static><link name="ground">',
                f'      <collision name="ground">{plane}</collision><visual name="ground">{plane}</visual>',
                "    </link></model>",
                f"    <include><uri>model://{name}</uri></include>",
                "  </world>",
                "</sdf>",
            ]
        )
        + "\n"
    )


def _airframe(name: str, model: GazeboVehicle, rows: Sequence[Compared], head: Sequence[str]) -> str:
    lines = ["#!/bin/sh", "#", f"# @name {name}, simulated by Gazebo", "# @type Multirotor", "#"]
    lines += [f"# {line}".rstrip() for line in head]
    lines += ["", ". ${R}etc/init.d/rc.mc_defaults", "", "PX4_SIMULATOR=${PX4_SIMULATOR:=gz}"]
    lines += ["PX4_GZ_WORLD=${PX4_GZ_WORLD:=default}", f"PX4_SIM_MODEL=${{PX4_SIM_MODEL:={name}}}", ""]
    lines += ["param set-default SIM_GZ_EN 1", ""]
    # The model's axes are forward, left and up.
    rotors = RotorLayout(name=name, positions=model.hubs_m @ _DIAGONAL, spins=np.array(model.spins))
    values = allocated(rotors, model.torque_m)
    for index in range(len(model.hubs_m)):
        values[f"SIM_GZ_EC_FUNC{index + 1}"] = 101 + index
        values[f"SIM_GZ_EC_MIN{index + 1}"] = model.slowest
        values[f"SIM_GZ_EC_MAX{index + 1}"] = model.fastest
    values |= {"MPC_THR_HOVER": rows_hover(rows), "THR_MDL_FAC": 0}
    return "\n".join([*lines, *(f"param set-default {key} {value:.7g}" for key, value in values.items())]) + "\n"


def _start(name: str, model: GazeboVehicle, hover: float) -> str:
    speeds = ", ".join([f"{float(model.speed(hover)):.1f}"] * len(model.hubs_m))
    return (
        f"With PX4: copy the folder {name} to Tools/simulation/gz/models, {AIRFRAME}_gz_{name} to\n"
        "ROMFS/px4fmu_common/init.d-posix/airframes and list it in the CMakeLists.txt there;\n"
        f"then make px4_sitl gz_{name}.\n"
        f"Alone: GZ_SIM_RESOURCE_PATH=. gz sim {name}.world.sdf, and the speeds of hover by\n"
        f"gz topic -t /{name}/command/motor_speed --msgtype gz.msgs.Actuators -p 'velocity:[{speeds}]'"
    )
