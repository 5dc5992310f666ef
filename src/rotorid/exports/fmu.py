"""FMI 2.0: each model as an FMU for co-simulation whose sources are C, and a script that compiles them.

An FMU that carries Python needs the same Python wherever it runs, and the library that makes it has binaries for two
systems. A linear model is some arrays and two hundred lines of C, which every tool that takes FMUs can have: the file
holds the sources, and the script that stands beside it compiles them for the machine it runs on and puts the result
into the file. Nothing is compiled by rotorid itself.

Inputs are held over a communication step. Continuous models are integrated exactly for them, for steps of any length;
sampled ones move on with their own rate.

References
----------
Modelica Association, Functional Mock-up Interface for Model Exchange and Co-Simulation, version 2.0.
"""

from __future__ import annotations

import hashlib
import io
import uuid
import zipfile
from collections.abc import Sequence
from importlib.resources import files
from typing import TYPE_CHECKING
from xml.sax.saxutils import quoteattr

from rotorid.exports.state_space import (
    NamedModel,
    compared_models,
    delay_words,
    description,
    early,
    headed,
    named_models,
)
from rotorid.exports.target import ExportChoices, Exported
from rotorid.typing import FloatArray

if TYPE_CHECKING:
    from rotorid.pipeline.joined import JoinedVehicle

NAME = "fmu"

_SOURCE = "linear_fmu.c"
_STEP_S = 0.001
_OLDEST = (1980, 1, 1, 0, 0, 0)
_NUMBERS_A_LINE = 6


def export(vehicle: JoinedVehicle, choices: ExportChoices) -> Exported:
    """An FMU for each model, and a script that compiles them.

    Parameters
    ----------
    vehicle
        With the models that it was joined from; of unknown scale too.
    choices
        Delays as states, as lags or left out; the rate of sampled models.

    Raises
    ------
    UsageError
        There is no model, or two would have one name.
    ModelError
        A model has no proper state space.
    """
    models = named_models(vehicle, choices)
    rows = compared_models(models, choices)
    sentences = delay_words(models, choices)
    head = headed(f"{choices.names}: identified models as FMUs, by rotorid", rows, sentences)
    names = [f"{choices.names}_{one.name}.fmu" for one in models]
    script = f"{choices.names}_compile.py"
    return Exported(
        target=NAME,
        files={
            **{name: _fmu(one, head) for name, one in zip(names, models, strict=True)},
            script: _COMPILE.format(names=names),
        },
        compared=rows,
        left_out=tuple(sentences),
        start=(
            f"python {script}    compiles the sources for this machine with its C compiler, into the files\n"
            f"fmpy simulate {names[0]}    or import it as a co-simulation FMU in Simulink, Dymola, OpenModelica"
        ),
        findings=early(models),
    )


def _fmu(one: NamedModel, head: Sequence[str]) -> bytes:
    header = _header(one)
    source = files("rotorid.exports").joinpath("sources", _SOURCE).read_text(encoding="utf-8")
    guid = str(uuid.UUID(bytes=hashlib.sha256((header + source).encode()).digest()[:16]))
    contents = {
        "modelDescription.xml": _description(one, guid),
        "sources/model.h": f'#define GUID "{guid}"\n{header}',
        f"sources/{one.name}.c": source,
        "documentation/index.html": _page(one, head),
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


def _header(one: NamedModel) -> str:
    system, structure = one.exported, one.model.structure
    sizes = {"STATES": len(system.states), "INPUTS": len(structure.inputs), "OUTPUTS": len(structure.outputs)}
    lines = [f"#define {name} {size}" for name, size in sizes.items()]
    lines.append(f"#define STEP_S {0.0 if system.sample_time_s is None else system.sample_time_s:.17g}")
    lines += [f"static const double {name}[] = {{{_numbers(getattr(system, name))}}};" for name in "ABCD"]
    return "\n".join(lines) + "\n"


def _numbers(matrix: FloatArray) -> str:
    texts = [f"{value:.17g}" for value in matrix.ravel().tolist()] or ["0"]
    rows = [", ".join(texts[i : i + _NUMBERS_A_LINE]) for i in range(0, len(texts), _NUMBERS_A_LINE)]
    return ",\n    ".join(rows)


def _description(one: NamedModel, guid: str) -> str:
    from rotorid import __version__

    structure, step_s = one.model.structure, one.exported.sample_time_s
    inputs, outputs = structure.inputs, structure.outputs
    variables = [
        f"    <ScalarVariable name={quoteattr(_once(name, outputs))} valueReference={quoteattr(str(number))} "
        'causality="input" variability="continuous"><Real start="0"/></ScalarVariable>'
        for number, name in enumerate(inputs)
    ]
    variables += [
        f"    <ScalarVariable name={quoteattr(name)} valueReference={quoteattr(str(number))} "
        'causality="output" variability="continuous" initial="calculated"><Real/></ScalarVariable>'
        for number, name in enumerate(outputs, start=len(inputs))
    ]
    unknowns = "".join(f'<Unknown index="{index}"/>' for index in range(len(inputs) + 1, len(variables) + 1))
    abilities = {
        "modelIdentifier": one.name,
        "canHandleVariableCommunicationStepSize": "true",
        "canInterpolateInputs": "false",
        "canGetAndSetFMUstate": "true",
        "canBeInstantiatedOnlyOncePerProcess": "false",
    }
    able = " ".join(f"{name}={quoteattr(value)}" for name, value in abilities.items())
    return "\n".join(
        [
            '<?xml version="1.0" encoding="UTF-8"?>',
            f'<fmiModelDescription fmiVersion="2.0" modelName={quoteattr(one.model.name)} guid={quoteattr(guid)} '
            f'generationTool="rotorid {__version__}" variableNamingConvention="flat" numberOfEventIndicators="0">',
            f"  <CoSimulation {able}>",
            f"    <SourceFiles><File name={quoteattr(one.name + '.c')}/></SourceFiles>",
            "  </CoSimulation>",
            f'  <DefaultExperiment startTime="0" stopTime="1" stepSize="{_STEP_S if step_s is None else step_s:g}"/>',
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


def _once(name: str, others: Sequence[str]) -> str:
    """A name that no output has."""
    return f"{name}_input" if name in others else name


def _page(one: NamedModel, head: Sequence[str]) -> str:
    from html import escape

    text = "\n".join([*description(one), "", *head])
    return (
        f'<!DOCTYPE html>\n<meta charset="utf-8">\n<title>{escape(one.model.name)}</title>\n<pre>{escape(text)}</pre>\n'
    )


_COMPILE = '''"""Compile the sources of the FMUs beside this file for this machine, and put the results into them.

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
