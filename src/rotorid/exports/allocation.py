r"""Control allocation of the vehicle itself: motor factors for ArduPilot, Betaflight and PX4 from identified geometry.

Rotor :math:`i` makes a force and a moment per newton of its thrust, the columns of the effectiveness E. The factors are
its pseudo-inverse: each column moves one axis alone,

.. math:: (L, M, N, -F_z) = E\,T, \qquad M_x = E^+, \qquad E\,E^+ = 1,

each scaled to a largest factor of one. An autopilot scales them again (ArduPilot to one half), so that the size of the
vehicle does not matter and gains stay what they were. For a symmetric frame this is the autopilot's own table. Where
rotors are not placed evenly about the center of gravity, that table couples the axes, above all thrust with pitch.

- ArduPilot: a Lua script for the frame class "scripting matrix". Roll to the right, pitch up and yaw to the right are
  positive, so that a counterclockwise rotor has a positive yaw factor.
- Betaflight: lines ``mmix`` of throttle, roll, pitch and yaw. Its pitch is positive nose down.
- PX4: ``CA_ROTORn_…``; it inverts the geometry itself.

References
----------
ArduPilot, AP_MotorsMatrix and AP_Scripting; Betaflight, ``mixer_init.c``; PX4, ActuatorEffectivenessRotors.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rotorid.data.display import listed
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.quantity import TWO_SIDED_95
from rotorid.errors import ModelError, UsageError
from rotorid.exports.px4_sih import allocated, parameter_file, set_lines
from rotorid.exports.settings import ExportSettings
from rotorid.exports.target import Compared, Exported, table_lines
from rotorid.models.rotors import UP, RotorLayout, ardupilot_mixer, px4_mixer
from rotorid.typing import FloatArray

if TYPE_CHECKING:
    from rotorid.flying.vehicle_from_results import JoinedVehicle
    from rotorid.flying.vehicle_numbers import VehicleNumber

NAME = "allocation"
AXES = ("roll", "pitch", "yaw", "thrust")

_USUAL_KAPPA_M = 0.05
"""``CA_ROTORn_KM`` of PX4 where nothing is set."""

_MOST_OF_BETAFLIGHT, _MOST = 8, 12
"""Motors of a mixer."""

_COUPLED_PERCENT = 1.0
"""Coupling of a standard table from which a table of one's own pays."""

_ZERO = 1e-9


def factors_of(layout: RotorLayout, kappa_m: float = _USUAL_KAPPA_M) -> FloatArray:
    """Factors of roll, pitch, yaw and thrust, each column with a largest magnitude of one, shape ``(rotors, 4)``.

    Parameters
    ----------
    layout
        Rotors about the center of gravity.
    kappa_m
        Torque over thrust, in the unit of the positions. It only matters where rotors are tilted.

    Raises
    ------
    ModelError
        The rotors cannot make one of the four without the others, or one would have to push down in hover.

    Examples
    --------
    >>> from rotorid.models.rotors import library_layout
    >>> factors_of(library_layout("quad.x")).round(6).tolist()[0]
    [-1.0, 1.0, 1.0, 1.0]
    """
    if layout.uncontrollable:
        raise ModelError(
            f"the rotors of {layout.name} cannot make {listed(layout.uncontrollable)} without the other axes",
            needed="rotors that make roll, pitch, yaw and thrust independently",
            remedy="correct positions and spin directions with --layout FILE.toml",
        )
    inverse = np.linalg.pinv(effectiveness(layout, kappa_m))
    factors = inverse / np.abs(inverse).max(axis=0)
    factors[np.abs(factors) < _ZERO] = 0.0
    if factors[:, 3].min() <= 0.0:
        worst = int(factors[:, 3].argmin()) + 1
        raise ModelError(
            f"motor {worst} of {layout.name} would have to push down in hover",
            needed="a center of gravity between the rotors",
            remedy="correct the positions, which count from the center of gravity, with --layout FILE.toml",
        )
    return np.asarray(factors)


def effectiveness(layout: RotorLayout, kappa_m: float) -> FloatArray:
    """Moments of roll, pitch and yaw and the thrust per newton of each rotor, shape ``(4, rotors)``."""
    rows = layout.effectiveness(kappa_m)
    return np.stack([*rows[3:], -rows[2]])


