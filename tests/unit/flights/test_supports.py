"""Which models a log supports: ``identify``, ``--model all``, ``review`` and ``tune`` do what ``inspect`` answers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from tests.twins import track_flights as twin

from rotorid import identify, inspect, review
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Maneuver, Source, Status, Topic, Unread
from rotorid.errors import InsufficientDataError
from rotorid.flights.selection import select_records
from rotorid.flights.supports import supported_models, supporting_logs, supports, unsupported
from rotorid.identifying.identify_many import identify_several, none_identified
from rotorid.models.library import rate_model as structure_of
from rotorid.proposing.plants import rate_model
from rotorid.results.model import IdentifiedModel
from rotorid.settings.identifying import IdentifySettings
from rotorid.simulation.wind import Wind
from rotorid.typing import FloatArray

MODEL = "rate.roll"
TRUTH = {"L_roll": 113.1, "L_p": -1.0}


def _by_identify(record: FlightRecord) -> IdentifiedModel | str:
    try:
        return identify(record, MODEL)
    except InsufficientDataError as error:
        return str(error)


def _by_all(record: FlightRecord) -> IdentifiedModel | str:
    several = identify_several(record)
    found = several.get(MODEL)
    if isinstance(found, IdentifiedModel):
        return found
    findings = found.findings if found is not None else none_identified(several, [record]).findings
    return " ".join(finding.message for finding in findings)


def _by_review(record: FlightRecord) -> IdentifiedModel | str:
    seen = review(record)
    found = seen.models.get(MODEL)
    if isinstance(found, IdentifiedModel):
        return found
    return " ".join(one.why for one in seen.cannot_tell if one.what in ("models", f"models.{MODEL}"))


def _by_tune(record: FlightRecord) -> IdentifiedModel | str:
    try:
        return rate_model("roll", (), [record])
    except InsufficientDataError as error:
        return str(error)


VERBS: dict[str, Callable[[FlightRecord], IdentifiedModel | str]] = {
    "identify": _by_identify,
    "identify all": _by_all,
    "review": _by_review,
    "tune": _by_tune,
}


def _record(rows: dict[str, FloatArray], *, rate_hz: float = 50.0, status: Status | None = None) -> FlightRecord:
    channels = tuple(Channel(name=name, unit=STANDARD_UNITS[name], source=name) for name in rows)
    values = np.stack(list(rows.values()))
    topic = Topic(name="log", time_s=np.arange(values.shape[1]) / rate_hz, channels=channels, values=values)
    source = Source(name="made.csv", format="CSV", sha256=str(hash(values.tobytes())))
    return FlightRecord(topics=(topic,), source=source, status=status or Status())


@pytest.fixture(scope="module")
def flown() -> dict[str, FloatArray]:
    """A minute and a half by stick in wind, and what is logged of them."""
    air = Wind(north_m_s=2.1, east_m_s=2.1, turbulence_m_s=0.5)
    return twin.columns(twin.fly(90.0, level=0.5, wind=air, seed=3))


def _without(columns: dict[str, FloatArray], name: str) -> dict[str, FloatArray]:
    return {key: values for key, values in columns.items() if key != name}


IN_AIR = Status(vehicle="multirotor", armed=((0.0, 89.0),), in_air=((0.0, 89.0),), flagged_in="twin")
MADE: dict[str, Callable[[dict[str, FloatArray]], FlightRecord]] = {
    "by stick": lambda flown: _record(flown, status=IN_AIR),
    "stick at rest": lambda flown: _record({**flown, "roll_stick": 0.0 * flown["roll_stick"]}, status=IN_AIR),
    "no stick": lambda flown: _record(_without(flown, "roll_stick"), status=IN_AIR),
    "no rate": lambda flown: _record(_without(flown, "p"), status=IN_AIR),
    "no command": lambda flown: _record(_without(flown, "roll_command"), status=IN_AIR),
    "slow": lambda flown: _record({k: v[::2] for k, v in flown.items()}, rate_hz=25.0, status=IN_AIR),
    "short flight": lambda flown: _record(flown, status=replace(IN_AIR, in_air=((40.0, 55.0),))),
    "never flew": lambda flown: _record(flown, status=replace(IN_AIR, in_air=(), armed=())),
    "rover": lambda flown: _record(flown, status=replace(IN_AIR, vehicle="rover", named_in="FRAME_CLASS")),
}
SAYS = {
    "stick at rest": "the roll stick does not move in flight",
    "no stick": "no roll stick is logged, nor a set-point that is the stick",
    "no rate": "the log lacks p",
    "no command": "the log lacks roll_command",
    "slow": "logged too slowly (roll_command at 25 Hz, p at 25 Hz)",
    "short flight": "no flight lasts 20 s",
    "never flew": "has no flight of 2 s and more, as twin shows: the vehicle was never armed",
    "rover": "the vehicle is a rover, not a multirotor, according to FRAME_CLASS",
}


def test_an_ordinary_flight_is_identified_by_every_verb_alike_and_right(flown: dict[str, FloatArray]) -> None:
    record = MADE["by stick"](flown)
    support = inspect(record).supports[MODEL]
    assert (support.possible, support.by, support.instrument) == (True, "ordinary flight", "roll_stick")
    assert "wider than from a sweep" in support.because
    assert "sweep" in support.remedy
    answers = {verb: ask(record) for verb, ask in VERBS.items()}
    found = {verb: answer for verb, answer in answers.items() if isinstance(answer, IdentifiedModel)}
    assert found.keys() == VERBS.keys(), answers
    first = found["identify"]
    std = first["L_roll"].std
    assert std is not None
    assert abs(first["L_roll"].value - TRUTH["L_roll"]) < 3.0 * std
    for answer in found.values():
        assert {name: (one.value, one.std) for name, one in answer.parameters.items()} == {
            name: (one.value, one.std) for name, one in first.parameters.items()
        }
        assert [f.severity for f in answer.findings if f.kind == "no_excitation"] == ["info"]


@pytest.mark.parametrize("made", SAYS)
def test_what_inspect_refuses_every_verb_refuses_with_the_same_sentence(
    made: str, flown: dict[str, FloatArray]
) -> None:
    record = MADE[made](flown)
    support = inspect(record).supports[MODEL]
    assert not support.possible
    assert SAYS[made] in support.because
    flies = made not in ("never flew",)
    for verb, ask in VERBS.items():
        answer = ask(record)
        if verb == "review" and not flies:
            assert answer == ""  # its flight is missing, which it says instead
            continue
        assert isinstance(answer, str), verb
        assert support.because.lower() in answer.lower(), verb


def _slow_sweep(rate_hz: float) -> FlightRecord:
    """A sweep of a rate loop with a lag of 48 ms, simulated at 500 Hz and logged more slowly."""
    rng, step_s = np.random.default_rng(2), 0.002
    time_s = np.arange(0.0, 80.0, step_s)
    sweep = np.where(np.abs(time_s - 40.0) < 30.0, 0.1 * np.sin(_phase(time_s - 10.0)), 0.0)
    lagged, p = np.zeros(time_s.size), np.zeros(time_s.size)
    for k in range(1, time_s.size):
        lagged[k] = lagged[k - 1] + step_s / 0.048 * (sweep[k - 1] - lagged[k - 1])
        p[k] = p[k - 1] + step_s * (TRUTH["L_roll"] * lagged[k - 1] + TRUTH["L_p"] * p[k - 1])
    p += 0.01 * rng.standard_normal(p.size)
    rows = {"roll_command": sweep, "p": p, "thrust_command": np.full(p.size, 0.4)}
    stride = round(1.0 / (step_s * rate_hz))
    sent = Maneuver(
        axis="roll",
        kind="sweep",
        start_s=10.0,
        stop_s=70.0,
        origin="declared",
        signal="roll_command",
        band_rad_s=(1.0, 40.0),
    )
    return replace(_record({k: v[::stride] for k, v in rows.items()}, rate_hz=rate_hz, status=IN_AIR), declared=(sent,))


def _phase(since_s: FloatArray) -> FloatArray:
    """Of a sweep from 1 to 40 rad/s in 60 s, whose frequency grows exponentially."""
    return np.asarray(60.0 / np.log(40.0) * (np.exp(np.log(40.0) * since_s / 60.0) - 1.0))


@pytest.mark.parametrize("rate_hz", [20.0, 25.0])
def test_a_sweep_that_was_logged_slowly_is_possible_and_identified_right(rate_hz: float) -> None:
    """Such logs carry a sweep of a rate loop: gain and damping lie within their intervals."""
    record = _slow_sweep(rate_hz)
    support = inspect(record).supports[MODEL]
    assert (support.possible, support.by) == (True, "excitation")
    assert "too slow for motor lag and delay" in support.because
    found = identify(record, MODEL)
    for name, truth in TRUTH.items():
        assert (std := found[name].std) is not None
        assert abs(found[name].value - truth) < 3.0 * std
    assert "rate_too_low" in {finding.kind for finding in found.findings}


def test_two_ordinary_logs_are_each_used_once(flown: dict[str, FloatArray]) -> None:
    first = MADE["by stick"](flown)
    second = _record({name: values[::-1].copy() for name, values in flown.items()}, status=IN_AIR)
    chosen = select_records(structure_of(MODEL), [first, second], IdentifySettings(), in_time=False)
    assert [flight.record is first for flight in chosen.selection.fitted] == [True, False]
    assert len(chosen.findings) == 2


def test_beside_a_sweep_an_ordinary_log_takes_no_part(flown: dict[str, FloatArray]) -> None:
    ordinary = MADE["by stick"](flown)
    sweep = Maneuver(axis="roll", kind="sweep", start_s=20.0, stop_s=80.0, origin="declared", signal="roll_stick")
    swept = replace(_record({k: v[:4250] for k, v in flown.items()}, status=IN_AIR), declared=(sweep,))
    chosen = select_records(structure_of(MODEL), [ordinary, swept], IdentifySettings(), in_time=False)
    assert [flight.record is swept for flight in chosen.selection.fitted] == [True]
    assert not chosen.findings


def test_several_logs_support_what_one_of_them_does(flown: dict[str, FloatArray]) -> None:
    poor, good = MADE["no rate"](flown), MADE["by stick"](flown)
    assert MODEL in supported_models([poor, good])
    assert unsupported([poor, good], MODEL) is None
    refused = unsupported([poor, MADE["stick at rest"](flown)], MODEL)
    assert refused is not None
    assert "the roll stick does not move" in str(refused)  # it comes closer than a log without a rate


def test_a_log_of_another_vehicle_takes_no_part_beside_one_that_serves(flown: dict[str, FloatArray]) -> None:
    good, rover = MADE["by stick"](flown), MADE["rover"]({name: values[:4000] for name, values in flown.items()})
    kept, findings = supporting_logs([rover, good], MODEL)
    assert [one is good for one in kept] == [True]
    assert [finding.kind for finding in findings] == ["other_vehicle"]
    assert "made.csv was left out: the vehicle is a rover" in findings[0].message
    with pytest.raises(InsufficientDataError, match="not a multirotor"):
        supporting_logs([rover], MODEL)


def test_a_given_segment_is_obeyed(flown: dict[str, FloatArray]) -> None:
    settings = IdentifySettings(
        segments=(Maneuver(axis="roll", kind="other", start_s=5.0, stop_s=80.0, origin="given"),)
    )
    assert MODEL in supported_models([MADE["stick at rest"](flown)], settings)
    chosen = select_records(structure_of(MODEL), [MADE["slow"](flown)], settings, in_time=False)
    assert [(one.maneuver.start_s, one.maneuver.stop_s) for one in chosen.selection.fitted] == [(5.0, 80.0)]


def test_a_model_of_two_axes_needs_both(flown: dict[str, FloatArray]) -> None:
    support = supports(MADE["by stick"](flown))["hover.lateral"]
    assert not support.possible
    assert "no sweep of roll and yaw" in support.because


def test_what_is_not_read_is_not_said_to_be_lacking() -> None:
    near = Unread(
        name="actuator_outputs", channels=("motor_",), why="which of them are motors is not known", rate_hz=50
    )
    record = FlightRecord(source=Source(name="a.ulg", format="PX4 ULog", sha256=""), topics=(), unread=(near,))
    support = supports(record)["physical.motors"]
    assert (support.possible, support.because) == (False, "no motor_1 or motor_speed_1 was read")
    assert support.remedy.startswith("actuator_outputs is in the log (50 Hz), but rotorid does not read it: which of")
    assert [need.found for need in support.needs] == ["in the log, but not read"]
