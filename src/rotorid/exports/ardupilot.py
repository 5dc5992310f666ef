r"""ArduPilot's simulator (SITL): a frame as JSON, and parameters.

Its equations, with the share :math:`c` of the range between ``spin_min`` and ``spin_max``, at the highest voltage and
the density where the reference was taken, without inflow:

.. math::

    F = F_{max} ((1 - e) c + e c^2), \quad F_{max} = \frac{m g}{n \, \mathrm{hoverThrOut}}, \quad
    Q = 0.05 \, s \, d \, c F, \quad D_i = k \sqrt{\rho A / n} \sqrt{F} \, V_i

with the momentum drag :math:`D_i` at the velocity of each motor, which damps rotation too, a drag of the body that
grows with the square, and a damping of rates. There is no lag and no delay, and the inertia is diagonal.

The curve has the force and the slope of the vehicle's rotors at hover wherever its form allows (:mod:`.thrust`).

The autopilot in front of the frame asks the motors for :math:`G` times its demand of thrust, to make up for voltage and
density. The vehicle that flew had a sagging battery, SITL has a constant one: two different :math:`G`, by which hover
and every loop would differ. So the compensation of voltage is off in the parameters, and what is left is that of
density, :math:`G = \rho_0 / \rho`. Where the vehicle is known by demands of thrust, the curve is the one that the
autopilot takes out, and ``hoverThrOut`` is such that SITL hovers at the demand of the flight.

References
----------
ArduPilot, ``libraries/SITL/SIM_Frame.cpp``, ``SIM_Motor.cpp``, ``AP_Motors/AP_Motors_Thrust_Linearization.cpp``
(compensation), ``AP_Filesystem/AP_Filesystem_posix.cpp`` (paths).
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, remark, warn
from rotorid.errors import ModelError
from rotorid.exports.arrangement import Arranged, arranged, refuse_tilted
from rotorid.exports.estimates import instead_of_default
from rotorid.exports.round_trip import (
    HOVER,
    LAG,
    PITCH,
    ROLL,
    VERTICAL,
    YAW,
    compared,
    fastest_m_s,
    identified_motion,
    in_flight,
    linearized,
    lost_air,
)
from rotorid.exports.settings import ExportSettings
from rotorid.exports.target import Compared, Exported, Fidelity, table_lines
from rotorid.exports.thrust import HoverThrust, expo_thrust, full_thrust_words
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

if TYPE_CHECKING:
    from rotorid.flying.vehicle_from_results import JoinedVehicle
    from rotorid.flying.vehicle_numbers import VehicleNumber
    from rotorid.models.rotors import RotorLayout
    from rotorid.results.summary import Straightening
    from rotorid.simulation.multirotor import Multirotor

NAME = "ardupilot"

_TORQUE, _DAMPING = 0.05, math.radians(400.0)
"""Torque by thrust, share and size; damping in 1/s times ``refRotRate``."""

_SEA_LEVEL_KG_M3, _LAPSE_1_M, _DENSITY_POWER = 1.225, 2.25577e-5, 4.2559
_DENSITY_RATIOS = (0.5, 1.25)
"""Between which ArduPilot makes up for density."""
_USUAL_SPIN_ARM = 0.1
_HOME_M = 584.0
"""Of the place where SITL starts when no other is named."""

_USUAL: Mapping[str, tuple[float, str]] = {
    "refAlt": (_HOME_M, "m"),
    "refSpd": (15.08, "m/s"),
    "refAngle": (45.0, "deg"),
    "refVoltage": (12.09, "V"),
    "refCurrent": (29.3, "A"),
    "refBatRes": (0.01, "ohm"),
    "maxVoltage": (12.6, "V"),
    "refRotRate": (120.0, "deg/s"),
    "disc_area": (0.385, "m^2"),
    "mdrag_coef": (0.2, "1"),
    "propExpo": (0.65, "1"),
    "spin_min": (0.15, "1"),
    "spin_max": (0.95, "1"),
    "pwmMin": (1000.0, "us"),
    "pwmMax": (2000.0, "us"),
}
"""Of SITL's own frame; ``refAlt`` is that of its home, where thrust then is as identified."""


