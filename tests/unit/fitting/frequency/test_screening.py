"""Couplings that no usable response shows, held at zero before a fit."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.response import FrequencyResponse
from rotorid.fitting.frequency.fit import fit_frequency
from rotorid.fitting.frequency.problem import FrequencyProblem, pair_names
from rotorid.fitting.frequency.screening import (
    without_silent_parameters,
    without_structural_zeros,
    without_unseen_couplings,
)
from rotorid.models.library import library_model
from rotorid.models.structure import LinearStructure

OMEGA = np.geomspace(0.6, 50.0, 40)
SYMMETRIC = {"L_p": -1.0, "L_v": -0.5, "N_r": -0.8, "Y_v": -1.0, "L_roll": 113.0, "N_yaw": 13.3, "T_motor": 0.05}


def lateral() -> LinearStructure:
    return library_model("hover.lateral").select(outputs=["p", "r", "ay"])


def posed(usable: Collection[str], structure: LinearStructure, weak: str = "") -> FrequencyProblem:
    """Responses of a symmetric vehicle, of which only some are coherent."""
    own = {name: value for name, value in {**SYMMETRIC, "Y_roll": 0.0}.items() if name in structure.parameters.names}
    values = {**structure.parameters.values, **own}
    exact = structure.response(values, OMEGA)
    noise = 1e-3 * np.random.default_rng(0).standard_normal((*exact.shape, 2)) @ np.array([1.0, 1j])
    every = [f"{output}/{source}" for output in structure.outputs for source in structure.inputs]
    error = np.where(np.array(every).reshape(exact.shape[:2]) == weak, 0.25, 1e-3)[..., None]
    data = FrequencyResponse(
        omega_rad_s=OMEGA,
        values=exact * (1.0 + noise) + 1e-6 * np.abs(noise),
        coherence=np.ones(exact.shape),
        random_error=np.broadcast_to(error, exact.shape),
        covariance=((1e-6 * np.abs(exact)[..., None] ** 2 + 1e-18) * np.eye(OMEGA.size)).astype(np.complex128),
        inputs=structure.inputs,
        outputs=structure.outputs,
        estimate="joint",
    )
    names = np.array(pair_names(data)).reshape(exact.shape[:2])
    used = np.isin(names, list(usable))[..., None] & np.ones(OMEGA.size, dtype=np.bool_)
    return FrequencyProblem(structure=structure, parameters=structure.parameters, data=data, used=used)


def test_couplings_of_a_symmetric_vehicle_are_held_and_the_rest_is_found() -> None:
    """Without the rule they run off against each other, and take the damping along."""
    problem, unseen = without_unseen_couplings(posed(["p/roll_command", "r/yaw_command", "ay/roll_command"], lateral()))
    assert {coupling.name for coupling in unseen} == {"L_r", "N_p", "N_v", "Y_r", "L_yaw", "N_roll", "Y_yaw"}
    found = problem.parameters.unpack(fit_frequency(problem).theta)
    for name in ("L_roll", "N_yaw", "L_p", "N_r", "T_motor"):
        assert found[name].value == pytest.approx(SYMMETRIC[name], rel=0.01)


def test_it_is_said_which_response_would_show_a_coupling() -> None:
    _, unseen = without_unseen_couplings(posed(["p/roll_command", "r/yaw_command"], lateral()))
    shown = {coupling.name: coupling.shown_by for coupling in unseen}
    assert shown["L_yaw"] == ("p/yaw_command",)
    assert shown["N_p"] == ("r/roll_command",)
    # The side force by roll rate shows in the acceleration alone, which is not used.
    assert shown["Y_p"] == ("ay/roll_command",)


def test_what_a_response_of_its_own_equation_shows_stays_free() -> None:
    every = ["p/roll_command", "p/yaw_command", "r/roll_command", "r/yaw_command", "ay/roll_command", "ay/yaw_command"]
    problem = posed(every, lateral())
    assert without_unseen_couplings(problem) == (problem, ())


def test_a_weak_response_of_another_equation_frees_nothing() -> None:
    """In steady wind the acceleration answers a turn; that says nothing of what turns the vehicle."""
    pairs = ["p/roll_command", "r/yaw_command", "ay/roll_command", "ay/yaw_command"]
    _, unseen = without_unseen_couplings(posed(pairs, lateral(), weak="ay/yaw_command"))
    names = {coupling.name for coupling in unseen}
    assert {"L_r", "L_yaw", "N_p", "N_v", "N_roll"} <= names
    assert not {"Y_r", "Y_yaw"} & names


def test_parameters_with_a_value_of_their_own_are_no_couplings() -> None:
    structure = lateral()
    known = structure.parameters.with_values({"L_yaw": 2.0})
    problem = posed(["p/roll_command", "r/yaw_command"], replace(structure, parameters=known))
    assert "L_yaw" not in {coupling.name for coupling in without_unseen_couplings(problem)[1]}


def test_what_a_well_known_response_shows_lets_others_be_seen() -> None:
    """The side force by the yaw command is known well: then so is what a side speed does to the yaw rate."""
    pairs = ["p/roll_command", "r/yaw_command", "ay/roll_command", "ay/yaw_command"]
    _, unseen = without_unseen_couplings(posed(pairs, lateral()))
    assert "N_v" not in {coupling.name for coupling in unseen}


@pytest.mark.parametrize(
    ("model", "pairs", "flown", "rest"),
    [
        ("hover.lateral", ("p/roll_command", "ay/roll_command"), "roll_command", "N_r"),
        ("hover.longitudinal", ("q/pitch_command", "ax/pitch_command"), "pitch_command", "Z_w"),
        ("hover.longitudinal", ("az/thrust_command",), "thrust_command", "M_q"),
    ],
)
def test_damping_of_an_axis_that_was_not_flown_is_held(
    model: str, pairs: tuple[str, ...], flown: str, rest: str
) -> None:
    outputs = ["p", "r", "ay"] if model == "hover.lateral" else ["q", "ax", "az"]
    structure = library_model(model).select(outputs=outputs, inputs=[flown])
    seen, _ = without_unseen_couplings(posed(pairs, structure))
    problem, silent = without_silent_parameters(without_structural_zeros(seen)[0])
    assert rest in silent
    assert not set(silent) & set(problem.parameters.free)
    assert without_silent_parameters(problem) == (problem, ())


def test_no_damping_is_held_where_every_axis_was_flown() -> None:
    problem, _ = without_unseen_couplings(posed(["p/roll_command", "r/yaw_command", "ay/roll_command"], lateral()))
    assert without_silent_parameters(problem) == (problem, ())
