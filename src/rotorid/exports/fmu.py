r"""FMI 2.0: the vehicle and each model as FMUs for co-simulation whose sources are C, and a script that compiles them.

An FMU that carries Python needs the same Python wherever it runs, and the library that makes it has binaries for two
systems. A model is some arrays and two hundred lines of C, which every tool that takes FMUs can have: the file holds
the sources, and the script in the same folder compiles them for the machine it runs on and puts the result into the
file. Nothing is compiled by rotorid itself.

A linear model holds its inputs over a communication step. Continuous ones are integrated exactly for that, for steps of
any length; sampled ones move on with their own rate. The vehicle is the rigid body with rotors, with its curve of
thrust, lag, drag and delay,

.. math::

    m \dot V = m g + R (W_F F + D_F (V_b, \omega)), \qquad
    J \dot\omega = W_M F + D_M (V_b, \omega) - \omega \times J \omega, \qquad
    T \dot x = u(t - \tau) - x, \qquad F_i = c_0 + c_1 x_i + c_2 x_i^2

in steps of a millisecond, from hover, in free flight: there is no ground.

References
----------
Modelica Association, Functional Mock-up Interface for Model Exchange and Co-Simulation, version 2.0.
"""

from __future__ import annotations

import hashlib
import io
import re
import uuid
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.resources import files
from typing import TYPE_CHECKING
from xml.sax.saxutils import quoteattr

import numpy as np

from rotorid.data.base import Immutable
from rotorid.errors import UsageError
from rotorid.exports.mujoco import own_slopes
from rotorid.exports.px4_sih import lag_of
from rotorid.exports.round_trip import DELAY, compared, hover_air, identified_motion, in_flight, linearized, lost_air
from rotorid.exports.settings import ExportSettings
from rotorid.exports.state_space import (
    NamedModel,
    air_words,
    compared_models,
    delay_words,
    description,
    early,
    harmless,
    headed,
    kept_delays,
    named_models,
)
from rotorid.exports.target import Compared, Exported, Fidelity
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

if TYPE_CHECKING:
    from rotorid.flying.vehicle_from_results import JoinedVehicle
    from rotorid.simulation.multirotor import Multirotor

NAME = "fmu"

STEP_S = 0.001

WINDS = ("wind_north", "wind_east", "wind_down")
"""Inputs of the vehicle besides its motors, m/s."""

OUTPUTS = (
    *("north", "east", "down", "velocity_north", "velocity_east", "velocity_down"),
    *("u", "v", "w", "p", "q", "r", "phi", "theta", "psi", "ax", "ay", "az"),
)
"""Of the vehicle: SI units, radians, axes north, east, down and forward, right, down."""

_OLDEST = (1980, 1, 1, 0, 0, 0)
_NUMBERS_A_LINE = 6


@dataclass(frozen=True, kw_only=True)
class _Unit(Immutable):
    """What an FMU is made of: its name, equations, numbers and variables."""

    name: str
    title: str
    dynamics: str
    header: str
    inputs: Sequence[str]
    outputs: Sequence[str]
    step_s: float
    lines: Sequence[str]
    starts: Mapping[str, float] = field(default_factory=dict)


def export(vehicle: JoinedVehicle, choices: ExportSettings) -> Exported:
    """An FMU for each model and, where its scale is known, for the vehicle, and a script that compiles them.

    Parameters
    ----------
    vehicle
        With the models that it was joined from; of unknown scale too.
    choices
        Delays of models as states, as lags or left out; the rate of sampled ones. The vehicle has its delay as past
        outputs, or as a part of the lag.

    Raises
    ------
    UsageError
        There is neither a model nor a vehicle, or two models would have one name.
    ModelError
        A model has no proper state space.
    """
    body = vehicle.multirotor
    if not vehicle.models and body is None:
        raise UsageError("no model to export", needed="a result with a model, or a complete vehicle")
    models = named_models(vehicle, choices) if vehicle.models else ()
    rows = compared_models(models, choices)
    sentences = [*delay_words(models, choices), *air_words(vehicle.models)]
    units = {f"{choices.names}_{model.name}.fmu": _linear(model) for model in models}
    if body is not None:
        unit = _vehicle(choices.names, vehicle, body, choices)
        units = {f"{choices.names}.fmu": unit, **units}
        rows = (*_compared(vehicle, body, unit.header, choices), *rows)
        sentences += _delay_remarks(vehicle, choices)
    head = headed(f"{choices.names}: an identified vehicle as FMUs, by rotorid", rows, sentences)
    script, names = f"{choices.names}_compile.py", list(units)
    return Exported(
        target=NAME,
        files={**{name: _fmu(unit, head) for name, unit in units.items()}, script: _COMPILE.format(names=names)},
        compared=rows,
        left_out=tuple(sentences),
        start=(
            f"python {script}    compiles the sources for this machine with its C compiler, into the files\n"
            f"fmpy simulate {names[0]}    or import it as a co-simulation FMU in Simulink, Dymola, OpenModelica"
        ),
        findings=early(models),
        delays=kept_delays(models, choices),
    )


