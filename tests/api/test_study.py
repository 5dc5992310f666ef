"""Long studies go on where they ended, and nothing that changed counts as passed."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

from tests.study import Passed, fingerprint, kept, left


def test_a_change_of_any_file_is_another_fingerprint(tmp_path: Path) -> None:
    one, two = tmp_path / "one.py", tmp_path / "two.py"
    one.write_text("a = 1\n")
    two.write_text("b = 2\n")
    before = fingerprint([one, two])
    assert fingerprint([two, one]) == before
    two.write_text("b = 3\n")
    assert fingerprint([one, two]) != before


def test_parts_that_passed_as_they_are_are_not_run_again() -> None:
    passed = [Passed("a", "same", 1.0), Passed("b", "before", 1.0)]
    assert left(["a", "b", "new"], passed, dict.fromkeys(("a", "b", "new"), "same")) == ["new", "b"]


def test_the_last_run_of_a_part_counts(tmp_path: Path) -> None:
    file = tmp_path / "study.jsonl"
    assert kept(file) == []
    runs = [Passed("a", "old", 1.0), Passed("a", "new", 2.0)]
    file.write_text("".join(json.dumps(asdict(run)) + "\n" for run in runs))
    assert left(["a"], kept(file), {"a": "new"}) == []
    assert left(["a"], kept(file), {"a": "old"}) == ["a"]
