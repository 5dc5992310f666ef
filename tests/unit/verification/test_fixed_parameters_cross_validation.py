"""The engine of cross-validation: which record was seen by which fold, means, spreads, empty folds."""

from __future__ import annotations

import math
import pickle
from collections.abc import Sequence

import numpy as np
import pytest

from rotorid.errors import InsufficientDataError, ModelError, UsageError
from rotorid.verification.fixed_parameters import (
    CrossValidation,
    FixedParameterScores,
    OutputScore,
    cross_validate,
    rescored,
)
from rotorid.verification.verification import Kind

GROUPS, NAMES = (1.0, 2.0, 6.0), ("a", "b", "c")


def scored(fit: float, *, horizon_s: float = math.inf, output: str = "p") -> FixedParameterScores:
    return FixedParameterScores(
        record="",
        horizon_s=horizon_s,
        scores={output: OutputScore(nrmse_fit_percent=fit, tic=0.1, rms=0.2)},
        time_s=np.zeros(0),
        measured=np.zeros((0, 0)),
        predicted=np.zeros((0, 0)),
    )


def mean(groups: Sequence[float]) -> float:
    return sum(groups) / len(groups)


def near(model: float, group: float) -> list[FixedParameterScores]:
    return [scored(100.0 - abs(model - group))]


def run(kind: Kind) -> CrossValidation[float]:
    return cross_validate(GROUPS, names=NAMES, kind=kind, fit=mean, score=near)


def test_each_is_identified_alone_and_scored_on_all_others() -> None:
    found = run("each")
    np.testing.assert_allclose(found.table, [[100.0, 99.0, 95.0], [99.0, 100.0, 96.0], [95.0, 96.0, 100.0]])
    np.testing.assert_array_equal(found.unseen, ~np.eye(3, dtype=bool))
    assert [fold.identified for fold in found.folds] == [("a",), ("b",), ("c",)]
    np.testing.assert_allclose(found.fold_means, [97.0, 97.5, 95.5])
    assert found.best == 1
    assert found.mean == pytest.approx(np.mean([97.0, 97.5, 95.5]))


def test_spread_is_the_standard_deviation_of_a_sample() -> None:
    found = run("each")
    np.testing.assert_allclose(found.fold_spreads, [np.std(pair, ddof=1) for pair in ([99, 95], [99, 96], [95, 96])])
    assert found.spread == pytest.approx(np.std([99.0, 95.0, 99.0, 96.0, 95.0, 96.0], ddof=1))


def test_leaving_one_out_scores_only_that_one() -> None:
    found = run("leave_one_out")
    np.testing.assert_array_equal(found.unseen, np.eye(3, dtype=bool))
    assert [fold.identified for fold in found.folds] == [("b", "c"), ("a", "c"), ("a", "b")]
    np.testing.assert_allclose(found.fold_means, [97.0, 98.5, 95.5])
    assert found.best is None
    assert np.isnan(found.fold_spreads).all()


def test_order_of_the_records_only_orders_the_table() -> None:
    turned = cross_validate(GROUPS[::-1], names=NAMES[::-1], kind="each", fit=mean, score=near)
    np.testing.assert_array_equal(turned.table, run("each").table[::-1, ::-1])


def test_a_fold_without_a_model_stays_empty_and_says_why() -> None:
    def fit(groups: Sequence[float]) -> float:
        if groups == (6.0,):
            raise InsufficientDataError("nothing moved")
        return mean(groups)

    found = cross_validate(GROUPS, names=NAMES, kind="each", fit=fit, score=near)
    assert found.folds[2].model is None
    assert found.folds[2].cause == "nothing moved"
    assert np.isnan(found.fold_means[2])
    assert found.mean == pytest.approx(np.mean([97.0, 97.5]))


def test_without_any_model_there_is_no_result() -> None:
    def fit(groups: Sequence[float]) -> float:
        raise InsufficientDataError("nothing moved.")

    with pytest.raises(InsufficientDataError, match="nothing moved; this needs"):
        cross_validate(GROUPS, names=NAMES, kind="each", fit=fit, score=near)


def test_a_record_that_cannot_be_scored_leaves_a_gap() -> None:
    def score(model: float, group: float) -> list[FixedParameterScores]:
        if group == 1.0:
            raise InsufficientDataError("too short")
        return near(model, group)

    found = cross_validate(GROUPS, names=NAMES, kind="each", fit=mean, score=score)
    assert np.isnan(found.table[:, 0]).all()
    assert found.fold_means[0] == pytest.approx(97.0)
    assert {fold.cause for fold in found.folds} == {f"{NAMES[0]} gives no score: too short"}
    # Scored in another way, the cause is gone.
    assert {fold.cause for fold in rescored(found, GROUPS, near).folds} == {""}


def test_a_model_that_diverges_on_a_record_leaves_the_others() -> None:
    def score(model: float, group: float) -> list[FixedParameterScores]:
        if group == 1.0:
            raise ModelError("the model diverges over a record")
        return near(model, group)

    found = cross_validate(GROUPS, names=NAMES, kind="each", fit=mean, score=score)
    assert found.folds[1].cause == f"{NAMES[0]} gives no score: the model diverges over a record"


def test_a_group_counts_by_the_mean_of_its_records() -> None:
    found = cross_validate(
        GROUPS, names=NAMES, kind="each", fit=mean, score=lambda _, group: [scored(80.0 + group), scored(90.0 + group)]
    )
    np.testing.assert_allclose(found.table[0], [86.0, 87.0, 91.0])


def test_an_output_that_never_moves_does_not_count() -> None:
    def score(model: float, group: float) -> list[FixedParameterScores]:
        still = scored(-math.inf, output="r").scores
        one = near(model, group)[0]
        return [
            FixedParameterScores(
                record="",
                horizon_s=math.inf,
                scores={**one.scores, **still},
                time_s=one.time_s,
                measured=one.measured,
                predicted=one.predicted,
            )
        ]

    found = cross_validate(GROUPS, names=NAMES, kind="each", fit=mean, score=score)
    assert found.outputs == ("p", "r")
    np.testing.assert_allclose(found.table, run("each").table)


def test_the_same_models_can_be_scored_again() -> None:
    found = run("each")
    ahead = rescored(found, GROUPS, lambda _, __: [scored(99.0, horizon_s=0.5)])
    assert (found.horizons_s, ahead.horizons_s) == ((math.inf,), (0.5,))
    assert [fold.model for fold in ahead.folds] == [fold.model for fold in found.folds]


def test_it_says_what_it_does_and_pickles() -> None:
    said: list[str] = []
    found = cross_validate(GROUPS, names=NAMES, kind="leave_one_out", fit=mean, score=near, progress=said.append)
    assert said == ["identifying without a", "identifying without b", "identifying without c"]
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(found)).table, found.table)


@pytest.mark.parametrize(
    ("groups", "names", "kind", "said"),
    [
        ((1.0,), ("a",), "each", "at least two"),
        ((1.0, 2.0), ("a", "a"), "each", "different names"),
        ((1.0, 2.0), ("a", "b"), "twofold", "each, leave_one_out"),
    ],
)
def test_wrong_use_is_refused(groups: tuple[float, ...], names: tuple[str, ...], kind: Kind, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        cross_validate(groups, names=names, kind=kind, fit=mean, score=near)
