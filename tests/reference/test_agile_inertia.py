"""Inertia from agile flights of a quadrotor whose owners state it: measured rotor speeds, no test input."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Topic
from rotorid.identifying.identification import identify_motors
from rotorid.results.model import IdentifiedModel
from rotorid.settings.motors import MotorSettings

MASS_KG = 0.752
STATED = {"I_xx": 2.52e-3, "I_yy": 2.14e-3}
FAST, MEDIUM, SLOW = "20210218171908seg2", "20210223114138seg3", "20210223104803seg2"
LAYOUT = """
[[rotor]]
position_m = [-0.075, 0.10, 0.0]
spin = "cw"
[[rotor]]
position_m = [0.075, 0.10, 0.0]
spin = "ccw"
[[rotor]]
position_m = [-0.075, -0.10, 0.0]
spin = "ccw"
[[rotor]]
position_m = [0.075, -0.10, 0.0]
spin = "cw"
"""

# Rotor speeds, levers and weight of this flight make 3.25e-3, in every octave from 4 to 16 Hz and by regressions both
# ways (2.6 to 3.3e-3): no part of it shows the stated 2.14e-3.
STATED_OTHERWISE = pytest.mark.xfail(raises=AssertionError, strict=True, reason="no part of this flight shows it")


def record_of(path: Path) -> FlightRecord:
    """The channels that the physics of motors takes, forward right down."""
    from scipy.io import loadmat

    table = next(value for name, value in loadmat(path).items() if not name.startswith("__"))
    names = [*"pqr", "az", "w", *(f"motor_speed_{motor}" for motor in range(1, 5))]
    rows = np.column_stack([table[:, 4], -table[:, 5:7], -table[:, 13], -table[:, 16], table[:, 20:24]]).T
    channels = tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in names)
    topic = Topic(name="t", time_s=table[:, 0], channels=channels, values=rows)
    return FlightRecord(source=Source(name=path.name, format="CSV", sha256=""), topics=(topic,))


@pytest.fixture(scope="module")
def models(unpacked: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory) -> dict[str, IdentifiedModel]:
    layout = tmp_path_factory.mktemp("agile") / "rotors.toml"
    layout.write_text(LAYOUT, encoding="utf-8")
    choices = MotorSettings(known={"m": MASS_KG}, layout=str(layout))
    return {
        name: identify_motors([record_of(unpacked(f"flight/neurobem_{name}.mat.xz"))], choices)
        for name in (FAST, MEDIUM, SLOW)
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    ("flight", "name"),
    [
        *((FAST, "I_xx"), (FAST, "I_yy"), (MEDIUM, "I_xx"), (SLOW, "I_xx")),
        pytest.param(SLOW, "I_yy", marks=STATED_OTHERWISE),
    ],
)
def test_the_interval_contains_the_stated_inertia(models: dict[str, IdentifiedModel], flight: str, name: str) -> None:
    found = models[flight].parameters[name]
    assert found.lower is not None
    assert found.upper is not None
    assert found.lower <= STATED[name] <= found.upper


@pytest.mark.slow
def test_inertia_is_never_off_by_more_than_the_worst_flight(models: dict[str, IdentifiedModel]) -> None:
    """The bound of what is not reached: four stated deviations, and 55 %."""
    for model in models.values():
        for name in STATED.keys() & set(model.parameters):
            found = model.parameters[name]
            assert found.std is not None
            assert abs(found.value - STATED[name]) <= min(4.0 * found.std, 0.55 * STATED[name]), name


@pytest.mark.slow
def test_thrust_that_moved_otherwise_than_the_speeds_is_a_finding(models: dict[str, IdentifiedModel]) -> None:
    curved = {name for name, model in models.items() if "assumed_curve" in {found.kind for found in model.findings}}
    assert curved == {FAST}
