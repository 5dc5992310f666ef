"""One answer on any machine: threads of the linear algebra and the order of logs change nothing but roundings."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROUNDING = 1e-9
"""Of a standard deviation; measured are 2e-13."""


def parameters(
    logs: Sequence[Path], folder: Path, *, model: str, threads: int = 1
) -> Mapping[str, Mapping[str, float | None]]:
    command = [sys.executable, "-m", "rotorid", "identify", *map(str, logs), "--model", model, "--out", str(folder)]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": str(threads), "OMP_NUM_THREADS": str(threads)}
    subprocess.run([*command, "--quiet"], env=environment, check=True)
    found: Mapping[str, Mapping[str, float | None]] = json.loads((folder / "result.json").read_text())["parameters"]
    return found


def apart(one: Mapping[str, Mapping[str, float | None]], other: Mapping[str, Mapping[str, float | None]]) -> float:
    """Largest difference of a value or of a standard deviation, in standard deviations."""
    assert one.keys() == other.keys()
    return max(
        abs((one[name][field] or 0.0) - (other[name][field] or 0.0)) / std
        for name in one
        if (std := one[name]["std"])
        for field in ("value", "std")
    )


def test_threads_and_the_order_of_logs_change_nothing(unpacked: Callable[[str], Path], tmp_path: Path) -> None:
    logs = [unpacked("px4_sitl/roll.ulg"), unpacked("px4_sitl/yaw.ulg.xz")]
    usual = parameters(logs, tmp_path / "usual", model="hover.lateral")
    again = parameters(logs, tmp_path / "again", model="hover.lateral")
    assert again == usual
    assert apart(usual, parameters(logs, tmp_path / "threads", model="hover.lateral", threads=2)) < ROUNDING
    assert apart(usual, parameters(logs[::-1], tmp_path / "order", model="hover.lateral")) < ROUNDING