def export(vehicle: JoinedVehicle, choices: ExportSettings) -> Exported:
    """A Lua script and parameters for ArduPilot, lines for Betaflight, parameters for PX4.

    Parameters
    ----------
    vehicle
        With its rotors. Arm and torque constant are written where they are known; factors do not need them.
    choices
        The name.

    Raises
    ------
    UsageError
        The rotors are not known, or they are tilted and the torque constant is not known.
    ModelError
        The rotors cannot make the four axes independently of each other.
    """
    layout, findings = _about_center(vehicle)
    kappa_m, defaults = _torque(vehicle, layout)
    factors = factors_of(layout, kappa_m)
    parameters = allocated(layout, kappa_m)
    name, order = choices.names, motor_test_order(layout)
    bodies: dict[str, str] = {f"{name}_motors.lua": lua_script(factors, order, name)}
    if layout.rotors <= _MOST_OF_BETAFLIGHT:
        bodies[f"{name}_betaflight.txt"] = mmix_lines(factors)
    rows = tuple(_compared(layout, kappa_m, factors, bodies, parameters))
    head = [
        f"{name}: control allocation of an identified multirotor, by rotorid",
        "",
        *table_lines(rows),
        "",
        *motor_words(layout),
    ]
    marks = {".lua": "--", ".txt": "#"}
    files = {
        file: "".join(f"{marks[file[-4:]]} {line}".rstrip() + "\n" for line in head) + body
        for file, body in bodies.items()
    }
    commented = "".join(f"# {line}".rstrip() + "\n" for line in head)
    return Exported(
        target=NAME,
        files={
            **files,
            f"{name}_ardupilot.param": f"{commented}FRAME_CLASS,15\nSCR_ENABLE,1\n",
            f"{name}_px4.params": parameter_file(parameters, head),
            f"{name}_px4_set.sh": set_lines(parameters, head),
        },
        compared=rows,
        defaults=defaults,
        left_out=tuple(_left_out(layout)),
        start=_start(name, betaflight=layout.rotors <= _MOST_OF_BETAFLIGHT),
        findings=(*findings, *_standard(layout, kappa_m, factors)),
    )


def _about_center(vehicle: JoinedVehicle) -> tuple[RotorLayout, list[Finding]]:
    """The rotors about the center of gravity, which flights show where it is off the rotors' center for sure."""
    layout = vehicle.layout
    if layout is None:
        raise UsageError(
            f"{NAME} needs the positions of the rotors of {vehicle.name}",
            remedy="add a result of physical.motors, or name a layout with --layout",
        )
    if layout.rotors > _MOST:
        raise ModelError(f"{layout.name} has {layout.rotors} rotors", needed=f"at most {_MOST}")
    moved = np.zeros(3)
    for row, name in enumerate(("x_cg", "y_cg")):
        for model in vehicle.models:
            found = model.parameters.get(name) if model.flight is not None and layout.arm_known else None
            if found is not None and found.std is not None and abs(found.value) > TWO_SIDED_95 * found.std:
                moved[row] = found.value
    if not moved.any():
        return layout, []
    message = (
        f"The flights show the center of gravity {1e3 * moved[0]:.1f} mm ahead and {1e3 * moved[1]:.1f} mm to the "
        "right of the rotors' center; the factors are about it. It moves with the battery."
    )
    found_at = remark("export_compromise", "center of gravity", message, x_m=float(moved[0]), y_m=float(moved[1]))
    return replace(layout, positions=layout.positions - moved), [found_at]


def _torque(vehicle: JoinedVehicle, layout: RotorLayout) -> tuple[float, dict[str, VehicleNumber]]:
    """Torque over thrust in the unit of the positions, and what of it nobody measured."""
    from rotorid.flying.vehicle_numbers import VehicleNumber

    defaults: dict[str, VehicleNumber] = {}
    if not layout.arm_known:
        of = "the unit of CA_ROTORn_PX and PY; PX4 uses their ratios only"
        defaults["arm"] = VehicleNumber(value=layout.arm, unit="m", source="default", of=of)
    known = vehicle.numbers.get("kappa")
    if known is not None and layout.arm_known:
        return known.value, defaults
    assert layout.axes is not None
    if not np.allclose(layout.axes, UP):
        missing = " and ".join([*([] if layout.arm_known else ["arm (m)"]), *(["kappa (m)"] if known is None else [])])
        options = [*([] if layout.arm_known else ["--set arm=M"]), *(["--set kappa=M"] if known is None else [])]
        raise UsageError(
            f"{NAME} needs {missing} of {vehicle.name}, because its rotors are tilted",
            remedy=f"add {' '.join(options)}",
        )
    of = "PX4's own; rotors that push straight up yaw alike with any"
    defaults["kappa"] = VehicleNumber(value=_USUAL_KAPPA_M, unit="m", source="default", of=of)
    return _USUAL_KAPPA_M, defaults


