"""Responses of whole records: which maneuvers, what is usable, what is said."""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.record import AXES, STANDARD_UNITS, Channel, FlightRecord, Source, Topic
from rotorid.documents.base import to_json
from rotorid.documents.response import ResponseDocument, response_document
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.loops.responses import Responses, refused_response, response, unit_of_ratio
from rotorid.results.provenance import Refused
from rotorid.settings.measuring import ResponseSettings
from rotorid.settings.parsing import parse_segment
from rotorid.simulation.hover_flight import OUTPUTS, Flight, fly
from rotorid.vehicles import s500
from rotorid.vehicles.demo import SWEEPS, demo_plan

VEHICLE = s500.vehicle()


def as_record(flight: Flight, name: str = "flight.csv", **factors: float) -> FlightRecord:
    """A log of a flight, channels multiplied by the factors that came."""
    names = list(flight.columns)
    topic = Topic(
        name="all",
        time_s=flight.time_s,
        channels=tuple(Channel(name=n, unit=STANDARD_UNITS[n]) for n in names),
        values=np.stack([factors.get(n, 1.0) * flight.columns[n] for n in names]),
    )
    return FlightRecord(source=Source(name=name, format="CSV", sha256=name), topics=(topic,))


def without(record: FlightRecord, *names: str) -> FlightRecord:
    (topic,) = record.topics
    rows = [row for row, channel in enumerate(topic.channels) if channel.name not in names]
    kept = replace(topic, channels=tuple(topic.channels[row] for row in rows), values=topic.values[rows])
    return replace(record, topics=(kept,))


@pytest.fixture(scope="module")
def roll() -> FlightRecord:
    """The two roll sweeps of the demonstration."""
    rng = np.random.default_rng(1)
    return as_record(fly(VEHICLE, demo_plan(rng=rng)[:SWEEPS], rng=rng))


@pytest.fixture(scope="module")
def pitch() -> FlightRecord:
    """Its two pitch sweeps, in a log of their own."""
    rng = np.random.default_rng(2)
    plan = [part for part in demo_plan(rng=rng) if part.maneuver.axis == "pitch" and part.maneuver.kind == "sweep"]
    early = plan[0].maneuver.start_s - 3.0
    moved = [
        replace(
            part,
            maneuver=replace(part.maneuver, start_s=part.maneuver.start_s - early, stop_s=part.maneuver.stop_s - early),
        )
        for part in plan
    ]
    return as_record(fly(VEHICLE, moved, rng=rng), "pitch.csv")


@pytest.fixture(scope="module")
def found(roll: FlightRecord) -> Responses:
    return response([roll], inputs=["roll_command"], outputs=["p", "ay"])


def said(result: Responses | Refused) -> Mapping[str, str]:
    return {finding.kind: finding.severity for finding in result.findings}


def test_usable_points_are_the_vehicle_within_their_errors(found: Responses) -> None:
    response = found.response
    for row, output in enumerate(response.outputs):
        exact = VEHICLE.system.response(response.omega_rad_s)[OUTPUTS.index(output), AXES.index("roll")]
        used = found.used[row, 0]
        deviation = np.sqrt(np.einsum("ff->f", response.covariance[row, 0]).real)
        assert used.sum() > 60
        # The autopilot answers a roll sweep with some yaw, which is an input of its own to roll and is not told apart.
        assert np.sqrt(np.mean(np.abs((response.values[row, 0] - exact) / deviation)[used] ** 2)) < 2.5


def test_the_document_says_what_the_arrays_hold(found: Responses) -> None:
    document, response = response_document(found), found.response
    assert document.instruments == ["roll_excitation"]
    pair = document.pairs["p/roll_command"]
    omega = response.omega_rad_s[found.used[0, 0]]
    assert pair.band_rad_s == (omega[0], omega[-1])
    assert pair.points == omega.size
    assert pair.unit == "rad/s"
    values = np.array(pair.magnitude) * np.exp(1j * np.array(pair.phase_rad))
    assert np.allclose(values, response.values[0, 0])
    assert ResponseDocument.model_validate_json(document.model_dump_json(by_alias=True)) == document


def test_responses_show_themselves_in_a_few_lines_and_pickle(found: Responses) -> None:
    shown = repr(found).splitlines()
    assert shown[0].startswith("joint estimate with roll_excitation")
    assert len(shown) <= 20
    assert "p/roll_command" in found._repr_html_()
    assert response_document(pickle.loads(pickle.dumps(found))) == response_document(found)


def test_phases_run_on_without_jumps_and_begin_where_a_person_would(found: Responses) -> None:
    pair = found.pairs["p/roll_command"]
    phase = np.array(pair.phase_rad)[np.array(pair.used)]
    assert np.abs(np.diff(phase)).max() < 1.0
    # A rate falls behind its command from −90° on; the speed modes lead below.
    assert -np.pi < phase[0] < np.pi
    assert phase[-1] < phase[0]


def test_margins_stand_beside_with_their_errors(found: Responses) -> None:
    loop = found.loops["roll"]
    assert "roll_excitation" in loop.method
    crossover = loop.numbers["crossover_rad_s"]
    assert crossover.std < 0.1 * crossover.value
    # Integrators hold disturbances off from zero frequency on, so the sensitivity rises through −3 dB near there.
    rejection = loop.numbers["disturbance_rejection_bandwidth_rad_s"]
    assert 0.2 * crossover.value < rejection.value < crossover.value
    assert not set(loop.numbers) & set(loop.not_seen)


