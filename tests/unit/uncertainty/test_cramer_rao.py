"""Bounds: CIFER's definitions, and a standard deviation that is one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.response import FrequencyResponse
from rotorid.errors import InsufficientDataError
from rotorid.fits.scatter import widened
from rotorid.fitting.frequency.error_shapes import smooth_columns
from rotorid.fitting.frequency.fit import fit_frequency
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.fitting.problem import Part
from rotorid.models.expression import Expression
from rotorid.models.library import rate_model
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.typing import ComplexArray, FloatArray
from rotorid.uncertainty.cramer_rao import Bounds, bounds, bounds_of_parts, colored_of
from rotorid.uncertainty.identifiability import Combination, unseen_combinations

OMEGA = np.geomspace(1.5, 50.0, 40)
TRUTH = {"L_roll": 60.0, "L_p": -3.0, "T_motor": 0.05, "tau_roll": 0.012}
STRUCTURE = rate_model("rate.roll")
EXACT = STRUCTURE.response(TRUTH, OMEGA)[0, 0]
SIZES = 40
LEVEL = 0.03
FITS = 400


def colored_covariance() -> ComplexArray:
    """Neighbors share two thirds of their error, with a phase between them, as overlapping windows have it."""
    steps = np.arange(OMEGA.size)
    distance = steps[:, None] - steps
    relative = LEVEL**2 * 2.0 * (2.0 / 3.0) ** np.abs(distance) * np.exp(0.4j * distance)
    return np.asarray(EXACT[:, None] * relative * EXACT.conj())


def response(values: ComplexArray, covariance: ComplexArray | None = None) -> FrequencyResponse:
    shape = (1, 1, OMEGA.size)
    return FrequencyResponse(
        omega_rad_s=OMEGA,
        values=values.reshape(shape),
        coherence=np.full(shape, 0.95),
        random_error=np.full(shape, LEVEL),
        covariance=(colored_covariance() if covariance is None else covariance)[None, None],
        inputs=STRUCTURE.inputs,
        outputs=STRUCTURE.outputs,
        estimate="direct",
    )


def problem(data: FrequencyResponse, structure: LinearStructure = STRUCTURE) -> FrequencyProblem:
    return FrequencyProblem(
        structure=structure, parameters=structure.parameters, data=data, used=np.ones(data.values.shape, dtype=bool)
    )


def draw(rng: np.random.Generator) -> ComplexArray:
    """Exact response with a circular error of the stated covariance, E[d d*] = C and E[d d^T] = 0."""
    root = np.linalg.cholesky(colored_covariance())
    white = (rng.standard_normal(OMEGA.size) + 1j * rng.standard_normal(OMEGA.size)) / np.sqrt(2.0)
    return np.asarray(EXACT + root @ white)


@pytest.fixture(scope="module")
def fits() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Errors and random standard deviations, each ``(fits, parameters)``, and sizes of the model error."""
    rng = np.random.default_rng(11)
    errors, spreads = [], []
    sizes: list[FloatArray] = []
    start = [np.array([50.0, -2.0, 0.04, 0.02])]
    for run in range(FITS):
        posed = problem(response(draw(rng)))
        solution = fit_frequency(posed, starts=start)
        limits = bounds(posed, solution, model_errors=run < SIZES)
        errors.append(solution.theta - np.array(list(TRUTH.values())))
        spreads.append(limits.random_std)
        if limits.model_error is not None:
            sizes.append(*limits.model_error.sizes.values())
    return np.array(errors), np.array(spreads), np.array(sizes)


def test_intervals_of_95_percent_cover_95_percent(fits: tuple[FloatArray, FloatArray, FloatArray]) -> None:
    errors, spreads, _ = fits
    covered = np.mean(np.abs(errors) <= 1.96 * spreads, axis=0)
    # Binomial scatter of 400 fits is 1.1 %. The twin is linear: it has no model error, and random errors are all.
    assert np.all(covered >= 0.95 - 0.035)
    assert np.all(covered <= 0.985)


def test_spread_of_the_fits_is_the_predicted_one(fits: tuple[FloatArray, FloatArray, FloatArray]) -> None:
    errors, spreads, _ = fits
    # A standard deviation from n fits scatters by 1 / sqrt(2 n): four times that, and 3 % for the curved model.
    tolerance = 4.0 / np.sqrt(2.0 * FITS) + 0.03
    np.testing.assert_allclose(errors.std(axis=0), np.median(spreads, axis=0), rtol=tolerance)
    assert np.all(np.abs(errors.mean(axis=0)) <= 5.0 * errors.std(axis=0) / np.sqrt(FITS) + 0.1 * spreads.mean(axis=0))


