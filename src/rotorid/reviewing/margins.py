"""Margins of the rate loops of a flight, as a review states them.

Each loop is that of :mod:`rotorid.loops.rate_loops`; this module adds what a flight does not show, and remarks.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from rotorid.autopilots.advice import move_stick
from rotorid.data.axes import RATE_OF
from rotorid.data.display import capital
from rotorid.data.findings import Finding, remark, warn
from rotorid.errors import InsufficientDataError
from rotorid.flights.controllers import controllers_of
from rotorid.flights.whole_flights import FlightData
from rotorid.loops.plants import PlantUnavailableError
from rotorid.loops.rate_loops import NUMBERS, RateLoop, rate_loop, remedy_of
from rotorid.models.autopilots.betaflight import TOP
from rotorid.reviewing.missing import Unavailable, section
from rotorid.reviewing.values import MarginReview
from rotorid.typing import Axis


def margins(flight: FlightData) -> tuple[dict[Axis, MarginReview], tuple[Unavailable, ...]]:
    """Margins of the rate loops of a flight, each with its error.

    Returns
    -------
    dict of MarginReview
        By axis; an axis that was not measured is absent.
    tuple of Unavailable
        What was not measured, and why.
    """
    found: dict[Axis, MarginReview] = {}
    unavailable: list[Unavailable] = []
    for axis in RATE_OF:
        review, missing = section(f"margins.{axis}", partial(_margin, flight, axis), None)
        unavailable += missing
        if review is not None:
            found[axis] = review
    return found, tuple(unavailable)


def _margin(flight: FlightData, axis: Axis) -> tuple[MarginReview | None, tuple[Unavailable, ...]]:
    """The margins of an axis, and those that were not measured."""
    try:
        loop = rate_loop(axis, flight.record)
    except PlantUnavailableError as reason:
        return None, (Unavailable(what=f"margins.{axis}", why=reason.why, remedy=reason.remedy),)
    except InsufficientDataError as error:
        remedy = error.remedy or move_stick(axis)
        return None, (Unavailable(what=f"margins.{axis}", why=f"{capital(error.came)}.", remedy=remedy),)
    return _review(flight, loop), tuple(
        Unavailable(what=f"margins.{axis}.{name}", why=loop.missing[name], remedy=remedy_of(loop, flight.record))
        for name in NUMBERS
        if name in loop.missing
    )


def _review(flight: FlightData, loop: RateLoop) -> MarginReview:
    return MarginReview(
        axis=loop.measured.axis,
        loop=loop.loop,
        controller=loop.controller,
        instrument=loop.measured.instrument,
        numbers=loop.numbers,
        by_model=loop.by_model,
        findings=(*loop.check.findings, *_remarks(flight, loop)),
        ends=loop.ends,
        settings=loop.settings,
        throttle=controllers_of(flight.record).throttle,
        explained=loop.check.correlation,
        stick_idle=loop.measured.idle,
        verdict=loop.verdict,
        plant=loop.plant,
        source=loop.measured.source,
    )


_LEAST_FACTOR, _SLEWED_SHARE = 0.99, 0.01
"""Factor of ArduPilot's slew limiter that lowers the gains, and least share of the flight for a warning."""

_MOVED = 0.2
"""How much smaller than its gain makes it the logged I term may be without a remark."""


def _remarks(flight: FlightData, loop: RateLoop) -> list[Finding]:
    axis, settings, check, main = loop.measured.axis, loop.settings, loop.check, next(iter(loop.ends), "")
    found = []
    factors = [values for _, values in flight.samples(f"{axis}_slew_factor")]
    if factors:
        values = np.concatenate(factors)
        lowered = float(np.mean(values < _LEAST_FACTOR)) if values.size else 0.0
        if lowered > _SLEWED_SHARE:
            found.append(
                warn(
                    "moving_gains",
                    axis,
                    f"The slew limiter lowered P and D of {axis} for {100.0 * lowered:.0f} % of the flight, down to "
                    f"{100.0 * float(values.min()):.0f} %. The margins are those of the full gains.",
                    share=lowered,
                    least=float(values.min()),
                )
            )
    if main:
        own, base = check.terms.get("d"), settings.controller.derivative_s2
        top = settings.ends[TOP].derivative_s2
        flew = f" (here {own.slope * top / base:.2f} times its base)" if own is not None and base > 0.0 else ""
        found.append(
            remark(
                "moving_gains",
                axis,
                f"D of {axis} changes between two values in flight{flew}. The margins are those with {main}.",
            )
        )
    if "i" in check.terms and check.terms["i"].slope < 1.0 - _MOVED:
        left = max(check.terms["i"].slope, 0.0)
        found.append(
            remark(
                "moving_gains",
                axis,
                f"The integral of {axis} was {100.0 * left:.0f} % of what its gain makes, since the controller reduces "
                "it while the set-point moves. In hover it is larger.",
                share=left,
            )
        )
    return found
