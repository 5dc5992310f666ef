"""Everybody who says for how long a motor was at a limit, each with the share that it states of a log."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.record import Channel, FlightRecord, TimeHistory
from rotorid.errors import InsufficientDataError
from rotorid.flights.oscillations import reviewed_oscillations
from rotorid.flights.whole_flights import flown
from rotorid.proposing.flown_gains import require_room
from rotorid.reviewing.inspection import inspect
from rotorid.reviewing.loops import loops
from rotorid.reviewing.motors import motors
from rotorid.signal.motors import logged_outputs, motor_limits
from rotorid.signal.quality import quality_findings


def _stated(findings: Iterable[Finding]) -> dict[str, float]:
    return {
        name: one.numbers[name]
        for one in findings
        if one.kind == "saturation" and one.where == "motors"
        for name in ("share", "upper_share", "lower_share")
        if name in one.numbers
    }


def _by_maneuver(record: FlightRecord) -> dict[str, float]:
    """What identify says of a maneuver that lasts as long as the flight, where there is one flight."""
    places = np.flatnonzero(motor_limits(record).counted)
    if np.ptp(places) >= places.size:
        return {}
    start_s, stop_s = motor_limits(record).time_s[places[[0, -1]]]
    still = TimeHistory(
        values=np.zeros((1, 2)),
        channels=(Channel(name="roll_command", unit="1"),),
        sample_rate_hz=1.0 / (stop_s - start_s + 2e-6),
        start_s=start_s - 1e-6,
    )
    return _stated(quality_findings(still, axis="roll", limits=motor_limits(record)))


def _by_review(record: FlightRecord) -> dict[str, float]:
    numbers = motors(record)[0].numbers
    names = {"upper_share": "saturated_high_share", "lower_share": "saturated_low_share"}
    stated = {name: numbers[key].value for name, key in names.items()}
    if "saturated_by_roll_share" in numbers:
        by_axis = [numbers[f"saturated_by_{axis}_share"].value for axis in ("roll", "pitch", "yaw", "thrust")]
        stated["share"] = sum(by_axis)
    return stated


def _by_loops(record: FlightRecord) -> dict[str, float]:
    return _stated(finding for loop in loops(flown(record))[0].values() for finding in loop.findings)


def _by_oscillations(record: FlightRecord) -> dict[str, float]:
    percents = [one.at_limit_percent for one in reviewed_oscillations(record) if one.at_limit_percent is not None]
    return {"share": 0.01 * max(percents)} if percents else {}


def _by_tune(record: FlightRecord) -> dict[str, float]:
    try:
        return _stated(require_room(record))
    except InsufficientDataError as refused:
        return _stated(refused.findings)


CALLERS: Mapping[str, Callable[[FlightRecord], dict[str, float]]] = {
    "inspect": lambda record: _stated(inspect(record).findings),
    "identify, motors": lambda record: _stated(logged_outputs(record).findings),
    "identify, maneuver": _by_maneuver,
    "review, motors": _by_review,
    "review, loops": _by_loops,
    "oscillations": _by_oscillations,
    "tune": _by_tune,
}
"""Each gives ``share``, ``upper_share`` and ``lower_share`` as far as it states them; shares that are small are not."""
