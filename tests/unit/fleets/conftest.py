"""Fleets of these tests copy one process, which has no memory of a fleet."""

from __future__ import annotations

import pytest
from tests.copies import kept

from rotorid.fleets import engines


@pytest.fixture(autouse=True)
def _one_program(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engines, "Program", kept)
