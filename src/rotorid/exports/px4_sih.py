r"""PX4's simulation in hardware (SIH): parameters, and an airframe that holds them.

Its equations, of four rotors in an X or six, with linear thrust and the lagged outputs :math:`x`:

.. math::

    x \leftarrow x + \tfrac{\Delta t}{T_{TAU}} (u - x), \qquad F_i = T_{MAX} x_i, \qquad
    M = \begin{pmatrix} L_{ROLL} T_{MAX} \sum a_i x_i \\ L_{PITCH} T_{MAX} \sum b_i x_i \\ Q_{MAX} \sum s_i x_i
    \end{pmatrix}

    m \dot V = F - K_{DV} V, \qquad I \dot\omega = M - K_{DW} \omega - \omega \times I \omega

``SIH_T_MAX`` is the slope of thrust at hover, so that loops are as fast as on the vehicle; the output in hover follows
from weight and slope, and goes to ``MPC_THR_HOVER``. ``SIH_T_TAU`` is such that a step of Euler's rule has the pole of
the lag.

References
----------
PX4-Autopilot, ``src/modules/simulation/simulator_sih``, and its documentation, ``sim_sih``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

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
    YAW,
    compared,
    identified_motion,
    in_flight,
    linearized,
    lost_air,
)
from rotorid.exports.settings import ExportSettings
from rotorid.exports.target import Compared, Exported, Fidelity, table_lines
from rotorid.exports.thrust import delay_words, full_thrust_words, lag_words, sih_lag
from rotorid.models.rotors import RotorLayout
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

if TYPE_CHECKING:
    from rotorid.flying.vehicle_from_results import JoinedVehicle
    from rotorid.flying.vehicle_numbers import VehicleNumber
    from rotorid.simulation.multirotor import Multirotor

NAME = "px4-sih"
STEP_S = 0.004
"""Of SIH in ``px4_sitl`` where nothing else was set."""

AIRFRAME = 22001
"""Number of the airframe: 22000 to 22999 are free for own ones."""

_ROOT = math.sqrt(0.75)
_USUAL_LAG_S, _USUAL_RATE_1_S = 0.05, 1.0
"""Lag of SIH's own vehicle, and its drag over mass and damping over inertia."""

_INTEGERS = frozenset({"SIH_VEHICLE_TYPE", "CA_AIRFRAME", "CA_ROTOR_COUNT"})


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame(Immutable):
    """An arrangement of rotors that SIH has.

    Parameters
    ----------
    name
        For people.
    kind
        ``SIH_VEHICLE_TYPE``.
    roll, pitch, spins
        What each rotor does by its thrust, in units of the levers, and by its torque.
    tolerance_deg
        How far the bearing of a rotor may be from that of the arrangement.
    """

    name: str
    kind: int
    roll: tuple[float, ...]
    pitch: tuple[float, ...]
    spins: tuple[float, ...]
    tolerance_deg: float


FRAMES: Mapping[int, Frame] = {
    4: Frame(
        name="quad X",
        kind=0,
        roll=(-1.0, 1.0, 1.0, -1.0),
        pitch=(1.0, -1.0, 1.0, -1.0),
        spins=(1.0, 1.0, -1.0, -1.0),
        tolerance_deg=35.0,
    ),
    6: Frame(
        name="hexa X",
        kind=4,
        roll=(-0.5, -1.0, -0.5, 0.5, 1.0, 0.5),
        pitch=(_ROOT, 0.0, -_ROOT, -_ROOT, 0.0, _ROOT),
        spins=(1.0, -1.0, 1.0, -1.0, 1.0, -1.0),
        tolerance_deg=15.0,
    ),
}