@dataclass(frozen=True, kw_only=True)
class SitlFrame(Immutable):
    """A frame that SITL knows by a name: it gives the order of the motors.

    Parameters
    ----------
    name
        Before the colon of ``--model``.
    layout
        The same in rotorid's library.
    frame_class, frame_type
        Parameters of the autopilot that fly it.
    """

    name: str
    layout: str
    frame_class: int
    frame_type: int


SITL_FRAMES = (
    SitlFrame(name="x", layout="quad.x", frame_class=1, frame_type=1),
    SitlFrame(name="+", layout="quad.plus", frame_class=1, frame_type=0),
    SitlFrame(name="hexax", layout="hexa.x", frame_class=2, frame_type=1),
    SitlFrame(name="hexa", layout="hexa.plus", frame_class=2, frame_type=0),
    SitlFrame(name="octa", layout="octo.plus", frame_class=3, frame_type=0),
    SitlFrame(name="octa-cwx", layout="octo.x.clockwise", frame_class=3, frame_type=14),
    SitlFrame(name="octa-quad", layout="x8", frame_class=4, frame_type=1),
)


@dataclass(frozen=True, kw_only=True)
class _Thrust:
    """Thrust of a motor in SITL's form, by how much the autopilot raises a demand, and whether demands are known."""

    expo: float
    hover_share: float
    spin_min: float
    spin_max: float
    exact: bool
    gain: float
    of_demands: bool = False

    @property
    def hover_c(self) -> float:
        """Share of the spin range in hover."""
        e, share = self.expo, self.hover_share
        return share if e == 0.0 else (e - 1.0 + math.sqrt((1.0 - e) ** 2 + 4.0 * e * share)) / (2.0 * e)

    @property
    def ratio(self) -> float:
        """Slope of thrust by share, over the quotient of the two: 1 of a line, 2 of a square."""
        return self.hover_c * (1.0 - self.expo + 2.0 * self.expo * self.hover_c) / self.hover_share


def export(vehicle: JoinedVehicle, choices: ExportSettings) -> Exported:
    """A frame as strict JSON, and a list of parameters.

    Parameters
    ----------
    vehicle
        With rotors as one of :data:`SITL_FRAMES` has them.
    choices
        The name; SITL has no delay and no lag.

    Raises
    ------
    UsageError
        Mass, inertia or another number is not known.
    ModelError
        SITL has no such frame, or the rotors are tilted.
    """
    from rotorid.flying.vehicle_from_results import require

    body = require(vehicle, "m", "I_xx", "I_yy", "I_zz", "kappa", "arm", target=NAME)
    refuse_tilted(body.rotors.layout, NAME)
    frame, rotors = sitl_frame(body.rotors.layout)
    defaults: dict[str, VehicleNumber] = {}
    findings: list[Finding] = []
    thrust = _thrust(vehicle, defaults, findings)
    table = _table(vehicle, body, rotors, thrust, defaults, findings)
    rows = _compared(vehicle, body, rotors, thrust, table)
    file = f"{choices.names}.json"
    head = [f"{choices.names}: an identified multirotor for ArduPilot's SITL, by rotorid", "", *table_lines(rows)]
    return Exported(
        target=NAME,
        files={
            file: json.dumps(table, indent=2, allow_nan=False) + "\n",
            f"{choices.names}.param": _parameter_file(_parameters(vehicle, frame, thrust, table), head),
        },
        compared=rows,
        defaults=defaults,
        left_out=tuple(_left_out(vehicle, body, thrust)),
        start=(
            "in the folder of these files, or with relative paths (SITL drops the first slash of an absolute one):\n"
            f"sim_vehicle.py -v ArduCopter --model {frame.name}:{file} --add-param-file {choices.names}.param"
        ),
        findings=tuple(findings),
    )


def sitl_frame(layout: RotorLayout) -> tuple[SitlFrame, Arranged]:
    """The frame of SITL that a layout is, and its rotors in SITL's order.

    Raises
    ------
    ModelError
        SITL has none.

    Examples
    --------
    >>> from rotorid.models.rotors import library_layout
    >>> frame, rotors = sitl_frame(library_layout("quad.x.betaflight"))
    >>> frame.name, rotors.order
    ('x', (1, 2, 3, 0))
    """
    from rotorid.models.rotors import library_layout

    for frame in SITL_FRAMES:
        own = library_layout(frame.layout)
        bearings_deg = np.degrees(np.arctan2(own.positions[:, 1], own.positions[:, 0])).tolist()
        tolerance_deg = 80.0 / layout.rotors
        rotors = arranged(layout, bearings_deg, own.spins.tolist(), tolerance_deg=tolerance_deg)
        if rotors is not None:
            return frame, rotors
    raise ModelError(
        f"the rotors of {layout.name} stand or turn as in no frame that SITL has",
        needed=f"one of {', '.join(frame.layout for frame in SITL_FRAMES)}",
    )


