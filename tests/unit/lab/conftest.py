"""Labs of these tests copy one process, which has no memory of a session."""

from __future__ import annotations

import pytest
from tests.copies import kept

from rotorid.lab import workers


@pytest.fixture(autouse=True)
def _one_program(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "Program", kept)
