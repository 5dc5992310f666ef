"""Tracks of a log as plain arrays in a folder: written by a worker, mapped by the server.

The channels stand there as soon as they are read, and are drawn while what ``inspect`` says of them is still computed.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.lab.pyramid import Pyramid
from rotorid.typing import FloatArray

TRACKS, INSPECTION = "tracks.json", "inspection.json"
_LONGEST = 1 << 19


def write_tracks(log: Path, folder: Path) -> None:
    """Read a log, and write its channels and what ``inspect`` says of it into a folder.

    Raises
    ------
    LogError
        It is no log.
    """
    from rotorid.documents.base import to_json
    from rotorid.documents.inspection import inspect_document
    from rotorid.io.registry import read
    from rotorid.pipeline.inspection import inspect

    record = read(log)
    rows: list[dict[str, Any]] = []
    for number, topic in enumerate(record.topics):
        np.save(folder / f"{number}.time.npy", topic.time_s)
        np.save(folder / f"{number}.values.npy", topic.values)
        for row, channel in enumerate(topic.channels):
            rows.append({"name": channel.name, "unit": channel.unit, "topic": topic.name, "file": number, "row": row})
    times = [topic.time_s for topic in record.topics if topic.time_s.size]
    span = [min(float(one[0]) for one in times), max(float(one[-1]) for one in times)] if times else [0.0, 1.0]
    _keep(folder / TRACKS, json.dumps({"channels": rows, "span_s": span}))
    _keep(folder / INSPECTION, to_json(inspect_document(inspect(record))))


def _keep(file: Path, text: str) -> None:
    """Write a file that another process finds whole or not at all."""
    half = file.with_suffix(".half")
    half.write_text(text, encoding="utf-8")
    half.replace(file)


class Tracks:
    """Channels of a log that was read, mapped from a folder, with the pyramids of those that were looked at."""

    def __init__(self, folder: Path) -> None:
        told = json.loads((folder / TRACKS).read_text(encoding="utf-8"))
        self._folder = folder
        self.channels: list[dict[str, Any]] = told["channels"]
        self.span_s: list[float] = told["span_s"]
        self._pyramids: dict[int, Pyramid] = {}

    def inspection(self) -> dict[str, Any] | None:
        """What ``inspect`` says of the log, as soon as it does."""
        try:
            told: dict[str, Any] = json.loads((self._folder / INSPECTION).read_text(encoding="utf-8"))
        except FileNotFoundError:
            return None
        return told

    def samples(self, number: int) -> tuple[FloatArray, FloatArray]:
        """Times and values of a channel."""
        row = self.channels[number]
        time_s = np.load(self._folder / f"{row['file']}.time.npy", mmap_mode="r", allow_pickle=False)
        values = np.load(self._folder / f"{row['file']}.values.npy", mmap_mode="r", allow_pickle=False)
        return time_s, values[row["row"]]

    def pyramid(self, number: int) -> Pyramid:
        """Of a channel; the last few that were looked at are kept."""
        found = self._pyramids.pop(number, None) or Pyramid(*self.samples(number))
        self._pyramids[number] = found
        while len(self._pyramids) > 12:
            self._pyramids.pop(next(iter(self._pyramids)), None)
        return found

    def cut(self, number: int, start_s: float, stop_s: float) -> tuple[FloatArray, float]:
        """Finite samples of an interval, on an even grid, and their rate in Hz; at most half a million."""
        time_s, values = self.samples(number)
        first, last = np.searchsorted(time_s, [start_s, stop_s])
        last = min(int(last), int(first) + _LONGEST)
        t, y = np.array(time_s[first:last]), np.array(values[first:last], dtype=float)
        t, y = t[np.isfinite(y)], y[np.isfinite(y)]
        if t.size < 16:
            return np.empty(0), 0.0
        rate = 1.0 / float(np.median(np.diff(t)))
        grid = np.arange(t[0], t[-1], 1.0 / rate)[:_LONGEST]
        return np.interp(grid, t, y), rate

    def spectrum(self, number: int, start_s: float, stop_s: float) -> dict[str, Any]:
        """One-sided power spectral density in unit²/Hz (Welch, Hann, half overlapping) over frequency in rad/s."""
        from scipy.signal import welch

        y, rate = self.cut(number, start_s, stop_s)
        if y.size < 16:
            return {"frequency_rad_s": [], "density": []}
        frequency, density = welch(y, fs=rate, nperseg=min(y.size, max(256, y.size // 8)), detrend="constant")
        return {"frequency_rad_s": (2.0 * np.pi * frequency[1:]).tolist(), "density": density[1:].tolist()}

    def spectrogram(self, number: int, start_s: float, stop_s: float) -> dict[str, Any]:
        """The same over time, in dB: at most 400 columns of 128 rows."""
        from scipy.signal import spectrogram

        y, rate = self.cut(number, start_s, stop_s)
        if y.size < 64:
            return {"time_s": [], "frequency_rad_s": [], "density_db": []}
        length = min(256, y.size // 4)
        step = max(length // 2, y.size // 400)
        f, t, density = spectrogram(y, fs=rate, nperseg=length, noverlap=max(length - step, 0), detrend="constant")
        density = density[1:129, :400]
        decibels = 10.0 * np.log10(np.maximum(density, 1e-30))
        return {
            "time_s": (start_s + t[:400]).tolist(),
            "frequency_rad_s": (2.0 * np.pi * f[1:129]).tolist(),
            "density_db": np.round(decibels, 2).tolist(),
        }
