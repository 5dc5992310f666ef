"""A remark is printed once: what several models share, and a reason that another remark names."""

from __future__ import annotations

import pytest
from tests.unit.flying.test_vehicle_from_results import result

from rotorid.cli.console import print_findings
from rotorid.cli.identify import _shared
from rotorid.data.findings import refusal, warn
from rotorid.documents.base import FindingDocument
from rotorid.documents.result import ResultDocument, result_document


def with_findings(name: str, *messages: str) -> ResultDocument:
    findings = [
        FindingDocument(kind="not_verified", severity="warning", where="p", message=one, numbers={}) for one in messages
    ]
    return result_document(result(name, {"L_p": -1.0})).model_copy(update={"findings": findings})


def test_what_several_models_share_is_one_remark() -> None:
    shared = _shared([with_findings("rate.roll", "All.", "Roll."), with_findings("rate.pitch", "All.", "Pitch.")])
    assert [one.message for one in shared] == ["All."]


def test_a_reason_is_not_printed_beside_what_follows_from_it(capsys: pytest.CaptureFixture[str]) -> None:
    why = "The log has no excitation of yaw."
    print_findings([refusal("no_excitation", "yaw", why), warn("not_tuned", "yaw", f"The gains of yaw stay: {why}")])
    out = capsys.readouterr().out
    assert "not_tuned" in out
    assert "no_excitation" not in out
