"""Tracks, spectra and spectrograms: of the interval that was asked for, whatever the stamps of the log are."""

from __future__ import annotations

import json
import tracemalloc
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from rotorid.io import sandbox
from rotorid.lab import tracks as lab_tracks
from rotorid.lab.tracks import Tracks, write_tracks
from rotorid.typing import FloatArray

RATE_HZ = 1000.0


def _tracks(folder: Path, time_s: FloatArray, *values: FloatArray) -> Tracks:
    np.save(folder / "0.time.npy", time_s)
    np.save(folder / "0.values.npy", np.stack(values))
    rows = [{"name": f"x{k}", "unit": "1", "topic": "t", "file": 0, "row": k} for k in range(len(values))]
    told = {"channels": rows, "span_s": [float(time_s[0]), float(time_s[-1])]}
    (folder / "tracks.json").write_text(json.dumps(told), encoding="utf-8")
    return Tracks(folder)


def _tone(time_s: FloatArray, frequency_hz: float) -> FloatArray:
    tone: FloatArray = np.sin(2.0 * np.pi * frequency_hz * time_s)
    return tone


@pytest.mark.parametrize("late_s", [2e5, 1e10])
def test_one_late_stamp_costs_no_memory(tmp_path: Path, late_s: float) -> None:
    time_s = np.append(np.arange(5000) / RATE_HZ, late_s)
    tracks = _tracks(tmp_path, time_s, _tone(time_s, 50.0))
    tracemalloc.start()
    try:
        found = tracks.spectrum(0, 0.0, 2.0 * late_s)
        gram = tracks.spectrogram(0, 0.0, 2.0 * late_s)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert most < 64 << 20
    frequency = np.array(found["frequency_rad_s"]) / (2.0 * np.pi)
    assert abs(frequency[np.argmax(found["density"])] - 50.0) < frequency[1] - frequency[0]
    # The one column with samples is drawn, and what lies between these and the late one stays empty.
    assert gram["density_db"][0][0] is not None
    assert set(gram["density_db"][0][1:]) == {None}


def test_a_spectrum_is_not_of_what_a_gap_lacks(tmp_path: Path) -> None:
    """A line drawn over a gap of half the log would take half of the power away."""
    time_s = np.concatenate([np.arange(4000), np.arange(12_000, 16_000)]) / RATE_HZ
    values = np.random.default_rng(0).normal(size=time_s.size)
    tracks = _tracks(tmp_path, time_s, values)
    found = tracks.spectrum(0, 0.0, 16.0)
    frequency = np.array(found["frequency_rad_s"]) / (2.0 * np.pi)
    power = np.trapezoid(found["density"], frequency)
    assert power == pytest.approx(np.var(values), rel=0.1)
    gram = tracks.spectrogram(0, 0.0, 16.0)
    blank = np.array([one is None for one in gram["density_db"][0]])
    centers = np.array(gram["time_s"])
    assert np.all(blank[(centers > 4.2) & (centers < 11.8)])
    assert not np.any(blank[(centers < 3.8) | (centers > 12.2)])


def test_a_spectrogram_lies_where_its_samples_are(tmp_path: Path) -> None:
    time_s = 100.0 + np.arange(20_000) / RATE_HZ
    values = np.where(time_s < 110.0, _tone(time_s, 50.0), _tone(time_s, 200.0))
    tracks = _tracks(tmp_path, time_s, values)
    # It is asked for from long before the first sample on.
    gram = tracks.spectrogram(0, 0.0, 1000.0)
    assert (gram["start_s"], gram["stop_s"]) == (100.0, time_s[-1])
    centers, rows = np.array(gram["time_s"]), np.array(gram["density_db"], dtype=float)
    loudest = np.array(gram["frequency_rad_s"])[np.argmax(rows, axis=0)] / (2.0 * np.pi)
    for inside, tone in ((centers < 109.8, 50.0), (centers > 110.2, 200.0)):
        assert np.all(np.abs(loudest[inside] - tone) < 4.0)
    assert centers[0] > 100.0
    assert centers[-1] < time_s[-1]


def test_an_interval_that_is_cut_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lab_tracks, "_LONGEST", 2000)
    time_s = np.arange(10_000) / RATE_HZ
    tracks = _tracks(tmp_path, time_s, _tone(time_s, 50.0))
    for found in (tracks.spectrum(0, 1.0, 9.0), tracks.spectrogram(0, 1.0, 9.0)):
        assert (found["start_s"], found["stop_s"]) == (1.0, 2.999)


@pytest.mark.parametrize("size", [1e200, np.nan, np.inf])
def test_whatever_the_values_are_an_answer_fits_into_json(tmp_path: Path, size: float) -> None:
    time_s = np.arange(1000) / RATE_HZ
    tracks = _tracks(tmp_path, time_s, np.where(time_s < 0.9, size, -1e200) * (0.5 + np.cos(time_s)))
    for found in (tracks.spectrum(0, 0.0, 1.0), tracks.spectrogram(0, 0.0, 1.0)):
        json.dumps(found, allow_nan=False)


@pytest.mark.parametrize("samples", [1, 4, 40])
def test_short_channels_are_no_error(tmp_path: Path, samples: int) -> None:
    time_s = np.arange(samples) / RATE_HZ
    tracks = _tracks(tmp_path, time_s, time_s)
    x, _ = tracks.pyramid(0).view(-1.0, 1.0, 100)
    assert x.size == samples
    assert tracks.spectrogram(0, -1.0, 1.0)["time_s"] == []
    assert (tracks.spectrum(0, -1.0, 1.0)["density"] == []) == (samples < 16)


def test_levels_of_a_channel_are_made_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """However many tracks are shown, and however many ask at once."""
    time_s = np.arange(1000) / RATE_HZ
    tracks = _tracks(tmp_path, time_s, *(time_s * k for k in range(20)))
    made, extremes_of = [], lab_tracks.extremes_of  # type: ignore[attr-defined]
    monkeypatch.setattr(lab_tracks, "extremes_of", lambda values: (made.append(1), extremes_of(values))[1])
    with ThreadPoolExecutor(8) as pool:
        for _ in range(2):
            greatest = list(pool.map(lambda k: tracks.pyramid(k % 20).view(0.0, 1.0, 10)[1].max(), range(60)))
            assert greatest == [time_s[-1] * (k % 20) for k in range(60)]
    assert len(made) == 20


def test_foreign_parsers_run_in_their_sandbox(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from scipy.io import savemat

    log = tmp_path / "log.mat"
    savemat(log, {"time": np.arange(100) / 100.0, "p": np.zeros(100)})

    def here(*_: object) -> None:
        raise AssertionError("a foreign parser runs in the process of the lab")

    monkeypatch.setattr(sandbox, "extract_here", here)
    write_tracks(log, tmp_path)
    assert [one["name"] for one in Tracks(tmp_path).channels] == ["p"]
