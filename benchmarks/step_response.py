"""Step responses of ordinary flights: the usual deconvolution beside the Gaussian process, against the truth.

The usual way, in the manner of PID-Analyzer and of most blackbox viewers, written anew here: windows of 2 s under a
Hann taper, the answer's spectrum divided by that of the set-point with a constant added to its power (Wiener), the mean
of the impulse responses of all windows in which the set-point moved, and its running sum. The constant stands for
noise; it is a low-pass as well, which makes fast rises longer and peaks lower, and nothing says how certain it is.

Flights and their truth are those of the tests (`tests/twins/everyday_flights.py`): by stick alone, in wind. Run
``python -m benchmarks.step_response``; ``--flights 96`` takes a quarter of an hour.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Mapping
from itertools import islice
from typing import NamedTuple

import numpy as np
from tests.twins.everyday_flights import Case, cases, fly, scores

from rotorid.typing import FloatArray

WINDOW_S, OVERLAP = 2.0, 0.75
CONSTANT = 0.01
"""Of the mean power of the set-point in a window."""

LEAST_RAD_S = 0.35
"""A window counts where the set-point reached 20 degrees per second."""

SHOWN_S = 0.5
RISE_WITHIN, OVERSHOOT_WITHIN, DELAY_WITHIN_S = 0.05, 2.0, 1.5e-3
NUMBERS = ("rise_time_s", "overshoot_percent", "delay_s")


class Compared(NamedTuple):
    """Numbers of one flight: true, by deconvolution, by the Gaussian process."""

    case: Case
    truth: Mapping[str, float]
    usual: Mapping[str, float]
    ours: Mapping[str, float]


def wiener_step(setpoint: FloatArray, answer: FloatArray, rate_hz: float) -> tuple[FloatArray, FloatArray]:
    """Times and values of the step response by deconvolution of windows."""
    length = round(WINDOW_S * rate_hz)
    taper = np.hanning(length)
    shown = round(SHOWN_S * rate_hz)
    impulses = []
    for begin in range(0, setpoint.size - length + 1, max(round((1.0 - OVERLAP) * length), 1)):
        asked = setpoint[begin : begin + length]
        if np.abs(asked).max() < LEAST_RAD_S:
            continue
        # Zeros behind each window, so that what comes late does not come round to its beginning.
        x, y = (np.fft.rfft(taper * part, 2 * length) for part in (asked, answer[begin : begin + length]))
        power = np.abs(x) ** 2
        impulses.append(np.fft.irfft(y * x.conj() / (power + CONSTANT * power.mean()))[:shown])
    if not impulses:
        return np.zeros(0), np.zeros(0)
    # A running sum stands in the middle between two samples.
    return (np.arange(shown) + 0.5) / rate_hz, np.cumsum(np.mean(impulses, axis=0))


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
        usual = numbers_of(*wiener_step(setpoint, answer, flight.sample_rate_hz))
        found = {name: score for name, score in scores(case).items() if name in NUMBERS}
        ours = {name: np.nan if score.told is None else score.told.value for name, score in found.items()}
        yield Compared(case, {name: score.truth for name, score in found.items()}, usual, ours)


def rises_within(compared: list[Compared]) -> tuple[float, float]:
    """Percent of the flights of which the rise time lies within its planned error: the usual way, and ours."""
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
        for way, name in (("Wiener", "usual"), ("Gaussian process", "ours")):
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
