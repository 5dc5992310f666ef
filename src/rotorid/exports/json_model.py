"""The models themselves as JSON, with their covariance, for tools that have no format of their own here.

Schema ``rotorid.models/1``: numbers of the vehicle as far as they are known, and of every model parameters, covariance,
matrices with exact delays, and the state space without them, continuous or sampled with held inputs.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np

from rotorid.errors import ModelError, UsageError
from rotorid.exports.target import Compared, ExportChoices, Exported
from rotorid.typing import FloatArray

if TYPE_CHECKING:
    from rotorid.documents.export import StateSpaceDocument
    from rotorid.models.state_space import StateSpace
    from rotorid.pipeline.joined import JoinedVehicle
    from rotorid.pipeline.results import IdentifiedModel

NAME = "json"


def export(vehicle: JoinedVehicle, choices: ExportChoices) -> Exported:
    """One JSON file.

    Parameters
    ----------
    vehicle
        What results say; of unknown scale too.
    choices
        The rate of a sampled state space. Delays stand beside the matrices, exactly.

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
            "no result came" if not names else f"two results of {max(names, key=names.count)} came",
            needed="results with models of different names",
        )
    late = [model.name for model in vehicle.models if _proper(model.system) is None]
    documents = [model_document(model, _state_space(model.system, choices)) for model in vehicle.models]
    text = to_json(models_document(vehicle, documents))
    return Exported(
        target=NAME,
        files={f"{choices.names}.json": text},
        compared=tuple(_compared(vehicle.models, json.loads(text))),
        left_out=(
            "Delays stand beside the matrices and are exact; the state space has none.",
            *(f"{name} has no state space: an output follows a state without a lag." for name in late),
        ),
        start=f"import json; models = json.load(open('{choices.names}.json'))['models']",
    )


def _proper(system: StateSpace) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray] | None:
    try:
        return system.proper()
    except ModelError:
        return None


def _state_space(system: StateSpace, choices: ExportChoices) -> StateSpaceDocument | None:
    from scipy.linalg import expm

    from rotorid.documents.export import StateSpaceDocument

    found = _proper(system)
    if found is None:
        return None
    A, B, C, D = found
    step_s = None if choices.sample_rate_hz is None else 1.0 / choices.sample_rate_hz
    if step_s is not None:
        # Exact for held inputs: the exponential of the system with its inputs as constant states.
        count = len(A)
        both = np.zeros((count + B.shape[1],) * 2)
        both[:count] = np.hstack([A, B])
        step = expm(step_s * both)
        A, B = step[:count, :count], step[:count, count:]
    return StateSpaceDocument(sample_time_s=step_s, A=A.tolist(), B=B.tolist(), C=C.tolist(), D=D.tolist())


def _compared(models: tuple[IdentifiedModel, ...], written: dict[str, list[dict[str, object]]]) -> list[Compared]:
    """Poles and delays as the file has them: slowest pole, fastest pole, largest delay of each model."""
    rows = []
    for model, document in zip(models, written["models"], strict=True):
        was, now = model.system, _read(document["matrices"])
        values = {
            "gain at 1 rad/s": (_gain(was), _gain(now), "1"),
            "largest delay": (_delay(was), _delay(now), "s"),
        }
        rows += [
            Compared(name=f"{model.name}: {name}", unit=unit, identified=a, exported=b, held="exact")
            for name, (a, b, unit) in values.items()
        ]
    return rows


def _read(matrices: object) -> StateSpace:
    from rotorid.models.state_space import StateSpace

    assert isinstance(matrices, dict)
    delays = matrices["delays_s"]
    return StateSpace(
        **{name: np.array(matrices[name], dtype=np.float64) for name in ("M", "F", "G", "H0", "H1")},
        input_delays_s=np.array(delays["inputs"]),
        output_delays_s=np.array(delays["outputs"]),
    )


def _gain(system: StateSpace) -> float:
    """Largest gain at 1 rad/s."""
    return float(np.abs(system.response(np.array([1.0]))).max(initial=0.0))


def _delay(system: StateSpace) -> float:
    return float(max(system.input_delays_s.max(initial=0.0), system.output_delays_s.max(initial=0.0)))
