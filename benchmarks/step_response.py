"""Step responses of ordinary flights: PID-Analyzer's deconvolution beside the Gaussian process, against the truth.

The peer is PID-Analyzer's published algorithm (Plasmatree, versions 0.5), written anew here with its own constants:
frames of 1 s under a Hann taper, sixteen in the length of one, each deconvolved (Wiener) with a ratio of signal to
noise of 10 below 25 Hz that a Gaussian lets fade, in degrees per second; running sums of the frames in which the
set-point passed 20 degrees per second; and of these the most common value at each time, from a smoothed histogram. The
ratio is a low-pass as well, which makes fast rises longer and peaks lower, and nothing says how certain it is.

Flights and their truth are those of the tests (`tests/twins/everyday_flights.py`): by stick alone, in wind. Run
``python -m benchmarks.step_response``; ``--flights 96`` takes a quarter of an hour.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Mapping
from itertools import islice
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d
from tests.twins.everyday_flights import Case, cases, fly, scores

from rotorid.typing import FloatArray

FRAME_S, FRAMES_IN_ONE = 1.0, 16
CUTOFF_HZ, SIGNAL_TO_NOISE = 25.0, 10.0
LEAST_DEG_S = 20.0
"""A frame counts where the set-point under the taper passed this."""

VALUES, BINS, SMOOTHED_BINS = (-1.5, 3.5), 1000, 7
"""Histogram of the step responses of all frames, and the width of the Gaussian over it."""

SHOWN_S = 0.5
RISE_WITHIN, OVERSHOOT_WITHIN, DELAY_WITHIN_S = 0.05, 2.0, 1.5e-3
NUMBERS = ("rise_time_s", "overshoot_percent", "delay_s")


class Compared(NamedTuple):
    """Numbers of one flight: true, by PID-Analyzer, by the Gaussian process."""

    case: Case
    truth: Mapping[str, float]
    usual: Mapping[str, float]
    ours: Mapping[str, float]


def pid_analyzer_step(setpoint: FloatArray, answer: FloatArray, rate_hz: float) -> tuple[FloatArray, FloatArray]:
    """Times and values of the step response as PID-Analyzer draws it; of rates in rad/s."""
    length = int(FRAME_S * rate_hz)
    begins = np.arange(0, setpoint.size - length + 1, length // FRAMES_IN_ONE)
    frames = begins[:, None] + np.arange(length)
    asked, answered = (np.degrees(signal)[frames] * np.hanning(length) for signal in (setpoint, answer))
    moved = np.abs(asked).max(axis=1) > LEAST_DEG_S
    if not moved.any():
        return np.zeros(0), np.zeros(0)
    padded = length + 1024 - length % 1024
    x, y = (np.fft.fft(signal[moved], padded) for signal in (asked, answered))
    noise = 1.0 / _signal_to_noise(padded, rate_hz)
    impulses = np.fft.ifft(y * x.conj() / (np.abs(x) ** 2 + noise)).real
    shown = int(SHOWN_S * rate_hz)
    # A running sum stands in the middle between two samples, as the truth does.
    return (np.arange(shown) + 0.5) / rate_hz, _most_common(np.cumsum(impulses[:, :shown], axis=1))


def _signal_to_noise(count: int, rate_hz: float) -> FloatArray:
    """The ratio at each line of a transform: constant up to the cut-off, then fading."""
    above = (np.abs(np.fft.fftfreq(count, 1.0 / rate_hz)) >= CUTOFF_HZ).astype(float)
    faded = gaussian_filter1d(above, (count - above.sum()) / 6.0)
    faded = (faded - faded.min()) / np.ptp(faded)
    return np.asarray(SIGNAL_TO_NOISE * (1.0 - faded + 1e-9))


def _most_common(steps: FloatArray) -> FloatArray:
    """Of values over frames and time the most common at each time: the mean, weighted by squares of a histogram."""
    edges = np.linspace(*VALUES, BINS + 1)
    counts = np.stack([np.histogram(at_time, edges)[0] for at_time in steps.T], axis=1).astype(float)
    counts = gaussian_filter1d(counts, SMOOTHED_BINS, axis=0, mode="constant")
    centers = np.linspace(*VALUES, BINS)
    return np.asarray((centers @ counts**2) / np.maximum((counts**2).sum(axis=0), np.finfo(float).tiny))


def numbers_of(time_s: FloatArray, step: FloatArray) -> dict[str, float]:
    """Rise from 0.1 to 0.9, overshoot beyond the set-point, time to half of it; what is not reached is no number."""
    if not step.size:
        return dict.fromkeys(NUMBERS, np.nan)
    fine = np.linspace(0.0, time_s[-1], 20_001)
    values = np.interp(fine, time_s, step)

    def reaches(level: float) -> float:
        return float(fine[np.argmax(values >= level)]) if (values >= level).any() else np.nan

    return {
        "rise_time_s": reaches(0.9) - reaches(0.1),
        "overshoot_percent": 100.0 * max(float(values.max()) - 1.0, 0.0),
        "delay_s": reaches(0.5),
    }


def compare(chosen: Iterable[Case]) -> Iterator[Compared]:
    for case in chosen:
        flight = fly(case)
        setpoint, answer = flight.columns["p_setpoint"], flight.columns["p"]
        usual = numbers_of(*pid_analyzer_step(setpoint, answer, flight.sample_rate_hz))
        found = {name: score for name, score in scores(case).items() if name in NUMBERS}
        ours = {name: np.nan if score.told is None else score.told.value for name, score in found.items()}
        yield Compared(case, {name: score.truth for name, score in found.items()}, usual, ours)


def rises_within(compared: list[Compared]) -> tuple[float, float]:
    """Percent of the flights of which the rise time lies within its planned error: the peer, and ours."""
    name = NUMBERS[0]
    truth = np.array([one.truth[name] for one in compared])
    ways = ([one.usual[name] for one in compared], [one.ours[name] for one in compared])
    usual, ours = (float(np.mean(np.abs(np.array(told) / truth - 1.0) <= RISE_WITHIN)) for told in ways)
    return 100.0 * usual, 100.0 * ours


def table(compared: list[Compared]) -> Iterator[str]:
    """Share of the flights within the planned errors, and the median error, by vehicle and way."""
    yield "| vehicle | way | rise ≤ 5 % | overshoot ≤ 2 | t50 ≤ 1.5 ms | rise, median | overshoot, median |"
    yield "|---|---|---|---|---|---|---|"
    vehicles = dict.fromkeys(one.case.vehicle for one in compared)
    for vehicle in (*vehicles, "all"):
        own = [one for one in compared if vehicle in (one.case.vehicle, "all")]
        for way, name in (("PID-Analyzer", "usual"), ("Gaussian process", "ours")):
            errors = {
                number: np.array([getattr(one, name)[number] - one.truth[number] for one in own])
                / (np.array([one.truth[number] for one in own]) if number == "rise_time_s" else 1.0)
                for number in NUMBERS
            }
            limits = (RISE_WITHIN, OVERSHOOT_WITHIN, DELAY_WITHIN_S)
            shares = [
                f"{100.0 * np.mean(np.abs(errors[number]) <= limit):.0f} %"
                for number, limit in zip(NUMBERS, limits, strict=True)
            ]
            rise, over = (float(np.nanmedian(errors[number])) for number in NUMBERS[:2])
            yield f"| {vehicle} | {way} | {' | '.join(shares)} | {100.0 * rise:+.1f} % | {over:+.1f} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flights", type=int, default=24)
    # An odd stride meets every vehicle, gain, wind and level.
    stride = (96 // parser.parse_args().flights) | 1
    chosen = islice(cases(), 0, None, stride)
    for line in table(list(compare(chosen))):
        print(line)


if __name__ == "__main__":
    main()
