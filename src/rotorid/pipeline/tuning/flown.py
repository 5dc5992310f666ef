"""What flew: the controller of an axis by the parameters of the log, whether it made the commands, and with what room.

Gains are judged by the controller that a log names. Where the log holds the rate as that controller took it, the
command is made again sample by sample. Where its rate stands in front of filters, as in ArduPilot's sweeps, the
responses to the injected excitation are compared instead: whatever the plant is, command and rate answer to it as

.. math:: G_{ue} = D_e - C G_{ye}

with the controller :math:`C` and :math:`D_e` the way of the excitation into the command, 1 at the mixer and
:math:`C_r` at the set-point of the rate.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from rotorid.data.axes import RATE_OF
from rotorid.data.findings import Finding, refusal, remark
from rotorid.data.record import FlightRecord, Source
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.models.autopilots.betaflight import NAME as BETAFLIGHT
from rotorid.models.autopilots.reading import axis_controller
from rotorid.models.autopilots.settings import AxisController
from rotorid.pipeline.checking.candidate import UNFILTERED
from rotorid.pipeline.checking.controllers import Controllers
from rotorid.pipeline.oscillations import describe, numbers_of, remedy, reviewed_oscillations
from rotorid.pipeline.preparation.command_noise import LEAST_NOISE_HZ, command_density
from rotorid.pipeline.preparation.controllers import LoggedController, acting_on, logged_axis, usual_throttle
from rotorid.pipeline.preparation.flights import Flight
from rotorid.pipeline.preparation.segments import cut
from rotorid.pipeline.responses import response
from rotorid.pipeline.results import IdentifiedModel
from rotorid.pipeline.summary import ControllerSettings
from rotorid.signal.autopilot_filters import controller_filters, known_filters
from rotorid.signal.filters import KnownFilter, combined_response
from rotorid.signal.motors import in_flight, linearization_of, logged_outputs, or_none, range_is_known
from rotorid.tuning.loops import ControllerParts, Gains
from rotorid.typing import Axis, ComplexArray, FloatArray
from rotorid.verification.time_domain import matched

_MOST_SATURATED = 0.02
"""Share of the flight with a motor at a limit above which nothing is proposed: its plant is that of a limit cycle."""

_AT_LIMIT = (0.02, 0.98)
"""Outputs of a motor, over the range in which it moves, at which it is."""

_AIRBORNE = 0.1
"""Mean output of the motors above which that counts."""

_UNLIKE = 0.35
"""Relative error of what a controller makes of the rate, its median over the band, above which other gains flew."""

_ABOVE_VELOCITY_RAD_S = 4.0
"""Below it the loops of velocity and position move the set-points."""

_FEWEST_POINTS = 5

_NOT_SEEN = 0.3
"""Share of the command that a controller must have made, for its gains to show at all."""

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
        Its log; of a result alone a record without samples, with the parameters that the result keeps.
    source
        Where the rate of the plant stands in the log.
    density
        Rad/s and one-sided density of the command over the flight, shape ``(2, n)``; ``None`` where it was logged too
        slowly.
    throttle
        Usual share of the throttle in flight.
    """

    axis: Axis
    controller: AxisController
    record: FlightRecord
    source: str
    density: FloatArray | None = None
    throttle: float = 0.0

    @property
    def passed(self) -> tuple[KnownFilter, ...]:
        """Filters that the rate of the plant has passed; none where ``identify`` took them out."""
        return () if self.source.endswith(UNFILTERED) else known_filters(self.record, self.source)

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
        source = self.source.removesuffix(UNFILTERED)
        acting = acting_on(self.record, self.controller.controller, source=source)
        seen, logged = combined_response(acting.seen, omega_rad_s), combined_response(self.passed, omega_rad_s)
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
        # Other filters do not change which firmware flew, and no longer make the logged commands.
        firmware, rate_hz = self.controller.firmware, self.controller.loop_rate_hz
        found = axis_controller(
            record.parameters, self.axis, firmware=firmware, loop_rate_hz=rate_hz, throttle=self.throttle
        )
        if found is None:
            raise UsageError(f"the parameters make no controller of {self.axis}", needed="filters that can be flown")
        return found

    def rate_noise(self, omega_rad_s: FloatArray, band_rad_s: tuple[float, float]) -> FloatArray | None:
        """Density of the noise of the logged rate, from the command beyond the motion; ``None`` where it is not seen.

        The command is logged behind all filters of its controller, so what it has beyond the band is what they let
        through: the density of the command over the squared gain of the controller. Below that the noise is taken to
        go on as it begins there.
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


def flown_axis(axis: Axis, model: IdentifiedModel, record: FlightRecord | None) -> FlownAxis:
    """The controller that flew an axis, by the parameters of the log or by what the result says of them.

    Raises
    ------
    InsufficientDataError
        Neither says which gains flew, or how the rate was filtered.
    """
    command, source = f"{axis}_command", model.provenance.sources.get(RATE_OF[axis], "")
    if record is not None:
        found = logged_axis(record, command, source=source.removesuffix(UNFILTERED))
        throttle = usual_throttle(record)
        density = command_density(record, command)
    elif (known := model.controller) is not None:
        found, throttle = _controller_of(known, axis), known.throttle or 0.0
        record, density = record_of(model), model.data.command_densities.get(command)
        if found is not None and not known.settings:
            raise InsufficientDataError(
                f"the result of {axis} does not hold the filters of its gyro: an older version made it",
                needed="a result of this version",
                remedy="identify anew, or give the log beside the result",
            )
    else:
        found = None
    if found is None or record is None:
        raise _no_gains(axis)
    return FlownAxis(axis=axis, controller=found, record=record, source=source, density=density, throttle=throttle)


def record_of(model: IdentifiedModel) -> FlightRecord:
    """A record without samples that holds what a result keeps of the parameters of its log.

    Parameters
    ----------
    model
        A result that knows its controller.
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
    """Logs, or records without samples of the results that keep their parameters where no log came."""
    return logs or [record_of(model) for model in given if model.controller is not None and model.controller.settings]


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
    found: dict[Axis, AxisController] = {}
    for axis in axes:
        held = (logged_axis(record, f"{axis}_command", source="") for record in logs)
        kept = (_controller_of(known, axis) for model in given if (known := model.controller) is not None)
        if (one := next(filter(None, chain(held, kept)), None)) is not None:
            found[axis] = one
    return found


