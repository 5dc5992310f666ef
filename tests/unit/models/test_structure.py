"""Structures: exact derivatives against the complex step, and the frequency response against the time response."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.errors import ModelError
from rotorid.models.expression import Expression
from rotorid.models.library import RATE_AXES, rate_model
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.structure import LinearStructure, Rows
from rotorid.simulation.linear import simulate_linear
from rotorid.typing import ComplexArray, FloatArray

OMEGA = np.geomspace(0.1, 200.0, 40)
NAMES = ("a", "b", "c", "d", "e")
STEP = 1e-30


def affine_entry(rng: np.random.Generator, constant: float, scale: float) -> str:
    one, two = rng.choice(NAMES, size=2, replace=False)
    return f"{constant} + {scale * rng.standard_normal()}*{one} + {scale * rng.standard_normal()}*{two}"


def curved_entry(rng: np.random.Generator, constant: float, scale: float) -> str:
    """An entry as physics has them, bounded by a few times its scale whatever the parameters are."""
    one, two, three = rng.choice(NAMES, size=3, replace=False)
    forms = (
        f"sin({one}*{two}) + cos({three}/k)",
        f"{one}*exp(-{one}**2)*tan({two}/(1 + k*abs({two})))",
        f"sqrt(1 + {one}**2)/(2 + abs({two})) - k*{three}/(1 + {three}**2)",
        f"log(1 + {one}**2)*{two}/(1 + {two}**2)",
        f"(1.5 + sin({one}))**cos({two}) - {three}/k/4",
    )
    return f"{constant} + {scale}*({forms[rng.integers(len(forms))]})"


def random_structure(seed: int, *, curved: bool = False) -> LinearStructure:
    """A coupled system of random shape, whose every matrix and delay is a function of shared parameters."""
    rng = np.random.default_rng(seed)
    x, u, y = (int(rng.integers(1, high)) for high in (5, 4, 4))

    def entry(constant: float, scale: float) -> Expression:
        form = curved_entry if curved and rng.uniform() < 0.5 else affine_entry
        return Expression.parse(form(rng, constant, scale))

    def rows(count: int, width: int, diagonal: float = 0.0) -> tuple[tuple[Expression, ...], ...]:
        return tuple(
            tuple(entry(diagonal * (i == j) + 0.3 * rng.standard_normal(), 0.3) for j in range(width))
            for i in range(count)
        )

    every = Expression.parse("0.02 + " + " + ".join(f"0.01*{name}" for name in NAMES))
    return LinearStructure(
        name=f"random.{seed}",
        inputs=tuple(f"u{i}" for i in range(u)),
        states=tuple(f"x{i}" for i in range(x)),
        outputs=tuple(f"y{i}" for i in range(y)),
        M=rows(x, x, 3.0),
        F=rows(x, x, -5.0),
        G=rows(x, u),
        H0=rows(y, x),
        H1=rows(y, x),
        input_delays=(every, *(entry(0.01, 0.01) for _ in range(u - 1))),
        output_delays=tuple(entry(0.02, 0.01) for _ in range(y)),
        constants={"k": 2.5},
        parameters=ParameterSet(
            tuple(Parameter(name=name, value=float(rng.standard_normal()), unit="1") for name in NAMES)
        ),
    )


def complex_step(structure: LinearStructure, values: dict[str, complex], omega: FloatArray) -> ComplexArray:
    r"""Derivative of the response by a step of :math:`10^{-30} i` in the values: exact, nothing cancels.

    The response is complex itself, so its own unit must not mix with that of the step: it is written as the real
    matrix [[0, -1], [1, 0]], every entry of the system becomes a block of two by two, and the formula stays the same.
    """
    numbers = {**structure.constants, **values}

    def matrix(rows: Rows, width: int) -> ComplexArray:
        entries = [[complex(entry.evaluate(numbers)) for entry in row] for row in rows]
        return np.array(entries, dtype=np.complex128).reshape(len(rows), width)

    x, u, y = len(structure.states), len(structure.inputs), len(structure.outputs)
    M, F, H0, H1 = (matrix(rows, x) for rows in (structure.M, structure.F, structure.H0, structure.H1))
    G = matrix(structure.G, u)
    tau_u, tau_y = matrix((structure.input_delays,), u)[0], matrix((structure.output_delays,), y)[0]
    one, unit = np.eye(2), np.array([[0.0, -1.0], [1.0, 0.0]])
    derivative = np.empty((y, u, omega.size), dtype=np.complex128)
    for point, w in enumerate(omega):
        states = np.linalg.solve(w * np.kron(M, unit) - np.kron(F, one), np.kron(G, one))
        blocks = ((np.kron(H0, one) + w * np.kron(H1, unit)) @ states).reshape(y, 2, u, 2)
        for i, k in np.ndindex(y, u):
            angle = w * (tau_y[i] + tau_u[k])
            block = blocks[i, :, k] @ (np.cos(angle) * one - np.sin(angle) * unit)
            derivative[i, k, point] = complex(block[0, 0].imag, block[1, 0].imag) / STEP
    return derivative


def stepped(values: dict[str, float], name: str) -> dict[str, complex]:
    return {**values, name: values[name] + 1j * STEP}


@pytest.mark.parametrize("curved", [False, True])
@pytest.mark.parametrize("seed", range(12))
def test_jacobian_of_random_structures_against_the_complex_step(seed: int, curved: bool) -> None:
    structure = random_structure(seed, curved=curved)
    values = structure.parameters.values
    response, jacobian = structure.response_and_jacobian(values, OMEGA, np.eye(len(NAMES)))
    np.testing.assert_allclose(response, structure.response(values, OMEGA), rtol=1e-10)
    assert jacobian.shape == (len(NAMES), *response.shape)
    for slot, name in enumerate(NAMES):
        exact = complex_step(structure, stepped(values, name), OMEGA)
        assert np.abs(jacobian[slot] - exact).max() <= 1e-9 * np.abs(exact).max()


@pytest.mark.parametrize("name", RATE_AXES)
@pytest.mark.parametrize("lag", [0.0, 0.05])
def test_jacobian_of_rate_models_against_the_complex_step(name: str, lag: float) -> None:
    axis, structure = RATE_AXES[name], rate_model(name)
    set_to = {axis.gain: -42.0, axis.damping: -1.7, "T_motor": lag, axis.delay: 0.011, "N_spin": 3.0 * (lag > 0.0)}
    values = {one: set_to[one] for one in structure.parameters.names}
    _, jacobian = structure.response_and_jacobian(values, OMEGA, structure.parameters.directions)
    for slot, parameter in enumerate(values):
        exact = complex_step(structure, stepped(values, parameter), OMEGA)
        np.testing.assert_allclose(jacobian[slot], exact, rtol=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_jacobian_through_ties_against_the_complex_step(seed: int) -> None:
    """Two parameters follow the others, one through the other; the step goes through the same ties."""
    structure = random_structure(seed, curved=True)
    parameters = structure.parameters.tie("b", "sin(a)*d - k*c").tie("e", "b/(1 + d**2)")
    directions = parameters.directions
    assert directions.shape == (5, 3)
    _, jacobian = structure.response_and_jacobian(parameters.values, OMEGA, directions)
    for slot, name in enumerate(parameters.free):
        values = stepped(parameters.values, name)
        for tied in ("b", "e"):
            expression = parameters[tied].tied
            assert expression is not None
            values[tied] = expression.evaluate({**structure.constants, **values})
        exact = complex_step(structure, values, OMEGA)
        assert np.abs(jacobian[slot] - exact).max() <= 1e-9 * np.abs(exact).max()


def test_matrices_and_their_derivatives_against_the_complex_step() -> None:
    structure = random_structure(4, curved=True)
    values = structure.parameters.values
    mixture = np.random.default_rng(1).standard_normal((len(NAMES), 2))
    system, derivatives = structure.matrices_and_jacobian(values, mixture)
    np.testing.assert_array_equal(system.F, structure.matrices(values).F)
    along = {name: values[name] + 1j * STEP * mixture[slot, 1] for slot, name in enumerate(NAMES)}
    rows = (*(getattr(structure, n) for n in ("M", "F", "G", "H0", "H1")), structure.input_delays)
    for derivative, entries in zip(derivatives, (*rows, structure.output_delays), strict=True):
        flat = [entry for row in entries for entry in (row if isinstance(row, tuple) else (row,))]
        exact = [np.imag(entry.evaluate({**structure.constants, **along})) / STEP for entry in flat]
        np.testing.assert_allclose(derivative[1].ravel(), exact, rtol=1e-12, atol=1e-14)


def test_jacobian_along_a_direction_is_the_mixture_of_its_parameters() -> None:
    structure = random_structure(3, curved=True)
    _, each = structure.response_and_jacobian(structure.parameters.values, OMEGA, np.eye(len(NAMES)))
    mixture = np.random.default_rng(0).standard_normal((len(NAMES), 2))
    _, along = structure.response_and_jacobian(structure.parameters.values, OMEGA, mixture)
    np.testing.assert_allclose(along, np.tensordot(mixture.T, each, axes=1), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("name", RATE_AXES)
@pytest.mark.parametrize("lag", [0.0, 0.05])
def test_frequency_response_against_time_response(name: str, lag: float) -> None:
    """A periodic multisine, after its transient, comes out as the response says.

    Between samples the simulation interpolates linearly, which weighs a sine by sinc^2(omega h / 2); the rest is exact.
    """
    axis = RATE_AXES[name]
    values = {axis.gain: 60.0, axis.damping: -3.0, "T_motor": lag, axis.delay: 0.0137, "N_spin": 3.0 * (lag > 0.0)}
    system = rate_model(name).matrices(values)
    rate_hz, samples, periods = 500.0, 2000, 5
    harmonics = np.array([1, 3, 8, 20, 45, 90])
    phases = np.random.default_rng(1).uniform(0.0, 2.0 * np.pi, harmonics.size)
    time_s = np.arange(samples) / rate_hz
    omega = 2.0 * np.pi * harmonics * rate_hz / samples
    period = np.cos(omega[:, None] * time_s + phases[:, None]).sum(axis=0)
    u = np.tile(period, periods)[None]
    # Periodic to the very end: linear interpolation needs the first sample of the next period.
    y = simulate_linear(system, u, sample_rate_hz=rate_hz, hold="first")[0, -2 * samples : -samples]
    measured = np.fft.rfft(y)[harmonics] / np.fft.rfft(period)[harmonics]
    held = np.sinc(omega / (2.0 * np.pi * rate_hz)) ** 2
    # A jump of the input is seen as it is, so a vertical model without lag passes interpolated values: with a delay of
    # 13.7 ms = 6.85 samples the value between two samples is another mix of the aliases than an integral of it.
    expected = system.response(omega)[0, 0]
    if name == "rate.vertical" and lag == 0.0:
        assert np.all(np.abs(measured / expected - 1.0) <= (omega / rate_hz) ** 2 / 8.0 + 1e-6)
        return
    # Aliases of a linear interpolation fall off as 1/k^2 and pass at least one integration: below (omega h)^2 / 12.
    assert np.all(np.abs(measured / (expected * held) - 1.0) <= (omega / rate_hz) ** 2 / 12.0 + 1e-6)


def simple(**change: object) -> LinearStructure:
    return replace(rate_model("rate.roll"), **change)


ZERO = Expression()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"G": ((ZERO,),)}, "matrix G is 1 x 1; expected 2 rows of 1 entries"),
        ({"F": ((ZERO,), (ZERO, ZERO))}, "matrix F is 2 x 1/2"),
        ({"input_delays": ()}, "1 input and 1 output delays"),
        ({"input_delays": (ZERO,)}, "tau_roll is in no matrix"),
        ({"input_delays": (Expression.parse("tau_rol"),)}, "names tau_rol, which.*did you mean tau_roll"),
        (
            {"output_delays": (Expression.parse("tau"),)},
            "names tau, which is not one of its parameters.*did you mean tau_roll",
        ),
        ({"gain": "L_rol"}, "names L_rol.*did you mean L_roll"),
        ({"optional": ("T_moto",)}, "names T_moto"),
        ({"constants": {"L_p": 1.0}}, "L_p is a parameter and a constant"),
        ({"constants": {"g": float("nan")}}, "the constant g is nan"),
    ],
)
def test_a_structure_that_does_not_hold_together_is_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        simple(**change)


def test_a_parameter_that_stands_in_a_tie_only_is_used() -> None:
    structure = rate_model("rate.roll")
    mass = Parameter(name="I_xx", value=0.02, unit="kg m^2")
    with pytest.raises(ModelError, match="I_xx is in no matrix"):
        replace(structure, parameters=ParameterSet((*structure.parameters, mass)))
    tied = ParameterSet((*structure.parameters, mass)).tie("L_roll", "2/I_xx")
    assert replace(structure, parameters=tied).response(tied.values, OMEGA).shape == (1, 1, OMEGA.size)
    # A tie of a parameter that stands nowhere itself is of no use.
    lost = ParameterSet((*tied, Parameter(name="x", unit="1", tied=Expression.parse("I_xx"))))
    with pytest.raises(ModelError, match="x is in no matrix"):
        replace(structure, parameters=lost)


def test_a_dropped_parameter_may_stand_nowhere() -> None:
    structure = rate_model("rate.roll")
    extra = ParameterSet((*structure.parameters, Parameter(name="L_v", unit="rad/(m s)"))).drop("L_v")
    assert replace(structure, parameters=extra).parameters["L_v"].status == "dropped"


def test_an_entry_without_a_value_says_which() -> None:
    structure = replace(
        rate_model("rate.roll"), M=((Expression.parse("1"), ZERO), (ZERO, Expression.parse("1/T_motor")))
    )
    values = structure.parameters.values
    with pytest.raises(ModelError, match=r"1/T_motor has no finite value at T_motor = 0"):
        structure.response({**values, "T_motor": 0.0}, OMEGA)
    # The square root has a value at zero and no slope.
    structure = replace(structure, M=((Expression.parse("1"), ZERO), (ZERO, Expression.parse("sqrt(T_motor)"))))
    structure.response({**values, "T_motor": 0.0}, OMEGA)
    with pytest.raises(ModelError, match="has no finite value at T_motor = 0"):
        structure.response_and_jacobian({**values, "T_motor": 0.0}, OMEGA, np.eye(4))


def test_there_is_no_other_rate_model() -> None:
    with pytest.raises(ModelError, match=r"no model 'rate\.rol'; expected one of rate\.roll"):
        rate_model("rate.rol")


@pytest.mark.parametrize("name", RATE_AXES)
def test_rate_models_start_inside_their_bounds(name: str) -> None:
    structure = rate_model(name)
    for parameter in structure.parameters:
        assert all(parameter.lower <= start <= parameter.upper for start in parameter.starts)
    assert structure.gain in structure.parameters.names
