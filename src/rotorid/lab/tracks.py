"""Tracks of a log as plain arrays in a folder: written by a worker, mapped by the server.

The channels stand there as soon as they are read, and are drawn while what ``inspect`` says of them is still computed.
"""

from __future__ import annotations

import json
import logging
import threading
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.lab.pyramid import Pyramid, extremes_of
from rotorid.typing import BoolArray, FloatArray, IntArray

TRACKS, INSPECTION = "tracks.json", "inspection.json"
_LONGEST, _FEWEST = 1 << 21, 16
_MOST_PIECES, _MOST_COLUMNS, _MOST_ROWS = 200, 400, 128
_GAP = 4.0
"""Samples that are further apart than so many of them usually are have a gap between them."""

_PROGRESS = logging.getLogger("rotorid.progress")


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
    from rotorid.reviewing.inspection import inspect

    _PROGRESS.info("reading")
    record = read(log)
    rows: list[dict[str, Any]] = []
    for number, topic in enumerate(record.topics):
        np.save(folder / f"{number}.time.npy", topic.time_s)
        np.save(folder / f"{number}.values.npy", topic.values)
        for row, channel in enumerate(topic.channels):
            rows.append({"name": channel.name, "unit": channel.unit, "topic": topic.name, "file": number, "row": row})
    times = [topic.time_s for topic in record.topics if topic.time_s.size]
    span = (
        [min(float(stamps[0]) for stamps in times), max(float(stamps[-1]) for stamps in times)] if times else [0.0, 1.0]
    )
    _keep(folder / TRACKS, json.dumps({"channels": rows, "span_s": span}))
    _PROGRESS.info("looking for flights and excitations")
    _keep(folder / INSPECTION, to_json(inspect_document(inspect(record))))


def _keep(file: Path, text: str) -> None:
    """Write a file that another process finds whole or not at all."""
    half = file.with_suffix(".half")
    half.write_text(text, encoding="utf-8")
    half.replace(file)


def listed(values: Any) -> Any:
    """Numbers for JSON: what is not finite is ``null``."""
    array = np.asarray(values, dtype=float)
    plain = array.astype(object)
    plain[~np.isfinite(array)] = None
    return plain.tolist()


@dataclass(frozen=True, eq=False)
class Cut:
    """Finite samples of an interval, and how many of them there are in a second."""

    time_s: FloatArray
    values: FloatArray
    rate_hz: float

    @cached_property
    def gaps(self) -> IntArray:
        """Numbers of the samples that have a gap behind them."""
        return np.flatnonzero(np.diff(self.time_s) > _GAP / self.rate_hz)

    def pieces(self) -> list[FloatArray]:
        """The values on an even grid, one piece between any two gaps; the longest where there are many."""
        edges = np.concatenate([[0], self.gaps + 1, [self.time_s.size]])
        longest = np.argsort(-np.diff(edges), kind="stable")[:_MOST_PIECES]
        return [self._even(int(edges[k]), int(edges[k + 1])) for k in longest]

    def _even(self, first: int, last: int) -> FloatArray:
        time_s = self.time_s[first:last]
        count = int((time_s[-1] - time_s[0]) * self.rate_hz) + 1
        even: FloatArray = np.interp(time_s[0] + np.arange(count) / self.rate_hz, time_s, self.values[first:last])
        return even

    def whole(self, start_s: FloatArray, stop_s: FloatArray) -> BoolArray:
        """Whether there is no gap between two times, for several pairs of them."""
        first = np.searchsorted(self.time_s, start_s, side="right") - 1
        last = np.searchsorted(self.time_s, stop_s)
        whole: BoolArray = np.searchsorted(self.gaps, first) == np.searchsorted(self.gaps, last)
        return whole


