"""Propagation: what the parameters' covariance makes of poles and responses, against draws of the parameters."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from rotorid.errors import UsageError
from rotorid.models.library import rate_model
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.models.toml import from_toml
from rotorid.typing import ComplexArray, FloatArray
from rotorid.uncertainty.cramer_rao import Bounds
from rotorid.uncertainty.propagation import Pole, covariance_of_all, pole_confidence, response_confidence

DRAWS = 4000
# A standard deviation from n draws scatters by 1 / sqrt(2 n); four times that, and what curvature adds at 1 % errors.
TOLERANCE = 4.0 / np.sqrt(2.0 * DRAWS) + 0.02

OSCILLATOR = """
name = "oscillator"
inputs = ["u"]
states = ["x", "v"]
outputs = ["x"]
M = [[1, 0], [0, "m"]]
F = [[0, 1], ["-k", "-c"]]
G = [[0], ["b"]]
H0 = [[1, 0]]
input_delays = ["tau"]
"""


def oscillator(values: Mapping[str, float]) -> LinearStructure:
    return from_toml(OSCILLATOR + "".join(f"[parameters.{name}]\nvalue = {value}\n" for name, value in values.items()))


def limits(parameters: ParameterSet, covariance: FloatArray) -> Bounds:
    size = len(parameters.free)
    return Bounds(
        names=parameters.free,
        cramer_rao=np.ones(size),
        insensitivity=np.ones(size),
        covariance=covariance,
        random=covariance,
        colored=1.0,
    )


def correlated(parameters: ParameterSet, percent: float) -> Bounds:
    """Errors of a given percentage, each correlated with its neighbor."""
    std = np.abs(parameters.pack()) * percent / 100.0
    place = np.arange(len(std))
    return limits(parameters, np.outer(std, std) * 0.6 ** np.abs(place[:, None] - place))


def draws(parameters: ParameterSet, bounds: Bounds) -> list[dict[str, float]]:
    root = np.linalg.cholesky(bounds.covariance)
    noise = np.random.default_rng(1).standard_normal((DRAWS, len(root)))
    return [parameters.unpack(parameters.pack() + root @ row).values for row in noise]


def drawn_poles(
    structure: LinearStructure, parameters: ParameterSet, bounds: Bounds, nominal: ComplexArray
) -> ComplexArray:
    """Poles of every draw in the order of the nominal ones, shape ``(draws, poles)``."""
    rows = []
    for values in draws(parameters, bounds):
        poles = structure.matrices(values).poles()
        rows.append(poles[np.argmin(np.abs(nominal[:, None] - poles), axis=1)])
    return np.array(rows)


RATE = rate_model("rate.roll").parameters.with_values({"L_roll": 60.0, "L_p": -3.0, "T_motor": 0.05, "tau_roll": 0.012})
SPRING = {"m": 2.0, "k": 30.0, "c": 1.6, "b": 5.0, "tau": 0.03}


@pytest.mark.parametrize(
    ("structure", "parameters"),
    [
        (rate_model("rate.roll"), RATE),
        pytest.param(rate_model("rate.roll"), RATE.drop("T_motor"), marks=pytest.mark.slow),
        (oscillator(SPRING), oscillator(SPRING).parameters),
    ],
    ids=["real", "algebraic", "pair"],
)
def test_poles_scatter_as_predicted(structure: LinearStructure, parameters: ParameterSet) -> None:
    bounds = correlated(parameters, 1.0)
    poles = pole_confidence(structure, parameters, bounds)
    nominal = np.array([pole.value for pole in poles])
    drawn = drawn_poles(structure, parameters, bounds, nominal)
    expected = structure.matrices(parameters.values).poles()
    np.testing.assert_allclose(np.sort(nominal.real), np.sort(expected.real), rtol=1e-12)
    np.testing.assert_allclose(np.sort(nominal.imag), np.sort(expected.imag), rtol=1e-12)
    assert np.all(np.diff(np.abs(nominal)) >= -1e-9 * np.abs(nominal).max())
    for pole, column in zip(poles, drawn.T, strict=True):
        assert pole.covariance is not None
        scatter = np.cov(np.stack([column.real, column.imag]))
        np.testing.assert_allclose(np.sqrt(np.diag(pole.covariance)), np.sqrt(np.diag(scatter)), rtol=TOLERANCE)
        # A correlation from n draws scatters by no more than 1 / sqrt(n).
        size = np.sqrt(np.outer(np.diag(scatter), np.diag(scatter))).max(initial=1e-300)
        assert abs(pole.covariance[0, 1] - scatter[0, 1]) <= 4.0 * size / np.sqrt(DRAWS) + TOLERANCE * size
        assert pole.frequency_std_rad_s == pytest.approx(np.abs(column).std(), rel=TOLERANCE)
        damping = -column.real / np.abs(column)
        assert pole.damping_std == pytest.approx(damping.std(), rel=TOLERANCE, abs=1e-12)


def test_derivatives_of_an_oscillator_are_those_of_its_formula() -> None:
    r""":math:`\omega^2 = k/m`, :math:`\zeta = c / (2 \sqrt{k m})`, one parameter at a time."""
    structure = oscillator(SPRING)
    frequency = np.sqrt(SPRING["k"] / SPRING["m"])
    damping = SPRING["c"] / (2.0 * np.sqrt(SPRING["k"] * SPRING["m"]))
    expected = {"k": (0.5, -0.5), "m": (-0.5, -0.5), "c": (0.0, 1.0), "b": (0.0, 0.0), "tau": (0.0, 0.0)}
    for name, (of_frequency, of_damping) in expected.items():
        parameters = structure.parameters
        for other in set(SPRING) - {name}:
            parameters = parameters.fix(other, SPRING[other])
        relative = 1e-3
        bounds = limits(parameters, np.array([[(relative * SPRING[name]) ** 2]]))
        for pole in pole_confidence(structure, parameters, bounds):
            assert pole.frequency_rad_s == pytest.approx(frequency, rel=1e-12)
            assert pole.damping == pytest.approx(damping, rel=1e-12)
            assert pole.frequency_std_rad_s == pytest.approx(abs(of_frequency) * relative * frequency, abs=1e-12)
            assert pole.damping_std == pytest.approx(abs(of_damping) * relative * damping, abs=1e-12)


def nearest_moves(drawn: ComplexArray, nominal: ComplexArray) -> ComplexArray:
    """How far two poles went, whichever order brings them nearest, shape ``(draws, 2)``."""
    straight, crossed = drawn - nominal, drawn[:, ::-1] - nominal
    nearer = (np.abs(straight) ** 2).sum(axis=1) <= (np.abs(crossed) ** 2).sum(axis=1)
    return np.where(nearer[:, None], straight, crossed)


@pytest.mark.parametrize("share", [1.0, 1.0 - 1e-9, 1.0 + 1e-3, 1.0 - 4e-3])
def test_poles_that_may_meet_move_as_far_as_predicted(share: float) -> None:
    """Near critical damping the poles move like a square root of the parameters."""
    values = SPRING | {"c": 2.0 * np.sqrt(SPRING["k"] * SPRING["m"]) * share}
    structure = oscillator(values)
    bounds = correlated(structure.parameters, 1.0)
    poles = pole_confidence(structure, structure.parameters, bounds)
    assert len(poles) == 2
    nominal = np.array([pole.value for pole in poles])
    drawn = np.array([structure.matrices(row).poles() for row in draws(structure.parameters, bounds)])
    moves = nearest_moves(drawn, nominal)
    for pole, column in zip(poles, moves.T, strict=True):
        assert pole.meets
        assert pole.covariance is not None
        found = np.sqrt(np.diag(pole.covariance))
        # Which of two real poles one of a pair becomes has no meaning: both share their squares.
        columns = column if nominal[0].imag == 0.0 else moves
        scatter = np.sqrt([np.mean(columns.real**2), np.mean(columns.imag**2)])
        np.testing.assert_allclose(found, scatter, rtol=0.1)
        assert pole.frequency_std_rad_s is not None
        damping = -(pole.value + column).real / np.abs(pole.value + column)
        assert pole.damping_std == pytest.approx(np.sqrt(np.mean((damping - pole.damping) ** 2)), rel=0.7)
        assert "they may coincide" in pole.words()


TWO_AND_ONE = """
name = "chain"
inputs = ["u"]
states = ["x", "y", "z"]
outputs = ["z"]
M = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
F = [["-a", 0, 0], [1, "-b", 0], [0, 1, "-c"]]
G = [[1], [0], [0]]
H0 = [[0, 0, 1]]
"""


def test_a_double_pole_takes_no_errors_from_the_others() -> None:
    """A chain of lags, two of them equal: the third keeps its own error, the two move like a root."""
    text = TWO_AND_ONE + "".join(
        f"[parameters.{name}]\nvalue = {value}\n" for name, value in {"a": 3.0, "b": 3.0, "c": 20.0}.items()
    )
    structure = from_toml(text)
    std = np.array([0.03, 0.03, 0.2])
    poles = pole_confidence(structure, structure.parameters, limits(structure.parameters, np.diag(std**2)))
    one, two, alone = poles
    assert alone.value == pytest.approx(-20.0)
    assert not alone.meets
    assert alone.covariance is not None
    np.testing.assert_allclose(alone.covariance, np.diag([0.2**2, 0.0]), atol=1e-12)
    # The poles are -a and -b, in whichever order: the lower is -3 - |a - b| / 2 + ..., never complex.
    for pole in (one, two):
        assert pole.value == pytest.approx(-3.0, abs=1e-6)
        assert pole.meets
        assert pole.covariance is not None
        np.testing.assert_allclose(np.sqrt(np.diag(pole.covariance)), [0.03, 0.0], rtol=0.1, atol=2e-3)


def test_poles_that_one_parameter_moves_together_know_as_much_as_it() -> None:
    """Two motors with one lag T: two poles at -1/T, each known to std(T) / T^2."""
    text = """
