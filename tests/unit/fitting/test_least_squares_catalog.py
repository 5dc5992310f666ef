"""Local solvers on problems with known minima (Moré, Garbow and Hillstrom, *Testing Unconstrained Optimization
Software*, ACM TOMS 1981; Hock and Schittkowski, *Test Examples for Nonlinear Programming Codes*, 1981).

A new solver is one line in ``SOLVERS``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from rotorid.fitting.least_squares import LevenbergMarquardt, Outcome, Residuals
from rotorid.typing import FloatArray

SOLVERS = (LevenbergMarquardt(iterations=1000),)


@dataclass(frozen=True, kw_only=True)
class Known:
    """A sum of squares with a minimum from the literature; ``at`` is empty where the minimum is no single point."""

    name: str
    residuals: Callable[[FloatArray], FloatArray]
    start: tuple[float, ...]
    minimum: float
    at: tuple[float, ...] = ()
    lower: tuple[float, ...] = ()
    upper: tuple[float, ...] = ()


def stack(*terms: FloatArray) -> FloatArray:
    return np.array(terms)


def bard(x: FloatArray) -> FloatArray:
    y = np.array([0.14, 0.18, 0.22, 0.25, 0.29, 0.32, 0.35, 0.39, 0.37, 0.58, 0.73, 0.96, 1.34, 2.10, 4.39])
    u = np.arange(1.0, 16.0)
    return y - (x[0] + u / ((16.0 - u) * x[1] + np.minimum(u, 16.0 - u) * x[2]))


def gaussian(x: FloatArray) -> FloatArray:
    rise = [0.0009, 0.0044, 0.0175, 0.0540, 0.1295, 0.2420, 0.3521]
    y = np.array([*rise, 0.3989, *rise[::-1]])
    t = (8.0 - np.arange(1.0, 16.0)) / 2.0
    return x[0] * np.exp(-x[1] * (t - x[2]) ** 2 / 2.0) - y


def kowalik(x: FloatArray) -> FloatArray:
    y = np.array([0.1957, 0.1947, 0.1735, 0.1600, 0.0844, 0.0627, 0.0456, 0.0342, 0.0323, 0.0235, 0.0246])
    u = np.array([4.0, 2.0, 1.0, 0.5, 0.25, 0.167, 0.125, 0.1, 0.0833, 0.0714, 0.0625])
    return y - x[0] * (u**2 + u * x[1]) / (u**2 + u * x[2] + x[3])


def meyer(x: FloatArray) -> FloatArray:
    y = np.array(
        [34780, 28610, 23650, 19630, 16370, 13720, 11540, 9744, 8261, 7030, 6005, 5147, 4427, 3820, 3307, 2872]
    )
    return x[0] * np.exp(x[1] / (45.0 + 5.0 * np.arange(1, 17) + x[2])) - y


def jennrich(x: FloatArray) -> FloatArray:
    i = np.arange(1.0, 11.0)
    return 2.0 + 2.0 * i - (np.exp(i * x[0]) + np.exp(i * x[1]))


def helical(x: FloatArray) -> FloatArray:
    turn = np.arctan(x[1] / x[0]) / (2.0 * np.pi) + (0.5 if x[0].real < 0.0 else 0.0)
    return stack(10.0 * (x[2] - 10.0 * turn), 10.0 * (np.sqrt(x[0] ** 2 + x[1] ** 2) - 1.0), x[2])


def rosenbrock(x: FloatArray) -> FloatArray:
    return stack(10.0 * (x[1] - x[0] ** 2), 1.0 - x[0])


def wood(x: FloatArray) -> FloatArray:
    return stack(
        10.0 * (x[1] - x[0] ** 2),
        1.0 - x[0],
        np.sqrt(90.0) * (x[3] - x[2] ** 2),
        1.0 - x[2],
        np.sqrt(10.0) * (x[1] + x[3] - 2.0),
        (x[1] - x[3]) / np.sqrt(10.0),
    )


def powell_singular(x: FloatArray) -> FloatArray:
    return stack(
        x[0] + 10.0 * x[1], np.sqrt(5.0) * (x[2] - x[3]), (x[1] - 2.0 * x[2]) ** 2, np.sqrt(10.0) * (x[0] - x[3]) ** 2
    )


def beale(x: FloatArray) -> FloatArray:
    return np.array([1.5, 2.25, 2.625]) - x[0] * (1.0 - x[1] ** np.array([1, 2, 3]))


def freudenstein(x: FloatArray) -> FloatArray:
    return stack(-13.0 + x[0] + ((5.0 - x[1]) * x[1] - 2.0) * x[1], -29.0 + x[0] + ((x[1] + 1.0) * x[1] - 14.0) * x[1])


def brown(x: FloatArray) -> FloatArray:
    return stack(x[0] - 1e6, x[1] - 2e-6, x[0] * x[1] - 2.0)


def powell_badly_scaled(x: FloatArray) -> FloatArray:
    return stack(1e4 * x[0] * x[1] - 1.0, np.exp(-x[0]) + np.exp(-x[1]) - 1.0001)


def box(x: FloatArray) -> FloatArray:
    t = 0.1 * np.arange(1.0, 11.0)
    return np.exp(-t * x[0]) - np.exp(-t * x[1]) - x[2] * (np.exp(-t) - np.exp(-10.0 * t))


INFINITY = float("inf")
CATALOG = (
    Known(name="Rosenbrock", residuals=rosenbrock, start=(-1.2, 1.0), minimum=0.0, at=(1.0, 1.0)),
    Known(name="Freudenstein", residuals=freudenstein, start=(6.0, 5.0), minimum=0.0, at=(5.0, 4.0)),
    Known(name="Freudenstein, local", residuals=freudenstein, start=(0.5, -2.0), minimum=48.9842536792),
    Known(name="Powell badly scaled", residuals=powell_badly_scaled, start=(0.0, 1.0), minimum=0.0),
    Known(name="Brown badly scaled", residuals=brown, start=(1.0, 1.0), minimum=0.0, at=(1e6, 2e-6)),
    Known(name="Beale", residuals=beale, start=(1.0, 1.0), minimum=0.0, at=(3.0, 0.5)),
    Known(name="Jennrich and Sampson", residuals=jennrich, start=(0.3, 0.4), minimum=124.3621823556),
    Known(name="Helical valley", residuals=helical, start=(-1.0, 0.0, 0.0), minimum=0.0, at=(1.0, 0.0, 0.0)),
    Known(name="Bard", residuals=bard, start=(1.0, 1.0, 1.0), minimum=8.214877306579e-3),
    Known(name="Gaussian", residuals=gaussian, start=(0.4, 1.0, 0.0), minimum=1.127932769e-8),
    Known(name="Meyer", residuals=meyer, start=(0.02, 4000.0, 250.0), minimum=87.94585517),
    Known(name="Box", residuals=box, start=(0.0, 10.0, 20.0), minimum=0.0),
    Known(name="Powell singular", residuals=powell_singular, start=(3.0, -1.0, 0.0, 1.0), minimum=0.0),
    Known(name="Wood", residuals=wood, start=(-3.0, -1.0, -3.0, -1.0), minimum=0.0, at=(1.0,) * 4),
    Known(name="Kowalik and Osborne", residuals=kowalik, start=(0.25, 0.39, 0.415, 0.39), minimum=3.0750560385e-4),
    Known(
        name="Rosenbrock below 0.5",
        residuals=rosenbrock,
        start=(-1.2, 1.0),
        minimum=0.25,
        at=(0.5, 0.25),
        upper=(0.5, INFINITY),
    ),
    Known(
        name="Hock and Schittkowski 1",
        residuals=rosenbrock,
        start=(-2.0, 1.0),
        minimum=0.0,
        at=(1.0, 1.0),
        lower=(-INFINITY, -1.5),
    ),
    Known(
        name="Hock and Schittkowski 2",
        residuals=rosenbrock,
        start=(2.0, 1.0),
        minimum=0.0504261879,
        at=(1.22437075, 1.5),
        lower=(-INFINITY, 1.5),
    ),
    Known(
        name="Beale in a corner",
        residuals=beale,
        start=(1.0, -0.5),
        minimum=0.703125,
        at=(2.0, 0.0),
        lower=(0.0, -1.0),
        upper=(2.0, 0.0),
    ),
)


def differentiated(known: Known, scale: FloatArray) -> Residuals:
    """Residuals of scaled parameters with their Jacobian by the complex step; the problems are analytic."""

    def evaluate(theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        x = theta * scale
        steps = 1e-30 * np.eye(x.size)
        columns = [known.residuals(x + 1j * step).imag / 1e-30 for step in steps]
        return known.residuals(x.astype(np.complex128)).real, np.stack(columns, axis=1) * scale

    return evaluate


def box_of(known: Known, scale: FloatArray) -> tuple[FloatArray, FloatArray]:
    size = len(known.start)
    lower = np.array(known.lower or (-INFINITY,) * size) / scale
    upper = np.array(known.upper or (INFINITY,) * size) / scale
    return lower, upper


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: type(solver).__name__)
@pytest.mark.parametrize("known", CATALOG, ids=lambda known: known.name)
def test_known_minima_are_found(known: Known, solver: LevenbergMarquardt) -> None:
    scale = np.ones(len(known.start))
    start, box = np.array(known.start), box_of(known, scale)
    solution = solver.minimize(differentiated(known, scale), start, *box)
    assert solution.outcome is Outcome.CONVERGED
    # Published to ten digits or so; a minimum of zero is reached as far as the solver's absolute tolerance goes.
    assert solution.cost == pytest.approx(known.minimum, rel=1e-7, abs=1e-12)
    assert np.all(solution.theta >= box[0])
    assert np.all(solution.theta <= box[1])
    if known.at:
        np.testing.assert_allclose(solution.theta, known.at, rtol=1e-5, atol=1e-6)
    assert list(solution.trace) == sorted(solution.trace, reverse=True)
    residual, jacobian = differentiated(known, scale)(solution.theta)
    np.testing.assert_array_equal(solution.residual, residual)
    np.testing.assert_array_equal(solution.jacobian, jacobian)


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: type(solver).__name__)
@pytest.mark.parametrize("known", CATALOG, ids=lambda known: known.name)
def test_units_of_the_parameters_do_not_matter(known: Known, solver: LevenbergMarquardt) -> None:
    """Scaled by powers of two, so that nothing rounds differently: the very same path, in other units."""
    size = len(known.start)
    scale = np.exp2(np.array([40.0, -33.0, 21.0, -50.0])[:size])
    plain = solver.minimize(differentiated(known, np.ones(size)), np.array(known.start), *box_of(known, np.ones(size)))
    scaled = solver.minimize(differentiated(known, scale), np.array(known.start) / scale, *box_of(known, scale))
    assert scaled.outcome is plain.outcome
    assert scaled.cost == pytest.approx(plain.cost, rel=1e-6, abs=1e-12)
    # The first steps agree to the rounding of the linear solver; later a valley may magnify it.
    np.testing.assert_allclose(scaled.trace[:5], plain.trace[:5], rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda solver: type(solver).__name__)
class TestOutcomes:
    def test_a_start_at_the_minimum_stays_there(self, solver: LevenbergMarquardt) -> None:
        solution = solver.minimize(differentiated(CATALOG[0], np.ones(2)), np.ones(2), *box_of(CATALOG[0], np.ones(2)))
        assert (solution.outcome, solution.evaluations, solution.cost) == (Outcome.CONVERGED, 1, 0.0)

    def test_a_start_outside_the_box_is_brought_to_its_edge(self, solver: LevenbergMarquardt) -> None:
        wall = np.array([-2.0, -2.0]), np.array([-1.5, -1.0])
        solution = solver.minimize(differentiated(CATALOG[0], np.ones(2)), np.array([9.0, 9.0]), *wall)
        # On x1 = -1.5 the valley lies at x2 = 2.25, above the box.
        assert solution.at_bound == (True, True)
        np.testing.assert_array_equal(solution.theta, [-1.5, -1.0])

    def test_a_wrong_jacobian_is_no_convergence(self, solver: LevenbergMarquardt) -> None:
        right = differentiated(CATALOG[0], np.ones(2))

        def wrong(theta: FloatArray) -> tuple[FloatArray, FloatArray]:
            residual, jacobian = right(theta)
            return residual, -jacobian

        solution = solver.minimize(wrong, np.array([-1.2, 1.0]), *box_of(CATALOG[0], np.ones(2)))
        assert solution.outcome is Outcome.STALLED
        assert solution.outcome.value.startswith("No step lowers the cost")


def test_iterations_that_run_out_are_said_so() -> None:
    solver = LevenbergMarquardt(iterations=3)
    solution = solver.minimize(
        differentiated(CATALOG[0], np.ones(2)), np.array([-1.2, 1.0]), *box_of(CATALOG[0], np.ones(2))
    )
    assert solution.outcome is Outcome.OUT_OF_ITERATIONS
    assert "iterations was used up" in solution.outcome.value
