"""Margins of ordinary flights, against the simulator's own linearization and what was true along each flight."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from tests.twins.everyday_flights import (
    PERIOD_S,
    Case,
    Truth,
    _lines_of,
    cases,
    craft_of,
    fly,
    harmonics,
    multisine_input,
    record_of,
    smooth_at,
    truth_of,
)

from rotorid.autopilots.filters import butterworth_low_pass
from rotorid.data.flight_plan import FlightPlan
from rotorid.data.record import Channel, FlightRecord, Source, Topic
from rotorid.flights.whole_flights import flown
from rotorid.loops.rate_loops import NUMBERS
from rotorid.models.autopilots.reading import axis_controller
from rotorid.models.controller import RateController
from rotorid.reviewing.margins import margins
from rotorid.reviewing.missing import Unavailable
from rotorid.reviewing.values import MarginReview
from rotorid.simulation.hover_flight import OUTPUTS
from rotorid.simulation.linearization import linearize
from rotorid.simulation.multirotor import PERFECT
from rotorid.simulation.multirotor_flight import Aircraft, fly_multirotor


def parameters_of(craft: Aircraft) -> dict[str, float]:
    """The gains that flew, as the autopilot would name them."""
    rates, angle = craft.autopilot.rates, craft.autopilot.angle_1_s
    if craft.autopilot.kind == "ardupilot":
        found = {"SCHED_LOOP_RATE": craft.autopilot.rate_hz}
        for i, name in enumerate(("RLL", "PIT", "YAW")):
            prefix = f"ATC_RAT_{name}"
            found |= {
                f"{prefix}_P": rates.proportional[i],
                f"{prefix}_I": rates.integral[i],
                f"{prefix}_D": rates.derivative[i],
                f"{prefix}_FLTD": rates.derivative_cutoff_hz[i],
                f"{prefix}_FLTE": rates.error_cutoff_hz[i],
                f"{prefix}_FLTT": rates.target_cutoff_hz[i],
                f"ATC_ANG_{name}_P": angle[i],
            }
        return found
    found = {"IMU_GYRO_RATEMAX": craft.autopilot.rate_hz, "IMU_DGYRO_CUTOFF": rates.derivative_cutoff_hz[0]}
    for i, name in enumerate(("ROLL", "PITCH", "YAW")):
        found |= {
            f"MC_{name}RATE_P": rates.proportional[i],
            f"MC_{name}RATE_I": rates.integral[i],
            f"MC_{name}RATE_D": rates.derivative[i],
            f"MC_{name}_TQ_CUTOFF": rates.command_cutoff_hz[i],
            f"MC_{name}_P": angle[i],
        }
    return found


def as_simulated(controller: RateController) -> RateController:
    """The controller of the simulator, which adds the integral late and reads the angle of the same tick."""
    return replace(controller, late_integral=True, late_angle=False)


def roll_controller(craft: Aircraft) -> RateController:
    found = axis_controller(parameters_of(craft), "roll")
    assert found is not None
    return as_simulated(found.controller)


@pytest.mark.parametrize(("vehicle", "gain"), [("px4_quad", 1.0), ("ardupilot_quad", 0.5)])
def test_the_loop_of_logged_gains_is_that_of_the_simulator(vehicle: str, gain: float) -> None:
    craft = replace(craft_of(vehicle, gain), sensors=PERFECT)
    autopilot = craft.autopilot
    # Loops of velocity, which no rate controller knows, add 4 % at 10 rad/s.
    autopilot = replace(autopilot, guidance=replace(autopilot.guidance, hold_velocity=False))
    sine = multisine_input(autopilot.rate_hz, 60.0)
    sine = replace(sine, entry="command", values=0.4 * sine.values, amplitude=0.4 * sine.amplitude)
    plan = FlightPlan(name="lines", inputs=(sine,), trim_s=0.0)
    flight = fly_multirotor(replace(craft, autopilot=autopilot), plan, seed=0)
    rate, command, excitation = (_lines_of(flight, name) for name in ("p", "roll_command", "roll_excitation"))
    omega = 2.0 * np.pi / PERIOD_S * harmonics()
    gyro = butterworth_low_pass(autopilot.gyro_cutoff_hz, autopilot.rate_hz).response(omega)
    motion = linearize(craft.vehicle, autopilot).response(omega)[OUTPUTS.index("p"), 0]
    linear = motion * gyro * roll_controller(craft).response(omega, gyro) / gyro
    flown_loop = (excitation - command) / command
    ratio = (flown_loop / linear)[(omega >= 10.0) & (omega <= 100.0)]
    assert np.abs(np.abs(ratio) - 1.0).max() < 0.01
    assert np.degrees(np.abs(np.angle(ratio))).max() < 0.5
    assert rate.size == omega.size


def true_margins(case: Case, truth: Truth) -> dict[str, float]:
    """Margins of the plant along a flight and the controller of the simulator."""
    omega = np.geomspace(truth.omega_rad_s[0], truth.omega_rad_s[-1], 20_000)
    controller = roll_controller(craft_of(case.vehicle, case.gain)).rate_loop
    loop = smooth_at(truth.omega_rad_s, truth.plant, omega) * controller.response(omega)
    size, distance = np.abs(loop), np.abs(1.0 + loop)
    last = int(np.flatnonzero((size[:-1] > 1.0) & (size[1:] <= 1.0))[-1])
    turns = np.flatnonzero((loop.imag[:-1] < 0.0) & (loop.imag[1:] >= 0.0) & (loop.real[:-1] < 0.0))
    turns = turns[size[turns] < 1.0]
    margin = math.remainder(float(np.angle(loop[last])) + math.pi, 2.0 * math.pi)
    found = {
        "crossover_rad_s": float(omega[last]),
        "phase_margin_deg": math.degrees(margin),
        "delay_margin_s": margin % (2.0 * math.pi) / float(omega[last]),
        "sensitivity_peak": float(1.0 / distance.min()),
        "disturbance_rejection_rad_s": float(omega[int((distance < 10.0**0.15).argmax())]),
    }
    return found | ({"gain_margin_db": float(-20.0 * np.log10(size[turns[0]]))} if turns.size else {})


PLANNED: Mapping[str, tuple[float, float]] = {
    "crossover_rad_s": (0.0, 0.05),
    "phase_margin_deg": (3.0, 0.0),
    "gain_margin_db": (1.0, 0.0),
    "sensitivity_peak": (0.0, 0.10),
    "disturbance_rejection_rad_s": (0.0, 0.05),
}
"""What a number may be off by: so much, or such a share of it."""


def logged(case: Case, *, axes: tuple[str, ...] = ("roll",)) -> FlightRecord:
    """The flight of a case with the gains that flew; of some axes only."""
    craft = craft_of(case.vehicle, case.gain)
    record = record_of(case, fly(case))
    format_ = "ArduPilot DataFlash" if craft.autopilot.kind == "ardupilot" else "PX4 ULog"
    dropped = {f"{axis}_command" for axis in ("roll", "pitch", "yaw") if axis not in axes}
    return replace(
        without(record, dropped),
        parameters=parameters_of(craft),
        source=Source(name="twin", format=format_, sha256=""),
    )


def without(record: FlightRecord, dropped: set[str]) -> FlightRecord:
    """A record without some channels."""
    topics = []
    for topic in record.topics:
        rows = [row for row, channel in enumerate(topic.channels) if channel.name not in dropped]
        if rows:
            channels = tuple(topic.channels[row] for row in rows)
            topics.append(Topic(name=topic.name, time_s=topic.time_s, channels=channels, values=topic.values[rows]))
    return replace(record, topics=tuple(topics))


def reviewed(record: FlightRecord) -> tuple[MarginReview | None, tuple[Unavailable, ...]]:
    """Margins of roll, and what of them is untold."""
    found, untold = margins(flown(record))
    return found.get("roll"), tuple(one for one in untold if one.what.startswith("margins.roll"))


PX4 = Case(vehicle="px4_quad", gain=1.0, wind_m_s=3.0, level=0.5, duration_s=60.0, seed=7)


@pytest.fixture(scope="module")
def px4() -> FlightRecord:
    return logged(PX4)


def test_an_everyday_flight_tells_all_margins(px4: FlightRecord) -> None:
    found, untold = reviewed(px4)
    assert found is not None
    assert not untold
    assert set(found.numbers) == set(NUMBERS)
    assert found.explained is not None
    assert found.explained > 0.98
    truth = true_margins(PX4, truth_of(PX4))
    for name, (absolute, share) in PLANNED.items():
        number = found.numbers[name]
        assert number.lower <= truth[name] <= number.upper or abs(number.value - truth[name]) <= max(
            absolute, share * truth[name]
        ), name
    assert found.settings is not None
    assert found.settings.described()["gains"]["MC_ROLLRATE_P"] == px4.parameters["MC_ROLLRATE_P"]


def test_gains_that_did_not_fly_have_no_margins(px4: FlightRecord) -> None:
    for changes in ({"MC_ROLLRATE_P": 2.0}, {"MC_ROLLRATE_P": 0.4}, {"MC_ROLLRATE_D": 20.0}):
        wrong = {name: value * changes.get(name, 1.0) for name, value in px4.parameters.items()}
        found, untold = reviewed(replace(px4, parameters=wrong))
        assert found is None
        (only,) = untold
        assert only.what == "margins.roll"
        assert "the logged roll command" in only.why
        assert only.remedy


def test_what_is_missing_is_said(px4: FlightRecord) -> None:
    for record, words in (
        (replace(px4, parameters={}), "no known gains for the roll controller"),
        (without(px4, {"p"}), "contains no p"),
        (without(px4, {"roll_command"}), "contains no roll_command"),
    ):
        found, untold = reviewed(record)
        assert found is None
        assert [one.what for one in untold] == ["margins.roll"]
        assert words in untold[0].why
        assert untold[0].remedy


def test_without_a_set_point_the_stick_tells_and_nothing_is_checked(px4: FlightRecord) -> None:
    found, _ = reviewed(without(px4, {"p_setpoint", "phi_setpoint"}))
    assert found is not None
    assert found.instrument == "stick"
    assert not found.stick_idle
    assert found.explained is None
    assert [finding.kind for finding in found.findings] == ["controller_unchecked"]
    assert "phase_margin_deg" in found.numbers


def test_the_set_point_of_the_angle_checks_the_controller_where_that_of_the_rate_is_not_logged(
    px4: FlightRecord,
) -> None:
    found, _ = reviewed(without(px4, {"p_setpoint"}))
    assert found is not None
    assert found.explained is not None
    assert found.explained > 0.95
    assert found.findings == ()


def test_a_resting_stick_leaves_what_gusts_tell(px4: FlightRecord) -> None:
    resting = Case(vehicle="px4_quad", gain=1.0, wind_m_s=6.0, level=1e-6, duration_s=60.0, seed=8)
    found, untold = reviewed(logged(resting))
    # What gusts show is no test of a loop: a card does not count it.
    assert found is None or found.stick_idle
    told = {} if found is None else found.numbers
    assert not {"gain_margin_db", "sensitivity_peak", "disturbance_rejection_rad_s"} & set(told)
    assert untold
    # What gusts move holds feedback: with the error of a plant that the stick moved, the truth lies outside.
    truth = true_margins(resting, truth_of(replace(resting, level=0.25)))
    assert set(told) <= {"crossover_rad_s", "phase_margin_deg", "delay_margin_s"}
    for name, one in told.items():
        assert one.lower <= truth[name] <= one.upper, name
    assert px4.parameters


def test_a_slew_limiter_that_acted_is_a_finding(px4: FlightRecord) -> None:
    main = px4.topics[0]
    factor = np.where(np.arange(main.time_s.size) % 10 == 0, 0.6, 1.0)
    limited = Topic(
        name="PIDR",
        time_s=main.time_s,
        channels=(Channel(name="roll_slew_factor", unit="1"),),
        values=factor[None],
    )
    found, _ = reviewed(replace(px4, topics=(*px4.topics, limited)))
    assert found is not None
    (finding,) = found.findings
    assert (finding.kind, finding.severity) == ("moving_gains", "warning")
    assert finding.numbers["least"] == pytest.approx(0.6)
    assert finding.numbers["share"] == pytest.approx(0.1, abs=0.01)


def test_a_slow_log_says_how_slow(px4: FlightRecord) -> None:
    main, *rest = px4.topics
    slow = Topic(name=main.name, time_s=main.time_s[::10], channels=main.channels, values=main.values[:, ::10])
    found, untold = reviewed(replace(px4, topics=(slow, *rest)))
    assert found is None
    assert "25 Hz" in untold[0].why


@pytest.mark.slow
def test_the_study_of_ninety_six_flights() -> None:
    inside: dict[str, list[bool]] = {name: [] for name in PLANNED}
    good: dict[str, list[bool]] = {name: [] for name in PLANNED}
    flights = list(cases())
    for case in flights:
        found, _ = reviewed(logged(case))
        truth = true_margins(case, truth_of(case))
        for name, (absolute, share) in PLANNED.items():
            if found is None or name not in found.numbers or name not in truth:
                continue
            number = found.numbers[name]
            held = number.lower <= truth[name] <= number.upper
            inside[name].append(held)
            good[name].append(held or abs(number.value - truth[name]) <= max(absolute, share * truth[name]))
    least_told = {"phase_margin_deg": 0.95, "sensitivity_peak": 0.80, "gain_margin_db": 0.45}
    for name, share in least_told.items():
        assert len(good[name]) >= share * len(flights), name
    for name, kept in good.items():
        assert np.mean(kept) >= 0.95, name