def air_density(altitude_m: float) -> float:
    """Of the standard atmosphere, kg/m³.

    Examples
    --------
    >>> round(air_density(593.0), 3)
    1.157
    """
    return float(_SEA_LEVEL_KG_M3 * (1.0 - _LAPSE_1_M * altitude_m) ** _DENSITY_POWER)


def compensation_gain(altitude_m: float) -> float:
    """What ArduPilot's motors make of a demand of thrust in thin air, times the demand, without that for voltage.

    Assumes the standard atmosphere; the barometer of SITL comes to within 1 % of it.

    Examples
    --------
    >>> round(compensation_gain(584.0), 4)
    1.0581
    """
    ratio = air_density(altitude_m) / _SEA_LEVEL_KG_M3
    return 1.0 / min(max(ratio, _DENSITY_RATIOS[0]), _DENSITY_RATIOS[1])


def _usual(name: str, defaults: dict[str, VehicleNumber], value: float | None = None, of: str = "") -> float:
    """The default of SITL's own frame, noted."""
    from rotorid.flying.vehicle_numbers import VehicleNumber

    usual, unit = _USUAL[name]
    chosen = usual if value is None else value
    defaults[name] = VehicleNumber(value=chosen, unit=unit, source="default", of=of or "SITL's own frame")
    return chosen


def _thrust(vehicle: JoinedVehicle, defaults: dict[str, VehicleNumber], findings: list[Finding]) -> _Thrust:
    gain = compensation_gain(_HOME_M if vehicle.altitude_m is None else vehicle.altitude_m)
    motors = next((model.motors for model in vehicle.models if model.motors is not None), None)
    if motors is not None and motors.outputs == "thrust_demand" and motors.straightening is not None:
        return _straightened(vehicle, motors.straightening, gain, findings)
    hover = HoverThrust(output=vehicle.hover_output, force=vehicle.hover_force_n, slope=vehicle.hover_slope_n)
    known = [vehicle.numbers.get(name) for name in ("spin_min", "spin_max")]
    if known[0] is not None and known[1] is not None:
        low, high = known[0].value, known[1].value
    elif motors is not None and motors.straightening is not None:
        low, high = motors.straightening.low, motors.straightening.high
    else:
        # Below this output a square through the force and the slope has no thrust.
        least = max(0.0, hover.output - 2.0 * hover.force / hover.slope)
        low = _usual("spin_min", defaults, least, "the output without thrust")
        high = _usual("spin_max", defaults, 1.0, "the whole range")
    curve = expo_thrust(hover, spin_min=low, spin_max=high)
    if not curve.exact:
        message = (
            "SITL's curve lies between a line and a square through no thrust at spin_min, and the vehicle's does not: "
            "thrust in hover is kept, its slope is not."
        )
        findings.append(warn("export_compromise", "propExpo", message, expo=curve.expo))
    controller = vehicle.controller
    if controller is not None and controller.autopilot == "ArduPilot":
        message = (
            f"Outputs have the effect that they had in flight. SITL's autopilot asks the motors for {gain:.3f} times "
            "its demand, "
            "for density alone; what the autopilot that flew made up for voltage is not in SITL's loops."
        )
        findings.append(remark("export_compromise", "MOT_BAT_VOLT_MAX", message, gain=gain))
    return _Thrust(
        expo=curve.expo, hover_share=curve.hover_share, spin_min=low, spin_max=high, exact=curve.exact, gain=gain
    )