def test_a_structure_that_holds_has_hardly_a_model_error(fits: tuple[FloatArray, FloatArray, FloatArray]) -> None:
    sizes = fits[2]
    assert sizes.min() < 0.001
    # Random errors of 5 % hide a model error of one.
    assert np.median(sizes) < 0.01


@pytest.mark.parametrize("size", [0.03, 0.1])
def test_model_error_is_found_at_its_size_and_widens_what_is_stated(size: float) -> None:
    """Smooth errors of magnitude and phase that no parameter of the structure knows."""
    rng = np.random.default_rng(3)
    columns = smooth_columns(np.log(OMEGA))
    found = []
    for _ in range(12):
        error = columns @ (rng.standard_normal((columns.shape[1], 2)) @ np.array([1.0, 1j]))
        posed = problem(response(draw(rng) * np.exp(size * error)))
        found.append(bounds(posed, fit_frequency(posed)))
    sizes = [error for limits in found if limits.model_error for error in limits.model_error.sizes.values()]
    # The root mean square of a dozen sizes, each from some six numbers.
    assert np.sqrt(np.mean(np.square(sizes))) == pytest.approx(size, rel=0.35)
    for limits in found:
        np.testing.assert_allclose(limits.std**2, limits.random_std**2 + limits.model_std**2)


def test_a_clock_within_a_sample_is_part_of_a_delay() -> None:
    posed = problem(replace(response(draw(np.random.default_rng(3))), sample_rate_hz=100.0))
    delay = posed.parameters.free.index("tau_roll")
    known = bounds(problem(posed.data), fit_frequency(posed)).model_std[delay]
    plain = problem(replace(posed.data, sample_rate_hz=None))
    without = bounds(plain, fit_frequency(plain)).model_std[delay]
    # Input and output are each known to 0.15 of 10 ms.
    assert np.sqrt(known**2 - without**2) == pytest.approx(np.sqrt(2.0) * 0.0015, rel=0.05)


def test_color_matters() -> None:
    """The same errors taken as independent promise too much: this is what the covariance is for."""
    colored = colored_covariance()
    rng = np.random.default_rng(4)
    values = draw(rng)
    posed = problem(response(values)), problem(response(values, np.diag(np.diag(colored))))
    spreads = [bounds(p, fit_frequency(p)) for p in posed]
    assert spreads[0].random_std[0] > 1.3 * spreads[1].random_std[0]


def test_cramer_rao_and_insensitivity_are_those_of_the_cost() -> None:
    """Against the Hessian of the cost by second differences, at a minimum of zero, where Gauss-Newton is exact."""
    posed = problem(response(EXACT))
    theta = np.array(list(TRUTH.values()))
    solution = replace(fit_frequency(posed), theta=theta)
    solution = replace(solution, residual=posed.residuals(theta)[0], jacobian=posed.residuals(theta)[1])
    limits = bounds(posed, solution)
    # Steps of 1e-3: truncation of the fourth derivative and rounding are both below 1e-4.
    steps = np.diag(1e-3 * np.abs(theta))

    def cost(at: FloatArray) -> float:
        return float(posed.costs(at).sum())

    hessian = np.array(
        [
            [
                (cost(theta + a + b) - cost(theta + a - b) - cost(theta - a + b) + cost(theta - a - b))
                / (4.0 * a.sum() * b.sum())
                for b in steps
            ]
            for a in steps
        ]
    )
    np.testing.assert_allclose(limits.insensitivity, 1.0 / np.sqrt(np.diag(hessian)), rtol=1e-3)
    np.testing.assert_allclose(limits.cramer_rao, 2.0 * np.sqrt(np.diag(np.linalg.inv(hessian))), rtol=1e-2)


def test_units_of_the_parameters_do_not_matter() -> None:
    data = response(draw(np.random.default_rng(5)))
    factor = 2.0**40
    scaled = replace(
        STRUCTURE,
        F=(
            (Expression.parse("L_p"), Expression.parse(f"{factor}*L_roll")),
            STRUCTURE.F[1],
        ),
    )
    posed, other = problem(data), problem(data, scaled)
    solution = fit_frequency(posed)
    theta = solution.theta / np.array([factor, 1.0, 1.0, 1.0])
    moved = other.residuals(theta)
    np.testing.assert_allclose(moved[0], solution.residual, atol=1e-9)
    one = bounds(posed, solution)
    two = bounds(other, replace(solution, theta=theta, residual=moved[0], jacobian=moved[1]))
    ratio = np.array([factor, 1.0, 1.0, 1.0])
    for name in ("std", "cramer_rao", "insensitivity"):
        np.testing.assert_allclose(getattr(one, name), getattr(two, name) * ratio, rtol=1e-6)
    np.testing.assert_allclose(one.correlation, two.correlation, atol=1e-6)