def test_logs_of_two_axes_give_all_four_responses(roll: FlightRecord, pitch: FlightRecord) -> None:
    pair = response([roll, pitch], inputs=["roll_command", "pitch_command"], outputs=["p", "q"])
    assert pair.response.instruments == ("roll_excitation", "pitch_excitation")
    assert pair.used[0, 0].sum() > 60
    assert pair.used[1, 1].sum() > 60
    # The axes do not couple: nothing to be seen, which is a remark and no warning.
    assert not pair.used[0, 1].any()
    assert said(pair)["low_coherence"] == "info"
    assert 0.0 <= pair.input_coherence["roll_command,pitch_command"] < 0.3
    assert {record.record for record in pair.records} == {"flight.csv", "pitch.csv"}
    assert all(record.coherence for record in pair.records)


def test_workers_change_no_number(roll: FlightRecord) -> None:
    alone, shared = (
        response_document(response([roll], inputs=["roll_command"], outputs=["p"], workers=count))
        for count in (None, 2)
    )
    assert len([record for record in alone.records if record.coherence]) == 2
    # The number of workers is no setting of the result.
    assert to_json(shared) == to_json(alone)


def test_no_workers_are_none() -> None:
    with pytest.raises(UsageError, match="--workers 0 is out of range"):
        ResponseSettings(workers=0)


def test_what_was_not_injected_counts_as_zero(roll: FlightRecord, pitch: FlightRecord) -> None:
    logs = [without(roll, "pitch_excitation"), without(pitch, "roll_excitation")]
    found = response(logs, inputs=["roll_command", "pitch_command"], outputs=["p", "q"])
    assert found.response.instruments == ("roll_excitation", "pitch_excitation")
    notes = [note for segment in found.segments for note in segment.history.processing]
    assert "pitch_excitation set to zero, not logged" in notes


def test_a_maneuver_that_hardly_shows_in_the_output_is_left_out(roll: FlightRecord) -> None:
    (topic,) = roll.topics
    values = topic.values.copy()
    values[topic.row("p")] = np.random.default_rng(4).standard_normal(topic.time_s.size)
    deaf = replace(
        roll,
        source=replace(roll.source, name="deaf.csv", sha256="deaf"),
        topics=(replace(topic, values=values),),
    )
    found = response([roll, deaf], inputs=["roll_command"], outputs=["p"])
    used = {(record.record, record.used) for record in found.records}
    assert used == {("flight.csv", True), ("deaf.csv", False)}
    left_out = [f for f in found.findings if f.kind == "low_coherence"]
    assert all(finding.where.startswith("deaf.csv") for finding in left_out)
    assert len(left_out) == SWEEPS


def test_a_flight_without_excitation_of_the_axis_is_read_whole_and_it_is_said(pitch: FlightRecord) -> None:
    settings = ResponseSettings(coherence=0.0, band_rad_s=(2.0, 30.0))
    try:
        result = response([pitch], inputs=["roll_command"], outputs=["p"], settings=settings)
    except InsufficientDataError as error:
        result = refused_response(error, [pitch], inputs=["roll_command"], outputs=["p"], settings=settings)  # type: ignore[assignment]
    assert said(result)["no_excitation"] == "warning"
    assert "whole flight" in next(f.message for f in result.findings if f.kind == "no_excitation")


def test_a_constant_input_is_refused_with_its_name(roll: FlightRecord) -> None:
    still = as_record_with(roll, roll_command=0.0)
    with pytest.raises(InsufficientDataError, match="roll_command") as caught:
        response(
            [still],
            inputs=["roll_command"],
            outputs=["p"],
            settings=ResponseSettings(segments=(parse_segment("roll:3:50"),), estimate="direct"),
        )
    assert caught.value.findings


def as_record_with(record: FlightRecord, **values: float) -> FlightRecord:
    """A log with channels that hold one value."""
    (topic,) = record.topics
    changed = topic.values.copy()
    for name, value in values.items():
        changed[topic.row(name)] = value
    return replace(record, topics=(replace(topic, values=changed),))


def test_a_band_above_the_nyquist_frequency_is_refused(roll: FlightRecord) -> None:
    with pytest.raises(UsageError, match="Nyquist"):
        response([roll], inputs=["roll_command"], outputs=["p"], settings=ResponseSettings(band_rad_s=(1.0, 2000.0)))


def test_a_channel_that_is_not_there_is_named(roll: FlightRecord) -> None:
    with pytest.raises(InsufficientDataError, match="has no motor_1"):
        response([roll], inputs=["motor_1"], outputs=["p"])


@pytest.mark.parametrize(
    ("output", "input", "unit"),
    [
        ("p", "roll_command", "rad/s"),
        ("u_dot", "theta", "m/s^2/rad"),
        ("p", "p_setpoint", "1"),
        ("phi", "u", "rad/(m/s)"),
    ],
)
def test_units_of_ratios(output: str, input: str, unit: str) -> None:
    assert unit_of_ratio(output, input) == unit
