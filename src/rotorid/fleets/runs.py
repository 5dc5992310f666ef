"""A fleet: its logs found, each answered once, the journal, the table.

The table does not depend on the order in which answers come: of logs with the same content the one whose address comes
first counts, and rows are sorted.
"""

from __future__ import annotations

import contextlib
import logging
import os
from collections import Counter
from collections.abc import Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from rotorid import __version__
from rotorid.errors import UsageError
from rotorid.fleets.engines import Cluster, Engine, Limits, Processes
from rotorid.fleets.identity import read_named, read_salt
from rotorid.fleets.places import Place, find_places
from rotorid.fleets.settings import FleetSettings
from rotorid.fleets.table import (
    FAILED,
    FILE,
    JOURNAL,
    PAGE,
    SALT,
    TABLE,
    Counts,
    Failed,
    Journal,
    LogAnswer,
    Row,
    require_parquet,
    require_table,
    settings_hash,
    sorted_failures,
    sorted_rows,
    write_table,
)
from rotorid.fleets.vehicles import separated
from rotorid.fleets.work import Task
from rotorid.io.files import sha256_of
from rotorid.io.folders import ResultKind, making, read_json, scratch_folder, target_folder
from rotorid.io.log_order import time_of
from rotorid.io.pool import cores
from rotorid.letters import visible
from rotorid.settings.option import as_settings
from rotorid.typing import FloatArray

if TYPE_CHECKING:
    from rotorid.settings.option_types import FleetOptions

_PROGRESS = logging.getLogger("rotorid.progress")
_LOCK = "fleet.lock"


