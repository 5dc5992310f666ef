"""MuJoCo loads the model, hovers, and answers as rotorid's own equations do."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.unit.exports.motion import doublet, imported, inequality, late, named, own
from tests.unit.exports.vehicles import asymmetric, second, sih

from rotorid.errors import ModelError
from rotorid.exports import Exported, ExportSettings
from rotorid.exports.mujoco import FLU, export, mjcf
from rotorid.flying.vehicle_from_results import JoinedVehicle, joined_vehicle
from rotorid.models.rotors import library_layout
from rotorid.typing import FloatArray

REASON = "MuJoCo is not installed"


def flown(exported: Exported, folder: Path, outputs: FloatArray) -> dict[str, FloatArray]:
    """What MuJoCo with the loop of the export makes of outputs, in axes forward, right, down."""
    loop: Any = imported(exported, folder, "vehicle_fly.py")
    model, data = loop.load()
    on_the_way = loop.late(model)
    rates, velocity = np.empty((len(outputs), 3)), np.empty((len(outputs), 3))
    for k, row in enumerate(outputs):
        loop.step(model, data, row, on_the_way)
        velocity[k], rates[k] = data.qvel[:3], data.qvel[3:6]
    return named(rates @ FLU, velocity @ FLU)


STRAIGHT = {"c_0": 0.1, "c_1": 8.5, "c_2": 0.0, "delay": 0.0}


@pytest.mark.parametrize(
    ("vehicle", "share"),
    [
        (sih(), 0.02),
        (second(T_motor=0.03), 0.2),
        # All of the motion, through products of inertia and mixed derivatives, where thrust is a line.
        (asymmetric(**STRAIGHT), 0.02),
        (asymmetric(delay=0.0), 0.2),
    ],
    ids=["sih", "second", "straight", "asymmetric"],
)
def test_it_hovers_and_answers_a_doublet_as_rotorid_does(vehicle: JoinedVehicle, share: float, tmp_path: Path) -> None:
    pytest.importorskip("mujoco", reason=REASON)
    exported, body = export(vehicle, ExportSettings()), vehicle.multirotor
    assert body is not None
    still = flown(exported, tmp_path, np.tile(body.hover_shares, (300, 1)))
    assert max(np.abs(values).max() for values in still.values()) < 1e-5
    for axis in range(3):
        outputs = doublet(body, axis)
        found = inequality(own(body, outputs), flown(exported, tmp_path, outputs), share=share, curved=share > 0.1)
        assert "pqr"[axis] in found
        assert max(found.values()) < 0.02, found


def test_the_delay_is_in_the_loop(tmp_path: Path) -> None:
    pytest.importorskip("mujoco", reason=REASON)
    vehicle = asymmetric(**STRAIGHT | {"delay": 0.006})
    exported, body = export(vehicle, ExportSettings()), vehicle.multirotor
    assert body is not None
    outputs = doublet(body, 0)
    found = inequality(own(body, late(outputs, 6)), flown(exported, tmp_path, outputs))
    assert max(found.values()) < 0.02, found
    row = next(row for row in exported.compared if row.name == "delay")
    assert (row.exported, row.held) == (pytest.approx(0.006), "approximated")


def test_a_hexacopter_loads(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco", reason=REASON)
    known = {"m": 2.0, "I_xx": 0.03, "I_yy": 0.03, "I_zz": 0.05, "c_2": 8.0, "kappa": 0.02, "arm": 0.3}
    exported = export(joined_vehicle([], given=known, layout=library_layout("hexa.x")), ExportSettings(names="six"))
    model = mujoco.MjModel.from_xml_string(exported.files["six.xml"])
    assert (model.nu, model.na) == (6, 0)
    assert model.body("six").mass[0] == pytest.approx(2.0)


def test_products_of_inertia_and_torques_change_their_signs() -> None:
    vehicle = asymmetric()
    body = vehicle.multirotor
    assert body is not None
    text = mjcf("v", body, lag_s=0.03)
    assert 'fullinertia="0.018 0.024 0.035 -0.0012 0.0017 0.0009"' in text
    # Clockwise, rear right, above the center.
    assert '<site name="rotor_1" pos="-0.2 -0.15 0.03"' in text
    assert 'site="rotor_1" gear="0 0 1 0 0 0.018"' in text
    assert 'dyntype="filterexact" dynprm="0.03"' in text


def test_every_row_is_exact_but_the_delay() -> None:
    rows = {row.name: row for row in export(asymmetric(), ExportSettings()).compared}
    assert {name for name, row in rows.items() if row.held != "exact"} == {"delay"}
    # Hover differs, as the mean of unlike outputs does from the output for the mean thrust.
    assert all(abs(row.difference_percent) < (0.1 if name == "hover output" else 1e-5) for name, row in rows.items())
    lagged = {row.name: row for row in export(asymmetric(), ExportSettings(delay="lag")).compared}
    assert lagged["motor lag and delay"].exported == pytest.approx(0.036)


def test_an_inertia_of_no_body_is_refused() -> None:
    with pytest.raises(ModelError, match=r"no rigid body has such.*--set I_zz"):
        export(asymmetric(I_zz=0.05), ExportSettings())