def _controller_of(known: ControllerSettings, axis: Axis) -> AxisController | None:
    """The controller of an axis by what a result says of it."""
    return axis_controller(
        {**known.gains, **known.filters, **known.settings},
        axis,
        firmware=known.firmware,
        loop_rate_hz=known.loop_rate_hz,
        throttle=known.throttle or 0.0,
    )


def require_gains(axis: Axis, record: FlightRecord) -> None:
    """Refuse a log without gains, before anything is identified from it.

    Raises
    ------
    InsufficientDataError
        Its parameters hold no controller of the axis.
    """
    if logged_axis(record, f"{axis}_command", source="") is None:
        raise _no_gains(axis)


def _no_gains(axis: Axis) -> InsufficientDataError:
    return InsufficientDataError(
        f"the gains of {axis} are not known",
        needed="a log with the parameters of its autopilot",
        remedy="give the log beside the result",
        findings=[refusal("no_controller", axis, f"No gains of the {axis} controller are known.")],
    )


def require_room(record: FlightRecord) -> list[Finding]:
    """Refuse a flight that oscillates or whose motors stood at their limits; a remark where they hide.

    Its plant is that of a limit cycle, and gains from it would be those of its limits.

    An output counts by the range in which the autopilot moves it in flight: ArduPilot's go from ``MOT_SPIN_MIN`` to
    ``MOT_SPIN_MAX`` alone.

    Raises
    ------
    InsufficientDataError
        An axis oscillates, or a motor was at a limit for more than 2 % of the flight.
    """
    require_calm(record)
    history = or_none(logged_outputs, record)
    known = linearization_of(record) if history is not None and history.kind == "output" else None
    if history is None or not range_is_known(record, history):
        why = "holds no outputs of all motors" if history is None else "does not say in which range its motors move"
        message = f"{record.source.name} {why}: whether a motor stood at a limit was not checked."
        return [remark("room_not_checked", record.source.name, message)]
    low, high = (known.low, known.high) if known is not None else (0.0, 1.0)
    shares = (history.values - low) / (high - low)
    # On the ground all motors idle at the lower end.
    flying = (history.values.mean(axis=0) > _AIRBORNE) & (shares > _AT_LIMIT[0]).any(axis=0)
    flying &= in_flight(record, history.time_s)
    limited = np.any((shares <= _AT_LIMIT[0]) | (shares >= _AT_LIMIT[1]), axis=0)
    share = float(limited[flying].mean()) if flying.any() else 0.0
    if share > _MOST_SATURATED:
        message = f"A motor stood at a limit for {100.0 * share:.0f} % of the flight: lower the gains first."
        raise InsufficientDataError(
            f"a motor stood at a limit for {100.0 * share:.0f} % of the flight",
            needed=f"at most {100.0 * _MOST_SATURATED:.0f} %, or the plant is that of a limit cycle",
            remedy="lower the gains first",
            findings=[refusal("saturation", record.source.name, message, share=share)],
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


def explained(flown: FlownAxis, model: IdentifiedModel) -> list[Finding]:
    """Refuse a controller that did not make the logged command; a remark where that cannot be seen.

    Raises
    ------
    InsufficientDataError
        Other gains flew than those of the parameters.
    """
    record, axis = flown.record, flown.axis
    if not flown.source.startswith(_BEHIND_FILTERS):
        return _by_responses(flown, record)
    controllers = Controllers(record=record, given={})
    command, rate = f"{axis}_command", RATE_OF[axis]
    own = [one for one in model.data.segments if one.record == record.source.name]
    band = model.band_rad_s
    if not own or band is None:
        return []
    try:
        segments, _ = cut(
            [Flight(record, one.maneuver) for one in own[:1]],
            channels=(command, rate),
            followers=controllers.channels((axis,)),
        )
        history = segments[0].history
        found = controllers.loop(axis, history, matched(band, None, history))
    except (InsufficientDataError, UsageError):
        found = None
    if found is None:
        return [_unchecked(axis, f"The log holds no set-point of {axis}")]
    _, setpoint, scores = found
    if not scores.alike and flown.controller.autopilot == BETAFLIGHT:
        # iterm relax, a D that moves and limits make much of a command in freestyle: this is no other controller.
        return [_unchecked(axis, f"D and the integral of {axis} move in flight, and the command with them")]
    if not scores.alike:
        message = (
            f"With its gains the {axis} controller does not make the logged command of {setpoint} and the rate: TIC "
            f"{scores.tic:.2f}."
        )
        raise _other(axis, message, f"TIC {scores.tic:.2f}", scores.tic)
    return []


def _by_responses(flown: FlownAxis, record: FlightRecord) -> list[Finding]:
    """The same by the responses of command and rate to what was injected."""
    axis, rate = flown.axis, RATE_OF[flown.axis]
    excitation, command = f"{axis}_excitation", f"{axis}_command"
    if excitation not in record.channel_names:
        return [
            _unchecked(
                axis, f"The rate of {axis} stands in {flown.source}, in front of filters, and nothing was injected"
            )
        ]
    try:
        found = response([record], inputs=excitation, outputs=(command, rate), estimate="direct")
    except (InsufficientDataError, UsageError):
        return [_unchecked(axis, f"Command and rate do not show an answer to {excitation}")]
    measured = found.response
    usable = np.asarray(found.used[:, 0], dtype=bool).all(axis=0) & (measured.omega_rad_s > _ABOVE_VELOCITY_RAD_S)
    omega = measured.omega_rad_s[usable]
    of_command, of_rate = measured.values[0, 0, usable], measured.values[1, 0, usable]
    acting = acting_on(record, flown.controller.controller, source=flown.source)
    misses = np.array(
        [
            _miss(way - of_command, loop.response(omega) * of_rate, of_command)
            for loop in (acting, acting.rate_loop)
            for way in _ways(loop, omega)
        ]
    )
    if np.any(misses <= _UNLIKE):
        return []
    # A way that shows at too few frequencies may be the right one: the others refute nothing.
    if np.isnan(misses).any():
        return [_unchecked(axis, f"The {axis} controller made too little of the command in the sweep")]
    message = (
        f"With its gains the {axis} controller does not answer to the rate as the logged command does: they "
        f"differ by {100.0 * misses.min():.0f} %."
    )
    raise _other(axis, message, f"{100.0 * misses.min():.0f} % off", float(misses.min()))


def _miss(made: ComplexArray, modeled: ComplexArray, command: ComplexArray) -> float:
    """How far what the controller made of the rate is from what its gains make; not a number where it made little."""
    told = np.abs(made) > _NOT_SEEN * np.abs(command)
    if np.count_nonzero(told) < _FEWEST_POINTS:
        return np.nan
    return float(np.median(np.abs(made[told] - modeled[told]) / np.abs(made[told])))


def _ways(loop: LoggedController, omega: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """How an excitation enters the command: at the mixer, or at the set-point of the rate."""
    return np.ones(omega.size, dtype=np.complex128), loop.controller.setpoint_response(omega)


def _unchecked(axis: Axis, why: str) -> Finding:
    return remark("controller_unchecked", axis, f"{why}: whether these gains made the commands was not checked.")


def _other(axis: Axis, message: str, told: str, value: float) -> InsufficientDataError:
    return InsufficientDataError(
        f"the gains in the log did not make the logged {axis}_command ({told})",
        needed="a flight whose controller is the one in its parameters",
        remedy="the gains changed in flight, or a part of the controller is not modeled",
        findings=[refusal("other_controller", axis, message, unlike=value)],
    )


def at_ends(controller: AxisController, parts: ControllerParts) -> dict[str, ControllerParts]:
    """Parts where a D moves in flight, by the name of each end."""
    return {name: replace(parts, controller=end) for name, end in controller.ends.items()}
