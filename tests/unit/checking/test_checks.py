"""Scores of unseen maneuvers in numbers: outputs that did not move have none."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rotorid.checking.checks import checks_of, maneuver_check
from rotorid.data.record import Maneuver
from rotorid.results.model import Verifications
from rotorid.verification.verification import Scores, Verification


def check(*moved: str) -> Verification:
    still = {"p": 80.0, "q": -1.9, "r": -math.inf}
    scores = {
        name: Scores(nrmse_fit_percent=fit, tic=0.2, rms=0.1, bias=0.0, reference_shift=0.0)
        for name, fit in still.items()
    }
    return Verification(
        record="a.ulg",
        maneuver=Maneuver(axis="roll", kind="doublet", start_s=1.0, stop_s=3.0),
        time_s=np.arange(5.0),
        inputs=np.zeros((1, 5)),
        measured=np.zeros((3, 5)),
        predicted=np.zeros((3, 5)),
        input_names=("roll_command",),
        output_names=("p", "q", "r"),
        scores=scores,
        moved=moved,
    )


@pytest.mark.parametrize(("moved", "scored"), [(("p",), {"p"}), (("p", "q"), {"p", "q"}), ((), {"p", "q"})])
def test_what_did_not_move_has_no_score(moved: tuple[str, ...], scored: set[str]) -> None:
    """Where nothing moved beyond what it did before, all are told that can be."""
    one = check(*moved)
    assert set(maneuver_check(one, ()).scores) == scored
    (record,) = checks_of(Verifications(maneuvers=(one,)), ()).records.values()
    assert set(record) == scored
