"""Black boxes in parallel sections: every system of distinct modes has one, with as many numbers as it needs."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.errors import ModelError
from rotorid.models.black_box import best_references, black_box, black_box_pairs, from_state_space
from rotorid.models.structure import LinearStructure
from rotorid.models.toml import from_toml, to_toml
from rotorid.typing import ComplexArray, FloatArray

OMEGA = np.geomspace(0.1, 60.0, 40)


def drawn(order: int, inputs: int, outputs: int, *, seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((order, order)) * 4.0 - 2.0 * np.eye(order)
    return A, rng.standard_normal((order, inputs)), rng.standard_normal((outputs, order))


def response(A: FloatArray, B: FloatArray, C: FloatArray) -> ComplexArray:
    solved = np.linalg.solve(1j * OMEGA[:, None, None] * np.eye(len(A)) - A, np.broadcast_to(B, (OMEGA.size, *B.shape)))
    return np.moveaxis(C @ solved, 0, -1)


def named(order: int, inputs: int, outputs: int, **how: object) -> LinearStructure:
    names = [f"u{k}" for k in range(inputs)], [f"y{k}" for k in range(outputs)]
    return black_box(order, *names, **how)  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("order", "inputs", "outputs"), [(1, 1, 1), (2, 1, 1), (3, 2, 1), (4, 2, 3), (5, 1, 2), (6, 3, 3)]
)
def test_any_system_has_its_sections(order: int, inputs: int, outputs: int, seed: int) -> None:
    A, B, C = drawn(order, inputs, outputs, seed=seed)
    structure = named(order, inputs, outputs)
    parameters = from_state_space(A, B, C, structure)
    expected = response(A, B, C)
    found = structure.response(parameters.values, OMEGA)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize(("order", "inputs", "outputs"), [(2, 1, 1), (4, 2, 3), (6, 3, 2)])
def test_as_many_numbers_as_the_data_can_tell(order: int, inputs: int, outputs: int) -> None:
    """n (u + y) is the dimension of all systems of order n; the responses move with every one of the parameters."""
    structure = named(order, inputs, outputs)
    assert len(structure.parameters) == order * (inputs + outputs)
    parameters = from_state_space(*drawn(order, inputs, outputs, seed=4), structure)
    _, slopes = structure.response_and_jacobian(parameters.values, OMEGA, parameters.directions)
    columns = np.vstack([part.reshape(len(slopes), -1).T for part in (slopes.real, slopes.imag)])
    singular = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), compute_uv=False)
    assert singular[-1] > 1e-6 * singular[0]


def test_poles_pass_from_real_to_complex_within_a_section() -> None:
    structure = black_box(2, ["u"], ["y"])
    B, C = np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]])
    for a1 in (5.0, 4.0, 3.0):  # two real poles, a double one, a pair
        parameters = from_state_space(np.array([[0.0, 1.0], [-4.0, -a1]]), B, C, structure)
        assert parameters.values == pytest.approx({"a0_1": 4.0, "a1_1": a1, "b_x1": 0.0, "b_x2": 1.0}, abs=1e-12)


def test_real_poles_stand_with_their_neighbors() -> None:
    structure = black_box(5, ["u"], ["y"])
    A = np.diag([-30.0, -1.0, -0.9, -8.0, -7.0])
    values = from_state_space(A, np.ones((5, 1)), np.ones((1, 5)), structure).values
    assert (values["a0_1"], values["a0_2"], values["a0_3"]) == pytest.approx((0.9, 56.0, 30.0))


@pytest.mark.parametrize("apart", [0.0, 1e-9])
def test_one_pole_in_two_sections_is_refused(apart: float) -> None:
    A = np.diag([-1.0, -1.0 - apart, -1.0 - 2.0 * apart])
    with pytest.raises(ModelError, match="two sections"):
        from_state_space(A, np.ones((3, 1)), np.ones((1, 3)), black_box(3, ["u"], ["y"]))


def test_a_reference_must_see_its_section() -> None:
    A = np.diag([-1.0, -2.0, -10.0, -12.0])
    B, C = np.ones((4, 1)), np.array([[1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 1.0]])
    with pytest.raises(ModelError, match="y0 does not show the poles"):
        from_state_space(A, B, C, named(4, 1, 2))
    references = best_references(A, C, ["y0", "y1"])
    assert references == ("y0", "y1")
    structure = named(4, 1, 2, references=references)
    found = structure.response(from_state_space(A, B, C, structure).values, OMEGA)
    np.testing.assert_allclose(found, response(A, B, C), rtol=1e-10, atol=1e-14)


def test_bounds_of_a_stable_box_are_those_of_stability() -> None:
    structure = black_box(3, ["u"], ["y"], stable=True)
    values = from_state_space(np.diag([-1.0, -2.0, -3.0]), np.ones((3, 1)), np.ones((1, 3)), structure).values
    assert structure.matrices(values).poles().real.max() < 0.0
    with pytest.raises(ModelError, match="outside its bounds"):
        from_state_space(np.diag([1.0, -2.0, -3.0]), np.ones((3, 1)), np.ones((1, 3)), structure)


def test_delays_are_those_of_the_inputs() -> None:
    structure = named(2, 2, 1, delays=True)
    parameters = structure.parameters.with_values({"tau_u0": 0.03, "tau_u1": 0.1})
    parameters = from_state_space(*drawn(2, 2, 1, seed=1), black_box(2, ["u0", "u1"], ["y0"], delays=True))
    assert parameters["tau_u1"].lower == 0.0
    late = structure.response({**parameters.values, "tau_u1": 0.1}, OMEGA)
    prompt = structure.response({**parameters.values, "tau_u1": 0.0}, OMEGA)
    np.testing.assert_allclose(late[:, 1], prompt[:, 1] * np.exp(-0.1j * OMEGA), rtol=1e-12)


def test_pairs_are_boxes_side_by_side() -> None:
    pairs = [("a", "y"), ("b", "z")]
    structure = black_box_pairs(3, pairs, delays=True)
    single = black_box(3, ["a"], ["y"], delays=True)
    values: dict[str, float] = {}
    alone = []
    for seed, (_, output) in enumerate(pairs):
        one = from_state_space(*drawn(3, 1, 1, seed=seed), single).with_values({"tau": 0.02 * (1 + seed)}).values
        values |= {f"{name}_{output}": value for name, value in one.items()}
        alone.append(single.response(one, OMEGA)[0, 0])
    assert set(values) == set(structure.parameters.names)
    found = structure.response(values, OMEGA)
    np.testing.assert_allclose([found[0, 0], found[1, 1]], alone, rtol=1e-12)
    assert not np.any(found[[0, 1], [1, 0]])


def test_a_box_can_be_written_and_read() -> None:
    structure = named(3, 2, 2, delays=True)
    parameters = from_state_space(*drawn(3, 2, 2, seed=2), structure)
    again = from_toml(to_toml(structure, parameters, {}))
    np.testing.assert_allclose(
        again.response(again.parameters.values, OMEGA), structure.response(parameters.values, OMEGA), rtol=1e-12
    )


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda: black_box(0, ["u"], ["y"]), "order 0"),
        (lambda: black_box(21, ["u"], ["y"]), "order 21"),
        (lambda: black_box(2, ["u"], ["phi"], references=["phy"]), "phy"),
        (lambda: black_box(4, ["u"], ["y"], references=["y"]), "got 1 reference outputs for 2 sections"),
        (lambda: black_box_pairs(2, [("u", "y"), ("u", "z")]), "input u is in two pairs"),
        (lambda: black_box_pairs(2, [("u", "y"), ("v", "y")]), "output y is in two pairs"),
        (lambda: from_state_space(np.eye(2), np.ones((2, 1)), np.ones((1, 2)), black_box(3, ["u"], ["y"])), "shapes"),
    ],
)
def test_wrong_calls_are_refused(wrong: object, words: str) -> None:
    with pytest.raises(ModelError, match=words):
        wrong()  # type: ignore[operator]
