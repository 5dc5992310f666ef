"""Every command with ``--out``, killed or with a full or read-only disk at each call that touches the results.

``python -m tests.hostile.interrupted FOLDER`` tries up to 100 calls of each command with each fault, keeps what became
of them in ``FOLDER``, a file for each command, and prints the table; ``FOLDER COMMAND …`` tries some.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tests.hostile.damage import ROOT

from rotorid.io.tables.csv import write_csv

MOMENTS = 100
COMMANDS: Mapping[str, Sequence[str]] = {
    "demo": ("demo",),
    "inspect": ("inspect", "LOG"),
    "response": ("response", "LOG", "--inputs", "roll_command", "--outputs", "p"),
    "identify": ("identify", "LOG", "--model", "rate.roll"),
    "identify, several": ("identify", "LOG", "--model", "rate.roll,response.first_order"),
    "verify": ("verify", "RESULT", "LOG"),
    "compare": ("compare", "RESULT", "OTHER", "--log", "LOG"),
    "review": ("review", "LOG"),
    "delay": ("delay", "LOG"),
    "track": ("track", "FLOWN"),
    "tune": ("tune", "FLOWN", "--axis", "roll"),
    "tune --judge": ("tune", "FLOWN", "--axis", "roll", "--judge", "GAINS"),
    "stitch": ("stitch", "AT-0", "AT-4"),
    "export": ("export", "RESULT", "--to", "json"),
    "design": ("design", "sweep", "doublet", "--vehicle", "px4_quad", "--axis", "roll", "--duration", "20"),
    "simulate": ("simulate", "rig"),
    "simulate --log": ("simulate", "RESULT", "--log", "LOG"),
    "example": ("example", "rig"),
    "fleet": ("fleet", "LOG", "--models", "rate.roll", "--workers", "1"),
}
"""Command to its words; those in capitals stand for files. ``run`` starts these commands, and writes nothing itself."""


def inputs(folder: Path) -> Mapping[str, Path]:
    """What commands are given, made once: a log, results, a flight with known gains, gains."""
    places = {name: folder / name.lower() for name in ("RESULT", "OTHER", "AT-0", "AT-4", "EXAMPLE")}
    places |= {"LOG": folder / "flight.csv", "GAINS": folder / "gains.txt"}
    folder.mkdir(parents=True, exist_ok=True)
    if not places["LOG"].exists():
        time_s = np.arange(0.0, 60.0, 0.01)
        command = 0.1 * np.sin(0.5 * time_s**2)
        rate = np.zeros(time_s.size)
        for k in range(1, time_s.size):
            rate[k] = rate[k - 1] + 0.01 * (100.0 * command[k - 1] - 3.0 * rate[k - 1])
        noise = 0.01 * np.random.default_rng(0).normal(size=time_s.size)
        write_csv(places["LOG"], time_s, {"roll_command": command, "p": rate + noise})
    places["GAINS"].write_text("roll: P=0.1 D=0.002\n", encoding="utf-8")
    return places


def made(words: Sequence[str], places: Mapping[str, Path]) -> list[str]:
    """The words of a command, with the files that it needs."""
    if "RESULT" in words and not places["RESULT"].exists():
        _rotorid("identify", places["LOG"], "--model", "rate.roll", "--out", places["RESULT"])
    if "OTHER" in words and not places["OTHER"].exists():
        _rotorid("identify", places["LOG"], "--model", "rate.roll", "--fix", "tau_roll=0", "--out", places["OTHER"])
    if "FLOWN" in words and not places["EXAMPLE"].exists():
        _rotorid("example", "px4", "--out", places["EXAMPLE"])
    if "AT-0" in words and not places["AT-4"].exists():
        from tests.unit.flying.test_stitching import LONGITUDINAL, identified

        from rotorid.documents.result import save

        for name, speed in (("AT-0", 0.0), ("AT-4", 4.0)):
            save(identified(LONGITUDINAL, speed), places[name])
    known = {**places, "FLOWN": places["EXAMPLE"] / "flight.ulg"}
    return [str(known.get(word, word)) for word in words]


def _rotorid(*words: str | Path) -> None:
    subprocess.run([sys.executable, "-m", "rotorid", *map(str, words), "--quiet"], check=True, env=_environment())


def _environment() -> Mapping[str, str]:
    places = [str(ROOT), *(entry for entry in sys.path if entry)]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(places), "OPENBLAS_NUM_THREADS": "1"}


def interrupted(words: Sequence[str], folder: Path, *, killed: int, full: int, read_only: int) -> list[dict[str, Any]]:
    """What became of a command and of its copies.

    Parameters
    ----------
    words
        The command, without ``--out``.
    folder
        An empty one, or one that is made.
    killed, full, read_only
        At how many of its calls it is killed, and at how many the disk is full, or read-only, from there on.
    """
    for name in ("temporary", "home"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    moments = map(str, (killed, full, read_only))
    ran = subprocess.run(
        [sys.executable, "-m", "tests.hostile.interrupted_child", str(folder / "work"), *moments, *words],
        env={**_environment(), "TMPDIR": str(folder / "temporary")},
        capture_output=True,
        text=True,
        check=False,
    )
    if ran.returncode:
        raise AssertionError(f"the child ended with {ran.returncode}: {ran.stderr[-2000:]}")
    lines = [json.loads(line) for line in ran.stdout.splitlines() if line.startswith('{"fault"')]
    if len(lines) < 2:
        raise AssertionError(f"the command wrote nothing: {ran.stderr[-2000:]}")
    return lines


def faults(lines: Sequence[Mapping[str, Any]]) -> list[str]:
    """What is wrong, with the fault and the call."""
    return [f"{line['fault']} {line.get('at', '')}: {wrong}" for line in lines for wrong in line.get("wrong", ())]


def row(name: str, lines: Sequence[Mapping[str, Any]]) -> str:
    """A row of the table, in Markdown."""
    known = ("killed", "full", "read-only", "none", "next run")
    of = {fault: [line for line in lines if line["fault"] == fault] for fault in known}
    tried = (sum(line["ended"] < 0 for line in of["killed"]), len(of["full"]), len(of["read-only"]))
    counts = (of["none"][0]["calls"], of["next run"][0]["files"], *tried, len(faults(lines)))
    return f"| {name} | {' | '.join(map(str, counts))} |"


def main(folder: Path, names: Sequence[str]) -> int:
    """Try, keep, print; the number of faults, at most one."""
    places, wrong = inputs(folder / "inputs"), 0
    print(
        "| command | calls | files | killed | disk full | read-only | faults |\n|---|---|---|---|---|---|---|",
        flush=True,
    )
    for name in names or COMMANDS:
        kept = folder / f"{name}.jsonl"
        if not kept.exists():
            words = made(COMMANDS[name], places)
            lines = interrupted(words, folder / name, killed=MOMENTS, full=MOMENTS, read_only=MOMENTS)
            kept.write_text("".join(f"{json.dumps(line)}\n" for line in lines), encoding="utf-8")
        lines = [json.loads(line) for line in kept.read_text(encoding="utf-8").splitlines()]
        wrong += len(faults(lines))
        print(row(name, lines), *faults(lines)[:3], sep="\n", flush=True)
    return min(wrong, 1)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), sys.argv[2:]))
