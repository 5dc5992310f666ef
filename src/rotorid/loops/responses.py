"""Logs in, frequency responses out: which stretches are used, what of each response can be used, and loops.

All rich excitations of the inputs' axes enter one estimate, except maneuvers that are far less coherent than the best
of their axis. Of a flight without excitation enter the parts in which the stick moves, as identify takes them, or else
all of it. A pair of output and input can be used where it is coherent enough and where what was measured is not the
inverse of the controller. Everything that follows from the responses (bands, means, phases that run on) is computed
here; files and pages only show it.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Unpack

import numpy as np

from rotorid.data.axes import ANGLE_OF
from rotorid.data.base import Immutable, read_only
from rotorid.data.display import html_table, lines_of
from rotorid.data.findings import Finding, refusal, remark, warn, worst_first
from rotorid.data.record import AXES, STANDARD_UNITS, FlightRecord, Maneuver
from rotorid.data.response import Estimate, FrequencyResponse
from rotorid.data.sensor_filters import with_sensor_filters
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fits.frequency.inverse import without_inverse_controller
from rotorid.flights.flights import Flight
from rotorid.flights.instruments import axes_of, axis_of, is_command, is_free
from rotorid.flights.measure import Measured, feedback_bias, given_filters_kept, measure, without_known_filters
from rotorid.flights.segments import require_known_names
from rotorid.flights.selection import (
    by_stick,
    described,
    each_once,
    excited_pairs,
    given_flights,
    of_axes,
    whole_flights,
    whole_record,
)
from rotorid.flights.sensors import corrected_record, sensor_correction, with_sensor_errors
from rotorid.io.pool import pool
from rotorid.io.records import as_records
from rotorid.loops.rate_loops import AxisLoop, axis_loop, beyond_band
from rotorid.results.model import Records
from rotorid.results.provenance import LoggedManeuver, Provenance, Refused, logged, provenance, refused
from rotorid.results.segment import Segment
from rotorid.results.summary import RemovedFilters
from rotorid.settings.measuring import ResponseSettings
from rotorid.settings.option import as_names, as_settings
from rotorid.signal.excitations import rich_excitations
from rotorid.typing import Axis, BoolArray, FloatArray

if TYPE_CHECKING:
    from rotorid.settings.option_types import ResponseOptions

_PROGRESS = logging.getLogger("rotorid.progress")


_FAR_LESS = 0.5
"""A maneuver with less than this share of the coherence of the best one on its axis is left out."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """A maneuver, its own mean coherence by pair ``output/input``, and whether it is used."""

    record: FlightRecord
    maneuver: Maneuver
    coherence: Mapping[str, float]
    used: bool = True


@dataclass(frozen=True, kw_only=True)
class ResponseRecord(LoggedManeuver):
    """A maneuver of a log that was looked at.

    Parameters
    ----------
    record, axis, kind, start_s, stop_s, band_rad_s, origin, signal
        As in :class:`rotorid.results.provenance.LoggedManeuver`.
    coherence
        Mean coherence that it has alone, by pair ``output/input``.
    used
        Whether it entered the estimate.
    """

    coherence: Mapping[str, float] = field(default_factory=dict)
    used: bool = True


@dataclass(frozen=True, kw_only=True, eq=False)
class ManeuverChoice:
    """Maneuvers of a response, those left out among the candidates."""

    candidates: tuple[Candidate, ...]
    findings: tuple[Finding, ...]

    @property
    def flown(self) -> tuple[Flight, ...]:
        """Records and maneuvers that are used."""
        return tuple(Flight(item.record, item.maneuver) for item in self.candidates if item.used)


def choose(
    records: Sequence[FlightRecord],
    inputs: Sequence[str],
    outputs: tuple[str, ...],
    settings: ResponseSettings,
) -> ManeuverChoice:
    """The rich excitations of the inputs' axes, without those that are far less coherent than the best of their axis.

    Inputs that are no commands of an axis take the excitations of the outputs' axes. Without any excitation the parts
    that a stick moves are read, or whole flights.

    Raises
    ------
    InsufficientDataError
        No record has a flight.
    UsageError
        No given segment lies inside a record, or one is of another axis.
    """
    each_once(records)
    axes = axes_of(inputs, outputs)
    flown = _given(records, axes, settings) or _found(records, axes)
    if not flown:
        return _whole_flights(records, axes, inputs)
    if len(flown) < 2:
        return ManeuverChoice(candidates=tuple(_plain(item) for item in flown), findings=())
    _PROGRESS.info("coherence of each maneuver")
    with pool(settings.workers) as workers:
        each = workers.shared(_EachCoherence(tuple(flown), tuple(inputs), outputs, settings))
        found = (map if workers.executor is None else workers.executor.map)(each, range(len(flown)))
        candidates = [
            Candidate(record=item.record, maneuver=item.maneuver, coherence=own)
            for item, own in zip(flown, found, strict=True)
        ]
    return _by_coherence(candidates)


def _given(records: Sequence[FlightRecord], axes: Sequence[Axis], settings: ResponseSettings) -> list[Flight]:
    if not settings.segments:
        return []
    return [described(flight) for flight in given_flights(records, of_axes(settings.segments, axes))]


def _found(records: Sequence[FlightRecord], axes: Sequence[Axis]) -> list[Flight]:
    return [Flight(record, m) for record in records for axis in axes for m in rich_excitations(record, axis)]


def _whole_flights(records: Sequence[FlightRecord], axes: Sequence[Axis], inputs: Sequence[str]) -> ManeuverChoice:
    candidates, findings = [], []
    # Of one command the parts in which its stick moves, as identify takes them.
    parts = by_stick(records, axes) if len(inputs) == 1 and is_command(inputs[0]) else []
    which = "its flight" if parts else "the whole flight"
    for flight in parts or _every_flight(records, axes, inputs):
        free = all(is_free([flight], name) for name in inputs)
        trap = "" if free else (" If gusts and not the pilot moved the vehicle, this response shows the controller.")
        name, start_s, stop_s = flight.record.source.name, flight.maneuver.start_s, flight.maneuver.stop_s
        candidates.append(_plain(flight))
        findings.append(
            (remark if free else warn)(
                "no_excitation",
                name,
                f"No sweep, multisine or random binary signal of {' or '.join(axes)} was found in "
                f"{name}, so {which} from {start_s:.1f} to {stop_s:.1f} s was used.{trap}",
                start_s=start_s,
                stop_s=stop_s,
            )
        )
    return ManeuverChoice(candidates=tuple(candidates), findings=tuple(findings))


def _every_flight(records: Sequence[FlightRecord], axes: Sequence[Axis], inputs: Sequence[str]) -> list[Flight]:
    """Flights from take-off to landing; of set-points also records that show neither."""
    if all(name.endswith("_setpoint") for name in inputs):
        return [whole_record(record, axes) for record in records]
    return whole_flights(records, axes)


def _plain(flown: Flight) -> Candidate:
    return Candidate(record=flown.record, maneuver=flown.maneuver, coherence={})


@dataclass(frozen=True)
class _EachCoherence:
    """The coherence of one of the maneuvers by its place: what a worker answers, since a log is large."""

    flown: tuple[Flight, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    settings: ResponseSettings

    def __call__(self, place: int) -> dict[str, float]:
        return _coherence(self.flown[place], self.inputs, self.outputs, self.settings)


def _coherence(
    flown: Flight, inputs: Sequence[str], outputs: tuple[str, ...], settings: ResponseSettings
) -> dict[str, float]:
    """The coherence that a maneuver has alone, to the input of its own axis; empty where it cannot be judged."""
    own = tuple(name for name in inputs if name == f"{flown.axis}_command") or tuple(inputs)
    direct = (
        replace(settings, instruments=(), windows_s=()) if len(own) < len(inputs) else replace(settings, windows_s=())
    )
    try:
        measured = measure([flown], inputs=own, outputs=outputs, settings=direct)
    except InsufficientDataError:
        # Too short or too still to be judged alone: it may still add to the others.
        return {}
    # That of input and output, with an instrument or without, so that maneuvers can be compared.
    response = measured.direct or measured.response
    return {
        f"{output}/{name}": float(np.mean(response.coherence[y, u]))
        for y, output in enumerate(response.outputs)
        for u, name in enumerate(response.inputs)
    }


def _by_coherence(candidates: Sequence[Candidate]) -> ManeuverChoice:
    best = {axis: max((_peak(item) for item in candidates if item.maneuver.axis == axis), default=0.0) for axis in AXES}
    kept, findings = [], []
    for item in candidates:
        top = best[item.maneuver.axis]
        used = not item.coherence or item.maneuver.origin == "given" or _peak(item) >= _FAR_LESS * top
        kept.append(replace(item, used=used))
        if not used:
            where = f"{item.record.source.name}: {item.maneuver.axis} at {item.maneuver.start_s:.1f} s"
            findings.append(
                warn(
                    "low_coherence",
                    where,
                    f"{item.record.source.name}: the {item.maneuver.axis} {item.maneuver.kind} from "
                    f"{item.maneuver.start_s:.1f} to {item.maneuver.stop_s:.1f} s was left out: its mean "
                    f"coherence is {_peak(item):.2f}, against {top:.2f} for the best of its axis. Use it with "
                    "--segment.",
                    mean_coherence=_peak(item),
                    best=top,
                )
            )
    return ManeuverChoice(candidates=tuple(kept), findings=tuple(findings))


def _peak(item: Candidate) -> float:
    """The coherence of the pair that shows the maneuver best."""
    return max(item.coherence.values(), default=0.0)


_SPLIT_IS_GOOD, _SPLIT_IS_WORTHLESS = 0.5, 0.8
"""Mean coherence between two inputs up to which their responses can be separated well, and above which not at all."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Pair(Immutable):
    """One response ``output/input`` and its usable band.

    Parameters
    ----------
    unit
        Of its magnitude.
    magnitude, phase_rad, coherence, random_error
        On the grid of the responses, shape ``(f,)``; phases run on without jumps through the usable points.
    used
        Points that can be used, shape ``(f,)``.
    band_rad_s
        First and last of them, ``None`` where there is none. The means are taken over them.
    points
        How many there are.
    mean_coherence, mean_random_error
        Means over them.
    direct_difference_db
        Rms difference of the direct estimate from a joint one.
    leakage_percent
        Rms of what the windows would have added.
    largest_input_noise_db
        How much too low noise at a measured input can have made a direct estimate at most.
    """

    unit: str
    magnitude: FloatArray
    phase_rad: FloatArray
    coherence: FloatArray
    random_error: FloatArray
    used: BoolArray
    band_rad_s: tuple[float, float] | None = None
    points: int = 0
    mean_coherence: float | None = None
    mean_random_error: float | None = None
    direct_difference_db: float | None = None
    leakage_percent: float | None = None
    largest_input_noise_db: float | None = None

    def __post_init__(self) -> None:
        numbers = ("magnitude", "phase_rad", "coherence", "random_error")
        self._set(**{name: read_only(getattr(self, name), np.float64, ndim=1) for name in numbers})
        self._set(used=read_only(self.used, np.bool_, ndim=1))


