"""What is believed of a vehicle before the flight that is being planned: its library entry, or a previous result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from rotorid.data.channel import AXES
from rotorid.data.immutable import Immutable
from rotorid.design.loop import LoopModel, Responds
from rotorid.errors import ModelError, UsageError
from rotorid.models.description import from_toml
from rotorid.models.structure import LinearStructure
from rotorid.pipeline.document import ResultDocument
from rotorid.pipeline.simulation import truth_of
from rotorid.signal.known_filter import butterworth_low_pass
from rotorid.simulate.multirotor_flight import Aircraft
from rotorid.typing import ComplexArray, FloatArray

_LARGEST_FILE = 100_000_000
_SHORTEST_LAG_S = 0.005
"""Where a fit of a motor without lag begins; it drops the lag where the data have none."""


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
    """

    structure: LinearStructure
    values: Mapping[str, float]
    source: str

    def __post_init__(self) -> None:
        self._set(values=self.values)


def read_prior(path: Path) -> Prior:
    """A previous result: a ``result.json``, beside which ``model.toml`` holds its structure, or the folder of both.

    Raises
    ------
    UsageError
        A file is missing or no result.
    ModelError
        The model has no linear structure, or holds one that the design cannot use.
    """
    file = path / "result.json" if path.is_dir() else path
    try:
        if file.stat().st_size > _LARGEST_FILE:
            raise UsageError(f"{file} has {file.stat().st_size} bytes", needed=f"a result of at most {_LARGEST_FILE}")
        document = ResultDocument.model_validate_json(file.read_bytes())
        text = file.with_name("model.toml").read_text(encoding="utf-8")
    except OSError as error:
        raise UsageError(
            f"{error.filename} cannot be read: {error.strerror}",
            needed="the result.json of an identification, with its model.toml beside it",
        ) from error
    except ValidationError as error:
        raise UsageError(f"{file} is no result of an identification", needed="a result.json") from error
    structure = from_toml(text, where=str(file.with_name("model.toml")))
    values = {name: one.value for name, one in document.parameters.items()}
    return Prior(structure=structure, values=values, source=file.as_posix())


def expected_values(model: LinearStructure, craft: Aircraft, prior: Prior | None = None) -> dict[str, float]:
    """Values of the free parameters of a model: those of the previous result, else those of the aircraft.

    Raises
    ------
    ModelError
        Neither knows a parameter.
    """
    known = {name: one.value for name, one in truth_of(craft).items()}
    known["T_motor"] = max(known["T_motor"], _SHORTEST_LAG_S)
    known |= {f"tau_{axis}": known[f"tau_{axis}"] + filtered_s(craft, axis) for axis in AXES}
    known |= dict(prior.values) if prior is not None else {}
    if missing := [name for name in model.parameters.free if name not in known]:
        raise ModelError(
            f"{model.name} has the parameters {', '.join(missing)}, of which {craft.name} has no value",
            needed="a model of derivatives: rate.*, hover.*, or that of a previous result",
            remedy="give the result of an earlier flight with --prior",
        )
    return {name: _inside(model, name, known[name]) for name in model.parameters.free}


def filtered_s(craft: Aircraft, axis: str) -> float:
    """How late the log shows the motion of an axis: the autopilot's filters, or the mean over a turn of its loop."""
    autopilot = craft.autopilot
    if autopilot.kind == "ardupilot":
        # The force of rotors without lag does not change in a turn, so that its mean is not late.
        even = axis == "thrust" and not craft.vehicle.rotors.lag_up_s
        return 0.0 if even else 0.5 / autopilot.rate_hz
    cutoff_hz = autopilot.accelerometer_cutoff_hz if axis == "thrust" else autopilot.gyro_cutoff_hz
    lag_s = craft.sensors.accelerometer_lag_s if axis == "thrust" else craft.sensors.gyro_lag_s
    return lag_s + (butterworth_low_pass(cutoff_hz, autopilot.rate_hz).delay_s if cutoff_hz > 0.0 else 0.0)


def _inside(model: LinearStructure, name: str, value: float) -> float:
    parameter = model.parameters[name]
    return float(np.clip(value, parameter.lower, parameter.upper))


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
