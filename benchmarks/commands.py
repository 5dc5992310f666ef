"""What whole commands cost, as a person types them: their processor time over that of the start of Python.

The start, Y, is ``import numpy, scipy.signal, scipy.optimize, pydantic, numba`` and nothing else: what no command of
its kind can save. Y and the command run in turn, so that a machine that slows down slows both, and medians are
compared. Every command runs once unmeasured before, so that what is compiled only once is not measured; long ones do so
on less data and are measured once. Processor time counts child processes as well.

Run ``python -m benchmarks.commands``, with parts of the names of jobs to choose some of them. With ``--profile`` it
prints where the time of each goes instead, and the largest costs of all (:mod:`benchmarks.stages`).
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from benchmarks import stages

DATA = Path(os.environ.get("ROTORID_DATA", Path(__file__).resolve().parents[2] / "shared" / "data")).resolve()
START = ("-c", "import numpy, scipy.signal, scipy.optimize, pydantic, numba")
REPEATS = 3
DEAREST, LARGEST = 12, 10
SKIPPED = f"whole commands skipped: there is no {DATA}; set ROTORID_DATA to the folder of flight data"


class Job(NamedTuple):
    """A command, in which ``@log`` stands for a file of the data folder.

    ``bar`` is how many times Y it may cost. ``warm_up`` is a shorter command that compiles the same, which marks the
    command as a long one. ``before`` are commands whose files it works on.
    """

    name: str
    command: str
    bar: float
    warm_up: str = ""
    before: tuple[str, ...] = ()


class Cost(NamedTuple):
    """Seconds of processor time of a command and of the start of Python beside it, medians."""

    job: Job
    command_s: float
    start_s: float

    @property
    def ratio(self) -> float:
        return self.command_s / self.start_s

    def __str__(self) -> str:
        verdict = "met" if self.ratio <= self.job.bar else "MISSED"
        return (
            f"{self.job.name:52} {self.command_s:8.2f} {self.start_s:6.2f} {self.ratio:7.1f} "
            f"{self.job.bar:6.1f}  {verdict}"
        )


_ROLL = "@ardupilot_sitl/x_calm_roll.BIN"
_PX4 = "@px4_sitl/roll.ulg @px4_sitl/pitch.ulg.xz @px4_sitl/yaw.ulg.xz @px4_sitl/thrust.ulg.xz"
_S500 = "@s500/pitch_sweeps.csv @s500/thrust_sweeps.csv --model hover.longitudinal"
_BEBOP = " ".join(f"@bebop/ident/{name}.mat" for name in ("120935", "121028", "121250", "122633"))
_AXES = (
    "--map @bebop/map.toml --decoupled --inputs phi_setpoint,theta_setpoint,velocity_down_setpoint "
    "--outputs phi,theta,velocity_down"
)

JOBS = (
    Job("inspect, .BIN of 22 MB", f"inspect {_ROLL}", 0.8),
    Job("identify rate.roll, .BIN of 22 MB, with report", f"identify {_ROLL} --model rate.roll", 1.6),
    Job("review, .BIN of 22 MB, with page", f"review {_ROLL}", 4.0),
    Job(
        "identify hover.longitudinal, S500, with doublets",
        f"identify {_S500} --verify @s500/pitch_doublets.csv --verify @s500/thrust_doublets.csv",
        3.0,
    ),
    Job("identify hover.full, four PX4 logs", f"identify {_PX4} --model hover.full", 5.0),
    Job(
        "identify physical.motors, four PX4 logs",
        f"identify {_PX4} --model physical.motors --fix m=1 --fix kappa=0.02 --arm 0.283",
        4.0,
    ),
    Job(
        "tune, result of three axes",
        "tune model --force",
        3.0,
        before=(
            "example px4 --out example",
            "identify example/flight.ulg --model rate.roll,rate.pitch,rate.yaw --out model",
        ),
    ),
    Job(
        "identify hover.longitudinal by prediction error",
        f"identify {_S500} --method prediction_error",
        9.0,
        warm_up="identify @px4_sitl/yaw.ulg.xz --model rate.yaw --method prediction_error",
    ),
    *(
        Job(
            f"identify black_box:{order}, Bebop, cross-validated",
            f"identify {_BEBOP} --model black_box:{order} {_AXES} --cross-validate each",
            12.0,
            warm_up=f"identify @bebop/ident/120935.mat --model black_box:{order} {_AXES}",
        )
        for order in (3, 4)
    ),
)
QUICK = tuple(job for job in JOBS if not job.warm_up)


def cpu_s(words: Sequence[str], folder: Path) -> float:
    """Seconds of processor time of ``python WORDS`` in a folder, user and system, with those of its child processes.

    Raises
    ------
    RuntimeError
        It failed, so that its time says nothing.
    """
    call = [sys.executable, *words]
    compiled_once = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    with subprocess.Popen(
        call, cwd=folder, env=compiled_once, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    ) as process:
        assert process.stderr is not None
        said = process.stderr.read()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"python {' '.join(words)} failed: {said.decode(errors='replace').strip()}")
    return usage.ru_utime + usage.ru_stime


def cost(job: Job) -> Cost:
    """Run a command and the start of Python in turn, the start first and last."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _warm_up(job, folder)
        starts, commands = [cpu_s(START, folder)], []
        for _ in range(1 if job.warm_up else REPEATS):
            commands.append(cpu_s(_words(job.command), folder))
            starts.append(cpu_s(START, folder))
    return Cost(job, statistics.median(commands), statistics.median(starts))


