"""Where the processor time of a whole command goes: imports, reading, conditioning, responses, fit, bounds, report.

The stack is looked at after every few milliseconds of processor time. That costs a percent or two, where a profiler
that follows every call makes Python several times as slow and numpy not at all. A look counts for the processor time
since the one before, so that a long call of compiled code counts in full, and belongs to the innermost function of
rotorid that has a stage, or to the import or the compiled kernel that is loaded inside it.

``python -m benchmarks.commands --profile`` prints the stages of its commands; this file alone is what its child process
runs: ``python stages.py ANSWER.json COMMAND``.
"""

from __future__ import annotations

import json
import runpy
import signal
import sys
import time
from collections import defaultdict
from pathlib import Path
from types import FrameType

STEP_S = 0.005
IMPORTS, KERNELS, OTHER = "imports", "compiled kernels", "other"

STAGES = {
    "io": "reading",
    "signal": "conditioning",
    "flights": "conditioning",
    "flights/measure": "responses",
    "flights/supports": "responses",
    "loops": "responses",
    "spectral": "responses",
    "fitting": "fit",
    "models": "fit",
    "reduction": "fit",
    "search": "fit",
    "simulation": "fit",
    "fits": "bounds",
    "uncertainty": "bounds",
    "checking": "verification",
    "verification": "verification",
    "reviewing": "review",
    "proposing": "tuning",
    "tuning": "tuning",
    "documents": "report",
    "exports": "report",
    "plot": "report",
    "report": "report",
    "results": "report",
}
"""Stage of a part of the package; that of the longest path counts."""


def stage_of(frame: FrameType | None) -> tuple[str, str]:
    """Stage of a stack, from its innermost frame on, and the function that it belongs to."""
    while frame is not None:
        file, name = frame.f_code.co_filename, frame.f_code.co_name
        if file.startswith("<frozen importlib"):
            return IMPORTS, ""
        if "/numba/" in file:
            return KERNELS, ""
        _, inside, part = file.rpartition("/rotorid/")
        if inside and name != "<module>":
            path = part.removesuffix(".py")
            found = [known for known in STAGES if path == known or path.startswith(f"{known}/")]
            if found:
                return STAGES[max(found, key=len)], f"{path}.{name}"
        frame = frame.f_back
    return OTHER, ""


def profile(words: list[str]) -> dict[str, dict[str, float]]:
    """Run a command in this process: seconds by stage, and by stage and function."""
    stages: defaultdict[str, float] = defaultdict(float)
    functions: defaultdict[str, float] = defaultdict(float)
    last_s = time.process_time()

    def look(_: int, frame: FrameType | None) -> None:
        nonlocal last_s
        now_s = time.process_time()
        stage, function = stage_of(frame)
        stages[stage] += now_s - last_s
        functions[function or stage] += now_s - last_s
        last_s = now_s

    signal.signal(signal.SIGPROF, look)
    signal.setitimer(signal.ITIMER_PROF, STEP_S, STEP_S)
    sys.argv = ["rotorid", *words]
    try:
        runpy.run_module("rotorid", run_name="__main__")
    except SystemExit as ended:
        if ended.code:
            raise
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    return {"stages": dict(stages), "functions": dict(functions)}


if __name__ == "__main__":
    # The folder of this file holds modules of its own, which no command may find.
    del sys.path[0]
    place, *command = sys.argv[1:]
    Path(place).write_text(json.dumps(profile(command)), encoding="utf-8")
