"""Relations between parameters, right ones and wrong ones: findings for the wrong alone, and intervals that contain."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from rotorid.data.response import FrequencyResponse
from rotorid.fits.ties import judge_ties, with_rotor_share
from rotorid.fitting.frequency.fit import fit_frequency, refine
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.models.hover_layouts import physical_hover
from rotorid.models.library import library_model
from rotorid.models.parameter import ParameterSet
from rotorid.models.rotors import library_layout
from rotorid.models.structure import LinearStructure
from rotorid.results.model import parameter_estimates
from rotorid.uncertainty.cramer_rao import Bounds, bounds
from rotorid.uncertainty.propagation import covariance_of_all, response_confidence
from rotorid.uncertainty.ties import TieTest, tie_tests, with_dropped_delays, with_ties

OMEGA = np.geomspace(0.5, 40.0, 24)
LEVEL = 0.01
TRUTH = {
    "I_xx": 0.025,
    "I_yy": 0.025,
    "I_zz": 0.045,
    "c_T": 0.1,
    "dc_T_dJ": -0.13,
    "c_H": 0.05,
    "c_P": 0.04,
    "J_r": 1e-5,
    "z": 0.03,
    "tau_roll": 0.01,
    "tau_pitch": 0.01,
    "tau_yaw": 0.01,
    "tau_thrust": 0.01,
    "T_motor": 0.04,
}
SHOWN = ("p/roll_command", "v/roll_command", "q/pitch_command", "u/pitch_command", "r/yaw_command", "w/thrust_command")
BODY = {"X_u": -0.6, "Y_v": -0.6, "Z_w": -0.6}
"""What drag of the body at the center of gravity adds, 1/s."""


class Found(NamedTuple):
    parameters: ParameterSet
    plain: Bounds
    limits: Bounds
    tests: tuple[TieTest, ...]

    @property
    def contradicted(self) -> set[str]:
        return {test.name for test in self.tests if test.contradicted}

    def findings(self) -> set[tuple[str, str]]:
        return {(one.kind, one.where) for one in judge_ties(self.parameters, self.limits, self.tests)}

    def contains(self, name: str, truth: float, limits: Bounds) -> bool:
        return abs(self.parameters[name].value - truth) <= 1.96 * limits.stds[name]


def measured(
    structure: LinearStructure, values: dict[str, float], shown: tuple[str, ...], seed: int
) -> FrequencyProblem:
    """Responses of the vehicle with errors of one percent, and the structure to be fitted to them."""
    exact = structure.response(values, OMEGA)
    rng = np.random.default_rng(seed)
    noise = (rng.standard_normal(exact.shape) + 1j * rng.standard_normal(exact.shape)) / np.sqrt(2.0)
    level = LEVEL * np.abs(exact)
    data = FrequencyResponse(
        omega_rad_s=OMEGA,
        values=exact + level * noise,
        coherence=np.full(exact.shape, 0.95),
        random_error=np.full(exact.shape, LEVEL),
        covariance=(np.maximum(level, 1e-12) ** 2)[..., None] * np.eye(OMEGA.size, dtype=np.complex128),
        inputs=structure.inputs,
        outputs=structure.outputs,
        estimate="direct",
    )
    used = np.array([[[f"{y}/{u}" in shown] * OMEGA.size for u in structure.inputs] for y in structure.outputs])
    return FrequencyProblem(structure=structure, parameters=structure.parameters, data=data, used=used)


def fitted(problem: FrequencyProblem) -> Found:
    solution = refine(problem, fit_frequency(problem, starts=[problem.parameters.pack()]))
    plain = bounds(problem, solution, weights="covariance")
    tests = tie_tests(problem, solution, weights="covariance")
    parameters = problem.parameters.unpack(solution.theta)
    limits = with_dropped_delays(with_ties(plain, tests), problem, solution, weights="covariance")
    return Found(parameters, plain, with_rotor_share(parameters, limits, problem.structure.name), tests)


def hover(*, body: bool, seed: int, I_zz: float | None = None) -> Found:
    """``physical.hover`` of a vehicle whose body drags or not; its yaw inertia known or not."""
    structure = physical_hover(library_layout("quad.x"))
    parameters = structure.parameters.with_values(TRUTH)
    values = parameters.values
    if body:
        values = values | {name: values[name] + more for name, more in BODY.items()}
    posed = measured(structure, values, SHOWN, seed)
    parameters = parameters.fix("J_r", TRUTH["J_r"])
    if I_zz is not None:
        parameters = parameters.fix("I_zz", I_zz)
    return fitted(posed.with_parameters(parameters))


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_rotors_that_drag_alone_contradict_nothing(seed: int) -> None:
    found = hover(body=False, seed=seed)
    assert found.findings() == set()
    for name in ("I_xx", "I_zz", "c_H", "dc_T_dJ"):
        assert found.contains(name, TRUTH[name], found.limits), name


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_body_that_drags_is_found_and_its_intervals_contain_the_truth(seed: int) -> None:
    found = hover(body=True, seed=seed)
    assert ("tie_contradicted", "Z_w") in found.findings()
    assert ("impossible_physics", "I_zz") in found.findings()
    for name in ("I_zz", "c_H", "c_P"):
        assert not found.contains(name, TRUTH[name], found.plain), name
        assert found.contains(name, TRUTH[name], found.limits), name
    assert found.contains("dc_T_dJ", TRUTH["dc_T_dJ"], found.limits)


def test_what_is_made_of_derivatives_is_no_error_of_theirs() -> None:
    found = hover(body=False, seed=1)
    listed = parameter_estimates(found.parameters, found.limits)
    for name, most in {"X_u": 0.05, "N_r": 0.05}.items():
        assert listed[name].std is not None
        assert listed[name].std <= most * abs(listed[name].value)  # type: ignore[operator]
    assert listed["c_H"].std > 0.2 * abs(listed["c_H"].value)  # type: ignore[operator]


def test_a_contradicted_tie_widens_no_other_derivative() -> None:
    found = hover(body=True, seed=1)
    assert "Z_w" in found.contradicted
    listed = parameter_estimates(found.parameters, found.limits)
    truth = found.parameters.with_values(TRUTH).values
    widened = np.sqrt(np.diag(covariance_of_all(found.parameters, found.limits)))
    for name, row in ((name, found.parameters.names.index(name)) for name in ("L_p", "M_q")):
        std = listed[name].std
        assert std is not None
        assert std < 0.5 * widened[row]
        assert abs(listed[name].value - truth[name]) <= 1.96 * std
    lower, upper = listed["Z_w"].lower, listed["Z_w"].upper
    assert lower is not None
    assert upper is not None
    assert lower <= truth["Z_w"] + BODY["Z_w"] <= upper
    structure = physical_hover(library_layout("quad.x"))
    heave = structure.outputs.index("w"), structure.inputs.index("thrust_command")
    roll = structure.outputs.index("p"), structure.inputs.index("roll_command")
    alone, together = (
        response_confidence(structure, found.parameters, limits, np.array([0.5, 4.0]))[0]
        for limits in (found.limits, replace(found.limits, implied={}))
    )
    assert alone[heave] == pytest.approx(together[heave], rel=0.02)
    assert alone[roll][1] < 0.8 * together[roll][1]
    assert listed["dc_T_dJ"].std == pytest.approx(found.limits.stds["dc_T_dJ"], rel=1e-9)


def test_a_known_yaw_inertia_shows_whose_drag_it_is() -> None:
    assert hover(body=False, seed=1, I_zz=TRUTH["I_zz"]).contradicted == set()
    found = hover(body=True, seed=1, I_zz=TRUTH["I_zz"])
    assert "N_r" in found.contradicted
    assert found.contains("c_H", TRUTH["c_H"], found.limits)


@pytest.mark.parametrize("delay_s", [0.0, 0.005])
def test_a_place_of_the_accelerometer_contains_the_truth_where_its_filter_was_dropped(delay_s: float) -> None:
    structure = library_model("axis.pitch")
    values = structure.parameters.values | {"M_u": 1.0, "X_q": 0.0, "tau_ax": delay_s, "T_motor": 0.04}
    posed = measured(structure, values, ("q/pitch_command", "ax/pitch_command"), 1)
    parameters = structure.parameters.with_values({**values, "tau_ax": 0.0}).drop("tau_ax")
    found = fitted(posed.with_parameters(parameters))
    assert found.contains("z_imu", 0.0, found.limits)
    if delay_s:
        assert found.limits.stds["z_imu"] > 1.05 * found.plain.stds["z_imu"]