@dataclass(frozen=True, kw_only=True, eq=False)
class Responses(Immutable):
    """A finished run of :func:`response`.

    Parameters
    ----------
    measured
        The responses and the data behind them.
    used
        Points that can be used, shape ``(y, u, f)``.
    loops
        Axis to what its loop looks like.
    least_coherence
        Coherence below which points were left out.
    records
        Maneuvers that were looked at.
    findings
        Remarks, the grave ones first.
    provenance
        Where all of it came from.
    """

    measured: Measured
    used: BoolArray
    loops: Mapping[Axis, AxisLoop]
    least_coherence: float
    records: tuple[ResponseRecord, ...]
    findings: tuple[Finding, ...]
    provenance: Provenance

    def __post_init__(self) -> None:
        self._set(loops=self.loops)

    @property
    def response(self) -> FrequencyResponse:
        """The responses."""
        return self.measured.response

    @property
    def segments(self) -> tuple[Segment, ...]:
        """The data behind them."""
        return self.measured.segments

    @property
    def inputs(self) -> tuple[str, ...]:
        """Channels that drive."""
        return self.response.inputs

    @property
    def outputs(self) -> tuple[str, ...]:
        """Channels that answer."""
        return self.response.outputs

    @property
    def estimate(self) -> Estimate:
        """How the responses were estimated."""
        return self.response.estimate

    @property
    def instruments(self) -> tuple[str, ...]:
        """Channels used as instruments; empty for a direct estimate."""
        return self.response.instruments

    @property
    def windows_s(self) -> tuple[float, ...]:
        """Lengths of the windows."""
        return self.response.windows_s

    @property
    def omega_rad_s(self) -> FloatArray:
        """Frequencies, shape ``(f,)``."""
        return self.response.omega_rad_s

    @property
    def processing(self) -> tuple[str, ...]:
        """Processing of the responses since their estimation, oldest first."""
        return self.response.processing

    @property
    def filters_removed(self) -> dict[str, RemovedFilters]:
        """Output to the filters that were taken out of its responses."""
        return self.measured.filters_removed

    @cached_property
    def pairs(self) -> Mapping[str, Pair]:
        """Every response by ``output/input``."""
        return MappingProxyType(pairs_of(self.measured, self.used))

    @property
    def input_coherence(self) -> dict[str, float]:
        """Mean coherence of every two inputs by ``first,second``, where anything can be used."""
        trusted = np.asarray(self.used.any(axis=(0, 1)))
        return input_coherences(self.inputs, self.measured.diagnostics.input_coherence, trusted)

    @property
    def largest_condition(self) -> float | None:
        """Largest condition number of the inputs' spectra where anything can be used; ``None`` for one input."""
        if len(self.inputs) == 1 or not self.used.any():
            return None
        return float(self.measured.diagnostics.condition[self.used.any(axis=(0, 1))].max())

    def __repr__(self) -> str:
        return lines_of(self._heading, self._rows())

    def _repr_html_(self) -> str:
        return html_table(self._heading, ("what", "which", "says"), self._rows())

    @property
    def _heading(self) -> str:
        instruments = f" with {', '.join(self.instruments)}" if self.instruments else ""
        return f"{self.estimate} estimate{instruments}, {self.omega_rad_s.size} frequencies"

    def _rows(self) -> list[tuple[str, str, str]]:
        rows = []
        for name, pair in self.pairs.items():
            if pair.band_rad_s is None:
                rows.append((name, "nothing", "no usable points"))
                continue
            low, high = pair.band_rad_s
            means = f"coherence {pair.mean_coherence:.2f}, random error {100.0 * (pair.mean_random_error or 0.0):.1f} %"
            rows.append((name, f"{low:.2g} to {high:.3g} rad/s", f"{pair.points} points, {means}"))
        rows += [(f"{axis} loop", f"{len(loop.numbers)} numbers", loop.method) for axis, loop in self.loops.items()]
        return rows + [(f"{f.severity} {f.kind}", f.where, f.message) for f in self.findings]


