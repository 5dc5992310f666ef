"""From selected maneuvers to frequency responses: windows, grid, joint and direct estimates.

Known filters of the autopilot, taken off measured responses.

Remarks on feedback in the input.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import AXES, TimeHistory
from rotorid.data.response import FrequencyResponse
from rotorid.errors import UsageError
from rotorid.fitting.frequency.problem import usable_points
from rotorid.pipeline.preparation.consistency import data_quality, sensor_agreement, sensor_errors
from rotorid.pipeline.preparation.flights import Flight
from rotorid.pipeline.preparation.instruments import choose_instruments, is_free, no_instrument, open_loop
from rotorid.pipeline.preparation.segments import cut, histories, require_known, source_of, with_surroundings
from rotorid.pipeline.results import Segment
from rotorid.pipeline.settings import CompositionChoice, MeasureSettings, TaperChoice
from rotorid.signal.autopilot_filters import filter_findings, known_filters
from rotorid.signal.filters import KnownFilter
from rotorid.spectral.composite import Composition
from rotorid.spectral.derived import corrected
from rotorid.spectral.estimate import Diagnostics, diagnosed_response
from rotorid.spectral.joined import by_input, joined_diagnostics
from rotorid.spectral.windows import (
    HALF_SINE,
    HANN,
    PERIODS_IN_WINDOW,
    Taper,
    WindowPlan,
    given_windows,
    plan_windows,
)
from rotorid.typing import BoolArray, FloatArray

_PROGRESS = logging.getLogger("rotorid.progress")


POINTS = 100
HIGHEST_DEFAULT_RAD_S = 100.0
_HALF_LINE = 1.5
"""Half the width of a window's spectral line, in units of one over its length."""

_LONGEST_MARGIN_S = 20.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Measured:
    """Measured responses and where they came from.

    Parameters
    ----------
    response
        The estimate to fit.
    direct
        The direct estimate, when ``response`` is a joint one.
    segments
        The data behind them.
    asked_rad_s
        Band that was looked at.
    excited_rad_s
        Input to the highest frequency that its sweeps reached; infinite where other excitations leave that to the
        coherence.
    findings
        Remarks on the way.
    diagnostics
        What stands behind ``response``.
    lowest_rad_s
        Input to the lowest frequency that its own windows reach, where windows were chosen by input.
    unfiltered
        Outputs that known filters were taken off.
    """

    response: FrequencyResponse
    direct: FrequencyResponse | None
    diagnostics: Diagnostics
    segments: tuple[Segment, ...]
    asked_rad_s: tuple[float, float]
    excited_rad_s: Mapping[str, float]
    findings: tuple[Finding, ...]
    lowest_rad_s: Mapping[str, float] = field(default_factory=dict)
    unfiltered: tuple[str, ...] = ()

    @property
    def excited_to_rad_s(self) -> float:
        """Highest frequency that the sweeps of any input reached."""
        return max(self.excited_rad_s.values())

    @property
    def trusted_rad_s(self) -> tuple[float, float]:
        """The band that was asked for, as far as sweeps went.

        Above a sweep there is coherence too: tapers leak, and feedback turns noise into input. It means nothing. Just
        below its end a response is biased, because there the sweep fills one flank of the spectral line only: with a
        delay of 40 ms and windows of 2.5 s by 3° and 2 %. So the line of the shortest window must lie inside.
        """
        return self._trusted_to(self.excited_to_rad_s)

    def trusted_points(self, data: FrequencyResponse, coherence: float) -> BoolArray:
        """Points of a response of these inputs that can be trusted, each input as far as its own sweeps went.

        Parameters
        ----------
        data
            The estimate or the one beside it.
        coherence
            The least that counts.

        Returns
        -------
        numpy.ndarray
            Shape ``(y, u, f)``.
        """
        bands = {name: self._trusted_to(top) for name, top in self.excited_rad_s.items()}
        bands = {name: (max(low, self.lowest_rad_s.get(name, low)), high) for name, (low, high) in bands.items()}
        each = [
            usable_points(data, coherence=coherence, band_rad_s=bands[name])[:, u] for u, name in enumerate(data.inputs)
        ]
        return np.stack(each, axis=1)

    def _trusted_to(self, top_rad_s: float) -> tuple[float, float]:
        low, high = self.asked_rad_s
        line = _HALF_LINE * 2.0 * np.pi / min(self.response.windows_s)
        return low, min(high, top_rad_s - line)


