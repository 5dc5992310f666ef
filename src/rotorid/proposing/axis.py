"""One axis before anything is proposed: the controller that flew, its plant, and the filters that are to be flown."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.axes import RATE_OF
from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import FlightRecord
from rotorid.flights.same_vehicle import different_gains, gains_of
from rotorid.loops.plants import identified_plant
from rotorid.models.autopilots.settings import AxisController
from rotorid.proposing.filters import with_filters
from rotorid.proposing.flown_gains import (
    LoggedLoop,
    at_ends,
    flown_axis,
    require_calm,
    require_controller_match,
    require_gains,
    require_room,
)
from rotorid.proposing.plants import plant_of, plant_remarks, rate_model, require_known
from rotorid.results.model import IdentifiedModel
from rotorid.tuning.bands import needed_band
from rotorid.tuning.loops import ControllerParts, Gains, frequency_grid, loop_figures
from rotorid.tuning.plant import UncertainPlant
from rotorid.tuning.proposal import Wishes
from rotorid.typing import Axis, ComplexArray, FloatArray

_OF_FIRMWARE = ("firmware_contradicted", "controller_unexplained")

_NAMED = 6
"""Gains that are listed where logs differ."""


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownAxis(Immutable):
    """An axis whose loop can be judged.

    Parameters
    ----------
    flown
        The controller that flew.
    plant
        With draws of what is not known.
    omega_rad_s
        Frequencies of the parts, shape ``(f,)``.
    then
        The log as if other filters had been flown; ``None`` where they stay.
    controller, parts
        The controller and what its gains do, with the filters that are to be flown.
    """

    flown: LoggedLoop
    plant: UncertainPlant
    omega_rad_s: FloatArray
    flown_parts: ControllerParts
    then: FlightRecord | None
    controller: AxisController
    parts: ControllerParts

    @property
    def gains(self) -> Gains:
        """As flown."""
        return Gains.of(self.flown.controller.controller)

    def drawn(self) -> ComplexArray:
        """All likely plants, shape ``(draws, f)``."""
        return self.plant.drawn(self.omega_rad_s)

    def needed_rad_s(self, wishes: Wishes) -> float:
        """Upper end of the sweep on which gains can be proposed and checked, see :func:`needed_rad_s`."""
        return needed_rad_s(self.flown.axis, self.plant, self.flown.controller, self.parts, wishes)


def needed_rad_s(
    axis: Axis, plant: UncertainPlant, controller: AxisController, parts: ControllerParts, wishes: Wishes
) -> float:
    """Upper end in whole rad/s of the sweep on which gains of an axis can be proposed and checked.

    Parameters
    ----------
    axis, plant
        Of which the most likely plant counts.
    controller
        As flown.
    parts
        What its gains do, with the filters that are to be flown.
    """
    ends = tuple(at_ends(controller, parts).values())
    return float(np.ceil(needed_band(axis, plant.response, parts.controller, parts, wishes=wishes, ends=ends)[1]))


def log_of(axis: Axis, logs: Sequence[FlightRecord]) -> FlightRecord | None:
    """The log that shows an axis: the first with its command, else the first."""
    return next((record for record in logs if f"{axis}_command" in record.channel_names), logs[0] if logs else None)


def logs_of(axis: Axis, logs: Sequence[FlightRecord]) -> list[FlightRecord]:
    """The logs that hold command and rate of an axis."""
    return [record for record in logs if {f"{axis}_command", RATE_OF[axis]} <= set(record.channel_names)]


def differing_gains(axes: Iterable[Axis], logs: Sequence[FlightRecord]) -> list[Finding]:
    """A warning for each log that was flown with other gains than the log that is taken for the one that flew.

    Parameters
    ----------
    axes, logs
        As for :func:`rotorid.proposing.proposal.tune`.
    """
    differences: dict[tuple[str, str], dict[str, str]] = {}
    for axis in axes:
        taken = log_of(axis, logs)
        others = [record for record in logs if record is not taken]
        if taken is None or not others:
            continue
        here = gains_of(taken, (axis,))
        for record in others:
            changed = {
                name: f"{name} {then:g} for {now:g}"
                for name, (now, then) in different_gains(here, gains_of(record, (axis,))).items()
            }
            if changed:
                differences.setdefault((record.source.name, taken.source.name), {}).update(changed)
    found = []
    for (name, taken_name), changed in differences.items():
        listed = ", ".join(changed[name] for name in sorted(changed)[:_NAMED])
        more = f" and {len(changed) - _NAMED} more" if len(changed) > _NAMED else ""
        message = (
            f"{name} was flown with other gains than {taken_name}: {listed}{more}. Those of {taken_name} are taken for "
            "flown; name the log first whose gains are to be changed."
        )
        found.append(warn("gains_differ", name, message, parameters=len(changed)))
    return found


def known_axis(
    axis: Axis,
    given: Sequence[IdentifiedModel],
    logs: Sequence[FlightRecord],
    *,
    filters: Mapping[str, float],
    draws: int,
    seed: int,
    findings: list[Finding],
) -> KnownAxis:
    """An axis with the loop that flew, where it can be judged.

    Parameters
    ----------
    axis
        ``roll``, ``pitch`` or ``yaw``.
    given, logs
        As for :func:`rotorid.proposing.proposal.tune`.
    filters
        Those that are to be flown.
    draws, seed
        Of the plant.
    findings
        What is remarked on is added here at once: it stays where the axis is refused later.

    Raises
    ------
    InsufficientDataError
        Its gains, its plant or its room are not known well enough.
    UsageError
        No such filter is among the parameters.
    """
    record = log_of(axis, logs)
    if record is not None:
        require_gains(axis, record)
        require_calm(record)
    model = rate_model(axis, given, logs)
    if record is not None:
        findings += [finding for finding in require_room(record, model) if finding not in findings]
    findings += [finding for finding in plant_remarks(axis, given, model) if finding not in findings]
    flown = flown_axis(axis, model, record)
    findings += require_controller_match(flown) if record is not None else _unchecked(model)
    then = with_filters(flown.record, filters) if filters else None
    # A result that was given may hold choices of its user; logs alone show what every verb measures of them.
    swept = None if model in given else identified_plant(axis, logs_of(axis, logs))
    plant = plant_of(model, axis, draws=draws, seed=seed, passed=flown.passed, measured=swept)
    omega = frequency_grid(flown.controller.controller)
    noise = flown.rate_noise(omega, plant.band_rad_s)
    known = KnownAxis(
        flown=flown,
        plant=plant,
        omega_rad_s=omega,
        flown_parts=flown.parts(omega, noise=noise),
        then=then,
        controller=flown.controller if then is None else flown.with_parameters(then),
        parts=flown.parts(omega, then=then, noise=noise),
    )
    loops = loop_figures(omega, known.drawn() * known.flown_parts.rate(known.gains), from_rad_s=plant.known_from_rad_s)
    require_known(axis, plant, loops.usual_crossover_rad_s)
    return known


def _unchecked(model: IdentifiedModel) -> list[Finding]:
    """What a result alone does not show of its flight, and what it says of the firmware."""
    message = (
        f"{model.name} came without its log: whether a motor reached a limit, and whether the gains made the commands, "
        "was not checked. Give the log beside the result."
    )
    findings = [finding for finding in model.findings if finding.kind in _OF_FIRMWARE]
    return [*findings, remark("room_not_checked", model.name, message)]