def _straightened(vehicle: JoinedVehicle, known: Straightening, gain: float, findings: list[Finding]) -> _Thrust:
    """The curve that the autopilot takes out, and the share of thrust that it asks for in SITL at the flown demand."""
    motors = next(model.motors for model in vehicle.models if model.motors is not None)
    flown_gain = known.hover_share / motors.hover_output
    expo = min(max(known.expo, 0.0), 1.0)
    message = (
        f"The vehicle is known by demands of thrust, for which its autopilot asked {flown_gain:.3f} times as much of "
        f"the motors, to make up for voltage and density. SITL asks for {gain:.3f} times as much, for density alone "
        "(MOT_BAT_VOLT_MAX is 0). hoverThrOut makes up for the difference: demands have the effect that they had in "
        "flight, to "
        "about 1 %, as well as SITL's barometer knows the density."
    )
    findings.append(remark("export_compromise", "hoverThrOut", message, flown_gain=flown_gain, gain=gain))
    share = gain * vehicle.hover_output
    if share >= 1.0:
        raise ModelError(
            f"at a demand of {vehicle.hover_output:.3g} in hover, SITL asks its motors for {share:.2f} of full thrust",
            needed="a vehicle that hovers below full thrust",
        )
    return _Thrust(
        expo=expo, hover_share=share, spin_min=known.low, spin_max=known.high, exact=True, gain=gain, of_demands=True
    )


def _table(
    vehicle: JoinedVehicle,
    body: Multirotor,
    rotors: Arranged,
    thrust: _Thrust,
    defaults: dict[str, VehicleNumber],
    findings: list[Finding],
) -> dict[str, Any]:
    """The JSON of the frame."""
    hubs, weight = rotors.positions(body.rotors.layout), body.mass_kg * STANDARD_GRAVITY_M_S2
    size = float(np.hypot(hubs[:, 0], hubs[:, 1]).max())
    altitude = vehicle.altitude_m
    altitude_m = _usual("refAlt", defaults) if altitude is None else altitude
    density = air_density(altitude_m)
    known_disc = vehicle.numbers.get("disc_area")
    disc = _usual("disc_area", defaults) if known_disc is None else known_disc.value
    drag = _momentum_drag(vehicle, density * disc * weight / body.mass_kg**2, defaults, findings)
    per_rotor = drag * math.sqrt(density * disc * weight) / len(hubs)
    voltage = vehicle.numbers.get("reference_v")
    torque = body.rotors.torque_per_thrust_m / (_TORQUE * size * thrust.hover_c * (1.0 + 1.0 / thrust.ratio))
    spins = body.rotors.layout.spins[list(rotors.order)] * (-1.0 if rotors.mirrored else 1.0)
    usual = {name: _usual(name, defaults) for name in ("refVoltage", "refCurrent", "refBatRes", "refAngle")}
    table: dict[str, Any] = {
        "mass": body.mass_kg,
        "diagonal_size": size,
        "refSpd": _reference_speed(weight, drag, density * disc, defaults, flown=fastest_m_s(vehicle) is not None),
        **usual,
        "refAlt": altitude_m,
        "maxVoltage": _usual("maxVoltage", defaults) if voltage is None else voltage.value,
        "battCapacityAh": 0.0,
        "propExpo": thrust.expo,
        "hoverThrOut": thrust.hover_share,
        "refRotRate": _rotation_rate(vehicle, body, per_rotor, defaults, findings),
        "pwmMin": _USUAL["pwmMin"][0],
        "pwmMax": _USUAL["pwmMax"][0],
        "spin_min": thrust.spin_min,
        "spin_max": thrust.spin_max,
        "slew_max": 0.0,
        "disc_area": disc,
        "mdrag_coef": drag,
        "moment_inertia": np.diag(body.inertia_kg_m2).tolist(),
        "num_motors": len(hubs),
    }
    for number, (hub, spin) in enumerate(zip(hubs.tolist(), spins.tolist(), strict=True), start=1):
        table[f"motor{number}_position"] = hub
        table[f"motor{number}_vector"] = [0.0, 0.0, -1.0]
        table[f"motor{number}_yaw"] = spin * torque
    return {name: _rounded(value) for name, value in table.items()}


def _rounded(value: Any) -> Any:
    if isinstance(value, list):
        return [_rounded(number) for number in value]
    return value if isinstance(value, int) else float(f"{value:.8g}")


