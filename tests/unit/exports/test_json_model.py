"""Models as JSON: strict, with covariance, and the same responses when read back."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.unit.flying.test_vehicle_from_results import motors

from rotorid.errors import UsageError
from rotorid.exports import Exported, ExportSettings, export
from rotorid.models.library import rate_model
from rotorid.results.model import IdentifiedModel

OMEGA = np.geomspace(0.5, 60.0, 20)


@pytest.fixture(scope="module")
def model() -> IdentifiedModel:
    """A rate model with a lag and a delay, whose equations are known; its errors do not matter here."""
    structure = rate_model("rate.roll")
    values = {"L_p": -2.0, "L_roll": 120.0, "T_motor": 0.04, "tau_roll": 0.006}
    known = {name: value for name, value in values.items() if name in structure.parameters.names}
    return replace(
        motors(), structure=replace(structure, parameters=structure.parameters.with_values(known)), motors=None
    )


def written(exported: Exported) -> Any:
    (text,) = exported.files.values()
    return json.loads(text)["models"][0]


def response(document: Any, omega: np.ndarray) -> np.ndarray:
    """Of the matrices and delays in the file."""
    m = {name: np.array(value) for name, value in document["matrices"].items() if name != "delays_s"}
    delays = document["matrices"]["delays_s"]
    found = []
    for w in omega:
        states = np.linalg.solve(1j * w * m["M"] - m["F"], m["G"])
        late = np.add.outer(delays["outputs"], delays["inputs"])
        found.append((m["H0"] + 1j * w * m["H1"]) @ states * np.exp(-1j * w * late))
    return np.moveaxis(np.array(found), 0, -1)


def test_the_matrices_answer_as_the_model(model: IdentifiedModel) -> None:
    document = written(export(model, "json"))
    assert response(document, OMEGA) == pytest.approx(model.response(OMEGA), rel=1e-12)
    assert document["covariance"]["names"] == list(model.bounds.names)
    assert np.array(document["covariance"]["matrix"]) == pytest.approx(model.bounds.covariance)
    assert document["parameters"]["I_xx"]["status"] == "free"


@pytest.mark.parametrize("rate_hz", [None, 250.0])
def test_the_state_space_is_continuous_or_sampled(model: IdentifiedModel, rate_hz: float | None) -> None:
    space = written(export(model, "json", ExportSettings(sample_rate_hz=rate_hz)))["state_space"]
    A, B, C, D = (np.array(space[name]) for name in "ABCD")
    assert space["sample_time_s"] == (None if rate_hz is None else pytest.approx(0.004))
    # Both have the gain of the model at rest, delays or none.
    at = -A if rate_hz is None else np.eye(len(A)) - A
    assert C @ np.linalg.solve(at, B) + D == pytest.approx(np.real(model.response([1e-6])[..., 0]), rel=1e-6)


def test_what_becomes_of_delays_is_said(model: IdentifiedModel) -> None:
    left_out, states = (
        export(model, "json", choices)
        for choices in (ExportSettings(delay="none"), ExportSettings(delay="states", pade_order=2))
    )
    assert "state space is without delays" in left_out.left_out[0]
    assert "delays as states" in states.left_out[0]
    count = len(written(left_out)["state_space"]["A"])
    assert len(written(states)["state_space"]["A"]) == count + 2
    assert export(model, "json").delays["rate.roll"].kept == "states"


def test_two_of_one_name_are_refused(model: IdentifiedModel) -> None:
    with pytest.raises(UsageError, match=r"two results of rate\.roll"):
        export([model, model], "json", given={"I_xx": 0.02})
    with pytest.raises(UsageError, match="no model to export"):
        export([], "json")
