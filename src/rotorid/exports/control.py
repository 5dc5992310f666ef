"""python-control: a script that makes the models, and the responses that they were fitted to.

It needs NumPy and python-control. Numbers are written so that they are read as the same ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from rotorid.exports.settings import ExportSettings
from rotorid.exports.state_space import (
    NamedModel,
    air_words,
    compared_models,
    delay_words,
    description,
    early,
    headed,
    kept_delays,
    measured,
    named_models,
)
from rotorid.exports.target import Exported
from rotorid.typing import FloatArray

if TYPE_CHECKING:
    from rotorid.flying.vehicle_from_results import JoinedVehicle

NAME = "control"


def export(vehicle: JoinedVehicle, choices: ExportSettings) -> Exported:
    """A Python file with a system for each model.

    Parameters
    ----------
    vehicle
        With the models that it was joined from; of unknown scale too.
    choices
        Delays as states, as lags or left out; the rate of sampled systems.

    Raises
    ------
    UsageError
        There is no model, or two would have one name.
    ModelError
        A model has no proper state space.
    """
    models = named_models(vehicle, choices)
    rows = compared_models(models, choices)
    sentences = [*delay_words(models, choices), *air_words(vehicle.models)]
    file, first = f"{choices.names}_control.py", models[0].name
    title = f"{choices.names}: identified models for python-control, by rotorid"
    return Exported(
        target=NAME,
        files={file: _script(models, headed(title, rows, sentences))},
        compared=rows,
        left_out=tuple(sentences),
        start=(
            f"import control\nfrom {choices.names}_control import {first}\n"
            f"control.bode_plot({first}); print(control.stability_margins({first}[0, 0]))"
        ),
        findings=early(models),
        delays=kept_delays(models, choices),
    )


def _script(models: Sequence[NamedModel], head: Sequence[str]) -> str:
    table = "\n".join(line.rstrip() for line in head)
    blocks = [f'"""{table}\n"""', "import control\nimport numpy as np", *(_system(model) for model in models)]
    return "\n\n".join(blocks) + "\n"


def _system(model: NamedModel) -> str:
    """Statements that make a model, and what was measured of it."""
    system, structure = model.exported, model.model.structure
    step = 0 if system.sample_time_s is None else repr(system.sample_time_s)
    matrices = ",\n".join(f"    {_array(getattr(system, name))}" for name in "ABCD")
    lines = [
        *(f"# {line}".rstrip() for line in description(model)),
        f"{model.name} = control.ss(",
        f"{matrices},",
        f"    {step},",
        f"    inputs={list(structure.inputs)!r},",
        f"    outputs={list(structure.outputs)!r},",
        *([f"    states={list(system.states)!r},"] if system.states else []),
        f"    name={model.name!r},",
        ")",
        f"{model.name}_delays_s = {_array(model.delays_s)}  # of each response, as identified",
    ]
    found = measured(model.model)
    if found is not None:
        lines += [
            "",
            "# As measured: the response, and the coherence of each of its points.",
            f"{model.name}_measured = control.frd(",
            f"    {_array(found['real'], 9)}",
            f"    + 1j * {_array(found['imag'], 9)},",
            f"    {_array(found['omega_rad_s'])},",
            ")",
            f"{model.name}_coherence = {_array(found['coherence'], 4)}",
        ]
    return "\n".join(lines)


def _array(values: FloatArray, digits: int = 17) -> str:
    """An array as Python has it; one without elements by its shape."""
    if not values.size:
        return f"np.zeros({tuple(values.shape)!r})"

    def nested(part: FloatArray) -> str:
        if part.ndim == 0:
            return f"{float(part):.{digits}g}"
        return "[" + ", ".join(nested(np.asarray(row)) for row in part) + "]"

    return f"np.array({nested(values)}, dtype=float)"
