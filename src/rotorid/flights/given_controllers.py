"""The controllers under which a model is flown: those of a log, from its parameters, or of a file of the user.

Gains that did not make the logged commands are not flown, and neither are those that predict them poorly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.axes import ANGLE_OF, RATE_OF
from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, remark
from rotorid.data.record import STANDARD_UNITS, FlightRecord, TimeHistory
from rotorid.errors import UsageError
from rotorid.flights.controller_check import ControllerCheck, check_controller, check_given
from rotorid.flights.controllers import controllers_of
from rotorid.models.controller import Driven
from rotorid.settings.given_controllers import GivenController
from rotorid.typing import Axis
from rotorid.verification.closed_loop import Loop, LoopScores, controller_alone
from rotorid.verification.sampled import Filter
from rotorid.verification.scores import GOOD_TIC


@dataclass(frozen=True, kw_only=True, eq=False)
class Controllers(Immutable):
    """The controllers of one log.

    Parameters
    ----------
    given
        Those that a person gave; they go before the gains in the log.
    """

    record: FlightRecord
    given: Mapping[Axis, GivenController]

    def __post_init__(self) -> None:
        self._set(given=self.given)

    def of(self, axis: Axis) -> GivenController | None:
        """The controller of an axis, where one is known."""
        if axis in self.given:
            return self.given[axis]
        logged = controllers_of(self.record).axis(axis)
        return GivenController(controller=logged.controller) if logged else None

    def check(self, axis: Axis, loop: Loop, setpoint: str) -> ControllerCheck:
        """Whether the controller of an axis made the commands of the log.

        Parameters
        ----------
        loop, setpoint
            As :meth:`loop` finds them.
        """
        if axis not in self.given:
            return check_controller(self.record, axis)
        return check_given(self.record, axis, loop.controller, setpoint=setpoint, driven=loop.driven)

    def channels(self, axes: Sequence[Axis]) -> tuple[str, ...]:
        """Logged channels that may drive the controllers of some axes.

        Raises
        ------
        UsageError
            The log lacks a set-point that was named.
        """
        wanted = []
        for axis in axes:
            found = self.of(axis)
            if found is None:
                continue
            if found.setpoint and found.setpoint not in self.record.channel_names:
                raise UsageError(
                    f"{self.record.source.name} contains no {found.setpoint} for the {axis} controller",
                    needed=f"one of {', '.join(n for n in self.record.channel_names if n.endswith('_setpoint'))}",
                )
            wanted += [name for name, _ in _setpoints(axis, found)] + [f"{axis}_excitation"]
        return tuple(dict.fromkeys(name for name in wanted if name in self.record.channel_names))

    def loop(self, axis: Axis, history: TimeHistory, filtered: Filter) -> tuple[Loop, str, LoopScores] | None:
        """The loop of an axis, its set-point, and how well its controller alone explains the measured command.

        Of several set-points the outermost one counts with which it does so closely, else the one that comes nearest.
        ``None`` where there is no controller or no set-point.
        """
        found = self.of(axis)
        if found is None:
            return None
        tried = []
        for name, driven in _setpoints(axis, found):
            if name not in history.names or RATE_OF[axis] not in history.names:
                continue
            loop = Loop(
                command=f"{axis}_command",
                rate=RATE_OF[axis],
                controller=found.controller,
                driven=driven,
                setpoint=history[name],
                excitation=_excitation(axis, history),
            )
            scores = controller_alone(
                loop,
                history[loop.rate],
                history[loop.command],
                filtered=filtered,
                sample_rate_hz=history.sample_rate_hz,
            )
            if scores.alike:
                return loop, name, scores
            tried.append((loop, name, scores))
        return min(tried, key=lambda item: item[2].tic, default=None)


def _setpoints(axis: Axis, given: GivenController) -> list[tuple[str, Driven]]:
    """Channels that may drive a controller, the outermost set-point first."""
    rate, angle = (f"{name}_setpoint" for name in (RATE_OF[axis], ANGLE_OF[axis]))
    if given.setpoint:
        return [(given.setpoint, "angle" if given.controller.angle_1_s and given.setpoint != rate else "rate")]
    outer: list[tuple[str, Driven]] = [(angle, "angle")] if given.controller.angle_1_s else []
    return [*outer, (rate, "rate")]


def _excitation(axis: Axis, history: TimeHistory) -> np.ndarray:
    """The test signal on the command, zero where there is none: one in another unit enters elsewhere."""
    name = f"{axis}_excitation"
    if name in history.names:
        channel = history.channels[history.names.index(name)]
        if channel.unit == STANDARD_UNITS[f"{axis}_command"]:
            return np.nan_to_num(history[name])
    return np.zeros(history.values.shape[1])


def no_controller(controllers: Controllers, axes: Sequence[Axis]) -> Finding:
    """The remark that a log has no gains, or gains without their set-point."""
    record, whose = controllers.record.source.name, " and ".join(axes)
    known = {axis: found for axis in axes if (found := controllers.of(axis)) is not None}
    table = f"[{axes[0]}]"
    unknown = [axis for axis in axes if axis not in known]
    if unknown:
        why, _ = controllers_of(controllers.record).unknown_gains(unknown[0])
        message = (
            f"No closed-loop simulation: {why[:1].lower()}{why[1:]}. Give rotorid verify --controller FILE.toml "
            f"with a table {table}: proportional_s, integral, derivative_s2, angle_1_s and, if it is not a "
            "standard one, the setpoint."
        )
    else:
        drives = " or ".join(
            dict.fromkeys(name for axis, found in known.items() for name, _ in _setpoints(axis, found))
        )
        message = (
            f"No closed-loop simulation: {record} contains the gains of the {whose} controller but not its "
            f"set-point, {drives}. Log it, or name another setpoint in the table {table} of --controller "
            "FILE.toml."
        )
    return remark("no_controller", record, message)


def doubts_of(controllers: Controllers, axis: Axis, found: tuple[Loop, str, LoopScores]) -> tuple[bool, list[Finding]]:
    """Whether a controller may close its loop, and the remarks on it: gains that flew, and that predict the command.

    Parameters
    ----------
    controllers
        Of the log.
    found
        What :meth:`Controllers.loop` found.
    """
    loop, setpoint, scores = found
    record = controllers.record.source.name
    check = controllers.check(axis, loop, setpoint)
    if check.verdict == "not made":
        message = f"No closed-loop simulation: {check.why[:1].lower()}{check.why[1:]}."
        return False, [remark("other_controller", f"{record}: {axis}", message, tic=scores.tic, **check.numbers)]
    if scores.tic > GOOD_TIC:
        return False, [*check.findings, _poor(record, axis, setpoint, scores)]
    return True, list(check.findings)


def _poor(record: str, axis: Axis, setpoint: str, scores: LoopScores) -> Finding:
    """The remark that the controller alone predicts the command of a maneuver poorly."""
    return remark(
        "other_controller",
        f"{record}: {axis}",
        f"No closed-loop simulation: the logged {axis} gains do not reproduce the {axis} command from {setpoint} "
        f"and the measured rate (Theil coefficient {scores.tic:.2f}, good: up to {GOOD_TIC:g}). Parts of the "
        "controller may not be modeled, the gains may have changed in flight, or the set-point may be another "
        "one.",
        tic=scores.tic,
        nrmse_fit_percent=scores.nrmse_fit_percent,
    )
