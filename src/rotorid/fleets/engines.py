"""Engines that run a fleet: processes of this machine, or workers of a Dask cluster.

Both do the same with the same log, since both let a child do it (:mod:`rotorid.fleets.worker`): one that is limited in
memory and time, whose end costs its log's attempt and nothing else. A log whose attempts ended two children is set
aside, with what ended them.
"""

from __future__ import annotations

import contextlib
import json
import os
import platform
import queue
import threading
import time
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from importlib import import_module, metadata
from typing import IO, Any, Protocol

from rotorid import __version__
from rotorid.data.base import Immutable
from rotorid.errors import LogError, UsageError
from rotorid.fleets.places import fetched
from rotorid.fleets.table import MEMBER, Failure, LogAnswer
from rotorid.fleets.work import Task, failure
from rotorid.io.copies import Program, Running
from rotorid.io.folders import scratch_folder

_LOGS_OF_A_CHILD = 200
"""Logs after which a child is replaced."""

_START_S = 120.0

_MOST_TRIES = 2
"""Tries after which a log is set aside."""

_PATIENCE_S = 120.0
_CONNECT_S = 30.0
_LIBRARIES = ("numpy", "scipy", "numba")
_WORK = "rotorid.fleets.work:answer"
_READY = b"ready\n"
_PROGRAM = "rotorid.fleets.worker"
_ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"), "1")


@dataclass(frozen=True, kw_only=True)
class Limits(Immutable):
    """Limits for one log.

    Parameters
    ----------
    memory_bytes
        Beyond what the program itself takes; on Linux.
    timeout_s
        From when it is given to a worker.
    work
        ``module:function`` that makes an answer of a task.
    """

    memory_bytes: int = 4 << 30
    timeout_s: float = 600.0
    work: str = _WORK


class Engine(Protocol):
    """Anything that makes answers out of tasks, in any order."""

    def run(self, tasks: Iterable[Task]) -> Iterator[LogAnswer]:
        """Answer every task once; whoever closes the iterator ends the work."""
        ...

    @property
    def workers(self) -> int:
        """How many logs are read at once."""
        ...


class _DiedError(Exception):
    """A child ended before it had answered."""

    def __init__(self, kind: Failure, reason: str) -> None:
        super().__init__(reason)
        self.kind: Failure = kind


class Child:
    """A process that answers one log after the other, and is replaced when it ends or has answered many.

    Parameters
    ----------
    limits
        Of each log.
    program
        What it runs; all children of a fleet have the same, whose imports are done once.
    """

    def __init__(self, limits: Limits, program: Program) -> None:
        self._limits = limits
        self._program = program
        self._process: Running | None = None
        self._asks: IO[bytes] | None = None
        self._answers: queue.Queue[bytes] = queue.Queue()
        self._given = 0

    @property
    def pid(self) -> int | None:
        """Number of the process."""
        return self._process.pid if self._process else None

    def ask(self, task: Task) -> LogAnswer:
        """The answer of one log.

        Raises
        ------
        _DiedError
            The child died, or had to be ended.
        """
        if self._process is None or self._given >= _LOGS_OF_A_CHILD:
            self.close()
            self._start()
        asks = self._asks
        assert asks is not None
        self._given += 1
        try:
            # The first log of a child waits for its imports, which are not on its account.
            line = self._answers.get(timeout=_START_S) if self._given == 1 else _READY
            if line == _READY:
                asks.write((json.dumps(task.as_json()) + "\n").encode())
                asks.flush()
                line = self._answers.get(timeout=self._limits.timeout_s)
        except queue.Empty:
            self.close()
            raise _DiedError("time", f"It had not ended after {self._limits.timeout_s:g} s.") from None
        except OSError:
            line = b""
        if line:
            with contextlib.suppress(ValueError):
                return LogAnswer.from_json(line.decode())
        code = self.close()
        why = f"signal {-code}" if code < 0 else f"code {code}"
        raise _DiedError("died", f"The worker that read it ended with {why}.")

    def _start(self) -> None:
        words = [str(self._limits.memory_bytes), self._limits.work]
        asked, asks = os.pipe()
        answers, answered = os.pipe()
        self._asks, stdout = open(asks, "wb"), open(answers, "rb")  # noqa: PTH123, SIM115
        self._answers, self._given = queue.Queue(), 0
        with open(os.devnull, "wb") as nowhere, open(asked, "rb"), open(answered, "wb"):  # noqa: PTH123
            self._process = self._program.start(words, stdin=asked, stdout=answered, stderr=nowhere.fileno())
        threading.Thread(target=_listen, args=(stdout, self._answers), daemon=True).start()

    def close(self) -> int:
        """End it with everything that it started; its exit code."""
        process, self._process = self._process, None
        if process is None:
            return 0
        # What it was about to say of itself is waited for, shortly.
        with contextlib.suppress(TimeoutError):
            process.wait(0.05)
        process.end()
        if self._asks is not None:
            with contextlib.suppress(OSError):
                self._asks.close()
        return process.wait()


