"""Parameters of the motor chain: what is known, what follows, what is refused."""

from __future__ import annotations

import itertools
import pickle
from typing import cast

import pytest

from rotorid.errors import ModelError
from rotorid.models.motors import SCALES, TERMS_OF_CURVE, Curve, motor_parameters
from rotorid.models.parameter import check_unit


@pytest.mark.parametrize("curve", list(TERMS_OF_CURVE))
def test_curves_have_their_coefficients(curve: Curve) -> None:
    parameters = motor_parameters(curve=curve)
    assert tuple(name for name in parameters.names if name.startswith("c_")) == TERMS_OF_CURVE[curve]
    for one in parameters:
        check_unit(one.name, one.unit)


def test_without_a_scale_mass_is_a_kilogram() -> None:
    mass = motor_parameters()["m"]
    assert (mass.value, mass.status) == (1.0, "fixed")


@pytest.mark.parametrize("name", [one for one in SCALES if one != "m"])
def test_any_scale_frees_the_mass(name: str) -> None:
    parameters = motor_parameters(known={name: 0.02})
    assert parameters["m"].status == "free"
    assert (parameters[name].value, parameters[name].status) == (0.02, "fixed")


def test_kappa_gives_the_inertia_of_yaw_and_the_other_way_round() -> None:
    by_kappa = motor_parameters(known={"m": 1.0, "kappa": 0.06}).with_values({"kappa_per_I_zz": 2.0})
    assert by_kappa["I_zz"].value == pytest.approx(0.03)
    assert by_kappa["I_zz"].status == "tied"
    by_inertia = motor_parameters(known={"m": 1.0, "I_zz": 0.03}).with_values({"kappa_per_I_zz": 2.0})
    assert by_inertia["kappa"].value == pytest.approx(0.06)
    assert by_inertia["kappa"].status == "tied"
    assert {"kappa", "I_zz"}.isdisjoint(motor_parameters(known={"m": 1.0}).names)


def test_axes_bring_their_parameters() -> None:
    of_axis = {"az": "tau_accel", "p": "I_xx", "q": "I_yy", "r": "kappa_per_I_zz"}
    for count in range(5):
        for axes in itertools.combinations(of_axis, count):
            names = set(motor_parameters(axes=axes).names)
            assert {axis for axis, name in of_axis.items() if name in names} == set(axes)
            assert ("tau_gyro" in names) == bool({"p", "q", "r"} & set(axes))


def test_lag_and_heave_damping_can_be_left_out() -> None:
    names = set(motor_parameters(lag=False, heave_damping=False).names)
    assert {"T_motor", "Z_w"}.isdisjoint(names)


def test_unknown_names_and_contradictions_are_refused() -> None:
    with pytest.raises(ModelError, match=r"there is no parameter mass; expected one of I_xx, .*m"):
        motor_parameters(known={"mass": 1.0})
    with pytest.raises(ModelError, match="a linear curve has no c_2"):
        motor_parameters(curve="linear", known={"c_2": 1.0})
    with pytest.raises(ModelError, match="both kappa and I_zz are given as known"):
        motor_parameters(known={"kappa": 0.02, "I_zz": 0.03})
    with pytest.raises(ModelError, match="there is no curve 'cubic'"):
        motor_parameters(curve=cast(Curve, "cubic"), known={"c_1": 1.0})


def test_values_out_of_bounds_are_refused() -> None:
    with pytest.raises(ModelError, match=r"the known m = -1 is not possible; expected a positive number"):
        motor_parameters(known={"m": -1.0})


def test_sets_can_be_sent() -> None:
    parameters = motor_parameters(known={"m": 1.5, "kappa": 0.06})
    assert pickle.loads(pickle.dumps(parameters)) == parameters
