"""Stand-in logs of a fleet, and what a worker makes of them: small texts whose words say what happens."""

from __future__ import annotations

import math
import os
import signal
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from rotorid.fleets.places import fetched
from rotorid.fleets.table import LogAnswer, Row
from rotorid.fleets.work import Task, failure
from rotorid.io.files import sha256_of

WORK = "tests.fleet_logs:answer"


def read_table(path: Path) -> list[Row]:
    """Rows of a table that :func:`rotorid.fleets.table.write_table` wrote."""
    from pyarrow import parquet

    return [Row(**one) for one in parquet.read_table(path).to_pylist()]


def write_logs(folder: Path, count: int, words: str = "value", *, first: int = 1) -> list[Path]:
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"log-{number:04d}.ulg" for number in range(first, first + count)]
    for number, path in enumerate(paths, start=first):
        path.write_text(f"{words} {number}", encoding="utf-8")
    return paths


def answer(task: Task) -> LogAnswer:
    """Do what the log says: give a number, wait, hang, eat memory, die."""
    with fetched(task.place) as place:
        path = Path(task.copy) if task.copy else place
        words = path.read_text(encoding="utf-8").split()
        content = sha256_of(path)
    what = words[0]
    if what == "hang":
        time.sleep(3600.0)
    if what == "die":
        os.kill(os.getpid(), signal.SIGKILL)
    if what == "busy":
        until = time.process_time() + float(words[2])
        while time.process_time() < until:
            math.sqrt(2.0)
    if what == "slow":
        time.sleep(0.1)
    if what == "memory":
        try:
            np.ones(1 << 33)
        except MemoryError:
            return failure(task, "memory", "It asked for more memory than one log may use.")
    if what == "unreadable":
        return failure(task, "unreadable", "This is no flight log.")
    row = Row(
        log=task.place.name,
        log_sha256=content,
        vehicle=task.place.folder,
        time_utc="",
        flight=1,
        model="rate.roll",
        parameter="L_roll",
        value=100.0 + float(words[1]),
        std=1.0,
        std_random=0.5,
        lower=98.0,
        upper=102.0,
        unit="rad/s^2",
        findings="",
        format="stand-in",
        firmware="",
        settings=task.settings,
    )
    base = failure(task, "error", "")
    return replace(base, log_sha256=content, failed=(), rows=(row,))


class Here:
    """An engine without processes: answers are the same, and no worker is started for each run."""

    workers = 1

    def run(self, tasks: Iterable[Task]) -> Iterator[LogAnswer]:
        """Answer every task once."""
        # What a process is given and gives back crosses its border as text.
        return (LogAnswer.from_json(answer(Task.from_json(task.as_json())).as_json()) for task in tasks)


def row_of(vehicle: str, flight: int, value: float, std: float = 1.0, **more: object) -> Row:
    """A row of a table made by hand."""
    return Row(
        **{
            "log": f"{vehicle}-{flight:03d}.ulg",
            "log_sha256": f"{vehicle}-{flight}",
            "vehicle": vehicle,
            "time_utc": "",
            "flight": 1,
            "model": "rate.roll",
            "parameter": "L_roll",
            "value": value,
            "std": std,
            "std_random": std,
            "lower": value - 2 * std,
            "upper": value + 2 * std,
            "unit": "rad/s^2",
            "findings": "",
            "format": "",
            "firmware": "",
            "settings": "",
            **more,
        }
    )


def table_of(values: Sequence[Sequence[float]], std: float = 1.0, **more: object) -> list[Row]:
    """Rows of vehicles ``v00`` on, each with its values in the order of its flights."""
    return [
        row_of(f"v{number:02d}", flight, value, std, **more)
        for number, own in enumerate(values)
        for flight, value in enumerate(own, start=1)
    ]
