"""Plan, fly, identify for one's own model: a controller holds it, and its log gives its numbers back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.unit.exports.models import model

import rotorid
from rotorid.data.flight_plan import FlightPlan, PlannedInput
from rotorid.errors import UsageError
from rotorid.excitation.plan import planned
from rotorid.flying.flown_models import fly_plan
from rotorid.flying.model_logs import fly_under_control, model_logs, noise_of
from rotorid.io.tables.csv import write_csv
from rotorid.models.library import library_model, rate_model
from rotorid.results.model import IdentifiedModel
from rotorid.settings.flying import FlySettings

PITCH = {
    "M_pitch": 90.0,
    "M_q": -1.4,
    "M_u": 0.8,
    "X_q": 0.0,
    "X_u": -0.25,
    "z_imu": 0.0,
    "tau_pitch": 0.014,
    "tau_ax": 0.004,
    "T_motor": 0.04,
}


def airframe(name: str, values: Mapping[str, float], outputs: tuple[str, ...] = ()) -> IdentifiedModel:
    structure = rate_model(name) if name.startswith("rate.") else library_model(name)
    structure = structure.select(outputs=list(outputs)) if outputs else structure
    own = {key: values[key] for key in structure.parameters.names}
    return model(replace(structure, parameters=structure.parameters.with_values(own)), responses=False)


def sweep(axis: str, entry: str, amplitude: float, duration_s: float = 50.0) -> PlannedInput:
    return planned(  # type: ignore[call-arg]
        axis,  # type: ignore[arg-type]
        "logarithmic_sweep",
        start_s=4.0,
        amplitude=amplitude,
        duration_s=duration_s,
        sample_rate_hz=250.0,
        band_rad_s=(1.0, 60.0),
        entry=entry,  # type: ignore[arg-type]
        seed=1,
    )


def test_an_unstable_model_stays_near_hover_and_answers_as_it_is() -> None:
    """Responses between logged commands and outputs, by the phase of its sweep, are those of the model."""
    own = airframe("axis.pitch", PITCH, ("q", "ax"))
    assert (own.system.poles().real > 0.0).any()
    flight = fly_under_control(own, FlightPlan(name="one", inputs=(sweep("pitch", "command", 0.1),), trim_s=4.0))
    assert all(np.abs(row).max() < 20.0 for row in flight.outputs.values())
    # The motion ends at rest, so that its transform over the whole flight has no ends.
    u, *rows = (np.fft.rfft(row) for row in (flight.inputs["pitch_command"], *flight.outputs.values()))
    omega = 2.0 * np.pi * np.fft.rfftfreq(flight.time_s.size, flight.time_s[1])
    there = (omega > 3.0) & (omega < 50.0)
    exact = own.response(omega[there])
    for y, row in enumerate(rows):
        off = row[there] / u[there] / exact[y, 0] - 1.0
        assert np.median(np.abs(off)) < 0.01, (y, np.median(np.abs(off)))


@pytest.mark.parametrize("entry", [pytest.param("command", marks=pytest.mark.slow), "stick"])
def test_its_log_gives_its_numbers_back(entry: str, tmp_path: Path) -> None:
    own = airframe("axis.pitch", PITCH, ("q", "ax"))
    amplitude = 0.1 if entry == "command" else 0.5
    plan = FlightPlan(name="one", inputs=(sweep("pitch", entry, amplitude),), trim_s=4.0)
    (log,) = fly_plan(own, plan, settings=FlySettings(seed=3)).logs
    assert (log.file, log.seed, log.assumed) == ("flight.csv", 3, ("q", "ax"))
    assert ("pitch_excitation" if entry == "command" else "pitch_stick") in log.columns
    write_csv(tmp_path / "flight.csv", log.time_s, log.columns)
    found = rotorid.identify(tmp_path / "flight.csv", "axis.pitch", outputs=("q", "ax"))
    for name in ("M_pitch", "M_q", "M_u", "X_u", "tau_pitch", "T_motor"):
        std = found.parameters[name].std
        assert std is not None
        # Three deviations: six numbers of one flight.
        assert abs(found.parameters[name].value - PITCH[name]) < 3.0 * std, name


def test_runs_differ_by_their_noise_alone() -> None:
    own = airframe("rate.pitch", PITCH)
    plan = FlightPlan(name="one", inputs=(sweep("pitch", "command", 0.1, 10.0),))
    first, second = fly_plan(own, plan, runs=2).logs
    assert (first.file, second.file) == ("flight_1.csv", "flight_2.csv")
    assert np.array_equal(first.columns["pitch_command"], second.columns["pitch_command"])
    difference = first.columns["q"] - second.columns["q"]
    assert np.std(difference) == pytest.approx(np.sqrt(2.0) * first.noise["q"], rel=0.1)
    (again,) = fly_plan(own, plan).logs
    assert np.array_equal(again.columns["q"], first.columns["q"])


def test_noise_that_the_result_knows_is_that_of_the_log() -> None:
    own = airframe("rate.pitch", PITCH)
    own = replace(own, fit=replace(own.fit, noise={"q": 0.03}))
    noise, assumed = noise_of(own, 250.0)
    assert (noise, assumed) == ({"q": 0.03}, ())
    plan = FlightPlan(name="one", inputs=(sweep("pitch", "command", 0.1, 10.0),))
    flown = fly_plan(own, plan)
    assert not [finding for finding in flown.findings if finding.kind == "assumed_noise"]
    said = fly_plan(airframe("rate.pitch", PITCH), plan).findings
    assert [finding.message for finding in said if finding.kind == "assumed_noise"] == [
        "The result does not know the noise of its flight. That of usual sensors was assumed: q 0.005 rad/s."
    ]


def test_hover_is_logged_as_it_is_measured() -> None:
    """About trim in the model, with gravity and the throttle of hover in the log."""
    structure = library_model("hover.longitudinal").select(outputs=["q", "ax", "az"])
    own = model(structure, responses=False)
    flight = fly_under_control(own, FlightPlan(name="one", inputs=(sweep("thrust", "command", 0.05, 10.0),)))
    (log,) = model_logs(own, flight)
    assert np.mean(log.columns["az"][:500]) == pytest.approx(-9.80665, abs=0.02)
    assert log.columns["thrust_command"][0] == pytest.approx(0.5)


def test_a_heading_is_asked_for_as_a_rate() -> None:
    own = model(rate_model("rate.yaw"), responses=False)
    flight = fly_under_control(own, FlightPlan(name="one", inputs=(sweep("yaw", "attitude_setpoint", 0.2, 10.0),)))
    assert flight.left == ()
    assert set(flight.asked) == {"psi_setpoint"}
    assert np.abs(flight.outputs["r"]).max() > 0.1


def test_a_plan_that_moves_nothing_of_it_is_refused() -> None:
    own = airframe("rate.pitch", PITCH)
    roll = sweep("roll", "command", 0.1, 10.0)
    with pytest.raises(UsageError, match=r"moves roll by command, which rate\.pitch does not have"):
        fly_plan(own, FlightPlan(name="one", inputs=(roll,)))
    flown = fly_plan(own, FlightPlan(name="two", inputs=(roll, sweep("pitch", "command", 0.1, 10.0))))
    assert [finding.kind for finding in flown.findings] == ["unused_choice", "assumed_noise"]
