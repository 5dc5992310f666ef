"""Models with known numbers, as results hold them: one response with a delay, and six with several."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rotorid.data.response import FrequencyResponse
from rotorid.documents.base import ProvenanceDocument
from rotorid.documents.result import ResultDocument, identified_model
from rotorid.flying.vehicle_from_results import JoinedVehicle, joined_vehicle
from rotorid.models.expression import Expression
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.structure import LinearStructure, Row, Rows
from rotorid.results.model import IdentifiedModel
from rotorid.results.summary import Correlation, ParameterEstimate

OMEGA = np.geomspace(1.0, 50.0, 25)
"""Up to the end of the usual band."""


def _rows(*texts: str) -> Rows:
    return tuple(_row(text) for text in texts)


def _row(text: str) -> Row:
    return tuple(Expression.parse(entry) for entry in text.split())


def _structure(name: str, **parts: object) -> LinearStructure:
    return LinearStructure(name=name, **parts)  # type: ignore[arg-type]


ROLL = _structure(
    "rate.roll",
    inputs=("roll_command",),
    states=("p", "motor"),
    outputs=("p",),
    M=_rows("1 0", "0 T_motor"),
    F=_rows("L_p L_roll", "0 -1"),
    G=_rows("0", "1"),
    H0=_rows("1 0"),
    H1=_rows("0 0"),
    input_delays=_row("tau_roll"),
    output_delays=_row("0"),
    parameters=ParameterSet(
        [
            Parameter(name="L_roll", value=110.0, unit="rad/s^2"),
            Parameter(name="L_p", value=-1.1, unit="1/s"),
            Parameter(name="T_motor", value=0.045, unit="s"),
            Parameter(name="tau_roll", value=0.009, unit="s"),
        ]
    ),
)

HOVER = _structure(
    "hover.two",
    inputs=("pitch_command", "thrust_command"),
    states=("u", "q", "theta", "w"),
    outputs=("q", "ax", "az"),
    M=_rows("1 0 0 0", "0 1 0 0", "0 0 1 0", "0 0 0 1"),
    F=_rows("X_u 0 -g 0", "M_u M_q 0 0", "0 1 0 0", "0 0 0 2*X_u"),
    G=_rows("0 0", "M_pitch 0", "0 0", "0.3 -9"),
    H0=_rows("0 1 0 0", "0 0 g 0", "0 0 0 0"),
    H1=_rows("0 0 0 0", "1 0 0 0", "0 0 0 1"),
    input_delays=_row("tau 0.004"),
    output_delays=_row("0.002 tau_a tau_a"),
    parameters=ParameterSet(
        [
            Parameter(name="X_u", value=-0.3, unit="1/s"),
            Parameter(name="M_u", value=0.8, unit="rad/(m s)"),
            Parameter(name="M_q", value=-1.4, unit="1/s"),
            Parameter(name="M_pitch", value=60.0, unit="rad/s^2"),
            Parameter(name="tau", value=0.011, unit="s"),
            Parameter(name="tau_a", value=0.007, unit="s"),
        ]
    ),
    constants={"g": 9.80665},
)


def model(structure: LinearStructure, *, name: str = "", responses: bool = True) -> IdentifiedModel:
    """A result, every value known to one percent, with the model's own response as the measured one."""
    values = structure.parameters
    parameters = {
        one.name: ParameterEstimate(value=one.value, unit=one.unit, std=0.01 * abs(one.value), status="free")
        for one in values
    }
    size = len(parameters)
    document = ResultDocument(
        model=name or structure.name,
        inputs=list(structure.inputs),
        outputs=list(structure.outputs),
        states=list(structure.states),
        parameters=parameters,
        correlation=Correlation(names=tuple(parameters), matrix=tuple(map(tuple, np.eye(size).tolist()))),
        provenance=ProvenanceDocument(version="0", command=[], inputs={"a/roll.ulg": "0" * 64}, settings={}, seed=0),
    )
    found = identified_model(document, None)
    if responses:
        response = structure.response(values.values, OMEGA)
        measured = FrequencyResponse(
            omega_rad_s=OMEGA,
            values=response,
            coherence=np.full(response.shape, 0.9),
            random_error=np.full(response.shape, 0.05),
            covariance=np.zeros((*response.shape, OMEGA.size), dtype=np.complex128),
            inputs=structure.inputs,
            outputs=structure.outputs,
            estimate="direct",
        )
        found = replace(found, data=replace(found.data, response=measured))
    return replace(found, structure=replace(structure, name=name or structure.name))


def vehicle(*models: IdentifiedModel) -> JoinedVehicle:
    """What is exported: nothing but models."""
    return joined_vehicle(list(models) or [model(ROLL), model(HOVER)])
