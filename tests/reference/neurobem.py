"""Three public flights of the NeuroBEM set: a racing quadrotor with the speeds of its rotors and motion capture."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

import rotorid
from rotorid.data.record import MotorRecord
from rotorid.models.flight import Airframe

FLIGHTS = {"d": "20210218171908seg2", "g": "20210223104803seg2", "h": "20210223114138seg3"}
FRAME = Airframe(
    positions=np.array([[-0.075, 0.1, 0.0], [0.075, 0.1, 0.0], [-0.075, -0.1, 0.0], [0.075, -0.1, 0.0]]),
    spins=np.array([-1.0, 1.0, 1.0, -1.0]),
    mass_kg=0.752,
    disc_m2=np.pi * 0.0646**2,
)
_MAPPING = Path(__file__).resolve().parents[2] / "docs" / "mappings" / "neurobem.toml"


def neurobem_flights(unpacked: Callable[[str], Path]) -> dict[str, MotorRecord]:
    """The flights by their letter, forward right down.

    Parameters
    ----------
    unpacked
        Path of a file of the data, unpacked.
    """
    return {key: _record(unpacked(f"flight/neurobem_{name}.mat.xz"), key) for key, name in FLIGHTS.items()}


def _record(path: Path, name: str) -> MotorRecord:
    log = rotorid.read(path, mapping=_MAPPING, sandbox=False)

    def rows(names: str) -> np.ndarray:
        return np.stack([log[channel].values for channel in names.split()])

    force = rows("ax ay az")
    return MotorRecord(
        name=name,
        sample_rate_hz=400.0,
        outputs=rows("motor_speed_1 motor_speed_2 motor_speed_3 motor_speed_4"),
        rates=rows("p q r"),
        az=force[2],
        force=force,
        velocity=rows("u v w"),
        attitude=rows("phi theta psi"),
        between="lines",
    )