def export(vehicle: JoinedVehicle, choices: ExportSettings) -> Exported:
    """Parameters of SIH as QGroundControl reads them and as lines for PX4's shell, and an airframe.

    Parameters
    ----------
    vehicle
        Four rotors in an X, or six.
    choices
        ``delay="lag"`` adds the delay to the lag.

    Raises
    ------
    UsageError
        Mass, inertia or another number is not known.
    ModelError
        SIH has no such arrangement of rotors, or they are tilted.
    """
    from rotorid.flying.vehicle_from_results import require

    body = require(vehicle, "m", "I_xx", "I_yy", "I_zz", "kappa", "arm", target=NAME)
    refuse_tilted(body.rotors.layout, NAME)
    frame, rotors = sih_frame(body.rotors.layout)
    parameters, defaults, findings = _parameters(vehicle, body, frame, choices)
    rows = _compared(vehicle, body, (frame, rotors), parameters, choices)
    left_out = _left_out(vehicle, choices)
    head = [f"{choices.names}: an identified multirotor for PX4's SIH, by rotorid", "", *table_lines(rows)]
    return Exported(
        target=NAME,
        files={
            f"{choices.names}.params": parameter_file(parameters, head),
            f"{choices.names}_set.sh": set_lines(parameters, head),
            f"{AIRFRAME}_sihsim_{choices.names}": _airframe(
                choices.names, frame, _places(body, frame), parameters, head
            ),
        },
        compared=rows,
        defaults=defaults,
        left_out=tuple(left_out),
        start=_start(choices.names, frame),
        findings=tuple(findings),
    )


def sih_frame(layout: RotorLayout) -> tuple[Frame, Arranged]:
    """The arrangement of SIH that a layout is, and its rotors in SIH's order.

    Raises
    ------
    ModelError
        The layout is none that SIH has.

    Examples
    --------
    >>> from rotorid.models.rotors import library_layout
    >>> frame, rotors = sih_frame(library_layout("quad.x.betaflight"))
    >>> frame.name, rotors.order
    ('quad X', (1, 2, 3, 0))
    """
    wanted = f"rotors in a {' or a '.join(frame.name for frame in FRAMES.values())}, which SIH flies"
    frame = FRAMES.get(layout.rotors)
    if frame is None:
        raise ModelError(f"{layout.name} has {layout.rotors} rotors", needed=wanted)
    bearings_deg = np.degrees(np.arctan2(-np.array(frame.roll), np.array(frame.pitch))).tolist()
    rotors = arranged(layout, bearings_deg, frame.spins, tolerance_deg=frame.tolerance_deg)
    if rotors is None:
        raise ModelError(f"the rotors of {layout.name} stand or turn otherwise", needed=wanted)
    return frame, rotors


def _parameters(
    vehicle: JoinedVehicle, body: Multirotor, frame: Frame, choices: ExportSettings
) -> tuple[dict[str, float], dict[str, VehicleNumber], list[Finding]]:
    """Values of the parameters as they are written, what was taken from SIH's own vehicle, remarks."""
    inertia, largest_n = body.inertia_kg_m2, vehicle.hover_slope_n
    defaults: dict[str, VehicleNumber] = {}
    findings: list[Finding] = []
    roll_m, pitch_m = _levers(body)
    lag_s = lag_of(vehicle, choices)
    masses = dict.fromkeys(("X_u", "Y_v", "Z_w"), body.mass_kg)
    inertias = {"L_p": float(inertia[0, 0]), "M_q": float(inertia[1, 1]), "N_r": float(inertia[2, 2])}
    drag = _mean_drag(vehicle, masses, "SIH_KDV", "N s/m", defaults, findings)
    damping = _mean_drag(vehicle, inertias, "SIH_KDW", "N m s", defaults, findings)
    if lag_s is None:
        defaults["SIH_T_TAU"] = _default(_USUAL_LAG_S, "s", "SIH_T_TAU")
    values = {
        "SIH_VEHICLE_TYPE": float(frame.kind),
        "SIH_MASS": body.mass_kg,
        "SIH_IXX": inertia[0, 0],
        "SIH_IYY": inertia[1, 1],
        "SIH_IZZ": inertia[2, 2],
        # Products as they stand in the matrix; without their sign it would be another body.
        "SIH_IXY": inertia[0, 1],
        "SIH_IXZ": inertia[0, 2],
        "SIH_IYZ": inertia[1, 2],
        "SIH_T_MAX": largest_n,
        "SIH_Q_MAX": body.rotors.torque_per_thrust_m * largest_n,
        "SIH_L_ROLL": roll_m,
        "SIH_L_PITCH": pitch_m,
        "SIH_KDV": drag,
        "SIH_KDW": damping,
        "SIH_T_TAU": _USUAL_LAG_S if lag_s is None else _time_constant(lag_s),
        "MPC_THR_HOVER": body.mass_kg * STANDARD_GRAVITY_M_S2 / (len(frame.spins) * largest_n),
        "THR_MDL_FAC": 0.0,
    }
    if vehicle.altitude_m is not None:
        values["SIH_LOC_H0"] = vehicle.altitude_m
    hover = values["MPC_THR_HOVER"]
    if hover >= 1.0:
        raise ModelError(
            f"with the slope of thrust at hover as largest thrust, {largest_n:.4g} N, SIH hovers at {hover:.2f}",
            needed="a curve of thrust that is nearer to a line",
        )
    if abs(hover - vehicle.hover_output) > _SAME_HOVER * vehicle.hover_output:
        message = (
            f"SIH's thrust is a line through zero: with the slope at hover it hovers at {hover:.3f} where the vehicle "
            f"hovers at {vehicle.hover_output:.3f}. MPC_THR_HOVER is set accordingly."
        )
        findings.append(remark("export_compromise", "SIH_T_MAX", message, hover_output=hover))
    return {name: written(value) for name, value in values.items()}, defaults, findings


