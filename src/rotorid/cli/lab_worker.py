"""A worker of the lab: one command of the command line, which tells its progress in lines of JSON."""

from __future__ import annotations

import contextlib
import json
import logging
import math
import sys
from pathlib import Path

from rotorid.io.children import end_with_parent


class _Told(logging.Handler):
    """Progress as lines of JSON on standard error."""

    def emit(self, record: logging.LogRecord) -> None:
        """One line."""
        if (cost := getattr(record, "cost", None)) is not None:
            if math.isfinite(cost):
                self._tell({"cost": cost})
            return
        self._tell(
            {
                "words": record.getMessage(),
                "done": getattr(record, "done", None),
                "total": getattr(record, "total", None),
            }
        )

    @staticmethod
    def _tell(told: dict[str, object]) -> None:
        sys.stderr.write(json.dumps({"progress": told}) + "\n")
        sys.stderr.flush()


def main() -> None:
    """Limit this process, then do what the words say."""
    memory_bytes = int(sys.argv.pop(1))
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    end_with_parent()
    log = logging.getLogger("rotorid.progress")
    log.setLevel(logging.DEBUG)
    log.addHandler(_Told())
    if sys.argv[1] == "read":
        _read(Path(sys.argv[2]), Path(sys.argv[3]))
        return
    from rotorid.cli.app import main as command

    command()


def _read(log: Path, folder: Path) -> None:
    """Write the tracks of a log as arrays, and its inspection."""
    from rotorid.cli.console import say
    from rotorid.errors import RotoridError
    from rotorid.lab.tracks import write_tracks

    try:
        write_tracks(log, folder)
    except RotoridError as error:
        say(f"rotorid: {error}")
        sys.exit(error.exit_code)


if __name__ == "__main__":
    main()
