"""What a fleet costs beside a plain loop, how two workers share the work, and whether memory stays flat.

Stand-in logs that take a given processor time each: what is measured is the fleet and not the identification. The plain
loop does the same work in one process that is started once; both sides know the logs and nothing else.

Run ``python -m benchmarks.fleet``.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path

from tests.fleet_logs import WORK, answer, write_logs

from rotorid.fleets import Fleet, FleetSettings, Limits, Processes, Task, places_of

SETTINGS = FleetSettings(models=("rate.roll",))
LIMITS = Limits(work=WORK, memory_bytes=1 << 30)
OVERHEAD_BAR, EFFICIENCY_BAR = 1.10, 0.85
LOG_S = 2.0


def plain(folder: Path) -> float:
    """Seconds of a loop over all logs."""
    begun = time.perf_counter()
    for place in places_of([folder]):
        answer(Task(place=place, asked={}, settings="", salt=""))
    return time.perf_counter() - begun


def fleet(folder: Path, out: Path, workers: int) -> float:
    """Seconds of a fleet over all logs, from nothing to its tables."""
    begun = time.perf_counter()
    run = Fleet([folder], SETTINGS, out, engine=Processes(workers, LIMITS))
    for _ in run:
        pass
    run.write_tables()
    run.close()
    return time.perf_counter() - begun


def resident_mib() -> float:
    """Memory of this process."""
    text = Path("/proc/self/status").read_text(encoding="ascii")
    return next(int(line.split()[1]) for line in text.splitlines() if line.startswith("VmRSS")) / 1024.0


def memory(folder: Path, out: Path) -> Iterable[float]:
    """Memory after every 250 logs of a fleet."""
    run = Fleet([folder], SETTINGS, out, engine=Processes(2, LIMITS))
    for count, _ in enumerate(run, start=1):
        if count % 250 == 0:
            yield resident_mib()
    run.close()


def main() -> None:
    """Print one line for each."""
    with tempfile.TemporaryDirectory() as scratch:
        home = Path(scratch)
        logs = home / "logs"
        logs.mkdir()
        for path in write_logs(logs, 30, "busy"):
            path.write_text(f"{path.read_text(encoding='utf-8')} {LOG_S}", encoding="utf-8")
        loop_s = plain(logs)
        one_s, two_s = fleet(logs, home / "one", 1), fleet(logs, home / "two", 2)
        print(f"30 logs of {LOG_S:g} s: loop {loop_s:.1f} s, fleet of 1 {one_s:.1f} s, of 2 {two_s:.1f} s")
        overhead, efficiency = one_s / loop_s, loop_s / (2.0 * two_s)
        print(f"fleet over loop {overhead:.3f}, bar {OVERHEAD_BAR}: {'met' if overhead <= OVERHEAD_BAR else 'MISSED'}")
        met = "met" if efficiency >= EFFICIENCY_BAR else "MISSED"
        print(f"efficiency of 2 workers {efficiency:.2f}, bar {EFFICIENCY_BAR}: {met}")
        many = home / "many"
        write_logs(many, 2000)
        seen = list(memory(many, home / "out"))
        grown = seen[-1] - statistics.median(seen[:2])
        print(f"memory over 2000 small logs {', '.join(f'{one:.0f}' for one in seen)} MiB: grown by {grown:.0f}")


if __name__ == "__main__":
    main()
