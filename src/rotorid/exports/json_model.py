"""The models themselves as JSON, with their covariance, for tools that have no format of their own here.

Schema ``rotorid.models/1``: numbers of the vehicle as far as they are known, and of every model parameters, covariance,
matrices with exact delays, and a state space without delays, continuous or sampled.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rotorid.errors import ModelError, UsageError
from rotorid.exports.settings import ExportSettings
from rotorid.exports.state_space import NamedModel, air_words, kept_delays, named_model, pade_words
from rotorid.exports.target import Compared, Exported

if TYPE_CHECKING:
    from rotorid.documents.export import StateSpaceDocument
    from rotorid.flying.vehicle_from_results import JoinedVehicle
    from rotorid.models.state_space import StateSpace
    from rotorid.results.model import IdentifiedModel

NAME = "json"

_DELAYS: Mapping[str, str] = {
    "none": "is without delays (--no-delay)",
    "states": "has delays as states",
    "lag": "has delays as lags",
}


def export(vehicle: JoinedVehicle, choices: ExportSettings) -> Exported:
    """One JSON file.

    Parameters
    ----------
    vehicle
        What results say; of unknown scale too.
    choices
        What becomes of the delays in the state space, and its rate. Beside the matrices they stand exactly.

    Raises
    ------
    UsageError
        There is no model, or two have one name.
    """
    from rotorid.documents.base import to_json
    from rotorid.documents.export import model_document, models_document

    names = [model.name for model in vehicle.models]
    if not names or len(set(names)) < len(names):
        raise UsageError(
            "no model to export" if not names else f"two results of {max(names, key=names.count)}",
            needed="results of different models",
        )
    proper = [_proper(model, choices) for model in vehicle.models]
    documents = [
        model_document(model, None if item is None else _state_space(item))
        for model, item in zip(vehicle.models, proper, strict=True)
    ]
    text = to_json(models_document(vehicle, documents))
    named = [item for item in proper if item is not None]
    improper = [name for name, item in zip(names, proper, strict=True) if item is None]
    approximated = choices.model_delay == "states" and choices.sample_rate_hz is None
    return Exported(
        target=NAME,
        files={f"{choices.names}.json": text},
        compared=tuple(_compared(vehicle.models, json.loads(text))),
        left_out=(
            f"The state space {_DELAYS[choices.model_delay]}; delays_s has the exact values.",
            *(pade_words(named) if approximated else ()),
            *(f"{name} has no proper state space; only its matrices are exported." for name in improper),
            *air_words(vehicle.models),
        ),
        start=f"import json; models = json.load(open('{choices.names}.json'))['models']",
        delays=kept_delays(named, choices),
    )


def _proper(model: IdentifiedModel, choices: ExportSettings) -> NamedModel | None:
    """A model with its state space; ``None`` where it has no proper one."""
    try:
        return named_model(model, choices)
    except ModelError:
        return None


def _state_space(item: NamedModel) -> StateSpaceDocument:
    from rotorid.documents.export import StateSpaceDocument

    found = item.exported
    return StateSpaceDocument(
        sample_time_s=found.sample_time_s,
        states=list(found.states),
        **{name: getattr(found, name).tolist() for name in "ABCD"},
    )


def _compared(models: Sequence[IdentifiedModel], written: Mapping[str, Any]) -> list[Compared]:
    """Gain and delay of each model as the file has them."""
    rows = []
    for model, document in zip(models, written["models"], strict=True):
        was, now = model.system, _read(document["matrices"])
        for name, of, unit in (("gain at 1 rad/s", _gain, "1"), ("longest delay", _delay, "s")):
            rows.append(
                Compared(name=f"{model.name}: {name}", unit=unit, identified=of(was), exported=of(now), held="exact")
            )
    return rows


def _read(matrices: Mapping[str, Any]) -> StateSpace:
    from rotorid.models.state_space import StateSpace

    return StateSpace(
        **{name: np.array(matrices[name], dtype=np.float64) for name in ("M", "F", "G", "H0", "H1")},
        input_delays_s=np.array(matrices["delays_s"]["inputs"]),
        output_delays_s=np.array(matrices["delays_s"]["outputs"]),
    )


def _gain(system: StateSpace) -> float:
    """Largest gain at 1 rad/s."""
    return float(np.abs(system.response(np.array([1.0]))).max(initial=0.0))


def _delay(system: StateSpace) -> float:
    """Of the response with the longest."""
    return float(np.add.outer(system.output_delays_s, system.input_delays_s).max(initial=-np.inf))
