"""Our ULog reader and pyulog on one log: a flight record against all topics as arrays.

Run ``python -m benchmarks.ulog LOG.ulg``. Both are what a user of either calls, and both read the file themselves.
Process time is compared, so that a busy machine does not decide.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from rotorid.io import read

LOG = (
    Path(os.environ.get("ROTORID_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
    / "px4_sitl"
    / "roll.ulg"
)
REPEATS = 5


def read_with_rotorid(path: Path) -> int:
    """Read a flight record, hash of the file included; the number of samples in it."""
    return sum(topic.time_s.size for topic in read(path).topics)


def read_with_pyulog(path: Path) -> int:
    """Read all topics."""
    from pyulog.core import ULog

    return sum(dataset.data["timestamp"].size for dataset in ULog(str(path)).data_list)


def _median_s(action: Callable[[Path], int], path: Path) -> float:
    action(path)  # imports
    times = []
    for _ in range(REPEATS):
        start = time.process_time()
        action(path)
        times.append(time.process_time() - start)
    return float(np.median(times))


def run(path: Path = LOG) -> dict[str, float]:
    ours_s, theirs_s = _median_s(read_with_rotorid, path), _median_s(read_with_pyulog, path)
    return {
        "log_mb": path.stat().st_size / 1e6,
        "rotorid_s": ours_s,
        "pyulog_s": theirs_s,
        "ratio": theirs_s / ours_s,
    }


def main() -> None:
    """Print the numbers, one per line."""
    for name, value in run(*map(Path, sys.argv[1:2])).items():
        print(f"{name:18} {value:14.3f}")


if __name__ == "__main__":
    main()
