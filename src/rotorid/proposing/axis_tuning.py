"""An axis with flown and proposed gains and their effect: loops, responses, steps, filters, and flights to the goal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.quantity import Quantity
from rotorid.data.record import FlightRecord
from rotorid.models.autopilots.settings import AxisController
from rotorid.proposing.axis import KnownAxis, needed_rad_s
from rotorid.proposing.filters import FilterPrice, changed_filters, prices
from rotorid.proposing.flown_gains import FlownLoop, at_ends
from rotorid.proposing.new_gains import AxisGains, scores_of, shares_angle
from rotorid.proposing.steps import attitude_steps, step_times_s
from rotorid.tuning.firmware import rounded, written
from rotorid.tuning.kinds import KINDS
from rotorid.tuning.loops import ControllerParts, Gains, loop_figures, over_draws
from rotorid.tuning.plant import UncertainPlant
from rotorid.tuning.proposal import AxisProposal, Judged, Wishes, flights_between, steps_beyond
from rotorid.typing import ComplexArray, FloatArray, LoopName


@dataclass(frozen=True, kw_only=True, eq=False)
class PathStep(Immutable):
    """Gains of one of several flights.

    Parameters
    ----------
    flight
        Which one: the proposed gains are those of the first.
    goal
        Whether no further step follows.
    judged
        The gains, and their effect on every draw of today's plant.
    parameters
        The same, by the firmware's names.
    """

    flight: int
    goal: bool
    judged: Judged
    parameters: Mapping[str, float]

    def __post_init__(self) -> None:
        self._set(parameters=self.parameters)


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisTuning(Immutable):
    """An axis: its controller, its plant, flown and proposed gains, and their effect.

    Parameters
    ----------
    controller
        As the log has it.
    plant
        With draws of its uncertainty.
    omega_rad_s
        Frequencies of the responses below.
    proposal
        Flown and proposed gains, judged on all draws.
    parameters
        Firmware's name of each gain to its flown and proposed value, which are equal where it does not change.
    loops
        ``flown``, ``proposed``, ``flown_whole``, ``proposed_whole``: broken loops over the draws, ``(draws, f)``.
    responses
        ``attitude`` over its set-point and ``disturbance``, the attitude over a moment in commands, each followed by
        ``_flown`` or ``_proposed``, over the draws, ``(draws, f)``.
    step_s, steps
        Seconds, and the step response of the attitude with both gains, ``(draws, n)`` each.
    parts
        Transfer functions of each gain, with the filters of the proposal.
    path
        The flights to the best gains within the limits, the proposed gains first and the goal last; empty where one
        flight reaches them.
    prices
        Phase lag and noise of every filter of the proposed loop.
    ends
        Effect of the proposed gains at each end of a D that changes in flight.
    noise_seen
        Whether the log shows the noise of the rate, so that noise is in units of the command and not only a ratio.
    without_derivative
        Phase margin in degrees that the rate loop would have without D, for ``flown`` and ``proposed`` gains: what D
        is worth beside this P. ``None`` where a likely loop is unstable without it; absent where D is zero.
    """

    controller: AxisController
    plant: UncertainPlant
    omega_rad_s: FloatArray
    proposal: AxisProposal
    parameters: Mapping[str, tuple[float, float]]
    loops: Mapping[str, ComplexArray]
    responses: Mapping[str, ComplexArray]
    step_s: FloatArray
    steps: Mapping[str, FloatArray]
    parts: ControllerParts
    wishes: Wishes = field(default_factory=Wishes)
    path: tuple[PathStep, ...] = ()
    prices: tuple[FilterPrice, ...] = ()
    ends: Mapping[str, Judged] = field(default_factory=dict)
    noise_seen: bool = False
    without_derivative: Mapping[str, Quantity | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._set(
            without_derivative=self.without_derivative,
            parameters=self.parameters,
            loops=self.loops,
            responses=self.responses,
            steps=self.steps,
            path=tuple(self.path),
            prices=tuple(self.prices),
            ends=self.ends,
        )

    @cached_property
    def needed_rad_s(self) -> float:
        """Upper end of the sweep that the best gains need."""
        return needed_rad_s(self.proposal.axis, self.plant, self.controller, self.parts, self.wishes)

    @property
    def changed(self) -> bool:
        """Whether a gain or a filter of the axis is to change."""
        return any(after != before for before, after in self.parameters.values())


def axis_tuning(axis: LoopName, known: KnownAxis, found: AxisGains, filters: Mapping[str, float]) -> AxisTuning:
    """An axis with its gains and their effect.

    Parameters
    ----------
    axis, known
        With the filters to fly.
    found
        Its gains.
    filters
        Those among the parameters that the user asked for.
    """
    flown, plant, then, controller, parts = known.flown, known.plant, known.then, known.controller, known.parts
    omega, drawn, proposal = known.omega_rad_s, known.drawn(), found.proposal
    before = known.flown_plant or plant
    sets = {
        "flown": (before.drawn(omega), known.flown_parts, proposal.flown.gains),
        "proposed": (drawn, parts, proposal.proposed.gains),
    }
    return AxisTuning(
        controller=flown.controller,
        plant=plant,
        omega_rad_s=omega,
        proposal=proposal,
        parameters=_parameters(known, filters, proposal),
        loops=_loops(sets),
        responses=_responses(omega, sets),
        parts=parts,
        wishes=found.wishes,
        prices=prices(
            None if KINDS[axis].outer else then or flown.record,
            controller,
            parts,
            plant.response(omega),
            proposal.proposed.gains,
        ),
        ends={
            name: scores_of(known, end, _with_end(proposal.proposed.gains, end))
            for name, end in at_ends(controller, parts).items()
        },
        noise_seen=parts.shows_noise,
        without_derivative=_without_derivative(omega, sets, plant.known_from_rad_s),
        **_steps(flown, then, (before, plant), proposal),
    )


def flights_to_goal(axis: LoopName, known: KnownAxis, tuning: AxisTuning) -> tuple[PathStep, ...]:
    """The flights to the goal, gains as the firmware will hold them; an angle gain of two axes stays as proposed."""
    found, wishes = tuning.proposal, tuning.wishes
    if shares_angle(known):
        wishes = replace(wishes, angle_1_s=found.proposed.gains.A)
    beyond = steps_beyond(
        axis,
        known.plant,
        found,
        parts=known.parts,
        flown_parts=None if known.then is None else known.flown_parts,
        ends=tuple(at_ends(known.controller, known.parts).values()),
        wishes=wishes,
    )
    if not beyond:
        return ()
    steps = [found.proposed]
    steps += [scores_of(known, known.parts, rounded(known.controller, scores.gains)) for scores in beyond]
    flights = [1, *range(2, len(beyond) + 1)]
    flights.append(flights[-1] + max(1, flights_between(steps[-2].gains, steps[-1].gains, wishes)))
    return tuple(
        PathStep(
            flight=flight, goal=scores is steps[-1], judged=scores, parameters=written(known.controller, scores.gains)
        )
        for flight, scores in zip(flights, steps, strict=True)
    )


def _with_end(gains: Gains, end: ControllerParts) -> Gains:
    return replace(gains, D=end.controller.derivative_s2)


def _parameters(known: KnownAxis, filters: Mapping[str, float], found: AxisProposal) -> dict[str, tuple[float, float]]:
    """Every gain and filter of the loop by the firmware's name, flown and proposed."""
    flown, then = known.flown.controller, known.controller
    new = {**then.filters, **(written(then, found.proposed.gains) if found.changed else {})}
    before = {**flown.gains, **flown.filters}
    if KINDS[known.flown.axis].outer:
        return {name: (value, new.get(name, value)) for name, value in before.items()}
    gyro = changed_filters(known.flown.record, filters, gyro=True)
    return {name: (value, new.get(name, value)) for name, value in before.items()} | gyro


