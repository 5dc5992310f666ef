"""What the lab costs: from start to page, from a log of 200 MB to its first picture, a frame while zooming, memory.

A real browser without a window against a real server; the log is the example's flight eight times over, as a .ulg.
Resident memory is that of the server and all its workers, not of the browser.

Run ``python -m benchmarks.lab`` (needs Chromium and Playwright).
"""

from __future__ import annotations

import statistics
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from tests.browser.lab_page import LabPage, chromium, serving

START_BAR_S, PLOT_BAR_S, FRAME_BAR_MS, MEMORY_BAR_MIB = 1.5, 4.0, 50.0, 1536.0
TIMES = 8
ZOOMS = 60


def long_log(folder: Path) -> Path:
    """The example's flight, flown again and again: its messages once more with later stamps."""
    command = [sys.executable, "-m", "rotorid", "example", "px4", "--out", str(folder / "flown"), "--quiet"]
    subprocess.run(command, check=True)
    content = (folder / "flown" / "flight.ulg").read_bytes()
    stamps: dict[str | int, int] = {}
    messages, place = [], 16
    while place < len(content):
        length, letter = struct.unpack_from("<HB", content, place)
        body = content[place + 3 : place + 3 + length]
        if letter == ord("F"):
            name, fields = body.decode().split(":", 1)
            stamps[name] = sum(one.startswith("uint64_t timestamp") for one in fields.split(";")[:2])
        elif letter == ord("A"):
            stamps[struct.unpack_from("<H", body, 1)[0]] = stamps[body[3:].decode()]
        elif letter == ord("D"):
            messages.append(content[place : place + 3 + length])
        place += 3 + length
    times = [struct.unpack_from("<Q", one, 5)[0] for one in messages]
    span = max(times) - min(times) + 4000
    file = folder / "long.ulg"
    with file.open("wb") as out:
        out.write(content)
        for again in range(1, TIMES):
            for one in messages:
                later = bytearray(one)
                for k in range(stamps[struct.unpack_from("<H", one, 3)[0]]):
                    (stamp,) = struct.unpack_from("<Q", one, 5 + 8 * k)
                    struct.pack_into("<Q", later, 5 + 8 * k, stamp + again * span)
                out.write(later)
    return file


def resident_mib(server: subprocess.Popen[str]) -> float:
    """Memory of a process and of all that it started."""
    parents, sizes = {}, {}
    for place in Path("/proc").glob("[0-9]*"):
        try:
            parents[int(place.name)] = int((place / "stat").read_text().rsplit(")", 1)[1].split()[1])
            rows = (place / "smaps_rollup").read_text().splitlines()
            sizes[int(place.name)] = next(int(row.split()[1]) for row in rows if row.startswith("Pss:")) / 1024.0
        except (OSError, IndexError, ValueError, StopIteration):
            continue

    def inside(number: int) -> bool:
        while number > 1:
            if number == server.pid:
                return True
            number = parents.get(number, 0)
        return False

    return sum(size for number, size in sizes.items() if inside(number))


def frames_ms(page: Any) -> list[float]:
    """Milliseconds that a zoom or a move keeps the page busy, and those until it is painted."""
    found: list[float] = page.evaluate(
        """async (count) => {
          const over = document.querySelector("#tracks .u-over"), box = over.getBoundingClientRect(), told = [];
          for (let k = 0; k < count; k += 1) {
            await new Promise(requestAnimationFrame);
            const begun = performance.now();
            over.dispatchEvent(new WheelEvent("wheel", { deltaY: k % 12 < 6 ? -100 : 100, shiftKey: k % 3 === 2,
              clientX: box.x + box.width / 2, clientY: box.y + 20, bubbles: true, cancelable: true }));
            await new Promise(requestAnimationFrame);
            told.push(performance.now() - begun);
          }
          return told;
        }""",
        ZOOMS,
    )
    return found


def main() -> None:
    """Print every number beside its bar."""
    with tempfile.TemporaryDirectory() as place, chromium() as started:
        folder = Path(place)
        log = long_log(folder)
        print(f"log of {log.stat().st_size / 1e6:.0f} MB")
        private = folder / "private"
        private.mkdir()
        begun = time.perf_counter()
        with serving(folder, private=private) as (address, server):
            lab = LabPage(started.new_page(viewport={"width": 1300, "height": 900}))
            lab.page.goto(address)
            lab.page.wait_for_selector("#choices-of-folder button")
            print(f"start to page {time.perf_counter() - begun:.2f} s, bar {START_BAR_S} s")
            begun = time.perf_counter()
            lab.page.click("#choices-of-folder button:text-is('long.ulg')")
            lab.page.wait_for_selector("#tracks .u-over")
            print(f"to the first picture {time.perf_counter() - begun:.2f} s, bar {PLOT_BAR_S} s")
            lab.wait_for_tracks()
            print(f"to the inspection {time.perf_counter() - begun:.2f} s, {resident_mib(server):.0f} MiB")
            times = frames_ms(lab.page)
            print(
                f"a frame {statistics.median(times):.0f} ms, 95 % {np.percentile(times, 95):.0f} ms, "
                f"bar {FRAME_BAR_MS:.0f} ms"
            )
            most = 0.0
            for k in range(2, 11):
                lab.page.click("#opener") if not lab.page.is_visible("#open") else None
                lab.page.click("#choices-of-folder button:text-is('long.ulg')")
                while lab.page.locator("#logs li").count() < k or lab.page.locator("#logs progress").count():
                    most = max(most, resident_mib(server))
                    lab.page.wait_for_timeout(100)
            print(f"ten such logs open: {resident_mib(server):.0f} MiB, most {most:.0f}, bar {MEMORY_BAR_MIB:.0f} MiB")
            asked: list[str] = []
            lab.page.on("request", lambda request: asked.append(request.url))
            before = resident_mib(server)
            lab.page.wait_for_timeout(20_000)
            print(f"20 s of rest: {len(asked)} requests, {resident_mib(server) - before:+.1f} MiB")


if __name__ == "__main__":
    main()
