"""Files of a proposal for the autopilot: new gains and filters, a straighter thrust curve, and the way back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple

from rotorid.data.findings import Finding
from rotorid.data.record import FlightRecord
from rotorid.errors import UsageError
from rotorid.proposing.axis_tuning import AxisTuning
from rotorid.proposing.filters import changed_filters
from rotorid.proposing.flown_gains import flown_controllers, settings_records
from rotorid.proposing.settings import TUNED_AXES
from rotorid.proposing.thrust import ThrustLinearization
from rotorid.results.model import IdentifiedModel
from rotorid.tuning.files import parameter_files
from rotorid.tuning.firmware import scaled, written
from rotorid.typing import LoopName


class ProposalFiles(NamedTuple):
    """Name of each file to its text, the thrust curve that they fly, and why that is not changed."""

    proposed: dict[str, str]
    rollback: dict[str, str]
    thrust: ThrustLinearization | None
    findings: tuple[Finding, ...]


def proposal_files(
    axes: Mapping[LoopName, AxisTuning],
    thrust: ThrustLinearization | None,
    given: Sequence[IdentifiedModel],
    logs: Sequence[FlightRecord],
    filters: Mapping[str, float],
) -> ProposalFiles:
    """Files with the new values, and those that go back to the flown ones.

    Parameters
    ----------
    axes
        With their new gains.
    thrust
        What linearizes thrust, where it is known.
    given, logs
        As for :func:`rotorid.proposing.proposal.tune`.
    filters
        Filters that the user asked for.
    """
    first = next(iter(axes.values())).controller
    changes = {name: pair for tuning in axes.values() for name, pair in tuning.parameters.items() if pair[0] != pair[1]}
    for record in settings_records(given, logs)[:1]:
        changes |= changed_filters(record, filters)
    every: dict[str, float] = {}
    for tuning in axes.values():
        every |= written(tuning.controller, tuning.proposal.flown.gains)
    make = partial(parameter_files, first.autopilot, firmware=first.firmware)
    files = make({name: after for name, (_, after) in changes.items()}, role="proposed") if changes else {}
    old = {name: before for name, (before, _) in changes.items()} or every
    findings: tuple[Finding, ...] = ()
    if thrust is not None and thrust.changed:
        try:
            straightened = _straightened(axes, thrust, given, logs)
        except UsageError as error:
            thrust = thrust.kept(error.came)
            findings = tuple(thrust.findings)
        else:
            files |= make({name: after for name, (_, after) in straightened.items()}, role="thrust")
            old |= {**every, **{name: before for name, (before, _) in straightened.items()}}
    return ProposalFiles(files, make(old, role="rollback"), thrust, findings)


def _straightened(
    axes: Mapping[LoopName, AxisTuning],
    thrust: ThrustLinearization,
    given: Sequence[IdentifiedModel],
    logs: Sequence[FlightRecord],
) -> dict[str, tuple[float, float]]:
    """The parameter that linearizes thrust, with gains that keep the loops in hover: flown and new.

    Thrust acts on every axis, so the gains of axes that are not tuned change too.

    Raises
    ------
    UsageError
        A gain leaves its range, or is not known.
    """
    controllers = {axis: axes[axis].controller for axis in TUNED_AXES if axis in axes}
    controllers |= flown_controllers((axis for axis in TUNED_AXES if axis not in axes), given, logs)
    if unknown := [axis for axis in TUNED_AXES if axis not in controllers]:
        named = " and ".join(unknown)
        raise UsageError(f"the gains of {named} would have to change too and are not known", needed="a log with them")
    values = {thrust.parameter: (thrust.flown, thrust.proposed)}
    for controller in controllers.values():
        try:
            new = scaled(controller, 1.0 / thrust.hover_gain)
        except UsageError as error:
            why = f"with {thrust.proposed:g}, {error.came}"
            raise UsageError(why, needed=error.needed) from error
        values |= {name: (controller.gains[name], value) for name, value in new.items()}
    return values
