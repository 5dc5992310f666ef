"""From numbers to documents: order, uniqueness, and what is null."""

from __future__ import annotations

import json
import math

import numpy as np

from rotorid.data.findings import Finding, worst_first
from rotorid.data.record import FlightRecord, Source
from rotorid.documents.base import FindingDocument, ProvenanceDocument
from rotorid.documents.result import ResultDocument, matrices_document
from rotorid.models.state_space import StateSpace
from rotorid.results.model import pole_estimates
from rotorid.results.provenance import provenance
from rotorid.results.summary import Checks, ParameterEstimate
from rotorid.settings.identifying import IdentifySettings
from rotorid.uncertainty.propagation import Pole
from rotorid.verification.verification import Scores


def finding(severity: str, message: str = "A remark.") -> Finding:
    return Finding(kind="gap", severity=severity, where="p", message=message, numbers={"gap_s": 0.5})  # type: ignore[arg-type]


def log(name: str, sha256: str) -> FlightRecord:
    return FlightRecord(source=Source(name=name, format="CSV", sha256=sha256), topics=())


def test_findings_come_worst_first_and_each_once() -> None:
    findings = [finding("info"), finding("warning", "First."), finding("error"), finding("info"), finding("warning")]
    documents = [FindingDocument.model_validate(finding) for finding in worst_first(findings)]
    assert [document.severity for document in documents] == ["error", "warning", "warning", "info"]
    assert [document.message for document in documents[1:3]] == ["First.", "A remark."]
    assert documents[0].numbers == {"gap_s": 0.5}


def test_logs_of_one_name_keep_their_own_hashes() -> None:
    records = [log("flight.csv", "a"), log("other.csv", "b"), log("flight.csv", "c"), log("flight.csv", "a")]
    found = provenance(records, IdentifySettings())
    assert found.inputs == {"flight.csv": "a", "other.csv": "b", "flight.csv (2)": "c"}


def test_matrices_and_poles_are_those_of_the_system() -> None:
    # s^2 + 2 zeta omega s + omega^2 with omega 5 and zeta 0.6, beside an integrator.
    system = StateSpace(
        M=np.eye(3),
        F=np.array([[0.0, 1.0, 0.0], [-25.0, -6.0, 0.0], [0.0, 0.0, 0.0]]),
        G=np.array([[0.0], [1.0], [1.0]]),
        H0=np.array([[1.0, 0.0, 0.0]]),
        H1=np.zeros((1, 3)),
        input_delays_s=np.array([0.01]),
        output_delays_s=np.array([0.0]),
    )
    document = matrices_document(system)
    assert document.F[1] == [-25.0, -6.0, 0.0]
    assert (document.delays_s.inputs, document.delays_s.outputs) == ([0.01], [0.0])
    integrator, *pair = pole_estimates([Pole(value=complex(value), covariance=None) for value in system.poles()])
    assert integrator.real_std is None
    assert (integrator.real, integrator.imag, integrator.damping, integrator.frequency_rad_s) == (0.0, 0.0, 0.0, 0.0)
    for pole in pair:
        np.testing.assert_allclose((pole.damping, pole.frequency_rad_s), (0.6, 5.0), rtol=1e-12)
    assert sorted(pole.imag for pole in pair) == [-math.sqrt(16.0), math.sqrt(16.0)]


def test_numbers_that_are_none_are_null() -> None:
    unsure = ParameterEstimate(value=1.0, unit="1/s", std=math.inf, status="free")
    score = Scores(nrmse_fit_percent=math.nan, tic=0.1, rms=0.1, bias=0.0, reference_shift=0.0)
    document = ResultDocument(
        model="rate.roll",
        inputs=[],
        outputs=[],
        states=[],
        parameters={"L_p": unsure},
        verification=Checks(records={"a.ulg": {"p": score}}),
        provenance=ProvenanceDocument.model_validate(provenance([], IdentifySettings())),
    )
    table = json.loads(document.model_dump_json())
    assert table["parameters"]["L_p"]["std"] is None
    assert table["verification"]["records"]["a.ulg"]["p"]["nrmse_fit_percent"] is None
