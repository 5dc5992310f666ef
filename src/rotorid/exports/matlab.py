r"""MATLAB and Octave: a ``.mat`` file, and a script that makes the models of literals alone.

MATLAB has delays of its own, which a continuous model keeps exactly. Octave has none: there each becomes a Padé
approximation of the order that stands in the script. Where parameters have standard deviations and MATLAB
has the Robust Control Toolbox, the script also makes an uncertain model of the same equations,

.. math:: M \dot x = F x + G u, \qquad y = H_0 x + H_1 \dot x

with each free parameter within 1.96 standard deviations; their correlation is in the ``.mat`` file alone.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rotorid.data.quantity import TWO_SIDED_95
from rotorid.errors import UsageError
from rotorid.exports.settings import ExportSettings
from rotorid.exports.state_space import (
    LONGEST_NAME,
    NamedModel,
    air_words,
    compared_models,
    delay_words,
    description,
    early,
    harmless,
    headed,
    kept_delays,
    measured,
    named_models,
    pade_words,
)
from rotorid.exports.target import Exported
from rotorid.simulation.rational_model import input_output_delays
from rotorid.typing import FloatArray

if TYPE_CHECKING:
    from rotorid.flying.vehicle_from_results import JoinedVehicle
    from rotorid.models.structure import LinearStructure

NAME = "matlab"

_HEADER = b"MATLAB 5.0 MAT-file, written by rotorid"
_HEADER_BYTES = 116
_NUMBERS_A_LINE = 8
_PLAIN = re.compile(r"[A-Za-z]\w*", re.ASCII)
_OCTAVE = "exist('OCTAVE_VERSION', 'builtin')"


def export(vehicle: JoinedVehicle, choices: ExportSettings) -> Exported:
    """A ``.mat`` file and a script.

    Parameters
    ----------
    vehicle
        With the models that it was joined from; of unknown scale too.
    choices
        By default MATLAB keeps delays, and Octave has states for them; ``delay="lag"`` makes lags of them in both, and
        ``delay="none"`` leaves them out. Of a sampled model delays are memory of past inputs.

    Raises
    ------
    UsageError
        There is no model, or names collide.
    ModelError
        A model has no proper state space.
    """
    models = named_models(vehicle, choices)
    if choices.names in {model.name for model in models} | {f"{model.name}_measured" for model in models}:
        raise UsageError(
            f"the script and a model in it have the same name {choices.names}",
            needed="names that differ",
            remedy="choose another with --name",
        )
    own = own_delays(choices)
    rows = compared_models(models, choices, own_delays=own)
    sentences = _own_delay_words(models) if own else delay_words(models, choices)
    sentences += air_words(vehicle.models)
    title = f"{choices.names}: identified models for MATLAB and Octave, by rotorid"
    head = headed(title, rows, sentences)
    return Exported(
        target=NAME,
        files={f"{choices.names}.m": _script(models, choices, head), f"{choices.names}.mat": _mat(models, choices)},
        compared=rows,
        left_out=tuple(sentences),
        start=(
            f"{choices.names}    in MATLAB (Control System Toolbox) or Octave (package control) makes "
            f"{', '.join(model.name for model in models)}\n"
            f"bode({models[0].name})    in Simulink: an LTI System block with {models[0].name}\n"
            f"data = load('{choices.names}.mat')    has matrices, delays, parameters and their covariance"
        ),
        findings=early(models),
        delays=kept_delays(models, choices),
    )


def own_delays(choices: ExportSettings) -> bool:
    """Whether delays are kept as delays."""
    return choices.sample_rate_hz is None and choices.model_delay == "states"


def _own_delay_words(models: Sequence[NamedModel]) -> list[str]:
    words = pade_words(models)
    return ["MATLAB keeps delays exactly. In Octave they are Padé approximations:", *words] if words else []


# The script


def _script(models: Sequence[NamedModel], choices: ExportSettings, head: Sequence[str]) -> str:
    lines = [*_comment(head), f"if {_OCTAVE}", "  pkg load control", "end"]
    for model in models:
        lines += ["", *_model(model, choices)]
    return "\n".join(lines) + "\n"


def _comment(lines: Sequence[str]) -> list[str]:
    return [f"% {line}".rstrip() for line in lines]


def _model(model: NamedModel, choices: ExportSettings) -> Iterator[str]:
    system = model.plant if own_delays(choices) else model.exported
    structure = model.model.structure
    yield from _comment(description(model))
    for name in "ABCD":
        yield f"{name} = {_matrix(getattr(system, name))};"
    step = "" if system.sample_time_s is None else f", {_number(system.sample_time_s)}"
    names = {"st": system.states, "in": structure.inputs, "out": structure.outputs}
    octave = "".join(f", '{key}name', {_cells(value)}" for key, value in names.items() if value)
    words = {"State": system.states, "Input": structure.inputs, "Output": structure.outputs}
    matlab = "".join(f", '{key}Name', {_cells(value)}" for key, value in words.items() if value)
    if not own_delays(choices):
        yield from _branched(
            f"{model.name} = ss(A, B, C, D{step}{octave});", f"{model.name} = ss(A, B, C, D{step}{matlab});"
        )
    else:
        before, behind = input_output_delays(model.model.system)
        yield "% Of the delays in Octave, which has none of its own; 0 leaves them out."
        yield f"pade_order = {model.pade_order};"
        yield f"input_delay = {_matrix(before[:, None])};"
        yield f"output_delay = {_matrix(behind[:, None])};"
        late = ", 'InputDelay', input_delay, 'OutputDelay', output_delay"
        yield from _branched(
            f"{model.name} = ss(A, B, C, D{octave});\n" + _joined(model.name, structure),
            f"{model.name} = ss(A, B, C, D{late}{matlab});",
        )
    yield from _uncertain(model)
    yield from _measured(model)


def _branched(octave: str, matlab: str) -> list[str]:
    return [
        f"if {_OCTAVE}",
        *(f"  {line}" for line in octave.splitlines()),
        "else",
        *(f"  {line}" for line in matlab.splitlines()),
        "end",
    ]


def _joined(name: str, structure: LinearStructure) -> str:
    """Statements for Octave that put approximations of the delays before and behind a model."""
    return f"""for side = 1:2
  late = {{input_delay, output_delay}}{{side}};
  if pade_order > 0 && any(late > 0)
    parts = cell(1, numel(late));
    for k = 1:numel(late)
      parts{{k}} = ss(1);
      if late(k) > 0
        [num, den] = padecoef(late(k), pade_order);
        parts{{k}} = ss(tf(num, den));
      end
    end
    if side == 1
      {name} = {name} * append(parts{{:}});
    else
      {name} = append(parts{{:}}) * {name};
    end
    {name} = set({name}, 'inname', {_cells(structure.inputs)}, 'outname', {_cells(structure.outputs)});
  end