name = "two motors"
inputs = ["a", "b"]
states = ["x", "y"]
outputs = ["x", "y"]
M = [["T", 0], [0, "T"]]
F = [[-1, 0], [0, -1]]
G = [[1, 0], [0, 1]]
H0 = [[1, 0], [0, 1]]
[parameters.T]
value = 0.048
"""
    structure = from_toml(text)
    poles = pole_confidence(structure, structure.parameters, limits(structure.parameters, np.array([[1e-6]])))
    assert len(poles) == 2
    for pole in poles:
        assert pole.value == pytest.approx(-1.0 / 0.048)
        assert pole.covariance is not None
        np.testing.assert_allclose(np.sqrt(np.diag(pole.covariance)), [1e-3 / 0.048**2, 0.0], rtol=0.02, atol=1e-9)


def test_a_triple_pole_of_certain_numbers_does_not_move() -> None:
    """Three integrators in a row that nothing makes uncertain."""
    text = TWO_AND_ONE.replace("G = [[1]", 'G = [["k"]') + "[parameters.k]\nvalue = 2.0\n"
    for name in "abc":
        text = text.replace(f'"-{name}"', "0")
    structure = from_toml(text)
    for pole in pole_confidence(structure, structure.parameters, correlated(structure.parameters, 1.0)):
        assert pole.covariance is not None
        assert np.abs(pole.covariance).max() < 1e-8


def test_two_pairs_that_may_meet_are_mirrored() -> None:
    text = """
