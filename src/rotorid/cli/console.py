"""How commands speak: results to standard output, everything else to standard error.

What comes from files is shown as it is written: no name can color a terminal, clear it or turn its direction. Results
go to folders that are named after the logs (:func:`default_folder`).

Ctrl-C is never lost. Python raises an interrupt wherever it happens to be; while a kernel is compiled that may be
inside a callback from compiled code, which prints the exception and goes on. So an interrupt is remembered, and raised
again with the next thing that a command says about its progress.
"""

from __future__ import annotations

import contextlib
import io
import logging
import os
import re
import shlex
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from rotorid.data.display import visible
from rotorid.data.findings import without_repeated
from rotorid.io.formats import PACKED

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

    from rotorid.data.findings import Finding
    from rotorid.documents.base import FindingDocument
    from rotorid.errors import RotoridError

INKS = {"green": "green", "yellow": "yellow", "red": "bold red", "gray": "dim"}
"""How a terminal shows the color of a verdict."""


class _Patient(io.FileIO):
    """Standard output that goes on when its reader has read enough, as ``head`` has: the rest goes nowhere."""

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except BrokenPipeError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self.fileno())
            os.close(nowhere)
            return memoryview(data).nbytes


def patient_output() -> None:
    """Let no reader that goes away, and no letter that a terminal cannot show, end a command.

    The files of a result are written whoever reads along, and the exit code is that of the data. A sign that cannot be
    shown is a question mark. What libraries in machine code print (LAPACK its complaints) goes to standard error: it
    would be a line amid the JSON.
    """
    if sys.stdout is not sys.__stdout__ or not isinstance(sys.stdout, io.TextIOWrapper):
        return
    sys.stdout.flush()
    # Without buffers, so that a disk that is full is said by the command and not after it.
    own = io.BufferedWriter(_Patient(_own_output(sys.stdout.fileno()), "wb", closefd=False), buffer_size=1)
    sys.stdout = io.TextIOWrapper(own, encoding=sys.stdout.encoding, errors="replace", write_through=True)


def _own_output(number: int) -> int:
    """Another number for standard output, whose own number then is standard error; the same where that is closed."""
    try:
        own = os.dup(number)
        os.dup2(sys.__stderr__.fileno() if sys.__stderr__ else 2, number)
    except OSError:
        return number
    return own


def spare_warnings() -> None:
    """Keep what libraries say about numbers from a person, who reads findings, unless Python was told otherwise."""
    errors = any(action == "error" for action, *_ in warnings.filters)
    if not sys.warnoptions and not errors:
        warnings.simplefilter("ignore")


_asked = threading.Event()


def listen() -> None:
    """End on SIGINT and SIGTERM as on Ctrl-C, so that temporary files are removed."""
    _asked.clear()
    sys.unraisablehook = _unraisable
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _interrupt)


def check() -> None:
    """Raise an interrupt that was asked for and lost.

    Raises
    ------
    KeyboardInterrupt
        Somebody asked for it.
    """
    if _asked.is_set():
        raise KeyboardInterrupt


def _unraisable(lost: sys.UnraisableHookArgs) -> None:
    """Say nothing of an interrupt that a callback of a library lost: :func:`check` raises it again."""
    if not isinstance(lost.exc_value, KeyboardInterrupt):
        sys.__unraisablehook__(lost)


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    _asked.set()
    raise KeyboardInterrupt


_PROGRESS = logging.getLogger("rotorid.progress")
log_progress = _PROGRESS.info
"""Say what is being done: seen where :func:`progress` shows it."""

_PIPE_WIDTH = 240
_NAME = "rotorid:"
_BAR_SIGNS = 24
_STYLES = {"warning": "bold yellow", "error": "bold red"}


def error_console() -> Console:
    """Console on standard error."""
    return _console(stderr=True)


def output_console() -> Console:
    """Console on standard output; in a pipe wide enough that no table wraps."""
    console = _console()
    return console if console.is_terminal else _console(width=_PIPE_WIDTH)


