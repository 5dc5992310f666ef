r"""The velocity loop as a flight itself shows it, by the set-points that the autopilot logs.

The acceleration :math:`a` that the loop asks for and the velocity :math:`v` both answer the velocity :math:`r` that
stick or path ask for, which contains no feedback. So

.. math:: P = \frac{S_{rv}}{S_{ra}}, \qquad L = P \, C_v \left(1 + \frac{A}{s}\right)

is the loop around the place, whatever gusts do; they only widen its interval. North and east fly the same gains and are
measured together. Neither a model of the attitude loop nor the drag is needed: what is wrong with them is not wrong
here. The gains in :math:`C_v` are the logged ones. That these flew shows in

.. math:: a = \kappa \, (C_r r - C_v v) + \gamma \, s r

where :math:`\kappa` is one for them, in gusts too, and :math:`\gamma` is the acceleration that the path adds, which no
feedback makes. Gains of the loop that are wrong by a half and more move :math:`\kappa` beyond 1.25.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rotorid.data.display import capital
from rotorid.data.findings import Finding, refusal, warn
from rotorid.data.quantities import QUANTITIES
from rotorid.data.quantity import Quantity, with_error
from rotorid.data.record import FlightRecord, Maneuver, TimeHistory
from rotorid.errors import InsufficientDataError
from rotorid.flights.command_relation import LEAST_WINDOWS, CommandRelation, windowed
from rotorid.flights.controller_check import ControllerVerdict, PathGain, path_gains
from rotorid.flights.controllers import EXPLAINED
from rotorid.flights.flights import Flight
from rotorid.flights.instruments import band_of_instrument
from rotorid.flights.segments import cut
from rotorid.io.flags import shared
from rotorid.proposing.axis import KnownAxis
from rotorid.proposing.outer import LoggedOuter
from rotorid.signal.airborne import airborne
from rotorid.spectral.derived import with_model_error
from rotorid.spectral.estimate import diagnosed_response
from rotorid.spectral.loops import sensitivity, series
from rotorid.spectral.margins import DisturbanceRejection, LoopMargins, disturbance_rejection, loop_margins
from rotorid.spectral.windows import grid_rad_s, plan_of_records
from rotorid.tuning.loops import Gains, loop_figures, quantities
from rotorid.typing import ComplexArray, FloatArray

_ASKED, _MADE, _FLOWN = "velocity_{}_feedforward", "acceleration_{}_setpoint", "velocity_{}"
_WAYS = ("north", "east")
_LOWEST_RAD_S, _OF_NYQUIST = 0.25, 0.6
_LEAST_MOTION_M_S = 0.5
_SHORTEST_S = 25.0

_MOST_DEVIATIONS = 3.0
"""Standard deviations between two estimates of a figure beyond which one is wrong; three figures are compared."""

_MODES = ("position", "position slow", "loiter", "auto", "mission", "return", "circle", "follow")
"""Modes whose velocity loop flies all the time."""

_SETTLES_S = 5.0
"""After a change of the mode: firmware then starts from the velocity that it has, which contains feedback."""
_MODEL_ERROR = 0.02

_WINDOW_S = 15.0
"""Windows in which set-points and velocity are compared; two fit in the shortest flight."""

_FASTEST_RAD_S = 5.0
"""Highest frequency of that comparison: paths are logged at 5 Hz."""

_LIKE_LOGGED, _UNLIKE_LOGGED = 1.2, 1.25
"""Factor between flown and logged gains up to which they are the same, and from which they are others. Of gains that
flew, logged at 5 and 10 Hz, it is at most 1.14."""

_SURE = 2.0
"""Standard deviations by which the factor has to be beyond that."""

_LEAST_FACTOR = 1e-3

PEAK_WIDER = 1.5
"""Factor of the interval of a peak that is read off a measured sensitivity, as the review has it."""


class LoopSeen(NamedTuple):
    """Margins of a measured loop, with the upper end of its band in rad/s."""

    margins: LoopMargins
    rejection: DisturbanceRejection
    top_rad_s: float

    @property
    def quantities(self) -> dict[str, Quantity]:
        """Its figures by name, as far as the band shows them."""
        figures = {}
        if self.margins.gain_crossovers and (phase := self.margins.phase_margin_rad) is not None:
            crossover = self.margins.gain_crossovers[-1].omega_rad_s
            figures["crossover_rad_s"] = Quantity.normal(crossover.value, crossover.std, "rad/s")
            figures["phase_margin_deg"] = Quantity.normal(math.degrees(phase.value), math.degrees(phase.std), "deg")
        peak, place = self.rejection.peak, self.rejection.peak_omega_rad_s
        # What ends near the peak biases its last points: what looks like a peak there is the end of the band.
        if peak is not None and place is not None and place.interval[1] < self.top_rad_s:
            figures["sensitivity_peak"] = Quantity.normal(peak.value, PEAK_WIDER * peak.std, "1")
        return figures


def loop_by_setpoints(own: LoggedOuter, gains: Gains, records: Sequence[FlightRecord]) -> LoopSeen | None:
    """Velocity and position loop together, as flights show them; ``None`` where none does.

    Stick or path have to ask for velocities that change by half a meter per second and more, in one mode for 30 s.

    Parameters
    ----------
    own
        The flown controller.
    gains
        Its gains.
    records
        Logs with velocity, and with the set-points of velocity and acceleration.
    """
    flights = [flight for record in records for flight in _flights(record)]
    if not flights:
        return None
    histories = [history for flight in flights for history in _histories(flight)]
    rate_hz = min(history.sample_rate_hz for history in histories)
    excited = [band_of_instrument([flight], flight.maneuver.signal)[1] for flight in flights]
    top = min(max(excited), _OF_NYQUIST * math.pi * rate_hz)
    band = (_LOWEST_RAD_S, top)
    if top < 4.0 * _LOWEST_RAD_S:
        return None
    plan = plan_of_records([history.duration_s for history in histories], band)
    try:
        plant, _ = diagnosed_response(
            histories,
            inputs=["made"],
            outputs=["flown"],
            instruments=["asked"],
            omega_rad_s=grid_rad_s(band, plan),
            windows_s=plan.lengths_s,
        )
    except InsufficientDataError:
        return None
    loop = with_model_error(series(plant, own.parts(plant.omega_rad_s).whole(gains)), _MODEL_ERROR)
    return LoopSeen(loop_margins(loop), disturbance_rejection(sensitivity(loop)), top)


class SetpointMatch(NamedTuple):
    """Whether logged gains made the accelerations that were asked for: ``made``, ``not made`` or ``not checked``.

    ``factor`` is what flew over what the logged gains make, and ``unexplained`` the share that they leave, as root mean
    square; ``None`` where nothing was compared.
    """

    verdict: ControllerVerdict
    why: str = ""
    factor: PathGain | None = None
    unexplained: float | None = None


def setpoints_match(own: LoggedOuter, records: Sequence[FlightRecord]) -> SetpointMatch:
    """Whether the logged gains of the velocity loop made its set-points, by the flights that move them.

    Parameters
    ----------
    own
        The controller by the parameters of the log.
    records
        As for :func:`loop_by_setpoints`.
    """
    relation = _relation(own, [flight for record in records for flight in _flights(record)])
    if relation is None:
        return SetpointMatch("not checked", "the log has no 30 s of moving velocity set-points")
    made, logged, ahead = (relation.signals[name] for name in ("made", "logged", "ahead"))
    related = relation.related("made")
    if not related.any():
        return SetpointMatch("not checked", "velocity and its set-point do not explain the acceleration set-point")
    gains = path_gains(made, {"logged": logged, "ahead": ahead}, related)
    factor, added = gains["logged"], min(max(gains["ahead"].slope, 0.0), 1.0)
    rest = (made - logged - added * ahead)[:, related]
    unexplained = float(np.linalg.norm(rest) / np.linalg.norm(made[:, related]))
    off, std = abs(math.log(max(factor.slope, _LEAST_FACTOR))), factor.std / max(factor.slope, _LEAST_FACTOR)
    shown = f"the flight shows {with_error(factor.slope, factor.std)} times what they make"
    if off - _SURE * std > math.log(_UNLIKE_LOGGED):
        return SetpointMatch("not made", shown, factor, unexplained)
    if unexplained > EXPLAINED:
        return SetpointMatch("not made", f"they leave {100.0 * unexplained:.0f} % unexplained", factor, unexplained)
    if off > math.log(_LIKE_LOGGED):
        return SetpointMatch("not checked", shown, factor, unexplained)
    return SetpointMatch("made", "", factor, unexplained)


def checked_by_flight(known: KnownAxis, findings: Sequence[Finding]) -> list[Finding]:
    """Findings on a computed velocity loop, with what its own flight shows of its gains and of the loop.

    Gains that made the set-points need no remark that they were not checked. Where the loop that the flight shows
    excludes the computed one, a warning says so: both have these gains, so attitude loop or drag are wrong.

    Parameters
    ----------
    known
        The loop with its flown gains and plant, see :func:`rotorid.proposing.outer.known_outer`.
    findings
        Of it.

    Raises
    ------
    InsufficientDataError
        Other gains made the set-points than those of the parameters.
    """
    own = known.flown
    match = setpoints_match(own, [own.record]) if isinstance(own, LoggedOuter) else None
    if match is not None and match.verdict == "not made":
        why = f"the logged {own.axis} gains did not make the logged acceleration set-points: {match.why}"
        raise InsufficientDataError(
            why,
            needed="a flight with the gains of its parameters",
            remedy="give the log in which these gains were flown",
            findings=[refusal("other_controller", own.axis, f"{capital(why)}.")],
        )
    if match is not None:
        findings = [shown for one in findings if (shown := _with_match(one, match)) is not None]
    seen = loop_by_setpoints(own, known.gains, [own.record]) if isinstance(own, LoggedOuter) else None
    measured = {} if seen is None else seen.quantities
    plant = known.flown_plant or known.plant
    loops = plant.drawn(known.omega_rad_s) * known.flown_parts.whole(known.gains)
    computed = quantities(loop_figures(known.omega_rad_s, loops, from_rad_s=plant.known_from_rad_s))
    both = [(QUANTITIES[name], computed[name], one) for name, one in measured.items() if name in computed]
    apart = [
        f"{figure.words} {figure.shown(flown)}, computed {figure.shown(from_parts)}"
        for figure, from_parts, flown in both
        if exclude_each_other(flown, from_parts)
    ]
    if not apart:
        return list(findings)
    message = (
        f"The set-points of {own.record.source.name} show another {own.axis} loop than its attitude loop and drag "
        f"give: {'; '.join(apart)}. One of these is wrong, so fly new gains of {own.axis} gently."
    )
    return [warn("methods_disagree", own.axis, message), *findings]


def _with_match(finding: Finding, match: SetpointMatch) -> Finding | None:
    """A finding with the reason why gains were not checked; ``None`` where they were, and made the set-points."""
    if finding.kind != "controller_unchecked":
        return finding
    return None if match.verdict == "made" else replace(finding, message=f"{finding.message.rstrip('.')}: {match.why}.")


def exclude_each_other(figure: Quantity, other: Quantity) -> bool:
    """Whether two estimates of one figure differ by more than both errors explain.

    Examples
    --------
    >>> crossover = Quantity.normal(10.0, 0.3, "rad/s")
    >>> [exclude_each_other(crossover, Quantity.normal(value, 0.4, "rad/s")) for value in (11.0, 12.0)]
    [False, True]
    """
    return abs(figure.value - other.value) > _MOST_DEVIATIONS * math.hypot(figure.std, other.std)


def _relation(own: LoggedOuter, flights: Sequence[Flight]) -> CommandRelation | None:
    """What a velocity controller made, and what its logged gains make, in windows; ``None`` where these are too few."""
    lines = np.arange(1, math.ceil(_FASTEST_RAD_S * _WINDOW_S / (2.0 * math.pi)))
    omega = np.asarray(2.0 * math.pi / _WINDOW_S * lines, dtype=np.float64)
    histories = [
        history
        for flight in flights
        for history in _histories(flight)
        if round(_WINDOW_S * history.sample_rate_hz) <= history.values.shape[1]
        and omega[-1] <= _OF_NYQUIST * math.pi * history.sample_rate_hz
        and np.isfinite(history.values).all()
    ]
    angle_1_s = own.controller.controller.angle_1_s
    parts: dict[str, list[ComplexArray]] = {}
    for history in histories:
        rate_hz = history.sample_rate_hz
        asked, made, flown = (np.asarray(history[name]) for name in ("asked", "made", "flown"))
        target = asked + angle_1_s * _summed(asked - flown, rate_hz)
        sums = {"target_sum": _summed(target, rate_hz), "flown_sum": _summed(flown, rate_hz)}
        for name, values in {"asked": asked, "made": made, "flown": flown, "target": target, **sums}.items():
            spectra = windowed(values, round(_WINDOW_S * rate_hz), 1)[:, lines]
            parts.setdefault(name, []).append(spectra)
    if sum(len(windows) for windows in parts.get("made", [])) < LEAST_WINDOWS:
        return None
    found = {name: np.concatenate(windows) for name, windows in parts.items()}
    return CommandRelation(
        omega_rad_s=omega,
        signals={"made": found["made"], "logged": _by_logged(own, omega, found), "ahead": 1j * omega * found["asked"]},
        rate=found["flown"],
        setpoint=found["asked"],
        throttle=np.zeros(len(found["flown"])),
        source="",
        sample_rate_hz=histories[0].sample_rate_hz,
    )


def _by_logged(own: LoggedOuter, omega_rad_s: FloatArray, found: Mapping[str, ComplexArray]) -> ComplexArray:
    """What the logged gains make of set-point and velocity, the integral of sums in time, which leak into no line."""
    parts, gains, s = own.parts(omega_rad_s), Gains.of(own.controller.controller), 1j * omega_rad_s
    by_target = {name: s * response for name, response in parts.by_angle.items()}
    made = by_target["ahead"] * found["target"]
    for gain, name in ((gains.P, "P"), (gains.D, "D")):
        made = made + gain * (by_target[name] * found["target"] - parts.by_rate[name] * found["flown"])
    of_sum = by_target["I"] * found["target_sum"] - parts.by_rate["I"] * found["flown_sum"]
    # The step for which an acceleration holds is a delay of the loop, not of what is logged.
    return np.asarray((made + gains.I * s * of_sum) * np.exp(s * own.controller.controller.delay_s))


def _summed(values: FloatArray, rate_hz: float) -> FloatArray:
    """Integral over time, by trapezoids."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]))]) / rate_hz