_Sets = Mapping[str, tuple[ComplexArray, ControllerParts, Gains]]


def _loops(sets: _Sets) -> dict[str, ComplexArray]:
    rate = {name: drawn * parts.rate(gains) for name, (drawn, parts, gains) in sets.items()}
    return rate | {f"{name}_whole": drawn * parts.whole(gains) for name, (drawn, parts, gains) in sets.items()}


def _without_derivative(omega: FloatArray, sets: _Sets, from_rad_s: float) -> dict[str, Quantity | None]:
    """Phase margins of the rate loops with the same gains but D, on all plants."""
    found: dict[str, Quantity | None] = {}
    for name, (drawn, parts, gains) in sets.items():
        if gains.D > 0.0:
            loops = loop_figures(omega, drawn * parts.rate(replace(gains, D=0.0)), from_rad_s=from_rad_s)
            margins = np.degrees(loops.phase_margin_rad)
            shown = bool((loops.stable > 0.0).all()) and bool(np.isfinite(margins).all())
            found[name] = over_draws(margins, "deg") if shown else None
    return found


def _responses(omega: FloatArray, sets: _Sets) -> dict[str, ComplexArray]:
    """The attitude over its set-point, and over a moment given as a command."""
    found = {}
    for name, (drawn, parts, gains) in sets.items():
        closed = 1.0 / (1.0 + drawn * parts.whole(gains))
        found[f"attitude_{name}"] = drawn * parts.angle(gains) * closed
        found[f"disturbance_{name}"] = drawn / (1j * omega) * closed
    return found


def _steps(
    flown: FlownLoop, then: FlightRecord | None, plants: tuple[UncertainPlant, UncertainPlant], found: AxisProposal
) -> dict[str, Any]:
    """Step response of the attitude with both gains, on all plants, as flown and as they will be."""
    sets = {"flown": (plants[0], None, found.flown.gains), "proposed": (plants[1], then, found.proposed.gains)}
    steps = {name: attitude_steps(flown, plant, gains, then=record) for name, (plant, record, gains) in sets.items()}
    return {"step_s": step_times_s(flown.axis), "steps": steps}