def measure(
    flights: Sequence[Flight],
    *,
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    settings: MeasureSettings,
    also: Sequence[str] = (),
) -> Measured:
    """Frequency responses of the outputs to the inputs over all maneuvers together.

    Joint input–output whenever every input has an instrument, and the direct estimate beside it. Channels in ``also``
    are taken along where every record has them.

    Raises
    ------
    InsufficientDataError
        A channel is missing, or the maneuvers are too short for the band.
    UsageError
        A shift is of a channel that takes no part, or longer than a maneuver.
    """
    instruments = choose_instruments(flights, inputs, outputs, settings)
    channels = (*inputs, *outputs)
    extra = [n for n in also if n not in channels and all(n in record.channel_names for record, _ in flights)]
    followers = tuple(dict.fromkeys((*instruments, *_other_commands(flights, inputs), *extra)))
    require_known(settings.shifts, (*channels, *followers))
    # Without an instrument the quiet time would only add what feedback makes of gusts.
    wider = flights
    if instruments:
        wider = with_surroundings(flights, _margin_s(flights, settings), (*channels, *instruments))
    segments, findings = cut(wider, channels=channels, followers=followers, shifts=settings.shifts)
    records = histories(segments)
    band = settings.band_rad_s or default_band(flights, records[0].sample_rate_hz)
    windows = _windows(records, band, settings, inputs)
    _PROGRESS.info("frequency responses")
    agreement = sensor_agreement(flights)
    errors = sensor_errors(agreement, outputs)
    direct, diagnostics = _respond(records, inputs, outputs, band, windows, settings)
    joint = None
    if instruments:
        joint, diagnostics = _respond(records, inputs, outputs, band, windows, settings, instruments)
    # An input that is the excitation itself needs no instrument, nor does one that comes straight from the stick.
    free = open_loop(flights, *inputs) or all(is_free(flights, name) for name in inputs)
    unknown = settings.estimate == "auto" and not instruments and not free
    measured = Measured(
        response=replace(joint or direct, sensor_errors=errors),
        direct=direct if joint else None,
        diagnostics=diagnostics,
        segments=segments,
        asked_rad_s=band,
        excited_rad_s={name: _excited_to(_of_input(flights, name)) for name in inputs},
        lowest_rad_s={name: windows[name].lowest_rad_s for name in inputs if name in settings.input_windows_s},
        findings=(
            *findings,
            *data_quality(flights, segments, inputs, agreement),
            *(finding for plan in _different(windows) for finding in plan.findings),
            *((no_instrument(inputs),) if unknown else ()),
        ),
    )
    return without_known_filters(measured, flights) if settings.correct_filters else measured


_COMPOSITIONS: Mapping[CompositionChoice, Composition] = {
    "variance": "minimum_variance",
    "least_squares": "least_squares",
    "weights": "weights",
}
_TAPERS: Mapping[TaperChoice, Taper] = {"hann": HANN, "half_sine": HALF_SINE}