class Tracks:
    """Channels of a log that was read, mapped from a folder, as are the pyramids of those that were looked at."""

    def __init__(self, folder: Path) -> None:
        saved = json.loads((folder / TRACKS).read_text(encoding="utf-8"))
        self._folder = folder
        self.channels: list[dict[str, Any]] = saved["channels"]
        self.span_s: list[float] = saved["span_s"]
        self._lock = threading.Lock()

    def inspection(self) -> dict[str, Any] | None:
        """The inspection of the log, as soon as it is there."""
        try:
            saved: dict[str, Any] = json.loads((self._folder / INSPECTION).read_text(encoding="utf-8"))
        except FileNotFoundError:
            return None
        return saved

    def _samples(self, number: int) -> tuple[FloatArray, FloatArray]:
        """Times and values of a channel."""
        row = self.channels[number]
        time_s, values = (_mapped(self._folder / f"{row['file']}.{kind}.npy") for kind in ("time", "values"))
        return time_s, values[row["row"]]

    def pyramid(self, number: int) -> Pyramid:
        """Of a channel; its levels are made when it is first looked at."""
        time_s, values = self._samples(number)
        file = self._folder / f"{number}.levels.npy"
        with self._lock:
            if not file.exists():
                half = file.with_suffix(".half.npy")
                np.save(half, extremes_of(values))
                half.replace(file)
        return Pyramid(time_s, values, _mapped(file))

    def cut(self, number: int, start_s: float, stop_s: float) -> Cut | None:
        """Finite samples of an interval, at most two million from its start; nothing where there are too few."""
        time_s, values = self._samples(number)
        first, last = (int(place) for place in np.searchsorted(time_s, [start_s, stop_s]))
        last = min(last, first + _LONGEST)
        t, y = np.array(time_s[first:last]), np.array(values[first:last], dtype=float)
        t, y = t[np.isfinite(y)], y[np.isfinite(y)]
        if t.size < _FEWEST:
            return None
        spacing_s = float(np.median(np.diff(t)))
        return Cut(t, y, 1.0 / spacing_s) if spacing_s > np.finfo(float).eps else None

    def spectrum(self, number: int, start_s: float, stop_s: float) -> dict[str, Any]:
        """One-sided power spectral density in unit²/Hz (Welch, Hann, half overlapping) over frequency in rad/s.

        ``start_s`` and ``stop_s`` are where the samples begin and end that it is of.
        """
        from scipy.signal import welch

        cut = self.cut(number, start_s, stop_s)
        pieces = [] if cut is None else cut.pieces()
        longest = max((piece.size for piece in pieces), default=0)
        if cut is None or longest < _FEWEST:
            return {"start_s": start_s, "stop_s": stop_s, "frequency_rad_s": [], "density": []}
        length = min(longest, max(256, sum(piece.size for piece in pieces) // 8))
        taken = [piece for piece in pieces if piece.size >= length]
        with np.errstate(all="ignore"):
            found = [welch(part, fs=cut.rate_hz, nperseg=length, detrend="constant") for part in taken]
            counts = [1 + 2 * (part.size - length) // length for part in taken]
            density = np.average([power for _, power in found], axis=0, weights=counts)
        return {
            "start_s": float(cut.time_s[0]),
            "stop_s": float(cut.time_s[-1]),
            "frequency_rad_s": listed(2.0 * np.pi * found[0][0][1:]),
            "density": listed(density[1:]),
        }

    def spectrogram(self, number: int, start_s: float, stop_s: float) -> dict[str, Any]:
        """The same over time, in dB: at most 400 columns of 128 rows, with nothing where there is a gap."""
        from scipy.signal import periodogram

        cut = self.cut(number, start_s, stop_s)
        longest = 0 if cut is None else max(piece.size for piece in cut.pieces())
        if cut is None or longest < 4 * _FEWEST:
            return {"start_s": start_s, "stop_s": stop_s, "time_s": [], "frequency_rad_s": [], "density_db": []}
        first, last = float(cut.time_s[0]), float(cut.time_s[-1])
        length = min(2 * _MOST_ROWS, longest // 4)
        half_s = 0.5 * (length - 1) / cut.rate_hz
        count = min(_MOST_COLUMNS, 1 + int((last - first - 2.0 * half_s) / half_s))
        centers = np.linspace(first + half_s, last - half_s, count)
        grid = centers[:, None] + np.linspace(-half_s, half_s, length)
        windows = np.interp(grid, cut.time_s, cut.values)
        with np.errstate(all="ignore"):
            f, density = periodogram(windows, fs=cut.rate_hz, window="hann", detrend="constant")
            decibels = 10.0 * np.log10(np.maximum(density[:, 1 : _MOST_ROWS + 1], 1e-30))
        decibels[~cut.whole(centers - half_s, centers + half_s)] = np.nan
        return {
            "start_s": first,
            "stop_s": last,
            "time_s": listed(centers),
            "frequency_rad_s": listed(2.0 * np.pi * f[1 : _MOST_ROWS + 1]),
            "density_db": listed(np.round(decibels.T, 2)),
        }


def _mapped(file: Path) -> FloatArray:
    array: FloatArray = np.load(file, mmap_mode="r", allow_pickle=False)
    return array
