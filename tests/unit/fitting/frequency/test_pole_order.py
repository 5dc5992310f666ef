"""A motor lag and a damping in a row: the response is the same if they change places, and the motor is the faster."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.data.response import FrequencyResponse
from rotorid.fitting.frequency.fit import fit_frequency
from rotorid.fitting.frequency.pole_order import with_faster_motor
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.models.library import library_model

OMEGA = np.geomspace(6.8, 166.0, 60)
TRUTH = {"N_yaw": 32.2, "N_spin": 12.2, "N_r": -0.75, "T_motor": 0.022, "tau_yaw": 0.008}


def yaw(truth: dict[str, float]) -> FrequencyProblem:
    structure, shape = library_model("axis.yaw"), (1, 1, OMEGA.size)
    data = FrequencyResponse(
        omega_rad_s=OMEGA,
        values=structure.response(truth, OMEGA).reshape(shape),
        coherence=np.full(shape, 0.95),
        random_error=np.full(shape, 0.05),
        covariance=np.zeros((*shape, OMEGA.size)),
        inputs=("yaw_command",),
        outputs=("r",),
        estimate="direct",
    )
    return FrequencyProblem(
        structure=structure, parameters=structure.parameters, data=data, used=np.ones(shape, dtype=bool)
    )


@pytest.mark.parametrize("per_command", [1.0, 1.0 / 200.0, 40.0])
@pytest.mark.parametrize("damping", [-0.75, -4.0])
def test_the_motor_is_the_faster_pole_whatever_the_unit_of_the_command(per_command: float, damping: float) -> None:
    truth = {name: value * (per_command if name in ("N_yaw", "N_spin") else 1.0) for name, value in TRUTH.items()}
    truth |= {"N_r": damping}
    problem = yaw(truth)
    found = problem.parameters.unpack(fit_frequency(problem).theta).values
    assert {name: found[name] for name in truth} == pytest.approx(truth, rel=1e-4)


def test_exchanged_poles_have_the_same_response() -> None:
    problem = yaw(TRUTH)
    ratio = -1.0 / (TRUTH["N_r"] * TRUTH["T_motor"])
    slow = {
        "N_yaw": ratio * TRUTH["N_yaw"],
        "N_spin": ratio * TRUTH["N_spin"],
        "N_r": -1.0 / TRUTH["T_motor"],
        "T_motor": -1.0 / TRUTH["N_r"],
        "tau_yaw": TRUTH["tau_yaw"],
    }
    theta = np.array([slow[name] for name in problem.parameters.free])
    assert float(problem.costs(theta).sum()) == pytest.approx(0.0, abs=1e-12)
    exchanged = with_faster_motor(problem, theta)
    assert exchanged is not None
    assert dict(zip(problem.parameters.free, exchanged, strict=True)) == pytest.approx(TRUTH)
    assert with_faster_motor(problem, exchanged) is None
