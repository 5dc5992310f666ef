"""``rotorid mcp`` says on the error stream where the system cannot keep its commands inside folders."""

from __future__ import annotations

from pathlib import Path

import pytest

from rotorid.cli.mcp import mcp_command


@pytest.mark.parametrize("able", [True, False])
def test_a_system_without_confinement_is_named(
    able: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    served: list[object] = []
    monkeypatch.setattr("rotorid.io.confinement.can_confine_files", lambda: able)
    monkeypatch.setattr("rotorid.mcp.server.serve", served.append)
    mcp_command([tmp_path])
    told = capsys.readouterr()
    assert len(served) == 1
    assert not told.out
    assert ("cannot keep commands inside folders" in told.err) is not able