_SAME_HOVER = 0.02
"""Share of the hover output by which that of SIH may differ without a remark."""


def lag_of(vehicle: JoinedVehicle, choices: ExportSettings) -> float | None:
    """The lag that a simulator should have, the delay included where that was chosen; ``None`` if neither is known."""
    lag, late = vehicle.numbers.get("T_motor"), vehicle.numbers.get("delay")
    added_s = max(late.value, 0.0) if late is not None and choices.delay == "lag" else 0.0
    if lag is None:
        return added_s or None
    return lag.value + added_s


def delay_steps(vehicle: JoinedVehicle, choices: ExportSettings, *, step_s: float) -> int:
    """Whole steps of a simulator by which commands are late; none where the lag holds the delay, or nothing does."""
    late = vehicle.numbers.get("delay")
    return 0 if late is None or choices.delay in ("lag", "none") else max(round(late.value / step_s), 0)


def _time_constant(lag_s: float) -> float:
    """``SIH_T_TAU`` of a lag; that of one step, the shortest that SIH has, where the lag is much shorter."""
    return STEP_S if lag_s < _SHORTEST_SHARE * STEP_S else sih_lag(lag_s, step_s=STEP_S)


_SHORTEST_SHARE = 0.1


def _default(value: float, unit: str, of: str) -> VehicleNumber:
    from rotorid.flying.vehicle_numbers import VehicleNumber

    return VehicleNumber(value=value, unit=unit, source="default", of=of)


def _mean_drag(
    vehicle: JoinedVehicle,
    sizes: Mapping[str, float],
    parameter: str,
    unit: str,
    defaults: dict[str, VehicleNumber],
    findings: list[Finding],
) -> float:
    """One coefficient for several axes: the mean of the first two, else what is seen of any, else that of SIH's own."""
    level = dict(list(sizes.items())[:2])
    known = [-vehicle.numbers[name].value * size for name, size in level.items() if name in vehicle.numbers]
    if not known:
        value = _USUAL_RATE_1_S * float(np.mean(list(level.values())))
        if (coefficient := instead_of_default(vehicle, sizes, parameter, value, unit, findings)) is not None:
            return coefficient
        defaults[parameter] = _default(value, unit, f"{_USUAL_RATE_1_S:g} 1/s as SIH's own vehicle has it")
        return value
    mean = float(np.mean(known))
    if mean < 0.0:
        message = f"{parameter} would be {mean:.3g} {unit}, a push instead of drag; it was set to zero."
        findings.append(warn("export_compromise", parameter, message, identified=mean))
    return max(mean, 0.0)


def written(value: float) -> float:
    """A value as seven digits hold it, which is what a parameter of PX4 does."""
    return float(f"{value:.7g}")


def sih_accelerations(
    parameters: Mapping[str, float], x: FloatArray, velocity_m_s: FloatArray, rates_rad_s: FloatArray
) -> FloatArray:
    """SIH's equations: accelerations without gravity, FRD, by lagged outputs in SIH's order.

    Parameters
    ----------
    parameters
        ``SIH_…`` by name.
    x
        Lagged outputs, shape ``(rotors,)``.
    velocity_m_s, rates_rad_s
        Through the air and of the body.
    """
    p, frame = parameters, FRAMES[len(x)]
    inertia = np.array(
        [
            [p["SIH_IXX"], p["SIH_IXY"], p["SIH_IXZ"]],
            [p["SIH_IXY"], p["SIH_IYY"], p["SIH_IYZ"]],
            [p["SIH_IXZ"], p["SIH_IYZ"], p["SIH_IZZ"]],
        ]
    )
    force = np.array([0.0, 0.0, -p["SIH_T_MAX"] * x.sum()]) - p["SIH_KDV"] * velocity_m_s
    moment = np.array(
        [
            p["SIH_L_ROLL"] * p["SIH_T_MAX"] * (x @ frame.roll),
            p["SIH_L_PITCH"] * p["SIH_T_MAX"] * (x @ frame.pitch),
            p["SIH_Q_MAX"] * (x @ frame.spins),
        ]
    )
    moment = moment - p["SIH_KDW"] * rates_rad_s - np.cross(rates_rad_s, inertia @ rates_rad_s)
    return np.concatenate([force / p["SIH_MASS"], np.linalg.solve(inertia, moment)])


