"""Readers that go away, disks that are full, people who press Ctrl-C: a sentence and a code, never a traceback."""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from rotorid.io.tables.csv import write_csv

COMMAND = [sys.executable, "-m", "rotorid"]
UNIX = pytest.mark.skipif(os.name != "posix", reason="signals and /dev/full are those of Unix")


@pytest.fixture
def log(tmp_path: Path) -> Path:
    time_s = np.arange(0.0, 60.0, 0.01)
    path = tmp_path / "flight.csv"
    motion = np.sin(0.5 * time_s**1.5)
    write_csv(path, time_s, {"roll_command": 0.1 * motion, "p": motion})
    return path


@UNIX
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full here")
def test_a_full_disk_is_a_sentence_and_two(log: Path) -> None:
    with Path("/dev/full").open("w") as full:
        ran = subprocess.run([*COMMAND, "inspect", log, "--json"], stdout=full, stderr=subprocess.PIPE, text=True)
    assert ran.returncode == 2
    assert "the output cannot be written" in ran.stderr
    assert "Traceback" not in ran.stderr


@UNIX
def test_a_reader_that_has_read_enough_is_no_error(log: Path) -> None:
    first = subprocess.Popen([*COMMAND, "inspect", log, "--json"], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert first.stdout is not None
    assert first.stderr is not None
    first.stdout.read(1)
    first.stdout.close()
    said = first.stderr.read().decode()
    assert first.wait(timeout=60.0) == 0
    assert "Traceback" not in said
    first.stderr.close()


@UNIX
def test_an_interrupt_is_said_and_leaves_nothing_half_written(tmp_path: Path) -> None:
    out = tmp_path / "demo"
    running = subprocess.Popen([*COMMAND, "demo", "--out", out], stderr=subprocess.PIPE, text=True)
    # Under load the program itself may take longer to start than any sleep.
    until = time.monotonic() + 60.0
    while not any(tmp_path.iterdir()) and time.monotonic() < until:
        time.sleep(0.05)
    time.sleep(0.5)
    running.send_signal(signal.SIGINT)
    _, said = running.communicate(timeout=60.0)
    assert running.returncode == 130
    assert "interrupted" in said
    assert "Traceback" not in said
    assert not list(tmp_path.glob("**/.rotorid-making-*"))


@UNIX
def test_an_interrupt_while_a_class_is_made_ends_with_the_same_code(tmp_path: Path) -> None:
    """The making of named tuples and data classes runs source, whose interrupts Python remembers until its end."""
    program = "from rotorid.cli import app\napp._parsed = lambda words: exec('raise KeyboardInterrupt')\napp.main()\n"
    (tmp_path / "interrupted.py").write_text(program)
    command = [sys.executable, "-m", "interrupted"]
    ran = subprocess.run(command, stderr=subprocess.PIPE, text=True, check=False, cwd=tmp_path)
    assert ran.returncode == 130
    assert "interrupted" in ran.stderr


def test_what_machine_code_prints_is_no_part_of_the_results() -> None:
    """LAPACK prints its complaints to standard output, past Python: by its number, when the program ends."""
    program = (
        "import os, sys\nfrom rotorid.cli.console import patient_output\n"
        "patient_output()\nos.write(1, b' ** On entry to DLASCL\\n')\nprint('{}')\n"
        "import numpy as np\ntry:\n    np.linalg.lstsq(np.full((3, 2), np.nan), np.ones(3))\n"
        "except np.linalg.LinAlgError:\n    pass\n"
    )
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert ran.stdout == "{}\n"
    assert "DLASCL" in ran.stderr


@UNIX
def test_results_are_written_where_standard_error_is_closed(log: Path) -> None:
    command = " ".join(shlex.quote(str(word)) for word in [*COMMAND, "inspect", log, "--json"])
    ran = subprocess.run(["sh", "-c", f"{command} 2>&-"], capture_output=True, text=True, check=True)
    assert json.loads(ran.stdout)["schema"]
