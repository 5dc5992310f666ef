"""Physics of the rotors: the linearization against the forces themselves, the way back, and what no body can be."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.errors import ModelError
from rotorid.models.physical import (
    MIXER,
    PHYSICAL_UNITS,
    check_hover_speed,
    check_inertia,
    check_signs,
    from_derivatives,
    hover_derivatives,
    hover_speed,
    rotor_forces,
)
from rotorid.units import STANDARD_GRAVITY_M_S2 as G
from rotorid.vehicles import s500

TYPICAL = {
    "m": 1.5,
    "I_xx": 0.028,
    "I_yy": 0.031,
    "I_zz": 0.055,
    "c_T": 0.1,
    "dc_T_dJ": -0.13,
    "c_H": 0.05,
    "c_P": 0.04,
    "D": 0.25,
    "l": 0.25,
    "z": 0.03,
    "rho": 1.225,
    "k_n": 100.0,
}
GEOMETRY = ("m", "D", "l", "rho", "k_n")


def vehicle(**change: float) -> dict[str, float]:
    """A vehicle whose rotors carry its weight."""
    physics = TYPICAL | change
    return physics | {"n_h": hover_speed(physics)}


def random_vehicle(rng: np.random.Generator) -> dict[str, float]:
    factors = np.exp(rng.uniform(-1.0, 1.0, len(TYPICAL)))
    physics = {name: value * factor for (name, value), factor in zip(TYPICAL.items(), factors, strict=True)}
    return vehicle(**physics | {"z": physics["z"] * rng.choice([-1.0, 1.0])})


def accelerations(physics: dict[str, float], motion: np.ndarray, commands: np.ndarray) -> np.ndarray:
    """Of the rotors alone and of inertia, no turning of the axes: u, v, w, p, q, r."""
    force, moment = rotor_forces(physics, motion[:3], motion[3:], physics["n_h"] + physics["k_n"] * MIXER @ commands)
    inertia = np.array([physics[name] for name in ("I_xx", "I_yy", "I_zz")])
    return np.concatenate([force / physics["m"], moment / inertia])


@pytest.mark.parametrize("seed", range(8))
def test_derivatives_are_the_slopes_of_the_forces(seed: int) -> None:
    """Central differences along each motion and command. Forces are of second order at most in each, so only rounding
    is left: of some twenty operations on what the weight at the end of an arm would accelerate."""
    physics = random_vehicle(np.random.default_rng(seed))
    step = 1e-3
    slopes = np.zeros((6, 10))
    for column in range(10):
        ends = []
        for sign in (1.0, -1.0):
            point = np.zeros(10)
            point[column] = sign * step
            ends.append(accelerations(physics, point[:6], point[6:]))
        slopes[:, column] = (ends[0] - ends[1]) / (2.0 * step)
    rows, columns = "XYZLMN", ("u", "v", "w", "p", "q", "r", "roll", "pitch", "yaw", "thrust")
    expected = np.zeros_like(slopes)
    for name, value in hover_derivatives(physics).items():
        force, of = name.split("_")
        expected[rows.index(force), columns.index(of)] = value
    lever = max(physics["l"], abs(physics["z"]), physics["D"])
    largest = (
        physics["m"] * G * max(1.0 / physics["m"], lever / min(physics[name] for name in ("I_xx", "I_yy", "I_zz")))
    )
    np.testing.assert_allclose(slopes, expected, rtol=1e-12, atol=20.0 * np.finfo(float).eps * largest / step)


def test_rotors_carry_the_weight_in_hover() -> None:
    physics = vehicle()
    force, moment = rotor_forces(physics, np.zeros(3), np.zeros(3), np.full(4, physics["n_h"]))
    np.testing.assert_allclose(force, [0.0, 0.0, -physics["m"] * G], atol=1e-12)
    np.testing.assert_allclose(moment, 0.0, atol=1e-12)


def test_thrust_derivative_follows_from_the_weight() -> None:
    physics = vehicle()
    expected = -2.0 * G * physics["k_n"] / physics["n_h"]
    assert hover_derivatives(physics)["Z_thrust"] == pytest.approx(expected, rel=1e-12)


def test_commands_act_on_their_own_axis() -> None:
    # The sums of eq 6 turn speeds back into commands.
    back = np.array([[0.0, -0.5, 0.0, 0.5], [0.5, 0.0, -0.5, 0.0], [-0.25, 0.25, -0.25, 0.25], [0.25] * 4])
    np.testing.assert_array_equal(back @ MIXER, np.eye(4))


@pytest.mark.parametrize("seed", range(20))
def test_derivatives_lead_back_to_the_physics(seed: int) -> None:
    rng = np.random.default_rng(seed)
    physics = random_vehicle(rng)
    derivatives = hover_derivatives(physics)
    covariance = np.diag([(0.02 * value) ** 2 for value in derivatives.values()])
    found = from_derivatives(derivatives, covariance, known={name: physics[name] for name in GEOMETRY})
    assert set(found.names) == set(PHYSICAL_UNITS) - set(GEOMETRY)
    for name, value in physics.items():
        # The optimum is flat: the fit stops within 1e-5 standard deviations, and these are some percent.
        assert found.values[name] == pytest.approx(value, rel=1e-5), name
    assert max(map(abs, found.misfit.values())) < 1e-4


def test_negative_drag_is_found_and_remarked_on() -> None:
    physics = vehicle(c_H=-0.05)
    derivatives = hover_derivatives(physics)
    covariance = np.diag([(0.02 * value) ** 2 for value in derivatives.values()])
    found = from_derivatives(derivatives, covariance, known={name: physics[name] for name in GEOMETRY})
    assert found.values["c_H"] == pytest.approx(-0.05, rel=1e-5)
    assert [(f.kind, f.where) for f in found.findings] == [("impossible_physics", "c_H")]


def test_stated_covariance_is_that_of_many_estimates() -> None:
    """Noise of 1 % keeps the physics linear; 250 draws know a standard deviation to 4.5 %, here 4 of these."""
    rng, draws = np.random.default_rng(5), 250
    physics = vehicle()
    truth = hover_derivatives(physics)
    mean = np.array(list(truth.values()))
    half = rng.standard_normal((mean.size, mean.size)) * 0.003 + 0.01 * np.eye(mean.size)
    root = np.abs(mean)[:, None] * half
    arm_std = 0.002
    estimates = []
    for _ in range(draws):
        seen = dict(zip(truth, mean + root @ rng.standard_normal(mean.size), strict=True))
        known = {name: physics[name] for name in GEOMETRY}
        known["l"] += arm_std * rng.standard_normal()
        found = from_derivatives(seen, root @ root.T, known=known, known_std={"l": arm_std})
        estimates.append([found.values[name] for name in found.names])
    at_truth = from_derivatives(
        truth, root @ root.T, known={name: physics[name] for name in GEOMETRY}, known_std={"l": arm_std}
    )
    scatter = np.array(estimates) - [physics[name] for name in at_truth.names]
    whitened = np.linalg.lstsq(*_rooted(at_truth.covariance, scatter.T), rcond=None)[0]
    rank = np.linalg.matrix_rank(_correlation(at_truth.covariance), tol=1e-9)
    # c_T and n_h carry the weight together: one of them follows from the others.
    assert rank == len(at_truth.names) - 1
    chi_square = np.sum(whitened**2, axis=0)
    assert chi_square.mean() == pytest.approx(rank, abs=4.0 * np.sqrt(2.0 * rank / draws))
    spread = np.sqrt(np.mean(scatter**2, axis=0))
    np.testing.assert_allclose(spread, list(at_truth.std.values()), rtol=4.0 / np.sqrt(2.0 * draws))


def _correlation(covariance: np.ndarray) -> np.ndarray:
    std = np.sqrt(np.diag(covariance))
    return covariance / np.outer(std, std)


def _rooted(covariance: np.ndarray, scatter: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A root of the covariance of rank r, shape (k, r), and the scatter, both with every quantity in its own std."""
    std = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(_correlation(covariance))
    kept = values > 1e-9
    return vectors[:, kept] * np.sqrt(values[kept]), scatter / std[:, None]


