"""What reads the controller of a log, or says whether its gains made the commands, by the name of its verb."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from rotorid.data.axes import RATE_OF
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.flights.controller_check import ControllerVerdict, check_controller, controller_findings
from rotorid.flights.controllers import controllers_of, controllers_of_result, logged_controller
from rotorid.flights.given_controllers import Controllers
from rotorid.identifying.identification import controller_settings
from rotorid.models.controller import RateController
from rotorid.proposing.flown_gains import LoggedLoop, flown_controllers, require_controller_match
from rotorid.signal.clock import source_topic
from rotorid.typing import Axis


def of_a_result(record: FlightRecord, axis: Axis) -> RateController | None:
    """What ``tune`` has where it is given the result alone."""
    known = controller_settings([record])
    found = None if known is None else controllers_of_result(known).axis(axis)
    return None if found is None else found.controller


def of_response(record: FlightRecord, axis: Axis) -> RateController | None:
    """What ``response`` multiplies the vehicle with, whichever rate it reads."""
    rate = RATE_OF[axis]
    source = ""
    if rate in record.channel_names:
        topic, row = source_topic(record, rate, record.start_s, record.stop_s)
        source = topic.channels[row].source
    found = logged_controller(record, f"{axis}_command", source=source)
    return None if found is None else found.controller


def of_verify(record: FlightRecord, axis: Axis) -> RateController | None:
    found = Controllers(record=record, given={}).of(axis)
    return None if found is None else found.controller


def of_tune(record: FlightRecord, axis: Axis) -> RateController | None:
    found = flown_controllers((axis,), (), (record,)).get(axis)
    return None if found is None else found.controller


READERS: Mapping[str, Callable[[FlightRecord, Axis], RateController | None]] = {
    "identify": of_a_result,
    "response": of_response,
    "verify": of_verify,
    "tune": of_tune,
}


_SAID: Mapping[tuple[str, ...], ControllerVerdict] = {
    (): "made",
    ("other_controller",): "not made",
    ("controller_unchecked",): "not checked",
}


def by_tune(record: FlightRecord, axis: Axis) -> ControllerVerdict:
    known = controllers_of(record)
    controller = known.axis(axis)
    assert controller is not None
    try:
        said = require_controller_match(
            LoggedLoop(axis=axis, controller=controller, known=known, record=record, source="")
        )
    except InsufficientDataError as refused:
        said = list(refused.findings)
    return _SAID[tuple(finding.kind for finding in said)]


def by_inspect(record: FlightRecord, axis: Axis) -> ControllerVerdict:
    """``inspect``, ``identify`` and ``review`` warn of gains that did not fly, and say nothing of others."""
    wrong = {finding.where for finding in controller_findings(record) if finding.kind == "controller_unexplained"}
    verdict = check_controller(record, axis).verdict
    return "not made" if axis in wrong else "made" if verdict == "not made" else verdict


VERDICTS: Mapping[str, Callable[[FlightRecord, Axis], ControllerVerdict]] = {"tune": by_tune, "inspect": by_inspect}


def readings(record: FlightRecord, axis: Axis) -> dict[str, RateController | None]:
    """The controller of an axis by each reader."""
    return {name: read(record, axis) for name, read in READERS.items()}


def verdicts(record: FlightRecord, axis: Axis) -> dict[str, ControllerVerdict]:
    """Whether the gains made the commands, by each verb; of an axis whose gains are known."""
    return {name: read(record, axis) for name, read in VERDICTS.items()}
