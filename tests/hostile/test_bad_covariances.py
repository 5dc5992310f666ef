"""Covariances of results that anybody may have written: those of no identification are refused where they are read."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from tests.hostile.damage import assert_complete

from rotorid.documents.base import ProvenanceDocument
from rotorid.documents.result import ResultDocument, identified_model
from rotorid.errors import ModelError
from rotorid.results.provenance import provenance
from rotorid.results.summary import Correlation, ParameterEstimate
from rotorid.settings.identifying import IdentifySettings

NAMES = ("L_p", "L_roll", "tau_roll")
SOUND = ((1.0, 0.5, 0.0), (0.5, 1.0, -0.2), (0.0, -0.2, 1.0))
MATRICES = {
    "no number": ((1.0, math.nan, 0.0), *SOUND[1:]),
    "endless": ((1.0, math.inf, 0.0), *SOUND[1:]),
    "above one": ((1.0, 2.0, 0.0), (2.0, 1.0, -0.2), SOUND[2]),
    "of no parameter with itself": ((0.5, 0.5, 0.0), *SOUND[1:]),
    "not symmetric": ((1.0, -0.5, 0.0), *SOUND[1:]),
    "negative in a direction": ((1.0, 0.9, -0.9), (0.9, 1.0, 0.9), (-0.9, 0.9, 1.0)),
}
DEVIATIONS = {"negative": -0.1, "beyond squares": 1e200, "no number": math.nan}


def document(matrix: Sequence[Sequence[float]] = SOUND, std: float = 0.1, random: float = 0.05) -> ResultDocument:
    estimates = {
        name: ParameterEstimate(value=2.0, unit="1/s", std=std, std_random=random, status="free") for name in NAMES
    }
    return ResultDocument(
        model="rate.roll",
        inputs=["roll_command"],
        outputs=["p"],
        states=["p"],
        parameters=estimates,
        correlation=Correlation(names=NAMES, matrix=tuple(map(tuple, matrix))),
        provenance=ProvenanceDocument.model_validate(provenance([], IdentifySettings())),
    )


def test_a_covariance_comes_back() -> None:
    bounds = identified_model(document(), None).bounds
    np.testing.assert_allclose(bounds.covariance, 0.01 * np.array(SOUND), rtol=1e-12)
    np.testing.assert_allclose(bounds.random, 0.0025 * np.array(SOUND), rtol=1e-12)


def test_what_rounding_does_to_a_correlation_is_kept() -> None:
    within = [[1.0, 1.0 + 1e-9], [1.0, 1.0]]
    assert identified_model(document([[*within[0], 0.0], [*within[1], 0.0], [0.0, 0.0, 1.0]]), None).bounds.names


@pytest.mark.parametrize("matrix", MATRICES.values(), ids=MATRICES.keys())
def test_correlations_of_no_identification_are_refused(matrix: Sequence[Sequence[float]]) -> None:
    with pytest.raises(ModelError, match="numbers that no identification gives") as caught:
        identified_model(document(matrix), None)
    assert_complete(caught.value)


@pytest.mark.parametrize("value", DEVIATIONS.values(), ids=DEVIATIONS.keys())
@pytest.mark.parametrize("which", ["std", "random"])
def test_deviations_of_no_identification_are_refused(which: str, value: float) -> None:
    with pytest.raises(ModelError, match="numbers that no identification gives"):
        identified_model(document(**{which: value}), None)
