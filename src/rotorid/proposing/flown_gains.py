"""The flown controller of an axis by the parameters of the log, whether it made the commands, and motor limits.

Gains are judged with the controller of the log, if it made the logged commands
(:func:`rotorid.flights.controller_check.check_controller`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from rotorid.autopilots.filters import KnownFilter, combined_response
from rotorid.autopilots.registry import named
from rotorid.checking.candidate import UNFILTERED
from rotorid.data.axes import RATE_OF
from rotorid.data.display import capital
from rotorid.data.findings import Finding, refusal, remark, warn
from rotorid.data.quantity import beyond
from rotorid.data.record import FlightRecord, Source
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flights.command_noise import LEAST_NOISE_HZ, command_density
from rotorid.flights.controller_check import check_controller
from rotorid.flights.controllers import LogControllers, controller_as_logged, controllers_of, controllers_of_result
from rotorid.flights.filter_effects import noise_behind, noise_of_rate, ratio_at_slowest
from rotorid.flights.gyro_noise import GyroNoise, gyro_noise
from rotorid.flights.oscillations import describe, numbers_of, remedy, reviewed_oscillations
from rotorid.models.autopilots.settings import AxisController
from rotorid.results.model import IdentifiedModel
from rotorid.signal.autopilot_filters import known_filters
from rotorid.signal.motors import motor_limits
from rotorid.signal.oscillations import check_oscillations
from rotorid.tuning.loops import ControllerParts, Gains
from rotorid.tuning.noise import RateNoise
from rotorid.typing import Axis, FloatArray, LoopName

_MOST_SATURATED = 0.02
"""Share of the time with a motor at a limit due to roll, pitch and yaw commands, above which nothing is proposed where
it is not known that the axis is calm: the plant may be that of a limit cycle."""

_MOST_BY_STICKS = 0.12
"""The same share where the axis is known to be calm: stable flights with full sticks and a chopped throttle reach it,
and their plants are right. More of it bends a plant, whatever did it."""

_NOISE_OVER_BAND = 1.5

_FEWEST_NOISE_POINTS = 8
"""Least number of frequencies for an estimate of noise."""


class FlownLoop(Protocol):
    """The controller of a loop as it flew, of an axis or an outer one."""

    @property
    def axis(self) -> LoopName:
        """Its name."""

    @property
    def controller(self) -> AxisController:
        """As flown."""

    @property
    def record(self) -> FlightRecord:
        """Its log."""

    @property
    def source(self) -> str:
        """Place of what the loop controls in the log."""

    @property
    def passed(self) -> tuple[KnownFilter, ...]:
        """Filters on it."""

    def parts(
        self, omega_rad_s: FloatArray, *, then: FlightRecord | None = None, noise: FloatArray | None = None
    ) -> ControllerParts:
        """Transfer functions of the gains, with the flown filters or those of another record's parameters."""

    def with_parameters(self, record: FlightRecord) -> AxisController:
        """The controller by the parameters of another record."""

    def rate_noise(self, omega_rad_s: FloatArray, band_rad_s: tuple[float, float], /) -> FloatArray | None:
        """Density of the noise of what the loop controls; ``None`` if not measured."""