def inertia_structure() -> LinearStructure:
    """Only the ratio L / J is in the data, as in a rig whose inertia and rotor constant are both unknown."""
    zero, one = Expression(), Expression.parse(1)
    return LinearStructure(
        name="rig",
        inputs=STRUCTURE.inputs,
        states=("p", "motor"),
        outputs=STRUCTURE.outputs,
        M=((Expression.parse("J"), zero), (zero, Expression.parse("T_motor"))),
        F=((zero, Expression.parse("K")), (zero, Expression.parse("-1"))),
        G=((zero,), (one,)),
        H0=((one, zero),),
        H1=((zero, zero),),
        input_delays=(zero,),
        output_delays=(zero,),
        parameters=ParameterSet(
            (
                Parameter(name="J", value=0.02, unit="kg m^2", lower=1e-6),
                Parameter(name="K", value=1.0, unit="N m"),
                Parameter(name="T_motor", value=0.04, unit="s", lower=0.0),
            )
        ),
        gain="K",
    )


def test_a_pair_that_cannot_be_told_apart_is_named() -> None:
    structure = inertia_structure()
    values = structure.response({"J": 0.02, "K": 1.2, "T_motor": 0.05}, OMEGA)
    posed = problem(response(values.ravel()), structure)
    solution = fit_frequency(posed)
    limits = bounds(posed, solution)
    found = unseen_combinations(posed.parameters.unpack(solution.theta), limits)
    assert len(found) == 1
    # Along the flat direction both change by the same percentage, and the lag not at all.
    shares = found[0].vector
    assert abs(shares["J"]) == pytest.approx(np.sqrt(0.5), abs=1e-3)
    assert shares["J"] == pytest.approx(shares["K"], abs=1e-3)
    assert shares["T_motor"] == pytest.approx(0.0, abs=1e-3)
    assert found[0].relative_std > 1e3
    assert found[0].words().startswith("The data show only K/J = ")
    assert limits.insensitivity[0] < 1e-3 * limits.cramer_rao[0]


def test_what_is_seen_is_not_named() -> None:
    posed = problem(response(EXACT))
    solution = fit_frequency(posed)
    assert unseen_combinations(posed.parameters.unpack(solution.theta), bounds(posed, solution)) == ()


def test_a_parameter_without_effect_is_refused_by_name() -> None:
    structure = inertia_structure()
    posed = problem(response(EXACT), structure)
    solution = fit_frequency(posed)
    blind = solution.jacobian * np.array([1.0, 1.0, 0.0])
    with pytest.raises(InsufficientDataError, match="T_motor has no effect on the fitted responses"):
        bounds(posed, replace(solution, jacobian=blind))


@pytest.mark.parametrize(
    ("vector", "start"),
    [
        ({"a": 1.0, "b": 0.0}, "a is very uncertain (±70 %)"),
        ({"a": 0.6, "b": -0.8}, "a and b can barely be separated"),
        ({"a": 0.577, "b": 0.577, "c": 0.577}, "a, b and c can barely be separated"),
        ({f"p{k}": 0.25 for k in range(16)}, "p0, p1, p2"),
    ],
)
def test_words_name_the_parts_that_matter(vector: dict[str, float], start: str) -> None:
    assert Combination(vector=vector, relative_std=0.7).words().startswith(start)


def test_parameters_that_do_the_same_are_named_and_no_others() -> None:
    rng = np.random.default_rng(3)
    slopes = rng.standard_normal((400, 1, 3))
    slopes[:, :, 2] = -slopes[:, :, 0]
    part = Part(rng.standard_normal((400, 1)), slopes, np.full((400, 1, 1), 400**-0.5))
    with pytest.raises(InsufficientDataError) as refused:
        bounds_of_parts([part], ("T_zero", "omega", "tau"))
    assert [finding.where for finding in refused.value.findings] == ["T_zero", "tau"]


def test_inflation_is_that_of_the_covariances_whatever_was_added() -> None:
    covariance, flat = np.diag([4.0, 1.0]), np.ones(2)
    found = Bounds(names=("a", "b"), cramer_rao=flat, insensitivity=flat, covariance=covariance, random=covariance)
    assert found.inflation == pytest.approx(1.0)
    wider = widened(found, {"a": 12.0**0.5})
    assert wider.inflation == pytest.approx(2.0**0.5)
    assert widened(replace(found, colored=1.7), {"a": 12.0**0.5}).inflation == 1.7
    both = [wider, replace(found, colored=1.7)]
    assert colored_of(both) == pytest.approx((2.0**0.5 * 1.7) ** 0.5)
    assert colored_of(both[:1]) is None
