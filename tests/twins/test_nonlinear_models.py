"""Known flights, noise added, given back to the fit: the truth must lie inside the predicted spread.

Drag comes from vehicles that fly freely, in still air and in wind ahead, aside and from behind
(:mod:`tests.twins.drag_flights`). Random errors alone hold the truth in few intervals of
still flights of the Bebop, and in none along the wind.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator

import numpy as np
import pytest
from scipy import stats
from tests.twins.drag_flights import DRAG, PLANS, WINDS, DragFlight, errors_of, identified, judged

from rotorid.fitting.least_squares import Outcome
from rotorid.fitting.time.nonlinear import NonlinearFit, NonlinearProblem, fit_nonlinear
from rotorid.fitting.time.output_error import TimeData
from rotorid.models.library import nonlinear_model
from rotorid.models.nonlinear import NonlinearStructure
from rotorid.models.parameter import ParameterSet
from rotorid.simulation.nonlinear import Scheme, simulate_nonlinear
from rotorid.typing import FloatArray

RATE_HZ = 20.0


def flown(
    model: NonlinearStructure,
    truth: ParameterSet,
    u: FloatArray,
    noise: FloatArray,
    rng: np.random.Generator,
    scheme: Scheme | None = None,
) -> TimeData:
    y = simulate_nonlinear(model, truth.values, u, sample_rate_hz=RATE_HZ, before=u[:, 0], scheme=scheme)
    return TimeData(
        name="twin",
        inputs=u,
        outputs=y + noise[:, None] * rng.standard_normal(y.shape),
        sample_rate_hz=RATE_HZ,
    )


def squared_errors(fit: NonlinearFit, truth: ParameterSet) -> float:
    """Squared distance from the truth in units of the predicted covariance; chi-squared with one degree for each."""
    error = fit.estimate.parameters.pack() - truth.pack()
    return float(error @ np.linalg.solve(fit.covariance, error))


def tilts(rng: np.random.Generator, samples: int) -> FloatArray:
    """Roll and pitch that go from one tilt to the next within a second, at a steady height."""
    corners = np.arange(0, samples + 20, 20)
    values = 0.35 * rng.choice([-1.0, 1.0], (2, corners.size))
    return np.stack([*(np.interp(np.arange(samples), corners, row) for row in values), *np.zeros((2, samples))])


@pytest.mark.parametrize("kind", ["linear", "quadratic"])
def test_drag_comes_back_within_its_spread(kind: str) -> None:
    model = nonlinear_model(f"drag.{kind}")
    truth = model.parameters.with_values({"k_Dx": 0.3, "k_Dy": 0.45})
    scheme, seeds, distances = Scheme(hold="first"), 30, []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        records = tuple(flown(model, truth, tilts(rng, 100), np.array([0.05, 0.08]), rng, scheme) for _ in range(2))
        given = NonlinearProblem(structure=model, parameters=model.parameters, records=records, scheme=scheme)
        fit = fit_nonlinear(given)
        assert fit.settled
        distances.append(squared_errors(fit, truth))
    low, high = stats.chi2.ppf([0.0005, 0.9995], 2 * seeds)  # type: ignore[misc]
    assert low < sum(distances) < high


def test_the_wrong_drag_is_seen() -> None:
    """The noise of a fit with the wrong law is larger than that of one with the right law."""
    right, wrong = nonlinear_model("drag.quadratic"), nonlinear_model("drag.linear")
    rng, scheme = np.random.default_rng(7), Scheme(hold="first")
    truth = right.parameters.with_values({"k_Dx": 0.3, "k_Dy": 0.45})
    records = (flown(right, truth, tilts(rng, 400), np.array([0.02, 0.02]), rng, scheme),)
    noises = [
        np.sqrt(
            np.diag(
                fit_nonlinear(
                    NonlinearProblem(structure=model, parameters=model.parameters, records=records, scheme=scheme)
                ).noise
            )
        )
        for model in (right, wrong)
    ]
    # 400 samples give a standard deviation to 3.5 %; four of these.
    assert noises[0] == pytest.approx([0.02, 0.02], rel=0.14)
    assert (noises[1] > 1.5 * noises[0]).all()


def flight() -> tuple[NonlinearStructure, ParameterSet]:
    model = nonlinear_model("flight.first_order")
    values = {"K_phi": 0.95, "T_phi": 0.16, "tau_phi": 0.063, "K_theta": 1.05, "T_theta": 0.14, "tau_theta": 0.071}
    values |= {"K_down": 1.1, "T_down": 0.25, "tau_down": 0.118, "K_psi": 1.2, "T_psi": 0.6, "tau_psi": 0.145}
    return model, model.parameters.with_values(values)


def binary(rng: np.random.Generator, samples: int) -> FloatArray:
    size = np.array([0.1, 0.1, 0.5, 0.5])[:, None]
    return np.repeat(size * rng.choice([-1.0, 1.0], (4, samples // 8)), 8, axis=1)


def test_a_whole_flight_comes_back_within_its_spread() -> None:
    """Ten states, fourteen parameters of which four are delays, nine outputs, an unknown start."""
    model, truth = flight()
    noise = np.array([0.01, 0.01, 0.01, 0.02, 0.02, 0.02, 0.005, 0.005, 0.005])
    seeds, distances = 2, []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        data = flown(model, truth, binary(rng, 240), noise, rng)
        fit = fit_nonlinear(NonlinearProblem(structure=model, parameters=model.parameters, records=(data,)))
        assert fit.settled
        assert fit.solution.outcome is Outcome.CONVERGED
        distances.append(squared_errors(fit, truth))
    low, high = stats.chi2.ppf([0.0005, 0.9995], len(truth.free) * seeds)  # type: ignore[misc]
    assert low < sum(distances) < high


@pytest.mark.parametrize(("wind", "disturbed"), [("still air", False), ("ahead", True)])
def test_intervals_hold_the_drag_of_a_vehicle_that_flies_freely(wind: str, disturbed: bool) -> None:
    found = identified(DragFlight("bebop", "even", wind, 3, duration_s=30))
    for name, true in DRAG["bebop"].items():
        one = found[name]
        assert one.std is not None
        assert one.std_model is not None
        assert abs(one.value - true) < 1.96 * one.std
        assert one.std < 0.3 * true
        assert one.std_model > 0.0
    assert ("disturbed_flight" in {finding.kind for finding in found.findings}) is disturbed


def test_a_wrong_law_of_drag_is_said() -> None:
    found = identified(DragFlight("bebop", "even", "still air", 3, duration_s=30), "drag.quadratic")
    (said,) = [finding for finding in found.findings if finding.kind == "disturbed_flight"]
    assert said.numbers["whole"] > 1.4 * said.numbers["piece"]


@functools.cache
def errors_in(vehicle: str, wind: str) -> tuple[tuple[float, float, float], ...]:
    """Of twelve flights, by seeds that nothing was chosen by."""
    plans = PLANS[vehicle]
    flights = [DragFlight(vehicle, plan, wind, seed) for plan in plans for seed in range(100, 100 + 12 // len(plans))]
    return tuple(error for flight in flights for error in errors_of(flight))


MISSED = {
    ("bebop", "still air"): "21 of 24: biases of 1 to 2 %, of stated 1.4 %",
    ("px4_quad", "still air"): "1.83 times the error, of 1.8; a median of 24 scatters by some 20 %",
    ("px4_quad", "aside"): "21 of 24, and 1.86 times the error: wind is no constant even within 3 s",
    ("px4_quad", "aslant, gusts"): "21 of 24, rms 1.36: wind is no constant even within 3 s",
}
"""Cells beyond the bars, and by what."""


def cells() -> Iterator[object]:
    for vehicle in DRAG:
        for wind in WINDS:
            reason = MISSED.get((vehicle, wind))
            marks = [pytest.mark.xfail(strict=True, raises=AssertionError, reason=reason)] if reason else []
            yield pytest.param(vehicle, wind, marks=marks)


@pytest.mark.slow
@pytest.mark.parametrize(("vehicle", "wind"), list(cells()))
def test_intervals_hold_drag_in_every_wind(vehicle: str, wind: str) -> None:
    """Clocks are off by what is usual; the table stands in ``docs/accuracy.md``."""
    found = judged(errors_in(vehicle, wind))
    print(f"{vehicle}, {wind}: {found}")
    if found.inside < 0.87 or found.rms > 1.4 or found.sharpness > 1.9:
        pytest.fail(f"beyond what is known: {found}")
    assert found.inside >= 0.9
    assert found.rms <= 1.2
    if found.median_error > 0.005:
        assert found.sharpness <= 1.8  # 1.48 is that of a normal error
    else:
        assert found.median_std <= 0.007


@pytest.mark.slow
def test_intervals_of_drag_do_not_hold_too_much() -> None:
    """All winds together: 24 intervals of a true 95 % hold all in 29 % of studies."""
    found = judged(error for vehicle in DRAG for wind in WINDS for error in errors_in(vehicle, wind))
    print(found)
    assert 0.9 <= found.inside <= 0.995
    assert found.rms <= 1.2