def _momentum_drag(
    vehicle: JoinedVehicle, scale: float, defaults: dict[str, VehicleNumber], findings: list[Finding]
) -> float:
    """``mdrag_coef`` of the drag over mass, which is it times the root of ``scale``."""
    known = [-vehicle.numbers[name].value for name in ("X_u", "Y_v") if name in vehicle.numbers]
    if not known:
        sizes = dict.fromkeys(("X_u", "Y_v", "Z_w"), 1.0 / math.sqrt(scale))
        coefficient = instead_of_default(vehicle, sizes, "mdrag_coef", _USUAL["mdrag_coef"][0], "1", findings)
        return _usual("mdrag_coef", defaults) if coefficient is None else coefficient
    drag = float(np.mean(known)) / math.sqrt(scale)
    if drag < 0.0:
        message = f"mdrag_coef would be {drag:.3g}, a push instead of drag; it was set to zero."
        findings.append(warn("export_compromise", "mdrag_coef", message, identified=drag))
    return max(drag, 0.0)


def _reference_speed(
    weight: float, drag: float, air: float, defaults: dict[str, VehicleNumber], *, flown: bool
) -> float:
    """``refSpd``: SITL's own, or the largest at which it does not lower ``mdrag_coef``.

    At that speed there is no drag of the body: so where fast flight has shown all of the drag.
    """
    angle = math.radians(_USUAL["refAngle"][0])
    if drag == 0.0:
        return _usual("refSpd", defaults)
    most = weight * math.tan(angle) / (math.cos(angle) ** 2 * drag * math.sqrt(weight * air / math.cos(angle)))
    if flown:
        return 0.999 * most
    if most >= _USUAL["refSpd"][0]:
        return _usual("refSpd", defaults)
    return _usual("refSpd", defaults, 0.999 * most, "the fastest that leaves mdrag_coef as it is")


def _rotation_rate(
    vehicle: JoinedVehicle,
    body: Multirotor,
    per_rotor: float,
    defaults: dict[str, VehicleNumber],
    findings: list[Finding],
) -> float:
    """``refRotRate`` of what is left of the damping beside that of the momentum drag, N s/m for each rotor."""
    hubs, inertia = body.rotors.layout.positions, body.inertia_kg_m2
    levers = {"L_p": (1, 2, inertia[0, 0]), "M_q": (0, 2, inertia[1, 1])}
    rest = [
        -vehicle.numbers[name].value - per_rotor * float((hubs[:, i] ** 2 + hubs[:, j] ** 2).sum()) / about
        for name, (i, j, about) in levers.items()
        if name in vehicle.numbers
    ]
    if not rest:
        return _unknown_rotation_rate(vehicle, body, per_rotor, defaults, findings)
    mean = float(np.mean(rest))
    if mean <= 0.0:
        message = (
            f"The momentum drag alone damps roll and pitch by {-mean:.2g} 1/s more than was identified: refRotRate is "
            "0, off."
        )
        findings.append(warn("export_compromise", "refRotRate", message, excess_1_s=-mean))
        return 0.0
    return _DAMPING / mean


def _unknown_rotation_rate(
    vehicle: JoinedVehicle,
    body: Multirotor,
    per_rotor: float,
    defaults: dict[str, VehicleNumber],
    findings: list[Finding],
) -> float:
    """``refRotRate`` where neither roll nor pitch is known: of what is seen of any axis, or SITL's own."""
    hubs, inertia = body.rotors.layout.positions, np.diag(body.inertia_kg_m2)
    levers = {"L_p": (1, 2, inertia[0]), "M_q": (0, 2, inertia[1]), "N_r": (0, 1, inertia[2])}
    drags = [per_rotor * float((hubs[:, i] ** 2 + hubs[:, j] ** 2).sum()) / about for i, j, about in levers.values()]
    usual = _DAMPING / _USUAL["refRotRate"][0]
    of_drag = float(np.mean(drags[:2]))
    total = instead_of_default(
        vehicle, dict.fromkeys(levers, 1.0), "damping of rates", usual + of_drag, "1/s", findings
    )
    if total is None:
        return _usual("refRotRate", defaults)
    return _DAMPING / (total - of_drag) if total > of_drag else 0.0


# The equations