def response(
    records: Records,
    *,
    inputs: str | Sequence[str] = (),
    outputs: str | Sequence[str] = (),
    settings: ResponseSettings | None = None,
    **options: Unpack[ResponseOptions],
) -> Responses:
    """Frequency responses of flight records: what ``rotorid response`` does.

    All rich excitations of the inputs' axes in all records enter one estimate, except maneuvers that are far less
    coherent than the others. Of a flight without excitation the parts in which the stick moves the axis of one command
    are read, as ``identify`` takes them; else it is read whole, from take-off to landing. Joint input–output wherever
    every input has an instrument, and the direct estimate beside it.

    Parameters
    ----------
    records
        Logs as :func:`rotorid.read` gives them, or their files; one may come without a list around it.
    inputs, outputs
        Channels, or one. What a log lacks and can be reconstructed (``u_dot``, ``p_dot``, body velocities) is. Without
        any, the set-points in which excitations stand, and what answers them.
    settings
        Choices; everything has a default.
    **options
        Fields of :class:`rotorid.settings.measuring.ResponseSettings`, which go before ``settings``.

    Returns
    -------
    Responses
        The responses, what of them can be used, loops, findings and where all came from.

    Raises
    ------
    InsufficientDataError
        Nothing can be used; the findings say why. One of them is ``inverse_controller`` where the controller alone
        moved the vehicle.
    UsageError
        A channel or an option is wrong.

    Examples
    --------
    >>> result = response("flight.BIN", inputs="roll_command", outputs="p", band_rad_s=(1, 90))  # doctest: +SKIP
    >>> result.pairs["p/roll_command"].band_rad_s  # doctest: +SKIP
    (1.2, 88.0)
    """
    settings = as_settings(ResponseSettings, settings, options)
    records = with_sensor_filters(as_records(records), settings.filters)
    inputs, outputs = as_names(inputs), as_names(outputs)
    if not inputs and not outputs:
        pairs = excited_pairs(records)
        inputs, outputs = tuple(u for u, _ in pairs), tuple(y for _, y in pairs)
    _require_channels(records, inputs, outputs, settings)
    chosen = choose(records, inputs, outputs, settings)
    sensors = None
    if settings.correct_sensors:
        sensors = sensor_correction(chosen.flown)
        corrected = {id(record): corrected_record(record, sensors.correction) for record in records}
        candidates = tuple(replace(item, record=corrected[id(item.record)]) for item in chosen.candidates)
        chosen = replace(chosen, candidates=candidates, findings=(*chosen.findings, *sensors.findings))
    measured = measure(
        chosen.flown,
        inputs=inputs,
        outputs=outputs,
        settings=replace(settings, correct_filters=False),
        also=[ANGLE_OF[axis_of(name)] for name in inputs if is_command(name) and axis_of(name) in ANGLE_OF],
    )
    if sensors is not None:
        measured = replace(measured, response=with_sensor_errors(measured.response, sensors.correction))
    # Loops and controllers are those that flew, filters and all.
    flown = measured
    if settings.correct_filters or settings.filters:
        measured = without_known_filters(measured, chosen.flown)
    else:
        kept = given_filters_kept(chosen.flown, measured.segments, outputs)
        measured = replace(measured, findings=(*measured.findings, *kept))
    response = measured.response
    limit = settings.least_coherence(joint=response.estimate == "joint")
    trusted = measured.trusted_points(response, limit)
    used, findings = without_inverse_controller(flown, trusted, settings, chosen.flown)
    if not used.any():
        raise _nothing_usable(measured, (*findings, *chosen.findings), limit)
    _PROGRESS.info("loops and margins")
    axes = [axis_of(name) for name in inputs if is_command(name)]
    loops = {axis: loop for axis in axes if (loop := axis_loop(axis, flown, chosen.flown, settings))}
    remarks = (
        *(f for record in records for f in record.findings),
        *chosen.findings,
        *measured.findings,
        *findings,
        *(finding for axis, loop in loops.items() for finding in beyond_band(axis, loop)),
        *feedback_bias(measured, used),
        *_split(measured, used),
        *_unusable(response, used, limit),
    )
    return Responses(
        measured=measured,
        used=used,
        loops=loops,
        least_coherence=limit,
        records=tuple(
            logged(item.record, item.maneuver, ResponseRecord, coherence=dict(item.coherence), used=item.used)
            for item in chosen.candidates
        ),
        findings=worst_first(remarks),
        provenance=provenance(records, settings, flights=chosen.flown, response=response),
    )


