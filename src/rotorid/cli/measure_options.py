"""Options that all commands share which measure responses, as the choices of a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


def channel_names(text: str | None) -> tuple[str, ...]:
    """``CHANNEL,...`` as names."""
    return tuple(name.strip() for name in text.split(",")) if text else ()


def measure_choices(
    *,
    band: str | None,
    windows: str | None,
    coherence: float | None,
    estimate: str,
    instrument: str | None,
    segment: Sequence[str] | None,
    shift: Sequence[str] | None,
    seed: int = 0,
) -> dict[str, Any]:
    """Fields of :class:`rotorid.pipeline.settings.MeasureSettings` from the texts of the command line.

    Raises
    ------
    UsageError
        A text cannot be read.
    """
    from rotorid.pipeline.settings import parse_band, parse_numbers, parse_segment, parse_shifts

    return {
        "band_rad_s": parse_band(band) if band else None,
        "windows_s": parse_numbers(windows) if windows else (),
        "coherence": coherence,
        "estimate": estimate,
        "instruments": channel_names(instrument),
        "segments": tuple(parse_segment(text) for text in segment or ()),
        "shifts": parse_shifts(tuple(shift or ())),
        "seed": seed,
    }