class Fleet:
    """A run over many logs, to be iterated once.

    Parameters
    ----------
    paths
        Files, folders, patterns, archives, addresses.
    settings
        What is asked of each log.
    folder
        Where journal and tables are; what lies there is not done again.
    engine
        What carries it out; processes of this machine by default.
    force
        Overwrite also tables that are not rotorid's.

    Raises
    ------
    UsageError
        Nothing was found, a model is unknown, or foreign files are where the tables go.
    """

    def __init__(
        self,
        paths: Iterable[str | Path],
        settings: FleetSettings,
        folder: Path,
        *,
        engine: Engine | None = None,
        force: bool = False,
    ) -> None:
        self._limits = Limits(memory_bytes=settings.memory_bytes, timeout_s=settings.timeout_s)
        if engine is None and settings.scheduler is not None:
            engine = Cluster(settings.scheduler, self._limits)
        require_parquet()
        _require_models(settings.models)
        self.settings, self.folder = settings, folder
        self.named = read_named(settings.vehicles)
        found = find_places(paths)
        self.places, self.skipped = found.places, found.skipped
        self._target = target_folder(folder, folder, RESULT, force=force)
        _make(folder)
        self._claimed = _claim(folder)
        if not settings.resume:
            _forget(folder / JOURNAL)
        self._salt = read_salt(folder / SALT).decode("ascii", "replace")
        self._journal = Journal(folder / JOURNAL, self._salt)
        self._journal.read()
        self._hash = settings_hash(settings.as_json())
        self._engine = engine
        self.answers: dict[str, LogAnswer] = {}
        self.resumed = 0
        self.copies: dict[str, str] = {}

    @property
    def engine(self) -> Engine:
        """The engine of the run."""
        if self._engine is None:
            self._engine = Processes(min(self.settings.workers or cores(), len(self.places)), self._limits)
        return self._engine

    def __iter__(self) -> Iterator[LogAnswer]:
        """Answers as they come, those of earlier runs first; of logs with the same content one."""
        visited: set[str] = set()
        for answer in self._answers():
            named = self.answers[answer.place] = self._with_names(answer)
            if not named.log_sha256 or named.log_sha256 not in visited:
                visited.add(named.log_sha256)
                yield named

    def _answers(self) -> Iterator[LogAnswer]:
        """Answers as logs gave them: of earlier runs, of the same content elsewhere, and of this run."""
        missing = []
        for place in self.places:
            known = self._known(place)
            if known is None:
                missing.append(place)
                continue
            self.resumed += 1
            yield known
        missing, moved = self._without_copies(missing)
        for answer in moved:
            self.resumed += 1
            self._journal.add(answer)
            yield answer
        _PROGRESS.info("reading logs", extra={"done": len(self.places) - len(missing), "total": len(self.places)})
        tasks = (
            Task(place=place, asked=self.settings.as_json(), settings=self._hash, salt=self._salt) for place in missing
        )
        running = self.engine.run(tasks) if missing else iter(())
        try:
            for answer in running:
                self._journal.add(answer)
                yield answer
        finally:
            if isinstance(running, Generator):
                running.close()

    def _known(self, place: Place) -> LogAnswer | None:
        """The answer of an earlier run with this version and these settings for an unchanged log."""
        found = self._journal.known(place.address, self._hash)
        fits = found is not None and found.mark == place.mark and found.version == __version__ and found.done
        return found if fits else None

    def _without_copies(self, places: list[Place]) -> tuple[list[Place], list[LogAnswer]]:
        """Places whose content is not known yet, and answers of the others: only files of equal size are looked at."""
        known = {
            answer.log_sha256: answer
            for answer in self._journal.answers.values()
            if answer.settings == self._hash and answer.version == __version__ and answer.done and answer.log_sha256
        }
        sizes = Counter(_size(place.mark) for place in self.places)
        here = {self._journal.written(place.address) for place in self.places}
        sizes.update(_size(answer.mark) for answer in known.values() if answer.place not in here)
        first: dict[str, Place] = {}
        left, moved = [], []
        for place in places:
            if sizes[_size(place.mark)] < 2 or not place.is_file:
                left.append(place)
                continue
            content = sha256_of(Path(place.address))
            if content in known:
                moved.append(_moved(known[content], place))
            elif content in first:
                self.copies[place.address] = first[content].address
            else:
                first[content] = place
                left.append(place)
        return left, moved

    def _with_names(self, answer: LogAnswer) -> LogAnswer:
        """An answer with the names and times that the user gives, else those in the log's name."""
        keys = (answer.log, answer.place, answer.log_sha256)
        vehicle = self.named.of(self.named.vehicle, *keys)
        time_utc = self.named.of(self.named.time, *keys) or time_of(answer.place)
        return replace(
            answer,
            rows=tuple(replace(row, vehicle=vehicle or row.vehicle, time_utc=time_utc) for row in answer.rows),
            failed=tuple(replace(failure, vehicle=vehicle or failure.vehicle) for failure in answer.failed),
        )

    def counted(self) -> list[LogAnswer]:
        """Answers that count, in the order of their addresses: each content once."""
        counted: dict[str, LogAnswer] = {}
        for address in sorted(self.answers):
            answer = self.answers[address]
            counted.setdefault(answer.log_sha256 or address, answer)
        return list(counted.values())

    @property
    def duplicates(self) -> int:
        """Logs whose content had been there already."""
        return len(self.answers) - len(self.counted()) + len(self.copies)

    def rows(self) -> list[Row]:
        """The table, in which a name that stood for several vehicles is one no more."""
        return separated(self.logged_rows())[0]

    def counts(self) -> Counts:
        """Logs by what became of them."""
        counted = self.counted()
        read = [answer for answer in counted if answer.log_sha256]
        answered = sum(bool(answer.rows) for answer in counted)
        return Counts(
            logs=len(self.places),
            answered=answered,
            refused=sum(not answer.rows for answer in read),
            unreadable=len(counted) - len(read),
            duplicates=self.duplicates,
            resumed=self.resumed,
            rows=sum(len(answer.rows) for answer in counted),
            skipped=self.skipped,
        )

    def gains(self) -> Mapping[str, Mapping[str, float]]:
        """Gains that each log was flown with, by its hash."""
        return {answer.log_sha256: answer.gains for answer in self.counted() if answer.log_sha256 and answer.gains}

    def patterns(self) -> Mapping[str, FloatArray]:
        """Patterns over the rotors of each log that was reviewed, by its hash."""
        return {
            answer.log_sha256: np.array(answer.patterns)
            for answer in self.counted()
            if answer.log_sha256 and answer.patterns
        }

    def logged_rows(self) -> list[Row]:
        """Rows with vehicles as their logs name them, for :func:`rotorid.fleets.analyze`."""
        return sorted_rows(self.counted())

    def failures(self) -> list[Failed]:
        """The table of what failed."""
        return sorted_failures(self.counted())

    def write_tables(self) -> None:
        """Write both tables in one step; a page and a JSON file of an earlier run go with its tables."""
        with self.writing():
            pass

    @contextmanager
    def writing(self) -> Iterator[Path]:
        """A folder with both tables, for what goes with them; when the context ends well all of it appears in one step.

        Raises
        ------
        UsageError
            The folder cannot be written, or foreign files are in the way.
        """
        with making(self._target) as made:
            write_table(made.place / TABLE, self.rows(), Row)
            write_table(made.place / FAILED, self.failures(), Failed)
            yield made.place

    def close(self) -> None:
        """Let others use the folder."""
        if self._claimed is not None:
            os.close(self._claimed)
            self._claimed = None

    def groups(self) -> Mapping[str, str]:
        """Group of each log by its hash, where the user named groups."""
        return {
            answer.log_sha256: group
            for answer in self.counted()
            if (group := self.named.of(self.named.group, answer.log, answer.place, answer.log_sha256))
        }


