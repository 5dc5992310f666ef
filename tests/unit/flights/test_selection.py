"""What is fitted, what is kept unseen, and which channel is the instrument."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Kind, Maneuver, Source, Topic
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flights.flights import Flight
from rotorid.flights.instruments import (
    band_of_instrument,
    by_instruments,
    choose_instruments,
    find_instrument,
    instrument_of,
)
from rotorid.flights.measure import measure
from rotorid.flights.selection import select_maneuvers
from rotorid.io.records import as_records
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.parsing import parse_segment
from rotorid.signal.excitations import find_excitations
from rotorid.typing import FloatArray

RATE_HZ = 50.0
STOP_S = 100.0


def maneuver(kind: Kind, start_s: float, stop_s: float) -> Maneuver:
    return Maneuver(axis="roll", kind=kind, start_s=start_s, stop_s=stop_s, origin="declared")


SWEEP = maneuver("sweep", 10.0, 40.0)
BINARY = maneuver("random_binary", 45.0, 70.0)
DOUBLET = maneuver("doublet", 80.0, 83.0)


def source(name: str) -> Source:
    return Source(name=name, format="CSV", sha256=name)


def record(
    *declared: Maneuver, moving: Sequence[str] = (), resting: Sequence[str] = (), name: str = "flight.csv"
) -> FlightRecord:
    """A log whose ``moving`` channels swing by one unit and whose ``resting`` ones do not."""
    time_s = np.arange(0.0, STOP_S, 1.0 / RATE_HZ)
    names = ("roll_command", "p", *moving, *resting)
    values = np.zeros((len(names), time_s.size))
    values[: 2 + len(moving)] = np.sin(time_s) + np.sin(2.7 * time_s)
    channels = tuple(Channel(name=n, unit=STANDARD_UNITS[n]) for n in names)
    topic = Topic(name="all", time_s=time_s, channels=channels, values=values)
    return FlightRecord(source=source(name), topics=(topic,), declared=declared)


def test_rich_maneuvers_are_fitted_and_short_ones_kept_unseen() -> None:
    log = record(SWEEP, DOUBLET, BINARY)
    selection = select_maneuvers([log], ["roll"], IdentifySettings())
    assert [one.maneuver for one in selection.fitted] == [SWEEP, BINARY]
    assert [one.maneuver for one in selection.unseen] == [DOUBLET]


def flight(*, landed_s: float = STOP_S, **moving: tuple[float, float]) -> FlightRecord:
    """A log that flies until it lands, whose named channels swing over their intervals only."""
    time_s = np.arange(0.0, STOP_S, 1.0 / RATE_HZ)
    names = ("roll_command", "p", "thrust_command", *moving)
    values = np.zeros((len(names), time_s.size))
    values[2] = np.where(time_s < landed_s, 0.5, 0.0)
    for row, (start_s, stop_s) in enumerate(moving.values(), start=3):
        inside = (time_s >= start_s) & (time_s < stop_s)
        phase = time_s[inside] - start_s
        # A slow to fast sweep where there is time for one, else a doublet.
        long = stop_s - start_s > 10.0
        values[row, inside] = np.sin(phase + 0.1 * phase**2) if long else np.sign(np.sin(np.pi * phase + 1e-9))
    channels = tuple(Channel(name=n, unit=STANDARD_UNITS[n]) for n in names)
    topic = Topic(name="all", time_s=time_s, channels=channels, values=values)
    return FlightRecord(source=source("flight.csv"), topics=(topic,))


def unseen_of(*records: FlightRecord) -> list[tuple[str, float]]:
    selection = select_maneuvers(records, ["roll"], IdentifySettings())
    return [(one.maneuver.signal, round(one.maneuver.start_s)) for one in selection.unseen]


def test_a_set_point_that_moves_while_the_stick_of_the_sweeps_rests_is_no_maneuver() -> None:
    swept = flight(roll_stick=(10.0, 50.0))
    returning = replace(flight(roll_stick=(0.0, 0.0), phi_setpoint=(60.0, 62.0)), source=source("returning.csv"))
    assert [m.signal for m in find_excitations(returning, "roll")] == ["phi_setpoint"]
    assert unseen_of(swept, returning) == []
    # Where the sweeps were set-points themselves, it is one as they are.
    by_program = replace(flight(phi_setpoint=(10.0, 50.0)), source=source("program.csv"))
    assert unseen_of(by_program, returning) == [("phi_setpoint", 60)]


def test_a_stick_doublet_is_unseen_beside_an_injected_sweep() -> None:
    swept = flight(roll_excitation=(10.0, 50.0))
    flown = replace(flight(roll_stick=(60.0, 62.0)), source=source("sticks.csv"))
    assert unseen_of(swept, flown) == [("roll_stick", 60)]


def test_a_maneuver_that_ends_on_the_ground_is_not_kept_unseen() -> None:
    swept = flight(roll_stick=(10.0, 50.0))
    later = replace(flight(roll_stick=(60.0, 62.0)), source=source("later.csv"))
    landing = replace(flight(roll_stick=(60.0, 62.0), landed_s=61.0), source=source("landing.csv"))
    assert unseen_of(swept, later) == [("roll_stick", 60)]
    assert unseen_of(swept, landing) == []


def test_given_segments_replace_what_is_found_and_what_they_cover_is_not_unseen() -> None:
    log = record(SWEEP, DOUBLET, moving=["roll_excitation"])
    given = (parse_segment("roll:50:90"),)
    selection = select_maneuvers([log], ["roll"], IdentifySettings(segments=given))
    kept = [one.maneuver for one in selection.fitted]
    assert [(one.start_s, one.stop_s, one.origin) for one in kept] == [(50.0, 90.0, "given")]
    assert selection.unseen == ()


def test_a_segment_of_another_axis_is_not_left_out_silently() -> None:
    given = (parse_segment("roll:50:90"), parse_segment("pitch:1:2"))
    with pytest.raises(UsageError, match="pitch:1:2 is on another axis"):
        select_maneuvers([record(SWEEP)], ["roll"], IdentifySettings(segments=given))


def test_a_segment_beyond_the_log_is_refused_with_the_span_of_the_log() -> None:
    settings = IdentifySettings(segments=(parse_segment("roll:500:600"),))
    with pytest.raises(UsageError, match=r"0\.0 to 100\.0 s of flight\.csv"):
        select_maneuvers([record(SWEEP)], ["roll"], settings)


def test_only_short_maneuvers_are_refused_with_their_names() -> None:
    with pytest.raises(InsufficientDataError, match=r"only short roll maneuvers \(doublet at 80\.0 s\)") as refused:
        select_maneuvers([record(DOUBLET)], ["roll"], IdentifySettings())
    assert [finding.kind for finding in refused.value.findings] == ["no_excitation"]


def test_the_same_data_twice_are_refused_and_other_data_are_not() -> None:
    log, other = record(SWEEP), record(SWEEP, name="other.csv")
    assert len(select_maneuvers([log, other], ["roll"], IdentifySettings()).fitted) == 2
    with pytest.raises(UsageError, match=r"flight\.csv was given twice"):
        select_maneuvers([log, other, log], ["roll"], IdentifySettings())
    with pytest.raises(UsageError, match="no log was given"):
        select_maneuvers([], ["roll"], IdentifySettings())


def test_logs_without_a_hash_are_told_apart() -> None:
    """Folders of tables have none."""
    folders = [replace(one, source=replace(one.source, sha256="")) for one in (record(SWEEP), record(SWEEP))]
    assert len(select_maneuvers(folders, ["roll"], IdentifySettings()).fitted) == 2
    with pytest.raises(UsageError, match="given twice"):
        select_maneuvers([folders[0], folders[0]], ["roll"], IdentifySettings())


def test_logs_of_one_name_get_names_of_their_own() -> None:
    """Every card begins with a 00000001.BIN; one log that is given twice keeps its name, under which it is refused."""
    monday, tuesday, other = (record(SWEEP, name=name) for name in ("a.csv", "b.csv", "c.csv"))
    tuesday = replace(tuesday, source=replace(tuesday.source, name="a.csv"))
    assert [one.source.name for one in as_records([monday, other, tuesday])] == ["a.csv (1)", "c.csv", "a.csv (2)"]
    assert [one.source.name for one in as_records([monday, other])] == ["a.csv", "c.csv"]
    assert [one.source.name for one in as_records([monday, monday])] == ["a.csv", "a.csv"]


def test_what_is_fitted_is_known_again_in_another_copy_of_the_log() -> None:
    selection = select_maneuvers([record(SWEEP, BINARY)], ["roll"], IdentifySettings(segments=(SWEEP,)))
    again = record(SWEEP, BINARY)
    assert selection.fits(Flight(again, SWEEP))
    assert not selection.fits(Flight(again, BINARY))
    assert not selection.fits(Flight(record(SWEEP, name="other.csv"), SWEEP))


def test_the_injection_is_the_instrument_before_any_set_point() -> None:
    log = record(SWEEP, moving=["p_setpoint", "phi_setpoint", "roll_excitation"])
    assert find_instrument([Flight(log, SWEEP)], "roll") == "roll_excitation"


def test_a_channel_that_rests_is_no_instrument() -> None:
    log = record(SWEEP, moving=["phi_setpoint"], resting=["roll_excitation"])
    assert find_instrument([Flight(log, SWEEP)], "roll") == "phi_setpoint"


def test_the_command_itself_is_never_the_instrument() -> None:
    assert find_instrument([Flight(record(SWEEP), SWEEP)], "roll") is None


def test_the_instrument_must_move_in_every_maneuver() -> None:
    flown = [
        Flight(record(SWEEP, moving=["roll_excitation"]), SWEEP),
        Flight(record(SWEEP, name="other.csv"), SWEEP),
    ]
    assert find_instrument(flown, "roll") is None


PITCH = Maneuver(axis="pitch", kind="sweep", start_s=10.0, stop_s=40.0, origin="declared")


@pytest.mark.parametrize(("name", "chosen"), [("roll_excitation", "roll_excitation"), ("phi_setpoint", "phi_setpoint")])
def test_what_another_log_lacks_is_an_instrument_of_the_axis_that_it_moved(name: str, chosen: str | None) -> None:
    """Taken as zero where another axis was flown, an instrument says nothing there, and is still free of feedback."""
    flown = [
        Flight(record(SWEEP, moving=[name]), SWEEP),
        Flight(record(PITCH, moving=["pitch_excitation"], name="other.csv"), PITCH),
    ]
    assert find_instrument(flown, "roll") == chosen


@pytest.mark.parametrize("order", [1, -1])
def test_an_instrument_that_one_of_several_logs_lacks_is_refused(order: int) -> None:
    flown = [
        Flight(record(SWEEP, moving=["phi_setpoint"]), SWEEP),
        Flight(record(SWEEP, name="other.csv"), SWEEP),
    ]
    settings = IdentifySettings(instruments=("phi_setpoint",))
    with pytest.raises(InsufficientDataError, match=r"other\.csv has no phi_setpoint"):
        choose_instruments(flown[::order], ["roll_command"], ["p"], settings)
    assert choose_instruments(flown[:1], ["roll_command"], ["p"], settings) == ("phi_setpoint",)


TIME_S = np.arange(0.0, STOP_S, 1.0 / RATE_HZ)
CHIRP = np.where((TIME_S > 10.0) & (TIME_S < 60.0), np.sin((TIME_S - 10.0) + 0.25 * (TIME_S - 10.0) ** 2), 0.0)
SWEPT = replace(SWEEP, stop_s=60.0, band_rad_s=(1.0, 26.0), origin="found", signal="phi_setpoint")


def log_of(name: str = "flight.csv", *declared: Maneuver, **channels: FloatArray) -> FlightRecord:
    topic = Topic(
        name="all",
        time_s=TIME_S,
        channels=tuple(Channel(name=n, unit=STANDARD_UNITS[n]) for n in channels),
        values=np.stack(list(channels.values())),
    )
    return FlightRecord(source=source(name), topics=(topic,), declared=declared)


def test_a_stick_without_power_in_the_band_of_a_sweep_is_no_instrument_of_it() -> None:
    """A pilot who pushes once, slowly, against a drift, while a program sweeps the attitude."""
    push = 0.5 * np.exp(-0.5 * ((TIME_S - 30.0) / 1.0) ** 2)
    log = log_of(roll_command=CHIRP, p=CHIRP, roll_stick=push, phi_setpoint=CHIRP)
    assert instrument_of(Flight(log, SWEPT), "roll") == "phi_setpoint"
    # An interval that is given has the signal of what was flown in it.
    given = Maneuver(axis="roll", kind="other", start_s=12.0, stop_s=58.0, origin="given")
    assert instrument_of(Flight(log, given), "roll") == "phi_setpoint"
    by_hand = log_of(roll_command=CHIRP, p=CHIRP, roll_stick=CHIRP, phi_setpoint=CHIRP)
    (swept,) = find_excitations(by_hand, "roll")
    assert instrument_of(Flight(by_hand, swept), "roll") == "roll_stick"
    assert instrument_of(Flight(by_hand, given), "roll") == "roll_stick"


def test_what_the_log_declares_is_the_instrument_whatever_else_moves() -> None:
    log = log_of(roll_command=CHIRP, p=CHIRP, roll_stick=CHIRP, roll_excitation=CHIRP)
    declared = replace(SWEPT, origin="declared", signal="roll_excitation")
    assert instrument_of(Flight(log, declared), "roll") == "roll_excitation"


def test_the_band_of_a_stick_ends_where_its_power_does() -> None:
    slow = np.convolve(np.random.default_rng(0).standard_normal(TIME_S.size), np.hanning(100), "same")
    log = log_of(roll_command=CHIRP, p=CHIRP, roll_stick=0.1 * slow / slow.std(), roll_excitation=CHIRP)
    whole = Flight(log, replace(SWEEP, start_s=0.0, stop_s=99.0))
    # A window of 2 s has its first zero at 4 pi / 2 s, and side lobes of a ten-thousandth of the power.
    low, high = band_of_instrument([whole], "roll_stick")
    assert low == 0.0
    assert 5.0 < high < 13.0
    assert band_of_instrument([whole], "roll_excitation")[1] > 20.0
    assert band_of_instrument([whole], "yaw_stick") == (0.0, np.inf)
    # A stick that was named and never moved has no band, and is no reason to stop.
    idle = Flight(log_of(roll_command=CHIRP, p=CHIRP, roll_stick=np.full(TIME_S.size, 0.1)), whole.maneuver)
    assert band_of_instrument([idle], "roll_stick") == (0.0, np.inf)


def in_closed_loop(name: str, *, injected: bool, seed: int) -> FlightRecord:
    """A roll axis in gusts, p' = 40 u - 2 p + gusts, under u = 0.2 (stick - p) + injection, swept in one of both."""
    rng = np.random.default_rng(seed)
    gusts = 0.5 * rng.standard_normal(TIME_S.size)
    stick, added = (0.0 * CHIRP, 0.2 * CHIRP) if injected else (CHIRP, 0.0 * CHIRP)
    p, u = np.zeros(TIME_S.size), np.zeros(TIME_S.size)
    for k in range(TIME_S.size):
        u[k] = 0.2 * (stick[k] - p[k]) + added[k]
        if k + 1 < TIME_S.size:
            p[k + 1] = p[k] + (40.0 * u[k] - 2.0 * p[k] + gusts[k]) / RATE_HZ
    declared = [replace(SWEPT, origin="declared", signal="roll_excitation")] if injected else []
    return log_of(name, *declared, roll_command=u, p=p, roll_stick=stick, roll_excitation=added)