def sitl_accelerations(
    table: Mapping[str, Any], x: FloatArray, velocity_m_s: FloatArray, rates_rad_s: FloatArray
) -> FloatArray:
    """SITL's equations at the highest voltage and the reference's density: accelerations without gravity, FRD.

    Parameters
    ----------
    table
        The JSON of a frame with positions of the motors and its inertia.
    x
        Outputs between ``pwmMin`` and ``pwmMax`` in SITL's order, shape ``(motors,)``.
    velocity_m_s, rates_rad_s
        Through the air and of the body.
    """
    n, mass, density = table["num_motors"], table["mass"], air_density(table["refAlt"])
    weight, e = mass * STANDARD_GRAVITY_M_S2, table["propExpo"]
    hover_m_s = 2.0 * table["refVoltage"] * table["refCurrent"] / weight
    area, fastest_m_s = weight / (0.5 * density * hover_m_s**2), hover_m_s / math.sqrt(table["hoverThrOut"])
    drag, body_drag = _sitl_drag(table, weight, density)
    c = np.clip((x - table["spin_min"]) / (table["spin_max"] - table["spin_min"]), 0.0, 1.0)
    force, moment = np.zeros(3), np.zeros(3)
    for number in range(n):
        hub, up = (np.array(table[f"motor{number + 1}_{what}"]) for what in ("position", "vector"))
        local = velocity_m_s + np.cross(rates_rad_s, hub)
        inflow = max(0.0, float(local @ up))
        jet = fastest_m_s**2 * ((1.0 - e) * c[number] + e * c[number] ** 2) - inflow**2
        thrust = max(0.0, 0.5 * density * area / n * jet)
        push = thrust * up - drag * math.sqrt(density * table["disc_area"] / n * thrust) * local
        yaw = table[f"motor{number + 1}_yaw"] * c[number] * _TORQUE * table["diagonal_size"] * thrust
        force += push
        moment += np.cross(hub, push) + np.array([0.0, 0.0, yaw])
    force -= body_drag * 0.5 * density * velocity_m_s * np.abs(velocity_m_s)
    damping = _DAMPING / table["refRotRate"] if table["refRotRate"] > 0.0 else 0.0
    return np.concatenate([force / mass, moment / np.array(table["moment_inertia"]) - damping * rates_rad_s])


def _sitl_drag(table: Mapping[str, Any], weight: float, density: float) -> tuple[float, float]:
    """Momentum drag as SITL leaves it, and the area of the body's drag."""
    angle, drag = math.radians(table["refAngle"]), table["mdrag_coef"]
    speed = table["refSpd"]
    momentum = math.cos(angle) ** 2 * drag * speed * math.sqrt(weight / math.cos(angle) * density * table["disc_area"])
    needed = weight * math.tan(angle)
    if momentum > needed:
        return drag * needed / momentum, 0.0
    return drag, (needed - momentum) / (0.5 * density * speed**2)


def _compared(
    vehicle: JoinedVehicle,
    body: Multirotor,
    rotors: Arranged,
    thrust: _Thrust,
    table: Mapping[str, Any],
) -> tuple[Compared, ...]:
    lag = vehicle.numbers.get("T_motor")
    identified = identified_motion(vehicle, body, lag_s=None if lag is None else lag.value)
    span = table["spin_max"] - table["spin_min"]
    hover = table["spin_min"] + span * _share_in_hover(table)
    own = linearized(
        lambda x, v, w: sitl_accelerations(table, x, v, w), np.full(table["num_motors"], hover), lag_s=None
    )
    back, output = rotors.restored(own.by_output), hover
    if thrust.of_demands:
        # One over the slope of thrust by output, in shares, is what the autopilot makes of a demand.
        c, e, gain = _share_in_hover(table), table["propExpo"], compensation_gain(table["refAlt"])
        back = back * span * gain / (1.0 - e + 2.0 * e * c)
        output = table["hoverThrOut"] / gain
    exported = own.replaced(back, hover_output=output)
    rows = compared(vehicle, identified, exported, _fidelities(vehicle, body, thrust), delay=False)
    return rows + in_flight(
        vehicle, body, lambda x, v, w: sitl_accelerations(table, x, v, w), np.full(table["num_motors"], hover)
    )


def _share_in_hover(table: Mapping[str, Any]) -> float:
    e, share = table["propExpo"], table["hoverThrOut"]
    return float(share if e == 0.0 else (e - 1.0 + math.sqrt((1.0 - e) ** 2 + 4.0 * e * share)) / (2.0 * e))