@dataclass(frozen=True, kw_only=True)
class LoggedLoop:
    """The controller of an axis, and the place of its rate in the log.

    Parameters
    ----------
    axis
        ``roll``, ``pitch`` or ``yaw``.
    controller
        As flown.
    record
        Its log; for a result alone a record without samples, with the parameters of the result.
    source
        Place of the plant's rate in the log.
    density
        Rad/s and one-sided density of the command over the flight, shape ``(2, n)``; ``None`` where it was logged too
        slowly.
    known
        The controllers of all axes, with their source.
    kept
        Noise of the rate behind the flown filters, which a result kept of its log; ``None`` for a log.
    """

    axis: Axis
    controller: AxisController
    record: FlightRecord
    source: str
    known: LogControllers
    density: FloatArray | None = None
    kept: RateNoise | None = None

    @cached_property
    def gyro(self) -> GyroNoise | None:
        """Noise of the gyro over its whole spectrum; ``None`` where the log does not show it."""
        try:
            return gyro_noise(self.record)
        except InsufficientDataError:
            return None

    @property
    def passed(self) -> tuple[KnownFilter, ...]:
        """Filters on the rate of the plant; none where ``identify`` removed them."""
        return () if self.source.endswith(UNFILTERED) else known_filters(self.record, self.source)

    def parts(
        self, omega_rad_s: FloatArray, *, then: FlightRecord | None = None, noise: FloatArray | None = None
    ) -> ControllerParts:
        """Transfer functions of the gains, with the flown filters or those of another record's parameters.

        Parameters
        ----------
        omega_rad_s
            Shape ``(f,)``.
        then
            The same log with other filters among its parameters.
        noise
            Density of the noise of the rate, shape ``(f,)``, which counts where that of the gyro is not known.
        """
        of_gyro = self._gyro_noise(then or self.record)
        source = self.source.removesuffix(UNFILTERED)
        acting = controller_as_logged(self.record, self.controller.controller, source=source)
        filters, logged = combined_response(acting.filters, omega_rad_s), combined_response(self.passed, omega_rad_s)
        controller = self.controller.controller
        if then is not None:
            filters = filters * ratio_at_slowest(self.record, then, omega_rad_s)
            controller = self.with_parameters(then).controller
        return ControllerParts(
            controller=controller,
            omega_rad_s=omega_rad_s,
            filters=filters,
            logged=logged,
            rate_noise=noise,
            gyro_noise=of_gyro,
        )

    def _gyro_noise(self, then: FlightRecord) -> RateNoise | None:
        """Noise of the rate behind the filters of a record, by the log or by what its result kept."""
        if self.gyro is not None:
            return noise_of_rate(self.record, then, self.gyro, self.axis)
        return None if self.kept is None else noise_behind(self.kept, self.record, then)

    def with_parameters(self, record: FlightRecord) -> AxisController:
        """The controller by the parameters of another record."""
        found = self.known.with_parameters(record.parameters).axis(self.axis)
        if found is None:
            raise UsageError(
                f"the parameters give no {self.axis} controller", needed="filters that the autopilot can fly"
            )
        return found

    def rate_noise(self, omega_rad_s: FloatArray, band_rad_s: tuple[float, float]) -> FloatArray | None:
        """Density of the noise of the logged rate, from the command above the motion; ``None`` if not measured.

        The command is logged behind all filters of its controller, so the noise is the density of the command above
        the band over the squared gain of the controller. Below the band the noise is assumed constant.
        """
        if self.density is None:
            return None
        at, density = self.density
        edge = max(2.0 * np.pi * LEAST_NOISE_HZ, _NOISE_OVER_BAND * band_rad_s[1])
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


def flown_axis(axis: Axis, model: IdentifiedModel, record: FlightRecord | None) -> LoggedLoop:
    """The flown controller of an axis, by the parameters of the log or of the result.

    Raises
    ------
    InsufficientDataError
        Neither contains the flown gains, or how the rate was filtered.
    """
    command, source = f"{axis}_command", model.provenance.sources.get(RATE_OF[axis], "")
    known, kept = model.controller, None
    if record is not None:
        own, flown, density = record, controllers_of(record), command_density(record, command)
    elif known is not None:
        own, flown, density = record_of(model), controllers_of_result(known), model.data.command_densities.get(command)
        if axis in model.data.rate_densities:
            omega, of_rate = model.data.rate_densities[axis]
            kept = RateNoise(omega_rad_s=omega, density=of_rate)
    else:
        raise _no_gains(axis, None)
    found = flown.axis(axis)
    if found is None:
        raise _no_gains(axis, flown)
    if record is None and known is not None and not known.settings:
        raise InsufficientDataError(
            f"the result of {axis} is from an older version and does not contain the gyro filters",
            remedy="identify again, or give the log with the result",
        )
    return LoggedLoop(axis=axis, controller=found, known=flown, record=own, source=source, density=density, kept=kept)


def record_of(model: IdentifiedModel) -> FlightRecord:
    """A record without samples, with the parameters of a result.

    Parameters
    ----------
    model
        A result with its controller.
    """
    known = model.controller
    assert known is not None
    name = next((maneuver.record for maneuver in model.provenance.maneuvers), model.name)
    return FlightRecord(
        source=Source(name=name, format=known.autopilot, sha256="", firmware=known.firmware),
        topics=(),
        parameters={**known.gains, **known.filters, **known.settings},
    )


def settings_records(given: Sequence[IdentifiedModel], logs: Sequence[FlightRecord]) -> Sequence[FlightRecord]:
    """Logs, or, without any, records without samples for the results with parameters."""
    return logs or [record_of(model) for model in given if model.controller is not None and model.controller.settings]


