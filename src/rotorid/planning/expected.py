r"""What a planned flight is expected to show, taken the way of an identification: cut, estimated, fitted.

A plan is cut into records as its log will be. In them stands what the test inputs move, known as a history, because a
sweep is a passing thing and no stationary noise, and what gusts and noise make of the loop. Every estimate is made of
spectra, and the expected ones are the sum of both,

.. math:: S_{ab} = \frac1K \sum_k A_k^* B_k + N_{ab}

with the transforms of the history in every window. From there on the estimator itself is asked what it would answer and
how sure it would be (:func:`rotorid.spectral.estimate.response_from`), and the fit of an identification where it ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.flight_plan import Entry, FlightPlan, PlannedInput
from rotorid.data.record import Channel, FlightRecord, Maneuver, Source, TimeHistory, Topic
from rotorid.data.response import FrequencyResponse
from rotorid.data.trust import ACCEPTABLE_COST, RICH_KINDS, least_coherence
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.frequency.fit import refine, weights_of
from rotorid.fitting.frequency.problem import FrequencyProblem, usable_points
from rotorid.fitting.frequency.screening import (
    above_speed_modes,
    without_structural_zeros,
    without_unseen_couplings,
)
from rotorid.fitting.least_squares import Solution
from rotorid.models.families import lacks_speed_modes
from rotorid.planning.loop import LoopModel
from rotorid.reduction.guided import Reduced, fit_and_drop, mean_cost
from rotorid.signal.excitations import find_excitations
from rotorid.spectral.conditioning import line_variance
from rotorid.spectral.estimate import response_from
from rotorid.spectral.spectra import SpectralMatrix, record_spectra
from rotorid.spectral.windows import (
    HANN,
    WindowPlan,
    band_of,
    excited_to_rad_s,
    margin_s,
    plan_of_records,
    refined,
    trusted_to_rad_s,
)
from rotorid.typing import Axis, BoolArray, ComplexArray, FloatArray
from rotorid.uncertainty.cramer_rao import Weights

_SHORT_KINDS = ("doublet", "multistep")


@dataclass(frozen=True, kw_only=True, eq=False)
class Planned(Immutable):
    """Test inputs as they will stand in the records of a fit.

    Parameters
    ----------
    flight
        Test inputs of the whole flight, one channel for each axis.
    spans
        First sample of each record, and the one after its last.
    axes
        The axes of these channels, those of the inputs of the model first.
    entries
        Where the test inputs of each axis enter.
    fitted
        The test inputs that are fitted, as an identification sees them.
    """

    flight: TimeHistory
    spans: tuple[tuple[int, int], ...]
    axes: tuple[Axis, ...]
    entries: tuple[Entry, ...]
    fitted: tuple[Maneuver, ...]

    def records(self, flight: TimeHistory | None = None) -> tuple[TimeHistory, ...]:
        """The records that are cut out of the test inputs, or out of a history of the same flight."""
        whole = flight or self.flight
        return tuple(
            replace(whole, values=whole.values[:, first:last], start_s=whole.start_s + first / whole.sample_rate_hz)
            for first, last in self.spans
        )

    def windows(self, band_rad_s: tuple[float, float], lengths_s: Sequence[float] = ()) -> WindowPlan:
        """Windows for the band: those given, or by the rule that an identification follows."""
        records_s = [(last - first) / self.flight.sample_rate_hz for first, last in self.spans]
        return plan_of_records(records_s, band_rad_s, lengths_s)

    @property
    def band_rad_s(self) -> tuple[float, float]:
        """The band to look at where none was asked for: that of the sweeps, or what the log carries."""
        return band_of(self.fitted, self.flight.sample_rate_hz)

    def excited_to_rad_s(self, axis: Axis) -> float:
        """How far up sweeps and multisines of an axis go; infinite where others leave that to the coherence."""
        return excited_to_rad_s([maneuver for maneuver in self.fitted if maneuver.axis == axis])


def as_planned(
    plan: FlightPlan,
    axes: Sequence[Axis],
    sample_rate_hz: float,
    *,
    declared: Sequence[Entry] = ("command",),
    alone: bool = False,
) -> Planned:
    """Cut a plan as an identification of some axes will cut its log.

    Doublets and multisteps are kept for verification where anything longer is flown. Quiet time of up to 20 s and half
    of a maneuver goes with it, up to the next maneuver of another axis; what then touches becomes one record.

    Parameters
    ----------
    axes
        Of the inputs of the model.
    declared
        Where test inputs enter that the log declares with their band; of others an identification finds what it can.
    alone
        Whether the log holds declared test inputs only while they are flown, so that no quiet time goes with them.

    Raises
    ------
    InsufficientDataError
        An axis is not excited.
    UsageError
        Test inputs of one axis enter at several places.
    """
    own = tuple(entered for entered in plan.inputs if entered.axis in axes)
    fitted = tuple(entered for entered in own if entered.maneuver.kind not in _SHORT_KINDS) or own
    if silent := [axis for axis in axes if axis not in {entered.axis for entered in fitted}]:
        raise InsufficientDataError(
            f"the plan {plan.name} has no test input on {', '.join(silent)}", needed="test inputs on every axis"
        )
    spans = _spans(plan, fitted, declared if alone else ())
    sources = (*axes, *(axis for axis in plan.axes if axis not in axes and _moves(plan, axis, spans)))
    flight = _flight(plan, sources, sample_rate_hz)
    return Planned(
        flight=flight,
        spans=tuple((round(start_s * sample_rate_hz), round(stop_s * sample_rate_hz)) for start_s, stop_s in spans),
        axes=sources,
        entries=tuple(_entry(plan, axis) for axis in sources),
        fitted=as_logged(fitted, flight, declared=declared),
    )


def _spans(plan: FlightPlan, fitted: Sequence[PlannedInput], alone: Sequence[Entry]) -> list[tuple[float, float]]:
    """Start and stop of each record; no quiet time goes with what enters at one of ``alone``."""
    widest_s = margin_s([entered.maneuver for entered in fitted])
    barriers = [
        other
        for other in plan.inputs
        if not any(other.start_s < own.stop_s and own.start_s < other.stop_s for own in fitted)
    ]
    spans: list[tuple[float, float]] = []
    for entered in sorted(fitted, key=lambda own: own.start_s):
        earliest = max([0.0, *(other.stop_s for other in barriers if other.stop_s <= entered.start_s)])
        latest = min([plan.duration_s, *(other.start_s for other in barriers if other.start_s >= entered.stop_s)])
        quiet_s = 0.0 if entered.entry in alone else widest_s
        start_s, stop_s = max(entered.start_s - quiet_s, earliest), min(entered.stop_s + quiet_s, latest)
        if spans and start_s < spans[-1][1]:
            start_s, stop_s = spans[-1][0], max(spans.pop()[1], stop_s)
        spans.append((start_s, stop_s))
    return spans


def _moves(plan: FlightPlan, axis: Axis, spans: Sequence[tuple[float, float]]) -> bool:
    own = [entered for entered in plan.inputs if entered.axis == axis]
    return any(entered.start_s < stop_s and start_s < entered.stop_s for entered in own for start_s, stop_s in spans)


def _entry(plan: FlightPlan, axis: Axis) -> Entry:
    entries = list(dict.fromkeys(entered.entry for entered in plan.inputs if entered.axis == axis))
    if len(entries) > 1:
        raise UsageError(f"{axis} has test inputs at {' and '.join(entries)}", needed="one entry for each axis")
    return entries[0]


def _flight(plan: FlightPlan, axes: Sequence[Axis], sample_rate_hz: float) -> TimeHistory:
    time_s = np.arange(round(plan.duration_s * sample_rate_hz)) / sample_rate_hz
    rows = [
        sum((entered.at(time_s) for entered in plan.inputs if entered.axis == axis), start=np.zeros_like(time_s))
        for axis in axes
    ]
    return TimeHistory(
        values=np.stack(rows),
        channels=tuple(Channel(name=f"{axis}_excitation", unit="1") for axis in axes),
        sample_rate_hz=sample_rate_hz,
        start_s=0.0,
    )


def as_logged(
    inputs: Sequence[PlannedInput], flight: TimeHistory, *, declared: Sequence[Entry] = ()
) -> tuple[Maneuver, ...]:
    """Kind and band of each test input as an identification takes them.

    An autopilot that makes a sweep itself logs its band. What comes from outside is found in the signals, with the band
    of its half waves: a sweep that goes through its lowest frequencies in less than a period begins higher than it was
    planned to. What is not recognized is taken for what was planned.

    Parameters
    ----------
    inputs
        What to look for.
    flight
        The test inputs of the whole flight as they are logged, one channel ``AXIS_excitation`` for each axis.
    declared
        Where test inputs enter that the log declares with their band.

    Examples
    --------
    >>> import numpy as np
    >>> from rotorid.data.record import Channel
    >>> from rotorid.excitation.plan import planned
    >>> sweep = planned("roll", "pilot_sweep", start_s=3.0, amplitude=0.2, duration_s=40.0, sample_rate_hz=100.0,
    ...                 band_rad_s=(1.0, 40.0), entry="attitude_setpoint")
    >>> flight = TimeHistory(values=[sweep.at(np.arange(4600) / 100.0)], sample_rate_hz=100.0, start_s=0.0,
    ...                      channels=(Channel(name="roll_excitation", unit="1"),))
    >>> [round(edge, 1) for edge in as_logged([sweep], flight)[0].band_rad_s]
    [1.4, 37.6]
    """
    record = FlightRecord(
        source=Source(name="plan", format="plan", sha256=""),
        topics=(Topic(name="plan", time_s=flight.time_s, channels=flight.channels, values=flight.values),),
    )
    found = [
        maneuver
        for axis in dict.fromkeys(entered.axis for entered in inputs)
        for maneuver in find_excitations(record, axis)
        if maneuver.kind in RICH_KINDS
    ]
    return tuple(
        entered.maneuver if entered.entry in declared else _as_found(entered.maneuver, found) for entered in inputs
    )


def _as_found(planned: Maneuver, found: Sequence[Maneuver]) -> Maneuver:
    """A test input as the maneuver of its axis that has most of it in common."""

    def shared_s(other: Maneuver) -> float:
        return min(planned.stop_s, other.stop_s) - max(planned.start_s, other.start_s)

    best = max((other for other in found if other.axis == planned.axis), key=shared_s, default=None)
    if best is None or shared_s(best) <= 0.5 * planned.duration_s:
        return planned
    return replace(planned, kind=best.kind, band_rad_s=best.band_rad_s, origin="found")


_SETTLING_S = 60.0
"""Time after the flight in which its last motion has died out."""


def excited_channels(loop: LoopModel, planned: Planned, omega_rad_s: FloatArray, names: Sequence[str]) -> ComplexArray:
    """Commands and outputs by the test inputs of a plan, the loop closed, shape ``(channels, sources, f)``.

    Raises
    ------
    UsageError
        The loop does not say how the test inputs get to the commands.
    """
    responses = loop.at(omega_rad_s)
    columns = [loop.inputs.index(loop.input_of(axis)) for axis in planned.axes]
    entered = np.stack(
        [loop.excitation(omega_rad_s, entry)[:, u] for entry, u in zip(planned.entries, columns, strict=True)], axis=1
    )
    commands = np.einsum("ijf,jsf->isf", responses.excited, entered)
    outputs = np.einsum("yuf,usf->ysf", responses.plant, commands)
    return np.asarray(np.concatenate([commands, outputs])[loop_rows(loop, names)])


def loop_rows(loop: LoopModel, names: Sequence[str]) -> list[int]:
    """Rows of commands and outputs of a loop, counted over both."""
    return [(*loop.inputs, *loop.outputs).index(name) for name in names]


def excited_flight(loop: LoopModel, planned: Planned, names: Sequence[str], *, highest_rad_s: float) -> TimeHistory:
    """Test inputs, commands and outputs of a whole flight without gusts and noise.

    By the frequency response of the closed loop over the whole flight, with time to settle behind it.

    Parameters
    ----------
    loop, planned
        What will fly, and what.
    names
        Commands and outputs, behind the test inputs.
    highest_rad_s
        What moves faster is left out.
    """
    from scipy.fft import irfft, next_fast_len, rfft

    flight = planned.flight
    samples, rate_hz = flight.values.shape[1], flight.sample_rate_hz
    length = int(next_fast_len(samples + round(_SETTLING_S * rate_hz), real=True))
    omega = np.asarray(2.0 * np.pi * rate_hz / length * np.arange(length // 2 + 1), dtype=np.float64)
    kept = (omega > 0.0) & (omega <= highest_rad_s)
    sources: ComplexArray = rfft(flight.values, n=length, axis=1)
    moved = np.zeros((len(names), omega.size), dtype=np.complex128)
    moved[:, kept] = np.einsum("csf,sf->cf", excited_channels(loop, planned, omega[kept], names), sources[:, kept])
    values = np.concatenate([flight.values, irfft(moved, n=length, axis=1)[:, :samples]])
    return TimeHistory(
        values=values,
        channels=(*flight.channels, *(Channel(name=name, unit="1") for name in names)),
        sample_rate_hz=rate_hz,
        start_s=flight.start_s,
    )


_BEYOND = 3.0
"""How far beyond the highest frequency the loop is followed: what is faster does not leak that far."""


def expected_response(
    loop: LoopModel,
    planned: Planned,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    omega_rad_s: FloatArray,
    windows_s: Sequence[float],
    joint: bool = True,
) -> FrequencyResponse:
    """What :func:`rotorid.spectral.estimate.frequency_response` is expected to answer.

    Parameters
    ----------
    loop
        What will fly.
    planned
        Its test inputs as they will be cut, the instruments of ``inputs`` first.
    inputs, outputs
        Channels of the response.
    omega_rad_s, windows_s
        As for the estimate.
    joint
        Whether the test inputs are the instruments, or the commands their own.

    Raises
    ------
    InsufficientDataError
        Too few windows fit into the records.

    Notes
    -----
    Estimates of few windows scatter about their expectation, coherence included; that of a coherence near zero is
    somewhat higher. Noise is taken as smooth over the line of a window, and what is known of leakage as known from
    expected responses: in flight it is known a little worse.
    """
    fine_rad_s, asked = refined(omega_rad_s)
    names = (*inputs, *outputs)
    records = planned.records(excited_flight(loop, planned, names, highest_rad_s=_BEYOND * omega_rad_s[-1]))
    flown = record_spectra(records, fine_rad_s, inputs=inputs, windows_s=windows_s)
    rows = loop_rows(loop, names)
    noise = np.moveaxis(loop.logged_noise(fine_rad_s)[np.ix_(rows, rows)], -1, 0).conj()
    matrices = tuple(_expected(matrix, noise, len(planned.axes), len(inputs)) for matrix in flown.matrices)
    if not joint:
        matrices = tuple(_self_excited(*pair) for pair in zip(matrices, flown.matrices, strict=True))
    with np.errstate(divide="ignore", invalid="ignore"):  # an output that an input cannot move has no relative error
        response, _ = response_from(
            replace(flown, matrices=matrices),
            inputs=inputs,
            outputs=outputs,
            instruments=planned.flight.names[: len(inputs)] if joint else (),
            asked=asked,
            fitted=False,
        )
    return response


def _expected(matrix: SpectralMatrix, noise: ComplexArray, sources: int, inputs: int) -> SpectralMatrix:
    """A spectral matrix of the history with what gusts and noise add, and of the inputs what they add to slopes."""
    here = noise[len(noise) - matrix.omega_rad_s.size :]
    values = matrix.values.copy()
    moved = slice(sources, sources + noise.shape[1])
    values[:, moved, moved] += here
    values[:, -inputs:, -inputs:] += line_variance(HANN, matrix.window_s) * here[:, :inputs, :inputs]
    return replace(matrix, values=values)


def _self_excited(matrix: SpectralMatrix, history: SpectralMatrix) -> SpectralMatrix:
    """The matrix for channels that are their own instruments, and are excited by what they do anyhow, too."""
    whole, planned = (np.einsum("fcc->cf", part.values).real for part in (matrix, history))
    scale = np.sqrt(whole / np.where(planned > 0.0, planned, whole))
    return replace(matrix, transforms=matrix.transforms * scale)


EstimateChoice: TypeAlias = Literal["auto", "direct", "joint"]
WeightsChoice: TypeAlias = Literal["auto", "cifer", "covariance"]


@dataclass(frozen=True, kw_only=True)
class FitSettings(Immutable):
    """How the flight will be identified; the defaults are those of an identification.

    Parameters
    ----------
    band_rad_s
        Band to look at; by default that of the sweeps, as the log declares or shows it.
    windows_s
        Window lengths; by default five by rule.
    coherence
        Least coherence of a point; by default 0.6 for a direct and 0.2 for a joint estimate.
    estimate
        ``auto`` is the joint one, as the test inputs will be logged.
    weights
        ``auto`` takes CIFER's for one response and those of the covariance of all errors for several.
    outputs
        Outputs to fit; by default all of the structure that the loop has.
    """

    band_rad_s: tuple[float, float] | None = None
    windows_s: tuple[float, ...] = ()
    coherence: float | None = None
    estimate: EstimateChoice = "auto"
    weights: WeightsChoice = "auto"
    outputs: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self._set(windows_s=tuple(self.windows_s), outputs=tuple(self.outputs))
        for what, given, kind in (
            ("estimate", self.estimate, EstimateChoice),
            ("weights", self.weights, WeightsChoice),
        ):
            if given not in get_args(kind):
                raise UsageError(f"unknown {what} {given!r}", needed=f"one of {', '.join(get_args(kind))}")

    @property
    def joint(self) -> bool:
        """Whether test inputs will be the instruments."""
        return self.estimate != "direct"

    @property
    def least_coherence(self) -> float:
        """The limit in force."""
        return least_coherence(self.coherence, joint=self.joint)


class ExpectedFit(NamedTuple):
    """Where a fit to the expected response ends.

    Parameters
    ----------
    problem
        Without the parameters that were dropped.
    solution
        The end, with the weights below.
    weights
        CIFER's, or those of the covariance of all errors.
    dropped
        Parameters that an identification would leave out.
    """

    problem: FrequencyProblem
    solution: Solution
    weights: Weights
    dropped: tuple[str, ...]


def expected_fit(problem: FrequencyProblem, choices: FitSettings) -> ExpectedFit:
    """Fit from the parameters of a problem, which are those that are expected.

    Parameters
    ----------
    problem
        Structure, expected parameters, expected response and its usable points.
    choices
        How the flight will be identified.
    """
    problem = without_unseen_couplings(without_structural_zeros(problem)[0])[0]

    def tried(part: FrequencyProblem) -> tuple[Reduced, float]:
        found = fit_and_drop(part)
        return found, mean_cost(found.problem, found.solution)

    reduced, cost = tried(problem)
    if cost > ACCEPTABLE_COST and lacks_speed_modes(problem.structure) and choices.band_rad_s is None:
        reduced = above_speed_modes(problem, tried) or reduced
    weights = weights_of(problem, choices.weights)
    return ExpectedFit(
        problem=reduced.problem,
        solution=refine(reduced.problem, reduced.solution) if weights == "covariance" else reduced.solution,
        weights=weights,
        dropped=tuple(name for name in problem.parameters.free if name not in reduced.problem.parameters.free),
    )


def usable(
    response: FrequencyResponse,
    planned: Planned,
    axes: Sequence[Axis],
    band_rad_s: tuple[float, float],
    choices: FitSettings,
) -> BoolArray:
    """Points that an identification would trust, shape ``(y, u, f)``.

    Parameters
    ----------
    response
        The expected one.
    planned, axes
        What is flown, and the axes of the inputs.
    band_rad_s, choices
        The band to look at, and how the flight will be identified.
    """
    tops = [min(band_rad_s[1], trusted_to_rad_s(planned.excited_to_rad_s(axis), response.windows_s)) for axis in axes]
    each = [
        usable_points(response, coherence=choices.least_coherence, band_rad_s=(band_rad_s[0], top))[:, u]
        for u, top in enumerate(tops)
    ]
    return np.stack(each, axis=1)
