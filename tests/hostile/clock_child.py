"""The child of `test_clocks`: takes logs whose clocks are none through the commands, with little memory to do it in.

A line for each log and command: what became of it, and the peak of the memory so far.
"""

from __future__ import annotations

import resource
import sys
from pathlib import Path

from tests.hostile.damage import hang_limit
from tests.hostile.fuzz_child import most_resident_kb, spoken

MEMORY_BYTES = 2 << 30
"""Of addresses: libraries and threads take half of it before anything is read."""


def main(folder: Path, commands: list[str]) -> None:
    """Every log of the folder through every command."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    for path in sorted(folder.iterdir()):
        for command in commands:
            with hang_limit():
                said = spoken([*command.split(), str(path), "--out", str(folder.parent / "out")])
            print(f"{path.name} {command}: {said}, {most_resident_kb()} kB", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
