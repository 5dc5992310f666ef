"""Intervals of 95 % on flights of the library's vehicles: how many hold, and how wide they are.

Each flight goes the way of a user's log, and every model that it supports is identified. True is the exact
linearization in hover, with what a flight makes of it:

- thrust of rotors whose thrust is quadratic in what is commanded has the slope at the mean command, and the mean
  command of a sweep that holds the height is lower than that of hover,
- drag and speed derivatives of ArduPilot's vehicle have no slope at rest (quadratic drag), couplings of zero are none
  in steady wind, and rate models leave out what turns the S500: these are not judged,
- filters of the autopilot add to delays, which are not judged here.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from tests.twins.motor_twins import VEHICLES, twin

import rotorid
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.pipeline.flight_settings import SimulateChoices
from rotorid.pipeline.simulation import truth_of

MODELS = (
    *(f"rate.{axis}" for axis in ("roll", "pitch", "yaw", "vertical")),
    *(f"axis.{axis}" for axis in ("roll", "pitch", "yaw")),
    "hover.lateral",
    "hover.longitudinal",
)
SEEDS = (1, 11, 21)
SLOPES_OF_SPEED = ("L_p", "M_q", "N_r", "X_u", "Y_v", "Z_w", "M_u", "L_v")
APART = {("s500", "rate")}
QUADRATIC = ("crazyflie", "hummingbird", "iris", "x500")


class Judged(NamedTuple):
    """A parameter of one flight: its distance from the truth, and its stated standard deviation."""

    vehicle: str
    family: str
    name: str
    error: float
    std: float


def flown_truth(vehicle: str, record: FlightRecord) -> dict[str, float]:
    """Slopes as the sweeps of a flight show them."""
    craft = SimulateChoices(vehicle=vehicle).aircraft
    truth = {name: true.value for name, true in truth_of(craft).items()}
    if vehicle in QUADRATIC:
        thrust = record["thrust_command"]
        sweep = rotorid.find_excitations(record, "thrust")[0]
        inside = (thrust.time_s >= sweep.start_s) & (thrust.time_s <= sweep.stop_s)
        before = (thrust.time_s >= sweep.start_s - 2.0) & (thrust.time_s < sweep.start_s)
        truth["Z_thrust"] *= float(np.mean(thrust.values[inside]) / np.mean(thrust.values[before]))
    return truth


def judged(vehicle: str, weather: str, record: FlightRecord, model: str) -> list[Judged]:
    truth = flown_truth(vehicle, record)
    found = rotorid.identify(record, model)
    family = model.partition(".")[0]
    rows = []
    for name, parameter in found.parameters.items():
        known = parameter.status == "free" and parameter.std and name in truth and not name.startswith("tau_")
        still = vehicle == "ardupilot_quad" and name in SLOPES_OF_SPEED
        if known and not still and not (weather == "wind" and truth[name] == 0.0):
            rows.append(Judged(vehicle, family, name, parameter.value - truth[name], float(parameter.std or 0.0)))
    return rows


class Study(NamedTuple):
    """All that was judged, how many identifications there were, and which were refused."""

    rows: list[Judged]
    flown: int
    refused: list[str]

    def held(self, vehicle: str, family: str) -> tuple[float, float]:
        """Share of intervals that hold, and rms of error over what is stated."""
        ratio = np.array([row.error / row.std for row in self.rows if (row.vehicle, row.family) == (vehicle, family)])
        return float(np.mean(np.abs(ratio) <= 1.96)), float(np.sqrt(np.mean(ratio**2)))


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    folder = tmp_path_factory.mktemp("flights")
    rows: list[Judged] = []
    flown, refused = 0, []
    for vehicle in VEHICLES:
        for weather in ("calm", "wind"):
            for seed in SEEDS:
                record = twin(vehicle, weather, seed, folder).record
                for model in MODELS:
                    if (vehicle, model.partition(".")[0]) in APART:
                        continue
                    flown += 1
                    try:
                        rows += judged(vehicle, weather, record, model)
                    except InsufficientDataError as error:
                        refused.append(f"{vehicle} {weather} {seed} {model}: {error}")
    found = Study(rows, flown, refused)
    for vehicle, family in sorted({(row.vehicle, row.family) for row in rows}):
        held, size = found.held(vehicle, family)
        print(f"| {vehicle} | {family} | {100.0 * held:.0f} % | {size:.2f} |")
    print(f"refused {len(refused)} of {flown}", *refused, sep="\n")
    return found


HELD, SIZE, REFUSED = 0.9, 1.2, 0.1
LEAST_HELD, LARGEST_SIZE = 0.7, 2.5
"""What even the worst of those that miss must keep."""

MISSED = {
    (
        "s500",
        "axis",
    ): "76 %: what turns with pitch has no place in one axis; X_u is positive by less than what is refused",
    ("hummingbird", "axis"): "86 %: in calm air L_v, M_u and the drag are 10 % too small: responses "
    "about the unstable mode at 4 rad/s are 2 to 13 % off at a coherence of 0.6 to 0.9, where one axis has no other",
    ("ardupilot_quad", "axis"): "88 %, three of 24: what quadratic drag does to Y_p and X_q",
}
JUDGED = [
    (vehicle, family) for vehicle in VEHICLES for family in ("rate", "axis", "hover") if (vehicle, family) not in APART
]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("vehicle", "family"),
    [
        pytest.param(
            *pair,
            marks=[pytest.mark.xfail(strict=True, raises=AssertionError, reason=MISSED[pair])]
            if pair in MISSED
            else [],
        )
        for pair in JUDGED
    ],
)
def test_intervals_hold(study: Study, vehicle: str, family: str) -> None:
    held, size = study.held(vehicle, family)
    assert held >= HELD
    assert size <= SIZE


@pytest.mark.slow
def test_what_misses_has_a_bound_and_few_are_refused(study: Study) -> None:
    found = [study.held(*pair) for pair in JUDGED]
    assert min(held for held, _ in found) > LEAST_HELD
    assert max(size for _, size in found) < LARGEST_SIZE
    assert len(study.refused) <= REFUSED * study.flown


@pytest.mark.slow
@pytest.mark.parametrize(("model", "name"), [("axis.roll", "Y_v"), ("axis.pitch", "X_u")])
def test_a_speed_that_pushes_is_refused(model: str, name: str, tmp_path: Path) -> None:
    record = twin("s500", "wind", 1, tmp_path).record
    with pytest.raises(InsufficientDataError) as refusal:
        rotorid.identify(record, model)
    assert name in {finding.where for finding in refusal.value.findings if finding.kind == "impossible_physics"}


@pytest.mark.slow
def test_a_lag_of_rotors_that_stands_for_a_damping_is_refused(tmp_path: Path) -> None:
    record = twin("s500", "wind", 1, tmp_path).record
    with pytest.raises(InsufficientDataError) as refusal:
        rotorid.identify(record, "axis.yaw")
    assert "impossible_physics" in {finding.kind for finding in refusal.value.findings}