def _flights(record: FlightRecord) -> Iterator[Flight]:
    """Parts in the air that a velocity loop flew, one flight for each way that was moved."""
    names = {name.format(way) for name in (_ASKED, _MADE, _FLOWN) for way in _WAYS}
    if not names <= set(record.channel_names):
        return
    try:
        intervals = airborne(record).intervals
    except InsufficientDataError:
        return
    own = tuple((start_s + _SETTLES_S, stop_s) for mode, start_s, stop_s in record.status.modes if mode in _MODES)
    for start_s, stop_s in shared(intervals, tuple(part for part in own if part[1] - part[0] >= _SHORTEST_S)):
        for way in _WAYS:
            track = record[_ASKED.format(way)]
            inside = (track.time_s >= start_s) & (track.time_s <= stop_s) & np.isfinite(track.values)
            time_s, values = track.time_s[inside], track.values[inside]
            if time_s.size < 2 or time_s[-1] - time_s[0] < _SHORTEST_S or np.ptp(values) < _LEAST_MOTION_M_S:
                continue
            maneuver = Maneuver(
                axis="pitch",
                kind="other",
                start_s=float(time_s[0]),
                stop_s=float(time_s[-1]),
                origin="found",
                signal=_ASKED.format(way),
            )
            yield Flight(record, maneuver)


def _histories(flight: Flight) -> list[TimeHistory]:
    """The channels of one way under names that both ways share."""
    way = flight.maneuver.signal.split("_")[1]
    ours = {_ASKED.format(way): "asked", _MADE.format(way): "made", _FLOWN.format(way): "flown"}
    segments, _ = cut([flight], channels=tuple(ours))
    return [
        replace(
            segment.history,
            channels=tuple(
                replace(channel, name=ours.get(channel.name, channel.name)) for channel in segment.history.channels
            ),
        )
        for segment in segments
    ]
