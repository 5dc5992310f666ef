"""The command line."""

from __future__ import annotations

import sys


def main() -> None:
    """Entry point: the command line; where that cannot even start, the doctor says why."""
    try:
        from rotorid.cli.app import main as command

        command()
    except Exception:
        # A broken library may raise anything, also one that the command line itself is made of.
        if sys.argv[1:2] != ["doctor"]:
            raise
        from rotorid.cli.installation import examine

        words = sys.argv[2:]
        sys.exit(0 if examine(self_test="--no-self-test" not in words, json="--json" in words) else 1)
