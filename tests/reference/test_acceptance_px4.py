"""What the first release promises on PX4 logs: stick sweeps, found in the signals, with lag and delay told apart."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

import rotorid
from rotorid.documents.result import result_document
from rotorid.results.model import IdentifiedModel

LAG_S = 48e-3
"""Motor lag of the simulator at its 4 ms steps."""


class Promise(NamedTuple):
    log: str
    model: str
    axis: str
    gain: str
    truth: float
    swept_s: tuple[float, float]


PROMISES = {
    "roll": Promise("roll.ulg", "rate.roll", "roll", "L_roll", 113.1, (40.54, 122.54)),
    "pitch": Promise("pitch.ulg.xz", "rate.pitch", "pitch", "M_pitch", 113.1, (39.44, 121.44)),
    "yaw": Promise("yaw.ulg.xz", "rate.yaw", "yaw", "N_yaw", 13.33, (39.38, 111.39)),
    "thrust": Promise("thrust.ulg.xz", "rate.vertical", "thrust", "Z_thrust", -20.0, (39.39, 111.39)),
}


@pytest.fixture(scope="module")
def found(unpacked: Callable[[str], Path]) -> Callable[[str], IdentifiedModel]:
    """The model of an axis, identified once, with nothing chosen by hand."""
    known: dict[str, IdentifiedModel] = {}

    def of(axis: str) -> IdentifiedModel:
        if axis not in known:
            promise = PROMISES[axis]
            known[axis] = rotorid.identify([rotorid.read(unpacked(f"px4_sitl/{promise.log}"))], promise.model)
        return known[axis]

    return of


@pytest.mark.parametrize("axis", PROMISES)
def test_gain_is_the_simulators(axis: str, found: Callable[[str], IdentifiedModel]) -> None:
    promise = PROMISES[axis]
    assert result_document(found(axis)).parameters[promise.gain].value == pytest.approx(promise.truth, rel=0.03)


@pytest.mark.parametrize("axis", ["roll", "pitch"])
def test_lag_and_delay_of_roll_and_pitch_are_told_apart(axis: str, found: Callable[[str], IdentifiedModel]) -> None:
    parameters = result_document(found(axis)).parameters
    assert parameters["T_motor"].value == pytest.approx(LAG_S, rel=0.10)
    assert parameters[f"tau_{axis}"].value == pytest.approx(5.3e-3, abs=1.5e-3)


def test_lag_plus_delay_of_thrust(found: Callable[[str], IdentifiedModel]) -> None:
    parameters = result_document(found("thrust")).parameters
    assert parameters["T_motor"].value + parameters["tau_thrust"].value == pytest.approx(55e-3, abs=4e-3)


@pytest.mark.parametrize("axis", PROMISES)
def test_stick_sweep_is_found_and_is_the_instrument(axis: str, found: Callable[[str], IdentifiedModel]) -> None:
    document = result_document(found(axis))
    (maneuver,) = document.provenance.maneuvers
    start_s, stop_s = PROMISES[axis].swept_s
    assert (maneuver.kind, maneuver.origin) == ("sweep", "found")
    # The sticks fade in and out, so the ends are where the motion shows: inside what was flown, and most of it.
    assert start_s - 0.1 <= maneuver.start_s < maneuver.stop_s <= stop_s + 0.1
    assert maneuver.stop_s - maneuver.start_s > 0.9 * (stop_s - start_s)
    assert document.provenance.estimate == "joint"
    assert document.provenance.instruments == [f"{axis}_stick"]


@pytest.mark.parametrize("axis", PROMISES)
def test_model_is_hardly_to_be_told_from_the_flight(axis: str, found: Callable[[str], IdentifiedModel]) -> None:
    cost = result_document(found(axis)).cost
    assert cost is not None
    assert cost.average < 10.0


def test_direct_estimate_leans_toward_the_inverse_of_the_controller(
    unpacked: Callable[[str], Path], found: Callable[[str], IdentifiedModel]
) -> None:
    # Feedback turns noise into command: without the instrument gain and lag come out too low, which it cures.
    record = rotorid.read(unpacked("px4_sitl/roll.ulg"))
    direct = rotorid.identify([record], "rate.roll", settings=rotorid.IdentifySettings(estimate="direct"))
    assert (result_document(direct).provenance.estimate, direct.data.direct) == ("direct", None)
    joint = result_document(found("roll")).parameters
    assert result_document(direct).parameters["L_roll"].value < joint["L_roll"].value
    assert result_document(direct).parameters["T_motor"].value < joint["T_motor"].value
