r"""The velocity loop as a flight itself shows it, by the set-points that the autopilot logs.

The acceleration :math:`a` that the loop asks for and the velocity :math:`v` both answer the velocity :math:`r` that
stick or path ask for, which contains no feedback. So

.. math:: P = \frac{S_{rv}}{S_{ra}}, \qquad L = P \, C_v \left(1 + \frac{A}{s}\right)

is the loop around the place, whatever gusts do; they only widen its interval. North and east fly the same gains and are
measured together. Neither a model of the attitude loop nor the drag is needed: what is wrong with them is not wrong
here. The gains in :math:`C_v` are the logged ones: that these flew is assumed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rotorid.data.findings import Finding, warn
from rotorid.data.quantities import QUANTITIES
from rotorid.data.quantity import Quantity
from rotorid.data.record import FlightRecord, Maneuver, TimeHistory
from rotorid.errors import InsufficientDataError
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


def checked_by_flight(known: KnownAxis, findings: Sequence[Finding]) -> list[Finding]:
    """Findings on a computed velocity loop, with a warning where the loop that its own flight shows excludes it.

    Both loops have the logged gains, so they compare attitude loop and drag with the flight. Whether these gains made
    the set-points stays unchecked.

    Parameters
    ----------
    known
        The loop with its flown gains and plant, see :func:`rotorid.proposing.outer.known_outer`.
    findings
        Of it.
    """
    own = known.flown
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


def exclude_each_other(figure: Quantity, other: Quantity) -> bool:
    """Whether two estimates of one figure differ by more than both errors explain.

    Examples
    --------
    >>> crossover = Quantity.normal(10.0, 0.3, "rad/s")
    >>> [exclude_each_other(crossover, Quantity.normal(value, 0.4, "rad/s")) for value in (11.0, 12.0)]
    [False, True]
    """
    return abs(figure.value - other.value) > _MOST_DEVIATIONS * math.hypot(figure.std, other.std)


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
