"""The same gains of a flight, whether tune has its log, the result of identify, or both."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from tests.documents_alike import alike

import rotorid
from rotorid.data.axes import RATE_OF
from rotorid.documents.result import load, save
from rotorid.documents.tune import tune_document
from rotorid.flights.controllers import controllers_of
from rotorid.identifying.identification import controller_settings
from rotorid.proposing import TuningProposal, tune
from rotorid.proposing.flown_gains import flown_axis
from rotorid.signal.autopilot_filters import controller_filters, known_filters
from rotorid.typing import Axis

FLIGHTS: list[tuple[str, Axis]] = [
    ("px4_sitl/roll.ulg", "roll"),
    ("px4_sitl/pitch.ulg.xz", "pitch"),
    ("px4_sitl/yaw.ulg.xz", "yaw"),
    ("ardupilot_sitl/x_wind_rollpitch.BIN.xz", "roll"),
    ("ardupilot_sitl/x_wind_rollpitch.BIN.xz", "pitch"),
    ("real_stacks/px4_sih_offboard_plan.ulg.xz", "roll"),
    ("real_stacks/ap_x_wind_soft_card_flight.BIN.xz", "pitch"),
    ("real_stacks/ap_x_guided_multisine.BIN.xz", "roll"),
]
_ROUTINE = (0, 6)
"""Places of the flights that every run of the tests looks at: one for each autopilot, one of them real."""
LOGS = sorted({name for name, _ in FLIGHTS} | {"everyday/betaflight_431_freestyle.bbl.xz"})
_ONE_LINE = {"room_not_checked"}
"""Kinds of findings by which a result says what its log would add."""

Three = Callable[[str, Axis], tuple[rotorid.FlightRecord, dict[str, TuningProposal]]]


@pytest.fixture(scope="module")
def three(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Three:
    """Proposals for one axis of a flight, by what tune was given; each made once."""
    logs: dict[str, rotorid.FlightRecord] = {}

    @cache
    def proposals(name: str, axis: Axis) -> tuple[rotorid.FlightRecord, dict[str, TuningProposal]]:
        log = logs.setdefault(name, rotorid.read(shared_data / name))
        folder = tmp_path_factory.mktemp("result")
        save(rotorid.identify(log, f"rate.{axis}"), folder)
        result = load(folder)
        return log, {
            "log": tune(records=log, axes=(axis,)),
            "result": tune(result, axes=(axis,)),
            "both": tune(result, log, axes=(axis,)),
        }

    return proposals


@pytest.mark.parametrize(
    ("name", "axis"),
    [
        pytest.param(*flight, marks=() if place in _ROUTINE else pytest.mark.slow)
        for place, flight in enumerate(FLIGHTS)
    ],
)
def test_a_log_its_result_and_both_give_one_proposal(name: str, axis: Axis, three: Three) -> None:
    _, found = three(name, axis)
    documents = {given: tune_document(proposal).model_dump()["axes"][axis] for given, proposal in found.items()}
    assert alike(documents["result"], documents["log"])
    assert alike(documents["both"], documents["log"])
    assert found["result"].files == found["log"].files == found["both"].files
    for given in ("result", "both"):
        one, other = (found[which].axes[axis].proposal.proposed for which in (given, "log"))
        np.testing.assert_allclose(one.whole.sensitivity_peak, other.whole.sensitivity_peak, rtol=1e-6)
    # What the log adds is said in one line, and nothing else of the axis differs.
    kinds = {given: {one.kind for one in proposal.findings if one.where == axis} for given, proposal in found.items()}
    assert kinds["result"] == kinds["log"] == kinds["both"]
    told = [one for one in found["result"].findings if one.kind in _ONE_LINE]
    assert len(told) == 1
    assert "was given without its log, so motor limits" in told[0].message
    noise = three(name, axis)[1]["result"].axes[axis].parts.gyro_noise
    assert ("the noise of the gyro were not checked" in told[0].message) == (noise is None)


@pytest.mark.parametrize("name", LOGS)
def test_a_result_keeps_the_controller_and_the_filters_of_its_log(name: str, shared_data: Path) -> None:
    log = rotorid.read(shared_data / name)
    sources = {
        rate: next(topic.channels[row].source for topic, row in log.holding(rate))
        for rate in RATE_OF.values()
        if rate in log.channel_names
    }
    known = controller_settings([log])
    assert known is not None

    class Model:
        controller, name = known, "rate.roll"
        provenance = type("Provenance", (), {"sources": sources, "maneuvers": ()})
        data = type("Data", (), {"command_densities": {}, "rate_densities": {}})

    for axis in RATE_OF:
        kept = flown_axis(axis, Model, None)  # type: ignore[arg-type]
        source = sources[RATE_OF[axis]]
        logged = controllers_of(log).axis(axis)
        assert logged is not None
        assert kept.controller.controller == logged.controller
        assert kept.controller.ends == logged.ends
        assert controller_filters(kept.record) == controller_filters(log)
        assert kept.passed == known_filters(log, source)


@pytest.mark.slow
def test_a_filter_is_tried_on_a_result_alone_too(three: Three, shared_data: Path, tmp_path: Path) -> None:
    log = rotorid.read(shared_data / "ardupilot_sitl/x_wind_rollpitch.BIN.xz")
    save(rotorid.identify(log, "rate.roll"), tmp_path)
    result, filters = load(tmp_path), {"INS_GYRO_FILTER": 60.0}
    one, other = (tune(result, logs, axes=("roll",), filters=filters) for logs in ((), log))
    assert one.axes["roll"].parameters == other.axes["roll"].parameters
    assert one.files == other.files


@pytest.mark.slow
def test_a_rate_whose_filter_was_taken_out_has_it_in_its_loop(shared_data: Path) -> None:
    """Without it the loop would look faster than it is by the delay of the filter."""
    log = rotorid.read(shared_data / "real_stacks/ap_x_guided_multisine.BIN.xz")
    peaks = []
    for corrected in (False, True):
        model = rotorid.identify(log, "rate.roll", correct_filters=corrected)
        peaks.append(
            float(np.median(tune(model, log, axes=("roll",)).axes["roll"].proposal.flown.whole.sensitivity_peak))
        )
    assert peaks[1] == pytest.approx(peaks[0], rel=0.1)


def test_a_filtered_rate_alone_shows_the_loop_that_an_injection_measured(three: Three) -> None:
    """Beyond its band the plant has the filter that the log names, and no pure delay in its place."""
    _, found = three("real_stacks/ap_x_guided_multisine.BIN.xz", "roll")
    one = found["log"].axes["roll"].proposal
    # The same gains by injection: M_s 1.88, 61 rad/s.
    assert np.median(one.flown.whole.sensitivity_peak) == pytest.approx(1.88, rel=0.1)
    assert np.median(one.flown.rate.usual_crossover_rad_s) == pytest.approx(61.0, rel=0.1)
    assert pytest.approx(0.070, rel=0.06) == one.proposed.gains.P
    assert pytest.approx(0.67, rel=0.06) == one.proposed.gains.I


def test_equal_plants_have_equal_gains(shared_data: Path) -> None:
    log = rotorid.read(shared_data / "real_stacks/px4_sih_offboard_plan.ulg.xz")
    found = tune(records=log, axes=("roll", "pitch")).axes
    roll, pitch = (found[axis].proposal.proposed.gains for axis in ("roll", "pitch"))
    for name, value in (("P", 0.3), ("I", 0.788), ("D", 0.0052), ("A", 5.535)):
        assert getattr(roll, name) == pytest.approx(value, rel=0.02)
        assert getattr(pitch, name) == pytest.approx(value, rel=0.02)
