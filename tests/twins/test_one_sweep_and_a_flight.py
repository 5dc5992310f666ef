"""Models over speed, once of sweeps at three speeds and once of sweeps in hover and one fast flight."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.twins.flight_flights import Case, craft_of, twin
from tests.twins.test_forward_flight import OUTPUTS
from tests.unit.identifying.flight_logs import DIAMETER_M, flown, layout_file

from rotorid.flying.designs import plan_for
from rotorid.flying.settings import PlanSettings
from rotorid.flying.simulation import everyday_plan
from rotorid.flying.stitching import Stitched, stitch
from rotorid.identifying.identification import identify
from rotorid.io.registry import read, write_log
from rotorid.results.model import IdentifiedModel
from rotorid.simulation import fly_multirotor, hover_derivatives_of, trimmed
from rotorid.simulation.multirotor_flight import Aircraft, piloted

pytestmark = pytest.mark.slow

CRAFT = piloted(craft_of("hummingbird", "outputs")[0])
SPEEDS = (0.0, 4.0, 8.0)
SPEED_DERIVATIVES = {"hover.longitudinal": ("Z_u", "Z_w", "M_u", "M_w"), "hover.lateral": ("L_v", "N_v")}


def sweeps(craft: Aircraft, folder: Path, speed_m_s: float) -> dict[str, IdentifiedModel]:
    """Both halves of the motion, of sweeps at a speed."""
    wishes = PlanSettings(
        shape="logarithmic_sweep",
        axes=("roll", "pitch", "yaw", "thrust"),
        band_rad_s=(0.5, 40.0),
        duration_s=120.0,
        entry="command",
        amplitudes={"roll": 0.1, "pitch": 0.1, "yaw": 0.06, "thrust": 0.06},
    )
    log = folder / "sweeps.ulg"
    flight = fly_multirotor(craft, plan_for(craft, wishes).plan, speed_m_s=(speed_m_s, speed_m_s), seed=1)
    write_log(log, flight, format="ulg")
    record = read(log)
    log.unlink()
    return {f"{model}-{speed_m_s:g}": identify([record], model, outputs=one) for model, one in OUTPUTS.items()}


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> dict[str, IdentifiedModel]:
    folder = tmp_path_factory.mktemp("swept")
    return {label: model for speed in SPEEDS for label, model in sweeps(CRAFT, folder, speed).items()}


@pytest.fixture(scope="module")
def fast(tmp_path_factory: pytest.TempPathFactory) -> IdentifiedModel:
    """Twenty seconds of an everyday flight at 3 to 10 m/s."""
    layout = str(layout_file(tmp_path_factory.mktemp("layout")))
    known = {name: flown().truth[name] for name in ("m", "I_zz")}
    return identify(flown().record, "physical.flight", layout=layout, rotor_diameter_m=DIAMETER_M, fix=known)


def errors(found: Stitched) -> dict[str, float]:
    """Root mean square over 2, 4, 6 and 8 m/s, as a share of the largest true value there."""
    off = {}
    truths = {speed: hover_derivatives_of(CRAFT.vehicle, CRAFT.autopilot, airspeed_m_s=speed) for speed in (2, 4, 6, 8)}
    for model, names in SPEED_DERIVATIVES.items():
        for name in names:
            true = np.array([truth[name] for truth in truths.values()])
            along = np.array([trimmed(CRAFT.vehicle, speed).velocity_m_s[0] for speed in truths])
            value, _ = found.curves[model][name].at(along)
            off[name] = float(np.sqrt(np.mean((value - true) ** 2)) / np.abs(true).max())
    return off


def test_hover_and_a_flight_are_as_good_as_sweeps_at_three_speeds(
    swept: dict[str, IdentifiedModel], fast: IdentifiedModel
) -> None:
    hover = {label: model for label, model in swept.items() if label.endswith("-0")}
    found = errors(stitch({**hover, "fast": fast}))
    of_sweeps = errors(stitch(swept))
    assert np.mean(list(found.values())) < np.mean(list(of_sweeps.values())), (found, of_sweeps)
    assert max(found.values()) < 0.15, found


def test_an_accelerometer_off_the_center_of_gravity_is_noticed(
    swept: dict[str, IdentifiedModel], fast: IdentifiedModel
) -> None:
    """It is 3 cm up: the sweeps alone state twice the drag, and the flight knows better."""
    found = stitch({label: model for label, model in swept.items() if label.endswith("-0")} | {"fast": fast})
    assert {one.where for one in found.findings if one.kind == "derivatives_differ"} >= {"X_u", "Y_v"}


def test_they_fly_through_the_speeds_as_the_vehicle_does(tmp_path: Path) -> None:
    """Sixty seconds of sticks from 0 to 8 m/s. Yaw hardly moves: its noise is left out."""
    craft = piloted(craft_of("forward_quad", "speeds")[0])
    flight = twin(Case("forward_quad", "eights", duration_s=30.0))
    layout, known = str(layout_file(tmp_path, flight.layout)), {name: flight.truth[name] for name in ("m", "I_zz")}
    fast = identify(flight.record, "physical.flight", layout=layout, rotor_diameter_m=DIAMETER_M, fix=known)
    log = tmp_path / "through.ulg"
    plan = everyday_plan(craft, duration_s=60.0, seed=5)
    write_log(log, fly_multirotor(craft, plan, speed_m_s=(0.0, 8.0), seed=5), format="ulg")
    (through,) = stitch({**sweeps(craft, tmp_path, 0.0), "fast": fast}, [read(log)]).flights
    assert through.measured["u"].max() > 7.0
    scores = {name: round(one.tic, 3) for name, one in through.scores.items() if name not in ("r", "yaw_command")}
    assert all(tic <= 0.1 for tic in scores.values()), scores
