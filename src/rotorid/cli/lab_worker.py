"""A worker of a server: one command of the command line, which reports its progress in lines of JSON."""

from __future__ import annotations

import contextlib
import json
import logging
import math
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from rotorid.io.children import end_with_parent

_COMMANDS = [f"cli.{name}" for name in ("app", "models", "response", "identify", "verify", "tune", "export", "review")]
_NEEDED = (
    "lab.tracks",
    "documents.inspection",
    "loops.responses",
    "documents.response",
    "report.response",
    "identifying.cross_validation",
    "identifying.identification",
    "identifying.identify_many",
    "identifying.motors",
    "identifying.verification",
    "search.multistart",
    "simulation.linear_kernels",
    "verification.kernels",
    "documents.results",
    "report.identification",
    "documents.verify",
    "report.verification",
    "proposing.proposal",
    "documents.tune",
    "report.tune",
    "exports.exporting",
    "documents.export",
    "documents.vehicle",
    "reviewing.assembly",
    "documents.review",
    "report.review",
    "report.files",
    "report.publication",
    "report.several",
)
"""Where the work of these commands is done; what they import on the way they import themselves."""

_LIBRARIES = ("scipy.integrate", "scipy.ndimage", "scipy.signal", "jinja2", "rich.table")


class _JsonProgress(logging.Handler):
    """Progress as lines of JSON on standard error."""

    def emit(self, record: logging.LogRecord) -> None:
        """One line."""
        if (cost := getattr(record, "cost", None)) is not None:
            if math.isfinite(cost):
                self._write({"cost": cost})
            return
        self._write(
            {
                "words": record.getMessage(),
                "done": getattr(record, "done", None),
                "total": getattr(record, "total", None),
            }
        )

    @staticmethod
    def _write(fields: dict[str, object]) -> None:
        sys.stderr.write(json.dumps({"progress": fields}) + "\n")
        sys.stderr.flush()


def prepare() -> None:
    """Import what steps and readers of logs need, before anybody waits for them."""
    for module in (*(f"rotorid.{name}" for name in (*_COMMANDS, *_NEEDED)), *_LIBRARIES):
        import_module(module)


def begin(words: Sequence[str]) -> None:
    """Limit this process, then do what the words say; whatever goes wrong is said in the last line."""
    from rotorid.cli.console import say
    from rotorid.errors import RotoridError
    from rotorid.lab.workers import EXIT_WITH_REASON

    limits, *words = words
    sys.argv = [sys.argv[0], *words]
    limits = json.loads(limits)
    memory_bytes = limits["memory_bytes"]
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    end_with_parent()
    if "writable" in limits:
        _keep_to(limits["readable"], limits["writable"])
    log = logging.getLogger("rotorid.progress")
    log.setLevel(logging.DEBUG)
    log.addHandler(_JsonProgress())
    try:
        _do(words)
    except RotoridError as error:
        say(f"rotorid: {error}")
        sys.exit(error.exit_code)
    except MemoryError:
        say(f"rotorid: it needed more memory than the {memory_bytes / 2**30:g} GiB that a command has")
        sys.exit(EXIT_WITH_REASON)
    except Exception as error:
        # The page shows the last line that a worker says: a fault of ours is a sentence there too, not a traceback.
        say(f"rotorid: {type(error).__name__}: {error}")
        sys.exit(EXIT_WITH_REASON)


def _keep_to(readable: list[str], writable: list[str]) -> None:
    """Keep this process to some places, compiled code of commands like it and the user's preferences."""
    from rotorid.cli.preferences import place
    from rotorid.io.confinement import confine_files

    package = Path(__file__).resolve().parents[1]
    preferred = place()
    confine_files(
        readable=[*map(Path, readable), package, *([] if preferred is None else [preferred])],
        writable=[Path(place) for place in writable],
    )


def _do(words: list[str]) -> None:
    """Read a log into a folder, fly one first, or carry out a command."""
    if words[0] in ("read", "fly"):
        log, folder = Path(words[1]), Path(words[2])
        if words[0] == "fly":
            from rotorid.flying.demo import fly_demo

            logging.getLogger("rotorid.progress").info("flying")
            fly_demo(log, seed=0)
        from rotorid.lab.tracks import write_tracks

        write_tracks(log, folder)
        return
    from rotorid.cli.app import main as command

    command()


if __name__ == "__main__":
    begin(sys.argv[1:])
