"""What ``inspect`` says of real and simulated logs is what a fit of the model then does, or refuses, with its words."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

import rotorid
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.fleets.work import flights_of
from rotorid.flights.flights import longest_flight
from rotorid.flights.supports import supported_models
from rotorid.identifying.identify_many import identify_several
from rotorid.models.library import RATE_AXES
from rotorid.results.model import IdentifiedModel
from rotorid.reviewing.assembly import review
from rotorid.reviewing.flight import flight
from rotorid.reviewing.inspection import Inspection, inspect

QUICK = ("px4_sitl/roll.ulg", "px4_sitl/pitch.ulg.xz", "px4/sample.ulg", "real_stacks/ap_x_wind_limit_cycle.BIN.xz")
FURTHER = (
    *(f"px4_sitl/{name}" for name in ("yaw.ulg.xz", "thrust.ulg.xz", "verify.ulg.xz")),
    *("px4/s250_2017.ulg", "px4/sample_log_small.ulg", "px4/sample_old_1MB.ulg"),
    "px4/sample_logging_tagged_and_default_params.ulg",
    *(f"ardupilot_sitl/{name}" for name in ("x_calm_roll.BIN", "x_calm_verify.BIN.xz", "x_wind_rollpitch.BIN.xz")),
    *("ardupilot/erle_brain3.BIN", "ardupilot/beast_0036.BIN", "betaflight/smooth_tune.BBL", "crazyflie/log10"),
    *("s500/roll_sweeps.csv", "s500/pitch_doublets.csv", "s500/thrust_sweeps.csv"),
    *("everyday/arducopter_321_1.BIN.xz", "everyday/arducopter_462_log_4.bin.xz", "everyday/px4_115_s500.ulg.xz"),
    *("everyday/arducopter_462_log_5.bin.xz", "everyday/betaflight_431_freestyle.bbl.xz"),
    *("everyday/betaflight_damaged_test_log.BFL.xz", "everyday/px4_165_fixed_wing_never_flown.ulg.xz"),
    *(f"real_stacks/ap_x_{name}.BIN.xz" for name in ("guided_multisine", "wind_ordinary_hard", "wind_ordinary_soft")),
    *("real_stacks/ap_x_wind_soft_card_flight.BIN.xz", "real_stacks/px4_sih_offboard_plan.ulg.xz"),
)
LOGS = (*QUICK, *(pytest.param(log, marks=pytest.mark.slow) for log in FURTHER))

OF_THE_FIT = {"poor_fit", "structure_error", "not_identifiable", "impossible_physics", "no_excitation"}
"""Kinds of refusals that only a fit can find; an excitation of motors among them is one that explains no motion."""


@pytest.fixture(scope="module")
def looked(unpacked: Callable[[str], Path]) -> Callable[[str], tuple[FlightRecord, Inspection]]:
    """A log and what is said of it, each once."""

    @cache
    def look(log: str) -> tuple[FlightRecord, Inspection]:
        record = rotorid.read(unpacked(log))
        return record, inspect(record)

    return look


@pytest.mark.parametrize("log", LOGS)
def test_every_model_does_what_inspect_said(log: str, looked: Callable[[str], tuple[FlightRecord, Inspection]]) -> None:
    record, inspection = looked(log)
    several = identify_several(record)
    for name, support in inspection.supports.items():
        answer = several.get(name)
        if support.possible:
            kinds = set() if isinstance(answer, IdentifiedModel) else {f.kind for f in answer.findings}  # type: ignore[union-attr]
            assert isinstance(answer, IdentifiedModel) or kinds & OF_THE_FIT, (name, kinds)
            # What may still be refused is said; that an excitation may be incoherent, or a model wrong, the page says.
            assert (
                isinstance(answer, IdentifiedModel)
                or support.by == "excitation"
                or "rotorid identify" in support.because
            )
        elif answer is not None:
            assert not isinstance(answer, IdentifiedModel), name
            assert support.because.removeprefix("the log ") in " ".join(finding.message for finding in answer.findings)
        elif name in RATE_AXES:
            with pytest.raises(InsufficientDataError) as refused:
                rotorid.identify(record, name)
            assert support.because in str(refused.value)


@pytest.mark.parametrize("log", LOGS)
def test_flights_have_one_start_stop_and_number(
    log: str, looked: Callable[[str], tuple[FlightRecord, Inspection]]
) -> None:
    record, inspection = looked(log)
    try:
        summary, _ = flight(record)
    except InsufficientDataError:
        assert not inspection.flights
        return
    assert summary.flights == tuple((one.start_s, one.stop_s) for one in inspection.flights)
    assert {one.seen_in for one in inspection.flights} == {summary.seen_in}
    assert longest_flight(record, or_whole=False) in summary.flights
    assert set(flights_of(record)) <= set(range(1, len(summary.flights) + 1))


def test_motors_at_their_limits_support_nothing(looked: Callable[[str], tuple[FlightRecord, Inspection]]) -> None:
    """A limit cycle at 22.9 Hz with a motor always at a limit: a fit of yaw gave 6.5 ± 1.9 rad/s² of the true 14.2."""
    record, inspection = looked("real_stacks/ap_x_wind_limit_cycle.BIN.xz")
    assert supported_models([record]) == ()
    assert not any(support.possible for support in inspection.supports.values())
    assert "the motor limits, not the vehicle" in inspection.supports["rate.yaw"].because
    assert inspection.supports["rate.yaw"].remedy == "end the oscillation first"
    (hidden,) = [one for one in review(record).cannot_tell if one.what == "models"]
    assert inspection.supports["rate.yaw"].because in hidden.why
