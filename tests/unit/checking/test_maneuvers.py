"""Which outputs of a maneuver a model is judged on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rotorid.checking.candidate import Candidate
from rotorid.checking.maneuvers import SHARE, excited_outputs
from rotorid.data.record import Maneuver
from rotorid.models.library import library_model
from rotorid.typing import Axis
from rotorid.verification.verification import Scores, Verification

OUTPUTS = ("p", "q")
INPUTS = ("roll_command", "pitch_command")
TIME_S = np.arange(3.0, 6.0, 0.01)


def candidate() -> Candidate:
    """Roll moves p and pitch moves q, and neither the other."""
    structure = library_model("hover.full").select(outputs=OUTPUTS, inputs=INPUTS)
    return Candidate(structure=structure, band_rad_s=(1.0, 50.0))


def doublet(axis: Axis, *, moves: tuple[float, float], moved: tuple[str, ...] = OUTPUTS) -> Verification:
    """A maneuver in which p and q swing by ``moves``."""
    wave = np.sin(2.0 * np.pi * TIME_S)
    swing = np.stack([size * wave for size in moves])
    score = Scores(nrmse_fit_percent=0.0, tic=1.0, rms=1.0, bias=0.0, reference_shift=0.0)
    return Verification(
        record="flight",
        maneuver=Maneuver(axis=axis, kind="doublet", start_s=TIME_S[0], stop_s=TIME_S[-1]),
        time_s=TIME_S,
        inputs=np.zeros((2, TIME_S.size)),
        measured=swing,
        predicted=swing,
        input_names=INPUTS,
        output_names=OUTPUTS,
        scores=dict.fromkeys(OUTPUTS, score),
        moved=moved,
    )


def judged_on(*checks: Verification, usual: dict[str, float] | None = None) -> list[tuple[str, ...]]:
    return [check.moved for check in excited_outputs(checks, replace(candidate(), usual=usual or {}))]


def test_an_output_that_the_maneuver_did_not_move_is_not_judged() -> None:
    assert judged_on(doublet("roll", moves=(1.0, 1.0), moved=("p",))) == [("p",)]
    assert judged_on(doublet("roll", moves=(1.0, 1.0))) == [OUTPUTS]


def test_a_small_motion_of_another_axis_is_not_judged_and_a_large_one_is() -> None:
    pitch = doublet("pitch", moves=(0.0, 1.0))
    small = doublet("roll", moves=(1.0, 0.9 * SHARE))
    large = doublet("roll", moves=(1.0, 1.1 * SHARE))
    assert judged_on(pitch, small)[1] == ("p",)
    # A coupling that the model lacks is no excuse for it.
    assert judged_on(pitch, large)[1] == OUTPUTS


def test_the_fitted_maneuvers_tell_what_is_a_large_motion() -> None:
    alone = doublet("roll", moves=(1.0, 0.1))
    assert judged_on(alone) == [OUTPUTS]
    assert judged_on(alone, usual={"p": 1.0, "q": 1.0}) == [("p",)]


def test_what_the_model_connects_is_judged_however_small() -> None:
    assert judged_on(doublet("roll", moves=(0.05, 0.0), moved=("p",)), usual={"p": 1.0}) == [("p",)]


def test_a_maneuver_that_moves_nothing_tells_nothing() -> None:
    assert judged_on(doublet("roll", moves=(1.0, 1.0), moved=())) == []


def test_an_axis_that_is_no_input_of_the_model_is_taken_to_move_all() -> None:
    assert judged_on(doublet("yaw", moves=(0.1, 0.1)), usual={"p": 1.0, "q": 1.0}) == [OUTPUTS]
