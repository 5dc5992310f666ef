"""From selected maneuvers to frequency responses: instruments, windows, grid, joint and direct estimates."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rotorid.data.channel import AXES
from rotorid.data.findings import Finding
from rotorid.data.history import TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.errors import UsageError
from rotorid.pipeline.identification import Segment
from rotorid.pipeline.selection import Flown, axis_of, cut, find_instrument, histories
from rotorid.pipeline.settings import IdentifySettings
from rotorid.signal.clock import missing_channel
from rotorid.spectral.estimate import frequency_response
from rotorid.spectral.windows import PERIODS_IN_WINDOW, given_windows, plan_windows
from rotorid.typing import BoolArray, FloatArray

POINTS = 100
HIGHEST_DEFAULT_RAD_S = 100.0
_BIAS_LIMIT_DB = 1.0
_HALF_LINE = 1.5
"""Half the width of the main lobe of a half-sine taper, in units of one over its length."""

_CORRELATION_LIMIT = 0.5
_LEAST_SHARE = 0.05


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
    cross_coherence
        Coherence of each other command with the excitation, shape ``(f,)``.
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
    cross_coherence: Mapping[str, FloatArray]
    asked_rad_s: tuple[float, float]
    excited_to_rad_s: float
    findings: tuple[Finding, ...]

    @property
    def trusted_rad_s(self) -> tuple[float, float]:
        """The band that was asked for, as far as sweeps went.

        Above a sweep there is coherence too: tapers leak, and feedback turns noise into input. It means nothing. Just
        below its end a response is biased, because there the sweep fills one flank of the spectral line only: with a
        delay of 40 ms and windows of 2.5 s by 3° and 2 %. So the line of the shortest window must lie inside.
        """
        low, high = self.asked_rad_s
        line = _HALF_LINE * 2.0 * np.pi / min(self.response.windows_s)
        return low, min(high, self.excited_to_rad_s - line)


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
    instruments = choose_instruments(flown, inputs, outputs, settings)
    others = _other_commands(flown, inputs)
    followers = tuple(dict.fromkeys((*instruments, *others)))
    segments, findings = cut(flown, channels=(*inputs, *outputs), followers=followers, progress=progress)
    records = histories(segments)
    band = settings.band_rad_s or default_band(flown, records[0].sample_rate_hz)
    lengths = [record.duration_s for record in records]
    if settings.windows_s:
        plan = given_windows(settings.windows_s, min(lengths))
    else:
        plan = plan_windows(min(lengths), sum(lengths), band)
    low = max(band[0], PERIODS_IN_WINDOW * 2.0 * np.pi / max(plan.lengths_s))
    omega: FloatArray = np.geomspace(min(low, 0.9 * band[1]), band[1], POINTS)
    progress("frequency responses")
    common: dict[str, Any] = {"inputs": inputs, "outputs": outputs, "omega_rad_s": omega, "windows_s": plan.lengths_s}
    direct = frequency_response(records, **common)
    cross = _cross_coherence(records, instruments or inputs, others, common)
    if not instruments:
        remark = (_no_instrument(inputs),) if settings.estimate == "auto" else ()
        return Measured(
            response=direct,
            beside=None,
            segments=segments,
            cross_coherence=cross,
            asked_rad_s=band,
            excited_to_rad_s=_excited_to(flown),
            findings=(*findings, *plan.findings, *remark),
        )
    joint = frequency_response(records, **common, instruments=instruments)
    return Measured(
        response=joint,
        beside=direct,
        segments=segments,
        cross_coherence=cross,
        asked_rad_s=band,
        excited_to_rad_s=_excited_to(flown),
        findings=(*findings, *plan.findings),
    )


def choose_instruments(
    flown: Sequence[Flown], inputs: Sequence[str], outputs: Sequence[str], settings: IdentifySettings
) -> tuple[str, ...]:
    """Instruments for all inputs, or none.

    Raises
    ------
    UsageError
        The joint estimate was asked for and an instrument is missing, or the number does not match.
    """
    if settings.estimate == "direct":
        return ()
    if settings.instruments:
        _require_instruments(flown, inputs, outputs, settings.instruments)
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


def _require_instruments(
    flown: Sequence[Flown], inputs: Sequence[str], outputs: Sequence[str], instruments: Sequence[str]
) -> None:
    for name in instruments:
        if name in (*inputs, *outputs):
            raise UsageError(
                f"{name} is part of the response itself",
                needed="an instrument: a channel that excites the input and contains no feedback",
                remedy="name another one, or use --estimate direct",
            )
        for record, _ in flown:
            if name not in record.channel_names:
                raise missing_channel(record, name, remedy="name a channel of the log with --instrument")


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


def feedback_bias(measured: Measured, used: BoolArray) -> tuple[Finding, ...]:
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


def correlated_inputs(measured: Measured, used: BoolArray) -> tuple[Finding, ...]:
    """Commands of other axes that moved along: a model of one input takes their effect for its own."""
    points = used.any(axis=(0, 1))
    findings = []
    for name, coherence in measured.cross_coherence.items():
        mean = float(np.mean(coherence[points])) if points.any() else 0.0
        if mean > _CORRELATION_LIMIT:
            findings.append(
                Finding(
                    kind="correlated_inputs",
                    severity="warning",
                    where=f"{name}, {measured.response.inputs[0]}",
                    message=(
                        f"{name} moved along with the excitation (mean coherence {mean:.2f} in the fitted band). What "
                        f"it does to {', '.join(measured.response.outputs)} is taken for an effect of "
                        f"{', '.join(measured.response.inputs)}."
                    ),
                    numbers={"mean_coherence": mean, "limit": _CORRELATION_LIMIT},
                )
            )
    return tuple(findings)


def _other_commands(flown: Sequence[Flown], inputs: Sequence[str]) -> tuple[str, ...]:
    """Commands of the other axes that every record holds."""
    names = [f"{axis}_command" for axis in AXES]
    return tuple(n for n in names if n not in inputs and all(n in record.channel_names for record, _ in flown))


def _cross_coherence(
    records: Sequence[TimeHistory], drivers: Sequence[str], others: Sequence[str], common: Mapping[str, Any]
) -> dict[str, FloatArray]:
    size = {name: sum(float(np.std(record[name])) for record in records) for name in (*others, *common["inputs"])}
    moving = [name for name in others if size[name] > _LEAST_SHARE * max(size[own] for own in common["inputs"])]
    if len(drivers) != 1 or not moving:
        return {}
    response = frequency_response(records, **{**common, "inputs": tuple(drivers), "outputs": tuple(moving)})
    return {name: response.coherence[row, 0] for row, name in enumerate(moving)}


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