def _console(**options: Any) -> Console:
    """A console on which names from files and models are seen, and do nothing to the terminal."""
    from rich.console import Console
    from rich.segment import Segment

    class Shown(Console):
        def render(self, *arguments: Any, **others: Any) -> Iterator[Segment]:
            for segment in super().render(*arguments, **others):
                # What the console itself asks of the terminal is marked as such.
                yield segment if segment.control else Segment(visible(segment.text), segment.style)

    return Shown(highlight=False, **options)


def say(text: str) -> None:
    """A plain sentence to standard error; on a terminal the name of the program in color."""
    shown = visible(text).replace("\n", "\\n")
    if not (shown.startswith(_NAME) and sys.stderr.isatty()):
        print(shown, file=sys.stderr)
        return
    from rich.text import Text

    error_console().print(Text.assemble((_NAME, "bold red"), shown.removeprefix(_NAME)), soft_wrap=True)


def print_refusal(
    error: RotoridError, findings: Sequence[Finding | FindingDocument], results: Path, *, quiet: bool
) -> None:
    """Why there is no result, to standard error; results of an earlier run are not mistaken for those of this one."""
    say(f"rotorid: {error}")
    for finding in () if quiet else without_repeated([finding for finding in findings if finding.severity != "info"]):
        say(f"  {finding.kind}: {finding.message}")
    if results.exists():
        say(f"rotorid: the results in {results.parent} are those of an earlier run")


def print_findings(findings: Sequence[Finding | FindingDocument], given: Sequence[Path] = ()) -> None:
    """Warnings and errors to standard output, what several places have in common once; remarks stand in the files.

    A command within a message names the files as they were given.
    """
    console = output_console()
    shown = without_repeated([f for f in findings if f.severity != "info"])
    distinct = dict.fromkeys((f.severity, f.kind, f.message) for f in shown)
    for severity, kind, message in distinct:
        console.print(severity, style=_STYLES.get(severity, "bold"), end="")
        console.print(f" {kind}: ", end="")
        words, found, command = message.partition(_COMMAND)
        for file in given if found else ():
            command = as_given(f"{_COMMAND}{command}", file).removeprefix(_COMMAND)
        # A command that is broken into lines cannot be copied.
        console.print(f"{words}{found}{command}", markup=False, soft_wrap=bool(found))


class _Status(logging.Handler):
    """Shows each message of the pipeline as what is being done.

    Work that is counted says how much of how much is done, ``extra={"done": 3, "total": 8}``, which is shown as a bar;
    from its second message on, the time that the rest takes at the same pace is shown too.
    """

    def __init__(self, show: Callable[[str, float | None], None]) -> None:
        super().__init__()
        self._show = show
        self._begun: dict[tuple[str, int], tuple[float, float, float]] = {}

    def emit(self, record: logging.LogRecord) -> None:
        """Show a message; a lost interrupt is raised here."""
        check()
        done, total = getattr(record, "done", None), getattr(record, "total", None)
        share = min(done / total, 1.0) if done is not None and total else None
        self._show(record.getMessage() + self._left(record, time.monotonic()), share)

    def _left(self, record: logging.LogRecord, now_s: float) -> str:
        done, total = getattr(record, "done", None), getattr(record, "total", None)
        if done is None or total is None:
            return ""
        # The same line speaks of the same work, until it counts from the beginning again.
        work = record.pathname, record.lineno
        first_s, first, last = self._begun.get(work, (now_s, done, done))
        if done == 0 or done < last:
            first_s, first = now_s, done
        self._begun[work] = first_s, first, done
        if not first < done < total:
            return ""
        return f", about {_duration((now_s - first_s) * (total - done) / (done - first))} left"


def _duration(seconds: float) -> str:
    """Seconds as one says them.

    Examples
    --------
    >>> _duration(41.3), _duration(150.0), _duration(5000.0)
    ('41 s', '2.5 min', '1.4 h')
    """
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.1f} min" if seconds < 3600.0 else f"{seconds / 3600.0:.1f} h"


