"""What is believed of a vehicle before its flight, of a previous result: its answers over those of the library."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from rotorid.data.base import Immutable
from rotorid.errors import UsageError
from rotorid.io.documents import MOST_JSON_BYTES, parse_json, read_text
from rotorid.models.structure import LinearStructure
from rotorid.models.toml import from_toml
from rotorid.planning.loop import LoopModel, Responds
from rotorid.typing import ComplexArray, FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Prior(Immutable):
    """A model from a previous flight.

    Parameters
    ----------
    structure
        What was identified.
    values
        Its parameters.
    source
        File that it came from.
    model_error
        Relative model error that it states of each response ``output/input``.
    std_model
        Standard deviation of model error that it states of each parameter.
    place
        Path by which it was read; empty where it was not.
    """

    structure: LinearStructure
    values: Mapping[str, float]
    source: str
    model_error: Mapping[str, float] = field(default_factory=dict)
    std_model: Mapping[str, float] = field(default_factory=dict)
    place: str = ""

    def __post_init__(self) -> None:
        self._set(values=self.values, model_error=self.model_error, std_model=self.std_model)


def read_prior(path: Path) -> Prior:
    """A previous result: a ``result.json``, beside which ``model.toml`` holds its structure, or the folder of both.

    Parameters
    ----------
    path
        One of these.

    Raises
    ------
    UsageError
        A file is missing or no result.
    ModelError
        The model has no linear structure, or holds one that the design cannot use.
    """
    file = path / "result.json" if path.is_dir() else path
    needed = "the result.json of an identification, with model.toml in the same folder"
    content = read_text(file, needed=needed, most_bytes=MOST_JSON_BYTES)
    text = read_text(file.with_name("model.toml"), needed=needed)
    try:
        known = _known(content)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise UsageError(f"{file} is not a result of an identification", needed="a result.json") from error
    structure = from_toml(text, where=str(file.with_name("model.toml")))
    # The folder's name, without its path, distinguishes results.
    return Prior(structure=structure, source="/".join(file.resolve().parts[-2:]), place=str(path), **known)


def _known(content: str) -> dict[str, dict[str, float]]:
    """Values of the parameters of a ``result.json``, and the model error of its responses and parameters."""
    result = parse_json(content)
    if result["schema"] != "rotorid.result/1":
        raise ValueError(f"the schema {result['schema']}")
    missed, parameters = (result.get("fit") or {}).get("model_error") or {}, result["parameters"]
    return {
        "values": {name: float(parameter["value"]) for name, parameter in parameters.items()},
        "model_error": {name: float(size) for name, size in missed.items()},
        "std_model": {
            name: float(parameter["std_model"]) for name, parameter in parameters.items() if parameter.get("std_model")
        },
    }


def with_prior(loop: LoopModel, prior: Prior) -> LoopModel:
    """The loop of an aircraft whose answers to commands are those of a previous result, as far as it has them.

    Everything else (controllers, noise, gusts, and what the result has no answer for) stays that of the aircraft, each
    answer in proportion to the rate of its axis.
    """
    shared = [name for name in prior.structure.inputs if name in loop.inputs]
    if not shared or not any(name in loop.outputs for name in prior.structure.outputs):
        raise UsageError(
            f"{prior.source} leads from {', '.join(prior.structure.inputs)} to {', '.join(prior.structure.outputs)}",
            needed=f"commands and outputs of {loop.name}: {', '.join((*loop.inputs, *loop.outputs))}",
            remedy="plan with a result that begins at the motors as --vehicle"
            if any(name.startswith("motor_") for name in prior.structure.inputs)
            else "",
        )
    return replace(loop, plant=_Overlaid(loop=loop, prior=prior, base=loop.plant))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Overlaid:
    """Outputs by commands, those of a previous result put over those of an aircraft."""

    loop: LoopModel
    prior: Prior
    base: Responds

    def response(self, omega_rad_s: FloatArray) -> ComplexArray:
        plant = self.base.response(omega_rad_s).copy()
        structure = self.prior.structure
        found = structure.matrices(dict(self.prior.values)).response(omega_rad_s)
        for u, command in enumerate(structure.inputs):
            if command not in self.loop.inputs:
                continue
            column = self.loop.inputs.index(command)
            own = _own_output(command)
            if own in structure.outputs:
                # Angles, speeds and accelerations follow the rate.
                ratio = found[structure.outputs.index(own), u] / plant[self.loop.outputs.index(own), column]
                plant[:, column] *= ratio
            for y, output in enumerate(structure.outputs):
                if output in self.loop.outputs:
                    plant[self.loop.outputs.index(output), column] = found[y, u]
        return plant


def _own_output(command: str) -> str:
    own = {"roll_command": "p", "pitch_command": "q", "yaw_command": "r", "thrust_command": "az"}
    return own.get(command, "")