def flown_controllers(
    axes: Iterable[Axis], given: Sequence[IdentifiedModel], logs: Sequence[FlightRecord]
) -> dict[Axis, AxisController]:
    """Controllers of axes, by the parameters of the first log or result that contains them.

    Parameters
    ----------
    axes
        Those without known gains are left out.
    given, logs
        As for :func:`rotorid.proposing.proposal.tune`.
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
        Its parameters contain no controller of the axis.
    """
    flown = controllers_of(record)
    if flown.axis(axis) is None:
        raise _no_gains(axis, flown)


def _no_gains(axis: Axis, flown: LogControllers | None) -> InsufficientDataError:
    why, remedy = ("The result has no gains", "give the log with the result")
    if flown is not None:
        why, remedy = flown.unknown_gains(axis)
    return InsufficientDataError(
        _clause(why),
        remedy=remedy,
        findings=[refusal("no_controller", axis, f"{why}.")],
    )


def _clause(sentence: str) -> str:
    """A sentence as a part of another one."""
    own = sentence if named(sentence).name else f"{sentence[:1].lower()}{sentence[1:]}"
    return own.rstrip(".")


def require_room(
    record: FlightRecord, model: IdentifiedModel | None = None, *, axis: Axis | None = None
) -> list[Finding]:
    """Refuse a flight that oscillates or whose motors were at their limits; a remark where that is not known.

    Its plant would be that of a limit cycle. Sticks, a chopped throttle and gusts take motors to their limits too: of
    an axis that was checked and is calm, they did that up to an eighth of the time.

    Parameters
    ----------
    model
        Its plant: limits count where it was measured. ``None`` for the whole flight.
    axis
        The one that is asked about; ``None`` for all of them.

    Raises
    ------
    InsufficientDataError
        An axis oscillates, or a motor was at a limit for more than 2 % of the time, or 12 % where the axis is calm.
    """
    require_calm(record)
    limits = motor_limits(record)
    own = () if model is None else [m for m in model.provenance.maneuvers if m.record == record.source.name]
    if own:
        limits = limits.during(tuple((maneuver.start_s, maneuver.stop_s) for maneuver in own))
    if limits.unknown:
        message = f"Motor limits were not checked: {record.source.name} {limits.unknown}."
        return [remark("room_not_checked", record.source.name, message)]
    # Throttle alone brings all motors to a limit, which gains do not cause.
    by_loop = limits.of(limits.by_loop)
    if by_loop <= _MOST_SATURATED:
        return []
    part = "the analyzed maneuvers" if own else "the flight"
    calm = _is_calm(record, axis)
    if calm and by_loop <= _MOST_BY_STICKS:
        return [limits.finding(warn, part, "No axis oscillates: sticks or gusts did it. Fly the new gains gently.")]
    most = _MOST_BY_STICKS if calm else _MOST_SATURATED
    what = "fly 30 s with smaller sticks" if calm else "lower the gains first"
    raise InsufficientDataError(
        f"a motor was at a limit for {beyond(100.0 * limits.share, 100.0 * most)} % of {part}",
        needed=f"less than {100.0 * most:.0f} % from roll, pitch and yaw commands",
        remedy=what,
        findings=[limits.finding(refusal, part, f"{capital(what)}.")],
    )


def _is_calm(record: FlightRecord, axis: Axis | None) -> bool:
    """Whether an axis, or roll and pitch, were checked and do not oscillate."""
    try:
        calm = check_oscillations(record).calm
    except InsufficientDataError:
        return False
    return set(calm) >= ({axis} if axis is not None else {"roll", "pitch"})


def require_calm(record: FlightRecord) -> None:
    """Refuse a flight in which an axis oscillates; a log that cannot be checked passes.

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
            remedy="lower the gains of that axis and fly again",
            findings=[
                refusal(
                    "oscillation",
                    oscillation.axis,
                    f"{describe((oscillation,))} {remedy(oscillation)}",
                    **numbers_of(oscillation),
                )
                for oscillation in found
            ],
        )


def require_controller_match(flown: LoggedLoop) -> list[Finding]:
    """Refuse a controller that did not make the logged command; remarks where that was not checked.

    Raises
    ------
    InsufficientDataError
        Other gains were flown than those of the parameters.
    """
    check = check_controller(flown.record, flown.axis)
    if check.verdict == "not made":
        raise InsufficientDataError(
            _clause(check.why),
            needed="a flight with the gains of its parameters",
            remedy=check.remedy,
            findings=[refusal("other_controller", flown.axis, f"{check.why}.", **check.numbers)],
        )
    return list(check.findings)


def at_ends(controller: AxisController, parts: ControllerParts) -> dict[str, ControllerParts]:
    """Parts at the ends of a D that changes in flight, by the name of each end."""
    return {name: replace(parts, controller=end) for name, end in controller.ends.items()}
