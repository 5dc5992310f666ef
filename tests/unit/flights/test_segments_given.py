"""A segment inside no log is wrong use, and a log that never flew is refused, in one way wherever it is found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from tests.unit.checking.large_motion import large_motion
from tests.unit.checking.response_flight import flight
from tests.unit.identifying import motor_logs

import rotorid
from rotorid.checking.predictions import whole_flights
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Status, Topic
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flights.motor_data import motor_data
from rotorid.flights.selection import select_maneuvers, select_records
from rotorid.flights.selection import whole_flights as flown_whole
from rotorid.flying.flown_models import fly_log
from rotorid.identifying.cross_validation import cross_validate
from rotorid.identifying.delays import delay
from rotorid.identifying.identification import identify, identify_motors
from rotorid.identifying.verification import verify
from rotorid.loops.responses import response
from rotorid.models.library import response_model
from rotorid.results.model import IdentifiedModel
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.motors import MotorSettings
from rotorid.settings.parsing import parse_segment
from rotorid.settings.verifying import VerifySettings

OUTSIDE = (parse_segment("roll:900:990"),)
SAYS = r"the segment roll:900:990 lies outside every log; expected a segment within [03]\.0 to .* s of .*; see the"
FIRST = response_model("response.first_order", [("phi_setpoint", "phi")])


def fold(records: list[FlightRecord], choices: IdentifySettings) -> IdentifiedModel:
    return identify(records, FIRST, settings=choices)


def log(*names: str, name: str = "flight.csv", status: Status | None = None) -> FlightRecord:
    """Noise on every channel for 40 s, in which nothing stands out."""
    time_s, rng = np.arange(0.0, 40.0, 0.02), np.random.default_rng(0)
    channels = tuple(Channel(name=one, unit=STANDARD_UNITS[one], source=one) for one in names)
    topic = Topic(name="all", time_s=time_s, channels=channels, values=rng.normal(size=(len(names), time_s.size)))
    source = Source(name=name, format="CSV", sha256=name)
    return FlightRecord(source=source, topics=(topic,), status=status or Status())


@pytest.fixture(scope="module")
def motors(tmp_path_factory: pytest.TempPathFactory) -> FlightRecord:
    path = motor_logs.flight(tmp_path_factory.mktemp("motors") / "motors.csv")
    return rotorid.read(path)


@pytest.fixture(scope="module")
def linear() -> IdentifiedModel:
    return identify([flight(samples=800)], FIRST)


@pytest.mark.parametrize(
    "run",
    [
        lambda: identify([log("roll_command", "p")], "rate.roll", segments=OUTSIDE),
        lambda: identify([log("roll_command", "p")], "rate.roll", segments=OUTSIDE, method="output_error"),
        lambda: identify([flight(samples=800)], FIRST, segments=OUTSIDE),
        lambda: delay([log("roll_command", "p")], input="roll_command", output="p", segments=OUTSIDE),
        lambda: delay([log("roll_command", "p")], segments=OUTSIDE),
        lambda: response([log("roll_command", "p")], inputs=["roll_command"], outputs=["p"], segments=OUTSIDE),
        lambda: identify([large_motion()], "flight.first_order", segments=OUTSIDE),
        lambda: cross_validate(
            [flight(seed=one, samples=800) for one in (1, 2)],
            FIRST,
            identify=fold,
            kind="each",
            settings=IdentifySettings(segments=OUTSIDE),
        ),
    ],
    ids=["frequency", "commands in time", "set-points", "delay", "delays", "response", "flight", "cross-validation"],
)
def test_it_is_one_error(run: Callable[[], object]) -> None:
    with pytest.raises(UsageError, match=SAYS) as refused:
        run()
    assert refused.value.exit_code == 2


def test_it_is_the_same_for_motors(motors: FlightRecord) -> None:
    with pytest.raises(UsageError, match=SAYS):
        identify_motors([motors], MotorSettings(layout="quad.x", segments=OUTSIDE))


def test_it_is_the_same_for_a_model_that_is_judged_or_flown(linear: IdentifiedModel) -> None:
    unseen = flight(seed=7, samples=800)
    with pytest.raises(UsageError, match=SAYS):
        verify(linear, [unseen], settings=VerifySettings(segments=OUTSIDE))
    with pytest.raises(UsageError, match=SAYS):
        fly_log(linear, [unseen], segments=OUTSIDE)


def test_of_several_logs_those_that_it_does_not_reach_take_no_part(linear: IdentifiedModel) -> None:
    near, far = flight(seed=7, samples=800), flight(seed=8, samples=200)
    within = (parse_segment("roll:7:15"),)
    assert far.stop_s < 7.0
    flown = fly_log(linear, [near, far], segments=within)
    assert [one.record for one in flown.stretches] == [near.source.name]
    (left,) = [one for one in flown.findings if one.kind == "not_verified"]
    assert left.message == f"{far.source.name} was not flown: it contains no given segment."


def test_a_missing_channel_within_the_segment_is_about_the_data() -> None:
    with pytest.raises(InsufficientDataError, match="has no roll_command"):
        identify([log("p")], "rate.roll", segments=(parse_segment("roll:5:30"),))


GROUNDED = Status(in_air=(), armed=(), flagged_in="vehicle_land_detected")


@pytest.mark.parametrize(
    "run",
    [
        lambda record: select_maneuvers([record], ["roll"], IdentifySettings(), otherwise=flown_whole),
        lambda record: select_records(FIRST, [record], IdentifySettings()),
        lambda record: delay([record], input="phi_setpoint", output="phi"),
        lambda record: delay([record]),
        lambda record: response([record], inputs=["phi_setpoint"], outputs=["phi"]),
        lambda record: whole_flights([record], ()),
    ],
    ids=["frequency", "time", "delay", "delays", "response", "nonlinear"],
)
def test_a_log_that_never_flew_is_refused_alike(run: Callable[[FlightRecord], object]) -> None:
    with pytest.raises(InsufficientDataError, match="no flight of 2 s and more, as vehicle_land_detected") as refused:
        run(log("phi_setpoint", "phi", "roll_command", status=GROUNDED))
    assert [finding.kind for finding in refused.value.findings] == ["never_airborne"]


def test_motors_that_never_flew_are_refused_alike(motors: FlightRecord) -> None:
    with pytest.raises(InsufficientDataError, match="no flight of 2 s") as refused:
        motor_data([replace(motors, status=GROUNDED)], MotorSettings(layout="quad.x"))
    assert [finding.kind for finding in refused.value.findings] == ["never_airborne"]


def test_of_several_logs_of_motors_those_that_it_does_not_reach_take_no_part(motors: FlightRecord) -> None:
    later = tuple(replace(topic, time_s=topic.time_s + 100.0) for topic in motors.topics)
    other = replace(motors, topics=later, source=replace(motors.source, name="later.csv", sha256="later"))
    choices = MotorSettings(layout="quad.x", segments=(parse_segment("roll:2:18"),))
    flights = motor_data([motors, other], choices).flights
    assert {flight.record.source.name for flight in flights} == {"motors.csv"}