def test_maneuvers_of_two_instruments_are_measured_apart_and_joined() -> None:
    records = [in_closed_loop("a.csv", injected=True, seed=1), in_closed_loop("b.csv", injected=False, seed=2)]
    flown = select_maneuvers(records, ["roll"], IdentifySettings()).fitted
    settings = IdentifySettings()
    assert [instrument_of(flight, "roll") for flight in flown] == ["roll_excitation", "roll_stick"]
    assert find_instrument(flown, "roll") is None
    assert by_instruments(flown, ["roll_command"], settings) == [flown[:1], flown[1:]]
    measured = measure(flown, inputs=("roll_command",), outputs=("p",), settings=settings)
    assert measured.response.estimate == "joint"
    (said,) = (one for one in measured.findings if one.kind == "joined_records")
    assert "roll_excitation at 10.0 s of a.csv; roll_stick at" in said.message
    omega = measured.response.omega_rad_s
    z = np.exp(1j * omega / RATE_HZ)
    truth = 40.0 / RATE_HZ / (z - 1.0 + 2.0 / RATE_HZ)
    inside = (omega > 2.0) & (omega < 20.0)
    error = np.abs(measured.response.values[0, 0] / truth - 1.0)[inside]
    stated = np.sqrt(2.0) * measured.response.random_error[0, 0, inside]
    assert float(np.mean(error < 2.5 * stated)) > 0.9
    alone = measure(flown[:1], inputs=("roll_command",), outputs=("p",), settings=settings)
    # Two flights tell more than one of them.
    assert float(np.median(measured.response.random_error[0, 0, inside])) < float(
        np.median(np.interp(omega[inside], alone.response.omega_rad_s, alone.response.random_error[0, 0]))
    )
