"""Identifiability: what cannot be told apart is named with what is seen of it, and with what to give."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from rotorid.data.response import FrequencyResponse
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.fitting.least_squares import Outcome, Solution
from rotorid.models.library import rate_model
from rotorid.models.structure import LinearStructure
from rotorid.models.toml import from_toml
from rotorid.typing import FloatArray
from rotorid.uncertainty.cramer_rao import bounds
from rotorid.uncertainty.identifiability import Combination, unseen_combinations

LEVEL = 0.02
BAND = np.geomspace(1.0, 30.0, 40)
RIG_UNITS = {"L": "m", "K_f": "N", "J_x": "kg m^2", "d": "1/s"}


def first_order(
    gain: str, values: Mapping[str, float], units: Mapping[str, str], *, delay: str = "0", damping: str = "d"
) -> LinearStructure:
    """``p' = -damping p + gain u(t - delay)``."""
    text = f"""
    name = "rig"
    inputs = ["roll_command"]
    states = ["p"]
    outputs = ["p"]
    F = [["-({damping})"]]
    G = [["{gain}"]]
    H0 = [[1]]
    input_delays = ["{delay}"]
    """
    for name, value in values.items():
        text += f'[parameters.{name}]\nvalue = {value!r}\nunit = "{units.get(name, "1")}"\n'
    return from_toml(text)


def found(structure: LinearStructure, values: Mapping[str, float], omega: FloatArray = BAND) -> tuple[Combination, ...]:
    """Combinations at the truth, where the residuals are zero."""
    exact = structure.response(values, omega)
    covariance = np.zeros((*exact.shape, omega.size), dtype=np.complex128)
    points = np.arange(omega.size)
    covariance[..., points, points] = 2.0 * LEVEL**2 * np.abs(exact) ** 2
    data = FrequencyResponse(
        omega_rad_s=omega,
        values=exact,
        coherence=np.full(exact.shape, 0.95),
        random_error=np.full(exact.shape, LEVEL),
        covariance=covariance,
        inputs=structure.inputs,
        outputs=structure.outputs,
        estimate="direct",
    )
    parameters = structure.parameters.with_values(values)
    posed = FrequencyProblem(
        structure=structure, parameters=parameters, data=data, used=np.ones(exact.shape, dtype=bool)
    )
    residual, jacobian = posed.residuals(parameters.pack())
    solution = Solution(
        theta=parameters.pack(),
        cost=float(residual @ residual),
        outcome=Outcome.CONVERGED,
        residual=residual,
        jacobian=jacobian,
        evaluations=1,
        trace=(),
        at_bound=(False,) * jacobian.shape[1],
    )
    return unseen_combinations(parameters, bounds(posed, solution))


def words(structure: LinearStructure, values: Mapping[str, float], omega: FloatArray = BAND) -> str:
    (combination,) = found(structure, values, omega)
    return combination.words()


def test_of_inertia_and_rotor_constant_only_the_ratio_is_seen() -> None:
    values = {"J_x": 0.047, "K_f": 0.109, "d": 0.5}
    assert words(first_order("K_f/J_x", values, RIG_UNITS), values) == (
        "The data show only K_f/J_x = 2.319, so J_x and K_f cannot be separated. Give one of them (--fix J_x=VALUE); "
        "J_x can be measured by swinging the vehicle on two cords."
    )


def test_of_three_factors_two_must_be_given() -> None:
    values = {"L": 0.197, "K_f": 0.109, "J_x": 0.047, "d": 0.5}
    (combination,) = found(first_order("L*K_f/J_x", values, RIG_UNITS), values)
    assert combination.words() == (
        "The data show only L*K_f/J_x = 0.4569, so L, K_f and J_x cannot be separated. "
        "Give two of L, K_f, J_x (--fix L=VALUE --fix J_x=VALUE); L can be measured with a ruler and "
        "J_x can be measured by swinging the vehicle on two cords."
    )
    assert set(combination.vector) == {"L", "K_f", "J_x", "d"}
    assert combination.vector["d"] == 0.0
    assert sum(share**2 for share in combination.vector.values()) == pytest.approx(1.0)
    # The vector is one of the directions along which the product stays the same.
    assert combination.vector["L"] + combination.vector["K_f"] == pytest.approx(combination.vector["J_x"], abs=1e-6)


