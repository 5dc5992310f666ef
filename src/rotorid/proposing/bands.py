"""The sweep that ``tune`` needs, for the plan of its flight."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rotorid.autopilots.registry import named
from rotorid.data.axes import RATE_OF
from rotorid.data.findings import Finding, warn
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flights.controllers import controllers_of_result
from rotorid.flying.designs import default_entry
from rotorid.flying.flight_air import flown_as
from rotorid.flying.settings import DesignSettings
from rotorid.io.registry import log_rate_hz
from rotorid.models.autopilots.settings import AxisController
from rotorid.planning.aircraft import aircraft_loop, rate_filters
from rotorid.planning.loop import LoopModel
from rotorid.planning.prior import with_prior
from rotorid.proposing.axis import known_axis
from rotorid.proposing.flown_gains import at_ends, flown_controllers
from rotorid.proposing.new_gains import wishes_of
from rotorid.proposing.settings import TUNED_AXES, TuneSettings
from rotorid.results.model import IdentifiedModel
from rotorid.simulation.multirotor_flight import Aircraft
from rotorid.tuning.bands import LOWEST_RAD_S, band_of, crossover_rad_s, foreseen
from rotorid.tuning.loops import ControllerParts, frequency_grid
from rotorid.tuning.proposal import AxisProposal
from rotorid.typing import Axis, ComplexArray, FloatArray

_LOGGED = 0.5
"""Share of half of the log's rate up to which a sweep is of use."""

_SENT_RAD_S = 2.0 * np.pi * 10.0
"""Set-points are sent at 100 Hz: ten per period of the highest frequency."""


def designed_for_tune(
    choices: DesignSettings, *, record: FlightRecord | None = None, models: Sequence[IdentifiedModel] = ()
) -> DesignSettings:
    """Choices of a design whose sweeps have the band that ``tune`` needs from the gains of a log or a result.

    Each axis is swept over its own band; axes flown together over the widest. Gains, noise and wind are those of the
    log. The band is what ``tune`` needs for the plant of that log or result, or, without one, for the vehicle.

    Parameters
    ----------
    choices
        The design; its band is replaced.
    record, models
        The log, or results of one vehicle, whose gains flew.

    Raises
    ------
    UsageError
        The vehicle takes set-points only, its autopilot is another one, or no axis is tuned.
    InsufficientDataError
        Neither log nor results contain the gains of an axis.
    """
    axes = [axis for axis in choices.plan.axes if axis in TUNED_AXES]
    if choices.entry.interface is not None or not axes:
        raise UsageError(
            f"--for-tune does not fit {choices.entry.name} with {', '.join(choices.plan.axes)}",
            needed="a vehicle with known gains, and roll, pitch or yaw",
        )
    choices = flown_as(choices, record) if record is not None else _with_gains_of(choices, models)
    logs = () if record is None else (record,)
    controllers = flown_controllers(axes, models, logs)
    if missing := [axis for axis in axes if axis not in controllers]:
        raise InsufficientDataError(
            f"the gains of {' and '.join(missing)} are not known",
            needed="a log with the autopilot's parameters, or a result from such a log",
        )
    craft = choices.aircraft
    loop = aircraft_loop(craft, filtered=True)
    if choices.prior is not None:
        loop = with_prior(loop, choices.prior)
    logged_hz = log_rate_hz(named(craft.autopilot.kind).log_format, craft.autopilot.rate_hz)
    bands: dict[Axis, tuple[float, float]] = {}
    short: list[Finding] = []
    for axis in axes:
        sent = (choices.plan.entry or default_entry(craft, axis)) != "command"
        most = min(_LOGGED * np.pi * logged_hz, _SENT_RAD_S if sent else np.inf)
        highest = _measured_rad_s(axis, models, logs)
        if highest is None:
            found, highest = _foreseen(axis, controllers[axis], craft, loop)
            if not found.keeps_limits:
                short.append(_no_gains(axis, found))
        bands[axis] = (LOWEST_RAD_S, float(min(np.ceil(highest), np.floor(most))))
        if highest > bands[axis][1]:
            short.append(
                _too_low(axis, highest, bands[axis][1], "set-points" if sent and most == _SENT_RAD_S else "logs")
            )
    # Axes that are flown at the same time share the widest.
    widest = (LOWEST_RAD_S, max(high for _, high in bands.values()))
    plan = replace(choices.plan, band_rad_s=widest, bands=bands)
    return replace(choices, plan=plan, remarks=(*choices.remarks, *short))


def _too_low(axis: Axis, needed_rad_s: float, most_rad_s: float, by: str) -> Finding:
    """A warning that slow set-points or a slow log end a sweep below what ``tune`` needs."""
    return warn(
        "band_below_crossover",
        axis,
        f"tune needs a sweep of {axis} up to {needed_rad_s / (2.0 * np.pi):.0f} Hz, but {by} of this autopilot reach "
        "only "
        f"{most_rad_s / (2.0 * np.pi):.0f} Hz; above that, margins will rely on the model.",
        needed_rad_s=needed_rad_s,
        planned_to_rad_s=most_rad_s,
    )


def _with_gains_of(choices: DesignSettings, models: Sequence[IdentifiedModel]) -> DesignSettings:
    known = next((model.controller for model in models if model.controller is not None), None)
    if known is None:
        raise InsufficientDataError("the result contains no gains", remedy="give the log in its place")
    firmware = known.firmware or choices.firmware
    gains = controllers_of_result(known).parameters
    return replace(choices, gains=gains, gains_source="the result", firmware=firmware)


def _measured_rad_s(axis: Axis, models: Sequence[IdentifiedModel], logs: Sequence[FlightRecord]) -> float | None:
    """Upper end of the band for the plant that ``tune`` takes from the same data; ``None`` without one."""
    try:
        known = known_axis(axis, models, logs, filters={}, draws=TuneSettings().draws, seed=0, findings=[])
    except InsufficientDataError:
        return None
    return known.needed_rad_s(wishes_of(known.controller, TuneSettings()))


def _no_gains(axis: Axis, found: AxisProposal) -> Finding:
    """A warning that the band is that of the flown gains, because no others are expected."""
    words = "; ".join(found.reasons)
    return warn(
        "tuning_bound",
        axis,
        f"No better gains of {axis} are expected ({words}). The sweep covers the flown gains, and may end too low for "
        "the gains that tune finds.",
        flown_crossover_rad_s=crossover_rad_s(found.flown),
    )


def _foreseen(axis: Axis, controller: AxisController, craft: Aircraft, loop: LoopModel) -> tuple[AxisProposal, float]:
    """Gains expected for an axis with the planned vehicle as plant, and the upper end of their band."""
    row, column = loop.outputs.index(RATE_OF[axis]), loop.inputs.index(f"{axis}_command")

    def plant(omega_rad_s: FloatArray) -> ComplexArray:
        return np.asarray(loop.plant.response(omega_rad_s)[row, column])

    omega = frequency_grid(controller.controller)
    # The plant is measured behind the filters of the controller.
    filters = rate_filters(craft, omega)[row]
    parts = ControllerParts(controller=controller.controller, omega_rad_s=omega, filters=filters, logged=filters)
    ends = tuple(at_ends(controller, parts).values())
    wishes = wishes_of(controller, TuneSettings())
    found = foreseen(axis, plant, controller.controller, parts, wishes=wishes, ends=ends)
    return found, band_of(found, plant, parts)[1]