def test_a_measured_speed_of_the_rotors_is_one_more_measurement() -> None:
    physics = vehicle()
    known = {name: physics[name] for name in ("m", "D", "l", "rho", "k_n")}
    derivatives = hover_derivatives(physics)
    covariance = np.diag([(0.05 * value) ** 2 for value in derivatives.values()])
    without = from_derivatives(derivatives, covariance, known=known)
    n_h = physics["n_h"]
    with_speed = from_derivatives(derivatives, covariance, known=known | {"n_h": n_h}, known_std={"n_h": 0.01 * n_h})
    assert with_speed.std["n_h"] < 0.01 * n_h < without.std["n_h"]
    assert with_speed.std["I_yy"] < without.std["I_yy"]


def test_what_the_derivatives_leave_open_is_named() -> None:
    derivatives = {"X_u": -0.25, "M_u": 3.0}
    known = {name: TYPICAL[name] for name in ("m", "D", "l", "rho", "k_n", "I_xx", "I_zz", "dc_T_dJ", "c_P", "c_T")}
    with pytest.raises(ModelError, match=r"X_u, M_u and what is known do not determine I_yy, z.*give one of I_yy, z"):
        from_derivatives(derivatives, np.diag([0.01, 0.1]) ** 2, known=known)


def test_the_published_s500_is_not_moved_by_its_rotors_alone() -> None:
    """Its M_q and Z_w are positive: no rotor gains thrust from air that meets it."""
    names = ("X_u", "Y_v", "M_u", "L_v", "M_q", "L_roll", "M_pitch", "N_r", "N_yaw", "Z_w", "Z_thrust")
    derivatives = {name: s500.TRUTH[name] for name in names}
    covariance = np.diag([(0.05 * value) ** 2 for value in derivatives.values()])
    known = {"m": 1.4, "D": 0.254, "l": 0.25, "rho": 1.2, "k_n": 100.0}
    found = from_derivatives(derivatives, covariance, known=known)
    assert {"dc_T_dJ", "derivatives"} <= {finding.where for finding in found.findings}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"derivatives": {"M_pich": 1.0}}, "no derivative 'M_pich'.*did you mean M_pitch"),
        ({"known": {"mass": 1.0}}, "no physical parameter 'mass'"),
        ({"known": {"m": -1.0}}, "the known m = -1 is not possible; expected a positive number"),
        ({"known": TYPICAL | {"n_h": 90.0}}, "every physical parameter is given as known"),
        ({"known_std": {"m": 0.1}}, "no known quantity 'm'"),
        ({"known": {"m": 1.0}, "known_std": {"m": -0.1}}, "standard deviation of m is -0.1"),
        ({"covariance": np.eye(2)}, r"shape \(2, 2\) for 1 derivatives"),
        ({"covariance": np.zeros((1, 1))}, "not positive definite"),
    ],
)
def test_a_wrong_call_says_what_is_wrong(change: dict[str, object], message: str) -> None:
    call = {"derivatives": {"X_u": -0.2}, "covariance": np.eye(1), "known": {}, "known_std": None} | change
    with pytest.raises(ModelError, match=message):
        from_derivatives(call["derivatives"], call["covariance"], known=call["known"], known_std=call["known_std"])


