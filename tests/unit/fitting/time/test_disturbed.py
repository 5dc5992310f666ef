"""Wind in nonlinear fits: constants in the equations, over pieces of a record."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.fitting.time.disturbed import DISTURBED, falls, left_over, pushed
from rotorid.fitting.time.nonlinear import NonlinearFit, NonlinearProblem, fit_nonlinear
from rotorid.fitting.time.output_error import TimeData
from rotorid.models.expression import Expression
from rotorid.models.library import nonlinear_model
from rotorid.simulation.nonlinear import Scheme, simulate_nonlinear

RATE_HZ = 20.0
SCHEME = Scheme(hold="first")
MODEL = nonlinear_model("drag.linear").select(["velocity_right"])
TRUTH = 0.33


def flown(wind_m_s: float, gusts_m_s: float, seed: int) -> TimeData:
    """A minute of roll in wind that the drag model does not know: speeds of a vehicle that flies in moving air."""
    rng = np.random.default_rng(seed)
    samples = round(60.0 * RATE_HZ)
    roll = np.repeat(0.1 * rng.choice([-1.0, 1.0], samples // 10), 10)
    roll = np.convolve(roll, np.full(6, 1.0 / 6.0))[:samples]
    gust = np.zeros(samples)
    for k in range(1, samples):
        gust[k] = 0.99 * gust[k - 1] + gusts_m_s * np.sqrt(1.0 - 0.99**2) * rng.standard_normal()
    air = wind_m_s + gust
    blown = replace(
        MODEL,
        inputs=(*MODEL.inputs, "air"),
        input_delays=(*MODEL.input_delays, Expression()),
        equations=(MODEL.equations[0] + Expression.symbol("k_Dy") * Expression.symbol("air"),),
    )
    u = np.stack([roll, *np.zeros((3, samples)), air])
    y = simulate_nonlinear(blown, {"k_Dy": TRUTH}, u, sample_rate_hz=RATE_HZ, before=u[:, 0], scheme=SCHEME)
    noisy = y + 0.02 * rng.standard_normal(y.shape)
    return TimeData(name="blown", inputs=u[:4], outputs=noisy, sample_rate_hz=RATE_HZ)


def fitted(data: TimeData, *, constants: bool, pieces_s: float | None = None) -> NonlinearFit:
    records = (data,) if pieces_s is None else data.pieces(pieces_s)
    structure = pushed(MODEL, ["k_Dy"]) if constants else MODEL
    return fit_nonlinear(
        NonlinearProblem(structure=structure, parameters=MODEL.parameters, records=records, scheme=SCHEME)
    )


def drag(fit: NonlinearFit) -> float:
    return fit.estimate.parameters["k_Dy"].value


@pytest.mark.parametrize("wind_m_s", [-2.0, 2.0])
def test_a_constant_is_a_steady_wind(wind_m_s: float) -> None:
    data = flown(wind_m_s, 0.0, 1)
    assert abs(drag(fitted(data, constants=False)) - TRUTH) > 0.1
    fit = fitted(data, constants=True)
    assert drag(fit) == pytest.approx(TRUTH, abs=0.02)
    assert left_over(fit) == pytest.approx([0.02**2], rel=0.15)


@pytest.mark.parametrize("seed", range(3))
def test_gusts_need_pieces(seed: int) -> None:
    data = flown(0.0, 0.5, seed)
    pieces, whole = fitted(data, constants=True, pieces_s=6.0), fitted(data, constants=True)
    assert (left_over(whole) > DISTURBED * left_over(pieces)).all()
    assert drag(pieces) == pytest.approx(TRUTH, abs=0.12)


def test_still_air_leaves_as_much_in_pieces() -> None:
    data = flown(0.0, 0.0, 2)
    whole, pieces = fitted(data, constants=False), fitted(data, constants=True, pieces_s=3.0)
    assert left_over(whole) == pytest.approx(left_over(pieces), rel=0.2)


def test_an_output_that_is_exact_hides_no_other() -> None:
    nothing, moved = np.zeros(2), np.array([0.0, 4.0])
    assert falls(nothing, nothing).tolist() == [1.0, 1.0]
    assert falls(moved, np.array([0.0, 1.0])).tolist() == [1.0, 4.0]
    assert falls(moved, nothing).tolist() == [1.0, np.inf]


def test_only_equations_with_a_free_parameter_are_pushed() -> None:
    flight = nonlinear_model("flight.first_order")
    states = pushed(flight, ["k_Dx", "K_phi"]).states[len(flight.states) :]
    assert states == ("push_on_velocity_north", "push_on_velocity_east", "push_on_phi")
