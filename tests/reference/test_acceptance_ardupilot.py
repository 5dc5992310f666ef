"""What the first release promises on ArduPilot logs: the simulator's own derivatives, out of closed-loop flights."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

import rotorid
from rotorid.documents.result import result_document
from rotorid.results.model import IdentifiedModel

TAU_S = 2.45e-3
"""Middle of the 2.4 to 2.5 ms that the simulator shows."""


class Promise(NamedTuple):
    log: str
    model: str
    gain: str
    delay: str
    truth: float
    share: float
    instrument: str
    intervals_s: tuple[tuple[float, float], ...]


ROLL_CALM = ((94.85, 186.33), (203.40, 264.90))
THRUST_CALM = ((94.91, 186.40), (205.45, 266.94))
PROMISES = (
    Promise("x_calm_roll.BIN", "rate.roll", "L_roll", "tau_roll", 437.2, 0.02, "roll_excitation", ROLL_CALM),
    Promise(
        "x_calm_thrust.BIN.xz",
        "rate.vertical",
        "Z_thrust",
        "tau_thrust",
        -27.33,
        0.02,
        "thrust_excitation",
        THRUST_CALM,
    ),
    Promise(
        "x_wind_rollpitch.BIN.xz",
        "rate.roll",
        "L_roll",
        "tau_roll",
        437.2,
        0.03,
        "roll_excitation",
        ((94.80, 176.29),),
    ),
    Promise(
        "x_wind_rollpitch.BIN.xz",
        "rate.pitch",
        "M_pitch",
        "tau_pitch",
        437.2,
        0.03,
        "pitch_excitation",
        ((194.40, 275.89),),
    ),
    Promise(
        "x_wind_yawthrust.BIN.xz", "rate.yaw", "N_yaw", "tau_yaw", 14.18, 0.03, "yaw_excitation", ((94.81, 176.29),)
    ),
    Promise(
        "x_wind_yawthrust.BIN.xz",
        "rate.vertical",
        "Z_thrust",
        "tau_thrust",
        -27.05,
        0.03,
        "thrust_excitation",
        ((194.30, 265.79),),
    ),
)


@pytest.fixture(scope="module")
def record(unpacked: Callable[[str], Path]) -> Callable[[str], rotorid.FlightRecord]:
    """Each log read once, since several axes are in one."""
    known: dict[str, rotorid.FlightRecord] = {}

    def of(name: str) -> rotorid.FlightRecord:
        if name not in known:
            known[name] = rotorid.read(unpacked(f"ardupilot_sitl/{name}"))
        return known[name]

    return of


@pytest.fixture(scope="module", params=PROMISES, ids=lambda p: f"{p.log.split('.')[0]}-{p.model}")
def kept(
    request: pytest.FixtureRequest, record: Callable[[str], rotorid.FlightRecord]
) -> tuple[Promise, IdentifiedModel]:
    """A promise and what came of it, with nothing chosen by hand."""
    promise: Promise = request.param
    return promise, rotorid.identify([record(promise.log)], promise.model)


def test_control_derivative_is_the_simulators(kept: tuple[Promise, IdentifiedModel]) -> None:
    promise, found = kept
    assert result_document(found).parameters[promise.gain].value == pytest.approx(promise.truth, rel=promise.share)


def test_delay_is_the_simulators_and_there_is_no_motor_lag(kept: tuple[Promise, IdentifiedModel]) -> None:
    promise, found = kept
    assert result_document(found).parameters[promise.delay].value == pytest.approx(TAU_S, abs=0.2e-3)
    assert result_document(found).parameters["T_motor"].status == "dropped"


def test_cost_is_below_ten(kept: tuple[Promise, IdentifiedModel]) -> None:
    _, found = kept
    assert result_document(found).cost is not None
    assert result_document(found).cost.average < 10.0
    assert all(pair.value < 10.0 for pair in result_document(found).cost.pairs.values())


def test_injection_is_the_instrument_and_the_direct_estimate_stands_beside(
    kept: tuple[Promise, IdentifiedModel],
) -> None:
    promise, found = kept
    assert result_document(found).provenance.estimate == "joint"
    assert result_document(found).provenance.instruments == [promise.instrument]
    assert found.data.direct is not None
    assert found.data.direct.estimate == "direct"


def test_chirps_are_found_where_the_log_declares_them(kept: tuple[Promise, IdentifiedModel]) -> None:
    promise, found = kept
    maneuvers = result_document(found).provenance.maneuvers
    assert {(m.kind, m.origin) for m in maneuvers} == {("sweep", "declared")}
    for maneuver, (start_s, stop_s) in zip(maneuvers, promise.intervals_s, strict=True):
        assert maneuver.start_s == pytest.approx(start_s, abs=0.1)
        assert maneuver.stop_s == pytest.approx(stop_s, abs=0.1)


def test_roll_model_predicts_stick_doublets_of_another_flight(
    record: Callable[[str], rotorid.FlightRecord],
) -> None:
    # The other flight logs only the filtered gyro, 10 ms later: the reference shift has to absorb that.
    found = rotorid.identify([record("x_calm_roll.BIN")], "rate.roll", verify=[record("x_calm_verify.BIN.xz")])
    scores = [outputs["p"] for outputs in result_document(found).verification.records.values()]
    starts = sorted(check.maneuver.start_s for check in found.verifications.maneuvers)
    assert starts == pytest.approx([95.8, 102.8, 110.8, 191.8], abs=0.15)
    assert len(scores) == 4
    assert max(score.tic for score in scores) < 0.15
