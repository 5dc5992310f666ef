"""What ``inspect`` says about every kind of log in the data folder, against what it said when a person looked.

A change that is meant is written down with ``python -m tests.golden.inspections``; no test does that.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tests.golden.inspections import GOLDEN, LOGS, facts

STAMPS_S = 0.02
"""Half of the last digit that is kept, and one sample of the slowest log."""


@pytest.mark.parametrize("log", LOGS)
def test_log_is_what_it_was(log: str, shared_data: Path) -> None:
    known = json.loads(GOLDEN.read_text(encoding="utf-8"))[log]
    seen = facts(log, shared_data)
    for part in ("excitations", "candidates"):
        seen_ones, known_ones = ([item.split() for item in summary.pop(part)] for summary in (seen, known))
        assert [item[:2] for item in seen_ones] == [item[:2] for item in known_ones]
        for one, other in zip(seen_ones, known_ones, strict=True):
            assert [float(stamp) for stamp in one[2:]] == pytest.approx([float(s) for s in other[2:]], abs=STAMPS_S)
    assert seen == known


def test_nothing_is_frozen_that_is_not_looked_at() -> None:
    assert set(json.loads(GOLDEN.read_text(encoding="utf-8"))) == set(LOGS)