def _listen(stdout: IO[bytes], answers: queue.Queue[bytes]) -> None:
    """Lines of a child, and an empty one when no more come."""
    with contextlib.suppress(ValueError, OSError), stdout:
        for line in stdout:
            answers.put(line)
    answers.put(b"")


@dataclass(eq=False)
class Processes:
    """Processes of this machine.

    Parameters
    ----------
    workers
        How many.
    limits
        Of each log.
    """

    workers: int
    limits: Limits = field(default_factory=Limits)

    def run(self, tasks: Iterable[Task]) -> Iterator[LogAnswer]:
        """Answer every task once."""
        waiting = iter(tasks)
        again: deque[Task] = deque()
        tries: dict[str, int] = {}
        lock = threading.Lock()
        found: queue.Queue[LogAnswer | BaseException | None] = queue.Queue()
        ended = threading.Event()
        program = Program(_PROGRAM, environment=_ONE_THREAD)
        children = [Child(self.limits, program) for _ in range(self.workers)]
        busy = 0

        def take() -> Task | None:
            nonlocal busy
            while not ended.is_set():
                with lock:
                    task = next(waiting, None)
                    if task is None and again:
                        task = again.popleft()
                    if task is not None:
                        busy += 1
                        return task
                    if busy == 0:
                        return None
                # Somebody else's log may come back.
                time.sleep(0.02)
            return None

        def work(child: Child) -> None:
            nonlocal busy
            try:
                while (task := take()) is not None:
                    try:
                        answer: LogAnswer | None = child.ask(task)
                    except _DiedError as error:
                        with lock:
                            count = tries[task.place.address] = tries.get(task.place.address, 0) + 1
                            if count < _MOST_TRIES:
                                again.append(task)
                        answer = None if count < _MOST_TRIES else _set_aside(task, error.kind, str(error))
                    if answer is not None:
                        found.put(answer)
                    with lock:
                        busy -= 1
            # Whatever goes wrong here is raised where the answers are awaited.
            except BaseException as error:
                found.put(error)
            finally:
                found.put(None)

        threads = [threading.Thread(target=work, args=(child,), daemon=True) for child in children]
        for thread in threads:
            thread.start()
        try:
            left = len(threads)
            while left:
                answer = found.get()
                if answer is None:
                    left -= 1
                elif isinstance(answer, BaseException):
                    raise answer
                else:
                    yield answer
        finally:
            ended.set()
            for child in children:
                child.close()
            program.close()


def _set_aside(task: Task, kind: Failure, reason: str) -> LogAnswer:
    return failure(task, kind, f"{reason} It was tried {_MOST_TRIES} times and set aside.")


# A Dask cluster


def _content(task: Task) -> bytes:
    with fetched(task.place) as log:
        return log.read_bytes()


