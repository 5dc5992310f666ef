"""Three public flights of the NeuroBEM set: a racing quadrotor with the speeds of its rotors and motion capture."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from rotorid.benchmarking.catalog import BENCHMARKS
from rotorid.benchmarking.flights import read_flights, vehicle_of
from rotorid.data.record import MotorRecord

FLIGHTS = {"d": "20210218171908seg2", "g": "20210223104803seg2", "h": "20210223114138seg3"}
FRAME = vehicle_of("neurobem").airframe


def neurobem_flights(unpacked: Callable[[str], Path]) -> dict[str, MotorRecord]:
    """The flights by their letter, forward right down.

    Parameters
    ----------
    unpacked
        Path of a file of the data, unpacked.
    """
    folder = {unpacked(f"flight/neurobem_{name}.mat.xz").parent for name in FLIGHTS.values()}.pop()
    found = {
        flight.name: flight.record for flight in read_flights(BENCHMARKS["neurobem"], folder, sandbox=False).flights
    }
    return {key: found[name] for key, name in FLIGHTS.items()}
