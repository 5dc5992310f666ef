"""New gains of each axis within its limits, as the firmware stores them; axes that share an angle gain agree on it.

Proposals and points of the filter curve come from here, so that the same filters and limits have the same gains.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rotorid.data.display import capital
from rotorid.data.findings import Finding, remark
from rotorid.errors import UsageError
from rotorid.models.autopilots.gains import parameters_of
from rotorid.models.autopilots.settings import AxisController, Parameter
from rotorid.proposing.axis import KnownAxis
from rotorid.proposing.flown_gains import at_ends
from rotorid.proposing.settings import TuneSettings
from rotorid.proposing.thrust import ThrustLinearization
from rotorid.tuning.firmware import ranges_of, rounded
from rotorid.tuning.loops import ControllerParts, Gains
from rotorid.tuning.proposal import AxisProposal, Judged, Wishes, judged, propose
from rotorid.typing import Axis, LoopName


class AxisGains(NamedTuple):
    """Flown and proposed gains of an axis, and the limits that they were found with."""

    proposal: AxisProposal
    wishes: Wishes

    @property
    def angle_1_s(self) -> float:
        """The proposed angle gain."""
        return self.proposal.proposed.gains.A


class AxisError(Exception):
    """An axis fails where gains are searched; all others stand."""

    def __init__(self, axis: Axis, cause: Exception) -> None:
        super().__init__(axis)
        self.axis, self.cause = axis, cause


def wishes_of(controller: AxisController, settings: TuneSettings, thrust: ThrustLinearization | None = None) -> Wishes:
    """Limits of the gains, and which of them may not change."""
    known = parameters_of(controller)
    return Wishes(
        sensitivity_peak=settings.robustness,
        noise=settings.noise,
        # What the firmware has no parameter for, or one whose meaning is not sure, stays.
        keep=tuple(name for name in "PIDA" if name in settings.keep or name not in known),
        gain_range=thrust.flown_range if thrust is not None else (1.0, 1.0),
        ranges=ranges_of(controller),
    )


def agreed_gains(
    known: Mapping[Axis, KnownAxis], wishes: Callable[[KnownAxis], Wishes]
) -> tuple[dict[Axis, AxisGains], list[Finding]]:
    """Gains of all axes, and a note where two of them had to agree on an angle gain.

    Where they would have two values of it, the smaller is flown by both. The flown one stays where one of them has no
    gains for that, or where one alone is known.

    Parameters
    ----------
    known
        Axes with the filters to fly.
    wishes
        Limits of the gains of an axis.

    Raises
    ------
    AxisError
        The search of one axis failed.
    """
    sharing = [axis for axis, one in known.items() if shares_angle(one)]
    if not sharing:
        return {axis: _gains(axis, one, wishes(one)) for axis, one in known.items()}, []
    first = known[sharing[0]]
    angle, flown = parameters_of(first.controller)["A"], first.gains.A
    alone = len(sharing) == 1
    why = f"{angle.name} stays, as roll and pitch share it and {sharing[0]} alone was tuned" if alone else ""

    def with_angle(axis: Axis, angle_1_s: float | None, why: str = "") -> AxisGains:
        return _gains(axis, known[axis], replace(wishes(known[axis]), angle_1_s=angle_1_s), why)

    found = {
        axis: with_angle(axis, flown if alone else None, why) if axis in sharing else _gains(axis, one, wishes(one))
        for axis, one in known.items()
    }
    free = [found[axis].angle_1_s for axis in sharing]
    for angle_1_s in (min(free), flown):
        for axis in sharing:
            if found[axis].angle_1_s != angle_1_s:
                found[axis] = with_angle(axis, angle_1_s)
        if all(found[axis].angle_1_s == angle_1_s for axis in sharing):
            break
    if "A" in wishes(first).keep or not (alone or len(set(free)) > 1):
        return found, []
    return found, [_shared(angle, sharing, free, found[sharing[0]].angle_1_s)]


def _shared(angle: Parameter, sharing: list[Axis], free: list[float], agreed_1_s: float) -> Finding:
    why = (
        f"It is not changed because only {sharing[0]} was tuned"
        if len(sharing) == 1
        else f"{' and '.join(sharing)} would need {' and '.join(f'{gain / angle.per_si:.0f}' for gain in free)}; both "
        f"get {agreed_1_s / angle.per_si:.0f}"
    )
    return remark("angle_shared", angle.name, f"Roll and pitch share {angle.name}. {capital(why)}.")


def shares_angle(known: KnownAxis) -> bool:
    """Whether another axis flies the angle gain of this one."""
    angle = parameters_of(known.controller).get("A")
    return angle is not None and angle.shared


def _gains(axis: Axis, known: KnownAxis, wishes: Wishes, why: str = "") -> AxisGains:
    """As :func:`axis_gains`; a failure names the axis, unless the user asked for something wrong."""
    try:
        return axis_gains(axis, known, wishes, why=why)
    except UsageError:
        raise
    except Exception as failure:
        raise AxisError(axis, failure) from failure


def axis_gains(axis: LoopName, known: KnownAxis, wishes: Wishes, *, why: str = "") -> AxisGains:
    """Flown and proposed gains of one axis or outer loop, both judged on all likely plants.

    Parameters
    ----------
    axis, known
        With the filters to fly.
    wishes
        Limits; with a given angle gain, that one is proposed.
    why
        Why the angle gain is given, which ends the reasons of the proposal.
    """
    parts = known.parts
    found = propose(
        axis,
        known.plant,
        known.controller.controller,
        parts=parts,
        flown_parts=None if known.then is None else known.flown_parts,
        ends=tuple(at_ends(known.controller, parts).values()),
        wishes=wishes,
    )
    if why:
        found = replace(found, reasons=(*found.reasons, why))
    if found.changed:
        found = replace(found, proposed=scores_of(known, parts, rounded(known.controller, found.proposed.gains)))
    elif known.then is not None or known.flown_plant is not None:
        # Gains that stay fly the other filters too.
        found = replace(found, proposed=scores_of(known, parts, found.flown.gains))
    if (before := known.flown_plant) is not None:
        # What flew had the inner loops of that flight.
        drawn = before.drawn(known.omega_rad_s)
        flown = judged(known.flown_parts, drawn, found.flown.gains, from_rad_s=before.known_from_rad_s)
        found = replace(found, flown=flown)
    better = float(np.median(found.proposed.attitude_rms / found.flown.attitude_rms))
    return AxisGains(replace(found, better=better), wishes)


def scores_of(known: KnownAxis, parts: ControllerParts, gains: Gains) -> Judged:
    """What gains of an axis do on every likely plant, by the transfer functions of some filters."""
    return judged(parts, known.drawn(), gains, from_rad_s=known.plant.known_from_rad_s)
