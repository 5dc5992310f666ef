"""The order of a black box: truths of known order come back, and too little data is refused."""

from __future__ import annotations

import numpy as np
import pytest
from tests.unit.cli.commands import rotorid
from tests.unit.identifying.response_twins import flight

from rotorid.documents.result import identified_model, result_document
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.black_box.fit import StartPlan
from rotorid.fitting.time.output_error import TimeData
from rotorid.identifying.identification import identify
from rotorid.models.state_space import StateSpace
from rotorid.simulation.linear import simulate_linear
from rotorid.verification.orders import compare_orders, held_out

QUICK = StartPlan(methods=("cva",), drawn=1)
POLES = (-2.0, -4.0 + 7.0j, -4.0 - 7.0j)
"""Of the truths: the first one, the last two, or all."""


def record(order: int, seed: int = 0, samples: int = 600, noise: float = 0.02) -> TimeData:
    """A random binary signal through a system of an order, with unit gain."""
    poles = {1: POLES[:1], 2: POLES[1:], 3: POLES}[order]
    a = np.poly(poles).real
    companion = np.zeros((order, order))
    companion[:-1, 1:] = np.eye(order - 1)
    companion[-1] = -a[:0:-1]
    one, none = np.eye(order), np.zeros((1, order))
    system = StateSpace(
        M=one,
        F=companion,
        G=a[-1] * one[:, -1:],
        H0=one[:1],
        H1=none,
        input_delays_s=[0.0],
        output_delays_s=[0.0],
    )
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice([-1.0, 1.0], size=samples // 6 + 1), 6)[None, :samples]
    y = simulate_linear(system, u, sample_rate_hz=20.0) + noise * rng.standard_normal((1, samples))
    return TimeData(name=f"flight {seed}", inputs=u, outputs=y, sample_rate_hz=20.0)


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 2, 3])
def test_a_truth_of_known_order_is_found(order: int) -> None:
    found = compare_orders([record(order)], inputs=["u"], outputs=["y"], highest=4, plan=QUICK)
    assert found.order == order
    assert found[order].parameters == 2 * order
    assert found[order].fitted_percent > 90.0
    assert found[order].color < 2.0 * found.chance
    assert [one.order for one in found.scores[:order]] == list(range(1, order + 1))
    # Criteria agree where residuals are white, and orders below leave color.
    assert min(found.scores, key=lambda one: one.bic).order == order
    assert all(one.color > 4.0 * found.chance for one in found.scores[: order - 1])


def test_logs_are_held_out_whole_where_there_are_three() -> None:
    logs = [record(2, seed, samples=200) for seed in range(3)]
    assert [one.name for one in held_out(logs)] == [one.name for one in logs]
    assert len(held_out(logs[:1])) == 3
    found = compare_orders(logs, inputs=["u"], outputs=["y"], highest=2, plan=QUICK)
    assert (found.order, found.records) == (2, ("flight 0", "flight 1", "flight 2"))


@pytest.mark.slow
def test_responses_side_by_side_have_one_order() -> None:
    first, second = record(1), record(2, seed=4)
    both = TimeData(
        name="flight",
        inputs=np.vstack([first.inputs, second.inputs]),
        outputs=np.vstack([first.outputs, second.outputs]),
        sample_rate_hz=20.0,
    )
    names = {"inputs": ["a_setpoint", "b_setpoint"], "outputs": ["a", "b"]}
    found = compare_orders([both], **names, decoupled=True, highest=2, plan=QUICK)
    assert found.order == 2
    assert found[2].parameters == 8


def test_too_little_to_hold_out_is_refused() -> None:
    with pytest.raises(InsufficientDataError, match="40 samples are too few to compare orders"):
        compare_orders([record(1, samples=40)], inputs=["u"], outputs=["y"])
    with pytest.raises(UsageError, match="a highest order of 0 is not possible"):
        compare_orders([record(1)], inputs=["u"], outputs=["y"], highest=0)


@pytest.mark.slow
def test_identify_chooses_the_order_and_keeps_the_table() -> None:
    found = identify([flight(3, samples=300)], "black_box:auto")
    document = result_document(found)
    assert (document.model, document.inputs) == ("black_box:2", ["phi_setpoint"])
    assert document.orders is not None
    assert document.orders.order == 2
    assert len(document.orders.held_out) == 5
    again = identified_model(document, None)
    assert again.fit.orders == found.fit.orders


def test_orders_are_not_cross_validated_twice() -> None:
    ran = rotorid("identify", "flight.csv", "--model", "black_box:auto", "--cross-validate", "each")
    assert ran.code == 2
    assert "black_box:auto cross-validates its orders already" in ran.err
