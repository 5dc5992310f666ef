"""How much faster the DataFlash reader is than pymavlink: both read every column of one log in one process.

Run ``python benchmarks/dataflash.py LOG.BIN``. Process time is compared, so that a busy machine does not decide.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from rotorid.io.ardupilot import decode

LOG = (
    Path(os.environ.get("ROTORID_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
    / "ardupilot_sitl"
    / "x_calm_roll.BIN"
)
REPEATS = 5
"""Ours is a matter of milliseconds: the median of a few runs. pymavlink's takes seconds: one run."""


def read_with_rotorid(path: Path) -> int:
    """Read every column, strings, arrays and units included; the number of values."""
    log = decode(np.fromfile(path, dtype=np.uint8))
    return sum(values.shape[0] for table in log.tables.values() for values in table.read().values())


def read_with_pymavlink(path: Path) -> int:
    """Do the same, message by message."""
    from pymavlink.DFReader import DFReader_binary

    values = 0
    log = DFReader_binary(str(path.resolve()))
    while (message := log.recv_msg()) is not None:
        values += len([getattr(message, name) for name in message.get_fieldnames()])
    log.close()
    return values


def _seconds(action: Callable[[Path], int], path: Path) -> tuple[float, int]:
    start = time.process_time()
    values = action(path)
    return time.process_time() - start, values


def run(path: Path = LOG) -> dict[str, float]:
    ours = [_seconds(read_with_rotorid, path) for _ in range(REPEATS)]
    theirs, their_values = _seconds(read_with_pymavlink, path)
    first, median = ours[0][0], float(np.median([seconds for seconds, _ in ours]))
    return {
        "log_mb": path.stat().st_size / 1e6,
        "values": float(ours[0][1]),
        "pymavlink_values": float(their_values),
        "rotorid_first_s": first,
        "rotorid_s": median,
        "pymavlink_s": theirs,
        "ratio_first": theirs / first,
        "ratio": theirs / median,
    }


def main() -> None:
    """Print the numbers, one per line."""
    for name, value in run(*map(Path, sys.argv[1:2])).items():
        print(f"{name:18} {value:14.3f}")


if __name__ == "__main__":
    main()
