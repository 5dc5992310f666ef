"""How commands print: results to standard output, everything else to standard error.

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
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from rotorid.data.display import listed
from rotorid.data.findings import SEVERITIES, without_repeated
from rotorid.io.formats import PACKED
from rotorid.letters import visible

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.table import Table

    from rotorid.data.findings import Finding, Severity
    from rotorid.documents.base import FindingDocument
    from rotorid.errors import RotoridError

Item = TypeVar("Item")

INKS = {"green": "green", "yellow": "yellow", "red": "bold red", "gray": "dim"}
"""Terminal styles of the colors of a verdict."""


class _Patient(io.FileIO):
    """Standard output that drops the rest when its reader stops reading, as ``head`` does."""

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
    """Hide warnings of libraries about numbers, unless Python was started with its own warning options."""
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
"""Report the current step; :func:`progress` shows it."""

_PERCENT = re.compile(r"(\d{1,9}(?:\.\d{1,9})?) ?%")
_NUMBER = re.compile(r"(?<!\w)\d{1,9}(?:\.\d{1,9})?")
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
    """Print a sentence to standard error; on a terminal the name of the program in color."""
    shown = visible(text).replace("\n", "\\n")
    if not (shown.startswith(_NAME) and sys.stderr.isatty()):
        print(shown, file=sys.stderr)
        return
    from rich.text import Text

    error_console().print(Text.assemble((_NAME, "bold red"), shown.removeprefix(_NAME)), soft_wrap=True)


def for_reader(text: str) -> str:
    """A text of the library for the command that was typed: an option of another command comes with its name."""
    from rotorid.settings.verbs import VERBS, with_verbs

    commands = {verb for verbs in VERBS.values() for verb in verbs}
    return with_verbs(text, next((word for word in sys.argv[1:] if word in commands), "review"))


def print_refusal(
    error: RotoridError, findings: Sequence[Finding | FindingDocument], results: Path, *, quiet: bool
) -> None:
    """Print why there is no result to standard error, and warn of results of an earlier run in the same folder."""
    say(f"rotorid: {for_reader(str(error))}")
    for finding in () if quiet else without_repeated([finding for finding in findings if finding.severity != "info"]):
        say(f"  {finding.kind}: {for_reader(finding.message)}")
    if results.exists():
        say(f"rotorid: the results in {results.parent} are from an earlier run")


MOST_LINES = 40
"""Lines that a normal run of a command prints at most; ``-v`` prints everything."""

MOST_ROWS = 12
MOST_FINDINGS = 4


def fold(items: Sequence[Item], *, verbose: bool, most: int = MOST_ROWS) -> Sequence[Item]:
    """The first few items, or all with ``-v``; a single item too many stays, as the line that counts it is no shorter.

    Examples
    --------
    >>> fold("abcde", verbose=False, most=3), fold("abcde", verbose=True, most=3), fold("abcd", verbose=False, most=3)
    ('abc', 'abcde', 'abcd')
    """
    return items if verbose or len(items) <= most + 1 else items[:most]


def more_words(count: int, item: str, page: str = "report.html") -> str:
    """How many items were left out, and where they are.

    Examples
    --------
    >>> more_words(12, "note"), more_words(2, "topic", page="")
    ('12 more notes: -v shows all, or open report.html', '2 more topics: -v shows all')
    """
    return f"{count} more {item}{'s' * (count != 1)}: -v shows all{f', or open {page}' if page else ''}"


def print_table(
    table: Table,
    rows: Sequence[Sequence[RenderableType]],
    *,
    verbose: bool,
    item: str = "row",
    most: int = MOST_ROWS,
    page: str = "report.html",
) -> None:
    """Print a table with its first few rows, or all with ``-v``, and count the others.

    Parameters
    ----------
    table
        Its columns; the rows are added here.
    item
        What a row is, for the line that counts the others: ``parameter``, ``maneuver``.
    page
        Where all rows are; empty for nowhere.
    """
    shown = fold(rows, verbose=verbose, most=most)
    for row in shown:
        table.add_row(*row)
    output_console().print(table)
    _print_more(len(rows) - len(shown), item, page)


def print_lines(
    lines: Sequence[str], *, verbose: bool, item: str = "line", most: int = MOST_ROWS, page: str = "report.html"
) -> None:
    """Print the first few lines, or all with ``-v``, and count the others."""
    console, shown = output_console(), fold(lines, verbose=verbose, most=most)
    for line in shown:
        # Names come from the log: brackets in them are no markup.
        console.print(line, markup=False, soft_wrap=True)
    _print_more(len(lines) - len(shown), item, page)


def _print_more(count: int, item: str, page: str) -> None:
    if count:
        output_console().print(more_words(count, item, page), style="dim", markup=False, soft_wrap=True)


_Key: TypeAlias = tuple["Severity", str, str]
"""Severity, kind and message of a finding."""


def print_findings(
    findings: Sequence[Finding | FindingDocument],
    given: Sequence[Path] = (),
    *,
    verbose: bool = False,
    most: int = MOST_FINDINGS,
    page: str = "report.html",
) -> None:
    """Print all errors and the first few warnings, each once with its count; with ``-v`` all findings.

    Parameters
    ----------
    given
        Files of the command line: a command within a message names them as they were given.
    verbose
        Print all, notes too.
    most
        How many to print without ``-v``, unless there are more errors: the first of each kind before the second of any.
    page
        Where all findings are; empty for nowhere.
    """
    console = output_console()
    wanted = [finding for finding in findings if verbose or finding.severity != "info"]
    counted = _joined(
        Counter((finding.severity, finding.kind, finding.message) for finding in without_repeated(wanted))
    )
    kinds: Counter[str] = Counter()
    order = {}
    for key in counted:
        kinds[key[1]] += 1
        order[key] = SEVERITIES.index(key[0]), kinds[key[1]]
    distinct = sorted(counted, key=order.__getitem__)
    errors = sum(severity == "error" for severity, _, _ in distinct)
    most = max(most, errors)
    merged = dict.fromkeys(distinct, 1)
    if len(fold(distinct, verbose=verbose, most=most)) < len(distinct):
        merged = _worst_of_each_kind(distinct)
    shown = fold([*merged], verbose=verbose, most=most)
    for key in shown:
        severity, kind, message = key
        times = counted[key]
        count = f" (worst of {merged[key]})" if merged[key] > 1 else f" ({times} times)" if times > 1 else ""
        console.print(severity, style=_STYLES.get(severity, "bold"), end="")
        console.print(f" {kind}{count}: ", end="")
        words, found, command = message.partition(_COMMAND)
        for file in given if found else ():
            command = as_given(f"{_COMMAND}{command}", file).removeprefix(_COMMAND)
        # A command that is broken into lines cannot be copied.
        console.print(f"{words}{found}{command}", markup=False, soft_wrap=bool(found))
    _print_more(len(distinct) - len(shown), "warning", page)


def _joined(counted: Counter[_Key]) -> Counter[_Key]:
    """Findings that say the same behind their first comma, at length, as one: three slow topics have one remedy."""
    heads: dict[_Key, list[tuple[str, int]]] = {}
    for (severity, kind, message), times in counted.items():
        head, _, rest = message.partition(", ")
        head, rest = (head, rest) if len(rest) > len(head) else (message, "")
        heads.setdefault((severity, kind, rest), []).append((head, times))
    together: Counter[_Key] = Counter()
    for (severity, kind, rest), same in heads.items():
        parts = [(listed([head for head, _ in same]), 1)] if rest and all(times == 1 for _, times in same) else same
        for head, times in parts:
            together[severity, kind, f"{head}, {rest}" if rest else head] = times
    return together


def _worst_of_each_kind(findings: Sequence[_Key]) -> dict[_Key, int]:
    """The worst warning of each kind with how many there are; errors stay apart.

    Messages of a kind differ in their numbers: the worst has the largest percentage, then the largest number.
    """
    kinds: dict[tuple[str, ...], list[_Key]] = {}
    for finding in findings:
        kinds.setdefault(finding if finding[0] == "error" else finding[:2], []).append(finding)
    return {max(many, key=lambda finding: _largest(finding[2])): len(many) for many in kinds.values()}


def _largest(message: str) -> tuple[float, float]:
    """The largest percentage of a message and its largest number, zero where there is none."""
    percents, numbers = _PERCENT.findall(message), _NUMBER.findall(message)
    return max(map(float, percents), default=0.0), max(map(float, numbers), default=0.0)


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
        """Show a message; a lost interrupt is raised here, unless the work has understood it."""
        if getattr(record, "understood", False):
            _asked.clear()
            say(f"{_NAME} {record.getMessage()}; Ctrl-C again ends the command")
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
    """Seconds in a suitable unit.

    Examples
    --------
    >>> _duration(41.3), _duration(150.0), _duration(5000.0)
    ('41 s', '2.5 min', '1.4 h')
    """
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.1f} min" if seconds < 3600.0 else f"{seconds / 3600.0:.1f} h"


def _line(text: str, share: float | None) -> RenderableType:
    """The current step, with a bar if it is counted."""
    from rich.progress_bar import ProgressBar
    from rich.table import Table
    from rich.text import Text

    # Names come from the user's files: brackets in them are no markup.
    if share is None:
        return Text(text)
    line = Table.grid(padding=(0, 1))
    line.add_row(ProgressBar(total=1.0, completed=share, width=_BAR_SIGNS), Text(text))
    return line


_PULSE_S = 10.0
"""Least time between lines of progress in a pipe."""

_SAME_STEPS = 6
"""A step that takes longer is printed again after as many."""

_STEP_SIGNS = 80


def _first_words(step: str) -> str:
    """A step without the reasons behind it, which are printed with the result."""
    return step if len(step) <= _STEP_SIGNS else f"{step[:_STEP_SIGNS].rsplit(' ', 1)[0]} …"


@contextmanager
def _lines_of_progress() -> Iterator[Callable[[str, float | None], None]]:
    """A function that takes the current step; a new one is printed every 10 s, one that takes longer every minute."""
    started_s, ended, state = time.monotonic(), threading.Event(), ["working"]
    printed, printed_s = "", started_s

    def update(text: str, share: float | None) -> None:
        state[0] = text if share is None else f"{text} ({100.0 * share:.0f} % done)"

    def pulse() -> None:
        nonlocal printed, printed_s
        while not ended.wait(_PULSE_S):
            step, now_s = _first_words(state[0]), time.monotonic()
            if step != printed or now_s - printed_s >= _SAME_STEPS * _PULSE_S:
                printed, printed_s = step, now_s
                say(f"{_NAME} {_duration(now_s - started_s)}: {step}")

    thread = threading.Thread(target=pulse, daemon=True)
    thread.start()
    try:
        yield update
    finally:
        ended.set()
        thread.join()


@contextmanager
def progress(*, quiet: bool) -> Iterator[Callable[[str], None]]:
    """Show the current step: one line on a terminal, in a pipe a line every 10 s at most."""
    console = error_console()
    logger = _PROGRESS
    with contextlib.ExitStack() as stack:
        if quiet:
            handler = _Status(lambda _text, _share: None)
        elif not console.is_terminal:
            handler = _Status(stack.enter_context(_lines_of_progress()))
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
    """The default folder for results, named after the logs and the command.

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