def _require_channels(
    records: Sequence[FlightRecord], inputs: Sequence[str], outputs: Sequence[str], settings: ResponseSettings
) -> None:
    """Refuse names that no log can hold, and an output that is an input."""
    for name in outputs:
        if name in inputs:
            raise UsageError(f"{name} is both input and output", needed="different channels")
    if odd := [name for name in settings.input_windows_s if name not in inputs]:
        raise UsageError(
            f"windows for {' and '.join(odd)}, which is no input", needed=f"windows of {' or '.join(inputs)}"
        )
    require_known_names((*inputs, *outputs, *settings.instruments), records)


def refused_response(
    error: InsufficientDataError,
    records: Sequence[FlightRecord],
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    settings: ResponseSettings,
) -> Refused:
    """Why data show no response: findings alone, and no number."""
    where = f"{', '.join(outputs)} over {', '.join(inputs)}" if inputs else "set-points"
    return refused(
        error,
        records,
        settings,
        otherwise=refusal("low_coherence", where, str(error)),
        inputs=inputs,
        outputs=outputs,
    )


def _split(measured: Measured, used: BoolArray) -> tuple[Finding, ...]:
    """How well several inputs can be separated."""
    diagnostics, inputs = measured.diagnostics, measured.response.inputs
    trusted = np.asarray(used.any(axis=(0, 1)))
    condition = float(diagnostics.condition[trusted].max())
    findings = []
    for name, mean in input_coherences(inputs, diagnostics.input_coherence, trusted).items():
        first, second = name.split(",")
        good = mean <= _SPLIT_IS_GOOD
        verdict = "can be separated well" if good else "can barely be separated"
        if mean > _SPLIT_IS_WORTHLESS:
            verdict = "cannot be separated"
        findings.append(
            (remark if good else warn)(
                "correlated_inputs",
                name,
                f"{first} and {second} have a mean coherence of {mean:.2f} (up to {_SPLIT_IS_GOOD:g} is good, "
                f"above {_SPLIT_IS_WORTHLESS:g} worthless) and a condition number of at most {condition:.3g}: "
                f"their responses {verdict}.",
                mean_coherence=mean,
                condition=condition,
            )
        )
    return tuple(findings)


