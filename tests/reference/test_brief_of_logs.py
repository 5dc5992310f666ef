"""The brief of a review fits into 20 kB with nothing left out, for logs of every family."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

import rotorid
from rotorid.documents.base import to_json
from rotorid.documents.brief import MOST_BYTES, BriefDocument, brief_document

LONG = pytest.mark.slow

LOGS = [
    "px4/s250_2017.ulg",
    "everyday/px4_165_fixed_wing_never_flown.ulg.xz",
    "field/maik_00000003.BIN",
    "real_stacks/ap_x_wind_ordinary_hard.BIN.xz",
    pytest.param("everyday/px4_115_s500.ulg.xz", marks=LONG),
    pytest.param("px4_sitl/roll.ulg", marks=LONG),
    pytest.param("ardupilot/beast_0036.BIN", marks=LONG),
    pytest.param("ardupilot_sitl/x_wind_rollpitch.BIN.xz", marks=LONG),
    pytest.param("everyday/arducopter_321_1.BIN.xz", marks=LONG),
    pytest.param("everyday/betaflight_431_freestyle.bbl.xz", marks=LONG),
    pytest.param("betaflight/smooth_tune.BBL", marks=LONG),
    pytest.param("crazyflie/log10", marks=LONG),
    pytest.param("field/f7_motors_only.xz", marks=LONG),
]


@pytest.mark.parametrize("name", LOGS)
def test_the_brief_of_a_log_is_small_and_whole(unpacked: Callable[[str], Path], name: str) -> None:
    document = brief_document(rotorid.review(rotorid.read(unpacked(name), sandbox=False)))
    text = to_json(document, indent=None)
    assert len(text.encode()) < MOST_BYTES
    assert BriefDocument.model_validate_json(text) == document
    assert not {kind for kind, count in document.left_out.model_dump().items() if count} - {"notes"}
    spans = [span for answer in document.answers for span in answer.evidence_s]
    assert all(start_s <= stop_s for start_s, stop_s in spans)
    if not document.flights_s:
        assert {answer.state for answer in document.answers} == {"cannot"}
        assert spans == []