def motor_test_order(layout: RotorLayout) -> tuple[int, ...]:
    """Place of each motor in ArduPilot's motor test, from 1: clockwise from the nose, the upper of two first.

    Examples
    --------
    >>> from rotorid.models.rotors import library_layout
    >>> motor_test_order(library_layout("quad.x")), motor_test_order(library_layout("quad.plus"))
    ((1, 3, 4, 2), (2, 4, 1, 3))
    """
    x, y, z = layout.positions.T
    bearings = np.round(np.degrees(np.arctan2(y, x)), 3) % 360.0
    places = {int(motor): place for place, motor in enumerate(np.lexsort((z, bearings)), start=1)}
    return tuple(places[motor] for motor in range(layout.rotors))


def motor_words(layout: RotorLayout) -> list[str]:
    """Where each motor is and how it turns, in the order of the vehicle's log.

    Examples
    --------
    >>> from rotorid.models.rotors import library_layout
    >>> motor_words(library_layout("quad.x"))[0]
    'motor 1: front right (45°), counterclockwise from above'
    """
    found = []
    for motor, ((x, y, _), spin) in enumerate(zip(layout.positions, layout.spins, strict=True), start=1):
        ends = (("front", "rear"), x), (("right", "left"), y)
        sides = [names[0] if value > 0.0 else names[1] for names, value in ends if abs(value) > _IN_LINE * layout.arm]
        bearing_deg = round(float(np.degrees(np.arctan2(y, x)))) % 360
        turning = "counterclockwise" if spin > 0.0 else "clockwise"
        found.append(f"motor {motor}: {' '.join(sides) or 'center'} ({bearing_deg}°), {turning} from above")
    return found


_IN_LINE = 0.05
"""Share of the arm by which a rotor counts as on an axis."""


# The files, and how they are read back


def lua_script(factors: FloatArray, order: Sequence[int], name: str) -> str:
    """A script for ArduPilot's frame class 15; factors of thrust only where they differ."""
    lines = [""]
    for motor, (roll, pitch, yaw, _) in enumerate(factors):
        numbers = ", ".join(_text(value) for value in (roll, pitch, yaw))
        lines.append(f"MotorsMatrix:add_motor_raw({motor}, {numbers}, {order[motor]})")
    if np.ptp(factors[:, 3]) > _SAME:
        lines += [
            f'assert(MotorsMatrix:set_throttle_factor({motor}, {_text(thrust)}), "no thrust factor of motor {motor}")'
            for motor, thrust in enumerate(factors[:, 3])
        ]
    lines += [f'assert(MotorsMatrix:init({len(factors)}), "the motor matrix of {name} was refused")']
    return "\n".join([*lines, f'motors:set_frame_string("{name}")']) + "\n"


_SAME = 5e-7


def mmix_lines(factors: FloatArray) -> str:
    """Lines for Betaflight's command line."""
    lines = ["mixer CUSTOM", "mmix reset"]
    for motor, (roll, pitch, yaw, thrust) in enumerate(factors):
        lines.append(f"mmix {motor} {' '.join(_text(value) for value in (thrust, roll, -pitch, yaw))}")
    return "\n".join([*lines, "set yaw_motors_reversed = OFF", "save"]) + "\n"


def _text(value: float) -> str:
    return f"{value + 0.0:.6f}" if abs(value) >= _SAME else "0.000000"


def lua_factors(text: str) -> FloatArray:
    """Factors of a script as ArduPilot takes them: roll, pitch and yaw up to one half, thrust up to one."""
    rows = [line.split(",") for line in re.findall(r"add_motor_raw\(([^()]*)\)", text)]
    factors = np.column_stack([np.array(rows, dtype=np.float64)[:, 1:4], np.ones(len(rows))])
    for motor, thrust in re.findall(r"set_throttle_factor\((\d+), ([^()]*)\)", text):
        factors[int(motor), 3] = float(thrust)
    return np.asarray(factors / np.abs(factors).max(axis=0) * (0.5, 0.5, 0.5, 1.0))


def mmix_factors(text: str) -> FloatArray:
    """Factors of Betaflight's lines in the order and signs of :func:`factors_of`."""
    rows = np.array([line.split()[2:] for line in text.splitlines() if re.match(r"mmix \d", line)], dtype=np.float64)
    return np.stack([rows[:, 1], -rows[:, 2], rows[:, 3], rows[:, 0]], axis=1)


