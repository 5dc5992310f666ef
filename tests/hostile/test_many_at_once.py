"""Fifty identifications at once on however few cores: each is as right as alone, none waits for another for ever."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="memory is counted in other units elsewhere"),
]

MANY = 50
LONGEST_S = 1500.0
MEMORY = 1.2
"""Most memory of one of many, over that of one alone."""

# Runs a command, and says its code and its most memory in kilobytes.
CHILD = """
import resource, subprocess, sys
code = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL).returncode
print(code, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""


def started(log: Path, *words: str, folder: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "rotorid", "identify", str(log), "--model", "rate.roll", "--quiet", *words]
    return subprocess.Popen(
        [sys.executable, "-c", CHILD, *command],
        stdout=subprocess.PIPE,
        text=True,
        cwd=folder,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    )


def answer(folder: Path) -> tuple[object, object]:
    document = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    return document["parameters"], document["cost"]


def test_fifty_answers_are_those_of_one(shared_data: Path, tmp_path: Path) -> None:
    log = shared_data / "px4_sitl" / "roll.ulg"
    alone = started(log, "--out", "alone", folder=tmp_path)
    code, memory = map(int, alone.communicate(timeout=LONGEST_S)[0].split())
    assert code == 0

    # Half of them write where they are told, the others find numbers for their default name.
    running = [
        started(log, *(("--out", f"run-{number}") if number % 2 else ()), folder=tmp_path) for number in range(MANY)
    ]
    ended = [tuple(map(int, one.communicate(timeout=LONGEST_S)[0].split())) for one in running]

    assert {code for code, _ in ended} == {0}
    assert max(peak for _, peak in ended) < MEMORY * memory
    folders = [place.parent for place in tmp_path.rglob("result.json") if place.parent.name != "alone"]
    assert len(folders) == MANY
    assert all(answer(folder) == answer(tmp_path / "alone") for folder in folders)
