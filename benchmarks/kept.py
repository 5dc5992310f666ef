"""Results of a long study, kept task by task, so that it can be run in parts and go on where it ended."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

Task = tuple[Any, ...]


def kept_rows(path: Path | None) -> dict[Task, list[dict[str, Any]]]:
    """Rows of the tasks that a file has, by task; a last line that was cut off is left out."""
    found: dict[Task, list[dict[str, Any]]] = {}
    if path is None or not path.exists():
        return found
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            read = json.loads(line)
        except json.JSONDecodeError:
            continue
        found[tuple(read["task"])] = read["rows"]
    return found


def run_tasks(
    tasks: Sequence[Task],
    work: Callable[[Task], list[dict[str, Any]]],
    *,
    path: Path | None = None,
    processes: int = 1,
) -> Iterator[dict[str, Any]]:
    """Rows of all tasks in their order: those of the file as they are, the others worked on and appended to it.

    Parameters
    ----------
    tasks
        What ``work`` takes: numbers, words and truth values only.
    work
        Rows of a task, of what JSON can hold.
    path
        The file, one task a line; ``None`` keeps nothing.
    processes
        How many tasks are worked on at a time.
    """
    known = kept_rows(path)
    missing = [task for task in tasks if task not in known]

    def keep(task: Task, rows: list[dict[str, Any]]) -> None:
        known[task] = rows
        if path is not None:
            with path.open("a", encoding="utf-8") as file:
                file.write(json.dumps({"task": list(task), "rows": rows}) + "\n")

    if processes == 1:
        for task in missing:
            keep(task, work(task))
    else:
        with ProcessPoolExecutor(processes) as pool:
            waiting = {pool.submit(work, task): task for task in missing}
            for done in as_completed(waiting):
                keep(waiting[done], done.result())
    for task in tasks:
        yield from known[task]
