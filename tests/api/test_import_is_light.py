"""``import rotorid`` costs nothing: what is heavy is loaded by what needs it."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = ("scipy", "numba", "pydantic", "typer", "rich", "jinja2", "matplotlib", "pyulog")


def modules_after(statement: str) -> set[str]:
    code = f"{statement}\nimport sys; print(*{{name.partition('.')[0] for name in sys.modules}})"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    return set(done.stdout.split())


@pytest.mark.parametrize(
    ("statement", "forbidden"),
    [
        ("import rotorid", (*HEAVY, "numpy")),
        ("from rotorid import Channel, FlightRecord, Maneuver, TimeHistory, UsageError", HEAVY),
        ("from rotorid import read", HEAVY),
        ("import rotorid.cli.app", ("scipy", "numba", "pydantic", "matplotlib", "pyulog", "numpy")),
    ],
    ids=["package", "value objects", "read", "command line"],
)
def test_nothing_heavy_is_imported(statement: str, forbidden: tuple[str, ...]) -> None:
    assert modules_after(statement).isdisjoint(forbidden)


def test_inspecting_imports_no_fit() -> None:
    # What a log is good for is known from what it holds; models are fitted by another command.
    statement = "import rotorid.reviewing.inspection, rotorid.identifying.families, rotorid.report.inspection_words"
    code = f"{statement}\nimport sys; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.split()
    fits = ("rotorid.fits.", "rotorid.search.", "rotorid.documents.", "rotorid.checking.", "numba", "jinja2")
    assert [name for name in loaded if name.startswith(fits)] == []
