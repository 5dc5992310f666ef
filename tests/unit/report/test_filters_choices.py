"""What pages say of a curve of filters with gains."""

from __future__ import annotations

from typing import cast

import pytest
from tests.unit.proposing.test_filter_curve_points import KEPT, point

from rotorid.documents.filter_curve import FilterCurveDocument, curve_document
from rotorid.proposing.filter_curve import FilterPoint, _numbered
from rotorid.report.filters import choice_sentence


def sentence(*points: FilterPoint) -> str:
    ordered = sorted([*points, KEPT], key=lambda one: one.noise)
    return choice_sentence(cast("FilterCurveDocument", curve_document(_numbered(ordered, KEPT))))


@pytest.mark.parametrize(
    ("noise", "attitude", "said"),
    [
        (0.8, 0.9, "Better filters for these gains: --filters 1"),
        (0.8, 1.1, "For less noise, fly another choice"),
        (1.2, 0.9, "No choice makes less noise."),
    ],
)
def test_what_to_do_compares_with_the_proposed_gains(noise: float, attitude: float, said: str) -> None:
    """Not with the flown ones, which may be quieter than every proposal."""
    assert said in sentence(point(noise, attitude))