@pytest.mark.parametrize(
    ("gain", "product"),
    [
        ("a*b", "a*b = 6"),
        ("a/b", "a/b = 1.5"),
        ("-a*b", "a*b = 6"),
        ("a*b**2", "a*b**2 = 12"),
        ("a**3/b**2", "a**3/b**2 = 6.75"),
        ("a**2*b**3", "a**2*b**3 = 72"),
        ("1/(a*b)", "a*b = 6"),
        ("sqrt(a)*b", "a*b**2 = 12"),
        ("a*b*c**2", "a*b*c**2 = 150"),
        ("a*b/(c*e)", "a*b/(c*e) = 0.1714"),
    ],
)
def test_any_small_power_product_is_found(gain: str, product: str) -> None:
    values = {"a": 3.0, "b": 2.0, "c": 5.0, "e": 7.0}
    values = {name: value for name, value in values.items() if name in gain} | {"d": 0.5}
    assert words(first_order(gain, values, {}), values).startswith(f"The data show only {product}, so ")


def test_two_pairs_are_two_sentences() -> None:
    values = {"a": 3.0, "b": 2.0, "d": 0.5, "s": 1.6}
    structure = first_order("a*b", values, {}, damping="d/s")
    sentences = sorted(combination.words() for combination in found(structure, values))
    assert [sentence.split(", so ")[0] for sentence in sentences] == [
        "The data show only a*b = 6",
        "The data show only d/s = 0.3125",
    ]


def test_of_two_delays_only_the_sum_is_seen() -> None:
    values = {"k": 40.0, "d": 0.5, "t_motor": 0.01, "t_link": 0.002}
    units = {"t_motor": "s", "t_link": "s"}
    structure = first_order("k", values, units, delay="t_motor + t_link")
    assert words(structure, values) == (
        "The data show only t_motor + t_link = 0.012, so t_motor and t_link cannot be separated. Give one of them "
        "(--fix t_motor=VALUE); a signal logged between them, such as the motor speeds, separates them."
    )


def test_equal_delays_are_a_sum_and_no_product() -> None:
    """At equal values a sum and a product have the same relative sensitivities."""
    values = {"k": 40.0, "d": 0.5, "t_motor": 0.01, "t_link": 0.01}
    structure = first_order("k", values, {"t_motor": "s", "t_link": "s"}, delay="t_motor + t_link")
    assert words(structure, values).startswith("The data show only t_motor + t_link = 0.02, so ")


def test_lag_and_delay_of_a_low_band_are_seen_as_their_sum() -> None:
    values = {"L_roll": 60.0, "L_p": -3.0, "T_motor": 0.02, "tau_roll": 0.02}
    structure = rate_model("rate.roll")
    low = words(structure, values, np.geomspace(1.0, 8.0, 25))
    assert low.startswith("T_motor and tau_roll can barely be separated: each is uncertain by ")
    assert "although T_motor + tau_roll = 0.04 is well known. Give one of them" in low
    assert low.endswith("separates them and so does a wider band.")
    assert found(structure, values, np.geomspace(1.0, 120.0, 60)) == ()


def test_without_a_simple_relation_the_parameters_are_named_all_the_same() -> None:
    values = {"a": 3.0, "b": 2.0, "d": 0.5}
    sentence = words(first_order("2.71828*a + 0.7321*b", values, {"a": "N", "b": "m"}), values)
    assert sentence.startswith("a and b can barely be separated: together they may change by 1000 % ")


def test_parameters_of_one_unit_may_form_a_sum() -> None:
    values = {"a": 3.0, "b": 1.7, "d": 0.5}
    sentence = words(first_order("2*a - b", values, {"a": "N", "b": "N"}), values)
    assert sentence.startswith("The data show only 2*a - b = 4.3, so ")


def test_what_is_to_be_given_settles_the_rest() -> None:
    """Of a*b*c and c*e the two easiest to measure, c and e, would leave a and b free to trade."""
    values = {"a": 3.0, "b": 2.0, "c": 5.0, "e": 0.7}
    structure = first_order("a*b*c", values, {"c": "kg", "e": "kg"}, damping="c*e")
    sentence = words(structure, values)
    assert sentence.startswith("The data show only c*e = 3.5 and a*b*c = 30, so a, b, c and e cannot be separated. ")
    assert "Give a and c (--fix a=VALUE --fix c=VALUE); c can be measured by weighing." in sentence
