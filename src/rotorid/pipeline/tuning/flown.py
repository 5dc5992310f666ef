"""What flew: the controller of an axis by the parameters of the log, whether it made the commands, and with what room.

Gains are judged by the controller that a log names, where it made the logged commands
(:func:`rotorid.pipeline.preparation.controller_check.check_controller`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rotorid.data.axes import RATE_OF
from rotorid.data.findings import Finding, refusal, remark
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.models.autopilots.settings import AxisController
from rotorid.pipeline.oscillations import describe, numbers_of, remedy, reviewed_oscillations
from rotorid.pipeline.preparation.controller_check import check_controller
from rotorid.pipeline.preparation.controllers import LogControllers, acting_on, controllers_of, controllers_of_result
from rotorid.pipeline.results import IdentifiedModel
from rotorid.signal.autopilot_filters import controller_filters
from rotorid.signal.filters import combined_response
from rotorid.signal.motors import motor_limits
from rotorid.tuning.loops import ControllerParts, Gains
from rotorid.typing import Axis, FloatArray

_MOST_SATURATED = 0.02
"""Share of the time in which roll, pitch and yaw commands keep a motor at a limit above which nothing is proposed: the
plant is that of a limit cycle."""

_LEAST_NOISE_HZ = 30.0
"""Faster rates are noise, as far as they also lie beyond the band of the plant, times the next."""

_NOISE_OVER_BAND = 1.5

_FEWEST_NOISE_POINTS = 8
"""With fewer frequencies nothing is said of noise."""

_BEHIND_FILTERS = ("vehicle_angular_velocity", "RATE", "PIDR", "PIDP", "PIDY", "gyroADC")
"""Where logs have the rate as the controller takes it, so that no filter of the gyro has to be known."""


@dataclass(frozen=True, kw_only=True)
class FlownAxis:
    """The controller of an axis, and where its rate stands in the log.

    Parameters
    ----------
    axis
        ``roll``, ``pitch`` or ``yaw``.
    controller
        As flown.
    record
        Its log, ``None`` where a result alone came.
    source
        Where the rate stands in the log.
    """

    axis: Axis
    controller: AxisController
    record: FlightRecord | None
    source: str

    def parts(
        self, omega_rad_s: FloatArray, *, then: FlightRecord | None = None, noise: FloatArray | None = None
    ) -> ControllerParts:
        """What the gains do, with the filters as flown or as another record's parameters have them.

        Parameters
        ----------
        omega_rad_s
            Shape ``(f,)``.
        then
            The same log with other filters among its parameters.
        noise
            Density of the noise of the rate, shape ``(f,)``.
        """
        ones = np.ones(omega_rad_s.size, dtype=np.complex128)
        if self.record is None:
            return ControllerParts(
                controller=self.controller.controller, omega_rad_s=omega_rad_s, seen=ones, logged=ones, rate_noise=noise
            )
        acting = acting_on(self.record, self.controller.controller, source=self.source)
        seen, logged = combined_response(acting.seen, omega_rad_s), combined_response(acting.logged, omega_rad_s)
        controller = self.controller.controller
        if then is not None:
            before, after = (combined_response(controller_filters(one), omega_rad_s) for one in (self.record, then))
            seen = seen * after / before
            controller = self.with_parameters(then).controller
        return ControllerParts(
            controller=controller, omega_rad_s=omega_rad_s, seen=seen, logged=logged, rate_noise=noise
        )

    def with_parameters(self, record: FlightRecord) -> AxisController:
        """The controller by the parameters of another record."""
        assert self.record is not None  # filters are replaced in a log
        found = controllers_of(self.record).with_parameters(record.parameters).axis(self.axis)
        if found is None:
            raise UsageError(f"the parameters make no controller of {self.axis}", needed="filters that can be flown")
        return found

    def rate_noise(self, omega_rad_s: FloatArray, band_rad_s: tuple[float, float]) -> FloatArray | None:
        """Density of the noise of the logged rate, from the command beyond the motion; ``None`` where it is not seen.

        The command is logged behind all filters of its controller, so what it has beyond the band is what they let
        through: the density of the command over the squared gain of the controller. Below that the noise is taken to
        go on as it begins there.
        """
        if self.record is None:
            return None
        found = _density(self.record, f"{self.axis}_command")
        if found is None:
            return None
        at, density = found
        edge = max(2.0 * np.pi * _LEAST_NOISE_HZ, _NOISE_OVER_BAND * band_rad_s[1])
        beyond = at > edge
        if np.count_nonzero(beyond) < _FEWEST_NOISE_POINTS:
            return None
        parts = self.parts(omega_rad_s)
        size = np.abs(parts.rate(Gains.of(self.controller.controller)))
        command = np.interp(omega_rad_s, at[beyond], density[beyond], right=0.0)
        rate = command / np.maximum(size, 1e-9 * size.max()) ** 2
        first = int(np.searchsorted(omega_rad_s, edge))
        if first >= omega_rad_s.size:
            return None
        rate[:first] = rate[first]
        return np.asarray(rate)


def _density(record: FlightRecord, channel: str) -> tuple[FloatArray, FloatArray] | None:
    """One-sided density of a channel by rad/s, over the whole log: the median over windows of half a second."""
    from scipy.signal import welch

    for topic in record.topics:
        row = topic.row(channel)
        if row is not None and np.isfinite(topic.sample_rate_hz) and topic.sample_rate_hz > 2.0 * _LEAST_NOISE_HZ:
            values = topic.values[row]
            values = values[np.isfinite(values)]
            window = round(topic.sample_rate_hz)
            if values.size < 4 * window:
                return None
            hz, density = welch(values, fs=topic.sample_rate_hz, nperseg=window, average="median")
            return np.asarray(2.0 * np.pi * hz), np.asarray(density / (2.0 * np.pi))
    return None


def flown_axis(axis: Axis, model: IdentifiedModel, record: FlightRecord | None) -> FlownAxis:
    """The controller that flew an axis, by the parameters of the log or by what the result says of them.

    Raises
    ------
    InsufficientDataError
        Neither says which gains flew, or how the rate was filtered.
    """
    source = model.provenance.sources.get(RATE_OF[axis], "")
    known = model.controller
    flown = controllers_of(record) if record is not None else None if known is None else controllers_of_result(known)
    found = flown.axis(axis) if flown is not None else None
    if found is None:
        raise _no_gains(axis, flown)
    if record is None and not source.startswith(_BEHIND_FILTERS):
        raise InsufficientDataError(
            f"the filter of the gyro of {axis} is not known: its rate stands in {source or 'an unknown place'}",
            needed="the log, whose parameters tell it",
            remedy="give the log beside the result",
        )
    return FlownAxis(axis=axis, controller=found, record=record, source=source)


def flown_controllers(
    axes: Iterable[Axis], given: Sequence[IdentifiedModel], logs: Sequence[FlightRecord]
) -> dict[Axis, AxisController]:
    """Controllers of axes that need no plant, by the parameters of the first log or result that holds them.

    Parameters
    ----------
    axes
        Which; those whose gains nothing holds are left out.
    given, logs
        As for :func:`rotorid.pipeline.tuning.proposal.tune`.
    """
    known = [
        *(controllers_of(record) for record in logs),
        *(controllers_of_result(model.controller) for model in given if model.controller is not None),
    ]
    found = {axis: next(filter(None, (flown.axis(axis) for flown in known)), None) for axis in axes}
    return {axis: controller for axis, controller in found.items() if controller is not None}


def require_gains(axis: Axis, record: FlightRecord) -> None:
    """Refuse a log without gains, before anything is identified from it.

    Raises
    ------
    InsufficientDataError
        Its parameters hold no controller of the axis.
    """
    flown = controllers_of(record)
    if flown.axis(axis) is None:
        raise _no_gains(axis, flown)


def _no_gains(axis: Axis, flown: LogControllers | None) -> InsufficientDataError:
    why, remedy = ("The result has no gains", "Give the log with the result.")
    if flown is not None:
        why, remedy = flown.unknown_gains(axis)
    return InsufficientDataError(
        _clause(why),
        needed="a log with the parameters of its autopilot",
        remedy=_clause(remedy),
        findings=[refusal("no_controller", axis, f"{why}.")],
    )


def _clause(sentence: str) -> str:
    """A sentence as a part of another one."""
    own = sentence if sentence.startswith("Betaflight") else f"{sentence[:1].lower()}{sentence[1:]}"
    return own.rstrip(".")


def require_room(record: FlightRecord, model: IdentifiedModel | None = None) -> list[Finding]:
    """Refuse a flight that oscillates or whose motors were at their limits; a remark where these are not known.

    Its plant is that of a limit cycle, and gains from it would be those of its limits.

    Parameters
    ----------
    record
        The log.
    model
        Its plant: limits count where it was measured. ``None`` for the flight as a whole.

    Raises
    ------
    InsufficientDataError
        An axis oscillates, or a motor was at a limit for more than 2 % of the time.
    """
    require_calm(record)
    limits = motor_limits(record)
    own = () if model is None else [m for m in model.provenance.maneuvers if m.record == record.source.name]
    if own:
        limits = limits.during(tuple((maneuver.start_s, maneuver.stop_s) for maneuver in own))
    if limits.unknown:
        message = f"{record.source.name} {limits.unknown}: whether a motor was at a limit was not checked."
        return [remark("room_not_checked", record.source.name, message)]
    # In a chop all motors are at their lower end, and in a punch at the upper one: gains make neither.
    if limits.of(limits.by_loop) > _MOST_SATURATED:
        part = "the analyzed maneuvers" if own else "the flight"
        raise InsufficientDataError(
            f"a motor was at a limit for {100.0 * limits.share:.0f} % of {part}",
            needed=f"at most {100.0 * _MOST_SATURATED:.0f} % by roll, pitch and yaw commands",
            remedy="lower the gains first",
            findings=[limits.finding(refusal, part, "Lower the gains first.")],
        )
    return []


def require_calm(record: FlightRecord) -> None:
    """Refuse a flight in which an axis oscillates; one that never flew, or cannot be checked, passes.

    Raises
    ------
    InsufficientDataError
        An axis oscillates, with the gains to lower first.
    """
    try:
        found = reviewed_oscillations(record)
    except InsufficientDataError:
        return
    if found:
        raise InsufficientDataError(
            describe(found),
            needed="a flight in which nothing oscillates, since the log shows the limits of the loop otherwise",
            remedy="lower the gains of the axis first",
            findings=[
                refusal("oscillation", one.axis, f"{describe((one,))} {remedy(one)}", **numbers_of(one))
                for one in found
            ],
        )


def explained(flown: FlownAxis) -> list[Finding]:
    """Refuse a controller that did not make the logged command; a remark where that was not checked.

    Raises
    ------
    InsufficientDataError
        Other gains flew than those of the parameters.
    """
    if flown.record is None:
        return []
    check = check_controller(flown.record, flown.axis)
    if check.verdict == "not made":
        raise InsufficientDataError(
            _clause(check.why),
            needed="a flight whose controller is the one in its parameters",
            remedy=_clause(check.remedy),
            findings=[refusal("other_controller", flown.axis, f"{check.why}.", **check.numbers)],
        )
    return list(check.findings)


def at_ends(controller: AxisController, parts: ControllerParts) -> dict[str, ControllerParts]:
    """Parts where a D moves in flight, by the name of each end."""
    return {name: replace(parts, controller=end) for name, end in controller.ends.items()}
