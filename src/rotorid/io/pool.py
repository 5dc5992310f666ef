"""Processes that share out runs of one work: the room for every ``--workers`` of a single log.

A worker has one thread for linear algebra, so that as many workers as cores do not get into each other's way, and its
sums are rounded alike whatever the number of workers. It ignores Ctrl-C, which is for the process that started it, and
ends with that. Many logs have workers of their own, limited in memory and time (:mod:`rotorid.fleets.engines`).
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pickle
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Generic, ParamSpec, TypeVar

from rotorid.io.children import end_with_parent
from rotorid.io.folders import scratch_folder

Arguments = ParamSpec("Arguments")
Answer = TypeVar("Answer")

_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(frozen=True)
class Pool:
    """Workers, or none: then runs follow one another in this process.

    Parameters
    ----------
    executor
        To share out the runs with, ``None`` without workers.
    folder
        For what the workers share.
    """

    executor: Executor | None = None
    folder: Path | None = None

    def shared(self, work: Callable[Arguments, Answer]) -> Callable[Arguments, Answer]:
        """A work that every worker reads once, instead of with every run: logs are large."""
        if self.folder is None:
            return work
        place = self.folder / f"{len(list(self.folder.iterdir()))}.pickle"
        place.write_bytes(pickle.dumps(work))
        return _Shared(str(place))


@contextmanager
def pool(workers: int | None) -> Iterator[Pool]:
    """Workers for as long as the context lasts; ``None`` for none.

    Parameters
    ----------
    workers
        How many. Work and answers must pickle.
    """
    if workers is None:
        yield Pool()
        return
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        with scratch_folder() as folder:
            # Processes that start afresh: a copy of one with threads may hang.
            context = multiprocessing.get_context("spawn")
            executor = ProcessPoolExecutor(workers, mp_context=context, initializer=_begin)
            try:
                yield Pool(executor, folder)
            finally:
                _end(executor)
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _end(executor: ProcessPoolExecutor) -> None:
    """End the workers at once: whoever leaves the pool waits for no run."""
    processes = list((getattr(executor, "_processes", None) or {}).values())
    executor.shutdown(wait=False, cancel_futures=True)
    for process in processes:
        with contextlib.suppress(OSError, ValueError):
            process.kill()


def _begin() -> None:
    """The beginning of a worker."""
    import warnings

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()
    warnings.simplefilter("ignore")


@lru_cache(maxsize=4)
def _read(place: str) -> Callable[..., Any]:
    work: Callable[..., Any] = pickle.loads(Path(place).read_bytes())
    return work


@dataclass(frozen=True)
class _Shared(Generic[Answer]):
    """A work in a file."""

    place: str

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        return _read(self.place)(*arguments, **named)