def _unusable(response: FrequencyResponse, used: BoolArray, limit: float) -> tuple[Finding, ...]:
    """Pairs without usable points: a warning if an input shows in no output at all."""
    findings = []
    for y, u in np.argwhere(~used.any(axis=-1)):
        name = f"{response.outputs[y]}/{response.inputs[u]}"
        best = float(response.coherence[y, u].max())
        findings.append(
            (remark if used[:, u].any() else warn)(
                "low_coherence",
                name,
                f"No point of {name} is usable: its coherence reaches {best:.2f} ({limit:g} needed).",
                best_coherence=best,
                limit=limit,
            )
        )
    return tuple(findings)


def _nothing_usable(measured: Measured, findings: Sequence[Finding], limit: float) -> InsufficientDataError:
    response = measured.response
    names = f"{', '.join(response.outputs)} over {', '.join(response.inputs)}"
    causes = [finding for finding in findings if finding.kind == "inverse_controller"]
    if causes:
        return InsufficientDataError(
            causes[0].message.rstrip("."),
            needed="more excitation than gusts and noise",
            findings=findings,
        )
    remarks = [*findings, *_unusable(response, np.zeros(response.values.shape, dtype=bool), limit)]
    return InsufficientDataError(
        f"no point of {names} reaches a coherence of {limit:g} with an error below 30 %",
        needed="excitation of the input that shows in the output",
        remedy="excite the axis harder or longer, fly in calmer air, or lower --coherence",
        findings=remarks,
    )


