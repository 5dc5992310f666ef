"""Maneuvers as records of a fit in time: rates, holds, and inputs that stand still."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.checking.response_flight import RATE_HZ, TRUTH, flight

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Maneuver, TimeHistory
from rotorid.documents.result import result_document
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.time.output_error import TimeData
from rotorid.flights.flights import Flight
from rotorid.flights.segments import TimeRecords, time_records
from rotorid.flights.selection import select_records
from rotorid.identifying.identification import identify
from rotorid.models.families import named_model
from rotorid.models.library import response_model
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.parsing import parse_segment
from rotorid.typing import FloatArray

SECOND = response_model("response.second_order_delay", [("phi_setpoint", "phi")])
BOX = named_model("black_box:2", inputs=["phi_setpoint"], outputs=["phi"])


def whole(record: FlightRecord) -> Flight:
    return Flight(record, Maneuver(axis="roll", kind="other", start_s=record.start_s, stop_s=record.stop_s))


def slower(record: FlightRecord, every: int = 2) -> FlightRecord:
    """Every second sample of a log: its commands, which stood for longer than that, are still held."""
    (topic,) = record.topics
    thinned = replace(topic, time_s=topic.time_s[::every], values=topic.values[:, ::every])
    source = replace(record.source, name=f"slow_{record.source.name}", sha256=f"slow {record.source.sha256}")
    return replace(record, source=source, topics=(thinned,))


def with_setpoint(record: FlightRecord, setpoint: FloatArray) -> FlightRecord:
    (topic,) = record.topics
    return replace(record, topics=(replace(topic, values=np.stack([setpoint, topic.values[1]])),))


def late(record: FlightRecord) -> FlightRecord:
    """The set-point in a topic of its own, stamped between the samples of the angle."""
    (topic,) = record.topics
    command, answer = (
        replace(topic, name=name, time_s=topic.time_s + shift_s, channels=topic.channels[row : row + 1],
                values=topic.values[row : row + 1])
        for row, (name, shift_s) in enumerate((("asked", 0.3 / RATE_HZ), ("angle", 0.0)))
    )  # fmt: skip
    # The angle sets the clock, as the slower of the two.
    quick = replace(
        command,
        time_s=np.repeat(command.time_s, 2) + np.tile([0.0, 0.5 / RATE_HZ], command.time_s.size),
        values=np.repeat(command.values, 2, axis=1),
    )
    source = replace(record.source, name=f"late_{record.source.name}", sha256=f"late {record.source.sha256}")
    return replace(record, source=source, topics=(quick, answer))


def records_of(*logs: FlightRecord, hold: str = "auto") -> TimeRecords:
    settings = IdentifySettings(hold=hold)  # type: ignore[arg-type]
    return time_records(SECOND, [whole(one) for one in logs], settings)


def test_every_log_keeps_its_rate_and_its_held_commands() -> None:
    fast, slow = flight(seed=1, samples=1000), slower(flight(seed=0, samples=1000))
    records = records_of(fast, slow)
    assert records.hold == "zero"
    assert [one.sample_rate_hz for one in records.data] == pytest.approx([50.0, 25.0])
    for data, log in zip(records.data, (fast, slow), strict=True):
        np.testing.assert_array_equal(data.outputs[0], log.topics[0].values[1])
    assert not any("were resampled to" in finding.message for finding in records.findings)


def test_the_delay_is_the_same_from_logs_of_two_rates() -> None:
    fast, slow = flight(seed=1, samples=1000), slower(flight(seed=0, samples=1000))
    found = result_document(identify([fast, slow], "response.second_order_delay"))
    delay = found.parameters["tau_phi"]
    assert found.hold == "zero"
    assert delay.std_random is not None
    # Four deviations; joined by lines the held steps of the slow log would be half of 40 ms late.
    assert abs(delay.value - TRUTH["tau_phi"]) < 4.0 * delay.std_random
    assert 4.0 * delay.std_random < 0.5 / 25.0


def test_logs_of_which_one_is_held_ask_for_a_hold() -> None:
    held, joined = flight(seed=0, samples=500), late(flight(seed=1, samples=500))
    assert records_of(joined).hold == "first"
    with pytest.raises(UsageError, match=r"flight0\.csv at 3\.0 s but continuous in .*late_flight1\.csv.*--hold"):
        records_of(held, joined)
    assert records_of(held, joined, hold="first").hold == "first"


def test_a_black_box_has_one_rate() -> None:
    logs = [flight(seed=1, samples=500), slower(flight(seed=0, samples=500))]
    flown = [whole(one) for one in logs]
    with pytest.raises(UsageError, match="--hold"):
        time_records(BOX, flown, IdentifySettings())
    records = time_records(BOX, flown, IdentifySettings(hold="first"))
    assert {one.sample_rate_hz for one in records.data} == {25.0}


def test_logs_of_one_name_are_told_apart() -> None:
    fast, slow = flight(seed=1, samples=500), slower(flight(seed=0, samples=500))
    same = replace(slow, source=replace(slow.source, name=fast.source.name))
    assert records_of(fast, same).hold == "zero"


def test_a_constant_is_no_motion_however_its_mean_is_rounded() -> None:
    names = ("phi_setpoint", "phi")
    assert np.ptp(np.full(1000, 0.1) - np.full(1000, 0.1).mean()) == 0.0
    assert np.abs(np.full(1000, 0.1) - np.full(1000, 0.1).mean()).max() > 0.0
    history = TimeHistory(
        values=np.stack([np.full(1000, 0.1), np.arange(1000.0)]),
        channels=tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in names),
        sample_rate_hz=RATE_HZ,
        start_s=0.0,
        processing=(),
    )
    data = TimeData.of(history, inputs=names[:1], outputs=names[1:], name="r")
    assert not data.inputs.any()
    assert TimeData.of(history, inputs=names[1:], outputs=names[:1], name="r").inputs.any()


def test_an_input_that_never_moves_identifies_nothing() -> None:
    still = with_setpoint(flight(samples=1000), np.full(1000, 0.1))
    with pytest.raises(InsufficientDataError, match=r"phi_setpoint does not move in flight0\.csv") as refused:
        identify([still], "response.second_order_delay")
    assert [finding.kind for finding in refused.value.findings] == ["no_excitation"]
    # Beside a log in which it moves, one in which it rests is data.
    assert len(records_of(still, flight(seed=1, samples=1000)).data) == 2


def test_to_score_a_model_one_moving_input_will_do() -> None:
    (topic,) = (record := flight(samples=500)).topics
    names = ("theta_setpoint", "theta")
    both = replace(
        topic,
        channels=(*topic.channels, *(Channel(name=name, unit="rad") for name in names)),
        values=np.vstack([topic.values, np.full((2, topic.time_s.size), 0.1)]),
    )
    pairs = response_model("response.first_order", [("phi_setpoint", "phi"), ("theta_setpoint", "theta")])
    flown = [whole(replace(record, topics=(both,)))]
    with pytest.raises(InsufficientDataError, match="theta_setpoint does not move"):
        time_records(pairs, flown, IdentifySettings())
    assert len(time_records(pairs, flown, IdentifySettings(), every_input=False).data) == 1


@pytest.mark.parametrize("segments", [(), (parse_segment("roll:0:9"),)])
def test_a_log_of_one_sample_is_too_short(segments: tuple[Maneuver, ...]) -> None:
    (topic,) = (record := flight(samples=500)).topics
    one = replace(record, topics=(replace(topic, time_s=topic.time_s[:1], values=topic.values[:, :1]),))
    with pytest.raises(InsufficientDataError, match="one moment") as refused:
        select_records(SECOND, [one], IdentifySettings(segments=segments))
    assert [finding.kind for finding in refused.value.findings] == ["record_too_short"]
