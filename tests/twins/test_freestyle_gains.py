"""Gains from flights by stick with chopped throttle: limits that sticks and chops make are no limit cycle.

Flown are full sticks and a throttle that is cut and pushed every few seconds, in gusts: motors are at a limit for up
to a fifth of the time, by roll, pitch and yaw commands for up to 12 %. No axis oscillates, and the plant by stick is
the vehicle's own, so that gains are proposed from it and hold on the exact plant.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.tuning_fleet import exact_plant
from tests.twins.oscillating_flights import CHANNELS, Case, fly, record_of

import rotorid
from rotorid.data.record import Channel, Topic
from rotorid.errors import InsufficientDataError
from rotorid.proposing import tune
from rotorid.proposing.flown_gains import require_room
from rotorid.signal.motors import motor_limits
from rotorid.tuning import loop_figures

VEHICLES = ("px4_quad", "ardupilot_quad", "betaflight_quad", "x500", "iris")
LOG_HZ = 400.0


def freestyle(vehicle: str, stick: float, seed: int, duration_s: float = 60.0) -> Case:
    """Full sticks and chops with the gains of the vehicle."""
    return Case(
        vehicle=vehicle,
        axes=("roll", "pitch"),
        wind_m_s=4.0,
        gusts_m_s=0.8,
        stick=stick,
        chops=True,
        duration_s=duration_s,
        seed=seed,
    )


def logged(case: Case) -> rotorid.FlightRecord:
    """The log of a flight, with the sticks that moved it."""
    record, flight = record_of(case, log_hz=LOG_HZ), fly(case)
    (topic,) = record.topics
    picked = np.searchsorted(flight.time_s, topic.time_s)
    sticks = [f"{axis}_stick" for axis in ("roll", "pitch", "yaw", "thrust")]
    moved = Topic(
        name="sticks",
        time_s=topic.time_s,
        channels=tuple(Channel(name=name, unit="1") for name in sticks),
        values=np.stack([flight.columns[name][picked] for name in sticks]),
    )
    assert not set(sticks) & set(CHANNELS)
    return replace(record, topics=(topic, moved))


def test_sticks_and_chops_at_the_limits_are_no_reason_to_lower_gains() -> None:
    record = logged(freestyle("ardupilot_quad", 0.8, 904, 25.0))
    limits = motor_limits(record)
    assert limits.of(limits.by_loop) > 0.02
    (said,) = require_room(record)
    assert (said.kind, said.severity) == ("saturation", "warning")
    assert said.message.endswith("No axis oscillates: sticks or gusts did it. Fly the new gains gently.")


def test_a_limit_cycle_is_refused_all_the_same() -> None:
    swings = replace(
        freestyle("ardupilot_quad", 0.4, 7, 25.0), proportional=3.0, integral=3.0, derivative=3.0, chops=False
    )
    with pytest.raises(InsufficientDataError, match="oscillate") as refused:
        require_room(logged(swings))
    assert {finding.kind for finding in refused.value.findings} == {"oscillation"}


def test_a_log_without_sticks_says_what_it_lacks() -> None:
    record = record_of(freestyle("px4_quad", 0.6, 900, 25.0), log_hz=LOG_HZ)
    with pytest.raises(InsufficientDataError) as refused:
        tune(records=record, axes=("roll",))
    (said,) = [finding.message for finding in refused.value.findings if finding.kind == "not_tuned"]
    assert "no roll stick is logged, nor a set-point that is the stick" in said


def true_peak(case: Case) -> float:
    """The larger M_s of both roll loops with the proposed gains on the exact plant; infinite where one is unstable."""
    one = tune(records=logged(case), axes=("roll",)).axes["roll"]
    omega, gains = one.omega_rad_s, one.proposal.proposed.gains
    true = exact_plant(case.craft, "roll", omega)
    parts = replace(one.parts, controller=replace(one.parts.controller, late_integral=True, late_angle=False))
    figures = [
        loop_figures(omega, (true * controller)[None], from_rad_s=one.plant.known_from_rad_s)
        for controller in (parts.rate(gains), parts.whole(gains))
    ]
    return max(float(found.sensitivity_peak[0]) if found.stable[0] else np.inf for found in figures)


@pytest.mark.slow
def test_gains_are_proposed_and_hold_on_the_exact_plant() -> None:
    """Fifteen flights: most are tuned, none is destabilized, and a refusal says which flight would do."""
    peaks, refused = [], []
    for stick in (0.6, 0.8, 0.95):
        for place, vehicle in enumerate(VEHICLES):
            case = freestyle(vehicle, stick, 900 + place + round(100 * stick))
            try:
                peaks.append(true_peak(case))
            except InsufficientDataError as error:
                refused.append([finding.message for finding in error.findings if finding.kind == "not_tuned"])
    assert len(peaks) >= 0.7 * (len(peaks) + len(refused))
    assert max(peaks) <= 1.75
    assert all("fly 30 s with smaller sticks" in said for (said,) in refused)
