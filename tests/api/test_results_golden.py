"""What commands answer on real logs, number by number, against what they answered when a person looked.

A change that is meant is written down with ``python -m tests.golden.results --write``, and by no test; what changed,
case by case, says ``--compare``. Cases that would take more than a minute together are marked as slow.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tests.golden.results import CASES, GOLDEN, Json, compared, differences, kept, known, run, written


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the results, which some commands read."""
    return tmp_path_factory.mktemp("golden")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if case.slow else name for name, case in CASES.items()]
)
def test_answer_is_what_it_was(name: str, shared_data: Path, work: Path) -> None:
    found = differences(known()[name], run(name, shared_data, work))
    assert not found, "\n".join(str(difference) for difference in found)


def test_nothing_is_frozen_that_is_not_looked_at() -> None:
    assert set(known()) == set(CASES)


def test_nothing_is_frozen_that_belongs_to_one_machine(shared_data: Path) -> None:
    text = GOLDEN.read_text(encoding="utf-8")
    assert str(shared_data) not in text
    assert all("version" not in answer["result"]["provenance"] for answer in known().values())


def parameter(**changes: Json) -> dict[str, Json]:
    whole = {"value": -2.0, "std": 40.0, "cramer_rao_percent": 50.0, "unit": "1/s", "points": 98}
    return {"parameters": {"L_p": whole | changes}, "findings": [{"kind": "gap", "severity": "info"}]}


@pytest.mark.parametrize(
    "changes",
    [
        {"value": -2.0 + 3e-5},  # a millionth of the standard deviation, 4e-5
        {"std": 40.0 * (1.0 + 9e-7)},
        {"cramer_rao_percent": 50.0 * (1.0 + 1.9e-5)},  # as much as the value, of which it is a percentage
    ],
    ids=str,
)
def test_rounding_is_no_difference(changes: dict[str, Json]) -> None:
    assert differences(parameter(), parameter(**changes)) == []


@pytest.mark.parametrize(
    ("changes", "where"),
    [
        ({"value": -2.0 + 5e-5}, "/parameters/L_p/value"),
        ({"std": 40.0 * (1.0 + 2e-6)}, "/parameters/L_p/std"),
        ({"std": None}, "/parameters/L_p/std"),
        ({"unit": "rad/s"}, "/parameters/L_p/unit"),
        ({"points": 97}, "/parameters/L_p/points"),
        ({"lower": -80.0}, "/parameters/L_p/lower"),
    ],
    ids=str,
)
def test_anything_else_is_a_difference(changes: dict[str, Json], where: str) -> None:
    (found,) = differences(parameter(), parameter(**changes))
    assert found.where == where


def test_findings_count_in_their_order() -> None:
    gap, skew = ({"kind": kind, "message": "-"} for kind in ("gap", "clock_skew"))
    (found,) = differences([gap, skew], [skew, gap])
    assert (found.before, found.after) == (["gap", "clock_skew"], ["clock_skew", "gap"])


def test_numbers_of_a_list_are_judged_by_its_largest() -> None:
    before, after = {"matrix": [[1.0, 1e-13], [0.0, 1.0]]}, {"matrix": [[1.0, 3e-13], [-1e-9, 1.0]]}
    assert differences(before, after) == []
    assert max(found.tolerances for found in compared(before, after)) == pytest.approx(1e-3)


def test_what_is_kept_is_rounded_and_short_and_reads_back() -> None:
    provenance = {"version": "1", "command": ["rotorid"], "inputs": {"a.csv": "12ab", "b/result.json": "34cd"}}
    found = kept({"provenance": provenance, "trace": [1.0 / 3.0] * 100, "value": 2.0 / 3.0, "names": ["p"] * 100})
    third = 0.33333333
    assert found["provenance"] == {"inputs": {"a.csv": "12ab", "b/result.json": None}}
    assert found["trace"] == {"count": 100, "mean_rms_ends": [third, third, third, third]}
    assert found["value"] == 0.66666667
    assert json.loads(written(found)) == found