end"""


def _uncertain(model: NamedModel) -> list[str]:
    """The model with uncertain parameters, where its matrices are regular and its names are those of variables."""
    structure, parameters = model.model.structure, model.model.structure.parameters
    needed = _needed(structure)
    names = [name for name in (*parameters.names, *structure.constants) if name in needed]
    spread = {name: model.model.parameters[name].std for name in parameters.free if name in model.model.parameters}
    regular = len(model.plant.A) == len(structure.states)
    ties = {found.name: found.tied.names for found in parameters if found.tied is not None}
    if any(names & set(ties) for names in ties.values()):
        return []
    if not regular or not any(spread.values()) or not all(_PLAIN.fullmatch(name) for name in names):
        return []
    lines = ["% With uncertain parameters, without delays.", "if exist('ureal')"]
    lines += [f"  {name} = {_number(value)};" for name, value in structure.constants.items() if name in needed]
    own = [found for found in parameters if found.name in needed]
    for parameter in sorted(own, key=lambda found: found.tied is not None):
        std = spread.get(parameter.name)
        if parameter.tied is not None:
            lines.append(f"  {parameter.name} = {_expression(str(parameter.tied))};")
        elif std:
            half = _number(TWO_SIDED_95 * std)
            value = _number(parameters.values[parameter.name])
            lines.append(f"  {parameter.name} = ureal('{parameter.name}', {value}, 'PlusMinus', [-{half}, {half}]);")
        else:
            lines.append(f"  {parameter.name} = {_number(parameters.values[parameter.name])};")
    for matrix in ("M", "F", "G", "H0", "H1"):
        rows = ["[" + ", ".join(_expression(str(entry)) for entry in row) + "]" for row in getattr(structure, matrix)]
        lines.append(f"  {matrix} = [{'; '.join(rows)}];")
    lines.append(f"  {model.name}_uncertain = ss(M \\ F, M \\ G, H0 + H1 * (M \\ F), H1 * (M \\ G));")
    return [*lines, "end"]


def _needed(structure: LinearStructure) -> set[str]:
    """Names that stand in the matrices, and in the ties of those."""
    rows = [row for matrix in ("M", "F", "G", "H0", "H1") for row in getattr(structure, matrix)]
    names = {name for row in rows for entry in row for name in entry.names}
    while more := {
        name
        for found in structure.parameters
        if found.name in names and found.tied is not None
        for name in found.tied.names - names
    }:
        names |= more
    return names


def _expression(text: str) -> str:
    return text.replace("**", "^")


def _measured(model: NamedModel) -> list[str]:
    found = measured(model.model)
    if found is None:
        return []
    real, imag = found["real"], found["imag"]
    shape = " ".join(map(str, real.shape))
    name = f"{model.name[: LONGEST_NAME - 9]}_measured"
    # MATLAB counts along the first index first.
    return [
        f"H = reshape(complex({_row(real.ravel(order='F'))}, ...",
        f"  {_row(imag.ravel(order='F'))}), [{shape}]);",
        f"{name} = frd(H, {_row(found['omega_rad_s'])});",
    ]


def _row(values: FloatArray) -> str:
    """A long row of numbers, broken into lines."""
    texts = [f"{value:.9g}" for value in values.tolist()]
    lines = [" ".join(texts[i : i + _NUMBERS_A_LINE]) for i in range(0, len(texts), _NUMBERS_A_LINE)]
    return "[" + " ...\n  ".join(lines) + "]"


def _number(value: float) -> str:
    """A literal that is read as the same number."""
    return f"{value:.17g}"


def _matrix(values: FloatArray) -> str:
    if not values.size:
        return f"zeros({values.shape[0]}, {values.shape[1]})"
    return "[" + "; ".join(", ".join(_number(value) for value in row) for row in values.tolist()) + "]"


def _cells(names: Sequence[str]) -> str:
    quoted = ["'" + harmless(name).replace("'", "''") + "'" for name in names]
    return "{" + "; ".join(quoted) + "}"


# The .mat file


def _mat(models: Sequence[NamedModel], choices: ExportSettings) -> bytes:
    from scipy.io import savemat

    # It writes to files that are open too, which its types do not say.
    written: Any = io.BytesIO()
    savemat(written, {model.name: _struct(model, choices) for model in models}, oned_as="column", do_compression=True)
    raw: bytes = written.getvalue()
    # The text at the head would hold the hour, and two exports of one result would differ.
    return _HEADER.ljust(_HEADER_BYTES) + raw[_HEADER_BYTES:]


def _struct(item: NamedModel, choices: ExportSettings) -> Mapping[str, Any]:
    from rotorid import __version__

    model, own = item.model, own_delays(choices)
    system = item.plant if own else item.exported
    before, behind = input_output_delays(model.system)
    bounds = model.bounds
    values: dict[str, Any] = {name: np.array(getattr(system, name)) for name in "ABCD"}
    values |= {
        "sample_time": 0.0 if system.sample_time_s is None else system.sample_time_s,
        "input_delay": before if own else np.zeros_like(before),
        "output_delay": behind if own else np.zeros_like(behind),
        "state_names": _cell(system.states),
        "input_names": _cell(model.structure.inputs),
        "output_names": _cell(model.structure.outputs),
        "parameter_names": _cell(list(model.parameters)),
        "parameters": np.array([found.value for found in model.parameters.values()]),
        "parameter_units": _cell([found.unit for found in model.parameters.values()]),
        "covariance_names": _cell(bounds.names),
        "covariance": np.array(bounds.covariance),
        "band": np.array(item.band_rad_s),
        "meta": {
            "model": model.name,
            "logs": _cell([str(name).replace("\\", "/").split("/")[-1] for name in model.provenance.inputs]),
            "axes": "forward, right, down",
            "delays": "own" if own else choices.model_delay,
            "version": __version__,
        },
    }
    if (found := measured(model)) is not None:
        values |= {"measured": found["real"] + 1j * found["imag"], "measured_omega": found["omega_rad_s"]}
        values["measured_coherence"] = found["coherence"]
    return values


def _cell(names: Sequence[str]) -> np.ndarray[Any, np.dtype[np.object_]]:
    """Names as a cell array, which one name alone would not become."""
    cells = np.empty((len(names), 1), dtype=object)
    for row, name in enumerate(names):
        cells[row, 0] = name
    return cells
