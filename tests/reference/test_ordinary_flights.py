"""An ordinary flight of a real autopilot: every verb takes the same parts of it, and says the same of its loops."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

import rotorid
from rotorid.data.quantity import Quantity
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.loops.rate_loops import rate_loop, shown_quantities
from rotorid.loops.responses import Responses
from rotorid.proposing.axis import known_axis
from rotorid.tuning.loops import loop_figures
from rotorid.tuning.plant import DRAWS


@pytest.fixture(scope="module")
def verify(unpacked: Callable[[str], Path]) -> FlightRecord:
    return rotorid.read(unpacked("px4_sitl/verify.ulg.xz"))


@pytest.fixture(scope="module")
def calm(unpacked: Callable[[str], Path]) -> FlightRecord:
    return rotorid.read(unpacked("ardupilot_sitl/x_calm_verify.BIN.xz"))


def test_response_takes_the_parts_that_identify_takes(verify: FlightRecord) -> None:
    model = rotorid.identify(verify, "rate.pitch")
    found = rotorid.response(verify, inputs="pitch_command", outputs="q")
    assert isinstance(found, Responses)
    fitted = [(one.start_s, one.stop_s) for one in model.provenance.maneuvers]
    assert [(one.start_s, one.stop_s) for one in found.records if one.used] == fitted
    biases = [
        {name: round(number, 6) for name, number in one.numbers.items()}
        for findings in (model.findings, found.findings)
        for one in findings
        if one.kind == "closed_loop_bias"
    ]
    assert len(biases) == 2
    assert biases[0] == biases[1]


def test_review_and_tune_read_one_loop(verify: FlightRecord) -> None:
    loop = rate_loop("roll", verify)
    shown = _read_by_tune(verify)
    for name in ("crossover_rad_s", "phase_margin_deg", "delay_margin_s"):
        assert shown[name].value == pytest.approx(loop.numbers[name].value, rel=1e-4)
    # Its plant and its gains are known: 14.7 rad/s.
    assert shown["crossover_rad_s"].lower < 14.7 < shown["crossover_rad_s"].upper


def _read_by_tune(record: FlightRecord) -> Mapping[str, Quantity]:
    known = known_axis("roll", (), [record], filters={}, draws=DRAWS, seed=0, findings=[])
    assert known.plant.band_rad_s == pytest.approx(rate_loop("roll", record).plant.band_rad_s, rel=1e-9)
    figures = loop_figures(
        known.omega_rad_s,
        known.drawn() * known.flown_parts.rate(known.gains),
        from_rad_s=known.plant.known_from_rad_s,
    )
    return shown_quantities(figures, known.plant)


def test_gains_are_not_judged_by_a_plant_that_ends_far_below_the_crossover(calm: FlightRecord) -> None:
    """The stick shows the plant up to 17 rad/s, the loop crosses over at 126; the set-point of the rate shows that."""
    loop = rate_loop("roll", calm)
    assert loop.crossover_measured
    # Broken at the mixer, that loop has a phase margin of 19 degrees.
    assert loop.numbers["phase_margin_deg"].value == pytest.approx(19.0, abs=3.0)
    with pytest.raises(InsufficientDataError, match=r"measured up to 16\.5 Hz only, below the crossover"):
        known_axis("roll", (), [calm], filters={}, draws=DRAWS, seed=0, findings=[])