def pairs_of(measured: Measured, used: BoolArray) -> dict[str, Pair]:
    """Every response ``output/input`` with its usable band; ``used`` has the shape ``(y, u, f)``."""
    response = measured.response
    return {
        f"{output}/{input}": _pair(measured, used[y, u], (y, u))
        for y, output in enumerate(response.outputs)
        for u, input in enumerate(response.inputs)
    }


def _pair(measured: Measured, chosen: BoolArray, row: tuple[int, int]) -> Pair:
    response, direct = measured.response, measured.direct
    input, values = response.inputs[row[1]], response.values[row]
    units = {channel.name: channel.unit for segment in measured.segments for channel in segment.history.channels}
    pair = Pair(
        unit=unit_of_ratio(response.outputs[row[0]], input, units),
        magnitude=np.abs(values),
        phase_rad=_unwrapped(values, chosen),
        coherence=response.coherence[row],
        random_error=response.random_error[row],
        used=chosen,
    )
    if not chosen.any():
        return pair
    omega, coherence = response.omega_rad_s[chosen], response.coherence[row][chosen]
    # Noise of a sensor at the input: the truth lies between S_uy/S_uu and S_yy/S_yu, that over the coherence.
    noisy = response.estimate == "direct" and not is_command(input)
    return replace(
        pair,
        band_rad_s=(float(omega[0]), float(omega[-1])),
        points=int(chosen.sum()),
        mean_coherence=float(coherence.mean()),
        mean_random_error=float(response.random_error[row][chosen].mean()),
        direct_difference_db=None if direct is None else _rms_db(direct.values[row][chosen] / values[chosen]),
        leakage_percent=100.0 * float(np.sqrt(np.mean(np.abs(measured.diagnostics.leakage[row][chosen]) ** 2))),
        largest_input_noise_db=float(-20.0 * np.log10(coherence.min())) if noisy else None,
    )


