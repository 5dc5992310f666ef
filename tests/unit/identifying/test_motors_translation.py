"""Horizontal accelerations of ``physical.motors --method accelerations``: drag comes back, or is not given."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from tests.unit.identifying.motor_logs import ARM_M, DRAG, leaning

from rotorid.errors import InsufficientDataError
from rotorid.identifying.comparison import compare
from rotorid.identifying.identification import identify_motors
from rotorid.identifying.verification import verify
from rotorid.io.registry import read
from rotorid.results.model import IdentifiedModel
from rotorid.settings.motors import MotorSettings
from rotorid.vehicles.motor_flight import TRUTH

CHOICES = MotorSettings(known={"m": TRUTH["m"]}, layout="quad.x", arm_m=ARM_M, method="accelerations")
CHANNELS = ("velocity_forward_dot", "velocity_right_dot")


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> IdentifiedModel:
    return identify_motors([read(leaning(tmp_path_factory.mktemp("leant") / "leant.csv"))], CHOICES)


def require_drag(found: IdentifiedModel) -> None:
    for name, truth in DRAG.items():
        one = found[name]
        assert one.std is not None
        assert abs(one.value - truth) < 2.0 * one.std, (name, one.value, one.std)
        assert one.std < 0.15, name


def test_known_drag_comes_back(model: IdentifiedModel) -> None:
    require_drag(model)
    assert set(CHANNELS) <= set(model.fit.outputs)
    assert model.fit.fit_percent is not None
    assert all(model.fit.fit_percent[name] > 80.0 for name in CHANNELS)


def test_positions_show_it_too(tmp_path: Path) -> None:
    log = leaning(tmp_path / "positions.csv", positions=True)
    found = identify_motors([read(log)], CHOICES)
    require_drag(found)
    priced = [one for one in found.findings if one.kind == "differentiated"]
    assert "Derivatives of north and east" in priced[0].message


def test_without_motion_there_is_no_drag(tmp_path: Path) -> None:
    found = identify_motors([read(leaning(tmp_path / "still.csv", still=True))], CHOICES)
    assert not set(DRAG) & set(found.parameters)
    assert not set(CHANNELS) & set(found.fit.outputs)
    said = {one.where: one.message for one in found.findings if one.kind == "no_excitation"}
    assert all(said[name].startswith(f"Not enough data for {name}") for name in DRAG)


def test_an_unseen_log_is_judged_by_it(model: IdentifiedModel, tmp_path: Path) -> None:
    log = read(leaning(tmp_path / "unseen.csv", seed=2))
    (one,) = verify(model, [log]).maneuvers
    assert set(CHANNELS) <= set(one.moved)
    assert all(one.scores[name].tic < 0.2 for name in CHANNELS)
    assert set(CHANNELS) <= set(compare([model, model], [log]).common_outputs)
    # A log without velocity judges the rest.
    blind = [replace(topic, channels=topic.channels[:8], values=topic.values[:8]) for topic in log.topics]
    (rest,) = verify(model, [replace(log, topics=tuple(blind))]).maneuvers
    assert "p_dot" in rest.moved
    assert not set(CHANNELS) & set(rest.moved)


def test_positions_that_are_asked_for_must_be_there(tmp_path: Path) -> None:
    with pytest.raises(InsufficientDataError, match="contains no north"):
        identify_motors([read(leaning(tmp_path / "no.csv"))], replace(CHOICES, outputs=("north", "east")))
