"""The trim of a model: hover stays zero, slow flight is measured, and what is given counts."""

from __future__ import annotations

import numpy as np
import pytest
from tests.unit.identifying.small_logs import DURATION_S, log, sweeps, topic

from rotorid.data.record import Maneuver
from rotorid.errors import ModelError
from rotorid.flights.flights import Flight
from rotorid.identifying.scope import trimmed
from rotorid.models.library import library_model, rate_model
from rotorid.settings.identifying import IdentifySettings

STRUCTURE = library_model("hover.longitudinal")
RATE_HZ = 50.0
SWAY = np.sin(2.0 * np.pi * np.arange(0.0, DURATION_S, 1.0 / RATE_HZ))
"""Whole periods: a mean of zero."""


def test_hover_stays_zero() -> None:
    record = log(topic("log", RATE_HZ, {"u": 0.4 + SWAY, "w": -0.4, "theta": 0.04 + 0.2 * SWAY, "phi": -0.04}))
    trim = trimmed(STRUCTURE, sweeps(record, ["pitch"]).fitted, IdentifySettings())
    assert trim.structure is STRUCTURE
    assert trim.findings == ()


def test_slow_flight_is_the_mean_over_the_maneuvers_with_a_remark() -> None:
    record = log(topic("log", RATE_HZ, {"u": 2.0 + SWAY, "w": 0.1, "theta": -0.1 + 0.2 * SWAY, "phi": 0.0}))
    trim = trimmed(STRUCTURE, sweeps(record, ["pitch"]).fitted, IdentifySettings())
    constants = trim.structure.constants
    assert constants["U0"] == pytest.approx(2.0, abs=1e-12)
    assert constants["theta0"] == pytest.approx(-0.1, abs=1e-12)
    # At speed everything counts: W0 is what lean makes of U0.
    assert constants["W0"] == pytest.approx(0.1, abs=1e-12)
    assert (constants["phi0"], constants["g"]) == (0.0, STRUCTURE.constants["g"])
    (finding,) = trim.findings
    assert (finding.kind, finding.severity) == ("trim", "info")
    assert "U0 = 2.00 m/s" in finding.message
    assert "theta0 = -5.7°" in finding.message
    assert set(finding.numbers) == {"U0", "W0", "theta0"}


def test_the_trim_reaches_the_matrices() -> None:
    record = log(topic("log", RATE_HZ, {"u": 2.0, "theta": -0.1}))
    moved = trimmed(STRUCTURE, sweeps(record, ["pitch"]).fitted, IdentifySettings()).structure
    before, after = (one.matrices(one.parameters.values).F for one in (STRUCTURE, moved))
    w, q, u, theta = (STRUCTURE.states.index(name) for name in ("w", "q", "u", "theta"))
    assert after[w, q] - before[w, q] == pytest.approx(2.0)
    assert after[u, theta] == pytest.approx(before[u, theta] * np.cos(0.1))


def test_means_are_over_all_maneuvers_by_their_samples_and_nothing_else() -> None:
    values = np.where(np.arange(SWAY.size) < SWAY.size // 2, 1.0, 9.0)
    values[3] = np.nan
    record = log(topic("log", RATE_HZ, {"u": values}))
    other = log(topic("log", RATE_HZ, {"u": 4.0}), name="second.csv")

    def flown(start_s: float, stop_s: float) -> Maneuver:
        return Maneuver(axis="pitch", kind="sweep", start_s=start_s, stop_s=stop_s, origin="found")

    trim = trimmed(STRUCTURE, [Flight(record, flown(0.0, 4.0)), Flight(other, flown(0.0, 2.0))], IdentifySettings())
    # 201 samples of which one is none, and 101.
    assert trim.structure.constants["U0"] == pytest.approx((200 * 1.0 + 101 * 4.0) / 301, rel=1e-12)


def test_velocities_over_the_earth_are_turned_into_the_body() -> None:
    lean = -0.2
    channels = {
        "velocity_north": 0.0,
        "velocity_east": 4.0,
        "velocity_down": 0.0,
        "phi": 0.0,
        "theta": lean,
        "psi": np.pi / 2,
    }
    record = log(topic("log", RATE_HZ, channels))
    constants = trimmed(STRUCTURE, sweeps(record, ["pitch"]).fitted, IdentifySettings()).structure.constants
    assert constants["U0"] == pytest.approx(4.0 * np.cos(lean), abs=1e-9)
    assert constants["W0"] == pytest.approx(4.0 * np.sin(lean), abs=1e-9)
    assert constants["theta0"] == pytest.approx(lean, abs=1e-12)


def test_given_constants_win_and_are_not_remarked_on() -> None:
    record = log(topic("log", RATE_HZ, {"u": 2.0, "theta": -0.1}))
    settings = IdentifySettings(constants={"U0": 0.0, "theta0": -0.2, "z_imu": 0.03})
    trim = trimmed(STRUCTURE, sweeps(record, ["pitch"]).fitted, settings)
    assert {name: trim.structure.constants[name] for name in settings.constants} == settings.constants
    assert trim.findings == ()


def test_records_without_speed_are_taken_as_hover() -> None:
    record = log(topic("log", RATE_HZ, {"q": SWAY}))
    assert trimmed(STRUCTURE, sweeps(record, ["pitch"]).fitted, IdentifySettings()).structure is STRUCTURE


def test_a_model_without_trim_stays_as_it_is() -> None:
    record = log(topic("log", RATE_HZ, {"u": 5.0}))
    structure = rate_model("rate.pitch")
    assert trimmed(structure, sweeps(record, ["pitch"]).fitted, IdentifySettings()).structure is structure


def test_an_unknown_constant_gets_the_nearest_one() -> None:
    record = log(topic("log", RATE_HZ, {"u": 0.0}))
    with pytest.raises(ModelError, match=r"no constant 'theta_0'.*did you mean theta0"):
        trimmed(STRUCTURE, sweeps(record, ["pitch"]).fitted, IdentifySettings(constants={"theta_0": 0.1}))


def test_maneuvers_at_several_speeds_are_warned_about() -> None:
    slow, fast = (log(topic("log", RATE_HZ, {"u": speed}), name=f"at-{speed:g}.csv") for speed in (0.0, 8.0))
    flights = [*sweeps(slow, ["pitch"]).fitted, *sweeps(fast, ["pitch"]).fitted]
    trim = trimmed(STRUCTURE, flights, IdentifySettings())
    assert trim.structure.constants["U0"] == pytest.approx(4.0)
    assert [finding.kind for finding in trim.findings] == ["trim", "several_trims"]
    assert trim.findings[1].numbers == {"lowest_m_s": 0.0, "highest_m_s": 8.0}
    given = trimmed(STRUCTURE, flights, IdentifySettings(constants={"U0": 4.0}))
    assert "several_trims" not in [finding.kind for finding in given.findings]