def _require_version(theirs: str) -> None:
    """Refuse what a worker of another version answered, for the whole run: it is no fault of the log."""
    if theirs != __version__:
        raise UsageError(
            f"a worker of the cluster has rotorid {theirs}",
            needed=f"rotorid {__version__} on every worker",
            remedy="replace it, then run the same command again: finished logs are kept",
        )


_children: dict[tuple[int, Limits], Child] = {}
_of_cluster = Program(_PROGRAM, environment=_ONE_THREAD)


def answer_here(task: dict[str, Any], limits: Limits, data: bytes | None = None) -> dict[str, Any]:
    """The task of a cluster worker: run it in a child process.

    Returns
    -------
    dict
        ``answer`` as a line, ``died`` with its reason, or ``unseen`` where this machine has no such file.
    """
    asked = Task.from_json(task)
    key = threading.get_ident(), limits
    child = _children.setdefault(key, Child(limits, _of_cluster))
    address = asked.place.address
    with contextlib.ExitStack() as stack:
        if data is not None:
            copy = stack.enter_context(scratch_folder()) / asked.place.file_name
            copy.write_bytes(data)
            asked = Task.from_json({**task, "copy": str(copy)})
        elif not asked.place.remote and not any(map(os.path.exists, (address, address.partition(MEMBER)[0]))):
            return {"unseen": True}
        try:
            return {"answer": child.ask(asked).as_json(), "version": __version__}
        except _DiedError as error:
            return {"died": error.kind, "reason": str(error)}


def versions_here() -> dict[str, str]:
    """Versions that results follow from."""
    found = {"rotorid": __version__, "python": ".".join(platform.python_version_tuple()[:2])}
    for name in _LIBRARIES:
        with contextlib.suppress(metadata.PackageNotFoundError):
            found[name] = metadata.version(name)
    return found


