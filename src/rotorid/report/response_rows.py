"""Rows of the tables of the response page: text for the page, from the numbers of the document."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from rotorid.pipeline.response_document import EstimatedDocument, LoopDocument, PairDocument, ResponseDocument
from rotorid.plot.quantity import quantity
from rotorid.report.numbers import MISSING, significant, unit, with_error
from rotorid.report.tables import ManeuverRow, maneuver_row
from rotorid.report.wording import Verdict

_DB_PER_NEPER = 20.0 / math.log(10.0)
_DEGREES = 180.0 / math.pi

_LOOP_NUMBERS: Mapping[str, tuple[str, str, float]] = {
    "crossover_rad_s": ("Crossover", "rad/s", 1.0),
    "phase_margin_rad": ("Phase margin", "°", _DEGREES),
    "delay_margin_s": ("Delay margin", "ms", 1e3),
    "gain_margin_up": ("Gain margin upward", "dB", 0.0),
    "gain_margin_down": ("Gain margin downward", "dB", 0.0),
    "modulus_margin": ("Modulus margin", "", 1.0),
    "modulus_omega_rad_s": ("Modulus margin at", "rad/s", 1.0),
    "disturbance_rejection_bandwidth_rad_s": ("Disturbance-rejection bandwidth", "rad/s", 1.0),
    "disturbance_rejection_peak": ("Disturbance-rejection peak", "dB", 0.0),
    "disturbance_rejection_peak_omega_rad_s": ("Disturbance-rejection peak at", "rad/s", 1.0),
    "attitude_bandwidth_rad_s": ("Attitude bandwidth", "rad/s", 1.0),
    "attitude_phase_bandwidth_rad_s": ("Attitude phase bandwidth", "rad/s", 1.0),
    "attitude_gain_bandwidth_rad_s": ("Attitude gain bandwidth", "rad/s", 1.0),
    "attitude_omega_180_rad_s": ("Attitude lag of 180° at", "rad/s", 1.0),
    "attitude_phase_delay_s": ("Attitude phase delay", "ms", 1e3),
    "attitude_fitted_phase_delay_s": ("Fitted attitude phase delay", "ms", 1e3),
}
"""Words, unit and factor of what a loop shows, in the order of the table; a factor of zero asks for decibels."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PairRow:
    """What can be used of one response."""

    name: str
    words: str
    band: str
    hertz: str
    points: str
    coherence: str
    error: str
    difference: str
    leakage: str
    noise: str
    unit: str

    @property
    def usable(self) -> bool:
        """Whether there is anything to use."""
        return self.points != "0"


def pair_rows(document: ResponseDocument) -> tuple[PairRow, ...]:
    """One row for each response ``output/input``."""
    return tuple(_pair_row(name, pair) for name, pair in document.pairs.items())


def _pair_row(name: str, pair: PairDocument) -> PairRow:
    output, _, input = name.partition("/")
    low, high = pair.band_rad_s or (math.nan, math.nan)
    error = None if pair.mean_random_error is None else 100.0 * pair.mean_random_error
    turn = 2.0 * math.pi
    return PairRow(
        name=name,
        words=f"{quantity(output).words} over {quantity(input).words}",
        band=f"{significant(low)} to {significant(high)}" if pair.band_rad_s else "nothing",
        hertz=f"{significant(low / turn)} to {significant(high / turn)} Hz" if pair.band_rad_s else "",
        points=str(pair.points),
        coherence=_coherence(pair.mean_coherence),
        error=significant(error, digits=2),
        difference=significant(pair.direct_difference_db, digits=2),
        leakage=significant(pair.leakage_percent, digits=2),
        noise=significant(pair.largest_input_noise_db, digits=2),
        unit=unit(pair.unit) or "1",
    )


def _coherence(value: float | None) -> str:
    return MISSING if value is None else f"{value:.2f}"


@dataclass(frozen=True, kw_only=True, slots=True)
class LoopRow:
    """A number that a loop showed."""

    words: str
    value: str
    unit: str


@dataclass(frozen=True, kw_only=True, slots=True)
class Unseen:
    """Numbers that a loop did not show, all for one reason."""

    words: str
    reason: str


def loop_rows(loop: LoopDocument) -> tuple[LoopRow, ...]:
    """What was seen of a loop, with standard deviations."""
    return tuple(
        LoopRow(words=words, value=_value(loop.numbers[name], factor), unit=of)
        for name, (words, of, factor) in _LOOP_NUMBERS.items()
        if name in loop.numbers
    )


def _value(number: EstimatedDocument, factor: float) -> str:
    if factor:
        return with_error(factor * number.value, factor * number.std)
    return with_error(20.0 * math.log10(number.value), _DB_PER_NEPER * number.std / number.value)


def unseen(loop: LoopDocument) -> tuple[Unseen, ...]:
    """What was not seen of a loop: one entry for each reason."""
    reasons: dict[str, list[str]] = {}
    for name in _LOOP_NUMBERS:
        if name in loop.not_seen:
            # A peak and the place of it are missed together.
            words = _LOOP_NUMBERS[name][0].removesuffix(" at").lower()
            reasons.setdefault(loop.not_seen[name], []).append(words)
    return tuple(
        Unseen(words=", ".join(dict.fromkeys(words)).capitalize(), reason=reason.removeprefix("not seen: "))
        for reason, words in reasons.items()
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class SplitRow:
    """How two inputs moved together."""

    inputs: str
    coherence: str


def split_rows(document: ResponseDocument) -> tuple[SplitRow, ...]:
    """One row for every two inputs."""
    return tuple(
        SplitRow(inputs=name.replace(",", ", "), coherence=_coherence(mean))
        for name, mean in document.input_coherence.items()
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class RecordRow:
    """A maneuver, its coherence when taken alone, and whether it entered the estimate."""

    maneuver: ManeuverRow
    coherence: str
    verdict: Verdict


def record_rows(document: ResponseDocument) -> tuple[RecordRow, ...]:
    """One row for each maneuver that was looked at."""
    return tuple(
        RecordRow(
            maneuver=maneuver_row(record.record, record),
            coherence=", ".join(f"{name} {_coherence(mean)}" for name, mean in record.coherence.items()),
            verdict=Verdict("good", "used") if record.used else Verdict("fair", "left out"),
        )
        for record in document.records
    )