def _linear(model: NamedModel) -> _Unit:
    system, structure = model.exported, model.model.structure
    sizes = {"STATES": len(system.states), "INPUTS": len(structure.inputs), "OUTPUTS": len(structure.outputs)}
    step_s = 0.0 if system.sample_time_s is None else system.sample_time_s
    arrays = {name: getattr(system, name) for name in "ABCD"}
    return _Unit(
        name=model.name,
        title=model.model.name,
        dynamics="linear.h",
        header=_header(sizes, {"STEP_S": step_s}, arrays),
        inputs=[f"{name}_input" if name in structure.outputs else name for name in structure.inputs],
        outputs=structure.outputs,
        step_s=step_s or STEP_S,
        lines=description(model),
    )


def _vehicle(name: str, vehicle: JoinedVehicle, body: Multirotor, choices: ExportSettings) -> _Unit:
    motors, air = body.rotors.layout.motor_names, hover_air(body)
    steps, share = divmod(round(_delay_s(vehicle, choices) / STEP_S, 9), 1.0)
    sizes = {
        "ROTORS": len(motors),
        "INPUTS": len(motors) + len(WINDS),
        "OUTPUTS": len(OUTPUTS),
        "DELAY_STEPS": int(steps),
    }
    scalars = {
        "STEP_S": STEP_S,
        "DELAY_SHARE": share,
        "MASS": body.mass_kg,
        "GRAVITY": STANDARD_GRAVITY_M_S2,
        "LAG_S": lag_of(vehicle, choices) or 0.0,
    }
    arrays = {
        "INERTIA": body.inertia_kg_m2,
        "INVERSE_INERTIA": np.linalg.inv(body.inertia_kg_m2),
        "AIR": air,
        "WRENCH": body.wrench,
        "THRUST": np.array(body.rotors.thrust),
        "HOVER": body.hover_shares,
    }
    return _Unit(
        name=name,
        title=name,
        dynamics="vehicle.h",
        header=_header(sizes, scalars, arrays),
        inputs=(*motors, *WINDS),
        outputs=OUTPUTS,
        step_s=STEP_S,
        lines=["Outputs of the motors from 0 to 1, at first those of hover; free flight, there is no ground."],
        starts=dict(zip(motors, body.hover_shares.tolist(), strict=True)),
    )


def _delay_s(vehicle: JoinedVehicle, choices: ExportSettings) -> float:
    """By which the vehicle's outputs are late; none where the lag holds the delay, or where it is left out."""
    late = vehicle.numbers.get(DELAY)
    return 0.0 if late is None or choices.model_delay != "states" else max(late.value, 0.0)


def _delay_remarks(vehicle: JoinedVehicle, choices: ExportSettings) -> list[str]:
    """How the delay of the vehicle is exported, and what is missing, in sentences."""
    remarks, late = [], vehicle.numbers.get(DELAY)
    if late is not None and late.value > 0.0:
        how = {
            "lag": "part of its lag",
            "none": "left out (--no-delay)",
            "states": f"exact, in steps of {1e3 * STEP_S:g} ms",
        }
        remarks.append(f"The delay of the vehicle, {1e3 * late.value:.2g} ms, is {how[choices.model_delay]}.")
    if "T_motor" not in vehicle.numbers:
        remarks.append("The lag of the motors is not identified.")
    return remarks + lost_air(vehicle)