name = "two springs"
inputs = ["u"]
states = ["x", "v", "y", "w"]
outputs = ["y"]
M = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
F = [[0, 1, 0, 0], ["-k", -1, 0, 0], [0, 0, 0, 1], [1, 0, "-l", -1]]
G = [[0], [1], [0], [0]]
H0 = [[0, 0, 1, 0]]
[parameters.k]
value = 25.0
[parameters.l]
value = 25.0
"""
    structure = from_toml(text)
    poles = pole_confidence(structure, structure.parameters, correlated(structure.parameters, 1.0))
    assert all(pole.meets for pole in poles)
    below = sorted((pole for pole in poles if pole.value.imag < 0.0), key=lambda pole: pole.value.real)
    above = sorted((pole for pole in poles if pole.value.imag > 0.0), key=lambda pole: pole.value.real)
    # k and l make their own pair each: the imaginary part is sqrt(k - 1/4), so 25 ± 0.25 moves it by 0.025.
    for low, high in zip(below, above, strict=True):
        assert low.covariance is not None
        assert high.covariance is not None
        np.testing.assert_allclose(low.covariance, high.covariance * [[1.0, -1.0], [-1.0, 1.0]], rtol=1e-9)
        assert np.sqrt(high.covariance[1, 1]) == pytest.approx(0.025, rel=0.1)


def test_poles_that_stay_apart_have_one() -> None:
    for share in (0.9, 1.1):
        values = SPRING | {"c": 2.0 * np.sqrt(SPRING["k"] * SPRING["m"]) * share}
        structure = oscillator(values)
        bounds = correlated(structure.parameters, 1.0)
        poles = pole_confidence(structure, structure.parameters, bounds)
        drawn = drawn_poles(structure, structure.parameters, bounds, np.array([pole.value for pole in poles]))
        # Not one draw crosses from a pair to two real poles or back.
        assert len({bool(one) for one in (drawn.imag == 0.0).ravel()}) == 1
        assert not any(pole.meets for pole in poles)


def test_a_pole_at_the_origin_has_no_damping() -> None:
    pole = Pole(value=0j, covariance=np.zeros((2, 2)))
    assert (pole.frequency_rad_s, pole.frequency_std_rad_s) == (0.0, 0.0)
    assert pole.damping is None
    assert pole.damping_std is None


def test_a_pole_in_words() -> None:
    pair = Pole(value=complex(1.871, 3.58), covariance=np.diag([0.01, 0.04]))
    assert pair.words().startswith("The pole at 1.871+3.58j 1/s has a natural frequency of 4.04 ± 0.18 rad/s")
    assert "damping ratio of −0.463 ± " in pair.words()


@pytest.mark.parametrize(
    ("structure", "parameters"),
    [(rate_model("rate.roll"), RATE), (oscillator(SPRING), oscillator(SPRING).parameters)],
    ids=["rate", "oscillator"],
)
def test_responses_scatter_as_predicted(structure: LinearStructure, parameters: ParameterSet) -> None:
    omega = np.array([0.5, 2.0, 10.0, 40.0])
    bounds = correlated(parameters, 1.0)
    magnitude, phase = response_confidence(structure, parameters, bounds, omega)
    assert magnitude.shape == phase.shape == (1, 1, 4)
    nominal = structure.response(parameters.values, omega)
    drawn = np.log(np.array([structure.response(values, omega) for values in draws(parameters, bounds)]) / nominal)
    np.testing.assert_allclose(magnitude, drawn.real.std(axis=0), rtol=TOLERANCE)
    np.testing.assert_allclose(phase, drawn.imag.std(axis=0), rtol=TOLERANCE)


def test_a_response_that_is_not_there_is_not_known() -> None:
    structure = oscillator(SPRING)
    parameters = structure.parameters.fix("b", 0.0)
    magnitude, phase = response_confidence(structure, parameters, correlated(parameters, 1.0), np.array([1.0, 2.0]))
    assert np.all(np.isinf(magnitude))
    assert np.all(np.isinf(phase))


def test_what_the_data_do_not_see_does_not_blur_the_response() -> None:
    """Mass, spring, damper and force scaled together change nothing: known to 1e6, the response to a percent."""
    structure = oscillator(SPRING)
    parameters = structure.parameters
    flat = parameters.pack() * np.array([1.0, 1.0, 1.0, 1.0, 0.0])
    known = correlated(parameters, 1.0).covariance
    bounds = limits(parameters, known + 1e12 * np.outer(flat, flat))
    omega = np.array([0.5, 4.0, 10.0])
    magnitude, _ = response_confidence(structure, parameters, bounds, omega)
    assert magnitude.max() < 0.2
    for pole in pole_confidence(structure, parameters, bounds):
        assert pole.frequency_std_rad_s is not None
        assert pole.frequency_std_rad_s < 0.05 * pole.frequency_rad_s


def test_tied_parameters_share_the_covariance() -> None:
    structure = oscillator(SPRING)
    parameters = structure.parameters.tie("b", "3*k").fix("tau", 0.03)
    bounds = correlated(parameters, 1.0)
    assert bounds.names == ("m", "k", "c")
    total = covariance_of_all(parameters, bounds)
    names = parameters.names
    k, b, tau = (names.index(name) for name in ("k", "b", "tau"))
    assert total.shape == (5, 5)
    np.testing.assert_allclose(total[:3, :3], bounds.covariance, rtol=1e-12)
    assert total[b, b] == pytest.approx(9.0 * total[k, k], rel=1e-12)
    assert total[b, k] == pytest.approx(3.0 * total[k, k], rel=1e-12)
    assert not total[tau].any()


def test_bounds_of_another_problem_are_refused() -> None:
    structure = oscillator(SPRING)
    bounds = correlated(structure.parameters, 1.0)
    other = structure.parameters.fix("tau", 0.03)
    with pytest.raises(UsageError, match=r"the bounds are for m, k, c, b, tau; expected bounds of m, k, c, b\."):
        covariance_of_all(other, bounds)
    with pytest.raises(UsageError):
        response_confidence(structure, other, bounds, np.ones(1))
    with pytest.raises(UsageError):
        pole_confidence(structure, other, bounds)


@pytest.mark.parametrize("seed", range(3))
def test_signs_that_rounding_chooses_move_no_error(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    structure = oscillator(SPRING | {"c": 2.0 * np.sqrt(SPRING["k"] * SPRING["m"]) * 0.996})
    bounds = correlated(structure.parameters, 1.0)
    before = pole_confidence(structure, structure.parameters, bounds)
    eigh, svd, random = np.linalg.eigh, np.linalg.svd, np.random.default_rng(seed)

    def turned_eigh(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
        of, vectors = eigh(matrix)
        return of, vectors * random.choice([-1.0, 1.0], of.size)

    def turned_svd(matrix: FloatArray, **options: bool) -> tuple[FloatArray, ...]:
        left, sizes, right = svd(matrix, **options)
        signs = random.choice([-1.0, 1.0], sizes.size)
        return (left * signs, sizes, right * signs[:, None]) if options else (left, sizes, right)

    monkeypatch.setattr(np.linalg, "eigh", turned_eigh)
    monkeypatch.setattr(np.linalg, "svd", turned_svd)
    after = pole_confidence(structure, structure.parameters, bounds)
    for one, other in zip(before, after, strict=True):
        assert one.covariance is not None
        assert other.covariance is not None
        np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-6, atol=1e-12)
