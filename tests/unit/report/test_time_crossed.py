"""The sentence above a cross-validation: how models were scored, and what flatters them."""

from __future__ import annotations

import pytest

from rotorid.report.time import crossed
from rotorid.results.summary import CrossValidationSummary, FoldSummary, SignalScore

LOOKS_AHEAD = "looks slightly ahead"


def document(band_rad_s: tuple[float, float] | None, horizon_s: float | None) -> CrossValidationSummary:
    score = SignalScore(nrmse_fit_percent=80.0, tic=0.1, rms=0.01)
    return CrossValidationSummary(
        kind="each",
        records=["a", "b"],
        outputs=["p"],
        horizon_s=horizon_s,
        band_rad_s=band_rad_s,
        folds=[
            FoldSummary(
                identified=["a"], unseen=["b"], scores={"a": {"p": score}}, cause="b gives no score: too short"
            ),
            FoldSummary(identified=["b"], unseen=["a"], scores={"a": {"p": score}}, mean_percent=80.0),
        ],
        mean_percent=80.0,
    )


@pytest.mark.parametrize(
    ("band_rad_s", "horizon_s", "said"),
    [((1.0, 20.0), 0.25, True), ((1.0, 20.0), None, False), (None, 0.25, False), (None, None, False)],
)
def test_a_filter_before_a_prediction_is_named(
    band_rad_s: tuple[float, float] | None, horizon_s: float | None, said: bool
) -> None:
    shown = crossed(document(band_rad_s, horizon_s))
    assert shown is not None
    assert (LOOKS_AHEAD in shown.words) is said
    assert ("1.0 to 20" in shown.words or "1 to 20" in shown.words) is (band_rad_s is not None)


def test_why_a_record_has_no_score_stands_in_its_row() -> None:
    shown = crossed(document(None, None))
    assert shown is not None
    first, second = shown.rows
    assert (first.cause, second.cause) == ("b gives no score: too short", "")
    assert first.cells[1].verdict is None
