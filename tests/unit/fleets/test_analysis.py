"""Populations, steps, odd flights, drifts and groups of numbers whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import optimize, stats
from tests.fleet_logs import table_of

from rotorid.errors import UsageError
from rotorid.fleets import analyze, population
from rotorid.fleets.changes import Spread, first_step, odd_flights, within_by_neighbors
from rotorid.fleets.populations import random_effects
from rotorid.uncertainty.differences import discoveries


def fleet_of(
    seed: int, *, vehicles: int = 20, flights: int = 20, between: float = 3.0, within: float = 1.0
) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return 100.0 + rng.normal(0, between, (vehicles, 1)) + rng.normal(0, within, (vehicles, flights))


def test_random_effects_are_those_of_the_likelihood_written_out() -> None:
    rng = np.random.default_rng(3)
    who = np.repeat(np.arange(6), [3, 5, 2, 7, 4, 4])
    s = rng.uniform(0.1, 0.4, who.size)
    y = 2.0 + rng.normal(0, 0.5, 6)[who] + rng.normal(0, 0.2, who.size) + rng.normal(0, s)
    x = np.column_stack([np.ones(who.size), rng.integers(0, 2, who.size)])

    def cost(deviations: np.ndarray) -> float:
        v = np.diag(deviations[1] ** 2 + s**2) + deviations[0] ** 2 * (who[:, None] == who)
        inverse = np.linalg.inv(v)
        information = x.T @ inverse @ x
        rest = y - x @ np.linalg.solve(information, x.T @ inverse @ y)
        return 0.5 * (np.linalg.slogdet(v)[1] + np.linalg.slogdet(information)[1] + rest @ inverse @ rest)

    direct = optimize.minimize(cost, [0.5, 0.2], method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-10})
    found = random_effects(y, s, who, design=x)
    assert found.between[0] == pytest.approx(direct.x[0], rel=1e-3)
    assert found.within[0] == pytest.approx(abs(direct.x[1]), rel=1e-2)


def test_without_stated_errors_they_are_those_of_a_balanced_analysis_of_variance() -> None:
    y = fleet_of(5, vehicles=8, flights=10)
    found = random_effects(y.ravel(), np.zeros(80), np.repeat(np.arange(8), 10))
    within = y.var(axis=1, ddof=1).mean()
    between = y.mean(axis=1).var(ddof=1) - within / 10
    assert found.within[0] == pytest.approx(np.sqrt(within), rel=1e-3)
    assert found.between[0] == pytest.approx(np.sqrt(between), rel=1e-3)


@pytest.mark.slow
def test_intervals_hold_over_40_fleets() -> None:
    inside = np.zeros(4)
    for seed in range(40):
        y = fleet_of(seed).ravel()
        found = population(y, np.full(400, 0.3), np.repeat(np.arange(20), 20), unit="1")
        new = 100.0 + np.random.default_rng([seed, 1]).normal(0, np.hypot(3.0, 0.95), 500)
        assert found.between is not None
        assert found.within is not None
        inside += [
            found.mean.lower <= 100.0 <= found.mean.upper,
            found.between.lower <= 3.0 <= found.between.upper,
            found.within.lower <= np.sqrt(1 - 0.3**2) <= found.within.upper,
            np.mean((found.low < new) & (new < found.high)),
        ]
    assert (inside / 40 >= 0.85).all(), inside / 40


@pytest.mark.parametrize("flights", [1, 2, 3])
def test_few_flights_have_a_mean_and_no_normal_range(flights: int) -> None:
    found = population(np.arange(flights) + 5.0, np.full(flights, 0.1), np.zeros(flights), unit="1")
    assert found.between is None
    assert (found.low, found.high) == (None, None)
    assert found.mean.lower < found.mean.value < found.mean.upper


def test_no_flight_is_refused() -> None:
    with pytest.raises(UsageError, match="no values"):
        population([], [], [], unit="1")


def test_spread_within_is_blind_to_steps_and_odd_flights() -> None:
    y = fleet_of(1)
    y[3, 10:] -= 20.0
    y[5, 4] += 50.0
    assert within_by_neighbors([(one, np.zeros(20)) for one in y]).within == pytest.approx(1.0, abs=0.12)


def test_a_series_without_a_step_seldom_looks_like_one() -> None:
    rng = np.random.default_rng(0)
    p = [first_step(rng.normal(0, 1.0, 20), np.full(20, 1.0), Spread(0.0, 1e6)) for _ in range(1000)]
    assert np.mean(np.array(p) < 0.05) <= 0.05


def test_the_first_flight_after_a_step_is_not_odd() -> None:
    y = np.r_[np.zeros(8), np.full(8, 10.0)] + np.random.default_rng(0).normal(0, 0.1, 16)
    assert odd_flights(y, np.full(16, 0.1), Spread(0.0, 1e6)).min() > 1e-3


def test_discoveries_are_those_of_scipy() -> None:
    p = np.random.default_rng(0).uniform(0, 1, 100) ** 4
    assert (discoveries(p) == (stats.false_discovery_control(p) <= 0.05)).all()


def test_a_step_is_found_with_its_size_and_nothing_else() -> None:
    y = fleet_of(2)
    y[6, 11:] *= 0.92
    told = analyze(table_of(y))
    (one,) = told.changed
    assert one.vehicle == "v06"
    assert [change.at_flight for change in one.changes] == [12]
    assert one.changes[0].ratio == pytest.approx(0.92, abs=0.01)
    assert not any(history.drift or history.odd for history in told.histories)


def test_a_step_is_found_after_three_flights() -> None:
    y = fleet_of(2)
    y[6, 17:] *= 0.92
    (one,) = analyze(table_of(y)).changed
    assert one.changes[0].at_flight == 18


def test_an_odd_flight_is_no_step() -> None:
    y = fleet_of(4)
    y[2, 7] += 12.0
    told = analyze(table_of(y))
    assert not told.changed
    assert [(one.vehicle, [odd.flight for odd in one.odd]) for one in told.histories if one.odd] == [("v02", [8])]


def test_a_slow_change_is_a_drift() -> None:
    y = fleet_of(4)
    y[2] -= 0.5 * np.arange(20)
    told = analyze(table_of(y))
    (one,) = [history for history in told.histories if history.drift]
    assert one.vehicle == "v02"
    assert one.drift is not None
    assert one.drift.slope.value == pytest.approx(-0.5, abs=3.0 * one.drift.slope.std)


def test_two_odd_vehicles_are_found_and_are_not_in_the_population() -> None:
    y = fleet_of(7)
    plain = analyze(table_of(y)).populations["rate.roll", "L_roll"]
    y[1] += 30.0
    y[9] += 30.0
    told = analyze(table_of(y))
    assert {one.vehicle for one in told.histories if one.odd_vehicle is not None} == {"v01", "v09"}
    assert told.populations["rate.roll", "L_roll"].vehicles == 18
    assert told.populations["rate.roll", "L_roll"].high == pytest.approx(plain.high, abs=1.5)


@pytest.mark.slow
def test_false_alarms_over_60_fleets_stay_below_5_percent() -> None:
    alarms = 0
    for seed in range(60):
        told = analyze(table_of(fleet_of(seed, vehicles=10, flights=12)))
        alarms += sum(bool(one.changes or one.drift) for one in told.histories)
    assert alarms <= 0.05 * 600, alarms


def test_before_and_after_a_tune_differ_by_what_was_changed() -> None:
    y = fleet_of(8, vehicles=6)
    y[:, 10:] += 5.0
    rows = table_of(y)
    groups = {row.log_sha256: "before" if int(row.log[4:7]) <= 10 else "after" for row in rows}
    (one,) = analyze(rows, groups=groups).differences
    assert (one.group, one.against, one.found) == ("before", "after", True)
    assert one.difference.lower <= -5.0 <= one.difference.upper
    assert one.difference.std < 0.5


def test_groups_of_alike_vehicles_cannot_be_told_apart() -> None:
    rows = table_of(fleet_of(9, vehicles=8))
    groups = {row.log_sha256: "a" if row.vehicle < "v04" else "b" for row in rows}
    (one,) = analyze(rows, groups=groups).differences
    assert not one.found


@pytest.mark.parametrize(
    ("names", "factors", "usual"),
    [
        (("L_roll", "M_pitch"), (0.92, 0.92), "propellers"),
        (("L_roll", "M_pitch"), (0.85, 1.0), "inertia"),
        (("L_roll", "I_xx"), (0.85, 1.15), "inertia"),
        (("T_motor",), (1.2,), "ESC"),
    ],
)
def test_a_pattern_says_what_usually_does_that(names: tuple[str, ...], factors: tuple[float, ...], usual: str) -> None:
    rows = []
    for k, (name, factor) in enumerate(zip(names, factors, strict=True)):
        y = fleet_of(20 + k)
        y[4, 9:] *= factor
        rows += table_of(y, parameter=name)
    if 1.0 in factors:
        factors = tuple(one for one in factors if one != 1.0)
    (cause,) = analyze(rows).causes
    assert cause.at_flight == 10
    assert usual in cause.usual or (len(factors) == 1 and "propellers" in cause.usual)


def test_numbers_of_two_units_have_no_mean() -> None:
    """Inertia is in kg m², in m² or in m, by what is known of mass and arm: no vehicle changed where an arm is lost."""
    rng = np.random.default_rng(3)
    known, unknown = rng.normal(0.010, 1e-4, (3, 6)), rng.normal(0.040, 4e-4, (2, 6))
    rows = table_of(known, std=1e-4, parameter="I_xx", unit="m^2")
    rows += table_of(unknown, std=4e-4, parameter="I_xx", unit="m")
    told = analyze(rows)
    assert {name: found.mean.unit for (_, name), found in told.populations.items()} == {"I_xx": "m^2", "I_xx in m": "m"}
    assert told.populations["rate.roll", "I_xx"].mean.value == pytest.approx(0.010, rel=0.02)
    assert told.changed == ()


def test_values_without_an_error_say_nothing() -> None:
    rows = table_of([[1.0, 2.0, 3.0]], std=float("nan"))
    assert analyze(rows).histories == ()


def test_the_order_of_rows_changes_nothing() -> None:
    rows = table_of(fleet_of(3))
    one, other = analyze(rows), analyze(rows[::-1])
    assert one.populations == other.populations


def test_a_normal_range_spans_both_spreads_and_the_error_of_the_mean() -> None:
    """Twenty vehicles that differ by 3 and scatter by 1: 95 % of further flights of further vehicles."""
    y = fleet_of(11)
    found = population(y.ravel(), np.full(400, 1e-3), np.repeat(np.arange(20), 20), unit="1")
    assert found.low is not None
    assert found.high is not None
    between, within = y.mean(axis=1).std(ddof=1), np.sqrt(y.var(axis=1, ddof=1).mean())
    half = stats.t.ppf(0.975, 19) * np.sqrt(between**2 * (1.0 + 1.0 / 20.0) + within**2)
    assert found.high - found.low == pytest.approx(2.0 * half, rel=0.02)


def test_a_vehicle_that_flew_alone_has_the_range_of_its_own_flights() -> None:
    """The spread between vehicles is not known of one, and does not widen what its own flights lie in."""
    y = np.random.default_rng(1).normal(10.0, 1.0, 20)
    found = population(y, np.full(20, 1e-3), np.zeros(20), unit="1")
    assert found.between is None
    assert found.low is not None
    assert found.high is not None
    assert found.mean.std == pytest.approx(y.std(ddof=1) / np.sqrt(20.0), rel=0.01)
    half = stats.t.ppf(0.975, 19) * y.std(ddof=1) * np.sqrt(1.0 + 1.0 / 20.0)
    assert found.high - found.low == pytest.approx(2.0 * half, rel=0.01)


def test_among_many_flights_one_of_them_lies_far_off_by_chance() -> None:
    """The probability of a flight is that of the oddest of all: without a change, 5 % of the series have one."""
    rng = np.random.default_rng(6)
    least = [odd_flights(rng.normal(0, 1.0, 30), np.ones(30), Spread(0.0, 1e6)).min() for _ in range(400)]
    assert np.mean(np.array(least) < 0.05) <= 0.05
    assert np.mean(np.array(least) < 0.9) > 0.2


def test_of_what_is_called_changed_a_twentieth_may_be_false() -> None:
    """Of 20 tests the smallest must be below 0.25 %, the ten smallest below 2.5 %."""
    assert not discoveries(np.r_[0.004, np.full(19, 0.9)]).any()
    assert discoveries(np.r_[0.002, np.full(19, 0.9)]).sum() == 1
    assert discoveries(np.r_[np.full(10, 0.02), np.full(10, 0.9)]).sum() == 10
    assert not discoveries(np.r_[np.full(10, 0.03), np.full(10, 0.9)]).any()