@pytest.mark.parametrize(
    ("inertia", "wrong"),
    [
        ((0.03476, 0.04589, 0.0977), ["I_zz"]),  # RotorS iris and firefly
        ((0.16, 0.20, 1.15), ["I_zz"]),  # identified with a genetic algorithm, a scale absorbed elsewhere
        ((0.029125, 0.029125, 0.055225), []),  # PX4 iris
        ((0.02167, 0.02167, 0.04), []),  # x500
        ((0.1, 0.2, 0.3), []),  # a flat plate, for all that 0.1 + 0.2 rounds to
        ((0.1, -0.2, 0.3), ["I_yy"]),
        ((0.0, float("nan"), 0.3), ["I_xx", "I_yy"]),
        ((0.5, 0.1, 0.1), ["I_xx"]),
    ],
)
def test_inertia_of_no_rigid_body_is_remarked_on(inertia: tuple[float, float, float], wrong: list[str]) -> None:
    findings = check_inertia(*inertia)
    assert [finding.where for finding in findings] == wrong
    assert {finding.kind for finding in findings} <= {"impossible_physics"}


def test_thrust_that_is_not_the_weight_is_remarked_on() -> None:
    physics = vehicle()
    assert check_hover_speed(physics) == []
    assert check_hover_speed(physics | {"n_h": 1.02 * physics["n_h"]}) == []
    (finding,) = check_hover_speed(physics | {"n_h": 0.9 * physics["n_h"]})
    assert finding.numbers["thrust_per_weight"] == pytest.approx(0.81)
    (finding,) = check_hover_speed(physics | {"n_h": 1.02 * physics["n_h"]}, tolerance=0.01)
    assert "104 % of the weight" in finding.message


def test_signs_are_those_of_friction_and_thrust() -> None:
    assert check_signs(vehicle()) == []
    assert [finding.where for finding in check_signs(vehicle(dc_T_dJ=0.1, c_P=-0.1))] == ["dc_T_dJ", "c_P"]
