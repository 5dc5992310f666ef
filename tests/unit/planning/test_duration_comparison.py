"""Plans side by side."""

from __future__ import annotations

import numpy as np
import pytest
from tests.unit.planning.plans import STRUCTURE, TRUTH, roll_loop, sweeps

from rotorid.errors import UsageError
from rotorid.planning.duration import compare_plans
from rotorid.planning.prediction import predict


def test_the_stronger_plan_is_best_and_the_hopeless_one_says_why() -> None:
    plans = [
        sweeps({"roll": 0.05}, 30.0, name="soft"),
        sweeps({"roll": 0.2}, 30.0, name="hard"),
        sweeps({"roll": 1e-5}, 30.0, name="hopeless"),
    ]
    loop = roll_loop(0.1)
    found = compare_plans(STRUCTURE, TRUTH, loop, plans)
    assert found.parameters == tuple(TRUTH)
    assert set(found.best.values()) == {"hard"}
    assert set(found.best) == set(TRUTH)
    assert list(found.refused) == ["hopeless"]
    assert "octave" in found.refused["hopeless"]
    assert np.isinf(found.percent[2]).all()
    assert found.predictions[2] is None
    assert found.percent[0, 0] == predict(STRUCTURE, TRUTH, loop, plans[0])["L_roll"].percent
    np.testing.assert_allclose(found.percent_of_a_minute[1], found.percent[1] * np.sqrt(found.duration_s[1] / 60.0))


def test_plans_have_names_of_their_own() -> None:
    plan = sweeps({"roll": 0.05}, 30.0)
    for plans in ([], [plan, plan]):
        with pytest.raises(UsageError, match="its own name"):
            compare_plans(STRUCTURE, TRUTH, roll_loop(), plans)
