"""Did a vehicle change? Few flights, numbers of one sign, names that stand for several vehicles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from tests.fleet_logs import row_of, table_of

from rotorid.documents.fleet import FleetDocument, fleet_document
from rotorid.fleets import Row, analyze, population
from rotorid.fleets.changes import stated_scatter
from rotorid.fleets.table import REVIEW, Counts
from rotorid.fleets.vehicles import separated
from rotorid.fleets.verdicts import verdicts_of
from rotorid.uncertainty.differences import Scale, differences


def documented(rows: Sequence[Row], **more: dict[str, dict[str, float]]) -> FleetDocument:
    counts = Counts(
        logs=len(rows), answered=len(rows), refused=0, unreadable=0, duplicates=0, resumed=0, rows=len(rows)
    )
    return fleet_document(analyze(rows, **more), failed=(), counts=counts, settings={})


def pair(std_share: float, factor: float = 2.9) -> list[Row]:
    """Two logs of one vehicle, of which one has ``factor`` times the control power."""
    return [row_of("quad", k, value, std_share * value) for k, value in ((1, 100.0), (2, 100.0 * factor))]


def test_two_logs_that_differ_clearly_say_that_the_vehicle_changed() -> None:
    found = documented(pair(0.05))
    assert found.sentences[0] == "The vehicle changed: quad."
    (change,) = found.changes
    assert (change.at_flight, change.after.value / change.before.value) == (2, pytest.approx(2.9))
    assert (found.checked.changed, found.checked.vehicles, found.verdicts[0].verdict) == (1, 1, "changed")


def test_two_logs_with_wide_intervals_decide_nothing() -> None:
    found = documented(pair(0.45))
    assert found.sentences[0] == "Not enough data to detect a change of the vehicle."
    assert found.verdicts[0].verdict == "undecided"
    assert "would be missed" in found.verdicts[0].why


def test_two_logs_that_agree_closely_show_no_change_and_say_how_large_one_could_hide() -> None:
    found = documented(pair(0.02, factor=1.01))
    assert found.sentences[0] == "No change found in quad."
    (number,) = found.verdicts[0].numbers
    assert number.detectable_share == pytest.approx(0.082, abs=0.003)


def test_a_single_flight_is_no_comparison() -> None:
    found = documented([row_of("quad", 1, 100.0)])
    assert found.sentences[0] == "Not enough data: only 1 flight."
    assert (found.checked.of_vehicles, found.checked.vehicles) == (1, 0)


@pytest.mark.parametrize("rows", [[], [row_of("a", 1, 100.0), row_of("b", 1, 100.0)], pair(0.45), pair(0.05)])
def test_nothing_is_never_called_no_change(rows: list[Row]) -> None:
    found = documented(rows)
    assert not found.sentences[0].startswith("No ") or found.checked.unchanged or not rows
    assert found.population == {} or found.population["rate.roll"]["L_roll"].normal is None


def test_a_fleet_says_for_how_many_vehicles_it_could_be_checked() -> None:
    rows = [*pair(0.02, factor=1.01), row_of("once", 1, 100.0, 2.0)]
    found = documented(rows)
    assert found.sentences[0] == "No change found in 1 of 2 vehicles; not enough data for the other."
    assert "Fly the same maneuvers again with it" in " ".join(found.sentences)
    assert "1 of 2 quantities could be checked" in found.sentences[1]
    assert any("once: only 1 flight" in sentence for sentence in found.sentences)


def test_a_quantity_that_is_near_zero_in_some_flights_is_counted_once() -> None:
    rows = [*pair(0.02, factor=1.01), row_of("quad", 3, 1.0, 2.0)]
    found = documented(rows)
    assert len(found.verdicts[0].numbers) == 2
    assert (found.checked.numbers, found.checked.of_numbers) == (1, 1)
    assert "1 of 1 quantity could be checked" in found.sentences[1]


def test_two_logs_are_compared_as_compare_does() -> None:
    """The same numbers, the same verdict, whatever their errors."""
    rng = np.random.default_rng(4)
    said = set()
    for _ in range(60):
        share = float(10.0 ** rng.uniform(-2.0, -0.4))
        rows = pair(share, factor=float(np.exp(rng.normal(0.0, 0.2))))
        before, after = [(row.value, row.std) for row in rows]
        (other,) = differences([("L_roll", before, after)])
        (one,) = verdicts_of(analyze(rows))
        assert one.verdict == other.verdict
        assert one.detectable["rate.roll", "L_roll"] == pytest.approx(other.detectable_share)
        said.add(one.verdict)
    assert said == {"changed", "unchanged", "undecided"}


def test_false_alarms_of_two_and_three_flights_stay_below_5_percent() -> None:
    """Estimates that state their errors truly, of vehicles that do not change; a change of 20 % is not overlooked."""
    rng = np.random.default_rng(0)
    for flights in (2, 3):
        alarms, found = 0, 0
        for _ in range(150):
            values = 100.0 * np.exp(0.04 * rng.standard_normal((1, flights)))
            alarms += bool(analyze(table_of(values, 4.0, std_random=1.0)).changed)
            values[:, -1] *= 1.3
            found += bool(analyze(table_of(values, 4.0, std_random=1.0)).changed)
        assert alarms <= 0.05 * 150 + 2.0 * np.sqrt(150 * 0.05)
        assert found >= 0.8 * 150


def test_scatter_beyond_what_is_stated_counts_once_it_is_seen() -> None:
    rng = np.random.default_rng(2)
    series = [(rng.normal(0.0, 3.0, 12), np.full(12, 0.5), np.full(12, 1.0)) for _ in range(8)]
    assert stated_scatter(series).spread.within == pytest.approx(3.0, rel=0.25)
    assert stated_scatter([(y[:2], r[:2], m[:2]) for y, r, m in series[:2]]).spread.within == 0.0


def test_measures_of_a_review_need_the_scatter_of_several_flights() -> None:
    rows = [replace(row, model=REVIEW, parameter="noise.gyro_rms") for row in pair(0.01)]
    found = documented(rows)
    assert found.verdicts[0].verdict == "undecided"
    assert "scatter" in found.verdicts[0].why


def test_a_range_of_numbers_of_one_sign_keeps_it() -> None:
    rng = np.random.default_rng(1)
    values, std = 0.005 * np.exp(rng.normal(0.0, 1.5, 12)), np.full(12, 1e-4)
    plain = population(values, std, np.arange(12), unit="s")
    kept = population(values, std, np.arange(12), unit="s", scale=Scale(True, 1.0))
    assert plain.low is not None
    assert kept.low is not None
    assert plain.low < 0.0 < kept.low
    rows = [row_of(f"v{k}", 1, value, 1e-4, parameter="tau_roll", unit="s") for k, value in enumerate(values)]
    of_fleet = documented(rows).population["rate.roll"]["tau_roll"]
    assert of_fleet.scale == "log"
    assert of_fleet.normal is not None
    assert of_fleet.normal[0] > 0.0


def test_negative_control_power_stays_negative() -> None:
    rows = [row_of(f"v{k}", 1, -value, 3.0, parameter="Z_thrust") for k, value in enumerate((9.0, 12.0, 15.0, 40.0))]
    normal = documented(rows).population["rate.roll"]["Z_thrust"].normal
    assert normal is not None
    assert normal[1] < 0.0


def test_delays_beside_a_lag_and_alone_are_two_quantities() -> None:
    rows = [
        row_of("quad", 1, 0.005, 0.001, parameter="tau_yaw", basis="r from gyro"),
        row_of("quad", 2, 0.047, 0.003, parameter="tau_yaw", basis="without T_motor, r from gyro"),
    ]
    found = documented(rows)
    assert set(found.population["rate.roll"]) == {"tau_yaw", "tau_yaw (without T_motor)"}
    assert found.verdicts[0].why == "no quantity was measured in 2 flights"


def test_an_estimate_at_its_bound_is_compared_with_its_like_alone() -> None:
    """Damping of heave is −0.02 ± 0.03 of one flight and −0.9 ± 0.2 of the next: the bound, and no change."""
    rows = [row_of("quad", 1, -0.02, 0.03, parameter="Z_w"), row_of("quad", 2, -0.9, 0.2, parameter="Z_w")]
    assert not documented(rows).changes
    (one,) = differences([("Z_w", (-0.02, 0.03), (-0.9, 0.2))])
    assert one.verdict == "undecided"


def test_a_folder_of_several_vehicles_is_taken_apart_first() -> None:
    rows = [
        row_of("logs", 1, 100.0, autopilot="PX4", frame="quad X"),
        row_of("logs", 2, 290.0, autopilot="ArduPilot", frame="quad X"),
        row_of("logs", 3, 290.0, autopilot="ArduPilot", frame="hexa X"),
    ]
    found = documented(rows)
    assert found.vehicles == 3
    assert not found.changes
    assert any(sentence.startswith("logs has logs of 3 vehicles") for sentence in found.sentences)
    kept, several = separated(rows)
    assert [row.vehicle for row in kept] == ["logs (PX4)", "logs (ArduPilot, quad X)", "logs (ArduPilot, hexa X)"]
    assert separated(kept) == (kept, ())
    assert several[0].name == "logs"


def test_what_a_log_leaves_out_makes_no_vehicle() -> None:
    rows = [row_of("logs", 1, 100.0, autopilot="PX4", frame="quad X"), row_of("logs", 2, 100.0, autopilot="PX4")]
    assert separated(rows) == (rows, ())


def test_other_gains_are_remarked_on() -> None:
    gains = {"quad-1": {"P": 0.15, "D": 0.003}, "quad-2": {"P": 0.2, "D": 0.003}}
    found = documented(pair(0.02, factor=1.01), gains=gains)
    (one,) = found.other_gains
    assert (one.log, one.at_flight, one.gains) == ("quad-002.ulg", 2, {"P": (0.15, 0.2)})
    assert any("Check that these logs are of one vehicle" in sentence for sentence in found.sentences)


def test_the_mean_of_one_flight_is_its_value_under_its_own_name() -> None:
    """Also of what keeps its sign, which is compared by logarithms, and of what may be zero."""
    rows = [
        row_of("quad", 1, value, std, parameter=name)
        for name, value, std in (("L_roll", 113.47, 1.09), ("tau_roll", 0.0033, 0.0028))
    ]
    means = documented(rows).population["rate.roll"]
    assert means["L_roll"].mean.value == pytest.approx(113.47, rel=1e-14)
    assert means["tau_roll"].mean.value == pytest.approx(0.0033, rel=1e-14)
