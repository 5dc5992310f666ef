"""Where searches look when nobody says where."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.errors import UsageError
from rotorid.fitting.problem import search_box
from rotorid.models.parameter import Parameter, ParameterSet


@pytest.mark.parametrize(
    ("parameter", "wider", "side"),
    [
        (Parameter(name="a", value=2.0, unit="1"), 3.0, (2.0 / 3.0, 6.0, "logarithmic")),
        (Parameter(name="a", value=-2.0, unit="1"), 10.0, (-20.0, -0.2, "logarithmic")),
        (Parameter(name="a", value=1.0, unit="1", starts=(0.5, 4.0)), 2.0, (0.25, 8.0, "logarithmic")),
        (Parameter(name="a", value=0.0, unit="1", starts=(-1.0, 4.0)), 3.0, (-12.0, 12.0, "linear")),
        (Parameter(name="a", value=0.0, unit="1"), 3.0, (-3e-3, 3e-3, "linear")),
        (Parameter(name="a", value=0.0, unit="s", lower=0.0), 3.0, (0.0, 3e-3, "linear")),
        (Parameter(name="a", value=2.0, unit="1", lower=1.0, upper=3.0), 3.0, (1.0, 3.0, "logarithmic")),
    ],
)
def test_sides(parameter: Parameter, wider: float, side: tuple[float, float, str]) -> None:
    box = search_box(ParameterSet([parameter]), wider=wider)
    assert (box.lower[0], box.upper[0], box.scales[0]) == (pytest.approx(side[0]), pytest.approx(side[1]), side[2])


def test_only_free_parameters_have_sides() -> None:
    held = Parameter(name="b", value=5.0, unit="1", status="fixed")
    box = search_box(ParameterSet([Parameter(name="a", value=2.0, unit="1"), held]))
    assert np.array_equal(box.lower, [2.0 / 3.0])


def test_bounds_that_leave_nothing_are_refused() -> None:
    with pytest.raises(UsageError):
        search_box(ParameterSet([Parameter(name="a", value=0.5, unit="1", upper=1.0, starts=(50.0,))]))
