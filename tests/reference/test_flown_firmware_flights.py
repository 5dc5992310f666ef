"""Margins of simulated flights of the real PX4, whatever version its logs name: plant of the simulator times gains.

The logs of ``px4_sitl`` are of a build without tags, which calls itself 1.8.0 and filters its derivative as all do
since 1.12.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.data.record import FlightRecord
from rotorid.documents.tune import tune_document
from rotorid.flights.controllers import EXPLAINED, flown_firmware
from rotorid.flights.whole_flights import flown
from rotorid.models.autopilots.reading import axis_controller
from rotorid.proposing.proposal import tune
from rotorid.reviewing.margins import margins
from rotorid.reviewing.values import MarginReview
from rotorid.typing import Axis, FloatArray

LOGS: Mapping[Axis, str] = {"roll": "px4_sitl/roll.ulg", "pitch": "px4_sitl/pitch.ulg.xz", "yaw": "px4_sitl/yaw.ulg.xz"}
PLANTS: Mapping[Axis, tuple[float, float]] = {"roll": (113.1, 1.0), "pitch": (113.1, 1.0), "yaw": (13.33, 0.833)}
LAG_S, DELAY_S, LOOP_HZ = 0.048, 5.3e-3, 250.0
NAMES = ("PX4 1.8.0 (beta)", "PX4 1.17.0")


def renamed(record: FlightRecord, firmware: str) -> FlightRecord:
    return replace(record, source=replace(record.source, firmware=firmware))


def exact_margins(record: FlightRecord, axis: Axis) -> dict[str, float]:
    """Margins of the rate loop: plant of the manifest times the gains in the log, as firmware since 1.12 has them."""
    found = axis_controller(record.parameters, axis, firmware="PX4 1.17.0", loop_rate_hz=LOOP_HZ)
    assert found is not None
    omega: FloatArray = np.geomspace(0.5, 600.0, 100_000)
    s, (gain, damping) = 1j * omega, PLANTS[axis]
    loop = (
        gain * np.exp(-DELAY_S * s) / ((LAG_S * s + 1.0) * (s + damping)) * found.controller.rate_loop.response(omega)
    )
    size = np.abs(loop)
    crossing = int(np.flatnonzero((size[:-1] > 1.0) & (size[1:] <= 1.0))[-1])
    turns = np.flatnonzero((loop.imag[:-1] < 0.0) & (loop.imag[1:] >= 0.0) & (loop.real[:-1] < 0.0))
    turn = int(turns[turns > crossing][0])
    return {
        "crossover_rad_s": float(omega[crossing]),
        "phase_margin_deg": float(np.degrees(np.angle(-loop[crossing]))),
        "gain_margin_db": float(-20.0 * np.log10(size[turn])),
        "sensitivity_peak": float(np.max(1.0 / np.abs(1.0 + loop))),
    }


@pytest.fixture(scope="module")
def logs(unpacked: Callable[[str], Path]) -> dict[Axis, FlightRecord]:
    return {axis: rotorid.read(unpacked(path)) for axis, path in LOGS.items()}


@pytest.mark.parametrize("axis", LOGS)
def test_the_log_of_a_build_without_tags_has_the_controller_that_flew(
    axis: Axis, logs: dict[Axis, FlightRecord]
) -> None:
    found = flown_firmware(logs[axis])
    assert found.name == "PX4 1.16 or newer"
    assert [finding.kind for finding in found.findings] == ["firmware_contradicted"]
    assert "firmware_contradicted" in {finding.kind for finding in rotorid.inspect(logs[axis]).findings}
    wrong, right = found.unexplained["PX4 1.8.0 (beta)"], found.unexplained[found.name]
    assert right < 0.1 < EXPLAINED < wrong


@pytest.mark.parametrize("declared", ["PX4 1.16.0", "PX4 1.8.0", "PX4"])
def test_a_second_flight_is_decided_alike(declared: str, unpacked: Callable[[str], Path]) -> None:
    record = renamed(rotorid.read(unpacked("real_stacks/px4_sih_offboard_plan.ulg.xz")), declared)
    found = flown_firmware(record)
    assert found.name == ("PX4 1.16 or newer" if declared == "PX4 1.8.0" else declared)


def review_of(record: FlightRecord, axis: Axis) -> MarginReview:
    found, _ = margins(flown(record))
    return found[axis]


@pytest.mark.parametrize(
    ("axis", "name"),
    [
        (axis, name)
        for axis in LOGS
        for name in ("crossover_rad_s", "phase_margin_deg", "gain_margin_db", "sensitivity_peak")
    ],
)
def test_margins_of_a_review_hold_the_exact_ones(axis: Axis, name: str, reviews: Mapping[Axis, MarginReview]) -> None:
    number, exact = reviews[axis].numbers[name], EXACT[axis][name]
    assert number.lower is not None
    assert number.upper is not None
    assert abs(number.value - exact) < 0.3 * exact
    assert number.lower < exact < number.upper


def test_short_maneuvers_show_the_loop_that_tune_finds_in_a_result(unpacked: Callable[[str], Path]) -> None:
    """The stick was idle but for doublets: the numbers are those of the response that ``identify`` measures of them."""
    record = rotorid.read(unpacked("px4_sitl/verify.ulg.xz"))
    for axis in LOGS:
        numbers, exact = review_of(record, axis).numbers, exact_margins(record, axis)
        for name in ("crossover_rad_s", "phase_margin_deg"):
            assert numbers[name].lower < exact[name] < numbers[name].upper, (axis, name)


@pytest.mark.parametrize("swept", ["pitch", "yaw"])
def test_an_axis_that_gusts_alone_moved_states_no_more_than_they_show(
    swept: Axis, logs: dict[Axis, FlightRecord]
) -> None:
    """The set-point of its rate holds feedback: the phase margin comes out at 54 and 51 degrees, with 12 stated."""
    numbers, exact = review_of(logs[swept], "roll").numbers, exact_margins(logs[swept], "roll")
    assert set(numbers) == {"crossover_rad_s", "phase_margin_deg", "delay_margin_s"}
    for name in ("crossover_rad_s", "phase_margin_deg"):
        assert numbers[name].lower < exact[name] < numbers[name].upper + 0.5


EXACT: dict[Axis, dict[str, float]] = {}


@pytest.fixture(scope="module")
def reviews(logs: dict[Axis, FlightRecord]) -> dict[Axis, MarginReview]:
    EXACT.update({axis: exact_margins(record, axis) for axis, record in logs.items()})
    return {axis: review_of(record, axis) for axis, record in logs.items()}


def test_the_name_of_the_version_changes_no_margin(
    logs: dict[Axis, FlightRecord], reviews: Mapping[Axis, MarginReview]
) -> None:
    other = review_of(renamed(logs["pitch"], "PX4 1.17.0"), "pitch")
    for name, number in reviews["pitch"].numbers.items():
        assert other.numbers[name].value == number.value, name


@pytest.mark.parametrize("axis", ["roll", "pitch"])
def test_flown_margins_of_tune_hold_the_exact_ones(axis: Axis, logs: dict[Axis, FlightRecord]) -> None:
    found = tune_document(tune(records=[logs[axis]], axes=(axis,), draws=50))
    assert found.firmware == "PX4 1.16 or newer"
    assert "firmware_contradicted" in [finding.kind for finding in found.findings]
    stated = found.axes[axis].flown
    for name, value in exact_margins(logs[axis], axis).items():
        lower, upper = stated[name].lower, stated[name].upper
        assert lower is not None
        assert upper is not None
        assert lower < value < upper, name