# The equations of the vehicle, by the numbers as they are written


def vehicle_accelerations(header: str, x: FloatArray, velocity_m_s: FloatArray, rates_rad_s: FloatArray) -> FloatArray:
    """What the FMU of a vehicle does: accelerations without gravity, FRD.

    Parameters
    ----------
    header
        Its numbers, as they stand in ``model.h``.
    x
        Lagged outputs, shape ``(rotors,)``.
    velocity_m_s, rates_rad_s
        Through the air and of the body, FRD.
    """
    number = {name: _read(header, name) for name in ("MASS", "INERTIA", "INVERSE_INERTIA", "AIR", "WRENCH", "THRUST")}
    c_0, c_1, c_2 = number["THRUST"]
    inertia = number["INERTIA"].reshape(3, 3)
    wrench = number["WRENCH"].reshape(6, -1) @ (c_0 + x * (c_1 + x * c_2))
    wrench = wrench + number["AIR"].reshape(6, 6) @ np.concatenate([velocity_m_s, rates_rad_s])
    moment = wrench[3:] - np.cross(rates_rad_s, inertia @ rates_rad_s)
    turning = number["INVERSE_INERTIA"].reshape(3, 3) @ moment
    return np.concatenate([wrench[:3] / number["MASS"][0], turning])


def _read(header: str, name: str) -> FloatArray:
    found = re.search(rf"\b{name}(?:\[\] = {{([^}}]*)}}| (\S+))", header)
    assert found is not None
    return np.array([float(text) for text in (found[1] or found[2]).split(",")])


def _compared(vehicle: JoinedVehicle, body: Multirotor, header: str, choices: ExportSettings) -> tuple[Compared, ...]:
    identified = own_slopes(vehicle, body, identified_motion(vehicle, body, lag_s=lag_of(vehicle, choices)))
    exported = linearized(
        lambda x, v, w: vehicle_accelerations(header, x, v, w),
        _read(header, "HOVER"),
        lag_s=float(_read(header, "LAG_S")[0]) or None,
    )
    rows = compared(vehicle, identified, exported, {}, delay=choices.model_delay == "lag")
    rows += in_flight(vehicle, body, lambda x, v, w: vehicle_accelerations(header, x, v, w), _read(header, "HOVER"))
    if choices.model_delay == "none":
        return rows
    late_s = float(_read(header, "DELAY_STEPS")[0] + _read(header, "DELAY_SHARE")[0]) * STEP_S
    held: Fidelity = "exact" if choices.model_delay == "states" else "approximated"
    return tuple(replace(row, exported=late_s, held=held) if row.name == DELAY else row for row in rows)


# The files


def _fmu(unit: _Unit, head: Sequence[str]) -> bytes:
    place = files("rotorid.exports").joinpath("sources")
    functions, equations = (place.joinpath(name).read_text(encoding="utf-8") for name in ("fmi2.c", unit.dynamics))
    digest = hashlib.sha256((unit.header + functions + equations).encode()).digest()
    guid = str(uuid.UUID(bytes=digest[:16]))
    contents = {
        "modelDescription.xml": _description(unit, guid),
        "sources/model.h": f'#define GUID "{guid}"\n{unit.header}',
        "sources/dynamics.h": equations,
        f"sources/{unit.name}.c": functions,
        "documentation/index.html": _page(unit, head),
    }
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in contents.items():
            # Without the hour of the clock two exports of one result are the same file.
            entry = zipfile.ZipInfo(name, date_time=_OLDEST)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, text)
    return written.getvalue()


def _header(sizes: Mapping[str, int], scalars: Mapping[str, float], arrays: Mapping[str, FloatArray]) -> str:
    lines = [f"#define {name} {size}" for name, size in sizes.items()]
    lines += [f"#define {name} {value:.17g}" for name, value in scalars.items()]
    lines += [f"static const double {name}[] = {{{_numbers(values)}}};" for name, values in arrays.items()]
    return "\n".join(lines) + "\n"


def _numbers(matrix: FloatArray) -> str:
    texts = [f"{value:.17g}" for value in matrix.ravel().tolist()] or ["0"]
    rows = [", ".join(texts[i : i + _NUMBERS_A_LINE]) for i in range(0, len(texts), _NUMBERS_A_LINE)]
    return ",\n    ".join(rows)


