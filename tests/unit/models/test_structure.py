"""Structures: exact derivatives against the complex step, and the frequency response against the time response."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.errors import ModelError
from rotorid.models.entry import Entry, affine_tensor
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.rate import RATE_AXES, rate_model
from rotorid.models.structure import LinearStructure
from rotorid.simulate.linear import simulate_linear
from rotorid.typing import ComplexArray, FloatArray

OMEGA = np.geomspace(0.1, 200.0, 40)
NAMES = ("a", "b", "c", "d", "e")


def random_structure(seed: int) -> LinearStructure:
    """A coupled system of random shape, whose every matrix and delay is an affine function of shared parameters."""
    rng = np.random.default_rng(seed)
    x, u, y = (int(rng.integers(1, high)) for high in (5, 4, 4))

    def entry(constant: float, scale: float) -> Entry:
        names = rng.choice(NAMES, size=2, replace=False)
        return Entry(constant=constant, terms=tuple((str(n), float(scale * rng.standard_normal())) for n in names))

    def rows(count: int, width: int, diagonal: float = 0.0) -> tuple[tuple[Entry, ...], ...]:
        return tuple(
            tuple(entry(diagonal * (i == j) + 0.3 * rng.standard_normal(), 0.3) for j in range(width))
            for i in range(count)
        )

    every = Entry(constant=0.02, terms=tuple((name, 0.01) for name in NAMES))
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
        parameters=ParameterSet(
            tuple(Parameter(name=name, value=float(rng.standard_normal()), unit="1") for name in NAMES)
        ),
    )


def complex_step(structure: LinearStructure, values: dict[str, float], name: str, omega: FloatArray) -> ComplexArray:
    r"""Derivative of the response by a step of :math:`10^{-30} i` in one parameter: exact, nothing cancels.

    The response is complex itself, so its own unit must not mix with that of the step: it is written as the real
    matrix [[0, -1], [1, 0]], every entry of the system becomes a block of two by two, and the formula stays the same.
    """
    step, names = 1e-30, tuple(values)
    vector = np.array([1.0, *(value + 1j * step * (n == name) for n, value in values.items())])
    x, u, y = len(structure.states), len(structure.inputs), len(structure.outputs)
    shapes = {"M": (x, x), "F": (x, x), "G": (x, u), "H0": (y, x), "H1": (y, x)}
    M, F, G, H0, H1 = (
        np.tensordot(vector, affine_tensor(getattr(structure, matrix), names, shape), axes=1)
        for matrix, shape in shapes.items()
    )
    tau_u = np.tensordot(vector, affine_tensor([structure.input_delays], names, (1, u)), axes=1)[0]
    tau_y = np.tensordot(vector, affine_tensor([structure.output_delays], names, (1, y)), axes=1)[0]
    one, unit = np.eye(2), np.array([[0.0, -1.0], [1.0, 0.0]])
    derivative = np.empty((y, u, omega.size), dtype=np.complex128)
    for point, w in enumerate(omega):
        states = np.linalg.solve(w * np.kron(M, unit) - np.kron(F, one), np.kron(G, one))
        blocks = ((np.kron(H0, one) + w * np.kron(H1, unit)) @ states).reshape(y, 2, u, 2)
        for i, k in np.ndindex(y, u):
            angle = w * (tau_y[i] + tau_u[k])
            block = blocks[i, :, k] @ (np.cos(angle) * one - np.sin(angle) * unit)
            derivative[i, k, point] = complex(block[0, 0].imag, block[1, 0].imag) / step
    return derivative


@pytest.mark.parametrize("seed", range(12))
def test_jacobian_of_random_structures_against_the_complex_step(seed: int) -> None:
    structure = random_structure(seed)
    values = structure.parameters.values
    response, jacobian = structure.response_and_jacobian(values, OMEGA, np.eye(len(NAMES)))
    np.testing.assert_allclose(response, structure.response(values, OMEGA), rtol=1e-10)
    assert jacobian.shape == (len(NAMES), *response.shape)
    for slot, name in enumerate(NAMES):
        exact = complex_step(structure, values, name, OMEGA)
        assert np.abs(jacobian[slot] - exact).max() <= 1e-9 * np.abs(exact).max()


@pytest.mark.parametrize("name", RATE_AXES)
@pytest.mark.parametrize("lag", [0.0, 0.05])
def test_jacobian_of_rate_models_against_the_complex_step(name: str, lag: float) -> None:
    axis, structure = RATE_AXES[name], rate_model(name)
    values = {axis.gain: -42.0, axis.damping: -1.7, "T_motor": lag, axis.delay: 0.011}
    _, jacobian = structure.response_and_jacobian(values, OMEGA, structure.parameters.directions)
    for slot, parameter in enumerate(values):
        exact = complex_step(structure, values, parameter, OMEGA)
        np.testing.assert_allclose(jacobian[slot], exact, rtol=1e-9)


def test_jacobian_along_a_direction_is_the_mixture_of_its_parameters() -> None:
    structure = random_structure(3)
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
    system = rate_model(name).matrices({axis.gain: 60.0, axis.damping: -3.0, "T_motor": lag, axis.delay: 0.0137})
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


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"G": ((Entry(),),)}, "matrix G is 1 x 1; needed: 2 rows of 1 entries"),
        ({"F": ((Entry(),), (Entry(), Entry()))}, "matrix F is 2 x 1/2"),
        ({"input_delays": ()}, "1 input and 1 output delays"),
        ({"input_delays": (Entry(),)}, "tau_roll stands in no matrix"),
        ({"input_delays": (Entry.parse("tau_rol"),)}, "tau_roll stands in no matrix"),
        ({"output_delays": (Entry.parse("tau"),)}, "rate.roll names tau, which is no parameter of it"),
        ({"gain": "L_rol"}, "names L_rol"),
        ({"optional": ("T_moto",)}, "names T_moto"),
    ],
)
def test_a_structure_that_does_not_hold_together_is_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        simple(**change)


def test_there_is_no_other_rate_model() -> None:
    with pytest.raises(ModelError, match=r"no model 'rate\.rol'; needed: one of rate\.roll"):
        rate_model("rate.rol")


@pytest.mark.parametrize("name", RATE_AXES)
def test_rate_models_start_inside_their_bounds(name: str) -> None:
    structure = rate_model(name)
    for parameter in structure.parameters:
        assert all(parameter.lower <= start <= parameter.upper for start in parameter.starts)
    assert structure.gain in structure.parameters.names