def _warm_up(job: Job, folder: Path) -> None:
    for command in (*job.before, job.warm_up or job.command):
        cpu_s(_words(command), folder)


def _words(command: str) -> list[str]:
    files = (str(DATA / word[1:]) if word.startswith("@") else word for word in command.split())
    return ["-m", "rotorid", *files]


def rows(jobs: Sequence[Job] = JOBS) -> Iterator[Cost | str]:
    """Costs as they come, or a sentence for what was skipped."""
    if not DATA.is_dir():
        yield SKIPPED
        return
    for job in jobs:
        yield cost(job)


def seconds_by_stage(job: Job) -> tuple[dict[str, float], dict[str, float]]:
    """Processor time of a command by stage, and of its dearest functions, on its second run."""
    with tempfile.TemporaryDirectory() as name:
        folder, answer = Path(name), Path(name) / "answer.json"
        _warm_up(job, folder)
        cpu_s([str(Path(stages.__file__)), str(answer), *_words(job.command)[2:]], folder)
        found = json.loads(answer.read_text(encoding="utf-8"))
    return found["stages"], found["functions"]


def print_profiles(jobs: Sequence[Job]) -> None:
    """Print the stages of each command, its dearest functions, and the largest stages of all commands."""
    if not DATA.is_dir():
        print(SKIPPED)
        return
    largest: list[tuple[float, str]] = []
    for job in jobs:
        by_stage, by_function = seconds_by_stage(job)
        whole_s = sum(by_stage.values())
        print(f"\n{job.name}: {whole_s:.2f} s")
        for costs, most in ((by_stage, len(by_stage)), (by_function, DEAREST)):
            for name, seconds in sorted(costs.items(), key=lambda item: -item[1])[:most]:
                print(f"  {100.0 * seconds / whole_s:5.1f} %  {name}", flush=True)
        largest += [(100.0 * seconds / whole_s, f"{name} of {job.name}") for name, seconds in by_stage.items()]
    print("\nLargest:")
    for percent, name in sorted(largest, reverse=True)[:LARGEST]:
        print(f"  {percent:5.1f} %  {name}")


def main() -> None:
    """Print the table, or with ``--profile`` where the time goes."""
    wanted = [word for word in sys.argv[1:] if word != "--profile"]
    jobs = [job for job in JOBS if not wanted or any(part in job.name for part in wanted)]
    if "--profile" in sys.argv:
        print_profiles(jobs)
        return
    print(f"{'command':52} {'CPU [s]':>8} {'Y [s]':>6} {'ratio':>7} {'bar':>6}")
    for row in rows(jobs):
        print(row, flush=True)


if __name__ == "__main__":
    main()