def _fidelities(vehicle: JoinedVehicle, body: Multirotor, thrust: _Thrust) -> dict[str, Fidelity]:
    """One drag for all axes, one damping, a diagonal inertia, no lag."""
    fidelities: dict[str, Fidelity] = dict.fromkeys(("Z_w", "L_p", "M_q", "N_r"), "approximated")
    fidelities |= dict.fromkeys((LAG, "M_u", "L_v"), "not")
    numbers = vehicle.numbers
    if "X_u" in numbers and "Y_v" in numbers:
        fidelities |= dict.fromkeys(("X_u", "Y_v"), "approximated")
    if any(numbers[name].value > 0.0 for name in ("X_u", "Y_v") if name in numbers):
        fidelities |= dict.fromkeys(("X_u", "Y_v"), "not")
    if not thrust.exact:
        fidelities |= dict.fromkeys((VERTICAL, ROLL, PITCH, YAW, HOVER), "approximated")
    if np.any(body.inertia_kg_m2[np.triu_indices(3, 1)]):
        fidelities |= dict.fromkeys((ROLL, PITCH, YAW), "approximated")
    return fidelities


def _left_out(vehicle: JoinedVehicle, body: Multirotor, thrust: _Thrust) -> list[str]:
    remarks = []
    for name, words in (("T_motor", "lag of the motors"), ("delay", "delay")):
        if name in vehicle.numbers and vehicle.numbers[name].value > 0.0:
            remarks.append(f"SITL has no {words}: {1e3 * vehicle.numbers[name].value:.2g} ms are lost.")
    if np.any(body.inertia_kg_m2[np.triu_indices(3, 1)]):
        remarks.append("SITL's inertia is diagonal: products of inertia are lost.")
    if any(name in vehicle.numbers for name in ("M_u", "L_v")):
        remarks.append("SITL has no moment by velocity but that of drag at the rotors: M_u and L_v are lost.")
    remarks.append("SITL has one drag for three axes and one damping for three: Z_w and N_r follow from the others.")
    remarks += lost_air(vehicle)
    if not thrust.of_demands:
        full_n = vehicle.hover_force_n / thrust.hover_share
        form = f"of SITL's form with an expo of {thrust.expo:.3g}"
        remarks += full_thrust_words(form, full_n, body.rotors.thrust_at(thrust.spin_max))
    if vehicle.altitude_m is None:
        remarks.append(
            f"The altitude of the flight is not known: thrust is as identified at {_HOME_M:g} m, where SITL starts."
        )
    return remarks


def _parameters(
    vehicle: JoinedVehicle, frame: SitlFrame, thrust: _Thrust, table: Mapping[str, Any]
) -> dict[str, float]:
    """Parameters of the autopilot and of SITL that go with the frame, and gains and filters that flew, of an ArduPilot.

    Gains of filters other than those of SITL's defaults would leave it other margins than the vehicle had.
    """
    parameters = {
        "FRAME_CLASS": float(frame.frame_class),
        "FRAME_TYPE": float(frame.frame_type),
        "MOT_PWM_MIN": table["pwmMin"],
        "MOT_PWM_MAX": table["pwmMax"],
        # ArduPilot arms no vehicle whose motors idle above the output where thrust begins.
        "MOT_SPIN_ARM": min(_USUAL_SPIN_ARM, table["spin_min"]),
        "MOT_SPIN_MIN": table["spin_min"],
        "MOT_SPIN_MAX": table["spin_max"],
        "MOT_THST_EXPO": table["propExpo"],
        "MOT_THST_HOVER": table["hoverThrOut"] / thrust.gain,
        # The battery of SITL does not sag, and a compensation of its own would change every loop.
        "MOT_BAT_VOLT_MAX": 0.0,
        "MOT_BAT_VOLT_MIN": 0.0,
        "SIM_BATT_VOLTAGE": table["maxVoltage"],
        "SIM_BATT_CAP_AH": 0.0,
    }
    controller = vehicle.controller
    if controller is not None and controller.autopilot == "ArduPilot":
        parameters |= {**controller.gains, **controller.filters}
        if controller.loop_rate_hz:
            parameters["SCHED_LOOP_RATE"] = controller.loop_rate_hz
    return parameters


def _parameter_file(parameters: Mapping[str, float], head: Sequence[str]) -> str:
    """Parameters as ArduPilot's tools read them: a name, a comma, a value."""
    lines = [f"# {line}".rstrip() for line in head]
    return "\n".join([*lines, *(f"{name},{value:.7g}" for name, value in parameters.items())]) + "\n"
