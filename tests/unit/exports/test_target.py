"""What every export has in common: rows of the round trip, choices, names of targets, draws."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.unit.exports.vehicles import sih
from tests.unit.flying.test_vehicle_from_results import hover, motors

from rotorid import export as export_by_face
from rotorid.errors import ModelError, UsageError
from rotorid.exports import TARGETS, Compared, Exported, ExportSettings, export, export_draws, table_lines
from rotorid.exports.draws import drawn_model
from rotorid.exports.round_trip import identified_motion, linearized

ROOT = Path(__file__).resolve().parents[3]


def row(identified: float, exported: float, **more: object) -> Compared:
    return Compared(name="gain", unit="1", identified=identified, exported=exported, held="exact", **more)  # type: ignore[arg-type]


def test_differences_grow_away_from_zero() -> None:
    assert row(-2.0, -2.02).difference_percent == pytest.approx(1.0)
    assert row(2.0, 1.98).difference_percent == pytest.approx(-1.0)
    assert row(0.0, 0.0).difference_percent == 0.0
    assert math.isinf(row(0.0, 1.0).difference_percent)
    assert row(0.0, 0.1, size=10.0).difference_percent == pytest.approx(1.0)


@pytest.mark.parametrize("came_back", [1.011, 0.989, math.nan])
def test_what_is_held_exactly_may_not_differ(came_back: float) -> None:
    with pytest.raises(ModelError, match="difference of at most 1 %"):
        Exported(target="one", files={}, compared=(row(1.0, came_back),))
    Exported(target="one", files={}, compared=(row(1.0, 1.009), replace(row(1.0, came_back), held="approximated")))


def test_the_table_says_what_is_not_held() -> None:
    lines = table_lines([replace(row(0.05, 0.0), unit="s", held="not")])
    assert lines[1].endswith(" lost")
    assert "%" not in lines[1]


@pytest.mark.parametrize("name", ["", "1st", "my-quad", "a b", "ä", "class", "x" * 41])
def test_names_that_are_none(name: str) -> None:
    with pytest.raises(UsageError, match="--name"):
        ExportSettings(names=name)


def test_targets_are_all_there() -> None:
    assert set(TARGETS) == {
        *(
            "px4-sih",
            "ardupilot",
            "gazebo",
            "mujoco",
            "rotorpy",
            "urdf",
            "allocation",
            "rl-tools",
            "crazyflow",
            "pyflyt",
            "aerial-gym",
            "flightmare",
        ),
        *("matlab", "control", "fmu", "json"),
    }


def test_the_lab_offers_every_target() -> None:
    from typing import get_args

    from rotorid.lab.steps import Step

    assert set(get_args(Step.model_fields["to"].annotation)) == set(TARGETS)
    page = (ROOT / "src/rotorid/lab/static/results.js").read_text(encoding="utf-8")
    listed = page.partition("const TARGETS = [")[2].partition("\n];")[0]
    assert set(re.findall(r'"([\w-]+)"', listed)) == set(TARGETS)


def test_the_face_exports_a_model() -> None:
    exported = export_by_face(motors(I_zz=0.038), "gazebo", ExportSettings(names="bird"))
    assert "bird/model.sdf" in exported.files
    assert exported.target == "gazebo"


def test_linearization_is_that_of_the_body() -> None:
    vehicle = sih()
    body = vehicle.multirotor
    assert body is not None
    motion = identified_motion(vehicle, body, lag_s=None)
    # 5 N by 0.2 m by 1/0.025 kg m^2 for each of four rotors.
    assert np.abs(motion.by_output[3]).sum() == pytest.approx(160.0)
    assert motion.by_motion[0, 0] == pytest.approx(-1.0)
    same = linearized(
        lambda x, v, w: motion.by_output @ x + motion.by_motion @ np.concatenate([v, w]), np.full(4, 0.5), lag_s=None
    )
    assert same.by_output == pytest.approx(motion.by_output, abs=1e-6)
    assert same.by_motion == pytest.approx(motion.by_motion, abs=1e-6)


def test_draws_have_the_covariance() -> None:
    model, rng = motors(I_zz=0.038), np.random.default_rng(3)
    names = model.bounds.names
    values = []
    for _ in range(400):
        drawn = drawn_model(model, rng=rng)
        assert drawn is not None
        values.append([drawn.parameters[name].value for name in names])
        assert drawn.parameters["m"].value == model.parameters["m"].value
    spread = np.cov(np.array(values).T)
    std = np.sqrt(np.diag(model.bounds.covariance))
    # Of 400 draws a standard deviation is known to 3.5 %, a correlation to 0.05.
    assert np.sqrt(np.diag(spread)) == pytest.approx(std, rel=0.15)
    assert (spread / np.outer(std, std))[~np.eye(len(std), dtype=bool)] == pytest.approx(0.0, abs=0.25)


def test_impossible_draws_are_drawn_again_and_counted() -> None:
    # Half of all inertias about the roll axis lie below zero, or nearly.
    vague = motors(I_zz=0.038)
    scale = np.where(np.array(vague.bounds.names) == "I_xx", 100.0, 1.0)
    vague = replace(vague, bounds=replace(vague.bounds, covariance=vague.bounds.covariance * np.outer(scale, scale)))
    made, redrawn = export_draws([vague], "ardupilot", ExportSettings(), 8)
    assert len(made) == 8
    assert redrawn > 0


def test_air_that_brakes_the_vehicle_brakes_every_draw() -> None:
    """Drag of -0.3 ± 0.9 1/s: more than a third of the draws would be driven, where the identified one is not."""
    vague = hover(X_u=-0.3)
    scale = np.where(np.array(vague.bounds.names) == "X_u", 3.0 / 0.03, 1.0)
    vague = replace(vague, bounds=replace(vague.bounds, covariance=vague.bounds.covariance * np.outer(scale, scale)))
    made, redrawn = export_draws([motors(I_zz=0.038), vague], "mujoco", ExportSettings(), 20)
    drag = [row.identified for exported in made for row in exported.compared if row.name == "X_u"]
    assert len(drag) == 20
    assert max(drag) < 0.0
    assert np.std(drag) > 0.3
    assert redrawn > 0


def test_draws_of_a_vehicle_that_lacks_a_number_ask_for_it() -> None:
    with pytest.raises(UsageError, match="add --set kappa=M"):
        export_draws([motors()], "mujoco", ExportSettings(), 5)


def test_draws_of_several_results_join_anew() -> None:
    made, _ = export_draws(
        [motors(I_zz=0.038), hover(X_u=-0.3, M_u=1.1, M_q=-0.71)], "px4-sih", ExportSettings(), 4, seed=5
    )
    drag = [next(one.identified for one in exported.compared if one.name == "X_u") for exported in made]
    assert len(set(drag)) == 4
    assert drag == pytest.approx([-0.3] * 4, rel=0.3)


def test_files_are_written_into_their_folders(tmp_path: object) -> None:
    from pathlib import Path

    folder = Path(str(tmp_path)) / "made"
    exported = export(sih(), "gazebo", ExportSettings(names="bird"))
    exported.write(folder)
    found = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert found == set(exported.files)


def test_rows_state_the_spread_of_the_results_and_hover_is_that_of_the_flights() -> None:
    """Thrust and mass known to 1 %, with terms that nobody correlates: gains are no better than their parts."""
    exported = export([motors(I_zz=0.038), hover()], "px4-sih")
    rows = {one.name: one for one in exported.compared}
    assert rows["hover output"].identified == pytest.approx(0.5233)
    for name in ("vertical", "roll", "pitch", "yaw"):
        gain = rows[f"{name} acceleration per output"]
        assert gain.identified_std is not None
        assert 0.002 < gain.identified_std / gain.identified < 0.03
    lag = rows["motor lag"]
    assert lag.identified_std == pytest.approx(0.01 * lag.identified)
    assert " ± " in table_lines([lag])[1]


@pytest.mark.parametrize(("stated", "held"), [(0.5077, "exact"), (0.5233, "approximated")])
def test_a_hover_that_mass_and_thrust_do_not_give_is_not_exact(stated: float, held: str) -> None:
    """The output that follows from exported numbers is that of the export by construction: it says nothing."""
    model = motors(I_zz=0.038)
    assert model.motors is not None
    exported = export(replace(model, motors=replace(model.motors, hover_output=stated)), "mujoco")
    (found,) = (one for one in exported.compared if one.name == "hover output")
    assert (found.identified, found.held) == (stated, held)
    assert found.exported == pytest.approx(0.5077, rel=1e-3)
    assert found.difference_percent == pytest.approx(100.0 * (0.5077 / stated - 1.0), abs=0.1)