def _respond(
    records: Sequence[TimeHistory],
    inputs: Sequence[str],
    outputs: Sequence[str],
    band_rad_s: tuple[float, float],
    windows: Mapping[str, WindowPlan],
    settings: MeasureSettings,
    instruments: Sequence[str] = (),
) -> tuple[FrequencyResponse, Diagnostics]:
    """Responses with the windows that were planned for each input."""
    longest = max(windows.values(), key=lambda plan: max(plan.lengths_s))
    omega = _grid(band_rad_s, longest)
    found = {
        plan.lengths_s: diagnosed_response(
            records,
            inputs=inputs,
            outputs=outputs,
            instruments=instruments,
            omega_rad_s=omega,
            windows_s=plan.lengths_s,
            overlap=settings.overlap,
            taper=_TAPERS[settings.taper],
            composition=_COMPOSITIONS[settings.composition],
        )
        for plan in _different(windows)
    }
    if len(found) == 1:
        return next(iter(found.values()))
    whole = by_input({name: found[plan.lengths_s][0] for name, plan in windows.items()})
    lengths = list(found)
    columns = [lengths.index(windows[name].lengths_s) for name in inputs]
    return whole, joined_diagnostics(list(found.values()), whole, columns=columns)


def _different(windows: Mapping[str, WindowPlan]) -> tuple[WindowPlan, ...]:
    """Plans of inputs, each once."""
    return tuple({plan.lengths_s: plan for plan in windows.values()}.values())


def _margin_s(flights: Sequence[Flight], settings: MeasureSettings) -> float:
    """How much quiet time to take along: that of the longest window, as far as it is known yet."""
    given = [*settings.windows_s, *(one for lengths in settings.input_windows_s.values() for one in lengths)]
    if given:
        return max(given)
    return min(0.5 * max(maneuver.duration_s for _, maneuver in flights), _LONGEST_MARGIN_S)


def _windows(
    records: Sequence[TimeHistory], band_rad_s: tuple[float, float], settings: MeasureSettings, inputs: Sequence[str]
) -> dict[str, WindowPlan]:
    """Windows of each input: half of the time flown lies in records of at least the planned length.

    A gap may leave a stub of a second beside records of a minute. Windows that do not fit into it pass it over.
    """
    lengths = np.sort([record.duration_s for record in records])[::-1]
    typical = float(lengths[np.searchsorted(np.cumsum(lengths), 0.5 * lengths.sum())])
    own = {name: lengths for name, lengths in settings.input_windows_s.items() if name in inputs}
    usual = None
    if any(name not in own for name in inputs):
        usual = (
            given_windows(settings.windows_s, typical)
            if settings.windows_s
            else plan_windows(typical, float(lengths.sum()), band_rad_s)
        )
    plans = {name: given_windows(one, typical) for name, one in own.items()}
    return {name: plan for name in inputs if (plan := plans.get(name, usual)) is not None}


def _grid(band_rad_s: tuple[float, float], plan: WindowPlan) -> FloatArray:
    """Logarithmic grid over what the windows support of the band."""
    lowest = PERIODS_IN_WINDOW * 2.0 * np.pi / max(plan.lengths_s)
    low, high = max(band_rad_s[0], lowest), band_rad_s[1]
    return np.geomspace(min(low, 0.9 * high), high, POINTS)


def default_band(flights: Sequence[Flight], sample_rate_hz: float) -> tuple[float, float]:
    """Band to look at: that of the sweeps, or whatever the sample rate carries for other excitations."""
    carried = min(0.25 * np.pi * sample_rate_hz, HIGHEST_DEFAULT_RAD_S)
    bands = [m.band_rad_s for _, m in flights if m.band_rad_s is not None]
    sweeps_only = all(m.kind == "sweep" and m.band_rad_s is not None for _, m in flights)
    low = min((band[0] for band in bands), default=0.5)
    high = max((band[1] for band in bands), default=carried) if sweeps_only else carried
    return low, min(high, 0.8 * np.pi * sample_rate_hz)


def _of_input(flights: Sequence[Flight], input: str) -> Sequence[Flight]:
    """The maneuvers of an input's own axis; all, where it has none."""
    return [item for item in flights if input == f"{item[1].axis}_command"] or flights


def _excited_to(flights: Sequence[Flight]) -> float:
    tops = [m.band_rad_s[1] for _, m in flights if m.kind in ("sweep", "multisine") and m.band_rad_s is not None]
    return max(tops) if len(tops) == len(flights) else np.inf


