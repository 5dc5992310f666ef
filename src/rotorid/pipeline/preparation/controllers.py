"""Rate controllers of the logs as they act on a logged rate: gains, steps, and the filters on either side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.record import FlightRecord
from rotorid.models.autopilots.reading import axis_controller
from rotorid.models.autopilots.settings import AxisController
from rotorid.models.controller import RateController
from rotorid.pipeline.preparation.flights import Flight
from rotorid.pipeline.preparation.instruments import axis_of
from rotorid.pipeline.preparation.measure import Measured
from rotorid.pipeline.preparation.segments import source_of
from rotorid.signal.autopilot_filters import controller_filters, known_filters
from rotorid.signal.filters import KnownFilter, combined_response
from rotorid.typing import ComplexArray, FloatArray

_EVERY_STEP_HZ = 200.0
"""A rate that is logged as often is logged at every step of its controller."""

_LEAST_PASSED = 0.01
"""Of a channel that its filters leave less of, nothing can be said."""

_LEAST_THRUST = 0.05


@dataclass(frozen=True, kw_only=True)
class LoggedController:
    r"""A rate controller by the rate in the log.

    .. math:: C_{log} = \frac{C_y F_\omega + C_r F_t A / s}{F_{log}}

    The rate controller sees the rate behind filters :math:`F_\omega`, the angle loop sees the motion itself, and the
    log what is left of it behind :math:`F_{log}`.

    Parameters
    ----------
    controller
        Gains and steps.
    seen
        Filters in front of the rate that the controller takes.
    logged
        Filters in front of the rate in the log.
    """

    controller: RateController
    seen: tuple[KnownFilter, ...] = ()
    logged: tuple[KnownFilter, ...] = ()

    @property
    def rate_loop(self) -> LoggedController:
        """The same without its angle loop."""
        return replace(self, controller=self.controller.rate_loop)

    def response(self, omega_rad_s: FloatArray) -> ComplexArray:
        """Command by the rate in the log, shape ``(f,)``, at frequencies above zero."""
        passed = combined_response(self.logged, omega_rad_s)
        left = np.maximum(np.abs(passed), _LEAST_PASSED) * np.exp(1j * np.angle(passed))
        return np.asarray(self.controller.response(omega_rad_s, combined_response(self.seen, omega_rad_s)) / left)


def logged_controller(record: FlightRecord, command: str, *, source: str) -> LoggedController | None:
    """The controller of a command as it acts on a logged rate; ``None`` where the log holds no gains.

    Parameters
    ----------
    record
        With the parameters of the autopilot.
    command
        Such as ``roll_command``.
    source
        Where the logged rate stands in the log. Of one whose filters are not known it is taken that the controller
        sees it as it is.
    """
    found = logged_axis(record, command, source=source)
    return None if found is None else acting_on(record, found.controller, source=source)


def logged_axis(
    record: FlightRecord, command: str, *, source: str, throttle: float | None = None
) -> AxisController | None:
    """What the parameters of a log say of the controller of a command; ``None`` where it holds no gains.

    Parameters
    ----------
    record, command, source
        As for :func:`logged_controller`.
    throttle
        Share of the throttle that was flown, on which controllers of Betaflight depend; the usual one of the log when
        not given.
    """
    return axis_controller(
        record.parameters,
        axis_of(command),
        firmware=record.source.firmware,
        loop_rate_hz=_loop_rate_hz(record, source),
        throttle=usual_throttle(record) if throttle is None else throttle,
    )


def acting_on(record: FlightRecord, controller: RateController, *, source: str) -> LoggedController:
    """A controller as it acts on a logged rate.

    Parameters
    ----------
    record, source
        As for :func:`logged_controller`.
    controller
        Gains and steps.
    """
    logged = known_filters(record, source)
    # A mean over a loop is no filter of the controller; an unknown source is taken for the controller's own.
    seen = controller_filters(record) if logged else ()
    return LoggedController(controller=controller, seen=seen, logged=logged)


def usual_throttle(record: FlightRecord) -> float:
    """Median of the throttle where there is any, from zero to one; zero where it is not logged.

    Betaflight moves filters and gains by the stick, before the mixer makes room for the other axes; other autopilots
    move nothing.

    Parameters
    ----------
    record
        The log.
    """
    stick = record.source.format.startswith("Betaflight")
    names = ("thrust_stick", "thrust_command") if stick else ("thrust_command",)
    found = ((topic, topic.row(name)) for name in names for topic in record.topics)
    for topic, row in found:
        if row is not None:
            values = topic.values[row]
            values = values[np.isfinite(values) & (values > _LEAST_THRUST)]
            return min(float(np.median(values)), 1.0) if values.size else 0.0
    return 0.0


def logged_controllers(
    flights: Sequence[Flight], measured: Measured, command: str, rate: str
) -> tuple[LoggedController, ...]:
    """The controllers of a command in the logs of some flights, one for each that differs."""
    sources = dict.fromkeys(source_of(segment, rate) for segment in measured.segments if rate in segment.history.names)
    found = (logged_controller(record, command, source=source) for source in sources or [""] for record, _ in flights)
    return tuple(dict.fromkeys(controller for controller in found if controller is not None))


def _loop_rate_hz(record: FlightRecord, source: str) -> float | None:
    """Rate of the loop where the log shows it; the parameters say it otherwise."""
    if "SCHED_LOOP_RATE" in record.parameters:
        return None
    rates = [
        topic.sample_rate_hz for topic in record.topics if any(channel.source == source for channel in topic.channels)
    ]
    fastest = max(rates, default=0.0)
    return fastest if _EVERY_STEP_HZ <= fastest < np.inf else None
