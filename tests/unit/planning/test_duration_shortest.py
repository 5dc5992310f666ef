"""The shortest flight, and why there is none."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest
from tests.unit.planning.plans import STRUCTURE, TRUTH, roll_loop, sweeps

from rotorid.data.flight_plan import FlightPlan
from rotorid.errors import UsageError
from rotorid.planning.duration import Shortest, shortest
from rotorid.planning.expected import FitSettings
from rotorid.planning.prediction import predict

LOOP = roll_loop(0.1)
CHOICES = FitSettings(band_rad_s=(2.0, 40.0))


def plan_of(duration_s: float) -> FlightPlan:
    return sweeps({"roll": 0.1}, duration_s)


def test_the_answer_is_good_enough_and_a_little_less_is_not() -> None:
    wanted = {"L_roll": 2.0, "T_motor": 5.0}
    found = shortest(STRUCTURE, TRUTH, LOOP, plan_of, wanted, shortest_s=15.0, longest_s=120.0, choices=CHOICES)
    assert found.duration_s is not None
    assert found.prediction is not None
    assert all(found.prediction[name].percent <= percent for name, percent in wanted.items())
    assert found.limiting in wanted
    assert found.limiting in found.words
    below = [one for one in found.tried if one.duration_s < found.duration_s]
    assert below
    assert below[-1].excess > 1.0
    assert below[-1].duration_s > 0.97 * found.duration_s


def test_a_duration_that_is_always_enough_is_the_shortest() -> None:
    found = shortest(STRUCTURE, TRUTH, LOOP, plan_of, {"L_roll": 50.0}, shortest_s=30.0, longest_s=60.0)
    assert found.duration_s == 30.0
    assert len(found.tried) == 2


def test_what_no_duration_reaches_is_named() -> None:
    found = shortest(
        STRUCTURE, TRUTH, LOOP, plan_of, {"L_roll": 50.0, "tau_roll": 0.001}, shortest_s=20.0, longest_s=60.0
    )
    assert found.duration_s is None
    assert found.limiting == "tau_roll"
    assert found.prediction is not None
    assert found.prediction["tau_roll"].percent > 0.001
    assert "0.001 % requested" in found.words


class Predicted(dict[str, SimpleNamespace]):
    """As much of a prediction as the search looks at."""

    @property
    def parameters(self) -> tuple[SimpleNamespace, ...]:
        return tuple(self.values())


def test_where_a_structure_does_not_fit_a_shorter_flight_may_do() -> None:
    """Model error that grows beyond 70 s: 60 s are enough, and the longest flight is not."""

    def inflated(*arguments: object, choices: FitSettings | None = None) -> dict[str, SimpleNamespace]:
        plan = arguments[3]
        assert isinstance(plan, FlightPlan)
        duration_s = plan.inputs[0].maneuver.duration_s
        random = math.sqrt(40.0 / duration_s)
        percent = random * (3.0 if duration_s > 70.0 else 1.0)
        parameter = SimpleNamespace(
            name="L_roll",
            percent=percent,
            std_model=math.sqrt(percent**2 - random**2),
            in_percent=lambda number: number,
        )
        return Predicted(L_roll=parameter)

    def within(percent: float) -> Shortest:
        span = {"shortest_s": 20.0, "longest_s": 240.0}
        return shortest(STRUCTURE, TRUTH, LOOP, plan_of, {"L_roll": percent}, **span, foretell=inflated)  # type: ignore[arg-type]

    found = within(1.0)
    assert found.duration_s == pytest.approx(40.0, rel=0.021)
    assert [one.duration_s for one in found.tried][-3:] == [60.0, 120.0, 240.0]
    never = within(0.5)
    assert never.duration_s is None
    # 60 s come to 0.82 %, the longest flight to 1.2 %.
    assert never.words.startswith("Not accurate enough: 60 s measure L_roll to 0.82 %")
    long = within(0.05)
    assert long.words.endswith("0.05 % requested.")


def test_a_parameter_that_is_left_out_is_never_reached() -> None:
    truth = {**TRUTH, "T_motor": 0.0}
    found = shortest(STRUCTURE, truth, roll_loop(0.1, truth), plan_of, {"T_motor": 5.0}, longest_s=60.0)
    assert found.duration_s is None
    assert "T_motor cannot be separated" in found.words


def test_a_flight_that_supports_nothing_is_said_to() -> None:
    found = shortest(
        STRUCTURE, TRUTH, roll_loop(30.0), lambda one: sweeps({"roll": 0.001}, one), {"L_roll": 5.0}, longest_s=40.0
    )
    assert (found.duration_s, found.prediction, found.limiting) == (None, None, "")
    assert "Not enough data for this model" in found.words


def test_the_answer_is_that_of_a_prediction() -> None:
    found = shortest(STRUCTURE, TRUTH, LOOP, plan_of, {"L_roll": 50.0}, shortest_s=30.0, longest_s=60.0)
    assert found.prediction is not None
    assert found.prediction["L_roll"].std == predict(STRUCTURE, TRUTH, LOOP, plan_of(30.0))["L_roll"].std


def test_wrong_wishes_are_refused() -> None:
    with pytest.raises(UsageError, match="did you mean L_roll"):
        shortest(STRUCTURE, TRUTH, LOOP, plan_of, {"L_rol": 5.0})
    with pytest.raises(UsageError, match="positive"):
        shortest(STRUCTURE, TRUTH, LOOP, plan_of, {"L_roll": 0.0})
    with pytest.raises(UsageError, match="no requested parameter"):
        shortest(STRUCTURE, TRUTH, LOOP, plan_of, {})
    with pytest.raises(UsageError, match="below the longest"):
        shortest(STRUCTURE, TRUTH, LOOP, plan_of, {"L_roll": 5.0}, shortest_s=50.0, longest_s=20.0)