def px4_layout(parameters: Mapping[str, float]) -> RotorLayout:
    """The rotors that parameters of PX4 describe."""
    count = int(parameters["CA_ROTOR_COUNT"])

    def column(letter: str, usual: Sequence[float]) -> list[list[float]]:
        names = [[f"CA_ROTOR{index}_{letter}{axis}" for axis in "XYZ"] for index in range(count)]
        return [[parameters.get(name, value) for name, value in zip(row, usual, strict=True)] for row in names]

    return RotorLayout(
        name="CA_ROTOR parameters",
        positions=np.array(column("P", (0.0, 0.0, 0.0))),
        spins=np.sign([parameters[f"CA_ROTOR{index}_KM"] for index in range(count)]),
        axes=np.array(column("A", UP)),
    )


def _compared(
    layout: RotorLayout,
    kappa_m: float,
    factors: FloatArray,
    bodies: Mapping[str, str],
    parameters: Mapping[str, float],
) -> Iterator[Compared]:
    """What each autopilot makes of the vehicle's rotors with its file, next to the factors themselves."""
    acts = effectiveness(layout, kappa_m)
    unit = "m" if layout.arm_known else "1"
    lua = lua_factors(next(iter(bodies.values())))
    yield from _responses("ArduPilot", acts @ (factors * (0.5, 0.5, 0.5, 1.0)), acts @ lua, unit)
    text = next((body for file, body in bodies.items() if file.endswith(".txt")), None)
    if text is not None:
        yield from _responses("Betaflight", acts @ factors, acts @ mmix_factors(text), unit)
    yield from _responses("PX4", acts @ px4_mixer(layout), acts @ px4_mixer(px4_layout(parameters)), unit)


def _responses(autopilot: str, wanted: FloatArray, found: FloatArray, unit: str) -> Iterator[Compared]:
    """Response of each axis to its own command, and the largest coupling of axes."""
    for row, axis in enumerate(AXES):
        yield Compared(
            name=f"{autopilot}: {axis} per command",
            unit="1" if axis == "thrust" else unit,
            identified=float(wanted[row, row]),
            exported=float(found[row, row]),
            held="exact",
        )
    yield Compared(
        name=f"{autopilot}: coupling of axes",
        unit="1",
        identified=0.0,
        exported=_coupling(found),
        held="exact",
        size=1.0,
    )


def _coupling(response: FloatArray) -> float:
    """Largest share of an axis' own response that the command of another axis makes on it."""
    shares = np.abs(response / np.diag(response)[:, None]) - np.eye(len(response))
    largest = float(shares.max())
    return largest if largest > _ROUNDED else 0.0


_ROUNDED = 1e-5
"""Six decimals of a factor."""


def _standard(layout: RotorLayout, kappa_m: float, factors: FloatArray) -> Iterator[Finding]:
    """Whether the factors are those of a standard frame, and what that one would do here if they are not."""
    standard = ardupilot_mixer(replace(layout, yaw_weights=layout.spins))
    if np.abs(2.0 * standard[:, :3] - factors[:, :3]).max() < _LIKE and np.ptp(factors[:, 3]) < _LIKE:
        yield remark(
            "export_compromise",
            "standard frame",
            "The factors are those of the standard frame: without these files, the autopilot mixes alike if its motors "
            "have the same order.",
        )
        return
    percent = 100.0 * _coupling(effectiveness(layout, kappa_m) @ standard)
    if percent >= _COUPLED_PERCENT:
        yield warn(
            "export_compromise",
            "standard frame",
            f"With the table of a standard frame, one axis disturbs another by up to {percent:.0f} %; these factors "
            "separate them.",
            coupling_percent=percent,
        )


_LIKE = 0.005


def _left_out(layout: RotorLayout) -> Iterator[str]:
    yield (
        "The thrust curve is not part of an allocation: set MOT_THST_EXPO, thrust_linear or THR_MDL_FAC from the "
        "identified curve."
    )
    yield "Gains are not written: each axis is scaled to a largest factor of one. Check them in a hover."
    assert layout.axes is not None
    if not np.allclose(layout.axes, UP):
        yield "Rotors are tilted: their side forces are not balanced by ArduPilot and Betaflight."
    if layout.rotors > _MOST_OF_BETAFLIGHT:
        yield f"Betaflight mixes {_MOST_OF_BETAFLIGHT} motors at most: no mmix lines were written."


def _start(name: str, *, betaflight: bool) -> str:
    lines = [
        "Motors are numbered as in the log, see the head of each file.",
        f"ArduPilot: load {name}_ardupilot.param, copy {name}_motors.lua to APM/scripts on the card, restart.",
        *([f"Betaflight: paste {name}_betaflight.txt into the CLI."] if betaflight else []),
        f"PX4: load {name}_px4.params in QGroundControl, or paste the lines of {name}_px4_set.sh into its shell.",
        "Then, without propellers, check order and direction of every motor in the motor test.",
    ]
    return "\n".join(lines)
