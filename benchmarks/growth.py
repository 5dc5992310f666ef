"""How time and memory grow with the work: length of a log, logs of a fit and of a fleet, channels, and parameters.

A job is done at sizes that double, each in a process of its own, after one at the smallest size that pays for imports
and compiled kernels. The exponent is the slope of the logarithm of what the job itself costs over that of the size
between the two largest: 1 is linear, 2 is quadratic. Logs grow by being flown again: the same flight after itself.

Run ``python -m benchmarks.growth``, with parts of the names of jobs to choose some of them.
"""

from __future__ import annotations

import json
import math
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import rotorid
from rotorid.data import FlightRecord, Topic

BAR = 1.5
"""Exponent between the two largest sizes up to which growth is no quadratic one, with noise of the machine."""

_PAUSE_S = 5.0


@dataclass(frozen=True, kw_only=True)
class Job:
    """Something that grows: its name, the sizes, and what makes it ready at a size, and then does it."""

    name: str
    of: str
    sizes: Sequence[int]
    ready: Callable[[int, Path], Callable[[], object]]


@dataclass(frozen=True, kw_only=True)
class Growth:
    """What a job cost at its sizes: seconds of processor, and the largest memory of its process in MiB."""

    job: Job
    seconds: Sequence[float]
    mib: Sequence[float]

    @property
    def exponent(self) -> float:
        return _slope(self.job.sizes, self.seconds)

    def __str__(self) -> str:
        seconds = " ".join(f"{value:7.2f}" for value in self.seconds)
        mib = " ".join(f"{value:6.0f}" for value in self.mib)
        verdict = "met" if self.exponent <= BAR else "MISSED"
        sizes = ", ".join(map(str, self.job.sizes))
        return f"{self.job.name:36} {self.job.of:8} {sizes:18} {seconds:32} {self.exponent:5.2f}  {verdict:7} {mib} MiB"


def _slope(sizes: Sequence[int], costs: Sequence[float]) -> float:
    return math.log(costs[-1] / costs[-2]) / math.log(sizes[-1] / sizes[-2])


def _written(folder: Path) -> None:
    """The example of a PX4 quadrotor: a flight of 217 s with sweeps and doublets on each axis, ``flight.ulg``."""
    call = [sys.executable, "-m", "rotorid", "example", "px4", "--quiet", "--force", "--out", str(folder)]
    subprocess.run(call, check=True)


def again(record: FlightRecord, times: int, name: str = "") -> FlightRecord:
    """A record whose flight was flown several times, one after another, shape of each topic ``(samples * times,)``."""
    span_s = record.stop_s - record.start_s + _PAUSE_S
    topics = tuple(
        Topic(
            name=topic.name,
            time_s=np.concatenate([topic.time_s + number * span_s for number in range(times)]),
            channels=topic.channels,
            values=np.tile(topic.values, (1, times)),
            of_table=topic.of_table,
        )
        for topic in record.topics
    )
    source = replace(record.source, name=name or record.source.name, sha256=name or record.source.sha256)
    return replace(record, topics=topics, source=source)


def _flown(folder: Path, times: int, name: str = "") -> FlightRecord:
    return again(rotorid.read(folder / "flight.ulg"), times, name)


def _inspecting(times: int, folder: Path) -> Callable[[], object]:
    record = _flown(folder, times)
    return lambda: rotorid.inspect(record)


def _reviewing(times: int, folder: Path) -> Callable[[], object]:
    record = _flown(folder, times)
    return lambda: rotorid.review(record)


def _identifying(model: str, **options: Any) -> Callable[[int, Path], Callable[[], object]]:
    def ready(times: int, folder: Path) -> Callable[[], object]:
        record = _flown(folder, times)
        return lambda: rotorid.identify(record, model, **options)

    return ready


def _of_several(number: int, folder: Path) -> Callable[[], object]:
    records = [_flown(folder, 1, f"flight-{index}.ulg") for index in range(number)]
    return lambda: rotorid.identify(records, "rate.roll")


