"""The controllers under which a model is flown: those of a log, from its parameters, or of a file of the user.

Gains that did not make the logged commands are not flown, and neither are those that predict them poorly.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.data.axes import ANGLE_OF, RATE_OF
from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, remark
from rotorid.data.record import STANDARD_UNITS, FlightRecord, TimeHistory
from rotorid.errors import ModelError, UsageError
from rotorid.flights.controller_check import ControllerCheck, check_controller, check_given
from rotorid.flights.controllers import controllers_of
from rotorid.io.documents import DocumentError, parse_toml, read_text
from rotorid.models.controller import FILTERS, Driven, RateController
from rotorid.models.toml_source import Source
from rotorid.typing import Axis
from rotorid.verification.closed_loop import Loop, LoopScores, controller_alone
from rotorid.verification.sampled import Filter
from rotorid.verification.scores import GOOD_TIC


@dataclass(frozen=True, kw_only=True)
class GivenController(Immutable):
    """A controller that a person gave.

    Parameters
    ----------
    controller
        Gains and filters.
    setpoint
        Channel that drives it; empty for the outermost set-point that is logged and explains the command.
    """

    controller: RateController
    setpoint: str = ""

    def __str__(self) -> str:
        numbers = ((one.name, getattr(self.controller, one.name)) for one in fields(self.controller))
        told = [f"{name}={value!r}" for name, value in numbers if value]
        return " ".join([*told, *([f"setpoint={self.setpoint}"] if self.setpoint else [])])


def read_controllers(path: Path) -> dict[Axis, GivenController]:
    """Read the controllers of a TOML file, one table for each axis.

    ::

        [pitch]
        proportional_s = 0.15
        integral = 0.2
        angle_1_s = 6.0
        setpoint = "theta_setpoint"

    Parameters
    ----------
    path
        The file. Its fields are those of :class:`rotorid.models.controller.RateController`, and ``setpoint``.

    Raises
    ------
    UsageError
        The file cannot be read, is no TOML, or says something else; the message names the line.
    """
    text = read_text(path, needed="a TOML file with gains")
    try:
        table = parse_toml(text)
    except DocumentError as error:
        raise UsageError(f"{path.name} is no TOML: {error}", needed="[pitch] and proportional_s = 0.15") from error
    source = Source(text=text, where=path.name)
    try:
        found = {
            _axis(name, source): _given(source.table(value, (name,)), name, source) for name, value in table.items()
        }
    except ModelError as error:
        raise UsageError(error.came, needed=error.needed, remedy=error.remedy) from None
    if not found:
        raise UsageError(f"{path.name} holds no controller", needed=f"a table [{'], ['.join(RATE_OF)}]")
    return found


def _axis(name: str, source: Source) -> Axis:
    if name not in RATE_OF:
        raise source.unknown("axis", name, RATE_OF, (name,))
    return name  # type: ignore[return-value]


def _given(table: Mapping[str, Any], axis: str, source: Source) -> GivenController:
    known = [one.name for one in fields(RateController) if one.name not in FILTERS]
    values: dict[str, Any] = {}
    for name, value in table.items():
        if name not in (*known, "setpoint"):
            raise source.unknown("field of a controller", name, (*known, "setpoint"), (axis, name))
        if name in ("derivative_of_error", "late_integral", "late_angle"):
            if not isinstance(value, bool):
                raise source.error((axis, name), f"{name} is {value!r}", needed="true or false")
            values[name] = value
        elif name != "setpoint":
            values[name] = source.number(value, (axis, name))
    if "proportional_s" not in values:
        raise source.error((axis,), f"[{axis}] has no proportional_s", needed="the gain on the rate")
    try:
        controller = RateController(**values)
    except UsageError as error:
        raise source.error((axis,), error.came, needed=error.needed) from None
    return GivenController(
        controller=controller, setpoint=source.text_of(table.get("setpoint", ""), (axis, "setpoint"))
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Controllers(Immutable):
    """The controllers of one log.

    Parameters
    ----------
    record
        The log.
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
        axis
            Of the controller.
        loop, setpoint
            As :meth:`loop` finds them.
        """
        if axis not in self.given:
            return check_controller(self.record, axis)
        return check_given(self.record, axis, loop.controller, setpoint=setpoint, driven=loop.driven)

    def channels(self, axes: Sequence[Axis]) -> tuple[str, ...]:
        """Channels that may drive the controllers of some axes, as far as they are logged.

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
                    f"{self.record.source.name} holds no {found.setpoint} for the {axis} controller",
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
    """What may drive a controller, the outermost set-point first."""
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
    """The remark that a log holds no gains, or gains and nothing that drives them."""
    record, whose = controllers.record.source.name, " and ".join(axes)
    known = {axis: found for axis in axes if (found := controllers.of(axis)) is not None}
    table = f"[{axes[0]}]"
    unknown = [axis for axis in axes if axis not in known]
    if unknown:
        why, _ = controllers_of(controllers.record).unknown_gains(unknown[0])
        message = (
            f"Not flown in closed loop: {why[:1].lower()}{why[1:]}. Give rotorid verify a "
            f"--controller FILE.toml with a table {table} of proportional_s, integral, derivative_s2, angle_1_s and, "
            "where it is no standard one, the setpoint that drives it."
        )
    else:
        drives = " or ".join(
            dict.fromkeys(name for axis, found in known.items() for name, _ in _setpoints(axis, found))
        )
        message = (
            f"Not flown in closed loop: {record} holds the gains of the {whose} controller and not what drives it, "
            f"{drives}. Log that set-point, or name another channel as setpoint in the table {table} of a --controller "
            "FILE.toml."
        )
    return remark("no_controller", record, message)


def doubts_of(controllers: Controllers, axis: Axis, found: tuple[Loop, str, LoopScores]) -> tuple[bool, list[Finding]]:
    """Whether a controller may close its loop, and the remarks on it: gains that flew, and that predict the command.

    Parameters
    ----------
    controllers
        Of the log.
    axis
        Of the controller.
    found
        What :meth:`Controllers.loop` found.
    """
    loop, setpoint, scores = found
    record = controllers.record.source.name
    check = controllers.check(axis, loop, setpoint)
    if check.verdict == "not made":
        message = f"Not flown in closed loop: {check.why[:1].lower()}{check.why[1:]}."
        return False, [remark("other_controller", f"{record}: {axis}", message, tic=scores.tic, **check.numbers)]
    if scores.tic > GOOD_TIC:
        return False, [*check.findings, _poor(record, axis, setpoint, scores)]
    return True, list(check.findings)


def _poor(record: str, axis: Axis, setpoint: str, scores: LoopScores) -> Finding:
    """The remark that the controller alone predicts the command of a maneuver poorly."""
    return remark(
        "other_controller",
        f"{record}: {axis}",
        f"Not flown in closed loop: with its gains the {axis} controller does not make the logged {axis} command "
        f"of {setpoint} and the measured rate (Theil coefficient {scores.tic:.2f}, good: up to {GOOD_TIC:g}). It "
        "has parts that are not modeled, the gains changed in flight, or its set-point is another one.",
        tic=scores.tic,
        nrmse_fit_percent=scores.nrmse_fit_percent,
    )
