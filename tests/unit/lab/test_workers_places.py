"""Commands that are kept to some places read and change nothing else, whatever they are asked."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat
from tests.hostile.samples import ulog

from rotorid.lab.workers import Job, Places, Workers

CONFINED = """
import sys
from rotorid.io.confinement import confine_files
sys.exit(not confine_files(readable=[], writable=[]))
"""

KEPT = """
import sys
from pathlib import Path
import rotorid
from rotorid.cli.lab_worker import _keep_to
from rotorid.compiling import kept_in
_keep_to([], sys.argv[1:])
(Path(sys.argv[1]) / "own").write_text("")
for place in (*kept_in(), Path(rotorid.__file__).parent / "__pycache__"):
    try:
        (place / "left.pyc").write_text("")
    except OSError:
        continue
    sys.exit(f"{place} was written")
"""


@pytest.fixture(scope="module", autouse=True)
def _confined() -> None:
    if subprocess.run([sys.executable, "-c", CONFINED], check=False).returncode:
        pytest.skip("this system keeps no process to places (Linux from 5.19 does)")


@pytest.fixture
def workers(tmp_path: Path) -> Workers:
    for name in ("inside", "outside", "results"):
        (tmp_path / name).mkdir()
    for name in ("inside", "outside"):
        (tmp_path / name / "flight.ulg").write_bytes(ulog().content)
    return Workers(places=Places(readable=(tmp_path / "inside",), writable=(tmp_path / "results",)))


def ran(workers: Workers, folder: Path, *words: str | Path) -> Job:
    job = workers.start([*map(str, words), "--json", "--quiet"], folder)
    assert job.ended.wait(60.0)
    return job


def test_logs_inside_are_read_and_results_written(workers: Workers, tmp_path: Path) -> None:
    results = tmp_path / "results" / "a"
    job = ran(workers, tmp_path / "job", "inspect", tmp_path / "inside" / "flight.ulg", "--out", results)
    assert job.state == "done", job.sentence
    assert (results / "inspect.json").is_file()


def test_nothing_outside_is_read(workers: Workers, tmp_path: Path) -> None:
    job = ran(workers, tmp_path / "job", "inspect", tmp_path / "outside" / "flight.ulg")
    assert job.state == "refused"
    assert "Permission denied" in job.sentence


def test_a_link_does_not_lead_out(workers: Workers, tmp_path: Path) -> None:
    link = tmp_path / "inside" / "link.ulg"
    link.symlink_to(tmp_path / "outside" / "flight.ulg")
    job = ran(workers, tmp_path / "job", "inspect", link)
    assert job.state == "refused"


def test_nothing_outside_is_written(workers: Workers, tmp_path: Path) -> None:
    log = tmp_path / "inside" / "flight.ulg"
    for place in (tmp_path / "outside" / "a", tmp_path / "inside" / "a"):
        job = ran(workers, tmp_path / "job", "inspect", log, "--out", place)
        assert job.state == "refused"
        assert not place.exists()


def test_no_code_is_left_for_commands_that_are_not_kept_to_places(tmp_path: Path) -> None:
    place = tmp_path / "cache" / "numba" / "confined"
    place.mkdir(parents=True)
    home = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")}
    home.pop("NUMBA_CACHE_DIR", None)
    ran = subprocess.run([sys.executable, "-c", KEPT, place], env=home, capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stderr) == (0, "")
    assert (place / "own").is_file()


def test_a_foreign_parser_still_runs_in_its_own_sandbox(workers: Workers, tmp_path: Path) -> None:
    log = tmp_path / "inside" / "flight.mat"
    time_s = np.arange(500) / 100.0
    savemat(log, {"time": time_s, "p": np.sin(time_s), "roll_command": np.cos(time_s)})
    job = ran(workers, tmp_path / "job", "inspect", log)
    assert job.state == "done", job.sentence