def _compared(
    vehicle: JoinedVehicle,
    body: Multirotor,
    placed: tuple[Frame, Arranged],
    parameters: Mapping[str, float],
    choices: ExportSettings,
) -> tuple[Compared, ...]:
    frame, rotors = placed
    identified = identified_motion(vehicle, body, lag_s=lag_of(vehicle, choices))
    hover = np.full(len(rotors.order), parameters["MPC_THR_HOVER"])
    constant_s = parameters["SIH_T_TAU"]
    # With the constant of one step the output is there after it, and no lag is left.
    at_once = constant_s <= STEP_S
    pole_s = 0.0 if at_once else -STEP_S / math.log1p(-STEP_S / constant_s)
    own = linearized(lambda x, v, w: sih_accelerations(parameters, x, v, w), hover, lag_s=pole_s)
    exported = own.replaced(rotors.restored(own.by_output))
    fidelities = _fidelities(body, frame, rotors) | ({LAG: "approximated"} if at_once else {})
    rows = compared(vehicle, identified, exported, fidelities, delay=choices.delay == "lag")
    return rows + in_flight(vehicle, body, lambda x, v, w: sih_accelerations(parameters, x, v, w), hover)


def _places(body: Multirotor, frame: Frame) -> FloatArray:
    """Where SIH has the rotors, in its order, shape ``(rotors, 3)``."""
    roll_m, pitch_m = _levers(body)
    return np.stack([pitch_m * np.array(frame.pitch), -roll_m * np.array(frame.roll), 0.0 * np.array(frame.roll)], 1)


def _levers(body: Multirotor) -> tuple[float, float]:
    """``SIH_L_ROLL`` and ``SIH_L_PITCH``."""
    hubs_m = np.abs(body.rotors.layout.positions)
    if len(hubs_m) == 4:
        return float(hubs_m[:, 1].mean()), float(hubs_m[:, 0].mean())
    return (float(np.hypot(hubs_m[:, 0], hubs_m[:, 1]).mean()),) * 2


def _fidelities(body: Multirotor, frame: Frame, rotors: Arranged) -> dict[str, Fidelity]:
    """What SIH has one number for where the vehicle has several, and what it has none for."""
    fidelities: dict[str, Fidelity] = dict.fromkeys(("X_u", "Y_v", "Z_w", "L_p", "M_q", "N_r"), "approximated")
    fidelities |= dict.fromkeys(("M_u", "L_v"), "not")
    hubs, ideal = rotors.positions(body.rotors.layout), _places(body, frame)
    moved = np.abs(hubs - ideal).max() > _SAME_PLACE * np.abs(ideal).max()
    if moved:
        fidelities |= dict.fromkeys((ROLL, PITCH), "approximated")
    # Products of inertia bring what is off on one axis to the others.
    if (moved or rotors.mirrored) and np.any(body.inertia_kg_m2[np.triu_indices(3, 1)]):
        fidelities |= dict.fromkeys((ROLL, PITCH, YAW), "approximated")
    c_0, _, c_2 = body.rotors.thrust
    if c_0 or c_2:
        fidelities[HOVER] = "approximated"
    return fidelities


_SAME_PLACE = 0.005
"""Share of the arm by which rotors may stand off the places that SIH has for them."""


def _left_out(vehicle: JoinedVehicle, choices: ExportSettings) -> list[str]:
    remarks = []
    words = "SIH has no delay: {} are lost; --delay-as-lag adds them to the lag."
    remarks += delay_words(vehicle, words, as_lag=choices.delay == "lag")
    if any(name in vehicle.numbers for name in ("M_u", "L_v")):
        remarks.append("SIH has no moment by velocity: M_u and L_v are lost.")
    remarks.append("SIH has one drag for three axes and one damping for three: Z_w and N_r follow from the others.")
    remarks += [*lost_air(vehicle), *lag_words(vehicle)]
    assert vehicle.multirotor is not None
    identified_n = vehicle.multirotor.rotors.thrust_at(1.0)
    return remarks + full_thrust_words("a line through zero", vehicle.hover_slope_n, identified_n)


