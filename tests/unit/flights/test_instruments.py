"""What autopilots say of a flight, in the pipeline: what is cut, what counts as an excitation, what was seen before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from rotorid.checking.predictions import fitted_logs, was_fitted
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Intervals, Maneuver, Source, Status, Topic
from rotorid.errors import InsufficientDataError
from rotorid.flights.flights import Flight
from rotorid.flights.instruments import excited_band, find_instrument, is_free, while_flying
from rotorid.flights.selection import select_maneuvers
from rotorid.results.provenance import provenance
from rotorid.reviewing.inspection import inspect
from rotorid.settings.identifying import IdentifySettings
from rotorid.signal.airborne import airborne
from rotorid.signal.excitations import find_excitations, still_declarations
from rotorid.typing import FloatArray

TIME_S = np.arange(0.0, 120.0, 0.01)
CHIRP = np.sin(0.5 * (TIME_S - 40.0) + 0.1 * (TIME_S - 40.0) ** 2) * ((TIME_S > 40.0) & (TIME_S < 100.0))


def record(name: str = "a.ulg", sha256: str = "a", *, status: Status | None = None, **rows: FloatArray) -> FlightRecord:
    channels = tuple(Channel(name=one, unit=STANDARD_UNITS[one], source=one) for one in rows)
    topic = Topic(name="clock", time_s=TIME_S, channels=channels, values=np.stack(list(rows.values())))
    source = Source(name=name, format="PX4 ULog", sha256=sha256)
    return FlightRecord(source=source, topics=(topic,), status=status or Status())


def flown(*intervals: tuple[float, float]) -> Status:
    told: Intervals = tuple(intervals)
    return Status(in_air=told, armed=told, flagged_in="vehicle_land_detected")


def given(start_s: float, stop_s: float) -> Maneuver:
    return Maneuver(axis="roll", kind="other", start_s=start_s, stop_s=stop_s, origin="given")


def test_flags_go_before_thrust_and_are_not_cut() -> None:
    thrust = np.where((TIME_S > 50.0) & (TIME_S < 60.0), 0.5, 0.0)
    found = airborne(record(thrust_command=thrust, status=flown((10.0, 110.0))))
    assert (found.intervals, found.seen_in, found.by_flags) == (((10.0, 110.0),), "vehicle_land_detected", True)


def test_flags_of_a_log_that_never_flew_go_before_thrust() -> None:
    with pytest.raises(InsufficientDataError, match="as vehicle_land_detected shows"):
        airborne(record(thrust_command=np.full(TIME_S.size, 0.5), status=flown()))


def test_an_early_flag_is_believed_where_the_vehicle_moves() -> None:
    raised = replace(flown((10.0, 30.0)), early=True)
    still = record(p=np.zeros(TIME_S.size), status=raised)
    with pytest.raises(InsufficientDataError, match="no flight"):
        airborne(still)
    moving = record(p=0.3 * np.sin(5.0 * TIME_S), status=raised)
    assert airborne(moving).intervals == ((10.0, 30.0),)
    # Whoever raises the throttle and tips over is said to fly for seconds.
    with pytest.raises(InsufficientDataError, match="no flight"):
        airborne(record(p=0.3 * np.sin(5.0 * TIME_S), status=replace(flown((10.0, 13.0)), early=True)))


def test_acro_at_zero_throttle_is_flight_while_the_vehicle_turns() -> None:
    thrust = np.where((TIME_S > 10.0) & (TIME_S < 110.0), 0.5, 0.0)
    thrust[(TIME_S > 50.0) & (TIME_S < 53.0)] = 0.0
    dive = record(thrust_command=thrust, p=2.0 * np.sin(3.0 * TIME_S))
    assert len(airborne(dive).intervals) == 1
    landed = record(thrust_command=thrust, p=np.zeros(TIME_S.size))
    assert len(airborne(landed).intervals) == 2


def test_a_given_segment_is_cut_by_flags_and_said_so() -> None:
    flight = record(p=CHIRP, status=flown((60.0, 110.0)))
    (kept,), (finding,) = while_flying([Flight(flight, given(10.0, 70.0))])
    assert (kept.maneuver.start_s, kept.maneuver.stop_s) == (60.0, 70.0)
    assert (finding.kind, finding.severity) == ("airborne", "warning")
    (kept,), (finding,) = while_flying([Flight(flight, given(10.0, 50.0))])
    assert (kept.maneuver.start_s, kept.maneuver.stop_s) == (10.0, 50.0)
    assert "mostly on the ground" in finding.message


def test_sticks_on_the_ground_excite_nothing() -> None:
    assert [m.kind for m in find_excitations(record(roll_stick=CHIRP), "roll")] == ["sweep"]
    assert [m.kind for m in find_excitations(record(roll_stick=CHIRP, status=flown((5.0, 110.0))), "roll")] == ["sweep"]
    assert find_excitations(record(roll_stick=CHIRP, status=flown((5.0, 30.0))), "roll") == ()


@pytest.mark.parametrize(("turns", "kinds"), [(0.1, ["doublet"]), (1.0, [])])
def test_a_flip_is_no_doublet(turns: float, kinds: list[str]) -> None:
    stick = np.where((TIME_S > 50.0) & (TIME_S < 50.6), 1.0, 0.0) - np.where(
        (TIME_S > 50.6) & (TIME_S < 51.0), 1.0, 0.0
    )
    rate = 2.0 * np.pi * turns / 0.6 * np.maximum(stick, 0.0)
    assert [m.kind for m in find_excitations(record(roll_stick=stick, p=rate), "roll")] == kinds


def test_what_is_declared_in_a_signal_that_stands_still_is_none() -> None:
    sweep = Maneuver(axis="roll", kind="sweep", start_s=40.0, stop_s=100.0, origin="declared", signal="roll_excitation")
    still = replace(record(roll_excitation=np.zeros(TIME_S.size)), declared=(sweep,))
    assert find_excitations(still, "roll") == ()
    assert still_declarations(still) == (sweep,)
    said = [f.message for f in inspect(still).findings if f.kind == "no_excitation"]
    assert said == ["The log declares a roll sweep from 40.00 to 100.00 s, but roll_excitation did not move."]
    moving = replace(record(roll_excitation=CHIRP), declared=(sweep,))
    assert list(find_excitations(moving, "roll")) == [sweep]


def test_set_points_that_are_the_stick_are_instruments() -> None:
    acro = replace(flown((5.0, 115.0)), direct_rates=((0.0, 80.0),))
    flight = record(p_setpoint=CHIRP, roll_stick=CHIRP, status=acro)
    early, late = Flight(flight, given(45.0, 70.0)), Flight(flight, given(70.0, 100.0))
    assert is_free([early], "p_setpoint")
    assert find_instrument([early], "roll") == "p_setpoint"
    assert not is_free([early, late], "p_setpoint")
    assert find_instrument([early, late], "roll") == "roll_stick"


def test_another_vehicle_gets_no_advice_for_multirotors() -> None:
    plane = record(p=CHIRP, status=Status(vehicle="plane", named_in="MAV_TYPE 1"))
    found = inspect(plane)
    assert found.vehicle == "plane"
    assert {support.remedy for support in found.supports.values()} == {""}


def test_a_log_is_known_by_its_content_and_not_by_its_name() -> None:
    fitted, judged = record("flight (1).csv", "one", p=CHIRP), record("flight (2).csv", "two", p=CHIRP)
    same_name = record("flight (1).csv", "three", p=CHIRP)
    maneuver = given(45.0, 70.0)
    came = provenance([fitted, judged, same_name], IdentifySettings(), flights=[Flight(fitted, maneuver)])
    assert was_fitted(came, Flight(fitted, maneuver))
    assert was_fitted(came, Flight(record("renamed.csv", "one", p=CHIRP), maneuver))
    assert not was_fitted(came, Flight(judged, maneuver))
    assert not was_fitted(came, Flight(same_name, maneuver))
    assert fitted_logs(came) == {"one"}
    other = provenance([fitted, same_name], IdentifySettings(), flights=[Flight(same_name, maneuver)])
    assert [one.record for one in other.maneuvers] == ["flight (1).csv (2)"]
    assert not was_fitted(other, Flight(fitted, maneuver))
    assert was_fitted(other, Flight(same_name, maneuver))


def test_what_another_vehicle_is_asked_for_is_no_sweep() -> None:
    rover = replace(flown((5.0, 110.0)), vehicle="rover", named_in="the log")
    still = record(yaw_command=np.zeros(TIME_S.size), r=np.zeros(TIME_S.size), status=rover)
    with pytest.raises(InsufficientDataError) as caught:
        select_maneuvers([still], ["yaw"], IdentifySettings())
    assert "sweep" not in str(caught.value)
    assert "in which yaw moves slowly and fast" in str(caught.value)
    with pytest.raises(InsufficientDataError, match="this needs a sweep"):
        select_maneuvers([record(yaw_command=np.zeros(TIME_S.size))], ["yaw"], IdentifySettings())


def test_a_binary_signal_excites_far_above_its_half_periods() -> None:
    # A controller answers steps of an angle with torque that has nearly all of its power octaves above them.
    rng = np.random.default_rng(3)
    steps = np.where(np.repeat(rng.random(120), 100) > 0.5, 0.2, -0.2)
    torque = np.diff(lfilter([0.1], [1.0, -0.9], steps), prepend=0.0)
    flight = Flight(record(theta_setpoint=steps, pitch_command=torque), given(0.0, 119.0))
    slow, fast = excited_band([flight], "theta_setpoint"), excited_band([flight], "pitch_command")
    assert slow is not None
    assert fast is not None
    assert slow[0] < 1.0
    assert slow[1] < fast[1]
    # The torque turns over at the 10 rad/s of the lag; its half periods say 3 rad/s at most.
    assert fast[0] < 10.0 < fast[1]
    assert excited_band([flight], "yaw_command") is None
    assert excited_band([Flight(record(p=np.ones(TIME_S.size)), given(0.0, 119.0))], "p") is None
