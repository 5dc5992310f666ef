"""What is fitted, what is kept unseen, and which channel is the instrument."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from rotorid.data.channel import STANDARD_UNITS, Channel
from rotorid.data.maneuver import Kind, Maneuver
from rotorid.data.record import FlightRecord, Source, Topic
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.pipeline.instruments import find_instrument
from rotorid.pipeline.selection import select_maneuvers
from rotorid.pipeline.settings import IdentifySettings, parse_segment

RATE_HZ = 50.0
STOP_S = 100.0


def maneuver(kind: Kind, start_s: float, stop_s: float) -> Maneuver:
    return Maneuver(axis="roll", kind=kind, start_s=start_s, stop_s=stop_s, origin="declared")


SWEEP = maneuver("sweep", 10.0, 40.0)
BINARY = maneuver("random_binary", 45.0, 70.0)
DOUBLET = maneuver("doublet", 80.0, 83.0)


def record(
    *declared: Maneuver, moving: Sequence[str] = (), resting: Sequence[str] = (), name: str = "flight.csv"
) -> FlightRecord:
    """A log whose ``moving`` channels swing by one unit and whose ``resting`` ones do not."""
    time_s = np.arange(0.0, STOP_S, 1.0 / RATE_HZ)
    names = ("roll_command", "p", *moving, *resting)
    values = np.zeros((len(names), time_s.size))
    values[: 2 + len(moving)] = np.sin(time_s)
    channels = tuple(Channel(name=n, unit=STANDARD_UNITS[n]) for n in names)
    topic = Topic(name="all", time_s=time_s, channels=channels, values=values)
    return FlightRecord(source=Source(name=name, format="CSV", sha256=name), topics=(topic,), declared=declared)


def test_rich_maneuvers_are_fitted_and_short_ones_kept_unseen() -> None:
    log = record(SWEEP, DOUBLET, BINARY)
    selection = select_maneuvers([log], ["roll"], IdentifySettings())
    assert [m for _, m in selection.fitted] == [SWEEP, BINARY]
    assert [m for _, m in selection.unseen] == [DOUBLET]


def test_given_segments_replace_what_is_found_and_what_they_cover_is_not_unseen() -> None:
    log = record(SWEEP, DOUBLET, moving=["roll_excitation"])
    given = (parse_segment("roll:50:90"),)
    selection = select_maneuvers([log], ["roll"], IdentifySettings(segments=given))
    assert [(m.start_s, m.stop_s, m.origin) for _, m in selection.fitted] == [(50.0, 90.0, "given")]
    assert selection.unseen == ()


def test_a_segment_of_another_axis_is_not_left_out_silently() -> None:
    given = (parse_segment("roll:50:90"), parse_segment("pitch:1:2"))
    with pytest.raises(UsageError, match="pitch:1:2 is of another axis"):
        select_maneuvers([record(SWEEP)], ["roll"], IdentifySettings(segments=given))


def test_a_segment_beyond_the_log_is_refused_with_the_span_of_the_log() -> None:
    settings = IdentifySettings(segments=(parse_segment("roll:500:600"),))
    with pytest.raises(InsufficientDataError, match=r"0\.0 to 100\.0 s of flight\.csv"):
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
    with pytest.raises(UsageError, match="no record came"):
        select_maneuvers([], ["roll"], IdentifySettings())


def test_what_is_fitted_is_known_again_in_another_copy_of_the_log() -> None:
    selection = select_maneuvers([record(SWEEP, BINARY)], ["roll"], IdentifySettings(segments=(SWEEP,)))
    again = record(SWEEP, BINARY)
    assert selection.fits(again, SWEEP)
    assert not selection.fits(again, BINARY)
    assert not selection.fits(record(SWEEP, name="other.csv"), SWEEP)


def test_the_injection_is_the_instrument_before_any_set_point() -> None:
    log = record(SWEEP, moving=["p_setpoint", "phi_setpoint", "roll_excitation"])
    assert find_instrument([(log, SWEEP)], "roll") == "roll_excitation"


def test_a_channel_that_rests_is_no_instrument() -> None:
    log = record(SWEEP, moving=["phi_setpoint"], resting=["roll_excitation"])
    assert find_instrument([(log, SWEEP)], "roll") == "phi_setpoint"


def test_the_command_itself_is_never_the_instrument() -> None:
    assert find_instrument([(record(SWEEP), SWEEP)], "roll") is None


def test_the_instrument_must_move_in_every_maneuver() -> None:
    flown = [(record(SWEEP, moving=["roll_excitation"]), SWEEP), (record(SWEEP, name="other.csv"), SWEEP)]
    assert find_instrument(flown, "roll") is None
