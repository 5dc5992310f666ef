"""Quantities behind derivatives: back to the physics they were made of, with the spread of what was put in."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rotorid.errors import ModelError
from rotorid.models.derived import (
    KNOWN_UNITS,
    RELATIONS,
    derived_quantities,
    require_useful,
    thrust_coefficient,
    useful_known,
)
from rotorid.models.physical import hover_derivatives, hover_speed
from rotorid.vehicles import hummingbird

PHYSICS = dict(hummingbird.PHYSICS)
PHYSICS["n_h"] = hover_speed(PHYSICS)
J_r = hummingbird.YAW["N_spin"] * PHYSICS["I_zz"] / (8.0 * math.pi * PHYSICS["k_n"])
TRUTH = PHYSICS | {
    "J_r": J_r,
    "kappa": PHYSICS["c_P"] * PHYSICS["D"] / (2.0 * math.pi * PHYSICS["c_T"]),
}
DERIVATIVES = hover_derivatives(PHYSICS) | {
    "N_spin": hummingbird.YAW["N_spin"],
    "T_motor": hummingbird.YAW["T_motor"],
}


def known(*names: str) -> dict[str, tuple[float, float]]:
    return {name: (PHYSICS[name], 0.0) for name in names}


def from_exact(*names: str, **given: tuple[float, float]) -> dict[str, float]:
    parameters = {name: DERIVATIVES[name] for name in names}
    return dict(derived_quantities(parameters, np.zeros((len(names), len(names))), given).values)


@pytest.mark.parametrize(
    ("derivatives", "given", "found"),
    [
        (("N_yaw", "N_spin"), ("I_zz", "k_n", "n_h", "rho", "D", "m"), ("J_r", "c_P", "kappa", "c_T")),
        (("N_yaw",), ("I_zz", "k_n", "n_h", "m"), ("kappa",)),
        (("Z_thrust", "Z_w"), ("k_n", "m", "rho", "D"), ("n_h", "c_T", "dc_T_dJ")),
        (("X_u", "M_u"), ("m", "rho", "n_h", "D", "I_yy"), ("c_H", "z")),
        (("Y_v", "L_v"), ("m", "rho", "n_h", "D", "I_xx"), ("c_H", "z")),
        (("N_yaw", "N_spin", "Z_thrust"), ("I_zz", "k_n", "rho", "D", "m"), ("n_h", "c_T", "c_P", "kappa", "J_r")),
    ],
)
def test_the_physics_of_derivatives_come_back(
    derivatives: tuple[str, ...], given: tuple[str, ...], found: tuple[str, ...]
) -> None:
    values = from_exact(*derivatives, **known(*given))
    assert {name: values[name] for name in found} == pytest.approx({name: TRUTH[name] for name in found}, rel=1e-12)


def test_yaw_has_the_numbers_that_were_published() -> None:
    """Table 3 of the publication: the pole of the motor, its gain, and yaw by the speed of the motors."""
    values = from_exact("N_yaw", "N_spin", "T_motor", **known("k_n"), k_omega_delta=(3.94, 0.0))
    assert values["M_motor_omega"] == pytest.approx(-42.21)
    assert values["M_motor_delta"] == pytest.approx(152.1, rel=1e-3)
    assert values["N_omega"] == pytest.approx(-0.5541)
    assert values["J_r_per_I_zz"] * PHYSICS["I_zz"] == pytest.approx(J_r)


def test_spread_is_that_of_many_draws() -> None:
    """Draws of parameters and known quantities scatter as stated, to four standard errors."""
    names = ("N_yaw", "N_spin", "Z_thrust", "Z_w")
    center = np.array([DERIVATIVES[name] for name in names])
    root = np.diag(0.01 * np.abs(center)) @ np.linalg.cholesky(np.full((4, 4), 0.5) + 0.5 * np.eye(4))
    given = {name: (PHYSICS[name], 0.01 * PHYSICS[name]) for name in ("I_zz", "k_n", "rho", "D", "m")}
    stated = derived_quantities(dict(zip(names, center, strict=True)), root @ root.T, given)
    rng, draws = np.random.default_rng(0), 700
    drawn = np.array(
        [
            list(
                derived_quantities(
                    dict(zip(names, center + root @ rng.standard_normal(4), strict=True)),
                    np.zeros((4, 4)),
                    {name: (value + std * rng.standard_normal(), 0.0) for name, (value, std) in given.items()},
                ).values.values()
            )
            for _ in range(draws)
        ]
    )
    # One percent of each input bends the relations by some percent of their spread; 700 draws know it to 2.7 %.
    ratio = drawn.std(axis=0, ddof=1) / np.array(list(stated.std.values()))
    assert np.abs(ratio - 1.0).max() < 4.0 / math.sqrt(2 * draws) + 0.03
    scatter = np.corrcoef(drawn.T)
    std = np.array(list(stated.std.values()))
    assert np.abs(scatter - stated.covariance / np.outer(std, std)).max() < 4.0 / math.sqrt(draws)
    assert np.all(np.diag(stated.of_identified) <= np.diag(stated.covariance) * (1.0 + 1e-12))


def test_what_is_known_stands_before_what_follows() -> None:
    """A speed in hover that was measured is taken, not the one that thrust in heave tells."""
    values = from_exact("Z_thrust", "Z_w", **known("k_n", "m", "rho", "D"), n_h=(70.0, 0.5))
    assert "n_h" not in values
    assert values["c_T"] == pytest.approx(TRUTH["c_T"] * (TRUTH["n_h"] / 70.0) ** 2)


def test_what_is_missing_is_named() -> None:
    found = derived_quantities({"N_yaw": 37.3, "N_spin": 10.3}, np.eye(2), known("k_n", "n_h"))
    assert found.missing["J_r"] == ("I_zz",)
    assert found.missing["kappa"] == ("I_zz", "m")
    assert "z" not in found.missing


def test_nothing_follows_from_nothing() -> None:
    found = derived_quantities({"tau_roll": 0.02}, np.eye(1))
    assert dict(found.values) == {}
    assert found.covariance.shape == (0, 0)


def test_nothing_follows_by_a_division_by_zero() -> None:
    assert "spin_up_lead" not in derived_quantities({"N_yaw": 0.0, "N_spin": 1.0}, np.eye(2)).values


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"I_xx": (0.1, 0.0)}, "nothing of axis.yaw follows from it; expected one of D, I_zz"),
        ({"I_zs": (0.1, 0.0)}, "did you mean I_"),
        ({"N_yaw": (1.0, 0.0)}, "is a parameter of axis.yaw"),
        ({"I_zz": (-0.1, 0.0)}, "the known I_zz = -0.1 is not possible; expected a positive number"),
        ({"I_zz": (math.nan, 0.0)}, "the known I_zz = nan is not possible"),
        ({"I_zz": (0.1, -1.0)}, "standard deviation of I_zz is -1"),
    ],
)
def test_a_known_quantity_that_says_nothing_is_refused(given: dict[str, tuple[float, float]], words: str) -> None:
    with pytest.raises(ModelError, match=words):
        require_useful(("N_yaw", "N_spin", "T_motor"), given, model="axis.yaw")


def test_a_model_without_physics_takes_no_known_quantity() -> None:
    assert useful_known(["K_phi", "tau_phi"]) == frozenset()
    with pytest.raises(ModelError, match="a model with N_yaw"):
        require_useful(("K_phi",), {"m": (1.0, 0.0)}, model="response.first_order")


def test_every_relation_can_be_worked_out() -> None:
    """Each name of an expression is a derivative, a known quantity or stands above."""
    above: set[str] = set()
    for relation in RELATIONS:
        assert relation.needs <= {*DERIVATIVES, *KNOWN_UNITS, *above}, relation.name
        above.add(relation.name)


def test_thrust_over_advance_ratio_is_a_line_with_its_spread() -> None:
    covariance = np.array([[4e-6, -1e-5], [-1e-5, 4e-4]])
    value, std = thrust_coefficient([-0.1, 0.0, 0.1], 0.14, -0.12, covariance)
    np.testing.assert_allclose(value, [0.152, 0.14, 0.128])
    np.testing.assert_allclose(std**2, [4e-6 + 2e-6 + 4e-6, 4e-6, 4e-6 - 2e-6 + 4e-6])