def _size(mark: str) -> str:
    return mark.partition("-")[0]


def _moved(answer: LogAnswer, place: Place) -> LogAnswer:
    """The answer of the same content at another place."""
    name = visible(place.name)
    folder = visible(Path(answer.place).parent.name)
    new = visible(place.folder)

    def renamed(vehicle: str) -> str:
        return new if vehicle == folder else vehicle

    return replace(
        answer,
        log=name,
        place=place.address,
        mark=place.mark,
        rows=tuple(replace(row, log=name, vehicle=renamed(row.vehicle)) for row in answer.rows),
        failed=tuple(replace(failure, log=name, vehicle=renamed(failure.vehicle)) for failure in answer.failed),
    )


def _make(folder: Path) -> None:
    """Make the folder of a fleet, where its journal grows."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(
            f"{folder} cannot be used: {error.strerror or error}", needed="a folder that you may write to"
        ) from error


def _main_document(path: Path) -> Mapping[str, Any]:
    """What makes a folder a fleet's: its JSON, or of a run without a page its table."""
    if path.name == TABLE:
        try:
            require_table(path)
        except UsageError as error:
            raise ValueError(str(error)) from error
        return {"schema": "rotorid.fleet"}
    document: Mapping[str, Any] = read_json(path)
    return document


RESULT = ResultKind(
    mains=(FILE, TABLE), schema="rotorid.fleet", files=(PAGE, FAILED, "fleet.pdf"), reader=_main_document
)
"""What a fleet writes in one step."""


def _forget(journal: Path) -> None:
    try:
        journal.unlink(missing_ok=True)
    except OSError as error:
        raise UsageError(
            f"{journal} cannot be removed: {error.strerror}", needed="a folder that you may write to"
        ) from error


def _claim(folder: Path) -> int | None:
    """A lock of the folder, which ends with the process; ``None`` where the system has none."""
    try:
        import fcntl
    except ImportError:
        return None
    try:
        descriptor = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise UsageError(
            f"{folder / _LOCK} cannot be used: {error.strerror}", needed="a folder that you may write to"
        ) from error
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise UsageError(f"another run is working in {folder}", remedy="wait, or choose another --out") from None
    except OSError:
        os.close(descriptor)
        return None
    return descriptor


def _require_models(models: Iterable[str]) -> None:
    """Refuse a model that is not known, before any log is read."""
    from rotorid.settings.resolve import asked_model, read_model

    for name in models:
        if isinstance(read := read_model(name), str):
            asked_model(read)


def fleet(
    paths: Iterable[str | Path] | str | Path,
    *,
    settings: FleetSettings | None = None,
    out: Path | str | None = None,
    engine: Engine | None = None,
    **options: Unpack[FleetOptions],
) -> Iterator[Row]:
    """Read and identify many logs, and yield rows as they come.

    Parameters
    ----------
    paths
        Files, folders, patterns, archives, addresses such as ``s3://bucket/logs``.
    settings
        Choices; everything has a default.
    out
        Folder for the journal and the tables; with one, a run that is ended goes on where it was, and the tables are
        written at the end.
    engine
        :class:`rotorid.fleets.Processes` by default, or :class:`rotorid.fleets.Cluster` of a scheduler or a client.
    **options
        Fields of :class:`rotorid.fleets.FleetSettings`, which go before ``settings``.

    Returns
    -------
    iterator of Row
        One for each parameter of each model of each flight of each log. What failed is in ``failed.parquet``.

    Raises
    ------
    UsageError
        Nothing was found, or an option is wrong.

    Examples
    --------
    >>> import pandas  # doctest: +SKIP
    >>> table = pandas.DataFrame(fleet("logs", models=["rate.roll"], out="fleet"))  # doctest: +SKIP
    """
    chosen = as_settings(FleetSettings, settings, options)
    _require_models(chosen.models)
    require_parquet()
    listed = [paths] if isinstance(paths, str | Path) else list(paths)
    return _rows(listed, chosen, None if out is None else Path(out), engine)


def _rows(paths: list[str | Path], settings: FleetSettings, out: Path | None, engine: Engine | None) -> Iterator[Row]:
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(scratch_folder()) if out is None else out
        run = Fleet(paths, settings, folder, engine=engine)
        stack.callback(run.close)
        for answer in run:
            yield from answer.rows
        if out is not None:
            run.write_tables()