# The files


def parameter_file(parameters: Mapping[str, float], head: Sequence[str]) -> str:
    """Parameters as QGroundControl keeps them: vehicle, component, name, value and MAVLink's type, with tabs between.

    Examples
    --------
    >>> print(parameter_file({"SIH_MASS": 1.5, "SIH_VEHICLE_TYPE": 0.0}, ["of a test"]).expandtabs(4))
    # of a test
    # Vehicle-Id Component-Id Name Value Type
    1   1   SIH_MASS    1.5 9
    1   1   SIH_VEHICLE_TYPE    0   6
    <BLANKLINE>
    """
    lines = [*_commented(head), "# Vehicle-Id Component-Id Name Value Type"]
    for name, value in sorted(parameters.items()):
        text, kind = (f"{value:.0f}", 6) if name in _INTEGERS else (f"{value:.7g}", 9)
        lines.append(f"1\t1\t{name}\t{text}\t{kind}")
    return "\n".join(lines) + "\n"


def set_lines(parameters: Mapping[str, float], head: Sequence[str]) -> str:
    """The same as lines for PX4's shell, which saves them at the end."""
    lines = [f"param set {name} {value:.7g}" for name, value in parameters.items()]
    return "\n".join([*_commented(head), *lines, "param save"]) + "\n"


def allocated(layout: RotorLayout, torque_per_thrust_m: float) -> dict[str, float]:
    """Parameters of PX4's control allocation for some rotors, as they are written."""
    from rotorid.vehicles.px4 import rotor_parameters

    found = rotor_parameters(layout, torque_per_thrust_m=torque_per_thrust_m)
    return {"CA_AIRFRAME": 0.0, **{name: written(value) + 0.0 for name, value in found.items()}}


def _commented(lines: Sequence[str]) -> list[str]:
    return [f"# {line}".rstrip() for line in lines]


def _airframe(name: str, frame: Frame, hubs_m: FloatArray, parameters: Mapping[str, float], head: Sequence[str]) -> str:
    lines = ["#!/bin/sh", "#", f"# @name {name}, simulated by SIH", f"# @type Simulation ({frame.name})", "#"]
    lines += [*_commented(head), "", ". ${R}etc/init.d/rc.mc_defaults", ""]
    lines += ["PX4_SIMULATOR=${PX4_SIMULATOR:=sihsim}", f"PX4_SIM_MODEL=${{PX4_SIM_MODEL:={name}}}", ""]
    lines += [f"param set-default SENS_EN_{sensor}SIM 1" for sensor in ("GPS", "BARO", "MAG")]
    layout = RotorLayout(name=frame.name, positions=hubs_m, spins=np.array(frame.spins), arm_known=True)
    rotors = allocated(layout, parameters["SIH_Q_MAX"] / parameters["SIH_T_MAX"])
    lines += ["", *(f"param set-default {key} {value:.7g}" for key, value in rotors.items())]
    lines += [""] + [f"param set-default PWM_MAIN_FUNC{index + 1} {101 + index}" for index in range(len(hubs_m))]
    own = {key: value for key, value in parameters.items() if key != "SIH_VEHICLE_TYPE"}
    lines += ["", *(f"param set-default {key} {value:.7g}" for key, value in own.items())]
    lines += ["", f"param set SIH_VEHICLE_TYPE {frame.kind}"]
    return "\n".join(lines) + "\n"


def _start(name: str, frame: Frame) -> str:
    stock = "sihsim_quadx" if frame.kind == 0 else "sihsim_hex"
    return (
        f"Without building: make px4_sitl {stock}; load {name}.params in QGroundControl, or paste the lines of\n"
        f"{name}_set.sh into PX4's shell; start it again.\n"
        f"As a model of its own: copy {AIRFRAME}_sihsim_{name} to ROMFS/px4fmu_common/init.d-posix/airframes,\n"
        f"list it in the CMakeLists.txt there, list {name} in src/modules/simulation/simulator_sih/CMakeLists.txt;\n"
        f"then make px4_sitl sihsim_{name}."
    )