def unit_of_ratio(output: str, input: str, units: Mapping[str, str] | None = None) -> str:
    """Unit of a response; ``units`` are those of its channels where they are not those of the vocabulary.

    Examples
    --------
    >>> unit_of_ratio("p", "roll_command"), unit_of_ratio("u", "theta"), unit_of_ratio("p", "p_setpoint")
    ('rad/s', 'm/s/rad', '1')
    """
    known = {**STANDARD_UNITS, **(units or {})}
    above, below = (known.get(name, "1") for name in (output, input))
    if above == below:
        return "1"
    if below == "1":
        return above
    return f"{above}/({below})" if "/" in below else f"{above}/{below}"


def input_coherences(inputs: Sequence[str], coherence: FloatArray, trusted: BoolArray) -> dict[str, float]:
    """Mean coherence of every two inputs over the trusted frequencies, by ``first,second``."""
    pairs = [(i, j) for i in range(len(inputs)) for j in range(i + 1, len(inputs))]
    where = trusted if trusted.any() else np.ones_like(trusted)
    return {f"{inputs[i]},{inputs[j]}": float(coherence[i, j, where].mean()) for i, j in pairs}


def _unwrapped(values: np.ndarray, chosen: BoolArray) -> FloatArray:
    """Phases that run on through the usable points, which begin within half a turn below zero and above −360°."""
    phase = np.angle(values)
    index = np.flatnonzero(chosen) if chosen.any() else np.arange(phase.size)
    spine = np.unwrap(phase[index])
    spine -= 2.0 * np.pi * np.ceil((spine[0] - 0.25 * np.pi) / (2.0 * np.pi))
    near = np.interp(np.arange(phase.size), index, spine)
    return np.asarray(phase + 2.0 * np.pi * np.round((near - phase) / (2.0 * np.pi)))


def _rms_db(ratio: np.ndarray) -> float:
    return float(np.sqrt(np.mean((20.0 * np.log10(np.abs(ratio))) ** 2)))