@dataclass(eq=False)
class Cluster:
    """The workers of a Dask scheduler.

    Parameters
    ----------
    scheduler
        Its address, such as ``tcp://10.0.0.1:8786``, or a ``dask.distributed.Client``.
    limits
        Of each log.
    patience_s
        For a scheduler that is being restarted, and for workers to come.

    Raises
    ------
    UsageError
        Dask is missing, the scheduler cannot be reached, or its workers have other versions.
    """

    scheduler: Any
    limits: Limits = field(default_factory=Limits)
    patience_s: float = _PATIENCE_S

    def __post_init__(self) -> None:
        try:
            self._dask = import_module("distributed")
        except ImportError as error:
            raise UsageError("--scheduler needs Dask", remedy="pip install 'rotorid[cluster]'") from error
        self._own = isinstance(self.scheduler, str)
        self._client = self._connected(_CONNECT_S) if self._own else self.scheduler
        self._require_versions()

    def _connected(self, timeout_s: float) -> Any:
        address = self.scheduler if self._own else self._client.scheduler.address
        try:
            client = self._dask.Client(address, timeout=timeout_s, set_as_default=False)
            client.wait_for_workers(1, timeout=timeout_s)
        # Its own errors are of many kinds, and an address may be anything.
        except Exception as error:
            raise UsageError(
                f"the scheduler {address} cannot be reached: {' '.join(str(error).split())[:200]}",
                needed="the address of a Dask scheduler with workers, such as tcp://HOST:8786",
            ) from error
        return client

    def _require_versions(self) -> None:
        own = versions_here()
        try:
            found = self._client.run(versions_here)
        # A worker without rotorid fails while it takes the function in.
        except Exception as error:
            raise UsageError(
                f"the workers cannot run rotorid: {' '.join(str(error).split())[:200]}",
                needed=f"rotorid {__version__} on every worker",
            ) from error
        for worker, theirs in found.items():
            other = {name: (theirs.get(name), own[name]) for name in own if theirs.get(name) != own[name]}
            if other:
                words = ", ".join(f"{name} {there} there and {here} here" for name, (there, here) in other.items())
                raise UsageError(f"the worker {worker} has {words}", needed="the same versions on every machine")

    @property
    def workers(self) -> int:
        """How many logs are read at once."""
        return max(int(sum(self._client.nthreads().values())), 1)

    def run(self, tasks: Iterable[Task]) -> Iterator[LogAnswer]:
        """Answer every task once."""
        waiting = iter(tasks)
        again: deque[tuple[Task, bytes | None]] = deque()
        tries: dict[str, int] = {}
        running: dict[Any, Task] = {}
        exhausted = False
        try:
            while True:
                while len(running) < 2 * self.workers and not (exhausted and not again):
                    entry = (next(waiting, None), None) if not exhausted else again.popleft()
                    if entry[0] is None:
                        exhausted = True
                        continue
                    running[self._submit(entry[0], entry[1])] = entry[0]
                if not running:
                    return
                for future in self._finished(running):
                    task = running.pop(future)
                    answer = self._result(future)
                    if "answer" in answer:
                        _require_version(answer["version"])
                        yield LogAnswer.from_json(answer["answer"])
                    elif "unseen" in answer:
                        # The workers do not have its disk.
                        try:
                            again.append((task, _content(task)))
                        except (LogError, OSError) as error:
                            yield failure(task, "unreachable", str(error))
                    elif "lost" in answer:
                        again.append((task, None))
                    else:
                        tries[task.place.address] = tries.get(task.place.address, 0) + 1
                        if tries[task.place.address] < _MOST_TRIES:
                            again.append((task, None))
                        else:
                            yield _set_aside(task, answer["died"], answer["reason"])
        finally:
            with contextlib.suppress(Exception):
                self._client.cancel(list(running))
            if self._own:
                with contextlib.suppress(Exception):
                    self._client.close(timeout=5)

    def _submit(self, task: Task, data: bytes | None) -> Any:
        until = time.monotonic() + self.patience_s
        while True:
            try:
                sent = None if data is None else self._client.scatter(data, hash=False)
                return self._client.submit(answer_here, task.as_json(), self.limits, sent, pure=False)
            # While a scheduler restarts, its client raises errors of many kinds: until patience ends all mean "again".
            except Exception:
                if time.monotonic() > until:
                    raise
                self._again()

    def _finished(self, running: dict[Any, Task]) -> list[Any]:
        """Futures that ended in any way; all of them where the scheduler was lost."""
        passing = TimeoutError, self._dask.TimeoutError, self._dask.CancelledError
        with contextlib.suppress(*passing), self._client.as_current():
            self._dask.wait(list(running), timeout=2.0, return_when="FIRST_COMPLETED")
        done = [future for future in running if future.status != "pending"]
        if not done and self._client.status not in ("running",):
            self._again()
            return list(running)
        return done

    def _result(self, future: Any) -> dict[str, Any]:
        if future.status in ("cancelled", "lost", "pending"):
            return {"lost": True}
        try:
            answer: dict[str, Any] = future.result(timeout=30)
        except self._dask.KilledWorker:
            return {"died": "died", "reason": "It was being read when several workers of the cluster ended."}
        # Whatever a cluster does to a task, its log is tried again.
        except Exception as error:
            return {"died": "error", "reason": f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"}
        return answer

    def _again(self) -> None:
        """Wait for the scheduler, and connect anew where the connection does not come back by itself."""
        until = time.monotonic() + self.patience_s
        while time.monotonic() < until:
            time.sleep(0.5)
            if self._client.status == "running":
                return
            if self._client.status == "closed":
                with contextlib.suppress(UsageError):
                    self._client = self._connected(10.0)
                    return
        raise UsageError(
            f"the scheduler did not answer for {self.patience_s:g} s",
            remedy="start it, then run the same command again: finished logs are kept",
        )
