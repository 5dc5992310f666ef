"""Payload between logs and thrust over voltage, out of the weight: known steps come back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.record import FlightRecord, MotorRecord, Source
from rotorid.fits.motors.loads import judge_loads, thrust_of_logs, voltage_exponent
from rotorid.fitting.motors.problem import MotorProblem
from rotorid.flights.motor_data import _compensated
from rotorid.models.motors import motor_parameters
from rotorid.signal.motors import Kind, MotorHistory
from rotorid.vehicles.motor_flight import TRUTH, flights, levers


@pytest.fixture(scope="module")
def record() -> MotorRecord:
    return flights(1, seed=5, duration_s=60.0)[0]


def posed(*records: MotorRecord) -> tuple[MotorProblem, np.ndarray]:
    parameters = motor_parameters(known={"m": TRUTH["m"]}, axes=("az", "p", "q", "r"))
    problem = MotorProblem(records=records, levers=levers(), parameters=parameters)
    return problem, np.array([TRUTH.get(name, 0.0) for name in parameters.free])


def test_a_payload_between_two_logs_is_found(record: MotorRecord) -> None:
    # Thrust makes less acceleration where there is more mass.
    loaded = replace(record, name="loaded", az=record.az / 1.1)
    logs = thrust_of_logs(*posed(record, loaded))
    assert logs[0].ratio == pytest.approx(1.0, abs=3.0 * logs[0].std)
    (finding,) = judge_loads(logs, None)
    assert (finding.kind, finding.where) == ("payload_step", "loaded")
    assert finding.numbers["mass_ratio"] == pytest.approx(1.1, rel=1e-6)
    assert finding.numbers["std"] < 0.015


def test_the_same_vehicle_has_no_step(record: MotorRecord) -> None:
    other = replace(flights(1, seed=6, duration_s=60.0)[0], name="other")
    assert list(judge_loads(thrust_of_logs(*posed(record, other)), None)) == []


@pytest.mark.parametrize("exponent", [1.0, 2.0])
def test_the_power_of_the_voltage_comes_back(record: MotorRecord, exponent: float) -> None:
    volts = np.linspace(16.8, 14.5, record.samples)
    sagging = replace(record, strength=(volts / 15.0) ** 2, az=record.az * (volts / 15.0) ** exponent)
    found = voltage_exponent(*posed(sagging), 15.0)
    assert found is not None
    assert found.exponent == pytest.approx(exponent, abs=3.0 * found.std)
    assert found.std < 0.3
    assert (found.lowest_v, found.highest_v) == pytest.approx((14.5, 16.8))
    (finding,) = judge_loads((), found)
    assert finding.severity == ("warning" if exponent == 1.0 else "info")


def test_a_battery_that_holds_says_nothing(record: MotorRecord) -> None:
    assert voltage_exponent(*posed(record), 15.0) is None
    assert voltage_exponent(*posed(record), None) is None


@pytest.mark.parametrize(
    ("kind", "log", "parameters", "compensated"),
    [
        ("output", "PX4 ULog", {"MC_BAT_SCALE_EN": 1.0}, False),
        # PX4 scales its demands before it logs them.
        ("thrust_demand", "PX4 ULog", {"MC_BAT_SCALE_EN": 1.0}, False),
        (
            "thrust_demand",
            "ArduPilot DataFlash",
            {
                "MOT_BAT_VOLT_MAX": 16.8,
                "MOT_BAT_VOLT_MIN": 13.2,
                "MOT_THST_EXPO": 0.65,
                "MOT_SPIN_MIN": 0.15,
                "MOT_SPIN_MAX": 0.95,
            },
            True,
        ),
        ("speed", "CSV", {}, True),
    ],
)
def test_thrust_follows_the_battery_but_where_it_is_compensated_behind_the_log(
    kind: Kind, log: str, parameters: dict[str, float], *, compensated: bool
) -> None:
    source = Source(name="log", format=log, sha256="")
    record = FlightRecord(source=source, topics=(), parameters=parameters)
    motors = MotorHistory(kind=kind, time_s=np.arange(2.0), values=np.zeros((4, 2)), source="")
    assert _compensated(record, motors) is compensated
