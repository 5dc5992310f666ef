"""Which outputs of a maneuver a model is judged on."""

from __future__ import annotations

import numpy as np

from rotorid.data.maneuver import Maneuver
from rotorid.models.catalog import library_model
from rotorid.pipeline.telling import SHARE, telling
from rotorid.pipeline.verify_model import Candidate
from rotorid.typing import Axis
from rotorid.verify.prediction import Horizon, Prediction
from rotorid.verify.time_domain import MOVED
from rotorid.verify.verification import Scores, Verification

OUTPUTS = ("p", "q")
INPUTS = ("roll_command", "pitch_command")
START_S, STOP_S = 3.0, 6.0
TIME_S = np.arange(0.0, 9.0, 0.01)


def candidate() -> Candidate:
    """Roll moves p and pitch moves q, and neither the other."""
    structure = library_model("hover.full").select(outputs=OUTPUTS, inputs=INPUTS)
    return Candidate(structure=structure, parameters=structure.parameters, band_rad_s=(1.0, 50.0))


def doublet(axis: Axis, *, moves: tuple[float, float], rests: tuple[float, float], moved: bool = True) -> Verification:
    """A maneuver in which p and q swing by ``moves``, after having swung by ``rests``; ``moved`` by what was said."""
    flown = (TIME_S >= START_S) & (TIME_S <= STOP_S)
    wave = np.sin(2.0 * np.pi * TIME_S)
    around = np.stack([np.where(flown, a, b) * wave for a, b in zip(moves, rests, strict=True)])
    score = Scores(nrmse_fit_percent=0.0, tic=1.0, rms=1.0, bias=0.0, reference_shift=0.0)
    horizon = Horizon(horizon_s=0.5, time_s=TIME_S, measured=around, predicted=around, scores={})
    return Verification(
        record="flight",
        maneuver=Maneuver(axis=axis, kind="doublet", start_s=START_S, stop_s=STOP_S),
        time_s=TIME_S[flown],
        inputs=np.zeros((2, np.count_nonzero(flown))),
        measured=around[:, flown],
        predicted=around[:, flown],
        input_names=INPUTS,
        output_names=OUTPUTS,
        scores=dict.fromkeys(OUTPUTS, score),
        moved=OUTPUTS if moved else (),
        ahead=Prediction(window_s=0.3, horizons=(horizon,), holds_s={}),
    )


def judged_on(*checks: Verification, usual: dict[str, float] | None = None) -> list[tuple[str, ...]]:
    return [check.moved for check in telling(checks, candidate(), usual or {})]


def test_an_output_that_moves_as_before_is_noise() -> None:
    assert judged_on(doublet("roll", moves=(1.0, 0.9 * MOVED), rests=(0.1, 1.0))) == [("p",)]
    assert judged_on(doublet("roll", moves=(1.0, 1.1 * MOVED), rests=(0.1, 1.0))) == [OUTPUTS]


def test_a_small_motion_of_another_axis_is_not_judged_and_a_large_one_is() -> None:
    pitch = doublet("pitch", moves=(0.0, 1.0), rests=(0.0, 0.01))
    small = doublet("roll", moves=(1.0, 0.9 * SHARE), rests=(0.01, 0.01))
    large = doublet("roll", moves=(1.0, 1.1 * SHARE), rests=(0.01, 0.01))
    assert judged_on(pitch, small)[1] == ("p",)
    # A coupling that the model lacks is no excuse for it.
    assert judged_on(pitch, large)[1] == OUTPUTS


def test_the_fitted_maneuvers_tell_what_is_a_large_motion() -> None:
    alone = doublet("roll", moves=(1.0, 0.1), rests=(0.01, 0.01))
    assert judged_on(alone) == [OUTPUTS]
    assert judged_on(alone, usual={"p": 1.0, "q": 1.0}) == [("p",)]


def test_what_the_model_connects_is_judged_however_small() -> None:
    assert judged_on(doublet("roll", moves=(0.05, 0.0), rests=(0.01, 0.0)), usual={"p": 1.0}) == [("p",)]


def test_a_maneuver_that_moves_nothing_tells_nothing() -> None:
    assert judged_on(doublet("roll", moves=(1.0, 1.0), rests=(1.0, 1.0))) == []


def test_an_axis_that_is_no_input_of_the_model_is_taken_to_move_all() -> None:
    assert judged_on(doublet("yaw", moves=(0.1, 0.1), rests=(0.01, 0.01)), usual={"p": 1.0, "q": 1.0}) == [OUTPUTS]
