"""A default of another vehicle gives way to an estimate that excludes it, and to none that does not."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from tests.unit.exports.vehicles import SECOND, SIH
from tests.unit.flying.test_vehicle_from_results import motors, result

from rotorid.exports import Exported, ExportSettings, export
from rotorid.exports.ardupilot import export as to_ardupilot
from rotorid.exports.px4_sih import export as to_sih
from rotorid.flying.vehicle_from_results import JoinedVehicle, joined_vehicle
from rotorid.flying.vehicle_numbers import VehicleNumber
from rotorid.models.rotors import library_layout
from rotorid.results.summary import ReductionStep


def seen(
    known: dict[str, float], *unknown: str, dropped: bool = False, **values: tuple[float, float | None]
) -> JoinedVehicle:
    """A vehicle without some numbers, and with others that are known to a standard deviation."""
    given = {name: one for name, one in known.items() if name not in unknown}
    given |= {} if dropped else {name: value for name, (value, _) in values.items()}
    vehicle = joined_vehicle([], given=given, layout=library_layout("quad.x"))
    found = {
        name: VehicleNumber(value=value, unit="1/s", source="identified", std=std, of="hover")
        for name, (value, std) in values.items()
    }
    return replace(vehicle, dropped=found) if dropped else replace(vehicle, numbers={**vehicle.numbers, **found})


def parameter(exported: Exported, name: str) -> float:
    text = exported.files["vehicle_set.sh"]
    assert isinstance(text, str)
    (line,) = (line for line in text.splitlines() if line.startswith(f"param set {name} "))
    return float(line.split()[-1])


AXES = ("X_u", "Y_v", "Z_w", "L_p", "M_q", "N_r")


@pytest.mark.parametrize(("std", "taken"), [(0.1, True), (0.25, False), (None, False)])
@pytest.mark.parametrize(("axis", "name", "size"), [("Z_w", "SIH_KDV", 1.0), ("N_r", "SIH_KDW", 0.03)])
def test_sih_takes_another_axis_where_its_own_vehicle_lies_far_away(
    axis: str, name: str, size: float, std: float | None, taken: bool
) -> None:
    """SIH's own vehicle has 1 1/s of all: three deviations of 0.1 from 0.45, and within three of 0.25.

    A deviation that is not known excludes nothing.
    """
    exported = to_sih(seen(SIH, *AXES, **{axis: (-0.45, std)}), ExportSettings())
    assert (name in exported.defaults) != taken
    assert [one.where for one in exported.findings if one.kind == "export_compromise"] == [name] * taken
    if taken:
        assert parameter(exported, name) == pytest.approx(0.45 * size)
        (finding,) = exported.findings
        assert "hover" in finding.message
        assert "--set" in finding.message


@pytest.mark.parametrize(("std", "taken"), [(0.02, True), (0.2, False)])
def test_sitl_takes_the_drag_along_z_where_its_own_frame_lies_far_away(std: float, taken: bool) -> None:
    exported = to_ardupilot(seen(SECOND, "X_u", Z_w=(-0.6, std)), ExportSettings())
    drag = next(one for one in exported.compared if one.name == "Z_w")
    assert ("mdrag_coef" in exported.defaults) != taken
    assert (abs(drag.difference_percent) < 1.0) == taken
    text = exported.files["vehicle.json"]
    assert (json.loads(text)["mdrag_coef"] == 0.2) != taken


@pytest.mark.parametrize(("std", "taken"), [(0.3, True), (3.0, False)])
def test_sitl_takes_a_damping_that_was_dropped(std: float, taken: bool) -> None:
    exported = to_ardupilot(seen(SECOND, dropped=True, L_p=(-6.0, std)), ExportSettings())
    assert ("refRotRate" in exported.defaults) != taken
    table = json.loads(exported.files["vehicle.json"])
    assert (6.98132 / table["refRotRate"] > 1.0) == taken


def test_a_dropped_derivative_is_kept_beside_the_numbers_with_the_least_of_its_errors() -> None:
    step = ReductionStep(
        parameter="X_u",
        action="dropped",
        reason="",
        value_before=-0.25,
        insensitivity_percent=30.0,
        cramer_rao_percent=20.0,
        mean_cost_before=10.0,
        mean_cost_after=10.5,
    )
    hover = result("hover.lateral", {"X_u": 0.0, "Y_v": -0.3})
    dropped = replace(hover.parameters["X_u"], value=0.0, std=None, status="dropped")
    hover = replace(
        hover, parameters={**hover.parameters, "X_u": dropped}, fit=replace(hover.fit, reduction=(step, step))
    )
    vehicle = joined_vehicle([motors(I_zz=0.038), hover])
    assert "X_u" not in vehicle.numbers
    assert vehicle.dropped["X_u"].value == -0.25
    assert vehicle.dropped["X_u"].std == pytest.approx(0.05)
    # What another result knows counts.
    other = result("hover.longitudinal", {"X_u": -0.2})
    assert not joined_vehicle([hover, other]).dropped
    assert export([motors(I_zz=0.038), hover], "px4-sih").files