def _of_order(order: int, folder: Path) -> Callable[[], object]:
    record = _flown(folder, 1)
    return lambda: rotorid.identify(record, f"black_box:{order}", inputs=("roll_command",), outputs=("p",))


def _wide(channels: int, folder: Path) -> Callable[[], object]:
    time_s = np.arange(0.0, 120.0, 0.01)
    columns = {"t": time_s, **{name: np.sin(time_s) for name in ("p", "q", "r", "roll_command")}}
    columns |= {f"spare {number}": np.cos(number * time_s) for number in range(channels)}
    path = folder / f"wide-{channels}.csv"
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.5f")
    return lambda: rotorid.inspect(path)


def _fleet(logs: int, folder: Path) -> Callable[[], object]:
    from scipy.signal import chirp, lfilter

    time_s, place = np.arange(0.0, 60.0, 0.01), folder / f"fleet-{logs}"
    place.mkdir(exist_ok=True)
    for number in range(logs):
        noise = np.random.default_rng(number).normal(scale=0.02, size=(2, time_s.size))
        command = 0.1 * chirp(time_s, 0.1, time_s[-1], 12.0, method="logarithmic") + 0.01 * noise[0]
        rate = lfilter([0.0, 0.5], [1.0, -0.95], command) + noise[1]
        table = np.column_stack([time_s, command, rate])
        path = place / f"{number}.csv"
        np.savetxt(path, table, delimiter=",", header="t,roll_command,p", comments="", fmt="%.5f")
    return lambda: list(
        rotorid.fleet([place], models=("rate.roll",), out=folder / f"fleet-{logs}-out", workers=1, resume=False)
    )


JOBS = (
    Job(name="inspect", of="length", sizes=(1, 2, 4, 8), ready=_inspecting),
    Job(name="identify rate.roll", of="length", sizes=(1, 2, 4, 8), ready=_identifying("rate.roll")),
    Job(name="identify physical.motors", of="length", sizes=(1, 2, 4, 8), ready=_identifying("physical.motors")),
    Job(
        name="identify rate.roll by output error",
        of="length",
        sizes=(1, 2, 4),
        ready=_identifying("rate.roll", method="output_error"),
    ),
    Job(name="review", of="length", sizes=(1, 2, 4, 8), ready=_reviewing),
    Job(name="identify rate.roll", of="logs", sizes=(1, 2, 4, 8), ready=_of_several),
    Job(name="fleet, rate.roll", of="logs", sizes=(4, 8, 16), ready=_fleet),
    Job(name="inspect of a table", of="columns", sizes=(64, 128, 256, 512), ready=_wide),
    Job(name="identify black_box", of="order", sizes=(2, 4, 8), ready=_of_order),
)


def growth(job: Job, folder: Path) -> Growth:
    """Do a job at each of its sizes, in processes of their own."""
    costs = []
    for size in job.sizes:
        call = [sys.executable, "-m", "benchmarks.growth", "--one", str(JOBS.index(job)), str(size), str(folder)]
        costs.append(json.loads(subprocess.run(call, check=True, capture_output=True, text=True).stdout))
    return Growth(job=job, seconds=[cost["seconds"] for cost in costs], mib=[cost["mib"] for cost in costs])


def _one(job: Job, size: int, folder: Path) -> dict[str, float]:
    job.ready(job.sizes[0], folder)()
    do = job.ready(size, folder)
    began_s = _processor_s()
    do()
    spent_s = _processor_s() - began_s
    return {"seconds": spent_s, "mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0}


def _processor_s() -> float:
    """Seconds of this process and of its children, those that still run left out."""
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system


def main() -> None:
    """Print the table."""
    if "--one" in sys.argv:
        number, size, place = sys.argv[sys.argv.index("--one") + 1 :]
        print(json.dumps(_one(JOBS[int(number)], int(size), Path(place))))
        return
    wanted = sys.argv[1:]
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        _written(folder)
        for job in JOBS:
            if not wanted or any(part in f"{job.name} {job.of}" for part in wanted):
                print(growth(job, folder), flush=True)


if __name__ == "__main__":
    main()
