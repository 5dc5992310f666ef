"""The velocity loop by logged set-points: a known vehicle in gusts, its loop back within the stated intervals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.findings import remark
from rotorid.data.quantity import Quantity
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Status, Topic
from rotorid.errors import InsufficientDataError
from rotorid.models.autopilots.outer import outer_controller
from rotorid.proposing.axis import KnownAxis
from rotorid.proposing.check import _measured
from rotorid.proposing.outer import LoggedOuter
from rotorid.proposing.outer_flown import checked_by_flight, loop_by_setpoints, setpoints_match
from rotorid.tuning.loops import Gains, LoopFigures, frequency_grid, loop_figures
from rotorid.tuning.plant import uncertain_plant
from rotorid.typing import ComplexArray, FloatArray

PX4 = {
    "MPC_XY_VEL_P_ACC": 1.8,
    "MPC_XY_VEL_I_ACC": 0.4,
    "MPC_XY_VEL_D_ACC": 0.2,
    "MPC_XY_P": 0.95,
    "MPC_VELD_LP": 5.0,
}
STEP_S, SECONDS = 0.01, 120.0
DRAG, FAST_RAD_S, DAMPING = 0.3, 9.0, 0.8
"""Drag over mass, and the attitude loop, of second order."""


def way(
    rng: np.random.Generator, gusts_m_s2: float, stick_m_s: float, ahead: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Velocity that the stick asks for, acceleration that the loop asks for, velocity; PX4's law, step by step.

    ``ahead`` is the share of the path's own acceleration that is added.
    """
    count = round(SECONDS / STEP_S)
    steps = np.repeat(stick_m_s * rng.choice([-2.0, -1.0, 0.0, 1.0, 2.0], 41), round(3.0 / STEP_S))[:count]
    # A path whose acceleration does not jump, as PX4 limits its jerk.
    late, slope = 1.0 - np.exp(-STEP_S / 0.15), STEP_S / (STEP_S + 1.0 / (2.0 * np.pi * PX4["MPC_VELD_LP"]))
    columns = np.zeros((3, count))
    asked = wanted = place_asked = place = speed = before = sloped = integral = tilt = turn = gust = 0.0
    for k in range(count):
        wanted += late * ((steps[k] - asked) / 0.4 - wanted)
        asked += wanted * STEP_S
        place_asked += asked * STEP_S
        error = asked + PX4["MPC_XY_P"] * (place_asked - place) - speed
        sloped += slope * ((speed - before) / STEP_S - sloped)
        before = speed
        made = ahead * wanted + PX4["MPC_XY_VEL_P_ACC"] * error + integral - PX4["MPC_XY_VEL_D_ACC"] * sloped
        integral += PX4["MPC_XY_VEL_I_ACC"] * error * STEP_S
        columns[:, k] = asked, made, speed
        gust += -gust * STEP_S + gusts_m_s2 * np.sqrt(2.0 * STEP_S) * rng.standard_normal()
        turn += STEP_S * (FAST_RAD_S**2 * (made - tilt) - 2.0 * DAMPING * FAST_RAD_S * turn)
        tilt += STEP_S * turn
        speed += STEP_S * (tilt - DRAG * speed + gust)
        place += STEP_S * speed
    return columns[0], columns[1], columns[2]


def flight(gusts_m_s2: float = 0.2, seed: int = 0, stick_m_s: float = 1.0, ahead: float = 0.0) -> FlightRecord:
    """What PX4 logs of it: the path at 5 Hz, set-points and velocity at 10 Hz, each with stamps of its own."""
    rng = np.random.default_rng(seed)
    time_s = STEP_S * np.arange(round(SECONDS / STEP_S))
    north, east = (way(rng, gusts_m_s2, stick_m_s, ahead) for _ in range(2))
    topics = []
    for row, (name, step, first) in enumerate(
        (("velocity_{}_feedforward", 20, 3), ("acceleration_{}_setpoint", 10, 5), ("velocity_{}", 10, 0))
    ):
        names = [name.format(one) for one in ("north", "east")]
        channels = tuple(Channel(name=one, unit=STANDARD_UNITS[one]) for one in names)
        picked = slice(first, None, step)
        values = np.stack([north[row], east[row]])[:, picked]
        topics.append(Topic(name=name, time_s=time_s[picked], channels=channels, values=values))
    return FlightRecord(
        source=Source(name="flight.ulg", format="PX4 ULog", sha256=str(seed), firmware="PX4 1.16.0"),
        topics=tuple(topics),
        parameters=PX4,
        status=Status(in_air=((0.0, SECONDS),), flagged_in="twin", modes=(("position", 0.0, SECONDS),)),
    )


def controller(record: FlightRecord) -> LoggedOuter:
    found = outer_controller(record.parameters, "velocity", loop_rate_hz=1.0 / STEP_S)
    assert found is not None
    return LoggedOuter(axis="velocity", controller=found, record=record, loop_rate_hz=1.0 / STEP_S)


def truth(own: LoggedOuter) -> LoopFigures:
    omega = frequency_grid(own.controller.controller, "velocity")
    s = 1j * omega
    attitude = FAST_RAD_S**2 / (s**2 + 2.0 * DAMPING * FAST_RAD_S * s + FAST_RAD_S**2)
    whole = own.parts(omega).whole(Gains.of(own.controller.controller))
    return loop_figures(omega, (attitude / (s + DRAG) * whole)[None], from_rad_s=0.05)


def near(found: Quantity, true: float) -> float:
    """Deviation over the stated standard deviation."""
    return abs(found.value - true) / found.std


