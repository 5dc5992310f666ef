"""What a proposal and a verdict are asked to hold for: the flown throttle, and both ends of a D that moves."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest
from tests.unit.proposing.test_judging import PX4, known, log

from rotorid.proposing.judging import _situations, judge_axis
from rotorid.proposing.new_gains import wishes_of
from rotorid.proposing.settings import TuneSettings
from rotorid.tuning.loops import Gains


def test_gains_are_asked_to_hold_over_the_flown_throttle() -> None:
    controller = known("roll", log(PX4)).controller
    thrust = cast("Any", SimpleNamespace(flown_range=(0.8, 1.5)))
    assert wishes_of(controller, TuneSettings(), thrust).gain_range == (0.8, 1.5)
    assert wishes_of(controller, TuneSettings()).gain_range == (1.0, 1.0)


@pytest.mark.parametrize(("gain_range", "verdict"), [((1.0, 1.0), "fly"), ((0.9, 8.0), "do_not_fly")])
def test_gains_of_a_file_are_judged_over_the_flown_throttle(gain_range: tuple[float, float], verdict: str) -> None:
    axis = known("roll", log(PX4))
    found = judge_axis("roll", axis, {"MC_ROLLRATE_P": 0.12}, gain_range=gain_range, advise=False)
    assert found.verdict == verdict


def test_gains_are_judged_at_both_ends_of_a_d_that_moves() -> None:
    axis = known("roll", log(PX4))
    flown = axis.controller.controller
    upper = replace(flown, derivative_s2=20.0 * flown.derivative_s2)
    controller = replace(axis.controller, ends={"its own D": flown, "D at the top": upper})
    found = _situations(axis.plant, controller, axis.parts, Gains.of(flown), (1.0, 1.0))
    own, top = found["its own D"], found["D at the top"]
    assert (own.rate.sensitivity_peak < 2.0).all()
    assert ((top.rate.stable == 0.0) | (top.rate.sensitivity_peak > 2.4)).all()