def _other_commands(flights: Sequence[Flight], inputs: Sequence[str]) -> tuple[str, ...]:
    """Commands of the other axes that every record holds."""
    names = [f"{axis}_command" for axis in AXES]
    return tuple(n for n in names if n not in inputs and all(n in record.channel_names for record, _ in flights))


def without_known_filters(measured: Measured, flights: Sequence[Flight]) -> Measured:
    """Responses as they would be without the filters that the logs say stood in front of their outputs.

    Parameters
    ----------
    measured
        The responses.
    flights
        Records and maneuvers behind them; the filters follow from the parameters of the records.

    Raises
    ------
    UsageError
        The records were filtered differently, so that one response of all of them cannot be corrected.
    """
    chains: dict[str, tuple[KnownFilter, ...]] = {}
    findings: list[Finding] = []
    for output in measured.response.outputs:
        sources = {source_of(segment, output) for segment in measured.segments}
        found = [known_filters(record, source) for source in sorted(sources) for record, _ in flights]
        if any(chain != found[0] for chain in found):
            raise UsageError(
                f"{output} was filtered differently in the logs",
                needed="one set of filters for all logs",
                remedy="estimate each log by itself, or leave out --correct-filters",
            )
        if found[0]:
            chains[output] = found[0]
        findings += [f for source in sorted(sources) for f in filter_findings(flights[0][0], source)]
    remarked = replace(measured, findings=(*measured.findings, *findings))
    if not chains:
        return remarked
    direct = None if measured.direct is None else corrected(measured.direct, chains)
    return replace(remarked, response=corrected(measured.response, chains), direct=direct, unfiltered=tuple(chains))


def filter_delays(measured: Measured, flights: Sequence[Flight]) -> dict[str, float]:
    """Output to the delay in seconds of the known filters in its response, where all logs had the same ones.

    Parameters
    ----------
    measured
        The responses.
    flights
        Records and maneuvers behind them.
    """
    delays: dict[str, float] = {}
    for output in measured.response.outputs:
        if output in measured.unfiltered:
            continue
        sources = sorted({source_of(segment, output) for segment in measured.segments})
        chains = [known_filters(record, source) for source in sources for record, _ in flights]
        if chains[0] and all(chain == chains[0] for chain in chains):
            delays[output] = sum(known.delay_s for known in chains[0])
    return delays


_BIAS_LIMIT_DB = 1.0


def feedback_bias(measured: Measured, used: BoolArray) -> tuple[Finding, ...]:
    """How far direct estimates lie from the joint ones where those were used.

    One warning for each response that feedback biases seriously; where there is none, one remark on the worst.
    """
    if measured.direct is None or not used.any():
        return ()
    pairs = np.argwhere(used.any(axis=-1))
    judged = [_judged(measured.response, measured.direct, used, int(y), int(u)) for y, u in pairs]
    serious = tuple(finding for finding in judged if finding.severity == "warning")
    return serious or (max(judged, key=lambda finding: finding.numbers["rms_db"]),)


def _judged(response: FrequencyResponse, direct: FrequencyResponse, used: BoolArray, y: int, u: int) -> Finding:
    points = used[y, u]
    decibel = 20.0 * np.log10(np.abs(direct.values[y, u, points] / response.values[y, u, points]))
    worst = float(decibel[np.argmax(np.abs(decibel))])
    typical = float(np.sqrt(np.mean(decibel**2)))
    serious = typical > _BIAS_LIMIT_DB
    return (warn if serious else remark)(
        "closed_loop_bias",
        f"{response.outputs[y]}/{response.inputs[u]}",
        f"The joint estimate with {', '.join(response.instruments)} was used. A direct estimate would differ by "
        f"{typical:.1f} dB rms and {worst:+.1f} dB at most in the used band"
        + (
            ": feedback biases it, unless the instrument contains feedback itself."
            if serious
            else ", so feedback hardly biases this flight."
        ),
        largest_db=worst,
        rms_db=typical,
    )
