"""Longitudinal and lateral motion side by side: responses, poles, simulation, covariance, names that both have."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.unit.flying.test_vehicle_from_results import result

import rotorid
from rotorid.documents.result import load, save
from rotorid.errors import UsageError
from rotorid.flying.model_from_results import JOINED, joined_halves, joined_model
from rotorid.models.library import library_model
from rotorid.results.model import IdentifiedModel, parameter_estimates
from rotorid.uncertainty.cramer_rao import Bounds

OMEGA = np.geomspace(0.3, 40.0, 12)


def half(name: str, seed: int, lag_s: float) -> IdentifiedModel:
    """A library model with some covariance, as if it had been identified."""
    structure = library_model(name)
    structure = replace(structure, parameters=structure.parameters.with_values({"T_motor": lag_s}))
    free = structure.parameters.free
    root = np.random.default_rng(seed).standard_normal((len(free), len(free)))
    bounds = Bounds(
        names=free,
        cramer_rao=np.ones(len(free)),
        insensitivity=np.ones(len(free)),
        covariance=root @ root.T,
        random=0.25 * root @ root.T,
        colored=2.0,
    )
    made = result(name, {"L_p": -1.0})
    return replace(
        made, structure=structure, bounds=bounds, parameters=parameter_estimates(structure.parameters, bounds)
    )


@pytest.fixture(scope="module")
def halves() -> tuple[IdentifiedModel, IdentifiedModel]:
    return half("hover.longitudinal", 1, 0.03), half("hover.lateral", 2, 0.05)


def test_blocks_answer_as_their_parts_and_do_not_couple(halves: tuple[IdentifiedModel, IdentifiedModel]) -> None:
    whole = joined_model(halves)
    first, second = (one.structure for one in halves)
    y, u = len(first.outputs), len(first.inputs)
    response = whole.response(OMEGA)
    np.testing.assert_allclose(response[:y, :u], halves[0].response(OMEGA), rtol=1e-9)
    np.testing.assert_allclose(response[y:, u:], halves[1].response(OMEGA), rtol=1e-9)
    assert not response[:y, u:].any()
    assert not response[y:, :u].any()
    assert len(whole.structure.states) == len(first.states) + len(second.states) >= 8
    together = sorted([pole.value for one in halves for pole in one.poles], key=lambda value: (value.real, value.imag))
    own = sorted([pole.value for pole in whole.poles], key=lambda value: (value.real, value.imag))
    np.testing.assert_allclose(own, together, rtol=1e-6, atol=1e-8)


def test_the_covariance_has_a_block_for_each(halves: tuple[IdentifiedModel, IdentifiedModel]) -> None:
    whole = joined_model(halves)
    count = len(halves[0].bounds.names)
    np.testing.assert_array_equal(whole.bounds.covariance[:count, :count], halves[0].bounds.covariance)
    np.testing.assert_array_equal(whole.bounds.covariance[count:, count:], halves[1].bounds.covariance)
    assert not whole.bounds.covariance[:count, count:].any()
    assert whole["M_q"].std == pytest.approx(halves[0]["M_q"].std, rel=1e-9)
    assert whole["L_v"].std_random == pytest.approx(halves[1]["L_v"].std_random, rel=1e-9)
    assert [finding.kind for finding in whole.findings] == ["joined_models"]


def test_what_both_have_keeps_the_name_of_its_half(halves: tuple[IdentifiedModel, IdentifiedModel]) -> None:
    whole = joined_model(halves)
    assert "T_motor" not in whole.parameters
    assert whole["T_motor_longitudinal"].value == 0.03
    assert whole["T_motor_lateral"].value == 0.05


def test_it_simulates_and_is_read_back(halves: tuple[IdentifiedModel, IdentifiedModel], tmp_path: Path) -> None:
    whole = rotorid.joined_model(halves)
    commands = np.zeros((4, 200))
    commands[0, 20:40] = 0.1
    moved = whole.simulate(commands, sample_rate_hz=100.0)
    alone = halves[0].simulate(commands[:2], sample_rate_hz=100.0)
    np.testing.assert_allclose(moved[: len(alone)], alone, atol=1e-9)
    assert not moved[len(alone) :].any()
    save(whole, tmp_path)
    again = load(tmp_path)
    np.testing.assert_allclose(again.response(OMEGA), whole.response(OMEGA), rtol=1e-6)
    assert again.name == JOINED


@pytest.mark.parametrize("target", ["control", "matlab", "json"])
def test_exports_of_both_halves_hold_the_whole(target: str, halves: tuple[IdentifiedModel, IdentifiedModel]) -> None:
    exported = rotorid.export(halves, target)
    assert any(b"joined" in (text.encode() if isinstance(text, str) else text) for text in exported.files.values())


def test_only_different_linear_models_join(halves: tuple[IdentifiedModel, IdentifiedModel]) -> None:
    with pytest.raises(UsageError, match="both have pitch_command"):
        joined_model([halves[0], halves[0]])
    with pytest.raises(UsageError, match="only 1 model"):
        joined_model([halves[0]])
    assert joined_halves([halves[0]]) is None
    assert joined_halves([halves[0], halves[0], halves[1]]) is None