def _line(text: str, share: float | None) -> RenderableType:
    """What is being done, behind a bar where it is counted."""
    from rich.progress_bar import ProgressBar
    from rich.table import Table
    from rich.text import Text

    # Names come from the user's files: brackets in them are no markup.
    if share is None:
        return Text(text)
    line = Table.grid(padding=(0, 1))
    line.add_row(ProgressBar(total=1.0, completed=share, width=_BAR_SIGNS), Text(text))
    return line


@contextmanager
def progress(*, quiet: bool) -> Iterator[Callable[[str], None]]:
    """A line on a terminal that says what is being done; nothing in a pipe."""
    console = error_console()
    logger = _PROGRESS
    with contextlib.ExitStack() as stack:
        if quiet or not console.is_terminal:
            handler = _Status(lambda _text, _share: None)
        else:
            status = stack.enter_context(console.status("reading"))
            handler = _Status(lambda text, share: status.update(_line(text, share)))
        before = logger.level, logger.propagate
        handler.setLevel(logging.INFO)
        logger.addHandler(handler)
        # The lab listens to every step of a fit.
        logger.setLevel(min(logger.level or logging.INFO, logging.INFO))
        logger.propagate = False
        try:
            yield logger.info
        finally:
            logger.removeHandler(handler)
            logger.setLevel(before[0])
            logger.propagate = before[1]


_NAME_SIGNS = 120
"""No file system takes names much longer than twice this."""


def default_folder(logs: Path | Sequence[Path], what: str) -> Path:
    """Where the results from logs go when the user does not say: named after the logs and what was done with them.

    Examples
    --------
    >>> default_folder(Path("logs/roll.ulg.xz"), "rate.roll").as_posix()
    'rotorid-out/roll-rate.roll'
    >>> default_folder([Path("a.BIN"), Path("b.BIN"), Path("c.BIN")], "delay").as_posix()
    'rotorid-out/a-and-2-more-delay'
    """
    from rotorid.cli.preferences import results_folder

    first, *more = [_stem(log) for log in ([logs] if isinstance(logs, Path) else logs)]
    others = "" if not more else f"-{more[0]}" if len(more) == 1 else f"-and-{len(more)}-more"
    return results_folder() / _file_name(f"{first}{others}-{what}")


def _file_name(text: str) -> str:
    """Text as the name of a folder: a model file may call itself anything."""
    return re.sub(r"[^\w.+-]+", "_", text).lstrip(".")[:_NAME_SIGNS] or "result"


def _stem(log: Path) -> str:
    """Name of a log without the extensions of its compression and its format."""
    return Path(log.stem if log.suffix.lower() in PACKED else log.name).stem


_TAKES_LOG = ("identify", "response", "review", "tune", "inspect")
_COMMAND = "rotorid design "
"""What a command within a message begins with."""

_TAKE_FILE = ("--map", "--gains", "--for-tune")


def as_given(command: str, file: Path, map: Path | None = None) -> str:
    """A command for a log with the paths by which log and mapping were named, so that it runs as it is printed.

    Results and pages name files without their folders, which are nobody's concern; a terminal knows where one is.

    Examples
    --------
    >>> as_given("rotorid identify 'my log.ulg' --model rate.roll", Path("logs/my log.ulg"))
    "rotorid identify 'logs/my log.ulg' --model rate.roll"
    >>> as_given("rotorid response roll --map m.toml --inputs roll", Path("logs/roll"), Path("maps/m.toml"))
    'rotorid response logs/roll --map maps/m.toml --inputs roll'
    """
    words = shlex.split(command)
    given = {Path(path.name): str(path) for path in (file, map) if path is not None}
    for place in range(2, len(words)):
        before = words[place - 1]
        if before in _TAKE_FILE or (place == 2 and before in _TAKES_LOG):
            words[place] = given.get(Path(words[place]), words[place])
    return shlex.join(words)
