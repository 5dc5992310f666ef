"""One sweep and a fast flight in place of several sweeps: the model at speed is that of the vehicle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.flying import flights, test_stitching
from tests.unit.flying.test_stitching import LATERAL, LONGITUDINAL, SPEEDS, identified

from rotorid.errors import UsageError
from rotorid.flying.stitching import Stitched, stitch
from rotorid.results.model import IdentifiedModel
from rotorid.simulation import hover_derivatives_of, trimmed

CRAFT = replace(test_stitching.CRAFT, vehicle=flights.vehicle({**flights.OF_OUTPUTS, "m_f": 0.0}))
FLIGHT = flights.flight({name: value for name, value in flights.OF_OUTPUTS.items() if name != "m_f"})


@pytest.fixture(scope="module")
def hover() -> dict[str, IdentifiedModel]:
    """Exact results of sweeps in hover, without what symmetry makes zero there."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(test_stitching, "CRAFT", CRAFT)
        return {
            LONGITUDINAL: identified(LONGITUDINAL, 0.0, dropped=("M_w", "Z_u", "X_w", "M_thrust", "X_thrust")),
            LATERAL: identified(LATERAL, 0.0, dropped=("L_r", "N_p", "N_roll")),
        }


@pytest.fixture(scope="module")
def found(hover: dict[str, IdentifiedModel]) -> Stitched:
    return stitch({**hover, "fast": FLIGHT})


def test_derivatives_of_motion_at_speed_are_those_of_the_vehicle(found: Stitched) -> None:
    """In hover they were identified; up to the fastest that was flown, physics has their change."""
    names = {
        LONGITUDINAL: ("X_u", "Z_w", "M_u", "M_w", "Z_u", "M_q"),
        LATERAL: ("Y_v", "L_v", "L_p", "N_r", "L_r"),
    }
    for speed in (*SPEEDS[1:], 10.0):
        truth = hover_derivatives_of(CRAFT.vehicle, CRAFT.autopilot, airspeed_m_s=speed)
        along = trimmed(CRAFT.vehicle, speed).velocity_m_s[0]
        for model, own in names.items():
            for name in own:
                value, std = found.curves[model][name].at(np.array([along]))
                size = max(abs(truth[name]), 0.05)
                assert value[0] == pytest.approx(truth[name], abs=0.02 * size), (speed, name)
                assert std[0] < 0.4 * size, (speed, name)


def test_control_derivatives_follow_the_slopes_of_the_rotors(found: Stitched) -> None:
    """Those too that symmetry makes zero in hover."""
    names = {LONGITUDINAL: ("Z_thrust", "M_pitch", "M_thrust", "X_thrust"), LATERAL: ("L_roll", "N_yaw", "N_roll")}
    for speed in (4.0, 8.0):
        truth = hover_derivatives_of(CRAFT.vehicle, CRAFT.autopilot, airspeed_m_s=speed)
        along = trimmed(CRAFT.vehicle, speed).velocity_m_s[0]
        for model, own in names.items():
            for name in own:
                value, _ = found.curves[model][name].at(np.array([along]))
                assert value[0] == pytest.approx(truth[name], rel=0.02, abs=0.05), (speed, name)


def test_the_trim_is_that_of_level_flight(found: Stitched, hover: dict[str, IdentifiedModel]) -> None:
    fastest = found.of(LONGITUDINAL)[-1]
    trim = trimmed(CRAFT.vehicle, 10.0)
    assert (fastest.trim["u"], fastest.trim["theta"]) == pytest.approx((trim.velocity_m_s[0], trim.angles_rad[1]), 1e-4)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(test_stitching, "CRAFT", CRAFT)
        at_speed = identified(LONGITUDINAL, 10.0)
    for command in ("thrust_command", "pitch_command"):
        assert fastest.trim[command] == pytest.approx(at_speed.covered[command].mean, abs=0.01)


def test_what_comes_from_physics_is_said(found: Stitched) -> None:
    assert {one.where for one in found.findings if one.kind == "speeds_by_physics"} == {LONGITUDINAL, LATERAL}


def test_a_flight_makes_speed_derivatives_surer_as_far_as_it_is_sure(hover: dict[str, IdentifiedModel]) -> None:
    """By the covariances: never less sure than either result alone."""
    wide = replace(FLIGHT, bounds=replace(FLIGHT.bounds, covariance=1e6 * FLIGHT.bounds.covariance))
    sure, unsure = (stitch({**hover, "fast": one}).curves[LONGITUDINAL]["Z_w"] for one in (FLIGHT, wide))
    alone = hover[LONGITUDINAL]["Z_w"].std
    assert alone is not None
    assert sure.std[0] < 0.95 * alone
    assert unsure.std[0] == pytest.approx(alone, rel=0.01)
    assert np.all(unsure.std >= sure.std)
    assert sure.value[0] == pytest.approx(unsure.value[0], rel=1e-3)
    # Derivatives that the sweeps do not show have no more than the flight.
    ends = [stitch({**hover, "fast": one}).curves[LONGITUDINAL]["M_w"].std[-1] for one in (FLIGHT, wide)]
    assert ends[1] > 10.0 * ends[0]


def test_derivatives_that_contradict_each_other_are_said_and_kept(hover: dict[str, IdentifiedModel]) -> None:
    model = hover[LONGITUDINAL]
    z_w, std = model["Z_w"].value, model["Z_w"].std
    assert std is not None
    parameters = model.structure.parameters.with_values({"Z_w": 2.0 * z_w})
    off = replace(
        model,
        structure=replace(model.structure, parameters=parameters),
        parameters={**model.parameters, "Z_w": replace(model["Z_w"], value=2.0 * z_w)},
    )
    found = stitch({"off": off, "fast": FLIGHT})
    (told,) = (one for one in found.findings if one.kind == "derivatives_differ")
    assert (told.where, told.severity) == ("Z_w", "warning")
    assert told.numbers["of_flight"] == pytest.approx(z_w, rel=0.01)
    curve = found.curves[LONGITUDINAL]["Z_w"]
    assert curve.value[0] == pytest.approx(2.0 * z_w, abs=std)


def test_a_flight_that_adds_nothing_is_refused(hover: dict[str, IdentifiedModel]) -> None:
    slow = replace(FLIGHT, flight=replace(FLIGHT.flight, limits=replace(flights.LIMITS, edge_m_s=(0.0, 0.5))))
    with pytest.raises(UsageError, match=r"at up to 0\.5 m/s"):
        stitch({**hover, "slow": slow})
    with pytest.raises(UsageError, match=r"results of physical\.flight"):
        stitch({**hover, "fast": FLIGHT, "again": FLIGHT})
    with pytest.raises(UsageError, match="adds no speed"):
        stitch({"fast": FLIGHT})
