"""A worker of a server: one command of the command line, which reports its progress in lines of JSON."""

from __future__ import annotations

import contextlib
import json
import logging
import math
import sys
from pathlib import Path

from rotorid.io.children import end_with_parent


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


def main() -> None:
    """Limit this process, then do what the words say; whatever goes wrong is said in the last line."""
    from rotorid.cli.console import say
    from rotorid.errors import RotoridError
    from rotorid.lab.workers import EXIT_WITH_REASON

    limits = json.loads(sys.argv.pop(1))
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
        _do(sys.argv[1:])
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
    main()