@pytest.mark.parametrize("gusts_m_s2", [0.0, 0.3])
def test_the_loop_is_the_one_that_flew_whatever_gusts_do(gusts_m_s2: float) -> None:
    """Also its interval is right: deviations of three flights, north and east together, are of its size."""
    misses = []
    for seed in range(3):
        record = flight(gusts_m_s2, seed)
        own = controller(record)
        found = loop_by_setpoints(own, Gains.of(own.controller.controller), [record])
        assert found is not None
        true, seen = truth(own), found.quantities
        assert seen["crossover_rad_s"].std < 0.05 * seen["crossover_rad_s"].value
        misses.append(near(seen["crossover_rad_s"], float(true.crossover_rad_s[0])))
        misses.append(near(seen["phase_margin_deg"], float(np.degrees(true.phase_margin_rad[0]))))
        if "sensitivity_peak" in seen:
            misses.append(near(seen["sensitivity_peak"], float(true.sensitivity_peak[0])))
    assert np.sqrt(np.mean(np.square(misses))) < 1.4
    assert max(misses) < 3.0


def test_a_flight_without_a_moved_stick_or_its_set_points_shows_nothing() -> None:
    record = flight(stick_m_s=0.05)
    own = controller(record)
    gains = Gains.of(own.controller.controller)
    assert loop_by_setpoints(own, gains, [record]) is None
    bare = replace(flight(), topics=flight().topics[1:])
    assert loop_by_setpoints(own, gains, [bare]) is None
    assert _measured("velocity", [bare]) == {}


@pytest.mark.parametrize(
    "modes",
    [(), (("altitude", 0.0, SECONDS),), tuple(("position", 20.0 * k, 20.0 * (k + 1)) for k in range(6))],
    ids=["unknown", "no velocity loop", "changes too often"],
)
def test_only_modes_whose_velocity_loop_flies_count(modes: tuple[tuple[str, float, float], ...]) -> None:
    """A change of the mode starts the path at the velocity that the vehicle has: that is feedback."""
    record = flight()
    assert _measured("velocity", [replace(record, status=replace(record.status, modes=modes))]) == {}


def test_the_check_of_a_second_flight_takes_what_was_measured() -> None:
    record = flight()
    seen = _measured("velocity", [record])
    assert near(seen["crossover_rad_s"], float(truth(controller(record)).crossover_rad_s[0])) < 3.0
    assert _measured("climb", [record]) == {}


def computed(record: FlightRecord, gain: float = 1.0) -> KnownAxis:
    """The loop by a plant that is the vehicle's own, or has another gain."""
    own = controller(record)
    omega = frequency_grid(own.controller.controller, "velocity")

    def response(w: FloatArray) -> ComplexArray:
        s = 1j * np.atleast_1d(w)
        attitude = FAST_RAD_S**2 / (s**2 + 2.0 * DAMPING * FAST_RAD_S * s + FAST_RAD_S**2)
        return np.asarray(gain * attitude / (s + DRAG))

    plant = uncertain_plant(response, None, band_rad_s=(0.03, 30.0), draws=40)
    parts = own.parts(omega)
    return KnownAxis(
        flown=own,
        plant=plant,
        omega_rad_s=omega,
        flown_parts=parts,
        then=None,
        controller=own.controller,
        parts=parts,
    )


UNCHECKED = remark("controller_unchecked", "velocity", "Whether the gains made its set-points was not checked.")


@pytest.mark.parametrize(("gain", "kinds"), [(1.0, []), (0.6, ["methods_disagree"])])
def test_a_computed_loop_is_compared_with_the_one_of_its_flight(gain: float, kinds: list[str]) -> None:
    found = checked_by_flight(computed(flight(), gain), [UNCHECKED])
    assert [one.kind for one in found] == kinds
    if kinds:
        assert "crossover" in found[0].message


def test_gains_without_logged_set_points_stay_unchecked_with_the_reason() -> None:
    still = replace(flight(), topics=flight().topics[1:])
    (found,) = checked_by_flight(computed(still), [UNCHECKED])
    assert found.kind == "controller_unchecked"
    assert found.message.endswith("was not checked: the log has no 30 s of moving velocity set-points.")


@pytest.mark.parametrize("ahead", [0.0, 1.0], ids=["", "the path adds its acceleration"])
@pytest.mark.parametrize("gusts_m_s2", [0.0, 0.3])
def test_gains_that_flew_made_the_set_points(gusts_m_s2: float, ahead: float) -> None:
    """S_ra = C_r S_rr - C_v S_rv, whatever the vehicle is and whatever gusts do."""
    record = flight(gusts_m_s2, ahead=ahead)
    found = setpoints_match(controller(record), [record])
    assert found.verdict == "made"
    assert found.factor is not None
    assert found.factor.slope == pytest.approx(1.0, abs=0.15 if ahead else 0.04)


@pytest.mark.parametrize("ahead", [0.0, 1.0], ids=["", "the path adds its acceleration"])
@pytest.mark.parametrize(
    ("name", "factor"),
    [
        ("MPC_XY_VEL_P_ACC", 0.5),
        ("MPC_XY_VEL_P_ACC", 2.0),
        ("MPC_XY_VEL_I_ACC", 3.0),
        ("MPC_XY_VEL_D_ACC", 4.0),
        ("MPC_XY_P", 0.5),
        ("MPC_XY_P", 2.0),
    ],
)
def test_gains_that_did_not_fly_are_found_and_not_believed(name: str, factor: float, ahead: float) -> None:
    """Measured and computed loop have the gains of the parameters, so that both agree on wrong ones."""
    record = replace(flight(ahead=ahead), parameters={**PX4, name: factor * PX4[name]})
    assert setpoints_match(controller(record), [record]).verdict == "not made"
    with pytest.raises(InsufficientDataError, match="did not make the logged acceleration set-points") as refused:
        checked_by_flight(computed(record), [UNCHECKED])
    assert [one.kind for one in refused.value.findings] == ["other_controller"]