def _description(unit: _Unit, guid: str) -> str:
    from rotorid import __version__

    variables = [
        f'    <ScalarVariable name={quoteattr(harmless(name))} valueReference="{number}" causality="input" '
        f'variability="continuous"><Real start="{unit.starts.get(name, 0.0):.17g}"/></ScalarVariable>'
        for number, name in enumerate(unit.inputs)
    ]
    variables += [
        f'    <ScalarVariable name={quoteattr(harmless(name))} valueReference="{number}" causality="output" '
        'variability="continuous" initial="calculated"><Real/></ScalarVariable>'
        for number, name in enumerate(unit.outputs, start=len(unit.inputs))
    ]
    unknowns = "".join(f'<Unknown index="{index}"/>' for index in range(len(unit.inputs) + 1, len(variables) + 1))
    abilities = {
        "modelIdentifier": unit.name,
        "canHandleVariableCommunicationStepSize": "true",
        "canInterpolateInputs": "false",
        "canGetAndSetFMUstate": "true",
        "canBeInstantiatedOnlyOncePerProcess": "false",
    }
    able = " ".join(f"{name}={quoteattr(value)}" for name, value in abilities.items())
    return "\n".join(
        [
            '<?xml version="1.0" encoding="UTF-8"?>',
            f'<fmiModelDescription fmiVersion="2.0" modelName={quoteattr(harmless(unit.title))} guid={quoteattr(guid)} '
            f'generationTool="rotorid {__version__}" variableNamingConvention="flat" numberOfEventIndicators="0">',
            f"  <CoSimulation {able}>",
            f"    <SourceFiles><File name={quoteattr(unit.name + '.c')}/></SourceFiles>",
            "  </CoSimulation>",
            f'  <DefaultExperiment startTime="0" stopTime="1" stepSize="{unit.step_s:g}"/>',
            "  <ModelVariables>",
            *variables,
            "  </ModelVariables>",
            "  <ModelStructure>",
            f"    <Outputs>{unknowns}</Outputs>",
            f"    <InitialUnknowns>{unknowns}</InitialUnknowns>",
            "  </ModelStructure>",
            "</fmiModelDescription>",
        ]
    )


def _page(unit: _Unit, head: Sequence[str]) -> str:
    from html import escape

    text = "\n".join([*unit.lines, "", *head])
    return f'<!DOCTYPE html>\n<meta charset="utf-8">\n<title>{escape(unit.title)}</title>\n<pre>{escape(text)}</pre>\n'


_COMPILE = '''"""Compile the sources of the FMUs in this folder for this machine, and put the results into them.

It needs a C compiler: the one that the variable CC names, else cc. Files that have a binary for this machine already
are left as they are.
"""

import os
import platform
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

NAMES = {names!r}
PLACES = {{"Linux": ("linux", "so"), "Darwin": ("darwin", "dylib"), "Windows": ("win", "dll")}}


def compiled(place):
    """Add a binary to a file; True if it had none."""
    system, ending = PLACES[platform.system()]
    bits = 64 if sys.maxsize > 2**32 else 32
    with zipfile.ZipFile(place) as archive:
        sources = [name for name in archive.namelist() if name.endswith(".c")]
        model = Path(sources[0]).stem
        binary = f"binaries/{{system}}{{bits}}/{{model}}.{{ending}}"
        if binary in archive.namelist():
            return False
        with tempfile.TemporaryDirectory() as folder:
            archive.extractall(folder)
            made = Path(folder) / "made"
            command = [os.environ.get("CC", "cc"), "-std=c99", "-O2", "-shared", "-fPIC", "-fvisibility=hidden"]
            command += [*(f"{{folder}}/{{name}}" for name in sources), "-o", str(made), "-lm"]
            subprocess.run(command, check=True)
            content = made.read_bytes()
    with zipfile.ZipFile(place, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(binary, content)
    return True


if __name__ == "__main__":
    for name in NAMES:
        new = compiled(Path(__file__).with_name(name))
        print(f"{{name}}: {{'compiled' if new else 'was compiled before'}}")
'''
