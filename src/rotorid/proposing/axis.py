"""One axis before anything is proposed: the flown controller, its plant, and the filters to fly."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.axes import RATE_OF
from rotorid.data.base import Immutable
from rotorid.data.display import listed
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import FlightRecord
from rotorid.flights.same_vehicle import different_gains, gains_of
from rotorid.loops.throttle import plant_at_hover
from rotorid.models.autopilots.settings import AxisController
from rotorid.proposing.filters import with_filters
from rotorid.proposing.flown_gains import (
    FlownLoop,
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
from rotorid.tuning.kinds import KINDS
from rotorid.tuning.loops import ControllerParts, Gains, frequency_grid, loop_figures
from rotorid.tuning.plant import UncertainPlant
from rotorid.tuning.proposal import Wishes
from rotorid.typing import Axis, ComplexArray, FloatArray, LoopName

_OF_FIRMWARE = ("firmware_contradicted", "controller_unexplained")

_NAMED = 6
"""Number of gains that are listed where logs differ."""


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownAxis(Immutable):
    """An axis whose loop can be judged.

    Parameters
    ----------
    flown
        The controller that flew.
    plant
        With draws of its uncertainty.
    omega_rad_s
        Frequencies of the parts, shape ``(f,)``.
    then
        The log with other filters among its parameters; ``None`` where they do not change.
    controller, parts
        The controller and the transfer functions of its gains, with the filters to fly.
    flown_plant
        The plant as it flew, where new gains of inner loops change it; ``None`` where it stays.
    """

    flown: FlownLoop
    plant: UncertainPlant
    omega_rad_s: FloatArray
    flown_parts: ControllerParts
    then: FlightRecord | None
    controller: AxisController
    parts: ControllerParts
    flown_plant: UncertainPlant | None = None

    @property
    def gains(self) -> Gains:
        """As flown."""
        return Gains.of(self.flown.controller.controller)

    def drawn(self) -> ComplexArray:
        """All likely plants, shape ``(draws, f)``."""
        return self.plant.drawn(self.omega_rad_s)

    def needed_rad_s(self, wishes: Wishes) -> float:
        """Upper end of the sweep that gains need, see :func:`needed_rad_s`."""
        return needed_rad_s(self.flown.axis, self.plant, self.flown.controller, self.parts, wishes)


def needed_rad_s(
    axis: LoopName, plant: UncertainPlant, controller: AxisController, parts: ControllerParts, wishes: Wishes
) -> float:
    """Upper end in whole rad/s of the sweep that is needed to propose and check gains of a loop.

    An outer loop needs none of its own: it is known where its inner loop is.

    Parameters
    ----------
    axis, plant
        Only the most likely plant counts.
    controller
        As flown.
    parts
        Transfer functions of its gains, with the filters to fly.
    """
    if KINDS[axis].outer:
        return 0.0
    ends = tuple(at_ends(controller, parts).values())
    return float(np.ceil(needed_band(axis, plant.response, parts.controller, parts, wishes=wishes, ends=ends)[1]))


def log_of(axis: Axis, logs: Sequence[FlightRecord]) -> FlightRecord | None:
    """The log that shows an axis: the first with its command, else the first."""
    return next((record for record in logs if f"{axis}_command" in record.channel_names), logs[0] if logs else None)


def logs_of(axis: Axis, logs: Sequence[FlightRecord]) -> list[FlightRecord]:
    """The logs with command and rate of an axis."""
    return [record for record in logs if {f"{axis}_command", RATE_OF[axis]} <= set(record.channel_names)]


def differing_gains(axes: Iterable[Axis], logs: Sequence[FlightRecord]) -> list[Finding]:
    """A warning for each log that was flown with other gains than the log whose gains are tuned.

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
                name: f"{name} {then:g} instead of {now:g}"
                for name, (now, then) in different_gains(here, gains_of(record, (axis,))).items()
            }
            if changed:
                differences.setdefault((record.source.name, taken.source.name), {}).update(changed)
    found = []
    for (name, taken_name), changed in differences.items():
        listed = ", ".join(changed[name] for name in sorted(changed)[:_NAMED])
        more = f" and {len(changed) - _NAMED} more" if len(changed) > _NAMED else ""
        message = (
            f"{name} was flown with other gains than {taken_name}: {listed}{more}. The gains of {taken_name} are "
            "tuned; to "
            "tune others, give their log first."
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
    """An axis with its flown loop, where it is known well enough.

    Parameters
    ----------
    axis
        ``roll``, ``pitch`` or ``yaw``.
    given, logs
        As for :func:`rotorid.proposing.proposal.tune`.
    filters
        Filters to fly.
    draws, seed
        Of the plant.
    findings
        Findings are added here at once, so that they stay if the axis is refused later.

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
        findings += [finding for finding in require_room(record, model, axis=axis) if finding not in findings]
    findings += [finding for finding in plant_remarks(axis, given, model) if finding not in findings]
    flown = flown_axis(axis, model, record)
    findings += require_controller_match(flown) if record is not None else _unchecked(axis, model)
    then = with_filters(flown.record, filters) if filters else None
    # A given result may contain choices of its user; logs alone give what every command measures from them.
    swept = None if model in given else plant_at_hover(axis, logs_of(axis, logs))
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


def _unchecked(axis: Axis, model: IdentifiedModel) -> list[Finding]:
    """What was not checked without the log, and remarks on the firmware."""
    # Older results do not have the noise of the gyro, nor has one of a slow log.
    unknown = [] if axis in model.data.rate_densities else ["the noise of the gyro"]
    message = (
        f"{model.name} was given without its log, so {listed(['motor limits', 'the logged gains', *unknown])} were not "
        "checked. Give the log with the result."
    )
    findings = [finding for finding in model.findings if finding.kind in _OF_FIRMWARE]
    return [*findings, remark("room_not_checked", model.name, message)]
