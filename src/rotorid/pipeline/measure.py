"""From selected maneuvers to frequency responses: instruments, windows, grid, joint and direct estimates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.response import FrequencyResponse
from rotorid.errors import UsageError
from rotorid.pipeline.identification import Segment
from rotorid.pipeline.selection import Flown, axis_of, cut, find_instrument, histories
from rotorid.pipeline.settings import IdentifySettings
from rotorid.spectral.estimate import frequency_response
from rotorid.spectral.windows import PERIODS_IN_WINDOW, WindowPlan, plan_windows
from rotorid.typing import FloatArray

POINTS = 100
HIGHEST_DEFAULT_RAD_S = 100.0
_BIAS_LIMIT_DB = 1.0
_SWEEP_MARGIN = 1.2


@dataclass(frozen=True, kw_only=True, eq=False)
class Measured:
    """Measured responses and where they came from.

    Parameters
    ----------
    response
        The estimate to fit.
    beside
        The direct estimate, when ``response`` is a joint one.
    segments
        The data behind them.
    asked_rad_s
        Band that was looked at.
    excited_to_rad_s
        Highest frequency that sweeps reached; infinite where other excitations leave that to the coherence.
    findings
        Remarks on the way.
    """

    response: FrequencyResponse
    beside: FrequencyResponse | None
    segments: tuple[Segment, ...]
    asked_rad_s: tuple[float, float]
    excited_to_rad_s: float
    findings: tuple[Finding, ...]

    @property
    def trusted_rad_s(self) -> tuple[float, float]:
        """The band that was asked for, as far as sweeps went.

        Above a sweep there is coherence too: tapers leak, and feedback turns noise into input. It means nothing.
        """
        low, high = self.asked_rad_s
        return low, min(high, _SWEEP_MARGIN * self.excited_to_rad_s)


def measure(
    flown: Sequence[Flown],
    *,
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    settings: IdentifySettings,
    progress: Callable[[str], None] = lambda _: None,
) -> Measured:
    """Frequency responses of the outputs to the inputs over all maneuvers together.

    Joint input–output whenever every input has an instrument, and the direct estimate beside it.

    Raises
    ------
    InsufficientDataError
        A channel is missing, or the maneuvers are too short for the band.
    """
    instruments = choose_instruments(flown, inputs, settings)
    segments, findings = cut(flown, channels=(*inputs, *outputs), followers=instruments, progress=progress)
    records = histories(segments)
    band = settings.band_rad_s or default_band(flown, records[0].sample_rate_hz)
    lengths = [record.duration_s for record in records]
    if settings.windows_s:
        plan = WindowPlan(lengths_s=tuple(sorted(settings.windows_s, reverse=True)))
    else:
        plan = plan_windows(min(lengths), sum(lengths), band)
    low = max(band[0], PERIODS_IN_WINDOW * 2.0 * np.pi / max(plan.lengths_s))
    omega: FloatArray = np.geomspace(min(low, 0.9 * band[1]), band[1], POINTS)
    progress("frequency responses")
    common = {"inputs": inputs, "outputs": outputs, "omega_rad_s": omega, "windows_s": plan.lengths_s}
    direct = frequency_response(records, **common)  # type: ignore[arg-type]
    if not instruments:
        remark = (_no_instrument(inputs),) if settings.estimate == "auto" else ()
        return Measured(
            response=direct,
            beside=None,
            segments=segments,
            asked_rad_s=band,
            excited_to_rad_s=_excited_to(flown),
            findings=(*findings, *plan.findings, *remark),
        )
    joint = frequency_response(records, **common, instruments=instruments)  # type: ignore[arg-type]
    return Measured(
        response=joint,
        beside=direct,
        segments=segments,
        asked_rad_s=band,
        excited_to_rad_s=_excited_to(flown),
        findings=(*findings, *plan.findings),
    )


def choose_instruments(flown: Sequence[Flown], inputs: Sequence[str], settings: IdentifySettings) -> tuple[str, ...]:
    """Instruments for all inputs, or none.

    Raises
    ------
    UsageError
        The joint estimate was asked for and an instrument is missing, or the number does not match.
    """
    if settings.estimate == "direct":
        return ()
    if settings.instruments:
        if len(settings.instruments) != len(inputs):
            raise UsageError(
                f"{len(settings.instruments)} instruments for {len(inputs)} inputs came", needed="one for each input"
            )
        return settings.instruments
    found = [find_instrument(flown, axis_of(name)) for name in inputs]
    if all(found):
        return tuple(name for name in found if name)
    if settings.estimate == "joint":
        missing = ", ".join(name for name, instrument in zip(inputs, found, strict=True) if not instrument)
        raise UsageError(
            f"no instrument for {missing} was found in the log",
            needed="a channel that excites it and contains no feedback",
            remedy="name one with --instrument, or use --estimate direct",
        )
    return ()


def default_band(flown: Sequence[Flown], sample_rate_hz: float) -> tuple[float, float]:
    """Band to look at: that of the sweeps, or whatever the sample rate carries for other excitations."""
    carried = min(0.25 * np.pi * sample_rate_hz, HIGHEST_DEFAULT_RAD_S)
    bands = [m.band_rad_s for _, m in flown if m.band_rad_s is not None]
    sweeps_only = all(m.kind == "sweep" and m.band_rad_s is not None for _, m in flown)
    low = min((band[0] for band in bands), default=0.5)
    high = max((band[1] for band in bands), default=carried) if sweeps_only else carried
    return low, min(high, 0.8 * np.pi * sample_rate_hz)


def _excited_to(flown: Sequence[Flown]) -> float:
    tops = [m.band_rad_s[1] for _, m in flown if m.kind == "sweep" and m.band_rad_s is not None]
    return max(tops) if len(tops) == len(flown) else np.inf


def feedback_bias(measured: Measured, used: np.ndarray) -> tuple[Finding, ...]:
    """How far the direct estimate lies from the joint one where the joint one was used."""
    if measured.beside is None or not used.any():
        return ()
    ratio = np.abs(measured.beside.values[used] / measured.response.values[used])
    decibel = 20.0 * np.log10(ratio)
    worst = float(decibel[np.argmax(np.abs(decibel))])
    instruments = ", ".join(measured.response.instruments)
    typical = float(np.sqrt(np.mean(decibel**2)))
    serious = typical > _BIAS_LIMIT_DB
    return (
        Finding(
            kind="closed_loop_bias",
            severity="warning" if serious else "info",
            where=f"{measured.response.outputs[0]}/{measured.response.inputs[0]}",
            message=(
                f"The joint estimate with {instruments} was used. A direct estimate would differ by {typical:.1f} dB "
                f"rms and {worst:+.1f} dB at most in the fitted band"
                + (": feedback biases it." if serious else ", so feedback hardly biases this flight.")
            ),
            numbers={"largest_db": worst, "rms_db": typical},
        ),
    )


def _no_instrument(inputs: Sequence[str]) -> Finding:
    names = ", ".join(inputs)
    return Finding(
        kind="closed_loop_bias",
        severity="warning",
        where=names,
        message=(
            f"No excitation free of feedback is logged for {names}, so the direct estimate was used. In closed loop "
            "it leans toward the inverse of the controller wherever gusts and noise rule."
        ),
    )
